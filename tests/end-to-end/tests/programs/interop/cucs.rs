//! A ground station that shares no code with the bridge flies a route through it, from discovery to
//! release, over signed MAVLink.

use std::fs;
use std::time::Duration;

use serde_json::Value;

use kit::process::{Running, filter, program};
use vsm_tests::ground::{Ground, HOME};
use vsm_tests::{here, plain_python};

#[test]
fn a_foreign_ground_station_flies_a_route() {
    let ground = Ground::new();
    let mut bridge = ground.bridge();
    let aircraft = ground.aircraft();

    let script = here().join("interop/fly.py").display().to_string();
    let report = ground.path("report.json").display().to_string();
    let dli = ground.dli();
    let arguments = [
        &script,
        "--vsm",
        &dli,
        "--bind",
        "127.0.0.1",
        "--home",
        HOME,
        "--report",
        &report,
    ];
    let mut station = Running::start(&plain_python(), arguments);
    let status = station.wait(FLIGHT);
    let all = || {
        format!(
            "the station:\n{}\nthe bridge:\n{}\nthe aircraft:\n{}",
            station.output(),
            bridge.output(),
            aircraft.output()
        )
    };
    let status = status.unwrap_or_else(|| panic!("no landing within {FLIGHT:?}\n{}", all()));
    assert!(status.success(), "{status}\n{}", all());

    let report = fs::read_to_string(&report).expect("the report");
    let report: Value = serde_json::from_str(&report).expect("a report in JSON");
    let checks = report["checks"].as_array().map_or(0, Vec::len);
    assert!(
        report["ok"] == true && checks >= 80,
        "{checks} checks\n{}",
        all()
    );

    // The flight has sent one of each of these, and more.
    let config = ground.path("vsm.toml").display().to_string();
    let arguments = ["status", "--json", "--config", &config];
    let status = filter(&program("vsm"), arguments, String::new());
    let status: Value = serde_json::from_str(&status).expect("a status in JSON");
    for name in [
        "misaddressed",
        "oversized",
        "truncated",
        "unauthorised source",
        "unknown message type",
        "without the right",
        "wrong checksum",
    ] {
        assert!(
            status["refused"][name].as_u64() >= Some(1),
            "{name}: {}",
            status["refused"]
        );
    }

    bridge.terminate();
    let status = bridge.wait(Duration::from_secs(2));
    assert!(
        status.is_some_and(|s| s.success()),
        "SIGTERM: {status:?}\n{}",
        bridge.output()
    );
}

/// A flight takes 40 s; a busy machine may need more.
const FLIGHT: Duration = Duration::from_secs(240);

#[test]
fn a_fixed_wing_is_flown_from_launch_to_landing() {
    on_wings("plane");
}

#[test]
fn a_vtol_is_flown_from_launch_to_landing() {
    on_wings("vtol");
}

/// Routes refused, an approach and a route, launch, course, loiter, the end of the route, go-around or hover, landing.
fn on_wings(airframe: &str) {
    let ground = Ground::new();
    let bridge = ground.bridge();
    let aircraft = ground.aircraft_with(&["--airframe", airframe, "--speed", FAST]);
    let script = here().join("interop/wings.py").display().to_string();
    let dli = ground.dli();
    let arguments = [
        &script,
        "--vsm",
        &dli,
        "--bind",
        "127.0.0.1",
        "--airframe",
        airframe,
        "--fast",
        FAST,
        "--leg",
        "150",
    ];
    let mut station = Running::start(&plain_python(), arguments);
    let status = station.wait(FLIGHT);
    assert!(
        status.is_some_and(|status| status.success()),
        "{status:?}\nthe station:\n{}\nthe bridge:\n{}\nthe aircraft:\n{}",
        station.output(),
        bridge.output(),
        aircraft.output()
    );
}

/// How much faster than time wings are flown.
/// Faster, a leg between two waypoints is over before a busy computer has reported it.
const FAST: &str = "12";

/// It sends to the group from one socket and receives from it on another.
#[test]
fn a_station_of_edition_25_flies_in_a_multicast_group() {
    let tables = "[[cucs]]\nid = \"1b:00:00:b0\"\nloi = [2, 3, 4, 5]\naddress = \"127.0.0.1\"\n";
    let (ground, group) = Ground::in_group(tables);
    let bridge = ground.bridge();
    let aircraft = ground.aircraft();
    let script = here().join("interop/cucs_ed25.py").display().to_string();
    let dli = ground.dli();
    let arguments = [
        &script,
        "--vsm",
        &dli,
        "--group",
        &group,
        "--bind",
        "127.0.0.1",
    ];
    let mut station = Running::start(&plain_python(), arguments);
    let status = station.wait(FLIGHT);
    assert!(
        status.is_some_and(|status| status.success())
            && station.output().contains("landed and released"),
        "{status:?}\n{}\nthe bridge:\n{}\nthe aircraft:\n{}",
        station.output(),
        bridge.output(),
        aircraft.output()
    );
}
