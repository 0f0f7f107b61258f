//! One node: it stands by, takes over, and keeps its lease.

use std::collections::{BTreeMap, VecDeque};
use std::io;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Condvar, Mutex, PoisonError};
use std::thread::JoinHandle;
use std::time::{Duration, Instant, SystemTime};

use mavlink_link::signing::SigningKey;
use serde::{Deserialize, Serialize};
use stanag_msgs::Id;
use tokio::sync::{mpsc, watch};

use super::etcd::{Change, Condition, Entry, Etcd};
use super::files::{MAX_TAKEN_OVER, SharedFiles, is_stored, max_bytes};
use super::remote::{Head, LANES, Names, Remote, Right, count_changes, lacks};
use super::seal::Seal;
use crate::config::SharedStore;
use crate::shell::clock::since_boot;
use crate::shell::disk::{self, FLEET_EPOCH, FileDisk, FileSystem as _, NativeFileSystem};

/// The node cannot take part.
#[derive(Debug, thiserror::Error)]
pub enum FleetError {
    /// Another program already stands by or serves under its name.
    #[error(
        "store.node: a node {node:?} takes part already: each computer needs a name of its own (after a crash its name is free again in {lease_s} s)"
    )]
    Name {
        /// The name.
        node: String,
        /// The time of a lease, s.
        lease_s: u64,
    },
    /// What etcd has is older than what this node served from.
    #[error("etcd is at epoch {epoch}, revision {revision}, change {changes}, and {folder} has seen epoch {seen_epoch}, revision {seen_revision}, change {seen_changes}: etcd was set back, as from a backup, or is another one. Stamps would be used twice. Bring etcd to where it was; or, to continue from this folder, stop all nodes, delete the keys that begin with vsm/ and the id of the VSM, remove the file fleet-epoch from this folder, and start this node first", folder = folder.display())]
    SetBack {
        /// The folder of the store.
        folder: PathBuf,
        /// What etcd has.
        epoch: u64,
        /// Its revision.
        revision: i64,
        /// What this node has seen.
        seen_epoch: u64,
        /// And of which revision.
        seen_revision: i64,
        /// How many changes of the files etcd has.
        changes: u64,
        /// And how many this node has seen.
        seen_changes: u64,
    },
    /// The folder holds the state of a VSM that is not of this fleet.
    #[error("[store] dir {folder} holds state that was not made in this fleet, which another node began: it would be deleted. Name an empty folder, or move these files away", folder = folder.display())]
    Foreign {
        /// The folder.
        folder: PathBuf,
    },
    /// The system, or etcd.
    #[error("the store in etcd: {0}")]
    Io(#[from] io::Error),
}

/// Tells a node that stands by to stop.
#[derive(Debug, Clone, Default)]
pub struct Stop(Arc<(Mutex<bool>, Condvar)>);

impl Stop {
    /// Requests the stop.
    pub fn set(&self) {
        *self.0.0.lock().unwrap_or_else(PoisonError::into_inner) = true;
        self.0.1.notify_all();
    }

    /// Waits this long, or until the stop; returns whether it was requested.
    fn wait(&self, time: Duration) -> bool {
        let stopped = self.0.0.lock().unwrap_or_else(PoisonError::into_inner);
        let waited = self
            .0
            .1
            .wait_timeout_while(stopped, time, |stopped| !*stopped);
        *waited.unwrap_or_else(PoisonError::into_inner).0
    }
}

/// The value of the owner's key, and of each node's.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub(super) struct Present {
    pub(super) node: String,
    /// Its lease, which nobody else has.
    pub(super) lease: i64,
    /// Start time, s since 1970 by that node's clock.
    pub(super) since: u64,
    /// The epoch of an owner.
    #[serde(default)]
    pub(super) epoch: u64,
}

/// A VSM that this node owns.
#[derive(Debug)]
pub struct Held {
    /// How often the VSM has changed its owner.
    pub epoch: u64,
    ended: Option<mpsc::Receiver<String>>,
    lease: watch::Receiver<Option<Instant>>,
    /// Ends the lease when dropped, so that the next node need not wait until it expires.
    _keeper: Keeper,
}

