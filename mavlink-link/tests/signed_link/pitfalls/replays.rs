//! Nothing is taken twice, nor on another link, nor as the answer to a later question.

use std::sync::Mutex;
use std::time::Duration;

use kit::attacks;
use mavlink_link::dialect::{MavMessage, STATUSTEXT_DATA};
use mavlink_link::link::{Endpoint, Link, LinkConfig, LinkState, Security};
use mavlink_link::signing::Stamp;

use crate::support::{DAY, STRANGER, Station, VEHICLE, Vehicle, WALL, ack, at, live_pair, ms};

#[test]
fn pitfall_02_a_retry_is_signed_anew() {
    let (mut station, mut vehicle) = live_pair(Endpoint::Listen);
    let (first, a) = station.send(at(10), &ack());
    let (second, b) = station.send(at(10), &ack());
    assert!(b.stamp > a.stamp && b.seq == a.seq.wrapping_add(1));
    assert!(vehicle.receive(&first));
    assert!(vehicle.receive(&second));
    assert!(!vehicle.receive(&first));
}

#[test]
fn pitfall_03_the_stream_keeps_the_stamp_of_every_packet() {
    let (mut station, mut vehicle) = live_pair(Endpoint::Listen);
    let count = attacks::times(20, 2_000);
    let frames: Vec<_> = (0..count).map(|_| vehicle.heartbeat()).collect();
    for frame in &frames {
        assert_eq!(station.receive(at(10), VEHICLE, frame).len(), 1);
    }
    for frame in &frames {
        assert!(station.receive(at(11), VEHICLE, frame).is_empty());
    }
    assert_eq!(
        station.link.stats().stale - 1,
        count,
        "one was stale while the pair came up"
    );
    attacks::report(attacks::FRAMES, count, "nothing delivered");
}

#[test]
fn pitfall_04_there_is_no_window_in_which_a_replay_passes() {
    let (mut station, mut vehicle) = live_pair(Endpoint::Listen);
    let (first, second) = (vehicle.heartbeat(), vehicle.heartbeat());
    assert_eq!(station.receive(at(10), VEHICLE, &second).len(), 1);
    // 10 us older, in the same millisecond.
    assert!(station.receive(at(10), VEHICLE, &first).is_empty());
    assert!(station.receive(at(10), VEHICLE, &second).is_empty());
}

#[test]
fn pitfall_05_a_capture_of_one_link_is_refused_on_the_other() {
    let (mut station, mut vehicle) = live_pair(Endpoint::Listen);
    let mut other = Link::new(LinkConfig::new(1, Security::Signed, Endpoint::Listen));
    let frame = vehicle.heartbeat();
    assert_eq!(station.receive(at(10), VEHICLE, &frame).len(), 1);
    let auth = Station::auth(&mut station.keys, &mut station.store);
    other.handle_datagram(at(11), STRANGER, &frame, auth, &mut |_| {
        panic!("delivered twice")
    });
    assert_eq!(other.stats().stale, 1);

    // One that was lost on its own link names that link: it is not taken on this one either.
    let mut elsewhere = Vehicle {
        link_id: 1,
        ..Vehicle::new(vehicle.stamp)
    };
    assert!(
        station
            .receive(at(12), VEHICLE, &elsewhere.heartbeat())
            .is_empty()
    );
    assert_eq!(station.link.stats().unexpected_link, 1);
}

/// The vehicle's other link was recorded since our last run, and we have just started: the recordings are played in
/// whenever the link could forget which one it is.
#[test]
fn pitfall_05_captures_of_another_link_neither_shut_the_vehicle_out_nor_keep_the_peer() {
    let mut station = Station::new(Endpoint::Listen, at(0));
    let mut other = Vehicle {
        link_id: 1,
        ..Vehicle::new(Stamp::from_unix(at(1_000).wall))
    };
    let captures: Vec<_> = (0..100).map(|_| other.heartbeat()).collect();
    let mut vehicle = Vehicle::new(Stamp::from_unix(at(2_000).wall));
    let mut refused = 0;
    for (n, capture) in (0..100).zip(&captures) {
        let now = 5_000 + n * 4_900;
        let taken = !station.receive(at(now), STRANGER, capture).is_empty();
        assert!(n == 0 || !taken, "capture {n}");
        for k in 1..40 {
            for (to, frame) in station.tick(at(now + k * 100)) {
                if to == VEHICLE {
                    vehicle.receive(&frame);
                }
            }
            let frame = vehicle.heartbeat();
            let accepted = station
                .receive(at(now + k * 100 + 50), VEHICLE, &frame)
                .len();
            refused += usize::from(accepted == 0);
        }
        assert_eq!(station.link.peer(), Some(VEHICLE));
    }
    // Only until the first heartbeat of ours has come back.
    assert!(refused <= 2, "{refused} of 3,900 refused");
    assert_eq!(station.link.learned_link_id(), Some(0));
}

