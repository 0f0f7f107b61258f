//! The gate before the handshake: an authenticator, under a key that only the two ends can have, on every message but step
//! 15. A message without it costs one hash, and no Diffie-Hellman, no session and no token of a rate limit.
//!
//! The key comes from the pairing code (suite 2), or from the two static keys (suite 1), so it exists before a message
//! arrives. It works as WireGuard's mac1 and mac2. The first authenticator shows that the message was made by someone with
//! the key. The second, which only the initiator sends and the responder requires under load, shows that the sender
//! receives at its address. A recording has the first, and never the second from another address.

use core::hash::{Hash, Hasher};

use hkdf::Hkdf;
use hmac::{Hmac, KeyInit as _, Mac as _};
use sha2::Sha256;
use subtle::ConstantTimeEq as _;
use zeroize::Zeroizing;

use super::identity::{Identity, PublicKey};
use super::message::{Data, Message, Step};
use super::pairing::PairingCode;

/// Bytes of one authenticator.
const TAG: usize = 16;

/// Proves that a sender receives at its address.
pub(super) type Cookie = [u8; TAG];

/// The key of one peer's authenticators.
#[derive(Clone)]
pub(super) struct Gate(Zeroizing<[u8; 32]>);

impl Gate {
    /// For a pairing: both ends have been given the same code.
    pub(super) fn of_code(code: &PairingCode) -> Self {
        Self::derive(&code.psk(), b"vsm/2 pairing gate")
    }

    /// Between pinned ends. `None` for a peer key that gives the same secret with everyone.
    pub(super) fn of_peers(own: &Identity, peer: &PublicKey) -> Option<Self> {
        let shared = own.secret().diffie_hellman(&(*peer.bytes()).into());
        let gate = Self::derive(shared.as_bytes(), b"vsm/2 pinned gate");
        shared.was_contributory().then_some(gate)
    }

    fn derive(secret: &[u8; 32], info: &[u8]) -> Self {
        let mut key = Zeroizing::new([0; 32]);
        // 32 bytes are far less than HKDF can produce, so this cannot fail.
        let _ = Hkdf::<Sha256>::new(None, secret).expand(info, &mut *key);
        Self(key)
    }

    /// The message with its authenticators; with the second one where the responder has required it.
    pub(super) fn seal(&self, message: &Message, cookie: Option<&Cookie>) -> Option<Message> {
        let data = message.data.as_slice();
        let mut sealed = [0; super::message::MAX_DATA];
        let len = data.len() + trailer(message.step);
        let (body, rest) = sealed.get_mut(..len)?.split_at_mut(data.len());
        body.copy_from_slice(data);
        let first = self.first(message);
        rest.get_mut(..TAG)?.copy_from_slice(&first);
        if let (Some(cookie), Some(second)) = (cookie, rest.get_mut(TAG..)) {
            second.copy_from_slice(&self.second(&first, cookie));
        }
        Some(Message {
            data: Data::new(&sealed[..len])?,
            ..message.clone()
        })
    }

    /// The message without its authenticators, where the first is right.
    pub(super) fn open(&self, sealed: &Message) -> Option<Opened> {
        let data = sealed.data.as_slice();
        let (body, rest) = data.split_at_checked(data.len().checked_sub(trailer(sealed.step))?)?;
        let message = Message {
            data: Data::new(body)?,
            ..sealed.clone()
        };
        // Read in full before it is used: a forged length only ends here.
        let (first, second) = rest.split_first_chunk::<TAG>()?;
        bool::from(self.first(&message).ct_eq(first)).then(|| Opened {
            first: *first,
            second: second.try_into().ok(),
            message,
        })
    }

    /// Whether the second authenticator was made with this cookie.
    pub(super) fn has_cookie(&self, opened: &Opened, cookie: &Cookie) -> bool {
        let second = self.second(&opened.first, cookie);
        opened
            .second
            .is_some_and(|found| bool::from(second.ct_eq(&found)))
    }

    fn first(&self, message: &Message) -> [u8; TAG] {
        // Up to the data: the zeros behind it are trimmed on the wire.
        let used = 43 + message.data.as_slice().len();
        self.tag(&[
            b"first",
            message.to_payload().get(..used).unwrap_or_default(),
        ])
    }

    fn second(&self, first: &[u8; TAG], cookie: &Cookie) -> [u8; TAG] {
        self.tag(&[b"second", cookie, first])
    }

    fn tag(&self, parts: &[&[u8]]) -> [u8; TAG] {
        tag(&self.0, parts)
    }
}

impl core::fmt::Debug for Gate {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.write_str("Gate(..)")
    }
}

