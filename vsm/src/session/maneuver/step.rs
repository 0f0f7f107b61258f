//! The steps of a command to PX4: a mode, a launch, a place, a circle, a speed.

use std::ops::RangeInclusive;
use std::time::Duration;

use mapping::mode::Px4Mode;
use mavlink_link::dialect::{MavCmd, MavFrame};
use mavlink_link::service::command::{Command, Payload, Repetition};

use super::{Climb, Confirmation};

/// One step of a maneuver.
#[derive(Debug, Clone, PartialEq)]
pub(crate) enum Step {
    /// Sends a command; a temporary rejection is retried for this long.
    Command {
        command: Command,
        what: &'static str,
        patience: Duration,
    },
    /// Makes the first of these mission items the current one; the vehicle may continue to the last of them at once.
    SetCurrent(RangeInclusive<u16>),
    /// Gives PX4 time to notice a stream that is sent at the same time.
    Pause(Duration),
    /// Waits for it this long; then the vehicle is sent the command once more.
    Insist {
        confirmation: Confirmation,
        command: Command,
        what: &'static str,
        after: Duration,
        again: Again,
    },
    /// Waits until the vehicle shows it.
    Confirm {
        confirmation: Confirmation,
        within: Duration,
    },
}

/// Which vehicle is sent a command once more.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Again {
    /// One that holds instead.
    WhereItHolds,
    /// One that shows the mode, flies a failsafe, or has shown nothing since: in any other mode a pilot or another station has it.
    ///
    /// PX4 takes the end of the sticks (2010) for their loss in whatever mode was commanded meanwhile: it holds, then returns
    /// (NAV_RCL_ACT). Only a mode that is commanded while this failsafe is active takes the vehicle over from it
    /// (FailsafeBase::getSelectedAction).
    AfterSticks,
}

impl Step {
    /// What it waits for, if it only waits.
    pub(super) fn confirmation(&self) -> Option<&Confirmation> {
        match self {
            Step::Insist { confirmation, .. } | Step::Confirm { confirmation, .. } => {
                Some(confirmation)
            }
            Step::Command { .. } | Step::SetCurrent(_) | Step::Pause(_) => None,
        }
    }

    /// The modes of which it waits for one, if it is the last to wait for them.
    pub(super) fn modes(&self) -> Option<&'static [Px4Mode]> {
        match self {
            Step::Confirm {
                confirmation: Confirmation::Mode(modes),
                ..
            } => Some(*modes),
            _ => None,
        }
    }

    /// Whether it waits for a mode, so that the command before it enters that mode.
    pub(super) fn confirms_a_mode(&self) -> bool {
        matches!(
            self,
            Step::Insist {
                confirmation: Confirmation::Mode(_),
                ..
            } | Step::Confirm {
                confirmation: Confirmation::Mode(_),
                ..
            }
        )
    }
}

/// The parameters of MAV_CMD_DO_SET_MODE for a mode of PX4.
pub(crate) fn set_mode(mode: Px4Mode) -> [f32; 7] {
    // PX4 v1.18 refuses the packed custom_mode in param2, and unused parameters that are neither 0 nor NaN.
    let (main, sub) = (f32::from(mode.main()), f32::from(mode.sub()));
    [CUSTOM_MODE_ENABLED, main, sub, 0.0, 0.0, 0.0, 0.0]
}

/// MAV_CMD_DO_SET_MODE to a mode of PX4, and its confirmation.
///
/// A take-off that ends at that very moment puts PX4 into AUTO.LOITER, whatever mode it has just accepted. Then the mode is
/// commanded again; not in any other mode, which might be a pilot's.
pub(crate) fn enter(modes: &'static [Px4Mode]) -> [Step; 3] {
    let mode = modes.first().copied().unwrap_or(Px4Mode::LOITER);
    let command = long(MavCmd::MAV_CMD_DO_SET_MODE, set_mode(mode));
    [
        Step::Command {
            command,
            what: mode.name(),
            patience: MODE_PATIENCE,
        },
        Step::Insist {
            confirmation: Confirmation::Mode(modes),
            command,
            what: mode.name(),
            after: INSIST_AFTER,
            again: Again::WhereItHolds,
        },
        Step::Confirm {
            confirmation: Confirmation::Mode(modes),
            // Both waits together are as long as the wait for any other state.
            within: STATE_WITHIN.saturating_sub(INSIST_AFTER),
        },
    ]
}

