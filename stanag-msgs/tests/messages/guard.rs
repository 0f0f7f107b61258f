//! The guard's trailer against an independent implementation, and against everything that is not the sender's.

use std::io::Read as _;

use proptest::prelude::*;
use serde_json::Value;
use stanag_msgs::guard::{
    Direction, GuardKey, Guarded, MAX_GUARDED, Opening, SealedText, TRAILER_BYTES, Trailer,
};
use stanag_msgs::{Id, MAX_DATAGRAM};

const CUCS: Id = Id(0x1b00_00a0);
const VSM: Id = Id(0x1b00_0001);

fn seal(key: &GuardKey, trailer: &Trailer, receiver: Id, datagram: &[u8]) -> Vec<u8> {
    let mut out = [0; MAX_GUARDED];
    let length = key.seal(trailer, receiver, datagram, &mut out).unwrap();
    out[..length].to_vec()
}

fn from_cucs(key: &GuardKey, stamp_us: u64) -> Trailer {
    Trailer {
        direction: Direction::ToVsm,
        sender: CUCS,
        key_id: key.id(),
        stamp_us,
    }
}

fn bytes(hex: &Value) -> Vec<u8> {
    let digits = hex.as_str().unwrap().as_bytes().chunks_exact(2);
    let byte = |pair| u8::from_str_radix(core::str::from_utf8(pair).unwrap(), 16).unwrap();
    digits.map(byte).collect()
}

#[test]
fn every_vector_of_the_reference_agrees_both_ways() {
    let path = concat!(
        env!("CARGO_MANIFEST_DIR"),
        "/../tests/data/dli/vectors-guard-4586.jsonl.gz"
    );
    let mut text = String::new();
    let file = std::fs::File::open(path).unwrap();
    let mut packed = flate2::read::GzDecoder::new(file);
    packed.read_to_string(&mut text).unwrap();
    assert_eq!(text.lines().count(), 24);
    for line in text.lines() {
        let value: Value = serde_json::from_str(line).unwrap();
        let id = |name: &str| Id(value[name].as_u64().unwrap().try_into().unwrap());
        let key = GuardKey::new(&bytes(&value["key"]).try_into().unwrap());
        let direction = match value["direction"].as_str() {
            Some("c2v") => Direction::ToVsm,
            _ => Direction::ToCucs,
        };
        let (datagram, sealed) = (bytes(&value["datagram"]), bytes(&value["sealed"]));
        let trailer = Trailer {
            direction,
            sender: id("sender"),
            key_id: key.id(),
            stamp_us: value["stamp_us"].as_u64().unwrap(),
        };
        let receiver = id("receiver");
        assert_eq!(seal(&key, &trailer, receiver, &datagram), sealed, "{line}");
        let guarded = Guarded::parse(&sealed).unwrap();
        assert_eq!((guarded.trailer, guarded.datagram), (trailer, &*datagram));
        assert!(key.verifies(&guarded, receiver), "{line}");
    }
}

#[test]
fn nothing_but_what_was_sealed_verifies() {
    let key = GuardKey::new(&[1; 32]);
    let sealed = seal(&key, &from_cucs(&key, 5), VSM, b"a datagram");
    let refuses =
        |bytes: &[u8]| Guarded::parse(bytes).is_none_or(|guarded| !key.verifies(&guarded, VSM));
    assert!(!refuses(&sealed));
    // Every bit, every truncation at either end, and bytes before and after.
    for bit in 0..sealed.len() * 8 {
        let mut other = sealed.clone();
        other[bit / 8] ^= 1 << (bit % 8);
        assert!(refuses(&other), "bit {bit}");
    }
    for cut in 1..=sealed.len() {
        assert!(refuses(&sealed[cut..]), "{cut} bytes less at the start");
        assert!(refuses(&sealed[..sealed.len() - cut]), "{cut} at the end");
    }
    assert!(refuses(&[b"x", &*sealed].concat()));
    assert!(refuses(&[&*sealed, b"x"].concat()));
    // The trailer of one datagram behind another, and two trailers.
    let other = seal(&key, &from_cucs(&key, 6), VSM, b"b datagram");
    let tail = |sealed: &[u8]| sealed[sealed.len() - TRAILER_BYTES..].to_vec();
    assert!(refuses(&[b"a datagram".to_vec(), tail(&other)].concat()));
    assert!(refuses(&[&*sealed, &*tail(&sealed)].concat()));
}

#[test]
fn a_key_is_of_one_receiver_one_direction_and_its_holders() {
    let (key, other) = (GuardKey::new(&[1; 32]), GuardKey::new(&[2; 32]));
    let sealed = seal(&key, &from_cucs(&key, 5), VSM, b"x");
    let guarded = Guarded::parse(&sealed).unwrap();
    assert!(key.verifies(&guarded, VSM));
    assert!(!key.verifies(&guarded, Id(VSM.0 + 1)), "another VSM");
    assert!(!other.verifies(&guarded, VSM), "another key");
    // Sent back, as if by the VSM: the MAC covers the direction, and each direction has a key of its own.
    let mut back = sealed.clone();
    back[1 + 3] = 2;
    let back = Guarded::parse(&back).unwrap();
    assert_eq!(back.trailer.direction, Direction::ToCucs);
    assert!(!key.verifies(&back, VSM) && !key.verifies(&back, CUCS));
    // Another CUCS's key that happens to have the same id.
    let mut named = from_cucs(&other, 5);
    named.key_id = key.id();
    let named = seal(&other, &named, VSM, b"x");
    assert!(!key.verifies(&Guarded::parse(&named).unwrap(), VSM));
}