/// Whether a node may stand by with what is in its folder, as [`stand_by`] finds it.
///
/// # Errors
/// [`FleetError::Foreign`], or it is not known: etcd does not answer, or the folder cannot be read.
pub(in crate::shell) fn check_state(
    store: &SharedStore,
    vsm: Id,
    disk: &FileDisk,
) -> Result<(), FleetError> {
    if Mark::read(disk.folder())? != Mark::default() || !has_files(disk)? {
        return Ok(());
    }
    let etcd = Etcd::new(&store.endpoints, CHECKED_WITHIN);
    match etcd.get(&Names::new(vsm).complete())? {
        Some(_) => Err(FleetError::Foreign {
            folder: disk.folder().to_owned(),
        }),
        None => Ok(()),
    }
}

/// A person waits for the answer.
const CHECKED_WITHIN: Duration = Duration::from_secs(3);

/// Whether a folder has files that etcd would have.
fn has_files(disk: &FileDisk) -> io::Result<bool> {
    let names = disk.names().map_err(io::Error::other)?;
    Ok(names.iter().any(|name| is_stored(name)))
}

/// Keeps the lease, on a thread of its own.
#[derive(Debug)]
struct Keeper {
    stop: Stop,
    thread: Option<JoinHandle<()>>,
}

impl Held {
    /// When the lease ends by this node's clock, which each renewal moves: the node may serve until then. The next one owns the
    /// VSM later.
    #[must_use]
    pub fn lease(&self) -> watch::Receiver<Option<Instant>> {
        self.lease.clone()
    }

    /// Receives the reason, once, when this node must stop serving.
    #[must_use]
    pub fn ended(&mut self) -> mpsc::Receiver<String> {
        let none = || mpsc::channel(1).1;
        self.ended.take().unwrap_or_else(none)
    }
}

/// Waits until this node owns the VSM, and brings `disk` to etcd's state. Returns the store to serve from, and the
/// ownership, which ends when it is dropped; `None` if stopped before.
///
/// `report` receives what a person should know meanwhile.
///
/// # Errors
/// The name is taken, etcd was restored to an earlier state, or the folder cannot be written. An etcd that does not answer
/// is waited for.
pub fn stand_by(
    (store, vsm): (&SharedStore, Id),
    key: &SigningKey,
    disk: FileDisk,
    stop: &Stop,
    report: &mut dyn FnMut(&str),
) -> Result<Option<(FileDisk, Held)>, FleetError> {
    let ttl = Duration::from_secs(store.lease_s);
    // A member that does not answer must leave time to ask another.
    let etcd = Etcd::new(&store.endpoints, ttl / 4);
    let mut node = Node {
        names: Names::new(vsm),
        name: store.node.clone(),
        ttl_s: store.lease_s,
        lease: None,
        said: String::new(),
        begun: Instant::now(),
        mark: Mark::read(disk.folder())?,
        marked: Instant::now(),
        changes: [0; LANES],
        has_files: has_files(&disk)?,
        folder: disk.folder().to_owned(),
        seal: Seal::new(key),
        looks: Looks::default(),
    };
    let (etcd, right, epoch) = loop {
        let (tried, began) = (Instant::now(), since_boot());
        let turn = node.try_once(&etcd);
        if let Ok(Turn::Wait(_)) = turn {
            node.looks.note(began, etcd.revision());
        }
        match turn {
            Ok(Turn::Owner(created, sent, epoch)) => {
                let right = Right {
                    created,
                    until: Right::until(sent, ttl),
                };
                break (etcd, right, epoch);
            }
            Ok(Turn::Wait(line)) | Err(Fault::Wait(line)) => node.say(line, report),
            Err(Fault::Fatal(fault)) => return Err(fault),
            Err(Fault::Etcd(cause)) => node.say(format!("etcd does not answer: {cause}"), report),
        }
        if stop.wait((tried + LOOK_AGAIN).saturating_duration_since(Instant::now())) {
            node.leave(&etcd);
            return Ok(None);
        }
    };
    // Written before any change: from here on the folder belongs to the fleet.
    node.mark.epoch = epoch;
    node.mark.revision = etcd.revision();
    node.mark.changes = node.changes;
    node.mark.write(&node.folder)?;
    let looks = std::mem::take(&mut node.looks);
    let made = node.mark.changes;
    let (names, seal) = (node.names.clone(), Seal::new(key));
    let remote = Arc::new(Remote::new(etcd, names, seal, right, made));
    let (ends, ended) = mpsc::channel(1);
    let keep = Keep {
        node,
        ttl,
        remote: remote.clone(),
        epoch,
        ends,
    };
    // Started before the restore, which may take longer than a lease.
    let keeper_stop = Stop::default();
    let of_thread = keeper_stop.clone();
    let thread = std::thread::Builder::new()
        .name("lease".to_owned())
        .spawn(move || keep.run(&of_thread))?;
    let keeper = Keeper {
        stop: keeper_stop,
        thread: Some(thread),
    };
    let Some(disk) = restore_until(&disk, &remote, &looks, stop, report)? else {
        return Ok(None);
    };
    let held = Held {
        epoch,
        ended: Some(ended),
        lease: remote.until(),
        _keeper: keeper,
    };
    Ok(Some((disk, held)))
}

