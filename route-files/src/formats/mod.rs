//! The files that routes and tracks are kept in, distinguished by their ending: what a ground station uploads, and what
//! `curve-plan` reads and writes. One reader for both.
//!
//! | part | holds |
//! |---|---|
//! | [`draft`](Draft) | a route as a file has it |
//! | [`losses`](Losses), `lost` | what of a file was not taken; what the formats do not hold |
//! | `lines` | the lines of a file with several, and the choice of one |
//! | `items` | mission items, which `qgc_plan` and `waypoints` share |
//! | `attributes` | what is done at a point as pairs of key and text, for `kml`, `gpx`, `geojson`, `table` (CSV) |
//! | `route_file` | the ground station's route file, and a draft as its route |
//! | `terrain` | the height of the ground |
//! | `xml`, `json_line`, `fault` | elements and values with their lines; errors |
//!
//! Curves are kept by the route file; the others hold points.

mod attributes;
mod draft;
mod fault;
mod geojson;
mod gpx;
mod items;
mod json_line;
mod kml;
mod lines;
mod losses;
mod lost;
mod qgc_plan;
mod route_file;
mod table;
mod terrain;
#[cfg(test)]
mod tests;
mod waypoints;
mod xml;

use std::io::Read as _;
use std::path::{Path, PathBuf};

use clap::Args;
use curve_paths::Position;
use stanag_msgs::Id;

use crate::fence::{self, Area};
use crate::route::model::Route;

pub use draft::{Conduct, Datum, Draft, Extra, Level, NoAltitude, Point, Repeat, TakeOff};
pub use fault::FormatError;
use lines::{Line, Lines};
pub use losses::{Loss, Losses};
pub use terrain::{Clearance, Terrain};
pub use xml::escaped;

/// Which part of a file to read.
#[derive(Clone, Debug, Args)]
pub struct Selection {
    /// Use only the rows of this lap (a table with a column lap).
    #[arg(long)]
    pub lap: Option<i64>,
    /// Keep every n-th fix.
    // The first is kept; without the option, and by default, all are.
    #[arg(long, default_value_t = 1, value_parser = clap::value_parser!(u32).range(1..))]
    pub every: u32,
    #[command(flatten)]
    line: Line,
    #[arg(skip)]
    most_unpacked: Option<u64>,
}

impl Default for Selection {
    fn default() -> Self {
        Self {
            lap: None,
            every: 1,
            line: Line::default(),
            most_unpacked: None,
        }
    }
}

/// How to take a file as a route.
#[derive(Clone, Debug, Default, Args)]
pub struct Import {
    #[command(flatten)]
    level: Level,
    /// Turn heights above home into altitudes by this altitude of home, m above mean sea level.
    #[arg(long, value_name = "M", allow_negative_numbers = true)]
    pub home_alt: Option<f64>,
    #[command(flatten)]
    line: Line,
    /// Fail where anything of the file would be lost; nothing is written or sent then.
    #[arg(long)]
    pub strict: bool,
    /// Bytes that a zipped file may unpack to, where somebody else sends it; else so many that no honest one has more.
    #[arg(skip)]
    pub most_unpacked: Option<u64>,
}

impl Import {
    /// A line of a file with several, by its name or its number from 1; and for a file without altitudes an altitude above mean sea
    /// level, or a height above home, m.
    #[must_use]
    pub fn of(line: Option<String>, altitude_m: Option<f64>, height_m: Option<f64>) -> Self {
        Self {
            level: Level::at(altitude_m, height_m),
            line: Line { line },
            ..Self::default()
        }
    }
}

/// The file to write, named alike by every command: `convert IN OUT` or `convert IN -o OUT`.
#[derive(Clone, Debug, Args)]
pub struct Output {
    /// Write to this file; its ending selects the format.
    #[arg(value_name = "OUTPUT")]
    written: Option<PathBuf>,
    /// The same as OUTPUT.
    #[arg(
        short,
        long = "output",
        value_name = "OUTPUT",
        conflicts_with = "written"
    )]
    output: Option<PathBuf>,
}

impl Output {
    /// The file, where one is named.
    #[must_use]
    pub fn path(&self) -> Option<&Path> {
        self.written.as_deref().or(self.output.as_deref())
    }
}

