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
    /// Of the air-side agent alone: no frame of the ground.
    Link,
}

impl Trigger {
    /// All, the most urgent first.
    pub(crate) const ALL: [Trigger; 5] = [
        Trigger::Engine,
        Trigger::Position,
        Trigger::Fence,
        Trigger::Battery,
        Trigger::Link,
    ];

    /// Those that a vehicle reports, which a bridge and an agent both judge.
    pub(crate) const OF_VEHICLE: [Trigger; 4] = [
        Trigger::Engine,
        Trigger::Position,
        Trigger::Fence,
        Trigger::Battery,
    ];
}
