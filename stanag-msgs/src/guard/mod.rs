//! The trailer of the DLI guard: 52 bytes behind a datagram that prove to the receiver who sent it.
//!
//! The standard has no authentication: the wrapper's source is whatever a sender writes. Two guards, one beside the
//! CUCS and one in the VSM, add this to each datagram between them (numbers have their most significant byte first,
//! as everywhere in the DLI):
//!
//! | offset | field | meaning |
//! |---|---|---|
//! | 0 | 2 bytes | `GD` |
//! | 2 | u8 | version 1 |
//! | 3 | u8 | direction: 1 CUCS to VSM, 2 VSM to CUCS, 3 VSM to a group |
//! | 4 | u32 | sender: the CUCS ID, or the VSM ID |
//! | 8 | u16 | key id: the first two bytes of HMAC-SHA256(key, "vsm/1 key id") |
//! | 10 | u16 | 0 |
//! | 12 | u64 | stamp, us since 1970: no two of one sender under one key are equal |
//! | 20 | 32 bytes | HMAC-SHA256(key of the direction, "vsm-guard-1", receiver ID, datagram, the 20 bytes before) |
//!
//! The key of a direction is HKDF-SHA256(key, info "c2v", "v2c" or "v2g"): a datagram that is sent back to its sender does not
//! verify. The receiver is not in the trailer: a datagram for one VSM does not verify at another that has the same key.
//!
//! A valid trailer does not prove that a datagram is new: which stamps are accepted is decided by the receiver.
//!
//! `exchange` is the datagram by which two guards agree on a key, `group` how a group is given one, `clock` how two
//! guards whose clocks differ find the difference. A web client has the same key but sends no datagrams: [`Opening`]
//! and [`ConnectionKey`] authenticate its frames.
//!
//! ```
//! use stanag_msgs::Id;
//! use stanag_msgs::guard::{Direction, GuardKey, Guarded, MAX_GUARDED, Trailer};
//!
//! let key = GuardKey::new(&[7; 32]);
//! let (cucs, vsm) = (Id(0x1b00_00a0), Id(0x1b00_0001));
//! let trailer = Trailer { direction: Direction::ToVsm, sender: cucs, key_id: key.id(), stamp_us: 1 };
//! let mut out = [0; MAX_GUARDED];
//! let length = key.seal(&trailer, vsm, b"datagram", &mut out).unwrap();
//!
//! let guarded = Guarded::parse(&out[..length]).unwrap();
//! assert_eq!((guarded.trailer, guarded.datagram), (trailer, &b"datagram"[..]));
//! assert!(key.verifies(&guarded, vsm));
//! assert!(!key.verifies(&guarded, cucs));
//! ```

mod clock;
mod connection;
mod exchange;
mod group;

pub use self::clock::{CLOCK_BYTES, ClockDatagram, ClockStep};
pub use self::exchange::ExchangeDatagram;
use self::group::Wrap;
pub use self::group::{OFFER_BYTES, Offer, is_offer};

use core::fmt;

use hkdf::Hkdf;
use hmac::{Hmac, KeyInit as _, Mac as _};
use sha2::Sha256;
use zeroize::Zeroizing;

pub use self::connection::{ConnectionKey, Opening, SealedText};
use crate::{Id, MAX_DATAGRAM};

/// The length of a trailer, bytes.
pub const TRAILER_BYTES: usize = HEAD_BYTES + MAC_BYTES;
/// The longest datagram between two guards: its content keeps the standard's limit of 548 bytes.
pub const MAX_GUARDED: usize = MAX_DATAGRAM + TRAILER_BYTES;

/// The direction of a datagram.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Direction {
    /// From a CUCS to a VSM.
    ToVsm,
    /// From a VSM to a CUCS.
    ToCucs,
    /// From a VSM to its group, under the group's key: status only, and never anything that a VSM accepts.
    ToGroup,
}

impl Direction {
    /// The direction of an answer; a group never answers.
    #[must_use]
    pub const fn back(self) -> Option<Direction> {
        match self {
            Direction::ToVsm => Some(Direction::ToCucs),
            Direction::ToCucs => Some(Direction::ToVsm),
            Direction::ToGroup => None,
        }
    }

