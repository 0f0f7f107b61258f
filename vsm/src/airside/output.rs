//! The agent's output: frames for its two links, lines for the log, and texts for the ground.

use std::collections::VecDeque;
use std::time::Duration;

use mavlink_link::dialect::MavSeverity;
use mavlink_link::link::Alert;

use crate::session::{LogLevel, Peer, link_alert_text};

/// One of the agent's two links.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Side {
    /// To the ground.
    Radio,
    /// To PX4.
    Px4,
}

/// A frame in the caller's buffer, ready to be sent.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Transmit {
    /// The link to send it on.
    pub side: Side,
    /// Its destination.
    pub to: Peer,
    /// Its bytes in the buffer.
    pub len: usize,
    /// It holds a key: wipe the buffer once it is sent.
    pub secret: bool,
}

/// A line for the log.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Note {
    /// Its severity.
    pub level: LogLevel,
    /// What happened.
    pub text: String,
}

impl Transmit {
    pub(super) fn new(side: Side, to: Peer, len: usize) -> Transmit {
        Transmit {
            side,
            to,
            len,
            secret: false,
        }
    }
}

/// News for people. Anybody on a link can cause entries at will: those that find no room are dropped, and counted by a line.
#[derive(Debug, Default)]
pub(super) struct Reports {
    notes: VecDeque<Note>,
    texts: VecDeque<(MavSeverity, String)>,
    /// How many lines, and texts for the ground, found no room.
    left_out: (u64, u64),
}

impl Reports {
    /// A line for the log.
    pub(super) fn note(&mut self, level: LogLevel, text: impl Into<String>) {
        if self.notes.len() < MAX_NOTES {
            let text = text.into();
            self.notes.push_back(Note { level, text });
        } else {
            self.left_out.0 += 1;
        }
    }

    pub(super) fn note_alert(&mut self, link: &str, alert: Alert) {
        let text = match alert {
            Alert::Unanswered => "it is received, but receives nothing from us",
            Alert::Copied => "somebody on the way copies its frames and delivers them first",
            Alert::VehicleUnsigned | Alert::StaysBehind => "stamps or signatures are missing",
            other => link_alert_text(other),
        };
        self.note(LogLevel::Warning, format!("{link}: {text}"));
    }

    /// The signing clock has moved to that of one of the two other ends.
    pub(super) fn note_clock(&mut self, whose: &str, ahead: Duration) {
        let text = format!(
            "the signing clock moved {:.0} s ahead, to that of {whose}: a computer started with a wrong clock",
            ahead.as_secs_f64()
        );
        self.note(LogLevel::Warning, text);
    }

    /// A text for the ground, which alerts its operators. It is cut to the 50 bytes that one STATUSTEXT holds.
    pub(super) fn alert_ground(&mut self, severity: MavSeverity, text: impl Into<String>) {
        if self.texts.len() < MAX_TEXTS {
            let mut text: String = text.into();
            // Then each character is one byte, so truncating cannot split one.
            text.retain(|character| character.is_ascii());
            text.truncate(MAX_TEXT_BYTES);
            self.texts.push_back((severity, text));
        } else {
            self.left_out.1 += 1;
        }
    }

    pub(super) fn poll_note(&mut self) -> Option<Note> {
        if let Some(note) = self.notes.pop_front() {
            return Some(note);
        }
        let (lines, texts) = std::mem::take(&mut self.left_out);
        (lines > 0 || texts > 0).then(|| Note {
            level: LogLevel::Warning,
            text: format!(
                "too much at once: {lines} lines are not logged, {texts} texts not sent to the ground"
            ),
        })
    }

    pub(super) fn poll_text(&mut self) -> Option<(MavSeverity, String)> {
        self.texts.pop_front()
    }
}

const MAX_NOTES: usize = 256;
const MAX_TEXTS: usize = 16;
const MAX_TEXT_BYTES: usize = 50;

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lines_and_texts_that_find_no_room_are_counted_by_a_line() {
        let mut reports = Reports::default();
        for n in 0..MAX_NOTES + 3 {
            reports.note(LogLevel::Info, n.to_string());
        }
        for n in 0..=MAX_TEXTS {
            reports.alert_ground(MavSeverity::MAV_SEVERITY_NOTICE, n.to_string());
        }
        let notes: Vec<Note> = std::iter::from_fn(|| reports.poll_note()).collect();
        assert_eq!(notes.len(), MAX_NOTES + 1);
        let last = notes.last().expect("a line");
        assert_eq!(
            last.text,
            "too much at once: 3 lines are not logged, 1 texts not sent to the ground"
        );
    }
}
