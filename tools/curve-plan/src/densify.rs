//! `densify`: the straight legs by which a curved route is flown.

use std::path::PathBuf;

use clap::Args;
use cucs::formats::Output;
use serde_json::json;

use crate::failure::Failure;
use crate::load::{Densify, Loaded};
use crate::messages::Addresses;
use crate::output::{print, write};
use crate::route::flown;

/// Arguments of `densify`.
#[derive(Debug, Args)]
pub(crate) struct Command {
    /// Read this route.
    file: PathBuf,
    #[command(flatten)]
    output: Output,
    #[command(flatten)]
    how: Densify,
    #[command(flatten)]
    addresses: Addresses,
    /// Print JSON, vertices included.
    #[arg(long)]
    json: bool,
}

impl Command {
    pub(crate) fn run(&self) -> Result<(), Failure> {
        let loaded = Loaded::read(&self.file, &self.how)?;
        let (densified, tolerance_m) = loaded.densify(&self.how)?;
        let flown = flown(&loaded.route, &densified);
        let losses = match self.output.path() {
            Some(output) => write(
                &self.file,
                output,
                &flown,
                &self.addresses,
                self.how.import.strict,
            )?,
            None => {
                loaded.report_losses(&self.how)?;
                flown.losses
            }
        };
        let items = densified.vertices.len();
        // Without a chord between vertices the crate returns infinity, for which JSON has no number.
        let shortest = Some(densified.shortest_chord_m).filter(|s| s.is_finite());
        if self.json {
            let vertices: Vec<_> = densified
                .vertices
                .iter()
                .map(|v| json!({ "lat_deg": v.position.lat_deg, "lon_deg": v.position.lon_deg, "alt_m": v.position.alt_m, "leg": v.leg, "t": v.t }))
                .collect();
            let report = json!({
                "legs": loaded.legs.len(), "items": items, "tolerance_m": tolerance_m,
                "bound_m": densified.bound_m, "shortest_chord_m": shortest, "vertices": vertices,
                "losses": losses.to_json(),
            });
            return print(&format!("{report}\n"));
        }
        print(&format!(
            "{} legs, {} items at a tolerance of {tolerance_m:.3} m; proven within {:.3} m; shortest chord {}\n",
            loaded.legs.len(),
            items,
            densified.bound_m,
            shortest.map_or_else(|| "none".to_owned(), |s| format!("{s:.1} m")),
        ))
    }
}
