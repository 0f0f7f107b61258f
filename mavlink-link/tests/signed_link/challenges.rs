//! Clocks that are further apart than a receiver follows: they meet at the higher one by a challenge, and by nothing that was
//! ever recorded.

use std::time::Duration;

use mavlink_link::Now;
use mavlink_link::clock::{Ceiling, Origin};
use mavlink_link::link::{Alert, Endpoint, Event, Link, LinkConfig, LinkState, Security};
use mavlink_link::receiver::KeyState;
use mavlink_link::signing::Stamp;
use mavlink_link::store::Store as _;

use crate::support::{
    Addr, BUILD, DAY, MemoryDisk, STRANGER, Station, VEHICLE, Vehicle, WALL, ack, at, heartbeat,
    key, live_pair, ms,
};

const GROUND: Addr = 14_550;

/// A computer beside the vehicle, as its agent is: system 1, and it receives the ground's system 245.
fn air(now: Now, store: MemoryDisk) -> Station {
    let mut station = Station::with_store(Endpoint::Listen, now, store);
    station.link = Link::new(LinkConfig {
        own_system: 1,
        own_component: 191,
        ..LinkConfig::new(245, Security::Signed, Endpoint::Listen)
    });
    station
}

/// The clocks of a computer whose wall clock is ahead.
fn ahead(ms: u64, by: Duration) -> Now {
    let now = at(ms);
    Now {
        wall: now.wall + by,
        ..now
    }
}

/// What both send by themselves reaches the other, second by second. All that the ground has sent.
fn meet(
    ground: &mut Station,
    air: &mut Station,
    seconds: std::ops::Range<u64>,
    by: Duration,
) -> Vec<Vec<u8>> {
    let mut recorded = Vec::new();
    for second in seconds {
        for step in 0..10 {
            let ms = second * 1_000 + step * 100;
            for (_, frame) in ground.tick(ahead(ms, by)) {
                air.receive(at(ms), GROUND, &frame);
                recorded.push(frame);
            }
            for (to, frame) in air.tick(at(ms)) {
                if to == GROUND {
                    ground.receive(ahead(ms, by), VEHICLE, &frame);
                }
            }
        }
    }
    recorded
}

fn answered(station: &Station, ms: u64) -> bool {
    let age = station.link.unanswered(Duration::from_millis(ms));
    station.link.state() == LinkState::Live && age.is_some_and(|age| age < Duration::from_secs(3))
}

#[test]
fn the_clock_behind_meets_the_one_ahead_and_what_was_recorded_meanwhile_is_stale() {
    for by in [2 * Duration::from_secs(3_600), 300 * DAY, 3_653 * DAY] {
        let mut ground = Station::new(Endpoint::Fixed(VEHICLE), ahead(0, by));
        let mut air = air(at(0), MemoryDisk::default());
        // A command that is refused, and recorded.
        let (command, _) = ground.send(ahead(0, by), &ack());
        assert!(air.receive(at(0), GROUND, &command).is_empty());
        assert_eq!(
            (air.link.stats().future, air.link.state()),
            (1, LinkState::Ahead)
        );
        let recorded = meet(&mut ground, &mut air, 0..3, by);
        assert!(answered(&ground, 3_000) && answered(&air, 3_000), "{by:?}");
        assert_eq!(air.link.stats().clock_met, 1);
        let events: Vec<_> = std::iter::from_fn(|| air.link.poll_event()).collect();
        assert!(
            events
                .iter()
                .any(|event| matches!(event, Event::ClockMet(met) if *met > by / 2)),
            "{events:?}"
        );
        for frame in recorded.iter().chain([&command]) {
            assert!(air.receive(at(3_000), STRANGER, frame).is_empty());
        }
        // And after a restart, whatever the wall clock: what was met is stored.
        let mut air = self::air(at(0), air.store);
        assert!(air.keys.clock().reading(at(0)) > Stamp::from_unix(WALL + by));
        for frame in recorded.iter().chain([&command]) {
            assert!(air.receive(at(1), STRANGER, frame).is_empty());
        }
        let (frame, _) = ground.send(ahead(4_000, by), &ack());
        let (late, _) = ground.send(ahead(20_000, by), &ack());
        assert!(
            air.receive(at(4_000), GROUND, &frame).len()
                + air.receive(at(20_000), GROUND, &late).len()
                > 0
        );
    }
}

