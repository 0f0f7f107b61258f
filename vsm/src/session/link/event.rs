//! Events that the link machine passes to the other machines.

use mavlink_link::dialect::{COMPONENT_METADATA_DATA, CONTROL_STATUS_DATA};
use mavlink_link::link;
use mavlink_link::service::text::Text;
use mavlink_link::service::{command, event, mission, param};

use super::frame::Peer;

/// An event of the vehicle or its link.
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
    /// The UA State that 3002 reports is another one, in the same mode.
    StateChanged,
    /// An operation of the mission service ended or progressed.
    Mission(mission::Event),
    /// A command ended.
    Command(command::Event),
    /// A command to this component, other than the autopilot, ended.
    ComponentCommand(u8, command::Event),
    /// A gimbal or a camera has reported something.
    PayloadReported,
    /// A parameter request ended.
    Parameter(param::Event),
    /// An unrequested parameter: another system has changed it.
    ParameterReported(param::Name, param::Value),
    /// It has answered the ping with this number.
    PingReturned(u32),
    /// It reports which systems may command it.
    ControlStatus(CONTROL_STATUS_DATA),
    /// A STATUSTEXT.
    Text(Text),
    /// A vehicle event (EVENT), or a notice that some were lost.
    Event(event::Event),
    /// It has reported where its metadata is.
    Metadata(COMPONENT_METADATA_DATA),
    /// An event of the link.
    Link(link::Event<Peer>),
    /// Another MAVLink system commands the vehicle, or requests to: for operators.
    ForeignControl(String),
}
