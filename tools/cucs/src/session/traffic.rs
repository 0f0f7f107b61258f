//! What was sent, received and dropped, counted.

use std::collections::BTreeMap;

use serde::Serialize;

/// A count for each Message Type.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize)]
pub struct ByType(BTreeMap<u16, u64>);

impl ByType {
    pub(crate) fn count(&mut self, message_type: u16) {
        *self.0.entry(message_type).or_default() += 1;
    }

    /// How many of this type.
    #[must_use]
    pub fn of(&self, message_type: u16) -> u64 {
        self.0.get(&message_type).copied().unwrap_or(0)
    }

    /// (Message Type, how many), by rising type.
    pub fn iter(&self) -> impl Iterator<Item = (u16, u64)> + '_ {
        self.0
            .iter()
            .map(|(message_type, count)| (*message_type, *count))
    }

    /// How many of all types.
    #[must_use]
    pub fn total(&self) -> u64 {
        self.0.values().sum()
    }
}

/// The counters of a session.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize)]
pub struct Traffic {
    /// Messages sent, retransmissions too.
    pub sent: ByType,
    /// How many of those sent were retransmissions.
    pub retransmitted: u64,
    /// Messages that were accepted.
    pub received: ByType,
    /// Received messages that were not used, by reason.
    pub dropped: BTreeMap<&'static str, u64>,
}

impl Traffic {
    pub(crate) fn drop(&mut self, reason: &'static str) {
        *self.dropped.entry(reason).or_default() += 1;
    }
}
