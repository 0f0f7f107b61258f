//! Datagrams: known bytes, several messages, and every way a wrapper can be wrong.

use stanag_msgs::messages::Heartbeat;
use stanag_msgs::wrapper::{Frame, MAX_DATAGRAM};
use stanag_msgs::{
    ChecksumStyle, EncodeError, Envelope, Header, Id, Message, Packer, TimeStamp, WrapperError,
    frames,
};

const BEAT: Heartbeat = Heartbeat {
    time_stamp: Some(TimeStamp(0x01_0203_0405)),
};
const ENVELOPE: Envelope = Envelope::new(Id(0x1b00_00a0), Id(0x1b00_0001));

fn encode(envelope: &Envelope) -> Vec<u8> {
    let mut out = [0xEE; MAX_DATAGRAM];
    let length = Message::from(BEAT).encode(envelope, &mut out).unwrap();
    out[..length].to_vec()
}

fn outcomes(datagram: &[u8]) -> Vec<Result<Frame<'_>, WrapperError>> {
    frames(datagram).collect()
}

#[test]
fn a_heartbeat_has_known_bytes() {
    let known = [
        0, 0, 0, 6, 0x1b, 0, 0, 0xa0, 0x1b, 0, 0, 1, 0x3E, 0x82, 0x20, 0, // header
        1, 1, 2, 3, 4, 5, // presence vector, time stamp
    ];
    assert_eq!(encode(&ENVELOPE), known);
    let frame = outcomes(&known)[0].unwrap();
    assert_eq!(frame.header, ENVELOPE.header(16002));
    assert_eq!(frame.data, &known[16..]);
    assert_eq!(
        Message::decode(16002, frame.data),
        Ok(Message::Heartbeat(BEAT))
    );
}

#[test]
fn property_words_are_the_known_ones() {
    for (envelope, word, bytes) in [
        (ENVELOPE, [0x20, 0x00], 22),
        (ENVELOPE.requesting_ack(), [0xA0, 0x00], 22),
        (ENVELOPE.summed(ChecksumStyle::Sum16), [0x20, 0x40], 24),
        (ENVELOPE.summed(ChecksumStyle::Sum32), [0x20, 0x80], 26),
        (ENVELOPE.summed(ChecksumStyle::Crc32), [0x20, 0xC0], 26),
        (
            Envelope {
                idd: Header::IDD_ED3,
                ..ENVELOPE
            },
            [0x1E, 0x00],
            22,
        ),
    ] {
        let wire = encode(&envelope);
        assert_eq!(wire[14..16], word);
        assert_eq!(wire.len(), bytes);
        assert_eq!(outcomes(&wire)[0].unwrap().header.envelope(), envelope);
    }
}

#[test]
fn edition_3_fills_the_first_word_and_receivers_ignore_it() {
    let mut wire = encode(&Envelope {
        idd: 30,
        ..ENVELOPE
    });
    assert_eq!(wire[..2], [0xFF, 0xFF]);
    wire[..2].copy_from_slice(&[0x12, 0x34]);
    // Nor do the reserved bits of the properties.
    wire[15] |= 0x3F;
    assert!(outcomes(&wire)[0].is_ok());
}

#[test]
fn a_bad_message_does_not_hide_the_next() {
    let summed = encode(&ENVELOPE.summed(ChecksumStyle::Crc32));
    for (byte, reason, offset) in [(20, "checksum", 26 + 22), (14, "idd", 26 + 14)] {
        let mut datagram = [&summed[..], &summed[..], &summed[..]].concat();
        datagram[26 + byte] ^= 0x40;
        let outcomes = outcomes(&datagram);
        assert_eq!(outcomes.len(), 3);
        assert!(outcomes[0].is_ok() && outcomes[2].is_ok());
        let error = outcomes[1].unwrap_err();
        assert_eq!((error.reason(), error.offset()), (reason, offset));
    }
}

