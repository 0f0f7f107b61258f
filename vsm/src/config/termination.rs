//! `vehicle.termination`: the planned action of a commanded flight termination (2005). Without the table it is refused.

use std::time::Duration;

use serde::{Deserialize, Serialize};

use super::error::{Fault, fault};
use super::key::WhenAbsent::{Required, Value};
use super::key::table;

table! {
    /// `vehicle.termination`: without this table every 2005 but a reset is refused.
    #[derive(Debug, Clone, Copy, PartialEq, Deserialize)]
    #[serde(deny_unknown_fields)]
    pub struct Termination {
        /// What a termination that a CUCS with LOI 5 has armed and then commanded (2005) does: `"terminate"` ends the flight
        /// (MAV_CMD_DO_FLIGHTTERMINATION: failsafe values at all outputs, a parachute, final until PX4 restarts), `"land"` lands
        /// where the vehicle is (AUTO.LAND), `"return"` returns (AUTO.RTL)
        /// ([termination.md](../guide/termination.md))
        pub action: TerminationAction => Required,
        /// How long it stays armed without being commanded, 5 to 120 s
        #[serde(default = "Termination::default_armed_s")]
        pub armed_s: f64 => Value("30.0"),
        /// How long the vehicle is commanded again and again until it shows the termination, 5 to 300 s
        #[serde(default = "Termination::default_confirm_s")]
        pub confirm_s: f64 => Value("30.0"),
    }
}

/// `vehicle.termination.action`
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum TerminationAction {
    /// MAV_CMD_DO_FLIGHTTERMINATION.
    Terminate,
    /// AUTO.LAND.
    Land,
    /// AUTO.RTL.
    Return,
}

impl Termination {
    fn default_armed_s() -> f64 {
        30.0
    }

    fn default_confirm_s() -> f64 {
        30.0
    }

    /// `armed_s`
    #[must_use]
    pub fn armed(&self) -> Duration {
        Duration::from_secs_f64(self.armed_s)
    }

    /// `confirm_s`
    #[must_use]
    pub fn confirm(&self) -> Duration {
        Duration::from_secs_f64(self.confirm_s)
    }

    /// Its ranges. `at` is where the table of the vehicle begins.
    pub(super) fn check(&self, at: usize) -> Result<(), Fault> {
        for (key, value, range, expected) in [
            ("armed_s", self.armed_s, 5.0..=120.0, "5 to 120 (seconds)"),
            (
                "confirm_s",
                self.confirm_s,
                5.0..=300.0,
                "5 to 300 (seconds)",
            ),
        ] {
            if !range.contains(&value) {
                let key = format!("vehicle.termination.{key}");
                return fault(at, &key, value, expected);
            }
        }
        Ok(())
    }
}
