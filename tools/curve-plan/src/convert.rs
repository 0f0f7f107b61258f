//! `convert`: a route from one format to another, or into the messages that a ground station sends.

use std::path::PathBuf;

use clap::Args;

use crate::failure::Failure;
use crate::formats::{self, Addresses, Format};
use crate::load::{Densify, Loaded};
use crate::output::{RequiredOutput, print};

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
}

impl Command {
    pub(crate) fn run(&self) -> Result<(), Failure> {
        let loaded = Loaded::read(&self.input, &self.how)?;
        let written = if Format::of(self.output.path())?.keeps_curves() {
            &loaded.route
        } else {
            let (densified, _) = loaded.densify(&self.how)?;
            &loaded.route.flown(&densified)
        };
        formats::write(self.output.path(), written, &self.addresses)?;
        if loaded.route.skipped > 0 {
            print(&format!(
                "{} items that are no part of the path were left out\n",
                loaded.route.skipped
            ))?;
        }
        Ok(())
    }
}
