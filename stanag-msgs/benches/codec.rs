//! The time to read and to write a message, without and with its wrapper.

#![allow(missing_docs, reason = "a bench has no callers")]

use std::hint::black_box;
use std::time::Duration;

use criterion::{Criterion, criterion_group, criterion_main};
use stanag_msgs::table::message;
use stanag_msgs::{ChecksumStyle, Envelope, Id, Message, frames};

/// A message with every field present.
fn full(id: u16) -> Message {
    let info = message(id).unwrap();
    let mut data: Vec<u8> = (0..info.full_bytes()).map(|index| index as u8).collect();
    let presence = (1u64 << info.fields.len()) - 1;
    let start = 8 - usize::from(info.presence_bytes);
    data[..info.presence_bytes.into()].copy_from_slice(&presence.to_be_bytes()[start..]);
    Message::decode(id, &data).unwrap()
}

fn codec(criterion: &mut Criterion) {
    for id in [4000, 13002, 3001] {
        let message = full(id);
        let mut out = [0; 548];
        let length = message.encode_data(&mut out).unwrap();
        let data = out[..length].to_vec();
        criterion.bench_function(&format!("decode {id}"), |bench| {
            // By reference: a value passed to black_box would add a copy of 520 bytes to the time.
            bench.iter(|| {
                black_box(&Message::decode(black_box(id), black_box(&data)));
            });
        });
        criterion.bench_function(&format!("encode {id}"), |bench| {
            bench.iter(|| black_box(&message).encode_data(black_box(&mut out)));
        });
    }
    let message = full(4000);
    for (name, style) in [
        ("none", ChecksumStyle::None),
        ("sum16", ChecksumStyle::Sum16),
        ("sum32", ChecksumStyle::Sum32),
        ("crc32", ChecksumStyle::Crc32),
    ] {
        let envelope = Envelope::new(Id(1), Id(2)).summed(style);
        let mut out = [0; 548];
        let length = message.encode(&envelope, &mut out).unwrap();
        let datagram = out[..length].to_vec();
        criterion.bench_function(&format!("unwrap and decode 4000, {name}"), |bench| {
            bench.iter(|| {
                let frame = frames(black_box(&datagram)).next().unwrap().unwrap();
                black_box(&Message::decode(frame.header.message_type, frame.data));
            });
        });
        criterion.bench_function(&format!("encode and wrap 4000, {name}"), |bench| {
            bench.iter(|| black_box(&message).encode(&envelope, black_box(&mut out)));
        });
    }
}

criterion_group! {
    name = benches;
    config = Criterion::default().warm_up_time(Duration::from_millis(300))
        .measurement_time(Duration::from_millis(900));
    targets = codec
}
criterion_main!(benches);
