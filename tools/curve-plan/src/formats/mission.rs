//! The two mission files of ground stations: QGroundControl's .plan (JSON) and Mission Planner's .waypoints (text).
//!
//! Where all items are relative to home the route is, too; where some are, each gets the home altitude added. Items that
//! name no place (speed, camera, jumps) are left out, and counted.

use std::fmt::Write;
use std::path::Path;

use curve_paths::Position;
use serde_json::{Value, json};

use crate::failure::Failure;
use crate::json_line;
use crate::route::{Datum, Route, Waypoint};

/// Commands that name a place on the path: waypoint, loiters, land, takeoff, spline, VTOL takeoff and land.
const PLACES: [i64; 9] = [16, 17, 18, 19, 21, 22, 82, 84, 85];
/// MAV_FRAME relative to home: GLOBAL_RELATIVE_ALT and its INT twin.
const RELATIVE: [i64; 2] = [3, 6];
/// MAV_FRAME above mean sea level: GLOBAL and its INT twin.
const ABSOLUTE: [i64; 2] = [0, 5];

/// Reads a .plan.
pub(crate) fn read_plan(file: &Path, text: &str) -> Result<Route, Failure> {
    let plan = json_line::document(file, text)?;
    let fault = |field: &str, problem: &str| json_line::fault(file, text, field, problem);
    if plan["fileType"] != "Plan" {
        let problem = format!("{}, expected \"Plan\"", plan["fileType"]);
        return Err(fault("fileType", &problem));
    }
    let home_alt = plan["mission"]["plannedHomePosition"][2].as_f64();
    let items = plan["mission"]["items"]
        .as_array()
        .ok_or_else(|| fault("mission.items", "missing, expected an array"))?;
    let mut found = Found::default();
    for (k, item) in items.iter().enumerate() {
        let field = |name: &str| format!("mission.items[{k}].{name}");
        if item["type"] != "SimpleItem" {
            let problem = format!("{}, expected \"SimpleItem\"", item["type"]);
            return Err(fault(&field("type"), &problem));
        }
        let command = item["command"]
            .as_i64()
            .ok_or_else(|| fault(&field("command"), "missing, expected a whole number"))?;
        let param = |n: usize| {
            item["params"][n].as_f64().ok_or_else(|| {
                let problem = format!("{}, expected a number", item["params"][n]);
                fault(&field(&format!("params[{n}]")), &problem)
            })
        };
        if !PLACES.contains(&command) {
            found.skipped += 1;
            continue;
        }
        let frame = item["frame"].as_i64().unwrap_or(-1);
        let relative = is_relative(frame).map_err(|e| fault(&field("frame"), &e))?;
        let line = json_line::line_of(text, &format!("mission.items[{k}]"));
        found.place(
            relative,
            Position::new(param(4)?, param(5)?, param(6)?),
            line,
        );
    }
    found.route(home_alt).ok_or_else(|| {
        let problem =
            "missing, expected an altitude: some items are relative to home and some are not";
        fault("mission.plannedHomePosition[2]", problem)
    })
}

/// Reads a .waypoints.
pub(crate) fn read_waypoints(file: &Path, text: &str) -> Result<Route, Failure> {
    let mut lines = text.lines().enumerate();
    let head = lines.next().map_or("", |(_, l)| l.trim());
    if head != "QGC WPL 110" {
        let problem = format!("{head:?}, expected \"QGC WPL 110\"");
        return Err(Failure::at(file, Some(1), "", problem));
    }
    let mut found = Found::default();
    let mut home_alt = None;
    for (k, line) in lines.filter(|(_, l)| !l.trim().is_empty()) {
        let number = Some(k as u64 + 1);
        let fields: Vec<&str> = line.split_whitespace().collect();
        if fields.len() != 12 {
            let problem = format!("{} fields, expected 12", fields.len());
            return Err(Failure::at(file, number, "", problem));
        }
        let value = |n: usize, name: &str| {
            fields[n].parse::<f64>().map_err(|_| {
                let problem = format!("{:?}, expected a number", fields[n]);
                Failure::at(file, number, name, problem)
            })
        };
        let (lat, lon, alt) = (
            value(8, "latitude")?,
            value(9, "longitude")?,
            value(10, "altitude")?,
        );
        // The first row is home, not a waypoint.
        if value(0, "index")? == 0.0 {
            home_alt = Some(alt);
            continue;
        }
        if !PLACES.contains(&(value(3, "command")? as i64)) {
            found.skipped += 1;
            continue;
        }
        let frame = value(2, "frame")? as i64;
        let relative = is_relative(frame).map_err(|e| Failure::at(file, number, "frame", e))?;
        found.place(relative, Position::new(lat, lon, alt), number);
    }
    found.route(home_alt).ok_or_else(|| {
        let problem =
            "no row of home (0), expected one: some items are relative to home and some are not";
        Failure::file(file, problem)
    })
}

