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
