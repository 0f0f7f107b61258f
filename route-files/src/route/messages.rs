//! A route into 13001, 13002, 13003, 50001 and 50002, and back. Time stamps are set when the messages are sent.

use std::collections::{BTreeMap, BTreeSet};

use stanag_msgs::enums::{
    LimitType, LoiterDurationUnits, MissionPlanMode, RouteType, WaypointType,
};
use stanag_msgs::messages::{
    CurveSegment, CurveSegmentPaper, MissionTransferCommand, UaLoiterWaypoint, UaPositionWaypoint,
    UaRoute,
};
use stanag_msgs::scalar::{Altitude, Integer, Scale};
use stanag_msgs::{Bam16, Bam32, Envelope, Id, MAX_DATAGRAM, Message, Scaled, Text, TimeStamp};

use super::model::{
    Curve, CurveForm, FurtherRoute, Loiter, LoiterSpan, Loop, Place, Route, RouteError, Waypoint,
};
use crate::download::Download;

impl Route {
    /// The messages, in the order: further routes, route, each waypoint with its loiter, curves. 50001 names vehicle and
    /// CUCS too.
    ///
    /// # Errors
    /// A value that its field cannot carry.
    pub fn messages(&self, vehicle: Id, cucs: Id) -> Result<Vec<Message>, RouteError> {
        let first = self.waypoints.first().ok_or(RouteError::Empty)?;
        let mut messages = Vec::new();
        // Before the one that is loaded: a 13000 without a Route ID loads the latest.
        for further in &self.further {
            messages.push(Message::UaRoute(UaRoute {
                initial_waypoint_number: Some(further.initial),
                route_id: text("Route ID", further.id.as_deref())?,
                route_type: further.route_type,
                ..UaRoute::default()
            }));
        }
        messages.push(Message::UaRoute(UaRoute {
            initial_waypoint_number: Some(self.initial.unwrap_or(first.number)),
            route_id: self.route_id()?,
            route_type: self.route_type,
            ..UaRoute::default()
        }));
        for waypoint in &self.waypoints {
            messages.push(position(waypoint)?.into());
            if let Some(loiter) = &waypoint.loiter {
                messages.push(loiter_waypoint(waypoint.number, loiter)?.into());
            }
        }
        for curve in &self.curves {
            messages.push(segment(curve, vehicle, cucs)?);
        }
        Ok(messages)
    }

    /// What a station at `cucs` sends to load it, a message a datagram: [`Route::messages`] and the 13000, each stamped
    /// a millisecond after the one before, the first at `unix_ms`, and each requesting an acknowledgement.
    ///
    /// # Errors
    /// A value that its field cannot carry, or a message longer than a datagram.
    pub fn datagrams(
        &self,
        vehicle: Id,
        cucs: Id,
        unix_ms: u64,
    ) -> Result<Vec<Vec<u8>>, RouteError> {
        let mut messages = self.messages(vehicle, cucs)?;
        messages.push(self.load_command()?.into());
        let envelope = Envelope::new(cucs, vehicle).requesting_ack();
        let mut bytes = [0; MAX_DATAGRAM];
        let mut out = Vec::with_capacity(messages.len());
        let stamps = TimeStamp::from_unix_ms(unix_ms).0..;
        for (stamp, message) in stamps.zip(messages) {
            let length = message
                .stamped(TimeStamp(stamp))
                .encode(&envelope, &mut bytes)?;
            out.extend(bytes.get(..length).map(<[u8]>::to_vec));
        }
        Ok(out)
    }

    /// The 13000 that loads it.
    ///
    /// # Errors
    /// A value that its field cannot carry.
    pub fn load_command(&self) -> Result<MissionTransferCommand, RouteError> {
        Ok(MissionTransferCommand {
            mission_id: self.mission_id()?,
            mission_plan_mode: Some(MissionPlanMode::Load),
            route_id: self.route_id()?,
            ..MissionTransferCommand::default()
        })
    }

