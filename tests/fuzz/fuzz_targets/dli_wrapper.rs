//! The wrapper alone: frames lie in their datagram one behind the other, what is no frame is named with its place, and a
//! header that was read is written again as it was.
#![no_main]

use libfuzzer_sys::fuzz_target;
use stanag_msgs::{MAX_DATAGRAM, Message, frames};

fuzz_target!(|bytes: &[u8]| {
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
