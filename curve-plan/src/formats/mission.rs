//! The two mission files of ground stations: QGroundControl's .plan (JSON) and Mission Planner's .waypoints (text).
//!
//! Altitudes are kept above mean sea level: an item relative to home gets the home altitude added. Items that name no
//! place (speed, camera, jumps) are left out, and counted.

use std::fmt::Write;
use std::path::Path;

use curve_paths::Position;
use serde_json::{Value, json};

use crate::failure::Failure;
use crate::route::{Route, Waypoint};

/// Commands that name a place on the path: waypoint, loiters, land, takeoff, spline, VTOL takeoff and land.
const PLACES: [i64; 9] = [16, 17, 18, 19, 21, 22, 82, 84, 85];
/// MAV_FRAME relative to home: GLOBAL_RELATIVE_ALT and its INT twin.
const RELATIVE: [i64; 2] = [3, 6];
/// MAV_FRAME above mean sea level: GLOBAL and its INT twin.
const ABSOLUTE: [i64; 2] = [0, 5];

/// Reads a .plan.
pub(crate) fn read_plan(file: &Path, text: &str) -> Result<Route, Failure> {
    let plan: Value =
        serde_json::from_str(text).map_err(|e| Failure::at(file, Some(e.line() as u64), "", &e))?;
    if plan["fileType"] != "Plan" {
        return Err(Failure::at(
            file,
            None,
            "fileType",
            format!("{}, expected \"Plan\"", plan["fileType"]),
        ));
    }
    let home_alt = plan["mission"]["plannedHomePosition"][2]
        .as_f64()
        .unwrap_or(0.0);
    let items = plan["mission"]["items"]
        .as_array()
        .ok_or_else(|| Failure::at(file, None, "mission.items", "missing, expected an array"))?;
    let mut route = Route::default();
    for (k, item) in items.iter().enumerate() {
        let field = |name: &str| format!("mission.items[{k}].{name}");
        if item["type"] != "SimpleItem" {
            let problem = format!("{}, expected \"SimpleItem\"", item["type"]);
            return Err(Failure::at(file, None, field("type"), problem));
        }
        let command = item["command"].as_i64().ok_or_else(|| {
            Failure::at(
                file,
                None,
                field("command"),
                "missing, expected a whole number",
            )
        })?;
        let param = |n: usize| {
            item["params"][n].as_f64().ok_or_else(|| {
                Failure::at(
                    file,
                    None,
                    field(&format!("params[{n}]")),
                    format!("{}, expected a number", item["params"][n]),
                )
            })
        };
        if !PLACES.contains(&command) {
            route.skipped += 1;
            continue;
        }
        let frame = item["frame"].as_i64().unwrap_or(-1);
        let base =
            base_m(frame, home_alt).map_err(|e| Failure::at(file, None, field("frame"), e))?;
        let place = (param(4)?, param(5)?);
        if place == (0.0, 0.0) {
            route.skipped += 1;
            continue;
        }
        route.waypoints.push(Waypoint::straight(
            Position::new(place.0, place.1, base + param(6)?),
            None,
        ));
    }
    Ok(route)
}

/// Reads a .waypoints.
pub(crate) fn read_waypoints(file: &Path, text: &str) -> Result<Route, Failure> {
    let mut lines = text.lines().enumerate();
    let head = lines.next().map_or("", |(_, l)| l.trim());
    if head != "QGC WPL 110" {
        return Err(Failure::at(
            file,
            Some(1),
            "",
            format!("{head:?}, expected \"QGC WPL 110\""),
        ));
    }
    let mut route = Route::default();
    let mut home_alt = 0.0;
    for (k, line) in lines.filter(|(_, l)| !l.trim().is_empty()) {
        let number = Some(k as u64 + 1);
        let fields: Vec<&str> = line.split_whitespace().collect();
        if fields.len() != 12 {
            return Err(Failure::at(
                file,
                number,
                "",
                format!("{} fields, expected 12", fields.len()),
            ));
        }
        let value = |n: usize, name: &str| {
            fields[n].parse::<f64>().map_err(|_| {
                Failure::at(
                    file,
                    number,
                    name,
                    format!("{:?}, expected a number", fields[n]),
                )
            })
        };
        let (lat, lon, alt) = (
            value(8, "latitude")?,
            value(9, "longitude")?,
            value(10, "altitude")?,
        );
        // The first row is home, not a waypoint.
        if value(0, "index")? == 0.0 {
            home_alt = alt;
            continue;
        }
        if !PLACES.contains(&(value(3, "command")? as i64)) || (lat, lon) == (0.0, 0.0) {
            route.skipped += 1;
            continue;
        }
        let frame = value(2, "frame")? as i64;
        let base = base_m(frame, home_alt).map_err(|e| Failure::at(file, number, "frame", e))?;
        route.waypoints.push(Waypoint::straight(
            Position::new(lat, lon, base + alt),
            number,
        ));
    }
    Ok(route)
}

fn base_m(frame: i64, home_alt: f64) -> Result<f64, String> {
    if ABSOLUTE.contains(&frame) {
        Ok(0.0)
    } else if RELATIVE.contains(&frame) {
        Ok(home_alt)
    } else {
        Err(format!(
            "{frame}, expected 0, 3, 5 or 6 (terrain is not known here)"
        ))
    }
}

/// Writes a .plan of waypoints above mean sea level, home at the first.
pub(crate) fn write_plan(points: &[Position]) -> String {
    let items: Vec<Value> = points
        .iter()
        .enumerate()
        .map(|(k, p)| {
            json!({
                "AMSLAltAboveTerrain": null, "Altitude": p.alt_m, "AltitudeMode": 2, "autoContinue": true,
                "command": 16, "doJumpId": k + 1, "frame": 0,
                "params": [0, 0, 0, null, p.lat_deg, p.lon_deg, p.alt_m], "type": "SimpleItem",
            })
        })
        .collect();
    let home = points
        .first()
        .map(|p| json!([p.lat_deg, p.lon_deg, p.alt_m]));
    let plan = json!({
        "fileType": "Plan", "groundStation": "QGroundControl", "version": 1,
        "geoFence": { "circles": [], "polygons": [], "version": 2 },
        "mission": {
            "cruiseSpeed": 15, "hoverSpeed": 5, "firmwareType": 12, "vehicleType": 2, "globalPlanAltitudeMode": 2,
            "items": items, "plannedHomePosition": home, "version": 2,
        },
        "rallyPoints": { "points": [], "version": 2 },
    });
    format!("{plan:#}\n")
}

/// Writes a .waypoints of waypoints above mean sea level, home at the first.
pub(crate) fn write_waypoints(points: &[Position]) -> String {
    let mut out = String::from("QGC WPL 110\n");
    let home = points.first().into_iter();
    for (k, p) in home.chain(points).enumerate() {
        let current = u8::from(k == 1);
        let _ = writeln!(
            out,
            "{k}\t{current}\t0\t16\t0\t0\t0\t0\t{:.7}\t{:.7}\t{:.3}\t1",
            p.lat_deg, p.lon_deg, p.alt_m
        );
    }
    out
}
