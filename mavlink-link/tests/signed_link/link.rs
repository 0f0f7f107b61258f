//! How one link finds, keeps, loses and lifts its vehicle.

use std::time::Duration;

use crate::support::*;
use mavlink_link::Now;
use mavlink_link::clock::{Ceiling, Origin};
use mavlink_link::dialect::MavMessage;
use mavlink_link::frame::{FrameView, KEY_EXCHANGE_ID, MAX_FRAME};
use mavlink_link::link::{
    Alert, Auth, Endpoint, Event, Link, LinkConfig, LinkState, Role, Security, SendError,
};
use mavlink_link::receiver::KeyState;
use mavlink_link::signing::{Stamp, verify};
use mavlink_link::store::Store as _;

fn events(station: &mut Station) -> Vec<Event<Addr>> {
    std::iter::from_fn(|| station.link.poll_event()).collect()
}

#[test]
fn a_listening_link_lifts_a_restarted_vehicle_within_one_round_trip() {
    let mut station = Station::new(Endpoint::Listen, at(0));
    let mut vehicle = Vehicle::new(Stamp::ZERO);
    assert_eq!(
        station.tick(at(0)),
        vec![],
        "there is nobody to talk to yet"
    );

    assert!(
        station
            .receive(at(100), VEHICLE, &vehicle.heartbeat())
            .is_empty()
    );
    assert_eq!(station.link.peer(), None, "what is stale moves no peer");
    let mut out = [0; MAX_FRAME];
    let auth = Station::auth(&mut station.keys, &mut station.store);
    assert_eq!(
        station.link.send(at(100), auth, &ack(), &mut out),
        Err(SendError::NoPeer)
    );

    let sent = station.heartbeats(at(100));
    assert_eq!(sent.len(), 1, "a heartbeat, at once");
    assert_eq!(sent[0].0, VEHICLE);
    assert!(vehicle.receive(&sent[0].1));

    let got = station.receive(at(120), VEHICLE, &vehicle.heartbeat());
    assert!(got.len() == 1 && got[0].verified && !got[0].late);
    assert_eq!(
        events(&mut station),
        [
            Event::PeerChanged {
                from: None,
                to: VEHICLE
            },
            Event::Live
        ]
    );
    assert_eq!(station.link.state(), LinkState::Live);
}

#[test]
fn a_heartbeat_that_waits_for_the_disk_is_sent_once_it_has_written() {
    let disk = MemoryDisk {
        queues: true,
        ..MemoryDisk::default()
    };
    let mut station = Station::with_store(Endpoint::Listen, at(0), disk);
    let mut vehicle = Vehicle::new(Stamp::ZERO);
    station.receive(at(100), VEHICLE, &vehicle.heartbeat());
    assert_eq!(station.heartbeats(at(100)), [], "nothing is signed yet");
    station.store.complete(u64::MAX);
    let sent = station.heartbeats(at(130));
    assert_eq!(sent.len(), 1, "at once, not a second later");
    assert!(vehicle.receive(&sent[0].1));
    let got = station.receive(at(140), VEHICLE, &vehicle.heartbeat());
    assert!(got.len() == 1 && got[0].verified);
}

#[test]
fn heartbeats_go_out_each_second_unprompted_and_say_what_we_are() {
    let mut station = Station::new(Endpoint::Fixed(VEHICLE), at(0));
    let mut beats = Vec::new();
    let mut now = at(0);
    while now.mono < Duration::from_secs(10) {
        for (to, frame) in station.tick(now) {
            beats.push((now.mono, to, frame));
        }
        assert!(station.link.poll_timeout() > now.mono);
        now = at(station.link.poll_timeout().as_millis() as u64);
    }
    assert_eq!(beats.len(), 10);
    for (n, (when, to, frame)) in beats.iter().enumerate() {
        assert_eq!((*when, *to), (Duration::from_secs(n as u64), VEHICLE));
        let view = FrameView::parse(frame).unwrap();
        verify(&key(), &view).unwrap();
        let MavMessage::HEARTBEAT(data) = view.message().unwrap() else {
            panic!()
        };
        assert_eq!((data.mavtype as u32, data.autopilot as u32), (6, 8));
        let header = view.header();
        assert_eq!(
            (header.system_id, header.component_id, header.seq),
            (245, 190, n as u8)
        );
    }
    assert_eq!(station.link.stats().sent_heartbeats, 10);
}

