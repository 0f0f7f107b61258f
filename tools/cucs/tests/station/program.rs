//! The program `cucs`: exit status 0 done, 1 refused or no answer, 2 wrong arguments or a faulty file; one line with the reason.

use std::net::UdpSocket;
use std::process::{Command, Output};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use stanag_msgs::messages::VehicleSpecificWaypoint;

use crate::support::*;

fn cucs(vsm: &str, arguments: &[&str]) -> Output {
    let mut command = Command::new(env!("CARGO_BIN_EXE_cucs"));
    command.args(["--vsm", vsm]).args(arguments);
    command.output().unwrap()
}

fn result(output: &Output) -> (Option<i32>, String, String) {
    let text = |bytes: &[u8]| String::from_utf8_lossy(bytes).into_owned();
    (
        output.status.code(),
        text(&output.stdout),
        text(&output.stderr),
    )
}

/// Serves a VSM on a thread while `work` runs with its address.
fn with_vsm(mut vsm: FakeVsm, work: impl FnOnce(&str)) {
    let socket = UdpSocket::bind("127.0.0.1:0").unwrap();
    socket
        .set_read_timeout(Some(Duration::from_millis(20)))
        .unwrap();
    let address = socket.local_addr().unwrap().to_string();
    let over = Arc::new(AtomicBool::new(false));
    let ends = Arc::clone(&over);
    let serving = std::thread::spawn(move || {
        let mut buffer = [0; 2_048];
        while !ends.load(Ordering::Relaxed) {
            if let Ok((bytes, from)) = socket.recv_from(&mut buffer) {
                for answer in vsm.handle(&buffer[..bytes]) {
                    socket.send_to(&answer, from).unwrap();
                }
            }
        }
    });
    work(&address);
    over.store(true, Ordering::Relaxed);
    serving.join().unwrap();
}

#[test]
fn no_vsm_is_status_1_with_the_address() {
    let free = UdpSocket::bind("127.0.0.1:0")
        .unwrap()
        .local_addr()
        .unwrap()
        .to_string();
    let (status, _, error) = result(&cucs(&free, &["discover"]));
    assert_eq!(status, Some(1));
    assert!(
        error.contains(&format!("no answer from a VSM at {free} within 3 s")),
        "{error}"
    );
}

/// The VSM is there, but drops what it receives.
#[test]
fn a_vsm_that_does_not_answer_may_have_listed_the_id_in_another_way() {
    let silent = UdpSocket::bind("127.0.0.1:0").unwrap();
    let vsm = silent.local_addr().unwrap().to_string();
    for edition in ["2.5", "4"] {
        let arguments = ["--edition", edition, "--id", "1b:00:00:b0", "discover"];
        let (status, _, error) = result(&cucs(&vsm, &arguments));
        assert_eq!(status, Some(1), "{error}");
        let why = "does not list, or lists with another edition, address or guard; `vsm doctor` at the VSM";
        assert!(error.contains(why), "{edition}: {error}");
    }
}

/// Edition 2.5 has no UA State: the wait would never end.
#[test]
fn wait_landed_in_edition_2_5_is_an_error_at_once() {
    // Nobody answers there, but nothing is sent to it either.
    let silent = UdpSocket::bind("127.0.0.1:0").unwrap();
    let vsm = silent.local_addr().unwrap().to_string();
    for condition in ["landed", "airborne"] {
        let began = Instant::now();
        let arguments = ["--edition", "2.5", "wait", condition];
        let (status, out, error) = result(&cucs(&vsm, &arguments));
        assert_eq!(status, Some(2), "{condition}: {error}");
        assert!(began.elapsed() < Duration::from_secs(2), "{error}");
        assert!(out.is_empty(), "{out}");
        let why = "is not shown in Edition 2.5, whose #104 has no UA State";
        assert!(error.contains(why), "{condition}: {error}");
    }
}

#[test]
fn wrong_arguments_are_status_2() {
    for arguments in [
        &["mode", "flop"][..],
        &["launch"],
        &["send", "no-such-file.toml"],
        &["script", "no-such-file"],
        &["take", "--loi", "9"],
        &["--id", "1b:0", "discover"],
    ] {
        let (status, out, error) = result(&cucs("127.0.0.1:9", arguments));
        assert_eq!(status, Some(2), "{arguments:?}: {error}");
        assert!(out.is_empty() && !error.is_empty());
    }
    assert_eq!(result(&cucs("nowhere", &["discover"])).0, Some(2));
}

