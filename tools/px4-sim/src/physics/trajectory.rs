//! What the navigator requests of an airframe, and the path that a multicopter derives from it: limited in speed,
//! acceleration and jerk, along the line between two waypoints and round the corner to the next one.
//!
//! The rules are PX4's position smoothing: the speed toward a waypoint is the highest from which the vehicle can
//! still brake or turn there. A vehicle that has not reached its waypoint steers to a point ahead on the leg's line,
//! and that line has no end. Nothing tests whether a waypoint has been passed, so a waypoint with a small acceptance
//! radius can be missed, and the line followed for good.

use super::motion::Ned;

/// How to move.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Guidance {
    /// Motors off or idling on the ground.
    Ground,
    /// Along a leg.
    Leg(Leg),
    /// Along a leg that starts at the ground: slowly at first.
    Climb(Leg),
    /// To above the leg's target, descending until the ground.
    Land(Leg),
    /// By a velocity, a position or both on each axis; an axis with neither stops.
    Steer {
        /// Local position, m.
        position: [Option<f64>; 3],
        /// Velocity, m/s.
        velocity: [Option<f64>; 3],
    },
    /// Along a track that somebody else plans: its place now, with feed-forward. PX4 flies it as it is, unsmoothed.
    Track {
        /// Local position, m.
        position: Ned,
        /// Velocity, m/s.
        velocity: Ned,
        /// Acceleration, m/s2.
        acceleration: Ned,
    },
    /// Around a centre.
    Circle(Circle),
}

/// A circle to fly: that of DO_ORBIT, or a loiter.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Circle {
    /// Centre in the local frame; down is the height to keep.
    pub centre: Ned,
    /// Radius, m; positive is clockwise from above.
    pub radius: f64,
    /// Speed over ground, m/s.
    pub speed: f64,
}

/// Where to point the nose.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Heading {
    /// As now.
    Hold,
    /// Toward the waypoint, or the centre of a circle.
    Along,
    /// A heading, radians.
    To(f64),
    /// A turn rate, rad/s.
    Rate(f64),
}

/// Limits, from the parameters that each names.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Limits {
    /// MPC_ACC_HOR, m/s2.
    pub acc_hor: f64,
    /// MPC_JERK_AUTO, m/s3.
    pub jerk: f64,
    /// MPC_XY_TRAJ_P: share of the acceleration that a corner may use.
    pub corner_gain: f64,
    /// MPC_XY_VEL_MAX, m/s.
    pub speed_max: f64,
    /// MPC_Z_V_AUTO_UP, m/s.
    pub climb: f64,
    /// MPC_Z_V_AUTO_DN, m/s.
    pub sink: f64,
    /// MPC_ACC_UP_MAX, m/s2.
    pub acc_up: f64,
    /// MPC_ACC_DOWN_MAX, m/s2.
    pub acc_down: f64,
    /// MPC_XY_ERR_MAX, m.
    pub lead_xy: f64,
    /// MPC_Z_ERR_MAX, m.
    pub lead_z: f64,
    /// NAV_MC_ALT_RAD, m.
    pub altitude_acceptance: f64,
}

/// One leg of a flight in the local frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Leg {
    /// Start of the leg's line.
    pub from: Ned,
    /// End of the leg.
    pub target: Ned,
    /// The waypoint after that; the target itself where the flight ends there.
    pub next: Ned,
    /// Acceptance radius of the target, m.
    pub acceptance: f64,
    /// Cruise speed, m/s.
    pub speed: f64,
}

impl Leg {
    /// A straight flight to `target`, which ends there.
    pub(crate) fn to(target: Ned, acceptance: f64, speed: f64) -> Self {
        Self {
            from: target,
            target,
            next: target,
            acceptance,
            speed,
        }
    }

    fn is_single(&self) -> bool {
        (self.from - self.target).norm() < 1e-3
    }
}

