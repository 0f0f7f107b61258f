//! `report.html`: one file that loads nothing: the fails first, a matrix by group, a filter, and a section for each
//! rule with its evidence and both readings of a disputed point.

use std::collections::BTreeMap;
use std::fmt::Write;

use serde_json::Value;
use stanag_msgs::disputed::{Choices, Disputed, Settled};

use super::junit::escape;
use super::{Report, RuleReport, utc};
use crate::catalogue::Catalogue;
use crate::profile::Profile;
use crate::verdict::Verdict;

const STYLE: &str = include_str!("style.css");
const SCRIPT: &str = include_str!("script.js");

/// How much of the evidence is shown.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Detail {
    /// All of it.
    Full,
    /// Only of rules that did not pass, and only the last messages: for documents.
    Brief,
}

/// Messages of a rule in a brief report.
const BRIEF_MESSAGES: usize = 4;

/// The report as a page.
#[must_use]
pub fn html(report: &Report, detail: Detail) -> String {
    let mut out = head(&format!(
        "{}: {} {}",
        report.suite, report.subject.name, report.subject.address
    ));
    title(&mut out, report);
    fails(&mut out, report);
    departures(&mut out, report);
    let names = group_names();
    matrix(&mut out, report, &names);
    filter(&mut out, report, &names);
    let readings = toml::from_str::<Profile>(&report.profile)
        .map(|profile| profile.readings)
        .unwrap_or_default();
    for verdict in Verdict::ALL {
        for rule in report.rules.iter().filter(|rule| rule.verdict == verdict) {
            section(&mut out, rule, &readings, detail);
        }
    }
    foot(&mut out, report);
    out
}

/// The beginning of a page, up to its content.
pub(super) fn head(title: &str) -> String {
    format!(
        "<!doctype html>\n<html lang=\"en\"><head><meta charset=\"utf-8\"><meta name=\"viewport\" content=\"width=device-width\">\
         <title>{}</title><style>{STYLE}</style></head><body><main>\n",
        escape(title)
    )
}

/// A verdict as a coloured word.
pub(super) fn badge(verdict: Verdict) -> String {
    let name = verdict.name();
    format!(
        "<span class=\"v\" style=\"background:var(--{name})\">{}</span>",
        name.replace('_', " ")
    )
}

fn title(out: &mut String, report: &Report) {
    let subject = &report.subject;
    let name = format!("{} {}", subject.name, subject.version);
    let name = if name.trim().is_empty() {
        &subject.address
    } else {
        name.trim()
    };
    let _ = write!(
        out,
        "<h1>{}: {}</h1><p class=\"small\">{} at {}{}. {}, catalogue {} of {}. {} in {:.0} s{}, begun {}.",
        escape(&report.suite),
        escape(name),
        escape(&subject.role),
        escape(&subject.address),
        escape(&subject.edition_text()),
        escape(&report.program),
        escape(&report.catalogue.version),
        escape(&report.catalogue.date),
        plural(report.rules.len(), "rule"),
        report.duration_s,
        if report.strict { ", strict" } else { "" },
        utc(report.started),
    );
    for (what, list) in [
        (" Vehicles", &subject.vehicles),
        (" CUCS ids", &subject.cucs),
    ] {
        if !list.is_empty() {
            let _ = write!(out, "{what}: {}.", escape(&list.join(", ")));
        }
    }
    out.push_str("</p><div class=\"counts\">");
    for verdict in Verdict::ALL {
        if let Some(count) = report.counts.get(verdict.name()) {
            let _ = write!(out, "<div><b>{count}</b> {}</div>", badge(verdict));
        }
    }
    out.push_str("</div>");
    for remark in &report.remarks {
        let _ = write!(out, "<p><b>Remark:</b> {}</p>", escape(remark));
    }
}

/// Lists the fails, unexpected ones first.
fn fails(out: &mut String, report: &Report) {
    let mut failed: Vec<(bool, &RuleReport)> = Verdict::ALL
        .into_iter()
        .filter(|verdict| verdict.is_fail())
        .flat_map(|verdict| {
            report
                .rules
                .iter()
                .filter(move |rule| rule.verdict == verdict)
        })
        .map(|rule| {
            let unexpected = report.unexpected();
            (!unexpected.iter().any(|other| other.id == rule.id), rule)
        })
        .collect();
    if failed.is_empty() {
        out.push_str("<h2>Nothing fails</h2>");
        return;
    }
    failed.sort_by_key(|(expected, _)| *expected);
    let _ = write!(
        out,
        "<h2>{}</h2><table><tr><th>rule</th><th>what was expected, and what came</th><th>what breaks in the field</th></tr>",
        plural_verb(failed.len())
    );
    for (expected, rule) in failed {
        let _ = write!(
            out,
            "<tr><td class=\"id\"><a href=\"#{0}\">{0}</a><br>{1}{2}</td><td>{3}</td><td>{4}</td></tr>",
            escape(&rule.id),
            badge(rule.verdict),
            if expected {
                " <span class=\"small\">expected</span>"
            } else {
                ""
            },
            escape(&rule.reason),
            escape(&rule.breaks)
        );
    }
    out.push_str("</table>");
}

