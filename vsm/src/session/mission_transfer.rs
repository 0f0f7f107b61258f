//! Plans of one aircraft: storing 13001 to 13003 and curves, and what a Mission Transfer Command (13000) asks.

use std::collections::VecDeque;
use std::time::Duration;

use mapping::altitude::Level;
use mavlink_link::service::command;
use mavlink_link::service::mission::{self, Failure, Operation};
use stanag_msgs::enums::{
    AckType, AlertPriority, MissionPlanMode as Mode, MissionTransferStatus, RouteType,
};
use stanag_msgs::messages::{
    CurveSegmentPaper, MissionTransferCommand, MissionUploadDownloadStatus, UaRoute,
    VehicleOperatingModeCommand,
};
use stanag_msgs::{Id, Message, Text};

use super::aircraft::Aircraft;
use super::alerts::Cause;
use super::desk::{Desk, Origin};
use super::plan_record::{self, Aboard};
use super::store::{Durability, StoreError, record_name};
use super::transfer::{Course, Transfer, explain};

/// What is on its way to the vehicle's mission store.
#[derive(Debug)]
pub(crate) struct Load {
    work: Work,
    /// Who asked by 13000; none where a mode command needs another route aboard.
    origin: Option<Origin>,
    mission_name: String,
    /// Flown once it is aboard.
    then: Option<(Option<Origin>, VehicleOperatingModeCommand)>,
}

#[expect(clippy::large_enum_variant, reason = "one an aircraft, and rare")]
#[derive(Debug)]
enum Work {
    Transfer(Transfer),
    Clear,
}

/// A plan on its way to a station.
#[derive(Debug)]
pub(crate) struct Download {
    origin: Origin,
    name: String,
    mode: Mode,
    left: VecDeque<Message>,
    pub(super) next_at: Duration,
}

/// Messages of a download that go out at once, and the pause after them: 800 a second.
const DOWNLOAD_BURST: usize = 8;
const DOWNLOAD_PAUSE: Duration = Duration::from_millis(10);

impl Load {
    /// Of a plan that was aboard: nobody has asked for it.
    pub(super) fn again(aboard: &Aboard) -> Load {
        Load {
            work: Work::Transfer(Transfer::again(aboard)),
            origin: None,
            mission_name: aboard.mission_name.clone(),
            then: None,
        }
    }

    fn is_unasked(&self) -> bool {
        self.origin.is_none() && self.then.is_none()
    }

    /// Who gave the command that is carried out once this is aboard.
    pub(super) fn waiting_command(&self) -> Option<Option<Origin>> {
        self.then.as_ref().map(|(origin, _)| *origin)
    }

    /// Forgets that command.
    pub(super) fn drop_command(&mut self) -> Option<Option<Origin>> {
        self.then.take().map(|(origin, _)| origin)
    }

    /// The station that asked for it, by 13000 or by a mode command; none where the VSM does by itself.
    pub(crate) fn owner(&self) -> Option<usize> {
        let then = self.then.as_ref().and_then(|(origin, _)| origin.as_ref());
        self.origin.as_ref().or(then).map(|origin| origin.station)
    }

    /// Whether the vehicle was taken out of its mission for it.
    fn held(&self) -> bool {
        matches!(&self.work, Work::Transfer(transfer) if transfer.held)
    }

    pub(crate) fn poll_timeout(&self) -> Option<Duration> {
        match &self.work {
            Work::Transfer(transfer) => transfer.poll_timeout(),
            Work::Clear => None,
        }
    }
}

impl Aircraft {
    /// 13001, 13002, 13003, 50001, 50002: stored at once, flown after 13000.
    pub(crate) fn store_plan_message(
        &mut self,
        desk: &mut Desk<'_>,
        origin: Origin,
        message: &Message,
    ) {
        let Some(cucs) = desk
            .stations
            .get(origin.station)
            .map(|station| station.id())
        else {
            return;
        };
        let before = self.plan.clone();
        let stored = self
            .plan
            .store(message, cucs, self.id())
            .map_err(|fault| fault.to_string())
            .and_then(|()| {
                self.save_plan(desk, cucs)
                    .map_err(|fault| format!("it cannot be stored: {fault}"))
            });
        match stored {
            Ok(()) => desk.acknowledge(self.id(), &origin, AckType::CarriedOut),
            Err(why) => {
                self.plan = before;
                self.refuse(desk, Some(origin), why);
            }
        }
    }

