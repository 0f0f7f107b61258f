//! One step of a payload command: the message to send, and the reported state that confirms it.
//!
//! An accepted COMMAND_ACK proves little here too: PX4's gimbal manager acknowledges a retraction that it does not carry
//! out. So a step ends only when the gimbal or the camera reports the result in a message that arrived after the answer.

use std::time::Duration;

use mapping::payload::Direction;
use mapping::payload::pointing::{
    GimbalAttitude, between, direction, euler, line_of_sight, looking_along, quaternion, sight_of,
    sight_to,
};
use mapping::payload::report::Station;
use mapping::telemetry::{Place, Telemetry};
use mavlink_link::dialect::{
    CameraMode, CameraSource, CameraZoomType, GIMBAL_MANAGER_SET_ATTITUDE_DATA,
    GIMBAL_MANAGER_SET_PITCHYAW_DATA, GimbalManagerFlags, MavCmd, MavMessage, SetFocusType,
};
use mavlink_link::service::Node;
use mavlink_link::service::command::{Command, Payload, Repetition};

/// A step.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Step {
    /// Primary control of the gimbal: PX4 refuses commands of anybody else.
    Control,
    /// Look in this direction, relative to the vehicle.
    Point(Direction),
    /// Turn: rates up and right, rad/s; relative to the horizon and north, or to the vehicle.
    Slew(Slew),
    /// Keep looking at a place.
    StareAt(Place),
    Neutral,
    Retract,
    Zoom(Zoom),
    Focus(Focus),
    Mode(CameraMode),
    Record(bool),
    Photograph,
    /// Show the thermal sensor, or the other one.
    Source {
        thermal: bool,
    },
}

/// Rates of a gimbal.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Slew {
    pub(super) up: f64,
    pub(super) right: f64,
    pub(super) inertial: bool,
}

/// A message that a gimbal is sent repeatedly, so that it continues.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Motion {
    Rates(Slew),
    /// The gimbal keeps looking at a place. The bridge steers it: PX4's navigator takes DO_SET_ROI_LOCATION too, but with
    /// MIS_MNT_YAW_CTL 0 it turns a multicopter towards the place, also during somebody else's mission. LOI 3 must not turn
    /// the vehicle.
    Stare(Place),
}

/// What a step moves: a newer command replaces the older one's steps for the same drive.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Drive {
    Gimbal,
    Zoom,
    Focus,
}

#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Zoom {
    Stop,
    In,
    Out,
    /// To this horizontal field of view, rad, by this focal length, mm.
    Field {
        horizontal: f64,
        focal_mm: f64,
    },
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Focus {
    Closer,
    Farther,
    Auto,
}

/// The message to send for a step.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum Order {
    /// A command to this component, which answers it.
    Command(u8, Command),
    /// A message without an answer.
    Post(Motion),
}

/// The state before the step, for steps that are a change.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(super) struct Before {
    zoom: Option<f64>,
    focus: Option<f64>,
    images: Option<i32>,
    /// The latest zoom report since then, to detect that the zoom has stopped.
    pub(super) last_zoom: Option<(Duration, f64)>,
}

impl Before {
    pub(super) fn of(station: &Station<'_>) -> Before {
        let camera = station.camera;
        let settings = camera
            .and_then(|camera| camera.settings)
            .map(|(_, known)| known);
        Before {
            zoom: settings.and_then(|known| known.zoom),
            focus: settings.and_then(|known| known.focus),
            images: camera
                .and_then(|camera| camera.capture)
                .map(|(_, known)| known.images),
            last_zoom: None,
        }
    }
}

impl Step {
    /// What it moves, if that can only move one way at a time.
    pub(super) fn drive(self) -> Option<Drive> {
        match self {
            Step::Control
            | Step::Point(_)
            | Step::Slew(_)
            | Step::StareAt(_)
            | Step::Neutral
            | Step::Retract => Some(Drive::Gimbal),
            Step::Zoom(_) => Some(Drive::Zoom),
            Step::Focus(_) => Some(Drive::Focus),
            _ => None,
        }
    }

    /// Whether a continuing zoom is over once this is shown.
    pub(super) fn ends_zoom(self) -> bool {
        matches!(self, Step::Zoom(Zoom::Stop | Zoom::Field { .. }))
    }

    /// Whether a manual focus is over once this is shown.
    pub(super) fn ends_manual_focus(self) -> bool {
        self == Step::Focus(Focus::Auto)
    }

