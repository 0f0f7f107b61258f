//! A camera of the MAVLink camera protocol: image and video mode, zoom, focus, photographs, video, storage, one stream.

use mavlink::MessageData as _;
use mavlink::dialects::development as mav;
use mavlink::dialects::development::{
    CameraCapFlags, CameraMode, MavMessage, MavType, StorageStatus, VideoStreamStatusFlags,
};

use super::gimbal::{Carrier, FromComponent};
use crate::vehicle::command::{Answer, Command};

/// The sensors of a camera.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Kind {
    Eo,
    EoIr,
}

/// A picture every so many seconds.
#[derive(Debug, Clone, Copy)]
struct Series {
    every_s: f64,
    /// How many are left, where they are limited.
    left: Option<u32>,
    next: f64,
}

#[derive(Debug)]
pub(crate) struct Camera {
    component: u8,
    gimbal: u8,
    kind: Kind,
    mode: CameraMode,
    /// Zoom, 0 to 100; where it moves to; and its speed by itself, per second.
    zoom: f64,
    zoom_to: Option<f64>,
    zoom_rate: f64,
    focus: f64,
    focus_rate: f64,
    recording_since: Option<f64>,
    images: u32,
    series: Option<Series>,
    left_mib: f64,
    thermal: bool,
    next_heartbeat: f64,
}

impl Camera {
    pub(crate) fn new(component: u8, gimbal: u8, kind: Kind) -> Camera {
        Camera {
            component,
            gimbal,
            kind,
            mode: CameraMode::CAMERA_MODE_IMAGE,
            zoom: 0.0,
            zoom_to: None,
            zoom_rate: 0.0,
            focus: 50.0,
            focus_rate: 0.0,
            recording_since: None,
            images: 0,
            series: None,
            left_mib: CAPACITY_MIB,
            thermal: false,
            next_heartbeat: 2.0,
        }
    }

    pub(crate) fn component(&self) -> u8 {
        self.component
    }

    pub(crate) fn hfov(&self) -> f64 {
        2.0 * (SENSOR_MM / 2.0 / self.focal_mm()).atan()
    }

    pub(crate) fn is_recording(&self) -> bool {
        self.recording_since.is_some()
    }

    pub(crate) fn images(&self) -> u32 {
        self.images
    }

    pub(crate) fn is_thermal(&self) -> bool {
        self.thermal
    }

    pub(crate) fn focus(&self) -> f64 {
        self.focus
    }

    pub(crate) fn set_storage(&mut self, left_mib: f64) {
        self.left_mib = left_mib;
    }

    pub(crate) fn step(&mut self, dt: f64, carrier: &Carrier, out: &mut Vec<FromComponent>) {
        if let Some(to) = self.zoom_to {
            let step = (to - self.zoom).clamp(-ZOOM_RATE * dt, ZOOM_RATE * dt);
            self.zoom += step;
        } else {
            self.zoom = (self.zoom + self.zoom_rate * dt).clamp(0.0, 100.0);
        }
        self.focus = (self.focus + self.focus_rate * dt).clamp(0.0, 100.0);
        self.continue_series(carrier.now);
        if self.is_recording() {
            self.left_mib -= VIDEO_MIB_S * dt;
            if self.left_mib <= 0.0 {
                self.left_mib = 0.0;
                self.recording_since = None;
            }
        }
        if carrier.now >= self.next_heartbeat {
            self.next_heartbeat = carrier.now + 1.0;
            let heartbeat = mav::HEARTBEAT_DATA {
                mavtype: MavType::MAV_TYPE_CAMERA,
                autopilot: mav::MavAutopilot::MAV_AUTOPILOT_INVALID,
                system_status: mav::MavState::MAV_STATE_ACTIVE,
                mavlink_version: 3,
                ..Default::default()
            };
            out.push((self.component, MavMessage::HEARTBEAT(heartbeat)));
        }
    }

