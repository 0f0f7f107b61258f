//! The machine without the others: the vehicle's side is played by the test, event by event.

use mapping::altitude::Altimeter;
use mapping::area::{Holder, Shape};
use mapping::rally::{self, Height};
use mapping::route::{self, Site};
use mapping::telemetry::{LandedState, MissionProgress, Place};
use mavlink_link::dialect::MissionState;
use mavlink_link::service::mission::{
    Event, Failure, Item, MavMissionType, Operation, plan_id, px4_read_back,
};
use stanag_msgs::enums::{
    AltitudeType, AreaPlanMode, AreaType, MissionPlanMode as Mode, MissionTransferStatus as Status,
};
use stanag_msgs::messages::{
    AreaTransferCommand, AreaVertex, MissionTransferCommand, UaPositionWaypoint, UaRoute,
    VehicleOperatingModeCommand,
};
use stanag_msgs::scalar::{Bam32, Scaled};
use stanag_msgs::{Text, TimeStamp};

use super::*;
use crate::session::context::FlightView;
use crate::session::effects::Request;
use crate::session::testing::{CUCS, World, acknowledgements, origin};

const MISSION: MavMissionType = MavMissionType::MAV_MISSION_TYPE_MISSION;
const FENCE: MavMissionType = MavMissionType::MAV_MISSION_TYPE_FENCE;
const RALLY: MavMissionType = MavMissionType::MAV_MISSION_TYPE_RALLY;
const SECOND: Duration = Duration::from_secs(1);

fn handle(world: &mut World, mission: &mut Mission, input: Input<'_>) {
    world.act(|common, views, effects| {
        let context = Context {
            common,
            flight: views.flight,
            parameters: views.parameters,
            rights: views.rights,
        };
        mission.handle(&context, input, effects);
    });
}

fn command(world: &mut World, mission: &mut Mission, message: impl Into<Message>) {
    let message = message.into();
    let input = Input::Command {
        origin: origin(&message),
        message: &message,
    };
    handle(world, mission, input);
    handle(world, mission, Input::Advance);
}

/// The mission service has done what it was busy with.
fn ended(world: &mut World, mission: &mut Mission, operation: Operation, event: Event) {
    assert_eq!(world.services.missions.busy(), Some(operation));
    world.services.missions.cancel();
    while world.services.missions.poll_event().is_some() {}
    handle(world, mission, Input::ServiceEnded(event));
    handle(world, mission, Input::Advance);
}

/// It has taken items, and returns them as PX4 does.
fn transferred(
    world: &mut World,
    mission: &mut Mission,
    kind: MavMissionType,
    items: &[Item],
) -> u32 {
    let opaque_id = plan_id(items);
    let uploaded = Event::Uploaded { kind, opaque_id };
    ended(world, mission, Operation::Upload, uploaded);
    let items = items.iter().map(|item| px4_read_back(kind, item)).collect();
    let downloaded = Event::Downloaded {
        kind,
        items,
        opaque_id,
    };
    ended(world, mission, Operation::Download, downloaded);
    opaque_id
}

/// What MISSION_CURRENT shows.
fn named(mission_id: u32, fence_id: u32) -> Option<MissionProgress> {
    Some(MissionProgress {
        seq: 0,
        total: Some(2),
        state: MissionState::MISSION_STATE_NOT_STARTED,
        mission_id,
        fence_id,
        rally_points_id: 0,
    })
}

/// An area of the configuration.
fn circle() -> Area {
    Area {
        keep_in: true,
        shape: Shape::Circle {
            centre: (47.0, 8.0),
            radius_m: 500.0,
        },
    }
}

/// The items of that area alone.
fn fence_items() -> Vec<Item> {
    let points = mapping::area::fence(&[circle()], &[], &Holder::default()).expect("a fence");
    points.iter().map(|point| point.item).collect()
}

/// The vehicle takes this area of the configuration, and has read it; returns the id of its fence.
fn bounded(world: &mut World, mission: &mut Mission, area: Area) -> u32 {
    let points = mapping::area::fence(std::slice::from_ref(&area), &[], &Holder::default())
        .expect("a fence");
    let items: Vec<Item> = points.iter().map(|point| point.item).collect();
    mission.set_areas(vec![area], world.now.mono);
    handle(world, mission, Input::WatchFence);
    let id = transferred(world, mission, FENCE, &items);
    world.vehicle.telemetry.mission = named(0, id);
    handle(world, mission, Input::WatchFence);
    assert!(!mission.fence.busy());
    world.advance(2 * SECOND);
    id
}