    /// The motion that continues after it.
    pub(super) fn motion(self) -> Option<Motion> {
        match self {
            Step::Slew(slew) if !slew.is_still() => Some(Motion::Rates(slew)),
            Step::StareAt(place) => Some(Motion::Stare(place)),
            _ => None,
        }
    }

    /// Whether nothing has to be sent, because the state is already reached.
    pub(super) fn is_so(self, station: &Station<'_>, own: Node) -> bool {
        let camera = station.camera;
        match self {
            Step::Control => controls(station, own),
            Step::Mode(mode) => camera
                .and_then(|camera| station.fresh(camera.settings))
                .is_some_and(|settings| settings.mode == mode),
            _ => false,
        }
    }

    /// The message for it; `None` if the station lacks the device.
    pub(super) fn order(self, station: &Station<'_>, own: Node) -> Option<Order> {
        let camera = || station.equipment.camera;
        let to_camera = |command, params, repetition| {
            let payload = Payload::Long(params);
            camera().map(|camera| {
                Order::Command(
                    camera,
                    Command {
                        command,
                        payload,
                        repetition,
                    },
                )
            })
        };
        let device = station.equipment.gimbal.unwrap_or(0);
        let manager = manager(station);
        let id = f32::from(device);
        let long = |command, params| {
            let command = Command {
                command,
                payload: Payload::Long(params),
                repetition: Repetition::Safe,
            };
            manager.map(|manager| Order::Command(manager, command))
        };
        let angles = |flags: GimbalManagerFlags, pitch: f64, yaw: f64| {
            let (pitch, yaw) = (pitch.to_degrees() as f32, yaw.to_degrees() as f32);
            let rate = f32::NAN;
            long(
                MavCmd::MAV_CMD_DO_GIMBAL_MANAGER_PITCHYAW,
                [pitch, yaw, rate, rate, flags.bits() as f32, 0.0, id],
            )
        };
        match self {
            Step::Control => long(
                MavCmd::MAV_CMD_DO_GIMBAL_MANAGER_CONFIGURE,
                [
                    f32::from(own.system),
                    f32::from(own.component),
                    // -1 leaves secondary control unchanged.
                    -1.0,
                    -1.0,
                    0.0,
                    0.0,
                    id,
                ],
            ),
            Step::Point(Direction { azimuth, elevation }) => {
                angles(GimbalManagerFlags::empty(), elevation, azimuth)
            }
            Step::Neutral => angles(GimbalManagerFlags::GIMBAL_MANAGER_FLAGS_NEUTRAL, 0.0, 0.0),
            Step::Retract => angles(GimbalManagerFlags::GIMBAL_MANAGER_FLAGS_RETRACT, 0.0, 0.0),
            Step::Slew(slew) => Some(Order::Post(Motion::Rates(slew))),
            Step::StareAt(place) => Some(Order::Post(Motion::Stare(place))),
            Step::Zoom(zoom) => {
                let (kind, value) = match zoom {
                    Zoom::Stop => (CameraZoomType::ZOOM_TYPE_CONTINUOUS, 0.0),
                    Zoom::In => (CameraZoomType::ZOOM_TYPE_CONTINUOUS, 1.0),
                    Zoom::Out => (CameraZoomType::ZOOM_TYPE_CONTINUOUS, -1.0),
                    Zoom::Field { focal_mm, .. } => {
                        (CameraZoomType::ZOOM_TYPE_FOCAL_LENGTH, focal_mm as f32)
                    }
                };
                let params = [kind as u32 as f32, value, 0.0, 0.0, 0.0, 0.0, 0.0];
                to_camera(MavCmd::MAV_CMD_SET_CAMERA_ZOOM, params, Repetition::Safe)
            }
            Step::Focus(focus) => {
                let (kind, value, repetition) = match focus {
                    // A repeated step would move the focus a second time.
                    Focus::Closer => (SetFocusType::FOCUS_TYPE_STEP, -1.0, Repetition::Never),
                    Focus::Farther => (SetFocusType::FOCUS_TYPE_STEP, 1.0, Repetition::Never),
                    Focus::Auto => (
                        SetFocusType::FOCUS_TYPE_AUTO_CONTINUOUS,
                        0.0,
                        Repetition::Safe,
                    ),
                };
                let params = [kind as u32 as f32, value, 0.0, 0.0, 0.0, 0.0, 0.0];
                to_camera(MavCmd::MAV_CMD_SET_CAMERA_FOCUS, params, repetition)
            }
            Step::Mode(mode) => to_camera(
                MavCmd::MAV_CMD_SET_CAMERA_MODE,
                [0.0, mode as u32 as f32, 0.0, 0.0, 0.0, 0.0, 0.0],
                Repetition::Safe,
            ),
            Step::Record(true) => to_camera(
                MavCmd::MAV_CMD_VIDEO_START_CAPTURE,
                // Stream 0 means all streams; status frequency 0, since CAMERA_CAPTURE_STATUS is requested separately.
                [0.0; 7],
                Repetition::Safe,
            ),
            Step::Record(false) => to_camera(
                MavCmd::MAV_CMD_VIDEO_STOP_CAPTURE,
                [0.0; 7],
                Repetition::Safe,
            ),
            Step::Photograph => to_camera(
                MavCmd::MAV_CMD_IMAGE_START_CAPTURE,
                // One image. A repeated command would take another one.
                [0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0],
                Repetition::Never,
            ),
            Step::Source { thermal } => {
                let source = if thermal {
                    CameraSource::CAMERA_SOURCE_IR
                } else {
                    CameraSource::CAMERA_SOURCE_RGB
                };
                to_camera(
                    MavCmd::MAV_CMD_SET_CAMERA_SOURCE,
                    [0.0, source as u32 as f32, 0.0, 0.0, 0.0, 0.0, 0.0],
                    Repetition::Safe,
                )
            }
        }
    }

