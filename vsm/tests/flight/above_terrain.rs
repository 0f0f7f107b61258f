//! `agl = "terrain"`: altitude type 2 is height above the ground of the elevation files, at waypoints and between them, and the
//! vehicle that flies such a route keeps it.

use std::fmt::Write as _;

use curve_paths::terrain::{Grid, Terrain};
use kit::bridge::{Rig, Setup, orders};
use px4_sim::Config;
use stanag_msgs::Message;
use stanag_msgs::enums::{
    AckType, AltitudeType, EoirPointingMode, FlightPathControlMode as Mode, LoiBitmap,
    StationBitmap1To16,
};
use stanag_msgs::messages::{
    CucsAuthorisationRequest, CurveSegment, EoIrLaserPayloadCommand,
    GenericInformationRequestMessage, PayloadSteeringCommand, VehicleOperatingModeCommand,
};
use stanag_msgs::{Bam16, Bam32, Scaled};

/// A folder with one elevation file, and what is in it: a ridge of 40 m across, its crest 150 m north of home, its feet 50 m
/// and 250 m north.
struct Ridge {
    folder: tempfile::TempDir,
    ground: Terrain,
}

impl Ridge {
    fn new() -> Ridge {
        let home = Config::default().home;
        let (step, rows, columns) = (0.0002, 40_u32, 40_u32);
        let mut text = format!(
            "ncols {columns}\nnrows {rows}\nxllcenter {}\nyllcenter {}\ncellsize {step}\n",
            home.longitude_deg - 0.004,
            home.latitude_deg - 0.004
        );
        for row in (0..rows).rev() {
            let north_m = (f64::from(row) * step - 0.004) * 111_195.0;
            let ridge_m = (40.0 - 0.4 * (north_m - 150.0).abs()).max(0.0);
            let height = format!("{:.2} ", home.altitude_m + ridge_m);
            writeln!(text, "{}", height.repeat(columns as usize)).expect("a string");
        }
        let folder = tempfile::tempdir().expect("a folder");
        std::fs::write(folder.path().join("ridge.asc"), &text).expect("it can be written");
        let grid = Grid::read("ridge.asc", text.into()).expect("a grid");
        Ridge {
            folder,
            ground: Terrain::new(vec![grid]),
        }
    }

    fn setup(&self) -> Setup {
        let keys = format!("agl = \"terrain\"\nterrain = {:?}\n", self.folder.path());
        Setup {
            vehicle_keys: keys.leak(),
            ..Setup::default()
        }
    }

    fn rig(&self) -> Rig {
        Rig::ready_with(self.setup())
    }

    /// How high the vehicle is above the ground below it, m.
    fn clearance_m(&self, rig: &Rig) -> f64 {
        let place = rig.truth().place;
        let ground = self
            .ground
            .height_m(place.latitude_deg, place.longitude_deg);
        place.altitude_m - ground.expect("the file covers where it flies")
    }
}

fn refusal(rig: &mut Rig, plan: Vec<Message>) -> String {
    rig.send_plan(plan);
    assert_eq!(rig.carry_out(orders::load()), Some(AckType::Refused));
    rig.run(0.5);
    rig.station().alerts().join("; ")
}

/// A curved leg that bulges north, over the crest where its ends are south of it.
fn bulge(from: u16, to: u16) -> CurveSegment {
    let control = |east| {
        let (latitude, longitude) = orders::place(240.0, east);
        let degrees = |degrees| Some(Bam32::from_degrees(degrees));
        (degrees(latitude), degrees(longitude))
    };
    let (p2, p3) = (control(20.0), control(100.0));
    CurveSegment {
        p1_waypoint_no: Some(from),
        p4_waypoint_no: Some(to),
        p2_latitude: p2.0,
        p2_longitude: p2.1,
        p3_latitude: p3.0,
        p3_longitude: p3.1,
        ..CurveSegment::default()
    }
}

#[test]
fn a_route_over_a_ridge_keeps_its_height_above_the_ground_on_straight_legs_and_on_curves() {
    const HEIGHT_M: f64 = 25.0;
    let ridge = Ridge::new();
    let mut rig = ridge.rig();
    // Over the ridge and back straight, then a curve over its crest. All are equally high above the ground below them.
    rig.send_plan(vec![
        orders::route(1).into(),
        orders::waypoint(1, 2, 20.0, 0.0, HEIGHT_M).into(),
        orders::waypoint(2, 3, 270.0, 0.0, HEIGHT_M).into(),
        orders::waypoint(3, 4, 40.0, 20.0, HEIGHT_M).into(),
        orders::waypoint(4, 0, 40.0, 100.0, HEIGHT_M).into(),
        bulge(3, 4).into(),
    ]);
    rig.done(orders::load());
    rig.take_off(HEIGHT_M);
    rig.done(orders::mode(Mode::Waypoint));
    let (mut least_m, mut highest_m) = (f64::INFINITY, f64::NEG_INFINITY);
    let mut begun = false;
    let ended = (0..2_400).any(|_| {
        rig.run(0.25);
        let truth = rig.truth();
        begun |= truth.position.n > 15.0;
        if begun {
            least_m = least_m.min(ridge.clearance_m(&rig));
            highest_m = highest_m.max(truth.place.altitude_m);
        }
        begun && (truth.position.n - 40.0).hypot(truth.position.e - 100.0) < 5.0
    });
    assert!(ended, "it is at {:?}", rig.truth());
    // Nine tenths of the height are kept by the profile; the rest is what the vehicle flies beside it.
    assert!(
        least_m > 0.9 * HEIGHT_M - 2.5,
        "{least_m} m above the ground"
    );
    let crest_m = Config::default().home.altitude_m + 40.0;
    assert!(
        highest_m > crest_m + 0.8 * HEIGHT_M,
        "it flew over the crest at {highest_m}"
    );
}

