//! Areas of the configuration and of a CUCS, and the routes that wait for them.

use stanag_msgs::enums::{AreaPlanMode, AreaType};
use stanag_msgs::messages::{AreaTransferCommand, AreaVertex};

use super::*;

#[test]
fn the_fence_of_the_configuration_is_uploaded_and_watched_without_a_command() {
    let mut world = World::new();
    let items = fence_items(&circle());
    let mut mission = Mission::new(vec![circle()], Vec::new());
    assert_eq!(mission.poll_timeout(), None);
    handle(&mut world, &mut mission, Input::LinkUp);
    let due = mission.poll_timeout().expect("the comparison");
    world.advance(due.saturating_sub(world.now.mono));
    handle(&mut world, &mut mission, Input::WatchFence);
    let id = transferred(&mut world, &mut mission, FENCE, &items);
    assert!(mission.view(&world.vehicle, &world.services).fence_busy);
    world.vehicle.telemetry.mission = named(0, id);
    handle(&mut world, &mut mission, Input::WatchFence);
    assert!(!mission.view(&world.vehicle, &world.services).fence_busy);
    assert_eq!(mission.poll_timeout(), None);
    // Another station changes it.
    world.sent_to(0);
    world.vehicle.telemetry.mission = named(0, id + 1);
    handle(&mut world, &mut mission, Input::WatchFence);
    let (_, texts) = reports(&mut world);
    assert!(texts.contains("is not the loaded one"), "{texts}");
}

/// PX4 takes a route that its fence forbids while it has no fence yet, and the 13000 would be answered as complete.
#[test]
fn a_route_is_sent_once_the_areas_of_the_configuration_are_aboard() {
    // The 13000 comes before the upload of the areas has begun, or during it.
    for early in [true, false] {
        let (mut world, mut mission) = ready();
        mission.fence = Fence::new(vec![circle()]);
        let items = compiled(&mut world, &mission);
        handle(&mut world, &mut mission, Input::LinkUp);
        if early {
            command(&mut world, &mut mission, transfer(Mode::Load));
            assert_eq!(answers(&mut world), [AckType::Received]);
            assert_eq!(world.services.missions.busy(), None, "it waits");
            let due = mission.poll_timeout().expect("the comparison");
            assert!(due > world.now.mono && due < world.now.mono + 4 * SECOND);
        }
        world.advance(4 * SECOND);
        handle(&mut world, &mut mission, Input::WatchFence);
        if !early {
            command(&mut world, &mut mission, transfer(Mode::Load));
            assert_eq!(answers(&mut world), [AckType::Received]);
        }
        let fence_id = transferred(&mut world, &mut mission, FENCE, &fence_items(&circle()));
        assert_eq!(world.services.missions.busy(), None, "it is not named yet");
        world.vehicle.telemetry.mission = named(0, fence_id);
        handle(&mut world, &mut mission, Input::WatchFence);
        handle(&mut world, &mut mission, Input::Advance);
        let id = transferred(&mut world, &mut mission, MISSION, &items);
        world.vehicle.telemetry.mission = named(id, fence_id);
        handle(&mut world, &mut mission, Input::Advance);
        assert!(mission.transfers.is_running(), "it is not judged yet");
    }
}

#[test]
fn a_route_is_refused_where_the_areas_of_the_configuration_are_not_uploaded() {
    let (mut world, mut mission) = ready();
    mission.fence = Fence::new(vec![circle()]);
    handle(&mut world, &mut mission, Input::LinkUp);
    command(&mut world, &mut mission, transfer(Mode::Load));
    world.advance(4 * SECOND);
    handle(&mut world, &mut mission, Input::WatchFence);
    upload_fails(&mut world, &mut mission, FENCE);
    let refused = |world: &mut World| {
        let (progress, texts) = reports(world);
        assert_eq!(progress.last(), Some(&(Status::Aborted, 0)));
        assert!(texts.contains("not known to hold its fence"), "{texts}");
    };
    refused(&mut world);
    // Until it is tried again.
    command(&mut world, &mut mission, transfer(Mode::Load));
    refused(&mut world);
    world.advance(31 * SECOND);
    handle(&mut world, &mut mission, Input::WatchFence);
    let fence_id = transferred(&mut world, &mut mission, FENCE, &fence_items(&circle()));
    world.vehicle.telemetry.mission = named(0, fence_id);
    handle(&mut world, &mut mission, Input::WatchFence);
    command(&mut world, &mut mission, transfer(Mode::Load));
    assert_eq!(world.services.missions.busy(), Some(Operation::Upload));
}

