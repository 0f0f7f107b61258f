//! One vehicle between a station of Edition 4 and one of Edition 2.5.

use kit::bridge::{cucs, vehicle_id};
use serde_json::json;
use stanag_msgs::Message;
use stanag_msgs::enums::{AckType, LoiBitmap};
use stanag_msgs::messages::PositiveHandoverAuthorisationRequest;

use super::*;

/// The CUCSs that #21s name as holders of vehicle 0.
fn shown(rig: &Rig, station: &mut StationEd25) -> Vec<(u64, u64)> {
    let lines = station.take(rig, 21);
    let pairs = lines
        .iter()
        .filter_map(|one| Some((one["CUCS ID"].as_u64()?, one["LOI Granted"].as_u64()?)));
    pairs.collect()
}

#[test]
fn each_sees_the_other_hold_the_vehicle_and_hands_it_over() {
    let (mut rig, mut station) = rig();
    assert_eq!(
        rig.carry_out(orders::request_control()),
        Some(AckType::CarriedOut)
    );
    rig.run(1.0);
    // The station of Edition 2.5 finds the holder when it discovers.
    station.send(&mut rig, Id::BROADCAST, 1, &json!({ "VSM ID": -1 }));
    rig.run(0.5);
    let lines = shown(&rig, &mut station);
    assert!(lines.contains(&(cucs(0).0.into(), 0x0f)), "{lines:?}");
    // It is refused what another holds, and asks for a handover: the holder is sent its wish, and consents.
    let refused = request(&mut rig, &mut station, LOI_4_AND_5, 1);
    assert_eq!(refused[0]["LOI Granted"].as_u64().unwrap() & 0x0c, 0);
    station.send(
        &mut rig,
        vehicle_id(0),
        1,
        &json!({
            "VSM ID": -1, "Requested/Handover LOI": LOI_4_AND_5, "Controlled Station Mode": 1,
            "Wait for Vehicle Data Link Transition Coordination Message": 1,
        }),
    );
    rig.run(1.0);
    let consent = PositiveHandoverAuthorisationRequest {
        requested_handover_loi: Some(LoiBitmap::from_raw(LOI_4_AND_5)),
        requesting_cucs_id: Some(CUCS),
        ..PositiveHandoverAuthorisationRequest::default()
    };
    assert_eq!(
        rig.carry_out(Message::from(consent)),
        Some(AckType::CarriedOut)
    );
    rig.run(1.0);
    let lines = shown(&rig, &mut station);
    assert!(
        lines
            .iter()
            .any(|(id, levels)| *id == u64::from(CUCS.0) && levels & 0x0c == 0x0c),
        "{lines:?}"
    );
    let statuses = station.take(&rig, 700);
    assert_eq!(statuses.last().unwrap()["Status"], 2, "successful");
    // And back: #600 names the acquiring station, which accepts by its request.
    station.send(
        &mut rig,
        vehicle_id(0),
        600,
        &json!({ "Acquiring CUCS ID": cucs(0).0 as i32 }),
    );
    rig.run(0.5);
    assert_eq!(
        rig.carry_out(orders::request_control()),
        Some(AckType::CarriedOut),
        "{:?}",
        station.alerts(&rig)
    );
    rig.run(1.0);
    let lines = shown(&rig, &mut station);
    assert!(
        lines
            .iter()
            .any(|(id, levels)| *id == u64::from(cucs(0).0) && levels & 0x0c == 0x0c),
        "{lines:?}"
    );
}

/// The waypoints that station 0 was sent by a download.
fn downloaded(rig: &Rig) -> Vec<stanag_msgs::messages::UaPositionWaypoint> {
    let received = rig.station().received.iter();
    let mut all: Vec<_> = received
        .filter_map(|(_, _, message)| match message {
            Message::UaPositionWaypoint(one) => Some(one.clone()),
            _ => None,
        })
        .collect();
    all.sort_by_key(|one| one.waypoint_number);
    all
}