#[test]
fn heartbeats_missed_in_a_pause_are_not_made_up_for() {
    let mut station = Station::new(Endpoint::Fixed(VEHICLE), at(0));
    assert_eq!(station.tick(at(0)).len(), 1);
    assert_eq!(station.tick(at(30_000)).len(), 1);
    assert_eq!(station.tick(at(30_001)).len(), 0);
    assert_eq!(station.tick(at(31_000)).len(), 1);
}

#[test]
fn a_vehicle_that_falls_back_is_behind_after_three_frames_and_live_at_the_first_good_one() {
    let (mut station, mut vehicle) = live_pair(Endpoint::Listen);
    vehicle.restart();
    let mut lifts = 0;
    for n in 0..200 {
        let now = at(2_000 + n * 10);
        assert!(
            station
                .receive(now, VEHICLE, &vehicle.heartbeat())
                .is_empty()
        );
        lifts += station.heartbeats(now).len();
        let state = if n < 2 {
            LinkState::Live
        } else {
            LinkState::Behind
        };
        assert_eq!(station.link.state(), state, "after {} frames", n + 1);
    }
    assert_eq!(lifts, 10, "five a second, for two seconds");
    assert_eq!(events(&mut station), [Event::Behind]);
    assert_eq!(station.link.peer(), Some(VEHICLE));

    // None of them reached the vehicle. After five seconds an alert is raised, once.
    for n in 0..20 {
        let now = at(4_000 + n * 500);
        station.receive(now, VEHICLE, &vehicle.heartbeat());
        station.tick(now);
    }
    assert_eq!(events(&mut station), [Event::Alert(Alert::StaysBehind)]);

    station.receive(at(15_000), VEHICLE, &vehicle.heartbeat());
    for (_, frame) in station.tick(at(15_000)) {
        vehicle.receive(&frame);
    }
    assert_eq!(
        station
            .receive(at(15_010), VEHICLE, &vehicle.heartbeat())
            .len(),
        1
    );
    assert_eq!(events(&mut station), [Event::Live]);
}

#[test]
fn a_vehicle_that_falls_back_and_comes_from_a_new_port_is_lifted_there() {
    let (mut station, mut vehicle) = live_pair(Endpoint::Listen);
    vehicle.restart();
    assert!(
        station
            .receive(at(5_000), VEHICLE + 9, &vehicle.heartbeat())
            .is_empty()
    );
    assert_eq!(
        station.link.peer(),
        Some(VEHICLE),
        "a stale frame moves nothing"
    );
    let sent = station.heartbeats(at(5_000));
    assert_eq!(sent[0].0, VEHICLE + 9);
    assert!(vehicle.receive(&sent[0].1));
    assert_eq!(
        station
            .receive(at(5_010), VEHICLE + 9, &vehicle.heartbeat())
            .len(),
        1
    );
    assert_eq!(station.link.peer(), Some(VEHICLE + 9));
}

#[test]
fn a_flood_of_replays_from_elsewhere_does_not_use_up_the_vehicles_heartbeats() {
    let (mut station, mut vehicle) = live_pair(Endpoint::Listen);
    let replay = vehicle.heartbeat();
    station.receive(at(10), VEHICLE, &replay);
    vehicle.restart();
    let (mut to_vehicle, mut to_stranger) = (0, 0);
    for n in 0..1_000 {
        let now = at(2_000 + n);
        station.receive(now, STRANGER, &replay);
        let mut sent = station.heartbeats(now);
        if n % 100 == 0 {
            station.receive(now, VEHICLE, &vehicle.heartbeat());
            sent.append(&mut station.heartbeats(now));
        }
        let to = |who| sent.iter().filter(|(to, _)| *to == who).count();
        to_vehicle += to(VEHICLE);
        to_stranger += to(STRANGER);
    }
    assert_eq!((to_vehicle, to_stranger), (5, 1));
}

