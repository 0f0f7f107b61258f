//! A fixed wing: it flies at an airspeed, turns by banking, drifts with the wind, and never stops before it has
//! landed.

use curve_paths::flight::Npfg;

use crate::physics::motion::{GRAVITY, Motion, Ned};
use crate::physics::noise::{Drift, Noise};
use crate::physics::trajectory::{Circle, Guidance, Leg, Trajectory};

/// What the guidance uses of the parameters.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct PlaneTuning {
    /// FW_AIRSPD_MIN, m/s.
    pub airspeed_min: f64,
    /// FW_AIRSPD_MAX, m/s.
    pub airspeed_max: f64,
    /// FW_R_LIM, radians.
    pub bank_max: f64,
    /// FW_T_CLMB_R_SP, m/s.
    pub climb: f64,
    /// FW_T_SINK_R_SP, m/s.
    pub sink: f64,
    /// NPFG_PERIOD, NPFG_DAMPING and NPFG_SW_DST_MLT.
    pub npfg: Npfg,
}

/// The airframe's state.
#[derive(Debug, Clone)]
pub(crate) struct Plane {
    /// The true motion.
    pub motion: Motion,
    /// The setpoint of its trajectory.
    pub target: Trajectory,
    /// Airspeed, m/s.
    pub airspeed: f64,
    climb: f64,
    bank: f64,
    wind: [f64; 2],
    turbulence: Drift,
    noise: Noise,
    /// Throttle, 0 to 1.
    pub throttle: f64,
}

/// The request of the guidance law.
struct Demand {
    course: f64,
    climb: f64,
    airspeed: f64,
}

impl Plane {
    /// On the ground at the origin.
    pub(crate) fn new(heading: f64, wind: [f64; 2], seed: u64) -> Self {
        Self {
            motion: Motion {
                attitude: [0.0, 0.0, heading],
                ..Motion::default()
            },
            target: Trajectory::default(),
            airspeed: 0.0,
            climb: 0.0,
            bank: 0.0,
            wind,
            turbulence: Drift::new(0.01, 0.7),
            noise: Noise::new(seed ^ 0xF1A9),
            throttle: 0.0,
        }
    }

    /// Continues the motion of another airframe.
    pub(crate) fn take_over(&mut self, motion: Motion, airspeed: f64) {
        self.motion = motion;
        self.airspeed = airspeed;
        self.climb = 0.0;
        self.bank = 0.0;
        self.target.position = motion.position;
    }

    /// Flies straight and level, changing speed by `push` m/s2; true once the airspeed has reached `until`.
    pub(crate) fn glide_level(&mut self, dt: f64, push: f64, until: f64) -> bool {
        let demand = Demand {
            course: self.motion.attitude[2],
            climb: 0.0,
            airspeed: self.airspeed,
        };
        let wide = PlaneTuning {
            airspeed_min: 0.0,
            airspeed_max: f64::MAX,
            bank_max: 0.1,
            climb: 0.0,
            sink: 0.0,
            npfg: Npfg::default(),
        };
        self.fly(dt, &demand, &wide);
        self.airspeed = (self.airspeed + push * dt).max(0.0);
        if push > 0.0 {
            self.airspeed >= until
        } else {
            self.airspeed <= until
        }
    }

    /// One step; `error` is the estimator's position error.
    pub(crate) fn step(&mut self, dt: f64, guidance: &Guidance, error: Ned, tuning: &PlaneTuning) {
        let believed = self.motion.position + error;
        let on_ground = self.motion.position.d >= 0.0;
        let demand = match guidance {
            Guidance::Ground => None,
            Guidance::Leg(leg) => Some(self.along(leg, believed, tuning)),
            Guidance::Climb(leg) => Some(Demand {
                course: self.motion.attitude[2],
                climb: self.climb_to(leg.target.d, believed, tuning),
                airspeed: leg.speed,
            }),
            Guidance::Land(leg) => Some(self.glide_down(leg, believed, tuning)),
            Guidance::Circle(circle) => Some(Demand {
                course: round(circle, believed),
                climb: self.climb_to(circle.centre.d, believed, tuning),
                airspeed: circle.speed,
            }),
            // Steering by sticks or setpoints is not simulated on wings: it flies straight and level.
            Guidance::Steer { .. } | Guidance::Track { .. } => Some(Demand {
                course: self.course(),
                climb: 0.0,
                airspeed: self.airspeed,
            }),
        };
        match demand {
            Some(demand) if !(on_ground && matches!(guidance, Guidance::Land(_))) => {
                self.fly(dt, &demand, tuning)
            }
            _ => self.roll_out(dt),
        }
    }

    /// Along a leg by PX4's own guidance law, so that a curve is flown with its lag.
    fn along(&mut self, leg: &Leg, believed: Ned, tuning: &PlaneTuning) -> Demand {
        self.target.position = leg.target;
        let flat = |at: Ned| [at.n, at.e];
        let ground = self.motion.velocity.horizontal();
        let [at, from, to] = [believed, leg.from, leg.target].map(flat);
        let course = tuning.npfg.course(at, from, to, ground);
        Demand {
            course,
            climb: self.climb_to(leg.target.d, believed, tuning),
            airspeed: leg.speed,
        }
    }