    /// The Mission ID for the 13000 that loads it.
    ///
    /// # Errors
    /// It is longer than its field.
    pub fn mission_id(&self) -> Result<Option<Text<20>>, RouteError> {
        text("Mission ID", self.mission_id.as_deref())
    }

    /// The Route ID.
    ///
    /// # Errors
    /// It is longer than its field.
    pub fn route_id(&self) -> Result<Option<Text<33>>, RouteError> {
        text("Route ID", self.id.as_deref())
    }

    /// The routes of a download, each with the waypoints that it reaches, in flying order.
    ///
    /// # Errors
    /// A waypoint or a curve lacks a position or an altitude, which a route file cannot leave out: a number in its place
    /// would be flown once the file is sent.
    pub fn from_download(download: &Download) -> Result<Vec<Route>, RouteError> {
        let mut curves = BTreeMap::<u16, Vec<Curve>>::new();
        for message in download.messages() {
            if let Some(curve) = curve(&message)? {
                curves.entry(curve.from).or_default().push(curve);
            }
        }
        let routes = download.routes().iter();
        routes.map(|route| from(route, download, &curves)).collect()
    }

    /// Routes of one plan, in the order of a download, as one: the latest flight route, otherwise the latest of all, is the
    /// one that a 13000 without a Route ID loads, so that the file loads it too. The others are further ones. `None` where
    /// there are none.
    #[must_use]
    pub fn joined(mut routes: Vec<Route>) -> Option<Route> {
        let flies = |route: &Route| matches!(route.route_type, None | Some(RouteType::Flight));
        let latest = routes.iter().rposition(flies);
        let main = latest.or(routes.len().checked_sub(1))?;
        let mut whole = routes.remove(main);
        // They are of one plan: a waypoint or a curve of both is the same.
        let name = |curve: &Curve| (curve.from, curve.to, curve.form == CurveForm::Paper);
        let mut known: BTreeSet<u16> = whole.waypoints.iter().map(|point| point.number).collect();
        let mut drawn: BTreeSet<_> = whole.curves.iter().map(name).collect();
        for route in routes {
            let Route {
                id,
                route_type,
                initial,
                waypoints,
                curves,
                ..
            } = route;
            let first = waypoints.first().map_or(0, |point| point.number);
            whole.further.push(FurtherRoute {
                id,
                route_type,
                initial: initial.unwrap_or(first),
            });
            let others = waypoints.into_iter();
            (whole.waypoints).extend(others.filter(|point| known.insert(point.number)));
            let others = curves.into_iter();
            (whole.curves).extend(others.filter(|curve| drawn.insert(name(curve))));
        }
        Some(whole)
    }
}

/// A text for a field of `N` bytes, refused rather than cut: a cut Route ID would name another route.
fn text<const N: usize>(
    what: &'static str,
    value: Option<&str>,
) -> Result<Option<Text<N>>, RouteError> {
    let Some(value) = value else { return Ok(None) };
    let printable = value
        .bytes()
        .all(|byte| byte == b' ' || byte.is_ascii_graphic());
    if value.len() < N && printable {
        Ok(Some(Text::new(value)))
    } else {
        let value = value.to_owned();
        Err(RouteError::Text {
            what,
            value,
            most: N - 1,
        })
    }
}

fn position(waypoint: &Waypoint) -> Result<UaPositionWaypoint, RouteError> {
    let what = |field: &str| format!("waypoint {}: {field}", waypoint.number);
    Ok(UaPositionWaypoint {
        waypoint_number: Some(waypoint.number),
        waypoint_to_latitude_or_relative_y: Some(angle(what("latitude"), waypoint.latitude_deg)?),
        waypoint_to_longitude_or_relative_x: Some(angle(
            what("longitude"),
            waypoint.longitude_deg,
        )?),
        waypoint_to_altitude: Some(scaled(what("altitude"), waypoint.altitude_m)?),
        waypoint_altitude_type: waypoint.altitude_type,
        waypoint_to_speed: maybe(what("speed"), waypoint.speed_m_s)?,
        waypoint_speed_type: waypoint.speed_type,
        next_waypoint: Some(waypoint.next),
        turn_type: waypoint.turn,
        waypoint_type: waypoint.repeat.map(|_| WaypointType::EndOfLoop),
        limit_type: waypoint.repeat.map(|repeat| repeat.limit_type),
        loop_limit: waypoint.repeat.map(|repeat| repeat.limit),
        ..UaPositionWaypoint::default()
    })
}

