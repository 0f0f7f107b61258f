//! A file on its way up: a window of pieces, each repeated until the vehicle confirms that it is written.

use std::time::Duration;

use super::failure::Lie;
use super::payload::{MAX_DATA, Opcode, Payload};
use super::pending::{Pending, Timing};
use super::read::Want;

/// Largest file that is written, bytes: it is kept in memory until the vehicle has it.
pub const MAX_WRITE: usize = 8 * 1024 * 1024;

#[derive(Debug)]
pub(super) struct Writing {
    pub(super) content: Vec<u8>,
    /// What is before this has been sent.
    sent: usize,
    /// Bytes that are confirmed.
    pub(super) confirmed: usize,
    pieces: Vec<Pending>,
}

impl Writing {
    pub(super) fn new(content: Vec<u8>) -> Self {
        let (sent, confirmed, pieces) = (0, 0, Vec::new());
        Self {
            content,
            sent,
            confirmed,
            pieces,
        }
    }

    /// The file was created again, and truncated: what the earlier session wrote is gone.
    pub(super) fn begin_again(&mut self) {
        (self.sent, self.confirmed) = (0, 0);
        self.pieces.clear();
    }

    /// Takes an answer to a piece; whether it was one.
    pub(super) fn confirm(&mut self, answer: &Payload) -> Result<bool, Lie> {
        let found = self
            .pieces
            .iter()
            .position(|piece| piece.is_answered_by(answer));
        let Some(place) = found else {
            return Ok(false);
        };
        let piece = self.pieces.swap_remove(place).payload;
        let sent = usize::from(piece.size);
        let confirmed = answer
            .number()
            .ok_or(Lie::Number("WriteFile", answer.size))?;
        // PX4 confirms the bytes that its file system took; fewer means a full card.
        if usize::try_from(confirmed) != Ok(sent) {
            let offset = piece.offset;
            return Err(Lie::Written {
                offset,
                sent,
                confirmed,
            });
        }
        self.confirmed += sent;
        Ok(true)
    }

    /// Whether a refusal belongs to a piece that is on its way.
    pub(super) fn is_waiting_for(&self, answer: &Payload) -> bool {
        self.pieces.iter().any(|piece| piece.is_answered_by(answer))
    }

    pub(super) fn want(
        &mut self,
        now: Duration,
        timing: &Timing,
        session: u8,
        mut number: impl FnMut() -> u16,
    ) -> Want {
        let late = self.pieces.iter_mut().find(|piece| piece.deadline <= now);
        if let Some(piece) = late {
            // Writing the same bytes to the same place again changes nothing.
            piece.payload.seq = number();
            piece.repeat(now, timing);
            return Want::Send(piece.payload.clone());
        }
        let rest = self.content.get(self.sent..).unwrap_or_default();
        if rest.is_empty() {
            let waiting = !self.pieces.is_empty();
            return if waiting {
                Want::Nothing
            } else {
                Want::Complete
            };
        }
        if self.pieces.len() >= usize::from(timing.window) {
            return Want::Nothing;
        }
        let data = rest.get(..MAX_DATA).unwrap_or(rest);
        let payload = Payload {
            session,
            // At most MAX_WRITE.
            offset: self.sent as u32,
            ..Payload::request(number(), Opcode::MAV_FTP_OPCODE_WRITEFILE).with_data(data)
        };
        self.sent += data.len();
        self.pieces.push(Pending::new(now, timing, payload.clone()));
        Want::Send(payload)
    }

    pub(super) fn poll_timeout(&self) -> Option<Duration> {
        self.pieces.iter().map(|piece| piece.deadline).min()
    }
}
