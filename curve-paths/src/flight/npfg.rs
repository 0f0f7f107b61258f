//! How PX4 v1.18 steers wings along a line: its guidance law (NPFG), and how early it switches to the next waypoint.
//!
//! PX4's fw_mode_manager gives each leg of a mission to NPFG as a straight line without curvature, so that a curve of chords
//! gets no feed-forward: it is flown as a row of corners, each taken a switch distance early. Two-dimensional vectors are
//! north and east.

use std::f64::consts::{FRAC_PI_2, PI};

/// A place, m, or a velocity, m/s: north, east.
pub type NorthEast = [f64; 2];

/// The parameters of the law.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Npfg {
    /// Period, s (PX4: NPFG_PERIOD).
    pub period_s: f64,
    /// Damping ratio (PX4: NPFG_DAMPING).
    pub damping: f64,
    /// Part of the track error boundary at which a waypoint counts as reached (PX4: NPFG_SW_DST_MLT).
    pub switch_multiplier: f64,
}

impl Default for Npfg {
    /// PX4's defaults: 10 s, 0.7, 0.32.
    fn default() -> Self {
        Self {
            period_s: 10.0,
            damping: 0.7,
            switch_multiplier: 0.32,
        }
    }
}

impl Npfg {
    /// How far before a waypoint PX4 switches to the next, m; the vehicle's acceptance radius counts where it is
    /// larger.
    #[must_use]
    pub fn switch_m(&self, ground_mps: f64) -> f64 {
        self.switch_multiplier * self.boundary_m(ground_mps)
    }

    /// Beyond this distance from its line a vehicle flies straight to the line, m.
    fn boundary_m(&self, ground_mps: f64) -> f64 {
        let time_s = self.period_s * self.damping;
        if ground_mps > 1.0 {
            ground_mps * time_s
        } else {
            0.5 * time_s * (ground_mps * ground_mps + 1.0)
        }
    }

    /// The course over ground to fly, rad clockwise from north: along the leg, and back to it.
    ///
    /// As PX4's `navigateWaypoints`: before the start of the leg the start is flown to, beyond its end the end,
    /// unless either is within the switch distance.
    #[must_use]
    pub fn course(&self, at: NorthEast, from: NorthEast, to: NorthEast, ground_mps: f64) -> f64 {
        let [leg, run, past] = [minus(to, from), minus(at, from), minus(at, to)];
        let before = dot(leg, run) < 0.0 && norm(run) > self.switch_m(ground_mps);
        let direct = if before {
            Some(from)
        } else if norm(leg) < f64::EPSILON || dot(leg, past) > 0.0 {
            Some(to)
        } else {
            None
        };
        if let Some(place) = direct {
            return bearing(minus(place, at));
        }
        let tangent = unit(leg);
        let error_m = cross(tangent, run);
        let share = (error_m.abs() / self.boundary_m(ground_mps)).min(1.0);
        let ahead = FRAC_PI_2 * (share - 1.0) * (share - 1.0);
        // Right of the line the way back is to the left.
        let back = if error_m < 0.0 { 1.0 } else { -1.0 };
        let normal = [-tangent[1], tangent[0]];
        bearing([
            ahead.cos() * back * normal[0] + ahead.sin() * tangent[0],
            ahead.cos() * back * normal[1] + ahead.sin() * tangent[1],
        ])
    }

    /// The lateral acceleration, m/s^2 to the right, that turns a vehicle flying through the air by `air` to a course over
    /// ground in a wind.
    #[must_use]
    pub fn acceleration(&self, course_rad: f64, air: NorthEast, wind: NorthEast) -> f64 {
        let airspeed = norm(air);
        let bearing = [course_rad.cos(), course_rad.sin()];
        let across = cross(wind, bearing);
        let along = (airspeed * airspeed - across * across).max(0.0).sqrt();
        let wanted = unit([
            along * bearing[0] - across * bearing[1],
            across * bearing[0] + along * bearing[1],
        ]);
        let gain = 4.0 * PI * self.damping / self.period_s;
        let turn = cross(air, wanted);
        if dot(air, wanted) < 0.0 {
            gain * airspeed.copysign(turn)
        } else {
            gain * turn
        }
    }
}

pub(super) fn minus(a: NorthEast, b: NorthEast) -> NorthEast {
    [a[0] - b[0], a[1] - b[1]]
}

pub(super) fn plus(a: NorthEast, b: NorthEast, times: f64) -> NorthEast {
    [a[0] + times * b[0], a[1] + times * b[1]]
}

pub(super) fn dot(a: NorthEast, b: NorthEast) -> f64 {
    a[0] * b[0] + a[1] * b[1]
}

/// Positive where the second lies clockwise of the first.
fn cross(a: NorthEast, b: NorthEast) -> f64 {
    a[0] * b[1] - a[1] * b[0]
}

pub(super) fn norm(a: NorthEast) -> f64 {
    a[0].hypot(a[1])
}

pub(super) fn unit(a: NorthEast) -> NorthEast {
    let length = norm(a).max(f64::MIN_POSITIVE);
    [a[0] / length, a[1] / length]
}

fn bearing(a: NorthEast) -> f64 {
    a[1].atan2(a[0])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_next_waypoint_is_taken_2_24_seconds_early_with_px4_s_defaults() {
        let npfg = Npfg::default();
        assert!((npfg.switch_m(15.0) - 33.6).abs() < 1e-9);
        assert!((npfg.switch_m(20.0) - 44.8).abs() < 1e-9);
    }

    #[test]
    fn a_vehicle_on_its_line_flies_along_it_and_one_beside_it_returns() {
        let npfg = Npfg::default();
        let course = |at| npfg.course(at, [0.0, 0.0], [500.0, 0.0], 15.0);
        assert!(course([100.0, 0.0]).abs() < 1e-9);
        // To the right of a line that leads north: back to the left, and straight to it from far away.
        assert!((-1.0..0.0).contains(&course([100.0, 20.0])));
        assert!((course([100.0, 300.0]) + FRAC_PI_2).abs() < 1e-9);
        assert!((course([100.0, -300.0]) - FRAC_PI_2).abs() < 1e-9);
        // Beyond the end it returns to the end.
        assert!((course([600.0, 0.0]).abs() - PI).abs() < 1e-9);
    }

    #[test]
    fn a_cross_wind_is_flown_into() {
        let npfg = Npfg::default();
        // Wind from the west, course north: the nose points left of the course, and no turn is commanded then.
        let wind = [0.0, 5.0];
        assert!(npfg.acceleration(0.0, [15.0, 0.0], wind) < -1.0);
        let settled = [(225.0f64 - 25.0).sqrt(), -5.0];
        assert!(npfg.acceleration(0.0, settled, wind).abs() < 1e-9);
    }
}
