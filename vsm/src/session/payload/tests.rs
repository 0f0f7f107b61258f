//! The machine without the others: refusals with their reasons, what is sent for a command, and what ends it.

#![allow(
    deprecated,
    reason = "MOUNT_ORIENTATION, by which PX4 reports its own outputs"
)]

use mapping::telemetry::{Attitude, Place};
use mavlink_link::dialect::{
    CAMERA_CAPTURE_STATUS_DATA, CAMERA_INFORMATION_DATA, CAMERA_SETTINGS_DATA, COMMAND_ACK_DATA,
    CameraCapFlags, GIMBAL_DEVICE_ATTITUDE_STATUS_DATA, GIMBAL_MANAGER_INFORMATION_DATA,
    GIMBAL_MANAGER_SET_ATTITUDE_DATA, GIMBAL_MANAGER_STATUS_DATA, GimbalDeviceFlags,
    GimbalManagerCapFlags, GimbalManagerFlags, HEARTBEAT_DATA, MOUNT_ORIENTATION_DATA, MavCmd,
    MavMessage, MavType, STORAGE_INFORMATION_DATA, StorageStatus,
};
use mavlink_link::service::Node;
use mavlink_link::service::command::Command;
use stanag_msgs::enums::{EoirSystemMode, FocusType, LaserRfCmd, LoiBitmap, SetFocus, SetZoom};
use stanag_msgs::messages::{EoIrLaserPayloadCommand, PayloadSteeringCommand};
use stanag_msgs::{Bam16, Bam32, Scaled};

use super::*;
use crate::session::authority::rules::{Access, Asker, Circumstances, Rights};
use crate::session::testing::{CUCS, World, acknowledgements, origin};

const GIMBAL: u8 = 154;
const CAMERA: u8 = 100;

/// A vehicle with a gimbal and a camera, and a CUCS with LOI 3 of station 1.
struct Scene {
    world: World,
    machine: Payload,
    rights: Authority,
}

impl Scene {
    fn new() -> Scene {
        let mut world = World::new();
        for station in &mut world.stations {
            station.profile.provisional = Provisional::All;
        }
        world.vehicle.telemetry.attitude = Some(Attitude {
            roll: 0.0,
            pitch: 0.0,
            yaw: 0.0,
            roll_rate: 0.0,
            pitch_rate: 0.0,
            yaw_rate: 0.0,
        });
        let here = Place {
            latitude: 47.4,
            longitude: 8.5,
            amsl_m: 588.0,
        };
        world.vehicle.telemetry.position = Some(here);
        world.vehicle.telemetry.home = Some(Place {
            amsl_m: 488.0,
            ..here
        });
        let asker = Asker {
            id: CUCS,
            authorised: LoiBitmap::LOI3,
            may_override: false,
            rank: 0,
        };
        let mut rights = Authority::default();
        let at = Circumstances {
            now: Duration::ZERO,
            roster: &[asker],
            loading: None,
            launch_or_landing: false,
        };
        let one = Rights::of_stations(Stations::one(1));
        rights.request(&at, &asker, Access::Control, one, true);
        let mut scene = Scene {
            world,
            machine: Payload::default(),
            rights,
        };
        scene.report(1, manager([0, 0]));
        scene.report(1, information());
        scene.report(GIMBAL, looking(0.0));
        scene.report(CAMERA, heartbeat());
        scene.report(CAMERA, camera());
        scene.report(CAMERA, settings(20.0));
        scene.report(CAMERA, capture(false, 3));
        scene
    }

    fn report(&mut self, component: u8, message: MavMessage) {
        let now = self.world.now.mono;
        self.world.vehicle.payloads.update(now, component, &message);
        self.handle(Input::Poll);
    }

    fn later(&mut self, seconds: f64) {
        self.world.now.mono += Duration::from_secs_f64(seconds);
    }

    fn handle(&mut self, input: Input<'_>) {
        let Scene {
            world,
            machine,
            rights,
        } = self;
        world.act(|common, views, effects| {
            let context = Context {
                common,
                rights,
                altimeter: views.flight.altimeter,
            };
            machine.handle(&context, input, effects);
        });
    }

    fn command(&mut self, message: impl Into<Message>) -> Vec<AckType> {
        let message = message.into();
        self.world.sent_to(0);
        let origin = origin(&message);
        self.handle(Input::Command {
            origin,
            message: &message,
        });
        self.answers()
    }

    fn answers(&mut self) -> Vec<AckType> {
        acknowledgements(&self.world.sent_to(0))
    }

    /// The commands that were sent to a component, each answered as accepted.
    fn accept(&mut self, component: u8) -> Vec<MavCmd> {
        self.answer(component, MavResult::MAV_RESULT_ACCEPTED)
    }

    fn answer(&mut self, component: u8, result: MavResult) -> Vec<MavCmd> {
        let mut sent = Vec::new();
        let now = self.world.now.mono;
        let client = self.world.services.commands_to(component);
        let mut ended = Vec::new();
        while let Some(message) = client.poll_transmit() {
            let (command, node) = match message {
                MavMessage::COMMAND_LONG(m) => (m.command, m.target_component),
                MavMessage::COMMAND_INT(m) => (m.command, m.target_component),
                _ => continue,
            };
            let ack = MavMessage::COMMAND_ACK(COMMAND_ACK_DATA {
                command,
                result,
                target_system: 245,
                target_component: 190,
                ..COMMAND_ACK_DATA::default()
            });
            client.handle_message(now, Node::new(1, node), &ack, true);
            sent.push(command);
            while let Some(event) = client.poll_event() {
                ended.push(event);
            }
        }
        for event in &ended {
            self.handle(Input::CommandEnded { component, event });
        }
        sent.retain(|command| *command != MavCmd::MAV_CMD_REQUEST_MESSAGE);
        sent
    }

