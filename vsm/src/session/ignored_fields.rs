//! Fields that a command carries and nothing is made of: reported by 16000, since an acknowledgement would hide it.
//!
//! A command is not refused for them. A ground station may send every field every time, and one that commands "hold" must
//! hold, whatever else it carries. Zero is what a full presence vector carries for nothing, and carries no command.

use mapping::support::{Received, field};
use stanag_msgs::Message;
use stanag_msgs::enums::{AltitudeCommandType, FlightPathControlMode as Mode, HeadingCommandType};
use stanag_msgs::messages::{
    EoIrLaserPayloadCommand, LoiterConfiguration, PayloadActionWaypoint, PayloadSteeringCommand,
    UaLoiterWaypoint, UaPositionWaypoint, UaStickCommand, VehicleOperatingModeCommand,
    VehicleSpecificWaypoint,
};
use stanag_msgs::table::{self, FieldInfo, MessageInfo};
use stanag_msgs::wrapper::MAX_DATA;

/// The fields of a message that ask for something and never have an effect here, by their place and name; none of a
/// message whose fields cannot be looked at alone.
pub(crate) fn unused_fields(message: &Message) -> Vec<&'static FieldInfo> {
    let mut unused = Vec::new();
    if ASKING.contains(&message.id()) {
        each_set(message, |one| {
            if is_unused(message.info(), one) {
                unused.push(one);
            }
        });
    }
    unused
}

/// What its station is sent of the ignored fields of a message; none where there are none. `place` narrows down where.
pub(crate) fn report(message_type: u16, names: &[&str], place: &str) -> Option<String> {
    let list = names.join(", ");
    (!names.is_empty()).then(|| format!("{message_type}: ignored{place}: {list}"))
}

/// The fields of a 2016 that are commanded and of which nothing is made in this mode. `routed` where a route is flown,
/// `winged` where wings are launched, which loiter then; `climbs` where it leads to a commanded altitude.
pub(crate) fn ignored_fields(
    command: &VehicleOperatingModeCommand,
    mode: Mode,
    routed: bool,
    winged: bool,
    climbs: bool,
) -> Vec<&'static str> {
    use {AltitudeCommandType as A, HeadingCommandType as H};
    let steers = mode == Mode::Autopilot;
    // The landing pattern of wings has speeds of its own, and begins at its start.
    let routed = routed && !(winged && mode == Mode::AutolandEngage);
    let (altitude, heading) = (command.altitude_command_type, command.heading_command_type);
    let turns_to = |kinds: [H; 2]| steers && heading.is_some_and(|kind| kinds.contains(&kind));
    let message = Message::from(command.clone());
    let mut names = Vec::new();
    each_set(&message, |one| {
        let applies = match one.name {
            ALTITUDE => {
                // An aborted landing climbs only where the vehicle hovers.
                (matches!(mode, Mode::Loiter | Mode::Autopilot | Mode::Launch)
                    || mode == Mode::AutolandWaveOff && climbs)
                    && !matches!(altitude, Some(A::None | A::VerticalSpeed))
            }
            "Commanded Vertical Speed" => {
                steers && matches!(altitude, Some(A::VerticalSpeed | A::RateLimitedAltitude))
            }
            "Commanded Heading" => turns_to([H::Heading, H::HeadingAndCourse]),
            "Commanded Course" => turns_to([H::Course, H::HeadingAndCourse]),
            "Commanded Turn Rate" => turns_to([H::TurnRate; 2]),
            "Commanded Speed" => routed || matches!(mode, Mode::Loiter | Mode::Autopilot),
            "Commanded Waypoint Number" => routed,
            "Loiter Position Latitude" | "Loiter Position Longitude" => {
                mode == Mode::Loiter || mode == Mode::Launch && winged
            }
            _ => !is_unused(message.info(), one),
        };
        if !applies {
            names.push(one.name);
        }
    });
    names
}

