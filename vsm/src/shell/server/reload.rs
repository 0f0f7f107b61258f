//! The configuration is read again while the bridge serves: at SIGHUP, and for `vsm reload`.
//!
//! It is checked as a whole first, and everything that a new vehicle needs is opened. What then fails leaves the bridge as
//! it was; what it keeps until a restart is named ([`Config::changes`]). Links of vehicles that stay are not touched.
//!
//! Files and names are read on a thread of their own ([`read`]): a folder of elevation files takes seconds, a name whose
//! server does not answer half a minute, and a vehicle in flight misses heartbeats and set points after one.

use std::path::{Path, PathBuf};
use std::rc::Rc;
use std::thread;
use std::time::Duration;

use mavlink_link::Now;
use mavlink_link::signing::KeyId;
use stanag_msgs::Id;
use tokio::net::UnixListener;
use tokio::signal::unix::{SignalKind, signal};
use tokio::sync::oneshot::error::TryRecvError;
use tokio::sync::{Notify, oneshot};
use tokio::time::{sleep, timeout};

use super::StartError;
use super::forward::{self, Forwards, OpenForward, Served};
use super::shared::{Core, OpenPort, Shared};
use super::tasks::{receive_forward, receive_vehicle};
use super::vehicle::{find_port, open_exchange, open_keys, open_port, record_vehicle};
use crate::config::{Changes, Config, ForwardLink, LinkAddress, Report, Signing, Vehicle};
use crate::key_exchange::KeyExchange;
use crate::session::LinkEnd;
use crate::shell::clock::NOT_BEFORE;
use crate::shell::ordered_files::OrderedKeys;
use crate::shell::recording::Recording;
use crate::shell::sockets::{Hosts, VehicleReader, VehicleWriter};
use crate::shell::status_socket;
use crate::shell::tasks::{Beat, Later};

/// Waits for requests and carries them out, one by one.
pub(super) async fn serve(
    shared: Rc<Shared>,
    beat: Rc<Beat>,
    later: Later,
    path: PathBuf,
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
        let report = match beat.during(reading.run(&shared, &path)).await {
            Ok(new) => reload(&shared, &later, new),
            Err(why) => Report::refused(why),
        };
        log(&path, &report);
        if let Some(stream) = stream {
            status_socket::answer(stream, &report, ANSWER_WITHIN).await;
        }
    }
}

