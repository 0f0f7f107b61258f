//! The commands of a CUCS, as they arrive: 2007, 2008, 2010, 2016, 2017 and 50023.
//!
//! A 2016 is decided in `mode_command`; what is here carries the decision out, or refuses with its reason.

use mapping::altitude::{Agl, Altimeter};
use mapping::configuration::changes;
use mapping::mode::Px4Mode;
use mapping::report::Commanded;
use mapping::telemetry::Health;
use stanag_msgs::Message;
use stanag_msgs::enums::{AckType, AltitudeType, FlightPathControlMode as Mode, RouteType};
use stanag_msgs::messages::{
    EngineCommand, LoiterConfiguration, UaStickCommand, VehicleOperatingModeCommand,
};

use super::repeated::{NOT_NEW, Repetition};
use super::situation::{Situation, Task};
use super::sticks::{SEEN_WITHIN, lost_within};
use super::{Context, Flight, engine, mode_command, settings, situation, steering};
use crate::config::LinkAddress;
use crate::session::context::Origin;
use crate::session::effects::{Effects, Request};
use crate::session::ignored_fields;
use crate::session::maneuver::{self, Maneuver, Step};

/// Commands, as they arrive.
impl Flight {
    pub(super) fn command(
        &mut self,
        context: &Context<'_>,
        origin: Origin,
        message: &Message,
        effects: &mut Effects<'_>,
    ) {
        match message {
            Message::VehicleOperatingModeCommand(command) => {
                // 17000 type 1 at once; type 2 or 3 follows when the vehicle has reported the outcome.
                effects.acknowledge(&origin, AckType::Received);
                self.operate(context, Some(origin), command, false, effects);
            }
            Message::LoiterConfiguration(new) => {
                self.configure_loiter(context, origin, new, effects);
            }
            Message::UaStickCommand(sticks) => {
                self.take_sticks(context, origin, sticks, effects);
            }
            Message::EngineCommand(command) => {
                self.command_engine(context, origin, command, effects);
            }
            Message::Contingency(set) => {
                self.provision_contingency(context, origin, set, effects);
            }
            _ => {
                let why = mapping::support::why_refused(message.id());
                effects.refuse(Some(origin), why.unwrap_or("it is not supported"));
            }
        }
    }

    /// 2017.
    fn configure_loiter(
        &mut self,
        context: &Context<'_>,
        origin: Origin,
        new: &LoiterConfiguration,
        effects: &mut Effects<'_>,
    ) {
        let airframe = context.vehicle.telemetry.airframe();
        let merged = match settings::merged(&self.loiter, new, airframe) {
            Ok(merged) => merged,
            Err(why) => return effects.refuse(Some(origin), why),
        };
        if merged != self.loiter {
            self.repeated.reopen();
        }
        let changed = changes::loiter(&merged, &self.loiter).collect();
        // A setting is only stored: 17000 type 2 comes at once, and the next loiter (2016 mode 12) flies by it.
        self.loiter = merged;
        effects.acknowledge(&origin, AckType::CarriedOut);
        effects.request(Request::Configured {
            changed,
            by: Some(origin.station),
        });
    }

    /// 2010.
    fn take_sticks(
        &mut self,
        context: &Context<'_>,
        origin: Origin,
        sticks: &UaStickCommand,
        effects: &mut Effects<'_>,
    ) {
        // No message of the vehicle confirms MANUAL_CONTROL: storing the sticks is all that can be answered.
        match self.sticks.take(context.mono(), sticks) {
            Ok(()) => effects.acknowledge(&origin, AckType::CarriedOut),
            Err(why) => effects.refuse(Some(origin), why),
        }
    }

