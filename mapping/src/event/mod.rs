//! The vehicle's events (EVENT, 410) as texts for operators: from the metadata that the vehicle carries, or without it.
//!
//! An event is a number and packed arguments; what it means is in a file of the firmware that sends it. [`find`] names that
//! file in the vehicle's general metadata, [`Catalogue::read`] reads it, [`unpack`] undoes how both are packed.
//! `definition` holds the file's form, `text` makes a sentence of a message and its arguments.

mod definition;
mod packed;
mod text;

use mavlink_link::service::event::Received;
use stanag_msgs::enums::AlertPriority;

pub use self::definition::{Catalogue, Definitions, MetadataError, find, path_of};
pub use self::packed::{MAX_UNPACKED, UnpackError, unpack};

/// What an event is for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Group {
    /// For the operator.
    Default,
    /// Part of a report on health or on the checks before arming.
    Check,
    /// Of a protocol between programs, or of a group that is not known: no operator is shown it.
    Other,
}

/// An event with its meaning.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Described {
    /// What it is for.
    pub group: Group,
    /// The message with its arguments.
    pub text: String,
}

/// An event that means something else than the vehicle's own text of it, whatever metadata there is.
#[must_use]
pub fn reworded(event: &Received) -> Option<Described> {
    (event.id == TAKEN_OVER).then(|| Described {
        group: Group::Default,
        text: "the vehicle has ended its failsafe for a mode that was commanded, or for a pilot's sticks".to_owned(),
    })
}

/// "Pilot took over using sticks" of PX4's failsafe, which it sends for each mode that is commanded in it, too
/// (FailsafeBase::getSelectedAction). That of its commander (`commander_rc_override`) is about sticks alone.
const TAKEN_OVER: u32 = id_of("failsafe_rc_override");

/// The priority of an event's external level; `None`: no operator is shown it (debug, and what is for programs).
#[must_use]
pub fn priority(level: u8) -> Option<AlertPriority> {
    match level {
        0 | 1 => Some(AlertPriority::Emergency),
        2 | 3 => Some(AlertPriority::Warning),
        4 => Some(AlertPriority::Caution),
        5 | 6 => Some(AlertPriority::Nominal),
        _ => None,
    }
}

/// An event without metadata: its numbers, for somebody who looks them up.
#[must_use]
pub fn plain(event: &Received) -> String {
    let used = event
        .arguments
        .iter()
        .rposition(|byte| *byte != 0)
        .map_or(0, |last| last + 1);
    let arguments: String = event.arguments[..used]
        .iter()
        .map(|byte| format!("{byte:02x}"))
        .collect();
    let level = LEVELS.get(usize::from(event.level)).unwrap_or(&"unknown");
    let arguments = if arguments.is_empty() {
        String::from("no arguments")
    } else {
        format!("arguments {arguments}")
    };
    format!(
        "vehicle event {} of component {}, {level}: {arguments}",
        event.id & 0xff_ffff,
        event.id >> 24,
    )
}

/// Whether a STATUSTEXT and an event have the same meaning. PX4 words most of them alike, some with one word or two
/// different, and numbers with other units: more than half of the words of the shorter one must be in the other.
#[must_use]
pub fn says_the_same(one: &str, other: &str) -> bool {
    let (one, other) = (words(one), words(other));
    let (short, long) = if one.len() <= other.len() {
        (one, other)
    } else {
        (other, one)
    };
    let common = short.iter().filter(|word| long.contains(word)).count();
    !short.is_empty() && common * 2 > short.len()
}

fn words(text: &str) -> Vec<String> {
    let all = text.split(|c: char| !c.is_ascii_alphabetic());
    let mut words: Vec<String> = all
        .filter(|word| word.len() >= 3)
        .map(str::to_ascii_lowercase)
        .collect();
    words.sort_unstable();
    words.dedup();
    words
}

/// PX4's `commander_arming_check_summary`: a report on health and arming checks begins.
pub const CHECKS_BEGIN: u32 = id_of("commander_arming_check_summary");
/// PX4's `commander_health_summary`: it ends.
pub const CHECKS_END: u32 = id_of("commander_health_summary");

/// The id that PX4's build gives an event of its autopilot: 24 bits of FNV-1a of its name, and component 1.
#[must_use]
pub const fn id_of(name: &str) -> u32 {
    let bytes = name.as_bytes();
    let (mut hash, mut at) = (0x811c_9dc5_u32, 0);
    while at < bytes.len() {
        hash = (hash ^ bytes[at] as u32).wrapping_mul(0x0100_0193);
        at += 1;
    }
    (hash & 0xff_ffff) | 1 << 24
}

const LEVELS: [&str; 10] = [
    "emergency",
    "alert",
    "critical",
    "error",
    "warning",
    "notice",
    "info",
    "debug",
    "protocol",
    "disabled",
];

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ids_are_those_of_px4s_build() {
        // From all_events.json of PX4 v1.18.
        assert_eq!(id_of("commander_load_param_failed"), 1 << 24 | 10_044_444);
        assert_eq!(id_of("check_modes_global_pos"), 1 << 24 | 10_011_251);
    }

    #[test]
    fn a_failsafe_that_a_commanded_mode_ends_is_not_a_pilots() {
        let event = |name| Received {
            id: id_of(name),
            sequence: 1,
            level: 6,
            arguments: [0; 40],
        };
        let known = reworded(&event("failsafe_rc_override")).expect("its text");
        assert!(known.text.contains("a mode that was commanded, or"));
        assert_eq!(reworded(&event("commander_rc_override")), None);
    }

    #[test]
    fn texts_that_px4_sends_twice_are_recognised_and_others_are_not() {
        for (text, event) in [
            ("Landing detected", "Landing detected"),
            (
                "Connection to ground station lost",
                "Connection to ground control station lost",
            ),
            (
                "Climb to 12.3 meters above home",
                "Climb to 12.3 m above home",
            ),
            (
                "Mission rejected: item 3: unsupported cmd: 7",
                "Mission rejected: item 3: unsupported command: 7",
            ),
        ] {
            assert!(says_the_same(text, event), "{text}");
        }
        assert!(!says_the_same(
            "Landing detected",
            "Armed by external command"
        ));
        assert!(!says_the_same("Low battery", "GPS fix lost"));
        assert!(!says_the_same("Landing detected", "Takeoff detected"));
        assert!(!says_the_same("", ""));
    }

    #[test]
    fn without_metadata_the_numbers_are_the_text() {
        let mut arguments = [0; 40];
        arguments[..2].copy_from_slice(&[7, 255]);
        let mut event = Received {
            id: 1 << 24 | 42,
            sequence: 1,
            level: 4,
            arguments,
        };
        let text = "vehicle event 42 of component 1, warning: arguments 07ff";
        assert_eq!(plain(&event), text);
        event.arguments = [0; 40];
        event.level = 15;
        assert_eq!(
            plain(&event),
            "vehicle event 42 of component 1, unknown: no arguments"
        );
    }
}
