//! A handover of a key that an earlier process did not finish: which of the two keys the vehicle has is found out in
//! flight, by asking under both. The key itself is never sent from here.

use std::collections::BTreeMap;

use mavlink_link::Now;
use mavlink_link::frame::MAX_FRAME;
use mavlink_link::link::{Alert, LinkState};
use mavlink_link::provisioning::{Event, KeyRollover, KeyRolloverConfig, Outcome, StartError};
use mavlink_link::receiver::KeyState;
use mavlink_link::signing::{SigningKey, Stamp};
use mavlink_link::store::Disk;
use stanag_msgs::enums::{AlertPriority, SubsystemId};

use super::aircraft::Aircraft;
use super::bridge::Bridge;
use super::desk::Desk;
use super::vehicle::{OutFrame, Peer, VehicleLink};

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
pub(super) struct KeyRecovery {
    handover: Option<Box<KeyRollover<Peer>>>,
    /// That the vehicle sends unsigned has been told.
    told_open: bool,
    pub(super) change: Option<KeyChange>,
}

impl KeyRecovery {
    /// When it wants to be called.
    pub(super) fn poll_timeout(&self) -> Option<std::time::Duration> {
        self.handover
            .as_ref()
            .map(|handover| handover.poll_timeout())
    }

    /// Whether it is not known yet which key the vehicle has.
    pub(super) fn is_open(&self) -> bool {
        self.handover.is_some()
    }
}

impl Bridge {
    /// Tells that the vehicle of this index may have `next` instead of its key: until that is known nothing of it is
    /// delivered.
    ///
    /// # Errors
    /// The store cannot be read, or both are the same key.
    pub fn settle_key(
        &mut self,
        index: usize,
        next: SigningKey,
        now: Now,
        not_before: std::time::Duration,
        store: &mut dyn Disk,
    ) -> Result<(), StartError> {
        let Some(aircraft) = self.aircraft.get_mut(index) else {
            return Ok(());
        };
        aircraft
            .mav
            .settle(next, Stamp::from_unix(not_before), now, store)
    }

    /// The next change that the key files need, and of which vehicle.
    pub fn poll_key_change(&mut self) -> Option<(usize, KeyChange)> {
        self.aircraft
            .iter_mut()
            .enumerate()
            .find_map(|(index, aircraft)| Some((index, aircraft.mav.key_recovery.change.take()?)))
    }
}

impl Aircraft {
    /// Tells the stations that the link is signed, and by which key.
    pub(super) fn say_signed(&mut self, desk: &mut Desk<'_>, listeners: &[usize]) {
        let Some(key) = self.mav.key().map(KeyState::id) else {
            return;
        };
        let raised = self.alerts.notice(
            desk.now.mono,
            AlertPriority::Nominal,
            SubsystemId::Comms,
            format!("MAVLink is signed and verified, key {key}"),
        );
        desk.alert(self.id(), listeners, raised);
    }
}

impl VehicleLink {
    fn settle(
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
        let handover = KeyRollover::start(config, self.key.take(), next, now, store)?;
        self.key_recovery.handover = Some(Box::new(handover));
        Ok(())
    }

    /// Takes a datagram while the key is not known. True where it has been taken.
    pub(super) fn settle_datagram(
        &mut self,
        now: Now,
        from: Peer,
        bytes: &[u8],
        store: &mut dyn Disk,
    ) -> bool {
        let Some(handover) = &mut self.key_recovery.handover else {
            return false;
        };
        handover.handle_datagram(now, from, bytes, store);
        self.settle_on(now, store);
        true
    }

    /// Does what is due while the key is not known.
    pub(super) fn settle_timeout(&mut self, now: Now, store: &mut dyn Disk) {
        if let Some(handover) = &mut self.key_recovery.handover {
            handover.handle_timeout(now);
            self.settle_on(now, store);
        }
    }

    fn settle_on(&mut self, now: Now, store: &mut dyn Disk) {
        let Some(handover) = &mut self.key_recovery.handover else {
            return;
        };
        let mut bytes = [0; MAX_FRAME];
        while let Some(sent) = handover.poll_transmit(now, store, &mut bytes) {
            self.out.push_back(OutFrame::new(sent.to, sent.len, bytes));
        }
        while let Some(event) = handover.poll_event() {
            match event {
                Event::Commit => self.key_recovery.change = Some(KeyChange::Commit),
                Event::Ended(Outcome::RolledBack) => {
                    self.key_recovery.change = Some(KeyChange::DropNext);
                }
                _ => {}
            }
        }
        if handover.vehicle_is_open(now.mono) && !self.key_recovery.told_open {
            self.key_recovery.told_open = true;
            self.tell_link(mavlink_link::link::Event::Alert(Alert::VehicleUnsigned));
        }
        let Some(handover) = &self.key_recovery.handover else {
            return;
        };
        // Only what the vehicle has proved ends the search: without a key nothing could ever be believed again.
        if let Some(Outcome::Committed | Outcome::RolledBack) = handover.outcome()
            && let Some(handover) = self.key_recovery.handover.take()
        {
            self.key = handover.into_key_in_force();
        }
    }

    /// How the link stands, for the status.
    pub(super) fn link_state_name(&self) -> &'static str {
        if self.key_recovery.is_open() {
            return "key_recovery";
        }
        match self.link.state() {
            LinkState::Waiting => "waiting",
            LinkState::Live => "live",
            LinkState::Behind => "behind",
        }
    }

    /// Frames that carried the vehicle's system id and were refused, by the reason.
    pub(super) fn refused_frames(&self) -> BTreeMap<&'static str, u64> {
        let stats = self.stats();
        let key_recovery = self.key_recovery.handover.as_deref();
        let (unsigned, foreign) = key_recovery.map_or((0, 0), |handover| {
            (handover.disbelieved_frames(), handover.foreign_frames())
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