#[test]
fn pitfall_06_two_threads_with_one_key_deliver_each_frame_once() {
    let (station, mut vehicle) = live_pair(Endpoint::Listen);
    let frames: Vec<_> = (0..500).map(|_| vehicle.heartbeat()).collect();
    // The table can only be reached through `&mut KeyState`, so the lock is the caller's and whole.
    let shared = Mutex::new((station.keys, station.store));
    let delivered = Mutex::new(Vec::new());
    std::thread::scope(|scope| {
        for _ in 0..2 {
            scope.spawn(|| {
                let mut link = Link::new(LinkConfig::new(1, Security::Signed, Endpoint::Listen));
                for frame in &frames {
                    let mut guard = shared.lock().unwrap();
                    let (keys, store) = &mut *guard;
                    let auth = Station::auth(keys, store);
                    link.handle_datagram(at(10), VEHICLE, frame, auth, &mut |d| {
                        delivered.lock().unwrap().push(d.stamp);
                    });
                    drop(guard);
                    std::thread::yield_now();
                }
            });
        }
    });
    let mut delivered = delivered.into_inner().unwrap();
    let count = delivered.len();
    delivered.sort();
    delivered.dedup();
    assert_eq!((count, delivered.len()), (500, 500));
}

#[test]
fn pitfall_17_what_reordering_loses_comes_through_by_a_retry() {
    let (mut station, mut vehicle) = live_pair(Endpoint::Listen);
    let text = MavMessage::STATUSTEXT(STATUSTEXT_DATA::default());
    let (early, late) = (vehicle.send(&text), vehicle.send(&ack()));
    assert_eq!(station.receive(at(10), VEHICLE, &late).len(), 1);
    assert!(station.receive(at(10), VEHICLE, &early).is_empty());
    assert_eq!(
        station.link.state(),
        LinkState::Live,
        "one late frame is no fall"
    );
    let again = vehicle.send(&text);
    assert_eq!(station.receive(at(11), VEHICLE, &again).len(), 1);
}

#[test]
fn pitfall_19_nothing_from_before_a_restart_is_accepted_after_it() {
    let (mut station, mut vehicle) = live_pair(Endpoint::Listen);
    let mut recorded = Vec::new();
    for n in 1..60 {
        for (_, frame) in station.tick(at(n * 1_000)) {
            vehicle.receive(&frame);
        }
        let frame = vehicle.heartbeat();
        // Every second one is lost on its way, and only the recorder has it.
        if n % 2 == 0 {
            assert_eq!(station.receive(at(n * 1_000), VEHICLE, &frame).len(), 1);
        }
        recorded.push(frame);
    }
    for wall in [WALL, WALL - 3652 * DAY, WALL + ms(60_000)] {
        let now = mavlink_link::Now {
            mono: Duration::ZERO,
            wall,
        };
        station = station.restart(now);
        for frame in &recorded {
            assert!(station.receive(now, VEHICLE, frame).is_empty());
        }
        assert_eq!(station.link.stats().stale, 59);
    }
}

#[test]
fn pitfall_25_an_old_acknowledgement_confirms_no_new_command() {
    let (mut station, mut vehicle) = live_pair(Endpoint::Listen);
    let delayed = vehicle.send(&ack());
    let (command, sent) = station.send(at(500), &ack());
    let mut can_answer = |frame: &[u8], now| {
        let mut answers = None;
        let auth = Station::auth(&mut station.keys, &mut station.store);
        station
            .link
            .handle_datagram(now, VEHICLE, frame, auth, &mut |d| {
                answers = Some(d.can_answer(sent.stamp));
            });
        answers
    };
    // The delayed one is genuine and new to us, so it is delivered, but it answers nothing.
    assert_eq!(can_answer(&delayed, at(510)), Some(false));
    assert!(vehicle.receive(&command));
    assert_eq!(can_answer(&vehicle.send(&ack()), at(520)), Some(true));
    // One held back for over a minute is shown, but confirms nothing either.
    let held = vehicle.send(&ack());
    assert_eq!(can_answer(&held, at(62_000)), Some(false));
}
