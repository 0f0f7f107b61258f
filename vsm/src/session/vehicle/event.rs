//! What a vehicle has told that the bridge acts on.

use mavlink_link::dialect::CONTROL_STATUS_DATA;
use mavlink_link::link;
use mavlink_link::service::text::Text;
use mavlink_link::service::{command, mission, param};

use super::Peer;

/// What the vehicle has told, for the bridge to act on.
#[expect(
    clippy::large_enum_variant,
    reason = "boxed, the vehicle could make us allocate"
)]
#[derive(Debug, Clone, PartialEq)]
pub(crate) enum VehicleEvent {
    /// A heartbeat after silence, or the first.
    Heard,
    /// No word of its state for [`SILENCE`](super::SILENCE).
    Silent,
    /// The vehicle has started anew: its clock since boot went back.
    Restarted,
    /// Its mode is another.
    ModeChanged,
    /// A mission service ended or went on.
    Mission(mission::Event),
    /// A command ended or went on.
    Command(command::Event),
    /// The answer to a parameter that was asked for.
    Parameter(param::Event),
    /// A parameter that it tells unasked: somebody has changed it.
    ParameterTold(param::Name, param::Value),
    /// It has returned the ping of this number.
    PingReturned(u32),
    /// It has answered a command of another system: (system, command).
    ForeignCommand(u8, u32),
    /// It has told which systems may command it.
    ControlStatus(CONTROL_STATUS_DATA),
    /// It passes on that this system asks for operator control.
    ControlAsked(u8),
    /// A text of its own.
    Text(Text),
    /// Something about the link.
    Link(link::Event<Peer>),
}