/// With nobody in control the vehicle would fly on while its contingency route waits for the fence.
#[test]
fn the_vsm_begins_no_route_by_itself_before_the_vehicle_holds_its_fence() {
    let (mut world, mut mission) = ready();
    stored(&mut world, &mut mission);
    mission.fence = Fence::new(vec![circle()]);
    let may_change =
        |world: &World, mission: &Mission| mission.view(&world.vehicle, &world.services).may_change;
    let by_itself = || Input::LoadAndFly {
        origin: None,
        route_type: Some(RouteType::Flight),
        command: Box::default(),
    };
    handle(&mut world, &mut mission, Input::LinkUp);
    assert!(may_change(&world, &mission).is_err(), "it is compared");
    handle(&mut world, &mut mission, by_itself());
    assert!(!mission.transfers.is_running());
    world.advance(4 * SECOND);
    handle(&mut world, &mut mission, Input::WatchFence);
    assert_eq!(may_change(&world, &mission), Err(BUSY));
    let fence_id = transferred(&mut world, &mut mission, FENCE, &fence_items(&circle()));
    world.vehicle.telemetry.mission = named(0, fence_id);
    handle(&mut world, &mut mission, Input::WatchFence);
    assert_eq!(may_change(&world, &mission), Ok(()));
    handle(&mut world, &mut mission, by_itself());
    assert!(mission.transfers.is_running());
}

#[test]
fn a_lost_mission_is_sent_again_once_the_fence_is_aboard() {
    let (mut world, mut mission, id) = holds_the_loaded_one();
    mission.fence = Fence::new(vec![circle()]);
    // The vehicle has restarted without anything aboard, and does not take the fence at once.
    world.vehicle.telemetry.mission = named(id + 1, 0);
    assert_eq!(looked(&mut world, &mut mission), Some(Operation::Upload));
    upload_fails(&mut world, &mut mission, FENCE);
    handle(&mut world, &mut mission, Input::CompareWithVehicle);
    assert!(!mission.transfers.is_running());
    world.advance(31 * SECOND);
    handle(&mut world, &mut mission, Input::WatchFence);
    let fence_id = transferred(&mut world, &mut mission, FENCE, &fence_items(&circle()));
    world.vehicle.telemetry.mission = named(id + 1, fence_id);
    handle(&mut world, &mut mission, Input::WatchFence);
    handle(&mut world, &mut mission, Input::CompareWithVehicle);
    assert!(mission.transfers.is_running());
}

/// The load of a mode waits for areas of a CUCS too, and refuses where the vehicle is lost meanwhile.
#[test]
fn a_route_for_a_mode_waits_for_the_areas_of_a_cucs_until_the_vehicle_is_silent() {
    let (mut world, mut mission) = ready();
    stored(&mut world, &mut mission);
    load_areas(&mut world, &mut mission);
    let fence_id = transferred(&mut world, &mut mission, FENCE, &fence_items(&circle()));
    world.vehicle.telemetry.mission = named(0, fence_id);
    handle(&mut world, &mut mission, Input::WatchFence);
    // The vehicle may have restarted without them.
    handle(&mut world, &mut mission, Input::LinkUp);
    let input = load_and_fly(Some(RouteType::Flight));
    handle(&mut world, &mut mission, input);
    handle(&mut world, &mut mission, Input::Advance);
    assert_eq!(world.services.missions.busy(), None, "it waits");
    answers(&mut world);
    world.vehicle.set_silent();
    handle(&mut world, &mut mission, Input::Advance);
    assert_eq!(answers(&mut world), [AckType::Refused]);
}

