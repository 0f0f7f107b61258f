//! `fit`: a recorded or drawn track as the fewest cubic legs within a tolerance.

use std::path::PathBuf;

use clap::Args;
use cucs::formats::{self, Level, Selection};
use curve_paths::fit::{Continuity, FitOptions, Track, fit};
use serde_json::json;

use crate::failure::Failure;
use crate::messages::Addresses;
use crate::output::{Output, print, progress, write};
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
    #[arg(long, value_name = "M", default_value_t = 1.0)]
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
    #[arg(long, value_name = "DEG")]
    corner: Option<f64>,
    #[command(flatten)]
    level: Level,
    /// Print JSON.
    #[arg(long)]
    json: bool,
}

impl Command {
    pub(crate) fn run(&self) -> Result<(), Failure> {
        let mut read = formats::read_track(&self.file, &self.selection)?;
        read.losses
            .report(&self.file.display().to_string(), false)?;
        let closed = self.closed || read.closed;
        let last = self.to.unwrap_or(usize::MAX);
        let fixes = std::mem::take(&mut read.points).into_iter().enumerate();
        read.points = fixes
            .filter(|(k, _)| (self.from..=last).contains(k))
            .map(|(_, w)| w)
            .collect();
        // A fit is made on the ground; what is flown needs altitudes.
        if self.output.path().is_some() {
            read.level(self.level, &self.file)?;
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
            fit(&track, &options, &mut progress()).map_err(|e| Failure::answer(&self.file, e))?;
        if let Some(output) = self.output.path() {
            let route = of_fit(&read.name, &fitted, closed, read.datum);
            write(output, &route, &self.addresses, false)?;
        }
        let (legs, deviation_m) = (fitted.legs.len(), fitted.deviation_m);
        if self.json {
            let report = json!({
                "fixes": track.fixes().len(), "tolerance_m": self.tolerance, "deviation_m": deviation_m,
                "joints": fitted.joints, "legs": ground_points(&fitted),
            });
            return print(&format!("{report}\n"));
        }
        print(&format!(
            "{} fixes, {legs} cubic legs, {deviation_m:.3} m off at most, both ways\n",
            track.fixes().len()
        ))
    }
}
