//! Routes out of what a vehicle sent of its plan.

use std::collections::BTreeSet;

use stanag_msgs::Message;
use stanag_msgs::enums::{LimitType, LoiterDurationUnits, WaypointType};
use stanag_msgs::messages::{UaLoiterWaypoint, UaPositionWaypoint, UaRoute};

use super::super::download::Download;
use super::{Curve, CurveForm, Loiter, LoiterSpan, Loop, Place, Route, Waypoint};

impl Route {
    /// The routes of a download, each with the waypoints that it reaches, in flying order.
    #[must_use]
    pub fn from_download(download: &Download) -> Vec<Route> {
        let all: Vec<Message> = download.messages().collect();
        download
            .routes()
            .iter()
            .map(|route| from(route, &all))
            .collect()
    }
}

fn from(route: &UaRoute, all: &[Message]) -> Route {
    let mut waypoints: Vec<Waypoint> = Vec::new();
    let mut reached = BTreeSet::new();
    let mut number = route.initial_waypoint_number.unwrap_or(0);
    while number != 0 && reached.insert(number) {
        let found = all.iter().find_map(|message| match message {
            Message::UaPositionWaypoint(point) if point.waypoint_number == Some(number) => {
                Some(point)
            }
            _ => None,
        });
        let Some(point) = found else { break };
        let loiter = all.iter().find_map(|message| match message {
            Message::UaLoiterWaypoint(loiter) if loiter.waypoint_number == Some(number) => {
                Some(loiter)
            }
            _ => None,
        });
        waypoints.push(waypoint(number, point, loiter));
        number = point.next_waypoint.unwrap_or(0);
    }
    let place = |curve: &Curve| {
        waypoints
            .iter()
            .position(|point| point.number == curve.from)
    };
    let mut curves: Vec<Curve> = all.iter().filter_map(curve).collect();
    curves.retain(|curve| place(curve).is_some());
    curves.sort_by_key(place);
    Route {
        mission_id: None,
        id: route.route_id.map(|id| id.as_str().to_owned()),
        route_type: route.route_type,
        initial: route.initial_waypoint_number,
        waypoints,
        curves,
    }
}

fn waypoint(
    number: u16,
    point: &UaPositionWaypoint,
    loiter_there: Option<&UaLoiterWaypoint>,
) -> Waypoint {
    Waypoint {
        number,
        latitude_deg: degrees(point.waypoint_to_latitude_or_relative_y),
        longitude_deg: degrees(point.waypoint_to_longitude_or_relative_x),
        altitude_m: point.waypoint_to_altitude.map_or(0.0, |m| m.si()),
        altitude_type: point.waypoint_altitude_type,
        speed_m_s: point.waypoint_to_speed.map(|speed| speed.si()),
        speed_type: point.waypoint_speed_type,
        next: point.next_waypoint.unwrap_or(0),
        turn: point.turn_type,
        loiter: loiter_there.map(loiter),
        repeat: (point.waypoint_type == Some(WaypointType::EndOfLoop)).then(|| Loop {
            limit_type: point.limit_type.unwrap_or(LimitType::None),
            limit: point.loop_limit.unwrap_or(0),
        }),
    }
}

fn loiter(loiter: &UaLoiterWaypoint) -> Loiter {
    Loiter {
        pattern: loiter.waypoint_loiter_type,
        radius_m: loiter.loiter_radius.map(|radius| radius.si()),
        length_m: loiter.loiter_length.map(|length| length.si()),
        bearing_deg: loiter.loiter_bearing.map(|bearing| bearing.degrees()),
        direction: loiter.loiter_direction,
        speed_m_s: loiter.loiter_speed.map(|speed| speed.si()),
        span: loiter.loiter_duration.map(|duration| {
            if loiter.loiter_duration_units == Some(LoiterDurationUnits::Turns) {
                LoiterSpan::Turns(duration)
            } else {
                LoiterSpan::Seconds(duration)
            }
        }),
    }
}

fn curve(message: &Message) -> Option<Curve> {
    match message {
        Message::CurveSegment(curve) => Some(Curve {
            from: curve.p1_waypoint_no?,
            to: curve.p4_waypoint_no?,
            p2: Place {
                latitude_deg: degrees(curve.p2_latitude),
                longitude_deg: degrees(curve.p2_longitude),
                altitude_m: curve.p2_altitude.map(|altitude| altitude.si()),
            },
            p3: Place {
                latitude_deg: degrees(curve.p3_latitude),
                longitude_deg: degrees(curve.p3_longitude),
                altitude_m: curve.p3_altitude.map(|altitude| altitude.si()),
            },
            altitude_type: curve.altitude_type,
            form: CurveForm::Native,
        }),
        Message::CurveSegmentPaper(curve) => Some(Curve {
            from: curve.p1_waypoint_no?,
            to: curve.p4_waypoint_no?,
            p2: Place {
                latitude_deg: curve.p2_latitude?.to_degrees(),
                longitude_deg: curve.p2_longitude?.to_degrees(),
                altitude_m: None,
            },
            p3: Place {
                latitude_deg: curve.p3_latitude?.to_degrees(),
                longitude_deg: curve.p3_longitude?.to_degrees(),
                altitude_m: None,
            },
            altitude_type: None,
            form: CurveForm::Paper,
        }),
        _ => None,
    }
}

fn degrees(angle: Option<stanag_msgs::Bam32>) -> f64 {
    angle.map_or(0.0, |angle| angle.degrees())
}
