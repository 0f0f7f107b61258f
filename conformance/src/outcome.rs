//! What follows every run: lines in the terminal, files, the exit status. Shared by the programs of the suite.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::sync::Arc;

use clap::Args;
use sha2::{Digest, Sha256};

use crate::bench::net::{Datagram, Net};
use crate::expected;
use crate::report::{self, Departure, Report, RuleReport};
use crate::verdict::Verdict;

/// Files that a run writes; `None` means the file is not written.
#[derive(Clone, Copy, Debug, Default)]
pub struct Files<'a> {
    /// report.json alone.
    pub json: Option<&'a Path>,
    /// JUnit alone.
    pub junit: Option<&'a Path>,
    /// report.html alone, in brief form.
    pub html: Option<&'a Path>,
    /// The fails of this run as expected departures.
    pub expected: Option<&'a Path>,
    /// A folder for every form of report, and the recording.
    pub folder: Option<&'a Path>,
}

/// Writes a file.
///
/// # Errors
/// It cannot be written: its name, why, and what to do.
pub fn save(path: &Path, bytes: &[u8]) -> Result<(), String> {
    std::fs::write(path, bytes).map_err(|error| cannot_be_written(path, &error))
}

fn cannot_be_written(path: &Path, error: &std::io::Error) -> String {
    let path = path.display();
    format!(
        "{path} cannot be written: {error}; name a place in a folder that can be written, on a disk with free space"
    )
}

impl Files<'_> {
    /// Writes the files.
    ///
    /// # Errors
    /// A file cannot be written: its name and why.
    pub fn write(&self, report: &Report, datagrams: &[Datagram]) -> Result<(), String> {
        if let Some(path) = self.json {
            save(path, report.to_json().as_bytes())?;
        }
        if let Some(path) = self.junit {
            save(path, report::junit::junit(report).as_bytes())?;
        }
        if let Some(path) = self.html {
            let page = report::html::html(report, report::html::Detail::Brief);
            save(path, page.as_bytes())?;
        }
        if let Some(path) = self.expected {
            save(path, expected::from_run(report).as_bytes())?;
        }
        let Some(folder) = self.folder else {
            return Ok(());
        };
        std::fs::create_dir_all(folder).map_err(|error| cannot_be_written(folder, &error))?;
        let capture = report::capture::pcapng(report, datagrams);
        let mut report = report.clone();
        report.hashes.insert("run.pcapng".into(), sha256(&capture));
        save(&folder.join("run.pcapng"), &capture)?;
        save(&folder.join("report.json"), report.to_json().as_bytes())?;
        save(
            &folder.join("report.html"),
            report::html::html(&report, report::html::Detail::Full).as_bytes(),
        )?;
        save(
            &folder.join("junit.xml"),
            report::junit::junit(&report).as_bytes(),
        )?;
        save(
            &folder.join("statement.md"),
            report::statement::statement(&report).as_bytes(),
        )
    }
}

/// Where a report goes, and what of it is expected.
#[derive(Clone, Debug, Args)]
pub struct Outputs {
    /// Departures that are expected, each with its reason (TOML)
    #[arg(long, value_name = "FILE")]
    expected: Option<PathBuf>,
    /// Write the fails of this run as expected departures
    #[arg(long, value_name = "FILE")]
    write_expected: Option<PathBuf>,
    /// Write a JUnit file
    #[arg(long, value_name = "FILE")]
    junit: Option<PathBuf>,
    /// Write report.json, report.html, junit.xml, run.pcapng and statement.md into this folder
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Write report.json to this file
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
    /// Write report.html to this file, with the evidence of fails and warnings only: small enough for documents
    #[arg(long, value_name = "FILE")]
    html: Option<PathBuf>,
}

impl Outputs {
    /// Checks the expected departures before anything is sent.
    ///
    /// # Errors
    /// The file cannot be read, or an entry of it is out of date or not complete.
    pub fn read_expected(&self) -> Result<Vec<Departure>, String> {
        match &self.expected {
            Some(file) => expected::read(file, &today()),
            None => Ok(Vec::new()),
        }
    }

    /// Compares with the expected departures, prints the summary, writes the files; returns the exit status.
    ///
    /// # Errors
    /// A file cannot be written: its name and why.
    pub fn finish(
        &self,
        mut report: Report,
        expected: Vec<Departure>,
        datagrams: &[Datagram],
    ) -> Result<u8, String> {
        report.expected = expected;
        report.count();
        let status = finish(&mut report);
        let files = Files {
            json: self.json.as_deref(),
            junit: self.junit.as_deref(),
            html: self.html.as_deref(),
            expected: self.write_expected.as_deref(),
            folder: self.out.as_deref(),
        };
        files.write(&report, datagrams)?;
        Ok(status)
    }
}

/// Compares with the expected departures and prints the summary. Returns the exit status: 0 as expected, 1 an
/// unexpected fail or an unused entry, 3 nothing could be judged, or a rule failed for which the network may be the
/// cause.
pub fn finish(report: &mut Report) -> u8 {
    let unused = expected::compare(report);
    summary(report);
    for line in &unused {
        eprint(line);
    }
    let unexpected = !report.unexpected().is_empty() || !unused.is_empty();
    match (report.judged(), unexpected) {
        (true, true) => 1,
        (true, false) if !report.excused() => 0,
        _ => 3,
    }
}

