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

use std::path::Path;

use curve_paths::{Control, Position};
use serde::Deserialize;
use toml::Spanned;

use crate::failure::Failure;
use crate::route::{Datum, Route, Waypoint};

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
pub(crate) fn read(file: &Path, text: &str) -> Result<Route, Failure> {
    let plan = cucs::Route::parse(file, text)?;
    let places: Places =
        toml::from_str(text).map_err(|e| Failure::at(file, None, "", e.message()))?;
    let line = |offset: usize| Some(1 + text[..offset].matches('\n').count() as u64);
    let line_of = |number: u16| {
        let place = places
            .waypoint
            .iter()
            .find(|w| *w.number.get_ref() == number);
        place.and_then(|w| line(w.number.span().start))
    };
    let (order, back) = order(&plan, file, &line_of)?;
    let datum = datum(&plan, file, &line_of)?;
    let point = |w: &cucs::Waypoint, to: Option<u16>| {
        let curve = plan
            .curves
            .iter()
            .find(|c| c.from == w.number && Some(c.to) == to);
        Waypoint {
            position: Position::new(w.latitude_deg, w.longitude_deg, w.altitude_m),
            line: line_of(w.number),
            curve: curve.map(|c| [control(c.p2), control(c.p3)]),
            no_altitude: None,
        }
    };
    let next = |k: usize| order.get(k + 1).map(|w| w.number).or(back);
    let mut waypoints: Vec<Waypoint> = (0..order.len()).map(|k| point(order[k], next(k))).collect();
    for (k, curve) in plan.curves.iter().enumerate() {
        let flown = |i: usize| order[i].number == curve.from && next(i) == Some(curve.to);
        if !(0..order.len()).any(flown) {
            let at = places.curve.get(k).and_then(|c| line(c.from.span().start));
            let problem = format!("no leg leads from {} to {}", curve.from, curve.to);
            return Err(Failure::at(file, at, "curve", problem));
        }
    }
    let closed = back.is_some() && back == order.first().map(|w| w.number);
    if let (false, Some(back)) = (
        closed,
        back.and_then(|n| order.iter().find(|w| w.number == n)),
    ) {
        waypoints.push(Waypoint {
            curve: None,
            ..point(back, None)
        });
    }
    Ok(Route {
        name: plan
            .id
            .clone()
            .or_else(|| plan.mission_id.clone())
            .unwrap_or_default(),
        closed,
        skipped: plan.waypoints.len() - order.len(),
        waypoints,
        datum,
        plan: Some(plan),
    })
}

/// The waypoints in the order that they are flown, and the one that the last leads back to.
fn order<'a>(
    plan: &'a cucs::Route,
    file: &Path,
    line_of: &dyn Fn(u16) -> Option<u64>,
) -> Result<(Vec<&'a cucs::Waypoint>, Option<u16>), Failure> {
    let mut order: Vec<&cucs::Waypoint> = Vec::new();
    let first = plan.waypoints.first().map_or(0, |w| w.number);
    let mut number = plan.initial.unwrap_or(first);
    while number != 0 {
        if order.iter().any(|w| w.number == number) {
            return Ok((order, Some(number)));
        }
        let Some(found) = plan.waypoints.iter().find(|w| w.number == number) else {
            let from = order.last().map(|w| w.number);
            let field = from.map_or("initial".to_owned(), |n| format!("waypoint {n}: next"));
            let problem = format!("{number}, expected the number of a waypoint, or 0");
            return Err(Failure::at(file, from.and_then(line_of), field, problem));
        };
        order.push(found);
        number = found.next;
    }
    Ok((order, None))
}

/// What all altitudes are above: a path has one.
fn datum(
    plan: &cucs::Route,
    file: &Path,
    line_of: &dyn Fn(u16) -> Option<u64>,
) -> Result<Datum, Failure> {
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
            return Err(Failure::at(file, line_of(number), field, problem));
        }
    }
    Ok(found.unwrap_or_default())
}

fn control(place: cucs::Place) -> Control {
    Control {
        lat_deg: place.latitude_deg,
        lon_deg: place.longitude_deg,
        alt_m: place.altitude_m,
    }
}
