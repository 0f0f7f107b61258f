//! Zeroize (50024): two orders of a CUCS that holds LOI 5, or one of an operator of this computer, and nothing else erases this VSM.
//!
//! `rules` decides, `text` is what operators and logs are sent of it; `bridge/zeroize.rs` carries it out, since it is about the
//! whole VSM and no single vehicle.

mod rules;
pub(crate) mod text;

use std::time::Duration;

use stanag_msgs::Id;

pub(crate) use self::rules::{Circumstances, Fleet, Outcome, Plan, Refusal, Rules, Stage};
use super::context::Origin;
use crate::config::Zeroize as Settings;

/// The order of this VSM.
#[derive(Debug, Default)]
pub(crate) struct Zeroize {
    pub(crate) settings: Settings,
    /// Nobody reaches the DLI but from this computer.
    local: bool,
    pub(crate) rules: Rules,
    /// The vehicle that it was armed by.
    pub(crate) vehicle: Option<Id>,
    /// What was ordered is meant in flight, too.
    pub(crate) in_flight: bool,
    /// The order to execute, which is answered once it is stored; `None` of one that was given here.
    pub(crate) waiting: Option<Option<(Id, Origin)>>,
}

impl Zeroize {
    pub(crate) fn new(settings: Settings, local: bool) -> Zeroize {
        Zeroize {
            settings,
            local,
            ..Zeroize::default()
        }
    }

    pub(crate) fn poll_timeout(&self) -> Option<Duration> {
        self.rules.poll_timeout()
    }

    /// What the configuration allows of a station, by whether its guard has verified the order.
    pub(crate) fn plan(&self, verified: bool) -> Option<Plan> {
        let Settings {
            by_message,
            in_flight,
            ..
        } = self.settings;
        let armed = self.settings.armed();
        by_message.then_some(Plan {
            armed,
            in_flight,
            authentic: verified || self.local,
        })
    }
}
