//! Which verified frames with stale timestamps may be a restarted vehicle's own, and which were recorded.

use core::time::Duration;

use crate::frame::Stamp;

/// Distinguishes a restarted vehicle from a recording of one: the stamps of the vehicle are new, and rise. A frame that
/// is played again and again would otherwise use up the heartbeats that are to lift the vehicle, and hold the place of
/// the provisional peer.
#[derive(Debug)]
pub(crate) struct Rising<A> {
    /// Stamps that counted lately, when, and for how many addresses: no more than two count with one, the vehicle and somebody
    /// who copies it faster.
    counted: [(Stamp, Duration, u8); COUNTED],
    next: usize,
    len: usize,
    /// The highest stamp of an address, and when it counted.
    marks: [Option<(A, Stamp, Duration)>; MARKS],
}

impl<A: Copy + Eq> Rising<A> {
    pub(crate) fn new() -> Self {
        Self {
            counted: [(Stamp::ZERO, Duration::ZERO, 0); COUNTED],
            next: 0,
            len: 0,
            marks: [None; MARKS],
        }
    }

    /// Whether a verified frame with a stale stamp can be the vehicle's own. Nothing is proved by it.
    pub(crate) fn counts(&mut self, from: A, stamp: Stamp, mono: Duration) -> bool {
        let mut counted = self.counted[..self.len].iter();
        let known = counted
            .position(|(known, at, _)| *known == stamp && mono.saturating_sub(*at) < COUNTED_LIFE);
        if known.is_some_and(|place| self.counted[place].2 == 2) {
            return false;
        }
        let of_address = |mark: &Option<(A, Stamp, Duration)>| mark.is_some_and(|m| m.0 == from);
        let oldest = |mark: &Option<(A, Stamp, Duration)>| mark.map(|m| m.2);
        let place = (self.marks.iter().position(of_address))
            .or_else(|| (0..MARKS).min_by_key(|&at| oldest(&self.marks[at])))
            .unwrap_or(0);
        if let Some((address, mark, at)) = self.marks[place]
            && address == from
            && stamp <= mark
            && mono.saturating_sub(at) < COUNTED_LIFE
        {
            return false;
        }
        self.marks[place] = Some((from, stamp, mono));
        if let Some(place) = known {
            self.counted[place].2 = 2;
            return true;
        }
        self.counted[self.next] = (stamp, mono, 1);
        self.next = (self.next + 1) % COUNTED;
        self.len = (self.len + 1).min(COUNTED);
        true
    }
}

const COUNTED: usize = 64;
const MARKS: usize = 8;
/// A vehicle may start again within a second, and with the same stamps: it is not taken for a recording for longer.
const COUNTED_LIFE: Duration = Duration::from_secs(1);

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_recording_counts_twice_a_second_and_a_vehicle_with_every_frame() {
        let mut rising = Rising::new();
        let mut recording = 0;
        for n in 0..60_000_u32 {
            let mono = Duration::from_secs(30) * n / 60_000;
            // One recorded frame, from a hundred addresses.
            recording += u32::from(rising.counts(100 + n % 100, Stamp::new(900_000), mono));
            if n % 600 == 0 {
                assert!(rising.counts(1, Stamp::new(u64::from(n) + 1), mono), "{n}");
            }
        }
        assert!(recording <= 60, "{recording}");
    }

    #[test]
    fn many_recorded_frames_of_one_address_count_once_a_round() {
        let mut rising = Rising::new();
        let mut counted = 0;
        for n in 0..30_000_u64 {
            let mono = Duration::from_millis(n / 30);
            counted += u32::from(rising.counts(7, Stamp::new(1 + n % 100), mono));
        }
        assert_eq!(counted, 100);
    }
}
