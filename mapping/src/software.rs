//! Software of the vehicle (AUTOPILOT_VERSION) as message 50013.

use mavlink_link::dialect::AUTOPILOT_VERSION_DATA;
use stanag_msgs::messages::SoftwareVersionReport;
use stanag_msgs::{Text, TimeStamp};

/// What a vehicle has said of its software and board.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Software {
    /// Such as `1.18.0-beta`.
    pub version: String,
    /// flight_custom_version: the first bytes of the hash of its source, as PX4 sends them.
    pub source: u64,
    /// board_version.
    pub board: u32,
    /// uid.
    pub hardware: u64,
}

impl Software {
    /// Of the message.
    #[must_use]
    pub fn of(message: &AUTOPILOT_VERSION_DATA) -> Software {
        let [major, minor, patch, kind] = message.flight_sw_version.to_be_bytes();
        // FIRMWARE_VERSION_TYPE.
        let kind = match kind {
            0..64 => "-dev",
            64..128 => "-alpha",
            128..192 => "-beta",
            192..255 => "-rc",
            255 => "",
        };
        Software {
            version: format!("{major}.{minor}.{patch}{kind}"),
            // Lowest byte first on the wire.
            source: u64::from_le_bytes(message.flight_custom_version),
            board: message.board_version,
            hardware: message.uid,
        }
    }
}

/// 50013. What the vehicle has not told is absent.
#[must_use]
pub fn report(
    vsm_version: &str,
    vehicle: Option<&Software>,
    stamp: TimeStamp,
) -> SoftwareVersionReport {
    let hex = |number: u64| Text::new(&format!("{number:016x}"));
    SoftwareVersionReport {
        time_stamp: Some(stamp),
        vsm_version: Some(Text::new(vsm_version)),
        autopilot_version: vehicle.map(|told| Text::new(&told.version)),
        autopilot_source: vehicle
            .filter(|told| told.source != 0)
            .map(|told| hex(told.source)),
        board_version: vehicle.map(|told| told.board),
        hardware_id: vehicle
            .filter(|told| told.hardware != 0)
            .map(|told| hex(told.hardware)),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_version_is_told_as_people_write_it() {
        let told = |flight_sw_version| {
            let message = AUTOPILOT_VERSION_DATA {
                flight_sw_version,
                ..AUTOPILOT_VERSION_DATA::default()
            };
            Software::of(&message).version
        };
        assert_eq!(told(0x0112_0080), "1.18.0-beta");
        assert_eq!(told(0x010f_02ff), "1.15.2");
        assert_eq!(told(0x0113_0000), "1.19.0-dev");
    }
}
