//! The machine without the others: commands go in, the vehicle's side is played by the test.

use mapping::plan::Plan;
use mapping::route::CompiledMission;
use mapping::telemetry::{Health, LandedState, MissionProgress, Orbit, Place};
use mavlink_link::dialect::{MavCmd, MavResult, MavState, MavType, MissionState};
use mavlink_link::service::mission::Item;
use stanag_msgs::enums::HeadingCommandType;
use stanag_msgs::messages::UaRoute;
use stanag_msgs::scalar::{Bam16, Scaled};
use stanag_msgs::{Id, TimeStamp};

use super::*;
use crate::config::OnLoss;
use crate::session::context::{Continues, HeldOrigin};
use crate::session::mission::record::UploadedMission;
use crate::session::other::Other;
use crate::session::testing::{World, acknowledgements, origin};

const ACCEPTED: MavResult = MavResult::MAV_RESULT_ACCEPTED;
const DENIED: MavResult = MavResult::MAV_RESULT_DENIED;
/// What the vehicle says with its answer.
const REASON: &str = "Switching to this mode is currently not available";

pub(super) fn handle(world: &mut World, flight: &mut Flight, input: Input<'_>) {
    world.act(|common, views, effects| {
        let context = Context {
            common,
            mission: views.mission,
            parameters: views.parameters,
        };
        flight.handle(&context, input, effects);
    });
}

/// A message of station 0, and what the machine does at once.
fn command(world: &mut World, flight: &mut Flight, message: impl Into<Message>) -> Vec<AckType> {
    let message = message.into();
    let input = Input::Command {
        origin: origin(&message),
        message: &message,
    };
    handle(world, flight, input);
    handle(world, flight, Input::Advance);
    acknowledgements(&world.sent_to(0))
}

/// The same of a #43 of these values, of Edition 2.5.
fn demand(world: &mut World, flight: &mut Flight, values: u64, heading: f64) -> Vec<AckType> {
    let message = turn_to(heading).into();
    let origin = Origin {
        continues: Some(Continues::Demand(values)),
        ..origin(&message)
    };
    let message = &message;
    handle(world, flight, Input::Command { origin, message });
    handle(world, flight, Input::Advance);
    acknowledgements(&world.sent_to(0))
}

/// A #42 of Edition 2.5 right after a #43.
fn mode_after_demand(
    world: &mut World,
    flight: &mut Flight,
    mode: Mode,
    continues: Option<Continues>,
) -> Vec<AckType> {
    let message = select(mode).into();
    let origin = Origin {
        continues,
        ..origin(&message)
    };
    let message = &message;
    handle(world, flight, Input::Command { origin, message });
    handle(world, flight, Input::Advance);
    acknowledgements(&world.sent_to(0))
}

/// The vehicle answers a change of mode.
fn answer_mode(world: &mut World, flight: &mut Flight, result: MavResult) -> Vec<AckType> {
    if result != ACCEPTED {
        world.vehicle.complain(world.now.mono, REASON);
    }
    for event in world.answer(MavCmd::MAV_CMD_DO_SET_MODE, result) {
        handle(world, flight, Input::CommandEnded(&event));
    }
    handle(world, flight, Input::Advance);
    acknowledgements(&world.sent_to(0))
}

fn steers(world: &World, flight: &Flight) -> bool {
    flight.steers(&world.vehicle.telemetry)
}

fn sticks() -> UaStickCommand {
    UaStickCommand {
        time_stamp: Some(TimeStamp(1)),
        longitudinal_stick: Some(50),
        ..UaStickCommand::default()
    }
}

fn turn_to(heading: f64) -> VehicleOperatingModeCommand {
    VehicleOperatingModeCommand {
        heading_command_type: Some(HeadingCommandType::Heading),
        commanded_heading: Some(Bam16::from_radians(heading)),
        ..select(Mode::Autopilot)
    }
}

/// Steered by set points, in the mode for that.
fn steered() -> (World, Flight) {
    let (mut world, mut flight) = (World::airborne(Px4Mode::LOITER), Flight::default());
    let answers = command(&mut world, &mut flight, turn_to(0.0));
    assert_eq!(answers, [AckType::Received]);
    assert_eq!(world.posts().len(), 1, "a set point before the mode");
    assert_eq!(world.commanded_modes(), [Px4Mode::OFFBOARD]);
    world.show_mode(Px4Mode::OFFBOARD);
    let answers = answer_mode(&mut world, &mut flight, ACCEPTED);
    assert_eq!(answers, [AckType::CarriedOut]);
    (world, flight)
}

#[test]
fn a_mode_is_carried_out_once_the_vehicle_shows_it_not_when_it_accepts_it() {
    let (mut world, mut flight) = (World::airborne(Px4Mode::POSCTL), Flight::default());
    let answers = command(&mut world, &mut flight, select(Mode::Loiter));
    assert_eq!(answers, [AckType::Received]);
    assert_eq!(world.commanded_modes(), [Px4Mode::LOITER]);
    assert_eq!(answer_mode(&mut world, &mut flight, ACCEPTED), []);
    assert!(flight.view().maneuver);
    world.show_mode(Px4Mode::LOITER);
    handle(&mut world, &mut flight, Input::Advance);
    assert_eq!(acknowledgements(&world.sent_to(0)), [AckType::CarriedOut]);
    assert!(!flight.view().maneuver && flight.poll_timeout().is_none());
}

#[test]
fn a_mode_supersedes_the_demand_before_it_unless_it_has_its_values() {
    for (continues, at_once, at_the_end) in [
        (None, &[AckType::Received, AckType::Refused][..], 1),
        (Some(Continues::ModeOfDemand), &[AckType::Received], 2),
    ] {
        let (mut world, mut flight) = (World::airborne(Px4Mode::LOITER), Flight::default());
        assert_eq!(demand(&mut world, &mut flight, 1, 0.5), [AckType::Received]);
        assert_eq!(world.commanded_modes(), [Px4Mode::OFFBOARD]);
        let land = Mode::AutolandEngage;
        let answers = mode_after_demand(&mut world, &mut flight, land, continues);
        assert_eq!(answers, at_once, "{continues:?}");
        assert_eq!(answer_mode(&mut world, &mut flight, ACCEPTED), []);
        world.show_mode(Px4Mode::LAND);
        assert_eq!(world.commanded_modes().pop(), Some(Px4Mode::LAND));
        let answers = answer_mode(&mut world, &mut flight, ACCEPTED);
        assert_eq!(answers, vec![AckType::CarriedOut; at_the_end]);
        // Where what is in progress is no demand, it is superseded in either case.
        let (mut world, mut flight) = (World::airborne(Px4Mode::POSCTL), Flight::default());
        command(&mut world, &mut flight, select(Mode::Loiter));
        let answers = mode_after_demand(&mut world, &mut flight, land, continues);
        assert_eq!(answers, [AckType::Received, AckType::Refused]);
    }
}

