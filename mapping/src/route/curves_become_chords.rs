//! A curved leg becomes chords that PX4 flies, within the tolerance, or is refused with the waypoint.

use crate::altitude::{Agl, Altimeter};
use crate::limits::{Limits, Performance, metres};
use crate::parameter::Parameters;
use crate::plan::Plan;
use crate::route::{CompiledMission, Curving, Reason, RouteError, Site, Vertices, compile};
use crate::telemetry::Place;
use curve_paths::flight::Policy;
use curve_paths::{BezierLeg, Control, Position};
use stanag_msgs::enums::{AltitudeType, LimitType, WaypointType};
use stanag_msgs::messages::{CurveSegment, CurveSegmentPaper, UaPositionWaypoint, UaRoute};
use stanag_msgs::{Bam32, Id, Message, Scaled};

const CUCS: Id = Id(0x1b00_00a0);
const VEHICLE: Id = Id(0x1b00_0101);
const P1: (f64, f64) = (47.3980, 8.5460);
const P2: (f64, f64) = (47.3990, 8.5460);
const P3: (f64, f64) = (47.3995, 8.5475);
const P4: (f64, f64) = (47.3985, 8.5485);

pub(super) fn site() -> Site<'static> {
    Site {
        home: Place {
            latitude: 47.3977,
            longitude: 8.5456,
            amsl_m: 488.0,
        },
        geoid_m: Some(47.4),
        agl: Agl::AboveHome,
        terrain: None,
        altimeter: Altimeter::STANDARD,
        wings: None,
        limits: Limits::default(),
        performance: Performance::default(),
        curving: Curving::default(),
    }
}

fn waypoint(number: u16, at: (f64, f64), next: u16) -> Message {
    Message::UaPositionWaypoint(UaPositionWaypoint {
        waypoint_number: Some(number),
        waypoint_to_latitude_or_relative_y: Some(Bam32::from_degrees(at.0)),
        waypoint_to_longitude_or_relative_x: Some(Bam32::from_degrees(at.1)),
        waypoint_to_altitude: Scaled::from_si(30.0).ok(),
        waypoint_altitude_type: Some(AltitudeType::Agl),
        waypoint_to_speed: Scaled::from_si(5.0).ok(),
        next_waypoint: Some(next),
        ..UaPositionWaypoint::default()
    })
}

fn curve(p1: u16, p4: u16) -> CurveSegment {
    CurveSegment {
        p1_waypoint_no: Some(p1),
        p4_waypoint_no: Some(p4),
        p2_latitude: Some(Bam32::from_degrees(P2.0)),
        p2_longitude: Some(Bam32::from_degrees(P2.1)),
        p3_latitude: Some(Bam32::from_degrees(P3.0)),
        p3_longitude: Some(Bam32::from_degrees(P3.1)),
        ..CurveSegment::default()
    }
}

fn planned(curves: &[Message]) -> Result<CompiledMission, RouteError> {
    planned_at(curves, &site())
}

fn planned_at(curves: &[Message], site: &Site) -> Result<CompiledMission, RouteError> {
    let mut plan = Plan::default();
    let route = UaRoute {
        initial_waypoint_number: Some(9),
        ..UaRoute::default()
    };
    let waypoints = [
        Message::UaRoute(route),
        waypoint(9, P1, 4),
        waypoint(4, P4, 2),
        waypoint(2, P1, 0),
    ];
    for message in waypoints.iter().chain(curves) {
        plan.store(message, CUCS, VEHICLE).expect("stored");
    }
    compile(&plan, 9, site)
}

fn refused(curves: &[Message]) -> RouteError {
    planned(curves).expect_err("should be refused")
}

