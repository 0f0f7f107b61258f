//! Whatever is refused is refused with a reason, the reason is taken back after a while, and nothing that is not
//! understood is acknowledged as done.

use std::collections::BTreeSet;

use kit::bridge::{Rig, Setup, cucs, orders, vehicle_id};
use stanag_msgs::enums::{
    AckType, AlertPriority, AlertType, AltitudeCommandType, AreaPlanMode, AreaType,
    FlightPathControlMode as Mode, LoiBitmap, LoiterDirection, LoiterType, RequestedAccess,
    SpeedType,
};
use stanag_msgs::messages::{
    AreaTransferCommand, AreaVertex, CucsAuthorisationRequest, CurveSegmentPaper,
    GenericInformationRequestMessage, InertialStates, LoiterConfiguration,
    ScheduleMessageUpdateCommand, SubsystemStatusAlert, UaPositionWaypoint,
    VehicleConfigurationCommand, VehicleOperatingModeCommand,
};
use stanag_msgs::{Bam32, Envelope, Id, Message, Scaled, frames};

fn schedule(message: u16, hertz: u16) -> ScheduleMessageUpdateCommand {
    ScheduleMessageUpdateCommand {
        requested_message_type: Some(message),
        frequency: Some(hertz),
        ..ScheduleMessageUpdateCommand::default()
    }
}

/// The 16000 that a station has received since `mark` messages.
fn reasons(rig: &Rig, station: usize, mark: usize) -> Vec<SubsystemStatusAlert> {
    let received = rig.stations[station].received[mark..].iter();
    received
        .filter_map(|(_, _, message)| match message {
            Message::SubsystemStatusAlert(alert) => Some(alert.clone()),
            _ => None,
        })
        .collect()
}

/// Sends a message that must be refused, with this in the reason.
fn refused(rig: &mut Rig, message: impl Into<Message>, why: &str) {
    let before = rig.station().alerts().len();
    let message = message.into();
    let id = message.id();
    assert_eq!(rig.carry_out(message), Some(AckType::Refused), "{id} {why}");
    rig.run(0.1);
    let alerts = rig.station().alerts().split_off(before);
    assert!(
        alerts.iter().any(|text| text.contains(why)),
        "{id}: {alerts:?}, expected {why}"
    );
}

#[test]
fn a_message_that_is_known_by_its_name_alone_is_refused_with_what_there_is_in_its_place() {
    let mut rig = Rig::ready();
    let mark = rig.station().received.len();
    let envelope = Envelope::new(cucs(0), vehicle_id(0)).requesting_ack();
    let mut bytes = [0; 64];
    let data = |out: &mut [u8]| {
        // A presence vector, and what may be its stamp.
        out[..6].copy_from_slice(&[1, 0, 0, 0, 0, 9]);
        Ok(6)
    };
    let length = stanag_msgs::wrapper::encode(11_000, &envelope, &mut bytes, data).expect("fits");
    rig.deliver_from_station(&bytes[..length]);
    rig.run(0.3);
    let texts: Vec<_> = reasons(&rig, 0, mark)
        .iter()
        .filter_map(|alert| Some(alert.text.as_ref()?.as_str().to_owned()))
        .collect();
    let text = texts.concat();
    for part in ["11000", "refused: ", "has no known layout", "50011"] {
        assert!(text.contains(part), "{part}: {text}");
    }
}

#[test]
fn a_missing_right_is_reported_once_and_cleared_though_the_command_is_repeated() {
    let mut rig = Rig::new(Setup::default());
    rig.run(9.0);
    refused(
        &mut rig,
        orders::mode(Mode::Loiter),
        "it needs LOI 4 (control); this CUCS holds nothing",
    );
    refused(&mut rig, schedule(4000, 1), "it needs LOI 2");
    let mark = rig.station().received.len();
    for _ in 0..100 {
        rig.send_once(orders::mode(Mode::Loiter));
        rig.run(0.01);
    }
    let alerts = reasons(&rig, 0, mark);
    assert!(alerts.len() <= 1, "{} alerts of one second", alerts.len());
    rig.run(20.0);
    // Each was raised with its id below 0, and is cleared by the id above it.
    let alerts = reasons(&rig, 0, 0);
    let raised: BTreeSet<i32> = alerts
        .iter()
        .filter_map(|alert| alert.alert_warning_id.filter(|id| *id < 0))
        .collect();
    let cleared: BTreeSet<i32> = alerts
        .iter()
        .filter(|alert| {
            alert.priority == Some(AlertPriority::Cleared)
                && alert.alert_type == Some(AlertType::Clear)
        })
        .filter_map(|alert| alert.alert_warning_id.map(|id| -id))
        .collect();
    assert!(!raised.is_empty());
    assert_eq!(raised, cleared);
}

