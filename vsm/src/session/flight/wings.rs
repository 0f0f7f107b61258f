//! 2016 for fixed wings, where it differs from a multicopter: launch (21), landing and its abort (19, 20), steering (15),
//! and the transitions of a VTOL.
//!
//! | 2016 | fixed wing | VTOL on its wings | VTOL that hovers |
//! |---|---|---|---|
//! | 11 | AUTO.MISSION | the same | transition, then the same: the route's first item |
//! | 12 | a circle or figure eight by 2017 | a circle; hover (2017 type 4) after a transition | hovers; a circle after a transition |
//! | 15 | GUIDED_COURSE | the same | set points, as a multicopter |
//! | 19 | the landing pattern aboard | the same | lands where it is |
//! | 20 | DO_GO_AROUND, then loiter | loiter | loiter |
//! | 21 | NAV_TAKEOFF, then loiter | | NAV_VTOL_TAKEOFF: transition, then loiter |
//!
//! PX4's course mode keeps a course over ground, an altitude and an air speed. It has no heading, which follows from the
//! wind.

use std::f64::consts::TAU;

use mapping::airframe::Airframe;
use mapping::mode::Px4Mode;
use mapping::report::Commanded;
use mapping::route::Wings;
use mapping::telemetry::Telemetry;
use stanag_msgs::enums::{
    AltitudeCommandType, FlightPathControlMode as Mode, HeadingCommandType, RouteType,
};
use stanag_msgs::messages::VehicleOperatingModeCommand;

use super::settings::Pattern;
use super::situation::{
    NEAR_M, Situation, Task, altitude, check_feasible, check_heights, checked_level,
    does_not_follow_ground, flown_as, has, holds, mission_not_reported, names_mode, place, plain,
    speed,
};
use super::steering::{self, Direction};
use crate::session::context::{MissionView, may_be_on_final};
use crate::session::link::state::VehicleState;
use crate::session::maneuver::{self, Maneuver, Step};
use crate::session::mission::record::UploadedMission;

/// Checks whether the vehicle can begin a route in its present state.
///
/// # Errors
/// A fixed wing is on the ground, or a VTOL is too low for its transition.
pub(super) fn may_begin_a_route(at: &Situation<'_>) -> Result<(), String> {
    let Some(wings) = &at.wings else {
        return Ok(());
    };
    if at.telemetry.stands() {
        return Err("the vehicle is on the ground: launch it first (mode 21, launch)".to_owned());
    }
    if at.telemetry.hovers() {
        check_transition(wings, at)?;
    }
    Ok(())
}

/// The transition that a VTOL needs before flying from this item: PX4 skips the transitions of earlier items and would fly a
/// fixed-wing leg in hover.
///
/// # Errors
/// It is too low for a transition.
pub(super) fn turn_for_the_leg(
    uploaded: &UploadedMission,
    seq: u16,
    at: &Situation<'_>,
    steps: &mut Vec<Step>,
) -> Result<(), String> {
    let Some(wings) = at.wings.as_ref().filter(|wings| wings.vtol) else {
        return Ok(());
    };
    let hovers = uploaded.compiled.hovers_from(seq);
    let turns_itself = uploaded.compiled.turns_at(seq);
    if (hovers == at.telemetry.hovers() && !at.under_way.turns) || turns_itself {
        return Ok(());
    }
    check_transition(wings, at)?;
    // It begins in a hold, without set points or sticks.
    if at.settled_mode() != Some(Px4Mode::LOITER) {
        steps.extend(maneuver::enter(&[Px4Mode::LOITER]));
    }
    steps.extend(maneuver::transition(hovers));
    Ok(())
}

/// Whether a VTOL is high enough to transition.
fn check_transition(wings: &Wings, at: &Situation<'_>) -> Result<(), String> {
    let height_m = at
        .telemetry
        .position
        .zip(at.telemetry.home)
        .map(|(here, home)| here.amsl_m - home.amsl_m)
        .ok_or("the vehicle has not reported position and home yet")?;
    // It hovers at about its commanded altitude.
    if height_m + ALTITUDE_SLACK_M >= wings.transition_m {
        return Ok(());
    }
    Err(format!(
        "a transition {height_m:.0} m above home, at least {:.0} (vehicle.limits.transition_m, VT_FW_MIN_ALT): climb first",
        wings.transition_m
    ))
}

