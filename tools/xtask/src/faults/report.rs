//! The table of `cargo xtask faults`, in Markdown.

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::fs;
use std::time::Duration;

use anyhow::Result;

use super::judge::Record;
use super::kind::Kind;
use super::station::Work;

/// What the table says of the run.
#[derive(Debug)]
pub(super) struct Run {
    pub(super) command: String,
    pub(super) took: Duration,
    pub(super) worlds: usize,
    pub(super) vehicles: usize,
    pub(super) left_out: Vec<String>,
}

/// The whole table.
pub(super) fn markdown(run: &Run, records: &[Record]) -> Result<String> {
    let mut by_kind: BTreeMap<Kind, Vec<&Record>> = BTreeMap::new();
    for record in records {
        by_kind.entry(record.kind).or_default().push(record);
    }
    let mut text = String::from(
        "| fault | times | taken over | p50 | p99 | longest | next command p50 | p99 |\n|---|---|---|---|---|---|---|---|\n",
    );
    let all = [("all", records.iter().collect::<Vec<_>>())];
    let kinds = by_kind.into_iter().map(|(kind, of)| (kind.in_words(), of));
    for (name, of) in kinds.chain(all) {
        let taken_over = sorted(of.iter().filter_map(|record| record.taken_over));
        let restored = sorted(of.iter().map(|record| record.restored));
        writeln!(
            text,
            "| {name} | {} | {} | {} | {} | {} | {} | {} |",
            of.len(),
            taken_over.len(),
            at(&taken_over, 50),
            at(&taken_over, 99),
            at(&taken_over, 100),
            at(&restored, 50),
            at(&restored, 99),
        )?;
    }
    let count = |is: fn(&Record) -> bool| records.iter().filter(|record| is(record)).count();
    let altitudes = count(|record| matches!(record.work, Work::Altitude(_)));
    let plans = count(|record| matches!(record.work, Work::Plan(_)));
    let rights = count(|record| matches!(record.work, Work::Right(_)));
    let accepted = count(|record| record.accepted);
    let repeated = count(|record| record.repeated);
    let fenced: u64 = records.iter().map(|record| record.fenced).sum();
    let late: usize = records.iter().map(|record| record.late_answers).sum();
    let contradicted = count(|record| record.contradicted);
    let both = records
        .iter()
        .map(|record| record.both_report)
        .max()
        .unwrap_or_default();
    writeln!(
        text,
        "\nDuring the faults {altitudes} altitudes were commanded, {plans} plans sent and {rights} rights taken or released, {accepted} of them \
         accepted. {repeated} commands reached their vehicle from two nodes, the first one not answered. {fenced} frames of a node that was \
         replaced reached vehicles, all below the stamps of the next one. {late} answers came \
         from a node after the next one had begun to serve, and such a node reported for {:.1} s more at most; {contradicted} commands were \
         refused by it and carried out by the next one.",
        both.as_secs_f64()
    )?;
    let violations = violations(records);
    writeln!(text, "\nViolations: {}.", violations.len())?;
    for violation in violations {
        writeln!(text, "- {violation}")?;
    }
    writeln!(
        text,
        "\n`{}`; {} world(s) side by side, {} vehicles each, {} s; {}.",
        run.command,
        run.worlds,
        run.vehicles,
        run.took.as_secs(),
        machine()
    )?;
    for what in &run.left_out {
        writeln!(text, "\nLeft out: {what}.")?;
    }
    Ok(text)
}

/// All violations, each with its fault.
pub(super) fn violations(records: &[Record]) -> Vec<String> {
    let each = records.iter().flat_map(|record| {
        let line = &record.line;
        record
            .violations
            .iter()
            // What a station has printed behind it is in the log of the run.
            .map(move |violation| violation.lines().next().unwrap_or_default())
            .map(move |violation| format!("{line}: {violation}"))
    });
    each.collect()
}

fn sorted(times: impl Iterator<Item = Duration>) -> Vec<Duration> {
    let mut times: Vec<_> = times.collect();
    times.sort();
    times
}

fn at(sorted: &[Duration], percent: usize) -> String {
    let last = sorted.len().saturating_sub(1);
    // Rounded up: the 99th of a few is the longest.
    let time = sorted.get((last * percent).div_ceil(100));
    time.map_or_else(String::new, |time| format!("{:.2} s", time.as_secs_f64()))
}

fn machine() -> String {
    let cores = std::thread::available_parallelism().map_or(1, usize::from);
    let kernel = fs::read_to_string("/proc/sys/kernel/osrelease").unwrap_or_default();
    let cpu = fs::read_to_string("/proc/cpuinfo").unwrap_or_default();
    let model = cpu
        .lines()
        .find_map(|line| line.strip_prefix("model name")?.split_once(':'));
    let model = model.map_or("", |(_, model)| model.trim());
    format!("{cores} cores ({model}), Linux {}", kernel.trim())
}

/// The document, with what is explained beside the table.
pub(super) fn document(table: &str) -> String {
    format!("{HEAD}\n{table}")
}

const HEAD: &str = "\
# Faults of a fleet, and what they changed

Written by `cargo xtask faults --docs`. [docs/guide/fleet.md](../guide/fleet.md) describes the set-up and what each check reads.

A fault is made under flying vehicles while a station commands, sends a plan, or takes a right; it is healed, the nodes that ended are
started again, and then everything is checked. *Taken over*: until the last vehicle had a frame of the next node. *Next command*: until a
command to a vehicle was carried out, counted from the fault, which includes how long it lasts.
";
