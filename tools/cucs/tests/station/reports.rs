//! The last reports of a vehicle are kept by their stamps; late, duplicate or broken messages, and those for other
//! stations, change nothing; and only a message that requests an answer gets one.

use cucs::{Event, Session, SessionConfig};
use kit::Random;
use stanag_msgs::enums::{
    AckType, AltitudeType, FlightPathControlMode as Mode, HandoverStatus, LoiBitmap, UaState,
};
use stanag_msgs::messages::{
    FromToNextWaypointStates, HandoverStatusReport, InertialStates, MessageAcknowledgement,
    PositiveHandoverAuthorisationGranted, PositiveHandoverAuthorisationRequest,
    VehicleOperatingModeReport, VehicleOperatingStates, VsmAuthorisationResponse,
};
use stanag_msgs::{Bam32, Envelope, Id, Message, Scaled, TimeStamp};

use crate::support::*;

fn session() -> Session {
    Session::new(SessionConfig::new(CUCS))
}

fn mode(stamp: u64, mode: Mode) -> Vec<u8> {
    let report = VehicleOperatingModeReport {
        time_stamp: Some(TimeStamp(stamp)),
        select_flight_path_control_mode: Some(mode),
    };
    datagram(VEHICLE, CUCS, report)
}

#[test]
fn the_latest_report_counts_by_its_stamp_and_not_by_its_arrival() {
    let mut session = session();
    for (stamp, reported, expected) in [
        (1_000, Mode::Launch, Mode::Launch),
        (1_400, Mode::Loiter, Mode::Loiter),
        (1_200, Mode::Launch, Mode::Loiter),
        (1_400, Mode::Launch, Mode::Loiter),
        (1_800, Mode::Waypoint, Mode::Waypoint),
    ] {
        session.handle_datagram(now(0), &mode(stamp, reported));
        assert_eq!(session.vehicle(VEHICLE).unwrap().mode(), Some(expected));
    }
    assert_eq!(session.traffic().dropped["late"], 2);
    // A VSM whose clock was set back an hour is accepted.
    session.handle_datagram(now(0), &mode(5_000_000, Mode::Waypoint));
    session.handle_datagram(now(0), &mode(1_400_000, Mode::AutolandEngage));
    assert_eq!(
        session.vehicle(VEHICLE).unwrap().mode(),
        Some(Mode::AutolandEngage)
    );
}

#[test]
fn position_state_and_waypoints_are_given_in_units() {
    let mut session = session();
    let unknown = InertialStates {
        time_stamp: Some(TimeStamp(1)),
        ..InertialStates::default()
    };
    session.handle_datagram(now(0), &datagram(VEHICLE, CUCS, unknown));
    assert_eq!(session.vehicle(VEHICLE).unwrap().position(), None);

    let inertial = InertialStates {
        time_stamp: Some(TimeStamp(2)),
        latitude: Some(Bam32::from_degrees(47.5)),
        longitude: Some(Bam32::from_degrees(-8.25)),
        altitude: Some(Scaled::from_si(535.4).unwrap()),
        altitude_type: Some(AltitudeType::Wgs84),
        u_speed: Some(Scaled::from_si(3.0).unwrap()),
        v_speed: Some(Scaled::from_si(-4.0).unwrap()),
        ..InertialStates::default()
    };
    let states = VehicleOperatingStates {
        ua_state: Some(UaState::from_raw(10)),
        ..VehicleOperatingStates::default()
    };
    let waypoints = FromToNextWaypointStates {
        from_waypoint_number: Some(0),
        to_waypoint_number: Some(40),
        ..FromToNextWaypointStates::default()
    };
    // All in one datagram.
    let mut bytes = datagram(VEHICLE, CUCS, inertial);
    bytes.extend(datagram(VEHICLE, CUCS, states));
    bytes.extend(datagram(VEHICLE, CUCS, waypoints));
    session.handle_datagram(now(7), &bytes);

    let vehicle = session.vehicle(VEHICLE).unwrap();
    let at = vehicle.position().unwrap();
    assert!((at.latitude_deg - 47.5).abs() < 1e-7);
    assert!((at.longitude_deg + 8.25).abs() < 1e-7);
    assert!((at.altitude_m - 535.4).abs() < 0.011);
    assert_eq!(vehicle.ground_speed_m_s(), Some(5.0));
    assert_eq!(vehicle.landed(), Some(false));
    assert_eq!(
        (vehicle.from_waypoint(), vehicle.to_waypoint()),
        (None, Some(40))
    );
    assert_eq!(vehicle.last_received, now(7).mono);
    for (state, landed) in [
        (0, None),
        (1, Some(true)),
        (3, Some(true)),
        (12, Some(false)),
    ] {
        let states = VehicleOperatingStates {
            ua_state: Some(UaState::from_raw(state)),
            ..VehicleOperatingStates::default()
        };
        session.handle_datagram(now(8), &datagram(VEHICLE, CUCS, states));
        assert_eq!(
            session.vehicle(VEHICLE).unwrap().landed(),
            landed,
            "{state}"
        );
    }
}

