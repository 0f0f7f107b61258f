//! `vsm zeroize`: erases keys, identities, plans, recordings and logs of a bridge or of an agent; and how a start continues
//! that finds an order to do so.

use std::io::{self, BufRead as _, Write as _};
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use anyhow::{Context as _, anyhow};
use clap::Args;
use mavlink_link::exchange::AutopilotKey;

use super::config_arg::ConfigArg;
use super::process::{Failure, bad, failed, load, load_airside, print_line, runtime, waiting};
use crate::config::airside::AirsideConfig;
use crate::config::{Config, ExchangeMode, Signing};
use crate::key_exchange::NOT_REACHED;
use crate::shell::airside_key;
use crate::shell::disk::{FileDisk, NativeFileSystem, OpenError};
use crate::shell::erase::{self, EraseError, Erased, Order};
use crate::shell::key_link;
use crate::shell::pairing::Pairing;
use crate::shell::service;
use crate::shell::status_socket::{self, IN_FLIGHT, Ordered, ZEROIZE};

#[derive(Debug, Args)]
pub(crate) struct Arguments {
    #[command(flatten)]
    config: ConfigArg,
    /// Erase without asking for a confirmation
    #[arg(long)]
    yes: bool,
    /// Erase also while a vehicle of the running bridge, or PX4 beside the running agent, is not known to be disarmed: it loses its
    /// link, and flies PX4's own failsafe
    #[arg(long)]
    in_flight: bool,
    /// Erase nothing: let what has been zeroized be served again, with a new key
    #[arg(long, conflicts_with_all = ["yes", "in_flight"])]
    clear: bool,
}

/// The owner of a store, its folder, and what has to be erased.
struct Target {
    id: String,
    store: PathBuf,
    order: Order,
    beyond: Box<Beyond<'static>>,
}

/// Carries out an order beyond this computer, with the store that has the keys for that, perhaps also in flight; and
/// reports the result. Never call it within a runtime: it creates its own.
pub(super) type Beyond<'a> = dyn Fn(FileDisk, bool, &mut dyn FnMut(&str)) + 'a;

pub(crate) fn run(arguments: &Arguments) -> Result<(), Failure> {
    let path = arguments.config.path();
    let Target {
        id,
        store,
        order,
        beyond,
    } = target(path, arguments.in_flight)?;
    if arguments.clear {
        erase::clear(&store).map_err(failed)?;
        print_line("it may be served again");
        return Ok(());
    }
    // An interrupted order is finished first: it may name other files than this configuration.
    let earlier = carry_out(&store, Some(&*beyond), &mut print_line);
    if let Some(erased) = earlier.map_err(failed)? {
        print_line("finished an earlier zeroize:");
        report(&erased);
    }
    let disk = match FileDisk::open_on(&store, Box::new(NativeFileSystem)) {
        // A bridge or an agent is running: it has to erase itself.
        Err(OpenError::Locked { .. }) => None,
        opened => Some(opened.map_err(bad)?),
    };
    let files = list(&order, &store);
    if !arguments.yes && !confirmed(&id).map_err(failed)? {
        return Err(bad(anyhow!(
            "nothing is erased: expected {id} to be typed, or --yes"
        )));
    }
    match disk {
        Some(mut disk) => {
            if let Some(doubt) = erase::begin(&mut disk, &order).map_err(failed)? {
                print_line(&doubt);
            }
            if order.reaches_beyond() {
                beyond(disk.shared(), arguments.in_flight, &mut print_line);
                erase::claim(&mut disk);
            }
        }
        None => {
            for line in order_running(&store, arguments.in_flight)? {
                print_line(&line);
            }
        }
    }
    // The first to get the store erases: this command, or the bridge that has ended.
    let ends = waiting(
        "the program that ran there to erase, and to end",
        UNLOCKED_WITHIN,
    );
    let erased = match once_unlocked(&store, Some(&*beyond), &mut print_line) {
        Err(EraseError::Open(OpenError::Locked { .. })) => {
            return Err(failed(anyhow!(
                "it is ordered, and the program that runs on {} still erases: start this again to see it finished",
                store.display()
            )));
        }
        erased => erased.map_err(failed)?,
    };
    drop(ends);
    let there = |file: &PathBuf| std::fs::symlink_metadata(file).is_ok_and(|found| !found.is_dir());
    let (left, files): (Vec<_>, Vec<_>) = files.into_iter().partition(there);
    if let Some(left) = left.iter().find(|file| order.needs(file)) {
        return Err(failed(anyhow!("{} is still there", left.display())));
    }
    let why = || "it could not be erased".to_owned();
    report(&erased.unwrap_or_else(|| Erased {
        files,
        left: left.into_iter().map(|file| (file, why())).collect(),
        ..Erased::default()
    }));
    Ok(())
}

