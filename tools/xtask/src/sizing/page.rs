//! The page of `cargo xtask sizing`, in Markdown.

use std::fmt::Write as _;

use anyhow::Result;

use super::costs::{
    CEILING_BYTES, CEILINGS_S, CHANGES, COMMAND_BYTES, COMMANDS_S, DATAGRAM_BYTES, ETCD_S, FILES,
    FRAMES_S, GIB, LONGEST_S, LOSS_S, MEASURED_WITH, MESSAGES_S, NODE_CORES, READ_S, REPORTS_S,
    ROOM_S, SEALS, TRIALS, WRITE_S, YEAR_S,
};
use super::fleet::Fleet;
use super::simulation::{Deaths, at, ceilings, deaths};
use crate::faults::Dice;

/// The whole page.
pub(super) fn markdown(fleet: &Fleet, seed: u64) -> Result<String> {
    let mut dice = Dice::new(seed);
    let events = [1, 2, fleet.nodes].map(|dead| deaths(fleet, dead, &mut dice));
    let (of_vsm, vsms) = (f64::from(fleet.of_vsm), f64::from(fleet.vsms()));
    let mut text = String::from(HEAD);
    let Fleet {
        vehicles, nodes, ..
    } = fleet;
    writeln!(
        text,
        "`cargo xtask sizing --vehicles {vehicles} --nodes {nodes} --of-vsm {} --seed {seed}`: {} VSMs.\n\n## Each node\n",
        fleet.of_vsm,
        fleet.vsms()
    )?;
    let full = |event: &Deaths| at(&event.fullest, 0.99);
    let columns = [vsms / f64::from(*nodes), full(&events[0]), full(&events[1])];
    writeln!(
        text,
        "| | all nodes are there | one is dead, the fullest other (p99) | two are dead, the fullest other (p99) |\n|---|---|---|---|"
    )?;
    let reports = fleet.vsm_datagrams();
    let (ceiling_writes, _) = ceilings(fleet.of_vsm, WRITE_S);
    let rows = [
        ("VSMs that it serves", 1.0, 0),
        ("vehicles", of_vsm, 0),
        ("CPU, % of a core", fleet.vsm_core(), 0),
        (
            "memory of the VSMs that it serves, MB",
            fleet.vsm_memory(),
            0,
        ),
        ("frames/s from vehicles", of_vsm * FRAMES_S, 0),
        ("datagrams/s to stations", reports, 0),
        (
            "Mbit/s to stations",
            reports * DATAGRAM_BYTES * 8.0 / 1e6,
            1,
        ),
        (
            "writes/s to etcd",
            ceiling_writes + 2.0 * COMMANDS_S * of_vsm,
            0,
        ),
    ];
    for (name, of_one, digits) in rows {
        let [all, one, two] = columns.map(|count| grouped(of_one * count, digits));
        writeln!(text, "| {name} | {all} | {one} | {two} |")?;
    }
    writeln!(
        text,
        "\n## When nodes die\n\n| | VSMs that change, a trial | taken over p50 | p99 | the last VSM p50 | p99 | later than 10 s | no node left, of all VSMs |\n|---|---|---|---|---|---|---|---|"
    )?;
    let names = ["one node dies", "two at once", "all restart at once"];
    for (name, event) in names.iter().zip(&events) {
        let changed = event.taken_over.len() as f64;
        let late = event.taken_over.iter().filter(|took| **took > LOSS_S);
        writeln!(
            text,
            "| {name} | {:.1} | {:.2} s | {:.2} s | {:.2} s | {:.2} s | {:.2} % | {:.3} % |",
            changed / f64::from(TRIALS),
            at(&event.taken_over, 0.5),
            at(&event.taken_over, 0.99),
            at(&event.last, 0.5),
            at(&event.last, 0.99),
            100.0 * late.count() as f64 / changed.max(1.0),
            100.0 * f64::from(event.without) / (vsms * f64::from(TRIALS)),
        )?;
    }
    writeln!(
        text,
        "\n## The size of a VSM\n\n| vehicles of a VSM | VSMs | CPU of a node, % of a core | memory of a node, MB | ceilings are stored within | taken over p50 | p99 | `fleet.key` lasts, years |\n|---|---|---|---|---|---|---|---|"
    )?;
    for of_vsm in [50, 100, 250, 500, 1_000, 2_000] {
        let other = Fleet { of_vsm, ..*fleet };
        let taken_over = deaths(&other, 1, &mut dice).taken_over;
        let on_node = f64::from(other.vsms()) / f64::from(*nodes);
        let writes = (CEILINGS_S + 2.0 * COMMANDS_S) * f64::from(of_vsm);
        writeln!(
            text,
            "| {} | {} | {} | {} | {:.2} s | {:.2} s | {:.2} s | {:.1} |",
            grouped(of_vsm.into(), 0),
            grouped(other.vsms().into(), 0),
            grouped(on_node * other.vsm_core(), 0),
            grouped(on_node * other.vsm_memory(), 0),
            ceilings(of_vsm, WRITE_S).1,
            at(&taken_over, 0.5),
            at(&taken_over, 0.99),
            SEALS / (2.0 * writes * YEAR_S),
        )?;
    }
    writeln!(
        text,
        "\n## What breaks first\n\n| at vehicles | what |\n|---|---|"
    )?;
    for (vehicles, what) in limits(fleet) {
        writeln!(text, "| {} | {what} |", grouped(vehicles, 0))?;
    }
    write!(text, "\n{SOURCES}")?;
    Ok(text)
}

