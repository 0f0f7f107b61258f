//! The order to zeroize: the ground makes its agent erase itself, in steps 6 and 7 of KEY_EXCHANGE (229).
//!
//! ```text
//! ground -> air   6  order, a number of the ground's, no challenge
//! ground <- air   7  the challenge for that number
//! ground -> air   6  order, number, challenge
//! ground <- air   7  number, report: stored, or refused with the reason
//! ```
//!
//! Promised: both steps carry the authenticator of the two pinned static keys ([`gate`](super::gate)), so a holder of the
//! signing key, or of the key of another vehicle's agent, can order nothing. An order counts once, and only with a
//! challenge that this process has given for its number within 20 s, so neither a recording nor a delayed order has any
//! effect. A report names the number that the ground has just drawn.

use core::fmt;

use super::message::Data;
use super::stats::Ignored;
use super::terms::Parties;

/// Of an order, or of the agent's challenge for it.
pub(super) type Nonce = [u8; 16];

/// What the air side has done about an order to zeroize.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ZeroizeReport {
    /// Nothing is erased there.
    Refused(ZeroizeRefusal),
    /// The order is stored there and is being carried out; with the state of the autopilot's key.
    Stored(AutopilotKey),
}

/// Why the air side refuses an order.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ZeroizeRefusal {
    /// 1: the autopilot is not known to be disarmed.
    InFlight,
    /// 2: its disk has not taken the order.
    NotStored,
    /// Any other.
    Unknown(u8),
}

/// The state of the autopilot's signing key, which is to be replaced by one that nobody keeps.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum AutopilotKey {
    /// 0: the agent is sending it another key.
    Pending,
    /// 1: it signs with the other key.
    Replaced,
    /// 2: it has not taken the other key.
    NotTaken,
    /// 3: it does not answer.
    NotReached,
    /// 4: it keeps its own, by the agent's configuration.
    Kept,
    /// 5: it is armed, and PX4 takes no key while armed.
    Armed,
    /// Any other.
    Unknown(u8),
}

impl ZeroizeReport {
    /// Whether no further report follows.
    #[must_use]
    pub fn is_final(self) -> bool {
        self != ZeroizeReport::Stored(AutopilotKey::Pending)
    }

    fn to_wire(self) -> [u8; 2] {
        match self {
            ZeroizeReport::Refused(why) => [
                REFUSED,
                match why {
                    ZeroizeRefusal::InFlight => 1,
                    ZeroizeRefusal::NotStored => 2,
                    ZeroizeRefusal::Unknown(other) => other,
                },
            ],
            ZeroizeReport::Stored(key) => [
                STORED,
                match key {
                    AutopilotKey::Pending => 0,
                    AutopilotKey::Replaced => 1,
                    AutopilotKey::NotTaken => 2,
                    AutopilotKey::NotReached => 3,
                    AutopilotKey::Kept => 4,
                    AutopilotKey::Armed => 5,
                    AutopilotKey::Unknown(other) => other,
                },
            ],
        }
    }

    fn from_wire(kind: u8, detail: u8) -> Option<ZeroizeReport> {
        match kind {
            REFUSED => Some(ZeroizeReport::Refused(match detail {
                1 => ZeroizeRefusal::InFlight,
                2 => ZeroizeRefusal::NotStored,
                other => ZeroizeRefusal::Unknown(other),
            })),
            STORED => Some(ZeroizeReport::Stored(match detail {
                0 => AutopilotKey::Pending,
                1 => AutopilotKey::Replaced,
                2 => AutopilotKey::NotTaken,
                3 => AutopilotKey::NotReached,
                4 => AutopilotKey::Kept,
                5 => AutopilotKey::Armed,
                other => AutopilotKey::Unknown(other),
            })),
            _ => None,
        }
    }
}

impl fmt::Display for ZeroizeReport {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Refused(why) => write!(f, "the agent refuses, and erases nothing: {why}"),
            Self::Stored(key) => write!(f, "the agent erases itself; {key}"),
        }
    }
}

impl fmt::Display for ZeroizeRefusal {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::InFlight => "PX4 is not known to be disarmed",
            Self::NotStored => "its disk does not take the order",
            Self::Unknown(other) => return write!(f, "reason {other}"),
        })
    }
}

impl fmt::Display for AutopilotKey {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Pending => "PX4 is being given a key that nobody keeps",
            Self::Replaced => "PX4 has taken a key that nobody keeps",
            Self::NotTaken => "PX4 has NOT taken another key, and keeps its own",
            Self::NotReached => "PX4 was NOT reached, and may have its key still",
            Self::Kept => "PX4 keeps its key, as the agent is configured",
            Self::Armed => "PX4 is armed, takes no key, and keeps its own",
            Self::Unknown(other) => return write!(f, "what PX4 has is not known ({other})"),
        })
    }
}

/// Step 6.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Order {
    /// The ground's number of it.
    pub(super) number: Nonce,
    /// The agent's, once it has given one.
    pub(super) challenge: Option<Nonce>,
    /// Valid also while the autopilot is not known to be disarmed.
    pub(super) in_flight: bool,
}

/// Step 7.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Answer {
    Challenge(Nonce),
    Report(ZeroizeReport),
}

