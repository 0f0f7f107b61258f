//! Messages 21000, 21100 and 21101: which stations there are, what each is, and where it looks.
//!
//! What is not known is absent: a gimbal that has been silent for [`FRESH`] looks nowhere, and an image centre without the height
//! of the ground under it has no place.

use std::time::Duration;

use mavlink_link::dialect::CameraCapFlags;
use stanag_msgs::enums::{
    AddressedSensor, EoirPointingMode, EoirSystemMode, ImageOutput, PayloadType,
    StationBitmap1To16, VideoEncoding, VideoStreamType,
};
use stanag_msgs::messages::{
    EoIrConfigurationState, EoIrLaserOperatingState, PayloadConfiguration, VideoStreamReport,
};
use stanag_msgs::{Bam16, Bam32, Id, Scaled, Text, TimeStamp};

use super::pointing::{self, Footprint, GimbalAttitude, LineOfSight};
use super::state::{Camera, Equipment, Gimbal, Payloads, StreamInformation};
use crate::telemetry::{Place, Telemetry};

/// System Operating Mode 10: active, and recording. A payload specific value, described by the guide.
pub const RECORDING: EoirSystemMode = EoirSystemMode::Unknown(10);
/// System Operating Mode 11, in a command only: take one photograph.
pub const PHOTOGRAPH: EoirSystemMode = EoirSystemMode::Unknown(11);
/// System Operating Mode 12, in a command only: end the recording, and leave the gimbal as it is (5 brings a stowed one out).
pub const END_RECORDING: EoirSystemMode = EoirSystemMode::Unknown(12);

/// What is older is not what is.
pub const FRESH: Duration = Duration::from_secs(5);

/// One station, and what its devices have reported.
#[derive(Debug, Clone, Copy)]
pub struct Station<'a> {
    /// What it is made of.
    pub equipment: Equipment,
    /// Its gimbal, where one has reported.
    pub gimbal: Option<&'a Gimbal>,
    /// Its camera, where one has reported.
    pub camera: Option<&'a Camera>,
    /// The time.
    pub now: Duration,
}

impl<'a> Station<'a> {
    /// The station of this equipment.
    #[must_use]
    pub fn of(equipment: Equipment, payloads: &'a Payloads, now: Duration) -> Station<'a> {
        Station {
            equipment,
            gimbal: payloads.gimbal(equipment.gimbal),
            camera: payloads.camera(equipment.camera),
            now,
        }
    }

    /// Its bit in the bitmaps of stations 1 to 16.
    #[must_use]
    pub fn bit(&self) -> u16 {
        self.equipment.bit()
    }

    /// A value that came with its time, where it is fresh.
    pub fn fresh<T: Copy>(&self, value: Option<(Duration, T)>) -> Option<T> {
        value
            .filter(|(at, _)| self.now.saturating_sub(*at) < FRESH)
            .map(|(_, value)| value)
    }

    /// How its gimbal stands now.
    #[must_use]
    pub fn attitude(&self) -> Option<GimbalAttitude> {
        self.fresh(self.gimbal?.attitude)
    }

    /// Along what it looks now; nowhere while it is retracted, or before the vehicle's own attitude is known.
    #[must_use]
    pub fn sight(&self, telemetry: &Telemetry) -> Option<LineOfSight> {
        let gimbal = self.attitude().filter(|gimbal| !gimbal.retracted)?;
        Some(pointing::line_of_sight(
            &gimbal,
            telemetry.attitude.as_ref()?,
        ))
    }

    /// What it looks at: the centre of its image on the ground.
    #[must_use]
    pub fn footprint(&self, telemetry: &Telemetry, ground: &Ground<'_>) -> Option<Footprint> {
        ground.meets(telemetry.position?, self.sight(telemetry)?)
    }

    fn is_recording(&self) -> Option<bool> {
        let capture = self.fresh(self.camera?.capture)?;
        Some(capture.recording)
    }
}

/// The ground that a sensor looks at.
#[derive(Debug, Clone, Copy)]
pub enum Ground<'a> {
    /// Flat, at this altitude AMSL: home's.
    Flat(f64),
    /// Of elevation files.
    Terrain(&'a curve_paths::terrain::Terrain),
}

impl Ground<'_> {
    /// Where a line of sight meets it.
    #[must_use]
    pub fn meets(&self, from: Place, sight: LineOfSight) -> Option<Footprint> {
        match self {
            Ground::Flat(amsl_m) => pointing::on_flat_ground(from, sight, *amsl_m),
            Ground::Terrain(terrain) => {
                let height = |north, east| terrain.height_m(north, east);
                pointing::on_terrain(from, sight, terrain.spacing_m(), height)
            }
        }
    }
}

