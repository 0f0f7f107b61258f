//! The air-side agent: a verifying relay beside PX4, and the only one that gives PX4 its keys.
//!
//! A sans-I/O machine between two links. Promised:
//!
//! - From the radio only frames pass that verify under the key in force, of a listed (system, component, link), with a
//!   stamp never accepted before, over restarts too. Octets pass unaltered. SETUP_SIGNING never passes, KEY_EXCHANGE goes
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
mod handing;
mod keys;
mod phase;
mod status;
mod watch;

pub use exchange::PairingNews;
pub use keys::{Held, Keys};
pub use status::{AirsideStatus, SideStatus};

use std::collections::VecDeque;
use std::time::Duration;

use mavlink_link::Now;
use mavlink_link::clock::{CeilingStore, Origin};
use mavlink_link::dialect::{MavMessage, MavSeverity, STATUSTEXT_DATA};
use mavlink_link::exchange::{
    Fingerprint, Identity, Node, Parties, Random, Responder, ResponderConfig, ResponderMemory,
    StagedKey, Wanted,
};
use mavlink_link::frame::{FrameView, MAX_FRAME};
use mavlink_link::link::{Alert, Auth, Endpoint, Event, Link, LinkConfig, Role, Security};
use mavlink_link::provisioning;
use mavlink_link::receiver::{KeyState, Stream, Talkers};
use mavlink_link::signing::{SigningKey, Stamp};
use zeroize::Zeroizing;

use self::fallback::Fallback;
use self::phase::{Cause, Phase, Relaying};
use self::watch::Watch;
use crate::session::{Counters, LogLevel, Peer, link_alert_text};

/// What an agent is told before it starts.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Settings {
    /// The vehicle's system id: PX4's, and the agent's own towards the ground.
    pub vehicle_system: u8,
    /// The agent's own system id towards PX4, which must be another than the vehicle's.
    pub own_system: u8,
    /// The agent's component id on both sides.
    pub own_component: u8,
    /// The agent's link id on both sides.
    pub own_link_id: u8,
    /// Who may speak to PX4, the VSM first; at most [`Talkers::MOST`].
    pub talkers: Vec<Stream>,
    /// Where the ground is, where that is known.
    pub radio: Endpoint<Peer>,
    /// Where PX4 is, where that is known.
    pub px4: Endpoint<Peer>,
    /// Whether PX4 is given the same key with a new stamp after each of its starts.
    pub restamp: bool,
    /// A date that cannot be in the future.
    pub not_before: Stamp,
    /// The VSM's and the vehicle's identification numbers, DLI.
    pub ids: [u32; 2],
}

