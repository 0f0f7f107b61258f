//! What a new plan does to a vehicle that flies another one.

use crate::vehicle::support::*;
use mavlink::dialects::development as mav;
use mavlink::dialects::development::{MavMessage, MissionState};
use mavlink_link::service::mission::{Item, plan_id};
use px4_sim::{Mode, Truth};

fn plan(east: f64) -> Vec<Item> {
    vec![
        takeoff(10.0),
        waypoint(60.0, east, 10.0),
        waypoint(120.0, east, 10.0),
        waypoint(180.0, east, 10.0),
        land(180.0, east),
    ]
}

/// On its way to item 2.
fn on_the_way() -> Flight {
    let mut flight = Flight::ready();
    assert_eq!(flight.upload(&plan(0.0)), Some(0));
    assert_eq!(flight.command(300, &[0.0]), Some(0));
    assert!(flight.until(90.0, |t| t.mission_seq == 2));
    flight.run(1.2);
    flight
}

#[test]
fn the_same_plan_changes_nothing() {
    let mut flight = on_the_way();
    let before = flight.mission_current();
    assert_eq!(before.mission_id, plan_id(&plan(0.0)));
    assert_eq!(flight.upload(&plan(0.0)), Some(0));
    flight.run(2.0);
    assert_eq!(flight.mission_current(), before);
    assert_eq!(flight.vehicle.truth().mode, Mode::Mission);
}

#[test]
fn another_plan_is_flown_at_once_from_the_same_index() {
    let mut flight = on_the_way();
    assert_eq!(flight.upload(&plan(80.0)), Some(0));
    flight.run(2.0);
    let now = flight.mission_current();
    assert_eq!((now.seq, now.total), (2, 5));
    assert_eq!(now.mission_id, plan_id(&plan(80.0)));
    assert_eq!(now.mission_state, MissionState::MISSION_STATE_ACTIVE);
    assert!(
        flight.until(60.0, |t| t.position.e > 60.0 && t.mission_seq >= 2),
        "turns to the new plan"
    );
}

#[test]
fn an_item_marked_current_is_where_another_plan_starts() {
    let mut flight = on_the_way();
    let mut items = plan(80.0);
    items[3].current = true;
    assert_eq!(flight.upload(&items), Some(0));
    flight.run(1.2);
    assert_eq!(flight.mission_current().seq, 3);
}

#[test]
fn a_shorter_plan_starts_at_its_last_item() {
    let mut flight = on_the_way();
    assert_eq!(flight.upload(&plan(0.0)[..2]), Some(0));
    flight.run(0.1);
    assert_eq!(flight.vehicle.truth().mission_seq, 1);
}

#[test]
fn clearing_the_plan_makes_it_hold() {
    let mut flight = on_the_way();
    flight.send(&MavMessage::MISSION_CLEAR_ALL(
        mav::MISSION_CLEAR_ALL_DATA {
            target_system: 1,
            target_component: 1,
            mission_type: mav::MavMissionType::MAV_MISSION_TYPE_MISSION,
        },
    ));
    flight.run(1.2);
    assert!(flight.has_text("No valid mission available, loitering"));
    assert_eq!(flight.vehicle.truth().mode, Mode::Loiter);
    let now = flight.mission_current();
    assert_eq!(
        (now.seq, now.total, now.mission_state),
        (0, 65535, MissionState::MISSION_STATE_NO_MISSION)
    );
    assert_eq!(flight.set_mode(Mode::Mission), Some(1));
}

#[test]
fn set_current_works_in_any_mode_and_refuses_what_is_not_there() {
    let mut flight = on_the_way();
    assert_eq!(flight.set_mode(Mode::Loiter), Some(0));
    flight.run(1.2);
    assert_eq!(
        flight.mission_current().mission_state,
        MissionState::MISSION_STATE_PAUSED
    );
    flight.send(&select(3));
    flight.run(1.2);
    assert_eq!(flight.mission_current().seq, 3);
    flight.send(&select(77));
    flight.run(0.5);
    assert!(flight.has_text("WPM: WP CURR CMD: Not in list"));
    assert_eq!(flight.set_mode(Mode::Mission), Some(0));
    flight.run(1.0);
    assert_eq!(flight.vehicle.truth().mission_seq, 3);
}

