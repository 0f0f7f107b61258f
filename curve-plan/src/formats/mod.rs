//! The files that routes and tracks are kept in, told apart by their ending.
//!
//! Curves are kept by the program's own format alone; the others hold waypoints, so a curved route is written to them
//! as the vertices that it is flown by.

mod geojson;
mod mission;
mod own;
mod table;
pub(crate) mod xml;

use std::path::Path;

use curve_paths::Position;

use crate::failure::Failure;
use crate::route::Route;

/// Which rows of a table of several laps to read.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Selection {
    /// The lap, where the table has a column of that name; none, all of them.
    pub(crate) lap: Option<i64>,
    /// Keep each n-th fix, from the first; 0 and 1 keep all.
    pub(crate) every: usize,
}

/// A kind of file.
#[derive(Clone, Copy, Debug, Eq, PartialEq)]
pub(crate) enum Format {
    Own,
    Plan,
    Waypoints,
    GeoJson,
    Kml,
    Gpx,
    Csv,
}

impl Format {
    /// The kind that a file's ending says.
    pub(crate) fn of(file: &Path) -> Result<Self, Failure> {
        let ending = file
            .extension()
            .and_then(|e| e.to_str())
            .unwrap_or("")
            .to_ascii_lowercase();
        Ok(match ending.as_str() {
            "toml" => Self::Own,
            "plan" => Self::Plan,
            "waypoints" => Self::Waypoints,
            "geojson" | "json" => Self::GeoJson,
            "kml" => Self::Kml,
            "gpx" => Self::Gpx,
            "csv" => Self::Csv,
            _ => {
                let known = ".toml, .plan, .waypoints, .geojson, .kml, .gpx, .csv";
                return Err(Failure::file(
                    file,
                    format!("unknown ending {ending:?}, expected one of {known}"),
                ));
            }
        })
    }
}

/// Reads a route or track.
pub(crate) fn read(file: &Path, selection: Selection) -> Result<Route, Failure> {
    let format = Format::of(file)?;
    if selection.lap.is_some() && format != Format::Csv {
        return Err(Failure::Usage(
            "--lap needs a table with a column lap (.csv)".into(),
        ));
    }
    let text = std::fs::read_to_string(file).map_err(|e| Failure::file(file, e))?;
    let mut route = match format {
        Format::Own => own::read(file, &text),
        Format::Plan => mission::read_plan(file, &text),
        Format::Waypoints => mission::read_waypoints(file, &text),
        Format::GeoJson => geojson::read(file, &text),
        Format::Kml => xml::read_kml(file, &text),
        Format::Gpx => xml::read_gpx(file, &text),
        Format::Csv => table::read(file, &text, selection.lap),
    }?;
    if selection.every > 1 {
        if route.is_curved() {
            return Err(Failure::Usage(
                "--every thins out a track; this route has curves".into(),
            ));
        }
        route.waypoints = route
            .waypoints
            .into_iter()
            .step_by(selection.every)
            .collect();
    }
    if route.name.is_empty() {
        route.name = file
            .file_stem()
            .and_then(|s| s.to_str())
            .unwrap_or("route")
            .to_owned();
    }
    Ok(route)
}

/// Writes a route with its curves: the program's own format.
pub(crate) fn write_route(file: &Path, route: &Route) -> Result<(), Failure> {
    save(file, &own::write(route))
}

/// Writes waypoints.
pub(crate) fn write_points(file: &Path, name: &str, points: &[Position]) -> Result<(), Failure> {
    let text = match Format::of(file)? {
        Format::Own => {
            let waypoints = points
                .iter()
                .map(|&p| crate::route::Waypoint::straight(p, None))
                .collect();
            own::write(&Route {
                name: name.to_owned(),
                closed: false,
                waypoints,
                skipped: 0,
            })
        }
        Format::Plan => mission::write_plan(points),
        Format::Waypoints => mission::write_waypoints(points),
        Format::GeoJson => geojson::write(name, points),
        Format::Kml => xml::write_kml(name, points),
        Format::Gpx => xml::write_gpx(name, points),
        Format::Csv => table::write(points),
    };
    save(file, &text)
}

/// Writes a text to a file.
pub(crate) fn save(file: &Path, text: &str) -> Result<(), Failure> {
    std::fs::write(file, text).map_err(|e| Failure::file(file, e))
}
