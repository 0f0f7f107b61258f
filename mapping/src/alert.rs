//! Texts and faults as message 16000, Subsystem Status Alert.

use mavlink_link::dialect::MavSeverity;
use stanag_msgs::enums::{AlertPriority, AlertType, SubsystemId};
use stanag_msgs::messages::SubsystemStatusAlert;
use stanag_msgs::{Id, Text, TimeStamp};

/// A report to operators.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Alert {
    /// Identifies the alert; later ones of the same id are updates of it. Above 0.
    pub id: i32,
    /// How urgent.
    pub priority: AlertPriority,
    /// The part of the aircraft or the VSM that it is about.
    pub subsystem: SubsystemId,
    /// A text that an operator can act on.
    pub text: String,
    /// It stays until its cause is gone: no operator can clear it.
    pub lasting: bool,
}

/// Longest text of one 16000 (field Text: 80 bytes with the closing NUL).
pub const TEXT: usize = 79;

/// Longest text of a vehicle that is reported: three messages of 16000. PX4's longest texts and events fit; a STATUSTEXT in 256
/// chunks would be 162 messages, at the cost of what a station is sent of other vehicles.
pub const MAX_TEXT: usize = 3 * TEXT;

/// A text of a vehicle, at most [`MAX_TEXT`] characters; `…` stands for the rest.
#[must_use]
pub fn shortened(mut text: String) -> String {
    if text.chars().nth(MAX_TEXT).is_some() {
        let end = text.char_indices().nth(MAX_TEXT - 1);
        text.truncate(end.map_or(0, |(at, _)| at));
        text.push('…');
    }
    text
}

/// How many messages a text takes.
#[must_use]
pub fn count(text: &str) -> u32 {
    u32::try_from(split(text).len()).unwrap_or(u32::MAX)
}

/// The priority of a STATUSTEXT severity.
#[must_use]
pub fn priority(severity: MavSeverity) -> AlertPriority {
    use MavSeverity as S;
    match severity {
        S::MAV_SEVERITY_EMERGENCY | S::MAV_SEVERITY_ALERT => AlertPriority::Emergency,
        S::MAV_SEVERITY_CRITICAL | S::MAV_SEVERITY_ERROR => AlertPriority::Warning,
        S::MAV_SEVERITY_WARNING => AlertPriority::Caution,
        _ => AlertPriority::Nominal,
    }
}

/// The messages of an alert: one, or as many as its text needs, numbered by Append Order from 1.
///
/// `first` marks the first instance: its id is sent negative (1100.08).
pub fn messages(
    alert: &Alert,
    first: bool,
    mut stamp: impl FnMut() -> TimeStamp,
) -> impl Iterator<Item = SubsystemStatusAlert> {
    let parts = split(&alert.text);
    let total = u8::try_from(parts.len()).unwrap_or(u8::MAX);
    let cleared = alert.priority == AlertPriority::Cleared;
    let whole = SubsystemStatusAlert {
        data_link_id: Some(Id::NULL),
        priority: Some(alert.priority),
        subsystem_state_report_reference: Some(NO_MORE_INFO),
        subsystem_id: Some(alert.subsystem),
        alert_type: Some(if cleared {
            AlertType::Clear
        } else if alert.lasting {
            AlertType::NotClearable
        } else {
            AlertType::Clearable
        }),
        alert_warning_id: Some(if first { -alert.id } else { alert.id }),
        persistence: Some(if cleared { 0 } else { UNDEFINED_PERSISTENCE }),
        ..SubsystemStatusAlert::default()
    };
    parts
        .into_iter()
        .zip(1_u8..)
        .map(move |(text, order)| SubsystemStatusAlert {
            time_stamp: Some(stamp()),
            text: Some(Text::new(&text)),
            append_order: (total > 1).then_some(order),
            append_total_number: (total > 1).then_some(total),
            ..whole.clone()
        })
}

/// Splits at spaces if possible, into at most 255 parts. Each character beyond ASCII becomes one `?` on the wire, so
/// characters are counted, not bytes.
fn split(text: &str) -> Vec<String> {
    let mut parts: Vec<String> = vec![String::new()];
    for word in text.split_inclusive(' ') {
        let mut word: Vec<char> = word.chars().collect();
        let room = TEXT - parts.last().map_or(0, |part| part.chars().count());
        if word.len() > room && word.len() <= TEXT {
            parts.push(String::new());
        }
        while !word.is_empty() {
            let Some(part) = parts.last_mut() else { break };
            let room = TEXT - part.chars().count();
            let rest = word.split_off(room.min(word.len()));
            part.extend(word);
            word = rest;
            if !word.is_empty() {
                parts.push(String::new());
            }
        }
    }
    parts.truncate(usize::from(u8::MAX));
    parts
}

const NO_MORE_INFO: i32 = -1;
const UNDEFINED_PERSISTENCE: i8 = -1;

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_long_text_is_split_at_spaces_and_nothing_is_lost() {
        let text = "waypoint 17: 6123 m above home, expected -500 to 5000. ".repeat(4);
        let parts = split(&text);
        assert!(parts.len() > 2);
        assert!(parts.iter().all(|part| part.len() <= TEXT));
        assert_eq!(parts.concat(), text);
        assert_eq!(split(&"x".repeat(200)).concat(), "x".repeat(200));
        assert_eq!(split(""), [""]);
    }

    #[test]
    fn a_text_of_a_vehicle_takes_few_messages_and_shows_that_it_was_cut() {
        let whole = "ä".repeat(MAX_TEXT);
        assert_eq!(shortened(whole.clone()), whole);
        let cut = shortened("ä".repeat(MAX_TEXT + 1));
        assert_eq!(cut.chars().count(), MAX_TEXT);
        assert!(cut.ends_with("ä…"), "{cut}");
        assert_eq!(count(&shortened("x".repeat(12_800))), 3);
        assert_eq!((count(""), count("low battery")), (1, 1));
    }
}
