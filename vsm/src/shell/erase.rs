//! Erases what must not fall into other hands: keys, identities, plans, recordings, logs; of a bridge, or of an agent.
//!
//! [`Order`] names what is to be erased. [`begin`] writes it into the store's folder, durably, before the first file is
//! touched. From then on nothing is served from that store, and each start finishes the order first
//! ([`finish_before_start`]), however often power fails in between. Each file is overwritten, synchronised, then deleted,
//! keys first; a missing file counts as done. The folders are synchronised, and only then is the order removed. A mark
//! stays ([`is_zeroized`]), so that an accidental start serves nothing.
//!
//! The part of an order beyond this computer (agents beside PX4, and PX4's own key) is tried once more by a start that
//! finds it unfinished ([`claim_at_start`]). The attempt is recorded on disk before it is made, so that nobody can keep the
//! keys alive by cutting the power again and again.
//!
//! Symbolic links are not followed: the link is deleted, and its target is reported. A file of another user is refused by
//! name. Where root erases, so is a file with a second name, and one that another user may have led root to. A file that could
//! not be erased keeps the order in place, except for recordings: others may write to their folder.

use std::fs::{self, Metadata};
use std::io;
use std::os::unix::fs::MetadataExt as _;
use std::path::{Path, PathBuf};

use mavlink_link::store::{Disk as _, Durability, StoreError};
use rustix::process::geteuid;
use serde::{Deserialize, Serialize};

use super::disk::{ERASE_ORDER, FileDisk, FileSystem, NativeFileSystem, OpenError};
use super::disk::{beside, folder_of, is_to_be_erased, replace};
use super::{key_store, ownership};
use crate::config::airside::AirsideConfig;
use crate::config::{Config, ExchangeMode, Signing};

/// What is to be erased beside the store.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Order {
    /// Paths of the current key files, links resolved: the other files of each key lie beside it.
    keys: Vec<PathBuf>,
    /// Lists of who may command: they name keys and vehicles.
    #[serde(default)]
    lists: Vec<PathBuf>,
    /// The folder of recordings.
    recordings: Option<PathBuf>,
    /// The audit logs and their key stay.
    keep_audit: bool,
    /// What it orders beyond this computer.
    #[serde(default)]
    beyond: Beyond,
    /// Valid in flight too; agents receive the same order.
    #[serde(default)]
    in_flight: bool,
}

/// The progress of what an order demands beyond this computer.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
enum Beyond {
    /// Nothing is demanded, or nothing is left to do.
    #[default]
    None,
    /// Not tried yet: the next start tries it.
    Due,
    /// Tried: only erasing is left.
    Tried,
}

impl Beyond {
    fn of(any: bool) -> Beyond {
        if any { Beyond::Due } else { Beyond::None }
    }
}

/// The outcome of an order.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Erased {
    /// Files that were overwritten and deleted.
    pub files: Vec<PathBuf>,
    /// Files left, on purpose or because they are not ours, which do not keep the order in place: what, and why.
    pub left: Vec<(PathBuf, String)>,
    /// What could not be erased, and why: the order stays.
    pub failed: Vec<(PathBuf, String)>,
}

