//! The files of a store in etcd: each has a head with its length, and pieces of equal size. Every change compares the owner
//! of the VSM, so that a node that lost it changes nothing, and the change before, so that each is applied once and in
//! order.

use std::collections::BTreeMap;
use std::io;
use std::ops::ControlFlow;
use std::sync::atomic::{AtomicU32, AtomicU64, Ordering};
use std::sync::{Mutex, PoisonError};
use std::time::{Duration, Instant};

use serde::{Deserialize, Serialize};
use tokio::sync::watch;
use zeroize::Zeroizing;

use super::etcd::{Change, Condition, Entry, Etcd};
use super::seal::Seal;

/// What one node may do with the files in etcd.
#[derive(Debug)]
pub(super) struct Remote {
    pub(super) etcd: Etcd,
    pub(super) names: Names,
    seal: Seal,
    right: Mutex<Right>,
    /// When the right ends, for whoever serves.
    until: watch::Sender<Option<Instant>>,
    /// The number of the last change of each lane that etcd has answered. One that has a lower one later was set back.
    made: [AtomicU64; LANES],
    /// The next generation number: no two attempts to store a file have the same one.
    generation: AtomicU32,
}

/// The last change of a lane: the next one is applied once, behind it. The condition of a request that the network delayed
/// for long no longer holds.
#[derive(Debug, Default)]
pub(super) struct Last(Option<Vec<u8>>);

/// The keys of a VSM in etcd.
#[derive(Debug, Clone)]
pub(super) struct Names {
    prefix: String,
}

/// The proof that this node owns the VSM.
#[derive(Debug, Clone, Copy)]
pub(super) struct Right {
    /// The revision that made it the owner: no later owner has the same.
    pub(super) created: i64,
    /// Its lease lasts longer than until then, whatever this node has received: [`Right::until`].
    pub(super) until: Instant,
}

/// The description of a file in etcd.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
pub(super) struct Head {
    /// The number of its pieces. A replaced file gets new pieces, and keeps the old content until its head changes.
    pub(super) generation: u32,
    /// Its length, bytes.
    pub(super) length: u64,
    /// etcd's revision that stored it, where it was read from there.
    #[serde(skip)]
    pub(super) changed: i64,
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

    /// The node whose folder is the first to be stored.
    pub(super) fn first(&self) -> String {
        format!("{}first", self.prefix)
    }

    /// Exists once the files of the first node were stored whole. Sealed, so that a node with another key fails before it
    /// owns anything.
    pub(super) fn complete(&self) -> String {
        format!("{}complete", self.prefix)
    }

    /// The present nodes, with their leases.
    pub(super) fn node(&self, node: &str) -> String {
        format!("{}node/{node}", self.prefix)
    }

    /// The drained nodes.
    pub(super) fn drained(&self, node: &str) -> String {
        format!("{}drained/{node}", self.prefix)
    }

    fn heads(&self) -> String {
        format!("{}head/", self.prefix)
    }

    fn head(&self, file: &str) -> String {
        format!("{}head/{file}", self.prefix)
    }

    fn every_piece(&self) -> String {
        format!("{}piece/", self.prefix)
    }

    fn each_last(&self) -> String {
        format!("{}last/", self.prefix)
    }

    /// What identifies the last change of a lane.
    fn last(&self, lane: usize) -> String {
        format!("{}{lane}", self.each_last())
    }

    fn all_pieces(&self, file: &str) -> String {
        format!("{}piece/{file}/", self.prefix)
    }

    fn pieces(&self, file: &str, generation: u32) -> String {
        format!("{}piece/{file}/{generation:08x}/", self.prefix)
    }

    fn piece(&self, file: &str, generation: u32, index: u64) -> String {
        format!("{}{index:08x}", self.pieces(file, generation))
    }
}

impl Right {
    /// When the right ends by this node's clock, for a lease of this time that was requested or renewed at `sent`. etcd counts
    /// the time from somewhere between the request and its answer, by a clock that may be faster. So a part is left out: far
    /// more than two clocks that are corrected while they run differ by (0.1 %), and enough for what is on its way to a socket.
    pub(super) fn until(sent: Instant, ttl: Duration) -> Instant {
        sent + ttl - ttl / 20
    }
}

impl Remote {
    /// `made`: how many changes this node knows that there are.
    pub(super) fn new(
        etcd: Etcd,
        names: Names,
        seal: Seal,
        right: Right,
        made: [u64; LANES],
    ) -> Remote {
        Remote {
            etcd,
            names,
            seal,
            right: Mutex::new(right),
            until: watch::Sender::new(Some(right.until)),
            made: made.map(AtomicU64::new),
            generation: AtomicU32::new(1),
        }
    }

    pub(super) fn right(&self) -> Right {
        *self.right.lock().unwrap_or_else(PoisonError::into_inner)
    }

    pub(super) fn set_right(&self, right: Right) {
        let mut held = self.right.lock().unwrap_or_else(PoisonError::into_inner);
        *held = right;
        self.until.send_replace(Some(right.until));
    }

