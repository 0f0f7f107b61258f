//! The messages: both handshakes as the Noise specification writes them, what is derived from them, and KEY_EXCHANGE.

use std::hash::{Hash, Hasher};

use super::Flaw;
use super::terms::{Name, Term, bytes, dh, hash, hkdf, hmac, join, len, public, sealed, secret};

#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub(crate) enum Suite {
    Pinned,
    Pairing,
}

#[derive(Clone, Copy, PartialEq, Eq)]
enum Token {
    E,
    S,
    Ee,
    Es,
    Se,
    Ss,
    Psk,
}

impl Suite {
    fn name(self) -> &'static [u8] {
        match self {
            Self::Pinned => b"Noise_KK_25519_ChaChaPoly_SHA256",
            Self::Pairing => b"Noise_XXpsk3_25519_ChaChaPoly_SHA256",
        }
    }

    fn pattern(self) -> &'static [&'static [Token]] {
        use Token::{E, Ee, Es, Psk, S, Se, Ss};
        match self {
            Self::Pinned => &[&[E, Es, Ss], &[E, Ee, Se]],
            Self::Pairing => &[&[E], &[E, Ee, S, Es], &[S, Se, Psk]],
        }
    }
}

/// What an end reports of itself inside a handshake.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub(crate) struct Facts {
    pub(crate) counter: u8,
    pub(crate) epoch: u8,
    /// The key in force.
    pub(crate) current: Option<Term>,
}

impl Facts {
    fn term(self) -> Term {
        let numbers = [
            self.counter,
            0,
            0,
            0,
            0,
            0,
            0,
            0,
            1,
            0,
            0,
            0,
            self.epoch,
            0,
            0,
            0,
        ];
        let id = match self.current {
            Some(key) => hmac(key, bytes(b"vsm/1 key id"), 8),
            None => bytes(&[0; 8]),
        };
        join(&[bytes(&numbers), id])
    }
}

/// What a message contains beside its seals: for an honest one what its sender is, for another what the attacker chose.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub(crate) struct Content {
    pub(crate) step: u8,
    pub(crate) session: u8,
    pub(crate) ephemeral: Name,
    pub(crate) identity: Name,
    pub(crate) facts: Facts,
    /// Status and number of step 4.
    pub(crate) outcome: [u8; 2],
}

/// One end's handshake.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub(crate) struct Handshake {
    pub(crate) suite: Suite,
    pub(crate) session: u8,
    pub(crate) initiates: bool,
    /// Static and ephemeral.
    pub(crate) own: [Name; 2],
    pub(crate) theirs: [Option<Name>; 2],
    h: Term,
    ck: Term,
    key: Option<Term>,
    nonce: u8,
}

impl Handshake {
    pub(crate) fn new(
        suite: Suite,
        session: u8,
        initiates: bool,
        own: [Name; 2],
        peer: Option<Name>,
    ) -> Handshake {
        let name = suite.name();
        let ck = if name.len() <= 32 {
            bytes(name)
        } else {
            hash(bytes(name))
        };
        let mut handshake = Handshake {
            suite,
            session,
            initiates,
            own,
            theirs: [peer, None],
            h: ck,
            ck,
            key: None,
            nonce: 0,
        };
        let policy = mavlink_link::exchange::policy_digest(mavlink_link::exchange::POLICY);
        let suite = match handshake.suite {
            Suite::Pinned => 1,
            Suite::Pairing => 2,
        };
        handshake.mix_hash(bytes(
            &[
                b"vsm-key-agreement/1\0".as_slice(),
                &[
                    suite, 245, 190, 1, 191, 0x1b, 0, 0, 1, 0x1b, 0, 1, 1, session, 0, 0, 0,
                ],
                &policy,
            ]
            .concat(),
        ));
        if let Some(peer) = peer {
            let both = if initiates {
                [own[0], peer]
            } else {
                [peer, own[0]]
            };
            both.into_iter()
                .for_each(|key| handshake.mix_hash(public(key)));
        }
        handshake
    }

    fn mix_hash(&mut self, term: Term) {
        self.h = hash(join(&[self.h, term]));
    }

    fn mix_key(&mut self, term: Term) {
        self.key = Some(hkdf(Some(self.ck), term, b"", 2));
        self.ck = hkdf(Some(self.ck), term, b"", 1);
        self.nonce = 0;
    }

    fn seal(&mut self, plain: Term) -> Term {
        let Some(key) = self.key else {
            unreachable!("no pattern here seals without a key")
        };
        let text = sealed(key, self.nonce, self.h, plain);
        self.nonce += 1;
        self.mix_hash(text);
        text
    }

