//! Stamps: where they begin, how they follow time, and who can move them.

use std::time::Duration;

use kit::attacks;
use mavlink_link::clock::{Origin, WallState};
use mavlink_link::frame::INCOMPAT_SIGNED;
use mavlink_link::link::{Alert, Endpoint, Event, Link, LinkConfig, Security};
use mavlink_link::receiver::KeyState;
use mavlink_link::signing::Stamp;

use crate::support::{
    BUILD, DAY, MemoryDisk, STRANGER, Station, VEHICLE, Vehicle, WALL, ack, at, heartbeat, key,
    live_pair, ms, other_key,
};

#[test]
fn pitfall_01_stamps_follow_time_through_a_silence() {
    let (mut station, mut vehicle) = live_pair(Endpoint::Listen);
    let (_, before) = station.send(at(10), &heartbeat());
    // Ten minutes without a word; another of the vehicle's streams has moved its clock meanwhile.
    vehicle.stamp = Stamp::from_unix(at(600_000).wall);
    let (frame, after) = station.send(at(600_010), &ack());
    let passed = after.stamp.unwrap().since(before.stamp.unwrap());
    assert_eq!(passed, Duration::from_secs(600));
    assert!(vehicle.receive(&frame));
}

#[test]
fn pitfall_10_epoch_unit_and_link_id_stand_where_they_belong() {
    let mut station = Station::new(Endpoint::Fixed(VEHICLE), at(0));
    station.link = Link::new(LinkConfig {
        link_id: 0x5c,
        ..LinkConfig::new(1, Security::Signed, Endpoint::Fixed(VEHICLE))
    });
    let (frame, _) = station.send(at(2_500), &heartbeat());
    let trailer = &frame[frame.len() - 13..];
    assert_eq!(trailer[0], 0x5c);
    // 2026-11-21 00:00:02.5 UTC, counted by hand: days since 2015-01-01 times 86,400 s, in 10 us.
    let units = (4_342 * 86_400 * 100_000 + 250_000_u64).to_le_bytes();
    assert_eq!(trailer[1..7], units[..6]);
    assert_eq!(frame[2], INCOMPAT_SIGNED);
}

#[test]
fn pitfall_11_the_wall_clock_may_jump_ten_years_either_way() {
    let ten_years = 3652 * DAY;
    let (mut station, mut vehicle) = live_pair(Endpoint::Listen);
    let mut exchange = |station: &mut Station, now| {
        let (frame, sent) = station.send(now, &ack());
        assert!(vehicle.receive(&frame), "{now:?}");
        assert_eq!(
            station.receive(now, VEHICLE, &vehicle.heartbeat()).len(),
            1,
            "{now:?}"
        );
        sent.stamp.unwrap()
    };
    let before = exchange(&mut station, at(10));
    let mut last = before;
    for (seconds, wall) in [(1, WALL + ten_years), (2, WALL - ten_years), (3, WALL)] {
        let now = mavlink_link::Now {
            mono: Duration::from_secs(seconds),
            wall,
        };
        station.tick(now);
        let stamp = exchange(&mut station, now);
        assert!(stamp > last && stamp.since(before) < Duration::from_secs(5));
        last = stamp;
    }
    // And over a restart, where the clock is read again.
    for (wall, state) in [
        (WALL - ten_years, WallState::Behind),
        (WALL + ten_years, WallState::FarAhead),
    ] {
        let now = mavlink_link::Now {
            mono: Duration::ZERO,
            wall,
        };
        station = station.restart(now);
        assert_eq!(station.keys.clock().wall_state(), state);
        // Above everything before, and not far: the vehicle's streams and other ends still fit.
        let stamp = station.keys.clock().reading(now);
        assert!(stamp > last && stamp.since(last) < Duration::from_secs(30));
    }
}

#[test]
fn pitfall_12_a_packet_a_year_ahead_moves_nothing() {
    let (mut station, mut vehicle) = live_pair(Endpoint::Listen);
    let before = station.keys.clock().reading(at(10));
    let ahead = before.plus(365 * DAY);
    for n in 0..50 {
        let frame = vehicle.send_stamped(&heartbeat(), ahead.plus(ms(n)));
        assert!(station.receive(at(10), VEHICLE, &frame).is_empty());
    }
    assert_eq!(station.link.stats().future, 50);
    assert_eq!(station.keys.clock().reading(at(10)), before);
    assert_eq!(
        station.receive(at(11), VEHICLE, &vehicle.heartbeat()).len(),
        1
    );

    // Within the hour it is followed, but the hour is measured from the base and does not ratchet.
    let limit = station
        .keys
        .clock()
        .base(at(20))
        .plus(Duration::from_secs(3_600));
    let mut stamp = limit;
    assert_eq!(
        station
            .receive(at(20), VEHICLE, &vehicle.send_stamped(&ack(), stamp))
            .len(),
        1
    );
    for _ in 0..50 {
        stamp = stamp.plus(Duration::from_secs(60));
        let frame = vehicle.send_stamped(&ack(), stamp);
        assert!(station.receive(at(20), VEHICLE, &frame).is_empty());
    }
    assert_eq!(station.keys.clock().reading(at(20)), limit.next().unwrap());
}

#[test]
fn pitfall_13_a_forgers_stamp_is_not_kept() {
    let (mut station, mut vehicle) = live_pair(Endpoint::Listen);
    let mut forger = Vehicle {
        key: other_key(),
        ..Vehicle::new(vehicle.stamp)
    };
    let count = attacks::times(99, 6_700_000);
    for n in 0..count {
        let ahead = Duration::from_secs(1 + n % 99);
        let frame = forger.send_stamped(&heartbeat(), vehicle.stamp.plus(ahead));
        assert!(station.receive(at(10), STRANGER, &frame).is_empty());
    }
    assert_eq!(station.link.stats().bad_signature, count);
    assert_eq!(
        station.receive(at(11), VEHICLE, &vehicle.heartbeat()).len(),
        1
    );
    assert_eq!(station.link.peer(), Some(VEHICLE));
    // Many at once raise one alert, not a hundred.
    let alerts = std::iter::from_fn(|| station.link.poll_event())
        .filter(|event| *event == Event::Alert(Alert::BadSignatures))
        .count();
    assert_eq!(alerts, 1);
    attacks::report(
        attacks::SIGNATURES,
        count,
        "nothing delivered, one alert; the vehicle's next frame is",
    );
}

#[test]
fn a_new_key_of_ours_begins_at_its_initial_stamp() {
    let mut store = MemoryDisk::default();
    let initial = Stamp::from_unix(WALL).plus(Duration::from_secs(5));
    let origin = Origin::Provisioned { initial };
    let keys = KeyState::start(key(), origin, BUILD, at(0), &mut store).unwrap();
    assert_eq!(keys.clock().floor().get(), initial.get() - 1);
    assert!(keys.clock().reading(at(0)) > initial);
    let link = Link::new(LinkConfig::new(1, Security::Signed, Endpoint::Listen));
    let mut station = Station { link, keys, store };
    let mut vehicle = Vehicle::new(initial);
    assert_eq!(
        station.receive(at(1), VEHICLE, &vehicle.heartbeat()).len(),
        1
    );
}
