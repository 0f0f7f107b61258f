//! The stamps of Edition 4 roll over on 2034-11-03; those of Edition 2.5 are seconds since 1970, and do not. A station flies
//! through that moment, and one begins after it.

use kit::clock::START;
use stanag_msgs::enums::FlightPathControlMode as Mode;
use stanag_msgs::{Message, TimeStamp};

use super::*;

/// The first moment of the second period, s since 1970.
const ROLL_OVER_S: f64 = (TimeStamp::EPOCH_UNIX_MS + TimeStamp::PERIOD_MS) as f64 / 1e3;

/// The wall clocks of both sides show this from now on.
pub(super) fn set_clock(rig: &mut Rig, wall_s: f64) {
    let shown_s = START.as_secs_f64() + rig.clock.elapsed().as_secs_f64();
    rig.clock.set_wall_step(wall_s - shown_s);
    // A step forward is followed once it has lasted.
    rig.run(12.0);
}

fn wall_s(rig: &Rig) -> f64 {
    rig.station_now().wall.as_secs_f64()
}

#[test]
fn a_station_flies_through_the_roll_over_and_its_stamps_continue() {
    let (mut rig, mut station) = rig();
    set_clock(&mut rig, ROLL_OVER_S - 50.0);
    let granted = request(&mut rig, &mut station, 0x0f, 1);
    assert_eq!(granted[0]["LOI Granted"], 0x0f, "{granted:?}");
    take_off(&mut rig, &mut station, 20.0);
    let acknowledge = json!({ "Message Type": 42 });
    station.send(&mut rig, vehicle_id(0), 1401, &acknowledge);
    assert!(wall_s(&rig) < ROLL_OVER_S - 5.0, "{}", wall_s(&rig));
    rig.run(ROLL_OVER_S - wall_s(&rig) + 0.5);
    // A position before and after; each as it would be read without knowing of any roll-over.
    let stamps: Vec<f64> = station
        .take(&rig, 101)
        .iter()
        .filter_map(|one| one["Time Stamp"].as_f64())
        .collect();
    assert!(stamps.is_sorted_by(|one, next| one < next), "{stamps:?}");
    let (first, last) = (stamps[0], stamps[stamps.len() - 1]);
    assert!(first < ROLL_OVER_S && last >= ROLL_OVER_S, "{first} {last}");
    // A command after it is carried out, and its acknowledgement returns the stamp as it was sent.
    station.take(&rig, 1400);
    station.send(
        &mut rig,
        vehicle_id(0),
        42,
        &json!({ "Select Flight Path Control Mode": 19 }),
    );
    let sent_s = wall_s(&rig);
    rig.run(0.5);
    let answers = station.take(&rig, 1400);
    let original = answers[0]["Original Message Time Stamp"].as_f64().unwrap();
    assert!((original - sent_s).abs() < 1.0, "{original} {sent_s}");
    assert!(rig.until(60.0, |rig| rig.truth().landed));
    let alerts = station.alerts(&rig).join("|");
    assert!(!alerts.contains("refused"), "{alerts}");
}

#[test]
fn a_recording_from_before_the_roll_over_moves_nothing_after_it() {
    let (mut rig, mut station) = rig();
    set_clock(&mut rig, ROLL_OVER_S - 90.0);
    request(&mut rig, &mut station, 0x0f, 1);
    take_off(&mut rig, &mut station, 20.0);
    let land = json!({ "Select Flight Path Control Mode": 19 });
    let recorded = station.datagram(&rig, vehicle_id(0), 42, &land);
    while wall_s(&rig) < ROLL_OVER_S + 5.0 {
        rig.run(1.0);
        let report = json!({ "Message Type": 106 });
        station.send(&mut rig, vehicle_id(0), 1403, &report);
    }
    rig.deliver_from(station.address, &recorded);
    rig.run(15.0);
    assert!(!rig.truth().landed && -rig.truth().position.d > 18.0);
}

#[test]
fn a_bridge_that_starts_after_it_serves_a_station_as_before() {
    let (mut rig, mut station) = rig();
    // 2041: the count has begun again.
    set_clock(&mut rig, 2_240_000_000.0);
    rig.restart_bridge();
    rig.run(9.0);
    let granted = request(&mut rig, &mut station, 0x0f, 1);
    assert_eq!(granted[0]["LOI Granted"], 0x0f, "{granted:?}");
    let away_s = granted[0]["Time Stamp"].as_f64().unwrap() - wall_s(&rig);
    assert!(away_s.abs() < 2.0, "{away_s}");
    take_off(&mut rig, &mut station, 20.0);
}

#[test]
fn a_station_of_edition_4_flies_through_it_though_its_count_begins_again() {
    let mut rig = Rig::new(Setup::default());
    rig.run(9.0);
    set_clock(&mut rig, ROLL_OVER_S - 60.0);
    rig.done(orders::request_control());
    rig.take_off(20.0);
    let left_s = ROLL_OVER_S - wall_s(&rig);
    assert!(left_s > 2.0, "{left_s}");
    rig.run(left_s + 2.0);
    let stamps = rig.station().received.iter();
    let stamps: Vec<TimeStamp> = stamps
        .filter_map(|(_, _, message)| match message {
            Message::InertialStates(states) => states.time_stamp,
            _ => None,
        })
        .collect();
    let (first, last) = (stamps[0], stamps[stamps.len() - 1]);
    let begun_ms = TimeStamp::PERIOD_MS - 60_000;
    assert!(
        first.0 > begun_ms && last.0 < 2_500,
        "{first:?} {last:?} {begun_ms}"
    );
    let near_ms = (ROLL_OVER_S * 1e3) as u64;
    let times = stamps.iter().map(|stamp| stamp.unix_ms_near(near_ms));
    assert!(times.is_sorted_by(|one, next| one < next), "{stamps:?}");
    // Its commands are newer than those of before.
    rig.done(orders::mode(Mode::Loiter));
}
