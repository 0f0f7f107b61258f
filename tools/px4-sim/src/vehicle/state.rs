//! One simulated PX4, without socket or clock: messages in, time in, messages out.

use std::collections::VecDeque;
use std::time::Duration;

use mavlink::dialects::development::{
    MISSION_ITEM_REACHED_DATA, MavMessage, MavMissionType, MavSeverity, MissionState,
};
use mavlink_link::service::Node;
use mavlink_link::service::mission::Item;

use super::actions::Actions;
use super::command::Command;
use super::ground::GroundGrid;
use super::operator::OperatorControl;
use crate::config::{Airframe, Config, Param, Params};
use crate::flight::commander::{Commander, Facts, boot};
use crate::flight::items::Fence;
use crate::flight::mode::Mode;
use crate::flight::navigator::Navigator;
use crate::flight::steering::{Movement, Setpoint, Sticks};
use crate::flight::view::{Note, View};
use crate::payload::gimbal::Carrier;
use crate::payload::{FromComponent, PayloadTruth, Payloads};
use crate::physics::airframe::{Body, Tuning};
use crate::physics::motion::{Geodetic, LocalFrame, Ned};
use crate::physics::noise::Estimator;
use crate::physics::trajectory::{Guidance, Heading};
use crate::physics::vtol::VtolState;
use crate::services::files::Files;
use crate::services::ftp;
use crate::services::metadata;
use crate::services::mission::{KINDS, Limits, Server};
use crate::services::mission_rules::{Airframe as ParamUse, Px4Rules};
use crate::services::param;
use crate::services::streams::Streams;
use crate::services::texts::Texts;

/// Something to send, from component 1 of the vehicle where no other is named.
#[derive(Debug, Clone, PartialEq)]
#[allow(
    clippy::large_enum_variant,
    reason = "nearly all are messages, none stays long"
)]
pub enum Outgoing {
    /// A message of the dialect.
    Message(MavMessage),
    /// A message of another component of the vehicle: a gimbal or a camera.
    Component(u8, MavMessage),
    /// A message with an enum value that the dialect's structs do not have.
    Raw {
        /// Message id.
        id: u32,
        /// Payload, not trimmed.
        payload: Vec<u8>,
    },
}

impl Outgoing {
    /// The message, where the dialect has one.
    pub fn message(&self) -> Option<&MavMessage> {
        match self {
            Self::Message(message) | Self::Component(_, message) => Some(message),
            Self::Raw { .. } => None,
        }
    }
}

/// The true state, for tests and pictures; the messages carry the vehicle's own estimate, which is slightly off.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Truth {
    /// Since boot.
    pub time: Duration,
    /// Where it is; altitude AMSL.
    pub place: Geodetic,
    /// The estimated place, which it reports.
    pub believed: Geodetic,
    /// The same as `place` in the local frame of the place of boot, m.
    pub position: Ned,
    /// Velocity over ground, m/s.
    pub velocity: Ned,
    /// Roll, pitch, yaw, radians; yaw from true north.
    pub attitude: [f64; 3],
    /// The flown mode.
    pub mode: Mode,
    /// Motors enabled.
    pub armed: bool,
    /// On the ground.
    pub landed: bool,
    /// MISSION_CURRENT.seq.
    pub mission_seq: u16,
    /// How a VTOL flies; `None` for another airframe.
    pub vtol: Option<VtolState>,
}

/// Faults of a vehicle, for tests of alerts. All but `instead`, `quad_chute` and `low_m` are only reported, and do
/// not affect its flight.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct HealthFaults {
    /// Bits of MAV_SYS_STATUS_SENSOR that SYS_STATUS reports as enabled and unhealthy.
    pub unhealthy: u32,
    /// Bits of ESTIMATOR_STATUS.flags that are inverted.
    pub estimator: u16,
    /// Battery charge reported, per cent.
    pub battery: Option<u8>,
    /// The mode entered, once, instead of the next one that DO_SET_MODE names and that is accepted: a take-off that
    /// ends at that moment puts PX4 into AUTO.LOITER.
    pub instead: Option<Mode>,
    /// The wings fail: once on them, or in transition to them, the vehicle leaves them (quad-chute).
    pub quad_chute: bool,
    /// What is wrong with its answers to TIMESYNC.
    pub clock: ClockFault,
    /// In AUTO.MISSION it flies this much below its items, m, like a wing whose altitude reference is wrong.
    pub low_m: u16,
}

