//! Who is sent the message of an exchange at once, while nothing has shown yet where the peer is.
//!
//! A request of the peer (step 0) is the same bytes each time, so a recording of it is as good as the original, and whoever
//! plays one from elsewhere can do so far more often than the peer asks. Sent to the latest caller alone, every message
//! would go there. So each address that calls is sent the message in progress once for its call: the peer among them is
//! reached whatever the others do, and who only had his address forged is sent little more than was sent in his name.

use core::time::Duration;
use std::collections::VecDeque;

/// The addresses that have called lately, and whether each has been answered.
#[derive(Debug)]
pub struct Callers<A> {
    /// In the order of their last calls.
    callers: VecDeque<Caller<A>>,
}

#[derive(Debug, Clone, Copy)]
struct Caller<A> {
    at: A,
    called: Duration,
    /// It has not been sent anything for its call.
    owed: bool,
}

impl<A> Default for Callers<A> {
    fn default() -> Self {
        Self {
            callers: VecDeque::new(),
        }
    }
}

impl<A: Copy + Eq> Callers<A> {
    /// Something that the peer can have made came from there.
    pub fn note(&mut self, from: A, now: Duration) {
        self.forget(now);
        match self.callers.iter().position(|one| one.at == from) {
            Some(place) if now.saturating_sub(self.callers[place].called) < CALLS_EVERY => return,
            Some(place) => {
                self.callers.remove(place);
            }
            // None is dropped for another: a crowd could drop the peer before it is answered.
            None if self.callers.len() >= MAX_CALLERS => return,
            None => {}
        }
        self.callers.push_back(Caller {
            at: from,
            called: now,
            owed: true,
        });
    }

    /// The message in progress has been sent there.
    pub fn served(&mut self, at: A) {
        let known = self.callers.iter_mut().filter(|one| one.at == at);
        known.for_each(|one| one.owed = false);
    }

    /// All that called lately are to be sent what begins now, since the peer may not call again in time.
    pub fn call_back(&mut self) {
        self.callers.iter_mut().for_each(|one| one.owed = true);
    }

    /// The next address to be sent the message in progress, with that message; where there is none yet, they wait for it.
    pub fn poll<M>(
        &mut self,
        now: Duration,
        message: impl FnOnce() -> Option<M>,
    ) -> Option<(A, M)> {
        self.forget(now);
        let caller = self.callers.iter_mut().find(|one| one.owed)?;
        let message = message()?;
        caller.owed = false;
        Some((caller.at, message))
    }

    fn forget(&mut self, now: Duration) {
        let old = |one: &Caller<A>| now.saturating_sub(one.called) >= REMEMBERED_FOR;
        while self.callers.front().is_some_and(old) {
            self.callers.pop_front();
        }
    }
}

/// How often a call from one address counts. A responder requests an exchange every ten seconds.
const CALLS_EVERY: Duration = Duration::from_secs(2);
/// How long a call waits for a message: until the peer has called again.
const REMEMBERED_FOR: Duration = Duration::from_secs(12);
/// With a message of 190 bytes each, at most 12 kB a second.
const MAX_CALLERS: usize = 128;

#[cfg(test)]
mod tests {
    use super::*;

    fn polled(callers: &mut Callers<u32>, ms: u64) -> Vec<u32> {
        let now = Duration::from_millis(ms);
        core::iter::from_fn(|| callers.poll(now, || Some(())).map(|(to, ())| to)).collect()
    }

    #[test]
    fn each_address_is_answered_once_for_its_call_however_often_others_call() {
        let mut callers = Callers::default();
        let mut answered = [0; 41];
        for ms in 0..30_000 {
            let now = Duration::from_millis(ms);
            for address in 1..41 {
                callers.note(address, now);
            }
            // The peer.
            if ms % 10_000 == 7 {
                callers.note(0, now);
                assert!(polled(&mut callers, ms).contains(&0));
            }
            for to in polled(&mut callers, ms) {
                answered[to as usize] += 1;
            }
        }
        assert!(
            answered[1..].iter().all(|&times| times == 15),
            "{answered:?}"
        );
    }

    #[test]
    fn a_call_waits_for_a_message_and_not_for_ever() {
        let mut callers = Callers::default();
        callers.note(1, Duration::ZERO);
        let later = Duration::from_secs(10);
        assert_eq!(callers.poll(later, || None::<()>), None);
        assert_eq!(polled(&mut callers, 10_000), [1]);
        assert!(polled(&mut callers, 10_000).is_empty());
        callers.call_back();
        callers.served(1);
        assert!(polled(&mut callers, 11_000).is_empty());
        callers.call_back();
        assert!(polled(&mut callers, 12_000).is_empty(), "forgotten");
    }

    #[test]
    fn ten_thousand_addresses_take_no_memory() {
        let mut callers = Callers::default();
        for address in 0..10_000 {
            callers.note(address, Duration::ZERO);
        }
        assert_eq!(callers.callers.len(), MAX_CALLERS);
        // Those who came first are answered.
        assert_eq!(polled(&mut callers, 0), (0..128).collect::<Vec<_>>());
    }
}
