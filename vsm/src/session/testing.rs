//! What a machine is tested with: everything that its [`Context`] and its [`Effects`] borrow, without the other machines.

use std::collections::VecDeque;
use std::path::Path;
use std::time::Duration;

use mapping::altitude::Altimeter;
use mapping::parameter::Parameters;
use mapping::report::Commanded;
use mavlink_link::Now;
use mavlink_link::service::Node;
use mavlink_link::store::{Disk, MemoryDisk};
use stanag_msgs::messages::LoiterConfiguration;
use stanag_msgs::{Id, Message, TimeStamp};

use super::alerts::Alerts;
use super::context::{Bounds, Context, FlightView, Origin, ParameterView, Settings};
use super::counters::Counters;
use super::duplicates::Remembered;
use super::effects::{DliEffects, Effects, Request};
use super::link::services::Services;
use super::link::state::VehicleState;
use super::log::LogEntry;
use super::outbox::Outbox;
use super::station::GroundStation;
use crate::config::{self, Config};

pub(crate) const VSM: Id = Id(0x1b00_0001);
/// Station 0. Station 1 has the next id.
pub(crate) const CUCS: Id = Id(0x1b00_00a0);
pub(crate) const VEHICLE: Id = Id(0x1b00_0101);

/// A vehicle that is live, with two stations; both listen, and the first controls.
pub(crate) struct World {
    pub(crate) now: Now,
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
    pub(crate) loiter: LoiterConfiguration,
    /// A maneuver is in progress.
    pub(crate) maneuver: bool,
    remembered: Vec<Remembered>,
    vsm_alerts: Alerts,
    outbox: Outbox,
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
                let mut station = GroundStation::new(cucs.get_ref().clone());
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
            bounds: Bounds::of(&vehicle),
            config: vehicle,
            settings: Settings {
                authority: *config.authority.get_ref(),
                provisional: config.dli.provisional,
                web_page: None,
            },
            controller: Some(CUCS),
            vehicle: state,
            services: Services::new(Node::new(245, 190), Node::new(1, 1)),
            alerts: Alerts::new(1),
            listeners: (0..stations.len()).collect(),
            requests: VecDeque::new(),
            counters: Counters::default(),
            log: VecDeque::new(),
            disk: Box::new(MemoryDisk::default()),
            parameters: Parameters::default(),
            loiter: LoiterConfiguration::default(),
            maneuver: false,
            remembered: stations.iter().map(|_| Remembered::default()).collect(),
            vsm_alerts: Alerts::new(0),
            outbox: Outbox::default(),
            stations,
        }
    }

    pub(crate) fn advance(&mut self, span: Duration) {
        self.now.mono += span;
        self.now.wall += span;
    }

    /// Lets a machine act: what it reads, what the other machines show, and what it may do.
    pub(crate) fn act<R>(
        &mut self,
        act: impl FnOnce(Context<'_>, FlightView<'_>, ParameterView<'_>, &mut Effects<'_>) -> R,
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
        };
        let flight = FlightView {
            maneuver: self.maneuver,
            steering: false,
            loss_action: false,
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
        let mut effects = Effects {
            dli: DliEffects {
                now: self.now,
                vsm: VSM,
                multicast: false,
                stations: &self.stations,
                remembered: &mut self.remembered,
                alerts: &mut self.vsm_alerts,
                outbox: &mut self.outbox,
                counters: &mut self.counters,
                log: &mut self.log,
                disk: &mut *self.disk,
            },
            id: VEHICLE,
            alerts: &mut self.alerts,
            listeners: &mut self.listeners,
            vehicle: &mut self.services,
            requests: &mut self.requests,
        };
        act(context, flight, parameters, &mut effects)
    }

    /// What was sent to a station since this was last called for any; what went to others is dropped.
    pub(crate) fn sent_to(&mut self, station: usize) -> Vec<Message> {
        let to = self.stations[station].id();
        let mut messages = Vec::new();
        while let Some(datagram) = self.outbox.pop() {
            for frame in stanag_msgs::frames(datagram.bytes()) {
                let frame = frame.expect("a whole frame");
                if frame.header.destination == to {
                    let message = Message::decode(frame.header.message_type, frame.data);
                    messages.push(message.expect("a message of the tables"));
                }
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
    }
}
