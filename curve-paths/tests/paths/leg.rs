//! What a leg is: reversible, split exactly, refused with the place, the value and what was expected.

use curve_paths::{
    BezierLeg, Control, DensifyError, Ground, Leg, LegError, Options, Position, densify,
};
use kit::curves::random_leg;
use proptest::prelude::*;

fn apart_m(a: Position, b: Position) -> f64 {
    a.ground().distance_m(b.ground()).hypot(a.alt_m - b.alt_m)
}

proptest! {
    #[test]
    fn a_reversed_leg_is_the_same_curve(seed in 0u64..1_000_000, t in 0.0..1.0) {
        let (_, leg) = random_leg(seed);
        prop_assert!(apart_m(leg.at(t), leg.reversed().at(1.0 - t)) < 1e-5);
        prop_assert_eq!(leg.reversed().p1(), leg.p4());
        prop_assert!((leg.length_m() - leg.reversed().length_m()).abs() < 1e-6 * leg.length_m());
    }

    #[test]
    fn both_parts_of_a_split_trace_the_leg(seed in 0u64..1_000_000, cut in 0.01..0.99, t in 0.0..1.0) {
        let (_, leg) = random_leg(seed);
        let (a, b) = leg.split(cut);
        prop_assert_eq!(a.p4(), b.p1());
        prop_assert_eq!((a.p1(), b.p4()), (leg.p1(), leg.p4()));
        prop_assert!(apart_m(a.at(t), leg.at(cut * t)) < 1e-4);
        prop_assert!(apart_m(b.at(t), leg.at(cut + (1.0 - cut) * t)) < 1e-4);
    }

    #[test]
    fn a_densified_route_starts_and_ends_where_its_legs_do(seed in 0u64..1_000_000) {
        let (_, leg) = random_leg(seed);
        let back = Leg::from(leg.reversed());
        let route = densify(&[leg.into(), back], &Options::geometry(1.0)).unwrap();
        let vertices = &route.vertices;
        prop_assert_eq!(vertices[0].position, leg.p1());
        // There and back is a closed loop, equal bit for bit.
        prop_assert_eq!(vertices[vertices.len() - 1].position, leg.p1());
        let joints = vertices.iter().filter(|v| v.leg == 0 && v.t == 1.0).count();
        prop_assert_eq!(joints, 1);
        for pair in vertices.windows(2) {
            prop_assert!(pair[1].leg > pair[0].leg || pair[1].t > pair[0].t);
        }
    }

    #[test]
    fn nothing_that_is_no_leg_passes_and_nothing_panics(
        numbers in proptest::array::uniform12(prop_oneof![
            -90.0..90.0f64, Just(f64::NAN), Just(f64::INFINITY), Just(0.0), Just(1e300), 0.0..0.1f64, 37.0..37.1f64,
        ]),
        altitudes in any::<[bool; 2]>(),
    ) {
        let n = numbers;
        let control = |k: usize, with: bool| Control { lat_deg: n[k], lon_deg: n[k + 1], alt_m: with.then_some(n[k + 2]) };
        let leg = BezierLeg::new(
            Position::new(n[0], n[1], n[2]),
            control(3, altitudes[0]),
            control(6, altitudes[1]),
            Position::new(n[9], n[10], n[11]),
        );
        if let Ok(leg) = leg {
            prop_assert!(leg.at(0.5).lat_deg.is_finite());
            let _ = densify(&[leg.into()], &Options::flight(5.0));
        }
    }
}

#[test]
fn the_definition_by_hand() {
    // Along the equator, symmetric: the middle is at the middle longitude, whatever the arms.
    let leg = BezierLeg::new(
        Position::new(0.0, -0.01, 0.0),
        Control::with_altitude(0.0, -0.005, 80.0),
        Control::with_altitude(0.0, 0.005, 80.0),
        Position::new(0.0, 0.01, 0.0),
    )
    .unwrap();
    let middle = leg.at(0.5);
    assert!(middle.lat_deg.abs() < 1e-12 && middle.lon_deg.abs() < 1e-12);
    // (0 + 3 * 80 + 3 * 80 + 0) / 8
    assert!((middle.alt_m - 60.0).abs() < 1e-12);
    // Over the pole: two points on opposite meridians.
    let over = BezierLeg::new(
        Position::new(89.99, 0.0, 0.0),
        Control::level(89.997, 0.0),
        Control::level(89.997, 180.0),
        Position::new(89.99, 180.0, 100.0),
    )
    .unwrap();
    assert!(90.0 - over.at(0.5).lat_deg < 1e-9);
    assert!((over.at(0.5).alt_m - 50.0).abs() < 1e-6);
    assert!(over.at(0.25).lon_deg.abs() < 1e-6 && over.at(0.75).lon_deg.abs() > 179.999);
}

