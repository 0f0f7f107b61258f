//! Turns a 2016 into commands to PX4, or gives the reason why PX4 cannot do it: a pure function of the [`Situation`].
//!
//! [`task`] comes first, then the modes: launch (21), wave-off (20), steering (15). `route`: the modes that fly a route (11,
//! 19, 23, 24); `loiter`: mode 12. [`wings`] has the differences for fixed wings.

mod loiter;
mod route;

use mapping::mode::Px4Mode;
use mapping::report::Commanded;
use stanag_msgs::enums::{
    AltitudeCommandType, FlightPathControlMode as Mode, HeadingCommandType, RouteType, SpeedType,
};
use stanag_msgs::messages::VehicleOperatingModeCommand;

use self::loiter::{flown_over, loiter};
pub(crate) use self::loiter::{hovers_instead, is_unconfigured};
pub(crate) use self::route::{continues_instead, is_over, restarts_route};
use self::route::{fly, is_current};
use super::settings::Pattern;
use super::situation::{
    NEAR_M, Situation, Task, altitude, check_feasible, check_heights, checked_level,
    does_not_follow_ground, has, holds, level, mode_of, names_mode, plain, speed,
};
use super::steering::{self, Vertical};
use super::wings;
use crate::session::duplicates::commands_values;
use crate::session::maneuver::{self, Step};

/// Decides.
///
/// # Errors
/// The reason, for the operator.
pub(crate) fn task(
    command: &VehicleOperatingModeCommand,
    at: &Situation<'_>,
) -> Result<Task, String> {
    let mode = mode_of(command, at.telemetry)
        .ok_or("no mode is commanded, and the vehicle has not reported one")?;
    if !names_mode(command) {
        if !commands_values(command) {
            // A setting that is kept, such as the altimeter's.
            return Ok(Task::Nothing);
        }
        if at.settled_mode().is_none() {
            return Err(
                "no mode is commanded while the present one is not known: another is being entered, or was commanded and is not shown \
                 yet, or none is shown since this VSM did not run; name the mode"
                    .to_owned(),
            );
        }
        if !matches!(mode, Mode::Waypoint | Mode::Loiter | Mode::Autopilot) {
            return Err(format!(
                "no mode is commanded, and in the current one, {}, nothing can be changed",
                mode.in_words()
            ));
        }
    }
    // Refused, not ignored: it contradicts the mode.
    if let Some(heading) = command.heading_command_type
        && heading != HeadingCommandType::None
        && mode != Mode::Autopilot
    {
        return Err(format!(
            "heading commands are not flown in mode {}",
            mode.in_words()
        ));
    }
    match mode {
        Mode::Waypoint => waypoint(command, at),
        Mode::Loiter => loiter(command, at),
        Mode::Launch => launch(command, at),
        Mode::AutolandEngage => match wings::land(at)? {
            Some(task) => Ok(task),
            None => fly(command, RouteType::Approach, at),
        },
        Mode::ContingencyA => contingency(command, RouteType::ContingencyA, &[Px4Mode::RTL], at),
        Mode::ContingencyB => contingency(command, RouteType::ContingencyB, &[Px4Mode::LAND], at),
        // The reported or the commanded landing: aborting is the safe decision for both.
        Mode::AutolandWaveOff
            if at.telemetry.hovers()
                && (at.telemetry.mode == Some(Px4Mode::LAND)
                    || at.under_way.lands
                    || lands_from(at).is_some()) =>
        {
            wave_off(command, at)
        }
        Mode::AutolandWaveOff => wings::wave_off(at),
        Mode::FlightDirector => Ok(Task::Manual),
        Mode::Autopilot if at.wings.is_some() && !at.telemetry.hovers() => {
            wings::steer(command, at)
        }
        Mode::Autopilot => steer(command, at),
        other if other == Px4Mode::RTL.reported() => Err(format!(
            "mode {}: only reported (3001), expected mode {}, which returns where no route of that type is stored",
            other.in_words(),
            Mode::ContingencyA.in_words()
        )),
        other => Err(format!("mode {}: not supported by PX4", other.in_words())),
    }
}

fn contingency(
    command: &VehicleOperatingModeCommand,
    route: RouteType,
    otherwise: &'static [Px4Mode],
    at: &Situation<'_>,
) -> Result<Task, String> {
    if has(route, at) {
        fly(command, route, at)
    } else {
        Ok(plain(otherwise, at))
    }
}