#[test]
fn a_later_command_supersedes_the_one_in_progress() {
    let (mut world, mut flight) = (World::airborne(Px4Mode::MISSION), Flight::default());
    command(&mut world, &mut flight, select(Mode::Loiter));
    assert_eq!(world.commanded_modes(), [Px4Mode::LOITER]);
    let answers = command(&mut world, &mut flight, select(Mode::AutolandEngage));
    assert_eq!(answers, [AckType::Received, AckType::Refused]);
    let answers = answer_mode(&mut world, &mut flight, ACCEPTED);
    assert_eq!(answers, [], "an answer to the first is none to the second");
    world.show_mode(Px4Mode::LAND);
    let mut sent = world.commanded_modes();
    assert_eq!(sent.pop(), Some(Px4Mode::LAND));
    let answers = answer_mode(&mut world, &mut flight, ACCEPTED);
    assert_eq!(answers, [AckType::CarriedOut]);
}

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

/// How many alerts with this in their first part station 0 was sent.
fn alerts_of(world: &mut World, what: &str) -> usize {
    let says_so = |message: &&Message| match message {
        Message::SubsystemStatusAlert(alert) => {
            let text = alert.text.as_ref().map(|text| text.as_str());
            text.is_some_and(|text| text.contains(what))
        }
        _ => false,
    };
    world.sent_to(0).iter().filter(says_so).count()
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
    // Or of a VSM that was killed: the vehicle is still in the mode.
    let mut restarted = Flight::default();
    handle(&mut world, &mut restarted, Input::Advance);
    command(&mut world, &mut restarted, sticks());
    let answers = command(&mut world, &mut restarted, select(Mode::FlightDirector));
    assert!(!answers.contains(&AckType::Refused), "{answers:?}");
}

#[test]
fn within_its_mode_steering_changes_set_points_alone() {
    let (mut world, mut flight) = steered();
    world.posts();
    world.advance(Duration::from_millis(50));
    let answers = command(&mut world, &mut flight, turn_to(1.0));
    assert_eq!(answers, [AckType::Received, AckType::CarriedOut]);
    assert_eq!(world.commanded_modes(), []);
    let posts = world.posts();
    let [MavMessage::SET_POSITION_TARGET_LOCAL_NED(set_point)] = posts.as_slice() else {
        panic!("one set point, not {posts:?}");
    };
    assert!((set_point.yaw - 1.0).abs() < 1e-3, "{}", set_point.yaw);
}

#[test]
fn set_points_end_when_their_mode_is_refused_or_left() {
    let (mut world, mut flight) = (World::airborne(Px4Mode::LOITER), Flight::default());
    command(&mut world, &mut flight, turn_to(0.0));
    assert!(steers(&world, &flight));
    world.commanded_modes();
    let answers = answer_mode(&mut world, &mut flight, DENIED);
    assert_eq!(answers, [AckType::Refused]);
    assert!(!steers(&world, &flight));

    let (mut world, mut flight) = steered();
    world.show_mode(Px4Mode::POSCTL);
    handle(&mut world, &mut flight, Input::Advance);
    assert!(!steers(&world, &flight));
}

/// The reason may come behind the answer: the maneuver ends with the answer, and is answered with the reason.
#[test]
fn a_refused_mode_is_answered_once_the_vehicles_reason_has_come_or_does_not_come() {
    use crate::session::link::state::REASON_WITHIN;
    for (comes, terminated) in [(true, false), (false, false), (false, true)] {
        let (mut world, mut flight) = (World::airborne(Px4Mode::LOITER), Flight::default());
        command(&mut world, &mut flight, turn_to(0.0));
        world.commanded_modes();
        for event in world.answer(MavCmd::MAV_CMD_DO_SET_MODE, DENIED) {
            handle(&mut world, &mut flight, Input::CommandEnded(&event));
        }
        assert!(!steers(&world, &flight) && !flight.view().maneuver);
        let due = flight.poll_timeout().expect("the answer");
        assert_eq!(due, world.now.mono + REASON_WITHIN);
        if terminated {
            world.termination.holds = true;
            handle(&mut world, &mut flight, Input::YieldToTermination);
        }
        handle(&mut world, &mut flight, Input::Advance);
        assert_eq!(acknowledgements(&world.sent_to(0)), []);
        let wait = if comes {
            REASON_WITHIN / 4
        } else {
            REASON_WITHIN
        };
        world.advance(wait);
        if comes {
            world.vehicle.complain(world.now.mono, REASON);
        }
        handle(&mut world, &mut flight, Input::Advance);
        let sent = world.sent_to(0);
        assert_eq!(acknowledgements(&sent), [AckType::Refused]);
        let texts = sent.iter().filter_map(|message| match message {
            Message::SubsystemStatusAlert(alert) => Some(alert.text.as_ref()?.as_str()),
            _ => None,
        });
        let text: String = texts.collect();
        assert!(text.contains("the vehicle answered: denied"), "{text}");
        assert_eq!(text.contains(REASON), comes, "{text}");
        assert_eq!(flight.poll_timeout(), None);
    }
}

/// Its reason has not come when the next maneuver begins, and what the vehicle says then may be about that.
#[test]
fn a_refused_mode_is_answered_when_another_maneuver_begins() {
    let (mut world, mut flight) = (World::airborne(Px4Mode::POSCTL), Flight::default());
    command(&mut world, &mut flight, select(Mode::Loiter));
    world.commanded_modes();
    for event in world.answer(MavCmd::MAV_CMD_DO_SET_MODE, DENIED) {
        handle(&mut world, &mut flight, Input::CommandEnded(&event));
    }
    handle(&mut world, &mut flight, Input::Advance);
    assert_eq!(acknowledgements(&world.sent_to(0)), []);
    let answers = command(&mut world, &mut flight, turn_to(0.0));
    assert!(answers.contains(&AckType::Refused), "{answers:?}");
    assert!(flight.view().maneuver && flight.unexplained.is_none());
}

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
    let (mut world, mut flight) = (World::airborne(Px4Mode::POSCTL), Flight::default());
    command(&mut world, &mut flight, select(Mode::Loiter));
    let stopped = Duration::from_secs(60);
    world.advance(stopped);
    flight.note_stop(stopped);
    let commanded = Some((Mode::Loiter, world.now.mono));
    assert_eq!(flight.mode_commanded, commanded);
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

