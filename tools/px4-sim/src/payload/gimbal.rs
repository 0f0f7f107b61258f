//! A gimbal of two axes, and its manager.
//!
//! Its state is pitch and yaw in the level frame of the vehicle's heading: an ideal stabilisation, limited by the
//! drive's speed and the ends of its travel. Its setpoint is in one of several frames (locked to the horizon and to
//! north, or following the vehicle), and is converted again at each step as the vehicle turns.

use std::f64::consts::{FRAC_PI_2, FRAC_PI_3, FRAC_PI_6, PI};

use mavlink::dialects::development as mav;
use mavlink::dialects::development::{
    GimbalDeviceErrorFlags, GimbalDeviceFlags, GimbalManagerCapFlags, GimbalManagerFlags,
    MavMessage,
};
use mavlink_link::service::Node;

use crate::physics::motion::{LocalFrame, Ned};
use crate::vehicle::command::{Answer, Command};

/// A message of a component.
pub(crate) type FromComponent = (u8, MavMessage);

/// What carries the gimbal, in its present state.
#[derive(Debug)]
pub(crate) struct Carrier {
    /// Roll, pitch, yaw, rad.
    pub attitude: [f64; 3],
    /// Where it is, in its local frame.
    pub position: Ned,
    /// The local frame.
    pub frame: LocalFrame,
    /// Time since boot, s.
    pub now: f64,
}

impl Carrier {
    pub(crate) fn boot_ms(&self) -> u32 {
        (self.now * 1e3) as u32
    }
}

/// Who manages it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Manager {
    /// PX4's gimbal module, as component 1.
    Px4,
    /// The gimbal itself.
    Own,
}

/// The setpoint.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Setpoint {
    Neutral,
    Retract,
    /// Pitch and yaw, rad; locked to the horizon and to north, or following the vehicle.
    Angles([f64; 2], Lock),
    /// Rates of both, rad/s, and the time since which they apply.
    Rates([f64; 2], Lock, f64),
    /// A place, in the vehicle's local frame.
    Place(Ned),
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct Lock {
    pitch: bool,
    yaw: bool,
}

#[derive(Debug)]
pub(crate) struct Gimbal {
    device: u8,
    manager: Manager,
    control: [u8; 2],
    setpoint: Setpoint,
    /// Pitch and yaw, level, from the vehicle's heading.
    level: [f64; 2],
    rates: [f64; 2],
    at_limit: [bool; 2],
    /// The vehicle's heading in the step before: a setpoint that is locked to north turns against it.
    heading: f64,
    now: f64,
    next_status: f64,
    next_attitude: f64,
}

impl Gimbal {
    pub(crate) fn new(device: u8, manager: Manager) -> Gimbal {
        Gimbal {
            device,
            manager,
            control: [0; 2],
            setpoint: Setpoint::Neutral,
            level: [0.0; 2],
            rates: [0.0; 2],
            at_limit: [false; 2],
            heading: 0.0,
            now: 0.0,
            next_status: 2.0,
            next_attitude: 2.0,
        }
    }

    pub(crate) fn device(&self) -> u8 {
        self.device
    }

    pub(crate) fn manager(&self) -> Manager {
        self.manager
    }

    pub(crate) fn is_retracted(&self) -> bool {
        self.setpoint == Setpoint::Retract && (self.level[0] - RETRACTED_PITCH).abs() < 0.02
    }

    /// The direction of its line of sight: north, east, down.
    pub(crate) fn sight(&self, carrier: &Carrier) -> [f64; 3] {
        turn(vector(self.level), [0.0, 0.0, carrier.attitude[2]])
    }