    /// Along the leg down to its end, and straight on until the ground; a leg without a beginning is landed on
    /// straight ahead at once.
    fn glide_down(&mut self, leg: &Leg, believed: Ned, tuning: &PlaneTuning) -> Demand {
        let airspeed = leg.speed.min(tuning.airspeed_min * 1.2);
        let flare = -tuning.sink.min(0.4 + 0.15 * -self.motion.position.d);
        let line = leg.target - leg.from;
        let length = line.horizontal();
        let along = (line.n * (leg.target.n - believed.n) + line.e * (leg.target.e - believed.e))
            / length.max(1.0);
        if length < 1.0 || along <= 0.0 {
            return Demand {
                course: self.course(),
                climb: flare,
                airspeed,
            };
        }
        let course = self.along(leg, believed, tuning).course;
        // The glide slope, and the way back to it.
        let slope_d = leg.target.d - (leg.target.d - leg.from.d) * (along / length).min(1.0);
        let sinks = self.motion.velocity.horizontal() * line.d / length;
        let climb = -sinks + 0.4 * (believed.d - slope_d);
        Demand {
            course,
            climb: climb.clamp(-2.0 * tuning.sink, tuning.climb).max(
                // The flare.
                if self.motion.position.d > -4.0 {
                    flare
                } else {
                    f64::NEG_INFINITY
                },
            ),
            airspeed,
        }
    }

    fn climb_to(&self, d: f64, believed: Ned, tuning: &PlaneTuning) -> f64 {
        (0.4 * (believed.d - d)).clamp(-tuning.sink, tuning.climb)
    }

    fn course(&self) -> f64 {
        let v = self.motion.velocity;
        if v.horizontal() > 1.0 {
            v.bearing()
        } else {
            self.motion.attitude[2]
        }
    }

    fn fly(&mut self, dt: f64, demand: &Demand, tuning: &PlaneTuning) {
        let airspeed = demand
            .airspeed
            .clamp(tuning.airspeed_min, tuning.airspeed_max);
        let airborne = self.motion.position.d < 0.0;
        // Thrust gives about 3 m/s2; the nose rises only at flying speed.
        let push = (airspeed - self.airspeed).clamp(-1.5, 3.0);
        self.airspeed = (self.airspeed + push * dt).max(0.0);
        let flying = self.airspeed >= tuning.airspeed_min;
        let climb = if flying || airborne {
            demand.climb
        } else {
            0.0
        };
        self.climb += (climb - self.climb).clamp(-1.5 * dt, 1.5 * dt);

        let heading = self.motion.attitude[2];
        let speed = self.airspeed.max(5.0);
        let air = [speed * heading.cos(), speed * heading.sin()];
        let bank = if airborne {
            let turn = tuning.npfg.acceleration(demand.course, air, self.wind);
            (turn / GRAVITY).atan()
        } else {
            0.0
        };
        let bank = bank.clamp(-tuning.bank_max, tuning.bank_max)
            + self.turbulence.step(dt, &mut self.noise);
        let roll_rate = 60f64.to_radians();
        self.bank += (2.5 * (bank - self.bank) * dt).clamp(-roll_rate * dt, roll_rate * dt);

        // A coordinated turn: bank and airspeed decide how fast the heading changes.
        let heading_rate = GRAVITY * self.bank.tan() / self.airspeed.max(5.0);
        let heading = self.motion.attitude[2] + heading_rate * dt;
        let pitch = (self.climb / self.airspeed.max(5.0))
            .clamp(-0.6, 0.6)
            .asin()
            + 0.03;
        // Wheels on the ground do not drift with the wind.
        let wind = if airborne { self.wind } else { [0.0; 2] };
        let level = (self.airspeed * self.airspeed - self.climb * self.climb)
            .max(0.0)
            .sqrt();
        let velocity = Ned::new(
            level * heading.cos() + wind[0],
            level * heading.sin() + wind[1],
            -self.climb,
        );
        self.motion.acceleration = (velocity - self.motion.velocity) * (1.0 / dt);
        self.motion.velocity = velocity;
        self.motion.position = self.motion.position + velocity * dt;
        self.throttle = (0.35 + 0.1 * push + 0.12 * self.climb).clamp(0.05, 1.0);
        self.touch();
        self.target.velocity = velocity;
        self.motion.turn_to([self.bank, pitch, heading], dt);
    }

    /// Brakes on its wheels; glides down where the motor was stopped in the air.
    fn roll_out(&mut self, dt: f64) {
        self.throttle = 0.0;
        self.bank -= self.bank * dt;
        let yaw = self.motion.attitude[2];
        if self.motion.position.d < 0.0 {
            self.climb += (-3.0 - self.climb) * dt;
            self.airspeed += (8.0 - self.airspeed) * 0.2 * dt;
        } else {
            self.climb = 0.0;
            self.airspeed = (self.airspeed - 4.0 * dt).max(0.0);
        }
        let velocity = Ned::new(
            self.airspeed * yaw.cos(),
            self.airspeed * yaw.sin(),
            -self.climb,
        );
        self.motion.acceleration = Ned::default();
        self.motion.velocity = velocity;
        self.motion.position = self.motion.position + velocity * dt;
        self.touch();
        self.motion.turn_to([self.bank, 0.0, yaw], dt);
    }

    fn touch(&mut self) {
        if self.motion.position.d > 0.0 {
            self.motion.position.d = 0.0;
            self.motion.velocity.d = 0.0;
            self.climb = self.climb.max(0.0);
        }
    }
}

/// The course around a circle: along its tangent, corrected inward or outward by the distance from it.
fn round(circle: &Circle, at: Ned) -> f64 {
    let out = at - circle.centre;
    let r = circle.radius.abs().max(10.0);
    let side = if circle.radius < 0.0 { -1.0 } else { 1.0 };
    let off = ((out.horizontal() - r) / (0.5 * r)).atan();
    out.bearing() + side * (std::f64::consts::FRAC_PI_2 + off)
}
