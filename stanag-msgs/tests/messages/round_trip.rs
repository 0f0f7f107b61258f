//! Whatever is decoded is encoded to the same bytes, by the structs and through JSON.

use proptest::prelude::*;
use proptest::strategy::ValueTree;
use proptest::test_runner::TestRunner;
use stanag_msgs::json::{decode_line, encode_line};
use stanag_msgs::table::{MESSAGES, MessageInfo, Wire};
use stanag_msgs::wrapper::{self, MAX_DATA};
use stanag_msgs::{Envelope, Id, Message};

/// Messages with at most this many fields are tried with every presence vector.
const EXHAUSTIVE: usize = 12;
const RANDOM_CASES: u32 = 300;

/// Message data with these fields present, their bytes taken from `pool`.
pub(crate) fn data(info: &MessageInfo, presence: u64, pool: &[u8]) -> Vec<u8> {
    let start = 8 - usize::from(info.presence_bytes);
    let mut data = presence.to_be_bytes()[start..].to_vec();
    let mut pool = pool.iter().copied().cycle();
    for field in info
        .fields
        .iter()
        .filter(|field| presence >> field.bit & 1 == 1)
    {
        let bytes = field
            .wire
            .bytes()
            .expect("only fields of known length are present");
        let place = data.len();
        data.extend(pool.by_ref().take(bytes));
        if let Wire::Char(_) = field.wire {
            // A text is 7-bit characters, then NULs.
            let length = usize::from(data[place]) % bytes;
            data[place..place + length]
                .iter_mut()
                .for_each(|byte| *byte = (*byte & 0x7F).max(1));
            data[place + length..].fill(0);
        }
    }
    data
}

pub(crate) fn known_presence(info: &MessageInfo) -> u64 {
    let known = info
        .fields
        .iter()
        .filter(|field| field.wire.bytes().is_some());
    known.fold(0, |bits, field| bits | 1 << field.bit)
}

pub(crate) fn returns(info: &MessageInfo, data: &[u8]) {
    let message = Message::decode(info.id, data).unwrap();
    assert_eq!(message.id(), info.id);
    let mut out = [0; MAX_DATA];
    let length = message.encode_data(&mut out).unwrap();
    assert_eq!(&out[..length], data, "{}", info.name);
}

fn returns_through_json(info: &MessageInfo, data: &[u8]) {
    let mut out = [0; 548];
    let length = wrapper::encode(
        info.id,
        &Envelope::new(Id(1), Id::BROADCAST),
        &mut out,
        |out| {
            out[..data.len()].copy_from_slice(data);
            Ok(data.len())
        },
    );
    let wire: String = out[..length.unwrap()]
        .iter()
        .map(|byte| format!("{byte:02x}"))
        .collect();
    let [raw] = &decode_line(&wire, true)[..] else {
        panic!("one message")
    };
    assert_eq!(
        encode_line(&raw.to_string(), true),
        Ok(wire.clone()),
        "{raw}"
    );

    let [value] = &decode_line(&wire, false)[..] else {
        panic!("one message")
    };
    match encode_line(&value.to_string(), false) {
        Ok(back) => assert_eq!(back, wire, "{value}"),
        // Random bytes need not be in the ranges of the sources.
        Err(error) => assert!(
            info.fields
                .iter()
                .any(|field| field.range.is_some() && error.to_string().starts_with(field.name)),
            "{error}"
        ),
    }
}

#[test]
fn every_presence_vector_of_short_messages() {
    let strategy = proptest::collection::vec(any::<u8>(), 997);
    let mut runner = TestRunner::deterministic();
    for info in MESSAGES
        .iter()
        .filter(|info| info.fields.len() <= EXHAUSTIVE)
    {
        let pool = strategy.new_tree(&mut runner).unwrap().current();
        let known = known_presence(info);
        for presence in (0..1 << info.fields.len()).filter(|presence| presence & !known == 0) {
            returns(
                info,
                &data(info, presence, &pool[presence as usize % 400..]),
            );
        }
    }
}

#[test]
fn random_presence_vectors_of_all_messages() {
    for info in MESSAGES {
        let known = known_presence(info);
        let strategy = (any::<u64>(), proptest::collection::vec(any::<u8>(), 0..600));
        let config = ProptestConfig {
            cases: RANDOM_CASES,
            failure_persistence: None,
            ..Default::default()
        };
        TestRunner::new(config)
            .run(&strategy, |(presence, mut pool)| {
                pool.push(7);
                let data = data(info, presence & known, &pool);
                returns(info, &data);
                returns_through_json(info, &data);
                Ok(())
            })
            .unwrap();
    }
}
