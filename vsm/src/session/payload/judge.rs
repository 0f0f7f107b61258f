//! Converts a 19001 or 19100 to steps, or gives the reason of the refusal. Pure.
//!
//! The pointing mode of 19100 decides which fields of 19001 count (0201.10): angles in mode 1, rates in 2 and 3, the place
//! in 4. A station may send all fields every time, so a value of another mode commands nothing.

use mapping::altitude::Datum;
use mapping::payload::Direction;
use mapping::payload::pointing::{direction, sight_to};
use mapping::payload::report::{END_RECORDING, Ground, PHOTOGRAPH, RECORDING, Station};
use mapping::payload::state::{Camera, CameraInformation};
use mapping::telemetry::{Attitude, Place, Telemetry};
use mavlink_link::dialect::{CameraCapFlags, CameraMode, GimbalManagerCapFlags, StorageStatus};
use stanag_msgs::enums::{
    EoirPointingMode as Pointing, EoirSystemMode as System, FocusType, ImageOutput,
    LaserDesignatorCmd, LaserPointerCmd, LaserRfCmd, SetFocus, SetZoom,
};
use stanag_msgs::messages::{EoIrLaserPayloadCommand, PayloadSteeringCommand};

use super::step::{Focus, Slew, Step, Zoom};

/// The state with which a command is checked.
#[derive(Debug, Clone, Copy)]
pub(super) struct Situation<'a> {
    pub(super) station: Station<'a>,
    pub(super) telemetry: &'a Telemetry,
    pub(super) ground: Option<Ground<'a>>,
    /// How the altitude of a place is read.
    pub(super) datum: Datum<'a>,
    /// The last commanded pointing mode, and the one that the gimbal has shown.
    pub(super) mode: Pointing,
    pub(super) shown: Pointing,
    /// A zoom was commanded; nothing that ends it has been shown or is in progress.
    pub(super) zooming: bool,
    /// The same for a focus that was set manually.
    pub(super) by_hand: bool,
}

/// The decision.
#[derive(Debug, Clone, Default, PartialEq)]
pub(super) struct Judged {
    pub(super) steps: Vec<Step>,
    /// The pointing mode from here on.
    pub(super) mode: Option<Pointing>,
    /// A note for the operator.
    pub(super) note: Option<&'static str>,
}

/// 19001.
pub(super) fn steering(
    command: &PayloadSteeringCommand,
    at: &Situation<'_>,
) -> Result<Judged, String> {
    let mut steps = Vec::new();
    let pointing = match at.mode {
        Pointing::AngleToUa => angles(command, at)?.map(Step::Point),
        Pointing::SlewRateToUa | Pointing::SlewRateInertial => {
            let up = command.vertical_slew_rate.map(|rate| rate.si());
            let right = command.horizontal_slew_rate.map(|rate| rate.si());
            (up.is_some() || right.is_some()).then(|| {
                Step::Slew(Slew {
                    up: up.unwrap_or(0.0),
                    right: right.unwrap_or(0.0),
                    inertial: at.mode == Pointing::SlewRateInertial,
                })
            })
        }
        Pointing::LatLongSlaved => {
            let place = stare(command, at)?;
            if let Some(place) = place {
                within_reach(place, at)?;
            }
            place.map(Step::StareAt)
        }
        _ => None,
    };
    if let Some(step) = pointing {
        gimbal(at)?;
        steps.extend([Step::Control, step]);
    }
    steps.extend(zoom(command, at)?.map(Step::Zoom));
    steps.extend(focus(command, at)?.map(Step::Focus));
    let points = command.set_centreline_azimuth_angle.is_some()
        || command.set_centreline_elevation_angle.is_some()
        || command.horizontal_slew_rate.is_some()
        || command.vertical_slew_rate.is_some()
        || command.latitude.is_some();
    // Without this the angles or rates would be ignored, and the command acknowledged as carried out.
    if steps.is_empty() && points && at.mode == Pointing::NoValue {
        return Err(
            "no pointing mode is set: command one by 19100 (1 angle, 2 and 3 slew rate, 4 place) first"
                .to_owned(),
        );
    }
    Ok(Judged {
        steps,
        ..Judged::default()
    })
}

