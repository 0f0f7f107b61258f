//! `vsm doctor`: what does not work, each with a line of cause and remedy. Exit status 1 if anything was found.
//!
//! If the bridge runs it is asked, since only it sees what arrives; otherwise this computer is checked.

use std::collections::HashSet;
use std::path::Path;
use std::time::Duration;

use anyhow::{Context as _, anyhow};
use serde::{Deserialize, Serialize};
use serde_json::json;

use super::process::{Failure, failed, load, named_store, print, report_line, runtime, waiting};
use super::status::RUNS_ON;
use crate::config::Config;
use crate::session::Logged;
use crate::session::findings::host::{self, HostFacts, StoreFact};
use crate::session::findings::{Code, Finding};
use crate::shell::{self_check, status_socket};

/// What of the status is needed.
#[derive(Debug, Deserialize)]
struct Running {
    vsm: String,
    uptime_s: f64,
    findings: Vec<Finding>,
    /// None in the answers of earlier versions.
    #[serde(default)]
    logged: Vec<Logged>,
    /// None in the answers of earlier versions.
    #[serde(default)]
    stations: Vec<Speaks>,
}

/// How a station speaks, by what was received of it.
#[derive(Debug, Deserialize, Serialize)]
struct Speaks {
    id: String,
    /// Lines of its `[[cucs]]`.
    #[serde(default)]
    profile: Vec<String>,
}

pub(crate) fn run(path: &Path, json: bool) -> Result<(), Failure> {
    let config = match load(path) {
        Ok(config) => config,
        Err(Failure::Bad(fault)) => return beside_wrong_file(path, fault, json),
        Err(other) => return Err(other),
    };
    let (running, facts) = {
        let longest = LISTEN_FOR.as_secs_f64().max(SETTLED_S);
        let _waiting = waiting(
            "what arrives: 3 s, and of a bridge that has just started its first 12 s; more where elevation files are read",
            Duration::from_secs_f64(longest) + ANSWER_WITHIN,
        );
        runtime()?.block_on(look(&config, path))?
    };
    let mut found = host::judge(&facts);
    if let Some(running) = &running {
        // A finding of both this program and the bridge is listed once.
        let of = |one: &Finding| (one.code, one.about.clone());
        let mut listed: HashSet<(Code, String)> = found.iter().map(of).collect();
        let others = running.findings.iter().filter(|one| listed.insert(of(one)));
        found.extend(others.cloned());
    }
    let standby = facts.standby.as_deref();
    show(&config.store.dir, running.as_ref(), standby, &found, json)?;
    if found.is_empty() {
        return Ok(());
    }
    Err(failed(anyhow!("{} found", count(found.len()))))
}

/// The file is wrong by now, such as after a reload that was refused: a bridge that runs with what it was is shown all the same. This
/// computer is not looked at, since the file does not say for what. The fault is the last line, and the exit status that of the file.
fn beside_wrong_file(path: &Path, fault: anyhow::Error, json: bool) -> Result<(), Failure> {
    // What answers with something else is an agent, whose file was given by mistake.
    let running = named_store(path).and_then(|store| Some((ask(&store).ok()??, store)));
    let Some((running, store)) = running else {
        return Err(Failure::Bad(fault));
    };
    report_line(RUNS_ON);
    show(&store, Some(&running), None, &running.findings, json)?;
    Err(Failure::Bad(fault))
}

