//! The Everland Speedway, lap 1, every second fix, closed: the figures that are published for it.

use std::io::Read;

use curve_paths::fit::{Continuity, FitOptions, Fitted, Start, Track, fit, straighten};
use curve_paths::{BezierLeg, ErrorAllowance, Leg, Options, Position, densify};
use kit::curves::{fewest_chords, two_sided_deviation_m};

fn lap_1() -> Track {
    let file = concat!(
        env!("CARGO_MANIFEST_DIR"),
        "/../tests/data/curves/everland-laps.csv.gz"
    );
    let mut text = String::new();
    flate2::read::GzDecoder::new(std::fs::File::open(file).unwrap())
        .read_to_string(&mut text)
        .unwrap();
    let fixes: Vec<Position> = text
        .lines()
        .filter(|line| line.starts_with("1,"))
        .step_by(2)
        .map(|line| {
            let mut fields = line.split(',').skip(1).map(|f| f.parse().unwrap());
            Position::new(fields.next().unwrap(), fields.next().unwrap(), 0.0)
        })
        .collect();
    assert_eq!(fixes.len(), 664);
    Track::new(&fixes, true).unwrap()
}

fn cubic(track: &Track, tolerance_m: f64, continuity: Continuity) -> Fitted {
    fit(
        track,
        &FitOptions {
            tolerance_m,
            continuity,
            corner_deg: None,
        },
        &mut |_| (),
    )
    .unwrap()
}

/// Hausdorff distance between all the legs and the whole polyline, by earth-centred samples at most 0.2 m apart: it
/// shares nothing with the measure that the fit uses.
fn two_sided_m(legs: &[BezierLeg], track: &Track) -> f64 {
    let mut curve = Vec::new();
    for leg in legs {
        let n = (5.0 * leg.length_m()).ceil() as usize;
        curve.extend((0..n).map(|k| leg.at(k as f64 / n as f64).ground().to_ecef()));
    }
    curve.push(legs[legs.len() - 1].p4().ground().to_ecef());
    let mut line = Vec::new();
    let fixes = track.fixes();
    for k in 0..fixes.len() {
        let (a, b) = (
            fixes[k].ground().to_ecef(),
            fixes[(k + 1) % fixes.len()].ground().to_ecef(),
        );
        let n = (5.0 * (b - a).norm()).ceil() as usize;
        line.extend((0..n).map(|i| a.lerp(b, i as f64 / n as f64)));
    }
    line.push(line[0]);
    let one_sided = |from: &[curve_paths::vector::Vec3], to: &[curve_paths::vector::Vec3]| {
        let mut worst: f64 = 0.0;
        for (k, x) in from.iter().enumerate().step_by(3) {
            // Both run once around: the nearest is about as far along, give or take a tenth of the lap.
            let middle = k * to.len() / from.len();
            let tenth = to.len() / 10;
            let nearest = (middle + to.len() - tenth..middle + to.len() + tenth)
                .map(|i| (to[i % to.len()] - *x).norm2())
                .fold(f64::INFINITY, f64::min);
            worst = worst.max(nearest.sqrt());
        }
        worst
    };
    // The curve starts where the fit chose; the line is turned to match.
    let start = curve[0];
    let nearest = (0..line.len()).min_by(|&a, &b| {
        (line[a] - start)
            .norm2()
            .total_cmp(&(line[b] - start).norm2())
    });
    line.rotate_left(nearest.unwrap());
    one_sided(&curve, &line).max(one_sided(&line, &curve))
}

fn joints_are_shared(fitted: &Fitted, track: &Track) {
    for pair in fitted.legs.windows(2) {
        assert_eq!(pair[0].p4(), pair[1].p1());
    }
    assert_eq!(fitted.legs[fitted.legs.len() - 1].p4(), fitted.legs[0].p1());
    for (leg, &joint) in fitted.legs.iter().zip(&fitted.joints) {
        assert_eq!(leg.p1(), track.fixes()[joint]);
    }
}

#[test]
fn straight_legs_111_for_1_m_and_32_for_10_m() {
    let track = lap_1();
    for (tolerance_m, legs) in [(0.5, 160), (1.0, 111), (2.0, 75), (10.0, 32)] {
        let found = straighten(&track, tolerance_m, Start::First).unwrap();
        assert_eq!(found.legs(), legs, "{tolerance_m}");
        assert!(found.deviation_m <= tolerance_m);
    }
    assert_eq!(straighten(&track, 10.0, Start::Any).unwrap().legs(), 31);
}

#[test]
fn cubic_legs_at_most_8_for_10_m() {
    let track = lap_1();
    let fitted = cubic(&track, 10.0, Continuity::G0);
    assert!(fitted.legs.len() <= 8, "{}", fitted.legs.len());
    joints_are_shared(&fitted, &track);
    let found = two_sided_m(&fitted.legs, &track);
    assert!(
        found <= fitted.deviation_m + 0.15 && found <= 10.0,
        "{found} {}",
        fitted.deviation_m
    );
}

