//! A queue that never holds more than a fixed number of entries.

use std::collections::VecDeque;

/// First in, first out; what does not fit is refused and counted.
///
/// Every service retries what matters, so a refused message is no worse than a lost one.
#[derive(Clone, Debug)]
pub struct Bounded<T> {
    entries: VecDeque<T>,
    capacity: usize,
    refused: u64,
}

impl<T> Bounded<T> {
    /// An empty queue for at most `capacity` entries.
    pub const fn new(capacity: usize) -> Self {
        Self {
            entries: VecDeque::new(),
            capacity,
            refused: 0,
        }
    }

    /// Appends; returns whether there was room.
    pub fn push(&mut self, entry: T) -> bool {
        let room = self.entries.len() < self.capacity;
        if room {
            self.entries.push_back(entry);
        } else {
            self.refused = self.refused.saturating_add(1);
        }
        room
    }

    /// Appends unless an equal entry waits already: a repetition due before the first has left would take the room of
    /// others.
    pub fn push_once(&mut self, entry: T)
    where
        T: PartialEq,
    {
        if !self.entries.contains(&entry) {
            self.push(entry);
        }
    }

    /// Removes the entries for which this is false.
    pub fn retain(&mut self, keep: impl FnMut(&T) -> bool) {
        self.entries.retain(keep);
    }

    /// Takes the oldest entry.
    pub fn pop(&mut self) -> Option<T> {
        self.entries.pop_front()
    }

    /// Takes back the entry appended last.
    pub fn pop_last(&mut self) -> Option<T> {
        self.entries.pop_back()
    }

    /// The entry appended last.
    pub fn last_mut(&mut self) -> Option<&mut T> {
        self.entries.back_mut()
    }

    /// Removes every entry.
    pub fn clear(&mut self) {
        self.entries.clear();
    }

    /// Entries waiting.
    pub fn len(&self) -> usize {
        self.entries.len()
    }

    /// Whether nothing waits.
    pub fn is_empty(&self) -> bool {
        self.entries.is_empty()
    }

    /// Entries refused for lack of room since the start.
    pub const fn refused(&self) -> u64 {
        self.refused
    }
}
