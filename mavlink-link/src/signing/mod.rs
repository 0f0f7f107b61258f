//! Signing and verifying frames, usable alone.
//!
//! The signature is a keyed hash: the first 6 bytes of SHA-256 over key, header, payload, checksum,
//! link id and stamp. It is not an HMAC. Which stamps are to be sent or accepted is not decided here
//! but in [`crate::clock`] and [`crate::receiver`].

mod hash;
mod key;
mod stamp;

pub use self::key::{KeyError, KeyId, SigningKey};
pub use self::stamp::Stamp;

use subtle::ConstantTimeEq as _;
use thiserror::Error;

use self::hash::tag;
use crate::frame::{
    FrameView, HEADER_LEN, INCOMPAT_SIGNED, MAX_FRAME, SIGNATURE_LEN, STX, TAG_LEN,
};

/// Appends the trailer to the frame `out[..len]` and returns the new length.
///
/// The flag is covered by the checksum, so the frame must have been encoded with
/// [`INCOMPAT_SIGNED`] in its header.
///
/// # Errors
/// `out[..len]` is no frame marked so, or there is no room left for the trailer.
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
    if out[2] & INCOMPAT_SIGNED == 0 {
        return Err(SignError::NotMarked);
    }
    out[len] = link_id;
    out[len + 1..end - TAG_LEN].copy_from_slice(&stamp.to_le_bytes());
    let tag = tag(key, &out[..end - TAG_LEN]);
    out[end - TAG_LEN..end].copy_from_slice(&tag);
    Ok(end)
}

/// Whether the frame's signature is that of `key`, compared in constant time.
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
    /// The bytes are no frame with room for a trailer.
    #[error("{len} bytes are no unsigned frame with room for a trailer")]
    NoFrame {
        /// Length given.
        len: usize,
    },
    /// The frame was encoded without the flag of a signed one.
    #[error("the frame was encoded without the incompatibility flag 0x01")]
    NotMarked,
}

/// Why a frame proves nothing.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Error)]
pub enum VerifyError {
    /// It carries no signature.
    #[error("the frame is not signed")]
    Unsigned,
    /// Its signature was not made with this key.
    #[error("the signature does not fit the key")]
    BadSignature,
}
