//! Payload stations: which there are and who holds them, an EO/IR operator who points, zooms and records while another CUCS
//! flies, and a payload that changes hands in flight.

use kit::bridge::{Rig, Setup, orders, vehicle_id};
use mapping::payload::report::{PHOTOGRAPH, RECORDING};
use stanag_msgs::enums::{
    AckType, AltitudeType, EoirPointingMode as Pointing, EoirSystemMode as System,
    FlightPathControlMode as Mode, ImageOutput, LoiBitmap, RequestedAccess, SetFocus, SetZoom,
    StationBitmap1To16,
};
use stanag_msgs::klv::LocalSet;
use stanag_msgs::messages::{
    CucsAuthorisationRequest, EoIrLaserOperatingState, EoIrLaserPayloadCommand,
    GenericInformationRequestMessage, PayloadSteeringCommand, PositiveHandoverAuthorisationRequest,
};
use stanag_msgs::{Bam16, Bam32, Message, Scaled};
use vsm::klv::view::View;

const DONE: Option<AckType> = Some(AckType::CarriedOut);
const REFUSED: Option<AckType> = Some(AckType::Refused);
/// Flies.
const PILOT: usize = 0;
/// Holds a payload station.
const OPERATOR: usize = 1;
/// Holds another, or takes over.
const SECOND: usize = 2;

fn rig(payloads: u8) -> Rig {
    let mut rig = Rig::new(Setup {
        stations: 3,
        vehicles: vec![px4_sim::Config {
            payloads,
            ..px4_sim::Config::default()
        }],
        dli_keys: "provisional = \"all\"",
        ..Setup::default()
    });
    rig.run(12.0);
    rig
}

fn take(rig: &mut Rig, by: usize, levels: u8, stations: u16) -> Option<AckType> {
    let request = CucsAuthorisationRequest {
        requested_handover_loi: Some(LoiBitmap::from_raw(levels)),
        requested_handover_access: Some(RequestedAccess::Request),
        controlled_station_1_16: Some(StationBitmap1To16::from_raw(stations)),
        ..CucsAuthorisationRequest::default()
    };
    let ticket = rig.send_as(by, 0, request);
    let end = rig.end_as(by, ticket);
    rig.run(0.5);
    end
}

/// What message 2 has shown a station last: LOI Granted, and the payload stations.
fn shown(rig: &Rig, of: usize) -> (u8, u16) {
    let last = rig.stations[of].last(vehicle_id(0), 2, |message| match message {
        Message::VsmAuthorisationResponse(m) => {
            Some((m.loi_granted?.raw(), m.controlled_station_1_16?.raw()))
        }
        _ => None,
    });
    last.expect("message 2")
}

fn steer(station: u16) -> PayloadSteeringCommand {
    PayloadSteeringCommand {
        station_number_1_16: Some(StationBitmap1To16::from_raw(station)),
        ..PayloadSteeringCommand::default()
    }
}

fn angles(station: u16, azimuth: f64, elevation: f64) -> PayloadSteeringCommand {
    PayloadSteeringCommand {
        set_centreline_azimuth_angle: Some(Bam16::from_degrees(azimuth)),
        set_centreline_elevation_angle: Some(Bam16::from_degrees(elevation)),
        ..steer(station)
    }
}

fn sensor(station: u16) -> EoIrLaserPayloadCommand {
    EoIrLaserPayloadCommand {
        station_number_1_16: Some(StationBitmap1To16::from_raw(station)),
        ..EoIrLaserPayloadCommand::default()
    }
}

fn pointing(station: u16, mode: Pointing) -> EoIrLaserPayloadCommand {
    EoIrLaserPayloadCommand {
        set_eo_ir_pointing_mode: Some(mode),
        ..sensor(station)
    }
}

fn system(station: u16, mode: System) -> EoIrLaserPayloadCommand {
    EoIrLaserPayloadCommand {
        system_operating_mode: Some(mode),
        ..sensor(station)
    }
}