impl Drop for Keeper {
    fn drop(&mut self) {
        self.stop.set();
        let _ = self.thread.take().map(JoinHandle::join);
    }
}

/// Brings the folder to etcd's state, with retries while this node owns the VSM; `None` if stopped before.
fn restore_until(
    disk: &FileDisk,
    remote: &Arc<Remote>,
    looks: &Looks,
    stop: &Stop,
    report: &mut dyn FnMut(&str),
) -> Result<Option<FileDisk>, FleetError> {
    loop {
        match restore(disk, remote, looks, stop) {
            Err(FleetError::Io(cause))
                if cause.kind() == io::ErrorKind::Other
                    && Instant::now() < remote.right().until =>
            {
                report(&format!(
                    "the store in etcd cannot be read or written yet: {cause}"
                ));
            }
            restored => return restored,
        }
        if stop.wait(LOOK_AGAIN) {
            return Ok(None);
        }
    }
}

/// Brings the folder to etcd's state, or, the first time, etcd to the folder's.
fn restore(
    disk: &FileDisk,
    remote: &Arc<Remote>,
    looks: &Looks,
    stop: &Stop,
) -> Result<Option<FileDisk>, FleetError> {
    let folder = disk.folder();
    let names = disk.names().map_err(io::Error::other)?;
    let files = if let Some(complete) = remote.etcd.get(&remote.names.complete())? {
        let heads = remote.heads()?;
        for name in names
            .iter()
            .filter(|name| is_stored(name) && !heads.contains_key(*name))
        {
            NativeFileSystem.remove(&folder.join(name))?;
        }
        for (name, head) in &heads {
            if stop.wait(Duration::ZERO) {
                return Ok(None);
            }
            let path = folder.join(name);
            let most = MAX_TAKEN_OVER * max_bytes(name);
            if head.length > most {
                tracing::warn!(
                    "{name} in etcd has {} bytes, longer than it becomes: something else has written to it, before versions that bound what is stored. Its first {most} bytes are taken over",
                    head.length
                );
            }
            let bytes = remote.read(name, *head, most)?;
            // By one byte more, which shows a file that is longer.
            let there = NativeFileSystem.read(&path, bytes.len() as u64 + 1)?;
            if there.as_ref() != Some(&bytes) {
                // Without synchronisation: after a power cut the next start restores again.
                disk::replace(&NativeFileSystem, &path, &bytes, false)?;
            }
        }
        let since = looks.since(&heads, complete.created);
        SharedFiles::new(folder, remote.clone(), heads, since)?
    } else {
        let (none, unknown) = (BTreeMap::new(), BTreeMap::new());
        let files = SharedFiles::new(folder, remote.clone(), none, unknown)?;
        files.store_all(&names)?;
        files
    };
    Ok(Some(disk.through(Arc::new(files))))
}

/// What a node has seen of etcd, in a file beside the store's: with it the node refuses an earlier state.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
struct Mark {
    /// The epoch in which the folder was last served.
    epoch: u64,
    /// The highest revision of an answer. Other users of etcd raise it too, and whoever restores a backup may.
    revision: i64,
    /// How many changes of each lane there were; unlike the others nobody without the key can state a higher number.
    #[serde(default)]
    changes: [u64; LANES],
}

impl Mark {
    fn read(folder: &Path) -> io::Result<Mark> {
        let mark = NativeFileSystem.read(&folder.join(FLEET_EPOCH), 1_024)?;
        mark.map_or(Ok(Mark::default()), |bytes| parse(&bytes))
    }