#[test]
fn without_signing_the_first_sender_holds_the_lock_until_it_is_silent() {
    let mut link: Link<Addr> = Link::new(LinkConfig::new(1, Security::Off, Endpoint::Listen));
    let mut vehicle = Vehicle::new(Stamp::new(1));
    let mut take = |link: &mut Link<Addr>, now, from| {
        let mut n = 0;
        let frame = vehicle.send_unsigned(&heartbeat());
        link.handle_datagram(now, from, &frame, Auth::Off, &mut |d| {
            n += u32::from(!d.verified)
        });
        n
    };
    assert_eq!(take(&mut link, at(0), VEHICLE), 1);
    assert_eq!(take(&mut link, at(4_000), VEHICLE), 1);
    for t in [4_001, 6_000, 9_000] {
        assert_eq!(take(&mut link, at(t), STRANGER), 0);
    }
    assert_eq!(link.stats().wrong_peer, 3);
    assert_eq!(link.peer(), Some(VEHICLE));
    assert_eq!(
        take(&mut link, at(9_001), STRANGER),
        1,
        "after more than 5 s of silence"
    );
    assert_eq!(link.peer(), Some(STRANGER));

    // A configured peer holds it for good.
    let mut link: Link<Addr> =
        Link::new(LinkConfig::new(1, Security::Off, Endpoint::Fixed(VEHICLE)));
    assert_eq!(take(&mut link, at(60_000), STRANGER), 0);
    assert_eq!(take(&mut link, at(60_000), VEHICLE), 1);

    // Another system is not the vehicle, and takes no lock.
    let mut link: Link<Addr> = Link::new(LinkConfig::new(9, Security::Off, Endpoint::Listen));
    assert_eq!(take(&mut link, at(0), VEHICLE), 0);
    assert_eq!((link.peer(), link.stats().unexpected_system), (None, 1));
}

#[test]
fn without_signing_frames_go_out_unsigned() {
    let config = LinkConfig {
        role: Role::OnboardComputer,
        ..LinkConfig::new(1, Security::Off, Endpoint::Fixed(VEHICLE))
    };
    let mut link: Link<Addr> = Link::new(config);
    let mut out = [0; MAX_FRAME];
    let sent = link.send(at(0), Auth::Off, &heartbeat(), &mut out).unwrap();
    assert!(!FrameView::parse(&out[..sent.len]).unwrap().is_signed());
    assert_eq!(sent.stamp, None);
    link.handle_timeout(at(0));
    let sent = link.poll_transmit(at(0), Auth::Off, &mut out).unwrap();
    let view = FrameView::parse(&out[..sent.len]).unwrap();
    let MavMessage::HEARTBEAT(data) = view.message().unwrap() else {
        panic!()
    };
    assert_eq!(data.mavtype as u32, 18);
}

#[test]
fn a_signed_link_without_its_key_neither_sends_nor_takes() {
    let mut link: Link<Addr> = Link::new(LinkConfig::new(
        1,
        Security::Signed,
        Endpoint::Fixed(VEHICLE),
    ));
    let mut vehicle = Vehicle::new(Stamp::from_unix(WALL));
    let mut out = [0; MAX_FRAME];
    assert_eq!(
        link.send(at(0), Auth::Off, &ack(), &mut out),
        Err(SendError::NoKey)
    );
    for frame in [vehicle.heartbeat(), vehicle.send_unsigned(&heartbeat())] {
        link.handle_datagram(at(0), VEHICLE, &frame, Auth::Off, &mut |_| {
            panic!("unverified")
        });
    }
    assert_eq!(link.stats().no_key, 3);
}

#[test]
fn a_store_that_fails_ends_sending_and_accepting_at_the_old_ceiling() {
    let (mut station, mut vehicle) = live_pair(Endpoint::Listen);
    station.store.full = Some("");
    let ceiling = station.keys.clock().ceiling();
    let writes = station.store.writes;
    let mut out = [0; MAX_FRAME];
    let (mut sent, mut taken) = (0, 0);
    for n in 1..=200 {
        let now = at(n * 100);
        let auth = Station::auth(&mut station.keys, &mut station.store);
        if let Ok(frame) = station.link.send(now, auth, &ack(), &mut out) {
            assert!(frame.stamp.unwrap() <= ceiling);
            sent += 1;
        }
        // The vehicle keeps the true time by itself.
        vehicle.stamp = Stamp::from_unix(now.wall);
        for got in station.receive(now, VEHICLE, &vehicle.heartbeat()) {
            assert!(got.stamp.unwrap() <= ceiling);
            taken += 1;
        }
    }
    assert!(
        (99..=101).contains(&sent) && (99..=101).contains(&taken),
        "{sent} {taken}"
    );
    assert!(station.link.stats().ceiling_not_stored > 90);
    // A failing disk is asked once a second, not for every frame.
    assert!(station.store.writes - writes <= 11);
    assert!(events(&mut station).contains(&Event::Alert(Alert::CeilingNotStored)));

    station.store.full = None;
    assert!(
        !station
            .receive(at(22_000), VEHICLE, &{
                vehicle.stamp = Stamp::from_unix(at(22_000).wall);
                vehicle.heartbeat()
            })
            .is_empty()
    );
}

