//! The one way to persist: typed records over a disk that holds bytes by name.
//!
//! Every machine that must survive a restart borrows a [`Disk`] for the length of a call and writes before it answers.
//! A [`Record`] says what its file is called, how its bytes read, and what it must survive; [`Store`] loads and saves it.
//!
//! ```
//! use mavlink_link::store::{Disk, Durability, MAX_RECORD_BYTES, Record, Store as _, StoreError};
//! use zeroize::Zeroizing;
//!
//! /// How often a vehicle was started.
//! struct Starts(u32);
//!
//! impl Record for Starts {
//!     type Key = u32;
//!     const DURABILITY: Durability = Durability::Process;
//!     fn name(vehicle: &u32) -> String { format!("starts-{vehicle:08x}") }
//!     fn encode(&self) -> Vec<u8> { self.0.to_string().into_bytes() }
//!     fn decode(bytes: &[u8]) -> Result<Self, String> {
//!         let text = std::str::from_utf8(bytes).map_err(|cause| cause.to_string())?;
//!         text.parse().map(Starts).map_err(|_| format!("{text:?} is not a number"))
//!     }
//! }
//!
//! fn started(disk: &mut dyn Disk, vehicle: u32) -> Result<u32, StoreError> {
//!     let before = disk.load::<Starts>(&vehicle)?.map_or(0, |starts| starts.0);
//!     disk.save(&vehicle, &Starts(before + 1))?;
//!     Ok(before + 1)
//! }
//! ```

use std::time::Duration;

use zeroize::Zeroizing;

/// Files by name. A file that is replaced holds the old bytes or the new after a crash, never a part.
pub trait Disk {
    /// The first `max_bytes` of a file; `None` where there is none.
    ///
    /// Wiped when dropped: keys are among the files.
    ///
    /// # Errors
    /// It exists and cannot be read.
    fn read(&self, name: &str, max_bytes: u64) -> Result<Option<Zeroizing<Vec<u8>>>, StoreError>;

    /// A file whole; `None` where there is none.
    ///
    /// # Errors
    /// As [`read`](Disk::read), or it is longer than that: something else has written to it, and its content would fill the
    /// memory, or count in part.
    fn read_whole(
        &self,
        name: &str,
        max_bytes: u64,
    ) -> Result<Option<Zeroizing<Vec<u8>>>, StoreError> {
        match self.read(name, max_bytes.saturating_add(1))? {
            Some(bytes) if bytes.len() as u64 > max_bytes => Err(StoreError::new(
                name,
                format!(
                    "it has more than {max_bytes} bytes, and was written to by something else: put back a copy of it, or move it away"
                ),
            )),
            read => Ok(read),
        }
    }

    /// How long ago another computer wrote this file at most, as this one found it at its start; `None` where that is not known.
    /// By no wall clock.
    fn written_within(&self, name: &str) -> Option<Duration> {
        let _ = name;
        None
    }

    /// Replaces a file whole.
    ///
    /// # Errors
    /// It was not made durable. The old bytes are still there, or, where only the folder could not be synchronised, the
    /// new ones.
    fn replace(
        &mut self,
        name: &str,
        bytes: &[u8],
        durability: Durability,
    ) -> Result<(), StoreError>;

    /// Appends to a file, which is created if missing.
    ///
    /// # Errors
    /// Nothing has been added, or a part.
    fn append(
        &mut self,
        name: &str,
        bytes: &[u8],
        durability: Durability,
    ) -> Result<(), StoreError>;

    /// Replaces a log by a shorter one that says the same. Where that takes time, what is appended meanwhile is in both, and
    /// nothing waits for it: a process that ends in between leaves one of them, whole.
    ///
    /// # Errors
    /// The log is as it was.
    fn compact(&mut self, name: &str, bytes: &[u8]) -> Result<(), StoreError> {
        self.replace(name, bytes, Durability::Process)
    }

    /// Moves a file into the place of another, durably. Does nothing if `from` does not exist.
    ///
    /// # Errors
    /// Nothing has changed, or the new name is not durable yet.
    fn rename(&mut self, from: &str, to: &str) -> Result<(), StoreError>;

    /// Deletes a file, durably. Does nothing if it does not exist.
    ///
    /// # Errors
    /// It is not deleted, or that is not durable yet.
    fn remove(&mut self, name: &str) -> Result<(), StoreError>;

    /// Whether a change may become durable only after its call.
    fn queues(&self) -> bool {
        false
    }

