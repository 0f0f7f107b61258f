//! Steering from outside: the pilot's sticks and OFFBOARD setpoints.

use mavlink::dialects::development::{
    MANUAL_CONTROL_DATA, SET_POSITION_TARGET_GLOBAL_INT_DATA, SET_POSITION_TARGET_LOCAL_NED_DATA,
};

use crate::config::{Param, Params};
use crate::physics::motion::{Geodetic, LocalFrame, Ned};
use crate::physics::trajectory::{Guidance, Heading};

/// MANUAL_CONTROL, each axis from -1 to 1.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(crate) struct Sticks {
    forward: f64,
    right: f64,
    up: f64,
    turn: f64,
}

impl Sticks {
    /// From the message; an axis with INT16_MAX is absent and counts as centred.
    ///
    /// In single precision and by a multiplication, as PX4 is compiled (-freciprocal-math): 900 becomes more than 0.9.
    pub(crate) fn new(m: &MANUAL_CONTROL_DATA) -> Self {
        let axis = |v: i16| {
            if v == i16::MAX {
                0.0
            } else {
                f64::from((f32::from(v) * 0.001).clamp(-1.0, 1.0))
            }
        };
        let throttle = if m.z == i16::MAX {
            0.0
        } else {
            f64::from((f32::from(m.z) * 0.001 * 2.0 - 1.0).clamp(-1.0, 1.0))
        };
        Self {
            forward: axis(m.x),
            right: axis(m.y),
            up: throttle,
            turn: axis(m.r),
        }
    }

    /// A climb is requested; without one the vehicle stays on the ground.
    pub(crate) fn wants_up(&self) -> bool {
        self.up > DEADZONE
    }

    /// The corner in which the left stick is while the right one is centred.
    pub(crate) fn gesture(&self) -> Option<Gesture> {
        let [forward, right, up, turn] = self.axes().map(|axis| axis as f32);
        let centred = forward.abs() < 0.1 && right.abs() < 0.1;
        let low = centred && up < -0.8;
        match turn {
            turn if low && turn > 0.9 => Some(Gesture::Arm),
            turn if low && turn < -0.9 => Some(Gesture::Disarm),
            _ => None,
        }
    }

    fn axes(&self) -> [f64; 4] {
        [self.forward, self.right, self.up, self.turn]
    }

    /// The velocity that the sticks request, relative to the heading.
    pub(crate) fn guidance(&self, yaw: f64, params: &Params) -> (Guidance, Heading) {
        let speed = params.get(Param::MPC_VEL_MANUAL);
        let (forward, right) = (dead(self.forward) * speed, dead(self.right) * speed);
        let up = dead(self.up);
        let climb = up
            * params.get(if up > 0.0 {
                Param::MPC_Z_VEL_MAX_UP
            } else {
                Param::MPC_Z_VEL_MAX_DN
            });
        let (sin, cos) = yaw.sin_cos();
        let velocity = [
            Some(forward * cos - right * sin),
            Some(forward * sin + right * cos),
            Some(-climb),
        ];
        let rate = dead(self.turn) * params.get(Param::MPC_MAN_Y_MAX).to_radians();
        (
            Guidance::Steer {
                position: [None; 3],
                velocity,
            },
            Heading::Rate(rate),
        )
    }
}

/// A corner of the left stick that means something.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Gesture {
    /// Lower right.
    Arm,
    /// Lower left.
    Disarm,
}

/// Whether the sticks are being moved by hand, as PX4 judges it (MovingDiff.hpp): by the smoothed speed of an axis, and not by
/// noise about one place.
#[derive(Debug, Default)]
pub(crate) struct Movement {
    last: Option<Judged>,
    axes: [AxisMovement; 4],
}

#[derive(Debug, Clone, Copy)]
struct Judged {
    at: f64,
    came_at: f64,
    sticks: Sticks,
}

