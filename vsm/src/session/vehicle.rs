//! The MAVLink side of one vehicle: its link, its services, and what it has said of itself.
//!
//! Only verified frames of the vehicle's autopilot (component 1) reach the telemetry, and only fresh ones confirm
//! anything. Where signing is off by configuration every frame of its system id counts.

use std::collections::VecDeque;
use std::net::SocketAddr;
use std::time::Duration;

use mapping::telemetry::Telemetry;
use mavlink::Message as _;
use mavlink_link::Now;
use mavlink_link::clock::CeilingStore;
use mavlink_link::dialect::{
    COMMAND_ACK_DATA, COMMAND_LONG_DATA, CONTROL_STATUS_DATA, MavCmd, MavMessage, MavResult,
    MavSeverity,
};
use mavlink_link::frame::{FrameView, Header, MAX_FRAME};
use mavlink_link::link::{Auth, Link, LinkStats};
use mavlink_link::receiver::KeyState;
use mavlink_link::service::interval::{Intervals, Rate};
use mavlink_link::service::text::{Text, Texts};
use mavlink_link::service::{Node, command, mission, param};
use mavlink_link::signing::Stamp;

use super::counters::ByType;
use super::key_agreement::Agreement;
use super::settling::Settling;

/// Where a frame came from or goes to.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Peer {
    /// A UDP address.
    Udp(SocketAddr),
    /// The other end of a serial line.
    Serial,
}

impl std::fmt::Display for Peer {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Peer::Udp(address) => address.fmt(f),
            Peer::Serial => f.write_str("serial"),
        }
    }
}

/// One frame for the wire.
#[derive(Debug, Clone)]
pub struct OutFrame {
    /// Where it goes.
    pub to: Peer,
    len: usize,
    octets: [u8; MAX_FRAME],
}

impl OutFrame {
    pub(super) fn new(to: Peer, len: usize, octets: [u8; MAX_FRAME]) -> OutFrame {
        OutFrame { to, len, octets }
    }

    /// Its octets.
    #[must_use]
    pub fn octets(&self) -> &[u8] {
        self.octets.get(..self.len).unwrap_or_default()
    }
}

/// What the vehicle has told, for the bridge to act on.
#[expect(
    clippy::large_enum_variant,
    reason = "boxed, the vehicle could make us allocate"
)]
#[derive(Debug, Clone, PartialEq)]
pub(crate) enum VehicleEvent {
    /// A heartbeat after silence, or the first.
    Heard,
    /// No word of its state for [`SILENCE`].
    Silent,
    /// The vehicle has started anew: its clock since boot went back.
    Restarted,
    /// Its mode is another.
    ModeChanged,
    /// A mission service ended or went on.
    Mission(mission::Event),
    /// A command ended or went on.
    Command(command::Event),
    /// The answer to a parameter that was asked for.
    Parameter(param::Event),
    /// A parameter that it tells unasked: somebody has changed it.
    ParameterTold(param::Name, param::Value),
    /// It has returned the ping of this number.
    PingReturned(u32),
    /// It has answered a command of another system: (system, command).
    ForeignCommand(u8, u32),
    /// It has told which systems may command it.
    ControlStatus(CONTROL_STATUS_DATA),
    /// It passes on that this system asks for operator control.
    ControlAsked(u8),
    /// A text of its own.
    Text(Text),
    /// Something about the link.
    Link(mavlink_link::link::Event<Peer>),
}

/// The machine.
#[derive(Debug)]
pub(crate) struct VehicleLink {
    vehicle: Node,
    pub(super) link: Link<Peer>,
    pub(super) key: Option<KeyState>,
    pub(super) settling: Settling,
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
            settling: Settling::default(),
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
        self.intervals.wish(id, Rate::Hz(hertz));
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

