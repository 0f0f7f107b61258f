//! Over a network that loses, duplicates and reorders, every message is carried out once and acknowledged; retransmissions
//! are the same bytes, and stamps rise strictly.

use std::collections::BTreeSet;
use std::time::Duration;

use crate::support::*;
use cucs::{Delivery, Event, Session, SessionConfig};
use stanag_msgs::enums::{AckType, FlightPathControlMode as Mode};
use stanag_msgs::messages::{
    MessageAcknowledgement, UaPositionWaypoint, UaRoute, VehicleOperatingModeCommand,
};
use stanag_msgs::{Id, Message, TimeStamp};

fn session(tries: u32) -> Session {
    let config = SessionConfig {
        tries,
        ..SessionConfig::new(CUCS)
    };
    Session::new(config)
}

fn waypoints(count: u16) -> Vec<Message> {
    let point = |number| UaPositionWaypoint {
        waypoint_number: Some(number),
        next_waypoint: Some(number + 1),
        ..UaPositionWaypoint::default()
    };
    (1..=count).map(|number| point(number).into()).collect()
}

fn command(mode: Mode) -> VehicleOperatingModeCommand {
    VehicleOperatingModeCommand {
        select_flight_path_control_mode: Some(mode),
        ..VehicleOperatingModeCommand::default()
    }
}

#[test]
fn every_message_is_carried_out_once_and_acknowledged() {
    for seed in 1..=20 {
        let mut session = session(40);
        let mut vsm = FakeVsm::new();
        let mut network = bad_network(seed);
        let sent = waypoints(200);
        let mut tickets = session.send_all(now(0), VEHICLE, sent.clone()).unwrap();
        tickets.push(
            session
                .send(now(0), VEHICLE, command(Mode::Loiter))
                .unwrap(),
        );

        let end = converse(&mut session, &mut vsm, &mut network, 300_000, |session| {
            let mut all = tickets.iter();
            all.all(|ticket| {
                session.delivery(*ticket) == Delivery::CarriedOut
                    || session.delivery(*ticket) == Delivery::Received
            })
        });
        assert!(end < 300_000, "seed {seed}: not all acknowledged");

        let numbers: Vec<u16> = vsm
            .carried_out
            .iter()
            .filter_map(|message| match message {
                Message::UaPositionWaypoint(point) => point.waypoint_number,
                _ => None,
            })
            .collect();
        assert_eq!(numbers.len(), 200, "seed {seed}: each once");
        assert_eq!(numbers.iter().collect::<BTreeSet<_>>().len(), 200);

        // A stamp belongs to a single message: whatever arrived with it, first or repeated, has the same bytes.
        let bytes: BTreeSet<&Vec<u8>> = vsm.received.iter().collect();
        let stamps: BTreeSet<TimeStamp> = bytes.iter().map(|bytes| stamp_of(bytes)).collect();
        assert_eq!(bytes.len(), 201);
        assert_eq!(stamps.len(), 201);
        assert!(
            vsm.received.len() > 201,
            "seed {seed}: nothing was lost or duplicated"
        );
        assert!(session.traffic().retransmitted > 0);

        // In the order in which they were submitted.
        let of = |ticket| session.sent(ticket).unwrap().1;
        assert!(tickets.windows(2).all(|pair| of(pair[0]) < of(pair[1])));
    }
}

#[test]
fn a_silent_vsm_is_sent_the_same_bytes_five_times_half_a_second_apart() {
    let mut session = session(5);
    let ticket = session
        .send(now(0), VEHICLE, command(Mode::Loiter))
        .unwrap();
    let mut copies = Vec::new();
    for ms in (0..60_000).step_by(10) {
        session.handle_timeout(now(ms));
        copies.extend(drain(&mut session).into_iter().map(|bytes| (ms, bytes)));
    }
    let times: Vec<u64> = copies.iter().map(|(ms, _)| *ms).collect();
    assert_eq!(times, [0, 500, 1_000, 1_500, 2_000]);
    assert!(copies.iter().all(|(_, bytes)| *bytes == copies[0].1));
    assert_eq!(session.delivery(ticket), Delivery::Unanswered);
    assert_eq!(session.poll_timeout(), None);
    assert_eq!(session.traffic().sent.of(2016), 5);
    assert_eq!(session.traffic().retransmitted, 4);
}

#[test]
fn any_type_of_acknowledgement_ends_the_retransmission_and_the_outcome_follows() {
    for (kind, delivery) in [
        (AckType::Received, Delivery::Received),
        (AckType::CarriedOut, Delivery::CarriedOut),
        (AckType::Refused, Delivery::Refused),
    ] {
        let mut session = session(5);
        let ticket = session
            .send(now(0), VEHICLE, command(Mode::Loiter))
            .unwrap();
        let (kind_of, stamp) = session.sent(ticket).unwrap();
        drain(&mut session);
        session.handle_datagram(now(1), &acknowledgement(VEHICLE, kind_of, stamp, kind));
        assert_eq!(session.delivery(ticket), delivery);
        assert_eq!(session.acknowledgement(2016, stamp), Some(delivery));
        session.handle_timeout(now(400));
        assert!(drain(&mut session).is_empty());
        // A late type 1 undoes nothing.
        session.handle_datagram(
            now(2),
            &acknowledgement(VEHICLE, kind_of, stamp, AckType::Received),
        );
        assert_eq!(session.delivery(ticket), delivery);
        if delivery.is_final() {
            session.handle_timeout(now(10_000));
            assert!(drain(&mut session).is_empty());
        }
        let answered = std::iter::from_fn(|| session.poll_event());
        assert!(
            answered
                .into_iter()
                .any(|event| event == Event::Answered { ticket, delivery })
        );
    }
}

