//! `cargo xtask sizing`: what a fleet of many nodes needs, from the costs that were measured, and what breaks first.
//!
//! Nothing is measured here. Loads are sums of measured costs; deaths of nodes, and the writes of a VSM to etcd, are simulated.
//! Every constant names the command or the page that it is from: who measures again changes it here, and writes the page
//! with `--docs`.
//!
//! Read in this order: `costs` (the constants), `simulation` (deaths of nodes, writes), `page` (the tables).

mod costs;
mod page;
mod simulation;

use std::fs;

use anyhow::{Result, bail};

use self::costs::{
    CORE_OF_200, CORE_OF_1000, ETCD_S, FILES, MEASURED_WITH, MEMORY_OF_200, MEMORY_OF_1000,
    MESSAGES_S, NODES_OF_VSM, READ_S, READS_S, REPORTS_S, STATIONS, WRITE_S,
};
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

#[derive(Debug, Clone, Copy)]
struct Fleet {
    vehicles: u32,
    nodes: u32,
    of_vsm: u32,
}

impl Fleet {
    /// The last VSM counts as a full one.
    fn vsms(&self) -> u32 {
        self.vehicles.div_ceil(self.of_vsm)
    }

    /// Of a core, %, as long as each station is held to the default limit.
    fn vsm_core(&self) -> f64 {
        line(self.of_vsm, CORE_OF_200, CORE_OF_1000)
    }

    /// The memory of its process, MB.
    fn vsm_memory(&self) -> f64 {
        line(self.of_vsm, MEMORY_OF_200, MEMORY_OF_1000)
    }

    /// How many datagrams a second a VSM sends to all its stations, at the default limit.
    fn vsm_datagrams(&self) -> f64 {
        (f64::from(self.of_vsm) * REPORTS_S).min(MESSAGES_S) * STATIONS
    }

    /// How long the last vehicle of a VSM waits beyond what was measured with three: the next node reads every file, and
    /// then stores every ceiling, one after the other. `lanes`: VSMs that do so at once.
    fn restore_s(&self, lanes: u32) -> f64 {
        let lanes = f64::from(lanes);
        let (read, write) = (READ_S.max(lanes / READS_S), WRITE_S.max(lanes / ETCD_S));
        f64::from(self.of_vsm.saturating_sub(MEASURED_WITH)) * (FILES * read + write)
    }
}

/// The line through the measured figures of 200 and of 1,000 vehicles in one process.
fn line(vehicles: u32, of_200: f64, of_1000: f64) -> f64 {
    of_200 + (of_1000 - of_200) * (f64::from(vehicles) - 200.0) / 800.0
}