/// What is begun for the fence or the rally points once the vehicle's link is up.
fn looked(world: &mut World, mission: &mut Mission) -> Option<Operation> {
    handle(world, mission, Input::LinkUp);
    world.advance(4 * SECOND);
    handle(world, mission, Input::WatchFence);
    world.services.missions.busy()
}

/// The bridge is killed and starts again, with neither areas nor rally points in its configuration.
fn restarted(world: &mut World) -> Mission {
    world.services.missions.cancel();
    while world.services.missions.poll_event().is_some() {}
    let mut mission = Mission::new(Vec::new(), Vec::new());
    let restored = world.act(|_, _, effects| mission.restore(effects));
    restored.expect("its records");
    mission
}

/// On the ground at home, with a route of two waypoints stored.
fn ready() -> (World, Mission) {
    let (mut world, mut mission) = (World::new(), Mission::new(Vec::new(), Vec::new()));
    world.vehicle.telemetry.home = Some(Place {
        latitude: 47.0,
        longitude: 8.0,
        amsl_m: 400.0,
    });
    let route = UaRoute {
        initial_waypoint_number: Some(1),
        route_id: Some(Text::new("R")),
        ..UaRoute::default()
    };
    command(&mut world, &mut mission, route);
    for (number, next) in [(1, 2), (2, 0)] {
        let north = 47.0 + f64::from(number) * 1e-4;
        let waypoint = UaPositionWaypoint {
            time_stamp: Some(TimeStamp(number.into())),
            waypoint_number: Some(number),
            waypoint_to_latitude_or_relative_y: Some(Bam32::from_degrees(north)),
            waypoint_to_longitude_or_relative_x: Some(Bam32::from_degrees(8.0)),
            waypoint_to_altitude: Some(Scaled::saturating_from_si(20.0)),
            waypoint_altitude_type: Some(AltitudeType::Agl),
            next_waypoint: Some(next),
            ..UaPositionWaypoint::default()
        };
        command(&mut world, &mut mission, waypoint);
    }
    assert_eq!(answers(&mut world), [AckType::CarriedOut; 3]);
    (world, mission)
}

/// As if 13000 had loaded another of its routes.
fn stored(world: &mut World, mission: &mut Mission) {
    let stored = world.act(|_, _, effects| {
        let begun = mission
            .store
            .begin_load(&transfer(Mode::Load), CUCS, effects);
        begun.map(|()| mission.store.upload_loaded(CUCS, effects))
    });
    stored.expect("begun").expect("stored");
}

/// The items that the route is compiled to.
fn compiled(world: &mut World, mission: &Mission) -> Vec<Item> {
    let plan = mission.store.offered(CUCS);
    world.act(|context, views, _| {
        let telemetry = &context.vehicle.telemetry;
        let site = Site {
            home: telemetry.home.expect("it was set"),
            geoid_m: telemetry.geoid_m,
            agl: context.bounds.agl,
            terrain: None,
            altimeter: Altimeter::STANDARD,
            wings: None,
            limits: views.parameters.limits(&context),
            performance: views.parameters.performance(&context),
            curving: context.bounds.curving,
        };
        route::compile(plan, 1, &site).expect("it is valid").items
    })
}

fn transfer(mode: Mode) -> MissionTransferCommand {
    MissionTransferCommand {
        mission_id: Some(Text::new("M")),
        mission_plan_mode: Some(mode),
        ..MissionTransferCommand::default()
    }
}

/// The acknowledgements since the last look.
fn answers(world: &mut World) -> Vec<AckType> {
    acknowledgements(&world.sent_to(0))
}