/// The smoothed path: the setpoint of now.
#[derive(Debug, Clone, Default)]
pub(crate) struct Trajectory {
    /// Position, m.
    pub position: Ned,
    /// Velocity, m/s.
    pub velocity: Ned,
    /// Acceleration, m/s2.
    pub acceleration: Ned,
    corner_speed: f64,
}

impl Trajectory {
    /// Restarts at a position and velocity, with no acceleration.
    pub(crate) fn reset(&mut self, position: Ned, velocity: Ned) {
        *self = Self {
            position,
            velocity,
            acceleration: Ned::default(),
            corner_speed: velocity.horizontal(),
        };
    }

    /// Follows a leg for `dt` seconds; `vehicle` is where the vehicle really is.
    pub(crate) fn follow(&mut self, dt: f64, leg: &Leg, vehicle: Ned, limits: &Limits) {
        let desired = self.velocity_along(leg, limits);
        self.advance(dt, desired, vehicle, limits);
    }

    /// Follows a leg horizontally and descends at `sink`, m/s.
    pub(crate) fn follow_and_sink(
        &mut self,
        dt: f64,
        leg: &Leg,
        sink: f64,
        vehicle: Ned,
        limits: &Limits,
    ) {
        let desired = Ned {
            d: sink,
            ..self.velocity_along(leg, limits)
        };
        self.advance(dt, desired, vehicle, limits);
    }

    /// Moves at a velocity for `dt` seconds.
    pub(crate) fn advance(&mut self, dt: f64, desired: Ned, vehicle: Ned, limits: &Limits) {
        // PX4's time stretching: the further the setpoint is ahead of the vehicle, the slower its time runs, so that
        // a vehicle with drag is not left behind. A setpoint that moves toward the vehicle is not slowed.
        let lead = self.position - vehicle;
        let ahead = lead.n * self.velocity.n + lead.e * self.velocity.e >= 0.0;
        let ahead_z = lead.d * self.velocity.d >= 0.0;
        let stretched = |ahead: bool, lead: f64, most: f64| {
            let share = if ahead { lead / most } else { 0.0 };
            dt * (1.0 - share.clamp(0.0, 1.0))
        };
        let dt_xy = stretched(ahead, lead.horizontal(), limits.lead_xy);
        let dt_z = stretched(ahead_z, lead.d.abs(), limits.lead_z);

        let (dn, de) = (desired.n - self.velocity.n, desired.e - self.velocity.e);
        let gap = dn.hypot(de);
        let pull = pull(gap, limits.acc_hor, limits.jerk);
        let (an, ae) = if gap > 1e-9 {
            (dn / gap * pull, de / gap * pull)
        } else {
            (0.0, 0.0)
        };
        let (jn, je) = (an - self.acceleration.n, ae - self.acceleration.e);
        let turn = jn.hypot(je);
        // The jerk limit acts on the horizontal vector, not on each axis: a limit for each axis would turn the direction.
        let keep = if turn > limits.jerk * dt_xy {
            limits.jerk * dt_xy / turn
        } else {
            1.0
        };
        self.acceleration.n += jn * keep;
        self.acceleration.e += je * keep;

        let dd = desired.d - self.velocity.d;
        let acc_z = if desired.d < 0.0 {
            limits.acc_up
        } else {
            limits.acc_down
        };
        let az = dd.signum() * self::pull(dd.abs(), acc_z, limits.jerk);
        self.acceleration.d +=
            (az - self.acceleration.d).clamp(-limits.jerk * dt_z, limits.jerk * dt_z);

        self.velocity.n += self.acceleration.n * dt_xy;
        self.velocity.e += self.acceleration.e * dt_xy;
        self.velocity.d += self.acceleration.d * dt_z;
        self.position.n += self.velocity.n * dt_xy;
        self.position.e += self.velocity.e * dt_xy;
        self.position.d += self.velocity.d * dt_z;
    }

