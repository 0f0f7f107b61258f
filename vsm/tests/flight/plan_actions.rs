//! 13006: what is done at a waypoint beside flying there goes up as mission items, is done where it was sent for, and shifts no
//! number of a waypoint.

use kit::bridge::{Rig, Setup, orders};
use mapping::payload::report::RECORDING;
use px4_sim::Airframe;
use stanag_msgs::enums::{AckType, FlightPathControlMode as Mode, MissionPlanMode};
use stanag_msgs::messages::{UaLoiterWaypoint, VehicleSpecificWaypoint};
use stanag_msgs::{Message, Text};

fn at(number: u16, tag: &str) -> Message {
    VehicleSpecificWaypoint {
        waypoint_number: Some(number),
        tag_type: Some(0),
        tag_data: Some(Text::new(tag)),
        ..VehicleSpecificWaypoint::default()
    }
    .into()
}

fn legs() -> Vec<Message> {
    vec![
        orders::route(7).into(),
        orders::waypoint(7, 8, 40.0, 0.0, 20.0).into(),
        orders::waypoint(8, 9, 140.0, 0.0, 20.0).into(),
        orders::waypoint(9, 10, 140.0, 60.0, 20.0).into(),
        orders::waypoint(10, 11, 140.0, 100.0, 20.0).into(),
        orders::waypoint(11, 0, 140.0, 140.0, 20.0).into(),
    ]
}

fn seq_of(rig: &Rig, command: u16) -> Option<usize> {
    let kind = mavlink_link::service::mission::MavMissionType::MAV_MISSION_TYPE_MISSION;
    let items = rig.vehicles[0].vehicle().plan(kind);
    items.iter().position(|item| item.command == command)
}

#[test]
fn actions_are_done_at_their_waypoints_and_downloaded_as_they_were_sent() {
    let mut rig = Rig::ready();
    let mut plan = legs();
    let tags = [
        (7, "TRIGGER 20 M"),
        (8, "TRIGGER OFF"),
        (9, "PHOTO;DELAY 40"),
        (10, "ROI OFF"),
        (11, "VIDEO START"),
    ];
    plan.extend(tags.map(|(number, tag)| at(number, tag)));
    rig.send_plan(plan);
    rig.done(orders::load());
    // They follow the item of their waypoint, and precede the next.
    let [trigger, off, delay, roi] = [206, 2003, 93, 197].map(|id| seq_of(&rig, id));
    assert!(
        trigger < off && off < delay && delay < roi,
        "{trigger:?} {off:?} {delay:?} {roi:?}"
    );
    rig.take_off(20.0);
    rig.done(orders::mode(Mode::Waypoint));
    let actions = |rig: &Rig| rig.vehicles[0].vehicle().actions().clone();
    assert!(
        rig.until(60.0, |rig| actions(rig).triggers > 0),
        "the first waypoint"
    );
    let north = rig.truth().position.n;
    assert!(
        (28.0..52.0).contains(&north),
        "it is triggered {north} m north"
    );
    assert!(
        rig.until(90.0, |rig| actions(rig).commands.contains(&2003)),
        "the second"
    );
    let triggers = actions(&rig).triggers;
    // One at once, then each 20 m of 100.
    assert!((5..=6).contains(&triggers), "{triggers} pulses on 100 m");
    // The delay at the third one is longer than the watchdog waits for progress.
    assert!(rig.until(60.0, |rig| actions(rig).photos == 1), "the third");
    rig.run(35.0);
    let east = rig.truth().position.e;
    assert!((45.0..75.0).contains(&east), "it waits {east} m east");
    assert_eq!(actions(&rig).triggers, triggers, "the trigger is off");
    assert!(!actions(&rig).films);
    assert!(rig.until(90.0, |rig| actions(rig).films), "the last one");
    // No output is moved by them.
    assert_eq!(actions(&rig).outputs, [None; 6]);
    assert!(
        !rig.station().has_alert("no progress"),
        "{:?}",
        rig.station().alerts()
    );
    // 4001 has named the waypoints that were sent, and no other.
    let named = rig
        .station()
        .received
        .iter()
        .filter_map(|(_, _, message)| match message {
            Message::FromToNextWaypointStates(states) => states.to_waypoint_number,
            _ => None,
        });
    let others: Vec<u16> = named
        .filter(|number| ![0, 7, 8, 9, 10, 11].contains(number))
        .collect();
    assert!(others.is_empty(), "{others:?}");
    // The way back.
    let before = rig.station().received.len();
    let download = orders::transfer(MissionPlanMode::Download);
    rig.done(download);
    rig.run(1.0);
    let received = rig.station().received[before..].iter();
    let downloaded: Vec<(u16, String)> = received
        .filter_map(|(_, _, message)| match message {
            Message::VehicleSpecificWaypoint(one) => {
                let text = one.tag_data.as_ref().map(|text| text.as_str().to_owned());
                Some((one.waypoint_number?, text?))
            }
            _ => None,
        })
        .collect();
    assert_eq!(
        downloaded,
        tags.map(|(number, tag)| (number, tag.to_owned()))
    );
}

