//! Manual flight by sticks (2010), and how it ends.

use mapping::telemetry::{Health, Orbit};

use super::*;
use crate::session::other::Other;

#[test]
fn sticks_stream_before_manual_flight_and_end_once_it_is_refused() {
    let (mut world, mut flight) = (World::airborne(Px4Mode::LOITER), Flight::default());
    let manual = || select(Mode::FlightDirector);
    let answers = command(&mut world, &mut flight, manual());
    assert_eq!(answers, [AckType::Received, AckType::Refused], "no sticks");
    assert_eq!(
        command(&mut world, &mut flight, sticks()),
        [AckType::CarriedOut]
    );
    assert!(
        world.posts().is_empty(),
        "PX4 breaks off a mission when sticks move"
    );
    command(&mut world, &mut flight, manual());
    assert_eq!(world.posts().len(), 1);
    assert_eq!(
        world.commanded_modes(),
        [],
        "PX4 must have seen sticks first"
    );
    world.advance(SEEN_WITHIN);
    command(&mut world, &mut flight, sticks());
    assert_eq!(world.posts().len(), 1);
    assert_eq!(world.commanded_modes(), [Px4Mode::POSCTL]);
    let answers = answer_mode(&mut world, &mut flight, DENIED);
    assert_eq!(answers, [AckType::Refused]);
    // Those that move would take the vehicle: the last once more, and no others.
    for posts in [1, 0, 0] {
        world.advance(Duration::from_millis(50));
        command(&mut world, &mut flight, sticks());
        assert_eq!(world.posts().len(), posts);
    }
}

/// PX4 has been sent sticks before it refuses their mode, and would leave the mode that it flies for their loss.
#[test]
fn a_vehicle_that_refuses_mode_2_stays_in_the_mode_that_it_flew() {
    use MavState::{MAV_STATE_ACTIVE as ACTIVE, MAV_STATE_CRITICAL as CRITICAL};
    for (flown, shown, status, repeats) in [
        (Px4Mode::LOITER, Px4Mode::LOITER, CRITICAL, true),
        (Px4Mode::MISSION, Px4Mode::LOITER, CRITICAL, true),
        // COM_FAIL_ACT_T is 0.
        (Px4Mode::MISSION, Px4Mode::RTL, CRITICAL, true),
        (Px4Mode::OFFBOARD, Px4Mode::LOITER, CRITICAL, true),
        (Px4Mode::LAND, Px4Mode::LOITER, CRITICAL, true),
        // By switches of a remote control.
        (Px4Mode::MISSION, Px4Mode::RTL, ACTIVE, false),
        (Px4Mode::MISSION, Px4Mode::POSCTL, ACTIVE, false),
    ] {
        let (mut world, mut flight) = if flown == Px4Mode::OFFBOARD {
            steered()
        } else {
            (World::airborne(flown), Flight::default())
        };
        command(&mut world, &mut flight, sticks());
        command(&mut world, &mut flight, select(Mode::FlightDirector));
        world.advance(SEEN_WITHIN);
        command(&mut world, &mut flight, sticks());
        assert_eq!(world.commanded_modes(), [Px4Mode::POSCTL]);
        let answers = answer_mode(&mut world, &mut flight, DENIED);
        assert_eq!(answers, [AckType::Refused]);
        world.advance(Duration::from_millis(500));
        handle(&mut world, &mut flight, Input::Advance);
        assert_eq!(world.commanded_modes(), [], "not missed yet");
        world.advance(Duration::from_millis(600));
        world.vehicle.telemetry.system_status = Some(status);
        world.show_mode(shown);
        world.posts();
        handle(&mut world, &mut flight, Input::ModeChanged);
        handle(&mut world, &mut flight, Input::Advance);
        if !repeats {
            assert_eq!(world.commanded_modes(), [], "{shown:?}");
            continue;
        }
        assert_eq!(world.commanded_modes(), [flown]);
        let set_points = usize::from(flown == Px4Mode::OFFBOARD);
        assert_eq!(world.posts().len(), set_points, "{flown:?}");
        world.show_mode(flown);
        let answers = answer_mode(&mut world, &mut flight, ACCEPTED);
        assert_eq!(answers, [], "nobody waits for it");
        assert!(!flight.view().maneuver, "{flown:?}");
    }
}

