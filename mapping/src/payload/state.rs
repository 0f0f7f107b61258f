//! What gimbals and cameras have reported of themselves: gimbal protocol v2 and camera protocol v2.
//!
//! A plain value. Whoever feeds it decides which messages to believe; each value has the time of its arrival, since a gimbal
//! that is silent points nowhere that is known.

use std::collections::BTreeMap;
use std::f64::consts::{PI, TAU};
use std::ops::RangeInclusive;
use std::time::Duration;

use mavlink_link::dialect::{
    CAMERA_INFORMATION_DATA, CameraCapFlags, CameraMode, GimbalDeviceFlags, GimbalManagerCapFlags,
    MavMessage, MavType, StorageStatus, VideoStreamStatusFlags,
};

use super::pointing::{Direction, Frame, GimbalAttitude, quaternion};

/// Everything that reports as a payload of one vehicle.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Payloads {
    gimbals: BTreeMap<u8, Gimbal>,
    cameras: BTreeMap<u8, Camera>,
    /// The vehicle's time since boot, ms, and when a message showed it.
    vehicle_ms: Option<(Duration, u32)>,
}

/// A gimbal: its device, and the manager that steers it.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Gimbal {
    /// The component that sends GIMBAL_MANAGER_INFORMATION and GIMBAL_MANAGER_STATUS of it: it takes the commands.
    pub manager: Option<u8>,
    /// GIMBAL_MANAGER_INFORMATION.
    pub regard: Option<Regard>,
    /// GIMBAL_MANAGER_STATUS: system and component in primary control, 0 and 0 where nobody is; and when it came.
    pub control: Option<(Duration, [u8; 2])>,
    /// GIMBAL_DEVICE_ATTITUDE_STATUS, and when it came; of a gimbal on the autopilot's outputs MOUNT_ORIENTATION.
    pub attitude: Option<(Duration, GimbalAttitude)>,
    /// Of a gimbal on the autopilot's outputs: when they were reported last, by the autopilot's clock, ms, and their roll, pitch and
    /// yaw.
    outputs: Option<(Duration, u32, [f64; 3])>,
}

impl Gimbal {
    /// Whether it is on outputs of the autopilot, which are relative to the vehicle's body.
    #[must_use]
    pub fn is_on_outputs(&self) -> bool {
        self.outputs.is_some()
    }

    /// MOUNT_ORIENTATION.
    fn note_outputs(&mut self, now: Duration, boot_ms: u32, angles: [f64; 3]) {
        let before = self.outputs.replace((now, boot_ms, angles));
        let rates = before.and_then(|(_, before_ms, before)| {
            let span = f64::from(boot_ms.wrapping_sub(before_ms)) / 1e3;
            let ([_, pitch, yaw], [_, was_pitch, was_yaw]) = (angles, before);
            let turned = [pitch - was_pitch, (yaw - was_yaw + PI).rem_euclid(TAU) - PI];
            (0.0 < span && span < 1.0).then(|| turned.map(|angle| angle / span))
        });
        let attitude = GimbalAttitude {
            q: quaternion(angles),
            frame: Frame::Body,
            retracted: false,
            neutral: false,
            rates,
            turn_rate: 0.0,
            vehicle_ms: Some(boot_ms),
        };
        self.attitude = Some((now, attitude));
    }
}

/// What a gimbal can do (GIMBAL_MANAGER_INFORMATION); angles in rad.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Regard {
    /// GIMBAL_MANAGER_INFORMATION.cap_flags.
    pub can: GimbalManagerCapFlags,
    /// Lowest and highest pitch, up positive; `None` where it reports none.
    pub pitch: Option<[f64; 2]>,
    /// The same of yaw, right of the vehicle's heading positive.
    pub yaw: Option<[f64; 2]>,
}