    /// How many changes of each lane etcd has answered, or had when this node began.
    pub(super) fn made(&self) -> [u64; LANES] {
        self.made.each_ref().map(|made| made.load(Ordering::SeqCst))
    }

    /// How many changes of each lane etcd has.
    pub(super) fn stored(&self) -> io::Result<[u64; LANES]> {
        count_changes(&self.etcd, &self.names, &self.seal)
    }

    pub(super) fn until(&self) -> watch::Receiver<Option<Instant>> {
        self.until.subscribe()
    }

    /// Applies all changes, or none.
    fn change(&self, lane: usize, last: &mut Last, mut changes: Vec<Change>) -> io::Result<()> {
        let (owner, key) = (self.names.owner(), self.names.last(lane));
        let of_files = changes.len();
        for _ in 0..TRIES {
            // Read again for each attempt: the keeper may have renewed the lease meanwhile.
            let right = self.right();
            if Instant::now() >= right.until {
                return Err(io::Error::other(
                    "the lease of this node has ended, and etcd has not renewed it: nothing can be stored, and no command taken, until it does",
                ));
            }
            let before = match last.0.take() {
                Some(before) => before,
                // Unknown: this process has changed nothing yet, or an answer was lost.
                None => self
                    .etcd
                    .get(&key)?
                    .map_or_else(Vec::new, |entry| entry.value),
            };
            let number = self.seal.number_of(&key, &before);
            let made = &self.made[lane];
            if number < made.load(Ordering::SeqCst) {
                // What is on this computer belongs on top of what is not there any more.
                return Err(io::Error::other(SET_BACK));
            }
            let number = number.saturating_add(1);
            let token = self.seal.token(&key, number)?;
            changes.truncate(of_files);
            changes.push(Change::Put(key.clone(), token.clone(), None));
            let behind = match before.is_empty() {
                true => Condition::CreatedAt(&key, 0),
                false => Condition::Holds(&key, &before),
            };
            let owned = Condition::CreatedAt(&owner, right.created);
            let applied = self.etcd.transact(&[owned, behind], &changes)?.is_some();
            // Or it was applied, and only its repetition was not.
            let is_there = |entry: Entry| entry.value == token;
            if applied || self.etcd.get(&key)?.is_some_and(is_there) {
                made.fetch_max(number, Ordering::SeqCst);
                last.0 = Some(token);
                return Ok(());
            }
            let owner = self.etcd.get(&owner)?;
            if owner.is_none_or(|entry| entry.created != right.created) {
                return Err(io::Error::other("this node no longer owns the VSM"));
            }
            // An earlier request arrived late: the next attempt goes behind it.
        }
        Err(io::Error::other("earlier requests are still arriving"))
    }

    /// Stores a file whole; etcd keeps the old content until the last step.
    pub(super) fn replace(
        &self,
        (lane, last): (usize, &mut Last),
        file: &str,
        bytes: &[u8],
    ) -> io::Result<Head> {
        let head = Head {
            generation: self.generation.fetch_add(1, Ordering::Relaxed),
            length: bytes.len() as u64,
            ..Head::default()
        };
        let mut changes = Vec::new();
        for (index, piece) in (0..).zip(bytes.chunks(PIECE)) {
            changes.push(self.put_piece(file, head.generation, index, piece)?);
            // The pieces are invisible until the head names their generation, so they may be stored in several requests.
            if changes.len() == MAX_CHANGES {
                self.change(lane, last, std::mem::take(&mut changes))?;
            }
        }
        changes.push(self.put_head(file, head)?);
        // Deletes the earlier pieces, and those of attempts that did not finish.
        let older = self.names.pieces(file, head.generation).into_bytes();
        changes.push(Change::RemoveRange(self.names.all_pieces(file), older));
        self.change(lane, last, changes)?;
        Ok(head)
    }

    /// Stores the new end of a file. `read`: its bytes from this offset to `length`.
    pub(super) fn append(
        &self,
        (lane, last): (usize, &mut Last),
        file: &str,
        (before, length): (Head, u64),
        read: impl FnOnce(u64) -> io::Result<Zeroizing<Vec<u8>>>,
    ) -> io::Result<Head> {
        // The last piece was perhaps not full: it is stored again.
        let first = before.length / PIECE as u64;
        let bytes = read(first * PIECE as u64)?;
        let mut changes = Vec::new();
        let mut head = before;
        for (index, piece) in (first..).zip(bytes.chunks(PIECE)) {
            changes.push(self.put_piece(file, head.generation, index, piece)?);
            head.length = (index * PIECE as u64 + piece.len() as u64).min(length);
            if changes.len() == MAX_CHANGES {
                // A head with each request: the pieces so far count even if the next request fails.
                changes.push(self.put_head(file, head)?);
                self.change(lane, last, std::mem::take(&mut changes))?;
            }
        }
        if !changes.is_empty() {
            changes.push(self.put_head(file, head)?);
            self.change(lane, last, changes)?;
        }
        Ok(head)
    }