#[test]
fn what_is_inside_keeps_the_limit_of_the_standard() {
    let key = GuardKey::new(&[1; 32]);
    let trailer = from_cucs(&key, 1);
    let longest = [7; MAX_DATAGRAM];
    assert_eq!(seal(&key, &trailer, VSM, &longest).len(), MAX_GUARDED);
    let mut out = [0; MAX_GUARDED + 1];
    let fault = key.seal(&trailer, VSM, &[7; MAX_DATAGRAM + 1], &mut out);
    assert!(fault.is_err_and(|fault| fault.to_string().contains("549 bytes")));
    key.seal(&trailer, VSM, b"x", &mut [0; TRAILER_BYTES])
        .unwrap_err();
    let long = [&[0; 1][..], &seal(&key, &trailer, VSM, &longest)].concat();
    assert_eq!(Guarded::parse(&long), None);
}

#[test]
fn a_key_shows_nothing_of_itself() {
    let key = GuardKey::new(&[0xab; 32]);
    let shown = format!("{key:?}");
    assert_eq!(shown, format!("GuardKey({:04x})", key.id()));
}

proptest! {
    #[test]
    fn what_is_sealed_is_read_back_and_verifies(
        key: [u8; 32],
        to_vsm: bool,
        sender: u32,
        receiver: u32,
        stamp_us: u64,
        datagram in proptest::collection::vec(any::<u8>(), 0..=MAX_DATAGRAM),
    ) {
        let key = GuardKey::new(&key);
        let direction = if to_vsm { Direction::ToVsm } else { Direction::ToCucs };
        let trailer = Trailer { direction, sender: Id(sender), key_id: key.id(), stamp_us };
        let sealed = seal(&key, &trailer, Id(receiver), &datagram);
        let guarded = Guarded::parse(&sealed).unwrap();
        prop_assert_eq!((guarded.trailer, guarded.datagram), (trailer, &*datagram));
        prop_assert!(key.verifies(&guarded, Id(receiver)));
    }

    #[test]
    fn any_bytes_are_read_or_not(bytes in proptest::collection::vec(any::<u8>(), 0..=640)) {
        if let Some(guarded) = Guarded::parse(&bytes) {
            prop_assert!(!GuardKey::new(&[1; 32]).verifies(&guarded, VSM));
        }
    }
}

#[test]
fn frames_of_a_connection_agree_with_the_reference_and_with_no_other_opening() {
    // With the HMAC and HKDF of tests/data/dli/reference_guard.py.
    let key = GuardKey::new(&core::array::from_fn(|place| place as u8));
    let opening = Opening {
        vsm: VSM,
        cucs: Id(0x1b00_00b0),
        of_vsm: [3; 32],
        of_client: [4; 32],
    };
    let connection = key.connection(&opening);
    let frames = [
        (
            Direction::ToVsm,
            "1a0c9a02dfe3974d492f35f1bfec835a41cc4d5d3992f916c104ce31969c4566 {\"n\":0}",
        ),
        (
            Direction::ToCucs,
            "0c83ca1591ac838047e0cd7c31f0c74f5f0da507b96e31dd0d2723d0d34b21d3 \
             {\"n\":1,\"error\":{\"of\":1,\"why\":\"\u{fc}\"}}",
        ),
    ];
    let others = [
        Opening {
            vsm: CUCS,
            ..opening
        },
        Opening {
            cucs: CUCS,
            ..opening
        },
        Opening {
            of_vsm: [5; 32],
            ..opening
        },
        Opening {
            of_client: [5; 32],
            ..opening
        },
    ];
    for (direction, frame) in frames {
        let sealed = SealedText::parse(frame).expect("a frame");
        assert!(connection.verifies(direction, &sealed));
        let back = direction.back().expect("a connection has two ends");
        assert!(!connection.verifies(back, &sealed));
        assert_eq!(connection.seal(direction, sealed.text), frame);
        for other in &others {
            assert!(
                !key.connection(other).verifies(direction, &sealed),
                "{other:?}"
            );
        }
        let other_key = GuardKey::new(&[9; 32]).connection(&opening);
        assert!(!other_key.verifies(direction, &sealed));
    }
    for broken in [
        "",
        "00 {}",
        "\u{fc}",
        &frames[0].1.to_uppercase(),
        &frames[0].1.replace(' ', ""),
    ] {
        assert_eq!(SealedText::parse(broken), None, "{broken}");
    }
    assert_eq!(
        format!("{connection:?}"),
        "ConnectionKey",
        "it shows nothing"
    );
}
