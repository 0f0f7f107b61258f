//! Who is sent the heartbeats that lift timestamps: a vehicle that has restarted, or one whose frames this end refuses
//! since it has restarted itself.
//!
//! A verified frame with a stale timestamp is from such a vehicle, or it was recorded, and nothing in the frame shows which.
//! [`Rising`] drops what is only repeated. A whole flight, played in its order from many addresses, passes it, and would use up a
//! bounded number of heartbeats if whoever is first got them. [`Lifts`] has places that it cannot take.

use core::cmp::Ordering;
use core::time::Duration;

use crate::frame::Stamp;

/// Where lifting heartbeats are to be sent: to the peer, and to three others.
///
/// Of the others, that with the newest timestamp is a vehicle that has not restarted: it stamps above all that was ever
/// recorded of it. That with the oldest is one that has: it begins again where all its recordings begin, and a recording of a
/// flight is newer. The third place is for whoever is first, so that nobody's chance is less than his share of all frames.
#[derive(Debug)]
pub(crate) struct Lifts<A, T> {
    /// The peer; of the others the newest, the oldest, and the first.
    waiting: [Option<(Stamp, A, T)>; PLACES],
    served: [Option<Duration>; PLACES],
}

impl<A: Copy + Eq, T: Copy> Lifts<A, T> {
    pub(crate) fn new() -> Self {
        Self {
            waiting: [None; PLACES],
            served: [None; PLACES],
        }
    }

    /// A verified frame with that timestamp, which is stale, came from there.
    pub(crate) fn note(&mut self, from: A, peer: Option<A>, stamp: Stamp, what: T) {
        let [of_peer, newest, oldest, first] = &mut self.waiting;
        let mut left = (stamp, from, what);
        if peer == Some(from) {
            *of_peer = Some(left);
            return;
        }
        for (place, wanted) in [(newest, Ordering::Greater), (oldest, Ordering::Less)] {
            match place {
                None => {
                    *place = Some(left);
                    return;
                }
                // An address waits in one place.
                Some(held) if held.1 == left.1 => {
                    if left.0.cmp(&held.0) == wanted {
                        *held = left;
                    }
                    return;
                }
                // Who has to leave this place may be right for the next.
                Some(held) if left.0.cmp(&held.0) == wanted => core::mem::swap(held, &mut left),
                Some(_) => {}
            }
        }
        first.get_or_insert(left);
    }

    /// The next one whose turn has come: each place five times a second.
    pub(crate) fn take(&mut self, mono: Duration) -> Option<(A, T)> {
        let mut places = self.waiting.iter_mut().zip(&mut self.served);
        places.find_map(|(waiting, served)| {
            let due = served.is_none_or(|at| mono.saturating_sub(at) >= LIFT_EVERY);
            let (_, to, what) = waiting.take_if(|_| due)?;
            *served = Some(mono);
            Some((to, what))
        })
    }

    /// Whether somebody waits for a turn.
    pub(crate) fn any(&self) -> bool {
        self.waiting.iter().any(Option::is_some)
    }
}

const PLACES: usize = 4;
const LIFT_EVERY: Duration = Duration::from_millis(200);

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

    /// All that is sent within a second to that address, while somebody plays a recording of these stamps from a hundred
    /// addresses, thirty frames a millisecond, and one frame in 50 ms comes from there.
    fn lifted_in_a_second(own: u64, recorded: std::ops::Range<u64>, others: &mut usize) -> usize {
        let (mut lifts, mut to_vehicle) = (Lifts::new(), 0);
        let mut played = recorded.cycle();
        for ms in 0..1_000 {
            for n in 0..31_u16 {
                let (from, stamp) = match n {
                    30 if ms % 50 != 7 => continue,
                    30 => (1, own + ms),
                    _ => (100 + n, played.next().unwrap_or_default()),
                };
                lifts.note(from, None, Stamp::new(stamp), ());
                while let Some((to, ())) = lifts.take(Duration::from_millis(ms)) {
                    to_vehicle += usize::from(to == 1);
                    *others += usize::from(to != 1);
                }
            }
        }
        to_vehicle
    }

    #[test]
    fn a_vehicle_above_or_below_all_that_was_recorded_of_it_is_lifted_and_nobody_is_sent_much() {
        for own in [1, 2_000_000] {
            let mut others = 0;
            let lifts = lifted_in_a_second(own, 1_000_000..1_600_000, &mut others);
            assert!((4..=5).contains(&lifts), "{own}: {lifts}");
            assert!(lifts + others <= 15, "{own}: {lifts} and {others}");
        }
    }

    #[test]
    fn one_address_waits_once_and_the_peer_has_a_place_of_its_own() {
        let mut lifts = Lifts::new();
        for stamp in [5, 9, 7, 1] {
            lifts.note('v', None, Stamp::new(stamp), ());
            lifts.note('p', Some('p'), Stamp::new(stamp), ());
        }
        let now = Duration::ZERO;
        let mut sent: Vec<char> =
            core::iter::from_fn(|| lifts.take(now).map(|(to, ())| to)).collect();
        sent.sort_unstable();
        assert_eq!(sent, ['p', 'v']);
        assert!(!lifts.any());
    }

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