/// How a vehicle answers TIMESYNC.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub enum ClockFault {
    /// As PX4 does.
    #[default]
    None,
    /// Not at all.
    Silent,
    /// With a clock that is this far ahead of that of its messages, ms.
    AheadMs(i32),
}

/// What the vehicle has done with the received commands and plans.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct VehicleCounters {
    /// Commands answered by ACCEPTED.
    pub commands_accepted: u64,
    /// Commands answered by another result.
    pub commands_refused: u64,
    /// Commands lost because too many came at once.
    pub commands_lost: u64,
    /// Commands for another target, or that PX4 leaves unanswered.
    pub commands_ignored: u64,
    /// Plans stored.
    pub plans_stored: u64,
    /// Parameters set, to another value or the same.
    pub parameters_set: u64,
}

/// A simulated PX4 v1.18.
#[derive(Debug)]
pub struct Vehicle {
    pub(crate) config: Config,
    pub(crate) frame: LocalFrame,
    pub(crate) body: Body,
    pub(crate) estimator: Estimator,
    pub(crate) commander: Commander,
    pub(crate) navigator: Navigator,
    pub(crate) params: Params,
    pub(crate) param_service: param::Server,
    pub(crate) ftp: ftp::Server,
    pub(crate) streams: Streams,
    pub(crate) missions: Server<Px4Rules>,
    pub(crate) texts: Texts,
    pub(crate) commands: VecDeque<Command>,
    pub(crate) out: VecDeque<Outgoing>,
    pub(crate) home: Option<Ned>,
    pub(crate) home_at_us: u64,
    pub(crate) landed: bool,
    pub(crate) sticks: Sticks,
    pub(crate) movement: Movement,
    pub(crate) setpoint: Option<Setpoint>,
    pub(crate) target: Ned,
    pub(crate) charge: f64,
    pub(crate) mission_state: MissionState,
    pub(crate) counters: VehicleCounters,
    pub(crate) fence: Fence,
    /// The id of the fence that the navigator reads or has read.
    pub(crate) fence_id: u32,
    /// When it has read it.
    pub(crate) fence_read_at: Duration,
    pub(crate) fence_unread: bool,
    pub(crate) plan_checked: bool,
    pub(crate) navigated: (Mode, bool),
    pub(crate) course: (Guidance, Heading),
    pub(crate) ticks: u64,
    pub(crate) carry: Duration,
    pub(crate) contact: f64,
    pub(crate) tuning: Tuning,
    pub(crate) reached: Option<(u16, u8)>,
    pub(crate) last_seq: usize,
    pub(crate) health_faults: HealthFaults,
    pub(crate) operator: OperatorControl,
    pub(crate) ground: Option<GroundGrid>,
    pub(crate) payloads: Payloads,
    /// When the navigator centres the gimbal.
    pub(crate) gimbal_centred_at: Option<f64>,
    pub(crate) actions: Actions,
}

impl Vehicle {
    /// Switched on, on the ground at home.
    pub fn new(config: Config) -> Self {
        let body = Body::new(&config);
        let rules = Px4Rules {
            airframe: match config.airframe {
                Airframe::Quad => ParamUse::RotaryWing,
                Airframe::Plane => ParamUse::FixedWing,
                Airframe::Vtol => ParamUse::Vtol,
            },
        };
        let node = Node::new(config.system_id, COMPONENT);
        let mut params = Params::default();
        params.set(Param::MAV_SYS_ID, f64::from(config.system_id));
        for (param, value) in config.airframe.defaults().iter().chain(&config.params) {
            params.set(*param, *value);
        }
        let mut files = config.files.clone();
        if config.events {
            for (path, content) in metadata::files(params.table()) {
                if files.get(path).is_none() {
                    files.insert(path, content);
                }
            }
        }
        let tuning = Tuning::read(config.airframe, &params);
        Self {
            frame: LocalFrame::new(config.home),
            body,
            estimator: Estimator::new(config.seed),
            commander: Commander::default(),
            navigator: Navigator::default(),
            param_service: param::Server::new(node, params.table()),
            ftp: ftp::Server::new(node, files),
            params,
            streams: Streams::new(boot::FIRST_HEARTBEAT),
            missions: Server::new(node, Limits::PX4_SITL, rules),
            texts: Texts::new(config.events),
            commands: VecDeque::new(),
            out: VecDeque::new(),
            home: None,
            home_at_us: 0,
            landed: true,
            sticks: Sticks::default(),
            movement: Movement::default(),
            setpoint: None,
            target: Ned::default(),
            charge: 1.0,
            mission_state: MissionState::MISSION_STATE_NO_MISSION,
            counters: VehicleCounters::default(),
            fence: Fence::default(),
            fence_id: 0,
            fence_read_at: Duration::ZERO,
            fence_unread: false,
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
            ground: None,
            payloads: Payloads::new(&config),
            gimbal_centred_at: None,
            actions: Actions::default(),
            operator: OperatorControl::new(config.operator_control, config.system_id),
            config,
        }
    }

