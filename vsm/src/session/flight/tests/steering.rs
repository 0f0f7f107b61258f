//! Set points in mode 15: while they flow, and who gets the vehicle after them.

use super::*;

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

/// PX4 keeps OFFBOARD as the mode that was chosen while its failsafe holds, at a fence for example, and would return out of that for want
/// of set points.
#[test]
fn set_points_stand_still_while_a_failsafe_holds_and_end_otherwise() {
    use MavState::{MAV_STATE_ACTIVE as ACTIVE, MAV_STATE_CRITICAL as CRITICAL};
    for (shown, status, without, continues) in [
        (Px4Mode::LOITER, CRITICAL, Some(0.0), true),
        (Px4Mode::LOITER, CRITICAL, Some(3.0), true),
        (Px4Mode::LOITER, ACTIVE, Some(0.0), false),
        (Px4Mode::RTL, CRITICAL, Some(0.0), false),
        (Px4Mode::POSCTL, CRITICAL, Some(0.0), false),
        // It may hold for want of set points, and would leave that.
        (Px4Mode::LOITER, CRITICAL, Some(5.0), false),
        (Px4Mode::LOITER, CRITICAL, None, false),
    ] {
        let (mut world, mut flight) = fast(without);
        world.sent_to(0);
        fails_over(&mut world, shown, status);
        let sent = streamed(&mut world, &mut flight, 40);
        assert_eq!(sent.len(), if continues { 40 } else { 0 }, "{shown:?}");
        assert!(sent.iter().all(stands_still));
        let named = alerts_of(&mut world, "set points stand still");
        assert_eq!(named, usize::from(continues));
        assert_eq!(steers(&world, &flight), continues);
    }
}

#[test]
fn set_points_end_as_the_vehicle_is_disarmed_and_go_on_where_it_is_back_in_the_mode() {
    for held in [false, true] {
        let (mut world, mut flight) = fast(Some(0.0));
        if held {
            fails_over(&mut world, Px4Mode::LOITER, MavState::MAV_STATE_CRITICAL);
            assert_eq!(streamed(&mut world, &mut flight, 5).len(), 5);
        }
        world.sent_to(0);
        world.vehicle.telemetry.armed = Some(false);
        // PX4 shows the mode that was chosen, on the ground too.
        fails_over(&mut world, Px4Mode::OFFBOARD, MavState::MAV_STATE_STANDBY);
        assert_eq!(streamed(&mut world, &mut flight, 5), []);
        assert_eq!(alerts_of(&mut world, "in OFFBOARD again"), 0);
    }
    let (mut world, mut flight) = fast(Some(0.0));
    for (mode, status) in [
        (Px4Mode::LOITER, MavState::MAV_STATE_CRITICAL),
        (Px4Mode::OFFBOARD, MavState::MAV_STATE_ACTIVE),
    ] {
        fails_over(&mut world, mode, status);
        assert_eq!(streamed(&mut world, &mut flight, 20).len(), 20);
    }
    assert_eq!(alerts_of(&mut world, "in OFFBOARD again"), 1);
}

#[test]
fn a_mode_15_that_is_commanded_while_a_failsafe_holds_steers_again_and_its_refusal_leaves_set_points_that_stand_still()
 {
    for refused in [true, false] {
        let (mut world, mut flight) = fast(Some(0.0));
        fails_over(&mut world, Px4Mode::LOITER, MavState::MAV_STATE_CRITICAL);
        // By then it is a new command.
        streamed(&mut world, &mut flight, 120);
        fails_over(&mut world, Px4Mode::LOITER, MavState::MAV_STATE_CRITICAL);
        let faster = VehicleOperatingModeCommand {
            commanded_speed: Scaled::from_si(3.0).ok(),
            ..turn_to(1.0)
        };
        assert_eq!(
            command(&mut world, &mut flight, faster),
            [AckType::Received]
        );
        assert_eq!(world.commanded_modes(), [Px4Mode::OFFBOARD]);
        assert!(!stands_still(&world.posts()[0]));
        if refused {
            answer_mode(&mut world, &mut flight, DENIED);
        } else {
            world.vehicle.telemetry.system_status = Some(MavState::MAV_STATE_ACTIVE);
            world.show_mode(Px4Mode::OFFBOARD);
            let answers = answer_mode(&mut world, &mut flight, ACCEPTED);
            assert_eq!(answers, [AckType::CarriedOut]);
        }
        world.posts();
        let sent = streamed(&mut world, &mut flight, 80);
        assert_eq!(sent.len(), 80, "{refused}");
        assert!(sent.iter().all(|one| stands_still(one) == refused));
    }
}

