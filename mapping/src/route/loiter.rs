//! Loiters of a route (13003) as items of PX4.
//!
//! | 13003 | multicopter | fixed wing |
//! |---|---|---|
//! | circular (or no type) | hovers: PX4 flies no circle within a mission there | circle of Loiter Radius, the vehicle's own where absent |
//! | hover | hovers | refused |
//! | racetrack, figure 8 | refused | refused |
//! | direction | of no effect; into the wind, or an unknown one, is refused | sign of the radius: clockwise positive; into the wind, or an unknown one, is refused |
//! | speed | of no effect; an unknown Speed Type beside it is refused | DO_CHANGE_SPEED; an unknown Speed Type beside it is refused |
//! | duration in seconds | NAV_LOITER_TIME | NAV_LOITER_TIME |
//! | duration in turns | refused | the time that so many turns take at the loiter's speed, where radius and speed are given |
//! | duration absent | NAV_LOITER_UNLIM | NAV_LOITER_UNLIM |
//! | duration 0 | no loiter: NAV_WAYPOINT | no loiter: NAV_WAYPOINT |
//!
//! PX4 has no item of a number of turns: it refuses NAV_LOITER_TURNS.

use std::f64::consts::TAU;

use stanag_msgs::enums::{LoiterDirection, LoiterDurationUnits, LoiterType, SpeedType};
use stanag_msgs::messages::UaLoiterWaypoint;

use super::error::Reason;
use super::item::NAV_LOITER_UNLIM;
use super::site::Site;
use crate::limits::{Performance, WIDEST_CIRCLE_M, disc};
use crate::plan::Plan;

/// A loiter as PX4 flies it: command and param1 to param4 of the item at its place, and the speed within it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Loiter {
    pub(super) command: u16,
    pub(super) params: [f32; 4],
    /// Loiter Speed, where the vehicle flies a circle.
    pub(super) speed_m_s: Option<f64>,
}

/// The loiter that is flown at a waypoint. A duration of 0 means none (Edition 2.5, #803 field 5); an absent duration means
/// without end.
pub(super) fn flown_at(plan: &Plan, number: u16) -> Option<&UaLoiterWaypoint> {
    plan.loiter(number)
        .filter(|loiter| loiter.loiter_duration != Some(0))
}

/// The places that a vehicle flies over at a waypoint: its position, and on wings the circle of its loiter.
pub(super) fn flown_over(
    centre: (f64, f64),
    requested: Option<&UaLoiterWaypoint>,
    site: &Site,
) -> Vec<(f64, f64)> {
    let circle = requested.zip(site.wings).map(|(requested, wings)| {
        let radius_m = requested.loiter_radius.map_or(0.0, |radius| radius.si());
        if radius_m > 0.0 {
            radius_m
        } else {
            wings.loiter_radius_m.abs()
        }
    });
    circle.map_or_else(|| vec![centre], |radius_m| disc(centre, radius_m))
}

/// `leg_speed_m_s` is the speed of the leg to the loiter, where one is commanded.
pub(super) fn loiter(
    requested: &UaLoiterWaypoint,
    leg_speed_m_s: Option<f64>,
    hovers: bool,
    performance: &Performance,
) -> Result<Loiter, Reason> {
    pattern(requested, hovers)?;
    let radius_m = radius(requested, hovers)?;
    let speed_m_s = speed(requested, hovers, performance)?;
    let seconds = match requested.loiter_duration {
        None => None,
        Some(duration) => match requested.loiter_duration_units {
            None | Some(LoiterDurationUnits::Seconds) => Some(f64::from(duration)),
            // PX4 refuses NAV_LOITER_TURNS, so turns become the time they take; a multicopter flies no circle here.
            Some(LoiterDurationUnits::Turns) => match speed_m_s.or(leg_speed_m_s) {
                Some(speed_m_s) if !hovers && radius_m != 0.0 => {
                    Some(f64::from(duration) * TAU * radius_m.abs() / speed_m_s)
                }
                _ => return Err(Reason::LoiterTurns),
            },
            Some(LoiterDurationUnits::Unknown(value)) => {
                return Err(Reason::unknown("Loiter Duration Units", value));
            }
        },
    };
    let radius = radius_m as f32;
    let (command, params) = match seconds {
        None => (NAV_LOITER_UNLIM, [0.0, 0.0, radius, f32::NAN]),
        Some(seconds) => (NAV_LOITER_TIME, [seconds as f32, 0.0, radius, 0.0]),
    };
    Ok(Loiter {
        command,
        params,
        speed_m_s,
    })
}

