//! Who is sent the message of an exchange at once, while nothing has shown yet where the peer is.
//!
//! A request of the peer (step 0) is the same bytes each time, so a recording of it is as good as the original, and whoever
//! plays one from elsewhere can do so far more often than the peer asks. Sent to the latest caller alone, every message
//! would go there. So each address that calls is sent the message in progress once for its call: the peer among them is
//! reached whatever the others do, and who only had his address forged is sent little more than was sent in his name.
//!
//! The addresses that are remembered are few, and one computer has 65,000 of them. So where computers can be distinguished, one
//! that has more places than others gives way to them ([`Callers::by_host`]).

use core::time::Duration;
use std::collections::VecDeque;

/// The addresses that have called lately, and whether each has been answered.
#[derive(Debug)]
pub struct Callers<A> {
    /// In the order of their last calls.
    callers: VecDeque<Caller<A>>,
    /// The computer of an address.
    host: Option<fn(A) -> u64>,
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
            host: None,
        }
    }
}

impl<A: Copy + Eq> Callers<A> {
    /// With the number of the computer that an address is of.
    #[must_use]
    pub fn by_host(host: fn(A) -> u64) -> Self {
        Self {
            host: Some(host),
            ..Self::default()
        }
    }

    /// Something that the peer can have made came from there.
    pub fn note(&mut self, from: A, now: Duration) {
        self.forget(now);
        match self.callers.iter().position(|one| one.at == from) {
            Some(place) if now.saturating_sub(self.callers[place].called) < CALLS_EVERY => return,
            Some(place) => {
                self.callers.remove(place);
            }
            None if self.callers.len() >= MAX_CALLERS => match self.gives_way_to(from) {
                Some(place) => {
                    self.callers.remove(place);
                }
                None => return,
            },
            None => {}
        }
        self.callers.push_back(Caller {
            at: from,
            called: now,
            owed: true,
        });
    }

    /// Who makes room for a newcomer: the latest caller of the computer that has the most places, where the newcomer's has fewer with
    /// this one. Nobody else: a crowd could drop the peer before it is answered.
    fn gives_way_to(&self, newcomer: A) -> Option<usize> {
        let host = self.host?;
        let mut hosts: Vec<u64> = self.callers.iter().map(|one| host(one.at)).collect();
        let own = hosts.iter().filter(|one| **one == host(newcomer)).count();
        hosts.sort_unstable();
        let most = hosts
            .chunk_by(|one, other| one == other)
            .max_by_key(|places| places.len())?;
        let crowd = most.first()?;
        let latest = self.callers.iter().rposition(|one| host(one.at) == *crowd);
        latest.filter(|_| most.len() > own + 1)
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
    fn ten_thousand_addresses_of_one_computer_keep_no_other_out() {
        let mut callers = Callers::by_host(|at: u32| u64::from(at / 100_000));
        let mut answered = 0;
        for ms in 0..60_000_u32 {
            // A new one each millisecond; all of them call again before they are forgotten.
            let now = Duration::from_millis(ms.into());
            callers.note(ms % 10_000, now);
            // The peer, on another computer, and later than they.
            if ms % 10_000 == 1_007 {
                callers.note(100_000, now);
            }
            let sent = polled(&mut callers, ms.into());
            answered += sent.iter().filter(|to| **to == 100_000).count();
        }
        assert_eq!(answered, 6);
        assert_eq!(callers.callers.len(), MAX_CALLERS);
    }

    #[test]
    fn a_crowd_of_computers_drops_nobody_who_was_there_before() {
        let mut callers = Callers::<u32>::by_host(u64::from);
        for address in 0..10_000_u32 {
            callers.note(address, Duration::ZERO);
        }
        assert_eq!(polled(&mut callers, 0), (0..128).collect::<Vec<_>>());
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
