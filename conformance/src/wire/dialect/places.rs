//! Which message and field of one edition is which of the other, for messages that name messages.

use stanag_msgs::ed25;
use stanag_msgs::table::{Direction, MessageInfo};

use super::{LOITER_REPORT, PREFERENCE_REPORT};

/// The row of a message of Edition 2.5.
#[must_use]
pub fn row(kind: u16) -> Option<&'static MessageInfo> {
    ed25::message(kind.into(), ed25::Version::Ed25)
}

/// The messages of Edition 2.5 that hold what this one of Edition 4 holds: those whose time stamp is its.
#[must_use]
pub fn rows_of(kind: u16) -> Vec<&'static MessageInfo> {
    if kind == LOITER_REPORT {
        return row(PREFERENCE_REPORT).into_iter().collect();
    }
    ed25::messages()
        .filter(|info| {
            let stamp = info.fields.first().and_then(|field| field.ed4);
            stamp.is_some_and(|(message, _)| message == kind)
        })
        .collect()
}

/// The report of Edition 2.5 by which a VSM sends this message of Edition 4.
#[must_use]
pub fn report_of(kind: u16) -> Option<u16> {
    let sent = |info: &&&MessageInfo| info.direction != Direction::ToVsm;
    rows_of(kind).iter().find(sent).map(|info| info.id)
}

/// The message of Edition 4 that this one of Edition 2.5 corresponds to.
#[must_use]
pub fn kind_of(number: u16) -> Option<u16> {
    if number == PREFERENCE_REPORT {
        return Some(LOITER_REPORT);
    }
    row(number)?.ed4_messages.first().copied()
}

/// Message and field number of Edition 2.5 for those of Edition 4; field 0 is the whole message.
#[must_use]
pub fn field_of(kind: u16, number: u8) -> Option<(u16, u8)> {
    let mut all = ed25::messages();
    if number == 0 {
        return all
            .find(|info| info.ed4_messages.contains(&kind))
            .map(|info| (info.id, 0));
    }
    let known = stanag_msgs::table::message(kind);
    if known.is_some_and(|info| usize::from(number) > info.fields.len()) {
        // A field number that does not exist is kept, since it does not exist there either.
        return field_of(kind, 0).map(|(message, _)| (message, number));
    }
    all.find_map(|info| {
        let mut fields = info.fields.iter();
        let found = fields.find(|field| field.ed4 == Some((kind, number)))?;
        Some((info.id, found.bit + 1))
    })
}

/// Message and field number of Edition 4 for those of Edition 2.5; field 0 is the whole message.
#[must_use]
pub fn counterpart_of(number: u16, field: u8) -> Option<(u16, u8)> {
    let info = row(number)?;
    match usize::from(field).checked_sub(1) {
        None => Some((*info.ed4_messages.first()?, 0)),
        Some(index) => info.fields.get(index)?.ed4,
    }
}

/// Whether Edition 2.5 has a field for this one of Edition 4.
#[must_use]
pub fn has_field(kind: u16, name: &str) -> bool {
    if kind == LOITER_REPORT {
        return ["Time Stamp", "Loiter Radius"].contains(&name);
    }
    let number = stanag_msgs::table::message(kind)
        .and_then(|info| info.field(name))
        .map(|field| field.bit + 1);
    number.is_some_and(|number| field_of(kind, number).is_some())
}

/// The fields by which a message names a message and a field of it, in Edition 4 and in Edition 2.5. Field 0: it names none.
pub(super) const NAMING: &[Naming] = &[
    Naming::new(17_000, (3, 0), 1400, (8, 0)),
    Naming::new(17_001, (2, 0), 1402, (4, 0)),
    Naming::new(17_002, (5, 0), 1403, (7, 0)),
    Naming::new(40_000, (5, 6), 1200, (7, 8)),
    Naming::new(41_000, (7, 8), 1300, (7, 8)),
    Naming::new(41_001, (7, 8), 1301, (7, 8)),
    Naming::new(41_002, (7, 8), 1302, (7, 8)),
    Naming::new(44_003, (5, 6), 1303, (7, 8)),
];

/// A message that names a message, and in which fields.
#[derive(Clone, Copy, Debug)]
pub(super) struct Naming {
    pub(super) ed4: u16,
    /// Numbers of its fields: message and field.
    pub(super) ed4_fields: (u8, u8),
    pub(super) ed25: u16,
    pub(super) ed25_fields: (u8, u8),
}

impl Naming {
    const fn new(ed4: u16, ed4_fields: (u8, u8), ed25: u16, ed25_fields: (u8, u8)) -> Self {
        Self {
            ed4,
            ed4_fields,
            ed25,
            ed25_fields,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_go_there_and_back() {
        assert_eq!(report_of(4000), Some(101));
        assert_eq!(report_of(3004), Some(109));
        assert_eq!(report_of(16_002), None);
        assert_eq!(field_of(2016, 2), Some((42, 4)));
        assert_eq!(counterpart_of(42, 4), Some((2016, 2)));
        assert_eq!(field_of(3001, 0), Some((106, 0)));
        assert_eq!(counterpart_of(106, 0), Some((3001, 0)));
        assert!(has_field(3002, "Altitude Type"));
        assert!(!has_field(3002, "Commanded Loiter Position Latitude"));
    }

    #[test]
    fn the_fields_that_name_are_where_the_table_has_them() {
        for naming in NAMING {
            let info = row(naming.ed25).expect("a row");
            for (there, here) in [
                (naming.ed4_fields.0, naming.ed25_fields.0),
                (naming.ed4_fields.1, naming.ed25_fields.1),
            ] {
                if here == 0 {
                    continue;
                }
                let place = info.fields[usize::from(here) - 1].ed4;
                assert_eq!(place, Some((naming.ed4, there)), "#{} {here}", naming.ed25);
            }
        }
    }
}
