//! A file on its way down: what has arrived, what is missing, and what is requested next.
//!
//! On the ground the vehicle sends bursts, each from one request, and what a burst has lost is then read piece by piece. In
//! flight everything is read piece by piece at a set rate: PX4 fills all the free room of its link with a burst, and
//! telemetry would wait behind it.

use std::collections::BTreeMap;
use std::time::Duration;

use super::checksum::crc32;
use super::failure::Lie;
use super::payload::{MAX_DATA, Opcode, Payload};
use super::pending::{Pending, Timing};

/// Bytes that may wait for missing ones before them, and the furthest that a burst of PX4 may run ahead: it sends 35 000 at
/// a time, and up to 15 000 more that its buffer holds.
pub const MAX_HELD: usize = 64 * 1024;
/// Bytes in order that may wait for their reader; nothing is requested meanwhile.
pub const MAX_UNREAD: usize = 256 * 1024;

#[derive(Debug)]
pub(super) struct Reading {
    /// As Open was answered.
    pub(super) size: u32,
    /// What is before this has been delivered.
    pub(super) next: u32,
    /// The CRC32 of it.
    pub(super) crc: u32,
    /// What is before this has been sent or requested.
    horizon: u32,
    /// A burst has met the end of the file: what is missing before it is read piece by piece, which shows whether that is
    /// true.
    at_end: bool,
    held: BTreeMap<u32, Vec<u8>>,
    burst: Option<Burst>,
    pieces: Vec<Pending>,
    /// The earliest time of the next request.
    pace_at: Duration,
}

#[derive(Debug)]
struct Burst {
    /// Of its request: packets of an earlier burst have lower numbers.
    seq: u16,
    /// The burst has ended if no packet arrives by then.
    until: Duration,
    /// How many in a row have brought nothing.
    empty: u32,
    brought: bool,
}

/// What to send, if anything.
#[expect(
    clippy::large_enum_variant,
    reason = "one value, moved at once: nothing is allocated for a packet"
)]
pub(super) enum Want {
    Send(Payload),
    Nothing,
    /// The whole file has been delivered.
    Complete,
}

impl Reading {
    pub(super) fn new(size: u32, next: u32, crc: u32) -> Self {
        Self {
            size,
            next,
            crc,
            horizon: next,
            at_end: false,
            held: BTreeMap::new(),
            burst: None,
            pieces: Vec::new(),
            pace_at: Duration::ZERO,
        }
    }

    /// The session is another: what was requested in the earlier one is not answered any more.
    pub(super) fn begin_again(&mut self) {
        self.burst = None;
        self.pieces.clear();
        self.at_end = false;
        self.horizon = self.end_of_held();
    }

    /// Grows with each byte that is new.
    pub(super) fn progress(&self) -> u64 {
        let held: usize = self.held.values().map(Vec::len).sum();
        u64::from(self.next) + held as u64
    }

    /// Takes data of the file. `unread`: what its reader has taken so far counts no more.
    pub(super) fn take(
        &mut self,
        offset: u32,
        data: &[u8],
        unread: &mut Vec<u8>,
    ) -> Result<(), Lie> {
        let length = data.len();
        let end = usize::try_from(offset)
            .ok()
            .and_then(|at| at.checked_add(length));
        let end = end.and_then(|end| u32::try_from(end).ok());
        let Some(end) = end.filter(|end| *end <= self.size && length > 0) else {
            let size = self.size;
            return Err(Lie::BeyondEnd {
                offset,
                length,
                size,
            });
        };
        // An unread backlog drops the packet; it is requested again once the reader has caught up.
        if end <= self.next || unread.len() + length > MAX_UNREAD {
            return Ok(());
        }
        if offset > self.next {
            return self.hold(offset, end, data);
        }
        self.deliver(offset, data, unread);
        while let Some((&offset, _)) = self.held.first_key_value()
            && offset <= self.next
            && let Some(data) = self.held.remove(&offset)
        {
            self.deliver(offset, &data, unread);
        }
        self.horizon = self.horizon.max(self.end_of_held());
        Ok(())
    }

    fn hold(&mut self, offset: u32, end: u32, data: &[u8]) -> Result<(), Lie> {
        // Bounded in bytes by how far ahead it may be, and in number for one that sends single bytes.
        if (end - self.next) as usize > MAX_HELD || self.held.len() >= MAX_PIECES {
            return Ok(());
        }
        // A retransmission may be longer than the first copy, but where both have bytes they must agree.
        if let Some(there) = self.held.get(&offset) {
            let common = there.len().min(data.len());
            if there[..common] != data[..common] {
                return Err(Lie::TwoContents(offset));
            }
            if there.len() >= data.len() {
                return Ok(());
            }
        }
        self.held.insert(offset, data.to_vec());
        self.horizon = self.horizon.max(end);
        Ok(())
    }