#[test]
fn smooth_cubic_legs_at_most_10_for_10_m() {
    let track = lap_1();
    let fitted = cubic(&track, 10.0, Continuity::G1);
    assert!(fitted.legs.len() <= 10, "{}", fitted.legs.len());
    joints_are_shared(&fitted, &track);
    assert!(two_sided_m(&fitted.legs, &track) <= 10.0);
    let n = fitted.legs.len();
    for leg in &fitted.legs {
        // No hidden corner: every arm is a fair part of its leg.
        let [p1, p2, p3, p4] = leg.ecef().0;
        let shorter = (p2 - p1).norm().min((p4 - p3).norm());
        assert!(shorter > 0.14 * (p4 - p1).norm(), "{shorter}");
    }
    for k in 0..n {
        let (a, b) = (
            fitted.legs[k].ecef().derivative(1.0).unit(),
            fitted.legs[(k + 1) % n].ecef().derivative(0.0).unit(),
        );
        // The arms' ends are on the ground, so each arm dips by its own sag: 1e-4 for some hundred metres.
        assert!((a - b).norm() < 2e-4, "joint {k}: {a:?} {b:?}");
    }
}

#[test]
fn cubic_legs_at_most_20_for_1_m_and_about_as_many_items_as_straight_ones() {
    let track = lap_1();
    let fitted = cubic(&track, 1.0, Continuity::G0);
    assert!(fitted.legs.len() <= 20, "{}", fitted.legs.len());
    joints_are_shared(&fitted, &track);
    assert!(fitted.deviation_m <= 1.0);
    let found = two_sided_m(&fitted.legs, &track);
    assert!(found <= 1.0, "{found}");
    let legs: Vec<Leg> = fitted.legs.iter().map(|&leg| leg.into()).collect();
    let dense = densify(&legs, &Options::geometry(1.0)).unwrap();
    let items = dense.vertices.len() - 1;
    assert!((105..=120).contains(&items), "{items}");
    let [first, .., last] = &dense.vertices[..] else {
        panic!("no vertices")
    };
    assert_eq!(first.position, last.position);
    for leg in &fitted.legs {
        chords_are_proven_and_few(leg);
    }
}

/// The oracles of random legs, applied to a leg of the real track.
fn chords_are_proven_and_few(leg: &BezierLeg) {
    let options = Options {
        min_chord_m: 0.0,
        ..Options::flight(1.0)
    };
    let flown = densify(&[Leg::from(*leg)], &options).unwrap();
    let found = two_sided_deviation_m(leg, &flown.vertices, 24);
    assert!(
        found <= flown.bound_m && flown.bound_m <= 1.0,
        "{found} {leg:?}"
    );
    for pair in flown.vertices.windows(2) {
        let bound_m = leg.chord_bound_m(pair[0].t, pair[1].t, &ErrorAllowance::MISSION_ITEM);
        assert!(bound_m <= 1.0, "{bound_m} {leg:?}");
    }
    let plain = densify(&[Leg::from(*leg)], &Options::geometry(1.0)).unwrap();
    let min = fewest_chords(leg, 1.0, &ErrorAllowance::NONE, 200);
    let chords = plain.vertices.len() - 1;
    assert!(chords as f64 <= 1.05 * min as f64 + 1.0, "{chords} {min}");
}

#[test]
fn far_fixes_are_joined_smoothly_too() {
    let fixes = [(47.0, 8.0), (47.0, 8.003), (47.002, 8.003), (47.002, 8.0)]
        .map(|(a, b)| Position::new(a, b, 0.0));
    for closed in [false, true] {
        let track = Track::new(&fixes, closed).unwrap();
        let fitted = cubic(&track, 1.0, Continuity::G1);
        assert_eq!(
            fitted.joints[0],
            *fitted.joints.last().unwrap() * usize::from(closed)
        );
        assert!(
            fitted.deviation_m <= 1.0 && fitted.legs.len() >= 3,
            "{fitted:?}"
        );
        for pair in fitted.legs.windows(2) {
            let (a, b) = (
                pair[0].ecef().derivative(1.0).unit(),
                pair[1].ecef().derivative(0.0).unit(),
            );
            assert!((a - b).norm() < 1e-3, "{a:?} {b:?}");
        }
    }
}

#[test]
fn an_open_track_and_corners_are_kept() {
    // A square of 200 m, drawn with a fix every 10 m.
    let corner = [(0.0, 0.0), (0.0, 0.002), (0.002, 0.002), (0.002, 0.0)];
    let mut fixes = Vec::new();
    for k in 0..4 {
        let (a, b) = (corner[k], corner[(k + 1) % 4]);
        for i in 0..20 {
            let f = f64::from(i) / 20.0;
            fixes.push(Position::new(
                a.0 + (b.0 - a.0) * f,
                a.1 + (b.1 - a.1) * f,
                0.0,
            ));
        }
    }
    for continuity in [Continuity::G0, Continuity::G1] {
        for closed in [false, true] {
            let track = Track::new(&fixes, closed).unwrap();
            let options = FitOptions {
                tolerance_m: 2.0,
                continuity,
                corner_deg: Some(45.0),
            };
            let fitted = fit(&track, &options, &mut |_| ()).unwrap();
            assert_eq!(
                fitted.legs.len(),
                4,
                "{continuity:?} {closed} {:?}",
                fitted.joints
            );
            let kept = [20, 40, 60]
                .iter()
                .all(|corner| fitted.joints.contains(corner));
            assert!(kept, "{continuity:?} {closed}: {:?}", fitted.joints);
            assert!(fitted.deviation_m <= 0.01, "{}", fitted.deviation_m);
        }
    }
}