fn angles(
    command: &PayloadSteeringCommand,
    at: &Situation<'_>,
) -> Result<Option<Direction>, String> {
    let (azimuth, elevation) = (
        command.set_centreline_azimuth_angle.map(|a| a.radians()),
        command.set_centreline_elevation_angle.map(|a| a.radians()),
    );
    let wanted = match (azimuth, elevation) {
        (None, None) => return Ok(None),
        (Some(azimuth), Some(elevation)) => Direction { azimuth, elevation },
        // A single angle turns about one axis; the other axis stays as it is now.
        (azimuth, elevation) => {
            let now = looking(at)?;
            Direction {
                azimuth: azimuth.unwrap_or(now.azimuth),
                elevation: elevation.unwrap_or(now.elevation),
            }
        }
    };
    if let Some(regard) = at.station.gimbal.and_then(|gimbal| gimbal.regard) {
        let names = [
            "Set Centreline Azimuth Angle",
            "Set Centreline Elevation Angle",
        ];
        regard.reaches(wanted, names)?;
    }
    Ok(Some(wanted))
}

fn stare(command: &PayloadSteeringCommand, at: &Situation<'_>) -> Result<Option<Place>, String> {
    let (latitude, longitude) = match (command.latitude, command.longitude) {
        (None, None) => return Ok(None),
        _ if at.telemetry.position.is_none() => {
            return Err("the vehicle's position is not known yet".to_owned());
        }
        (Some(latitude), Some(longitude)) => (latitude.degrees(), longitude.degrees()),
        _ => return Err("Latitude or Longitude is missing".to_owned()),
    };
    let altitude = command
        .altitude
        .ok_or("Altitude is missing: the height of the point that is looked at")?
        .si();
    let over = [(latitude, longitude)];
    let level = (at.datum.level(altitude, command.altitude_type, over))
        .map_err(|fault| fault.to_string())?;
    let amsl_m = match (level, at.telemetry.home) {
        (mapping::altitude::Level::Amsl(amsl_m), _) => amsl_m,
        (above, Some(home)) => above.amsl(home.amsl_m),
        _ => return Err("altitude type 2 (AGL): home is not known yet".to_owned()),
    };
    Ok(Some(Place {
        latitude,
        longitude,
        amsl_m,
    }))
}

/// Refuses a place that the gimbal cannot look at from here: else the command would end only after the time of a slow drive. Its range
/// may be that of its drives or, stabilised, from the horizon: the place is beyond both.
fn within_reach(place: Place, at: &Situation<'_>) -> Result<(), String> {
    let regard = at.station.gimbal.and_then(|gimbal| gimbal.regard);
    let (Some(regard), Some(from), Some(attitude)) =
        (regard, at.telemetry.position, at.telemetry.attitude)
    else {
        return Ok(());
    };
    let sight = sight_to(from, place);
    let reaches = |attitude: &Attitude| {
        let mut to = direction(sight, attitude);
        // Straight down every azimuth is the same.
        if to.elevation.abs() > STEEP {
            to.azimuth = 0.0;
        }
        regard.reaches(to, ["azimuth of the place", "elevation of the place"])
    };
    let level = Attitude {
        roll: 0.0,
        pitch: 0.0,
        ..attitude
    };
    reaches(&level).or_else(|why| reaches(&attitude).map_err(|_| why))
}

fn zoom(command: &PayloadSteeringCommand, at: &Situation<'_>) -> Result<Option<Zoom>, String> {
    let wanted = match command.set_zoom {
        None => return field_of_view(command, at),
        Some(SetZoom::UseFieldsOfView) => return field_of_view(command, at),
        Some(SetZoom::NoChange) if at.zooming => Zoom::Stop,
        Some(SetZoom::NoChange) => return Ok(None),
        Some(SetZoom::ZoomIn) => Zoom::In,
        Some(SetZoom::ZoomOut) => Zoom::Out,
        Some(other) => return Err(format!("Set Zoom {}, expected 0 to 3", other.raw())),
    };
    let camera = camera(at, CameraCapFlags::CAMERA_CAP_FLAGS_HAS_BASIC_ZOOM, "zoom")?.0;
    let known = camera.settings.and_then(|(_, settings)| settings.zoom);
    if known.is_none() {
        return Err(
            "the camera reports no zoom (CAMERA_SETTINGS), so none could be confirmed".to_owned(),
        );
    }
    Ok(Some(wanted))
}

