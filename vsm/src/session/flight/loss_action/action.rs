//! What is flown for a lost CUCS, and when that is done.

use std::time::Duration;

use mapping::mode::Px4Mode;
use serde::{Deserialize, Serialize};

use crate::config::OnLoss;
use crate::session::contingency::priority::Urgency;
use crate::session::other::Other;

/// What is flown.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub(crate) enum Action {
    Hold,
    Contingency,
    Return,
}

/// What the machine reads.
#[derive(Debug, Clone, Copy)]
pub(crate) struct LossContext {
    pub(crate) now: Duration,
    /// Data is received from the vehicle.
    pub(crate) live: bool,
    pub(crate) on_ground: bool,
    /// A CUCS holds LOI 4 or 5.
    pub(crate) controlled: bool,
    pub(crate) mode: Option<Px4Mode>,
    /// The bridge did not run, and the vehicle has not shown its mode since.
    pub(crate) awaits_mode: bool,
    /// The vehicle carries the route of contingency A.
    pub(crate) carries_contingency: bool,
    /// It has flown that route to its end and holds there.
    pub(crate) completed: bool,
    /// A maneuver is in progress, or a route is being uploaded for a mode command: another command would conflict with it.
    pub(crate) busy: bool,
    /// A fixed wing is, or may be, on its final approach.
    pub(crate) on_final: bool,
    /// A route can be uploaded now.
    pub(crate) may_change_mission: bool,
    /// Who else flies the vehicle.
    pub(crate) other: Option<Other>,
}

impl Action {
    /// The action for a lost CUCS; `steered`: it was steering by set points.
    pub(crate) fn of(on_loss: OnLoss, steered: bool) -> Option<Action> {
        match on_loss {
            OnLoss::Continue if !steered => None,
            // Without steering it would fly straight on forever.
            OnLoss::Continue | OnLoss::Hold => Some(Action::Hold),
            OnLoss::Contingency => Some(Action::Contingency),
            OnLoss::Rtl => Some(Action::Return),
        }
    }

    pub(crate) fn urgency(self) -> Urgency {
        match self {
            Action::Hold => Urgency::Hold,
            Action::Contingency => Urgency::Route,
            Action::Return => Urgency::Return,
        }
    }

    /// Whether a vehicle in this mode flies the action or its equivalent. A route that was flown to its end (`completed`) is
    /// not flown again from its start.
    pub(crate) fn is_shown(
        self,
        mode: Option<Px4Mode>,
        carries_contingency: bool,
        completed: bool,
    ) -> bool {
        match mode {
            // Its own failsafe also brings it down.
            Some(Px4Mode::RTL | Px4Mode::LAND) => true,
            Some(Px4Mode::LOITER | Px4Mode::ORBIT) => {
                self == Action::Hold || (self == Action::Contingency && completed)
            }
            Some(Px4Mode::MISSION) => self == Action::Contingency && carries_contingency,
            _ => false,
        }
    }
}

/// Why the action has ended, for the text of the cleared alert. Without an action (a held contingency) it ends where the vehicle
/// returns or lands.
pub(super) fn finished(context: &LossContext, action: Option<Action>) -> Option<&'static str> {
    // With or without a link, the CUCS in control decides.
    if context.controlled {
        return Some("another CUCS controls the vehicle");
    }
    // The last report of a silent vehicle may no longer hold.
    if !context.live {
        return None;
    }
    if context.on_ground {
        return Some("vehicle is on the ground");
    }
    let (shown, reason) = match action {
        Some(action) => (action, "the vehicle carries out the loss action"),
        None => (Action::Return, "the vehicle returns or lands"),
    };
    shown
        .is_shown(context.mode, context.carries_contingency, context.completed)
        .then_some(reason)
}

pub(super) fn name(action: Action) -> &'static str {
    match action {
        Action::Hold => "hold",
        Action::Contingency => "fly contingency A",
        Action::Return => "return",
    }
}