    /// Complete after a power cut too: the node does not start with a damaged mark.
    fn write(self, folder: &Path) -> io::Result<()> {
        let text = serde_json::to_vec(&self).map_err(io::Error::other)?;
        disk::replace(&NativeFileSystem, &folder.join(FLEET_EPOCH), &text, true)
    }
}

/// This node in etcd.
#[derive(Debug)]
struct Node {
    names: Names,
    name: String,
    ttl_s: u64,
    lease: Option<Lease>,
    /// The last report, so that each is made once.
    said: String,
    begun: Instant,
    mark: Mark,
    /// When the mark was written last.
    marked: Instant,
    /// How many changes of each lane etcd had at the last look.
    changes: [u64; LANES],
    /// Whether its folder contained files of a store at the start.
    has_files: bool,
    folder: PathBuf,
    seal: Seal,
    looks: Looks,
}

/// When this node has looked at etcd while it stood by, since the boot of its computer, and the revision that it has seen: what
/// has a later one was stored after that look. So it knows how long ago another node stored a file at most, by its own time alone. A
/// lease does not show that: an etcd that is started again gives the leases of before their whole time once more.
#[derive(Debug, Default)]
struct Looks(VecDeque<(Duration, i64)>);

impl Looks {
    /// A look that began then was answered with this revision.
    fn note(&mut self, began: Duration, revision: i64) {
        while self.0.front().is_some_and(|(at, _)| *at + KEPT < began) {
            self.0.pop_front();
        }
        match self.0.back_mut() {
            Some((at, last)) if *last == revision => *at = began,
            _ => self.0.push_back((began, revision)),
        }
    }

    /// After which moment each of these files was stored, where that is known. Those up to `complete` are of the folder of the
    /// first owner: it may have written them long before.
    fn since(&self, heads: &BTreeMap<String, Head>, complete: i64) -> BTreeMap<String, Duration> {
        let later = heads.iter().filter(|(_, head)| head.changed > complete);
        let since = later.filter_map(|(name, head)| {
            let mut looks = self.0.iter().rev();
            let (at, _) = looks.find(|(_, revision)| *revision < head.changed)?;
            Some((name.clone(), *at))
        });
        since.collect()
    }
}

#[derive(Debug, Clone, Copy)]
struct Lease {
    id: i64,
    /// When the last renewal was sent: the lease ends this long after that at the earliest.
    renewed: Instant,
}

enum Turn {
    /// Owner since this revision, by a request sent at this time, in this epoch.
    Owner(i64, Instant, u64),
    /// Another node is the owner, or this one may not be: what to report.
    Wait(String),
}

enum Fault {
    Etcd(io::Error),
    /// etcd answers, and this node has to wait: what to report.
    Wait(String),
    Fatal(FleetError),
}

impl From<io::Error> for Fault {
    fn from(cause: io::Error) -> Fault {
        Fault::Etcd(cause)
    }
}

impl Node {
    fn say(&mut self, line: String, report: &mut dyn FnMut(&str)) {
        if self.said != line {
            report(&line);
            self.said = line;
        }
    }

    fn ttl(&self) -> Duration {
        Duration::from_secs(self.ttl_s)
    }

    /// Notes what etcd has from time to time. A lost note only weakens the check for a restored etcd.
    fn follow(&mut self, revision: i64, changes: [u64; LANES]) {
        let first = self.mark == Mark::default();
        if revision <= self.mark.revision || (!first && self.marked.elapsed() < MARK_EVERY) {
            return;
        }
        self.mark.revision = revision;
        self.mark.changes = changes;
        self.marked = Instant::now();
        if let Err(cause) = self.mark.write(&self.folder) {
            // Continues without it: a node with a full disk can still hand over to another.
            let mark = self.folder.join(FLEET_EPOCH);
            tracing::warn!("{} cannot be written: {cause}", mark.display());
        }
    }