#[test]
fn each_error_names_the_place_the_value_and_what_was_expected() {
    let p = Position::new(37.0, 127.0, 100.0);
    let q = Position::new(37.01, 127.0, 100.0);
    let c = Control::level(37.005, 127.002);
    let text = |p1, p2, p3, p4| BezierLeg::new(p1, p2, p3, p4).unwrap_err().to_string();
    assert_eq!(
        text(p, Control::level(f64::NAN, 127.0), c, q),
        "P2: latitude is NaN, expected a finite number"
    );
    assert_eq!(
        text(p, c, Control::level(37.0, 181.0), q),
        "P3: longitude is 181, expected -180 to 180"
    );
    assert!(
        text(p, Control::level(37.6, 127.0), c, q).starts_with("P2 is 66"),
        "50 km"
    );
    assert!(
        text(p, c, Control::with_altitude(37.0, 127.0, 5.0), q)
            .starts_with("P2 carries no altitude")
    );
    let same = Control::level(37.0, 127.0);
    assert!(matches!(
        BezierLeg::new(p, same, same, p),
        Err(LegError::ZeroLength { .. })
    ));
    let far = Position::new(37.6, 127.0, 100.0);
    assert!(matches!(
        Leg::straight(p, far),
        Err(LegError::TooFar { point: "P4", .. })
    ));
}

/// The table for implementers in docs/guide/curves.md, computed by an independent program.
#[test]
fn the_published_check_values() {
    let leg = BezierLeg::new(
        Position::new(37.29, 127.20, 100.0),
        Control::level(37.31, 127.20),
        Control::level(37.31, 127.24),
        Position::new(37.29, 127.24, 200.0),
    )
    .unwrap();
    let page = include_str!("../../../docs/guide/curves.md");
    let rows = page.lines().filter_map(|line| {
        let cells: Result<Vec<f64>, _> = line
            .trim_matches('|')
            .split('|')
            .map(|c| c.trim().parse())
            .collect();
        cells.ok().filter(|cells| cells.len() == 4)
    });
    let mut seen = 0;
    for row in rows {
        let found = leg.at(row[0]);
        assert!(
            (found.lat_deg - row[1]).abs() < 1e-8 && (found.lon_deg - row[2]).abs() < 1e-8,
            "{found:?}"
        );
        assert!((found.alt_m - row[3]).abs() < 1e-3, "{found:?}");
        seen += 1;
    }
    assert_eq!(seen, 3);
}

#[test]
fn a_torn_or_empty_route_is_refused() {
    assert_eq!(
        densify(&[], &Options::geometry(1.0)),
        Err(DensifyError::Empty)
    );
    let (_, leg) = random_leg(0);
    let error = densify(&[leg.into(), leg.into()], &Options::geometry(1.0)).unwrap_err();
    assert!(matches!(error, DensifyError::Gap { leg: 1, .. }), "{error}");
}

#[test]
fn a_turn_too_tight_for_the_chords_is_named_with_its_place() {
    // Half a circle of 2.5 m: one chord is 2.5 m off it, and two chords of 4 m are longer than it.
    let (south, north, east) = (47.4, 47.400_045, 8.500_044_2);
    let p1 = Position::new(south, 8.5, 500.0);
    let (p2, p3) = (Control::level(south, east), Control::level(north, east));
    let leg = BezierLeg::new(p1, p2, p3, Position::new(north, 8.5, 500.0)).unwrap();
    let to = Leg::straight(Position::new(south, 8.499, 500.0), p1).unwrap();
    let error = densify(&[to, leg.into()], &Options::flight(1.0)).unwrap_err();
    let DensifyError::ChordTooShort {
        leg: index, t, at, ..
    } = error
    else {
        panic!("{error}");
    };
    assert_eq!((index, at), (1, leg.at(t)));
    let place = format!("({:.7}, {:.7})", at.lat_deg, at.lon_deg);
    let text = error.to_string();
    assert!(
        text.contains(&place) && text.contains("make it wider or less steep"),
        "{text}"
    );
}

#[test]
fn radians_and_degrees_are_one_place() {
    let g = Ground::from_radians(0.65, 2.2);
    assert!(
        (g.lat_deg - 37.242_256_681).abs() < 1e-8 && (g.lon_deg - 126.050_714_921).abs() < 1e-8
    );
}
