//! What a 13004 requests of a payload station from the leg to its waypoint on: where its sensor looks, and which sensor is
//! shown.
//!
//! By the standard this happens when the vehicle begins to fly to the waypoint (#804), so the items precede those of the
//! leg. Anything that a mission of PX4 v1.18 cannot do is refused on arrival, and nothing of it is stored:
//!
//! | 13004 | items | why no other |
//! |---|---|---|
//! | Set Sensor Pointing Mode 1, azimuth and elevation | DO_SET_ROI_NONE, DO_GIMBAL_MANAGER_CONFIGURE, _PITCHYAW | without control PX4's manager denies angles (input_mavlink.cpp); without the first a nose that follows a place continues doing so |
//! | 4, starepoint | DO_GIMBAL_MANAGER_CONFIGURE, DO_SET_ROI_LOCATION | |
//! | 2, 3, slew rates | refused | PX4 makes a rate of PITCHYAW one step to angle 0, and 13004 has no field for it |
//! | 6, stow | refused | PX4 drops the flag RETRACT, and DO_MOUNT_CONTROL's retract only centres |
//! | 5, 7, 8 | refused | no item tracks a target or searches a line |
//! | Sensor Output 1, 2 | SET_CAMERA_SOURCE | |
//! | Set Sensor Mode 0, 2 | refused | no item switches a sensor off |

use stanag_msgs::enums::{AltitudeType, PointingModeWp, SensorModeCmd, SensorOutput};
use stanag_msgs::messages::PayloadActionWaypoint;

use super::pointing::Direction;

/// The request of a 13004.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PayloadAction {
    /// Station number, 1 to 16.
    pub station: u8,
    /// Where its sensor looks; `None` leaves it unchanged.
    pub pointing: Option<Pointing>,
    /// Shows the thermal sensor (Sensor Output 2), or the other one (1).
    pub thermal: Option<bool>,
}

/// Where a sensor looks until another action.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Pointing {
    /// Relative to the vehicle (0804.14, 0804.15).
    Angles(Direction),
    /// At a place (0804.10 to 0804.13).
    Place(StarePoint),
}

/// A place to look at.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct StarePoint {
    /// Degrees north and east.
    pub place: (f64, f64),
    /// Metres, with the reference of its type.
    pub altitude_m: f64,
    /// The reference of the altitude.
    pub altitude_type: Option<AltitudeType>,
}

impl PayloadAction {
    /// The request of a 13004.
    ///
    /// # Errors
    /// What no item of PX4's missions can do: the field, its value, and what is expected.
    pub fn of(action: &PayloadActionWaypoint) -> Result<PayloadAction, String> {
        let stations = action.station_number_1_16.map_or(0, |bits| bits.raw());
        if stations.count_ones() != 1 {
            return Err(format!(
                "Station Number names {} stations, expected one",
                stations.count_ones()
            ));
        }
        for (sensor, mode) in [(1, action.set_sensor_1_mode), (2, action.set_sensor_2_mode)] {
            if let Some(mode) = mode.filter(|mode| *mode != SensorModeCmd::On) {
                return Err(format!(
                    "Set Sensor {sensor} Mode {}: no mission item of PX4 switches a sensor off, expected 1 (on)",
                    mode.raw()
                ));
            }
        }
        let thermal = match action.sensor_output {
            None | Some(SensorOutput::None) => None,
            Some(SensorOutput::Sensor1) => Some(false),
            Some(SensorOutput::Sensor2) => Some(true),
            Some(other) => {
                return Err(format!(
                    "Sensor Output {}, expected 0 (none), 1 (sensor 1, EO) or 2 (sensor 2, IR): a station has one stream",
                    other.raw()
                ));
            }
        };
        let pointing = match action.set_sensor_pointing_mode {
            None | Some(PointingModeWp::Nil) => None,
            Some(PointingModeWp::AngleToUa) => Some(Pointing::Angles(angles(action)?)),
            Some(PointingModeWp::LatLongSlaved) => Some(Pointing::Place(stare_point(action)?)),
            Some(PointingModeWp::Stow) => {
                return Err(
                    "Set Sensor Pointing Mode 6 (stow): PX4's missions centre a gimbal and do not retract it; command it \
                     in flight (19100)"
                        .to_owned(),
                );
            }
            Some(other) => {
                return Err(format!(
                    "Set Sensor Pointing Mode {}: PX4 has no mission item for it, expected 0 (nil), 1 (angles) or 4 (place)",
                    other.raw()
                ));
            }
        };
        Ok(PayloadAction {
            station: stations.trailing_zeros() as u8 + 1,
            pointing,
            thermal,
        })
    }
}

/// The component id of the camera that an item for a station names: MAV_COMP_ID_CAMERA for station 1, the following ids for
/// the others.
#[must_use]
pub fn camera_of(station: u8) -> u8 {
    station.saturating_add(99)
}

