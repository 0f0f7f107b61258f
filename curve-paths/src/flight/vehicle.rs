//! What flies, and its limits: the formulas of its speed limits, and how it flies the corners of its route.

use thiserror::Error;

use super::npfg::{NorthEast, Npfg, dot, norm, unit};

/// Standard gravity, m/s^2.
pub(super) const G: f64 = 9.806_65;

/// A vehicle by the way that it turns.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Airframe {
    /// Turns by banking.
    FixedWing(FixedWing),
    /// Turns by tilting its thrust.
    Multicopter(Multicopter),
}

/// A fixed-wing aircraft in coordinated turns.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FixedWing {
    /// Greatest bank, rad (PX4: FW_R_LIM).
    pub bank_rad: f64,
    /// Slowest speed that it flies, m/s (PX4: FW_AIRSPD_MIN).
    pub slowest_mps: f64,
    /// Its guidance law.
    pub npfg: Npfg,
    /// Least distance before a waypoint at which it counts as reached, m (PX4: NAV_ACC_RAD; a waypoint's own radius
    /// has no effect on wings).
    pub acceptance_m: f64,
    /// Time constant of the bank behind its command, s (PX4: NPFG_ROLL_TC, which PX4 uses in its own guidance).
    pub roll_s: f64,
    /// The wind in which its flights are predicted, from any direction, m/s.
    pub wind_mps: f64,
}

/// A multicopter under PX4's own smoothing.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Multicopter {
    /// Greatest horizontal acceleration, m/s^2 (PX4: MPC_ACC_HOR).
    pub acceleration: f64,
    /// Greatest jerk, m/s^3 (PX4: MPC_JERK_AUTO).
    pub jerk: f64,
    /// Climb, m/s (PX4: MPC_Z_V_AUTO_UP).
    pub climb_mps: f64,
    /// Descent, m/s (PX4: MPC_Z_V_AUTO_DN).
    pub descent_mps: f64,
    /// Part of the acceleration that is used in a corner (PX4: MPC_XY_TRAJ_P).
    pub corner_gain: f64,
}

impl Default for FixedWing {
    /// PX4's defaults: 50 degrees of bank, 10 m/s at the slowest, an acceptance of 10 m; a wind of 5 m/s.
    fn default() -> Self {
        Self {
            bank_rad: 50f64.to_radians(),
            slowest_mps: 10.0,
            npfg: Npfg::default(),
            acceptance_m: 10.0,
            roll_s: 0.5,
            wind_mps: 5.0,
        }
    }
}

impl Default for Multicopter {
    /// PX4's defaults: 3 m/s^2, 4 m/s^3, 3 m/s up, 1.5 m/s down, half the acceleration in corners.
    fn default() -> Self {
        Self {
            acceleration: 3.0,
            jerk: 4.0,
            climb_mps: 3.0,
            descent_mps: 1.5,
            corner_gain: 0.5,
        }
    }
}

/// A parameter of the vehicle that is not accepted.
#[derive(Clone, Debug, Error, PartialEq)]
pub enum ParameterError {
    /// No formula here uses it.
    #[error("{0} is unknown, expected one of {known}", known = Airframe::NAMES.join(", "))]
    Unknown(String),
    /// It is out of range.
    #[error("{name} is {value}, expected more than {above} and at most {most}")]
    Range {
        /// Its name.
        name: String,
        /// Its value.
        value: f64,
        /// It must be greater than this.
        above: f64,
        /// It may be at most this.
        most: f64,
    },
}

impl Airframe {
    /// The names that [`set`](Self::set) accepts: parameters of PX4, in its units, and `wind_m_s`, the wind for which
    /// wings are predicted.
    pub const NAMES: [&'static str; 13] = [
        "FW_AIRSPD_MIN",
        "FW_R_LIM",
        "MPC_ACC_HOR",
        "MPC_JERK_AUTO",
        "MPC_XY_TRAJ_P",
        "MPC_Z_V_AUTO_DN",
        "MPC_Z_V_AUTO_UP",
        "NAV_ACC_RAD",
        "NPFG_DAMPING",
        "NPFG_PERIOD",
        "NPFG_ROLL_TC",
        "NPFG_SW_DST_MLT",
        "wind_m_s",
    ];