/// Status and per cent of the 14000s since the last look, and the texts of the alerts.
fn reports(world: &mut World) -> (Vec<(Status, u8)>, String) {
    let (mut reports, mut texts) = (Vec::new(), String::new());
    for message in world.sent_to(0) {
        match message {
            Message::MissionUploadDownloadStatus(report) => {
                reports.extend(report.status.zip(report.percent_complete));
            }
            Message::SubsystemStatusAlert(alert) => {
                texts += alert.text.as_ref().map_or("", |text| text.as_str());
            }
            _ => {}
        }
    }
    (reports, texts)
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
        route_type: Some(stanag_msgs::enums::RouteType::ContingencyA),
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
        let wanted = VehicleOperatingModeCommand::default();
        let message = wanted.clone().into();
        let input = Input::LoadAndFly {
            origin: Some(origin(&message)),
            route_type: Some(stanag_msgs::enums::RouteType::Flight),
            command: Box::new(wanted),
        };
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

/// A wing's mission that ends in a landing, flown now.
fn flying_to_a_landing(world: &mut World, mission: &mut Mission) {
    const NAV_LAND: u16 = 21;
    let item = |command| Item {
        command,
        ..Item::default()
    };
    mission.store.uploaded = Some(UploadedMission {
        compiled: mapping::route::CompiledMission {
            items: vec![item(16), item(NAV_LAND)],
            waypoint_of: vec![1, 2],
            ..mapping::route::CompiledMission::default()
        },
        mission_id: 7,
        route_type: stanag_msgs::enums::RouteType::Flight,
        mission_name: String::new(),
        plan: Plan::default(),
    });
    let telemetry = &mut world.vehicle.telemetry;
    telemetry.vehicle_type = Some(mavlink_link::dialect::MavType::MAV_TYPE_FIXED_WING);
    telemetry.mission = named(7, 0);
    world.show_mode(mapping::mode::Px4Mode::MISSION);
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
        let wanted = VehicleOperatingModeCommand::default();
        let message = wanted.clone().into();
        let input = Input::LoadAndFly {
            origin: Some(origin(&message)),
            route_type: None,
            command: Box::new(wanted),
        };
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

/// The vehicle holds the loaded mission, whose id is returned, and has been compared with it.
fn holds_the_loaded_one() -> (World, Mission, u32) {
    let (mut world, mut mission) = ready();
    let items = compiled(&mut world, &mission);
    handle(&mut world, &mut mission, Input::LinkUp);
    command(&mut world, &mut mission, transfer(Mode::Load));
    let id = transferred(&mut world, &mut mission, MISSION, &items);
    world.vehicle.telemetry.mission = named(id, 0);
    handle(&mut world, &mut mission, Input::Advance);
    handle(&mut world, &mut mission, Input::CompareWithVehicle);
    (world, mission, id)
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

#[test]
fn a_download_sends_eight_messages_and_pauses() {
    let (mut world, mut mission) = ready();
    for number in 10..20 {
        let waypoint = UaPositionWaypoint {
            waypoint_number: Some(number),
            ..UaPositionWaypoint::default()
        };
        command(&mut world, &mut mission, waypoint);
    }
    stored(&mut world, &mut mission);
    world.sent_to(0);
    command(&mut world, &mut mission, transfer(Mode::Download));
    let plan = |messages: Vec<Message>| {
        let plan = |message: &&Message| matches!(message.id(), 13001 | 13002);
        messages.iter().filter(plan).count()
    };
    assert_eq!(plan(world.sent_to(0)), 8);
    handle(&mut world, &mut mission, Input::AdvanceDownload);
    assert_eq!(plan(world.sent_to(0)), 0);
    let due = mission.poll_timeout().expect("a pause");
    world.advance(due.saturating_sub(world.now.mono));
    handle(&mut world, &mut mission, Input::AdvanceDownload);
    assert_eq!(plan(world.sent_to(0)), 5);
    assert_eq!(mission.poll_timeout(), None);
}

#[test]
fn a_download_ends_with_the_removal_of_its_station() {
    for removed in [true, false] {
        let (mut world, mut mission) = ready();
        for number in 10..20 {
            let waypoint = UaPositionWaypoint {
                waypoint_number: Some(number),
                ..UaPositionWaypoint::default()
            };
            command(&mut world, &mut mission, waypoint);
        }
        stored(&mut world, &mut mission);
        command(&mut world, &mut mission, transfer(Mode::Download));
        match removed {
            true => world.stations[0].removed = true,
            false => world.stations.clear(),
        }
        let due = mission.poll_timeout().expect("a pause");
        world.advance(due.saturating_sub(world.now.mono));
        handle(&mut world, &mut mission, Input::AdvanceDownload);
        assert_eq!(mission.poll_timeout(), None);
    }
}

#[test]
fn a_cancel_ends_a_download_and_what_was_sent_is_not_loaded_by_the_next_13000() {
    let (mut world, mut mission) = ready();
    stored(&mut world, &mut mission);
    for number in 10..30 {
        let waypoint = UaPositionWaypoint {
            waypoint_number: Some(number),
            ..UaPositionWaypoint::default()
        };
        command(&mut world, &mut mission, waypoint);
    }
    stored(&mut world, &mut mission);
    command(&mut world, &mut mission, transfer(Mode::Download));
    command(
        &mut world,
        &mut mission,
        UaPositionWaypoint {
            waypoint_number: Some(2),
            next_waypoint: Some(10),
            ..UaPositionWaypoint::default()
        },
    );
    world.sent_to(0);
    command(&mut world, &mut mission, transfer(Mode::Cancel));
    let (progress, texts) = reports(&mut world);
    assert_eq!(progress, [(Status::Aborted, 0), (Status::Complete, 100)]);
    assert!(texts.contains("cancelled"), "{texts}");
    assert_eq!(mission.poll_timeout(), None, "no more of the download");
    command(&mut world, &mut mission, transfer(Mode::Load));
    let (progress, texts) = reports(&mut world);
    assert_eq!(progress, [(Status::Aborted, 0)]);
    assert!(texts.contains("send the whole route"), "{texts}");
    assert!(!mission.transfers.is_running());
    assert_eq!(
        mission
            .store
            .plan()
            .waypoint(2)
            .and_then(|w| w.next_waypoint),
        Some(0)
    );
}

#[test]
fn a_cancelled_clearing_leaves_no_route_that_counts_as_uploaded() {
    let (mut world, mut mission) = ready();
    let items = compiled(&mut world, &mission);
    command(&mut world, &mut mission, transfer(Mode::Load));
    let id = transferred(&mut world, &mut mission, MISSION, &items);
    world.vehicle.telemetry.mission = named(id, 0);
    handle(&mut world, &mut mission, Input::Advance);
    assert!(mission.store.uploaded.is_some());

    command(&mut world, &mut mission, transfer(Mode::Clear));
    assert_eq!(world.services.missions.busy(), Some(Operation::Clear));
    world.sent_to(0);
    command(&mut world, &mut mission, transfer(Mode::Cancel));
    let (progress, _) = reports(&mut world);
    assert_eq!(progress, [(Status::Aborted, 0), (Status::Complete, 100)]);
    // MISSION_CLEAR_ALL was sent: the vehicle may hold nothing. What was loaded can be uploaded again.
    assert!(mission.store.uploaded.is_none());
    assert!(mission.store.loaded.is_some());
    let mut after = Mission::new(Vec::new(), Vec::new());
    world.act(|_, _, effects| after.store.restore(effects).expect("it is read"));
    assert!(after.store.uploaded.is_none());
}

/// PX4 takes the last item, and the cancellation comes a moment later.
#[test]
fn a_vehicle_that_holds_a_route_whose_load_was_cancelled_or_failed_is_named_once() {
    for (cancelled, taken) in [(true, true), (true, false), (false, true)] {
        let (mut world, mut mission) = ready();
        let id = plan_id(&compiled(&mut world, &mission));
        world.vehicle.telemetry.mission = named(id + 1, 0);
        command(&mut world, &mut mission, transfer(Mode::Load));
        let progress = Event::Progress {
            operation: Operation::Upload,
            done: 1,
            total: 2,
            percent: 50,
        };
        handle(&mut world, &mut mission, Input::ServiceEnded(progress));
        handle(&mut world, &mut mission, Input::CompareWithVehicle);
        if cancelled {
            command(&mut world, &mut mission, transfer(Mode::Cancel));
        } else {
            let failed = Event::Failed {
                operation: Operation::Upload,
                kind: MISSION,
                reason: Failure::NoAnswer { seq: None },
            };
            ended(&mut world, &mut mission, Operation::Upload, failed);
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
    let progress = Event::Progress {
        operation: Operation::Upload,
        done: 1,
        total: 2,
        percent: 50,
    };
    handle(&mut world, &mut mission, Input::ServiceEnded(progress));
    world.sent_to(0);
    let failed = Event::Failed {
        operation: Operation::Upload,
        kind: MISSION,
        reason: Failure::NoAnswer { seq: None },
    };
    ended(&mut world, &mut mission, Operation::Upload, failed);
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
            let progress = Event::Progress {
                operation: Operation::Upload,
                done: 1,
                total: 2,
                percent: 50,
            };
            handle(&mut world, &mut mission, Input::ServiceEnded(progress));
        }
        handle(&mut world, &mut mission, Input::CompareWithVehicle);
        let failed = Event::Failed {
            operation: Operation::Upload,
            kind: MISSION,
            reason: Failure::NoAnswer { seq: None },
        };
        ended(&mut world, &mut mission, Operation::Upload, failed);
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
        let wanted = VehicleOperatingModeCommand::default();
        let message = wanted.clone().into();
        let input = Input::LoadAndFly {
            origin: Some(origin(&message)),
            route_type: (!is_loaded).then_some(stanag_msgs::enums::RouteType::Flight),
            command: Box::new(wanted),
        };
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

#[test]
fn the_fence_of_the_configuration_is_uploaded_and_watched_without_a_command() {
    let mut world = World::new();
    let circle = circle();
    let items: Vec<Item> =
        mapping::area::fence(std::slice::from_ref(&circle), &[], &Holder::default())
            .expect("a fence")
            .iter()
            .map(|point| point.item)
            .collect();
    let mut mission = Mission::new(vec![circle], Vec::new());
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
        let fence_id = transferred(&mut world, &mut mission, FENCE, &fence_items());
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
    let failed = || Event::Failed {
        operation: Operation::Upload,
        kind: FENCE,
        reason: Failure::NoAnswer { seq: None },
    };
    ended(&mut world, &mut mission, Operation::Upload, failed());
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
    let fence_id = transferred(&mut world, &mut mission, FENCE, &fence_items());
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
        route_type: Some(stanag_msgs::enums::RouteType::Flight),
        command: Box::default(),
    };
    handle(&mut world, &mut mission, Input::LinkUp);
    assert!(may_change(&world, &mission).is_err(), "it is compared");
    handle(&mut world, &mut mission, by_itself());
    assert!(!mission.transfers.is_running());
    world.advance(4 * SECOND);
    handle(&mut world, &mut mission, Input::WatchFence);
    assert_eq!(may_change(&world, &mission), Err(BUSY));
    let fence_id = transferred(&mut world, &mut mission, FENCE, &fence_items());
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
    let failed = Event::Failed {
        operation: Operation::Upload,
        kind: FENCE,
        reason: Failure::NoAnswer { seq: None },
    };
    ended(&mut world, &mut mission, Operation::Upload, failed);
    handle(&mut world, &mut mission, Input::CompareWithVehicle);
    assert!(!mission.transfers.is_running());
    world.advance(31 * SECOND);
    handle(&mut world, &mut mission, Input::WatchFence);
    let fence_id = transferred(&mut world, &mut mission, FENCE, &fence_items());
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
    let fence_id = transferred(&mut world, &mut mission, FENCE, &fence_items());
    world.vehicle.telemetry.mission = named(0, fence_id);
    handle(&mut world, &mut mission, Input::WatchFence);
    // The vehicle may have restarted without them.
    handle(&mut world, &mut mission, Input::LinkUp);
    let wanted = VehicleOperatingModeCommand::default();
    let message = wanted.clone().into();
    let input = Input::LoadAndFly {
        origin: Some(origin(&message)),
        route_type: Some(stanag_msgs::enums::RouteType::Flight),
        command: Box::new(wanted),
    };
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
    let id = transferred(&mut world, &mut mission, FENCE, &fence_items());
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
    let circle = circle();
    let items: Vec<Item> =
        mapping::area::fence(std::slice::from_ref(&circle), &[], &Holder::default())
            .expect("a fence")
            .iter()
            .map(|point| point.item)
            .collect();
    let mut mission = Mission::new(Vec::new(), Vec::new());
    mission.set_areas(vec![circle], world.now.mono);
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
fn rally_points_that_change_during_their_upload_are_replaced_and_cleared() {
    let mut world = World::new();
    let at = |latitude: f64| {
        let height = Height::AboveHome(0.0);
        let place = (latitude, 8.0);
        vec![RallyPoint { place, height }]
    };
    let mut mission = Mission::new(Vec::new(), Vec::new());
    mission.set_rally(at(47.001), world.now.mono);
    handle(&mut world, &mut mission, Input::WatchFence);
    for (sent, next) in [(at(47.001), at(47.002)), (at(47.002), Vec::new())] {
        assert_eq!(world.services.missions.busy(), Some(Operation::Upload));
        mission.set_rally(next, world.now.mono);
        // What is read back is compared with what was sent, not with what is configured by now.
        let items = rally::items(&sent);
        let id = transferred(&mut world, &mut mission, RALLY, &items);
        world.vehicle.telemetry.mission = named(0, 0).map(|shown| MissionProgress {
            rally_points_id: id,
            ..shown
        });
        // The upload is finished, then the change is due.
        handle(&mut world, &mut mission, Input::WatchFence);
        handle(&mut world, &mut mission, Input::WatchFence);
    }
    let cleared = Event::Cleared { kind: RALLY };
    ended(&mut world, &mut mission, Operation::Clear, cleared);
    world.vehicle.telemetry.mission = named(0, 0);
    handle(&mut world, &mut mission, Input::WatchFence);
    assert_eq!(world.services.missions.busy(), None);
    assert_eq!(mission.poll_timeout(), None);
}

#[test]
fn a_comparison_of_the_fence_that_a_silent_vehicle_delays_wakes_nobody() {
    let mut world = World::new();
    let circle = circle();
    let mut mission = Mission::new(vec![circle], Vec::new());
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

/// PX4 names none by 0, and a vehicle without ids whatever it holds.
#[test]
fn rally_points_that_the_configuration_has_lost_are_cleared_also_where_the_vehicle_names_none() {
    let mut world = World::new();
    world.vehicle.telemetry.mission = named(0, 0);
    let point = RallyPoint {
        place: (47.0, 8.0),
        height: mapping::rally::Height::AboveHome(2.0),
    };
    let mut before = Mission::new(Vec::new(), vec![point]);
    let busy = looked(&mut world, &mut before);
    assert_eq!(busy, Some(Operation::Upload));
    // Killed in the midst of it.
    let mut after = restarted(&mut world);
    let busy = looked(&mut world, &mut after);
    assert_eq!(busy, Some(Operation::Clear));
    let cleared = Event::Cleared { kind: RALLY };
    ended(&mut world, &mut after, Operation::Clear, cleared);
    let mut once = restarted(&mut world);
    assert_eq!(looked(&mut world, &mut once), None);
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
        let failed = Event::Failed {
            operation: Operation::Upload,
            kind: FENCE,
            reason: Failure::NoAnswer { seq: None },
        };
        ended(&mut world, &mut mission, Operation::Upload, failed);
        assert!(answers(&mut world).contains(&AckType::Refused));
        let expected = requested.then_some(Operation::Clear);
        world.advance(31 * SECOND);
        handle(&mut world, &mut mission, Input::WatchFence);
        assert_eq!(world.services.missions.busy(), expected);
        let mut after = restarted(&mut world);
        assert_eq!(looked(&mut world, &mut after), expected);
    }
}

/// At another field, with a vehicle that holds them no longer.
#[test]
fn areas_that_the_vehicle_breaches_after_a_restart_are_named_with_what_clears_them() {
    let (mut world, mut mission) = (World::new(), Mission::new(Vec::new(), Vec::new()));
    load_areas(&mut world, &mut mission);
    let id = transferred(&mut world, &mut mission, FENCE, &fence_items());
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

#[test]
fn rally_points_that_nobody_configured_are_left_alone_with_an_alert() {
    let mut world = World::new();
    let mut mission = Mission::new(Vec::new(), Vec::new());
    world.vehicle.telemetry.mission = named(0, 0).map(|named| MissionProgress {
        rally_points_id: 5,
        ..named
    });
    world.sent_to(0);
    let unknown = |world: &mut World, mission: &mut Mission| {
        handle(world, mission, Input::WatchFence);
        assert_eq!(world.services.missions.busy(), None);
        let (_, texts) = reports(world);
        texts.contains("rally points that the configuration does not have")
    };
    assert!(
        !unknown(&mut world, &mut mission),
        "perhaps cleared just now"
    );
    world.advance(6 * SECOND);
    assert!(unknown(&mut world, &mut mission));
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
