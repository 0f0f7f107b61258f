//! The legacy exchange: a public key every 10 s, and the shared secret as signing key, without authentication.
//!
//! Anyone in the middle can pose as either end. It exists for peers that have nothing better. Nothing falls back to it, and
//! a program must warn where it is switched on. Promised all the same: random keys, refusal of a peer that contributes
//! nothing, and that a later peer never replaces the first of a process.

use core::fmt;
use core::time::Duration;

use super::identity::{Identity, PublicKey};
use super::message::{MAX_MESSAGE, Message, Received};
use super::stats::{ExchangeStats, Ignored};
use crate::frame::Node;
use crate::signing::SigningKey;

/// One end of the legacy exchange; both are the same.
pub struct Legacy {
    identity: Identity,
    peer: Node,
    theirs: Option<PublicKey>,
    send_at: Duration,
    stats: ExchangeStats,
}

impl Legacy {
    /// An end with a fresh random key and the peer's system and component; its first message is due at once.
    #[must_use]
    pub fn new(identity: Identity, peer: Node, now: Duration) -> Self {
        Self {
            identity,
            peer,
            theirs: None,
            send_at: now,
            stats: ExchangeStats::default(),
        }
    }

    /// The payload that is due, if any: the public key, all other fields zero.
    pub fn poll_transmit(&mut self, now: Duration) -> Option<[u8; MAX_MESSAGE]> {
        if now < self.send_at {
            return None;
        }
        self.send_at = now.saturating_add(EVERY);
        let mut payload = [0; MAX_MESSAGE];
        payload[..32].copy_from_slice(self.identity.public().bytes());
        Some(payload)
    }

    /// When the next message is due.
    #[must_use]
    pub fn poll_timeout(&self) -> Duration {
        self.send_at
    }

    /// Takes a payload; returns the shared key for the first public key of the peer.
    ///
    /// # Errors
    /// Why it was ignored.
    pub fn handle(&mut self, source: Node, payload: &[u8]) -> Result<SigningKey, Ignored> {
        let result = self.judge(source, payload);
        self.stats
            .count(result.as_ref().map(|_| ()).map_err(|ignored| *ignored));
        result
    }

    fn judge(&mut self, source: Node, payload: &[u8]) -> Result<SigningKey, Ignored> {
        if source != self.peer {
            return Err(Ignored::Source);
        }
        let Received::Legacy(theirs) = Message::parse(payload).map_err(Ignored::Message)? else {
            return Err(Ignored::Version);
        };
        if theirs == self.identity.public() {
            return Err(Ignored::Reflected);
        }
        match self.theirs {
            Some(known) if known == theirs => return Err(Ignored::Repeated),
            // Trust on first use: a second key is either a restart of the peer or somebody in the middle, and nothing tells
            // them apart.
            Some(_) => return Err(Ignored::Changed),
            None => {}
        }
        let shared = self
            .identity
            .secret()
            .diffie_hellman(&(*theirs.bytes()).into());
        // A public key of low order gives an all-zero secret, which anyone can compute.
        if !shared.was_contributory() {
            return Err(Ignored::Forged);
        }
        let key = SigningKey::new(shared.to_bytes()).map_err(|_| Ignored::Forged)?;
        self.theirs = Some(theirs);
        Ok(key)
    }

    /// The peer's public key, once there is one.
    #[must_use]
    pub fn peer(&self) -> Option<&PublicKey> {
        self.theirs.as_ref()
    }

    /// Counts of what was received and ignored.
    #[must_use]
    pub fn stats(&self) -> &ExchangeStats {
        &self.stats
    }
}

impl fmt::Debug for Legacy {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Legacy")
            .field("peer", &self.peer)
            .finish_non_exhaustive()
    }
}

const EVERY: Duration = Duration::from_secs(10);

#[cfg(test)]
mod tests {
    use super::*;

    const GROUND: Node = Node {
        system: 245,
        component: 190,
    };
    const AIR: Node = Node {
        system: 1,
        component: 191,
    };

    #[test]
    fn both_ends_derive_the_same_key_and_keep_it() {
        let mut ground = Legacy::new(Identity::new([1; 32]), AIR, Duration::ZERO);
        let mut air = Legacy::new(Identity::new([2; 32]), GROUND, Duration::ZERO);
        let up = ground.poll_transmit(Duration::ZERO).unwrap();
        let down = air.poll_transmit(Duration::ZERO).unwrap();
        assert!(ground.poll_transmit(Duration::from_secs(9)).is_none());
        let one = air.handle(GROUND, &up[..32]).unwrap();
        let other = ground.handle(AIR, &down[..32]).unwrap();
        assert!(one.same_as(&other));
        assert_eq!(air.handle(GROUND, &up).unwrap_err(), Ignored::Repeated);
        assert_eq!(air.handle(GROUND, &[9; 32]).unwrap_err(), Ignored::Changed);
        assert!(ground.poll_transmit(Duration::from_secs(10)).is_some());
    }

    #[test]
    fn a_peer_that_contributes_nothing_is_refused() {
        let mut air = Legacy::new(Identity::new([2; 32]), GROUND, Duration::ZERO);
        assert_eq!(air.handle(GROUND, &[0; 32]).unwrap_err(), Ignored::Forged);
        let mut one = [0; 32];
        one[0] = 1;
        assert_eq!(air.handle(GROUND, &one).unwrap_err(), Ignored::Forged);
    }

    #[test]
    fn its_own_key_and_other_senders_are_ignored() {
        let mut air = Legacy::new(Identity::new([2; 32]), GROUND, Duration::ZERO);
        let own = air.poll_transmit(Duration::ZERO).unwrap();
        assert_eq!(air.handle(GROUND, &own).unwrap_err(), Ignored::Reflected);
        assert_eq!(air.handle(AIR, &[3; 32]).unwrap_err(), Ignored::Source);
    }
}
