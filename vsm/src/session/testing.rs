//! What a machine is tested with: everything that its [`Context`] and its [`Effects`] borrow, without the other machines.

use std::collections::VecDeque;
use std::path::Path;
use std::time::Duration;

use mapping::altitude::Altimeter;
use mapping::area::Areas;
use mapping::mode::Px4Mode;
use mapping::parameter::Parameters;
use mapping::plan::Plan;
use mapping::report::Commanded;
use mapping::telemetry::{Attitude, LandedState, Place};
use mavlink_link::Now;
use mavlink_link::dialect::{COMMAND_ACK_DATA, MavCmd, MavMessage, MavResult, MavType};
use mavlink_link::service::{Node, command};
use mavlink_link::store::{Disk, MemoryDisk};
use stanag_msgs::enums::AckType;
use stanag_msgs::messages::LoiterConfiguration;
use stanag_msgs::{Id, Message, TimeStamp};

use super::alerts::Alerts;
use super::authority::rules::Authority;
use super::context::{
    Bounds, Context, FlightView, MissionView, Origin, ParameterView, Settings, TerminationView,
    Transfer,
};
use super::counters::Counters;
use super::duplicates::Remembered;
use super::effects::{DliEffects, Effects, Request};
use super::limits::Limits;
use super::link::services::Services;
use super::link::state::VehicleState;
use super::log::LogEntry;
use super::logical::LogicalIds;
use super::mission::progress::RouteProgress;
use super::mission::record::UploadedMission;
use super::outbox::Outbox;
use super::paths::Paths;
use super::station::GroundStation;
use super::store::Boot;
use crate::config::{self, Config};

pub(crate) const VSM: Id = Id(0x1b00_0001);
/// Station 0. Station 1 has the next id.
pub(crate) const CUCS: Id = Id(0x1b00_00a0);
pub(crate) const VEHICLE: Id = Id(0x1b00_0101);

/// A vehicle that is live, with two stations; both listen, and the first controls.
pub(crate) struct World {
    pub(crate) now: Now,
    pub(crate) boot: Option<Boot>,
    pub(crate) config: config::Vehicle,
    pub(crate) settings: Settings,
    pub(crate) bounds: Bounds,
    pub(crate) stations: Vec<GroundStation>,
    pub(crate) controller: Option<Id>,
    pub(crate) vehicle: VehicleState,
    pub(crate) services: Services,
    pub(crate) alerts: Alerts,
    pub(crate) listeners: Vec<usize>,
    pub(crate) requests: VecDeque<Request>,
    pub(crate) counters: Counters,
    pub(crate) log: VecDeque<LogEntry>,
    pub(crate) disk: Box<dyn Disk>,
    pub(crate) parameters: Parameters,
    pub(crate) rights: Authority,
    pub(crate) loiter: LoiterConfiguration,
    /// A maneuver is in progress.
    pub(crate) maneuver: bool,
    pub(crate) plan: Plan,
    /// The mission that the vehicle carries.
    pub(crate) uploaded: Option<UploadedMission>,
    /// It finds that infeasible.
    pub(crate) infeasible: bool,
    pub(crate) transfer: Transfer,
    pub(crate) areas: Areas,
    pub(crate) termination: TerminationView,
    logical: LogicalIds,
    progress: RouteProgress,
    remembered: Vec<Remembered>,
    vsm_alerts: Alerts,
    outbox: Outbox,
    paths: Paths,
}

/// What the other machines show.
pub(crate) struct Views<'a> {
    pub(crate) mission: MissionView<'a>,
    pub(crate) flight: FlightView<'a>,
    pub(crate) parameters: ParameterView<'a>,
    pub(crate) rights: &'a Authority,
}

