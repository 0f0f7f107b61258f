//! One attempt: what has been sent of it, and when it is sent again, given up and begun again.

use core::fmt;
use core::time::Duration;

use crate::exchange::gate::Gate;
use crate::exchange::identity::{NoRandom, PublicKey, Random};
use crate::exchange::keys::Confirmation;
use crate::exchange::message::Message;
use crate::exchange::noise::Noise;
use crate::signing::KeyId;

/// Step 1 has been sent.
#[derive(Debug)]
pub(super) struct Asking {
    pub(super) noise: Noise,
    pub(super) gate: Gate,
    pub(super) message: Message,
    /// As on disk; with suite 2 it is sent in step 3.
    pub(super) counter: u64,
}

/// Step 2 has been read, and `next` is on disk.
pub(super) struct Confirming {
    pub(super) gate: Gate,
    pub(super) message: Message,
    pub(super) agreed: Promise,
    pub(super) confirmation: Confirmation,
    /// The responder's ephemeral key, which it repeats in step 4.
    pub(super) ephemeral: [u8; 32],
    /// When step 2 was received.
    pub(super) since: Duration,
    /// The sequence number of the last step 4.
    pub(super) seq: Option<u32>,
}

impl fmt::Debug for Confirming {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Confirming")
            .field("message", &self.message)
            .finish_non_exhaustive()
    }
}

/// What memory keeps of the agreed key: not the key itself.
#[derive(Debug, Clone, Copy)]
pub(super) struct Promise {
    pub(super) key: KeyId,
    pub(super) peer: PublicKey,
    pub(super) epoch: u32,
}

/// One attempt: the same payload again after 0.5, 1, 2 and 4 s, given up 10 s after the first.
#[derive(Debug, Clone, Copy)]
pub(super) struct Attempt {
    give_up_at: Duration,
    next_at: Duration,
    sent: usize,
}

impl Attempt {
    pub(super) fn begin(now: Duration) -> Self {
        Self {
            give_up_at: now.saturating_add(GIVE_UP),
            next_at: now,
            sent: 0,
        }
    }

    /// The next step of the same attempt: sent at once, and again at the same intervals. The end of the attempt stays.
    pub(super) fn next_step(&mut self, now: Duration) {
        (self.next_at, self.sent) = (now, 0);
    }

    /// Whether it is time to send; counts the sending.
    pub(super) fn take_due(&mut self, now: Duration) -> bool {
        if now < self.next_at {
            return false;
        }
        let pause = RESEND.get(self.sent).copied().unwrap_or(RESEND_LAST);
        self.sent += 1;
        self.next_at = now.saturating_add(pause);
        true
    }

    pub(super) fn is_over(&self, now: Duration) -> bool {
        now >= self.give_up_at
    }

    pub(super) fn poll_timeout(&self) -> Duration {
        self.next_at.min(self.give_up_at)
    }
}

/// The pauses between attempts: 1, 2, 4 .. 30 s, 20 % more or less.
#[derive(Debug, Default)]
pub(super) struct Pauses {
    failures: u32,
}

impl Pauses {
    pub(super) fn reset(&mut self) {
        self.failures = 0;
    }

    pub(super) fn next(&mut self, random: &mut dyn Random) -> Duration {
        let whole = Duration::from_secs(1 << self.failures.min(5)).min(LONGEST);
        self.failures = self.failures.saturating_add(1);
        // Without random bytes two initiators might collide repeatedly, but a responder has only one.
        let jitter = byte(random).unwrap_or(128);
        whole * 8 / 10 + whole * 4 / 10 * u32::from(jitter) / 255
    }
}

fn byte(random: &mut dyn Random) -> Result<u8, NoRandom> {
    let mut byte = [0];
    random.fill(&mut byte)?;
    Ok(byte[0])
}

const RESEND: [Duration; 4] = [
    Duration::from_millis(500),
    Duration::from_secs(1),
    Duration::from_secs(2),
    Duration::from_secs(4),
];
const RESEND_LAST: Duration = Duration::from_secs(4);
const GIVE_UP: Duration = Duration::from_secs(10);
const LONGEST: Duration = Duration::from_secs(30);

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_attempt_is_sent_five_times_in_ten_seconds() {
        let mut attempt = Attempt::begin(Duration::ZERO);
        let mut sent = Vec::new();
        for ms in (0..10_000).step_by(100) {
            let now = Duration::from_millis(ms);
            assert!(!attempt.is_over(now));
            if attempt.take_due(now) {
                sent.push(ms);
            }
        }
        assert_eq!(sent, [0, 500, 1_500, 3_500, 7_500]);
        assert!(attempt.is_over(Duration::from_secs(10)));
    }

    #[test]
    fn pauses_double_to_thirty_seconds_within_a_fifth() {
        for (byte, factor) in [(0, 0.8), (255, 1.2)] {
            let mut random = |out: &mut [u8]| {
                out.fill(byte);
                Ok(())
            };
            let mut pauses = Pauses::default();
            for whole in [1.0, 2.0, 4.0, 8.0, 16.0, 30.0, 30.0] {
                let pause = pauses.next(&mut random).as_secs_f64();
                assert!((pause - whole * factor).abs() < 0.01, "{pause} of {whole}");
            }
        }
    }
}