fn loiter_waypoint(number: u16, loiter: &Loiter) -> Result<UaLoiterWaypoint, RouteError> {
    let what = |field: &str| format!("waypoint {number}: loiter.{field}");
    let bearing = match loiter.bearing_deg {
        None => None,
        Some(value) if value.is_finite() => Some(Bam16::from_degrees(value)),
        Some(value) => {
            return Err(RouteError::Angle {
                what: what("bearing"),
                value,
            });
        }
    };
    let (duration, units) = match loiter.span {
        None => (None, None),
        Some(LoiterSpan::Seconds(s)) => (Some(s), Some(LoiterDurationUnits::Seconds)),
        Some(LoiterSpan::Turns(turns)) => (Some(turns), Some(LoiterDurationUnits::Turns)),
    };
    Ok(UaLoiterWaypoint {
        waypoint_number: Some(number),
        waypoint_loiter_type: loiter.pattern,
        loiter_radius: maybe(what("radius"), loiter.radius_m)?,
        loiter_length: maybe(what("length"), loiter.length_m)?,
        loiter_bearing: bearing,
        loiter_direction: loiter.direction,
        loiter_speed: maybe(what("speed"), loiter.speed_m_s)?,
        loiter_duration: duration,
        loiter_duration_units: units,
        ..UaLoiterWaypoint::default()
    })
}

fn segment(curve: &Curve, vehicle: Id, cucs: Id) -> Result<Message, RouteError> {
    let what = |field: &str| format!("curve from waypoint {}: {field}", curve.from);
    let (p2, p3) = (curve.p2, curve.p3);
    match curve.form {
        CurveForm::Native => Ok(Message::CurveSegment(CurveSegment {
            p1_waypoint_no: Some(curve.from),
            p4_waypoint_no: Some(curve.to),
            p2_latitude: Some(angle(what("p2 latitude"), p2.latitude_deg)?),
            p2_longitude: Some(angle(what("p2 longitude"), p2.longitude_deg)?),
            p2_altitude: maybe(what("p2 altitude"), p2.altitude_m)?,
            p3_latitude: Some(angle(what("p3 latitude"), p3.latitude_deg)?),
            p3_longitude: Some(angle(what("p3 longitude"), p3.longitude_deg)?),
            p3_altitude: maybe(what("p3 altitude"), p3.altitude_m)?,
            altitude_type: curve.altitude_type,
            ..CurveSegment::default()
        })),
        CurveForm::Paper if p2.altitude_m.is_some() || p3.altitude_m.is_some() => {
            Err(RouteError::CurveAltitude { from: curve.from })
        }
        CurveForm::Paper => Ok(Message::CurveSegmentPaper(CurveSegmentPaper {
            vehicle_id: Some(vehicle),
            cucs_id: Some(cucs),
            p1_waypoint_no: Some(curve.from),
            p4_waypoint_no: Some(curve.to),
            p2_latitude: Some(p2.latitude_deg.to_radians()),
            p2_longitude: Some(p2.longitude_deg.to_radians()),
            p3_latitude: Some(p3.latitude_deg.to_radians()),
            p3_longitude: Some(p3.longitude_deg.to_radians()),
            ..CurveSegmentPaper::default()
        })),
    }
}

fn angle(what: String, degrees: f64) -> Result<Bam32, RouteError> {
    if degrees.is_finite() {
        Ok(Bam32::from_degrees(degrees))
    } else {
        Err(RouteError::Angle {
            what,
            value: degrees,
        })
    }
}

