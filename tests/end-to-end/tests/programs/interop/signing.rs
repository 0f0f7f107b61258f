//! Frames signed here verify in pymavlink, and those signed by pymavlink verify here; each side refuses
//! the wrong key, the replayed and the unsigned.

use mavlink_link::frame::{FrameView, MAX_FRAME, SIGNATURE_LEN, encode};

use kit::process::hex;

use super::pymavlink::{End, KEY, OTHER_KEY, pymavlink_signs, pymavlink_verifies, unsigned};

#[test]
fn pymavlink_verifies_our_frames() {
    let mut ours = End::new(KEY);
    let frames = ours.frames();
    let verdicts = pymavlink_verifies(KEY, None, &frames);
    for (verdict, frame) in verdicts.iter().zip(&frames) {
        assert_eq!(verdict["accepted"], true, "{verdict} for {}", hex(frame));
    }
    let names: Vec<_> = verdicts
        .iter()
        .filter_map(|v| v["message"].as_str())
        .collect();
    assert_eq!(
        names,
        [
            "HEARTBEAT",
            "COMMAND_LONG",
            "MISSION_ITEM_INT",
            "STATUSTEXT"
        ]
    );
    assert_eq!(verdicts[1]["fields"]["param7"], 518.25);
    assert_eq!(verdicts[2]["fields"]["x"], 473_977_434);
    assert_eq!(verdicts[3]["fields"]["text"], "a text, with its end");
}

#[test]
fn pymavlink_refuses_the_wrong_key_the_replayed_and_the_unsigned() {
    let frames = End::new(KEY).frames();
    let verdicts = pymavlink_verifies(OTHER_KEY, None, &frames);
    assert!(verdicts.iter().all(|v| v["accepted"] == false));
    assert_eq!(verdicts.len(), frames.len());

    let twice: Vec<_> = frames.iter().chain(&frames).cloned().collect();
    let verdicts = pymavlink_verifies(KEY, None, &twice);
    let (first, again) = verdicts.split_at(frames.len());
    assert!(first.iter().all(|v| v["accepted"] == true), "{first:?}");
    assert!(again.iter().all(|v| v["accepted"] == false), "{again:?}");

    let bare: Vec<_> = frames.iter().map(|frame| unsigned(frame)).collect();
    let verdicts = pymavlink_verifies(KEY, None, &bare);
    assert!(
        verdicts.iter().all(|v| v["accepted"] == false),
        "{verdicts:?}"
    );
}

#[test]
fn we_verify_the_frames_of_pymavlink() {
    let frames = pymavlink_signs(KEY, 200);
    let mut ours = End::new(KEY);
    for frame in &frames {
        assert_eq!(ours.receive(frame), 1, "{}", hex(frame));
        // The frame was read as it was meant: packed again, it is the same bytes.
        let view = FrameView::parse(frame).expect("a frame");
        let message = view.message().expect("a message of the dialect");
        let mut out = [0; MAX_FRAME];
        let len = encode(&message, view.header(), &mut out);
        assert_eq!(hex(&out[..len]), hex(&frame[..frame.len() - SIGNATURE_LEN]));
    }
    let stats = ours.link.stats();
    assert_eq!(
        (stats.good_frames, stats.bad_crc, stats.delivered_verified),
        (200, 0, 200)
    );
}

#[test]
fn we_refuse_the_wrong_key_the_replayed_and_the_unsigned_of_pymavlink() {
    let frames = pymavlink_signs(KEY, 20);

    let mut strange = End::new(OTHER_KEY);
    assert!(frames.iter().all(|frame| strange.receive(frame) == 0));
    assert_eq!(strange.link.stats().bad_signature, 20);

    let mut ours = End::new(KEY);
    assert!(frames.iter().all(|frame| ours.receive(frame) == 1));
    assert!(frames.iter().all(|frame| ours.receive(frame) == 0));
    assert_eq!(ours.link.stats().stale, 20);

    let mut ours = End::new(KEY);
    assert!(
        frames
            .iter()
            .all(|frame| ours.receive(&unsigned(frame)) == 0)
    );
    assert_eq!(ours.link.stats().unsigned_vehicle, 20);

    // Any one bit of a signature counts.
    let mut ours = End::new(KEY);
    let mut bent = frames[0].clone();
    *bent.last_mut().expect("bytes") ^= 1;
    assert_eq!(ours.receive(&bent), 0);
    assert_eq!(ours.receive(&frames[0]), 1, "a forged frame deafens nobody");
}
