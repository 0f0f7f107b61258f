//! Reports come as often as they should, and none is later than its limit, by the virtual clock.

use std::time::Duration;

use kit::bridge::{Rig, Setup, orders, vehicle_id};
use stanag_msgs::enums::{AckType, FlightPathControlMode as Mode, LoiBitmap};
use stanag_msgs::messages::{
    GenericInformationRequestMessage, InertialStates, ScheduleMessageUpdateCommand,
};
use stanag_msgs::{Message, U40, table};

fn schedule(message: u16, hertz: u16) -> ScheduleMessageUpdateCommand {
    ScheduleMessageUpdateCommand {
        requested_message_type: Some(message),
        frequency: Some(hertz),
        ..ScheduleMessageUpdateCommand::default()
    }
}

fn request(message: u16, fields: Option<u64>) -> GenericInformationRequestMessage {
    GenericInformationRequestMessage {
        message_type: Some(message),
        requested_field_presence_vector: fields.map(|all| U40::new(all).expect("five bytes")),
        ..GenericInformationRequestMessage::default()
    }
}

/// When a station received messages of a type since `from`.
fn times(rig: &Rig, message: u16, from: Duration) -> Vec<Duration> {
    let received = rig.station().received.iter();
    received
        .filter(|(at, _, received)| received.id() == message && *at >= from)
        .map(|(at, _, _)| *at)
        .collect()
}

fn longest_gap(times: &[Duration]) -> Duration {
    let gaps = times.windows(2).map(|pair| pair[1] - pair[0]);
    gaps.max().expect("more than one")
}

#[test]
fn status_is_pushed_twice_a_second_on_the_ground_as_in_the_air() {
    let mut rig = Rig::ready();
    rig.run(2.0);
    let from = rig.clock.elapsed();
    rig.done(orders::launch(10.0));
    rig.run(30.0);
    for message in [3001, 3002, 4000, 4001] {
        let times = times(&rig, message, from);
        assert!(times.len() >= 60, "{message}: {}", times.len());
        assert!(
            longest_gap(&times) <= Duration::from_millis(500),
            "{message}: {:?}",
            longest_gap(&times)
        );
    }
}

#[test]
fn a_schedule_is_kept_within_the_latency_of_its_message_and_ends_when_cancelled() {
    let mut rig = Rig::ready();
    for (message, hertz) in [(3001_u16, 10_u16), (3002, 5), (4000, 20), (4001, 4), (3, 1)] {
        let end = rig.carry_out(schedule(message, hertz));
        assert_eq!(end, Some(AckType::CarriedOut), "{message}");
        rig.run(1.0);
        let from = rig.clock.elapsed();
        rig.run(20.0);
        let times = times(&rig, message, from);
        let period = Duration::from_secs(1) / u32::from(hertz);
        let latency = table::message(message).and_then(|info| info.latency_ms);
        let limit = period + Duration::from_millis(latency.expect("it has a limit").into());
        assert!(
            longest_gap(&times) <= limit,
            "{message}: {:?}",
            longest_gap(&times)
        );
        let expected = 20 * usize::from(hertz);
        assert!(
            times.len() + 2 >= expected && times.len() <= expected + 25,
            "{message}: {} of {expected}",
            times.len()
        );
        rig.done(schedule(message, 0));
        rig.run(1.0);
        let from = rig.clock.elapsed();
        rig.run(5.0);
        assert_eq!(self::times(&rig, message, from), []);
    }
}

/// Every report that 17001 and 17002 can ask for of a vehicle that is not flown by hand.
const REPORTS: [u16; 14] = [
    3, 3000, 3001, 3002, 3004, 3005, 3006, 3007, 3009, 3010, 4000, 4001, 12_101, 16_001,
];

#[test]
fn no_report_of_any_kind_is_later_than_its_limit_on_request_and_by_schedule() {
    let mut rig = Rig::ready();
    rig.take_off(15.0);
    // 3009 and 3010 are of messages that the vehicle is asked for first.
    for message in [3009, 3010, 16_001] {
        let _ = rig.carry_out(request(message, None));
    }
    rig.run(3.0);
    for message in REPORTS {
        let info = table::message(message).expect("a report of the table");
        // Where no source gives a limit, a second.
        let limit = Duration::from_millis(info.latency_ms.unwrap_or(1_000).into());
        let _ = rig.carry_out(schedule(message, 0));
        rig.run(0.5);
        let asked = rig.clock.elapsed();
        let end = rig.carry_out(request(message, None));
        assert_eq!(end, Some(AckType::CarriedOut), "{message}");
        let answered = times(&rig, message, asked);
        let took = *answered.first().expect("an answer") - asked;
        assert!(took <= limit, "{message}: {took:?} of {limit:?}");
        let end = rig.carry_out(schedule(message, 2));
        assert_eq!(end, Some(AckType::CarriedOut), "{message}");
        rig.run(1.0);
        let from = rig.clock.elapsed();
        rig.run(6.0);
        let times = times(&rig, message, from);
        let gap = longest_gap(&times);
        let max = Duration::from_millis(500) + limit;
        assert!(gap <= max, "{message}: {gap:?} of {max:?}");
        let _ = rig.carry_out(schedule(message, 0));
    }
}

