//! Heights: above home, above the ground, how steep, and where a track has none.

use crate::Files;

const HOME: &str = "47.3977,8.5456,488";

/// A route file of two waypoints at these altitudes.
fn route(kind: &str, from_m: f64, to_m: f64) -> String {
    format!(
        "[defaults]\naltitude_type = \"{kind}\"\n\
         [[waypoint]]\nnumber = 10\nlatitude = 47.3980\nlongitude = 8.5456\naltitude = {from_m}\n\
         [[waypoint]]\nnumber = 20\nlatitude = 47.3998\nlongitude = 8.5456\naltitude = {to_m}\n"
    )
}

/// A grid of the ground north of home: flat at 488 m, with a ridge of this height across the route's middle.
fn ridge(height_m: f64) -> String {
    let mut text = String::from(
        "ncols 3\nnrows 7\nxllcenter 8.5450\nyllcenter 47.3976\ncellsize 0.0005\nNODATA_value -9999\n",
    );
    // The northernmost row first.
    for row in (0..7).rev() {
        let height_m = if row == 3 { height_m } else { 488.0 };
        text += &format!("{height_m} {height_m} {height_m}\n");
    }
    text
}

#[test]
fn check_needs_home_and_refuses_what_is_below_it() {
    let files = Files::new();
    files.put("low.toml", &route("amsl", 500.0, 480.0));
    files.put("high.toml", &route("amsl", 500.0, 520.0));
    files.put("relative.toml", &route("agl", 20.0, -5.0));
    let (status, printed) = files.refused(&["check", "high.toml"]);
    assert_eq!(status, 2, "{printed}");
    assert!(printed.contains("give --home LAT,LON,ALT"), "{printed}");
    let printed = files.done(&["check", "high.toml", "--home", HOME]);
    assert!(
        printed.contains("heights: 12.0 to 32.0 m above home; largest step +20.0 m, leg 0"),
        "{printed}"
    );
    for (file, home) in [("low.toml", &["--home", HOME][..]), ("relative.toml", &[])] {
        let (status, printed) = files.refused(&[&["check", file], home].concat());
        assert_eq!(status, 1, "{printed}");
        for part in [
            "leg from waypoint 10: ",
            " m below home at 47.39",
            "--below-home",
        ] {
            assert!(printed.contains(part), "{part}: {printed}");
        }
        files.done(&[&["check", file, "--below-home"], home].concat());
    }
    let (status, printed) = files.refused(&["check", "high.toml", "--home", "47,8"]);
    assert_eq!(status, 2);
    assert!(printed.contains("expected LAT,LON,ALT"), "{printed}");
}

#[test]
fn check_sees_a_curve_that_dips_between_high_waypoints() {
    let files = Files::new();
    let dip = "\n[[curve]]\nfrom = 10\nto = 20\np2 = [47.3986, 8.5456, 400.0]\np3 = [47.3992, 8.5456, 400.0]\n\
               altitude_type = \"amsl\"\n";
    files.put("dip.toml", &(route("amsl", 500.0, 500.0) + dip));
    let (status, printed) = files.refused(&["check", "dip.toml", "--home", HOME]);
    assert_eq!(status, 1, "{printed}");
    assert!(printed.contains("below home at 47.398"), "{printed}");
}

#[test]
fn a_file_with_a_home_of_its_own_needs_none() {
    let files = Files::new();
    files.put(
        "own.waypoints",
        "QGC WPL 110\n0 1 0 16 0 0 0 0 47.397 8.5456 488 1\n1 0 0 16 0 0 0 0 47.398 8.5456 500 1\n\
         2 0 0 16 0 0 0 0 47.399 8.5456 485 1\n",
    );
    let (status, printed) = files.refused(&["check", "own.waypoints"]);
    assert_eq!(status, 1, "{printed}");
    assert!(printed.contains("3.0 m below home"), "{printed}");
    // It is kept when converted, and the first waypoint's place does not replace it.
    files.done(&["convert", "own.waypoints", "own.plan"]);
    let plan: serde_json::Value = serde_json::from_str(&files.get("own.plan")).unwrap();
    assert_eq!(plan["mission"]["plannedHomePosition"][2], 488.0);
}

