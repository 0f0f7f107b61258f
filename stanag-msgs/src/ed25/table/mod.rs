//! The messages of Edition 2.5, one row each, a file for each group.
//!
//! A row has the clause and the table of the text, the levels of interoperability that must support the message, and for
//! each field the place that Edition 4 has for the same: message and field number, where one is known.

mod configuration;
mod data_link;
mod flight_command;
mod flight_status;
mod general;
mod mission;
mod payload;
mod private;
mod rows;
mod subsystems;
mod system_id;

use super::Version;
use crate::table::{self, MessageInfo};

/// The groups, in the order of their message types.
static GROUPS: [&[MessageInfo]; 10] = [
    system_id::GROUP,
    flight_command::GROUP,
    flight_status::GROUP,
    payload::GROUP,
    data_link::GROUP,
    mission::GROUP,
    subsystems::GROUP,
    configuration::GROUP,
    general::GROUP,
    private::GROUP,
];

/// Every message, in the order of the Message Types.
pub fn messages() -> impl Iterator<Item = &'static MessageInfo> {
    GROUPS.into_iter().flatten()
}

/// A message type of any edition for people: `13000 (Mission Transfer Command)`; for one that only Edition 2.5 has,
/// `#800 (Mission Upload Command)`.
#[must_use]
pub fn named(message_type: u16) -> String {
    let own = messages().find(|info| info.id == message_type);
    match own.filter(|_| table::message(message_type).is_none()) {
        Some(info) => format!("#{message_type} ({})", info.name),
        None => table::named(message_type),
    }
}

/// The message of this type in a datagram of this version, where the table has it.
///
/// The versions differ in one layout: Amendment 1 has no field 5 in #1501.
pub fn message(message_type: u32, version: Version) -> Option<&'static MessageInfo> {
    let found = messages().find(|message| u32::from(message.id) == message_type)?;
    if message_type == 1501 && version == Version::Amendment1 {
        return Some(&IDENT_OF_AMENDMENT_1);
    }
    Some(found)
}

/// #1501 of Amendment 1: without its last field, Ident Enable Duration.
static IDENT_OF_AMENDMENT_1: MessageInfo = {
    let mut message = general::GROUP[5];
    assert!(message.id == 1501);
    message.fields = message.fields.split_at(4).0;
    message
};

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn groups_are_in_the_order_of_their_types() {
        let ids: Vec<_> = messages().map(|message| message.id).collect();
        assert!(ids.is_sorted_by(|low, high| low < high), "{ids:?}");
        // Those of the text, and those of this project.
        assert_eq!(ids.len(), 79 + 3);
    }

    #[test]
    fn amendment_1_drops_one_field_of_1501() {
        let length = |version| message(1501, version).unwrap().full_bytes();
        assert_eq!((length(Version::Ed25), length(Version::Ed2)), (19, 19));
        assert_eq!(length(Version::Amendment1), 17);
        assert!(message(2000, Version::Ed25).is_none());
    }
}
