//! The fraction of the vehicle's frames that are lost, measured by gaps in their sequence numbers.

use std::time::Duration;

/// Frames of one sender on one link, in the present window and the previous one.
#[derive(Debug, Default)]
pub(crate) struct Loss {
    last: Option<u8>,
    began: Duration,
    received: [u32; 2],
    lost: [u32; 2],
}

impl Loss {
    /// A frame with this sequence number has arrived.
    pub(super) fn note(&mut self, now: Duration, seq: u8) {
        if now.saturating_sub(self.began) >= WINDOW {
            let idle = now.saturating_sub(self.began) >= 2 * WINDOW;
            let shift = |counts: [u32; 2]| [if idle { 0 } else { counts[1] }, 0];
            (self.received, self.lost) = (shift(self.received), shift(self.lost));
            self.began = now;
            if idle {
                // After a silence the sequence number may have wrapped around, so the gap is not counted.
                self.last = None;
            }
        }
        self.received[1] += 1;
        let Some(last) = self.last else {
            self.last = Some(seq);
            return;
        };
        match seq.wrapping_sub(last) {
            ahead @ 1..128 => {
                self.lost[1] += u32::from(ahead - 1);
                self.last = Some(seq);
            }
            // The frame arrived late and was already counted as lost.
            _ => self.lost[1] = self.lost[1].saturating_sub(1),
        }
    }

    /// The fraction that did not arrive, 0 to 1; `None` until enough frames were counted.
    pub(crate) fn part(&self) -> Option<f64> {
        let [received, lost]: [u32; 2] =
            [self.received, self.lost].map(|counts| counts.iter().sum());
        (received >= MIN_FRAMES).then(|| f64::from(lost) / f64::from(received + lost))
    }
}

const WINDOW: Duration = Duration::from_secs(5);
const MIN_FRAMES: u32 = 20;

#[cfg(test)]
mod tests {
    use super::*;

    fn after(frames: impl Iterator<Item = (u64, u8)>) -> Loss {
        let mut loss = Loss::default();
        for (ms, seq) in frames {
            loss.note(Duration::from_millis(ms), seq);
        }
        loss
    }

    #[test]
    fn gaps_are_counted_over_the_roll_over_of_the_number() {
        assert_eq!(after((0..10).map(|n| (n * 20, n as u8))).part(), None);
        assert_eq!(
            after((0..1_000).map(|n| (n * 20, n as u8))).part(),
            Some(0.0)
        );
        let every_fourth = (0..2_000_u64)
            .filter(|n| n % 4 != 0)
            .map(|n| (n * 20, n as u8));
        let part = after(every_fourth).part().expect("enough");
        assert!((part - 0.25).abs() < 0.01, "{part}");
    }

    #[test]
    fn what_was_overtaken_is_not_lost_and_an_old_loss_is_forgotten() {
        let swapped = (0..1_000_u64).map(|n| (n * 20, (n ^ 1) as u8));
        let part = after(swapped).part().expect("enough");
        assert!(part < 0.02, "{part}");
        let mut loss = after((0..500_u64).map(|n| (n * 20, (n * 3) as u8)));
        assert!(loss.part().is_some_and(|part| part > 0.6));
        for n in 0..600_u64 {
            loss.note(
                Duration::from_millis(10_000 + n * 20),
                (499 * 3 + 1 + n) as u8,
            );
        }
        assert_eq!(loss.part(), Some(0.0));
    }
}
