//! The groups of messages that an entry of the access list allows.

use std::fmt;
use std::str::FromStr;

use stanag_msgs::Message;
use stanag_msgs::enums::{ContingencyAction, LoiBitmap};

/// A group of messages. Its order is that of the lines of a list.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Group {
    /// Status and queries: messages that need LOI 2. Every other group includes it.
    Monitor,
    /// Commands to payload stations: messages that need LOI 3.
    Payload,
    /// Routes, waypoints and areas, and loading them.
    Plan,
    /// Everything else that needs LOI 4: modes, loiter, sticks, set points, lights.
    Fly,
    /// Parameters of the vehicle (50011).
    Settings,
    /// Launch, landing and engine: messages that need LOI 5, except for the next two groups.
    Launch,
    /// Flight termination (2005).
    Terminate,
    /// Erasing keys, plans and logs (50024).
    Zeroize,
}

impl Group {
    /// All of them.
    pub const ALL: [Group; 8] = [
        Group::Monitor,
        Group::Payload,
        Group::Plan,
        Group::Fly,
        Group::Settings,
        Group::Launch,
        Group::Terminate,
        Group::Zeroize,
    ];

    /// Its name in a list.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Group::Monitor => "monitor",
            Group::Payload => "payload",
            Group::Plan => "plan",
            Group::Fly => "fly",
            Group::Settings => "settings",
            Group::Launch => "launch",
            Group::Terminate => "terminate",
            Group::Zeroize => "zeroize",
        }
    }

    /// Its byte in a MAC; these values never change.
    pub(super) const fn code(self) -> u8 {
        match self {
            Group::Monitor => 1,
            Group::Payload => 2,
            Group::Plan => 3,
            Group::Fly => 4,
            Group::Settings => 5,
            Group::Launch => 6,
            Group::Terminate => 7,
            Group::Zeroize => 8,
        }
    }

    /// The level that its messages need: a CUCS with the group may hold it.
    #[must_use]
    pub const fn level(self) -> LoiBitmap {
        match self {
            Group::Monitor => LoiBitmap::LOI2,
            Group::Payload => LoiBitmap::LOI3,
            Group::Plan | Group::Fly | Group::Settings => LoiBitmap::LOI4,
            Group::Launch | Group::Terminate | Group::Zeroize => LoiBitmap::LOI5,
        }
    }

    /// A further group that a message needs: a CUCS that may not land the aircraft must not configure an automatic landing
    /// either.
    pub(crate) fn besides(message: &Message) -> Option<Group> {
        match message {
            Message::Contingency(one)
                if one.contingency_action == Some(ContingencyAction::Landing) =>
            {
                Some(Group::Launch)
            }
            _ => None,
        }
    }

    /// The group of a message that needs this right. Messages that need LOI 4 are listed by name; any other is in `launch`,
    /// the narrowest group.
    pub(crate) fn of(message: &Message, right: LoiBitmap) -> Group {
        match message {
            Message::FlightTerminationCommand(_) => Group::Terminate,
            Message::ZeroizeCommand(_) => Group::Zeroize,
            Message::ParameterSetCommand(_) => Group::Settings,
            Message::MissionTransferCommand(_)
            | Message::UaRoute(_)
            | Message::UaPositionWaypoint(_)
            | Message::UaLoiterWaypoint(_)
            // It also needs LOI 3 of its station, which only `payload` gives.
            | Message::PayloadActionWaypoint(_)
            | Message::VehicleSpecificWaypoint(_)
            | Message::CurveSegment(_)
            | Message::CurveSegmentPaper(_)
            | Message::AreaVertex(_)
            | Message::AreaTransferCommand(_) => Group::Plan,
            Message::VehicleOperatingModeCommand(_) if right == LoiBitmap::LOI4 => Group::Fly,
            Message::LoiterConfiguration(_)
            | Message::UaStickCommand(_)
            | Message::UnmannedAircraftLights(_)
            | Message::Contingency(_)
            | Message::HoldCommand(_) => Group::Fly,
            _ if right == LoiBitmap::LOI2 => Group::Monitor,
            _ if right == LoiBitmap::LOI3 => Group::Payload,
            _ => Group::Launch,
        }
    }
}

impl fmt::Display for Group {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(self.name())
    }
}

impl FromStr for Group {
    type Err = UnknownGroup;

    fn from_str(text: &str) -> Result<Group, UnknownGroup> {
        let found = Group::ALL.into_iter().find(|group| group.name() == text);
        found.ok_or_else(|| UnknownGroup(text.to_owned()))
    }
}

/// Not the name of a group.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("{0:?} is not a group of messages: expected {EXPECTED}")]
pub struct UnknownGroup(String);

pub(super) const EXPECTED: &str =
    "monitor, payload, plan, fly, settings, launch, terminate or zeroize";

#[cfg(test)]
mod tests {
    use super::*;
    use crate::session::authority::right_for;

    #[test]
    fn each_group_has_a_name_and_a_code_of_its_own() {
        assert_eq!(EXPECTED.replace(" or ", ", ").split(", ").count(), 8);
        for (n, group) in (1..).zip(Group::ALL) {
            assert_eq!(group.code(), n);
            assert_eq!(group.name().parse(), Ok(group));
            assert!(EXPECTED.contains(group.name()));
        }
        assert!("Fly".parse::<Group>().is_err());
    }

    #[test]
    fn every_message_is_in_a_group_of_the_right_that_it_needs() {
        let mut seen = 0;
        for message in (0..=u16::MAX).filter_map(Message::empty) {
            let Some(right) = right_for(&message, None) else {
                continue;
            };
            let group = Group::of(&message, right);
            assert_eq!(group.level(), right, "{}: {group}", message.id());
            seen += 1;
        }
        assert!(seen > 20, "{seen}");
        for (message_type, expected) in [(13004, Group::Plan), (50023, Group::Fly)] {
            let message = Message::empty(message_type).expect("it is in the table");
            assert_eq!(Group::of(&message, LoiBitmap::LOI4), expected);
        }
    }
}
