//! A route is loaded (13000), or uploaded for a mode; how that ends, and what the vehicle then holds.

use super::*;
use crate::session::context::FlightView;
use crate::session::effects::Request;

/// The vehicle takes the first of two items.
fn first_item_taken(world: &mut World, mission: &mut Mission) {
    let progress = Event::Progress {
        operation: Operation::Upload,
        done: 1,
        total: 2,
        percent: 50,
    };
    handle(world, mission, Input::ServiceEnded(progress));
}

#[test]
fn a_route_is_loaded_once_the_vehicle_names_it_and_a_restart_finds_it() {
    let (mut world, mut mission) = ready();
    let items = compiled(&mut world, &mission);
    command(&mut world, &mut mission, transfer(Mode::Load));
    let id = transferred(&mut world, &mut mission, MISSION, &items);
    assert!(mission.uploaded().is_none(), "MISSION_CURRENT is awaited");
    assert_eq!(mission.poll_timeout(), Some(world.now.mono + 5 * SECOND));
    let (progress, _) = reports(&mut world);
    let begun = [0, 0, 50].map(|percent| (Status::InProgress, percent));
    assert_eq!(progress, begun);

    world.vehicle.telemetry.mission = named(id, 0);
    handle(&mut world, &mut mission, Input::Advance);
    assert_eq!(reports(&mut world).0, [(Status::Complete, 100)]);
    let view = mission.view(&world.vehicle, &world.services);
    assert_eq!(view.uploaded.map(|route| route.mission_id), Some(id));
    assert_eq!(view.loaded, view.uploaded);
    assert_eq!(mission.poll_timeout(), None);

    let mut found = Mission::new(Vec::new(), Vec::new());
    let restored = world.act(|_, _, effects| found.restore(effects));
    restored.expect("the records are read");
    assert!(!found.store.plan().is_empty());
    assert_eq!(found.store.plan(), mission.store.plan());
    let notes = |route: Option<&UploadedMission>| {
        let mut route = route.expect("it is there").clone();
        route.compiled.notes.clear();
        route
    };
    assert_eq!(notes(found.uploaded()), notes(mission.uploaded()));
}

#[test]
fn a_load_that_changes_a_contingency_route_by_its_waypoint_numbers_is_named() {
    let (mut world, mut mission) = ready();
    let home = UaRoute {
        time_stamp: Some(TimeStamp(5)),
        initial_waypoint_number: Some(2),
        route_id: Some(Text::new("HOME")),
        route_type: Some(RouteType::ContingencyA),
        ..UaRoute::default()
    };
    command(&mut world, &mut mission, home);
    stored(&mut world, &mut mission);
    assert_eq!(
        reports(&mut world).1,
        "",
        "the first of them changes nothing"
    );
    let moved = |number, next, metres| UaPositionWaypoint {
        time_stamp: Some(TimeStamp(10)),
        waypoint_number: Some(number),
        waypoint_to_altitude: Some(Scaled::saturating_from_si(metres)),
        next_waypoint: Some(next),
        ..UaPositionWaypoint::default()
    };
    let new = UaRoute {
        time_stamp: Some(TimeStamp(9)),
        initial_waypoint_number: Some(1),
        route_id: Some(Text::new("NEW")),
        ..UaRoute::default()
    };
    command(&mut world, &mut mission, new);
    command(&mut world, &mut mission, moved(2, 3, 60.0));
    command(&mut world, &mut mission, moved(3, 0, 60.0));
    assert_eq!(
        reports(&mut world).1,
        "",
        "nothing is changed before the load"
    );
    stored(&mut world, &mut mission);
    let (_, text) = reports(&mut world);
    assert!(text.contains("changed contingency A route HOME"), "{text}");
    assert!(text.contains("waypoint numbers: 2, 3; send"), "{text}");
}