fn plural(count: usize, what: &str) -> String {
    format!("{count} {what}{}", if count == 1 { "" } else { "s" })
}

fn plural_verb(count: usize) -> String {
    if count == 1 {
        "1 rule fails".into()
    } else {
        format!("{count} rules fail")
    }
}

fn departures(out: &mut String, report: &Report) {
    if report.expected.is_empty() {
        return;
    }
    out.push_str("<h2>Expected departures</h2><table><tr><th>rule</th><th>verdict</th><th>reason</th><th>occurred</th></tr>");
    for departure in &report.expected {
        let _ = write!(
            out,
            "<tr><td>{}</td><td>{}</td><td>{}</td><td>{}</td></tr>",
            escape(&departure.rule),
            badge(departure.verdict),
            escape(&departure.reason),
            if departure.used { "yes" } else { "no" }
        );
    }
    out.push_str("</table>");
}

fn group_names() -> BTreeMap<String, String> {
    let groups = Catalogue::embedded().groups;
    groups
        .into_iter()
        .map(|(id, group)| (id, group.name))
        .collect()
}

fn matrix(out: &mut String, report: &Report, names: &BTreeMap<String, String>) {
    let mut groups: BTreeMap<&str, Vec<&RuleReport>> = BTreeMap::new();
    for rule in &report.rules {
        groups.entry(&rule.group).or_default().push(rule);
    }
    out.push_str("<h2>By group</h2><table class=\"cells\"><tr><th colspan=\"2\">group</th><th>rules</th><th class=\"n\">fail</th><th class=\"n\">pass</th></tr>");
    for (group, rules) in groups {
        let count =
            |wanted: fn(Verdict) -> bool| rules.iter().filter(|rule| wanted(rule.verdict)).count();
        let _ = write!(
            out,
            "<tr><td><b>{}</b></td><td>{}</td><td>",
            escape(group),
            escape(names.get(group).map_or("", String::as_str))
        );
        for rule in &rules {
            let _ = write!(
                out,
                "<a href=\"#{0}\" title=\"{0} {1}: {2}\" aria-label=\"{0} {2}\" style=\"background:var(--{2})\"></a>",
                escape(&rule.id),
                escape(&rule.title),
                rule.verdict.name()
            );
        }
        let failed = count(Verdict::is_fail);
        let _ = write!(
            out,
            "</td><td class=\"n\">{}</td><td class=\"n\">{} of {}</td></tr>",
            if failed == 0 {
                String::new()
            } else {
                failed.to_string()
            },
            count(|verdict| verdict == Verdict::Pass),
            rules.len()
        );
    }
    out.push_str("</table>");
}

fn filter(out: &mut String, report: &Report, names: &BTreeMap<String, String>) {
    out.push_str(
        "<h2>Rules</h2><div class=\"filter\"><button data-verdict=\"\" aria-pressed=\"true\">all</button>",
    );
    for verdict in Verdict::ALL {
        if let Some(count) = report.counts.get(verdict.name()) {
            let _ = write!(
                out,
                "<button data-verdict=\"{}\">{} {count}</button>",
                verdict.name(),
                verdict.name().replace('_', " ")
            );
        }
    }
    out.push_str(
        "<select id=\"group\" aria-label=\"group\"><option value=\"\">all groups</option>",
    );
    let mut groups: Vec<&str> = report.rules.iter().map(|rule| &*rule.group).collect();
    groups.sort_unstable();
    groups.dedup();
    for group in groups {
        let _ = write!(
            out,
            "<option value=\"{0}\">{0} {1}</option>",
            escape(group),
            escape(names.get(group).map_or("", String::as_str))
        );
    }
    out.push_str("</select><input id=\"find\" type=\"search\" placeholder=\"find in rules and messages\" aria-label=\"find\"></div><p id=\"none\" class=\"small\" hidden>No rule matches.</p>");
}

fn section(
    out: &mut String,
    rule: &RuleReport,
    readings: &BTreeMap<String, String>,
    detail: Detail,
) {
    let _ = write!(
        out,
        "<details class=\"rule\" id=\"{0}\" data-verdict=\"{1}\" data-group=\"{2}\"><summary>{3}<b>{0}</b><span>{4}</span>",
        escape(&rule.id),
        rule.verdict.name(),
        escape(&rule.group),
        badge(rule.verdict),
        escape(&rule.title),
    );
    if !rule.reason.is_empty() {
        let _ = write!(out, "<span class=\"small\">{}</span>", escape(&rule.reason));
    }
    out.push_str("</summary><div><dl>");
    let firm = if rule.firm {
        "firm: the clause was read in this edition"
    } else {
        "carried over: not read in this edition"
    };
    let attempts = if rule.attempts.len() > 1 {
        let names: Vec<&str> = rule.attempts.iter().map(|verdict| verdict.name()).collect();
        names.join(", ")
    } else {
        String::new()
    };
    let rows = [
        ("Rule", format!("{} ({})", rule.rule, rule.level)),
        ("Found", rule.reason.clone()),
        ("Repetitions", attempts),
        ("Observed by", rule.observable.clone()),
        ("Breaks in the field", rule.breaks.clone()),
        (
            "Source",
            format!("{} ({}; {firm})", rule.source, rule.basis),
        ),
        (
            "Disputed",
            rule.disputed
                .as_deref()
                .map_or(String::new(), |key| disputed(key, readings)),
        ),
        ("Notes", rule.notes.join("; ")),
    ];
    for (name, text) in rows.iter().filter(|(_, text)| !text.is_empty()) {
        let _ = write!(out, "<dt>{name}</dt><dd>{}</dd>", escape(text));
    }
    out.push_str("</dl>");
    evidence(out, rule, detail);
    out.push_str("</div></details>\n");
}

