//! The access list: which messages each CUCS may send to each vehicle, until when, and under which guard key. It is signed
//! with the access key.
//!
//! `list` is the file, `group` the groups of messages, `permits` the permissions of one CUCS. [`Access`] is the list in
//! force in a VSM, with the clock by which its entries expire.
//!
//! It promises:
//! - **It only narrows.** A list gives no right that `[[cucs]]` does not give.
//! - **No older list** comes into force again, also after restarts: the newest list that was ever in force is kept in the
//!   store. If the file is damaged, not signed, older, or different with the same version, the stored list stays in force.
//! - **An expired entry stays expired**: its time is that of a [`SigningClock`], which advances with monotonic time and
//!   never goes back over a restart. Setting the wall clock while the VSM runs moves it at most once, forward, if it was
//!   wrong at the start.
//! - **Nothing expires in the air.** A CUCS that holds a right over a vehicle keeps it, whatever the clock, until the
//!   vehicle is known to be disarmed. Entries that a newer list removes end at once, because a person decided that.

mod group;
mod list;
mod permits;

use std::time::Duration;

use mavlink_link::Now;
use mavlink_link::clock::{Ceiling, Origin, SigningClock, WallState};
use mavlink_link::signing::{KeyId, SigningKey, Stamp};
use mavlink_link::store::{Disk, Durability, Record, Store as _, StoreError};
use stanag_msgs::Id;

pub use self::group::{Group, UnknownGroup};
pub use self::list::{AccessEntry, AccessKey, AccessList, ListError, MAX_LIST_BYTES, parse_until};
pub(crate) use self::permits::{Permit, Permits, Permitted};
use super::dates::utc;
use crate::config::Config;

/// The restriction of the rights in `[[cucs]]`.
#[derive(Debug)]
pub(crate) enum Gate {
    /// No list is configured.
    Open,
    /// A list is configured but not loaded yet: nothing is permitted.
    Shut,
    /// A list is in force.
    List(Box<Access>),
}

impl Gate {
    pub(crate) fn of(config: &Config) -> Gate {
        match config.access {
            None => Gate::Open,
            Some(_) => Gate::Shut,
        }
    }
}

/// The list that is in force.
#[derive(Debug)]
pub(crate) struct Access {
    key: AccessKey,
    list: AccessList,
    /// The signed list.
    text: String,
    clock: SigningClock,
    /// Why the file is not in force, if another list is.
    refused: Option<String>,
    /// The version in the store at the start.
    before: Option<u64>,
}

/// A verified list that may be put in force.
#[derive(Debug)]
pub struct PreparedAccess {
    list: AccessList,
    text: String,
}

/// Why a VSM has no access list.
#[derive(Debug, thiserror::Error)]
pub enum AccessError {
    /// No list was ever in force, and the file is not a valid list.
    #[error("no access list was in force yet: {0}")]
    None(String),
    /// The stored list does not verify.
    #[error("the access list in the store: {0}")]
    Stored(ListError),
    /// The store.
    #[error(transparent)]
    Store(#[from] StoreError),
}

/// Why a list is not put in force.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum RenewError {
    /// It is not a valid list.
    #[error(transparent)]
    List(#[from] ListError),
    /// It is older than the one in force.
    #[error("the file of the access list is version {found}, older than version {in_force}, which stays in force: {}", sign_after(*in_force))]
    Older {
        /// The file's version.
        found: u64,
        /// The version in force.
        in_force: u64,
    },
    /// Two different lists were signed with the same version.
    #[error("the file of the access list has the same version ({version}) as the one in force, and other entries; the one in force stays: {}", sign_after(*version))]
    Another {
        /// The version of both.
        version: u64,
    },
    /// No list can be in force here.
    #[error(
        "no access list is in force that the file could replace: name it in [access] of the configuration, and restart the bridge"
    )]
    NotConfigured,
}

/// How a list becomes newer than this version.
fn sign_after(version: u64) -> String {
    match version.checked_add(1) {
        Some(next) => {
            format!(
                "sign the file again, by `vsm access sign --version {next}` or a greater version"
            )
        }
        None => {
            "there is no greater version: make another key (`vsm keygen`), and a new list under it"
                .to_owned()
        }
    }
}

