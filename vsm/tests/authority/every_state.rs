//! The promises of the authority machine, checked over every state of smaller scopes.
//!
//! The whole scope takes minutes and is run by hand; its figures are in docs/guide/authority.md:
//!
//! ```text
//! cargo test --release -p vsm --test authority every_state_of_growing_scopes -- --ignored --nocapture
//! ```
//!
//! `VSM_MODEL_SECONDS=300` bounds each scope; without it each is visited to its end.
#![allow(clippy::print_stdout, reason = "its figures are its product")]

use std::time::{Duration, Instant};

use crate::model::{AuthorityModel, FULL, Scope};
use stateright::{Checker as _, Model as _};

fn check(scope: Scope, min_states: usize) {
    let checker = AuthorityModel::new(scope)
        .checker()
        .threads(1)
        .spawn_bfs()
        .join();
    checker.assert_properties();
    checker.model().assert_moved();
    assert!(
        checker.unique_state_count() >= min_states,
        "only {} states: the model does not move",
        checker.unique_state_count()
    );
}

#[test]
fn two_cucs_with_a_station_loads_launches_and_silence() {
    let scope = Scope {
        cucs: 2,
        stations: 1,
        monitors: false,
        ..FULL
    };
    check(scope, 300);
}

#[test]
fn three_cucs_for_control_through_loads_launches_and_silence() {
    let scope = Scope {
        stations: 0,
        monitors: false,
        ..FULL
    };
    check(scope, 300);
}

#[test]
fn three_cucs_for_control_and_a_station() {
    let scope = Scope {
        stations: 1,
        monitors: false,
        silence: false,
        phases: false,
        ..FULL
    };
    check(scope, 200);
}

/// A CUCS is taken out of the configuration and listed again, and another may hold less and more, also while it controls, while a
/// handover waits, and while it is silent.
#[test]
fn two_cucs_while_the_configuration_is_read_again() {
    let scope = Scope {
        cucs: 2,
        stations: 1,
        monitors: false,
        phases: false,
        reloads: true,
        ..FULL
    };
    check(scope, 100);
}

/// The scope whose every state is visited in minutes, here to the depth that seconds allow.
#[test]
fn every_history_of_three_inputs_in_the_whole_scope() {
    let checker = AuthorityModel::new(FULL)
        .checker()
        .threads(1)
        .target_max_depth(4)
        .spawn_bfs()
        .join();
    checker.assert_no_discovery("at most one holder of each right");
    checker.assert_no_discovery("no command without its right at that moment");
    checker.assert_no_discovery("a granted request is never lost");
    checker.assert_no_discovery("a restart changes nothing");
    checker.assert_no_discovery("a release leads to free");
    checker.assert_no_discovery("no two handovers are of one right");
}

/// Up to 3 CUCSs and 2 payload stations with loss, duplication, reordering, silence, loads, launches and restarts.
#[test]
#[ignore = "takes minutes even in a release build"]
fn every_state_of_growing_scopes_up_to_the_whole() {
    let limit = std::env::var("VSM_MODEL_SECONDS").ok();
    let limit = limit.map(|text| Duration::from_secs(text.parse().expect("seconds")));
    for scope in GROWING {
        let started = Instant::now();
        let model = AuthorityModel::new(scope);
        let properties = model.properties();
        let mut checker = model.checker().threads(1);
        if let Some(limit) = limit {
            checker = checker.timeout(limit);
        }
        let checker = checker.spawn_bfs().join();
        let took = started.elapsed();
        let whole = limit.is_none_or(|limit| took < limit);
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
}

const GROWING: [Scope; 5] = [
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
