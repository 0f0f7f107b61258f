//! The ground station's route file (TOML): waypoints with numbers, and curves between them. What `cucs send` sends.
//!
//! ```toml
//! id = "bend"
//!
//! [defaults]
//! altitude = 30.0
//! altitude_type = "agl"                       # or amsl, wgs84
//!
//! [[waypoint]]
//! number = 10
//! latitude = 47.4
//! longitude = 8.5
//!
//! [[waypoint]]
//! number = 20
//! latitude = 47.4
//! longitude = 8.502
//!
//! [[curve]]
//! from = 10
//! to = 20
//! p2 = [47.4002, 8.5005]                      # and an altitude in both, or in neither
//! p3 = [47.4004, 8.5010]
//! ```

use std::collections::{HashMap, HashSet};
use std::path::Path;

use curve_paths::{Control, Position};
use serde::Deserialize;
use toml::Spanned;

use super::draft::{Conduct, Datum, Draft, Point, Repeat};
use super::fault::FormatError;
use super::items::LOITER_EXIT;
use super::losses::Losses;
use super::lost;
use crate::fence::{self, Area, FenceFileError};
use crate::route::model::{Curve, CurveForm, Loop, Place, Route, Waypoint};
use crate::route::read::Lines;

/// Where in the text the waypoints and curves stand.
#[derive(Deserialize)]
struct Places {
    waypoint: Vec<WaypointPlace>,
    #[serde(default)]
    curve: Vec<CurvePlace>,
}

#[derive(Deserialize)]
struct WaypointPlace {
    number: Spanned<u16>,
}

#[derive(Deserialize)]
struct CurvePlace {
    from: Spanned<u16>,
}

/// Reads a route: the path from its initial waypoint along Next Waypoint; the end of a loop leads back once.
pub(super) fn read(file: &Path, text: &str) -> Result<Draft, FormatError> {
    let plan = Route::parse(file, text)?;
    let places: Places =
        toml::from_str(text).map_err(|e| FormatError::at(file, None, "", e.message()))?;
    let lines = Lines::of(text);
    let line = |offset: usize| Some(lines.at(offset) as u64);
    // Looked up by number, since a route may have 65,534 waypoints.
    let numbers = places.waypoint.iter().map(|w| &w.number);
    let starts: HashMap<u16, usize> = numbers.map(|n| (*n.get_ref(), n.span().start)).collect();
    let line_of = |number: u16| starts.get(&number).and_then(|start| line(*start));
    let (order, back) = order(&plan, file, &line_of)?;
    let datum = datum(&plan, file, &line_of)?;
    let mut curves: HashMap<(u16, u16), &Curve> = HashMap::new();
    for curve in &plan.curves {
        // The first of two between the same waypoints.
        curves.entry((curve.from, curve.to)).or_insert(curve);
    }
    let point = |w: &Waypoint, to: Option<u16>| {
        let curve = to.and_then(|to| curves.get(&(w.number, to)));
        let index = |number| order.iter().position(|w| w.number == number);
        Point {
            curve: curve.map(|c| [control(c.p2), control(c.p3)]),
            item: w.number.into(),
            conduct: Conduct {
                speed_m_s: w.speed_m_s,
                speed_type: w.speed_type,
                turn: w.turn,
                loiter: w.loiter,
                repeat: w.repeat.and_then(|repeat| {
                    Some(Repeat {
                        to: index(w.next)?,
                        limit_type: repeat.limit_type,
                        limit: repeat.limit,
                    })
                }),
                take_off: None,
                exit: None,
            },
            ..Point::straight(
                Position::new(w.latitude_deg, w.longitude_deg, w.altitude_m),
                line_of(w.number),
            )
        }
    };
    let next = |k: usize| order.get(k + 1).map(|w| w.number).or(back);
    let mut points: Vec<Point> = (0..order.len()).map(|k| point(order[k], next(k))).collect();
    // A curve that a further route flies is sent as it is.
    let further = plan.waypoints.iter().filter(|_| !plan.further.is_empty());
    let legs: HashSet<(u16, u16)> = (order.iter().enumerate())
        .filter_map(|(k, w)| Some((w.number, next(k)?)))
        .chain(further.map(|w| (w.number, w.next)))
        .collect();
    for (k, curve) in plan.curves.iter().enumerate() {
        if !legs.contains(&(curve.from, curve.to)) {
            let at = places.curve.get(k).and_then(|c| line(c.from.span().start));
            let problem = format!("no leg leads from {} to {}", curve.from, curve.to);
            return Err(FormatError::at(file, at, "curve", problem));
        }
    }
    let closed = back.is_some() && back == order.first().map(|w| w.number);
    if let (false, Some(back)) = (
        closed,
        back.and_then(|n| order.iter().find(|w| w.number == n)),
    ) {
        points.push(Point {
            curve: None,
            conduct: Conduct::default(),
            ..point(back, None)
        });
    }
    let mut losses = Losses::of("waypoint");
    losses.items = plan.waypoints.len();
    let areas = areas(file, text)?;
    Ok(Draft {
        name: plan
            .id
            .clone()
            .or_else(|| plan.mission_id.clone())
            .unwrap_or_default(),
        closed,
        points,
        datum,
        areas,
        losses,
        plan: Some(plan),
        ..Draft::default()
    })
}