impl World {
    pub(crate) fn new() -> World {
        let text = r#"
            [dli]
            vsm_id = "1b:00:00:01"
            listen = "127.0.0.1:4586"
            [[cucs]]
            id = "1b:00:00:a0"
            loi = [2, 3, 4, 5]
            [[cucs]]
            id = "1b:00:00:a1"
            loi = [2, 3, 4, 5]
            [[vehicle]]
            id = "1b:00:01:01"
            link = "udpin:127.0.0.1:14550"
            system_id = 1
            signing = "off"
            [store]
            dir = "state"
        "#;
        let config = Config::parse(text, Path::new(".")).expect("a configuration");
        let vehicle = config.vehicle[0].get_ref().clone();
        let stations: Vec<GroundStation> = (config.cucs.iter().zip(40_000_u16..))
            .map(|(cucs, port)| {
                let mut station = GroundStation::new(cucs.get_ref().clone(), &config.dli);
                station.peer = Some(([127, 0, 0, 1], port).into());
                station
            })
            .collect();
        let mut state = VehicleState::default();
        state.set_live();
        World {
            now: Now {
                mono: Duration::from_secs(100),
                wall: Duration::from_secs(1_795_219_200),
            },
            boot: Some(Boot {
                id: 1,
                zero: Duration::ZERO,
            }),
            bounds: Bounds::of(&vehicle),
            config: vehicle,
            settings: Settings {
                authority: *config.authority.get_ref(),
                web_page: None,
            },
            controller: Some(CUCS),
            vehicle: state,
            services: Services::new(Node::new(245, 190), Node::new(1, 1), None),
            alerts: Alerts::new(1),
            listeners: (0..stations.len()).collect(),
            requests: VecDeque::new(),
            counters: Counters::default(),
            log: VecDeque::new(),
            disk: Box::new(MemoryDisk::default()),
            parameters: Parameters::default(),
            rights: Authority::default(),
            loiter: LoiterConfiguration::default(),
            maneuver: false,
            plan: Plan::default(),
            uploaded: None,
            infeasible: false,
            transfer: Transfer::None,
            areas: Areas::default(),
            termination: TerminationView::default(),
            logical: LogicalIds::default(),
            progress: RouteProgress::default(),
            remembered: stations.iter().map(|_| Remembered::default()).collect(),
            vsm_alerts: Alerts::new(0),
            outbox: Outbox::default(),
            // Nothing is held back: what a machine sends is what is seen.
            paths: Paths::new(Limits::of(&config.dli), std::iter::empty()),
            stations,
        }
    }

    /// The same with a multicopter in the air, 20 m above home, in this mode.
    pub(crate) fn airborne(mode: Px4Mode) -> World {
        let mut world = World::new();
        let home = Place {
            latitude: 47.0,
            longitude: 8.0,
            amsl_m: 400.0,
        };
        let telemetry = &mut world.vehicle.telemetry;
        telemetry.vehicle_type = Some(MavType::MAV_TYPE_QUADROTOR);
        telemetry.landed = Some(LandedState::InAir);
        telemetry.armed = Some(true);
        telemetry.home = Some(home);
        telemetry.position = Some(Place {
            amsl_m: 420.0,
            ..home
        });
        telemetry.target = telemetry.position;
        telemetry.velocity_ned = Some([3.0, 0.0, 0.0]);
        telemetry.attitude = Some(Attitude {
            roll: 0.0,
            pitch: 0.0,
            yaw: 0.0,
            roll_rate: 0.0,
            pitch_rate: 0.0,
            yaw_rate: 0.0,
        });
        world.show_mode(mode);
        world
    }

    /// The vehicle reports this mode, by a message made after the last command.
    pub(crate) fn show_mode(&mut self, mode: Px4Mode) {
        self.vehicle.show_mode(self.now.mono, mode);
    }

    /// The vehicle was sent a command that may change its mode, and has reported none since.
    pub(crate) fn command_was_sent(&mut self) {
        self.vehicle.command_was_sent();
    }

    /// From now on nothing can be written.
    pub(crate) fn fill_disk(&mut self) {
        self.disk = Box::new(MemoryDisk {
            full: Some(""),
            ..MemoryDisk::default()
        });
    }

    /// The modes of PX4 that the vehicle was commanded to enter since the last look; other commands are dropped.
    pub(crate) fn commanded_modes(&mut self) -> Vec<Px4Mode> {
        let mut modes = Vec::new();
        while let Some(message) = self.services.commands.poll_transmit() {
            if let MavMessage::COMMAND_LONG(command) = message
                && command.command == MavCmd::MAV_CMD_DO_SET_MODE
            {
                let (main, sub) = (command.param2 as u32, command.param3 as u32);
                modes.push(Px4Mode(main << 16 | sub << 24));
            }
        }
        modes
    }