#[test]
fn a_recorded_answer_and_a_recorded_challenge_move_nothing() {
    let by = 300 * DAY;
    let mut ground = Station::new(Endpoint::Fixed(VEHICLE), ahead(0, by));
    let mut first = air(at(0), MemoryDisk::default());
    let (mut up, mut down) = (Vec::new(), Vec::new());
    for n in 0..30 {
        let ms = n * 100;
        for (_, frame) in ground.tick(ahead(ms, by)) {
            first.receive(at(ms), GROUND, &frame);
            up.push(frame);
        }
        for (_, frame) in first.tick(at(ms)) {
            ground.receive(ahead(ms, by), VEHICLE, &frame);
            down.push(frame);
        }
    }
    assert_eq!(first.link.stats().clock_met, 1);

    // Another end that has accepted nothing of this: every frame that answered is refused, before and after it has asked
    // for itself.
    let mut other = air(at(60_000), MemoryDisk::default());
    let before = other.keys.clock().base(at(60_000));
    for ms in (60_000..70_000).step_by(250) {
        for frame in &up {
            assert!(other.receive(at(ms), STRANGER, frame).is_empty());
        }
        other.tick(at(ms));
    }
    assert_eq!(other.link.stats().clock_met, 0);
    assert_eq!(other.keys.clock().base(at(60_000)), before);
    // It has asked whoever plays them, once a second and no more.
    assert!((8..=12).contains(&other.link.stats().clock_challenges));

    // Recorded challenges are answered at most five times a second, and nobody's clock moves.
    let floor = ground.keys.clock().floor();
    let sent = ground.link.stats().clock_answers;
    for ms in (70_000..71_000).step_by(10) {
        for frame in &down {
            ground.receive(ahead(ms, by), STRANGER, frame);
        }
        ground.heartbeats(ahead(ms, by));
    }
    assert!(ground.link.stats().clock_answers - sent <= 6);
    assert_eq!(ground.keys.clock().floor(), floor);
}

#[test]
fn a_flood_of_recordings_does_not_keep_the_two_apart() {
    let by = 300 * DAY;
    let mut ground = Station::new(Endpoint::Fixed(VEHICLE), ahead(0, by));
    let mut air = air(at(0), MemoryDisk::default());
    // Refused while the agent was off: a thousand frames of the ground.
    let old: Vec<_> = (0..1_000)
        .map(|n| ground.send(ahead(n, by), &ack()).0)
        .collect();
    for ms in (1_000..6_000).step_by(20) {
        for frame in &old {
            air.receive(at(ms), STRANGER, frame);
            for (to, sent) in air.heartbeats(at(ms)) {
                if to == GROUND {
                    ground.receive(ahead(ms, by), VEHICLE, &sent);
                }
            }
        }
        for (_, frame) in ground.tick(ahead(ms, by)) {
            air.receive(at(ms), GROUND, &frame);
        }
        for (to, sent) in air.tick(at(ms)) {
            if to == GROUND {
                ground.receive(ahead(ms, by), VEHICLE, &sent);
            }
        }
    }
    assert_eq!(air.link.stats().clock_met, 1);
    assert!(answered(&air, 6_000) && answered(&ground, 6_000));
    assert_eq!(air.link.peer(), Some(GROUND));
}

#[test]
fn beside_honest_frames_nobody_is_challenged() {
    let (mut station, mut vehicle) = live_pair(Endpoint::Listen);
    let far = station.keys.clock().reading(at(10)).plus(365 * DAY);
    for n in 0..100 {
        let now = at(10 + n * 100);
        let thief = vehicle.send_stamped(&heartbeat(), far.plus(ms(n)));
        station.receive(now, STRANGER, &thief);
        for (to, frame) in station.tick(now) {
            assert_eq!(to, VEHICLE);
            vehicle.receive(&frame);
        }
        station.receive(now, VEHICLE, &vehicle.heartbeat());
    }
    assert_eq!(station.link.stats().clock_challenges, 0);
    assert_eq!(station.link.state(), LinkState::Live);
}

#[test]
fn the_last_ten_years_of_stamps_are_met_by_nobody() {
    let mut store = MemoryDisk::default();
    let near_the_end = Stamp::new(Stamp::MAX.get() - 9 * 365 * 86_400 * 100_000);
    store.save(&key().id(), &Ceiling(near_the_end)).unwrap();
    let mut ground = Station::with_store(Endpoint::Fixed(VEHICLE), at(0), store);
    let mut air = air(at(0), MemoryDisk::default());
    let before = air.keys.clock().base(at(0));
    meet(&mut ground, &mut air, 0..5, Duration::ZERO);
    assert_eq!(air.link.stats().clock_met, 0);
    assert_eq!(air.keys.clock().base(at(0)), before);
}

#[test]
fn a_clock_that_cannot_be_stored_is_not_met_before_the_disk_works() {
    let by = 300 * DAY;
    let mut ground = Station::new(Endpoint::Fixed(VEHICLE), at(0));
    let mut air = air(at(0), MemoryDisk::default());
    meet(&mut ground, &mut air, 0..1, Duration::ZERO);
    let mut ground = Station::new(Endpoint::Fixed(VEHICLE), ahead(1_000, by));
    air.store.full = Some("");
    let before = air.keys.clock().ceiling();
    meet(&mut ground, &mut air, 1..4, by);
    assert_eq!(
        (air.link.stats().clock_met, air.keys.clock().ceiling()),
        (0, before)
    );
    air.store.full = None;
    meet(&mut ground, &mut air, 4..8, by);
    assert_eq!(air.link.stats().clock_met, 1);
}