/// PX4 leaves such an area out, and keeps the rest under the id of the whole.
#[test]
fn an_area_that_home_breaches_is_uploaded_once_home_is_within_it() {
    let (mut world, mut mission) = ready();
    let place = |latitude| Place {
        latitude,
        longitude: 8.0,
        amsl_m: 400.0,
    };
    world.vehicle.telemetry.home = Some(place(47.1));
    mission.set_areas(vec![circle()], world.now.mono);
    handle(&mut world, &mut mission, Input::WatchFence);
    assert_eq!(world.services.missions.busy(), None);
    let (_, texts) = reports(&mut world);
    assert!(texts.contains("home is currently outside it"), "{texts}");
    command(&mut world, &mut mission, transfer(Mode::Load));
    let (progress, texts) = reports(&mut world);
    assert_eq!(progress.last(), Some(&(Status::Aborted, 0)));
    assert!(texts.contains("not known to hold its fence"), "{texts}");
    world.vehicle.telemetry.home = Some(place(47.0));
    world.advance(31 * SECOND);
    handle(&mut world, &mut mission, Input::WatchFence);
    let id = transferred(&mut world, &mut mission, FENCE, &fence_items(&circle()));
    world.vehicle.telemetry.mission = named(0, id);
    handle(&mut world, &mut mission, Input::WatchFence);
    assert_eq!(mission.fence.id(), Some(id));
    // What is aboard is judged no more.
    world.vehicle.telemetry.home = Some(place(47.1));
    handle(&mut world, &mut mission, Input::LinkUp);
    world.advance(4 * SECOND);
    handle(&mut world, &mut mission, Input::WatchFence);
    assert_eq!(mission.fence.id(), Some(id));
}

#[test]
fn an_area_that_leaves_the_configuration_during_its_upload_is_cleared() {
    let mut world = World::new();
    let items = fence_items(&circle());
    let mut mission = Mission::new(Vec::new(), Vec::new());
    mission.set_areas(vec![circle()], world.now.mono);
    handle(&mut world, &mut mission, Input::WatchFence);
    assert_eq!(world.services.missions.busy(), Some(Operation::Upload));
    mission.set_areas(Vec::new(), world.now.mono);
    let id = transferred(&mut world, &mut mission, FENCE, &items);
    world.vehicle.telemetry.mission = named(0, id);
    // The upload is finished, then the change is due.
    handle(&mut world, &mut mission, Input::WatchFence);
    handle(&mut world, &mut mission, Input::WatchFence);
    let cleared = Event::Cleared { kind: FENCE };
    ended(&mut world, &mut mission, Operation::Clear, cleared);
    world.vehicle.telemetry.mission = named(0, 0);
    handle(&mut world, &mut mission, Input::WatchFence);
    assert_eq!(world.services.missions.busy(), None);
    assert_eq!(mission.poll_timeout(), None);
}

#[test]
fn a_comparison_of_the_fence_that_a_silent_vehicle_delays_wakes_nobody() {
    let mut world = World::new();
    let mut mission = Mission::new(vec![circle()], Vec::new());
    handle(&mut world, &mut mission, Input::LinkUp);
    world.vehicle = VehicleState::default();
    world.advance(10 * SECOND);
    assert!(
        mission
            .poll_timeout()
            .is_some_and(|due| due < world.now.mono)
    );
    handle(&mut world, &mut mission, Input::WatchFence);
    assert_eq!(mission.poll_timeout(), None);
    world.vehicle.set_live();
    handle(&mut world, &mut mission, Input::WatchFence);
    assert_eq!(world.services.missions.busy(), Some(Operation::Upload));
}

/// Its first upload, and a clearing that is cut off too. The same of areas of a CUCS.
#[test]
fn areas_that_a_restart_in_the_middle_of_their_upload_takes_away_are_cleared() {
    for configured in [true, false] {
        let mut world = World::new();
        world.vehicle.telemetry.mission = named(0, 0);
        let areas = configured.then(circle).into_iter().collect();
        let mut before = Mission::new(areas, Vec::new());
        if !configured {
            load_areas(&mut world, &mut before);
        }
        let busy = looked(&mut world, &mut before);
        assert_eq!(busy, Some(Operation::Upload), "{configured}");
        for _ in 0..2 {
            let mut after = restarted(&mut world);
            let busy = looked(&mut world, &mut after);
            assert_eq!(busy, Some(Operation::Clear), "{configured}");
        }
        let mut after = restarted(&mut world);
        looked(&mut world, &mut after);
        let cleared = Event::Cleared { kind: FENCE };
        ended(&mut world, &mut after, Operation::Clear, cleared);
        let mut once = restarted(&mut world);
        assert_eq!(looked(&mut world, &mut once), None, "{configured}");
    }
}

