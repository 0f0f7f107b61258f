//! Where the other end of a link is, as far as verified datagrams show it.
//!
//! A datagram that verifies shows who made it, not who sent it: somebody on the way can copy each one and deliver the copy
//! first, from an address of their own. If the newest address were followed at once, what is sent would go to the copier.
//! So the other end stays where it was while anything new comes from there: a datagram, or the original of one that was
//! accepted from elsewhere. Meanwhile a link that can ask whether what it sends arrives asks at both addresses
//! ([`ProvenAddress::contender`]), and moves where the other one alone answers: an aircraft whose NAT has given it another
//! port is followed within a second or two, and no copier can answer. The same is asked where the originals come from
//! elsewhere, in case the copier was there first.
//!
//! One that cannot answer is followed [`STAYS_FOR`] after the last that was new from the old address, or after
//! [`MANY`] datagrams without an original, since one that has moved sends nothing from the old address. An address counts as
//! one of originals once [`MANY`] datagrams came from there first: somebody who was faster once must not keep the link by
//! repeating, slower, what the other end sends.
//!
//! While two addresses claim to be the other end, what is sent to it goes to both ([`ProvenAddress::others`]), except keys: a
//! copier that was there first, or that forwards the questions and nothing else, costs nothing then.

use core::time::Duration;
use std::collections::VecDeque;

/// Follows the address of the other end. `K` recognises a datagram that comes again.
#[derive(Debug)]
pub(crate) struct ProvenAddress<A, K> {
    at: Option<A>,
    /// When anything new came from there, copied before or not, and of which sender.
    shown: Option<(Duration, Sender)>,
    /// Datagrams that came from there first, the latest of them, and where one of these has come from since.
    firsts: u32,
    latest: VecDeque<K>,
    echo: Option<(A, Duration)>,
    /// Where the last came from that was accepted from elsewhere since then, and how many did.
    contender: Option<(A, Duration)>,
    elsewhere: u32,
    /// Those of them whose original has not come.
    copied: VecDeque<(K, Duration)>,
}

/// Which program at the other end has sent something.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Sender {
    /// The one that the link is for.
    Main,
    /// One beside the main one, such as a camera. It may have a socket of its own, so it says where the link leads only while
    /// the main one is not received.
    Beside,
}

impl<A: Copy + Eq, K: Copy + PartialEq> ProvenAddress<A, K> {
    /// Expected at `at`, where that is known from a configuration.
    pub(crate) fn new(at: Option<A>) -> Self {
        Self {
            at,
            shown: None,
            firsts: 0,
            // Not at the first datagrams of a flight.
            latest: VecDeque::with_capacity(MAX_LATEST),
            echo: None,
            contender: None,
            elsewhere: 0,
            copied: VecDeque::new(),
        }
    }

    pub(crate) fn get(&self) -> Option<A> {
        self.at
    }

    /// Takes `at` for the address, without a proof: the first proof from elsewhere moves it.
    pub(crate) fn assume(&mut self, at: A) {
        if self.at != Some(at) {
            self.move_to(Duration::ZERO, at, Sender::Main);
            self.shown = None;
        }
    }

    /// Everywhere else it may be. Whoever has seen the copies of a copier knows as much as this end about which of the addresses
    /// is the copier's: what is sent to all of them arrives, and what arrives twice is refused as a replay.
    pub(crate) fn others(&self, now: Duration) -> impl Iterator<Item = A> + use<A, K> {
        let contender = lately(self.contender, now);
        let echo = lately(self.echo, now).filter(|echo| Some(*echo) != contender);
        contender.into_iter().chain(echo)
    }

    /// Where else it may be: something was accepted from there, and nothing new from the known address since then; or what is
    /// accepted from the known address comes from there as well.
    pub(crate) fn contender(&self, now: Duration) -> Option<A> {
        lately(self.contender, now).or_else(|| lately(self.echo, now))
    }

    /// The other end has answered what was sent to `at`. Returns the address before and now, if this has moved it.
    pub(crate) fn answered_at(&mut self, now: Duration, at: A) -> Option<(Option<A>, A)> {
        if self.contender(now) != Some(at) {
            return None;
        }
        let by = self.shown.map_or(Sender::Main, |(_, by)| by);
        let moved = self.move_to(now, at, by);
        // That is more than being first.
        self.firsts = MANY;
        Some(moved)
    }

