//! `dli-check compare`: verdicts of several reports side by side.

use std::path::PathBuf;

use clap::Args;

use crate::outcome::{print, save};
use crate::report::{Report, SCHEMA, matrix};

/// Arguments of `dli-check compare`.
#[derive(Debug, Args)]
pub(super) struct CompareArguments {
    /// Report files (report.json): two runs of one system, or runs of several systems
    #[arg(required = true, num_args = 2..)]
    reports: Vec<PathBuf>,
    /// Write the matrix as a page to this file
    #[arg(long, value_name = "FILE")]
    html: Option<PathBuf>,
}

pub(super) fn compare(arguments: &CompareArguments) -> Result<u8, String> {
    let reports = arguments
        .reports
        .iter()
        .map(|file| {
            let name = file.display();
            let text = std::fs::read_to_string(file).map_err(|error| format!("{name}: {error}"))?;
            let report: Report = serde_json::from_str(&text)
                .map_err(|error| format!("{name}: {error}; expected a report.json of dli-check"))?;
            if report.schema != SCHEMA {
                return Err(format!(
                    "{name}: schema is {:?}, expected {SCHEMA:?}; make the report with this version of dli-check",
                    report.schema
                ));
            }
            Ok(report)
        })
        .collect::<Result<Vec<Report>, String>>()?;
    let files: Vec<String> = arguments
        .reports
        .iter()
        .map(|file| file.display().to_string())
        .collect();
    let names = matrix::names(&reports, &files);
    let rows = matrix::rows(&reports);
    print(matrix::markdown(&names, &rows).trim_end());
    if let Some(file) = &arguments.html {
        save(file, matrix::html(&names, &reports, &rows).as_bytes())?;
    }
    Ok(u8::from(rows.iter().any(matrix::Row::worse)))
}