    pub(crate) fn step(&mut self, dt: f64, carrier: &Carrier, out: &mut Vec<FromComponent>) {
        self.now = carrier.now;
        let wanted = self.wanted(dt, carrier);
        self.heading = carrier.attitude[2];
        for (axis, [low, high]) in LIMITS.into_iter().enumerate() {
            let target = wanted[axis].clamp(low, high);
            self.at_limit[axis] = (target - wanted[axis]).abs() > 1e-6;
            let step = (target - self.level[axis]).clamp(-MAX_RATE * dt, MAX_RATE * dt);
            self.level[axis] += step;
            self.rates[axis] = step / dt;
        }
        if carrier.now >= self.next_attitude {
            self.next_attitude = carrier.now + 0.2;
            out.push((self.device, self.attitude(carrier)));
        }
        if self.manager == Manager::Own && carrier.now >= self.next_status {
            self.next_status = carrier.now + 1.0;
            out.push((self.device, self.status(carrier.boot_ms())));
        }
    }

    /// The commanded pitch and yaw, in the level frame of the vehicle's heading.
    fn wanted(&mut self, dt: f64, carrier: &Carrier) -> [f64; 2] {
        let [roll, pitch, heading] = carrier.attitude;
        let following = |angles| angles_of(turn(vector(angles), [roll, pitch, 0.0]));
        let (stands, turned) = (self.level, wrapped(heading - self.heading));
        match &mut self.setpoint {
            Setpoint::Neutral => following([0.0, 0.0]),
            Setpoint::Retract => [RETRACTED_PITCH, 0.0],
            Setpoint::Angles(angles, lock) => {
                let [_, yaw] = *angles;
                let mut level = if lock.pitch {
                    *angles
                } else {
                    following(*angles)
                };
                if lock.yaw {
                    level[1] = wrapped(yaw - heading);
                }
                level
            }
            Setpoint::Rates(rates, lock, since) => {
                // PX4 ends rates by itself: a gimbal must not keep turning because the link with its setpoints was
                // lost.
                if carrier.now - *since > RATES_END_S {
                    *rates = [0.0; 2];
                }
                let turned = if lock.yaw { turned } else { 0.0 };
                [
                    stands[0] + rates[0] * dt,
                    wrapped(stands[1] + rates[1] * dt - turned),
                ]
            }
            Setpoint::Place(at) => {
                let (north, east) = (at.n - carrier.position.n, at.e - carrier.position.e);
                let down = at.d - carrier.position.d;
                let along = north.hypot(east).max(1e-3);
                [(-down).atan2(along), wrapped(east.atan2(north) - heading)]
            }
        }
    }

    /// Whether its angles follow the vehicle, and so are reported in the vehicle's frame.
    fn follows(&self) -> bool {
        matches!(self.setpoint, Setpoint::Angles(_, lock) | Setpoint::Rates(_, lock, _) if !lock.pitch)
    }

    fn attitude(&self, carrier: &Carrier) -> MavMessage {
        use GimbalDeviceFlags as F;
        let [roll, pitch, heading] = carrier.attitude;
        let mut flags = F::empty();
        let mut angles = self.level;
        let locks_yaw = matches!(
            self.setpoint,
            Setpoint::Place(_)
                | Setpoint::Angles(_, Lock { yaw: true, .. })
                | Setpoint::Rates(_, Lock { yaw: true, .. }, _)
        );
        if self.follows() {
            angles = angles_of(turn_back(vector(self.level), [roll, pitch, 0.0]));
        } else {
            flags |= F::GIMBAL_DEVICE_FLAGS_ROLL_LOCK | F::GIMBAL_DEVICE_FLAGS_PITCH_LOCK;
        }
        if locks_yaw {
            flags |= F::GIMBAL_DEVICE_FLAGS_YAW_LOCK | F::GIMBAL_DEVICE_FLAGS_YAW_IN_EARTH_FRAME;
            angles[1] = wrapped(self.level[1] + heading);
        } else {
            flags |= F::GIMBAL_DEVICE_FLAGS_YAW_IN_VEHICLE_FRAME;
        }
        match self.setpoint {
            Setpoint::Neutral => flags |= F::GIMBAL_DEVICE_FLAGS_NEUTRAL,
            Setpoint::Retract if self.is_retracted() => flags |= F::GIMBAL_DEVICE_FLAGS_RETRACT,
            _ => {}
        }
        let mut failures = GimbalDeviceErrorFlags::empty();
        if self.at_limit[0] {
            failures |= GimbalDeviceErrorFlags::GIMBAL_DEVICE_ERROR_FLAGS_AT_PITCH_LIMIT;
        }
        if self.at_limit[1] {
            failures |= GimbalDeviceErrorFlags::GIMBAL_DEVICE_ERROR_FLAGS_AT_YAW_LIMIT;
        }
        MavMessage::GIMBAL_DEVICE_ATTITUDE_STATUS(mav::GIMBAL_DEVICE_ATTITUDE_STATUS_DATA {
            time_boot_ms: carrier.boot_ms(),
            q: quaternion(angles),
            angular_velocity_x: 0.0,
            angular_velocity_y: self.rates[0] as f32,
            angular_velocity_z: self.rates[1] as f32,
            failure_flags: failures,
            flags,
            ..Default::default()
        })
    }