    /// The number of the last change that this disk has accepted and makes durable later, counted from 1. What a change
    /// promises must not be answered before it is [`Progress::Durable`].
    ///
    /// 0 for a disk whose changes are durable when their call returns, as most are.
    fn queued(&self) -> u64 {
        0
    }

    /// How far these changes are. Each file is independent: one that cannot be made durable holds back no other.
    fn progress(&self, of: Changes) -> Progress {
        let _ = of;
        Progress::Durable
    }

    /// A record that cannot be made durable just now, and why. It is tried again, and further changes of it are refused.
    fn failing(&self) -> Option<StoreError> {
        None
    }

    /// Rotates a log, so that the next line is the first of a new one: `name` becomes `name.1`, that `name.2`, up to
    /// `keep`; the oldest is deleted.
    ///
    /// No file is lost before all others have their new names: until then the oldest is `name.{keep + 1}`. A rotation that
    /// failed in the middle, or was cut off by a crash, leaves a gap in the numbers; the next one continues there and moves
    /// nothing twice.
    ///
    /// # Errors
    /// Not all of it has been done; no line is lost.
    fn rotate(&mut self, name: &str, keep: u32) -> Result<(), StoreError> {
        // The first free number ends the chain of renames: everything above it was moved by an earlier, interrupted
        // rotation.
        let surplus = log_name(name, keep + 1);
        let mut free = None;
        for number in 0..=keep + 1 {
            if self.read(&log_name(name, number), 0)?.is_none() {
                free = Some(number);
                break;
            }
        }
        // No gap: the rotation before is complete, except that its oldest file is still there.
        let free = match free {
            Some(number) => number,
            None => {
                self.remove(&surplus)?;
                keep + 1
            }
        };
        // Only to a free name: no rename can replace a file, however often it is tried.
        for number in (0..free).rev() {
            self.rename(&log_name(name, number), &log_name(name, number + 1))?;
        }
        if self.read(&surplus, 0)?.is_some() {
            self.remove(&surplus)?;
        }
        Ok(())
    }
}

/// Changes that a disk has queued, by their numbers: those after `after`, up to `until`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Changes {
    /// What [`Disk::queued`] was before the first of them.
    pub after: u64,
    /// The last of them.
    pub until: u64,
}

impl Changes {
    /// No change at all, which is durable.
    pub const NONE: Changes = Changes { after: 0, until: 0 };

    /// Whether there is none.
    #[must_use]
    pub fn is_empty(self) -> bool {
        self.until <= self.after
    }

    /// Both ranges, and the changes between them.
    #[must_use]
    pub fn and(self, others: Changes) -> Changes {
        match (self.is_empty(), others.is_empty()) {
            (true, _) => others,
            (_, true) => self,
            _ => Changes {
                after: self.after.min(others.after),
                until: self.until.max(others.until),
            },
        }
    }
}

/// How far changes are on their way to the disk.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Progress {
    /// All of them survive what they must: see [`Durability`].
    Durable,
    /// They are on their way.
    Waiting,
    /// One could not be made durable and is tried again. What depends on it must hold up nothing else.
    Failing,
}

/// What a record must survive.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Durability {
    /// The end of this process, `kill -9` too, from the return of the call on: what follows cannot wait, such as a command
    /// to the vehicle.
    Process,
    /// The same, but on a disk that queues only once its change is [`Progress::Durable`]: nothing but an answer follows,
    /// which waits for that.
    Answered,
    /// A power cut as well: synchronised to the disk before the call returns, or, on a disk that queues, once
    /// its change is [`Progress::Durable`].
    Power,
}

/// A file that could not be written or read. The text adds what to do, where the system's reason does not.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("record {name}: {cause}{}", remedy(cause))]
pub struct StoreError {
    /// The file.
    pub name: String,
    /// The system's reason, or what is wrong with the content.
    pub cause: String,
}

impl StoreError {
    /// An error about a file, for a reason.
    pub fn new(name: impl Into<String>, cause: impl core::fmt::Display) -> StoreError {
        StoreError {
            name: name.into(),
            cause: cause.to_string(),
        }
    }
}

/// What to do about a disk error, by the system's own words: `; free space on its disk`. Empty where the reason is not
/// known, or the text already contains the remedy.
///
/// By the words and not by the error number: causes are kept as texts here, and programs that set no locale get them in
/// English.
#[must_use]
pub fn remedy(cause: &str) -> &'static str {
    let known = REMEDIES
        .iter()
        .find(|(reason, remedy)| cause.contains(reason) && !cause.contains(remedy));
    known.map_or("", |(_, remedy)| remedy)
}