#[test]
fn what_is_no_report_or_too_often_is_refused_with_the_reason() {
    let mut rig = Rig::ready();
    refused(&mut rig, schedule(4000, 101), "Frequency 101 Hz");
    refused(
        &mut rig,
        schedule(2016, 1),
        "(Vehicle Operating Mode Command) is not a report",
    );
    let request = |message| GenericInformationRequestMessage {
        message_type: message,
        ..GenericInformationRequestMessage::default()
    };
    refused(
        &mut rig,
        request(Some(6000)),
        "(IFF/SSR Status Report) is not a report",
    );
    refused(
        &mut rig,
        request(Some(3011)),
        "no data received yet for message 3011",
    );
    refused(&mut rig, request(None), "Message Type is missing");
    refused(
        &mut rig,
        VehicleConfigurationCommand::default(),
        "2000 (Vehicle Configuration Command) is not supported",
    );
    for hertz in [51, 100] {
        rig.done(schedule(4000, hertz));
        rig.run(1.0);
        let (from, to) = (rig.station().received.len(), 5.0);
        rig.run(to);
        let count = rig.station().received[from..]
            .iter()
            .filter(|(_, _, message)| message.id() == 4000)
            .count();
        // The virtual clock goes in steps of 10 ms.
        let min = usize::from(hertz) * 9 / 2;
        assert!(count >= min, "{count} in 5 s at {hertz} Hz");
    }
}

#[test]
fn a_new_grant_begins_with_the_default_reports_whatever_was_cancelled_before() {
    let mut rig = Rig::ready();
    for message in [3001, 3002, 4000, 4001, 16002] {
        rig.done(schedule(message, 0));
    }
    let count = |rig: &mut Rig| {
        let mark = rig.station().received.len();
        rig.run(3.0);
        let received = rig.station().received[mark..].iter();
        received
            .filter(|(_, _, message)| [3001, 3002, 4000, 4001].contains(&message.id()))
            .count()
    };
    rig.run(0.5);
    assert_eq!(count(&mut rig), 0);
    let release = CucsAuthorisationRequest {
        requested_handover_access: Some(RequestedAccess::Relinquish),
        ..orders::request_control()
    };
    rig.done(release);
    assert_eq!(count(&mut rig), 0);
    rig.done(orders::request_control());
    assert!(count(&mut rig) >= 4 * 6);
}

#[test]
fn a_request_for_control_that_is_not_understood_grants_nothing() {
    let mut rig = Rig::new(Setup::default());
    rig.run(9.0);
    let levels = |raw| Some(LoiBitmap::from_raw(raw));
    let cases = [
        (
            CucsAuthorisationRequest {
                requested_handover_access: Some(RequestedAccess::from_raw(7)),
                ..orders::request_control()
            },
            "Access 7, expected 0 to 2",
        ),
        (
            CucsAuthorisationRequest {
                requested_handover_loi: levels(0x10),
                ..orders::request_control()
            },
            "bits 0x10",
        ),
        (
            CucsAuthorisationRequest {
                requested_handover_loi: levels(0x1d),
                ..orders::request_control()
            },
            "bits 0x10",
        ),
        (
            CucsAuthorisationRequest {
                vsm_id: Some(Id(0x1b00_0002)),
                ..orders::request_control()
            },
            "another VSM's",
        ),
    ];
    for (request, why) in cases {
        refused(&mut rig, request, why);
        let granted = rig
            .station()
            .last(vehicle_id(0), 2, |message| match message {
                Message::VsmAuthorisationResponse(answer) => answer.loi_granted,
                _ => None,
            });
        assert_eq!(granted, Some(LoiBitmap::NONE), "{why}");
    }
    rig.done(orders::request_control());
    // A release is always granted.
    let release = CucsAuthorisationRequest {
        vsm_id: Some(Id(0x1b00_0002)),
        requested_handover_loi: levels(0x10),
        requested_handover_access: Some(RequestedAccess::Relinquish),
        ..CucsAuthorisationRequest::default()
    };
    rig.done(release);
    let end = rig.carry_out(orders::mode(Mode::Loiter));
    assert_eq!(end, Some(AckType::Refused));
}

