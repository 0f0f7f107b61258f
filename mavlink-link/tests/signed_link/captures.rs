//! Every frame of the PX4 1.18 recordings is framed and checked, and the signed ones verify.

use std::collections::BTreeMap;

use mavlink_link::frame::{FrameError, Parser, Undecoded};
use mavlink_link::signing::{SigningKey, verify};

use kit::captures::read;

/// What a recording holds in one direction.
#[derive(Debug, Default, PartialEq, Eq)]
struct Census {
    frames: u32,
    /// Frames that the dialect's structs refuse, by message id and value.
    undecoded: BTreeMap<(u32, u64), u32>,
    unsigned: u32,
    /// Signed frames by the index of the key that verifies them; the last counts those of no key.
    signed: [u32; 5],
    mavlink1: u32,
}

fn census(name: &str, from_autopilot: bool) -> Census {
    let keys = keys();
    let mut census = Census::default();
    let mut parser = Parser::new();
    for datagram in read(name)
        .iter()
        .filter(|d| d.from_autopilot == from_autopilot)
    {
        let mut frames = parser.feed(&datagram.bytes);
        while let Some(item) = frames.next() {
            let frame = match item {
                Ok(frame) => frame,
                Err(FrameError::Mavlink1 { .. }) => {
                    census.mavlink1 += 1;
                    continue;
                }
                Err(error) => panic!("{name}: {error}"),
            };
            assert!(frame.is_checked());
            census.frames += 1;
            match frame.message() {
                Ok(_) => {}
                Err(Undecoded::UnknownValue { value, .. }) => {
                    *census
                        .undecoded
                        .entry((frame.header().message_id, value))
                        .or_default() += 1;
                }
                Err(error) => panic!("{name}: {error}"),
            }
            if frame.is_signed() {
                let key = keys.iter().position(|key| verify(key, &frame).is_ok());
                census.signed[key.unwrap_or(4)] += 1;
            } else {
                census.unsigned += 1;
            }
        }
    }
    assert_eq!(parser.pending(), 0, "{name} ends inside a frame");
    assert_eq!(
        parser.counts().garbage_bytes,
        0,
        "{name} holds bytes outside frames"
    );
    census
}

/// The keys of recordings 04 and 05: K1, K2, the all-zero key PX4 was talked into, and that of 05.
fn keys() -> [SigningKey; 4] {
    [
        SigningKey::new(core::array::from_fn(|i| i as u8 + 1)).unwrap(),
        SigningKey::new([0xa5; 32]).unwrap(),
        SigningKey::new_allowing_zero([0; 32]),
        SigningKey::new(core::array::from_fn(|i| i as u8 + 0x64)).unwrap(),
    ]
}

#[test]
fn every_frame_of_px4_is_framed_checked_and_counted() {
    // (recording, frames from PX4, frames to it, what the dialect refuses of each)
    type Refused = &'static [((u32, u64), u32)];
    let expected: [(&str, u32, u32, Refused, Refused); 8] = [
        ("01-boot-heartbeats", 11_574, 25, &[], &[]),
        (
            "02-params-mission-upload",
            16_374,
            1_773,
            &[((47, 77), 1), ((77, 31_999), 1)],
            &[((44, 77), 1), ((76, 31_999), 1)],
        ),
        ("03-arm-takeoff-mission-landa", 33_212, 328, &[], &[]),
        (
            "03-arm-takeoff-mission-landb",
            15_988,
            47,
            &[((76, 0), 4)],
            &[],
        ),
        ("04-signing-gcs-linka", 27_705, 94, &[], &[]),
        ("04-signing-gcs-linkb", 9_781, 34, &[], &[]),
        ("05-signing-restart-replay", 6_732, 48, &[], &[]),
        ("06-reupload-failsafe", 4_065, 206, &[], &[]),
    ];
    for (name, from_px4, to_px4, refused_from, refused_to) in expected {
        let (from, to) = (census(name, true), census(name, false));
        assert_eq!((from.frames, to.frames), (from_px4, to_px4), "{name}");
        assert_eq!(
            from.undecoded,
            refused_from.iter().copied().collect(),
            "{name} from PX4"
        );
        assert_eq!(
            to.undecoded,
            refused_to.iter().copied().collect(),
            "{name} to PX4"
        );
        // The one MAVLink 1 frame was sent at PX4 to see that it is ignored.
        assert_eq!(
            (from.mavlink1, to.mavlink1),
            (0, u32::from(name.ends_with("linka"))),
            "{name}"
        );
    }
}

#[test]
fn every_signed_frame_of_px4_verifies_under_the_key_of_its_time() {
    let signed = |name| {
        let census = census(name, true);
        (census.unsigned, census.signed)
    };
    // One signed frame came through PX4 from a component that had guessed a key: it verifies under none.
    assert_eq!(
        signed("04-signing-gcs-linka"),
        (3_219, [16_842, 7_643, 0, 0, 1])
    );
    assert_eq!(
        signed("04-signing-gcs-linkb"),
        (1_949, [0, 6_824, 1_008, 0, 0])
    );
    assert_eq!(
        signed("05-signing-restart-replay"),
        (1_976, [0, 0, 0, 4_756, 0])
    );
}

#[test]
fn every_signed_frame_to_px4_verifies_or_was_forged_for_the_occasion() {
    let signed = |name| {
        let census = census(name, false);
        (census.unsigned, census.signed)
    };
    assert_eq!(signed("04-signing-gcs-linka"), (39, [17, 37, 0, 0, 1]));
    assert_eq!(signed("04-signing-gcs-linkb"), (8, [0, 23, 3, 0, 0]));
    assert_eq!(signed("05-signing-restart-replay"), (20, [0, 0, 0, 28, 0]));
}
