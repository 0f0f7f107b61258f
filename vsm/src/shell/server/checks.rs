//! What a start would find wrong, found without one: for `vsm doctor`, for `vsm check-config`, and for a running bridge, which
//! has its keys in memory and would miss their files at its next start.
//!
//! [`look`] reads the files that a configuration names, [`look_at_store`] the names in the store; both lock, make and change nothing.
//! What else ends a start is found by `trial`.

use std::fs;
use std::io;
use std::path::{Path, PathBuf};

use mavlink_link::Now;
use mavlink_link::signing::KeyId;
use stanag_msgs::Id;

use super::StartError;
use super::guards;
use super::vehicle::look_at_keys;
use crate::config::{Config, ExchangeMode, Signing};
use crate::session::examine_access;
use crate::session::findings::host::{KeyFault, StoreFact};
use crate::shell::clock::{Clock, NOT_BEFORE};
use crate::shell::disk;
use crate::shell::trial_disk::{TrialDisk, TrialFiles};
use crate::shell::web::Tiles;
use crate::shell::{guard_file, key_file};

/// A file that a configuration names, and that a start reads.
#[derive(Debug, Clone)]
pub struct NamedFile {
    /// The key that names it.
    pub key: &'static str,
    /// The byte of the configuration's text at which the table of that key begins; 0 where the key is in no list.
    pub at: usize,
    /// Whose it is, such as `vehicle 1b:00:01:01`.
    pub whose: String,
    /// Where it is.
    pub path: PathBuf,
    /// Where the packaged unit copies it to at its first start, and where it is used.
    pub copied_to: Option<PathBuf>,
    kind: Kind,
}

#[derive(Debug, Clone)]
enum Kind {
    Vehicle(Id, ExchangeMode),
    Forward(String),
    Guard(Id),
    Access,
    Store,
    Tiles,
}

/// The files that a start of this configuration reads, keys first. `file`: the configuration's own, beside which the key of
/// the packaged unit waits for its first start.
#[must_use]
pub fn named_files(config: &Config, file: Option<&Path>) -> Vec<NamedFile> {
    let of = |key, at, whose: String, path: &Path, kind| NamedFile {
        key,
        at,
        whose,
        path: path.to_owned(),
        copied_to: None,
        kind,
    };
    let mut files = vec![];
    for one in &config.vehicle {
        let (vehicle, at) = (one.get_ref(), one.span().start);
        if let Signing::KeyFile(path, exchange) = &vehicle.signing {
            let whose = format!("vehicle {}", vehicle.id);
            let kind = Kind::Vehicle(vehicle.id, exchange.mode);
            let mut named = of("vehicle.signing.key_file", at, whose, path, kind);
            if exchange.mode != ExchangeMode::On
                && let Some(beside) = file.and_then(|file| waits_beside(path, file))
            {
                named.copied_to = Some(std::mem::replace(&mut named.path, beside));
            }
            files.push(named);
        }
    }
    for one in &config.forward {
        let (forward, at) = (one.get_ref(), one.span().start);
        if let Some(path) = &forward.key_file {
            let whose = format!("[[forward]] {}", forward.name);
            let kind = Kind::Forward(forward.name.clone());
            files.push(of("forward.key_file", at, whose, path, kind));
        }
    }
    for one in &config.cucs {
        let (station, at) = (one.get_ref(), one.span().start);
        if let Some(guard) = &station.guard {
            let whose = format!("CUCS {}", station.id);
            let kind = Kind::Guard(station.id);
            let path = &guard.key_file;
            files.push(of("cucs.guard.key_file", at, whose, path, kind));
        }
    }
    if let Some(access) = &config.access {
        let (whose, path) = ("[access]".to_owned(), &access.key_file);
        files.push(of("access.key_file", 0, whose, path, Kind::Access));
    }
    if let Some(path) = &config.store.key_file {
        let whose = "[store]".to_owned();
        files.push(of("store.key_file", 0, whose, path, Kind::Store));
    }
    if let Some(path) = &config.web.tiles {
        files.push(of("web.tiles", 0, "[web]".to_owned(), path, Kind::Tiles));
    }
    files
}

/// Where a key of the packaged unit is before its first start, which copies it to its place: a second key made there would not
/// be the vehicle's.
fn waits_beside(path: &Path, config: &Path) -> Option<PathBuf> {
    let absent = |cause: io::Error| cause.kind() == io::ErrorKind::NotFound;
    let waits = path.starts_with(SERVICE_STATE) && fs::symlink_metadata(path).is_err_and(absent);
    waits.then(|| config.with_file_name(path.file_name().unwrap_or_default()))
}

