//! The frames of a web client: text, each with an HMAC under the keys of its connection.
//!
//! A connection is reliable and in order, so its frames need nothing of the trailer but the HMAC. What the trailer's
//! stamp prevents, that a recording counts again, the opening prevents: each end names 32 random bytes, and both are
//! in the keys.
//!
//! ```text
//! about  "vsm-web-1", VSM ID, CUCS ID, random bytes of the VSM, random bytes of the client
//! key    HMAC-SHA256(key of the direction, about): of all frames of a direction
//! frame  64 lower-case hex digits, a space, a text;  the digits are HMAC-SHA256(key, text)
//! ```
//!
//! The key of the direction is that of the datagrams' trailers. An HMAC of one can never be valid for the other: what
//! the trailers hash begins with "vsm-guard-1".
//!
//! ```
//! use stanag_msgs::Id;
//! use stanag_msgs::guard::{Direction, GuardKey, Opening, SealedText};
//!
//! let opening = Opening { vsm: Id(1), cucs: Id(2), of_vsm: [3; 32], of_client: [4; 32] };
//! let key = GuardKey::new(&[7; 32]).connection(&opening);
//! let frame = key.seal(Direction::ToVsm, "{}");
//!
//! let sealed = SealedText::parse(&frame).unwrap();
//! assert_eq!(sealed.text, "{}");
//! assert!(key.verifies(Direction::ToVsm, &sealed));
//! assert!(!key.verifies(Direction::ToCucs, &sealed), "it does not go back");
//! ```

use core::fmt::{self, Write as _};

use hmac::{Hmac, KeyInit as _, Mac as _};
use sha2::Sha256;
use zeroize::Zeroize as _;

use super::{Direction, GuardKey, MAC_BYTES};
use crate::Id;

/// The two ends of a connection, and the random bytes of both.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Opening {
    /// VSM ID.
    pub vsm: Id,
    /// CUCS ID of the client.
    pub cucs: Id,
    /// Random bytes of the VSM.
    pub of_vsm: [u8; 32],
    /// Random bytes of the client.
    pub of_client: [u8; 32],
}

/// The keys of a connection, one for each direction. Wiped when dropped, and `Debug` shows nothing of them.
pub struct ConnectionKey {
    to_vsm: Box<Hmac<Sha256>>,
    to_cucs: Box<Hmac<Sha256>>,
}

impl GuardKey {
    /// Derives the keys of a connection.
    #[must_use]
    pub fn connection(&self, opening: &Opening) -> ConnectionKey {
        let of = |direction: &Hmac<Sha256>| {
            let about = Hmac::clone(direction)
                .chain_update(CONTEXT)
                .chain_update(opening.vsm.0.to_be_bytes())
                .chain_update(opening.cucs.0.to_be_bytes())
                .chain_update(opening.of_vsm)
                .chain_update(opening.of_client);
            let mut key: [u8; 32] = about.finalize().into_bytes().into();
            let keyed = Box::new(Hmac::new_from_slice(&key).expect("HMAC takes any length"));
            key.zeroize();
            keyed
        };
        ConnectionKey {
            to_vsm: of(&self.to_vsm),
            to_cucs: of(&self.to_cucs),
        }
    }
}

impl ConnectionKey {
    /// The frame for this text.
    #[must_use]
    pub fn seal(&self, direction: Direction, text: &str) -> String {
        let mac = self.mac(direction, text).finalize().into_bytes();
        let mut frame = String::with_capacity(HEX_DIGITS + 1 + text.len());
        for byte in mac {
            let _ = write!(frame, "{byte:02x}");
        }
        frame.push(' ');
        frame.push_str(text);
        frame
    }

    /// Whether the other end has sealed it in this connection, in constant time.
    #[must_use]
    pub fn verifies(&self, direction: Direction, sealed: &SealedText<'_>) -> bool {
        let expected = self.mac(direction, sealed.text);
        expected.verify_slice(&sealed.mac).is_ok()
    }

    fn mac(&self, direction: Direction, text: &str) -> Hmac<Sha256> {
        let keyed = match direction {
            Direction::ToVsm => &self.to_vsm,
            // A connection has two ends and no group: what is not for the VSM is for its client.
            Direction::ToCucs | Direction::ToGroup => &self.to_cucs,
        };
        Hmac::clone(keyed).chain_update(text.as_bytes())
    }
}

impl fmt::Debug for ConnectionKey {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("ConnectionKey")
    }
}

/// A well-formed frame. Nothing in its text may be believed before it verifies.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct SealedText<'a> {
    /// The sealed text.
    pub text: &'a str,
    mac: [u8; MAC_BYTES],
}

impl<'a> SealedText<'a> {
    /// Reads a frame; `None` unless it begins with 64 lower-case hex digits and a space. A frame has one written form
    /// only.
    #[must_use]
    pub fn parse(frame: &'a str) -> Option<SealedText<'a>> {
        let (digits, rest) = frame.split_at_checked(HEX_DIGITS)?;
        let text = rest.strip_prefix(' ')?;
        let (pairs, []) = digits.as_bytes().as_chunks::<2>() else {
            return None;
        };
        let mut mac = [0; MAC_BYTES];
        for (byte, [high, low]) in mac.iter_mut().zip(pairs) {
            *byte = digit(*high)? << 4 | digit(*low)?;
        }
        Some(SealedText { text, mac })
    }

    /// The HMAC that the frame has, whether it verifies or not.
    #[must_use]
    pub fn mac(&self) -> &[u8; MAC_BYTES] {
        &self.mac
    }
}

fn digit(character: u8) -> Option<u8> {
    match character {
        b'0'..=b'9' => Some(character - b'0'),
        b'a'..=b'f' => Some(character - b'a' + 10),
        _ => None,
    }
}

/// Digits of the HMAC in front of a frame's text.
const HEX_DIGITS: usize = 2 * MAC_BYTES;
const CONTEXT: &[u8] = b"vsm-web-1";