/// A message whose first authenticator is right.
#[derive(Debug)]
pub(super) struct Opened {
    /// Without authenticators.
    pub(super) message: Message,
    first: [u8; TAG],
    second: Option<[u8; TAG]>,
}

impl Opened {
    /// Whether there is a second authenticator at all.
    pub(super) fn has_second(&self) -> bool {
        self.second.is_some_and(|second| second != [0; TAG])
    }
}

/// Only the initiator ever has to prove its address.
fn trailer(step: Step) -> usize {
    match step {
        Step::Offer | Step::Confirm => 2 * TAG,
        _ => TAG,
    }
}

/// The cookie of an address, by a secret that nobody else has: no state is kept per address.
pub(super) fn cookie_of<A: Hash>(secret: &[u8; 32], address: &A) -> Cookie {
    let mut mac = Feeder(keyed(secret));
    address.hash(&mut mac);
    shortened(mac.0)
}

/// Feeds the parts of an address to the authenticator.
struct Feeder(Hmac<Sha256>);

impl Hasher for Feeder {
    fn write(&mut self, bytes: &[u8]) {
        self.0.update(bytes);
    }

    fn finish(&self) -> u64 {
        // Unused: the bytes that `Hash` writes are all that is needed, as input of an HMAC.
        0
    }
}

fn tag(key: &[u8; 32], parts: &[&[u8]]) -> [u8; TAG] {
    let mut mac = keyed(key);
    parts.iter().for_each(|part| mac.update(part));
    shortened(mac)
}

fn keyed(key: &[u8; 32]) -> Hmac<Sha256> {
    // Padded to the hash's block as HMAC does it, so that there is no length that could be wrong.
    let mut block = Zeroizing::new([0; 64]);
    block[..32].copy_from_slice(key);
    Hmac::<Sha256>::new((&*block).into())
}

fn shortened(mac: Hmac<Sha256>) -> [u8; TAG] {
    let mut tag = [0; TAG];
    tag.copy_from_slice(&mac.finalize().into_bytes()[..TAG]);
    tag
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::exchange::message::{Status, VERSION};
    use crate::frame::Node;

    fn message(step: Step, data: &[u8]) -> Message {
        Message {
            public_key: [7; 32],
            session: 5,
            version: VERSION,
            step,
            suite: 2,
            status: Status::Ok,
            target: Node {
                system: 1,
                component: 191,
            },
            data: Data::new(data).unwrap(),
        }
    }

    fn gate(letter: char) -> Gate {
        let code = letter.to_string().repeat(32);
        Gate::of_code(&PairingCode::parse(&code).unwrap())
    }

    #[test]
    fn a_message_passes_whole_and_under_its_own_key_only() {
        for step in [Step::Please, Step::Offer, Step::Answer, Step::Confirm] {
            let plain = message(step, &[3; 88]);
            let sealed = gate('A').seal(&plain, None).unwrap();
            assert_eq!(gate('A').open(&sealed).unwrap().message, plain);
            assert!(gate('B').open(&sealed).is_none());
            let bytes = sealed.to_payload();
            for at in 0..43 + sealed.data.as_slice().len() - 16 {
                let mut bent = bytes;
                bent[at] ^= 1;
                let Ok(super::super::Received::Exchange(bent)) = Message::parse(&bent) else {
                    continue;
                };
                assert!(gate('A').open(&bent).is_none(), "{step:?} byte {at}");
            }
        }
        assert!(gate('A').open(&message(Step::Offer, &[0; 31])).is_none());
    }

    #[test]
    fn both_pinned_ends_have_the_same_gate_and_a_bad_point_has_none() {
        let (one, other) = (Identity::new([1; 32]), Identity::new([2; 32]));
        let here = Gate::of_peers(&one, &other.public()).unwrap();
        let there = Gate::of_peers(&other, &one.public()).unwrap();
        let sealed = here.seal(&message(Step::Offer, &[]), None).unwrap();
        assert!(there.open(&sealed).is_some());
        assert!(Gate::of_peers(&one, &PublicKey::new([0; 32])).is_none());
    }

    #[test]
    fn a_cookie_is_of_one_address_and_one_secret() {
        let (gate, plain) = (gate('A'), message(Step::Offer, &[1; 16]));
        let cookie = cookie_of(&[9; 32], &7_u16);
        let opened = gate
            .open(&gate.seal(&plain, Some(&cookie)).unwrap())
            .unwrap();
        assert!(gate.has_cookie(&opened, &cookie));
        assert!(!gate.has_cookie(&opened, &cookie_of(&[9; 32], &8_u16)));
        assert!(!gate.has_cookie(&opened, &cookie_of(&[8; 32], &7_u16)));
        let without = gate.open(&gate.seal(&plain, None).unwrap()).unwrap();
        assert!(!gate.has_cookie(&without, &cookie));
    }
}
