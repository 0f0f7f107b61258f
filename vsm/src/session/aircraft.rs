//! One aircraft: who holds which rights over it, its plan, what it is told, and what is told of it.

use std::collections::VecDeque;
use std::time::Duration;

use mapping::mode::Px4Mode;
use mapping::plan::Plan;
use mapping::report::{self, Commanded};
use mapping::{altitude, route};
use mavlink_link::Now;
use mavlink_link::dialect::MavType;
use mavlink_link::frame::FrameView;
use mavlink_link::service::mission::{self, MavMissionType};
use stanag_msgs::enums::{
    AccessGranted, AckType, AlertPriority, FlightPathControlMode as Mode, LoiBitmap,
    PresenceVectorSupport, RequestedAccess, RouteType, SubsystemId,
};
use stanag_msgs::messages::{
    CucsAuthorisationRequest, Heartbeat, LoiterConfiguration, VehicleId,
    VehicleOperatingModeCommand, VsmAuthorisationResponse,
};
use stanag_msgs::{Id, Message, Text};

use super::alerts::{Alerts, Cause};
use super::authority::{Authority, CONTROL, Request};
use super::bridge::LogLevel;
use super::ceiling::Ceilings;
use super::desk::{Desk, Origin};
use super::maneuver::{self, Maneuver, Progress};
use super::mission_transfer::Load;
use super::mode_command::{self, Situation, Task};
use super::plan_record::Aboard;
use super::push::Push;
use super::station::{Period, Silence};
use super::transfer::Bounds;
use super::vehicle::{Peer, VehicleEvent, VehicleLink};
use crate::config::{self, OnLoss};

/// The machine.
#[derive(Debug)]
pub(crate) struct Aircraft {
    pub(crate) config: config::Vehicle,
    pub(crate) mav: VehicleLink,
    pub(crate) authority: Authority,
    pub(crate) plan: Plan,
    pub(crate) aboard: Option<Aboard>,
    pub(crate) load: Option<Load>,
    pub(crate) bounds: Bounds,
    pub(crate) alerts: Alerts,
    maneuver: Option<(Option<Origin>, Maneuver)>,
    loiter: LoiterConfiguration,
    commanded: Commanded,
    push: Push,
    silence: Silence,
}

impl Aircraft {
    pub(crate) fn new(config: config::Vehicle, mav: VehicleLink, number: i32) -> Aircraft {
        let config::Limits {
            first_m,
            leg_m,
            lowest_m,
            highest_m,
            speed_m_s,
        } = config.limits;
        let items = usize::from(config.curve.max_items);
        let bounds = Bounds {
            agl: match config.agl {
                config::Agl::Home => altitude::Agl::AboveHome,
                config::Agl::Refuse => altitude::Agl::Refuse,
            },
            limits: route::Limits {
                first_m,
                leg_m,
                lowest_m,
                highest_m,
                speed_m_s,
                items,
            },
        };
        Aircraft {
            config,
            mav,
            authority: Authority::default(),
            plan: Plan::default(),
            aboard: None,
            load: None,
            bounds,
            alerts: Alerts::new(number),
            maneuver: None,
            loiter: LoiterConfiguration::default(),
            commanded: Commanded::default(),
            push: Push::default(),
            silence: Silence::None,
        }
    }

    pub(crate) fn id(&self) -> Id {
        self.config.id
    }

    /// What stands from the start: an unsigned link is said aloud.
    pub(crate) fn announce(&mut self, desk: &mut Desk<'_>) {
        if self.config.signing == config::Signing::Off {
            let text =
                "MAVLink signing is off: anyone in range of the link can command this vehicle"
                    .to_owned();
            let raised = self.alerts.raise(
                Cause::SigningOff,
                AlertPriority::Warning,
                SubsystemId::Comms,
                text,
            );
            desk.alert(self.id(), &[], raised);
        }
    }

    // --- what CUCSs ask -----------------------------------------------------------------------------------------

