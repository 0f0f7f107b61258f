//! Reloads the configuration while the bridge serves: on SIGHUP and for `vsm reload`.
//!
//! The whole configuration is checked first, and everything that a new vehicle needs is opened. If that fails, the bridge
//! stays unchanged. Changes that need a restart are listed ([`Config::changes`]). Links of vehicles that stay are not
//! touched. Guard keys are the exception: they are no part of the file, and those that were rotated or revoked come into
//! force also where the file is refused ([`renew_guard_keys`]).
//!
//! Files and host names are read on a separate thread ([`read`]): a folder of elevation files takes seconds, a name server
//! that does not answer half a minute, and after one second a vehicle in flight misses heartbeats and set points. The same
//! applies to key files and recordings of added vehicles, and to their records in the store ([`read_ahead`]).

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::rc::Rc;
use std::sync::Arc;
use std::thread;
use std::time::Duration;

use mavlink_link::Now;
use mavlink_link::clock::Ceiling;
use mavlink_link::service::text::one_line;
use mavlink_link::signing::{KeyId, SigningKey};
use mavlink_link::store::{Disk as _, Record as _};
use stanag_msgs::Id;
use tokio::net::UnixListener;
use tokio::signal::unix::{SignalKind, signal};
use tokio::sync::oneshot::error::TryRecvError;
use tokio::sync::{Notify, oneshot};
use tokio::time::{sleep, timeout};

use super::StartError;
use super::encryption::open_encryption;
use super::forward::{self, Forwards, OpenForward, Served};
use super::guard_thread::{self, Work};
use super::guards;
use super::read_ahead::{Ahead, ReadAhead};
use super::shared::{Core, OpenPort, Shared};
use super::tasks::{receive_forward, receive_vehicle};
use super::vehicle::{check_own, find_port, open_exchange, open_keys, open_port, record_vehicle};
use crate::config::{Changes, Config, ForwardLink, LinkAddress, Report, Signing, Vehicle};
use crate::key_exchange::{ExchangeRecord, IDENTITY, KeyExchange};
use crate::session::{GuardKeyUntil, LinkEnd};
use crate::shell::clock::NOT_BEFORE;
use crate::shell::disk::FileDisk;
use crate::shell::key_store::KeyStore;
use crate::shell::ordered_files::OrderedKeys;
use crate::shell::recording::{Recorder, Recording};
use crate::shell::sockets::{Hosts, Resolver, VehicleReader, VehicleWriter};
use crate::shell::status_socket;
use crate::shell::tasks::{Beat, Later};

/// Waits for requests and carries them out, one by one.
pub(super) async fn serve(
    shared: Rc<Shared>,
    beat: Rc<Beat>,
    later: Later,
    (path, resolver): (PathBuf, Resolver),
    listener: UnixListener,
) {
    let mut hangup = match signal(SignalKind::hangup()) {
        Ok(hangup) => Some(hangup),
        Err(cause) => {
            tracing::warn!("SIGHUP cannot be received ({cause}): use `vsm reload`");
            None
        }
    };
    let mut reading = Reading::default();
    loop {
        let request = async {
            let signalled = async {
                match &mut hangup {
                    Some(hangup) => hangup.recv().await,
                    None => std::future::pending().await,
                }
            };
            tokio::select! {
                _ = signalled => None,
                accepted = listener.accept() => Some(accepted),
            }
        };
        let stream = match beat.during(request).await {
            None => None,
            Some(Ok((stream, _))) => Some(stream),
            Some(Err(cause)) => {
                tracing::warn!("the socket for reloading: {cause}");
                beat.during(sleep(PAUSE)).await;
                continue;
            }
        };
        let mut report = match beat.during(reading.run(&shared, &path, resolver)).await {
            Ok(new) => reload(&shared, &later, new),
            Err(why) => Report::refused(why),
        };
        if report.refused.is_some() {
            beat.during(renew_guard_keys(&shared, resolver, &mut report))
                .await;
        }
        let refused = refusal(&path, &report);
        shared.with(|core, _| core.bridge.note_reload(refused.as_deref()));
        log(&path, &report);
        if let Some(stream) = stream {
            status_socket::answer(stream, &report, ANSWER_WITHIN).await;
        }
    }
}

