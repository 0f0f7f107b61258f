//! What the sessions keep over a restart: one record of a kind for each vehicle, written before it is answered.
//!
//! How old a record is decides what is still done by it. The wall clock does not show that: it may have been set in between, and a
//! computer without a battery-backed clock starts with the time of its last shutdown. So such a record keeps an [`Uptime`].

use std::time::Duration;

use mavlink_link::store::StoreError;
use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};
use stanag_msgs::Id;

/// One boot of the computer, and where the monotonic time of this process begins in it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Boot {
    /// The first 64 bits of its random name.
    pub id: u64,
    /// The time since the boot, sleep of the computer included, at which the monotonic time was 0: the shell notes where a sleep
    /// has changed it (`Bridge::note_zero`).
    pub zero: Duration,
}

/// A moment by the computer's time since boot, which nobody sets.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub(crate) struct Uptime {
    boot: u64,
    ms: u64,
}

impl Boot {
    /// The moment of a monotonic time of this process.
    pub(crate) fn at(self, mono: Duration) -> Uptime {
        let since_boot = self.zero.saturating_add(mono);
        Uptime {
            boot: self.id,
            ms: u64::try_from(since_boot.as_millis()).unwrap_or(u64::MAX),
        }
    }
}

impl Uptime {
    /// So long before this.
    pub(crate) fn before(self, age: Duration) -> Uptime {
        let age_ms = u64::try_from(age.as_millis()).unwrap_or(u64::MAX);
        Uptime {
            ms: self.ms.saturating_sub(age_ms),
            ..self
        }
    }

    /// How long before `now` it was; `None` where it was before the computer was restarted, or at another computer.
    pub(crate) fn age(self, now: Uptime) -> Option<Duration> {
        let ms = now.ms.checked_sub(self.ms)?;
        (now.boot == self.boot).then(|| Duration::from_millis(ms))
    }
}

/// The name of a vehicle's record of a kind.
pub(crate) fn record_name(kind: &str, vehicle: Id) -> String {
    format!("{kind}-{:08x}.json", vehicle.0)
}

/// A record's content as JSON.
pub(crate) fn to_json(record: &impl Serialize) -> Vec<u8> {
    // The records are plain structs with text as keys: there is nothing that JSON could not hold.
    serde_json::to_vec(record).unwrap_or_default()
}

/// A record from its content.
pub(crate) fn from_json<R: DeserializeOwned>(bytes: &[u8]) -> Result<R, String> {
    serde_json::from_slice(bytes).map_err(|cause| cause.to_string())
}

/// Makes a serde struct the JSON record of a vehicle: `kind-1b000101.json`.
macro_rules! vehicle_record {
    ($record:ty, $kind:literal, $durability:ident) => {
        impl ::mavlink_link::store::Record for $record {
            type Key = ::stanag_msgs::Id;
            const DURABILITY: ::mavlink_link::store::Durability =
                ::mavlink_link::store::Durability::$durability;

            fn name(vehicle: &::stanag_msgs::Id) -> String {
                $crate::session::store::record_name($kind, *vehicle)
            }

            fn encode(&self) -> Vec<u8> {
                $crate::session::store::to_json(self)
            }

            fn decode(bytes: &[u8]) -> Result<Self, String> {
                $crate::session::store::from_json(bytes)
            }
        }
    };
}
pub(crate) use vehicle_record;

/// A fault of a vehicle's record of a kind.
pub(crate) fn record_fault(kind: &str, vehicle: Id, cause: impl std::fmt::Display) -> StoreError {
    StoreError::new(record_name(kind, vehicle), cause)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_age_of_a_moment_is_known_within_its_boot_only() {
        let boot = |id, zero_s| Boot {
            id,
            zero: Duration::from_secs(zero_s),
        };
        let s = Duration::from_secs;
        let written = boot(1, 100).at(s(20));
        let text = to_json(&written);
        assert_eq!(from_json(&text), Ok(written));
        // The process of before began 100 s after the boot, this one 125 s after it.
        assert_eq!(written.age(boot(1, 125).at(s(3))), Some(s(8)));
        assert_eq!(written.age(boot(1, 100).at(s(20))), Some(Duration::ZERO));
        assert_eq!(written.age(boot(2, 125).at(s(3))), None, "another boot");
        assert_eq!(written.age(boot(1, 100).at(s(19))), None, "not written yet");
        let now = boot(2, 0).at(s(20));
        assert_eq!(now.before(s(8)).age(now), Some(s(8)));
    }
}
