//! The agent's end of the key exchange: what comes of it goes to PX4, and what PX4 does with it is told.
//!
//! A pairing window is opened by a person at this computer, never from the radio.

use std::time::Duration;

use mavlink_link::Now;
use mavlink_link::exchange::{
    Inbound, Node, PairingCode, PublicKey, Random, ResponderEvent, Status, VehicleState,
    WindowError,
};
use mavlink_link::frame::{KEY_EXCHANGE_ID, MAX_FRAME};
use mavlink_link::link::{KeyExchangeFrame, LinkState};
use mavlink_link::provisioning::State;

use super::phase::{Cause, Phase};
use super::{Agent, Keys, Side, Transmit};
use crate::session::{LogLevel, Peer};

/// Why an agreement came to nothing, in step 4's reason.
const SEVERAL_AUTOPILOTS: u8 = 1;

/// What the person at the pairing window is told.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum PairingNews {
    /// The ground has proved to know the code: its static key is pinned.
    Paired(PublicKey),
    /// Somebody did not know the code.
    WrongCode,
    /// The window has closed without a pairing.
    Closed,
}

impl Agent {
    /// Opens the window for one pairing with this code, for 10 minutes.
    ///
    /// # Errors
    /// A key is on its way to PX4, or the disk failed.
    pub fn open_window(
        &mut self,
        now: Now,
        code: &PairingCode,
        keys: &mut dyn Keys,
    ) -> Result<(), WindowError> {
        self.responder
            .open_window(now.mono, code, keys.for_exchange())?;
        self.news.clear();
        self.note(
            LogLevel::Warning,
            "the pairing window is open for 10 minutes",
        );
        self.follow_responder(now, keys);
        Ok(())
    }

    /// Closes the window: nobody waits at it any more.
    pub fn close_window(&mut self) {
        self.responder.close_window();
    }

    /// What has happened at the pairing window.
    pub fn poll_pairing(&mut self) -> Option<PairingNews> {
        self.news.pop_front()
    }

    /// Takes a KEY_EXCHANGE frame of the ground.
    pub(super) fn take_exchange(
        &mut self,
        now: Now,
        frame: &KeyExchangeFrame<Peer>,
        random: &mut dyn Random,
        keys: &mut dyn Keys,
    ) {
        if matches!(&self.phase, Phase::HandingOver(on) if on.cause == Cause::LostKey) {
            // Seconds, as a rule: until then it is not known under which key PX4 is to be given another.
            self.held_back
                .count("KEY_EXCHANGE while PX4 is given its key again");
            return;
        }
        self.responder.set_vehicle(VehicleState {
            armed: self.watch.is_armed(),
            signed: matches!(self.phase, Phase::Relaying(_)) && self.px4.state() == LinkState::Live,
        });
        let inbound = Inbound {
            from: frame.from,
            source: Node {
                system: frame.header.system_id,
                component: frame.header.component_id,
            },
            verified: frame.verified.is_some(),
            payload: frame.payload(),
        };
        // What it passes over it counts itself.
        let _ = self
            .responder
            .handle(now.mono, inbound, random, keys.for_exchange());
        self.follow_responder(now, keys);
    }

    /// Lets go what is over.
    pub(super) fn exchange_timeout(&mut self, now: Now, keys: &mut dyn Keys) {
        self.responder.handle_timeout(now.mono);
        self.follow_responder(now, keys);
    }

    fn follow_responder(&mut self, now: Now, keys: &mut dyn Keys) {
        while let Some(event) = self.responder.poll_event() {
            match event {
                ResponderEvent::Staged { key, epoch } => {
                    self.note(LogLevel::Info, format!("key {key} agreed, epoch {epoch}"));
                    self.hand_over_staged(now, keys);
                }
                ResponderEvent::Withdrawn => self.give_up_staged(),
                ResponderEvent::Paired { peer } => {
                    let fingerprint = peer.fingerprint();
                    self.note(
                        LogLevel::Warning,
                        format!("paired with the ground {fingerprint}; only it can agree about keys from now on"),
                    );
                    self.tell_pairing(PairingNews::Paired(peer));
                }
                ResponderEvent::WindowClosed => {
                    self.note(LogLevel::Info, "the pairing window is closed");
                    self.tell_pairing(PairingNews::Closed);
                }
                ResponderEvent::WrongCode => {
                    self.note(
                        LogLevel::Warning,
                        "somebody tried to pair with a wrong code",
                    );
                    self.tell_pairing(PairingNews::WrongCode);
                }
                ResponderEvent::NotStored(fault) => {
                    self.note(
                        LogLevel::Error,
                        format!("the exchange cannot be stored: {fault}"),
                    );
                }
            }
        }
    }

