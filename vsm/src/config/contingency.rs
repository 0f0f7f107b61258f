//! `vehicle.contingency`: what is flown while something is wrong with the vehicle.

use serde::{Deserialize, Serialize};

use super::error::{Fault, fault};
use super::key::WhenAbsent::{Nothing, Value};
use super::key::table;

table! {
    /// `vehicle.contingency`
    #[derive(Debug, Clone, Copy, PartialEq, Deserialize)]
    #[serde(deny_unknown_fields, default)]
    pub struct Contingency {
        /// What the bridge commands in the air once less energy is left than `battery_percent`: `"hold"`, `"rtl"`, `"land"`,
        /// `"contingency-a"` or `"contingency-b"` ([autonomy.md](../guide/autonomy.md))
        pub battery: Option<ContingencyAction> => Nothing("nothing"),
        /// Energy left, 1 to 90 %
        pub battery_percent: u8 => Value("25"),
        /// What it commands once the vehicle has no position: `"land"`, since every other action needs one
        pub position: Option<ContingencyAction> => Nothing("nothing"),
        /// What it commands once the vehicle is outside of its fence: as for `battery`
        pub fence: Option<ContingencyAction> => Nothing("nothing"),
        /// What it commands once a motor has failed: as for `battery`
        pub engine: Option<ContingencyAction> => Nothing("nothing"),
    }
}

/// An action of `vehicle.contingency`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum ContingencyAction {
    /// AUTO.LOITER.
    Hold,
    /// AUTO.RTL.
    Rtl,
    /// AUTO.LAND.
    Land,
    /// The route of contingency A (mode 23 of 2016).
    ContingencyA,
    /// The route of contingency B.
    ContingencyB,
}

impl ContingencyAction {
    /// What operators are sent of it.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            ContingencyAction::Hold => "hold",
            ContingencyAction::Rtl => "return",
            ContingencyAction::Land => "landing",
            ContingencyAction::ContingencyA => "contingency A",
            ContingencyAction::ContingencyB => "contingency B",
        }
    }
}

impl Default for Contingency {
    fn default() -> Self {
        Contingency {
            battery: None,
            battery_percent: 25,
            position: None,
            fence: None,
            engine: None,
        }
    }
}

impl Contingency {
    /// Its ranges. `at` is where the vehicle's table begins.
    pub(super) fn check(&self, at: usize) -> Result<(), Fault> {
        if !(1..=90).contains(&self.battery_percent) {
            let (key, expected) = ("vehicle.contingency.battery_percent", "1 to 90 (per cent)");
            return fault(at, key, self.battery_percent, expected);
        }
        if self
            .position
            .is_some_and(|action| action != ContingencyAction::Land)
        {
            let found = "an action that needs a position";
            return fault(at, "vehicle.contingency.position", found, "\"land\"");
        }
        Ok(())
    }
}
