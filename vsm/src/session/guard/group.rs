//! The group key at both ends: the VSM seals under it what it sends to its multicast group, a guard verifies that.
//!
//! Promised:
//! - The VSM makes another key with each start, and whenever a guard loses its own: who was locked out reads the group's datagrams still,
//!   as everybody does, and seals none that another guard takes.
//! - A guard takes nothing of the group twice, and nothing that was sent before it was given the key: the offer says up to which
//!   stamp. So nothing of the group is on any disk.
//! - Nothing that is sealed under a group key is ever taken by a VSM: every guard of the group could have sealed it.
//!
//! Offers are repeated: one that is lost is made up for by the next, [`OFFER_EVERY`] later.

use std::collections::BTreeMap;
use std::time::Duration;

use hmac::{Hmac, KeyInit as _, Mac as _};
use mavlink_link::Now;
use mavlink_link::signing::Stamp;
use sha2::Sha256;
use stanag_msgs::Id;
use stanag_msgs::guard::{Direction, GuardKey, Guarded, MAX_GUARDED, Offer, Trailer};
use zeroize::Zeroizing;

use super::{GuardRefusal, Window, micros, stamp_of};

/// The VSM's end.
#[derive(Debug)]
pub(crate) struct GroupSender {
    vsm: Id,
    secret: Zeroizing<[u8; 32]>,
    number: u32,
    key: GroupKey,
    /// Both clocks at the start: the wall clock is read once, as by a signing clock.
    start: Now,
    last: Stamp,
    /// When each guard was last offered the key, by its CUCS.
    offered: BTreeMap<Id, Duration>,
}

struct GroupKey {
    bytes: Zeroizing<[u8; 32]>,
    key: GuardKey,
}

impl std::fmt::Debug for GroupKey {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        self.key.fmt(f)
    }
}

impl GroupKey {
    fn new(bytes: Zeroizing<[u8; 32]>) -> GroupKey {
        let key = GuardKey::new(&bytes);
        GroupKey { bytes, key }
    }

    /// The `number`-th key of a run.
    fn of(secret: &[u8; 32], number: u32) -> GroupKey {
        let mut block = Zeroizing::new([0; 64]);
        block[..32].copy_from_slice(secret);
        let made = Hmac::<Sha256>::new((&*block).into())
            .chain_update(b"vsm group key")
            .chain_update(number.to_be_bytes());
        GroupKey::new(Zeroizing::new(made.finalize().into_bytes().into()))
    }
}

impl GroupSender {
    /// An end with its first key. `secret`: random, and for this run only.
    pub(crate) fn new(vsm: Id, secret: [u8; 32], now: Now) -> GroupSender {
        let secret = Zeroizing::new(secret);
        GroupSender {
            vsm,
            key: GroupKey::of(&secret, 0),
            secret,
            number: 0,
            start: now,
            last: Stamp::ZERO,
            offered: BTreeMap::new(),
        }
    }

    /// Another key from now on: a guard has lost its own.
    pub(crate) fn renew(&mut self) {
        self.number = self.number.wrapping_add(1);
        self.key = GroupKey::of(&self.secret, self.number);
        self.offered.clear();
    }

    /// Whether the guard of this CUCS is to be offered the key.
    pub(crate) fn offer_is_due(&self, cucs: Id, now: Duration) -> bool {
        let last = self.offered.get(&cucs);
        last.is_none_or(|at| *at + OFFER_EVERY <= now)
    }

    pub(crate) fn note_offered(&mut self, cucs: Id, now: Duration) {
        self.offered.insert(cucs, now);
    }

    /// What a guard is given.
    pub(crate) fn offer(&self) -> Offer {
        Offer {
            key: self.key.bytes.clone(),
            floor_us: micros(self.last),
        }
    }

    /// Seals a datagram for the group; its length.
    pub(crate) fn seal(
        &mut self,
        now: Now,
        datagram: &[u8],
        out: &mut [u8; MAX_GUARDED],
    ) -> Option<usize> {
        let passed = now.mono.saturating_sub(self.start.mono);
        let stamp = Stamp::from_unix(self.start.wall + passed);
        self.last = stamp.max(self.last.plus(ONE));
        let trailer = Trailer {
            direction: Direction::ToGroup,
            sender: self.vsm,
            key_id: self.key.key.id(),
            stamp_us: micros(self.last),
        };
        let sealed = self.key.key.seal(&trailer, Id::BROADCAST, datagram, out);
        sealed.ok()
    }
}

/// A guard's end.
#[derive(Debug)]
pub struct GroupReceiver {
    vsm: Id,
    key: Option<GroupKey>,
    floor: Stamp,
    window: Window,
}

impl GroupReceiver {
    /// An end that has been given no key yet.
    #[must_use]
    pub fn new(vsm: Id) -> GroupReceiver {
        GroupReceiver {
            vsm,
            key: None,
            floor: Stamp::ZERO,
            window: Window::default(),
        }
    }

    /// Takes what has arrived in a datagram that is sealed for this guard; true where the key is another than before.
    pub fn take(&mut self, offer: Offer) -> bool {
        // The same again: what has been taken under it stays taken.
        if self
            .key
            .as_ref()
            .is_some_and(|known| known.bytes == offer.key)
        {
            return false;
        }
        self.floor = stamp_of(offer.floor_us).unwrap_or(Stamp::ZERO);
        self.window = Window::default();
        self.key = Some(GroupKey::new(offer.key));
        true
    }