#[test]
fn a_discovery_of_another_vsm_is_not_answered() {
    let mut rig = Rig::new(Setup::default());
    rig.run(9.0);
    let answers = |rig: &mut Rig, vsm: Id| {
        let mark = rig.station().received.len();
        let now = rig.station_now();
        let request = CucsAuthorisationRequest {
            vsm_id: Some(vsm),
            requested_handover_access: Some(RequestedAccess::Relinquish),
            ..CucsAuthorisationRequest::default()
        };
        rig.stations[0].send_once(now, Id::BROADCAST, request.into());
        rig.run(0.5);
        let received = rig.station().received[mark..].iter();
        received.filter(|(_, _, message)| message.id() == 2).count()
    };
    assert_eq!(answers(&mut rig, Id(0x1b00_0002)), 0);
    assert_eq!(answers(&mut rig, Id::BROADCAST), 1);
    assert_eq!(answers(&mut rig, kit::bridge::VSM), 1);
}

#[test]
fn a_loiter_that_cannot_be_flown_is_refused_at_once_and_the_one_before_stays() {
    let mut rig = Rig::ready();
    let circle = LoiterConfiguration {
        loiter_type: Some(LoiterType::Circular),
        loiter_radius: Some(Scaled::saturating_from_si(30.0)),
        ..LoiterConfiguration::default()
    };
    rig.done(circle.clone());
    for (change, why) in [
        (
            LoiterConfiguration {
                loiter_type: Some(LoiterType::from_raw(9)),
                ..LoiterConfiguration::default()
            },
            "Loiter Type 9",
        ),
        (
            LoiterConfiguration {
                loiter_type: Some(LoiterType::Racetrack),
                ..LoiterConfiguration::default()
            },
            "Loiter Type 2",
        ),
        (
            LoiterConfiguration {
                loiter_direction: Some(LoiterDirection::IntoWind),
                ..LoiterConfiguration::default()
            },
            "Loiter Direction 3",
        ),
        (
            LoiterConfiguration {
                loiter_radius: Some(Scaled::saturating_from_si(1_500.0)),
                ..LoiterConfiguration::default()
            },
            "Loiter Radius 1500 m, at most 1000",
        ),
        (
            LoiterConfiguration {
                loiter_radius: Some(Scaled::saturating_from_si(0.0)),
                ..LoiterConfiguration::default()
            },
            "Loiter Radius 0 m, expected more than 0",
        ),
    ] {
        refused(&mut rig, change, why);
    }
    // A hover has none: a full presence vector carries 0 for it, which is no radius for the next circle.
    for kind in [LoiterType::Hover, LoiterType::Circular] {
        let radius = (kind == LoiterType::Hover).then(|| Scaled::saturating_from_si(0.0));
        let change = LoiterConfiguration {
            loiter_type: Some(kind),
            loiter_radius: radius,
            ..LoiterConfiguration::default()
        };
        assert_eq!(rig.carry_out(change), Some(AckType::CarriedOut), "{kind:?}");
    }
    let request = GenericInformationRequestMessage {
        message_type: Some(3004),
        ..GenericInformationRequestMessage::default()
    };
    rig.done(request);
    let kept = rig
        .station()
        .last(vehicle_id(0), 3004, |message| match message {
            Message::LoiterConfigurationReport(report) => {
                Some((report.loiter_type, report.loiter_radius))
            }
            _ => None,
        });
    assert_eq!(kept, Some((circle.loiter_type, circle.loiter_radius)));
}

