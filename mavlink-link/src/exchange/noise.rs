//! The Noise handshake, by `snow`, with our own Diffie-Hellman and the caller's random bytes.
//!
//! Promised: a Diffie-Hellman result of all zeros ends the handshake; the only random bytes are the caller's ephemeral
//! key; raw keys are taken only from a finished handshake, and its state is dropped at once. `snow` does
//! not wipe its own state; the secrets that pass through this module are wiped.

use snow::params::{CipherChoice, DHChoice, HashChoice};
use snow::resolvers::{CryptoResolver, DefaultResolver};
use snow::types::{Cipher, Dh, Hash};
use snow::{Builder, HandshakeState};
use thiserror::Error;
use x25519_dalek::StaticSecret;
use zeroize::{Zeroize, Zeroizing};

use super::identity::{Identity, PublicKey};
use super::message::Suite;

/// What a handshake starts with.
pub(super) struct Setup<'a> {
    pub(super) suite: Suite,
    pub(super) own: &'a Identity,
    /// The pinned key of the peer; suite 1.
    pub(super) peer: Option<&'a PublicKey>,
    /// Of the pairing code; suite 2.
    pub(super) psk: Option<&'a [u8; 32]>,
    pub(super) prologue: &'a [u8],
    pub(super) ephemeral: &'a [u8; 32],
}

/// One end's handshake.
pub(super) struct Noise(Box<HandshakeState>);

/// The result of a finished handshake.
pub(super) struct Finished {
    /// The handshake hash: public, never a key.
    pub(super) hash: [u8; 32],
    pub(super) k1: Zeroizing<[u8; 32]>,
    pub(super) k2: Zeroizing<[u8; 32]>,
}

/// A message did not decrypt, or a result was all zero. Not distinguished: the difference would help an attacker.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Error)]
#[error("the Noise message is not from the peer")]
pub(super) struct Failed;

impl From<snow::Error> for Failed {
    fn from(_: snow::Error) -> Self {
        Self
    }
}

impl Noise {
    pub(super) fn initiator(setup: &Setup<'_>) -> Result<Self, Failed> {
        Ok(Self(Box::new(builder(setup)?.build_initiator()?)))
    }

    pub(super) fn responder(setup: &Setup<'_>) -> Result<Self, Failed> {
        Ok(Self(Box::new(builder(setup)?.build_responder()?)))
    }

    pub(super) fn write(&mut self, payload: &[u8]) -> Result<Written, Failed> {
        let mut written = Written {
            bytes: [0; MAX_LEN],
            len: 0,
        };
        written.len = self.0.write_message(payload, &mut written.bytes)?;
        Ok(written)
    }

    /// Reads a message and returns its payload.
    ///
    /// After a failure the state may have mixed in forged bytes. Only an end's own first message, in a pattern that begins
    /// with a key, may be read again; otherwise the handshake must be built again.
    pub(super) fn read(&mut self, parts: [&[u8]; 2]) -> Result<Written, Failed> {
        let [first, second] = parts;
        let mut message = [0; MAX_LEN];
        let whole = message
            .get_mut(..first.len() + second.len())
            .ok_or(Failed)?;
        whole[..first.len()].copy_from_slice(first);
        whole[first.len()..].copy_from_slice(second);
        let mut payload = Written {
            bytes: [0; MAX_LEN],
            len: 0,
        };
        payload.len = self.0.read_message(whole, &mut payload.bytes)?;
        Ok(payload)
    }

    pub(super) fn peer(&self) -> Option<PublicKey> {
        let bytes: &[u8; 32] = self.0.get_remote_static()?.try_into().ok()?;
        Some(PublicKey::new(*bytes))
    }

    /// The raw keys; `None` before the end, when they would be constants that anyone can compute.
    pub(super) fn finish(mut self) -> Option<Finished> {
        if !self.0.is_handshake_finished() {
            return None;
        }
        let mut hash = [0; 32];
        hash.copy_from_slice(self.0.get_handshake_hash().get(..32)?);
        // The transport mode of `snow` is never entered: it would keep the keys in a state that nothing wipes.
        let (mut k1, mut k2) = self.0.dangerously_get_raw_split();
        let finished = Finished {
            hash,
            k1: Zeroizing::new(k1),
            k2: Zeroizing::new(k2),
        };
        k1.zeroize();
        k2.zeroize();
        Some(finished)
    }
}

impl core::fmt::Debug for Noise {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.write_str("Noise(..)")
    }
}

/// A Noise message or payload.
pub(super) struct Written {
    bytes: [u8; MAX_LEN],
    len: usize,
}

impl Written {
    pub(super) fn as_slice(&self) -> &[u8] {
        self.bytes.get(..self.len).unwrap_or_default()
    }
}

