//! The bridge did not run for seconds: what it reads first is of before.

use super::*;

/// The bridge stands still for three seconds, and then reads a report of before.
fn stopped(world: &mut World, mode: Px4Mode) {
    let from = world.now.mono;
    world.advance(Duration::from_secs(3));
    world.vehicle.note_unread(from, world.now.mono);
    world.show_mode(mode);
    world.posts();
}

/// PX4 is in its failsafe for lost set points by then, and would leave it for set points as of before.
#[test]
fn steering_of_before_a_stop_of_the_bridge_waits_for_the_mode() {
    for shown in [Px4Mode::OFFBOARD, Px4Mode::RTL] {
        let (mut world, mut flight) = steered();
        stopped(&mut world, Px4Mode::OFFBOARD);
        let mut unnamed = turn_to(1.0);
        unnamed.select_flight_path_control_mode = None;
        for order in [unnamed, turn_to(1.0)] {
            let answers = command(&mut world, &mut flight, order);
            assert_eq!(answers, [AckType::Received, AckType::Refused]);
        }
        assert!(world.posts().is_empty() && world.commanded_modes().is_empty());
        let next = flight.poll_timeout();
        assert!(next > Some(world.now.mono), "polled in a busy loop");
        world.advance(Duration::from_secs(3));
        world.show_mode(shown);
        handle(&mut world, &mut flight, Input::Advance);
        let steered = shown == Px4Mode::OFFBOARD;
        assert_eq!(!world.posts().is_empty(), steered, "{}", shown.name());
    }
}

#[test]
fn a_steered_vehicle_that_is_released_after_a_stop_of_the_bridge_is_left_to_a_pilot() {
    for shown in [Px4Mode::OFFBOARD, Px4Mode::POSCTL] {
        let (mut world, mut flight) = steered();
        stopped(&mut world, Px4Mode::OFFBOARD);
        world.commanded_modes();
        world.controller = None;
        handle(&mut world, &mut flight, Input::ControlChanged);
        handle(&mut world, &mut flight, Input::Advance);
        assert_eq!(world.commanded_modes(), [], "until it has shown its mode");
        world.advance(Duration::from_secs(3));
        world.show_mode(shown);
        handle(&mut world, &mut flight, Input::WatchLossAction);
        handle(&mut world, &mut flight, Input::Advance);
        let held = world.commanded_modes() == [Px4Mode::LOITER];
        assert_eq!(held, shown == Px4Mode::OFFBOARD, "{}", shown.name());
    }
}

#[test]
fn sticks_after_a_stop_of_the_bridge_wait_for_the_mode() {
    let (mut world, mut flight) = (World::airborne(Px4Mode::LOITER), Flight::default());
    command(&mut world, &mut flight, sticks());
    command(&mut world, &mut flight, select(Mode::FlightDirector));
    world.show_mode(Px4Mode::POSCTL);
    handle(&mut world, &mut flight, Input::Advance);
    stopped(&mut world, Px4Mode::POSCTL);
    command(&mut world, &mut flight, sticks());
    let answers = command(&mut world, &mut flight, select(Mode::FlightDirector));
    assert_eq!(answers, [AckType::Received, AckType::Refused]);
    assert!(world.posts().is_empty());
    world.advance(Duration::from_secs(3));
    world.show_mode(Px4Mode::POSCTL);
    command(&mut world, &mut flight, sticks());
    assert_eq!(world.posts().len(), 1);
}

/// A command that waited in a socket is part of the stream that it was sent in.
#[test]
fn no_station_has_paused_while_the_bridge_did_not_run() {
    for stands_still in [true, false] {
        let (mut world, mut flight) = held();
        world.show_mode(Px4Mode::POSCTL);
        let stopped = Duration::from_secs(60);
        world.advance(stopped);
        if stands_still {
            flight.note_stop(stopped);
        }
        let answers = command(&mut world, &mut flight, select(Mode::Loiter));
        assert_eq!(answers.contains(&AckType::Refused), stands_still);
    }
}

/// The reason may wait unread while the bridge does not run.
#[test]
fn a_refused_mode_awaits_its_reason_over_a_stop_of_the_bridge() {
    let (mut world, mut flight) = (World::airborne(Px4Mode::POSCTL), Flight::default());
    command(&mut world, &mut flight, select(Mode::Loiter));
    world.commanded_modes();
    for event in world.answer(MavCmd::MAV_CMD_DO_SET_MODE, DENIED) {
        handle(&mut world, &mut flight, Input::CommandEnded(&event));
    }
    let due = flight.poll_timeout().expect("the answer");
    let stopped = Duration::from_secs(60);
    world.advance(stopped);
    flight.postpone(stopped);
    assert_eq!(flight.poll_timeout(), Some(due + stopped));
    handle(&mut world, &mut flight, Input::Advance);
    assert_eq!(acknowledgements(&world.sent_to(0)), []);
    world.vehicle.complain(world.now.mono, REASON);
    handle(&mut world, &mut flight, Input::Advance);
    assert_eq!(acknowledgements(&world.sent_to(0)), [AckType::Refused]);
}
