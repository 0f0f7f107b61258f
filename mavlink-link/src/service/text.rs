//! Whole texts from STATUSTEXT (253), whose long ones come in chunks of 50 bytes.
//!
//! PX4 ends a text with a tab when it also sends it as EVENT (410), for ground stations
//! that decode events. Without the vehicle's event metadata the text is all there is, so
//! it is kept and the tab removed; only a twin, the same text with and without a tab
//! within a second, is dropped.
//!
//! A text is one line, whatever its sender put into it ([`one_line`]): a line of its own in a log would be
//! taken for the log's.

use std::borrow::Cow;
use std::time::Duration;

use mavlink::dialects::development::{MavMessage, MavSeverity, STATUSTEXT_DATA};

use super::bounded::Bounded;
use crate::frame::Node;

/// A whole text.
#[derive(Clone, PartialEq, Debug)]
pub struct Text {
    /// Who sent it.
    pub from: Node,
    /// STATUSTEXT.severity
    pub severity: MavSeverity,
    /// The text as one line, with `…` where a chunk is missing. Bytes that are not UTF-8 are replaced.
    pub text: String,
    /// No chunk is missing.
    pub complete: bool,
    /// The vehicle sends the same as EVENT.
    pub is_event_twin: bool,
}

/// Assembles the texts of one system.
#[derive(Debug)]
pub struct Texts {
    system: u8,
    partial: Vec<Partial>,
    recent: Vec<Recent>,
    events: Bounded<Text>,
}

#[derive(Debug)]
struct Partial {
    from: Node,
    id: u16,
    severity: MavSeverity,
    /// By chunk_seq.
    chunks: Vec<Option<Vec<u8>>>,
    /// The number of chunks, once the last has arrived.
    total: Option<usize>,
    due: Duration,
}

#[derive(Debug)]
struct Recent {
    from: Node,
    /// STATUSTEXT.id, which a late copy of a chunk carries.
    id: u16,
    text: String,
    is_event_twin: bool,
    until: Duration,
}

impl Texts {
    /// For the texts of all components of `system`.
    pub const fn new(system: u8) -> Self {
        Self {
            system,
            partial: Vec::new(),
            recent: Vec::new(),
            events: Bounded::new(MAX_EVENTS),
        }
    }

    /// Takes a message of `from`; returns whether it was a text of this system.
    pub fn handle_message(&mut self, now: Duration, from: Node, message: &MavMessage) -> bool {
        let MavMessage::STATUSTEXT(data) = message else {
            return false;
        };
        if from.system != self.system {
            return false;
        }
        // STATUSTEXT.id 0: the text is whole in one message and has no chunks.
        if data.id == 0 {
            let text = joined(&[Some(chunk(data))], true);
            self.emit(now, from, 0, data.severity, (text, true));
        } else {
            self.handle_chunk(now, from, data);
        }
        true
    }

    /// Completes the texts whose missing chunks did not arrive in time.
    pub fn handle_timeout(&mut self, now: Duration) {
        self.recent.retain(|recent| recent.until > now);
        while let Some(place) = self.partial.iter().position(|p| p.due <= now) {
            self.complete(now, place);
        }
    }

    /// When [`Texts::handle_timeout`] is next needed.
    pub fn poll_timeout(&self) -> Option<Duration> {
        self.partial.iter().map(|partial| partial.due).min()
    }

    /// The next text.
    pub fn poll_event(&mut self) -> Option<Text> {
        self.events.pop()
    }

