//! How high, far and fast a vehicle can be commanded to fly: by the configuration, by its own parameters, and by PX4's
//! defaults for those it has not reported.
//!
//! The configuration phase reports the same bounds (41003), and a 2016, a 13002 or a 13003 beyond them is refused.

use geo::{Destination, Distance, Haversine, Point};

use crate::altitude::Level;
use crate::parameter::Parameters;

/// What a route must stay within.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Limits {
    /// Farthest first waypoint from home, m.
    pub first_m: f64,
    /// Longest leg, m.
    pub leg_m: f64,
    /// Lowest waypoint, m above home; a negative one applies only with `below_home`.
    pub lowest_m: f64,
    /// Whether anything may be flown below home.
    pub below_home: bool,
    /// Highest waypoint, m above home.
    pub highest_m: f64,
    /// Lowest place of a route, m above the terrain where that is known; negative: below it.
    pub above_terrain_m: f64,
    /// Fastest commanded speed, m/s; the vehicle's own limit applies if it is lower ([`Performance`]).
    pub speed_m_s: f64,
    /// Lowest transition of a VTOL, m above home.
    pub transition_m: f64,
    /// Most mission items.
    pub items: usize,
}

impl Default for Limits {
    fn default() -> Self {
        Limits {
            first_m: 5_000.0,
            leg_m: 50_000.0,
            lowest_m: -500.0,
            below_home: false,
            highest_m: 5_000.0,
            above_terrain_m: 0.0,
            speed_m_s: 100.0,
            transition_m: 20.0,
            items: 500,
        }
    }
}

impl Limits {
    /// The vehicle's parameters that narrow them.
    pub const NAMES: [&str; 1] = ["GF_MAX_VER_DIST"];

    /// These limits, narrowed by the fence that the vehicle itself keeps (GF_MAX_VER_DIST): PX4 refuses a plan above it,
    /// and runs the fence's action if a command leads there. Both the declaration (41000) and the checks of commands and
    /// loads use the result.
    #[must_use]
    pub fn of(self, parameters: &Parameters) -> Self {
        let [vertical] = Self::NAMES;
        let fence_m = parameters.above_zero(vertical);
        Limits {
            highest_m: fence_m.map_or(self.highest_m, |fence_m| fence_m.min(self.highest_m)),
            ..self
        }
    }

    /// The lowest height that may be flown, m above home.
    #[must_use]
    pub fn floor_m(&self) -> f64 {
        if self.below_home {
            self.lowest_m
        } else {
            self.lowest_m.max(0.0)
        }
    }

    /// Checks that a level may be flown. Every altitude that is sent to the vehicle passes this check, whatever its
    /// commanded type.
    ///
    /// # Errors
    /// It is below home and that is not allowed, or it is beyond the limits.
    pub fn check_height(&self, level: Level, home_amsl_m: f64) -> Result<(), HeightError> {
        let height_m = level.above_home(home_amsl_m);
        // Home is where the vehicle was on the ground, so its altitude is the ground's. A NaN is refused here too.
        let clear = height_m > 0.0 || self.below_home;
        if !clear {
            return Err(HeightError::BelowHome {
                height_m,
                home_amsl_m,
            });
        }
        if (self.floor_m()..=self.highest_m).contains(&height_m) {
            return Ok(());
        }
        Err(HeightError::Beyond {
            height_m,
            lowest_m: self.floor_m(),
            highest_m: self.highest_m,
        })
    }
}

/// An altitude that may not be flown.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
pub enum HeightError {
    /// At home's altitude or below it, and `vehicle.limits.below_home` does not allow that.
    #[error(
        "{:.1} m AMSL is {:.1} m below home ({home_amsl_m:.1} m AMSL): raise it above home, or allow it by \
         vehicle.limits.below_home = true",
        home_amsl_m + height_m,
        0.0 - height_m
    )]
    BelowHome {
        /// Metres above home, 0 or less.
        height_m: f64,
        /// Home's altitude, m above mean sea level.
        home_amsl_m: f64,
    },
    /// Too low or too high.
    #[error(
        "{height_m:.0} m above home, expected {lowest_m:.0} to {highest_m:.0} (vehicle.limits)"
    )]
    Beyond {
        /// Metres above home.
        height_m: f64,
        /// Lowest allowed.
        lowest_m: f64,
        /// Highest allowed.
        highest_m: f64,
    },
}