/// Its mode has no number that would be enough.
#[test]
fn a_vehicle_that_refuses_mode_2_on_its_circle_is_sent_back_to_that() {
    let (mut world, mut flight) = (World::airborne(Px4Mode::ORBIT), Flight::default());
    world.vehicle.telemetry.orbit = Some(Orbit {
        centre: world.vehicle.telemetry.position.expect("a place"),
        radius_m: -40.0,
    });
    command(&mut world, &mut flight, sticks());
    command(&mut world, &mut flight, select(Mode::FlightDirector));
    world.advance(SEEN_WITHIN);
    command(&mut world, &mut flight, sticks());
    world.commanded_modes();
    answer_mode(&mut world, &mut flight, DENIED);
    world.advance(Duration::from_millis(1_100));
    world.vehicle.telemetry.system_status = Some(MavState::MAV_STATE_CRITICAL);
    world.show_mode(Px4Mode::LOITER);
    handle(&mut world, &mut flight, Input::Advance);
    let sent = world.services.commands.poll_transmit();
    let Some(MavMessage::COMMAND_INT(circle)) = sent else {
        panic!("a circle, not {sent:?}");
    };
    let expected = (MavCmd::MAV_CMD_DO_ORBIT, -40.0);
    assert_eq!((circle.command, circle.param1), expected);
}

/// In POSCTL by the sticks of station 0.
fn by_hand() -> (World, Flight) {
    let (mut world, mut flight) = (World::airborne(Px4Mode::LOITER), Flight::default());
    command(&mut world, &mut flight, sticks());
    command(&mut world, &mut flight, select(Mode::FlightDirector));
    world.advance(SEEN_WITHIN);
    command(&mut world, &mut flight, sticks());
    assert_eq!(world.commanded_modes(), [Px4Mode::POSCTL]);
    world.show_mode(Px4Mode::POSCTL);
    let answers = answer_mode(&mut world, &mut flight, ACCEPTED);
    assert_eq!(answers, [AckType::CarriedOut]);
    world.posts();
    (world, flight)
}

#[test]
fn a_mode_that_ends_the_sticks_is_commanded_again_once_they_are_missed_but_not_over_a_pilot() {
    use MavState::{MAV_STATE_ACTIVE as ACTIVE, MAV_STATE_CRITICAL as CRITICAL};
    let missed = Duration::from_millis(1_100);
    for (shown, status, repeats) in [
        (Px4Mode::LOITER, ACTIVE, true),
        // COM_FAIL_ACT_T is 0.
        (Px4Mode::RTL, CRITICAL, true),
        // By switches of a remote control.
        (Px4Mode::RTL, ACTIVE, false),
        (Px4Mode::LAND, ACTIVE, false),
        (Px4Mode::POSCTL, ACTIVE, false),
    ] {
        let (mut world, mut flight) = by_hand();
        let answers = command(&mut world, &mut flight, select(Mode::Loiter));
        assert_eq!(answers, [AckType::Received]);
        assert_eq!(world.commanded_modes(), [Px4Mode::LOITER]);
        world.posts();
        assert_eq!(answer_mode(&mut world, &mut flight, ACCEPTED), []);
        // Sticks that move would take it back: the last once more, and no others.
        for posts in [1, 0, 0] {
            world.advance(Duration::from_millis(50));
            command(&mut world, &mut flight, sticks());
            assert_eq!(world.posts().len(), posts);
        }
        world.show_mode(Px4Mode::LOITER);
        handle(&mut world, &mut flight, Input::Advance);
        let early = acknowledgements(&world.sent_to(0));
        assert_eq!(early, [], "the failsafe is still to come");
        world.advance(missed);
        world.vehicle.telemetry.system_status = Some(status);
        world.show_mode(shown);
        handle(&mut world, &mut flight, Input::Advance);
        let again = world.commanded_modes();
        if !repeats {
            assert_eq!(again, [], "{shown:?}");
            continue;
        }
        assert_eq!(again, [Px4Mode::LOITER]);
        world.show_mode(Px4Mode::LOITER);
        let answers = answer_mode(&mut world, &mut flight, ACCEPTED);
        assert_eq!(answers, [AckType::CarriedOut]);
        // PX4 does not miss them any longer: the next mode is commanded once.
        command(&mut world, &mut flight, select(Mode::ContingencyA));
        assert_eq!(world.commanded_modes(), [Px4Mode::RTL]);
        world.show_mode(Px4Mode::RTL);
        let answers = answer_mode(&mut world, &mut flight, ACCEPTED);
        assert_eq!(answers, [AckType::CarriedOut]);
    }
}

/// A 2010 whose acknowledgement is read with the alerts.
fn send_sticks(world: &mut World, flight: &mut Flight) {
    let message = sticks().into();
    let origin = origin(&message);
    let message = &message;
    handle(world, flight, Input::Command { origin, message });
    handle(world, flight, Input::Advance);
}

