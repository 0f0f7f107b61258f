//! Checks the authority machine over every state of growing scopes, up to 3 CUCSs and 2 payload stations with loss,
//! duplication, reordering, silence, loads, launches and restarts. The argument bounds each scope, s; without it
//! each is visited to its end. `cargo run --release -p vsm --example authority_model -- 300`.
#![expect(clippy::print_stdout, reason = "its figures are its product")]

#[path = "../tests/authority_support/model.rs"]
mod model;

use std::time::{Duration, Instant};

use model::{AuthorityModel, FULL, Scope};
use stateright::{Checker as _, Model as _};

fn main() {
    let limit = std::env::args().nth(1).and_then(|text| text.parse().ok());
    for scope in SCOPES {
        let started = Instant::now();
        let model = AuthorityModel::new(scope);
        let properties = model.properties();
        let mut checker = model.checker().threads(1);
        if let Some(limit) = limit {
            checker = checker.timeout(Duration::from_secs(limit));
        }
        let checker = checker.spawn_bfs().join();
        let took = started.elapsed();
        let whole = limit.is_none_or(|limit| took < Duration::from_secs(limit));
        println!(
            "{scope:?}: {} states, {} steps, depth {}, {:.1} s, {}",
            checker.unique_state_count(),
            checker.state_count(),
            checker.max_depth(),
            took.as_secs_f64(),
            if whole {
                "every state"
            } else {
                "not to the end"
            },
        );
        for property in properties {
            checker.assert_no_discovery(property.name);
        }
        if whole {
            checker.model().assert_moved();
        }
    }
    println!("every property holds");
}

const SCOPES: [Scope; 5] = [
    Scope {
        cucs: 2,
        stations: 1,
        monitors: false,
        ..FULL
    },
    Scope {
        stations: 0,
        monitors: false,
        ..FULL
    },
    Scope {
        silence: false,
        phases: false,
        monitors: false,
        ..FULL
    },
    Scope {
        stations: 1,
        monitors: false,
        ..FULL
    },
    FULL,
];