    /// Component 1 of its system.
    pub fn node(&self) -> Node {
        Node::new(self.config.system_id, COMPONENT)
    }

    /// The next message to send.
    pub fn poll_transmit(&mut self) -> Option<Outgoing> {
        self.out.pop_front()
    }

    /// The true state.
    pub fn truth(&self) -> Truth {
        let motion = self.body.motion();
        Truth {
            time: TICK * u32::try_from(self.ticks).unwrap_or(u32::MAX),
            place: self.frame.to_global(motion.position),
            believed: self.believed_place(),
            position: motion.position,
            velocity: motion.velocity,
            attitude: motion.attitude,
            mode: self.commander.mode(),
            armed: self.commander.is_armed(),
            landed: self.landed,
            mission_seq: self.navigator.mission.index() as u16,
            vtol: self.body.vtol(),
        }
    }

    /// The true state of its payloads, station 1 first.
    pub fn payloads(&self) -> Vec<PayloadTruth> {
        self.payloads.truth(&self.carrier())
    }

    /// Sets the storage that the camera of a station, from 0, has left, MiB.
    pub fn set_storage(&mut self, station: usize, left_mib: f64) {
        self.payloads.set_storage(station, left_mib);
    }

    /// The vehicle's state as its payloads use it.
    pub(crate) fn carrier(&self) -> Carrier {
        let motion = self.body.motion();
        Carrier {
            attitude: motion.attitude,
            position: motion.position,
            frame: self.frame,
            now: self.now(),
        }
    }

    pub(crate) fn send_of_components(&mut self, messages: Vec<FromComponent>) {
        for (component, message) in messages {
            if self.out.len() < MAX_OUT {
                self.out.push_back(Outgoing::Component(component, message));
            }
        }
    }

    /// What it has done with the commands and plans it received.
    pub fn counters(&self) -> VehicleCounters {
        self.counters
    }

    /// Time since boot, s.
    pub(crate) fn now(&self) -> f64 {
        self.ticks as f64 * DT
    }

    pub(crate) fn now_duration(&self) -> Duration {
        Duration::from_micros(self.ticks * TICK.as_micros() as u64)
    }

    /// The estimated position.
    pub(crate) fn believed(&self) -> Ned {
        self.body.motion().position + self.estimator.position_error()
    }

    /// Whether the estimator has a global position.
    pub(crate) fn is_located(&self) -> bool {
        self.now() >= boot::FIRST_HEARTBEAT
    }

