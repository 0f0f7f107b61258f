//! What becomes of each datagram at the agent, in words, for a log that is detailed enough (`RUST_LOG=debug`).
//!
//! As for the bridge ([`session::trace`](crate::session)): made of what was counted between two looks, apart from the machine,
//! and messages are named and never shown, so that no key can get into a log.

use super::agent::Agent;
use super::output::Side;
use crate::session::trace::{LinkTrace, sent};
use crate::session::{Counters, Peer};

/// What had been counted before a datagram was taken.
#[derive(Debug)]
pub struct Trace {
    side: Side,
    link: LinkTrace,
    passed: u64,
    held_back: Counters,
}

impl Agent {
    /// Counts before a datagram of this side is taken.
    #[must_use]
    pub fn begin_trace(&self, side: Side) -> Trace {
        Trace {
            side,
            link: LinkTrace::begin(self.stats_of(side)),
            passed: self.passed_from(side),
            held_back: self.relay.held_back.clone(),
        }
    }

    /// What became of it.
    #[must_use]
    pub fn end_trace(&self, before: Trace, from: Peer, bytes: &[u8]) -> String {
        let Trace {
            side,
            link,
            passed,
            held_back,
        } = before;
        let mut text = format!("{}: ", name(side));
        let stats = self.stats_of(side);
        let read = stats.datagrams > link.datagrams();
        text += &link.end(stats, from, bytes);
        let passed = self.passed_from(side) - passed;
        if passed > 0 {
            text += &format!("; passed on {passed}");
        }
        for (why, count) in self.relay.held_back.iter() {
            let count = count - held_back.get(why);
            if count > 0 {
                text += &format!("; held back {count}: {why}");
            }
        }
        if !read {
            // Without a key nothing of it can be verified.
            text += &format!("; not read ({})", self.phase.name());
        }
        text
    }

    fn stats_of(&self, side: Side) -> mavlink_link::link::LinkStats {
        match side {
            Side::Radio => self.radio.stats(),
            Side::Px4 => self.px4.stats(),
        }
    }

    fn passed_from(&self, side: Side) -> u64 {
        match side {
            Side::Radio => self.relay.to_px4,
            Side::Px4 => self.relay.to_ground,
        }
    }
}

/// A frame that goes out.
#[must_use]
pub fn sent_text(side: Side, to: Peer, bytes: &[u8]) -> String {
    format!("{}: {}", name(side), sent(to, bytes))
}

fn name(side: Side) -> &'static str {
    match side {
        Side::Radio => "ground",
        Side::Px4 => "PX4",
    }
}
