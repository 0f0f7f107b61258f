//! Describes what happens to each datagram at the agent, for a detailed log (`RUST_LOG=debug`).
//!
//! As for the bridge ([`session::trace`](crate::session)), this is derived from the counters before and after a datagram,
//! outside the machine. Messages are named and never shown, so that no key can get into a log.

use super::agent::Agent;
use super::output::Side;
use crate::session::trace::{LinkTrace, sent};
use crate::session::{Counters, Peer};

/// The counters before a datagram is taken.
#[derive(Debug)]
pub struct Trace {
    side: Side,
    link: LinkTrace,
    passed: u64,
    held_back: Counters,
}

impl Agent {
    /// Notes the counters before a datagram of this side is taken.
    #[must_use]
    pub fn begin_trace(&self, side: Side) -> Trace {
        Trace {
            side,
            link: LinkTrace::begin(self.stats_of(side)),
            passed: self.passed_from(side),
            held_back: self.relay.held_back.clone(),
        }
    }

    /// Describes what happened to it.
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
            // Without a key none of its frames can be verified.
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

/// Describes a frame that is sent.
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