/// How many vehicles the fleet has when this breaks, and what it is.
fn limits(fleet: &Fleet) -> Vec<(f64, String)> {
    let (vsms, of_vsm) = (f64::from(fleet.vsms()), f64::from(fleet.of_vsm));
    let growth = CEILINGS_S * CEILING_BYTES + COMMANDS_S * COMMAND_BYTES;
    let history = |quota: f64, retention_s: f64| quota / (2.0 * retention_s * growth);
    let seconds_left = LOSS_S - LONGEST_S;
    let restored = seconds_left / (FILES * READ_S + WRITE_S) + f64::from(MEASURED_WITH);
    let writes = CEILINGS_S + 2.0 * COMMANDS_S;
    let stored = ROOM_S / WRITE_S;
    let shown = MESSAGES_S / REPORTS_S;
    let sealed = SEALS / (2.0 * writes * YEAR_S);
    let mut limits = vec![
        (
            history(2.0 * GIB, 3_600.0),
            "**etcd's database is full**, with its own quota of 2 GiB and `--auto-compaction-retention=1h`: nothing can be stored, \
             and every VSM loses its vehicles within 10 s"
                .to_owned(),
        ),
        (
            history(8.0 * GIB, 300.0),
            "etcd's database is full, with `--quota-backend-bytes=8589934592 --auto-compaction-retention=5m`"
                .to_owned(),
        ),
        (
            vsms * shown,
            format!(
                "{shown:.0} in a VSM: a station that has all of them is sent less than is due, with `dli.max_messages_s` unset (1000)"
            ),
        ),
        (
            1e8 / (REPORTS_S * DATAGRAM_BYTES * 8.0),
            "the link of 100 Mbit/s of one station that has all vehicles is full, limits raised".to_owned(),
        ),
        (
            f64::from(fleet.nodes) * NODE_CORES * 100.0 * of_vsm / fleet.vsm_core(),
            "nodes of two cores are busy, none of them dead".to_owned(),
        ),
        (
            vsms * restored,
            format!("{restored:.0} in a VSM: the slowest take-over lasts longer than 10 s (`COM_DL_LOSS_T`)"),
        ),
        (
            vsms * stored,
            format!("{stored:.0} in a VSM: its ceilings are stored more slowly than they are needed, 4 s ahead, and frames wait"),
        ),
        (
            ETCD_S / CHANGES / writes,
            "etcd takes no more writes: the published ones are of one change, ours of four".to_owned(),
        ),
        (
            vsms * sealed,
            format!("{sealed:.0} in a VSM: its `fleet.key` has sealed 2^32 values within a year; with one key for all VSMs, {sealed:.0} in all"),
        ),
    ];
    limits.sort_by(|one, other| one.0.total_cmp(&other.0));
    limits
}