/// Items that name a place, as found.
#[derive(Default)]
struct Found {
    places: Vec<(bool, Waypoint)>,
    skipped: usize,
}

impl Found {
    /// Takes an item in; one at 0, 0 is where the vehicle is, no place.
    fn place(&mut self, relative: bool, position: Position, line: Option<u64>) {
        if (position.lat_deg, position.lon_deg) == (0.0, 0.0) {
            self.skipped += 1;
        } else {
            self.places
                .push((relative, Waypoint::straight(position, line)));
        }
    }

    /// `None` where home's altitude is needed and absent.
    fn route(self, home_alt: Option<f64>) -> Option<Route> {
        let all_relative = !self.places.is_empty() && self.places.iter().all(|(r, _)| *r);
        let absolute = |(relative, mut w): (bool, Waypoint)| {
            if relative && !all_relative {
                w.position.alt_m += home_alt?;
            }
            Some(w)
        };
        Some(Route {
            waypoints: self
                .places
                .into_iter()
                .map(absolute)
                .collect::<Option<_>>()?,
            skipped: self.skipped,
            datum: Datum::above_home(all_relative),
            ..Route::default()
        })
    }
}

fn is_relative(frame: i64) -> Result<bool, String> {
    if ABSOLUTE.contains(&frame) || RELATIVE.contains(&frame) {
        Ok(RELATIVE.contains(&frame))
    } else {
        Err(format!(
            "{frame}, expected 0, 3, 5 or 6 (terrain is not known here)"
        ))
    }
}

/// Writes a .plan, home at the first waypoint.
pub(crate) fn write_plan(route: &Route) -> String {
    // QGroundControl's altitude modes: 1 relative to home, 2 above mean sea level.
    let (frame, mode) = if route.datum == Datum::Home {
        (3, 1)
    } else {
        (0, 2)
    };
    let items: Vec<Value> = route
        .positions()
        .iter()
        .enumerate()
        .map(|(k, p)| {
            json!({
                "AMSLAltAboveTerrain": null, "Altitude": p.alt_m, "AltitudeMode": mode, "autoContinue": true,
                "command": 16, "doJumpId": k + 1, "frame": frame,
                "params": [0, 0, 0, null, p.lat_deg, p.lon_deg, p.alt_m], "type": "SimpleItem",
            })
        })
        .collect();
    let home = home(route).map(|p| json!([p.lat_deg, p.lon_deg, p.alt_m]));
    let plan = json!({
        "fileType": "Plan", "groundStation": "QGroundControl", "version": 1,
        "geoFence": { "circles": [], "polygons": [], "version": 2 },
        "mission": {
            "cruiseSpeed": 15, "hoverSpeed": 5, "firmwareType": 12, "vehicleType": 2, "globalPlanAltitudeMode": mode,
            "items": items, "plannedHomePosition": home, "version": 2,
        },
        "rallyPoints": { "points": [], "version": 2 },
    });
    format!("{plan:#}\n")
}

/// Writes a .waypoints, home at the first waypoint.
pub(crate) fn write_waypoints(route: &Route) -> String {
    let mut out = String::from("QGC WPL 110\n");
    let frame = if route.datum == Datum::Home { 3 } else { 0 };
    let home = home(route).map(|p| (0, p));
    let items = route.positions().into_iter().map(|p| (frame, p));
    for (k, (frame, p)) in home.into_iter().chain(items).enumerate() {
        let current = u8::from(k == 1);
        let _ = writeln!(
            out,
            "{k}\t{current}\t{frame}\t16\t0\t0\t0\t0\t{:.8}\t{:.8}\t{:.3}\t1",
            p.lat_deg, p.lon_deg, p.alt_m
        );
    }
    out
}

/// Home: the first waypoint; at height 0 where heights are above it.
fn home(route: &Route) -> Option<Position> {
    let first = route.waypoints.first()?.position;
    let alt_m = if route.datum == Datum::Home {
        0.0
    } else {
        first.alt_m
    };
    Some(Position { alt_m, ..first })
}