fn order(rig: &mut Rig, by: usize, message: impl Into<Message>) -> Option<AckType> {
    let ticket = rig.send_as(by, 0, message);
    rig.end_as(by, ticket)
}

/// Carried out, or the alerts say why not.
fn done(rig: &mut Rig, by: usize, message: impl Into<Message>) {
    let end = order(rig, by, message);
    assert_eq!(end, DONE, "{:?}", rig.stations[by].alerts());
}

fn state(rig: &Rig, of: usize, station: u16) -> EoIrLaserOperatingState {
    let all = rig.stations[of].received.iter().rev();
    let mut states = all.filter_map(|(_, _, message)| match message {
        Message::EoIrLaserOperatingState(state) if state.station_number_1_16 == Some(station) => {
            Some(state.clone())
        }
        _ => None,
    });
    states.next().expect("21101")
}

/// Azimuth and elevation of a payload's line of sight from the vehicle's heading, degrees.
fn looks(rig: &Rig, station: usize) -> (f64, f64) {
    let [north, east, down] = rig.vehicles[0].vehicle().payloads()[station].sight;
    let heading = rig.truth().attitude[2];
    let azimuth = (east.atan2(north) - heading).to_degrees();
    (
        (azimuth + 540.0).rem_euclid(360.0) - 180.0,
        (-down).asin().to_degrees(),
    )
}

#[test]
fn a_vehicle_without_payload_offers_no_station() {
    let mut rig = rig(0);
    assert_eq!(take(&mut rig, OPERATOR, 0x02, 0), REFUSED);
    assert!(rig.stations[OPERATOR].has_alert("the vehicle has no such payload station"));
    assert_eq!(shown(&rig, OPERATOR), (0, 0));
    // Beside other levels it is granted, for no station.
    assert_eq!(take(&mut rig, PILOT, 0x0f, 0), DONE);
    assert_eq!(shown(&rig, PILOT), (0x0f, 0));
    assert_eq!(order(&mut rig, PILOT, angles(1, 0.0, 0.0)), REFUSED);
    // Nothing is asked of devices that are not there.
    let before = rig.vehicles[0].vehicle().counters().commands_ignored;
    rig.run(10.0);
    assert_eq!(
        rig.vehicles[0].vehicle().counters().commands_ignored,
        before
    );
}

#[test]
fn stations_are_those_that_the_vehicle_shows_and_each_has_one_holder() {
    let mut rig = rig(2);
    assert_eq!(take(&mut rig, OPERATOR, 0x02, 0b1), DONE);
    assert_eq!(shown(&rig, OPERATOR), (0x03, 0b1));
    assert_eq!(
        take(&mut rig, SECOND, 0x02, 0b101),
        REFUSED,
        "one of them is there and held"
    );
    assert_eq!(take(&mut rig, SECOND, 0x02, 0b10), DONE);
    assert_eq!(shown(&rig, SECOND), (0x03, 0b10));
    // 21000 came unrequested, one a station.
    let mut of = Vec::new();
    for (_, _, message) in &rig.stations[OPERATOR].received {
        if let Message::PayloadConfiguration(m) = message {
            let bits = m.payload_stations_available_1_16.map(|bits| bits.raw());
            of.push((m.station_number_1_16.map(|bits| bits.raw()), bits));
        }
    }
    of.sort_unstable();
    of.dedup();
    assert_eq!(of, [(Some(1), Some(3)), (Some(2), Some(3))]);
    // Each commands its own.
    assert_eq!(
        order(&mut rig, OPERATOR, pointing(0b10, Pointing::AngleToUa)),
        REFUSED
    );
    assert!(rig.stations[OPERATOR].has_alert("it needs LOI 3 (payload) of station 2"));
    done(&mut rig, SECOND, pointing(0b10, Pointing::AngleToUa));
    done(&mut rig, OPERATOR, pointing(0b1, Pointing::AngleToUa));
    done(&mut rig, SECOND, angles(0b10, -40.0, -20.0));
    done(&mut rig, OPERATOR, angles(0b1, 40.0, -50.0));
    for (station, (azimuth, elevation)) in [(0, (40.0, -50.0)), (1, (-40.0, -20.0))] {
        let (a, e) = looks(&rig, station);
        assert!(
            (a - azimuth).abs() < 3.5 && (e - elevation).abs() < 3.5,
            "{station}: {a} {e}"
        );
    }
}

