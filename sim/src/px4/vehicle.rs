//! One simulated PX4, without socket or clock: messages in, time in, messages out.

use std::collections::VecDeque;
use std::time::Duration;

use mavlink::dialects::development::{
    MISSION_ITEM_REACHED_DATA, MavMessage, MavMissionType, MavSeverity, MissionState,
};
use mavlink_link::service::mission::{Airframe as ParamUse, Limits, Px4Rules, Server, ServerEvent};
use mavlink_link::service::{Node, param};

use super::body::{Body, Tuning};
use super::command::Command;
use super::commander::{Commander, Facts, boot};
use super::config::{Airframe, Config};
use super::estimator::Estimator;
use super::fence::Fence;
use super::geo::{Geodetic, LocalFrame, Ned};
use super::guidance::{Guidance, Heading};
use super::mission::{Note, View};
use super::mode::Mode;
use super::navigator::Navigator;
use super::params::{Param, Params};
use super::reports::mission_mode_active;
use super::steering::{Setpoint, Sticks};
use super::streams::{Streams, id};
use super::texts::Texts;

/// Something to put on the wire, from component 1 of the vehicle.
#[derive(Debug, Clone, PartialEq)]
#[allow(
    clippy::large_enum_variant,
    reason = "nearly all are messages, none stays long"
)]
pub enum Outgoing {
    /// A message of the dialect.
    Message(MavMessage),
    /// A message that the dialect's structs cannot hold: an enum value they do not know.
    Raw {
        /// Message id.
        id: u32,
        /// Payload, not trimmed.
        payload: Vec<u8>,
    },
}

impl Outgoing {
    /// The message, where the dialect has it.
    pub fn message(&self) -> Option<&MavMessage> {
        match self {
            Self::Message(message) => Some(message),
            Self::Raw { .. } => None,
        }
    }
}

/// What is really so, for tests and pictures; the messages carry the vehicle's own, slightly
/// wrong, belief.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Truth {
    /// Since boot.
    pub time: Duration,
    /// Where it is; altitude AMSL.
    pub place: Geodetic,
    /// The same in the local frame of the place of boot, m.
    pub position: Ned,
    /// Velocity over ground, m/s.
    pub velocity: Ned,
    /// Roll, pitch, yaw, radians; yaw from true north.
    pub attitude: [f64; 3],
    /// The mode that is flown.
    pub mode: Mode,
    /// Motors enabled.
    pub armed: bool,
    /// On the ground.
    pub landed: bool,
    /// MISSION_CURRENT.seq.
    pub mission_seq: u16,
}

/// What the vehicle has done with what it was told.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct VehicleCounters {
    /// Commands answered by ACCEPTED.
    pub commands_accepted: u64,
    /// Commands answered otherwise.
    pub commands_refused: u64,
    /// Commands lost because too many came at once.
    pub commands_lost: u64,
    /// Commands for somebody else, or that PX4 leaves unanswered.
    pub commands_ignored: u64,
    /// Plans stored.
    pub plans_stored: u64,
}

/// A simulated PX4 v1.18.
#[derive(Debug)]
pub struct Vehicle {
    pub(super) config: Config,
    pub(super) frame: LocalFrame,
    pub(super) body: Body,
    pub(super) estimator: Estimator,
    pub(super) commander: Commander,
    pub(super) navigator: Navigator,
    pub(super) params: Params,
    pub(super) param_service: param::Server,
    pub(super) streams: Streams,
    pub(super) missions: Server<Px4Rules>,
    pub(super) texts: Texts,
    pub(super) commands: VecDeque<Command>,
    pub(super) out: VecDeque<Outgoing>,
    pub(super) home: Option<Ned>,
    pub(super) home_at_us: u64,
    pub(super) landed: bool,
    pub(super) sticks: Sticks,
    pub(super) setpoint: Option<Setpoint>,
    pub(super) target: Ned,
    pub(super) charge: f64,
    pub(super) mission_state: MissionState,
    pub(super) counters: VehicleCounters,
    fence: Fence,
    plan_checked: bool,
    navigated: (Mode, bool),
    course: (Guidance, Heading),
    ticks: u64,
    carry: Duration,
    contact: f64,
    tuning: Tuning,
    reached: Option<(u16, u8)>,
    last_seq: usize,
}

