//! The resources of one vehicle before it is served: its keys, its link, its recording, and its key exchange.

use std::path::Path;
use std::rc::Rc;

use mavlink_link::Now;
use mavlink_link::clock::Ceiling;
use mavlink_link::signing::{KeyId, SigningKey};
use mavlink_link::store::{Disk, Store as _};
use stanag_msgs::Id;
use tokio::sync::Notify;

use super::StartError;
use super::shared::OpenPort;
use crate::config::{Config, ExchangeMode, LinkAddress, Record, Signing, Vehicle};
use crate::key_exchange::{KeyExchange, Surroundings};
use crate::session::Bridge;
use crate::shell::clock::NOT_BEFORE;
use crate::shell::key_file::{self, KeyFileError, system_random};
use crate::shell::key_store::{KeyStore, KeyStoreError};
use crate::shell::recording::{self, Quota, Recorder, Recording};
use crate::shell::sockets::{self, Hosts, VehicleReader};

/// Checks that no vehicle in `known` has one of this one's keys.
pub(super) fn check_own(
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

pub(super) fn record_vehicle(
    config: &Config,
    vehicle: &Vehicle,
    now: Now,
    recorder: &Recorder,
) -> Result<Option<Recording>, StartError> {
    let Some(record) = &config.record else {
        return Ok(None);
    };
    let name = format!("{:08x}", vehicle.id.0);
    let quota = share(config, record);
    let begun = Recording::begin(&record.dir, &name, now.wall, quota, recorder);
    begun.map(Some).map_err(|cause| StartError::Recording {
        folder: record.dir.clone(),
        cause,
    })
}

/// Whether recordings could be begun, where some are configured.
pub(super) fn check_records(config: &Config) -> Result<(), StartError> {
    let Some(record) = &config.record else {
        return Ok(());
    };
    recording::check(&record.dir).map_err(|cause| StartError::Recording {
        folder: record.dir.clone(),
        cause,
    })
}

/// One recording for each vehicle, and one for the DLI.
pub(super) fn share(config: &Config, record: &Record) -> Quota {
    Quota::share(record.max_mb, config.vehicle.len() + 1)
}

/// The key exchange of a vehicle that agrees on keys over the air. For other vehicles, a key rotation that an earlier
/// process began is continued.
pub(super) fn open_exchange(
    config: &Config,
    (index, vehicle): (usize, &Vehicle),
    keys: &KeyStore,
    records: Option<&mut dyn Disk>,
    now: Now,
    (bridge, store): (&mut Bridge, &mut dyn Disk),
) -> Result<Option<KeyExchange>, StartError> {
    if let Signing::KeyFile(_, settings) = &vehicle.signing
        && settings.mode != ExchangeMode::Off
    {
        let mut with = Surroundings {
            bridge,
            store,
            records: match records {
                Some(records) => Some(&mut *records),
                None => None,
            },
            keys,
            random: &mut system_random,
            not_before: NOT_BEFORE,
        };
        let mut exchange = KeyExchange::open(config, vehicle, index, *settings, now, &mut with)?;
        // The agent installs the key; in flight the vehicle continues under its current one.
        exchange.take_up_next(now, &mut with);
        return Ok(Some(exchange));
    }
    if let Some(next) = keys.next()? {
        tracing::warn!(
            "the rotation to key {} is not finished: finding out which key the vehicle has",
            next.id()
        );
        bridge.settle_key(index, next, now, NOT_BEFORE, store)?;
    }
    Ok(None)
}

/// How the files of a vehicle's keys are opened.
pub(super) type OpenKeys<'a> = &'a dyn Fn(&Path) -> Result<KeyStore, KeyStoreError>;

/// The keys of a vehicle, which may be none of another vehicle in `known`.
pub(super) fn open_keys(
    vehicle: &Vehicle,
    known: &mut Vec<(Id, KeyId)>,
    store: &mut dyn Disk,
    open: OpenKeys<'_>,
) -> Result<(Option<SigningKey>, Option<KeyStore>), StartError> {
    let Signing::KeyFile(path, exchange) = &vehicle.signing else {
        return Ok((None, None));
    };
    let keys = open(path)?;
    let (key, keys) = vehicle_keys(path, keys, exchange.mode, store)?;
    check_own(vehicle.id, Some(&keys), known)?;
    Ok((Some(key), Some(keys)))
}

/// The ids of a vehicle's keys, by a look: nothing is locked or changed. None where a start makes the first one.
pub(super) fn look_at_keys(path: &Path, mode: ExchangeMode) -> Result<Vec<KeyId>, StartError> {
    let ids = KeyStore::look(path)?.ids()?;
    let path = path.to_owned();
    match mode {
        ExchangeMode::On if ids.is_empty() => Err(StartError::NotPaired { path }),
        ExchangeMode::Off if ids.is_empty() => Err(KeyFileError::Absent { path }.into()),
        _ => Ok(ids),
    }
}

/// The open link with this address.
pub(super) fn find_port<'a>(
    ports: &'a [Option<OpenPort>],
    link: &LinkAddress,
) -> Option<&'a OpenPort> {
    ports.iter().flatten().find(|port| port.link == *link)
}

/// Opens the link of a vehicle.
pub(super) fn open_port(
    vehicle: &Vehicle,
    hosts: &Hosts,
    store: &mut dyn Disk,
) -> Result<(VehicleReader, OpenPort), StartError> {
    let record = format!("port-{:08x}", vehicle.id.0);
    let (reader, writer, peer) =
        sockets::open_link("vehicle.link", &vehicle.link, hosts, &record, store)?;
    let link = vehicle.link.clone();
    let close = Rc::new(Notify::new());
    let port = OpenPort {
        link,
        writer,
        peer,
        close,
    };
    Ok((reader, port))
}

/// The current key and its files. A first key that was sent, with unknown outcome, counts as the current one.
fn vehicle_keys(
    path: &Path,
    keys: KeyStore,
    mode: ExchangeMode,
    store: &mut dyn Disk,
) -> Result<(SigningKey, KeyStore), StartError> {
    if let Err(fault) = keys.bury(store) {
        tracing::warn!("the clock of a dead key cannot be deleted: {fault}");
    }
    if keys.current()?.is_none() {
        // A key has a clock on disk before it is sent, so without one it was never sent.
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
        // Until a key is agreed on, the link has a random key that nobody else holds: no unsigned frame is accepted.
        keys.stage(&key_file::random().map_err(StartError::Random)?)?;
        keys.commit()?;
    }
    if keys.current()?.is_none() && mode == ExchangeMode::On {
        let path = path.to_owned();
        return Err(StartError::NotPaired { path });
    }
    match keys.current()? {
        Some(key) => Ok((key, keys)),
        // Read only for the error, which names the missing file and the command that creates it.
        None => Ok((key_file::read(path)?, keys)),
    }
}