/// What the status shows of a reload that was refused, until one is not.
fn refusal(path: &Path, report: &Report) -> Option<String> {
    let why = report.refused.as_ref()?;
    let kept: String = report.kept.iter().map(|one| format!("; {one}")).collect();
    let path = path.display().to_string();
    // The fault of a file names it already.
    let text = match why.starts_with(&path) {
        true => format!("{why}{kept}"),
        false => format!("{path}: {why}{kept}"),
    };
    Some(one_line(&text).into_owned())
}

fn log(path: &Path, report: &Report) {
    let path = path.display();
    if let Some(why) = &report.refused {
        tracing::error!("{path} is refused, nothing has changed: {why}");
        for change in &report.applied {
            tracing::warn!("{path} is refused, and applied is: {change}");
        }
        for kept in &report.kept {
            tracing::error!("{kept}");
        }
        return;
    }
    match report.applied.join("; ") {
        none if none.is_empty() => tracing::info!("{path} is read again: nothing to apply"),
        applied => tracing::info!("{path} is read again: {applied}"),
    }
    if !report.restart.is_empty() {
        let keys = report.restart.join("; ");
        tracing::warn!("{path}: these wait for a restart: {keys}");
    }
}

/// What a configuration needs from files and name servers.
struct Reread {
    changes: Changes,
    hosts: Hosts,
    /// For the added vehicles.
    files: BTreeMap<Id, Files>,
    /// For the ground stations beside the bridge.
    forward_keys: Vec<Option<SigningKey>>,
    /// For the ground stations with a guard.
    guard_keys: Vec<(Id, Vec<GuardKeyUntil>)>,
    /// The file of the access list, where one is configured.
    access: Option<Result<Vec<u8>, String>>,
    /// The store's records of what is added.
    ahead: ReadAhead,
}

/// Keys and recording of an added vehicle.
struct Files {
    key: Option<SigningKey>,
    keys: Option<OrderedKeys>,
    recording: Option<Recording>,
}

/// The thread that reads them, one at a time.
#[derive(Default)]
struct Reading(Option<oneshot::Receiver<Result<Reread, String>>>);

impl Reading {
    /// # Errors
    /// Something cannot be read, or takes too long: why. Nothing has changed.
    async fn run(
        &mut self,
        shared: &Shared,
        path: &Path,
        resolver: Resolver,
    ) -> Result<Reread, String> {
        // Drop the late result of an earlier reload: it holds locks on files of vehicles, which this reload needs.
        let waits = matches!(
            self.0.as_mut().map(oneshot::Receiver::try_recv),
            Some(Err(TryRecvError::Empty))
        );
        if waits {
            return Err(
                "an earlier reload is still waiting for a file or a name server: reload again once that has answered"
                    .to_owned(),
            );
        }
        // A vehicle that was removed a moment ago may be added again: what it has left is read from its files.
        let until = shared.core.borrow().store.queued();
        let is_written = || shared.core.borrow().store.is_tried(until);
        let written = async {
            while !is_written() {
                sleep(LOOK_AGAIN).await;
            }
        };
        if timeout(WRITTEN_WITHIN, written).await.is_err() {
            return Err("the disk of the store is too slow: reload again".to_owned());
        }
        let (sender, receiver) = oneshot::channel();
        let mut open = Open::of(shared, resolver);
        let path = path.to_owned();
        // Not the runtime's own thread pool: the end of the program would wait for it.
        thread::Builder::new()
            .name("reload".to_owned())
            .spawn(move || drop(sender.send(read(&path, &mut open))))
            .map_err(|cause| format!("no thread to read it: {cause}"))?;
        let receiver = self.0.insert(receiver);
        match timeout(READ_WITHIN, receiver).await {
            Ok(read) => {
                self.0 = None;
                read.unwrap_or_else(|_| Err("the thread that reads it ended".to_owned()))
            }
            Err(_) => Err(format!(
                "its files and names are not read after {} s: look at vehicle.terrain, and the hosts of udpout and tcpout \
                 links",
                READ_WITHIN.as_secs()
            )),
        }
    }
}