/// A Commanded Speed of 0 commands none: "0 m/s commanded" would be printed while the vehicle flies on.
#[test]
fn a_speed_that_is_rounded_to_0_is_status_2_with_option_and_value() {
    let commands: [(&[&str], &str); 5] = [
        (&["speed"], "METRES_PER_SECOND"),
        (&["fly", "--speed"], "--speed"),
        (&["loiter", "--speed"], "--speed"),
        (&["mode", "loiter", "--speed"], "--speed"),
        (
            &["hold", "1", "--until", "waypoint=3", "loiter", "--speed"],
            "--speed",
        ),
    ];
    for (command, option) in commands {
        for value in ["0", "-0", "0.2", "-5", "nan", "40000"] {
            let arguments = [command, &[value]].concat();
            let (status, out, error) = result(&cucs("127.0.0.1:9", &arguments));
            assert_eq!(status, Some(2), "{arguments:?}: {error}");
            for part in [
                option,
                &format!("'{value}'"),
                "expected 0.25 to 32767.5 m/s",
            ] {
                assert!(error.contains(part), "{arguments:?}: {part}: {error}");
            }
            assert!(out.is_empty(), "{out}");
        }
    }
}

#[test]
fn each_subcommand_may_be_a_process_of_its_own() {
    with_vsm(FakeVsm::new(), |vsm| {
        let done = |arguments: &[&str]| {
            let (status, out, error) = result(&cucs(vsm, arguments));
            assert_eq!(status, Some(0), "{arguments:?}: {error}");
            out
        };
        let discovered = done(&["discover"]);
        assert!(discovered.contains("1b:00:01:01 behind VSM 1b:00:00:01"));
        assert!(discovered.contains("2 (quadrotor in MAVLink's list)"));
        assert!(done(&["take", "--loi", "4,5"]).contains("LOI 4, 5 (control, launch) granted"));
        let route = concat!(
            env!("CARGO_MANIFEST_DIR"),
            "/../../examples/square.route.toml"
        );
        assert!(done(&["send", route, "--mission-id", "M2"]).contains("4 waypoints is aboard"));
        let plan = concat!(
            env!("CARGO_MANIFEST_DIR"),
            "/../curve-plan/tests/data/qgroundcontrol.plan"
        );
        let (status, _, error) = result(&cucs(vsm, &["send", plan, "--strict"]));
        assert_eq!(status, Some(1));
        assert!(error.contains("nothing was written or sent"), "{error}");
        let (status, out, error) = result(&cucs(vsm, &["--json", "send", plan]));
        assert_eq!(status, Some(0), "{error}");
        assert!(
            error.contains("3 of 7 items taken; lost: camera at item 5"),
            "{error}"
        );
        assert!(
            out.contains("\"waypoints\":4,\"losses\":{\"items\":7,\"taken\":3,"),
            "{out}"
        );
        assert!(done(&["download"]).contains("speed = 6\n"));
        assert!(done(&["send", route, "--mission-id", "M2"]).contains("4 waypoints is aboard"));
        assert!(done(&["--json", "launch", "30"]).contains("{\"done\":\"launched\"}"));
        assert!(done(&["download"]).contains("[[waypoint]]\nnumber = 10\n"));
        done(&["mode", "12", "--altitude", "40", "--position=-33.9,18.4"]);
        done(&["release"]);
        let (status, _, error) = result(&cucs(vsm, &["watch"]));
        assert_eq!(status, Some(1));
        assert!(error.contains("run `cucs take` first"), "{error}");
    });
}

#[test]
fn a_refusal_is_status_1_with_its_reason_and_stops_a_script() {
    let mut vsm = FakeVsm::new();
    vsm.refuse_mode = Some("mode 20 cannot be flown".into());
    with_vsm(vsm, |vsm| {
        let script = std::env::temp_dir().join(format!("{}.cucs", std::process::id()));
        std::fs::write(&script, "take\n\nmode 20 # no\nrelease\n").unwrap();
        let path = script.to_string_lossy().into_owned();
        let (status, out, error) = result(&cucs(vsm, &["script", &path]));
        std::fs::remove_file(&script).unwrap();
        assert_eq!(status, Some(1));
        assert!(
            error.contains(".cucs:3: mode 20 # no: 2016 mode 20 (wave-off) is refused: "),
            "{error}"
        );
        assert!(error.contains("mode 20 cannot be flown"), "{error}");
        assert!(
            out.contains("granted") && !out.contains("released"),
            "{out}"
        );
    });
}