    /// 2008.
    fn command_engine(
        &mut self,
        context: &Context<'_>,
        origin: Origin,
        command: &EngineCommand,
        effects: &mut Effects<'_>,
    ) {
        effects.acknowledge(&origin, AckType::Received);
        if !context.vehicle.live() {
            return effects.refuse(Some(origin), SILENT);
        }
        match engine::steps(command, context.vehicle) {
            Ok((wanted, task)) => {
                self.engine_command = Some(wanted);
                // Arming and disarming do not change the commanded values in 3002.
                let maneuver = |steps| Maneuver::new(steps, self.commanded);
                let running = self.maneuver.as_ref();
                let stops = running.is_some_and(|(_, running)| running.disarms());
                match task {
                    engine::Task::Steps(steps) => {
                        let maneuver = maneuver(steps);
                        self.begin(context, Some(origin), maneuver, effects);
                    }
                    // An earlier stop in progress is no longer wanted.
                    engine::Task::Look(step) if stops => {
                        let maneuver = maneuver(vec![step]);
                        self.begin(context, Some(origin), maneuver, effects);
                    }
                    engine::Task::Look(step) => {
                        let seen = maneuver(vec![step]);
                        self.look_for(context, origin, seen, effects);
                    }
                }
            }
            Err(why) => effects.refuse(Some(origin), why),
        }
    }