fn field_of_view(
    command: &PayloadSteeringCommand,
    at: &Situation<'_>,
) -> Result<Option<Zoom>, String> {
    // 0 means no field of view: a station that sends every field fills unused ones with 0.
    let horizontal = command
        .set_horizontal_field_of_view
        .map(|angle| angle.radians().rem_euclid(std::f64::consts::TAU));
    let Some(horizontal) = horizontal.filter(|angle| *angle > 0.0) else {
        return Ok(None);
    };
    let (camera, known) = camera(at, CameraCapFlags::CAMERA_CAP_FLAGS_HAS_BASIC_ZOOM, "zoom")?;
    if camera.field_of_view.is_none() {
        return Err(
            "the camera reports no field of view (CAMERA_FOV_STATUS), so none could be confirmed"
                .to_owned(),
        );
    }
    let width = known.sensor_width_mm.ok_or(
        "the camera reports no width of its sensor (CAMERA_INFORMATION): zoom in or out instead",
    )?;
    if horizontal >= std::f64::consts::PI {
        return Err("Set Horizontal Field of View, expected less than 180 degrees".to_owned());
    }
    Ok(Some(Zoom::Field {
        horizontal,
        focal_mm: width / 2.0 / (horizontal / 2.0).tan(),
    }))
}

fn focus(command: &PayloadSteeringCommand, at: &Situation<'_>) -> Result<Option<Focus>, String> {
    let wanted = match (command.set_focus, command.focus_type) {
        (Some(SetFocus::FocusCloser), _) => Focus::Closer,
        (Some(SetFocus::FocusFarther), _) => Focus::Farther,
        // Cameras start in auto focus: nothing has to be sent before the focus was set manually.
        (None | Some(SetFocus::NoChange), Some(FocusType::Auto)) if at.by_hand => Focus::Auto,
        (None | Some(SetFocus::NoChange), _) => return Ok(None),
        (Some(other), _) => return Err(format!("Set Focus {}, expected 0 to 2", other.raw())),
    };
    let camera = camera(
        at,
        CameraCapFlags::CAMERA_CAP_FLAGS_HAS_BASIC_FOCUS,
        "focus",
    )?
    .0;
    let known = camera.settings.and_then(|(_, settings)| settings.focus);
    if known.is_none() && wanted != Focus::Auto {
        return Err(
            "the camera reports no focus (CAMERA_SETTINGS), so none could be confirmed".to_owned(),
        );
    }
    Ok(Some(wanted))
}

/// 19100.
pub(super) fn sensor(
    command: &EoIrLaserPayloadCommand,
    at: &Situation<'_>,
) -> Result<Judged, String> {
    let laser = |named: &str| Err(format!("{named}: the station has no laser"));
    match command.fire_laser_pointer {
        None | Some(LaserPointerCmd::Off) => {}
        Some(_) => return laser("Fire Laser Pointer"),
    }
    match command.fire_laser_rangefinder {
        None | Some(LaserRfCmd::Off) => {}
        Some(_) => return laser("Fire Laser Rangefinder"),
    }
    match command.initiate_laser_designator {
        None | Some(LaserDesignatorCmd::Off) => {}
        Some(_) => return laser("Initiate Laser Designator"),
    }
    let mut steps = Vec::new();
    steps.extend(image_output(command.image_output, at)?);
    let system = command.system_operating_mode;
    if let Some(system) = system {
        steps.extend(system_mode(system, at)?);
    }
    // 0 means no mode: a station that sends every field fills unused ones with 0.
    let mode = (command.set_eo_ir_pointing_mode).filter(|mode| *mode != Pointing::NoValue);
    let mut note = None;
    if let Some(mode) = mode {
        let points = pointing_mode(mode, at)?;
        let keeps = points.iter().any(|step| matches!(step, Step::Point(_)));
        note = (keeps && mode == Pointing::LatLongSlaved).then_some(NO_PLACE);
        if !points.is_empty() && matches!(system, Some(System::Stow | System::Cage)) {
            return Err(
                "stow or cage, and another pointing mode, which would end it: command one of them"
                    .to_owned(),
            );
        }
        steps.extend(points);
    }
    Ok(Judged { steps, mode, note })
}

