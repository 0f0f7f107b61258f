//! Commands of the CUCS that has the right to give them: 2016, 2017, and where plans go.

use mapping::mode::Px4Mode;
use stanag_msgs::Message;
use stanag_msgs::enums::{AckType, AltitudeType, FlightPathControlMode as Mode, LoiBitmap};
use stanag_msgs::messages::VehicleOperatingModeCommand;

use super::aircraft::Aircraft;
use super::authority::{Rights, Stations};
use super::desk::{Desk, Origin};
use super::ignored_fields;
use super::maneuver::{self, Maneuver, Progress};
use super::mission_transfer::Load;
use super::mode_command::{self, Situation, Task};
use super::plan_record::UploadedMission;

impl Aircraft {
    /// The rights that a message needs; `None` where it is none that a CUCS commands with.
    pub(super) fn right_for(&self, message: &Message) -> Option<LoiBitmap> {
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
            Message::EngineCommand(_) => Some(LoiBitmap::LOI5),
            Message::LoiterConfiguration(_)
            | Message::UaStickCommand(_)
            | Message::UnmannedAircraftLights(_)
            | Message::MissionTransferCommand(_)
            | Message::UaRoute(_)
            | Message::UaPositionWaypoint(_)
            | Message::UaLoiterWaypoint(_)
            | Message::CurveSegment(_)
            | Message::CurveSegmentPaper(_)
            | Message::ParameterSetCommand(_)
            | Message::AreaVertex(_)
            | Message::AreaTransferCommand(_) => Some(LoiBitmap::LOI4),
            Message::ParameterRequest(_)
            | Message::PingRequest(_)
            | Message::SubsystemStatusRequest(_)
            | Message::SubsystemStatusDetailRequest(_) => Some(LoiBitmap::LOI2),
            _ => None,
        }
    }

    /// A command of a CUCS that holds the right for it.
    pub(super) fn command(&mut self, desk: &mut Desk<'_>, origin: Origin, message: &Message) {
        self.say_unused(desk, &origin, message);
        match message {
            Message::VehicleOperatingModeCommand(command) => {
                desk.acknowledge(self.id(), &origin, AckType::Received);
                self.operate(desk, Some(origin), command);
            }
            Message::LoiterConfiguration(configuration) => {
                self.configure_loiter(desk, origin, configuration)
            }
            Message::UaStickCommand(sticks) => self.take_sticks(desk, origin, sticks),
            Message::EngineCommand(command) => self.command_engine(desk, origin, command),
            Message::UnmannedAircraftLights(lights) => self.command_lights(desk, origin, lights),
            Message::MissionTransferCommand(command) => {
                self.transfer_command(desk, origin, command)
            }
            Message::ParameterRequest(request) => self.request_parameter(desk, origin, request),
            Message::ParameterSetCommand(command) => self.set_parameter(desk, origin, command),
            Message::PingRequest(request) => self.ping(desk, origin, request),
            Message::SubsystemStatusRequest(request) => {
                self.subsystem_status(desk, origin, request)
            }
            Message::SubsystemStatusDetailRequest(request) => {
                self.subsystem_detail(desk, origin, request)
            }
            Message::AreaVertex(vertex) => self.store_area(desk, origin, vertex),
            Message::AreaTransferCommand(command) => self.transfer_areas(desk, origin, command),
            other => self.store_plan_message(desk, origin, other),
        }
    }

    /// A 2016; without origin it is the VSM's own.
    pub(super) fn operate(
        &mut self,
        desk: &mut Desk<'_>,
        origin: Option<Origin>,
        command: &VehicleOperatingModeCommand,
    ) {
        self.operate_with(desk, origin, command, false);
    }

    /// The same, where `just_loaded` says that the route aboard was put there for it.
    pub(super) fn operate_with(
        &mut self,
        desk: &mut Desk<'_>,
        origin: Option<Origin>,
        command: &VehicleOperatingModeCommand,
        just_loaded: bool,
    ) {
        if !self.mav.live() {
            let text = "the vehicle is silent: no command can be confirmed".to_owned();
            return self.refuse(desk, origin, text);
        }
        let altimeter = match self.altimeter_of(command) {
            Ok(altimeter) => altimeter,
            Err(why) => return self.refuse(desk, origin, why),
        };
        let waits = |load: &Load| load.waiting_command().is_some();
        let enters = |(_, maneuver): &(_, Maneuver)| maneuver.enters_a_mode();
        let situation = Situation {
            telemetry: &self.mav.telemetry,
            aboard: self.aboard.as_ref(),
            loaded_mission: self.loaded_mission.as_ref(),
            plan: &self.plan,
            just_loaded,
            entering: self.load.as_ref().is_some_and(waits)
                || self.maneuver.as_ref().is_some_and(enters),
            loiter: &self.loiter,
            commanded: self.commanded,
            agl: self.bounds.agl,
            altimeter,
            limits: self.bounds.limits,
            performance: self.performance(),
        };
        let task = mode_command::task(command, &situation);
        let mode = mode_command::mode_of(command, &self.mav.telemetry);
        // What is refused changes nothing: the setting is kept only now.
        let task = task.and_then(|task| self.set_altimeter(desk, origin, altimeter).map(|()| task));
        if task.is_ok()
            && command.commanded_altitude.is_some()
            && command.altitude_type == Some(AltitudeType::Agl)
        {
            self.say_agl(desk);
        }
        if let (Ok(task), Some(origin), Some(mode)) = (&task, origin, mode) {
            let names = ignored_fields::ignored_fields(
                command,
                mode,
                task.flies_a_route(self.mav.telemetry.mode),
            );
            self.say_unheeded(desk, &origin, &names, &format!(" in mode {}", mode.raw()));
        }
        let anew = mode_command::flies_anew(command, &self.mav.telemetry)
            && command.select_flight_path_control_mode == Some(Mode::Waypoint);
        match task {
            Err(why) => self.refuse(desk, origin, why),
            Ok(Task::Nothing) => {
                if let Some(origin) = origin {
                    desk.acknowledge(self.id(), &origin, AckType::CarriedOut);
                }
            }
            Ok(Task::Steps(steps, commanded)) => {
                let needs_mission = steps
                    .iter()
                    .any(|step| matches!(step, maneuver::Step::SetCurrent(_)));
                if self.load.is_some()
                    && (needs_mission
                        || maneuver::mode_after(&steps, None) == Some(Px4Mode::MISSION))
                {
                    return self.refuse(
                        desk,
                        origin,
                        "a route is on its way aboard: wait for 14000".to_owned(),
                    );
                }
                if self.fence.busy() && needs_mission {
                    let why = "a fence is on its way aboard: wait for 50018".to_owned();
                    return self.refuse(desk, origin, why);
                }
                if anew && self.route_progress.was_flown() {
                    let loops = |aboard: &UploadedMission| aboard.compiled.circuit().is_some();
                    let once = if self.aboard.as_ref().is_some_and(loops) {
                        ", its loop only once: PX4 has counted it; clear and load the route for more"
                    } else {
                        ""
                    };
                    let text = format!(
                        "mode 11: the route has been flown to its end, it is flown again from its start{once}"
                    );
                    self.advise(desk, text);
                }
                self.begin(desk, origin, Maneuver::new(steps, commanded));
            }
            Ok(Task::Launch(steps, commanded)) => {
                let maneuver = Maneuver::new(steps, commanded).undone_by(maneuver::arm(false));
                self.begin(desk, origin, maneuver);
            }
            Ok(Task::Manual) => self.fly_by_hand(desk, origin),
            Ok(Task::Steer(order, commanded)) => self.steer(desk, origin, order, commanded),
            Ok(Task::Load(route)) => self.load_and_fly(desk, origin, Some(route), command),
            Ok(Task::Reload) => self.load_and_fly(desk, origin, None, command),
        }
    }

    pub(super) fn begin(
        &mut self,
        desk: &mut Desk<'_>,
        origin: Option<Origin>,
        maneuver: Maneuver,
    ) {
        self.stop_running(desk);
        self.maneuver = Some((origin, maneuver));
        self.run_until_idle(desk);
    }

    /// Ends what runs, for a later command.
    pub(super) fn stop_running(&mut self, desk: &mut Desk<'_>) {
        self.end_running(desk, "superseded by a later command", |_, _| true);
    }

    /// Ends what a CUCS began that no longer controls the vehicle: nothing is gone on with that it could not
    /// command now.
    pub(super) fn end_commands_without_right(&mut self, desk: &mut Desk<'_>) {
        let controller = self.authority.controller();
        let why = match controller {
            Some(id) => format!("{id} controls the vehicle now"),
            None => "its sender does not control the vehicle any more, nobody does".to_owned(),
        };
        self.end_running(desk, &why, |desk, origin| {
            origin.is_some_and(|origin| {
                desk.asker(origin.station).map(|asker| asker.id) != controller
            })
        });
    }

    fn end_running(
        &mut self,
        desk: &mut Desk<'_>,
        why: &str,
        ends: impl Fn(&Desk<'_>, Option<Origin>) -> bool,
    ) {
        if let Some((origin, mut running)) = self.maneuver.take() {
            if ends(desk, origin) {
                running.abandon(desk.now.mono, &mut self.mav);
                self.let_go();
                self.watch_commanded();
                self.refuse(desk, origin, why.to_owned());
            } else {
                self.maneuver = Some((origin, running));
            }
        }
        // A command that waits for its route to be aboard has not begun, and must not begin later.
        if let Some(load) = &mut self.load
            && load
                .waiting_command()
                .is_some_and(|origin| ends(desk, origin))
            && let Some(origin) = load.drop_command()
        {
            self.refuse(desk, origin, why.to_owned());
        }
    }

    /// Ends streams whose mode was not entered; within their mode they must not starve.
    fn let_go(&mut self) {
        let mode = self.mav.telemetry.mode;
        if mode != Some(Px4Mode::POSCTL) {
            self.sticks.release();
        }
        if mode != Some(Px4Mode::OFFBOARD) {
            self.steering.release();
        }
    }

    /// Refuses a command: 17000 where it was asked for, 16000 with the reason to who commanded.
    pub(super) fn refuse(&mut self, desk: &mut Desk<'_>, origin: Option<Origin>, why: String) {
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
        self.tell_stations(desk, &to, text);
    }

    /// Refuses a message of a CUCS that does not hold the right it needs.
    pub(super) fn refuse_without_right(
        &mut self,
        desk: &mut Desk<'_>,
        origin: &Origin,
        right: LoiBitmap,
    ) {
        desk.counters.count("without the right");
        let held = desk
            .asker(origin.station)
            .map_or(Rights::NONE, |asker| self.authority.held(asker.id));
        let needed = Rights::named(right, Stations::NONE);
        self.refuse_foreign(desk, origin, format!("it needs {needed}, held is {held}"));
    }

    /// Refuses a message that any listed CUCS may send, with any right or none: of many that are alike the reason is
    /// told now and then, since nothing keeps a station from sending them.
    pub(super) fn refuse_foreign(&mut self, desk: &mut Desk<'_>, origin: &Origin, why: String) {
        desk.acknowledge(self.id(), origin, AckType::Refused);
        let Some(asker) = desk.asker(origin.station) else {
            return;
        };
        let text = format!("{} of {} refused: {why}", origin.message_type, asker.id);
        let to = [origin.station];
        let raised = self.alerts.answer_sometimes(desk.now.mono, &to, text);
        desk.alert(self.id(), &to, raised);
    }

    /// Clears the answers that have stood long enough.
    pub(super) fn clear_answers(&mut self, desk: &mut Desk<'_>) {
        while let Some((to, raised)) = self.alerts.next_over(desk.now.mono) {
            desk.show(self.id(), &to, &raised);
        }
    }

    pub(super) fn advance_maneuver(&mut self, desk: &mut Desk<'_>) {
        let Some((origin, maneuver)) = &mut self.maneuver else {
            return;
        };
        let origin = *origin;
        match maneuver.advance(desk.now.mono, &mut self.mav) {
            Progress::Going => {}
            Progress::Done => {
                self.commanded = maneuver.commanded;
                self.maneuver = None;
                self.keep_commanded();
                if let Some(origin) = origin {
                    desk.acknowledge(self.id(), &origin, AckType::CarriedOut);
                }
            }
            Progress::Refused(why) => self.fail_maneuver(desk, origin, why),
        }
    }

    pub(super) fn fail_maneuver(
        &mut self,
        desk: &mut Desk<'_>,
        origin: Option<Origin>,
        why: String,
    ) {
        if let Some((_, mut maneuver)) = self.maneuver.take() {
            maneuver.abandon(desk.now.mono, &mut self.mav);
        }
        self.let_go();
        self.watch_commanded();
        self.refuse(desk, origin, why);
    }
}
