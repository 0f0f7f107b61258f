//! `fit`: a recorded or drawn track as the fewest cubic legs within a tolerance.

use std::path::PathBuf;

use clap::Args;
use cucs::formats::{self, Level, Output, Selection};
use curve_paths::Position;
use curve_paths::fit::{Continuity, FitOptions, Track, fit};
use serde_json::json;

use crate::failure::Failure;
use crate::messages::Addresses;
use crate::output::{print, progress, write};
use crate::route::{ground_points, of_fit};

/// Arguments of `fit`.
#[derive(Debug, Args)]
pub(crate) struct Command {
    /// Read this track.
    file: PathBuf,
    #[command(flatten)]
    output: Output,
    #[command(flatten)]
    addresses: Addresses,
    /// Stay within this deviation both ways on the ground, m.
    #[arg(
        long,
        value_name = "M",
        default_value_t = 1.0,
        allow_negative_numbers = true
    )]
    tolerance: f64,
    #[command(flatten)]
    selection: Selection,
    /// Keep only the fixes from this one, counted from 0 after --every.
    #[arg(long, default_value_t = 0)]
    from: usize,
    /// Keep only the fixes up to this one, itself included.
    #[arg(long)]
    to: Option<usize>,
    /// Close the track: it returns to its first fix.
    #[arg(long)]
    closed: bool,
    /// Let legs also share their direction where they meet.
    #[arg(long)]
    g1: bool,
    /// Keep a fix as a corner where the track turns by more than this, degrees.
    #[arg(long, value_name = "DEG", allow_negative_numbers = true)]
    corner: Option<f64>,
    #[command(flatten)]
    level: Level,
    /// Fit and write nothing where something of the file cannot be taken.
    #[arg(long)]
    strict: bool,
    /// Print JSON.
    #[arg(long)]
    json: bool,
}

impl Command {
    pub(crate) fn run(&self) -> Result<(), Failure> {
        let mut read = formats::read_track(&self.file, &self.selection)?;
        read.lost_beside_places()
            .report(&self.file.display().to_string(), self.strict)?;
        let closed = self.closed || read.closed;
        let last = self.to.unwrap_or(usize::MAX);
        let fixes = std::mem::take(&mut read.points).into_iter().enumerate();
        read.points = fixes
            .filter(|(k, _)| (self.from..=last).contains(k))
            .map(|(_, w)| w)
            .collect();
        // A fit is made on the ground, but a flight needs altitudes.
        let terrain = self.level.terrain()?;
        let gaps = read.without_altitude();
        if self.output.path().is_some() {
            read.level(&self.level, terrain.as_ref(), &self.file)?;
        }
        let fixes = read.positions();
        let track = Track::new(&fixes, closed).map_err(|e| Failure::file(&self.file, e))?;
        let continuity = if self.g1 {
            Continuity::G1
        } else {
            Continuity::G0
        };
        let options = FitOptions {
            tolerance_m: self.tolerance,
            continuity,
            corner_deg: self.corner,
        };
        let fitted =
            fit(&track, &options, &mut progress()).map_err(|e| Failure::fit(&self.file, e))?;
        if let Some(output) = self.output.path() {
            let route = of_fit(&read.name, &fitted, closed, read.datum);
            if let Some(terrain) = &terrain {
                // Between joints a leg climbs evenly, whatever the ground does there, so its clearance is checked.
                route.above_ground(terrain, &self.file)?;
            }
            write(&self.file, output, &route, &self.addresses, self.strict)?;
        }
        let (legs, deviation_m) = (fitted.legs.len(), fitted.deviation_m);
        // Where some fixes have no altitude there is nothing to compare with.
        let apart = read.without_altitude().is_none();
        let apart = apart.then(|| altitudes_apart(track.fixes(), &fitted.joints));
        if self.json {
            let report = json!({
                "fixes": track.fixes().len(), "tolerance_m": self.tolerance, "deviation_m": deviation_m,
                "joints": fitted.joints, "legs": ground_points(&fitted),
                "without_altitude": gaps.map_or(0, |(count, _)| count),
                "altitude_deviation_m": apart.map(|(_, apart_m)| apart_m),
            });
            return print(&format!("{report}\n"));
        }
        let fixes = track.fixes().len();
        let mut text = format!(
            "{fixes} fixes, {legs} cubic legs, {deviation_m:.3} m off at most, both ways\n"
        );
        if let Some((count, first)) = gaps {
            text += &format!(
                "no altitude at {count} fixes, the first is fix {first}: a route of it needs --altitude or --height\n"
            );
        }
        if let Some((fix, apart_m)) = apart
            && apart_m > self.tolerance
        {
            text += &format!(
                "altitudes: each leg climbs evenly, {apart_m:.1} m off the track's at most, at fix {fix}\n"
            );
        }
        print(&text)
    }
}

/// How far the altitudes of the fixes differ from an even climb between the joints around them: the worst fix, and m.
fn altitudes_apart(fixes: &[Position], joints: &[usize]) -> (usize, f64) {
    let mut worst = (0, 0.0);
    let n = fixes.len();
    for pair in joints.windows(2) {
        // The last leg of a closed track passes over its first fix.
        let last = if pair[1] > pair[0] {
            pair[1]
        } else {
            pair[1] + n
        };
        let along: Vec<f64> = (pair[0]..last)
            .scan(0.0, |so_far, k| {
                *so_far += fixes[k % n]
                    .ground()
                    .distance_m(fixes[(k + 1) % n].ground());
                Some(*so_far)
            })
            .collect();
        let (from_m, to_m) = (fixes[pair[0]].alt_m, fixes[last % n].alt_m);
        let length_m = along.last().copied().unwrap_or(0.0).max(f64::MIN_POSITIVE);
        for (k, at_m) in (pair[0] + 1..last).zip(&along) {
            let even_m = from_m + (to_m - from_m) * at_m / length_m;
            let apart_m = (fixes[k % n].alt_m - even_m).abs();
            if apart_m > worst.1 {
                worst = (k % n, apart_m);
            }
        }
    }
    worst
}
