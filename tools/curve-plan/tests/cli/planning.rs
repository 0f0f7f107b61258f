//! `densify`, `fit` and `compare`: figures, budgets, loops and closed tracks.

use std::io::Read;
use std::path::Path;

use crate::{Files, ROUTE};

fn everland(files: &Files) {
    let packed =
        Path::new(env!("CARGO_MANIFEST_DIR")).join("../../tests/data/curves/everland-laps.csv.gz");
    let mut text = String::new();
    flate2::read::GzDecoder::new(std::fs::File::open(packed).unwrap())
        .read_to_string(&mut text)
        .unwrap();
    files.put("laps.csv", &text);
}

#[test]
fn compare_prints_the_figures_and_the_legs() {
    let files = Files::new();
    everland(&files);
    let track = [
        "compare",
        "laps.csv",
        "--lap",
        "1",
        "--every",
        "2",
        "--closed",
        "--tolerance",
        "10",
    ];
    let rows = files.json(&[&track[..], &["--json"]].concat());
    let row = &rows[0];
    let keys: Vec<_> = row
        .as_object()
        .unwrap()
        .keys()
        .map(String::as_str)
        .collect();
    assert_eq!(
        keys,
        [
            "tolerance_m",
            "straight",
            "cubic",
            "octets_straight",
            "octets_cubic",
            "deviation_m",
            "legs"
        ]
    );
    assert_eq!(row["straight"], 32);
    let cubic = row["cubic"].as_u64().unwrap();
    assert!(cubic <= 8);
    assert!(row["deviation_m"].as_f64().unwrap() <= 10.0);
    let legs = row["legs"].as_array().unwrap();
    assert_eq!(legs.len() as u64, cubic);
    for (k, leg) in legs.iter().enumerate() {
        assert_eq!(leg.as_array().unwrap().len(), 4);
        assert_eq!(leg[3], legs[(k + 1) % legs.len()][0]);
    }
    assert_eq!(row["octets_straight"], 32 * 59);
    assert_eq!(row["octets_cubic"].as_u64().unwrap(), cubic * (59 + 53));
    assert!(files.done(&track).contains("items flown"));
}

#[test]
fn a_budget_and_free_vertices_save_items() {
    let files = Files::new();
    let items = |more: &[&str]| {
        let report = files.json(&[&["densify", "route.toml", "--json"], more].concat());
        assert!(report["bound_m"].as_f64().unwrap() <= report["tolerance_m"].as_f64().unwrap());
        report["items"].as_u64().unwrap()
    };
    let plain = items(&[]);
    assert!(items(&["--free"]) < plain);
    assert!(items(&["--max-items", "7"]) <= 7);
    let (status, printed) = files.refused(&["densify", "route.toml", "--max-items", "2"]);
    assert_eq!(status, 1);
    assert!(
        printed.contains("the ends of the legs alone are 3"),
        "{printed}"
    );
}

#[test]
fn fit_writes_a_route_that_can_be_flown() {
    let files = Files::new();
    files.done(&[
        "densify",
        "route.toml",
        "--tolerance",
        "0.2",
        "-o",
        "track.csv",
    ]);
    let report = files.json(&[
        "fit",
        "track.csv",
        "--tolerance",
        "1",
        "--g1",
        "-o",
        "fit.toml",
        "--json",
    ]);
    assert!(report["deviation_m"].as_f64().unwrap() <= 1.0);
    assert!(
        report["legs"].as_array().unwrap().len() <= 3,
        "{}",
        report["legs"]
    );
    assert!(
        files
            .done(&["densify", "fit.toml"])
            .contains("proven within")
    );
}

#[test]
fn a_closed_fit_comes_back_to_its_first_waypoint() {
    let files = Files::new();
    let mut track = String::from("lat,lon,height_m\n");
    for k in 0..72 {
        let (s, c) = (f64::from(k) * 5.0).to_radians().sin_cos();
        track += &format!("{},{},30\n", 47.0 + 0.001 * c, 8.0 + 0.0015 * s);
    }
    files.put("circle.csv", &track);
    files.done(&["fit", "circle.csv", "--closed", "-o", "circle.toml"]);
    let report = files.json(&["densify", "circle.toml", "--json"]);
    let vertices = report["vertices"].as_array().unwrap();
    let (first, last) = (&vertices[0], vertices.last().unwrap());
    assert_eq!(
        (&first["lat_deg"], &first["lon_deg"]),
        (&last["lat_deg"], &last["lon_deg"])
    );
    assert!(report["legs"].as_u64().unwrap() >= 2);
}

#[test]
fn a_loop_leads_back_once() {
    let files = Files::new();
    let round = ROUTE.replace(
        "altitude = 540.0",
        "altitude = 540.0\nnext = 20\nloop = { limit = 3 }",
    );
    files.put("round.toml", &round);
    let report = files.json(&["densify", "round.toml", "--json"]);
    assert_eq!(report["legs"], 3);
    let last = report["vertices"].as_array().unwrap().last().unwrap();
    assert_eq!(last["lat_deg"], 47.399);
}
