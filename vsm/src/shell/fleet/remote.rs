//! The files of a store in etcd: each is a head, which says how long it is, and pieces of equal size. Every change compares the
//! owner of the VSM: a node that has lost it changes nothing.

use std::collections::BTreeMap;
use std::io;
use std::sync::{Mutex, PoisonError};
use std::time::Instant;

use serde::{Deserialize, Serialize};
use zeroize::Zeroizing;

use super::etcd::{Change, Condition, Etcd};
use super::seal::Seal;

/// What one node may do with the files in etcd.
#[derive(Debug)]
pub(super) struct Remote {
    pub(super) etcd: Etcd,
    pub(super) names: Names,
    seal: Seal,
    right: Mutex<Right>,
}

/// The keys of a VSM in etcd.
#[derive(Debug, Clone)]
pub(super) struct Names {
    prefix: String,
}

/// That this node owns the VSM.
#[derive(Debug, Clone, Copy)]
pub(super) struct Right {
    /// The revision that made it the owner: no later owner has the same.
    pub(super) created: i64,
    /// Until then its lease has not ended, whatever this node has heard.
    pub(super) until: Instant,
}

/// What is known of a file in etcd.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub(super) struct Head {
    /// Its pieces are those with this number: a file that is replaced gets others, and is the old one until its head changes.
    pub(super) generation: u32,
    /// Its length, bytes.
    pub(super) length: u64,
}

impl Names {
    pub(super) fn new(vsm: stanag_msgs::Id) -> Names {
        Names {
            prefix: format!("vsm/{:08x}/", vsm.0),
        }
    }

    /// The node that serves, with its lease.
    pub(super) fn owner(&self) -> String {
        format!("{}owner", self.prefix)
    }

    /// How often the VSM has changed its owner.
    pub(super) fn epoch(&self) -> String {
        format!("{}epoch", self.prefix)
    }

    /// There since the files of the first owner were stored whole.
    pub(super) fn complete(&self) -> String {
        format!("{}complete", self.prefix)
    }

    /// Who is there, with his lease.
    pub(super) fn node(&self, node: &str) -> String {
        format!("{}node/{node}", self.prefix)
    }

    /// Who is not to serve.
    pub(super) fn drained(&self, node: &str) -> String {
        format!("{}drained/{node}", self.prefix)
    }

    fn heads(&self) -> String {
        format!("{}head/", self.prefix)
    }

    fn head(&self, file: &str) -> String {
        format!("{}head/{file}", self.prefix)
    }

    fn pieces(&self, file: &str, generation: u32) -> String {
        format!("{}piece/{file}/{generation:08x}/", self.prefix)
    }

    fn piece(&self, file: &str, generation: u32, index: u64) -> String {
        format!("{}{index:08x}", self.pieces(file, generation))
    }
}

impl Remote {
    pub(super) fn new(etcd: Etcd, names: Names, seal: Seal, right: Right) -> Remote {
        Remote {
            etcd,
            names,
            seal,
            right: Mutex::new(right),
        }
    }

    pub(super) fn right(&self) -> Right {
        *self.right.lock().unwrap_or_else(PoisonError::into_inner)
    }

    pub(super) fn set_right(&self, right: Right) {
        *self.right.lock().unwrap_or_else(PoisonError::into_inner) = right;
    }

    /// Changes what is stored, all of it or nothing.
    fn change(&self, changes: &[Change]) -> io::Result<()> {
        let right = self.right();
        if Instant::now() >= right.until {
            return Err(io::Error::other(
                "the lease of this node has ended, and etcd has not renewed it: nothing can be stored, and no command taken, until it does",
            ));
        }
        let owner = self.names.owner();
        let condition = Condition::CreatedAt(&owner, right.created);
        match self.etcd.transact(&[condition], changes)? {
            Some(_) => Ok(()),
            None => Err(io::Error::other("another node owns this VSM by now")),
        }
    }

    /// Stores a file whole: until the last step it is in etcd what it was.
    pub(super) fn replace(
        &self,
        file: &str,
        before: Option<Head>,
        bytes: &[u8],
    ) -> io::Result<Head> {
        let head = Head {
            generation: before.map_or(1, |head| head.generation.wrapping_add(1)),
            length: bytes.len() as u64,
        };
        let mut changes = Vec::new();
        for (index, piece) in (0..).zip(bytes.chunks(PIECE)) {
            changes.push(self.put_piece(file, head.generation, index, piece)?);
            if changes.len() == MAX_CHANGES {
                self.change(&std::mem::take(&mut changes))?;
            }
        }
        changes.push(self.put_head(file, head)?);
        if let Some(before) = before {
            changes.push(Change::RemoveAll(
                self.names.pieces(file, before.generation),
            ));
        }
        self.change(&changes)?;
        Ok(head)
    }

