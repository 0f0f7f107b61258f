//! What follows every run: lines in the terminal, files, the exit status. Shared by the programs of the suite.

use std::path::Path;
use std::sync::Arc;

use sha2::{Digest, Sha256};

use crate::bench::net::{Datagram, Net};
use crate::expected;
use crate::report::{self, Report};
use crate::verdict::Verdict;

/// Files that a run writes; none where `None`.
#[derive(Clone, Copy, Debug, Default)]
pub struct Files<'a> {
    /// report.json alone.
    pub json: Option<&'a Path>,
    /// JUnit alone.
    pub junit: Option<&'a Path>,
    /// report.html alone, brief.
    pub html: Option<&'a Path>,
    /// The fails of this run as expected departures.
    pub expected: Option<&'a Path>,
    /// A folder for every form of report, and the recording.
    pub folder: Option<&'a Path>,
}

impl Files<'_> {
    /// Writes them.
    ///
    /// # Errors
    /// A file cannot be written: its name and why.
    pub fn write(&self, report: &Report, datagrams: &[Datagram]) -> Result<(), String> {
        let file = |path: &Path, bytes: &[u8]| {
            std::fs::write(path, bytes).map_err(|error| format!("{}: {error}", path.display()))
        };
        if let Some(path) = self.json {
            file(path, report.to_json().as_bytes())?;
        }
        if let Some(path) = self.junit {
            file(path, report::junit::junit(report).as_bytes())?;
        }
        if let Some(path) = self.html {
            let page = report::html::html(report, report::html::Detail::Brief);
            file(path, page.as_bytes())?;
        }
        if let Some(path) = self.expected {
            file(path, expected::from_run(report).as_bytes())?;
        }
        let Some(folder) = self.folder else {
            return Ok(());
        };
        std::fs::create_dir_all(folder)
            .map_err(|error| format!("{}: {error}", folder.display()))?;
        let capture = report::capture::pcapng(report, datagrams);
        let mut report = report.clone();
        report.hashes.insert("run.pcapng".into(), sha256(&capture));
        file(&folder.join("run.pcapng"), &capture)?;
        file(&folder.join("report.json"), report.to_json().as_bytes())?;
        file(
            &folder.join("report.html"),
            report::html::html(&report, report::html::Detail::Full).as_bytes(),
        )?;
        file(
            &folder.join("junit.xml"),
            report::junit::junit(&report).as_bytes(),
        )?;
        file(
            &folder.join("statement.md"),
            report::statement::statement(&report).as_bytes(),
        )
    }
}

/// Compares with the expected departures, prints the summary; the exit status: 0 as expected, 1 an unexpected fail or an
/// entry that is not needed, 3 nothing could be judged.
pub fn finish(report: &mut Report) -> u8 {
    let unused = expected::compare(report);
    summary(report);
    for line in &unused {
        eprint(line);
    }
    if !report.judged() {
        3
    } else {
        u8::from(!report.unexpected().is_empty() || !unused.is_empty())
    }
}

/// What was judged, in a few lines.
pub fn summary(report: &Report) {
    for rule in report.rules.iter().filter(|rule| rule.verdict.is_fail()) {
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

/// Calls `stop` on Ctrl-C or SIGTERM: a CI that is out of time must not leave a subject changed. A second signal ends the
/// program at once.
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
    // A closed pipe (`| head`) is no reason to panic.
    let _ = writeln!(std::io::stdout(), "{line}");
}

/// A line on standard error.
#[allow(clippy::print_stderr, reason = "the program's errors")]
pub fn eprint(line: &str) {
    use std::io::Write;
    let _ = writeln!(std::io::stderr(), "{line}");
}
