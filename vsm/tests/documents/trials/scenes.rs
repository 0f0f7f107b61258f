//! The scenes that trials are played in: who is there, what has gone before, and what is done with the message.

use px4_sim::Airframe;
use stanag_msgs::enums::{
    AreaPlanMode, FlightPathControlMode as Mode, StationBitmap1To16, StationBitmap17To32,
};
use stanag_msgs::messages::{CucsAuthorisationRequest, MissionTransferCommand, UaRoute};
use stanag_msgs::{Message, Text};

use super::messages::{areas, circle, corner, loiter_there};
use crate::scene::send;
use kit::bridge::{Rig, Setup, orders};

pub(super) fn one() -> Setup {
    Setup::default()
}

pub(super) fn two_stations() -> Setup {
    Setup {
        stations: 2,
        vehicle_keys: PAYLOADS,
        ..Setup::default()
    }
}

pub(super) fn transitions() -> Setup {
    Setup {
        stations: 2,
        dli_keys: "provisional = \"all\"",
        ..Setup::default()
    }
}

pub(super) fn termination() -> Setup {
    Setup {
        dli_keys: "provisional = \"all\"",
        vehicle_keys: "termination = { action = \"land\" }",
        ..Setup::default()
    }
}

pub(super) fn plane() -> Setup {
    Setup {
        vehicles: vec![px4_sim::Config {
            airframe: Airframe::Plane,
            params: vec![(px4_sim::Param::MIS_TKO_LAND_REQ, 0.0)],
            ..px4_sim::Config::default()
        }],
        ..Setup::default()
    }
}

pub(super) fn vtol() -> Setup {
    let mut setup = plane();
    setup.vehicles[0].airframe = Airframe::Vtol;
    setup
}

pub(super) fn nothing(_: &mut Rig) {}

pub(super) fn control(rig: &mut Rig) {
    rig.done(orders::request_control());
    rig.run(1.0);
}

pub(super) fn with_a_failing_compass(rig: &mut Rig) {
    control(rig);
    rig.vehicles[0]
        .vehicle_mut()
        .set_health_faults(px4_sim::HealthFaults {
            unhealthy: 0x4,
            ..px4_sim::HealthFaults::default()
        });
    rig.run(5.0);
}

pub(super) fn control_with_stations(rig: &mut Rig) {
    rig.done(CucsAuthorisationRequest {
        controlled_station_1_16: Some(stations_1_16(3)),
        controlled_station_17_32: Some(stations_17_32(3)),
        ..orders::request_control()
    });
}

pub(super) fn other_controls(rig: &mut Rig) {
    let ticket = rig.send_as(1, 0, orders::request_control());
    rig.until(5.0, |rig| rig.stations[1].end(ticket).is_some());
}

pub(super) fn airborne(rig: &mut Rig) {
    control(rig);
    rig.take_off(20.0);
    rig.run(2.0);
}

/// Its clock is measured.
pub(super) fn airborne_and_beating(rig: &mut Rig) {
    rig.stations[0].heartbeats = true;
    airborne(rig);
}

pub(super) fn airborne_with_route(rig: &mut Rig) {
    control(rig);
    rig.send_plan(orders::square());
    rig.done(orders::load());
    rig.take_off(20.0);
}

pub(super) fn with_two_routes(rig: &mut Rig) {
    control(rig);
    rig.send_plan(orders::square());
    rig.send_plan(vec![
        UaRoute {
            route_id: Some(Text::new("R2")),
            ..orders::route(201)
        }
        .into(),
        orders::waypoint(201, 0, 40.0, 40.0, 15.0).into(),
    ]);
}

pub(super) fn with_two_routes_loaded(rig: &mut Rig) {
    with_two_routes(rig);
    rig.done(orders::load());
}

pub(super) fn then_5_s(rig: &mut Rig, message: &Message) {
    send(rig, message);
    rig.run(5.0);
}

pub(super) fn then_20_s(rig: &mut Rig, message: &Message) {
    send(rig, message);
    rig.run(20.0);
}

