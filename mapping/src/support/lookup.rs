//! The facts about a message, a field, the values of a field.

use stanag_msgs::table::{Direction, FieldInfo, Layout, MessageInfo};

use super::facts::SUPPORT;
use super::row::MessageSupport;

/// The effect of a field of a message from a CUCS.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Received {
    /// It has this effect.
    Honoured(&'static str),
    /// Accepted, kept where the message is kept, and without effect.
    Ignored,
    /// The whole message is refused.
    Refused,
    /// A CUCS never sends it.
    Never,
}

/// The support of one field.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct FieldSupport {
    /// What fills it where this VSM sends it.
    pub sent: Option<&'static str>,
    /// Its effect on receipt.
    pub received: Received,
}

/// The row of a message, where it has one.
#[must_use]
pub fn message(id: u16) -> Option<&'static MessageSupport> {
    rows().find(|row| row.id == id)
}

/// All rows, in the order of their types.
pub fn rows() -> impl Iterator<Item = &'static MessageSupport> {
    SUPPORT.iter().copied().flatten()
}

/// The support of a field.
#[must_use]
pub fn field(message: &MessageInfo, field: &FieldInfo) -> FieldSupport {
    let row = self::message(message.id);
    let find = |fields: &[(&str, &'static str)]| {
        fields
            .iter()
            .find(|(name, _)| *name == field.name)
            .map(|(_, what)| *what)
    };
    let received = match row {
        _ if message.direction == Direction::ToCucs => Received::Never,
        Some(row) if !row.taken.is_empty() => match find(row.honoured) {
            Some(how) => Received::Honoured(how),
            None => Received::Ignored,
        },
        _ => Received::Refused,
    };
    FieldSupport {
        sent: row.and_then(|row| find(row.sent)),
        received,
    }
}

/// Whether a message's layout is derived from Edition 2, so that `dli.provisional` applies.
#[must_use]
pub fn provisional(message: &MessageInfo) -> bool {
    message.layout == Layout::Ed2Derived
}

/// Enumerated fields of messages from a CUCS: message, field, and the values that have an effect.
static VALUES: &[(u16, &str, &[u8])] = &[
    (1, "Requested/Handover Access", &[0, 1, 2]),
    (2008, "Engine Command", &[0, 1, 2]),
    (2008, "Reverse Thrust", &[0, 3]),
    (2008, "Reverse Thrust Power", &[0, 2]),
    (2008, "Ignition Switch Power", &[0, 2]),
    (2008, "Ignition Switch Activation", &[0, 2]),
    (
        2016,
        "Select Flight Path Control Mode",
        &[0, 2, 11, 12, 15, 19, 20, 21, 23, 24],
    ),
    (2016, "Altitude Command Type", &[0, 1, 2, 3]),
    (2016, "Heading Command Type", &[0, 1, 2, 3, 5]),
    (2016, "Heading Reference", &[0]),
    (2016, "Speed Type", &[0, 1, 2]),
    (2016, "Altitude Type", &[0, 1, 2, 3]),
    (2017, "Loiter Type", &[1, 4]),
    (2017, "Loiter Direction", &[0, 1, 2]),
    (13000, "Mission Plan Mode", &[1, 2, 3, 4, 5]),
    (13001, "Route Type", &[0, 1, 2, 3, 4]),
    (13002, "Location Type", &[0]),
    (13002, "Waypoint Altitude Type", &[0, 1, 2, 3]),
    (13002, "Waypoint Speed Type", &[0, 1, 2]),
    (13002, "Turn Type", &[0, 1]),
    (13002, "Waypoint Type", &[0, 1]),
    (13002, "Limit Type", &[0, 1]),
    (13003, "Waypoint Loiter Type", &[1, 4]),
    (13003, "Loiter Duration Units", &[0]),
    (19001, "Set Zoom", &[0, 1, 2, 3]),
    (19001, "Altitude Type", &[0, 1, 2, 3]),
    (19001, "Set Focus", &[0, 1, 2]),
    (19001, "Focus Type", &[0, 1]),
    (19100, "Image Output", &[1, 2]),
    (19100, "Set EO/IR Pointing Mode", &[0, 1, 2, 3, 4]),
    (19100, "Fire Laser Pointer", &[0]),
    (19100, "Fire Laser Rangefinder", &[0]),
    (19100, "Initiate Laser Designator", &[0]),
];

/// The same for a fixed wing, where it differs.
static FIXED_WING: &[(u16, &str, &[u8])] = &[
    (2016, "Altitude Command Type", &[0, 1]),
    (2016, "Heading Command Type", &[0, 2]),
    (2017, "Loiter Type", &[1, 3]),
    (13003, "Waypoint Loiter Type", &[1]),
    (13003, "Loiter Direction", &[0, 1, 2]),
    (13003, "Loiter Duration Units", &[0, 1]),
];

/// The values of a field that have an effect; `None` where all have.
#[must_use]
pub fn values(message: u16, field: &str, hovers: bool) -> Option<&'static [u8]> {
    let own = if hovers { &[] } else { FIXED_WING };
    own.iter()
        .chain(VALUES)
        .find(|(id, name, _)| *id == message && *name == field)
        .map(|(_, _, values)| *values)
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use mavlink::{MavlinkVersion, Message as _};
    use mavlink_link::dialect::MavMessage;
    use stanag_msgs::table;

    use super::*;
    use crate::telemetry::Telemetry;

    #[test]
    fn rows_are_in_order_and_name_messages_and_fields_of_the_table() {
        assert!(rows().is_sorted_by_key(|row| row.id));
        for row in rows() {
            let info = table::message(row.id).expect("a message of the table");
            for (name, what) in row.honoured.iter().chain(row.sent) {
                assert!(info.field(name).is_some(), "{} {name}", row.id);
                assert!(!what.is_empty(), "{} {name}", row.id);
            }
            assert!(
                row.honoured.is_empty() || !row.taken.is_empty(),
                "{}",
                row.id
            );
            assert_eq!(row.sends.is_empty(), row.sent.is_empty(), "{}", row.id);
            for fields in [row.honoured, row.sent] {
                for (index, (name, _)) in fields.iter().enumerate() {
                    assert!(fields[..index].iter().all(|(other, _)| other != name));
                }
            }
        }
    }

    #[test]
    fn directions_agree_with_the_table() {
        for row in rows() {
            let info = table::message(row.id).expect("a message of the table");
            assert!(
                row.taken.is_empty() || info.direction != Direction::ToCucs,
                "{} is never sent by a CUCS",
                row.id
            );
            // A request for control (4) is passed on to the CUCS that holds it.
            assert!(
                row.sends.is_empty() || info.direction != Direction::ToVsm || row.id == 4,
                "{} is never sent by a VSM",
                row.id
            );
        }
    }

    #[test]
    fn a_field_is_one_of_the_four() {
        let of = |id: u16, name: &str| {
            let info = table::message(id).expect("a message");
            field(info, info.field(name).expect("a field"))
        };
        assert!(matches!(
            of(13002, "Turn Type").received,
            Received::Honoured(_)
        ));
        assert!(of(13002, "Turn Type").sent.is_some());
        assert_eq!(of(13002, "Activity ID").received, Received::Ignored);
        assert_eq!(
            of(2000, "Initial Propulsion Energy").received,
            Received::Refused
        );
        assert_eq!(of(4000, "Latitude").received, Received::Never);
        assert!(of(4000, "Latitude").sent.is_some());
        assert!(of(4000, "Magnetic Variation").sent.is_none());
    }

    #[test]
    fn values_are_those_of_honoured_fields_and_named_by_their_enumeration() {
        for (id, name, values) in VALUES.iter().chain(FIXED_WING) {
            let info = table::message(*id).expect("a message of the table");
            let known = info.field(name).expect("a field of the message");
            let honoured = field(info, known).received;
            assert!(matches!(honoured, Received::Honoured(_)), "{id} {name}");
            let enumeration = known.enumeration.expect("an enumerated field");
            for value in *values {
                assert!(
                    enumeration.text(i64::from(*value)).is_some(),
                    "{id} {name} {value}"
                );
            }
        }
    }

    /// The words of a row's texts that look like MAVLink names: capitals and underscores.
    fn mavlink_words(row: &MessageSupport) -> impl Iterator<Item = &'static str> {
        let fields = row.honoured.iter().chain(row.sent).map(|(_, what)| *what);
        let texts = fields.chain([row.taken, row.sends]);
        texts
            .flat_map(|text| text.split(|c: char| !(c.is_ascii_alphanumeric() || c == '_')))
            .filter(|word| word.len() > 3 && word.chars().all(|c| !c.is_ascii_lowercase()))
            .filter(|word| word.chars().any(|c| c.is_ascii_uppercase()))
    }

    /// The names of the dialect's commands, as COMMAND_LONG carries them.
    fn commands() -> BTreeSet<String> {
        let named = |id: u16| {
            let mut payload = [0; 33];
            payload[28..30].copy_from_slice(&id.to_le_bytes());
            match MavMessage::parse(MavlinkVersion::V2, COMMAND_LONG, &payload) {
                Ok(MavMessage::COMMAND_LONG(command)) => Some(format!("{:?}", command.command)),
                _ => None,
            }
        };
        (0..=u16::MAX).filter_map(named).collect()
    }

    const COMMAND_LONG: u32 = 76;

    #[test]
    fn every_message_that_telemetry_keeps_is_named_as_a_source() {
        let named: BTreeSet<&str> = rows().flat_map(mavlink_words).collect();
        let kept = (0..=20_000).filter_map(|id| {
            // An empty payload stands for zeros.
            let message = MavMessage::parse(MavlinkVersion::V2, id, &[]).ok()?;
            Telemetry::default()
                .update(&message)
                .then(|| message.message_name())
        });
        let missing: Vec<&str> = kept.filter(|name| !named.contains(name)).collect();
        assert!(missing.is_empty(), "{missing:?}");
    }

    #[test]
    fn names_of_mavlink_are_those_of_the_dialect_and_of_px4() {
        let commands = commands();
        for row in rows() {
            for word in mavlink_words(row).filter(|word| word.contains('_')) {
                let known = MavMessage::message_id_from_name(word).is_some()
                    || commands.contains(&format!("MAV_CMD_{word}"))
                    || crate::parameter::range(word).is_some();
                assert!(known, "{word} of {}", row.id);
            }
        }
    }
}
