//! `vsm airside`: the agent beside PX4.

use std::io::{self, Write};
use std::path::Path;

use crate::shell::airside::{AirsideError, AirsideServer};
use crate::shell::{memory, pairing_socket, service};
use anyhow::{Context as _, anyhow};
use clap::{Args, Subcommand};
use serde_json::Value;

use super::config_arg::AgentConfigArg;
use super::process::{
    Failure, LogFormat, announce, bad, failed, load_airside, log, runtime, stop_signal,
};
use super::status;
use super::zeroize;

#[derive(Debug, Args)]
#[command(args_conflicts_with_subcommands = true)]
pub(crate) struct Arguments {
    #[command(subcommand)]
    action: Option<Action>,
    #[command(flatten)]
    config: AgentConfigArg,
    /// Open the window for one pairing at the start, as `vsm airside pair` does, and show the code to enter on the ground
    #[arg(long)]
    pair: bool,
    /// Write the log as text or as JSON, one object a line; RUST_LOG chooses how much of it
    #[arg(long, value_name = "FORMAT", default_value = "text")]
    log: LogFormat,
}

#[derive(Debug, Subcommand)]
pub(crate) enum Action {
    /// Open the running agent's window for one pairing, for 10 minutes, and show the code to enter on the ground
    Pair {
        #[command(flatten)]
        config: AgentConfigArg,
        /// Use this code, which the ground has made, instead of a new one; `-` reads it from standard input, which is safer:
        /// every user of this computer can see arguments in the list of processes
        #[arg(long, value_name = "CODE")]
        code: Option<String>,
    },
    /// Show the state of a running agent
    Status {
        #[command(flatten)]
        config: AgentConfigArg,
        /// Print JSON
        #[arg(long)]
        json: bool,
    },
}

pub(crate) fn run(arguments: Arguments) -> Result<(), Failure> {
    match arguments.action {
        None => serve(arguments.config.path(), arguments.pair, arguments.log),
        Some(Action::Pair { config, code }) => pair(config.path(), code),
        Some(Action::Status { config, json }) => show(config.path(), json),
    }
}

fn serve(path: &Path, with_pairing: bool, format: LogFormat) -> Result<(), Failure> {
    let config = load_airside(path)?;
    let _log = log(format)?;
    memory::lock();
    // Before any key is read and any link is open: after an order to zeroize, nothing may be served.
    zeroize::finish(
        &config.store.dir,
        Some(&|store, _, report| zeroize::beyond_agent(&config, store, report)),
    )?;
    let runtime = runtime()?;
    runtime.block_on(async {
        let server = AirsideServer::open(&config).map_err(|fault| match fault {
            AirsideError::Keys(_) | AirsideError::OpenLink { .. } => bad(fault),
            other => failed(other),
        })?;
        let stop = stop_signal()?;
        let ready = format!(
            "airside: ready: radio {}, PX4 {}",
            config.radio.get_ref().link,
            config.px4.get_ref().link
        );
        announce("INFO", &ready);
        service::ready();
        if with_pairing {
            let store = config.store.dir.clone();
            // The socket exists and ends with the agent: a failure after that concerns nobody.
            std::thread::spawn(move || {
                let _ = pairing_socket::ask(&store, "", |line| {
                    let _ = writeln!(io::stdout(), "{line}");
                });
            });
        }
        server.serve(stop).await.map_err(failed)?;
        // As for `vsm run`.
        zeroize::finish(&config.store.dir, None)?;
        service::stopping();
        tracing::info!("stopped");
        Ok(())
    })
}

/// Until the window is closed; ending this program closes it too.
fn pair(path: &Path, code: Option<String>) -> Result<(), Failure> {
    let config = load_airside(path)?;
    let code = match code.as_deref() {
        // Read from standard input: an argument would be visible in the list of processes.
        Some("-") => {
            let mut line = String::new();
            io::stdin()
                .read_line(&mut line)
                .context("standard input")
                .map_err(failed)?;
            Some(line.trim().to_owned())
        }
        _ => code,
    };
    let mut paired = false;
    pairing_socket::ask(
        &config.store.dir,
        code.as_deref().unwrap_or_default(),
        |line| {
            // The word with which `AirsideServer` reports success; a failed attempt begins with "pairing".
            paired |= line.starts_with("paired");
            // If standard output is closed, there is nobody to report to.
            let _ = writeln!(io::stdout(), "{line}");
        },
    )
    .map_err(|cause| failed(status::no_answer("agent", &config.store.dir, cause)))?;
    if paired {
        Ok(())
    } else {
        Err(failed(anyhow!("nobody was paired with")))
    }
}

fn show(path: &Path, json: bool) -> Result<(), Failure> {
    let config = load_airside(path)?;
    status::report("agent", &config.store.dir, json, readable)
}

/// What it flies while the ground is lost, where that is configured.
fn contingency(of: &Value) -> String {
    if of.is_null() {
        return String::new();
    }
    let mut text = match of["ground_lost_s"].as_f64() {
        Some(lost_s) => format!("  contingencies: the ground is lost for {lost_s:.0} s\n"),
        None => "  contingencies: the ground is there\n".to_owned(),
    };
    for (name, list) in [("stands", &of["standing"]), ("the last time", &of["last"])] {
        for line in list.as_array().into_iter().flatten() {
            text += &format!("    {name}: {}\n", status::plain(line));
        }
    }
    text
}

fn readable(of: &Value) -> String {
    let mut text = format!(
        "agent of vehicle {}, up {:.0} s: {}\n",
        status::plain(&of["vehicle"]),
        of["uptime_s"].as_f64().unwrap_or(0.0),
        status::plain(&of["state"])
    );
    if let Some(id) = of["key_id"].as_str() {
        text += &format!("  key in force {id}\n");
    }
    if let Some(id) = of["next_key_id"].as_str() {
        text += &format!("  key on its way to PX4 {id}\n");
    }
    text += &status::memory("  ", of);
    text += &format!("  this agent    {}\n", status::plain(&of["identity"]));
    let ground = of["ground"].as_str().unwrap_or("not paired yet");
    text += &format!("  paired with   {ground}\n");
    if let Some(left) = of["window_s"].as_u64() {
        text += &format!("  the pairing window is open for {left} s\n");
    }
    text += &status::counts("  key exchange: ", &of["exchange"]);
    text += &contingency(&of["contingency"]);
    text += &status::encryption(&of["encryption"]);
    for (name, side) in [("radio", &of["radio"]), ("PX4", &of["px4"])] {
        let peer = side["peer"].as_str().unwrap_or("no data received yet");
        text += &format!("  {name}: peer {peer}\n");
        text += &status::counts("    frames: ", &side["frames"]);
    }
    text += &format!(
        "  passed on: {} to PX4, {} to the ground\n",
        of["to_px4"], of["to_ground"]
    );
    text += &status::counts("  verified and held back: ", &of["held_back"]);
    text += &status::counts("    messages by id: ", &of["denied_messages"]);
    text += &status::counts("    commands by number: ", &of["denied_commands"]);
    text
}