const REMEDIES: [(&str, &str); 7] = [
    ("No space left on device", "; free space on its disk"),
    // etcd's own words.
    (
        "database space exceeded",
        "; compact etcd's database, then give etcdctl alarm disarm",
    ),
    (
        "Disk quota exceeded",
        "; free space, or raise the quota of its owner",
    ),
    (
        "File too large",
        "; raise the limit on the size of files (ulimit -f)",
    ),
    (
        "Read-only file system",
        "; mount its disk for writing (a disk with faults is mounted read-only by itself: look at dmesg)",
    ),
    ("Input/output error", "; its disk has faults: look at dmesg"),
    (
        "Too many open files",
        "; raise the limit on open files (ulimit -n)",
    ),
];

/// A value with a file of its own.
pub trait Record: Sized {
    /// What distinguishes two files of this kind, such as a vehicle's id.
    type Key: ?Sized;

    /// What [`Store::save`] makes it survive.
    const DURABILITY: Durability;

    /// The file's name.
    fn name(key: &Self::Key) -> String;

    /// The file's content.
    fn encode(&self) -> Vec<u8>;

    /// The value of a file.
    ///
    /// # Errors
    /// What is wrong with the content, for a person.
    fn decode(bytes: &[u8]) -> Result<Self, String>;
}

/// Typed records, on every [`Disk`].
pub trait Store: Disk {
    /// Reads a record; `None` where it was never written.
    ///
    /// # Errors
    /// It exists and cannot be read or decoded. A caller must not treat that as a missing record: what it promised before
    /// the restart would be lost.
    fn load<R: Record>(&self, key: &R::Key) -> Result<Option<R>, StoreError> {
        let name = R::name(key);
        match self.read_whole(&name, MAX_RECORD_BYTES)? {
            None => Ok(None),
            Some(bytes) => match R::decode(&bytes) {
                Ok(record) => Ok(Some(record)),
                Err(cause) => Err(StoreError { name, cause }),
            },
        }
    }

    /// Writes a record.
    ///
    /// # Errors
    /// As [`Disk::replace`].
    fn save<R: Record>(&mut self, key: &R::Key, record: &R) -> Result<(), StoreError> {
        self.save_as(key, record, R::DURABILITY)
    }

    /// Writes a record with another durability than its kind has.
    ///
    /// # Errors
    /// As [`Disk::replace`].
    fn save_as<R: Record>(
        &mut self,
        key: &R::Key,
        record: &R,
        durability: Durability,
    ) -> Result<(), StoreError> {
        self.replace(&R::name(key), &record.encode(), durability)
    }
}

impl<D: Disk + ?Sized> Store for D {}

/// The name of a log after this many rotations.
#[must_use]
pub fn log_name(name: &str, number: u32) -> String {
    if number == 0 {
        name.to_owned()
    } else {
        format!("{name}.{number}")
    }
}

/// Bound on a record that is read back: a full plan of 10,000 waypoints is a quarter of it.
pub const MAX_RECORD_BYTES: u64 = 16 << 20;

#[cfg(any(test, feature = "test-util"))]
pub use memory::MemoryDisk;

#[cfg(any(test, feature = "test-util"))]
mod memory {
    use std::collections::{BTreeMap, VecDeque};
    use std::time::Duration;

    use super::{Changes, Disk, Durability, Progress, StoreError};
    use zeroize::Zeroizing;

    /// A disk in memory, for tests: it outlives what writes to it, and can be full.
    #[derive(Debug, Default, Clone)]
    pub struct MemoryDisk {
        /// The files.
        pub records: BTreeMap<String, Vec<u8>>,
        /// No file whose name starts so can be changed: a full disk. An empty text matches every file.
        pub full: Option<&'static str>,
        /// But for those that start so and are there: a full disk has room to write over them.
        pub written_over: Option<&'static str>,
        /// How many changes were tried.
        pub writes: u64,
        /// How many of them were refused.
        pub refused: u64,
        /// How many had to survive a power cut.
        pub synced: u64,
        /// Whether changes with [`Durability::Power`] become durable later, by [`complete`](MemoryDisk::complete).
        pub queues: bool,
        /// Records that were replaced and are not durable yet, the oldest first: the end of the process loses them.
        pub waiting: VecDeque<(u64, String, Vec<u8>)>,
        /// Records whose names start so cannot be made durable.
        pub stuck: Option<&'static str>,
        /// The last change that was queued.
        pub queued: u64,
        /// All up to this one are durable, except those that are stuck.
        pub durable: u64,
        /// How long ago another computer wrote each record at most.
        pub written_within: Option<Duration>,
    }