    /// Something that the other end alone can have made was accepted from `from`, for the first time. Returns the address
    /// before and now, if this has moved it.
    pub(crate) fn prove(
        &mut self,
        now: Duration,
        from: A,
        by: Sender,
        key: Option<K>,
    ) -> Option<(Option<A>, A)> {
        let shown_by = self
            .shown
            .and_then(|(at, by)| (now.saturating_sub(at) < STAYS_FOR).then_some(by));
        let hidden = (shown_by, by) == (Some(Sender::Main), Sender::Beside);
        if self.at == Some(from) {
            if !hidden {
                self.firsts = self.firsts.saturating_add(1);
                self.note_first(key);
                self.show(now, by);
            }
            return None;
        }
        let better = (shown_by, by) == (Some(Sender::Beside), Sender::Main);
        if hidden
            || (self.at.is_some()
                && shown_by.is_some()
                && !better
                && !self.has_left(now, from, key))
        {
            return None;
        }
        let moved = self.move_to(now, from, by);
        self.note_first(key);
        Some(moved)
    }

    fn note_first(&mut self, key: Option<K>) {
        self.latest.truncate(MAX_LATEST - 1);
        key.into_iter().for_each(|key| self.latest.push_front(key));
    }

    /// Something that was accepted before came from `from`. Returns true if this is the original of a copy from elsewhere.
    pub(crate) fn note_second(&mut self, now: Duration, from: A, key: &K) -> bool {
        if self.at != Some(from) {
            if self.latest.contains(key) || self.copied.iter().any(|(copied, _)| copied == key) {
                self.echo = Some((from, now));
            }
            return false;
        }
        if self.firsts < MANY {
            return false;
        }
        self.forget(now);
        let Some(place) = self.copied.iter().position(|(copied, _)| copied == key) else {
            return false;
        };
        // Each counts once.
        self.copied.remove(place);
        if let Some((_, by)) = self.shown {
            self.show(now, by);
        }
        true
    }

    fn move_to(&mut self, now: Duration, to: A, by: Sender) -> (Option<A>, A) {
        let before = self.at.replace(to);
        (self.firsts, self.echo) = (1, None);
        self.latest.clear();
        self.copied.clear();
        self.show(now, by);
        (before, to)
    }

    fn show(&mut self, now: Duration, by: Sender) {
        self.shown = Some((now, by));
        (self.contender, self.elsewhere) = (None, 0);
    }

    /// One more from elsewhere: whether these are too many for copies.
    fn has_left(&mut self, now: Duration, from: A, key: Option<K>) -> bool {
        self.contender = Some((from, now));
        self.elsewhere += 1;
        if self.elsewhere >= MANY {
            return true;
        }
        self.forget(now);
        // The oldest are kept: their originals come next.
        if let Some(key) = key
            && self.copied.len() < MAX_COPIED
        {
            self.copied.push_back((key, now));
        }
        false
    }

    fn forget(&mut self, now: Duration) {
        self.copied
            .retain(|(_, at)| now.saturating_sub(*at) < STAYS_FOR);
    }
}

fn lately<A>(seen: Option<(A, Duration)>, now: Duration) -> Option<A> {
    seen.and_then(|(from, at)| (now.saturating_sub(at) < STAYS_FOR).then_some(from))
}

/// How long the other end is taken to be where it was, after the last that came from there.
const STAYS_FOR: Duration = Duration::from_millis(2_500);
/// So many datagrams in a row are no accident: a second of telemetry.
const MANY: u32 = 64;
/// Copies that are remembered: those of a burst.
const MAX_COPIED: usize = 256;
/// Originals that are remembered: one recognised now and then is enough.
const MAX_LATEST: usize = 32;

#[cfg(test)]
mod tests {
    use super::*;

    const VEHICLE: u8 = 1;
    const COPIER: u8 = 2;

    const fn at(ms: u64) -> Duration {
        Duration::from_millis(ms)
    }

    fn known() -> ProvenAddress<u8, u64> {
        let mut address = ProvenAddress::new(None);
        let first = address.prove(at(0), VEHICLE, Sender::Main, Some(0));
        assert_eq!(first, Some((None, VEHICLE)), "it is followed at once");
        for _ in 1..MANY {
            assert_eq!(address.prove(at(0), VEHICLE, Sender::Main, None), None);
        }
        address
    }

    #[test]
    fn a_faster_copy_of_everything_moves_nothing() {
        let mut address = known();
        for n in 1..1_000 {
            assert_eq!(
                address.prove(at(20 * n), COPIER, Sender::Main, Some(n)),
                None
            );
            assert!(address.note_second(at(20 * n + 5), VEHICLE, &n));
            assert!(
                !address.note_second(at(20 * n + 6), VEHICLE, &n),
                "counts once"
            );
        }
    }

