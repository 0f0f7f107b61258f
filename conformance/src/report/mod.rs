//! The result of a run: one model, from which every form of report is made.
//!
//! `report.json` is the model itself; [`html`], [`junit`], [`statement`] and [`capture`] are made from it and the
//! recording alone.

pub mod capture;
pub mod html;
pub mod junit;
pub mod matrix;
pub mod statement;

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};
use serde_json::Value;

use crate::catalogue::{Listed, Release, Rule};
use crate::verdict::{Verdict, findings};

/// Version of the form of `report.json`.
pub const SCHEMA: &str = "1";
/// The form of `report.json` as a JSON Schema (draft 2020-12); `dli-check schema` prints it.
pub const JSON_SCHEMA: &str = include_str!("../../report.schema.json");

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
    /// The program that made it, with its version.
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
    /// Remarks about the run as a whole: network loss, an occupied vehicle, an interruption.
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
    /// Its address.
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
    /// Whether it failed, and is inconclusive only because something else may be the cause: the network, a flood, another
    /// CUCS.
    #[serde(default)]
    pub excused: bool,
    /// How long it took.
    pub duration_s: f64,
    /// Messages.
    pub evidence: Vec<Value>,
    /// First and last datagram of the recording that belong to it.
    pub datagrams: Option<(usize, usize)>,
}

/// An expected departure, and whether it occurred.
#[derive(Clone, Debug, Deserialize, Serialize)]
pub struct Departure {
    /// Rule id, or a pattern with `*`.
    pub rule: String,
    /// Verdict that is expected.
    pub verdict: Verdict,
    /// Why.
    pub reason: String,
    /// Text that the rule's finding has to contain, or it is another departure; absent accepts every finding.
    #[serde(default)]
    pub finding: Option<String>,
    /// Whether a rule had it.
    pub used: bool,
}

impl Departure {
    /// Whether it is about this rule, and expects everything that the rule finds.
    #[must_use]
    pub fn covers(&self, rule: &RuleReport) -> bool {
        let finding = self.finding.as_deref().unwrap_or_default();
        matches(&self.rule, &rule.id)
            && (rule.verdict == self.verdict || rule.verdict.is_fail() && self.verdict.is_fail())
            && findings(&rule.reason).all(|found| found.contains(finding))
    }
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
            level: rule.level.name().into(),
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
            excused: false,
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

    /// Whether a rule failed and something else may be the cause: the run does not show that the rule holds.
    #[must_use]
    pub fn excused(&self) -> bool {
        self.rules.iter().any(|rule| rule.excused)
    }