#[test]
fn a_vehicle_that_holds_something_else_than_was_sent_carries_nothing() {
    let (mut world, mut mission) = ready();
    let items = compiled(&mut world, &mission);
    command(&mut world, &mut mission, transfer(Mode::Load));
    let uploaded = Event::Uploaded {
        kind: MISSION,
        opaque_id: 1,
    };
    ended(&mut world, &mut mission, Operation::Upload, uploaded);
    let downloaded = Event::Downloaded {
        kind: MISSION,
        items: items[1..].to_vec(),
        opaque_id: 1,
    };
    ended(&mut world, &mut mission, Operation::Download, downloaded);
    let (progress, texts) = reports(&mut world);
    assert_eq!(progress.last(), Some(&(Status::Aborted, 0)));
    assert!(texts.contains("the vehicle holds another plan"), "{texts}");
    assert!(!mission.transfers.is_running() && mission.uploaded().is_none());
}

#[test]
fn a_mode_command_flies_once_its_route_is_uploaded_unless_it_was_dropped() {
    for dropped in [false, true] {
        let (mut world, mut mission) = ready();
        stored(&mut world, &mut mission);
        let items = compiled(&mut world, &mission);
        let input = load_and_fly(Some(RouteType::Flight));
        handle(&mut world, &mut mission, input);
        // A mode on its way in must be seen first, and what waits for that needs no time.
        world.maneuver = true;
        handle(&mut world, &mut mission, Input::Advance);
        assert_eq!(world.services.missions.busy(), None);
        assert_eq!(mission.poll_timeout(), None);
        world.maneuver = false;
        handle(&mut world, &mut mission, Input::Advance);
        world.controller = dropped
            .then_some(stanag_msgs::Id(CUCS.0 + 1))
            .or(Some(CUCS));
        let why = "another controls".to_owned();
        let drop = Input::DropWaitingCommand {
            why,
            without_right: true,
        };
        handle(&mut world, &mut mission, drop);
        let id = transferred(&mut world, &mut mission, MISSION, &items);
        world.vehicle.telemetry.mission = named(id, 0);
        handle(&mut world, &mut mission, Input::Advance);
        let flown = world.requests.iter().any(|request| {
            matches!(
                request,
                Request::Fly {
                    just_loaded: true,
                    ..
                }
            )
        });
        assert_eq!(flown, !dropped);
        let refused = answers(&mut world).contains(&AckType::Refused);
        assert_eq!(refused, dropped);
        // Only 13000 loads.
        assert!(mission.uploaded().is_some() && mission.store.loaded.is_none());
    }
}

/// Requested before the final approach, and begun on it: a hold would circle the wing as low as it has come.
#[test]
fn a_load_that_waited_takes_no_wing_off_its_final_approach() {
    for on_final in [false, true] {
        let (mut world, mut mission) = ready();
        flying_to_a_landing(&mut world, &mut mission);
        // Another mission, as 13000 has loaded it.
        let mut loaded = mission.store.uploaded.clone().expect("aboard");
        loaded.compiled.items.truncate(1);
        mission.store.loaded = Some(loaded);
        let input = load_and_fly(None);
        world.maneuver = true;
        handle(&mut world, &mut mission, input);
        handle(&mut world, &mut mission, Input::Advance);
        if on_final && let Some(progress) = &mut world.vehicle.telemetry.mission {
            progress.seq = 1;
        }
        // What was commanded before may be entered yet: another plan would be flown at once.
        world.maneuver = false;
        world.command_was_sent();
        handle(&mut world, &mut mission, Input::Advance);
        assert_eq!(world.commanded_modes(), []);
        world.show_mode(mapping::mode::Px4Mode::MISSION);
        for _ in 0..2 {
            handle(&mut world, &mut mission, Input::Advance);
        }
        let expected: &[mapping::mode::Px4Mode] = if on_final {
            &[]
        } else {
            &[mapping::mode::Px4Mode::LOITER]
        };
        assert_eq!(world.commanded_modes(), expected);
        let refused = answers(&mut world).contains(&AckType::Refused);
        assert_eq!(refused, on_final);
        let view = mission.view(&world.vehicle, &world.services);
        assert_eq!(view.waiting_command().is_none(), on_final);
    }
}