    /// Why the command was refused.
    fn refusal(&mut self, message: impl Into<Message>) -> String {
        let message = message.into();
        self.world.sent_to(0);
        let origin = origin(&message);
        self.handle(Input::Command {
            origin,
            message: &message,
        });
        let sent = self.world.sent_to(0);
        assert_eq!(acknowledgements(&sent), [AckType::Refused]);
        // A long text comes in several parts.
        let text = |message: &Message| match message {
            Message::SubsystemStatusAlert(alert) => {
                alert.text.as_ref().map(|text| text.as_str().to_owned())
            }
            _ => None,
        };
        sent.iter().filter_map(text).collect()
    }

    /// Puts it into a pointing mode, as if the vehicle had shown it.
    fn mode(&mut self, mode: EoirPointingMode) {
        let state = self.machine.states.entry(1).or_default();
        (state.commanded, state.shown) = (mode, mode);
    }
}

fn manager(control: [u8; 2]) -> MavMessage {
    MavMessage::GIMBAL_MANAGER_STATUS(GIMBAL_MANAGER_STATUS_DATA {
        gimbal_device_id: GIMBAL,
        primary_control_sysid: control[0],
        primary_control_compid: control[1],
        ..GIMBAL_MANAGER_STATUS_DATA::default()
    })
}

fn information() -> MavMessage {
    MavMessage::GIMBAL_MANAGER_INFORMATION(GIMBAL_MANAGER_INFORMATION_DATA {
        gimbal_device_id: GIMBAL,
        cap_flags: GimbalManagerCapFlags::empty(),
        pitch_min: -1.6,
        pitch_max: 0.5,
        yaw_min: -2.6,
        yaw_max: 2.6,
        ..GIMBAL_MANAGER_INFORMATION_DATA::default()
    })
}

/// The gimbal looks ahead and down by degrees.
fn looking(down: f64) -> MavMessage {
    let half = down.to_radians() / 2.0;
    MavMessage::GIMBAL_DEVICE_ATTITUDE_STATUS(GIMBAL_DEVICE_ATTITUDE_STATUS_DATA {
        q: [half.cos() as f32, 0.0, -half.sin() as f32, 0.0],
        flags: GimbalDeviceFlags::GIMBAL_DEVICE_FLAGS_YAW_IN_VEHICLE_FRAME,
        ..GIMBAL_DEVICE_ATTITUDE_STATUS_DATA::default()
    })
}

fn heartbeat() -> MavMessage {
    MavMessage::HEARTBEAT(HEARTBEAT_DATA {
        mavtype: MavType::MAV_TYPE_CAMERA,
        ..HEARTBEAT_DATA::default()
    })
}

fn camera() -> MavMessage {
    MavMessage::CAMERA_INFORMATION(CAMERA_INFORMATION_DATA {
        flags: CameraCapFlags::CAMERA_CAP_FLAGS_CAPTURE_VIDEO
            | CameraCapFlags::CAMERA_CAP_FLAGS_CAPTURE_IMAGE
            | CameraCapFlags::CAMERA_CAP_FLAGS_HAS_BASIC_ZOOM,
        gimbal_device_id: GIMBAL,
        ..CAMERA_INFORMATION_DATA::default()
    })
}

fn settings(zoom: f32) -> MavMessage {
    MavMessage::CAMERA_SETTINGS(CAMERA_SETTINGS_DATA {
        zoomLevel: zoom,
        focusLevel: f32::NAN,
        ..CAMERA_SETTINGS_DATA::default()
    })
}

fn capture(recording: bool, images: i32) -> MavMessage {
    MavMessage::CAMERA_CAPTURE_STATUS(CAMERA_CAPTURE_STATUS_DATA {
        video_status: u8::from(recording),
        image_count: images,
        ..CAMERA_CAPTURE_STATUS_DATA::default()
    })
}

fn steer(degrees: f64) -> PayloadSteeringCommand {
    PayloadSteeringCommand {
        station_number_1_16: Some(StationBitmap1To16::from_raw(1)),
        set_centreline_azimuth_angle: Some(Bam16::from_degrees(0.0)),
        set_centreline_elevation_angle: Some(Bam16::from_degrees(degrees)),
        ..PayloadSteeringCommand::default()
    }
}

fn system(mode: EoirSystemMode) -> EoIrLaserPayloadCommand {
    EoIrLaserPayloadCommand {
        station_number_1_16: Some(StationBitmap1To16::from_raw(1)),
        system_operating_mode: Some(mode),
        ..EoIrLaserPayloadCommand::default()
    }
}

#[test]
fn a_gimbal_is_taken_under_control_and_carried_out_is_where_it_looks() {
    let mut scene = Scene::new();
    scene.accept(1);
    scene.mode(EoirPointingMode::AngleToUa);
    assert_eq!(scene.command(steer(-30.0)), [AckType::Received]);
    let control = MavCmd::MAV_CMD_DO_GIMBAL_MANAGER_CONFIGURE;
    assert_eq!(scene.accept(1), [control]);
    // Accepted is not shown: nothing more is sent before the manager reports who is in control.
    assert_eq!(scene.accept(1), []);
    scene.later(0.5);
    scene.report(1, manager([245, 190]));
    assert_eq!(
        scene.accept(1),
        [MavCmd::MAV_CMD_DO_GIMBAL_MANAGER_PITCHYAW]
    );
    scene.later(0.2);
    scene.report(GIMBAL, looking(15.0));
    assert_eq!(scene.answers(), [], "on its way");
    scene.later(0.2);
    scene.report(GIMBAL, looking(29.0));
    assert_eq!(scene.answers(), [AckType::CarriedOut]);
}