/// What is open already, and needs no name server; and the means to read the rest.
struct Open {
    config: Config,
    ports: Vec<LinkAddress>,
    forwards: Vec<ForwardLink>,
    keys: Vec<(Id, KeyStore)>,
    store: FileDisk,
    stored: Arc<Notify>,
    recorder: Recorder,
    now: Now,
    resolver: Resolver,
}

impl Open {
    fn of(shared: &Shared, resolver: Resolver) -> Open {
        let core = shared.core.borrow();
        let ports = core.ports.iter().flatten();
        let keys = core.bridge.vehicles().zip(&core.key_stores);
        let view = |(id, keys): (Id, &Option<OrderedKeys>)| {
            let OrderedKeys { keys, files, .. } = keys.as_ref()?;
            Some((id, keys.view(Box::new(files.clone()))))
        };
        Open {
            config: core.config.clone(),
            ports: ports.map(|one| one.link.clone()).collect(),
            forwards: core.forwards.iter().map(|one| one.link.clone()).collect(),
            keys: keys.filter_map(view).collect(),
            store: core.store.files().shared(),
            stored: shared.stored.clone(),
            recorder: core.recorder.clone(),
            now: shared.clock.now(),
            resolver,
        }
    }
}

/// Puts the guard keys of the running configuration in force as their files have them now, though the new configuration is
/// refused: a key that was revoked must not stay in force because of a mistake elsewhere in that file.
async fn renew_guard_keys(shared: &Shared, resolver: Resolver, report: &mut Report) {
    let open = Open::of(shared, resolver);
    if open.config.stations().all(|one| one.guard.is_none()) {
        return;
    }
    let (sender, receiver) = oneshot::channel();
    let spawned = thread::Builder::new()
        .name("guard files".to_owned())
        .spawn(move || drop(sender.send(read_guard_keys(&open))));
    let read = match spawned {
        Ok(_) => timeout(READ_KEYS_WITHIN, receiver)
            .await
            .ok()
            .and_then(Result::ok),
        Err(_) => None,
    };
    shared.with(|core, now| {
        let before = core.bridge.guard_key_ids();
        let Some(read) = read else {
            let why = "its file is not read in time";
            let each = before.iter().map(|(id, _)| kept(&before, *id, why));
            return report.kept.extend(each);
        };
        let mut good = vec![];
        for (id, keys) in read {
            match keys {
                Ok(keys) => good.push((id, keys)),
                Err(why) => report.kept.push(kept(&before, id, &why)),
            }
        }
        let Core { bridge, store, .. } = core;
        if let Err(fault) = bridge.set_guard_keys(good, now, NOT_BEFORE, store) {
            tracing::error!("a CUCS has no guard key: {fault}");
        }
        report_guard_keys(&before, &bridge.guard_key_ids(), report);
        // A pairing that was ended must not lead to another key.
        let paths = guard_thread::paths(&core.config);
        core.guard_thread.give(Work::Files(paths));
    });
}

/// The guard keys of the running configuration, each by itself. Blocks.
fn read_guard_keys(open: &Open) -> Vec<(Id, Result<Vec<GuardKeyUntil>, String>)> {
    let mut known = vec![];
    for (id, keys) in &open.keys {
        // What is wrong with a vehicle's key says nothing about those of guards.
        let _ = check_own(*id, Some(keys), &mut known);
    }
    let forward_keys = forward::keys(&open.config, &known).unwrap_or_default();
    let others = forward::owners(&open.config, &known, &forward_keys);
    let each = guards::each(&open.config, others, open.now).into_iter();
    each.map(|(id, keys)| (id, keys.map_err(|fault| fault.to_string())))
        .collect()
}