    /// A 2016; without origin it is a command of the VSM. `just_loaded`: its route was uploaded for it.
    pub(super) fn operate(
        &mut self,
        context: &Context<'_>,
        origin: Option<Origin>,
        command: &VehicleOperatingModeCommand,
        just_loaded: bool,
        effects: &mut Effects<'_>,
    ) {
        let (now, vehicle) = (context.mono(), context.vehicle);
        // What was uploaded for a command is not another one.
        let repeats = !just_loaded && self.repeated.is_continued(context, origin, command);
        let undecided =
            origin.and_then(|by| self.is_undecided(context, by, command, just_loaded, repeats));
        // Before all refusals: what repeats a refused command is part of a stream too, and no station pauses by a silence of the
        // vehicle. Not where it is refused as too early: sent again after the alert, it is the decision that `TOO_EARLY` requests.
        let repetition = if just_loaded || (undecided.is_some() && !repeats) {
            Repetition::None
        } else {
            let other = || self.shown_other(vehicle, now).is_some();
            let over_other = vehicle.live().then(other);
            self.repeated
                .note(context, origin, command, &context.mission, over_other)
        };
        if !vehicle.live() {
            return effects.refuse(origin, SILENT);
        }
        if let Some(why) = undecided {
            return effects.refuse(origin, why);
        }
        let repetition = if repetition == Repetition::OfDone && self.is_left(context) {
            // Once: the next repeats the one that is carried out now.
            self.repeated.reopen();
            Repetition::OfMode
        } else {
            repetition
        };
        let telemetry = &context.vehicle.telemetry;
        let altimeter = match settings::altimeter_of(command, self.altimeter) {
            Ok(altimeter) => altimeter,
            Err(why) => return effects.refuse(origin, why),
        };
        let situation = Situation {
            telemetry,
            uploaded: context.mission.uploaded,
            infeasible: context.mission.why_infeasible(telemetry),
            progress: context.mission.progress,
            loaded: context.mission.loaded,
            plan: context.mission.plan,
            fence: context.mission.fence,
            unfenced: context.mission.unfenced,
            just_loaded,
            repeats: repetition == Repetition::OfDone,
            under_way: self.under_way(context),
            landing_from_m: self.landing_from_m,
            loiter: &self.loiter,
            commanded: self.commanded,
            agl: context.bounds.agl,
            altimeter,
            limits: context.parameters.limits(context),
            terrain: context.bounds.terrain.as_deref(),
            performance: context.parameters.performance(context),
            route_performance: context.parameters.route_performance(context),
            wings: context.parameters.wings(context),
            vtol_loiter_m: context.parameters.get("VTO_LOITER_ALT"),
        };
        if repetition != Repetition::None
            && let Some(by) = self.taken_by(context, mode_command::is_over(&situation))
        {
            return effects.refuse(origin, format!("{by}, and {NOT_NEW}"));
        }
        if let (Repetition::OfDone, Some(origin)) = (repetition, origin)
            && self.is_still_flown(context)
        {
            return effects.acknowledge(&origin, AckType::CarriedOut);
        }
        let winged = situation.wings.is_some();
        let hovers_instead = mode_command::hovers_instead(command, &situation);
        let unconfigured = mode_command::is_unconfigured(command, &situation);
        let unconfigured = unconfigured.filter(|_| !self.unconfigured_named);
        let continues_instead = mode_command::continues_instead(command, &situation);
        let restarts = mode_command::restarts_route(command, &situation)
            && command.select_flight_path_control_mode == Some(Mode::Waypoint);
        // A refused command changes nothing: the altimeter setting is stored only if the rest can be flown.
        let task = mode_command::task(command, &situation).and_then(|task| {
            self.set_altimeter(altimeter, origin, effects)
                .map(|()| task)
        });
        let task = match task {
            Ok(task) => task,
            Err(why) => return effects.refuse(origin, why),
        };
        // Unused fields are reported, not refused: a station may send every field every time, and a commanded hold must be
        // carried out.
        let ignored = situation::mode_of(command, telemetry).map(|mode| {
            let routed = task.flies_a_route(telemetry.mode);
            let climbs = task.climbs();
            let names = ignored_fields::ignored_fields(command, mode, routed, winged, climbs);
            (mode, names)
        });
        // PX4 refuses the terrain frame (11): without elevation files AGL is flown as height above home, which is reported.
        let flies_altitude = command.commanded_altitude.is_some()
            && !ignored
                .as_ref()
                .is_some_and(|(_, names)| names.contains(&ignored_fields::ALTITUDE));
        if flies_altitude
            && command.altitude_type == Some(AltitudeType::Agl)
            && context.bounds.agl == Agl::AboveHome
        {
            effects.advise_agl();
        }
        if let Some((origin, (mode, names))) = origin.zip(ignored) {
            let place = format!(" in mode {}", mode.in_words());
            let text = ignored_fields::report(origin.message_type, &names, &place);
            self.unconfigured_named |= unconfigured.is_some();
            let notices = [hovers_instead, unconfigured].into_iter().flatten();
            for text in text.into_iter().chain(notices.map(str::to_owned)) {
                effects.answer(&[origin.station], text);
            }
            if let Some(text) = continues_instead {
                effects.answer_sometimes(&[origin.station], text);
            }
        }
        match task {
            Task::Nothing => {
                if let Some(origin) = origin {
                    effects.acknowledge(&origin, AckType::CarriedOut);
                }
            }
            Task::Steps(steps, commanded) => {
                // What begins again before the vehicle has shown it would never be shown.
                if let (Repetition::OfRunning, Some(by)) = (repetition, origin) {
                    return self.join(by, effects);
                }
                if let Some(why) = waits_for_transfer(&steps, context) {
                    return effects.refuse(origin, why);
                }
                if restarts && context.mission.progress.was_flown() {
                    report_restart(context, effects);
                }
                self.begin(context, origin, Maneuver::new(steps, commanded), effects);
            }
            Task::Launch(steps, commanded) => {
                // Begun again, it would first be ended, which stops the motors.
                if let (Repetition::OfRunning, Some(by)) = (repetition, origin) {
                    return self.join(by, effects);
                }
                if let Some(why) = waits_for_transfer(&steps, context) {
                    return effects.refuse(origin, why);
                }
                // If a step after arming fails, the motors must not keep running on the ground.
                let maneuver = Maneuver::new(steps, commanded).undone_by(maneuver::arm(false));
                self.begin(context, origin, maneuver, effects);
            }
            Task::Manual => self.fly_manually(context, origin, effects),
            Task::Steer(order, commanded) => {
                self.steer(context, origin, repetition, (order, commanded), effects);
            }
            Task::Load(route_type) => {
                self.load_and_fly(context, origin, Some(route_type), command, effects);
            }
            Task::Reload => self.load_and_fly(context, origin, None, command, effects),
        }
        let running = self.maneuver.as_ref().and_then(|(by, _)| *by);
        if origin.is_some_and(|by| running == Some(by) || self.joined.last() == Some(&by)) {
            let mission = &context.mission;
            self.repeated
                .begun(context, origin, command, mission, repetition);
        }
    }

