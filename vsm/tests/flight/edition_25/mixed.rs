//! One vehicle between a station of Edition 4 and one of Edition 2.5.

use std::net::SocketAddr;

use kit::bridge::{cucs, vehicle_id};
use serde_json::json;
use stanag_msgs::Message;
use stanag_msgs::enums::{AckType, ConfigRequestType, LoiBitmap, RequestedAccess};
use stanag_msgs::messages::{
    CucsAuthorisationRequest, FieldConfigurationRequest, Heartbeat,
    PositiveHandoverAuthorisationRequest,
};
use vsm::session::Destination;

use super::*;

/// The CUCSs that #21s name as holders of vehicle 0.
fn shown(rig: &Rig, station: &mut StationEd25) -> Vec<(u64, u64)> {
    let lines = station.take(rig, 21);
    let pairs = lines
        .iter()
        .filter_map(|one| Some((one["CUCS ID"].as_u64()?, one["LOI Granted"].as_u64()?)));
    pairs.collect()
}

/// The holder of Edition 4 lets the station of Edition 2.5 have it.
fn consent() -> PositiveHandoverAuthorisationRequest {
    PositiveHandoverAuthorisationRequest {
        requested_handover_loi: Some(LoiBitmap::from_raw(LOI_4_AND_5)),
        requesting_cucs_id: Some(CUCS),
        ..PositiveHandoverAuthorisationRequest::default()
    }
}