    const fn code(self) -> u8 {
        match self {
            Direction::ToVsm => 1,
            Direction::ToCucs => 2,
            Direction::ToGroup => 3,
        }
    }

    const fn of_code(code: u8) -> Option<Direction> {
        match code {
            1 => Some(Direction::ToVsm),
            2 => Some(Direction::ToCucs),
            3 => Some(Direction::ToGroup),
            _ => None,
        }
    }
}

/// The content of a trailer, except its MAC.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Trailer {
    /// Its direction.
    pub direction: Direction,
    /// CUCS ID or VSM ID.
    pub sender: Id,
    /// The name of the key, by which the receiver finds it.
    pub key_id: u16,
    /// Microseconds since 1970.
    pub stamp_us: u64,
}

impl Trailer {
    fn head(&self) -> [u8; HEAD_BYTES] {
        let mut head = [0; HEAD_BYTES];
        head[..2].copy_from_slice(MAGIC);
        head[2] = VERSION;
        head[3] = self.direction.code();
        head[4..8].copy_from_slice(&self.sender.0.to_be_bytes());
        head[8..10].copy_from_slice(&self.key_id.to_be_bytes());
        head[12..].copy_from_slice(&self.stamp_us.to_be_bytes());
        head
    }
}

/// A datagram with a well-formed trailer. Nothing in it may be believed before it verifies.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Guarded<'a> {
    /// The content of the trailer.
    pub trailer: Trailer,
    /// The datagram in front of the trailer.
    pub datagram: &'a [u8],
    mac: &'a [u8; MAC_BYTES],
}

impl<'a> Guarded<'a> {
    /// Reads the trailer; `None` where there is none. Another version, an unknown direction, a reserved bit that is
    /// set, and more than [`MAX_GUARDED`] bytes count as no trailer.
    #[must_use]
    pub fn parse(bytes: &'a [u8]) -> Option<Guarded<'a>> {
        if bytes.len() > MAX_GUARDED {
            return None;
        }
        let (rest, mac) = bytes.split_last_chunk::<MAC_BYTES>()?;
        let (datagram, head) = rest.split_last_chunk::<HEAD_BYTES>()?;
        let [b'G', b'D', VERSION, direction, fields @ ..] = head else {
            return None;
        };
        let (sender, fields) = fields.split_first_chunk()?;
        let (key_id, fields) = fields.split_first_chunk()?;
        let ([0, 0], stamp) = fields.split_first_chunk()? else {
            return None;
        };
        let trailer = Trailer {
            direction: Direction::of_code(*direction)?,
            sender: Id(u32::from_be_bytes(*sender)),
            key_id: u16::from_be_bytes(*key_id),
            stamp_us: u64::from_be_bytes(*stamp.first_chunk()?),
        };
        Some(Guarded {
            trailer,
            datagram,
            mac,
        })
    }
}

/// A key of 32 bytes that one CUCS shares with one VSM, or a VSM with the guards of its group, ready for every direction.
///
/// It holds the state of the HMACs instead of the key, on the heap: a value that is moved leaves copies on stacks,
/// which nothing wipes. It is wiped when dropped, and `Debug` shows nothing of it.
pub struct GuardKey {
    id: u16,
    to_vsm: Box<Hmac<Sha256>>,
    to_cucs: Box<Hmac<Sha256>>,
    to_group: Box<Hmac<Sha256>>,
    wrap: Wrap,
}

impl GuardKey {
    /// Derives the keys of all directions from a key.
    #[must_use]
    pub fn new(key: &[u8; 32]) -> GuardKey {
        let id = keyed(key).chain_update(KEY_ID).finalize().into_bytes();
        GuardKey {
            id: u16::from_be_bytes([id[0], id[1]]),
            to_vsm: derived(key, b"c2v"),
            to_cucs: derived(key, b"v2c"),
            to_group: derived(key, b"v2g"),
            wrap: Wrap::new(&expanded(key, b"group wrap")),
        }
    }

