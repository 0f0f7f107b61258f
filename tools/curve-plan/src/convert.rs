//! `convert`: a route from one format to another, or into the messages that a ground station sends.

use std::path::PathBuf;

use clap::Args;
use cucs::formats::Format;
use curve_paths::Vertex;
use serde_json::json;

use crate::failure::Failure;
use crate::load::{Densify, Loaded};
use crate::messages::Addresses;
use crate::output::{RequiredOutput, print, write};
use crate::route::flown;

/// Arguments of `convert`.
#[derive(Debug, Args)]
#[command(mut_arg("written", |to| to.help("Write to this file; curves stay curves in .toml, .hex and .pcapng, and become their vertices elsewhere")))]
pub(crate) struct Command {
    /// Read this route.
    input: PathBuf,
    #[command(flatten)]
    output: RequiredOutput,
    #[command(flatten)]
    how: Densify,
    #[command(flatten)]
    addresses: Addresses,
    /// Print JSON: what was lost of the route.
    #[arg(long)]
    json: bool,
}

impl Command {
    pub(crate) fn run(&self) -> Result<(), Failure> {
        let loaded = Loaded::read(&self.input, &self.how)?;
        let written = if Format::of(self.output.path())?.keeps_curves() || !loaded.route.is_curved()
        {
            loaded.route
        } else {
            let (densified, _) = loaded.densify(&self.how)?;
            let mut flown = flown(&loaded.route, &densified);
            for (k, point) in loaded.route.points.iter().enumerate() {
                if point.curve.is_some() {
                    let within = |v: &&Vertex| v.leg == k && v.t > 0.0;
                    let legs = densified.vertices.iter().filter(within).count();
                    let what = format!("curve of the leg from it ({legs} straight legs instead)");
                    flown.losses.add(point.item, what);
                }
            }
            flown
        };
        let strict = self.how.import.strict;
        let losses = write(
            &self.input,
            self.output.path(),
            &written,
            &self.addresses,
            strict,
        )?;
        if self.json {
            let report = json!({ "written": self.output.path().display().to_string(), "losses": losses.to_json() });
            print(&format!("{report}\n"))?;
        }
        Ok(())
    }
}
