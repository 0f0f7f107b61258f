//! Keys of a running bridge: rollovers that an earlier process did not finish, and keys agreed over the air.
//!
//! The exchange itself is a machine beside the bridge; its messages pass through the vehicle's link here.

use std::time::Duration;

use mavlink_link::Now;
use mavlink_link::link::{KeyExchangeFrame, LinkState};
use mavlink_link::provisioning::StartError;
use mavlink_link::receiver::KeyState;
use mavlink_link::signing::{KeyId, SigningKey, Stamp};
use mavlink_link::store::{Disk, StoreError};
use stanag_msgs::enums::SubsystemId;

use super::Bridge;
use crate::session::alerts::Cause;
use crate::session::link::frame::Peer;
use crate::session::link::key_agreement::ExchangeNotice;
use crate::session::link::key_recovery::KeyChange;

impl Bridge {
    /// From now on KEY_EXCHANGE frames of this vehicle's link are kept for the exchange.
    pub fn want_key_exchange(&mut self, index: usize) {
        if let Some(aircraft) = self.aircraft.get_mut(index) {
            aircraft.link.agreement.wanted = true;
        }
    }

    /// The next KEY_EXCHANGE frame of this vehicle's link.
    pub fn poll_key_exchange(&mut self, index: usize) -> Option<KeyExchangeFrame<Peer>> {
        self.aircraft
            .get_mut(index)?
            .link
            .agreement
            .inbox
            .pop_front()
    }

    /// Whether it has been shown where this vehicle's link leads.
    #[must_use]
    pub fn has_peer(&self, index: usize) -> bool {
        let aircraft = self.aircraft.get(index);
        aircraft.is_some_and(|one| one.link.peer().is_some())
    }

    /// Sends a KEY_EXCHANGE payload to the vehicle's peer, or to `otherwise` if there is none yet. Returns false if it
    /// cannot be sent now.
    pub fn send_key_exchange(
        &mut self,
        index: usize,
        now: Now,
        payload: &[u8],
        otherwise: Option<Peer>,
        disk: &mut dyn Disk,
    ) -> bool {
        let Some(aircraft) = self.aircraft.get_mut(index) else {
            return false;
        };
        aircraft
            .link
            .send_key_exchange(now, payload, otherwise, disk)
    }

    /// A key that the vehicle may begin to sign with: its frames are checked for it.
    ///
    /// # Errors
    /// The clock of the key cannot be read.
    pub fn offer_next_key(
        &mut self,
        index: usize,
        key: SigningKey,
        now: Now,
        not_before: Duration,
        disk: &mut dyn Disk,
    ) -> Result<(), StoreError> {
        match self.aircraft.get_mut(index) {
            Some(aircraft) => aircraft.link.offer_next_key(key, now, not_before, disk),
            None => Ok(()),
        }
    }

    /// A proven report of the agent: the vehicle already signs with the next key, which is the current one on disk.
    pub fn adopt_next_key(&mut self, index: usize, now: Now, disk: &mut dyn Disk) {
        if let Some(aircraft) = self.aircraft.get_mut(index) {
            aircraft.link.adopt_next_key(now, disk);
        }
    }

    /// No vehicle will ever sign with the next key.
    pub fn withdraw_next_key(&mut self, index: usize) {
        if let Some(aircraft) = self.aircraft.get_mut(index) {
            aircraft.link.agreement.next = None;
        }
    }

    /// The key under which the vehicle's frames are being accepted.
    #[must_use]
    pub fn proven_key(&self, index: usize) -> Option<KeyId> {
        let mav = &self.aircraft.get(index)?.link;
        let live = mav.link.state() == LinkState::Live;
        mav.key.as_ref().map(KeyState::id).filter(|_| live)
    }

    /// Notifies the stations, and the log.
    pub fn notify_of_exchange(
        &mut self,
        index: usize,
        now: Now,
        notice: ExchangeNotice,
        disk: &mut dyn Disk,
    ) {
        let (mut dli, aircraft) = self.effects(now, disk);
        let Some(aircraft) = aircraft.get_mut(index) else {
            return;
        };
        let mut effects = aircraft.effects(&mut dli);
        let comms = SubsystemId::Comms;
        match notice {
            ExchangeNotice::Once(priority, text) => effects.notify(priority, comms, text),
            ExchangeNotice::Stands(priority, text) => {
                effects.raise(Cause::KeyExchange, priority, comms, text);
            }
            ExchangeNotice::Over(text) => effects.clear(Cause::KeyExchange, text),
        }
    }

    /// The vehicle with this index may have `next` instead of its key: until that is known, no frame of it is delivered.
    ///
    /// # Errors
    /// The disk cannot be read, or both are the same key.
    pub fn settle_key(
        &mut self,
        index: usize,
        next: SigningKey,
        now: Now,
        not_before: Duration,
        disk: &mut dyn Disk,
    ) -> Result<(), StartError> {
        let not_before = Stamp::from_unix(not_before);
        match self.aircraft.get_mut(index) {
            Some(aircraft) => aircraft
                .link
                .begin_key_recovery(next, not_before, now, disk),
            None => Ok(()),
        }
    }

    /// The next change that the key files need, and its vehicle.
    pub fn poll_key_change(&mut self) -> Option<(usize, KeyChange)> {
        self.aircraft.poll_key_change()
    }
}