impl Regard {
    /// Whether a gimbal can look there. `names`: of the fields for azimuth and elevation.
    ///
    /// # Errors
    /// It reaches not so far: which field, its value, and the range.
    pub fn reaches(&self, to: Direction, names: [&str; 2]) -> Result<(), String> {
        let axes = [(to.elevation, self.pitch), (to.azimuth, self.yaw)];
        for (name, (angle, range)) in names.into_iter().rev().zip(axes) {
            if let Some([low, high]) = range
                && !(low - SLACK..=high + SLACK).contains(&angle)
            {
                return Err(format!(
                    "{name} {:.1} degrees, expected {:.1} to {:.1}: the gimbal reaches no farther",
                    angle.to_degrees(),
                    low.to_degrees(),
                    high.to_degrees()
                ));
            }
        }
        Ok(())
    }
}

/// A camera.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Camera {
    /// Its HEARTBEAT came last at this time.
    pub heard_at: Option<Duration>,
    /// CAMERA_INFORMATION.
    pub information: Option<CameraInformation>,
    /// CAMERA_SETTINGS, and when it came.
    pub settings: Option<(Duration, Settings)>,
    /// CAMERA_CAPTURE_STATUS, and when it came.
    pub capture: Option<(Duration, Capture)>,
    /// STORAGE_INFORMATION.
    pub storage: Option<Storage>,
    /// CAMERA_FOV_STATUS: horizontal and vertical field of view, rad; and when it came.
    pub field_of_view: Option<(Duration, [f64; 2])>,
    /// VIDEO_STREAM_STATUS or VIDEO_STREAM_INFORMATION of its first stream, and when it came: it runs, it is thermal.
    pub stream: Option<(Duration, Stream)>,
    /// VIDEO_STREAM_INFORMATION of each, by their numbers from 1.
    pub streams: BTreeMap<u8, StreamInformation>,
}

/// What a camera is (CAMERA_INFORMATION).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CameraInformation {
    /// CAMERA_INFORMATION.flags.
    pub can: CameraCapFlags,
    /// Pixels, columns and rows; 0 where it reports none.
    pub resolution: [u16; 2],
    /// Width of the sensor, mm, where it is known: with it a field of view is a focal length.
    pub sensor_width_mm: Option<f64>,
    /// The gimbal that carries it, where it names one.
    pub gimbal: Option<u8>,
}

/// CAMERA_SETTINGS.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Settings {
    /// Image or video mode.
    pub mode: CameraMode,
    /// Zoom, 0 to 100 %, where it reports one.
    pub zoom: Option<f64>,
    /// Focus, 0 (near) to 100 %, where it reports one.
    pub focus: Option<f64>,
}

/// CAMERA_CAPTURE_STATUS.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Capture {
    /// Video is recorded.
    pub recording: bool,
    /// Images captured in all; -1 where it does not count.
    pub images: i32,
}

/// STORAGE_INFORMATION.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Storage {
    /// Empty slot, unformatted, ready, not supported.
    pub status: StorageStatus,
    /// What is left, MiB.
    pub available_mib: f64,
}

/// VIDEO_STREAM_STATUS.flags.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Stream {
    /// It is running.
    pub running: bool,
    /// It is of a thermal sensor.
    pub thermal: bool,
}

/// What a video stream is, and where (VIDEO_STREAM_INFORMATION).
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct StreamInformation {
    /// How many the camera has.
    pub count: u8,
    /// VIDEO_STREAM_TYPE.
    pub kind: u8,
    /// VIDEO_STREAM_ENCODING.
    pub encoding: u8,
    /// Pixels, columns and rows; 0 where it reports none.
    pub resolution: [u16; 2],
    /// As the camera gives it.
    pub uri: String,
}

/// What makes a payload station: `vehicle.payload`, or what the vehicle shows.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Equipment {
    /// Station number, 1 to 32; the payload messages have a place for 1 to 16.
    pub number: u8,
    /// Gimbal device id: the component id of a MAVLink gimbal, 1 to 6 of one that the autopilot drives.
    pub gimbal: Option<u8>,
    /// Component id of the camera.
    pub camera: Option<u8>,
}

impl Equipment {
    /// Its bit in the bitmaps of stations 1 to 16; 0 where it has none there.
    #[must_use]
    pub fn bit(&self) -> u16 {
        let place = u32::from(self.number.wrapping_sub(1));
        1_u16.checked_shl(place).unwrap_or(0)
    }
}

