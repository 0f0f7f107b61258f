//! Values that change in the course of a recording, by time.

use std::time::Duration;

use stanag_msgs::Id;

use crate::session::log::{LogEntry, LogLevel};

/// Values of one thing by time: each holds until the next.
#[derive(Debug)]
pub(super) struct Changes<T>(pub(super) Vec<(Duration, T)>);

impl<T> Default for Changes<T> {
    fn default() -> Self {
        Changes(Vec::new())
    }
}

impl<T: PartialEq> Changes<T> {
    /// From now on it is this; true where it was not before.
    pub(super) fn set(&mut self, at: Duration, value: T) -> bool {
        if self.0.last().is_some_and(|(_, last)| *last == value) {
            return false;
        }
        self.push(at, value);
        true
    }
}

impl<T> Changes<T> {
    pub(super) fn push(&mut self, at: Duration, value: T) {
        // A clock that was set back repeats times: what came later stays later.
        let at = self.0.last().map_or(at, |(last, _)| at.max(*last));
        self.0.push((at, value));
    }

    /// The value at this moment, and since when.
    pub(super) fn at(&self, moment: Duration) -> Option<&(Duration, T)> {
        let until = self.0.partition_point(|(at, _)| *at <= moment);
        self.0.get(until.checked_sub(1)?)
    }
}

pub(super) fn entry(level: LogLevel, about: Id, text: String) -> LogEntry {
    LogEntry { level, about, text }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_value_holds_until_the_next_also_where_the_clock_was_set_back() {
        let s = Duration::from_secs;
        let mut changes = Changes::default();
        assert!(changes.set(s(10), 'a') && !changes.set(s(11), 'a') && changes.set(s(20), 'b'));
        // Set back by 15 s.
        assert!(changes.set(s(5), 'c'));
        assert_eq!(changes.at(s(9)), None);
        assert_eq!(changes.at(s(19)), Some(&(s(10), 'a')));
        assert_eq!(changes.at(s(20)), Some(&(s(20), 'c')));
        assert_eq!(changes.at(s(12)), Some(&(s(10), 'a')));
    }
}
