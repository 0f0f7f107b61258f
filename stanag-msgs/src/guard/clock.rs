//! How two guards whose clocks are too far apart find the difference: a challenge that never existed before, and an
//! answer to it that only a holder of the key can give, and only then.
//!
//! No datagram of the DLI begins like these, and none with a trailer is one of them. A receiver that does not know
//! them drops them. They are as long as the shortest datagram with a trailer, so that no answer is longer than what
//! it answers, and nobody can use a guard to amplify traffic:
//!
//! | offset | field | meaning |
//! |---|---|---|
//! | 0 | 2 bytes | `GC` |
//! | 2 | u8 | version 1 |
//! | 3 | u8 | direction: 1 CUCS to VSM, 2 VSM to CUCS |
//! | 4 | u32 | sender: the CUCS ID, or the VSM ID |
//! | 8 | u16 | key id |
//! | 10 | u8 | 1 challenge, 2 answer |
//! | 11 | u8 | 0 |
//! | 12 | u64 | stamp, us since 1970: one of the sender's, used for nothing else |
//! | 20 | 32 bytes | HMAC-SHA256(key of the direction, "vsm-guard-clock-1", receiver ID, of an answer the HMAC of the challenge, the 20 bytes before) |
//!
//! An answer repeats no number: its HMAC covers the challenge's HMAC, which is of a stamp that is never used again,
//! and so is new and cannot be predicted without the key. An answer to another challenge does not verify.
//!
//! ```
//! use stanag_msgs::Id;
//! use stanag_msgs::guard::{ClockDatagram, Direction, GuardKey, Trailer};
//!
//! let key = GuardKey::new(&[7; 32]);
//! let (cucs, vsm) = (Id(0x1b00_00a0), Id(0x1b00_0001));
//! let to_cucs = Trailer { direction: Direction::ToCucs, sender: vsm, key_id: key.id(), stamp_us: 1 };
//! let to_vsm = Trailer { direction: Direction::ToVsm, sender: cucs, key_id: key.id(), stamp_us: 9 };
//!
//! let challenge = key.challenge(to_cucs, cucs);
//! let received = ClockDatagram::parse(&challenge.to_bytes()).unwrap();
//! assert!(key.verifies_challenge(&received, cucs));
//! let answer = key.answer(&received, to_vsm, vsm);
//! assert!(key.verifies_answer(&answer, vsm, &challenge));
//! let other = key.challenge(Trailer { stamp_us: 2, ..to_cucs }, cucs);
//! assert!(!key.verifies_answer(&answer, vsm, &other));
//! ```

use hmac::{Hmac, Mac as _};
use sha2::Sha256;

use super::{Direction, GuardKey, HEAD_BYTES, MAC_BYTES, TRAILER_BYTES, Trailer};
use crate::Id;

/// Challenge or answer.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ClockStep {
    /// Requests an answer from the other end.
    Challenge,
    /// The answer; its stamp is the time at the other end.
    Answer,
}

impl ClockStep {
    const fn code(self) -> u8 {
        match self {
            ClockStep::Challenge => 1,
            ClockStep::Answer => 2,
        }
    }

    const fn of_code(code: u8) -> Option<ClockStep> {
        match code {
            1 => Some(ClockStep::Challenge),
            2 => Some(ClockStep::Answer),
            _ => None,
        }
    }
}

/// A challenge or an answer. Nothing in it may be believed before it verifies.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct ClockDatagram {
    /// Challenge or answer.
    pub step: ClockStep,
    /// Sender, direction, key and stamp, as in a trailer.
    pub trailer: Trailer,
    mac: [u8; MAC_BYTES],
}

impl ClockDatagram {
    /// Reads one; `None` where it is something else. Anyone can send such bytes: nothing in them is verified yet.
    #[must_use]
    pub fn parse(bytes: &[u8]) -> Option<ClockDatagram> {
        let (head, mac) = bytes.split_first_chunk::<HEAD_BYTES>()?;
        let mac: [u8; MAC_BYTES] = mac.try_into().ok()?;
        let [b'G', b'C', VERSION, direction, fields @ ..] = head else {
            return None;
        };
        let (sender, fields) = fields.split_first_chunk()?;
        let (key_id, fields) = fields.split_first_chunk()?;
        let ([step, 0], stamp) = fields.split_first_chunk()? else {
            return None;
        };
        // A group never answers.
        let direction = Direction::of_code(*direction).filter(|way| *way != Direction::ToGroup)?;
        Some(ClockDatagram {
            step: ClockStep::of_code(*step)?,
            trailer: Trailer {
                direction,
                sender: Id(u32::from_be_bytes(*sender)),
                key_id: u16::from_be_bytes(*key_id),
                stamp_us: u64::from_be_bytes(*stamp.first_chunk()?),
            },
            mac,
        })
    }

    /// The bytes to send.
    #[must_use]
    pub fn to_bytes(&self) -> [u8; CLOCK_BYTES] {
        let mut bytes = [0; CLOCK_BYTES];
        let (head, mac) = bytes.split_at_mut(HEAD_BYTES);
        head.copy_from_slice(&head_of(self.step, &self.trailer));
        mac.copy_from_slice(&self.mac);
        bytes
    }
}

impl GuardKey {
    /// A challenge. Each stamp may be used once.
    #[must_use]
    pub fn challenge(&self, trailer: Trailer, receiver: Id) -> ClockDatagram {
        self.clock_datagram(ClockStep::Challenge, trailer, receiver, &[])
    }

