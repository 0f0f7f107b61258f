//! The catalogue of rules: `rules.toml`, embedded in the program and versioned.

use conformance::catalogue::{Hazard, Level, Listed};
use conformance::report::RuleReport;
use serde::{Deserialize, Serialize};

/// The catalogue.
pub type Catalogue = conformance::catalogue::CatalogueOf<Rule>;

impl Listed for Rule {
    const TEXT: &'static str = include_str!("../rules.toml");

    fn id(&self) -> &str {
        &self.id
    }
}

/// One rule.
#[derive(Clone, Debug, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub struct Rule {
    /// Stable id, `SIGN-003`.
    pub id: String,
    /// What it is about, in a few words.
    pub title: String,
    /// Who is judged.
    pub subjects: Vec<Role>,
    /// Whether breaking it is a fail.
    pub level: Level,
    /// Number in the list of signing pitfalls of docs/guide/mavlink-conformance.md.
    #[serde(default)]
    pub pitfall: Option<u8>,
    /// The rule itself.
    pub rule: String,
    /// Where it is from: page of the MAVLink guide, or the autopilot whose behaviour it is.
    pub source: String,
    /// What is sent, and what has to be seen.
    pub observable: String,
    /// What goes wrong in the field.
    pub breaks: String,
    /// What the subject or the run must provide, by the names of [`NEEDS`].
    #[serde(default)]
    pub needs: Vec<String>,
    /// The worst that a faulty subject could do.
    pub hazard: Hazard,
}

/// Who is judged.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Role {
    /// The vehicle's side.
    Autopilot,
    /// The ground's side.
    Station,
    /// What forwards between them.
    Router,
}

impl Role {
    /// Its name.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Autopilot => "autopilot",
            Self::Station => "station",
            Self::Router => "router",
        }
    }
}

/// What a rule may need, and the option that provides it.
pub const NEEDS: &[(&str, &str)] = &[
    ("key", "the subject's signing key (--key-file)"),
    ("second", "a second link of the subject (--second)"),
    ("restart", "a command that restarts the subject (--restart)"),
    ("logs", "files of the subject: logs, recordings (--logs)"),
    (
        "phrase",
        "the pass phrase from which the key was made (--phrase-file)",
    ),
    (
        "system-time",
        "leave to send a SYSTEM_TIME that is ten years off, by which PX4 in SITL sets the clock of its computer (--system-time)",
    ),
    (
        "setup-signing",
        "leave to send SETUP_SIGNING (--allow setup-signing)",
    ),
];

impl Rule {
    /// A report without a judgement yet.
    #[must_use]
    pub fn report(&self) -> RuleReport {
        RuleReport {
            id: self.id.clone(),
            group: self.group().to_owned(),
            title: self.title.clone(),
            level: self.level.name().into(),
            firm: true,
            basis: "public text or measured behaviour".into(),
            rule: self.rule.clone(),
            observable: self.observable.clone(),
            source: self.source.clone(),
            breaks: self.breaks.clone(),
            ..RuleReport::default()
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_embedded_catalogue_is_whole() {
        let catalogue = Catalogue::embedded();
        assert_eq!(catalogue.rule.len(), catalogue.catalogue.rules);
        let mut ids: Vec<_> = catalogue.rule.iter().map(|rule| &rule.id).collect();
        ids.sort();
        ids.dedup();
        assert_eq!(ids.len(), catalogue.rule.len(), "an id is used twice");
        for rule in &catalogue.rule {
            for need in &rule.needs {
                assert!(
                    NEEDS.iter().any(|(name, _)| name == need),
                    "{}: unknown need {need:?}",
                    rule.id
                );
            }
            assert!(!rule.subjects.is_empty(), "{}", rule.id);
        }
        let pitfalls: Vec<u8> = catalogue
            .rule
            .iter()
            .filter_map(|rule| rule.pitfall)
            .collect();
        for number in 1..=28 {
            assert!(pitfalls.contains(&number), "no rule for pitfall {number}");
        }
    }
}