#[test]
fn a_gimbal_that_stands_elsewhere_after_its_time_refuses_the_command() {
    let mut scene = Scene::new();
    scene.report(1, manager([245, 190]));
    scene.accept(1);
    scene.mode(EoirPointingMode::AngleToUa);
    scene.command(steer(-30.0));
    scene.accept(1);
    for _ in 0..21 {
        scene.later(1.0);
        scene.report(GIMBAL, looking(0.0));
    }
    assert_eq!(scene.answers(), [AckType::Refused]);
}

#[test]
fn a_newer_steering_command_replaces_the_older() {
    let mut scene = Scene::new();
    scene.report(1, manager([245, 190]));
    scene.accept(1);
    scene.mode(EoirPointingMode::AngleToUa);
    scene.command(steer(-30.0));
    scene.accept(1);
    scene.later(0.1);
    assert_eq!(
        scene.command(steer(-60.0)),
        [AckType::Refused, AckType::Received]
    );
    scene.accept(1);
    scene.later(0.2);
    scene.report(GIMBAL, looking(60.0));
    assert_eq!(scene.answers(), [AckType::CarriedOut]);
}

#[test]
fn rates_are_set_again_each_second_and_end_with_the_right() {
    let mut scene = Scene::new();
    scene.report(1, manager([245, 190]));
    scene.accept(1);
    scene.mode(EoirPointingMode::SlewRateToUa);
    scene.command(PayloadSteeringCommand {
        station_number_1_16: Some(StationBitmap1To16::from_raw(1)),
        horizontal_slew_rate: Some(Scaled::saturating_from_si(0.2)),
        ..PayloadSteeringCommand::default()
    });
    let rates = |posts: Vec<MavMessage>| -> Vec<f32> {
        let rate = |message: &MavMessage| match message {
            MavMessage::GIMBAL_MANAGER_SET_ATTITUDE(m) => Some(m.angular_velocity_z),
            _ => None,
        };
        posts.iter().filter_map(rate).collect()
    };
    assert_eq!(rates(scene.world.services.take_posts()), [0.2]);
    scene.later(0.2);
    let mut turning = looking(0.0);
    if let MavMessage::GIMBAL_DEVICE_ATTITUDE_STATUS(m) = &mut turning {
        m.angular_velocity_z = 0.18;
    }
    scene.report(GIMBAL, turning);
    assert_eq!(scene.answers(), [AckType::CarriedOut]);
    for _ in 0..3 {
        scene.later(1.0);
        scene.handle(Input::Poll);
        assert_eq!(rates(scene.world.services.take_posts()), [0.2]);
    }
    scene.rights = Authority::default();
    scene.handle(Input::Poll);
    assert_eq!(rates(scene.world.services.take_posts()), [0.0]);
    scene.later(5.0);
    scene.handle(Input::Poll);
    assert_eq!(rates(scene.world.services.take_posts()), [0.0; 0]);
}

#[test]
fn recording_is_carried_out_once_the_camera_shows_it() {
    let mut scene = Scene::new();
    scene.accept(CAMERA);
    assert_eq!(
        scene.command(system(report::RECORDING)),
        [AckType::Received]
    );
    assert_eq!(scene.accept(CAMERA), [MavCmd::MAV_CMD_VIDEO_START_CAPTURE]);
    scene.later(0.5);
    scene.report(CAMERA, capture(false, 3));
    assert_eq!(scene.answers(), []);
    scene.later(0.5);
    scene.report(CAMERA, capture(true, 3));
    assert_eq!(scene.answers(), [AckType::CarriedOut]);
    // Again: it is so already.
    assert_eq!(
        scene.command(system(report::RECORDING)),
        [AckType::CarriedOut]
    );
}

