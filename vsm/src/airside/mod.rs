//! The air-side agent: a verifying relay beside PX4, and the only one that gives PX4 its keys.
//!
//! A sans-I/O machine between two links. It promises:
//!
//! - From the radio, a frame passes only if it verifies under the key in force, comes from a listed (system, component,
//!   link), and has a stamp that was never accepted before, also over restarts. Its bytes pass unaltered. SETUP_SIGNING
//!   never passes, KEY_EXCHANGE goes only to the exchange, and a frame with the vehicle's own system id is dropped.
//! - To the radio, a frame of PX4 passes only if it verifies under the key in force: no unsigned frame, none under the
//!   previous key.
//! - A key for PX4 comes from this machine's own disk, never from the radio. It is sent by the states of
//!   [`mavlink_link::provisioning`]: only while disarmed, at most three times, and taken as installed only if frames
//!   verify.
//! - A PX4 that is unsigned, or has fallen back to the previous key, is sent its key again at once. Until it signs, no
//!   command reaches it.
//! - What the ground may command is limited by a list of the agent's own ([`RelayPolicy`]), so that a captured ground
//!   station does not own the vehicle's shell, files and failsafes.
//! - An order to zeroize, from the paired ground or from an operator here, is stored before it is acknowledged, and refused
//!   unless PX4 is known to be disarmed (`zeroize`).
//!
//! The promise against replays after a restart of PX4 holds only if PX4 has no other radio.
//!
//! The files, from the bottom up: `phase` is the state of PX4's key, `keys` the agent's disk, `output` what it sends and
//! logs. `watch`, `relay`, `fallback`, `contingency` and `exchange` know no sibling; `agent` is the struct that holds them
//! all. Above it, `key_install` installs a key on PX4, `transmit` chooses the next frame, `start` begins, `trace` describes
//! what happened to a datagram. This file is the router.

mod agent;
mod contingency;
mod exchange;
mod fallback;
mod key_install;
mod keys;
mod output;
mod phase;
mod relay;
mod start;
mod status;
mod trace;
mod transmit;
mod watch;
mod zeroize;

pub use agent::{Agent, Settings};
pub use contingency::AloneStatus;
pub use exchange::PairingNews;
pub use keys::{Held, Keys};
pub use output::{Note, Side, Transmit};
pub use start::AgentError;
pub use status::{AirsideStatus, SideStatus};
pub use trace::{Trace, sent_text};

use std::time::Duration;

use mavlink_link::Now;
use mavlink_link::exchange::{
    Message, PairingCode, Random, Received, Step, VehicleState, WindowError,
};
use mavlink_link::link::{Alert, Auth, Event, KeyExchangeFrame, LinkState};