#[test]
fn a_steered_vehicle_that_nobody_controls_any_more_is_held() {
    for nobody in [false, true] {
        let (mut world, mut flight) = steered();
        if nobody {
            world.controller = None;
        }
        handle(&mut world, &mut flight, Input::ControlChanged);
        handle(&mut world, &mut flight, Input::Advance);
        let expected: &[Px4Mode] = if nobody { &[Px4Mode::LOITER] } else { &[] };
        assert_eq!(world.commanded_modes(), expected);
        assert!(
            steers(&world, &flight),
            "until the vehicle shows another mode"
        );
    }
}

/// Released while the vehicle is silent: the hold is commanded once it is there again.
#[test]
fn a_steered_vehicle_that_is_silent_when_control_is_released_is_held_later() {
    let (mut world, mut flight) = steered();
    world.vehicle.set_silent();
    world.controller = None;
    handle(&mut world, &mut flight, Input::ControlChanged);
    handle(&mut world, &mut flight, Input::Advance);
    handle(&mut world, &mut flight, Input::WatchLossAction);
    assert_eq!(world.commanded_modes(), []);
    world.advance(Duration::from_secs(3));
    world.vehicle.set_live();
    handle(&mut world, &mut flight, Input::WatchLossAction);
    handle(&mut world, &mut flight, Input::Advance);
    assert_eq!(world.commanded_modes(), [Px4Mode::LOITER]);
}

/// A pilot or a failsafe that has taken the vehicle keeps it.
#[test]
fn a_command_that_waits_for_its_route_gives_way_to_a_pilot_and_to_a_failsafe() {
    for (mode, gives_way) in [
        (Px4Mode::POSCTL, true),
        (Px4Mode::RTL, true),
        (Px4Mode::LAND, true),
        // The hold of the upload itself.
        (Px4Mode::LOITER, false),
    ] {
        let (mut world, mut flight) = (World::airborne(Px4Mode::MISSION), Flight::default());
        world.transfer = context::Transfer::Running {
            owner: None,
            waiting_command: Some(None),
        };
        world.show_mode(mode);
        handle(&mut world, &mut flight, Input::ModeChanged);
        let dropped = matches!(
            world.requests.pop_front(),
            Some(Request::DropWaitingCommand { .. })
        );
        assert_eq!(dropped, gives_way, "{}", mode.name());
    }
}

#[test]
fn a_wing_that_is_steered_or_about_to_be_is_held_when_nobody_controls_it() {
    for entered in [true, false] {
        let (mut world, mut flight) = (World::airborne(Px4Mode::LOITER), Flight::default());
        world.vehicle.telemetry.vehicle_type = Some(MavType::MAV_TYPE_FIXED_WING);
        command(&mut world, &mut flight, select(Mode::Autopilot));
        assert_eq!(world.commanded_modes(), [Px4Mode::COURSE]);
        if entered {
            world.show_mode(Px4Mode::COURSE);
        }
        let answers = answer_mode(&mut world, &mut flight, ACCEPTED);
        assert_eq!(answers.contains(&AckType::CarriedOut), entered);
        assert!(steers(&world, &flight));
        world.controller = None;
        handle(&mut world, &mut flight, Input::ControlChanged);
        handle(&mut world, &mut flight, Input::Advance);
        assert_eq!(world.commanded_modes(), [Px4Mode::LOITER]);
        handle(&mut world, &mut flight, Input::ControllerLost);
        // Where the vehicle never showed the mode, the hold that runs is the last that it was sent.
        assert_eq!(flight.view().loss_action, entered);
    }
}

#[test]
fn a_maneuver_ends_with_the_right_of_its_sender_and_one_of_the_vsm_does_not() {
    for of_the_vsm in [false, true] {
        let (mut world, mut flight) = (World::airborne(Px4Mode::POSCTL), Flight::default());
        if of_the_vsm {
            handle(&mut world, &mut flight, Input::Hold);
            handle(&mut world, &mut flight, Input::Advance);
        } else {
            command(&mut world, &mut flight, select(Mode::Loiter));
        }
        world.controller = None;
        handle(&mut world, &mut flight, Input::ControlChanged);
        assert_eq!(flight.view().maneuver, of_the_vsm);
        let expected: &[AckType] = if of_the_vsm { &[] } else { &[AckType::Refused] };
        assert_eq!(acknowledgements(&world.sent_to(0)), expected);
    }
}

#[test]
fn a_command_that_waits_for_its_route_does_not_begin_after_a_later_one() {
    let (mut world, mut flight) = (World::airborne(Px4Mode::POSCTL), Flight::default());
    world.transfer = context::Transfer::Running {
        owner: None,
        waiting_command: Some(None),
    };
    command(&mut world, &mut flight, select(Mode::Loiter));
    assert!(
        matches!(
            world.requests.pop_front(),
            Some(Request::DropWaitingCommand {
                without_right: false,
                ..
            })
        ),
        "what waits for its route must not begin after a later command"
    );
}

/// Else a restart would make the next mode 12 at a place a hover.
#[test]
fn a_loiter_configuration_is_stored_before_it_applies_and_refused_by_a_full_disk() {
    let circle = |radius_m| LoiterConfiguration {
        time_stamp: Some(TimeStamp(1)),
        loiter_radius: Some(Scaled::saturating_from_si(radius_m)),
        ..LoiterConfiguration::default()
    };
    let radius_m = |flight: &Flight| flight.view().loiter.loiter_radius.map(|radius| radius.si());
    let (mut world, mut flight) = (World::airborne(Px4Mode::LOITER), Flight::default());
    let answers = command(&mut world, &mut flight, circle(60.0));
    assert_eq!(answers, [AckType::CarriedOut]);
    let mut restarted = Flight::default();
    let restored = world.act(|_, _, effects| restarted.restore(effects));
    restored.expect("its record");
    assert!(radius_m(&restarted).is_some_and(|radius_m| (radius_m - 60.0).abs() < 0.1));
    assert_eq!(radius_m(&restarted), radius_m(&flight));

    world.fill_disk();
    let answers = command(&mut world, &mut flight, circle(90.0));
    assert_eq!(answers, [AckType::Refused]);
    assert_eq!(radius_m(&restarted), radius_m(&flight));
    // The same once more is there already.
    let answers = command(&mut world, &mut flight, circle(60.0));
    assert_eq!(answers, [AckType::CarriedOut]);
}

