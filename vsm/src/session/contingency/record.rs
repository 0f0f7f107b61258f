//! The stored state of contingencies: which causes were handled, and what CUCSs have set.

use serde::{Deserialize, Serialize};

use crate::config::ContingencyAction as Action;
use crate::session::store::vehicle_record;
use crate::session::trigger::Trigger;

/// The stored state.
#[derive(Debug, Default, Serialize, Deserialize)]
pub(crate) struct Record {
    pub(super) handled: Vec<Handled>,
    #[serde(default)]
    pub(super) set: Vec<Setting>,
}

vehicle_record!(Record, "contingencies", Power);

/// What ended the action of a cause that may persist.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub(super) struct Handled {
    pub(super) trigger: Trigger,
    pub(super) end: End,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub(super) enum End {
    /// The vehicle has shown this action.
    Shown(Action),
    /// It has flown the route of this action to its end, and holds there.
    Completed(Action),
    /// A pilot has the vehicle.
    Pilot,
    /// The CUCS in control has sent another command.
    Operator,
}

impl End {
    /// The action that was flown.
    pub(super) fn flown(self) -> Option<Action> {
        match self {
            End::Shown(action) | End::Completed(action) => Some(action),
            End::Pilot | End::Operator => None,
        }
    }
}

/// A CUCS's setting for a cause.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub(crate) struct Setting {
    pub(crate) trigger: Trigger,
    pub(crate) action: Action,
    /// The battery level; `None` for the configured one.
    pub(crate) percent: Option<u8>,
}
