//! Values that differ from what a ground station has set: 44000 and 44002 report the present ones.
//!
//! These are the values that this VSM keeps for all stations together (the altimeter setting of 2016, the loiter of
//! 2017), and the mode that the vehicle is in. 44001 reports the floats among the vehicle's controls
//! ([`super::Controls`]).
//!
//! Modes 11, 15, 20 and 21 can be commanded at times only, and mode 2 where the vehicle takes sticks: 44003 reports when
//! ([`Available`]). That sticks (2010) come before mode 2 is up to the station itself.

use stanag_msgs::Message;
use stanag_msgs::enums::{EnumIndexEnable, FieldAvailable, FlightPathControlMode};
use stanag_msgs::messages::{
    FieldChangeEnumeratedCommand, FieldChangeIntegerCommand, LoiterConfiguration,
    MessageParameterAvailability,
};
use stanag_msgs::table;

use crate::altitude::Altimeter;

/// 44002: the vehicle's present mode, as a value of 2016. A mode of the VSM's own is described by 41002 of 3001.
#[must_use]
pub fn mode(now: FlightPathControlMode) -> Option<Message> {
    change(2016, "Select Flight Path Control Mode", now.raw().into())
}

/// 44000: the altimeter setting of 2016, in steps on the wire.
#[must_use]
pub fn altimeter(now: Altimeter) -> Option<Message> {
    let step = field(2016, "Altimeter Setting")?.step();
    let steps = (now.pascal() / step).round();
    change(2016, "Altimeter Setting", steps as i32)
}

/// One message for each value of 2017 that has an effect and differs from before.
pub fn loiter(
    now: &LoiterConfiguration,
    before: &LoiterConfiguration,
) -> impl Iterator<Item = Message> + use<> {
    let values = |of: &LoiterConfiguration| {
        [
            ("Loiter Type", of.loiter_type.map(|kind| kind.raw().into())),
            (
                "Loiter Radius",
                of.loiter_radius.map(|radius| i32::from(radius.raw())),
            ),
            (
                "Loiter Direction",
                of.loiter_direction.map(|way| way.raw().into()),
            ),
        ]
    };
    values(now)
        .into_iter()
        .zip(values(before))
        .filter(|(now, before)| now != before)
        .filter_map(|((name, now), _)| change(2017, name, now?))
}

/// 44002 of an enumerated field, 44000 of any other.
fn change(message: u16, name: &str, value: i32) -> Option<Message> {
    let field = field(message, name)?;
    let number = field.bit + 1;
    Some(if field.enumeration.is_some() {
        Message::FieldChangeEnumeratedCommand(FieldChangeEnumeratedCommand {
            requested_message: Some(message),
            requested_field: Some(number),
            commanded_enumeration_index_value: Some(value),
            ..FieldChangeEnumeratedCommand::default()
        })
    } else {
        Message::FieldChangeIntegerCommand(FieldChangeIntegerCommand {
            requested_message: Some(message),
            requested_field: Some(number),
            commanded_value: Some(value),
            ..FieldChangeIntegerCommand::default()
        })
    })
}

fn field(message: u16, name: &str) -> Option<&'static table::FieldInfo> {
    table::message(message)?.field(name)
}

/// Which modes can be commanded now.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Available {
    /// 2: the vehicle takes the sticks of a ground station, and does not fall once they end.
    pub manual: bool,
    /// 11: a route is loaded, and a vehicle with wings is in the air.
    pub waypoint: bool,
    /// 15: the vehicle is in the air.
    pub autopilot: bool,
    /// 20: the vehicle lands.
    pub wave_off: bool,
    /// 21: the vehicle is on the ground.
    pub launch: bool,
}

impl Available {
    /// One 44003 for each of these modes.
    pub fn all(self) -> impl Iterator<Item = Message> {
        self.states()
            .into_iter()
            .map(|(mode, available)| availability(mode, available))
    }

    /// One 44003 for each mode whose availability has changed.
    pub fn changes(self, before: &Available) -> impl Iterator<Item = Message> + use<> {
        self.states()
            .into_iter()
            .zip(before.states())
            .filter(|(now, before)| now != before)
            .map(|((mode, available), _)| availability(mode, available))
    }

    fn states(self) -> [(FlightPathControlMode, bool); 5] {
        [
            (FlightPathControlMode::FlightDirector, self.manual),
            (FlightPathControlMode::Waypoint, self.waypoint),
            (FlightPathControlMode::Autopilot, self.autopilot),
            (FlightPathControlMode::AutolandWaveOff, self.wave_off),
            (FlightPathControlMode::Launch, self.launch),
        ]
    }
}

fn availability(mode: FlightPathControlMode, available: bool) -> Message {
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

#[cfg(test)]
mod tests {
    use stanag_msgs::Scaled;
    use stanag_msgs::enums::{LoiterDirection, LoiterType};

    use super::*;

    #[test]
    fn a_value_is_reported_by_the_message_of_its_kind_in_steps() {
        let reported = altimeter(Altimeter::new(101_820.0).expect("a setting"));
        let expected = FieldChangeIntegerCommand {
            requested_message: Some(2016),
            requested_field: Some(16),
            commanded_value: Some(10_182),
            ..FieldChangeIntegerCommand::default()
        };
        assert_eq!(reported, Some(expected.into()));
        let Some(Message::FieldChangeEnumeratedCommand(reported)) =
            mode(FlightPathControlMode::AutolandEngage)
        else {
            panic!("an enumerated field")
        };
        assert_eq!(reported.requested_field, Some(2));
        assert_eq!(reported.commanded_enumeration_index_value, Some(19));
    }

    #[test]
    fn every_mode_that_comes_and_goes_is_listed_and_only_those_that_changed_are_reported() {
        let listed = |messages: Vec<Message>| -> Vec<(u8, EnumIndexEnable)> {
            let of = |message| match message {
                Message::MessageParameterAvailability(m) => {
                    assert_eq!(
                        (m.reported_message, m.reported_field),
                        (Some(2016), Some(2))
                    );
                    m.reported_enumerated_index.zip(m.enumerated_index_enable)
                }
                _ => None,
            };
            messages.into_iter().filter_map(of).collect()
        };
        let before = Available {
            manual: false,
            waypoint: true,
            autopilot: false,
            wave_off: false,
            launch: true,
        };
        let (yes, no) = (EnumIndexEnable::Available, EnumIndexEnable::Unavailable);
        let all = listed(before.all().collect());
        assert_eq!(all, [(2, no), (11, yes), (15, no), (20, no), (21, yes)]);
        let now = Available {
            manual: true,
            launch: false,
            ..before
        };
        let changed = listed(now.changes(&before).collect());
        assert_eq!(changed, [(2, yes), (21, no)]);
    }

    #[test]
    fn of_a_loiter_only_what_changed_is_reported() {
        let before = LoiterConfiguration {
            loiter_type: Some(LoiterType::Circular),
            loiter_radius: Some(Scaled::saturating_from_si(30.0)),
            ..LoiterConfiguration::default()
        };
        let now = LoiterConfiguration {
            loiter_radius: Some(Scaled::saturating_from_si(60.0)),
            loiter_direction: Some(LoiterDirection::CounterClockwise),
            ..before.clone()
        };
        let ids: Vec<u16> = loiter(&now, &before)
            .map(|reported| reported.id())
            .collect();
        assert_eq!(ids, [44_000, 44_002]);
        assert_eq!(loiter(&now, &now).count(), 0);
    }
}
