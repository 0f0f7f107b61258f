//! How a server comes to its store, keys, sockets and recordings, before anything is sent.

use std::cell::RefCell;
use std::io;
use std::net::SocketAddr;
use std::path::Path;
use std::rc::Rc;
use std::sync::Arc;

use mavlink_link::Now;
use mavlink_link::signing::{KeyId, SigningKey};
use stanag_msgs::Id;
use tokio::net::TcpListener;
use tokio::sync::Notify;

use super::shared::{Core, Shared};
use super::{Server, StartError};
use crate::config::{Config, ExchangeMode, Record, Signing, Vehicle};
use crate::key_exchange::{KeyExchange, Surroundings};
use crate::session::{AuditKey, Bridge, BridgeError, LinkEnd, Peer};
use crate::shell::clock::{Clock, NOT_BEFORE};
use crate::shell::disk::FileDisk;
use crate::shell::dli_recording::DliRecording;
use crate::shell::key_file::system_random;
use crate::shell::key_store::KeyStore;
use crate::shell::ordered_files::OrderedKeys;
use crate::shell::queued_disk::QueuedDisk;
use crate::shell::recording::{Quota, Recording};
use crate::shell::sockets::{self, DliSockets, VehicleWriter};
use crate::shell::{key_file, status_socket};
use mavlink_link::clock::Ceiling;
use mavlink_link::store::Store as _;

impl Server {
    /// Opens store, keys, sockets and recordings. Must be called within a tokio runtime.
    ///
    /// # Errors
    /// Any of them cannot be had; nothing has been sent then.
    pub fn open(config: &Config) -> Result<Server, StartError> {
        // The store's lock comes first: a second bridge stops here, before it touches keys or sockets.
        Server::open_on(config, FileDisk::open(&config.store.dir)?)
    }

    /// As [`Server::open`], with the store on this disk.
    ///
    /// # Errors
    /// As [`Server::open`].
    pub fn open_on(config: &Config, mut store: FileDisk) -> Result<Server, StartError> {
        let clock = Clock::default();
        let now = clock.now();
        let dli = DliSockets::open(&config.dli)?;
        let (mut readers, mut writers, mut ends, mut recordings) = (vec![], vec![], vec![], vec![]);
        let (mut key_stores, mut key_ids) = (vec![], vec![]);
        let mut ports: Vec<(VehicleWriter, Option<Peer>)> = vec![];
        let links = config.links();
        for vehicle in config.vehicles() {
            let (key, keys) = match &vehicle.signing {
                Signing::KeyFile(path, exchange) => {
                    let (key, keys) = vehicle_keys(path, exchange.mode, &mut store)?;
                    (Some(key), Some(keys))
                }
                Signing::Off => (None, None),
            };
            check_own(vehicle.id, keys.as_ref(), &mut key_ids)?;
            key_stores.push(keys);
            let port = links.iter().position(|link| **link == vehicle.link);
            let (writer, peer) = match port.and_then(|port| ports.get(port)) {
                Some(open) => open.clone(),
                None => {
                    let record = format!("port-{:08x}", vehicle.id.0);
                    let (reader, writer, peer) =
                        sockets::open_link("vehicle.link", &vehicle.link, &record, &mut store)?;
                    readers.push(reader);
                    ports.push((writer.clone(), peer));
                    (writer, peer)
                }
            };
            writers.push(writer);
            ends.push(LinkEnd { key, peer });
            recordings.push(record_vehicle(config, vehicle, now)?);
        }
        let dli_recording = record_dli(config, now)?;
        // Before the bridge verifies its audit logs, and binds the next line by it.
        AuditKey::load_or_make(&mut store, &mut system_random).map_err(BridgeError::Store)?;
        let mut bridge = Bridge::new(config, ends, now, NOT_BEFORE, &mut store)?;
        let mut secret = [0; 32];
        system_random(&mut secret).map_err(|fault| StartError::Random(io::Error::other(fault)))?;
        bridge.set_secret(secret);
        let exchanges = open_exchanges(config, &key_stores, now, &mut bridge, &mut store)?;
        let page = config
            .http
            .as_ref()
            .map(|http| Ok::<_, StartError>((listen(http.listen)?, http.hosts.clone())))
            .transpose()?;
        let status = status_socket::listen(&config.store.dir).map_err(StartError::Status)?;
        let stored = Arc::new(Notify::new());
        // From here on nothing waits for the disk.
        let key_stores = key_stores.into_iter().map(|keys| {
            keys.map(|keys| OrderedKeys::start(keys, &store, stored.clone()))
                .transpose()
        });
        let key_stores = key_stores
            .collect::<Result<_, _>>()
            .map_err(StartError::Writer)?;
        let store = QueuedDisk::new(store, stored.clone()).map_err(StartError::Writer)?;
        let shared = Shared {
            clock,
            vsm: config.dli.vsm_id.to_string(),
            core: RefCell::new(Core {
                bridge,
                store,
                recordings,
                dli_recording,
                key_stores,
                exchanges,
            }),
            outgoing: Notify::new(),
            timing: Notify::new(),
            stored,
        };
        Ok(Server {
            shared: Rc::new(shared),
            dli,
            readers,
            writers,
            status,
            page,
        })
    }
}