impl Payloads {
    /// Takes the vehicle's time since boot, ms, as its autopilot has shown it by now: gimbals are dated by it.
    pub fn note_time(&mut self, now: Duration, boot_ms: Option<u32>) {
        if self.vehicle_ms.map(|(_, known)| known) != boot_ms {
            self.vehicle_ms = boot_ms.map(|boot_ms| (now, boot_ms));
        }
    }

    /// Takes a message of a component of the vehicle's system.
    #[allow(
        deprecated,
        reason = "MOUNT_ORIENTATION, by which PX4 reports its own outputs"
    )]
    pub fn update(&mut self, now: Duration, component: u8, message: &MavMessage) {
        match message {
            MavMessage::GIMBAL_MANAGER_INFORMATION(m) if m.gimbal_device_id != 0 => {
                if let Some(gimbal) = self.gimbal_mut(m.gimbal_device_id) {
                    gimbal.manager = Some(component);
                    gimbal.regard = Some(Regard {
                        can: m.cap_flags,
                        pitch: range(m.pitch_min, m.pitch_max),
                        yaw: range(m.yaw_min, m.yaw_max),
                    });
                }
            }
            MavMessage::GIMBAL_MANAGER_STATUS(m) if m.gimbal_device_id != 0 => {
                if let Some(gimbal) = self.gimbal_mut(m.gimbal_device_id) {
                    gimbal.manager = Some(component);
                    let holder = [m.primary_control_sysid, m.primary_control_compid];
                    gimbal.control = Some((now, holder));
                }
            }
            MavMessage::GIMBAL_DEVICE_ATTITUDE_STATUS(m) => {
                // A device that is a component of its own leaves the id out.
                let device = match m.gimbal_device_id {
                    0 => component,
                    id => id,
                };
                let flags = m.flags;
                let locked = flags.contains(GimbalDeviceFlags::GIMBAL_DEVICE_FLAGS_PITCH_LOCK);
                // Older devices state neither frame: there the lock decides.
                let north = flags
                    .contains(GimbalDeviceFlags::GIMBAL_DEVICE_FLAGS_YAW_IN_EARTH_FRAME)
                    || flags.contains(GimbalDeviceFlags::GIMBAL_DEVICE_FLAGS_YAW_LOCK)
                        && !flags
                            .contains(GimbalDeviceFlags::GIMBAL_DEVICE_FLAGS_YAW_IN_VEHICLE_FRAME);
                let q = m.q.map(f64::from);
                let rates = [m.angular_velocity_y, m.angular_velocity_z].map(f64::from);
                if !q.iter().all(|part| part.is_finite()) {
                    return;
                }
                // The vehicle shows its time some times a second. Without what has passed since then, a gimbal that turns would
                // seem to be of the moment of a position that is 0.2 s older.
                let vehicle_ms = self.vehicle_ms.map(|(at, boot_ms)| {
                    boot_ms.wrapping_add(now.saturating_sub(at).as_millis() as u32)
                });
                if let Some(gimbal) = self.gimbal_mut(device) {
                    // PX4 reports the set point of its own outputs as their attitude, also of an axis that does not move: one that is
                    // to be locked, and not stabilised by MNT_DO_STAB (OutputRC::_stream_device_attitude_status).
                    if (gimbal.outputs).is_some_and(|(at, ..)| now.saturating_sub(at) < STANDS_FOR)
                    {
                        return;
                    }
                    let mut attitude = GimbalAttitude {
                        q,
                        frame: match (north, locked) {
                            (true, _) => Frame::North,
                            (false, true) => Frame::Heading,
                            (false, false) => Frame::Body,
                        },
                        retracted: flags.contains(GimbalDeviceFlags::GIMBAL_DEVICE_FLAGS_RETRACT),
                        // PX4 sets it for a gimbal of protocol v1 all the time (OutputMavlinkV1).
                        neutral: flags.contains(GimbalDeviceFlags::GIMBAL_DEVICE_FLAGS_NEUTRAL)
                            && !DRIVEN.contains(&device),
                        rates: rates.iter().all(|rate| rate.is_finite()).then_some(rates),
                        turn_rate: 0.0,
                        vehicle_ms,
                    };
                    if let Some((_, before)) = &gimbal.attitude {
                        attitude.turn_rate = attitude.rate_since(before);
                    }
                    gimbal.attitude = Some((now, attitude));
                }
            }
            MavMessage::MOUNT_ORIENTATION(m) => {
                let angles = [m.roll, m.pitch, m.yaw].map(|angle| f64::from(angle).to_radians());
                // A gimbal that is a component of its own may send it too.
                let driven = self.gimbals.get_mut(&ON_OUTPUTS);
                if let Some(gimbal) = driven.filter(|one| one.manager == Some(component))
                    && angles.iter().all(|angle| angle.is_finite())
                {
                    gimbal.note_outputs(now, m.time_boot_ms, angles);
                }
            }
            other => self.update_camera(now, component, other),
        }
    }

    fn update_camera(&mut self, now: Duration, component: u8, message: &MavMessage) {
        match message {
            MavMessage::HEARTBEAT(m) if m.mavtype == MavType::MAV_TYPE_CAMERA => {
                if let Some(camera) = self.camera_mut(component) {
                    camera.heard_at = Some(now);
                }
            }
            MavMessage::CAMERA_INFORMATION(m) if m.camera_device_id == 0 => {
                if let Some(camera) = self.camera_mut(component) {
                    camera.information = Some(information(component, m));
                }
            }
            MavMessage::CAMERA_SETTINGS(m) if m.camera_device_id == 0 => {
                if let Some(camera) = self.camera_mut(component) {
                    let settings = Settings {
                        mode: m.mode_id,
                        zoom: level(m.zoomLevel),
                        focus: level(m.focusLevel),
                    };
                    camera.settings = Some((now, settings));
                }
            }
            MavMessage::CAMERA_CAPTURE_STATUS(m) if m.camera_device_id == 0 => {
                if let Some(camera) = self.camera_mut(component) {
                    let capture = Capture {
                        recording: m.video_status == 1,
                        images: m.image_count,
                    };
                    camera.capture = Some((now, capture));
                }
            }
            MavMessage::STORAGE_INFORMATION(m) => {
                // Autopilots have a card of their own: only that of a camera is a payload's.
                if let Some(camera) = self.cameras.get_mut(&component) {
                    camera.storage = Some(Storage {
                        status: m.status,
                        available_mib: f64::from(m.available_capacity),
                    });
                }
            }
            MavMessage::CAMERA_FOV_STATUS(m) if m.camera_device_id == 0 => {
                let fields = [m.hfov, m.vfov].map(|degrees| f64::from(degrees).to_radians());
                if let Some(camera) = self.cameras.get_mut(&component)
                    && fields.iter().all(|field| field.is_finite() && *field > 0.0)
                {
                    camera.field_of_view = Some((now, fields));
                }
            }
            MavMessage::VIDEO_STREAM_STATUS(m) if m.stream_id == 1 && m.camera_device_id == 0 => {
                self.note_stream(now, component, m.flags);
            }
            MavMessage::VIDEO_STREAM_INFORMATION(m) if m.camera_device_id == 0 => {
                if m.stream_id == 1 {
                    self.note_stream(now, component, m.flags);
                }
                if let Some(camera) = self.cameras.get_mut(&component)
                    && (1..=MAX_STREAMS).contains(&m.stream_id)
                {
                    let information = StreamInformation {
                        count: m.count,
                        kind: m.mavtype as u8,
                        encoding: m.encoding as u8,
                        resolution: [m.resolution_h, m.resolution_v],
                        // What is no text is none.
                        uri: m.uri.to_str().unwrap_or_default().to_owned(),
                    };
                    camera.streams.insert(m.stream_id, information);
                }
            }
            _ => {}
        }
    }

    fn note_stream(&mut self, now: Duration, component: u8, flags: VideoStreamStatusFlags) {
        if let Some(camera) = self.cameras.get_mut(&component) {
            let running = VideoStreamStatusFlags::VIDEO_STREAM_STATUS_FLAGS_RUNNING;
            let thermal = VideoStreamStatusFlags::VIDEO_STREAM_STATUS_FLAGS_THERMAL;
            let stream = Stream {
                running: flags.contains(running),
                thermal: flags.contains(thermal),
            };
            camera.stream = Some((now, stream));
        }
    }

    /// The number of devices of one vehicle is limited, so that input cannot make the table grow.
    fn gimbal_mut(&mut self, device: u8) -> Option<&mut Gimbal> {
        let room = self.gimbals.len() < MAX_DEVICES || self.gimbals.contains_key(&device);
        room.then(|| self.gimbals.entry(device).or_default())
    }

    fn camera_mut(&mut self, component: u8) -> Option<&mut Camera> {
        let room = self.cameras.len() < MAX_DEVICES || self.cameras.contains_key(&component);
        room.then(|| self.cameras.entry(component).or_default())
    }

    /// A gimbal by its device id.
    #[must_use]
    pub fn gimbal(&self, device: Option<u8>) -> Option<&Gimbal> {
        self.gimbals.get(&device?)
    }

    /// A camera by its component id.
    #[must_use]
    pub fn camera(&self, component: Option<u8>) -> Option<&Camera> {
        self.cameras.get(&component?)
    }

    /// Every gimbal with its device id.
    pub fn gimbals(&self) -> impl Iterator<Item = (u8, &Gimbal)> {
        self.gimbals.iter().map(|(id, gimbal)| (*id, gimbal))
    }

    /// Every camera with its component id.
    pub fn cameras(&self) -> impl Iterator<Item = (u8, &Camera)> {
        self.cameras.iter().map(|(id, camera)| (*id, camera))
    }

    /// The payload stations, by rising number: those that the configuration names, or else those that the vehicle shows.
    #[must_use]
    pub fn stations(&self, configured: &[Equipment]) -> Vec<Equipment> {
        if !configured.is_empty() {
            return configured.to_vec();
        }
        let mut stations = BTreeMap::new();
        let mut carried = Vec::new();
        for (id, camera) in &self.cameras {
            let Some(number) = number_of(*id) else {
                continue;
            };
            let gimbal = camera.information.as_ref().and_then(|known| known.gimbal);
            let gimbal = gimbal.filter(|gimbal| self.gimbals.contains_key(gimbal));
            carried.extend(gimbal);
            let station = Equipment {
                number,
                gimbal,
                camera: Some(*id),
            };
            stations.insert(number, station);
        }
        for id in self.gimbals.keys().filter(|id| !carried.contains(id)) {
            let Some(number) = number_of(*id) else {
                continue;
            };
            let station = stations.entry(number).or_insert(Equipment {
                number,
                gimbal: None,
                camera: None,
            });
            // A camera that names no gimbal stands on that of its number.
            station.gimbal.get_or_insert(*id);
        }
        stations.into_values().collect()
    }
}