/// PX4 v1.18 compares the place of a hover with its fence once it has ended what it flew, and no circle of a multicopter.
#[test]
fn a_circle_or_a_hover_that_leaves_the_fence_is_refused_with_the_area() {
    let mut rig = Rig::ready();
    let (home, place) = (orders::place(0.0, 0.0), orders::place);
    rig.done(AreaVertex {
        area_id: Some(1),
        area_type: Some(AreaType::KeepInCircle),
        vertex_count: Some(1),
        vertex_number: Some(1),
        latitude: Some(Bam32::from_degrees(home.0)),
        longitude: Some(Bam32::from_degrees(home.1)),
        radius: Some(200.0),
        ..AreaVertex::default()
    });
    rig.done(AreaTransferCommand {
        area_plan_mode: Some(AreaPlanMode::Load),
        ..AreaTransferCommand::default()
    });
    rig.take_off(20.0);
    rig.done(LoiterConfiguration {
        loiter_type: Some(LoiterType::Circular),
        loiter_radius: Some(Scaled::saturating_from_si(30.0)),
        ..LoiterConfiguration::default()
    });
    let around = |north| {
        let (latitude, longitude) = place(north, 0.0);
        VehicleOperatingModeCommand {
            loiter_position_latitude: Some(Bam32::from_degrees(latitude)),
            loiter_position_longitude: Some(Bam32::from_degrees(longitude)),
            ..orders::mode(Mode::Loiter)
        }
    };
    let why = "mode 12 (loiter): the circle of 30 m leaves area 1, to stay inside";
    // Its centre outside, and its rim alone.
    for north in [400.0, 180.0] {
        refused(&mut rig, around(north), why);
        assert_ne!(rig.truth().mode, px4_sim::Mode::Orbit);
        rig.run(10.0);
    }
    rig.done(around(150.0));
    assert_eq!(rig.truth().mode, px4_sim::Mode::Orbit);
    rig.done(LoiterConfiguration {
        loiter_type: Some(LoiterType::Hover),
        ..LoiterConfiguration::default()
    });
    let why = "mode 12 (loiter): the hover there leaves area 1, to stay inside";
    refused(&mut rig, around(400.0), why);
    assert_eq!(rig.truth().mode, px4_sim::Mode::Orbit, "flown on");
    rig.done(around(180.0));
}

#[test]
fn a_curve_that_is_no_number_is_refused_when_it_comes() {
    let mut rig = Rig::ready();
    let curve = CurveSegmentPaper {
        time_stamp: Some(0.0),
        vehicle_id: Some(vehicle_id(0)),
        cucs_id: Some(cucs(0)),
        p1_waypoint_no: Some(1),
        p4_waypoint_no: Some(2),
        p2_latitude: Some(0.8),
        p2_longitude: Some(0.15),
        p3_latitude: Some(0.8),
        p3_longitude: Some(0.15),
    };
    rig.done(curve.clone());
    for value in [f64::NAN, f64::INFINITY, 1.6, -2.0] {
        let bad = CurveSegmentPaper {
            p3_latitude: Some(value),
            ..curve.clone()
        };
        refused(&mut rig, bad, "50001 P3 Latitude");
    }
}

#[test]
fn what_a_mode_ignores_is_reported_and_what_it_cannot_do_is_refused() {
    let mut rig = Rig::ready();
    rig.take_off(20.0);
    let hold = orders::mode(Mode::Loiter);
    let full = VehicleOperatingModeCommand {
        altitude_command_type: Some(AltitudeCommandType::None),
        commanded_altitude: Some(Scaled::saturating_from_si(40.0)),
        commanded_vertical_speed: Some(Scaled::saturating_from_si(2.0)),
        commanded_waypoint_number: Some(3),
        ..hold.clone()
    };
    rig.done(full);
    rig.run(0.1);
    assert!(rig.station().has_alert(
        "2016: ignored in mode 12 (loiter): Commanded Altitude, Commanded Vertical Speed, Commanded Waypoint Number"
    ));
    let climb = VehicleOperatingModeCommand {
        altitude_command_type: Some(AltitudeCommandType::VerticalSpeed),
        commanded_vertical_speed: Some(Scaled::saturating_from_si(2.0)),
        ..hold.clone()
    };
    refused(
        &mut rig,
        climb,
        "Altitude Command Type 2 (vertical speed) is not flown",
    );
    // A value without a mode is for the mode that is flown.
    rig.done(orders::mode(Mode::AutolandEngage));
    let value = VehicleOperatingModeCommand {
        commanded_altitude: Some(Scaled::saturating_from_si(40.0)),
        ..VehicleOperatingModeCommand::default()
    };
    refused(
        &mut rig,
        value,
        "in the current one, 19 (land), nothing can be changed",
    );
    rig.done(hold.clone());
    let fast = VehicleOperatingModeCommand {
        commanded_speed: Some(Scaled::saturating_from_si(30.0)),
        ..hold.clone()
    };
    refused(&mut rig, fast, "speed 30.0 m/s, expected 0.5 to 12.0");
    let push = VehicleOperatingModeCommand {
        speed_type: Some(SpeedType::Thrust),
        thrust: Some(60),
        ..orders::mode(Mode::Autopilot)
    };
    refused(&mut rig, push.clone(), "Speed Type 3 (thrust)");
    let beside = VehicleOperatingModeCommand {
        speed_type: None,
        ..push
    };
    rig.done(beside);
    rig.run(0.1);
    assert!(
        rig.station()
            .has_alert("2016: ignored in mode 15 (autopilot): Thrust")
    );
}