/// What a start would have of each of these files: the ids of its keys, the one in force first, or why it could not use it. No
/// key may be in the files of two. Blocks, on a file server that does not answer for as long as that.
#[must_use]
pub fn look(files: &[NamedFile], now: Now) -> Vec<Result<Vec<KeyId>, StartError>> {
    let mut known: Vec<(&NamedFile, KeyId)> = vec![];
    let mut looked = vec![];
    for file in files {
        let keys = file.keys(now).and_then(|keys| {
            let of_another = |(owner, one): &&(&NamedFile, KeyId)| {
                keys.contains(one) && owner.whose != file.whose
            };
            match known.iter().find(of_another) {
                Some((owner, key)) => Err(file.has_key_of(owner, *key)),
                None => Ok(keys),
            }
        });
        known.extend(keys.iter().flatten().map(|key| (file, *key)));
        looked.push(keys);
    }
    looked
}

impl NamedFile {
    /// Whether it holds a key.
    #[must_use]
    pub fn is_key(&self) -> bool {
        !matches!(self.kind, Kind::Tiles)
    }

    fn keys(&self, now: Now) -> Result<Vec<KeyId>, StartError> {
        Ok(match &self.kind {
            Kind::Vehicle(..) if self.copied_to.is_some() => {
                vec![key_file::read_waiting(&self.path)?.id()]
            }
            Kind::Vehicle(_, mode) => look_at_keys(&self.path, *mode)?,
            Kind::Guard(_) => {
                let keys = guard_file::read(&self.path, now)?;
                keys.iter().map(|(key, _)| key.id()).collect()
            }
            Kind::Forward(_) | Kind::Access => vec![key_file::read(&self.path)?.id()],
            // It seals what etcd is given, and is compared with no other.
            Kind::Store => {
                drop(key_file::read(&self.path)?);
                vec![]
            }
            Kind::Tiles => {
                drop(Tiles::open(&self.path)?);
                vec![]
            }
        })
    }

    fn has_key_of(&self, owner: &NamedFile, key: KeyId) -> StartError {
        let other = owner.whose.clone();
        match (&self.kind, &owner.kind) {
            (Kind::Vehicle(other, _), Kind::Vehicle(one, _)) => StartError::SameKey {
                one: *one,
                other: *other,
                key,
            },
            (Kind::Guard(station), _) => StartError::GuardKey {
                station: *station,
                other,
                key,
            },
            (Kind::Forward(name), _) => StartError::ForwardKey {
                name: name.clone(),
                other,
                key,
            },
            // Vehicles are looked at first.
            _ => StartError::AccessKey { other, key },
        }
    }

    fn fault(&self, why: impl ToString) -> KeyFault {
        KeyFault {
            whose: self.whose.clone(),
            why: why.to_string(),
            reload: false,
        }
    }
}

/// What is wrong with the key files, and the key that the file of each guard holds.
#[derive(Debug, Default)]
pub struct Keys {
    /// Those that a start could not use, and those that hold no key yet.
    pub faults: Vec<KeyFault>,
    /// The CUCS, the id of the key, and its file.
    pub guards: Vec<(Id, KeyId, PathBuf)>,
}

/// Looks at the key files among these. Blocks as [`look`] does.
#[must_use]
pub fn look_at_key_files(files: &[NamedFile], now: Now) -> Keys {
    let mut keys = Keys::default();
    for (file, held) in files.iter().zip(look(files, now)) {
        match (held, &file.kind) {
            (_, Kind::Tiles) => {}
            (Err(StartError::NotPaired { .. }), _) => keys.faults.push(file.not_agreed()),
            (Err(cause), _) => keys.faults.push(file.fault(cause)),
            (Ok(held), Kind::Vehicle(..)) if held.is_empty() => keys.faults.push(file.not_agreed()),
            (Ok(held), Kind::Guard(cucs)) => {
                let key = held.first().map(|key| (*cucs, *key, file.path.clone()));
                keys.guards.extend(key);
            }
            (Ok(_), _) => {}
        }
    }
    keys
}

impl NamedFile {
    fn not_agreed(&self) -> KeyFault {
        self.fault(format!(
            "no key {} has been agreed yet, or it is lost: pair with the air-side agent (\"vsm pair\")",
            self.path.display()
        ))
    }
}

/// What is wrong with the folder of a store, while a bridge uses it too: its disk has no room, or a folder is in the way of its files.
/// `shared`: it is this node's copy of what is in etcd.
#[must_use]
pub fn look_at_store(folder: &Path, shared: bool) -> Option<StoreFact> {
    let shown = folder.display();
    if let Some(free) = disk::is_full(folder) {
        let copy = if shared {
            " (this node's copy of what etcd has)"
        } else {
            ""
        };
        let why = format!("[store] dir {shown}{copy}: its disk is full, {free} bytes are free");
        return Some(StoreFact::Full(why));
    }
    let fault = disk::check_names(folder).err()?;
    Some(StoreFact::Unusable(format!("[store] dir: {fault}")))
}

