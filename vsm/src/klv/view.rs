//! What a station has been sent of a vehicle, as a local set.
//!
//! Each message 4000 makes a set, and its Time Stamp, when the position was valid, is the set's. Values of the payload are added where the
//! last 21101 is of the same time, within [`MAX_APART_MS`]. What the messages leave out, the set leaves out.

use stanag_msgs::Message;
use stanag_msgs::TimeStamp;
use stanag_msgs::enums::{AddressedSensor, AltitudeType};
use stanag_msgs::klv::LocalSet;
use stanag_msgs::messages::{EoIrLaserOperatingState, InertialStates, VehicleId};

/// How far apart, in ms, the time stamps of 4000 and 21101 may be in one set: the period of a 21101 that comes unasked, and that of the
/// positions that both are stamped with. The 4000 just before the next 21101 may be of a position so much later.
pub const MAX_APART_MS: u64 = 700;

/// What is known of one vehicle and one of its payload stations.
#[derive(Debug, Clone)]
pub struct View {
    station: u16,
    designation: Option<String>,
    identity: Option<VehicleId>,
    payload: Option<EoIrLaserOperatingState>,
}

impl View {
    /// Nothing is known yet. `station`: the payload station, 1 to 16. `designation`: the model of the aircraft, which no
    /// message has.
    #[must_use]
    pub fn new(station: u8, designation: Option<String>) -> View {
        View {
            station: 1_u16
                .checked_shl(u32::from(station).wrapping_sub(1))
                .unwrap_or(0),
            designation,
            identity: None,
            payload: None,
        }
    }

    /// Takes a message of the vehicle; a 4000 with a time stamp makes a set. `unix_us`: about now, since the set counts from
    /// 1970 and the five bytes of a stamp roll over.
    pub fn take(&mut self, message: &Message, unix_us: u64) -> Option<LocalSet> {
        match message {
            Message::VehicleId(new) => self.identity = Some(new.clone()),
            Message::EoIrLaserOperatingState(new)
                if new.station_number_1_16 == Some(self.station) =>
            {
                self.payload = Some(new.clone());
            }
            Message::InertialStates(new) => return self.set(new, unix_us),
            _ => {}
        }
        None
    }

    fn set(&self, states: &InertialStates, unix_us: u64) -> Option<LocalSet> {
        let stamp = states.time_stamp?;
        let mut set = LocalSet::at(stamp.unix_ms_near(unix_us / 1_000) * 1_000);
        set.platform_designation = self.designation.clone();
        if let Some(identity) = &self.identity {
            set.mission_id = text(identity.mission_id.as_ref().map(|text| text.as_str()));
            set.platform_tail_number =
                text(identity.tail_number.as_ref().map(|text| text.as_str()));
            set.platform_call_sign =
                text(identity.atc_call_sign.as_ref().map(|text| text.as_str()));
        }
        platform(&mut set, states);
        let near = |payload: &&EoIrLaserOperatingState| {
            payload
                .time_stamp
                .is_some_and(|other| apart(stamp, other) <= MAX_APART_MS)
        };
        if let Some(payload) = self.payload.as_ref().filter(near) {
            sensor(&mut set, payload);
        }
        set.clear_out_of_range();
        Some(set)
    }
}

