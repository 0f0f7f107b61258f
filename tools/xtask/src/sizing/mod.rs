//! `cargo xtask sizing`: what a fleet of many nodes needs, from the costs that were measured, and what breaks first.
//!
//! Nothing is measured here. Loads are sums of measured costs; deaths of nodes, and the writes of a VSM to etcd, are simulated.
//! Every constant names the command or the page that it is from: who measures again changes it here, and writes the page
//! with `--docs`.
//!
//! Read in this order: `costs` (the constants), `fleet` (what each VSM costs), `simulation` (deaths of nodes, writes), `page` (the tables).

mod costs;
mod fleet;
mod page;
mod simulation;

use std::fs;

use anyhow::{Result, bail};

use self::costs::NODES_OF_VSM;
use self::fleet::Fleet;
use crate::kill::number;
use crate::steps::root;

/// Prints the page for `--vehicles N` (10,000) on `--nodes N` (20), `--of-vsm N` (100) vehicles in each VSM; `--docs` writes it.
pub(crate) fn run() -> Result<()> {
    let fleet = Fleet {
        vehicles: within("--vehicles", 10_000, 1, 1_000_000)?,
        nodes: within("--nodes", 20, NODES_OF_VSM, 1_000)?,
        of_vsm: within("--of-vsm", 100, 10, 5_000)?,
    };
    let seed = number("--seed")?.unwrap_or(4_586);
    let page = page::markdown(&fleet, seed)?;
    eprintln!("{page}");
    if std::env::args().any(|argument| argument == "--docs") {
        fs::write(root().join("docs/reference/fleet-sizing.md"), page)?;
    }
    Ok(())
}

fn within(name: &str, default: u32, min: u32, max: u32) -> Result<u32> {
    let given = number(name)?.unwrap_or(default.into());
    match u32::try_from(given) {
        Ok(fits) if (min..=max).contains(&fits) => Ok(fits),
        _ => bail!("{name} {given}: expected {min} to {max}"),
    }
}
