//! Which curved legs of a compiled route may be streamed (`vehicle.curve.mode = "offboard"`): flown as drawn, by set points,
//! in place of their chords.
//!
//! The chords stay in the mission: they are what is flown where the stream cannot begin, ends early or fails. So a curve is
//! streamed only if the mission does nothing on it but fly: PX4 executes no item while it is in OFFBOARD.

use std::ops::RangeInclusive;

use curve_paths::Ground;
use mavlink_link::service::mission::Item;

use super::curve;
use super::item::{DO_CHANGE_SPEED, DO_JUMP, NAV_WAYPOINT, degrees_e7};
use super::mission::{CompiledMission, Leg, StreamedLeg, StreamedRun};
use super::site::Site;
use super::waypoint;
use crate::altitude::Level;
use crate::parameter::Parameters;
use crate::plan::{Curve, Plan};

/// The runs of a mission, and why the other curves are flown as chords.
pub(super) fn runs(
    plan: &Plan,
    compiled: &CompiledMission,
    site: &Site<'_>,
) -> (Vec<StreamedRun>, Vec<String>) {
    let (mut runs, mut notes): (Vec<StreamedRun>, Vec<String>) = (Vec::new(), Vec::new());
    let mut speed_m_s = site.performance.cruise_m_s;
    let mut legs = compiled.order.iter();
    let Some(mut p1) = legs.next() else {
        return (runs, notes);
    };
    speed_m_s = p1.speed_m_s.unwrap_or(speed_m_s);
    for p4 in legs {
        speed_m_s = p4.speed_m_s.unwrap_or(speed_m_s);
        let curve = plan.curves_from(p1.number).find(|(to, _)| *to == p4.number);
        if let Some((_, curve)) = curve {
            match leg((p1, p4), curve, speed_m_s, (plan, compiled), site) {
                Ok((entry, leg)) => {
                    let end = leg.end;
                    match runs.last_mut().filter(|run| run.resume == entry) {
                        Some(run) => {
                            run.legs.push(leg);
                            run.resume = end;
                        }
                        None => runs.push(StreamedRun {
                            entry,
                            legs: vec![leg],
                            resume: end,
                            exit: None,
                        }),
                    }
                }
                Err(why) => notes.push(format!(
                    "curve {} to {} is flown as chords, not streamed: {why}",
                    p1.number, p4.number
                )),
            }
        }
        p1 = p4;
    }
    for run in &mut runs {
        if let Some((resume, exit)) = exit(compiled, run.resume) {
            (run.resume, run.exit) = (resume, Some(exit));
        }
    }
    (runs, notes)
}

/// Whether PX4's own reaction to a stream that stops is known and safe.
///
/// # Errors
/// The parameter that forbids it, its value, and what was expected.
pub fn permitted(parameters: &Parameters) -> Result<(), String> {
    let of = |name: &str| {
        parameters
            .get(name)
            .ok_or_else(|| format!("the vehicle has not reported {name}"))
    };
    let action = of("COM_OBL_RC_ACT")?;
    if !LOSS_ACTIONS.contains(&action) {
        return Err(format!(
            "COM_OBL_RC_ACT is {action:.0}, expected 5 (hold), 3 (return) or 4 (land): what PX4 does when set points stop"
        ));
    }
    let after_s = of("COM_OF_LOSS_T")?;
    if !LOSS_AFTER_S.contains(&after_s) {
        return Err(format!(
            "COM_OF_LOSS_T is {after_s:.2} s, expected {} to {} s: when PX4 takes set points for lost",
            LOSS_AFTER_S.start(),
            LOSS_AFTER_S.end()
        ));
    }
    Ok(())
}

/// A leg, and the item of its P1.
fn leg(
    (p1, p4): (&Leg, &Leg),
    curve: &Curve,
    speed_m_s: f64,
    (plan, compiled): (&Plan, &CompiledMission),
    site: &Site<'_>,
) -> Result<(u16, StreamedLeg), String> {
    let over_ground = |leg: &Leg| {
        let waypoint = plan.waypoint(leg.number);
        waypoint
            .and_then(|waypoint| waypoint::above_ground(waypoint, site))
            .is_some()
    };
    if over_ground(p1) || over_ground(p4) {
        return Err("it follows the ground".to_owned());
    }
    // PX4 stops cameras where it leaves AUTO.MISSION, and returns to the place before to begin them again (mission_base.cpp);
    // the nose follows a starepoint, which a set point would overrule. A route does nothing but fly.
    let acts = |item: &&Item| !item.is_flown_to() && !FLIES.contains(&item.command);
    if let Some(item) = compiled.items.iter().find(acts) {
        return Err(format!(
            "the route commands more than flight (item of command {})",
            item.command
        ));
    }
    let missing = || "its items are not known".to_owned();
    let entry = arrival(compiled, p1).ok_or_else(missing)?;
    let end = arrival(compiled, p4).ok_or_else(missing)?;
    let item = |at: usize| compiled.items.get(at);
    if !item(entry).is_some_and(passes) {
        return Err(format!("the vehicle stays at waypoint {}", p1.number));
    }
    let mut vertices = Vec::new();
    for at in entry + 1..end {
        let of = item(at).ok_or_else(missing)?;
        if passes(of) && compiled.waypoint_of.get(at) == Some(&p4.number) {
            vertices.push((ground(of), seq(at + 1)?));
        } else if of.command != DO_CHANGE_SPEED {
            return Err(format!(
                "the mission acts on the way from waypoint {}",
                p1.number
            ));
        }
    }
    let (curve, above_home) =
        curve::bezier((p1, p4), curve, None, site).map_err(|fault| fault.to_string())?;
    Ok((
        seq(entry)?,
        StreamedLeg {
            ends: (p1.number, p4.number),
            curve,
            above_home,
            speed_m_s,
            vertices,
            end: seq(end)?,
        },
    ))
}