    /// 13000.
    pub(crate) fn transfer_command(
        &mut self,
        desk: &mut Desk<'_>,
        origin: Origin,
        command: &MissionTransferCommand,
    ) {
        desk.acknowledge(self.id(), &origin, AckType::Received);
        let name = command
            .mission_id
            .as_ref()
            .map_or_else(String::new, |id| id.as_str().to_owned());
        match command.mission_plan_mode {
            Some(Mode::Load) => self.load(desk, origin, name, command),
            Some(Mode::Clear) => self.clear(desk, origin, name),
            Some(Mode::Download) => self.download(desk, origin, &name, None),
            Some(Mode::DownloadWaypoint) => {
                self.download(desk, origin, &name, command.waypoint_number)
            }
            Some(Mode::Cancel) => self.cancel(desk, origin, &name),
            Some(Mode::Unknown(value)) => {
                let why = format!("Mission Plan Mode {value}, expected 1 to 5");
                self.reject(desk, origin, &name, Mode::Unknown(value), None, why);
            }
            None => self.refuse(
                desk,
                Some(origin),
                "Mission Plan Mode is missing".to_owned(),
            ),
        }
    }

    fn load(
        &mut self,
        desk: &mut Desk<'_>,
        origin: Origin,
        name: String,
        command: &MissionTransferCommand,
    ) {
        if let Err(why) = self.may_change_mission() {
            return self.reject(desk, origin, &name, Mode::Load, None, why);
        }
        let route_id = command
            .route_id
            .as_ref()
            .map(|id| id.as_str())
            .filter(|id| !id.is_empty());
        let (route, route_type) = match self.route_to_load(route_id) {
            Ok(found) => found,
            Err(why) => return self.reject(desk, origin, &name, Mode::Load, None, why),
        };
        let flights = self
            .plan
            .routes()
            .iter()
            .filter(|route| mapping::plan::route_type(route) == RouteType::Flight);
        if route_id.is_none() && flights.count() > 1 {
            let named = route.route_id.as_ref().map_or("", |id| id.as_str());
            let text = format!(
                "13000 names no Route ID: of several flight routes the latest, {named:?}, is loaded"
            );
            self.advise(desk, text);
        }
        self.report(
            desk,
            origin.station,
            &name,
            Mode::Load,
            MissionTransferStatus::InProgress,
            0,
            None,
        );
        self.load = Some(Load {
            work: Work::Transfer(Transfer::new(desk.now.mono, &route, route_type)),
            origin: Some(origin),
            mission_name: name,
            then: None,
        });
        self.go_on(desk);
    }

    /// The route that a load means: the one named, else the latest flight route, else the latest of all.
    fn route_to_load(&self, route_id: Option<&str>) -> Result<(UaRoute, RouteType), String> {
        let route = match route_id {
            Some(id) => self
                .plan
                .route_named(id)
                .ok_or_else(|| format!("route {id:?} has not been received (13001)"))?,
            None => self
                .plan
                .route_of_type(RouteType::Flight)
                .or_else(|| self.plan.routes().last())
                .ok_or("no route has been received (13001)")?,
        };
        Ok((route.clone(), mapping::plan::route_type(route)))
    }

    /// A mode command that needs another route aboard first: the latest of a type, or what 13000 has loaded.
    pub(crate) fn load_and_fly(
        &mut self,
        desk: &mut Desk<'_>,
        origin: Option<Origin>,
        route_type: Option<RouteType>,
        command: &VehicleOperatingModeCommand,
    ) {
        if let Err(why) = self.may_change_mission() {
            return self.refuse(desk, origin, why);
        }
        let transfer = match (route_type, &self.chosen) {
            (Some(route_type), _) => self
                .plan
                .route_of_type(route_type)
                .map(|route| Transfer::new(desk.now.mono, route, route_type)),
            (None, Some(chosen)) => Some(Transfer::again(chosen)),
            (None, None) => None,
        };
        let Some(transfer) = transfer else {
            let why = "no such route has been received (13001)".to_owned();
            return self.refuse(desk, origin, why);
        };
        self.load = Some(Load {
            work: Work::Transfer(transfer),
            origin: None,
            mission_name: self
                .chosen
                .as_ref()
                .map_or_else(String::new, |chosen| chosen.mission_name.clone()),
            then: Some((origin, command.clone())),
        });
        self.go_on(desk);
    }

