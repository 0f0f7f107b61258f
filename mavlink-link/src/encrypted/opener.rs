//! Packets into frames: what was accepted before is refused, and a frame of which a part is missing is dropped.

use super::framing::Kind;
use super::packet::{PACKET, PLAIN, PacketKey, counter_of};
use super::sealer::ROOM;
use super::stats::Dropped;
use crate::frame::{CRC_LEN, HEADER_LEN, INCOMPAT_SIGNED, MAX_FRAME, SIGNATURE_LEN, STX};

/// Which counters were accepted.
#[derive(Debug, Default)]
pub(super) struct Window {
    highest: u32,
    /// Bit n: `highest - n` was accepted.
    accepted: u64,
    /// Nothing below the highest is taken: what carries the packets does not reorder them.
    strict: bool,
}

impl Window {
    pub(super) fn new(strict: bool) -> Self {
        Self {
            strict,
            ..Self::default()
        }
    }

    /// Whether this counter was not accepted before, as far as is known.
    pub(super) fn is_fresh(&self, counter: u32) -> bool {
        match self.highest.checked_sub(counter) {
            // The first packet has 1.
            _ if counter == 0 => false,
            None => true,
            Some(_) if self.strict => false,
            Some(age) => age < u64::BITS && self.accepted & (1 << age) == 0,
        }
    }

    /// Notes a counter that is fresh.
    pub(super) fn accept(&mut self, counter: u32) {
        if let Some(step @ 1..) = counter.checked_sub(self.highest) {
            self.accepted = self.accepted.checked_shl(step).unwrap_or(0) | 1;
            self.highest = counter;
        } else if let Some(age) = self.highest.checked_sub(counter) {
            self.accepted |= 1_u64.checked_shl(age).unwrap_or(0);
        }
    }
}

/// One direction of one session, receiving.
#[derive(Debug)]
pub(super) struct Opener {
    key: PacketKey,
    window: Window,
    forged: u32,
    /// The begin of a frame that continues in the next packet.
    partial: [u8; MAX_FRAME],
    held: usize,
}

/// What a packet brought beside its frames.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Opened {
    /// Packets missing before this one.
    pub(super) missing: u32,
    /// It is one that was missing.
    pub(super) late: bool,
    /// Something inside was no MAVLink frame.
    pub(super) malformed: bool,
}

impl Opener {
    pub(super) fn new(key: PacketKey, strict: bool) -> Self {
        Self {
            key,
            window: Window::new(strict),
            forged: 0,
            partial: [0; MAX_FRAME],
            held: 0,
        }
    }

    /// The highest counter accepted.
    pub(super) fn counter(&self) -> u32 {
        self.window.highest
    }

    /// Whether too many forgeries were tried: nothing is opened any more.
    pub(super) fn is_retired(&self) -> bool {
        self.forged == MAX_FORGED
    }

    /// As if so many forgeries more had been tried.
    pub(super) fn count_forgeries(&mut self, tried: u32) {
        self.forged = self.forged.saturating_add(tried);
    }

    /// Adds the frames that are whole with this packet to `out`. Nothing changes unless it verifies, but the number of
    /// forgeries.
    ///
    /// # Errors
    /// Why it is dropped.
    pub(super) fn open(
        &mut self,
        packet: &[u8; PACKET],
        out: &mut Vec<u8>,
    ) -> Result<Opened, Dropped> {
        debug_assert_eq!(packet[0], Kind::Data.to_wire());
        if self.is_retired() {
            return Err(Dropped::Retired);
        }
        if !self.key.is_of(packet) {
            return Err(Dropped::Station);
        }
        let counter = counter_of(packet);
        if !self.window.is_fresh(counter) {
            return Err(Dropped::Replayed);
        }
        let Some(plain) = self.key.open(packet) else {
            self.count_forgeries(1);
            return Err(Dropped::Forged);
        };
        let before = self.window.highest;
        self.window.accept(counter);
        let late = counter < before;
        let missing = counter.saturating_sub(before).saturating_sub(1);
        let malformed = self.extract(&plain, late, missing > 0, out).is_none();
        Ok(Opened {
            missing,
            late,
            malformed,
        })
    }