/// That the key of a guard stays in force.
fn kept(before: &[(Id, Option<String>)], id: Id, why: &str) -> String {
    let before = before.iter().find(|(known, _)| *known == id);
    match before.and_then(|(_, key)| key.as_ref()) {
        Some(key) => format!("cucs {id} guard key {key} stays in force: {why}"),
        None => format!("cucs {id} has no guard key: {why}"),
    }
}

/// Reads everything that may be slow. Blocks.
fn read(path: &Path, open: &mut Open) -> Result<Reread, String> {
    let mut config = Config::load(path).map_err(|fault| fault.to_string())?;
    let read = config.read_terrain(Some(&open.config));
    read.map_err(|fault| fault.to_string())?;
    let changes = open.config.changes(&config)?;
    let config = &changes.config;
    // Checked here, where a refusal costs nothing: opening the key would fail on the removed vehicle's lock.
    check_heirs(&open.config, config)?;
    let is_new = |one: &&Vehicle| open.config.vehicles().all(|known| known.id != one.id);
    let vehicles = config.vehicles().filter(is_new).map(|one| &one.link);
    let vehicles = vehicles.filter(|link| !open.ports.contains(link));
    let vehicles = vehicles.filter_map(|link| Some(("vehicle.link", link.host()?)));
    let forwards = config.forwards().map(|one| &one.link);
    let forwards = forwards.filter(|link| !open.forwards.contains(link));
    let forwards = forwards.filter_map(|link| Some(("forward.link", link.host()?)));
    let asked = Hosts::ask(vehicles.chain(forwards), open.resolver);
    let hosts = asked.map_err(|fault| fault.to_string())?;
    let mut known = vec![];
    for (id, keys) in &open.keys {
        check_own(*id, Some(keys), &mut known).map_err(|fault| fault.to_string())?;
    }
    let mut files = BTreeMap::new();
    let added: Vec<&Vehicle> = config.vehicles().filter(is_new).collect();
    for vehicle in added {
        let of_it = read_vehicle(config, vehicle, &mut known, open);
        files.insert(vehicle.id, of_it.map_err(|fault| fault.to_string())?);
    }
    let forward_keys = forward::keys(config, &known).map_err(|fault| fault.to_string())?;
    let stations = config.stations().map(|one| one.id);
    let is_listed = |id: &Id| open.config.stations().any(|one| one.id == *id);
    let stations = stations.filter(|id| !is_listed(id));
    let ids = stations.chain(files.keys().copied());
    let ids = ids.map(|id| format!("{:08x}", id.0));
    let others = forward::owners(config, &known, &forward_keys);
    let guard_keys = guards::keys(config, others, open.now).map_err(|fault| fault.to_string())?;
    // The list of the running bridge: another one waits for a restart.
    let access = open.config.access.as_ref();
    let access = access.map(|access| guards::access_list(&access.list));
    let others = forward_keys.iter().flatten().map(SigningKey::id);
    let of_guards = guard_keys.iter().flat_map(|(_, keys)| keys);
    let of_guards = of_guards.map(|(key, _)| key.id());
    let keys = known.iter().map(|(_, key)| *key);
    let keys = keys.chain(others).chain(of_guards);
    let keys = keys.map(|key| Ceiling::name(&key));
    let ahead = ReadAhead::of(&open.store, ids.chain(keys).collect());
    let ahead = ahead.map_err(|fault| fault.to_string())?;
    Ok(Reread {
        hosts,
        files,
        forward_keys,
        guard_keys,
        access,
        ahead,
        changes,
    })
}