/// Mode 19; `None` if the approach route is flown, which may have to be uploaded first. No steps if its pattern is flown
/// already.
pub(super) fn land(at: &Situation<'_>) -> Result<Option<Task>, String> {
    let approach = has(RouteType::Approach, at);
    let here = || Ok(Some(plain(&[Px4Mode::LAND], at)));
    // Just after a start: a wing in the air would be brought down where it is.
    if at.wings.is_some() && !at.telemetry.airborne() && !at.telemetry.stands() {
        return Err(
            "mode 19 (land): the vehicle has not reported yet whether it is on the ground: command it again in a second".to_owned(),
        );
    }
    if !at.telemetry.airborne() {
        return here();
    }
    if at.wings.is_none() {
        return if approach { Ok(None) } else { here() };
    }
    // Commanded again, for example because no answer came: begun from its start, the pattern would turn a wing off its glide close to
    // the ground, and a VTOL that already hovers towards its touch-down would land short of it.
    if let Some(uploaded) = at.uploaded
        && holds(at.telemetry, uploaded) == Some(true)
        && uploaded.lands(at.telemetry)
    {
        if at.settled_mode() == Some(Px4Mode::MISSION) {
            return Ok(Some(Task::Steps(Vec::new(), at.commanded)));
        }
        // Whether it is still on its glide is known in a second; the wrong guess would turn it there.
        if !at.under_way.enters && uploaded.is_on_final(at.telemetry) {
            return Err(
                "mode 19 (land): on the final approach, and the vehicle has not reported its mode since the last command: command it \
                 again in a second"
                    .to_owned(),
            );
        }
    }
    if at.telemetry.hovers() {
        return here();
    }
    let pattern = at
        .uploaded
        .and_then(|uploaded| Some((uploaded, uploaded.compiled.landing_start()?)));
    // A VTOL would transition to hover and land at its position, and a fixed wing would refuse, although the pattern is
    // aboard.
    if let Some((uploaded, _)) = pattern
        && holds(at.telemetry, uploaded).is_none()
    {
        return Err(mission_not_reported("mode 19 (land)"));
    }
    match pattern.filter(|(uploaded, _)| holds(at.telemetry, uploaded) == Some(true)) {
        Some((uploaded, start)) => {
            let compiled = &uploaded.compiled;
            check_feasible(Mode::AutolandEngage, at)?;
            check_heights(uploaded, at)?;
            let mut steps = vec![Step::SetCurrent(start..=compiled.place_from(start))];
            steps.extend(maneuver::enter(&[Px4Mode::MISSION]));
            // After the mode, with which PX4 repeats the route's speed.
            let cruise_m_s = at.route_performance.cruise_m_s;
            let speed_m_s = compiled.speed_of_landing(at.may_jump(), cruise_m_s);
            steps.extend(speed_m_s.map(|speed_m_s| maneuver::change_speed(speed_m_s, false)));
            Ok(Some(Task::Steps(steps, Commanded::default())))
        }
        None if approach => Ok(None),
        // PX4 transitions to hover and lands here.
        None if at.telemetry.airframe() == Airframe::Vtol => here(),
        None => Err(
            "mode 19 (land): the vehicle carries no landing pattern: send an approach route (13001), or load a route (13000) with \
             vehicle.landing configured"
                .to_owned(),
        ),
    }
}

/// Mode 20: aborts the reported or commanded landing.
pub(super) fn wave_off(at: &Situation<'_>) -> Result<Task, String> {
    let loiter = || Ok(plain(&[Px4Mode::LOITER], at));
    if at.telemetry.mode == Some(Px4Mode::LAND) {
        return loiter();
    }
    let seq = at.telemetry.mission.map(|mission| mission.seq);
    // It may be on its final approach, where a loiter would circle just above the ground.
    if at.telemetry.mode == Some(Px4Mode::MISSION) && at.uploaded.is_some() && seq.is_none() {
        return Err(mission_not_reported("mode 20 (wave-off)"));
    }
    let landing = at
        .uploaded
        .filter(|_| at.telemetry.mode == Some(Px4Mode::MISSION))
        .zip(seq)
        .filter(|(uploaded, seq)| uploaded.compiled.lands(*seq));
    match landing {
        Some((uploaded, seq)) => {
            let low = uploaded.compiled.is_touch_down(seq);
            if low && at.telemetry.airframe() == Airframe::FixedWing {
                // Only this command makes PX4 climb out of a glide.
                Ok(Task::Steps(
                    maneuver::go_around().into(),
                    Commanded::default(),
                ))
            } else {
                loiter()
            }
        }
        // A commanded landing may not be reported yet, and a superseded one may have begun.
        None if at.under_way.lands || (at.under_way.unseen && !at.under_way.enters) => loiter(),
        None => Err(
            "mode 20 (wave-off): the vehicle is not landing, there is nothing to abort".to_owned(),
        ),
    }
}

