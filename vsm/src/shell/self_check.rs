//! What a computer looks like to a bridge: what `vsm doctor` looks at by itself, and the key files, which a running bridge
//! looks at too.

use std::io;
use std::net::{SocketAddr, TcpListener, ToSocketAddrs as _, UdpSocket};
use std::path::PathBuf;
use std::time::{Duration, SystemTime, UNIX_EPOCH};

use dli_group::Interface;
use rustix::fs::{Access, access};

use super::clock::NOT_BEFORE;
use super::disk::{FileDisk, NativeFileSystem, OpenError};
use super::interfaces::listen_elsewhere;
use super::key_file;
use crate::config::{Config, ExchangeMode, LinkAddress, Signing};
use crate::session::findings::host::{HostFacts, StoreFact};

/// Clock, key files, interface of the group, and who else sends to it: what can be looked at beside a running bridge.
pub async fn beside(config: &Config, listen_for: Duration) -> HostFacts {
    let wall = SystemTime::now().duration_since(UNIX_EPOCH);
    let mut facts = HostFacts {
        wall: wall.unwrap_or_default(),
        not_before: NOT_BEFORE,
        keys: unusable(key_files(config)),
        ..HostFacts::default()
    };
    let Some(group) = config.dli.multicast else {
        return facts;
    };
    let there = dli_group::interfaces().unwrap_or_default();
    let is_there = |interface: &Interface| match interface {
        Interface::Address(at) => there.contains_key(at),
        Interface::Name(name) => there.values().any(|one| one == name),
    };
    match &config.dli.interface {
        Some(interface) if !there.is_empty() && !is_there(interface) => {
            let names = there.iter().map(|(at, name)| format!("{name} ({at})"));
            facts.interface = Some((interface.to_string(), names.collect()));
        }
        interface => {
            let found = listen_elsewhere(group, interface.as_ref(), listen_for).await;
            facts.elsewhere = found.ok().flatten().map(|(at, from)| (group, at, from));
        }
    }
    facts
}

/// A key file of the configuration.
#[derive(Debug)]
pub(super) struct KeyFile {
    whose: String,
    path: PathBuf,
    /// It holds a key that is agreed with an agent, and is not there before that.
    agreed: bool,
}

/// The key files that the next start will read.
pub(super) fn key_files(config: &Config) -> Vec<KeyFile> {
    let vehicles = config.vehicles().filter_map(|vehicle| {
        let Signing::KeyFile(path, exchange) = &vehicle.signing else {
            return None;
        };
        let agreed = exchange.mode != ExchangeMode::Off;
        Some((format!("vehicle {}", vehicle.id), path, agreed))
    });
    let stations = config.stations().filter_map(|station| {
        let guard = station.guard.as_ref()?;
        Some((format!("CUCS {}", station.id), &guard.key_file, false))
    });
    let forwards = config.forwards().filter_map(|forward| {
        let path = forward.key_file.as_ref()?;
        Some((format!("[[forward]] {}", forward.name), path, false))
    });
    let access = config.access.iter();
    let access = access.map(|access| ("[access]".to_owned(), &access.key_file, false));
    let store = config.store.key_file.iter();
    let store = store.map(|path| ("[store]".to_owned(), path, false));
    let of_vehicles_and_stations = vehicles.chain(stations).chain(forwards);
    let each = of_vehicles_and_stations.chain(access).chain(store);
    let each = each.map(|(whose, path, agreed)| KeyFile {
        whose,
        path: path.clone(),
        agreed,
    });
    each.collect()
}

/// Those of them that it could not use: whose, and why. Blocks, on a file server that does not answer for as long as that.
pub(super) fn unusable(files: Vec<KeyFile>) -> Vec<(String, String)> {
    let fault = |file: KeyFile| {
        let why = if file.agreed && !file.path.exists() {
            format!(
                "no key {} has been agreed yet, or it is lost: pair with the air-side agent (\"vsm pair\")",
                file.path.display()
            )
        } else {
            key_file::read(&file.path).err()?.to_string()
        };
        Some((file.whose, why))
    };
    files.into_iter().filter_map(fault).collect()
}

/// As `vsm run` does.
fn open(config: &Config) -> Result<FileDisk, OpenError> {
    match config.store.shared() {
        None => FileDisk::open(&config.store.dir),
        Some(_) => FileDisk::open_on(&config.store.dir, Box::new(NativeFileSystem)),
    }
}

/// The same, and what a start would need: store and ports.
pub async fn before_a_start(config: &Config, listen_for: Duration) -> HostFacts {
    let mut facts = beside(config, listen_for).await;
    // A folder that is missing is made by the start; the lock is released at once.
    let folder = &config.store.dir;
    facts.store = match folder.exists().then(|| open(config)) {
        None | Some(Ok(_)) => None,
        Some(Err(OpenError::Locked { folder })) => {
            // The ports were not checked: the process that uses the store uses them too.
            facts.store = Some(StoreFact::Locked(folder.display().to_string()));
            return facts;
        }
        Some(Err(fault)) => Some(StoreFact::Unusable(fault.to_string())),
    };
    let mut want = |key, value: String, had: io::Result<()>| {
        if let Err(cause) = had {
            facts.ports.push((key, value, cause.to_string()));
        }
    };
    let udp = |at: SocketAddr| UdpSocket::bind(at).map(drop);
    want(
        "dli.listen",
        config.dli.listen.to_string(),
        udp(config.dli.listen),
    );
    if let Some(http) = &config.http {
        let had = TcpListener::bind(http.listen).map(drop);
        want("http.listen", http.listen.to_string(), had);
    }
    for vehicle in config.vehicles() {
        let had = match &vehicle.link {
            LinkAddress::UdpIn(at) => udp(*at),
            LinkAddress::UdpOut(host) => host.to_socket_addrs().map(drop),
            LinkAddress::Serial { device, .. } => {
                access(device.as_str(), Access::READ_OK | Access::WRITE_OK).map_err(Into::into)
            }
        };
        want("vehicle.link", vehicle.link.to_string(), had);
    }
    facts
}