fn builder<'a>(setup: &Setup<'a>) -> Result<Builder<'a>, Failed> {
    let name = match setup.suite {
        Suite::Pinned => "Noise_KK_25519_ChaChaPoly_SHA256",
        Suite::Pairing => "Noise_XXpsk3_25519_ChaChaPoly_SHA256",
    };
    let primitives = Primitives(Zeroizing::new(*setup.ephemeral));
    let mut builder = Builder::with_resolver(name.parse()?, Box::new(primitives))
        .local_private_key(setup.own.expose())?
        .prologue(setup.prologue)?;
    if let Some(peer) = setup.peer {
        builder = builder.remote_public_key(peer.bytes())?;
    }
    if let Some(psk) = setup.psk {
        builder = builder.psk(3, psk)?;
    }
    Ok(builder)
}

/// Provides the primitives: ours for curve and randomness, `snow`'s for the rest.
struct Primitives(Zeroizing<[u8; 32]>);

impl CryptoResolver for Primitives {
    fn resolve_rng(&self) -> Option<Box<dyn snow::types::Random>> {
        // `snow` draws the ephemeral key from here, and nothing else.
        Some(Box::new(Once(Some(self.0.clone()))))
    }

    fn resolve_dh(&self, choice: &DHChoice) -> Option<Box<dyn Dh>> {
        matches!(choice, DHChoice::Curve25519).then(|| Box::<Curve>::default() as Box<dyn Dh>)
    }

    fn resolve_hash(&self, choice: &HashChoice) -> Option<Box<dyn Hash>> {
        // Only the curve is replaced: `snow`'s own accepts an all-zero Diffie-Hellman result.
        DefaultResolver.resolve_hash(choice)
    }

    fn resolve_cipher(&self, choice: &CipherChoice) -> Option<Box<dyn Cipher>> {
        DefaultResolver.resolve_cipher(choice)
    }
}

/// Returns the ephemeral key, once.
struct Once(Option<Zeroizing<[u8; 32]>>);

impl snow::types::Random for Once {
    fn try_fill_bytes(&mut self, out: &mut [u8]) -> Result<(), snow::Error> {
        let bytes = self.0.take().ok_or(snow::Error::Rng)?;
        if out.len() != bytes.len() {
            return Err(snow::Error::Rng);
        }
        out.copy_from_slice(&*bytes);
        Ok(())
    }
}

/// X25519 that wipes its secret and refuses a result to which the peer contributed nothing.
struct Curve {
    secret: StaticSecret,
    public: [u8; 32],
}

impl Default for Curve {
    fn default() -> Self {
        Self {
            secret: [0; 32].into(),
            public: [0; 32],
        }
    }
}

impl Curve {
    fn hold(&mut self, bytes: [u8; 32]) {
        self.secret = bytes.into();
        self.public = x25519_dalek::PublicKey::from(&self.secret).to_bytes();
    }
}

impl Dh for Curve {
    fn name(&self) -> &'static str {
        "25519"
    }

    fn pub_len(&self) -> usize {
        32
    }

    fn priv_len(&self) -> usize {
        32
    }

    fn set(&mut self, secret: &[u8]) {
        let mut bytes = Zeroizing::new([0; 32]);
        // Never another length: `Identity` has 32 bytes.
        bytes
            .iter_mut()
            .zip(secret)
            .for_each(|(to, from)| *to = *from);
        self.hold(*bytes);
    }

    fn generate(&mut self, random: &mut dyn snow::types::Random) -> Result<(), snow::Error> {
        let mut bytes = Zeroizing::new([0; 32]);
        random.try_fill_bytes(&mut *bytes)?;
        self.hold(*bytes);
        Ok(())
    }

    fn pubkey(&self) -> &[u8] {
        &self.public
    }

    fn privkey(&self) -> &[u8] {
        self.secret.as_bytes()
    }

    fn dh(&self, public: &[u8], out: &mut [u8]) -> Result<(), snow::Error> {
        let public: [u8; 32] = public
            .get(..32)
            .and_then(|bytes| bytes.try_into().ok())
            .ok_or(snow::Error::Dh)?;
        let shared = self.secret.diffie_hellman(&public.into());
        // Some public keys give zero with every secret: the result would be known to everyone.
        if !shared.was_contributory() {
            return Err(snow::Error::Dh);
        }
        out.get_mut(..32)
            .ok_or(snow::Error::Dh)?
            .copy_from_slice(shared.as_bytes());
        Ok(())
    }
}

/// Longer than the longest message: ephemeral 32, static 48, payload 40.
const MAX_LEN: usize = 256;
