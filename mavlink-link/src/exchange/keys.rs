//! What is derived from a finished handshake: the signing key, the confirmations and the keys of the confidential link.

use core::fmt;

use hkdf::Hkdf;
use hmac::{Hmac, KeyInit as _, Mac as _};
use sha2::Sha256;
use zeroize::{Zeroize as _, Zeroizing};

use super::identity::PublicKey;
use super::message::Status;
use super::noise::Finished;
use super::terms::Terms;
use crate::signing::SigningKey;

/// A key that both ends have once the exchange is complete.
pub struct Agreed {
    /// The MAVLink signing key.
    pub key: SigningKey,
    /// The keys of the confidential link, where both request it.
    pub confidential: Option<ConfidentialKeys>,
    /// The epoch of this exchange: above every one that either end had stored.
    pub epoch: u32,
    /// The peer's static key. On the ground only step 4 proves it, or a frame of the vehicle that verifies under
    /// [`key`](Agreed::key).
    pub peer: PublicKey,
}

impl fmt::Debug for Agreed {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Agreed")
            .field("key", &self.key.id())
            .field("epoch", &self.epoch)
            .field("peer", &self.peer)
            .finish_non_exhaustive()
    }
}

/// The two keys of the confidential link.
pub struct ConfidentialKeys {
    /// From the ground to the vehicle.
    pub up: Zeroizing<[u8; 32]>,
    /// From the vehicle to the ground.
    pub down: Zeroizing<[u8; 32]>,
}

/// The proof that the other end has the same keys.
pub(super) struct Confirmation {
    initiator: Zeroizing<[u8; 32]>,
    responder: Zeroizing<[u8; 32]>,
    hash: [u8; 32],
    session: u32,
}

/// Derives all keys; `None` where the signing key would be all zero, or the epochs are used up.
pub(super) fn derive(finished: &Finished, terms: &Terms<'_>) -> Option<(Agreed, Confirmation)> {
    let mut secret = Zeroizing::new([0; 64]);
    secret[..32].copy_from_slice(&*finished.k1);
    secret[32..].copy_from_slice(&*finished.k2);
    let (mut prk, hkdf) = Hkdf::<Sha256>::extract(Some(&finished.hash), &*secret);
    // The expanded keys are enough: the pseudorandom key would give all of them.
    prk.as_mut_slice().zeroize();
    let expand = |info: &[&[u8]]| {
        let mut key = Zeroizing::new([0; 32]);
        hkdf.expand_multi_info(info, &mut *key).ok()?;
        Some(key)
    };
    let [ours, theirs] = terms.epochs;
    // Above both stored epochs: it rises even where one end has lost its store.
    let epoch = ours.max(theirs).checked_add(1)?;
    // Both ends must want them: one that does not would have no use for the keys, and would not keep them.
    let confidential = if terms.wanted.iter().all(|wanted| wanted.confidential) {
        let (ids, number) = (terms.parties.ids(), epoch.to_be_bytes());
        // Two labels, so that a recording of one direction is noise in the other.
        Some(ConfidentialKeys {
            up: expand(&[b"vsm/1 commsec up", &ids, &number])?,
            down: expand(&[b"vsm/1 commsec down", &ids, &number])?,
        })
    } else {
        None
    };
    let agreed = Agreed {
        key: SigningKey::new(*expand(&[b"vsm/1 mavlink"])?).ok()?,
        confidential,
        epoch,
        peer: terms.peer,
    };
    let confirmation = Confirmation {
        initiator: expand(&[b"vsm/1 confirm i"])?,
        responder: expand(&[b"vsm/1 confirm r"])?,
        hash: finished.hash,
        session: terms.session,
    };
    Some((agreed, confirmation))
}

impl Confirmation {
    /// Step 3 of suite 1: HMAC(Kci, h, "I", session).
    pub(super) fn of_initiator(&self) -> [u8; 32] {
        mac(
            &self.initiator,
            &[&self.hash, b"I", &self.session.to_le_bytes()],
        )
        .finalize()
        .into_bytes()
        .into()
    }

    /// Whether step 3 of suite 1 was made with the same keys; in constant time.
    pub(super) fn proves_initiator(&self, data: &[u8]) -> bool {
        mac(
            &self.initiator,
            &[&self.hash, b"I", &self.session.to_le_bytes()],
        )
        .verify_slice(data)
        .is_ok()
    }

    /// Step 4: the body and HMAC(Kcr, h, "R", session, body).
    pub(super) fn of_responder(&self, outcome: Outcome) -> [u8; OUTCOME] {
        let body = outcome.to_bytes();
        let tag = self.responder_mac(&body).finalize().into_bytes();
        let mut data = [0; OUTCOME];
        data[..8].copy_from_slice(&body);
        data[8..].copy_from_slice(&tag);
        data
    }

    /// The outcome in step 4, if it was made with the same keys.
    pub(super) fn read_outcome(&self, data: &[u8]) -> Option<Outcome> {
        let (body, tag) = data.split_first_chunk::<8>()?;
        self.responder_mac(body).verify_slice(tag).ok()?;
        Some(Outcome::from_bytes(*body))
    }

    fn responder_mac(&self, body: &[u8; 8]) -> Hmac<Sha256> {
        mac(
            &self.responder,
            &[&self.hash, b"R", &self.session.to_le_bytes(), body],
        )
    }
}

impl fmt::Debug for Confirmation {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("Confirmation(..)")
    }
}

/// The body of step 4.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Outcome {
    pub(super) status: Status,
    /// More of the cause, for a log; 0 where there is none.
    pub(super) reason: u8,
    /// Rises with every change of the two.
    pub(super) seq: u32,
}

impl Outcome {
    fn to_bytes(self) -> [u8; 8] {
        let [a, b, c, d] = self.seq.to_le_bytes();
        [self.status.into(), self.reason, 0, 0, a, b, c, d]
    }

    fn from_bytes(bytes: [u8; 8]) -> Self {
        let [status, reason, _, _, a, b, c, d] = bytes;
        Self {
            status: status.into(),
            reason,
            seq: u32::from_le_bytes([a, b, c, d]),
        }
    }
}

const OUTCOME: usize = 40;

fn mac(key: &[u8; 32], parts: &[&[u8]]) -> Hmac<Sha256> {
    // HMAC pads a short key with zeros to a block. Padded here, the key has the block's type and no length that could be
    // wrong, so there is no error to handle.
    let mut block = Zeroizing::new([0; 64]);
    block[..32].copy_from_slice(key);
    let mut mac = Hmac::<Sha256>::new((&*block).into());
    parts.iter().for_each(|part| mac.update(part));
    mac
}
