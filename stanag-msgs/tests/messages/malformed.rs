//! Malformed message data: every kind of error, its place, and never a panic.

use proptest::prelude::*;
use stanag_msgs::DecodeError::{self, *};
use stanag_msgs::json::{decode_line, encode_line};
use stanag_msgs::messages::FileTransferNotification;
use stanag_msgs::scalar::UnsizedText;
use stanag_msgs::table::{self, FieldInfo, MESSAGES, MessageInfo};
use stanag_msgs::{EncodeError, Message, frames};

/// The field of a presence bit.
fn field(message_type: u16, bit: usize) -> &'static FieldInfo {
    &table::message(message_type).unwrap().fields[bit]
}

#[test]
fn every_error_gives_place_and_reason() {
    let cases: &[(u16, &[u8], DecodeError, &str)] = &[
        (
            2009,
            &[1],
            UnknownMessage { message_type: 2009 },
            "unknown message type 2009",
        ),
        (
            4000,
            &[0, 0],
            NoPresence {
                message_type: 4000,
                found: 2,
                expected: 3,
            },
            "message 4000: 2 bytes, expected a presence vector of 3",
        ),
        (
            16002,
            &[3, 0, 0, 0, 0, 0, 0],
            UnknownPresence {
                message_type: 16002,
                presence: 3,
                known: 1,
            },
            "message 16002: presence vector 0x3 has bits beyond 0x1",
        ),
        (
            4000,
            &[0, 0, 0x0C, 1, 2, 3, 4, 5, 6],
            Truncated {
                message_type: 4000,
                field: field(4000, 3),
                offset: 7,
                found: 2,
            },
            "message 4000 field 4 (Altitude) at offset 7: 2 bytes, expected 3",
        ),
        (
            17003,
            &[5, 0, 0, 0, 0, 0, 65],
            UnknownLength {
                message_type: 17003,
                field: field(17003, 2),
                offset: 6,
            },
            "message 17003 field 3 (File Name) at offset 6: its length is not known",
        ),
        (
            16002,
            &[1, 0, 0, 0, 0, 0, 9, 9],
            Trailing {
                message_type: 16002,
                offset: 6,
                found: 2,
            },
            "message 16002: 2 bytes left over at offset 6, expected none",
        ),
    ];
    for (message_type, data, error, text) in cases {
        assert_eq!(Message::decode(*message_type, data), Err(*error));
        assert_eq!(error.to_string(), *text);
        if let Some(info) = table::message(*message_type) {
            assert_eq!(table::walk(info, data).last().unwrap().err(), Some(*error));
        }
    }
}

/// Message data with every field of known length, all bytes zero.
fn full(info: &MessageInfo) -> Vec<u8> {
    let known = info
        .fields
        .iter()
        .filter(|field| field.wire.bytes().is_some());
    let (presence, length) = known.fold((0_u64, 0), |(bits, length), field| {
        (
            bits | 1 << field.bit,
            length + field.wire.bytes().unwrap_or(0),
        )
    });
    let start = 8 - usize::from(info.presence_bytes);
    let mut data = presence.to_be_bytes()[start..].to_vec();
    data.resize(data.len() + length, 0);
    data
}

#[test]
fn every_message_refuses_each_kind_of_malformed_data_with_its_place() {
    for info in MESSAGES {
        let id = info.id;
        let head = usize::from(info.presence_bytes);
        let whole = full(info);
        let error = |data: &[u8]| {
            let error = Message::decode(id, data).err();
            let walked = table::walk(info, data).find_map(Result::err);
            assert_eq!(error, walked, "{id}");
            error
        };
        assert_eq!(error(&whole), None, "{id} is valid");
        // Cut within the presence vector.
        for length in 0..head {
            let expected = NoPresence {
                message_type: id,
                found: length,
                expected: head,
            };
            assert_eq!(error(&whole[..length]), Some(expected));
        }
        // Cut within, and before, each field.
        let mut offset = head;
        for field in info.fields {
            let Some(bytes) = field.wire.bytes() else {
                continue;
            };
            for found in 0..bytes {
                let expected = Truncated {
                    message_type: id,
                    field,
                    offset,
                    found,
                };
                assert_eq!(error(&whole[..offset + found]), Some(expected));
            }
            offset += bytes;
        }
        // Bytes beyond the last field.
        for more in 1..=3 {
            let mut long = whole.clone();
            long.resize(whole.len() + more, 0xff);
            let expected = Trailing {
                message_type: id,
                offset: whole.len(),
                found: more,
            };
            assert_eq!(error(&long), Some(expected));
        }
        // Each presence bit that no field has.
        let known = (1_u64 << info.fields.len()) - 1;
        for bit in info.fields.len()..8 * head {
            let mut odd = whole.clone();
            odd[head - 1 - bit / 8] |= 1 << (bit % 8);
            let Some(UnknownPresence { known: of, .. }) = error(&odd) else {
                panic!("{id} accepts bit {bit}");
            };
            assert_eq!(of, known);
        }
        // A field whose length no source gives.
        for field in info
            .fields
            .iter()
            .filter(|field| field.wire.bytes().is_none())
        {
            let mut odd = vec![0; head];
            odd[head - 1 - usize::from(field.bit) / 8] |= 1 << (field.bit % 8);
            let expected = UnknownLength {
                message_type: id,
                field,
                offset: head,
            };
            assert_eq!(error(&odd), Some(expected));
        }
    }
}

#[test]
fn a_field_of_unknown_length_blocks_only_messages_that_carry_it() {
    let known = FileTransferNotification::decode(&[1, 0, 0, 0, 0, 7]).unwrap();
    assert_eq!(known.time_stamp.unwrap().0, 7);
    assert_eq!(known.file_name, None);
    let blocked = FileTransferNotification {
        file_name: Some(UnsizedText),
        ..known
    };
    let error = EncodeError::UnknownLength {
        message_type: 17003,
        field: field(17003, 2),
    };
    assert_eq!(blocked.encode_data(&mut [0; 64]), Err(error));
    assert_eq!(
        error.to_string(),
        "message 17003 field 3 (File Name): its length is not known"
    );
}

#[test]
fn an_empty_presence_vector_is_an_empty_message() {
    for info in MESSAGES {
        let data = vec![0; info.presence_bytes.into()];
        assert_eq!(
            Message::decode(info.id, &data).ok(),
            Message::empty(info.id),
            "{}",
            info.name
        );
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(4000))]

    #[test]
    fn any_bytes_give_an_answer(datagram in proptest::collection::vec(any::<u8>(), 0..80)) {
        for frame in frames(&datagram).flatten() {
            let _ = Message::decode(frame.header.message_type, frame.data);
        }
        for info in MESSAGES {
            let by_struct = Message::decode(info.id, &datagram).err();
            let by_table = table::walk(info, &datagram).find_map(Result::err);
            prop_assert_eq!(by_struct, by_table);
        }
        let hex: String = datagram.iter().map(|byte| format!("{byte:02x}")).collect();
        prop_assert_eq!(decode_line(&hex, true).is_empty(), hex.is_empty());
    }

    #[test]
    fn any_line_gives_an_answer(line in "\\PC{0,60}", raw: bool) {
        let _ = decode_line(&line, raw);
        let _ = encode_line(&line, raw);
    }
}