/// The place of the sensor is that of the vehicle: where on it the sensor sits is not reported.
fn platform(set: &mut LocalSet, states: &InertialStates) {
    set.platform_heading_deg = states
        .heading
        .map(|angle| angle.degrees().rem_euclid(360.0));
    let pitch = states.pitch.map(|angle| angle.degrees());
    let roll = states.roll.map(|angle| angle.degrees());
    // Both forms of an angle in one set would be two values of one thing.
    (set.platform_pitch_deg, set.platform_pitch_full_deg) = by_size(pitch, 20.0);
    (set.platform_roll_deg, set.platform_roll_full_deg) = by_size(roll, 50.0);
    set.sensor_latitude_deg = states.latitude.map(|angle| angle.degrees());
    set.sensor_longitude_deg = states.longitude.map(|angle| angle.degrees());
    let altitude = states.altitude.map(|altitude| altitude.si());
    match states.altitude_type {
        Some(AltitudeType::Wgs84) => set.sensor_ellipsoid_height_m = altitude,
        // What this project's VSM has for it is above mean sea level (docs/guide/mapping.md).
        Some(AltitudeType::Barometric) => set.sensor_true_altitude_m = altitude,
        // Pressure altitude and height above ground are no height of any item.
        _ => {}
    }
    let (north, east) = (
        states.u_speed.map(|speed| speed.si()),
        states.v_speed.map(|speed| speed.si()),
    );
    set.sensor_north_velocity_m_s = north;
    set.sensor_east_velocity_m_s = east;
    set.platform_ground_speed_m_s = north.zip(east).map(|(north, east)| north.hypot(east));
}

fn sensor(set: &mut LocalSet, payload: &EoIrLaserOperatingState) {
    // A bitmap in commands; a picture is of one.
    let source =
        |sensor, name: &str| (payload.addressed_sensor == Some(sensor)).then(|| name.to_owned());
    set.image_source_sensor =
        source(AddressedSensor::EO, "EO").or_else(|| source(AddressedSensor::IR, "IR"));
    let degrees = |angle: Option<stanag_msgs::Bam16>| angle.map(|angle| angle.degrees());
    let turn = |angle| degrees(angle).map(|angle| angle.rem_euclid(360.0));
    set.sensor_horizontal_fov_deg = degrees(payload.actual_horizontal_field_of_view);
    set.sensor_vertical_fov_deg = degrees(payload.actual_vertical_field_of_view);
    set.sensor_relative_azimuth_deg = turn(payload.actual_centreline_azimuth_angle);
    set.sensor_relative_elevation_deg = degrees(payload.actual_centreline_elevation_angle);
    set.sensor_relative_roll_deg = turn(payload.actual_sensor_rotation_angle);
    set.slant_range_m = payload.reported_range.map(f64::from);
    // 1: the next three are known.
    if payload.image_position == Some(1) {
        set.frame_center_latitude_deg = payload
            .latitude_of_image_centre
            .map(|angle| angle.degrees());
        set.frame_center_longitude_deg = payload
            .longitude_of_image_centre
            .map(|angle| angle.degrees());
        set.frame_center_ellipsoid_height_m = payload.altitude.map(|altitude| altitude.si());
        set.image_coordinate_system = Some("Geodetic WGS84".to_owned());
    }
}

/// An angle as the item for small ones, or as that for all.
fn by_size(angle: Option<f64>, small: f64) -> (Option<f64>, Option<f64>) {
    match angle {
        Some(angle) if angle.abs() <= small => (Some(angle), None),
        other => (None, other),
    }
}

fn text(text: Option<&str>) -> Option<String> {
    text.filter(|text| !text.is_empty()).map(str::to_owned)
}

/// Milliseconds; stamps roll over in 2034.
fn apart(one: TimeStamp, other: TimeStamp) -> u64 {
    let apart = one.0.abs_diff(other.0) % TimeStamp::PERIOD_MS;
    apart.min(TimeStamp::PERIOD_MS - apart)
}

#[cfg(test)]
mod tests {
    use stanag_msgs::{Bam16, Bam32, Scaled};

    use super::*;

    /// 2001, when the stamps of these tests are of their first period.
    const NOW_US: u64 = 978_307_200_000_000;

    fn inertial(stamp: u64) -> InertialStates {
        InertialStates {
            time_stamp: Some(TimeStamp(stamp)),
            ..InertialStates::default()
        }
    }