    /// Stores what a file has grown by. `read`: its bytes from this offset to `length`.
    pub(super) fn append(
        &self,
        file: &str,
        before: Head,
        length: u64,
        read: impl FnOnce(u64) -> io::Result<Zeroizing<Vec<u8>>>,
    ) -> io::Result<Head> {
        let first = before.length / PIECE as u64;
        let bytes = read(first * PIECE as u64)?;
        let mut changes = Vec::new();
        let mut head = before;
        for (index, piece) in (first..).zip(bytes.chunks(PIECE)) {
            changes.push(self.put_piece(file, head.generation, index, piece)?);
            head.length = (index * PIECE as u64 + piece.len() as u64).min(length);
            if changes.len() == MAX_CHANGES {
                changes.push(self.put_head(file, head)?);
                self.change(&std::mem::take(&mut changes))?;
            }
        }
        if !changes.is_empty() {
            changes.push(self.put_head(file, head)?);
            self.change(&changes)?;
        }
        Ok(head)
    }

    pub(super) fn remove(&self, file: &str, head: Head) -> io::Result<()> {
        self.change(&[
            Change::Remove(self.names.head(file)),
            Change::RemoveAll(self.names.pieces(file, head.generation)),
        ])
    }

    /// Notes that the store of the first owner is whole.
    pub(super) fn complete(&self) -> io::Result<()> {
        self.change(&[Change::Put(self.names.complete(), b"1".to_vec(), None)])
    }

    /// The heads of all files.
    pub(super) fn heads(&self) -> io::Result<BTreeMap<String, Head>> {
        let prefix = self.names.heads();
        let mut heads = BTreeMap::new();
        self.each(&prefix, |key, sealed| {
            let plain = self.seal.open(key, &sealed)?;
            let head = serde_json::from_slice(&plain).map_err(io::Error::other)?;
            heads.insert(key[prefix.len()..].to_owned(), head);
            Ok(())
        })?;
        Ok(heads)
    }

    /// A file whole.
    pub(super) fn read(&self, file: &str, head: Head) -> io::Result<Zeroizing<Vec<u8>>> {
        let mut bytes = Zeroizing::new(Vec::with_capacity(
            usize::try_from(head.length).unwrap_or(0),
        ));
        self.each(&self.names.pieces(file, head.generation), |key, sealed| {
            // A piece too many is of an attempt that ended before its head was stored.
            let due = self
                .names
                .piece(file, head.generation, bytes.len() as u64 / PIECE as u64);
            if (bytes.len() as u64) < head.length && key == due {
                bytes.extend_from_slice(&self.seal.open(key, &sealed)?);
            }
            Ok(())
        })?;
        let length = usize::try_from(head.length).unwrap_or(usize::MAX);
        if bytes.len() < length {
            let fault = format!("{file} in etcd has {} of {length} bytes", bytes.len());
            return Err(io::Error::new(io::ErrorKind::InvalidData, fault));
        }
        bytes.truncate(length);
        Ok(bytes)
    }

    /// Each key that begins with `prefix`, of one state, in pages.
    fn each(
        &self,
        prefix: &str,
        mut then: impl FnMut(&str, Vec<u8>) -> io::Result<()>,
    ) -> io::Result<()> {
        let (mut from, mut revision) = (prefix.to_owned(), 0);
        loop {
            let page = self.etcd.list(prefix, &from, MAX_ENTRIES, revision)?;
            revision = page.revision;
            for entry in page.entries {
                // The first key behind this one.
                from = format!("{}\0", entry.key);
                then(&entry.key, entry.value)?;
            }
            if !page.more {
                return Ok(());
            }
        }
    }

    fn put_piece(
        &self,
        file: &str,
        generation: u32,
        index: u64,
        piece: &[u8],
    ) -> io::Result<Change> {
        let key = self.names.piece(file, generation, index);
        let sealed = self.seal.seal(&key, piece)?;
        Ok(Change::Put(key, sealed, None))
    }

    fn put_head(&self, file: &str, head: Head) -> io::Result<Change> {
        let key = self.names.head(file);
        let plain = serde_json::to_vec(&head).map_err(io::Error::other)?;
        let sealed = self.seal.seal(&key, &plain)?;
        Ok(Change::Put(key, sealed, None))
    }
}

/// A log that grows by a line has its last piece stored again.
const PIECE: usize = 4_096;
/// etcd takes 128 changes in a transaction, and 1.5 MB, unless it is configured otherwise.
const MAX_CHANGES: usize = 100;
/// Some 1 MB a page.
const MAX_ENTRIES: u32 = 256;