/// The mode in which the steps leave a vehicle that is in the mode `now`; `None` if it may be one of several.
pub(crate) fn mode_after(steps: &[Step], now: Option<Px4Mode>) -> Option<Px4Mode> {
    let mut modes = steps.iter().rev().filter_map(Step::modes);
    match modes.next() {
        None => now,
        Some([mode]) => Some(*mode),
        Some(_) => None,
    }
}

/// Arms, and takes off to an altitude above mean sea level.
pub(crate) fn launch(amsl_m: f64) -> Vec<Step> {
    // A short climb may have ended in AUTO.LOITER before a HEARTBEAT shows AUTO.TAKEOFF.
    const TAKEN_OFF: &[Px4Mode] = &[Px4Mode::TAKEOFF, Px4Mode::LOITER];
    // PX4 takes plain AUTO.TAKEOFF to MIS_TAKEOFF_ALT: the altitude must be in the command. Unused parameters that
    // are neither 0 nor NaN are denied.
    let take_off = [0.0, 0.0, 0.0, f32::NAN, f32::NAN, f32::NAN, amsl_m as f32];
    let command = long(MavCmd::MAV_CMD_NAV_TAKEOFF, take_off);
    rising(command, TAKEN_OFF, LIFT_OFF_WITHIN)
}

/// Arms a fixed wing, and takes off to an altitude above mean sea level, where it loiters; around `place` if there is one.
/// PX4 takes off as the vehicle is configured: from a runway, by hand or from a catapult.
pub(crate) fn launch_wing(amsl_m: f64, place: Option<(f64, f64)>) -> Vec<Step> {
    const TAKEN_OFF: &[Px4Mode] = &[Px4Mode::TAKEOFF, Px4Mode::LOITER];
    let params = [0.0, 0.0, 0.0, f32::NAN];
    let command = at_place(MavCmd::MAV_CMD_NAV_TAKEOFF, params, place, amsl_m);
    rising(command, TAKEN_OFF, ROLL_WITHIN)
}

/// Arms a VTOL, and takes off: it climbs in hover to an altitude above mean sea level, transitions towards `place`, and
/// loiters there.
pub(crate) fn launch_vtol(amsl_m: f64, place: (f64, f64)) -> Vec<Step> {
    const TAKEN_OFF: &[Px4Mode] = &[Px4Mode::VTOL_TAKEOFF, Px4Mode::LOITER];
    let params = [0.0, 0.0, 0.0, f32::NAN];
    let command = at_place(
        MavCmd::MAV_CMD_NAV_VTOL_TAKEOFF,
        params,
        Some(place),
        amsl_m,
    );
    rising(command, TAKEN_OFF, ROLL_WITHIN)
}

fn rising(take_off: Command, taken_off: &'static [Px4Mode], within: Duration) -> Vec<Step> {
    // Armed in AUTO.MISSION, PX4 would take off along its mission at once.
    let mut steps: Vec<Step> = enter(&[Px4Mode::LOITER]).into();
    steps.extend([
        Step::Command {
            command: arm(true),
            what: "arming",
            patience: ARM_PATIENCE,
        },
        Step::Confirm {
            confirmation: Confirmation::Armed,
            within: STATE_WITHIN,
        },
        Step::Command {
            command: take_off,
            what: "take-off",
            patience: Duration::ZERO,
        },
        Step::Confirm {
            confirmation: Confirmation::Mode(taken_off),
            within: STATE_WITHIN,
        },
        Step::Confirm {
            // The mode alone does not prove a take-off: AUTO.LOITER was entered before arming.
            confirmation: Confirmation::OffTheGround,
            within,
        },
    ]);
    steps
}

/// The end of a fixed wing's take-off: PX4 then loiters by itself.
pub(crate) fn climbed() -> Step {
    Step::Confirm {
        confirmation: Confirmation::Mode(&[Px4Mode::LOITER]),
        within: CLIMB_WITHIN,
    }
}

