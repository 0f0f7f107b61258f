//! The result of a run: one model, from which every form of report is made.
//!
//! `report.json` is the model itself; [`html`], [`junit`], [`statement`] and [`capture`] read nothing else but the
//! recording.

pub mod capture;
pub mod html;
pub mod junit;
pub mod statement;

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};
use serde_json::Value;

use crate::catalogue::{Release, Rule};
use crate::verdict::Verdict;

/// Version of the form of `report.json`.
pub const SCHEMA: &str = "1";

/// The suite of `dli-check`, as reports name it.
pub const DLI: &str = "DLI conformance";

/// A run.
#[derive(Clone, Debug, Default, Deserialize, Serialize)]
pub struct Report {
    /// Version of this form.
    pub schema: String,
    /// Which suite, for headings.
    #[serde(default)]
    pub suite: String,
    /// Which program made it.
    pub program: String,
    /// The catalogue.
    pub catalogue: Release,
    /// Who was judged.
    pub subject: Subject,
    /// When the run began, seconds since 1970.
    pub started: u64,
    /// How long it took.
    pub duration_s: f64,
    /// Whether a broken "should" is a fail.
    pub strict: bool,
    /// Profile as it was used, TOML.
    pub profile: String,
    /// SHA-256 of profile, catalogue and recording.
    pub hashes: BTreeMap<String, String>,
    /// What the run as a whole has to say: network loss, an occupied vehicle, an interruption.
    pub remarks: Vec<String>,
    /// How many rules have which verdict.
    pub counts: BTreeMap<String, usize>,
    /// Expected departures, where a file names them.
    pub expected: Vec<Departure>,
    /// The rules, in the order of the catalogue.
    pub rules: Vec<RuleReport>,
}

/// Who was judged.
#[derive(Clone, Debug, Default, Deserialize, Serialize)]
pub struct Subject {
    /// "vsm", "cucs" or "capture".
    pub role: String,
    /// From the profile.
    pub name: String,
    /// From the profile.
    pub version: String,
    /// Where it was.
    pub address: String,
    /// Edition of the interface.
    pub edition: String,
    /// Ids of vehicles.
    pub vehicles: Vec<String>,
    /// CUCS ids that it knows, with LOI Authorised.
    pub cucs: Vec<String>,
}

/// A rule with its verdict.
#[derive(Clone, Debug, Default, Deserialize, Serialize)]
pub struct RuleReport {
    /// Id.
    pub id: String,
    /// Group.
    pub group: String,
    /// Title.
    pub title: String,
    /// must, should or may.
    pub level: String,
    /// Whether the clause was read in the judged edition.
    pub firm: bool,
    /// What kind of source.
    pub basis: String,
    /// Verdict.
    pub verdict: Verdict,
    /// Expectation that failed, or why it was not judged, in one sentence.
    pub reason: String,
    /// Remarks that do not change the verdict.
    pub notes: Vec<String>,
    /// The rule.
    pub rule: String,
    /// What is observed.
    pub observable: String,
    /// Clause.
    pub source: String,
    /// What goes wrong in the field.
    pub breaks: String,
    /// The reading that was judged by, where it is disputed.
    pub disputed: Option<String>,
    /// Verdicts of the repetitions.
    pub attempts: Vec<Verdict>,
    /// How long it took.
    pub duration_s: f64,
    /// Messages.
    pub evidence: Vec<Value>,
    /// First and last datagram of the recording that belong to it.
    pub datagrams: Option<(usize, usize)>,
}

/// An expected departure, with how it went.
#[derive(Clone, Debug, Deserialize, Serialize)]
pub struct Departure {
    /// Rule id, or a pattern with `*`.
    pub rule: String,
    /// Verdict that is expected.
    pub verdict: Verdict,
    /// Why.
    pub reason: String,
    /// Whether a rule had it.
    pub used: bool,
}

impl Subject {
    /// The edition for a heading; nothing where a suite has none.
    #[must_use]
    pub fn edition_text(&self) -> String {
        if self.edition.is_empty() {
            String::new()
        } else {
            format!(", Edition {}", self.edition)
        }
    }
}

impl RuleReport {
    /// A rule without a judgement yet.
    #[must_use]
    pub fn new(rule: &Rule, edition: &str) -> Self {
        Self {
            id: rule.id.clone(),
            group: rule.group().to_owned(),
            title: rule.title.clone(),
            level: format!("{:?}", rule.level).to_lowercase(),
            firm: !rule.carried_over(edition),
            basis: rule.basis.clone(),
            verdict: Verdict::Skipped,
            reason: String::new(),
            notes: Vec::new(),
            rule: rule.rule.clone(),
            observable: rule.observable.clone(),
            source: rule.source.clone(),
            breaks: rule.breaks.clone(),
            disputed: rule.disputed.clone(),
            attempts: Vec::new(),
            duration_s: 0.0,
            evidence: Vec::new(),
            datagrams: None,
        }
    }
}

impl Report {
    /// Counts the verdicts.
    pub fn count(&mut self) {
        self.counts.clear();
        for rule in &self.rules {
            *self
                .counts
                .entry(rule.verdict.name().to_owned())
                .or_default() += 1;
        }
    }

    /// Whether anything was judged at all.
    #[must_use]
    pub fn judged(&self) -> bool {
        self.rules.iter().any(|rule| {
            rule.verdict.is_fail() || matches!(rule.verdict, Verdict::Pass | Verdict::Warning)
        })
    }

    /// Fails that no departure expects.
    #[must_use]
    pub fn unexpected(&self) -> Vec<&RuleReport> {
        let expected = |rule: &RuleReport| {
            self.expected
                .iter()
                .any(|departure| matches(&departure.rule, &rule.id) && departure.verdict.is_fail())
        };
        self.rules
            .iter()
            .filter(|rule| rule.verdict.is_fail() && !expected(rule))
            .collect()
    }

    /// As JSON.
    #[must_use]
    pub fn to_json(&self) -> String {
        serde_json::to_string_pretty(self).unwrap_or_default()
    }
}

/// Whether a pattern, in which `*` stands for anything, names this rule.
#[must_use]
pub fn matches(pattern: &str, id: &str) -> bool {
    match pattern.split_once('*') {
        None => pattern == id,
        Some((head, tail)) => {
            id.starts_with(head) && id.len() >= head.len() + tail.len() && id.ends_with(tail)
        }
    }
}

#[cfg(test)]
mod tests {
    use super::matches;

    #[test]
    fn patterns_match() {
        assert!(matches("AUTH-002", "AUTH-002"));
        assert!(matches("AUTH-*", "AUTH-002"));
        assert!(matches("*", "AUTH-002"));
        assert!(!matches("AUTH-*", "HAND-002"));
        assert!(!matches("AUTH-002", "AUTH-0021"));
    }
}