    pub(crate) fn facts(&self) -> Facts<'_> {
        Facts {
            now: self.now(),
            landed: self.landed,
            mission_valid: self.navigator.mission.is_valid(),
            params: &self.params,
        }
    }

    /// Ids of mission, fence and rally plan.
    pub(crate) fn plan_ids(&self) -> [u32; 3] {
        KINDS.map(|kind| self.missions.opaque_id(kind))
    }

    /// Sets home to the estimated position.
    pub(crate) fn set_home(&mut self) {
        self.home = Some(self.believed());
        self.home_at_us = self.boot_us();
        self.plan_checked = false;
    }

    /// Calls the navigator with a view of the vehicle, and carries out its notes.
    pub(crate) fn navigate<T>(
        &mut self,
        call: impl FnOnce(&mut Navigator, &View<'_>, &mut Vec<Note>) -> T,
    ) -> T {
        let mut notes = Vec::new();
        let motion = self.body.motion();
        let view = View {
            now: self.now(),
            position: self.believed(),
            velocity: motion.velocity,
            yaw: motion.attitude[2],
            landed: self.landed,
            home: self.home_or_zero(),
            frame: &self.frame,
            params: &self.params,
            airframe: self.body.flown_as(),
            kind: self.config.airframe,
            vtol: self.body.vtol(),
        };
        let done = call(&mut self.navigator, &view, &mut notes);
        self.take_notes(notes);
        done
    }

    /// Calls the commander with the facts on which it decides, and carries out its notes.
    pub(crate) fn decide<T>(
        &mut self,
        call: impl FnOnce(&mut Commander, &Facts<'_>, &mut Vec<Note>) -> T,
    ) -> T {
        let mut notes = Vec::new();
        let mut commander = std::mem::take(&mut self.commander);
        let decided = call(&mut commander, &self.facts(), &mut notes);
        self.commander = commander;
        self.take_notes(notes);
        decided
    }

    pub(crate) fn send(&mut self, message: MavMessage) {
        // Bounded, because a test may step a vehicle without ever polling it.
        if self.out.len() < MAX_OUT {
            self.out.push_back(Outgoing::Message(message));
        }
    }

    pub(crate) fn send_reached(&mut self, seq: u16) {
        let reached = MISSION_ITEM_REACHED_DATA { seq };
        self.send(MavMessage::MISSION_ITEM_REACHED(reached));
    }

    /// Queues a text of severity 2 with the tab by which PX4 marks the legacy copy of an event.
    pub(crate) fn critical(&mut self, text: &str) {
        self.texts
            .queue(MavSeverity::MAV_SEVERITY_CRITICAL, format!("{text}\t"));
    }

    fn take_notes(&mut self, notes: Vec<Note>) {
        for note in notes {
            match note {
                Note::Info(text) => self.texts.queue(MavSeverity::MAV_SEVERITY_INFO, text),
                Note::Critical(text) => self.texts.queue(MavSeverity::MAV_SEVERITY_CRITICAL, text),
                Note::Reached(seq) => {
                    self.reached = Some((seq, 0));
                    self.send_reached(seq);
                }
                Note::ReturnHome => {}
                Note::CentreGimbal => {
                    let soon = self.now() + CENTRED_AFTER_S;
                    self.gimbal_centred_at.get_or_insert(soon);
                }
                Note::Action(item) => {
                    let (now, here) = (self.now(), self.body.motion().position);
                    let before = self.actions.triggers;
                    self.actions.take(&item, now, here);
                    self.trigger_cameras_since(before);
                    self.order_by_item(&item);
                }
                Note::Transition { to_wings } => self.body.turn(to_wings),
            }
        }
    }

    /// The stored items of a plan.
    pub fn plan(&self, kind: MavMissionType) -> &[Item] {
        self.missions.items(kind)
    }

    /// Records an event by its name in PX4's source, with its external level and packed arguments; it is sent with the next
    /// step.
    pub fn report_event(&mut self, name: &str, level: u8, arguments: &[u8]) {
        self.texts.events.record(name, level, arguments);
    }

    /// The next `count` events are recorded, but not sent before somebody requests them.
    pub fn lose_events(&mut self, count: usize) {
        self.texts.events.lose = count;
    }

    /// Sets the faults; the default is none.
    pub fn set_health_faults(&mut self, health_faults: HealthFaults) {
        if health_faults.estimator != self.health_faults.estimator {
            self.texts
                .events
                .report_checks(health_faults.estimator != 0);
        }
        self.health_faults = health_faults;
    }

    /// Requests the ground north-east of its home from now on, with heights this far apart, m.
    pub fn ask_for_ground(&mut self, spacing_m: u16) {
        let grid = GroundGrid::new(self.config.home, spacing_m, self.now());
        self.ground = Some(grid);
    }

    /// The received part of the ground.
    pub fn ground(&self) -> Option<&GroundGrid> {
        self.ground.as_ref()
    }

    /// The files of its card.
    pub fn files(&self) -> &Files {
        self.ftp.files()
    }

    /// The files of its card, to change them from outside, as a logger does.
    pub fn files_mut(&mut self) -> &mut Files {
        self.ftp.files_mut()
    }

    /// What mission items have done with its payload.
    pub fn actions(&self) -> &Actions {
        &self.actions
    }

    /// The parameters' values.
    pub fn params(&self) -> &Params {
        &self.params
    }
}

/// Step of physics and control: 250 Hz.
pub const TICK: Duration = Duration::from_millis(4);
/// [`TICK`] in seconds.
pub(crate) const DT: f64 = 0.004;
/// MAV_COMP_ID_AUTOPILOT1.
const COMPONENT: u8 = 1;
/// Navigator::neutralize_gimbal_if_control_activated
const CENTRED_AFTER_S: f64 = 0.25;
/// Messages that wait at most.
const MAX_OUT: usize = 4096;
