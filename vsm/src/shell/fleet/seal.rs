//! Encrypts what leaves this node for the store of a fleet: etcd, its backups and its network see no plan, identity or
//! clock, and can change none.

use std::io;

use aes_gcm::aead::{AeadInOut as _, KeyInit as _};
use aes_gcm::{Aes256Gcm, Nonce, Tag};
use hmac::{Hmac, Mac as _};
use mavlink_link::signing::SigningKey;
use sha2::Sha256;
use zeroize::Zeroizing;

use crate::shell::key_file::system_random;

/// Seals values under the key of the fleet, each bound to the name under which it is stored, and numbers changes.
pub(super) struct Seal {
    cipher: Aes256Gcm,
    /// Of what numbers a change: nothing of that is secret, and it needs none of the few nonces.
    numbers: Zeroizing<[u8; 32]>,
}

impl std::fmt::Debug for Seal {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str("Seal(..)")
    }
}

impl Seal {
    /// From the key of `store.key_file`. The sealing key is derived from it, so that the file's key itself has no other
    /// use.
    pub(super) fn new(key: &SigningKey) -> Seal {
        let derived = |label: &[u8]| {
            let derived = mac(key.expose(), &[label]).finalize().into_bytes();
            Zeroizing::new(<[u8; 32]>::from(derived))
        };
        let sealing = derived(b"vsm store of a fleet");
        Seal {
            cipher: Aes256Gcm::new((&*sealing).into()),
            numbers: derived(b"vsm changes of a fleet"),
        }
    }

    /// What identifies the change of this number, and no other: its number, random bytes, and a MAC of both.
    pub(super) fn token(&self, name: &str, number: u64) -> io::Result<Vec<u8>> {
        let mut random = [0; 16];
        system_random(&mut random).map_err(|fault| io::Error::other(fault.to_string()))?;
        let mut token = number.to_be_bytes().to_vec();
        token.extend_from_slice(&random);
        let mac = mac(&*self.numbers, &[name.as_bytes(), &token]);
        token.extend_from_slice(&mac.finalize().into_bytes());
        Ok(token)
    }

    /// The number of a change. 0 for what this key has not made: it is before every change.
    pub(super) fn number_of(&self, name: &str, token: &[u8]) -> u64 {
        let Some((numbered, there)) = token.split_last_chunk::<32>() else {
            return 0;
        };
        let mac = mac(&*self.numbers, &[name.as_bytes(), numbered]);
        match (mac.verify_slice(there), numbered.first_chunk()) {
            (Ok(()), Some(number)) => u64::from_be_bytes(*number),
            _ => 0,
        }
    }

    /// Random nonces of 96 bits: some 2^32 values may be sealed with one key (NIST SP 800-38D, 8.3), a thousand a second
    /// for 49 days, or one a second for 136 years.
    pub(super) fn seal(&self, name: &str, plain: &[u8]) -> io::Result<Vec<u8>> {
        let mut nonce = [0; NONCE];
        system_random(&mut nonce).map_err(|fault| io::Error::other(fault.to_string()))?;
        let mut sealed = nonce.to_vec();
        sealed.extend_from_slice(plain);
        let tag = self
            .cipher
            .encrypt_inout_detached(
                &Nonce::from(nonce),
                // The name as associated data: etcd cannot swap two values.
                name.as_bytes(),
                (&mut sealed[NONCE..]).into(),
            )
            .map_err(|_| io::Error::other("it is too long to be sealed"))?;
        sealed.extend_from_slice(&tag);
        Ok(sealed)
    }

    pub(super) fn open(&self, name: &str, sealed: &[u8]) -> io::Result<Zeroizing<Vec<u8>>> {
        let other = || {
            io::Error::new(
                io::ErrorKind::InvalidData,
                format!(
                    "{name} in etcd was not written with the key of store.key_file, or was changed"
                ),
            )
        };
        let (nonce, rest) = sealed.split_first_chunk::<NONCE>().ok_or_else(other)?;
        let (data, tag) = rest.split_last_chunk::<TAG>().ok_or_else(other)?;
        let mut plain = Zeroizing::new(data.to_vec());
        self.cipher
            .decrypt_inout_detached(
                &Nonce::from(*nonce),
                name.as_bytes(),
                plain.as_mut_slice().into(),
                &Tag::from(*tag),
            )
            .map_err(|_| other())?;
        Ok(plain)
    }
}

fn mac(key: &[u8], parts: &[&[u8]]) -> Hmac<Sha256> {
    let mac = Hmac::<Sha256>::new_from_slice(key);
    let mut mac = mac.expect("HMAC takes a key of any length");
    parts.iter().for_each(|part| mac.update(part));
    mac
}

const NONCE: usize = 12;
const TAG: usize = 16;

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn nobody_without_the_key_gives_a_change_a_number() {
        let seal = Seal::new(&SigningKey::new([7; 32]).unwrap());
        let token = seal.token("last/1", 4_586).unwrap();
        assert_ne!(seal.token("last/1", 4_586).unwrap(), token);
        assert_eq!(seal.number_of("last/1", &token), 4_586);
        assert_eq!(seal.number_of("last/0", &token), 0);
        let other = Seal::new(&SigningKey::new([8; 32]).unwrap());
        assert_eq!(other.number_of("last/1", &token), 0);
        for at in 0..token.len() {
            let mut changed = token.clone();
            changed[at] ^= 1;
            assert_eq!(seal.number_of("last/1", &changed), 0, "byte {at}");
            assert_eq!(seal.number_of("last/1", &token[..at]), 0, "{at} bytes");
        }
    }

    #[test]
    fn a_value_opens_under_its_own_name_and_key_only_and_unchanged() {
        let seal = Seal::new(&SigningKey::new([7; 32]).unwrap());
        let sealed = seal.seal("head/plan", b"a plan").unwrap();
        assert_eq!(&**seal.open("head/plan", &sealed).unwrap(), b"a plan");
        assert!(seal.open("head/other", &sealed).is_err());
        assert!(
            Seal::new(&SigningKey::new([8; 32]).unwrap())
                .open("head/plan", &sealed)
                .is_err()
        );
        for at in 0..sealed.len() {
            let mut changed = sealed.clone();
            changed[at] ^= 1;
            assert!(seal.open("head/plan", &changed).is_err(), "byte {at}");
            assert!(seal.open("head/plan", &sealed[..at]).is_err(), "{at} bytes");
        }
        assert!(!sealed.windows(6).any(|part| part == b"a plan"));
    }
}
