//! The air-side agent: a verifying relay beside PX4, and the only one that gives PX4 its keys.
//!
//! A sans-I/O machine between two links. Promised:
//!
//! - From the radio only frames pass that verify under the key in force, of a listed (system, component, link), with a
//!   stamp never accepted before, over restarts too. Bytes pass unaltered. SETUP_SIGNING never passes, KEY_EXCHANGE goes
//!   to the exchange alone, and whatever carries the vehicle's own system id is dropped.
//! - To the radio only PX4's frames pass that verify under the key in force: none unsigned, none under the key before.
//! - A key for PX4 comes from this machine's own disk, never from the radio, and goes out by the states of
//!   [`mavlink_link::provisioning`]: disarmed, at most three times, believed only where frames verify.
//! - An unsigned PX4, or one that has fallen back to the key before, is given its key again at once; until it signs no
//!   command reaches it.
//!
//! What the promise against replays after PX4's restart is worth hangs on PX4 having no other radio.

mod exchange;
mod fallback;
mod key_install;
mod keys;
mod phase;
mod relay;
mod start;
mod status;
mod transmit;
mod watch;

pub use exchange::PairingNews;
pub use keys::{Held, Keys};
pub use start::{AgentError, Settings};
pub use status::{AirsideStatus, SideStatus};

use std::collections::VecDeque;
use std::time::Duration;

use mavlink_link::Now;
use mavlink_link::dialect::MavSeverity;
use mavlink_link::exchange::{Fingerprint, Responder};
use mavlink_link::link::{Alert, Event, Link};

use self::fallback::Fallback;
use self::phase::Phase;
use self::relay::Relayed;
use self::watch::Watch;
use crate::session::{Counters, LogLevel, Peer, link_alert_text};

/// One of the agent's two links.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Side {
    /// To the ground.
    Radio,
    /// To PX4.
    Px4,
}

/// A frame that stands ready in the caller's buffer.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Transmit {
    /// Which link it goes out on.
    pub side: Side,
    /// Where it must go.
    pub to: Peer,
    /// Its bytes in the buffer.
    pub len: usize,
    /// It holds a key: wipe the buffer once it is sent.
    pub secret: bool,
}

/// A line for the log.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Note {
    /// How much it matters.
    pub level: LogLevel,
    /// What happened.
    pub text: String,
}

/// The machine.
#[derive(Debug)]
pub struct Agent {
    settings: Settings,
    started: Duration,
    radio: Link<Peer>,
    px4: Link<Peer>,
    phase: Phase,
    /// The agent's own static key, as people compare it.
    identity: Fingerprint,
    responder: Responder<Peer>,
    news: VecDeque<PairingNews>,
    /// Looks for the key before in what does not verify under the one in force.
    fallback: Option<Fallback>,
    watch: Watch,
    queue: VecDeque<Relayed>,
    notes: VecDeque<Note>,
    /// What the ground should know; it alerts its operators.
    texts: VecDeque<(MavSeverity, &'static str)>,
    held_back: Counters,
    to_px4: u64,
    to_ground: u64,
}

impl Agent {
    /// When [`handle_timeout`](Self::handle_timeout) wants to be called, in monotonic time.
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
        self.radio.poll_timeout().min(px4).min(self.exchange_due())
    }

    /// Does what is due by now. Calling it early or late does no harm.
    pub fn handle_timeout(&mut self, now: Now, keys: &mut dyn Keys) {
        self.radio.handle_timeout(now);
        self.exchange_timeout(now, keys);
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
        while let Some(event) = self.px4.poll_event() {
            if let Event::Alert(alert) = event {
                self.tell_alert("PX4's link", alert);
            }
        }
    }

    /// The next thing for the log.
    pub fn poll_note(&mut self) -> Option<Note> {
        self.notes.pop_front()
    }

    /// How it stands.
    #[must_use]
    pub fn status(&self, vehicle: String, mono: Duration) -> AirsideStatus {
        AirsideStatus {
            vehicle,
            uptime_s: mono.saturating_sub(self.started).as_secs_f64(),
            state: self.phase.name(),
            key_id: self.phase.key_id().map(|id| id.to_string()),
            next_key_id: self.phase.next_id().map(|id| id.to_string()),
            to_px4: self.to_px4,
            to_ground: self.to_ground,
            held_back: self.held_back.clone(),
            identity: self.identity.to_string(),
            ground: self
                .responder
                .memory()
                .peer
                .map(|peer| peer.key.fingerprint().to_string()),
            window_s: self.responder.window(mono).map(|left| left.as_secs()),
            exchange: {
                let stats = self.responder.stats();
                let told = [("taken", stats.taken)].into_iter();
                told.chain(stats.by_reason())
                    .filter(|&(_, count)| count > 0)
                    .collect()
            },
            radio: SideStatus::new(self.radio.peer(), &self.radio.stats()),
            px4: SideStatus::new(self.px4.peer(), &self.px4.stats()),
        }
    }

    fn tell_alert(&mut self, link: &str, alert: Alert) {
        let text = match alert {
            Alert::VehicleUnsigned | Alert::StaysBehind => "stamps or signatures are missing",
            other => link_alert_text(other),
        };
        self.note(LogLevel::Warning, format!("{link}: {text}"));
    }

    /// At most 50 bytes, the longest that STATUSTEXT holds in one.
    fn tell_ground(&mut self, severity: MavSeverity, text: &'static str) {
        if self.texts.len() < MAX_TEXTS {
            self.texts.push_back((severity, text));
        }
    }

    fn note(&mut self, level: LogLevel, text: impl Into<String>) {
        if self.notes.len() < MAX_NOTES {
            let text = text.into();
            self.notes.push_back(Note { level, text });
        }
    }
}

const MAX_NOTES: usize = 256;
const MAX_TEXTS: usize = 8;