/// The station of a device by its id: MAV_COMP_ID_CAMERA to _CAMERA6, MAV_COMP_ID_GIMBAL to _GIMBAL6, and the gimbals 1 to 6
/// that an autopilot drives.
fn number_of(id: u8) -> Option<u8> {
    match id {
        1..=6 => Some(id),
        100..=105 => Some(id - 99),
        154 => Some(1),
        171..=175 => Some(id - 169),
        _ => None,
    }
}

fn information(component: u8, m: &CAMERA_INFORMATION_DATA) -> CameraInformation {
    let width = f64::from(m.sensor_size_h);
    CameraInformation {
        can: m.flags,
        resolution: [m.resolution_h, m.resolution_v],
        sensor_width_mm: (width.is_finite() && width > 0.0).then_some(width),
        gimbal: match m.gimbal_device_id {
            0 => None,
            // The gimbal is the same component as the camera.
            7 => Some(component),
            id => Some(id),
        },
    }
}

fn range(low: f32, high: f32) -> Option<[f64; 2]> {
    let both = [low, high].map(f64::from);
    (both.iter().all(|end| end.is_finite()) && low < high).then_some(both)
}

fn level(percent: f32) -> Option<f64> {
    (0.0..=100.0)
        .contains(&percent)
        .then_some(f64::from(percent))
}

