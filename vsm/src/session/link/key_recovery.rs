//! Key recovery after a rollover that an earlier process did not finish: it finds out, also in flight, which of the two keys
//! the vehicle has, by sending under both. The key itself is never sent from here.

use std::collections::VecDeque;

use mavlink_link::Now;
use mavlink_link::frame::MAX_FRAME;
use mavlink_link::link::{self, Alert, LinkConfig};
use mavlink_link::provisioning::{Event, KeyRollover, KeyRolloverConfig, Outcome, StartError};
use mavlink_link::receiver::KeyState;
use mavlink_link::signing::{SigningKey, Stamp};
use mavlink_link::store::Disk;

use super::event::VehicleEvent;
use super::frame::{OutFrame, Peer};

/// What the shell does with the key files.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum KeyChange {
    /// The vehicle has the next key: it becomes the current one.
    Commit,
    /// The vehicle keeps the current key: the next one is deleted.
    DropNext,
}

/// The machine, and what the shell has to do with the key files.
#[derive(Debug, Default)]
pub(crate) struct KeyRecovery {
    rollover: Option<Box<KeyRollover<Peer>>>,
    /// Whether the alert was raised that the vehicle sends unsigned.
    reported_open: bool,
    /// What to do with the key files.
    pub(crate) change: Option<KeyChange>,
}

impl KeyRecovery {
    /// When [`KeyRecovery::handle_timeout`] is next needed.
    pub(super) fn poll_timeout(&self) -> Option<std::time::Duration> {
        self.rollover
            .as_ref()
            .map(|rollover| rollover.poll_timeout())
    }

    /// Whether the vehicle's key is still unknown.
    pub(super) fn is_open(&self) -> bool {
        self.rollover.is_some()
    }

    /// Begins the search between the `current` key and `next`.
    pub(super) fn begin(
        &mut self,
        link: LinkConfig<Peer>,
        current: Option<KeyState>,
        next: SigningKey,
        not_before: Stamp,
        now: Now,
        store: &mut dyn Disk,
    ) -> Result<(), StartError> {
        let config = KeyRolloverConfig {
            link,
            not_before,
            // The link may be a radio: the key must not cross it, and an unsigned frame proves nothing there.
            may_send_key: false,
            believe_unsigned: false,
        };
        let rollover = KeyRollover::start(config, current, next, now, store)?;
        self.rollover = Some(Box::new(rollover));
        Ok(())
    }

    /// Takes a datagram while the key is unknown. Returns true if it was taken.
    pub(super) fn handle_datagram(
        &mut self,
        now: Now,
        from: Peer,
        bytes: &[u8],
        store: &mut dyn Disk,
    ) -> bool {
        let Some(rollover) = &mut self.rollover else {
            return false;
        };
        rollover.handle_datagram(now, from, bytes, store);
        true
    }

    /// Does what is due while the key is unknown.
    pub(super) fn handle_timeout(&mut self, now: Now) {
        if let Some(rollover) = &mut self.rollover {
            rollover.handle_timeout(now);
        }
    }

    /// Moves frames to send to `out`, and reports to `events`. Once the vehicle has proved which key it has, that becomes
    /// the `key` in force.
    pub(super) fn advance(
        &mut self,
        now: Now,
        key: &mut Option<KeyState>,
        out: &mut VecDeque<OutFrame>,
        events: &mut VecDeque<VehicleEvent>,
        store: &mut dyn Disk,
    ) {
        let Some(rollover) = &mut self.rollover else {
            return;
        };
        let mut bytes = [0; MAX_FRAME];
        while let Some(sent) = rollover.poll_transmit(now, store, &mut bytes) {
            out.push_back(OutFrame::new(sent.to, sent.len, bytes));
        }
        while let Some(event) = rollover.poll_event() {
            match event {
                Event::Commit => self.change = Some(KeyChange::Commit),
                Event::Ended(Outcome::RolledBack) => self.change = Some(KeyChange::DropNext),
                _ => {}
            }
        }
        if rollover.vehicle_is_open(now.mono) && !self.reported_open {
            self.reported_open = true;
            let alert = link::Event::Alert(Alert::VehicleUnsigned);
            events.push_back(VehicleEvent::Link(alert));
        }
        // Only a proof of the vehicle ends the search: without a key no frame could ever be accepted again.
        if let Some(Outcome::Committed | Outcome::RolledBack) = rollover.outcome()
            && let Some(rollover) = self.rollover.take()
        {
            *key = rollover.into_key_in_force();
        }
    }

    /// Frames that were not signed, and frames signed with neither key, during the search.
    pub(super) fn refused_frames(&self) -> (u64, u64) {
        self.rollover.as_deref().map_or((0, 0), |rollover| {
            (rollover.disbelieved_frames(), rollover.foreign_frames())
        })
    }
}