#[test]
fn acknowledgements_alerts_and_changes_of_mode_are_reported_within_their_limits() {
    let mut rig = Rig::ready();
    let limit = |message: u16| {
        let info = table::message(message).expect("of the table");
        Duration::from_millis(info.latency_ms.unwrap_or(1_000).into())
    };
    // 17000 "received", and the reason of a refusal.
    let asked = rig.clock.elapsed();
    let ticket = rig.send(orders::mode(Mode::SlaveToSensor));
    assert!(rig.until(1.0, |rig| rig.station().end(ticket).is_some()));
    assert!(rig.clock.elapsed() - asked <= limit(17_000));
    let alerts = times(&rig, 16_000, asked);
    assert!(*alerts.first().expect("a reason") - asked <= limit(16_000));
    // 3001 on change: the vehicle's own heartbeat comes once a second, CURRENT_MODE on change.
    rig.done(schedule(3001, 0));
    let ticket = rig.send(orders::launch(10.0));
    let launched = |rig: &Rig| rig.truth().mode == px4_sim::Mode::Takeoff;
    assert!(rig.until(20.0, launched));
    let entered = rig.clock.elapsed();
    assert_eq!(rig.end(ticket), Some(AckType::CarriedOut));
    let reported = times(&rig, 3001, entered);
    let took = *reported.first().expect("a change is reported") - entered;
    assert!(took <= limit(3001) + Duration::from_secs(1), "{took:?}");
}

#[test]
fn a_request_is_answered_at_once_with_the_requested_fields() {
    let mut rig = Rig::ready();
    rig.done(schedule(4000, 0));
    rig.run(1.0);
    let from = rig.clock.elapsed();
    let latitude_alone = Some(0b10);
    rig.done(request(4000, latitude_alone));
    let (at, _, answer) = rig
        .station()
        .received
        .iter()
        .rfind(|(at, from_id, message)| {
            *at >= from && *from_id == vehicle_id(0) && message.id() == 4000
        })
        .expect("the answer");
    assert!(*at - from <= Duration::from_millis(500));
    let Message::InertialStates(states) = answer else {
        panic!("another message")
    };
    let expected = InertialStates {
        time_stamp: states.time_stamp,
        latitude: states.latitude,
        ..InertialStates::default()
    };
    assert_eq!(*states, expected);
    assert!(states.latitude.is_some() && states.time_stamp.is_some());
    // All of them where nothing in particular is asked for.
    for all in [None, Some(0)] {
        rig.done(request(4000, all));
        let last = rig
            .station()
            .last(vehicle_id(0), 4000, |message| match message {
                Message::InertialStates(states) => states.longitude,
                _ => None,
            });
        assert!(last.is_some());
    }
}

#[test]
fn what_is_no_report_is_refused_and_so_is_a_station_without_loi_2() {
    let mut rig = Rig::ready();
    for message in [1, 2016, 6000, 65_000] {
        assert_eq!(rig.carry_out(schedule(message, 1)), Some(AckType::Refused));
        assert_eq!(
            rig.carry_out(request(message, None)),
            Some(AckType::Refused)
        );
    }
    assert_eq!(rig.carry_out(schedule(4000, 101)), Some(AckType::Refused));
    let mut rig = Rig::new(Setup::default());
    rig.run(5.0);
    assert_eq!(rig.carry_out(schedule(4000, 1)), Some(AckType::Refused));
    assert_eq!(rig.carry_out(request(4000, None)), Some(AckType::Refused));
    assert!(rig.station().received.iter().all(|(_, _, message)| {
        !matches!(message, Message::VsmAuthorisationResponse(granted)
            if granted.loi_granted.is_some_and(|levels| levels.contains(LoiBitmap::LOI2)))
    }));
}