    fn tell_pairing(&mut self, news: PairingNews) {
        // Strangers cause these at will, and perhaps nobody is at the window.
        if self.news.len() < MAX_NEWS {
            self.news.push_back(news);
        }
    }

    /// A key of an exchange is on disk: PX4 is to have it.
    fn hand_over_staged(&mut self, now: Now, keys: &mut dyn Keys) {
        let next = match keys.next() {
            Ok(Some(next)) => next,
            Ok(None) => return,
            Err(fault) => {
                self.note(
                    LogLevel::Error,
                    format!("the agreed key cannot be read: {fault}"),
                );
                return;
            }
        };
        let old = match std::mem::replace(&mut self.phase, Phase::Keyless) {
            Phase::Relaying(relaying) => Some(relaying.key),
            Phase::HandingOver(on) => on.handover.into_old(),
            Phase::Keyless | Phase::CannotSign { .. } => None,
        };
        if let Err(fault) = self.hand_over(old, next, Cause::NewKey, now, keys) {
            // The key stays on disk, and a restart of the agent goes on with it.
            self.note(
                LogLevel::Error,
                format!("the agreed key cannot be handed over: {fault}"),
            );
            return;
        }
        self.responder.report(Status::WaitDisarm, 0);
    }

    /// The staged key must not be sent any more: PX4 goes on with the one that it has.
    fn give_up_staged(&mut self) {
        self.note(LogLevel::Info, "the agreed key is given up for another");
        self.phase = match std::mem::replace(&mut self.phase, Phase::Keyless) {
            Phase::HandingOver(on) if on.cause == Cause::NewKey => on
                .handover
                .into_old()
                .map_or(Phase::Keyless, |key| Phase::relaying(key, None)),
            Phase::CannotSign { .. } => Phase::Keyless,
            other => other,
        };
    }

    /// Tells the ground, when it asks, what has become of its key.
    pub(super) fn tell_state(&mut self, state: State) {
        match state {
            State::Staged | State::WaitDisarm => self.responder.report(Status::WaitDisarm, 0),
            State::Sent => self.responder.key_sent(),
            State::Unknown => self.responder.report(Status::Silent, 0),
            State::Committed | State::NotTaken | State::RolledBack => {}
        }
    }

    /// More than one autopilot is on PX4's link: the key is refused.
    pub(super) fn tell_refused(&mut self) {
        self.responder.key_dropped();
        self.responder.report(Status::Refused, SEVERAL_AUTOPILOTS);
    }

    /// The next answer to the ground.
    pub(super) fn exchange_transmit(
        &mut self,
        now: Now,
        keys: &mut dyn Keys,
        out: &mut [u8; MAX_FRAME],
    ) -> Option<Transmit> {
        let (to, message) = match self.responder.poll_transmit() {
            Some(answer) => (answer.to, answer.message),
            // Without a key nothing else tells the ground that somebody is here.
            None if matches!(self.phase, Phase::Keyless) => {
                let to = self.radio.peer()?;
                (to, self.responder.please(now.mono)?)
            }
            None => return None,
        };
        let auth = self.phase.ground_auth(keys);
        let payload = message.to_payload();
        // What cannot be stamped now is asked for again by the ground.
        let sent = self
            .radio
            .send_raw(now, auth, KEY_EXCHANGE_ID, &payload, Some(to), out)
            .ok()?;
        Some(Transmit {
            side: Side::Radio,
            to: sent.to,
            len: sent.len,
            secret: false,
        })
    }

    pub(super) fn exchange_due(&self) -> Duration {
        self.responder.poll_timeout().unwrap_or(Duration::MAX)
    }
}

const MAX_NEWS: usize = 32;