fn scaled<R: Integer, S: Scale>(what: String, value: f64) -> Result<Scaled<R, S>, RouteError> {
    Scaled::from_si(value).map_err(|fault| RouteError::Value { what, fault })
}

fn maybe<R: Integer, S: Scale>(
    what: String,
    value: Option<f64>,
) -> Result<Option<Scaled<R, S>>, RouteError> {
    value.map(|value| scaled(what, value)).transpose()
}

/// `curves`: those of the plan, by the waypoint where each begins.
fn from(
    route: &UaRoute,
    download: &Download,
    curves: &BTreeMap<u16, Vec<Curve>>,
) -> Result<Route, RouteError> {
    let mut waypoints: Vec<Waypoint> = Vec::new();
    let mut reached = BTreeSet::new();
    let mut number = route.initial_waypoint_number.unwrap_or(0);
    // A loop leads back to a waypoint that was reached before.
    while number != 0
        && reached.insert(number)
        && let Some((point, loiter)) = download.waypoint(number)
    {
        waypoints.push(waypoint(number, point, loiter)?);
        number = point.next_waypoint.unwrap_or(0);
    }
    let each = waypoints.iter();
    let curves = each.filter_map(|point| curves.get(&point.number)).flatten();
    let curves = curves.copied().collect();
    Ok(Route {
        mission_id: None,
        id: route.route_id.map(|id| id.as_str().to_owned()),
        route_type: route.route_type,
        initial: route.initial_waypoint_number,
        waypoints,
        curves,
        further: Vec::new(),
    })
}

