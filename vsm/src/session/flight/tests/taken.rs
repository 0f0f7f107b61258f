//! Who takes the vehicle out of a commanded mode keeps it from a station that repeats the command.

use stanag_msgs::enums::LoiterType;

use super::repeated::REPEATED_WITHIN;
use super::*;

const SECOND: Duration = Duration::from_secs(1);
const REFUSED: [AckType; 2] = [AckType::Received, AckType::Refused];

/// A 2016, and how it is answered at once; the vehicle is sent no mode.
fn refused(world: &mut World, flight: &mut Flight, commanded: Mode) -> bool {
    let answers = command(world, flight, select(commanded));
    answers == REFUSED && world.commanded_modes().is_empty()
}

#[test]
fn the_mode_is_not_entered_again_whoever_has_the_vehicle_before_a_pause_or_another_mode() {
    use MavState::{MAV_STATE_ACTIVE as ACTIVE, MAV_STATE_CRITICAL as CRITICAL};
    for (shown, status, landing) in [
        (Px4Mode::POSCTL, ACTIVE, false),
        (Px4Mode::RTL, CRITICAL, false),
        // Before it acts: the mode commanded once more would end it.
        (Px4Mode::LOITER, CRITICAL, false),
        // By switches of a remote control, or another station.
        (Px4Mode::RTL, ACTIVE, false),
        (Px4Mode::LOITER, ACTIVE, true),
    ] {
        for paused in [true, false] {
            let (mut world, mut flight) = held();
            let commanded = if landing {
                let land = Mode::AutolandEngage;
                enters(&mut world, &mut flight, land, Px4Mode::LAND);
                land
            } else {
                Mode::Loiter
            };
            world.vehicle.telemetry.system_status = Some(status);
            // Longer than the pause: each is part of the stream.
            for _ in 0..10 {
                world.advance(SECOND);
                world.show_mode(shown);
                assert!(refused(&mut world, &mut flight, commanded), "{shown:?}");
            }
            let (later, mode) = match (paused, landing) {
                (true, true) => (commanded, Px4Mode::LAND),
                (true, false) => (commanded, Px4Mode::LOITER),
                (false, _) => (Mode::ContingencyA, Px4Mode::RTL),
            };
            if paused {
                world.advance(REPEATED_WITHIN);
            }
            let answers = command(&mut world, &mut flight, select(later));
            assert_eq!(answers, [AckType::Received], "{shown:?} {paused}");
            assert_eq!(world.commanded_modes(), [mode], "{shown:?} {paused}");
        }
    }
}

#[test]
fn a_repetition_in_the_mode_is_answered_and_commands_nothing() {
    let (mut world, mut flight) = held();
    for _ in 0..10 {
        world.advance(SECOND);
        world.show_mode(Px4Mode::LOITER);
        let answers = command(&mut world, &mut flight, select(Mode::Loiter));
        assert_eq!(answers, [AckType::Received, AckType::CarriedOut]);
        assert_eq!(world.commanded_modes(), []);
    }
    // A loiter that was configured since is flown.
    let hover = LoiterConfiguration {
        loiter_type: Some(LoiterType::Hover),
        ..LoiterConfiguration::default()
    };
    let answers = command(&mut world, &mut flight, hover.clone());
    assert_eq!(answers, [AckType::CarriedOut]);
    command(&mut world, &mut flight, select(Mode::Loiter));
    assert_eq!(world.commanded_modes(), [Px4Mode::LOITER]);
    world.show_mode(Px4Mode::LOITER);
    let answers = answer_mode(&mut world, &mut flight, ACCEPTED);
    assert_eq!(answers, [AckType::CarriedOut]);
    // A station that repeats the mode repeats its configuration too.
    let answers = command(&mut world, &mut flight, hover);
    assert_eq!(answers, [AckType::CarriedOut]);
    let answers = command(&mut world, &mut flight, select(Mode::Loiter));
    assert_eq!(answers, [AckType::Received, AckType::CarriedOut]);
    assert_eq!(world.commanded_modes(), []);
}