/// Sticks are a stream; mode 2 is entered with the first.
pub(super) fn stream(rig: &mut Rig, message: &Message) {
    for round in 0..40 {
        rig.send_once(message.clone());
        if round == 2 {
            let _ = rig.send(orders::mode(Mode::FlightDirector));
        }
        rig.run(0.1);
    }
}

pub(super) fn then_loiter(rig: &mut Rig, message: &Message) {
    send(rig, message);
    rig.done(loiter_there(60.0, 0.0));
    rig.run(30.0);
}

/// 13001 under trial, then the rest of its plan, and a flight of route R1.
pub(super) fn as_route(rig: &mut Rig, message: &Message) {
    send(rig, message);
    rig.send_plan(orders::square().into_iter().skip(1).collect());
    let load = MissionTransferCommand {
        route_id: Some(Text::new("R1")),
        ..orders::load()
    };
    send(rig, &load.into());
    rig.take_off(20.0);
    send(rig, &orders::mode(Mode::Waypoint).into());
    rig.run(5.0);
}

/// 13002 under trial as the second waypoint of three.
pub(super) fn as_waypoint(rig: &mut Rig, message: &Message) {
    rig.send_plan(vec![
        orders::route(1).into(),
        orders::waypoint(1, 2, 60.0, 0.0, 20.0).into(),
        orders::waypoint(3, 0, 60.0, 90.0, 20.0).into(),
    ]);
    send(rig, message);
    send(rig, &orders::load().into());
}

/// 13003 under trial at the first of two waypoints.
pub(super) fn as_loiter(rig: &mut Rig, message: &Message) {
    rig.send_plan(vec![
        orders::route(1).into(),
        orders::waypoint(1, 2, 300.0, 0.0, 80.0).into(),
        orders::waypoint(2, 0, 600.0, 600.0, 80.0).into(),
    ]);
    send(rig, message);
    send(rig, &orders::load().into());
}

/// 13004 under trial at the first of two waypoints.
pub(super) fn as_payload_action(rig: &mut Rig, message: &Message) {
    rig.send_plan(vec![
        orders::route(1).into(),
        orders::waypoint(1, 2, 60.0, 0.0, 20.0).into(),
        orders::waypoint(2, 0, 60.0, 90.0, 20.0).into(),
    ]);
    send(rig, message);
    // Also without the action, where it was refused.
    rig.done(orders::load());
}

/// A curve under trial between two waypoints. 50001 has a stamp of its own kind, which 17000 cannot return.
pub(super) fn as_curve(rig: &mut Rig, message: &Message) {
    rig.send_plan(vec![
        orders::route(1).into(),
        orders::waypoint(1, 2, 50.0, 0.0, 20.0).into(),
        orders::waypoint(2, 0, 50.0, 200.0, 20.0).into(),
    ]);
    rig.send_once(message.clone());
    rig.run(0.5);
    send(rig, &orders::load().into());
}

/// 50016 under trial as the third corner of a triangle.
pub(super) fn as_corner(rig: &mut Rig, message: &Message) {
    let corners = [(300.0, 0.0), (-300.0, 300.0)];
    for (number, at) in (1..).zip(corners) {
        rig.done(corner(number, at));
    }
    send(rig, message);
    send(rig, &areas(AreaPlanMode::Load).into());
}

pub(super) fn then_load_areas(rig: &mut Rig, message: &Message) {
    send(rig, message);
    send(rig, &areas(AreaPlanMode::Load).into());
}

pub(super) fn with_areas(rig: &mut Rig) {
    control(rig);
    rig.done(circle());
}

/// A request that waits has no end yet.
pub(super) fn request_control_of(rig: &mut Rig, message: &Message) {
    let _ = rig.send(message.clone());
    rig.run(5.0);
}

/// Payload stations that can be held.
const PAYLOADS: &str = "
[[vehicle.payload]]
station = 1
[[vehicle.payload]]
station = 2
[[vehicle.payload]]
station = 17
[[vehicle.payload]]
station = 18
";

fn stations_1_16(bits: u16) -> StationBitmap1To16 {
    StationBitmap1To16::from_raw(bits)
}

fn stations_17_32(bits: u16) -> StationBitmap17To32 {
    StationBitmap17To32::from_raw(bits)
}
