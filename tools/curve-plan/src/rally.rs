//! `rally`: the rally points of a file as `[[vehicle.rally]]` tables, which a VSM uploads to the vehicle. The DLI has
//! no message for them.

use std::fmt::Write as _;
use std::path::PathBuf;

use clap::Args;
use cucs::formats::{self, Output};

use crate::failure::Failure;
use crate::output::{print, save};

/// Arguments of `rally`.
#[derive(Debug, Args)]
#[command(mut_arg("written", |to| to.help("Write to this file, which is replaced (default: standard output)")))]
pub(crate) struct Command {
    /// Read the rally points of this .plan of QGroundControl.
    input: PathBuf,
    #[command(flatten)]
    output: Output,
}

impl Command {
    pub(crate) fn run(&self) -> Result<(), Failure> {
        let mut text = String::new();
        for point in formats::read_rally(&self.input)? {
            // QGroundControl has their heights above home, and sends them as such.
            let _ = writeln!(
                text,
                "[[vehicle.rally]]\nplace = [{:?}, {:?}]\nheight_m = {:?}",
                point.lat_deg, point.lon_deg, point.alt_m
            );
        }
        match self.output.path() {
            Some(file) => save(file, text.as_bytes()),
            None => print(&text),
        }
    }
}
