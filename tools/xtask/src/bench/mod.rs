//! `cargo xtask bench`: the benches in one run, their figures as tables in Markdown, and what they are held against.
//!
//! A bench prints its tables as Markdown; beside them a line `figure NAME MEDIAN MIN MAX` for each figure that [`goals`] may
//! know, and a line `note: ...` for what a reader of the tables has to know, such as a program that is not here.

mod goals;
mod plot;

use std::fs;
use std::process::{Command, Stdio};

use anyhow::{Context as _, Result, bail};

use self::goals::Figures;
use crate::peers;
use crate::steps::{Steps, cargo, root};

/// Runs the benches and prints the tables to standard output; with `--table` those that a goal is of, with `--docs` into the
/// documents too.
#[expect(clippy::print_stdout, reason = "the tables are the product")]
pub(crate) fn run(steps: &mut Steps) -> Result<()> {
    let has = |option: &str| std::env::args().any(|argument| argument == option);
    let (table, docs) = (has("--table"), has("--docs"));
    if let Err(error) = peers::install(steps) {
        steps.leave_out(format!("pymavlink and MAVSDK: {error:#}"));
    }
    let mut printed = Printed::default();
    for bench in BENCHES {
        if bench.has_goals || !(table || docs) {
            let text = steps.step(&bench.name(), || bench.run())?;
            printed.add(&text);
        }
    }
    for note in &printed.notes {
        if let Some(what) = note.strip_prefix("LEFT OUT: ") {
            steps.leave_out(what);
        }
    }
    let goals = goals::table(&printed.figures);
    println!("{goals}");
    println!("{}", printed.body());
    println!("{}", machine());
    if docs {
        write(&printed, &goals)?;
    }
    Ok(())
}

/// Writes the page and its picture.
fn write(printed: &Printed, goals: &str) -> Result<()> {
    let page = format!(
        "# Performance, measured\n\n\
         `cargo xtask bench --docs` writes this page: {}. Each figure is the median of turns in random order, with the least and the \
         greatest beside it; a ratio is taken within a turn. What the rows mean: [the guide](../guide/performance.md).\n\n\
         ![each figure as a part of its goal](../img/performance.svg)\n\n{goals}\n{}",
        machine(),
        printed.body()
    );
    let docs = root().join("docs");
    let files = [
        ("reference/performance.md", page),
        (
            "img/performance.svg",
            plot::draw(&goals::shares(&printed.figures)),
        ),
    ];
    for (name, text) in files {
        fs::write(docs.join(name), text).with_context(|| format!("docs/{name}"))?;
    }
    Ok(())
}

struct Bench {
    package: &'static str,
    bench: &'static str,
    options: &'static [&'static str],
    /// Whether a goal is of one of its figures.
    has_goals: bool,
}

impl Bench {
    const fn of(package: &'static str, bench: &'static str, has_goals: bool) -> Bench {
        Bench {
            package,
            bench,
            options: &[],
            has_goals,
        }
    }

    fn command(&self) -> Command {
        let Bench { package, bench, .. } = self;
        let mut command = cargo(["bench", "--locked", "-p", package, "--bench", bench]);
        command.arg("--").args(self.options);
        command
    }

    fn name(&self) -> String {
        let Bench { package, bench, .. } = self;
        format!("cargo bench -p {package} --bench {bench}")
    }

    fn run(&self) -> Result<String> {
        let done = self
            .command()
            .current_dir(root())
            .stdin(Stdio::null())
            .stderr(Stdio::inherit())
            .output()
            .context("cargo bench")?;
        if !done.status.success() {
            bail!("{} ended with {}", self.name(), done.status);
        }
        Ok(String::from_utf8_lossy(&done.stdout).into_owned())
    }
}

/// The receive path against a bound, as a ratio to what it cannot do without: for CI.
pub(crate) fn check(steps: &mut Steps) -> Result<()> {
    let bench = Bench {
        options: &["--check"],
        ..Bench::of("mavlink-link", "frames", false)
    };
    steps.run(&mut bench.command())
}

/// What the benches have printed.
#[derive(Debug, Default)]
struct Printed {
    /// Criterion's: what, and the time.
    times: Vec<(String, String)>,
    /// In Markdown, an empty line between them.
    tables: String,
    figures: Figures,
    notes: Vec<String>,
}