/// PX4 would miss the sticks in its failsafe too, and leave that for what their loss is to do.
#[test]
fn centred_sticks_come_while_a_failsafe_has_left_the_mode_and_not_while_a_pilot_has() {
    use MavState::{MAV_STATE_ACTIVE as ACTIVE, MAV_STATE_CRITICAL as CRITICAL};
    for (shown, status, continues) in [
        (Px4Mode::LOITER, CRITICAL, true),
        (Px4Mode::RTL, CRITICAL, true),
        (Px4Mode::LOITER, ACTIVE, false),
        (Px4Mode::RTL, ACTIVE, false),
        // ALTCTL: the vehicle would drift.
        (Px4Mode::new(2, 0), CRITICAL, false),
    ] {
        let (mut world, mut flight) = by_hand();
        world.sent_to(0);
        world.vehicle.telemetry.system_status = Some(status);
        world.show_mode(shown);
        let mut sent = Vec::new();
        for _ in 0..10 {
            world.advance(Duration::from_millis(50));
            send_sticks(&mut world, &mut flight);
            sent.extend(world.posts());
        }
        assert_eq!(sent.len(), if continues { 10 } else { 0 }, "{shown:?}");
        assert_eq!(
            alerts_of(&mut world, "do not steer"),
            usize::from(continues)
        );
        let Some(MavMessage::MANUAL_CONTROL(last)) = sent.last() else {
            continue;
        };
        assert_eq!([last.x, last.y, last.z, last.r], [0, 0, 500, 0]);

        // Another mode ends them at once, whatever the vehicle shows of its failsafe, unless it is refused.
        for refused in [true, false] {
            command(&mut world, &mut flight, select(Mode::AutolandEngage));
            assert_eq!(world.commanded_modes(), [Px4Mode::LAND]);
            world.posts();
            world.advance(Duration::from_millis(50));
            command(&mut world, &mut flight, sticks());
            assert!(world.posts().is_empty());
            if refused {
                answer_mode(&mut world, &mut flight, DENIED);
                // PX4's reason may still come.
                world.advance(Duration::from_millis(50));
                command(&mut world, &mut flight, sticks());
                assert_eq!(world.posts().len(), 1);
            }
        }
        assert_eq!(answer_mode(&mut world, &mut flight, ACCEPTED), []);
        world.show_mode(Px4Mode::LAND);
        for missed in [false, true] {
            for _ in 0..25 {
                world.advance(Duration::from_millis(50));
                command(&mut world, &mut flight, sticks());
                assert!(world.posts().is_empty());
            }
            if !missed {
                assert_eq!(world.commanded_modes(), [Px4Mode::LAND]);
                world.show_mode(Px4Mode::LAND);
                let answers = answer_mode(&mut world, &mut flight, ACCEPTED);
                assert_eq!(answers, [AckType::CarriedOut]);
            }
        }
    }
}

/// PX4 has seen sticks before it refuses their mode, and would leave its failsafe for want of them.
#[test]
fn centred_sticks_follow_a_mode_2_that_is_refused_while_a_failsafe_holds() {
    let failsafe = |world: &mut World| {
        world.vehicle.telemetry.system_status = Some(MavState::MAV_STATE_CRITICAL);
        world.show_mode(Px4Mode::LOITER);
    };
    for was_flown in [true, false] {
        let (mut world, mut flight) = if was_flown {
            by_hand()
        } else {
            (World::airborne(Px4Mode::MISSION), Flight::default())
        };
        if was_flown {
            // Mode 2 is a new command by then.
            for _ in 0..60 {
                world.advance(Duration::from_millis(100));
                command(&mut world, &mut flight, sticks());
            }
            world.posts();
        }
        failsafe(&mut world);
        command(&mut world, &mut flight, sticks());
        for (attempt, superseded) in [false, true, false].into_iter().enumerate() {
            command(&mut world, &mut flight, select(Mode::FlightDirector));
            world.advance(SEEN_WITHIN);
            command(&mut world, &mut flight, sticks());
            assert_eq!(world.commanded_modes(), [Px4Mode::POSCTL]);
            if superseded {
                // By a mode that is refused, too.
                command(&mut world, &mut flight, select(Mode::AutolandEngage));
                answer_mode(&mut world, &mut flight, ACCEPTED);
                assert_eq!(world.commanded_modes().pop(), Some(Px4Mode::LAND));
            }
            world.vehicle.complain(world.now.mono, REASON);
            for event in world.answer(MavCmd::MAV_CMD_DO_SET_MODE, DENIED) {
                handle(&mut world, &mut flight, Input::CommandEnded(&event));
            }
            handle(&mut world, &mut flight, Input::Advance);
            let named = alerts_of(&mut world, "do not steer");
            if attempt == 0 {
                // Not the same text again within two seconds.
                assert_eq!(named, usize::from(!was_flown));
            }
            world.posts();
            let mut sent = Vec::new();
            for _ in 0..5 {
                world.advance(Duration::from_millis(50));
                command(&mut world, &mut flight, sticks());
                sent.extend(world.posts());
            }
            assert_eq!(sent.len(), 5, "{was_flown} {attempt}");
            let Some(MavMessage::MANUAL_CONTROL(last)) = sent.last() else {
                panic!("sticks, not {sent:?}");
            };
            assert_eq!([last.x, last.y, last.z, last.r], [0, 0, 500, 0]);
        }
    }
}

