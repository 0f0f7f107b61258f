//! The pairing code: carried by people from one computer to the other, once.
//!
//! 160 random bits, not a password: psk3 does not protect against offline guessing, so a code chosen by a person would be
//! found (pitfall 18).

use core::fmt;

use hkdf::Hkdf;
use sha2::Sha256;
use thiserror::Error;
use zeroize::{Zeroize, ZeroizeOnDrop, Zeroizing};

use super::identity::{NoRandom, Random};

/// 160 bits, written as 32 base32 characters; wiped when dropped, never printed by `Debug`.
///
/// ```
/// use mavlink_link::exchange::PairingCode;
/// let code = PairingCode::parse("abcd-efgh ijkl-mnop qrst-uvwx yz23-4567")?;
/// assert_eq!(code.text().as_str(), "ABCD-EFGH-IJKL-MNOP-QRST-UVWX-YZ23-4567");
/// # Ok::<(), mavlink_link::exchange::CodeError>(())
/// ```
#[derive(Zeroize, ZeroizeOnDrop)]
pub struct PairingCode([u8; 20]);

impl PairingCode {
    /// A new code.
    ///
    /// # Errors
    /// There are no random bytes.
    pub fn generate(random: &mut dyn Random) -> Result<Self, NoRandom> {
        let mut code = Self([0; 20]);
        random.fill(&mut code.0)?;
        Ok(code)
    }

    /// A code as a person types it: any case; white space and hyphens are ignored, and 0, 1 and 8, which base32 does not
    /// have, are read as O, I and B.
    ///
    /// # Errors
    /// Where the text is wrong, without any of its content.
    pub fn parse(text: &str) -> Result<Self, CodeError> {
        let mut code = Self([0; 20]);
        let mut count = 0_usize;
        for (offset, letter) in text.char_indices() {
            let value = match letter.to_ascii_uppercase() {
                ' ' | '-' | '\t' | '\r' | '\n' => continue,
                // 0, 1 and 8 are not in the alphabet: people read and type them for O, I and B.
                '0' => b'O' - b'A',
                '1' => b'I' - b'A',
                '8' => b'B' - b'A',
                c @ 'A'..='Z' => c as u8 - b'A',
                c @ '2'..='7' => c as u8 - b'2' + 26,
                _ => return Err(CodeError::Letter { offset }),
            };
            for bit in 0..5 {
                let at = count * 5 + bit;
                if let Some(byte) = code.0.get_mut(at / 8) {
                    *byte |= (value >> (4 - bit) & 1) << (7 - at % 8);
                }
            }
            // Counted on, so that the error can name a text that is too long; it stops at one too many, for a text of any
            // length.
            count = count.saturating_add(1);
            if count > LETTERS {
                return Err(CodeError::Length { letters: count });
            }
        }
        if count == LETTERS {
            Ok(code)
        } else {
            Err(CodeError::Length { letters: count })
        }
    }

    /// The code in groups of four, to be shown to a person.
    #[must_use]
    pub fn text(&self) -> Zeroizing<String> {
        // Reserved in full: a growing string would leave copies of the code behind.
        let mut text = Zeroizing::new(String::with_capacity(LETTERS + LETTERS / 4));
        for n in 0..LETTERS {
            if n > 0 && n % 4 == 0 {
                text.push('-');
            }
            let value = (0..5).fold(0_u8, |value, bit| {
                let at = n * 5 + bit;
                value << 1 | (self.0[at / 8] >> (7 - at % 8) & 1)
            });
            text.push(char::from(ALPHABET[usize::from(value)]));
        }
        text
    }

    /// A second copy for a second owner: each is wiped on its own.
    #[must_use]
    pub fn duplicate(&self) -> Self {
        Self(self.0)
    }

    /// The pre-shared key that the code stands for.
    pub(super) fn psk(&self) -> Zeroizing<[u8; 32]> {
        let mut psk = Zeroizing::new([0; 32]);
        // 32 bytes are far less than HKDF can produce, so this cannot fail.
        let _ = Hkdf::<Sha256>::new(None, &self.0).expand(b"vsm/1 pair", &mut *psk);
        psk
    }
}

impl fmt::Debug for PairingCode {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("PairingCode(..)")
    }
}

/// Why a text is not a code. Never shows any of it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Error)]
pub enum CodeError {
    /// A character other than a letter or 2 to 7.
    #[error("not a character of a pairing code at offset {offset}, expected A to Z or 2 to 7")]
    Letter {
        /// Offset in bytes.
        offset: usize,
    },
    /// Too many or too few.
    #[error("{letters} characters, expected 32")]
    Length {
        /// Letters found; counting stops at 33.
        letters: usize,
    },
}

const LETTERS: usize = 32;
const ALPHABET: &[u8; 32] = b"ABCDEFGHIJKLMNOPQRSTUVWXYZ234567";

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_alphabet_is_that_of_rfc_4648() {
        // python3 -c 'import base64; print(base64.b32encode(bytes(range(20))).decode())'
        let code = PairingCode(core::array::from_fn(|n| n as u8));
        assert_eq!(
            code.text().replace('-', ""),
            "AAAQEAYEAUDAOCAJBIFQYDIOB4IBCEQT"
        );
        assert_eq!(PairingCode::parse(&code.text()).unwrap().0, code.0);
        let typed = code
            .text()
            .replace('O', "0")
            .replace('I', "1")
            .to_lowercase();
        assert_eq!(PairingCode::parse(&typed).unwrap().0, code.0);
    }

    #[test]
    fn an_error_shows_the_place() {
        let fault = |text: &str| PairingCode::parse(text).unwrap_err();
        assert_eq!(fault("AB"), CodeError::Length { letters: 2 });
        assert_eq!(fault("AB!"), CodeError::Letter { offset: 2 });
        assert_eq!(fault(&"A".repeat(40)), CodeError::Length { letters: 33 });
    }

    #[test]
    fn debug_shows_nothing() {
        assert_eq!(format!("{:?}", PairingCode([0x41; 20])), "PairingCode(..)");
    }
}
