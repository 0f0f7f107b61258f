//! `cargo xtask faults`: a fleet of three nodes and three members of etcd in network namespaces, faults at random under
//! flying vehicles, and what must not happen, judged from the wire.
//!
//! Read in this order: `network` (hosts, switches, cuts), `world` (who runs on them), `station` (what is done meanwhile, and
//! what must be kept), `kind` (the faults), `wire` and `capture` (the evidence), `judge` (one fault and its verdict),
//! `report` (the table). It needs root, `ip` and `etcd`; clock steps need libfaketime, slow disks strace.
//!
//! What it makes is gone when it ends, also by a violation or Ctrl-C: the work is done by a process of its own, in a group of its own,
//! that cleans up as soon as the pipe to it closes, however that came about.

mod capture;
mod draw;
mod judge;
mod kind;
mod network;
mod process;
mod report;
mod station;
mod wire;
mod world;

use std::fs;
use std::io::Read as _;
use std::os::unix::process::CommandExt as _;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Mutex, PoisonError};
use std::thread;
use std::time::{Instant, SystemTime, UNIX_EPOCH};

use anyhow::{Context as _, Result, anyhow, bail};

pub(crate) use self::draw::Dice;
use self::judge::Record;
use self::kind::Kind;
use self::station::Stations;
use self::world::World;
use crate::kill::number;
use crate::steps::{Steps, is_there, option, root};
use crate::tests;

/// Builds the programs, unless `--bins DIR` names them, and makes `--times N` faults (1,000) in `--side-by-side N` worlds (1).
pub(crate) fn run(steps: &mut Steps) -> Result<()> {
    if flag(WORKER) {
        return work();
    }
    if let Some(missing) = missing() {
        return steps.missing(format!("{missing}: no faults are made"));
    }
    if option("--bins").is_none() {
        tests::build(steps)?;
    }
    for (kind, needs) in left_out() {
        steps.missing(format!(
            "{needs} is not installed: not made: {}",
            kind.in_words()
        ))?;
    }
    let own = std::env::current_exe().context("the path of xtask")?;
    let mut worker = Command::new(own);
    worker.args(std::env::args().skip(1)).arg(WORKER);
    steps.step("faults", || {
        // Ctrl-C reaches this process alone, and the other one by the end of the pipe.
        let mut worker = worker.stdin(Stdio::piped()).process_group(0).spawn()?;
        let pipe = worker.stdin.take();
        let status = worker.wait()?;
        drop(pipe);
        if !status.success() {
            bail!("the faults ended with {status}");
        }
        Ok(())
    })
}

/// Makes the faults, prints the table, and writes it where `--docs` is given.
fn work() -> Result<()> {
    thread::spawn(|| {
        let _ = std::io::stdin().read_to_end(&mut Vec::new());
        process::interrupt();
    });
    let times = number("--times")?.unwrap_or(1_000);
    let vehicles = usize::try_from(number("--vehicles")?.unwrap_or(3))?;
    let worlds = number("--side-by-side")?.unwrap_or(1).max(1);
    let seed = match number("--seed")? {
        Some(seed) => seed,
        None => SystemTime::now().duration_since(UNIX_EPOCH)?.as_secs(),
    };
    if !(1..=50).contains(&vehicles) {
        bail!("--vehicles {vehicles}: expected 1 to 50");
    }
    let command = format!(
        "cargo xtask faults --times {times} --seed {seed} --vehicles {vehicles} --side-by-side {worlds}"
    );
    eprintln!("xtask: {command}");
    let folder = std::env::temp_dir().join(format!("vsm-faults-{}", std::process::id()));
    let (begun, records) = (Instant::now(), Mutex::new(Vec::new()));
    let left = AtomicU64::new(times);
    let broken: Vec<_> = thread::scope(|scope| {
        let each = (0..worlds).map(|number| {
            let (records, left, folder) = (&records, &left, folder.join(number.to_string()));
            let dice = Dice::new(seed.wrapping_add(number << 32));
            scope.spawn(move || in_world(number, &folder, vehicles, dice, left, records))
        });
        let each: Vec<_> = each.collect();
        let ended = each
            .into_iter()
            .map(|world| world.join().unwrap_or_else(|_| Err(anyhow!("it panicked"))));
        ended.filter_map(Result::err).collect()
    });
    let records = records.into_inner().unwrap_or_else(PoisonError::into_inner);
    let run = report::Run {
        command,
        took: begun.elapsed(),
        worlds: usize::try_from(worlds)?,
        vehicles,
        left_out: left_out()
            .iter()
            .map(|(kind, needs)| format!("{} ({needs} is not installed)", kind.in_words()))
            .collect(),
    };
    let table = report::markdown(&run, &records)?;
    eprintln!("\n{table}");
    let violations = report::violations(&records);
    if violations.is_empty() && broken.is_empty() {
        fs::remove_dir_all(&folder).context("the folder of the worlds")?;
    } else {
        eprintln!("logs: {}", folder.display());
    }
    if let Some(why) = broken.into_iter().next() {
        return Err(why);
    }
    if flag("--docs") {
        fs::write(
            root().join("docs/reference/fleet-faults.md"),
            report::document(&table),
        )?;
    }
    if !violations.is_empty() {
        bail!("{} violations", violations.len());
    }
    Ok(())
}