    /// Message 1 to this vehicle: a request, a release, or a question where it names no access.
    pub(crate) fn authorise(
        &mut self,
        desk: &mut Desk<'_>,
        origin: &Origin,
        request: &CucsAuthorisationRequest,
    ) -> AckType {
        let Some(asker) = desk
            .stations
            .get(origin.station)
            .map(|station| station.asker())
        else {
            return AckType::Refused;
        };
        let levels = request.requested_handover_loi.unwrap_or(LoiBitmap::NONE);
        let wish = match request.requested_handover_access {
            Some(RequestedAccess::Relinquish) => Some(Request::Release(levels)),
            Some(RequestedAccess::Request) if !levels.is_empty() => Some(Request::Control(levels)),
            Some(RequestedAccess::Override) if !levels.is_empty() => {
                Some(Request::Override(levels))
            }
            _ => None,
        };
        let Some(wish) = wish else {
            self.answer_authorisation(desk, origin.station, Some(request));
            return AckType::CarriedOut;
        };
        let before = self.authority.clone();
        let offered = self.silence >= Silence::Offered;
        let mut outcome = self.authority.request(asker, wish, offered);
        if self.authority != before
            && let Err(fault) = self.store_authority(desk)
        {
            // A right that would not survive a restart is not granted.
            self.authority = before.clone();
            outcome.in_full = false;
            outcome.deposed.clear();
            let text = format!("authority cannot be stored, nothing changes: {fault}");
            self.warn(desk, Cause::Store, text);
        }
        for deposed in &outcome.deposed {
            let index = desk
                .stations
                .iter()
                .position(|station| station.id() == *deposed);
            if let Some(index) = index {
                self.answer_authorisation(desk, index, None);
            }
        }
        if self.authority != before {
            self.say_change_of_control(desk, &before);
        }
        self.answer_authorisation(desk, origin.station, Some(request));
        let now_listens = self.authority.holds(asker.id, LoiBitmap::LOI2);
        if now_listens != (!before.granted(asker.id).is_empty()) {
            self.push.reset(origin.station);
            if now_listens {
                self.welcome(desk, origin.station);
            }
        }
        if outcome.in_full {
            AckType::CarriedOut
        } else {
            AckType::Refused
        }
    }

    fn say_change_of_control(&mut self, desk: &mut Desk<'_>, before: &Authority) {
        let (from, to) = (before.controller(), self.authority.controller());
        if from != to {
            let name = |id: Option<Id>| id.map_or_else(|| "nobody".to_owned(), |id| id.to_string());
            let text = format!("control passes from {} to {}", name(from), name(to));
            desk.note(LogLevel::Info, self.id(), text);
            self.silence = Silence::None;
            if let Some(raised) = self
                .alerts
                .clear(Cause::CucsSilent, "control has passed on")
            {
                let listeners = desk.listeners(&self.authority, None);
                desk.alert(self.id(), &listeners, Some(raised));
            }
        }
    }

    /// Message 2: what this station may have and now holds.
    pub(crate) fn answer_authorisation(
        &mut self,
        desk: &mut Desk<'_>,
        station: usize,
        request: Option<&CucsAuthorisationRequest>,
    ) {
        let Some(asker) = desk.stations.get(station).map(|station| station.asker()) else {
            return;
        };
        let granted = self.authority.granted(asker.id);
        let in_control = granted.intersects(LoiBitmap::LOI3.union(CONTROL));
        let response = VsmAuthorisationResponse {
            time_stamp: Some(desk.stamp()),
            vsm_id: Some(desk.vsm),
            data_link_id: Some(Id::NULL),
            access_authorized: Some(u8::from(!asker.authorised.is_empty())),
            access_granted: Some(if in_control {
                AccessGranted::InControl
            } else {
                AccessGranted::NotInControl
            }),
            loi_authorized: Some(asker.authorised),
            loi_granted: Some(granted),
            controlled_station_1_16: request.and_then(|request| request.controlled_station_1_16),
            access_requested: request
                .and_then(|request| request.requested_handover_access)
                .map(RequestedAccess::raw),
            vehicle_type: Some(self.vehicle_type()),
            vehicle_subtype: Some(0),
            cucs_type: request.and_then(|request| request.cucs_type),
            cucs_subtype: request.and_then(|request| request.cucs_subtype),
            presence_vector_support: Some(PresenceVectorSupport::Partial),
            ..VsmAuthorisationResponse::default()
        };
        desk.send(
            station,
            self.id(),
            &Message::VsmAuthorisationResponse(response.clone()),
        );
        desk.send_to_group(self.id(), &Message::VsmAuthorisationResponse(response));
    }