/// A maneuver that takes a wing off its final approach, in whatever mode.
///
/// It is carried out all the same: a runway that is not free is known to the operator alone. But a hold or a course begins at
/// the height of that moment, which may be a few metres, and only a go-around climbs by itself.
#[derive(Debug)]
pub(super) struct BreakOff {
    /// In these modes the vehicle may have left it.
    modes: Vec<Px4Mode>,
    /// The same by commands before the latest, which may still take effect.
    earlier: Vec<Px4Mode>,
    /// Nothing is commanded that climbs.
    keeps_height: bool,
}

/// What a vehicle that is to leave its final approach reports.
#[derive(Debug, PartialEq, Eq)]
pub(super) enum Shown {
    /// Nothing of it yet.
    NotYet,
    /// It has left the approach, with this text for operators.
    BrokenOff(String),
    /// It has landed, or somebody else has it.
    Otherwise,
}

impl BreakOff {
    /// `None` where the maneuver leaves no final approach, or climbs out of it.
    pub(super) fn by(
        maneuver: &Maneuver,
        telemetry: &Telemetry,
        mission: &MissionView<'_>,
    ) -> Option<BreakOff> {
        let leaves = maneuver.leaves_its_item() && !maneuver.goes_around();
        if !leaves || is_down(telemetry) || !mission.is_on_final(telemetry) {
            return None;
        }
        // A place without an altitude is flown to at the present one.
        let commanded_m = maneuver.commanded.altitude_amsl_m;
        let climbs = commanded_m
            .zip(telemetry.position)
            .is_some_and(|(amsl_m, here)| amsl_m > here.amsl_m + NEAR_M);
        let keeps = |mode| KEEP_HEIGHT.contains(&mode);
        let to_item = maneuver.sends_to().map(|_| Px4Mode::MISSION);
        Some(BreakOff {
            modes: maneuver.modes().chain(to_item).collect(),
            earlier: Vec::new(),
            keeps_height: maneuver.last_mode().is_some_and(keeps) && !climbs,
        })
    }

    /// This one, once something else was commanded.
    pub(super) fn superseded(mut self) -> BreakOff {
        self.modes.retain(|mode| !self.earlier.contains(mode));
        self.earlier.append(&mut self.modes);
        self
    }

    /// This one, commanded while a superseded one may still take effect.
    pub(super) fn after(self, before: BreakOff) -> BreakOff {
        BreakOff {
            earlier: before.earlier,
            ..self
        }
    }

    /// This one, once the vehicle has refused the latest command: those before it may still take effect.
    pub(super) fn refused(mut self) -> Option<BreakOff> {
        self.modes = std::mem::take(&mut self.earlier);
        (!self.modes.is_empty()).then_some(self)
    }

    /// Whether the vehicle has left its final approach, by reports of after the command.
    pub(super) fn shown_by(&self, vehicle: &VehicleState, mission: &MissionView<'_>) -> Shown {
        let telemetry = &vehicle.telemetry;
        let Some(mode) = vehicle.settled_mode() else {
            return Shown::NotYet;
        };
        if is_down(telemetry) {
            return Shown::Otherwise;
        }
        // Within AUTO.MISSION it leaves by another item, which is not known for a second after a silence.
        if mission.is_on_final(telemetry) || may_be_on_final(telemetry) {
            return Shown::NotYet;
        }
        if !self.modes.contains(&mode) && !self.earlier.contains(&mode) {
            return Shown::Otherwise;
        }
        let places = telemetry.position.zip(telemetry.home);
        let height = places.map_or_else(String::new, |(here, home)| {
            format!(", {:.0} m above home", here.amsl_m - home.amsl_m)
        });
        let follows = if self.keeps_height {
            "; it keeps that height until an altitude is commanded (2016)"
        } else {
            ""
        };
        Shown::BrokenOff(format!(
            "the landing is broken off on the final approach{height}, by {}{follows}",
            mode.name()
        ))
    }
}

