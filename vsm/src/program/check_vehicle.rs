//! `vsm check-vehicle`: which of PX4's own settings weaken the link. It reads parameters and changes nothing.

use std::io;
use std::path::Path;
use std::time::{Duration, Instant};

use anyhow::{Context as _, anyhow};
use mapping::hardening::{Finding, Reading, Verdict, judge};
use serde_json::{Value, json};

use super::process::{Failure, bad, failed, load, print, report_line, runtime};
use crate::config::Config;
use crate::session::VehicleSettings;
use crate::shell::settings_link::{NOTHING_FOR, SettingsLink};
use crate::shell::status_socket;

/// Status 0: nothing weakens the link, and everything that the vehicle has was read.
pub(crate) fn run(path: &Path, json: bool, wait_s: u64) -> Result<(), Failure> {
    let config = load(path)?;
    let patience = Duration::from_secs(wait_s);
    if config.vehicle.is_empty() {
        let fault = anyhow!(
            "{}: no [[vehicle]] in it, expected one to read",
            path.display()
        );
        return Err(bad(fault));
    }
    report_line(&format!(
        "vsm: reading settings; {wait_s} s a vehicle at most (--wait-s)"
    ));
    let mut silent = vec![];
    let vehicles = match ask_bridge(&config.store.dir, patience) {
        Ok(vehicles) => vehicles,
        Err(fault) if is_not_running(&fault) => read_alone(&config, patience, &mut silent)?,
        Err(fault) => {
            let fault = anyhow!(fault).context("the running bridge does not answer");
            return Err(failed(fault));
        }
    };
    let judged: Vec<(&VehicleSettings, Vec<Finding>)> = vehicles
        .iter()
        .map(|vehicle| {
            let mut findings = judge(|name| vehicle.reading_of(name));
            let mut all = config.vehicles();
            let rally = all.any(|one| one.id.to_string() == vehicle.id && !one.rally.is_empty());
            // Without a rally point, how the vehicle returns weakens nothing.
            findings.retain(|one| rally || one.setting.name != "RTL_TYPE");
            (vehicle, findings)
        })
        .collect();
    if json {
        let all: Vec<Value> = judged.iter().map(|(of, all)| in_json(of, all)).collect();
        let text = serde_json::to_string_pretty(&all).map_err(failed)?;
        print(&(text + "\n"))?;
    } else {
        let text: Vec<String> = judged.iter().map(|(of, all)| readable(of, all)).collect();
        print(&text.join("\n"))?;
    }
    let complaints: Vec<String> = judged
        .iter()
        .filter_map(
            |(of, all)| match silent.iter().find(|(id, _)| *id == of.id) {
                Some((_, why)) => Some(why.clone()),
                None => complaint(of, all, wait_s),
            },
        )
        .collect();
    if complaints.is_empty() {
        return Ok(());
    }
    Err(failed(anyhow!(complaints.join("; "))))
}

/// The bridge reads them over the link that it holds, and answers when it has all.
fn ask_bridge(store: &Path, patience: Duration) -> io::Result<Vec<VehicleSettings>> {
    let end = Instant::now() + patience;
    loop {
        let left = end.saturating_duration_since(Instant::now());
        let within = left.max(ASK_EVERY);
        let text = status_socket::ask(store, status_socket::SETTINGS, within)?;
        let vehicles: Vec<VehicleSettings> = serde_json::from_str(&text)?;
        // A bridge that has just started may not have received the vehicle yet, and requests nothing of a silent one.
        if vehicles.iter().all(|vehicle| vehicle.live) || Instant::now() >= end {
            return Ok(vehicles);
        }
        std::thread::sleep(ASK_EVERY);
    }
}

fn is_not_running(fault: &io::Error) -> bool {
    matches!(
        fault.kind(),
        io::ErrorKind::NotFound | io::ErrorKind::ConnectionRefused
    )
}