    /// What a station is told first: message 3, and the alerts that stand.
    fn welcome(&mut self, desk: &mut Desk<'_>, station: usize) {
        let message = Message::VehicleId(self.vehicle_id(desk));
        desk.send(station, self.id(), &message);
        for alert in self.alerts.standing().cloned().collect::<Vec<_>>() {
            let raised = super::alerts::Raised { alert, first: true };
            desk.alert(self.id(), &[station], Some(raised));
        }
    }

    fn vehicle_id(&self, desk: &mut Desk<'_>) -> VehicleId {
        VehicleId {
            time_stamp: Some(desk.stamp()),
            vsm_id: Some(desk.vsm),
            vehicle_id_update: Some(self.id()),
            vehicle_type: Some(self.vehicle_type()),
            vehicle_subtype: Some(0),
            owning_id: Some((self.id().0 >> 24) as u8),
            tail_number: Some(Text::new(&self.config.tail_number)),
            mission_id: self
                .aboard
                .as_ref()
                .map(|aboard| Text::new(&aboard.mission_name)),
            ..VehicleId::default()
        }
    }

    /// The custodian's list of vehicle types is not public: MAVLink's MAV_TYPE stands in, 0 before it is heard.
    fn vehicle_type(&self) -> u16 {
        self.mav
            .telemetry
            .vehicle_type
            .map_or(0, |kind: MavType| kind as u16)
    }

    /// The rights that a message needs; `None` where it is none that a CUCS commands with.
    pub(crate) fn right_for(&self, message: &Message) -> Option<LoiBitmap> {
        match message {
            Message::VehicleOperatingModeCommand(command) => {
                let mode = mode_command::mode_of(command, &self.mav.telemetry);
                let launch_or_land = matches!(
                    mode,
                    Some(Mode::Launch | Mode::AutolandEngage | Mode::AutolandWaveOff)
                );
                Some(if launch_or_land {
                    LoiBitmap::LOI5
                } else {
                    LoiBitmap::LOI4
                })
            }
            Message::LoiterConfiguration(_)
            | Message::MissionTransferCommand(_)
            | Message::UaRoute(_)
            | Message::UaPositionWaypoint(_)
            | Message::UaLoiterWaypoint(_)
            | Message::CurveSegment(_)
            | Message::CurveSegmentPaper(_) => Some(LoiBitmap::LOI4),
            _ => None,
        }
    }

    /// A command of a CUCS that holds the right for it.
    pub(crate) fn command(&mut self, desk: &mut Desk<'_>, origin: Origin, message: &Message) {
        match message {
            Message::VehicleOperatingModeCommand(command) => {
                desk.acknowledge(self.id(), &origin, AckType::Received);
                self.operate(desk, Some(origin), command);
            }
            Message::LoiterConfiguration(configuration) => {
                merge(&mut self.loiter, configuration);
                desk.acknowledge(self.id(), &origin, AckType::CarriedOut);
            }
            Message::MissionTransferCommand(command) => {
                self.transfer_command(desk, origin, command)
            }
            other => self.store_plan_message(desk, origin, other),
        }
    }

    /// A 2016; without origin it is the VSM's own.
    pub(crate) fn operate(
        &mut self,
        desk: &mut Desk<'_>,
        origin: Option<Origin>,
        command: &VehicleOperatingModeCommand,
    ) {
        if !self.mav.live() {
            let text = "the vehicle is silent: no command can be confirmed".to_owned();
            return self.refuse(desk, origin, text);
        }
        let situation = Situation {
            telemetry: &self.mav.telemetry,
            aboard: self.aboard.as_ref(),
            contingency: [RouteType::ContingencyA, RouteType::ContingencyB]
                .map(|wanted| self.plan.route_of_type(wanted).is_some()),
            loiter: &self.loiter,
            commanded: self.commanded,
            agl: self.bounds.agl,
            limits: self.bounds.limits,
        };
        match mode_command::task(command, &situation) {
            Err(why) => self.refuse(desk, origin, why),
            Ok(Task::Steps(steps, commanded)) => {
                let needs_mission = steps
                    .iter()
                    .any(|step| matches!(step, maneuver::Step::SetCurrent(_)));
                if self.load.is_some() && (needs_mission || enters_mission(&steps)) {
                    return self.refuse(
                        desk,
                        origin,
                        "a route is on its way aboard: wait for 14000".to_owned(),
                    );
                }
                self.begin(desk, origin, Maneuver::new(steps, commanded));
            }
            Ok(Task::Launch(steps, commanded)) => {
                let maneuver = Maneuver::new(steps, commanded).undone_by(maneuver::arm(false));
                self.begin(desk, origin, maneuver);
            }
            Ok(Task::Load(route)) => self.load_and_fly(desk, origin, route, command),
        }
    }

