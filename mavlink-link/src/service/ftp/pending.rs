//! One request that is repeated until it is answered, and the waits between.

use std::time::Duration;

use super::payload::Payload;

/// Waits and repeats.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct Timing {
    /// Wait for an answer before the first repeat; each further wait is twice as long.
    pub answer: Duration,
    /// Longest wait before a repeat.
    pub longest_answer: Duration,
    /// An operation that gets no answer for so long has failed. A PX4 that restarts is back within it.
    pub silence: Duration,
    /// The same for a CRC32, which PX4 computes at the speed of its card.
    pub checksum: Duration,
    /// Pause before the session is requested again while another station has it. PX4 closes a session 10 s after the last
    /// request of any station: more frequent attempts would keep it open forever.
    pub busy: Duration,
    /// How long to keep trying.
    pub busy_total: Duration,
    /// How often a request keeps the session open.
    pub keep_alive: Duration,
    /// Pieces in flight at once.
    pub window: u8,
}

impl Default for Timing {
    fn default() -> Self {
        Self {
            answer: Duration::from_millis(500),
            longest_answer: Duration::from_secs(4),
            silence: Duration::from_secs(30),
            checksum: Duration::from_secs(180),
            busy: Duration::from_secs(12),
            busy_total: Duration::from_secs(36),
            keep_alive: Duration::from_secs(4),
            window: 8,
        }
    }
}

impl Timing {
    /// The wait after this many repeats.
    pub(super) fn wait(&self, repeats: u32) -> Duration {
        // The exponent is bounded for the multiplication; the wait is bounded by `longest_answer` long before.
        (self.answer * 2_u32.pow(repeats.min(8))).min(self.longest_answer)
    }
}

/// A request that is repeated until it is answered.
#[derive(Debug)]
pub(super) struct Pending {
    pub(super) payload: Payload,
    pub(super) repeats: u32,
    pub(super) deadline: Duration,
}

impl Pending {
    pub(super) fn new(now: Duration, timing: &Timing, payload: Payload) -> Self {
        let deadline = now + timing.wait(0);
        Self {
            payload,
            repeats: 0,
            deadline,
        }
    }

    pub(super) fn repeat(&mut self, now: Duration, timing: &Timing) {
        self.repeats += 1;
        self.deadline = now + timing.wait(self.repeats);
    }

    pub(super) fn is_answered_by(&self, answer: &Payload) -> bool {
        answer.requested == self.payload.opcode && answer.seq == self.payload.seq.wrapping_add(1)
    }

    /// Whether this byte of the file was requested by it.
    pub(super) fn covers(&self, at: u32) -> bool {
        let from = self.payload.offset;
        (from..from + u32::from(self.payload.size)).contains(&at)
    }
}
