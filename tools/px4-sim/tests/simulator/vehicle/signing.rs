//! Signing as the real PX4 does it: stamps that are not a clock, how a verified packet raises them, silent drops,
//! replays after a restart, and SETUP_SIGNING with all its pitfalls.

use std::time::Duration;

use crate::vehicle::support::heartbeat;
use mavlink::dialects::development as mav;
use mavlink::dialects::development::MavMessage;
use mavlink_link::frame::{FrameView, Header, INCOMPAT_SIGNED, MAX_FRAME, encode};
use mavlink_link::service::{Node, command};
use mavlink_link::signing::{SigningKey, Stamp, sign, verify};
use px4_sim::{Autopilot, Config, Signing};

const KEY: [u8; 32] = [7; 32];
/// A time in 2026.
const NOW: u64 = 37_517_586_000_000;

struct Bench {
    autopilot: Autopilot<u16>,
    sent: Vec<Vec<u8>>,
}

impl Bench {
    fn new(signing: Signing) -> Self {
        Self {
            autopilot: Autopilot::new(Config::default(), signing, vec![Some(14550)]),
            sent: Vec::new(),
        }
    }

    fn run(&mut self, seconds: f64) -> Vec<Vec<u8>> {
        self.sent.clear();
        for _ in 0..(seconds * 50.0) as u32 {
            self.autopilot.step(Duration::from_millis(20));
            let mut out = [0; MAX_FRAME];
            while let Some(t) = self.autopilot.poll_transmit(&mut out) {
                self.sent.push(out[..t.len].to_vec());
            }
        }
        self.sent.clone()
    }

    fn send(&mut self, bytes: &[u8]) {
        self.autopilot.handle_datagram(0, 14550, bytes);
    }

    fn acks(frames: &[Vec<u8>]) -> usize {
        let is_ack = |f: &&Vec<u8>| {
            matches!(
                FrameView::parse(f).unwrap().message(),
                Ok(MavMessage::COMMAND_ACK(_))
            )
        };
        frames.iter().filter(is_ack).count()
    }
}

fn frame(message: &MavMessage, system: u8, key: Option<(&SigningKey, u8, u64)>) -> Vec<u8> {
    let header = Header {
        system_id: system,
        component_id: 190,
        incompat: if key.is_some() { INCOMPAT_SIGNED } else { 0 },
        ..Default::default()
    };
    let mut out = [0; MAX_FRAME];
    let mut len = encode(message, header, &mut out);
    if let Some((key, link, stamp)) = key {
        len = sign(key, link, Stamp::new(stamp), &mut out, len).unwrap();
    }
    out[..len].to_vec()
}

fn ask() -> MavMessage {
    command::long(
        Node::new(1, 1),
        mav::MavCmd::MAV_CMD_REQUEST_MESSAGE,
        [148.0],
    )
}

fn setup(key: [u8; 32], initial_timestamp: u64) -> MavMessage {
    MavMessage::SETUP_SIGNING(mav::SETUP_SIGNING_DATA {
        initial_timestamp,
        target_system: 77,
        target_component: 9,
        secret_key: key,
    })
}

fn key() -> SigningKey {
    SigningKey::new(KEY).unwrap()
}

fn stamps(frames: &[Vec<u8>]) -> Vec<u64> {
    frames
        .iter()
        .map(|f| {
            FrameView::parse(f)
                .unwrap()
                .signature()
                .unwrap()
                .stamp
                .get()
        })
        .collect()
}

#[test]
fn its_stamps_count_packets_until_a_verified_packet_lifts_them() {
    let mut bench = Bench::new(Signing::with_key(key(), 0));
    let first = bench.run(3.0);
    assert!(
        first
            .iter()
            .all(|f| verify(&key(), &FrameView::parse(f).unwrap()).is_ok())
    );
    let counted: Vec<u64> = (0..first.len() as u64).collect();
    assert_eq!(stamps(&first), counted);
    assert_eq!(bench.autopilot.signing_clock(0), Some(first.len() as u64));

    // An unsigned heartbeat counts as a heartbeat, but raises no stamp; a signed one does.
    bench.send(&frame(&heartbeat(), 245, None));
    assert_eq!(bench.autopilot.signing_clock(0), Some(first.len() as u64));
    bench.send(&frame(&heartbeat(), 245, Some((&key(), 0, NOW))));
    assert_eq!(stamps(&bench.run(0.5))[0], NOW);

    // After a restart it is back at the value in the key file.
    bench.autopilot.restart();
    assert_eq!(stamps(&bench.run(3.0))[0], 0);
}

