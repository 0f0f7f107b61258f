//! One waypoint (13002) of a route with its loiter (13003): its checked fields, and the items that fly it.

use mavlink_link::service::mission::{FRAME_MISSION, Item};
use stanag_msgs::enums::{LimitType, LocationType, TurnType, WaypointSpeedType, WaypointType};
use stanag_msgs::messages::{UaLoiterWaypoint, UaPositionWaypoint};

use super::error::Reason;
use super::item::{DO_JUMP, NAV_WAYPOINT, change_speed, placed};
use super::loiter;
use super::mission::{CompiledMission, Leg};
use super::site::Site;
use crate::limits::Performance;

/// The leg to it: position, altitude, speed.
///
/// # Errors
/// The first field that is missing, or that PX4 cannot fly, or that is out of the limits.
pub(super) fn leg(
    number: u16,
    waypoint: &UaPositionWaypoint,
    requested: Option<&UaLoiterWaypoint>,
    site: &Site,
) -> Result<Leg, Reason> {
    match waypoint.location_type {
        None | Some(LocationType::Absolute) => {}
        Some(other) => return Err(Reason::Relative(other.raw())),
    }
    let latitude = waypoint
        .waypoint_to_latitude_or_relative_y
        .ok_or(Reason::Missing("Waypoint to Latitude"))?
        .degrees();
    let longitude = waypoint
        .waypoint_to_longitude_or_relative_x
        .ok_or(Reason::Missing("Waypoint to Longitude"))?
        .degrees();
    if !(-90.0..=90.0).contains(&latitude) {
        return Err(Reason::Latitude(latitude));
    }
    let altitude_m = waypoint
        .waypoint_to_altitude
        .ok_or(Reason::Missing("Waypoint to Altitude"))?
        .si();
    let over = loiter::flown_over((latitude, longitude), requested, site);
    let altitude_type = waypoint.waypoint_altitude_type;
    let level = site.datum().level(altitude_m, altitude_type, over)?;
    site.limits.check_height(level, site.home.amsl_m)?;
    Ok(Leg {
        number,
        latitude,
        longitude,
        level,
        speed_m_s: speed(waypoint, &site.performance)?,
    })
}

/// Its commanded height above the ground of elevation files, m; `None` for another kind of altitude.
pub(super) fn above_ground(waypoint: &UaPositionWaypoint, site: &Site) -> Option<f64> {
    let altitude_m = waypoint.waypoint_to_altitude?.si();
    let is_above = site
        .datum()
        .is_above_ground(waypoint.waypoint_altitude_type);
    is_above.then_some(altitude_m)
}

fn speed(waypoint: &UaPositionWaypoint, performance: &Performance) -> Result<Option<f64>, Reason> {
    // A full presence vector carries 0 for no speed.
    let commanded = waypoint.waypoint_to_speed.map(|speed| speed.si());
    let commanded = commanded.filter(|speed_m_s| *speed_m_s != 0.0);
    match waypoint.waypoint_speed_type {
        Some(WaypointSpeedType::ArrivalTime) => return Err(Reason::ArrivalTime),
        Some(WaypointSpeedType::Unknown(value)) if commanded.is_some() => {
            return Err(Reason::unknown("Waypoint Speed Type", value));
        }
        _ => {}
    }
    let Some(speed_m_s) = commanded else {
        return Ok(None);
    };
    Ok(Some(performance.check(speed_m_s)?))
}

/// The items at its position: fly there, or stay as its loiter requests.
///
/// # Errors
/// A turn or a loiter that PX4 cannot fly.
pub(super) fn items(
    leg: &Leg,
    waypoint: &UaPositionWaypoint,
    requested: Option<&UaLoiterWaypoint>,
    site: &Site,
) -> Result<Vec<Item>, Reason> {
    let there = |command, params| placed(leg.place(), leg.level, command, params);
    let fly_to = there(NAV_WAYPOINT, [0.0, acceptance(waypoint)?, 0.0, f32::NAN]);
    let Some(requested) = requested else {
        return Ok(vec![fly_to]);
    };
    let loiter = loiter::loiter(requested, leg.speed_m_s, site.hovers(), &site.performance)?;
    if let Some(wings) = &site.wings {
        let speed_m_s = loiter.speed_m_s.or(leg.speed_m_s);
        let speed_m_s = speed_m_s.unwrap_or(site.performance.cruise_m_s);
        // Radius 0 is the vehicle's own.
        if loiter.params[2] != 0.0 {
            wings.check_circle(loiter.params[2].into(), speed_m_s)?;
        }
    }
    let stay = there(loiter.command, loiter.params);
    match loiter
        .speed_m_s
        .filter(|speed| Some(*speed) != leg.speed_m_s)
    {
        None => Ok(vec![stay]),
        // The loiter's speed is neither that of the leg to it nor that of the next one.
        Some(speed_m_s) => {
            let back = leg
                .speed_m_s
                .map(|speed_m_s| change_speed(speed_m_s, site.hovers()));
            Ok([fly_to, change_speed(speed_m_s, site.hovers()), stay]
                .into_iter()
                .chain(back)
                .collect())
        }
    }
}

fn acceptance(waypoint: &UaPositionWaypoint) -> Result<f32, Reason> {
    match waypoint.turn_type {
        None | Some(TurnType::ShortTurn) => Ok(0.0),
        Some(TurnType::FlyOver) => Ok(FLY_OVER_M),
        Some(TurnType::Unknown(value)) => Err(Reason::unknown("Turn Type", value)),
    }
}

/// Whether a waypoint ends a loop.
pub(super) fn ends_loop(waypoint: &UaPositionWaypoint) -> Result<bool, Reason> {
    match waypoint.waypoint_type {
        None | Some(WaypointType::Normal) => Ok(false),
        Some(WaypointType::EndOfLoop) => Ok(true),
        Some(WaypointType::Unknown(value)) => Err(Reason::unknown("Waypoint Type", value)),
    }
}

/// The jump back from the end of a loop, `number`, whose own items are in `compiled` already; `None` for a loop that is
/// flown once.
pub(super) fn jump(
    number: u16,
    waypoint: &UaPositionWaypoint,
    compiled: &CompiledMission,
) -> Result<Option<Item>, Reason> {
    let start = crate::plan::next(waypoint);
    let seq = compiled
        .first_item_of(start)
        .filter(|_| start != number)
        .ok_or(Reason::LoopStart(start))?;
    let jumps = match waypoint.limit_type {
        // PX4 has no jump without end: 65,535 is the most that it counts.
        None | Some(LimitType::None) => MAX_JUMPS,
        Some(LimitType::Count) => match waypoint.loop_limit {
            None => return Err(Reason::Missing("Loop Limit")),
            Some(0) => return Err(Reason::LoopLimit),
            // The first lap needs no jump.
            Some(times) => times - 1,
        },
        Some(LimitType::Time) => return Err(Reason::LoopTime),
        Some(LimitType::Unknown(value)) => return Err(Reason::unknown("Limit Type", value)),
    };
    Ok((jumps > 0).then(|| Item {
        frame: FRAME_MISSION,
        command: DO_JUMP,
        autocontinue: true,
        params: [f32::from(seq), f32::from(jumps), 0.0, 0.0],
        ..Item::default()
    }))
}

/// Acceptance radius of a fly-over, m: under 2 m a multicopter at 5 m/s can miss the waypoint and fly on for good.
const FLY_OVER_M: f32 = 3.0;
const MAX_JUMPS: u16 = u16::MAX;
