//! What outlives the end of a process: the bridge keeps plan, authority and signing clock over `kill -9`,
//! and accepts an aircraft again whose stamps have fallen back with its restart.

use std::time::Duration;

use kit::process::Running;
use vsm_tests::ground::{Ground, HOME};
use vsm_tests::{here, plain_python};

#[test]
fn the_bridge_keeps_plan_authority_and_clock_over_a_kill() {
    let ground = Ground::new();
    let bridge = ground.bridge();
    let aircraft = ground.aircraft();
    station(&ground, "prepare", &[&bridge, &aircraft]);

    // Dropping it is SIGKILL: nothing can be written any more.
    drop(bridge);
    let bridge = ground.bridge();
    station(&ground, "resume", &[&bridge, &aircraft]);
}

#[test]
fn an_aircraft_that_restarts_is_missed_and_its_link_restored() {
    let ground = Ground::new();
    let bridge = ground.bridge();
    let aircraft = ground.aircraft();
    station(&ground, "return", &[&bridge, &aircraft]);

    drop(aircraft);
    station(&ground, "silence", &[&bridge]);

    let aircraft = ground.aircraft();
    station(&ground, "return", &[&bridge, &aircraft]);
}

/// Runs one part of the story as a ground station; its verdict is the test's.
pub(super) fn station(ground: &Ground, part: &str, others: &[&Running]) {
    let script = here().join("interop/survive.py").display().to_string();
    let dli = ground.dli();
    let arguments = [
        script.as_str(),
        part,
        "--vsm",
        &dli,
        "--bind",
        "127.0.0.1",
        "--home",
        HOME,
    ];
    let mut station = Running::start(&plain_python(), arguments);
    let status = station.wait(PART);
    let mut all = station.output();
    for other in others {
        all.push_str("\n----\n");
        all.push_str(&other.output());
    }
    assert!(
        status.is_some_and(|s| s.success()),
        "{part}: {status:?}\n{all}"
    );
}

/// A part takes 20 s; a busy machine may need more.
const PART: Duration = Duration::from_secs(120);