#[test]
fn a_refusal_says_once_that_it_is_one() {
    let mut vsm = FakeVsm::new();
    vsm.refuse_mode = Some("mode 21 (launch): home is not known yet".into());
    with_vsm(vsm, |vsm| {
        assert_eq!(result(&cucs(vsm, &["take"])).0, Some(0));
        let (status, out, error) = result(&cucs(vsm, &["launch", "30"]));
        assert_eq!(status, Some(1), "{error}");
        let both = out + &error;
        assert_eq!(both.matches("refused").count(), 1, "{both}");
        assert_eq!(both.matches("home is not known yet").count(), 1, "{both}");
        // For programs the alert is an object of its own.
        let (_, out, _) = result(&cucs(vsm, &["--json", "launch", "30"]));
        assert!(out.contains("\"alert\":\"2016 refused: mode 21"), "{out}");
    });
}

#[test]
fn traffic_names_the_messages() {
    let script = std::env::temp_dir().join(format!("traffic-{}.cucs", std::process::id()));
    std::fs::write(&script, "discover\ntraffic\n").unwrap();
    with_vsm(FakeVsm::new(), |vsm| {
        let (status, out, error) = result(&cucs(vsm, &["script", &script.to_string_lossy()]));
        assert_eq!(status, Some(0), "{error}");
        let name = stanag_msgs::table::message(1).map(|message| message.name);
        let line = format!("1 {}: ", name.expect("message 1"));
        assert!(
            out.lines().any(|shown| shown.trim().starts_with(&line)),
            "{out}"
        );
    });
    std::fs::remove_file(&script).unwrap();
}

#[test]
fn a_route_is_sent_from_each_format_that_is_read() {
    let folder = std::env::temp_dir().join(format!("formats-{}", std::process::id()));
    std::fs::create_dir_all(&folder).unwrap();
    let data = concat!(env!("CARGO_MANIFEST_DIR"), "/../curve-plan/tests/data/");
    let examples = concat!(env!("CARGO_MANIFEST_DIR"), "/../../examples/");
    let geojson = folder.join("line.geojson");
    let line = r#"{"type": "LineString", "coordinates": [[8.5, 47.4, 510], [8.51, 47.4, 510]]}"#;
    std::fs::write(&geojson, line).unwrap();
    let flat = examples.to_owned() + "square.kml";
    let mut files = ["square.route.toml", "square.plan"]
        .map(|file| examples.to_owned() + file)
        .to_vec();
    files.extend(
        [
            "mavproxy.waypoints",
            "mavproxy-px4.txt",
            "google-earth.kml",
            "google-earth.kmz",
            "garmin.gpx",
            "spreadsheet.csv",
        ]
        .map(|file| data.to_owned() + file),
    );
    files.push(geojson.display().to_string());
    let endings: std::collections::BTreeSet<&str> = files
        .iter()
        .filter_map(|file| file.rsplit('.').next())
        .collect();
    let read = [
        "csv",
        "geojson",
        "gpx",
        "kml",
        "kmz",
        "plan",
        "toml",
        "txt",
        "waypoints",
    ];
    assert!(endings.into_iter().eq(read));
    for file in &files {
        with_vsm(FakeVsm::new(), |vsm| {
            assert_eq!(result(&cucs(vsm, &["take"])).0, Some(0));
            let (status, out, error) = result(&cucs(vsm, &["send", file]));
            assert_eq!(status, Some(0), "{file}: {error}");
            assert!(out.contains("is aboard"), "{file}: {out}");
        });
    }
    with_vsm(FakeVsm::new(), |vsm| {
        assert_eq!(result(&cucs(vsm, &["take"])).0, Some(0));
        // No altitude is invented.
        let (status, out, error) = result(&cucs(vsm, &["send", &flat]));
        assert_eq!(status, Some(2), "{out}{error}");
        assert!(
            error.contains("--height") && !out.contains("aboard"),
            "{out}{error}"
        );
        let (status, _, error) = result(&cucs(vsm, &["send", &flat, "--height", "30"]));
        assert_eq!(status, Some(0), "{error}");
    });
    std::fs::remove_dir_all(&folder).unwrap();
}