#[test]
fn every_refusal_names_its_reason() {
    let mut scene = Scene::new();
    scene.accept(1);
    scene.mode(EoirPointingMode::AngleToUa);
    let two = PayloadSteeringCommand {
        station_number_1_16: Some(StationBitmap1To16::from_raw(2)),
        ..steer(-10.0)
    };
    assert!(
        scene
            .refusal(two.clone())
            .contains("LOI 3 (payload) of station 2")
    );
    let both = PayloadSteeringCommand {
        station_number_1_16: Some(StationBitmap1To16::from_raw(3)),
        ..two
    };
    assert!(scene.refusal(both).contains("names 2 stations"));
    assert!(scene.refusal(steer(40.0)).contains("reaches no farther"));
    let laser = EoIrLaserPayloadCommand {
        fire_laser_rangefinder: Some(LaserRfCmd::FireOnePulse),
        ..system(EoirSystemMode::Active)
    };
    assert!(scene.refusal(laser).contains("no laser"));
    assert!(
        scene
            .refusal(system(EoirSystemMode::Stow))
            .contains("can retract")
    );
    assert!(
        scene
            .refusal(system(EoirSystemMode::Calibrate))
            .contains("expected 0 stow")
    );
    let full = MavMessage::STORAGE_INFORMATION(STORAGE_INFORMATION_DATA {
        status: StorageStatus::STORAGE_STATUS_READY,
        available_capacity: 3.0,
        ..STORAGE_INFORMATION_DATA::default()
    });
    scene.report(CAMERA, full);
    assert!(
        scene
            .refusal(system(report::RECORDING))
            .contains("3 MiB left")
    );
    scene.mode(EoirPointingMode::NoValue);
    assert!(scene.refusal(steer(-10.0)).contains("no pointing mode"));
    scene.mode(EoirPointingMode::LatLongSlaved);
    let no_altitude = PayloadSteeringCommand {
        latitude: Some(Bam32::from_degrees(47.4)),
        longitude: Some(Bam32::from_degrees(8.5)),
        ..steer(-10.0)
    };
    assert!(scene.refusal(no_altitude).contains("Altitude is missing"));
    scene.mode(EoirPointingMode::AngleToUa);
    scene.world.stations[0].profile.provisional = Provisional::Status;
    assert!(scene.refusal(steer(-10.0)).contains("dli.provisional"));
    scene.world.stations[0].profile.provisional = Provisional::All;
    scene.later(10.0);
    assert!(
        scene
            .refusal(steer(-10.0))
            .contains("no data from the gimbal")
    );
    scene.world.vehicle.set_silent();
    assert!(
        scene
            .refusal(steer(-10.0))
            .contains("no data from the vehicle")
    );
}

/// The attitudes and rates that were sent to the gimbal beside commands.
fn attitudes(scene: &mut Scene) -> Vec<GIMBAL_MANAGER_SET_ATTITUDE_DATA> {
    let set = |message| match message {
        MavMessage::GIMBAL_MANAGER_SET_ATTITUDE(m) => Some(m),
        _ => None,
    };
    let posts = scene.world.services.take_posts();
    posts.into_iter().filter_map(set).collect()
}

fn pointing(mode: EoirPointingMode) -> EoIrLaserPayloadCommand {
    EoIrLaserPayloadCommand {
        station_number_1_16: Some(StationBitmap1To16::from_raw(1)),
        set_eo_ir_pointing_mode: Some(mode),
        ..EoIrLaserPayloadCommand::default()
    }
}

fn turn(rate: f64) -> PayloadSteeringCommand {
    PayloadSteeringCommand {
        station_number_1_16: Some(StationBitmap1To16::from_raw(1)),
        horizontal_slew_rate: Some(Scaled::saturating_from_si(rate)),
        ..PayloadSteeringCommand::default()
    }
}

fn zoom(zoom: SetZoom) -> PayloadSteeringCommand {
    PayloadSteeringCommand {
        station_number_1_16: Some(StationBitmap1To16::from_raw(1)),
        set_zoom: Some(zoom),
        ..PayloadSteeringCommand::default()
    }
}

/// It turns right, and shows it.
fn turning(scene: &mut Scene) {
    scene.report(1, manager([245, 190]));
    scene.accept(1);
    scene.mode(EoirPointingMode::SlewRateToUa);
    scene.command(turn(0.2));
    scene.later(0.2);
    let mut shown = looking(0.0);
    if let MavMessage::GIMBAL_DEVICE_ATTITUDE_STATUS(m) = &mut shown {
        m.angular_velocity_z = 0.2;
    }
    scene.report(GIMBAL, shown);
    assert_eq!(scene.answers(), [AckType::CarriedOut]);
    scene.world.services.take_posts();
}

#[test]
fn a_place_is_looked_at_without_a_command_that_turns_the_vehicle() {
    let mut scene = Scene::new();
    scene.report(1, manager([245, 190]));
    scene.accept(1);
    scene.mode(EoirPointingMode::LatLongSlaved);
    // 100 m north, 100 m below: half a right angle down.
    let stare = PayloadSteeringCommand {
        latitude: Some(Bam32::from_degrees(47.4 + 100.0 / 111_195.0)),
        longitude: Some(Bam32::from_degrees(8.5)),
        altitude: Some(Scaled::saturating_from_si(0.0)),
        altitude_type: Some(stanag_msgs::enums::AltitudeType::Agl),
        ..steer(0.0)
    };
    assert_eq!(scene.command(stare), [AckType::Received]);
    assert_eq!(scene.accept(1), [], "PX4's navigator would take a ROI too");
    let pitch = |of: &[GIMBAL_MANAGER_SET_ATTITUDE_DATA]| -> Vec<f32> {
        let pitch = |m: &GIMBAL_MANAGER_SET_ATTITUDE_DATA| 2.0 * m.q[2].asin().to_degrees();
        of.iter().map(|m| pitch(m).round()).collect()
    };
    let sent = attitudes(&mut scene);
    assert_eq!(pitch(&sent), [-45.0]);
    let lock = GimbalManagerFlags::GIMBAL_MANAGER_FLAGS_YAW_LOCK;
    assert!(sent[0].flags.contains(lock));
    scene.later(0.3);
    scene.report(GIMBAL, looking(45.0));
    assert_eq!(scene.answers(), [AckType::CarriedOut]);
    // The vehicle flies on, and the direction follows.
    attitudes(&mut scene);
    let from = scene.world.vehicle.telemetry.position.as_mut();
    from.expect("a position").amsl_m += 73.2;
    scene.later(0.25);
    scene.handle(Input::Poll);
    assert_eq!(pitch(&attitudes(&mut scene)), [-60.0]);
    scene.rights = Authority::default();
    scene.handle(Input::Poll);
    attitudes(&mut scene);
    scene.later(1.0);
    scene.handle(Input::Poll);
    assert_eq!(attitudes(&mut scene), [], "nobody holds it");
}

