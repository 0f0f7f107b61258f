//! CSV with a header: one fix a row, columns found by their names. `alt_m` is above mean sea level, `height_m` above home;
//! `elevation_m` is the ground's, and no altitude to fly at.

use std::path::Path;

use crate::failure::Failure;
use crate::route::{Datum, NoAltitude, Route, Waypoint};

/// Reads the rows of one lap, or of all.
pub(crate) fn read(file: &Path, text: &str, lap: Option<i64>) -> Result<Route, Failure> {
    let mut reader = csv::ReaderBuilder::new()
        .trim(csv::Trim::All)
        .from_reader(text.as_bytes());
    let header = reader
        .headers()
        .map_err(|e| Failure::at(file, Some(1), "", e))?
        .clone();
    let find = |names: &[&str]| {
        header
            .iter()
            .position(|h| names.contains(&h.to_ascii_lowercase().as_str()))
    };
    let need = |names: &[&str]| {
        find(names).ok_or_else(|| {
            let problem = format!("no such column, expected one of {}", names.join(", "));
            Failure::at(file, Some(1), names[0], problem)
        })
    };
    let (lat, lon) = (need(LATITUDE)?, need(LONGITUDE)?);
    let height = find(HEIGHT);
    let alt = height.or_else(|| find(ALTITUDE));
    let ground = find(GROUND).is_some();
    let lap_column = match lap {
        Some(wanted) => Some((need(&["lap"])?, wanted)),
        None => None,
    };
    let mut route = Route {
        datum: Datum::above_home(height.is_some()),
        ..Route::default()
    };
    for row in reader.records() {
        let row =
            row.map_err(|e| Failure::at(file, e.position().map(csv::Position::line), "", &e))?;
        let line = row.position().map(csv::Position::line);
        let number = |column: usize| {
            let text = row.get(column).unwrap_or("");
            text.parse::<f64>().map_err(|_| {
                let problem = format!("{text:?}, expected a number");
                Failure::at(file, line, &header[column], problem)
            })
        };
        if let Some((column, wanted)) = lap_column {
            let text = row.get(column).unwrap_or("");
            let here: i64 = text.parse().map_err(|_| {
                let problem = format!("{text:?}, expected a whole number");
                Failure::at(file, line, "lap", problem)
            })?;
            if here != wanted {
                continue;
            }
        }
        let alt_m = match alt.filter(|&c| !row.get(c).unwrap_or("").is_empty()) {
            Some(column) => Ok(number(column)?),
            None if ground => Err(NoAltitude::Ground),
            None => Err(NoAltitude::Missing),
        };
        let point = Waypoint::found(number(lat)?, number(lon)?, alt_m, line);
        route.waypoints.push(point);
    }
    if route.waypoints.is_empty() {
        let which = lap.map_or_else(String::new, |l| format!(" of lap {l}"));
        return Err(Failure::file(
            file,
            format!("no fixes{which}, expected some"),
        ));
    }
    Ok(route)
}

const LATITUDE: &[&str] = &["lat_deg", "lat", "latitude"];
const LONGITUDE: &[&str] = &["lon_deg", "lon", "lng", "longitude"];
const HEIGHT: &[&str] = &["height_m"];
const ALTITUDE: &[&str] = &["alt_m", "alt", "altitude", "ele"];
/// The ground's own altitude, which is none to fly at.
const GROUND: &[&str] = &["elevation_m", "elevation"];

/// Writes the waypoints.
pub(crate) fn write(route: &Route) -> String {
    let above = if route.datum == Datum::Home {
        HEIGHT
    } else {
        ALTITUDE
    };
    let mut out = format!("lat_deg,lon_deg,{}\n", above[0]);
    for p in route.positions() {
        out += &format!("{:.8},{:.8},{:.3}\n", p.lat_deg, p.lon_deg, p.alt_m);
    }
    out
}