/// Mode 11.
fn waypoint(command: &VehicleOperatingModeCommand, at: &Situation<'_>) -> Result<Task, String> {
    if altitude(command).is_some() {
        return Err(
            "mode 11 (waypoint) flies the altitudes of the route; command another in mode 12 (loiter)".to_owned(),
        );
    }
    if at.uploaded.is_none() && at.loaded.is_none() {
        let why = if at.plan.is_empty() {
            "no route has been loaded (13000)"
        } else {
            // Of a load that failed, the vehicle may hold any part: it flies nothing before the next one, and not the earlier route
            // either, which the operator has replaced.
            "the vehicle no longer holds the loaded route: it was cleared, or the load that was to replace it was refused or failed; load a \
             route again (13000)"
        };
        return Err(format!("mode 11 (waypoint): {why}"));
    }
    fly(command, RouteType::Flight, at)
}

/// Mode 20 of a vehicle that lands, in AUTO.LAND or by its approach: climb to the commanded altitude, otherwise to the altitude at which the landing began,
/// since that airspace is known to be free. If neither is known it holds. DO_GO_AROUND is for fixed wings.
fn wave_off(command: &VehicleOperatingModeCommand, at: &Situation<'_>) -> Result<Task, String> {
    // DO_REPOSITION would make it take off.
    if at.telemetry.stands() {
        return Err("mode 20 (wave-off): the vehicle is on the ground already".to_owned());
    }
    let commanded = match altitude(command) {
        Some(metres) => {
            let home = at
                .telemetry
                .home
                .ok_or("mode 20 (wave-off): home is not known yet")?;
            let over = flown_over(None, Pattern::Hover, command, at)?;
            Some(checked_level(metres, command, &over, at)?.amsl(home.amsl_m))
        }
        None => None,
    };
    let present = at.telemetry.position.map(|place| place.amsl_m);
    if let (Some(wanted), Some(present)) = (commanded, present)
        && wanted < present
    {
        return Err(format!(
            "mode 20 (wave-off) climbs: commanded {wanted:.1} m AMSL, the vehicle is at {present:.1} m"
        ));
    }
    match (commanded.or(lands_from(at)), present) {
        (Some(amsl_m), Some(present))
            if at.telemetry.hovers() && at.telemetry.airborne() && amsl_m > present + NEAR_M =>
        {
            let commanded = Commanded {
                altitude_amsl_m: Some(amsl_m),
                ..Commanded::default()
            };
            let mut steps = Vec::new();
            if at.telemetry.mode == Some(Px4Mode::MISSION) {
                // It would climb on its way to the item that it flies to.
                steps.extend(maneuver::enter(&[Px4Mode::LOITER]));
            }
            steps.extend(maneuver::reposition(None, amsl_m, None));
            Ok(Task::Steps(steps, commanded))
        }
        _ => Ok(plain(&[Px4Mode::LOITER], at)),
    }
}

/// Where the landing of a multicopter began, in AUTO.LAND or by its approach, m above mean sea level; `None` where it does not land.
fn lands_from(at: &Situation<'_>) -> Option<f64> {
    let by_approach = || {
        let flies = at.telemetry.mode == Some(Px4Mode::MISSION) && at.wings.is_none();
        let seq = at.telemetry.mission.filter(|_| flies)?.seq;
        let compiled = &at.uploaded?.compiled;
        let last = compiled.order.last().filter(|_| compiled.lands(seq))?;
        Some(last.level.amsl(at.telemetry.home?.amsl_m))
    };
    at.landing_from_m.or_else(by_approach)
}

