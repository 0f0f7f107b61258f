//! Named counts of what was taken, sent and refused: every drop has a name.

use std::collections::BTreeMap;

use serde::Serialize;

/// Counts by name; the names are fixed in the code, so their number is bounded.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize)]
#[serde(transparent)]
pub struct Counters(BTreeMap<&'static str, u64>);

impl Counters {
    /// One more of this.
    pub fn count(&mut self, name: &'static str) {
        let value = self.0.entry(name).or_default();
        *value = value.saturating_add(1);
    }

    /// So many more of this; none are not named.
    pub fn add(&mut self, name: &'static str, count: u64) {
        if count > 0 {
            let value = self.0.entry(name).or_default();
            *value = value.saturating_add(count);
        }
    }

    /// How many of this.
    #[must_use]
    pub fn get(&self, name: &str) -> u64 {
        self.0.get(name).copied().unwrap_or(0)
    }

    /// All, by name.
    pub fn iter(&self) -> impl Iterator<Item = (&'static str, u64)> + '_ {
        self.0.iter().map(|(name, count)| (*name, *count))
    }
}

/// Counts of messages by their type.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize)]
#[serde(transparent)]
pub struct ByType(BTreeMap<u32, u64>);

impl ByType {
    /// One more of this type.
    pub fn count(&mut self, message: u32) {
        // Types come from the wire: a bound keeps strangers from growing it.
        if self.0.len() < MAX_TYPES || self.0.contains_key(&message) {
            *self.0.entry(message).or_default() += 1;
        }
    }

    /// All, by type.
    pub fn iter(&self) -> impl Iterator<Item = (u32, u64)> + '_ {
        self.0.iter().map(|(message, count)| (*message, *count))
    }
}

const MAX_TYPES: usize = 512;
