//! Which of two addresses leads to the other end, where frames of it come from both.
//!
//! A frame that verifies can be a copy, but an answer to a PING shows that the PING has arrived, and each PING has a number
//! of its own ([`challenge`](super::challenge)). So both addresses are asked once a second. The link moves only to one that
//! answers while the known one does not. Where both answer, one of them passes PINGs on: both are sent to
//! ([`Link::others`](super::Link::others)).

use core::time::Duration;

/// The questions of the last second.
#[derive(Debug)]
pub(super) struct PathProbe<A> {
    begun: Duration,
    /// The known address, and the other.
    places: Option<[Place<A>; 2]>,
}

#[derive(Debug, Clone, Copy)]
struct Place<A> {
    at: A,
    /// The number of its PING, once that is sent.
    number: Option<u64>,
    answered: bool,
}

impl<A: Copy + Eq> PathProbe<A> {
    pub(super) fn new() -> Self {
        Self {
            begun: Duration::ZERO,
            places: None,
        }
    }

    /// The other end may be at `other` instead of `known`. Returns true where the last second has shown that it is.
    pub(super) fn compare(&mut self, known: A, other: A, mono: Duration) -> bool {
        let age = mono.saturating_sub(self.begun);
        if self.places.is_some() && age < ROUND {
            return false;
        }
        let same = |[a, b]: &[Place<A>; 2]| (a.at, b.at) == (known, other);
        let asked = self.places.filter(|places| same(places) && age < LATE);
        if let Some([known, other]) = asked {
            if other.answered && !known.answered {
                self.places = None;
                return true;
            }
            // Nothing is wrong, and each PING costs a slow radio: the next comparison can wait.
            if known.answered && age < PAUSE {
                return false;
            }
        }
        self.begun = mono;
        self.places = Some([known, other].map(|at| Place {
            at,
            number: None,
            answered: false,
        }));
        false
    }

    /// Whom to ask next.
    pub(super) fn due(&self) -> Option<A> {
        let mut places = self.places.iter().flatten();
        places.find_map(|place| place.number.is_none().then_some(place.at))
    }

    /// It was asked with this number.
    pub(super) fn asked(&mut self, at: A, number: u64) {
        if let Some(place) = self
            .places
            .iter_mut()
            .flatten()
            .find(|place| place.at == at)
        {
            place.number = Some(number);
        }
    }

    /// The PING with this number was answered, from wherever.
    pub(super) fn answered(&mut self, number: u64) {
        for place in self.places.iter_mut().flatten() {
            place.answered |= place.number == Some(number);
        }
    }
}

/// How long an answer is waited for: over a slower line nothing is decided here.
const ROUND: Duration = Duration::from_secs(1);
/// How long the known address stands after it has answered.
const PAUSE: Duration = Duration::from_secs(5);
/// Answers of a comparison that was broken off are no longer looked at.
const LATE: Duration = Duration::from_secs(10);

#[cfg(test)]
mod tests {
    use super::*;

    /// Asks 1 and 2, and lets those answer.
    fn round(answers: &[u8]) -> bool {
        let mut probe = PathProbe::<u8>::new();
        let at = Duration::from_millis;
        assert!(!probe.compare(1, 2, at(5_000)));
        while let Some(to) = probe.due() {
            probe.asked(to, 70 + u64::from(to));
        }
        for &who in answers {
            probe.answered(70 + u64::from(who));
        }
        probe.answered(99);
        assert!(!probe.compare(1, 2, at(5_990)), "not before a second");
        probe.compare(1, 2, at(6_000))
    }

    #[test]
    fn only_an_answer_of_the_other_alone_moves_it() {
        assert!(round(&[2]));
        assert!(!round(&[1]) && !round(&[1, 2]) && !round(&[]));
    }

    #[test]
    fn answers_of_another_comparison_do_not_count() {
        for (known, other, ms) in [(1, 3, 6_000), (3, 2, 6_000), (1, 2, 15_000)] {
            let mut probe = PathProbe::new();
            let at = Duration::from_millis;
            probe.compare(1, 2, at(5_000));
            probe.asked(2, 72);
            probe.answered(72);
            assert!(!probe.compare(known, other, at(ms)));
        }
    }
}