fn angles(action: &PayloadActionWaypoint) -> Result<Direction, String> {
    use std::f64::consts::{FRAC_PI_2, PI, TAU};
    let missing = |field| format!("{field} is missing, which Set Sensor Pointing Mode 1 needs");
    let signed = |radians: f64| (radians + PI).rem_euclid(TAU) - PI;
    let azimuth = action.payload_az_wrt_ua;
    let azimuth = signed(azimuth.ok_or_else(|| missing("Payload Az"))?.radians());
    let elevation = action.payload_el_wrt_ua;
    let elevation = signed(elevation.ok_or_else(|| missing("Payload El"))?.radians());
    if elevation.abs() > FRAC_PI_2 + 1e-3 {
        return Err(format!(
            "Payload El {:.1} degrees, expected -90 to 90",
            elevation.to_degrees()
        ));
    }
    let rotation = action.payload_sensor_rotation_angle;
    let rotation = rotation.map_or(0.0, |angle| signed(angle.radians()));
    if rotation.abs() > LEVEL_RAD {
        return Err(format!(
            "Payload Sensor Rotation Angle {:.1} degrees: PX4's mission items keep the image level, expected 0",
            rotation.to_degrees()
        ));
    }
    Ok(Direction { azimuth, elevation })
}

fn stare_point(action: &PayloadActionWaypoint) -> Result<StarePoint, String> {
    let missing = |field| format!("{field} is missing, which Set Sensor Pointing Mode 4 needs");
    let latitude = action.starepoint_latitude;
    let latitude = latitude
        .ok_or_else(|| missing("Starepoint Latitude"))?
        .degrees();
    let longitude = action.starepoint_longitude;
    let longitude = longitude
        .ok_or_else(|| missing("Starepoint Longitude"))?
        .degrees();
    let altitude = action.starepoint_altitude;
    let altitude_m = altitude.ok_or_else(|| missing("Starepoint Altitude"))?.si();
    if !(-90.0..=90.0).contains(&latitude) {
        return Err(format!(
            "Starepoint Latitude {latitude:.4} deg, expected -90 to 90"
        ));
    }
    // Which of the known types can be flown depends on home and the configuration, and is judged when the route is loaded.
    let altitude_type = match action.starepoint_altitude_type {
        None => return Err(missing("Starepoint Altitude Type")),
        Some(AltitudeType::Unknown(value)) => {
            return Err(format!("Starepoint Altitude Type {value}, expected 0 to 3"));
        }
        known => known,
    };
    Ok(StarePoint {
        place: (latitude, longitude),
        altitude_m,
        altitude_type,
    })
}

/// A rotation below this is none: steps of a BAM, and what a float makes of 0.
const LEVEL_RAD: f64 = 1e-3;

#[cfg(test)]
mod tests {
    use stanag_msgs::enums::StationBitmap1To16;
    use stanag_msgs::{Bam16, Bam32};

    use super::*;

    fn of(change: impl FnOnce(&mut PayloadActionWaypoint)) -> Result<PayloadAction, String> {
        let mut action = PayloadActionWaypoint {
            station_number_1_16: Some(StationBitmap1To16::STATION_1),
            ..PayloadActionWaypoint::default()
        };
        change(&mut action);
        PayloadAction::of(&action)
    }

    #[test]
    fn an_azimuth_to_the_left_is_negative_and_other_modes_fields_do_not_count() {
        let action = of(|one| {
            one.set_sensor_pointing_mode = Some(PointingModeWp::AngleToUa);
            one.payload_az_wrt_ua = Some(Bam16::from_degrees(330.0));
            one.payload_el_wrt_ua = Some(Bam16::from_degrees(-45.0));
            // Edition 2.5 sends every field.
            one.starepoint_latitude = Some(Bam32::from_degrees(0.0));
            one.set_sensor_1_mode = Some(SensorModeCmd::On);
        });
        let Ok(PayloadAction {
            station: 1,
            pointing: Some(Pointing::Angles(direction)),
            thermal: None,
        }) = action
        else {
            panic!("{action:?}");
        };
        assert!(
            (direction.azimuth.to_degrees() + 30.0).abs() < 0.01,
            "{direction:?}"
        );
        assert!(
            (direction.elevation.to_degrees() + 45.0).abs() < 0.01,
            "{direction:?}"
        );
    }

    #[test]
    fn what_px4_has_no_item_for_is_refused_by_field_and_value() {
        type Change = fn(&mut PayloadActionWaypoint);
        let refused: [(Change, &str); 9] = [
            (|one| one.station_number_1_16 = None, "names 0 stations"),
            (
                |one| one.station_number_1_16 = Some(StationBitmap1To16::from_raw(5)),
                "names 2 stations",
            ),
            (
                |one| one.set_sensor_2_mode = Some(SensorModeCmd::Off),
                "Sensor 2 Mode 0",
            ),
            (
                |one| one.sensor_output = Some(SensorOutput::Both),
                "Sensor Output 3",
            ),
            (
                |one| one.set_sensor_pointing_mode = Some(PointingModeWp::SlewRateToUa),
                "Pointing Mode 2",
            ),
            (
                |one| one.set_sensor_pointing_mode = Some(PointingModeWp::Stow),
                "19100",
            ),
            (
                |one| one.set_sensor_pointing_mode = Some(PointingModeWp::AngleToUa),
                "Payload Az is missing",
            ),
            (
                |one| one.set_sensor_pointing_mode = Some(PointingModeWp::LatLongSlaved),
                "Starepoint Latitude is missing",
            ),
            (
                |one| {
                    one.set_sensor_pointing_mode = Some(PointingModeWp::AngleToUa);
                    one.payload_az_wrt_ua = Some(Bam16::from_degrees(0.0));
                    one.payload_el_wrt_ua = Some(Bam16::from_degrees(0.0));
                    one.payload_sensor_rotation_angle = Some(Bam16::from_degrees(10.0));
                },
                "Rotation Angle 10.0",
            ),
        ];
        for (change, why) in refused {
            let refusal = of(change).expect_err(why);
            assert!(refusal.contains(why), "{refusal}");
        }
    }
}