/// PX4 takes the last item, and the cancellation comes a moment later.
#[test]
fn a_vehicle_that_holds_a_route_whose_load_was_cancelled_or_failed_is_named_once() {
    for (cancelled, taken) in [(true, true), (true, false), (false, true)] {
        let (mut world, mut mission) = ready();
        let id = plan_id(&compiled(&mut world, &mission));
        world.vehicle.telemetry.mission = named(id + 1, 0);
        command(&mut world, &mut mission, transfer(Mode::Load));
        first_item_taken(&mut world, &mut mission);
        handle(&mut world, &mut mission, Input::CompareWithVehicle);
        if cancelled {
            command(&mut world, &mut mission, transfer(Mode::Cancel));
        } else {
            upload_fails(&mut world, &mut mission, MISSION);
        }
        handle(&mut world, &mut mission, Input::CompareWithVehicle);
        let words = "the vehicle holds the route whose load was cancelled or has failed";
        let (_, texts) = reports(&mut world);
        assert!(!texts.contains(words), "it reports another: {texts}");
        world.vehicle.telemetry.mission = named(if taken { id } else { id + 1 }, 0);
        for first in [true, false] {
            handle(&mut world, &mut mission, Input::CompareWithVehicle);
            let (_, texts) = reports(&mut world);
            assert_eq!(texts.contains(words), taken && first, "{texts}");
        }
        assert!(mission.uploaded().is_none());
    }
}

#[test]
fn a_load_that_fails_half_way_says_that_the_earlier_route_is_not_flown() {
    let (mut world, mut mission) = ready();
    let items = compiled(&mut world, &mission);
    command(&mut world, &mut mission, transfer(Mode::Load));
    let id = transferred(&mut world, &mut mission, MISSION, &items);
    world.vehicle.telemetry.mission = named(id, 0);
    handle(&mut world, &mut mission, Input::Advance);
    let is_loaded = |world: &World, mission: &Mission| {
        let view = mission.view(&world.vehicle, &world.services);
        view.loaded.is_some()
    };
    assert!(is_loaded(&world, &mission));
    let higher = UaPositionWaypoint {
        time_stamp: Some(TimeStamp(3)),
        waypoint_number: Some(2),
        waypoint_to_latitude_or_relative_y: Some(Bam32::from_degrees(47.0002)),
        waypoint_to_longitude_or_relative_x: Some(Bam32::from_degrees(8.0)),
        waypoint_to_altitude: Some(Scaled::saturating_from_si(30.0)),
        waypoint_altitude_type: Some(AltitudeType::Agl),
        next_waypoint: Some(0),
        ..UaPositionWaypoint::default()
    };
    command(&mut world, &mut mission, higher);
    command(&mut world, &mut mission, transfer(Mode::Load));
    first_item_taken(&mut world, &mut mission);
    world.sent_to(0);
    upload_fails(&mut world, &mut mission, MISSION);
    assert!(!is_loaded(&world, &mission));
    let (_, texts) = reports(&mut world);
    assert!(
        texts.contains("flies no route before the next load"),
        "{texts}"
    );
}

