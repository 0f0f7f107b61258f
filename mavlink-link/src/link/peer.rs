//! The peer lock: to whom a link talks, and what may change that.

use core::time::Duration;

/// How a link finds its peer.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Endpoint<A> {
    /// Bound, waiting: the peer is who proves to be it (udpin).
    Listen,
    /// The peer is this one from the start (udpout, serial).
    Fixed(A),
}

/// Holds the peer of one link.
#[derive(Debug)]
pub(super) struct PeerLock<A> {
    endpoint: Endpoint<A>,
    peer: Option<A>,
    heard: Option<Duration>,
    /// Whose frames verify but are behind: may be sent heartbeats, nothing else.
    provisional: Option<(A, Duration)>,
}

impl<A: Copy + Eq> PeerLock<A> {
    pub(super) fn new(endpoint: Endpoint<A>) -> Self {
        let peer = match endpoint {
            Endpoint::Listen => None,
            Endpoint::Fixed(address) => Some(address),
        };
        Self {
            endpoint,
            peer,
            heard: None,
            provisional: None,
        }
    }

    pub(super) fn peer(&self) -> Option<A> {
        self.peer
    }

    /// Whom heartbeats go to.
    pub(super) fn heartbeat_to(&self) -> Option<A> {
        self.peer.or(self.provisional.map(|(address, _)| address))
    }

    /// A verified and accepted frame came from there. Gives the change of the peer, if it is one.
    pub(super) fn confirm(&mut self, from: A, mono: Duration) -> Option<(Option<A>, A)> {
        self.provisional = None;
        self.heard = Some(mono);
        self.move_to(from)
    }

    /// A verified frame that is behind came from there.
    pub(super) fn stale_from(&mut self, from: A, mono: Duration) {
        let held = self
            .provisional
            .is_some_and(|(held, at)| held != from && mono.saturating_sub(at) < PROVISIONAL_HOLD);
        if self.peer.is_none() && !held {
            self.provisional = Some((from, mono));
        }
    }

    /// On an unsigned link: whether a frame from there is taken. The first sender holds the lock until
    /// it has been silent for [`UNSIGNED_SILENCE`]; a fixed peer holds it for good.
    pub(super) fn admit_unsigned(
        &mut self,
        from: A,
        mono: Duration,
    ) -> Result<Option<(Option<A>, A)>, WrongPeer> {
        let silent = self
            .heard
            .is_none_or(|at| mono.saturating_sub(at) > UNSIGNED_SILENCE);
        let may_move = matches!(self.endpoint, Endpoint::Listen) && silent;
        if self.peer.is_some_and(|peer| peer != from) && !may_move {
            return Err(WrongPeer);
        }
        self.heard = Some(mono);
        Ok(self.move_to(from))
    }

    fn move_to(&mut self, to: A) -> Option<(Option<A>, A)> {
        let from = self.peer.replace(to);
        (from != Some(to)).then_some((from, to))
    }
}

/// Somebody else holds the lock.
#[derive(Debug)]
pub(super) struct WrongPeer;

/// How long the peer of an unsigned link must be silent before another sender takes its place.
pub const UNSIGNED_SILENCE: Duration = Duration::from_secs(5);
/// How long a provisional peer is kept after its last frame against another one.
const PROVISIONAL_HOLD: Duration = Duration::from_secs(2);