/// 21000: a station, among all that there are.
#[must_use]
pub fn configuration(
    station: &Station<'_>,
    all: &[Equipment],
    vsm: Id,
    stamp: TimeStamp,
) -> PayloadConfiguration {
    let available = all.iter().map(Equipment::bit).fold(0, |all, one| all | one);
    let records = station
        .camera
        .and_then(|camera| camera.information)
        .map(|known| {
            known
                .can
                .contains(CameraCapFlags::CAMERA_CAP_FLAGS_CAPTURE_VIDEO)
        });
    PayloadConfiguration {
        time_stamp: Some(stamp),
        vsm_id: Some(vsm),
        payload_stations_available_1_16: Some(StationBitmap1To16::from_raw(available)),
        station_number_1_16: Some(StationBitmap1To16::from_raw(station.bit())),
        payload_type: Some(payload_type(station)),
        number_of_payload_recording_devices: records.map(u8::from),
        ..PayloadConfiguration::default()
    }
}

/// 50025: a video stream of a station's camera, by its number.
#[must_use]
pub fn video_stream(
    bit: u16,
    (number, stream): (u8, &StreamInformation),
    stamp: TimeStamp,
) -> VideoStreamReport {
    let [columns, rows] = stream
        .resolution
        .map(|pixels| Some(pixels).filter(|pixels| *pixels > 0));
    VideoStreamReport {
        time_stamp: Some(stamp),
        station_number_1_16: Some(StationBitmap1To16::from_raw(bit)),
        stream_number: Some(number),
        stream_count: Some(stream.count),
        stream_type: Some(VideoStreamType::from_raw(stream.kind)),
        video_encoding: Some(VideoEncoding::from_raw(stream.encoding)),
        horizontal_resolution: columns,
        vertical_resolution: rows,
        uri: Some(Text::new(&stream.uri)),
    }
}

fn payload_type(station: &Station<'_>) -> PayloadType {
    let thermal = |camera: &Camera| {
        camera.information.is_some_and(|known| {
            (known.can).contains(CameraCapFlags::CAMERA_CAP_FLAGS_HAS_THERMAL_RANGE)
        })
    };
    match (station.equipment.gimbal, station.equipment.camera) {
        (_, None) => PayloadType::NotSpecified,
        (None, Some(_)) => PayloadType::FixedCamera,
        (Some(_), Some(_)) if station.camera.is_some_and(thermal) => PayloadType::EoIr,
        (Some(_), Some(_)) => PayloadType::Eo,
    }
}

/// 21100: what a station's sensor is, and where it can look.
#[must_use]
pub fn sensor(station: &Station<'_>, vsm: Id, stamp: TimeStamp) -> EoIrConfigurationState {
    let known = station.camera.and_then(|camera| camera.information);
    let [columns, rows] = known.map_or([0; 2], |known| known.resolution);
    let pixels = |count: u16| {
        i16::try_from(count)
            .ok()
            .filter(|count| *count > 0 && known.is_some())
    };
    let regard = station.gimbal.and_then(|gimbal| gimbal.regard);
    let end = |range: Option<[f64; 2]>, end: usize| {
        range
            .and_then(|range| range.get(end).copied())
            .map(Bam16::from_radians)
    };
    let (pitch, yaw) = (
        regard.and_then(|regard| regard.pitch),
        regard.and_then(|regard| regard.yaw),
    );
    // A full turn is both ends of the angle: as BAM they would be the same, and mean none.
    let yaw = yaw.map(|[low, high]| [low.max(-WHOLE), high.min(WHOLE)]);
    EoIrConfigurationState {
        time_stamp: Some(stamp),
        vsm_id: Some(vsm),
        station_number_1_16: Some(station.bit()),
        eo_vertical_image_dimension: pixels(rows),
        eo_horizontal_image_dimension: pixels(columns),
        field_of_regard_elevation_min: end(pitch, 0),
        field_of_regard_elevation_max: end(pitch, 1),
        field_of_regard_azimuth_min: end(yaw, 0),
        field_of_regard_azimuth_max: end(yaw, 1),
        ..EoIrConfigurationState::default()
    }
}

