//! The limits of a route flown on wings: possible turns and climbs, and how the vehicle lands.
//!
//! PX4 refuses none of it. It flies past a waypoint inside its turn circle, and spirals up to one that is too steep for the
//! leg, in AUTO.MISSION, with nothing reported.

use geo::{Bearing, Destination, Distance, Haversine, Point};

use super::error::Reason;
use crate::limits::{Limits, Performance};
use crate::parameter::Parameters;

/// A fixed wing, or a VTOL on its wings.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Wings {
    /// It hovers too: it transitions before a route, and lands vertically.
    pub vtol: bool,
    /// The performance of a VTOL while it hovers.
    pub hover: Option<Performance>,
    /// Greatest bank, rad: FW_R_LIM.
    pub bank_rad: f64,
    /// Fastest climb, m/s: FW_T_CLMB_MAX.
    pub climb_m_s: f64,
    /// Fastest descent, m/s: FW_T_SINK_MAX.
    pub sink_m_s: f64,
    /// Its own loiter, m: NAV_LOITER_RAD; negative is counter-clockwise.
    pub loiter_radius_m: f64,
    /// Steepest landing, degrees: FW_LND_ANG.
    pub glide_deg: f64,
    /// PX4 flies no mission without a landing: MIS_TKO_LAND_REQ 2, 3 and 5, and 4 with a take-off, which no mission has
    /// here.
    pub needs_landing: bool,
    /// Lowest transition of a VTOL, m above home: `vehicle.limits.transition_m`, VT_FW_MIN_ALT where that is higher.
    pub transition_m: f64,
    /// Where it lands, unless an approach route defines that: `vehicle.landing`.
    pub landing: Option<Pattern>,
}

/// `vehicle.landing`: a landing pattern where no approach route is loaded.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Pattern {
    /// Course of the final approach, rad clockwise from true north.
    pub course_rad: f64,
    /// Height of its loiter, m above home.
    pub height_m: f64,
    /// Slope of the glide, degrees; FW_LND_ANG where none is configured.
    pub glide_deg: Option<f64>,
    /// Radius of its loiter, m, negative counter-clockwise; NAV_LOITER_RAD where none is configured.
    pub radius_m: Option<f64>,
    /// Where it touches down, degrees north and east; home where none is configured.
    pub place: Option<(f64, f64)>,
}

impl Wings {
    /// The parameters that it is derived from, in addition to those of [`Performance`](crate::limits::Performance).
    pub const NAMES: [&str; 7] = [
        "FW_LND_ANG",
        "FW_R_LIM",
        "FW_T_CLMB_MAX",
        "FW_T_SINK_MAX",
        "MIS_TKO_LAND_REQ",
        "NAV_LOITER_RAD",
        "VT_FW_MIN_ALT",
    ];

    /// From the vehicle's parameters, with PX4's defaults for those it has not reported.
    #[must_use]
    pub fn of(
        vtol: bool,
        parameters: &Parameters,
        limits: &Limits,
        landing: Option<Pattern>,
    ) -> Wings {
        let or = |name, default| parameters.above_zero(name).unwrap_or(default);
        let loiter = parameters.get("NAV_LOITER_RAD");
        // The defaults of wings, rc.fw_defaults and rc.vtol_defaults of PX4 v1.18, set 2.
        let required = parameters.get("MIS_TKO_LAND_REQ").unwrap_or(2.0);
        Wings {
            vtol,
            hover: vtol.then(|| Performance::of(true, parameters, limits)),
            bank_rad: or("FW_R_LIM", 50.0).to_radians(),
            climb_m_s: or("FW_T_CLMB_MAX", 5.0),
            sink_m_s: or("FW_T_SINK_MAX", 5.0),
            loiter_radius_m: loiter.filter(|m| *m != 0.0).unwrap_or(80.0),
            glide_deg: or("FW_LND_ANG", 5.0),
            needs_landing: [2.0, 3.0, 5.0].contains(&required),
            transition_m: limits.transition_m.max(or("VT_FW_MIN_ALT", 0.0)),
            landing,
        }
    }

