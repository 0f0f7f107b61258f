//! The falls of other signers that concern this layer, one test each, numbered as in the list of
//! falls. Those of provisioning (14, 23, 27) are in `provisioning.rs`, those of the key files (18, 28)
//! in `vsm/tests/key_store_survives_failures.rs`; `c_library.rs` shows 7, 12 and 19 beside the C library
//! that falls for them.

mod support;

use std::sync::Mutex;
use std::time::Duration;

use mavlink_link::clock::{Origin, WallState};
use mavlink_link::dialect::{MavMessage, RADIO_STATUS_DATA, SETUP_SIGNING_DATA, STATUSTEXT_DATA};
use mavlink_link::exchange::{Identity, PairingCode};
use mavlink_link::frame::{FrameView, INCOMPAT_SIGNED, checksum};
use mavlink_link::link::{Alert, Endpoint, Event, Link, LinkConfig, LinkState, Security};
use mavlink_link::receiver::KeyState;
use mavlink_link::signing::{KeyError, SigningKey, Stamp, verify};
use mavlink_link::tlog::{MAX_RECORD, record};
use support::*;
use zeroize::{Zeroize as _, ZeroizeOnDrop};

#[test]
fn fall_01_stamps_follow_time_through_a_silence() {
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
fn fall_02_a_retry_is_signed_anew() {
    let (mut station, mut vehicle) = live_pair(Endpoint::Listen);
    let (first, a) = station.send(at(10), &ack());
    let (second, b) = station.send(at(10), &ack());
    assert!(b.stamp > a.stamp && b.seq == a.seq.wrapping_add(1));
    assert!(vehicle.receive(&first));
    assert!(vehicle.receive(&second));
    assert!(!vehicle.receive(&first));
}

#[test]
fn fall_03_the_stream_keeps_the_stamp_of_every_packet() {
    let (mut station, mut vehicle) = live_pair(Endpoint::Listen);
    let frames: Vec<_> = (0..20).map(|_| vehicle.heartbeat()).collect();
    for frame in &frames {
        assert_eq!(station.receive(at(10), VEHICLE, frame).len(), 1);
    }
    for frame in &frames {
        assert!(station.receive(at(11), VEHICLE, frame).is_empty());
    }
    assert_eq!(
        station.link.stats().stale - 1,
        20,
        "one was stale while the pair came up"
    );
}

#[test]
fn fall_04_there_is_no_window_in_which_a_replay_passes() {
    let (mut station, mut vehicle) = live_pair(Endpoint::Listen);
    let (first, second) = (vehicle.heartbeat(), vehicle.heartbeat());
    assert_eq!(station.receive(at(10), VEHICLE, &second).len(), 1);
    // 10 us older, in the same millisecond.
    assert!(station.receive(at(10), VEHICLE, &first).is_empty());
    assert!(station.receive(at(10), VEHICLE, &second).is_empty());
}

#[test]
fn fall_05_a_capture_of_one_link_is_refused_on_the_other() {
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

#[test]
fn fall_06_two_threads_with_one_key_deliver_each_frame_once() {
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
fn fall_07_a_full_table_still_has_a_place_for_the_autopilot() {
    let mut station = Station::new(Endpoint::Listen, at(0));
    let high = Stamp::from_unix(at(1_000).wall);
    for component in 2..30 {
        let mut other = Vehicle {
            component,
            ..Vehicle::new(high)
        };
        station.receive(at(0), VEHICLE, &other.heartbeat());
    }
    assert_eq!(station.link.stats().delivered_verified, 12);
    assert_eq!(station.link.stats().stream_table_full, 16);
    let mut autopilot = Vehicle::new(high);
    assert_eq!(
        station
            .receive(at(0), VEHICLE, &autopilot.heartbeat())
            .len(),
        1
    );
}

#[test]
fn fall_08_a_message_accepted_unsigned_is_refused_with_a_wrong_signature() {
    let (mut station, mut vehicle) = live_pair(Endpoint::Listen);
    let status = MavMessage::RADIO_STATUS(RADIO_STATUS_DATA {
        rssi: 9,
        ..Default::default()
    });
    let got = station.receive(at(10), VEHICLE, &vehicle.send_unsigned(&status));
    assert!(matches!(&got[..], [one] if !one.verified && one.stamp.is_none()));

    vehicle.key = other_key();
    assert!(
        station
            .receive(at(11), VEHICLE, &vehicle.send(&status))
            .is_empty()
    );
    assert_eq!(station.link.stats().bad_signature, 1);
    // And from elsewhere than the peer not even unsigned.
    assert!(
        station
            .receive(at(12), STRANGER, &vehicle.send_unsigned(&status))
            .is_empty()
    );
    assert_eq!(station.link.stats().unsigned_stranger, 1);
}

#[test]
fn fall_09_checksum_and_signature_are_each_checked() {
    let (mut station, mut vehicle) = live_pair(Endpoint::Listen);
    // A wrong checksum under a right signature: made by signing a frame whose checksum is off.
    let good = vehicle.heartbeat();
    let crc_at = 10 + usize::from(good[1]);
    let mut out = [0; 280];
    out[..good.len()].copy_from_slice(&good);
    out[crc_at] ^= 1;
    let len = mavlink_link::signing::sign(&key(), 0, vehicle.stamp, &mut out, crc_at + 2).unwrap();
    assert!(station.receive(at(10), VEHICLE, &out[..len]).is_empty());
    assert_eq!(
        (
            station.link.stats().bad_crc,
            station.link.stats().bad_signature
        ),
        (1, 0)
    );

    // A right checksum under a signature that was made before the payload was changed.
    let mut forged = vehicle.heartbeat();
    forged[12] ^= 1;
    let crc = checksum(&forged[1..crc_at], 50);
    forged[crc_at..crc_at + 2].copy_from_slice(&crc.to_le_bytes());
    assert!(station.receive(at(11), VEHICLE, &forged).is_empty());
    assert_eq!(
        (
            station.link.stats().bad_crc,
            station.link.stats().bad_signature
        ),
        (1, 1)
    );
}

#[test]
fn fall_10_epoch_unit_and_link_id_stand_where_they_belong() {
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
fn fall_11_the_wall_clock_may_jump_ten_years_either_way() {
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
    // And over a restart, where the clock is read anew.
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
fn fall_12_a_packet_a_year_ahead_moves_nothing() {
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
fn fall_13_a_forgers_stamp_is_not_kept() {
    let (mut station, mut vehicle) = live_pair(Endpoint::Listen);
    let mut forger = Vehicle {
        key: other_key(),
        ..Vehicle::new(vehicle.stamp)
    };
    for n in 1..100 {
        let frame = forger.send_stamped(&heartbeat(), vehicle.stamp.plus(Duration::from_secs(n)));
        assert!(station.receive(at(10), STRANGER, &frame).is_empty());
    }
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
}

#[test]
fn fall_15_every_delivery_says_whether_it_was_verified() {
    let (mut station, mut vehicle) = live_pair(Endpoint::Listen);
    let got = station.receive(at(10), VEHICLE, &vehicle.heartbeat());
    assert!(got[0].verified && got[0].stamp.is_some());
    assert_eq!(station.link.state(), LinkState::Live);

    // With signing off even a signed frame is delivered as unverified: there is no key to tell.
    let mut open = Link::new(LinkConfig::new(1, Security::Off, Endpoint::Listen));
    let mut got = Vec::new();
    for frame in [vehicle.heartbeat(), vehicle.send_unsigned(&heartbeat())] {
        let auth = mavlink_link::link::Auth::Off;
        open.handle_datagram(at(10), VEHICLE, &frame, auth, &mut |d| {
            got.push(Got::of(&d))
        });
    }
    assert_eq!(got.len(), 2);
    assert!(got.iter().all(|got| !got.verified && got.stamp.is_none()));
}

#[test]
fn fall_16_the_key_is_not_shown_and_its_own_octets_are_wiped() {
    // Dropping does what `zeroize` does, and that leaves none of the octets. Copies that a move left elsewhere are not
    // reached by it: see "Not promised" in docs/security.md.
    fn wiped_on_drop<T: ZeroizeOnDrop>() {}
    wiped_on_drop::<SigningKey>();
    let mut wiped = key();
    wiped.zeroize();
    assert_eq!(wiped.expose(), &[0; 32]);

    let (mut station, mut vehicle) = live_pair(Endpoint::Listen);
    station.receive(at(10), VEHICLE, &vehicle.heartbeat());
    let shown = format!("{:?} {:#?} {:?}", key(), station.keys, station.link);
    assert!(shown.contains("SigningKey(..)"));
    let hex: String = key().expose().iter().map(|o| format!("{o:02x}")).collect();
    let list = format!("{:?}", key().expose());
    for secret in [&hex[..16], &list[..24], &list[list.len() - 24..]] {
        assert!(!shown.contains(secret), "{secret}");
    }
    // Nor does a text that is refused as a key.
    let error = SigningKey::from_hex("deadbeefcafe").unwrap_err();
    assert!(!format!("{error} {error:?}").contains("dead"));
}

/// A panic tells what it is about by `Debug`: a test harness, a log and standard error have it then.
#[test]
fn fall_16_a_panic_about_a_secret_does_not_tell_it() {
    use std::panic::{AssertUnwindSafe, catch_unwind};
    let mut random = |out: &mut [u8]| {
        out.fill(0x5a);
        Ok(())
    };
    let code = PairingCode::generate(&mut random).unwrap();
    let text = code.text().to_lowercase();
    let (station, _) = live_pair(Endpoint::Listen);
    fn told<T: std::fmt::Debug>(about: &'static str, secret: T) -> (&'static str, String) {
        let refuse = |secret| Err::<(), T>(secret);
        let panic = catch_unwind(AssertUnwindSafe(|| refuse(secret).unwrap())).unwrap_err();
        let text = panic.downcast_ref::<String>().unwrap();
        (about, text.to_lowercase())
    }
    for (about, told) in [
        told("SigningKey", key()),
        told("KeyState", station.keys),
        told("Identity", Identity::new([0x5a; 32])),
        told("PairingCode", code),
    ] {
        assert!(told.contains(&about.to_lowercase()), "{told}");
        let shown = |octets: &[u8]| {
            let hex: String = octets.iter().map(|o| format!("{o:02x}")).collect();
            let list = format!("{octets:?}");
            [hex, list[1..list.len() - 1].to_owned()]
        };
        let secrets = [shown(&key().expose()[..8]), shown(&[0x5a; 8])].concat();
        for secret in secrets.iter().map(String::as_str).chain([&text[..8]]) {
            assert!(!told.contains(secret), "{about}: {secret}");
        }
    }
}

#[test]
fn fall_17_what_reordering_loses_comes_through_by_a_retry() {
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
fn fall_18_a_pass_phrase_is_not_a_key() {
    assert_eq!(
        SigningKey::from_hex("correct horse battery staple").unwrap_err(),
        KeyError::Digit { offset: 1 }
    );
    assert_eq!(
        SigningKey::from_hex("decade").unwrap_err(),
        KeyError::Length { digits: 6 }
    );
}

#[test]
fn fall_19_nothing_from_before_a_restart_is_accepted_after_it() {
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
fn fall_20_a_recording_holds_neither_key_nor_anything_to_replay() {
    let (_, mut vehicle) = live_pair(Endpoint::Listen);
    let setup = MavMessage::SETUP_SIGNING(SETUP_SIGNING_DATA {
        initial_timestamp: 77,
        target_system: 1,
        target_component: 1,
        secret_key: *key().expose(),
    });
    let frames = [
        vehicle.heartbeat(),
        vehicle.send(&setup),
        vehicle.send_unsigned(&setup),
        vehicle.send(&ack()),
    ];
    for frame in &frames {
        let mut out = [0xee; MAX_RECORD];
        let view = FrameView::parse(frame).unwrap();
        let len = record(WALL, &view, &mut out);
        assert_eq!(
            out[..8],
            u64::try_from(WALL.as_micros()).unwrap().to_be_bytes()
        );

        let recorded = FrameView::parse(&out[8..len]).expect("a reader finds a right checksum");
        assert_eq!(recorded.as_bytes().len(), len - 8);
        assert!(!recorded.is_signed());
        let (was, is) = (view.header(), recorded.header());
        assert_eq!(
            (is.message_id, is.seq, is.incompat),
            (was.message_id, was.seq, 0)
        );
        if was.message_id == 256 {
            assert!(recorded.payload().iter().all(|&octet| octet == 0));
            assert!(
                !out[..len]
                    .windows(8)
                    .any(|w| key().expose().windows(8).any(|k| k == w))
            );
        } else {
            assert_eq!(recorded.payload(), view.payload());
        }
        // Played in at a signed receiver it gets nothing in.
        let mut station = Station::new(Endpoint::Listen, at(0));
        assert!(station.receive(at(1), VEHICLE, &out[8..len]).is_empty());
        assert_eq!(station.link.stats().unsigned_vehicle, 1);
        assert!(verify(&key(), &recorded).is_err());
    }
}

#[test]
fn fall_21_a_strangers_datagram_does_not_move_the_peer() {
    let (mut station, mut vehicle) = live_pair(Endpoint::Listen);
    let replay = vehicle.heartbeat();
    station.receive(at(10), VEHICLE, &replay);
    let mut forger = Vehicle {
        key: other_key(),
        ..Vehicle::new(vehicle.stamp)
    };
    for datagram in [
        replay,
        forger.heartbeat(),
        vehicle.send_unsigned(&heartbeat()),
        vec![0xfd],
        vec![],
    ] {
        assert!(station.receive(at(11), STRANGER, &datagram).is_empty());
        assert_eq!(station.link.peer(), Some(VEHICLE));
    }
    assert_eq!(station.send(at(12), &ack()).1.to, VEHICLE);
    // A start of a frame from elsewhere is not joined with the peer's octets.
    station.receive(at(13), STRANGER, &vehicle.heartbeat()[..11]);
    assert_eq!(
        station.receive(at(14), VEHICLE, &vehicle.heartbeat()).len(),
        1
    );
    // The vehicle on a new port proves itself and is followed.
    assert_eq!(
        station
            .receive(at(15), VEHICLE + 1, &vehicle.heartbeat())
            .len(),
        1
    );
    assert_eq!(station.link.peer(), Some(VEHICLE + 1));
}

#[test]
fn fall_22_our_own_frames_come_back_and_are_refused() {
    let (mut station, _) = live_pair(Endpoint::Listen);
    let (frame, _) = station.send(at(10), &ack());
    assert!(station.receive(at(11), VEHICLE, &frame).is_empty());
    assert_eq!(station.link.stats().reflected, 1);

    // Even where the vehicle was configured with our own system id.
    let config = LinkConfig::new(245, Security::Signed, Endpoint::Listen);
    let mut link: Link<Addr> = Link::new(config);
    let auth = Station::auth(&mut station.keys, &mut station.store);
    link.handle_datagram(at(11), VEHICLE, &frame, auth, &mut |_| {
        panic!("a reflection")
    });
    assert_eq!(link.stats().reflected, 1);
}

#[test]
fn fall_23_a_vehicle_that_lost_its_key_is_noticed() {
    let (mut station, mut vehicle) = live_pair(Endpoint::Listen);
    // Its heartbeats alone prove nothing: anyone can send those.
    station.receive(at(10), VEHICLE, &vehicle.send_unsigned(&heartbeat()));
    assert_eq!(station.link.poll_event(), None);
    assert!(
        station
            .receive(at(11), VEHICLE, &vehicle.send_unsigned(&ack()))
            .is_empty()
    );
    assert_eq!(
        station.link.poll_event(),
        Some(Event::Alert(Alert::VehicleUnsigned))
    );
    assert_eq!(station.link.stats().unsigned_vehicle, 2);
}

#[test]
fn fall_24_strangers_heartbeats_raise_no_alarm_and_pass_for_nobody() {
    let (mut station, vehicle) = live_pair(Endpoint::Listen);
    let accepted = station.link.accepted_at();
    for n in 0..200 {
        let mut stranger = Vehicle {
            system: 255,
            component: 190,
            key: other_key(),
            ..Vehicle::new(vehicle.stamp)
        };
        // As the recordings show: forwarded by the vehicle, from its address.
        assert!(
            station
                .receive(at(10 + n), VEHICLE, &stranger.heartbeat())
                .is_empty()
        );
        assert!(
            station
                .receive(at(10 + n), VEHICLE, &stranger.send_unsigned(&heartbeat()))
                .is_empty()
        );
    }
    assert_eq!(station.link.stats().unexpected_system, 400);
    assert_eq!(station.link.stats().bad_signature, 0);
    assert_eq!(station.link.poll_event(), None);
    assert_eq!(station.link.accepted_at(), accepted);
}

#[test]
fn fall_25_an_old_acknowledgement_confirms_no_new_command() {
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

#[test]
fn fall_26_the_vehicles_own_frame_is_not_taken_back_by_its_side_of_the_link() {
    let (mut station, mut vehicle) = live_pair(Endpoint::Listen);
    let frame = vehicle.send(&ack());
    // The vehicle itself would take its own frame: the key is right, and the stream is new to it.
    assert!(vehicle.receive(&frame));
    // An end of ours on its side does not, whoever brings the frame.
    let config = LinkConfig {
        own_system: 1,
        own_component: 191,
        ..LinkConfig::new(245, Security::Signed, Endpoint::Listen)
    };
    let mut air_side: Link<Addr> = Link::new(config);
    let auth = Station::auth(&mut station.keys, &mut station.store);
    air_side.handle_datagram(at(10), STRANGER, &frame, auth, &mut |_| {
        panic!("a reflection")
    });
    assert_eq!((air_side.stats().reflected, air_side.peer()), (1, None));
    // And our ground end never sends under the vehicle's id, so nobody can reflect through it.
    let (ours, _) = station.send(at(11), &ack());
    assert_eq!(FrameView::parse(&ours).unwrap().header().system_id, 245);
}

#[test]
fn fall_15_state_and_counters_say_whether_signing_is_on() {
    let (mut station, mut vehicle) = live_pair(Endpoint::Listen);
    assert_eq!(station.link.state(), LinkState::Live);
    let mut unsigned = Station::new(Endpoint::Listen, at(0));
    unsigned.receive(at(1), VEHICLE, &vehicle.send_unsigned(&ack()));
    assert_eq!(unsigned.link.state(), LinkState::Waiting);
    let stats = unsigned.link.stats();
    assert_eq!((stats.unsigned_vehicle, stats.delivered_verified), (1, 0));
    // A vehicle that restarts is seen to be behind until it is lifted.
    vehicle.restart();
    for n in 0..4 {
        station.receive(at(5_000 + n), VEHICLE, &vehicle.heartbeat());
    }
    assert_eq!(station.link.state(), LinkState::Behind);
}

#[test]
fn a_new_key_of_ours_begins_at_its_initial_stamp() {
    let mut store = MemoryStore::default();
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

/// The vehicle's other link was recorded since our last run, and we have just started: the recordings are played in
/// whenever the link could forget which one it is.
#[test]
fn fall_05_captures_of_another_link_neither_shut_the_vehicle_out_nor_keep_the_peer() {
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
            let heard = station
                .receive(at(now + k * 100 + 50), VEHICLE, &frame)
                .len();
            refused += usize::from(heard == 0);
        }
        assert_eq!(station.link.peer(), Some(VEHICLE));
    }
    // Only until the first heartbeat of ours has come back.
    assert!(refused <= 2, "{refused} of 3,900 refused");
    assert_eq!(station.link.learned_link_id(), Some(0));
}