#[test]
fn what_is_not_well_signed_is_dropped_without_a_word() {
    let mut bench = Bench::new(Signing::with_key(key(), 0));
    bench.run(3.0);
    let wrong = SigningKey::new([8; 32]).unwrap();
    let good = frame(&ask(), 245, Some((&key(), 0, NOW)));
    let mut flipped = good.clone();
    flipped[20] ^= 1;
    bench.send(&frame(&ask(), 245, None));
    bench.send(&frame(&ask(), 245, Some((&wrong, 0, NOW))));
    bench.send(&flipped);
    assert_eq!(Bench::acks(&bench.run(1.0)), 0);
    bench.send(&good);
    assert_eq!(Bench::acks(&bench.run(1.0)), 1);
    bench.send(&good);
    bench.send(&frame(&ask(), 245, Some((&key(), 0, NOW - 1))));
    assert_eq!(Bench::acks(&bench.run(1.0)), 0);
    let counters = bench.autopilot.counters(0);
    assert_eq!(counters.dropped_unsigned, 1);
    assert_eq!(counters.dropped_bad_signature, 1);
    assert_eq!(counters.dropped_old_stamp, 2);
    assert_eq!(counters.not_frames, 1, "the flipped bit is a bad checksum");
    assert_eq!(counters.refused(), 4);
}

#[test]
fn a_badly_signed_heartbeat_still_counts_as_a_ground_station() {
    let mut bench = Bench::new(Signing::with_key(key(), 0));
    bench.run(3.0);
    let wrong = SigningKey::new([8; 32]).unwrap();
    bench.send(&frame(&heartbeat(), 245, Some((&wrong, 0, NOW))));
    let accepted = bench.run(0.5).iter().any(|f| {
        matches!(FrameView::parse(f).unwrap().message(), Ok(MavMessage::STATUSTEXT(t))
            if t.text.starts_with(b"GCS connection regained"))
    });
    assert!(accepted);
    assert_eq!(bench.autopilot.counters(0).badly_signed, 1);
}

#[test]
fn a_new_stream_may_be_a_minute_old_and_any_stamp_ahead() {
    let mut bench = Bench::new(Signing::with_key(key(), NOW));
    bench.run(3.0);
    let clock = bench.autopilot.signing_clock(0).unwrap();
    let verified = |b: &Bench| b.autopilot.counters(0).verified;
    bench.send(&frame(
        &heartbeat(),
        10,
        Some((&key(), 0, clock - 5_900_000)),
    ));
    assert_eq!(verified(&bench), 1);
    bench.send(&frame(
        &heartbeat(),
        11,
        Some((&key(), 0, clock - 6_200_000)),
    ));
    assert_eq!(
        (verified(&bench), bench.autopilot.counters(0).badly_signed),
        (1, 1)
    );
    bench.send(&frame(&ask(), 11, Some((&key(), 0, clock - 6_200_000))));
    assert_eq!(bench.autopilot.counters(0).dropped_old_stream, 1);
    // A stamp ten minutes ahead is accepted, and keeps out new streams with the right time.
    bench.send(&frame(&ask(), 12, Some((&key(), 0, clock + 60_000_000))));
    assert_eq!(verified(&bench), 2);
    bench.send(&frame(&ask(), 13, Some((&key(), 0, clock))));
    assert_eq!(bench.autopilot.counters(0).dropped_old_stream, 2);
}

#[test]
fn the_seventeenth_stream_is_refused_until_a_restart() {
    let mut bench = Bench::new(Signing::with_key(key(), 0));
    bench.run(3.0);
    for system in 100..117 {
        bench.send(&frame(&ask(), system, Some((&key(), 0, NOW))));
    }
    let counters = bench.autopilot.counters(0);
    assert_eq!(
        (counters.verified, counters.dropped_too_many_streams),
        (16, 1)
    );
    bench.autopilot.restart();
    bench.send(&frame(&ask(), 116, Some((&key(), 0, NOW))));
    assert_eq!(bench.autopilot.counters(0).verified, 17);
}

#[test]
fn a_recorded_command_is_accepted_again_after_a_restart() {
    let mut bench = Bench::new(Signing::with_key(key(), 0));
    bench.run(3.0);
    let recorded = frame(&ask(), 245, Some((&key(), 0, NOW)));
    bench.send(&recorded);
    bench.send(&recorded);
    assert_eq!(Bench::acks(&bench.run(0.5)), 1);
    bench.autopilot.restart();
    bench.run(3.0);
    bench.send(&recorded);
    assert_eq!(Bench::acks(&bench.run(0.5)), 1);
}