/// Whether it is known to have landed: just after a start nothing of that is reported yet, which is no landing.
fn is_down(telemetry: &Telemetry) -> bool {
    telemetry.stands() || telemetry.armed == Some(false)
}

/// Mode 21: the steps, and their commanded values.
pub(super) fn launch(
    command: &VehicleOperatingModeCommand,
    at: &Situation<'_>,
    wings: &Wings,
    amsl_m: f64,
) -> Result<(Vec<Step>, Commanded), String> {
    let home = at
        .telemetry
        .home
        .ok_or("mode 21 (launch): home is not known yet")?;
    let height_m = amsl_m - home.amsl_m;
    let place = place(command, at)?;
    let commanded = Commanded {
        altitude_amsl_m: Some(amsl_m),
        loiter_position: place,
        ..Commanded::default()
    };
    if !wings.vtol {
        if height_m < LOWEST_WING_LAUNCH_M {
            return Err(format!(
                "mode 21 (launch): {height_m:.1} m above home, of a fixed wing at least {LOWEST_WING_LAUNCH_M} m"
            ));
        }
        return Ok((maneuver::launch_wing(amsl_m, place), commanded));
    }
    if height_m < wings.transition_m {
        return Err(format!(
            "mode 21 (launch): a transition {height_m:.1} m above home, at least {:.0} (vehicle.limits.transition_m, VT_FW_MIN_ALT)",
            wings.transition_m
        ));
    }
    // PX4 turns towards the loiter to transition. Without a commanded position the loiter is ahead: the crew has set the
    // vehicle up with its nose into the wind.
    let ahead = || {
        let here = at.telemetry.position?;
        let nose = at.telemetry.attitude?.yaw;
        let from = (here.latitude, here.longitude);
        let away_m = 2.0 * wings.loiter_radius_m.abs();
        Some(mapping::limits::moved(from, nose, away_m))
    };
    let loiter = place
        .or_else(ahead)
        .ok_or("mode 21 (launch): the vehicle has not reported position and heading yet")?;
    let commanded = Commanded {
        // It loiters at the height of its parameter, whatever the altitude of its transition.
        altitude_amsl_m: at.vtol_loiter_m.map(|above_m| home.amsl_m + above_m),
        loiter_position: Some(loiter),
        ..commanded
    };
    Ok((maneuver::launch_vtol(amsl_m, loiter), commanded))
}

/// Mode 15 on wings.
pub(super) fn steer(
    command: &VehicleOperatingModeCommand,
    at: &Situation<'_>,
) -> Result<Task, String> {
    if !at.telemetry.airborne() {
        return Err("mode 15 (autopilot) needs an airborne vehicle".to_owned());
    }
    let course_rad = match command.heading_command_type {
        Some(
            kind @ (HeadingCommandType::Heading
            | HeadingCommandType::HeadingAndCourse
            | HeadingCommandType::TurnRate),
        ) => {
            return Err(format!(
                "mode 15 (autopilot): Heading Command Type {} on wings: PX4 keeps a course over ground, the heading follows from the \
                 wind; command a course (type 2)",
                kind.raw()
            ));
        }
        _ => match steering::direction(command)? {
            Some(Direction::Steady { track, .. }) => Some(track),
            Some(Direction::Turning(_)) | None => None,
        },
    };
    let level = match (command.altitude_command_type, altitude(command)) {
        (Some(AltitudeCommandType::VerticalSpeed), _) => {
            return Err(
                "mode 15 (autopilot): Altitude Command Type 2 (vertical speed) on wings: PX4 climbs by its own rate; command an altitude \
                 (type 1)"
                    .to_owned(),
            );
        }
        (_, Some(metres)) => {
            does_not_follow_ground(command, at)?;
            Some(checked_level(metres, command, &[], at)?)
        }
        (_, None) => None,
    };
    let speed_m_s = speed(command, &at.performance)?;
    let entered = at.settled_mode() == Some(Px4Mode::COURSE);
    let mut commanded = if entered {
        at.commanded
    } else {
        Commanded::default()
    };
    commanded.loiter_position = None;
    let mut steps = Vec::new();
    if !entered {
        // On entry PX4 keeps the present course and altitude, at its default speed.
        steps.extend(maneuver::enter(&[Px4Mode::COURSE]));
    }
    // Speed and altitude first: otherwise they would wait for the turn, which takes a while.
    if let Some(speed_m_s) = speed_m_s {
        steps.push(maneuver::change_speed(speed_m_s, false));
        commanded.speed_m_s = Some(speed_m_s);
        commanded.speed_type = Some(flown_as(false));
    }
    if let Some(level) = level {
        let home = at.telemetry.home.ok_or("home is not known yet")?;
        let amsl_m = level.amsl(home.amsl_m);
        steps.extend(maneuver::change_altitude(amsl_m));
        commanded.altitude_amsl_m = Some(amsl_m);
    }
    if let Some(course_rad) = course_rad {
        steps.extend(maneuver::course(course_rad.rem_euclid(TAU)));
        commanded.direction = steering::reported(command);
    }
    Ok(Task::Steps(steps, commanded))
}