/// The reading that was judged by, and the other one, with the sources that have each.
fn disputed(key: &str, readings: &BTreeMap<String, String>) -> String {
    if let Some(point) = Settled::find(key) {
        return format!("{}: {}, by {}.", point.question, point.meaning, point.by);
    }
    let Some(point) = Disputed::find(key) else {
        return key.to_owned();
    };
    let judged = readings.get(key).map_or(point.default, String::as_str);
    let by = if readings.contains_key(key) {
        "as the profile reads it"
    } else {
        "the default"
    };
    let others = match point.choices {
        Choices::OneOf(choices) => {
            let others: Vec<&str> = choices
                .iter()
                .copied()
                .filter(|choice| *choice != judged)
                .collect();
            format!("the other reading is {:?}", others.join("\" or \""))
        }
        Choices::Values(meanings) => {
            format!("other readings give {} other values", meanings.join(", "))
        }
    };
    format!(
        "{}: judged as {judged:?} ({by}); {others}. Sources: {}. Set by readings.{key} in the profile.",
        point.question, point.sources
    )
}

fn evidence(out: &mut String, rule: &RuleReport, detail: Detail) {
    let shown: &[Value] = match detail {
        Detail::Full => &rule.evidence,
        Detail::Brief
            if matches!(
                rule.verdict,
                Verdict::Fail | Verdict::Flaky | Verdict::Warning
            ) =>
        {
            &rule.evidence[rule.evidence.len().saturating_sub(BRIEF_MESSAGES)..]
        }
        Detail::Brief => &[],
    };
    if shown.is_empty() {
        return;
    }
    out.push_str("<table class=\"evidence\"><tr><th class=\"n\">s</th><th></th><th>message</th><th>fields, and the bytes</th></tr>");
    for message in shown {
        let text = |key: &str| escape(message[key].as_str().unwrap_or_default());
        let (arrow, way) = match message["direction"].as_str() {
            Some("sent") => ("&rarr;", "sent"),
            Some("received") => ("&larr;", "received"),
            _ => ("?", "operator"),
        };
        let id = match message["id"].as_u64() {
            Some(0) | None => String::new(),
            Some(id) => id.to_string(),
        };
        let _ = write!(
            out,
            "<tr><td class=\"n\">{:.3}</td><td title=\"{way}\">{arrow}</td><td>{id} {}<br><span class=\"small\">{} {}</span></td><td>",
            message["time"].as_f64().unwrap_or_default(),
            text("name"),
            text("source"),
            match message["destination"].as_str() {
                Some(to) if !to.is_empty() => format!("to {}", escape(to)),
                _ => String::new(),
            },
        );
        if let Some(error) = message["error"].as_str() {
            let _ = write!(out, "<b>{}</b> ", escape(error));
        }
        let fields = message["fields"]
            .as_object()
            .map_or(String::new(), |fields| {
                fields
                    .iter()
                    .map(|(name, value)| format!("{name} {}", plain(value)))
                    .collect::<Vec<_>>()
                    .join(", ")
            });
        let _ = write!(
            out,
            "{}<div class=\"hex\">{}</div></td></tr>",
            escape(&fields),
            text("hex")
        );
    }
    out.push_str("</table>");
    if shown.len() < rule.evidence.len() {
        let _ = write!(
            out,
            "<p class=\"small\">The last {} of {} messages.</p>",
            shown.len(),
            rule.evidence.len()
        );
    }
}

fn plain(value: &Value) -> String {
    match value {
        Value::String(text) => format!("{text:?}"),
        other => other.to_string(),
    }
}

fn foot(out: &mut String, report: &Report) {
    let _ = write!(
        out,
        "<h2>Profile</h2><pre>{}</pre>",
        escape(&report.profile)
    );
    for (name, hash) in &report.hashes {
        let _ = write!(
            out,
            "<p class=\"small\">SHA-256 of {}: {}</p>",
            escape(name),
            escape(hash)
        );
    }
    let _ = writeln!(
        out,
        "<p class=\"small\">This is no certificate. Firm: the clause was read in the judged edition. Carried over: it was read in Edition 2.5, or is \
         known from secondary sources only. A broken \"should\" is a warning{}.</p></main><script>{SCRIPT}</script></body></html>",
        if report.strict {
            " in a run that is not strict; this one is"
        } else {
            ""
        }
    );
}