/// A number with commas.
fn grouped(value: f64, digits: usize) -> String {
    let text = format!("{value:.digits$}");
    let whole = text.split('.').next().unwrap_or_default().len();
    let mut out = String::new();
    for (index, sign) in text.chars().enumerate() {
        if index > 0 && index < whole && (whole - index).is_multiple_of(3) {
            out.push(',');
        }
        out.push(sign);
    }
    out
}

const HEAD: &str = "\
# The size of a fleet

Written by `cargo xtask sizing --docs`. Calculated and simulated from measured costs, not measured: no fleet of this size has been run.
[docs/guide/fleet.md](../guide/fleet.md#ten-thousand-vehicles) says what follows from it.

The unit is the VSM: a process that serves its vehicles on one node, and stands by on two others.

";

const SOURCES: &str = "\
## Where the figures are from

| figure | from |
|---|---|
| CPU and memory of a process: the line through 26 % and 28 MB (200 vehicles), 85 % and 83 MB (1,000), each vehicle 41 frames/s, three CUCSs held to 1,000 messages/s | `cargo bench -p vsm --bench fleet`, one run on two cores; below 200 and above 1,000 the line is continued |
| 13.5 reports/s of a vehicle to each station | `VSM_FLEET_MINUTES=60 cargo test -p vsm --test hot_path memory`: 2,430,100 reports of 50 vehicles in an hour |
| 107 bytes a datagram | message tables, every field present; CRC-32, UDP, IPv4, Ethernet; `pack` is off |
| taken over with three vehicles: 74 take-overs that nobody ordered, drawn by kind of fault, p50 2.74 to 3.03 s, longest 6.04 s; straight lines between the shortest (2 s, what is left of a lease), the median and the longest of a kind | `cargo xtask faults --times 220 --seed 4588 --vehicles 3 --side-by-side 4`; `store.lease_s = 3` |
| beyond it, for each vehicle: six reads of 0.7 ms, a write of 1.6 ms and an fsync of 1 ms | the code; etcd's page *Performance* |
| a ceiling each 6 s for each vehicle, 541 bytes of database | `mavlink-link/src/signing/clock.rs`; 2,500 such requests to etcd 3.4.23, one member, in memory |
| a command a minute for each vehicle, two writes, 3,130 bytes | assumed; not measured |
| history of up to twice the retention: etcd compacts once in that time, what is older than it | watched: etcd 3.4.23, a retention of 20 s |
| 44,341 writes/s, 141,578 reads/s; quota of 2 GiB, 8 GiB suggested at most; 1.5 MiB a request, of which ours has 90 kB at most | etcd's pages *Performance* and *System limits* |
| 2^32 values sealed with a key, two for each write | NIST SP 800-38D, 8.3 |

Not in it: processes that stand by (four reads of etcd each 250 ms), what a report costs beyond the default limits, computers that compete for CPU while
they take over, radios.
";

#[cfg(test)]
mod tests {
    use super::super::fleet::FLEET;
    use super::*;

    #[test]
    fn what_breaks_first_comes_first() {
        let limits = limits(&FLEET);
        assert!(limits.is_sorted_by_key(|(vehicles, _)| *vehicles));
        assert!(limits[0].1.contains("database is full"), "{limits:?}");
        // Four times the quota, a twelfth of the history.
        let later = limits.iter().find(|(_, what)| what.contains("5m"));
        let times = later.map(|(vehicles, _)| vehicles / limits[0].0);
        assert!(
            times.is_some_and(|times| (times - 48.0).abs() < 1e-6),
            "{times:?}"
        );
    }

    #[test]
    fn the_same_seed_writes_the_same_page() {
        let page = |seed| markdown(&FLEET, seed).unwrap_or_default();
        assert_eq!(page(1), page(1));
        assert_ne!(page(1), page(2));
        assert!(page(1).contains("| vehicles | 500 |"), "{}", page(1));
        assert!(page(1).contains("| frames/s from vehicles | 20,500 |"));
    }

    #[test]
    fn numbers_have_commas_between_thousands() {
        let written = [(0.4, 0), (999.6, 0), (1_234_567.0, 0), (12_345.67, 1)];
        let written = written.map(|(value, digits)| grouped(value, digits));
        assert_eq!(written, ["0", "1,000", "1,234,567", "12,345.7"]);
    }
}