    /// `None` where the inside is no sequence of frames.
    fn extract(
        &mut self,
        plain: &[u8; PLAIN],
        late: bool,
        gap: bool,
        out: &mut Vec<u8>,
    ) -> Option<()> {
        let [first, used, data @ ..] = plain;
        let data = data.get(..usize::from(*used))?;
        let start = data.get(usize::from(*first)..).unwrap_or_default();
        if late {
            // Only what is whole in it: the frame that waits belongs to packets after it.
            let mut aside = Pieces::default();
            return aside.take(start, out);
        }
        let mut pieces = Pieces {
            partial: self.partial,
            held: if gap { 0 } else { self.held },
        };
        let continues = pieces.held > 0;
        let taken = pieces.take(if continues { data } else { start }, out);
        (self.partial, self.held) = match taken {
            Some(()) => (pieces.partial, pieces.held),
            None => ([0; MAX_FRAME], 0),
        };
        taken
    }
}

/// A frame that grows.
struct Pieces {
    partial: [u8; MAX_FRAME],
    held: usize,
}

impl Default for Pieces {
    fn default() -> Self {
        Self {
            partial: [0; MAX_FRAME],
            held: 0,
        }
    }
}

impl Pieces {
    fn take(&mut self, data: &[u8], out: &mut Vec<u8>) -> Option<()> {
        for &byte in data {
            *self.partial.get_mut(self.held)? = byte;
            self.held += 1;
            if self.partial[0] != STX {
                return None;
            }
            if frame_len(&self.partial[..self.held]) == Some(self.held) {
                out.extend_from_slice(&self.partial[..self.held]);
                self.held = 0;
            }
        }
        Some(())
    }
}

/// How long the MAVLink 2 frame is that begins so, where that can be seen.
pub(super) fn frame_len(begin: &[u8]) -> Option<usize> {
    let [STX, payload, flags, ..] = begin else {
        return None;
    };
    let trailer = if flags & INCOMPAT_SIGNED == 0 {
        0
    } else {
        SIGNATURE_LEN
    };
    Some(HEADER_LEN + usize::from(*payload) + CRC_LEN + trailer)
}

/// Forgeries tried on one key before it is given up. Each has at most 7 chances in 2^64 (GHASH over 7 blocks, tag of 8), so
/// that all of them have less than one in 2^29. A low bound, as 2^16, would gain nothing, and give anybody on the radio a
/// cheap way to have keys given up that work.
const MAX_FORGED: u32 = u32::MAX;

const _: () = assert!(ROOM < 255, "`first` of 255 is none");

#[cfg(test)]
mod tests {
    use super::super::sealer::Sealer;
    use super::*;

    fn pair(strict: bool) -> (Sealer, Opener) {
        let key = || PacketKey::new(&[7; 32], 1, 1);
        (Sealer::new(key()), Opener::new(key(), strict))
    }

    /// A frame of this length in all, unsigned.
    fn frame(len: usize, fill: u8) -> Vec<u8> {
        let mut frame = vec![fill; len];
        frame[..3].copy_from_slice(&[STX, u8::try_from(len - 12).unwrap(), 0]);
        frame
    }

    fn packets(sealer: &mut Sealer, frames: &[Vec<u8>]) -> Vec<[u8; PACKET]> {
        let mut packets = Vec::new();
        for frame in frames {
            sealer.push(frame, |packet| packets.push(packet));
        }
        packets.extend(sealer.flush());
        packets
    }

    #[test]
    fn frames_of_every_length_come_out_as_they_went_in() {
        let (mut sealer, mut opener) = pair(true);
        let frames: Vec<_> = (12..=267).map(|len| frame(len, len as u8)).collect();
        let mut out = Vec::new();
        for packet in packets(&mut sealer, &frames) {
            let opened = opener.open(&packet, &mut out).unwrap();
            assert_eq!((opened.missing, opened.malformed), (0, false));
        }
        assert_eq!(out, frames.concat());
    }