/// A kind of file.
#[derive(Clone, Copy, Debug, Eq, PartialEq)]
pub enum Format {
    /// The ground station's route file.
    RouteFile,
    /// QGroundControl.
    Plan,
    /// Mission Planner, MAVProxy.
    Waypoints,
    /// GeoJSON.
    GeoJson,
    /// Google Earth.
    Kml,
    /// Google Earth, zipped.
    Kmz,
    /// GPX.
    Gpx,
    /// A table.
    Csv,
    /// Messages, a line each; not read.
    Hex,
    /// Messages, as a capture; not read.
    Pcapng,
}

impl Format {
    /// The kind that belongs to a file's ending.
    ///
    /// # Errors
    /// No kind has this ending.
    pub fn of(file: &Path) -> Result<Self, FormatError> {
        let ending = ending(file);
        Ok(match ending.as_str() {
            "toml" => Self::RouteFile,
            "plan" => Self::Plan,
            "waypoints" | "txt" => Self::Waypoints,
            "geojson" | "json" => Self::GeoJson,
            "kml" => Self::Kml,
            "kmz" => Self::Kmz,
            "gpx" => Self::Gpx,
            "csv" => Self::Csv,
            "hex" => Self::Hex,
            "pcapng" => Self::Pcapng,
            _ => {
                let known = ".toml, .plan, .waypoints, .txt, .geojson, .kml, .kmz, .gpx, .csv, .hex, .pcapng";
                return Err(FormatError::file(
                    file,
                    format!("unknown ending {ending:?}, expected one of {known}"),
                ));
            }
        })
    }

    /// Whether it can hold a curve.
    #[must_use]
    pub const fn keeps_curves(self) -> bool {
        matches!(self, Self::RouteFile | Self::Hex | Self::Pcapng)
    }
}

/// The ending of a file's name, in small letters.
#[must_use]
pub fn ending(file: &Path) -> String {
    let ending = file.extension().and_then(|e| e.to_str()).unwrap_or("");
    ending.to_ascii_lowercase()
}

/// Reads a route to be flown: each point has an altitude, of the file or of the command line.
///
/// # Errors
/// It cannot be read, is not of its format, a point has no altitude, or it is below the ground.
pub fn read(file: &Path, import: &Import) -> Result<Draft, FormatError> {
    read_content(file, bytes(file)?, import)
}

fn read_content(file: &Path, content: Vec<u8>, import: &Import) -> Result<Draft, FormatError> {
    let selection = Selection {
        line: import.line.clone(),
        most_unpacked: import.most_unpacked,
        ..Selection::default()
    };
    let mut draft = track_in(file, content, &selection)?;
    let terrain = import.level.terrain()?;
    draft.level(&import.level, terrain.as_ref(), file)?;
    if let Some(home_m) = import.home_alt {
        draft.lift(home_m);
    }
    if let Some(terrain) = terrain {
        draft.clearance = Some(draft.above_ground(&terrain, file)?);
    }
    Ok(draft)
}

/// Reads a route to be sent; what of the file is not in it.
///
/// A route file is sent as it is, whether its waypoints hang together or not: that is the VSM's to judge.
///
/// # Errors
/// As of [`read`].
pub fn read_to_send(file: &Path, import: &Import) -> Result<(Route, Losses), FormatError> {
    content_to_send(file, bytes(file)?, import)
}

/// As [`read_to_send`], of what a file holds: of `file` its name alone is looked at.
///
/// # Errors
/// As of [`read`].
pub fn content_to_send(
    file: &Path,
    content: Vec<u8>,
    import: &Import,
) -> Result<(Route, Losses), FormatError> {
    // These look at the path, and so must it be one.
    if ending(file) != "toml" || import.level.is_given() || import.home_alt.is_some() {
        return read_content(file, content, import)?.to_send(file);
    }
    let text = text(file, not_empty(file, content)?)?;
    let route = Route::parse(file, &text)?;
    let mut losses = Losses::of("waypoint");
    losses.items = route.waypoints.len();
    lost::sent_fence(&route_file::areas(file, &text)?, file, &mut losses);
    Ok((route, losses))
}

/// Reads a route or track for what is done on the ground: altitudes may be absent.
///
/// # Errors
/// It cannot be read, or is not of its format.
pub fn read_track(file: &Path, selection: &Selection) -> Result<Draft, FormatError> {
    track_in(file, bytes(file)?, selection)
}

