//! Any bytes of a MAVLink link, whole and in pieces: what is found is a frame, the recorder takes it as one, and a
//! decoded message encodes to bytes that decode to the same.

use core::time::Duration;

use mavlink_link::frame::{FrameView, MAX_FRAME, Parser, encode};
use mavlink_link::tlog;

/// Feeds the bytes to a parser, whole and in pieces whose length the first byte gives.
pub fn run(bytes: &[u8]) {
    let Some((&piece, rest)) = bytes.split_first() else {
        return;
    };
    // The checksum of an unknown message cannot be verified: whether it counts as a frame depends on what arrives
    // with it.
    let mut found = frames(rest, rest.len().max(1));
    found.extend(frames(rest, usize::from(piece) % 40 + 1));
    for found in &found {
        let view = FrameView::parse(found).expect("it was found");
        let mut record = [0; tlog::MAX_RECORD];
        let length = tlog::record(Duration::from_secs(1), &view, &mut record);
        if !view.is_checked() {
            // An unknown message: accepted for its signature alone, and recorded without it.
            continue;
        }
        let kept = FrameView::parse(&record[8..length]).expect("a record holds a frame");
        assert!(!kept.is_signed());
        let Ok(message) = view.message() else {
            continue;
        };
        let mut once = [0; MAX_FRAME];
        let length = encode(&message, view.header(), &mut once);
        let mut header = view.header();
        header.incompat = 0;
        let length_plain = encode(&message, header, &mut once);
        assert!(length == length_plain);
        let again = FrameView::parse(&once[..length_plain]).expect("our own frame");
        let again = again.message().expect("our own message");
        let mut twice = [0; MAX_FRAME];
        assert_eq!(encode(&again, header, &mut twice), length_plain);
        assert_eq!(once[..length_plain], twice[..length_plain]);
    }
}

fn frames(bytes: &[u8], piece: usize) -> Vec<Vec<u8>> {
    let mut parser = Parser::new();
    let mut found = Vec::new();
    for part in bytes.chunks(piece) {
        let mut frames = parser.feed(part);
        while let Some(frame) = frames.next() {
            if let Ok(view) = frame {
                found.push(view.as_bytes().to_vec());
            }
        }
    }
    found
}