/// MAV_CMD_DO_VTOL_TRANSITION, and the state that it leads to.
pub(crate) fn transition(to_hover: bool) -> [Step; 2] {
    let state = if to_hover {
        VTOL_STATE_MC
    } else {
        VTOL_STATE_FW
    };
    [
        Step::Command {
            command: long(
                MavCmd::MAV_CMD_DO_VTOL_TRANSITION,
                [state, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0],
            ),
            what: "transition",
            patience: Duration::ZERO,
        },
        Step::Confirm {
            confirmation: Confirmation::Hovers(to_hover),
            within: TRANSITION_WITHIN,
        },
    ]
}

/// MAV_CMD_GUIDED_CHANGE_HEADING to a course over ground, rad, and the flight along it. PX4 accepts it only in
/// GUIDED_COURSE.
pub(crate) fn course(course_rad: f64) -> [Step; 2] {
    const COURSE_OVER_GROUND: f32 = 0.0;
    let degrees = course_rad.to_degrees().rem_euclid(360.0) as f32;
    [
        Step::Command {
            command: long(
                MavCmd::MAV_CMD_GUIDED_CHANGE_HEADING,
                [COURSE_OVER_GROUND, degrees, 0.0, 0.0, 0.0, 0.0, 0.0],
            ),
            what: "course",
            patience: Duration::ZERO,
        },
        Step::Confirm {
            confirmation: Confirmation::Course(course_rad),
            within: TURN_WITHIN,
        },
    ]
}

/// MAV_CMD_DO_CHANGE_ALTITUDE: PX4 accepts it in AUTO.LOITER and GUIDED_COURSE, and keeps circle and course, but no figure eight.
pub(crate) fn change_altitude(amsl_m: f64) -> [Step; 2] {
    const FRAME_GLOBAL: f32 = 0.0;
    [
        Step::Command {
            command: long(
                MavCmd::MAV_CMD_DO_CHANGE_ALTITUDE,
                [amsl_m as f32, FRAME_GLOBAL, 0.0, 0.0, 0.0, 0.0, 0.0],
            ),
            what: "altitude",
            patience: Duration::ZERO,
        },
        Step::Confirm {
            confirmation: Confirmation::Target {
                place: None,
                amsl_m: Some(amsl_m),
            },
            within: STATE_WITHIN,
        },
    ]
}

/// MAV_CMD_DO_GO_AROUND: PX4 climbs out of a landing, and loiters above the touch-down point.
pub(crate) fn go_around() -> [Step; 2] {
    [
        Step::Command {
            command: long(MavCmd::MAV_CMD_DO_GO_AROUND, [0.0; 7]),
            // PX4's navigator accepts it in any state (navigator_main.cpp): only the mode that follows shows that it took
            // effect.
            what: "go-around",
            patience: Duration::ZERO,
        },
        Step::Confirm {
            confirmation: Confirmation::Mode(&[Px4Mode::LOITER]),
            within: STATE_WITHIN,
        },
    ]
}

/// MAV_CMD_DO_FIGURE_EIGHT of a fixed wing around a place: half its length and the radius of its ends, m, and the direction
/// of its long axis, rad from true north; PX4's own value for each `None`.
pub(crate) fn figure_eight(
    place: (f64, f64),
    amsl_m: f64,
    [half_m, radius_m, bearing_rad]: [Option<f64>; 3],
) -> [Step; 3] {
    let or_own = |value: Option<f64>| value.map_or(f32::NAN, |value| value as f32);
    let params = [or_own(half_m), or_own(radius_m), 0.0, or_own(bearing_rad)];
    let command = at_place(MavCmd::MAV_CMD_DO_FIGURE_EIGHT, params, Some(place), amsl_m);
    [
        Step::Command {
            command,
            what: "figure eight",
            patience: Duration::ZERO,
        },
        Step::Confirm {
            confirmation: Confirmation::Mode(&[Px4Mode::LOITER]),
            within: STATE_WITHIN,
        },
        Step::Confirm {
            confirmation: target(place, Some(amsl_m)),
            within: STATE_WITHIN,
        },
    ]
}

/// What a fixed wing shows of a circle or an eight. AUTO.LOITER alone proves nothing: PX4 accepts one outside its geofence,
/// and continues the loiter before.
fn target(place: (f64, f64), amsl_m: Option<f64>) -> Confirmation {
    Confirmation::Target {
        place: Some(place),
        amsl_m,
    }
}