/// Mode 21: climb to an altitude, then fly the launch route if there is one.
fn launch(command: &VehicleOperatingModeCommand, at: &Situation<'_>) -> Result<Task, String> {
    if at.telemetry.airborne() {
        return Err("mode 21 (launch): the vehicle is already in the air".to_owned());
    }
    // After a start of the VSM the vehicle may be in the air without having reported it yet.
    if !at.telemetry.stands() {
        return Err(
            "mode 21 (launch): the vehicle has not reported yet whether it is on the ground"
                .to_owned(),
        );
    }
    // In the air it would be bounded by nothing, and be refused every route.
    if let Some(why) = at.unfenced {
        return Err(format!(
            "mode 21 (launch): the vehicle is not known to hold its fence: {why}"
        ));
    }
    let route = has(RouteType::Launch, at);
    let metres =
        altitude(command).ok_or("mode 21 (launch) needs a commanded altitude to take off to")?;
    let home = at
        .telemetry
        .home
        .ok_or("mode 21 (launch): home is not known yet")?;
    let level = checked_level(metres, command, &[(home.latitude, home.longitude)], at)?;
    let amsl_m = level.amsl(home.amsl_m);
    let height_m = amsl_m - home.amsl_m;
    if height_m < LOWEST_LAUNCH_M {
        return Err(format!(
            "mode 21 (launch): {height_m:.1} m above home, expected at least {LOWEST_LAUNCH_M} m"
        ));
    }
    let (mut steps, commanded) = match &at.wings {
        Some(wings) => wings::launch(command, at, wings, amsl_m)?,
        None => {
            let commanded = Commanded {
                altitude_amsl_m: Some(amsl_m),
                ..Commanded::default()
            };
            (maneuver::launch(amsl_m), commanded)
        }
    };
    if route {
        if at.wings.is_some() {
            // A fixed wing does not turn to another target during its climb: wait for the end of the climb.
            steps.push(maneuver::climbed());
        }
        match at.uploaded {
            Some(uploaded)
                if uploaded.route_type == RouteType::Launch
                    && holds(at.telemetry, uploaded) == Some(true)
                    && is_current(uploaded, RouteType::Launch, at) =>
            {
                check_feasible(Mode::Launch, at)?;
                check_heights(uploaded, at)?;
                steps.push(Step::SetCurrent(0..=uploaded.compiled.place_from(0)));
                steps.extend(maneuver::enter(&[Px4Mode::MISSION]));
            }
            // Uploaded on the ground: a route that the vehicle refuses is then known before the take-off.
            _ => return Ok(Task::Load(RouteType::Launch)),
        }
    }
    Ok(Task::Launch(steps, commanded))
}

/// Mode 15: speed, direction and climb by set points.
fn steer(command: &VehicleOperatingModeCommand, at: &Situation<'_>) -> Result<Task, String> {
    if !at.telemetry.airborne() {
        return Err("mode 15 (autopilot) needs an airborne vehicle".to_owned());
    }
    let rate = command.commanded_vertical_speed.map(|rate| rate.si());
    let altitude_m = command.commanded_altitude.map(|altitude| altitude.si());
    // On entry the vehicle keeps its present motion, whatever was commanded in the mode before.
    let mut commanded = if at.settled_mode() == Some(Px4Mode::OFFBOARD) {
        at.commanded
    } else {
        Commanded::default()
    };
    let vertical = match command.altitude_command_type {
        Some(AltitudeCommandType::None) => None,
        None if altitude_m.is_none() => None,
        Some(AltitudeCommandType::VerticalSpeed) => {
            // With a vertical speed, 3002 has no commanded altitude to report.
            commanded.altitude_amsl_m = None;
            Some(Vertical::Rate(rate.ok_or(
                "mode 15 (autopilot): Commanded Vertical Speed is missing",
            )?))
        }
        None | Some(AltitudeCommandType::Altitude | AltitudeCommandType::RateLimitedAltitude) => {
            let home = at.telemetry.home.ok_or("home is not known yet")?;
            let metres = altitude_m.ok_or("mode 15 (autopilot): Commanded Altitude is missing")?;
            does_not_follow_ground(command, at)?;
            let amsl_m = level(metres, command, &[], at)?.amsl(home.amsl_m);
            commanded.altitude_amsl_m = Some(amsl_m);
            let limited =
                command.altitude_command_type == Some(AltitudeCommandType::RateLimitedAltitude);
            // A rate of 0 is an unused field of a full presence vector, not a limit.
            let most_m_s = rate.filter(|rate| limited && *rate != 0.0);
            Some(Vertical::Altitude {
                amsl_m,
                most_m_s: most_m_s.map_or(steering::CLIMB_M_S, f64::abs),
            })
        }
        Some(other) => {
            return Err(format!(
                "Altitude Command Type {} is not known",
                other.raw()
            ));
        }
    };
    let order = steering::Order {
        speed_m_s: speed(command, &at.performance)?,
        direction: steering::direction(command)?,
        vertical,
    };
    if order.speed_m_s.is_some() {
        commanded.speed_m_s = order.speed_m_s;
        commanded.speed_type = Some(SpeedType::Ground);
    }
    commanded.loiter_position = None;
    // A command without a heading keeps the steered one.
    if order.direction.is_some() {
        commanded.direction = steering::reported(command);
    }
    Ok(Task::Steer(order, commanded))
}