    /// Requests the upload of a route, of this type or the loaded one again, to be flown afterwards.
    fn load_and_fly(
        &mut self,
        context: &Context<'_>,
        origin: Option<Origin>,
        route_type: Option<RouteType>,
        command: &VehicleOperatingModeCommand,
        effects: &mut Effects<'_>,
    ) {
        if origin.is_some_and(|origin| origin.held.is_none()) {
            self.contingencies.operator_loads();
            // The upload takes seconds, and a contingency may begin meanwhile: what counts is whether its operator knew of
            // it when the command was sent.
            self.load_commanded = Some(context.mono());
        }
        effects.request(Request::LoadAndFly {
            origin,
            route_type,
            command: Box::new(command.clone()),
        });
    }

    fn set_altimeter(
        &mut self,
        altimeter: Altimeter,
        by: Option<Origin>,
        effects: &mut Effects<'_>,
    ) -> Result<(), String> {
        if altimeter != self.altimeter {
            // Stored first: if that fails, the setting in use is still the one on disk.
            settings::store_altimeter(altimeter, effects)?;
            self.altimeter = altimeter;
            effects.request(Request::Configured {
                changed: changes::altimeter(altimeter).into_iter().collect(),
                by: by.map(|origin| origin.station),
            });
        }
        Ok(())
    }

    /// Mode 2: the stream first, then the mode.
    fn fly_manually(
        &mut self,
        context: &Context<'_>,
        origin: Option<Origin>,
        effects: &mut Effects<'_>,
    ) {
        let now = context.mono();
        if context.vehicle.awaits_mode() {
            return effects.refuse(origin, format!("mode 2 (manual): {DID_NOT_RUN}"));
        }
        let parameters = context.parameters.values;
        // A remote control may be on: the vehicle would enter the mode, and not be flown by this CUCS.
        if let Some(why) = parameters.ignores_sticks() {
            let why = format!("mode 2 (manual): the vehicle ignores sticks (2010): its {why}");
            return effects.refuse(origin, why);
        }
        // A safety pilot's, for example: nothing would show that these move nothing.
        let health = context.vehicle.telemetry.sensed.health;
        if let Some(why) = parameters.prefers_other_sticks()
            && health.is_some_and(Health::has_sticks)
            && !self.sticks.were_shown(now, lost_within(parameters))
        {
            let why = format!(
                "mode 2 (manual): the vehicle has sticks of a remote control or another station, and would ignore these (2010): its {why}; \
                 end the others first"
            );
            return effects.refuse(origin, why);
        }
        // The next mode would be the end of the flight.
        if let Some(why) = parameters.falls_without_sticks() {
            let why = format!(
                "mode 2 (manual): the end of the sticks (2010) would bring the vehicle down in any other mode: its {why}; set that to 2, \
                 or COM_RCL_EXCEPT to 7"
            );
            return effects.refuse(origin, why);
        }
        if !self.sticks.fresh(now) {
            let why =
                "mode 2 (manual): no sticks (2010) received; send them first, at 10 Hz or more";
            return effects.refuse(origin, why);
        }
        let mut steps = Vec::new();
        if self.settled_mode(context) != Some(Px4Mode::POSCTL) {
            // PX4 refuses the mode until it has seen sticks.
            steps.push(Step::Pause(SEEN_WITHIN));
        }
        steps.extend(maneuver::enter(&[Px4Mode::POSCTL]));
        let maneuver = Maneuver::new(steps, Commanded::default());
        self.begin(context, origin, maneuver, effects);
        // After `begin`: what it superseded has released the sticks.
        let slow = matches!(context.common.config.link, LinkAddress::Serial { .. });
        self.sticks.engage(now, slow);
        self.stream_sticks(context, effects);
    }

