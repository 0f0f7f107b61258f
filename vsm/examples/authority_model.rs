//! Checks the authority machine over every state of its whole scope: 3 CUCSs, 2 payload stations, loss, duplication,
//! reordering, silence, loads, launches and restarts. `cargo run --release -p vsm --example authority_model`.
#![expect(clippy::print_stdout, reason = "its figures are its product")]

#[path = "../tests/authority_support/model.rs"]
mod model;

use std::time::Instant;

use model::{AuthorityModel, FULL};
use stateright::{Checker as _, Model as _};

fn main() {
    let started = Instant::now();
    let checker = AuthorityModel { scope: FULL }
        .checker()
        .threads(2)
        .spawn_bfs()
        .join();
    println!(
        "{} states, {} steps, depth {}, {:.1} s",
        checker.unique_state_count(),
        checker.state_count(),
        checker.max_depth(),
        started.elapsed().as_secs_f64()
    );
    checker.assert_properties();
    println!("every property holds");
}
