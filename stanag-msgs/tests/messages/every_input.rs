//! Every input of wrapper and presence vectors up to a bound: every presence vector of one and two bytes, and of longer
//! ones all with few bits set or few cleared; every Message Length with every Message Properties word; every changed byte
//! of a message with a checksum. Nothing panics, what is taken encodes to the same bytes, and all else is refused.
//!
//! docs/guide/reliability.md has the bounds and the numbers of inputs.

use stanag_msgs::table::{MESSAGES, MessageInfo};
use stanag_msgs::wrapper::{MAX_DATA, MAX_DATAGRAM};
use stanag_msgs::{ChecksumStyle, DecodeError, Envelope, Header, Id, Message, frames};

use crate::round_trip::{data, known_presence, returns};

/// Decodes message data with this presence vector: whole, one byte short, and one byte too long.
fn is_judged(info: &MessageInfo, presence: u64, known: u64, pool: &[u8]) -> usize {
    let bytes = usize::from(info.presence_bytes);
    if presence & !known != 0 {
        // A present field of unknown length cannot be skipped either, since the next field's place is unknown.
        let mut wire = presence.to_be_bytes()[8 - bytes..].to_vec();
        wire.extend(&pool[..200]);
        let refused = Message::decode(info.id, &wire).unwrap_err();
        let beyond = presence >> info.fields.len() != 0;
        assert!(
            beyond == matches!(refused, DecodeError::UnknownPresence { .. }),
            "{} {presence:#x}: {refused}",
            info.name
        );
        return 1;
    }
    let mut wire = data(info, presence, pool);
    returns(info, &wire);
    wire.push(0);
    Message::decode(info.id, &wire).unwrap_err();
    wire.truncate(wire.len() - 2);
    Message::decode(info.id, &wire).unwrap_err();
    3
}

/// Every value of this many bits with at most `few` set.
fn sparse(bits: u32, few: u32) -> Vec<u64> {
    let mut all = vec![0_u64];
    let mut last = all.clone();
    for _ in 0..few {
        let higher = |value: &u64| (64 - value.leading_zeros())..bits;
        let next = last
            .iter()
            .flat_map(|value| higher(value).map(move |bit| value | 1 << bit));
        last = next.collect();
        all.extend(&last);
    }
    all
}

/// Presence vectors longer than two bytes: at most `few` set, or `few` of the known ones cleared.
fn every_presence(few: u32) -> usize {
    let pool: Vec<u8> = (0..1_000).map(|n| (n % 251) as u8).collect();
    let mut number = 0;
    for info in MESSAGES {
        let known = known_presence(info);
        let bits = 8 * u32::from(info.presence_bytes);
        if bits <= 16 {
            for presence in 0..1 << bits {
                number += is_judged(info, presence, known, &pool);
            }
            continue;
        }
        for some in sparse(bits, few) {
            number += is_judged(info, some, known, &pool);
            let cleared = known & !some;
            let room = data(info, cleared, &pool).len() < MAX_DATA;
            if some & !known == 0 && room {
                number += is_judged(info, cleared, known, &pool);
            }
        }
    }
    number
}

#[test]
fn every_presence_vector_is_read_as_it_was_written_or_refused() {
    let number = every_presence(2);
    assert!(number > 2_000_000, "{number}");
}

#[test]
#[ignore = "a minute in a release build"]
fn every_presence_vector_with_up_to_four_bits_is_read_or_refused() {
    every_presence(4);
}

#[test]
fn every_length_with_every_property_is_a_whole_message_or_refused() {
    let mut out = [0; MAX_DATAGRAM];
    let beat = Message::empty(16_002).expect("a heartbeat");
    let length = beat.encode(&ENVELOPE, &mut out).expect("it fits");
    let message = &out[..length];
    // Alone, and with two like it behind: a length may reach into them, but not beyond.
    let behind = [message; 3].concat();
    for length in 0..=u16::MAX {
        for style in 0..4 {
            for idd in [0, 29, 30, 31, 32, 33, 127] {
                for ack in [0, 0x80] {
                    let mut bytes = behind.clone();
                    bytes[2..4].copy_from_slice(&length.to_be_bytes());
                    bytes[14..16].copy_from_slice(&[ack | idd, style << 6]);
                    let mut end = 0;
                    for frame in frames(&bytes) {
                        let Ok(frame) = frame else { continue };
                        let start = frame.bytes.as_ptr() as usize - bytes.as_ptr() as usize;
                        assert!(start >= end, "two messages share bytes");
                        end = start + frame.bytes.len();
                        assert_eq!(bytes[start..end], *frame.bytes);
                        assert!(
                            (30..=32).contains(&frame.header.idd) && frame.data.len() <= MAX_DATA
                        );
                        let word = frame.header.properties().to_be_bytes();
                        assert_eq!(
                            word,
                            bytes[start + 14..start + 16],
                            "written as it was read"
                        );
                    }
                    assert!(end <= bytes.len());
                }
            }
        }
    }
}

#[test]
fn no_message_with_a_checksum_is_taken_with_a_changed_byte() {
    let mut number = 0;
    let mut out = [0; MAX_DATAGRAM];
    for info in MESSAGES {
        let message = Message::empty(info.id).expect("one of the table");
        for style in [
            ChecksumStyle::Sum16,
            ChecksumStyle::Sum32,
            ChecksumStyle::Crc32,
        ] {
            let envelope = ENVELOPE.summed(style);
            let Ok(length) = message.encode(&envelope, &mut out) else {
                continue;
            };
            let whole = out[..length].to_vec();
            for at in 0..length {
                // The checksum does not protect the bits that announce whether there is one.
                let style_bits = if at == 15 { 0xc0 } else { 0 };
                for change in (1..=255_u8).filter(|change| change & style_bits == 0) {
                    number += 1;
                    let mut changed = whole.clone();
                    changed[at] ^= change;
                    for frame in frames(&changed) {
                        assert!(frame.is_err(), "{} byte {at} ^ {change:#x}", info.name);
                    }
                }
            }
        }
    }
    assert!(number > 1_000_000, "{number}");
}

const ENVELOPE: Envelope = Envelope {
    idd: Header::IDD_ED4,
    ..Envelope::new(Id(0x1b00_00a0), Id(0x1b00_0001))
};