fn log(path: &Path, report: &Report) {
    let path = path.display();
    if let Some(why) = &report.refused {
        return tracing::error!("{path} is refused, nothing has changed: {why}");
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

/// What a configuration needs of files and name servers.
struct Reread {
    config: Config,
    hosts: Hosts,
}

/// The thread that reads them, one at a time.
#[derive(Default)]
struct Reading(Option<oneshot::Receiver<Result<Reread, String>>>);

impl Reading {
    /// # Errors
    /// Something cannot be read, or takes too long: why. Nothing has changed.
    async fn run(&mut self, shared: &Shared, path: &Path) -> Result<Reread, String> {
        let earlier = self.0.as_mut().map(oneshot::Receiver::try_recv);
        if let Some(Err(TryRecvError::Empty)) = earlier {
            return Err(
                "an earlier reload still waits for a file or a name server: reload again once it has answered"
                    .to_owned(),
            );
        }
        let (sender, receiver) = oneshot::channel();
        let open = {
            let core = shared.core.borrow();
            let ports = core.ports.iter().flatten();
            Open {
                config: core.config.clone(),
                ports: ports.map(|one| one.link.clone()).collect(),
                forwards: core.forwards.iter().map(|one| one.link.clone()).collect(),
            }
        };
        let path = path.to_owned();
        // Not the runtime's own thread for such work: the end of the program would wait for it.
        thread::Builder::new()
            .name("reload".to_owned())
            .spawn(move || drop(sender.send(read(&path, &open))))
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

/// What is there already, and needs no name server.
struct Open {
    config: Config,
    ports: Vec<LinkAddress>,
    forwards: Vec<ForwardLink>,
}

/// Reads everything that may take its time. Blocks.
fn read(path: &Path, open: &Open) -> Result<Reread, String> {
    let mut config = Config::load(path).map_err(|fault| fault.to_string())?;
    let read = config.read_terrain(Some(&open.config));
    read.map_err(|fault| fault.to_string())?;
    let is_new = |one: &&Vehicle| open.config.vehicles().all(|known| known.id != one.id);
    let vehicles = config.vehicles().filter(is_new).map(|one| &one.link);
    let vehicles = vehicles.filter(|link| !open.ports.contains(link));
    let vehicles = vehicles.filter_map(|link| Some(("vehicle.link", link.host()?)));
    let forwards = config.forwards().map(|one| &one.link);
    let forwards = forwards.filter(|link| !open.forwards.contains(link));
    let forwards = forwards.filter_map(|link| Some(("forward.link", link.host()?)));
    let hosts = Hosts::ask(vehicles.chain(forwards)).map_err(|fault| fault.to_string())?;
    Ok(Reread { config, hosts })
}

/// What a vehicle that is added comes with.
struct Added {
    vehicle: Vehicle,
    end: LinkEnd,
    keys: Option<OrderedKeys>,
    writer: VehicleWriter,
    recording: Option<Recording>,
}

/// Links that were opened for them.
type Opened = Vec<(VehicleReader, OpenPort)>;

fn reload(shared: &Rc<Shared>, later: &Later, new: Reread) -> Report {
    let Reread { config: new, hosts } = new;
    let stored = shared.stored.clone();
    let applied = shared.with(|core, now| {
        let Changes { config, report } = core.config.changes(&new)?;
        check_removed(core, &config)?;
        let opened = open_added(core, &config, &hosts, &stored, now);
        let (opened, forwards) = opened.map_err(|fault| fault.to_string())?;
        let Forwards {
            ends,
            opened: new,
            readers,
        } = forwards;
        let numbers: Vec<usize> = ends.iter().map(|(number, _)| *number).collect();
        let Core { bridge, store, .. } = core;
        let prepared = bridge.prepare_forwards(&config, ends, now, NOT_BEFORE, store);
        let prepared = prepared.map_err(|fault| fault.to_string())?;
        let receivers = apply(core, config, opened, now).map_err(|fault| fault.to_string())?;
        core.bridge.take_forwards(prepared);
        change_forwards(core, &numbers, new);
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

/// A vehicle in flight is not left to itself, and its key not to another while it is locked.
fn check_removed(core: &Core, config: &Config) -> Result<(), String> {
    let is_listed = |id: Id| config.vehicles().any(|one| one.id == id);
    for vehicle in core.config.vehicles().filter(|one| !is_listed(one.id)) {
        let id = vehicle.id;
        if core.bridge.is_flying(id) {
            return Err(format!(
                "vehicle {id} is armed and cannot be removed: reload again once it is disarmed, or keep its [[vehicle]]"
            ));
        }
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

/// Keys, links and recordings of the vehicles that are added, and what other ground stations need. No key is anybody's twice.
fn open_added(
    core: &mut Core,
    config: &Config,
    hosts: &Hosts,
    stored: &std::sync::Arc<Notify>,
    now: Now,
) -> Result<((Vec<Added>, Opened), Forwards), StartError> {
    let mut known: Vec<(Id, KeyId)> = vec![];
    for (id, keys) in core.bridge.vehicles().zip(&core.key_stores) {
        let held = keys.as_ref().map(|keys| keys.keys.ids()).transpose()?;
        known.extend(held.into_iter().flatten().map(|key| (id, key)));
    }
    let (mut added, mut opened) = (vec![], Opened::new());
    for vehicle in config.vehicles() {
        if core.config.vehicles().any(|one| one.id == vehicle.id) {
            continue;
        }
        let (key, keys) = open_keys(vehicle, &mut known, &mut core.store)?;
        let start = |keys| OrderedKeys::start(keys, core.store.files(), stored.clone());
        let keys = keys.map(start).transpose().map_err(StartError::Writer)?;
        let is_new = |(_, port): &&(VehicleReader, OpenPort)| port.link == vehicle.link;
        if find_port(&core.ports, &vehicle.link).is_none() && !opened.iter().any(|one| is_new(&one))
        {
            opened.push(open_port(vehicle, hosts, &mut core.store)?);
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
            recording: record_vehicle(config, vehicle, now)?,
        });
    }
    let served = Served {
        config: &core.config,
        bridge: &core.bridge,
        forwards: &core.forwards,
        hosts,
    };
    let forwards = forward::open(config, &known, Some(served), &mut core.store)?;
    Ok(((added, opened), forwards))
}

/// Lets the bridge continue with `config`. Returns what has to be received.
fn apply(
    core: &mut Core,
    config: Config,
    (added, opened): (Vec<Added>, Opened),
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
    // In two steps, so that what fails with a new vehicle can be undone: taking rights away cannot.
    let mut both = core.config.clone();
    let is_new = |id: Id| kept.iter().any(|(vehicle, ..)| vehicle.id == id);
    let new = config.vehicle.iter().filter(|one| is_new(one.get_ref().id));
    both.vehicle.extend(new.cloned());
    core.bridge
        .reload(&both, ends, now, NOT_BEFORE, &mut core.store)?;
    let mut exchanges = vec![];
    let mut begin = || -> Result<(), StartError> {
        for (index, (vehicle, keys, ..)) in (served..).zip(&mut kept) {
            if let Some(OrderedKeys { keys, records, .. }) = keys {
                let machine = (&mut core.bridge, &mut core.store as _);
                let exchange =
                    open_exchange(&both, (index, vehicle), keys, Some(records), now, machine)?;
                exchanges.extend(exchange.map(|exchange| (index, exchange)));
            }
        }
        core.bridge
            .reload(&config, vec![], now, NOT_BEFORE, &mut core.store)?;
        Ok(())
    };
    if let Err(fault) = begin() {
        core.bridge
            .reload(&core.config, vec![], now, NOT_BEFORE, &mut core.store)?;
        return Err(fault);
    }
    for (_, keys, writer, recording) in kept {
        core.writers.push(writer);
        core.key_stores.push(keys);
        core.recordings.push(recording);
    }
    core.exchanges.append(&mut exchanges);
    let before: Vec<Id> = both.vehicles().map(|one| one.id).collect();
    remove_ends(core, &before);
    if let Some(recording) = &mut core.dli_recording {
        recording.set_stations(config.stations().map(|one| one.id).collect());
    }
    core.config = config;
    Ok(change_ports(core, opened))
}

/// Closes what belonged to vehicles that are gone, of those that there were.
fn remove_ends(core: &mut Core, before: &[Id]) {
    let left: Vec<Id> = core.bridge.vehicles().collect();
    for index in (0..before.len())
        .rev()
        .filter(|index| !left.contains(&before[*index]))
    {
        core.writers.remove(index);
        core.key_stores.remove(index);
        if let Some(mut recording) = core.recordings.remove(index) {
            recording.flush();
        }
        core.exchanges.retain(|(at, _)| *at != index);
        let later = core.exchanges.iter_mut().filter(|(at, _)| *at > index);
        later.for_each(|(at, exchange): &mut (usize, KeyExchange)| {
            *at -= 1;
            exchange.set_index(*at);
        });
    }
}

/// Puts links that were opened where the bridge has them, and closes those that no vehicle is on.
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

/// Puts links that were opened where the rest is, and closes those that no ground station is on.
fn change_forwards(core: &mut Core, ends: &[usize], opened: Vec<OpenForward>) {
    core.forwards.extend(opened);
    core.forwards.retain(|one| {
        let stays = ends.contains(&one.number);
        if !stays {
            one.close.notify_one();
        }
        stays
    });
}

const PAUSE: Duration = Duration::from_millis(500);
const ANSWER_WITHIN: Duration = Duration::from_secs(1);
/// Forty tiles from a slow disk, or a name server after another; `vsm reload` waits a little longer.
const READ_WITHIN: Duration = Duration::from_secs(100);