    /// Radius of the tightest turn at an air speed, m, without wind.
    #[must_use]
    pub fn turn_radius_m(&self, speed_m_s: f64) -> f64 {
        // R = V^2 / (g tan bank), for a coordinated turn.
        speed_m_s * speed_m_s / (GRAVITY_M_S2 * self.bank_rad.tan())
    }

    /// Whether a VTOL is high enough here for a transition.
    ///
    /// # Errors
    /// It is not, or it is no VTOL.
    pub(super) fn check_transition(&self, height_m: f64) -> Result<(), Reason> {
        if !self.vtol {
            return Err(Reason::NoVtol);
        }
        if height_m >= self.transition_m {
            return Ok(());
        }
        Err(Reason::LowTransition {
            height_m,
            least_m: self.transition_m,
        })
    }

    /// Whether it can circle with this radius at this speed.
    ///
    /// # Errors
    /// It cannot bank that far.
    pub(super) fn check_circle(&self, radius_m: f64, speed_m_s: f64) -> Result<(), Reason> {
        let least_m = self.turn_radius_m(speed_m_s);
        if radius_m.abs() >= least_m {
            return Ok(());
        }
        Err(Reason::TightCircle {
            radius_m: radius_m.abs(),
            least_m,
            speed_m_s,
        })
    }

    /// Checks that a leg with this climb over this distance is flat enough at this speed.
    ///
    /// # Errors
    /// It climbs or descends faster than the wing does.
    pub(super) fn check_climb(
        &self,
        climb_m: f64,
        distance_m: f64,
        speed_m_s: f64,
    ) -> Result<(), Reason> {
        let most_m_s = if climb_m > 0.0 {
            self.climb_m_s
        } else {
            self.sink_m_s
        };
        let seconds = distance_m / speed_m_s;
        // A climb within PX4's own vertical acceptance is never too steep.
        if climb_m.abs() <= most_m_s * seconds + LEVEL_M {
            return Ok(());
        }
        Err(Reason::Steep {
            climb_m,
            distance_m,
            speed_m_s,
            most_m: most_m_s * seconds,
        })
    }

    /// Checks that a vehicle that comes from the first place can turn at the second, waypoint `at`, to the third.
    ///
    /// # Errors
    /// It lies inside the turn circle.
    pub(super) fn check_turn(
        &self,
        at: u16,
        places: [(f64, f64); 3],
        speed_m_s: f64,
    ) -> Result<(), Reason> {
        let [a, b, c] = places.map(point);
        let (course, onward) = (Haversine.bearing(a, b), Haversine.bearing(b, c));
        let turn = (onward - course + 540.0).rem_euclid(360.0) - 180.0;
        let radius_m = self.turn_radius_m(speed_m_s);
        // At 180 degrees either side is possible.
        let side = if turn < 0.0 { -90.0 } else { 90.0 };
        let centre = Haversine.destination(b, course + side, radius_m);
        let off_m = Haversine.distance(centre, c);
        // PX4 accepts the waypoint within its radius, so a place slightly inside the circle is still reached.
        if off_m >= radius_m - INSIDE_M {
            return Ok(());
        }
        Err(Reason::TightTurn {
            at,
            turn_deg: turn.abs(),
            radius_m,
            speed_m_s,
        })
    }
}

fn point((latitude, longitude): (f64, f64)) -> Point {
    Point::new(longitude, latitude)
}

const GRAVITY_M_S2: f64 = 9.806_65;
/// The default of NAV_FW_ALT_RAD, m.
const LEVEL_M: f64 = 10.0;
/// The default of NAV_ACC_RAD, m: within it a waypoint is accepted all the same.
const INSIDE_M: f64 = 10.0;
