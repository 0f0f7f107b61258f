//! `kill -9` at random moments: the bridge, the agent or both, in flights with handovers, uploads and new keys. Nothing that
//! was acknowledged is lost, nothing is done twice, one station or none is in control, and both ends have one key.
//!
//! A handful here; `cargo xtask kill --times 1000` runs as many as that, several vehicles side by side, and prints the
//! table of docs/guide/reliability.md.

mod crew;
mod model;
mod tap;

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::sync::atomic::{AtomicUsize, Ordering::Relaxed};
use std::thread;
use std::time::{Duration, Instant};

use crew::Crew;

/// What was killed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Victim {
    Bridge,
    Agent,
    Both,
}

/// One kill.
#[derive(Debug, Clone, Copy)]
struct Kill {
    /// What was under way.
    doing: &'static str,
    victim: Victim,
    /// A key was agreed on at one end or both and not in force yet.
    between_keys: bool,
}

/// What came of the kills of all vehicles.
#[derive(Debug, Default)]
struct Report {
    kills: Vec<Kill>,
    faults: Vec<String>,
    carried_out: usize,
    refused: usize,
    keys: usize,
    setups: usize,
    longest: Duration,
}

impl Report {
    fn add(&mut self, crew: Crew) {
        self.carried_out += crew.carried_out;
        self.refused += crew.refused;
        self.keys += crew.keys.len();
        self.setups += crew.setups();
        self.longest = self.longest.max(crew.longest);
        self.kills.extend(crew.kills);
        self.faults.extend(crew.faults);
    }

    fn table(&self, took: Duration) -> String {
        let mut rows: BTreeMap<&str, [usize; 5]> = BTreeMap::new();
        for kill in &self.kills {
            let row = rows.entry(kill.doing).or_default();
            row[0] += 1;
            row[1 + kill.victim as usize] += 1;
            row[4] += usize::from(kill.between_keys);
        }
        let mut text = String::from(
            "| killed during | kills | bridge | agent | both | of these between two keys |\n|---|---|---|---|---|---|\n",
        );
        let mut sum = [0; 5];
        for (doing, row) in rows {
            let [all, bridge, agent, both, keys] = row;
            let _ = writeln!(
                text,
                "| {doing} | {all} | {bridge} | {agent} | {both} | {keys} |"
            );
            for (sum, one) in sum.iter_mut().zip(row) {
                *sum += one;
            }
        }
        let [all, bridge, agent, both, keys] = sum;
        let _ = writeln!(
            text,
            "| all | {all} | {bridge} | {agent} | {both} | {keys} |"
        );
        let Report {
            carried_out,
            refused,
            keys,
            setups,
            longest,
            faults,
            ..
        } = self;
        let _ = writeln!(
            text,
            "{carried_out} orders and requests carried out, {refused} refused; {keys} keys seen in force at both ends, \
             {setups} SETUP_SIGNINGs; link and key in order again after {:.1} s at most; {} faults; {:.0} s",
            longest.as_secs_f64(),
            faults.len(),
            took.as_secs_f64()
        );
        text
    }
}

/// A message with the fields that it has.
fn short(message: &stanag_msgs::Message) -> String {
    let text = format!("{message:?}");
    let fields = text.split(", ").filter(|field| !field.contains(": None"));
    fields.collect::<Vec<_>>().join(", ")
}

#[test]
#[expect(
    clippy::print_stderr,
    reason = "the table is printed for whoever reads the test"
)]
fn whatever_is_killed_nothing_is_lost_or_done_twice() {
    let number = |name: &str| std::env::var(name).ok()?.parse::<u64>().ok();
    let times = number("VSM_KILLS").unwrap_or(3) as usize;
    let side_by_side = number("VSM_KILLS_SIDE_BY_SIDE").unwrap_or(1);
    let seed = number("VSM_SEED").unwrap_or(4_586);
    eprintln!("VSM_SEED={seed}");
    let (begun, killed) = (Instant::now(), AtomicUsize::new(0));
    let mut report = Report::default();
    thread::scope(|scope| {
        let vehicles: Vec<_> = (0..side_by_side)
            .map(|n| {
                let killed = &killed;
                scope.spawn(move || fly(seed.wrapping_mul(31).wrapping_add(n), times, killed))
            })
            .collect();
        for vehicle in vehicles {
            let crews = vehicle.join().expect("its own panic is above");
            crews.into_iter().for_each(|crew| report.add(crew));
        }
    });
    eprintln!("{}", report.table(begun.elapsed()));
    assert!(report.faults.is_empty(), "{}", report.faults.join("\n"));
}

/// Kills until `times` are reached by all together. After a fault a new vehicle begins, so that one fault is one.
#[expect(
    clippy::print_stderr,
    reason = "a run of an hour shows that it continues, and a fault at once"
)]
fn fly(seed: u64, times: usize, killed: &AtomicUsize) -> Vec<Crew> {
    let mut crews = Vec::new();
    let mut left = true;
    while left {
        let seed = seed.wrapping_add(1_000 * crews.len() as u64);
        let mut crew = Crew::start(seed, times >= 20);
        while crew.faults.is_empty() {
            let before = crew.kills.len();
            crew.survive_one();
            let all = killed.fetch_add(crew.kills.len() - before, Relaxed);
            let all = all + crew.kills.len() - before;
            if all / 50 > (all - (crew.kills.len() - before)) / 50 {
                eprintln!("{all} kills");
            }
            left = all < times;
            if !left {
                break;
            }
        }
        for fault in &crew.faults {
            eprintln!("FAULT (seed {seed}): {fault}");
        }
        if !crew.faults.is_empty() {
            let last = crew.history.len().saturating_sub(HISTORY);
            eprintln!("{}", crew.history[last..].join("\n"));
        }
        crews.push(crew);
    }
    crews
}

/// Lines of what happened before a fault.
const HISTORY: usize = 60;
