//! What a restart has cut off: its record, and how it is reported.

use std::time::Duration;

use serde::{Deserialize, Serialize};
use stanag_msgs::enums::{AlertPriority, SubsystemId};

use super::action::{Action, name};
use crate::session::alerts::Cause;
use crate::session::effects::Effects;
use crate::session::store::{Uptime, vehicle_record};

/// What is pending while nobody controls the vehicle, as a restart finds it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub(super) enum Pending {
    LossAction(Action),
    /// A held contingency, by its number: its own record keeps that it is not carried out again.
    Held(u16),
}

#[derive(Debug, Default, Serialize, Deserialize)]
pub(super) struct Record {
    pub(super) pending: Option<Pending>,
    /// When it was written; `None` in a record of an earlier version too.
    #[serde(default)]
    pub(super) written: Option<Uptime>,
}

vehicle_record!(Record, "loss-action", Power);

#[derive(Debug, Clone, Copy)]
pub(super) struct CutOff {
    pub(super) pending: Pending,
    /// When that began.
    pub(super) written: Option<Uptime>,
    /// When the vehicle first showed its mode after the restart.
    pub(super) since: Option<Duration>,
    /// It is left as it is.
    pub(super) left: bool,
}

impl CutOff {
    pub(super) fn of(pending: Pending, written: Option<Uptime>) -> CutOff {
        CutOff {
            pending,
            written,
            since: None,
            left: false,
        }
    }

    pub(super) fn what(self) -> String {
        let what = match self.pending {
            Pending::LossAction(action) => format!("the loss action ({})", name(action)),
            Pending::Held(number) => format!("held command {number}, a contingency,"),
        };
        format!("{what} was cut off by a restart of the VSM")
    }

    pub(super) fn raise(self, follows: &str, effects: &mut Effects<'_>) {
        let text = format!(
            "{}, and nobody controls the vehicle: take control{follows}",
            self.what()
        );
        let (priority, comms) = (AlertPriority::Emergency, SubsystemId::Comms);
        effects.raise(Cause::LossAction, priority, comms, text);
    }
}