/// The geofence that a route file may hold.
pub(super) fn areas(file: &Path, text: &str) -> Result<Vec<Area>, FormatError> {
    fence::parse(file, text).map_err(|fault| match fault {
        FenceFileError::Form { line, message, .. } => {
            FormatError::at(file, Some(line as u64), "area", message)
        }
        FenceFileError::Shape { area, .. } => {
            let problem = "expected vertices, or centre and radius";
            FormatError::at(file, None, format!("area {area}"), problem)
        }
        FenceFileError::Many { what, count, .. } => FormatError::at(file, None, what, count),
        fault @ FenceFileError::Value { .. } => fault.into(),
    })
}

/// The waypoints in the order that they are flown, and the one that the last leads back to.
fn order<'a>(
    plan: &'a Route,
    file: &Path,
    line_of: &dyn Fn(u16) -> Option<u64>,
) -> Result<(Vec<&'a Waypoint>, Option<u16>), FormatError> {
    let mut order: Vec<&Waypoint> = Vec::new();
    let waypoints: HashMap<u16, &Waypoint> = plan.waypoints.iter().map(|w| (w.number, w)).collect();
    let mut reached = HashSet::new();
    let first = plan.waypoints.first().map_or(0, |w| w.number);
    let mut number = plan.initial.unwrap_or(first);
    while number != 0 {
        if !reached.insert(number) {
            return Ok((order, Some(number)));
        }
        let Some(&found) = waypoints.get(&number) else {
            let from = order.last().map(|w| w.number);
            let field = from.map_or("initial".to_owned(), |n| format!("waypoint {n}: next"));
            let problem = format!("{number}, expected the number of a waypoint, or 0");
            return Err(FormatError::at(
                file,
                from.and_then(line_of),
                field,
                problem,
            ));
        };
        order.push(found);
        number = found.next;
    }
    Ok((order, None))
}

/// What all altitudes are above: a path has one.
fn datum(
    plan: &Route,
    file: &Path,
    line_of: &dyn Fn(u16) -> Option<u64>,
) -> Result<Datum, FormatError> {
    let waypoints = plan
        .waypoints
        .iter()
        .map(|w| (w.number, "waypoint", w.altitude_type));
    let raised = plan
        .curves
        .iter()
        .filter(|c| c.p2.altitude_m.or(c.p3.altitude_m).is_some());
    let curves = raised.map(|c| (c.from, "curve from", c.altitude_type));
    let mut found = None;
    for (number, what, kind) in waypoints.chain(curves) {
        let datum = Datum::of(kind);
        if *found.get_or_insert(datum) != datum {
            let field = format!("{what} {number}: altitude_type");
            let problem = "another than before, expected the same throughout";
            return Err(FormatError::at(file, line_of(number), field, problem));
        }
    }
    Ok(found.unwrap_or_default())
}

