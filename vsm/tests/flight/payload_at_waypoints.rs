//! 13004: where a gimbal looks, and which sensor is shown, from the leg to a waypoint on.

use kit::bridge::{Rig, Setup, orders};
use mapping::payload::pointing::direction;
use mapping::telemetry::Attitude;
use stanag_msgs::enums::{
    AckType, AltitudeType, FlightPathControlMode as Mode, LoiBitmap, MissionPlanMode,
    PointingModeWp as Pointing, RequestedAccess, SensorModeCmd, SensorOutput, StationBitmap1To16,
};
use stanag_msgs::messages::{
    CucsAuthorisationRequest, PayloadActionWaypoint, VehicleOperatingModeCommand,
};
use stanag_msgs::{Bam16, Bam32, Message, Scaled};

const DONE: Option<AckType> = Some(AckType::CarriedOut);
const REFUSED: Option<AckType> = Some(AckType::Refused);
/// LOI 3, 4 and 5.
const ALL: u8 = 0x0e;
const LOI_3: u8 = 0x02;
/// North and east of home, m: what is looked at.
const PLACE: (f64, f64) = (230.0, 30.0);

fn rig(provisional: &'static str, stations: u8) -> Rig {
    let mut rig = Rig::new(Setup {
        stations,
        vehicles: vec![px4_sim::Config {
            payloads: 2,
            ..px4_sim::Config::default()
        }],
        dli_keys: provisional,
        ..Setup::default()
    });
    rig.run(12.0);
    rig
}

fn take(rig: &mut Rig, by: usize, levels: u8, stations: u16) {
    let request = CucsAuthorisationRequest {
        requested_handover_loi: Some(LoiBitmap::from_raw(levels)),
        requested_handover_access: Some(RequestedAccess::Request),
        controlled_station_1_16: Some(StationBitmap1To16::from_raw(stations)),
        ..CucsAuthorisationRequest::default()
    };
    let ticket = rig.send_as(by, 0, request);
    assert_eq!(rig.end_as(by, ticket), DONE);
    rig.run(0.5);
}

fn action(number: u16, station: u16, mode: Pointing) -> PayloadActionWaypoint {
    PayloadActionWaypoint {
        waypoint_number: Some(number),
        station_number_1_16: Some(StationBitmap1To16::from_raw(station)),
        set_sensor_1_mode: Some(SensorModeCmd::On),
        set_sensor_pointing_mode: Some(mode),
        ..PayloadActionWaypoint::default()
    }
}

fn angles(number: u16, station: u16, azimuth: f64, elevation: f64) -> PayloadActionWaypoint {
    PayloadActionWaypoint {
        payload_az_wrt_ua: Some(Bam16::from_degrees(azimuth)),
        payload_el_wrt_ua: Some(Bam16::from_degrees(elevation)),
        ..action(number, station, Pointing::AngleToUa)
    }
}

fn stare(number: u16) -> PayloadActionWaypoint {
    let (latitude, longitude) = orders::place(PLACE.0, PLACE.1);
    PayloadActionWaypoint {
        sensor_output: Some(SensorOutput::Sensor2),
        starepoint_latitude: Some(Bam32::from_degrees(latitude)),
        starepoint_longitude: Some(Bam32::from_degrees(longitude)),
        starepoint_altitude: Scaled::from_si(0.0).ok(),
        starepoint_altitude_type: Some(AltitudeType::Agl),
        ..action(number, 1, Pointing::LatLongSlaved)
    }
}

fn legs() -> Vec<Message> {
    vec![
        orders::route(7).into(),
        orders::waypoint(7, 8, 40.0, 0.0, 20.0).into(),
        orders::waypoint(8, 9, 140.0, 0.0, 20.0).into(),
        orders::waypoint(9, 10, 140.0, 80.0, 20.0).into(),
        orders::waypoint(10, 0, 60.0, 80.0, 20.0).into(),
    ]
}

/// Azimuth and elevation from the body, which flies nose down, degrees.
fn looks(rig: &Rig) -> (f64, f64) {
    let sight = rig.vehicles[0].vehicle().payloads()[0].sight;
    let [roll, pitch, yaw] = rig.truth().attitude;
    let attitude = Attitude {
        roll,
        pitch,
        yaw,
        roll_rate: 0.0,
        pitch_rate: 0.0,
        yaw_rate: 0.0,
    };
    let seen = direction(sight, &attitude);
    (seen.azimuth.to_degrees(), seen.elevation.to_degrees())
}

