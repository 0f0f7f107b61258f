//! Rate limits: how often anyone may make the responder compute.

use core::time::Duration;

/// A token bucket.
#[derive(Debug, Clone, Copy)]
struct Bucket {
    tokens: f32,
    at: Duration,
}

impl Bucket {
    fn full(rate: f32, now: Duration) -> Self {
        Self {
            tokens: rate,
            at: now,
        }
    }

    fn refill(&mut self, rate: f32, now: Duration) {
        let since = now.saturating_sub(self.at).as_secs_f32();
        (self.tokens, self.at) = ((self.tokens + since * rate).min(rate), now);
    }

    fn has(&self) -> bool {
        self.tokens >= 1.0
    }
}

/// What a sender has proved, beyond the authenticator that every admitted message has.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Claim {
    /// The frame is verified under the key in force.
    Verified,
    /// It is at its address.
    Proven,
    Nothing,
}

/// The limits of one responder. Verified frames, proven addresses, repetitions and refusals have their own, so that
/// messages which anyone can send or replay use up nothing that an honest peer needs.
#[derive(Debug)]
pub(super) struct Limits<A> {
    verified: Bucket,
    all: Bucket,
    again: Bucket,
    owner: Bucket,
    refusals: Bucket,
    addresses: [Option<(A, Bucket)>; ADDRESSES],
    proven: [Option<(A, Bucket)>; ADDRESSES],
}

impl<A: Copy + Eq> Limits<A> {
    pub(super) fn new(now: Duration) -> Self {
        Self {
            verified: Bucket::full(EACH, now),
            all: Bucket::full(ALL, now),
            again: Bucket::full(ALL, now),
            owner: Bucket::full(EACH, now),
            refusals: Bucket::full(EACH, now),
            addresses: [None; ADDRESSES],
            proven: [None; ADDRESSES],
        }
    }

    /// Takes a token for a message that costs a Diffie-Hellman; false where there is none.
    pub(super) fn admit(&mut self, from: A, claim: Claim, now: Duration) -> bool {
        match self.of_claim(from, claim, now) {
            Some(admitted) => admitted,
            None => {
                // A flood from many addresses meets the common bucket, a flood from one address its own.
                self.all.refill(ALL, now);
                let address = address(&mut self.addresses, from, now);
                address.refill(EACH, now);
                take(&mut [&mut self.all, address])
            }
        }
    }

    /// Takes a token for a message that is answered as before; `owner`: it comes from the address it first came from.
    /// Anyone can replay these, so they take nothing from new messages.
    pub(super) fn repeat(&mut self, from: A, claim: Claim, owner: bool, now: Duration) -> bool {
        match self.of_claim(from, claim, now) {
            Some(admitted) => admitted,
            None if owner => {
                self.owner.refill(EACH, now);
                take(&mut [&mut self.owner])
            }
            None => {
                self.again.refill(ALL, now);
                take(&mut [&mut self.again])
            }
        }
    }

    /// Takes a token for a refusal by step 15, which anyone can provoke.
    pub(super) fn refuse(&mut self, from: A, claim: Claim, now: Duration) -> bool {
        match self.of_claim(from, claim, now) {
            Some(admitted) => admitted,
            None => {
                self.refusals.refill(EACH, now);
                take(&mut [&mut self.refusals])
            }
        }
    }

    fn of_claim(&mut self, from: A, claim: Claim, now: Duration) -> Option<bool> {
        match claim {
            Claim::Verified => {
                self.verified.refill(EACH, now);
                Some(take(&mut [&mut self.verified]))
            }
            Claim::Proven => {
                let address = address(&mut self.proven, from, now);
                address.refill(EACH, now);
                Some(take(&mut [address]))
            }
            Claim::Nothing => None,
        }
    }
}

/// The bucket of an address. A new address replaces the least recently used one.
fn address<A: Copy + Eq>(
    addresses: &mut [Option<(A, Bucket)>; ADDRESSES],
    from: A,
    now: Duration,
) -> &mut Bucket {
    let known = addresses
        .iter()
        .position(|entry| entry.is_some_and(|(address, _)| address == from));
    let place = known.unwrap_or_else(|| {
        let oldest = |entry: &Option<(A, Bucket)>| entry.map(|(_, bucket)| bucket.at);
        (0..ADDRESSES)
            .min_by_key(|&at| oldest(&addresses[at]))
            .unwrap_or(0)
    });
    if known.is_none() {
        addresses[place] = None;
    }
    let (_, bucket) = addresses[place].get_or_insert((from, Bucket::full(EACH, now)));
    bucket
}

/// One from each, or from none.
fn take(buckets: &mut [&mut Bucket]) -> bool {
    let all = buckets.iter().all(|bucket| bucket.has());
    if all {
        buckets.iter_mut().for_each(|bucket| bucket.tokens -= 1.0);
    }
    all
}

/// A second, in frames verified under the current key, from each address, and of refusals.
const EACH: f32 = 5.0;
/// A second, from all addresses together.
const ALL: f32 = 20.0;
/// Addresses with a bucket of their own.
const ADDRESSES: usize = 16;

#[cfg(test)]
mod tests {
    use super::*;

    fn admitted(limits: &mut Limits<u16>, from: impl Fn(u32) -> u16, claim: Claim) -> u32 {
        (0..10_000)
            .filter(|&n| limits.admit(from(n), claim, Duration::from_millis(n.into())))
            .count() as u32
    }

    #[test]
    fn ten_seconds_of_a_flood_are_admitted_at_the_stated_rates() {
        // The burst of one second, and ten seconds' worth.
        let mut limits = Limits::new(Duration::ZERO);
        assert_eq!(admitted(&mut limits, |_| 1, Claim::Nothing), 54);
        let mut limits = Limits::new(Duration::ZERO);
        assert_eq!(admitted(&mut limits, |n| n as u16, Claim::Nothing), 219);
        let mut limits = Limits::new(Duration::ZERO);
        assert_eq!(admitted(&mut limits, |_| 1, Claim::Verified), 54);
        let mut limits = Limits::new(Duration::ZERO);
        assert_eq!(admitted(&mut limits, |_| 1, Claim::Proven), 54);
    }

    #[test]
    fn unverified_frames_cannot_use_up_the_limit_of_verified_ones() {
        let mut limits = Limits::new(Duration::ZERO);
        for n in 0..1_000 {
            limits.admit(n, Claim::Nothing, Duration::ZERO);
            limits.repeat(n, Claim::Nothing, false, Duration::ZERO);
            limits.refuse(n, Claim::Nothing, Duration::ZERO);
        }
        assert!(!limits.admit(1_000, Claim::Nothing, Duration::ZERO));
        assert!(limits.repeat(1_000, Claim::Nothing, true, Duration::ZERO));
        assert!(limits.admit(1_000, Claim::Proven, Duration::ZERO));
        assert!(limits.admit(1_000, Claim::Verified, Duration::ZERO));
    }
}
