//! What a computer looks like to a bridge that is not running: what `vsm doctor` looks at by itself.

use std::io;
use std::net::{SocketAddr, TcpListener, ToSocketAddrs as _, UdpSocket};
use std::time::{Duration, SystemTime, UNIX_EPOCH};

use dli_group::Interface;
use rustix::fs::{Access, access};

use super::clock::NOT_BEFORE;
use super::disk::{FileDisk, NativeFileSystem, OpenError};
use super::interfaces::listen_elsewhere;
use super::key_file;
use crate::config::{Config, ExchangeMode, LinkAddress, Signing};
use crate::session::findings::host::{HostFacts, StoreFact};

/// Clock, interface of the group, and who else sends to it: what can be looked at beside a running bridge.
pub async fn beside(config: &Config, listen_for: Duration) -> HostFacts {
    let wall = SystemTime::now().duration_since(UNIX_EPOCH);
    let mut facts = HostFacts {
        wall: wall.unwrap_or_default(),
        not_before: NOT_BEFORE,
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

/// As `vsm run` does.
fn open(config: &Config) -> Result<FileDisk, OpenError> {
    match config.store.shared() {
        None => FileDisk::open(&config.store.dir),
        Some(_) => FileDisk::open_on(&config.store.dir, Box::new(NativeFileSystem)),
    }
}

/// The same, and what a start would need: store, keys, ports.
pub async fn before_a_start(config: &Config, listen_for: Duration) -> HostFacts {
    let mut facts = beside(config, listen_for).await;
    // A folder that is missing is made by the start; the lock is released at once.
    let folder = &config.store.dir;
    facts.store = match folder.exists().then(|| open(config)) {
        None | Some(Ok(_)) => None,
        Some(Err(OpenError::Locked { folder })) => {
            // Nothing was asked of the ports: who has the store has them, too.
            facts.store = Some(StoreFact::Locked(folder.display().to_string()));
            return facts;
        }
        Some(Err(fault)) => Some(StoreFact::Unusable(fault.to_string())),
    };
    for vehicle in config.vehicles() {
        if let Signing::KeyFile(path, exchange) = &vehicle.signing {
            let waits = exchange.mode != ExchangeMode::Off && !path.exists();
            let why = match key_file::read(path) {
                Ok(_) => continue,
                Err(_) if waits => format!(
                    "no key {} has been agreed yet: pair with the air-side agent (\"vsm pair\")",
                    path.display()
                ),
                Err(fault) => fault.to_string(),
            };
            facts.keys.push((vehicle.id.to_string(), why));
        }
    }
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