/// The vehicle has taken the route of the first load, and nothing of the second.
#[test]
fn a_later_load_that_ends_early_too_hides_no_route_that_the_vehicle_holds() {
    let (mut world, mut mission) = ready();
    let id = plan_id(&compiled(&mut world, &mission));
    world.vehicle.telemetry.mission = named(id + 1, 0);
    for first in [true, false] {
        command(&mut world, &mut mission, transfer(Mode::Load));
        if first {
            first_item_taken(&mut world, &mut mission);
        }
        handle(&mut world, &mut mission, Input::CompareWithVehicle);
        upload_fails(&mut world, &mut mission, MISSION);
        handle(&mut world, &mut mission, Input::CompareWithVehicle);
    }
    reports(&mut world);
    for (reported, words) in [
        (id, "the vehicle holds the route whose load"),
        (id, ""),
        (id + 1, "the vehicle no longer holds a route whose load"),
        (id, "the vehicle holds the route whose load"),
    ] {
        world.advance(10 * SECOND);
        world.vehicle.telemetry.mission = named(reported, 0);
        handle(&mut world, &mut mission, Input::CompareWithVehicle);
        let (_, texts) = reports(&mut world);
        assert!(texts.contains(words), "{texts}, expected {words}");
        assert_eq!(texts.is_empty(), words.is_empty(), "{texts}");
    }
}

/// A load for a mode command fails at its read-back: of a route that nobody waits for any more, and of the loaded one.
#[test]
fn a_route_whose_load_for_a_mode_fails_is_named_unless_it_is_the_loaded_one() {
    for is_loaded in [false, true] {
        let (mut world, mut mission) = ready();
        if !is_loaded {
            stored(&mut world, &mut mission);
        }
        let items = compiled(&mut world, &mission);
        let id = plan_id(&items);
        if is_loaded {
            command(&mut world, &mut mission, transfer(Mode::Load));
            transferred(&mut world, &mut mission, MISSION, &items);
            world.vehicle.telemetry.mission = named(id, 0);
            handle(&mut world, &mut mission, Input::Advance);
        }
        assert_eq!(mission.store.loaded.is_some(), is_loaded);
        world.vehicle.telemetry.mission = named(id + 1, 0);
        let input = load_and_fly((!is_loaded).then_some(RouteType::Flight));
        handle(&mut world, &mut mission, input);
        handle(&mut world, &mut mission, Input::Advance);
        if !is_loaded {
            let drop = Input::DropWaitingCommand {
                why: "superseded".to_owned(),
                without_right: false,
            };
            handle(&mut world, &mut mission, drop);
        }
        let uploaded = Event::Uploaded {
            kind: MISSION,
            opaque_id: id,
        };
        ended(&mut world, &mut mission, Operation::Upload, uploaded);
        let downloaded = Event::Downloaded {
            kind: MISSION,
            items: items[1..].to_vec(),
            opaque_id: id,
        };
        ended(&mut world, &mut mission, Operation::Download, downloaded);
        assert!(!mission.transfers.is_running());
        reports(&mut world);
        world.vehicle.telemetry.mission = named(id, 0);
        handle(&mut world, &mut mission, Input::CompareWithVehicle);
        let (_, texts) = reports(&mut world);
        let is_named = texts.contains("the vehicle holds the route whose load");
        assert_eq!(is_named, !is_loaded, "{texts}");
    }
}

/// After a silence a wing may be on its final approach for as long as its item is not known.
#[test]
fn an_upload_is_refused_while_a_wing_may_be_on_its_final_approach() {
    let (mut world, mut mission) = (World::new(), Mission::new(Vec::new(), Vec::new()));
    let message: Message = MissionTransferCommand {
        mission_plan_mode: Some(Mode::Clear),
        ..MissionTransferCommand::default()
    }
    .into();
    for unknown in [true, false] {
        let (now, origin) = (world.now.mono, origin(&message));
        world.act(|common, views, effects| {
            let context = Context {
                common,
                rights: views.rights,
                flight: FlightView {
                    item_unknown_until: unknown.then_some(now + SECOND),
                    ..views.flight
                },
                parameters: views.parameters,
            };
            let message = &message;
            mission.handle(&context, Input::Command { origin, message }, effects);
        });
        let answers = acknowledgements(&world.sent_to(0));
        assert_eq!(answers.contains(&AckType::Refused), unknown, "{answers:?}");
    }
}