#[test]
fn an_altimeter_setting_is_stored_before_it_applies_and_refused_by_a_full_disk() {
    let set = || VehicleOperatingModeCommand {
        altimeter_setting: Some(Scaled::saturating_from_si(100_000.0)),
        ..select(Mode::Loiter)
    };
    let wanted = Altimeter::new(100_000.0).expect("a pressure");

    let (mut world, mut flight) = (World::airborne(Px4Mode::POSCTL), Flight::default());
    command(&mut world, &mut flight, set());
    assert_eq!(flight.view().altimeter, wanted);
    assert!(matches!(
        world.requests.pop_front(),
        Some(Request::Configured { by: Some(0), .. })
    ));
    let mut restarted = Flight::default();
    let restored = world.act(|_, _, effects| restarted.restore(effects));
    restored.expect("the record is read");
    assert_eq!(restarted.view().altimeter, wanted);

    let (mut world, mut flight) = (World::airborne(Px4Mode::POSCTL), Flight::default());
    world.fill_disk();
    let answers = command(&mut world, &mut flight, set());
    assert_eq!(answers, [AckType::Received, AckType::Refused]);
    assert_eq!(flight.view().altimeter, Altimeter::STANDARD);
    assert!(world.requests.is_empty());
    assert_eq!(world.commanded_modes(), [], "the whole command is refused");
}

#[test]
fn nothing_is_commanded_of_a_silent_vehicle() {
    let mut flight = Flight::default();
    let mut world = World::new();
    world.vehicle = crate::session::link::state::VehicleState::default();
    let answers = command(&mut world, &mut flight, select(Mode::Loiter));
    assert_eq!(answers, [AckType::Received, AckType::Refused]);
    assert_eq!(world.commanded_modes(), []);
}

#[test]
fn the_loss_of_the_controller_is_flown_home_where_the_hold_is_refused_twice() {
    let (mut world, mut flight) = (World::airborne(Px4Mode::MISSION), Flight::default());
    world.settings.authority.on_loss = OnLoss::Hold;
    world.controller = None;
    handle(&mut world, &mut flight, Input::ControllerLost);
    assert!(flight.view().loss_action);
    for mode in [Px4Mode::LOITER, Px4Mode::LOITER, Px4Mode::RTL] {
        handle(&mut world, &mut flight, Input::WatchLossAction);
        handle(&mut world, &mut flight, Input::Advance);
        assert_eq!(world.commanded_modes(), [mode]);
        answer_mode(&mut world, &mut flight, DENIED);
        assert!(!flight.view().maneuver);
        let due = flight.poll_timeout().expect("the next try");
        world.advance(due.saturating_sub(world.now.mono));
    }
    world.show_mode(Px4Mode::RTL);
    handle(&mut world, &mut flight, Input::WatchLossAction);
    assert!(!flight.view().loss_action && flight.poll_timeout().is_none());
}

#[test]
fn what_a_held_contingency_has_begun_outlives_control_but_not_a_loss_action() {
    for (contingency, on_loss, kept) in [
        (true, OnLoss::Continue, true),
        (false, OnLoss::Continue, false),
        (true, OnLoss::Rtl, false),
    ] {
        let (mut world, mut flight) = (World::airborne(Px4Mode::MISSION), Flight::default());
        world.settings.authority.on_loss = on_loss;
        let message: Message = select(Mode::Loiter).into();
        let held = Some(HeldOrigin {
            serial: 1,
            contingency,
        });
        let origin = Origin {
            held,
            ..origin(&message)
        };
        let message = &message;
        handle(&mut world, &mut flight, Input::Command { origin, message });
        assert!(flight.view().maneuver);
        world.requests.clear();
        world.controller = None;
        handle(&mut world, &mut flight, Input::ControlChanged);
        handle(&mut world, &mut flight, Input::ControllerLost);
        let ended = |request: &Request| matches!(request, Request::HeldEnded { .. });
        assert_eq!(!world.requests.iter().any(ended), kept, "{on_loss:?}");
    }
}

#[test]
fn who_has_taken_the_vehicle_from_a_termination_keeps_it_though_nobody_controls() {
    let air = Some(LandedState::InAir);
    for (mode, landed, acts) in [
        (Px4Mode::POSCTL, air, false),
        (Px4Mode::LOITER, air, true),
        (Px4Mode::LOITER, None, true),
        (Px4Mode::LOITER, Some(LandedState::OnGround), false),
    ] {
        let (mut world, mut flight) = (World::airborne(Px4Mode::LAND), Flight::default());
        world.vehicle.telemetry.landed = landed;
        world.settings.authority.on_loss = OnLoss::Rtl;
        world.termination.holds = true;
        world.controller = None;
        handle(&mut world, &mut flight, Input::ControllerLost);
        assert!(!flight.view().loss_action, "the termination holds");
        world.show_mode(mode);
        world.termination.holds = false;
        handle(&mut world, &mut flight, Input::Advance);
        assert_eq!(flight.view().loss_action, acts, "{mode:?} {landed:?}");
        handle(&mut world, &mut flight, Input::WatchLossAction);
        assert_eq!(flight.view().loss_action, acts, "{mode:?} {landed:?}");
    }
}