    /// Sets a value of the vehicle; a parameter of the other airframe is checked, and changes nothing.
    ///
    /// # Errors
    /// The name is unknown, or the value out of range.
    pub fn set(&mut self, name: &str, value: f64) -> Result<(), ParameterError> {
        if !Self::NAMES.contains(&name) {
            return Err(ParameterError::Unknown(name.to_owned()));
        }
        let (above, most) = match name {
            "FW_R_LIM" => (0.0, 84.0),
            "NPFG_DAMPING" | "NPFG_SW_DST_MLT" | "MPC_XY_TRAJ_P" => (0.0, 1.0),
            // 0 m/s is allowed: the lower limit is exclusive.
            "wind_m_s" => (-f64::MIN_POSITIVE, 30.0),
            _ => (0.0, 1_000.0),
        };
        if !(value > above && value <= most) {
            return Err(ParameterError::Range {
                name: name.to_owned(),
                value,
                above: above.max(0.0),
                most,
            });
        }
        match self {
            Self::FixedWing(wing) => wing.take(name, value),
            Self::Multicopter(copter) => copter.take(name, value),
        }
        Ok(())
    }
}

impl FixedWing {
    fn take(&mut self, name: &str, value: f64) {
        match name {
            "FW_AIRSPD_MIN" => self.slowest_mps = value,
            "FW_R_LIM" => self.bank_rad = value.to_radians(),
            "NAV_ACC_RAD" => self.acceptance_m = value,
            "NPFG_DAMPING" => self.npfg.damping = value,
            "NPFG_PERIOD" => self.npfg.period_s = value,
            "NPFG_ROLL_TC" => self.roll_s = value,
            "NPFG_SW_DST_MLT" => self.npfg.switch_multiplier = value,
            "wind_m_s" => self.wind_mps = value,
            _ => {}
        }
    }

    /// The tightest radius at a speed, m: R = V^2 / (g tan bank).
    #[must_use]
    pub fn radius_m(&self, speed_mps: f64) -> f64 {
        speed_mps * speed_mps / (G * self.bank_rad.tan())
    }

    /// The fastest speed on a radius, m/s.
    #[must_use]
    pub fn fastest_mps(&self, radius_m: f64) -> f64 {
        (radius_m * G * self.bank_rad.tan()).sqrt()
    }

    /// How far before a waypoint it counts as reached, at a speed over ground, m.
    #[must_use]
    pub fn switch_m(&self, ground_mps: f64) -> f64 {
        self.acceptance_m.max(self.npfg.switch_m(ground_mps))
    }
}

impl Multicopter {
    fn take(&mut self, name: &str, value: f64) {
        match name {
            "MPC_ACC_HOR" => self.acceleration = value,
            "MPC_JERK_AUTO" => self.jerk = value,
            "MPC_XY_TRAJ_P" => self.corner_gain = value,
            "MPC_Z_V_AUTO_DN" => self.descent_mps = value,
            "MPC_Z_V_AUTO_UP" => self.climb_mps = value,
            _ => {}
        }
    }

    /// The fastest speed, m/s, at which a turn keeps the lateral acceleration V^2 / R and the lateral jerk
    /// V^3 |d(1/R)/ds| within the limits.
    #[must_use]
    pub fn fastest_mps(&self, radius_m: f64, curvature_rate: f64) -> f64 {
        let by_jerk = if curvature_rate > 0.0 {
            (self.jerk / curvature_rate).cbrt()
        } else {
            f64::INFINITY
        };
        (self.acceleration * radius_m).sqrt().min(by_jerk)
    }

    /// The speed, m/s, to which PX4 limits itself on a chord: v = (-b + sqrt(b^2 + 8 a c)) / 2, b = 4 a^2 / j. That
    /// is `math::trajectory::computeMaxSpeedFromDistance` of PX4 with a final speed of 0.
    #[must_use]
    pub fn on_chord_mps(&self, chord_m: f64) -> f64 {
        let b = 4.0 * self.acceleration * self.acceleration / self.jerk;
        0.5 * (-b + (b * b + 8.0 * self.acceleration * chord_m).sqrt())
    }