    /// Fails that no departure expects.
    #[must_use]
    pub fn unexpected(&self) -> Vec<&RuleReport> {
        let expected =
            |rule: &RuleReport| self.expected.iter().any(|departure| departure.covers(rule));
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

/// Seconds since 1970 by the clock of this computer.
#[must_use]
pub fn now() -> u64 {
    std::time::SystemTime::now()
        .duration_since(std::time::UNIX_EPOCH)
        .unwrap_or_default()
        .as_secs()
}

/// Seconds since 1970 as date and time, `2026-11-23T06:50:00Z`.
#[must_use]
pub fn utc(seconds: u64) -> String {
    let (days, rest) = ((seconds / 86_400) as i64, seconds % 86_400);
    // Howard Hinnant's days to civil.
    let shifted = days + 719_468;
    let era = shifted.div_euclid(146_097);
    let day_of_era = shifted.rem_euclid(146_097);
    let year_of_era =
        (day_of_era - day_of_era / 1_460 + day_of_era / 36_524 - day_of_era / 146_096) / 365;
    let day_of_year = day_of_era - (365 * year_of_era + year_of_era / 4 - year_of_era / 100);
    let shifted_month = (5 * day_of_year + 2) / 153;
    let day = day_of_year - (153 * shifted_month + 2) / 5 + 1;
    let month = if shifted_month < 10 {
        shifted_month + 3
    } else {
        shifted_month - 9
    };
    let year = year_of_era + era * 400 + i64::from(month <= 2);
    format!(
        "{year:04}-{month:02}-{day:02}T{:02}:{:02}:{:02}Z",
        rest / 3600,
        rest / 60 % 60,
        rest % 60
    )
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
pub(crate) mod tests {
    use serde_json::{Value, json};

    use super::*;
    use crate::catalogue::Catalogue;

    /// A report with something of everything, and texts that look like markup.
    pub(crate) fn report(catalogue: &Catalogue) -> Report {
        let mut rules: Vec<RuleReport> = catalogue.rule[..40]
            .iter()
            .map(|rule| RuleReport {
                verdict: Verdict::Pass,
                ..RuleReport::new(rule, "4")
            })
            .collect();
        for (rule, verdict) in rules.iter_mut().zip(Verdict::ALL) {
            rule.verdict = verdict;
            rule.reason = "expected <b>, got \"&\"".into();
        }
        rules[0].attempts = vec![Verdict::Fail, Verdict::Fail, Verdict::Fail];
        rules[0].datagrams = Some((0, 2));
        rules[0].evidence = vec![json!({
            "time": 0.25, "direction": "received", "source": "1b:00:01:01", "destination": "1b:00:00:a0", "id": 2,
            "name": "VSM Authorisation Response", "fields": { "Text": "</script><b>" }, "hex": "00ff",
        })];
        let mut report = Report {
            schema: SCHEMA.into(),
            suite: DLI.into(),
            program: "dli-check 0".into(),
            catalogue: catalogue.catalogue.clone(),
            subject: Subject {
                role: "vsm".into(),
                name: "Acme <VSM>".into(),
                version: "1.0".into(),
                address: "127.0.0.1:4586".into(),
                edition: "4".into(),
                vehicles: vec!["1b:00:01:01".into()],
                cucs: Vec::new(),
            },
            started: 1_795_416_600,
            duration_s: 61.5,
            strict: false,
            profile: "[readings]\nchecksum_1 = \"crc16\"\n".into(),
            hashes: BTreeMap::from([("profile".into(), "ab".into())]),
            remarks: vec!["a remark".into()],
            counts: BTreeMap::new(),
            expected: vec![Departure {
                rule: "WRAP-*".into(),
                verdict: Verdict::Fail,
                reason: "known".into(),
                finding: None,
                used: true,
            }],
            rules,
        };
        report.count();
        report
    }

    #[test]
    fn seconds_are_a_date() {
        assert_eq!(utc(0), "1970-01-01T00:00:00Z");
        assert_eq!(utc(951_825_599), "2000-02-29T11:59:59Z");
        assert_eq!(utc(1_795_416_600), "2026-11-23T06:50:00Z");
    }

    #[test]
    fn the_page_is_whole_and_nothing_in_a_message_is_markup() {
        let catalogue = Catalogue::embedded();
        let report = report(&catalogue);
        let page = html::html(&report, html::Detail::Full);
        assert!(!page.contains("</script><b>"));
        assert!(page.contains("&lt;/script&gt;&lt;b&gt;"));
        for rule in &report.rules {
            assert!(page.contains(&format!("id=\"{}\"", rule.id)), "{}", rule.id);
        }
        // The page loads nothing.
        for outside in ["http://", "https://", "src=", "@import", "url("] {
            assert!(!page.contains(outside), "{outside}");
        }
        let first = page.find("<details").unwrap();
        assert!(page[first..].starts_with(&format!(
            "<details class=\"rule\" id=\"{}\" data-verdict=\"fail\"",
            report.rules[0].id
        )));
        let disputed = report
            .rules
            .iter()
            .find(|rule| rule.disputed.as_deref() == Some("checksum_1"));
        assert!(disputed.is_some(), "the report has a disputed rule");
        assert!(page.contains("judged as &quot;crc16&quot; (as the profile reads it); the other reading is &quot;sum&quot;"));
        let main = page.find("<main>").zip(page.find("</main>"));
        assert!(main.is_some_and(|(begin, end)| begin < first && first < end));
        let brief = html::html(&report, html::Detail::Brief);
        assert!(brief.len() <= page.len());
    }

    #[test]
    fn the_statement_has_the_date_of_the_run() {
        let signed = statement::statement(&report(&Catalogue::embedded()));
        assert!(
            signed.contains("| Began | 2026-11-23T06:50:00Z |"),
            "{signed}"
        );
    }

    /// Checks a value by the part of JSON Schema that `report.schema.json` uses.
    fn misfits(schema: &Value, root: &Value, value: &Value, place: &str, found: &mut Vec<String>) {
        if let Some(name) = schema["$ref"].as_str() {
            let part = name.trim_start_matches("#/$defs/");
            return misfits(&root["$defs"][part], root, value, place, found);
        }
        let kind = match value {
            Value::Null => "null",
            Value::Bool(_) => "boolean",
            Value::Number(number) if number.is_u64() || number.is_i64() => "integer",
            Value::Number(_) => "number",
            Value::String(_) => "string",
            Value::Array(_) => "array",
            Value::Object(_) => "object",
        };
        let allowed: Vec<&str> = match &schema["type"] {
            Value::String(one) => vec![one],
            Value::Array(many) => many.iter().filter_map(Value::as_str).collect(),
            _ => vec![kind],
        };
        if !(allowed.contains(&kind) || kind == "integer" && allowed.contains(&"number")) {
            found.push(format!("{place}: {kind}, expected {allowed:?}"));
        }
        if let Some(values) = schema["enum"].as_array()
            && !values.contains(value)
        {
            found.push(format!("{place}: {value}, expected one of {values:?}"));
        }
        if let Some(object) = value.as_object() {
            for key in schema["required"].as_array().into_iter().flatten() {
                if !object.contains_key(key.as_str().unwrap_or_default()) {
                    found.push(format!("{place}: lacks {key}"));
                }
            }
            for (key, inner) in object {
                let place = format!("{place}.{key}");
                match (&schema["properties"][key], &schema["additionalProperties"]) {
                    (Value::Null, Value::Bool(false)) => found.push(format!("{place}: unknown")),
                    (Value::Null, other) if other.is_object() => {
                        misfits(other, root, inner, &place, found);
                    }
                    (Value::Null, _) => {}
                    (property, _) => misfits(property, root, inner, &place, found),
                }
            }
        }
        if let (Some(list), true) = (value.as_array(), schema["items"].is_object()) {
            for (index, inner) in list.iter().enumerate() {
                misfits(
                    &schema["items"],
                    root,
                    inner,
                    &format!("{place}[{index}]"),
                    found,
                );
            }
        }
    }

    #[test]
    fn report_json_has_the_form_of_its_schema() {
        let schema: Value = serde_json::from_str(JSON_SCHEMA).unwrap();
        let report: Value =
            serde_json::from_str(&report(&Catalogue::embedded()).to_json()).unwrap();
        let check = |report: &Value| {
            let mut found = Vec::new();
            misfits(&schema, &schema, report, "report", &mut found);
            found
        };
        assert_eq!(check(&report), Vec::<String>::new());
        let mut wrong = report.clone();
        wrong["rules"][0]["verdict"] = "good".into();
        wrong["rules"][1]["colour"] = "red".into();
        wrong.as_object_mut().unwrap().remove("started");
        assert_eq!(check(&wrong).len(), 3, "{:?}", check(&wrong));
    }

    #[test]
    fn the_statement_names_what_could_not_be_judged() {
        let mut report = report(&Catalogue::embedded());
        report.rules.retain(|rule| !rule.verdict.is_fail());
        let open = report
            .rules
            .iter()
            .find(|rule| rule.verdict == Verdict::Inconclusive);
        let line = open.map(|rule| format!("- **{}** {}", rule.id, rule.title));
        let text = statement::statement(&report);
        assert!(text.contains("None of those that were judged"), "{text}");
        assert!(text.contains(&line.unwrap()), "{text}");
        report
            .rules
            .retain(|rule| rule.verdict != Verdict::Inconclusive);
        let text = statement::statement(&report);
        assert!(text.contains("## Rules that fail\n\nNone.\n"), "{text}");
        assert!(!text.contains("could not be judged"), "{text}");
    }

    #[test]
    fn patterns_match() {
        assert!(matches("AUTH-*", "AUTH-002"));
        assert!(matches("AUTH-002", "AUTH-002"));
        assert!(matches("*", "AUTH-002"));
        assert!(!matches("AUTH-*", "HAND-002"));
        assert!(!matches("AUTH-002", "AUTH-0021"));
    }
}