/// PX4 takes GIMBAL_MANAGER_SET_ATTITUDE of who controls its gimbal, whatever gimbal that is for.
#[test]
fn who_turns_one_station_moves_no_other() {
    let mut rig = rig(2);
    assert_eq!(take(&mut rig, PILOT, 0x0c, 0), DONE);
    assert_eq!(take(&mut rig, OPERATOR, 0x02, 0b1), DONE);
    assert_eq!(take(&mut rig, SECOND, 0x02, 0b10), DONE);
    done(&mut rig, PILOT, orders::launch(30.0));
    assert!(rig.until(60.0, |rig| -rig.truth().position.d > 29.0));
    done(&mut rig, OPERATOR, pointing(0b1, Pointing::AngleToUa));
    done(&mut rig, OPERATOR, angles(0b1, 40.0, -50.0));
    let stays = |rig: &Rig| {
        let (azimuth, elevation) = looks(rig, 0);
        assert!(
            (azimuth - 40.0).abs() < 3.5 && (elevation + 50.0).abs() < 3.5,
            "{azimuth} {elevation}"
        );
    };
    done(&mut rig, SECOND, pointing(0b10, Pointing::SlewRateToUa));
    let slew = PayloadSteeringCommand {
        horizontal_slew_rate: Some(Scaled::saturating_from_si(0.1)),
        vertical_slew_rate: Some(Scaled::saturating_from_si(-0.1)),
        ..steer(0b10)
    };
    done(&mut rig, SECOND, slew);
    rig.run(5.0);
    let (azimuth, elevation) = looks(&rig, 1);
    assert!(azimuth > 20.0 && elevation < -20.0, "{azimuth} {elevation}");
    stays(&rig);
    done(&mut rig, SECOND, pointing(0b10, Pointing::LatLongSlaved));
    let (latitude, longitude) = orders::place(60.0, -60.0);
    let stare = PayloadSteeringCommand {
        latitude: Some(Bam32::from_degrees(latitude)),
        longitude: Some(Bam32::from_degrees(longitude)),
        altitude: Some(Scaled::saturating_from_si(0.0)),
        altitude_type: Some(AltitudeType::Agl),
        ..steer(0b10)
    };
    done(&mut rig, SECOND, stare);
    let (azimuth, _) = looks(&rig, 1);
    assert!((azimuth + 45.0).abs() < 5.0, "{azimuth}");
    stays(&rig);
}

#[test]
fn the_video_streams_of_cameras_are_announced_when_they_appear_and_on_request() {
    let mut rig = rig(2);
    // LOI 2 alone is granted to who only listens.
    let request = CucsAuthorisationRequest {
        requested_handover_loi: Some(LoiBitmap::LOI2),
        requested_handover_access: Some(RequestedAccess::Request),
        ..CucsAuthorisationRequest::default()
    };
    let ticket = rig.send_as(OPERATOR, 0, request);
    assert_eq!(rig.end_as(OPERATOR, ticket), DONE);
    rig.run(8.0);
    let streams = |rig: &Rig, from: usize| -> Vec<(u16, String)> {
        let received = rig.stations[OPERATOR].received[from..].iter();
        let streams = received.filter_map(|(_, _, message)| match message {
            Message::VideoStreamReport(one) => Some((
                one.station_number_1_16?.raw(),
                one.uri.as_ref()?.as_str().to_owned(),
            )),
            _ => None,
        });
        streams.collect()
    };
    let expected = [(1, 100), (2, 101)]
        .map(|(bit, camera)| (bit, format!("rtsp://192.168.144.25:8554/camera{camera}")));
    let mut announced = streams(&rig, 0);
    announced.sort();
    assert_eq!(announced, expected, "once each");
    let before = rig.stations[OPERATOR].received.len();
    let request = GenericInformationRequestMessage {
        message_type: Some(50025),
        station_number_1_16: Some(StationBitmap1To16::from_raw(2)),
        ..GenericInformationRequestMessage::default()
    };
    assert_eq!(order(&mut rig, OPERATOR, request), DONE);
    rig.run(0.3);
    assert_eq!(streams(&rig, before), expected[1..]);
    // Who begins to listen later is sent them with the grant.
    let before = rig.stations[SECOND].received.len();
    assert_eq!(take(&mut rig, SECOND, 0x01, 0), DONE);
    let late = rig.stations[SECOND].received[before..].iter();
    let late = late.filter(|(_, _, message)| message.id() == 50025);
    assert_eq!(late.count(), 2);
}

