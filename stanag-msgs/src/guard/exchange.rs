//! How two guards agree on a key: a step of the exchange in a datagram on the DLI's own port that is not a message of
//! the DLI.
//!
//! No datagram of the DLI begins like it: Editions 3 and 4 begin with 0x0000 or 0xFFFF, and Edition 2.5 with a digit.
//!
//! | offset | field | meaning |
//! |---|---|---|
//! | 0 | 2 bytes | `GX` |
//! | 2 | u8 | version 1 |
//! | 3 | u8 | direction: 1 CUCS to VSM, 2 VSM to CUCS |
//! | 4 | u32 | CUCS ID |
//! | 8 | u32 | VSM ID |
//! | 12 | 1 to 203 bytes | the step, laid out as MAVLink's KEY_EXCHANGE (229) of this project, without its last zeros |
//!
//! Nothing in it is authentic before the exchange's state machine has verified it: the ids only select the machine.
//!
//! ```
//! use stanag_msgs::Id;
//! use stanag_msgs::guard::{Direction, ExchangeDatagram};
//!
//! let step = ExchangeDatagram { direction: Direction::ToVsm, cucs: Id(0x1b00_00a0), vsm: Id(0x1b00_0001), payload: &[7, 8, 0] };
//! let bytes = step.to_bytes();
//! let read = ExchangeDatagram::parse(&bytes).unwrap();
//! assert_eq!((read.cucs, read.payload), (step.cucs, &[7, 8][..]));
//! assert!(ExchangeDatagram::parse(b"2.5 ...........").is_none());
//! ```

use super::Direction;
use crate::Id;

/// A step of an exchange between two guards.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct ExchangeDatagram<'a> {
    /// Its direction.
    pub direction: Direction,
    /// The CUCS beside which the guard is.
    pub cucs: Id,
    /// The VSM.
    pub vsm: Id,
    /// The step, for the exchange's state machine.
    pub payload: &'a [u8],
}

impl<'a> ExchangeDatagram<'a> {
    /// Reads one; `None` where it is something else. Anyone can send such bytes: nothing in them is verified yet.
    #[must_use]
    pub fn parse(bytes: &'a [u8]) -> Option<ExchangeDatagram<'a>> {
        let [b'G', b'X', VERSION, direction, rest @ ..] = bytes else {
            return None;
        };
        // Two ends agree on a key; a group is sent its key in an offer.
        let direction = Direction::of_code(*direction).filter(|way| *way != Direction::ToGroup)?;
        let (cucs, rest) = rest.split_first_chunk()?;
        let (vsm, payload) = rest.split_first_chunk()?;
        (1..=MAX_STEP)
            .contains(&payload.len())
            .then_some(ExchangeDatagram {
                direction,
                cucs: Id(u32::from_be_bytes(*cucs)),
                vsm: Id(u32::from_be_bytes(*vsm)),
                payload,
            })
    }

    /// The bytes to send. Bytes of the step beyond 203 are left out; no step has as many.
    #[must_use]
    pub fn to_bytes(&self) -> Vec<u8> {
        let used = self.payload.iter().rposition(|byte| *byte != 0);
        let used = used.map_or(1, |last| last + 1).min(MAX_STEP);
        let mut bytes = vec![b'G', b'X', VERSION, self.direction.code()];
        bytes.extend(self.cucs.0.to_be_bytes());
        bytes.extend(self.vsm.0.to_be_bytes());
        bytes.extend(self.payload.iter().take(used));
        bytes
    }
}

/// The version of these datagrams.
const VERSION: u8 = 1;
/// The longest payload of KEY_EXCHANGE.
const MAX_STEP: usize = 203;

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_written_is_read_and_nothing_else_is() {
        let step = ExchangeDatagram {
            direction: Direction::ToCucs,
            cucs: Id(1),
            vsm: Id(2),
            payload: &[5; MAX_STEP],
        };
        let bytes = step.to_bytes();
        assert_eq!(ExchangeDatagram::parse(&bytes), Some(step));
        assert_eq!(bytes[..12], [b'G', b'X', 1, 2, 0, 0, 0, 1, 0, 0, 0, 2]);
        for (at, other) in [(0, b'2'), (1, b'D'), (2, 2), (3, 0), (3, 3)] {
            let mut bent = bytes.clone();
            bent[at] = other;
            assert!(ExchangeDatagram::parse(&bent).is_none(), "byte {at}");
        }
        for length in 0..=12 {
            assert!(ExchangeDatagram::parse(&bytes[..length]).is_none());
        }
        assert!(ExchangeDatagram::parse(&[&bytes[..], &[1]].concat()).is_none());
    }
}