/// Minimum height with which PX4 takes off, m.
const LOWEST_LAUNCH_M: f64 = 1.5;

#[cfg(test)]
mod tests {
    use curve_paths::terrain::{Grid, Terrain};
    use mapping::altitude::{Agl, Altimeter, FRAME_AMSL, Level};
    use mapping::area::Areas;
    use mapping::limits::{Limits, Performance};
    use mapping::plan::Plan;
    use mapping::route::{CompiledMission, Leg};
    use mapping::telemetry::{LandedState, MissionProgress, Place, Telemetry};
    use mavlink_link::dialect::{MavLandedState, MissionState};
    use mavlink_link::service::mission::Item;
    use stanag_msgs::enums::{AltitudeType, FlightPathControlMode as Mode};
    use stanag_msgs::messages::{LoiterConfiguration, UaRoute};
    use stanag_msgs::{Id, Scaled};

    use super::super::situation::UnderWay;
    use super::*;
    use crate::session::mission::progress::RouteProgress;
    use crate::session::mission::record::UploadedMission;

    fn task_of(
        command: &VehicleOperatingModeCommand,
        telemetry: &Telemetry,
        uploaded: Option<&UploadedMission>,
        limits: Limits,
    ) -> Result<Task, String> {
        task_with(
            (&Plan::default(), None, None),
            command,
            telemetry,
            uploaded,
            limits,
        )
    }

    fn task_with(
        (plan, infeasible, terrain): (&Plan, Option<&str>, Option<&Terrain>),
        command: &VehicleOperatingModeCommand,
        telemetry: &Telemetry,
        uploaded: Option<&UploadedMission>,
        limits: Limits,
    ) -> Result<Task, String> {
        let at = Situation {
            telemetry,
            uploaded,
            infeasible: infeasible.map(str::to_owned),
            progress: &RouteProgress::default(),
            loaded: None,
            plan,
            fence: (&[], &Areas::default()),
            unfenced: None,
            just_loaded: false,
            repeats: false,
            under_way: UnderWay::default(),
            landing_from_m: None,
            loiter: &LoiterConfiguration::default(),
            commanded: Commanded::default(),
            agl: Agl::AboveHome,
            altimeter: Altimeter::STANDARD,
            limits,
            terrain,
            performance: Performance::default(),
            route_performance: Performance::default(),
            wings: None,
            vtol_loiter_m: None,
        };
        task(command, &at)
    }

    #[test]
    fn a_launch_waits_for_the_vehicles_word_that_it_stands() {
        let home = Place {
            latitude: 47.0,
            longitude: 8.0,
            amsl_m: 488.0,
        };
        let command = VehicleOperatingModeCommand {
            select_flight_path_control_mode: Some(Mode::Launch),
            commanded_altitude: Scaled::from_si(20.0).ok(),
            altitude_type: Some(AltitudeType::Agl),
            ..VehicleOperatingModeCommand::default()
        };
        let judged = |landed| {
            let telemetry = Telemetry {
                home: Some(home),
                landed,
                ..Telemetry::default()
            };
            let task = task_of(&command, &telemetry, None, Limits::default());
            task.map(|task| matches!(task, Task::Launch(..)))
        };
        assert_eq!(judged(Some(LandedState::OnGround)), Ok(true));
        // The VSM was restarted while the vehicle flies, or the vehicle does not know it.
        let undefined = LandedState::of(MavLandedState::MAV_LANDED_STATE_UNDEFINED);
        for unknown in [None, undefined] {
            assert!(judged(unknown).is_err_and(|why| why.contains("not reported yet")));
        }
    }

    #[test]
    fn the_return_that_is_only_reported_names_the_mode_that_commands_it() {
        let refused = |mode| {
            let command = VehicleOperatingModeCommand {
                select_flight_path_control_mode: Some(mode),
                ..VehicleOperatingModeCommand::default()
            };
            let task = task_of(&command, &Telemetry::default(), None, Limits::default());
            task.map(drop).expect_err("no mode to command")
        };
        let why = refused(Px4Mode::RTL.reported());
        assert!(why.starts_with("mode 32 (return): only reported"), "{why}");
        assert!(why.contains("mode 23 (contingency A)"), "{why}");
        assert!(refused(Mode::Unknown(33)).contains("not supported by PX4"));
    }