#[test]
fn the_rights_of_another_cucs_are_not_ours() {
    let mut session = session();
    let response = |stamp, levels| VsmAuthorisationResponse {
        time_stamp: Some(TimeStamp(stamp)),
        loi_granted: Some(LoiBitmap::from_raw(levels)),
        ..VsmAuthorisationResponse::default()
    };
    session.handle_datagram(now(0), &datagram(VEHICLE, CUCS, response(1, 0x05)));
    session.handle_datagram(
        now(0),
        &datagram(VEHICLE, Id(0x1b00_00b0), response(2, 0x0f)),
    );
    session.handle_datagram(now(0), &datagram(VEHICLE, Id::BROADCAST, response(3, 0x0f)));
    let vehicle = session.vehicle(VEHICLE).unwrap();
    assert_eq!(vehicle.granted(), LoiBitmap::LOI2 | LoiBitmap::LOI4);
    assert_eq!(vehicle.authorisations, 1);
    let dropped = &session.traffic().dropped;
    assert_eq!((dropped["misaddressed"], dropped["for others"]), (1, 1));
}

#[test]
fn a_long_alert_is_reported_once_and_whole() {
    let mut session = session();
    let text = "13000 refused: waypoint 17: 6123 m above home, expected -500 to 5000 m above home";
    let parts = FakeVsm::new().alert(text);
    assert_eq!(parts.len(), 3);
    for index in [2, 0, 2, 1, 1, 0] {
        session.handle_datagram(now(0), &parts[index]);
    }
    let vehicle = session.vehicle(VEHICLE).unwrap();
    let texts: Vec<&str> = vehicle.alerts().map(|alert| alert.text.as_str()).collect();
    assert_eq!(texts, [text]);
    let alerts = std::iter::from_fn(|| session.poll_event())
        .filter(|event| matches!(event, Event::Alert { .. }))
        .count();
    assert_eq!(alerts, 1);
}

#[test]
fn an_acknowledgement_is_sent_only_to_who_asks_this_cucs_for_one() {
    let report = VehicleOperatingModeReport {
        time_stamp: Some(TimeStamp(77)),
        select_flight_path_control_mode: Some(Mode::Loiter),
    };
    let answer = MessageAcknowledgement::default();
    let asks = |to| Envelope::new(VEHICLE, to).requesting_ack();
    for (bytes, answers) in [
        (enveloped(&asks(CUCS), report.clone()), 1),
        (enveloped(&Envelope::new(VEHICLE, CUCS), report.clone()), 0),
        (enveloped(&asks(Id::BROADCAST), report.clone()), 0),
        (enveloped(&asks(Id(0x1b00_00b0)), report.clone()), 0),
        (enveloped(&asks(CUCS), answer), 0),
    ] {
        let mut session = session();
        session.handle_datagram(now(0), &bytes);
        let sent = drain(&mut session);
        assert_eq!(sent.len(), answers);
        for datagram in sent {
            let [(false, VEHICLE, _, Message::MessageAcknowledgement(answer))] =
                &messages(&datagram)[..]
            else {
                panic!("not an acknowledgement");
            };
            assert_eq!(answer.original_message_type, Some(3001));
            assert_eq!(answer.original_message_time_stamp, Some(TimeStamp(77)));
            assert_eq!(answer.acknowledgement_type, Some(AckType::Received));
        }
    }
}

#[test]
fn heartbeats_go_out_once_a_second_and_only_when_switched_on() {
    let mut session = session();
    let mut beats = Vec::new();
    for ms in (0..12_000).step_by(20) {
        match ms {
            3_000 => session.set_heartbeats(now(ms), true),
            8_500 => session.set_heartbeats(now(ms), false),
            _ => session.handle_timeout(now(ms)),
        }
        for datagram in drain(&mut session) {
            for (wants_ack, to, _, message) in messages(&datagram) {
                assert!(matches!(message, Message::Heartbeat(_)));
                assert_eq!((wants_ack, to), (false, Id::BROADCAST));
                beats.push(ms);
            }
        }
    }
    assert_eq!(beats, [3_000, 4_000, 5_000, 6_000, 7_000, 8_000]);
}