/// Where the mission continues after the item of the last P4, if the vehicle flies on from there at once.
fn exit(compiled: &CompiledMission, end: u16) -> Option<(u16, (Ground, Level))> {
    let at = usize::from(end);
    compiled.items.get(at).filter(|item| passes(item))?;
    let mut after = compiled.items.iter().skip(at + 1);
    let next = after.find(|item| item.command != DO_CHANGE_SPEED);
    let next = next.filter(|item| item.command == NAV_WAYPOINT)?;
    let level = Level::of_frame(next.frame, next.z.into())?;
    Some((end.checked_add(1)?, (ground(next), level)))
}

/// The item with which the vehicle arrives at a waypoint.
fn arrival(compiled: &CompiledMission, leg: &Leg) -> Option<usize> {
    let place = (degrees_e7(leg.latitude), degrees_e7(leg.longitude));
    let items = compiled.items.iter().zip(&compiled.waypoint_of);
    // The last: a curve may pass its end before.
    let mut here = items.enumerate().filter(|(_, (item, number))| {
        **number == leg.number && item.is_flown_to() && (item.x, item.y) == place
    });
    here.next_back().map(|(at, _)| at)
}

/// Whether the vehicle flies through the item; a stop that PX4 needs to find it is none of the route's.
fn passes(item: &Item) -> bool {
    item.command == NAV_WAYPOINT && item.params[0] <= BRAKES_S
}

fn ground(item: &Item) -> Ground {
    let degrees = |e7: i32| f64::from(e7) * 1e-7;
    Ground::new(degrees(item.x), degrees(item.y))
}

fn seq(at: usize) -> Result<u16, String> {
    u16::try_from(at).map_err(|_| "it is beyond item 65535".to_owned())
}

/// COM_OBL_RC_ACT: return, land, hold. The others leave the vehicle to sticks that nobody may hold, or stop its motors.
const LOSS_ACTIONS: [f64; 3] = [3.0, 4.0, 5.0];
/// COM_OF_LOSS_T, s. Less would take every lost datagram for a loss; for as long as it lasts the last set point is flown.
const LOSS_AFTER_S: RangeInclusive<f64> = 0.5..=1.0;
/// Items without a place that belong to the flight.
const FLIES: [u16; 2] = [DO_CHANGE_SPEED, DO_JUMP];
/// The hold of `brake`, s.
const BRAKES_S: f32 = 0.1;

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_stream_is_permitted_where_px4s_reaction_to_its_loss_is_known_and_safe() {
        let with = |action: Option<f64>, after_s: Option<f64>| {
            let mut parameters = Parameters::default();
            for (name, value) in [("COM_OBL_RC_ACT", action), ("COM_OF_LOSS_T", after_s)] {
                if let Some(value) = value {
                    assert!(parameters.set(name, value));
                }
            }
            permitted(&parameters)
        };
        for action in [3.0, 4.0, 5.0] {
            assert_eq!(with(Some(action), Some(1.0)), Ok(()));
        }
        for action in [0.0, 1.0, 2.0, 6.0, 7.0] {
            let why = with(Some(action), Some(1.0)).unwrap_err();
            assert!(why.contains("COM_OBL_RC_ACT"), "{why}");
        }
        for after_s in [0.0, 0.2, 1.5, 60.0] {
            let why = with(Some(5.0), Some(after_s)).unwrap_err();
            assert!(why.contains("COM_OF_LOSS_T"), "{why}");
        }
        assert!(
            with(None, Some(1.0))
                .unwrap_err()
                .contains("COM_OBL_RC_ACT")
        );
        assert!(with(Some(5.0), None).unwrap_err().contains("COM_OF_LOSS_T"));
    }
}