#[derive(Debug, Clone, Copy, Default)]
struct AxisMovement {
    /// Smoothed, ranges a second.
    speed: f64,
    /// The way of the last samples that differed, and how many they are.
    upwards: Option<bool>,
    same_way: u32,
}

impl Movement {
    /// Takes the next sticks, and returns whether they are moved faster than MAN_OVERRIDE_SPD.
    pub(crate) fn take(&mut self, now: f64, sticks: Sticks, params: &Params) -> bool {
        let judged = Judged {
            at: now,
            came_at: now,
            sticks,
        };
        let Some(before) = self.last.replace(judged) else {
            return false;
        };
        if now - before.came_at > params.get(Param::COM_RC_LOSS_T) {
            self.axes = [AxisMovement::default(); 4];
            return false;
        }
        self.judge(now - before.at, before.sticks, sticks, params)
    }

    /// The same of the last sticks, every 0.2 s without others (ManualControl::Run): until they are lost, a movement in which they ended
    /// is judged again.
    pub(crate) fn judge_again(&mut self, now: f64, params: &Params) -> bool {
        let Some(last) = self.last.as_mut().filter(|last| now - last.at >= AGAIN_S) else {
            return false;
        };
        let (span, sticks) = (now - last.at, last.sticks);
        last.at = now;
        if now - last.came_at > params.get(Param::COM_RC_LOSS_T) {
            *self = Self::default();
            return false;
        }
        self.judge(span, sticks, sticks, params)
    }

    fn judge(&mut self, span: f64, before: Sticks, sticks: Sticks, params: &Params) -> bool {
        if span <= 0.0 {
            return false;
        }
        let fastest = params.get(Param::MAN_OVERRIDE_SPD);
        let mut moved = false;
        let values = sticks.axes().into_iter().zip(before.axes());
        for (axis, (new, old)) in self.axes.iter_mut().zip(values) {
            moved |= axis.is_moved((new - old) / span, span, fastest);
        }
        fastest >= 0.0 && moved
    }
}

impl AxisMovement {
    fn is_moved(&mut self, speed: f64, span: f64, fastest: f64) -> bool {
        self.speed += (speed - self.speed) * span / (span + SMOOTHED_OVER_S);
        if speed.abs() > 0.0 {
            let upwards = Some(speed > 0.0);
            self.same_way = if self.upwards == upwards {
                self.same_way + 1
            } else {
                1
            };
            self.upwards = upwards;
        }
        self.speed.abs() > fastest && self.same_way >= SAMPLES_OF_ONE_WAY
    }
}

/// A setpoint of OFFBOARD: local frame, NaN where not commanded.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Setpoint {
    position: [Option<f64>; 3],
    velocity: [Option<f64>; 3],
    acceleration: [Option<f64>; 3],
    heading: Heading,
}

impl Setpoint {
    /// From SET_POSITION_TARGET_LOCAL_NED in LOCAL_NED (1), or BODY_NED (8) and BODY_FRD (12), the latter two with a
    /// velocity only. `None` where nothing in it can be flown.
    pub(crate) fn from_local(m: &SET_POSITION_TARGET_LOCAL_NED_DATA, yaw: f64) -> Option<Self> {
        let mask = m.type_mask.bits();
        let mut position = pick([m.x, m.y, m.z], mask, 0);
        let mut velocity = pick([m.vx, m.vy, m.vz], mask, 3);
        let mut acceleration = pick([m.afx, m.afy, m.afz], mask, 6);
        match m.coordinate_frame as u32 {
            1 => {}
            8 | 12 => {
                position = [None; 3];
                acceleration = [None; 3];
                if let [Some(forward), Some(right), _] = velocity {
                    let (sin, cos) = yaw.sin_cos();
                    velocity[0] = Some(forward * cos - right * sin);
                    velocity[1] = Some(forward * sin + right * cos);
                }
            }
            _ => return None,
        }
        let heading = heading(m.yaw, m.yaw_rate, mask);
        Self::new(position, velocity, acceleration, heading)
    }

