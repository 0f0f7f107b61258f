//! The stream parser: datagrams or serial bytes in, frames out.
//!
//! Promised: at most one frame's worth of bytes is kept between calls; after noise, a bad checksum or
//! a refused frame the search continues one byte later, so that a good frame behind it is never lost.

use super::layout::{MAX_FRAME, STX, STX_V1};
use super::view::{FrameError, FrameView, Verdict, examine};

/// Finds frames in a stream of bytes.
#[derive(Debug)]
pub struct Parser {
    /// The start of a frame whose end has not arrived yet: `buf[start..end]`.
    buf: [u8; CAPACITY],
    start: usize,
    end: usize,
    /// The kept start will not be completed: search it for whole frames inside.
    expire: bool,
    counts: FrameCounts,
}

impl Parser {
    /// A parser that keeps nothing yet.
    #[must_use]
    pub fn new() -> Self {
        Self {
            buf: [0; CAPACITY],
            start: 0,
            end: 0,
            expire: false,
            counts: FrameCounts::default(),
        }
    }

    /// Takes a datagram, or a read of a serial port. Drain the result: frames not taken before it is
    /// dropped are lost.
    ///
    /// Bytes that begin with a whole good frame end a partial frame that is still kept, so that a
    /// broken datagram cannot delay the next ones.
    pub fn feed<'p, 'd>(&'p mut self, bytes: &'d [u8]) -> Frames<'p, 'd> {
        // PX4 sends one whole frame in a datagram; a read of a serial port may end inside one. Bytes that begin with a
        // whole frame continue nothing: the rest of the kept frame is lost.
        if self.pending() > 0 && matches!(examine(bytes), Verdict::Frame(_)) {
            self.expire = true;
        }
        Frames {
            parser: self,
            input: bytes,
            at: 0,
            unchecked: None,
            to_hash: 2 * bytes.len() + MAX_FRAME,
        }
    }

    /// Bytes kept of a frame whose end has not arrived.
    #[must_use]
    pub fn pending(&self) -> usize {
        self.end - self.start
    }

    /// Gives up waiting for the rest of the kept bytes: the line was silent too long. Good frames
    /// inside them are returned by the next [`feed`](Self::feed).
    pub fn expire_pending(&mut self) {
        self.expire = self.pending() > 0;
    }

    /// Drops the kept bytes, counted as a truncated frame. For datagrams of senders other than the peer, whose
    /// bytes must not be joined with anything.
    pub fn discard_pending(&mut self) {
        if self.pending() > 0 {
            self.counts.truncated += 1;
            self.counts.garbage_bytes += self.pending() as u64;
        }
        (self.start, self.end, self.expire) = (0, 0, false);
    }

    /// What has been processed since the start.
    #[must_use]
    pub fn counts(&self) -> FrameCounts {
        self.counts
    }
}

impl Default for Parser {
    fn default() -> Self {
        Self::new()
    }
}

/// The frames of one call of [`Parser::feed`].
#[derive(Debug)]
pub struct Frames<'p, 'd> {
    parser: &'p mut Parser,
    input: &'d [u8],
    at: usize,
    /// Length of the frame just returned whose checksum could not be checked.
    unchecked: Option<usize>,
    /// Bytes of such frames that may still be returned. Each costs its receiver a signature, and in a datagram made for it one
    /// could begin at every seventh byte: 300 in 2 kB.
    to_hash: usize,
}