#[test]
fn an_operator_points_zooms_and_records_while_another_flies() {
    let mut rig = rig(1);
    assert_eq!(take(&mut rig, PILOT, 0x0c, 0), DONE);
    assert_eq!(take(&mut rig, OPERATOR, 0x02, 0b1), DONE);
    done(&mut rig, PILOT, orders::launch(30.0));
    assert!(rig.until(60.0, |rig| -rig.truth().position.d > 29.0));
    // Who flies does not steer the payload, and who steers it does not fly.
    assert_eq!(order(&mut rig, PILOT, angles(1, 0.0, 0.0)), REFUSED);
    assert_eq!(order(&mut rig, OPERATOR, orders::launch(50.0)), REFUSED);

    done(&mut rig, OPERATOR, pointing(1, Pointing::AngleToUa));
    done(&mut rig, OPERATOR, angles(1, 90.0, -30.0));
    rig.run(2.0);
    let (azimuth, elevation) = looks(&rig, 0);
    assert!((azimuth - 90.0).abs() < 3.5 && (elevation + 30.0).abs() < 3.5);
    let seen = state(&rig, OPERATOR, 1);
    assert_eq!(seen.pointing_mode_state, Some(Pointing::AngleToUa));
    let range = seen.reported_range.expect("a range");
    // 30 m up, 30 degrees down: 60 m away.
    assert!((f64::from(range) - 60.0).abs() < 5.0, "{range}");
    assert_eq!(seen.image_position, Some(1));
    let (north, east) = {
        let home = px4_sim::LocalFrame::new(px4_sim::Config::default().home);
        let at = home.to_local(px4_sim::Geodetic {
            latitude_deg: seen.latitude_of_image_centre.expect("a place").degrees(),
            longitude_deg: seen.longitude_of_image_centre.expect("a place").degrees(),
            altitude_m: 488.0,
        });
        (at.n, at.e)
    };
    let [n, e, d] = rig.vehicles[0].vehicle().payloads()[0].sight;
    let at = rig.truth().position;
    let (true_n, true_e) = (at.n + n / d * -at.d, at.e + e / d * -at.d);
    assert!(
        (north - true_n).hypot(east - true_e) < 4.0,
        "{north} {east}, {true_n} {true_e}"
    );
    metadata_shows(&rig, &seen);

    // Zoom in, stop, and to a field of view.
    let zoom = |zoom| PayloadSteeringCommand {
        set_zoom: Some(zoom),
        ..steer(1)
    };
    let wide = rig.vehicles[0].vehicle().payloads()[0].hfov;
    done(&mut rig, OPERATOR, zoom(SetZoom::ZoomIn));
    done(&mut rig, OPERATOR, zoom(SetZoom::NoChange));
    assert!(rig.vehicles[0].vehicle().payloads()[0].hfov < wide);
    let field = PayloadSteeringCommand {
        set_horizontal_field_of_view: Some(Bam16::from_degrees(20.0)),
        ..zoom(SetZoom::UseFieldsOfView)
    };
    done(&mut rig, OPERATOR, field);
    let hfov = rig.vehicles[0].vehicle().payloads()[0].hfov.to_degrees();
    assert!((hfov - 20.0).abs() < 1.0, "{hfov}");
    let focus = PayloadSteeringCommand {
        set_focus: Some(SetFocus::FocusCloser),
        ..steer(1)
    };
    let before = rig.vehicles[0].vehicle().payloads()[0].focus;
    done(&mut rig, OPERATOR, focus);
    assert!(rig.vehicles[0].vehicle().payloads()[0].focus < before);

    // Photographs, video, and the other sensor.
    done(&mut rig, OPERATOR, system(1, PHOTOGRAPH));
    assert_eq!(rig.vehicles[0].vehicle().payloads()[0].images, 1);
    done(&mut rig, OPERATOR, system(1, RECORDING));
    assert!(rig.vehicles[0].vehicle().payloads()[0].recording);
    rig.run(3.0);
    assert_eq!(
        state(&rig, OPERATOR, 1).system_operating_mode_state,
        Some(RECORDING)
    );
    assert_eq!(
        order(&mut rig, OPERATOR, system(1, PHOTOGRAPH)),
        REFUSED,
        "it records"
    );
    done(&mut rig, OPERATOR, system(1, System::Active));
    assert!(!rig.vehicles[0].vehicle().payloads()[0].recording);
    let infrared = EoIrLaserPayloadCommand {
        image_output: Some(ImageOutput::Ir),
        ..sensor(1)
    };
    done(&mut rig, OPERATOR, infrared);
    assert!(rig.vehicles[0].vehicle().payloads()[0].thermal);
    rig.vehicles[0].vehicle_mut().set_storage(0, 2.0);
    rig.run(6.0);
    assert_eq!(order(&mut rig, OPERATOR, system(1, RECORDING)), REFUSED);
    assert!(rig.stations[OPERATOR].has_alert("2 MiB left"));
    assert!(rig.truth().armed, "the flight goes on");
}