/// PX4 takes one source of sticks at a time, and shows not who has chosen POSCTL.
#[test]
fn centred_sticks_end_where_a_pilot_may_have_the_vehicle_and_as_it_is_disarmed() {
    use MavState::{MAV_STATE_ACTIVE as ACTIVE, MAV_STATE_CRITICAL as CRITICAL};
    for (shown, status, armed) in [
        (Px4Mode::POSCTL, ACTIVE, true),
        (Px4Mode::POSCTL, ACTIVE, false),
        (Px4Mode::LOITER, CRITICAL, false),
    ] {
        let (mut world, mut flight) = by_hand();
        world.vehicle.telemetry.system_status = Some(CRITICAL);
        world.show_mode(Px4Mode::LOITER);
        world.advance(Duration::from_millis(50));
        command(&mut world, &mut flight, sticks());
        assert_eq!(world.posts().len(), 1);
        world.vehicle.telemetry.system_status = Some(status);
        world.vehicle.telemetry.armed = Some(armed);
        world.show_mode(shown);
        for first in [true, false] {
            world.advance(Duration::from_millis(50));
            send_sticks(&mut world, &mut flight);
            assert_eq!(world.posts(), [], "{shown:?} {armed}");
            let warned = alerts_of(&mut world, "is in POSCTL again");
            assert_eq!(warned, usize::from(first && armed), "{shown:?}");
        }
    }
}

/// The VSM was killed while the vehicle was flown by sticks, which PX4 may not miss yet.
#[test]
fn a_mode_that_follows_the_sticks_of_a_process_before_is_commanded_again_once_they_are_missed() {
    for (found, repeats) in [(Px4Mode::POSCTL, true), (Px4Mode::MISSION, false)] {
        let (mut world, mut flight) = (World::airborne(found), Flight::default());
        handle(&mut world, &mut flight, Input::Advance);
        command(&mut world, &mut flight, select(Mode::Loiter));
        assert_eq!(world.commanded_modes(), [Px4Mode::LOITER]);
        assert_eq!(answer_mode(&mut world, &mut flight, ACCEPTED), []);
        world.show_mode(Px4Mode::LOITER);
        handle(&mut world, &mut flight, Input::Advance);
        let answers = acknowledgements(&world.sent_to(0));
        assert_eq!(answers.is_empty(), repeats, "{answers:?}");
        world.advance(Duration::from_millis(1_100));
        world.vehicle.telemetry.system_status = Some(MavState::MAV_STATE_CRITICAL);
        world.show_mode(Px4Mode::LOITER);
        handle(&mut world, &mut flight, Input::Advance);
        let again = world.commanded_modes() == [Px4Mode::LOITER];
        assert_eq!(again, repeats, "{}", found.name());
    }
}

#[test]
fn the_last_sticks_stand_still_where_a_termination_ends_them() {
    let (mut world, mut flight) = by_hand();
    world.advance(Duration::from_millis(5));
    handle(&mut world, &mut flight, Input::YieldToTermination);
    assert_eq!(world.posts().len(), 1);
    world.advance(Duration::from_millis(100));
    command(&mut world, &mut flight, sticks());
    assert!(world.posts().is_empty());
}

#[test]
fn sticks_fly_on_where_the_mode_that_was_to_end_them_is_refused() {
    let (mut world, mut flight) = by_hand();
    command(&mut world, &mut flight, select(Mode::Loiter));
    assert_eq!(world.commanded_modes(), [Px4Mode::LOITER]);
    let answers = answer_mode(&mut world, &mut flight, DENIED);
    assert_eq!(answers, [AckType::Refused]);
    world.posts();
    world.advance(Duration::from_millis(100));
    command(&mut world, &mut flight, sticks());
    assert_eq!(world.posts().len(), 1);
}