/// A COMMAND_INT at a place and altitude; INT32_MAX means no place.
fn at_place(command: MavCmd, params: [f32; 4], place: Option<(f64, f64)>, amsl_m: f64) -> Command {
    let (x, y) = place.map_or((i32::MAX, i32::MAX), |(latitude, longitude)| {
        (e7(latitude), e7(longitude))
    });
    Command {
        command,
        payload: Payload::Int {
            frame: MavFrame::MAV_FRAME_GLOBAL,
            params,
            x,
            y,
            z: amsl_m as f32,
        },
        repetition: Repetition::Safe,
    }
}

/// Disarms, and waits until the vehicle reports it.
pub(crate) fn disarm() -> [Step; 2] {
    [
        Step::Command {
            command: arm(false),
            what: "disarming",
            patience: Duration::ZERO,
        },
        Step::Confirm {
            confirmation: Confirmation::Disarmed,
            within: STATE_WITHIN,
        },
    ]
}

/// MAV_CMD_COMPONENT_ARM_DISARM, never forced.
pub(crate) fn arm(armed: bool) -> Command {
    long(
        MavCmd::MAV_CMD_COMPONENT_ARM_DISARM,
        [f32::from(u8::from(armed)), 0.0, 0.0, 0.0, 0.0, 0.0, 0.0],
    )
}

/// MAV_CMD_DO_CHANGE_SPEED. No message of PX4 shows the commanded speed, so the acknowledgement has to be enough.
///
/// PX4 applies a speed to the present leg of a multicopter only as a ground speed, and to the present flight of a fixed
/// wing only as an air speed.
pub(crate) fn change_speed(speed_m_s: f64, hovers: bool) -> Step {
    let kind = if hovers { 1.0 } else { 0.0 };
    Step::Command {
        command: long(
            MavCmd::MAV_CMD_DO_CHANGE_SPEED,
            [kind, speed_m_s as f32, -1.0, 0.0, 0.0, 0.0, 0.0],
        ),
        what: "speed",
        patience: Duration::ZERO,
    }
}

/// MAV_CMD_DO_REPOSITION: to a place, or to another altitude at the place that the vehicle has. Enters AUTO.LOITER.
pub(crate) fn reposition(
    place: Option<(f64, f64)>,
    amsl_m: f64,
    speed_m_s: Option<f64>,
) -> [Step; 3] {
    let speed = speed_m_s.map_or(-1.0, |speed| speed as f32);
    let params = [speed, CHANGE_MODE, 0.0, f32::NAN];
    // Without a place PX4 keeps the one that it flies to, be it a waypoint of its mission (navigator_main.cpp).
    let command = at_place(MavCmd::MAV_CMD_DO_REPOSITION, params, place, amsl_m);
    [
        Step::Command {
            command,
            what: "reposition",
            patience: Duration::ZERO,
        },
        Step::Confirm {
            confirmation: Confirmation::Mode(&[Px4Mode::LOITER]),
            within: STATE_WITHIN,
        },
        Step::Confirm {
            confirmation: Confirmation::Target {
                place,
                amsl_m: Some(amsl_m),
            },
            within: STATE_WITHIN,
        },
    ]
}

/// MAV_CMD_DO_REPOSITION to no place and no altitude: the vehicle stops where it is, or on wings circles there, also where it is in
/// AUTO.LOITER already and flies to a commanded place or altitude. That mode, commanded once more, changes nothing in PX4: it does not
/// call `Loiter::on_activation` again. `circle_m`: the radius with which the vehicle circles, 0 for a hover.
pub(crate) fn stop(circle_m: f64) -> [Step; 3] {
    let params = [-1.0, CHANGE_MODE, 0.0, f32::NAN];
    let command = at_place(MavCmd::MAV_CMD_DO_REPOSITION, params, None, f64::NAN);
    [
        Step::Command {
            command,
            what: "hold",
            patience: Duration::ZERO,
        },
        Step::Confirm {
            confirmation: Confirmation::Mode(&[Px4Mode::LOITER]),
            within: STATE_WITHIN,
        },
        Step::Confirm {
            confirmation: Confirmation::Stays { circle_m },
            within: STATE_WITHIN,
        },
    ]
}

