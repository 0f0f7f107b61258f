//! `convert`: a route from one format to another.

use std::path::PathBuf;

use clap::Args;

use crate::failure::Failure;
use crate::formats::{self, Format};
use crate::load::{Densify, Loaded, positions};
use crate::print;

/// Arguments of `convert`.
#[derive(Debug, Args)]
pub(crate) struct Command {
    /// The route.
    input: PathBuf,
    /// Where to write it; curves stay curves in .toml, and become their vertices elsewhere.
    output: PathBuf,
    #[command(flatten)]
    how: Densify,
}

impl Command {
    pub(crate) fn run(&self) -> Result<(), Failure> {
        let loaded = Loaded::read(&self.input)?;
        if Format::of(&self.output)? == Format::Own {
            formats::write_route(&self.output, &loaded.route)?;
        } else {
            let (densified, _) = loaded.densify(&self.how)?;
            formats::write_points(&self.output, &loaded.route.name, &positions(&densified))?;
        }
        if loaded.route.skipped > 0 {
            print(&format!(
                "{} items that name no place were left out\n",
                loaded.route.skipped
            ))?;
        }
        Ok(())
    }
}
