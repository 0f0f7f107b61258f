//! The machine without the others: the vehicle's side is played by the test, event by event.
//!
//! In reading order: `loads` (13000, and loads for a mode), `transfers` (downloads and cancellations), `uploaded` (what the vehicle
//! holds), `fence`, `rally_points`.

mod fence;
mod loads;
mod rally_points;
mod transfers;
mod uploaded;

use mapping::altitude::Altimeter;
use mapping::area::{Holder, Shape};
use mapping::route::{self, Site};
use mapping::telemetry::{MissionProgress, Place};
use mavlink_link::dialect::MissionState;
use mavlink_link::service::mission::{
    Event, Failure, Item, MavMissionType, Operation, plan_id, px4_read_back,
};
use stanag_msgs::enums::{
    AltitudeType, MissionPlanMode as Mode, MissionTransferStatus as Status, RouteType,
};
use stanag_msgs::messages::{
    MissionTransferCommand, UaPositionWaypoint, UaRoute, VehicleOperatingModeCommand,
};
use stanag_msgs::scalar::{Bam32, Scaled};
use stanag_msgs::{Text, TimeStamp};

use super::*;
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

/// An upload ends without an answer of the vehicle.
fn upload_fails(world: &mut World, mission: &mut Mission, kind: MavMissionType) {
    let failed = Event::Failed {
        operation: Operation::Upload,
        kind,
        reason: Failure::NoAnswer { seq: None },
    };
    ended(world, mission, Operation::Upload, failed);
}

/// A route is to be uploaded for a mode that station 0 has commanded.
fn load_and_fly(route_type: Option<RouteType>) -> Input<'static> {
    let command = VehicleOperatingModeCommand::default();
    let message = command.clone().into();
    Input::LoadAndFly {
        origin: Some(origin(&message)),
        route_type,
        command: Box::new(command),
    }
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

/// The items of an area alone.
fn fence_items(area: &Area) -> Vec<Item> {
    let areas = std::slice::from_ref(area);
    let points = mapping::area::fence(areas, &[], &Holder::default()).expect("a fence");
    points.iter().map(|point| point.item).collect()
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
        route_type: RouteType::Flight,
        mission_name: String::new(),
        plan: Plan::default(),
    });
    let telemetry = &mut world.vehicle.telemetry;
    telemetry.vehicle_type = Some(mavlink_link::dialect::MavType::MAV_TYPE_FIXED_WING);
    telemetry.mission = named(7, 0);
    world.show_mode(mapping::mode::Px4Mode::MISSION);
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