#[test]
fn where_no_file_covers_the_ground_nothing_is_flown() {
    let ridge = Ridge::new();
    let mut rig = ridge.rig();
    let beyond = |north| -> Vec<Message> {
        vec![
            orders::route(7).into(),
            orders::waypoint(7, 8, 50.0, 0.0, 30.0).into(),
            orders::waypoint(8, 0, north, 0.0, 30.0).into(),
        ]
    };
    let why = refusal(&mut rig, beyond(900.0));
    assert!(
        why.contains("waypoint 8: altitude type 2 (AGL): the height of the ground at 47.4")
            && why.contains("is not known; add N47E008.hgt to vehicle.terrain"),
        "{why}"
    );
    // A loiter in mode 12 too, and mode 15 follows no ground.
    rig.take_off(30.0);
    let (latitude, longitude) = orders::place(900.0, 0.0);
    let loiter = VehicleOperatingModeCommand {
        loiter_position_latitude: Some(Bam32::from_degrees(latitude)),
        loiter_position_longitude: Some(Bam32::from_degrees(longitude)),
        commanded_altitude: Some(Scaled::saturating_from_si(30.0)),
        altitude_type: Some(AltitudeType::Agl),
        ..orders::mode(Mode::Loiter)
    };
    assert_eq!(rig.carry_out(loiter.clone()), Some(AckType::Refused));
    let steered = VehicleOperatingModeCommand {
        loiter_position_latitude: None,
        loiter_position_longitude: None,
        select_flight_path_control_mode: Some(Mode::Autopilot),
        ..loiter.clone()
    };
    assert_eq!(rig.carry_out(steered), Some(AckType::Refused));
    let alerts = rig.station().alerts().join("; ");
    assert!(alerts.contains("does not follow the ground"), "{alerts}");
    // On the crest it is known.
    let (latitude, longitude) = orders::place(150.0, 0.0);
    let crest = VehicleOperatingModeCommand {
        loiter_position_latitude: Some(Bam32::from_degrees(latitude)),
        loiter_position_longitude: Some(Bam32::from_degrees(longitude)),
        commanded_altitude: Some(Scaled::saturating_from_si(40.0)),
        ..loiter
    };
    rig.done(crest);
    let there = |rig: &Rig| (ridge.clearance_m(rig) - 40.0).abs() < 4.0;
    assert!(rig.until(60.0, |rig| rig.truth().position.n > 145.0 && there(rig)));
}

#[test]
fn a_loop_is_not_closed_over_a_ridge_without_a_waypoint_there() {
    use stanag_msgs::enums::WaypointType;
    let ridge = Ridge::new();
    let mut rig = ridge.rig();
    let mut end = orders::waypoint(8, 7, 270.0, 0.0, 25.0);
    end.waypoint_type = Some(WaypointType::EndOfLoop);
    let why = refusal(
        &mut rig,
        vec![
            orders::route(7).into(),
            orders::waypoint(7, 8, 20.0, 0.0, 25.0).into(),
            end.into(),
        ],
    );
    assert!(
        why.contains("the leg that leads back to 7 needs points"),
        "{why}"
    );
}

#[test]
fn the_height_above_the_ground_is_reported_as_it_is() {
    let ridge = Ridge::new();
    let mut rig = ridge.rig();
    rig.take_off(20.0);
    let asked = GenericInformationRequestMessage {
        message_type: Some(3009),
        ..GenericInformationRequestMessage::default()
    };
    rig.send_once(asked);
    rig.run(1.0);
    let reported = rig
        .station()
        .received
        .iter()
        .rev()
        .find_map(|(_, _, message)| match message {
            Message::AirAndGroundRelativeStates(states) => states.agl_altitude,
            _ => None,
        });
    let reported_m = reported.expect("a 3009").si();
    assert!(
        (reported_m - ridge.clearance_m(&rig)).abs() < 3.0,
        "{reported_m}"
    );
}