#[allow(deprecated, reason = "PX4 takes this and refuses its successor")]
fn select(seq: u16) -> MavMessage {
    MavMessage::MISSION_SET_CURRENT(mav::MISSION_SET_CURRENT_DATA {
        seq,
        target_system: 1,
        target_component: 1,
    })
}

/// Seen on v1.18: the speed is reset where AUTO.MISSION is entered, and the last one before the current item repeated.
#[test]
fn a_jump_keeps_the_present_speed_and_entering_the_mission_repeats_that_of_its_items() {
    let mut flight = Flight::ready();
    let plan = vec![
        takeoff(10.0),
        waypoint(400.0, 0.0, 10.0),
        action(178, [1.0, 2.0, -1.0, 0.0]),
        waypoint(800.0, 0.0, 10.0),
    ];
    assert_eq!(flight.upload(&plan), Some(0));
    assert_eq!(flight.command(300, &[0.0]), Some(0));
    assert!(flight.until(60.0, |t| t.mission_seq == 1));
    let is_flown = |flight: &mut Flight, expected: f64| {
        flight.run(18.0);
        let found = flight.vehicle.truth().velocity.horizontal();
        assert!(
            (found - expected).abs() < 0.5,
            "{found:.2} m/s, expected {expected} m/s"
        );
    };
    let enter_again = |flight: &mut Flight| {
        assert_eq!(flight.set_mode(Mode::Loiter), Some(0));
        flight.run(1.0);
        assert_eq!(flight.set_mode(Mode::Mission), Some(0));
    };
    is_flown(&mut flight, 5.0);
    flight.send(&select(3));
    is_flown(&mut flight, 5.0);
    enter_again(&mut flight);
    is_flown(&mut flight, 2.0);
    flight.send(&select(1));
    is_flown(&mut flight, 2.0);
    enter_again(&mut flight);
    is_flown(&mut flight, 5.0);
}

#[test]
fn an_item_reached_is_reported_repeatedly() {
    let flight = on_the_way();
    let repeats = flight
        .received
        .iter()
        .filter(|(_, m)| matches!(m, MavMessage::MISSION_ITEM_REACHED(r) if r.seq == 1))
        .count();
    assert!(repeats >= 2, "{repeats}");
}

#[test]
fn a_hold_a_speed_and_a_jump_are_flown() {
    let mut flight = Flight::ready();
    let plan = vec![
        takeoff(10.0),
        action(178, [1.0, 2.0, -1.0, 0.0]),
        item(16, [3.0, 2.0, 0.0, f32::NAN], 40.0, 0.0, 10.0),
        waypoint(0.0, 0.0, 10.0),
        action(177, [2.0, 1.0, 0.0, 0.0]),
        action(20, [0.0; 4]),
    ];
    assert_eq!(flight.upload(&plan), Some(0));
    assert_eq!(flight.command(300, &[0.0]), Some(0));
    assert!(
        flight.until(400.0, |t| !t.armed),
        "{:?}",
        flight.vehicle.truth()
    );
    let fastest = |part: &[Truth]| {
        part.iter()
            .map(|t| t.velocity.horizontal())
            .fold(0.0, f64::max)
    };
    let mission: Vec<Truth> = flight
        .track
        .iter()
        .filter(|t| t.mode == Mode::Mission)
        .copied()
        .collect();
    assert!(fastest(&mission) < 2.4, "{}", fastest(&mission));
    let reached = |seq: u16| {
        let mut times = 0;
        let mut last = f64::NEG_INFINITY;
        for (at, m) in &flight.received {
            if matches!(m, MavMessage::MISSION_ITEM_REACHED(r) if r.seq == seq) {
                if at - last > 12.0 {
                    times += 1;
                }
                last = *at;
            }
        }
        times
    };
    assert_eq!(reached(2), 2, "the jump repeats item 2 once");
    let held = mission
        .windows(2)
        .filter(|w| w[0].velocity.horizontal() < 0.3)
        .count() as f64
        * 0.1;
    assert!(held > 4.0, "two holds of 3 s: {held}");
    assert!(flight.track.iter().any(|t| t.mode == Mode::Rtl));
}