    fn begin(&mut self, desk: &mut Desk<'_>, origin: Option<Origin>, maneuver: Maneuver) {
        if let Some((earlier, mut running)) = self.maneuver.take() {
            running.abandon(desk.now.mono, &mut self.mav);
            self.refuse(desk, earlier, "superseded by a later command".to_owned());
        }
        self.maneuver = Some((origin, maneuver));
        self.go_on(desk);
    }

    /// Refuses a command: 17000 where it was asked for, 16000 with the reason to who commanded.
    pub(crate) fn refuse(&mut self, desk: &mut Desk<'_>, origin: Option<Origin>, why: String) {
        let to: Vec<usize> = match &origin {
            Some(origin) => {
                desk.acknowledge(self.id(), origin, AckType::Refused);
                vec![origin.station]
            }
            None => desk.listeners(&self.authority, None),
        };
        let what = origin.map_or_else(String::new, |origin| {
            format!("{} refused: ", origin.message_type)
        });
        let text = format!("{what}{why}");
        let raised = self.alerts.notice(
            desk.now.mono,
            AlertPriority::Caution,
            SubsystemId::VsmStatus,
            text,
        );
        desk.alert(self.id(), &to, raised);
    }

    /// 17001.
    pub(crate) fn schedule(
        &mut self,
        desk: &mut Desk<'_>,
        station: usize,
        message: u16,
        hertz: u16,
    ) -> bool {
        if !REPORTS.contains(&message) || hertz > MOST_HERTZ {
            return false;
        }
        let period = match hertz {
            0 => Period::Never,
            hertz => Period::Every(Duration::from_secs(1) / u32::from(hertz)),
        };
        let id = self.id();
        if let Some(of) = desk.stations.get_mut(station) {
            of.schedule.insert((id, message), period);
        }
        self.push.reset(station);
        true
    }

    /// 17002: a report, at once. False where there is none of this type.
    pub(crate) fn report_once(
        &mut self,
        desk: &mut Desk<'_>,
        station: usize,
        message: u16,
    ) -> bool {
        if message == 2 {
            self.answer_authorisation(desk, station, None);
            return true;
        }
        let Some(report) = self.compose(desk, message) else {
            return false;
        };
        desk.send(station, self.id(), &report);
        true
    }

    fn compose(&mut self, desk: &mut Desk<'_>, message: u16) -> Option<Message> {
        let stamp = desk.stamp();
        let (vehicle, live) = (&self.mav.telemetry, self.mav.live());
        let flight = self.aboard.as_ref().map(|aboard| &aboard.flight);
        match message {
            3 => Some(Message::VehicleId(self.vehicle_id(desk))),
            3001 if live => {
                report::operating_mode(vehicle, stamp).map(Message::VehicleOperatingModeReport)
            }
            3001 => Some(Message::VehicleOperatingModeReport(
                report::no_operating_mode(stamp),
            )),
            3002 => {
                let states =
                    report::operating_states(vehicle, &self.commanded, flight, !live, stamp);
                Some(Message::VehicleOperatingStates(states))
            }
            // What a silent vehicle said last is no state of now: it is not repeated.
            4000 if live => report::inertial_states(vehicle, stamp).map(Message::InertialStates),
            4001 if live => Some(Message::FromToNextWaypointStates(report::waypoint_states(
                vehicle, flight, stamp,
            ))),
            16002 => Some(Message::Heartbeat(Heartbeat {
                time_stamp: Some(stamp),
            })),
            _ => None,
        }
    }

    // --- what the vehicle tells -----------------------------------------------------------------------------------

