//! Terms: what a message is made of. The attacker asks whether he can make one; the tests against the code ask for its bytes.

use std::cell::RefCell;
use std::collections::{BTreeSet, HashMap};
use std::rc::Rc;

use hmac::{KeyInit as _, Mac as _};
use sha2::{Digest as _, Sha256};
use snow::params::CipherChoice;
use snow::resolvers::{CryptoResolver as _, DefaultResolver};
use x25519_dalek::{PublicKey, StaticSecret};

/// Who has a secret, or the secret itself: a private key, the pairing code, the first signing key.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub(crate) enum Name {
    Ground,
    Air,
    /// The static key of a ground computer that was stolen.
    Stolen,
    /// The attacker's static and ephemeral keys.
    Eve,
    EveOnce,
    /// The ephemeral keys of the ends, one for each handshake.
    GroundOnce(u8),
    AirOnce(u8),
    Code,
    FirstKey,
    /// The agent's secrets that challenges for orders are made with, one for each time that it draws one.
    Challenges(u8),
}

/// A term by its number: equal terms have the same.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub(crate) struct Term(u32);

#[derive(PartialEq, Eq, Hash)]
enum Made {
    Bytes(Vec<u8>),
    Secret(Name),
    Public(Name),
    /// In order, so that both ends make the same.
    Dh(Name, Name),
    Join(Vec<Term>),
    Hash(Term),
    /// The n-th 32 bytes of HKDF-SHA256.
    Hkdf(Option<Term>, Term, &'static [u8], u8),
    /// HMAC-SHA256, cut to a length.
    Hmac(Term, Term, u8),
    /// ChaCha20-Poly1305: key, nonce, associated data, text.
    Sealed(Term, u8, Term, Term),
}

#[derive(Default)]
struct Terms {
    made: Vec<Rc<Made>>,
    numbers: HashMap<Rc<Made>, Term>,
}

thread_local! {
    static TERMS: RefCell<Terms> = RefCell::default();
    static VALUES: RefCell<HashMap<Term, Vec<u8>>> = RefCell::default();
}

fn make(made: Made) -> Term {
    TERMS.with_borrow_mut(|terms| {
        let made = Rc::new(made);
        let next = Term(terms.made.len() as u32);
        let term = *terms.numbers.entry(made.clone()).or_insert(next);
        if term == next {
            terms.made.push(made);
        }
        term
    })
}

pub(crate) fn bytes(bytes: &[u8]) -> Term {
    make(Made::Bytes(bytes.to_vec()))
}

pub(crate) fn secret(name: Name) -> Term {
    make(Made::Secret(name))
}

pub(crate) fn public(name: Name) -> Term {
    make(Made::Public(name))
}

pub(crate) fn dh(a: Name, b: Name) -> Term {
    make(Made::Dh(a.min(b), a.max(b)))
}

pub(crate) fn join(parts: &[Term]) -> Term {
    make(Made::Join(parts.to_vec()))
}

pub(crate) fn hash(term: Term) -> Term {
    make(Made::Hash(term))
}

pub(crate) fn hkdf(salt: Option<Term>, input: Term, info: &'static [u8], block: u8) -> Term {
    make(Made::Hkdf(salt, input, info, block))
}

pub(crate) fn hmac(key: Term, text: Term, len: u8) -> Term {
    make(Made::Hmac(key, text, len))
}

pub(crate) fn sealed(key: Term, nonce: u8, ad: Term, plain: Term) -> Term {
    make(Made::Sealed(key, nonce, ad, plain))
}

/// What the attacker has: everything that was sent, whole and in parts, and secrets that he was given.
#[derive(Default)]
pub(crate) struct Knowledge {
    pub(crate) received: BTreeSet<Term>,
    pub(crate) names: BTreeSet<Name>,
}

impl Knowledge {
    /// Whether he can make the term. What is sealed in messages he knows without opening them: public keys, numbers and
    /// names of keys, so that he need never take a term apart.
    pub(crate) fn makes(&self, term: Term) -> bool {
        let made = TERMS.with_borrow(|terms| terms.made[term.0 as usize].clone());
        let has =
            |name: &Name| matches!(name, Name::Eve | Name::EveOnce) || self.names.contains(name);
        self.received.contains(&term)
            || match &*made {
                Made::Bytes(_) | Made::Public(_) => true,
                Made::Secret(name) => has(name),
                Made::Dh(a, b) => has(a) || has(b),
                Made::Join(parts) => parts.iter().all(|part| self.makes(*part)),
                Made::Hash(term) => self.makes(*term),
                Made::Hkdf(salt, input, _, _) => {
                    self.makes(*input) && salt.is_none_or(|salt| self.makes(salt))
                }
                Made::Hmac(key, text, _) => self.makes(*key) && self.makes(*text),
                Made::Sealed(key, _, ad, plain) => {
                    self.makes(*key) && self.makes(*ad) && self.makes(*plain)
                }
            }
    }
}

/// How many bytes the term has.
pub(crate) fn len(term: Term) -> usize {
    let made = TERMS.with_borrow(|terms| terms.made[term.0 as usize].clone());
    match &*made {
        Made::Bytes(bytes) => bytes.len(),
        Made::Join(parts) => parts.iter().map(|part| len(*part)).sum(),
        Made::Hmac(_, _, len) => usize::from(*len),
        Made::Sealed(_, _, _, plain) => len(*plain) + 16,
        _ => 32,
    }
}

/// The bytes of a secret. The code is what 32 letters A stand for.
pub(crate) fn secret_bytes(name: Name) -> Vec<u8> {
    match name {
        Name::Code => vec![0; 20],
        _ => Sha256::digest(format!("{name:?}")).to_vec(),
    }
}

pub(crate) fn key_pair(name: Name) -> (StaticSecret, PublicKey) {
    let secret = StaticSecret::from(<[u8; 32]>::try_from(secret_bytes(name)).unwrap());
    let public = PublicKey::from(&secret);
    (secret, public)
}

/// The term as the code would write it.
pub(crate) fn value(term: Term) -> Vec<u8> {
    if let Some(known) = VALUES.with_borrow(|values| values.get(&term).cloned()) {
        return known;
    }
    let value = compute(term);
    VALUES.with_borrow_mut(|values| values.insert(term, value.clone()));
    value
}

fn compute(term: Term) -> Vec<u8> {
    let made = TERMS.with_borrow(|terms| terms.made[term.0 as usize].clone());
    match &*made {
        Made::Bytes(bytes) => bytes.clone(),
        Made::Secret(name) => secret_bytes(*name),
        Made::Public(name) => key_pair(*name).1.as_bytes().to_vec(),
        Made::Dh(a, b) => {
            let shared = key_pair(*a).0.diffie_hellman(&key_pair(*b).1);
            shared.as_bytes().to_vec()
        }
        Made::Join(parts) => parts.iter().flat_map(|part| value(*part)).collect(),
        Made::Hash(term) => Sha256::digest(value(*term)).to_vec(),
        Made::Hkdf(salt, input, info, block) => {
            let mut out = vec![0; 32 * usize::from(*block)];
            let hkdf = hkdf::Hkdf::<Sha256>::new(salt.map(value).as_deref(), &value(*input));
            hkdf.expand(info, &mut out).unwrap();
            out.split_off(out.len() - 32)
        }
        Made::Hmac(key, text, len) => {
            let mut mac = hmac::Hmac::<Sha256>::new_from_slice(&value(*key)).unwrap();
            mac.update(&value(*text));
            mac.finalize().into_bytes()[..usize::from(*len)].to_vec()
        }
        Made::Sealed(key, nonce, ad, plain) => {
            let mut cipher = DefaultResolver
                .resolve_cipher(&CipherChoice::ChaChaPoly)
                .unwrap();
            cipher.set(&value(*key).try_into().unwrap());
            let (ad, plain) = (value(*ad), value(*plain));
            let mut out = vec![0; plain.len() + 16];
            cipher.encrypt(u64::from(*nonce), &ad, &plain, &mut out);
            out
        }
    }
}