#[test]
fn a_field_of_a_plan_that_never_has_an_effect_is_reported_once() {
    let mut rig = Rig::ready();
    let before = rig.station().received.len();
    for number in 1..=5 {
        let waypoint = UaPositionWaypoint {
            altitude_change_behaviour: Some(stanag_msgs::enums::AltitudeChangeBehaviour::from_raw(
                1,
            )),
            ..orders::waypoint(number, 0, 50.0, 0.0, 20.0)
        };
        rig.done(waypoint);
    }
    let reasons: Vec<_> = reasons(&rig, 0, before)
        .into_iter()
        .filter_map(|alert| alert.text)
        .collect();
    assert_eq!(reasons.len(), 1, "{reasons:?}");
    assert_eq!(
        reasons[0].as_str(),
        "13002: ignored: Altitude Change Behaviour"
    );
}

#[test]
fn a_message_that_a_vsm_sends_is_refused_with_the_reason() {
    let mut rig = Rig::ready();
    let wall = rig.now().wall;
    let report = InertialStates {
        time_stamp: Some(stanag_msgs::TimeStamp::from_unix_ms(wall.as_millis() as u64)),
        ..InertialStates::default()
    };
    let envelope = stanag_msgs::Envelope::new(cucs(0), vehicle_id(0)).requesting_ack();
    let mut bytes = [0; stanag_msgs::MAX_DATAGRAM];
    let length = Message::from(report)
        .encode(&envelope, &mut bytes)
        .expect("it fits");
    rig.deliver_from_station(&bytes[..length]);
    rig.run(0.1);
    assert!(rig.station().has_alert("message is VSM to CUCS only"));
    // A vector with a bit that no field has.
    bytes[16] |= 0x80;
    rig.deliver_from_station(&bytes[..length]);
    rig.run(0.1);
    assert!(rig.station().has_alert("has bits beyond"));
}

#[test]
fn copies_to_the_group_are_addressed_to_the_station_that_they_are_for() {
    let mut rig = Rig::new(Setup {
        stations: 2,
        dli_keys: "multicast = \"225.200.1.0:51017\"\ninterface = \"127.0.0.1\"",
        ..Setup::default()
    });
    rig.run(9.0);
    assert!(rig.group.is_empty(), "nobody listens yet");
    for (station, levels) in [(0, 0x0f), (1, 0x01)] {
        let request = CucsAuthorisationRequest {
            requested_handover_loi: Some(LoiBitmap::from_raw(levels)),
            ..orders::request_control()
        };
        let ticket = rig.send_as(station, 0, request);
        assert_eq!(rig.end_as(station, ticket), Some(AckType::CarriedOut));
    }
    rig.run(2.0);
    rig.group.clear();
    rig.run(5.0);
    let mut counts = [0; 2];
    for bytes in &rig.group {
        for frame in frames(bytes) {
            let header = frame.expect("a sound one").header;
            assert_eq!(header.source, vehicle_id(0));
            let to = (0..2).find(|index| cucs(*index) == header.destination);
            let to = to.expect("one of the stations that listen");
            counts[to] += usize::from(header.message_type == 4000);
        }
    }
    assert!(
        counts.iter().all(|count| (24..=27).contains(count)),
        "{counts:?}"
    );
}

#[test]
fn of_a_storm_of_refusals_each_is_acknowledged_and_some_are_explained() {
    let mut rig = Rig::ready();
    let mark = rig.station().received.len();
    let tickets: Vec<_> = (0..300)
        .map(|_| {
            rig.run(0.01);
            rig.send(orders::mode(Mode::from_raw(17)))
        })
        .collect();
    rig.run(1.0);
    let ends = tickets.iter().map(|ticket| rig.station().end(*ticket));
    assert!(ends.into_iter().all(|end| end == Some(AckType::Refused)));
    let alerts = reasons(&rig, 0, mark).len();
    assert!((1..=20).contains(&alerts), "{alerts}");
    // Something else is reported all the same.
    rig.mav.faults.loss = 1.0;
    assert!(rig.until(8.0, |rig| {
        rig.station().has_alert("no data from the vehicle")
    }));
}
