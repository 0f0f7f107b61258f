//! Which values of enumerated fields are acted on: the others that sources name are refused, or mean nothing here.

/// A field of enumerated values in a message from a CUCS: message, field, and the values that are acted on.
pub static VALUES: &[(u16, &str, &[u8])] = &[
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
];

/// The same of a fixed wing, where it differs.
pub static FIXED_WING: &[(u16, &str, &[u8])] = &[
    (
        2016,
        "Select Flight Path Control Mode",
        &[0, 2, 11, 12, 19, 20, 21, 23, 24],
    ),
    (2016, "Altitude Command Type", &[0, 1]),
    (2016, "Heading Command Type", &[0]),
    (2017, "Loiter Type", &[1]),
    (13003, "Waypoint Loiter Type", &[1]),
    (13003, "Loiter Direction", &[0, 1, 2]),
    (13003, "Loiter Duration Units", &[0, 1]),
];

/// The values of a field that are acted on; `None` where all are.
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
    use stanag_msgs::table;

    use super::*;

    #[test]
    fn values_are_those_of_honoured_fields_and_named_by_their_enumeration() {
        for (id, name, values) in VALUES.iter().chain(FIXED_WING) {
            let info = table::message(*id).expect("a message of the table");
            let field = info.field(name).expect("a field of the message");
            let honoured = crate::support::field(info, field).received;
            assert!(
                matches!(honoured, crate::support::Received::Honoured(_)),
                "{id} {name}"
            );
            let enumeration = field.enumeration.expect("an enumerated field");
            for value in *values {
                assert!(
                    enumeration.text(i64::from(*value)).is_some(),
                    "{id} {name} {value}"
                );
            }
        }
    }
}
