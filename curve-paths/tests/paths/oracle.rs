//! The deviation that densification promises, against an oracle that shares nothing with it: dense samples of the
//! definition, geodesics of GeographicLib, vertices rounded as they go out.

use curve_paths::{
    DensifyError, ErrorAllowance, Leg, Options, Vertices, densify, densify_to_budget,
};
use kit::curves::{Kind, random_leg, two_sided_deviation_m};

/// Legs tried; the debug build tries fewer.
const LEGS: u64 = if cfg!(debug_assertions) {
    2_000
} else {
    10_000
};
/// Of them, judged by the dynamic program, which is slow.
const JUDGED: u64 = if cfg!(debug_assertions) { 400 } else { LEGS };

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
            let bound_m = leg.chord_bound_m(a, pair[1].t, &ErrorAllowance::MISSION_ITEM);
            assert!(
                bound_m <= tolerance_m,
                "{kind:?} {seed}: {a}..{} {bound_m}",
                pair[1].t
            );
        }
    }
    // A bound that no curve nearly reaches would be a bad one.
    assert!(worst > 0.97, "{worst}");
}

#[test]
fn the_points_are_at_most_five_percent_and_one_above_the_optimum_of_a_dynamic_program() {
    let workers = std::thread::available_parallelism().map_or(1, usize::from) as u64;
    let sums = std::thread::scope(|scope| {
        let part = |worker| move || judged((worker..JUDGED).step_by(workers as usize));
        let parts: Vec<_> = (0..workers)
            .map(|worker| scope.spawn(part(worker)))
            .collect();
        let sums: Vec<_> = parts.into_iter().map(|part| part.join().unwrap()).collect();
        sums
    });
    let total = |which: fn(&[usize; 3]) -> usize| sums.iter().map(which).sum::<usize>();
    let (legs, points, optimum) = (total(|s| s[0]), total(|s| s[1]), total(|s| s[2]));
    // With more chords than this the program's grid is too coarse for an optimum.
    assert!(legs as u64 * 10 > JUDGED * 8, "{legs} judged");
    assert!(points as f64 <= 1.01 * optimum as f64, "{points} {optimum}");
}

/// Legs judged, chords of ours, chords of the dynamic program.
fn judged(seeds: impl Iterator<Item = u64>) -> [usize; 3] {
    let mut sums = [0; 3];
    for seed in seeds {
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
        let min = kit::curves::fewest_chords(&leg, tolerance_m, &ErrorAllowance::NONE, GRID);
        assert!(
            n as f64 <= 1.05 * min as f64 + 1.0,
            "{kind:?} {seed}: {n} chords, {min} would do"
        );
        sums = [sums[0] + 1, sums[1] + n, sums[2] + min];
    }
    sums
}

#[test]
fn vertices_off_the_curve_keep_the_promise_with_a_quarter_fewer_chords() {
    let (mut on, mut off) = (0, 0);
    for seed in 0..LEGS / 4 {
        let (kind, leg) = random_leg(seed);
        let tolerance_m = [0.5, 1.0, 2.0, 10.0][(seed / 9 % 4) as usize];
        let options = Options {
            min_chord_m: 0.0,
            ..Options::flight(tolerance_m)
        };
        let plain = densify(&[Leg::from(leg)], &options).unwrap();
        let free = densify(
            &[Leg::from(leg)],
            &Options {
                vertices: Vertices::Free,
                ..options
            },
        )
        .unwrap();
        let found = two_sided_deviation_m(&leg, &free.vertices, 24);
        assert!(free.bound_m <= tolerance_m, "{kind:?} {seed}");
        assert!(
            found <= free.bound_m,
            "{kind:?} {seed}: {found} of {} promised\n{leg:?}",
            free.bound_m
        );
        assert!(free.vertices.len() <= plain.vertices.len());
        assert_eq!(free.vertices.last().unwrap().position, leg.p4());
        if plain.vertices.len() > 8 {
            on += plain.vertices.len() - 1;
            off += free.vertices.len() - 1;
        }
    }
    assert!(4 * off < 3 * on, "{off} of {on}");
}

#[test]
fn a_minimum_chord_is_kept_or_refused() {
    let (mut kept, mut refused) = (0, 0);
    for seed in 0..LEGS / 4 {
        let (kind, leg) = random_leg(seed);
        let tolerance_m = [0.5, 1.0, 2.0][(seed / 9 % 3) as usize];
        match densify(&[Leg::from(leg)], &Options::flight(tolerance_m)) {
            Ok(route) if route.vertices.len() > 2 => {
                assert!(
                    route.shortest_chord_m >= 4.0,
                    "{kind:?} {seed} {}",
                    route.shortest_chord_m
                );
                let found = two_sided_deviation_m(&leg, &route.vertices, 24);
                assert!(
                    found <= route.bound_m && route.bound_m <= tolerance_m,
                    "{kind:?} {seed}"
                );
                kept += 1;
            }
            Ok(_) => {}
            // A turn within some metres, or a climb on the spot: no aircraft flies that.
            Err(DensifyError::ChordTooShort { .. }) => {
                assert_ne!(kind, Kind::Gentle, "{seed}");
                refused += 1;
            }
            Err(error) => panic!("{error}"),
        }
    }
    assert!(kept > 5 * refused, "{kept} {refused}");
}

#[test]
fn a_budget_is_kept_with_the_smallest_tolerance() {
    for seed in 0..60 {
        let (_, leg) = random_leg(seed);
        let route = [Leg::from(leg)];
        let options = Options {
            min_chord_m: 0.0,
            ..Options::flight(0.02)
        };
        for max in [2, 5, 20, 80] {
            let found = densify_to_budget(&route, max, &options).unwrap();
            assert!(found.densified.vertices.len() <= max);
            assert!(found.densified.bound_m <= found.tolerance_m);
            if found.tolerance_m > options.tolerance_m {
                let tighter = Options {
                    tolerance_m: 0.0079 + (found.tolerance_m - 0.0079) * 0.99,
                    ..options
                };
                if tighter.tolerance_m > 0.02 {
                    assert!(
                        densify(&route, &tighter).unwrap().vertices.len() > max,
                        "{seed} {max}"
                    );
                }
            }
        }
    }
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
