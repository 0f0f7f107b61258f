//! A station of Edition 2.5 as payload operator (#200, #201, #300 to #302), while one of Edition 4 flies.

use super::*;
use stanag_msgs::enums::{LoiBitmap, RequestedAccess};
use stanag_msgs::messages::CucsAuthorisationRequest;

/// A vehicle with a payload, flown by the station of Edition 4; that of Edition 2.5 holds payload station 1.
pub(super) fn operating() -> (Rig, StationEd25) {
    let mut rig = Rig::new(Setup {
        tables: TABLES,
        vehicles: vec![px4_sim::Config {
            payloads: 1,
            ..px4_sim::Config::default()
        }],
        ..Setup::default()
    });
    rig.run(12.0);
    let control = CucsAuthorisationRequest {
        requested_handover_loi: Some(LoiBitmap::from_raw(LOI_4_AND_5)),
        requested_handover_access: Some(RequestedAccess::Request),
        ..CucsAuthorisationRequest::default()
    };
    rig.done(control);
    rig.take_off(30.0);
    let mut station = StationEd25::new(CUCS, ([127, 0, 0, 2], 41_000).into());
    let fields = json!({
        "VSM ID": -1, "Requested/Handover LOI": 2, "Controlled Station": 1, "Controlled Station Mode": 1,
    });
    station.send(&mut rig, vehicle_id(0), 1, &fields);
    rig.run(4.0);
    let granted = station.take(&rig, 21);
    assert!(
        granted
            .iter()
            .any(|one| one["LOI Granted"] == 3 && one["Controlled Station"] == 1),
        "{granted:?}"
    );
    (rig, station)
}

/// #201: a station of this edition always sends all fields; these are what it shows its operator.
pub(super) fn sensor(rig: &mut Rig, station: &mut StationEd25, system: u8, pointing: u8) {
    let fields = json!({
        "Station Number": 1, "Addressed Sensor": 1, "System Operating Mode": system,
        "Set EO Sensor Mode": 1, "Image Output": 1, "Set EO/IR Pointing Mode": pointing,
        "Select Laser Rangefinder First/Last Pulse": 1,
    });
    station.send(rig, vehicle_id(0), 201, &fields);
}

/// #200 with all fields.
fn steer(rig: &mut Rig, station: &mut StationEd25, fields: &Value) {
    let mut all = json!({ "Station Number": 1, "Set Zoom": 1 });
    if let (Some(all), Some(fields)) = (all.as_object_mut(), fields.as_object()) {
        all.extend(fields.clone());
    }
    station.send(rig, vehicle_id(0), 200, &all);
}

#[test]
fn an_operator_of_edition_2_5_points_zooms_and_records() {
    let (mut rig, mut station) = operating();
    let configuration = station.take(&rig, 300);
    assert_eq!(
        configuration.last().expect("#300")["Payload Stations Available"],
        1
    );
    sensor(&mut rig, &mut station, 5, 1);
    rig.run(2.0);
    let down = (-30.0_f64).to_radians();
    steer(
        &mut rig,
        &mut station,
        &json!({ "Set Centreline Azimuth Angle": 1.0, "Set Centreline Elevation Angle": down }),
    );
    rig.run(6.0);
    let state = station.take(&rig, 302);
    let state = state.last().expect("#302");
    let near = |field: &str, value: f64| (state[field].as_f64().unwrap() - value).abs() < 0.06;
    assert!(near("Actual Centreline Azimuth Angle", 1.0), "{state}");
    assert!(near("Actual Centreline Elevation Angle", down), "{state}");
    assert_eq!(state["Pointing Mode State"], 1);
    assert_eq!(state["Image Position"], 1);
    let range = state["Reported Range"].as_f64().unwrap();
    assert!((range - 60.0).abs() < 6.0, "{state}");

    let wide = rig.vehicles[0].vehicle().payloads()[0].hfov;
    let field = json!({
        "Set Zoom": 0, "Set Horizontal Field Of View": 20.0_f64.to_radians(),
        "Set Centreline Azimuth Angle": 1.0, "Set Centreline Elevation Angle": down,
    });
    steer(&mut rig, &mut station, &field);
    rig.run(6.0);
    let hfov = rig.vehicles[0].vehicle().payloads()[0].hfov;
    assert!(
        hfov < wide && (hfov.to_degrees() - 20.0).abs() < 1.0,
        "{hfov}"
    );
    // Recording and photographs are payload specific modes in both editions.
    sensor(&mut rig, &mut station, 10, 1);
    rig.run(6.0);
    assert!(rig.vehicles[0].vehicle().payloads()[0].recording);
    rig.run(3.0);
    let state = station.take(&rig, 302);
    assert_eq!(
        state.last().expect("#302")["System Operating Mode State"],
        10
    );
    sensor(&mut rig, &mut station, 5, 1);
    rig.run(6.0);
    assert!(!rig.vehicles[0].vehicle().payloads()[0].recording);
    assert!(rig.truth().armed);
    // What is refused is named.
    sensor(&mut rig, &mut station, 6, 1);
    rig.run(1.0);
    let alerts = station.alerts(&rig).join("|");
    assert!(alerts.contains("System Operating Mode 6"), "{alerts}");
}

/// #804 with all fields, as this edition sends it.
fn at_waypoint(number: u16, mode: u8) -> Value {
    json!({
        "Waypoint Number": number, "Station Number": 1, "Set Sensor 1 Mode": 1, "Set Sensor 2 Mode": 1, "Sensor Output": 0,
        "Set Sensor Pointing Mode": mode, "Starepoint Latitude": 0.0, "Starepoint Longitude": 0.0,
        "Starepoint Altitude": 0.0, "Starepoint Altitude Type": 2, "Payload Az (wrt AV)": 0.5, "Payload El (wrt AV)": -0.5,
        "Payload Sensor Rotation Angle": 0.0,
    })
}

