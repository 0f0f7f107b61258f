//! Keys: what is none, and where none is ever seen.

use mavlink_link::dialect::{MavMessage, SETUP_SIGNING_DATA};
use mavlink_link::exchange::{Identity, PairingCode};
use mavlink_link::frame::FrameView;
use mavlink_link::link::Endpoint;
use mavlink_link::signing::{KeyError, SigningKey, verify};
use mavlink_link::tlog::{MAX_RECORD, record};
use zeroize::{Zeroize as _, ZeroizeOnDrop};

use crate::support::{Station, VEHICLE, WALL, ack, at, key, live_pair};

#[test]
fn pitfall_16_the_key_is_not_shown_and_its_own_bytes_are_wiped() {
    // Dropping does what `zeroize` does, and that leaves none of the bytes. Copies that a move left elsewhere are not
    // reached by it: see "Not promised" in docs/guide/security.md.
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

/// A panic message contains `Debug` output, which ends up in a test harness, a log and on standard error.
#[test]
fn pitfall_16_a_panic_about_a_secret_does_not_tell_it() {
    use std::panic::{AssertUnwindSafe, catch_unwind};
    let mut random = |out: &mut [u8]| {
        out.fill(0x5a);
        Ok(())
    };
    let code = PairingCode::generate(&mut random).unwrap();
    let text = code.text().to_lowercase();
    let (station, _) = live_pair(Endpoint::Listen);
    fn shown<T: std::fmt::Debug>(about: &'static str, secret: T) -> (&'static str, String) {
        let refuse = |secret| Err::<(), T>(secret);
        let panic = catch_unwind(AssertUnwindSafe(|| refuse(secret).unwrap())).unwrap_err();
        let text = panic.downcast_ref::<String>().unwrap();
        (about, text.to_lowercase())
    }
    for (about, printed) in [
        shown("SigningKey", key()),
        shown("KeyState", station.keys),
        shown("Identity", Identity::new([0x5a; 32])),
        shown("PairingCode", code),
    ] {
        assert!(printed.contains(&about.to_lowercase()), "{printed}");
        let shown = |bytes: &[u8]| {
            let hex: String = bytes.iter().map(|o| format!("{o:02x}")).collect();
            let list = format!("{bytes:?}");
            [hex, list[1..list.len() - 1].to_owned()]
        };
        let secrets = [shown(&key().expose()[..8]), shown(&[0x5a; 8])].concat();
        for secret in secrets.iter().map(String::as_str).chain([&text[..8]]) {
            assert!(!printed.contains(secret), "{about}: {secret}");
        }
    }
}

#[test]
fn pitfall_18_a_pass_phrase_is_not_a_key() {
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
fn pitfall_20_a_recording_holds_neither_key_nor_anything_to_replay() {
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
            assert!(recorded.payload().iter().all(|&byte| byte == 0));
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