#[test]
fn who_else_has_the_vehicle_keeps_it_when_nobody_controls() {
    const MANUAL: Px4Mode = Px4Mode::new(1, 0);
    const ALTCTL: Px4Mode = Px4Mode::new(2, 0);
    const ACRO: Px4Mode = Px4Mode::new(5, 0);
    const STABILIZED: Px4Mode = Px4Mode::new(7, 0);
    for mode in [MANUAL, ALTCTL, Px4Mode::POSCTL, ACRO, STABILIZED] {
        for on_loss in [OnLoss::Hold, OnLoss::Contingency, OnLoss::Rtl] {
            let (mut world, mut flight) = (World::airborne(mode), Flight::default());
            world.settings.authority.on_loss = on_loss;
            world.controller = None;
            handle(&mut world, &mut flight, Input::ControllerLost);
            for _ in 0..5 {
                handle(&mut world, &mut flight, Input::WatchLossAction);
                handle(&mut world, &mut flight, Input::Advance);
                world.advance(Duration::from_secs(2));
            }
            assert_eq!(world.commanded_modes(), [], "{mode:?}, {on_loss:?}");
            assert!(!flight.view().loss_action);
        }
    }
    // PX4's failsafe holds; the action follows when it ends.
    let (mut world, mut flight) = (World::airborne(Px4Mode::LOITER), Flight::default());
    world.settings.authority.on_loss = OnLoss::Rtl;
    world.vehicle.telemetry.system_status = Some(MavState::MAV_STATE_CRITICAL);
    world.controller = None;
    handle(&mut world, &mut flight, Input::ControllerLost);
    world.advance(Duration::from_secs(2));
    handle(&mut world, &mut flight, Input::WatchLossAction);
    handle(&mut world, &mut flight, Input::Advance);
    assert_eq!(world.commanded_modes(), []);
    world.vehicle.telemetry.system_status = Some(MavState::MAV_STATE_ACTIVE);
    world.advance(Duration::from_secs(2));
    handle(&mut world, &mut flight, Input::WatchLossAction);
    handle(&mut world, &mut flight, Input::Advance);
    assert_eq!(world.commanded_modes(), [Px4Mode::RTL]);
}

