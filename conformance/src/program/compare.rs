//! `dli-check compare`: verdicts of several reports side by side.

use std::path::PathBuf;

use crate::outcome::print;
use crate::report::Report;

pub(super) fn compare(files: &[PathBuf]) -> Result<u8, String> {
    let reports = files
        .iter()
        .map(|file| {
            let text = std::fs::read_to_string(file)
                .map_err(|error| format!("{}: {error}", file.display()))?;
            serde_json::from_str(&text).map_err(|error| {
                format!(
                    "{}: {error}; expected a report.json of dli-check",
                    file.display()
                )
            })
        })
        .collect::<Result<Vec<Report>, String>>()?;
    let mut ids: Vec<&str> = reports
        .iter()
        .flat_map(|report| report.rules.iter().map(|rule| rule.id.as_str()))
        .collect();
    ids.sort_unstable();
    ids.dedup();
    let header: Vec<String> = reports
        .iter()
        .zip(files)
        .map(|(report, file)| {
            if report.subject.name.is_empty() {
                file.display().to_string()
            } else {
                report.subject.name.clone()
            }
        })
        .collect();
    print(&format!("| rule | {} |", header.join(" | ")));
    print(&format!("|---{}|", "|---".repeat(reports.len())));
    let mut worse = false;
    for id in ids {
        let verdicts: Vec<_> = reports
            .iter()
            .map(|report| {
                report
                    .rules
                    .iter()
                    .find(|rule| rule.id == id)
                    .map(|rule| rule.verdict)
            })
            .collect();
        let same = verdicts.windows(2).all(|pair| pair[0] == pair[1]);
        let names: Vec<&str> = verdicts
            .iter()
            .map(|verdict| verdict.map_or("-", |verdict| verdict.name()))
            .collect();
        print(&format!(
            "| {}{id} | {} |",
            if same { "" } else { "* " },
            names.join(" | ")
        ));
        let fails: Vec<bool> = verdicts
            .iter()
            .map(|verdict| verdict.is_some_and(|verdict| verdict.is_fail()))
            .collect();
        worse |= fails.windows(2).any(|pair| !pair[0] && pair[1]);
    }
    Ok(u8::from(worse))
}