    fn payload(stamp: u64, station: u16) -> EoIrLaserOperatingState {
        EoIrLaserOperatingState {
            time_stamp: Some(TimeStamp(stamp)),
            station_number_1_16: Some(station),
            actual_centreline_azimuth_angle: Some(Bam16::from_degrees(-90.0)),
            image_position: Some(0),
            latitude_of_image_centre: Some(Bam32::from_degrees(47.0)),
            ..EoIrLaserOperatingState::default()
        }
    }

    fn azimuth(view: &mut View, at: u64) -> Option<f64> {
        let set = view.take(&inertial(at).into(), NOW_US).expect("a set");
        assert_eq!(
            set.frame_center_latitude_deg, None,
            "0302.15 says that it is not known"
        );
        set.sensor_relative_azimuth_deg
    }

    #[test]
    fn the_payload_is_of_the_same_time_and_station_or_absent() {
        let mut view = View::new(2, None);
        assert_eq!(view.take(&payload(1_000, 0b01).into(), NOW_US), None);
        assert_eq!(azimuth(&mut view, 1_000), None, "another station");
        assert_eq!(view.take(&payload(1_000, 0b10).into(), NOW_US), None);
        for (at, expected) in [
            (300, Some(270.0)),
            (1_700, Some(270.0)),
            (299, None),
            (1_701, None),
        ] {
            assert_eq!(azimuth(&mut view, at), expected, "{at}");
        }
        view.take(&payload(TimeStamp::PERIOD_MS - 100, 0b10).into(), NOW_US);
        assert_eq!(
            azimuth(&mut view, 100),
            Some(270.0),
            "stamps have rolled over between"
        );
    }

    #[test]
    fn what_4000_leaves_out_is_absent_and_each_angle_and_height_has_one_item() {
        let mut view = View::new(1, Some("quad".to_owned()));
        assert_eq!(
            view.take(&InertialStates::default().into(), NOW_US),
            None,
            "of no time"
        );
        let empty = view.take(&inertial(5).into(), NOW_US).expect("a set");
        let expected = LocalSet {
            platform_designation: Some("quad".to_owned()),
            ..LocalSet::at((TimeStamp::EPOCH_UNIX_MS + 5) * 1_000)
        };
        assert_eq!(empty, expected);
        let later_us = (TimeStamp(5).unix_ms() + TimeStamp::PERIOD_MS) * 1_000;
        let set = View::new(1, None).take(&inertial(5).into(), later_us + 1_000_000);
        assert_eq!(set, Some(LocalSet::at(later_us)), "after the roll-over");
        let of = |pitch: f64, roll: f64, kind| {
            let states = InertialStates {
                pitch: Some(Bam16::from_degrees(pitch)),
                roll: Some(Bam16::from_degrees(roll)),
                altitude: Some(Scaled::saturating_from_si(500.0)),
                altitude_type: Some(kind),
                ..inertial(5)
            };
            View::new(1, None)
                .take(&states.into(), NOW_US)
                .expect("a set")
        };
        let level = of(10.0, -10.0, AltitudeType::Wgs84);
        assert!(level.platform_pitch_deg.is_some() && level.platform_pitch_full_deg.is_none());
        assert!(
            level.sensor_ellipsoid_height_m.is_some() && level.sensor_true_altitude_m.is_none()
        );
        let steep = of(-21.0, 120.0, AltitudeType::Barometric);
        assert!(steep.platform_pitch_deg.is_none() && steep.platform_pitch_full_deg.is_some());
        // No item holds a roll beyond 90 degrees.
        assert!(steep.platform_roll_deg.is_none() && steep.platform_roll_full_deg.is_none());
        assert!(
            steep.sensor_true_altitude_m.is_some() && steep.sensor_ellipsoid_height_m.is_none()
        );
        let pressure = of(0.0, 0.0, AltitudeType::Pressure);
        assert_eq!(
            (
                pressure.sensor_true_altitude_m,
                pressure.sensor_ellipsoid_height_m
            ),
            (None, None)
        );
    }
}
