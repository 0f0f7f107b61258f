//! Signing and verifying one frame: the keyed hash in one pass over one buffer.
//!
//! A frame is short and whole, so key, bytes and padding are laid out as SHA-256 blocks at once: that
//! is faster than a streaming hasher, and leaves one copy of the key to wipe.

use sha2::block_api::compress256;
use subtle::ConstantTimeEq as _;
use thiserror::Error;
use zeroize::Zeroize as _;

use super::key::SigningKey;
use crate::frame::{
    FrameView, HEADER_LEN, INCOMPAT_SIGNED, MAX_FRAME, SIGNATURE_LEN, STX, Stamp, TAG_LEN,
};

/// Appends the trailer to the frame `out[..len]` and returns the new length.
///
/// The checksum covers the flag, so the frame must have been encoded with [`INCOMPAT_SIGNED`] in its header.
///
/// # Errors
/// `out[..len]` is not a frame encoded so, or has no room left for the trailer.
pub fn sign(
    key: &SigningKey,
    link_id: u8,
    stamp: Stamp,
    out: &mut [u8; MAX_FRAME],
    len: usize,
) -> Result<usize, SignError> {
    let end = len + SIGNATURE_LEN;
    if len < HEADER_LEN || end > MAX_FRAME || out[0] != STX {
        return Err(SignError::NoFrame { len });
    }
    // The flag cannot be set here: the checksum, already computed, covers it.
    if out[2] & INCOMPAT_SIGNED == 0 {
        return Err(SignError::NotMarked);
    }
    out[len] = link_id;
    out[len + 1..end - TAG_LEN].copy_from_slice(&stamp.to_le_bytes());
    let tag = tag(key, &out[..end - TAG_LEN]);
    out[end - TAG_LEN..end].copy_from_slice(&tag);
    Ok(end)
}

/// Checks that the frame was signed with `key`, in constant time.
///
/// # Errors
/// There is no signature, or it is not that of the key.
pub fn verify(key: &SigningKey, frame: &FrameView<'_>) -> Result<(), VerifyError> {
    let (Some(signature), Some(bytes)) = (frame.signature(), frame.signed_bytes()) else {
        return Err(VerifyError::Unsigned);
    };
    if bool::from(tag(key, bytes).ct_eq(&signature.tag)) {
        Ok(())
    } else {
        Err(VerifyError::BadSignature)
    }
}

/// Why a frame cannot be signed.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Error)]
pub enum SignError {
    /// The bytes are not a frame with room for a trailer.
    #[error("{len} bytes are not an unsigned frame with room for a trailer")]
    NoFrame {
        /// Length given.
        len: usize,
    },
    /// The frame was encoded without the flag of a signed one.
    #[error("the frame was encoded without the incompatibility flag 0x01")]
    NotMarked,
}

/// Why a frame is not verified.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Error)]
pub enum VerifyError {
    /// It carries no signature.
    #[error("the frame is not signed")]
    Unsigned,
    /// Its signature was not made with this key.
    #[error("the signature was not made with this key")]
    BadSignature,
}

/// The first 6 bytes of SHA-256(key ‖ bytes); `bytes` are those of a frame up to its timestamp.
fn tag(key: &SigningKey, bytes: &[u8]) -> [u8; TAG_LEN] {
    let bytes = &bytes[..bytes.len().min(MAX_BYTES)];
    let end = KEY_LEN + bytes.len();
    let count = (end + 1 + LENGTH_LEN).div_ceil(BLOCK_LEN);

    let mut blocks = [[0; BLOCK_LEN]; MAX_BLOCKS];
    let flat = blocks.as_flattened_mut();
    flat[..KEY_LEN].copy_from_slice(key.expose());
    flat[KEY_LEN..end].copy_from_slice(bytes);
    flat[end] = 0x80;
    let bits = (end as u64 * 8).to_be_bytes();
    flat[count * BLOCK_LEN - LENGTH_LEN..count * BLOCK_LEN].copy_from_slice(&bits);

    let mut state = INITIAL;
    compress256(&mut state, &blocks[..count]);
    // The only copy of the key made here: wiped at once (pitfall 16).
    blocks[0][..KEY_LEN].zeroize();

    let [a, b, c, d] = state[0].to_be_bytes();
    let [e, f, ..] = state[1].to_be_bytes();
    [a, b, c, d, e, f]
}

const KEY_LEN: usize = 32;
const MAX_BYTES: usize = MAX_FRAME - TAG_LEN;
const BLOCK_LEN: usize = 64;
/// SHA-256 ends with the message's length in bits.
const LENGTH_LEN: usize = 8;
const MAX_BLOCKS: usize = (KEY_LEN + MAX_BYTES + 1 + LENGTH_LEN).div_ceil(BLOCK_LEN);
/// The initial state of SHA-256 (FIPS 180-4, 5.3.3).
const INITIAL: [u32; 8] = [
    0x6a09_e667,
    0xbb67_ae85,
    0x3c6e_f372,
    0xa54f_f53a,
    0x510e_527f,
    0x9b05_688c,
    0x1f83_d9ab,
    0x5be0_cd19,
];

#[cfg(test)]
mod tests {
    use super::*;
    use sha2::{Digest as _, Sha256};

    #[test]
    fn it_is_sha_256_at_every_length() {
        let key = SigningKey::new_allowing_zero(core::array::from_fn(|i| i as u8 * 7));
        let bytes: [u8; MAX_BYTES] = core::array::from_fn(|i| i as u8 ^ 0x5a);
        for len in 0..=MAX_BYTES {
            let digest = Sha256::new()
                .chain_update(key.expose())
                .chain_update(&bytes[..len]);
            assert_eq!(
                tag(&key, &bytes[..len]),
                digest.finalize()[..TAG_LEN],
                "{len}"
            );
        }
    }
}