    fn deliver(&mut self, offset: u32, data: &[u8], unread: &mut Vec<u8>) {
        let known = (self.next - offset) as usize;
        if let Some(new) = data.get(known..).filter(|new| !new.is_empty()) {
            self.crc = crc32(self.crc, new);
            unread.extend_from_slice(new);
            self.next += new.len() as u32;
        }
    }

    fn end_of_held(&self) -> u32 {
        let ends = self
            .held
            .iter()
            .map(|(offset, data)| offset + data.len() as u32);
        ends.fold(self.next, u32::max)
    }

    /// A packet of a burst. Whether it belongs to the present one.
    pub(super) fn burst_packet(
        &mut self,
        now: Duration,
        timing: &Timing,
        packet: &Payload,
    ) -> bool {
        let Some(burst) = &mut self.burst else {
            // A packet that arrives after the end of its burst, out of order, is as good as any.
            return true;
        };
        // PX4 numbers a packet of a burst from its request. `burst_complete` is uninitialised in some packets, so it ends a
        // burst early at worst: what is missing is requested again.
        let ahead = packet.seq.wrapping_sub(burst.seq);
        if ahead == 0 || ahead > MAX_BURST_PACKETS {
            return false;
        }
        burst.until = now + timing.answer;
        burst.brought = true;
        if packet.burst_complete {
            self.burst = None;
        }
        true
    }

    /// The vehicle reports the end of the file, in the numbering of the present burst.
    pub(super) fn burst_at_end(&mut self, packet: &Payload) {
        let ours = self.burst.take_if(|burst| {
            let ahead = packet.seq.wrapping_sub(burst.seq);
            // Only a hint: holes before the reported end are read piece by piece, and a false end shows as an early EOF.
            ahead > 0 && ahead <= MAX_BURST_PACKETS
        });
        if ours.is_some() {
            self.at_end = true;
            self.horizon = self.size.min(self.next.saturating_add(MAX_HELD as u32));
        }
    }

    /// Whether this is the number of the present burst's request.
    pub(super) fn is_burst_answer(&self, seq: u16) -> bool {
        self.burst
            .as_ref()
            .is_some_and(|one| seq.wrapping_sub(one.seq) <= MAX_BURST_PACKETS)
    }

    /// Takes the piece that an answer belongs to off the list; `None` for a late duplicate.
    pub(super) fn answered(&mut self, answer: &Payload) -> Option<Pending> {
        let place = self
            .pieces
            .iter()
            .position(|piece| piece.is_answered_by(answer))?;
        Some(self.pieces.swap_remove(place))
    }

    /// What to send now; called until there is nothing.
    pub(super) fn want(
        &mut self,
        now: Duration,
        timing: &Timing,
        rate: Option<u32>,
        unread: usize,
        session: u8,
        mut number: impl FnMut() -> u16,
    ) -> Want {
        if self.next >= self.size {
            return Want::Complete;
        }
        let late = self.pieces.iter_mut().find(|piece| piece.deadline <= now);
        if let Some(piece) = late {
            // A new number for each repeat: PX4 would answer a repeated number from memory only if it was the last.
            piece.payload.seq = number();
            piece.repeat(now, timing);
            return Want::Send(piece.payload.clone());
        }
        let mut empty = 0;
        if let Some(burst) = &self.burst {
            if now < burst.until {
                return Want::Nothing;
            }
            // Each burst that brought nothing doubles the wait for the next.
            empty = if burst.brought { 0 } else { burst.empty + 1 };
            self.burst = None;
        }
        if unread > MAX_UNREAD / 2 {
            self.pace_at = now + READER_IS_SLOW;
            return Want::Nothing;
        }
        let Some(bytes_per_s) = rate else {
            return self.want_unpaced(now, timing, session, empty, number);
        };
        if now < self.pace_at || self.pieces.len() >= PACED_WINDOW {
            return Want::Nothing;
        }
        let Some((offset, length)) = self.missing().or_else(|| self.extend()) else {
            return Want::Nothing;
        };
        let on_the_wire = f64::from(length) + FRAMES_OF_A_PIECE;
        let pause = Duration::from_secs_f64(on_the_wire / f64::from(bytes_per_s.max(1)));
        // Idle time is not made up for by a burst of requests.
        self.pace_at = self.pace_at.max(now) + pause;
        self.piece(now, timing, session, offset, length, number())
    }