/// Whether the vehicle hovers in a loiter of this pattern; adds a transition if needed.
///
/// # Errors
/// A transition would be on the ground or too low.
pub(super) fn transition_for(
    pattern: Pattern,
    named: bool,
    at: &Situation<'_>,
    steps: &mut Vec<Step>,
) -> Result<bool, String> {
    let hovers = at.telemetry.hovers();
    let Some(wings) = at.wings.as_ref().filter(|wings| wings.vtol) else {
        return Ok(hovers);
    };
    let wanted = match pattern {
        Pattern::Own => hovers,
        Pattern::Hover => true,
        Pattern::Circle(_) | Pattern::FigureEight(_) => false,
    };
    // A change of altitude or speed alone is not a new loiter.
    if (wanted == hovers && !at.under_way.turns) || !named {
        return Ok(hovers);
    }
    if !at.telemetry.airborne() {
        return Err("mode 12 (loiter): a transition needs an airborne vehicle".to_owned());
    }
    check_transition(wings, at)?;
    steps.extend(maneuver::transition(wanted));
    Ok(wanted)
}

/// Whether a pattern is flown around the present position if no position is commanded: for fixed wings, if the mode is
/// commanded.
pub(super) fn circles_here(
    pattern: Pattern,
    hovers: bool,
    command: &VehicleOperatingModeCommand,
) -> bool {
    let shaped = matches!(pattern, Pattern::Circle(_) | Pattern::FigureEight(_));
    !hovers && shaped && names_mode(command)
}

/// Checks whether a fixed wing can fly this radius at the commanded speed, or at its own.
pub(super) fn check_circle(
    wings: &Wings,
    radius_m: f64,
    speed_m_s: Option<f64>,
    at: &Situation<'_>,
) -> Result<(), String> {
    let speed_m_s = speed_m_s.unwrap_or(at.route_performance.cruise_m_s);
    let least_m = wings.turn_radius_m(speed_m_s);
    if radius_m >= least_m {
        return Ok(());
    }
    Err(format!(
        "Loiter Radius {radius_m:.0} m at {speed_m_s:.1} m/s, at least {least_m:.0} (FW_R_LIM)"
    ))
}

/// Modes that begin at the present height and keep it.
const KEEP_HEIGHT: [Px4Mode; 4] = [
    Px4Mode::LOITER,
    Px4Mode::ORBIT,
    Px4Mode::COURSE,
    Px4Mode::OFFBOARD,
];
/// Below this height a fixed wing would loiter among obstacles around its runway, m.
const LOWEST_WING_LAUNCH_M: f64 = 10.0;
/// How far below its altitude a VTOL may hover, m: the default of NAV_MC_ALT_RAD.
const ALTITUDE_SLACK_M: f64 = 0.8;

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_refused_command_leaves_what_was_commanded_before_it() {
        let by = |mode| BreakOff {
            modes: vec![mode],
            earlier: Vec::new(),
            keeps_height: true,
        };
        assert!(by(Px4Mode::LOITER).refused().is_none());
        // A return, right after a hold that the vehicle has not reported yet.
        let both = by(Px4Mode::RTL).after(by(Px4Mode::LOITER).superseded());
        assert_eq!(
            (&both.modes[..], &both.earlier[..]),
            (&[Px4Mode::RTL][..], &[Px4Mode::LOITER][..])
        );
        let rest = both.refused().expect("the hold");
        assert_eq!(rest.modes, [Px4Mode::LOITER]);
        // A go-around takes it off its approach by itself, and may be refused too.
        let superseded = rest.superseded().superseded();
        assert!(superseded.modes.is_empty());
        let rest = superseded.refused().expect("the hold");
        assert!(rest.refused().is_none());
    }
}
