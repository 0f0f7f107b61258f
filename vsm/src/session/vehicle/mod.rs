//! The MAVLink side of one vehicle: its link, its services, and what it has said of itself.
//!
//! Only verified frames of the vehicle's autopilot (component 1) reach the telemetry, and only fresh ones confirm
//! anything. Where signing is off by configuration every frame of its system id counts.

mod event;
mod frame;
mod intake;
mod rates;
mod sending;

pub(crate) use event::VehicleEvent;
pub use frame::{OutFrame, Peer};

use std::collections::VecDeque;
use std::time::Duration;

use mapping::telemetry::Telemetry;
use mavlink_link::Now;
use mavlink_link::dialect::{MavMessage, MavSeverity};
use mavlink_link::link::{Auth, Link, LinkStats};
use mavlink_link::receiver::{AUTOPILOT, KeyState};
use mavlink_link::service::interval::{Intervals, Rate};
use mavlink_link::service::text::Texts;
use mavlink_link::service::{Node, command, mission, param};
use mavlink_link::signing::Stamp;
use mavlink_link::store::Disk;

use self::rates::RATES;
use super::counters::ByType;
use super::key_agreement::Agreement;
use super::key_recovery::KeyRecovery;

/// The machine.
#[derive(Debug)]
pub(crate) struct VehicleLink {
    vehicle: Node,
    pub(super) link: Link<Peer>,
    pub(super) key: Option<KeyState>,
    pub(super) key_recovery: KeyRecovery,
    pub(super) agreement: Agreement,
    /// Since when frames have been accepted without a break.
    pub(super) live_since: Option<Duration>,
    pub(crate) telemetry: Telemetry,
    pub(crate) missions: mission::Client,
    pub(crate) commands: command::Client,
    pub(crate) parameters: param::Client,
    intervals: Intervals,
    texts: Texts,
    /// When its last heartbeat came.
    heartbeat_at: Option<Duration>,
    /// When it last told its mode.
    heard_at: Option<Duration>,
    silent: bool,
    boot_ms: Option<u32>,
    progress_told_ms: Option<u32>,
    asked: Asked,
    /// A mode was told after the last command was sent that may change it.
    state_is_newer: bool,
    complaint: Option<(Duration, String)>,
    posts: VecDeque<MavMessage>,
    believed: Vec<(Node, MavMessage, Fresh)>,
    events: VecDeque<VehicleEvent>,
    pub(super) out: VecDeque<OutFrame>,
    pub(crate) received: ByType,
    pub(crate) sent: ByType,
}

/// Stamps of what was asked: an answer is never stamped below its question.
#[derive(Debug, Clone, Copy, Default)]
struct Asked {
    /// First message of the mission operation that runs.
    mission: Option<Stamp>,
    /// First try of the command that runs.
    command: Option<Stamp>,
    /// First of the parameters that are asked for.
    parameter: Option<Stamp>,
    /// The last command that may change its state.
    last: Option<Stamp>,
}

/// Which questions a message can be an answer to.
#[derive(Debug, Clone, Copy)]
struct Fresh {
    mission: bool,
    command: bool,
    parameter: bool,
    state: bool,
}

/// A vehicle that has not told its mode for so long, by HEARTBEAT or CURRENT_MODE, has fallen silent, and what it last
/// said is stale.
///
/// Heartbeats alone would not do: they come once a second, and where four packets of ten are lost three in a row are
/// missing every few seconds, while all else goes on.
pub(crate) const SILENCE: Duration = Duration::from_millis(3_500);
/// And so has one without a heartbeat for so long, since nothing else says whether it is armed.
const NO_HEARTBEAT: Duration = Duration::from_secs(10);

impl VehicleLink {
    pub(crate) fn new(own: Node, link: Link<Peer>, key: Option<KeyState>) -> VehicleLink {
        let vehicle = Node::new(link.config().vehicle_system, AUTOPILOT);
        VehicleLink {
            vehicle,
            link,
            key,
            key_recovery: KeyRecovery::default(),
            agreement: Agreement::default(),
            live_since: None,
            telemetry: Telemetry::default(),
            missions: mission::Client::new(own, vehicle, mission::Timing::default()),
            commands: command::Client::new(own, vehicle, command::Timing::default()),
            parameters: param::Client::new(own, vehicle, param::Timing::default()),
            intervals: Intervals::new(RATES.iter().copied()),
            texts: Texts::new(vehicle.system),
            heartbeat_at: None,
            heard_at: None,
            silent: true,
            boot_ms: None,
            progress_told_ms: None,
            asked: Asked::default(),
            state_is_newer: true,
            complaint: None,
            posts: VecDeque::new(),
            believed: Vec::new(),
            events: VecDeque::new(),
            out: VecDeque::new(),
            received: ByType::default(),
            sent: ByType::default(),
        }
    }

    /// Whether it is heard: what it has said is not stale.
    pub(crate) fn live(&self) -> bool {
        !self.silent
    }

    /// When it last told its mode.
    pub(crate) fn heard_at(&self) -> Option<Duration> {
        self.heard_at
    }

