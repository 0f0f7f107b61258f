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

    fn store_peer(&mut self, peer: &PinnedPeer) -> Result<(), StoreError> {
        let _held = guard_file::hold(&self.path).map_err(reason)?;
        let known = self.record().map_err(reason)?;
        let same = |one: &ExchangeRecord| one.peer == Some(*peer.key.bytes());
        // A person has revoked it since, so what this process knows of the guard is out of date.
        if !self.pairs && !known.as_ref().is_some_and(same) {
            return Err(reason("the pairing was ended"));
        }
        self.write(&ExchangeRecord {
            peer: Some(*peer.key.bytes()),
            counter: peer.counter,
            epoch: known.map_or(0, |record| record.epoch),
            ..ExchangeRecord::default()
        })
    }

    fn store_next(&mut self, agreed: &Agreed) -> Result<(), StoreError> {
        let _held = guard_file::hold(&self.path).map_err(reason)?;
        let Some(mut record) = self.record().map_err(reason)? else {
            return Err(reason("the pairing was ended"));
        };
        // The epoch goes first: a power cut in between skips one, and never uses one twice.
        record.epoch = record.epoch.max(agreed.epoch);
        self.write(&record)?;
        guard_file::put_in_force(&*self.system, &self.path, &agreed.key).map_err(reason)
    }
}

fn reason(fault: impl std::fmt::Display) -> StoreError {
    StoreError {
        reason: fault.to_string(),
    }
}

/// The record is a few hundred bytes.
const MOST: u64 = 4_096;