#[test]
fn a_lost_outcome_is_asked_for_with_the_same_bytes_until_it_comes_or_a_minute_has_passed() {
    for outcome_comes in [true, false] {
        let mut session = session(5);
        let ticket = session
            .send(now(0), VEHICLE, command(Mode::Launch))
            .unwrap();
        let (kind_of, stamp) = session.sent(ticket).unwrap();
        let first = drain(&mut session);
        let received = acknowledgement(VEHICLE, kind_of, stamp, AckType::Received);
        let carried_out = acknowledgement(VEHICLE, kind_of, stamp, AckType::CarriedOut);
        session.handle_datagram(now(1), &received);
        let mut copies = 0;
        for ms in (0..300_000).step_by(100) {
            session.handle_timeout(now(ms));
            for copy in drain(&mut session) {
                assert_eq!(copy, first[0]);
                copies += 1;
                // The first outcome was lost; a duplicate is given the last answer again.
                let answer = if outcome_comes {
                    &carried_out
                } else {
                    &received
                };
                session.handle_datagram(now(ms), answer);
            }
        }
        let (expected, delivery) = if outcome_comes {
            (1, Delivery::CarriedOut)
        } else {
            (60, Delivery::Received)
        };
        assert_eq!((copies, session.delivery(ticket)), (expected, delivery));
        assert_eq!(session.poll_timeout(), None);
    }
}

#[test]
fn an_acknowledgement_of_something_else_is_ignored() {
    let mut session = session(5);
    let ticket = session
        .send(now(0), VEHICLE, command(Mode::Loiter))
        .unwrap();
    let (kind_of, stamp) = session.sent(ticket).unwrap();
    let done = AckType::CarriedOut;
    let other = TimeStamp(stamp.0 + 1);
    for wrong in [
        acknowledgement(VEHICLE, kind_of, other, done),
        acknowledgement(VEHICLE, 13000, stamp, done),
        acknowledgement(Id(0x1b00_0102), kind_of, stamp, done),
        acknowledgement(VEHICLE, kind_of, stamp, AckType::from_raw(9)),
    ] {
        session.handle_datagram(now(1), &wrong);
        assert_eq!(session.delivery(ticket), Delivery::Sent(1));
    }
    assert_eq!(session.traffic().dropped["unmatched acknowledgement"], 4);
}

#[test]
fn an_answer_after_the_last_try_still_counts() {
    let mut session = session(1);
    let ticket = session
        .send(now(0), VEHICLE, command(Mode::Loiter))
        .unwrap();
    let (kind_of, stamp) = session.sent(ticket).unwrap();
    session.handle_timeout(now(600));
    assert_eq!(session.delivery(ticket), Delivery::Unanswered);
    session.handle_datagram(
        now(700),
        &acknowledgement(VEHICLE, kind_of, stamp, AckType::CarriedOut),
    );
    assert_eq!(session.delivery(ticket), Delivery::CarriedOut);
}

#[test]
fn stamps_rise_though_the_clock_stops_or_goes_back() {
    let mut session = session(5);
    let mut stamps = Vec::new();
    for unix_ms in [UNIX_MS, UNIX_MS, UNIX_MS - 60_000, UNIX_MS + 5] {
        let at = cucs::Now {
            mono: Duration::ZERO,
            unix_ms,
        };
        for _ in 0..3 {
            let ticket = session
                .send_unconfirmed(at, VEHICLE, UaRoute::default())
                .unwrap();
            stamps.push(session.sent(ticket).unwrap().1);
        }
    }
    assert!(
        stamps.windows(2).all(|pair| pair[0] < pair[1]),
        "{stamps:?}"
    );
    assert_eq!(stamps[0], TimeStamp::from_unix_ms(UNIX_MS));
}

#[test]
fn a_route_is_packed_into_few_datagrams_and_the_window_is_kept() {
    let mut session = session(5);
    session.send_all(now(0), VEHICLE, waypoints(100)).unwrap();
    let first = drain(&mut session);
    let in_them: usize = first.iter().map(|bytes| messages(bytes).len()).sum();
    assert_eq!(in_them, 32);
    assert!(first.len() <= 3, "{} datagrams", first.len());
    // Answers make room.
    let mut vsm = FakeVsm::new();
    for datagram in &first {
        for answer in vsm.handle(datagram) {
            session.handle_datagram(now(1), &answer);
        }
    }
    let second: usize = drain(&mut session)
        .iter()
        .map(|bytes| messages(bytes).len())
        .sum();
    assert_eq!(second, 32);
}

fn acknowledgement(from: Id, kind_of: u16, stamp: TimeStamp, kind: AckType) -> Vec<u8> {
    let answer = MessageAcknowledgement {
        original_message_time_stamp: Some(stamp),
        original_message_type: Some(kind_of),
        acknowledgement_type: Some(kind),
        ..MessageAcknowledgement::default()
    };
    datagram(from, CUCS, answer)
}
