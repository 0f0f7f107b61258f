//! What the link machine passes on to the others.

use mavlink_link::dialect::{COMPONENT_METADATA_DATA, CONTROL_STATUS_DATA};
use mavlink_link::link;
use mavlink_link::service::text::Text;
use mavlink_link::service::{command, event, mission, param};

use super::frame::Peer;

/// What the vehicle has reported, answered or done.
#[expect(
    clippy::large_enum_variant,
    reason = "boxed, the vehicle could make us allocate"
)]
#[derive(Debug, Clone, PartialEq)]
pub(crate) enum VehicleEvent {
    /// A heartbeat after silence, or the first.
    LinkUp,
    /// Its mode was not reported for [`SILENCE`](super::state::SILENCE).
    Silent,
    /// The vehicle has restarted: its clock since boot went back.
    Restarted,
    ModeChanged,
    /// An operation of the mission service ended or progressed.
    Mission(mission::Event),
    /// A command ended.
    Command(command::Event),
    /// A command to this component ended, which is not the autopilot.
    ComponentCommand(u8, command::Event),
    /// A gimbal or a camera has reported something.
    PayloadReported,
    /// A parameter request ended.
    Parameter(param::Event),
    /// A parameter that nobody requested: somebody has changed it.
    ParameterReported(param::Name, param::Value),
    /// It has returned the ping of this number.
    PingReturned(u32),
    /// It reports which systems may command it.
    ControlStatus(CONTROL_STATUS_DATA),
    /// A text of its own.
    Text(Text),
    /// An event of its own, or that some were lost.
    Event(event::Event),
    /// It names its metadata.
    Metadata(COMPONENT_METADATA_DATA),
    /// Something about the link.
    Link(link::Event<Peer>),
    /// Another MAVLink system commands the vehicle, or requests to: for operators.
    ForeignControl(String),
}
