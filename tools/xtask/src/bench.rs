//! `cargo xtask bench`: every bench in one run, and its figures as tables in Markdown.

use std::process::{Command, Stdio};

use anyhow::{Context as _, Result, bail};

use crate::steps::{Steps, cargo, root};

/// Runs the benches and prints the tables to standard output.
#[expect(clippy::print_stdout, reason = "the tables are the product")]
pub(crate) fn run(steps: &mut Steps) -> Result<()> {
    let mut rows = Vec::new();
    let mut tables = String::new();
    for (package, bench) in BENCHES {
        let what = format!("cargo bench -p {package} --bench {bench}");
        let text = steps.step(&what, || output(package, bench))?;
        for line in text.lines() {
            if line.starts_with('|') {
                tables.push_str(line);
                tables.push('\n');
            } else if let Some(found) = peer(line) {
                rows.extend(found);
            }
        }
        rows.extend(criterion(&text));
    }
    println!("| what | time |\n|---|---|");
    for (what, time) in &rows {
        println!("| {what} | {time} |");
    }
    println!("\n{tables}");
    println!("{}", receive_path(&rows));
    println!("{}", added(&tables));
    println!("`cargo xtask bench`, {}", machine());
    Ok(())
}

fn output(package: &str, bench: &str) -> Result<String> {
    let mut command = cargo(["bench", "--locked", "-p", package, "--bench", bench]);
    let done = command
        .current_dir(root())
        .stdin(Stdio::null())
        .stderr(Stdio::inherit())
        .output()
        .context("cargo bench")?;
    if !done.status.success() {
        bail!(
            "cargo bench -p {package} --bench {bench} ended with {}",
            done.status
        );
    }
    Ok(String::from_utf8_lossy(&done.stdout).into_owned())
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

/// Figures of the C library and of pymavlink: `C library 40 receive 812 send 700 (bytes, ns a frame, median)`.
fn peer(line: &str) -> Option<Vec<(String, String)>> {
    let program = ["C library", "pymavlink"];
    let program = program.into_iter().find(|name| line.starts_with(name))?;
    let words: Vec<&str> = line[program.len()..].split_whitespace().collect();
    let (bytes, figures) = words.split_first()?;
    let figures = figures
        .chunks_exact(2)
        .take_while(|pair| pair[1].parse::<f64>().is_ok());
    let row = |pair: &[&str]| {
        (
            format!("{program} {} {bytes}", pair[0]),
            format!("{} ns", pair[1]),
        )
    };
    Some(figures.map(row).collect())
}

/// What the receive path takes of the C library's time in the same run; the goal is a third.
fn receive_path(rows: &[(String, String)]) -> String {
    let time = |name: String| {
        let (_, time) = rows.iter().find(|(what, _)| *what == name)?;
        nanoseconds(time)
    };
    let parts = [40, 266].map(|bytes| {
        let ours = time(format!("ours receive {bytes}"));
        let theirs = time(format!("C library receive {bytes}"));
        match ours.zip(theirs) {
            Some((ours, theirs)) => format!("{:.2} at {bytes} bytes", ours / theirs),
            None => format!("not measured at {bytes} bytes"),
        }
    });
    format!(
        "Receive path, as a part of the C library's time (the goal: at most 0.33): {}",
        parts.join(", ")
    )
}

/// What the bridge adds to a bare echo at 1,000 messages a second; the goal is under 150 us at the 99th percentile.
fn added(tables: &str) -> String {
    let row = tables
        .lines()
        .find(|line| line.contains("1000/s") && line.contains("3001"));
    let p99 = row.and_then(|line| line.split('|').nth(7));
    format!(
        "Added by the bridge at 1,000 messages/s, p99 (the goal: under 150 us):{}",
        p99.unwrap_or(" not measured")
    )
}

/// `1.5 us` as 1500.
fn nanoseconds(time: &str) -> Option<f64> {
    let (figure, unit) = time.split_once(' ')?;
    let factor = match unit {
        "ps" => 1e-3,
        "ns" => 1.0,
        "us" | "µs" | "μs" => 1e3,
        "ms" => 1e6,
        _ => return None,
    };
    Some(figure.parse::<f64>().ok()? * factor)
}

/// Processor, cores, compiler and how busy the machine is.
fn machine() -> String {
    let read = |path: &str| std::fs::read_to_string(path).unwrap_or_default();
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

const BENCHES: [(&str, &str); 8] = [
    ("stanag-msgs", "codec"),
    ("comparison-benches", "signing"),
    ("comparison-benches", "per_message"),
    ("comparison-benches", "radio"),
    ("vsm", "bridge"),
    ("vsm", "sockets"),
    ("vsm", "protected"),
    ("vsm", "fleet"),
];

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn figures_of_criterion_and_of_peers_are_read() {
        let text = "decode 4000   time:   [1.0 ns 2.5 ns 3.0 ns]\na long name\n          time:   [1 us 2 us 3 us]\n";
        let pair = |a: &str, b: &str| (a.to_owned(), b.to_owned());
        let expected = [pair("decode 4000", "2.5 ns"), pair("a long name", "2 us")];
        assert_eq!(criterion(text), expected);
        let line = "C library 40 receive 812 send 700 (bytes, ns a frame, median)";
        let expected = vec![
            pair("C library receive 40", "812 ns"),
            pair("C library send 40", "700 ns"),
        ];
        assert_eq!(peer(line), Some(expected));
        assert_eq!(peer("other"), None);
    }

    #[test]
    fn the_goals_are_told() {
        let row = |what: &str, time: &str| (what.to_owned(), time.to_owned());
        let rows = [
            row("ours receive 40", "0.3 µs"),
            row("C library receive 40", "1000 ns"),
        ];
        let text = receive_path(&rows);
        assert!(
            text.ends_with("0.30 at 40 bytes, not measured at 266 bytes"),
            "{text}"
        );
        let table = "| mode change to 3001, 1000/s | 60 us | 120 us | 20 us | 21 us | 40 us | 99 us | 30 us | 0 of 3000 |\n";
        assert!(added(table).ends_with(": 99 us "), "{}", added(table));
    }
}