    /// The next message but for its ephemeral key, written, or as it must be to be read.
    pub(crate) fn step(&mut self, sends: bool, content: &Content, flaw: Option<Flaw>) -> Vec<Term> {
        let at = usize::from(content.step) - 1;
        let mut data = Vec::new();
        for token in self.suite.pattern()[at] {
            let [own_s, own_e] = self.own;
            let [their_s, their_e] = self.theirs.map(|name| name.unwrap_or(Name::Eve));
            match token {
                Token::E => {
                    self.theirs[1] = if sends {
                        self.theirs[1]
                    } else {
                        Some(content.ephemeral)
                    };
                    self.mix_hash(public(content.ephemeral));
                    if self.suite == Suite::Pairing {
                        self.mix_key(public(content.ephemeral));
                    }
                }
                Token::S => {
                    self.theirs[0] = if sends {
                        self.theirs[0]
                    } else {
                        Some(content.identity)
                    };
                    data.push(self.seal(public(content.identity)));
                }
                Token::Ee if flaw == Some(Flaw::NoEphemerals) => {}
                Token::Se if flaw == Some(Flaw::NoInitiatorKey) => {}
                Token::Psk if flaw == Some(Flaw::NoCode) => {}
                Token::Ee => self.mix_key(dh(own_e, their_e)),
                Token::Ss => self.mix_key(dh(own_s, their_s)),
                // The first letter is the initiator's key.
                Token::Es if self.initiates => self.mix_key(dh(own_e, their_s)),
                Token::Es => self.mix_key(dh(own_s, their_e)),
                Token::Se if self.initiates => self.mix_key(dh(own_s, their_e)),
                Token::Se => self.mix_key(dh(own_e, their_s)),
                Token::Psk => {
                    let psk = code_psk();
                    self.mix_hash(hkdf(Some(self.ck), psk, b"", 2));
                    self.key = Some(hkdf(Some(self.ck), psk, b"", 3));
                    self.ck = hkdf(Some(self.ck), psk, b"", 1);
                    self.nonce = 0;
                }
            }
        }
        let payload = match (self.suite, content.step) {
            (Suite::Pairing, 1) => bytes(&[]),
            _ => content.facts.term(),
        };
        data.push(self.seal(payload));
        data
    }

    fn derive(&self, info: &'static [u8]) -> Term {
        let [k1, k2] = [1, 2].map(|block| hkdf(Some(self.ck), bytes(&[]), b"", block));
        hkdf(Some(self.h), join(&[k1, k2]), info, 1)
    }

    /// The signing key of a finished handshake.
    pub(crate) fn signing_key(&self) -> Term {
        self.derive(b"vsm/1 mavlink")
    }

    pub(crate) fn confirmation(&self) -> Term {
        let text = join(&[self.h, bytes(b"I"), bytes(&[self.session, 0, 0, 0])]);
        hmac(self.derive(b"vsm/1 confirm i"), text, 32)
    }

    pub(crate) fn outcome(&self, [status, number]: [u8; 2]) -> Vec<Term> {
        let body = bytes(&[status, 0, 0, 0, number, 0, 0, 0]);
        let text = join(&[self.h, bytes(b"R"), bytes(&[self.session, 0, 0, 0]), body]);
        vec![body, hmac(self.derive(b"vsm/1 confirm r"), text, 32)]
    }
}

fn code_psk() -> Term {
    hkdf(None, secret(Name::Code), b"vsm/1 pair", 1)
}

/// The key of the gate: of the pairing code, or of two pinned ends.
pub(crate) fn gate(pinned: Option<[Name; 2]>) -> Term {
    match pinned {
        Some([a, b]) => hkdf(None, dh(a, b), b"vsm/2 pinned gate", 1),
        None => hkdf(None, code_psk(), b"vsm/2 pairing gate", 1),
    }
}

/// A message on the wire: whole, and what its sender must be able to make.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) struct Message {
    pub(crate) wire: Term,
    pub(crate) suite: Suite,
    pub(crate) content: Content,
    pub(crate) parts: Vec<Term>,
}

impl Message {
    pub(crate) fn new(suite: Suite, content: Content, data: &[Term], gate: Term) -> Message {
        let up = content.step % 2 == 1;
        let [system, component] = if up { [1, 191] } else { [245, 190] };
        let used: usize = data.iter().map(|part| len(*part)).sum();
        let trailer = if up { 32 } else { 16 };
        let header = |len: usize| {
            let suite = if suite == Suite::Pinned { 1 } else { 2 };
            let rest = [
                content.session,
                0,
                0,
                0,
                2,
                content.step,
                suite,
                0,
                system,
                component,
                len as u8,
            ];
            [public(content.ephemeral), bytes(&rest)]
        };
        let text = [&[bytes(b"first")], header(used).as_slice(), data].concat();
        let tag = hmac(gate, join(&text), 16);
        // The proof of an address, which is only asked for under load.
        let proof = if up { vec![bytes(&[0; 16])] } else { vec![] };
        let parts = [data, &[tag]].concat();
        let wire = join(&[header(used + trailer).as_slice(), &parts, &proof].concat());
        Message {
            wire,
            suite,
            content,
            parts,
        }
    }
}

impl Hash for Message {
    fn hash<H: Hasher>(&self, state: &mut H) {
        // All else follows from it.
        self.wire.hash(state);
    }
}
