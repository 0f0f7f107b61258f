//! After the loss of the controlling CUCS, and what a restart has cut off.

use stanag_msgs::Id;
use stanag_msgs::messages::UaRoute;

use super::*;
use crate::session::context::HeldOrigin;

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
