//! `vsm doctor`: what does not work, a line of cause and cure each. Exit status 1 where anything was found.
//!
//! Where the bridge runs, it is asked, since only it sees what arrives; else this computer is looked at.

use std::path::Path;
use std::time::Duration;

use anyhow::{Context as _, anyhow};
use serde::{Deserialize, Serialize};
use serde_json::json;

use super::process::{Failure, bad, failed, print, runtime};
use crate::config::Config;
use crate::session::findings::Finding;
use crate::session::findings::host::{self, HostFacts, StoreFact};
use crate::shell::{self_check, status_socket};

/// What of the status is needed.
#[derive(Debug, Deserialize)]
struct Running {
    vsm: String,
    uptime_s: f64,
    findings: Vec<Finding>,
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
    let config = Config::load(path).map_err(bad)?;
    let (running, facts) = runtime()?.block_on(look(&config))?;
    let mut found = host::judge(&facts);
    if let Some(running) = &running {
        for finding in &running.findings {
            // What this program has seen as well is listed once.
            if !found
                .iter()
                .any(|one| one.code == finding.code && one.about == finding.about)
            {
                found.push(finding.clone());
            }
        }
    }
    let speak: Vec<&Speaks> = (running.iter().flat_map(|running| &running.stations))
        .filter(|station| !station.profile.is_empty())
        .collect();
    let store = config.store.dir.display();
    if json {
        let report = json!({"running": running.is_some(), "findings": found, "profiles": speak});
        print(&format!("{report}\n"))?;
    } else {
        let mut text = match &running {
            Some(running) => format!(
                "VSM {} has run for {:.0} s on the store {store}\n",
                running.vsm, running.uptime_s
            ),
            None => format!(
                "no bridge answers for the store {store}: only this computer was looked at; while \"vsm run\" runs, this shows \
                 what arrives, too\n"
            ),
        };
        for finding in &found {
            text += &format!("{finding}\n");
        }
        if found.is_empty() {
            text += "nothing found\n";
        }
        for station in &speak {
            let lines = station.profile.join(", ");
            text += &format!(
                "CUCS {} is answered as it speaks; to fix that, its [[cucs]] takes: {lines}\n",
                station.id
            );
        }
        print(&text)?;
    }
    if found.is_empty() {
        return Ok(());
    }
    Err(failed(anyhow!("{} found", count(found.len()))))
}

fn count(findings: usize) -> String {
    match findings {
        1 => "1 fault".to_owned(),
        many => format!("{many} faults"),
    }
}

async fn look(config: &Config) -> Result<(Option<Running>, HostFacts), Failure> {
    let Some(mut running) = ask(config)? else {
        return Ok((None, self_check::before_a_start(config, LISTEN_FOR).await));
    };
    let mut facts = self_check::beside(config, LISTEN_FOR).await;
    // A bridge that has just started has not waited long enough to miss anything.
    while running.uptime_s < SETTLED_S {
        tokio::time::sleep(Duration::from_millis(500)).await;
        let Some(later) = ask(config)? else {
            return Err(failed(anyhow!(
                "the bridge has ended meanwhile: look at its log"
            )));
        };
        running = later;
    }
    let configured = config.dli.vsm_id.to_string();
    if running.vsm != configured {
        let store = config.store.dir.display().to_string();
        facts.store = Some(StoreFact::Other(store, running.vsm.clone(), configured));
    }
    Ok((Some(running), facts))
}

fn ask(config: &Config) -> Result<Option<Running>, Failure> {
    let Ok(text) = status_socket::ask(&config.store.dir, status_socket::STATUS, ANSWER_WITHIN)
    else {
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
/// A bridge that serves answers at once.
const ANSWER_WITHIN: Duration = Duration::from_secs(3);
