//! Frames on the radio: 7e ‖ kind ‖ body ‖ 7e, with 7e and 7d inside written as 7d and the byte xor 20, as in HDLC.
//!
//! Promised: no input panics or allocates; whatever was lost or changed, the next 7e that arrives begins a frame that can
//! be read. What lies between two flags and is no frame is one drop with a name.

use super::stats::Dropped;
use crate::frame::MAX_FRAME;

/// The longest content of a frame: its kind, and a KEY_EXCHANGE as MAVLink frames it.
pub const MAX_CONTENT: usize = 1 + MAX_FRAME;
/// The longest frame on the wire: every byte escaped, and two flags.
pub const MAX_WIRE: usize = 2 + 2 * MAX_CONTENT;

/// What a frame holds, its first byte.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Kind {
    /// 0: an encrypted packet.
    Data,
    /// 1: for or from the radio at this end, which reads it itself: never encrypted.
    Radio,
    /// 2: a KEY_EXCHANGE (229), which must pass before there is a key.
    Clear,
}

impl Kind {
    pub(super) const fn to_wire(self) -> u8 {
        match self {
            Self::Data => 0,
            Self::Radio => 1,
            Self::Clear => 2,
        }
    }

    pub(super) const fn from_wire(raw: u8) -> Option<Self> {
        match raw {
            0 => Some(Self::Data),
            1 => Some(Self::Radio),
            2 => Some(Self::Clear),
            _ => None,
        }
    }
}

/// Writes a frame with this content and returns its length.
pub(super) fn write(content: &[u8], out: &mut [u8; MAX_WIRE]) -> usize {
    out[0] = FLAG;
    let mut at = 1;
    for &byte in content.iter().take(MAX_CONTENT) {
        if matches!(byte, FLAG | ESCAPE) {
            (out[at], out[at + 1]) = (ESCAPE, byte ^ FLIP);
            at += 2;
        } else {
            out[at] = byte;
            at += 1;
        }
    }
    out[at] = FLAG;
    at + 1
}

/// Finds frames in bytes.
#[derive(Debug)]
pub(super) struct Deframer {
    content: [u8; MAX_CONTENT],
    len: usize,
    escaped: bool,
    fault: Option<Dropped>,
}

impl Default for Deframer {
    fn default() -> Self {
        Self {
            content: [0; MAX_CONTENT],
            len: 0,
            escaped: false,
            fault: None,
        }
    }
}

impl Deframer {
    /// Reads up to the end of the next frame, and leaves the rest in `bytes`; `None` where they end before it.
    pub(super) fn next(&mut self, bytes: &mut &[u8]) -> Option<Result<&[u8], Dropped>> {
        while let Some((&byte, rest)) = bytes.split_first() {
            *bytes = rest;
            if byte != FLAG {
                self.take(byte);
                continue;
            }
            let (len, fault) = self.end();
            match fault {
                Some(fault) => return Some(Err(fault)),
                // Two flags between two frames, or the one that begins the first.
                None if len == 0 => {}
                None => return Some(Ok(&self.content[..len])),
            }
        }
        None
    }

    /// Forgets a frame whose end has not arrived: what it was dropped for, if anything has arrived.
    pub(super) fn discard(&mut self) -> Option<Dropped> {
        let (len, fault) = self.end();
        let plaintext = self.content[..len].first().is_some_and(is_mavlink);
        match (fault, plaintext) {
            (_, true) => Some(Dropped::Plaintext),
            (Some(fault), _) => Some(fault),
            (None, _) => (len > 0).then_some(Dropped::Truncated),
        }
    }

    fn take(&mut self, byte: u8) {
        let byte = match (self.escaped, byte) {
            (false, ESCAPE) => {
                self.escaped = true;
                return;
            }
            (false, byte) => byte,
            (true, byte) => {
                self.escaped = false;
                // Nothing else is ever escaped: another byte is a damaged one.
                if !matches!(byte ^ FLIP, FLAG | ESCAPE) {
                    self.fault.get_or_insert(Dropped::Escape);
                }
                byte ^ FLIP
            }
        };
        match self.content.get_mut(self.len) {
            Some(place) => {
                *place = byte;
                self.len += 1;
            }
            None => {
                self.fault.get_or_insert(Dropped::Length);
            }
        }
    }

    fn end(&mut self) -> (usize, Option<Dropped>) {
        if core::mem::take(&mut self.escaped) {
            self.fault.get_or_insert(Dropped::Escape);
        }
        (core::mem::take(&mut self.len), self.fault.take())
    }
}

/// Whether this byte begins a MAVLink frame, of version 1 or 2.
pub(super) fn is_mavlink(byte: &u8) -> bool {
    matches!(*byte, crate::frame::STX | crate::frame::STX_V1)
}

const FLAG: u8 = 0x7e;
const ESCAPE: u8 = 0x7d;
const FLIP: u8 = 0x20;

#[cfg(test)]
mod tests {
    use super::*;

    fn read(mut bytes: &[u8]) -> Vec<Result<Vec<u8>, Dropped>> {
        let mut deframer = Deframer::default();
        let mut found = Vec::new();
        while let Some(item) = deframer.next(&mut bytes) {
            found.push(item.map(<[u8]>::to_vec));
        }
        found
    }

    #[test]
    fn flags_and_escapes_pass_inside_and_a_frame_is_as_long_as_promised() {
        let content: Vec<u8> = (0..=255).chain([FLAG; 25]).collect();
        assert_eq!(content.len(), MAX_CONTENT);
        let mut out = [0; MAX_WIRE];
        let len = write(&content, &mut out);
        assert_eq!(out[..len].iter().filter(|&&byte| byte == FLAG).count(), 2);
        assert_eq!(read(&out[..len]), [Ok(content)]);
        let len = write(&[FLAG; MAX_CONTENT], &mut out);
        assert_eq!(len, MAX_WIRE);
    }

    #[test]
    fn the_next_flag_begins_a_good_frame_whatever_came_before() {
        let mut good = [0; MAX_WIRE];
        let len = write(&[0, 5, 6], &mut good);
        for (before, fault) in [
            (&[FLAG, 1, ESCAPE][..], Dropped::Escape),
            (&[FLAG, 1, ESCAPE, 7, 8], Dropped::Escape),
            (&[9; MAX_CONTENT + 1], Dropped::Length),
        ] {
            let bytes = [before, &good[..len]].concat();
            assert_eq!(read(&bytes), [Err(fault), Ok(vec![0, 5, 6])]);
        }
        // A flag that was lost between two frames costs neither: one is enough.
        let bytes = [&good[..len], &good[1..len]].concat();
        assert_eq!(read(&bytes).len(), 2);
    }

    #[test]
    fn a_datagram_that_ends_too_early_is_named() {
        let mut deframer = Deframer::default();
        assert_eq!(deframer.discard(), None);
        for (bytes, fault) in [
            (&[FLAG, 0, 1][..], Dropped::Truncated),
            (&[FLAG, ESCAPE], Dropped::Escape),
            (&[0xfd, 9, 0], Dropped::Plaintext),
        ] {
            assert!(deframer.next(&mut &*bytes).is_none());
            assert_eq!(deframer.discard(), Some(fault));
            assert_eq!(deframer.discard(), None);
        }
    }
}