/// The confirmation of a speed on a circle.
pub(crate) fn shows_speed(speed_m_s: f64) -> Step {
    Step::Confirm {
        confirmation: Confirmation::Speed(speed_m_s),
        within: SPEED_WITHIN,
    }
}

/// MAV_CMD_DO_ORBIT around a place; a negative radius is flown counter-clockwise. Enters ORBIT on a multicopter, whose
/// ORBIT_EXECUTION_STATUS shows the circle, AUTO.LOITER on a fixed wing. Without an altitude a multicopter keeps the one
/// that was commanded for its present circle. `climb`: where it flies this circle already.
pub(crate) fn orbit(
    place: (f64, f64),
    amsl_m: Option<f64>,
    radius_m: f64,
    speed_m_s: Option<f64>,
    hovers: bool,
    climb: Option<Climb>,
) -> Vec<Step> {
    let speed = speed_m_s.map_or(f32::NAN, |speed| speed as f32);
    let params = [radius_m as f32, speed, 0.0, f32::NAN];
    // PX4 keeps what is NaN (FlightTaskOrbit::applyCommandParameters).
    let or_kept = amsl_m.unwrap_or(f64::NAN);
    let command = at_place(MavCmd::MAV_CMD_DO_ORBIT, params, Some(place), or_kept);
    const FLOWN: &[Px4Mode] = &[Px4Mode::ORBIT];
    const WINGED: &[Px4Mode] = &[Px4Mode::LOITER];
    let mut steps = vec![
        Step::Command {
            command,
            what: "orbit",
            patience: Duration::ZERO,
        },
        Step::Confirm {
            confirmation: Confirmation::Mode(if hovers { FLOWN } else { WINGED }),
            within: STATE_WITHIN,
        },
    ];
    let confirmation = if hovers {
        Confirmation::Orbit {
            centre: place,
            radius_m,
            climb,
        }
    } else {
        target(place, amsl_m)
    };
    steps.push(Step::Confirm {
        confirmation,
        within: STATE_WITHIN,
    });
    steps
}

fn long(command: MavCmd, params: [f32; 7]) -> Command {
    Command {
        command,
        payload: Payload::Long(params),
        repetition: Repetition::Safe,
    }
}

fn e7(degrees: f64) -> i32 {
    (degrees * 1e7).round() as i32
}

/// DO_SET_MODE param1: MAV_MODE_FLAG_CUSTOM_MODE_ENABLED.
const CUSTOM_MODE_ENABLED: f32 = 1.0;
/// DO_REPOSITION param2: without this flag PX4 denies it outside AUTO.LOITER.
const CHANGE_MODE: f32 = 1.0;
/// HEARTBEAT comes at 1 Hz, and some of them are lost.
const STATE_WITHIN: Duration = Duration::from_secs(6);
/// A vehicle that still holds after this long is sent the command again.
const INSIST_AFTER: Duration = Duration::from_millis(2_500);
/// PX4 spins its motors up before it lifts.
const LIFT_OFF_WITHIN: Duration = Duration::from_secs(12);
/// PX4 refuses to arm for some seconds after its start.
const ARM_PATIENCE: Duration = Duration::from_secs(8);
/// PX4 refuses to fly a mission for some tenths of a second after its upload.
const MODE_PATIENCE: Duration = Duration::from_secs(2);
/// A fixed wing rolls on its runway first.
const ROLL_WITHIN: Duration = Duration::from_secs(60);
/// Enough for a climb at 3 m/s to 500 m.
const CLIMB_WITHIN: Duration = Duration::from_secs(200);
/// VT_TRANS_TIMEOUT is 15 s by default; a transition back slows down first.
const TRANSITION_WITHIN: Duration = Duration::from_secs(30);
/// Enough for half a circle of 200 m radius at 15 m/s.
const TURN_WITHIN: Duration = Duration::from_secs(60);
/// MAV_VTOL_STATE of DO_VTOL_TRANSITION.
const VTOL_STATE_MC: f32 = 3.0;
const VTOL_STATE_FW: f32 = 4.0;
/// Time to reach another speed on a circle.
const SPEED_WITHIN: Duration = Duration::from_secs(15);