    fn handle_chunk(&mut self, now: Duration, from: Node, data: &STATUSTEXT_DATA) {
        let copy = |r: &Recent| r.from == from && r.id == data.id && r.until > now;
        // A late copy of a chunk would otherwise open a text that can never be completed.
        if self.recent.iter().any(copy) {
            return;
        }
        let same = |p: &Partial| p.from == from && p.id == data.id;
        let place = match self.partial.iter().position(same) {
            Some(place) => place,
            None => {
                // A sender that never ends its texts cannot grow the table.
                if self.partial.len() >= MAX_PARTIAL {
                    self.complete(now, 0);
                }
                self.partial.push(Partial {
                    from,
                    id: data.id,
                    severity: data.severity,
                    chunks: Vec::new(),
                    total: None,
                    due: now + PATIENCE,
                });
                self.partial.len() - 1
            }
        };
        let Some(partial) = self.partial.get_mut(place) else {
            return;
        };
        let seq = usize::from(data.chunk_seq);
        if partial.chunks.len() <= seq {
            partial.chunks.resize(seq + 1, None);
        }
        let bytes = chunk(data);
        // A NUL ends the text, and with it the chunks.
        if bytes.len() < data.text.len() {
            partial.total = Some(seq + 1);
        }
        partial.chunks[seq] = Some(bytes);
        if partial.is_whole() {
            self.complete(now, place);
        }
    }

    fn complete(&mut self, now: Duration, place: usize) {
        let partial = self.partial.remove(place);
        let whole = partial.is_whole();
        let ended = partial
            .total
            .is_some_and(|total| total <= partial.chunks.len());
        let text = joined(&partial.chunks, ended);
        let severity = partial.severity;
        self.emit(now, partial.from, partial.id, severity, (text, whole));
    }

    fn emit(
        &mut self,
        now: Duration,
        from: Node,
        id: u16,
        severity: MavSeverity,
        (text, complete): (String, bool),
    ) {
        let is_event_twin = text.ends_with('\t');
        let mut text = one_line(&text).into_owned();
        text.truncate(text.trim_end().len());
        if text.is_empty() {
            // A text of white space only has nothing to report.
            return;
        }
        self.recent.retain(|recent| recent.until > now);
        // Either version may arrive first: the one that comes second is dropped.
        let twin = self.recent.iter().any(|recent| {
            recent.from == from && recent.text == text && recent.is_event_twin != is_event_twin
        });
        if twin {
            return;
        }
        // Beyond this bound a twin is delivered twice; nothing is lost.
        if self.recent.len() < MAX_RECENT {
            self.recent.push(Recent {
                from,
                id,
                text: text.clone(),
                is_event_twin,
                until: now + PATIENCE,
            });
        }
        self.events.push(Text {
            from,
            severity,
            text,
            complete,
            is_event_twin,
        });
    }
}

impl Partial {
    fn is_whole(&self) -> bool {
        self.total == Some(self.chunks.len()) && self.chunks.iter().all(Option::is_some)
    }
}

/// A text as one line that reads as it stands: a space for each control character, and for each character that breaks the
/// line or turns its direction.
pub fn one_line(text: &str) -> Cow<'_, str> {
    if !text.contains(does_not_show) {
        return Cow::Borrowed(text);
    }
    Cow::Owned(text.replace(does_not_show, " "))
}

/// Beside control characters, line and paragraph separators, and the embeddings, overrides and isolates of Unicode's
/// bidirectional algorithm.
fn does_not_show(c: char) -> bool {
    c.is_control()
        || matches!(c, '\u{2028}' | '\u{2029}' | '\u{202a}'..='\u{202e}' | '\u{2066}'..='\u{2069}')
}

/// How long to wait for a missing chunk, and how long a text is remembered for its twin.
const PATIENCE: Duration = Duration::from_secs(1);
/// Incomplete texts. With one more, the oldest is delivered as it is.
const MAX_PARTIAL: usize = 8;
const MAX_RECENT: usize = 32;
const MAX_EVENTS: usize = 64;

fn chunk(data: &STATUSTEXT_DATA) -> Vec<u8> {
    data.text.iter().copied().take_while(|&o| o != 0).collect()
}

/// The chunks as one text; `ended` when the last one has arrived.
fn joined(chunks: &[Option<Vec<u8>>], ended: bool) -> String {
    let mut bytes = Vec::new();
    let mut gap = false;
    for chunk in chunks {
        match chunk {
            Some(chunk) => bytes.extend_from_slice(chunk),
            // One mark for a gap, however wide.
            None if !gap => bytes.extend_from_slice("…".as_bytes()),
            None => {}
        }
        gap = chunk.is_none();
    }
    if !ended {
        bytes.extend_from_slice("…".as_bytes());
    }
    String::from_utf8_lossy(&bytes).into_owned()
}
