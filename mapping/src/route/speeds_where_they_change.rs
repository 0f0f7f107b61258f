//! A speed becomes a DO_CHANGE_SPEED where it is another one than before, or may be.

use stanag_msgs::enums::{AltitudeType, LimitType, WaypointType};
use stanag_msgs::messages::{CurveSegment, UaPositionWaypoint};
use stanag_msgs::{Bam32, Id, Scaled};

use super::curves_become_chords::site;
use super::item::DO_CHANGE_SPEED;
use super::{CompiledMission, compile};
use crate::plan::Plan;

/// Waypoints from 1 on, 100 m apart to the north, with these speeds, changed by `change`.
fn flown(speeds_m_s: &[Option<f64>], change: impl Fn(&mut UaPositionWaypoint)) -> CompiledMission {
    compile(&plan(speeds_m_s, change), 1, &site()).expect("it is flown")
}

fn plan(speeds_m_s: &[Option<f64>], change: impl Fn(&mut UaPositionWaypoint)) -> Plan {
    let mut plan = Plan::default();
    for (number, speed_m_s) in (1_u16..).zip(speeds_m_s) {
        let is_last = usize::from(number) == speeds_m_s.len();
        let mut waypoint = UaPositionWaypoint {
            waypoint_number: Some(number),
            waypoint_to_latitude_or_relative_y: Some(Bam32::from_degrees(
                47.3977 + 0.0009 * f64::from(number),
            )),
            waypoint_to_longitude_or_relative_x: Some(Bam32::from_degrees(8.5456)),
            waypoint_to_altitude: Scaled::from_si(30.0).ok(),
            waypoint_altitude_type: Some(AltitudeType::Agl),
            waypoint_to_speed: speed_m_s.map(Scaled::saturating_from_si),
            next_waypoint: Some(if is_last { 0 } else { number + 1 }),
            ..UaPositionWaypoint::default()
        };
        change(&mut waypoint);
        plan.store(&waypoint.into(), CUCS, VEHICLE).expect("stored");
    }
    plan
}

/// The waypoints before which a speed is set, and the speeds.
fn speeds(compiled: &CompiledMission) -> Vec<(u16, f32)> {
    let items = compiled.items.iter().zip(&compiled.waypoint_of);
    items
        .filter(|(item, _)| item.command == DO_CHANGE_SPEED)
        .map(|(item, number)| (*number, item.params[1]))
        .collect()
}

#[test]
fn a_speed_that_is_flown_already_is_not_set_again() {
    let [slow, fast] = [Some(2.0), Some(6.0)];
    let compiled = flown(&[None, slow, slow, None, slow, fast, fast, slow], |_| {});
    assert_eq!(speeds(&compiled), [(2, 2.0), (6, 6.0), (8, 2.0)]);
    let long = flown(&[slow; 400], |_| {});
    assert_eq!(long.items.len(), 401);
}

#[test]
fn a_loop_sets_the_speeds_that_its_laps_may_begin_without() {
    let [slow, fast] = [Some(2.0), Some(6.0)];
    // Waypoint 2 is reached from waypoint 1 at 2 m/s, and from the end of the loop at 6 m/s.
    let back = |waypoint: &mut UaPositionWaypoint| {
        if waypoint.waypoint_number == Some(4) {
            waypoint.waypoint_type = Some(WaypointType::EndOfLoop);
            waypoint.next_waypoint = Some(2);
            waypoint.limit_type = Some(LimitType::Count);
            waypoint.loop_limit = Some(3);
        }
    };
    let compiled = flown(&[slow, slow, slow, fast], back);
    assert_eq!(speeds(&compiled), [(1, 2.0), (2, 2.0), (4, 6.0)]);
    let compiled = flown(&[slow, None, slow, fast], back);
    assert_eq!(speeds(&compiled), [(1, 2.0), (3, 2.0), (4, 6.0)]);
}

#[test]
fn a_curve_has_its_speed_from_its_own_item() {
    let slow = Some(2.0);
    let mut plan = plan(&[slow; 4], |_| {});
    let east = |degrees_n| {
        (
            Some(Bam32::from_degrees(degrees_n)),
            Some(Bam32::from_degrees(8.5460)),
        )
    };
    let [(p2_latitude, p2_longitude), (p3_latitude, p3_longitude)] = [47.3998, 47.4001].map(east);
    let bow = CurveSegment {
        p1_waypoint_no: Some(2),
        p4_waypoint_no: Some(3),
        p2_latitude,
        p2_longitude,
        p3_latitude,
        p3_longitude,
        ..CurveSegment::default()
    };
    plan.store(&bow.into(), CUCS, VEHICLE).expect("stored");
    let compiled = compile(&plan, 1, &site()).expect("it is flown");
    assert_eq!(speeds(&compiled)[..2], [(1, 2.0), (3, 2.0)]);
}

#[test]
fn a_jump_finds_the_speed_that_is_set_before_it() {
    let [slow, fast] = [Some(2.0), Some(6.0)];
    let compiled = flown(&[None, slow, slow, fast, None], |_| {});
    let before =
        |number| compiled.speed_before(compiled.first_item_of(number).expect("it is there"));
    let over_ground = |speed_m_s| Some((speed_m_s, true));
    assert_eq!(
        [1, 2, 3, 4, 5].map(before),
        [None, None, over_ground(2.0), None, over_ground(6.0)]
    );
    let set_by = |leg| compiled.speed_set_by(leg);
    let expected = [None, Some(1), Some(1), Some(3), Some(3), Some(3)];
    assert_eq!([0, 1, 2, 3, 4, 5].map(set_by), expected);
    assert_eq!(compiled.speed_before(u16::MAX), None);
}

const CUCS: Id = Id(0x1b00_00a0);
const VEHICLE: Id = Id(0x1b00_0101);