/// No bridge runs, and an order stands: the agents beside PX4 are ordered the same, and PX4 without one is given another key, as
/// long as there are keys to do so.
pub(super) fn beyond_bridge(
    config: &Config,
    store: &FileDisk,
    in_flight: bool,
    report: &mut dyn FnMut(&str),
) {
    let vehicles = u32::try_from(config.vehicles().count()).unwrap_or(u32::MAX);
    let _waiting = waiting(
        "the agents beside PX4, and PX4, to take the order",
        BEYOND_WITHIN.saturating_mul(vehicles),
    );
    let Ok(runtime) = runtime() else {
        return report(NOT_REACHED);
    };
    runtime.block_on(async {
        for vehicle in config.vehicles() {
            let Signing::KeyFile(key_file, exchange) = &vehicle.signing else {
                continue;
            };
            if exchange.mode != ExchangeMode::On {
                continue;
            }
            let of = (key_file.as_path(), *exchange);
            let outcome = match Pairing::with_agent(config, vehicle, of, store.shared()) {
                Ok(Some(agent)) => agent.order_zeroize(in_flight).await,
                Ok(None) => "no agent is paired, and none was ordered to erase itself".to_owned(),
                Err(fault) => format!("{NOT_REACHED} ({fault})"),
            };
            report(&format!("vehicle {}: {outcome}", vehicle.id));
        }
        for line in key_link::discard_keys(config, store).await {
            report(&line);
        }
    });
}

/// No agent runs, and an order stands: PX4 is given another key.
pub(super) fn beyond_agent(config: &AirsideConfig, store: FileDisk, report: &mut dyn FnMut(&str)) {
    let _waiting = waiting("PX4 to take another key", ANSWER_WITHIN);
    let not_reached = AutopilotKey::NotReached;
    let Ok(runtime) = runtime() else {
        return report(&not_reached.to_string());
    };
    match runtime.block_on(airside_key::discard(config, store)) {
        Ok(key) => report(&key.to_string()),
        Err(fault) => report(&format!("{not_reached} ({fault})")),
    }
}

/// Lets the bridge or the agent that has the store give up everything, and end. What it reports of what is not on this computer.
fn order_running(store: &Path, in_flight: bool) -> Result<Vec<String>, Failure> {
    let word = if in_flight { IN_FLIGHT } else { b'd' };
    let _waiting = waiting(
        "the program that runs there to take the order",
        ANSWER_WITHIN,
    );
    let answer = status_socket::ask_for(store, ZEROIZE, &[word], ANSWER_WITHIN);
    let answer =
        answer.context("what runs on this store does not answer: stop it, then start this again");
    let answer: Ordered = answer
        .and_then(|text| serde_json::from_str(&text).context("its answer"))
        .map_err(failed)?;
    match answer.refused {
        None => Ok(answer.beyond),
        Some(why) => Err(failed(anyhow!("nothing is erased: {why}"))),
    }
}

/// Finishes what is ordered, as soon as the process that was ordered lets go of the store.
fn once_unlocked(
    store: &Path,
    beyond: Option<&Beyond<'_>>,
    print: &mut dyn FnMut(&str),
) -> Result<Option<Erased>, EraseError> {
    let end = Instant::now() + UNLOCKED_WITHIN;
    loop {
        match carry_out(store, beyond, print) {
            Err(EraseError::Open(OpenError::Locked { .. })) if Instant::now() < end => {
                std::thread::sleep(LOOK_AGAIN);
            }
            done => return done,
        }
    }
}

/// Carries out a stored order: first beyond this computer, if its process has ended before that and `beyond` does it, as
/// long as there are keys to do so.
fn carry_out(
    store: &Path,
    beyond: Option<&Beyond<'_>>,
    print: &mut dyn FnMut(&str),
) -> Result<Option<Erased>, EraseError> {
    if let Some(beyond) = beyond
        && let Some((disk, in_flight)) = erase::claim_at_start(store)?
    {
        beyond(disk, in_flight, print);
        // Threads that have written for that release the store in a moment.
        return once_unlocked(store, None, print);
    }
    erase::finish_before_start(store)
}

fn target(path: &Path, in_flight: bool) -> Result<Target, Failure> {
    if AirsideConfig::is_at(path) {
        let config = load_airside(path)?;
        return Ok(Target {
            id: config.agent.get_ref().vehicle_id.to_string(),
            order: Order::of_agent(&config),
            store: config.store.dir.clone(),
            beyond: Box::new(move |store, _, report| beyond_agent(&config, store, report)),
        });
    }
    // Also if there is no such file: the error says how to create one.
    let config = load(path)?;
    Ok(Target {
        id: config.dli.vsm_id.to_string(),
        order: Order::of_bridge(&config, in_flight),
        store: config.store.dir.clone(),
        beyond: Box::new(move |store, in_flight, report| {
            beyond_bridge(&config, &store, in_flight, report);
        }),
    })
}

