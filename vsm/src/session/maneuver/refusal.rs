//! Why a maneuver has failed, with the reason of the vehicle, for which the answer to its command may have to wait.
//!
//! PX4 refuses a command by COMMAND_ACK, and sends the reason by STATUSTEXT: in the same turn of its link, in another datagram, or
//! a little later. What a refusal ends is ended at once; only its report waits.

use std::time::Duration;

use crate::session::link::state::{REASON_WITHIN, VehicleState};

/// Why a maneuver has failed.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Refusal {
    why: String,
    by_vehicle: bool,
    /// Of this command the vehicle's reason may still come.
    unexplained: Option<Answered>,
}

/// The command that the vehicle has refused.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Answered {
    /// When it was first sent.
    pub(super) sent: Duration,
    pub(super) at: Duration,
}

impl Refusal {
    /// The vehicle has refused a command, and sends its reason apart from that, if it has one.
    pub(super) fn by_vehicle(why: String, unexplained: Option<Answered>) -> Refusal {
        Refusal {
            why,
            by_vehicle: true,
            unexplained,
        }
    }

    /// Whether the vehicle has answered that it does not do what was commanded.
    pub(crate) fn is_by_vehicle(&self) -> bool {
        self.by_vehicle
    }

    /// Whether the vehicle's reason may still come.
    pub(crate) fn awaits_reason(&self, now: Duration, vehicle: &VehicleState) -> bool {
        let comes = |at| now < at + REASON_WITHIN && !vehicle.has_complained(at);
        self.unexplained.is_some_and(|of| comes(of.at))
    }

    /// When nothing more is awaited.
    pub(crate) fn poll_timeout(&self) -> Option<Duration> {
        self.unexplained.map(|of| of.at + REASON_WITHIN)
    }

    /// The bridge did not run for so long: the reason may wait unread.
    pub(crate) fn postpone(&mut self, by: Duration) {
        if let Some(of) = &mut self.unexplained {
            of.at += by;
        }
    }

    /// Adds the vehicle's reason, as far as it has come, and awaits nothing more: what the vehicle says later may be about another
    /// command.
    pub(crate) fn explain(&mut self, vehicle: &VehicleState) {
        let reason = |of: Answered| vehicle.complaint(of.sent, of.at);
        if let Some(reason) = self.unexplained.take().and_then(reason) {
            self.why += &reason;
        }
    }

    /// The text for an operator, with the vehicle's reason as far as it has come.
    pub(crate) fn text(mut self, vehicle: &VehicleState) -> String {
        self.explain(vehicle);
        self.why
    }
}

impl From<String> for Refusal {
    fn from(why: String) -> Refusal {
        Refusal {
            why,
            by_vehicle: false,
            unexplained: None,
        }
    }
}
