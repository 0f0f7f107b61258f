//! What the sessions keep over a restart: one record of a kind for each vehicle, written before it is answered.

use mavlink_link::store::StoreError;
use serde::Serialize;
use serde::de::DeserializeOwned;
use stanag_msgs::Id;

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