fn pattern(requested: &UaLoiterWaypoint, hovers: bool) -> Result<(), Reason> {
    match requested.waypoint_loiter_type {
        None | Some(LoiterType::Circular) => Ok(()),
        Some(LoiterType::Hover) if hovers => Ok(()),
        Some(LoiterType::Hover) => Err(Reason::LoiterType("hover: it is a fixed wing")),
        Some(LoiterType::Racetrack) => Err(Reason::LoiterType("racetrack")),
        Some(LoiterType::Figure8) => Err(Reason::LoiterType("figure 8")),
        Some(LoiterType::Unknown(value)) => Err(Reason::unknown("Waypoint Loiter Type", value)),
    }
}

/// Metres, negative for counter-clockwise; 0 is the vehicle's own radius.
fn radius(requested: &UaLoiterWaypoint, hovers: bool) -> Result<f64, Reason> {
    let radius_m = requested.loiter_radius.map_or(0.0, |radius| radius.si());
    // The limit is declared for every vehicle (41003), so it applies to one that hovers too.
    if radius_m > WIDEST_CIRCLE_M {
        return Err(Reason::LoiterRadius(radius_m));
    }
    match requested.loiter_direction {
        None | Some(LoiterDirection::VehicleDependent) => Ok(radius_m),
        // An undefined direction is refused for one that hovers too: only 0 to 2 are declared.
        Some(LoiterDirection::IntoWind) => Err(Reason::LoiterType("turn into the wind")),
        Some(LoiterDirection::Unknown(value)) => Err(Reason::unknown("Loiter Direction", value)),
        _ if hovers => Ok(radius_m),
        // The sign of a radius of 0 has no meaning.
        Some(LoiterDirection::Clockwise | LoiterDirection::CounterClockwise) if radius_m == 0.0 => {
            Err(Reason::Missing("Loiter Radius beside Loiter Direction"))
        }
        Some(LoiterDirection::Clockwise) => Ok(radius_m),
        Some(LoiterDirection::CounterClockwise) => Ok(-radius_m),
    }
}

/// m/s on the circle; `None` for a vehicle that hovers.
fn speed(
    requested: &UaLoiterWaypoint,
    hovers: bool,
    performance: &Performance,
) -> Result<Option<f64>, Reason> {
    // A full presence vector carries 0 for no speed.
    let commanded = requested.loiter_speed.map(|speed| speed.si());
    let Some(speed_m_s) = commanded.filter(|speed_m_s| *speed_m_s != 0.0) else {
        return Ok(None);
    };
    match requested.speed_type {
        None | Some(SpeedType::Indicated | SpeedType::True | SpeedType::Ground) => {}
        Some(other) => return Err(Reason::unknown("Speed Type", other.raw())),
    }
    // After the check above: an unknown Speed Type is refused even where the speed has no effect.
    if hovers {
        return Ok(None);
    }
    Ok(Some(performance.check(speed_m_s)?))
}

pub(super) const NAV_LOITER_TIME: u16 = 19;

#[cfg(test)]
mod tests {
    use super::*;
    use stanag_msgs::{Id, Scaled};

    fn circle() -> UaLoiterWaypoint {
        UaLoiterWaypoint {
            waypoint_loiter_type: Some(LoiterType::Circular),
            loiter_radius: Some(Scaled::saturating_from_si(60.0)),
            ..UaLoiterWaypoint::default()
        }
    }

    fn made(
        requested: &UaLoiterWaypoint,
        leg: Option<f64>,
        hovers: bool,
    ) -> Result<Loiter, Reason> {
        loiter(requested, leg, hovers, &Performance::default())
    }

