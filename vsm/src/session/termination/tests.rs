//! The machine without the others: what it sends, and what of the vehicle's reports it takes for an answer.

use mapping::mode::Px4Mode;
use mavlink_link::dialect::MavState;
use stanag_msgs::TimeStamp;
use stanag_msgs::enums::FtState;

use super::*;
use crate::session::duplicates::Delay;
use crate::session::testing::{CUCS, World, acknowledgements, origin};

/// Executed just now, by an order of station 0 that waits for its answer; the audit log has it.
fn commanded(world: &World, action: Action) -> Termination {
    let at = |stamp| Circumstances {
        now: world.now.mono,
        by: CUCS,
        stamp: TimeStamp(stamp),
        controls: true,
        handover: false,
        proven: true,
        delay: Delay::Behind(Duration::ZERO),
        layout: true,
        plan: Some(Plan {
            action,
            armed: Duration::from_secs(30),
            confirm: Duration::from_secs(300),
        }),
        vehicle: Shows::Flying,
    };
    let mut termination = Termination::default();
    for (order, stamp) in [(Order::Arm, 1), (Order::Execute, 2)] {
        termination
            .rules
            .order(order, &at(stamp))
            .expect("a good order");
    }
    let execute = FlightTerminationCommand {
        commanded_flight_termination_state: Some(FtState::Execute),
        ..FlightTerminationCommand::default()
    };
    termination.commanded = Some((origin(&execute.into()), action));
    termination.send_at = Some(world.now.mono);
    termination
}

/// Lets it watch for so many seconds, ten times in each: how many commands it has sent.
fn watch(world: &mut World, termination: &mut Termination, seconds: u32) -> usize {
    let mut sent = 0;
    for _ in 0..seconds * 10 {
        world.act(|context, _, effects| termination.handle(&context, Input::Watch, effects));
        sent += world.posts().len();
        world.advance(Duration::from_millis(100));
    }
    sent
}

/// TERMINATION of before is one: that is final.
#[test]
fn a_mode_of_before_the_command_is_no_answer_to_it() {
    for (action, mode) in [
        (Action::Land, Px4Mode::LAND),
        (Action::Return, Px4Mode::RTL),
    ] {
        let mut world = World::airborne(mode);
        // One that may reset it.
        world.stations[0].profile.provisional = Provisional::All;
        world.advance(Duration::from_millis(100));
        let mut termination = commanded(&world, action);
        assert!(watch(&mut world, &mut termination, 3) >= 3, "{action:?}");
        assert_eq!(termination.rules.reported(), FtState::Arm, "{action:?}");
        assert_eq!(acknowledgements(&world.sent_to(0)), [], "{action:?}");
        world.show_mode(mode);
        watch(&mut world, &mut termination, 1);
        assert_eq!(termination.rules.reported(), FtState::Execute, "{action:?}");
        assert_eq!(acknowledgements(&world.sent_to(0)), [AckType::CarriedOut]);
    }
}

/// Each of them would take it from its pilot again, who cannot be seen.
#[test]
fn a_landing_is_not_commanded_for_ever_without_sight_of_the_vehicle_and_an_end_of_the_flight_is() {
    let mut world = World::airborne(Px4Mode::LOITER);
    world.advance(Duration::from_millis(100));
    let mut landing = commanded(&world, Action::Land);
    assert_eq!(watch(&mut world, &mut landing, 20), UNSEEN as usize);
    // Seen again, and not landing: it is commanded again.
    world.show_mode(Px4Mode::LOITER);
    assert_eq!(watch(&mut world, &mut landing, 20), UNSEEN as usize);
    let mut end = commanded(&world, Action::Terminate);
    assert_eq!(watch(&mut world, &mut end, 20), 20);
}

/// PX4 misses the sticks that the termination has ended.
#[test]
fn a_landing_that_a_failsafe_holds_is_commanded_again_a_few_times_and_over_a_pilot_never() {
    use MavState::{MAV_STATE_ACTIVE as ACTIVE, MAV_STATE_CRITICAL as CRITICAL};
    let again = AGAINST_HOLD as usize;
    for (status, intended, commands) in [
        (CRITICAL, None, again),
        (CRITICAL, Some(Px4Mode::LAND), again),
        // A hold that is chosen while a failsafe would hold too.
        (CRITICAL, Some(Px4Mode::LOITER), 0),
        (ACTIVE, None, 0),
    ] {
        let mut world = World::airborne(Px4Mode::POSCTL);
        // One that may reset it.
        world.stations[0].profile.provisional = Provisional::All;
        let mut landing = commanded(&world, Action::Land);
        assert_eq!(watch(&mut world, &mut landing, 1), 1);
        world.show_mode(Px4Mode::LAND);
        assert_eq!(watch(&mut world, &mut landing, 1), 0);
        assert_eq!(landing.rules.reported(), FtState::Execute);
        world.vehicle.telemetry.system_status = Some(status);
        let mut sent = 0;
        for _ in 0..8 {
            world.show_mode(Px4Mode::LOITER);
            world.vehicle.telemetry.intended_mode = intended;
            sent += watch(&mut world, &mut landing, 1);
        }
        assert_eq!(sent, commands, "{status:?} {intended:?}");
        assert_eq!(landing.rules.reported(), FtState::Reset, "left");
    }
}

#[test]
fn a_vehicle_that_ends_its_flight_by_itself_has_not_landed_as_it_was_ordered() {
    for (action, answer) in [
        (Action::Land, AckType::Refused),
        (Action::Return, AckType::Refused),
        (Action::Terminate, AckType::CarriedOut),
    ] {
        let mut world = World::airborne(Px4Mode::LOITER);
        let mut termination = commanded(&world, action);
        watch(&mut world, &mut termination, 1);
        world.show_mode(Px4Mode::TERMINATION);
        watch(&mut world, &mut termination, 1);
        assert_eq!(acknowledgements(&world.sent_to(0)), [answer], "{action:?}");
        assert_eq!(termination.rules.reported(), FtState::Execute);
    }
}
