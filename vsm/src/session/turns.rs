//! Work that waits for one place, of several stations: each has a queue of its own, and its turn.
//!
//! A queue that all stations share is the property of the fastest: whoever fills it first keeps the others out. Here a
//! station that has much to ask waits behind itself alone. How much may wait is decided by whoever lets it wait, by
//! [`Turns::waiting`].

use std::collections::{BTreeMap, VecDeque};
use std::ops::Bound::{Excluded, Unbounded};

/// The queues, by the index of their station.
#[derive(Debug)]
pub(crate) struct Turns<T> {
    /// None is empty.
    queues: BTreeMap<usize, VecDeque<T>>,
    /// Whose turn was last.
    last: usize,
}

impl<T> Default for Turns<T> {
    fn default() -> Turns<T> {
        Turns {
            queues: BTreeMap::new(),
            last: 0,
        }
    }
}

impl<T> Turns<T> {
    /// How much of a station waits.
    pub(crate) fn waiting(&self, station: usize) -> usize {
        self.queues.get(&station).map_or(0, VecDeque::len)
    }

    pub(crate) fn is_empty(&self) -> bool {
        self.queues.is_empty()
    }

    /// Queues an item behind the other items of the same station.
    pub(crate) fn push(&mut self, station: usize, one: T) {
        self.queues.entry(station).or_default().push_back(one);
    }

    /// The first of the station whose turn it is.
    pub(crate) fn pop(&mut self) -> Option<(usize, T)> {
        let later = self.queues.range((Excluded(self.last), Unbounded)).next();
        let station = *later.or_else(|| self.queues.iter().next())?.0;
        let queue = self.queues.get_mut(&station)?;
        let first = queue.pop_front()?;
        if queue.is_empty() {
            self.queues.remove(&station);
        }
        self.last = station;
        Some((station, first))
    }

    /// Removes all queued items of a station.
    pub(crate) fn take(&mut self, station: usize) -> VecDeque<T> {
        self.queues.remove(&station).unwrap_or_default()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn who_has_much_waits_behind_itself_alone() {
        let mut turns = Turns::default();
        for number in 0..1_000 {
            turns.push(3, number);
        }
        turns.push(0, -1);
        turns.push(7, -2);
        turns.push(0, -3);
        let order: Vec<(usize, i32)> = std::iter::from_fn(|| turns.pop()).take(6).collect();
        assert_eq!(order, [(3, 0), (7, -2), (0, -1), (3, 1), (0, -3), (3, 2)]);
        assert_eq!((turns.waiting(3), turns.waiting(0)), (997, 0));
        assert_eq!(turns.take(3).len(), 997);
        assert!(turns.is_empty() && turns.pop().is_none());
    }
}