impl Printed {
    fn add(&mut self, text: &str) {
        let mut lines = text.lines().peekable();
        while let Some(line) = lines.next() {
            if line.starts_with('|') {
                let is_head = lines.peek().is_some_and(|next| next.starts_with("|---"));
                if is_head && !self.tables.is_empty() {
                    self.tables.push('\n');
                }
                self.tables.push_str(line);
                self.tables.push('\n');
            } else if let Some(note) = line.strip_prefix("note: ") {
                self.notes.push(note.to_owned());
            } else {
                self.figures.add(line);
            }
        }
        self.times.extend(criterion(text));
    }

    /// Everything but the goals.
    fn body(&self) -> String {
        let mut out = String::new();
        for note in &self.notes {
            out += &format!("- {note}\n");
        }
        out += &format!("\n{}", self.tables);
        if !self.times.is_empty() {
            out += "\n| what | time |\n|---|---|\n";
            for (what, time) in &self.times {
                out += &format!("| {what} | {time} |\n");
            }
        }
        out
    }
}

/// Criterion's results: a name, on the same line or the one before, and `time: [low middle high]`.
fn criterion(text: &str) -> Vec<(String, String)> {
    let mut found = Vec::new();
    let mut before = "";
    for line in text.lines() {
        if let Some((name, rest)) = line.split_once("time:") {
            let name = if name.trim().is_empty() { before } else { name };
            let figures: Vec<&str> = rest.trim().trim_matches(['[', ']']).split(' ').collect();
            if let [_, _, middle, unit, ..] = figures[..] {
                found.push((name.trim().to_owned(), format!("{middle} {unit}")));
            }
        }
        before = line;
    }
    found
}

/// Processor, cores, compiler and how busy the machine is.
fn machine() -> String {
    let read = |path: &str| fs::read_to_string(path).unwrap_or_default();
    let cpu = read("/proc/cpuinfo");
    let model = cpu
        .lines()
        .find_map(|line| line.strip_prefix("model name")?.split_once(": "));
    let model = model.map_or("unknown processor", |(_, name)| name);
    let cores = std::thread::available_parallelism().map_or(1, usize::from);
    let load = read("/proc/loadavg");
    let load = load.split(' ').next().unwrap_or("unknown");
    let compiler = Command::new("rustc").arg("--version").output();
    let compiler = compiler.map(|done| String::from_utf8_lossy(&done.stdout).trim().to_owned());
    format!(
        "{model}, {cores} cores, {}, load {load} at the end",
        compiler.unwrap_or_default()
    )
}

const BENCHES: [Bench; 12] = [
    Bench::of("mavlink-link", "frames", true),
    Bench::of("vsm", "beside", true),
    Bench::of("vsm", "sockets", true),
    Bench::of("vsm", "flight", true),
    Bench::of("vsm", "fleet", true),
    Bench::of("vsm", "footprint", false),
    Bench::of("vsm", "protected", false),
    Bench::of("vsm", "bridge", false),
    Bench::of("stanag-msgs", "codec", false),
    Bench::of("comparison-benches", "signing", false),
    Bench::of("comparison-benches", "per_message", false),
    Bench::of("comparison-benches", "radio", false),
];

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn figures_of_criterion_are_read() {
        let text = "decode 4000   time:   [1.0 ns 2.5 ns 3.0 ns]\na long name\n          time:   [1 us 2 us 3 us]\n";
        let pair = |a: &str, b: &str| (a.to_owned(), b.to_owned());
        let expected = [pair("decode 4000", "2.5 ns"), pair("a long name", "2 us")];
        assert_eq!(criterion(text), expected);
    }

    #[test]
    fn tables_stand_apart_and_notes_and_figures_are_kept() {
        let mut printed = Printed::default();
        printed.add("| a |\n|---|\n| 1 |\n| b |\n|---|\n| 2 |\nnote: LEFT OUT: a program\nfigure idle-wakeups 2.0 1.0 3.0\n");
        printed.add("Running benches\n| c |\n|---|\n| 3 |\n");
        assert_eq!(
            printed.tables,
            "| a |\n|---|\n| 1 |\n\n| b |\n|---|\n| 2 |\n\n| c |\n|---|\n| 3 |\n"
        );
        assert_eq!(printed.notes, ["LEFT OUT: a program"]);
        assert!(goals::table(&printed.figures).contains("2.0 (1.0 to 3.0)"));
        assert!(printed.body().starts_with("- LEFT OUT: a program\n\n| a |"));
    }
}
