//! Whether the vehicle's stamps are accepted, and how soon it is told to lift them.

use core::time::Duration;

/// How a signed link stands.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum LinkState {
    /// No frame has been accepted yet.
    Waiting,
    /// Frames are accepted.
    Live,
    /// The vehicle's frames verify, but their stamps have fallen back.
    Behind,
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

    /// A verified frame was stale. True where the link falls behind by it.
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

    /// Whether a lifting heartbeat may go out now: at most five a second to the peer, and as many to
    /// all others, so that replays from elsewhere cannot use up the peer's share.
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