    /// The vehicle answers the command that it was sent last. Returns how the commands that have ended did.
    pub(crate) fn answer(&mut self, command: MavCmd, result: MavResult) -> Vec<command::Event> {
        let commands = &mut self.services.commands;
        let ack = MavMessage::COMMAND_ACK(COMMAND_ACK_DATA {
            command,
            result,
            target_system: 245,
            target_component: 190,
            ..COMMAND_ACK_DATA::default()
        });
        commands.handle_message(self.now.mono, Node::new(1, 1), &ack, true);
        std::iter::from_fn(|| commands.poll_event()).collect()
    }

    /// What was sent to the vehicle beside commands since the last look.
    pub(crate) fn posts(&mut self) -> Vec<MavMessage> {
        self.services.take_posts()
    }

    pub(crate) fn advance(&mut self, span: Duration) {
        self.now.mono += span;
        self.now.wall += span;
    }

    /// Lets a machine act: what it reads, what the other machines show, and what it may do.
    pub(crate) fn act<R>(
        &mut self,
        act: impl FnOnce(Context<'_>, Views<'_>, &mut Effects<'_>) -> R,
    ) -> R {
        let context = Context {
            now: self.now,
            vsm: VSM,
            config: &self.config,
            settings: &self.settings,
            bounds: &self.bounds,
            stations: &self.stations,
            controller: self.controller,
            vehicle: &self.vehicle,
            termination: self.termination,
        };
        let flight = FlightView {
            maneuver: self.maneuver,
            streams_curve: false,
            loss_action: false,
            contingency: false,
            commands_by_itself: false,
            item_unknown_until: None,
            commanded: Commanded::default(),
            altimeter: Altimeter::STANDARD,
            loiter: &self.loiter,
            engine_command: None,
            sticks: None,
        };
        let parameters = ParameterView {
            values: &self.parameters,
            reading: false,
        };
        let mission = MissionView {
            plan: &self.plan,
            uploaded: self.uploaded.as_ref(),
            loaded: None,
            progress: &self.progress,
            transfer: self.transfer,
            waiting_mode: None,
            fence_busy: false,
            areas: &self.areas,
            fence: (&[], &self.areas),
            unfenced: None,
            infeasible: self.infeasible,
            may_change: match self.transfer {
                Transfer::None => Ok(()),
                Transfer::Running { .. } => Err("a transfer is running"),
            },
        };
        let views = Views {
            mission,
            flight,
            parameters,
            rights: &self.rights,
        };
        let mut effects = Effects {
            dli: DliEffects {
                now: self.now,
                boot: self.boot,
                vsm: VSM,
                multicast: false,
                stations: &self.stations,
                logical: &self.logical,
                remembered: &mut self.remembered,
                alerts: &mut self.vsm_alerts,
                outbox: &mut self.outbox,
                paths: &mut self.paths,
                counters: &mut self.counters,
                log: &mut self.log,
                asker: None,
                mark: self.disk.queued(),
                disk: &mut *self.disk,
            },
            id: VEHICLE,
            alerts: &mut self.alerts,
            listeners: &mut self.listeners,
            vehicle: &mut self.services,
            requests: &mut self.requests,
        };
        act(context, views, &mut effects)
    }

    /// What was sent to a station since this was last called for any; what went to others is dropped.
    pub(crate) fn sent_to(&mut self, station: usize) -> Vec<Message> {
        let own = self.stations[station].id();
        let all = self.sent().into_iter();
        all.filter_map(|(to, message)| (to == own).then_some(message))
            .collect()
    }

    /// What was sent to anybody, with its destination.
    pub(crate) fn sent(&mut self) -> Vec<(Id, Message)> {
        let mut messages = Vec::new();
        while let Some(datagram) = self.outbox.pop() {
            for frame in stanag_msgs::frames(datagram.bytes()) {
                let frame = frame.expect("a whole frame");
                let message = Message::decode(frame.header.message_type, frame.data);
                let message = message.expect("a message of the tables");
                messages.push((frame.header.destination, message));
            }
        }
        messages
    }
}

/// A message of station 0 that wants an acknowledgement.
pub(crate) fn origin(message: &Message) -> Origin {
    Origin {
        station: 0,
        message_type: message.id(),
        stamp: Some(TimeStamp(1)),
        ack_requested: true,
        held: None,
        continues: None,
    }
}

/// The acknowledgements among these messages.
pub(crate) fn acknowledgements(messages: &[Message]) -> Vec<AckType> {
    let ack = |message: &Message| match message {
        Message::MessageAcknowledgement(ack) => ack.acknowledgement_type,
        _ => None,
    };
    messages.iter().filter_map(ack).collect()
}
