//! `check`: what is too tight to fly, and what a recorded flight measured.

use crate::{Files, ROUTE};

/// Below the route.
const HOME: &str = "47.3977,8.5456,488";

#[test]
fn check_finds_the_tight_place_and_refuses_where_requested() {
    let files = Files::new();
    let report = files.json(&[
        "check",
        "route.toml",
        "--home",
        HOME,
        "--speed",
        "30",
        "--airframe",
        "plane",
        "--slowest",
        "5",
        "--bank",
        "30",
        "--json",
    ]);
    let fastest = report["fastest_mps"].as_f64().unwrap();
    assert!(
        fastest < 30.0 && !report["changes"].as_array().unwrap().is_empty(),
        "{report}"
    );
    assert_eq!(report["tight"][0]["leg"], 1);
    let (status, printed) = files.refused(&[
        "check",
        "route.toml",
        "--home",
        HOME,
        "--speed",
        "30",
        "--airframe",
        "plane",
        "--bank",
        "30",
        "--policy",
        "refuse",
    ]);
    assert_eq!(status, 1);
    assert!(
        printed.contains("leg 1 at t = ") && printed.contains("at most"),
        "{printed}"
    );
    assert!(
        files
            .done(&["check", "route.toml", "--home", HOME])
            .contains("predicted and not promised")
    );
    assert_eq!(files.refused(&["check", "route.toml", "--bank", "90"]).0, 2);
}

#[test]
fn check_flies_each_leg_at_the_speed_that_the_file_names() {
    let files = Files::new();
    let fast = ROUTE.replace("[defaults]\n", "[defaults]\nspeed = 20.0\n");
    files.put("fast.toml", &fast);
    // A slower leg to the curve, which begins at waypoint 20.
    let slow = fast.replace("altitude = 510.0\n", "altitude = 510.0\nspeed = 12.0\n");
    files.put("slow.toml", &slow);
    let check = |file: &str, speed: &str| {
        let route = ["check", file, "--home", HOME, "--speed", speed, "--json"];
        let plane = ["--airframe", "plane", "--slowest", "5", "--bank", "30"];
        files.json(&[&route[..], &plane, &["--wind", "0"]].concat())
    };
    let (named, given) = (check("fast.toml", "5"), check("route.toml", "20"));
    for key in ["changes", "time_s", "predicted_deviation_m"] {
        assert_eq!(named[key], given[key], "{key}");
    }
    let slow = check("slow.toml", "5");
    assert_eq!(slow["speeds_mps"], serde_json::json!([12.0, 20.0]));
    let figure = |report: &serde_json::Value, key: &str| report[key].as_f64().unwrap();
    assert!(figure(&slow, "time_s") > figure(&named, "time_s"));
    // It speeds up where the curve begins, and not before.
    let changes = serde_json::json!([{ "vertex": 1, "speed_mps": 20.0 }]);
    assert_eq!(
        (&slow["changes"], &named["changes"]),
        (&changes, &serde_json::json!([]))
    );
}

#[test]
fn check_takes_the_airframe_of_a_vehicle_file() {
    let files = Files::new();
    files.put(
        "wing.toml",
        include_str!("../../../../examples/plane.airframe.toml"),
    );
    files.put(
        "wing.params",
        "# Onboard parameters\n1\t1\tMAV_TYPE\t22\t6\n1\t1\tFW_R_LIM\t45.0\t9\n1\t1\tSYS_AUTOSTART\t10043\t6\n",
    );
    files.put("quad.toml", "MAV_TYPE = 2\nMPC_ACC_HOR = 1.0\n");
    let check = |airframe: &str, more: &[&str]| {
        let common = [
            "check",
            "route.toml",
            "--home",
            HOME,
            "--speed",
            "15",
            "--json",
        ];
        files.json(&[&common[..], &["--airframe", airframe], more].concat())
    };
    let figure = |report: &serde_json::Value, key: &str| report[key].as_f64().unwrap();
    let file = check("wing.toml", &[]);
    // 45 degrees of bank: the same as by the option, and less than the 50 of PX4.
    let [saved, option, px4] = [
        check("wing.params", &[]),
        check("plane", &["--bank", "45"]),
        check("plane", &[]),
    ];
    assert_eq!(figure(&file, "fastest_mps"), figure(&option, "fastest_mps"));
    assert_eq!(
        figure(&saved, "fastest_mps"),
        figure(&option, "fastest_mps")
    );
    assert!(figure(&file, "fastest_mps") < figure(&px4, "fastest_mps"));
    // 8 m/s of wind in the file, 5 where the file does not name it.
    let predicted = "predicted_deviation_m";
    assert!(figure(&file, predicted) > figure(&saved, predicted));
    let lazy = check("quad.toml", &[]);
    assert!(figure(&lazy, "fastest_mps") < figure(&check("quad", &[]), "fastest_mps"));
}

