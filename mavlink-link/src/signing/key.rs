//! The signing key: wiped when dropped, never printed, never compared with `==`.
//!
//! The key lives on the heap, in one place: a value that holds a key is moved often, and each move of bytes held inside the
//! value would leave a copy on a stack, which nothing wipes.

use core::fmt;

use hmac::{Hmac, KeyInit as _, Mac as _};
use sha2::Sha256;
use subtle::ConstantTimeEq as _;
use thiserror::Error;
use zeroize::{Zeroize, ZeroizeOnDrop};

/// The 32 bytes that both ends of a link share.
///
/// Neither `Clone` nor `PartialEq`, so that every copy is visible in the code and every comparison takes constant time;
/// `Debug` shows nothing of it (pitfall 16).
///
/// ```compile_fail
/// # let key = mavlink_link::signing::SigningKey::new([1; 32]).unwrap();
/// let copy = key.clone();
/// ```
///
/// ```compile_fail
/// # let key = mavlink_link::signing::SigningKey::new([1; 32]).unwrap();
/// let same = key == key;
/// ```
pub struct SigningKey(Box<[u8; 32]>);

impl Zeroize for SigningKey {
    fn zeroize(&mut self) {
        self.0.zeroize();
    }
}

impl Drop for SigningKey {
    fn drop(&mut self) {
        self.zeroize();
    }
}

impl ZeroizeOnDrop for SigningKey {}

impl SigningKey {
    /// A key of these bytes.
    ///
    /// # Errors
    /// All bytes are zero: anyone could sign.
    pub fn new(bytes: [u8; 32]) -> Result<Self, KeyError> {
        // Wrapped before the check, so that the bytes are wiped on the error path too.
        let key = Self::new_allowing_zero(bytes);
        if bool::from(key.0.ct_eq(&[0; 32])) {
            Err(KeyError::AllZero)
        } else {
            Ok(key)
        }
    }

    /// A key of any bytes, all-zero too: PX4 accepts such a key, so a model of PX4 needs one.
    #[must_use]
    pub fn new_allowing_zero(mut bytes: [u8; 32]) -> Self {
        let key = Self::copy_of(&bytes);
        bytes.zeroize();
        key
    }

    fn copy_of(bytes: &[u8; 32]) -> Self {
        // Made empty and filled in place: a box of the bytes themselves would pass them over the stack.
        let mut key = Self(Box::new([0; 32]));
        key.0.copy_from_slice(bytes);
        key
    }

    /// A key written as 64 hexadecimal digits; white space around them is ignored.
    ///
    /// # Errors
    /// Where the text is wrong, without any of its content: it may be most of a key.
    pub fn from_hex(text: &str) -> Result<Self, KeyError> {
        let offset = text.len() - text.trim_start().len();
        let digits = text.trim().as_bytes();
        let mut key = Self(Box::new([0; 32]));
        // Decoded by hand and not by a library: a decoder that returns a vector or an array would leave a copy behind.
        for (at, &digit) in digits.iter().enumerate() {
            let value = match digit {
                b'0'..=b'9' => digit - b'0',
                b'a'..=b'f' => digit - b'a' + 10,
                b'A'..=b'F' => digit - b'A' + 10,
                _ => {
                    return Err(KeyError::Digit {
                        offset: offset + at,
                    });
                }
            };
            // Digits beyond the 64th are counted for the error and not stored.
            if let Some(byte) = key.0.get_mut(at / 2) {
                *byte = *byte << 4 | value;
            }
        }
        if digits.len() != 64 {
            return Err(KeyError::Length {
                digits: digits.len(),
            });
        }
        if bool::from(key.0.ct_eq(&[0; 32])) {
            Err(KeyError::AllZero)
        } else {
            Ok(key)
        }
    }

    /// The public name of the key: the first 8 bytes of HMAC-SHA256(key, "vsm/1 key id").
    #[must_use]
    pub fn id(&self) -> KeyId {
        // An HMAC accepts a key of any length, so this cannot fail.
        let mut id = [0; 8];
        if let Ok(mut mac) = Hmac::<Sha256>::new_from_slice(&*self.0) {
            mac.update(b"vsm/1 key id");
            id.copy_from_slice(&mac.finalize().into_bytes()[..8]);
        }
        KeyId(id)
    }

