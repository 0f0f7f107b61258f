//! Falls of signing with pymavlink at the other end: what it sends as an adversary who holds the wire, and sometimes the
//! key, and what it makes of ours. The falls are numbered as in `mavlink-link/tests/falls/`, which has them all.

use std::time::Duration;

use mavlink_link::dialect::{HEARTBEAT_DATA, MavMessage};
use mavlink_link::frame::MAX_FRAME;
use mavlink_link::link::{Auth, Endpoint, Link, LinkConfig, Security};
use mavlink_link::signing::Stamp;
use serde_json::json;

use kit::process::hex;

use super::pymavlink::{
    End, KEY, OTHER_KEY, peer_stamp, pymavlink_forges, pymavlink_verifies, unsigned,
};

/// 10 us units.
const SECOND: u64 = 100_000;
const YEAR: u64 = 366 * 86_400 * SECOND;

impl End {
    fn heartbeat(&mut self) -> Vec<u8> {
        let message = MavMessage::HEARTBEAT(HEARTBEAT_DATA::default());
        let mut out = [0; MAX_FRAME];
        let auth = Auth::Signed {
            key: &mut self.key,
            store: &mut self.store,
        };
        let sent = self.link.send(self.now, auth, &message, &mut out);
        let len = sent.expect("a frame").len;
        out[..len].to_vec()
    }
}

#[test]
fn pitfall_01_pymavlink_accepts_us_after_a_long_silence() {
    let mut ours = End::new(KEY);
    let before = ours.heartbeat();
    ours.now = ours.now.after(Duration::from_secs(300));
    let after = ours.heartbeat();
    // One that has just begun, five minutes on, lets in no stream older than a minute.
    let late = peer_stamp() + 300 * SECOND;
    let verdict = &pymavlink_verifies(KEY, Some(late), std::slice::from_ref(&after))[0];
    assert_eq!(verdict["accepted"], true, "{verdict}");
    let verdict = &pymavlink_verifies(KEY, Some(late), &[before])[0];
    assert_eq!(verdict["accepted"], false, "{verdict}");
}

#[test]
fn pitfall_02_pymavlink_takes_a_retry_but_no_bytes_twice() {
    let mut ours = End::new(KEY);
    let (first, retry) = (ours.heartbeat(), ours.heartbeat());
    let verdicts = pymavlink_verifies(KEY, None, &[first.clone(), first, retry]);
    let accepted: Vec<_> = verdicts
        .iter()
        .map(|verdict| verdict["accepted"] == true)
        .collect();
    assert_eq!(accepted, [true, false, true]);
}

#[test]
fn pitfall_04_no_frame_of_pymavlink_is_taken_out_of_its_order() {
    let stamp = peer_stamp();
    let frames = pymavlink_forges(
        KEY,
        &[
            json!({"message": "ack", "stamp": stamp}),
            json!({"message": "heartbeat", "stamp": stamp + 1}),
        ],
    );
    let mut ours = End::new(KEY);
    assert_eq!(ours.receive(&frames[1]), 1);
    assert_eq!(ours.receive(&frames[0]), 0, "10 us older");
    assert_eq!(ours.link.stats().stale, 1);
}

#[test]
fn pitfall_05_a_frame_of_pymavlink_is_taken_on_one_link_alone() {
    let frames = pymavlink_forges(
        KEY,
        &[
            json!({"message": "ack"}),
            json!({"message": "heartbeat", "link": 1, "stamp": peer_stamp() + 9}),
        ],
    );
    let mut ours = End::new(KEY);
    assert_eq!(ours.receive(&frames[0]), 1);
    let mut second = Link::new(LinkConfig::new(
        1,
        Security::Signed,
        Endpoint::Fixed(14_581_u16),
    ));
    let auth = Auth::Signed {
        key: &mut ours.key,
        store: &mut ours.store,
    };
    second.handle_datagram(ours.now, 14_581, &frames[0], auth, &mut |_| {
        panic!("delivered twice")
    });
    assert_eq!(second.stats().stale, 1);
    // A frame that names another link, and was perhaps lost there.
    assert_eq!(ours.receive(&frames[1]), 0);
    assert_eq!(ours.link.stats().unexpected_link, 1);
}