fn image_output(output: Option<ImageOutput>, at: &Situation<'_>) -> Result<Option<Step>, String> {
    let stream = (at.station.camera).and_then(|camera| camera.stream);
    let stream = stream.map(|(_, stream)| stream);
    let thermal = match output {
        None => return Ok(None),
        Some(ImageOutput::None) if stream.is_none_or(|stream| !stream.running) => return Ok(None),
        Some(ImageOutput::None) => {
            return Err("Image Output none: the video stream is not switched off".to_owned());
        }
        Some(ImageOutput::Eo) => false,
        Some(ImageOutput::Ir) => true,
        Some(other) => {
            return Err(format!(
                "Image Output {}, expected 1 (EO) or 2 (IR): the station has one stream",
                other.raw()
            ));
        }
    };
    if stream.is_some_and(|stream| stream.running && stream.thermal == thermal) {
        return Ok(None);
    }
    let thermal_too = CameraCapFlags::CAMERA_CAP_FLAGS_HAS_THERMAL_RANGE;
    camera(at, thermal_too, "thermal sensor beside another")?;
    if stream.is_none() {
        return Err("the camera reports no video stream (VIDEO_STREAM_STATUS)".to_owned());
    }
    Ok(Some(Step::Source { thermal }))
}

fn system_mode(mode: System, at: &Situation<'_>) -> Result<Vec<Step>, String> {
    let recording = (at.station.camera)
        .and_then(|camera| at.station.fresh(camera.capture))
        .map(|capture| capture.recording);
    let attitude = at.station.attitude();
    let retracted = attitude.is_some_and(|gimbal| gimbal.retracted);
    Ok(match mode {
        System::Stow if retracted => Vec::new(),
        System::Stow => {
            gimbal(at)?;
            let can = (at.station.gimbal).and_then(|gimbal| gimbal.regard);
            if !can.is_some_and(|regard| {
                (regard.can).contains(GimbalManagerCapFlags::GIMBAL_MANAGER_CAP_FLAGS_HAS_RETRACT)
            }) {
                return Err(
                    "stow: the gimbal does not report that it can retract; command 2 (cage) instead"
                        .to_owned(),
                );
            }
            vec![Step::Control, Step::Retract]
        }
        System::Cage => {
            gimbal(at)?;
            vec![Step::Control, Step::Neutral]
        }
        System::Active => {
            let mut steps = Vec::new();
            if retracted {
                steps.extend([Step::Control, Step::Neutral]);
            }
            if recording == Some(true) {
                steps.push(Step::Record(false));
            }
            steps
        }
        _ if mode == END_RECORDING => match recording {
            Some(true) => vec![Step::Record(false)],
            Some(false) => Vec::new(),
            None => {
                return Err(
                    "the camera does not report whether it records (CAMERA_CAPTURE_STATUS)"
                        .to_owned(),
                );
            }
        },
        _ if mode == RECORDING && recording == Some(true) => Vec::new(),
        _ if mode == RECORDING => {
            let (camera, known) =
                camera(at, CameraCapFlags::CAMERA_CAP_FLAGS_CAPTURE_VIDEO, "video")?;
            has_room(camera)?;
            let anyway = CameraCapFlags::CAMERA_CAP_FLAGS_CAN_CAPTURE_VIDEO_IN_IMAGE_MODE;
            in_mode(
                known,
                CameraMode::CAMERA_MODE_VIDEO,
                anyway,
                Step::Record(true),
            )
        }
        _ if mode == PHOTOGRAPH => {
            let (camera, known) = camera(
                at,
                CameraCapFlags::CAMERA_CAP_FLAGS_CAPTURE_IMAGE,
                "photographs",
            )?;
            has_room(camera)?;
            let anyway = CameraCapFlags::CAMERA_CAP_FLAGS_CAN_CAPTURE_IMAGE_IN_VIDEO_MODE;
            if recording == Some(true) && !known.can.contains(anyway) {
                return Err(
                    "photograph: the camera records video; command 5 (active) first".to_owned(),
                );
            }
            if camera.capture.is_none_or(|(_, capture)| capture.images < 0) {
                return Err(
                    "the camera reports no count of images (CAMERA_CAPTURE_STATUS), so none could be confirmed"
                        .to_owned(),
                );
            }
            in_mode(
                known,
                CameraMode::CAMERA_MODE_IMAGE,
                anyway,
                Step::Photograph,
            )
        }
        other => {
            return Err(format!(
                "System Operating Mode {}, expected 0 stow, 2 cage, 5 active, 10 record, 11 photograph or 12 end recording: MAVLink has no \
                 command for others",
                other.raw()
            ));
        }
    })
}

fn in_mode(
    camera: CameraInformation,
    mode: CameraMode,
    anyway: CameraCapFlags,
    step: Step,
) -> Vec<Step> {
    let has_modes = camera
        .can
        .contains(CameraCapFlags::CAMERA_CAP_FLAGS_HAS_MODES);
    if has_modes && !camera.can.contains(anyway) {
        vec![Step::Mode(mode), step]
    } else {
        vec![step]
    }
}

