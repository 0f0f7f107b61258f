//! `vsm fleet`: the computers that can serve a VSM.

use std::time::{Duration, Instant};

use anyhow::{Context as _, anyhow};
use clap::{Args, Subcommand};

use super::config_arg::ConfigArg;
use super::process::{Failure, bad, failed, print, print_line, waiting};
use crate::config::{Config, SharedStore};
use crate::shell::fleet::operator::{Fleet, Operator};

/// Show the computers that can serve this VSM, and choose which does ([store] kind = "etcd")
#[derive(Debug, Args)]
pub(crate) struct Arguments {
    #[command(subcommand)]
    action: Action,
}

#[derive(Debug, Subcommand)]
enum Action {
    /// List the nodes, and which of them serves
    List {
        #[command(flatten)]
        config: ConfigArg,
        /// Print JSON
        #[arg(long)]
        json: bool,
    },
    /// Let a node serve nothing, until `resume`: before its computer is taken away
    Drain {
        /// The node, as store.node names it
        #[arg(long)]
        node: String,
        #[command(flatten)]
        config: ConfigArg,
    },
    /// Let a drained node serve again
    Resume {
        /// The node, as store.node names it
        #[arg(long)]
        node: String,
        #[command(flatten)]
        config: ConfigArg,
    },
    /// Have another node serve: drain the one that does, wait until another has taken over, and let it stand by again
    Move {
        #[command(flatten)]
        config: ConfigArg,
    },
}

pub(crate) fn run(arguments: &Arguments) -> Result<(), Failure> {
    let config = match &arguments.action {
        Action::List { config, .. } | Action::Move { config } => config,
        Action::Drain { config, .. } | Action::Resume { config, .. } => config,
    };
    let (operator, lease) = open(config)?;
    match &arguments.action {
        Action::List { json, .. } => {
            let fleet = operator.fleet().map_err(failed)?;
            let text = if *json {
                serde_json::to_string(&fleet).map_err(failed)? + "\n"
            } else {
                readable(&fleet)
            };
            print(&text)
        }
        Action::Drain { node, .. } => {
            let fleet = operator.fleet().map_err(failed)?;
            let known = fleet.nodes.iter().any(|one| one.name == *node);
            if !known {
                return Err(bad(anyhow!(
                    "no node {node:?} takes part: {}",
                    readable(&fleet).trim_end()
                )));
            }
            operator.drain(node).map_err(failed)?;
            if fleet.owner.as_ref() == Some(node) {
                taken_over(&operator, node, lease)?;
            } else {
                print_line(&format!(
                    "{node} serves nothing until `vsm fleet resume --node {node}`"
                ));
            }
            Ok(())
        }
        Action::Resume { node, .. } => {
            operator.resume(node).map_err(failed)?;
            print_line(&format!("{node} may serve again"));
            Ok(())
        }
        Action::Move { .. } => {
            let fleet = operator.fleet().map_err(failed)?;
            let owner = fleet.owner.clone();
            let owner = owner.ok_or_else(|| failed(anyhow!("no node serves: nothing to move")))?;
            let others = fleet
                .nodes
                .iter()
                .any(|one| one.present && !one.drained && one.name != owner);
            if !others {
                return Err(failed(anyhow!(
                    "{owner} serves, and no other node stands by: it would leave the vehicles without a ground"
                )));
            }
            // Draining makes the owner give up the vehicles. It is resumed even if nobody takes over, so that it serves
            // again.
            operator.drain(&owner).map_err(failed)?;
            let moved = taken_over(&operator, &owner, lease);
            operator
                .resume(&owner)
                .with_context(|| {
                    format!("{owner} is still drained: `vsm fleet resume --node {owner}`")
                })
                .map_err(failed)?;
            moved
        }
    }
}

fn open(config: &ConfigArg) -> Result<(Operator, Duration), Failure> {
    let config = Config::load(config.path()).map_err(bad)?;
    let store: SharedStore = config.store.shared().ok_or_else(|| {
        failed(anyhow!(
            "store.kind is \"files\": one computer serves this VSM, and nothing is to be shown; docs/guide/fleet.md is how others stand by"
        ))
    })?;
    let lease = Duration::from_secs(store.lease_s);
    Ok((Operator::new(&store, config.dli.vsm_id), lease))
}

/// Waits until another node than `before` serves.
fn taken_over(operator: &Operator, before: &str, lease: Duration) -> Result<(), Failure> {
    let within = lease * 2 + MARGIN;
    let _waiting = waiting("another node to take over", within);
    let begun = Instant::now();
    loop {
        let owner = operator.fleet().map_err(failed)?.owner;
        if let Some(owner) = owner.filter(|owner| owner != before) {
            let took_s = begun.elapsed().as_secs_f64();
            print_line(&format!(
                "{owner} serves in place of {before}, after {took_s:.1} s"
            ));
            return Ok(());
        }
        if begun.elapsed() > within {
            return Err(failed(anyhow!(
                "{before} is drained, and no other node has taken over within {} s: `vsm fleet list` shows who takes part, and \
                 `vsm fleet resume --node {before}` lets it serve again",
                within.as_secs()
            )));
        }
        std::thread::sleep(LOOK_AGAIN);
    }
}

fn readable(fleet: &Fleet) -> String {
    let mut text = match &fleet.owner {
        Some(owner) => format!("{owner} serves (epoch {})\n", fleet.epoch),
        None => format!("no node serves (epoch {})\n", fleet.epoch),
    };
    for node in &fleet.nodes {
        let serves = fleet.owner.as_ref() == Some(&node.name);
        let state = match (serves, node.present, node.drained) {
            (true, _, false) => "serves",
            (true, _, true) => "serves, and is to end",
            (false, true, false) => "stands by",
            (false, true, true) => "drained",
            (false, false, _) => "drained, not there",
        };
        text += &format!("  {:<16} {state}\n", node.name);
    }
    text
}

const MARGIN: Duration = Duration::from_secs(5);
const LOOK_AGAIN: Duration = Duration::from_millis(100);