/// Whether a start would have an access list: `Some` where it would have that of the store, and why not that of the file.
///
/// # Errors
/// It would have none.
pub fn look_at_access(config: &Config) -> Result<Option<String>, StartError> {
    let Some(access) = &config.access else {
        return Ok(None);
    };
    let key = key_file::read(&access.key_file)?;
    let file = guards::access_list(&access.list);
    let (now, vsm) = (Clock::default().now(), config.dli.vsm_id);
    let mut store = TrialDisk::new(&config.store.dir, TrialFiles::default());
    Ok(examine_access(
        &key, vsm, file, now, NOT_BEFORE, &mut store,
    )?)
}

/// `StateDirectory` of the packaged unit.
pub(in crate::shell) const SERVICE_STATE: &str = "/var/lib/vsm";

#[cfg(test)]
mod tests {
    use std::os::unix::fs::PermissionsExt as _;
    use std::time::Duration;

    use super::*;

    const NOW: Now = Now {
        mono: Duration::ZERO,
        wall: Duration::ZERO,
    };

    fn config(folder: &Path, more: &str) -> Config {
        let text = format!(
            "[dli]\nvsm_id = \"1b:00:00:01\"\nlisten = \"127.0.0.1:0\"\n[store]\ndir = \"state\"\n{more}"
        );
        Config::parse(&text, folder).unwrap_or_else(|fault| panic!("{fault}"))
    }

    fn faults(config: &Config) -> Vec<String> {
        let looked = look(&named_files(config, None), NOW).into_iter();
        let faults = looked.filter_map(Result::err);
        faults.map(|fault| fault.to_string()).collect()
    }

    const TABLES: &str = "[[vehicle]]\nid = \"1b:00:01:01\"\nlink = \"udpin:127.0.0.1:0\"\nsystem_id = 1\n\
        signing = { key_file = \"uav1.key\" }\n\
        [[forward]]\nname = \"qgc\"\nlink = \"tcpin:127.0.0.1:0\"\nkey_file = \"qgc.key\"\n\
        [[cucs]]\nid = \"1b:00:00:a0\"\nloi = [2]\nguard = { key_file = \"a0.key\" }\n\
        [access]\nlist = \"access.list\"\nkey_file = \"access.key\"\n";
    const KEYS: [&str; 4] = ["uav1.key", "qgc.key", "a0.key", "access.key"];

    #[test]
    fn every_key_file_is_looked_at_and_none_may_hold_the_key_of_another() {
        let folder = tempfile::tempdir().unwrap();
        let path = |name: &str| folder.path().join(name);
        let config = config(folder.path(), TABLES);
        assert_eq!(faults(&config).len(), KEYS.len());
        for name in KEYS {
            key_file::generate(&path(name)).unwrap();
        }
        assert_eq!(faults(&config), Vec::<String>::new());
        for (name, words) in [
            ("qgc.key", "[[forward]] qgc has the key"),
            ("a0.key", "CUCS 1b:00:00:a0 has the guard key"),
            ("access.key", "access.key_file has the key"),
        ] {
            let own = fs::read(path(name)).unwrap();
            fs::copy(path("uav1.key"), path(name)).unwrap();
            let found = faults(&config);
            assert_eq!(found.len(), 1, "{found:?}");
            assert!(
                found[0].contains(words) && found[0].contains("of vehicle 1b:00:01:01"),
                "{found:?}"
            );
            fs::write(path(name), own).unwrap();
        }
        // A pipe is looked at without waiting for its other end.
        fs::remove_file(path("a0.key")).unwrap();
        let made = std::process::Command::new("mkfifo")
            .arg(path("a0.key"))
            .status();
        assert!(made.unwrap().success());
        let found = faults(&config);
        assert!(
            found.len() == 1 && found[0].contains("not a regular file"),
            "{found:?}"
        );
    }

    #[test]
    fn the_folder_of_the_keys_is_looked_at_too() {
        let folder = tempfile::tempdir().unwrap();
        let config = config(folder.path(), TABLES);
        for name in KEYS {
            key_file::generate(&folder.path().join(name)).unwrap();
        }
        fs::set_permissions(folder.path(), fs::Permissions::from_mode(0o777)).unwrap();
        let found = faults(&config);
        assert!(
            found.iter().any(|one| one.contains("written by others")),
            "{found:?}"
        );
    }

    #[test]
    fn the_key_of_a_guard_is_named_beside_what_is_wrong_with_others() {
        let folder = tempfile::tempdir().unwrap();
        let config = config(folder.path(), TABLES);
        key_file::generate(&folder.path().join("a0.key")).unwrap();
        let keys = look_at_key_files(&named_files(&config, None), NOW);
        let whose: Vec<&str> = keys.faults.iter().map(|one| &*one.whose).collect();
        assert_eq!(
            whose,
            ["vehicle 1b:00:01:01", "[[forward]] qgc", "[access]"]
        );
        let [(cucs, key, path)] = &keys.guards[..] else {
            panic!("{keys:?}");
        };
        assert_eq!(*cucs, Id(0x1b00_00a0));
        assert_eq!(*key, key_file::read(path).unwrap().id());
    }
}