impl Order {
    /// Number, challenge or zeros, VSM and vehicle id (big-endian), flags.
    pub(super) fn to_data(self, parties: &Parties) -> Option<Data> {
        let mut bytes = [0; 41];
        bytes[..16].copy_from_slice(&self.number);
        bytes[16..32].copy_from_slice(&self.challenge.unwrap_or_default());
        bytes[32..40].copy_from_slice(&ids(parties));
        bytes[40] = ORDERED | if self.in_flight { IN_FLIGHT } else { 0 };
        Data::new(&bytes)
    }

    /// `Err` for data that are no order, or an order for another VSM or vehicle.
    pub(super) fn parse(data: &Data, parties: &Parties) -> Result<Order, Ignored> {
        let (order, whose) = Order::split(data).ok_or(Ignored::Step)?;
        if whose == ids(parties) {
            Ok(order)
        } else {
            Err(Ignored::Target)
        }
    }

    fn split(data: &Data) -> Option<(Order, [u8; 8])> {
        let bytes: &[u8; 41] = data.as_slice().try_into().ok()?;
        let (number, rest) = bytes.split_first_chunk::<16>()?;
        let (challenge, rest) = rest.split_first_chunk::<16>()?;
        let (whose, rest) = rest.split_first_chunk::<8>()?;
        let flags = *rest.first()?;
        // A later version may give an unknown flag a meaning that this version would violate, so the order is refused.
        if flags & ORDERED == 0 || flags & !(ORDERED | IN_FLIGHT) != 0 {
            return None;
        }
        let order = Order {
            number: *number,
            // Zeros stand for "no challenge yet": the ground asks for one.
            challenge: Some(*challenge).filter(|challenge| *challenge != Nonce::default()),
            in_flight: flags & IN_FLIGHT != 0,
        };
        Some((order, *whose))
    }
}

impl Answer {
    /// Kind, detail, number, challenge or zeros.
    pub(super) fn to_data(self, number: &Nonce) -> Option<Data> {
        let mut bytes = [0; 34];
        let challenge = match self {
            Answer::Challenge(challenge) => {
                bytes[0] = CHALLENGE;
                challenge
            }
            Answer::Report(report) => {
                bytes[..2].copy_from_slice(&report.to_wire());
                Nonce::default()
            }
        };
        bytes[2..18].copy_from_slice(number);
        bytes[18..].copy_from_slice(&challenge);
        Data::new(&bytes)
    }

    /// The number that it answers, and the answer; `None` for other data.
    pub(super) fn parse(data: &Data) -> Option<(Nonce, Answer)> {
        let bytes: &[u8; 34] = data.as_slice().try_into().ok()?;
        let ([kind, detail], rest) = bytes.split_first_chunk::<2>()?;
        let (number, rest) = rest.split_first_chunk::<16>()?;
        let answer = match *kind {
            CHALLENGE => Answer::Challenge(*rest.first_chunk::<16>()?),
            kind => Answer::Report(ZeroizeReport::from_wire(kind, *detail)?),
        };
        Some((*number, answer))
    }
}

fn ids(parties: &Parties) -> [u8; 8] {
    let mut ids = [0; 8];
    ids[..4].copy_from_slice(&parties.vsm_id.to_be_bytes());
    ids[4..].copy_from_slice(&parties.vehicle_id.to_be_bytes());
    ids
}

const CHALLENGE: u8 = 1;
const REFUSED: u8 = 2;
const STORED: u8 = 3;
const ORDERED: u8 = 1;
const IN_FLIGHT: u8 = 2;

#[cfg(test)]
mod tests {
    use super::*;
    use crate::frame::Node;

    fn parties(vehicle: u32) -> Parties {
        let node = |system, component| Node { system, component };
        Parties::new(node(245, 190), node(1, 191), 0x1b00_0001, vehicle)
    }

    #[test]
    fn orders_come_back_from_their_bytes_and_others_are_none() {
        for challenge in [None, Some([3; 16])] {
            for in_flight in [false, true] {
                let order = Order {
                    number: [7; 16],
                    challenge,
                    in_flight,
                };
                let data = order.to_data(&parties(1)).unwrap();
                assert_eq!(Order::parse(&data, &parties(1)), Ok(order));
                assert_eq!(Order::parse(&data, &parties(2)), Err(Ignored::Target));
                for flags in [0, 2, 4, 5, 255] {
                    let mut bytes = data.as_slice().to_vec();
                    bytes[40] = flags;
                    let data = Data::new(&bytes).unwrap();
                    let parsed = Order::parse(&data, &parties(1));
                    assert_eq!(parsed, Err(Ignored::Step), "flags {flags}");
                }
                let short = Data::new(&data.as_slice()[..40]).unwrap();
                assert_eq!(Order::parse(&short, &parties(1)), Err(Ignored::Step));
            }
        }
    }

    #[test]
    fn every_answer_comes_back_from_its_bytes() {
        let mut answers = vec![Answer::Challenge([5; 16])];
        for detail in 0..=255 {
            for kind in [REFUSED, STORED] {
                let report = ZeroizeReport::from_wire(kind, detail).unwrap();
                assert_eq!(report.to_wire(), [kind, detail]);
                assert!(!report.to_string().is_empty());
                answers.push(Answer::Report(report));
            }
        }
        for answer in answers {
            let data = answer.to_data(&[9; 16]).unwrap();
            assert_eq!(Answer::parse(&data), Some(([9; 16], answer)));
        }
        let unknown = Data::new(&[9; 34]).unwrap();
        assert_eq!(Answer::parse(&unknown), None);
        assert_eq!(Answer::parse(&Data::EMPTY), None);
    }
}