    /// Mode 15: set points first, then the mode; within the mode the set points alone change.
    fn steer(
        &mut self,
        context: &Context<'_>,
        origin: Option<Origin>,
        repetition: Repetition,
        (order, mut commanded): (steering::Order, Commanded),
        effects: &mut Effects<'_>,
    ) {
        if context.vehicle.awaits_mode() {
            return effects.refuse(origin, format!("mode 15 (autopilot): {DID_NOT_RUN}"));
        }
        // A command that arrives while the mode is being entered adds to the one before, as its set points do.
        if let Some((_, running)) = &self.maneuver
            && running.enters(Px4Mode::OFFBOARD)
        {
            let mut both = running.commanded;
            both.keep(&commanded);
            if order.vertical.is_some() {
                // A vertical speed has replaced an altitude.
                both.altitude_amsl_m = commanded.altitude_amsl_m;
            }
            commanded = both;
        }
        let telemetry = &context.vehicle.telemetry;
        // The reported mode is not enough: a HEARTBEAT from before a hold that was just commanded still shows OFFBOARD, and
        // a change of the set points alone would be acknowledged while the vehicle holds.
        let entered =
            self.settled_mode(context) == Some(Px4Mode::OFFBOARD) && self.steering.engaged();
        // On a copy: a refused order must not disturb the present steering.
        let mut steering = self.steering.clone();
        if !entered {
            steering.enter_again();
        }
        if let Err(why) = steering.take(context.mono(), order, telemetry) {
            return effects.refuse(origin, why);
        }
        // While the mode is being entered, a demand that continues its command, or the next of a stream, changes only the set points.
        if (self.is_continued_by(origin) || repetition != Repetition::None)
            && let (Some((_, running)), Some(origin)) = (&mut self.maneuver, origin)
            && running.enters(Px4Mode::OFFBOARD)
        {
            running.commanded = commanded;
            self.steering = steering;
            return self.join(origin, effects);
        }
        self.supersede(context, origin, effects);
        // Only after the superseded maneuver has released the stream.
        self.steering = steering;
        self.stream_set_points(context, effects);
        let steps: Vec<Step> = if entered {
            Vec::new()
        } else {
            maneuver::enter(&[Px4Mode::OFFBOARD]).into()
        };
        self.begin(context, origin, Maneuver::new(steps, commanded), effects);
    }
}

/// Why these steps must wait for a transfer to the vehicle, if they must: while a mission is being replaced, an index could
/// mean a different item.
fn waits_for_transfer(steps: &[Step], context: &Context<'_>) -> Option<&'static str> {
    let needs_mission = steps.iter().any(|step| matches!(step, Step::SetCurrent(_)));
    // Without a step to another mode it would stay in the mission that the transfer takes it out of.
    let now = context.vehicle.telemetry.mode;
    let flies_mission = maneuver::mode_after(steps, now) == Some(Px4Mode::MISSION);
    if context.mission.is_transferring() && (needs_mission || flies_mission) {
        Some("a route is being uploaded: wait for 14000")
    } else if context.mission.fence_busy && needs_mission {
        Some("a fence is being uploaded (wait for 50018), or rally points are")
    } else {
        None
    }
}

/// Reports that a route which has been flown to its end is flown again.
fn report_restart(context: &Context<'_>, effects: &mut Effects<'_>) {
    let uploaded = context.mission.uploaded;
    let loops = uploaded.is_some_and(|uploaded| uploaded.compiled.circuit().is_some());
    let once = if loops {
        ", its loop only once: PX4 has counted it; clear and load the route for more"
    } else {
        ""
    };
    effects.advise(format!(
        "mode 11 (waypoint): the route was flown to its end, flying it again from its start{once}"
    ));
}

const DID_NOT_RUN: &str =
    "this VSM did not run, and the vehicle has not shown its mode since: command it again";
const SILENT: &str = "no data from the vehicle: no command can be confirmed";
