//! `compare`: the fewest straight legs against the fewest cubic ones for a recorded track.
//!
//! Straight legs have their vertices on the fixes, and a closed track is flown from its first fix; cubic legs meet in
//! place (G0), start on whichever fixes save a leg, and are measured both ways against the polyline of the fixes.

use std::fmt::Write;
use std::path::{Path, PathBuf};

use clap::Args;
use cucs::formats::{self, Selection};
use curve_paths::fit::{Continuity, FitOptions, Start, Track, fit, straighten};
use curve_paths::{Leg, Options, Position, densify};
use serde::Serialize;

use crate::failure::Failure;
use crate::output::{print, progress};
use crate::route::ground_points;

/// Arguments of `compare`.
#[derive(Debug, Args)]
pub(crate) struct Compare {
    /// Read this track.
    file: PathBuf,
    #[command(flatten)]
    selection: Selection,
    /// Close the track: it returns to its first fix.
    #[arg(long)]
    closed: bool,
    /// Stay within this deviation both ways, m; may be given several times.
    #[arg(
        long = "tolerance",
        value_name = "M",
        required = true,
        allow_negative_numbers = true
    )]
    tolerances: Vec<f64>,
    /// Print JSON.
    #[arg(long)]
    json: bool,
}

/// The figures of one tolerance.
#[derive(Debug, Serialize)]
struct Row {
    tolerance_m: f64,
    straight: usize,
    cubic: usize,
    octets_straight: usize,
    octets_cubic: usize,
    deviation_m: f64,
    legs: Vec<[[f64; 2]; 4]>,
    #[serde(skip)]
    flown: usize,
    #[serde(skip)]
    straight_any_start: usize,
}

impl Compare {
    pub(crate) fn run(&self) -> Result<(), Failure> {
        let route = formats::read_track(&self.file, &self.selection)?;
        route
            .losses
            .report(&self.file.display().to_string(), false)?;
        let fixes: Vec<Position> = route.points.iter().map(|w| w.position).collect();
        let track = Track::new(&fixes, self.closed).map_err(|e| Failure::file(&self.file, e))?;
        let rows = self
            .tolerances
            .iter()
            .map(|&t| row(&self.file, &track, t))
            .collect::<Result<Vec<_>, _>>()?;
        if self.json {
            let text = serde_json::to_string(&rows).map_err(|e| Failure::Answer(e.to_string()))?;
            return print(&(text + "\n"));
        }
        print(&table(&rows, track.fixes().len()))
    }
}

fn row(file: &Path, track: &Track, tolerance_m: f64) -> Result<Row, Failure> {
    let unfitted = |fault| Failure::fit(file, fault);
    let straight = straighten(track, tolerance_m, Start::First)
        .map_err(unfitted)?
        .legs();
    let straight_any_start = straighten(track, tolerance_m, Start::Any)
        .map_err(unfitted)?
        .legs();
    let options = FitOptions {
        tolerance_m,
        continuity: Continuity::G0,
        corner_deg: None,
    };
    let fitted = fit(track, &options, &mut progress()).map_err(unfitted)?;
    let cubic = fitted.legs.len();
    let legs: Vec<Leg> = fitted.legs.iter().map(|&leg| leg.into()).collect();
    let dense = densify(&legs, &Options::geometry(tolerance_m))
        .map_err(|fault| Failure::densify(file, tolerance_m, fault))?;
    // An open route has one waypoint more than it has legs.
    let open = usize::from(!track.is_closed());
    Ok(Row {
        tolerance_m,
        straight,
        cubic,
        octets_straight: (straight + open) * WAYPOINT_BYTES,
        octets_cubic: (cubic + open) * WAYPOINT_BYTES + cubic * CURVE_BYTES,
        deviation_m: fitted.deviation_m,
        legs: ground_points(&fitted),
        flown: dense.vertices.len() - 1 + open,
        straight_any_start,
    })
}

fn table(rows: &[Row], fixes: usize) -> String {
    let mut out = format!(
        "{fixes} fixes\ntolerance m  straight (best start)  cubic  deviation m  DLI bytes straight / cubic  items flown\n"
    );
    for r in rows {
        let straight = format!("{} ({})", r.straight, r.straight_any_start);
        let bytes = format!("{} / {}", r.octets_straight, r.octets_cubic);
        let _ = writeln!(
            out,
            "{:>11}  {straight:>21}  {:>5}  {:>11.3}  {bytes:>27}  {:>11}",
            r.tolerance_m, r.cubic, r.deviation_m, r.flown
        );
    }
    out + "What curves save is messages and handles to edit. The items flown hardly change: the aircraft flies the\n\
           cubic legs as that many straight ones.\n"
}

/// A 13002 with all its fields: wrapper 16, presence vector 3, fields 40; no checksum.
const WAYPOINT_BYTES: usize = 59;
/// A 50002 with all its fields: wrapper 16, presence vector 2, fields 35; no checksum.
const CURVE_BYTES: usize = 53;
