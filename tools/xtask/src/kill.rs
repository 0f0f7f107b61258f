//! `cargo xtask kill`: `kill -9` of real processes at random moments, as many times as requested.
//!
//! The test is `processes/kills` of `tests/end-to-end`, of which every test run does a handful. The seed is printed, and
//! `--seed N` draws the same again, though not the same moments: the machine has its part in those.

use std::time::{SystemTime, UNIX_EPOCH};

use anyhow::{Context as _, Result};

use crate::steps::{Steps, cargo, option};
use crate::tests;

/// Kills `--times N` processes (1,000), of `--side-by-side N` vehicles (4) at once, and prints the table.
pub(crate) fn run(steps: &mut Steps) -> Result<()> {
    let times = number("--times")?.unwrap_or(1_000);
    let side_by_side = number("--side-by-side")?.unwrap_or(4);
    let seed = match number("--seed")? {
        Some(seed) => seed,
        None => SystemTime::now().duration_since(UNIX_EPOCH)?.as_secs(),
    };
    tests::build(steps)?;
    let test = [
        "test",
        "--workspace",
        "--locked",
        "--test",
        "programs",
        "kills",
        "--",
        "--nocapture",
    ];
    steps.run(
        cargo(test)
            .env("VSM_KILLS", times.to_string())
            .env("VSM_KILLS_SIDE_BY_SIDE", side_by_side.to_string())
            .env("VSM_SEED", seed.to_string()),
    )
}

/// The whole number that follows an option.
pub(crate) fn number(name: &str) -> Result<Option<u64>> {
    let Some(given) = option(name) else {
        return Ok(None);
    };
    let text = given.to_string_lossy();
    let number = text
        .parse()
        .with_context(|| format!("{name} {text}: expected a whole number"))?;
    Ok(Some(number))
}