    /// Keeps its lease and checks whether the VSM is free.
    fn try_once(&mut self, etcd: &Etcd) -> Result<Turn, Fault> {
        let lease = self.present(etcd)?;
        let complete = etcd.get(&self.names.complete())?;
        let before = etcd.get(&self.names.epoch())?;
        let last = match &before {
            Some(entry) => parse::<u64>(&entry.value)?,
            None => 0,
        };
        if let Some(complete) = &complete {
            // Fails for a node with another key, before it owns anything. First: by another key no change has a number.
            let opened = self.seal.open(&complete.key, &complete.value);
            opened.map_err(|cause| Fault::Fatal(cause.into()))?;
        }
        let changes = count_changes(etcd, &self.names, &self.seal)?;
        self.changes = changes;
        // Checked before anything is written: otherwise repeated starts would raise the revision until the check passes.
        let (seen, revision) = (self.mark, etcd.revision());
        if seen.epoch > last || seen.revision > revision || lacks(changes, seen.changes) {
            return Err(Fault::Fatal(FleetError::SetBack {
                folder: self.folder.clone(),
                epoch: last,
                revision,
                seen_epoch: seen.epoch,
                seen_revision: seen.revision,
                changes: changes.iter().sum(),
                seen_changes: seen.changes.iter().sum(),
            }));
        }
        // Its files were made outside this fleet, and `restore` would delete them.
        if complete.is_some() && seen == Mark::default() && self.has_files {
            let folder = self.folder.clone();
            return Err(Fault::Fatal(FleetError::Foreign { folder }));
        }
        // It belongs to the fleet from here on, and from here on detects a restored etcd.
        if complete.is_some() {
            self.follow(revision, changes);
        }
        let is_drained = etcd.get(&self.names.drained(&self.name))?.is_some();
        let drained = format!(
            "drained: this node serves nothing until `vsm fleet resume --node {}`",
            self.name
        );
        if let Some(entry) = etcd.get(&self.names.owner())? {
            let owner: Present = parse(&entry.value)?;
            // The answer to the request that made it the owner was lost.
            if owner.lease == lease.id && is_drained {
                self.leave(etcd);
                self.lease = None;
                return Ok(Turn::Wait(drained));
            }
            if owner.lease == lease.id {
                return Ok(Turn::Owner(entry.created, lease.renewed, owner.epoch));
            }
            return Ok(Turn::Wait(format!("standing by: {} serves", owner.node)));
        }
        if is_drained {
            return Ok(Turn::Wait(drained));
        }
        let first = etcd.get(&self.names.first())?;
        let first = first.map(|entry| String::from_utf8_lossy(&entry.value).into_owned());
        // Another node's first store was interrupted; only that node has all of it.
        if let Some(first) = first.filter(|first| complete.is_none() && *first != self.name) {
            return Ok(Turn::Wait(format!(
                "the folder of {first} is not whole in etcd yet: that node has to continue first"
            )));
        }
        let epoch = last + 1;
        let (owner_key, epoch_key) = (self.names.owner(), self.names.epoch());
        let same_epoch = match &before {
            Some(entry) => Condition::Holds(&epoch_key, &entry.value),
            None => Condition::CreatedAt(&epoch_key, 0),
        };
        let present = self.to_json(lease.id, epoch);
        let mut puts = vec![
            Change::Put(owner_key.clone(), present, Some(lease.id)),
            Change::Put(epoch_key.clone(), epoch.to_string().into_bytes(), None),
        ];
        if complete.is_none() {
            let name = self.name.clone().into_bytes();
            puts.push(Change::Put(self.names.first(), name, None));
        }
        // Both: no owner, and nobody has served since `before` was read.
        let conditions = [Condition::CreatedAt(&owner_key, 0), same_epoch];
        Ok(match etcd.transact(&conditions, &puts)? {
            Some(created) => Turn::Owner(created, lease.renewed, epoch),
            None => Turn::Wait("standing by".to_owned()),
        })
    }

    /// Keeps its lease, and makes sure that etcd lists it.
    fn present(&mut self, etcd: &Etcd) -> Result<Lease, Fault> {
        let sent = Instant::now();
        if let Some(lease) = self.lease {
            // Renewed at a third of its time, so that two attempts may fail.
            if sent < lease.renewed + self.ttl() / 3 {
                return Ok(lease);
            }
            if etcd.keep_alive(lease.id)? {
                return Ok(*self.lease.insert(Lease {
                    renewed: sent,
                    ..lease
                }));
            }
            self.lease = None;
            self.begun = sent;
        }
        let id = etcd.grant(self.ttl_s)?;
        let key = self.names.node(&self.name);
        let put = Change::Put(key.clone(), self.to_json(id, 0), Some(id));
        if etcd
            .transact(&[Condition::CreatedAt(&key, 0)], &[put])?
            .is_none()
            && !self.is_own(etcd.get(&key)?, id)?
        {
            let _ = etcd.revoke(id);
            // Perhaps the key of the process before, whose lease has not ended yet.
            if self.begun.elapsed() > self.ttl() * 2 + LOOK_AGAIN {
                return Err(Fault::Fatal(FleetError::Name {
                    node: self.name.clone(),
                    lease_s: self.ttl_s,
                }));
            }
            let taken = format!("the name {:?} is taken until its lease ends", self.name);
            return Err(Fault::Wait(taken));
        }
        self.begun = sent;
        Ok(*self.lease.insert(Lease { id, renewed: sent }))
    }