/// Opens the keys of an added vehicle, which may be none of a vehicle in `known`, and begins its recording.
fn read_vehicle(
    config: &Config,
    vehicle: &Vehicle,
    known: &mut Vec<(Id, KeyId)>,
    open: &mut Open,
) -> Result<Files, StartError> {
    let (key, keys) = open_keys(vehicle, known, &mut open.store, &KeyStore::open)?;
    let keys = keys.map(|keys| OrderedKeys::start(keys, &open.store, open.stored.clone()));
    if let Some(keys) = &keys {
        // The bridge reads the keys when it begins to serve the vehicle, and the key exchange reads its records.
        let records = [ExchangeRecord::name(&vehicle.id), IDENTITY.to_owned()];
        let records = records.map(|name| open.store.folder().join(name));
        let all = keys.keys.files().into_iter().chain(records);
        keys.files.hold(all).map_err(StartError::Writer)?;
    }
    Ok(Files {
        key,
        keys,
        recording: record_vehicle(config, vehicle, open.now, &open.recorder)?,
    })
}

/// An added vehicle with its resources.
struct Added {
    vehicle: Vehicle,
    end: LinkEnd,
    keys: Option<OrderedKeys>,
    writer: VehicleWriter,
    recording: Option<Recording>,
}

/// Links opened for added vehicles.
type Opened = Vec<(VehicleReader, OpenPort)>;

fn reload(shared: &Rc<Shared>, later: &Later, new: Reread) -> Report {
    let applied = shared.with(|core, now| {
        let Changes { config, mut report } = new.changes;
        let (ahead, guard_keys) = (new.ahead, new.guard_keys);
        // So that the bridge, which compares a ceiling with the one before, reads none from the disk.
        for (name, bytes) in ahead.named() {
            core.store.know(name, bytes);
        }
        check_removed(core, &config)?;
        let access = new.access.map(|file| {
            let file = file.map_err(|why| why.to_string())?;
            let prepared = core.bridge.prepare_access(&file);
            prepared.map_err(|fault| fault.to_string())
        });
        let access = match access.transpose() {
            Ok(access) => access.flatten(),
            Err(why) => {
                core.bridge.refuse_access(&why, now, &mut core.store);
                return Err(why);
            }
        };
        let opened = open_added(
            core,
            &config,
            (&new.hosts, &ahead),
            new.files,
            new.forward_keys,
        );
        let (opened, forwards) = opened.map_err(|fault| fault.to_string())?;
        let Forwards {
            ends,
            opened: new,
            readers,
        } = forwards;
        let numbers: Vec<usize> = ends.iter().map(|(number, _)| *number).collect();
        let Core { bridge, store, .. } = core;
        let store = &mut Ahead::new(store, &ahead);
        let prepared = bridge.prepare_forwards(&config, ends, now, NOT_BEFORE, store);
        let prepared = prepared.map_err(|fault| fault.to_string())?;
        // Stored before the configuration that it narrows is applied, which may grant more.
        if let Err(fault) = bridge.store_access(access.as_ref(), store) {
            let why = format!("the access list cannot be stored: {fault}");
            bridge.refuse_access(&why, now, store);
            return Err(why);
        }
        let applied = apply(core, config, opened, &ahead, now);
        let receivers = applied.map_err(|fault| fault.to_string())?;
        let Core { bridge, store, .. } = core;
        let store = &mut Ahead::new(store, &ahead);
        let before = bridge.guard_key_ids();
        let keyed = bridge.set_guard_keys(guard_keys, now, NOT_BEFORE, store);
        if let Err(fault) = keyed {
            // The bridge accepts nothing of a station without its key. That is no reason to undo the other changes.
            tracing::error!("a CUCS has no guard key: {fault}");
        }
        report_guard_keys(&before, &bridge.guard_key_ids(), &mut report);
        let changed = bridge.take_access(access, now, store);
        report.applied.extend(changed);
        core.bridge.take_forwards(prepared);
        change_forwards(core, &numbers, new);
        let paths = guard_thread::paths(&core.config);
        core.guard_thread.give(Work::Files(paths));
        Ok::<_, String>((report, receivers, readers))
    });
    match applied {
        Err(why) => Report::refused(why),
        Ok((report, receivers, readers)) => {
            for (number, reader, close) in readers {
                let shared = shared.clone();
                later.spawn("ground station receiver", move |beat| {
                    receive_forward(shared, beat, number, reader, close)
                });
            }
            for (port, reader, close) in receivers {
                let shared = shared.clone();
                later.spawn("vehicle receiver", move |beat| {
                    receive_vehicle(shared, beat, port, reader, close)
                });
            }
            for warning in shared.core.borrow().config.warnings() {
                tracing::warn!("{warning}");
            }
            report
        }
    }
}