/// The newest list that was in force under a key, as it was signed.
struct Stored(String);

impl Record for Stored {
    type Key = KeyId;
    const DURABILITY: Durability = Durability::Power;

    // Named by its key: another key starts without a list, and returning to an earlier key finds its latest list again.
    fn name(key: &KeyId) -> String {
        format!("access-{key}")
    }

    fn encode(&self) -> Vec<u8> {
        self.0.clone().into_bytes()
    }

    fn decode(bytes: &[u8]) -> Result<Self, String> {
        let text = String::from_utf8(bytes.to_vec());
        text.map(Stored).map_err(|_| "it is no text".to_owned())
    }
}

impl Access {
    /// Loads the list of the file, or the stored one if that is newer or the file is not valid.
    ///
    /// # Errors
    /// There is none, or the store cannot be used: nothing may be served.
    pub(crate) fn start(
        key: &SigningKey,
        vsm: Id,
        file: Result<Vec<u8>, String>,
        now: Now,
        not_before: Duration,
        disk: &mut dyn Disk,
    ) -> Result<Access, AccessError> {
        let key = AccessKey::new(key);
        let stored = disk.load::<Stored>(&key.id())?;
        let known = stored.map(|Stored(text)| {
            let list = AccessList::verified(text.as_bytes(), &key, vsm);
            list.map(|list| PreparedAccess { list, text })
        });
        // A damaged stored list is an error. If it counted as absent, an older file could come into force.
        let known = known.transpose().map_err(AccessError::Stored)?;
        let file = file.and_then(|bytes| {
            let known = known
                .as_ref()
                .map(|known| (known.list.version(), &*known.text));
            prepare(&bytes, &key, vsm, known).map_err(|fault| fault.to_string())
        });
        let before = known.as_ref().map(|known| known.list.version());
        let (PreparedAccess { list, text }, refused) = match (file, known) {
            // Stored before it is used, so that no later start falls back to an older list.
            (Ok(Some(new)), _) => {
                disk.save(&key.id(), &Stored(new.text.clone()))?;
                (new, None)
            }
            (Ok(None), Some(known)) => (known, None),
            // A file that is refused must not end the service: the stored list still verifies.
            (Err(why), Some(known)) => (known, Some(why)),
            (Err(why), None) => return Err(AccessError::None(why)),
            // `prepare` returns `None` only if the file equals a stored list, so this cannot happen.
            (Ok(None), None) => return Err(AccessError::None("it is empty".to_owned())),
        };
        let ceiling = disk.load::<Ceiling>(&key.id())?.map(|Ceiling(at)| at);
        let not_before = Stamp::from_unix(not_before);
        let clock = SigningClock::start(key.id(), Origin::KeyFile, ceiling, not_before, now);
        let mut access = Access {
            key,
            list,
            text,
            clock,
            refused,
            before,
        };
        access.keep(now, disk);
        Ok(access)
    }

    /// Checks whether a file is a newer list; `None` if it is the one in force. Changes nothing.
    ///
    /// # Errors
    /// It is not a newer list: why.
    pub(crate) fn prepare(&self, file: &[u8]) -> Result<Option<PreparedAccess>, RenewError> {
        let known = (self.list.version(), &*self.text);
        prepare(file, &self.key, self.list.vsm(), Some(known))
    }

    /// Stores a newer list: from then on no start uses an older one.
    ///
    /// # Errors
    /// It cannot be stored, and must not come into force.
    pub(crate) fn store(
        &self,
        new: &PreparedAccess,
        disk: &mut dyn Disk,
    ) -> Result<(), StoreError> {
        disk.save(&self.key.id(), &Stored(new.text.clone()))
    }

    /// Puts a stored newer list in force; returns the changes, for the report.
    pub(crate) fn take(&mut self, new: PreparedAccess) -> String {
        let before = self.list.version();
        (self.list, self.text, self.refused) = (new.list, new.text, None);
        let (after, count) = (self.list.version(), self.list.entries().len());
        format!("access list version {before} -> {after}, {count} entries")
    }