#[test]
fn the_chords_stay_within_the_tolerance_and_their_radii_within_half_a_chord() {
    let compiled = planned(&[Message::CurveSegment(curve(9, 4))]).expect("flown");
    let places: Vec<(f64, f64, f32)> = compiled
        .items
        .iter()
        .filter(|item| item.command == 16)
        .map(|item| {
            (
                f64::from(item.x) / 1e7,
                f64::from(item.y) / 1e7,
                item.params[1],
            )
        })
        .collect();
    let chords = &places[..places.len() - 1];
    assert!(chords.len() > 5, "a curve of {} vertices", chords.len());
    for pair in chords.windows(2) {
        let chord_m = metres((pair[0].0, pair[0].1), (pair[1].0, pair[1].1));
        assert!(chord_m >= 3.99, "a chord of {chord_m} m");
        assert!(
            (2.0..=3.0).contains(&pair[0].2) && f64::from(pair[0].2) <= 0.5 * chord_m + 0.01,
            "{pair:?}"
        );
    }
    let end = |at: (f64, f64)| Position::new(at.0, at.1, 30.0);
    let exact = BezierLeg::new(
        end(P1),
        Control::level(P2.0, P2.1),
        Control::level(P3.0, P3.1),
        end(P4),
    )
    .expect("a leg");
    for step in 0..=1000 {
        let at = exact.at(f64::from(step) / 1000.0);
        let off_m = chords
            .windows(2)
            .map(|pair| {
                from_chord(
                    (at.lat_deg, at.lon_deg),
                    (pair[0].0, pair[0].1),
                    (pair[1].0, pair[1].1),
                )
            })
            .fold(f64::MAX, f64::min);
        assert!(off_m <= 1.02, "{off_m} m off at {step}");
    }
}

/// Distance from a chord in a plane at the point: the leg is 200 m long.
fn from_chord(at: (f64, f64), a: (f64, f64), b: (f64, f64)) -> f64 {
    let plane = |p: (f64, f64)| {
        (
            (p.0 - at.0) * 111_200.0,
            (p.1 - at.1) * 111_200.0 * at.0.to_radians().cos(),
        )
    };
    let ((ax, ay), (bx, by)) = (plane(a), plane(b));
    let (dx, dy) = (bx - ax, by - ay);
    let along = (-(ax * dx + ay * dy) / (dx * dx + dy * dy)).clamp(0.0, 1.0);
    (ax + along * dx).hypot(ay + along * dy)
}

#[test]
fn a_flight_to_the_curves_end_goes_straight_there() {
    let compiled = planned(&[Message::CurveSegment(curve(9, 4))]).expect("flown");
    let first = usize::from(compiled.first_item_of(4).expect("waypoint 4"));
    assert_ne!(
        compiled.waypoint_of[first - 1],
        9,
        "the chords lie before it"
    );
    let last = (first..)
        .find(|at| compiled.items[*at].command == 16)
        .expect("its position");
    assert!(
        metres(
            (
                f64::from(compiled.items[last].x) / 1e7,
                f64::from(compiled.items[last].y) / 1e7
            ),
            P4
        ) < 0.1
    );
    assert_eq!(
        compiled.leg_of_item(first as u16 - 1),
        Some(1),
        "4001 says that a chord leads to waypoint 4"
    );
}

#[test]
fn both_messages_draw_the_same_curve() {
    let paper = CurveSegmentPaper {
        vehicle_id: Some(VEHICLE),
        cucs_id: Some(CUCS),
        p1_waypoint_no: Some(9),
        p4_waypoint_no: Some(4),
        p2_latitude: Some(P2.0.to_radians()),
        p2_longitude: Some(P2.1.to_radians()),
        p3_latitude: Some(P3.0.to_radians()),
        p3_longitude: Some(P3.1.to_radians()),
        ..CurveSegmentPaper::default()
    };
    let native = planned(&[Message::CurveSegment(curve(9, 4))]).expect("flown");
    let paper = planned(&[Message::CurveSegmentPaper(paper)]).expect("flown");
    assert_eq!(native.items.len(), paper.items.len());
    for (one, other) in native.items.iter().zip(&paper.items) {
        assert!(
            (one.x - other.x).abs() <= 2 && (one.y - other.y).abs() <= 2,
            "{one:?} {other:?}"
        );
    }
}