/// An order that could not be started, or not be read again.
#[derive(Debug, thiserror::Error)]
pub enum EraseError {
    /// The store cannot be used.
    #[error(transparent)]
    Open(#[from] OpenError),
    /// The order is not stored: nothing has been erased, and nothing will be.
    #[error("the order to zeroize cannot be stored, and nothing is erased: {0}")]
    Begin(StoreError),
    /// The order cannot be read.
    #[error("the order to zeroize {path} cannot be read: {cause}; nothing is served from this store while it is there: remove it, then run `vsm zeroize`, or `vsm run` where nothing was to be erased", path = path.display())]
    Order {
        /// Its file.
        path: PathBuf,
        /// The system's reason.
        cause: io::Error,
    },
    /// Something is left.
    #[error("the zeroize of {store} is not finished: {path}: {why}; nothing is served from this store until it is: mend that, then start this again", store = store.display(), path = path.display())]
    Unfinished {
        /// The store.
        store: PathBuf,
        /// The first of what is left.
        path: PathBuf,
        /// Why.
        why: String,
    },
}

impl Order {
    /// Everything of a bridge. `in_flight`: the order is valid in flight too.
    #[must_use]
    pub fn of_bridge(config: &Config, in_flight: bool) -> Order {
        // With a key exchange there is an agent to order. Without one the bridge itself replaces PX4's key, if the
        // configuration says so.
        let beyond = config.vehicles().any(|one| match &one.signing {
            Signing::KeyFile(_, exchange) => match exchange.mode {
                ExchangeMode::On => true,
                ExchangeMode::Off => config.zeroize.px4_key,
                ExchangeMode::Legacy => false,
            },
            Signing::Off => false,
        });
        let vehicles = config.vehicles().filter_map(|one| match &one.signing {
            Signing::KeyFile(path, _) => Some(path.as_path()),
            Signing::Off => None,
        });
        let forwards = config.forwards().filter_map(|one| one.key_file.as_deref());
        let guards = config.stations().filter_map(|one| one.guard.as_ref());
        let guards = guards.map(|guard| guard.key_file.as_path());
        let access = config.access.iter().map(|access| access.key_file.as_path());
        let fleet = config.store.key_file.iter().map(PathBuf::as_path);
        let others = forwards.chain(guards).chain(access).chain(fleet);
        Order {
            keys: vehicles.chain(others).map(real).collect(),
            lists: config.access.iter().map(|one| real(&one.list)).collect(),
            recordings: config.record.as_ref().map(|record| absolute(&record.dir)),
            keep_audit: config.zeroize.keep_audit,
            beyond: Beyond::of(beyond),
            in_flight,
        }
    }

    /// Everything of an agent beside PX4.
    #[must_use]
    pub fn of_agent(config: &AirsideConfig) -> Order {
        Order {
            keys: vec![real(&config.agent.get_ref().key_file)],
            lists: Vec::new(),
            recordings: None,
            keep_audit: false,
            beyond: Beyond::of(config.zeroize.px4_key),
            // PX4 accepts no key while it is armed, whatever the order says.
            in_flight: false,
        }
    }

    /// Whether it orders anything beyond this computer.
    #[must_use]
    pub fn reaches_beyond(&self) -> bool {
        self.beyond == Beyond::Due
    }

    /// The files it would erase now, keys first, since everything else depends on them. Files that are kept, and folders
    /// that cannot be read, are added to `erased`.
    #[must_use]
    pub fn files(&self, store: &Path, erased: &mut Erased) -> Vec<PathBuf> {
        let mut files = Vec::new();
        for key in &self.keys {
            for file in key_store::files_of(key) {
                let beside = beside(&file);
                files.extend([file, beside]);
            }
        }
        // Dangling links are kept in the list: `erase` deletes the link.
        files.retain(|file| fs::symlink_metadata(file).is_ok_and(|found| !found.is_dir()));
        let mut stored = entries(store, erased);
        let is_identity = |path: &Path| named(path, |name| name.starts_with("exchange"));
        // Identities before the rest of the store: power may fail at any point of the list.
        stored.sort_by_key(|path| (!is_identity(path), path.clone()));
        for path in stored {
            let kept = named(&path, |name| [LOCK, ERASE_ORDER, MARK].contains(&name));
            if kept || files.contains(&path) {
                continue;
            }
            if self.keep_audit && named(&path, |name| name.starts_with("audit")) {
                let why = "zeroize.keep_audit is set".to_owned();
                erased.left.push((path, why));
                continue;
            }
            files.push(path);
        }
        let lists = self.lists.iter().filter(|list| list.is_file());
        files.extend(lists.cloned());
        if let Some(folder) = &self.recordings {
            let recorded = entries(folder, erased).into_iter();
            files.extend(recorded.filter(|path| named(path, is_recording)));
        }
        files
    }

