//! A route of straight legs: as the CUCS sends it, and as the picture shows it.

use cucs::{Route, Waypoint};
use stanag_msgs::enums::{AltitudeType, WaypointSpeedType};

use super::picture::Planned;
use super::track::Point;
use super::world::north_east_deg;

/// A waypoint: number, m north and east of home, m above home, m/s, next.
pub(super) type Row = (u16, f64, f64, f64, f64, u16);

pub(super) fn route(rows: &[Row]) -> Route {
    let waypoints = rows
        .iter()
        .map(|(number, north_m, east_m, up_m, speed_m_s, next)| {
            let (latitude_deg, longitude_deg) = north_east_deg(*north_m, *east_m);
            Waypoint {
                number: *number,
                latitude_deg,
                longitude_deg,
                altitude_m: *up_m,
                altitude_type: Some(AltitudeType::Agl),
                speed_m_s: Some(*speed_m_s),
                speed_type: Some(WaypointSpeedType::Ground),
                next: *next,
                ..Waypoint::default()
            }
        });
    Route {
        mission_id: Some("DEMO".to_owned()),
        id: Some("DEMO ROUTE".to_owned()),
        waypoints: waypoints.collect(),
        ..Route::default()
    }
}

pub(super) fn planned(rows: &[Row]) -> Planned {
    let point = |north_m, east_m, up_m| Point {
        north_m,
        east_m,
        up_m,
        ..Point::HOME
    };
    let waypoints: Vec<(u16, Point)> = rows
        .iter()
        .map(|(number, north_m, east_m, up_m, ..)| (*number, point(*north_m, *east_m, *up_m)))
        .collect();
    let legs = waypoints.iter().map(|(_, point)| *point);
    Planned {
        line: std::iter::once(Point::HOME).chain(legs).collect(),
        waypoints,
        ..Planned::default()
    }
}