fn is_close((azimuth, elevation): (f64, f64), to: (f64, f64), within: f64) -> bool {
    (azimuth - to.0).abs() < within && (elevation - to.1).abs() < within
}

/// How far from the place it looks, at the height of home, m.
fn misses(rig: &Rig) -> f64 {
    let [north, east, down] = rig.vehicles[0].vehicle().payloads()[0].sight;
    let at = rig.truth().position;
    let range = -at.d / down.max(1e-3);
    (at.n + range * north - PLACE.0).hypot(at.e + range * east - PLACE.1)
}

fn waypoint_mode(number: u16) -> VehicleOperatingModeCommand {
    VehicleOperatingModeCommand {
        commanded_waypoint_number: Some(number),
        ..orders::mode(Mode::Waypoint)
    }
}

#[test]
fn a_gimbal_is_pointed_where_the_leg_begins_and_the_actions_come_back_as_they_were_sent() {
    let mut rig = rig("provisional = \"all\"", 1);
    take(&mut rig, 0, ALL, 1);
    let actions = [
        angles(8, 1, 40.0, -50.0),
        stare(9),
        angles(10, 1, 0.0, -40.0),
    ];
    let mut plan = legs();
    plan.extend(actions.iter().cloned().map(Message::from));
    rig.send_plan(plan);
    rig.done(orders::load());
    // A multicopter's nose follows the place, which nobody should be surprised by.
    assert!(
        rig.station()
            .has_alert("waypoint 9: the vehicle turns its nose")
    );
    rig.take_off(20.0);
    rig.done(orders::mode(Mode::Waypoint));
    // On the leg to 7 nothing is pointed.
    assert!(rig.until(60.0, |rig| rig.truth().position.n > 20.0));
    assert!(is_close(looks(&rig), (0.0, 0.0), 4.0), "{:?}", looks(&rig));
    assert!(rig.until(60.0, |rig| rig.truth().position.n > 80.0));
    assert!(
        is_close(looks(&rig), (40.0, -50.0), 4.0),
        "{:?}",
        looks(&rig)
    );
    // From 8 on it looks at the place, and so does the nose.
    assert!(rig.until(60.0, |rig| rig.truth().position.e > 40.0));
    assert!(misses(&rig) < 3.0, "{} m", misses(&rig));
    let to_place = (PLACE.1 - rig.truth().position.e).atan2(PLACE.0 - rig.truth().position.n);
    let off = (rig.truth().attitude[2] - to_place).to_degrees();
    assert!(off.abs() < 15.0, "the nose is {off} degrees off");
    assert!(rig.vehicles[0].vehicle().payloads()[0].thermal);
    assert!(rig.until(60.0, |rig| rig.truth().position.n < 100.0));
    assert!(
        is_close(looks(&rig), (0.0, -40.0), 4.0),
        "{:?}",
        looks(&rig)
    );
    let nose = rig.truth().attitude[2].to_degrees().abs();
    assert!(nose > 150.0, "it flies south again: {nose}");
    // A flight to a waypoint begins with what its leg begins with.
    rig.done(waypoint_mode(8));
    assert!(rig.until(30.0, |rig| is_close(looks(rig), (40.0, -50.0), 4.0)));
    // 4001 and the watchdog know of no waypoint at the place.
    assert!(!rig.station().has_alert("no progress"));
    let before = rig.station().received.len();
    rig.done(orders::transfer(MissionPlanMode::Download));
    rig.run(1.0);
    let received = rig.station().received[before..].iter();
    let downloaded: Vec<PayloadActionWaypoint> = received
        .filter_map(|(_, _, message)| match message {
            Message::PayloadActionWaypoint(one) => Some(PayloadActionWaypoint {
                time_stamp: None,
                ..one.clone()
            }),
            _ => None,
        })
        .collect();
    assert_eq!(downloaded, actions);
}