    pub(super) fn may_change_mission(&self) -> Result<(), String> {
        if !self.mav.live() {
            return Err("the vehicle is silent: nothing can be loaded".to_owned());
        }
        if self.load.is_some() || self.fence.busy() || self.mav.missions.busy().is_some() {
            return Err("another transfer is in progress".to_owned());
        }
        Ok(())
    }

    fn clear(&mut self, desk: &mut Desk<'_>, origin: Origin, name: String) {
        let begun = self.may_change_mission().and_then(|()| {
            self.begin_clearing(desk.now)
                .map_err(|fault| format!("the mission service is {fault}"))
        });
        if let Err(why) = begun {
            return self.reject(desk, origin, &name, Mode::Clear, None, why);
        }
        self.load = Some(Load {
            work: Work::Clear,
            origin: Some(origin),
            mission_name: name,
            then: None,
        });
    }

    fn cancel(&mut self, desk: &mut Desk<'_>, origin: Origin, name: &str) {
        if let Some(mut load) = self.load.take() {
            match &mut load.work {
                Work::Transfer(transfer) => {
                    if transfer.cancel(desk.now.mono, &mut self.mav) {
                        self.forget_aboard(desk);
                    }
                }
                Work::Clear => self.mav.missions.cancel(),
            }
            self.end_load(desk, load, None, "cancelled".to_owned());
        }
        desk.acknowledge(self.id(), &origin, AckType::CarriedOut);
        self.report(
            desk,
            origin.station,
            name,
            Mode::Cancel,
            MissionTransferStatus::Complete,
            100,
            None,
        );
    }

    /// The plan as the CUCS sent it, in its own numbers; one waypoint where a number is given. Of the route that 13000
    /// has loaded it is what went aboard, not what has been sent since; of the others what they would be loaded as.
    fn download(&mut self, desk: &mut Desk<'_>, origin: Origin, name: &str, waypoint: Option<u16>) {
        let mode = if waypoint.is_some() {
            Mode::DownloadWaypoint
        } else {
            Mode::Download
        };
        let chosen = self.chosen.as_ref().map(|chosen| &chosen.plan);
        let beside = chosen
            .filter(|chosen| !chosen.is_empty())
            .map(|chosen| self.plan.beside(chosen));
        let plan = beside.as_ref().unwrap_or(&self.plan);
        let wanted: VecDeque<Message> = match waypoint {
            None => plan.messages().collect(),
            Some(number) if plan.waypoint(number).is_some() => {
                plan.messages_about(number).collect()
            }
            // Received, and no route leads to it yet.
            Some(number) => self.plan.messages_about(number).collect(),
        };
        if wanted.is_empty() {
            let why = match waypoint {
                Some(number) => format!("waypoint {number} has not been received"),
                None => "there is no plan".to_owned(),
            };
            return self.reject(desk, origin, name, mode, waypoint, why);
        }
        if self.download.is_some() {
            return self.reject(
                desk,
                origin,
                name,
                mode,
                waypoint,
                "another download is in progress".to_owned(),
            );
        }
        self.download = Some(Download {
            origin,
            name: name.to_owned(),
            mode,
            left: wanted,
            next_at: desk.now.mono,
        });
        self.advance_download(desk);
    }

    /// Sends the next few messages of a download: a full plan at once would overflow the station's socket.
    pub(super) fn advance_download(&mut self, desk: &mut Desk<'_>) {
        let id = self.id();
        let Some(download) = &mut self.download else {
            return;
        };
        if download.next_at > desk.now.mono {
            return;
        }
        download.next_at = desk.now.mono + DOWNLOAD_PAUSE;
        let origin = download.origin;
        let few = download.left.len().min(DOWNLOAD_BURST);
        let burst: Vec<Message> = download.left.drain(..few).collect();
        let Some(cucs) = desk
            .stations
            .get(origin.station)
            .map(|station| station.id())
        else {
            return;
        };
        for message in burst {
            let message = restamped(message, desk, cucs, id);
            desk.send(origin.station, id, &message);
        }
        if download.left.is_empty()
            && let Some(Download {
                origin, name, mode, ..
            }) = self.download.take()
        {
            desk.acknowledge(id, &origin, AckType::CarriedOut);
            self.report(
                desk,
                origin.station,
                &name,
                mode,
                MissionTransferStatus::Complete,
                100,
                None,
            );
        }
    }

