//! Any track is fitted within the tolerance, or refused; nothing panics.

use curve_paths::fit::{
    Continuity, FitError, FitOptions, Start, Track, TrackError, fit, straighten,
};
use curve_paths::{Leg, Options, Position, densify};
use proptest::prelude::*;

/// A random walk of fixes some metres to some hundred metres apart.
fn tracks() -> impl Strategy<Value = Vec<Position>> {
    let step = (1.0..200.0f64, -2.0..2.0f64);
    prop::collection::vec(step, 3..40).prop_map(|steps| {
        let (mut x, mut y, mut heading) = (0.0f64, 0.0f64, 0.0f64);
        steps
            .into_iter()
            .map(|(length, turn)| {
                heading += turn;
                x += length * heading.cos();
                y += length * heading.sin();
                Position::new(37.0 + y / 111_000.0, 127.0 + x / 88_000.0, 50.0)
            })
            .collect()
    })
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(16))]
    #[test]
    fn every_track_is_fitted_within_the_tolerance(
        fixes in tracks(),
        closed in any::<bool>(),
        smooth in any::<bool>(),
        corner in prop::option::of(30.0..120.0f64),
        tolerance_m in prop::sample::select(vec![0.5, 2.0, 20.0]),
    ) {
        let Ok(track) = Track::new(&fixes, closed) else { return Ok(()) };
        let continuity = if smooth { Continuity::G1 } else { Continuity::G0 };
        let options = FitOptions { tolerance_m, continuity, corner_deg: corner };
        let fitted = fit(&track, &options, &mut |_| ()).unwrap();
        prop_assert!(fitted.deviation_m <= tolerance_m);
        prop_assert!(!fitted.legs.is_empty() && fitted.legs.len() <= track.gaps());
        let joints = fitted.legs.windows(2).all(|pair| pair[0].p4() == pair[1].p1());
        prop_assert!(joints);
        let (first, last) = (fitted.legs[0].p1(), fitted.legs[fitted.legs.len() - 1].p4());
        prop_assert_eq!(first == last, closed);
        let straight = straighten(&track, tolerance_m, Start::Any).unwrap();
        prop_assert!(straight.deviation_m <= tolerance_m && straight.legs() <= track.gaps());
        // What was fitted can be flown: a legal route, densified.
        let legs: Vec<Leg> = fitted.legs.iter().map(|&leg| leg.into()).collect();
        prop_assert!(densify(&legs, &Options::geometry(tolerance_m)).is_ok());
    }
}

#[test]
fn what_is_no_track_is_refused() {
    let p = Position::new(37.0, 127.0, 0.0);
    assert_eq!(
        Track::new(&[], false),
        Err(TrackError::TooFew { count: 0, min: 2 })
    );
    assert_eq!(
        Track::new(&[p, p, p], false),
        Err(TrackError::TooFew { count: 1, min: 2 })
    );
    let q = Position::new(37.001, 127.0, 0.0);
    assert_eq!(
        Track::new(&[p, q, p], true),
        Err(TrackError::TooFew { count: 2, min: 3 })
    );
    let bad = Position::new(f64::NAN, 127.0, 0.0);
    assert!(matches!(
        Track::new(&[p, bad], false),
        Err(TrackError::Fix { index: 1, .. })
    ));
    let far = Position::new(39.5, 127.0, 0.0);
    assert!(matches!(
        Track::new(&[p, far], false),
        Err(TrackError::TooWide { .. })
    ));
    let track = Track::new(&[p, q], false).unwrap();
    let options = FitOptions {
        tolerance_m: f64::NAN,
        continuity: Continuity::G0,
        corner_deg: None,
    };
    assert!(matches!(
        fit(&track, &options, &mut |_| ()),
        Err(FitError::Tolerance { .. })
    ));
}

#[test]
fn the_progress_rises_to_one() {
    let fixes: Vec<Position> = (0..50)
        .map(|k| {
            Position::new(
                37.0 + f64::from(k) * 1e-4,
                127.0 + f64::from(k * k) * 1e-6,
                0.0,
            )
        })
        .collect();
    let track = Track::new(&fixes, false).unwrap();
    for continuity in [Continuity::G0, Continuity::G1] {
        let mut progress = Vec::new();
        let options = FitOptions {
            tolerance_m: 1.0,
            continuity,
            corner_deg: None,
        };
        fit(&track, &options, &mut |done| progress.push(done)).unwrap();
        assert!(
            progress.is_sorted() && progress.last() == Some(&1.0),
            "{progress:?}"
        );
    }
}
