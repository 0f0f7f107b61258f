//! Who talks: static keys, their fingerprints, and the ids that both ends must agree about.

use core::fmt;

use sha2::{Digest as _, Sha256};
use subtle::ConstantTimeEq as _;
use thiserror::Error;
use x25519_dalek::StaticSecret;
use zeroize::Zeroizing;

use super::message::{Node, Suite};

/// Random bytes from the caller: this crate has no source of its own.
pub trait Random {
    /// Fills all of `out` with bytes that nobody can guess.
    ///
    /// # Errors
    /// There are none; nothing is sent then.
    fn fill(&mut self, out: &mut [u8]) -> Result<(), NoRandom>;
}

impl<F: FnMut(&mut [u8]) -> Result<(), NoRandom>> Random for F {
    fn fill(&mut self, out: &mut [u8]) -> Result<(), NoRandom> {
        self(out)
    }
}

/// The system has no random bytes.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Error)]
#[error("no random bytes")]
pub struct NoRandom;

/// This end's static X25519 key: wiped when dropped, never printed.
pub struct Identity(StaticSecret);

impl Identity {
    /// A key of these bytes, as stored by [`Identity::expose`].
    #[must_use]
    pub fn new(bytes: [u8; 32]) -> Self {
        Self(bytes.into())
    }

    /// A new key.
    ///
    /// # Errors
    /// There are no random bytes.
    pub fn generate(random: &mut dyn Random) -> Result<Self, NoRandom> {
        let mut bytes = Zeroizing::new([0; 32]);
        random.fill(&mut *bytes)?;
        Ok(Self::new(*bytes))
    }

    /// The public half, which the peer pins.
    #[must_use]
    pub fn public(&self) -> PublicKey {
        PublicKey(x25519_dalek::PublicKey::from(&self.0).to_bytes())
    }

    /// A second copy, where two owners are wanted: each is wiped on its own.
    #[must_use]
    pub fn duplicate(&self) -> Self {
        Self(self.0.clone())
    }

    /// The bytes themselves, for a file. Keep no copy.
    #[must_use]
    pub fn expose(&self) -> &[u8; 32] {
        self.0.as_bytes()
    }

    pub(super) fn secret(&self) -> &StaticSecret {
        &self.0
    }
}

impl fmt::Debug for Identity {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("Identity(..)")
    }
}

/// A peer's public X25519 key.
#[derive(Clone, Copy, Eq)]
pub struct PublicKey([u8; 32]);

impl PublicKey {
    /// A key of these bytes; any are a key to X25519, the all-zero result of a bad one is refused in use.
    #[must_use]
    pub const fn new(bytes: [u8; 32]) -> Self {
        Self(bytes)
    }

    /// The bytes.
    #[must_use]
    pub const fn bytes(&self) -> &[u8; 32] {
        &self.0
    }

    /// What two people compare.
    #[must_use]
    pub fn fingerprint(&self) -> Fingerprint {
        let mut half = [0; 16];
        half.copy_from_slice(&Sha256::digest(self.0)[..16]);
        Fingerprint(half)
    }
}

impl PartialEq for PublicKey {
    fn eq(&self, other: &Self) -> bool {
        self.0.ct_eq(&other.0).into()
    }
}

impl fmt::Debug for PublicKey {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "PublicKey({})", self.fingerprint())
    }
}

/// The first 16 bytes of SHA-256 of a public key; shown as eight groups of four hexadecimal digits.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub struct Fingerprint([u8; 16]);

impl fmt::Display for Fingerprint {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for (n, pair) in self.0.chunks_exact(2).enumerate() {
            let gap = if n == 0 { "" } else { ":" };
            write!(f, "{gap}{:02x}{:02x}", pair[0], pair[1])?;
        }
        Ok(())
    }
}

/// What both ends must hold the same, or nothing decrypts.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Parties {
    /// The ground side, which begins.
    pub initiator: Node,
    /// The air side, which answers.
    pub responder: Node,
    /// The VSM's DLI identification number.
    pub vsm_id: u32,
    /// The vehicle's DLI identification number.
    pub vehicle_id: u32,
    /// SHA-256 of the canonical policy text, [`policy_digest`].
    pub policy: [u8; 32],
}

impl Parties {
    /// Both ends under the policy of this version, [`POLICY`].
    #[must_use]
    pub fn new(initiator: Node, responder: Node, vsm_id: u32, vehicle_id: u32) -> Self {
        Self {
            initiator,
            responder,
            vsm_id,
            vehicle_id,
            policy: policy_digest(POLICY),
        }
    }

    /// Both ends' system and component ids, then VSM and vehicle id, big-endian.
    pub(super) fn ids(&self) -> [u8; 12] {
        let mut ids = [0; 12];
        ids[0] = self.initiator.system;
        ids[1] = self.initiator.component;
        ids[2] = self.responder.system;
        ids[3] = self.responder.component;
        ids[4..8].copy_from_slice(&self.vsm_id.to_be_bytes());
        ids[8..].copy_from_slice(&self.vehicle_id.to_be_bytes());
        ids
    }

    /// The Noise prologue of one session.
    pub(super) fn prologue(&self, suite: Suite, session: u32) -> [u8; PROLOGUE] {
        let mut prologue = [0; PROLOGUE];
        let (label, rest) = prologue.split_at_mut(LABEL.len());
        label.copy_from_slice(LABEL);
        // rest[0] is the zero that ends the label.
        rest[1] = suite.to_wire();
        rest[2..14].copy_from_slice(&self.ids());
        rest[14..18].copy_from_slice(&session.to_le_bytes());
        rest[18..].copy_from_slice(&self.policy);
        prologue
    }
}

/// SHA-256 of a policy text, as both ends must have it.
#[must_use]
pub fn policy_digest(text: &str) -> [u8; 32] {
    Sha256::digest(text.as_bytes()).into()
}

/// The canonical policy text of this version: what a key that comes out of an exchange is for. Two programs that would
/// use it differently never agree about one.
pub const POLICY: &str = "vsm policy 1\n\
    signing: MAVLink 2, required in both directions\n\
    unsigned: RADIO_STATUS, KEY_EXCHANGE\n\
    provisioning: air-side agent, disarmed\n";

const LABEL: &[u8] = b"vsm-key-agreement/1";
const PROLOGUE: usize = LABEL.len() + 2 + 12 + 4 + 32;
