//! Detects that PX4 has fallen back to the previous key, for example when a power cut brings its old key file back.
//!
//! A frame that verifies under that key may be a recording. It counts only with a stamp above all stamps that were ever
//! sent or accepted under it. If its stamp is lower, a heartbeat under that key is sent: it raises the stamps of a PX4 that
//! has the key, and of nothing else.

use mavlink_link::Now;
use mavlink_link::frame::MAX_FRAME;
use mavlink_link::link::{Auth, Link, LinkConfig};
use mavlink_link::receiver::{AUTOPILOT, KeyState};
use mavlink_link::signing::{SigningKey, Stamp};
use mavlink_link::store::StoreError;

use super::keys::{Keys, with_clock};
use super::output::{Side, Transmit};
use super::phase::Phase;
use crate::session::Peer;

/// A second receiver on PX4's link, for the previous key, as long as there is one to look for.
#[derive(Debug, Default)]
pub(super) struct Fallback(Option<Receiver>);

#[derive(Debug)]
struct Receiver {
    link: Link<Peer>,
    key: KeyState,
}

impl Fallback {
    /// The heartbeat that is due under the previous key, if any.
    pub(super) fn poll_transmit(
        &mut self,
        now: Now,
        phase: &Phase,
        keys: &mut dyn Keys,
        out: &mut [u8; MAX_FRAME],
    ) -> Option<Transmit> {
        // During a key rollover `KeyRollover` itself verifies under both keys.
        if !matches!(phase, Phase::Relaying(_)) {
            self.0 = None;
        }
        let Receiver { link, key } = self.0.as_mut()?;
        let store = keys.disk();
        let sent = link.poll_transmit(now, Auth::Signed { key, store }, out)?;
        Some(Transmit::new(Side::Px4, sent.to, sent.len))
    }

    /// Whether these bytes prove that the autopilot now signs with the previous key. `px4`: the configuration of its link.
    ///
    /// # Errors
    /// The clock of the previous key cannot be read.
    pub(super) fn is_under_previous(
        &mut self,
        now: Now,
        (from, bytes): (Peer, &[u8]),
        previous: Option<&SigningKey>,
        (px4, not_before): (&LinkConfig<Peer>, Stamp),
        keys: &mut dyn Keys,
    ) -> Result<bool, StoreError> {
        let Some(previous) = previous else {
            self.0 = None;
            return Ok(false);
        };
        // After another rotation the previous key is a different one, with a clock of its own.
        let held = self.0.take().filter(|held| held.key.id() == previous.id());
        let receiver = match held {
            Some(held) => held,
            None => Receiver {
                key: with_clock(previous.duplicate(), not_before, now, keys)?,
                link: Link::new(*px4),
            },
        };
        let Receiver { link, key } = self.0.insert(receiver);
        let auth = Auth::Signed {
            key,
            store: keys.disk(),
        };
        let mut proven = false;
        link.handle_datagram(now, from, bytes, auth, &mut |delivery| {
            // PX4 forwards frames of other components with their own signatures: they prove nothing about PX4's key.
            proven |= delivery.verified && delivery.header.component_id == AUTOPILOT;
        });
        // The link under the key in force gets the same bytes and reports its own events: these would be duplicates.
        while link.poll_event().is_some() {}
        if proven {
            self.0 = None;
        }
        Ok(proven)
    }
}