fn has_room(camera: &Camera) -> Result<(), String> {
    let Some(storage) = camera.storage else {
        // A camera that reports no storage may record elsewhere: it answers for itself.
        return Ok(());
    };
    match storage.status {
        StorageStatus::STORAGE_STATUS_EMPTY => Err("the camera has no storage inserted".to_owned()),
        StorageStatus::STORAGE_STATUS_UNFORMATTED => {
            Err("the storage of the camera is not formatted".to_owned())
        }
        StorageStatus::STORAGE_STATUS_READY if storage.available_mib < MIN_ROOM_MIB => {
            Err(format!(
                "the storage of the camera has {:.0} MiB left, expected {MIN_ROOM_MIB:.0} or more",
                storage.available_mib
            ))
        }
        _ => Ok(()),
    }
}

fn pointing_mode(mode: Pointing, at: &Situation<'_>) -> Result<Vec<Step>, String> {
    // A station may repeat the mode in every 19100. A new step would stop a gimbal that turns.
    if mode == at.mode && mode == at.shown {
        return Ok(Vec::new());
    }
    let step = match mode {
        // The gimbal keeps its direction until a 19001 names angles.
        Pointing::AngleToUa => {
            gimbal(at)?;
            Step::Point(looking(at)?)
        }
        Pointing::SlewRateToUa | Pointing::SlewRateInertial => Step::Slew(Slew {
            inertial: mode == Pointing::SlewRateInertial,
            ..Slew::STILL
        }),
        // The gimbal locks on the centre of the view (4.1.3.2 of Edition 2.5). Where that meets no ground, as where PX4 leaves it
        // (level), it keeps its direction: the place is that of the 19001 which follows.
        Pointing::LatLongSlaved => {
            gimbal(at)?;
            let ground = at
                .ground
                .ok_or("the height of the ground is not known yet: no home")?;
            match at.station.footprint(at.telemetry, &ground) {
                Some(seen) => Step::StareAt(seen.place),
                None => Step::Point(looking(at)?),
            }
        }
        Pointing::TargetSlaved => {
            return Err("Set EO/IR Pointing Mode 5: no target is tracked here".to_owned());
        }
        other => {
            return Err(format!(
                "Set EO/IR Pointing Mode {}, expected 0 to 4",
                other.raw()
            ));
        }
    };
    gimbal(at)?;
    Ok(vec![Step::Control, step])
}

/// The present direction of the gimbal.
fn looking(at: &Situation<'_>) -> Result<Direction, String> {
    let sight = at.station.sight(at.telemetry);
    sight
        .zip(at.telemetry.attitude)
        .map(|(sight, attitude)| direction(sight, &attitude))
        .ok_or_else(|| "where the gimbal looks is not known".to_owned())
}

/// Checks that the station's gimbal reports and has a manager.
fn gimbal(at: &Situation<'_>) -> Result<(), String> {
    let number = at.station.equipment.number;
    if at.station.equipment.gimbal.is_none() {
        return Err(format!("station {number} has no gimbal"));
    }
    if at.station.attitude().is_none() {
        return Err(format!("no data from the gimbal of station {number}"));
    }
    if at
        .station
        .gimbal
        .is_none_or(|gimbal| gimbal.manager.is_none())
    {
        return Err(format!(
            "no manager of the gimbal of station {number} has reported (GIMBAL_MANAGER_INFORMATION, GIMBAL_MANAGER_STATUS)"
        ));
    }
    Ok(())
}

/// The station's camera, if it can do this.
fn camera<'a>(
    at: &Situation<'a>,
    can: CameraCapFlags,
    what: &str,
) -> Result<(&'a Camera, CameraInformation), String> {
    let number = at.station.equipment.number;
    if at.station.equipment.camera.is_none() {
        return Err(format!("station {number} has no camera"));
    }
    let known = at
        .station
        .camera
        .and_then(|camera| Some((camera, camera.information?)));
    let (camera, information) =
        known.ok_or_else(|| format!("no data from the camera of station {number}"))?;
    if information.can.contains(can) {
        Ok((camera, information))
    } else {
        Err(format!(
            "the camera of station {number} has no {what} (CAMERA_INFORMATION)"
        ))
    }
}

const NO_PLACE: &str = "pointing mode 4: the centre of the view meets no ground that is known; the gimbal keeps its direction until 19001 \
                        names a place";
/// 87 degrees.
const STEEP: f64 = 1.518;
const MIN_ROOM_MIB: f64 = 16.0;