    /// The content of an accepted datagram of the group.
    ///
    /// # Errors
    /// It is not: why.
    pub fn open<'a>(
        &mut self,
        now: Duration,
        guarded: &Guarded<'a>,
    ) -> Result<&'a [u8], GuardRefusal> {
        let trailer = &guarded.trailer;
        if trailer.direction != Direction::ToGroup {
            return Err(GuardRefusal::Direction);
        }
        if trailer.sender != self.vsm {
            return Err(GuardRefusal::Sender);
        }
        let known = self.key.as_ref();
        let Some(key) = known.filter(|one| one.key.id() == trailer.key_id) else {
            return Err(GuardRefusal::Key);
        };
        if !key.key.verifies(guarded, Id::BROADCAST) {
            return Err(GuardRefusal::Forged);
        }
        let stamp = stamp_of(trailer.stamp_us).ok_or(GuardRefusal::Ahead)?;
        if stamp <= self.floor {
            return Err(GuardRefusal::Old);
        }
        self.window.judge(now, stamp)?;
        self.window.take(now, stamp);
        Ok(guarded.datagram)
    }
}

/// How often a guard is offered the key.
const OFFER_EVERY: Duration = Duration::from_secs(5);
/// The step of the stamps.
const ONE: Duration = Duration::from_micros(10);

#[cfg(test)]
mod tests {
    use super::*;

    const VSM: Id = Id(0x1b00_0001);

    fn at(s: u64) -> Now {
        Now {
            mono: Duration::from_secs(s),
            wall: Duration::from_secs(1_800_000_000 + s),
        }
    }

    fn sealed(sender: &mut GroupSender, s: u64) -> Vec<u8> {
        let mut out = [0; MAX_GUARDED];
        let length = sender.seal(at(s), b"status", &mut out).unwrap();
        out[..length].to_vec()
    }

    fn open(receiver: &mut GroupReceiver, s: u64, bytes: &[u8]) -> Result<(), GuardRefusal> {
        let guarded = Guarded::parse(bytes).unwrap();
        receiver.open(at(s).mono, &guarded).map(drop)
    }

    #[test]
    fn what_was_sent_under_the_key_is_taken_once_and_nothing_from_before_the_offer() {
        let mut sender = GroupSender::new(VSM, [3; 32], at(0));
        let mut receiver = GroupReceiver::new(VSM);
        let early = sealed(&mut sender, 1);
        assert_eq!(open(&mut receiver, 1, &early), Err(GuardRefusal::Key));
        assert!(receiver.take(sender.offer()));
        assert_eq!(open(&mut receiver, 1, &early), Err(GuardRefusal::Old));
        let one = sealed(&mut sender, 2);
        let other = sealed(&mut sender, 2);
        // In another order.
        assert_eq!(open(&mut receiver, 2, &other), Ok(()));
        assert_eq!(open(&mut receiver, 2, &one), Ok(()));
        for again in [&one, &other] {
            assert_eq!(open(&mut receiver, 2, again), Err(GuardRefusal::Replayed));
        }
        // The same offer once more makes nothing new of what was taken.
        assert!(!receiver.take(sender.offer()));
        assert_eq!(open(&mut receiver, 3, &one), Err(GuardRefusal::Replayed));
        // A guard that was started again is given the floor of now.
        let mut started = GroupReceiver::new(VSM);
        assert!(started.take(sender.offer()));
        assert_eq!(open(&mut started, 3, &other), Err(GuardRefusal::Old));
        let late = sealed(&mut sender, 4);
        let next = sealed(&mut sender, 40);
        assert_eq!(open(&mut started, 40, &next), Ok(()));
        assert_eq!(open(&mut started, 40, &late), Err(GuardRefusal::Late));
    }

    #[test]
    fn another_key_ends_the_one_before_and_another_start_has_others() {
        let mut sender = GroupSender::new(VSM, [3; 32], at(0));
        let mut receiver = GroupReceiver::new(VSM);
        receiver.take(sender.offer());
        let before = sealed(&mut sender, 1);
        sender.renew();
        assert!(receiver.take(sender.offer()));
        assert!(open(&mut receiver, 1, &before).is_err());
        let mut locked_out = GroupReceiver::new(VSM);
        locked_out.take(GroupSender::new(VSM, [3; 32], at(0)).offer());
        let bytes = sealed(&mut sender, 2);
        assert!(open(&mut locked_out, 2, &bytes).is_err());
        assert_eq!(open(&mut receiver, 2, &bytes), Ok(()));
        let other = GroupSender::new(VSM, [4; 32], at(0));
        assert_ne!(other.offer().key, sender.offer().key);
    }

    #[test]
    fn a_clock_that_was_set_back_neither_repeats_a_stamp_nor_silences_the_group() {
        let mut sender = GroupSender::new(VSM, [3; 32], at(0));
        let mut receiver = GroupReceiver::new(VSM);
        receiver.take(sender.offer());
        for s in 0..200 {
            let now = Now {
                mono: at(s).mono,
                wall: at(s).wall - Duration::from_secs(86_400 * s),
            };
            let mut out = [0; MAX_GUARDED];
            let length = sender.seal(now, b"status", &mut out).unwrap();
            assert_eq!(open(&mut receiver, s, &out[..length]), Ok(()), "{s}");
        }
    }

    #[test]
    fn nobody_but_the_vsm_is_believed_to_send_to_the_group() {
        let mut sender = GroupSender::new(Id(5), [3; 32], at(0));
        let mut receiver = GroupReceiver::new(VSM);
        receiver.take(sender.offer());
        let bytes = sealed(&mut sender, 1);
        assert_eq!(open(&mut receiver, 1, &bytes), Err(GuardRefusal::Sender));
        let mut sender = GroupSender::new(VSM, [3; 32], at(0));
        let mut bytes = sealed(&mut sender, 1);
        bytes[0] ^= 1;
        assert_eq!(open(&mut receiver, 1, &bytes), Err(GuardRefusal::Forged));
    }
}
