//! Every input of the frame parser up to a bound: every header, every cut of a stream, every change of a byte or of two
//! bits, every short string of the bytes that mean something to it. A frame that is found encodes to the same bytes, one
//! that was changed is never believed, and nothing delays the good frame behind it for good.
//!
//! docs/guide/reliability.md has the bounds and the numbers of inputs. Larger bounds:
//! `cargo test --release -p mavlink-link --test signed_link every_frame -- --ignored`.

use kit::attacks;
use mavlink_link::frame::{
    FrameView, Header, INCOMPAT_SIGNED, KEY_EXCHANGE_ID, MAX_FRAME, Parser, STX, STX_V1, checksum,
    crc_extra, encode_raw,
};
use mavlink_link::signing::{Stamp, verify};

use crate::support::{Vehicle, heartbeat, key};

/// What a parser returns of these bytes, as (bytes, checked).
fn found(parser: &mut Parser, bytes: &[u8]) -> Vec<(Vec<u8>, bool)> {
    let mut found = Vec::new();
    let mut frames = parser.feed(bytes);
    while let Some(frame) = frames.next() {
        if let Ok(view) = frame {
            found.push((view.as_bytes().to_vec(), view.is_checked()));
        }
    }
    assert!(parser.pending() <= MAX_FRAME);
    found
}

/// A good frame that ends whatever came before.
fn good() -> Vec<u8> {
    Vehicle::new(Stamp::new(7)).send_unsigned(&heartbeat())
}

/// The good frame is found behind whatever the parser was fed with: at once, as the next datagram, or after the silence.
fn good_comes_through(parser: &mut Parser, good: &[u8], before: &dyn core::fmt::Debug) {
    let mut all = found(parser, good);
    if !all.iter().any(|(bytes, _)| bytes == good) {
        parser.expire_pending();
        all = found(parser, &[]);
    }
    assert!(all.iter().any(|(bytes, _)| bytes == good), "{before:?}");
}

/// A frame with this header and payload, the checksum right where the message is known, signed by nobody.
fn frame(length: u8, incompat: u8, message_id: u32, fill: u8) -> Vec<u8> {
    let id = message_id.to_le_bytes();
    let mut bytes = vec![STX, length, incompat, 0, 9, 1, 1, id[0], id[1], id[2]];
    bytes.resize(bytes.len() + usize::from(length), fill);
    let sum = checksum(&bytes[1..], crc_extra(message_id).unwrap_or(0));
    bytes.extend(sum.to_le_bytes());
    if incompat & INCOMPAT_SIGNED != 0 {
        bytes.extend([fill; 13]);
    }
    bytes
}

#[test]
fn of_every_header_what_is_found_encodes_to_the_same_bytes() {
    let good = good();
    // HEARTBEAT, PARAM_VALUE, KEY_EXCHANGE, SETUP_SIGNING, and one of no dialect.
    let mut number = 0;
    for message_id in [0, 22, 256, KEY_EXCHANGE_ID, 0x00ab_cdef] {
        for length in 0..=255 {
            for incompat in 0..=255 {
                number += 1;
                let bytes = frame(length, incompat, message_id, 0x55);
                let mut parser = Parser::new();
                let all = found(&mut parser, &[&bytes[..], &good].concat());
                let (last, before) = all.split_last().expect("the good frame");
                assert_eq!(last.0, good, "{length} {incompat} {message_id}");
                let known = crc_extra(message_id).is_some();
                let taken = incompat <= INCOMPAT_SIGNED && (known || incompat == INCOMPAT_SIGNED);
                assert_eq!(before.len(), usize::from(taken), "{length} {incompat}");
                let Some((found, checked)) = before.first() else {
                    continue;
                };
                assert_eq!((found, *checked), (&bytes, known));
                let view = FrameView::parse(found).expect("it was found");
                let mut again = [0; MAX_FRAME];
                if known {
                    let header: Header = view.header();
                    let length = encode_raw(header, view.payload(), &mut again).expect("known");
                    assert_eq!(again[..length], found[..length]);
                }
            }
        }
    }
    assert_eq!(number, 5 * 256 * 256);
}