    /// Whether a file that cannot be erased keeps the order in place. Anyone who may write into the folder of recordings
    /// could otherwise block it forever; and a list may belong to another user, who signs it.
    #[must_use]
    pub fn needs(&self, path: &Path) -> bool {
        let within = |folder: &PathBuf| folder_of(path) == folder;
        let listed = self.lists.iter().any(|list| list == path);
        !listed && !self.recordings.as_ref().is_some_and(within)
    }
}

/// Writes the order into the store, which nobody else holds: from here on nothing is served from it. `Some`: the order is
/// in place, but a power cut may undo it, and why.
///
/// # Errors
/// It is not in place, also after a power cut: nothing will be erased.
pub fn begin(disk: &mut FileDisk, order: &Order) -> Result<Option<String>, EraseError> {
    let fault = |cause: serde_json::Error| EraseError::Begin(StoreError::new(ERASE_ORDER, cause));
    let text = serde_json::to_vec(order).map_err(fault)?;
    let Err(cause) = disk.replace(ERASE_ORDER, &text, Durability::Power) else {
        return Ok(None);
    };
    // If only the synchronisation of the folder failed, the file already has its name, and the next start would carry out
    // an order that was reported as refused.
    let (store, system) = (disk.folder(), disk.system());
    let withdrawn = match is_to_be_erased(store) {
        true => system
            .remove(&store.join(ERASE_ORDER))
            .and_then(|()| system.sync(store)),
        false => Ok(()),
    };
    match withdrawn {
        Ok(()) => Err(EraseError::Begin(cause)),
        // It cannot be taken back, so it is carried out as ordered.
        Err(fault) => Ok(Some(format!(
            "{cause}; it cannot be withdrawn either ({fault}): it is carried out now, and where power fails before, perhaps at the \
             next start"
        ))),
    }
}

/// Claims the part of an order beyond this computer for the process that holds the store: whether it is valid in flight
/// too. `None` if there is nothing to do, if it was tried before, or if the disk does not record the attempt: then it is
/// not made, since each start would repeat it and the keys would stay meanwhile.
pub fn claim(disk: &mut FileDisk) -> Option<bool> {
    let system = disk.system();
    let mut order = read(disk.folder(), &*system).ok()??;
    if order.beyond != Beyond::Due {
        return None;
    }
    // Recorded before the attempt, not after: see the head of this file.
    order.beyond = Beyond::Tried;
    let text = serde_json::to_vec(&order).ok()?;
    let stored = disk.replace(ERASE_ORDER, &text, Durability::Power);
    stored.is_ok().then_some(order.in_flight)
}

/// As [`claim`], at a start. The returned store stays locked until dropped; use it for this purpose only.
///
/// # Errors
/// Another process has the store, or it cannot be used.
pub fn claim_at_start(store: &Path) -> Result<Option<(FileDisk, bool)>, EraseError> {
    if !is_to_be_erased(store) {
        return Ok(None);
    }
    let mut disk = FileDisk::open_to_erase(store, Box::new(NativeFileSystem))?;
    let claimed = claim(&mut disk);
    Ok(claimed.map(|in_flight| (disk, in_flight)))
}

/// Whether a store has been zeroized and not been cleared by a person since. True also if that cannot be determined.
#[must_use]
pub fn is_zeroized(store: &Path) -> bool {
    let found = fs::symlink_metadata(store.join(MARK));
    !matches!(found, Err(cause) if cause.kind() == io::ErrorKind::NotFound)
}

/// A person allows a zeroized store to be used again.
///
/// # Errors
/// Another process has it, an order stands in it, or it cannot be written.
pub fn clear(store: &Path) -> anyhow::Result<()> {
    let disk = FileDisk::open_on(store, Box::new(NativeFileSystem))?;
    let system = disk.system();
    system.remove(&store.join(MARK))?;
    Ok(system.sync(store)?)
}

/// Finishes the order in a store, before anything of the store is read or served; the store is locked meanwhile. `None` if
/// there is no order.
///
/// # Errors
/// Another process has the store, or it is not finished: nothing may be served.
pub fn finish_before_start(store: &Path) -> Result<Option<Erased>, EraseError> {
    finish_on(store, Box::new(NativeFileSystem))
}

/// As [`finish_before_start`], with all writing by `system`.
///
/// # Errors
/// As [`finish_before_start`].
pub fn finish_on(store: &Path, system: Box<dyn FileSystem>) -> Result<Option<Erased>, EraseError> {
    if !is_to_be_erased(store) {
        return Ok(None);
    }
    let disk = FileDisk::open_to_erase(store, system)?;
    let Some(erased) = finish(store, &*disk.system())? else {
        return Ok(None);
    };
    if let Some((path, why)) = erased.failed.first() {
        return Err(EraseError::Unfinished {
            store: store.to_owned(),
            path: path.clone(),
            why: why.clone(),
        });
    }
    Ok(Some(erased))
}

/// Whether a start could read the order in a store, where there is one.
///
/// # Errors
/// It could not, and would not start.
pub fn check_order(store: &Path) -> Result<(), EraseError> {
    read(store, &NativeFileSystem).map(drop)
}

/// The order in a store.
fn read(store: &Path, system: &dyn FileSystem) -> Result<Option<Order>, EraseError> {
    let path = store.join(ERASE_ORDER);
    let order = system.read(&path, MAX_ORDER_BYTES).and_then(|text| {
        let parsed = text.map(|text| serde_json::from_slice(&text));
        Ok(parsed.transpose()?)
    });
    order.map_err(|cause| EraseError::Order { path, cause })
}

/// Carries out the order in a store.
fn finish(store: &Path, system: &dyn FileSystem) -> Result<Option<Erased>, EraseError> {
    let path = store.join(ERASE_ORDER);
    let Some(order) = read(store, system)? else {
        return Ok(None);
    };
    let mut erased = Erased::default();
    // Synchronised even where no file is left: an earlier run may have deleted names without reaching the disk.
    let mut folders: Vec<PathBuf> = vec![store.to_owned()];
    folders.extend(order.keys.iter().map(|key| folder_of(key).to_owned()));
    folders.extend(order.recordings.clone());
    for file in order.files(store, &mut erased) {
        match erase(&file, system) {
            Ok(None) => erased.files.push(file),
            Ok(Some(why)) => erased.left.push((file, why)),
            Err(cause) if order.needs(&file) => erased.failed.push((file, cause.to_string())),
            Err(cause) => erased.left.push((file, cause.to_string())),
        }
    }
    folders.sort();
    folders.dedup();
    for folder in folders.into_iter().filter(|folder| folder.exists()) {
        if let Err(cause) = system.sync(&folder) {
            erased.failed.push((folder, cause.to_string()));
        }
    }
    if erased.failed.is_empty() {
        // Only now: a start that finds neither order nor mark serves. The mark goes first, so that at no moment both are
        // missing.
        let removed = replace(system, &store.join(MARK), b"", true)
            .and_then(|()| system.remove(&path))
            .and_then(|()| system.sync(store));
        if let Err(cause) = removed {
            erased.failed.push((path, cause.to_string()));
        }
    }
    Ok(Some(erased))
}

/// Erases one file; returns the reason if a file that is not ours is left.
fn erase(path: &Path, system: &dyn FileSystem) -> io::Result<Option<String>> {
    let found = match fs::symlink_metadata(path) {
        Err(cause) if cause.kind() == io::ErrorKind::NotFound => return Ok(None),
        found => found?,
    };
    // Root must not be led to a file of its own by somebody else.
    let folder = folder_of(path);
    ownership::check_way(folder)?;
    if geteuid().is_root() {
        ownership::check_folder(folder)?;
    }
    // A link's target may be anyone's file. Overwriting it could destroy something unrelated.
    if found.is_symlink() {
        let to = fs::read_link(path);
        let to = to.map_or_else(|_| "its target".into(), |to| to.display().to_string());
        system.remove(path)?;
        let why = format!("it was a symbolic link, and is deleted; {to} is not erased");
        return Ok(Some(why));
    }
    if found.is_dir() {
        return Ok(Some("it is a folder, which vsm did not create".into()));
    }
    if found.is_file() {
        // A creation that was cut off has left both names on one file, and root erases none with two.
        let second = beside(path);
        let same = |other: Metadata| (other.dev(), other.ino()) == (found.dev(), found.ino());
        if fs::symlink_metadata(&second).is_ok_and(same) {
            system.remove(&second)?;
        }
        system.overwrite(path)?;
    }
    // A socket has no content.
    system.remove(path)?;
    Ok(None)
}

/// The entries of a folder.
fn entries(folder: &Path, erased: &mut Erased) -> Vec<PathBuf> {
    let listed = fs::read_dir(folder).and_then(|listed| {
        let each = listed.map(|entry| Ok(entry?.path()));
        each.collect::<io::Result<Vec<PathBuf>>>()
    });
    match listed {
        Ok(mut paths) => {
            paths.sort();
            paths
        }
        Err(cause) if cause.kind() == io::ErrorKind::NotFound => Vec::new(),
        Err(cause) => {
            erased.failed.push((folder.to_owned(), cause.to_string()));
            Vec::new()
        }
    }
}

fn named(path: &Path, is: impl Fn(&str) -> bool) -> bool {
    let name = path.file_name();
    name.is_some_and(|name| is(&name.to_string_lossy()))
}

/// Whether a bridge has written a file with this name, in this run or earlier, also for a vehicle that is no longer
/// configured.
fn is_recording(name: &str) -> bool {
    let of_vehicle = || {
        let id = name.split_once('-').map(|(id, _)| id);
        let is_id = |id: &str| id.len() == 8 && id.bytes().all(|byte| byte.is_ascii_hexdigit());
        name.ends_with(".tlog") && id.is_some_and(is_id)
    };
    (name.starts_with("dli-") && name.ends_with(".pcapng")) || of_vehicle()
}

/// The next start may have another working folder, and the files of a key lie where a configured link leads. Root follows none that
/// somebody else may have put there.
fn real(path: &Path) -> PathBuf {
    let real = match ownership::check_way(path) {
        Ok(()) => key_store::real_path(path).ok(),
        Err(_) => None,
    };
    real.unwrap_or_else(|| absolute(path))
}

fn absolute(path: &Path) -> PathBuf {
    std::path::absolute(path).unwrap_or_else(|_| path.to_owned())
}

/// What no program can erase: how the medium of a folder keeps overwritten data, where the system reports it.
#[must_use]
pub fn medium(folder: &Path) -> Option<&'static str> {
    let kind = rustix::fs::statfs(folder).ok()?.f_type;
    // linux/magic.h, and OpenZFS's own.
    Some(match u64::try_from(kind).ok()? {
        0x9123_683e => "btrfs, which writes elsewhere what is overwritten (copy on write)",
        0x2fc1_2fc1 => "ZFS, which writes elsewhere what is overwritten (copy on write)",
        0xca45_1a4e => "bcachefs, which writes elsewhere what is overwritten (copy on write)",
        0x794c_7630 => "an overlay, whose lower layers keep what they had",
        0xf2f5_2010 => "F2FS, a log, which writes elsewhere what is overwritten",
        0x6969 => "NFS: what its server keeps is not known",
        _ => return None,
    })
}

/// The store's lock, which holds nothing and is never removed.
const LOCK: &str = "lock";
/// Marks a zeroized store.
const MARK: &str = "zeroized";
/// Room for a path for each vehicle and station.
const MAX_ORDER_BYTES: u64 = 1 << 20;

#[cfg(test)]
mod tests;