    /// GIMBAL_MANAGER_STATUS.
    pub(crate) fn status(&self, boot_ms: u32) -> MavMessage {
        MavMessage::GIMBAL_MANAGER_STATUS(mav::GIMBAL_MANAGER_STATUS_DATA {
            time_boot_ms: boot_ms,
            flags: GimbalManagerFlags::empty(),
            gimbal_device_id: self.device,
            primary_control_sysid: self.control[0],
            primary_control_compid: self.control[1],
            secondary_control_sysid: 0,
            secondary_control_compid: 0,
        })
    }

    /// GIMBAL_MANAGER_INFORMATION.
    pub(crate) fn information(&self, boot_ms: u32) -> MavMessage {
        use GimbalManagerCapFlags as C;
        let mut can = C::GIMBAL_MANAGER_CAP_FLAGS_HAS_NEUTRAL
            | C::GIMBAL_MANAGER_CAP_FLAGS_HAS_PITCH_AXIS
            | C::GIMBAL_MANAGER_CAP_FLAGS_HAS_PITCH_FOLLOW
            | C::GIMBAL_MANAGER_CAP_FLAGS_HAS_PITCH_LOCK
            | C::GIMBAL_MANAGER_CAP_FLAGS_HAS_YAW_AXIS
            | C::GIMBAL_MANAGER_CAP_FLAGS_HAS_YAW_FOLLOW
            | C::GIMBAL_MANAGER_CAP_FLAGS_HAS_YAW_LOCK
            | C::GIMBAL_MANAGER_CAP_FLAGS_CAN_POINT_LOCATION_GLOBAL;
        if self.manager == Manager::Own {
            can |= C::GIMBAL_MANAGER_CAP_FLAGS_HAS_RETRACT;
        }
        let [[pitch_min, pitch_max], [yaw_min, yaw_max]] =
            LIMITS.map(|ends| ends.map(|end| end as f32));
        MavMessage::GIMBAL_MANAGER_INFORMATION(mav::GIMBAL_MANAGER_INFORMATION_DATA {
            time_boot_ms: boot_ms,
            cap_flags: can,
            roll_min: 0.0,
            roll_max: 0.0,
            pitch_min,
            pitch_max,
            yaw_min,
            yaw_max,
            gimbal_device_id: self.device,
        })
    }

    /// Carries out a command to the component of a gimbal that is its own manager.
    pub(crate) fn execute_own(
        &mut self,
        command: &Command,
        carrier: &Carrier,
    ) -> (Answer, Vec<FromComponent>) {
        if self.manager != Manager::Own {
            return (Answer::Unsupported, Vec::new());
        }
        if command.id == REQUEST_MESSAGE {
            let message = match command.param(1) as u32 {
                280 => self.information(carrier.boot_ms()),
                281 => self.status(carrier.boot_ms()),
                285 => self.attitude(carrier),
                _ => return (Answer::Denied, Vec::new()),
            };
            return (Answer::Accepted, vec![(self.device, message)]);
        }
        let mut command = *command;
        if command.id == SET_ROI_LOCATION {
            command = place(&command, carrier);
        }
        (self.execute(&command), Vec::new())
    }