    /// Takes what arrived. `tap` sees every frame that was believed, for a recording.
    pub(crate) fn handle_datagram(
        &mut self,
        now: Now,
        from: Peer,
        octets: &[u8],
        store: &mut dyn CeilingStore,
        tap: &mut dyn FnMut(&FrameView<'_>),
    ) {
        if self.settle_datagram(now, from, octets, store) {
            return;
        }
        if self.look_for_next_key(now, from, octets, store) {
            self.collect(now.mono);
            self.flush(now, store);
            return;
        }
        // The link borrows itself while it delivers: what it delivers is taken in afterwards.
        let mut believed = std::mem::take(&mut self.believed);
        let asked = self.asked;
        let (link, key, received) = (&mut self.link, self.key.as_mut(), &mut self.received);
        link.handle_datagram(now, from, octets, auth(key, store), &mut |delivery| {
            tap(&delivery.frame);
            received.count(delivery.header.message_id);
            let fresh = Fresh {
                mission: delivery.can_answer(asked.mission),
                command: delivery.can_answer(asked.command),
                parameter: delivery.can_answer(asked.parameter),
                state: delivery.can_answer(asked.last),
            };
            if let Ok(message) = delivery.message {
                let Header {
                    system_id,
                    component_id,
                    ..
                } = delivery.header;
                believed.push((Node::new(system_id, component_id), message, fresh));
            }
        });
        for (node, message, fresh) in believed.drain(..) {
            self.take_message(now, node, &message, fresh);
        }
        self.believed = believed;
        self.collect(now.mono);
        self.flush(now, store);
    }

    fn take_message(&mut self, now: Now, node: Node, message: &MavMessage, fresh: Fresh) {
        self.texts.handle_message(now.mono, node, message);
        if node != self.vehicle {
            return;
        }
        if let MavMessage::COMMAND_ACK(ack) = message
            && ack.target_system != 0
            && ack.target_system != self.link.config().own_system
        {
            let event = VehicleEvent::ForeignCommand(ack.target_system, ack.command as u32);
            self.events.push_back(event);
        }
        match message {
            MavMessage::CONTROL_STATUS(status) => {
                self.events
                    .push_back(VehicleEvent::ControlStatus(status.clone()));
            }
            MavMessage::COMMAND_LONG(asked)
                if asked.command == MavCmd::MAV_CMD_REQUEST_OPERATOR_CONTROL
                    && asked.target_system == self.link.config().own_system =>
            {
                self.events
                    .push_back(VehicleEvent::ControlAsked(asked.param4 as u8));
                // That it has been heard, no more.
                self.post(MavMessage::COMMAND_ACK(COMMAND_ACK_DATA {
                    command: asked.command,
                    result: MavResult::MAV_RESULT_ACCEPTED,
                    target_system: node.system,
                    target_component: node.component,
                    ..COMMAND_ACK_DATA::default()
                }));
            }
            _ => {}
        }
        #[allow(deprecated, reason = "what PX4 answers")]
        if let MavMessage::PING(ping) = message
            && ping.target_system == self.link.config().own_system
        {
            self.events.push_back(VehicleEvent::PingReturned(ping.seq));
        }
        let mode = self.telemetry.mode;
        self.telemetry.update(message);
        if matches!(
            message,
            MavMessage::HEARTBEAT(_) | MavMessage::CURRENT_MODE(_)
        ) {
            self.state_is_newer |= fresh.state;
            self.heard_at = Some(now.mono);
        }
        if let MavMessage::HEARTBEAT(_) = message {
            self.heartbeat_at = Some(now.mono);
            if self.silent {
                self.silent = false;
                // It may have been given another plan meanwhile.
                self.telemetry.mission = None;
                self.intervals.ask_again();
                self.events.push_back(VehicleEvent::Heard);
            }
        }
        self.watch_boot(message);
        if let MavMessage::MISSION_CURRENT(_) = message {
            self.progress_told_ms = self.boot_ms;
        }
        if self.telemetry.mode != mode {
            self.events.push_back(VehicleEvent::ModeChanged);
        }
        self.missions
            .handle_message(now.mono, node, message, fresh.mission);
        self.commands
            .handle_message(now.mono, node, message, fresh.command);
        let answered = self
            .parameters
            .handle_message(now.mono, node, message, fresh.parameter);
        if let MavMessage::PARAM_VALUE(told) = message
            && !answered
            && let Some((name, value)) = param::told(told)
        {
            self.events
                .push_back(VehicleEvent::ParameterTold(name, value));
        }
    }

    /// A clock since boot that goes back is another boot: the rates asked for are forgotten.
    fn watch_boot(&mut self, message: &MavMessage) {
        let boot_ms = match message {
            MavMessage::ATTITUDE(m) => m.time_boot_ms,
            MavMessage::GLOBAL_POSITION_INT(m) => m.time_boot_ms,
            _ => return,
        };
        // Frames of one link may overtake each other a little.
        if self
            .boot_ms
            .is_some_and(|before| boot_ms.saturating_add(BOOT_SLACK_MS) < before)
        {
            self.telemetry.mission = None;
            self.intervals.ask_again();
            self.events.push_back(VehicleEvent::Restarted);
        }
        self.boot_ms = Some(boot_ms);
    }

    /// Passes on what the link would say, were it asked.
    pub(super) fn tell_link(&mut self, event: mavlink_link::link::Event<Peer>) {
        self.events.push_back(VehicleEvent::Link(event));
    }

    /// Does what is due.
    pub(crate) fn handle_timeout(&mut self, now: Now, store: &mut dyn CeilingStore) {
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
            self.settling.poll_timeout(),
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

    /// Signs and queues what the link and the services want sent; called after each change of theirs.
    pub(crate) fn flush(&mut self, now: Now, store: &mut dyn CeilingStore) {
        let mut octets = [0; MAX_FRAME];
        while let Some(sent) =
            self.link
                .poll_transmit(now, auth(self.key.as_mut(), store), &mut octets)
        {
            self.sent.count(HEARTBEAT);
            self.out.push_back(OutFrame {
                to: sent.to,
                len: sent.len,
                octets,
            });
        }
        while let Some(message) = self.posts.pop_front() {
            self.send(now, &message, store);
        }
        if self.missions.busy().is_none() {
            self.asked.mission = None;
        }
        while let Some(message) = self.missions.poll_transmit() {
            let stamp = self.send(now, &message, store);
            self.asked.mission = self.asked.mission.or(stamp);
        }
        if self.parameters.pending() == 0 {
            self.asked.parameter = None;
        }
        while let Some(message) = self.parameters.poll_transmit() {
            let stamp = self.send(now, &message, store);
            self.asked.parameter = self.asked.parameter.or(stamp);
        }
        loop {
            while let Some(event) = self.commands.poll_event() {
                self.asked.command = None;
                if self.intervals.handle_event(now.mono, &event) {
                    self.intervals.advance(now.mono, &mut self.commands);
                } else {
                    self.events.push_back(VehicleEvent::Command(event));
                }
            }
            let Some(message) = self.commands.poll_transmit() else {
                break;
            };
            let stamp = self.send(now, &message, store);
            self.asked.command = self.asked.command.or(stamp);
            if may_change_state(&message) {
                self.asked.last = stamp.or(self.asked.last);
                self.state_is_newer = false;
            }
        }
    }

    fn send(
        &mut self,
        now: Now,
        message: &MavMessage,
        store: &mut dyn CeilingStore,
    ) -> Option<Stamp> {
        let mut octets = [0; MAX_FRAME];
        // Refusals are counted and alerted by the link; the service repeats or gives up by its own timing.
        let sent = self
            .link
            .send(now, auth(self.key.as_mut(), store), message, &mut octets)
            .ok()?;
        self.sent.count(message.message_id());
        self.out.push_back(OutFrame {
            to: sent.to,
            len: sent.len,
            octets,
        });
        sent.stamp
    }
}

/// Rates and messages are asked for all the time: what is told meanwhile is no older for it.
fn may_change_state(command: &MavMessage) -> bool {
    !matches!(
        command,
        MavMessage::COMMAND_LONG(COMMAND_LONG_DATA {
            command: MavCmd::MAV_CMD_SET_MESSAGE_INTERVAL | MavCmd::MAV_CMD_REQUEST_MESSAGE,
            ..
        })
    )
}

pub(super) fn auth<'a>(key: Option<&'a mut KeyState>, store: &'a mut dyn CeilingStore) -> Auth<'a> {
    match key {
        Some(key) => Auth::Signed { key, store },
        None => Auth::Off,
    }
}

/// A complaint belongs to a refusal that follows within this time.
const COMPLAINT_LIFE: Duration = Duration::from_secs(3);
const AUTOPILOT: u8 = 1;
const HEARTBEAT: u32 = 0;
const BOOT_SLACK_MS: u32 = 1_000;

/// What the DLI needs of the vehicle, and what PX4 sends unasked that it does not: its 50 Hz streams are not for a
/// radio.
const RATES: &[(u32, Rate)] = &[
    // First: with it a bad link is not taken for a silent vehicle.
    (436, Rate::Hz(5.0)), // CURRENT_MODE
    (30, Rate::Hz(5.0)),  // ATTITUDE
    (33, Rate::Hz(5.0)),  // GLOBAL_POSITION_INT
    (32, Rate::Hz(5.0)),  // LOCAL_POSITION_NED
    (245, Rate::Hz(2.0)), // EXTENDED_SYS_STATE
    (242, Rate::Hz(1.0)), // HOME_POSITION
    (24, Rate::Hz(1.0)),  // GPS_RAW_INT
    (74, Rate::Hz(2.0)),  // VFR_HUD
    (87, Rate::Hz(2.0)),  // POSITION_TARGET_GLOBAL_INT
    (1, Rate::Hz(1.0)),   // SYS_STATUS
    (147, Rate::Hz(0.5)), // BATTERY_STATUS
    (31, Rate::Off),      // ATTITUDE_QUATERNION
    (83, Rate::Off),      // ATTITUDE_TARGET
    (85, Rate::Off),      // POSITION_TARGET_LOCAL_NED
    (36, Rate::Off),      // SERVO_OUTPUT_RAW
];
