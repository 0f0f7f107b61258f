//! `vsm demo --fleet N`: all vehicles fly their routes together over one port, the table says what the tracks show, and with a page
//! nobody flies them.

use std::process::{Command, Output};
use std::time::Duration;

use kit::process::{Running, program};

use super::demo_web::{address, json};

fn demo(arguments: &[&str]) -> (Output, String) {
    let out = tempfile::tempdir().expect("a folder");
    let done = Command::new(program("vsm"))
        .arg("demo")
        .args(arguments)
        .arg("--out")
        .arg(out.path())
        .output()
        .expect("it runs");
    let svg = std::fs::read_to_string(out.path().join("flight.svg")).unwrap_or_default();
    (done, svg)
}

/// The numbers in the row of the closing table with this name.
fn row(text: &str, name: &str) -> Vec<f64> {
    let line = text
        .lines()
        .find_map(|line| line.strip_prefix("  ")?.strip_prefix(name));
    let line = line.unwrap_or_else(|| panic!("no row {name:?} in:\n{text}"));
    let words = line.split([' ', ',']);
    words.filter_map(|word| word.parse().ok()).collect()
}

#[test]
fn a_fleet_flies_its_routes_together_over_one_port() {
    let (done, svg) = demo(&["--fleet", "3", "--speed", "5"]);
    let text = String::from_utf8(done.stdout).expect("text");
    let printed = String::from_utf8_lossy(&done.stderr);
    assert!(done.status.success(), "{text}\n{printed}");
    // Together: all are airborne before the first one flies its route, and all have flown it before the first one lands.
    let at = |what: &str| {
        let place = text.find(what);
        place.unwrap_or_else(|| panic!("no {what:?} in:\n{text}"))
    };
    assert!(at("all launched") < at("all fly the route"));
    assert!(at("all fly the route") < at("the routes are flown"));
    assert!(at("the routes are flown") < at("all landed"));
    assert_eq!(row(&text, "vehicles flown"), [3.0, 3.0]);
    assert_eq!(row(&text, "waypoints reached"), [12.0, 12.0]);
    let [lost, sent] = row(&text, "datagrams lost")[..] else {
        panic!("{text}")
    };
    // Loopback loses none unless a buffer is full.
    assert!(sent > 1_000.0 && lost < 0.02 * sent, "{text}");
    let [lost, sent] = row(&text, "messages lost")[..] else {
        panic!("{text}")
    };
    assert!(sent > 100.0 && lost < 0.02 * sent, "{text}");
    // A load, a launch, a route and a landing of each.
    let [p50_ms, p99_ms, commands] = row(&text, "first answer to a command")[..] else {
        panic!("{text}")
    };
    assert!(
        commands == 12.0 && p50_ms > 0.0 && p50_ms <= p99_ms,
        "{text}"
    );
    let [bridge, all] = row(&text, "CPU share")[..] else {
        panic!("{text}")
    };
    assert!(bridge > 0.0 && bridge < all, "{text}");
    assert!(!svg.contains("NaN"), "{svg}");
    // The others of the fleet, in the map and in the profile.
    assert_eq!(svg.matches("class=\"other\"").count(), 4, "{svg}");
    // The last line is the folder.
    let folder = text.lines().next_back().expect("a last line");
    assert!(folder.starts_with('/'), "{text}");
}

#[test]
fn a_fleet_with_a_page_is_left_to_who_opens_it() {
    let out = tempfile::tempdir().expect("a folder");
    let folder = out.path().to_str().expect("its name");
    let arguments = ["demo", "--fleet", "3", "--web", "0", "--out", folder];
    let mut demo = Running::start(&program("vsm"), arguments);
    demo.wait_for("3 vehicles are on the ground and nobody's", LIMIT);
    demo.wait_for("stays until Ctrl-C", LIMIT);
    let printed = demo.output();
    let status = json(address(&printed), "/status.json");
    let vehicles = status["vehicles"].as_array().expect("a list");
    assert_eq!(vehicles.len(), 3, "{status}");
    let mut keys: Vec<_> = vehicles
        .iter()
        .map(|vehicle| &vehicle["link"]["key_id"])
        .collect();
    for vehicle in vehicles {
        assert_eq!(vehicle["armed"], false, "{vehicle}");
        assert_eq!(vehicle["link"]["arrives"], "verified", "{vehicle}");
        assert_eq!(
            vehicle["link"]["address"], vehicles[0]["link"]["address"],
            "{vehicle}"
        );
    }
    // Each vehicle has a key of its own.
    keys.dedup();
    assert_eq!(keys.len(), 3, "{keys:?}");
    demo.signal("INT");
    let ended = demo.wait(LIMIT).expect("it ends");
    assert!(ended.success(), "{}", demo.output());
}

#[test]
fn a_fleet_of_none_or_too_many_is_refused_with_what_is_expected() {
    for count in ["0", "201", "many"] {
        let (done, svg) = demo(&["--fleet", count]);
        let printed = String::from_utf8_lossy(&done.stderr);
        assert_eq!(done.status.code(), Some(2), "{printed}");
        assert!(
            printed.contains("--fleet <N>") && printed.contains(count),
            "{printed}"
        );
        assert!(count == "many" || printed.contains("1..=200"), "{printed}");
        assert_eq!(svg, "", "nothing has flown");
    }
    // Fleets are of quadrotors on a route of straight legs.
    let (done, _) = demo(&["--fleet", "2", "--wing"]);
    assert_eq!(done.status.code(), Some(2));
}

const LIMIT: Duration = Duration::from_secs(60);