fn track_in(file: &Path, content: Vec<u8>, selection: &Selection) -> Result<Draft, FormatError> {
    let mut draft = parse(file, content, selection)?;
    if draft.points.is_empty() {
        let problem = "no path, expected a line, a route, a track, waypoints or points";
        return Err(FormatError::file(file, problem));
    }
    if selection.every > 1 {
        if draft.is_curved() {
            return Err(FormatError::Option(
                "--every thins out a track; this route has curves".into(),
            ));
        }
        draft.points = draft
            .points
            .into_iter()
            .step_by(selection.every as usize)
            .collect();
    }
    if draft.name.is_empty() {
        draft.name = file
            .file_stem()
            .and_then(|s| s.to_str())
            .unwrap_or("route")
            .to_owned();
    }
    Ok(draft)
}

/// Reads the geofence of a fence file, or of any file that holds one.
///
/// # Errors
/// It cannot be read, is not of its format, or has no area.
pub fn read_fence(file: &Path) -> Result<Vec<Area>, FormatError> {
    let areas = if Format::of(file)? == Format::RouteFile {
        fence::parse(file, &text(file, not_empty(file, bytes(file)?)?)?)?
    } else {
        parse(file, bytes(file)?, &Selection::default())?.areas
    };
    // A route without a fence must not take the place of the one aboard.
    if areas.is_empty() {
        let problem = "no geofence, expected at least one area";
        return Err(FormatError::file(file, problem));
    }
    Ok(areas)
}

/// Reads the rally points of a .plan: degrees, and metres above home. Other formats do not say what their heights are above.
///
/// # Errors
/// It cannot be read, is no .plan, or has no rally point.
pub fn read_rally(file: &Path) -> Result<Vec<Position>, FormatError> {
    if Format::of(file)? != Format::Plan {
        let problem = "rally points are read from a .plan, where their heights are above home";
        return Err(FormatError::file(file, problem));
    }
    let rally = parse(file, bytes(file)?, &Selection::default())?.rally;
    if rally.is_empty() {
        let problem = "no rally point, expected at least one";
        return Err(FormatError::file(file, problem));
    }
    Ok(rally)
}

fn parse(file: &Path, content: Vec<u8>, selection: &Selection) -> Result<Draft, FormatError> {
    let format = Format::of(file)?;
    if selection.lap.is_some() && format != Format::Csv {
        let problem = "--lap needs a table with a column lap (.csv)";
        return Err(FormatError::Option(problem.into()));
    }
    let lines = [Format::Kml, Format::Kmz, Format::Gpx, Format::GeoJson];
    if selection.line.line.is_some() && !lines.contains(&format) {
        let problem =
            "--line needs a file that can have several lines (.kml, .kmz, .gpx, .geojson)";
        return Err(FormatError::Option(problem.into()));
    }
    let mut content = not_empty(file, content)?;
    if format == Format::Kmz {
        content = kml::unpack(file, &content, selection.most_unpacked)?;
    }
    let text = &text(file, content)?;
    let choose = |lines: Lines| lines.choose(file, &selection.line);
    match format {
        Format::RouteFile => route_file::read(file, text),
        Format::Plan => qgc_plan::read(file, text),
        Format::Waypoints => waypoints::read(file, text),
        Format::GeoJson => choose(geojson::read(file, text)?),
        Format::Kml | Format::Kmz => choose(kml::read(file, text)?),
        Format::Gpx => choose(gpx::read(file, text)?),
        Format::Csv => Ok(table::read(file, text, selection.lap)?.numbered()),
        Format::Hex | Format::Pcapng => {
            let problem = "messages are written, not read: cucs download gives a .toml";
            Err(FormatError::file(file, problem))
        }
    }
}

fn bytes(file: &Path) -> Result<Vec<u8>, FormatError> {
    let fault = |e: std::io::Error| FormatError::file(file, e);
    let open = std::fs::File::open(file).map_err(fault)?;
    let mut bytes = Vec::new();
    // A device may never end, and a recording of hours is no route.
    let mut all = open.take(MAX_BYTES + 1);
    all.read_to_end(&mut bytes).map_err(fault)?;
    if bytes.len() as u64 > MAX_BYTES {
        let problem = format!(
            "over {} MB, expected a route or a track",
            MAX_BYTES / 1_000_000
        );
        return Err(FormatError::file(file, problem));
    }
    Ok(bytes)
}