#[test]
fn the_ceiling_is_stored_before_it_is_needed_and_about_every_ten_seconds() {
    let (mut station, _) = live_pair(Endpoint::Listen);
    for n in 0..6_000 {
        let (_, sent) = station.send(at(n * 10), &ack());
        let Ceiling(stored) = station.store.load(&key().id()).unwrap().unwrap();
        assert!(sent.stamp.unwrap() <= stored);
    }
    assert!(
        (6..=8).contains(&station.store.writes),
        "{}",
        station.store.writes
    );
}

#[test]
fn a_wall_clock_far_ahead_is_used_once_a_person_accepts_it() {
    let mut store = MemoryDisk::default();
    store
        .save(&key().id(), &Ceiling(Stamp::from_unix(WALL)))
        .unwrap();
    let now = Now {
        mono: Duration::ZERO,
        wall: WALL + 400 * DAY,
    };
    let mut station = Station::with_store(Endpoint::Fixed(VEHICLE), now, store);
    assert_eq!(
        station.keys.clock().reading(now),
        Stamp::from_unix(WALL).next().unwrap()
    );
    station.tick(now);
    assert_eq!(events(&mut station), [Event::Alert(Alert::WallFarAhead)]);
    let later = now.after(Duration::from_secs(20));
    station.keys.accept_wall(later);
    assert_eq!(
        station.keys.clock().reading(later),
        Stamp::from_unix(later.wall)
    );
    station.tick(later);
    assert_eq!(events(&mut station), []);
}

#[test]
fn the_wall_clock_set_right_after_a_start_without_one_is_taken_over() {
    // A computer without a battery starts in 1970 and gets the time later.
    let mut store = MemoryDisk::default();
    store
        .save(&key().id(), &Ceiling(Stamp::from_unix(WALL)))
        .unwrap();
    let boot = Now {
        mono: Duration::from_secs(5),
        wall: Duration::from_secs(9),
    };
    let mut keys = KeyState::start(key(), Origin::KeyFile, BUILD, boot, &mut store).unwrap();
    assert_eq!(
        keys.clock().reading(boot),
        Stamp::from_unix(WALL).next().unwrap()
    );
    let set = Now {
        mono: Duration::from_secs(35),
        wall: WALL + DAY,
    };
    keys.watch_wall(set);
    assert_eq!(keys.clock().reading(set), Stamp::from_unix(WALL + DAY));
    // And without any ceiling, not before the build.
    let keys = KeyState::start(
        key(),
        Origin::KeyFile,
        BUILD,
        boot,
        &mut MemoryDisk::default(),
    )
    .unwrap();
    assert!(keys.clock().reading(boot).since(BUILD) < Duration::from_secs(1));
}

#[test]
fn the_key_exchange_gets_its_frames_and_nobody_else() {
    let (mut station, mut vehicle) = live_pair(Endpoint::Listen);
    let mut peer: Link<Addr> = Link::new(LinkConfig {
        own_system: 1,
        own_component: 191,
        ..LinkConfig::new(245, Security::Off, Endpoint::Fixed(245))
    });
    let mut out = [0; MAX_FRAME];
    let mut unsigned = || {
        let payload = [0x42; 203];
        let sent = peer
            .send_raw(at(0), Auth::Off, KEY_EXCHANGE_ID, &payload, None, &mut out)
            .unwrap();
        out[..sent.len].to_vec()
    };
    assert!(station.receive(at(10), STRANGER, &unsigned()).is_empty());
    let [Event::KeyExchange(frame)] = &events(&mut station)[..] else {
        panic!()
    };
    assert_eq!(
        (frame.from, frame.verified, frame.payload()),
        (STRANGER, None, &[0x42; 203][..])
    );
    assert_eq!(station.link.peer(), Some(VEHICLE));

    // A flood is bounded and leaves room for everything else.
    for _ in 0..100 {
        station.receive(at(20), STRANGER, &unsigned());
    }
    // Beside a frame that has just verified it would raise nothing.
    station.receive(at(3_000), VEHICLE, &vehicle.send_unsigned(&ack()));
    let after = events(&mut station);
    assert_eq!(after.len(), 5);
    assert_eq!(after[4], Event::Alert(Alert::VehicleUnsigned));
    assert_eq!(station.link.stats().events_lost, 96);
}

