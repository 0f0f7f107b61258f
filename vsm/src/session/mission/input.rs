//! What the mission machine reads, and what happens to it.

use mavlink_link::service::{command, mission};
use stanag_msgs::Message;
use stanag_msgs::enums::RouteType;
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
    /// What a vehicle is commanded that must be stopped on its way.
    pub(super) fn stop(&self) -> &'static str {
        match self.returns_instead(self.flight.contingency) {
            true => "return",
            false => "hold",
        }
    }
}

/// What happens to it.
#[derive(Debug)]
pub(crate) enum Input<'a> {
    /// 13000 to 13004, 13006, 50001, 50002, 50016 or 50017 of a CUCS that holds the right.
    Command {
        origin: Origin,
        message: &'a Message,
    },
    /// A mode command needs another route uploaded first: of this type, or what 13000 has loaded where it is `None`.
    LoadAndFly {
        origin: Option<Origin>,
        route_type: Option<RouteType>,
        command: Box<VehicleOperatingModeCommand>,
    },
    /// The mode command that waits for its route must not be carried out any more; with `without_right` only where its
    /// sender does not control the vehicle.
    DropWaitingCommand { why: String, without_right: bool },
    /// A flight termination is commanded: a load must not take the vehicle out of it.
    YieldToTermination,
    /// A command to the vehicle ended.
    CommandEnded(&'a command::Event),
    /// An operation of the mission service ended or progressed.
    ServiceEnded(mission::Event),
    /// Data of the vehicle arrives, for the first time or again, or it has restarted: it may carry another mission.
    LinkUp,
    /// Lets a load take its next step.
    Advance,
    /// After bytes of the vehicle: where it is along its mission, and whether it makes progress.
    WatchProgress,
    /// Compares the mission that the vehicle names with the one that was loaded.
    CompareWithVehicle,
    /// Looks whether what is being sent is still of the CUCS in control, and whether anything more came of it.
    WatchUpload,
    /// Compares the fence and the rally points that the vehicle names with those that it should hold.
    WatchFence,
    /// Sends the next few messages of a download.
    AdvanceDownload,
}