impl Vehicle {
    /// Switched on, standing at home.
    pub fn new(config: Config) -> Self {
        let body = Body::new(&config);
        let rules = Px4Rules {
            airframe: match config.airframe {
                Airframe::Quad => ParamUse::RotaryWing,
                Airframe::Plane => ParamUse::FixedWing,
            },
        };
        let node = Node::new(config.system_id, COMPONENT);
        let mut params = Params::new();
        params.set(Param::MAV_SYS_ID, f64::from(config.system_id));
        if config.airframe == Airframe::Plane {
            params.set(Param::MAV_TYPE, 1.0);
        }
        let tuning = Tuning::read(config.airframe, &params);
        Self {
            frame: LocalFrame::new(config.home),
            body,
            estimator: Estimator::new(config.seed),
            commander: Commander::new(),
            navigator: Navigator::new(),
            param_service: param::Server::new(node, params.table()),
            params,
            streams: Streams::new(boot::FIRST_HEARTBEAT),
            missions: Server::new(node, Limits::PX4_SITL, rules),
            texts: Texts::new(),
            commands: VecDeque::new(),
            out: VecDeque::new(),
            home: None,
            home_at_us: 0,
            landed: true,
            sticks: Sticks::default(),
            setpoint: None,
            target: Ned::default(),
            charge: 1.0,
            mission_state: MissionState::MISSION_STATE_NO_MISSION,
            counters: VehicleCounters::default(),
            fence: Fence::default(),
            plan_checked: false,
            navigated: (Mode::Loiter, false),
            course: (Guidance::Ground, Heading::Hold),
            ticks: 0,
            carry: Duration::ZERO,
            contact: 0.0,
            tuning,
            reached: None,
            last_seq: 0,
            config,
        }
    }

    /// Component 1 of its system.
    pub fn node(&self) -> Node {
        Node::new(self.config.system_id, COMPONENT)
    }

    /// Lets time pass. Physics runs in steps of [`TICK`]; what is left over waits.
    pub fn step(&mut self, dt: Duration) {
        self.carry += dt;
        while self.carry >= TICK {
            self.carry -= TICK;
            self.tick();
        }
    }

    /// The next message to send.
    pub fn poll_transmit(&mut self) -> Option<Outgoing> {
        self.out.pop_front()
    }

    /// What is really so.
    pub fn truth(&self) -> Truth {
        let motion = self.body.motion();
        Truth {
            time: TICK * u32::try_from(self.ticks).unwrap_or(u32::MAX),
            place: self.frame.to_global(motion.position),
            position: motion.position,
            velocity: motion.velocity,
            attitude: motion.attitude,
            mode: self.commander.mode(),
            armed: self.commander.is_armed(),
            landed: self.landed,
            mission_seq: self.navigator.mission.index() as u16,
        }
    }

    /// What it has done with what it was told.
    pub fn counters(&self) -> VehicleCounters {
        self.counters
    }

    /// Time since boot, s.
    pub(super) fn now(&self) -> f64 {
        self.ticks as f64 * DT
    }

    pub(super) fn now_duration(&self) -> Duration {
        Duration::from_micros(self.ticks * TICK.as_micros() as u64)
    }

    /// Position as the estimator has it.
    pub(super) fn believed(&self) -> Ned {
        self.body.motion().position + self.estimator.position_error()
    }

    /// The estimator has a global position.
    pub(super) fn is_located(&self) -> bool {
        self.now() >= boot::FIRST_HEARTBEAT
    }