#[test]
fn an_unknown_message_that_verifies_is_passed_raw() {
    let (mut station, mut vehicle) = live_pair(Endpoint::Listen);
    let mut out = [0; MAX_FRAME];
    let mut frame = vehicle.send_unsigned(&heartbeat());
    frame[2] = 1;
    frame[7..10].copy_from_slice(&[0xf0, 0xff, 0xff]);
    out[..frame.len()].copy_from_slice(&frame);
    let len = mavlink_link::signing::sign(&key(), 0, vehicle.stamp, &mut out, frame.len()).unwrap();
    let mut seen = 0;
    for from in [VEHICLE, VEHICLE] {
        let auth = Station::auth(&mut station.keys, &mut station.store);
        station
            .link
            .handle_datagram(at(10), from, &out[..len], auth, &mut |d| {
                assert!(d.verified && d.message.is_err() && !d.payload.is_empty());
                seen += 1;
            });
    }
    assert_eq!(seen, 1, "and once only");
    assert_eq!(station.link.stats().undecoded_id, 1);
    // Unverified, it is nothing.
    out[len - 1] ^= 1;
    assert!(station.receive(at(11), VEHICLE, &out[..len]).is_empty());
    assert_eq!(
        (
            station.link.stats().unknown_id,
            station.link.stats().bad_signature
        ),
        (1, 0)
    );
}

#[test]
fn the_autopilots_link_id_moves_only_by_a_frame_that_it_can_only_have_made_now() {
    let (mut station, vehicle) = live_pair(Endpoint::Listen);
    assert_eq!(station.link.learned_link_id(), Some(0));
    let mut moved = Vehicle {
        link_id: 3,
        ..Vehicle::new(vehicle.stamp)
    };
    // However long the silence: this may be a recording of its other link. A heartbeat goes there.
    for now in [20_000, 600_000] {
        let frame = moved.heartbeat();
        assert!(station.receive(at(now), STRANGER, &frame).is_empty());
        assert_eq!(station.link.peer(), Some(VEHICLE));
        for (to, lift) in station.heartbeats(at(now)) {
            assert_eq!(to, STRANGER);
            assert!(now == 20_000 || moved.receive(&lift));
        }
    }
    assert_eq!(station.link.stats().unexpected_link, 2);
    // What it sends after that heartbeat is no recording.
    let frame = moved.heartbeat();
    assert_eq!(station.receive(at(600_050), STRANGER, &frame).len(), 1);
    assert!(events(&mut station).contains(&Event::Alert(Alert::LinkIdMoved)));
    assert_eq!(station.link.learned_link_id(), Some(3));

    // Was that carried over from another link at once, then the one that it displaced is back with its first frame,
    // and is not displaced again while it speaks.
    let mut vehicle = Vehicle::new(moved.stamp);
    let frame = vehicle.heartbeat();
    assert_eq!(station.receive(at(600_060), VEHICLE, &frame).len(), 1);
    let frame = moved.heartbeat();
    assert!(station.receive(at(600_070), STRANGER, &frame).is_empty());
    let frame = vehicle.heartbeat();
    assert_eq!(station.receive(at(602_600), VEHICLE, &frame).len(), 1);
    assert_eq!(station.link.peer(), Some(VEHICLE));

    // A configured one never does.
    let config = LinkConfig {
        vehicle_link_id: Some(0),
        ..LinkConfig::new(1, Security::Signed, Endpoint::Fixed(VEHICLE))
    };
    station.link = Link::new(config);
    for (_, frame) in station.tick(at(700_000)) {
        moved.receive(&frame);
    }
    let frame = moved.heartbeat();
    assert!(station.receive(at(700_000), VEHICLE, &frame).is_empty());
    assert_eq!(station.link.stats().unexpected_link, 1);
    assert_eq!(station.link.learned_link_id(), None);
}

