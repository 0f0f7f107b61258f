//! A vehicle that returns with another plan is given the loaded one again, unless it flies; and whoever commands it
//! beside this VSM is reported.

use kit::bridge::{Rig, orders};
use mavlink_link::dialect::{MISSION_CLEAR_ALL_DATA, MavCmd, MavMessage, MavMissionType};
use mavlink_link::frame::{Header, INCOMPAT_SIGNED, MAX_FRAME, encode};
use mavlink_link::service::{Node, command};
use mavlink_link::signing::{self, SigningKey, Stamp};
use px4_sim::Mode as Px4;
use stanag_msgs::enums::FlightPathControlMode as Mode;

/// Another ground station, 255, that has the key too, and whose frames come in over the same link as ours.
fn foreign(rig: &mut Rig, message: &MavMessage) {
    let header = Header {
        incompat: INCOMPAT_SIGNED,
        system_id: 255,
        component_id: 190,
        ..Header::default()
    };
    let mut frame = [0; MAX_FRAME];
    let length = encode(message, header, &mut frame);
    let key = SigningKey::new([0x41; 32]).expect("the key of the rig");
    let stamp = Stamp::from_unix(rig.now().wall);
    let length = signing::sign(&key, 7, stamp, &mut frame, length).expect("it has room");
    let link = ([127, 0, 0, 1], 14_550).into();
    rig.vehicles[0].handle_datagram(0, link, &frame[..length]);
}

fn clear() -> MavMessage {
    MavMessage::MISSION_CLEAR_ALL(MISSION_CLEAR_ALL_DATA {
        target_system: 1,
        target_component: 1,
        mission_type: MavMissionType::MAV_MISSION_TYPE_MISSION,
    })
}

/// The link is lost; the plan aboard goes meanwhile; the vehicle comes back.
fn lose_the_plan(rig: &mut Rig) {
    rig.mav.faults.loss = 1.0;
    rig.run(5.0);
    foreign(rig, &clear());
    rig.run(0.5);
    rig.mav.faults.loss = 0.0;
}

fn loaded() -> Rig {
    let mut rig = Rig::ready();
    rig.send_plan(orders::square());
    rig.done(orders::load());
    rig
}

fn plans(rig: &Rig) -> u64 {
    rig.vehicles[0].vehicle().counters().plans_stored
}

#[test]
fn a_returned_vehicle_that_lost_the_plan_is_given_it_again() {
    let mut rig = loaded();
    let before = plans(&rig);
    lose_the_plan(&mut rig);
    assert!(
        rig.until(20.0, |rig| rig
            .station()
            .has_alert("the loaded plan is uploaded again")),
        "{:?}",
        rig.station().alerts()
    );
    assert!(rig.station().has_alert("the loaded one is sent again"));
    assert!(plans(&rig) > before);
    rig.take_off(20.0);
    rig.done(orders::mode(Mode::Waypoint));
}

#[test]
fn a_vehicle_that_restarted_without_its_plan_is_given_it_again() {
    let mut rig = loaded();
    rig.vehicles[0].restart();
    assert!(
        rig.until(40.0, |rig| rig
            .station()
            .has_alert("the loaded plan is uploaded again")),
        "{:?}",
        rig.station().alerts()
    );
}

#[test]
fn a_returned_vehicle_with_the_same_plan_is_left_alone() {
    let mut rig = loaded();
    let before = plans(&rig);
    rig.mav.faults.loss = 1.0;
    rig.run(5.0);
    rig.mav.faults.loss = 0.0;
    rig.run(10.0);
    assert!(rig.station().has_alert("link to the vehicle is up"));
    assert!(!rig.station().has_alert("another plan"));
    assert_eq!(plans(&rig), before);
}

#[test]
fn a_plan_that_another_station_has_changed_is_reported_and_left() {
    for flies in [false, true] {
        let mut rig = loaded();
        if flies {
            rig.take_off(20.0);
            rig.done(orders::mode(Mode::Waypoint));
        }
        rig.run(3.0);
        assert!(!rig.station().has_alert("another plan"), "{flies}");
        foreign(&mut rig, &clear());
        let before = plans(&rig);
        let said = rig.until(5.0, |rig| {
            rig.station().has_alert("another station has changed it")
        });
        assert!(said, "{flies}: {:?}", rig.station().alerts());
        rig.run(10.0);
        // Nor behind a gap of the link: it was changed on purpose.
        rig.mav.faults.loss = 1.0;
        rig.run(5.0);
        rig.mav.faults.loss = 0.0;
        rig.run(10.0);
        assert_eq!(plans(&rig), before, "{flies}: it is not sent again");
        // The station decides.
        if !flies {
            rig.done(orders::load());
            rig.run(3.0);
            assert!(plans(&rig) > before);
        }
    }
}

#[test]
fn a_plan_is_not_exchanged_under_a_vehicle_that_flies_its_mission() {
    let mut rig = loaded();
    // Another plan is put aboard by a restart of the VSM's memory of it: what it loaded is not what the vehicle has.
    rig.take_off(20.0);
    rig.done(orders::mode(Mode::Waypoint));
    assert!(rig.until(30.0, |rig| rig.truth().mission_seq >= 1));
    let name = "aboard-1b000101.json";
    let record = String::from_utf8(rig.store.records[name].clone()).expect("it is JSON");
    let id = record
        .split("\"mission_id\":")
        .nth(1)
        .and_then(|rest| rest.split(',').next());
    let other = record.replacen(id.expect("it has an id"), "305419896", 1);
    rig.store
        .records
        .insert(name.to_owned(), other.into_bytes());
    rig.restart_bridge();
    assert!(
        rig.until(10.0, |rig| rig.station().has_alert("load it again (13000)")),
        "{:?}",
        rig.station().alerts()
    );
    let before = plans(&rig);
    rig.mav.faults.loss = 1.0;
    rig.run(5.0);
    rig.mav.faults.loss = 0.0;
    assert!(
        rig.until(10.0, |rig| rig
            .station()
            .has_alert("once it leaves AUTO.MISSION")),
        "{:?}",
        rig.station().alerts()
    );
    rig.run(3.0);
    assert_eq!(rig.truth().mode, Px4::Mission, "it flies on");
    assert_eq!(plans(&rig), before);
}

#[test]
fn who_commands_the_vehicle_beside_this_vsm_is_reported() {
    let mut rig = Rig::ready();
    let command = command::long(Node::new(1, 1), MavCmd::MAV_CMD_DO_SET_HOME, [1.0]);
    foreign(&mut rig, &command);
    assert!(
        rig.until(3.0, |rig| {
            rig.station()
                .has_alert("MAVLink system 255 commands the vehicle too: command 179")
        }),
        "{:?}",
        rig.station().alerts()
    );
}
