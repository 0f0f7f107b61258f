//! Payloads of a simulated vehicle: gimbals and cameras, each a MAVLink component of its own beside the autopilot.
//!
//! Station 1 is a MAVLink gimbal (component 154) that PX4's own gimbal manager steers (component 1), and an EO/IR camera
//! (component 100). Station 2 is a smart payload, as PX4's manager drives one gimbal only: its gimbal (component 171) is its own
//! manager, and carries an EO camera (component 101).
//!
//! - [`gimbal`]: how a gimbal moves, and what a gimbal manager accepts. PX4's manager follows its source
//!   (src/modules/gimbal/input_mavlink.cpp, v1.18): a command of a sender that is not in primary control is DENIED,
//!   RETRACT is acknowledged and not done, angles of NaN in DO_GIMBAL_MANAGER_PITCHYAW become 0, and rates end 2 s
//!   after they were set. GIMBAL_MANAGER_SET_ATTITUDE moves it whatever component and device that is for.
//! - [`camera`]: the camera protocol: modes, zoom, focus, photographs, video, storage.

pub(crate) mod camera;
pub(crate) mod gimbal;

use mavlink::MessageData as _;
use mavlink::dialects::development as mav;
use mavlink::dialects::development::MavMessage;
use mavlink_link::service::Node;

use self::camera::{Camera, Kind};
pub(crate) use self::gimbal::FromComponent;
use self::gimbal::{Carrier, Gimbal, Manager};
use crate::config::Config;
use crate::vehicle::command::{Answer, Command};

/// The payloads of one vehicle.
#[derive(Debug)]
pub(crate) struct Payloads {
    stations: Vec<Station>,
}

#[derive(Debug)]
struct Station {
    gimbal: Gimbal,
    camera: Camera,
}

/// The true state of a payload, for tests and pictures.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PayloadTruth {
    /// North, east, down: a unit vector.
    pub sight: [f64; 3],
    /// The gimbal is retracted.
    pub retracted: bool,
    /// Horizontal field of view, rad.
    pub hfov: f64,
    /// Video is recorded.
    pub recording: bool,
    /// Photographs taken.
    pub images: u32,
    /// The stream shows the thermal sensor.
    pub thermal: bool,
    /// Focus, 0 (near) to 100.
    pub focus: f64,
}

impl Payloads {
    pub(crate) fn new(config: &Config) -> Payloads {
        let stations = [
            Station {
                gimbal: Gimbal::new(154, Manager::Px4),
                camera: Camera::new(100, 154, Kind::EoIr),
            },
            Station {
                gimbal: Gimbal::new(171, Manager::Own),
                camera: Camera::new(101, 171, Kind::Eo),
            },
        ];
        let count = usize::from(config.payloads);
        Payloads {
            stations: stations.into_iter().take(count).collect(),
        }
    }

    /// The true state of each payload, station 1 first.
    pub(crate) fn truth(&self, carrier: &Carrier) -> Vec<PayloadTruth> {
        let truth = |station: &Station| PayloadTruth {
            sight: station.gimbal.sight(carrier),
            retracted: station.gimbal.is_retracted(),
            hfov: station.camera.hfov(),
            recording: station.camera.is_recording(),
            images: station.camera.images(),
            thermal: station.camera.is_thermal(),
            focus: station.camera.focus(),
        };
        self.stations.iter().map(truth).collect()
    }

    /// Sets the storage that a camera has left, MiB.
    pub(crate) fn set_storage(&mut self, station: usize, left_mib: f64) {
        if let Some(station) = self.stations.get_mut(station) {
            station.camera.set_storage(left_mib);
        }
    }

    /// Lets time pass, and reports what is due.
    pub(crate) fn step(&mut self, dt: f64, carrier: &Carrier) -> Vec<FromComponent> {
        let mut out = Vec::new();
        for station in &mut self.stations {
            station.gimbal.step(dt, carrier, &mut out);
            station.camera.step(dt, carrier, &mut out);
        }
        out
    }

    /// A message that PX4's gimbal manager streams or answers REQUEST_MESSAGE with.
    pub(crate) fn report(&self, message: u32, boot_ms: u32) -> Option<MavMessage> {
        let mut gimbals = self.stations.iter().map(|station| &station.gimbal);
        let gimbal = gimbals.find(|gimbal| gimbal.manager() == Manager::Px4)?;
        match message {
            mav::GIMBAL_MANAGER_STATUS_DATA::ID => Some(gimbal.status(boot_ms)),
            mav::GIMBAL_MANAGER_INFORMATION_DATA::ID => Some(gimbal.information(boot_ms)),
            _ => None,
        }
    }

    /// A command to another component than the autopilot: the answer, and further messages. `None` where there is no
    /// such component.
    pub(crate) fn execute(
        &mut self,
        command: &Command,
        carrier: &Carrier,
    ) -> Option<(Answer, Vec<FromComponent>)> {
        let component = command.target.component;
        for Station { gimbal, camera } in &mut self.stations {
            if camera.component() == component {
                return Some(camera.execute(command, carrier));
            }
            if gimbal.device() == component {
                return Some(gimbal.execute_own(command, carrier));
            }
        }
        None
    }

    /// A command to the autopilot that its gimbal manager handles. `None` where it has no gimbal: then nothing
    /// answers.
    pub(crate) fn execute_by_px4(&mut self, command: &Command) -> Option<Answer> {
        let mut gimbals = self.stations.iter_mut().map(|station| &mut station.gimbal);
        let gimbal = gimbals.find(|gimbal| gimbal.manager() == Manager::Px4)?;
        Some(gimbal.execute(command))
    }

    /// PX4's navigator takes its gimbal, whoever controls it, centres it, and lets go of it.
    pub(crate) fn centre(&mut self) {
        for Station { gimbal, .. } in &mut self.stations {
            if gimbal.manager() == Manager::Px4 {
                gimbal.centre();
            }
        }
    }

    /// GIMBAL_MANAGER_SET_ATTITUDE, which is never answered. PX4's receiver and gimbal module look at no target and at no device,
    /// only at who is in control.
    pub(crate) fn set_attitude(
        &mut self,
        from: Node,
        message: &mav::GIMBAL_MANAGER_SET_ATTITUDE_DATA,
        system: u8,
    ) {
        for Station { gimbal, .. } in &mut self.stations {
            let own = Node::new(system, gimbal.device());
            if gimbal.manager() == Manager::Px4
                || own.is_target(message.target_system, message.target_component)
            {
                gimbal.set_attitude(from, message);
            }
        }
    }

    /// GIMBAL_MANAGER_SET_PITCHYAW, which PX4 v1.18 does not handle.
    pub(crate) fn set_pitch_yaw(
        &mut self,
        from: Node,
        message: &mav::GIMBAL_MANAGER_SET_PITCHYAW_DATA,
        system: u8,
    ) {
        for Station { gimbal, .. } in &mut self.stations {
            let own = Node::new(system, gimbal.device());
            if gimbal.manager() == Manager::Own
                && own.is_target(message.target_system, message.target_component)
            {
                gimbal.set_pitch_yaw(from, message);
            }
        }
    }
}
