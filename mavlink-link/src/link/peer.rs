//! The peer lock: where a link sends, and what may change that; and whether the vehicle is live.
//!
//! A stranger's datagram must not move the peer, or our answers would go to the stranger (pitfall 21). On a signed link
//! only a verified and accepted frame moves it. A verified frame with a stale timestamp may be a replay from anywhere, or
//! a vehicle that has restarted: it gets heartbeats, which reveal nothing and lift the vehicle's timestamps, and nothing
//! else.

use core::time::Duration;

/// How a link finds its peer.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Endpoint<A> {
    /// Bound, waiting: the peer is the sender that proves to be the vehicle (udpin).
    Listen,
    /// The peer is this one from the start (udpout, serial).
    Fixed(A),
}

/// Holds the peer of one link.
#[derive(Debug)]
pub(super) struct PeerLock<A> {
    endpoint: Endpoint<A>,
    peer: Option<A>,
    last_frame: Option<Duration>,
    /// The sender of frames that verify but are stale: may be sent heartbeats, nothing else.
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
            last_frame: None,
            provisional: None,
        }
    }

    pub(super) fn peer(&self) -> Option<A> {
        self.peer
    }

    /// Where heartbeats are sent.
    pub(super) fn heartbeat_to(&self) -> Option<A> {
        self.peer.or(self.provisional.map(|(address, _)| address))
    }

    /// A verified and accepted frame came from there. Returns the change of the peer, if it is one.
    pub(super) fn confirm(&mut self, from: A, mono: Duration) -> Option<(Option<A>, A)> {
        self.provisional = None;
        self.last_frame = Some(mono);
        self.move_to(from)
    }

    /// A verified frame with a stale timestamp came from there.
    pub(super) fn stale_from(&mut self, from: A, mono: Duration) {
        let held = self
            .provisional
            .is_some_and(|(held, at)| held != from && mono.saturating_sub(at) < PROVISIONAL_HOLD);
        if self.peer.is_none() && !held {
            self.provisional = Some((from, mono));
        }
    }

    /// On an unsigned link: whether a frame from there is accepted. The first sender holds the lock until
    /// it has been silent for [`UNSIGNED_SILENCE`]; a fixed peer holds it for good.
    pub(super) fn admit_unsigned(
        &mut self,
        from: A,
        mono: Duration,
    ) -> Result<Option<(Option<A>, A)>, WrongPeer> {
        // Without signatures only silence frees the lock: otherwise any datagram could take it over.
        let silent = self
            .last_frame
            .is_none_or(|at| mono.saturating_sub(at) > UNSIGNED_SILENCE);
        let may_move = matches!(self.endpoint, Endpoint::Listen) && silent;
        if self.peer.is_some_and(|peer| peer != from) && !may_move {
            return Err(WrongPeer);
        }
        self.last_frame = Some(mono);
        Ok(self.move_to(from))
    }

    fn move_to(&mut self, to: A) -> Option<(Option<A>, A)> {
        let from = self.peer.replace(to);
        (from != Some(to)).then_some((from, to))
    }
}

/// Another sender holds the lock.
#[derive(Debug)]
pub(super) struct WrongPeer;

/// How long the peer of an unsigned link must be silent before another sender takes its place.
pub const UNSIGNED_SILENCE: Duration = Duration::from_secs(5);
/// How long a provisional peer is kept after its last frame against another one.
const PROVISIONAL_HOLD: Duration = Duration::from_secs(2);

/// The state of a signed link.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum LinkState {
    /// No frame has been accepted yet.
    Waiting,
    /// Frames are accepted.
    Live,
    /// The vehicle's frames verify, but their timestamps have fallen back.
    Behind,
    /// The vehicle's frames verify, but are stamped further ahead than is followed.
    Ahead,
}

/// Follows [`LinkState`] and paces the heartbeats that lift a vehicle that has fallen back.
#[derive(Debug)]
pub(super) struct Presence {
    state: LinkState,
    accepted: Option<Duration>,
    /// The last stale frames, oldest first.
    stale: [Option<Duration>; STALE_FRAMES],
    /// When to raise the alert that the vehicle stays behind.
    alert_at: Option<Duration>,
    lifted: [Option<Duration>; 2],
}

impl Presence {
    pub(super) fn new() -> Self {
        Self {
            state: LinkState::Waiting,
            accepted: None,
            stale: [None; STALE_FRAMES],
            alert_at: None,
            lifted: [None; 2],
        }
    }

    pub(super) fn state(&self) -> LinkState {
        self.state
    }

    pub(super) fn accepted_at(&self) -> Option<Duration> {
        self.accepted
    }

    /// A frame was accepted. True where the link was not live before.
    pub(super) fn accepted(&mut self, mono: Duration) -> bool {
        self.accepted = Some(mono);
        self.stale = [None; STALE_FRAMES];
        self.alert_at = None;
        core::mem::replace(&mut self.state, LinkState::Live) != LinkState::Live
    }

    /// A verified frame was stale. True where the link becomes [`LinkState::Behind`] by it. A single stale
    /// frame may be a replay or reordered; three within a second, with none accepted, look like a vehicle that restarted.
    pub(super) fn stale(&mut self, mono: Duration) -> bool {
        self.stale.rotate_left(1);
        self.stale[STALE_FRAMES - 1] = Some(mono);
        let recent = |at: Duration| mono.saturating_sub(at) <= STALE_WITHIN;
        let behind = self.stale.iter().all(|at| at.is_some_and(recent))
            && !self.accepted.is_some_and(recent);
        if !behind || self.state == LinkState::Behind {
            return false;
        }
        self.state = LinkState::Behind;
        self.alert_at = Some(mono.saturating_add(BEHIND_ALERT));
        true
    }

    /// A verified frame was stamped too far ahead. True where the link becomes [`LinkState::Ahead`] by it: not by a
    /// recording beside a vehicle that is received.
    pub(super) fn ahead(&mut self, mono: Duration) -> bool {
        let received = self
            .accepted
            .is_some_and(|at| mono.saturating_sub(at) <= STALE_WITHIN);
        if received {
            return false;
        }
        self.alert_at = None;
        core::mem::replace(&mut self.state, LinkState::Ahead) != LinkState::Ahead
    }

    /// Whether a lifting heartbeat may be sent now: at most five a second to the peer, and as many to
    /// all others together, so that replays from elsewhere cannot use up the peer's share.
    pub(super) fn may_lift(&mut self, to_peer: bool, mono: Duration) -> bool {
        let last = &mut self.lifted[usize::from(to_peer)];
        let may = last.is_none_or(|at| mono.saturating_sub(at) >= LIFT_EVERY);
        if may {
            *last = Some(mono);
        }
        may
    }

    pub(super) fn alert_at(&self) -> Option<Duration> {
        self.alert_at
    }

    /// True once, when the vehicle has stayed behind for too long.
    pub(super) fn take_alert(&mut self, mono: Duration) -> bool {
        self.alert_at.take_if(|at| *at <= mono).is_some()
    }
}

const STALE_FRAMES: usize = 3;
const STALE_WITHIN: Duration = Duration::from_secs(1);
const BEHIND_ALERT: Duration = Duration::from_secs(5);
const LIFT_EVERY: Duration = Duration::from_millis(200);