#[test]
fn a_plan_of_two_routes_is_fetched_as_a_file_that_can_be_sent_again() {
    let folder = std::env::temp_dir().join(format!("two-routes-{}", std::process::id()));
    std::fs::create_dir_all(&folder).unwrap();
    let at = |name: &str| folder.join(name).display().to_string();
    let route = |id: &str, first: u16, north: f64| {
        let waypoint = |number: u16, next: &str| {
            format!(
                "[[waypoint]]\nnumber = {number}\nlatitude = {}\nlongitude = 8.5\naltitude = 30\naltitude_type = \"agl\"\n{next}",
                north + f64::from(number) * 1e-5
            )
        };
        let last = waypoint(first + 1, "");
        format!(
            "id = \"{id}\"\ninitial = {first}\n{}{last}",
            waypoint(first, &format!("next = {}\n", first + 1))
        )
    };
    std::fs::write(at("a.route.toml"), route("a", 10, 47.3)).unwrap();
    std::fs::write(at("b.route.toml"), route("b", 50, 47.4)).unwrap();
    with_vsm(FakeVsm::new(), |vsm| {
        let done = |arguments: &[&str]| {
            let (status, out, error) = result(&cucs(vsm, arguments));
            assert_eq!(status, Some(0), "{arguments:?}: {error}");
            out
        };
        done(&["take"]);
        done(&["send", &at("a.route.toml")]);
        done(&["send", &at("b.route.toml")]);
        done(&["download", &at("both.route.toml")]);
        let both = std::fs::read_to_string(at("both.route.toml")).unwrap();
        done(&["download", "-o", &at("again.route.toml")]);
        let again = std::fs::read_to_string(at("again.route.toml")).unwrap();
        assert_eq!(again, both, "OUTPUT and -o OUTPUT are the same");
        let (status, _, error) = result(&cucs(vsm, &["download", "a", "-o", "b"]));
        assert_eq!(status, Some(2), "{error}");
        for number in [10, 11, 50, 51] {
            assert!(both.contains(&format!("number = {number}\n")), "{both}");
        }
        assert!(done(&["send", &at("both.route.toml")]).contains("4 waypoints is aboard"));
    });
    std::fs::remove_dir_all(&folder).unwrap();
}

#[test]
fn a_download_names_the_actions_that_its_file_lacks() {
    let folder = std::env::temp_dir().join(format!("actions-{}", std::process::id()));
    std::fs::create_dir_all(&folder).unwrap();
    let at = |name: &str| folder.join(name).display().to_string();
    let route = "[[waypoint]]\nnumber = 20\nlatitude = 47.3\nlongitude = 8.5\naltitude = 30\naltitude_type = \"agl\"\n";
    std::fs::write(at("a.route.toml"), route).unwrap();
    let mut vsm = FakeVsm::new();
    let photo = VehicleSpecificWaypoint {
        waypoint_number: Some(20),
        tag_type: Some(0),
        tag_data: Some("PHOTO".into()),
        ..VehicleSpecificWaypoint::default()
    };
    vsm.actions.push(photo.into());
    with_vsm(vsm, |vsm| {
        assert_eq!(result(&cucs(vsm, &["take"])).0, Some(0));
        let (status, _, error) = result(&cucs(vsm, &["send", &at("a.route.toml")]));
        assert_eq!(status, Some(0), "{error}");
        let out = at("back.route.toml");
        let (status, _, error) = result(&cucs(vsm, &["download", &out]));
        assert_eq!(status, Some(0), "{error}");
        let lost = "lost: vehicle-specific action (13006) at waypoint 20";
        assert!(error.contains(&out) && error.contains(lost), "{error}");
        for arguments in [&["--json", "download"][..], &["--json", "download", &out]] {
            let (status, printed, error) = result(&cucs(vsm, arguments));
            assert_eq!(status, Some(0), "{error}");
            let losses = r#""lost":[{"what":"vehicle-specific action (13006)","item":20}]"#;
            assert!(printed.contains(losses), "{printed}");
        }
    });
    std::fs::remove_dir_all(&folder).unwrap();
}
