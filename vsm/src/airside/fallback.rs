//! Whether PX4 has fallen back to the key before, as when a power cut brings its old key file back.
//!
//! A frame that verifies under that key may be a recording. It counts only with a stamp above all that was ever sent or
//! accepted under it; where it is below, a heartbeat under that key goes out, which lifts the stamps of a PX4 that has
//! the key, and of nothing else.

use mavlink_link::Now;
use mavlink_link::frame::MAX_FRAME;
use mavlink_link::link::{Auth, Link};
use mavlink_link::receiver::{AUTOPILOT, KeyState};

use super::phase::Phase;
use super::{Agent, Keys, Side, Transmit};
use crate::session::{LogLevel, Peer};

/// A second receiver on PX4's link, for the key before.
#[derive(Debug)]
pub(super) struct Fallback {
    link: Link<Peer>,
    key: KeyState,
}

impl Agent {
    /// The heartbeat that is due under the key before, if any.
    pub(super) fn fallback_transmit(
        &mut self,
        now: Now,
        keys: &mut dyn Keys,
        out: &mut [u8; MAX_FRAME],
    ) -> Option<Transmit> {
        if !matches!(self.phase, Phase::Relaying(_)) {
            self.fallback = None;
        }
        let Fallback { link, key } = self.fallback.as_mut()?;
        let sent = link.poll_transmit(
            now,
            Auth::Signed {
                key,
                store: keys.disk(),
            },
            out,
        )?;
        Some(Transmit {
            side: Side::Px4,
            to: sent.to,
            len: sent.len,
            secret: false,
        })
    }

    /// Whether these bytes show that the autopilot signs with the key before now.
    pub(super) fn is_under_previous(
        &mut self,
        now: Now,
        from: Peer,
        bytes: &[u8],
        keys: &mut dyn Keys,
    ) -> bool {
        let previous = match &self.phase {
            Phase::Relaying(relaying) => relaying.previous.as_ref(),
            _ => None,
        };
        let Some(previous) = previous else {
            self.fallback = None;
            return false;
        };
        let id = previous.id();
        if self
            .fallback
            .as_ref()
            .is_none_or(|held| held.key.id() != id)
        {
            let key = match self.state_of(previous.duplicate(), now, keys) {
                Ok(key) => key,
                Err(fault) => {
                    self.note(LogLevel::Error, format!("the key before: {fault}"));
                    return false;
                }
            };
            let link = Link::new(*self.px4.config());
            self.fallback = Some(Fallback { link, key });
        }
        let Some(Fallback { link, key }) = &mut self.fallback else {
            return false;
        };
        let auth = Auth::Signed {
            key,
            store: keys.disk(),
        };
        let mut proven = false;
        link.handle_datagram(now, from, bytes, auth, &mut |delivery| {
            proven |= delivery.verified && delivery.header.component_id == AUTOPILOT;
        });
        // PX4's link under the key in force sees the same bytes, and tells.
        while link.poll_event().is_some() {}
        if proven {
            self.fallback = None;
        }
        proven
    }
}