/// What `vsm klv` makes of the messages that the operator has received: the same, of the time of the last 4000.
fn metadata_shows(rig: &Rig, seen: &EoIrLaserOperatingState) {
    let mut view = View::new(1, None);
    let received = rig.stations[OPERATOR].received.iter();
    let now_us = rig.now().wall.as_micros() as u64;
    let made = received.filter_map(|(_, _, message)| Some((message, view.take(message, now_us)?)));
    let made: Vec<_> = made.collect();
    // Of 2 s, in which 21101 came four times.
    let mut lately = made.iter().rev().take(10);
    assert!(lately.all(|(_, set)| set.sensor_relative_azimuth_deg.is_some()));
    let (message, set) = made.last().expect("a 4000");
    let Message::InertialStates(states) = message else {
        panic!("{message:?}");
    };
    let (set, _) = LocalSet::decode(&set.encode().expect("in range")).expect("a set");
    let valid = states.time_stamp.expect("a stamp").unix_ms() * 1_000;
    assert_eq!(set.time_us, valid, "when the position was valid");
    let truth = rig.truth();
    let near = |name: &str, value: Option<f64>, expected: f64, within: f64| {
        let value = value.expect(name);
        assert!((value - expected).abs() < within, "{name} {value}");
    };
    let at = truth.believed;
    near("latitude", set.sensor_latitude_deg, at.latitude_deg, 2e-5);
    near(
        "longitude",
        set.sensor_longitude_deg,
        at.longitude_deg,
        2e-5,
    );
    let heading = truth.attitude[2].to_degrees().rem_euclid(360.0);
    near("heading", set.platform_heading_deg, heading, 1.0);
    near("azimuth", set.sensor_relative_azimuth_deg, 90.0, 3.5);
    near("elevation", set.sensor_relative_elevation_deg, -30.0, 3.5);
    near("range", set.slant_range_m, 60.0, 5.0);
    let centre = seen.latitude_of_image_centre.expect("a place").degrees();
    near("centre", set.frame_center_latitude_deg, centre, 1e-4);
    // Both heights are above the ellipsoid: the ground is as far below as the vehicle has climbed.
    let height = set.frame_center_ellipsoid_height_m.expect("a height") + 30.0;
    near("height", set.sensor_ellipsoid_height_m, height, 2.0);
    assert_eq!(set.sensor_true_altitude_m, None, "of one datum");
}