#[test]
fn another_mode_ends_set_points_that_stand_still_once_it_is_entered() {
    for (commanded, mode) in [
        (Mode::Loiter, Px4Mode::LOITER),
        (Mode::AutolandEngage, Px4Mode::LAND),
    ] {
        let (mut world, mut flight) = fast(Some(0.0));
        for refused in [true, false] {
            fails_over(&mut world, Px4Mode::LOITER, MavState::MAV_STATE_CRITICAL);
            // It is a new command after such a pause.
            streamed(&mut world, &mut flight, 120);
            fails_over(&mut world, Px4Mode::LOITER, MavState::MAV_STATE_CRITICAL);
            command(&mut world, &mut flight, select(commanded));
            assert_eq!(world.commanded_modes().last(), Some(&mode), "{mode:?}");
            world.command_was_sent();
            assert_eq!(streamed(&mut world, &mut flight, 60).len(), 60);
            if refused {
                answer_mode(&mut world, &mut flight, DENIED);
            } else {
                world.show_mode(mode);
                answer_mode(&mut world, &mut flight, ACCEPTED);
            }
            world.posts();
            let sent = streamed(&mut world, &mut flight, 60);
            assert_eq!(sent.len(), if refused { 60 } else { 0 }, "{mode:?}");
        }
        assert!(!steers(&world, &flight));
    }
}

/// PX4 may be in a failsafe as well, as for its battery: it does not miss set points in a mode that was commanded.
#[test]
fn a_hold_that_is_commanded_ends_set_points_whatever_failsafe_the_vehicle_shows() {
    let (mut world, mut flight) = fast(Some(0.0));
    command(&mut world, &mut flight, select(Mode::Loiter));
    world.command_was_sent();
    fails_over(&mut world, Px4Mode::LOITER, MavState::MAV_STATE_CRITICAL);
    answer_mode(&mut world, &mut flight, ACCEPTED);
    world.posts();
    assert_eq!(streamed(&mut world, &mut flight, 20), []);
    assert!(!steers(&world, &flight));
}

/// A pilot may have switched it back, or PX4: nothing tells which.
#[test]
fn a_vehicle_that_shows_the_mode_again_hovers_until_it_is_commanded_anew() {
    let (mut world, mut flight) = fast(Some(0.0));
    let mut repeats = |world: &mut World| {
        let mut sent = Vec::new();
        for turn in 0..10 {
            let answers = command(world, &mut flight, turn_to(0.1 * f64::from(turn)));
            assert_eq!(answers, [AckType::Received, AckType::Refused]);
            sent.extend(streamed(world, &mut flight, 10));
        }
        sent
    };
    fails_over(&mut world, Px4Mode::LOITER, MavState::MAV_STATE_CRITICAL);
    assert!(repeats(&mut world).iter().all(stands_still));
    fails_over(&mut world, Px4Mode::OFFBOARD, MavState::MAV_STATE_ACTIVE);
    assert!(repeats(&mut world).iter().all(stands_still));
    fails_over(&mut world, Px4Mode::OFFBOARD, MavState::MAV_STATE_ACTIVE);
    let sent = streamed(&mut world, &mut flight, 101);
    assert_eq!(sent.len(), 101);
    assert!(sent.iter().all(stands_still));
    command(&mut world, &mut flight, turn_to(2.0));
    assert_eq!(world.commanded_modes(), [], "it is in the mode");
    let posts = streamed(&mut world, &mut flight, 1);
    let Some(MavMessage::SET_POSITION_TARGET_LOCAL_NED(turned)) = posts.last() else {
        panic!("a set point, not {posts:?}");
    };
    assert!((turned.yaw - 2.0).abs() < 1e-3 && stands_still(&posts[0]));
}

/// Steered at 5 m/s; `without` set points it acts by this COM_OBL_RC_ACT.
fn fast(without: Option<f64>) -> (World, Flight) {
    let (mut world, mut flight) = steered();
    if let Some(without) = without {
        world.parameters.set("COM_OBL_RC_ACT", without);
    }
    let faster = VehicleOperatingModeCommand {
        commanded_speed: Scaled::from_si(5.0).ok(),
        ..turn_to(0.0)
    };
    command(&mut world, &mut flight, faster);
    assert!(!stands_still(&streamed(&mut world, &mut flight, 1)[0]));
    (world, flight)
}

fn fails_over(world: &mut World, mode: Px4Mode, status: MavState) {
    world.vehicle.telemetry.system_status = Some(status);
    world.show_mode(mode);
}

/// What is sent in so many periods of the set points.
fn streamed(world: &mut World, flight: &mut Flight, periods: u32) -> Vec<MavMessage> {
    let mut sent = Vec::new();
    for _ in 0..periods {
        world.advance(Duration::from_millis(50));
        handle(world, flight, Input::Advance);
        sent.extend(world.posts());
    }
    sent
}

fn stands_still(message: &MavMessage) -> bool {
    match message {
        MavMessage::SET_POSITION_TARGET_LOCAL_NED(one) => [one.vx, one.vy, one.vz] == [0.0; 3],
        other => panic!("a set point, not {other:?}"),
    }
}
