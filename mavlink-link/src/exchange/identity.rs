//! Static keys and their fingerprints, and the caller's random bytes.

use core::fmt;

use sha2::{Digest as _, Sha256};
use subtle::ConstantTimeEq as _;
use thiserror::Error;
use x25519_dalek::StaticSecret;
use zeroize::{Zeroize as _, Zeroizing};

/// Random bytes from the caller: this crate has no source of its own.
pub trait Random {
    /// Fills all of `out` with bytes that nobody can guess.
    ///
    /// # Errors
    /// There are no random bytes; nothing is sent then.
    fn fill(&mut self, out: &mut [u8]) -> Result<(), NoRandom>;
}

impl<F: FnMut(&mut [u8]) -> Result<(), NoRandom>> Random for F {
    fn fill(&mut self, out: &mut [u8]) -> Result<(), NoRandom> {
        self(out)
    }
}

/// The system provided no random bytes.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Error)]
#[error("no random bytes")]
pub struct NoRandom;

/// This end's static X25519 key: wiped when dropped, never printed, and moved without a copy of its bytes.
pub struct Identity(Box<Zeroizing<[u8; 32]>>);

impl Identity {
    /// A key of these bytes, as stored by [`Identity::expose`].
    #[must_use]
    pub fn new(mut bytes: [u8; 32]) -> Self {
        let identity = Self::copy_of(&bytes);
        bytes.zeroize();
        identity
    }

    fn copy_of(bytes: &[u8; 32]) -> Self {
        // Made empty and filled in place, so that no copy stays on the stack.
        let mut identity = Self(Box::new(Zeroizing::new([0; 32])));
        identity.0.copy_from_slice(bytes);
        identity
    }

    /// A new key.
    ///
    /// # Errors
    /// There are no random bytes.
    pub fn generate(random: &mut dyn Random) -> Result<Self, NoRandom> {
        let mut identity = Self::copy_of(&[0; 32]);
        random.fill(&mut **identity.0)?;
        Ok(identity)
    }

    /// The public key, which the peer pins.
    #[must_use]
    pub fn public(&self) -> PublicKey {
        PublicKey(x25519_dalek::PublicKey::from(&self.secret()).to_bytes())
    }

    /// A second copy for a second owner: each is wiped on its own.
    #[must_use]
    pub fn duplicate(&self) -> Self {
        Self::copy_of(&self.0)
    }

    /// The bytes, for a file. Keep no copy.
    #[must_use]
    pub fn expose(&self) -> &[u8; 32] {
        &self.0
    }

    /// For one use: wiped when it is dropped.
    pub(super) fn secret(&self) -> StaticSecret {
        (**self.0).into()
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
    /// A key of these bytes. X25519 accepts any; a bad one is refused in use, where its result is all zero.
    #[must_use]
    pub const fn new(bytes: [u8; 32]) -> Self {
        Self(bytes)
    }

    /// The bytes.
    #[must_use]
    pub const fn bytes(&self) -> &[u8; 32] {
        &self.0
    }

    /// For two people to compare by eye.
    #[must_use]
    pub fn fingerprint(&self) -> Fingerprint {
        let mut half = [0; 16];
        half.copy_from_slice(&Sha256::digest(self.0)[..16]);
        Fingerprint(half)
    }
}

impl PartialEq for PublicKey {
    // Constant time: a derived comparison would stop at the first difference.
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
