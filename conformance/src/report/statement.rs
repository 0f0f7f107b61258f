//! `statement.md`: what was judged and how it ended, with hashes, for a signature.

use std::fmt::Write;

use super::{Report, utc};
use crate::verdict::Verdict;

/// The statement.
#[must_use]
pub fn statement(report: &Report) -> String {
    let mut out = String::from("# Statement of conformance test\n\n");
    let subject = &report.subject;
    let rows = [
        (
            "Subject",
            format!("{} {} ({})", subject.name, subject.version, subject.role),
        ),
        ("Address", subject.address.clone()),
        ("Edition judged", subject.edition.clone()),
        ("Vehicles", subject.vehicles.join(", ")),
        ("Program", report.program.clone()),
        (
            "Catalogue",
            format!("{} of {}", report.catalogue.version, report.catalogue.date),
        ),
        ("Began", utc(report.started)),
        ("Took", format!("{:.0} s", report.duration_s)),
    ];
    out.push_str("| | |\n|---|---|\n");
    for (name, value) in rows.iter().filter(|(_, value)| !value.is_empty()) {
        let _ = writeln!(out, "| {name} | {value} |");
    }
    for (name, hash) in &report.hashes {
        let _ = writeln!(out, "| SHA-256 of {name} | `{hash}` |");
    }
    out.push_str("\n| verdict | rules |\n|---|---|\n");
    for verdict in Verdict::ALL {
        let _ = writeln!(
            out,
            "| {} | {} |",
            verdict.name(),
            report.counts.get(verdict.name()).unwrap_or(&0)
        );
    }
    out.push_str("\n## Rules that fail\n\n");
    let mut any = false;
    for rule in report.rules.iter().filter(|rule| rule.verdict.is_fail()) {
        any = true;
        let firm = if rule.firm || subject.edition.is_empty() {
            "firm"
        } else {
            "carried over from another edition"
        };
        let _ = writeln!(
            out,
            "- **{}** {} ({firm}): {}",
            rule.id, rule.title, rule.reason
        );
    }
    let open: Vec<_> = (report.rules.iter())
        .filter(|rule| rule.verdict == Verdict::Inconclusive)
        .collect();
    match (any, open.is_empty()) {
        (true, _) => {}
        (false, true) => out.push_str("None.\n"),
        (false, false) => {
            let _ = writeln!(
                out,
                "None of those that were judged; {} could not be judged, as named below.",
                open.len()
            );
        }
    }
    if !open.is_empty() {
        out.push_str("\n## Rules that could not be judged\n\n");
    }
    for rule in open {
        let _ = writeln!(out, "- **{}** {}: {}", rule.id, rule.title, rule.reason);
    }
    if !report.remarks.is_empty() {
        out.push_str("\n## Remarks\n\n");
        for remark in &report.remarks {
            let _ = writeln!(out, "- {remark}");
        }
    }
    out.push_str("\nThis is no certificate.");
    if !subject.edition.is_empty() {
        out.push_str(
            " Rules for Editions 3 and 4 that are not firm rest on secondary sources, which `dli-check explain RULE` names.",
        );
    }
    out.push_str("\n\nDate, name, signature:\n\n______________________________\n");
    out
}
