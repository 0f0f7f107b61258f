//! The promises of the authority machine, checked over every state of smaller scopes; the whole scope is run by
//! `cargo run --release -p vsm --example authority_model`, its figures are in docs/guide/authority.md.

#[path = "authority_support/model.rs"]
mod model;

use model::{AuthorityModel, FULL, Scope};
use stateright::{Checker as _, Model as _};

fn check(scope: Scope, at_least: usize) {
    let checker = AuthorityModel::new(scope)
        .checker()
        .threads(1)
        .spawn_bfs()
        .join();
    checker.assert_properties();
    checker.model().assert_moved();
    assert!(
        checker.unique_state_count() >= at_least,
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