    #[test]
    fn an_empty_packet_verifies_once_and_brings_nothing() {
        let (mut sealer, mut opener) = pair(true);
        let (mut sent, mut out) = (Vec::new(), Vec::new());
        let long = frame(200, 1);
        sealer.push(&long, |packet| sent.push(packet));
        assert_eq!(sent.len(), 2);
        sent.extend(sealer.seal());
        sent.extend(sealer.seal());
        for packet in &sent {
            assert!(!opener.open(packet, &mut out).unwrap().malformed);
        }
        assert_eq!((sent.len(), &out), (4, &long), "the last one is empty");
        let (mut sealer, mut opener) = pair(false);
        out.clear();
        let empty = sealer.seal().unwrap();
        assert!(!opener.open(&empty, &mut out).unwrap().malformed);
        assert!(out.is_empty());
        assert_eq!(opener.open(&empty, &mut out), Err(Dropped::Replayed));
    }

    #[test]
    fn a_lost_packet_costs_the_frames_that_lie_in_it_and_no_other() {
        let frames: Vec<_> = (0..40).map(|n| frame(30 + n, n as u8)).collect();
        let count = packets(&mut pair(true).0, &frames).len();
        for lost in 0..count {
            let (mut sealer, mut opener) = pair(true);
            let mut out = Vec::new();
            for (at, packet) in packets(&mut sealer, &frames).iter().enumerate() {
                if at != lost {
                    assert!(!opener.open(packet, &mut out).unwrap().malformed);
                }
            }
            let mut left = out.as_slice();
            let (mut got, mut gap) = (0, 0);
            for frame in &frames {
                match left.strip_prefix(frame.as_slice()) {
                    Some(rest) => (left, got) = (rest, got + 1),
                    None => gap += 1,
                }
            }
            assert!(left.is_empty() && gap <= 4, "{got} received, {gap} lost");
        }
    }

    #[test]
    fn a_window_of_64_takes_each_packet_once_in_any_order() {
        let (mut sealer, mut opener) = pair(false);
        let all: Vec<_> = (0..200)
            .flat_map(|n| packets(&mut sealer, &[frame(40, n)]))
            .collect();
        let mut out = Vec::new();
        for block in all.chunks(50) {
            for packet in block.iter().rev() {
                opener.open(packet, &mut out).unwrap();
            }
        }
        assert_eq!(out.len(), 200 * 40);
        for packet in &all {
            assert_eq!(opener.open(packet, &mut out), Err(Dropped::Replayed));
        }
        assert_eq!(out.len(), 200 * 40);
        // Below the window nothing is known, so nothing is taken.
        let (mut sealer, mut opener) = pair(false);
        let all: Vec<_> = (0..66)
            .flat_map(|n| packets(&mut sealer, &[frame(40, n)]))
            .collect();
        opener.open(&all[65], &mut out).unwrap();
        assert_eq!(opener.open(&all[1], &mut out), Err(Dropped::Replayed));
        assert!(opener.open(&all[2], &mut out).is_ok());
    }

    #[test]
    fn a_key_is_given_up_after_too_many_forgeries() {
        let (mut sealer, mut opener) = pair(false);
        let good = packets(&mut sealer, &[frame(40, 1)])[0];
        let mut bad = good;
        bad[60] ^= 1;
        let mut out = Vec::new();
        opener.count_forgeries(MAX_FORGED - 2);
        for _ in 0..2 {
            assert!(!opener.is_retired());
            assert_eq!(opener.open(&bad, &mut out), Err(Dropped::Forged));
        }
        assert!(opener.is_retired());
        assert_eq!(opener.open(&good, &mut out), Err(Dropped::Retired));
    }

    #[test]
    fn the_last_counters_are_not_used_and_none_begins_again() {
        let near = u32::MAX - 3;
        let mut sealer = Sealer::at(PacketKey::new(&[7; 32], 1, 1), near);
        assert!(sealer.has_room_for(ROOM));
        assert!(!sealer.has_room_for(MAX_FRAME));
        for _ in 0..3 {
            let packet = packets(&mut sealer, &[frame(40, 1)])[0];
            assert!(counter_of(&packet) > near);
        }
        assert!(!sealer.has_room_for(1));
        assert!(packets(&mut sealer, &[frame(40, 1)]).is_empty());
    }
}