#[test]
fn what_a_payload_does_at_a_waypoint_goes_up_and_comes_back() {
    let (mut rig, mut station) = operating();
    // The station of Edition 4 gives up control, and this one takes it beside its payload station.
    let release = CucsAuthorisationRequest {
        requested_handover_loi: Some(LoiBitmap::from_raw(LOI_4_AND_5)),
        requested_handover_access: Some(RequestedAccess::Relinquish),
        ..CucsAuthorisationRequest::default()
    };
    rig.done(release);
    let fields = json!({
        "VSM ID": -1, "Requested/Handover LOI": 0x0e, "Controlled Station": 1, "Controlled Station Mode": 1,
    });
    station.send(&mut rig, vehicle_id(0), 1, &fields);
    rig.run(1.0);
    station.send(&mut rig, vehicle_id(0), 804, &at_waypoint(1, 6));
    rig.run(0.5);
    let alerts = station.alerts(&rig).concat();
    assert!(
        alerts
            .contains("#804 (Payload Action Waypoint) refused: Set Sensor Pointing Mode 6 (stow)"),
        "{alerts}"
    );
    let mut place = at_waypoint(1, 4);
    place["Starepoint Altitude Type"] = json!(9);
    station.send(&mut rig, vehicle_id(0), 804, &place);
    rig.run(0.5);
    let alerts = station.alerts(&rig).concat();
    let why = "#804 (Payload Action Waypoint) refused: Starepoint Altitude Type 9";
    assert!(alerts.contains(why), "{alerts}");
    for (number, fields) in [
        (801, route(1, "R1", 2)),
        (802, waypoint(1, 2, 40.0, 0.0)),
        (804, at_waypoint(1, 1)),
        (802, waypoint(2, 0, 90.0, 0.0)),
    ] {
        station.send(&mut rig, vehicle_id(0), number, &fields);
    }
    rig.run(0.5);
    let loaded = transfer(&mut rig, &mut station, 2);
    assert_eq!(loaded, Some(1), "{:?}", station.alerts(&rig));
    assert_eq!(transfer(&mut rig, &mut station, 3), Some(1));
    let back = station.take(&rig, 804);
    assert_eq!(back.len(), 1, "{back:?}");
    let sent = at_waypoint(1, 1);
    for field in [
        "Waypoint Number",
        "Station Number",
        "Set Sensor Pointing Mode",
        "Set Sensor 2 Mode",
    ] {
        assert_eq!(back[0][field], sent[field], "{field}");
    }
    let azimuth = back[0]["Payload Az (wrt AV)"].as_f64().expect("an angle");
    assert!((azimuth - 0.5).abs() < 2e-4, "{azimuth}");
    mode(&mut rig, &mut station, 11);
    assert!(rig.until(30.0, |rig| {
        let [.., down] = rig.vehicles[0].vehicle().payloads()[0].sight;
        (0.3..0.75).contains(&down)
    }));
}

/// #205.
fn record(rig: &mut Rig, station: &mut StationEd25, mode: u8, device: u8) {
    let fields = json!({
        "Recording Device Number": device, "Set Recording Index Type": 0, "Set Recording Mode": mode,
        "Set Replay Mode": 0,
    });
    station.send(rig, vehicle_id(0), 205, &fields);
    rig.run(5.0);
}

/// The Recording Status of #306 for device 1, on request.
fn recorder(rig: &mut Rig, station: &mut StationEd25) -> Vec<(Value, Value)> {
    station.take(rig, 306);
    let fields =
        json!({ "VSM ID": -1, "Data Link ID": -1, "Station Number": 0, "Message Type": 306 });
    station.send(rig, vehicle_id(0), 1403, &fields);
    rig.run(3.0);
    let all = station.take(rig, 306).into_iter();
    all.map(|one| {
        (
            one["Recording Device Number"].clone(),
            one["Recording Status"].clone(),
        )
    })
    .collect()
}

#[test]
fn a_recorder_is_the_camera_of_its_station_and_reports_once_for_each_request() {
    let (mut rig, mut station) = operating();
    let records = |rig: &Rig| rig.vehicles[0].vehicle().payloads()[0].recording;
    let [recording, ready] = [3, 2].map(|status| vec![(json!(1), json!(status))]);
    rig.run(5.0);
    assert_eq!(recorder(&mut rig, &mut station), ready);
    record(&mut rig, &mut station, 2, 1);
    assert!(records(&rig), "{:?}", station.alerts(&rig));
    assert_eq!(recorder(&mut rig, &mut station), recording);
    // What it cannot do changes nothing.
    record(&mut rig, &mut station, 3, 1);
    record(&mut rig, &mut station, 0, 2);
    let alerts = station.alerts(&rig).concat();
    assert!(
        alerts.contains("Set Recording Mode 3, expected 0"),
        "{alerts}"
    );
    assert!(
        alerts.contains("it needs LOI 3 (payload) of station 2"),
        "{alerts}"
    );
    assert!(records(&rig));
    record(&mut rig, &mut station, 0, 1);
    assert!(!records(&rig));
    assert_eq!(recorder(&mut rig, &mut station), ready);
    // Nothing of it is pushed.
    rig.run(3.0);
    assert!(station.take(&rig, 306).is_empty());
}
