//! Messages 21000, 21100 and 21101: which stations there are, what each is, and where it looks.
//!
//! What is not known is absent: a gimbal that has been silent for [`FRESH`] looks nowhere, and an image centre without the height
//! of the ground under it has no place.
//!
//! An image centre is made of three messages of the vehicle: its position, its attitude and the gimbal's. It is that of the moment of the
//! position, as the rest of 4000 is, so the vehicle's attitude is brought to that moment. How a gimbal turned in between is not known well
//! enough to do the same with it: whether its rates are about its own axes or those of the horizon, devices do not agree, and some
//! report none or 0 while they turn. Where it may have turned, there is no image centre ([`Station::image_centre`]).

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

use super::pointing::{self, Footprint, Frame, GimbalAttitude, LineOfSight};
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

    /// How its gimbal stands now, where it looks anywhere: not while it is retracted.
    fn looking(&self) -> Option<GimbalAttitude> {
        self.attitude().filter(|gimbal| !gimbal.retracted)
    }

    /// Along what it looks now; nowhere while it is retracted, or before the vehicle's own attitude is known.
    #[must_use]
    pub fn sight(&self, telemetry: &Telemetry) -> Option<LineOfSight> {
        let vehicle = telemetry.attitude.as_ref()?;
        Some(pointing::line_of_sight(&self.looking()?, vehicle))
    }

    /// What it looks at now, by the latest of each report: to steer by, while the gimbal turns too.
    #[must_use]
    pub fn footprint(&self, telemetry: &Telemetry, ground: &Ground<'_>) -> Option<Footprint> {
        ground.meets(telemetry.position?, self.sight(telemetry)?)
    }

    /// The centre of its image on the ground, as it was at the moment of the vehicle's position; `None` where gimbal or vehicle may have
    /// turned between that and their reports.
    #[must_use]
    pub fn image_centre(&self, telemetry: &Telemetry, ground: &Ground<'_>) -> Option<Footprint> {
        let place = telemetry.located()?;
        let gimbal = self.looking()?;
        if !gimbal.is_of(telemetry.position_ms()?) {
            return None;
        }
        let vehicle = match gimbal.frame {
            // Its direction is its own, however the vehicle turns.
            Frame::North => telemetry.attitude_at_place()?,
            Frame::Heading | Frame::Body => telemetry.attitude_with_place()?,
        };
        ground.meets(place, pointing::line_of_sight(&gimbal, &vehicle))
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

/// 21101: what a station does, and where it really looks, from a vehicle as 4000 of this stamp has it. `footprint`: its
/// [image centre](Station::image_centre). `mode`: the pointing mode that it was commanded to and has shown.
#[must_use]
pub fn operating(
    station: &Station<'_>,
    telemetry: &Telemetry,
    footprint: Option<Footprint>,
    mode: EoirPointingMode,
    stamp: TimeStamp,
) -> EoIrLaserOperatingState {
    let attitude = telemetry.attitude_at_place();
    let direction = station.looking().zip(attitude).map(|(gimbal, vehicle)| {
        pointing::direction(pointing::line_of_sight(&gimbal, &vehicle), &vehicle)
    });
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
        ATTITUDE_DATA, CAMERA_CAPTURE_STATUS_DATA, GIMBAL_DEVICE_ATTITUDE_STATUS_DATA,
        GLOBAL_POSITION_INT_DATA, GimbalDeviceFlags, MavMessage,
    };

    use super::*;

    const NOW: Duration = Duration::from_secs(100);
    const ALL: Equipment = Equipment {
        number: 2,
        gimbal: Some(154),
        camera: Some(100),
    };

    /// When the vehicle was where it is, by its own clock.
    const THERE_MS: u32 = 20_000;

    /// Of a vehicle that has reported its position alone.
    fn placed() -> Telemetry {
        let mut telemetry = Telemetry {
            geoid_m: Some(47.4),
            ..Telemetry::default()
        };
        let position = GLOBAL_POSITION_INT_DATA {
            time_boot_ms: THERE_MS,
            lat: 474_000_000,
            lon: 85_000_000,
            alt: 588_000,
            ..GLOBAL_POSITION_INT_DATA::default()
        };
        telemetry.update(&MavMessage::GLOBAL_POSITION_INT(position));
        telemetry
    }

    fn telemetry() -> Telemetry {
        let mut telemetry = placed();
        turned(&mut telemetry, THERE_MS, 0.0, 0.0);
        telemetry
    }

    /// ATTITUDE of this moment: heading and rate, rad and rad/s.
    fn turned(telemetry: &mut Telemetry, time_boot_ms: u32, yaw: f64, rate: f64) {
        let attitude = ATTITUDE_DATA {
            time_boot_ms,
            yaw: yaw as f32,
            yawspeed: rate as f32,
            ..ATTITUDE_DATA::default()
        };
        telemetry.update(&MavMessage::ATTITUDE(attitude));
    }

    /// A gimbal that looks down by this angle, rad, and turns at this rate; its report came at this time of the vehicle.
    fn looking(down: f64, rate: f64, flags: GimbalDeviceFlags, vehicle_ms: u32) -> Payloads {
        let mut payloads = Payloads::default();
        looks(&mut payloads, down, rate, flags, vehicle_ms);
        payloads
    }

    /// The next report of the gimbal.
    fn looks(
        payloads: &mut Payloads,
        down: f64,
        rate: f64,
        flags: GimbalDeviceFlags,
        vehicle_ms: u32,
    ) {
        let half = down / 2.0;
        let message =
            MavMessage::GIMBAL_DEVICE_ATTITUDE_STATUS(GIMBAL_DEVICE_ATTITUDE_STATUS_DATA {
                q: [half.cos() as f32, 0.0, -half.sin() as f32, 0.0],
                angular_velocity_z: rate as f32,
                flags,
                ..GIMBAL_DEVICE_ATTITUDE_STATUS_DATA::default()
            });
        payloads.note_time(NOW, Some(vehicle_ms));
        payloads.update(NOW, 154, &message);
    }

    fn looking_down(flags: GimbalDeviceFlags) -> Payloads {
        looking(std::f64::consts::FRAC_PI_2, 0.0, flags, THERE_MS)
    }

    fn state(
        payloads: &Payloads,
        now: Duration,
        ground: Option<&Ground<'_>>,
    ) -> EoIrLaserOperatingState {
        let (station, telemetry) = (Station::of(ALL, payloads, now), telemetry());
        let mode = EoirPointingMode::AngleToUa;
        let image = ground.and_then(|ground| station.image_centre(&telemetry, ground));
        operating(&station, &telemetry, image, mode, TimeStamp(1))
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

    /// Metres north and east of the vehicle to what a camera that looks 45 degrees down sees from 100 m; `None` where that is not known.
    fn centre(payloads: &Payloads, telemetry: &Telemetry) -> Option<[f64; 2]> {
        let station = Station::of(ALL, payloads, NOW);
        let seen = station.image_centre(telemetry, &Ground::Flat(488.0))?;
        let from = telemetry.position.expect("known");
        let (north, east) = pointing::offset_m(from, seen.place);
        Some([north, east].map(f64::round))
    }

    #[test]
    fn an_image_centre_is_that_of_the_moment_of_the_position() {
        let body = GimbalDeviceFlags::empty();
        let down = std::f64::consts::FRAC_PI_4;
        let payloads = looking(down, 0.0, body, THERE_MS);
        // In a turn of 1.5 rad/s through north, reported 0.1 s later.
        let mut telemetry = placed();
        turned(&mut telemetry, THERE_MS + 100, 0.15, 1.5);
        turned(&mut telemetry, THERE_MS + 300, 0.45, 1.5);
        assert_eq!(centre(&payloads, &telemetry), Some([100.0, 0.0]));
        // The direction from the vehicle's axes is not turned by that.
        let station = Station::of(ALL, &payloads, NOW);
        let image = station.image_centre(&telemetry, &Ground::Flat(488.0));
        let mode = EoirPointingMode::AngleToUa;
        let shown = operating(&station, &telemetry, image, mode, TimeStamp(1));
        let azimuth = shown.actual_centreline_azimuth_angle.expect("known");
        assert!(azimuth.degrees().abs() < 0.1, "{azimuth:?}");
    }

    #[test]
    fn an_image_centre_whose_parts_are_of_different_moments_is_absent() {
        let body = GimbalDeviceFlags::empty();
        let north = GimbalDeviceFlags::GIMBAL_DEVICE_FLAGS_YAW_IN_EARTH_FRAME;
        let down = std::f64::consts::FRAC_PI_4;
        let seen = |flags, gimbal_rate, gimbal_ms, telemetry: &Telemetry| {
            centre(&looking(down, gimbal_rate, flags, gimbal_ms), telemetry)
        };
        let ahead = Some([100.0, 0.0]);
        let there = telemetry();
        // A gimbal that stands is reported once a second; one that turns by 30 degrees a second was elsewhere.
        assert_eq!(seen(body, 0.0, THERE_MS - 1_200, &there), ahead);
        assert_eq!(seen(body, 0.5, THERE_MS - 1_200, &there), None);
        assert_eq!(seen(body, 0.5, THERE_MS + 200, &there), None);
        assert_eq!(seen(body, 0.5, THERE_MS + 100, &there), ahead);
        assert_eq!(seen(body, 0.0, THERE_MS - 3_000, &there), None);
        // Of one that reports rates of 0 two reports show it: it has come from so far up within a second.
        for (up, late_ms, found) in [(0.0, 200, ahead), (0.5, 200, None), (0.5, 100, ahead)] {
            let mut payloads = looking(down - up, 0.0, body, THERE_MS + late_ms - 1_000);
            looks(&mut payloads, down, 0.0, body, THERE_MS + late_ms);
            assert_eq!(centre(&payloads, &there), found, "{up} {late_ms}");
        }
        // The attitude is of 0.9 s and of 3 s later. A camera that turns with the vehicle may have turned.
        for (late_ms, rate, of_body) in [(900, 0.01, ahead), (900, 0.5, None), (3_000, 0.0, None)] {
            let mut later = placed();
            turned(&mut later, THERE_MS + late_ms, 0.0, rate);
            let found = seen(body, 0.0, THERE_MS + 900, &later);
            assert_eq!(found, of_body, "{late_ms} ms, {rate} rad/s");
            assert_eq!(seen(north, 0.0, THERE_MS + 900, &later), ahead);
        }
        // A position without a fix of the receiver is none, as in 4000.
        let without = Telemetry {
            gps_fix: Some(false),
            ..telemetry()
        };
        assert_eq!(seen(body, 0.0, THERE_MS, &without), None);
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
