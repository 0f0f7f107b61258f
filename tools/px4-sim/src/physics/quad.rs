//! A quadrotor: it follows a trajectory as PX4's controllers do, with some lag and error, tilts with its
//! acceleration, and lands on flat ground at the height of its home.

use crate::physics::motion::{GRAVITY, Motion, Ned, tilt_for, wrap_pi};
use crate::physics::noise::{Drift, Noise};
use crate::physics::trajectory::{Circle, Guidance, Heading, Limits, Trajectory, braking_speed};

/// What the controllers use of the parameters.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct QuadTuning {
    /// Limits of the trajectory.
    pub limits: Limits,
    /// MPC_XY_P, 1/s.
    pub position_gain: f64,
    /// MPC_XY_VEL_P_ACC, 1/s.
    pub velocity_gain: f64,
    /// MPC_TKO_SPEED, m/s.
    pub takeoff_speed: f64,
    /// MPC_TKO_RAMP_T, s.
    pub takeoff_ramp: f64,
    /// MPC_LAND_SPEED, m/s.
    pub land_speed: f64,
    /// MPC_LAND_CRWL, m/s, below MPC_LAND_ALT3.
    pub land_crawl: f64,
    /// MPC_LAND_ALT1, 2, 3, m above ground.
    pub land_altitudes: [f64; 3],
    /// MPC_YAWRAUTO_MAX, rad/s.
    pub yaw_rate: f64,
    /// MPC_YAWRAUTO_ACC, rad/s2.
    pub yaw_acc: f64,
}

/// The airframe's state.
#[derive(Debug, Clone)]
pub(crate) struct Quad {
    /// The true motion.
    pub motion: Motion,
    /// The present setpoint: position, velocity, acceleration.
    pub trajectory: Trajectory,
    steering: Steering,
    /// Heading setpoint, radians.
    pub heading: f64,
    heading_rate: f64,
    /// Acceleration of the rotors beyond what holds the weight.
    push: Ned,
    /// What the integrators of the velocity controllers add against drag and wind.
    trim: Ned,
    wind: [f64; 2],
    gusts: [Drift; 3],
    noise: Noise,
    /// Throttle, 0 to 1.
    pub throttle: f64,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Steering {
    Ground,
    Leg,
    Other,
}

impl Quad {
    /// On the ground at the origin.
    pub(crate) fn new(heading: f64, wind: [f64; 2], seed: u64) -> Self {
        let motion = Motion {
            attitude: [0.0, 0.0, heading],
            ..Motion::default()
        };
        Self {
            motion,
            trajectory: Trajectory::default(),
            steering: Steering::Ground,
            heading,
            heading_rate: 0.0,
            push: Ned::default(),
            trim: Ned::default(),
            wind,
            gusts: [
                Drift::new(1.0, 1.2),
                Drift::new(1.0, 1.2),
                Drift::new(1.0, 0.8),
            ],
            noise: Noise::new(seed ^ 0x51AD),
            throttle: 0.0,
        }
    }

    /// Continues the motion of another airframe.
    pub(crate) fn take_over(&mut self, motion: Motion) {
        self.motion = motion;
        self.trajectory.reset(motion.position, motion.velocity);
        self.steering = Steering::Other;
        (self.heading, self.heading_rate) = (motion.attitude[2], 0.0);
        (self.push, self.trim) = (Ned::default(), Ned::default());
    }

    /// One step. `error` is the estimator's present position error: the controllers use the estimate, not the truth.
    pub(crate) fn step(
        &mut self,
        dt: f64,
        guidance: &Guidance,
        heading: &Heading,
        error: Ned,
        tuning: &QuadTuning,
    ) {
        if matches!(guidance, Guidance::Ground) {
            self.rest(dt);
            return;
        }
        let believed = self.motion.position + error;
        self.plan(dt, guidance, believed, tuning);
        self.steer_heading(dt, guidance, heading, believed, tuning);
        self.fly(dt, believed, tuning);
    }

    fn rest(&mut self, dt: f64) {
        self.steering = Steering::Ground;
        (self.push, self.trim) = (Ned::default(), Ned::default());
        if self.motion.position.d < 0.0 {
            // Motors stopped in the air.
            self.motion.acceleration = Ned::new(0.0, 0.0, GRAVITY);
            self.motion.velocity.d += GRAVITY * dt;
            self.motion.position = self.motion.position + self.motion.velocity * dt;
        }
        if self.motion.position.d >= 0.0 {
            self.motion.position.d = 0.0;
            self.motion.velocity = Ned::default();
            self.motion.acceleration = Ned::default();
        }
        self.heading = self.motion.attitude[2];
        self.heading_rate = 0.0;
        self.throttle = 0.0;
        let yaw = self.motion.attitude[2];
        self.motion.turn_to([0.0, 0.0, yaw], dt);
    }