#[test]
fn a_gimbal_keeps_looking_at_a_place_while_the_vehicle_flies_past() {
    let mut rig = rig(1);
    assert_eq!(take(&mut rig, PILOT, 0x0c, 0), DONE);
    assert_eq!(take(&mut rig, OPERATOR, 0x02, 0b1), DONE);
    rig.send_plan(orders::square());
    rig.done(orders::load());
    done(&mut rig, PILOT, orders::launch(20.0));
    assert!(rig.until(60.0, |rig| -rig.truth().position.d > 19.0));
    done(&mut rig, OPERATOR, pointing(1, Pointing::AngleToUa));
    done(&mut rig, OPERATOR, angles(1, 0.0, -40.0));
    // It locks on what it sees; then on a place that is named.
    done(&mut rig, OPERATOR, pointing(1, Pointing::LatLongSlaved));
    let (latitude, longitude) = orders::place(60.0, 60.0);
    let stare = PayloadSteeringCommand {
        latitude: Some(Bam32::from_degrees(latitude)),
        longitude: Some(Bam32::from_degrees(longitude)),
        altitude: Some(Scaled::saturating_from_si(0.0)),
        altitude_type: Some(AltitudeType::Agl),
        ..steer(1)
    };
    done(&mut rig, OPERATOR, stare);
    done(&mut rig, PILOT, orders::mode(Mode::Waypoint));
    for _ in 0..3 {
        rig.run(5.0);
        let [n, e, d] = rig.vehicles[0].vehicle().payloads()[0].sight;
        let at = rig.truth().position;
        let (seen_n, seen_e) = (at.n + n / d * -at.d, at.e + e / d * -at.d);
        assert!(
            (seen_n - 60.0).hypot(seen_e - 60.0) < 15.0,
            "{seen_n} {seen_e} from {at:?}"
        );
    }
    // Rates: it turns until it is commanded to stop, or nobody holds it.
    done(&mut rig, OPERATOR, pointing(1, Pointing::SlewRateToUa));
    let slew = PayloadSteeringCommand {
        horizontal_slew_rate: Some(Scaled::saturating_from_si(0.1)),
        vertical_slew_rate: Some(Scaled::saturating_from_si(0.0)),
        ..steer(1)
    };
    done(&mut rig, OPERATOR, slew);
    let (from, _) = looks(&rig, 0);
    rig.run(6.0);
    let (to, _) = looks(&rig, 0);
    let turned = (to - from + 540.0).rem_euclid(360.0) - 180.0;
    assert!(
        turned > 20.0,
        "longer than the 2 s after which PX4 ends rates: {turned}"
    );
    assert_eq!(
        order(
            &mut rig,
            OPERATOR,
            CucsAuthorisationRequest {
                requested_handover_loi: Some(LoiBitmap::LOI3),
                requested_handover_access: Some(RequestedAccess::Relinquish),
                ..CucsAuthorisationRequest::default()
            }
        ),
        DONE
    );
    rig.run(1.0);
    let (from, _) = looks(&rig, 0);
    rig.run(3.0);
    let (to, _) = looks(&rig, 0);
    assert!((to - from).abs() < 4.0, "nobody holds it: {from} {to}");
}

