//! Why a message of Edition 4 that a CUCS may send is refused as a whole.

static REFUSED: &[(&[u16], &str)] = &[
    (
        &[2000],
        "the configuration of the vehicle is set in its parameters",
    ),
    (
        &[2007],
        "PX4 has no command for lights: they show its state",
    ),
    (
        &[5000, 5001],
        "no transponder is connected to this VSM: PX4 reports the state of none",
    ),
    (
        &[13_005],
        "PX4's missions switch no lights and no data links, and their actuator items would move the outputs 5 and 6 too",
    ),
    (&[19_200], "no radar is connected to this VSM"),
    (
        &[42_000],
        "there are no remote displays beside the status page",
    ),
];

/// The reason, where there is one besides "not supported".
#[must_use]
pub fn why_refused(message: u16) -> Option<&'static str> {
    let mut reasons = REFUSED.iter();
    let (_, why) = reasons.find(|(ids, _)| ids.contains(&message))?;
    Some(why)
}

#[cfg(test)]
mod tests {
    use stanag_msgs::table::{self, Direction};

    use super::*;
    use crate::support;

    #[test]
    fn reasons_are_of_messages_that_a_cucs_may_send_and_none_of_which_is_taken() {
        for id in REFUSED.iter().flat_map(|(ids, _)| *ids) {
            let info = table::message(*id).expect("a message of the table");
            assert_ne!(info.direction, Direction::ToCucs, "{id}");
            assert!(
                support::message(*id).is_none_or(|row| row.taken.is_empty()),
                "{id}"
            );
        }
    }
}