    /// When it falls silent, if nothing more comes.
    fn silent_at(&self) -> Option<Duration> {
        let (heard, beat) = self.heard_at.zip(self.heartbeat_at)?;
        Some((heard + SILENCE).min(beat + NO_HEARTBEAT))
    }

    /// Sends a message that nothing answers, with the next flush.
    pub(crate) fn post(&mut self, message: MavMessage) {
        self.posts.push_back(message);
    }

    /// Wants a message at a rate from now on; asked for when the next command may go.
    pub(crate) fn want(&mut self, id: u32, hertz: f32) {
        self.intervals.request(id, Rate::Hz(hertz));
    }

    /// Its clock since boot, ms, as of its latest message that shows it.
    pub(crate) fn boot_ms(&self) -> Option<u32> {
        self.boot_ms
    }

    /// The same when it last told the progress of its mission.
    pub(crate) fn progress_told_ms(&self) -> Option<u32> {
        self.progress_told_ms
    }

    /// Whether a mode was told by a message made after the last command was sent that may change it.
    pub(crate) fn state_is_newer_than_command(&self) -> bool {
        self.state_is_newer
    }

    /// What the vehicle complained of just now, to be set after a refusal.
    pub(crate) fn latest_complaint(&self, now: Duration) -> Option<String> {
        let (at, text) = self.complaint.as_ref()?;
        (now.saturating_sub(*at) < COMPLAINT_LIFE).then(|| format!(" ({text})"))
    }

    /// The system id that this VSM speaks as.
    pub(crate) fn own_system(&self) -> u8 {
        self.link.config().own_system
    }

    pub(crate) fn peer(&self) -> Option<Peer> {
        self.link.peer()
    }

    pub(crate) fn stats(&self) -> LinkStats {
        self.link.stats()
    }

    pub(crate) fn key(&self) -> Option<&KeyState> {
        self.key.as_ref()
    }

    /// Passes on what the link would say, were it asked.
    pub(super) fn tell_link(&mut self, event: mavlink_link::link::Event<Peer>) {
        self.events.push_back(VehicleEvent::Link(event));
    }

    /// Does what is due.
    pub(crate) fn handle_timeout(&mut self, now: Now, store: &mut dyn Disk) {
        self.settle_timeout(now, store);
        self.link.handle_timeout(now);
        self.missions.handle_timeout(now.mono);
        self.commands.handle_timeout(now.mono);
        self.parameters.handle_timeout(now.mono);
        self.texts.handle_timeout(now.mono);
        let silent = self.silent_at().is_none_or(|at| at <= now.mono);
        if silent && !self.silent {
            self.silent = true;
            self.events.push_back(VehicleEvent::Silent);
        }
        if self.live() {
            self.intervals.advance(now.mono, &mut self.commands);
        }
        self.collect(now.mono);
        self.flush(now, store);
    }

    /// When [`VehicleLink::handle_timeout`] is next needed.
    pub(crate) fn poll_timeout(&self) -> Duration {
        let silence = self.silent_at().filter(|_| !self.silent);
        let intervals = self.intervals.poll_timeout().filter(|_| self.live());
        [
            self.missions.poll_timeout(),
            self.commands.poll_timeout(),
            self.parameters.poll_timeout(),
            self.texts.poll_timeout(),
            silence,
            intervals,
            self.key_recovery.poll_timeout(),
        ]
        .into_iter()
        .flatten()
        .fold(self.link.poll_timeout(), Duration::min)
    }

    pub(crate) fn poll_event(&mut self) -> Option<VehicleEvent> {
        self.events.pop_front()
    }

    pub(crate) fn poll_transmit(&mut self) -> Option<OutFrame> {
        self.out.pop_front()
    }

    /// Moves what the services have to say to the events.
    fn collect(&mut self, now: Duration) {
        while let Some(event) = self.missions.poll_event() {
            self.events.push_back(VehicleEvent::Mission(event));
        }
        while let Some(event) = self.parameters.poll_event() {
            self.events.push_back(VehicleEvent::Parameter(event));
        }
        while let Some(text) = self.texts.poll_event() {
            if text.severity as u32 <= MavSeverity::MAV_SEVERITY_WARNING as u32 {
                self.complaint = Some((now, text.text.clone()));
            }
            self.events.push_back(VehicleEvent::Text(text));
        }
        while let Some(event) = self.link.poll_event() {
            match event {
                mavlink_link::link::Event::Live => self.live_since = Some(now),
                mavlink_link::link::Event::Behind => self.live_since = None,
                mavlink_link::link::Event::KeyExchange(frame) if self.agreement.wanted => {
                    self.agreement.take_in(frame);
                    continue;
                }
                _ => {}
            }
            self.events.push_back(VehicleEvent::Link(event));
        }
    }
}

/// How the link signs and verifies: by the key, or not at all where signing is off by configuration.
pub(super) fn auth<'a>(key: Option<&'a mut KeyState>, store: &'a mut dyn Disk) -> Auth<'a> {
    match key {
        Some(key) => Auth::Signed { key, store },
        None => Auth::Off,
    }
}

/// A complaint belongs to a refusal that follows within this time.
const COMPLAINT_LIFE: Duration = Duration::from_secs(3);