fn not_empty(file: &Path, content: Vec<u8>) -> Result<Vec<u8>, FormatError> {
    if content.iter().all(u8::is_ascii_whitespace) {
        let problem = "empty, expected a route or a track";
        return Err(FormatError::file(file, problem));
    }
    Ok(content)
}

/// A day's track at a fix a tenth of a second has some 60 MB as GPX.
const MAX_BYTES: u64 = 100_000_000;

/// The text of a file, without the mark that spreadsheets and editors of Windows put before it.
fn text(file: &Path, bytes: Vec<u8>) -> Result<String, FormatError> {
    let text = String::from_utf8(bytes).map_err(|e| {
        let before = e.as_bytes().iter().take(e.utf8_error().valid_up_to());
        let line = 1 + before.filter(|b| **b == b'\n').count() as u64;
        FormatError::at(file, Some(line), "", "not UTF-8, expected text in UTF-8")
    })?;
    Ok(text
        .strip_prefix('\u{feff}')
        .map(str::to_owned)
        .unwrap_or(text))
}

/// A route in a file's format, and what of it and of the file that it was read from is not in there. Curves only where
/// the format keeps them; messages are not written here.
///
/// # Errors
/// The format cannot hold the kind of its altitudes, or the route is none that a ground station can send.
pub fn write(file: &Path, draft: &Draft) -> Result<(Vec<u8>, Losses), FormatError> {
    let format = Format::of(file)?;
    if draft.is_curved() && !format.keeps_curves() {
        return Err(FormatError::file(
            file,
            "its format has no curves, expected .toml",
        ));
    }
    let refuse = |heights: &str, instead: &str| {
        Err(FormatError::file(
            file,
            format!("the route has {heights}, which its format cannot hold: {instead}"),
        ))
    };
    match (format, draft.datum) {
        (Format::RouteFile | Format::Hex | Format::Pcapng, _) => {}
        (_, Datum::Unstated) => return refuse("no altitude_type", "expected agl or amsl"),
        (_, Datum::Ellipsoid) => {
            return refuse(
                "heights above the ellipsoid",
                "give them above mean sea level",
            );
        }
        (_, Datum::Pressure) => {
            return refuse("pressure altitudes", "give them above mean sea level");
        }
        (Format::Gpx, Datum::Home) => return refuse("heights above home", "give --home-alt"),
        _ => {}
    }
    let mut losses = draft.losses.clone();
    if format != Format::RouteFile {
        lost::route(draft, &mut losses);
    }
    let text = match format {
        Format::RouteFile => {
            let route = draft.to_route(&mut losses)?;
            // What is written can be read again. A mission file may hold a speed that no waypoint can have.
            let sent = route.messages(Id::NULL, Id::NULL);
            sent.map_err(|fault| FormatError::file(file, fault))?;
            lost::rally(draft, &mut losses);
            fence::check(file, &draft.areas)?;
            let fence = fence::to_toml(&draft.areas);
            let gap = if fence.is_empty() { "" } else { "\n" };
            route.to_toml() + gap + &fence
        }
        Format::Plan => qgc_plan::write(draft, &mut losses),
        Format::Waypoints => waypoints::write(draft, &mut losses),
        Format::GeoJson => geojson::write(draft, &mut losses),
        Format::Kml => kml::write(draft, &mut losses),
        Format::Kmz => {
            let kml = kml::write(draft, &mut losses);
            return Ok((kml::pack(file, &kml)?, losses));
        }
        Format::Gpx => gpx::write(draft, &mut losses),
        Format::Csv => table::write(draft, &mut losses),
        Format::Hex | Format::Pcapng => {
            let problem = "messages are written by curve-plan convert";
            return Err(FormatError::file(file, problem));
        }
    };
    Ok((text.into_bytes(), losses))
}

impl Draft {
    /// The route that is sent for it, and what of the file is not in it.
    ///
    /// # Errors
    /// A point is no place on the Earth, or there are more waypoints than numbers.
    pub fn to_send(&self, file: &Path) -> Result<(Route, Losses), FormatError> {
        self.check_positions(file)?;
        let mut losses = self.losses.clone();
        let route = self.to_route(&mut losses)?;
        lost::sent_fence(&self.areas, file, &mut losses);
        lost::rally(self, &mut losses);
        Ok((route, losses))
    }
}
