//! Decoding and encoding allocate nothing.

use std::hint::black_box;

use kit::heap::{Counting, allocations};
use stanag_msgs::table::MESSAGES;
use stanag_msgs::{ChecksumStyle, Envelope, Id, Message, Packer, Profile, frames};

#[global_allocator]
static ALLOCATOR: Counting = Counting;

#[test]
fn the_count_counts() {
    assert_eq!(allocations(|| drop(black_box(Box::new(1)))).0, 1);
}

#[test]
fn no_message_allocates() {
    let envelope = Envelope::new(Id(1), Id(2)).summed(ChecksumStyle::Crc32);
    let mut messages = Vec::new();
    for info in MESSAGES {
        let mut data = vec![0; info.full_bytes()];
        let start = 8 - usize::from(info.presence_bytes);
        let known = info
            .fields
            .iter()
            .filter(|field| field.wire.bytes().is_some());
        let presence = known.fold(0u64, |bits, field| bits | 1 << field.bit);
        data[..info.presence_bytes.into()].copy_from_slice(&presence.to_be_bytes()[start..]);
        messages.push(Message::decode(info.id, &data).unwrap());
    }
    let profile = Profile::default();
    let mut packer = Packer::new();
    let mut decoded = 0;
    let (count, ()) = allocations(|| {
        for message in &messages {
            let mut out = [0; 548];
            let length = profile.encode(message, &envelope, &mut out).unwrap();
            for frame in frames(&out[..length]) {
                let frame = frame.unwrap();
                let back = profile
                    .decode(frame.header.message_type, frame.data)
                    .unwrap();
                decoded += usize::from(back == *message);
            }
            let bad = &out[16..length - 5];
            black_box(Message::decode(message.id(), bad).is_err());
            packer
                .push(&envelope, message, |datagram| {
                    black_box(datagram.len());
                })
                .unwrap();
        }
    });
    assert_eq!((count, decoded), (0, MESSAGES.len()));
}
