//! `report.html`: one file without network: a matrix by group, fails first, a filter, and each rule with its evidence.

use std::collections::BTreeMap;
use std::fmt::Write;

use super::junit::escape;
use super::{Report, RuleReport};
use crate::verdict::Verdict;

const STYLE: &str = "
:root{--pass:#1a7f37;--fail:#c62828;--flaky:#ad1457;--warning:#9a6700;--inconclusive:#6e5494;--not_applicable:#777;--skipped:#777}
body{font:15px/1.5 system-ui,sans-serif;margin:2em auto;max-width:1100px;padding:0 1em;color:#1c1e21;background:#fff}
h1{font-size:1.5em}h2{font-size:1.15em;margin-top:2em}table{border-collapse:collapse;width:100%}
th,td{text-align:left;padding:.25em .6em;border-bottom:1px solid #ddd;vertical-align:top}
.v{display:inline-block;color:#fff;border-radius:3px;padding:0 .5em;font-size:.85em;white-space:nowrap}
.matrix a{display:inline-block;width:1.1em;height:1.1em;border-radius:2px;margin:1px;vertical-align:middle}
details{border:1px solid #ddd;border-radius:4px;margin:.4em 0;padding:.2em .7em}summary{cursor:pointer}
pre{background:#f6f8fa;padding:.6em;overflow-x:auto;font-size:12px;white-space:pre-wrap;word-break:break-all}
dt{font-weight:600}dd{margin:0 0 .5em 0}.filter button{margin-right:.4em}.small{color:#57606a;font-size:.9em}
@media print{.filter{display:none}details{break-inside:avoid}body{margin:0;max-width:none}}
";

const SCRIPT: &str = "
function show(v){document.querySelectorAll('details.rule').forEach(function(d){d.hidden=v!==''&&d.dataset.verdict!==v})}
document.querySelectorAll('.filter button').forEach(function(b){b.onclick=function(){show(b.dataset.verdict)}});
document.getElementById('find').oninput=function(){var t=this.value.toLowerCase();document.querySelectorAll('details.rule').forEach(function(d){d.hidden=d.textContent.toLowerCase().indexOf(t)<0})};
window.addEventListener('beforeprint',function(){document.querySelectorAll('details[data-verdict=fail]').forEach(function(d){d.open=true})});
window.addEventListener('hashchange',function(){var d=document.getElementById(location.hash.slice(1));if(d){d.hidden=false;d.open=true}});
";

/// The report as a page.
#[must_use]
pub fn html(report: &Report) -> String {
    let subject = &report.subject;
    let mut out = String::from(
        "<!doctype html>\n<html lang=\"en\"><head><meta charset=\"utf-8\"><meta name=\"viewport\" content=\"width=device-width\">",
    );
    let _ = write!(
        out,
        "<title>{}: {}</title><style>{STYLE}</style></head><body>",
        escape(&report.suite),
        escape(&subject.address)
    );
    let _ = write!(
        out,
        "<h1>{}: {} {}</h1><p>{} at {}{}. {}, catalogue {} of {}. {} rules in {:.0} s{}.</p>",
        escape(&report.suite),
        escape(&subject.name),
        escape(&subject.version),
        escape(&subject.role),
        escape(&subject.address),
        escape(&subject.edition_text()),
        escape(&report.program),
        escape(&report.catalogue.version),
        escape(&report.catalogue.date),
        report.rules.len(),
        report.duration_s,
        if report.strict { ", strict" } else { "" }
    );
    for (name, ids) in [("Vehicles", &subject.vehicles), ("CUCS ids", &subject.cucs)] {
        if !ids.is_empty() {
            let _ = write!(
                out,
                "<p class=\"small\">{name}: {}</p>",
                escape(&ids.join(", "))
            );
        }
    }
    for remark in &report.remarks {
        let _ = write!(out, "<p><b>Remark:</b> {}</p>", escape(remark));
    }
    if !report.expected.is_empty() {
        out.push_str("<h2>Expected departures</h2><table><tr><th>rule</th><th>verdict</th><th>reason</th><th>occurred</th></tr>");
        for departure in &report.expected {
            let _ = write!(
                out,
                "<tr><td>{}</td><td>{}</td><td>{}</td><td>{}</td></tr>",
                escape(&departure.rule),
                departure.verdict.name(),
                escape(&departure.reason),
                if departure.used { "yes" } else { "no" }
            );
        }
        out.push_str("</table>");
    }
    matrix(&mut out, report);
    out.push_str("<h2>Rules</h2><p class=\"filter\"><button data-verdict=\"\">all</button>");
    for verdict in Verdict::ALL {
        if let Some(count) = report.counts.get(verdict.name()) {
            let _ = write!(
                out,
                "<button data-verdict=\"{0}\">{0} {count}</button>",
                verdict.name()
            );
        }
    }
    out.push_str("<input id=\"find\" placeholder=\"find\" aria-label=\"find\"></p>");
    for verdict in Verdict::ALL {
        for rule in report.rules.iter().filter(|rule| rule.verdict == verdict) {
            detail(&mut out, rule);
        }
    }
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
    if !subject.edition.is_empty() {
        out.push_str("<p class=\"small\">Firm: the clause was read in the judged edition. Carried over: it was read in Edition 2.5, or is known from secondary sources only.</p>");
    }
    let _ = write!(out, "<script>{SCRIPT}</script></body></html>");
    out
}

fn matrix(out: &mut String, report: &Report) {
    let mut groups: BTreeMap<&str, Vec<&RuleReport>> = BTreeMap::new();
    for rule in &report.rules {
        groups.entry(&rule.group).or_default().push(rule);
    }
    out.push_str("<h2>Matrix</h2><table class=\"matrix\"><tr><th>group</th><th>rules</th><th>fail</th><th>pass</th></tr>");
    for (group, rules) in groups {
        let count =
            |wanted: fn(Verdict) -> bool| rules.iter().filter(|rule| wanted(rule.verdict)).count();
        let _ = write!(out, "<tr><td>{}</td><td>", escape(group));
        for rule in &rules {
            let _ = write!(
                out,
                "<a href=\"#{0}\" title=\"{0} {1}: {2}\" style=\"background:var(--{2})\"></a>",
                escape(&rule.id),
                escape(&rule.title),
                rule.verdict.name()
            );
        }
        let _ = write!(
            out,
            "</td><td>{}</td><td>{} of {}</td></tr>",
            count(Verdict::is_fail),
            count(|verdict| verdict == Verdict::Pass),
            rules.len()
        );
    }
    out.push_str("</table>");
}

fn detail(out: &mut String, rule: &RuleReport) {
    let verdict = rule.verdict.name();
    let _ = write!(
        out,
        "<details class=\"rule\" id=\"{}\" data-verdict=\"{verdict}\"><summary><span class=\"v\" style=\"background:var(--{verdict})\">{verdict}</span> <b>{}</b> {} <span class=\"small\">{}</span></summary><dl>",
        escape(&rule.id),
        escape(&rule.id),
        escape(&rule.title),
        escape(&rule.reason)
    );
    let firm = if rule.firm { "firm" } else { "carried over" };
    let rows = [
        ("Rule", rule.rule.clone()),
        ("Found", rule.reason.clone()),
        ("Observed by", rule.observable.clone()),
        ("Breaks in the field", rule.breaks.clone()),
        ("Source", format!("{} ({firm}, {}, {})", rule.source, rule.basis, rule.level)),
        ("Disputed reading", rule.disputed.clone().map_or(String::new(), |key| format!("{key}: judged by the profile's reading; the other reading is named in the source"))),
        ("Notes", rule.notes.join("; ")),
    ];
    for (name, text) in rows.iter().filter(|(_, text)| !text.is_empty()) {
        let _ = write!(out, "<dt>{name}</dt><dd>{}</dd>", escape(text));
    }
    out.push_str("</dl>");
    if !rule.evidence.is_empty() {
        out.push_str("<table><tr><th>s</th><th></th><th>message</th><th>fields</th></tr>");
        for message in &rule.evidence {
            let text = |key: &str| message[key].as_str().unwrap_or_default().to_owned();
            let _ = write!(
                out,
                "<tr><td>{:.3}</td><td>{}</td><td>{} {}<br><span class=\"small\">{} to {}</span></td><td><pre>{}\n{}</pre></td></tr>",
                message["time"].as_f64().unwrap_or_default(),
                if message["direction"] == "sent" {
                    "&rarr;"
                } else {
                    "&larr;"
                },
                message["id"],
                escape(&text("name")),
                escape(&text("source")),
                escape(&text("destination")),
                escape(&message["fields"].to_string()),
                escape(&text("hex"))
            );
        }
        out.push_str("</table>");
    }
    out.push_str("</details>");
}
