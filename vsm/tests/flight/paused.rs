//! A bridge that is paused, as one is whose node's lease has ended: it answers no station and commands no vehicle, and the vehicles
//! keep a ground. Then it continues.

use kit::bridge::flight::hold_at;
use kit::bridge::{Rig, orders};
use px4_sim::Mode as Px4;
use stanag_msgs::enums::{AckType, FlightPathControlMode as Mode};

/// MAVLink ids.
const HEARTBEAT: u32 = 0;
const PING: u32 = 4;
const COMMAND_INT: u32 = 75;

fn pause(rig: &mut Rig, paused: bool) {
    let now = rig.clock.now().mono;
    let bridge = rig.bridge.as_mut().expect("it runs");
    bridge.pause(now, paused);
}

#[test]
fn a_paused_bridge_answers_no_station_and_only_keeps_the_link_to_its_vehicle() {
    let mut rig = Rig::ready();
    rig.take_off(20.0);
    rig.done(orders::mode(Mode::Loiter));
    pause(&mut rig, true);
    // What is on its way arrives.
    rig.run(1.0);
    rig.arrived.clear();
    let sent = rig.sent_to.clone();
    let ticket = rig.send(orders::mode(Mode::AutolandEngage));
    // Longer than PX4 flies on without a ground, COM_DL_LOSS_T.
    rig.run(20.0);
    assert_eq!(rig.sent_to, sent);
    let keeps = |id: &u32| [HEARTBEAT, PING].contains(id);
    assert!(rig.arrived.keys().all(keeps), "{:?}", rig.arrived);
    assert!(rig.arrived.get(&HEARTBEAT).is_some_and(|count| *count > 15));
    assert_eq!(rig.truth().mode, Px4::Loiter);
    assert_eq!(rig.station().end(ticket), None);
    rig.stations[0].give_up(ticket);
    // A repetition that is on its way would be new to it.
    rig.run(1.0);

    pause(&mut rig, false);
    rig.run(5.0);
    assert!(rig.sent_to != sent, "it reports again");
    assert_eq!(rig.truth().mode, Px4::Loiter, "nothing is made up for");
    rig.done(orders::mode(Mode::AutolandEngage));
    assert_eq!(rig.truth().mode, Px4::Land);
}

#[test]
fn what_was_commanded_before_a_pause_is_answered_behind_it() {
    let mut rig = Rig::ready();
    rig.take_off(20.0);
    rig.done(orders::mode(Mode::Loiter));
    rig.arrived.clear();
    let ticket = rig.send(hold_at(40.0));
    assert!(rig.until(5.0, |rig| rig.arrived.contains_key(&COMMAND_INT)));
    pause(&mut rig, true);
    rig.run(30.0);
    assert_eq!(rig.station().end(ticket), None);
    // No repetition: the answer has waited.
    rig.stations[0].give_up(ticket);
    let before = rig.station().answers(ticket).len();
    pause(&mut rig, false);
    rig.run(1.0);
    let answers = rig.station().answers(ticket);
    assert_eq!(answers.get(before..), Some(&[AckType::CarriedOut][..]));
}
