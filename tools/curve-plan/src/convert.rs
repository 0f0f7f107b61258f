//! `convert`: a route from one format to another, or into the messages that a ground station sends.

use std::path::PathBuf;

use clap::Args;

use crate::failure::Failure;
use crate::formats::{self, Addresses, Format};
use crate::load::{Densify, Loaded};
use crate::output::print;

/// Arguments of `convert`.
#[derive(Debug, Args)]
pub(crate) struct Command {
    /// Read this route.
    input: PathBuf,
    /// Write it to this file; curves stay curves in .toml, .hex and .pcapng, and become their vertices elsewhere.
    output: PathBuf,
    #[command(flatten)]
    how: Densify,
    #[command(flatten)]
    addresses: Addresses,
}

impl Command {
    pub(crate) fn run(&self) -> Result<(), Failure> {
        let loaded = Loaded::read(&self.input, &self.how)?;
        let written = if Format::of(&self.output)?.keeps_curves() {
            &loaded.route
        } else {
            let (densified, _) = loaded.densify(&self.how)?;
            &loaded.route.flown(&densified)
        };
        formats::write(&self.output, written, &self.addresses)?;
        if loaded.route.skipped > 0 {
            print(&format!(
                "{} items that are no part of the path were left out\n",
                loaded.route.skipped
            ))?;
        }
        Ok(())
    }
}