#[test]
fn a_curve_that_cannot_be_flown_is_refused_with_its_waypoint() {
    let far = CurveSegment {
        p2_latitude: Some(Bam32::from_degrees(48.0)),
        ..curve(9, 4)
    };
    let nan = CurveSegmentPaper {
        vehicle_id: Some(VEHICLE),
        cucs_id: Some(CUCS),
        p1_waypoint_no: Some(9),
        p4_waypoint_no: Some(4),
        p2_latitude: Some(f64::NAN),
        p2_longitude: Some(0.1),
        p3_latitude: Some(0.8),
        p3_longitude: Some(0.1),
        ..CurveSegmentPaper::default()
    };
    let without = CurveSegment {
        p3_longitude: None,
        ..curve(9, 4)
    };
    // What is no angle is not even stored.
    let stored = Plan::default().store(&Message::CurveSegmentPaper(nan), CUCS, VEHICLE);
    assert!(stored.is_err(), "{stored:?}");
    for bad in [Message::CurveSegment(far), Message::CurveSegment(without)] {
        let fault = refused(&[bad]);
        assert_eq!(fault.waypoint, 9);
        assert!(
            matches!(fault.reason, Reason::Curve { to: 4, .. }),
            "{fault}"
        );
    }
    let low = Scaled::from_si(-900.0).ok();
    let dive = CurveSegment {
        p2_altitude: low,
        p3_altitude: low,
        altitude_type: Some(AltitudeType::Agl),
        ..curve(9, 4)
    };
    let fault = refused(&[Message::CurveSegment(dive)]);
    assert_eq!(fault.waypoint, 9);
    let text = fault.to_string();
    assert!(
        text.starts_with("waypoint 9: its curved leg to 4: at 47.39"),
        "{text}"
    );
    assert!(text.contains("below home (488.0 m AMSL)"), "{text}");
    // A hairpin with a radius of a metre, 500 m to the east: it is named by its place and the waypoints, not by a number of legs.
    let hairpin = CurveSegment {
        p2_latitude: Some(Bam32::from_degrees(47.3980)),
        p2_longitude: Some(Bam32::from_degrees(8.5540)),
        p3_latitude: Some(Bam32::from_degrees(47.3981)),
        p3_longitude: Some(Bam32::from_degrees(8.5540)),
        ..curve(9, 4)
    };
    let curving = Curving {
        policy: Policy::Refuse,
        ..Curving::default()
    };
    let site = Site { curving, ..site() };
    let fault = planned_at(&[Message::CurveSegment(hairpin)], &site).expect_err("too tight");
    let text = fault.to_string();
    assert!(
        text.starts_with("waypoint 9: its curved leg to 4: at 47.39"),
        "{text}"
    );
    assert!(!text.contains("leg 0"), "{text}");
    let fault = refused(&[Message::CurveSegment(curve(9, 2))]);
    assert_eq!(
        (fault.waypoint, fault.reason),
        (9, Reason::CurveEnd { to: 2, next: 4 })
    );
    let fault = refused(&[
        Message::CurveSegment(curve(9, 4)),
        Message::CurveSegment(curve(9, 2)),
    ]);
    assert_eq!(fault.waypoint, 9);
    assert!(matches!(fault.reason, Reason::TwoCurves(..)), "{fault}");
    let fault = refused(&[Message::CurveSegment(curve(9, 77))]);
    assert_eq!(
        (fault.waypoint, fault.reason),
        (77, Reason::CurveWithoutEnd(9))
    );
}

#[test]
fn a_loop_is_not_closed_by_a_curve() {
    let lap = |limit: u16| {
        let mut plan = Plan::default();
        let Message::UaPositionWaypoint(end) = waypoint(4, P4, 9) else {
            unreachable!()
        };
        let end = UaPositionWaypoint {
            waypoint_type: Some(WaypointType::EndOfLoop),
            limit_type: Some(LimitType::Count),
            loop_limit: Some(limit),
            ..end
        };
        let back = CurveSegment {
            p1_waypoint_no: Some(4),
            p4_waypoint_no: Some(9),
            ..curve(4, 9)
        };
        for message in [waypoint(9, P1, 4), end.into(), back.into()] {
            plan.store(&message, CUCS, VEHICLE).expect("stored");
        }
        compile(&plan, 9, &site())
    };
    // Flown straight it would be another leg than the one that was sent.
    let fault = lap(3).expect_err("the way back is curved");
    let (waypoint, reason) = (fault.waypoint, fault.reason);
    assert_eq!((waypoint, reason), (4, Reason::CurveClosesLoop(9)));
    // A loop that is flown once does not lead back.
    assert!(lap(1).is_ok());
}

#[test]
fn a_curve_without_its_end_is_refused_with_what_mends_it() {
    let stray = |curve: CurveSegment| refused(&[Message::CurveSegment(curve)]).to_string();
    assert_eq!(
        stray(curve(9, 77)),
        "waypoint 77: not received, and a curved leg joins it to 9: send it (13002), or clear the plan (13000 mode 1)"
    );
    assert!(stray(curve(77, 9)).starts_with("waypoint 77: not received"));
    // Where the waypoint that leads to the missing one is led elsewhere, the curve goes with the leg.
    let led = |next| [Message::CurveSegment(curve(2, 77)), waypoint(2, P1, next)];
    let why = refused(&led(77)).to_string();
    let way = "send it (13002), or 2 with another Next Waypoint, or clear";
    assert!(why.contains(way), "{why}");
    let [stray, to_77] = led(77);
    assert!(planned(&[stray, to_77, waypoint(2, P1, 0)]).is_ok());
}

