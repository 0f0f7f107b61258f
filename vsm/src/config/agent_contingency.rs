//! `[contingency]` of `airside.toml`: what the agent flies while nothing is received from the ground.

use std::time::Duration;

use serde::Deserialize;

use super::contingency::ContingencyAction;
use super::error::{Fault, fault};
use super::key::WhenAbsent::{Nothing, Table, Value};
use super::key::table;
use super::vehicle::{Area, check_areas};

table! {
    /// `[contingency]` of an agent
    #[derive(Debug, Clone, PartialEq, Deserialize)]
    #[serde(deny_unknown_fields, default)]
    pub struct AgentContingency {
        /// The ground is lost when no verified frame of it has arrived for so long, 5 to 3600 s: what follows is flown from then on,
        /// and until one does ([autonomy.md](../guide/autonomy.md#without-the-ground))
        pub link_lost_s: f64 => Value("30.0"),
        /// What the agent commands in the air then: `"hold"`, `"rtl"` or `"land"`. It has no route: an upload is the bridge's
        pub link: Option<ContingencyAction> => Nothing("nothing"),
        /// What it commands while less energy is left than `battery_percent`
        pub battery: Option<ContingencyAction> => Nothing("nothing"),
        /// Energy left, 1 to 90 %
        pub battery_percent: u8 => Value("25"),
        /// What it commands while the vehicle has no position: `"land"`, since every other action needs one
        pub position: Option<ContingencyAction> => Nothing("nothing"),
        /// What it commands while the vehicle is outside of the areas of `[[contingency.area]]`
        pub fence: Option<ContingencyAction> => Nothing("nothing"),
        /// What it commands once a motor has failed
        pub engine: Option<ContingencyAction> => Nothing("nothing"),
        /// Areas that the agent judges by; PX4 keeps those that the bridge has sent it
        pub area: Vec<Area> => Table(Area::KEYS),
    }
}

impl Default for AgentContingency {
    fn default() -> AgentContingency {
        AgentContingency {
            link_lost_s: 30.0,
            link: None,
            battery: None,
            battery_percent: 25,
            position: None,
            fence: None,
            engine: None,
            area: Vec::new(),
        }
    }
}

impl AgentContingency {
    /// `link_lost_s`
    #[must_use]
    pub fn link_lost(&self) -> Duration {
        Duration::from_secs_f64(self.link_lost_s)
    }

    /// Its ranges. `at` is where the table begins.
    pub(super) fn check(&self, at: usize) -> Result<(), Fault> {
        if !(5.0..=3600.0).contains(&self.link_lost_s) {
            let (key, expected) = ("contingency.link_lost_s", "5 to 3600 (seconds)");
            return fault(at, key, self.link_lost_s, expected);
        }
        if !(1..=90).contains(&self.battery_percent) {
            let (key, expected) = ("contingency.battery_percent", "1 to 90 (per cent)");
            return fault(at, key, self.battery_percent, expected);
        }
        for (key, action) in [
            ("contingency.link", self.link),
            ("contingency.battery", self.battery),
            ("contingency.position", self.position),
            ("contingency.fence", self.fence),
            ("contingency.engine", self.engine),
        ] {
            use ContingencyAction as A;
            if let Some(A::ContingencyA | A::ContingencyB) = action {
                let expected =
                    "\"hold\", \"rtl\" or \"land\": the agent uploads no route, the bridge does";
                return fault(at, key, "a contingency route", expected);
            }
        }
        if self
            .position
            .is_some_and(|action| action != ContingencyAction::Land)
        {
            let found = "an action that needs a position";
            return fault(at, "contingency.position", found, "\"land\"");
        }
        if let Err(found) = check_areas(&self.area) {
            return fault(at, "contingency.area", found, "areas that make a fence");
        }
        if self.fence.is_some() && self.area.is_empty() {
            let (found, expected) = ("no area", "a [[contingency.area]] to be outside of");
            return fault(at, "contingency.fence", found, expected);
        }
        Ok(())
    }
}