    /// Carries out a command to this component.
    pub(crate) fn execute(
        &mut self,
        command: &Command,
        carrier: &Carrier,
    ) -> (Answer, Vec<FromComponent>) {
        let mut out = Vec::new();
        let answer = match command.id {
            512 => match self.report(command.param(1) as u32, carrier) {
                Some(message) => {
                    out.push((self.component, message));
                    Answer::Accepted
                }
                None => Answer::Denied,
            },
            530 => self.set_mode(command.param(2)),
            531 => self.set_zoom(command.param(1), command.param(2)),
            532 => self.set_focus(command.param(1), command.param(2)),
            534 => self.set_source(command.param(2)),
            2000 => self.photographs(command.param(2), command.param(3), carrier.now),
            2001 => {
                self.series = None;
                Answer::Accepted
            }
            2500 => self.record(carrier.now),
            2501 => {
                self.recording_since = None;
                Answer::Accepted
            }
            _ => Answer::Unsupported,
        };
        (answer, out)
    }

    fn set_mode(&mut self, mode: f64) -> Answer {
        self.mode = match mode as i64 {
            0 => CameraMode::CAMERA_MODE_IMAGE,
            1 => CameraMode::CAMERA_MODE_VIDEO,
            _ => return Answer::Denied,
        };
        match self.mode {
            CameraMode::CAMERA_MODE_VIDEO => self.series = None,
            _ => self.recording_since = None,
        }
        Answer::Accepted
    }

    fn set_zoom(&mut self, kind: f64, value: f64) -> Answer {
        if !value.is_finite() {
            return Answer::Denied;
        }
        (self.zoom_to, self.zoom_rate) = match kind as i64 {
            0 => (
                Some((self.zoom + value.signum() * 10.0).clamp(0.0, 100.0)),
                0.0,
            ),
            1 => (None, value.clamp(-1.0, 1.0) * ZOOM_RATE),
            2 if (0.0..=100.0).contains(&value) => (Some(value), 0.0),
            3 => {
                let zoom = (value / WIDE_MM - 1.0) / (TIMES - 1.0) * 100.0;
                if !(-0.5..=100.5).contains(&zoom) {
                    return Answer::Denied;
                }
                (Some(zoom.clamp(0.0, 100.0)), 0.0)
            }
            _ => return Answer::Denied,
        };
        Answer::Accepted
    }

    fn set_focus(&mut self, kind: f64, value: f64) -> Answer {
        match kind as i64 {
            0 => self.focus = (self.focus + value.signum() * 5.0).clamp(0.0, 100.0),
            1 => self.focus_rate = value.clamp(-1.0, 1.0) * 20.0,
            2 if (0.0..=100.0).contains(&value) => self.focus = value,
            4..=6 => {
                self.focus_rate = 0.0;
                self.focus = 70.0;
            }
            _ => return Answer::Denied,
        }
        Answer::Accepted
    }

    fn set_source(&mut self, source: f64) -> Answer {
        self.thermal = match (self.kind, source as i64) {
            (_, 0 | 1) => false,
            (Kind::EoIr, 2) => true,
            _ => return Answer::Denied,
        };
        Answer::Accepted
    }

    /// Takes one photograph, a number of them, or (0) one every `every_s` until they are stopped.
    fn photographs(&mut self, every_s: f64, count: f64, now: f64) -> Answer {
        let left = match count as i64 {
            1 => return self.photograph(),
            0 => None,
            more => u32::try_from(more).ok().map(|more| more - 1),
        };
        if every_s.is_nan() || every_s <= 0.0 || count < 0.0 {
            return Answer::Denied;
        }
        let first = self.photograph();
        if first == Answer::Accepted {
            let next = now + every_s;
            self.series = Some(Series {
                every_s,
                left,
                next,
            });
        }
        first
    }