    // --- the vehicle's side of it ---------------------------------------------------------------------------------

    pub(crate) fn advance_load(&mut self, desk: &mut Desk<'_>) {
        let Some(Load {
            work: Work::Transfer(transfer),
            ..
        }) = &mut self.load
        else {
            return;
        };
        // A mode on its way in must be seen before another plan goes up: it could be flown at once.
        if self.maneuver.is_some() && transfer.has_not_begun() {
            return;
        }
        let held = transfer.held;
        let course = transfer.advance(desk.now.mono, &self.plan, &self.bounds, &mut self.mav);
        if transfer.held && !held {
            let text = "the vehicle flies its mission: it is put on hold (mode 12) while another plan goes aboard";
            self.advise(desk, text.to_owned());
        }
        self.follow(desk, course);
    }

    pub(crate) fn load_sees_command(&mut self, desk: &mut Desk<'_>, event: &command::Event) {
        let Some(Load {
            work: Work::Transfer(transfer),
            ..
        }) = &mut self.load
        else {
            return;
        };
        let course = transfer.handle_command(desk.now.mono, event, &self.mav);
        self.follow(desk, course);
    }

    pub(crate) fn load_sees_mission(&mut self, desk: &mut Desk<'_>, event: mission::Event) {
        match (&mut self.load, event) {
            (
                Some(Load {
                    work: Work::Transfer(transfer),
                    ..
                }),
                event,
            ) => {
                let course = transfer.handle_mission(desk.now.mono, event, &mut self.mav);
                self.follow(desk, course);
            }
            (
                Some(Load {
                    work: Work::Clear, ..
                }),
                mission::Event::Cleared { .. },
            ) => self.cleared(desk),
            (
                Some(Load {
                    work: Work::Clear, ..
                }),
                mission::Event::Failed {
                    operation: Operation::Clear,
                    reason,
                    ..
                },
            ) => {
                if let Some(load) = self.load.take() {
                    self.end_load(desk, load, None, format!("clear: {}", explain(&reason)));
                }
                if reason != Failure::Cancelled {
                    self.forget_aboard(desk);
                }
            }
            _ => {}
        }
    }

    fn follow(&mut self, desk: &mut Desk<'_>, course: Course) {
        match course {
            Course::Going => {}
            Course::Percent(percent) => {
                let Some(Load {
                    origin: Some(origin),
                    mission_name,
                    ..
                }) = &self.load
                else {
                    return;
                };
                let (station, name) = (origin.station, mission_name.clone());
                let status = MissionTransferStatus::InProgress;
                self.report(desk, station, &name, Mode::Load, status, percent, None);
            }
            Course::Done { flight, mission_id } => {
                let Some(load) = self.load.take() else { return };
                let Work::Transfer(transfer) = &load.work else {
                    return;
                };
                let route_type = transfer.route_type;
                let mission_name = load.mission_name.clone();
                let plan = transfer.plan.clone();
                if flight
                    .order
                    .iter()
                    .any(|leg| matches!(leg.level, Level::AboveHome(_)))
                {
                    self.say_agl(desk);
                }
                for note in &flight.notes {
                    self.advise(desk, note.clone());
                }
                let same = self
                    .aboard
                    .as_ref()
                    .is_some_and(|aboard| aboard.flight.items == flight.items);
                if !same {
                    self.passage.begin(&self.mav.telemetry);
                }
                self.aboard = Some(Aboard {
                    flight,
                    mission_id,
                    route_type,
                    mission_name,
                    plan,
                });
                // Only 13000 chooses; a route that a mode needed, or that was chosen before, is aboard for that.
                if load.origin.is_some() || again(&self.chosen, &self.aboard) {
                    self.chosen.clone_from(&self.aboard);
                }
                // What is answered as loaded must still be known after a crash.
                match self.save_aboard(desk) {
                    Ok(()) => self.loaded(desk, load),
                    Err(fault) => {
                        let why = format!("the route is aboard, but cannot be stored: {fault}");
                        self.end_load(desk, load, None, why);
                    }
                }
            }
            Course::Refused {
                waypoint,
                why,
                touched,
            } => {
                let Some(load) = self.load.take() else { return };
                if touched {
                    if load.origin.is_some() {
                        self.chosen = None;
                    }
                    self.forget_aboard(desk);
                }
                self.end_load(desk, load, waypoint, why);
            }
        }
    }