/// Runs a program of the suite: parses its command line, calls what it does, returns its exit status.
pub fn program<C: clap::Parser>(
    name: &str,
    carry_out: impl FnOnce(C) -> Result<u8, String>,
) -> ExitCode {
    let arguments = match C::try_parse() {
        Ok(arguments) => arguments,
        Err(error) => {
            let _ = error.print();
            return ExitCode::from(if error.use_stderr() { 2 } else { 0 });
        }
    };
    match carry_out(arguments) {
        Ok(status) => ExitCode::from(status),
        Err(error) => {
            eprint(&format!("{name}: {error}"));
            ExitCode::from(2)
        }
    }
}

/// The line of a judged rule, its id in a column of this width.
pub fn print_rule(rule: &RuleReport, width: usize) {
    let reason = if rule.reason.is_empty() { "" } else { ": " };
    print(&format!(
        "{:<14} {:<width$} {:5.1} s  {}{reason}{}",
        rule.verdict.name(),
        rule.id,
        rule.duration_s,
        rule.title,
        rule.reason
    ));
}

/// Plays one rule many times and counts its verdicts; returns the exit status. A round returns the judged rule, and
/// whether the operator has stopped the run.
///
/// # Errors
/// The error of a round.
pub fn rounds(
    rule: &str,
    times: u32,
    mut round: impl FnMut() -> Result<(Option<RuleReport>, bool), String>,
) -> Result<u8, String> {
    let mut counts: BTreeMap<&str, u32> = BTreeMap::new();
    let mut excused = false;
    for number in 1..=times {
        let (found, interrupted) = round()?;
        let Some(found) = found else { continue };
        excused |= found.excused;
        *counts.entry(found.verdict.name()).or_default() += 1;
        print(&format!(
            "{number}: {} {}",
            found.verdict.name(),
            found.reason
        ));
        if interrupted {
            break;
        }
    }
    print(&format!("{rule}: {counts:?}"));
    let failed = counts.contains_key("fail");
    Ok(if counts.is_empty() || excused && !failed {
        3
    } else {
        u8::from(failed)
    })
}

/// Prints what was judged, in a few lines.
pub fn summary(report: &Report) {
    let shown = |rule: &&RuleReport| rule.verdict.is_fail() || rule.excused;
    for rule in report.rules.iter().filter(shown) {
        print(&format!(
            "{} {} {}: {}",
            rule.verdict.name().to_uppercase(),
            rule.id,
            rule.title,
            rule.reason
        ));
    }
    for remark in &report.remarks {
        print(&format!("remark: {remark}"));
    }
    let counts: Vec<String> = Verdict::ALL
        .iter()
        .filter_map(|verdict| {
            Some(format!(
                "{} {}",
                report.counts.get(verdict.name())?,
                verdict.name()
            ))
        })
        .collect();
    print(&format!(
        "{} rules in {:.0} s: {}",
        report.rules.len(),
        report.duration_s,
        counts.join(", ")
    ));
}

/// SHA-256 in hexadecimal.
#[must_use]
pub fn sha256(bytes: &[u8]) -> String {
    crate::wire::hex(&Sha256::digest(bytes))
}

/// Calls `stop` on Ctrl-C or SIGTERM: a CI job that runs out of time must not leave the subject changed. A second
/// signal ends the program at once.
pub fn on_interrupt(stop: impl FnOnce() + Send + 'static) {
    std::thread::spawn(move || {
        let Ok(runtime) = tokio::runtime::Builder::new_current_thread()
            .enable_all()
            .build()
        else {
            return;
        };
        runtime.block_on(async {
            use tokio::signal::unix::{SignalKind, signal};
            let (Ok(mut interrupt), Ok(mut terminate)) = (
                signal(SignalKind::interrupt()),
                signal(SignalKind::terminate()),
            ) else {
                return;
            };
            tokio::select! { _ = interrupt.recv() => {} _ = terminate.recv() => {} }
            stop();
            tokio::select! { _ = interrupt.recv() => {} _ = terminate.recv() => {} }
            std::process::exit(130);
        });
    });
}

/// Ends every wait of a run on Ctrl-C; a second one ends the program.
pub fn stop_on_interrupt(net: &Arc<Net>) {
    let net = net.clone();
    on_interrupt(move || {
        net.interrupt();
        eprint("interrupted: releasing control; a second signal ends at once");
    });
}

/// The date, `2026-11-22`.
#[must_use]
pub fn today() -> String {
    report::utc(report::now())[..10].to_owned()
}

/// A line of output.
#[allow(clippy::print_stdout, reason = "the program's output")]
pub fn print(line: &str) {
    use std::io::Write;
    // A closed pipe (`| head`) is no reason to panic: the error is ignored.
    let _ = writeln!(std::io::stdout(), "{line}");
}

/// A line on standard error.
#[allow(clippy::print_stderr, reason = "the program's errors")]
pub fn eprint(line: &str) {
    use std::io::Write;
    let _ = writeln!(std::io::stderr(), "{line}");
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_fail_that_the_network_may_have_caused_is_no_success() {
        let rule = |verdict, excused| RuleReport {
            verdict,
            excused,
            ..RuleReport::default()
        };
        let status = |rules: Vec<RuleReport>| {
            finish(&mut Report {
                rules,
                ..Report::default()
            })
        };
        let pass = rule(Verdict::Pass, false);
        let excused = rule(Verdict::Inconclusive, true);
        assert_eq!(status(vec![pass.clone()]), 0);
        assert_eq!(
            status(vec![pass.clone(), rule(Verdict::Inconclusive, false)]),
            0
        );
        assert_eq!(status(vec![pass, excused.clone()]), 3);
        assert_eq!(status(vec![rule(Verdict::Fail, false), excused]), 1);
        let twice = rounds("ACK-007", 2, || {
            Ok((Some(rule(Verdict::Inconclusive, true)), false))
        });
        assert_eq!(twice, Ok(3));
    }
}
