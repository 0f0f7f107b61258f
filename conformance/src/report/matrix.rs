//! Several systems side by side: the matrix of `dli-check compare`, as Markdown and as one page.

use std::collections::BTreeMap;
use std::fmt::Write;

use super::Report;
use super::html::{badge, head};
use super::junit::escape;
use crate::verdict::Verdict;

/// One rule with the verdict of each system, where it was judged there.
#[derive(Clone, Debug, PartialEq)]
pub struct Row {
    /// Id.
    pub rule: String,
    /// Title.
    pub title: String,
    /// In the order of the systems; `None` where a report does not have the rule.
    pub verdicts: Vec<Option<Verdict>>,
}

impl Row {
    /// Whether all systems have the same verdict.
    #[must_use]
    pub fn same(&self) -> bool {
        self.verdicts.windows(2).all(|pair| pair[0] == pair[1])
    }

    /// Whether a system fails where the one before it did not.
    #[must_use]
    pub fn worse(&self) -> bool {
        let fails = |verdict: &Option<Verdict>| verdict.is_some_and(Verdict::is_fail);
        self.verdicts
            .windows(2)
            .any(|pair| !fails(&pair[0]) && fails(&pair[1]))
    }
}

/// All rules of these reports, in the order of their ids.
#[must_use]
pub fn rows(reports: &[Report]) -> Vec<Row> {
    let mut rows: BTreeMap<&str, Row> = BTreeMap::new();
    for (index, report) in reports.iter().enumerate() {
        for rule in &report.rules {
            let row = rows.entry(&rule.id).or_insert_with(|| Row {
                rule: rule.id.clone(),
                title: rule.title.clone(),
                verdicts: vec![None; reports.len()],
            });
            row.verdicts[index] = Some(rule.verdict);
        }
    }
    rows.into_values().collect()
}

/// Names of the systems: from the profile, otherwise from the file, with a number where two are equal.
#[must_use]
pub fn names(reports: &[Report], files: &[String]) -> Vec<String> {
    let own = |(report, file): (&Report, &String)| {
        let name = format!("{} {}", report.subject.name, report.subject.version);
        match name.trim() {
            "" => file.clone(),
            name => name.to_owned(),
        }
    };
    let all: Vec<String> = reports.iter().zip(files).map(own).collect();
    all.iter()
        .enumerate()
        .map(|(index, name)| {
            if all.iter().filter(|other| *other == name).count() > 1 {
                format!("{name} ({})", index + 1)
            } else {
                name.clone()
            }
        })
        .collect()
}

/// The matrix as a table in Markdown; a star marks rules on which the systems differ.
#[must_use]
pub fn markdown(names: &[String], rows: &[Row]) -> String {
    let mut out = format!(
        "| rule | {} |\n|---{}|\n",
        names.join(" | "),
        "|---".repeat(names.len())
    );
    for row in rows {
        let verdicts: Vec<&str> = row
            .verdicts
            .iter()
            .map(|verdict| verdict.map_or("-", Verdict::name))
            .collect();
        let _ = writeln!(
            out,
            "| {}{} | {} |",
            if row.same() { "" } else { "* " },
            row.rule,
            verdicts.join(" | ")
        );
    }
    out
}

/// The matrix as a page: counts, then the rules on which the systems differ, then the others.
#[must_use]
pub fn html(names: &[String], reports: &[Report], rows: &[Row]) -> String {
    let mut out = head("Conformance: comparison");
    out.push_str("<h1>Conformance: comparison</h1><table><tr><th></th>");
    for (name, report) in names.iter().zip(reports) {
        let _ = write!(
            out,
            "<th>{}<br><span class=\"small\">catalogue {}{}</span></th>",
            escape(name),
            escape(&report.catalogue.version),
            escape(&report.subject.edition_text())
        );
    }
    out.push_str("</tr>");
    for verdict in Verdict::ALL {
        let _ = write!(out, "<tr><td>{}</td>", badge(verdict));
        for report in reports {
            let count = report.counts.get(verdict.name()).copied().unwrap_or(0);
            let _ = write!(out, "<td>{count}</td>");
        }
        out.push_str("</tr>");
    }
    out.push_str("</table>");
    let (same, differ): (Vec<&Row>, Vec<&Row>) = rows.iter().partition(|row| row.same());
    table(
        &mut out,
        &format!("{} rules differ", differ.len()),
        names,
        &differ,
    );
    table(
        &mut out,
        &format!("{} rules are alike", same.len()),
        names,
        &same,
    );
    out.push_str("</main></body></html>\n");
    out
}

fn table(out: &mut String, title: &str, names: &[String], rows: &[&Row]) {
    let _ = write!(out, "<h2>{title}</h2>");
    if rows.is_empty() {
        return;
    }
    out.push_str("<table><tr><th>rule</th>");
    for name in names {
        let _ = write!(out, "<th>{}</th>", escape(name));
    }
    out.push_str("</tr>");
    for row in rows {
        let _ = write!(
            out,
            "<tr id=\"{0}\"><td><b>{0}</b> {1}</td>",
            escape(&row.rule),
            escape(&row.title)
        );
        for verdict in &row.verdicts {
            let _ = write!(out, "<td>{}</td>", verdict.map_or("-".into(), badge));
        }
        out.push_str("</tr>");
    }
    out.push_str("</table>");
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::catalogue::Catalogue;
    use crate::report::tests::report;

    #[test]
    fn three_systems_stand_beside_each_other() {
        let catalogue = Catalogue::embedded();
        let mut reports = vec![report(&catalogue), report(&catalogue), report(&catalogue)];
        reports[1].subject.name = "Other".into();
        reports[1].rules[20].verdict = Verdict::Fail;
        reports[2].rules.remove(20);
        let files = ["a.json", "b.json", "c.json"].map(str::to_owned);
        let names = names(&reports, &files);
        assert_eq!(
            names,
            ["Acme <VSM> 1.0 (1)", "Other 1.0", "Acme <VSM> 1.0 (3)"]
        );
        let rows = rows(&reports);
        let row = &rows.iter().find(|row| !row.same()).unwrap();
        assert_eq!(row.verdicts[1..], [Some(Verdict::Fail), None]);
        assert!(row.worse());
        let text = markdown(&names, &rows);
        assert!(text.contains(&format!("* {} |", row.rule)), "{text}");
        assert!(text.contains("| fail | - |"), "{text}");
        let page = html(&names, &reports, &rows);
        assert!(
            page.contains("1 rules differ") && page.contains("Acme &lt;VSM&gt;"),
            "{page}"
        );
    }
}