/// PX4's navigator takes its gimbal from whoever has it, and centres it.
#[test]
fn a_gimbal_that_the_vehicle_has_centred_is_not_reported_as_pointed() {
    let mut rig = rig(1);
    assert_eq!(take(&mut rig, PILOT, 0x0c, 0), DONE);
    assert_eq!(take(&mut rig, OPERATOR, 0x02, 0b1), DONE);
    rig.send_plan(orders::square());
    rig.done(orders::load());
    done(&mut rig, PILOT, orders::launch(20.0));
    assert!(rig.until(60.0, |rig| -rig.truth().position.d > 19.0));
    done(&mut rig, PILOT, orders::mode(Mode::Waypoint));
    done(&mut rig, OPERATOR, pointing(1, Pointing::AngleToUa));
    done(&mut rig, OPERATOR, angles(1, 40.0, -50.0));
    rig.run(1.0);
    let mode = |rig: &Rig| state(rig, OPERATOR, 1).pointing_mode_state;
    assert_eq!(mode(&rig), Some(Pointing::AngleToUa));
    done(&mut rig, PILOT, orders::mode(Mode::Loiter));
    rig.run(4.0);
    let (azimuth, elevation) = looks(&rig, 0);
    assert!(
        azimuth.abs() < 5.0 && elevation.abs() < 5.0,
        "{azimuth} {elevation}"
    );
    assert_eq!(mode(&rig), Some(Pointing::NoValue));
    assert!(rig.stations[OPERATOR].has_alert("controlled by nobody now"));
    done(&mut rig, OPERATOR, angles(1, -30.0, -20.0));
    rig.run(1.0);
    assert_eq!(mode(&rig), Some(Pointing::AngleToUa));
}

#[test]
fn a_payload_is_handed_over_in_flight_and_stowed_by_its_new_holder() {
    let mut rig = rig(2);
    assert_eq!(take(&mut rig, PILOT, 0x0c, 0), DONE);
    assert_eq!(take(&mut rig, OPERATOR, 0x02, 0b10), DONE);
    done(&mut rig, PILOT, orders::launch(20.0));
    assert!(rig.until(60.0, |rig| -rig.truth().position.d > 19.0));
    let hand = |to: usize, rig: &Rig| PositiveHandoverAuthorisationRequest {
        requested_handover_loi: Some(LoiBitmap::LOI3),
        controlled_station_1_16: Some(StationBitmap1To16::from_raw(0b10)),
        requesting_cucs_id: Some(rig.stations[to].id),
        ..PositiveHandoverAuthorisationRequest::default()
    };
    let offer = hand(SECOND, &rig);
    let offered = rig.send_as(OPERATOR, 0, offer);
    rig.run(1.0);
    let accept = hand(SECOND, &rig);
    done(&mut rig, SECOND, accept);
    assert_eq!(rig.end_as(OPERATOR, offered), DONE);
    rig.run(0.5);
    assert_eq!(shown(&rig, SECOND), (0x03, 0b10));
    assert_eq!(
        order(&mut rig, OPERATOR, system(0b10, System::Stow)),
        REFUSED
    );
    done(&mut rig, SECOND, system(0b10, System::Stow));
    assert!(rig.vehicles[0].vehicle().payloads()[1].retracted);
    rig.run(2.0);
    let stowed = state(&rig, SECOND, 0b10);
    assert_eq!(stowed.system_operating_mode_state, Some(System::Stow));
    assert_eq!(
        stowed.actual_centreline_azimuth_angle, None,
        "it looks nowhere"
    );
    done(&mut rig, SECOND, system(0b10, System::Active));
    // 17002 for one station.
    let request = GenericInformationRequestMessage {
        message_type: Some(21100),
        station_number_1_16: Some(StationBitmap1To16::from_raw(0b10)),
        ..GenericInformationRequestMessage::default()
    };
    done(&mut rig, SECOND, request);
    rig.run(0.5);
    let rows = rig.stations[SECOND].last(vehicle_id(0), 21100, |message| match message {
        Message::EoIrConfigurationState(m) => m.eo_vertical_image_dimension,
        _ => None,
    });
    assert_eq!(rows, Some(1080));
    assert!(rig.truth().armed);
}
