//! The group key: what a VSM sends to a multicast group is sealed under it, and each guard is given it under its own key.
//!
//! Everybody who has the key can seal with it: a sealed datagram proves the VSM as its sender only as far as all
//! guards of the group are trusted. So the key is for status from the VSM, and nothing that a VSM receives under it
//! is ever accepted.
//!
//! A datagram to the group has the same trailer ([`Trailer`](super::Trailer)), with direction 3, and its MAC covers
//! the broadcast id ([`Id::BROADCAST`]) as the receiver. A guard is given the key in an [`Offer`], inside a datagram
//! that is sealed for it alone:
//!
//! | offset | field | meaning |
//! |---|---|---|
//! | 0 | 2 bytes | `GK` |
//! | 2 | u8 | version 1 |
//! | 3 | u8 | 0 |
//! | 4 | u64 | stamp, us since 1970, of the guard key and used once: the nonce |
//! | 12 | u64 | floor, us since 1970: what is stamped so or before was sent before this offer |
//! | 20 | 32 bytes | the group key, encrypted by AES-256-GCM under HKDF-SHA256(guard key, info "group wrap") |
//! | 52 | 16 bytes | tag of that; associated: the 20 bytes before |

use core::fmt;

use aes_gcm::aead::{AeadInOut as _, KeyInit as _};
use aes_gcm::{Aes256Gcm, Nonce};
use zeroize::Zeroizing;

/// Encrypts group keys for one guard. `Debug` shows nothing of it.
pub(super) struct Wrap(Box<Aes256Gcm>);

/// A group key as it is sent to one guard.
#[derive(Debug)]
pub struct Offer {
    /// The key, decrypted.
    pub key: Zeroizing<[u8; 32]>,
    /// A datagram of the group with this stamp or an earlier one, in us since 1970, must be refused.
    pub floor_us: u64,
}

impl Wrap {
    pub(super) fn new(key: &[u8; 32]) -> Wrap {
        Wrap(Box::new(Aes256Gcm::new(key.into())))
    }

    pub(super) fn seal(&self, stamp_us: u64, offer: &Offer) -> Option<[u8; OFFER_BYTES]> {
        let mut bytes = [0; OFFER_BYTES];
        bytes[..3].copy_from_slice(&[b'G', b'K', VERSION]);
        bytes[4..12].copy_from_slice(&stamp_us.to_be_bytes());
        bytes[12..HEAD].copy_from_slice(&offer.floor_us.to_be_bytes());
        let (head, rest) = bytes.split_at_mut(HEAD);
        let (key, tag) = rest.split_at_mut(KEY);
        key.copy_from_slice(&*offer.key);
        let sealed = self
            .0
            .encrypt_inout_detached(&nonce(stamp_us), head, key.into());
        // Encryption fails only for lengths that no offer has. The buffer then still holds the key in the clear, so
        // it is wiped.
        let Ok(sealed) = sealed else {
            zeroize::Zeroize::zeroize(&mut bytes);
            return None;
        };
        tag.copy_from_slice(&sealed);
        Some(bytes)
    }

    pub(super) fn open(&self, bytes: &[u8; OFFER_BYTES]) -> Option<Offer> {
        let (head, rest) = bytes.split_first_chunk::<HEAD>()?;
        let (sealed, tag) = rest.split_first_chunk::<KEY>()?;
        let tag: &[u8; TAG] = tag.try_into().ok()?;
        let stamp_us = u64::from_be_bytes(*head[4..12].first_chunk()?);
        let mut key = Zeroizing::new(*sealed);
        self.0
            .decrypt_inout_detached(
                &nonce(stamp_us),
                head,
                key.as_mut_slice().into(),
                tag.into(),
            )
            .ok()?;
        Some(Offer {
            key,
            floor_us: u64::from_be_bytes(*head[12..].first_chunk()?),
        })
    }
}

impl fmt::Debug for Wrap {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("Wrap(..)")
    }
}

/// Whether the content of a datagram is an offer, by its first bytes. No datagram of the DLI begins like it.
#[must_use]
pub fn is_offer(inside: &[u8]) -> bool {
    inside.starts_with(&[b'G', b'K', VERSION, 0]) && inside.len() == OFFER_BYTES
}

fn nonce(stamp_us: u64) -> Nonce<aes_gcm::aead::consts::U12> {
    let mut nonce = [0; 12];
    nonce[4..].copy_from_slice(&stamp_us.to_be_bytes());
    nonce.into()
}

/// The length of an offer, bytes.
pub const OFFER_BYTES: usize = HEAD + KEY + TAG;
/// Bytes in front of the encrypted key; they are authenticated with it.
const HEAD: usize = 20;
/// Bytes of a group key.
const KEY: usize = 32;
/// Bytes of an AES-GCM tag.
const TAG: usize = 16;
/// The version of an offer.
const VERSION: u8 = 1;

#[cfg(test)]
mod tests {
    use super::super::GuardKey;
    use super::*;

    #[test]
    fn an_offer_is_opened_by_its_guard_alone_and_whole_alone() {
        let (one, other) = (GuardKey::new(&[1; 32]), GuardKey::new(&[2; 32]));
        let offer = Offer {
            key: Zeroizing::new([9; 32]),
            floor_us: 77,
        };
        let bytes = one.wrap(5, &offer).unwrap();
        assert!(is_offer(&bytes));
        assert!(!bytes.windows(4).any(|part| part == [9; 4]), "encrypted");
        let opened = one.unwrap(&bytes).unwrap();
        assert_eq!((*opened.key, opened.floor_us), ([9; 32], 77));
        assert!(other.unwrap(&bytes).is_none());
        for at in 0..bytes.len() {
            let mut bent = bytes;
            bent[at] ^= 1;
            assert!(one.unwrap(&bent).is_none(), "byte {at}");
            assert!(one.unwrap(&bytes[..at]).is_none());
        }
        // Another stamp gives another ciphertext.
        assert_ne!(one.wrap(6, &offer).unwrap()[20..52], bytes[20..52]);
    }
}
