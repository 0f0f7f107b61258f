//! What this VSM does with each field of each message: the one source of the support table (`docs/reference/support.md`), of the
//! answers of the configuration phase that say what is not supported, and of the tests that hold both to the truth.
//!
//! A message that is not listed is neither sent nor acted on: one for the VSM is refused, with 16000 saying so.

mod facts;
mod values;

use stanag_msgs::table::{self, Direction, FieldInfo, Layout, MessageInfo};

pub use facts::SUPPORT;
pub use values::{FIXED_WING, VALUES, values};

/// What is done with one message.
#[derive(Debug, Clone, Copy)]
pub struct MessageSupport {
    /// Its Message Type.
    pub id: u16,
    /// What it leads to when it comes from a CUCS; empty where it is not taken.
    pub taken: &'static str,
    /// When it is sent; empty where it never is.
    pub sends: &'static str,
    /// The fields that change what is done, and how. The others are looked at by nobody.
    pub honoured: &'static [(&'static str, &'static str)],
    /// The fields that are filled, and from what. The others are absent.
    pub sent: &'static [(&'static str, &'static str)],
}

/// What is done with a field of a message that comes from a CUCS.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Received {
    /// Acted on, in this way.
    Honoured(&'static str),
    /// Taken, kept where the message is kept, and without effect.
    Ignored,
    /// The whole message is refused.
    Refused,
    /// It never comes from a CUCS.
    Never,
}

/// What is done with one field.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct FieldSupport {
    /// What it is filled from where this VSM sends it.
    pub sent: Option<&'static str>,
    /// What is done with it on receipt.
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

/// What is done with a field.
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

/// Whether a message's layout is derived from Edition 2 and so subject to `dli.provisional`.
#[must_use]
pub fn provisional(message: &MessageInfo) -> bool {
    message.layout == Layout::Ed2Derived
}

/// Every message for a VSM, with whether this one takes it: what 44003 says message by message.
pub fn uplink() -> impl Iterator<Item = (&'static MessageInfo, bool)> {
    table::MESSAGES
        .iter()
        .filter(|info| info.direction != Direction::ToCucs)
        .map(|info| {
            let taken = message(info.id).is_some_and(|row| !row.taken.is_empty());
            (info, taken)
        })
}

#[cfg(test)]
mod tests {
    use super::*;

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
            // A wish for control (4) is passed on to who holds it.
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
            of(2005, "Flight Termination Mode").received,
            Received::Refused
        );
        assert_eq!(of(4000, "Latitude").received, Received::Never);
        assert!(of(4000, "Latitude").sent.is_some());
        assert!(of(4000, "Magnetic Variation").sent.is_none());
    }
}