    /// A datagram from the vehicle's side.
    pub(crate) fn handle_datagram(
        &mut self,
        desk: &mut Desk<'_>,
        from: Peer,
        octets: &[u8],
        tap: &mut dyn FnMut(&FrameView<'_>),
    ) {
        self.mav
            .handle_datagram(desk.now, from, octets, &mut Ceilings(desk.store), tap);
        self.go_on(desk);
    }

    /// Does what is due.
    pub(crate) fn handle_timeout(&mut self, desk: &mut Desk<'_>) {
        self.mav.handle_timeout(desk.now, &mut Ceilings(desk.store));
        self.watch_controller(desk);
        self.go_on(desk);
        self.push_due(desk);
    }

    /// When [`Aircraft::handle_timeout`] is next needed.
    pub(crate) fn poll_timeout(&self, now: Duration) -> Duration {
        [
            Some(self.mav.poll_timeout()),
            self.maneuver
                .as_ref()
                .and_then(|(_, maneuver)| maneuver.poll_timeout()),
            self.load.as_ref().and_then(Load::poll_timeout),
            self.push.poll_timeout(),
        ]
        .into_iter()
        .flatten()
        .fold(now + LOOK_AGAIN, Duration::min)
    }

    /// Lets every machine take its next step, until nothing is left to do now.
    pub(crate) fn go_on(&mut self, desk: &mut Desk<'_>) {
        for _ in 0..MOST_ROUNDS {
            let mut events: VecDeque<VehicleEvent> = VecDeque::new();
            while let Some(event) = self.mav.poll_event() {
                events.push_back(event);
            }
            let idle = events.is_empty();
            for event in events {
                self.take_event(desk, event);
            }
            self.advance_maneuver(desk);
            self.advance_load(desk);
            self.mav.flush(desk.now, &mut Ceilings(desk.store));
            if idle {
                break;
            }
        }
    }

    fn take_event(&mut self, desk: &mut Desk<'_>, event: VehicleEvent) {
        let listeners = desk.listeners(&self.authority, None);
        match event {
            VehicleEvent::Heard => {
                desk.note(LogLevel::Info, self.id(), "the vehicle is heard".to_owned());
                let raised = self
                    .alerts
                    .clear(Cause::VehicleSilent, "the vehicle is heard again");
                desk.alert(self.id(), &listeners, raised);
                self.report_on_change(desk);
            }
            VehicleEvent::Silent => {
                let text = "the vehicle is silent: its state is not known".to_owned();
                let raised = self.alerts.raise(
                    Cause::VehicleSilent,
                    AlertPriority::Warning,
                    SubsystemId::Comms,
                    text,
                );
                desk.alert(self.id(), &listeners, raised);
                self.report_on_change(desk);
            }
            VehicleEvent::Restarted => {
                let text = "the autopilot has restarted".to_owned();
                let raised = self.alerts.notice(
                    desk.now.mono,
                    AlertPriority::Warning,
                    AUTOPILOT_SUBSYSTEM,
                    text,
                );
                desk.alert(self.id(), &listeners, raised);
            }
            VehicleEvent::ModeChanged => self.report_on_change(desk),
            VehicleEvent::Text(text) => {
                let priority = mapping::alert::priority(text.severity);
                let raised =
                    self.alerts
                        .notice(desk.now.mono, priority, AUTOPILOT_SUBSYSTEM, text.text);
                desk.alert(self.id(), &listeners, raised);
            }
            VehicleEvent::Command(event) => {
                if let Some((origin, maneuver)) = &mut self.maneuver
                    && let Progress::Refused(why) =
                        maneuver.handle_command(desk.now.mono, &event, &self.mav)
                {
                    let origin = *origin;
                    self.fail_maneuver(desk, origin, why);
                }
                self.load_sees_command(desk, &event);
            }
            VehicleEvent::Mission(event) => {
                if let Some((origin, maneuver)) = &mut self.maneuver
                    && let Progress::Refused(why) = maneuver.handle_mission(&event)
                {
                    let origin = *origin;
                    self.fail_maneuver(desk, origin, why);
                }
                self.load_sees_mission(desk, event);
            }
            VehicleEvent::Link(event) => self.take_link_event(desk, &listeners, event),
        }
    }

    fn take_link_event(
        &mut self,
        desk: &mut Desk<'_>,
        listeners: &[usize],
        event: mavlink_link::link::Event<Peer>,
    ) {
        use mavlink_link::link::Event as E;
        match event {
            E::PeerChanged { from, to } => {
                let text = format!("the vehicle's address is {to:?}, it was {from:?}");
                desk.note(LogLevel::Info, self.id(), text);
            }
            E::Behind => desk.note(
                LogLevel::Info,
                self.id(),
                "its stamps are behind: it has restarted".to_owned(),
            ),
            E::Live => desk.note(LogLevel::Info, self.id(), "the link is live".to_owned()),
            E::Alert(alert) => {
                let text = link_alert_text(alert).to_owned();
                let raised = self.alerts.notice(
                    desk.now.mono,
                    AlertPriority::Warning,
                    SubsystemId::Comms,
                    text,
                );
                desk.alert(self.id(), listeners, raised);
            }
            // Keys are agreed with the air-side agent only, which is not configured here.
            E::KeyExchange(_) => desk.counters.count("key exchange ignored"),
        }
    }

    fn advance_maneuver(&mut self, desk: &mut Desk<'_>) {
        let Some((origin, maneuver)) = &mut self.maneuver else {
            return;
        };
        let origin = *origin;
        match maneuver.advance(desk.now.mono, &mut self.mav) {
            Progress::Going => {}
            Progress::Done => {
                self.commanded = maneuver.commanded;
                self.maneuver = None;
                if let Some(origin) = origin {
                    desk.acknowledge(self.id(), &origin, AckType::CarriedOut);
                }
            }
            Progress::Refused(why) => self.fail_maneuver(desk, origin, why),
        }
    }

    fn fail_maneuver(&mut self, desk: &mut Desk<'_>, origin: Option<Origin>, why: String) {
        if let Some((_, mut maneuver)) = self.maneuver.take() {
            maneuver.abandon(desk.now.mono, &mut self.mav);
        }
        self.refuse(desk, origin, why);
    }

    /// 3001 and 3002 on change, beside their period.
    fn report_on_change(&mut self, desk: &mut Desk<'_>) {
        for message in [3001, 3002] {
            let Some(report) = self.compose(desk, message) else {
                continue;
            };
            for station in desk.listeners(&self.authority, None) {
                desk.send(station, self.id(), &report);
            }
            desk.send_to_group(self.id(), &report);
        }
    }

    fn push_due(&mut self, desk: &mut Desk<'_>) {
        for index in desk.listeners(&self.authority, None) {
            let Some(station) = desk.stations.get(index) else {
                continue;
            };
            for message in self
                .push
                .take_due(desk.now.mono, index, station, self.config.id)
            {
                if let Some(report) = self.compose(desk, message) {
                    desk.send(index, self.id(), &report);
                    desk.send_to_group(self.id(), &report);
                }
            }
        }
    }

    // --- a silent controller --------------------------------------------------------------------------------------

    fn watch_controller(&mut self, desk: &mut Desk<'_>) {
        let controller = self.authority.controller();
        let station = desk
            .stations
            .iter()
            .find(|station| Some(station.id()) == controller);
        let silence = station.map_or(Silence::None, |station| {
            station.silence(desk.now.mono, &desk.loss)
        });
        if silence == self.silence {
            return;
        }
        self.silence = silence;
        let name = controller.map_or_else(String::new, |id| id.to_string());
        let listeners = desk.listeners(&self.authority, None);
        let raised = match silence {
            Silence::None => self
                .alerts
                .clear(Cause::CucsSilent, "the controlling CUCS is heard again"),
            Silence::Warned => {
                let text = format!("the controlling CUCS {name} is silent");
                self.alerts.raise(
                    Cause::CucsSilent,
                    AlertPriority::Caution,
                    SubsystemId::Comms,
                    text,
                )
            }
            Silence::Offered => {
                let text =
                    format!("the controlling CUCS {name} is silent: another may take control");
                self.alerts.raise(
                    Cause::CucsSilent,
                    AlertPriority::Warning,
                    SubsystemId::Comms,
                    text,
                )
            }
            Silence::Lost => {
                let text = format!(
                    "the controlling CUCS {name} is lost: {}",
                    loss_text(desk.loss.on_loss)
                );
                self.alerts.raise(
                    Cause::CucsSilent,
                    AlertPriority::Emergency,
                    SubsystemId::Comms,
                    text,
                )
            }
        };
        desk.alert(self.id(), &listeners, raised);
        if silence == Silence::Lost {
            self.lose_controller(desk, controller);
        }
    }

    fn lose_controller(&mut self, desk: &mut Desk<'_>, controller: Option<Id>) {
        if let Some(id) = controller {
            self.authority.release(id, CONTROL);
            if let Err(fault) = self.store_authority(desk) {
                self.warn(
                    desk,
                    Cause::Store,
                    format!("authority cannot be stored: {fault}"),
                );
            }
        }
        let mode = match desk.loss.on_loss {
            OnLoss::Continue => return,
            OnLoss::Hold => Mode::Loiter,
            OnLoss::Contingency => Mode::ContingencyA,
            OnLoss::Rtl => {
                let steps = maneuver::enter(&[Px4Mode::RTL]);
                return self.begin(desk, None, Maneuver::new(steps, self.commanded));
            }
        };
        if self.mav.telemetry.airborne() {
            let command = VehicleOperatingModeCommand {
                select_flight_path_control_mode: Some(mode),
                ..VehicleOperatingModeCommand::default()
            };
            self.operate(desk, None, &command);
        }
    }

    pub(crate) fn warn(&mut self, desk: &mut Desk<'_>, cause: Cause, text: String) {
        let listeners = desk.listeners(&self.authority, None);
        let raised = self
            .alerts
            .raise(cause, AlertPriority::Warning, SubsystemId::VsmStatus, text);
        desk.alert(self.id(), &listeners, raised);
    }

    /// Clears the mission aboard; used by 13000 mode 1.
    pub(crate) fn begin_clearing(&mut self, now: Now) -> Result<(), mission::StartError> {
        self.mav
            .missions
            .clear(now.mono, MavMissionType::MAV_MISSION_TYPE_MISSION)
    }
}

/// 2017 is a configuration message: an absent field keeps its last value.
fn merge(kept: &mut LoiterConfiguration, new: &LoiterConfiguration) {
    let old = std::mem::take(kept);
    *kept = LoiterConfiguration {
        time_stamp: new.time_stamp.or(old.time_stamp),
        loiter_type: new.loiter_type.or(old.loiter_type),
        loiter_radius: new.loiter_radius.or(old.loiter_radius),
        loiter_length: new.loiter_length.or(old.loiter_length),
        loiter_length_units: new.loiter_length_units.or(old.loiter_length_units),
        loiter_bearing: new.loiter_bearing.or(old.loiter_bearing),
        loiter_direction: new.loiter_direction.or(old.loiter_direction),
        flying_behaviour: new.flying_behaviour.or(old.flying_behaviour),
        loiter_duration: new.loiter_duration.or(old.loiter_duration),
        loiter_duration_units: new.loiter_duration_units.or(old.loiter_duration_units),
        activity_id: new.activity_id.or(old.activity_id),
    };
}

fn enters_mission(steps: &[maneuver::Step]) -> bool {
    let mission = &[Px4Mode::MISSION][..];
    steps.iter().any(|step| {
        matches!(step, maneuver::Step::Confirm { sight: maneuver::Sight::Mode(modes), .. } if *modes == mission)
    })
}

fn loss_text(on_loss: OnLoss) -> &'static str {
    match on_loss {
        OnLoss::Continue => "the vehicle goes on",
        OnLoss::Hold => "the vehicle holds",
        OnLoss::Contingency => "contingency A is flown",
        OnLoss::Rtl => "the vehicle returns",
    }
}

