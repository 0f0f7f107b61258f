//! `vsm demo --payload`: one CUCS flies while another operates the payload, and the picture shows where the sensor really looked.

use std::process::Command;

use kit::process::program;

#[test]
fn an_operator_works_while_another_flies_and_the_picture_shows_where_the_sensor_looked() {
    let out = tempfile::tempdir().expect("a folder");
    let done = Command::new(program("vsm"))
        .args(["demo", "--payload", "--speed", "6", "--out"])
        .arg(out.path())
        .output()
        .expect("it runs");
    let text = String::from_utf8(done.stdout).expect("text");
    let printed = String::from_utf8_lossy(&done.stderr);
    assert!(done.status.success(), "{text}\n{printed}");
    let svg = std::fs::read_to_string(out.path().join("flight.svg")).expect("a picture");
    assert!(!svg.contains("NaN"), "{svg}");
    // Both have done theirs, at the same time.
    let at = |what: &str| {
        let place = text.find(what);
        place.unwrap_or_else(|| panic!("no {what:?} in:\n{text}"))
    };
    assert!(at("pilot: flies the route") < at("operator: looks at a place"));
    assert!(at("operator: records") < at("the route is flown"));
    for (letter, what) in ('A'..).zip(["looks right", "zooms to 20", "looks at", "records", "IR"]) {
        assert!(svg.contains(&format!("{letter} {what}")), "{letter} {what}");
    }
    // As many centres are drawn as were reported near it, and they stay at the place that is looked at.
    let line = text.lines().find(|line| line.starts_with("image centres"));
    let line = line.expect("a report");
    let figures: Vec<f64> = line
        .split([' ', ','])
        .filter_map(|word| word.parse().ok())
        .collect();
    let [by_angles, slaved, off_m, _, drawn, ..] = figures[..] else {
        panic!("{line}")
    };
    assert!(by_angles >= 2.0 && slaved >= 5.0, "{line}");
    assert!(off_m > 0.0 && off_m < 20.0, "{line}");
    let centers = svg.matches("class=\"seen\"").count();
    assert!(
        centers as f64 == drawn && drawn >= slaved,
        "{centers}: {line}"
    );
    // Of each line of sight that is drawn the width of the view, too: its field of view has been reported by then.
    let sights = svg.matches("class=\"sight\"").count();
    let widths = svg.matches("class=\"width\"").count();
    assert!(
        sights >= 5 && widths + 1 >= sights && widths <= sights,
        "{sights} {widths}: {svg}"
    );
}
