//! KEY_EXCHANGE (229) as bytes: one layout, parsed strictly and written canonically.
//!
//! Promised: no input panics or allocates; what is read and written again is the same bytes but for the zeros that
//! MAVLink 2 trims. A payload of at most 32 bytes, or version 0, is the legacy exchange and never anything else.

use core::fmt;

use subtle::ConstantTimeEq as _;
use thiserror::Error;

use super::identity::PublicKey;
use crate::frame::Node;

/// The longest payload of KEY_EXCHANGE, bytes.
pub const MAX_MESSAGE: usize = 203;
/// The most bytes of `data`.
pub const MAX_DATA: usize = 160;
/// The version of the exchange that this crate speaks. Version 1 had no authenticator before the handshake, so anyone's
/// first message cost the responder a Diffie-Hellman and a session.
pub const VERSION: u8 = 2;

/// A message as received from the radio.
#[derive(Debug, Clone, Copy)]
pub struct Inbound<'a, A> {
    /// Where it came from; the answer is sent there.
    pub from: A,
    /// System and component of the frame's header.
    pub source: Node,
    /// Whether the frame was verified under the current key.
    pub verified: bool,
    /// The payload, trailing zeros trimmed.
    pub payload: &'a [u8],
}

/// What was received: an exchange of this version, or the bare public key of the legacy exchange.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Received {
    /// The extended message.
    Exchange(Message),
    /// The public key alone, unauthenticated.
    Legacy(PublicKey),
}

/// One step of an exchange.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Message {
    /// 229.public_key: the sender's ephemeral key, in every step; zero in steps 0 and 15.
    pub public_key: [u8; 32],
    /// 229.session: chosen at random by the initiator; 0 only in step 0.
    pub session: u32,
    /// 229.version, [`VERSION`] for all that is known here.
    pub version: u8,
    /// 229.step.
    pub step: Step,
    /// 229.suite as on the wire; see [`Suite`].
    pub suite: u8,
    /// 229.status as on the wire; unauthenticated, see [`Status`].
    pub status: Status,
    /// 229.target_system and target_component: matched exactly, there is no broadcast.
    pub target: Node,
    /// 229.data up to 229.length.
    pub data: Data,
}

/// 229.step.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Step {
    /// 0: the responder requests an exchange. Only a hint, since anybody can send it.
    Please,
    /// 1: the initiator's ephemeral key and first Noise message.
    Offer,
    /// 2: the responder's.
    Answer,
    /// 3: the initiator's confirmation.
    Confirm,
    /// 4: the responder's confirmation and the state of the key.
    Outcome,
    /// 5: the responder, under load, requires the initiator to prove its address.
    Cookie,
    /// 6: the initiator orders the responder to zeroize.
    Order,
    /// 7: the responder's challenge for an order, or the order's outcome.
    Report,
    /// 15: refused, with a status. Unauthenticated, so it changes nothing.
    Reject,
    /// Any other.
    Unknown(u8),
}

impl From<u8> for Step {
    fn from(raw: u8) -> Self {
        match raw {
            0 => Self::Please,
            1 => Self::Offer,
            2 => Self::Answer,
            3 => Self::Confirm,
            4 => Self::Outcome,
            5 => Self::Cookie,
            6 => Self::Order,
            7 => Self::Report,
            15 => Self::Reject,
            other => Self::Unknown(other),
        }
    }
}

impl From<Step> for u8 {
    fn from(step: Step) -> Self {
        match step {
            Step::Please => 0,
            Step::Offer => 1,
            Step::Answer => 2,
            Step::Confirm => 3,
            Step::Outcome => 4,
            Step::Cookie => 5,
            Step::Order => 6,
            Step::Report => 7,
            Step::Reject => 15,
            Step::Unknown(other) => other,
        }
    }
}

/// 229.suite: the Noise protocol. One for each peer; nothing is negotiated, so nothing can be downgraded.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Suite {
    /// 1, `Noise_KK_25519_ChaChaPoly_SHA256`: both know the other's static key.
    Pinned,
    /// 2, `Noise_XXpsk3_25519_ChaChaPoly_SHA256`: both know the pairing code.
    Pairing,
}

impl Suite {
    /// The suite of a number on the wire, if it is known.
    #[must_use]
    pub const fn from_wire(raw: u8) -> Option<Self> {
        match raw {
            1 => Some(Self::Pinned),
            2 => Some(Self::Pairing),
            _ => None,
        }
    }

    /// The number on the wire.
    #[must_use]
    pub const fn to_wire(self) -> u8 {
        match self {
            Self::Pinned => 1,
            Self::Pairing => 2,
        }
    }
}