    fn want_unpaced(
        &mut self,
        now: Duration,
        timing: &Timing,
        session: u8,
        empty: u32,
        mut number: impl FnMut() -> u16,
    ) -> Want {
        // Few bytes are missing: single reads are cheaper than a burst, which would send everything after the first hole
        // again.
        if self.at_end || self.missing_bytes() <= MAX_REPAIR {
            if self.pieces.len() >= usize::from(timing.window) {
                return Want::Nothing;
            }
            if let Some((offset, length)) = self.missing() {
                return self.piece(now, timing, session, offset, length, number());
            }
            if !self.pieces.is_empty() {
                return Want::Nothing;
            }
        }
        // A new burst covers all open holes, so late answers to single reads are no longer needed.
        self.pieces.clear();
        self.horizon = self.end_of_held();
        let payload = Payload {
            session,
            offset: self.next,
            size: MAX_DATA as u8,
            ..Payload::request(number(), Opcode::MAV_FTP_OPCODE_BURSTREADFILE)
        };
        self.burst = Some(Burst {
            seq: payload.seq,
            until: now + timing.wait(empty),
            empty,
            brought: false,
        });
        Want::Send(payload)
    }

    fn piece(
        &mut self,
        now: Duration,
        timing: &Timing,
        session: u8,
        offset: u32,
        length: u8,
        seq: u16,
    ) -> Want {
        let payload = Payload {
            session,
            offset,
            size: length,
            ..Payload::request(seq, Opcode::MAV_FTP_OPCODE_READFILE)
        };
        self.pieces.push(Pending::new(now, timing, payload.clone()));
        Want::Send(payload)
    }

    /// The first range before the horizon that has neither arrived nor is requested.
    fn missing(&self) -> Option<(u32, u8)> {
        self.holes().find_map(|(from, to)| {
            let mut at = from;
            while at < to {
                let Some(piece) = self.pieces.iter().find(|one| one.covers(at)) else {
                    // A piece requested further ahead limits this one: no byte is requested twice.
                    let later = self.pieces.iter().map(|one| one.payload.offset);
                    let until = later.filter(|start| *start > at).fold(to, u32::min);
                    return Some((at, (until - at).min(MAX_DATA as u32) as u8));
                };
                at = piece.payload.offset + u32::from(piece.payload.size);
            }
            None
        })
    }

    fn missing_bytes(&self) -> u32 {
        self.holes().map(|(from, to)| to - from).sum()
    }

    /// Moves the horizon on by one piece.
    fn extend(&mut self) -> Option<(u32, u8)> {
        let offset = self.horizon;
        let length = self.room().min(MAX_DATA as u32);
        self.horizon += length;
        (length > 0).then_some((offset, length as u8))
    }

    /// How far the horizon may be moved on.
    fn room(&self) -> u32 {
        let end = self.next.saturating_add(MAX_HELD as u32).min(self.size);
        end.saturating_sub(self.horizon)
    }

    fn holes(&self) -> impl Iterator<Item = (u32, u32)> + '_ {
        let ranges = self
            .held
            .iter()
            .map(|(at, data)| (*at, at + data.len() as u32));
        let mut known = self.next;
        ranges
            .chain([(self.horizon.max(self.next), u32::MAX)])
            .filter_map(move |(from, to)| {
                let hole = (known < from).then_some((known, from));
                known = known.max(to);
                hole
            })
    }

    pub(super) fn poll_timeout(&self, rate: Option<u32>, unread: usize) -> Option<Duration> {
        let burst = self.burst.as_ref().map(|burst| burst.until);
        let pieces = self.pieces.iter().map(|piece| piece.deadline);
        // Only while something can be requested: otherwise the caller would be woken again at once, forever.
        let paced = rate.is_some()
            && self.pieces.len() < PACED_WINDOW
            && (self.room() > 0 || self.missing().is_some());
        let waits = self.burst.is_none() && (paced || unread > MAX_UNREAD / 2);
        let pace = waits.then_some(self.pace_at);
        pieces.chain(burst).chain(pace).min()
    }
}

/// 64 KiB in pieces of 239 bytes are 275; an honest peer needs no more.
const MAX_PIECES: usize = 512;
/// Packets of one burst; PX4's are 147 and what its buffer holds.
const MAX_BURST_PACKETS: u16 = 4_096;
/// What is missing after a burst is read piece by piece up to here; beyond it another burst is faster.
const MAX_REPAIR: u32 = 32 * MAX_DATA as u32;
/// Pieces that are on their way at once where they are paced.
const PACED_WINDOW: usize = 4;
/// Request and answer of a piece, signed, beside its data: 25 bytes of frame and 15 of payload, twice.
const FRAMES_OF_A_PIECE: f64 = 80.0;
/// How often a slow reader is checked.
const READER_IS_SLOW: Duration = Duration::from_millis(20);