/// The vehicle's performance, and its defaults.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Performance {
    /// The slowest speed that can be commanded, m/s: FW_AIRSPD_MIN; for a multicopter one step of the field.
    pub slowest_m_s: f64,
    /// The fastest, m/s: MPC_XY_VEL_MAX or FW_AIRSPD_MAX, at most `vehicle.limits.speed_m_s`.
    pub fastest_m_s: f64,
    /// The speed before any is commanded, m/s: MPC_XY_CRUISE or FW_AIRSPD_TRIM.
    pub cruise_m_s: f64,
    /// The distance within which a waypoint without its own radius is accepted, m: NAV_ACC_RAD.
    pub acceptance_m: f64,
}

/// A speed that the vehicle cannot be commanded to fly.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
#[error("speed {speed_m_s:.1} m/s, expected {slowest_m_s:.1} to {fastest_m_s:.1}")]
pub struct SpeedError {
    /// m/s
    pub speed_m_s: f64,
    /// m/s
    pub slowest_m_s: f64,
    /// m/s
    pub fastest_m_s: f64,
}

impl Performance {
    /// The parameters that it is derived from.
    pub const NAMES: [&str; 6] = [
        "MPC_XY_VEL_MAX",
        "MPC_XY_CRUISE",
        "NAV_ACC_RAD",
        "FW_AIRSPD_MAX",
        "FW_AIRSPD_MIN",
        "FW_AIRSPD_TRIM",
    ];

    /// For a vehicle that can hover, or cannot, with these parameters, within the configured limits.
    #[must_use]
    pub fn of(hovers: bool, parameters: &Parameters, limits: &Limits) -> Self {
        let [slowest, fastest, cruise] = if hovers {
            [None, Some("MPC_XY_VEL_MAX"), Some("MPC_XY_CRUISE")]
        } else {
            ["FW_AIRSPD_MIN", "FW_AIRSPD_MAX", "FW_AIRSPD_TRIM"].map(Some)
        };
        let known = |name: Option<&str>| name.and_then(|name| parameters.above_zero(name));
        // The configuration narrows what the vehicle's parameters allow, and never widens it.
        let fastest_m_s = known(fastest).map_or(limits.speed_m_s, |own| own.min(limits.speed_m_s));
        let px4s = if hovers {
            QUAD_CRUISE_M_S
        } else {
            WING_CRUISE_M_S
        };
        Self {
            slowest_m_s: known(slowest).unwrap_or(STEP_M_S).min(fastest_m_s),
            fastest_m_s,
            cruise_m_s: known(cruise).unwrap_or(px4s),
            acceptance_m: known(Some("NAV_ACC_RAD")).unwrap_or(ACCEPTANCE_M),
        }
    }

    /// The speed, if it can be commanded.
    ///
    /// # Errors
    /// It is too slow, too fast, or no number.
    pub fn check(&self, speed_m_s: f64) -> Result<f64, SpeedError> {
        let Self {
            slowest_m_s,
            fastest_m_s,
            ..
        } = *self;
        if (slowest_m_s..=fastest_m_s).contains(&speed_m_s) {
            return Ok(speed_m_s);
        }
        Err(SpeedError {
            speed_m_s,
            slowest_m_s,
            fastest_m_s,
        })
    }
}

impl Default for Performance {
    /// For a multicopter that has reported nothing.
    fn default() -> Self {
        Self::of(true, &Parameters::default(), &Limits::default())
    }
}

/// Metres over ground between two places given in degrees, on the sphere: for limits, not for geometry.
#[must_use]
pub fn metres(from: (f64, f64), to: (f64, f64)) -> f64 {
    Haversine.distance(Point::new(from.1, from.0), Point::new(to.1, to.0))
}