/// Whether a field asks for something that is never done.
fn is_unused(message: &'static MessageInfo, one: &FieldInfo) -> bool {
    field(message, one).received == Received::Ignored && !SILENT.contains(&one.name)
}

/// Every field of a message that is there and not zero.
fn each_set(message: &Message, mut see: impl FnMut(&'static FieldInfo)) {
    let mut data = [0; MAX_DATA];
    let length = message.encode_data(&mut data).unwrap_or(0);
    let data = data.get(..length).unwrap_or_default();
    for (one, bytes) in table::walk(message.info(), data).flatten() {
        if bytes.iter().any(|byte| *byte != 0) {
            see(one);
        }
    }
}

/// The field of 2016 that is reported in other words too.
pub(crate) const ALTITUDE: &str = "Commanded Altitude";

/// Messages that ask the vehicle for something, all of whose fields can be looked at alone; 2016 depends on its mode.
const ASKING: &[u16] = &[
    UaStickCommand::ID,
    LoiterConfiguration::ID,
    UaPositionWaypoint::ID,
    UaLoiterWaypoint::ID,
    PayloadActionWaypoint::ID,
    VehicleSpecificWaypoint::ID,
    PayloadSteeringCommand::ID,
    EoIrLaserPayloadCommand::ID,
];
/// Fields that ask for nothing by themselves: an activity's number, and which messages follow.
const SILENT: &[&str] = &["Activity ID", "Optional Messages for Waypoint"];

#[cfg(test)]
mod tests {
    use stanag_msgs::Scaled;

    use super::*;

    #[test]
    fn what_a_mode_does_not_heed_is_named_and_zeros_are_not() {
        let command = VehicleOperatingModeCommand {
            altitude_command_type: Some(AltitudeCommandType::None),
            commanded_altitude: Some(Scaled::saturating_from_si(30.0)),
            commanded_vertical_speed: Some(Scaled::saturating_from_si(2.0)),
            commanded_speed: Some(Scaled::saturating_from_si(5.0)),
            commanded_waypoint_number: Some(7),
            thrust: Some(40),
            ..VehicleOperatingModeCommand::default()
        };
        assert_eq!(
            ignored_fields(&command, Mode::Loiter, false, false, false),
            [
                "Commanded Altitude",
                "Commanded Vertical Speed",
                "Commanded Waypoint Number",
                "Thrust"
            ]
        );
        assert_eq!(
            ignored_fields(&command, Mode::Waypoint, true, false, false),
            ["Commanded Altitude", "Commanded Vertical Speed", "Thrust"]
        );
        let empty = VehicleOperatingModeCommand {
            commanded_speed: Some(Scaled::saturating_from_si(0.0)),
            thrust: Some(0),
            ..VehicleOperatingModeCommand::default()
        };
        assert_eq!(
            ignored_fields(&empty, Mode::ContingencyA, false, false, false),
            [""; 0]
        );
    }
    #[test]
    fn the_altitude_of_a_wave_off_is_ignored_only_where_it_is_not_flown() {
        let command = VehicleOperatingModeCommand {
            commanded_altitude: Some(Scaled::saturating_from_si(45.0)),
            ..VehicleOperatingModeCommand::default()
        };
        let ignored =
            |climbs| ignored_fields(&command, Mode::AutolandWaveOff, false, false, climbs);
        assert_eq!(ignored(true), [""; 0]);
        assert_eq!(ignored(false), ["Commanded Altitude"]);
    }

    #[test]
    fn the_landing_pattern_of_wings_ignores_a_commanded_speed() {
        let command = VehicleOperatingModeCommand {
            commanded_speed: Some(Scaled::saturating_from_si(15.0)),
            ..VehicleOperatingModeCommand::default()
        };
        let ignored = |winged| ignored_fields(&command, Mode::AutolandEngage, true, winged, false);
        assert_eq!(ignored(true), ["Commanded Speed"]);
        assert_eq!(ignored(false), [""; 0]);
    }
}
