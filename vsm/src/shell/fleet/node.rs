//! One node: it stands by, takes over, and keeps its lease.

use std::io;
use std::path::PathBuf;
use std::sync::{Arc, Condvar, Mutex, PoisonError};
use std::thread::JoinHandle;
use std::time::{Duration, Instant, SystemTime};

use mavlink_link::signing::SigningKey;
use serde::{Deserialize, Serialize};
use stanag_msgs::Id;
use tokio::sync::mpsc;

use super::etcd::{Change, Condition, Etcd};
use super::files::{EPOCH, SharedFiles, is_stored};
use super::remote::{Names, Remote, Right};
use super::seal::Seal;
use crate::config::SharedStore;
use crate::shell::disk::{self, FileDisk, FileSystem as _, NativeFileSystem};

/// The node cannot take part.
#[derive(Debug, thiserror::Error)]
pub enum FleetError {
    /// Another program stands by or serves under its name.
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
    #[error("etcd holds the VSM as of epoch {remote}, and {folder} was served in epoch {local}: etcd was set back, as from a backup. Its stamps would be used twice. Restore etcd as it was, or, to continue from this folder, delete the keys that begin with vsm/ and the id of the VSM", folder = folder.display())]
    SetBack {
        /// The folder of the store.
        folder: PathBuf,
        /// The epoch of the folder.
        local: u64,
        /// The epoch in etcd.
        remote: u64,
    },
    /// The system, or etcd.
    #[error("the store in etcd: {0}")]
    Io(#[from] io::Error),
}

/// Whether a node that stands by is to end.
#[derive(Debug, Clone, Default)]
pub struct Stop(Arc<(Mutex<bool>, Condvar)>);

impl Stop {
    /// It is.
    pub fn set(&self) {
        *self.0.0.lock().unwrap_or_else(PoisonError::into_inner) = true;
        self.0.1.notify_all();
    }

    /// Waits this long, or until it is; whether it is.
    fn wait(&self, time: Duration) -> bool {
        let stopped = self.0.0.lock().unwrap_or_else(PoisonError::into_inner);
        let waited = self
            .0
            .1
            .wait_timeout_while(stopped, time, |stopped| !*stopped);
        *waited.unwrap_or_else(PoisonError::into_inner).0
    }
}

/// What the key of the owner holds, and that of each node.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub(super) struct Present {
    pub(super) node: String,
    /// Its lease, which nobody else has.
    pub(super) lease: i64,
    /// Since when, s since 1970 by that node's clock.
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
    /// Dropped with this: it ends the lease on its way out, so that the next node need not wait for its time.
    _keeper: Keeper,
}

/// Keeps the lease, on a thread of its own.
#[derive(Debug)]
struct Keeper {
    stop: Stop,
    thread: Option<JoinHandle<()>>,
}

impl Held {
    /// Receives the reason when this node must not serve any more. Once.
    #[must_use]
    pub fn ended(&mut self) -> mpsc::Receiver<String> {
        let none = || mpsc::channel(1).1;
        self.ended.take().unwrap_or_else(none)
    }
}