use self::fallback::Fallback;
use self::phase::Stage;
use self::phase::{Cause, Phase};
use self::relay::FrameForwarder;
use crate::relay_policy::Px4Now;
pub use crate::relay_policy::RelayPolicy;
use crate::session::{LogLevel, Peer};

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
        self.exchange.open_window(now, code, keys)?;
        self.reports.note(
            LogLevel::Warning,
            "the pairing window is open for 10 minutes",
        );
        self.follow_exchange(now, keys);
        Ok(())
    }

    /// Closes the window: the operator has stopped waiting.
    pub fn close_window(&mut self) {
        self.exchange.responder.close_window();
    }

    /// What has happened at the pairing window.
    pub fn poll_pairing(&mut self) -> Option<PairingNews> {
        self.exchange.poll_news()
    }

    /// Takes bytes received from the ground. `random` is for the exchange.
    pub fn handle_radio(
        &mut self,
        now: Now,
        from: Peer,
        bytes: &[u8],
        random: &mut dyn Random,
        keys: &mut dyn Keys,
    ) {
        let closed = self.phase.is_closed(now.mono, self.px4.accepted_at());
        let to = self.px4_peer(now.mono);
        let px4_now = Px4Now {
            disarmed: self.watch.is_disarmed(now.mono),
            zeroizing: self.zeroize != Stage::Safe,
        };
        let auth = self.phase.ground_auth(keys);
        self.radio
            .handle_datagram(now, from, bytes, auth, &mut |delivery| {
                self.relay.pass_to_px4(&delivery, to, closed, px4_now);
            });
        while let Some(event) = self.radio.poll_event() {
            match event {
                Event::KeyExchange(frame) => self.take_exchange(now, &frame, random, keys),
                Event::Alert(alert) => self.reports.note_alert("the ground's link", alert),
                Event::PeerChanged { to, .. } => {
                    self.reports
                        .note(LogLevel::Info, format!("the ground is at {to}"));
                }
                Event::ClockMet(ahead) => self.reports.note_clock("the ground", ahead),
                Event::Behind | Event::Ahead | Event::Live => {}
            }
        }
    }

    /// The address of PX4. While a key is being installed, the rollover receives PX4's frames and knows their source.
    fn px4_peer(&self, mono: Duration) -> Option<Peer> {
        match &self.phase {
            Phase::HandingOver(on) if on.handover.peer().is_some() => on.handover.proven_peer(mono),
            _ => self.px4.peer(),
        }
    }

    /// Takes bytes received from PX4.
    pub fn handle_px4(&mut self, now: Now, from: Peer, bytes: &[u8], keys: &mut dyn Keys) {
        match &self.phase {
            // Without a key no frame of PX4 can be verified, and unverified frames are not relayed.
            Phase::Keyless | Phase::CannotSign { .. } => {}
            Phase::HandingOver(_) => self.take_while_handing_over(now, from, bytes, keys),
            Phase::Relaying(_) => self.take_and_relay(now, from, bytes, keys),
        }
    }

    fn take_and_relay(&mut self, now: Now, from: Peer, bytes: &[u8], keys: &mut dyn Keys) {
        let Phase::Relaying(relaying) = &mut self.phase else {
            return;
        };
        let bad_before = self.px4.stats().bad_signature;
        let auth = Auth::Signed {
            key: &mut relaying.key,
            store: keys.disk(),
        };
        let mut forwarder = FrameForwarder {
            mono: now.mono,
            own_component: self.settings.own_component,
            ground: self.radio.peer(),
            watch: &mut self.watch,
            alone: &mut self.alone,
            relay: &mut self.relay,
        };
        self.px4
            .handle_datagram(now, from, bytes, auth, &mut |delivery| {
                if delivery.verified {
                    forwarder.pass(&delivery.frame);
                }
            });
        let mut unsigned = false;
        while let Some(event) = self.px4.poll_event() {
            match event {
                Event::Alert(Alert::VehicleUnsigned) => unsigned = true,
                Event::Alert(alert) => self.reports.note_alert("PX4's link", alert),
                Event::Live => self
                    .reports
                    .note(LogLevel::Info, "link to PX4 is up, signed and verified"),
                Event::Behind => self.reports.note(
                    LogLevel::Info,
                    "PX4's timestamps are behind: it or this agent has restarted; sending it a current timestamp",
                ),
                Event::ClockMet(ahead) => self.reports.note_clock("PX4", ahead),
                Event::Ahead => self.reports.note(
                    LogLevel::Warning,
                    "PX4's timestamps are over an hour ahead: asking it for a proof that they are its own",
                ),
                Event::PeerChanged { .. } | Event::KeyExchange(_) => {}
            }
        }
        // The second check costs another hash per frame: only a frame that failed under the key in force is worth it.
        let fell_back =
            self.px4.stats().bad_signature > bad_before && self.fell_back(now, from, bytes, keys);
        if unsigned || fell_back {
            self.key_lost(unsigned, now, keys);
        } else if self.watch.take_restart() {
            self.px4_restarted(keys);
        }
    }

    /// It signs with the current key after a restart, so the previous key is no longer needed.
    fn px4_restarted(&mut self, keys: &mut dyn Keys) {
        self.reports
            .note(LogLevel::Info, "PX4 has restarted and signs");
        self.alone.px4_restarted();
        // PX4 reads its key file at boot: a restart under the current key shows that the file holds it.
        if let Phase::Relaying(relaying) = &mut self.phase
            && relaying.previous.is_some()
        {
            match keys.drop_previous() {
                Ok(()) => {
                    relaying.previous = None;
                    // The fallback receiver would continue to use stamps of a key whose clock is deleted.
                    self.fallback = Fallback::default();
                }
                Err(fault) => self.reports.note(
                    LogLevel::Warning,
                    format!("the previous key cannot be deleted: {fault}"),
                ),
            }
        }
    }

    /// Whether PX4 signs with the previous key.
    fn fell_back(&mut self, now: Now, from: Peer, bytes: &[u8], keys: &mut dyn Keys) -> bool {
        let previous = match &self.phase {
            Phase::Relaying(relaying) => relaying.previous.as_ref(),
            _ => None,
        };
        let link = (self.px4.config(), self.settings.not_before);
        let found = self
            .fallback
            .is_under_previous(now, (from, bytes), previous, link, keys);
        found.unwrap_or_else(|fault| {
            let text = format!("the previous key: {fault}");
            self.reports.note(LogLevel::Error, text);
            false
        })
    }

    fn take_exchange(
        &mut self,
        now: Now,
        frame: &KeyExchangeFrame<Peer>,
        random: &mut dyn Random,
        keys: &mut dyn Keys,
    ) {
        // An order to zeroize is taken in every phase; everything else may have to wait.
        let orders = || {
            let message = Message::parse(frame.payload());
            matches!(message, Ok(Received::Exchange(message)) if message.step == Step::Order)
        };
        if self.zeroize != Stage::Safe && !orders() {
            self.relay
                .held_back
                .count("KEY_EXCHANGE while a zeroize is carried out");
            return;
        }
        if matches!(&self.phase, Phase::HandingOver(on) if on.cause == Cause::LostKey) && !orders()
        {
            // This usually takes seconds. Until then it is not known which key PX4 has, and so how to give it another.
            self.relay
                .held_back
                .count("KEY_EXCHANGE while PX4 is given its key again");
            return;
        }
        let vehicle = VehicleState {
            armed: self.watch.is_armed(),
            signed: matches!(self.phase, Phase::Relaying(_)) && self.px4.state() == LinkState::Live,
        };
        self.exchange.handle(now, frame, vehicle, random, keys);
        self.follow_exchange(now, keys);
    }

    /// When [`handle_timeout`](Self::handle_timeout) is next needed, in monotonic time.
    #[must_use]
    pub fn poll_timeout(&self) -> Duration {
        let px4 = match &self.phase {
            Phase::Keyless => Duration::MAX,
            Phase::CannotSign { again_at, .. } => *again_at,
            Phase::Relaying(_) => self.px4.poll_timeout(),
            Phase::HandingOver(on) => on
                .commit_at
                .unwrap_or(Duration::MAX)
                .min(on.handover.poll_timeout()),
        };
        self.radio
            .poll_timeout()
            .min(px4)
            .min(self.exchange.poll_timeout())
            .min(self.zeroize_timeout())
            .min(
                self.alone
                    .poll_timeout(self.started, self.radio.present_at()),
            )
    }

    /// Does what is due now. Calling it early or late does no harm.
    pub fn handle_timeout(&mut self, now: Now, keys: &mut dyn Keys) {
        self.radio.handle_timeout(now);
        self.exchange.responder.handle_timeout(now.mono);
        self.follow_exchange(now, keys);
        match &mut self.phase {
            Phase::Keyless => {}
            Phase::CannotSign { again_at, .. } if *again_at <= now.mono => {
                self.try_again_to_sign(now, keys);
            }
            Phase::CannotSign { .. } => {}
            Phase::Relaying(_) => self.px4.handle_timeout(now),
            Phase::HandingOver(on) => {
                on.handover.handle_timeout(now);
                self.follow_handover(now, keys);
            }
        }
        self.follow_zeroize(now.mono);
        self.alone.step(&mut contingency::Surroundings {
            now,
            started: self.started,
            ground: self.radio.present_at(),
            reaches_px4: self.phase.reaches_px4(),
            disk: keys.disk(),
            reports: &mut self.reports,
        });
        while let Some(event) = self.px4.poll_event() {
            if let Event::Alert(alert) = event {
                self.reports.note_alert("PX4's link", alert);
            }
        }
    }

    /// Whether PX4 has recently reported, in a signed frame, that it is disarmed.
    #[must_use]
    pub fn is_disarmed(&self, mono: Duration) -> bool {
        self.watch.is_disarmed(mono)
    }

    /// Whether a key is due to be sent to PX4.
    #[must_use]
    pub fn key_is_due(&self, mono: Duration) -> bool {
        match &self.phase {
            Phase::Keyless | Phase::CannotSign { .. } => false,
            Phase::HandingOver(on) => on.handover.key_is_due(),
            Phase::Relaying(_) => self.settings.restamp && self.watch.restamp_is_due(mono),
        }
    }

    /// Holds back keys for PX4, or releases them: the shell uses this while it checks who would receive them. Everything
    /// else continues.
    pub fn hold_key(&mut self, hold: bool) {
        self.key_held = hold;
    }

    /// Counts what the shell has held back, for the status.
    pub fn count_held_back(&mut self, why: &'static str) {
        self.relay.held_back.count(why);
    }

    /// The next thing for the log.
    pub fn poll_note(&mut self) -> Option<Note> {
        self.reports.poll_note()
    }

    /// The agent's status.
    #[must_use]
    pub fn status(&self, vehicle: String, mono: Duration) -> AirsideStatus {
        AirsideStatus {
            vehicle,
            uptime_s: mono.saturating_sub(self.started).as_secs_f64(),
            state: self.phase.name(),
            key_id: self.phase.key_id().map(|id| id.to_string()),
            next_key_id: self.phase.next_id().map(|id| id.to_string()),
            memory_locked: false,
            to_px4: self.relay.to_px4,
            to_ground: self.relay.to_ground,
            held_back: self.relay.held_back.clone(),
            denied_messages: self.relay.denied_messages.clone(),
            denied_commands: self.relay.denied_commands.clone(),
            identity: self.identity.to_string(),
            ground: self
                .exchange
                .responder
                .memory()
                .peer
                .map(|peer| peer.key.fingerprint().to_string()),
            window_s: self
                .exchange
                .responder
                .window(mono)
                .map(|left| left.as_secs()),
            exchange: {
                let stats = self.exchange.responder.stats();
                let taken = [("taken", stats.taken)].into_iter();
                taken
                    .chain(stats.by_reason())
                    .filter(|&(_, count)| count > 0)
                    .collect()
            },
            encryption: None,
            contingency: self.alone.status(mono),
            radio: SideStatus::new(&self.radio, mono),
            px4: SideStatus::new(&self.px4, mono),
        }
    }
}