    #[test]
    fn a_duration_of_0_is_no_loiter_and_an_absent_one_has_no_end() {
        let (cucs, vehicle) = (Id(0x1b00_00a0), Id(0x1b00_0101));
        let mut plan = Plan::default();
        for (number, duration) in [(1, None), (2, Some(0)), (3, Some(4))] {
            let message = UaLoiterWaypoint {
                waypoint_number: Some(number),
                loiter_duration: duration,
                ..circle()
            };
            plan.store(&message.into(), cucs, vehicle).unwrap();
        }
        let command = |number| {
            let requested = flown_at(&plan, number)?;
            Some(made(requested, None, true).unwrap().command)
        };
        assert_eq!(command(1), Some(NAV_LOITER_UNLIM));
        assert_eq!(command(2), None);
        assert_eq!(command(3), Some(NAV_LOITER_TIME));
    }

    #[test]
    fn the_sign_of_the_radius_is_the_direction() {
        let mut requested = circle();
        for (direction, radius) in [
            (LoiterDirection::Clockwise, 60.0),
            (LoiterDirection::CounterClockwise, -60.0),
            (LoiterDirection::VehicleDependent, 60.0),
        ] {
            requested.loiter_direction = Some(direction);
            let item = made(&requested, None, false).unwrap();
            assert_eq!((item.command, item.params[2]), (NAV_LOITER_UNLIM, radius));
        }
        requested.loiter_direction = Some(LoiterDirection::IntoWind);
        assert!(made(&requested, None, false).is_err());
        requested.loiter_direction = Some(LoiterDirection::CounterClockwise);
        requested.loiter_radius = None;
        assert!(matches!(
            made(&requested, None, false),
            Err(Reason::Missing(_))
        ));
    }

    #[test]
    fn an_unknown_value_is_refused_where_the_vehicle_hovers_too() {
        for hovers in [true, false] {
            for direction in [LoiterDirection::IntoWind, LoiterDirection::Unknown(9)] {
                let mut requested = circle();
                requested.loiter_direction = Some(direction);
                assert!(made(&requested, None, hovers).is_err(), "{direction:?}");
            }
            let mut requested = circle();
            requested.loiter_speed = Some(Scaled::saturating_from_si(15.0));
            requested.speed_type = Some(SpeedType::Unknown(9));
            assert!(made(&requested, None, hovers).is_err(), "{hovers}");
        }
        let mut requested = circle();
        requested.loiter_direction = Some(LoiterDirection::CounterClockwise);
        requested.loiter_speed = Some(Scaled::saturating_from_si(15.0));
        let item = made(&requested, None, true).unwrap();
        assert_eq!((item.params[2], item.speed_m_s), (60.0, None));
    }

    #[test]
    fn turns_are_flown_as_time_where_radius_and_speed_are_known() {
        let mut requested = circle();
        requested.loiter_duration = Some(3);
        requested.loiter_duration_units = Some(LoiterDurationUnits::Turns);
        assert_eq!(made(&requested, None, false), Err(Reason::LoiterTurns));
        assert_eq!(made(&requested, Some(15.0), true), Err(Reason::LoiterTurns));
        let item = made(&requested, Some(15.0), false).unwrap();
        assert_eq!(item.command, NAV_LOITER_TIME);
        assert!((item.params[0] - 75.4).abs() < 0.01, "{:?}", item.params);
        requested.loiter_speed = Some(Scaled::saturating_from_si(30.0));
        let item = made(&requested, Some(15.0), false).unwrap();
        assert!((item.params[0] - 37.7).abs() < 0.01, "{:?}", item.params);
        assert_eq!(item.speed_m_s, Some(30.0));
        // A full presence vector carries 0 for no speed.
        requested.loiter_speed = Some(Scaled::saturating_from_si(0.0));
        let item = made(&requested, Some(15.0), false).unwrap();
        assert!((item.params[0] - 75.4).abs() < 0.01, "{:?}", item.params);
        assert_eq!(item.speed_m_s, None);
    }

    #[test]
    fn a_fixed_wing_does_not_hover_and_nobody_flies_a_racetrack() {
        let mut requested = circle();
        requested.waypoint_loiter_type = Some(LoiterType::Hover);
        assert!(made(&requested, None, true).is_ok());
        assert!(matches!(
            made(&requested, None, false),
            Err(Reason::LoiterType(_))
        ));
        requested.waypoint_loiter_type = Some(LoiterType::Racetrack);
        assert!(matches!(
            made(&requested, None, true),
            Err(Reason::LoiterType(_))
        ));
    }
}