#[test]
fn each_sees_the_other_hold_the_vehicle_and_hands_it_over() {
    let (mut rig, mut station) = rig();
    rig.done(orders::request_control());
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
    rig.done(Message::from(consent()));
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
    // Handed over to the station of Edition 4 (#600), which downloads field by field what was sent.
    let acquires = json!({ "Acquiring CUCS ID": cucs(0).0 as i32 });
    station.send(&mut rig, vehicle_id(0), 600, &acquires);
    rig.run(0.5);
    rig.done(orders::request_control());
    rig.run(1.0);
    assert!(
        shown(&rig, &mut station)
            .iter()
            .any(|(id, levels)| *id == u64::from(cucs(0).0) && levels & 0x0c == 0x0c),
        "the station of Edition 2.5 sees who holds it now"
    );
    let download = orders::transfer(stanag_msgs::enums::MissionPlanMode::Download);
    rig.done(download);
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
    rig.done(orders::load());
    // And handed back, by the wish of one and the consent of the other.
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
    rig.done(Message::from(consent()));
    rig.run(1.0);
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

/// Edition 2.5 has no heartbeat, and its text no rule for the loss of a connection: silence is no release (4.1.1.3).
#[test]
fn a_station_whose_program_crashed_keeps_control_until_another_overrides_it() {
    const WITH_A_CHIEF: &str = "[[cucs]]\nid = \"1b:00:00:b0\"\nloi = [2, 3, 4, 5]\naddress = \"127.0.0.2\"\n\
        [[cucs]]\nid = \"1b:00:00:b1\"\nloi = [2, 3, 4, 5]\naddress = \"127.0.0.3\"\noverride = true\n";
    let mut rig = Rig::new(Setup {
        tables: WITH_A_CHIEF,
        ..Setup::default()
    });
    rig.run(9.0);
    let mut station = StationEd25::new(CUCS, ([127, 0, 0, 2], 41_000).into());
    request(&mut rig, &mut station, 0x0f, 1);
    take_off(&mut rig, &mut station, 20.0);
    mode(&mut rig, &mut station, 12);
    rig.run(5.0);
    // It crashes; for ten minutes nothing of it arrives, far beyond every limit of a station with heartbeats.
    rig.run(600.0);
    let still = rig.truth().mode;
    assert_eq!(still, px4_sim::Mode::Loiter, "on_loss is not flown");
    // Who only requests it is refused: it is held. Who may override it gets it, and lands.
    let refused = rig.carry_out(orders::request_control());
    assert_eq!(refused, Some(AckType::Refused));
    let mut chief = StationEd25::new(Id(0x1b00_00b1), ([127, 0, 0, 3], 41_000).into());
    let granted = request(&mut rig, &mut chief, LOI_4_AND_5, 2);
    let levels = granted[0]["LOI Granted"].as_u64();
    assert_eq!(
        levels.map(|levels| levels & 0x0c),
        Some(0x0c),
        "{granted:?}"
    );
    mode(&mut rig, &mut chief, 19);
    assert!(rig.until(60.0, |rig| rig.truth().landed));
}

#[test]
fn a_station_that_comes_back_in_edition_4_from_elsewhere_is_asked_in_it() {
    for trusted in [true, false] {
        let (mut rig, mut station) = if trusted { ready() } else { unproven() };
        // Longer than it must be quiet, and shorter than its lease.
        rig.run(12.0);
        let before = rig.others.len();
        let elsewhere = ([127, 0, 0, 2], 41_777).into();
        let request = Message::from(CucsAuthorisationRequest {
            time_stamp: Some(stanag_msgs::TimeStamp::from_unix_ms(
                rig.station_now().wall.as_millis() as u64,
            )),
            requested_handover_loi: Some(LoiBitmap::LOI2),
            requested_handover_access: Some(RequestedAccess::Request),
            ..CucsAuthorisationRequest::default()
        });
        let mut bytes = [0; stanag_msgs::MAX_DATAGRAM];
        let envelope = stanag_msgs::Envelope::new(CUCS, vehicle_id(0));
        let length = request.encode(&envelope, &mut bytes).expect("it fits");
        rig.deliver_from(elsewhere, &bytes[..length]);
        rig.run(2.0);
        let sent = rig.others[before..]
            .iter()
            .filter(|(to, _)| *to == elsewhere);
        let sent: Vec<_> = sent.map(|(_, bytes)| bytes.clone()).collect();
        assert!(!sent.is_empty(), "trusted: {trusted}");
        for bytes in sent {
            assert!(!stanag_msgs::ed25::is_ed25(&bytes), "{bytes:02x?}");
        }
        station.take(&rig, 21);
    }
}

/// Somebody elsewhere sends in Edition 2.5 in the name of a station of Edition 4 that only listens and acknowledges: nothing that it is
/// sent is in that edition, and it keeps its status.
#[test]
fn forged_datagrams_of_edition_2_5_cost_a_station_of_edition_4_that_listens_nothing() {
    let mut rig = Rig::ready();
    let mut forger = StationEd25::new(cucs(0), ([127, 0, 0, 9], 41_000).into());
    for _ in 0..150 {
        forger.send(&mut rig, Id::BROADCAST, 1, &json!({ "VSM ID": -1 }));
        rig.run(2.0);
    }
    let last = rig.station().received.last().expect("status").0;
    let silent = rig.clock.elapsed() - last;
    assert!(silent.as_secs_f64() < 1.0, "no status for {silent:?}");
    rig.done(orders::launch(20.0));
}

/// A station that comes back at another port, and a forger behind it, before the VSM sends: each is asked in its own edition.
#[test]
fn of_two_that_claim_a_station_each_is_asked_in_its_own_edition() {
    let mut rig = Rig::ready();
    // Longer than it must be quiet.
    rig.run(12.0);
    let elsewhere: SocketAddr = ([127, 0, 0, 1], 41_777).into();
    let beat = Message::from(Heartbeat::default());
    let mut bytes = [0; stanag_msgs::MAX_DATAGRAM];
    let envelope = stanag_msgs::Envelope::new(cucs(0), vehicle_id(0));
    let length = beat.encode(&envelope, &mut bytes).expect("it fits");
    let mut forger = StationEd25::new(cucs(0), ([127, 0, 0, 9], 41_000).into());
    let forged = forger.datagram(&rig, Id::BROADCAST, 1, &json!({ "VSM ID": -1 }));
    let now = rig.now();
    let bridge = rig.bridge.as_mut().expect("it runs");
    bridge.handle_dli(now, elsewhere, &bytes[..length], &mut rig.store);
    bridge.handle_dli(now, forger.address, &forged, &mut rig.store);
    let asked: Vec<_> = std::iter::from_fn(|| bridge.poll_dli())
        .map(|one| (one.to, stanag_msgs::ed25::is_ed25(one.bytes())))
        .collect();
    for (address, ed25) in [(elsewhere, false), (forger.address, true)] {
        let there = Destination::Unicast(address);
        assert!(asked.contains(&(there, ed25)), "{address}: {asked:?}");
        assert!(!asked.contains(&(there, !ed25)), "{address}: {asked:?}");
    }
}

/// Somebody changes his edition before the VSM has sent what it answers in the other, and back. What each answer was charged is settled
/// then, not what it would be charged now.
#[test]
fn who_changes_his_edition_before_he_is_answered_is_sent_three_times_what_came_from_him_at_most() {
    let mut rig = Rig::new(Setup::default());
    rig.run(9.0);
    let mut forger = StationEd25::new(cucs(0), ([127, 0, 0, 9], 41_000).into());
    let there = forger.address;
    let configure = Message::from(FieldConfigurationRequest {
        request_type: Some(ConfigRequestType::Loi4),
        ..FieldConfigurationRequest::default()
    });
    let mut bytes = [0; stanag_msgs::MAX_DATAGRAM];
    let envelope = stanag_msgs::Envelope::new(cucs(0), vehicle_id(0));
    let length = configure.encode(&envelope, &mut bytes).expect("it fits");
    let one = &bytes[..length];
    let many = one.repeat(20);
    let (mut came, mut sent) = (0, 0);
    for _ in 0..20 {
        let other = forger.datagram(&rig, Id::BROADCAST, 1, &json!({ "VSM ID": -1 }));
        let now = rig.now();
        let bridge = rig.bridge.as_mut().expect("it runs");
        bridge.handle_dli(now, there, &many, &mut rig.store);
        bridge.handle_dli(now, there, &other, &mut rig.store);
        while let Some(answer) = bridge.poll_dli() {
            sent += answer.bytes().len() as u64;
        }
        bridge.handle_dli(now, there, one, &mut rig.store);
        came += (many.len() + other.len() + one.len()) as u64;
        rig.run(0.3);
    }
    sent += rig.sent_to[&there].1;
    assert!(sent <= 3 * came, "{sent} bytes for {came}");
    assert!(sent > came, "{sent} bytes for {came}");
}

/// A station whose address nobody vouches for: it has asked, and proved nothing.
fn unproven() -> (Rig, StationEd25) {
    let mut rig = Rig::new(Setup {
        tables: "[[cucs]]\nid = \"1b:00:00:b0\"\nloi = [2, 3, 4, 5]\n",
        ..Setup::default()
    });
    rig.run(9.0);
    let mut station = StationEd25::new(CUCS, ([127, 0, 0, 2], 41_000).into());
    request(&mut rig, &mut station, 0x0f, 1);
    (rig, station)
}
