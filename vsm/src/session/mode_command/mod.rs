//! What a 2016 asks of PX4, or why PX4 cannot do it.
//!
//! A field that is absent is not commanded. So are the values that a full presence vector carries for "nothing": an
//! altitude or heading command type 0, speed 0, waypoint 0, and a loiter position of exactly 0, 0.

mod launch;
mod loiter;
mod route;
mod steer;
mod values;

pub(crate) use route::flies_anew;

use mapping::altitude::{Agl, Altimeter};
use mapping::limits::Limits;
use mapping::limits::Performance;
use mapping::mode::Px4Mode;
use mapping::plan::Plan;
use mapping::report::Commanded;
use mapping::telemetry::Telemetry;
use stanag_msgs::enums::{FlightPathControlMode as Mode, HeadingCommandType, RouteType};
use stanag_msgs::messages::{LoiterConfiguration, VehicleOperatingModeCommand};

use self::launch::launch;
use self::loiter::loiter;
use self::route::{fly, waypoint};
use self::steer::steer;
use self::values::altitude;
use super::maneuver::{self, Step};
use super::plan_record::UploadedMission;
use super::steering;

/// What is to be done.
#[derive(Debug)]
pub(crate) enum Task {
    /// Nothing is asked of the vehicle, and what it is about goes on.
    Nothing,
    /// These steps; then this is what 3002 reports as commanded.
    Steps(Vec<Step>, Commanded),
    /// A launch: its steps, undone by disarming when it fails on the ground.
    Launch(Vec<Step>, Commanded),
    /// The route of this type must first go aboard, then the command is looked at again.
    Load(RouteType),
    /// What 13000 has loaded must first go aboard again, then the command is looked at again.
    Reload,
    /// Manual flight: sticks, then the mode.
    Manual,
    /// Steering: set points, then the mode.
    Steer(steering::Order, Commanded),
}

impl Task {
    /// Whether a route is flown for it, by a vehicle that is in the mode `now`.
    pub(crate) fn flies_a_route(&self, now: Option<Px4Mode>) -> bool {
        match self {
            Task::Load(_) | Task::Reload => true,
            Task::Steps(steps, _) | Task::Launch(steps, _) => {
                maneuver::mode_after(steps, now) == Some(Px4Mode::MISSION)
            }
            Task::Nothing | Task::Manual | Task::Steer(..) => false,
        }
    }
}

/// What must be known to decide.
#[derive(Debug, Clone)]
pub(crate) struct Situation<'a> {
    pub(crate) telemetry: &'a Telemetry,
    pub(crate) aboard: Option<&'a UploadedMission>,
    /// What 13000 has loaded last.
    pub(crate) loaded_mission: Option<&'a UploadedMission>,
    /// What has been sent.
    pub(crate) plan: &'a Plan,
    /// The route aboard has just been loaded for this command.
    pub(crate) just_loaded: bool,
    /// A command that enters a mode is being carried out.
    pub(crate) entering: bool,
    pub(crate) loiter: &'a LoiterConfiguration,
    pub(crate) commanded: Commanded,
    pub(crate) agl: Agl,
    pub(crate) altimeter: Altimeter,
    pub(crate) limits: Limits,
    pub(crate) performance: Performance,
}

/// The mode that a command is about: its own, or the present one where it names none.
pub(crate) fn mode_of(
    command: &VehicleOperatingModeCommand,
    telemetry: &Telemetry,
) -> Option<Mode> {
    command
        .select_flight_path_control_mode
        .filter(|mode| *mode != Mode::NoMode)
        .or_else(|| telemetry.mode.map(Px4Mode::reported))
}

fn steps_to_waypoint(command: &VehicleOperatingModeCommand) -> bool {
    command
        .commanded_waypoint_number
        .is_some_and(|number| number != 0)
}

fn names_mode(command: &VehicleOperatingModeCommand) -> bool {
    command
        .select_flight_path_control_mode
        .is_some_and(|mode| mode != Mode::NoMode)
}

/// Whether no mode, altitude, speed, heading, place or waypoint is commanded: nothing is to be flown otherwise.
fn names_nothing(command: &VehicleOperatingModeCommand) -> bool {
    let angles = [
        command.loiter_position_latitude,
        command.loiter_position_longitude,
    ];
    altitude(command).is_none()
        && command
            .commanded_vertical_speed
            .is_none_or(|rate| rate.si() == 0.0)
        && command
            .commanded_speed
            .is_none_or(|speed| speed.si() == 0.0)
        && command
            .heading_command_type
            .is_none_or(|kind| kind == HeadingCommandType::None)
        && !steps_to_waypoint(command)
        && angles
            .iter()
            .all(|angle| angle.is_none_or(|angle| angle.degrees() == 0.0))
}

/// Decides.
///
/// # Errors
/// The reason, for the operator.
pub(crate) fn task(
    command: &VehicleOperatingModeCommand,
    at: &Situation<'_>,
) -> Result<Task, String> {
    let mode = mode_of(command, at.telemetry)
        .ok_or("no mode is commanded, and the vehicle has told none")?;
    if !names_mode(command) {
        if names_nothing(command) {
            // A setting that is kept, such as the altimeter's.
            return Ok(Task::Nothing);
        }
        if at.entering {
            return Err(
                "no mode is commanded, and another is being entered: name the mode that it is for"
                    .to_owned(),
            );
        }
        if !matches!(mode, Mode::Waypoint | Mode::Loiter | Mode::Autopilot) {
            return Err(format!(
                "no mode is commanded, and in the present one, {}, nothing can be changed",
                mode.raw()
            ));
        }
    }
    if let Some(heading) = command.heading_command_type
        && heading != HeadingCommandType::None
        && mode != Mode::Autopilot
    {
        return Err(format!(
            "heading commands are not flown in mode {}",
            mode.raw()
        ));
    }
    match mode {
        Mode::Waypoint => waypoint(command, at),
        Mode::Loiter => loiter(command, at),
        Mode::Launch => launch(command, at),
        Mode::AutolandEngage if at.telemetry.airborne() && has(RouteType::Approach, at) => {
            fly(command, RouteType::Approach, at)
        }
        Mode::AutolandEngage => Ok(plain(&[Px4Mode::LAND], at)),
        Mode::ContingencyA => contingency(command, RouteType::ContingencyA, &[Px4Mode::RTL], at),
        Mode::ContingencyB => contingency(command, RouteType::ContingencyB, &[Px4Mode::LAND], at),
        // A multicopter that lands is stopped where it is; DO_GO_AROUND is for wings.
        Mode::AutolandWaveOff if at.telemetry.mode == Some(Px4Mode::LAND) => {
            Ok(plain(&[Px4Mode::LOITER], at))
        }
        Mode::AutolandWaveOff if at.telemetry.hovers() => Err(
            "mode 20 (wave-off): the vehicle is not landing, there is nothing to break off"
                .to_owned(),
        ),
        Mode::FlightDirector => Ok(Task::Manual),
        Mode::Autopilot => steer(command, at),
        other => Err(format!("mode {}: PX4 cannot do that", other.raw())),
    }
}

fn plain(modes: &'static [Px4Mode], at: &Situation<'_>) -> Task {
    let commanded = if at.telemetry.mode.is_some_and(|mode| modes.contains(&mode)) {
        at.commanded
    } else {
        Commanded::default()
    };
    Task::Steps(maneuver::enter(modes).into(), commanded)
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

/// Whether the plan holds a route of this type.
fn has(route: RouteType, at: &Situation<'_>) -> bool {
    at.plan.route_of_type(route).is_some()
}