fn link_alert_text(alert: mavlink_link::link::Alert) -> &'static str {
    use mavlink_link::link::Alert as A;
    match alert {
        A::WallFarAhead => {
            "this computer's clock is over a year ahead of the signing clock: check it"
        }
        A::CeilingNotStored => {
            "the signing clock cannot be stored: sending and accepting will stop"
        }
        A::ClockExhausted => "the signing clock is exhausted: a new key is needed",
        A::StaysBehind => "the vehicle's stamps stay behind: no frame of it is believed",
        A::VehicleUnsigned => "the vehicle sends unsigned: its key may be lost",
        A::BadSignatures => "many frames with bad signatures: an attack, or two keys",
        A::Future => "frames with stamps over an hour ahead are refused",
        A::LinkIdMoved => "the autopilot signs with another link id",
        A::StreamTableFull => "too many signing streams: one is refused",
    }
}

/// What 17001 and 17002 can ask for.
const REPORTS: &[u16] = &[3, 3001, 3002, 4000, 4001, 16002];
const MOST_HERTZ: u16 = 50;
/// Subsystem ID of what the autopilot says of itself: VSM specific.
const AUTOPILOT_SUBSYSTEM: SubsystemId = SubsystemId::from_raw(20);
/// Silences are looked at this often.
const LOOK_AGAIN: Duration = Duration::from_millis(250);
/// Bound on what one datagram may set off.
const MOST_ROUNDS: usize = 32;
