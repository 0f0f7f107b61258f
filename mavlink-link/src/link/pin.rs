//! Which link id the autopilot's signatures carry on this link, so that a capture of another link is refused.
//!
//! One key serves all links, so a frame recorded on one of them verifies on every other (pitfall 5). Where the
//! configuration does not say which link id the vehicle uses here, it is learned, and only from a frame that can be
//! no recording: one stamped above a heartbeat that we sent a moment ago.

use core::time::Duration;

use super::freshness::Age;

/// The link id of the vehicle's component 1 on one link, and how firmly it is held.
#[derive(Debug)]
pub(super) struct LinkIdPin(Option<Pin>);

#[derive(Debug, Clone, Copy)]
struct Pin {
    link_id: u8,
    hold: Hold,
}

/// How firmly a link id is held.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Hold {
    /// Seen only in frames that may be recordings, last at that time: dropped after a silence.
    Assumed(Duration),
    /// Seen in a frame that can only have been made at that moment. Only another such frame moves it, and only during a
    /// silence, or back to the link id before.
    Proven {
        /// When the last frame came.
        last: Duration,
        /// The link id before.
        before: Option<u8>,
    },
    /// Never moved.
    Configured,
}

impl LinkIdPin {
    /// The configured link id, else the one that an earlier run has learned, else none yet.
    pub(super) fn new(configured: Option<u8>, known: Option<u8>) -> Self {
        let earlier = Hold::Proven {
            last: Duration::ZERO,
            before: None,
        };
        let held = |hold| move |link_id| Pin { link_id, hold };
        Self(
            configured
                .map(held(Hold::Configured))
                .or(known.map(held(earlier))),
        )
    }

    /// The link id, where it was learned for certain.
    pub(super) fn learned(&self) -> Option<u8> {
        let proven = |pin: &Pin| matches!(pin.hold, Hold::Proven { .. });
        self.0.filter(proven).map(|pin| pin.link_id)
    }

    /// Whether the link id is held but not configured.
    pub(super) fn is_movable(&self) -> bool {
        self.0.is_some_and(|pin| pin.hold != Hold::Configured)
    }

    /// The link id that the autopilot must use. One that is only assumed is dropped after a silence.
    pub(super) fn expected(&self, mono: Duration) -> Option<u8> {
        let held = |pin: &Pin| match pin.hold {
            Hold::Assumed(last) => mono.saturating_sub(last) <= ASSUMED_FOR,
            Hold::Proven { .. } | Hold::Configured => true,
        };
        self.0.filter(held).map(|pin| pin.link_id)
    }

    /// Whether the autopilot may use another link id than before in a frame of this age.
    ///
    /// A recording of another link, played first or during a silence, is too old. A frame that is carried over from
    /// the other link at once is not: therefore it must meet a silence, and gives way to the link id it displaced.
    pub(super) fn may_move(&self, link_id: u8, age: Age, mono: Duration) -> bool {
        let gives_way = match self.0.map(|pin| pin.hold) {
            None | Some(Hold::Configured) => false,
            Some(Hold::Assumed(_)) => true,
            Some(Hold::Proven { last, before }) => {
                before == Some(link_id) || mono.saturating_sub(last) >= PROVEN_FOR
            }
        };
        gives_way && age.is_now()
    }

    /// Records the link id of an accepted frame; true where it is another one than before.
    pub(super) fn record(&mut self, link_id: u8, age: Age, mono: Duration) -> bool {
        let same = self.0.filter(|pin| pin.link_id == link_id);
        let moved = self.0.is_some() && same.is_none();
        let hold = match (same.map(|pin| pin.hold), self.0) {
            (Some(Hold::Configured), _) => Hold::Configured,
            (Some(Hold::Proven { before, .. }), _) => Hold::Proven { last: mono, before },
            _ if !age.is_now() => Hold::Assumed(mono),
            (None, Some(displaced)) => Hold::Proven {
                last: mono,
                before: match displaced.hold {
                    // The one that comes back is not displaced again at once.
                    Hold::Proven { before, .. } if before != Some(link_id) => {
                        Some(displaced.link_id)
                    }
                    _ => None,
                },
            },
            _ => Hold::Proven {
                last: mono,
                before: None,
            },
        };
        self.0 = Some(Pin { link_id, hold });
        moved
    }
}

/// How long the autopilot must be silent before a link id that is only assumed may be another one.
const ASSUMED_FOR: Duration = Duration::from_secs(5);
/// How long it must be silent before one that is proven may be another one.
const PROVEN_FOR: Duration = Duration::from_secs(1);