/// `silent`: the vehicles on whose links nothing arrives, with what to do.
fn read_alone(
    config: &Config,
    patience: Duration,
    silent: &mut Vec<(String, String)>,
) -> Result<Vec<VehicleSettings>, Failure> {
    let runtime = runtime()?;
    let each = config.vehicles().map(|vehicle| {
        runtime.block_on(async {
            let link = SettingsLink::open(config, vehicle)
                .with_context(|| format!("vehicle {}", vehicle.id))
                .map_err(failed)?;
            let (settings, nothing) = link.read(patience).await;
            if nothing {
                let (id, link) = (&settings.id, &vehicle.link);
                let waited_s = patience.min(NOTHING_FOR).as_secs();
                let why = format!(
                    "vehicle {id}: nothing at all arrived on {link} within {waited_s} s: is it switched on, and does it send \
                     there? `vsm doctor` looks closer while `vsm run` runs"
                );
                silent.push((id.clone(), why));
            }
            Ok(settings)
        })
    });
    each.collect()
}

/// Why the exit status is 1.
fn complaint(vehicle: &VehicleSettings, findings: &[Finding], wait_s: u64) -> Option<String> {
    let id = &vehicle.id;
    let unread = findings
        .iter()
        .filter(|one| one.reading == Reading::NotAnswered)
        .count();
    let weak = findings
        .iter()
        .filter(|one| one.verdict == Verdict::Weak)
        .count();
    if unread == findings.len() {
        return Some(format!(
            "vehicle {id}: no answer that can be believed within {wait_s} s: is it switched on, and its key the one in \
             force? While `vsm run` runs, `vsm status` shows what its link refuses"
        ));
    }
    if weak > 0 {
        return Some(format!("vehicle {id}: {weak} settings weaken the link"));
    }
    (unread > 0).then(|| format!("vehicle {id}: {unread} settings were not read within {wait_s} s"))
}

fn readable(vehicle: &VehicleSettings, findings: &[Finding]) -> String {
    let of = |verdict| findings.iter().filter(move |one| one.verdict == verdict);
    let count = |verdict| of(verdict).count();
    let mut text = format!("vehicle {}", vehicle.id);
    if !vehicle.tail_number.is_empty() {
        text += &format!(" ({})", vehicle.tail_number);
    }
    text += &format!(
        ": {} weak, {} to decide, {} good, {} unknown\n",
        count(Verdict::Weak),
        count(Verdict::Decide),
        count(Verdict::Good),
        count(Verdict::Unknown)
    );
    for (verdict, title) in [(Verdict::Weak, "WEAK  "), (Verdict::Decide, "DECIDE")] {
        for finding in of(verdict) {
            let (name, source) = (finding.setting.name, finding.setting.source);
            text += &format!("  {title} {name} = {}\n", finding.shown());
            text += &format!("         {}\n", finding.why);
            let better = finding.better_shown();
            text += &format!("         better: {better} (PX4: {source})\n");
        }
    }
    for (reading, why) in [
        (Reading::Absent, "the vehicle has no such parameter"),
        (Reading::NotAnswered, "not read"),
    ] {
        let names = of(Verdict::Unknown).filter(|one| one.reading == reading);
        let names: Vec<&str> = names.map(|one| one.setting.name).collect();
        if !names.is_empty() {
            text += &format!("  unknown, {why}: {}\n", names.join(", "));
        }
    }
    text
}

fn in_json(vehicle: &VehicleSettings, findings: &[Finding]) -> Value {
    let settings = findings.iter().map(|finding| {
        let value = match finding.reading {
            Reading::Value(value) => Some(value),
            Reading::Absent | Reading::NotAnswered => None,
        };
        json!({
            "name": finding.setting.name,
            "verdict": match finding.verdict {
                Verdict::Weak => "weak",
                Verdict::Decide => "decide",
                Verdict::Good => "good",
                Verdict::Unknown => "unknown",
            },
            "value": value,
            "shown": finding.shown(),
            "why": finding.why,
            "better": finding.setting.better,
            "better_shown": finding.better_shown(),
            "source": finding.setting.source,
        })
    });
    json!({
        "vehicle": vehicle.id,
        "tail_number": vehicle.tail_number,
        "live": vehicle.live,
        "settings": settings.collect::<Vec<_>>(),
    })
}

const ASK_EVERY: Duration = Duration::from_millis(500);
