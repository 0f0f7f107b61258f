//! What the tests of all crates share.
//!
//! | module | what it is for |
//! |---|---|
//! | [`attacks`] | how much of an attack a test makes: a little, or with `cargo xtask attacks` all |
//! | [`network`] | a simulated network: loss, duplication, reordering, delay and damage, by a seed |
//! | [`clock`] | a virtual clock, whose wall clock can be stepped and whose process can restart |
//! | [`curves`] | random curved legs, and oracles that share nothing with `curve-paths` |
//! | [`captures`] | the recorded sessions with real autopilots (`tests/data/captures`) |
//! | [`process`] | programs under test: start, wait for a line, terminate by process id; free ports, key files |
//! | [`relay`] | the simulated network between two real UDP sockets |
//! | [`serial`] | serial lines made of pseudo terminals |
//! | [`streams`] | what PX4 sends on a radio |
//! | [`heap`] | an allocator that counts |
//! | [`measure`] | for benches: turns in random order, medians with their spread, what a process takes |
//! | `any_input` (feature `any_input`) | what has to hold for any bytes at all: the targets of fuzzing |
//! | `bridge` (feature `bridge`) | the bridge with simulated vehicles and ground stations |
//! | `web` (feature `web`) | a client of the page's WebSocket |
//! | [`tools`] | other people's programs that a test needs, and what happens where one is missing |
//!
//! Randomness comes from [`Random`]: the same seed gives the same history.
//!
//! ```
//! use std::time::Duration;
//! use kit::network::{Faults, Network};
//!
//! let mut network = Network::new(7, Faults { loss: 0.5, ..Faults::NONE });
//! for n in 0..100 {
//!     network.send(Duration::ZERO, "ground", "air", vec![n]);
//! }
//! let mut arrived = 0;
//! while network.receive(Duration::from_secs(1)).is_some() {
//!     arrived += 1;
//! }
//! assert_eq!(arrived + network.lost(), 100);
//! ```
#![allow(
    clippy::missing_panics_doc,
    reason = "a panic is how a test's support reports a failure"
)]

#[cfg(feature = "any_input")]
pub mod any_input;
pub mod attacks;
#[cfg(feature = "bridge")]
pub mod bridge;
pub mod captures;
pub mod clock;
pub mod curves;
#[cfg(feature = "bridge")]
pub mod etcd;
pub mod heap;
pub mod measure;
pub mod network;
pub mod process;
pub mod relay;
pub mod serial;
pub mod streams;
pub mod tools;
#[cfg(feature = "web")]
pub mod web;

use std::path::Path;

/// A seeded pseudo-random number generator: `Random::with_seed(7)`.
pub use fastrand::Rng as Random;

/// The root of the workspace.
pub fn workspace() -> &'static Path {
    let package = Path::new(env!("CARGO_MANIFEST_DIR"));
    package
        .ancestors()
        .nth(2)
        .expect("tests/kit lies two folders below")
}

/// Every `nth` of cases that can be enumerated; all of them with `VSM_ALL_CASES` set
/// (`cargo xtask test --all-cases`).
#[must_use]
pub fn every(nth: usize) -> usize {
    let all = std::env::var_os("VSM_ALL_CASES").is_some();
    if all { 1 } else { nth }
}
