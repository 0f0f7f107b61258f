//! `vsm fleet`: the computers that can serve a VSM.

use std::time::{Duration, Instant};

use anyhow::anyhow;
use clap::{Args, Subcommand};

use super::config_arg::ConfigArg;
use super::process::{Failure, bad, failed, load, print, print_line, waiting};
use crate::config::SharedStore;
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
            takes_part(&fleet, node)?;
            operator.drain(node).map_err(failed)?;
            if fleet.owner.as_ref() == Some(node) {
                if !taken_over(&operator, node, lease)? {
                    let still = format!(
                        "{node} is still drained: `vsm fleet resume --node {node}` lets it serve again"
                    );
                    return Err(nobody(lease, &still));
                }
            } else {
                print_line(&format!(
                    "{node} serves nothing until `vsm fleet resume --node {node}`"
                ));
            }
            Ok(())
        }
        Action::Resume { node, .. } => {
            takes_part(&operator.fleet().map_err(failed)?, node)?;
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
            // Draining makes the owner give up the vehicles, and leaves them to another. The order ends by itself, so that
            // an interrupted move leaves no vehicle without a ground.
            let drain = operator
                .drain_for(&owner, patience(lease))
                .map_err(failed)?;
            let drain = drain.ok_or_else(|| {
                failed(anyhow!(
                    "{owner} is drained already, by `vsm fleet drain` or by a move within the last {} s: `vsm fleet list` shows who takes over",
                    patience(lease).as_secs()
                ))
            })?;
            let moved = taken_over(&operator, &owner, lease);
            operator.end(&drain);
            end_of_move(&owner, lease, moved)
        }
    }
}

/// Refuses a name that is none of the fleet's: an order to it would change nothing, and the node that is meant would stay as it is.
fn takes_part(fleet: &Fleet, node: &str) -> Result<(), Failure> {
    if fleet.nodes.iter().any(|one| one.name == node) {
        return Ok(());
    }
    let names: Vec<&str> = fleet.nodes.iter().map(|one| one.name.as_str()).collect();
    let expected = match &names[..] {
        [] => "none does: `vsm run` on its computer makes one take part".to_owned(),
        names => format!("expected one of {}", names.join(", ")),
    };
    Err(bad(anyhow!(
        "--node {node}: no such node takes part, {expected}"
    )))
}

fn open(config: &ConfigArg) -> Result<(Operator, Duration), Failure> {
    let config = load(config.path())?;
    let store: SharedStore = config.store.shared().ok_or_else(|| {
        failed(anyhow!(
            "store.kind is \"files\": one computer serves this VSM, and nothing is to be shown; docs/guide/fleet.md is how others stand by"
        ))
    })?;
    let lease = Duration::from_secs(store.lease_s);
    Ok((Operator::new(&store, config.dli.vsm_id), lease))
}

/// What a move ends with, once its order to the node that served has ended.
fn end_of_move(owner: &str, lease: Duration, moved: Result<bool, Failure>) -> Result<(), Failure> {
    match moved? {
        true => Ok(()),
        false => Err(nobody(lease, &format!("{owner} may serve again"))),
    }
}

fn nobody(lease: Duration, state: &str) -> Failure {
    failed(anyhow!(
        "no other node has taken over within {} s: `vsm fleet list` shows who takes part; {state}",
        patience(lease).as_secs()
    ))
}

/// How long another node may take to take over.
fn patience(lease: Duration) -> Duration {
    lease * 2 + MARGIN
}

/// Waits until another node than `before` serves; false if none does in time.
fn taken_over(operator: &Operator, before: &str, lease: Duration) -> Result<bool, Failure> {
    let within = patience(lease);
    let _waiting = waiting("another node to take over", within);
    let begun = Instant::now();
    loop {
        let owner = operator.fleet().map_err(failed)?.owner;
        if let Some(owner) = owner.filter(|owner| owner != before) {
            let took_s = begun.elapsed().as_secs_f64();
            print_line(&format!(
                "{owner} serves in place of {before}, after {took_s:.1} s"
            ));
            return Ok(true);
        }
        if begun.elapsed() > within {
            return Ok(false);
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::shell::fleet::operator::FleetNode;

    #[test]
    fn an_order_to_a_node_that_does_not_take_part_is_refused_with_those_that_do() {
        let node = |name: &str| FleetNode {
            name: name.to_owned(),
            present: false,
            drained: true,
        };
        let mut fleet = Fleet {
            owner: None,
            epoch: 1,
            since: None,
            nodes: vec![node("alpha"), node("beta")],
        };
        assert!(takes_part(&fleet, "beta").is_ok());
        let refused = |fleet: &Fleet| match takes_part(fleet, "gamma") {
            Err(Failure::Bad(fault)) => format!("{fault:#}"),
            _ => panic!("it is refused as a usage error"),
        };
        assert!(refused(&fleet).ends_with("expected one of alpha, beta"));
        fleet.nodes.clear();
        assert!(refused(&fleet).contains("none does"));
    }

    #[test]
    fn a_move_that_nobody_follows_ends_with_the_state_of_the_node() {
        let lease = Duration::from_secs(10);
        assert!(end_of_move("a", lease, Ok(true)).is_ok());
        let Err(Failure::Failed(fault)) = end_of_move("a", lease, Ok(false)) else {
            panic!("it failed");
        };
        let text = format!("{fault:#}");
        assert!(text.contains("within 25 s"), "{text}");
        assert!(text.ends_with("a may serve again"), "{text}");
    }
}