#[test]
fn what_a_mission_cannot_point_is_refused_when_it_is_sent_and_leaves_nothing() {
    let mut rig = rig("provisional = \"all\"", 2);
    take(&mut rig, 0, ALL, 2);
    let cases = [
        // Station 2 is its own gimbal manager.
        (
            angles(8, 2, 0.0, -20.0),
            "no gimbal that the autopilot steers",
        ),
        (
            angles(8, 1, 0.0, -20.0),
            "needs LOI 3 (payload) of station 1",
        ),
        (action(8, 2, Pointing::Stow), "do not retract it"),
        (action(8, 2, Pointing::SlewRateInertial), "Pointing Mode 3"),
        (
            PayloadActionWaypoint {
                starepoint_altitude_type: Some(AltitudeType::Unknown(9)),
                ..stare(8)
            },
            "Starepoint Altitude Type 9, expected 0 to 3",
        ),
        (
            PayloadActionWaypoint {
                starepoint_altitude_type: None,
                ..stare(8)
            },
            "Starepoint Altitude Type is missing",
        ),
    ];
    for (message, why) in cases {
        assert_eq!(rig.carry_out(message), REFUSED, "{why}");
        assert!(
            rig.station().has_alert(why),
            "{why}: {:?}",
            rig.station().alerts()
        );
    }
    // With the station they are judged by its gimbal and camera.
    take(&mut rig, 0, LOI_3, 3);
    assert_eq!(rig.carry_out(angles(8, 1, 0.0, 60.0)), REFUSED);
    assert!(
        rig.station()
            .has_alert("Payload El 60.0 degrees, expected -90.0 to 30.0")
    );
    let shows = PayloadActionWaypoint {
        sensor_output: Some(SensorOutput::Sensor2),
        ..action(8, 2, Pointing::Nil)
    };
    assert_eq!(rig.carry_out(shows), REFUSED);
    assert!(rig.station().has_alert("reports no second sensor"));
    // Who only holds the station changes no plan.
    let ticket = rig.send_as(1, 0, angles(8, 1, 0.0, -20.0));
    assert_eq!(rig.end_as(1, ticket), REFUSED);
    rig.send_plan(legs());
    rig.done(orders::load());
    let kind = mavlink_link::service::mission::MavMissionType::MAV_MISSION_TYPE_MISSION;
    let items = rig.vehicles[0].vehicle().plan(kind);
    assert!(items.iter().all(|item| item.command == 16), "{items:?}");
}

/// The station has passed on between the 13004 and the 13000: who looks through the sensor now must not have it turned.
#[test]
fn a_route_that_points_a_station_of_another_cucs_is_not_loaded() {
    let mut rig = rig("provisional = \"all\"", 2);
    take(&mut rig, 0, ALL, 1);
    let mut plan = legs();
    plan.push(angles(8, 1, 40.0, -50.0).into());
    rig.send_plan(plan);
    let release = CucsAuthorisationRequest {
        requested_handover_loi: Some(LoiBitmap::from_raw(LOI_3)),
        requested_handover_access: Some(RequestedAccess::Relinquish),
        controlled_station_1_16: Some(StationBitmap1To16::STATION_1),
        ..CucsAuthorisationRequest::default()
    };
    let ticket = rig.send_as(0, 0, release);
    assert_eq!(rig.end_as(0, ticket), DONE);
    take(&mut rig, 1, LOI_3, 1);
    assert_eq!(rig.carry_out(orders::load()), REFUSED);
    let why = "waypoint 8 has a payload action (13004): it needs LOI 3 (payload) of station 1";
    assert!(rig.station().has_alert(why), "{:?}", rig.station().alerts());
    let kind = mavlink_link::service::mission::MavMissionType::MAV_MISSION_TYPE_MISSION;
    assert!(rig.vehicles[0].vehicle().plan(kind).is_empty());
    // A route without it is loaded.
    rig.send_plan(legs());
    rig.done(orders::load());
}

#[test]
fn a_layout_that_is_not_agreed_on_points_nothing() {
    let mut rig = rig("", 1);
    take(&mut rig, 0, ALL, 1);
    assert_eq!(rig.carry_out(angles(8, 1, 0.0, -20.0)), REFUSED);
    assert!(rig.station().has_alert("dli.provisional"));
}
