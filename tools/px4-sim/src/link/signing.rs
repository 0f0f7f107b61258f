//! Signing as PX4 v1.18 does it, faults included: a model of the other side, and no example to follow.
//!
//! - PX4's own packets carry the initial timestamp plus one for each packet; only a verified packet on the same link
//!   raises it.
//! - A new stream (system, component, link id) is accepted when it is at most 60 s behind the link's clock; there are 16
//!   for the life of the process, whatever the key.
//! - HEARTBEAT, RADIO_STATUS, ADSB_VEHICLE and COLLISION are accepted unsigned, and badly signed too.
//! - A refused frame is dropped silently: neither COMMAND_ACK nor STATUSTEXT.

use mavlink::dialects::development::SETUP_SIGNING_DATA;
use mavlink_link::frame::FrameView;
use mavlink_link::signing::{SigningKey, Stamp, verify};

/// Why a frame was dropped.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Refusal {
    /// No signature, and not one of the four that need none.
    Unsigned,
    /// The signature does not verify with this key.
    BadSignature,
    /// The stamp is not above the last one of its stream: a replay, or out of order.
    OldStamp,
    /// A new stream more than 60 s behind this link's clock.
    OldStream,
    /// A 17th stream.
    TooManyStreams,
}

/// Why a frame was accepted.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Admission {
    /// Signature and stamp are valid.
    Verified,
    /// No key is set, or the message needs no signature.
    Unsigned,
    /// Badly signed, but one of the four: still accepted.
    BadlySigned,
}

/// The outcome of SETUP_SIGNING.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Setup {
    /// The key is in use, on every link.
    Accepted,
    /// Signing is off.
    Disabled,
    /// The vehicle is armed.
    Armed,
    /// The zero key arrived unsigned.
    Ignored,
}

/// Key and streams, shared by all links of the process.
#[derive(Debug, Default)]
pub struct Signing {
    key: Option<SigningKey>,
    stored_stamp: u64,
    streams: Vec<((u8, u8, u8), Stamp)>,
}

impl Signing {
    /// Off until SETUP_SIGNING.
    pub fn off() -> Self {
        Self::default()
    }

    /// As with a key file: signed from the first packet, whose stamp is `initial` (units of 10 us).
    pub fn with_key(key: SigningKey, initial: u64) -> Self {
        Self {
            key: Some(key),
            stored_stamp: initial,
            streams: Vec::new(),
        }
    }

    /// The key, while signing is on.
    pub fn key(&self) -> Option<&SigningKey> {
        self.key.as_ref()
    }

    /// The stamp with which a link starts, now and after a restart.
    pub fn stored_stamp(&self) -> u64 {
        self.stored_stamp
    }

    /// Forgets the streams, as a restart does; key and initial stamp are on disk and are kept.
    pub fn restart(&mut self) {
        self.streams.clear();
    }

    /// Checks a frame; `clock` is the link's own, and a verified frame raises it.
    pub fn admit(&mut self, frame: &FrameView<'_>, clock: &mut u64) -> Result<Admission, Refusal> {
        let Some(key) = &self.key else {
            return Ok(Admission::Unsigned);
        };
        let header = frame.header();
        let needs_none = NEED_NO_SIGNATURE.contains(&header.message_id);
        let exempt = |admission, refusal| match needs_none {
            true => Ok(admission),
            false => Err(refusal),
        };
        let Some(signature) = frame.signature() else {
            return exempt(Admission::Unsigned, Refusal::Unsigned);
        };
        if verify(key, frame).is_err() {
            return exempt(Admission::BadlySigned, Refusal::BadSignature);
        }
        let id = (header.system_id, header.component_id, signature.link_id);
        // PX4 checks the stamp after the signature, so a forged frame cannot move a stream.
        match self.admit_stamp(id, signature.stamp, *clock) {
            Ok(()) => {
                *clock = (*clock).max(signature.stamp.get());
                Ok(Admission::Verified)
            }
            Err(refusal) => exempt(Admission::BadlySigned, refusal),
        }
    }

    fn admit_stamp(&mut self, id: (u8, u8, u8), stamp: Stamp, clock: u64) -> Result<(), Refusal> {
        if let Some((_, last)) = self.streams.iter_mut().find(|(known, _)| *known == id) {
            if stamp <= *last {
                return Err(Refusal::OldStamp);
            }
            *last = stamp;
            return Ok(());
        }
        if self.streams.len() >= MAX_STREAMS {
            return Err(Refusal::TooManyStreams);
        }
        if stamp.get() + BEHIND < clock {
            return Err(Refusal::OldStream);
        }
        self.streams.push((id, stamp));
        Ok(())
    }

    /// SETUP_SIGNING, which PX4 accepts whatever its target is. `signed` is whether the frame carried a signature.
    pub fn setup(&mut self, m: &SETUP_SIGNING_DATA, signed: bool, armed: bool) -> Setup {
        if armed {
            return Setup::Armed;
        }
        if m.secret_key == [0; 32] && m.initial_timestamp == 0 {
            if self.key.is_some() && !signed {
                return Setup::Ignored;
            }
            self.key = None;
            self.stored_stamp = 0;
            return Setup::Disabled;
        }
        // PX4 treats a zero key with a stamp like any other key.
        self.key = Some(SigningKey::new_allowing_zero(m.secret_key));
        self.stored_stamp = m.initial_timestamp;
        Setup::Accepted
    }
}

/// HEARTBEAT, RADIO_STATUS, ADSB_VEHICLE, COLLISION.
const NEED_NO_SIGNATURE: [u32; 4] = [0, 109, 246, 247];
/// MAVLINK_MAX_SIGNING_STREAMS of this build.
const MAX_STREAMS: usize = 16;
/// 60 s in units of 10 us.
const BEHIND: u64 = 6_000_000;