#[test]
fn check_reports_steps_that_the_vehicle_cannot_climb() {
    let files = Files::new();
    // Like a track whose altitudes begin with a gap that was read as 0.
    files.put("step.toml", &route("agl", 1.0, 153.0));
    let report = files.json(&["check", "step.toml", "--speed", "10", "--json"]);
    let heights = &report["heights"];
    assert_eq!(heights["largest_step_m"], 152.0, "{report}");
    assert_eq!(heights["steep"][0]["leg"], 0);
    assert_eq!(heights["steep"][0]["limit_mps"], 3.0);
    let rate = heights["steep"][0]["rate_mps"].as_f64().unwrap();
    assert!((7.0..8.0).contains(&rate), "{report}");
    let printed = files.done(&["check", "step.toml", "--speed", "10"]);
    assert!(
        printed.contains("leg 0: climbs 152.0 m in 200."),
        "{printed}"
    );
    let gentle = files.json(&["check", "step.toml", "--speed", "3", "--json"]);
    assert!(gentle["heights"]["steep"].as_array().unwrap().is_empty());
}

#[test]
fn a_route_below_the_ground_is_refused_between_its_waypoints_too() {
    let files = Files::new();
    files.put("flat.toml", &route("amsl", 520.0, 520.0));
    files.put("ground.asc", &ridge(515.0));
    files.put("hill.asc", &ridge(530.0));
    let report = files.json(&[
        "check",
        "flat.toml",
        "--home",
        HOME,
        "--terrain",
        "ground.asc",
        "--json",
    ]);
    let clearance = report["heights"]["terrain"]["clearance_m"]
        .as_f64()
        .unwrap();
    assert!((4.9..6.0).contains(&clearance), "{report}");
    for command in [
        &["check", "flat.toml", "--home", HOME][..],
        &["densify", "flat.toml"],
        &["convert", "flat.toml", "out.plan"],
        &["send", "flat.toml", "--vsm", "127.0.0.1:9"],
    ] {
        let (status, printed) = files.refused(&[command, &["--terrain", "hill.asc"]].concat());
        assert_eq!(status, 1, "{command:?} {printed}");
        assert!(
            printed.contains("leg from waypoint 10: ")
                && printed.contains("below the ground at 47.399"),
            "{command:?} {printed}"
        );
        assert!(!files.path("out.plan").exists());
    }
    // Heights above home need its altitude.
    files.put("relative.toml", &route("agl", 30.0, 30.0));
    let arguments = ["densify", "relative.toml", "--terrain", "ground.asc"];
    let (status, printed) = files.refused(&arguments);
    assert!(status == 2 && printed.contains("--home-alt"), "{printed}");
    files.done(&[&arguments[..], &["--home-alt", "488"]].concat());
}

#[test]
fn heights_above_ground_follow_it() {
    let files = Files::new();
    files.put("ground.asc", &ridge(500.0));
    files.put(
        "track.csv",
        "lat,lon\n47.3980,8.5456\n47.3991,8.5456\n47.3998,8.5456\n",
    );
    files.done(&[
        "convert",
        "track.csv",
        "over.csv",
        "--height",
        "40",
        "--terrain",
        "ground.asc",
    ]);
    let written = files.get("over.csv");
    assert!(written.starts_with("lat_deg,lon_deg,alt_m\n"), "{written}");
    let altitudes: Vec<f64> = written
        .lines()
        .skip(1)
        .map(|line| line.rsplit(',').next().unwrap().parse().unwrap())
        .collect();
    for (found, expected) in altitudes.iter().zip([528.0, 540.0, 528.0]) {
        assert!((found - expected).abs() < 0.5, "{written}");
    }
    files.put(
        "ground.kml",
        "<kml><Placemark><LineString><altitudeMode>relativeToGround</altitudeMode>\
         <coordinates>8.5456,47.3980,40 8.5456,47.3991,40</coordinates></LineString></Placemark></kml>",
    );
    files.done(&[
        "convert",
        "ground.kml",
        "kml.csv",
        "--terrain",
        "ground.asc",
    ]);
    assert!(
        files.get("kml.csv").contains(",540.000"),
        "{}",
        files.get("kml.csv")
    );
    // Without a height a track on the ground cannot be flown.
    let (status, printed) =
        files.refused(&["convert", "track.csv", "x.csv", "--terrain", "ground.asc"]);
    assert!(status == 2 && printed.contains("no altitude"), "{printed}");
}

