//! The mission that the vehicle holds: its end, another in its place, and whether PX4 can fly it.

use mapping::telemetry::LandedState;

use super::*;

/// The vehicle takes this area of the configuration, and has read it; returns the id of its fence.
fn bounded(world: &mut World, mission: &mut Mission, area: Area) -> u32 {
    let items = fence_items(&area);
    mission.set_areas(vec![area], world.now.mono);
    handle(world, mission, Input::WatchFence);
    let id = transferred(world, mission, FENCE, &items);
    world.vehicle.telemetry.mission = named(0, id);
    handle(world, mission, Input::WatchFence);
    assert!(!mission.fence.busy());
    world.advance(2 * SECOND);
    id
}

#[test]
fn the_end_of_a_route_is_stored_once_the_disk_takes_it_and_known_after_a_restart() {
    let (mut world, mut mission) = ready();
    let items = compiled(&mut world, &mission);
    command(&mut world, &mut mission, transfer(Mode::Load));
    let id = transferred(&mut world, &mut mission, MISSION, &items);
    world.vehicle.telemetry.mission = named(id, 0);
    handle(&mut world, &mut mission, Input::Advance);
    assert!(mission.uploaded().is_some());
    let last = u16::try_from(items.len() - 1).expect("a short route");
    let reports_item = |world: &mut World, mission: &mut Mission, mode, state| {
        world.show_mode(mode);
        let progress = named(id, 0).expect("a mission");
        world.vehicle.telemetry.mission = Some(MissionProgress {
            seq: last,
            state,
            ..progress
        });
        // What was reached counts from the next report on.
        for _ in 0..2 {
            handle(world, mission, Input::WatchProgress);
        }
    };
    let (flown, landing) = (
        mapping::mode::Px4Mode::MISSION,
        mapping::mode::Px4Mode::LAND,
    );
    let (active, complete) = (
        MissionState::MISSION_STATE_ACTIVE,
        MissionState::MISSION_STATE_COMPLETE,
    );
    reports_item(&mut world, &mut mission, flown, active);
    assert!(!restarted(&mut world).progress.has_ended());

    world.vehicle.telemetry.reached = Some(last);
    world.fill_disk();
    reports_item(&mut world, &mut mission, flown, complete);
    let text = "that the route was flown to its end cannot be stored";
    let alerts = |world: &World| {
        let standing = world.alerts.standing();
        standing.filter(|one| one.text.contains(text)).count()
    };
    assert_eq!(alerts(&world), 1);
    world.disk = Box::new(mavlink_link::store::MemoryDisk::default());
    reports_item(&mut world, &mut mission, flown, complete);
    assert!(!restarted(&mut world).store.ended, "not at each report");
    world.advance(SECOND);
    reports_item(&mut world, &mut mission, landing, active);
    let mut after = restarted(&mut world);
    reports_item(&mut world, &mut after, landing, active);
    let is_over = |world: &World, mission: &Mission| {
        let uploaded = mission.uploaded().expect("it carries one");
        let progress = &mission.progress;
        progress.is_over(&uploaded.compiled, &world.vehicle.telemetry)
    };
    assert!(is_over(&world, &after));

    // It is flown again.
    reports_item(&mut world, &mut after, flown, active);
    assert!(!is_over(&world, &after));
    assert!(!restarted(&mut world).progress.has_ended());
}

#[test]
fn a_returned_vehicle_with_another_mission_is_sent_the_loaded_one_again() {
    let (mut world, mut mission, id) = holds_the_loaded_one();
    world.vehicle.telemetry.mission = named(id + 1, 0);
    handle(&mut world, &mut mission, Input::CompareWithVehicle);
    assert!(!mission.transfers.is_running(), "it has not been away");
    handle(&mut world, &mut mission, Input::LinkUp);
    handle(&mut world, &mut mission, Input::CompareWithVehicle);
    assert!(mission.transfers.is_running());
    assert!(
        reports(&mut world)
            .1
            .contains("the loaded one is sent again")
    );
    handle(&mut world, &mut mission, Input::Advance);
    assert_eq!(world.services.missions.busy(), Some(Operation::Upload));
}

/// PX4 would fly it at once, from the item that it has reached in the other.
#[test]
fn the_loaded_mission_is_sent_again_in_auto_mission_only_on_the_ground() {
    for (landed, sent) in [
        (Some(LandedState::OnGround), true),
        (Some(LandedState::InAir), false),
        (None, false),
    ] {
        let (mut world, mut mission, id) = holds_the_loaded_one();
        world.show_mode(mapping::mode::Px4Mode::MISSION);
        world.vehicle.telemetry.landed = landed;
        world.vehicle.telemetry.mission = named(id + 1, 0);
        handle(&mut world, &mut mission, Input::LinkUp);
        handle(&mut world, &mut mission, Input::CompareWithVehicle);
        assert_eq!(mission.transfers.is_running(), sent, "{landed:?}");
    }
}

