//! The operator's page in Debian's Chromium, driven by Playwright: what it shows of a vehicle in flight, and how it behaves.

use std::process::Command;
use std::time::Duration;

use kit::process::{Running, filter, program};
use kit::tools::works;
use vsm_tests::ground::{Ground, HOME};
use vsm_tests::{here, peers_python};

#[test]
fn the_page_is_quick_small_accessible_and_usable_in_a_flood_of_alerts() {
    if !there_is_a_browser() {
        return;
    }
    let ground =
        Ground::with_tables("[record]\ndir = \"records\"\n[web]\ntiles = \"map.pmtiles\"\n");
    let tiles = ground.path("map.pmtiles").display().to_string();
    make_tiles(&tiles);
    let mut bridge = ground.bridge();
    let aircraft = ground.aircraft_with(&["--speed", "3"]);
    fly_the_square(&ground, &mut bridge);
    drive("page_reads.py", &[&ground.page()], &bridge);
    drop(aircraft);
    bridge.terminate();
    bridge.wait(LIMIT).expect("it ends");

    // What was just flown, as a recording.
    let records = ground.path("records").display().to_string();
    let listen = "127.0.0.1:0";
    let arguments = ["replay", &records, "--listen", listen, "--tiles", &tiles];
    let mut replay = Running::start(&program("vsm"), arguments);
    replay.wait_for("ready", LIMIT);
    let printed = replay.output();
    let page = printed
        .split_whitespace()
        .find(|word| word.starts_with("http://"));
    drive("page_replays.py", &[page.expect("its address")], &replay);
}

#[test]
fn a_route_is_drawn_sent_flown_and_seen_and_who_may_not_is_kept_out() {
    if !there_is_a_browser() {
        return;
    }
    let ground = Ground::with_tables(&format!(
        r#"
[web]
control = true
[[cucs]]
id = "{PILOT}"
loi = [2, 4, 5]
guard = {{ key_file = "pilot.key" }}
web = true
"#
    ));
    let key = ground.path("pilot.key");
    let made = Running::start(
        &program("vsm"),
        ["guard".as_ref(), "keygen".as_ref(), key.as_os_str()],
    )
    .wait(LIMIT);
    assert!(made.is_some_and(|status| status.success()), "{made:?}");
    let mut bridge = ground.bridge();
    let aircraft = ground.aircraft_with(&["--speed", "3"]);
    bridge.wait_for("the link is live", LIMIT);
    let key = key.display().to_string();
    let vehicle = aircraft.id().to_string();
    let cucs = program("cucs");
    let second = format!("{} --vsm {} ask", cucs.display(), ground.dli());
    let arguments = [
        &ground.page(),
        PILOT,
        &key,
        "--low-battery",
        &vehicle,
        "--second",
        &second,
    ];
    drive("page_commands.py", &arguments, &bridge);
}

/// Until the vehicle flies the route.
fn fly_the_square(ground: &Ground, bridge: &mut Running) {
    bridge.wait_for("the link is live", LIMIT);
    let route = kit::workspace().join("examples/square.route.toml");
    let route = route.display();
    // A link is live before what the vehicle reports by it is.
    let script = format!(
        "take\nwatch --seconds 3\nsend {route}\nlaunch 30\nwait airborne\nfly\nwait waypoint 20\n"
    );
    std::fs::write(ground.path("flight.cucs"), script).expect("the script");
    let flight = ground.path("flight.cucs").display().to_string();
    let arguments = ["--vsm", &ground.dli(), "script", &flight];
    filter(&program("cucs"), arguments, String::new());
}

fn there_is_a_browser() -> bool {
    works("chromium", Command::new("chromium").arg("--version"))
}

/// Pictures of the ground around where the vehicle stands.
fn make_tiles(file: &str) {
    let script = here().join("interop/map_tiles.py").display().to_string();
    let place: Vec<&str> = HOME.split(',').take(2).collect();
    let arguments = [script.as_str(), file].into_iter().chain(place);
    let mut made = Running::start(&peers_python(), arguments);
    let status = made.wait(LIMIT);
    assert!(
        status.is_some_and(|status| status.success()),
        "{}",
        made.output()
    );
}

/// Runs one of the programs that drive the browser to its end.
fn drive(script: &str, arguments: &[&str], served_by: &Running) {
    let script = here().join("interop").join(script).display().to_string();
    let arguments = [script.as_str()]
        .into_iter()
        .chain(arguments.iter().copied());
    let mut driver = Running::start(&peers_python(), arguments);
    let status = driver.wait(LIMIT);
    assert!(
        status.is_some_and(|status| status.success()),
        "{status:?}\n{}\n----\n{}",
        driver.output(),
        served_by.output()
    );
}

const PILOT: &str = "1b:00:00:b0";
/// A run takes a minute; a busy machine may need more.
const LIMIT: Duration = Duration::from_secs(240);