/// Gimbal device ids of an autopilot that drives a gimbal itself, and that of PX4's outputs.
const DRIVEN: RangeInclusive<u8> = 1..=6;
const ON_OUTPUTS: u8 = 1;
/// What the outputs were reported to be stands for this long.
const STANDS_FOR: Duration = Duration::from_secs(5);
/// Half a degree, rad: a step of the wire, and what a gimbal rounds.
const SLACK: f64 = 0.009;
/// Streams of each camera that are kept.
const MAX_STREAMS: u8 = 8;
/// Devices of each kind that are kept.
const MAX_DEVICES: usize = 32;

#[cfg(test)]
#[allow(deprecated, reason = "MOUNT_ORIENTATION")]
mod tests {
    use mavlink_link::dialect::{
        GIMBAL_DEVICE_ATTITUDE_STATUS_DATA, GIMBAL_MANAGER_STATUS_DATA, HEARTBEAT_DATA,
        MOUNT_ORIENTATION_DATA,
    };

    use super::*;

    const NOW: Duration = Duration::from_secs(1);

    fn camera(gimbal: u8) -> MavMessage {
        MavMessage::CAMERA_INFORMATION(CAMERA_INFORMATION_DATA {
            gimbal_device_id: gimbal,
            ..CAMERA_INFORMATION_DATA::default()
        })
    }

