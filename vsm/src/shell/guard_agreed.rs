//! The key files of one guarded CUCS at the VSM, as the exchange writes them: `a0.key`, `a0.key.previous`, and `a0.key.pairing`,
//! which names the guard that it is paired with.
//!
//! The pairing is stored beside the key, so that revoking the key ends the pairing too (`vsm guard revoke`): otherwise a
//! revoked guard could agree on another key. A process holds `a0.key.lock` while it changes any of these files.

use std::io;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use mavlink_link::exchange::{
    Agreed, PinnedPeer, PublicKey, ResponderMemory, ResponderStore, StoreError,
};
use mavlink_link::signing::SigningKey;
use mavlink_link::store::Record as _;

use super::disk::{self, FileSystem, NativeFileSystem};
use super::guard_file;
use super::key_file::KeyFileError;
use crate::key_exchange::ExchangeRecord;

/// The files of one CUCS.
#[derive(Debug, Clone)]
pub struct AgreedFiles {
    path: PathBuf,
    system: Arc<dyn FileSystem>,
    /// A pairing window is open: a guard with the code may replace the previous one.
    pairs: bool,
}

impl AgreedFiles {
    /// The files whose key is at `path`, which need not exist yet.
    #[must_use]
    pub fn new(path: &Path) -> AgreedFiles {
        AgreedFiles::new_on(path, Arc::new(NativeFileSystem))
    }

    /// As [`AgreedFiles::new`], with all writing by `system`.
    #[must_use]
    pub fn new_on(path: &Path, system: Arc<dyn FileSystem>) -> AgreedFiles {
        AgreedFiles {
            path: path.to_owned(),
            system,
            pairs: false,
        }
    }

    /// The file of the key.
    #[must_use]
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Sets whether a pairing window is open.
    pub fn set_pairing(&mut self, pairs: bool) {
        self.pairs = pairs;
    }

    /// The state of these files for the machine. A key file that does not exist yet counts as no key.
    ///
    /// # Errors
    /// One of them is there and cannot be used.
    pub fn memory(&self) -> Result<ResponderMemory, KeyFileError> {
        let record = self.record().map_err(|cause| self.fault(cause))?;
        let peer = record.as_ref().and_then(|record| {
            let (key, counter) = (record.peer()?, record.counter);
            Some(PinnedPeer { key, counter })
        });
        let current = match super::key_file::read(&self.path) {
            Ok(key) => Some(key.id()),
            Err(KeyFileError::Absent { .. }) => None,
            Err(fault) => return Err(fault),
        };
        Ok(ResponderMemory {
            peer,
            epoch: record.map_or(0, |record| record.epoch),
            current,
            next: None,
        })
    }

    /// The guard that it is paired with.
    #[must_use]
    pub fn peer(&self) -> Option<PublicKey> {
        self.record().ok()??.peer()
    }

    fn record(&self) -> io::Result<Option<ExchangeRecord>> {
        let bytes = self.system.read(&guard_file::pairing(&self.path), MOST)?;
        bytes
            .map(|bytes| ExchangeRecord::decode(&bytes).map_err(io::Error::other))
            .transpose()
    }

    fn write(&self, record: &ExchangeRecord) -> Result<(), StoreError> {
        let path = guard_file::pairing(&self.path);
        disk::replace(&*self.system, &path, &record.encode(), true).map_err(reason)
    }

    /// Undoes a change of the pairing whose key could not be stored.
    fn restore(&self, before: Option<ExchangeRecord>, key: &SigningKey) -> Result<(), StoreError> {
        // Only the folder could not be synchronised: the key is in its place, and the pairing belongs to it.
        if super::key_file::read(&self.path).is_ok_and(|there| there.same_as(key)) {
            return Ok(());
        }
        if let Some(record) = before {
            return self.write(&record);
        }
        let path = guard_file::pairing(&self.path);
        let removed = self.system.remove(&path);
        let synced = removed.and_then(|()| self.system.sync(disk::folder_of(&path)));
        synced.map_err(reason)
    }

    fn fault(&self, cause: io::Error) -> KeyFileError {
        let path = guard_file::pairing(&self.path);
        KeyFileError::Io { path, cause }
    }
}

impl ResponderStore for AgreedFiles {
    fn withdraw_next(&mut self) -> Result<(), StoreError> {
        // A key takes effect here as soon as it is stored, so there is never one to withdraw.
        Ok(())
    }

    fn store_agreed(&mut self, peer: &PinnedPeer, agreed: &Agreed) -> Result<(), StoreError> {
        let _held = guard_file::hold(&self.path).map_err(reason)?;
        let known = self.record().map_err(reason)?;
        let same = |one: &ExchangeRecord| one.peer == Some(*peer.key.bytes());
        // A person has revoked it since, so what this process knows of the guard is out of date.
        if !self.pairs && !known.as_ref().is_some_and(same) {
            return Err(reason("the pairing was ended"));
        }
        let epoch = known.as_ref().map_or(0, |record| record.epoch);
        // The record goes first: a power cut in between skips an epoch, and never uses one twice.
        self.write(&ExchangeRecord {
            peer: Some(*peer.key.bytes()),
            counter: peer.counter,
            epoch: epoch.max(agreed.epoch),
            ..ExchangeRecord::default()
        })?;
        let put = guard_file::put_in_force(&*self.system, &self.path, &agreed.key);
        put.map_err(|cause| match self.restore(known, &agreed.key) {
            Ok(()) => reason(cause),
            Err(other) => reason(format!("{cause}; the pairing is changed: {other}")),
        })
    }
}

fn reason(fault: impl std::fmt::Display) -> StoreError {
    StoreError {
        reason: fault.to_string(),
    }
}

/// The record is a few hundred bytes.
const MOST: u64 = 4_096;

#[cfg(test)]
mod tests {
    use super::*;
    use crate::shell::key_file;

    fn agreed(n: u8) -> (PinnedPeer, Agreed) {
        let key = PublicKey::new([n; 32]);
        let agreed = Agreed {
            key: SigningKey::new([n; 32]).unwrap(),
            confidential: None,
            epoch: n.into(),
            peer: key,
        };
        let counter = n.into();
        (PinnedPeer { key, counter }, agreed)
    }

    #[test]
    fn a_key_that_cannot_be_stored_leaves_the_earlier_pairing() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a0.key");
        let mut files = AgreedFiles::new(&path);
        files.set_pairing(true);

        // A folder in the key's place: the record can be written, and the key cannot.
        let (peer, first) = agreed(1);
        std::fs::create_dir(&path).unwrap();
        files.store_agreed(&peer, &first).unwrap_err();
        std::fs::remove_dir(&path).unwrap();
        assert_eq!(files.memory().unwrap(), ResponderMemory::default());

        files.store_agreed(&peer, &first).unwrap();
        let before = files.memory().unwrap();
        assert_eq!(before.peer, Some(peer));
        let (other, second) = agreed(2);
        let previous = folder.path().join("a0.key.previous");
        std::fs::create_dir(&previous).unwrap();
        files.store_agreed(&other, &second).unwrap_err();
        assert_eq!(files.memory().unwrap(), before);
        std::fs::remove_dir(&previous).unwrap();
        files.store_agreed(&other, &second).unwrap();
        assert_eq!(files.peer(), Some(other.key));
        assert!(key_file::read(&path).unwrap().same_as(&second.key));
    }
}