    fn plan(&mut self, dt: f64, guidance: &Guidance, believed: Ned, tuning: &QuadTuning) {
        let kind = match guidance {
            Guidance::Leg { .. } | Guidance::Land { .. } | Guidance::Climb { .. } => Steering::Leg,
            _ => Steering::Other,
        };
        // Between legs the trajectory continues, since a restart at each waypoint would stop the setpoint there. It
        // restarts on leaving the ground, and where another kind of steering has left it more than 3 m away.
        if kind != self.steering {
            let at = self.motion.position;
            if self.steering == Steering::Ground {
                self.trajectory.reset(believed, Ned::default());
            } else if (at - self.trajectory.position).norm() > 3.0 {
                self.trajectory.reset(believed, self.motion.velocity);
            }
            self.steering = kind;
        }
        let above_ground = -self.motion.position.d;
        let mut limits = tuning.limits;
        match guidance {
            Guidance::Ground => {}
            Guidance::Leg(leg) => self.trajectory.follow(dt, leg, believed, &limits),
            Guidance::Climb(leg) => {
                // MPC_TKO_SPEED limits the climb below MPC_LAND_ALT1 only, and the ramp builds it up.
                if above_ground < tuning.land_altitudes[0] {
                    limits.climb = tuning.takeoff_speed;
                    limits.acc_up = tuning.takeoff_speed / tuning.takeoff_ramp;
                }
                self.trajectory.follow(dt, leg, believed, &limits);
            }
            Guidance::Land(leg) => {
                let sink = self.landing_speed(tuning);
                self.trajectory
                    .follow_and_sink(dt, leg, sink, believed, &limits);
            }
            Guidance::Steer { position, velocity } => {
                let desired = self.steered(position, velocity, tuning);
                self.trajectory.advance(dt, desired, believed, &limits);
            }
            &Guidance::Track {
                position,
                velocity,
                acceleration,
            } => {
                // PositionControl takes set points without any planning of its own; only the pull of a far one is limited.
                self.trajectory.reset(position, velocity);
                self.trajectory.acceleration = acceleration;
                let off = position - believed;
                let reach = limits.speed_max / tuning.position_gain;
                if off.norm() > reach {
                    self.trajectory.position = believed + off * (reach / off.norm());
                }
            }
            &Guidance::Circle(Circle {
                centre,
                radius,
                speed,
            }) => {
                let out = believed - centre;
                let r = out.horizontal().max(0.1);
                let (un, ue) = (out.n / r, out.e / r);
                let side = radius.signum();
                // Toward the circle first, then around it.
                let outward = (0.6 * (radius.abs() - r)).clamp(-speed.abs(), speed.abs());
                let round = (speed * speed - outward * outward).max(0.0).sqrt() * side;
                let climb = (1.0 * (centre.d - self.trajectory.position.d))
                    .clamp(-limits.climb, limits.sink);
                let desired = Ned::new(un * outward - ue * round, ue * outward + un * round, climb);
                self.trajectory.advance(dt, desired, believed, &limits);
            }
        }
    }

    /// Fast above the first altitude, slow below the second, at crawl speed below the third.
    fn landing_speed(&self, tuning: &QuadTuning) -> f64 {
        let height = -self.motion.position.d;
        let [high, low, crawl] = tuning.land_altitudes;
        if height <= crawl {
            return tuning.land_crawl;
        }
        let share = ((height - low) / (high - low)).clamp(0.0, 1.0);
        tuning.land_speed + share * (tuning.limits.sink - tuning.land_speed)
    }

    /// The velocity that a steering setpoint requests: from the distance to a position, from a velocity, or from
    /// both; an axis with neither stops.
    fn steered(
        &self,
        position: &[Option<f64>; 3],
        velocity: &[Option<f64>; 3],
        tuning: &QuadTuning,
    ) -> Ned {
        let at = self.trajectory.position;
        let axis = |i: usize, here: f64, gain: f64| {
            let lead = velocity[i].unwrap_or(0.0);
            lead + position[i].map_or(0.0, |p| gain * (p - here))
        };
        // Far away it approaches no faster than it can brake.
        let gain = match (position[0], position[1]) {
            (Some(n), Some(e)) => {
                let far = (n - at.n).hypot(e - at.e).max(0.1);
                let limits = &tuning.limits;
                let speed = braking_speed(limits.jerk, limits.acc_hor, far, 0.0);
                tuning.position_gain.min(speed / far)
            }
            _ => tuning.position_gain,
        };
        let (n, e) = (axis(0, at.n, gain), axis(1, at.e, gain));
        let d = axis(2, at.d, 1.0).clamp(-tuning.limits.climb, tuning.limits.sink);
        let speed = n.hypot(e);
        let k = if speed > tuning.limits.speed_max {
            tuning.limits.speed_max / speed
        } else {
            1.0
        };
        Ned::new(n * k, e * k, d)
    }

