//! The functions of `vsm fleet`: shows which nodes take part and which one serves, and drains or resumes nodes.

use std::io;
use std::time::Duration;

use serde::Serialize;
use stanag_msgs::Id;

use super::etcd::{Change, Condition, Etcd};
use super::node::{Present, parse};
use super::remote::Names;
use crate::config::SharedStore;

/// The nodes of a VSM, as etcd has them.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct Fleet {
    /// The node that serves; absent if none does.
    pub owner: Option<String>,
    /// How often the VSM has changed its owner.
    pub epoch: u64,
    /// Since when it serves, s since 1970 by its clock.
    pub since: Option<u64>,
    /// All nodes that take part, by name.
    pub nodes: Vec<FleetNode>,
}

/// A node of a fleet.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct FleetNode {
    /// `store.node` of its configuration.
    pub name: String,
    /// It has a lease: its program runs and reaches etcd.
    pub present: bool,
    /// It must not serve.
    pub drained: bool,
}

/// An order not to serve that ends by itself.
#[derive(Debug)]
pub struct TimedDrain {
    lease: i64,
}

/// Reads the state of a fleet, and drains and resumes nodes.
#[derive(Debug)]
pub struct Operator {
    etcd: Etcd,
    names: Names,
}

impl Operator {
    /// Of the VSM of a configuration.
    #[must_use]
    pub fn new(store: &SharedStore, vsm: Id) -> Operator {
        Operator {
            etcd: Etcd::new(&store.endpoints, WITHIN),
            names: Names::new(vsm),
        }
    }

    /// The nodes that take part.
    ///
    /// # Errors
    /// etcd does not answer, or what it has is of another version.
    pub fn fleet(&self) -> io::Result<Fleet> {
        let owner = self.etcd.get(&self.names.owner())?;
        let owner = owner
            .map(|entry| parse::<Present>(&entry.value))
            .transpose()?;
        let epoch = match self.etcd.get(&self.names.epoch())? {
            Some(entry) => parse(&entry.value)?,
            None => 0,
        };
        let (present, drained) = (
            self.named(&self.names.node(""))?,
            self.named(&self.names.drained(""))?,
        );
        let mut names: Vec<&String> = present.iter().chain(&drained).collect();
        names.sort();
        names.dedup();
        let nodes = names.into_iter().map(|name| FleetNode {
            name: name.clone(),
            present: present.contains(name),
            drained: drained.contains(name),
        });
        Ok(Fleet {
            since: owner.as_ref().map(|owner| owner.since),
            owner: owner.map(|owner| owner.node),
            epoch,
            nodes: nodes.collect(),
        })
    }

    /// Orders a node not to serve, until [`Operator::resume`]: a serving node stops, and another takes over.
    ///
    /// # Errors
    /// etcd does not answer.
    pub fn drain(&self, node: &str) -> io::Result<()> {
        let put = Change::Put(self.names.drained(node), b"1".to_vec(), None);
        self.etcd.transact(&[], &[put]).map(drop)
    }

    /// The same for this time at most, rounded down to seconds (2 s at least: etcd ends no lease sooner), or until
    /// [`Operator::end`]: etcd ends the order where its giver is interrupted. `None` if the node is drained already.
    ///
    /// # Errors
    /// etcd does not answer. An order that it has received nevertheless ends in time.
    pub fn drain_for(&self, node: &str, time: Duration) -> io::Result<Option<TimedDrain>> {
        let lease = self.etcd.grant(time.as_secs())?;
        let key = self.names.drained(node);
        // Names its lease: a request whose answer was lost finds its own value.
        let value = lease.to_string().into_bytes();
        let put = Change::Put(key.clone(), value.clone(), Some(lease));
        // Not in place of another order, such as one without an end.
        let free = Condition::CreatedAt(&key, 0);
        let put = self.etcd.transact(&[free], &[put])?.is_some();
        if put || (self.etcd.get(&key)?).is_some_and(|entry| entry.value == value) {
            return Ok(Some(TimedDrain { lease }));
        }
        let _ = self.etcd.revoke(lease);
        Ok(None)
    }

    /// Ends an order before its time, if etcd answers; otherwise it ends in time.
    pub fn end(&self, drain: &TimedDrain) {
        let _ = self.etcd.revoke(drain.lease);
    }

    /// Lets a node serve again.
    ///
    /// # Errors
    /// etcd does not answer.
    pub fn resume(&self, node: &str) -> io::Result<()> {
        let remove = Change::Remove(self.names.drained(node));
        self.etcd.transact(&[], &[remove]).map(drop)
    }

    /// The rest of each key that begins with the prefix.
    fn named(&self, prefix: &str) -> io::Result<Vec<String>> {
        let page = self.etcd.list(prefix, prefix, MAX_NODES, 0)?;
        let keys = page.entries.into_iter();
        Ok(keys
            .map(|entry| entry.key[prefix.len()..].to_owned())
            .collect())
    }
}

/// A person waits for the answer.
const WITHIN: Duration = Duration::from_secs(3);
const MAX_NODES: u32 = 1_000;
