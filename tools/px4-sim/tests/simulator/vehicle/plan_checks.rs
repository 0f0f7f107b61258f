//! The codes of a refused upload, and what is accepted although it should not be.

use crate::vehicle::support::*;
use mavlink::dialects::development as mav;
use mavlink::dialects::development::{MavMessage, MissionState};

#[test]
fn bad_items_have_their_codes() {
    let mut flight = Flight::ready();
    let mut local = waypoint(10.0, 0.0, 5.0);
    local.frame = 1;
    let mut terrain = waypoint(10.0, 0.0, 5.0);
    terrain.frame = 11;
    let mut pitch = takeoff(10.0);
    pitch.params[0] = 15.0;
    for (bad, code) in [
        (local, 2),
        (terrain, 2),
        (item(18, [0.0, 0.0, 0.0, f32::NAN], 10.0, 0.0, 5.0), 3),
        (item(82, [0.0, 0.0, 0.0, f32::NAN], 10.0, 0.0, 5.0), 3),
        (pitch, 6),
    ] {
        assert_eq!(flight.upload(&[takeoff(10.0), bad]), Some(code), "{bad:?}");
        flight.run(0.1);
    }
    flight.run(0.5);
    assert!(
        flight.has_text("IGN MISSION_ITEM: Invalid item"),
        "{:?}",
        flight.texts()
    );
}

#[test]
fn an_acceptance_is_no_safety_check() {
    let mut flight = Flight::ready();
    let mut nowhere = waypoint(10.0, 0.0, 5.0);
    nowhere.x = 2_000_000_000;
    let mut nan = waypoint(10.0, 0.0, f32::NAN);
    nan.z = f32::NAN;
    let jump = action(177, [99.0, 1.0, 0.0, 0.0]);
    for plan in [
        vec![takeoff(10.0), nowhere],
        vec![takeoff(10.0), nan],
        vec![takeoff(10.0), waypoint(20_000.0, 0.0, 10.0)],
        vec![takeoff(10.0), jump],
        vec![waypoint(10.0, 0.0, 5.0)],
    ] {
        assert_eq!(flight.upload(&plan), Some(0));
        flight.run(1.2);
        assert_eq!(
            flight.mission_current().mission_state,
            MissionState::MISSION_STATE_NOT_STARTED
        );
        assert_eq!(usize::from(flight.mission_current().total), plan.len());
    }
}

#[test]
fn a_plan_outside_the_fence_is_aboard_but_cannot_be_flown() {
    let mut flight = Flight::ready();
    let fence = [item(5003, [50.0, 0.0, 0.0, 0.0], 0.0, 0.0, 0.0)];
    assert_eq!(
        flight.upload_kind(&fence, mav::MavMissionType::MAV_MISSION_TYPE_FENCE),
        Some(0)
    );
    assert_eq!(
        flight.upload(&[takeoff(10.0), waypoint(100.0, 0.0, 10.0)]),
        Some(0)
    );
    flight.run(1.5);
    assert!(
        flight.has_text("Geofence violation for waypoint 2"),
        "{:?}",
        flight.texts()
    );
    let current = flight.mission_current();
    assert_eq!(
        (current.total, current.mission_state),
        (2, MissionState::MISSION_STATE_NO_MISSION)
    );
    assert_ne!(current.fence_id, 0);
    assert_eq!(flight.command(300, &[0.0]), Some(2));
}

#[test]
fn an_area_that_home_breaches_is_left_out_until_the_fence_is_another() {
    let mut flight = Flight::ready();
    let around = |north| [item(5003, [50.0, 0.0, 0.0, 0.0], north, 0.0, 0.0)];
    let load = |flight: &mut Flight, north| {
        let kind = mav::MavMissionType::MAV_MISSION_TYPE_FENCE;
        assert_eq!(flight.upload_kind(&around(north), kind), Some(0));
        flight.run(1.5);
        let left_out = "Geofence invalid, doesn't contain Home position";
        let texts = flight.texts();
        texts.iter().filter(|text| text.contains(left_out)).count()
    };
    assert_eq!(load(&mut flight, 100.0), 1);
    // It is not read again.
    assert_eq!(load(&mut flight, 100.0), 1);
    assert_eq!(
        flight.upload(&[takeoff(10.0), waypoint(-100.0, 0.0, 10.0)]),
        Some(0)
    );
    flight.run(1.5);
    let state = |flight: &Flight| flight.mission_current().mission_state;
    assert_eq!(state(&flight), MissionState::MISSION_STATE_NOT_STARTED);
    assert_eq!(load(&mut flight, 0.0), 1);
    assert_eq!(state(&flight), MissionState::MISSION_STATE_NO_MISSION);
}

#[test]
fn an_unknown_command_and_an_unknown_kind_are_answered() {
    let mut flight = Flight::ready();
    let count = |mission_type: u8| {
        // count 1, target 1/1, mission type.
        [1, 0, 1, 1, mission_type, 0, 0, 0, 0]
    };
    flight.vehicle.handle_raw(GCS, 44, &count(77));
    flight.run(0.1);
    assert_eq!(
        flight.raw.last().map(|(id, p)| (*id, p[2], p[3])),
        Some((47, 4, 77))
    );

    flight.send(&MavMessage::MISSION_COUNT(mav::MISSION_COUNT_DATA {
        count: 1,
        target_system: 1,
        target_component: 1,
        ..Default::default()
    }));
    let mut bytes = [0; 38];
    bytes[30..32].copy_from_slice(&65_000u16.to_le_bytes());
    bytes[32..36].copy_from_slice(&[1, 1, 6, 1]);
    flight.vehicle.handle_raw(GCS, 73, &bytes);
    flight.run(0.1);
    let ack = flight.last(|m| match m {
        MavMessage::MISSION_ACK(a) => Some(a.mavtype as u32),
        _ => None,
    });
    assert_eq!(ack, Some(3));
}
