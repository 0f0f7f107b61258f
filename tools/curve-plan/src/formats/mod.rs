//! The files that routes and tracks are kept in, distinguished by their ending.
//!
//! Curves are kept by the ground station's route file and by the messages; the others hold waypoints, so a curved route
//! is written to them as the vertices that it is flown by.

mod dli;
mod geojson;
mod mission;
mod route_file;
mod table;
pub(crate) mod xml;

use std::path::Path;

use clap::Args;

use crate::failure::Failure;
use crate::route::{Datum, Level, Route};

pub(crate) use dli::Addresses;

/// Which fixes of a track to read.
#[derive(Clone, Copy, Debug, Default, Args)]
pub(crate) struct Selection {
    /// Use only the rows of this lap (a table with a column lap).
    #[arg(long)]
    lap: Option<i64>,
    /// Keep every n-th fix.
    // The first is kept; without the option, and by default, all are.
    #[arg(long, default_value_t = 1, value_parser = clap::value_parser!(u32).range(1..))]
    every: u32,
}

/// A kind of file.
#[derive(Clone, Copy, Debug, Eq, PartialEq)]
pub(crate) enum Format {
    /// The ground station's route file.
    RouteFile,
    Plan,
    Waypoints,
    GeoJson,
    Kml,
    Gpx,
    Csv,
    /// Messages, a line each; not read.
    Hex,
    /// Messages, as a capture; not read.
    Pcapng,
}

impl Format {
    /// The kind that belongs to a file's ending.
    pub(crate) fn of(file: &Path) -> Result<Self, Failure> {
        let ending = ending(file);
        Ok(match ending.as_str() {
            "toml" => Self::RouteFile,
            "plan" => Self::Plan,
            "waypoints" => Self::Waypoints,
            "geojson" | "json" => Self::GeoJson,
            "kml" => Self::Kml,
            "gpx" => Self::Gpx,
            "csv" => Self::Csv,
            "hex" => Self::Hex,
            "pcapng" => Self::Pcapng,
            _ => {
                let known = ".toml, .plan, .waypoints, .geojson, .kml, .gpx, .csv, .hex, .pcapng";
                return Err(Failure::file(
                    file,
                    format!("unknown ending {ending:?}, expected one of {known}"),
                ));
            }
        })
    }

    /// Whether it can hold a curve.
    pub(crate) const fn keeps_curves(self) -> bool {
        matches!(self, Self::RouteFile | Self::Hex | Self::Pcapng)
    }
}

/// The ending of a file's name, in small letters.
pub(crate) fn ending(file: &Path) -> String {
    let ending = file.extension().and_then(|e| e.to_str()).unwrap_or("");
    ending.to_ascii_lowercase()
}

/// Reads a route to be flown: each waypoint has an altitude, of the file or of the command line.
pub(crate) fn read(file: &Path, level: Level) -> Result<Route, Failure> {
    let mut route = read_track(file, Selection::default())?;
    route.level(level, file)?;
    Ok(route)
}

/// Reads a route or track for what is done on the ground: altitudes may be absent.
pub(crate) fn read_track(file: &Path, selection: Selection) -> Result<Route, Failure> {
    let format = Format::of(file)?;
    if selection.lap.is_some() && format != Format::Csv {
        return Err(Failure::Usage(
            "--lap needs a table with a column lap (.csv)".into(),
        ));
    }
    let text = std::fs::read_to_string(file).map_err(|e| Failure::file(file, e))?;
    let mut route = match format {
        Format::RouteFile => route_file::read(file, &text),
        Format::Plan => mission::read_plan(file, &text),
        Format::Waypoints => mission::read_waypoints(file, &text),
        Format::GeoJson => geojson::read(file, &text),
        Format::Kml => xml::read_kml(file, &text),
        Format::Gpx => xml::read_gpx(file, &text),
        Format::Csv => table::read(file, &text, selection.lap),
        Format::Hex | Format::Pcapng => {
            let problem = "messages are written, not read: cucs download gives a .toml";
            Err(Failure::file(file, problem))
        }
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
            .step_by(selection.every as usize)
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

/// Writes a route; a curved one only where the format keeps curves.
pub(crate) fn write(file: &Path, route: &Route, addresses: &Addresses) -> Result<(), Failure> {
    let format = Format::of(file)?;
    if route.is_curved() && !format.keeps_curves() {
        return Err(Failure::file(
            file,
            "its format has no curves, expected .toml",
        ));
    }
    let refuse = |heights: &str, instead: &str| {
        Err(Failure::file(
            file,
            format!("the route has {heights}, which its format cannot hold: {instead}"),
        ))
    };
    match (format, route.datum) {
        (Format::RouteFile | Format::Hex | Format::Pcapng, _) => {}
        (_, Datum::Unstated) => return refuse("no altitude_type", "expected agl or amsl"),
        (_, Datum::Ellipsoid) => {
            return refuse(
                "heights above the ellipsoid",
                "give them above mean sea level",
            );
        }
        (Format::Gpx, Datum::Home) => return refuse("heights above home", "give --home-alt"),
        _ => {}
    }
    let text = match format {
        Format::RouteFile => route.to_plan()?.to_toml(),
        Format::Plan => mission::write_plan(route),
        Format::Waypoints => mission::write_waypoints(route),
        Format::GeoJson => geojson::write(route),
        Format::Kml => xml::write_kml(route),
        Format::Gpx => xml::write_gpx(route),
        Format::Csv => table::write(route),
        Format::Hex => addresses.hex(route)?,
        Format::Pcapng => return save(file, &addresses.pcapng(route)?),
    };
    save(file, text.as_bytes())
}

/// Writes a file.
pub(crate) fn save(file: &Path, bytes: &[u8]) -> Result<(), Failure> {
    std::fs::write(file, bytes).map_err(|e| Failure::file(file, e))
}
