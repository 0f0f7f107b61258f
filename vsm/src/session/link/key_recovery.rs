//! A key rollover that an earlier process did not finish: which of the two keys the vehicle has is found out in flight,
//! by asking under both. The key itself is never sent from here.

use std::collections::BTreeMap;

use mavlink_link::Now;
use mavlink_link::frame::MAX_FRAME;
use mavlink_link::link::{self, Alert, LinkState};
use mavlink_link::provisioning::{Event, KeyRollover, KeyRolloverConfig, Outcome, StartError};
use mavlink_link::signing::{SigningKey, Stamp};
use mavlink_link::store::Disk;

use super::VehicleLink;
use super::event::VehicleEvent;
use super::frame::{OutFrame, Peer};
use crate::session::effects::Effects;

/// What the shell does with the key files.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum KeyChange {
    /// The vehicle has the next key: it becomes the current one.
    Commit,
    /// The vehicle keeps the current key: the next one is deleted.
    DropNext,
}

/// The machine, and what it wants done with the files.
#[derive(Debug, Default)]
pub(crate) struct KeyRecovery {
    rollover: Option<Box<KeyRollover<Peer>>>,
    /// That the vehicle sends unsigned has been reported.
    reported_open: bool,
    /// What is to be done with the key files.
    pub(crate) change: Option<KeyChange>,
}

impl KeyRecovery {
    /// When [`VehicleLink::handle_timeout`] is next needed for it.
    pub(super) fn poll_timeout(&self) -> Option<std::time::Duration> {
        self.rollover
            .as_ref()
            .map(|rollover| rollover.poll_timeout())
    }

    /// Whether it is not known yet which key the vehicle has.
    pub(super) fn is_open(&self) -> bool {
        self.rollover.is_some()
    }
}

impl VehicleLink {
    /// The vehicle may have `next` instead of its key: until that is known nothing of it is delivered.
    pub(crate) fn begin_key_recovery(
        &mut self,
        next: SigningKey,
        not_before: Stamp,
        now: Now,
        store: &mut dyn Disk,
    ) -> Result<(), StartError> {
        let config = KeyRolloverConfig {
            link: *self.link.config(),
            not_before,
            may_send_key: false,
            believe_unsigned: false,
        };
        let rollover = KeyRollover::start(config, self.key.take(), next, now, store)?;
        self.key_recovery.rollover = Some(Box::new(rollover));
        Ok(())
    }

    /// Takes a datagram while the key is not known. True where it has been taken.
    pub(super) fn recover_key_from(
        &mut self,
        now: Now,
        from: Peer,
        bytes: &[u8],
        effects: &mut Effects<'_>,
    ) -> bool {
        let Some(rollover) = &mut self.key_recovery.rollover else {
            return false;
        };
        rollover.handle_datagram(now, from, bytes, effects.dli.disk);
        self.advance_key_recovery(effects);
        true
    }

    /// Does what is due while the key is not known.
    pub(super) fn recover_key(&mut self, effects: &mut Effects<'_>) {
        if let Some(rollover) = &mut self.key_recovery.rollover {
            rollover.handle_timeout(effects.dli.now);
            self.advance_key_recovery(effects);
        }
    }

    fn advance_key_recovery(&mut self, effects: &mut Effects<'_>) {
        let now = effects.dli.now;
        let KeyRecovery {
            rollover: running,
            reported_open,
            change,
        } = &mut self.key_recovery;
        let Some(rollover) = running else {
            return;
        };
        let mut bytes = [0; MAX_FRAME];
        while let Some(sent) = rollover.poll_transmit(now, effects.dli.disk, &mut bytes) {
            self.out.push_back(OutFrame::new(sent.to, sent.len, bytes));
        }
        while let Some(event) = rollover.poll_event() {
            match event {
                Event::Commit => *change = Some(KeyChange::Commit),
                Event::Ended(Outcome::RolledBack) => *change = Some(KeyChange::DropNext),
                _ => {}
            }
        }
        if rollover.vehicle_is_open(now.mono) && !*reported_open {
            *reported_open = true;
            self.events.push_back(VehicleEvent::Link(link::Event::Alert(
                Alert::VehicleUnsigned,
            )));
        }
        // Only what the vehicle has proved ends the search: without a key nothing could ever be believed again.
        if let Some(Outcome::Committed | Outcome::RolledBack) = rollover.outcome()
            && let Some(rollover) = running.take()
        {
            self.key = rollover.into_key_in_force();
        }
    }

    /// How the link stands, for the status.
    pub(crate) fn link_state_name(&self) -> &'static str {
        if self.key_recovery.is_open() {
            return "settling";
        }
        match self.link.state() {
            LinkState::Waiting => "waiting",
            LinkState::Live => "live",
            LinkState::Behind => "behind",
        }
    }

    /// Frames that carried the vehicle's system id and were refused, by the reason.
    pub(crate) fn refused_frames(&self) -> BTreeMap<&'static str, u64> {
        let stats = self.stats();
        let key_recovery = self.key_recovery.rollover.as_deref();
        let (unsigned, foreign) = key_recovery.map_or((0, 0), |rollover| {
            (rollover.disbelieved_frames(), rollover.foreign_frames())
        });
        [
            ("not signed", stats.unsigned_vehicle + unsigned),
            (
                "signature does not fit the key",
                stats.bad_signature + foreign,
            ),
            ("replayed, reordered or fallen back", stats.stale),
            ("stamp over an hour ahead", stats.future),
            ("another link's stream", stats.unexpected_link),
            ("stream not on the list", stats.not_listed),
            ("too many streams", stats.stream_table_full),
            ("signing clock not stored", stats.ceiling_not_stored),
            ("our own frame, reflected", stats.reflected),
            ("not from the peer", stats.wrong_peer),
        ]
        .into_iter()
        .filter(|&(_, count)| count > 0)
        .collect()
    }
}
