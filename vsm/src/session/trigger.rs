//! What a contingency is for: shared by the machine that flies it and the alerts.

use serde::{Deserialize, Serialize};

/// What leads to an action.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub(crate) enum Trigger {
    Engine,
    Position,
    Fence,
    Battery,
}

impl Trigger {
    /// All, the most urgent first.
    pub(crate) const ALL: [Trigger; 4] = [
        Trigger::Engine,
        Trigger::Position,
        Trigger::Fence,
        Trigger::Battery,
    ];
}
