//! What the mission machine reads, and its inputs.

use mavlink_link::service::{command, mission};
use stanag_msgs::Message;
use stanag_msgs::enums::{MissionPlanMode, RouteType};
use stanag_msgs::messages::VehicleOperatingModeCommand;

use crate::session::authority::rules::Authority;
use crate::session::context::{self, FlightView, Origin, ParameterView};

/// What it reads.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Context<'a> {
    pub(crate) common: context::Context<'a>,
    pub(crate) flight: FlightView<'a>,
    pub(crate) parameters: ParameterView<'a>,
    pub(crate) rights: &'a Authority,
}

context::deref_to_common!(Context);

impl Context<'_> {
    /// The action commanded to stop the vehicle during its mission.
    pub(super) fn stop(&self) -> &'static str {
        match self.returns_instead(self.flight.contingency) {
            true => "return",
            false => "hold",
        }
    }
}

/// An input.
#[derive(Debug)]
pub(crate) enum Input<'a> {
    /// 13000 to 13004, 13006, 50001, 50002, 50016 or 50017 of a CUCS that holds the right.
    Command {
        origin: Origin,
        message: &'a Message,
    },
    /// A mode command needs another route uploaded first: one of this type, or if `None` the one that 13000 loaded.
    LoadAndFly {
        origin: Option<Origin>,
        route_type: Option<RouteType>,
        command: Box<VehicleOperatingModeCommand>,
    },
    /// Cancels the mode command that waits for its route; with `without_right` only if its sender does not control the
    /// vehicle.
    DropWaitingCommand { why: String, without_right: bool },
    /// A flight termination is commanded: a load must not interrupt it.
    YieldToTermination,
    /// A command to the vehicle ended.
    CommandEnded(&'a command::Event),
    /// An operation of the mission service ended or progressed.
    ServiceEnded(mission::Event),
    /// The vehicle's link is up, for the first time or again, or it has restarted: it may carry another mission.
    LinkUp,
    /// Lets a load take its next step.
    Advance,
    /// Data of the vehicle has arrived: update its position along the mission and check its progress.
    WatchProgress,
    /// Compares the mission that the vehicle names with the one that was loaded.
    CompareWithVehicle,
    /// Checks whether the upload still belongs to the CUCS in control, and whether it has stalled.
    WatchUpload,
    /// Compares the fence and rally points that the vehicle reports with those that it should hold.
    WatchFence,
    /// Sends the next few messages of a download.
    AdvanceDownload,
}

impl Input<'_> {
    /// Whether it requests the upload of a route.
    pub(super) fn loads(&self) -> bool {
        match self {
            Input::LoadAndFly { .. } => true,
            Input::Command {
                message: Message::MissionTransferCommand(command),
                ..
            } => command.mission_plan_mode == Some(MissionPlanMode::Load),
            _ => false,
        }
    }
}