/// An operator who sees the vehicle leave it presses at once, and more than once.
#[test]
fn a_hold_a_return_and_a_landing_are_carried_out_again_where_the_vehicle_flies_on() {
    use MavState::{MAV_STATE_ACTIVE as ACTIVE, MAV_STATE_CRITICAL as CRITICAL};
    for (commanded, mode) in [
        (Mode::Loiter, Px4Mode::LOITER),
        (Mode::ContingencyA, Px4Mode::RTL),
        (Mode::ContingencyB, Px4Mode::LAND),
        (Mode::AutolandEngage, Px4Mode::LAND),
    ] {
        // By switches of a remote control, or another station.
        for (left_for, status) in [
            (Px4Mode::MISSION, ACTIVE),
            (Px4Mode::OFFBOARD, ACTIVE),
            (Px4Mode::MISSION, CRITICAL),
        ] {
            let (mut world, mut flight) = (World::airborne(Px4Mode::MISSION), Flight::default());
            enters(&mut world, &mut flight, commanded, mode);
            world.vehicle.telemetry.system_status = Some(status);
            for _ in 0..3 {
                world.advance(SECOND);
                world.show_mode(left_for);
                for sent in [&[mode][..], &[]] {
                    let answers = command(&mut world, &mut flight, select(commanded));
                    assert_eq!(answers, [AckType::Received], "{commanded} {status:?}");
                    assert_eq!(world.commanded_modes(), sent, "{commanded} {status:?}");
                }
                world.show_mode(mode);
                let answers = answer_mode(&mut world, &mut flight, ACCEPTED);
                assert_eq!(answers, [AckType::CarriedOut; 2], "{commanded} {status:?}");
            }
        }
    }
}

/// PX4 shows AUTO.LOITER as it disarms, and its motors after that.
#[test]
fn a_landing_and_a_return_that_have_ended_on_the_ground_are_not_begun_again() {
    for (commanded, mode) in [
        (Mode::AutolandEngage, Px4Mode::LAND),
        (Mode::ContingencyA, Px4Mode::RTL),
        (Mode::ContingencyB, Px4Mode::LAND),
    ] {
        let (mut world, mut flight) = held();
        enters(&mut world, &mut flight, commanded, mode);
        world.vehicle.telemetry.landed = Some(LandedState::OnGround);
        for (shown, armed) in [
            (mode, true),
            (Px4Mode::LOITER, true),
            (Px4Mode::LOITER, false),
            (Px4Mode::LOITER, false),
        ] {
            world.advance(SECOND);
            world.show_mode(shown);
            world.vehicle.telemetry.armed = Some(armed);
            let answers = command(&mut world, &mut flight, select(commanded));
            let expected = [AckType::Received, AckType::CarriedOut];
            assert_eq!(answers, expected, "{commanded} {shown:?} {armed}");
            assert_eq!(world.commanded_modes(), [], "{commanded} {shown:?} {armed}");
        }
    }
}

/// Its time has come just after the hold.
#[test]
fn a_hold_that_is_commanded_again_ends_a_held_command_to_fly_on() {
    let (mut world, mut flight) = held();
    let order = turn_to(0.0);
    let message = Message::from(order.clone());
    let later = context::HeldOrigin {
        serial: 1,
        contingency: false,
    };
    let origin = Origin {
        held: Some(later),
        ..origin(&message)
    };
    let input = Input::Fly {
        origin: Some(origin),
        command: &order,
        just_loaded: false,
    };
    handle(&mut world, &mut flight, input);
    handle(&mut world, &mut flight, Input::Advance);
    assert_eq!(world.commanded_modes(), [Px4Mode::OFFBOARD]);
    for stops in [true, false] {
        let answers = command(&mut world, &mut flight, select(Mode::Loiter));
        assert!(!answers.contains(&AckType::Refused), "{answers:?}");
        // DO_REPOSITION enters AUTO.LOITER, and ends what that mode flew to before.
        let sent = world.services.commands.poll_transmit();
        let is_stop = |message: &MavMessage| matches!(message, MavMessage::COMMAND_INT(one) if one.command == MavCmd::MAV_CMD_DO_REPOSITION);
        assert_eq!(sent.as_ref().is_some_and(is_stop), stops, "{sent:?}");
    }
}