    /// Carries out a command to its manager. Params 5 to 7 of [`SET_ROI_LOCATION`] are metres in the local frame
    /// ([`place`]).
    pub(crate) fn execute(&mut self, command: &Command) -> Answer {
        let from = [command.from.system, command.from.component];
        match command.id {
            CONFIGURE => {
                let own = [command.target.system, command.target.component.max(1)];
                for side in [0, 1] {
                    self.control[side] = match command.param(side + 1).round() as i64 {
                        id @ 0..=255 => id as u8,
                        -2 => own[side],
                        -3 if self.control[side] == from[side] => 0,
                        _ => self.control[side],
                    };
                }
                Answer::Accepted
            }
            PITCHYAW if self.control != from => Answer::Denied,
            PITCHYAW => {
                let flags = GimbalManagerFlags::from_bits_truncate(command.param(5) as u32);
                let angle = |number| command.given(number).unwrap_or(0.0).to_radians();
                let rates = match self.manager {
                    // PX4 takes an absent angle as 0, and returns to it at every step: rates alone have an effect
                    // only by GIMBAL_MANAGER_SET_ATTITUDE.
                    Manager::Px4 => [None; 2],
                    Manager::Own => [3, 4].map(|number| command.given(number).map(f64::to_radians)),
                };
                self.set(flags, Some([angle(1), angle(2)]), rates)
            }
            SET_ROI_LOCATION => {
                let [.., n, e, d] = command.params;
                self.setpoint = Setpoint::Place(Ned::new(n, e, d));
                Answer::Accepted
            }
            SET_ROI_NONE => {
                self.setpoint = Setpoint::Neutral;
                Answer::Accepted
            }
            _ => Answer::Unsupported,
        }
    }

    /// GIMBAL_MANAGER_SET_ATTITUDE.
    pub(crate) fn set_attitude(&mut self, from: Node, m: &mav::GIMBAL_MANAGER_SET_ATTITUDE_DATA) {
        if self.control != [from.system, from.component] {
            return;
        }
        let q = m.q.map(f64::from);
        let angles = q.iter().all(|part| part.is_finite()).then(|| {
            let [w, x, y, z] = q;
            angles_of([
                1.0 - 2.0 * (y * y + z * z),
                2.0 * (x * y + w * z),
                2.0 * (x * z - w * y),
            ])
        });
        let rates = [m.angular_velocity_y, m.angular_velocity_z]
            .map(|rate| rate.is_finite().then_some(f64::from(rate)));
        self.set(m.flags, angles, rates);
    }

    /// It is to look ahead, and nobody controls it then.
    pub(crate) fn centre(&mut self) {
        self.setpoint = Setpoint::Neutral;
        self.control = [0; 2];
    }

    /// GIMBAL_MANAGER_SET_PITCHYAW.
    pub(crate) fn set_pitch_yaw(&mut self, from: Node, m: &mav::GIMBAL_MANAGER_SET_PITCHYAW_DATA) {
        if self.control != [from.system, from.component] {
            return;
        }
        let given = |value: f32| value.is_finite().then_some(f64::from(value));
        let angles = given(m.pitch).zip(given(m.yaw));
        let angles = angles.map(|(pitch, yaw)| [pitch, yaw]);
        self.set(m.flags, angles, [given(m.pitch_rate), given(m.yaw_rate)]);
    }

    fn set(
        &mut self,
        flags: GimbalManagerFlags,
        angles: Option<[f64; 2]>,
        rates: [Option<f64>; 2],
    ) -> Answer {
        use GimbalManagerFlags as F;
        let lock = Lock {
            pitch: flags.contains(F::GIMBAL_MANAGER_FLAGS_PITCH_LOCK),
            yaw: flags.contains(F::GIMBAL_MANAGER_FLAGS_YAW_LOCK),
        };
        if flags.contains(F::GIMBAL_MANAGER_FLAGS_RETRACT) {
            // PX4's manager acknowledges a retract and does nothing.
            if self.manager == Manager::Own {
                self.setpoint = Setpoint::Retract;
            }
        } else if flags.contains(F::GIMBAL_MANAGER_FLAGS_NEUTRAL) {
            self.setpoint = Setpoint::Neutral;
        } else if let [Some(pitch), Some(yaw)] = rates {
            self.setpoint = Setpoint::Rates([pitch, yaw], lock, self.now);
        } else if let Some(angles) = angles {
            self.setpoint = Setpoint::Angles(angles, lock);
        }
        Answer::Accepted
    }
}