fn waypoint(
    number: u16,
    point: &UaPositionWaypoint,
    loiter_there: Option<&UaLoiterWaypoint>,
) -> Result<Waypoint, RouteError> {
    let of = format!("waypoint {number}");
    let altitude = point.waypoint_to_altitude.map(|m| m.si());
    Ok(Waypoint {
        number,
        latitude_deg: degrees(&of, "latitude", point.waypoint_to_latitude_or_relative_y)?,
        longitude_deg: degrees(&of, "longitude", point.waypoint_to_longitude_or_relative_x)?,
        altitude_m: there(&of, "altitude", altitude)?,
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
    })
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

/// The curve that a message gives; `None` where it gives none.
fn curve(message: &Message) -> Result<Option<Curve>, RouteError> {
    Ok(match message {
        Message::CurveSegment(curve) => {
            let (Some(from), Some(to)) = (curve.p1_waypoint_no, curve.p4_waypoint_no) else {
                return Ok(None);
            };
            let of = format!("curve from waypoint {from}");
            let place =
                |latitude, longitude, altitude: Option<Altitude>| -> Result<_, RouteError> {
                    Ok(Place {
                        latitude_deg: degrees(&of, "latitude", latitude)?,
                        longitude_deg: degrees(&of, "longitude", longitude)?,
                        altitude_m: altitude.map(|altitude| altitude.si()),
                    })
                };
            Some(Curve {
                from,
                to,
                p2: place(curve.p2_latitude, curve.p2_longitude, curve.p2_altitude)?,
                p3: place(curve.p3_latitude, curve.p3_longitude, curve.p3_altitude)?,
                altitude_type: curve.altitude_type,
                form: CurveForm::Native,
            })
        }
        Message::CurveSegmentPaper(curve) => {
            let (Some(from), Some(to)) = (curve.p1_waypoint_no, curve.p4_waypoint_no) else {
                return Ok(None);
            };
            let of = format!("curve from waypoint {from}");
            let place = |latitude: Option<f64>, longitude: Option<f64>| -> Result<_, RouteError> {
                Ok(Place {
                    latitude_deg: there(&of, "latitude", latitude)?.to_degrees(),
                    longitude_deg: there(&of, "longitude", longitude)?.to_degrees(),
                    altitude_m: None,
                })
            };
            Some(Curve {
                from,
                to,
                p2: place(curve.p2_latitude, curve.p2_longitude)?,
                p3: place(curve.p3_latitude, curve.p3_longitude)?,
                altitude_type: None,
                form: CurveForm::Paper,
            })
        }
        _ => None,
    })
}

fn degrees(of: &str, field: &'static str, angle: Option<Bam32>) -> Result<f64, RouteError> {
    there(of, field, angle.map(Bam32::degrees))
}

fn there(of: &str, field: &'static str, value: Option<f64>) -> Result<f64, RouteError> {
    value.ok_or_else(|| RouteError::Absent {
        of: of.to_owned(),
        field,
    })
}

#[cfg(test)]
mod tests {
    use std::time::{Duration, Instant};

    use super::*;

    /// Two routes that share all their waypoints, each leg curved.
    #[test]
    fn ten_thousand_waypoints_with_as_many_curves_are_a_matter_of_milliseconds() {
        const COUNT: u16 = 10_000;
        let mut download = Download::default();
        for (id, first) in [("one", 1), ("two", 2)] {
            let route = UaRoute {
                route_id: Some(Text::new(id)),
                initial_waypoint_number: Some(first),
                ..UaRoute::default()
            };
            assert!(download.take(&route.into()));
        }
        let place = |number: u16| Some(Bam32::from_degrees(f64::from(number) * 1e-3));
        for number in 1..=COUNT {
            let next = if number == COUNT { 0 } else { number + 1 };
            let point = UaPositionWaypoint {
                waypoint_number: Some(number),
                waypoint_to_latitude_or_relative_y: place(number),
                waypoint_to_longitude_or_relative_x: place(number),
                waypoint_to_altitude: Scaled::from_si(30.0).ok(),
                next_waypoint: Some(next),
                ..UaPositionWaypoint::default()
            };
            assert!(download.take(&point.into()));
            let leg = CurveSegment {
                p1_waypoint_no: Some(number),
                p4_waypoint_no: Some(next),
                p2_latitude: place(number),
                p2_longitude: place(number),
                p3_latitude: place(number),
                p3_longitude: place(number),
                ..CurveSegment::default()
            };
            assert!(next == 0 || download.take(&leg.into()));
        }
        let begun = Instant::now();
        let routes = Route::from_download(&download).expect("whole");
        let counts = |route: &Route| (route.waypoints.len(), route.curves.len());
        let counted: Vec<_> = routes.iter().map(counts).collect();
        assert_eq!(counted, [(10_000, 9_999), (9_999, 9_998)]);
        let whole = Route::joined(routes).expect("a route");
        let took = begun.elapsed();
        assert_eq!(counts(&whole), (10_000, 9_999));
        // In order, and that which the second route lacks behind them.
        let numbers = whole.waypoints.iter().map(|point| point.number);
        assert!(numbers.eq((2..=COUNT).chain([1])));
        assert!(
            whole
                .curves
                .iter()
                .map(|curve| curve.from)
                .eq((2..COUNT).chain([1]))
        );
        // A search of all waypoints for each curve, or waypoint, takes many seconds in a build for tests.
        assert!(took < Duration::from_secs(2), "{took:?}");
    }

    #[test]
    fn a_joined_plan_loads_the_route_that_a_load_without_a_name_loads() {
        let route = |id: &str, route_type| Route {
            id: Some(id.to_owned()),
            route_type,
            ..Route::default()
        };
        let older = || route("older", None);
        let newer = || route("newer", Some(RouteType::Flight));
        let home = || route("home", Some(RouteType::ContingencyA));
        let joined = |routes| {
            let whole = Route::joined(routes)?;
            let further = whole.further.into_iter().map(|one| one.id.unwrap());
            Some((whole.id.unwrap(), further.collect::<Vec<_>>()))
        };
        // In the order in which a vehicle sends them: the latest stands last.
        assert_eq!(
            joined(vec![older(), newer(), home()]),
            Some(("newer".into(), vec!["older".into(), "home".into()]))
        );
        let away = route("away", Some(RouteType::ContingencyB));
        assert_eq!(
            joined(vec![home(), away]),
            Some(("away".into(), vec!["home".into()]))
        );
        assert_eq!(joined(Vec::new()), None);
    }
}