    /// Whether a key was put with this lease: the first answer was lost, and the repetition was not applied.
    fn is_own(&self, entry: Option<Entry>, lease: i64) -> io::Result<bool> {
        let present = entry
            .map(|entry| parse::<Present>(&entry.value))
            .transpose()?;
        Ok(present.is_some_and(|present| present.lease == lease))
    }

    fn to_json(&self, lease: i64, epoch: u64) -> Vec<u8> {
        let present = Present {
            node: self.name.clone(),
            lease,
            since: SystemTime::now()
                .duration_since(SystemTime::UNIX_EPOCH)
                .map_or(0, |time| time.as_secs()),
            epoch,
        };
        serde_json::to_vec(&present).unwrap_or_default()
    }

    fn leave(&self, etcd: &Etcd) {
        if let Some(lease) = self.lease {
            let _ = etcd.revoke(lease.id);
        }
    }
}

/// Keeps the lease of an owner.
struct Keep {
    node: Node,
    ttl: Duration,
    remote: Arc<Remote>,
    epoch: u64,
    ends: mpsc::Sender<String>,
}

impl Keep {
    fn run(mut self, stop: &Stop) {
        let mut lapsed = false;
        loop {
            let begun = Instant::now();
            match self.renew() {
                Ok(Renewal::Done) => {
                    if std::mem::take(&mut lapsed) {
                        tracing::info!("etcd has renewed the lease of this node");
                    }
                }
                Ok(Renewal::NotYet) => {}
                Ok(Renewal::Ends(why)) => {
                    // Sent once. A drained node keeps its lease until all that it promised is stored.
                    let _ = self.ends.try_send(why);
                }
                Err(cause) => {
                    let over = Instant::now() >= self.remote.right().until;
                    if over && !std::mem::replace(&mut lapsed, true) {
                        tracing::error!(
                            "the lease of this node has ended without an answer of etcd: it answers no station and commands no vehicle until there is one: {cause}"
                        );
                    }
                }
            }
            if stop.wait((begun + self.ttl / 3).saturating_duration_since(Instant::now())) {
                break;
            }
        }
        self.node.leave(&self.remote.etcd);
    }