    impl MemoryDisk {
        fn admit(&mut self, name: &str, durability: Durability) -> Result<(), StoreError> {
            self.writes += 1;
            let starts = |prefix: &str| name.starts_with(prefix);
            let over = self.written_over.is_some_and(starts) && self.records.contains_key(name);
            if self.full.is_some_and(starts) && !over {
                self.refused += 1;
                return Err(StoreError::new(name, "No space left on device"));
            }
            self.synced += u64::from(durability == Durability::Power);
            self.queued += u64::from(self.queues && durability == Durability::Power);
            Ok(())
        }

        fn is_stuck(&self, name: &str) -> bool {
            self.stuck.is_some_and(|prefix| name.starts_with(prefix))
        }

        /// Makes all changes up to this number durable.
        pub fn complete(&mut self, change: u64) {
            for one in std::mem::take(&mut self.waiting) {
                if one.0 <= change && !self.is_stuck(&one.1) {
                    self.records.insert(one.1, one.2);
                } else {
                    self.waiting.push_back(one);
                }
            }
            self.durable = self.durable.max(change.min(self.queued));
        }

        /// Ends the process: queued changes are lost.
        pub fn kill(&mut self) {
            self.waiting.clear();
            self.durable = self.queued;
        }
    }

    impl Disk for MemoryDisk {
        fn read(
            &self,
            name: &str,
            max_bytes: u64,
        ) -> Result<Option<Zeroizing<Vec<u8>>>, StoreError> {
            let max = usize::try_from(max_bytes).unwrap_or(usize::MAX);
            // A process sees its own queued writes, as on a real disk that queues.
            let waits = self.waiting.iter().rev().find(|one| one.1 == name);
            let bytes = waits.map(|one| &one.2).or(self.records.get(name));
            Ok(bytes.map(|bytes| Zeroizing::new(bytes[..bytes.len().min(max)].to_vec())))
        }

        fn written_within(&self, name: &str) -> Option<Duration> {
            self.written_within
                .filter(|_| self.records.contains_key(name))
        }

        fn replace(
            &mut self,
            name: &str,
            bytes: &[u8],
            durability: Durability,
        ) -> Result<(), StoreError> {
            // A write behind a queued one of the same file must queue too, or the older bytes would overwrite it.
            let follows = self.waiting.iter().any(|one| one.1 == name);
            let durability = if follows {
                Durability::Power
            } else {
                durability
            };
            self.admit(name, durability)?;
            if self.queues && durability == Durability::Power {
                let waits = (self.queued, name.to_owned(), bytes.to_vec());
                self.waiting.push_back(waits);
            } else {
                self.records.insert(name.to_owned(), bytes.to_vec());
            }
            Ok(())
        }

        fn append(
            &mut self,
            name: &str,
            bytes: &[u8],
            durability: Durability,
        ) -> Result<(), StoreError> {
            self.admit(name, durability)?;
            let file = self.records.entry(name.to_owned()).or_default();
            file.extend_from_slice(bytes);
            Ok(())
        }

        fn rename(&mut self, from: &str, to: &str) -> Result<(), StoreError> {
            self.admit(from, Durability::Power)?;
            if let Some(bytes) = self.records.remove(from) {
                self.records.insert(to.to_owned(), bytes);
            }
            Ok(())
        }

        fn remove(&mut self, name: &str) -> Result<(), StoreError> {
            self.admit(name, Durability::Power)?;
            self.waiting.retain(|one| one.1 != name);
            self.records.remove(name);
            Ok(())
        }

        fn queues(&self) -> bool {
            self.queues
        }

        fn queued(&self) -> u64 {
            self.queued
        }

        fn failing(&self) -> Option<StoreError> {
            let mut stuck = self.waiting.iter().filter(|one| self.is_stuck(&one.1));
            stuck
                .next()
                .map(|one| StoreError::new(&*one.1, "Input/output error"))
        }