/// PX4 names items, counted from 1, and nothing where it has judged the route before.
#[test]
fn an_infeasible_route_is_refused_with_the_waypoint_of_the_station() {
    for (complaints, waypoint, expected) in [
        (
            &["Geofence violation for waypoint 1"][..],
            1,
            "(Geofence violation for waypoint 1); item 1 of the vehicle's mission is waypoint 1",
        ),
        (
            &[][..],
            2,
            "finds the route infeasible: waypoint 2 breaches the fence",
        ),
        (
            &["High wind speed detected"][..],
            2,
            "(High wind speed detected): waypoint 2 breaches the fence",
        ),
    ] {
        let (mut world, mut mission) = ready();
        let around_the_first = Shape::Circle {
            centre: (47.0, 8.0),
            radius_m: 15.0,
        };
        let area = Area {
            keep_in: true,
            shape: around_the_first,
        };
        let fence_id = bounded(&mut world, &mut mission, area);
        let items = compiled(&mut world, &mission);
        command(&mut world, &mut mission, transfer(Mode::Load));
        let id = transferred(&mut world, &mut mission, MISSION, &items);
        for complaint in complaints {
            world.vehicle.complain(world.now.mono, complaint);
        }
        let found = named(id, fence_id).map(|mission| MissionProgress {
            state: MissionState::MISSION_STATE_NO_MISSION,
            ..mission
        });
        world.sent_to(0);
        world.advance(6 * SECOND);
        world.vehicle.show_progress(world.now.mono, found);
        handle(&mut world, &mut mission, Input::Advance);
        let sent = world.sent_to(0);
        let requested = sent.iter().find_map(|message| match message {
            Message::MissionUploadDownloadStatus(report) => report.waypoint_request,
            _ => None,
        });
        assert_eq!(requested, Some(waypoint));
        // A long text comes in parts.
        let parts = sent.iter().filter_map(|message| match message {
            Message::SubsystemStatusAlert(alert) => alert.text.as_ref().map(|text| text.as_str()),
            _ => None,
        });
        let texts: String = parts.collect();
        assert!(texts.contains(expected), "{texts}");
    }
}

/// On the ground PX4 judges its mission again on entering AUTO.MISSION, so that only a breach of the fence is sure to stay.
#[test]
fn a_route_aboard_is_infeasible_on_the_ground_only_where_it_breaches_the_fence() {
    let (mut world, mut mission) = ready();
    world.vehicle.telemetry.position = world.vehicle.telemetry.home;
    let fence_id = bounded(&mut world, &mut mission, circle());
    let items = compiled(&mut world, &mission);
    command(&mut world, &mut mission, transfer(Mode::Load));
    let id = transferred(&mut world, &mut mission, MISSION, &items);
    let now = world.now.mono;
    world.vehicle.show_progress(now, named(id, fence_id));
    handle(&mut world, &mut mission, Input::Advance);
    assert!(mission.uploaded().is_some());
    let found = |world: &mut World, mission: &mut Mission, fence_id| {
        let found = named(id, fence_id).map(|progress| MissionProgress {
            state: MissionState::MISSION_STATE_NO_MISSION,
            ..progress
        });
        world.vehicle.show_progress(world.now.mono, found);
        // Every datagram has it looked at; the alert stays as it is.
        for _ in 0..2 {
            handle(world, mission, Input::WatchProgress);
        }
        let (ground, air) = (Some(LandedState::OnGround), Some(LandedState::InAir));
        let refusals = [ground, air, None].map(|landed| {
            world.vehicle.telemetry.landed = landed;
            let view = mission.view(&world.vehicle, &world.services);
            view.why_infeasible(&world.vehicle.telemetry)
        });
        let mut texts = world.alerts.standing().map(|alert| alert.text.clone());
        let alert = texts.find(|text| text.contains("infeasible"));
        (refusals, alert)
    };
    let (refusals, alert) = found(&mut world, &mut mission, fence_id);
    let text = alert.expect("it stands");
    assert!(!text.contains("fence"), "{text}");
    assert_eq!(refusals, [None, Some(text.clone()), Some(text)]);

    let around_the_first = Area {
        keep_in: true,
        shape: Shape::Circle {
            centre: (47.0, 8.0),
            radius_m: 15.0,
        },
    };
    let fence_id = bounded(&mut world, &mut mission, around_the_first);
    let (refusals, alert) = found(&mut world, &mut mission, fence_id);
    let text = alert.expect("it stands");
    assert!(text.contains("(waypoint 2 breaches it)"), "{text}");
    assert_eq!(refusals, [(); 3].map(|()| Some(text.clone())));

    // The vehicle may have restarted: it judges its mission once it has read its fence again.
    handle(&mut world, &mut mission, Input::LinkUp);
    let (refusals, _) = found(&mut world, &mut mission, fence_id);
    assert_eq!(refusals, [None, None, None]);
    world.advance(2 * SECOND);
    let (refusals, _) = found(&mut world, &mut mission, fence_id);
    assert!(refusals.iter().all(Option::is_some), "{refusals:?}");
}

/// What they find is announced with a hold, and nothing else is commanded while a flight termination holds.
#[test]
fn the_watches_of_a_mission_judge_nothing_while_a_flight_termination_holds() {
    for holds in [false, true] {
        let (mut world, mut mission) = ready();
        flying_to_a_landing(&mut world, &mut mission);
        world.vehicle.telemetry.landed = Some(LandedState::InAir);
        world.termination.holds = holds;
        let uploaded = mission.uploaded().expect("aboard");
        let judged = world.act(|common, views, _| {
            let context = Context {
                common,
                flight: views.flight,
                parameters: views.parameters,
                rights: views.rights,
            };
            watchdog::flown(&context, uploaded).is_some()
        });
        assert_eq!(judged, !holds);
    }
}