#[test]
fn pitfall_08_what_may_come_unsigned_may_not_come_badly_signed() {
    let frames = pymavlink_forges(
        KEY,
        &[
            json!({"message": "ack"}),
            json!({"message": "radio_status", "key": hex(&OTHER_KEY)}),
            json!({"message": "heartbeat", "key": hex(&OTHER_KEY)}),
        ],
    );
    let mut ours = End::new(KEY);
    assert_eq!(ours.receive(&frames[0]), 1, "the peer is known");
    assert_eq!(ours.receive(&frames[1]), 0);
    assert_eq!(ours.receive(&frames[2]), 0);
    assert_eq!(ours.link.stats().bad_signature, 2);
    assert_eq!(
        ours.receive_unsigned(&unsigned(&frames[1])),
        1,
        "RADIO_STATUS without a signature"
    );
    assert_eq!(
        ours.receive_unsigned(&unsigned(&frames[2])),
        0,
        "HEARTBEAT without a signature"
    );
}

#[test]
fn pitfall_10_a_stamp_of_another_epoch_or_unit_moves_nothing() {
    let stamp = peer_stamp();
    let since_1970 = stamp + 1_420_070_400 * SECOND;
    let frames = pymavlink_forges(
        KEY,
        &[
            json!({"message": "ack", "stamp": since_1970}),
            json!({"message": "ack", "stamp": stamp / 100}),
            json!({"message": "ack", "stamp": stamp / SECOND}),
            json!({"message": "ack", "stamp": (stamp * 10) & 0xffff_ffff_ffff}),
            json!({"message": "ack", "stamp": stamp}),
        ],
    );
    let mut ours = End::new(KEY);
    for frame in &frames[..4] {
        assert_eq!(ours.receive(frame), 0, "{}", hex(frame));
    }
    let stats = ours.link.stats();
    assert_eq!(stats.future + stats.stale, 4);
    assert_eq!(
        ours.receive(&frames[4]),
        1,
        "the honest one, after all of them"
    );
}

#[test]
fn pitfall_12_a_key_holder_a_year_ahead_drags_nothing_along() {
    let stamp = peer_stamp();
    let frames = pymavlink_forges(
        KEY,
        &[
            json!({"message": "heartbeat", "stamp": stamp + YEAR}),
            json!({"message": "heartbeat", "stamp": stamp + 7_200 * SECOND, "component": 7}),
            json!({"message": "ack", "stamp": stamp}),
        ],
    );
    let mut ours = End::new(KEY);
    assert_eq!((ours.receive(&frames[0]), ours.receive(&frames[1])), (0, 0));
    assert_eq!(ours.link.stats().future, 2);
    let sent = ours.heartbeat();
    let verdict = &pymavlink_verifies(KEY, None, &[sent])[0];
    assert_eq!(verdict["accepted"], true, "our own stamps stay: {verdict}");
    assert!(ours.key.clock().ceiling() < Stamp::new(stamp + YEAR));
    assert_eq!(ours.receive(&frames[2]), 1);
}

#[test]
fn pitfall_13_a_forger_with_a_high_stamp_deafens_nobody() {
    let stamp = peer_stamp();
    let frames = pymavlink_forges(
        KEY,
        &[
            json!({"message": "heartbeat", "stamp": stamp + 60 * SECOND, "key": hex(&OTHER_KEY)}),
            json!({"message": "ack", "stamp": stamp}),
        ],
    );
    let mut ours = End::new(KEY);
    assert_eq!(ours.receive(&frames[0]), 0);
    assert_eq!(ours.receive(&frames[1]), 1);
    assert_eq!(ours.link.stats().bad_signature, 1);
}

#[test]
fn pitfall_22_a_frame_in_our_own_name_is_refused_though_it_verifies() {
    let stamp = peer_stamp();
    let frames = pymavlink_forges(
        KEY,
        &[
            json!({"message": "ack", "system": 245, "component": 190, "stamp": stamp}),
            json!({"message": "ack", "system": 245, "component": 1, "stamp": stamp + 1}),
        ],
    );
    let mut ours = End::new(KEY);
    let own = ours.heartbeat();
    for frame in [&own, &frames[0], &frames[1]] {
        assert_eq!(ours.receive(frame), 0);
    }
    assert_eq!(ours.link.stats().reflected, 3);
}
