//! STATUSTEXT: one text every 50 ms, long ones in chunks of 50 bytes.
//!
//! PX4 sends many texts twice, as EVENT (410) and as a legacy STATUSTEXT that ends with a tab character; this
//! simulator does so where its configuration requires it, otherwise it sends the STATUSTEXT alone. Identical texts
//! queue up, as observed on the wire, and arrive up to 0.3 s late.

use std::collections::VecDeque;

use mavlink::dialects::development::{MavMessage, MavSeverity, STATUSTEXT_DATA};
use mavlink::types::CharArray;

use super::events::Events;

/// The queue of texts. A text that does not fit is lost, as in PX4.
#[derive(Debug, Clone, Default)]
pub(crate) struct Texts {
    waiting: VecDeque<(MavSeverity, String)>,
    next_id: u16,
    due: f64,
    pub(crate) events: Events,
}

impl Texts {
    /// A queue, with events beside the texts or without.
    pub(crate) fn new(events: bool) -> Self {
        Self {
            events: Events::new(events),
            ..Self::default()
        }
    }

    /// Queues a text.
    pub(crate) fn queue(&mut self, severity: MavSeverity, text: impl Into<String>) {
        let text = text.into();
        self.events.beside_text(&text);
        if self.waiting.len() < CAPACITY {
            self.waiting.push_back((severity, text));
        }
    }

    /// The next text that is due, as one message or several chunks.
    pub(crate) fn poll(&mut self, now: f64, mut send: impl FnMut(MavMessage)) {
        if now < self.due {
            return;
        }
        let Some((severity, text)) = self.waiting.pop_front() else {
            return;
        };
        self.due = now + SPACING_S;
        let id = self.next_id;
        self.next_id = self.next_id.wrapping_add(1);
        for (chunk_seq, chunk) in (0u8..).zip(text.as_bytes().chunks(CHUNK)) {
            let mut bytes = [0; CHUNK];
            bytes[..chunk.len()].copy_from_slice(chunk);
            send(MavMessage::STATUSTEXT(STATUSTEXT_DATA {
                severity,
                text: CharArray::new(bytes),
                id,
                chunk_seq,
            }));
        }
    }
}

/// Characters of one STATUSTEXT.
const CHUNK: usize = 50;
/// Texts that wait at most.
const CAPACITY: usize = 64;
/// Between two texts: PX4 streams STATUSTEXT at 20 Hz.
const SPACING_S: f64 = 0.05;

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_long_text_is_sent_in_chunks_and_the_next_one_later() {
        let mut texts = Texts::default();
        texts.queue(MavSeverity::MAV_SEVERITY_INFO, "x".repeat(52));
        texts.queue(MavSeverity::MAV_SEVERITY_INFO, "y");
        let mut out = Vec::new();
        texts.poll(1.0, |m| out.push(m));
        texts.poll(1.01, |m| out.push(m));
        assert_eq!(out.len(), 2);
        texts.poll(1.06, |m| out.push(m));
        let ids: Vec<_> = out
            .iter()
            .map(|m| match m {
                MavMessage::STATUSTEXT(t) => (t.id, t.chunk_seq),
                other => panic!("{other:?}"),
            })
            .collect();
        assert_eq!(ids, [(0, 0), (0, 1), (1, 0)]);
    }
}