#[test]
fn cut_in_three_anywhere_a_stream_gives_the_same_frames() {
    let mut vehicle = Vehicle::new(Stamp::new(1));
    let parts = [
        vehicle.heartbeat(),
        frame(40, 0, 22, STX),
        vehicle.send_unsigned(&heartbeat()),
        frame(30, 1, 0x00ab_cdef, 0x55),
        vehicle.heartbeat(),
    ];
    let stream = parts.concat();
    let expected: Vec<_> = parts.to_vec();
    for first in 0..=stream.len() {
        for second in first..=stream.len() {
            let mut parser = Parser::new();
            let pieces = [&stream[..first], &stream[first..second], &stream[second..]];
            let all = pieces.map(|piece| found(&mut parser, piece)).concat();
            let all: Vec<_> = all.into_iter().map(|(bytes, _)| bytes).collect();
            assert_eq!(all, expected, "cut at {first} and {second}");
        }
    }
}

/// Feeds a changed frame: nothing of it is believed, and the good frame behind it comes through.
fn is_refused(changed: &[u8], good: &[u8], signed: bool) {
    let mut parser = Parser::new();
    for (bytes, checked) in found(&mut parser, changed) {
        let view = FrameView::parse(&bytes).expect("it was found");
        if signed {
            verify(&key(), &view).unwrap_err();
        } else {
            // Without a signature the checksum is all there is.
            assert!(!checked, "{changed:02x?}");
        }
    }
    good_comes_through(&mut parser, good, &changed);
}

#[test]
fn no_frame_with_a_changed_byte_or_two_changed_bits_is_believed() {
    let good = good();
    let mut made = 0;
    let mut vehicle = Vehicle::new(Stamp::new(1 << 40));
    let frames = [
        (vehicle.heartbeat(), true),
        (vehicle.send_unsigned(&heartbeat()), false),
    ];
    for (frame, signed) in frames {
        for at in 0..frame.len() {
            for change in 1..=255 {
                let mut changed = frame.clone();
                changed[at] ^= change;
                is_refused(&changed, &good, signed);
                made += 1;
            }
        }
        let bits = 8 * frame.len();
        for one in 0..bits {
            for other in one + 1..bits {
                let mut changed = frame.clone();
                changed[one / 8] ^= 1 << (one % 8);
                changed[other / 8] ^= 1 << (other % 8);
                is_refused(&changed, &good, signed);
                made += 1;
            }
        }
    }
    attacks::report(
        attacks::FRAMES,
        made,
        "none believed; the good frame behind each is",
    );
}

/// Every string of so many bytes of those that mean something, in two feeds.
fn every_string(length: u32) {
    let good = good();
    let meaning = [STX, STX_V1, 0, 1];
    for number in 0..4_usize.pow(length) {
        let digit = |at: u32| meaning[number / 4_usize.pow(at) % 4];
        let string: Vec<u8> = (0..length).map(digit).collect();
        let mut parser = Parser::new();
        let (one, other) = string.split_at(string.len() / 2);
        // Too short for a frame.
        assert!(found(&mut parser, one).is_empty() && found(&mut parser, other).is_empty());
        good_comes_through(&mut parser, &good, &string);
    }
}

#[test]
fn no_string_of_start_bytes_and_lengths_holds_back_a_good_frame() {
    (0..=8).for_each(every_string);
}

#[test]
#[ignore = "a minute in a release build"]
fn no_longer_string_of_start_bytes_and_lengths_holds_back_a_good_frame() {
    (9..=11).for_each(every_string);
}

#[test]
#[ignore = "minutes in a release build"]
fn no_frame_with_two_changed_bytes_is_believed() {
    let good = good();
    let frame = Vehicle::new(Stamp::new(1 << 40)).heartbeat();
    for one in 0..frame.len() {
        for other in one + 1..frame.len() {
            for change in 0..=u16::MAX {
                let [first, second] = change.to_le_bytes();
                if first == 0 || second == 0 {
                    continue;
                }
                let mut changed = frame.clone();
                changed[one] ^= first;
                changed[other] ^= second;
                is_refused(&changed, &good, true);
            }
        }
    }
}