    /// A group key, encrypted for the holder of this key; `None` where encryption fails. Each stamp may be used once.
    #[must_use]
    pub fn wrap(&self, stamp_us: u64, offer: &Offer) -> Option<[u8; OFFER_BYTES]> {
        self.wrap.seal(stamp_us, offer)
    }

    /// The group key in an offer that was made for this key. Whether the offer is new is shown by its datagram's
    /// stamp.
    #[must_use]
    pub fn unwrap(&self, inside: &[u8]) -> Option<Offer> {
        is_offer(inside).then(|| self.wrap.open(inside.try_into().ok()?))?
    }

    /// The number by which a trailer names the key: not unique, so it only selects the keys that are tried.
    #[must_use]
    pub const fn id(&self) -> u16 {
        self.id
    }

    /// Writes a datagram and its trailer; returns the length.
    ///
    /// # Errors
    /// The datagram is longer than 548 bytes, or `out` has no room.
    pub fn seal(
        &self,
        trailer: &Trailer,
        receiver: Id,
        datagram: &[u8],
        out: &mut [u8],
    ) -> Result<usize, TooLong> {
        let length = datagram.len() + TRAILER_BYTES;
        let too_long = TooLong(datagram.len());
        if datagram.len() > MAX_DATAGRAM {
            return Err(too_long);
        }
        let out = out.get_mut(..length).ok_or(too_long)?;
        let head = trailer.head();
        let mac = self.mac(trailer.direction, receiver, datagram, &head);
        let (body, tail) = out.split_at_mut(datagram.len());
        body.copy_from_slice(datagram);
        tail[..HEAD_BYTES].copy_from_slice(&head);
        tail[HEAD_BYTES..].copy_from_slice(&mac.finalize().into_bytes());
        Ok(length)
    }

    /// Whether a holder of this key has sealed it for this receiver, in constant time.
    #[must_use]
    pub fn verifies(&self, guarded: &Guarded<'_>, receiver: Id) -> bool {
        let Guarded {
            trailer,
            datagram,
            mac,
        } = guarded;
        let expected = self.mac(trailer.direction, receiver, datagram, &trailer.head());
        trailer.key_id == self.id && expected.verify_slice(*mac).is_ok()
    }

    fn mac(
        &self,
        direction: Direction,
        receiver: Id,
        datagram: &[u8],
        head: &[u8; HEAD_BYTES],
    ) -> Hmac<Sha256> {
        self.of_direction(direction)
            .chain_update(CONTEXT)
            .chain_update(receiver.0.to_be_bytes())
            .chain_update(datagram)
            .chain_update(head)
    }

    fn of_direction(&self, direction: Direction) -> Hmac<Sha256> {
        let keyed = match direction {
            Direction::ToVsm => &self.to_vsm,
            Direction::ToCucs => &self.to_cucs,
            Direction::ToGroup => &self.to_group,
        };
        Hmac::clone(keyed)
    }
}

impl fmt::Debug for GuardKey {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "GuardKey({:04x})", self.id)
    }
}

fn keyed(key: &[u8; 32]) -> Hmac<Sha256> {
    Hmac::new_from_slice(key).expect("HMAC takes a key of any length")
}

fn derived(key: &[u8; 32], info: &[u8]) -> Box<Hmac<Sha256>> {
    Box::new(keyed(&expanded(key, info)))
}

fn expanded(key: &[u8; 32], info: &[u8]) -> Zeroizing<[u8; 32]> {
    let mut bytes = Zeroizing::new([0; 32]);
    Hkdf::<Sha256>::new(None, key)
        .expand(info, &mut *bytes)
        .expect("32 bytes are one block of its output");
    bytes
}

/// A datagram that cannot be guarded.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[error("a datagram of {0} bytes, expected 0 to 548, and room for 52 more")]
pub struct TooLong(usize);

/// Bytes of a trailer in front of its MAC; the MAC covers them.
const HEAD_BYTES: usize = 20;
/// Bytes of HMAC-SHA256.
const MAC_BYTES: usize = 32;
const MAGIC: &[u8; 2] = b"GD";
/// The version of the trailer.
const VERSION: u8 = 1;
const CONTEXT: &[u8] = b"vsm-guard-1";
const KEY_ID: &[u8] = b"vsm/1 key id";