/// The place at a distance, m, and direction, rad clockwise from true north, from another; degrees north and east.
#[must_use]
pub fn moved(from: (f64, f64), course_rad: f64, distance_m: f64) -> (f64, f64) {
    let from = Point::new(from.1, from.0);
    let at = Haversine.destination(from, course_rad.to_degrees(), distance_m);
    (at.y(), at.x())
}

/// A place and points of the circle around it: the places flown over along the circle.
#[must_use]
pub fn disc(centre: (f64, f64), radius_m: f64) -> Vec<(f64, f64)> {
    // No point of the circle is further from one of these than an elevation sample of 30 m, up to a radius of 170 m; on the
    // widest circle it is six samples.
    let course = |part: u32| f64::from(part) * std::f64::consts::TAU / f64::from(POINTS_OF_CIRCLE);
    let circle = (0..POINTS_OF_CIRCLE).map(|part| moved(centre, course(part), radius_m));
    std::iter::once(centre).chain(circle).collect()
}

/// The places flown over along a figure of eight: half its length and the radius of its ends, m, and the direction of its long axis, rad
/// from true north. Half its length is at least twice the radius.
#[must_use]
pub fn eight(centre: (f64, f64), half_m: f64, radius_m: f64, bearing_rad: f64) -> Vec<(f64, f64)> {
    // Up to where the straight ways through the middle touch the end.
    let touches = std::f64::consts::PI - (radius_m / (half_m - radius_m)).clamp(0.0, 1.0).acos();
    let end = |course: f64, way: f64| {
        let middle = moved(centre, course, half_m - radius_m);
        (0..=POINTS_OF_CIRCLE).map(move |part| {
            let share = 2.0 * f64::from(part) / f64::from(POINTS_OF_CIRCLE) - 1.0;
            moved(middle, course + way * share * touches, radius_m)
        })
    };
    let other = bearing_rad + std::f64::consts::PI;
    end(bearing_rad, 1.0).chain(end(other, -1.0)).collect()
}

/// The widest circle, m: for a multicopter MC_ORBIT_RAD_MAX (PX4 accepts a wider one, and then stops), for a fixed wing the
/// maximum of NAV_LOITER_RAD.
pub const WIDEST_CIRCLE_M: f64 = 1_000.0;

const POINTS_OF_CIRCLE: u32 = 36;
/// One step of the speed field.
const STEP_M_S: f64 = 0.5;
/// The default of MPC_XY_CRUISE.
const QUAD_CRUISE_M_S: f64 = 5.0;
/// The default of FW_AIRSPD_TRIM.
const WING_CRUISE_M_S: f64 = 15.0;
/// The default of NAV_ACC_RAD.
pub(crate) const ACCEPTANCE_M: f64 = 10.0;

#[cfg(test)]
mod tests {
    use super::*;
    use crate::parameter::NAMES;

    fn parameters(values: &[(&str, f64)]) -> Parameters {
        let mut parameters = Parameters::default();
        for (name, value) in values {
            assert!(parameters.set(name, *value), "{name}");
        }
        parameters
    }

    #[test]
    fn the_vehicle_s_own_values_apply_within_the_configured_limits() {
        let reported = parameters(&[
            ("MPC_XY_VEL_MAX", 12.0),
            ("MPC_XY_CRUISE", 7.0),
            ("NAV_ACC_RAD", 4.0),
            ("FW_AIRSPD_MIN", 11.0),
            ("FW_AIRSPD_MAX", 22.0),
            ("FW_AIRSPD_TRIM", 16.0),
        ]);
        let of = |hovers, speed_m_s| {
            let limits = Limits {
                speed_m_s,
                ..Limits::default()
            };
            let Performance {
                slowest_m_s,
                fastest_m_s,
                cruise_m_s,
                acceptance_m,
            } = Performance::of(hovers, &reported, &limits);
            [slowest_m_s, fastest_m_s, cruise_m_s, acceptance_m]
        };
        assert_eq!(of(true, 100.0), [0.5, 12.0, 7.0, 4.0]);
        assert_eq!(of(false, 100.0), [11.0, 22.0, 16.0, 4.0]);
        assert_eq!(of(true, 10.0), [0.5, 10.0, 7.0, 4.0]);
        assert_eq!(of(false, 10.0), [10.0, 10.0, 16.0, 4.0]);
    }

