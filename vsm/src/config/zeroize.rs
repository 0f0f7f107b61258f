//! `[zeroize]`: what a zeroize erases, and who may order one. `vsm zeroize` needs no permission here; a message does.

use std::time::Duration;

use serde::Deserialize;

use super::error::{Fault, fault};
use super::key::WhenAbsent::Value;
use super::key::table;

table! {
    /// `[zeroize]`
    #[derive(Debug, Clone, Copy, PartialEq, Deserialize)]
    #[serde(deny_unknown_fields, default)]
    pub struct Zeroize {
        /// Keep the audit logs and their key, `audit.key`; with `false` they are erased too
        pub keep_audit: bool => Value("false"),
        /// Take the order from a CUCS that holds LOI 5 (50024, to arm and then to execute) and has a guard, or reaches the DLI on
        /// loopback, where nobody else does; with `false` it is refused, and only
        /// `vsm zeroize` on this computer gives it ([zeroize.md](../guide/zeroize.md))
        pub by_message: bool => Value("false"),
        /// Take it also while a vehicle is not known to be disarmed: **that aircraft loses its link**, and flies PX4's own
        /// failsafe from then on
        pub in_flight: bool => Value("false"),
        /// Give PX4 of each vehicle without an agent a random key that nobody keeps, while it is disarmed; over a serial line or
        /// loopback only. **Not where that line is a radio**: who receives it would have the key that PX4 obeys from then on
        pub px4_key: bool => Value("false"),
        /// How long it stays armed without being executed, 5 to 120 s
        pub armed_s: f64 => Value("30.0"),
    }
}

impl Default for Zeroize {
    fn default() -> Zeroize {
        Zeroize {
            keep_audit: false,
            by_message: false,
            in_flight: false,
            px4_key: false,
            armed_s: 30.0,
        }
    }
}

impl Zeroize {
    /// `armed_s`
    #[must_use]
    pub fn armed(&self) -> Duration {
        Duration::from_secs_f64(self.armed_s)
    }

    /// Its range.
    pub(super) fn check(&self) -> Result<(), Fault> {
        if (5.0..=120.0).contains(&self.armed_s) {
            return Ok(());
        }
        fault(0, "zeroize.armed_s", self.armed_s, "5 to 120 (seconds)")
    }
}
