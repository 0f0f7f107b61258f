//! What flies, and what it can do: the formulas of its speed limits.

/// Standard gravity, m/s^2.
const G: f64 = 9.806_65;

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
}

impl Default for FixedWing {
    /// 30 degrees of bank, 10 m/s at the slowest.
    fn default() -> Self {
        Self {
            bank_rad: 30f64.to_radians(),
            slowest_mps: 10.0,
        }
    }
}

impl Default for Multicopter {
    /// PX4's defaults: 3 m/s^2, 4 m/s^3, 3 m/s up, 1.5 m/s down.
    fn default() -> Self {
        Self {
            acceleration: 3.0,
            jerk: 4.0,
            climb_mps: 3.0,
            descent_mps: 1.5,
        }
    }
}

impl FixedWing {
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
}

impl Multicopter {
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

    /// The speed, m/s, that PX4 holds itself to on a chord: v = (-b + sqrt(b^2 + 8 a c)) / 2, b = 4 a^2 / j.
    #[must_use]
    pub fn on_chord_mps(&self, chord_m: f64) -> f64 {
        let b = 4.0 * self.acceleration * self.acceleration / self.jerk;
        0.5 * (-b + (b * b + 8.0 * self.acceleration * chord_m).sqrt())
    }

    /// How far it is above or below a chord that rises by `rise_m` while `time_s` goes by, m.
    ///
    /// PX4 climbs to each item's altitude at once and not along the chord; and where the next item is at another
    /// altitude, it swings about its own by what a stop from full climb takes (seen in flight: 4 m above, 1 m below).
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

    /// What flying adds to the planned deviation at a speed, m: 0.8 m at 5 m/s and 1.4 m at 10 m/s as measured, in
    /// proportion below, and on the same line above.
    #[must_use]
    pub fn added_deviation_m(&self, speed_mps: f64) -> f64 {
        if speed_mps <= 5.0 {
            0.16 * speed_mps
        } else {
            0.8 + 0.12 * (speed_mps - 5.0)
        }
    }
}

/// PX4 takes items this close for level, m.
const LEVEL_M: f64 = 1e-3;

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
        let f = FixedWing::default();
        assert!(
            (9.0..9.5).contains(&f.fastest_mps(15.0)) && (9.9..10.2).contains(&f.fastest_mps(18.0))
        );
        assert!((f.radius_m(f.fastest_mps(80.0)) - 80.0).abs() < 1e-9);
    }
}
