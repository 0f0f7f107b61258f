//! CSV with a header: one fix a row, columns found by their names. `alt_m` is above mean sea level, `height_m` above home.

use std::path::Path;

use curve_paths::Position;

use crate::failure::Failure;
use crate::route::{Datum, Route, Waypoint};

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
    let lap_column = match lap {
        Some(wanted) => Some((need(&["lap"])?, wanted)),
        None => None,
    };
    let mut route = Route {
        datum: Datum::above_home(height.is_some()),
        ..Route::default()
    };
    let mut last_alt = None;
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
        // A blank altitude is that of the row before.
        let alt_m = match alt.filter(|&c| !row.get(c).unwrap_or("").is_empty()) {
            Some(column) => number(column)?,
            None => last_alt.unwrap_or(0.0),
        };
        last_alt = Some(alt_m);
        route.waypoints.push(Waypoint::straight(
            Position::new(number(lat)?, number(lon)?, alt_m),
            line,
        ));
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
const ALTITUDE: &[&str] = &[
    "alt_m",
    "alt",
    "altitude",
    "elevation_m",
    "elevation",
    "ele",
];

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