/// DO_SET_ROI_LOCATION with its place converted to the local frame, in which the gimbal works. The altitude is AMSL,
/// whatever the frame.
pub(crate) fn place(command: &Command, carrier: &Carrier) -> Command {
    let mut command = *command;
    let [.., latitude, longitude, amsl] = command.params;
    let at = carrier
        .frame
        .to_local(crate::physics::motion::Geodetic::new(
            latitude, longitude, amsl,
        ));
    for (param, value) in command.params.iter_mut().skip(4).zip([at.n, at.e, at.d]) {
        *param = value;
    }
    command
}

/// The unit vector for pitch and yaw: forward, right, down.
fn vector([pitch, yaw]: [f64; 2]) -> [f64; 3] {
    let ((sp, cp), (sy, cy)) = (pitch.sin_cos(), yaw.sin_cos());
    [cp * cy, cp * sy, -sp]
}

fn angles_of([x, y, z]: [f64; 3]) -> [f64; 2] {
    [(-z).clamp(-1.0, 1.0).asin(), y.atan2(x)]
}

fn turn([x, y, z]: [f64; 3], [roll, pitch, yaw]: [f64; 3]) -> [f64; 3] {
    let ((sr, cr), (sp, cp), (sy, cy)) = (roll.sin_cos(), pitch.sin_cos(), yaw.sin_cos());
    let (y, z) = (cr * y - sr * z, sr * y + cr * z);
    let (x, z) = (cp * x + sp * z, cp * z - sp * x);
    [cy * x - sy * y, sy * x + cy * y, z]
}

fn turn_back([x, y, z]: [f64; 3], [roll, pitch, yaw]: [f64; 3]) -> [f64; 3] {
    let ((sr, cr), (sp, cp), (sy, cy)) = (roll.sin_cos(), pitch.sin_cos(), yaw.sin_cos());
    let (x, y) = (cy * x + sy * y, cy * y - sy * x);
    let (x, z) = (cp * x - sp * z, sp * x + cp * z);
    [x, cr * y + sr * z, cr * z - sr * y]
}

fn quaternion([pitch, yaw]: [f64; 2]) -> [f32; 4] {
    let ((sp, cp), (sy, cy)) = ((pitch / 2.0).sin_cos(), (yaw / 2.0).sin_cos());
    [cp * cy, -sp * sy, sp * cy, cp * sy].map(|part| part as f32)
}

fn wrapped(angle: f64) -> f64 {
    (angle + PI).rem_euclid(2.0 * PI) - PI
}

/// DO_GIMBAL_MANAGER_PITCHYAW and DO_GIMBAL_MANAGER_CONFIGURE.
pub(crate) const PITCHYAW: u16 = 1000;
pub(crate) const CONFIGURE: u16 = 1001;
pub(crate) const SET_ROI_LOCATION: u16 = 195;
pub(crate) const SET_ROI_NONE: u16 = 197;
const REQUEST_MESSAGE: u16 = 512;
/// Pitch -90 to 30 degrees, yaw 150 to either side.
const LIMITS: [[f64; 2]; 2] = [[-FRAC_PI_2, FRAC_PI_6], [-5.0 * FRAC_PI_6, 5.0 * FRAC_PI_6]];
/// Pitch of a retracted gimbal: the upper end of its travel.
const RETRACTED_PITCH: f64 = FRAC_PI_6;
/// 60 degrees a second.
const MAX_RATE: f64 = FRAC_PI_3;
/// The timeout of PX4's check_and_handle_setpoint_timeout, s.
const RATES_END_S: f64 = 2.0;