    /// Whether the station shows it, by reports from after `since`.
    pub(super) fn is_shown(
        self,
        station: &Station<'_>,
        telemetry: &Telemetry,
        own: Node,
        before: &Before,
        since: Duration,
    ) -> bool {
        let attitude = station
            .gimbal
            .and_then(|gimbal| gimbal.attitude)
            .filter(|(at, _)| *at > since)
            .map(|(_, attitude)| attitude);
        let camera = station.camera;
        let settings = camera
            .and_then(|camera| camera.settings)
            .filter(|(at, _)| *at > since);
        let capture = camera
            .and_then(|camera| camera.capture)
            .filter(|(at, _)| *at > since)
            .map(|(_, capture)| capture);
        match self {
            Step::Control => controls(station, own),
            Step::Point(at) => attitude.is_some_and(|shown| looks(&shown, at, telemetry)),
            Step::Neutral => attitude.is_some_and(|shown| {
                !shown.retracted && (shown.neutral || looks(&shown, FORWARD, telemetry))
            }),
            Step::Retract => attitude.is_some_and(|shown| shown.retracted),
            Step::Slew(slew) => attitude.is_some_and(|shown| slew.is_shown(&shown)),
            Step::StareAt(place) => {
                let sight = station.sight(telemetry);
                attitude.is_some()
                    && sight
                        .zip(telemetry.position)
                        .is_some_and(|(sight, from)| between(sight, sight_to(from, place)) < CLOSE)
            }
            Step::Zoom(Zoom::Field { horizontal, .. }) => camera
                .and_then(|camera| camera.field_of_view)
                .is_some_and(|(at, [shown, _])| {
                    at > since && (shown - horizontal).abs() < 0.05 * horizontal
                }),
            Step::Zoom(zoom) => settings
                .and_then(|(at, settings)| Some((at, settings.zoom?)))
                .is_some_and(|(at, shown)| match (zoom, before.zoom) {
                    // At the end of its range the zoom can no longer change.
                    (Zoom::In, Some(was)) => shown > was + 0.5 || shown >= 99.5,
                    (Zoom::Out, Some(was)) => shown < was - 0.5 || shown <= 0.5,
                    (Zoom::Stop, _) => before
                        .last_zoom
                        .is_some_and(|(then, zoom)| then < at && (zoom - shown).abs() < 0.5),
                    _ => false,
                }),
            // The protocol has no report of it: the acknowledgement has to be enough.
            Step::Focus(Focus::Auto) => true,
            Step::Focus(focus) => settings
                .and_then(|(_, settings)| settings.focus)
                .zip(before.focus)
                .is_some_and(|(shown, was)| match focus {
                    Focus::Closer => shown < was || shown <= 0.0,
                    _ => shown > was || shown >= 100.0,
                }),
            Step::Mode(mode) => settings.is_some_and(|(_, settings)| settings.mode == mode),
            Step::Record(on) => capture.is_some_and(|capture| capture.recording == on),
            Step::Photograph => capture
                .zip(before.images)
                .is_some_and(|(capture, was)| capture.images > was),
            Step::Source { thermal } => {
                camera
                    .and_then(|camera| camera.stream)
                    .is_some_and(|(at, stream)| {
                        at > since && stream.running && stream.thermal == thermal
                    })
            }
        }
    }

