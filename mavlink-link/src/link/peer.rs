//! The peer lock: where a link sends, and what may change that; and whether the vehicle is live.
//!
//! A stranger's datagram must not move the peer, or our answers would go to the stranger (pitfall 21). On a signed link
//! only verified and accepted frames move it, as [`address`](crate::address) says. A verified frame with a stale timestamp may be a replay from anywhere, or
//! a vehicle that has restarted: it gets heartbeats, which reveal nothing and lift the vehicle's timestamps, and nothing
//! else.

use core::time::Duration;

use crate::address::{ProvenAddress, Sender};
use crate::frame::Signature;

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
    peer: ProvenAddress<A, Signature>,
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
            peer: ProvenAddress::new(peer),
            last_frame: None,
            provisional: None,
        }
    }

    pub(super) fn peer(&self) -> Option<A> {
        self.peer.get()
    }

    /// Where heartbeats are sent.
    pub(super) fn heartbeat_to(&self) -> Option<A> {
        self.peer().or(self.provisional.map(|(address, _)| address))
    }

    /// A verified and accepted frame came from there. Returns the change of the peer, if it is one.
    pub(super) fn confirm(
        &mut self,
        from: A,
        by: Sender,
        frame: Option<Signature>,
        mono: Duration,
    ) -> Option<(Option<A>, A)> {
        self.provisional = None;
        self.last_frame = Some(mono);
        self.peer.prove(mono, from, by, frame)
    }

    /// See [`ProvenAddress::contender`].
    pub(super) fn contender(&self, mono: Duration) -> Option<A> {
        self.peer.contender(mono)
    }

    /// See [`ProvenAddress::others`].
    pub(super) fn others(&self, mono: Duration) -> impl Iterator<Item = A> + use<A> {
        self.peer.others(mono)
    }

    /// See [`ProvenAddress::answered_at`].
    pub(super) fn answered_at(&mut self, mono: Duration, at: A) -> Option<(Option<A>, A)> {
        self.peer.answered_at(mono, at)
    }

    /// A verified frame that was accepted before, or is stale, came from there: whether somebody else has delivered a copy
    /// of it first.
    pub(super) fn was_copied(&mut self, from: A, frame: &Signature, mono: Duration) -> bool {
        self.peer.note_second(mono, from, frame)
    }

    /// A verified frame with a stale timestamp came from there.
    pub(super) fn stale_from(&mut self, from: A, mono: Duration) {
        let held = self
            .provisional
            .is_some_and(|(held, at)| held != from && mono.saturating_sub(at) < PROVISIONAL_HOLD);
        if self.peer().is_none() && !held {
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
        let before = self.peer();
        if before.is_some_and(|peer| peer != from) && !may_move {
            return Err(WrongPeer);
        }
        self.last_frame = Some(mono);
        self.peer.assume(from);
        Ok((before != Some(from)).then_some((before, from)))
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

/// Follows [`LinkState`].
#[derive(Debug)]
pub(super) struct Presence {
    state: LinkState,
    accepted: Option<Duration>,
    /// The first accepted frame after the last silence.
    resumed: Option<Duration>,
    /// The last accepted frame that nobody can have held back for long.
    present: Option<Duration>,
    /// The last accepted frame of the autopilot itself.
    autopilot: Option<Duration>,
    /// The last stale frames, oldest first.
    stale: [Option<Duration>; STALE_FRAMES],
    /// When to raise the alert that the vehicle stays behind.
    alert_at: Option<Duration>,
}

impl Presence {
    pub(super) fn new() -> Self {
        Self {
            state: LinkState::Waiting,
            accepted: None,
            resumed: None,
            present: None,
            autopilot: None,
            stale: [None; STALE_FRAMES],
            alert_at: None,
        }
    }

    pub(super) fn state(&self) -> LinkState {
        self.state
    }

    pub(super) fn accepted_at(&self) -> Option<Duration> {
        self.accepted
    }

    /// Since when frames have been accepted without a silence.
    pub(super) fn resumed_at(&self) -> Option<Duration> {
        self.resumed
    }

    /// A frame was accepted. True where the link was not live before.
    pub(super) fn accepted(&mut self, mono: Duration) -> bool {
        let before = self.accepted.replace(mono);
        if before.is_none_or(|at| mono.saturating_sub(at) >= SILENCE) {
            self.resumed = Some(mono);
        }
        self.stale = [None; STALE_FRAMES];
        self.alert_at = None;
        core::mem::replace(&mut self.state, LinkState::Live) != LinkState::Live
    }

    pub(super) fn present_at(&self) -> Option<Duration> {
        self.present
    }

    /// Its sender was there within the last minute, or nothing sent from here could show it.
    pub(super) fn is_present(&mut self, mono: Duration) {
        self.present = Some(mono);
    }

    /// A frame of the autopilot was accepted.
    pub(super) fn autopilot_accepted(&mut self, mono: Duration) {
        self.autopilot = Some(mono);
    }

    /// Whether the autopilot signs: one frame that anybody can send says nothing beside those that it has just signed.
    pub(super) fn autopilot_signs(&self, mono: Duration) -> bool {
        self.autopilot
            .is_some_and(|at| mono.saturating_sub(at) < SIGNS_FOR)
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

    pub(super) fn alert_at(&self) -> Option<Duration> {
        self.alert_at
    }

    /// True once, when the vehicle has stayed behind for too long.
    pub(super) fn take_alert(&mut self, mono: Duration) -> bool {
        self.alert_at.take_if(|at| *at <= mono).is_some()
    }
}

/// How long no frame must be accepted for the next one to be the first again.
const SILENCE: Duration = Duration::from_secs(5);
const STALE_FRAMES: usize = 3;
const STALE_WITHIN: Duration = Duration::from_secs(1);
const BEHIND_ALERT: Duration = Duration::from_secs(5);
/// How long an accepted frame shows that the autopilot signs. One that has lost its key has restarted, which takes
/// longer.
const SIGNS_FOR: Duration = Duration::from_secs(2);