#[test]
fn any_bytes_are_survived() {
    let mut session = session();
    let mut random = Random::with_seed(7);
    let mut vsm = FakeVsm::new();
    let mut good = vsm.alert("a text that is longer than one part of it may be, by far");
    good.push(mode(1, Mode::Loiter));
    good.push(datagram(VEHICLE, CUCS, InertialStates::default()));
    for round in 0..20_000_u64 {
        let mut bytes = good[round as usize % good.len()].clone();
        for _ in 0..random.usize(1..=4) {
            let at = random.usize(..bytes.len());
            bytes[at] = random.u8(..);
        }
        bytes.truncate(random.usize(1..=bytes.len() * 2));
        session.handle_datagram(now(round), &bytes);
    }
    session.handle_datagram(now(0), &[]);
    session.handle_datagram(now(0), &[0; 2_000]);
    assert!(
        session.traffic().dropped.len() >= 4,
        "{:?}",
        session.traffic().dropped
    );
    assert!(session.vehicles().count() <= 256);
}

#[test]
fn requests_and_offers_are_reported_once_and_dropped_when_they_are_decided() {
    let control = LoiBitmap::from_raw(0x0c);
    let other = Id(0x1b00_00b0);
    let mut session = Session::new(SessionConfig::new(CUCS));
    let mut stamp = 0;
    let mut deliver = |session: &mut Session, to: Id, message: Message| {
        stamp += 100;
        let message = stamped(message, TimeStamp(800_000_000_000 + stamp));
        session.handle_datagram(now(stamp), &datagram(VEHICLE, to, message));
        std::iter::from_fn(|| session.poll_event())
            .filter(|event| {
                matches!(
                    event,
                    Event::HandoverRequested { .. } | Event::HandoverOffered { .. }
                )
            })
            .collect::<Vec<Event>>()
    };
    let holds = |levels: u8| {
        Message::from(VsmAuthorisationResponse {
            loi_granted: Some(LoiBitmap::from_raw(levels)),
            ..VsmAuthorisationResponse::default()
        })
    };
    let request = || {
        Message::from(PositiveHandoverAuthorisationRequest {
            requested_handover_loi: Some(control),
            requesting_cucs_id: Some(other),
            ..PositiveHandoverAuthorisationRequest::default()
        })
    };
    let offer = |levels: LoiBitmap| {
        Message::from(PositiveHandoverAuthorisationGranted {
            loi_authorized: Some(levels),
            ..PositiveHandoverAuthorisationGranted::default()
        })
    };
    let known = |session: &Session| {
        let vehicle = session.vehicle(VEHICLE).unwrap();
        (vehicle.handover_request(), vehicle.handover_offer())
    };

    assert!(deliver(&mut session, CUCS, holds(0x0d)).is_empty());
    assert!(
        deliver(&mut session, other, request()).is_empty(),
        "it is for another"
    );
    let events = deliver(&mut session, CUCS, request());
    assert_eq!(
        events,
        [Event::HandoverRequested {
            vehicle: VEHICLE,
            by: other,
            loi: control
        }]
    );
    assert!(
        deliver(&mut session, CUCS, request()).is_empty(),
        "once is enough"
    );
    assert_eq!(known(&session), (Some((other, control)), None));
    let over = HandoverStatusReport {
        cucs_id_acquiring_control: Some(other),
        status: Some(HandoverStatus::Failed),
        ..HandoverStatusReport::default()
    };
    deliver(&mut session, CUCS, over.into());
    assert_eq!(known(&session), (None, None));
    assert_eq!(
        deliver(&mut session, CUCS, request()).len(),
        1,
        "a new request"
    );
    deliver(&mut session, CUCS, holds(0x01));
    assert_eq!(
        known(&session),
        (None, None),
        "levels that are not held cannot be requested"
    );

    let offered = deliver(&mut session, CUCS, offer(control));
    assert_eq!(
        offered,
        [Event::HandoverOffered {
            vehicle: VEHICLE,
            loi: control
        }]
    );
    deliver(&mut session, CUCS, holds(0x0d));
    assert_eq!(known(&session), (None, None), "what is held is no offer");
    assert!(deliver(&mut session, CUCS, offer(control)).is_empty());
    deliver(&mut session, CUCS, holds(0x01));
    assert_eq!(deliver(&mut session, CUCS, offer(control)).len(), 1);
    deliver(&mut session, CUCS, offer(LoiBitmap::NONE));
    assert_eq!(known(&session), (None, None), "it was withdrawn");
}

/// The message with this stamp: field 1 of each of these.
fn stamped(message: Message, stamp: TimeStamp) -> Message {
    macro_rules! stamp {
        ($($kind:ident),*) => {
            match message {
                $(Message::$kind(mut m) => {
                    m.time_stamp = Some(stamp);
                    Message::$kind(m)
                })*
                other => panic!("message {} is not stamped here", other.id()),
            }
        };
    }
    stamp!(
        VsmAuthorisationResponse,
        PositiveHandoverAuthorisationRequest,
        PositiveHandoverAuthorisationGranted,
        HandoverStatusReport
    )
}