impl Frames<'_, '_> {
    /// The next frame, or the next refusal; `None` when the bytes are used up.
    ///
    /// Not an `Iterator`: a frame borrows the parser until the next call.
    #[expect(clippy::should_implement_trait, reason = "the items borrow from self")]
    pub fn next(&mut self) -> Option<Result<FrameView<'_>, FrameError>> {
        self.unchecked = None;
        let found = self.search()?;
        Some(found.map(
            |Found {
                 kept,
                 start,
                 len,
                 checked,
             }| {
                let bytes: &[u8] = if kept { &self.parser.buf } else { self.input };
                FrameView::from_parts(&bytes[start..start + len], checked)
            },
        ))
    }

    /// Confirms that the last frame, whose checksum could not be checked, has a correct signature: the search
    /// continues behind it. Without this call it continues inside it, since the frame may be noise.
    pub fn accept_unchecked(&mut self) {
        if let Some(len) = self.unchecked.take() {
            // One byte of it was skipped when the frame was returned.
            self.skip(len - 1);
        }
    }

    fn search(&mut self) -> Option<Result<Found, FrameError>> {
        loop {
            let kept = self.parser.pending() > 0;
            let expiring = kept && self.parser.expire;
            if kept && !expiring {
                self.fill();
            }
            let rest = self.rest();
            if rest.is_empty() {
                self.parser.expire = false;
                return None;
            }
            let noise = rest
                .iter()
                .take_while(|&&o| o != STX && o != STX_V1)
                .count();
            if noise > 0 {
                self.skip_noise(noise);
                continue;
            }
            let start = if kept { self.parser.start } else { self.at };
            match examine(rest) {
                Verdict::Frame(len) => {
                    self.parser.counts.good += 1;
                    self.skip(len);
                    return Some(Ok(Found {
                        kept,
                        start,
                        len,
                        checked: true,
                    }));
                }
                Verdict::Unchecked(len) if len > self.to_hash => self.skip_noise(1),
                Verdict::Unchecked(len) => {
                    self.to_hash -= len;
                    // Without CRC_EXTRA it may be noise: the search continues inside it unless its signature verifies.
                    self.parser.counts.unchecked += 1;
                    self.skip(1);
                    self.unchecked = Some(len);
                    return Some(Ok(Found {
                        kept,
                        start,
                        len,
                        checked: false,
                    }));
                }
                Verdict::Refused(len, error) => {
                    self.parser.counts.count(error);
                    self.skip(len);
                    return Some(Err(error));
                }
                Verdict::Garbage => self.skip_noise(1),
                Verdict::Incomplete if expiring => {
                    self.parser.counts.count(FrameError::Truncated);
                    self.skip(1);
                    return Some(Err(FrameError::Truncated));
                }
                // The buffer was full. The next round moves the kept bytes to its start, which makes room for more input.
                Verdict::Incomplete if kept && self.at < self.input.len() => {}
                Verdict::Incomplete => {
                    self.keep();
                    return None;
                }
            }
        }
    }

    /// The bytes to search next: the kept ones first.
    fn rest(&self) -> &[u8] {
        if self.parser.pending() > 0 {
            &self.parser.buf[self.parser.start..self.parser.end]
        } else {
            &self.input[self.at..]
        }
    }

    fn skip_noise(&mut self, bytes: usize) {
        self.parser.counts.garbage_bytes += bytes as u64;
        self.skip(bytes);
    }

    fn skip(&mut self, bytes: usize) {
        if self.parser.pending() > 0 {
            self.parser.start += bytes;
            if self.parser.pending() == 0 {
                (self.parser.start, self.parser.end, self.parser.expire) = (0, 0, false);
            }
        } else {
            self.at += bytes;
        }
    }

    /// Appends as much of the input to the kept bytes as fits.
    fn fill(&mut self) {
        let parser = &mut *self.parser;
        parser.buf.copy_within(parser.start..parser.end, 0);
        (parser.start, parser.end) = (0, parser.end - parser.start);
        let len = (CAPACITY - parser.end).min(self.input.len() - self.at);
        parser.buf[parser.end..parser.end + len]
            .copy_from_slice(&self.input[self.at..self.at + len]);
        parser.end += len;
        self.at += len;
    }

    /// Keeps the incomplete end of the input for the next call.
    fn keep(&mut self) {
        let rest = self.input.len() - self.at;
        if rest > 0 && self.parser.pending() == 0 {
            self.parser.buf[..rest].copy_from_slice(&self.input[self.at..]);
            (self.parser.start, self.parser.end) = (0, rest);
            self.at = self.input.len();
        }
    }
}

/// Where a frame was found.
struct Found {
    kept: bool,
    start: usize,
    len: usize,
    checked: bool,
}

/// What a parser has processed, each drop under its own name.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct FrameCounts {
    /// Frames with a correct checksum.
    pub good: u64,
    /// Signed frames of a message without known CRC_EXTRA, returned unchecked.
    pub unchecked: u64,
    /// Candidates with a wrong checksum.
    pub bad_crc: u64,
    /// Frames with an unknown incompatibility flag.
    pub unknown_incompat: u64,
    /// MAVLink 1 frames.
    pub mavlink1: u64,
    /// Unsigned frames of a message without known CRC_EXTRA; noise can look like one.
    pub unknown_id: u64,
    /// Frames whose end never came.
    pub truncated: u64,
    /// Bytes outside any frame.
    pub garbage_bytes: u64,
}

impl FrameCounts {
    fn count(&mut self, error: FrameError) {
        *match error {
            FrameError::BadCrc { .. } => &mut self.bad_crc,
            FrameError::UnknownIncompat { .. } => &mut self.unknown_incompat,
            FrameError::Mavlink1 { .. } => &mut self.mavlink1,
            FrameError::UnknownId { .. } => &mut self.unknown_id,
            FrameError::Truncated => &mut self.truncated,
            FrameError::NoFrame => &mut self.garbage_bytes,
        } += 1;
    }
}

/// Room for a kept start and for enough bytes behind it to examine it and the next one.
const CAPACITY: usize = 2 * MAX_FRAME;