#[test]
fn a_vehicle_that_a_pilot_has_taken_from_set_points_is_not_held_when_control_is_released() {
    for taken in [false, true] {
        let (mut world, mut flight) = steered();
        if taken {
            world.show_mode(Px4Mode::POSCTL);
        }
        world.controller = None;
        handle(&mut world, &mut flight, Input::ControlChanged);
        for _ in 0..3 {
            handle(&mut world, &mut flight, Input::WatchLossAction);
            handle(&mut world, &mut flight, Input::Advance);
        }
        let expected = if taken { vec![] } else { vec![Px4Mode::LOITER] };
        assert_eq!(world.commanded_modes(), expected);
        assert_eq!(flight.view().loss_action, !taken);
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

#[test]
fn a_vehicle_that_a_pilot_has_armed_is_not_disarmed_for_a_launch_that_was_cut_off() {
    let mut world = World::airborne(Px4Mode::new(7, 0));
    let mut flight = Flight::default();
    flight.cut_off_launch();
    world.vehicle.telemetry.landed = Some(LandedState::OnGround);
    handle(&mut world, &mut flight, Input::EndCutOffLaunch);
    handle(&mut world, &mut flight, Input::Advance);
    assert_eq!(world.services.commands.poll_transmit(), None);
    assert!(!flight.view().maneuver);
}

#[test]
fn nothing_is_disarmed_before_the_vehicle_knows_where_it_is() {
    let (mut world, mut flight) = (World::airborne(Px4Mode::LOITER), Flight::default());
    flight.cut_off_launch();
    world.vehicle.telemetry.landed = None;
    handle(&mut world, &mut flight, Input::EndCutOffLaunch);
    handle(&mut world, &mut flight, Input::Advance);
    assert_eq!(world.services.commands.poll_transmit(), None);
    assert!(flight.launch_cut_off, "it is decided later");
}

/// Another process finds the record of a loss action that was begun, and nobody controls the vehicle.
fn restarted(world: &mut World, on_loss: OnLoss) -> Flight {
    world.controller = None;
    let now = world.now.mono;
    let (mut before, mut after) = (LossAction::default(), Flight::default());
    world.act(|_, _, effects| {
        before.begin(on_loss, false, now);
        before.store(effects);
        after.restore(effects).expect("the record is read");
    });
    after
}

#[test]
fn a_loss_action_that_a_restart_cut_off_waits_until_the_vehicle_is_known_to_fly() {
    let mut world = World::airborne(Px4Mode::LOITER);
    let mut flight = restarted(&mut world, OnLoss::Contingency);
    world.vehicle.telemetry.landed = None;
    assert_eq!(watch(&mut world, &mut flight, 7), []);
    world.vehicle.telemetry.landed = Some(LandedState::InAir);
    assert_eq!(watch(&mut world, &mut flight, 1), [Px4Mode::RTL]);
}

#[test]
fn a_launch_that_a_restart_cut_off_leaves_no_running_motors_on_the_ground() {
    for airborne in [false, true] {
        let (mut world, mut flight) = (World::airborne(Px4Mode::LOITER), Flight::default());
        flight.launch_cut_off = true;
        if !airborne {
            world.vehicle.telemetry.landed = Some(LandedState::OnGround);
        }
        handle(&mut world, &mut flight, Input::EndCutOffLaunch);
        handle(&mut world, &mut flight, Input::Advance);
        let disarms = world.services.commands.poll_transmit().is_some_and(|sent| {
            matches!(sent, MavMessage::COMMAND_LONG(sent)
                if sent.command == MavCmd::MAV_CMD_COMPONENT_ARM_DISARM && sent.param1 == 0.0)
        });
        assert_eq!(disarms, !airborne);
        assert!(!flight.launch_cut_off, "once");
    }
}

/// What a 2008 that starts the engine is answered, and what follows from it.
fn start_engine(world: &mut World, flight: &mut Flight) -> Vec<AckType> {
    let start = EngineCommand {
        engine_command: Some(CommandedEngineState::Start),
        ..EngineCommand::default()
    };
    command(world, flight, start)
}

/// PX4 has taken the mode, and shows it only with its next HEARTBEAT: without set points it would return home.
#[test]
fn set_points_continue_while_a_superseded_mode_15_may_still_be_entered() {
    let later: [fn(&mut World, &mut Flight); 3] = [
        |world, flight| {
            command(world, flight, select(Mode::Loiter));
        },
        |world, flight| handle(world, flight, Input::Hold),
        |world, flight| {
            world.controller = None;
            handle(world, flight, Input::ControlChanged);
        },
    ];
    for supersede in later {
        let (mut world, mut flight) = (World::airborne(Px4Mode::LOITER), Flight::default());
        command(&mut world, &mut flight, turn_to(0.0));
        world.commanded_modes();
        world.command_was_sent();
        supersede(&mut world, &mut flight);
        world.command_was_sent();
        for _ in 0..30 {
            world.advance(Duration::from_millis(50));
            world.posts();
            handle(&mut world, &mut flight, Input::Advance);
            assert_eq!(world.posts().len(), 1);
        }
        // The vehicle was in it all the while.
        world.show_mode(Px4Mode::OFFBOARD);
        world.advance(Duration::from_secs(3));
        handle(&mut world, &mut flight, Input::Advance);
        assert_eq!(world.posts().len(), 1);
        world.show_mode(Px4Mode::LOITER);
        handle(&mut world, &mut flight, Input::Advance);
        assert!(world.posts().is_empty() && !steers(&world, &flight));
    }
}

#[test]
fn a_start_of_a_running_engine_leaves_a_mode_that_is_being_entered() {
    let (mut world, mut flight) = (World::airborne(Px4Mode::LOITER), Flight::default());
    command(&mut world, &mut flight, turn_to(0.0));
    world.commanded_modes();
    world.command_was_sent();
    // Armed by a report of before that command: it proves nothing yet.
    assert_eq!(
        start_engine(&mut world, &mut flight),
        [AckType::Received],
        "answered by what the vehicle shows"
    );
    assert!(steers(&world, &flight) && flight.view().maneuver);
    world.show_mode(Px4Mode::OFFBOARD);
    let answers = answer_mode(&mut world, &mut flight, ACCEPTED);
    assert_eq!(answers, [AckType::CarriedOut; 2]);
    assert!(steers(&world, &flight) && !flight.view().maneuver);
}

#[test]
fn a_demand_of_other_values_supersedes_demands_and_not_the_mode() {
    let started = |by_mode: bool| {
        let (mut world, mut flight) = (World::airborne(Px4Mode::LOITER), Flight::default());
        if by_mode {
            command(&mut world, &mut flight, turn_to(0.0));
        }
        (world, flight)
    };
    for by_mode in [true, false] {
        let (mut world, mut flight) = started(by_mode);
        for _ in 0..2 {
            let answers = demand(&mut world, &mut flight, 120, 1.0);
            assert!(!answers.contains(&AckType::Refused), "{answers:?}");
        }
        let answers = demand(&mut world, &mut flight, 150, 1.5);
        let refused = answers.iter().filter(|one| **one == AckType::Refused);
        assert_eq!(refused.count(), 2, "{answers:?}");
        world.show_mode(Px4Mode::OFFBOARD);
        let answers = answer_mode(&mut world, &mut flight, ACCEPTED);
        let expected = [AckType::CarriedOut; 2];
        assert_eq!(answers, expected[..1 + usize::from(by_mode)]);
    }
}

#[test]
fn a_wave_off_right_after_the_landing_was_commanded_aborts_it() {
    let (mut world, mut flight) = (World::airborne(Px4Mode::LOITER), Flight::default());
    command(&mut world, &mut flight, select(Mode::AutolandEngage));
    assert_eq!(world.commanded_modes(), [Px4Mode::LAND]);
    world.command_was_sent();
    let answers = command(&mut world, &mut flight, select(Mode::AutolandWaveOff));
    assert_eq!(answers, [AckType::Received, AckType::Refused], "mode 19");
    answer_mode(&mut world, &mut flight, ACCEPTED);
    assert_eq!(world.commanded_modes(), [Px4Mode::LOITER]);
    // Without a landing there is nothing to abort.
    let (mut world, mut flight) = (World::airborne(Px4Mode::LOITER), Flight::default());
    let answers = command(&mut world, &mut flight, select(Mode::AutolandWaveOff));
    assert_eq!(answers, [AckType::Received, AckType::Refused]);
    assert!(!flight.view().maneuver);
}

/// The hold may have ended a mode 15 that the vehicle has entered, and shows later.
#[test]
fn a_loss_action_is_not_done_by_a_report_of_before_the_last_command() {
    let (mut world, mut flight) = (World::airborne(Px4Mode::LOITER), Flight::default());
    world.settings.authority.on_loss = OnLoss::Hold;
    command(&mut world, &mut flight, turn_to(0.0));
    world.commanded_modes();
    world.command_was_sent();
    world.controller = None;
    handle(&mut world, &mut flight, Input::ControlChanged);
    handle(&mut world, &mut flight, Input::ControllerLost);
    handle(&mut world, &mut flight, Input::WatchLossAction);
    assert!(flight.view().loss_action);
    world.show_mode(Px4Mode::LOITER);
    handle(&mut world, &mut flight, Input::Advance);
    handle(&mut world, &mut flight, Input::WatchLossAction);
    assert!(!flight.view().loss_action);
}

#[test]
fn a_command_without_a_mode_is_judged_by_no_report_of_before_the_last_command() {
    let (mut world, mut flight) = (World::airborne(Px4Mode::LOITER), Flight::default());
    let faster = VehicleOperatingModeCommand {
        commanded_speed: Scaled::from_si(5.0).ok(),
        ..VehicleOperatingModeCommand::default()
    };
    // A mode that was commanded and given up: no maneuver runs, and the vehicle may be in it.
    world.command_was_sent();
    let answers = command(&mut world, &mut flight, faster.clone());
    assert_eq!(answers, [AckType::Received, AckType::Refused]);
    world.show_mode(Px4Mode::LOITER);
    let answers = command(&mut world, &mut flight, faster);
    assert_eq!(answers, [AckType::Received]);
}

/// A VTOL on its way to its wings, for a route that is flown on them.
fn turning() -> (World, Flight) {
    let (mut world, mut flight) = (World::airborne(Px4Mode::LOITER), Flight::default());
    let mut steps = maneuver::transition(false).to_vec();
    steps.extend(maneuver::enter(&[Px4Mode::MISSION]));
    world.vehicle.telemetry.vehicle_type = Some(MavType::MAV_TYPE_VTOL_TAILSITTER_DUOROTOR);
    world.act(|common, views, effects| {
        let context = Context {
            common,
            mission: views.mission,
            parameters: views.parameters,
        };
        let maneuver = Maneuver::new(steps, Commanded::default());
        flight.begin(&context, None, maneuver, effects);
    });
    handle(&mut world, &mut flight, Input::Advance);
    assert_eq!(world.commanded_modes(), []);
    for event in world.answer(MavCmd::MAV_CMD_DO_VTOL_TRANSITION, ACCEPTED) {
        handle(&mut world, &mut flight, Input::CommandEnded(&event));
    }
    handle(&mut world, &mut flight, Input::Advance);
    (world, flight)
}

#[test]
fn a_pilot_who_takes_over_between_two_steps_keeps_the_aircraft() {
    let on_wings = Some(mavlink_link::dialect::MavVtolState::MAV_VTOL_STATE_FW);
    for taken in [None, Some(Px4Mode::POSCTL), Some(Px4Mode::RTL)] {
        let (mut world, mut flight) = turning();
        if let Some(mode) = taken {
            world.show_mode(mode);
            handle(&mut world, &mut flight, Input::Advance);
            assert!(!flight.view().maneuver, "at once, not at the next step");
            // The pilot's own hold.
            world.show_mode(Px4Mode::LOITER);
        }
        world.vehicle.telemetry.vtol_state = on_wings;
        handle(&mut world, &mut flight, Input::Advance);
        let expected: &[Px4Mode] = match taken {
            None => &[Px4Mode::MISSION],
            Some(_) => &[],
        };
        assert_eq!(world.commanded_modes(), expected, "{taken:?}");
    }
}

/// The controller is lost, and the vehicle is to return.
pub(super) fn lose(world: &mut World, flight: &mut Flight) {
    world.settings.authority.on_loss = OnLoss::Rtl;
    world.controller = None;
    handle(world, flight, Input::ControllerLost);
}

/// What is commanded in so many seconds.
pub(super) fn watch(world: &mut World, flight: &mut Flight, seconds: u64) -> Vec<Px4Mode> {
    for _ in 0..seconds {
        world.advance(Duration::from_secs(1));
        handle(world, flight, Input::WatchLossAction);
        handle(world, flight, Input::Advance);
    }
    world.commanded_modes()
}

/// Nobody waits for a reason: where the route of the loss action cannot be flown, the vehicle returns.
#[test]
fn a_loss_action_returns_where_the_vehicle_finds_its_route_infeasible() {
    let (mut world, mut flight) = (World::airborne(Px4Mode::LOITER), Flight::default());
    let route = UaRoute {
        initial_waypoint_number: Some(1),
        route_type: Some(RouteType::ContingencyA),
        ..UaRoute::default()
    };
    let stored = world.plan.store(&route.into(), Id(1), Id(2));
    assert_eq!(stored, Ok(()));
    let sent = world.plan.route_of_type(RouteType::ContingencyA);
    world.uploaded = Some(UploadedMission {
        compiled: CompiledMission::default(),
        mission_id: 0,
        route_type: RouteType::ContingencyA,
        mission_name: String::new(),
        plan: world.plan.part(sent.expect("it was stored")),
    });
    world.infeasible = true;
    world.settings.authority.on_loss = OnLoss::Contingency;
    world.controller = None;
    handle(&mut world, &mut flight, Input::ControllerLost);
    assert_eq!(watch(&mut world, &mut flight, 5), [Px4Mode::RTL]);
}

#[test]
fn a_failsafe_that_only_holds_is_respected_for_half_a_minute_and_one_that_does_more_for_ever() {
    for (mode, acts) in [
        (Px4Mode::LOITER, true),
        (Px4Mode::MISSION, true),
        (Px4Mode::TERMINATION, false),
    ] {
        let (mut world, mut flight) = (World::airborne(mode), Flight::default());
        world.vehicle.telemetry.system_status = Some(MavState::MAV_STATE_CRITICAL);
        lose(&mut world, &mut flight);
        assert_eq!(watch(&mut world, &mut flight, 28), [], "{mode:?}");
        let expected: &[Px4Mode] = if acts { &[Px4Mode::RTL] } else { &[] };
        let commanded = watch(&mut world, &mut flight, 5);
        assert_eq!(commanded.first(), expected.first(), "{mode:?}");
    }
}

#[test]
fn a_failsafe_that_returns_after_its_hold_is_the_end_of_the_loss_action() {
    let (mut world, mut flight) = (World::airborne(Px4Mode::LOITER), Flight::default());
    world.vehicle.telemetry.system_status = Some(MavState::MAV_STATE_CRITICAL);
    lose(&mut world, &mut flight);
    assert_eq!(watch(&mut world, &mut flight, 25), []);
    world.show_mode(Px4Mode::RTL);
    assert_eq!(watch(&mut world, &mut flight, 20), []);
    assert!(!flight.view().loss_action);
}

#[test]
fn a_wing_that_may_be_on_its_final_approach_is_not_taken_off_it() {
    let wing = || {
        let mut world = World::airborne(Px4Mode::MISSION);
        world.vehicle.telemetry.vehicle_type = Some(MavType::MAV_TYPE_FIXED_WING);
        (world, Flight::default())
    };
    let (mut world, mut flight) = wing();
    lose(&mut world, &mut flight);
    assert_eq!(watch(&mut world, &mut flight, 4), []);
    // Its link was gone once more.
    world.vehicle.set_silent();
    assert_eq!(watch(&mut world, &mut flight, 10), []);
    world.vehicle.set_live();
    handle(&mut world, &mut flight, Input::Advance);
    assert_eq!(watch(&mut world, &mut flight, 4), []);
    assert!(flight.view().loss_action);
    let commanded = watch(&mut world, &mut flight, 4);
    assert_eq!(commanded.first(), Some(&Px4Mode::RTL), "it reports none");
    // The item is known, and no touch-down of a mission of ours.
    let (mut world, mut flight) = wing();
    lose(&mut world, &mut flight);
    assert_eq!(watch(&mut world, &mut flight, 1), []);
    world.vehicle.telemetry.mission = Some(MissionProgress {
        seq: 1,
        total: Some(3),
        state: MissionState::MISSION_STATE_ACTIVE,
        mission_id: 0,
        fence_id: 0,
        rally_points_id: 0,
    });
    let commanded = watch(&mut world, &mut flight, 2);
    assert_eq!(commanded.first(), Some(&Px4Mode::RTL));
}

#[test]
fn a_route_of_the_loss_action_is_not_flown_over_a_failsafe_that_began_during_its_upload() {
    for failsafe in [true, false] {
        let (mut world, mut flight) = (World::airborne(Px4Mode::LOITER), Flight::default());
        if failsafe {
            world.vehicle.telemetry.system_status = Some(MavState::MAV_STATE_CRITICAL);
        }
        let fly = Input::Fly {
            origin: None,
            command: &select(Mode::AutolandEngage),
            just_loaded: true,
        };
        handle(&mut world, &mut flight, fly);
        handle(&mut world, &mut flight, Input::Advance);
        assert_eq!(flight.view().maneuver, !failsafe);
    }
}

#[test]
fn a_late_report_of_sticks_that_were_released_drops_no_command_that_waits_for_its_route() {
    for taken in [false, true] {
        let (mut world, mut flight) = (World::airborne(Px4Mode::LOITER), Flight::default());
        world.transfer = context::Transfer::Running {
            owner: None,
            waiting_command: Some(None),
        };
        // The hold of the upload has been sent; this report was made before.
        world.show_mode(Px4Mode::POSCTL);
        world.command_was_sent();
        handle(&mut world, &mut flight, Input::ModeChanged);
        assert!(world.requests.is_empty());
        let newer = if taken {
            Px4Mode::POSCTL
        } else {
            Px4Mode::LOITER
        };
        world.show_mode(newer);
        handle(&mut world, &mut flight, Input::Advance);
        assert_eq!(world.requests.is_empty(), !taken);
    }
}

/// A wing on its final approach, 20 m above home, with a mission of a touch-down alone.
fn on_final() -> (World, Flight) {
    const NAV_LAND: u16 = 21;
    let mut world = World::airborne(Px4Mode::MISSION);
    world.vehicle.telemetry.vehicle_type = Some(MavType::MAV_TYPE_FIXED_WING);
    let touch_down = Item {
        command: NAV_LAND,
        ..Item::default()
    };
    world.uploaded = Some(UploadedMission {
        compiled: CompiledMission {
            items: vec![touch_down],
            waypoint_of: vec![0],
            ..CompiledMission::default()
        },
        mission_id: 0,
        route_type: RouteType::Flight,
        mission_name: String::new(),
        plan: Plan::default(),
    });
    world.vehicle.telemetry.mission = Some(MissionProgress {
        seq: 0,
        total: Some(1),
        state: MissionState::MISSION_STATE_ACTIVE,
        mission_id: 0,
        fence_id: 0,
        rally_points_id: 0,
    });
    (world, Flight::default())
}

/// The alert that station 0 was sent of a landing that was broken off.
fn broken_off(world: &mut World) -> Option<String> {
    let texts = world.sent_to(0).into_iter().filter_map(|message| {
        let Message::SubsystemStatusAlert(alert) = message else {
            return None;
        };
        Some(alert.text?.as_str().to_owned())
    });
    // A long text comes in several parts.
    let all: String = texts.collect();
    all.find("the landing is broken off")
        .map(|from| all[from..].to_owned())
}

#[test]
fn a_landing_is_broken_off_once_the_vehicle_reports_it_and_not_where_it_refuses() {
    for (result, warns) in [(ACCEPTED, true), (DENIED, false)] {
        let (mut world, mut flight) = on_final();
        handle(&mut world, &mut flight, Input::Hold);
        handle(&mut world, &mut flight, Input::Advance);
        assert_eq!(world.commanded_modes(), [Px4Mode::LOITER]);
        world.command_was_sent();
        for event in world.answer(MavCmd::MAV_CMD_DO_SET_MODE, result) {
            handle(&mut world, &mut flight, Input::CommandEnded(&event));
        }
        // It sinks until the mode is reported.
        let place = &mut world.vehicle.telemetry.position;
        *place = place.map(|place| Place {
            amsl_m: place.amsl_m - 2.0,
            ..place
        });
        world.show_mode(Px4Mode::MISSION);
        handle(&mut world, &mut flight, Input::Advance);
        assert_eq!(broken_off(&mut world), None, "{result:?}");
        world.show_mode(Px4Mode::LOITER);
        handle(&mut world, &mut flight, Input::ModeChanged);
        handle(&mut world, &mut flight, Input::Advance);
        let text = broken_off(&mut world);
        assert_eq!(text.is_some(), warns, "{result:?} {text:?}");
        let names = |text: String| {
            text.contains("18 m above home") && text.contains("AUTO.LOITER; it keeps")
        };
        assert_eq!(text.is_some_and(names), warns);
        handle(&mut world, &mut flight, Input::Advance);
        assert_eq!(broken_off(&mut world), None, "once");
    }
}

/// EXTENDED_SYS_STATE comes once a second: what it has not reported yet is not on the ground.
#[test]
fn just_after_a_start_a_landing_is_broken_off_too_and_none_begins_where_the_wing_is() {
    for (landed, armed, warns) in [
        (None, true, true),
        (None, false, false),
        (Some(LandedState::OnGround), true, false),
    ] {
        let begun = || {
            let (mut world, flight) = on_final();
            let telemetry = &mut world.vehicle.telemetry;
            (telemetry.landed, telemetry.armed) = (landed, Some(armed));
            (world, flight)
        };
        let (mut world, mut flight) = begun();
        handle(&mut world, &mut flight, Input::Hold);
        handle(&mut world, &mut flight, Input::Advance);
        world.show_mode(Px4Mode::LOITER);
        handle(&mut world, &mut flight, Input::ModeChanged);
        handle(&mut world, &mut flight, Input::Advance);
        let text = broken_off(&mut world);
        assert_eq!(text.is_some(), warns, "{landed:?} {armed} {text:?}");
        // A hold may be in the air, too.
        let (mut world, mut flight) = begun();
        world.show_mode(Px4Mode::LOITER);
        command(&mut world, &mut flight, select(Mode::AutolandEngage));
        let modes = world.commanded_modes();
        let expected = landed.map(|_| Px4Mode::LAND);
        assert_eq!(modes, Vec::from_iter(expected), "{landed:?}");
    }
}

#[test]
fn a_landing_that_another_has_taken_or_that_ends_is_not_broken_off() {
    let shown: [fn(&mut World); 4] = [
        |world| world.show_mode(Px4Mode::POSCTL),
        |world| world.vehicle.telemetry.landed = Some(LandedState::OnGround),
        |world| world.vehicle.telemetry.armed = Some(false),
        // Of a silent vehicle the item is not known for a second.
        |world| world.vehicle.telemetry.mission = None,
    ];
    for show in shown {
        let (mut world, mut flight) = on_final();
        handle(&mut world, &mut flight, Input::Hold);
        handle(&mut world, &mut flight, Input::Advance);
        show(&mut world);
        handle(&mut world, &mut flight, Input::Advance);
        assert_eq!(broken_off(&mut world), None);
    }
}