    pub(super) fn facts(&self) -> Facts<'_> {
        Facts {
            now: self.now(),
            landed: self.landed,
            mission_valid: self.navigator.mission.is_valid(),
            params: &self.params,
        }
    }

    /// Ids of mission, fence and rally plan.
    pub(super) fn plan_ids(&self) -> [u32; 3] {
        [
            MavMissionType::MAV_MISSION_TYPE_MISSION,
            MavMissionType::MAV_MISSION_TYPE_FENCE,
            MavMissionType::MAV_MISSION_TYPE_RALLY,
        ]
        .map(|kind| self.missions.opaque_id(kind))
    }

    /// Calls the navigator with a view of the vehicle.
    pub(super) fn navigate<T>(&mut self, call: impl FnOnce(&mut Navigator, &View<'_>) -> T) -> T {
        let motion = self.body.motion();
        let view = View {
            now: self.ticks as f64 * DT,
            position: motion.position + self.estimator.position_error(),
            velocity: motion.velocity,
            yaw: motion.attitude[2],
            landed: self.landed,
            home: self.home.unwrap_or_default(),
            frame: &self.frame,
            params: &self.params,
            airframe: self.config.airframe,
        };
        call(&mut self.navigator, &view)
    }

    pub(super) fn send(&mut self, message: MavMessage) {
        // An endless queue would be a leak where nobody polls.
        if self.out.len() < MAX_OUT {
            self.out.push_back(Outgoing::Message(message));
        }
    }

    /// Says a text of severity 2 that PX4 marks as an event's twin.
    pub(super) fn critical(&mut self, text: &str) {
        self.texts
            .say(MavSeverity::MAV_SEVERITY_CRITICAL, format!("{text}\t"));
    }

    pub(super) fn take_notes(&mut self, notes: Vec<Note>) {
        for note in notes {
            match note {
                Note::Info(text) => self.texts.say(MavSeverity::MAV_SEVERITY_INFO, text),
                Note::Critical(text) => self.texts.say(MavSeverity::MAV_SEVERITY_CRITICAL, text),
                Note::Reached(seq) => {
                    self.reached = Some((seq, 0));
                    self.send(MavMessage::MISSION_ITEM_REACHED(
                        MISSION_ITEM_REACHED_DATA { seq },
                    ));
                }
                Note::ReturnHome => {}
            }
        }
    }

    fn tick(&mut self) {
        self.ticks += 1;
        let now = self.now();
        if self.ticks.is_multiple_of(ESTIMATOR_EVERY) {
            self.estimator.step(DT * ESTIMATOR_EVERY as f64);
        }
        if self.home.is_none() && now >= boot::HOME {
            self.set_home();
        }
        if self.ticks.is_multiple_of(COMMANDS_EVERY) {
            while let Some(command) = self.commands.pop_front() {
                self.execute(&command);
            }
        }
        self.command();
        self.fly(now);
        self.detect_ground(now);
        self.serve();
        self.report_due(now);
    }

    /// Home is where the vehicle believes to be.
    pub(super) fn set_home(&mut self) {
        self.home = Some(self.believed());
        self.home_at_us = self.boot_us();
        self.plan_checked = false;
    }

    fn command(&mut self) {
        let mut notes = Vec::new();
        let was_armed = self.commander.is_armed();
        let mut commander = std::mem::take(&mut self.commander);
        commander.step(&self.facts(), &mut notes);
        self.commander = commander;
        if was_armed != self.commander.is_armed() {
            self.charge = self.charge.max(0.5);
        }
        self.take_notes(notes);
    }

    fn fly(&mut self, now: f64) {
        let (mode, armed) = (self.commander.mode(), self.commander.is_armed());
        if armed {
            self.charge = (self.charge - DT / 1500.0).max(0.5);
        }
        if self.ticks.is_multiple_of(NAVIGATE_EVERY) || self.navigated != (mode, armed) {
            self.navigated = (mode, armed);
            let step = self.navigate(|navigator, view| navigator.step(mode, armed, view));
            if let Some(next) = step.then {
                self.commander.hand_over(next);
            }
            self.take_notes(step.notes);
            self.course = (step.guidance, step.heading);
        }
        let spooling = now - self.commander.armed_at() < self.params.get(Param::COM_SPOOLUP_TIME);
        let (guidance, heading) = if !armed || spooling && self.landed {
            (Guidance::Ground, Heading::Hold)
        } else {
            self.steer(mode).unwrap_or(self.course)
        };
        self.target = match &guidance {
            Guidance::Leg(leg) | Guidance::Climb(leg) | Guidance::Land(leg) => leg.target,
            Guidance::Circle { centre, .. } => *centre,
            Guidance::Ground | Guidance::Steer { .. } => self.body.setpoint().position,
        };
        let error = self.estimator.position_error();
        self.body.step(DT, &guidance, &heading, error, &self.tuning);
        let sinking = matches!(guidance, Guidance::Land(_) | Guidance::Ground)
            || matches!(guidance, Guidance::Steer { .. } if self.body.setpoint().velocity.d > 0.05);
        let touching = self.body.motion().position.d >= -0.001;
        self.contact = if touching && sinking {
            self.contact + DT
        } else {
            0.0
        };
    }

    /// The modes that are steered from outside.
    fn steer(&self, mode: Mode) -> Option<(Guidance, Heading)> {
        let ground = Some((Guidance::Ground, Heading::Hold));
        let yaw = self.body.motion().attitude[2];
        match mode {
            Mode::PosCtl | Mode::AltCtl => {
                if self.landed && !self.sticks.wants_up() {
                    return ground;
                }
                Some(self.sticks.guidance(yaw, &self.params))
            }
            Mode::Offboard => {
                let setpoint = self.setpoint?;
                if self.landed && !setpoint.wants_up(self.believed().d) {
                    return ground;
                }
                Some(setpoint.guidance())
            }
            Mode::Termination => ground,
            _ => None,
        }
    }

    fn detect_ground(&mut self, now: f64) {
        let motion = self.body.motion();
        let landed = if self.landed {
            motion.position.d > -LIFTED_M
        } else {
            let still = match self.config.airframe {
                Airframe::Quad => true,
                Airframe::Plane => motion.velocity.horizontal() < 1.0,
            };
            self.contact >= LANDED_AFTER_S && still
        };
        if landed != self.landed {
            self.landed = landed;
            let mut notes = Vec::new();
            self.commander.landed(landed, now, &mut notes);
            self.take_notes(notes);
        }
    }

    fn serve(&mut self) {
        let now = self.now_duration();
        if self.missions.poll_timeout().is_some_and(|at| at <= now) {
            self.missions.handle_timeout(now);
        }
        if !self.plan_checked && self.home.is_some() {
            self.plan_checked = true;
            self.check_plan();
        }
        let current =
            (self.navigator.mission.count() > 0).then(|| self.navigator.mission.index() as u16);
        self.missions.set_current(current);
        self.drain_services();
        if self
            .param_service
            .poll_timeout()
            .is_some_and(|at| at <= now)
        {
            self.param_service.handle_timeout(now);
        }
    }

    /// Takes what the mission server has to send and to say.
    pub(super) fn drain_services(&mut self) {
        while let Some(message) = self.missions.poll_transmit() {
            self.send(message);
        }
        while let Some(event) = self.missions.poll_event() {
            self.take_event(event);
        }
        while let Some(message) = self.param_service.poll_transmit() {
            self.send(message);
        }
        while let Some(param::ServerEvent::Set { name, value }) = self.param_service.poll_event() {
            self.params.store(name, value);
            self.tuning = Tuning::read(self.config.airframe, &self.params);
        }
    }

    fn take_event(&mut self, event: ServerEvent) {
        let active = self.commander.is_armed() && self.commander.mode() == Mode::Mission;
        match event {
            ServerEvent::Text(text) => self.texts.say(MavSeverity::MAV_SEVERITY_CRITICAL, text),
            ServerEvent::CurrentSet(seq) => {
                let (_, notes) =
                    self.navigate(|nav, view| nav.mission.select(usize::from(seq), active, view));
                self.take_notes(notes);
            }
            ServerEvent::Stored {
                kind: MavMissionType::MAV_MISSION_TYPE_MISSION,
                start,
                ..
            } => {
                self.counters.plans_stored += 1;
                let items = self
                    .missions
                    .items(MavMissionType::MAV_MISSION_TYPE_MISSION)
                    .to_vec();
                let start = start.map(usize::from);
                let notes =
                    self.navigate(|nav, view| nav.mission.replace(items, start, active, view));
                self.reached = None;
                self.plan_checked = false;
                self.take_notes(notes);
            }
            ServerEvent::Stored { kind, .. } => {
                self.counters.plans_stored += 1;
                if kind == MavMissionType::MAV_MISSION_TYPE_FENCE {
                    self.fence = Fence::new(self.missions.items(kind), &self.frame);
                    self.plan_checked = false;
                }
            }
        }
    }

    /// What little PX4 checks of a plan, once it has a home.
    fn check_plan(&mut self) {
        let fence = self.fence.clone();
        let notes = self.navigate(|nav, view| {
            let mut notes = Vec::new();
            nav.mission.check(view, &mut notes);
            let outside = nav
                .mission
                .places(view)
                .find(|(_, at)| !fence.allows(*at))
                .map(|(i, _)| i);
            if let Some(index) = outside {
                notes.push(
                    nav.mission
                        .reject(format!("Geofence violation for waypoint {}\t", index + 1)),
                );
            }
            notes
        });
        self.take_notes(notes);
    }

    fn report_due(&mut self, now: f64) {
        let mut due = Vec::new();
        self.streams.poll(now, |id| due.push(id));
        let seq = self.navigator.mission.index();
        if seq != self.last_seq && !due.contains(&id::MISSION_CURRENT) && self.is_located() {
            due.push(id::MISSION_CURRENT);
        }
        self.last_seq = seq;
        for message in due {
            if message == id::MISSION_CURRENT {
                self.update_mission_state();
            }
            if let Some(report) = self.report(message) {
                self.send(report);
            }
            if message == id::MISSION_CURRENT {
                self.repeat_reached();
            }
        }
        let mut said = Vec::new();
        if self.is_located() {
            self.texts.poll(now, |text| said.push(text));
        }
        for text in said {
            self.send(text);
        }
    }

    /// MISSION_CURRENT.mission_state by PX4's own rules, the case that they forget included: then
    /// the state stays what it was.
    fn update_mission_state(&mut self) {
        let mission = &self.navigator.mission;
        let active = mission_mode_active(self.commander.mode());
        self.mission_state = if !mission.is_valid() {
            MissionState::MISSION_STATE_NO_MISSION
        } else if mission.is_finished() {
            MissionState::MISSION_STATE_COMPLETE
        } else if active {
            MissionState::MISSION_STATE_ACTIVE
        } else if mission.reached().is_some() {
            MissionState::MISSION_STATE_PAUSED
        } else if mission.index() < 1 {
            MissionState::MISSION_STATE_NOT_STARTED
        } else {
            return;
        };
    }

    fn repeat_reached(&mut self) {
        let Some((seq, sent)) = &mut self.reached else {
            return;
        };
        if *sent < REACHED_REPEATS && self.navigator.mission.count() > 0 {
            *sent += 1;
            let seq = *seq;
            self.send(MavMessage::MISSION_ITEM_REACHED(
                MISSION_ITEM_REACHED_DATA { seq },
            ));
        }
    }

    /// The parameters' values.
    pub fn params(&self) -> &Params {
        &self.params
    }
}

/// Step of physics and control: 250 Hz.
pub const TICK: Duration = Duration::from_millis(4);
const DT: f64 = 0.004;
const ESTIMATOR_EVERY: u64 = 10;
/// The commander looks at its commands every 8 ms.
const COMMANDS_EVERY: u64 = 2;
/// The navigator looks at the position at about 20 Hz, so that a fast vehicle can pass a small
/// radius between two looks.
const NAVIGATE_EVERY: u64 = 13;
const COMPONENT: u8 = 1;
const MAX_OUT: usize = 4096;
const LIFTED_M: f64 = 0.05;
const LANDED_AFTER_S: f64 = 0.8;
const REACHED_REPEATS: u8 = 10;