    fn loaded(&mut self, desk: &mut Desk<'_>, load: Load) {
        if load.then.is_none() && load.held() {
            let text = "another plan is aboard, and the vehicle holds (mode 12): mode 11 flies it";
            self.advise(desk, text.to_owned());
        }
        if load.is_unasked() {
            self.advise(desk, "the loaded plan is aboard again".to_owned());
        }
        if let Some(origin) = load.origin {
            desk.acknowledge(self.id(), &origin, AckType::CarriedOut);
            let status = MissionTransferStatus::Complete;
            self.report(
                desk,
                origin.station,
                &load.mission_name,
                Mode::Load,
                status,
                100,
                None,
            );
        }
        if let Some((origin, command)) = load.then {
            self.operate(desk, origin, &command);
        }
    }

    fn cleared(&mut self, desk: &mut Desk<'_>) {
        let Some(load) = self.load.take() else { return };
        self.plan.clear();
        self.aboard = None;
        self.chosen = None;
        let cucs = load
            .origin
            .and_then(|origin| desk.stations.get(origin.station))
            .map(|station| station.id());
        let saved = self
            .save_plan(desk, cucs.unwrap_or(Id::NULL))
            .and_then(|()| self.save_aboard(desk));
        if let Err(fault) = saved {
            let why = format!("the vehicle is cleared, but that cannot be stored: {fault}");
            return self.end_load(desk, load, None, why);
        }
        if let Some(origin) = load.origin {
            desk.acknowledge(self.id(), &origin, AckType::CarriedOut);
            let status = MissionTransferStatus::Complete;
            self.report(
                desk,
                origin.station,
                &load.mission_name,
                Mode::Clear,
                status,
                100,
                None,
            );
        }
    }

    fn end_load(&mut self, desk: &mut Desk<'_>, load: Load, waypoint: Option<u16>, why: String) {
        let why = if load.held() {
            format!("{why}; the vehicle was put on hold (mode 12) for it")
        } else {
            why
        };
        let mode = match load.work {
            Work::Transfer(_) => Mode::Load,
            Work::Clear => Mode::Clear,
        };
        if load.is_unasked() {
            let text = format!("the loaded plan is not aboard any more: {why}");
            self.tell_once(desk, AlertPriority::Warning, text);
        }
        if let Some((origin, _)) = load.then {
            self.refuse(desk, origin, why.clone());
        }
        if let Some(origin) = load.origin {
            self.reject(desk, origin, &load.mission_name, mode, waypoint, why);
        }
    }

    /// The vehicle may hold something else than what was loaded: nothing is flown before the next load.
    fn forget_aboard(&mut self, desk: &mut Desk<'_>) {
        self.aboard = None;
        if let Err(fault) = self.save_aboard(desk) {
            self.warn(
                desk,
                Cause::Store,
                format!("the plan cannot be stored: {fault}"),
            );
        }
    }

    /// 14000 with status 2, and 16000 with the reason.
    fn reject(
        &mut self,
        desk: &mut Desk<'_>,
        origin: Origin,
        name: &str,
        mode: Mode,
        waypoint: Option<u16>,
        why: String,
    ) {
        self.report(
            desk,
            origin.station,
            name,
            mode,
            MissionTransferStatus::Aborted,
            0,
            waypoint,
        );
        self.refuse(desk, Some(origin), why);
    }