/// Key files are read again too, and the configuration does not show a changed key.
fn report_guard_keys(
    before: &[(Id, Option<String>)],
    after: &[(Id, Option<String>)],
    report: &mut Report,
) {
    for (id, key) in after {
        let old = before.iter().find(|(known, _)| known == id);
        match (old.and_then(|(_, old)| old.as_ref()), key) {
            (Some(old), Some(key)) if old == key => {}
            (Some(old), Some(key)) => {
                let applied = format!("cucs {id} guard key {old} -> {key}");
                report.applied.push(applied);
            }
            (None, Some(key)) => report.applied.push(format!("cucs {id} guard key {key}")),
            (_, None) => {
                let restart =
                    format!("cucs {id} guard key (the log has why; nothing is taken of it)");
                report.restart.push(restart);
            }
        }
    }
}

/// An armed vehicle must not be removed: nobody could command it any more.
fn check_removed(core: &Core, config: &Config) -> Result<(), String> {
    match removed(&core.config, config).find(|one| core.bridge.is_flying(one.id)) {
        None => Ok(()),
        Some(Vehicle { id, .. }) => Err(format!(
            "vehicle {id} is armed and cannot be removed: reload again once it is disarmed, or keep its [[vehicle]]"
        )),
    }
}

fn removed<'a>(before: &'a Config, config: &'a Config) -> impl Iterator<Item = &'a Vehicle> {
    let is_listed = |id: Id| config.vehicles().any(|one| one.id == id);
    before.vehicles().filter(move |one| !is_listed(one.id))
}

/// The key of a removed vehicle stays locked until the removal is complete.
fn check_heirs(before: &Config, config: &Config) -> Result<(), String> {
    for vehicle in removed(before, config) {
        let id = vehicle.id;
        let Signing::KeyFile(file, _) = &vehicle.signing else {
            continue;
        };
        let same =
            |one: &&Vehicle| matches!(&one.signing, Signing::KeyFile(other, _) if other == file);
        if let Some(heir) = config.vehicles().find(same) {
            return Err(format!(
                "vehicle {} has the key file {} of vehicle {id}, which is removed: remove it first, reload, then add the other",
                heir.id,
                file.display()
            ));
        }
    }
    Ok(())
}

/// The links of the added vehicles, and of other ground stations.
fn open_added(
    core: &mut Core,
    config: &Config,
    (hosts, ahead): (&Hosts, &ReadAhead),
    mut files: BTreeMap<Id, Files>,
    forward_keys: Vec<Option<SigningKey>>,
) -> Result<((Vec<Added>, Opened), Forwards), StartError> {
    let (mut added, mut opened) = (vec![], Opened::new());
    let mut store = Ahead::new(&mut core.store, ahead);
    for vehicle in config.vehicles() {
        let Some(Files {
            key,
            keys,
            recording,
        }) = files.remove(&vehicle.id)
        else {
            continue;
        };
        let is_new = |(_, port): &&(VehicleReader, OpenPort)| port.link == vehicle.link;
        if find_port(&core.ports, &vehicle.link).is_none() && !opened.iter().any(|one| is_new(&one))
        {
            opened.push(open_port(vehicle, hosts, &mut store)?);
        }
        let new = opened.iter().find(is_new).map(|(_, port)| port);
        let Some(port) = find_port(&core.ports, &vehicle.link).or(new) else {
            continue;
        };
        let peer = port.peer;
        added.push(Added {
            vehicle: vehicle.clone(),
            end: LinkEnd { key, peer },
            keys,
            writer: port.writer.clone(),
            recording,
        });
    }
    let served = Served {
        config: &core.config,
        bridge: &core.bridge,
        forwards: &core.forwards,
        hosts,
    };
    let forwards = forward::open(config, forward_keys, Some(served), &mut store)?;
    Ok(((added, opened), forwards))
}