/// At another field, with a vehicle that holds them no longer.
#[test]
fn areas_that_the_vehicle_breaches_after_a_restart_are_named_with_what_clears_them() {
    let (mut world, mut mission) = (World::new(), Mission::new(Vec::new(), Vec::new()));
    load_areas(&mut world, &mut mission);
    let id = transferred(&mut world, &mut mission, FENCE, &fence_items(&circle()));
    world.vehicle.telemetry.mission = named(0, id);
    handle(&mut world, &mut mission, Input::WatchFence);
    assert!(answers(&mut world).contains(&AckType::CarriedOut));
    let elsewhere = Some(Place {
        latitude: 48.0,
        longitude: 8.0,
        amsl_m: 400.0,
    });
    world.vehicle.telemetry.home = elsewhere;
    world.vehicle.telemetry.position = elsewhere;
    world.vehicle.telemetry.mission = named(0, 0);
    let unfenced = |world: &World, mission: &Mission| {
        let view = mission.view(&world.vehicle, &world.services);
        view.unfenced.map(str::to_owned)
    };
    let mut of_the_file = Mission::new(vec![circle()], Vec::new());
    assert_eq!(looked(&mut world, &mut of_the_file), None);
    let why = unfenced(&world, &of_the_file).expect("a reason");
    assert!(why.starts_with("area 1 of the configuration: "), "{why}");
    assert!(why.contains("vehicle.area"), "{why}");

    let mut after = restarted(&mut world);
    assert_eq!(looked(&mut world, &mut after), None, "PX4 leaves it out");
    let why = unfenced(&world, &after).expect("a reason");
    assert!(
        why.starts_with("area 1: the vehicle is currently outside it"),
        "{why}"
    );
    assert!(why.contains("clear them (50017"), "{why}");
    let (_, texts) = reports(&mut world);
    assert!(texts.contains("not uploaded: area 1: "), "{texts}");
    let clear = AreaTransferCommand {
        area_plan_mode: Some(AreaPlanMode::Clear),
        ..AreaTransferCommand::default()
    };
    command(&mut world, &mut after, clear);
    let cleared = Event::Cleared { kind: FENCE };
    ended(&mut world, &mut after, Operation::Clear, cleared);
    assert_eq!(unfenced(&world, &after), None);
}

/// 50016 and 50017 of a CUCS.
fn load_areas(world: &mut World, mission: &mut Mission) {
    let centre = AreaVertex {
        area_id: Some(1),
        area_type: Some(AreaType::KeepInCircle),
        vertex_count: Some(1),
        vertex_number: Some(1),
        latitude: Some(Bam32::from_degrees(47.0)),
        longitude: Some(Bam32::from_degrees(8.0)),
        radius: Some(500.0),
        ..AreaVertex::default()
    };
    command(world, mission, centre);
    let load = AreaTransferCommand {
        area_plan_mode: Some(AreaPlanMode::Load),
        ..AreaTransferCommand::default()
    };
    command(world, mission, load);
    assert_eq!(world.services.missions.busy(), Some(Operation::Upload));
}

/// What the vehicle holds after a failed upload is known only where it has requested no item: then its own areas are left alone.
#[test]
fn areas_whose_upload_fails_are_cleared_where_the_vehicle_may_hold_some() {
    for requested in [false, true] {
        let (mut world, mut mission) = (World::new(), Mission::new(Vec::new(), Vec::new()));
        load_areas(&mut world, &mut mission);
        if requested {
            let progress = Event::Progress {
                operation: Operation::Upload,
                done: 0,
                total: 1,
                percent: 0,
            };
            handle(&mut world, &mut mission, Input::ServiceEnded(progress));
        }
        upload_fails(&mut world, &mut mission, FENCE);
        assert!(answers(&mut world).contains(&AckType::Refused));
        let expected = requested.then_some(Operation::Clear);
        world.advance(31 * SECOND);
        handle(&mut world, &mut mission, Input::WatchFence);
        assert_eq!(world.services.missions.busy(), expected);
        let mut after = restarted(&mut world);
        assert_eq!(looked(&mut world, &mut after), expected);
    }
}