    fn velocity_along(&mut self, leg: &Leg, limits: &Limits) -> Ned {
        let turning = !leg.is_single() && self.is_turning(leg);
        // Off the line, PX4 steers to a point ahead on it and not to the waypoint itself. That point moves with the
        // vehicle, even beyond the waypoint: so a vehicle that has missed its waypoint flies away from it.
        let aim = if turning {
            self.point_ahead(leg)
        } else {
            leg.target
        };
        let mut speed = self.speed_toward(leg, limits);
        // In a turn the initial speed is kept: the distance to the target would allow more before the nose points
        // there.
        if turning {
            speed = speed.min(self.corner_speed);
        } else {
            self.corner_speed = speed;
        }
        let to_aim = aim - self.position;
        let far = to_aim.horizontal();
        let (n, e) = if far > 1e-6 {
            (to_aim.n / far * speed, to_aim.e / far * speed)
        } else {
            (0.0, 0.0)
        };
        let d = if to_aim.d.abs() > 1e-6 {
            to_aim.d.signum() * self.climb_toward(leg, limits)
        } else {
            0.0
        };
        Ned::new(n, e, d)
    }

    /// More than about ten degrees off the direction to the target, and not there yet.
    fn is_turning(&self, leg: &Leg) -> bool {
        let to_target = leg.target - self.position;
        let (speed, far) = (self.velocity.horizontal(), to_target.horizontal());
        if speed <= 0.2 || far <= leg.acceptance {
            return false;
        }
        (self.velocity.n * to_target.n + self.velocity.e * to_target.e) / (speed * far) < 0.98
    }

    /// A point of the leg's (endless) line ahead of the vehicle.
    fn point_ahead(&self, leg: &Leg) -> Ned {
        let line = leg.target - leg.from;
        let length = line.norm();
        let unit = line * (1.0 / length);
        let run = self.position - leg.from;
        let along = run.n * unit.n + run.e * unit.e + run.d * unit.d;
        let closest = leg.from + unit * along;
        let off = (closest - self.position).norm();
        let reach = leg.acceptance.max(5.0);
        let ahead = if reach > off {
            (reach * reach - off * off).sqrt()
        } else {
            0.0
        };
        closest + unit * ahead
    }

    /// Horizontal speed that the rest of the path still allows.
    fn speed_toward(&self, leg: &Leg, limits: &Limits) -> f64 {
        let onward = speed_before(leg.target, leg.next, leg.next, 0.0, leg, limits);
        speed_before(self.position, leg.target, leg.next, onward, leg, limits)
    }

    fn climb_toward(&self, leg: &Leg, limits: &Limits) -> f64 {
        let to_go = leg.target.d - self.position.d;
        let (limit, acc) = if to_go < 0.0 {
            (limits.climb, limits.acc_up)
        } else {
            (limits.sink, limits.acc_down)
        };
        let after = leg.next.d - leg.target.d;
        // Through a waypoint on the way up or down the climb rate is kept; before a level leg it is braked to zero.
        let same_way = after * to_go > 0.0 && after.abs() > limits.altitude_acceptance;
        let arrival = if same_way { limit } else { 0.0 };
        limit.min(braking_speed(limits.jerk, acc, to_go.abs(), arrival))
    }
}

/// Acceleration toward a velocity that differs by `gap`: full, then tapered as the jerk limit requires.
fn pull(gap: f64, acc: f64, jerk: f64) -> f64 {
    acc.min((2.0 * jerk * gap).sqrt()).min(6.0 * gap)
}