/// Not after the 20 s in which a slow drive could have turned there.
#[test]
fn a_place_that_the_gimbal_cannot_reach_is_refused_at_once() {
    let mut scene = Scene::new();
    scene.report(1, manager([245, 190]));
    scene.accept(1);
    scene.mode(EoirPointingMode::LatLongSlaved);
    let MavMessage::GIMBAL_MANAGER_INFORMATION(information) = information() else {
        unreachable!("its own message")
    };
    let short = GIMBAL_MANAGER_INFORMATION_DATA {
        pitch_min: -0.6,
        ..information
    };
    scene.report(1, MavMessage::GIMBAL_MANAGER_INFORMATION(short));
    // 100 m below.
    let stare = |north_m: f64| PayloadSteeringCommand {
        latitude: Some(Bam32::from_degrees(47.4 + north_m / 111_195.0)),
        longitude: Some(Bam32::from_degrees(8.5)),
        altitude: Some(Scaled::saturating_from_si(0.0)),
        altitude_type: Some(stanag_msgs::enums::AltitudeType::Agl),
        ..steer(0.0)
    };
    let why = scene.refusal(stare(100.0));
    assert!(why.contains("elevation of the place"), "{why}");
    let why = scene.refusal(stare(-300.0));
    assert!(why.contains("azimuth of the place"), "{why}");
    assert_eq!(scene.command(stare(200.0)), [AckType::Received]);
    // With the nose down its drives reach there.
    let attitude = scene.world.vehicle.telemetry.attitude.as_mut();
    attitude.expect("one").pitch = -0.3;
    let answers = scene.command(stare(100.0));
    assert!(answers.contains(&AckType::Received), "{answers:?}");
}

/// PX4 leaves a gimbal level that nobody has turned yet.
#[test]
fn a_gimbal_that_looks_at_no_ground_keeps_its_direction_until_a_place_is_named() {
    let mut scene = Scene::new();
    scene.report(1, manager([245, 190]));
    scene.accept(1);
    let slaved = Message::from(EoIrLaserPayloadCommand {
        station_number_1_16: Some(StationBitmap1To16::from_raw(1)),
        set_eo_ir_pointing_mode: Some(EoirPointingMode::LatLongSlaved),
        ..EoIrLaserPayloadCommand::default()
    });
    scene.world.sent_to(0);
    scene.handle(Input::Command {
        origin: origin(&slaved),
        message: &slaved,
    });
    let sent = scene.world.sent_to(0);
    assert_eq!(acknowledgements(&sent), [AckType::Received]);
    let text = |message: &Message| match message {
        Message::SubsystemStatusAlert(alert) => {
            alert.text.as_ref().map(|text| text.as_str().to_owned())
        }
        _ => None,
    };
    let noted: String = sent.iter().filter_map(text).collect();
    assert!(
        noted.contains("pointing mode 4: the centre of the view"),
        "{noted}"
    );
    assert_eq!(
        scene.accept(1),
        [MavCmd::MAV_CMD_DO_GIMBAL_MANAGER_PITCHYAW]
    );
    scene.later(0.2);
    scene.report(GIMBAL, looking(0.0));
    assert_eq!(scene.answers(), [AckType::CarriedOut]);
    // 100 m north, 100 m below.
    let stare = PayloadSteeringCommand {
        latitude: Some(Bam32::from_degrees(47.4 + 100.0 / 111_195.0)),
        longitude: Some(Bam32::from_degrees(8.5)),
        altitude: Some(Scaled::saturating_from_si(0.0)),
        altitude_type: Some(stanag_msgs::enums::AltitudeType::Agl),
        ..steer(0.0)
    };
    assert_eq!(scene.command(stare), [AckType::Received]);
    assert_eq!(attitudes(&mut scene).len(), 1);
    scene.later(0.3);
    scene.report(GIMBAL, looking(45.0));
    assert_eq!(scene.answers(), [AckType::CarriedOut]);
}