/// 21101: what a station does, and where it really looks. `mode`: the pointing mode that it was commanded to and has shown.
#[must_use]
pub fn operating(
    station: &Station<'_>,
    telemetry: &Telemetry,
    ground: Option<&Ground<'_>>,
    mode: EoirPointingMode,
    stamp: TimeStamp,
) -> EoIrLaserOperatingState {
    let sight = station.sight(telemetry);
    let direction = sight
        .zip(telemetry.attitude)
        .map(|(sight, attitude)| pointing::direction(sight, &attitude));
    let footprint = ground.and_then(|ground| station.footprint(telemetry, ground));
    // Altitude is that of 4000, above the ellipsoid: without the geoid separation the three are no place.
    let image = footprint.zip(telemetry.geoid_m);
    let camera = station.camera;
    let fields = camera.and_then(|camera| station.fresh(camera.field_of_view));
    let stream = camera.and_then(|camera| station.fresh(camera.stream));
    EoIrLaserOperatingState {
        time_stamp: Some(stamp),
        station_number_1_16: Some(station.bit()),
        addressed_sensor: stream.map(|stream| {
            if stream.thermal {
                AddressedSensor::IR
            } else {
                AddressedSensor::EO
            }
        }),
        system_operating_mode_state: system_mode(station),
        image_output_state: stream.map(|stream| match (stream.running, stream.thermal) {
            (false, _) => ImageOutput::None,
            (true, false) => ImageOutput::Eo,
            (true, true) => ImageOutput::Ir,
        }),
        actual_centreline_elevation_angle: direction.map(|at| Bam16::from_radians(at.elevation)),
        actual_vertical_field_of_view: fields.map(|[_, vertical]| Bam16::from_radians(vertical)),
        actual_centreline_azimuth_angle: direction.map(|at| Bam16::from_radians(at.azimuth)),
        actual_horizontal_field_of_view: fields
            .map(|[horizontal, _]| Bam16::from_radians(horizontal)),
        image_position: Some(u8::from(image.is_some())),
        latitude_of_image_centre: image.map(|(at, _)| Bam32::from_degrees(at.place.latitude)),
        longitude_of_image_centre: image.map(|(at, _)| Bam32::from_degrees(at.place.longitude)),
        altitude: image.map(|(at, geoid_m)| Scaled::saturating_from_si(at.place.amsl_m + geoid_m)),
        pointing_mode_state: Some(mode),
        reported_range: footprint.map(|at| at.range_m as f32),
        ..EoIrLaserOperatingState::default()
    }
}

fn system_mode(station: &Station<'_>) -> Option<EoirSystemMode> {
    let attitude = station.attitude();
    if attitude.is_some_and(|gimbal| gimbal.retracted) {
        return Some(EoirSystemMode::Stow);
    }
    match (station.is_recording(), attitude) {
        (Some(true), _) => Some(RECORDING),
        (Some(false), _) | (None, Some(_)) => Some(EoirSystemMode::Active),
        (None, None) => None,
    }
}

/// Half a turn, less than a step of BAM.
const WHOLE: f64 = std::f64::consts::PI - 1e-4;

#[cfg(test)]
mod tests {
    use mavlink_link::dialect::{
        CAMERA_CAPTURE_STATUS_DATA, GIMBAL_DEVICE_ATTITUDE_STATUS_DATA, GimbalDeviceFlags,
        MavMessage,
    };

    use super::*;
    use crate::telemetry::Attitude;

    const NOW: Duration = Duration::from_secs(100);
    const ALL: Equipment = Equipment {
        number: 2,
        gimbal: Some(154),
        camera: Some(100),
    };