/// Speed at `start` toward `target`, when `next` follows and may be entered at `exit`.
fn speed_before(start: Ned, target: Ned, next: Ned, exit: f64, leg: &Leg, limits: &Limits) -> f64 {
    let onward = next - target;
    let hop = onward.horizontal();
    let mut at_target = 0.0;
    if hop > 1e-3 && hop >= leg.acceptance {
        let run = target - start;
        let (a, b) = (run.horizontal(), hop);
        // The angle between the legs as seen from the corner: pi is straight on.
        let cos = if a > 1e-9 {
            -(run.n * onward.n + run.e * onward.e) / (a * b)
        } else {
            1.0
        };
        let angle = cos.clamp(-1.0, 1.0).acos();
        at_target = corner_speed(angle, limits.corner_gain * limits.acc_hor, leg.acceptance)
            .min(exit)
            .min(leg.speed);
    }
    leg.speed.min(limits.speed_max).min(braking_speed(
        limits.jerk,
        limits.acc_hor,
        (start - target).horizontal(),
        at_target,
    ))
}

/// Speed around a corner, on a circle that touches both legs at `radius` from the corner.
fn corner_speed(angle: f64, acc: f64, radius: f64) -> f64 {
    let half = (angle / 2.0).min(std::f64::consts::FRAC_PI_2 - 1e-6);
    (acc * radius * half.tan()).sqrt()
}

/// Highest speed from which `distance` is enough to slow down to `arrival`, including the time to build up the
/// deceleration.
pub(crate) fn braking_speed(jerk: f64, acc: f64, distance: f64, arrival: f64) -> f64 {
    // Solves v*v/(2*acc) + v*2*acc/jerk = distance + arrival*arrival/(2*acc) for v.
    let b = 4.0 * acc * acc / jerk;
    let c = -2.0 * acc * distance - arrival * arrival;
    (0.5 * (-b + (b * b - 4.0 * c).sqrt())).max(arrival)
}

#[cfg(test)]
mod tests {
    use super::*;

    pub(crate) const SITL: Limits = Limits {
        acc_hor: 3.0,
        jerk: 4.0,
        corner_gain: 0.5,
        speed_max: 12.0,
        climb: 3.0,
        sink: 1.5,
        acc_up: 4.0,
        acc_down: 3.0,
        lead_xy: 2.0,
        lead_z: 1.0,
        altitude_acceptance: 0.8,
    };

    #[test]
    fn braking_speeds_are_those_of_short_chords() {
        for (chord, speed) in [(5.0, 2.6), (11.3, 4.9), (20.0, 7.3), (31.7, 10.0)] {
            let v = braking_speed(4.0, 3.0, chord, 0.0);
            assert!((v - speed).abs() < 0.1, "{chord} m: {v}");
        }
    }

    #[test]
    fn it_stops_at_its_target_within_every_limit() {
        let mut t = Trajectory::default();
        let leg = Leg::to(Ned::new(80.0, 60.0, -20.0), 10.0, 5.0);
        for _ in 0..250 * 60 {
            let before = t.acceleration;
            t.follow(0.004, &leg, t.position, &SITL);
            assert!(t.velocity.horizontal() < 5.01);
            assert!(t.acceleration.horizontal() < 3.01);
            let jerk = (t.acceleration - before).horizontal() / 0.004;
            assert!(jerk < 4.01, "{jerk}");
        }
        assert!((t.position - leg.target).norm() < 0.1, "{:?}", t.position);
    }

    #[test]
    fn a_missed_waypoint_is_never_turned_back_to() {
        let mut t = Trajectory::default();
        // Past the target, off its line by more than the radius: it continues along the line.
        t.reset(Ned::new(12.0, 1.5, -10.0), Ned::new(5.0, 0.0, 0.0));
        let leg = Leg {
            from: Ned::new(-100.0, 0.0, -10.0),
            target: Ned::new(10.0, 0.0, -10.0),
            next: Ned::new(120.0, 0.0, -10.0),
            acceptance: 1.0,
            speed: 5.0,
        };
        for _ in 0..250 * 60 {
            t.follow(0.004, &leg, t.position, &SITL);
        }
        assert!(t.position.n > 100.0, "{:?}", t.position);
    }
}