/// PX4 moves no output whose axis is to be locked and is not stabilised, and reports it as if it did.
#[test]
fn a_gimbal_on_the_autopilots_outputs_is_pointed_from_the_vehicle_and_looks_where_they_are() {
    let mut scene = Scene::new();
    scene.world.vehicle.payloads = mapping::payload::state::Payloads::default();
    let attitude = scene.world.vehicle.telemetry.attitude.as_mut();
    attitude.expect("one").yaw = std::f64::consts::FRAC_PI_2;
    let status = GIMBAL_MANAGER_STATUS_DATA {
        gimbal_device_id: 1,
        primary_control_sysid: 245,
        primary_control_compid: 190,
        ..GIMBAL_MANAGER_STATUS_DATA::default()
    };
    let outputs = |pitch, yaw| {
        MavMessage::MOUNT_ORIENTATION(MOUNT_ORIENTATION_DATA {
            pitch,
            yaw,
            ..MOUNT_ORIENTATION_DATA::default()
        })
    };
    scene.report(1, MavMessage::GIMBAL_MANAGER_STATUS(status));
    scene.report(1, outputs(0.0, 0.0));
    scene.accept(1);
    scene.mode(EoirPointingMode::LatLongSlaved);
    // 100 m north, 100 m below; its nose is to the east.
    let stare = PayloadSteeringCommand {
        latitude: Some(Bam32::from_degrees(47.4 + 100.0 / 111_195.0)),
        longitude: Some(Bam32::from_degrees(8.5)),
        altitude: Some(Scaled::saturating_from_si(0.0)),
        altitude_type: Some(stanag_msgs::enums::AltitudeType::Agl),
        ..steer(0.0)
    };
    assert_eq!(scene.command(stare), [AckType::Received]);
    let sent = attitudes(&mut scene);
    assert!(sent[0].flags.is_empty());
    let [_, pitch, yaw] = mapping::payload::pointing::euler(sent[0].q.map(f64::from));
    let rounded = [pitch, yaw].map(|angle| angle.to_degrees().round());
    assert_eq!(rounded, [-45.0, -90.0]);
    scene.later(0.3);
    let MavMessage::GIMBAL_DEVICE_ATTITUDE_STATUS(mut set_point) = looking(45.0) else {
        unreachable!("its own message")
    };
    set_point.gimbal_device_id = 1;
    set_point.flags = GimbalDeviceFlags::GIMBAL_DEVICE_FLAGS_YAW_LOCK
        | GimbalDeviceFlags::GIMBAL_DEVICE_FLAGS_PITCH_LOCK;
    scene.report(1, MavMessage::GIMBAL_DEVICE_ATTITUDE_STATUS(set_point));
    assert_eq!(scene.answers(), [], "where it is to look");
    scene.report(1, outputs(-45.0, -90.0));
    assert_eq!(scene.answers(), [AckType::CarriedOut]);
}

#[test]
fn what_flies_the_vehicle_does_not_wait_for_a_gimbal_that_does_not_answer() {
    let mut scene = Scene::new();
    scene.accept(1);
    scene.mode(EoirPointingMode::AngleToUa);
    scene.command(steer(-30.0));
    let sent = scene.world.services.commands_to(1).poll_transmit();
    let Some(MavMessage::COMMAND_LONG(sent)) = sent else {
        panic!("{sent:?}");
    };
    assert_eq!(sent.command, MavCmd::MAV_CMD_DO_GIMBAL_MANAGER_CONFIGURE);
    let mode = Command {
        command: MavCmd::MAV_CMD_DO_SET_MODE,
        payload: mavlink_link::service::command::Payload::Long([0.0; 7]),
        repetition: mavlink_link::service::command::Repetition::Safe,
    };
    let now = scene.world.now.mono;
    let flight = &mut scene.world.services.commands;
    flight.submit(now, mode).expect("room");
    assert!(flight.poll_transmit().is_some(), "at once");
}

#[test]
fn no_gimbal_is_steered_before_its_manager_has_reported() {
    let mut scene = Scene::new();
    scene.world.vehicle.payloads = mapping::payload::state::Payloads::default();
    scene.report(GIMBAL, looking(0.0));
    scene.mode(EoirPointingMode::AngleToUa);
    assert!(scene.refusal(steer(-30.0)).contains("no manager"));
}

#[test]
fn a_command_that_a_newer_one_replaces_is_not_carried_out() {
    let mut scene = Scene::new();
    scene.report(1, manager([245, 190]));
    scene.accept(1);
    scene.mode(EoirPointingMode::AngleToUa);
    assert_eq!(
        scene.command(system(EoirSystemMode::Cage)),
        [AckType::Received]
    );
    assert_eq!(
        scene.command(steer(-60.0)),
        [AckType::Refused, AckType::Received]
    );
    // One mode by another: the older is not shown by what the newer does.
    assert_eq!(
        scene.command(pointing(EoirPointingMode::SlewRateToUa)),
        [AckType::Refused, AckType::Received]
    );
    assert_eq!(
        scene.command(pointing(EoirPointingMode::SlewRateInertial)),
        [AckType::Refused, AckType::Received]
    );
    for _ in 0..7 {
        scene.later(1.0);
        let mut drifting = looking(0.0);
        if let MavMessage::GIMBAL_DEVICE_ATTITUDE_STATUS(m) = &mut drifting {
            m.angular_velocity_z = 0.5;
        }
        scene.report(GIMBAL, drifting);
    }
    assert_eq!(scene.answers(), [AckType::Refused]);
    let state = &scene.machine.states[&1];
    let modes = (state.commanded, state.shown);
    let before = EoirPointingMode::AngleToUa;
    assert_eq!(modes, (before, before), "what was shown last");
    // What is not shown yet is shown by the steering that it was for.
    scene.report(1, manager([245, 190]));
    scene.command(pointing(EoirPointingMode::SlewRateToUa));
    assert_eq!(
        scene.command(turn(0.2)),
        [AckType::Refused, AckType::Received]
    );
    let state = &scene.machine.states[&1];
    assert_eq!(state.commanded, EoirPointingMode::SlewRateToUa);
    scene.later(0.2);
    let mut turning = looking(0.0);
    if let MavMessage::GIMBAL_DEVICE_ATTITUDE_STATUS(m) = &mut turning {
        m.angular_velocity_z = 0.2;
    }
    scene.report(GIMBAL, turning);
    assert_eq!(scene.answers(), [AckType::CarriedOut]);
    let shown = scene.machine.states[&1].shown;
    assert_eq!(shown, EoirPointingMode::SlewRateToUa);
}

