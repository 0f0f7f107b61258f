//! The agent's end of the key exchange: agreed keys go to PX4, and what PX4 does with them is reported to the ground.
//!
//! Only a person at this computer can open a pairing window, never the radio.

use std::collections::VecDeque;
use std::time::Duration;

use mavlink_link::Now;
use mavlink_link::exchange::{
    Inbound, Node, PairingCode, PublicKey, Random, Responder, ResponderEvent, Status, VehicleState,
    WindowError,
};
use mavlink_link::frame::{KEY_EXCHANGE_ID, MAX_FRAME};
use mavlink_link::link::{KeyExchangeFrame, Link};
use mavlink_link::provisioning::State;

use super::keys::Keys;
use super::output::{Side, Transmit};
use super::phase::Phase;
use crate::session::Peer;

/// Why an agreement failed: the reason in step 4.
const SEVERAL_AUTOPILOTS: u8 = 1;

/// News for the person at the pairing window.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum PairingNews {
    /// The ground has proved that it knows the code: its static key is pinned.
    Paired(PublicKey),
    /// Somebody did not know the code.
    WrongCode,
    /// The window has closed without a pairing.
    Closed,
}

/// The responder, and the news for people at its window.
#[derive(Debug)]
pub(super) struct Exchange {
    pub(super) responder: Responder<Peer>,
    news: VecDeque<PairingNews>,
}

impl Exchange {
    pub(super) fn new(responder: Responder<Peer>) -> Exchange {
        Exchange {
            responder,
            news: VecDeque::new(),
        }
    }

    pub(super) fn open_window(
        &mut self,
        now: Now,
        code: &PairingCode,
        keys: &mut dyn Keys,
    ) -> Result<(), WindowError> {
        self.responder
            .open_window(now.mono, code, keys.for_exchange())?;
        self.news.clear();
        Ok(())
    }

    pub(super) fn poll_news(&mut self) -> Option<PairingNews> {
        self.news.pop_front()
    }

    /// Takes a KEY_EXCHANGE frame of the ground.
    pub(super) fn handle(
        &mut self,
        now: Now,
        frame: &KeyExchangeFrame<Peer>,
        vehicle: VehicleState,
        random: &mut dyn Random,
        keys: &mut dyn Keys,
    ) {
        self.responder.set_vehicle(vehicle);
        let inbound = Inbound {
            from: frame.from,
            source: Node {
                system: frame.header.system_id,
                component: frame.header.component_id,
            },
            verified: frame.verified.is_some(),
            payload: frame.payload(),
        };
        // The responder itself counts what it ignores.
        let _ = self
            .responder
            .handle(now.mono, inbound, random, keys.for_exchange());
    }

    /// The next event for the key and the log; events about the window are kept for `poll_news` too.
    pub(super) fn poll_event(&mut self) -> Option<ResponderEvent> {
        let event = self.responder.poll_event()?;
        let news = match &event {
            ResponderEvent::Paired { peer } => PairingNews::Paired(*peer),
            ResponderEvent::WindowClosed => PairingNews::Closed,
            ResponderEvent::WrongCode => PairingNews::WrongCode,
            _ => return Some(event),
        };
        // Strangers can cause these at will, and perhaps nobody reads them.
        if self.news.len() < MAX_NEWS {
            self.news.push_back(news);
        }
        Some(event)
    }

    /// Sets what the ground is answered when it asks about its key.
    pub(super) fn report_state(&mut self, state: State) {
        match state {
            State::Staged | State::WaitDisarm => self.responder.report(Status::WaitDisarm, 0),
            State::Sent => self.responder.key_sent(),
            State::Unknown => self.responder.report(Status::Silent, 0),
            // A key that was not taken is sent again; the other two are reported when the key rollover ends.
            State::Committed | State::NotTaken | State::RolledBack => {}
        }
    }

    /// More than one autopilot is on PX4's link: the key is refused.
    pub(super) fn report_refused(&mut self) {
        self.responder.key_dropped();
        // After `key_dropped`, which reports a rollback: the ground is to learn the more exact reason.
        self.responder.report(Status::Refused, SEVERAL_AUTOPILOTS);
    }

    /// The next answer to the ground.
    pub(super) fn poll_transmit(
        &mut self,
        now: Now,
        (radio, phase): (&mut Link<Peer>, &mut Phase),
        keys: &mut dyn Keys,
        out: &mut [u8; MAX_FRAME],
    ) -> Option<Transmit> {
        // Persist, then answer: the disk may be slow.
        if !keys.is_stored() {
            return None;
        }
        let (to, message) = match self.responder.poll_transmit() {
            Some(answer) => (answer.to, answer.message),
            // Without a key nothing else shows the ground that somebody is here. One that waits for PX4 is enough: another
            // would replace it.
            None if matches!(phase, Phase::Keyless) && self.responder.memory().next.is_none() => {
                let to = radio.peer()?;
                (to, self.responder.please(now.mono)?)
            }
            None => return None,
        };
        let auth = phase.ground_auth(keys);
        let payload = message.to_payload();
        // What cannot be stamped now is asked for again by the ground.
        let sent = radio
            .send_raw(now, auth, KEY_EXCHANGE_ID, &payload, Some(to), out)
            .ok()?;
        Some(Transmit::new(Side::Radio, sent.to, sent.len))
    }

    pub(super) fn poll_timeout(&self) -> Duration {
        self.responder.poll_timeout().unwrap_or(Duration::MAX)
    }
}

const MAX_NEWS: usize = 32;