/// Waits until this node owns the VSM, and brings `disk` to what etcd has: the store to serve from, and the ownership, which ends when it
/// is dropped. `None` where it was stopped before.
///
/// `report` is given what a person should know meanwhile.
///
/// # Errors
/// The name is taken, etcd was set back, or the folder cannot be written. An etcd that does not answer is waited for.
pub fn stand_by(
    (store, vsm): (&SharedStore, Id),
    key: &SigningKey,
    disk: FileDisk,
    stop: &Stop,
    report: &mut dyn FnMut(&str),
) -> Result<Option<(FileDisk, Held)>, FleetError> {
    let ttl = Duration::from_secs(store.lease_s);
    // A member that does not answer must leave time to ask another one.
    let etcd = Etcd::new(&store.endpoints, ttl / 4);
    let mut node = Node {
        names: Names::new(vsm),
        name: store.node.clone(),
        ttl_s: store.lease_s,
        lease: None,
        said: String::new(),
        begun: Instant::now(),
        served: served(&disk)?,
        folder: disk.folder().to_owned(),
    };
    let (etcd, right, epoch) = loop {
        let tried = Instant::now();
        match node.try_once(&etcd) {
            Ok(Turn::Owner(created, sent, epoch)) => {
                let right = Right {
                    created,
                    until: sent + ttl,
                };
                break (etcd, right, epoch);
            }
            Ok(Turn::Wait(line)) => node.say(line, report),
            Err(Fault::Fatal(fault)) => return Err(fault),
            Err(Fault::Etcd(cause)) => node.say(format!("etcd does not answer: {cause}"), report),
        }
        if stop.wait((tried + LOOK_AGAIN).saturating_duration_since(Instant::now())) {
            node.leave(&etcd);
            return Ok(None);
        }
    };
    let remote = Arc::new(Remote::new(etcd, node.names.clone(), Seal::new(key), right));
    let (ends, ended) = mpsc::channel(1);
    let keep = Keep {
        node,
        ttl,
        remote: remote.clone(),
        epoch,
        ends,
    };
    // From here on, since what is restored may take longer than a lease lasts.
    let keeper_stop = Stop::default();
    let of_thread = keeper_stop.clone();
    let thread = std::thread::Builder::new()
        .name("lease".to_owned())
        .spawn(move || keep.run(&of_thread))?;
    let keeper = Keeper {
        stop: keeper_stop,
        thread: Some(thread),
    };
    let disk = restore(&disk, &remote, epoch)?;
    let held = Held {
        epoch,
        ended: Some(ended),
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

/// Brings the folder to what etcd has, or, the first time, etcd to what the folder has.
fn restore(disk: &FileDisk, remote: &Arc<Remote>, epoch: u64) -> Result<FileDisk, FleetError> {
    let folder = disk.folder().to_owned();
    let whole = remote.etcd.get(&remote.names.complete())?.is_some();
    let heads = remote.heads()?;
    let names = disk.names().map_err(io::Error::other)?;
    let files = if whole {
        for name in names
            .iter()
            .filter(|name| is_stored(name) && !heads.contains_key(*name))
        {
            NativeFileSystem.remove(&folder.join(name))?;
        }
        for (name, head) in &heads {
            let path = folder.join(name);
            let bytes = remote.read(name, *head)?;
            if NativeFileSystem.read(&path, u64::MAX)?.as_ref() != Some(&bytes) {
                disk::replace(&NativeFileSystem, &path, &bytes, false)?;
            }
        }
        SharedFiles::new(&folder, remote.clone(), heads)
    } else {
        let files = SharedFiles::new(&folder, remote.clone(), heads);
        files.store_all(&names)?;
        files
    };
    // From here on stamps of this epoch may be used: an older state must not be served.
    let mark = folder.join(EPOCH);
    disk::replace(&NativeFileSystem, &mark, epoch.to_string().as_bytes(), true)?;
    Ok(disk.through(Arc::new(files)))
}

/// The epoch in which the folder was served last; 0 where it never was.
fn served(disk: &FileDisk) -> io::Result<u64> {
    let mark = NativeFileSystem.read(&disk.folder().join(EPOCH), 32)?;
    let Some(mark) = mark else { return Ok(0) };
    parse(&mark)
}

/// This node in etcd.
#[derive(Debug)]
struct Node {
    names: Names,
    name: String,
    ttl_s: u64,
    lease: Option<Lease>,
    /// What was reported last: each thing once.
    said: String,
    begun: Instant,
    /// The epoch in which its folder was served last.
    served: u64,
    folder: PathBuf,
}

#[derive(Debug, Clone, Copy)]
struct Lease {
    id: i64,
    /// When what renewed it last was sent: it ends this long after that at the earliest.
    renewed: Instant,
}

enum Turn {
    /// Since the revision, by a request that was sent then, in this epoch.
    Owner(i64, Instant, u64),
    /// Somebody else is, or this one is not to be: what to report.
    Wait(String),
}

enum Fault {
    Etcd(io::Error),
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

    /// Keeps its lease and looks whether the VSM is free.
    fn try_once(&mut self, etcd: &Etcd) -> Result<Turn, Fault> {
        let lease = self.present(etcd)?;
        if etcd.get(&self.names.drained(&self.name))?.is_some() {
            return Ok(Turn::Wait(format!(
                "drained: this node serves nothing until `vsm fleet resume --node {}`",
                self.name
            )));
        }
        if let Some(entry) = etcd.get(&self.names.owner())? {
            let owner: Present = parse(&entry.value)?;
            // The answer to the request that made it the owner was lost.
            if owner.lease == lease.id {
                return Ok(Turn::Owner(entry.created, lease.renewed, owner.epoch));
            }
            return Ok(Turn::Wait(format!("standing by: {} serves", owner.node)));
        }
        let before = etcd.get(&self.names.epoch())?;
        let last = match &before {
            Some(entry) => parse::<u64>(&entry.value)?,
            None => 0,
        };
        // Before anything is taken: a node that is started again and again would count past it.
        if self.served > last {
            return Err(Fault::Fatal(FleetError::SetBack {
                folder: self.folder.clone(),
                local: self.served,
                remote: last,
            }));
        }
        let epoch = last + 1;
        let (owner_key, epoch_key) = (self.names.owner(), self.names.epoch());
        let same_epoch = match &before {
            Some(entry) => Condition::Holds(&epoch_key, &entry.value),
            None => Condition::CreatedAt(&epoch_key, 0),
        };
        let changes = [
            Change::Put(
                owner_key.clone(),
                self.to_json(lease.id, epoch),
                Some(lease.id),
            ),
            Change::Put(epoch_key.clone(), epoch.to_string().into_bytes(), None),
        ];
        let conditions = [Condition::CreatedAt(&owner_key, 0), same_epoch];
        Ok(match etcd.transact(&conditions, &changes)? {
            Some(created) => Turn::Owner(created, lease.renewed, epoch),
            None => Turn::Wait("standing by".to_owned()),
        })
    }

    /// Sees that its lease goes on and that etcd lists it.
    fn present(&mut self, etcd: &Etcd) -> Result<Lease, Fault> {
        let sent = Instant::now();
        if let Some(lease) = self.lease {
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
        }
        let id = etcd.grant(self.ttl_s)?;
        let key = self.names.node(&self.name);
        let put = Change::Put(key.clone(), self.to_json(id, 0), Some(id));
        if etcd
            .transact(&[Condition::CreatedAt(&key, 0)], &[put])?
            .is_none()
        {
            let _ = etcd.revoke(id);
            // That of the process before, perhaps, which its lease outlives.
            if self.begun.elapsed() > self.ttl() * 2 + LOOK_AGAIN {
                return Err(Fault::Fatal(FleetError::Name {
                    node: self.name.clone(),
                    lease_s: self.ttl_s,
                }));
            }
            let taken = format!("the name {:?} is taken until its lease ends", self.name);
            return Err(Fault::Etcd(io::Error::other(taken)));
        }
        self.begun = sent;
        Ok(*self.lease.insert(Lease { id, renewed: sent }))
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
            match self.renew(begun) {
                Ok(None) => {
                    if std::mem::take(&mut lapsed) {
                        tracing::info!("etcd has renewed the lease of this node");
                    }
                }
                Ok(Some(why)) => {
                    // Once is enough. A node that is drained keeps its lease until all that it promised is stored.
                    let _ = self.ends.try_send(why);
                }
                Err(cause) => {
                    let over = Instant::now() >= self.remote.right().until;
                    if over && !std::mem::replace(&mut lapsed, true) {
                        tracing::error!(
                            "the lease of this node has ended without an answer of etcd: it takes no commands until there is one: {cause}"
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

    /// Why this node must not serve any more, or nothing.
    fn renew(&mut self, sent: Instant) -> io::Result<Option<String>> {
        let etcd = &self.remote.etcd;
        let alive = match self.node.lease {
            Some(lease) => etcd.keep_alive(lease.id)?,
            None => false,
        };
        if alive {
            let created = self.remote.right().created;
            self.remote.set_right(Right {
                created,
                until: sent + self.ttl,
            });
            let drained = etcd.get(&self.node.names.drained(&self.node.name))?;
            return Ok(drained.map(|_| "this node is drained".to_owned()));
        }
        // Gone, as where etcd was away for longer than it lasts. Where nobody has taken over, everything is as this node left it.
        self.node.lease = None;
        let owner_key = self.node.names.owner();
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
                until: sent + self.ttl,
            });
            return Ok(None);
        }
        let _ = etcd.revoke(lease);
        let owner = etcd.get(&owner_key)?;
        let owner = owner
            .map(|entry| parse::<Present>(&entry.value))
            .transpose()?;
        Ok(match owner {
            Some(owner) if owner.epoch != self.epoch => Some(format!(
                "{} has taken over (epoch {})",
                owner.node, owner.epoch
            )),
            // Its own, of which the answer was lost: that lease ends, too.
            Some(_) => None,
            None => match etcd.get(&epoch_key)? {
                Some(entry) if parse::<u64>(&entry.value)? == self.epoch => None,
                _ => Some("another node has served since".to_owned()),
            },
        })
    }
}

pub(super) fn parse<T: for<'a> Deserialize<'a>>(bytes: &[u8]) -> io::Result<T> {
    serde_json::from_slice(bytes).map_err(|cause| io::Error::new(io::ErrorKind::InvalidData, cause))
}

/// How soon a node that stands by sees that the VSM is free.
const LOOK_AGAIN: Duration = Duration::from_millis(250);