    /// The answer to a challenge, which must have been verified before.
    #[must_use]
    pub fn answer(
        &self,
        challenge: &ClockDatagram,
        trailer: Trailer,
        receiver: Id,
    ) -> ClockDatagram {
        self.clock_datagram(ClockStep::Answer, trailer, receiver, &challenge.mac)
    }

    /// Whether it is a challenge that a holder of this key has made for this receiver, in constant time.
    #[must_use]
    pub fn verifies_challenge(&self, received: &ClockDatagram, receiver: Id) -> bool {
        received.step == ClockStep::Challenge && self.verifies_clock(received, receiver, &[])
    }

    /// Whether a holder of this key has answered this challenge by it, in constant time.
    #[must_use]
    pub fn verifies_answer(
        &self,
        received: &ClockDatagram,
        receiver: Id,
        challenge: &ClockDatagram,
    ) -> bool {
        received.step == ClockStep::Answer
            && self.verifies_clock(received, receiver, &challenge.mac)
    }

    fn clock_datagram(
        &self,
        step: ClockStep,
        trailer: Trailer,
        receiver: Id,
        asked: &[u8],
    ) -> ClockDatagram {
        let mac = self.clock_mac(step, &trailer, receiver, asked);
        ClockDatagram {
            step,
            trailer,
            mac: mac.finalize().into_bytes().into(),
        }
    }

    fn verifies_clock(&self, received: &ClockDatagram, receiver: Id, asked: &[u8]) -> bool {
        let expected = self.clock_mac(received.step, &received.trailer, receiver, asked);
        received.trailer.key_id == self.id && expected.verify_slice(&received.mac).is_ok()
    }

    fn clock_mac(
        &self,
        step: ClockStep,
        trailer: &Trailer,
        receiver: Id,
        asked: &[u8],
    ) -> Hmac<Sha256> {
        self.of_direction(trailer.direction)
            .chain_update(CONTEXT)
            .chain_update(receiver.0.to_be_bytes())
            .chain_update(asked)
            .chain_update(head_of(step, trailer))
    }
}

fn head_of(step: ClockStep, trailer: &Trailer) -> [u8; HEAD_BYTES] {
    let mut head = trailer.head();
    head[..3].copy_from_slice(&[b'G', b'C', VERSION]);
    head[10] = step.code();
    head
}

/// The length of each of them.
pub const CLOCK_BYTES: usize = TRAILER_BYTES;
/// The version of these datagrams.
const VERSION: u8 = 1;
const CONTEXT: &[u8] = b"vsm-guard-clock-1";

#[cfg(test)]
mod tests {
    use super::super::Guarded;
    use super::*;

    const CUCS: Id = Id(0x1b00_00a0);
    const VSM: Id = Id(0x1b00_0001);

    fn from(sender: Id, key: &GuardKey, stamp_us: u64) -> Trailer {
        Trailer {
            direction: if sender == VSM {
                Direction::ToCucs
            } else {
                Direction::ToVsm
            },
            sender,
            key_id: key.id(),
            stamp_us,
        }
    }

    #[test]
    fn what_is_written_is_read_and_no_bit_of_it_can_be_changed() {
        let key = GuardKey::new(&[1; 32]);
        let challenge = key.challenge(from(VSM, &key, 5), CUCS);
        let answer = key.answer(&challenge, from(CUCS, &key, 9), VSM);
        let verifies = |bytes: &[u8]| {
            ClockDatagram::parse(bytes).is_some_and(|one| {
                key.verifies_challenge(&one, CUCS) || key.verifies_answer(&one, VSM, &challenge)
            })
        };
        for one in [challenge, answer] {
            let bytes = one.to_bytes();
            assert_eq!(ClockDatagram::parse(&bytes), Some(one));
            assert!(verifies(&bytes));
            // Neither is a datagram with a trailer.
            assert_eq!(Guarded::parse(&bytes), None);
            for bit in 0..bytes.len() * 8 {
                let mut bent = bytes;
                bent[bit / 8] ^= 1 << (bit % 8);
                assert!(!verifies(&bent), "bit {bit}");
            }
            for length in 0..bytes.len() {
                assert!(ClockDatagram::parse(&bytes[..length]).is_none());
            }
            assert!(ClockDatagram::parse(&[&bytes[..], &[0]].concat()).is_none());
        }
    }

    #[test]
    fn an_answer_is_of_one_challenge_one_receiver_and_its_holders() {
        let (key, other) = (GuardKey::new(&[1; 32]), GuardKey::new(&[2; 32]));
        let challenge = key.challenge(from(VSM, &key, 5), CUCS);
        let answer = key.answer(&challenge, from(CUCS, &key, 9), VSM);
        assert!(key.verifies_answer(&answer, VSM, &challenge));
        assert!(!key.verifies_answer(&answer, Id(7), &challenge));
        assert!(!key.verifies_challenge(&answer, VSM));
        assert!(!key.verifies_answer(&challenge, CUCS, &challenge));
        assert!(!key.verifies_challenge(&challenge, Id(7)));
        for another in [
            key.challenge(from(VSM, &key, 6), CUCS),
            other.challenge(from(VSM, &other, 5), CUCS),
        ] {
            assert!(!key.verifies_answer(&answer, VSM, &another));
        }
        let forged = other.answer(&challenge, from(CUCS, &key, 9), VSM);
        assert!(!key.verifies_answer(&forged, VSM, &challenge));
    }
}
