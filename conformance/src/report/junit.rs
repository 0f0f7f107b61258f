//! `junit.xml`: a test case for each rule, so that a vendor's CI shows them.

use std::fmt::Write;

use super::Report;
use crate::verdict::Verdict;

/// The report as JUnit XML.
#[must_use]
pub fn junit(report: &Report) -> String {
    let count = |wanted: fn(Verdict) -> bool| {
        report
            .rules
            .iter()
            .filter(|rule| wanted(rule.verdict))
            .count()
    };
    let failures = count(Verdict::is_fail);
    let errors = count(|verdict| verdict == Verdict::Inconclusive);
    let skipped = count(|verdict| matches!(verdict, Verdict::NotApplicable | Verdict::Skipped));
    let mut out = String::from("<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n");
    let _ = writeln!(
        out,
        "<testsuite name=\"{} {}\" tests=\"{}\" failures=\"{failures}\" errors=\"{errors}\" skipped=\"{skipped}\" time=\"{:.3}\">",
        escape(report.program.split(' ').next().unwrap_or_default()),
        escape(&report.subject.address),
        report.rules.len(),
        report.duration_s
    );
    for rule in &report.rules {
        let _ = write!(
            out,
            "  <testcase classname=\"{}\" name=\"{} {}\" time=\"{:.3}\"",
            rule.group,
            rule.id,
            escape(&rule.title),
            rule.duration_s
        );
        let reason = escape(&rule.reason);
        let _ = match rule.verdict {
            Verdict::Pass => writeln!(out, "/>"),
            Verdict::Warning => writeln!(
                out,
                "><system-out>warning: {reason}</system-out></testcase>"
            ),
            Verdict::Fail | Verdict::Flaky => writeln!(
                out,
                "><failure message=\"{reason}\" type=\"{}\">{}</failure></testcase>",
                rule.verdict.name(),
                escape(&format!(
                    "{}\nBreaks in the field: {}\nClause: {}",
                    rule.rule, rule.breaks, rule.source
                ))
            ),
            Verdict::Inconclusive => writeln!(
                out,
                "><error message=\"{reason}\" type=\"inconclusive\"/></testcase>"
            ),
            Verdict::NotApplicable | Verdict::Skipped => {
                writeln!(out, "><skipped message=\"{reason}\"/></testcase>")
            }
        };
    }
    out.push_str("</testsuite>\n");
    out
}

/// Escapes text for XML and HTML. Control characters, which neither may contain, become spaces.
#[must_use]
pub fn escape(text: &str) -> String {
    text.chars()
        .fold(String::with_capacity(text.len()), |mut out, character| {
            match character {
                '&' => out.push_str("&amp;"),
                '<' => out.push_str("&lt;"),
                '>' => out.push_str("&gt;"),
                '"' => out.push_str("&quot;"),
                '\n' => out.push('\n'),
                control if control.is_control() => out.push(' '),
                other => out.push(other),
            }
            out
        })
}