/// Whether no vehicle before has one of this one's keys.
fn check_own(
    vehicle: Id,
    keys: Option<&KeyStore>,
    known: &mut Vec<(Id, KeyId)>,
) -> Result<(), StartError> {
    let held = keys.map(KeyStore::ids).transpose()?;
    for key in held.into_iter().flatten() {
        match known.iter().find(|(_, known)| *known == key) {
            Some((one, _)) if *one != vehicle => {
                let (one, other) = (*one, vehicle);
                return Err(StartError::SameKey { one, other, key });
            }
            _ => known.push((vehicle, key)),
        }
    }
    Ok(())
}

fn record_vehicle(
    config: &Config,
    vehicle: &Vehicle,
    now: Now,
) -> Result<Option<Recording>, StartError> {
    let Some(record) = &config.record else {
        return Ok(None);
    };
    let name = format!("{:08x}", vehicle.id.0);
    let begun = Recording::begin(&record.dir, &name, now.wall, share(config, record));
    begun.map(Some).map_err(|cause| StartError::Recording {
        folder: record.dir.clone(),
        cause,
    })
}

/// One recording for each vehicle, and the one of the DLI.
fn share(config: &Config, record: &Record) -> Quota {
    Quota::share(record.max_mb, config.vehicle.len() + 1)
}

fn record_dli(config: &Config, now: Now) -> Result<Option<DliRecording>, StartError> {
    let Some(record) = &config.record else {
        return Ok(None);
    };
    let stations = config.stations().map(|station| station.id).collect();
    let begun = DliRecording::begin(&record.dir, stations, now.wall, share(config, record));
    begun.map(Some).map_err(|cause| StartError::Recording {
        folder: record.dir.clone(),
        cause,
    })
}

/// The exchanges of the vehicles that agree about keys over the air. Of the others, a handover that an earlier process
/// has begun goes on.
fn open_exchanges(
    config: &Config,
    key_stores: &[Option<KeyStore>],
    now: Now,
    bridge: &mut Bridge,
    store: &mut FileDisk,
) -> Result<Vec<(usize, KeyExchange)>, StartError> {
    let mut exchanges = vec![];
    for ((index, keys), vehicle) in key_stores.iter().enumerate().zip(config.vehicles()) {
        if let (Signing::KeyFile(_, settings), Some(keys)) = (&vehicle.signing, keys)
            && settings.mode != ExchangeMode::Off
        {
            let mut with = Surroundings {
                bridge: &mut *bridge,
                store: &mut *store,
                records: None,
                keys,
                random: &mut system_random,
                not_before: NOT_BEFORE,
            };
            let mut exchange =
                KeyExchange::open(config, vehicle, index, *settings, now, &mut with)?;
            // The agent hands it over: in flight the vehicle goes on under its current key.
            exchange.take_up_next(now, &mut with);
            exchanges.push((index, exchange));
            continue;
        }
        if let Some(next) = keys.as_ref().map(KeyStore::next).transpose()?.flatten() {
            tracing::warn!(
                "a handover of key {} is not finished: finding out which key the vehicle has",
                next.id()
            );
            bridge.settle_key(index, next, now, NOT_BEFORE, store)?;
        }
    }
    Ok(exchanges)
}

fn listen(address: SocketAddr) -> Result<TcpListener, StartError> {
    let listener = std::net::TcpListener::bind(address).and_then(|listener| {
        listener.set_nonblocking(true)?;
        TcpListener::from_std(listener)
    });
    listener.map_err(|cause| StartError::Http { address, cause })
}

/// The key in force and its files. A first key that was sent and whose end is not known is the one in force.
fn vehicle_keys(
    path: &Path,
    mode: ExchangeMode,
    store: &mut FileDisk,
) -> Result<(SigningKey, KeyStore), StartError> {
    let keys = KeyStore::open(path)?;
    if let Err(fault) = keys.bury(store) {
        tracing::warn!("the clock of a dead key cannot be deleted: {fault}");
    }
    if keys.current()?.is_none() {
        // A key that is handed over has a clock on disk before it leaves.
        if mode == ExchangeMode::Off
            && let Some(next) = keys.next()?
            && store.load::<Ceiling>(&next.id())?.is_none()
        {
            let path = path.to_owned();
            return Err(StartError::NeverSent { path });
        }
        keys.commit()?;
    }
    if keys.current()?.is_none() && mode == ExchangeMode::Legacy {
        // Until there is an agreed key the link has one that nobody else holds: nothing unsigned is believed.
        keys.stage(&key_file::random().map_err(StartError::Random)?)?;
        keys.commit()?;
    }
    if keys.current()?.is_none() && mode == ExchangeMode::On {
        let path = path.to_owned();
        return Err(StartError::NotPaired { path });
    }
    match keys.current()? {
        Some(key) => Ok((key, keys)),
        // Read only for its error, which names the missing file and the command that makes one.
        None => Ok((key_file::read(path)?, keys)),
    }
}