#[test]
fn what_is_being_entered_is_commanded_once_and_given_up_for_a_pilot_who_comes_meanwhile() {
    for (before, taken) in [
        (Px4Mode::MISSION, false),
        (Px4Mode::MISSION, true),
        // The operator takes it from the pilot.
        (Px4Mode::POSCTL, false),
    ] {
        let (mut world, mut flight) = (World::airborne(before), Flight::default());
        command(&mut world, &mut flight, select(Mode::Loiter));
        assert_eq!(world.commanded_modes(), [Px4Mode::LOITER]);
        for _ in 0..3 {
            world.advance(SECOND / 10);
            if taken {
                world.show_mode(Px4Mode::POSCTL);
            }
            let answers = command(&mut world, &mut flight, select(Mode::Loiter));
            let expected = if taken { &REFUSED[..] } else { &REFUSED[..1] };
            assert_eq!(answers, expected);
            assert_eq!(world.commanded_modes(), []);
        }
        if !taken {
            world.show_mode(Px4Mode::LOITER);
            let answers = answer_mode(&mut world, &mut flight, ACCEPTED);
            assert_eq!(answers, [AckType::CarriedOut; 4], "together");
        }
    }
}

#[test]
fn a_stream_of_steering_does_not_lead_back_to_its_mode_whatever_its_values() {
    let (mut world, mut flight) = steered();
    world.posts();
    for tenth in 0..80 {
        world.advance(SECOND / 10);
        world.show_mode(Px4Mode::POSCTL);
        let order = turn_to(f64::from(tenth) / 100.0);
        let answers = command(&mut world, &mut flight, order);
        assert_eq!(answers, REFUSED);
        assert_eq!((world.commanded_modes(), world.posts()), (vec![], vec![]));
    }
    world.advance(REPEATED_WITHIN);
    let answers = command(&mut world, &mut flight, turn_to(1.0));
    assert_eq!(answers, [AckType::Received]);
    assert_eq!(world.commanded_modes(), [Px4Mode::OFFBOARD]);
}

/// The hold of the mission watchdog, or of the altitude band.
#[test]
fn a_hold_of_the_vsm_is_not_ended_by_a_repetition() {
    let (mut world, mut flight) = held();
    let home = Mode::ContingencyA;
    enters(&mut world, &mut flight, home, Px4Mode::RTL);
    handle(&mut world, &mut flight, Input::Hold);
    handle(&mut world, &mut flight, Input::Advance);
    assert_eq!(world.commanded_modes(), [Px4Mode::LOITER]);
    assert!(refused(&mut world, &mut flight, home), "not shown yet");
    world.show_mode(Px4Mode::LOITER);
    answer_mode(&mut world, &mut flight, ACCEPTED);
    assert!(!flight.view().maneuver);
    world.advance(SECOND);
    assert!(refused(&mut world, &mut flight, home));
}

/// The station may have sent its command to the process before, and repeats it.
#[test]
fn a_stream_that_continues_over_a_restart_takes_the_vehicle_from_no_pilot() {
    for (since_start, shown, held_back) in [
        (2, Px4Mode::POSCTL, true),
        (2, Px4Mode::MISSION, false),
        (6, Px4Mode::POSCTL, false),
    ] {
        let (mut world, mut flight) = (World::airborne(shown), Flight::default());
        let restored = world.act(|_, _, effects| flight.restore(effects));
        assert_eq!(restored, Ok(()));
        world.advance(SECOND * since_start);
        world.show_mode(shown);
        let times = if held_back { 10 } else { 1 };
        for _ in 0..times {
            let refused = refused(&mut world, &mut flight, Mode::Loiter);
            assert_eq!(refused, held_back, "{since_start} {shown:?}");
            world.advance(SECOND);
            world.show_mode(shown);
        }
    }
}

/// A link that is lost for longer than the pause, and the failsafe that PX4 flies for it.
#[test]
fn no_station_pauses_by_a_silence_of_the_vehicle() {
    let (mut world, mut flight) = held();
    world.vehicle.set_silent();
    for _ in 0..10 {
        world.advance(SECOND);
        assert!(refused(&mut world, &mut flight, Mode::Loiter));
    }
    world.vehicle.set_live();
    world.show_mode(Px4Mode::RTL);
    assert!(refused(&mut world, &mut flight, Mode::Loiter));
}

#[test]
fn the_command_of_another_station_is_a_new_one() {
    let (mut world, mut flight) = held();
    world.show_mode(Px4Mode::POSCTL);
    assert!(refused(&mut world, &mut flight, Mode::Loiter));
    let message = select(Mode::Loiter).into();
    let origin = Origin {
        station: 1,
        ..origin(&message)
    };
    let message = &message;
    handle(&mut world, &mut flight, Input::Command { origin, message });
    handle(&mut world, &mut flight, Input::Advance);
    assert_eq!(world.commanded_modes(), [Px4Mode::LOITER]);
}
