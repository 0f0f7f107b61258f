//! Signing and verifying frames, the key, and the clock whose timestamps never repeat.
//!
//! The signature is a keyed hash: the first 6 bytes of SHA-256 over key, header, payload, checksum,
//! link id and timestamp. It is not an HMAC. A correct signature does not make a frame fresh: which timestamps may be
//! sent is decided by [`clock`], which may be accepted by [`crate::receiver`].

pub mod clock;
mod key;
mod signature;

pub use self::key::{KeyError, KeyId, SigningKey};
pub use self::signature::{SignError, VerifyError, sign, verify};
pub use crate::frame::Stamp;
