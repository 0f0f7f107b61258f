//! The catalogue of rules: `rules.toml`, embedded in the program and versioned.
//!
//! A rule's id never changes. `rules.toml` states what each rule requires; how it is judged is code in `rules/` (a
//! scene that the suite plays) and `passive/` (a function over recorded traffic). A rule of the catalogue without
//! code is listed with the reason, and never passes.

use std::collections::BTreeMap;

use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};

const TEXT: &str = include_str!("../rules.toml");

/// The catalogue of this suite.
pub type Catalogue = CatalogueOf<Rule>;

/// A catalogue whose rules have the form `R`: `mavlink-check` has one of its own.
#[derive(Clone, Debug, Deserialize)]
pub struct CatalogueOf<R> {
    /// Version and date.
    pub catalogue: Release,
    /// Seconds for each timer, by name.
    #[serde(default)]
    pub timers: BTreeMap<String, f64>,
    /// The groups by name: the first part of a rule's id.
    #[serde(default)]
    pub groups: BTreeMap<String, Group>,
    /// The rules, in the order of their groups.
    pub rule: Vec<R>,
}

/// The form of a suite's rules.
pub trait Listed: DeserializeOwned {
    /// The catalogue, embedded in the program.
    const TEXT: &'static str;

    /// Stable id, `AUTH-002`.
    fn id(&self) -> &str;

    /// The group, `AUTH`.
    fn group(&self) -> &str {
        self.id().split('-').next().unwrap_or_default()
    }
}

impl Listed for Rule {
    const TEXT: &'static str = TEXT;

    fn id(&self) -> &str {
        &self.id
    }
}

/// A group of rules.
#[derive(Clone, Debug, Deserialize)]
pub struct Group {
    /// What it is about.
    pub name: String,
}

/// Which catalogue this is.
#[derive(Clone, Debug, Default, Deserialize, Serialize)]
pub struct Release {
    /// Semantic version: a new rule is minor, a changed judgement major.
    pub version: String,
    /// Number of rules.
    pub rules: usize,
    /// When it was changed last.
    pub date: String,
}

/// One rule.
#[derive(Clone, Debug, Deserialize, Serialize)]
pub struct Rule {
    /// Stable id, `AUTH-002`.
    pub id: String,
    /// What it is about, in a few words.
    pub title: String,
    /// Who is judged.
    pub subject: Subject,
    /// Editions that it is judged for.
    pub editions: Vec<String>,
    /// Whether breaking it is a fail.
    pub level: Level,
    /// What the subject must have for the rule to be judged.
    pub needs: Vec<String>,
    /// The rule itself.
    pub rule: String,
    /// Clause.
    pub source: String,
    /// Kind of source: text, text-inferred, second-hand, contract.
    pub basis: String,
    /// Editions in which the clause itself was read.
    #[serde(default)]
    pub firm: Vec<String>,
    /// A, B or C.
    pub confidence: String,
    /// What is sent, and what has to be seen.
    pub observable: String,
    /// What goes wrong in the field.
    pub breaks: String,
    /// How it is judged: active, passive, operator.
    pub how: Vec<String>,
    /// The set of rules to which it belongs.
    pub profile: String,
    /// The worst that a faulty subject could do.
    pub hazard: Hazard,
    /// Message types in Editions 3 and 4.
    #[serde(default)]
    pub messages: Vec<u16>,
    /// The disputed reading that changes what is expected.
    #[serde(default)]
    pub disputed: Option<String>,
}

/// Who is judged by a rule.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Subject {
    /// The vehicle's side.
    Vsm,
    /// The ground station's side.
    Cucs,
    /// Either.
    Both,
}

/// What breaking a rule means.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Level {
    /// A fail.
    Must,
    /// A warning; a fail with `--strict`.
    Should,
    /// Reported, never judged.
    May,
}

/// The worst that a faulty subject could do while a rule is judged.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Deserialize, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Hazard {
    /// Nothing moves.
    None,
    /// Things may move on the ground.
    Ground,
    /// The aircraft flies, or is commanded in flight.
    Flight,
    /// Simulation only.
    Destructive,
}

impl<R: Listed> CatalogueOf<R> {
    /// The catalogue that this program was built with.
    ///
    /// # Panics
    /// Never in a program whose tests passed: a test parses the embedded text.
    #[must_use]
    pub fn embedded() -> Self {
        toml::from_str(R::TEXT).expect("the embedded catalogue is tested")
    }

    /// The rule of this id.
    #[must_use]
    pub fn find(&self, id: &str) -> Option<&R> {
        self.rule.iter().find(|rule| rule.id() == id)
    }

    /// The bytes of the catalogue, for its hash in a statement.
    #[must_use]
    pub fn text() -> &'static str {
        R::TEXT
    }

    /// The rules with these ids, in any case of letters, spelled as in the catalogue.
    ///
    /// # Errors
    /// There is no such rule; the sentence names the command of `program` that lists all.
    pub fn ids(&self, given: &[String], program: &str) -> Result<Vec<String>, String> {
        let rules: Vec<String> = given.iter().map(|id| id.to_uppercase()).collect();
        match rules.iter().find(|id| self.find(id).is_none()) {
            Some(unknown) => Err(format!("no rule {unknown:?}; `{program} list` shows all")),
            None => Ok(rules),
        }
    }

    /// The rule of this id, in any case of letters.
    ///
    /// # Errors
    /// There is no such rule; the sentence names the command of `program` that lists all.
    pub fn named(&self, id: &str, program: &str) -> Result<&R, String> {
        self.find(&id.to_uppercase())
            .ok_or_else(|| format!("no rule {id:?}; `{program} list` shows all"))
    }
}

impl Rule {
    /// Whether the clause was read only in another edition than the judged one.
    #[must_use]
    pub fn carried_over(&self, edition: &str) -> bool {
        !self.firm.iter().any(|firm| firm == edition)
    }
}

impl Level {
    /// Its name.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Must => "must",
            Self::Should => "should",
            Self::May => "may",
        }
    }
}

impl std::fmt::Display for Hazard {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(match self {
            Self::None => "none",
            Self::Ground => "ground",
            Self::Flight => "flight",
            Self::Destructive => "destructive",
        })
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
        assert_eq!(ids.len(), catalogue.rule.len());
        assert!(catalogue.find("AUTH-002").is_some());
        for rule in &catalogue.rule {
            assert!(catalogue.groups.contains_key(rule.group()), "{}", rule.id);
            let key = rule.disputed.as_deref();
            let known = key.is_none_or(|key| {
                use stanag_msgs::disputed::{Disputed, Settled};
                Disputed::find(key).is_some() || Settled::find(key).is_some()
            });
            assert!(known, "{}: {key:?} is no disputed point", rule.id);
        }
    }
}