#[test]
fn a_mistake_in_a_vehicle_file_is_named() {
    let files = Files::new();
    for (name, text, named) in [
        ("a.toml", "FW_R_LIM = 45.0\n", "MAV_TYPE is missing"),
        (
            "b.toml",
            "MAV_TYPE = 6\n",
            "key MAV_TYPE: MAV_TYPE is 6, expected 1 (fixed wing)",
        ),
        (
            "c.toml",
            "MAV_TYPE = 1\nFW_RLIM = 45\n",
            "FW_RLIM is unknown, expected one of FW_AIRSPD_MIN",
        ),
        (
            "d.toml",
            "MAV_TYPE = 1\nFW_R_LIM = 90\n",
            "FW_R_LIM is 90, expected more than 0 and at most 84",
        ),
        (
            "e.toml",
            "MAV_TYPE = 1\nFW_R_LIM = \"45\"\n",
            "key FW_R_LIM: \"45\", expected a number",
        ),
        (
            "f.toml",
            "MAV_TYPE = 1\nFW_R_LIM = nan\n",
            "FW_R_LIM is NaN",
        ),
        ("g.toml", "MAV_TYPE = \n", "line 1"),
        (
            "h.params",
            "1\t1\tMAV_TYPE\t1\t6\n1\t1\tFW_R_LIM\n",
            "line 2: ",
        ),
        (
            "i.params",
            "1\t1\tMAV_TYPE\t1\t6\n1\t1\tFW_R_LIM\tx\t9\n",
            "line 2: FW_R_LIM is \"x\", expected a number",
        ),
        (
            "j.params",
            "1\t1\tMAV_TYPE\t1\t6\n1\t1\tNPFG_PERIOD\t-1\t9\n",
            "line 2: NPFG_PERIOD is -1",
        ),
    ] {
        files.put(name, text);
        let (status, printed) =
            files.refused(&["check", "route.toml", "--home", HOME, "--airframe", name]);
        assert!(
            status == 2 && printed.contains(name) && printed.contains(named),
            "{status} {printed}"
        );
    }
    for (airframe, named) in [
        ("missing.toml", "missing.toml"),
        ("glider", "expected quad, plane"),
    ] {
        let (status, printed) = files.refused(&[
            "check",
            "route.toml",
            "--home",
            HOME,
            "--airframe",
            airframe,
        ]);
        assert!(status == 2 && printed.contains(named), "{status} {printed}");
    }
}

/// A .tlog record of a MAVLink 1 GLOBAL_POSITION_INT.
pub(crate) fn record(lat_deg: f64, lon_deg: f64, alt_m: f64) -> Vec<u8> {
    let mut frame = vec![0xfe, 28, 0, 1, 1, 33];
    let numbers = [1_000.0, lat_deg * 1e7, lon_deg * 1e7, alt_m * 1e3];
    frame.extend(numbers.map(|x| (x.round() as i32).to_le_bytes()).concat());
    frame.resize(6 + 28, 0);
    let crc = frame[1..].iter().chain([&104]).fold(0xffff_u16, |crc, &b| {
        let mut t = b ^ (crc & 0xff) as u8;
        t ^= t << 4;
        let t = u16::from(t);
        (crc >> 8) ^ (t << 8) ^ (t << 3) ^ (t >> 4)
    });
    frame.extend(crc.to_le_bytes());
    [vec![0; 8], frame].concat()
}

#[test]
fn check_measures_a_recorded_flight() {
    let files = Files::new();
    let flat = ROUTE.replace("510.0", "500.0").replace("540.0", "500.0");
    files.put(
        "flat.toml",
        &flat.replace(", 515.0", "").replace(", 560.0", ""),
    );
    let fine = files.json(&[
        "densify",
        "flat.toml",
        "--tolerance",
        "0.05",
        "--min-chord",
        "0",
        "--json",
    ]);
    let mut log = Vec::new();
    for v in fine["vertices"].as_array().unwrap() {
        // 0.7 m to the north of it, and its height above another datum.
        let lat = v["lat_deg"].as_f64().unwrap() + 0.7 / 111_180.0;
        log.extend(record(lat, v["lon_deg"].as_f64().unwrap(), 12.0));
    }
    std::fs::write(files.path("flight.tlog"), &log).unwrap();
    let report = files.json(&[
        "check",
        "flat.toml",
        "--home",
        HOME,
        "--flown",
        "flight.tlog",
        "--json",
    ]);
    let off = report["flown"]["deviation_m"].as_f64().unwrap();
    assert!((0.6..0.76).contains(&off), "{report}");
    assert_eq!(report["flown"]["passed"], report["flown"]["points"]);
    assert!(
        files
            .done(&[
                "check",
                "flat.toml",
                "--home",
                HOME,
                "--flown",
                "flight.tlog"
            ])
            .contains("passed within 3 m")
    );
    std::fs::write(files.path("half.tlog"), &log[..log.len() / 2]).unwrap();
    assert_eq!(
        files
            .refused(&["check", "flat.toml", "--home", HOME, "--flown", "half.tlog"])
            .0,
        1
    );
    files.put("empty.tlog", "");
    assert_eq!(
        files
            .refused(&[
                "check",
                "flat.toml",
                "--home",
                HOME,
                "--flown",
                "empty.tlog"
            ])
            .0,
        2
    );
}