#[test]
fn a_message_with_an_unknown_end_ends_the_datagram() {
    let beat = encode(&ENVELOPE);
    let with = |offset: usize, bytes: &[u8]| {
        let mut datagram = [&beat[..], &beat[..], &beat[..]].concat();
        datagram[22 + offset..][..bytes.len()].copy_from_slice(bytes);
        datagram
    };
    let long = vec![0; MAX_DATAGRAM + 1];
    let cases = [
        (
            with(2, &[0, 0]),
            WrapperError::Length {
                offset: 24,
                value: 0,
                expected: 528,
            },
            2,
        ),
        (
            with(2, &[2, 17]),
            WrapperError::Length {
                offset: 24,
                value: 529,
                expected: 528,
            },
            2,
        ),
        (
            with(2, &[0, 29]),
            WrapperError::Truncated {
                offset: 22,
                value: 44,
                expected: 45,
            },
            2,
        ),
        (
            with(14, &[0x1E, 0xC0])[..48].to_vec(),
            WrapperError::ChecksumStyle {
                offset: 37,
                value: 3,
                expected: 2,
            },
            2,
        ),
        (
            beat[..15].to_vec(),
            WrapperError::NoHeader {
                offset: 0,
                value: 15,
                expected: 16,
            },
            1,
        ),
        (
            beat[..21].to_vec(),
            WrapperError::Truncated {
                offset: 0,
                value: 21,
                expected: 22,
            },
            1,
        ),
        (
            with(0, &[])[..23].to_vec(),
            WrapperError::NoHeader {
                offset: 22,
                value: 1,
                expected: 16,
            },
            2,
        ),
        (
            Vec::new(),
            WrapperError::NoHeader {
                offset: 0,
                value: 0,
                expected: 16,
            },
            1,
        ),
        (
            long,
            WrapperError::Oversized {
                offset: 548,
                value: 549,
                expected: 548,
            },
            1,
        ),
    ];
    for (datagram, error, count) in cases {
        let outcomes = outcomes(&datagram);
        assert_eq!(outcomes.len(), count, "{error}");
        assert_eq!(outcomes.last(), Some(&Err(error)));
    }
}

#[test]
fn only_versions_30_to_32_are_accepted() {
    let mut wire = encode(&ENVELOPE);
    for idd in 0..=127 {
        wire[14] = idd;
        assert_eq!(
            outcomes(&wire)[0].is_ok(),
            (30..=32).contains(&idd),
            "{idd}"
        );
    }
}

#[test]
fn messages_that_cannot_be_written_are_refused() {
    let message = Message::from(BEAT);
    let full = encode(&ENVELOPE.summed(ChecksumStyle::Sum32)).len();
    for length in 0..full {
        let mut out = vec![0; length];
        let outcome = message.encode(&ENVELOPE.summed(ChecksumStyle::Sum32), &mut out);
        assert!(
            matches!(outcome, Err(EncodeError::BufferTooSmall { .. })),
            "{length}"
        );
    }
    let mut out = [0; 64];
    let mut refuse = |envelope| message.encode(&envelope, &mut out).unwrap_err();
    assert_eq!(
        refuse(Envelope {
            idd: 29,
            ..ENVELOPE
        }),
        EncodeError::Idd { idd: 29 }
    );
    let ed3 = Envelope {
        idd: 30,
        ..ENVELOPE
    }
    .summed(ChecksumStyle::Crc32);
    assert_eq!(refuse(ed3), EncodeError::ChecksumStyle { idd: 30 });
}

#[test]
fn packed_datagrams_are_full_and_lose_nothing() {
    let mut packer = Packer::new();
    let mut datagrams = Vec::new();
    for stamp in 0..100 {
        let beat = Message::from(Heartbeat {
            time_stamp: Some(TimeStamp(stamp)),
        });
        packer
            .push(&ENVELOPE, &beat, |datagram| {
                datagrams.push(datagram.to_vec())
            })
            .unwrap();
    }
    packer.flush(|datagram| datagrams.push(datagram.to_vec()));
    assert!(packer.is_empty());
    packer.flush(|_| panic!("nothing is left to send"));
    assert_eq!(
        datagrams.iter().map(Vec::len).collect::<Vec<_>>(),
        [528, 528, 528, 528, 88]
    );
    let stamps = datagrams
        .iter()
        .flat_map(|datagram| frames(datagram))
        .map(|frame| match Message::decode(16002, frame.unwrap().data) {
            Ok(Message::Heartbeat(beat)) => beat.time_stamp.unwrap().0,
            other => panic!("{other:?}"),
        });
    assert!(stamps.eq(0..100));
}