    fn continue_series(&mut self, now: f64) {
        let Some(series) = &mut self.series else {
            return;
        };
        if series.left == Some(0) {
            self.series = None;
        } else if now >= series.next {
            series.next += series.every_s;
            series.left = series.left.map(|left| left - 1);
            self.photograph();
        }
    }

    fn photograph(&mut self) -> Answer {
        if self.left_mib < IMAGE_MIB {
            return Answer::Failed;
        }
        // It takes no photographs in video mode, as its flags state.
        if self.mode != CameraMode::CAMERA_MODE_IMAGE {
            return Answer::TemporarilyRejected;
        }
        self.left_mib -= IMAGE_MIB;
        self.images += 1;
        Answer::Accepted
    }

    fn record(&mut self, now: f64) -> Answer {
        if self.mode != CameraMode::CAMERA_MODE_VIDEO {
            return Answer::TemporarilyRejected;
        }
        if self.left_mib <= 0.0 {
            return Answer::Failed;
        }
        self.recording_since.get_or_insert(now);
        Answer::Accepted
    }

    fn report(&self, message: u32, carrier: &Carrier) -> Option<MavMessage> {
        let time_boot_ms = carrier.boot_ms();
        let hfov = self.hfov();
        let vfov = 2.0 * ((hfov / 2.0).tan() * ROWS / COLUMNS).atan();
        Some(match message {
            mav::CAMERA_INFORMATION_DATA::ID => {
                MavMessage::CAMERA_INFORMATION(mav::CAMERA_INFORMATION_DATA {
                    time_boot_ms,
                    focal_length: self.focal_mm() as f32,
                    sensor_size_h: SENSOR_MM as f32,
                    sensor_size_v: (SENSOR_MM * ROWS / COLUMNS) as f32,
                    flags: self.flags(),
                    resolution_h: COLUMNS as u16,
                    resolution_v: ROWS as u16,
                    gimbal_device_id: self.gimbal,
                    ..Default::default()
                })
            }
            mav::CAMERA_SETTINGS_DATA::ID => {
                MavMessage::CAMERA_SETTINGS(mav::CAMERA_SETTINGS_DATA {
                    time_boot_ms,
                    mode_id: self.mode,
                    zoomLevel: self.zoom as f32,
                    focusLevel: self.focus as f32,
                    camera_device_id: 0,
                })
            }
            mav::CAMERA_CAPTURE_STATUS_DATA::ID => {
                let recording = self
                    .recording_since
                    .map_or(0.0, |since| carrier.now - since);
                MavMessage::CAMERA_CAPTURE_STATUS(mav::CAMERA_CAPTURE_STATUS_DATA {
                    time_boot_ms,
                    recording_time_ms: (recording * 1e3) as u32,
                    available_capacity: self.left_mib as f32,
                    video_status: u8::from(self.is_recording()),
                    // Idle, or idle between two photographs of a series.
                    image_status: if self.series.is_some() { 2 } else { 0 },
                    image_interval: self.series.map_or(0.0, |one| one.every_s as f32),
                    image_count: self.images as i32,
                    ..Default::default()
                })
            }
            mav::STORAGE_INFORMATION_DATA::ID => {
                MavMessage::STORAGE_INFORMATION(mav::STORAGE_INFORMATION_DATA {
                    time_boot_ms,
                    total_capacity: CAPACITY_MIB as f32,
                    used_capacity: (CAPACITY_MIB - self.left_mib) as f32,
                    available_capacity: self.left_mib as f32,
                    storage_id: 1,
                    storage_count: 1,
                    status: StorageStatus::STORAGE_STATUS_READY,
                    ..Default::default()
                })
            }
            mav::CAMERA_FOV_STATUS_DATA::ID => {
                MavMessage::CAMERA_FOV_STATUS(mav::CAMERA_FOV_STATUS_DATA {
                    time_boot_ms,
                    lat_camera: i32::MAX,
                    lon_camera: i32::MAX,
                    alt_camera: i32::MAX,
                    lat_image: i32::MAX,
                    lon_image: i32::MAX,
                    alt_image: i32::MAX,
                    q: [f32::NAN; 4],
                    hfov: hfov.to_degrees() as f32,
                    vfov: vfov.to_degrees() as f32,
                    camera_device_id: 0,
                })
            }
            mav::VIDEO_STREAM_STATUS_DATA::ID => {
                let mut flags = VideoStreamStatusFlags::VIDEO_STREAM_STATUS_FLAGS_RUNNING;
                if self.thermal {
                    flags |= VideoStreamStatusFlags::VIDEO_STREAM_STATUS_FLAGS_THERMAL;
                }
                MavMessage::VIDEO_STREAM_STATUS(mav::VIDEO_STREAM_STATUS_DATA {
                    framerate: 30.0,
                    bitrate: 4_000_000,
                    flags,
                    resolution_h: COLUMNS as u16,
                    resolution_v: ROWS as u16,
                    hfov: hfov.to_degrees().round() as u16,
                    stream_id: 1,
                    ..Default::default()
                })
            }
            mav::VIDEO_STREAM_INFORMATION_DATA::ID => {
                MavMessage::VIDEO_STREAM_INFORMATION(mav::VIDEO_STREAM_INFORMATION_DATA {
                    framerate: 30.0,
                    bitrate: 4_000_000,
                    flags: VideoStreamStatusFlags::VIDEO_STREAM_STATUS_FLAGS_RUNNING,
                    resolution_h: COLUMNS as u16,
                    resolution_v: ROWS as u16,
                    hfov: hfov.to_degrees().round() as u16,
                    stream_id: 1,
                    count: 1,
                    mavtype: mav::VideoStreamType::VIDEO_STREAM_TYPE_RTSP,
                    encoding: mav::VideoStreamEncoding::VIDEO_STREAM_ENCODING_H264,
                    uri: self.stream_uri().as_str().into(),
                    ..Default::default()
                })
            }
            _ => return None,
        })
    }

