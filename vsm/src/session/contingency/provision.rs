//! The action for each cause.

use crate::config::{self, ContingencyAction as Action};
use crate::session::trigger::Trigger;

/// The action for each cause.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(crate) struct Provision {
    pub(crate) battery: Option<Action>,
    pub(crate) battery_percent: u8,
    pub(crate) position: Option<Action>,
    pub(crate) fence: Option<Action>,
    pub(crate) engine: Option<Action>,
    /// Only for an agent: no frame of the ground is received.
    pub(crate) link: Option<Action>,
}

impl From<config::Contingency> for Provision {
    fn from(configured: config::Contingency) -> Provision {
        Provision {
            battery: configured.battery,
            battery_percent: configured.battery_percent,
            position: configured.position,
            fence: configured.fence,
            engine: configured.engine,
            link: None,
        }
    }
}

impl Trigger {
    /// Its key in `vehicle.contingency`, and the action there.
    pub(super) fn key(self, config: &mut Provision) -> (&'static str, &mut Option<Action>) {
        match self {
            Trigger::Engine => ("engine", &mut config.engine),
            Trigger::Position => ("position", &mut config.position),
            Trigger::Fence => ("fence", &mut config.fence),
            Trigger::Battery => ("battery", &mut config.battery),
            Trigger::Link => ("link", &mut config.link),
        }
    }

    pub(crate) fn action(self, config: &Provision) -> Option<Action> {
        let mut copy = *config;
        *self.key(&mut copy).1
    }
}