#[test]
fn no_step_of_the_wall_clock_moves_a_clock_that_has_a_peer() {
    let (mut station, _) = live_pair(Endpoint::Listen);
    let mut last = station.keys.clock().reading(at(10));
    for (second, by) in [
        2 * Duration::from_secs(3_600),
        300 * DAY,
        366 * DAY,
        3_653 * DAY,
    ]
    .into_iter()
    .enumerate()
    {
        let ms = 1_000 * (second as u64 + 1);
        station.tick(ahead(ms, by));
        let stamp = station.keys.clock().reading(ahead(ms, by));
        assert!(stamp.since(last) <= Duration::from_secs(2), "{by:?}");
        station.tick(at(ms + 500));
        last = stamp;
    }
    // Nor where the computer started without a wall clock, once the peer has been received.
    let boot = Now {
        mono: Duration::ZERO,
        wall: Duration::from_secs(9),
    };
    let mut store = MemoryDisk::default();
    store
        .save(&key().id(), &Ceiling(Stamp::from_unix(WALL)))
        .unwrap();
    let mut keys = KeyState::start(key(), Origin::KeyFile, BUILD, boot, &mut store).unwrap();
    let mut link = Link::new(LinkConfig::new(
        1,
        Security::Signed,
        Endpoint::Fixed(VEHICLE),
    ));
    let mut vehicle = Vehicle::new(keys.clock().reading(boot).plus(ms(10)));
    link.handle_datagram(
        boot,
        VEHICLE,
        &vehicle.heartbeat(),
        Station::auth(&mut keys, &mut store),
        &mut |_| {},
    );
    assert_eq!(link.state(), LinkState::Live);
    let set = ahead(1_000, 30 * DAY);
    keys.watch_wall(set);
    assert!(keys.clock().reading(set) < Stamp::from_unix(WALL + DAY));
}

/// The peer's clock is half an hour ahead from the start. A frame that was held back for 20 minutes lies above every
/// stamp of ours of that time, unless our clock runs with the peer's.
#[test]
fn a_frame_held_back_by_a_peer_whose_clock_is_ahead_is_late() {
    let mut station = Station::new(Endpoint::Fixed(VEHICLE), at(0));
    let mut vehicle = Vehicle::new(Stamp::from_unix(WALL).plus(Duration::from_secs(1_800)));
    station.tick(at(0));
    assert_eq!(
        station.receive(at(1), VEHICLE, &vehicle.heartbeat()).len(),
        1
    );
    let held = vehicle.send_stamped(&ack(), vehicle.stamp.plus(Duration::from_secs(1)));
    for second in 1..1_200 {
        station.tick(at(second * 1_000));
    }
    let got = station.receive(at(1_200_000), VEHICLE, &held);
    assert!(got[0].late, "{got:?}");
}

#[test]
fn a_vehicle_that_is_received_and_receives_nothing_is_reported() {
    let (mut station, mut vehicle) = live_pair(Endpoint::Fixed(VEHICLE));
    let mut alerts = 0;
    for second in 1..30_u64 {
        let now = at(second * 1_000);
        // Our frames are lost, or refused: the vehicle counts on from the last one that it has received.
        station.tick(now);
        assert_eq!(station.receive(now, VEHICLE, &vehicle.heartbeat()).len(), 1);
        alerts += std::iter::from_fn(|| station.link.poll_event())
            .filter(|event| *event == Event::Alert(Alert::Unanswered))
            .count();
    }
    assert_eq!(station.link.state(), LinkState::Live, "frames are accepted");
    let age = station.link.unanswered(Duration::from_secs(29)).unwrap();
    assert!(age > Duration::from_secs(27), "{age:?}");
    assert_eq!(alerts, 1);
}

/// Seen on PX4 v1.18 after cuts of 10 and 17 s: "commands are lost" came with the first frame, and they were not.
#[test]
fn a_link_that_comes_back_is_not_reported_as_unanswered_at_once() {
    let (mut station, mut vehicle) = live_pair(Endpoint::Fixed(VEHICLE));
    let mut unanswered = |seconds: std::ops::Range<u64>, received: bool| {
        let mut alerts = 0;
        for second in seconds {
            let now = at(second * 1_000);
            station.tick(now);
            if received {
                assert_eq!(station.receive(now, VEHICLE, &vehicle.heartbeat()).len(), 1);
            }
            station.tick(now);
            alerts += std::iter::from_fn(|| station.link.poll_event())
                .filter(|event| *event == Event::Alert(Alert::Unanswered))
                .count();
        }
        alerts
    };
    assert_eq!(unanswered(1..18, false), 0, "silent");
    assert_eq!(unanswered(18..28, true), 0, "it has had no time to answer");
    assert_eq!(unanswered(28..31, true), 1, "nothing is answered");
}