        fn progress(&self, of: Changes) -> Progress {
            let mut waiting = self.waiting.iter();
            if waiting.any(|one| of.after < one.0 && one.0 <= of.until && self.is_stuck(&one.1)) {
                Progress::Failing
            } else if of.is_empty() || of.until <= self.durable {
                Progress::Durable
            } else {
                Progress::Waiting
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A disk of which so many changes of names succeed, and no more.
    struct Renames {
        disk: MemoryDisk,
        left: u32,
    }

    impl Renames {
        fn take(&mut self, name: &str) -> Result<(), StoreError> {
            let left = self.left.checked_sub(1);
            self.left = left.ok_or_else(|| StoreError::new(name, "Input/output error"))?;
            Ok(())
        }
    }

    impl Disk for Renames {
        fn read(&self, name: &str, max: u64) -> Result<Option<Zeroizing<Vec<u8>>>, StoreError> {
            self.disk.read(name, max)
        }

        fn replace(&mut self, name: &str, bytes: &[u8], of: Durability) -> Result<(), StoreError> {
            self.disk.replace(name, bytes, of)
        }

        fn append(&mut self, name: &str, bytes: &[u8], of: Durability) -> Result<(), StoreError> {
            self.disk.append(name, bytes, of)
        }

        fn rename(&mut self, from: &str, to: &str) -> Result<(), StoreError> {
            self.take(from)?;
            self.disk.rename(from, to)
        }

        fn remove(&mut self, name: &str) -> Result<(), StoreError> {
            self.take(name)?;
            self.disk.remove(name)
        }
    }

    /// The files of a log, the newest first.
    fn logs(disk: &MemoryDisk) -> Vec<u8> {
        let number = |name: &str| name.strip_prefix("log.").map_or(0, |n| n.parse().unwrap());
        let mut all: Vec<(u32, u8)> = disk
            .records
            .iter()
            .map(|(n, b)| (number(n), b[0]))
            .collect();
        all.sort_unstable();
        all.into_iter().map(|(_, byte)| byte).collect()
    }

    #[test]
    fn a_rotation_that_is_cut_off_anywhere_however_often_loses_no_log() {
        // After so many changes of names; a crash is the same, with a new process.
        for cut in 0..=5 {
            let mut disk = Renames {
                disk: MemoryDisk::default(),
                left: u32::MAX,
            };
            for log in 0..5 {
                disk.append("log", &[log], Durability::Power).unwrap();
                if log < 4 {
                    disk.rotate("log", 3).unwrap();
                }
            }
            assert_eq!(logs(&disk.disk), [4, 3, 2, 1]);
            disk.left = cut;
            for _ in 0..9 {
                let done = disk.rotate("log", 3);
                assert_eq!(done.is_ok(), cut == 5, "{cut}");
                disk.left = 0;
                let all = if done.is_ok() {
                    &[4, 3, 2][..]
                } else {
                    &[4, 3, 2, 1]
                };
                assert_eq!(logs(&disk.disk), all, "{cut}");
                if done.is_ok() {
                    break;
                }
            }
            disk.left = u32::MAX;
            if cut < 5 {
                disk.rotate("log", 3).unwrap();
            }
            disk.append("log", &[5], Durability::Power).unwrap();
            disk.rotate("log", 3).unwrap();
            assert_eq!(logs(&disk.disk), [5, 4, 3], "{cut}");
            assert!(!disk.disk.records.contains_key("log"));
        }
    }

    #[test]
    fn a_rotated_log_keeps_so_many_and_begins_a_new_one() {
        let mut disk = MemoryDisk::default();
        for round in 0..4_u8 {
            disk.append("log", &[round], Durability::Power).unwrap();
            disk.rotate("log", 2).unwrap();
        }
        let read = |number| disk.read(&log_name("log", number), u64::MAX).unwrap();
        assert!(read(0).is_none() && read(3).is_none());
        assert_eq!(read(1).unwrap().as_slice(), [3]);
        assert_eq!(read(2).unwrap().as_slice(), [2]);
    }

    #[test]
    fn a_file_that_is_too_long_is_not_read_in_part() {
        let mut disk = MemoryDisk::default();
        disk.append("log", b"12345", Durability::Power).unwrap();
        assert_eq!(**disk.read_whole("log", 5).unwrap().unwrap(), *b"12345");
        let refused = disk.read_whole("log", 4).unwrap_err().to_string();
        assert!(
            refused.contains("record log: it has more than 4 bytes"),
            "{refused}"
        );
        assert_eq!(disk.read_whole("none", 4).unwrap(), None);
    }

    #[test]
    fn a_disk_that_refuses_is_named_with_what_to_do_once() {
        let full = StoreError::new("audit.key", "No space left on device (os error 28)");
        assert_eq!(
            full.to_string(),
            "record audit.key: No space left on device (os error 28); free space on its disk"
        );
        // A cause that carries the text of another.
        let outer = StoreError::new("plan", &full);
        assert_eq!(outer.to_string().matches("free space").count(), 1);
        let other = StoreError::new("plan", "line 3: no number");
        assert_eq!(other.to_string(), "record plan: line 3: no number");
    }
}