#[test]
fn no_pointing_mode_is_no_command_and_none_ends_a_stow_of_its_own_message() {
    let mut scene = Scene::new();
    turning(&mut scene);
    assert_eq!(
        scene.command(pointing(EoirPointingMode::NoValue)),
        [AckType::CarriedOut]
    );
    let state = &scene.machine.states[&1];
    assert_eq!(state.commanded, EoirPointingMode::SlewRateToUa);
    assert!(state.moving.is_some());
    let both = EoIrLaserPayloadCommand {
        set_eo_ir_pointing_mode: Some(EoirPointingMode::AngleToUa),
        ..system(EoirSystemMode::Cage)
    };
    assert!(scene.refusal(both).contains("stow or cage"));
    let same = EoIrLaserPayloadCommand {
        set_eo_ir_pointing_mode: Some(EoirPointingMode::SlewRateToUa),
        ..system(EoirSystemMode::Cage)
    };
    assert_eq!(scene.command(same), [AckType::Received]);
}

#[test]
fn a_station_has_few_commands_in_progress_and_a_newer_zoom_replaces_the_older() {
    let mut scene = Scene::new();
    scene.accept(CAMERA);
    assert_eq!(scene.command(zoom(SetZoom::ZoomIn)), [AckType::Received]);
    for _ in 0..6 {
        assert_eq!(
            scene.command(zoom(SetZoom::ZoomOut)),
            [AckType::Refused, AckType::Received]
        );
    }
    for _ in 0..3 {
        let photograph = system(report::PHOTOGRAPH);
        assert_eq!(scene.command(photograph), [AckType::Received]);
    }
    let why = scene.refusal(system(report::PHOTOGRAPH));
    assert!(
        why.contains("4 commands for payload station 1 are in progress"),
        "{why}"
    );
    // What replaces one takes no place.
    assert_eq!(
        scene.command(zoom(SetZoom::ZoomIn)),
        [AckType::Refused, AckType::Received]
    );
}

#[test]
fn a_zoom_and_a_turn_end_with_the_right_of_who_commanded_them() {
    let mut scene = Scene::new();
    turning(&mut scene);
    scene.accept(CAMERA);
    scene.command(zoom(SetZoom::ZoomIn));
    scene.accept(CAMERA);
    scene.later(0.5);
    scene.report(CAMERA, settings(30.0));
    assert_eq!(scene.answers(), [AckType::CarriedOut]);
    scene.accept(CAMERA);
    scene.rights = Authority::default();
    scene.handle(Input::Poll);
    assert_eq!(scene.accept(CAMERA), [MavCmd::MAV_CMD_SET_CAMERA_ZOOM]);
    let rates: Vec<f32> = attitudes(&mut scene)
        .iter()
        .map(|m| m.angular_velocity_z)
        .collect();
    assert_eq!(rates, [0.0]);
    let state = &scene.machine.states[&1];
    assert_eq!(state.commanded, EoirPointingMode::NoValue);
    assert!(!state.zooming);
}

#[test]
fn a_zoom_whose_stop_finds_a_full_queue_is_stopped_later_and_is_not_inherited() {
    let mut scene = Scene::new();
    scene.accept(CAMERA);
    scene.command(zoom(SetZoom::ZoomIn));
    scene.accept(CAMERA);
    scene.later(0.5);
    scene.report(CAMERA, settings(30.0));
    assert_eq!(scene.answers(), [AckType::CarriedOut]);
    scene.accept(CAMERA);
    let now = scene.world.now.mono;
    let client = scene.world.services.commands_to(CAMERA);
    while client.submit(now, request(259)).is_ok() {}
    let rights = std::mem::take(&mut scene.rights);
    scene.handle(Input::Poll);
    // Whoever holds it next is none whom the zoom is of.
    let state = &scene.machine.states[&1];
    assert!(state.stops_zoom && !state.zooming && state.by.is_none());
    scene.rights = rights;
    let sent: Vec<MavCmd> = (0..64).flat_map(|_| scene.accept(CAMERA)).collect();
    assert_eq!(sent, [MavCmd::MAV_CMD_SET_CAMERA_ZOOM]);
    assert!(!scene.machine.states[&1].stops_zoom);
}

/// Zooms in, until the camera has shown it.
fn zooming(scene: &mut Scene) {
    scene.accept(CAMERA);
    assert_eq!(scene.command(zoom(SetZoom::ZoomIn)), [AckType::Received]);
    scene.accept(CAMERA);
    scene.later(0.5);
    scene.report(CAMERA, settings(30.0));
    assert_eq!(scene.answers(), [AckType::CarriedOut]);
    scene.accept(CAMERA);
}

#[test]
fn a_stop_of_a_zoom_that_failed_is_sent_again_and_one_in_progress_is_not() {
    let mut scene = Scene::new();
    zooming(&mut scene);
    let stop = || zoom(SetZoom::NoChange);
    assert_eq!(scene.command(stop()), [AckType::Received]);
    // It is in progress: a station that sends all fields repeats it with every command.
    assert_eq!(scene.command(stop()), [AckType::CarriedOut]);
    let denied = MavResult::MAV_RESULT_DENIED;
    let sent = scene.answer(CAMERA, denied);
    assert_eq!(sent, [MavCmd::MAV_CMD_SET_CAMERA_ZOOM]);
    assert_eq!(scene.answers(), [AckType::Refused]);

    assert_eq!(scene.command(stop()), [AckType::Received]);
    assert_eq!(
        scene.accept(CAMERA),
        [MavCmd::MAV_CMD_SET_CAMERA_ZOOM],
        "again"
    );
    for _ in 0..2 {
        scene.later(0.5);
        scene.report(CAMERA, settings(31.0));
    }
    assert_eq!(scene.answers(), [AckType::CarriedOut]);
    assert_eq!(scene.command(stop()), [AckType::CarriedOut], "it is so");
}