/// Why an agent does not start.
#[derive(Debug, thiserror::Error)]
pub enum AgentError {
    /// The list of talkers.
    #[error("{0} talkers, expected 1 to 8")]
    Talkers(usize),
    /// A handover that is not finished.
    #[error(transparent)]
    Handover(#[from] provisioning::StartError),
    /// A clock.
    #[error("the signing clock cannot be read: {0}")]
    Clock(#[from] mavlink_link::clock::StoreError),
}

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
    /// Its octets in the buffer.
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

/// A frame on its way through, as it came.
#[derive(Debug)]
struct Relayed {
    side: Side,
    to: Peer,
    len: usize,
    octets: [u8; MAX_FRAME],
}

impl Agent {
    /// Begins, or goes on where an earlier process was ended.
    ///
    /// # Errors
    /// The list of talkers is empty or too long, or a clock cannot be read.
    pub fn start(
        settings: Settings,
        identity: Identity,
        held: Held,
        now: Now,
        keys: &mut dyn Keys,
    ) -> Result<Agent, AgentError> {
        let talkers = settings.talkers.len();
        let only = Talkers::listed(&settings.talkers).ok_or(AgentError::Talkers(talkers))?;
        let first = settings.talkers.first().ok_or(AgentError::Talkers(0))?;
        let mut radio = LinkConfig::new(first.system, Security::Signed, settings.radio);
        // Towards the ground the agent is a component of the vehicle: the link refuses what comes in under that id.
        radio.own_system = settings.vehicle_system;
        radio.only = only;
        let mut px4 = LinkConfig::new(settings.vehicle_system, Security::Signed, settings.px4);
        px4.own_system = settings.own_system;
        for link in [&mut radio, &mut px4] {
            link.own_component = settings.own_component;
            link.link_id = settings.own_link_id;
            link.role = Role::OnboardComputer;
            link.accept_unsigned = &[];
        }
        let [vsm, vehicle] = settings.ids;
        let fingerprint = identity.public().fingerprint();
        let exchange = ResponderConfig {
            parties: Parties::new(
                Node {
                    system: first.system,
                    component: first.component,
                },
                Node {
                    system: settings.vehicle_system,
                    component: settings.own_component,
                },
                vsm,
                vehicle,
            ),
            identity,
            wanted: Wanted {
                signing: true,
                confidential: false,
            },
        };
        let next = match &held.next {
            None => None,
            Some(next) => Some(StagedKey {
                id: next.id(),
                // A key with a clock has been sent.
                sent: keys.load(&next.id())?.is_some(),
            }),
        };
        let memory = ResponderMemory {
            peer: held.peer,
            epoch: held.epoch,
            current: held.current.as_ref().map(SigningKey::id),
            next,
        };
        let mut agent = Agent {
            identity: fingerprint,
            responder: Responder::new(exchange, memory, now.mono),
            news: VecDeque::new(),
            started: now.mono,
            radio: Link::new(radio),
            px4: Link::new(px4),
            phase: Phase::Keyless,
            fallback: None,
            watch: Watch::default(),
            queue: VecDeque::new(),
            notes: VecDeque::new(),
            texts: VecDeque::new(),
            held_back: Counters::default(),
            to_px4: 0,
            to_ground: 0,
            settings,
        };
        agent.resume(held, now, keys)?;
        Ok(agent)
    }

    fn resume(&mut self, held: Held, now: Now, keys: &mut dyn Keys) -> Result<(), AgentError> {
        let current = match held.current {
            None => None,
            Some(key) => Some(self.state_of(key, now, keys)?),
        };
        if let Some(next) = held.next {
            self.note(
                LogLevel::Warning,
                format!(
                    "the handover of key {} is not finished: it goes on",
                    next.id()
                ),
            );
            return Ok(self.hand_over(current, next, Cause::NewKey, now, keys)?);
        }
        if let Some(key) = current {
            self.phase = Phase::Relaying(Box::new(Relaying {
                key,
                previous: held.previous,
            }));
        }
        Ok(())
    }

    fn state_of(
        &self,
        key: SigningKey,
        now: Now,
        keys: &mut dyn Keys,
    ) -> Result<KeyState, mavlink_link::clock::StoreError> {
        let not_before = self.settings.not_before;
        KeyState::start(key, Origin::KeyFile, not_before, now, keys)
    }

    /// Takes what came from the ground. `random` is for the exchange.
    pub fn handle_radio(
        &mut self,
        now: Now,
        from: Peer,
        octets: &[u8],
        random: &mut dyn Random,
        keys: &mut dyn Keys,
    ) {
        let closed = self.phase.is_closed(now.mono, self.px4.accepted_at());
        let to = self.px4.peer();
        let Agent {
            radio,
            phase,
            queue,
            held_back,
            to_px4,
            ..
        } = self;
        let auth = phase.ground_auth(keys);
        radio.handle_datagram(now, from, octets, auth, &mut |delivery| {
            let why = match to {
                _ if !delivery.verified => "unsigned",
                _ if delivery.header.message_id == SETUP_SIGNING => "SETUP_SIGNING from the ground",
                _ if closed => "PX4 is not heard, signed",
                None => "PX4 has not been heard",
                Some(to) => match enqueue(queue, Side::Px4, to, &delivery.frame) {
                    true => {
                        *to_px4 += 1;
                        return;
                    }
                    false => "too much at once",
                },
            };
            held_back.count(why);
        });
        while let Some(event) = self.radio.poll_event() {
            match event {
                Event::KeyExchange(frame) => self.take_exchange(now, &frame, random, keys),
                Event::Alert(alert) => self.tell_alert("the ground's link", alert),
                Event::PeerChanged { to, .. } => {
                    self.note(LogLevel::Info, format!("the ground is at {to}"));
                }
                Event::Behind | Event::Live => {}
            }
        }
    }

    /// Takes what came from PX4.
    pub fn handle_px4(&mut self, now: Now, from: Peer, octets: &[u8], keys: &mut dyn Keys) {
        match &self.phase {
            Phase::Keyless | Phase::CannotSign { .. } => {}
            Phase::HandingOver(_) => self.take_while_handing_over(now, from, octets, keys),
            Phase::Relaying(_) => self.take_and_relay(now, from, octets, keys),
        }
    }

    fn take_and_relay(&mut self, now: Now, from: Peer, octets: &[u8], keys: &mut dyn Keys) {
        let Phase::Relaying(relaying) = &mut self.phase else {
            return;
        };
        let bad_before = self.px4.stats().bad_signature;
        let auth = Auth::Signed {
            key: &mut relaying.key,
            store: keys,
        };
        let mut passage = Passage {
            mono: now.mono,
            own_component: self.settings.own_component,
            ground: self.radio.peer(),
            watch: &mut self.watch,
            queue: &mut self.queue,
            held_back: &mut self.held_back,
            to_ground: &mut self.to_ground,
        };
        self.px4
            .handle_datagram(now, from, octets, auth, &mut |delivery| {
                if delivery.verified {
                    passage.pass(&delivery.frame);
                }
            });
        let mut unsigned = false;
        while let Some(event) = self.px4.poll_event() {
            match event {
                Event::Alert(Alert::VehicleUnsigned) => unsigned = true,
                Event::Alert(alert) => self.tell_alert("PX4's link", alert),
                Event::Live => self.note(LogLevel::Info, "PX4 is heard, signed"),
                Event::Behind => self.note(
                    LogLevel::Info,
                    "PX4's stamps have fallen back: it has started anew, and is lifted",
                ),
                Event::PeerChanged { .. } | Event::KeyExchange(_) => {}
            }
        }
        let fell_back = self.px4.stats().bad_signature > bad_before
            && self.is_under_previous(now, from, octets, keys);
        if unsigned || fell_back {
            self.key_lost(unsigned, now, keys);
        } else if self.watch.take_restart() {
            self.px4_restarted(keys);
        }
    }

    /// It signs with the current key after a start: the one before has come to its end.
    fn px4_restarted(&mut self, keys: &mut dyn Keys) {
        self.note(LogLevel::Info, "PX4 has started anew, and signs");
        if let Phase::Relaying(relaying) = &mut self.phase
            && relaying.previous.is_some()
        {
            match keys.drop_previous() {
                Ok(()) => relaying.previous = None,
                Err(fault) => self.note(
                    LogLevel::Warning,
                    format!("the key before cannot be deleted: {fault}"),
                ),
            }
        }
    }

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

    /// Writes the next frame that is due into `out`. Call it until it gives `None`, after each of the others.
    pub fn poll_transmit(
        &mut self,
        now: Now,
        keys: &mut dyn Keys,
        out: &mut [u8; MAX_FRAME],
    ) -> Option<Transmit> {
        if let Some(relayed) = self.queue.pop_front() {
            *out = relayed.octets;
            return Some(Transmit {
                side: relayed.side,
                to: relayed.to,
                len: relayed.len,
                secret: false,
            });
        }
        self.fallback_transmit(now, keys, out)
            .or_else(|| self.px4_transmit(now, keys, out))
            .or_else(|| self.exchange_transmit(now, keys, out))
            .or_else(|| self.radio_transmit(now, keys, out))
    }

    fn px4_transmit(
        &mut self,
        now: Now,
        keys: &mut dyn Keys,
        out: &mut [u8; MAX_FRAME],
    ) -> Option<Transmit> {
        let (to, len, secret) = match &mut self.phase {
            Phase::Keyless | Phase::CannotSign { .. } => return None,
            Phase::HandingOver(on) => {
                let sent = on.handover.poll_transmit(now, keys, out)?;
                (sent.to, sent.len, sent.secret)
            }
            Phase::Relaying(relaying)
                if self.settings.restamp && self.watch.restamp_is_due(now.mono) =>
            {
                self.watch.restamped();
                let key = &mut relaying.key;
                // The same key with a stamp above all: what was recorded before PX4's start dies with it.
                let initial = key
                    .take_stamp(now, &mut *keys as &mut dyn CeilingStore)
                    .ok()?;
                let mut payload = Zeroizing::new([0; 42]);
                payload[..8].copy_from_slice(&initial.get().to_le_bytes());
                payload[8] = self.settings.vehicle_system;
                payload[9] = mavlink_link::receiver::AUTOPILOT;
                payload[10..].copy_from_slice(key.key().expose());
                let auth = Auth::Signed { key, store: keys };
                let sent = self
                    .px4
                    .send_raw(now, auth, SETUP_SIGNING, &*payload, None, out)
                    .ok()?;
                self.note(
                    LogLevel::Info,
                    "PX4 has started, disarmed: its key is given a new stamp; do not cut its power for 5 s",
                );
                (sent.to, sent.len, true)
            }
            Phase::Relaying(relaying) => {
                let auth = Auth::Signed {
                    key: &mut relaying.key,
                    store: keys,
                };
                let sent = self.px4.poll_transmit(now, auth, out)?;
                (sent.to, sent.len, false)
            }
        };
        Some(Transmit {
            side: Side::Px4,
            to,
            len,
            secret,
        })
    }

    fn radio_transmit(
        &mut self,
        now: Now,
        keys: &mut dyn Keys,
        out: &mut [u8; MAX_FRAME],
    ) -> Option<Transmit> {
        let heard = self.radio.peer().is_some();
        let auth = self.phase.ground_auth(keys);
        if matches!(auth, Auth::Off) {
            return None;
        }
        let text = if heard { self.texts.pop_front() } else { None };
        let sent = match text {
            Some((severity, text)) => {
                let text = MavMessage::STATUSTEXT(STATUSTEXT_DATA {
                    severity,
                    text: text.into(),
                    ..STATUSTEXT_DATA::default()
                });
                self.radio.send(now, auth, &text, out).ok()?
            }
            None => self.radio.poll_transmit(now, auth, out)?,
        };
        Some(Transmit {
            side: Side::Radio,
            to: sent.to,
            len: sent.len,
            secret: false,
        })
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

    /// At most 50 octets, the longest that STATUSTEXT holds in one.
    fn tell_ground(&mut self, severity: MavSeverity, text: &'static str) {
        if self.texts.len() < MOST_TEXTS {
            self.texts.push_back((severity, text));
        }
    }

    fn note(&mut self, level: LogLevel, text: impl Into<String>) {
        if self.notes.len() < MOST_NOTES {
            let text = text.into();
            self.notes.push_back(Note { level, text });
        }
    }
}

/// What a frame of PX4 goes through on its way to the ground.
struct Passage<'a> {
    mono: Duration,
    own_component: u8,
    ground: Option<Peer>,
    watch: &'a mut Watch,
    queue: &'a mut VecDeque<Relayed>,
    held_back: &'a mut Counters,
    to_ground: &'a mut u64,
}

impl Passage<'_> {
    /// A frame that has verified under the key in force.
    fn pass(&mut self, frame: &FrameView<'_>) {
        self.watch.take(self.mono, frame);
        let header = frame.header();
        let why = match self.ground {
            _ if header.message_id == SETUP_SIGNING => "SETUP_SIGNING from PX4",
            _ if header.component_id == self.own_component => "our own frame, reflected",
            None => "the ground has not been heard",
            Some(to) => match enqueue(self.queue, Side::Radio, to, frame) {
                true => {
                    *self.to_ground += 1;
                    return;
                }
                false => "too much at once",
            },
        };
        self.held_back.count(why);
    }
}

/// False where the queue is full.
fn enqueue(queue: &mut VecDeque<Relayed>, side: Side, to: Peer, frame: &FrameView<'_>) -> bool {
    let mut octets = [0; MAX_FRAME];
    let bytes = frame.as_bytes();
    let Some(place) = octets.get_mut(..bytes.len()) else {
        return false;
    };
    if queue.len() >= MOST_RELAYED {
        return false;
    }
    place.copy_from_slice(bytes);
    queue.push_back(Relayed {
        side,
        to,
        len: bytes.len(),
        octets,
    });
    true
}

const SETUP_SIGNING: u32 = 256;
/// Frames of one datagram, many times over: more than this is a flood.
const MOST_RELAYED: usize = 1_024;
const MOST_NOTES: usize = 256;
const MOST_TEXTS: usize = 8;
