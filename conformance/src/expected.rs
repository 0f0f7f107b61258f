//! Expected departures: a TOML file of rules that are known to fail, each with its reason, so that CI is red only when
//! something got worse.

use std::path::Path;

use serde::{Deserialize, Serialize};

use crate::report::{Departure, Report, matches};
use crate::verdict::Verdict;

/// The file.
#[derive(Clone, Debug, Default, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
struct File {
    #[serde(default)]
    expected: Vec<Entry>,
}

#[derive(Clone, Debug, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
struct Entry {
    rule: String,
    verdict: Verdict,
    reason: String,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    ticket: Option<String>,
    /// `2027-01-31`, after which it counts no more.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    until: Option<String>,
}

/// Reads the file.
///
/// # Errors
/// It cannot be read, is no such file, lacks a reason, or has an entry that is over; in a sentence.
pub fn read(path: &Path, today: &str) -> Result<Vec<Departure>, String> {
    let name = path.display();
    let text = std::fs::read_to_string(path)
        .map_err(|error| format!("expected departures {name}: {error}"))?;
    let file: File =
        toml::from_str(&text).map_err(|error| format!("expected departures {name}: {error}"))?;
    file.expected
        .into_iter()
        .map(|entry| {
            if entry.reason.trim().is_empty() {
                return Err(format!("expected departures {name}: {} has no reason; state why it is expected", entry.rule));
            }
            match entry.until {
                Some(until) if until.as_str() < today => Err(format!(
                    "expected departures {name}: {} counted until {until}; mend the subject or renew the entry",
                    entry.rule
                )),
                _ => Ok(Departure {
                    rule: entry.rule,
                    verdict: entry.verdict,
                    reason: entry.reason,
                    used: false,
                }),
            }
        })
        .collect()
}

/// Writes the file that makes the fails of a run expected.
#[must_use]
pub fn from_run(report: &Report) -> String {
    let expected = report
        .rules
        .iter()
        .filter(|rule| rule.verdict.is_fail())
        .map(|rule| Entry {
            rule: rule.id.clone(),
            verdict: rule.verdict,
            reason: rule.reason.clone(),
            ticket: None,
            until: None,
        })
        .collect();
    toml::to_string_pretty(&File { expected }).unwrap_or_default()
}

/// Notes which departures occurred; those that did not are returned, because an entry that is not needed hides the next
/// fault.
pub fn compare(report: &mut Report) -> Vec<String> {
    for departure in &mut report.expected {
        departure.used = report.rules.iter().any(|rule| {
            matches(&departure.rule, &rule.id)
                && (rule.verdict == departure.verdict
                    || rule.verdict.is_fail() && departure.verdict.is_fail())
        });
    }
    // An entry about rules that this run was not asked to judge is not its matter.
    let unused = report.expected.iter().filter(|departure| {
        !departure.used && (report.rules.iter()).any(|rule| matches(&departure.rule, &rule.id))
    });
    unused
        .map(|departure| {
            format!(
                "expected {} of {}, which did not occur: remove the entry",
                departure.verdict.name(),
                departure.rule
            )
        })
        .collect()
}
