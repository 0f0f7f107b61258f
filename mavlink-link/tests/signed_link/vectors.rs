//! pymavlink's signed frames verify here, and ours of the same message are the same bytes.

use mavlink_link::dialect::MavMessage;
use mavlink_link::frame::{FrameView, Header, INCOMPAT_SIGNED, MAX_FRAME, encode, encode_raw};
use mavlink_link::signing::{SigningKey, Stamp, VerifyError, sign, verify};

struct Vector {
    key: SigningKey,
    link_id: u8,
    stamp: Stamp,
    header: Header,
    frame: Vec<u8>,
}

fn vectors() -> Vec<Vector> {
    let text = include_str!("../data/pymavlink_vectors.txt");
    let vectors: Vec<_> = text.lines().map(vector).collect();
    assert_eq!(vectors.len(), 21);
    vectors
}

fn vector(line: &str) -> Vector {
    let fields: Vec<&str> = line.split(' ').collect();
    let [
        key,
        link_id,
        stamp,
        seq,
        system_id,
        component_id,
        message_id,
        frame,
    ] = fields[..]
    else {
        panic!("{line}")
    };
    Vector {
        key: SigningKey::from_hex(key).unwrap(),
        link_id: link_id.parse().unwrap(),
        stamp: Stamp::new(stamp.parse().unwrap()),
        header: Header {
            seq: seq.parse().unwrap(),
            system_id: system_id.parse().unwrap(),
            component_id: component_id.parse().unwrap(),
            message_id: message_id.parse().unwrap(),
            incompat: INCOMPAT_SIGNED,
            compat: 0,
        },
        frame: kit::process::from_hex(frame),
    }
}

#[test]
fn pymavlinks_frames_verify_under_their_key_and_no_other() {
    let other = SigningKey::new([0x77; 32]).unwrap();
    for vector in vectors() {
        let frame = FrameView::parse(&vector.frame).unwrap();
        assert_eq!(frame.header(), vector.header);
        let signature = frame.signature().unwrap();
        assert_eq!(
            (signature.link_id, signature.stamp),
            (vector.link_id, vector.stamp)
        );
        assert_eq!(verify(&vector.key, &frame), Ok(()));
        assert_eq!(verify(&other, &frame), Err(VerifyError::BadSignature));
    }
}

#[test]
fn our_frames_of_the_same_messages_are_the_same_bytes() {
    for vector in vectors() {
        let theirs = FrameView::parse(&vector.frame).unwrap();
        let message: MavMessage = theirs.message().unwrap();
        let mut out = [0xee; MAX_FRAME];
        let len = encode(&message, vector.header, &mut out);
        let len = sign(&vector.key, vector.link_id, vector.stamp, &mut out, len).unwrap();
        assert_eq!(out[..len], vector.frame);

        let mut out = [0xee; MAX_FRAME];
        let len = encode_raw(vector.header, theirs.payload(), &mut out).unwrap();
        let len = sign(&vector.key, vector.link_id, vector.stamp, &mut out, len).unwrap();
        assert_eq!(out[..len], vector.frame);
    }
}

#[test]
fn no_single_bit_can_be_changed_in_a_signed_frame() {
    for vector in vectors().into_iter().step_by(4) {
        for bit in 0..vector.frame.len() * 8 {
            let mut forged = vector.frame.clone();
            forged[bit / 8] ^= 1 << (bit % 8);
            let verified = FrameView::parse(&forged).is_ok_and(|f| {
                f.as_bytes().len() == forged.len() && verify(&vector.key, &f).is_ok()
            });
            assert!(!verified, "bit {bit}");
        }
    }
}
