//! Any bytes as a datagram of the DLI: its messages, and the wrapper alone.

use stanag_msgs::json::{self, decode_line, encode_line};
use stanag_msgs::{MAX_DATAGRAM, Message, Packer, Profile, ed25, frames, table};

/// What is decoded is encoded to the same bytes, and the three readings of a message (struct, walk over the table, JSON)
/// agree on whether it is one.
///
/// # Panics
/// They do not.
pub fn datagram(bytes: &[u8]) {
    for frame in frames(bytes).flatten() {
        let header = frame.header;
        let decoded = Message::decode(header.message_type, frame.data);
        if let Some(info) = table::message(header.message_type) {
            let walked = table::walk(info, frame.data).collect::<Result<Vec<_>, _>>();
            match (&decoded, &walked) {
                (Ok(_), Ok(_)) => {}
                (Err(fault), Err(other)) => assert_eq!(fault, other),
                _ => panic!("struct and table differ: {decoded:?}, {walked:?}"),
            }
        }
        assert_eq!(decoded.is_ok(), json::frame(&frame, true).is_ok());
        let Ok(message) = decoded else { continue };

        let mut data = [0; MAX_DATAGRAM];
        let length = message.encode_data(&mut data).expect("it has been decoded");
        let again = Message::decode(header.message_type, &data[..length]).expect("our own bytes");
        let mut twice = [0; MAX_DATAGRAM];
        assert_eq!(again.encode_data(&mut twice), Ok(length));
        assert_eq!(data[..length], twice[..length]);

        let mut packer = Packer::new();
        let mut sent = 0;
        packer
            .push(&header.envelope(), &message, |datagram| {
                sent += datagram.len()
            })
            .expect("it came in a datagram");
        packer.flush(|datagram| sent += datagram.len());
        assert!(sent <= MAX_DATAGRAM);

        let mut profile = Profile::default();
        profile.set("ack_type", "0,1,2").expect("a choice");
        profile.set("checksum_1", "crc16").expect("a choice");
        let _ = profile.decode(header.message_type, frame.data);
    }
    // The text side: what is printed for a datagram is read back to bytes.
    let hex: String = bytes.iter().map(|byte| format!("{byte:02x}")).collect();
    for line in decode_line(&hex, true) {
        if line.get("error").is_none() {
            encode_line(&line.to_string(), true).expect("what was decoded can be encoded");
        }
    }
    if let Ok(text) = std::str::from_utf8(bytes) {
        let _ = encode_line(text, false);
        let _ = decode_line(text, false);
    }
}

/// Frames lie in their datagram one behind the other, what is no frame is named with its place, and a header that was
/// read is written again as it was.
///
/// # Panics
/// One of these does not hold.
pub fn wrapper(bytes: &[u8]) {
    edition_2_5(bytes);
    let begin = bytes.as_ptr() as usize;
    let mut end = 0;
    for frame in frames(bytes) {
        let frame = match frame {
            Ok(frame) => frame,
            Err(fault) => {
                assert!(fault.offset() <= bytes.len(), "{fault}");
                continue;
            }
        };
        let offset = frame.bytes.as_ptr() as usize - begin;
        assert!(offset >= end, "two frames share bytes");
        end = offset + frame.bytes.len();
        assert!(end <= bytes.len() && bytes.len() <= MAX_DATAGRAM);

        let header = frame.header;
        let Ok(message) = Message::decode(header.message_type, frame.data) else {
            continue;
        };
        let mut out = [0; MAX_DATAGRAM];
        let length = message.encode(&header.envelope(), &mut out);
        let length = length.expect("it came in a datagram");
        let again = frames(&out[..length]).next().expect("one frame");
        assert_eq!(again.expect("our own frame").header, header);
    }
}

/// The same of the wrapper of Edition 2.5, and of the fields behind it.
fn edition_2_5(bytes: &[u8]) {
    let begin = bytes.as_ptr() as usize;
    let mut end = 0;
    for frame in ed25::frames(bytes) {
        let frame = match frame {
            Ok(frame) => frame,
            Err(fault) => {
                assert!(fault.offset() <= bytes.len(), "{fault}");
                continue;
            }
        };
        let offset = frame.bytes.as_ptr() as usize - begin;
        assert!(offset >= end, "two frames share bytes");
        end = offset + frame.bytes.len();
        let mut out = [0; MAX_DATAGRAM];
        let length =
            ed25::encode(&frame.header, frame.data, &mut out).expect("it came in a datagram");
        let again = ed25::frames(&out[..length])
            .next()
            .expect("one frame")
            .expect("our own frame");
        assert_eq!((again.header, again.data), (frame.header, frame.data));
        if let Some(info) = ed25::message(frame.header.message_type, frame.header.version) {
            let whole = table::walk(info, frame.data).all(|field| field.is_ok());
            assert_eq!(whole, frame.data.len() == info.full_bytes());
        }
    }
}
