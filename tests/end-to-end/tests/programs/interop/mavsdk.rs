//! MAVSDK as the vehicle: its mission, action and parameter servers take a route and commands from the bridge, signed
//! by the bridge and verified by pymavlink on the way, and the same without signatures.

use std::time::Duration;

use kit::process::Running;
use vsm_tests::ground::Ground;
use vsm_tests::{here, peers_python};

#[test]
fn mavsdk_takes_routes_and_commands_signed() {
    let ground = Ground::new();
    let key = ground.path("uav1.key").display().to_string();
    fly(&ground, &["--key-file", &key]);
}

#[test]
fn mavsdk_takes_routes_and_commands_unsigned() {
    fly(&Ground::unsigned(), &[]);
}

fn fly(ground: &Ground, further: &[&str]) {
    let bridge = ground.bridge();
    let script = here()
        .join("interop/mavsdk_flight.py")
        .display()
        .to_string();
    let (dli, link) = (ground.dli(), ground.link());
    let arguments = [script.as_str(), "--vsm", &dli, "--link", &link];
    let arguments = arguments.iter().chain(further);
    let mut flight = Running::start(&peers_python(), arguments);
    let status = flight.wait(FLIGHT);
    assert!(
        status.is_some_and(|s| s.success()),
        "{status:?}\n{}\n----\n{}",
        flight.output(),
        bridge.output()
    );
}

/// A flight takes 15 s; a busy machine may need more.
const FLIGHT: Duration = Duration::from_secs(120);