/// What 21101 has shown last: whether the camera records.
fn records(rig: &Rig) -> bool {
    let mut received = rig.station().received.iter().rev();
    let state = received.find_map(|(_, _, message)| match message {
        Message::EoIrLaserOperatingState(state) => Some(state.system_operating_mode_state),
        _ => None,
    });
    state.expect("21101") == Some(RECORDING)
}

#[test]
fn a_camera_does_what_is_ordered_of_it_at_waypoints_and_shows_it() {
    let mut rig = Rig::ready_with(Setup {
        vehicles: vec![px4_sim::Config {
            payloads: 1,
            ..px4_sim::Config::default()
        }],
        dli_keys: "provisional = \"all\"",
        ..Setup::default()
    });
    let mut plan = legs();
    let tags = [
        (7, "VIDEO START"),
        (8, "VIDEO STOP;PHOTO"),
        (9, "PHOTO EVERY 2"),
        (10, "PHOTO STOP"),
        (11, "TRIGGER 2 S"),
    ];
    plan.extend(tags.map(|(number, tag)| at(number, tag)));
    rig.send_plan(plan);
    rig.done(orders::load());
    rig.take_off(20.0);
    assert!(!records(&rig));
    rig.done(orders::mode(Mode::Waypoint));
    let images = |rig: &Rig| rig.vehicles[0].vehicle().payloads()[0].images;
    assert!(rig.until(60.0, records), "the first waypoint");
    assert!(rig.truth().position.n > 28.0 && images(&rig) == 0);
    assert!(rig.until(60.0, |rig| !records(rig)), "the second");
    assert!(rig.truth().position.n > 120.0);
    // Back in its image mode it takes the one photograph of that waypoint.
    assert_eq!(images(&rig), 1);
    assert!(rig.until(60.0, |rig| images(rig) > 1), "the third");
    let (before, since) = (images(&rig), rig.now().mono);
    let off = |rig: &Rig| rig.vehicles[0].vehicle().actions().commands.contains(&2001);
    assert!(rig.until(60.0, off), "the fourth");
    let lasted_s = (rig.now().mono - since).as_secs_f64();
    let (taken, expected) = (f64::from(images(&rig) - before), lasted_s / 2.0);
    assert!(
        (taken - expected).abs() <= 1.0,
        "{taken} in {lasted_s:.1} s"
    );
    let stopped = images(&rig);
    rig.run(3.0);
    assert_eq!(images(&rig), stopped);
    // The trigger counts by time, where the vehicle stays too: 12 s of pulses each 2 s.
    let triggers = |rig: &Rig| rig.vehicles[0].vehicle().actions().triggers;
    assert!(rig.until(60.0, |rig| triggers(rig) > 0), "the last one");
    let before = (triggers(&rig), images(&rig));
    rig.run(12.0);
    let after = (triggers(&rig), images(&rig));
    assert!(
        (5..=7).contains(&(after.0 - before.0)),
        "{before:?} {after:?}"
    );
    assert_eq!(after.1 - before.1, after.0 - before.0);
}

#[test]
fn what_px4_would_never_come_to_is_refused_with_its_waypoint() {
    let mut rig = Rig::ready();
    let mut plan = legs();
    let loiter = UaLoiterWaypoint {
        waypoint_number: Some(8),
        ..UaLoiterWaypoint::default()
    };
    plan.extend([at(8, "PHOTO"), loiter.into()]);
    rig.send_plan(plan);
    assert_eq!(rig.carry_out(orders::load()), Some(AckType::Refused));
    assert!(
        rig.station()
            .has_alert("waypoint 8: an action (13006) after its loiter")
    );
    assert_eq!(rig.carry_out(at(8, "FLAPS 1")), Some(AckType::Refused));
    // It would set outputs 5 and 6 too.
    assert_eq!(rig.carry_out(at(8, "SERVO 2 1")), Some(AckType::Refused));
    assert!(rig.station().has_alert("outputs 5 and 6"));
    // On wings nothing stands still.
    let mut rig = Rig::ready_with(Setup {
        vehicles: vec![px4_sim::Config {
            airframe: Airframe::Plane,
            ..px4_sim::Config::default()
        }],
        vehicle_keys: "landing = { course_deg = 0 }\n",
        ..Setup::default()
    });
    let mut plan: Vec<Message> = vec![
        orders::route(7).into(),
        orders::waypoint(7, 8, 400.0, 0.0, 60.0).into(),
        orders::waypoint(8, 0, 900.0, 0.0, 60.0).into(),
    ];
    plan.push(at(7, "DELAY 5"));
    rig.send_plan(plan);
    assert_eq!(rig.carry_out(orders::load()), Some(AckType::Refused));
    assert!(
        rig.station().has_alert("DELAY (13006) on wings"),
        "{:?}",
        rig.station().alerts()
    );
}