    fn device() -> MavMessage {
        MavMessage::GIMBAL_DEVICE_ATTITUDE_STATUS(GIMBAL_DEVICE_ATTITUDE_STATUS_DATA {
            q: [1.0, 0.0, 0.0, 0.0],
            ..GIMBAL_DEVICE_ATTITUDE_STATUS_DATA::default()
        })
    }

    #[test]
    fn a_station_has_the_number_of_its_device_whatever_reports_first() {
        let mut forwards = Payloads::default();
        let mut backwards = Payloads::default();
        let reports = [
            (154, device()),
            (100, camera(0)),
            (101, camera(171)),
            (171, device()),
        ];
        for (id, message) in &reports {
            forwards.update(NOW, *id, message);
        }
        for (id, message) in reports.iter().rev() {
            backwards.update(NOW, *id, message);
        }
        let expected = [(1, Some(154), Some(100)), (2, Some(171), Some(101))];
        for payloads in [forwards, backwards] {
            let stations = payloads.stations(&[]);
            let found: Vec<_> = stations
                .iter()
                .map(|s| (s.number, s.gimbal, s.camera))
                .collect();
            assert_eq!(found, expected);
        }
    }

    #[test]
    fn a_vehicle_without_payload_has_no_station_and_one_that_is_configured_has_just_those() {
        let mut payloads = Payloads::default();
        payloads.update(NOW, 1, &MavMessage::HEARTBEAT(HEARTBEAT_DATA::default()));
        assert!(payloads.stations(&[]).is_empty());
        payloads.update(NOW, 154, &device());
        let configured = Equipment {
            number: 7,
            gimbal: Some(154),
            camera: None,
        };
        assert_eq!(payloads.stations(&[configured]), [configured]);
    }

    /// PX4's set point, as the attitude of the gimbal on its outputs.
    fn set_point() -> MavMessage {
        let half = std::f32::consts::FRAC_PI_8;
        MavMessage::GIMBAL_DEVICE_ATTITUDE_STATUS(GIMBAL_DEVICE_ATTITUDE_STATUS_DATA {
            q: [half.cos(), 0.0, 0.0, half.sin()],
            flags: GimbalDeviceFlags::GIMBAL_DEVICE_FLAGS_NEUTRAL
                | GimbalDeviceFlags::GIMBAL_DEVICE_FLAGS_YAW_LOCK,
            gimbal_device_id: 1,
            ..GIMBAL_DEVICE_ATTITUDE_STATUS_DATA::default()
        })
    }