    #[test]
    fn mode_11_names_a_route_that_was_replaced_by_a_load_that_failed() {
        let command = VehicleOperatingModeCommand {
            select_flight_path_control_mode: Some(Mode::Waypoint),
            ..VehicleOperatingModeCommand::default()
        };
        let refused = |plan: &Plan| {
            let at = Telemetry::default();
            let task = task_with((plan, None, None), &command, &at, None, Limits::default());
            task.map(drop).expect_err("no route")
        };
        let mut plan = Plan::default();
        assert!(refused(&plan).contains("no route has been loaded"));
        // What was loaded before stays stored.
        let route = UaRoute {
            initial_waypoint_number: Some(1),
            ..UaRoute::default()
        };
        let stored = plan.store(&route.into(), Id(1), Id(2));
        assert_eq!(stored, Ok(()));
        let why = refused(&plan);
        assert!(
            why.contains("refused or failed; load a route again (13000)"),
            "{why}"
        );
    }

    /// A route that the vehicle holds, and mode 11, which flies it.
    fn aboard_and_waypoint(
        compiled: CompiledMission,
    ) -> (UploadedMission, VehicleOperatingModeCommand) {
        let uploaded = UploadedMission {
            compiled,
            mission_id: 0,
            route_type: RouteType::Flight,
            mission_name: String::new(),
            plan: Plan::default(),
        };
        let command = VehicleOperatingModeCommand {
            select_flight_path_control_mode: Some(Mode::Waypoint),
            ..VehicleOperatingModeCommand::default()
        };
        (uploaded, command)
    }

    #[test]
    fn a_route_aboard_that_the_vehicle_finds_infeasible_is_not_begun() {
        let telemetry = Telemetry {
            home: Some(Place {
                latitude: 47.0,
                longitude: 8.0,
                amsl_m: 488.0,
            }),
            landed: Some(LandedState::InAir),
            ..Telemetry::default()
        };
        for (mode, route_type) in [
            (Mode::Waypoint, RouteType::Flight),
            (Mode::AutolandEngage, RouteType::Approach),
            (Mode::ContingencyA, RouteType::ContingencyA),
            (Mode::ContingencyB, RouteType::ContingencyB),
        ] {
            let (mut uploaded, mut command) = aboard_and_waypoint(CompiledMission::default());
            command.select_flight_path_control_mode = Some(mode);
            uploaded.route_type = route_type;
            let mut plan = Plan::default();
            let route = UaRoute {
                initial_waypoint_number: Some(1),
                route_type: Some(route_type),
                ..UaRoute::default()
            };
            assert_eq!(plan.store(&route.into(), Id(1), Id(2)), Ok(()));
            let sent = plan.route_of_type(route_type).expect("it was stored");
            uploaded.plan = plan.part(sent);
            let judged = |infeasible| {
                let given = (&plan, infeasible, None);
                let limits = Limits::default();
                task_with(given, &command, &telemetry, Some(&uploaded), limits)
            };
            let task = judged(None).expect("it is flown");
            assert!(task.flies_a_route(None), "{task:?}");
            let why = judged(Some("infeasible: load another")).map(drop);
            let expected = format!("mode {}: infeasible: load another", mode.in_words());
            assert_eq!(why, Err(expected), "PX4 flies nothing of it");
        }
    }

    /// PX4 stays in AUTO.MISSION after the landing, armed for a while, and the ground is reported up to a second later.
    #[test]
    fn an_approach_that_has_landed_is_not_begun_again_before_the_vehicle_reports_the_ground() {
        let home = Place {
            latitude: 47.0,
            longitude: 8.0,
            amsl_m: 488.0,
        };
        let item = Item {
            frame: FRAME_AMSL,
            command: 16,
            z: 500.0,
            ..Item::default()
        };
        let leg = Leg {
            number: 7,
            latitude: home.latitude,
            longitude: home.longitude,
            level: Level::Amsl(500.0),
            speed_m_s: None,
        };
        let (mut uploaded, mut command) = aboard_and_waypoint(CompiledMission {
            items: vec![item],
            waypoint_of: vec![7],
            order: vec![leg],
            ..CompiledMission::default()
        });
        command.select_flight_path_control_mode = Some(Mode::AutolandEngage);
        uploaded.route_type = RouteType::Approach;
        let mut plan = Plan::default();
        let route = UaRoute {
            initial_waypoint_number: Some(7),
            route_type: Some(RouteType::Approach),
            ..UaRoute::default()
        };
        assert_eq!(plan.store(&route.into(), Id(1), Id(2)), Ok(()));
        let sent = plan.route_of_type(RouteType::Approach);
        uploaded.plan = plan.part(sent.expect("it was stored"));
        let begins = |mode| {
            let telemetry = Telemetry {
                home: Some(home),
                landed: Some(LandedState::InAir),
                mode: Some(mode),
                mission: Some(MissionProgress {
                    seq: 0,
                    total: Some(1),
                    state: MissionState::MISSION_STATE_COMPLETE,
                    mission_id: 0,
                    fence_id: 0,
                    rally_points_id: 0,
                }),
                ..Telemetry::default()
            };
            let given = (&plan, None, None);
            let limits = Limits::default();
            match task_with(given, &command, &telemetry, Some(&uploaded), limits) {
                Ok(Task::Steps(steps, _)) => !steps.is_empty(),
                other => panic!("{other:?}"),
            }
        };
        assert!(!begins(Px4Mode::MISSION), "it would take off again");
        assert!(begins(Px4Mode::LOITER), "in another flight");
    }

