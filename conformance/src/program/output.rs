//! What the subcommands share: where a report goes, the profile of a file, ids of rules.

use std::path::{Path, PathBuf};

use clap::Args;

use crate::bench::net::Datagram;
use crate::expected;
use crate::outcome::{Files, finish, today};
use crate::profile::Profile;
use crate::report::{Departure, Report};

/// Where a report goes, and what of it is expected.
#[derive(Clone, Debug, Args)]
pub(super) struct Outputs {
    /// Departures that are expected, each with its reason (TOML)
    #[arg(long, value_name = "FILE")]
    expected: Option<PathBuf>,
    /// Write the fails of this run as expected departures
    #[arg(long, value_name = "FILE")]
    write_expected: Option<PathBuf>,
    /// Write a JUnit file
    #[arg(long, value_name = "FILE")]
    junit: Option<PathBuf>,
    /// Write report.json, report.html, junit.xml, run.pcapng and statement.md into this folder
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Write report.json to this file
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
    /// Write report.html to this file, with the evidence of fails and warnings only: small enough for documents
    #[arg(long, value_name = "FILE")]
    html: Option<PathBuf>,
}

impl Outputs {
    /// Checks the expected departures before anything is sent.
    pub(super) fn read_expected(&self) -> Result<Vec<Departure>, String> {
        match &self.expected {
            Some(file) => expected::read(file, &today()),
            None => Ok(Vec::new()),
        }
    }

    /// Compares with what is expected, sums up and writes; the exit status.
    pub(super) fn finish(
        &self,
        mut report: Report,
        expected: Vec<Departure>,
        datagrams: &[Datagram],
    ) -> Result<u8, String> {
        report.expected = expected;
        report.count();
        let status = finish(&mut report);
        let files = Files {
            json: self.json.as_deref(),
            junit: self.junit.as_deref(),
            html: self.html.as_deref(),
            expected: self.write_expected.as_deref(),
            folder: self.out.as_deref(),
        };
        files.write(&report, datagrams)?;
        Ok(status)
    }
}

/// The profile of a file, or the default.
pub(super) fn profile(file: Option<&Path>) -> Result<Profile, String> {
    match file {
        Some(file) => Profile::read(file).map_err(|error| error.to_string()),
        None => Ok(Profile::default()),
    }
}

/// Rule ids as the catalogue has them.
pub(super) fn rule_ids(
    given: &[String],
    catalogue: &crate::catalogue::Catalogue,
) -> Result<Vec<String>, String> {
    let rules: Vec<String> = given.iter().map(|id| id.to_uppercase()).collect();
    match rules.iter().find(|id| catalogue.find(id).is_none()) {
        Some(unknown) => Err(format!("no rule {unknown:?}; `dli-check list` shows all")),
        None => Ok(rules),
    }
}