    fn renew(&mut self) -> io::Result<Renewal> {
        let etcd = &self.remote.etcd;
        // Checked before the renewal: an earlier state may have the same owner.
        let owner_key = self.node.names.owner();
        let (revision, owner) = etcd.get_now(&owner_key)?;
        // What was answered before this request is there, whatever is stored meanwhile.
        let (seen, made) = (self.node.mark.revision, self.remote.made());
        let stored = self.remote.stored()?;
        if revision < seen || lacks(stored, made) {
            return Ok(Renewal::Ends(format!(
                "etcd was set back: it is at revision {revision}, changes {stored:?}, and this node has seen {seen}, {made:?}"
            )));
        }
        let sent = Instant::now();
        let alive = match self.node.lease {
            Some(lease) => etcd.keep_alive(lease.id)?,
            None => false,
        };
        if alive {
            let created = self.remote.right().created;
            // The lease alone is no right: its key may have been deleted under it, and another node may own the VSM since.
            if owner.as_ref().is_none_or(|entry| entry.created != created) {
                let by = owner
                    .map(|entry| parse::<Present>(&entry.value))
                    .transpose()?;
                let by = by.map_or("nobody".to_owned(), |present| present.node);
                return Ok(Renewal::Ends(format!(
                    "its key in etcd was deleted by something else: {by} owns the VSM"
                )));
            }
            self.remote.set_right(Right {
                created,
                until: Right::until(sent, self.ttl),
            });
            let drained = etcd.get(&self.node.names.drained(&self.node.name))?;
            self.node.follow(revision, stored);
            return Ok(match drained {
                Some(_) => Renewal::Ends("this node is drained".to_owned()),
                None => Renewal::Done,
            });
        }
        // The lease has ended, for example while etcd was away for longer than it lasts. If nobody has taken over,
        // everything is as this node left it.
        self.node.lease = None;
        let epoch_key = self.node.names.epoch();
        let lease = etcd.grant(self.node.ttl_s)?;
        let epoch = self.epoch.to_string();
        let conditions = [
            Condition::CreatedAt(&owner_key, 0),
            Condition::Holds(&epoch_key, epoch.as_bytes()),
        ];
        let node_key = self.node.names.node(&self.node.name);
        let changes = [
            Change::Put(
                owner_key.clone(),
                self.node.to_json(lease, self.epoch),
                Some(lease),
            ),
            Change::Put(node_key, self.node.to_json(lease, 0), Some(lease)),
        ];
        if let Some(created) = etcd.transact(&conditions, &changes)? {
            self.node.lease = Some(Lease {
                id: lease,
                renewed: sent,
            });
            self.remote.set_right(Right {
                created,
                until: Right::until(sent, self.ttl),
            });
            return Ok(Renewal::Done);
        }
        let _ = etcd.revoke(lease);
        Ok(match etcd.get(&owner_key)? {
            Some(entry) => {
                let owner: Present = parse(&entry.value)?;
                if owner.epoch == self.epoch {
                    // Its own, from a request whose answer was lost.
                    self.node.lease = Some(Lease {
                        id: owner.lease,
                        renewed: sent,
                    });
                    let until = self.remote.right().until;
                    self.remote.set_right(Right {
                        created: entry.created,
                        until,
                    });
                    Renewal::NotYet
                } else {
                    let (node, epoch) = (owner.node, owner.epoch);
                    Renewal::Ends(format!("{node} has taken over (epoch {epoch})"))
                }
            }
            None => match etcd.get(&epoch_key)? {
                Some(entry) if parse::<u64>(&entry.value)? == self.epoch => Renewal::NotYet,
                _ => Renewal::Ends("another node has served since".to_owned()),
            },
        })
    }
}

/// What became of an attempt to keep the lease.
enum Renewal {
    /// The node serves on.
    Done,
    /// Nobody else serves; the next attempt may succeed.
    NotYet,
    /// Why this node must stop serving.
    Ends(String),
}

pub(super) fn parse<T: for<'a> Deserialize<'a>>(bytes: &[u8]) -> io::Result<T> {
    serde_json::from_slice(bytes).map_err(|cause| io::Error::new(io::ErrorKind::InvalidData, cause))
}

/// How often a node notes what it has seen of etcd.
const MARK_EVERY: Duration = Duration::from_secs(10);
/// How often a node that stands by checks whether the VSM is free.
const LOOK_AGAIN: Duration = Duration::from_millis(250);
/// How long a look is remembered: longer than anything is that is taken up by its age.
const KEPT: Duration = Duration::from_secs(120);

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_was_stored_after_a_look_is_known_to_be_younger_and_nothing_else_is() {
        let s = Duration::from_secs;
        let mut looks = Looks::default();
        for (at, revision) in [(1_000, 70), (1_100, 80), (1_101, 80), (1_102, 83)] {
            looks.note(s(at), revision);
        }
        let heads = [69, 70, 71, 80, 81, 84].map(|changed| {
            let head = Head {
                changed,
                ..Head::default()
            };
            (changed.to_string(), head)
        });
        let heads = BTreeMap::from(heads);
        let since = |looks: &Looks, complete| {
            let since = looks.since(&heads, complete).into_iter();
            since.collect::<Vec<_>>()
        };
        let known = |name: &str, at| (name.to_owned(), s(at));
        assert_eq!(
            since(&looks, 60),
            [
                known("71", 1_000),
                known("80", 1_000),
                known("81", 1_101),
                known("84", 1_102)
            ]
        );
        // What the first owner has brought along may be of any age.
        assert_eq!(since(&looks, 82), [known("84", 1_102)]);
        // Nothing is kept for ever, and a node that has just begun to stand by knows nothing.
        looks.note(s(1_121), 90);
        assert_eq!(since(&looks, 60).first(), Some(&known("81", 1_101)));
        let mut begun = Looks::default();
        begun.note(s(2_000), 90);
        assert!(since(&begun, 60).is_empty());
    }
}
