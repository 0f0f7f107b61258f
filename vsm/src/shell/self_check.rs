//! What a computer looks like to a bridge: what `vsm doctor` looks at by itself, beside a running bridge or before a start.

use std::fs;
use std::io;
use std::path::Path;
use std::time::{Duration, SystemTime, UNIX_EPOCH};

use dli_group::Interface;

use super::clock::{Clock, NOT_BEFORE};
use super::disk::{self, FileDisk, NativeFileSystem, OpenError};
use super::erase;
#[cfg(feature = "etcd")]
use super::fleet::{FleetError, check_state, operator::Operator};
use super::interfaces::listen_elsewhere;
use super::key_store::KeyStoreError;
use super::ownership;
use super::server::StartError;
use super::server::checks::{self, NamedFile, SERVICE_STATE};
use super::server::trial;
use super::sockets::{self, DliSockets, Hosts, SocketError};
use super::trial_disk::{TrialDisk, TrialFiles};
use crate::config::Config;
use crate::session::findings::host::{
    HostFacts, PortFault, PortProblem, StartFault, StartPart, StoreFact,
};

/// Clock, files, disk, interface of the group, and who else sends to it: what can be looked at beside a running bridge. `file`:
/// that of the configuration.
pub async fn beside(config: &Config, file: &Path, listen_for: Duration) -> HostFacts {
    let wall = SystemTime::now().duration_since(UNIX_EPOCH);
    let mut facts = HostFacts {
        wall: wall.unwrap_or_default(),
        not_before: NOT_BEFORE,
        store: checks::look_at_store(&config.store.dir, config.store.shared().is_some()),
        ..HostFacts::default()
    };
    // Root may have read it for a service that may not.
    let readable = fs::metadata(file).map(|about| ownership::check_readable(&about, file));
    if let Ok(Err(fault)) = readable {
        facts.start.push(StartFault {
            what: StartPart::File,
            why: fault.to_string(),
        });
    }
    let now = Clock::default().now();
    let files = checks::named_files(config, Some(file));
    facts.keys = checks::look_at_key_files(&files, now).faults;
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

/// The same, and what a start would need: the store, and all that it opens. Blocks on name servers and elevation files.
pub async fn before_a_start(config: &Config, file: &Path, listen_for: Duration) -> HostFacts {
    let mut facts = beside(config, file, listen_for).await;
    // A start makes a folder that is missing; this one must leave nothing behind.
    let folder = &config.store.dir;
    // A link that leads nowhere is there, too.
    match fs::symlink_metadata(folder).ok().map(|_| open(config)) {
        None => {}
        // The lock is released at once.
        Some(Ok(disk)) => {
            if let Some(why) = of_another_fleet(config, &disk) {
                facts.store = Some(StoreFact::Unusable(why));
            }
        }
        Some(Err(OpenError::Locked { folder })) => {
            // The ports are not checked: the process that uses the store uses them too.
            match fleet(config) {
                Some(Ok(Some(stands_by))) => facts.standby = Some(stands_by),
                // A node that stands by waits for etcd, and answers nobody meanwhile.
                Some(Err(why)) => facts.etcd = Some(why),
                Some(Ok(None)) | None => {
                    facts.store = Some(StoreFact::Locked(folder.display().to_string()));
                }
            }
            return facts;
        }
        Some(Err(OpenError::Zeroizing { folder })) => {
            facts.store = Some(match erase::check_order(&folder) {
                Ok(()) => StoreFact::Zeroized(folder.display().to_string()),
                Err(fault) => StoreFact::Unusable(fault.to_string()),
            });
        }
        Some(Err(fault)) => facts.store = Some(StoreFact::Unusable(fault.to_string())),
    }
    if facts.store.is_none() && folder.exists() && erase::is_zeroized(folder) {
        facts.store = Some(StoreFact::Zeroized(folder.display().to_string()));
    }
    let files = checks::named_files(config, Some(file));
    let at_first_start = |file: &NamedFile| file.copied_to.is_some();
    // The unit makes its folder, and puts the key there.
    let is_installed = folder.exists() || !folder.starts_with(SERVICE_STATE);
    if facts.store.is_none()
        && is_installed
        && let Err(cause) = disk::probe(folder)
    {
        let folder = folder.display();
        facts.store = Some(StoreFact::Unusable(format!(
            "[store] dir {folder}: {cause}"
        )));
    }
    if let Some(Err(why)) = fleet(config) {
        facts.etcd = Some(why);
    }
    if files.iter().any(at_first_start) {
        return facts;
    }
    let Err(cause) = trial::try_start(config) else {
        facts.start.extend(access(config));
        return facts;
    };
    // It ends at the first fault. A serial line that it has opened is closed by a task.
    tokio::time::sleep(CLOSED_WITHIN).await;
    ports(config, &mut facts);
    if !is_known(&cause, &facts) {
        facts.start.push(start_fault(&cause));
    }
    facts
}

/// Whether the facts have what ended a start, perhaps in words that say more.
fn is_known(cause: &StartError, facts: &HostFacts) -> bool {
    match cause {
        StartError::Socket(_) | StartError::Http { .. } => {
            !facts.ports.is_empty() || facts.interface.is_some()
        }
        // A look locks nothing, and does not see that another process has a lock.
        StartError::Keys(KeyStoreError::Locked { .. }) => false,
        StartError::Key(_)
        | StartError::Keys(_)
        | StartError::NotPaired { .. }
        | StartError::SameKey { .. }
        | StartError::ForwardKey { .. }
        | StartError::GuardKey { .. }
        | StartError::AccessKey { .. } => !facts.keys.is_empty(),
        _ => false,
    }
}

/// What the node that has the store does, where it is one of several and etcd has its lease: it stands by, and for whom. An
/// error: etcd does not answer.
#[cfg(feature = "etcd")]
fn fleet(config: &Config) -> Option<Result<Option<String>, String>> {
    let store = config.store.shared()?;
    let fleet = Operator::new(&store, config.dli.vsm_id).fleet();
    Some(fleet.map_err(|cause| cause.to_string()).map(|fleet| {
        let mut nodes = fleet.nodes.iter();
        let own = nodes.find(|one| one.name == store.node && one.present)?;
        match &fleet.owner {
            // It serves, and should answer.
            Some(owner) if *owner == own.name => None,
            _ if own.drained => Some("it is drained".to_owned()),
            Some(owner) => Some(format!("{owner} serves")),
            None => Some("no node serves".to_owned()),
        }
    }))
}

/// That the store has state which the fleet did not make: a node does not stand by with it.
#[cfg(feature = "etcd")]
fn of_another_fleet(config: &Config, disk: &FileDisk) -> Option<String> {
    match check_state(&config.store.shared()?, config.dli.vsm_id, disk) {
        Err(fault @ FleetError::Foreign { .. }) => Some(fault.to_string()),
        // That etcd does not answer has a line of its own.
        Ok(()) | Err(_) => None,
    }
}

#[cfg(not(feature = "etcd"))]
fn of_another_fleet(_: &Config, _: &FileDisk) -> Option<String> {
    None
}

#[cfg(not(feature = "etcd"))]
fn fleet(_: &Config) -> Option<Result<Option<String>, String>> {
    None
}

/// What ends a start, or what it serves without, that has no place of its own in the facts.
fn start_fault(cause: &StartError) -> StartFault {
    let what = match cause {
        StartError::Access(_) => StartPart::AccessList,
        StartError::Recording { cause, .. } if cause.kind() == io::ErrorKind::StorageFull => {
            StartPart::FullRecording
        }
        StartError::Terrain(_) | StartError::Recording { .. } | StartError::Tiles(_) => {
            StartPart::File
        }
        _ => StartPart::Other,
    };
    StartFault {
        what,
        why: cause.to_string(),
    }
}

/// An access list that is not that of the file: the store has an earlier one.
fn access(config: &Config) -> Option<StartFault> {
    let why = checks::look_at_access(config).ok()??;
    Some(StartFault {
        what: StartPart::AccessList,
        why: format!("{why}; a start serves by the list of the store"),
    })
}

/// Each port, address and device by itself: a start ends at the first that it cannot have. Those that are opened stay so
/// until all are, since two of the configuration may be the same.
fn ports(config: &Config, facts: &mut HostFacts) {
    let mut held: Vec<Box<dyn std::any::Any>> = vec![];
    let mut fault = |key, value: String, kind: io::ErrorKind, why: String| {
        let problem = problem(kind);
        facts.ports.push(PortFault {
            key,
            value,
            problem,
            why,
        });
    };
    let mut of_socket = |key, value: String, cause: &SocketError| {
        let (kind, why) = cause.reason();
        fault(key, value, kind, why);
    };
    match DliSockets::open_unicast(&config.dli) {
        Ok(socket) => held.push(Box::new(socket)),
        Err(cause) => of_socket("dli.listen", config.dli.listen.to_string(), &cause),
    }
    match DliSockets::open_group(&config.dli) {
        Ok(group) => held.push(Box::new(group)),
        // That the interface is not there has a line of its own.
        Err(SocketError::Interface(_)) if facts.interface.is_some() => {}
        Err(cause) => {
            let group = config.dli.multicast;
            let group = group.map_or_else(String::new, |group| group.to_string());
            of_socket("dli.multicast", group, &cause);
        }
    }
    let mut store = TrialDisk::new(&config.store.dir, TrialFiles::default());
    for link in config.links() {
        // Of the vehicles on a link the first names the record of its port.
        let Some(vehicle) = config.vehicles().find(|one| one.link == *link) else {
            continue;
        };
        let record = sockets::port_record(config, vehicle);
        match sockets::open_link("vehicle.link", link, &Hosts::AskNow, &record, &mut store) {
            Ok(opened) => held.push(Box::new(opened)),
            Err(cause) => of_socket("vehicle.link", link.to_string(), &cause),
        }
    }
    for forward in config.forwards() {
        let record = format!("port-forward-{}", forward.name);
        match sockets::open_forward(&forward.link, &Hosts::AskNow, &record, &mut store) {
            Ok(opened) => held.push(Box::new(opened)),
            Err(cause) => of_socket("forward.link", forward.link.to_string(), &cause),
        }
    }
    if let Some(http) = &config.http
        && let Err(cause) = std::net::TcpListener::bind(http.listen)
    {
        let (at, why) = (http.listen.to_string(), cause.to_string());
        fault("http.listen", at, cause.kind(), why);
    }
}

fn problem(kind: io::ErrorKind) -> PortProblem {
    match kind {
        io::ErrorKind::AddrInUse | io::ErrorKind::ResourceBusy => PortProblem::Taken,
        io::ErrorKind::AddrNotAvailable => PortProblem::Elsewhere,
        io::ErrorKind::PermissionDenied => PortProblem::Denied,
        io::ErrorKind::NotFound => PortProblem::Absent,
        _ => PortProblem::Other,
    }
}

/// The task that writes a serial line ends when nobody writes to it, which takes a moment.
const CLOSED_WITHIN: Duration = Duration::from_millis(50);

#[cfg(test)]
mod tests {
    use std::os::unix::fs::{DirBuilderExt as _, symlink};

    use super::*;

    async fn unusable(config: &Config) -> String {
        let facts = before_a_start(config, Path::new("vsm.toml"), Duration::ZERO).await;
        match facts.store {
            Some(StoreFact::Unusable(why)) => why,
            other => panic!("{other:?}"),
        }
    }

    #[tokio::test]
    async fn a_store_that_cannot_be_used_is_named_and_not_taken_for_a_zeroized_one() {
        let folder = tempfile::tempdir().unwrap();
        let text =
            "[dli]\nvsm_id = \"1b:00:00:01\"\nlisten = \"127.0.0.1:0\"\n[store]\ndir = \"state\"\n";
        let config = Config::parse(text, folder.path()).unwrap_or_else(|fault| panic!("{fault}"));
        let store = &config.store.dir;
        fs::write(store, "").unwrap();
        let why = unusable(&config).await;
        assert!(why.contains("it is a file"), "{why}");
        fs::remove_file(store).unwrap();
        symlink("absent", store).unwrap();
        let why = unusable(&config).await;
        assert!(why.contains("it is a link to absent"), "{why}");
        fs::remove_file(store).unwrap();
        fs::DirBuilder::new().mode(0o700).create(store).unwrap();
        fs::write(store.join("zeroize.order"), "junk").unwrap();
        let why = unusable(&config).await;
        assert!(
            why.contains("zeroize.order cannot be read") && why.contains("remove it"),
            "{why}"
        );
    }

    #[test]
    fn a_full_disk_of_recordings_is_no_fault_that_ends_a_start() {
        for (kind, full) in [
            (io::ErrorKind::StorageFull, true),
            (io::ErrorKind::ReadOnlyFilesystem, false),
        ] {
            let cause = StartError::Recording {
                folder: "records".into(),
                cause: kind.into(),
            };
            let what = start_fault(&cause).what;
            assert_eq!(matches!(what, StartPart::FullRecording), full, "{kind}");
        }
    }
}
