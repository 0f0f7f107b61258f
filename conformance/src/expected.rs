//! Expected departures: a TOML file of rules that are known to fail, each with its reason, so that CI is red only when
//! something got worse.

use std::path::Path;

use serde::{Deserialize, Serialize};

use crate::report::{Departure, Report, matches};
use crate::verdict::{Verdict, findings};

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
    /// Part of what the rule finds: another finding of the same rule is not expected.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    finding: Option<String>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    ticket: Option<String>,
    /// `2027-01-31`: after this date the entry no longer counts.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    until: Option<String>,
}

/// Reads the file.
///
/// # Errors
/// It cannot be read or parsed, an entry lacks its reason, or an entry's date has passed; in a sentence.
pub fn read(path: &Path, today: &str) -> Result<Vec<Departure>, String> {
    let name = path.display();
    let text = std::fs::read_to_string(path)
        .map_err(|error| format!("expected departures {name}: {error}"))?;
    let file: File =
        toml::from_str(&text).map_err(|error| format!("expected departures {name}: {error}"))?;
    file.expected
        .into_iter()
        .map(|entry| {
            if entry.finding.as_ref().is_some_and(|finding| finding.trim().is_empty()) {
                return Err(format!("expected departures {name}: the finding of {} is empty; quote a part of what the report says of it, or leave it out", entry.rule));
            }
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
                    finding: entry.finding,
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
            finding: finding_of(&rule.reason),
            ticket: None,
            until: None,
        })
        .collect();
    toml::to_string_pretty(&File { expected }).unwrap_or_default()
}

/// The part of a reason that the next run will repeat: everything before the first number. `None` where there are
/// several kinds of findings without a common part.
fn finding_of(reason: &str) -> Option<String> {
    let mut all = findings(reason);
    let first = all.next()?;
    let end = first
        .find(|letter: char| letter.is_ascii_digit())
        .unwrap_or(first.len());
    let stable = first[..end].trim_end();
    (stable.len() >= 20 && all.next().is_none()).then(|| stable.to_owned())
}

/// Marks which departures occurred and returns those that did not: an entry that is not needed would hide the next
/// fault.
pub fn compare(report: &mut Report) -> Vec<String> {
    for departure in &mut report.expected {
        departure.used = report.rules.iter().any(|rule| departure.covers(rule));
    }
    // An entry about rules that this run did not judge, or whose fail the network may have caused, cannot be called
    // unused.
    let unused = report.expected.iter().filter(|departure| {
        let mut rules = report.rules.iter().filter(|rule| !rule.excused);
        !departure.used && rules.any(|rule| matches(&departure.rule, &rule.id))
    });
    unused
        .map(|departure| {
            let finding = departure.finding.as_ref();
            format!(
                "expected {} of {}{}, which did not occur: remove the entry",
                departure.verdict.name(),
                departure.rule,
                finding.map_or(String::new(), |finding| format!(
                    " with the finding {finding:?}"
                ))
            )
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::report::RuleReport;
    use crate::verdict::also;

    /// A run in which one rule failed for this reason, with this expected departure.
    fn run(reason: &str, finding: Option<&str>) -> (Vec<String>, usize) {
        let mut report = Report {
            expected: vec![Departure {
                rule: "ALERT-001".into(),
                verdict: Verdict::Fail,
                reason: "known".into(),
                finding: finding.map(str::to_owned),
                used: false,
            }],
            rules: vec![RuleReport {
                id: "ALERT-001".into(),
                verdict: Verdict::Fail,
                reason: reason.into(),
                ..RuleReport::default()
            }],
            ..Report::default()
        };
        let unused = compare(&mut report);
        (unused, report.unexpected().len())
    }

    const KNOWN: &str = "expected a new negative id for a new alert; -7 was used before";
    const OTHER: &str = "expected the first message of an alert to have a negative id; got 3";

    #[test]
    fn another_finding_of_an_expected_rule_is_not_expected() {
        let finding = Some("expected a new negative id for a new alert");
        assert_eq!(run(KNOWN, finding), (vec![], 0));
        let (unused, unexpected) = run(OTHER, finding);
        assert_eq!((unused.len(), unexpected), (1, 1));
        // The other finding is not hidden behind the known one either.
        assert_eq!(run(&also(KNOWN, OTHER), finding).1, 1);
        assert_eq!(run(OTHER, None), (vec![], 0));
    }

    #[test]
    fn a_finding_that_is_written_holds_in_the_next_run() {
        let finding = finding_of(KNOWN);
        assert_eq!(
            finding.as_deref(),
            Some("expected a new negative id for a new alert; -")
        );
        assert_eq!(
            run(&KNOWN.replace("-7", "-81"), finding.as_deref()),
            (vec![], 0)
        );
        assert_eq!(finding_of(&also(KNOWN, OTHER)), None);
    }
}
