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

/// Seals values under the key of the fleet, each bound to the name under which it is stored.
pub(super) struct Seal(Aes256Gcm);

impl std::fmt::Debug for Seal {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str("Seal(..)")
    }
}

impl Seal {
    /// From the key of `store.key_file`. The sealing key is derived from it, so that the file's key itself has no other
    /// use.
    pub(super) fn new(key: &SigningKey) -> Seal {
        let derived = Hmac::<Sha256>::new_from_slice(key.expose());
        let mut derived = derived.expect("HMAC takes a key of any length");
        derived.update(b"vsm store of a fleet");
        let derived = Zeroizing::new(<[u8; 32]>::from(derived.finalize().into_bytes()));
        Seal(Aes256Gcm::new((&*derived).into()))
    }

    /// Random nonces of 96 bits: some 2^32 values may be sealed with one key (NIST SP 800-38D, 8.3), a thousand a second
    /// for 49 days, or one a second for 136 years.
    pub(super) fn seal(&self, name: &str, plain: &[u8]) -> io::Result<Vec<u8>> {
        let mut nonce = [0; NONCE];
        system_random(&mut nonce).map_err(|fault| io::Error::other(fault.to_string()))?;
        let mut sealed = nonce.to_vec();
        sealed.extend_from_slice(plain);
        let tag = self
            .0
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
        self.0
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

const NONCE: usize = 12;
const TAG: usize = 16;

#[cfg(test)]
mod tests {
    use super::*;

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