    #[test]
    fn unknown_values_are_px4_s_defaults_within_the_limits() {
        let Performance {
            slowest_m_s,
            fastest_m_s,
            cruise_m_s,
            acceptance_m,
        } = Performance::default();
        assert_eq!(
            [slowest_m_s, fastest_m_s, cruise_m_s, acceptance_m],
            [0.5, 100.0, 5.0, 10.0]
        );
        let wing = Performance::of(false, &Parameters::default(), &Limits::default());
        assert_eq!(wing.cruise_m_s, 15.0);
    }

    #[test]
    fn nothing_is_flown_below_home_unless_that_is_allowed() {
        const HOME_M: f64 = 488.0;
        let forbidden = Limits::default();
        let allowed = Limits {
            below_home: true,
            ..forbidden
        };
        let of = |limits: Limits, level| limits.check_height(level, HOME_M);
        for level in [
            Level::Amsl(487.9),
            Level::Amsl(0.0),
            Level::AboveHome(-0.1),
            // At home's altitude it is on the ground, however that is written.
            Level::Amsl(HOME_M),
            Level::AboveHome(0.0),
        ] {
            let found = of(forbidden, level);
            assert!(
                matches!(found, Err(HeightError::BelowHome { .. })),
                "{level:?} {found:?}"
            );
            let deep = level.amsl(HOME_M) < -12.0;
            assert_eq!(of(allowed, level).is_err(), deep, "{level:?}");
        }
        assert_eq!(of(forbidden, Level::Amsl(488.1)), Ok(()));
        assert!(of(forbidden, Level::Amsl(f64::NAN)).is_err());
        assert!(of(allowed, Level::AboveHome(f64::NAN)).is_err());
        assert!(of(allowed, Level::AboveHome(-500.1)).is_err());
        let text = of(forbidden, Level::Amsl(480.5)).map_err(|fault| fault.to_string());
        let expected = "480.5 m AMSL is 7.5 m below home (488.0 m AMSL): raise it above home, or allow it by \
                        vehicle.limits.below_home = true";
        assert_eq!(text, Err(expected.to_owned()));
    }

    #[test]
    fn its_parameters_are_among_those_that_are_read() {
        let mut names = Performance::NAMES.iter().chain(&Limits::NAMES);
        assert!(names.all(|name| NAMES.contains(name)));
    }

    #[test]
    fn the_vehicle_s_own_fence_lowers_the_highest_and_never_raises_it() {
        let highest = |fence_m| {
            let limits = Limits::default().of(&parameters(&[("GF_MAX_VER_DIST", fence_m)]));
            assert_eq!(
                limits.check_height(Level::AboveHome(limits.highest_m), 488.0),
                Ok(())
            );
            assert!(
                limits
                    .check_height(Level::AboveHome(limits.highest_m + 0.1), 488.0)
                    .is_err()
            );
            limits.highest_m
        };
        // 0 is how PX4 writes that there is none.
        assert_eq!(
            [120.0, 0.0, 9_000.0].map(highest),
            [120.0, 5_000.0, 5_000.0]
        );
    }

    #[test]
    fn a_speed_beyond_it_is_refused_with_the_range() {
        let reported = parameters(&[("MPC_XY_VEL_MAX", 12.0)]);
        let performance = Performance::of(true, &reported, &Limits::default());
        for fine in [0.5, 12.0] {
            assert_eq!(performance.check(fine), Ok(fine));
        }
        for beyond in [0.0, 12.5, -1.0, f64::NAN, f64::INFINITY] {
            assert!(performance.check(beyond).is_err(), "{beyond}");
        }
        let fault = performance.check(20.0).map_err(|fault| fault.to_string());
        let expected = "speed 20.0 m/s, expected 0.5 to 12.0".to_owned();
        assert_eq!(fault, Err(expected));
    }
}