    #[expect(clippy::too_many_arguments, reason = "the fields of 14000")]
    fn report(
        &mut self,
        desk: &mut Desk<'_>,
        station: usize,
        name: &str,
        mode: Mode,
        status: MissionTransferStatus,
        percent: u8,
        waypoint: Option<u16>,
    ) {
        let message = MissionUploadDownloadStatus {
            time_stamp: Some(desk.stamp()),
            mission_id: Some(Text::new(name)),
            status: Some(status),
            percent_complete: Some(percent),
            waypoint_request: waypoint,
            mission_plan_mode: Some(mode),
        };
        desk.send(
            station,
            self.id(),
            &Message::MissionUploadDownloadStatus(message),
        );
    }

    // --- records ----------------------------------------------------------------------------------------------------

    fn save_plan(&self, desk: &mut Desk<'_>, cucs: Id) -> Result<(), StoreError> {
        let octets = plan_record::encode_plan(&self.plan, cucs, self.id());
        desk.store.save(
            &record_name("plan", self.id()),
            &octets,
            Durability::Process,
        )
    }

    fn save_aboard(&self, desk: &mut Desk<'_>) -> Result<(), StoreError> {
        for (kind, route) in [("chosen", &self.chosen), ("aboard", &self.aboard)] {
            let octets = route.as_ref().map_or_else(Vec::new, |route| {
                plan_record::encode_aboard(route, self.id())
            });
            desk.store
                .save(&record_name(kind, self.id()), &octets, Durability::Power)?;
        }
        Ok(())
    }

    /// What a restart finds: authority, plan, and what is aboard.
    ///
    /// # Errors
    /// A record is there and cannot be read: starting without it would lose what was promised.
    pub(crate) fn restore(&mut self, desk: &mut Desk<'_>) -> Result<(), StoreError> {
        let id = self.id();
        let unreadable = |kind: &str, cause: String| StoreError {
            name: record_name(kind, id),
            cause,
        };
        self.restore_authority(desk)?;
        if let Some(octets) = desk
            .store
            .load(&record_name("plan", id))?
            .filter(|octets| !octets.is_empty())
        {
            self.plan = plan_record::decode_plan(&octets, id)
                .map_err(|cause| unreadable("plan", cause.to_string()))?;
        }
        for (kind, route) in [("aboard", &mut self.aboard), ("chosen", &mut self.chosen)] {
            let octets = desk.store.load(&record_name(kind, id))?;
            if let Some(octets) = octets.filter(|octets| !octets.is_empty()) {
                let read = plan_record::decode_aboard(&octets, id)
                    .map_err(|cause| unreadable(kind, cause.to_string()))?;
                *route = Some(read);
            }
        }
        self.restore_fence(desk)?;
        self.restore_altimeter(desk)
    }
}

/// Whether what is aboard now is what was chosen before, as it was.
fn again(chosen: &Option<Aboard>, aboard: &Option<Aboard>) -> bool {
    match (chosen, aboard) {
        (Some(chosen), Some(aboard)) => {
            chosen.route_type == aboard.route_type && chosen.flight.items == aboard.flight.items
        }
        _ => false,
    }
}

/// A stored message as the VSM sends it: its own stamp; 50001 names vehicle and CUCS as its wrapper does.
fn restamped(message: Message, desk: &mut Desk<'_>, cucs: Id, vehicle: Id) -> Message {
    let stamp = desk.stamp();
    match message {
        Message::UaRoute(mut route) => {
            route.time_stamp = Some(stamp);
            Message::UaRoute(route)
        }
        Message::UaPositionWaypoint(mut waypoint) => {
            waypoint.time_stamp = Some(stamp);
            Message::UaPositionWaypoint(waypoint)
        }
        Message::UaLoiterWaypoint(mut loiter) => {
            loiter.time_stamp = Some(stamp);
            Message::UaLoiterWaypoint(loiter)
        }
        Message::CurveSegment(mut curve) => {
            curve.time_stamp = Some(stamp);
            Message::CurveSegment(curve)
        }
        Message::CurveSegmentPaper(curve) => Message::CurveSegmentPaper(CurveSegmentPaper {
            time_stamp: Some(stamp.0 as f64),
            vehicle_id: Some(vehicle),
            cucs_id: Some(cucs),
            ..curve
        }),
        other => other,
    }
}