    #[test]
    fn one_that_has_moved_is_followed_after_its_silence_or_after_many() {
        for (every, followed) in [(20, 64 * 20), (1_000, 3_000)] {
            let mut address = known();
            let moved = (1..).map(|n| every * n).find(|&ms| {
                address
                    .prove(at(ms), COPIER, Sender::Main, Some(ms))
                    .is_some()
            });
            assert_eq!(moved, Some(followed));
            assert_eq!(address.get(), Some(COPIER));
        }
    }

    #[test]
    fn a_second_datagram_from_elsewhere_holds_nothing() {
        let mut address = known();
        for n in 1..200 {
            if let Some(moved) = address.prove(at(10 * n), COPIER, Sender::Main, Some(n)) {
                assert_eq!(moved, (Some(VEHICLE), COPIER));
                return;
            }
            assert!(!address.note_second(at(10 * n + 1), 3, &n));
            assert!(!address.note_second(at(10 * n + 1), VEHICLE, &(n + 10_000)));
        }
        panic!("not followed");
    }

    #[test]
    fn one_that_was_faster_once_keeps_nothing_by_repeating() {
        let mut address = ProvenAddress::new(None);
        address.prove(at(0), COPIER, Sender::Main, Some(0));
        let moved = (1..).map(|n| 20 * n).find(|&ms| {
            let moved = address.prove(at(ms), VEHICLE, Sender::Main, Some(ms));
            assert!(!address.note_second(at(ms + 1), COPIER, &ms));
            moved.is_some()
        });
        assert_eq!(moved, Some(64 * 20));
    }

    #[test]
    fn an_answer_moves_it_at_once_and_only_to_a_contender() {
        let mut address = known();
        assert_eq!(address.answered_at(at(5), COPIER), None);
        address.prove(at(10), COPIER, Sender::Main, Some(1));
        assert_eq!(address.contender(at(10)), Some(COPIER));
        assert!(address.note_second(at(11), VEHICLE, &1));
        assert_eq!(address.contender(at(11)), None, "it was a copy");
        address.prove(at(20), 3, Sender::Main, Some(2));
        assert_eq!(address.answered_at(at(30), 3), Some((Some(VEHICLE), 3)));
        assert_eq!(address.get(), Some(3));
        // Who repeats what comes from there may be the other end too, if it answers.
        address.prove(at(40), 3, Sender::Main, Some(4));
        assert!(!address.note_second(at(41), VEHICLE, &4));
        assert_eq!(address.contender(at(42)), Some(VEHICLE));
        assert_eq!(address.contender(at(4_000)), None);
        assert_eq!(
            address.answered_at(at(50), VEHICLE),
            Some((Some(3), VEHICLE))
        );
    }

    #[test]
    fn a_ground_station_behind_a_copier_is_followed_and_stays() {
        let mut address = ProvenAddress::new(None);
        let (ground, ms) = (VEHICLE, |n: u64| at(20 * n));
        for n in 0..100 {
            address.prove(ms(n), ground, Sender::Beside, Some(n));
        }
        // It has another port, and a copier is faster.
        let moved_to = 7;
        for n in 100..1_000 {
            address.prove(ms(n), COPIER, Sender::Beside, Some(n));
            address.note_second(ms(n), moved_to, &n);
            if n % 50 == 0 && address.contender(ms(n)) == Some(moved_to) {
                address.answered_at(ms(n), moved_to);
            }
            let sent_to = address.get().into_iter().chain(address.others(ms(n)));
            assert!(sent_to.into_iter().any(|to| to == moved_to), "{n}");
            assert!(n < 300 || address.get() == Some(moved_to), "{n}");
        }
    }

    #[test]
    fn a_camera_neither_moves_nor_holds_what_leads_to_the_autopilot() {
        let mut address = ProvenAddress::new(None);
        let camera = 9;
        let mut prove = |ms, from, by| address.prove(at(ms), from, by, Some(ms)).is_some();
        assert!(prove(0, camera, Sender::Beside), "nothing else is known");
        assert!(prove(10, VEHICLE, Sender::Main), "at once");
        for n in 2..300 {
            assert!(!prove(10 * n, camera, Sender::Beside), "{n}");
            if n % 100 == 0 {
                assert!(!prove(10 * n + 5, VEHICLE, Sender::Main));
            }
        }
    }
}