#[test]
fn a_link_id_that_an_earlier_run_learned_refuses_captures_of_another_link_from_the_start() {
    let config = LinkConfig {
        known_link_id: Some(0),
        ..LinkConfig::new(1, Security::Signed, Endpoint::Listen)
    };
    let mut station = Station::new(Endpoint::Listen, at(0));
    station.link = Link::new(config);
    let capture = Vehicle {
        link_id: 1,
        ..Vehicle::new(Stamp::from_unix(at(1_000).wall))
    }
    .heartbeat();
    assert!(station.receive(at(5_000), STRANGER, &capture).is_empty());
    assert_eq!(station.link.peer(), None);
    let mut vehicle = Vehicle::new(Stamp::from_unix(at(2_000).wall));
    let frame = vehicle.heartbeat();
    assert_eq!(station.receive(at(5_001), VEHICLE, &frame).len(), 1);
}

#[test]
fn a_frame_in_two_datagrams_of_the_peer_is_joined_and_a_cold_start_of_one_is_not() {
    let (mut station, mut vehicle) = live_pair(Endpoint::Listen);
    let frame = vehicle.heartbeat();
    assert!(station.receive(at(10), VEHICLE, &frame[..17]).is_empty());
    assert_eq!(station.receive(at(11), VEHICLE, &frame[17..]).len(), 1);

    let frame = vehicle.heartbeat();
    assert!(station.receive(at(20), VEHICLE, &frame[..17]).is_empty());
    assert!(
        station.receive(at(600), VEHICLE, &frame[17..]).is_empty(),
        "half a second later"
    );
    assert_eq!(station.link.stats().truncated, 1);
    assert_eq!(
        station
            .receive(at(601), VEHICLE, &vehicle.heartbeat())
            .len(),
        1
    );
}

/// How long a restarted station needs until it accepts its vehicle's frames, while recorded frames are played to it in their
/// order. `both`: the vehicle has restarted too.
fn back_after_a_restart(recorded: usize, addresses: u16, both: bool) -> u64 {
    let (mut station, mut vehicle) = live_pair(Endpoint::Listen);
    let recordings: Vec<Vec<u8>> = (0..recorded).map(|_| vehicle.heartbeat()).collect();
    for frame in &recordings {
        station.receive(at(3), VEHICLE, frame);
    }
    let mut station = station.restart(at(1_000));
    if both {
        vehicle.restart();
    }
    let mut played = recordings.iter().cycle();
    for ms in 1_000..21_000 {
        for n in 0..30 {
            let from = STRANGER + (n % addresses);
            let frame = played.next().expect("some are recorded");
            assert!(station.receive(at(ms), from, frame).is_empty());
            // What is due goes out after each datagram, as in the shell.
            for (to, frame) in station.tick(at(ms)) {
                if to == VEHICLE {
                    vehicle.receive(&frame);
                }
            }
        }
        if ms % 50 == 0 {
            if !station
                .receive(at(ms), VEHICLE, &vehicle.heartbeat())
                .is_empty()
            {
                return ms - 1_000;
            }
            for (to, frame) in station.tick(at(ms)) {
                if to == VEHICLE {
                    vehicle.receive(&frame);
                }
            }
        }
    }
    panic!("{recorded} recorded frames from {addresses} addresses keep the link down");
}

#[test]
fn a_recording_played_30_000_times_a_second_does_not_delay_the_link_after_a_restart() {
    // The longest is not over when the link is to be back: no frame of it comes twice.
    for recorded in [1, 2, 20, 40_000] {
        for addresses in [1, 2, 7, 30] {
            for both in [false, true] {
                let ms = back_after_a_restart(recorded, addresses, both);
                assert!(
                    ms <= 1_000,
                    "{recorded} frames, {addresses} addresses, both restarted: {both}: {ms} ms"
                );
            }
        }
    }
}

#[test]
fn an_unsigned_frame_beside_verified_ones_raises_no_alarm() {
    let (mut station, mut vehicle) = live_pair(Endpoint::Listen);
    let unsigned = vehicle.send_unsigned(&ack());
    let raised = |station: &mut Station| {
        let events = events(station);
        events.contains(&Event::Alert(Alert::VehicleUnsigned))
    };
    for ms in (100..30_000).step_by(100) {
        if ms % 1_000 == 0 {
            assert_eq!(
                station.receive(at(ms), VEHICLE, &vehicle.heartbeat()).len(),
                1
            );
        }
        for from in [STRANGER, VEHICLE] {
            assert!(station.receive(at(ms), from, &unsigned).is_empty());
        }
        for (_, frame) in station.tick(at(ms)) {
            vehicle.receive(&frame);
        }
    }
    assert!(!raised(&mut station));
    // It has restarted and lost its key.
    station.receive(at(32_000), VEHICLE, &unsigned);
    assert!(raised(&mut station));
}