    /// The message of the camera that shows it; it is requested until it does.
    pub(super) fn evidence(self) -> Option<u16> {
        match self {
            Step::Zoom(Zoom::Field { .. }) => Some(CAMERA_FOV_STATUS),
            Step::Zoom(_) | Step::Focus(_) | Step::Mode(_) => Some(CAMERA_SETTINGS),
            Step::Record(_) | Step::Photograph => Some(CAMERA_CAPTURE_STATUS),
            Step::Source { .. } => Some(VIDEO_STREAM_STATUS),
            _ => None,
        }
    }

    /// How long the step may take.
    pub(super) fn limit(self) -> Duration {
        match self {
            // Enough for a slow drive to turn by 180 degrees.
            Step::Point(_) | Step::StareAt(_) | Step::Neutral | Step::Retract => {
                Duration::from_secs(20)
            }
            Step::Zoom(_) => Duration::from_secs(12),
            _ => Duration::from_secs(6),
        }
    }

    /// What did not happen, for a refusal.
    pub(super) fn undone(self) -> &'static str {
        match self {
            Step::Control => {
                "the gimbal manager does not show this VSM in primary control (GIMBAL_MANAGER_STATUS)"
            }
            Step::Point(_) => "the gimbal does not show the commanded angles",
            Step::Slew(_) => "the gimbal does not show the commanded rates: it may be at its limit",
            Step::StareAt(_) => "the gimbal does not look at the commanded place",
            Step::Neutral => "the gimbal does not show its neutral position",
            Step::Retract => "the gimbal does not show that it is retracted",
            Step::Zoom(_) => "the camera does not show the commanded zoom",
            Step::Focus(_) => "the camera does not show another focus",
            Step::Mode(_) => "the camera does not show the mode that this needs",
            Step::Record(true) => "the camera does not show that it records",
            Step::Record(false) => "the camera does not show that recording has ended",
            Step::Photograph => "the camera has not counted another image",
            Step::Source { .. } => "the video stream does not show the commanded sensor",
        }
    }
}

impl Slew {
    pub(super) const STILL: Slew = Slew {
        up: 0.0,
        right: 0.0,
        inertial: false,
    };

    fn is_still(self) -> bool {
        self.up == 0.0 && self.right == 0.0
    }

    /// A drive may be slower than commanded: what counts is that it turns the right way.
    fn is_shown(self, gimbal: &GimbalAttitude) -> bool {
        let Some([up, right]) = gimbal.rates else {
            return false;
        };
        [(self.up, up), (self.right, right)]
            .into_iter()
            .all(|(commanded, shown)| {
                if commanded.abs() < STILL_RAD_S {
                    shown.abs() < 2.0 * STILL_RAD_S
                } else {
                    shown * commanded.signum() > 0.5 * commanded.abs()
                }
            })
    }
}

impl Motion {
    /// The repetition period: PX4 stops rates 2 s after they were set; a place moves relative to the vehicle, whose
    /// position arrives at 5 Hz.
    pub(super) fn again(self) -> Duration {
        match self {
            Motion::Rates(_) => Duration::from_secs(1),
            Motion::Stare(_) => Duration::from_millis(200),
        }
    }

