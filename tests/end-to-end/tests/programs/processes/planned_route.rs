//! `curve-plan send`: a planned route goes through the bridge to the aircraft as a ground station's would, comes back as
//! it was, and what is refused is reported with its reason.

use std::fs;
use std::process::{Command, Output};
use std::time::{Duration, Instant};

use serde_json::Value;

use kit::process::program;
use vsm_tests::ground::Ground;

/// A curve of 150 m that climbs, then a straight leg.
const ROUTE: &str = r#"id = "bend"
[defaults]
altitude = 30.0
altitude_type = "agl"
speed = 5.0
[[waypoint]]
number = 10
latitude = 47.3980
longitude = 8.5460
[[waypoint]]
number = 20
latitude = 47.3986
longitude = 8.5480
[[waypoint]]
number = 30
latitude = 47.3980
longitude = 8.5490
[[curve]]
from = 10
to = 20
p2 = [47.3990, 8.5462, 32.0]
p3 = [47.3992, 8.5474, 30.0]
altitude_type = "agl"
"#;

#[test]
fn a_planned_route_is_uploaded_and_the_rights_are_given_back() {
    let ground = Ground::new();
    let _bridge = ground.bridge();
    let _aircraft = ground.aircraft();
    fs::write(ground.path("bend.toml"), ROUTE).expect("the route");

    // The aircraft may not have reported its position yet: then the route is refused, and sent again.
    let end = Instant::now() + PATIENCE;
    let printed = loop {
        let sent = run(
            &ground,
            "curve-plan",
            &["send", "bend.toml", "--json", "--vsm", &ground.dli()],
        );
        if sent.status.success() {
            break lines(&sent);
        }
        assert_eq!(sent.status.code(), Some(1), "{sent:?}");
        assert!(Instant::now() < end, "{sent:?}");
        std::thread::sleep(Duration::from_millis(200));
    };
    assert!(
        printed
            .iter()
            .any(|line| line["loaded"] == "bend.toml" && line["waypoints"] == 3),
        "{printed:?}"
    );
    let curves = |line: &Value| line.to_string().contains("1 curved legs in");
    assert!(printed.iter().any(curves), "{printed:?}");
    let last_rights = printed.iter().rev().find(|line| !line["granted"].is_null());
    assert_eq!(
        last_rights
            .map(|line| line["granted"].to_string())
            .as_deref(),
        Some("[]")
    );

    let vsm = ground.dli();
    let cucs = |verb: &[&str]| {
        let done = run(&ground, "cucs", &[&["--vsm", vsm.as_str()], verb].concat());
        assert!(done.status.success(), "{verb:?}: {done:?}");
    };
    cucs(&["take"]);
    cucs(&["download", "-o", "back.toml"]);
    let dense = |file: &str| -> Value {
        let done = run(&ground, "curve-plan", &["densify", file, "--json"]);
        lines(&done).remove(0)
    };
    let (there, back) = (dense("bend.toml"), dense("back.toml"));
    assert_eq!(there["items"], back["items"]);
    // The messages carry angles in steps of 8.4e-8 degree.
    let pairs = there["vertices"]
        .as_array()
        .into_iter()
        .flatten()
        .zip(back["vertices"].as_array().into_iter().flatten());
    for (a, b) in pairs {
        let off = |key: &str| {
            (a[key].as_f64().unwrap_or(f64::NAN) - b[key].as_f64().unwrap_or(f64::NAN)).abs()
        };
        assert!(
            off("lat_deg") < 2e-7 && off("lon_deg") < 2e-7 && off("alt_m") < 0.05,
            "{a} {b}"
        );
    }

    // A station that holds rights keeps them.
    let sent = run(
        &ground,
        "curve-plan",
        &["send", "bend.toml", "--json", "--vsm", &ground.dli()],
    );
    assert!(sent.status.success(), "{sent:?}");
    assert!(
        lines(&sent).iter().all(|line| line["granted"].is_null()),
        "{sent:?}"
    );
}

#[test]
fn what_is_refused_has_its_reason() {
    let ground = Ground::new();
    let _bridge = ground.bridge();
    fs::write(ground.path("bend.toml"), ROUTE).expect("the route");
    let vsm = ground.dli();
    let status = |arguments: &[&str]| {
        let all = [&["send", "bend.toml"], arguments].concat();
        let sent = run(&ground, "curve-plan", &all);
        (
            sent.status.code(),
            String::from_utf8_lossy(&sent.stderr).into_owned(),
        )
    };
    let (code, printed) = status(&["--vsm", &vsm, "--id", "1b:00:00:ff"]);
    assert_eq!(code, Some(1), "{printed}");
    assert!(printed.contains("no answer from a VSM"), "{printed}");
    let (code, printed) = status(&["--vsm", &vsm, "--vehicle", "1b:00:01:09"]);
    assert_eq!(code, Some(1), "{printed}");
    assert!(
        printed.contains("1b:00:01:09 does not answer; discovered: 1b:00:01:01"),
        "{printed}"
    );
    let (code, printed) = status(&["--vsm", "nowhere"]);
    assert_eq!(code, Some(2), "{printed}");
    assert!(printed.contains("expected HOST:PORT"), "{printed}");
}

fn run(ground: &Ground, name: &str, arguments: &[&str]) -> Output {
    Command::new(program(name))
        .args(arguments)
        .current_dir(ground.path(""))
        .output()
        .expect("the program runs")
}

fn lines(done: &Output) -> Vec<Value> {
    let text = String::from_utf8_lossy(&done.stdout);
    text.lines()
        .map(|line| serde_json::from_str(line).expect("JSON"))
        .collect()
}

const PATIENCE: Duration = Duration::from_secs(30);
