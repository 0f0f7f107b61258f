//! `vsm demo --curve` flies the section of nine curves and reports how it went; its route is what the report states.

use std::io::Read as _;
use std::process::Command;

use kit::process::program;

#[test]
fn the_section_is_flown_within_the_prediction_and_drawn() {
    let out = tempfile::tempdir().expect("a folder");
    let done = Command::new(program("vsm"))
        .args(["demo", "--curve", "--speed", "30", "--out"])
        .arg(out.path())
        .output()
        .expect("it runs");
    let text = String::from_utf8(done.stdout).expect("text");
    let printed = String::from_utf8_lossy(&done.stderr);
    assert!(done.status.success(), "{text}\n{printed}");
    let figure = |name: &str| -> f64 {
        let line = text
            .lines()
            .find(|line| line.trim_start().starts_with(name));
        let rest = line
            .and_then(|line| line.split(name).nth(1))
            .unwrap_or_else(|| panic!("no {name} in {text}"));
        rest.split_whitespace()
            .next()
            .and_then(|n| n.parse().ok())
            .unwrap_or_else(|| panic!("{rest}"))
    };
    assert_eq!(figure("curved legs"), 9.0);
    assert_eq!(figure("points passed"), 100.0);
    assert!(figure("deviation, proven") <= figure("tolerance"));
    let flown = figure("deviation, flown");
    assert!(
        flown > 0.2 && flown <= figure("deviation, predicted"),
        "{text}"
    );
    let svg = std::fs::read_to_string(out.path().join("flight.svg")).expect("a picture");
    assert!(
        svg.contains("Everland") && svg.matches("<polyline").count() >= 3 && !svg.contains("NaN")
    );
    let last = text.lines().last().expect("a line");
    assert_eq!(
        std::path::Path::new(last),
        std::path::absolute(out.path()).expect("a path")
    );
}

#[test]
fn the_section_is_nine_curves_within_a_metre_of_the_recorded_fixes() {
    let root = concat!(env!("CARGO_MANIFEST_DIR"), "/..");
    let path = format!("{root}/examples/everland.route.toml");
    let route = cucs::Route::load(path.as_ref()).expect("a route");
    assert_eq!(route.curves.len(), 9);
    let file = std::fs::File::open(format!("{root}/tests/data/curves/everland-laps.csv.gz"));
    let mut text = String::new();
    flate2::read::GzDecoder::new(file.expect("the fixes"))
        .read_to_string(&mut text)
        .expect("text");
    let fixes: Vec<(f64, f64)> = text
        .lines()
        .filter(|line| line.starts_with("1,"))
        .step_by(2)
        .skip(226)
        .take(321)
        .map(|line| {
            let mut fields = line
                .split(',')
                .skip(1)
                .map(|f| f.parse().expect("a number"));
            (
                fields.next().expect("latitude"),
                fields.next().expect("longitude"),
            )
        })
        .collect();
    let metres = |p: (f64, f64)| (p.0 * 110_970.0, p.1 * 88_660.0);
    let end = |number| {
        let w = route
            .waypoints
            .iter()
            .find(|w| w.number == number)
            .expect("a waypoint");
        metres((w.latitude_deg, w.longitude_deg))
    };
    let mut line = Vec::new();
    for curve in &route.curves {
        let [p2, p3] = [curve.p2, curve.p3].map(|p| metres((p.latitude_deg, p.longitude_deg)));
        let p = [end(curve.from), p2, p3, end(curve.to)];
        line.extend((0..=2_000).map(|k| {
            let t = f64::from(k) / 2_000.0;
            let u = 1.0 - t;
            let w = [u * u * u, 3.0 * u * u * t, 3.0 * u * t * t, t * t * t];
            (
                (0..4).map(|i| w[i] * p[i].0).sum::<f64>(),
                (0..4).map(|i| w[i] * p[i].1).sum::<f64>(),
            )
        }));
    }
    for fix in &fixes {
        let (n, e) = metres(*fix);
        let off = line
            .iter()
            .map(|p| (p.0 - n).hypot(p.1 - e))
            .fold(f64::MAX, f64::min);
        assert!(off < 1.01, "{fix:?} is {off} m off");
    }
}
