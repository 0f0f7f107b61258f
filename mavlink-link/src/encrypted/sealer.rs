//! Frames into packets: MAVLink frames follow each other without gaps, over the ends of packets.
//!
//! Promised: no counter is used twice. It starts at 1 under a key that no earlier process had, rises by one a packet,
//! and there is no way to set it or to copy the sealer.

use zeroize::Zeroize as _;

use super::packet::{PACKET, PLAIN, PacketKey};

/// MAVLink in one packet.
pub(super) const ROOM: usize = PLAIN - 2;
/// `first` of a packet in which no frame begins.
pub(super) const NO_START: u8 = 255;

/// Two flags, and what escaping adds to a packet: two of 256 values of a byte are escaped.
const FRAMING: usize = 3;

/// Bytes on the radio for one frame of MAVLink that is sent alone: whole packets.
#[must_use]
pub const fn bytes_on_radio(frame: usize) -> usize {
    frame.div_ceil(ROOM) * (PACKET + FRAMING)
}

/// One direction of one session, sending.
#[derive(Debug)]
pub(super) struct Sealer {
    key: PacketKey,
    /// Of the last packet.
    counter: u32,
    plain: [u8; PLAIN],
    used: usize,
    first: u8,
}

impl Sealer {
    pub(super) fn new(key: PacketKey) -> Self {
        Self {
            key,
            counter: 0,
            plain: [0; PLAIN],
            used: 0,
            first: NO_START,
        }
    }

    /// Packets sealed so far.
    pub(super) fn counter(&self) -> u32 {
        self.counter
    }

    /// Whether so many bytes can still be sent: the last counters are never used, and none begins again.
    pub(super) fn has_room_for(&self, bytes: usize) -> bool {
        let packets = u32::try_from(bytes / ROOM + 2).unwrap_or(u32::MAX);
        self.counter.checked_add(packets).is_some()
    }

    /// Adds one whole frame, and gives each packet that is full.
    pub(super) fn push(&mut self, mut frame: &[u8], mut emit: impl FnMut([u8; PACKET])) {
        if self.first == NO_START {
            self.first = u8::try_from(self.used).unwrap_or(NO_START);
        }
        while !frame.is_empty() {
            let (now, later) = frame.split_at(frame.len().min(ROOM - self.used));
            self.plain[2 + self.used..][..now.len()].copy_from_slice(now);
            (self.used, frame) = (self.used + now.len(), later);
            if self.used == ROOM
                && let Some(packet) = self.flush()
            {
                emit(packet);
            }
        }
    }

    /// Whether bytes wait for the packet to be full.
    pub(super) fn is_pending(&self) -> bool {
        self.used > 0
    }

    /// The packet as it is, filled with zeros; `None` where it is empty.
    pub(super) fn flush(&mut self) -> Option<[u8; PACKET]> {
        if !self.is_pending() {
            return None;
        }
        self.seal()
    }

    /// The same, also where it is empty: it shows that this end has the key.
    pub(super) fn seal(&mut self) -> Option<[u8; PACKET]> {
        let used = core::mem::take(&mut self.used);
        let mut plain = core::mem::replace(&mut self.plain, [0; PLAIN]);
        plain[0] = core::mem::replace(&mut self.first, NO_START);
        plain[1] = u8::try_from(used).ok()?;
        // First the counter: whatever fails after this, it is not used again.
        self.counter = self.counter.checked_add(1)?;
        let packet = self.key.seal(self.counter, &plain);
        plain.zeroize();
        packet
    }

    #[cfg(test)]
    pub(super) fn at(key: PacketKey, counter: u32) -> Self {
        Self {
            counter,
            ..Self::new(key)
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::framing::{self, MAX_WIRE};
    use super::*;

    #[test]
    fn a_frame_that_is_sent_alone_takes_the_bytes_that_are_planned_for_it() {
        let mut sealer = Sealer::new(PacketKey::new(&[1; 32], 2, 3));
        let mut wire = [0; MAX_WIRE];
        let times = 500;
        for len in [1, 45, ROOM, ROOM + 1, 2 * ROOM, 280] {
            let mut bytes = 0;
            for _ in 0..times {
                let mut packets = Vec::new();
                sealer.push(&vec![7; len], |packet| packets.push(packet));
                packets.extend(sealer.flush());
                for packet in &packets {
                    bytes += framing::write(packet, &mut wire);
                }
            }
            let planned = bytes_on_radio(len) * times;
            let fits = bytes <= planned && 100 * bytes > 99 * planned;
            assert!(fits, "{len}: {bytes} of {planned}");
        }
    }
}
