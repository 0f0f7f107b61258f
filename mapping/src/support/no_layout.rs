//! Messages of STANAG 4586 that are known by name alone: no public source has a layout, so nothing can be decoded.

use std::ops::RangeInclusive;

/// Messages that are known by their names alone.
#[derive(Debug, Clone)]
pub struct NoLayout {
    /// Their Message Types; `None` where not even these are known.
    pub ids: Option<RangeInclusive<u16>>,
    /// What is known of their names.
    pub name: &'static str,
    /// What this project has in their place.
    pub why: &'static str,
}

/// All of them, by rising type.
pub static NO_LAYOUT: &[NoLayout] = &[
    NoLayout {
        ids: Some(11_000..=11_002),
        name: "vehicle auxiliary, fuel, oil and hydraulic commands",
        why: "no source gives their fields, and no message of Edition 2.5 has them, from which they could be derived; what a vehicle has of it is \
              set by its parameters (50011)",
    },
    NoLayout {
        ids: Some(36_000..=39_999),
        name: "autonomy (Activity Constraint and others)",
        why: "no source gives their fields; commands that wait for a condition are the private messages 50020 to 50022",
    },
    NoLayout {
        ids: None,
        name: "a commanded wind, or a commanded icing area",
        why: "no source names a message; PX4 estimates the wind and takes none, and has neither a sensor of ice nor a protection from it",
    },
];

/// Why a message that is known by name alone cannot be read; `None` for any other.
#[must_use]
pub fn why_no_layout(message: u16) -> Option<String> {
    let mut all = NO_LAYOUT.iter();
    let one = all.find(|one| one.ids.as_ref().is_some_and(|ids| ids.contains(&message)))?;
    Some(format!(
        "message {message} ({}) has no known layout: {}",
        one.name, one.why
    ))
}

#[cfg(test)]
mod tests {
    use super::*;
    use stanag_msgs::table;

    #[test]
    fn what_has_a_layout_is_not_listed_without_one() {
        for message in table::MESSAGES {
            assert_eq!(why_no_layout(message.id), None, "{}", message.name);
        }
        assert!(why_no_layout(11_000).is_some_and(|why| why.contains("50011")));
        assert!(NO_LAYOUT.iter().all(|one| !one.why.is_empty()));
    }
}