/// Switches the bridge to `config`. Returns the links to receive from.
fn apply(
    core: &mut Core,
    config: Config,
    (added, opened): (Vec<Added>, Opened),
    ahead: &ReadAhead,
    now: Now,
) -> Result<Vec<(usize, VehicleReader, Rc<Notify>)>, StartError> {
    let served = core.writers.len();
    let mut ends = vec![];
    let mut kept = vec![];
    for Added {
        vehicle,
        end,
        keys,
        writer,
        recording,
    } in added
    {
        ends.push(end);
        kept.push((vehicle, keys, writer, recording));
    }
    // In two steps, so that a failure with a new vehicle can be undone: withdrawn rights cannot be given back.
    let mut both = core.config.clone();
    let is_new = |id: Id| kept.iter().any(|(vehicle, ..)| vehicle.id == id);
    let new = config.vehicle.iter().filter(|one| is_new(one.get_ref().id));
    both.vehicle.extend(new.cloned());
    let mut store = Ahead::new(&mut core.store, ahead);
    core.bridge
        .reload(&both, ends, now, NOT_BEFORE, &mut store)?;
    let (mut exchanges, mut encryptions) = (vec![], vec![]);
    let mut begin = || -> Result<(), StartError> {
        for (index, (vehicle, keys, ..)) in (served..).zip(&mut kept) {
            if let Some(OrderedKeys { keys, records, .. }) = keys {
                let machine = (&mut core.bridge, &mut store as _);
                let exchange = open_exchange(
                    &both,
                    (index, vehicle),
                    keys,
                    Some(&mut *records),
                    now,
                    machine,
                )?;
                exchanges.extend(exchange.map(|exchange| (index, exchange)));
                let mut ports = opened.iter().map(|(_, port)| port);
                let port = ports.find(|port| port.link == vehicle.link);
                let at = port.and_then(|port| port.peer);
                let encryption = open_encryption(&both, vehicle, at, now, records)?;
                encryptions.extend(encryption.map(|one| (index, one)));
            }
        }
        core.bridge
            .reload(&config, vec![], now, NOT_BEFORE, &mut store)?;
        Ok(())
    };
    // Back to the vehicles and rights of before.
    if let Err(fault) = begin() {
        core.bridge
            .reload(&core.config, vec![], now, NOT_BEFORE, &mut core.store)?;
        return Err(fault);
    }
    for keys in kept.iter().filter_map(|(_, keys, ..)| keys.as_ref()) {
        keys.files.release();
    }
    for (_, keys, writer, recording) in kept {
        core.writers.push(writer);
        core.key_stores.push(keys);
        core.recordings.push(recording);
    }
    core.exchanges.append(&mut exchanges);
    core.encryptions.append(&mut encryptions);
    let before: Vec<Id> = both.vehicles().map(|one| one.id).collect();
    remove_ends(core, &before);
    if let Some(recording) = &mut core.dli_recording {
        recording.set_stations(config.stations().map(|one| one.id).collect());
    }
    core.config = config;
    Ok(change_ports(core, opened))
}

/// Closes what belonged to removed vehicles; `before` are all vehicles of before.
fn remove_ends(core: &mut Core, before: &[Id]) {
    let left: Vec<Id> = core.bridge.vehicles().collect();
    // From the last to the first, so that the indices still to come stay valid.
    for index in (0..before.len())
        .rev()
        .filter(|index| !left.contains(&before[*index]))
    {
        core.writers.remove(index);
        core.key_stores.remove(index);
        if let Some(mut recording) = core.recordings.remove(index) {
            recording.flush();
        }
        core.encryptions.retain(|(at, _)| *at != index);
        let later = core.encryptions.iter_mut().filter(|(at, _)| *at > index);
        later.for_each(|(at, _)| *at -= 1);
        core.exchanges.retain(|(at, _)| *at != index);
        let later = core.exchanges.iter_mut().filter(|(at, _)| *at > index);
        later.for_each(|(at, exchange): &mut (usize, KeyExchange)| {
            *at -= 1;
            exchange.set_index(*at);
        });
    }
}