    fn steer_heading(
        &mut self,
        dt: f64,
        guidance: &Guidance,
        heading: &Heading,
        believed: Ned,
        t: &QuadTuning,
    ) {
        let goal = match heading {
            Heading::Hold => None,
            Heading::To(yaw) => Some(*yaw),
            Heading::Rate(rate) => {
                self.heading_rate = rate.clamp(-3.5, 3.5);
                self.heading = wrap_pi(self.heading + self.heading_rate * dt);
                return;
            }
            Heading::Along => match guidance {
                Guidance::Leg(leg) => {
                    let way = leg.target - believed;
                    (way.horizontal() > leg.acceptance).then(|| way.bearing())
                }
                Guidance::Circle(circle) => Some((circle.centre - believed).bearing()),
                _ => None,
            },
        };
        let desired = match goal {
            Some(goal) => {
                let off = wrap_pi(goal - self.heading);
                let rate = (2.0 * t.yaw_acc * off.abs())
                    .sqrt()
                    .min(4.0 * off.abs())
                    .min(t.yaw_rate);
                rate * off.signum()
            }
            None => 0.0,
        };
        self.heading_rate += (desired - self.heading_rate).clamp(-t.yaw_acc * dt, t.yaw_acc * dt);
        self.heading = wrap_pi(self.heading + self.heading_rate * dt);
    }

    fn fly(&mut self, dt: f64, believed: Ned, tuning: &QuadTuning) {
        let plan = &self.trajectory;
        let off = plan.position - believed;
        let v = self.motion.velocity;
        let k = tuning.velocity_gain;
        let gap = Ned::new(
            plan.velocity.n + tuning.position_gain * off.n - v.n,
            plan.velocity.e + tuning.position_gain * off.e - v.e,
            plan.velocity.d + off.d - v.d,
        );
        let integrated = Ned::new(gap.n * TRIM_XY, gap.e * TRIM_XY, gap.d * TRIM_Z) * dt;
        self.trim = limited(self.trim + integrated, MAX_TRIM);
        let mut desired =
            plan.acceleration + Ned::new(k * gap.n, k * gap.e, VELOCITY_GAIN_Z * gap.d) + self.trim;
        // Horizontal acceleration of at most gravity is a tilt of about 45 degrees, the default of MPC_TILTMAX_AIR.
        let tilt = desired.horizontal();
        if tilt > GRAVITY {
            desired.n *= GRAVITY / tilt;
            desired.e *= GRAVITY / tilt;
        }
        desired.d = desired.d.clamp(-8.0, 6.0);
        // Attitude responds with a delay, thrust faster.
        let (slow, fast) = ((dt / 0.15).min(1.0), (dt / 0.06).min(1.0));
        self.push.n += (desired.n - self.push.n) * slow;
        self.push.e += (desired.e - self.push.e) * slow;
        self.push.d += (desired.d - self.push.d) * fast;
        let [gn, ge, gd] = &mut self.gusts;
        // Gusts shake a vehicle with drag more at speed than in hover.
        let (rough_xy, rough_z) = (0.08 + 0.09 * v.horizontal(), 0.08 + 0.04 * v.horizontal());
        let gust = Ned::new(
            rough_xy * gn.step(dt, &mut self.noise),
            rough_xy * ge.step(dt, &mut self.noise),
            rough_z * gd.step(dt, &mut self.noise),
        );
        let drag = Ned::new(v.n - self.wind[0], v.e - self.wind[1], v.d) * DRAG;
        self.motion.acceleration = self.push - drag + gust;
        self.motion.velocity = v + self.motion.acceleration * dt;
        self.motion.position = self.motion.position + self.motion.velocity * dt;
        if self.motion.position.d > 0.0 {
            self.motion.position.d = 0.0;
            self.motion.velocity = Ned::default();
        }
        let force = self.push - Ned::new(0.0, 0.0, GRAVITY);
        let (roll, pitch) = tilt_for(force, self.heading);
        self.throttle = (0.5 * force.norm() / GRAVITY).clamp(0.0, 1.0);
        self.motion.turn_to([roll, pitch, self.heading], dt);
    }
}

fn limited(v: Ned, most: f64) -> Ned {
    Ned::new(
        v.n.clamp(-most, most),
        v.e.clamp(-most, most),
        v.d.clamp(-most, most),
    )
}

/// SIH_KDV over SIH_MASS, 1/s: the reference vehicle has much drag, and flies slower than it plans.
const DRAG: f64 = 1.0;
/// MPC_Z_VEL_P_ACC, 1/s.
const VELOCITY_GAIN_Z: f64 = 4.0;
/// MPC_XY_VEL_I_ACC, 1/s2.
const TRIM_XY: f64 = 0.4;
/// MPC_Z_VEL_I_ACC, 1/s2.
const TRIM_Z: f64 = 2.0;
/// Limit of the integrators, m/s2; PX4 limits the vertical one to standard gravity.
const MAX_TRIM: f64 = 9.0;