    /// To PX4's manager GIMBAL_MANAGER_SET_ATTITUDE: PX4 treats angles that DO_GIMBAL_MANAGER_PITCHYAW leaves out as 0, so that
    /// command cannot set rates alone. To any other GIMBAL_MANAGER_SET_PITCHYAW: PX4 takes the first for its own gimbal, whatever
    /// component it is for (MavlinkReceiver, InputMavlinkGimbalV2), and would turn that too. `None` before the gimbal has a
    /// manager, and for a place before the vehicle's position is known.
    pub(super) fn message(
        self,
        station: &Station<'_>,
        telemetry: &Telemetry,
        vehicle: Node,
    ) -> Option<MavMessage> {
        use GimbalManagerFlags as F;
        let locked = F::GIMBAL_MANAGER_FLAGS_ROLL_LOCK
            | F::GIMBAL_MANAGER_FLAGS_PITCH_LOCK
            | F::GIMBAL_MANAGER_FLAGS_YAW_LOCK;
        let (flags, q, [x, y, z]) = match self {
            Motion::Rates(slew) => {
                let flags = if slew.inertial { locked } else { F::empty() };
                let rates = [0.0, slew.up as f32, slew.right as f32];
                (flags, [f32::NAN; 4], rates)
            }
            Motion::Stare(place) => {
                let sight = sight_to(telemetry.position?, place);
                // PX4 does not move an output whose axis is to be locked and is not stabilised (MNT_DO_STAB).
                let (flags, q) = if station.gimbal?.is_on_outputs() {
                    let at = direction(sight, telemetry.attitude.as_ref()?);
                    (F::empty(), quaternion([0.0, at.elevation, at.azimuth]))
                } else {
                    (locked, looking_along(sight))
                };
                (flags, q.map(|part| part as f32), [f32::NAN; 3])
            }
        };
        let (target_system, target_component) = (vehicle.system, manager(station)?);
        let gimbal_device_id = station.equipment.gimbal.unwrap_or(0);
        Some(if target_component == vehicle.component {
            MavMessage::GIMBAL_MANAGER_SET_ATTITUDE(GIMBAL_MANAGER_SET_ATTITUDE_DATA {
                flags,
                q,
                angular_velocity_x: x,
                angular_velocity_y: y,
                angular_velocity_z: z,
                target_system,
                target_component,
                gimbal_device_id,
            })
        } else {
            // NaN, which means unset, stays NaN.
            let [_, pitch, yaw] = euler(q.map(f64::from)).map(|angle| angle as f32);
            MavMessage::GIMBAL_MANAGER_SET_PITCHYAW(GIMBAL_MANAGER_SET_PITCHYAW_DATA {
                flags,
                pitch,
                yaw,
                pitch_rate: y,
                yaw_rate: z,
                target_system,
                target_component,
                gimbal_device_id,
            })
        })
    }
}

/// REQUEST_MESSAGE.
pub(super) fn request(message: u16) -> Command {
    // 0 means all storages and all streams; for the status, the first stream.
    let which = if message == VIDEO_STREAM_STATUS {
        1.0
    } else {
        0.0
    };
    Command {
        command: MavCmd::MAV_CMD_REQUEST_MESSAGE,
        payload: Payload::Long([f32::from(message), which, 0.0, 0.0, 0.0, 0.0, 0.0]),
        repetition: Repetition::Never,
    }
}

/// The component that takes the commands of a gimbal; `None` before it has reported: an autopilot without a gimbal module
/// answers none of them.
fn manager(station: &Station<'_>) -> Option<u8> {
    station.gimbal?.manager
}

fn controls(station: &Station<'_>, own: Node) -> bool {
    holder(station) == Some([own.system, own.component])
}

/// System and component in primary control of the gimbal, 0 and 0 for nobody, as recently reported.
pub(super) fn holder(station: &Station<'_>) -> Option<[u8; 2]> {
    station.fresh(station.gimbal?.control)
}

/// Whether a gimbal looks in this direction. Its own angles are compared too: a gimbal that omits the lock flags but
/// stabilises reports pitch from the horizon.
fn looks(gimbal: &GimbalAttitude, at: Direction, telemetry: &Telemetry) -> bool {
    let Some(vehicle) = telemetry.attitude else {
        return false;
    };
    let sight = line_of_sight(gimbal, &vehicle);
    let [_, pitch, yaw] = euler(gimbal.q);
    let reported = Direction {
        azimuth: yaw,
        elevation: pitch,
    };
    let level = mapping::telemetry::Attitude {
        roll: 0.0,
        pitch: 0.0,
        yaw: 0.0,
        ..vehicle
    };
    let wanted = sight_of(at, &level);
    between(sight_of(direction(sight, &vehicle), &level), wanted) < CLOSE
        || between(sight_of(reported, &level), wanted) < CLOSE
}

const FORWARD: Direction = Direction {
    azimuth: 0.0,
    elevation: 0.0,
};
/// 3 degrees: the accuracy of a drive under wind and vibration.
const CLOSE: f64 = 0.0524;
const STILL_RAD_S: f64 = 0.02;
pub(super) const CAMERA_INFORMATION: u16 = 259;
pub(super) const CAMERA_SETTINGS: u16 = 260;
pub(super) const STORAGE_INFORMATION: u16 = 261;
pub(super) const CAMERA_CAPTURE_STATUS: u16 = 262;
pub(super) const VIDEO_STREAM_INFORMATION: u16 = 269;
pub(super) const VIDEO_STREAM_STATUS: u16 = 270;
pub(super) const CAMERA_FOV_STATUS: u16 = 271;
pub(super) const GIMBAL_MANAGER_INFORMATION: u16 = 280;