#[test]
fn the_first_key_is_accepted_from_anybody_and_later_ones_only_signed() {
    let mut bench = Bench::new(Signing::off());
    bench.run(6.0);
    assert!(!bench.autopilot.is_signing());
    // Addressed to another system and component, which PX4 does not check.
    bench.send(&frame(&setup(KEY, NOW), 245, None));
    let frames = bench.run(0.3);
    assert!(!frames.is_empty());
    assert!(
        frames
            .iter()
            .all(|f| verify(&key(), &FrameView::parse(f).unwrap()).is_ok()),
        "signed at once"
    );
    assert!(stamps(&frames)[0] >= NOW);
    let text = |frames: &[Vec<u8>], words: &[u8]| {
        frames.iter().any(|f| {
            matches!(FrameView::parse(f).unwrap().message(), Ok(MavMessage::STATUSTEXT(t)) if t.text.starts_with(words))
        })
    };
    assert!(text(&frames, b"MAVLink signing key accepted"));
    assert_eq!(Bench::acks(&frames), 0, "never a COMMAND_ACK");

    let second = SigningKey::new([9; 32]).unwrap();
    bench.send(&frame(&setup([9; 32], NOW), 245, None));
    bench.run(0.1);
    assert_eq!(bench.autopilot.counters(0).dropped_unsigned, 1);
    bench.send(&frame(
        &setup([9; 32], NOW),
        245,
        Some((&key(), 0, NOW + 1_000_000)),
    ));
    let frames = bench.run(0.3);
    assert!(
        frames
            .iter()
            .all(|f| verify(&second, &FrameView::parse(f).unwrap()).is_ok())
    );
    // Streams are kept when the key changes.
    bench.send(&frame(&ask(), 245, Some((&second, 0, NOW + 1_000_000))));
    assert_eq!(bench.autopilot.counters(0).dropped_old_stamp, 1);

    bench.send(&frame(
        &setup([0; 32], 0),
        245,
        Some((&second, 0, NOW + 2_000_000)),
    ));
    let frames = bench.run(0.3);
    assert!(text(&frames, b"MAVLink signing disabled"));
    assert!(
        frames
            .iter()
            .all(|f| !FrameView::parse(f).unwrap().is_signed())
    );
    // A zero key with a stamp counts as a key.
    bench.send(&frame(&setup([0; 32], 5), 245, None));
    bench.run(0.1);
    assert!(bench.autopilot.is_signing());
}

#[test]
fn a_key_is_refused_while_armed() {
    let mut bench = Bench::new(Signing::off());
    bench.run(6.0);
    let arm = command::long(
        Node::new(1, 1),
        mav::MavCmd::MAV_CMD_COMPONENT_ARM_DISARM,
        [1.0],
    );
    bench.send(&frame(&arm, 245, None));
    bench.run(0.1);
    assert!(bench.autopilot.vehicle().truth().armed);
    bench.send(&frame(&setup(KEY, NOW), 245, None));
    bench.run(0.3);
    assert!(!bench.autopilot.is_signing());
}

#[test]
fn the_first_sender_is_answered_for_life_and_others_are_obeyed() {
    let mut bench = Bench::new(Signing::off());
    bench.run(6.0);
    bench
        .autopilot
        .handle_datagram(0, 1, &frame(&heartbeat(), 245, None));
    bench
        .autopilot
        .handle_datagram(0, 2, &frame(&ask(), 200, None));
    bench.autopilot.step(Duration::from_millis(40));
    let mut out = [0; MAX_FRAME];
    let mut ack = false;
    while let Some(t) = bench.autopilot.poll_transmit(&mut out) {
        assert_eq!(t.to, 1);
        if let Ok(MavMessage::COMMAND_ACK(a)) = FrameView::parse(&out[..t.len]).unwrap().message() {
            assert_eq!(a.target_system, 200);
            ack = true;
        }
    }
    assert!(ack);
    assert_eq!(bench.autopilot.counters(0).from_strangers, 1);
}

#[test]
fn several_frames_a_datagram_and_one_over_two_are_read() {
    let mut bench = Bench::new(Signing::off());
    bench.run(6.0);
    let mut bytes = frame(&ask(), 245, None);
    bytes.extend_from_slice(&frame(&ask(), 245, None));
    bytes.extend_from_slice(b"\xfdgarbage");
    bench.send(&bytes);
    let third = frame(&ask(), 245, None);
    bench.send(&third[..15]);
    bench.send(&third[15..]);
    assert_eq!(Bench::acks(&bench.run(0.2)), 3);
}
