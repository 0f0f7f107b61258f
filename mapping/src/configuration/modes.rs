//! Modes that can be commanded at times only: 44003 says when.

use stanag_msgs::Message;
use stanag_msgs::enums::{EnumIndexEnable, FieldAvailable, FlightPathControlMode};
use stanag_msgs::messages::MessageParameterAvailability;

/// Which of them can be commanded now.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Available {
    /// 21: the vehicle is on the ground.
    pub launch: bool,
    /// 11: a route is aboard.
    pub waypoint: bool,
}

impl Available {
    /// One 44003 a mode.
    pub fn all(self) -> impl Iterator<Item = Message> {
        self.states()
            .into_iter()
            .map(|(mode, available)| said(mode, available))
    }

    /// One 44003 for each mode that was other before.
    pub fn changes(self, before: &Available) -> impl Iterator<Item = Message> + use<> {
        self.states()
            .into_iter()
            .zip(before.states())
            .filter(|(now, before)| now != before)
            .map(|((mode, available), _)| said(mode, available))
    }

    fn states(self) -> [(FlightPathControlMode, bool); 2] {
        [
            (FlightPathControlMode::Waypoint, self.waypoint),
            (FlightPathControlMode::Launch, self.launch),
        ]
    }
}

fn said(mode: FlightPathControlMode, available: bool) -> Message {
    Message::MessageParameterAvailability(MessageParameterAvailability {
        station_number_1_16: Some(0),
        reported_message: Some(2016),
        reported_field: Some(MODE_FIELD),
        field_available: Some(FieldAvailable::Available),
        reported_enumerated_index: Some(mode.raw()),
        enumerated_index_enable: Some(if available {
            EnumIndexEnable::Available
        } else {
            EnumIndexEnable::Unavailable
        }),
        ..MessageParameterAvailability::default()
    })
}

/// Select Flight Path Control Mode, counted from 1.
const MODE_FIELD: u8 = 2;
