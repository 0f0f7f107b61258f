//! The deviation that densification promises, against an oracle that shares nothing with it: dense samples of the
//! definition, geodesics of GeographicLib, vertices rounded as they go out.

mod common;

use common::{Kind, random_leg, two_sided_deviation_m};
use curve_paths::{Charges, DensifyError, Leg, Options, densify};

/// Legs tried; the debug build tries fewer.
const LEGS: u64 = if cfg!(debug_assertions) {
    2_000
} else {
    10_000
};

#[test]
fn no_curve_is_further_from_its_polyline_than_promised_nor_the_polyline_from_it() {
    let mut worst: f64 = 0.0;
    for seed in 0..LEGS {
        let (kind, leg) = random_leg(seed);
        let tolerance_m = [0.1, 0.5, 1.0, 2.0, 10.0][(seed / 9 % 5) as usize];
        let options = Options {
            min_chord_m: 0.0,
            ..Options::flight(tolerance_m)
        };
        let route = densify(&[Leg::from(leg)], &options).unwrap();
        let found = two_sided_deviation_m(&leg, &route.vertices, 24);
        assert!(route.bound_m <= tolerance_m, "{kind:?} {seed}");
        assert!(
            found <= route.bound_m,
            "{kind:?} {seed}: {found} of {} promised\n{leg:?}",
            route.bound_m
        );
        worst = worst.max(found / route.bound_m);
        for pair in route.vertices.windows(2) {
            let a = if pair[0].t == 1.0 { 0.0 } else { pair[0].t };
            let bound_m = leg.chord_bound_m(a, pair[1].t, &Charges::MISSION_ITEM);
            assert!(
                bound_m <= tolerance_m,
                "{kind:?} {seed}: {a}..{} {bound_m}",
                pair[1].t
            );
        }
    }
    // A bound that no curve comes near would be a bad one.
    assert!(worst > 0.97, "{worst}");
}

#[test]
fn the_points_are_at_most_five_percent_and_one_above_the_optimum_of_a_dynamic_program() {
    let charges = Charges::NONE;
    let (mut points, mut optimum) = (0, 0);
    for seed in 0..LEGS / 5 {
        let (kind, leg) = random_leg(seed);
        let tolerance_m = [0.5, 1.0, 2.0][(seed / 9 % 3) as usize];
        let n = densify(&[Leg::from(leg)], &Options::geometry(tolerance_m))
            .unwrap()
            .vertices
            .len()
            - 1;
        if n > 60 {
            continue;
        }
        let least = common::fewest_chords(&leg, tolerance_m, &charges, GRID);
        assert!(
            n as f64 <= 1.05 * least as f64 + 1.0,
            "{kind:?} {seed}: {n} chords, {least} would do"
        );
        points += n;
        optimum += least;
    }
    assert!(points as f64 <= 1.01 * optimum as f64, "{points} {optimum}");
}

/// Vertices of the dynamic program lie at this many even steps of t.
const GRID: usize = 200;

#[test]
fn legs_of_no_length_are_refused() {
    let p = curve_paths::Position::new(37.0, 127.0, 100.0);
    let c = curve_paths::Control::level(37.0, 127.0);
    let error = curve_paths::BezierLeg::new(p, c, c, p).unwrap_err();
    assert!(
        matches!(error, curve_paths::LegError::ZeroLength { .. }),
        "{error}"
    );
}

#[test]
fn a_tolerance_that_the_roundings_eat_is_refused() {
    let (_, leg) = random_leg(1);
    let error = densify(&[Leg::from(leg)], &Options::flight(0.008)).unwrap_err();
    assert!(matches!(error, DensifyError::Tolerance { .. }), "{error}");
}

#[test]
fn every_kind_of_leg_was_tried() {
    let kinds: std::collections::HashSet<_> = (0..100).map(|seed| random_leg(seed).0).collect();
    assert_eq!(kinds.len(), Kind::ALL.len());
}
