//! The wrapper alone: frames lie in their datagram one behind the other, what is no frame is named with its place, and a
//! header that was read is written again as it was.
#![no_main]

use libfuzzer_sys::fuzz_target;
use stanag_msgs::{MAX_DATAGRAM, Message, ed25, frames, table};

fuzz_target!(|bytes: &[u8]| {
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
});

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
