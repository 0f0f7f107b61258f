//! Loading (13000 mode 2): which route, how it goes on, and what follows from its end.

use mapping::altitude::Level;
use mapping::mode::Px4Mode;
use mapping::route::{CompiledMission, Site};
use mavlink_link::dialect::MissionState;
use mavlink_link::service::command;
use stanag_msgs::enums::{MissionPlanMode as Mode, MissionTransferStatus, RouteType};
use stanag_msgs::messages::{UaRoute, VehicleOperatingModeCommand};

use super::{Load, Work, not_received};
use crate::session::aircraft::Aircraft;
use crate::session::desk::{Desk, Origin};
use crate::session::plan_record::UploadedMission;
use crate::session::transfer::{Course, Transfer};

impl Aircraft {
    pub(super) fn load(
        &mut self,
        desk: &mut Desk<'_>,
        origin: Origin,
        name: String,
        route_id: Option<&str>,
    ) {
        if let Err(why) = self.may_change_mission() {
            return self.reject(desk, origin, &name, Mode::Load, None, why);
        }
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
        self.run_until_idle(desk);
    }

    /// The route that a load means: the one named, else the latest flight route, else the latest of all.
    fn route_to_load(&self, route_id: Option<&str>) -> Result<(UaRoute, RouteType), String> {
        let route = match route_id {
            Some(id) => self.plan.route_named(id).ok_or_else(|| not_received(id))?,
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
        let transfer = match (route_type, &self.loaded_mission) {
            (Some(route_type), _) => self
                .plan
                .route_of_type(route_type)
                .map(|route| Transfer::new(desk.now.mono, route, route_type)),
            (None, Some(loaded_mission)) => Some(Transfer::again(loaded_mission)),
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
                .loaded_mission
                .as_ref()
                .map_or_else(String::new, |loaded_mission| {
                    loaded_mission.mission_name.clone()
                }),
            then: Some((origin, command.clone())),
        });
        self.run_until_idle(desk);
    }

    /// What the vehicle has told of where it is and what it can; `None` before it has told its home.
    fn site(&self) -> Option<Site> {
        let telemetry = &self.mav.telemetry;
        Some(Site {
            home: telemetry.home?,
            geoid_m: telemetry.geoid_m,
            agl: self.bounds.agl,
            altimeter: self.bounds.altimeter,
            hovers: telemetry.hovers(),
            limits: self.bounds.limits,
            performance: self.performance(),
            curving: self.bounds.curving,
        })
    }

    /// Lets a load take its next step.
    pub(crate) fn advance_load(&mut self, desk: &mut Desk<'_>) {
        if self.load.is_none() {
            return;
        }
        let (site, learning) = (self.site(), self.learns_performance());
        let Some(Load {
            work: Work::Transfer(transfer),
            ..
        }) = &mut self.load
        else {
            return;
        };
        // It bounds the route.
        if learning && transfer.may_wait(desk.now.mono) {
            return;
        }
        // A mode on its way in must be seen before another plan goes up: it could be flown at once.
        if self.maneuver.is_some() && transfer.has_not_begun() {
            return;
        }
        let held = transfer.held;
        let course = transfer.advance(desk.now.mono, &self.plan, site.as_ref(), &mut self.mav);
        if transfer.held && !held {
            let text = "the vehicle flies its mission: it is put on hold (mode 12) while another plan goes aboard";
            self.advise(desk, text.to_owned());
        }
        self.follow(desk, course);
    }

    /// The end of a command, while the vehicle is put on hold for a load.
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

    /// What a load has come to.
    pub(super) fn follow(&mut self, desk: &mut Desk<'_>, course: Course) {
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
            Course::Done {
                compiled,
                mission_id,
            } => self.is_aboard(desk, compiled, mission_id),
            Course::Refused {
                waypoint,
                why,
                touched,
            } => {
                let Some(load) = self.load.take() else { return };
                if touched {
                    if load.origin.is_some() {
                        self.loaded_mission = None;
                    }
                    self.forget_aboard(desk);
                }
                self.end_load(desk, load, waypoint, why);
            }
        }
    }

    /// A route is aboard, as the vehicle itself says.
    fn is_aboard(&mut self, desk: &mut Desk<'_>, compiled: CompiledMission, mission_id: u32) {
        let Some(load) = self.load.take() else { return };
        let Work::Transfer(transfer) = &load.work else {
            return;
        };
        let route_type = transfer.route_type;
        let mission_name = load.mission_name.clone();
        let plan = transfer.plan.clone();
        if compiled
            .order
            .iter()
            .any(|leg| matches!(leg.level, Level::AboveHome(_)))
        {
            self.say_agl(desk);
        }
        for note in &compiled.notes {
            self.advise(desk, note.clone());
        }
        let same = self
            .aboard
            .as_ref()
            .is_some_and(|aboard| aboard.compiled.items == compiled.items);
        if !same {
            self.route_progress.begin(&self.mav.telemetry);
        } else if load.origin.is_some() {
            self.say_where_it_goes_on(desk, &compiled);
        }
        self.aboard = Some(UploadedMission {
            compiled,
            mission_id,
            route_type,
            mission_name,
            plan,
        });
        // Only 13000 chooses; a route that a mode needed, or that was loaded_mission before, is aboard for that.
        if load.origin.is_some() || again(&self.loaded_mission, &self.aboard) {
            self.loaded_mission.clone_from(&self.aboard);
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

    /// PX4 applies nothing of a plan that it holds already: what has been flown of it is not flown again.
    fn say_where_it_goes_on(&mut self, desk: &mut Desk<'_>, compiled: &CompiledMission) {
        let telemetry = &self.mav.telemetry;
        let begun = |state| state != MissionState::MISSION_STATE_COMPLETE;
        let mission = telemetry.mission.filter(|mission| {
            telemetry.mode != Some(Px4Mode::MISSION)
                && mission.seq > compiled.place_from(0)
                && begun(mission.state)
        });
        let Some(mission) = mission else { return };
        if let Some(number) = compiled.waypoint_of.get(usize::from(mission.seq)) {
            let text = format!(
                "the vehicle holds this plan already: mode 11 goes on to waypoint {number}, unless another is commanded"
            );
            self.advise(desk, text);
        }
    }

    /// Answers whoever asked, and flies it where that was meant.
    fn loaded(&mut self, desk: &mut Desk<'_>, load: Load) {
        if load.then.is_none() && load.held() {
            let text = "another plan is aboard, and the vehicle holds (mode 12): mode 11 flies it";
            self.advise(desk, text.to_owned());
        }
        if load.is_unasked() {
            self.advise(desk, "the loaded plan is aboard again".to_owned());
        }
        if let Some(origin) = load.origin {
            self.complete(desk, &origin, &load.mission_name, Mode::Load);
        }
        if let Some((origin, command)) = load.then {
            self.operate_with(desk, origin, &command, true);
        }
    }
}

/// Whether what is aboard now is what was loaded_mission before, as it was.
fn again(loaded_mission: &Option<UploadedMission>, aboard: &Option<UploadedMission>) -> bool {
    match (loaded_mission, aboard) {
        (Some(loaded_mission), Some(aboard)) => {
            loaded_mission.route_type == aboard.route_type
                && loaded_mission.compiled.items == aboard.compiled.items
        }
        _ => false,
    }
}