#[test]
fn srtm_tiles_are_read_and_their_voids_are_an_error_with_the_place() {
    const SIDE: usize = 1_201;
    let files = Files::new();
    // Higher to the north: 400 m at 47 degrees, 1 m more each sample; void at 47.5.
    let mut tile = Vec::with_capacity(SIDE * SIDE * 2);
    for row in 0..SIDE {
        let from_south = SIDE - 1 - row;
        let height = if from_south == 600 {
            -32_768
        } else {
            400 + from_south as i16
        };
        for _ in 0..SIDE {
            tile.extend(height.to_be_bytes());
        }
    }
    std::fs::create_dir(files.path("srtm")).unwrap();
    std::fs::write(files.path("srtm/N47E008.hgt"), &tile).unwrap();
    let convert = |south: f64, north: f64, from: &str| {
        files.put("t.csv", &format!("lat,lon\n{south},8.5\n{north},8.5\n"));
        files.run(&[
            "convert",
            "t.csv",
            "t2.csv",
            "--height",
            "50",
            "--terrain",
            from,
        ])
    };
    for from in ["srtm", "srtm/N47E008.hgt"] {
        let output = convert(47.1, 47.101, from);
        assert!(output.status.success(), "{output:?}");
        let written = files.get("t2.csv");
        // 0.1 degree is 120 samples.
        assert!(
            written.contains(",570.000\n") && written.contains(",571.2"),
            "{written}"
        );
        for (south, north, expected) in [
            (
                47.4999,
                47.501,
                "no height of the ground at 47.499900, 8.500000 (void)",
            ),
            (47.499, 47.501, "(void)"),
            (
                46.9,
                46.95,
                if from == "srtm" {
                    "no tile N46E008.hgt"
                } else {
                    "outside it"
                },
            ),
        ] {
            let output = convert(south, north, from);
            let printed = String::from_utf8_lossy(&output.stderr).into_owned();
            assert_eq!(output.status.code(), Some(2), "{printed}");
            assert!(printed.contains(expected), "{expected}: {printed}");
        }
    }
    files.put("srtm/short.hgt", "");
    let output = convert(47.1, 47.101, "srtm/short.hgt");
    assert!(String::from_utf8_lossy(&output.stderr).contains("expected the name of a tile"));
}

#[test]
fn fit_reports_gaps_in_the_altitudes_and_what_an_even_climb_loses() {
    let files = Files::new();
    let mut gaps = String::from("lat,lon,alt_m\n");
    let mut steps = gaps.clone();
    for k in 0..20 {
        let (lat, lon) = (47.398 + 1e-4 * f64::from(k), 8.5456);
        let alt = if k == 0 || k == 7 {
            String::new()
        } else {
            "520".to_owned()
        };
        gaps += &format!("{lat:.6},{lon},{alt}\n");
        steps += &format!("{lat:.6},{lon},{}\n", if k == 10 { 560 } else { 520 });
    }
    files.put("gaps.csv", &gaps);
    files.put("steps.csv", &steps);
    let printed = files.done(&["fit", "gaps.csv"]);
    assert!(
        printed.contains("no altitude at 2 fixes, the first is fix 0"),
        "{printed}"
    );
    let report = files.json(&["fit", "gaps.csv", "--json"]);
    assert_eq!(report["without_altitude"], 2);
    assert!(report["altitude_deviation_m"].is_null());
    let (status, printed) = files.refused(&["fit", "gaps.csv", "-o", "x.toml"]);
    assert!(
        status == 2 && printed.contains("no altitude (2 of 20 points have none)"),
        "{printed}"
    );
    let printed = files.done(&["fit", "steps.csv"]);
    assert!(
        printed.contains("40.0 m off the track's at most, at fix 10"),
        "{printed}"
    );
    let report = files.json(&["fit", "steps.csv", "--json"]);
    assert_eq!(report["without_altitude"], 0);
}

#[test]
fn the_centre_line_of_everland_gives_no_altitude_to_fly_at() {
    let files = Files::new();
    // Its first rows: the ground's elevation, blank where the source had 0.
    files.put(
        "centreline.csv",
        "lat_deg,lon_deg,elevation_m\n37.2962138,127.2065027,\n37.2972969,127.2053204,147.000\n\
         37.2977695,127.2048060,152.000\n37.2979019,127.2046911,152.000\n",
    );
    let printed = files.done(&["fit", "centreline.csv"]);
    assert!(printed.contains("no altitude at 4 fixes"), "{printed}");
    let (status, printed) = files.refused(&["fit", "centreline.csv", "-o", "x.toml"]);
    assert!(
        status == 2 && printed.contains("4 of 4 points"),
        "{printed}"
    );
    files.done(&["fit", "centreline.csv", "-o", "x.toml", "--height", "40"]);
    assert_eq!(files.get("x.toml").matches("altitude = 40").count(), 2);
}