/// 229.status, and the first byte of step 4's body.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Status {
    /// 0: no fault.
    Ok,
    /// 1: another key is being installed in the autopilot, and is not replaced.
    Busy,
    /// 2: the key waits until the vehicle is disarmed.
    WaitDisarm,
    /// 3: SETUP_SIGNING has been sent.
    Sent,
    /// 4: the autopilot signs with the key.
    Active,
    /// 5: the autopilot did not take the key; the old one stays.
    RolledBack,
    /// 6: the autopilot is silent; both keys are kept.
    Silent,
    /// 7: the autopilot cannot sign.
    CannotSign,
    /// 8: the session is unknown, or has expired.
    UnknownSession,
    /// 9: refused.
    Refused,
    /// 10: this end speaks another version of the exchange.
    OtherVersion,
    /// Any other.
    Unknown(u8),
}

impl From<u8> for Status {
    fn from(raw: u8) -> Self {
        match raw {
            0 => Self::Ok,
            1 => Self::Busy,
            2 => Self::WaitDisarm,
            3 => Self::Sent,
            4 => Self::Active,
            5 => Self::RolledBack,
            6 => Self::Silent,
            7 => Self::CannotSign,
            8 => Self::UnknownSession,
            9 => Self::Refused,
            10 => Self::OtherVersion,
            other => Self::Unknown(other),
        }
    }
}

impl From<Status> for u8 {
    fn from(status: Status) -> Self {
        match status {
            Status::Ok => 0,
            Status::Busy => 1,
            Status::WaitDisarm => 2,
            Status::Sent => 3,
            Status::Active => 4,
            Status::RolledBack => 5,
            Status::Silent => 6,
            Status::CannotSign => 7,
            Status::UnknownSession => 8,
            Status::Refused => 9,
            Status::OtherVersion => 10,
            Status::Unknown(other) => other,
        }
    }
}

impl fmt::Display for Status {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Ok => "ok",
            Self::Busy => "busy with another key",
            Self::WaitDisarm => "waiting until the vehicle is disarmed",
            Self::Sent => "sent to the autopilot",
            Self::Active => "in use by the autopilot",
            Self::RolledBack => "not taken by the autopilot; the old key stays in use",
            Self::Silent => "no data from the autopilot; both keys are kept",
            Self::CannotSign => "the autopilot cannot sign",
            Self::UnknownSession => "unknown session",
            Self::Refused => "refused",
            Self::OtherVersion => "another version of the exchange; update the older end",
            Self::Unknown(other) => return write!(f, "unknown status {other}"),
        })
    }
}

/// 229.data: at most [`MAX_DATA`] bytes.
#[derive(Clone)]
pub struct Data {
    bytes: [u8; MAX_DATA],
    len: usize,
}

impl Data {
    /// No bytes.
    pub const EMPTY: Self = Self {
        bytes: [0; MAX_DATA],
        len: 0,
    };

    /// These bytes, where they fit.
    #[must_use]
    pub fn new(bytes: &[u8]) -> Option<Self> {
        let mut data = Self::EMPTY;
        data.bytes.get_mut(..bytes.len())?.copy_from_slice(bytes);
        data.len = bytes.len();
        Some(data)
    }

    /// The bytes.
    #[must_use]
    pub fn as_slice(&self) -> &[u8] {
        &self.bytes[..self.len]
    }
}

impl PartialEq for Data {
    fn eq(&self, other: &Self) -> bool {
        // Constant time: the other message may come from an attacker.
        self.len == other.len && bool::from(self.bytes.ct_eq(&other.bytes))
    }
}

impl Eq for Data {}

impl fmt::Debug for Data {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} bytes", self.len)
    }
}

impl Message {
    /// Parses a payload as received, trailing zeros trimmed.
    ///
    /// # Errors
    /// It is too long, claims more data than fits, or has bytes where there must be zeros.
    pub fn parse(payload: &[u8]) -> Result<Received, MessageError> {
        let mut bytes = [0; MAX_MESSAGE];
        bytes
            .get_mut(..payload.len())
            .ok_or(MessageError::TooLong { len: payload.len() })?
            .copy_from_slice(payload);
        let mut public_key = [0; 32];
        public_key.copy_from_slice(&bytes[..32]);
        let version = bytes[36];
        if payload.len() <= 32 || version == 0 {
            return Ok(Received::Legacy(PublicKey::new(public_key)));
        }
        let len = usize::from(bytes[42]);
        if len > MAX_DATA {
            return Err(MessageError::Length { length: bytes[42] });
        }
        // Strict, so that each message has one encoding, and bytes that the authenticator does not cover carry nothing.
        let (data, rest) = bytes[43..].split_at(len);
        if let Some(at) = rest.iter().position(|&byte| byte != 0) {
            return Err(MessageError::Beyond {
                offset: 43 + len + at,
            });
        }
        Ok(Received::Exchange(Self {
            public_key,
            session: u32::from_le_bytes([bytes[32], bytes[33], bytes[34], bytes[35]]),
            version,
            step: bytes[37].into(),
            suite: bytes[38],
            status: bytes[39].into(),
            target: Node {
                system: bytes[40],
                component: bytes[41],
            },
            data: Data::new(data).unwrap_or(Data::EMPTY),
        }))
    }

