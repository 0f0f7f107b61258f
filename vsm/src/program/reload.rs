//! `vsm reload`.

use std::path::{Path, PathBuf};
use std::time::Duration;

use anyhow::{Context as _, anyhow};

use crate::config::{Config, ConfigError, Report};
use crate::shell::status_socket;

use super::process::{Failure, act_for, bad, failed, named_store, print, waiting};
use super::status::no_answer;

pub(crate) fn reload(path: &Path, json: bool) -> Result<(), Failure> {
    let store = store_of(path).map_err(bad)?;
    act_for(&store, &[])?;
    let asked = {
        let _waiting = waiting("the bridge to apply the file", ANSWER_WITHIN);
        status_socket::ask(&store, status_socket::RELOAD, ANSWER_WITHIN)
    };
    let text = asked.map_err(|cause| failed(no_answer("vsm", &store, cause)))?;
    let report: Report = serde_json::from_str(&text)
        .context("the running vsm answers with something else")
        .map_err(failed)?;
    if json {
        print(&(text + "\n"))?;
    } else {
        print(&readable(path, &report))?;
    }
    match report.refused {
        None => Ok(()),
        Some(why) => Err(bad(anyhow!(
            "the running bridge refuses {}, and nothing of it is applied: {why}",
            path.display()
        ))),
    }
}

fn readable(path: &Path, report: &Report) -> String {
    let mut text = String::new();
    match report.refused {
        None => text += &format!("{}: read again by the running bridge\n", path.display()),
        Some(_) if report.applied.is_empty() && report.kept.is_empty() => return text,
        Some(_) => text += "the configuration is refused; guard keys are read again all the same\n",
    }
    if report.applied.is_empty() && report.refused.is_none() {
        text += "  nothing to apply\n";
    }
    for kept in &report.kept {
        text += &format!("  NOT APPLIED: {kept}\n");
    }
    for change in &report.applied {
        text += &format!("  applied: {change}\n");
    }
    for key in &report.restart {
        text += &format!("  waits for a restart: {key}\n");
    }
    text
}

/// Where the bridge of a configuration is found, also where the rest of the file is wrong: the bridge itself reports that.
fn store_of(path: &Path) -> Result<PathBuf, ConfigError> {
    let fault = match Config::load(path) {
        Ok(config) => return Ok(config.store.dir),
        Err(fault) => fault,
    };
    named_store(path).ok_or(fault)
}

/// It reads elevation files, resolves names, opens links and keys, and writes what rights have changed.
const ANSWER_WITHIN: Duration = Duration::from_secs(120);