    /// The URI of its pictures; nothing is served there.
    fn stream_uri(&self) -> String {
        format!("rtsp://192.168.144.25:8554/camera{}", self.component)
    }

    fn flags(&self) -> CameraCapFlags {
        use CameraCapFlags as C;
        let mut flags = C::CAMERA_CAP_FLAGS_CAPTURE_VIDEO
            | C::CAMERA_CAP_FLAGS_CAPTURE_IMAGE
            | C::CAMERA_CAP_FLAGS_HAS_MODES
            | C::CAMERA_CAP_FLAGS_HAS_BASIC_ZOOM
            | C::CAMERA_CAP_FLAGS_HAS_BASIC_FOCUS
            | C::CAMERA_CAP_FLAGS_HAS_VIDEO_STREAM;
        if self.kind == Kind::EoIr {
            flags |= C::CAMERA_CAP_FLAGS_HAS_THERMAL_RANGE;
        }
        flags
    }

    fn focal_mm(&self) -> f64 {
        WIDE_MM * (1.0 + (TIMES - 1.0) * self.zoom / 100.0)
    }
}

/// A sensor of 1/2.3 inch: at 5.54 mm it has a field of view of 60 degrees.
const SENSOR_MM: f64 = 6.4;
/// Shortest focal length, mm, and how many times it the longest is.
const WIDE_MM: f64 = 5.543;
const TIMES: f64 = 10.0;
/// Pixels of the image.
const COLUMNS: f64 = 1920.0;
const ROWS: f64 = 1080.0;
/// Change of zoom per second, on the scale of 0 to 100.
const ZOOM_RATE: f64 = 25.0;
/// Storage of a new card, and what a photograph and a second of video take.
const CAPACITY_MIB: f64 = 30_000.0;
const IMAGE_MIB: f64 = 8.0;
const VIDEO_MIB_S: f64 = 4.0;