/// What will be erased, before anything is.
fn list(order: &Order, store: &Path) -> Vec<PathBuf> {
    let mut erased = Erased::default();
    let files = order.files(store, &mut erased);
    print_line(&format!("to be erased, for good ({} files):", files.len()));
    for file in &files {
        print_line(&format!("  {}", file.display()));
    }
    for (path, why) in erased.left.iter().chain(&erased.failed) {
        print_line(&format!("  not {}: {why}", path.display()));
    }
    files
}

fn confirmed(id: &str) -> anyhow::Result<bool> {
    let mut out = io::stdout();
    write!(out, "type {id} to erase them: ")?;
    out.flush()?;
    let mut line = String::new();
    io::stdin()
        .lock()
        .read_line(&mut line)
        .context("standard input")?;
    Ok(line.trim().eq_ignore_ascii_case(id))
}

fn report(erased: &Erased) {
    for line in lines(erased) {
        print_line(&line);
    }
}

/// What became of it, and what no program can promise.
fn lines(erased: &Erased) -> Vec<String> {
    let mut lines = vec![format!("erased {} files", erased.files.len())];
    for (path, why) in &erased.left {
        lines.push(format!("not erased: {}: {why}", path.display()));
    }
    let mut folders: Vec<&Path> = erased
        .files
        .iter()
        .filter_map(|file| file.parent())
        .collect();
    folders.sort();
    folders.dedup();
    for folder in folders {
        if let Some(medium) = erase::medium(folder) {
            lines.push(format!(
                "not erased: what {} still has of them: it is on {medium}",
                folder.display()
            ));
        }
    }
    lines.extend(NOT_ERASED.map(str::to_owned));
    lines
}

/// A bridge has ended by an order: PX4's keys, where the configuration says so, before its own are erased.
pub(super) async fn discard_keys(config: &Config, store: FileDisk) {
    if !store.is_ordered() {
        return;
    }
    let mut done = std::pin::pin!(key_link::discard_keys(config, &store));
    let mut pings = tokio::time::interval(service::ping_interval().unwrap_or(PING));
    let lines = loop {
        tokio::select! {
            lines = &mut done => break lines,
            _ = pings.tick() => service::alive(),
        }
    };
    for line in lines {
        tracing::warn!("zeroize: {line}");
    }
    // Claimed, so that the next process with the store only erases.
    erase::claim(&mut store.shared());
}

/// A start that finds an order finishes it and ends, since what it would have served is gone. So does a bridge that has
/// stored an order, and each start after that, whoever has finished it, until a person clears it: otherwise a service would
/// use its credential again. `beyond` is for a start: a process that ends has already done that.
pub(super) fn finish(store: &Path, beyond: Option<&Beyond<'_>>) -> Result<(), Failure> {
    let mut log = |line: &str| tracing::warn!("zeroize: {line}");
    let erased = service::while_busy(|| once_unlocked(store, beyond, &mut log)).map_err(failed)?;
    for line in erased.iter().flat_map(lines) {
        tracing::warn!("{line}");
    }
    if erased.is_none() && !erase::is_zeroized(store) {
        return Ok(());
    }
    Err(Failure::Zeroized(anyhow!(
        "zeroized: an order stood in {}, and is carried out; nothing is served until it has a new key and `vsm zeroize --clear` \
         was run",
        store.display()
    )))
}

/// A bridge that ends gets so long to write what is left to write, and to give PX4 another key.
const UNLOCKED_WITHIN: Duration = Duration::from_secs(60);
const PING: Duration = Duration::from_secs(2);
const LOOK_AGAIN: Duration = Duration::from_millis(50);
/// Of one vehicle: an exchange with its agent, or another key for its PX4.
const BEYOND_WITHIN: Duration = Duration::from_secs(32);
/// A bridge waits for its agents, and an agent for PX4.
const ANSWER_WITHIN: Duration = Duration::from_secs(60);
/// What no program can promise.
const NOT_ERASED: [&str; 4] = [
    "not erased: copies that the medium keeps (wear levelling of flash and memory cards, journals, snapshots, swap): destroy the \
     key of an encrypted disk, or the medium",
    "not erased: copies elsewhere: backups, collected logs, /etc/vsm/*.key of a service, key files carried by hand, the other end \
     of each key (PX4, agent, other stations)",
    "not erased: PX4's flight logs, and its key (mavlink/mavlink-signing-key.bin on its memory card) unless an agent was reported to \
     have replaced it; an agent that was not reported to erase itself: run `vsm zeroize` with its airside.toml there",
    "not erased: the configuration file, and what other programs have recorded",
];
