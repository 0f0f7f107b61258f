//! Rate limits: how often anybody may make the responder compute.

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

/// The limits of one responder: verified frames have their own, so that no attacker can use them up.
#[derive(Debug)]
pub(super) struct Limits<A> {
    verified: Bucket,
    all: Bucket,
    addresses: [Option<(A, Bucket)>; ADDRESSES],
}

impl<A: Copy + Eq> Limits<A> {
    pub(super) fn new(now: Duration) -> Self {
        Self {
            verified: Bucket::full(EACH, now),
            all: Bucket::full(ALL, now),
            addresses: [None; ADDRESSES],
        }
    }

    /// Takes a token; false where there is none.
    pub(super) fn admit(&mut self, from: A, verified: bool, now: Duration) -> bool {
        // A bucket of its own: strangers must not use up the rate of a ground that holds the key.
        if verified {
            self.verified.refill(EACH, now);
            return take(&mut [&mut self.verified]);
        }
        self.all.refill(ALL, now);
        let address = address(&mut self.addresses, from, now);
        address.refill(EACH, now);
        take(&mut [&mut self.all, address])
    }
}

/// The bucket of an address; a new address takes the place of the one that was used least recently.
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

/// A second, in frames verified under the current key, and from each address.
const EACH: f32 = 5.0;
/// A second, from all addresses together.
const ALL: f32 = 20.0;
/// Addresses with a bucket of their own.
const ADDRESSES: usize = 16;

#[cfg(test)]
mod tests {
    use super::*;

    fn admitted(limits: &mut Limits<u16>, from: impl Fn(u32) -> u16, verified: bool) -> u32 {
        (0..10_000)
            .filter(|&n| limits.admit(from(n), verified, Duration::from_millis(n.into())))
            .count() as u32
    }

    #[test]
    fn ten_seconds_of_a_flood_are_admitted_at_the_stated_rates() {
        // The burst of one second, and ten seconds' worth.
        let mut limits = Limits::new(Duration::ZERO);
        assert_eq!(admitted(&mut limits, |_| 1, false), 54);
        let mut limits = Limits::new(Duration::ZERO);
        assert_eq!(admitted(&mut limits, |n| n as u16, false), 219);
        let mut limits = Limits::new(Duration::ZERO);
        assert_eq!(admitted(&mut limits, |_| 1, true), 54);
    }

    #[test]
    fn unverified_frames_cannot_use_up_the_limit_of_verified_ones() {
        let mut limits = Limits::new(Duration::ZERO);
        for n in 0..1_000 {
            limits.admit(n, false, Duration::ZERO);
        }
        assert!(!limits.admit(1_000, false, Duration::ZERO));
        assert!(limits.admit(1_000, true, Duration::ZERO));
    }
}
