//! What the bridge has logged of late, for the page: who took control, what was refused and why, which alerts came and went.

use std::collections::VecDeque;
use std::time::Duration;

use serde::Serialize;

use crate::session::{LATELY, LogEntry, LogLevel, Logged};

/// The newest log entries; older ones are left out.
#[derive(Debug, Default)]
pub struct Events {
    kept: VecDeque<Event>,
    next: u64,
}

/// One log entry.
#[derive(Debug, Clone, Serialize)]
pub struct Event {
    /// Rises by one with each.
    pub number: u64,
    /// When, ms since 1970.
    pub at_ms: u64,
    /// "info", "warning" or "error".
    pub level: &'static str,
    /// The vehicle, CUCS or VSM that it is about.
    pub about: String,
    /// What happened.
    pub text: String,
}

impl Event {
    /// A log entry with its number; none of what only a debug log shows.
    pub(crate) fn of(number: u64, wall: Duration, entry: &LogEntry) -> Option<Event> {
        let level = match entry.level {
            LogLevel::Debug => return None,
            LogLevel::Info => "info",
            LogLevel::Warning => "warning",
            LogLevel::Error => "error",
        };
        Some(Event {
            number,
            at_ms: u64::try_from(wall.as_millis()).unwrap_or(u64::MAX),
            level,
            about: entry.about.to_string(),
            text: entry.text.chars().take(MAX_TEXT).collect(),
        })
    }
}

impl Events {
    /// Keeps an entry; what only a debug log shows is left out.
    pub fn push(&mut self, wall: Duration, entry: &LogEntry) {
        let Some(event) = Event::of(self.next, wall, entry) else {
            return;
        };
        if self.kept.len() >= MAX_EVENTS {
            self.kept.pop_front();
        }
        self.kept.push_back(event);
        self.next += 1;
    }

    /// Warnings and errors of the last [`LATELY`].
    pub fn lately(&self, wall: Duration) -> Vec<Logged> {
        let now_ms = u64::try_from(wall.as_millis()).unwrap_or(u64::MAX);
        let ago = |one: &Event| Duration::from_millis(now_ms.saturating_sub(one.at_ms));
        let warn = self.kept.iter().filter(|one| one.level != "info");
        warn.filter(|one| ago(one) <= LATELY)
            .map(|one| Logged {
                ago_s: ago(one).as_secs(),
                level: one.level.to_owned(),
                about: one.about.clone(),
                text: one.text.clone(),
            })
            .collect()
    }

    /// Those that are kept, the oldest first.
    pub fn all(&self) -> impl Iterator<Item = &Event> {
        self.kept.iter()
    }
}

/// A page shows the last of them; a flood of them costs no more memory than this.
const MAX_EVENTS: usize = 400;
/// No text of ours is longer.
const MAX_TEXT: usize = 400;

#[cfg(test)]
mod tests {
    use super::*;

    fn entry(level: LogLevel, text: &str) -> LogEntry {
        LogEntry {
            level,
            about: stanag_msgs::Id(0x1b00_0001),
            text: text.to_owned(),
        }
    }

    #[test]
    fn a_flood_leaves_the_newest_and_their_numbers_rise_on() {
        let mut events = Events::default();
        events.push(Duration::ZERO, &entry(LogLevel::Debug, "left out"));
        for _ in 0..3 * MAX_EVENTS {
            events.push(Duration::from_secs(1), &entry(LogLevel::Warning, "x"));
        }
        let numbers: Vec<u64> = events.all().map(|one| one.number).collect();
        let newest = 3 * MAX_EVENTS as u64;
        assert_eq!(numbers.len(), MAX_EVENTS);
        assert_eq!(numbers.last(), Some(&(newest - 1)));
        events.push(Duration::ZERO, &entry(LogLevel::Info, &"x".repeat(9_999)));
        let last = events.all().last().expect("the last");
        assert_eq!(last.number, newest);
        assert_eq!((last.text.len(), last.level), (MAX_TEXT, "info"));
    }
}