    fn outputs(time_boot_ms: u32, yaw: f32) -> MavMessage {
        MavMessage::MOUNT_ORIENTATION(MOUNT_ORIENTATION_DATA {
            time_boot_ms,
            yaw,
            ..MOUNT_ORIENTATION_DATA::default()
        })
    }

    #[test]
    fn a_gimbal_on_outputs_is_where_they_are_and_not_where_it_is_to_be() {
        let mut payloads = Payloads::default();
        let status = MavMessage::GIMBAL_MANAGER_STATUS(GIMBAL_MANAGER_STATUS_DATA {
            gimbal_device_id: 1,
            ..GIMBAL_MANAGER_STATUS_DATA::default()
        });
        payloads.update(NOW, 1, &status);
        let yaw = |payloads: &Payloads| {
            let gimbal = payloads.gimbal(Some(1)).expect("a gimbal");
            let (_, attitude) = gimbal.attitude.expect("an attitude");
            let [_, _, yaw] = super::super::pointing::euler(attitude.q);
            (attitude.frame, yaw.to_degrees().round(), attitude.rates)
        };
        payloads.update(NOW, 1, &set_point());
        assert_eq!(yaw(&payloads), (Frame::North, 45.0, Some([0.0; 2])));
        let attitude = payloads.gimbal(Some(1)).and_then(|one| one.attitude);
        assert!(attitude.is_some_and(|(_, attitude)| !attitude.neutral));
        // A gimbal of its own does not use them.
        payloads.update(NOW, 154, &outputs(100, -80.0));
        assert_eq!(yaw(&payloads).1, 45.0);
        payloads.update(NOW, 1, &outputs(100, 10.0));
        payloads.update(NOW, 1, &set_point());
        assert_eq!(yaw(&payloads), (Frame::Body, 10.0, None));
        payloads.update(NOW, 1, &outputs(300, 12.0));
        let (_, _, rates) = yaw(&payloads);
        let [pitch, turn] = rates.expect("two reports");
        assert!(
            pitch == 0.0 && (turn.to_degrees() - 10.0).abs() < 1e-3,
            "{turn}"
        );
        payloads.update(NOW + STANDS_FOR, 1, &set_point());
        assert_eq!(yaw(&payloads).1, 45.0, "without them it is all there is");
    }

    #[test]
    fn a_report_of_a_gimbal_is_of_the_time_that_the_vehicle_has_by_then() {
        let ms = Duration::from_millis;
        let mut payloads = Payloads::default();
        let dated = |payloads: &mut Payloads, after_ms: u64| {
            payloads.update(NOW + ms(after_ms), 154, &device());
            let attitude = payloads.gimbal(Some(154)).and_then(|one| one.attitude);
            attitude.expect("a report").1.vehicle_ms
        };
        assert_eq!(dated(&mut payloads, 0), None);
        payloads.note_time(NOW, Some(5_000));
        assert_eq!(dated(&mut payloads, 0), Some(5_000));
        // A message of the autopilot without a time shows none.
        payloads.note_time(NOW + ms(100), Some(5_000));
        assert_eq!(dated(&mut payloads, 150), Some(5_150));
        payloads.note_time(NOW + ms(210), Some(5_200));
        assert_eq!(dated(&mut payloads, 260), Some(5_250));
        // It has restarted.
        payloads.note_time(NOW + ms(300), None);
        assert_eq!(dated(&mut payloads, 400), None);
    }

    #[test]
    fn a_gimbal_that_the_autopilot_drives_is_known_by_the_id_in_its_messages() {
        let mut payloads = Payloads::default();
        let status = MavMessage::GIMBAL_MANAGER_STATUS(GIMBAL_MANAGER_STATUS_DATA {
            gimbal_device_id: 1,
            primary_control_sysid: 245,
            primary_control_compid: 190,
            ..GIMBAL_MANAGER_STATUS_DATA::default()
        });
        payloads.update(NOW, 1, &status);
        let gimbal = payloads.gimbal(Some(1)).expect("a gimbal");
        assert_eq!(gimbal.control, Some((NOW, [245, 190])));
        assert_eq!(payloads.stations(&[])[0].number, 1);
    }
}