    /// The key that it is signed by.
    pub(crate) fn key_id(&self) -> KeyId {
        self.key.id()
    }

    /// The version in force before this start, if the store had one.
    pub(crate) fn before(&self) -> Option<u64> {
        self.before
    }

    /// Sets why the file is not the list in force, or that it is again.
    pub(crate) fn note_file(&mut self, refused: Option<String>) {
        self.refused = refused;
    }

    /// Keeps the stored time ahead of the clock; once a second.
    pub(crate) fn keep(&mut self, now: Now, disk: &mut dyn Disk) {
        self.clock.watch_wall(now);
        self.clock.waits(now, disk);
    }

    /// The time by which entries expire, seconds since 1970. `None` if the wall clock was over a year ahead of the stored
    /// time, so that the elapsed time is unknown: entries with an expiry then count as expired.
    fn time(&self, mono: Duration) -> Option<u64> {
        let known = self.clock.wall_state() != WallState::FarAhead;
        // The base advances with monotonic time only.
        let now = Now {
            mono,
            wall: Duration::ZERO,
        };
        known.then(|| self.clock.base(now).to_unix().as_secs())
    }

    /// The present permissions of a CUCS.
    pub(crate) fn permits(&self, cucs: Id, now: Now) -> Vec<Permit> {
        let time = self.time(now.mono);
        let of_it = self.list.entries().iter().filter(|one| one.cucs == cucs);
        let permit = |one: &AccessEntry| Permit {
            entry: *one,
            over: (one.until).is_some_and(|until| time.is_none_or(|time| time >= until.get())),
        };
        of_it.map(permit).collect()
    }

    /// The version in force.
    pub(crate) fn version(&self) -> u64 {
        self.list.version()
    }

    /// Why the file is not in force.
    pub(crate) fn refused(&self) -> Option<&str> {
        self.refused.as_deref()
    }

    /// Its status.
    pub(crate) fn status(&self, now: Duration) -> AccessStatus {
        AccessStatus {
            version: self.list.version(),
            key_id: self.key.id().to_string(),
            entries: self.list.entries().len(),
            time: self.time(now).map(utc),
            refused: self.refused.clone(),
        }
    }
}

/// The status of the access list.
#[derive(Debug, Clone, serde::Serialize)]
pub struct AccessStatus {
    /// The version of the list in force.
    pub version: u64,
    /// The id of the key that it is signed by.
    pub key_id: String,
    /// The number of its entries.
    pub entries: usize,
    /// The time by which entries expire; `None` if unknown, in which case all entries with an expiry have expired.
    pub time: Option<String>,
    /// Why the file is not in force.
    pub refused: Option<String>,
}

/// Whether a start would have a list: `Some` where it would have that of the store, and why not that of the file.
///
/// # Errors
/// It would have none.
pub(crate) fn examine(
    key: &SigningKey,
    vsm: Id,
    file: Result<Vec<u8>, String>,
    now: Now,
    not_before: Duration,
    disk: &mut dyn Disk,
) -> Result<Option<String>, AccessError> {
    let access = Access::start(key, vsm, file, now, not_before, disk)?;
    Ok(access.refused)
}

fn prepare(
    file: &[u8],
    key: &AccessKey,
    vsm: Id,
    known: Option<(u64, &str)>,
) -> Result<Option<PreparedAccess>, RenewError> {
    let list = AccessList::verified(file, key, vsm)?;
    let found = list.version();
    match known {
        Some((_, text)) if text.as_bytes() == file => return Ok(None),
        Some((in_force, _)) if found < in_force => {
            return Err(RenewError::Older { found, in_force });
        }
        // Two different lists with one version: neither is the newer one.
        Some((in_force, _)) if found == in_force => {
            return Err(RenewError::Another { version: found });
        }
        _ => {}
    }
    // Loses nothing: `verified` accepts only UTF-8.
    let text = String::from_utf8_lossy(file).into_owned();
    Ok(Some(PreparedAccess { list, text }))
}

#[cfg(test)]
mod tests;
