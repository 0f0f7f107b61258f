//! `vsm demo --wing` and `--vtol`: the flight takes place, from launch to landing, and its picture marks the landing pattern and
//! the transitions.

use std::process::Command;

use kit::process::program;

/// What the demo prints, and its picture.
fn flown(airframe: &str) -> (String, String) {
    let out = tempfile::tempdir().expect("a folder");
    let done = Command::new(program("vsm"))
        .args(["demo", airframe, "--speed", "40", "--out"])
        .arg(out.path())
        .output()
        .expect("it runs");
    let text = String::from_utf8(done.stdout).expect("text");
    let printed = String::from_utf8_lossy(&done.stderr);
    assert!(done.status.success(), "{text}\n{printed}");
    let svg = std::fs::read_to_string(out.path().join("flight.svg")).expect("a picture");
    assert!(!svg.contains("NaN"), "{svg}");
    (text, svg)
}

/// The marks in their order, each with its time and its height.
fn marks(text: &str) -> Vec<(f64, f64, &str)> {
    let lines = text
        .lines()
        .skip_while(|line| !line.starts_with("marks of"));
    let marks = lines.skip(1).map_while(|line| {
        let (time_s, rest) = line.strip_prefix("  ")?.split_once(" s ")?;
        let (up_m, what) = rest.split_once(" m ")?;
        let number = |text: &str| text.trim().parse().expect("a number");
        Some((number(time_s), number(up_m), what.trim()))
    });
    marks.collect()
}

fn off_m(text: &str) -> f64 {
    let line = text.lines().find(|line| line.starts_with("touched down"));
    let figure = line.and_then(|line| line.split(' ').nth(2));
    figure.and_then(|m| m.parse().ok()).expect("a figure")
}

#[test]
fn a_fixed_wing_flies_its_route_and_lands_by_its_pattern() {
    let (text, svg) = flown("--wing");
    let marks = marks(&text);
    let [(landing_s, high_m, landing), (down_s, low_m, down)] = marks[..] else {
        panic!("{marks:?}")
    };
    assert_eq!((landing, down), ("landing (mode 19)", "touch-down"));
    // From the end of the route down the glide, no vertical landing.
    assert!(
        high_m > 50.0 && low_m < 1.0 && down_s > landing_s + 60.0,
        "{marks:?}"
    );
    assert!(off_m(&text) < 100.0, "{text}");
    assert!(text.contains("the route is flown") && text.contains("control handed back"));
    assert!(
        svg.contains(">landing pattern<") && svg.contains("A landing (mode 19)"),
        "{svg}"
    );
    assert!(
        svg.contains("B touch-down") && !svg.contains("transition"),
        "{svg}"
    );
}

#[test]
fn a_vtol_transitions_after_its_launch_and_before_its_landing() {
    let (text, svg) = flown("--vtol");
    let found: Vec<&str> = marks(&text).iter().map(|mark| mark.2).collect();
    assert_eq!(found.first(), Some(&"transition to wings"), "{text}");
    assert_eq!(found.last(), Some(&"touch-down"), "{text}");
    let landing = found.iter().position(|what| *what == "landing (mode 19)");
    let after = &found[landing.expect("it lands")..];
    let expected = [
        "landing (mode 19)",
        "transition to hover",
        "hovers",
        "touch-down",
    ];
    assert_eq!(after, expected, "{text}");
    assert!(off_m(&text) < 10.0, "{text}");
    assert!(svg.contains(">landing pattern<"), "{svg}");
    for (letter, what) in ('A'..).zip(found) {
        assert!(
            svg.contains(&format!("{letter} {what}")),
            "{letter} {what}: {svg}"
        );
    }
}
