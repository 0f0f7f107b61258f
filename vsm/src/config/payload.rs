//! `[[vehicle.payload]]`: the payload stations of a vehicle, if its operator names them.
//!
//! Without this table the stations are those that the vehicle reports. If it is present there are no others: a station
//! keeps its number when a device is replaced, and a gimbal that nobody may steer has none.

use mapping::payload::Equipment;
use serde::Deserialize;

use super::error::{Fault, fault};
use super::key::WhenAbsent::{Nothing, Required};
use super::key::table;

table! {
    /// `vehicle.payload`: one payload station.
    #[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
    #[serde(deny_unknown_fields)]
    pub struct Payload {
        /// In a `[[vehicle.payload]]`, which together are all payload stations of the vehicle ([payload.md](../guide/payload.md)):
        /// its number, 1 to 32; the payload messages have a place for 1 to 16 only
        pub station: u8 => Required,
        /// Its gimbal, 1 to 255: the component id of a MAVLink gimbal, such as 154 or 171, or the device id, 1 to 6, of one that
        /// the autopilot drives
        pub gimbal: Option<u8> => Nothing("it has none"),
        /// Component id of its camera, 2 to 255, such as 100
        pub camera: Option<u8> => Nothing("it has none"),
    }
}

impl Payload {
    /// As the session knows it.
    #[must_use]
    pub fn equipment(&self) -> Equipment {
        Equipment {
            number: self.station,
            gimbal: self.gimbal,
            camera: self.camera,
        }
    }
}

/// Checks the stations of a vehicle. `at` is where its table begins.
pub(super) fn check(stations: &[Payload], at: usize) -> Result<(), Fault> {
    for (place, one) in stations.iter().enumerate() {
        if !(1..=32).contains(&one.station) {
            let expected = "1 to 32";
            return fault(at, "vehicle.payload.station", one.station, expected);
        }
        let before = || stations.iter().take(place);
        if before().any(|other| other.station == one.station) {
            let expected = "a station number that no other payload has";
            return fault(at, "vehicle.payload.station", one.station, expected);
        }
        if let Some(gimbal) = one.gimbal {
            if gimbal == 0 {
                let expected = "a gimbal device id, 1 to 255";
                return fault(at, "vehicle.payload.gimbal", gimbal, expected);
            }
            if before().any(|other| other.gimbal == one.gimbal) {
                let expected = "a gimbal that no other payload has";
                return fault(at, "vehicle.payload.gimbal", gimbal, expected);
            }
        }
        if let Some(camera) = one.camera {
            if camera < 2 {
                let expected = "a component id of 2 to 255: 1 is the autopilot";
                return fault(at, "vehicle.payload.camera", camera, expected);
            }
            if before().any(|other| other.camera == one.camera) {
                let expected = "a camera that no other payload has";
                return fault(at, "vehicle.payload.camera", camera, expected);
            }
        }
    }
    Ok(())
}