    /// From SET_POSITION_TARGET_GLOBAL_INT, altitude AMSL (frames 0, 5) or above home (3, 6).
    pub(crate) fn from_global(
        m: &SET_POSITION_TARGET_GLOBAL_INT_DATA,
        frame: &LocalFrame,
        home: Ned,
    ) -> Option<Self> {
        let mask = m.type_mask.bits();
        let at = frame.to_local(Geodetic::from_e7(m.lat_int, m.lon_int, m.alt.into()));
        let d = match m.coordinate_frame as u32 {
            0 | 5 => at.d,
            3 | 6 => home.d - f64::from(m.alt),
            _ => return None,
        };
        let mut position = pick([at.n as f32, at.e as f32, d as f32], mask, 0);
        if let [Some(n), Some(e), _] = &mut position {
            (*n, *e) = (at.n, at.e);
        }
        Self::new(
            position,
            pick([m.vx, m.vy, m.vz], mask, 3),
            pick([m.afx, m.afy, m.afz], mask, 6),
            heading(m.yaw, m.yaw_rate, mask),
        )
    }

    fn new(
        position: [Option<f64>; 3],
        velocity: [Option<f64>; 3],
        acceleration: [Option<f64>; 3],
        heading: Heading,
    ) -> Option<Self> {
        let flyable = position.iter().chain(&velocity).any(Option::is_some);
        flyable.then_some(Self {
            position,
            velocity,
            acceleration,
            heading,
        })
    }

    /// The guidance and heading for it.
    pub(crate) fn guidance(&self) -> (Guidance, Heading) {
        let guidance = match (whole(self.position), whole(self.velocity)) {
            (Some(position), Some(velocity)) => Guidance::Track {
                position,
                velocity,
                acceleration: whole(self.acceleration).unwrap_or_default(),
            },
            _ => Guidance::Steer {
                position: self.position,
                velocity: self.velocity,
            },
        };
        (guidance, self.heading)
    }

    /// A climb is requested; without one the vehicle stays on the ground.
    pub(crate) fn wants_up(&self, down: f64) -> bool {
        self.position[2].is_some_and(|d| d < down - 0.3)
            || self.velocity[2].is_some_and(|v| v < -0.1)
    }
}

fn whole(axes: [Option<f64>; 3]) -> Option<Ned> {
    let [n, e, d] = axes;
    Some(Ned::new(n?, e?, d?))
}

fn pick(values: [f32; 3], mask: u16, shift: u32) -> [Option<f64>; 3] {
    let mut out = [None; 3];
    for (i, value) in values.into_iter().enumerate() {
        let ignored = mask >> (shift + i as u32) & 1 == 1;
        out[i] = (!ignored && value.is_finite()).then_some(f64::from(value));
    }
    out
}

fn heading(yaw: f32, rate: f32, mask: u16) -> Heading {
    if mask & 0x400 == 0 && yaw.is_finite() {
        Heading::To(f64::from(yaw))
    } else if mask & 0x800 == 0 && rate.is_finite() {
        Heading::Rate(f64::from(rate))
    } else {
        Heading::Hold
    }
}

/// The middle tenth of a stick's range counts as centred; the rest is scaled to the full range.
fn dead(v: f64) -> f64 {
    if v.abs() < DEADZONE {
        0.0
    } else {
        (v.abs() - DEADZONE) / (1.0 - DEADZONE) * v.signum()
    }
}

/// The part of a stick's range around its centre that counts as centred.
const DEADZONE: f64 = 0.1;
/// Time constant of the speed of a stick, s.
const SMOOTHED_OVER_S: f64 = 0.05;
/// Fewer in a row are noise.
const SAMPLES_OF_ONE_WAY: u32 = 3;
/// ManualControl::Run waits for sticks this long, s.
const AGAIN_S: f64 = 0.2;