#[test]
fn a_curve_stays_where_its_waypoint_is_sent_again_for_the_same_leg() {
    let whole = [
        Message::CurveSegment(curve(9, 4)),
        waypoint(9, P1, 4),
        waypoint(4, P4, 2),
    ];
    let legs = |messages: &[Message]| planned(messages).expect("flown").curved.map(|c| c.legs);
    assert_eq!(legs(&whole), Some(1));
    let away_and_back = [&whole[..], &[waypoint(9, P1, 2), waypoint(9, P1, 4)]].concat();
    assert_eq!(legs(&away_and_back), None);
}

#[test]
fn too_few_items_mean_the_smallest_tolerance_that_they_allow_and_a_note() {
    let curves = [Message::CurveSegment(curve(9, 4))];
    let within = |items: usize| {
        let mut site = site();
        site.limits.items = items;
        planned_at(&curves, &site)
    };
    let free = within(500).expect("flown");
    let wished = free.curved.expect("a curve");
    assert!(wished.tolerance_m == 1.0 && wished.bound_m <= 1.0);
    assert_eq!(
        wished.chords,
        free.items.iter().filter(|item| item.command == 16).count() - 2
    );
    let fewest = free.items.len();
    let mut before_m = 1.0;
    for items in (fewest - 4..fewest).rev() {
        let compiled = within(items).expect("flown more coarsely");
        let curved = compiled.curved.expect("a curve");
        assert!(compiled.items.len() <= items);
        assert!(curved.bound_m <= curved.tolerance_m && curved.tolerance_m > before_m - 1e-9);
        let note_text = format!("tolerance {:.2} m, not 1 m", curved.tolerance_m);
        assert!(
            compiled.notes.iter().any(|note| note.contains(&note_text)),
            "{:?}",
            compiled.notes
        );
        // A little less would need more.
        let mut closer = site();
        closer.limits.items = items;
        closer.curving.tolerance_m = curved.tolerance_m / 1.02;
        let closer = planned_at(&curves, &closer).expect("flown");
        assert!(closer.curved.expect("a curve").tolerance_m > curved.tolerance_m / 1.02);
        before_m = curved.tolerance_m;
    }
    let fault = within(3).expect_err("the waypoints alone are more");
    assert!(matches!(fault.reason, Reason::TooManyItems(3)), "{fault}");
}

#[test]
fn free_vertices_are_fewer_and_the_ends_stay() {
    let curves = [Message::CurveSegment(curve(9, 4))];
    let items = |vertices, tolerance_m| {
        let mut site = site();
        site.curving = Curving {
            vertices,
            tolerance_m,
            ..site.curving
        };
        planned_at(&curves, &site).expect("flown")
    };
    let (on, free) = (items(Vertices::OnCurve, 0.5), items(Vertices::Free, 0.5));
    assert!(
        free.items.len() < on.items.len(),
        "{} {}",
        free.items.len(),
        on.items.len()
    );
    assert!(free.curved.expect("a curve").bound_m <= 0.5);
    let places = |compiled: &CompiledMission| -> Vec<(i32, i32)> {
        let places = compiled.items.iter().filter(|item| item.command == 16);
        places.map(|item| (item.x, item.y)).collect()
    };
    let (on, free) = (places(&on), places(&free));
    assert_eq!((on[0], on[on.len() - 2]), (free[0], free[free.len() - 2]));
}

#[test]
fn the_prediction_uses_the_vehicle_s_own_parameters() {
    let curves = [Message::CurveSegment(curve(9, 4))];
    let mut slow = site();
    let mut reported = Parameters::default();
    reported.set("MPC_ACC_HOR", 0.1);
    slow.curving.know(&reported);
    let time_s = |site: &Site| {
        let compiled = planned_at(&curves, site).expect("flown");
        compiled.curved.expect("a curve").time_s
    };
    let (slow_s, known_s) = (time_s(&slow), time_s(&site()));
    assert!(slow_s > 1.5 * known_s, "{slow_s} {known_s}");
}