    fn telemetry() -> Telemetry {
        Telemetry {
            attitude: Some(Attitude {
                roll: 0.0,
                pitch: 0.0,
                yaw: 0.0,
                roll_rate: 0.0,
                pitch_rate: 0.0,
                yaw_rate: 0.0,
            }),
            position: Some(Place {
                latitude: 47.4,
                longitude: 8.5,
                amsl_m: 588.0,
            }),
            geoid_m: Some(47.4),
            ..Telemetry::default()
        }
    }

    fn looking_down(flags: GimbalDeviceFlags) -> Payloads {
        let mut payloads = Payloads::default();
        let half = std::f64::consts::FRAC_PI_4;
        let message =
            MavMessage::GIMBAL_DEVICE_ATTITUDE_STATUS(GIMBAL_DEVICE_ATTITUDE_STATUS_DATA {
                q: [half.cos() as f32, 0.0, -half.sin() as f32, 0.0],
                flags,
                ..GIMBAL_DEVICE_ATTITUDE_STATUS_DATA::default()
            });
        payloads.update(NOW, 154, &message);
        payloads
    }

    fn state(
        payloads: &Payloads,
        now: Duration,
        ground: Option<&Ground<'_>>,
    ) -> EoIrLaserOperatingState {
        let station = Station::of(ALL, payloads, now);
        let mode = EoirPointingMode::AngleToUa;
        operating(&station, &telemetry(), ground, mode, TimeStamp(1))
    }

    #[test]
    fn the_operating_state_shows_where_the_gimbal_looks() {
        let payloads = looking_down(GimbalDeviceFlags::GIMBAL_DEVICE_FLAGS_PITCH_LOCK);
        let shown = state(&payloads, NOW, Some(&Ground::Flat(488.0)));
        let elevation = shown.actual_centreline_elevation_angle.expect("known");
        assert!((elevation.degrees() + 90.0).abs() < 0.1);
        assert!((shown.reported_range.expect("known") - 100.0).abs() < 0.1);
        assert_eq!(shown.image_position, Some(1));
        let altitude = shown.altitude.expect("known");
        assert!((altitude.si() - 535.4).abs() < 0.02);
        assert_eq!(shown.station_number_1_16, Some(0b10));
    }

    #[test]
    fn what_is_silent_retracted_or_over_unknown_ground_is_absent() {
        let payloads = looking_down(GimbalDeviceFlags::GIMBAL_DEVICE_FLAGS_PITCH_LOCK);
        let silent = state(&payloads, NOW + FRESH, Some(&Ground::Flat(488.0)));
        assert_eq!(silent.actual_centreline_elevation_angle, None);
        assert_eq!(silent.reported_range, None);
        assert_eq!(
            (silent.image_position, silent.system_operating_mode_state),
            (Some(0), None)
        );
        let unknown = state(&payloads, NOW, None);
        assert!(unknown.actual_centreline_azimuth_angle.is_some());
        assert_eq!(
            (unknown.reported_range, unknown.latitude_of_image_centre),
            (None, None)
        );
        let stowed = looking_down(GimbalDeviceFlags::GIMBAL_DEVICE_FLAGS_RETRACT);
        let stowed = state(&stowed, NOW, Some(&Ground::Flat(488.0)));
        assert_eq!(
            stowed.system_operating_mode_state,
            Some(EoirSystemMode::Stow)
        );
        assert_eq!(stowed.actual_centreline_elevation_angle, None);
    }

    #[test]
    fn a_camera_that_records_is_active_and_recording() {
        let mut payloads = looking_down(GimbalDeviceFlags::GIMBAL_DEVICE_FLAGS_PITCH_LOCK);
        let capture = MavMessage::CAMERA_CAPTURE_STATUS(CAMERA_CAPTURE_STATUS_DATA {
            video_status: 1,
            ..CAMERA_CAPTURE_STATUS_DATA::default()
        });
        payloads.update(NOW, 100, &capture);
        let shown = state(&payloads, NOW, None);
        assert_eq!(shown.system_operating_mode_state, Some(RECORDING));
    }
}