    /// Whether both are the same key, in constant time.
    #[must_use]
    pub fn same_as(&self, other: &Self) -> bool {
        // `==` returns at the first difference, and its duration shows how many bytes matched (pitfall 16).
        self.0.ct_eq(&*other.0).into()
    }

    /// A second copy for a second owner: each is wiped on its own.
    #[must_use]
    pub fn duplicate(&self) -> Self {
        Self::copy_of(&self.0)
    }

    /// The bytes themselves, where they lie, for the hash, a key file or SETUP_SIGNING. Keep no copy.
    #[must_use]
    pub fn expose(&self) -> &[u8; 32] {
        &self.0
    }
}

impl fmt::Debug for SigningKey {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("SigningKey(..)")
    }
}

/// Names a key without revealing it: for logs, status and the file names of stored clocks.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct KeyId([u8; 8]);

impl KeyId {
    /// An id as stored or received.
    #[must_use]
    pub const fn from_bytes(bytes: [u8; 8]) -> Self {
        Self(bytes)
    }

    /// An id as [`Display`](fmt::Display) writes it.
    #[must_use]
    pub fn parse(text: &str) -> Option<Self> {
        let digits = text.as_bytes();
        let mut id = [0; 8];
        for (byte, pair) in id.iter_mut().zip(digits.chunks_exact(2)) {
            let pair = core::str::from_utf8(pair).ok()?;
            *byte = u8::from_str_radix(pair, 16).ok()?;
        }
        // `from_str_radix` accepts a leading plus sign.
        (digits.len() == 16 && !text.contains('+')).then_some(Self(id))
    }

    /// The id's bytes.
    #[must_use]
    pub const fn bytes(&self) -> &[u8; 8] {
        &self.0
    }
}

impl fmt::Display for KeyId {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.0.iter().try_for_each(|byte| write!(f, "{byte:02x}"))
    }
}

/// Why a text or bytes are not a key. Never shows any of them.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Error)]
pub enum KeyError {
    /// Not 64 digits.
    #[error("{digits} hexadecimal digits, expected 64")]
    Length {
        /// Digits found.
        digits: usize,
    },
    /// A character that is not a hexadecimal digit.
    #[error("not a hexadecimal digit at offset {offset}")]
    Digit {
        /// Offset in bytes from the start of the text.
        offset: usize,
    },
    /// The all-zero key, which everyone knows.
    #[error("the key is all zero, expected 32 random bytes")]
    AllZero,
}

#[cfg(test)]
mod tests {
    use super::*;

    const HEX: &str = "0102030405060708090a0b0c0d0e0f101112131415161718191A1B1C1D1E1F20";

    #[test]
    fn hex_is_read_with_its_newline() {
        let key = SigningKey::from_hex(&format!("{HEX}\n")).unwrap();
        assert_eq!(key.expose()[0], 1);
        assert_eq!(key.expose()[31], 0x20);
        assert!(key.same_as(&key.duplicate()));
    }

    #[test]
    fn an_error_shows_the_place_and_no_content() {
        let long = format!("{HEX}00");
        assert_eq!(
            SigningKey::from_hex(&long).unwrap_err(),
            KeyError::Length { digits: 66 }
        );
        assert_eq!(
            SigningKey::from_hex("").unwrap_err(),
            KeyError::Length { digits: 0 }
        );
        let wrong = format!(" {}", HEX.replace("0a", "0g"));
        assert_eq!(
            SigningKey::from_hex(&wrong).unwrap_err(),
            KeyError::Digit { offset: 20 }
        );
        assert_eq!(
            SigningKey::from_hex(&"0".repeat(64)).unwrap_err(),
            KeyError::AllZero
        );
    }

    #[test]
    fn the_id_is_an_hmac_of_the_key() {
        // python3 -c 'import hmac; print(hmac.new(bytes(range(1, 33)), b"vsm/1 key id", "sha256").hexdigest()[:16])'
        let key = SigningKey::from_hex(HEX).unwrap();
        assert_eq!(key.id().to_string(), "965fac51df6401b4");
        assert_eq!(KeyId::parse("965fac51df6401b4"), Some(key.id()));
        for wrong in [
            "",
            "965fac51df6401b",
            "965fac51df6401b40",
            "965fac51df6401g4",
            "+65fac51df6401b4",
        ] {
            assert_eq!(KeyId::parse(wrong), None);
        }
    }
}