/// Puts opened links where the bridge expects them, and closes links that no vehicle uses.
fn change_ports(core: &mut Core, opened: Opened) -> Vec<(usize, VehicleReader, Rc<Notify>)> {
    let Core {
        ports,
        bridge,
        config,
        ..
    } = core;
    let mut receivers = vec![];
    for (reader, port) in opened {
        if let Some(index) = bridge.link_index(&port.link) {
            receivers.push((index, reader, port.close.clone()));
            ports.resize_with(ports.len().max(index + 1), || None);
            ports[index] = Some(port);
        }
    }
    for place in ports.iter_mut() {
        let is_used = |port: &OpenPort| config.vehicles().any(|one| one.link == port.link);
        if let Some(port) = place.take_if(|port| !is_used(port)) {
            port.close.notify_one();
        }
    }
    receivers
}

/// Adds opened links to the others, and closes links that no ground station uses.
fn change_forwards(core: &mut Core, ends: &[usize], opened: Vec<OpenForward>) {
    core.forwards.extend(opened);
    for one in &mut core.forwards {
        // The configuration may name other users now.
        let mut configured = core.config.forwards();
        if let Some(forward) = configured.find(|forward| forward.link == one.link) {
            one.peers = forward::peers(forward);
        }
    }
    core.forwards.retain(|one| {
        let stays = ends.contains(&one.number);
        if !stays {
            one.close.notify_one();
        }
        stays
    });
}

const PAUSE: Duration = Duration::from_millis(500);
const LOOK_AGAIN: Duration = Duration::from_millis(10);
/// Some synchronisations of a slow disk.
const WRITTEN_WITHIN: Duration = Duration::from_secs(5);
const ANSWER_WITHIN: Duration = Duration::from_secs(1);
/// Forty tiles from a slow disk, or several name servers in turn; `vsm reload` waits a little longer.
const READ_WITHIN: Duration = Duration::from_secs(100);
/// A few small files, when the rest has failed.
const READ_KEYS_WITHIN: Duration = Duration::from_secs(10);

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_refusal_is_one_line_with_the_keys_that_stay_in_force() {
        let path = Path::new("vsm.toml");
        let mut report = Report::default();
        assert_eq!(refusal(path, &report), None);
        let before = [(Id(1), Some("a".to_owned())), (Id(2), None)];
        report.refused = Some("line 7:\nno value".to_owned());
        report.kept = vec![kept(&before, Id(1), "no file"), kept(&before, Id(2), "why")];
        let text = refusal(path, &report).unwrap();
        let [first, second] = [Id(1), Id(2)];
        assert_eq!(
            text,
            format!(
                "vsm.toml: line 7: no value; cucs {first} guard key a stays in force: no file; cucs {second} has no guard key: why"
            )
        );
    }

    #[test]
    fn a_guard_key_that_is_another_or_none_is_reported() {
        let key = |id, key: &str| (Id(id), Some(key.to_owned()));
        let before = [key(1, "a"), key(2, "a"), key(3, "a")];
        let after = [key(1, "b"), key(2, "a"), (Id(3), None), key(4, "d")];
        let mut report = Report::default();
        report_guard_keys(&before, &after, &mut report);
        let [first, third, fourth] = [Id(1), Id(3), Id(4)];
        assert_eq!(
            report.applied,
            [
                format!("cucs {first} guard key a -> b"),
                format!("cucs {fourth} guard key d")
            ]
        );
        assert_eq!(report.restart.len(), 1);
        assert!(report.restart[0].contains(&third.to_string()));
    }
}