#[test]
fn a_camera_that_looks_at_the_ridge_sees_its_slope_and_not_the_plain_behind_it() {
    let ridge = Ridge::new();
    let mut rig = Rig::ready_with(Setup {
        vehicles: vec![Config {
            payloads: 1,
            ..Config::default()
        }],
        dli_keys: "provisional = \"all\"",
        ..ridge.setup()
    });
    // LOI 3 of station 1 beside control.
    let request = CucsAuthorisationRequest {
        requested_handover_loi: Some(LoiBitmap::from_raw(0x0e)),
        controlled_station_1_16: Some(StationBitmap1To16::STATION_1),
        ..orders::request_control()
    };
    rig.done(request);
    rig.take_off(60.0);
    let station = Some(StationBitmap1To16::STATION_1);
    let by_angles = EoIrLaserPayloadCommand {
        station_number_1_16: station,
        set_eo_ir_pointing_mode: Some(EoirPointingMode::AngleToUa),
        ..EoIrLaserPayloadCommand::default()
    };
    rig.done(by_angles);
    // Its crest is 20 m below and 150 m north, whichever way the vehicle points; straight on the plain would be 450 m away.
    let heading = rig.truth().attitude[2].to_degrees();
    let at_the_crest = PayloadSteeringCommand {
        station_number_1_16: station,
        set_centreline_azimuth_angle: Some(Bam16::from_degrees(-heading)),
        set_centreline_elevation_angle: Some(Bam16::from_degrees(-9.0)),
        ..PayloadSteeringCommand::default()
    };
    rig.done(at_the_crest);
    rig.run(3.0);
    let mut received = rig.station().received.iter().rev();
    let seen = received.find_map(|(_, _, message)| match message {
        Message::EoIrLaserOperatingState(state) => Some(state.clone()),
        _ => None,
    });
    let seen = seen.expect("21101");
    // Where the true line of sight meets the ground of the file, in steps of 0.1 m.
    let frame = px4_sim::LocalFrame::new(Config::default().home);
    let sight = rig.vehicles[0].vehicle().payloads()[0].sight;
    let from = rig.truth().position;
    let along = |range_m: f64| {
        let [n, e, d] = sight.map(|part| part * range_m);
        let at = px4_sim::Ned {
            n: from.n + n,
            e: from.e + e,
            d: from.d + d,
        };
        (at, frame.to_global(at))
    };
    let ranges = (0..6_000).map(|tenth| f64::from(tenth) / 10.0);
    let range_m = ranges
        .map(|range_m| (range_m, along(range_m).1))
        .find(|(_, at)| {
            let ground = ridge.ground.height_m(at.latitude_deg, at.longitude_deg);
            at.altitude_m < ground.expect("the file covers what it looks at")
        });
    let (range_m, _) = range_m.expect("it meets the ground");
    assert!(
        (110.0..170.0).contains(&range_m),
        "on the near slope: {range_m}"
    );
    let reported_m = f64::from(seen.reported_range.expect("a range"));
    // A degree of the line of sight, at this grazing angle to a slope of 22 degrees, is some metres.
    assert!(
        (reported_m - range_m).abs() < 8.0,
        "{reported_m}, {range_m}"
    );
    let centre = frame.to_local(px4_sim::Geodetic {
        latitude_deg: seen.latitude_of_image_centre.expect("a place").degrees(),
        longitude_deg: seen.longitude_of_image_centre.expect("a place").degrees(),
        altitude_m: Config::default().home.altitude_m,
    });
    let (truly, _) = along(range_m);
    let off_m = (centre.n - truly.n).hypot(centre.e - truly.e);
    assert!(off_m < 9.0, "{off_m} m");
}

#[test]
fn a_vehicle_that_asks_for_the_ground_is_sent_what_is_known_of_it() {
    let ridge = Ridge::new();
    let mut rig = ridge.rig();
    let vehicle = |rig: &Rig| {
        rig.vehicles[0]
            .vehicle()
            .ground()
            .cloned()
            .expect("it asks")
    };
    rig.vehicles[0].vehicle_mut().ask_for_ground(9);
    assert!(rig.until(15.0, |rig| vehicle(rig).missing() == 0));
    let grid = vehicle(&rig);
    let home_m = Config::default().home.altitude_m;
    // 150 m north of home is the crest, and 50 m is its foot.
    for (north, east, height_m) in [(17, 0, 39.0), (17, 31, 39.0), (7, 3, 5.0), (0, 0, 0.0)] {
        let found = grid.height_m(north, east).expect("it came");
        assert!(
            (f64::from(found) - home_m - height_m).abs() < 4.0,
            "{north} {east}: {found}"
        );
    }
    // Over 40 m apart the grid reaches beyond the file: what is not known is not answered, and what is known is.
    rig.vehicles[0].vehicle_mut().ask_for_ground(40);
    rig.run(8.0);
    let missing = vehicle(&rig).missing();
    assert!((1..56).contains(&missing), "{missing} are missing");
}