    pub(super) fn remove(&self, (lane, last): (usize, &mut Last), file: &str) -> io::Result<()> {
        let changes = vec![
            Change::Remove(self.names.head(file)),
            Change::remove_all(self.names.all_pieces(file)),
        ];
        self.change(lane, last, changes)
    }

    /// Removes all files: an earlier attempt of the first owner may have stored a part, which is useless.
    pub(super) fn remove_all(&self, lane: usize, last: &mut Last) -> io::Result<()> {
        let changes = vec![
            Change::remove_all(self.names.heads()),
            Change::remove_all(self.names.every_piece()),
        ];
        self.change(lane, last, changes)
    }

    /// Notes that the store of the first owner is whole.
    pub(super) fn complete(&self, lane: usize, last: &mut Last) -> io::Result<()> {
        let key = self.names.complete();
        let sealed = self.seal.seal(&key, b"complete")?;
        self.change(lane, last, vec![Change::Put(key, sealed, None)])
    }

    /// The heads of all files.
    pub(super) fn heads(&self) -> io::Result<BTreeMap<String, Head>> {
        let prefix = self.names.heads();
        let mut heads = BTreeMap::new();
        self.each(&prefix, |entry| {
            let plain = self.seal.open(&entry.key, &entry.value)?;
            let mut head: Head = serde_json::from_slice(&plain).map_err(io::Error::other)?;
            head.changed = entry.changed;
            let file = entry.key[prefix.len()..].to_owned();
            // Above every stored generation, so that no piece of an earlier owner is overwritten.
            self.generation
                .fetch_max(head.generation + 1, Ordering::Relaxed);
            heads.insert(file, head);
            Ok(ControlFlow::Continue(()))
        })?;
        Ok(heads)
    }

    /// A file, or its first `most` bytes.
    pub(super) fn read(&self, file: &str, head: Head, most: u64) -> io::Result<Zeroizing<Vec<u8>>> {
        let length = usize::try_from(head.length.min(most)).unwrap_or(usize::MAX);
        let mut bytes = Zeroizing::new(Vec::with_capacity(length.saturating_add(PIECE)));
        self.each(&self.names.pieces(file, head.generation), |entry| {
            // Surplus pieces come from an attempt that ended before its head was stored.
            let due = self
                .names
                .piece(file, head.generation, bytes.len() as u64 / PIECE as u64);
            if bytes.len() < length && entry.key == due {
                bytes.extend_from_slice(&self.seal.open(&entry.key, &entry.value)?);
            }
            Ok(if bytes.len() < length {
                ControlFlow::Continue(())
            } else {
                ControlFlow::Break(())
            })
        })?;
        if bytes.len() < length {
            let fault = format!("{file} in etcd has {} of {length} bytes", bytes.len());
            return Err(io::Error::new(io::ErrorKind::InvalidData, fault));
        }
        bytes.truncate(length);
        Ok(bytes)
    }

    /// Calls `then` for each key that begins with `prefix`, in pages of one state, until it has enough.
    fn each(
        &self,
        prefix: &str,
        mut then: impl FnMut(&Entry) -> io::Result<ControlFlow<()>>,
    ) -> io::Result<()> {
        let (mut from, mut revision) = (prefix.to_owned(), 0);
        loop {
            let page = self.etcd.list(prefix, &from, MAX_ENTRIES, revision)?;
            revision = page.revision;
            for entry in page.entries {
                // The smallest key after this one.
                from = format!("{}\0", entry.key);
                if then(&entry)?.is_break() {
                    return Ok(());
                }
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

/// How many changes of each lane etcd has; 0 where the last one was made without the key.
pub(super) fn count_changes(etcd: &Etcd, names: &Names, seal: &Seal) -> io::Result<[u64; LANES]> {
    let prefix = names.each_last();
    let there = etcd.list(&prefix, &prefix, MAX_ENTRIES, 0)?.entries;
    let mut changes = [0; LANES];
    for (lane, number) in changes.iter_mut().enumerate() {
        let key = names.last(lane);
        let last = there.iter().find(|entry| entry.key == key);
        *number = last.map_or(0, |entry| seal.number_of(&key, &entry.value));
    }
    Ok(changes)
}

/// Whether one lane has fewer changes than were seen.
pub(super) fn lacks(changes: [u64; LANES], seen: [u64; LANES]) -> bool {
    changes.iter().zip(seen).any(|(there, seen)| *there < seen)
}

/// What links live by, and everything else (`files`).
pub(super) const LANES: usize = 2;
const SET_BACK: &str =
    "etcd was set back, as from a backup: it lacks changes that it has answered to this node";
/// Bytes of a piece: a log that grows by a line has its last piece stored again.
const PIECE: usize = 4_096;
/// How often a change is tried behind late requests.
const TRIES: usize = 4;
/// A request of about 90 kB: on a link of 2 Mbit/s it is answered in time. (etcd accepts 128 changes, and 1.5 MB.)
const MAX_CHANGES: usize = 16;
/// For an answer of about 130 kB.
const MAX_ENTRIES: u32 = 24;