    /// Whether a payload is a request for an exchange (step 0).
    #[must_use]
    pub fn is_request(payload: &[u8]) -> bool {
        matches!(Self::parse(payload), Ok(Received::Exchange(message)) if message.step == Step::Please)
    }

    /// The whole payload; the frame encoder trims its trailing zeros.
    #[must_use]
    pub fn to_payload(&self) -> [u8; MAX_MESSAGE] {
        let mut bytes = [0; MAX_MESSAGE];
        bytes[..32].copy_from_slice(&self.public_key);
        bytes[32..36].copy_from_slice(&self.session.to_le_bytes());
        bytes[36] = self.version;
        bytes[37] = self.step.into();
        bytes[38] = self.suite;
        bytes[39] = self.status.into();
        bytes[40] = self.target.system;
        bytes[41] = self.target.component;
        // `Data` holds at most 160 bytes, so this cannot fail.
        bytes[42] = u8::try_from(self.data.len).unwrap_or(0);
        bytes[43..].copy_from_slice(&self.data.bytes);
        bytes
    }
}

/// Why a payload is not a KEY_EXCHANGE.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Error)]
pub enum MessageError {
    /// More bytes than the message has.
    #[error("a payload of {len} bytes, expected at most 203")]
    TooLong {
        /// Bytes found.
        len: usize,
    },
    /// 229.length.
    #[error("length is {length}, expected at most 160")]
    Length {
        /// The value found.
        length: u8,
    },
    /// A byte other than zero follows the data.
    #[error("a byte beyond the data at offset {offset}, expected zeros")]
    Beyond {
        /// Its offset in the payload.
        offset: usize,
    },
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::frame::{KEY_EXCHANGE_CRC_EXTRA, KEY_EXCHANGE_ID, crc_extra};

    fn message(data: &[u8]) -> Message {
        Message {
            public_key: [7; 32],
            session: 0x0403_0201,
            version: VERSION,
            step: Step::Answer,
            suite: Suite::Pairing.to_wire(),
            status: Status::Ok,
            target: Node {
                system: 245,
                component: 190,
            },
            data: Data::new(data).unwrap(),
        }
    }

    #[test]
    fn fields_are_where_the_table_has_them() {
        let payload = message(&[9; 88]).to_payload();
        assert_eq!(payload[..32], [7; 32]);
        // The fifth is the version: 2 since a message carries an authenticator from before the handshake.
        assert_eq!(payload[32..43], [1, 2, 3, 4, 2, 2, 2, 0, 245, 190, 88]);
        assert_eq!(payload[43..131], [9; 88]);
        assert_eq!(payload[131..], [0; 72]);
    }

    #[test]
    fn trimmed_zeros_are_restored() {
        for len in [0, 1, 40, 160] {
            let mut data = vec![5; len];
            data.iter_mut().rev().take(3).for_each(|byte| *byte = 0);
            let sent = message(&data);
            let payload = sent.to_payload();
            let used = payload.iter().rposition(|&byte| byte != 0).unwrap() + 1;
            let read = Message::parse(&payload[..used]).unwrap();
            assert_eq!(read, Received::Exchange(sent));
        }
    }

    #[test]
    fn short_payloads_and_version_zero_are_the_legacy_exchange() {
        let key = PublicKey::new([7; 32]);
        assert_eq!(Message::parse(&[7; 32]).unwrap(), Received::Legacy(key));
        let mut payload = message(&[1]).to_payload();
        payload[36] = 0;
        assert_eq!(Message::parse(&payload).unwrap(), Received::Legacy(key));
        assert!(matches!(Message::parse(&[]).unwrap(), Received::Legacy(_)));
    }

    #[test]
    fn what_does_not_fit_is_refused_with_its_offset() {
        assert_eq!(
            Message::parse(&[1; 204]).unwrap_err(),
            MessageError::TooLong { len: 204 }
        );
        let mut payload = message(&[]).to_payload();
        payload[42] = 161;
        assert_eq!(
            Message::parse(&payload).unwrap_err(),
            MessageError::Length { length: 161 }
        );
        payload[42] = 3;
        payload[46] = 1;
        assert_eq!(
            Message::parse(&payload).unwrap_err(),
            MessageError::Beyond { offset: 46 }
        );
    }

    #[test]
    fn crc_extra_is_that_of_the_one_field_that_is_no_extension() {
        // mavgen: the message name, then type, name and array length of each field that is no extension.
        let crc = crc::Crc::<u16>::new(&crc::CRC_16_MCRF4XX);
        let mut digest = crc.digest();
        digest.update(b"KEY_EXCHANGE uint8_t public_key ");
        digest.update(&[32]);
        let [low, high] = digest.finalize().to_le_bytes();
        assert_eq!(low ^ high, KEY_EXCHANGE_CRC_EXTRA);
        assert_eq!(crc_extra(KEY_EXCHANGE_ID), Some(KEY_EXCHANGE_CRC_EXTRA));
    }
}