/// Makes faults in one world until none are left.
fn in_world(
    number: u64,
    folder: &Path,
    vehicles: usize,
    mut dice: Dice,
    left: &AtomicU64,
    records: &Mutex<Vec<Record>>,
) -> Result<()> {
    fs::create_dir_all(folder)?;
    // Names of interfaces have room for 15 bytes, those of namespaces for the id of this process.
    let prefix = format!("vsm{}-{number}-", std::process::id());
    let mut world = World::start(prefix, folder, &bins()?, vehicles)?;
    let mut stations = Stations::new(world.computers.clone(), vehicles);
    for vehicle in 0..vehicles {
        stations.begin(vehicle)?;
    }
    let skipped = left_out();
    let mut kinds = Kind::ALL.to_vec();
    kinds.retain(|kind| skipped.iter().all(|(skipped, _)| skipped != kind));
    let mut planted = !flag("--plant");
    let take = |left: u64| left.checked_sub(1);
    while left
        .fetch_update(Ordering::Relaxed, Ordering::Relaxed, take)
        .is_ok()
    {
        let record = judge::one(&mut world, &mut stations, &mut dice, &kinds)
            .with_context(|| format!("world {number}"))?;
        let mut records = records.lock().unwrap_or_else(PoisonError::into_inner);
        let verdict = match &record.violations[..] {
            [] => "ok".to_owned(),
            violations => format!("VIOLATION: {}", violations.join("; ")),
        };
        let taken_over = record.taken_over.map_or_else(String::new, |time| {
            format!(", taken over in {:.2} s", time.as_secs_f64())
        });
        let done = if record.accepted {
            "accepted"
        } else {
            "not accepted"
        };
        eprintln!(
            "{:4} {}, {:?} {done}{taken_over}: {verdict}",
            records.len() + 1,
            record.line,
            record.work
        );
        records.push(record);
        drop(records);
        if !std::mem::replace(&mut planted, true) {
            judge::plant(&world)?;
        }
    }
    Ok(())
}

fn flag(name: &str) -> bool {
    std::env::args().any(|argument| argument == name)
}

/// Where the programs are.
fn bins() -> Result<PathBuf> {
    match option("--bins") {
        Some(bins) => fs::canonicalize(&bins).with_context(|| bins.display().to_string()),
        None => {
            let own = std::env::current_exe().context("the path of xtask")?;
            Ok(own.parent().context("its folder")?.to_owned())
        }
    }
}

/// What is missing for any fault.
fn missing() -> Option<&'static str> {
    if !rustix::process::geteuid().is_root() {
        return Some("network namespaces need root");
    }
    if !is_there(Command::new("ip").args(["netns", "list"])) {
        return Some("ip (iproute2) is not installed, or has no network namespaces");
    }
    if !is_there(Command::new("etcd").arg("--version")) {
        return Some("etcd is not installed");
    }
    None
}

/// The faults that cannot be made here, and what they need.
fn left_out() -> Vec<(Kind, &'static str)> {
    let there = |needs: &str| match needs {
        "libfaketime" => world::faketime().is_some(),
        "tc" => is_there(Command::new("tc").arg("-V")),
        program => is_there(Command::new(program).arg("-V")),
    };
    let needs = Kind::ALL
        .iter()
        .filter_map(|kind| Some((*kind, kind.needs()?)));
    needs.filter(|(_, needs)| !there(needs)).collect()
}

/// Given to the process that does the work.
const WORKER: &str = "--worker";