#[test]
fn a_zoom_ends_with_the_right_also_while_its_stop_is_not_confirmed() {
    let mut scene = Scene::new();
    zooming(&mut scene);
    scene.command(zoom(SetZoom::NoChange));
    scene.answer(CAMERA, MavResult::MAV_RESULT_DENIED);
    scene.rights = Authority::default();
    scene.handle(Input::Poll);
    assert_eq!(scene.accept(CAMERA), [MavCmd::MAV_CMD_SET_CAMERA_ZOOM]);
}

#[test]
fn what_commands_no_zoom_leaves_the_stop_of_the_previous_holder() {
    let mut scene = Scene::new();
    scene.accept(CAMERA);
    let now = scene.world.now.mono;
    let client = scene.world.services.commands_to(CAMERA);
    while client.submit(now, request(259)).is_ok() {}
    scene.machine.states.entry(1).or_default().stops_zoom = true;
    for no_zoom in [SetZoom::NoChange, SetZoom::UseFieldsOfView] {
        assert_eq!(scene.command(zoom(no_zoom)), [AckType::CarriedOut]);
        assert!(scene.machine.states[&1].stops_zoom);
    }
}

#[test]
fn auto_focus_that_failed_is_commanded_again() {
    let mut scene = Scene::new();
    let MavMessage::CAMERA_INFORMATION(mut known) = camera() else {
        unreachable!("its own message")
    };
    known.flags |= CameraCapFlags::CAMERA_CAP_FLAGS_HAS_BASIC_FOCUS;
    scene.report(CAMERA, MavMessage::CAMERA_INFORMATION(known));
    scene.accept(CAMERA);
    scene.machine.states.entry(1).or_default().by_hand = true;
    let auto = || PayloadSteeringCommand {
        set_focus: Some(SetFocus::NoChange),
        focus_type: Some(FocusType::Auto),
        ..zoom(SetZoom::NoChange)
    };
    let focus = [MavCmd::MAV_CMD_SET_CAMERA_FOCUS];
    assert_eq!(scene.command(auto()), [AckType::Received]);
    assert_eq!(scene.answer(CAMERA, MavResult::MAV_RESULT_DENIED), focus);
    assert_eq!(scene.answers(), [AckType::Refused]);
    assert_eq!(scene.command(auto()), [AckType::Received]);
    assert_eq!(scene.accept(CAMERA), focus);
    assert_eq!(scene.answers(), [AckType::CarriedOut]);
    assert_eq!(scene.command(auto()), [AckType::CarriedOut], "it is so");
}

#[test]
fn angles_are_not_shown_once_another_steers_the_gimbal_and_the_next_take_it_back() {
    let mut scene = Scene::new();
    scene.report(1, manager([245, 190]));
    scene.accept(1);
    scene.mode(EoirPointingMode::AngleToUa);
    scene.handle(Input::Poll);
    assert_eq!(scene.machine.states[&1].shown, EoirPointingMode::AngleToUa);
    scene.world.sent_to(0);
    // As PX4's navigator leaves it.
    scene.report(1, manager([0, 0]));
    let sent = scene.world.sent_to(0);
    let alerts_of = |message: &&Message| match message {
        Message::SubsystemStatusAlert(alert) => alert
            .text
            .as_ref()
            .is_some_and(|text| text.as_str().contains("controlled by nobody")),
        _ => false,
    };
    assert_eq!(sent.iter().filter(alerts_of).count(), 1, "{sent:?}");
    assert_eq!(scene.machine.states[&1].shown, EoirPointingMode::NoValue);
    scene.report(1, manager([0, 0]));
    assert!(scene.world.sent_to(0).is_empty(), "once");
    assert_eq!(scene.command(steer(-30.0)), [AckType::Received]);
    let control = MavCmd::MAV_CMD_DO_GIMBAL_MANAGER_CONFIGURE;
    assert_eq!(scene.accept(1), [control]);
    scene.later(0.5);
    scene.report(1, manager([245, 190]));
    assert_eq!(
        scene.accept(1),
        [MavCmd::MAV_CMD_DO_GIMBAL_MANAGER_PITCHYAW]
    );
    scene.later(0.2);
    scene.report(GIMBAL, looking(30.0));
    assert_eq!(scene.answers(), [AckType::CarriedOut]);
    assert_eq!(scene.machine.states[&1].shown, EoirPointingMode::AngleToUa);
}

#[test]
fn rates_end_once_another_steers_the_gimbal() {
    let mut scene = Scene::new();
    turning(&mut scene);
    scene.report(1, manager([255, 190]));
    scene.later(1.1);
    scene.handle(Input::Poll);
    assert_eq!(attitudes(&mut scene), []);
    let sent = scene.world.sent_to(0);
    let alerts_of = |message: &Message| match message {
        Message::SubsystemStatusAlert(alert) => alert
            .text
            .as_ref()
            .is_some_and(|text| text.as_str().contains("system 255")),
        _ => false,
    };
    assert!(sent.iter().any(alerts_of), "{sent:?}");
    let state = &scene.machine.states[&1];
    assert_eq!(state.commanded, EoirPointingMode::NoValue);
    assert!(state.moving.is_none());
}