    /// How far the vehicle is above or below a chord that rises by `rise_m` within `time_s`, m.
    ///
    /// PX4 climbs to each item's altitude at once and not along the chord. Where the next item is at another
    /// altitude, it overshoots its own by the distance of a stop from full climb (measured in flight: 4 m above, 1 m
    /// below).
    #[must_use]
    pub fn lead_m(&self, rise_m: f64, time_s: f64) -> f64 {
        if rise_m.abs() <= LEVEL_M {
            return 0.0;
        }
        let rate = if rise_m > 0.0 {
            self.climb_mps
        } else {
            self.descent_mps
        };
        let climb_s = rise_m.abs() / rate;
        let share = climb_s.min(time_s) / climb_s.max(time_s).max(1e-9);
        rise_m.abs() * (1.0 - share) + self.climb_mps * (1.0 + self.climb_mps / 8.0)
    }

    /// How far it is off a straight leg at a speed, m: the error of its position estimate, and the lag of its
    /// controller.
    #[must_use]
    pub fn straight_m(&self, speed_mps: f64) -> f64 {
        ESTIMATE_M + LAG_S * speed_mps
    }

    /// How far it is off both legs of a corner that is flown at a speed and with an acceptance radius, m.
    ///
    /// PX4 slows down to the speed that turns within the radius, starts to turn on entering it, and then needs a time
    /// that its jerk limits: it cuts the corner, overshoots the next leg, or both.
    #[must_use]
    pub fn corner_m(&self, legs: [NorthEast; 2], speed_mps: f64, acceptance_m: f64) -> f64 {
        let [before, after] = legs;
        let turn = dot(unit(before), unit(after)).clamp(-1.0, 1.0).acos();
        let by_radius = (self.corner_gain * self.acceleration * acceptance_m
            / (0.5 * turn).tan().max(1e-9))
        .sqrt();
        let at_corner = speed_mps.min(by_radius).min(self.on_chord_mps(norm(after)));
        // Beyond a right angle all of the speed is across the next leg.
        let across = at_corner * turn.min(std::f64::consts::FRAC_PI_2).sin();
        let least = self.acceleration * self.acceleration / self.jerk;
        let carried_m = if across <= least {
            across * (across / self.jerk).sqrt()
        } else {
            0.5 * across * (across / self.acceleration + self.acceleration / self.jerk)
        };
        let over_m = carried_m - acceptance_m * turn.sin().max(0.0);
        let cut_m = acceptance_m * (0.5 * turn).sin();
        over_m.max(cut_m) + self.straight_m(speed_mps)
    }
}

/// Error of the estimated position, m, as px4-sim and PX4's SIH have it.
const ESTIMATE_M: f64 = 0.35;
/// Lag of the position controller, s.
const LAG_S: f64 = 0.12;
/// PX4 takes items this close for level, m.
pub(super) const LEVEL_M: f64 = 1e-3;

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn chords_slow_px4_as_flown() {
        let m = Multicopter::default();
        for (chord_m, speed) in [(5.0, 2.6), (11.3, 4.9), (20.0, 7.3), (31.7, 10.0)] {
            assert!(
                (m.on_chord_mps(chord_m) - speed).abs() < 0.06,
                "{chord_m}: {}",
                m.on_chord_mps(chord_m)
            );
        }
    }

    #[test]
    fn the_speedway_allows_9_to_10_metres_a_second_at_30_degrees_of_bank() {
        let f = FixedWing {
            bank_rad: 30f64.to_radians(),
            ..FixedWing::default()
        };
        assert!(
            (9.0..9.5).contains(&f.fastest_mps(15.0)) && (9.9..10.2).contains(&f.fastest_mps(18.0))
        );
        assert!((f.radius_m(f.fastest_mps(80.0)) - 80.0).abs() < 1e-9);
    }
}
