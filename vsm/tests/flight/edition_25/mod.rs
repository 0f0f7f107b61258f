//! Stations of Edition 2.5: whole flights, which fields of a command count, what is refused by name, and one vehicle
//! between a station of Edition 2.5 and one of Edition 4.

mod after_2034;
mod border;
mod cases;
mod commands;
mod controls;
mod effects;
mod mixed;
mod operator;
mod payload;
mod plans;
mod restarts;
mod station;
mod table;

use kit::bridge::{Rig, Setup, orders, vehicle_id};
use serde_json::{Value, json};
use stanag_msgs::Id;

use self::station::StationEd25;

const CUCS: Id = Id(0x1b00_00b0);
const TABLES: &str =
    "[[cucs]]\nid = \"1b:00:00:b0\"\nloi = [2, 3, 4, 5]\naddress = \"127.0.0.2\"\n";
const LOI_4_AND_5: u8 = 0x0c;

fn rig() -> (Rig, StationEd25) {
    let mut rig = Rig::new(Setup {
        tables: TABLES,
        ..Setup::default()
    });
    rig.run(9.0);
    let station = StationEd25::new(CUCS, ([127, 0, 0, 2], 41_000).into());
    (rig, station)
}

/// A station that has all rights.
fn ready() -> (Rig, StationEd25) {
    let (mut rig, mut station) = rig();
    let granted = request(&mut rig, &mut station, 0x0f, 1);
    assert_eq!(granted[0]["LOI Granted"], 0x0f, "{granted:?}");
    rig.run(1.0);
    (rig, station)
}

/// #1 to vehicle 0: the #21s that follow, but for lines about others.
fn request(rig: &mut Rig, station: &mut StationEd25, levels: u8, mode: u8) -> Vec<Value> {
    let fields =
        json!({ "VSM ID": -1, "Requested/Handover LOI": levels, "Controlled Station Mode": mode });
    station.take(rig, 21);
    station.send(rig, vehicle_id(0), 1, &fields);
    rig.run(0.5);
    let all = station.take(rig, 21);
    let own = json!(station.id.0 as i32);
    all.into_iter()
        .filter(|one| one["CUCS ID"] == own)
        .collect()
}

/// #42.
fn mode(rig: &mut Rig, station: &mut StationEd25, mode: u8) {
    let fields = json!({ "Select Flight Path Control Mode": mode });
    station.send(rig, vehicle_id(0), 42, &fields);
}

/// #43 that commands nothing but what is given.
fn steer(rig: &mut Rig, station: &mut StationEd25, fields: &Value) {
    station.send(rig, vehicle_id(0), 43, fields);
}

fn take_off(rig: &mut Rig, station: &mut StationEd25, height_m: f64) {
    let fields =
        json!({ "Altitude Command Type": 1, "Commanded Altitude": height_m, "Altitude Type": 2 });
    steer(rig, station, &fields);
    rig.run(0.1);
    mode(rig, station, 21);
    let up = rig.until(60.0, |rig| -rig.truth().position.d > height_m - 1.0);
    assert!(up, "{:?}", station.alerts(rig));
}

/// #802, metres north and east of home and above it.
fn waypoint(number: u16, next: u16, north: f64, east: f64) -> Value {
    let (latitude, longitude) = orders::place(north, east);
    json!({
        "Waypoint Number": number,
        "Waypoint to Latitude or Relative Y": latitude.to_radians(),
        "Waypoint to Longitude or Relative X": longitude.to_radians(),
        "Waypoint to Altitude": 20.0,
        "Waypoint Altitude Type": 2,
        "Next Waypoint": next,
    })
}

/// #801.
fn route(first: u16, name: &str, kind: u8) -> Value {
    json!({ "Initial Waypoint Number": first, "Route ID": name, "Route Type": kind })
}

/// #800, and the status that follows it.
fn transfer(rig: &mut Rig, station: &mut StationEd25, mode: u8) -> Option<u64> {
    station.take(rig, 900);
    let fields = json!({ "Mission ID": "M1", "Mission Plan Mode": mode });
    station.send(rig, vehicle_id(0), 800, &fields);
    for _ in 0..100 {
        rig.run(0.2);
        let end = station
            .take(rig, 900)
            .into_iter()
            .find(|one| one["Status"] != 0);
        if let Some(end) = end {
            return end["Status"].as_u64();
        }
    }
    None
}