    #[test]
    fn the_way_to_a_route_is_compared_with_the_terrain_unless_the_vehicle_is_on_the_ground() {
        // From north to south: a ridge between the vehicle and waypoint 7.
        let rows = (0..20).map(|row| {
            let ridge = (8..12).contains(&row);
            let height = if ridge { "600 " } else { "400 " };
            height.repeat(20)
        });
        let rows: String = rows.collect();
        let text = format!("ncols 20 nrows 20 xllcenter 8 yllcenter 47 cellsize 0.001 {rows}");
        let grid = Grid::read("ridge.asc", text.into_bytes()).expect("a grid");
        let terrain = Terrain::new(vec![grid]);
        let (latitude, longitude) = (47.002, 8.01);
        let item = Item {
            frame: FRAME_AMSL,
            command: 16,
            x: 470_020_000,
            y: 80_100_000,
            z: 500.0,
            ..Item::default()
        };
        let leg = Leg {
            number: 7,
            latitude,
            longitude,
            level: Level::Amsl(500.0),
            speed_m_s: None,
        };
        let (uploaded, command) = aboard_and_waypoint(CompiledMission {
            items: vec![item],
            waypoint_of: vec![7],
            order: vec![leg],
            ..CompiledMission::default()
        });
        let judged = |landed| {
            let home = Place {
                latitude,
                longitude,
                amsl_m: 400.0,
            };
            let telemetry = Telemetry {
                home: Some(home),
                position: Some(Place {
                    latitude: 47.016,
                    amsl_m: 450.0,
                    ..home
                }),
                landed,
                ..Telemetry::default()
            };
            let given = (&Plan::default(), None, Some(&terrain));
            let limits = Limits::default();
            task_with(given, &command, &telemetry, Some(&uploaded), limits).map(drop)
        };
        assert_eq!(judged(Some(LandedState::OnGround)), Ok(()));
        for landed in [Some(LandedState::InAir), None] {
            let why = judged(landed).expect_err("the ridge is higher");
            let expected = "from where the vehicle is, waypoint 7: ";
            assert!(why.contains(expected), "{landed:?}: {why}");
        }
    }

    #[test]
    fn a_route_aboard_is_flown_only_above_the_present_home() {
        let item = Item {
            frame: FRAME_AMSL,
            command: 16,
            z: 500.0,
            ..Item::default()
        };
        let (uploaded, command) = aboard_and_waypoint(CompiledMission {
            items: vec![item],
            waypoint_of: vec![7],
            ..CompiledMission::default()
        });
        let judged = |amsl_m, below_home| {
            let telemetry = Telemetry {
                home: Some(Place {
                    latitude: 47.0,
                    longitude: 8.0,
                    amsl_m,
                }),
                ..Telemetry::default()
            };
            let limits = Limits {
                below_home,
                ..Limits::default()
            };
            task_of(&command, &telemetry, Some(&uploaded), limits).map(drop)
        };
        assert_eq!(judged(488.0, false), Ok(()));
        // The vehicle was carried up a hill after the load.
        let why = judged(520.0, false).expect_err("it is 20 m below home");
        let expected = "the route aboard, from the present home: waypoint 7: 500.0 m AMSL is 20.0 m below home (520.0 m";
        assert!(why.starts_with(expected), "{why}");
        assert_eq!(judged(520.0, true), Ok(()));
    }
}