/// Prints what was found. `standby`: why the node on this store serves nothing.
fn show(
    store: &Path,
    running: Option<&Running>,
    standby: Option<&str>,
    found: &[Finding],
    json: bool,
) -> Result<(), Failure> {
    let logged = running.map_or_else(Vec::new, |running| beside_findings(&running.logged, found));
    let speak: Vec<&Speaks> = (running.iter().flat_map(|running| &running.stations))
        .filter(|station| !station.profile.is_empty())
        .collect();
    let store = store.display();
    if json {
        let report = json!({
            "running": running.is_some(),
            "standby": standby,
            "findings": found,
            "logged": logged,
            "profiles": speak,
        });
        print(&format!("{report}\n"))
    } else {
        let mut text = match (running, standby) {
            (Some(running), _) => format!(
                "VSM {} has run for {:.0} s on the store {store}\n",
                running.vsm, running.uptime_s
            ),
            (None, Some(why)) => format!("the node on the store {store} stands by: {why}\n"),
            (None, None) => format!(
                "no bridge answers for the store {store}: only this computer was looked at; while \"vsm run\" runs, this shows \
                 what arrives, too\n"
            ),
        };
        for finding in found {
            text += &format!("{finding} [{}]\n", finding.code);
        }
        if found.is_empty() {
            text += if logged.is_empty() {
                "nothing found\n"
            } else {
                "nothing found now\n"
            };
        }
        for line in &logged {
            text += &format!(
                "logged {} s ago, {}: {}: {}\n",
                line.ago_s, line.level, line.about, line.text
            );
        }
        for station in &speak {
            let lines = station.profile.join(", ");
            text += &format!(
                "CUCS {} is answered as it speaks; to fix that, its [[cucs]] takes: {lines}\n",
                station.id
            );
        }
        print(&text)
    }
}

/// What the log has named of late and is no finding now: who has read the one and asks the other must not doubt either. Each
/// text once, with its latest time.
fn beside_findings(logged: &[Logged], found: &[Finding]) -> Vec<Logged> {
    let mut lines: Vec<Logged> = Vec::new();
    for line in logged.iter().rev() {
        let is_same = |one: &&Logged| one.about == line.about && one.text == line.text;
        // A log line already names its vehicle.
        let stands = found
            .iter()
            .any(|one| one.to_string().ends_with(&line.text));
        if !stands && lines.iter().filter(is_same).count() == 0 {
            lines.push(line.clone());
        }
    }
    lines.truncate(MAX_LOGGED);
    lines.reverse();
    lines
}

fn count(findings: usize) -> String {
    match findings {
        1 => "1 fault".to_owned(),
        many => format!("{many} faults"),
    }
}

async fn look(config: &Config, path: &Path) -> Result<(Option<Running>, HostFacts), Failure> {
    if ask(&config.store.dir)?.is_none() {
        let facts = self_check::before_a_start(config, path, LISTEN_FOR).await;
        return Ok((None, facts));
    }
    let mut facts = self_check::beside(config, path, LISTEN_FOR).await;
    let ended = || failed(anyhow!("the bridge has ended meanwhile: look at its log"));
    // After that, so that its times are fresh.
    let mut running = ask(&config.store.dir)?.ok_or_else(ended)?;
    // A bridge that has just started has not waited long enough to miss anything.
    while running.uptime_s < SETTLED_S {
        tokio::time::sleep(Duration::from_millis(500)).await;
        running = ask(&config.store.dir)?.ok_or_else(ended)?;
    }
    let configured = config.dli.vsm_id.to_string();
    if running.vsm != configured {
        let store = config.store.dir.display().to_string();
        facts.store = Some(StoreFact::Other(store, running.vsm.clone(), configured));
    }
    Ok((Some(running), facts))
}

fn ask(store: &Path) -> Result<Option<Running>, Failure> {
    let Ok(text) = status_socket::ask(store, status_socket::STATUS, ANSWER_WITHIN) else {
        return Ok(None);
    };
    let running = serde_json::from_str(&text)
        .context("the running vsm answers with something else: is it of another version?")
        .map_err(failed)?;
    Ok(Some(running))
}

/// A ground station sends a heartbeat each second or two.
const LISTEN_FOR: Duration = Duration::from_secs(3);
/// A bridge finds what does not work within this time.
const SETTLED_S: f64 = 12.0;
/// The latest lines of the log that are shown.
const MAX_LOGGED: usize = 10;
/// A bridge that serves answers at once.
const ANSWER_WITHIN: Duration = Duration::from_secs(3);
