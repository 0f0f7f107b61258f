//! Commands and their maneuvers: what confirms, supersedes, refuses and ends one.

use stanag_msgs::scalar::Scaled;

use super::*;
use crate::session::context::Continues;

/// A #43 of these values, of Edition 2.5, and what the machine does at once.
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

/// What a 2008 that starts the engine is answered, and what follows from it.
fn start_engine(world: &mut World, flight: &mut Flight) -> Vec<AckType> {
    let start = EngineCommand {
        engine_command: Some(CommandedEngineState::Start),
        ..EngineCommand::default()
    };
    command(world, flight, start)
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

/// As just after a start of the VSM: where the vehicle flies to a place, AUTO.LOITER once more does not stop it.
#[test]
fn a_hold_before_the_first_set_point_is_no_mere_mode() {
    let (mut world, mut flight) = (World::airborne(Px4Mode::LOITER), Flight::default());
    world.vehicle.telemetry.target = None;
    let answers = command(&mut world, &mut flight, select(Mode::Loiter));
    assert_eq!(answers, [AckType::Received]);
    assert_eq!(world.commanded_modes(), []);
}