#[test]
fn a_route_of_edition_2_5_reaches_a_station_of_edition_4_and_comes_back() {
    let (mut rig, mut station) = rig();
    request(&mut rig, &mut station, LOI_4_AND_5, 1);
    let speed = json!(6.5);
    for (number, mut fields) in [
        (801, route(101, "R1", 2)),
        (802, waypoint(101, 102, 40.0, 0.0)),
        (802, waypoint(102, 0, 40.0, 40.0)),
        (
            803,
            json!({ "Waypoint Number": 102, "Waypoint Loiter Time": 4, "Waypoint Loiter Type": 4 }),
        ),
    ] {
        if number == 802 {
            fields["Waypoint to Speed"] = speed.clone();
        }
        station.send(&mut rig, vehicle_id(0), number, &fields);
    }
    rig.run(0.5);
    assert_eq!(
        transfer(&mut rig, &mut station, 2),
        Some(1),
        "{:?}",
        station.alerts(&rig)
    );
    // To the station of Edition 4: field by field what was sent.
    request(&mut rig, &mut station, 0, 0);
    assert_eq!(
        rig.carry_out(orders::request_control()),
        Some(AckType::CarriedOut)
    );
    let download = orders::transfer(stanag_msgs::enums::MissionPlanMode::Download);
    assert_eq!(rig.carry_out(download), Some(AckType::CarriedOut));
    rig.run(0.5);
    let there = downloaded(&rig);
    let numbers: Vec<_> = there
        .iter()
        .map(|one| (one.waypoint_number, one.next_waypoint))
        .collect();
    assert_eq!(numbers, [(Some(101), Some(102)), (Some(102), Some(0))]);
    let (latitude, longitude) = orders::place(40.0, 40.0);
    assert!(
        (there[1]
            .waypoint_to_latitude_or_relative_y
            .unwrap()
            .degrees()
            - latitude)
            .abs()
            < 1e-7
    );
    assert!(
        (there[1]
            .waypoint_to_longitude_or_relative_x
            .unwrap()
            .degrees()
            - longitude)
            .abs()
            < 1e-7
    );
    assert!((there[1].waypoint_to_speed.unwrap().si() - 6.5).abs() < 0.26);
    let loiters = rig.station().received.iter().filter(|(_, _, message)| {
        matches!(message, Message::UaLoiterWaypoint(one) if one.loiter_duration == Some(4))
    });
    assert_eq!(loiters.count(), 1);
    // It sends what it was sent, and the station of Edition 2.5 finds its own route again.
    let mut plan = vec![orders::route(101).into()];
    plan.extend(there.into_iter().map(Message::from));
    rig.send_plan(plan);
    assert_eq!(rig.carry_out(orders::load()), Some(AckType::CarriedOut));
    let release = stanag_msgs::messages::CucsAuthorisationRequest {
        requested_handover_access: Some(stanag_msgs::enums::RequestedAccess::Relinquish),
        ..Default::default()
    };
    assert!(rig.carry_out(release).is_some());
    request(&mut rig, &mut station, LOI_4_AND_5, 1);
    station.take(&rig, 802);
    assert_eq!(transfer(&mut rig, &mut station, 3), Some(1));
    let back = station.take(&rig, 802);
    for (number, next, north, east) in [(101, 102, 40.0, 0.0), (102, 0, 40.0, 40.0)] {
        let sent = waypoint(number, next, north, east);
        let one = back.iter().find(|one| one["Waypoint Number"] == number);
        let one = one.unwrap_or_else(|| panic!("{number} of {back:?}"));
        for field in [
            "Waypoint to Latitude or Relative Y",
            "Waypoint to Longitude or Relative X",
        ] {
            let apart = sent[field].as_f64().unwrap() - one[field].as_f64().unwrap();
            assert!(apart.abs() < 3e-9, "{number} {field}");
        }
        assert_eq!(one["Next Waypoint"], next);
        assert_eq!(one["Waypoint to Altitude"], json!(20.0));
    }
}