#[test]
fn manual_flight_is_refused_where_the_vehicle_ignores_sticks() {
    const TAKEN: &[AckType] = &[AckType::Received];
    const REFUSED: &[AckType] = &[AckType::Received, AckType::Refused];
    for (source, expected) in [(0.0, REFUSED), (4.0, REFUSED), (1.0, TAKEN)] {
        let (mut world, mut flight) = (World::airborne(Px4Mode::LOITER), Flight::default());
        world.parameters.set("COM_RC_IN_MODE", source);
        command(&mut world, &mut flight, sticks());
        let answers = command(&mut world, &mut flight, select(Mode::FlightDirector));
        assert_eq!(answers, expected, "{source}");
        let streams = !world.posts().is_empty();
        assert_eq!(streams, expected == TAKEN, "{source}");
    }
}

#[test]
fn sticks_that_come_are_not_taken_for_a_pilots() {
    let (mut world, mut flight) = (World::airborne(Px4Mode::LOITER), Flight::default());
    command(&mut world, &mut flight, sticks());
    command(&mut world, &mut flight, select(Mode::FlightDirector));
    world.show_mode(Px4Mode::POSCTL);
    handle(&mut world, &mut flight, Input::Advance);
    let now = |world: &World| world.now.mono;
    assert_eq!(flight.other(&world.vehicle, now(&world)), None);
    world.advance(Duration::from_secs(1));
    handle(&mut world, &mut flight, Input::Advance);
    assert_eq!(flight.other(&world.vehicle, now(&world)), None);
    // PX4 would have left the mode by now: somebody else's sticks fly it.
    world.advance(Duration::from_secs(3));
    handle(&mut world, &mut flight, Input::Advance);
    let pilot = Some(Other::Pilot(Px4Mode::POSCTL));
    assert_eq!(flight.other(&world.vehicle, now(&world)), pilot);
}

/// A safety pilot's remote control is on.
#[test]
fn manual_flight_is_refused_where_the_vehicle_has_other_sticks_that_go_first() {
    const REMOTE_CONTROL: u32 = 0x1_0000;
    let health = |healthy| {
        Some(Health {
            enabled: REMOTE_CONTROL,
            healthy,
        })
    };
    for (source, health, refused) in [
        (Some(5.0), health(REMOTE_CONTROL), true),
        (Some(2.0), health(REMOTE_CONTROL), true),
        (Some(6.0), health(REMOTE_CONTROL), false),
        (None, health(REMOTE_CONTROL), false),
        // It misses one.
        (Some(5.0), health(0), false),
        (Some(5.0), None, false),
    ] {
        let (mut world, mut flight) = (World::airborne(Px4Mode::LOITER), Flight::default());
        if let Some(source) = source {
            world.parameters.set("COM_RC_IN_MODE", source);
        }
        world.vehicle.telemetry.sensed.health = health;
        command(&mut world, &mut flight, sticks());
        let answers = command(&mut world, &mut flight, select(Mode::FlightDirector));
        assert_eq!(answers.contains(&AckType::Refused), refused, "{source:?}");
        assert_eq!(world.posts().is_empty(), refused, "{source:?}");
    }
    // Those that it has are these.
    let (mut world, mut flight) = by_hand();
    world.parameters.set("COM_RC_IN_MODE", 2.0);
    world.vehicle.telemetry.sensed.health = health(REMOTE_CONTROL);
    let answers = command(&mut world, &mut flight, select(Mode::FlightDirector));
    assert!(!answers.contains(&AckType::Refused), "{answers:?}");
    // PX4 counts them as there until it takes them for lost.
    for (lost_s, refused) in [(10.0, false), (0.5, true)] {
        let (mut world, mut flight) = by_hand();
        world.parameters.set("COM_RC_IN_MODE", 2.0);
        world.parameters.set("COM_RC_LOSS_T", lost_s);
        world.vehicle.telemetry.sensed.health = health(REMOTE_CONTROL);
        world.advance(Duration::from_secs(9));
        world.show_mode(Px4Mode::LOITER);
        command(&mut world, &mut flight, sticks());
        let answers = command(&mut world, &mut flight, select(Mode::FlightDirector));
        assert_eq!(answers.contains(&AckType::Refused), refused, "{lost_s} s");
    }
    // Or of a VSM that was killed: the vehicle is still in the mode.
    let mut restarted = Flight::default();
    handle(&mut world, &mut restarted, Input::Advance);
    command(&mut world, &mut restarted, sticks());
    let answers = command(&mut world, &mut restarted, select(Mode::FlightDirector));
    assert!(!answers.contains(&AckType::Refused), "{answers:?}");
}
