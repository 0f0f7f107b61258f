//! What the commands that read a route share: its arguments, its legs, its vertices.

use std::path::{Path, PathBuf};

use clap::Args;
use cucs::formats::{self, Draft, Import};
use curve_paths::{BudgetError, Densified, Leg, Options, Vertices, densify, densify_to_budget};

use crate::failure::Failure;

/// How to densify, on the command line.
#[derive(Clone, Debug, Args)]
pub(crate) struct Densify {
    /// Stay within this deviation both ways, in three dimensions, rounding included, m.
    #[arg(
        long,
        value_name = "M",
        default_value_t = 1.0,
        allow_negative_numbers = true
    )]
    pub(crate) tolerance: f64,
    /// Use at most this many items, by the smallest tolerance that allows it, never below --tolerance.
    #[arg(long, value_name = "N")]
    pub(crate) max_items: Option<usize>,
    /// Let vertices leave the curve by up to the tolerance: about 30 % fewer.
    #[arg(long)]
    pub(crate) free: bool,
    /// Keep chords between vertices of a curved leg at least this long, m.
    #[arg(
        long,
        value_name = "M",
        default_value_t = 4.0,
        allow_negative_numbers = true
    )]
    pub(crate) min_chord: f64,
    #[command(flatten)]
    pub(crate) import: Import,
}

/// A route from a file, with its legs.
pub(crate) struct Loaded {
    pub(crate) file: PathBuf,
    pub(crate) route: Draft,
    pub(crate) legs: Vec<Leg>,
    /// The value of --home-alt.
    pub(crate) home_alt_m: Option<f64>,
}

impl Loaded {
    /// Reads a route and checks its legs.
    pub(crate) fn read(file: &Path, how: &Densify) -> Result<Self, Failure> {
        let route = formats::read(file, &how.import)?;
        let legs = route.legs(file)?;
        Ok(Self {
            file: file.to_owned(),
            route,
            legs,
            home_alt_m: how.import.home_alt,
        })
    }

    /// The speed on each leg, m/s: that of the file, where it names none that of the leg before, and `first_mps` before any.
    pub(crate) fn speeds(&self, first_mps: f64) -> Vec<f64> {
        let named = |point: usize| {
            // The last leg of a closed route leads to the first point again, without a speed.
            let speed = self.route.points.get(point)?.conduct.speed_m_s;
            speed.filter(|speed_mps| *speed_mps > 0.0)
        };
        let mut speed_mps = named(0).unwrap_or(first_mps);
        let legs = 0..self.legs.len();
        legs.map(|leg| {
            speed_mps = named(leg + 1).unwrap_or(speed_mps);
            speed_mps
        })
        .collect()
    }

    /// Reports what of the file the route does not have.
    pub(crate) fn report_losses(&self, how: &Densify) -> Result<(), Failure> {
        let file = self.file.display().to_string();
        Ok(self.route.losses.report(&file, how.import.strict)?)
    }

    /// Densifies it; returns the vertices and their tolerance.
    pub(crate) fn densify(&self, how: &Densify) -> Result<(Densified, f64), Failure> {
        if !(0.0..=1_000.0).contains(&how.min_chord) {
            return Err(Failure::Usage(format!(
                "--min-chord is {}, expected 0 to 1000 m",
                how.min_chord
            )));
        }
        let vertices = if how.free {
            Vertices::Free
        } else {
            Vertices::OnCurve
        };
        let options = Options {
            min_chord_m: how.min_chord,
            vertices,
            ..Options::flight(how.tolerance)
        };
        match how.max_items {
            Some(max) => densify_to_budget(&self.legs, max, &options)
                .map(|found| (found.densified, found.tolerance_m))
                .map_err(|fault| match fault {
                    BudgetError::Densify(fault) => {
                        Failure::densify(&self.file, how.tolerance, fault)
                    }
                    fault @ BudgetError::TooFew { .. } => Failure::answer(&self.file, fault),
                }),
            None => densify(&self.legs, &options)
                .map(|densified| (densified, how.tolerance))
                .map_err(|fault| Failure::densify(&self.file, how.tolerance, fault)),
        }
    }
}