fn control(place: Place) -> Control {
    Control {
        lat_deg: place.latitude_deg,
        lon_deg: place.longitude_deg,
        alt_m: place.altitude_m,
    }
}

impl Draft {
    /// The ground station's route: the one that it was read from, or one with waypoints numbered 10, 20 and so on. A
    /// closed one ends where it began, by a waypoint of its own. What it cannot hold goes to `losses`.
    ///
    /// # Errors
    /// More waypoints than there are numbers.
    pub fn to_route(&self, losses: &mut Losses) -> Result<Route, FormatError> {
        if let Some(plan) = &self.plan {
            return Ok(plan.clone());
        }
        lost::extras(self, losses);
        let points = self.written();
        let ends = points.len();
        let step = if ends <= usize::from(MAX_NUMBER / 10) {
            10
        } else {
            1
        };
        let number = |k: usize| {
            let number = u16::try_from((k + 1) * step).ok();
            number.filter(|n| *n <= MAX_NUMBER).ok_or_else(|| {
                FormatError::Answer(format!("{ends} waypoints, expected at most {MAX_NUMBER}"))
            })
        };
        let altitude_type = self.datum.altitude_type();
        let mut route = Route {
            id: Some(printable(&self.name)),
            ..Route::default()
        };
        for (k, point) in points.iter().enumerate() {
            let conduct = &point.conduct;
            if conduct.take_off.is_some() {
                let what = "take-off (flown to as a waypoint: launch first)";
                losses.add(point.item, what);
            }
            if conduct.exit.is_some() {
                losses.add(point.item, LOITER_EXIT);
            }
            let last = k + 1 == ends;
            // A route ends with its loop: what would follow has no way out of it.
            let repeat = conduct.repeat.filter(|_| last);
            if let (None, Some(lost)) = (repeat, conduct.repeat) {
                losses.add(point.item, format!("loop back to point {}", lost.to + 1));
            }
            let next = match repeat {
                Some(repeat) => number(repeat.to)?,
                None if last => 0,
                None => number(k + 1)?,
            };
            route.waypoints.push(Waypoint {
                number: number(k)?,
                latitude_deg: point.position.lat_deg,
                longitude_deg: point.position.lon_deg,
                altitude_m: point.position.alt_m,
                altitude_type,
                speed_m_s: conduct.speed_m_s,
                speed_type: conduct.speed_type,
                next,
                turn: conduct.turn,
                loiter: conduct.loiter,
                repeat: repeat.map(|repeat| Loop {
                    limit_type: repeat.limit_type,
                    limit: repeat.limit,
                }),
            });
            if let (Some([p2, p3]), false) = (point.curve, last) {
                let place = |c: Control| Place {
                    latitude_deg: c.lat_deg,
                    longitude_deg: c.lon_deg,
                    altitude_m: c.alt_m,
                };
                route.curves.push(Curve {
                    from: number(k)?,
                    to: next,
                    p2: place(p2),
                    p3: place(p3),
                    altitude_type: p2.alt_m.and(altitude_type),
                    form: CurveForm::Native,
                });
            }
        }
        Ok(route)
    }
}

/// A name as a Route ID carries it.
fn printable(name: &str) -> String {
    let seven_bits = |c: char| {
        if c == ' ' || c.is_ascii_graphic() {
            c
        } else {
            '?'
        }
    };
    name.chars().map(seven_bits).take(ROUTE_ID).collect()
}

/// Waypoint Number: 0 and 65535 are none.
const MAX_NUMBER: u16 = 65_534;
/// Characters of a Route ID.
const ROUTE_ID: usize = 32;
