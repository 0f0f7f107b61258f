//! One simulated PX4, without socket or clock: messages in, time in, messages out.

use std::collections::VecDeque;
use std::time::Duration;

use mavlink::dialects::development::{
    MISSION_ITEM_REACHED_DATA, MavMessage, MavMissionType, MavSeverity, MissionState,
};
use mavlink_link::service::Node;
use mavlink_link::service::mission::Item;

use super::body::{Body, Tuning};
use super::command::Command;
use super::commander::{Commander, Facts, boot};
use super::config::{Airframe, Config};
use super::estimator::Estimator;
use super::fence::Fence;
use super::geo::{Geodetic, LocalFrame, Ned};
use super::guidance::{Guidance, Heading};
use super::mode::Mode;
use super::navigator::Navigator;
use super::operator::Operator;
use super::params::{Param, Params};
use super::services::mission::{Limits, Server};
use super::services::mission_rules::{Airframe as ParamUse, Px4Rules};
use super::services::param;
use super::steering::{Setpoint, Sticks};
use super::streams::Streams;
use super::texts::Texts;
use super::view::{Note, View};

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

/// What is wrong with a vehicle, for tests of what is said of it. It flies on as if nothing were.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct HealthFaults {
    /// Bits of MAV_SYS_STATUS_SENSOR that SYS_STATUS tells as used and not well.
    pub unhealthy: u32,
    /// Bits of ESTIMATOR_STATUS.flags that are the other way round.
    pub estimator: u16,
    /// Per cent that the battery tells.
    pub battery: Option<u8>,
    /// The mode entered, once, in place of the next one that DO_SET_MODE names and that is accepted: a take-off that ends
    /// in that moment puts PX4 into AUTO.LOITER.
    pub instead: Option<Mode>,
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
    pub(super) fence: Fence,
    pub(super) plan_checked: bool,
    pub(super) navigated: (Mode, bool),
    pub(super) course: (Guidance, Heading),
    pub(super) ticks: u64,
    carry: Duration,
    pub(super) contact: f64,
    pub(super) tuning: Tuning,
    pub(super) reached: Option<(u16, u8)>,
    pub(super) last_seq: usize,
    pub(super) health_faults: HealthFaults,
    pub(super) operator: Operator,
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
        for (param, value) in &config.params {
            params.set(*param, *value);
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
            health_faults: HealthFaults::default(),
            operator: Operator::default(),
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

    /// The items of a plan that it holds.
    pub fn plan(&self, kind: MavMissionType) -> &[Item] {
        self.missions.items(kind)
    }

    /// Makes it ail, or well again.
    pub fn ail(&mut self, health_faults: HealthFaults) {
        self.health_faults = health_faults;
    }

    /// The parameters' values.
    pub fn params(&self) -> &Params {
        &self.params
    }
}

/// Step of physics and control: 250 Hz.
pub const TICK: Duration = Duration::from_millis(4);
pub(super) const DT: f64 = 0.004;
const COMPONENT: u8 = 1;
const MAX_OUT: usize = 4096;
