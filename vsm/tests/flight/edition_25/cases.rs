//! The messages of a station of Edition 2.5 that are tried, in the order of their numbers. Places are metres north and east
//! of home, angles radians.

use kit::bridge::{cucs, orders, vehicle_id};
use px4_sim::{Airframe, HealthFaults, Param};
use serde_json::{Value, json};

use super::payload::operating;
use super::*;

/// A message in a scene, and other values of its fields.
pub(super) struct Case {
    pub(super) number: u16,
    pub(super) before: fn() -> (Rig, StationEd25),
    pub(super) base: Value,
    /// Sends the message, and does what makes its effect seen.
    pub(super) act: fn(&mut Rig, &mut StationEd25, u16, &Value),
    /// Carried out, to another effect.
    pub(super) changes: Vec<(&'static str, Value)>,
    /// Values for which the message is refused.
    pub(super) refused: Vec<(&'static str, Value)>,
}

macro_rules! case {
    ($number:literal, $before:expr, $act:expr, $base:tt, [$($field:literal = $value:expr),* $(,)?]
        $(, refused [$($bad:literal = $bad_value:expr),* $(,)?])?) => {
        Case {
            number: $number,
            before: $before,
            base: json!($base),
            act: $act,
            changes: vec![$(($field, json!($value))),*],
            refused: vec![$($(($bad, json!($bad_value))),*)?],
        }
    };
}

pub(super) fn cases() -> Vec<Case> {
    let mut all = rights();
    all.extend(flight());
    all.extend(plans());
    all.extend(payloads());
    all.extend(requests());
    all
}

fn rights() -> Vec<Case> {
    vec![
        case!(1, rig, then_2_s, { "VSM ID": -1, "Requested/Handover LOI": 15, "Controlled Station Mode": 1 },
            ["Requested/Handover LOI" = 1, "Controlled Station Mode" = 0],
            refused ["VSM ID" = 5]),
        case!(1, two_payloads, then_2_s,
            { "VSM ID": -1, "Requested/Handover LOI": 2, "Controlled Station": 1, "Controlled Station Mode": 1 },
            ["Controlled Station" = 2]),
        case!(1, other_controls, then_2_s,
            { "VSM ID": -1, "Requested/Handover LOI": 12, "Controlled Station Mode": 1,
              "Wait for Vehicle Data Link Transition Coordination Message": 1 },
            [], refused ["Wait for Vehicle Data Link Transition Coordination Message" = 0]),
        case!(404, ready, then_2_s, { "Control Assignment Request": 1 }, [],
            refused ["Control Assignment Request" = 0]),
        case!(600, ready, then_2_s, { "Acquiring CUCS ID": (cucs(0).0 as i32) }, [],
            refused ["Acquiring CUCS ID" = 0, "Set Forward Link (FL) Carrier Frequency (ADT)" = 1.0,
                "Set Return Link (RL) Carrier Frequency (ADT)" = 1.0, "Set PN Code (ADT)" = 1]),
    ]
}

fn flight() -> Vec<Case> {
    let (north, east) = orders::place(60.0, 0.0);
    let (further_north, further_east) = orders::place(120.0, 60.0);
    let there = (north.to_radians(), east.to_radians());
    let beyond = (further_north.to_radians(), further_east.to_radians());
    vec![
        case!(41, airborne, then_loiter_there, { "Loiter Type": 1, "Loiter Radius": 30.0, "Loiter Direction": 1 },
            ["Loiter Type" = 4, "Loiter Radius" = 60.0, "Loiter Direction" = 2]),
        case!(41, airborne, then_loiter,
            { "Loiter Type": 4, "Loiter Altitude": 30.0, "Altitude Type": 2, "Loiter Speed": 4.0, "Speed Type": 2 },
            ["Loiter Altitude" = 35.0, "Altitude Type" = 1, "Loiter Speed" = 3.0, "Speed Type" = 3]),
        case!(41, plane_up, then_loiter,
            { "Loiter Type": 3, "Loiter Radius": 60.0, "Loiter Length": 600.0, "Loiter Direction": 1 },
            ["Loiter Length" = 900.0, "Loiter Bearing" = 1.0]),
        case!(42, airborne, then_5_s, { "Select Flight Path Control Mode": 12 },
            ["Select Flight Path Control Mode" = 19]),
        case!(43, in_autopilot, then_5_s,
            { "Altitude Command Type": 3, "Commanded Altitude": 60.0, "Altitude Type": 2, "Commanded Vertical Speed": 1.0,
              "Heading Command Type": 3, "Commanded Heading": 0.5, "Commanded Course": 1.0, "Commanded Speed": 3.0 },
            ["Altitude Command Type" = 1, "Commanded Altitude" = 12.0, "Commanded Vertical Speed" = 2.0,
             "Heading Command Type" = 1, "Commanded Heading" = -0.5, "Commanded Course" = -1.0,
             "Commanded Speed" = 5.0],
            refused ["Speed Type" = 3]),
        case!(43, in_autopilot, then_5_s, { "Heading Command Type": 5, "Commanded Turn Rate": 0.1 },
            ["Commanded Turn Rate" = 0.3]),
        case!(43, ready, then_launch,
            { "Altitude Command Type": 1, "Commanded Altitude": 520.0, "Altitude Type": 0, "Altimeter Setting": 101_325.0 },
            ["Altitude Type" = 2, "Altimeter Setting" = 101_500.0]),
        case!(43, with_a_route_up, then_fly, { "Commanded Waypoint Number": 101 },
            ["Commanded Waypoint Number" = 103]),
        case!(43, in_manual_loiter, then_5_s,
            { "Loiter Position Latitude": (there.0), "Loiter Position Longitude": (there.1) },
            ["Loiter Position Latitude" = beyond.0, "Loiter Position Longitude" = beyond.1]),
        case!(45, ready, then_2_s, { "Engine Command": 1 }, ["Engine Command" = 0],
            refused ["Engine Number" = 9]),
        case!(46, with_termination, then_2_s, { "Commanded Flight Termination State": 1 },
            ["Commanded Flight Termination State" = 0],
            refused ["Flight Termination Mode" = 1]),
        case!(48, loitering, then_demand, { "Altitude Mode": 2, "Speed Mode": 2, "Course/Heading Mode": 2 },
            ["Altitude Mode" = 0, "Speed Mode" = 0, "Course/Heading Mode" = 0]),
    ]
}

fn plans() -> Vec<Case> {
    let second = waypoint(102, 103, 40.0, 40.0);
    let mut faster = second.clone();
    faster["Waypoint to Speed"] = json!(5.0);
    faster["Waypoint Speed Type"] = json!(2);
    let mut ends = second.clone();
    ends["Next Waypoint"] = json!(0);
    let (north, east) = orders::place(90.0, 70.0);
    let (further_north, further_east) = orders::place(150.0, 90.0);
    vec![
        case!(800, with_a_route, then_2_s, { "Mission ID": "M1", "Mission Plan Mode": 2 },
            ["Mission ID" = "M2", "Mission Plan Mode" = 1]),
        case!(800, with_a_loaded_route, then_2_s, { "Mission Plan Mode": 4, "Waypoint Number": 101 },
            ["Waypoint Number" = 102]),
        case!(801, with_waypoints, then_load, { "Initial Waypoint Number": 101, "Route ID": "R1", "Route Type": 2 },
            ["Initial Waypoint Number" = 102, "Route ID" = "R9", "Route Type" = 3]),
        case!(
            802,
            with_ends,
            then_load,
            (faster),
            [
                "Waypoint Number" = 109,
                "Waypoint to Latitude or Relative Y" = north.to_radians(),
                "Waypoint to Longitude or Relative X" = east.to_radians(),
                "Waypoint to Altitude" = 30.0,
                "Waypoint Altitude Type" = 1,
                "Location Type" = 1,
                "Waypoint to Speed" = 7.0,
                "Waypoint Speed Type" = 3,
                "Next Waypoint" = 0,
                "Turn Type" = 1
            ]
        ),
        case!(
            802,
            with_one_waypoint_and_ways_out,
            then_load,
            (ends),
            [
                "Contingency Waypoint A" = 201,
                "Contingency Waypoint B" = 211
            ]
        ),
        case!(803, plane_with_a_route, then_load,
            { "Waypoint Number": 101, "Waypoint Loiter Time": 60, "Waypoint Loiter Type": 1, "Loiter Radius": 60.0,
              "Loiter Direction": 1 },
            ["Waypoint Number" = 102, "Waypoint Loiter Time" = 90, "Waypoint Loiter Type" = 4, "Loiter Radius" = 90.0,
             "Loiter Direction" = 2]),
        case!(804, with_a_route_and_a_payload, then_load,
            { "Waypoint Number": 101, "Station Number": 1, "Set Sensor 1 Mode": 1, "Set Sensor 2 Mode": 1,
              "Sensor Output": 1, "Set Sensor Pointing Mode": 1, "Starepoint Latitude": (north.to_radians()),
              "Starepoint Longitude": (east.to_radians()), "Starepoint Altitude Type": 2, "Payload Az (wrt AV)": 0.5,
              "Payload El (wrt AV)": -0.5 },
            ["Waypoint Number" = 102, "Sensor Output" = 2, "Set Sensor Pointing Mode" = 4, "Payload Az (wrt AV)" = 0.8,
             "Payload El (wrt AV)" = -0.8],
            refused ["Station Number" = 2, "Set Sensor 1 Mode" = 0, "Set Sensor 2 Mode" = 0, "Sensor Output" = 3,
                "Set Sensor Pointing Mode" = 6, "Payload El (wrt AV)" = 1.2, "Payload Sensor Rotation Angle" = 0.2]),
        case!(804, with_a_route_and_a_payload, then_load,
            { "Waypoint Number": 101, "Station Number": 1, "Set Sensor 1 Mode": 1, "Set Sensor 2 Mode": 1,
              "Set Sensor Pointing Mode": 4, "Starepoint Latitude": (north.to_radians()),
              "Starepoint Longitude": (east.to_radians()), "Starepoint Altitude": 500.0, "Starepoint Altitude Type": 0 },
            ["Starepoint Latitude" = further_north.to_radians(), "Starepoint Longitude" = further_east.to_radians(),
             "Starepoint Altitude" = 510.0, "Starepoint Altitude Type" = 2]),
        case!(806, with_a_route, then_load, { "Waypoint Number": 102, "Tag/Data": "DELAY 5" },
            ["Waypoint Number" = 103, "Tag/Data" = "DELAY 6"],
            refused ["Tag Type" = 1]),
    ]
}

fn payloads() -> Vec<Case> {
    let (north, east) = orders::place(40.0, 10.0);
    let (further_north, further_east) = orders::place(80.0, 50.0);
    vec![
        case!(200, by_angle, then_5_s,
            { "Station Number": 1, "Set Centreline Azimuth Angle": 0.3, "Set Centreline Elevation Angle": -0.5,
              "Set Zoom": 0, "Set Horizontal Field Of View": 0.35, "Set Focus": 0 },
            ["Set Centreline Azimuth Angle" = 0.6, "Set Centreline Elevation Angle" = -0.9, "Set Zoom" = 2,
             "Set Horizontal Field Of View" = 0.5, "Set Focus" = 2],
            refused ["Station Number" = 0]),
        case!(200, by_rate, then_5_s,
            { "Station Number": 1, "Set Zoom": 1, "Horizontal Slew Rate": 0.1, "Vertical Slew Rate": -0.05 },
            ["Horizontal Slew Rate" = -0.1, "Vertical Slew Rate" = -0.1]),
        case!(200, by_place, then_5_s,
            { "Station Number": 1, "Set Zoom": 1, "Latitude": (north.to_radians()), "Longitude": (east.to_radians()),
              "Altitude": 0.0, "Altitude Type": 2 },
            ["Latitude" = further_north.to_radians(), "Longitude" = further_east.to_radians(), "Altitude" = 10.0],
            refused ["Altitude Type" = 9]),
        case!(200, focused_by_hand, then_5_s, { "Station Number": 1, "Set Zoom": 1, "Focus Type": 1 },
            ["Focus Type" = 0]),
        case!(201, operating, then_5_s,
            { "Station Number": 1, "Addressed Sensor": 1, "System Operating Mode": 5, "Set EO Sensor Mode": 1,
              "Image Output": 1, "Set EO/IR Pointing Mode": 0, "Select Laser Rangefinder First/Last Pulse": 1 },
            ["System Operating Mode" = 10, "Set EO/IR Pointing Mode" = 1],
            refused ["Station Number" = 3, "Image Output" = 9, "Fire Laser Pointer/Rangefinder" = 51,
                "Initiate Laser Designator" = 51]),
        case!(205, with_two_recorders, then_5_s, { "Recording Device Number": 1, "Set Recording Mode": 2 },
            ["Recording Device Number" = 2, "Set Recording Mode" = 0],
            refused ["Recording Device Number" = 3, "Set Recording Mode" = 3, "Set Replay Mode" = 1]),
        case!(1403, operating, then_2_s, { "Message Type": 300 }, [], refused ["Station Number" = 2]),
    ]
}

fn requests() -> Vec<Case> {
    vec![
        case!(1000, ready, then_2_s, {}, ["Subsystem ID" = 8]),
        case!(1001, with_a_failing_compass, then_2_s, { "Subsystem State Report Reference": 6 }, [],
            refused ["Subsystem State Report Reference" = 1]),
        case!(1200, rig, then_2_s, { "VSM ID": -1, "Request Type": 0, "Requested Message": 43, "Requested Field": 13 },
            ["Request Type" = 4, "Requested Message" = 802, "Requested Field" = 5],
            refused ["VSM ID" = 5]),
        case!(1401, ready, then_configure_a_loiter, { "Message Type": 41 }, ["Message Type" = 43]),
        case!(1402, ready, then_2_s, { "Requested Message Type": 102, "Frequency": 4.0 },
            ["Requested Message Type" = 103, "Frequency" = 2.0]),
        case!(1403, ready, then_2_s, { "Message Type": 100 }, ["Message Type" = 20]),
        case!(2010, ready, then_2_s, { "Parameter Name": "MPC_XY_CRUISE" }, ["Parameter Name" = "MIS_LND_ABRT_ALT"]),
        case!(2011, with_controls, then_2_s, { "Parameter Name": "MPC_XY_CRUISE", "Commanded Value": 7.0 },
            ["Parameter Name" = "MIS_LND_ABRT_ALT", "Commanded Value" = 8.0],
            refused ["Parameter Name" = "NAV_DLL_ACT", "Commanded Value" = 30.0]),
    ]
}

// The scenes.

fn with_setup(setup: Setup, levels: u8) -> (Rig, StationEd25) {
    let mut rig = Rig::new(Setup {
        tables: TABLES,
        ..setup
    });
    rig.run(9.0);
    let mut station = StationEd25::new(CUCS, ([127, 0, 0, 2], 41_000).into());
    if levels > 0 {
        let granted = request(&mut rig, &mut station, levels, 1);
        assert_eq!(granted[0]["LOI Granted"], levels, "{granted:?}");
        rig.run(1.0);
    }
    (rig, station)
}

fn two_payloads() -> (Rig, StationEd25) {
    let vehicle = px4_sim::Config {
        payloads: 2,
        ..px4_sim::Config::default()
    };
    with_setup(
        Setup {
            vehicles: vec![vehicle],
            ..Setup::default()
        },
        0,
    )
}

/// Two payload stations with a camera each, both held.
fn with_two_recorders() -> (Rig, StationEd25) {
    let (mut rig, mut station) = two_payloads();
    rig.run(3.0);
    hold(&mut rig, &mut station, 2, 3);
    (rig, station)
}

/// #1 with payload stations.
fn hold(rig: &mut Rig, station: &mut StationEd25, levels: u8, stations: u16) {
    let fields = json!({
        "VSM ID": -1, "Requested/Handover LOI": levels, "Controlled Station": stations, "Controlled Station Mode": 1,
    });
    station.send(rig, vehicle_id(0), 1, &fields);
    rig.run(4.0);
    let granted = station.take(rig, 21);
    let is_held = |one: &Value| one["Controlled Station"] == stations;
    assert!(granted.iter().any(is_held), "{granted:?}");
}

fn with_controls() -> (Rig, StationEd25) {
    let vehicle = px4_sim::Config {
        events: true,
        ..px4_sim::Config::default()
    };
    let setup = Setup {
        vehicles: vec![vehicle],
        vehicle_keys: "[vehicle.controls]\nparameters = [\"MPC_XY_CRUISE\", \"MIS_LND_ABRT_ALT\"]\n",
        ..Setup::default()
    };
    let (mut rig, station) = with_setup(setup, 0x0f);
    // Their ranges are read by then.
    rig.run(10.0);
    (rig, station)
}

fn other_controls() -> (Rig, StationEd25) {
    let (mut rig, station) = rig();
    assert!(rig.carry_out(orders::request_control()).is_some());
    rig.run(1.0);
    (rig, station)
}

fn airborne() -> (Rig, StationEd25) {
    let (mut rig, mut station) = ready();
    take_off(&mut rig, &mut station, 20.0);
    rig.run(2.0);
    (rig, station)
}

fn in_mode(number: u8) -> (Rig, StationEd25) {
    let (mut rig, mut station) = airborne();
    mode(&mut rig, &mut station, number);
    rig.run(3.0);
    (rig, station)
}

fn in_autopilot() -> (Rig, StationEd25) {
    in_mode(15)
}

fn loitering() -> (Rig, StationEd25) {
    in_mode(12)
}

fn in_manual_loiter() -> (Rig, StationEd25) {
    let (mut rig, mut station) = loitering();
    let manual = json!({ "Altitude Mode": 2, "Speed Mode": 2, "Course/Heading Mode": 2 });
    station.send(&mut rig, vehicle_id(0), 48, &manual);
    rig.run(0.5);
    (rig, station)
}

fn plane() -> Setup {
    Setup {
        vehicles: vec![px4_sim::Config {
            airframe: Airframe::Plane,
            params: vec![(Param::MIS_TKO_LAND_REQ, 0.0)],
            ..px4_sim::Config::default()
        }],
        ..Setup::default()
    }
}

fn plane_up() -> (Rig, StationEd25) {
    let (mut rig, mut station) = with_setup(plane(), 0x0f);
    take_off(&mut rig, &mut station, 80.0);
    rig.run(5.0);
    (rig, station)
}

fn plane_with_a_route() -> (Rig, StationEd25) {
    let (mut rig, mut station) = with_setup(plane(), 0x0f);
    let at = |number, next, north, east| {
        let mut one = waypoint(number, next, north, east);
        one["Waypoint to Altitude"] = json!(80.0);
        one
    };
    let plan = [
        (801, route(101, "R1", 2)),
        (802, at(101, 102, 300.0, 0.0)),
        (802, at(102, 0, 600.0, 600.0)),
    ];
    upload(&mut rig, &mut station, &plan);
    (rig, station)
}

fn upload(rig: &mut Rig, station: &mut StationEd25, plan: &[(u16, Value)]) {
    for (number, fields) in plan {
        station.send(rig, vehicle_id(0), *number, fields);
    }
    rig.run(0.5);
}

fn square() -> [(u16, Value); 3] {
    [
        (802, waypoint(101, 102, 40.0, 0.0)),
        (802, waypoint(102, 103, 40.0, 40.0)),
        (802, waypoint(103, 0, 0.0, 40.0)),
    ]
}

fn with_waypoints() -> (Rig, StationEd25) {
    let (mut rig, mut station) = ready();
    upload(&mut rig, &mut station, &square());
    (rig, station)
}

fn with_a_route() -> (Rig, StationEd25) {
    let (mut rig, mut station) = with_waypoints();
    upload(&mut rig, &mut station, &[(801, route(101, "R1", 2))]);
    (rig, station)
}

fn with_a_route_and_a_payload() -> (Rig, StationEd25) {
    let (mut rig, mut station) = two_payloads();
    rig.run(3.0);
    hold(&mut rig, &mut station, 0x0e, 1);
    upload(&mut rig, &mut station, &square());
    upload(&mut rig, &mut station, &[(801, route(101, "R1", 2))]);
    (rig, station)
}

fn with_a_loaded_route() -> (Rig, StationEd25) {
    let (mut rig, mut station) = with_a_route();
    assert_eq!(transfer(&mut rig, &mut station, 2), Some(1));
    (rig, station)
}

fn with_a_route_up() -> (Rig, StationEd25) {
    let (mut rig, mut station) = with_a_loaded_route();
    take_off(&mut rig, &mut station, 20.0);
    rig.run(2.0);
    (rig, station)
}

/// A route whose second waypoint is not there yet.
fn with_ends() -> (Rig, StationEd25) {
    let (mut rig, mut station) = ready();
    let [first, _, third] = square();
    upload(
        &mut rig,
        &mut station,
        &[(801, route(101, "R1", 2)), first, third],
    );
    (rig, station)
}

/// A route of one waypoint that is not there yet, and two waypoints to go to in a contingency.
fn with_one_waypoint_and_ways_out() -> (Rig, StationEd25) {
    let (mut rig, mut station) = ready();
    let plan = [
        (801, route(102, "R1", 2)),
        (802, waypoint(201, 0, 0.0, -40.0)),
        (802, waypoint(211, 0, 0.0, -80.0)),
    ];
    upload(&mut rig, &mut station, &plan);
    (rig, station)
}

fn with_termination() -> (Rig, StationEd25) {
    let setup = Setup {
        vehicle_keys: "termination = { action = \"terminate\" }",
        ..Setup::default()
    };
    let (mut rig, mut station) = with_setup(setup, 0x0f);
    take_off(&mut rig, &mut station, 20.0);
    // Its clock is measured by what it sends anyway.
    for _ in 0..5 {
        station.send(
            &mut rig,
            vehicle_id(0),
            1403,
            &json!({ "Message Type": 108 }),
        );
        rig.run(1.0);
    }
    (rig, station)
}

fn pointing(mode: u8) -> (Rig, StationEd25) {
    let (mut rig, mut station) = operating();
    payload::sensor(&mut rig, &mut station, 5, mode);
    rig.run(2.0);
    (rig, station)
}

fn by_angle() -> (Rig, StationEd25) {
    pointing(1)
}

fn by_rate() -> (Rig, StationEd25) {
    pointing(2)
}

/// It looks down before: a place is looked at from where the sensor is known to look.
fn by_place() -> (Rig, StationEd25) {
    let (mut rig, mut station) = by_angle();
    let down =
        json!({ "Station Number": 1, "Set Zoom": 1, "Set Centreline Elevation Angle": -0.7 });
    station.send(&mut rig, vehicle_id(0), 200, &down);
    rig.run(4.0);
    payload::sensor(&mut rig, &mut station, 5, 4);
    rig.run(2.0);
    let alerts = station.alerts(&rig).join("|");
    assert!(!alerts.contains("#201 refused"), "{alerts}");
    (rig, station)
}

fn focused_by_hand() -> (Rig, StationEd25) {
    let (mut rig, mut station) = by_angle();
    let nearer = json!({ "Station Number": 1, "Set Zoom": 1, "Set Focus": 2, "Focus Type": 1 });
    station.send(&mut rig, vehicle_id(0), 200, &nearer);
    rig.run(2.0);
    (rig, station)
}

fn with_a_failing_compass() -> (Rig, StationEd25) {
    let (mut rig, station) = ready();
    let faults = HealthFaults {
        unhealthy: 0x4,
        ..HealthFaults::default()
    };
    rig.vehicles[0].vehicle_mut().set_health_faults(faults);
    rig.run(5.0);
    (rig, station)
}

// What follows the message.

fn then_2_s(rig: &mut Rig, station: &mut StationEd25, number: u16, fields: &Value) {
    station.send(rig, vehicle_id(0), number, fields);
    rig.run(2.0);
}

fn then_5_s(rig: &mut Rig, station: &mut StationEd25, number: u16, fields: &Value) {
    station.send(rig, vehicle_id(0), number, fields);
    rig.run(5.0);
}

/// A launch 20 s later, whatever altitude it is to reach.
fn then_launch(rig: &mut Rig, station: &mut StationEd25, number: u16, fields: &Value) {
    station.send(rig, vehicle_id(0), number, fields);
    rig.run(0.2);
    mode(rig, station, 21);
    rig.run(20.0);
}

fn then_fly(rig: &mut Rig, station: &mut StationEd25, number: u16, fields: &Value) {
    station.send(rig, vehicle_id(0), number, fields);
    rig.run(0.2);
    mode(rig, station, 11);
    rig.run(6.0);
}

fn then_loiter(rig: &mut Rig, station: &mut StationEd25, number: u16, fields: &Value) {
    station.send(rig, vehicle_id(0), number, fields);
    rig.run(0.5);
    mode(rig, station, 12);
    rig.run(25.0);
}

/// A multicopter circles about a place.
fn then_loiter_there(rig: &mut Rig, station: &mut StationEd25, number: u16, fields: &Value) {
    let manual = json!({ "Altitude Mode": 2, "Speed Mode": 2, "Course/Heading Mode": 2 });
    station.send(rig, vehicle_id(0), 48, &manual);
    station.send(rig, vehicle_id(0), number, fields);
    rig.run(0.5);
    let (latitude, longitude) = orders::place(60.0, 0.0);
    let place = json!({
        "Loiter Position Latitude": latitude.to_radians(),
        "Loiter Position Longitude": longitude.to_radians(),
    });
    mode(rig, station, 12);
    steer(rig, station, &place);
    rig.run(30.0);
}

fn then_demand(rig: &mut Rig, station: &mut StationEd25, number: u16, fields: &Value) {
    station.send(rig, vehicle_id(0), number, fields);
    rig.run(0.5);
    let (latitude, longitude) = orders::place(60.0, 0.0);
    let demand = json!({
        "Altitude Command Type": 1, "Commanded Altitude": 30.0, "Altitude Type": 2,
        "Commanded Speed": 3.0, "Speed Type": 2,
        "Loiter Position Latitude": latitude.to_radians(),
        "Loiter Position Longitude": longitude.to_radians(),
    });
    steer(rig, station, &demand);
    rig.run(10.0);
}

fn then_load(rig: &mut Rig, station: &mut StationEd25, number: u16, fields: &Value) {
    station.send(rig, vehicle_id(0), number, fields);
    rig.run(0.2);
    for mode in [2, 3] {
        let fields = json!({ "Mission ID": "M1", "Mission Plan Mode": mode });
        station.send(rig, vehicle_id(0), 800, &fields);
        rig.run(4.0);
    }
}

fn then_configure_a_loiter(rig: &mut Rig, station: &mut StationEd25, number: u16, fields: &Value) {
    station.send(rig, vehicle_id(0), number, fields);
    rig.run(0.2);
    let loiter = json!({ "Loiter Type": 4 });
    station.send(rig, vehicle_id(0), 41, &loiter);
    rig.run(0.5);
}
