//! Signing and verifying frames, usable alone.
//!
//! The signature is a keyed hash: the first 6 bytes of SHA-256 over key, header, payload, checksum,
//! link id and stamp. It is not an HMAC. Which stamps are to be sent or accepted is not decided here
//! but in [`clock`] and [`crate::receiver`].

pub mod clock;
mod key;
mod signature;

pub use self::key::{KeyError, KeyId, SigningKey};
pub use self::signature::{SignError, VerifyError, sign, verify};
pub use crate::frame::Stamp;
