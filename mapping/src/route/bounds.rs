//! What a route must stay within: how far, how high, how many items.

use geo::{Distance, Haversine, Point};

use super::{Leg, Reason, Site};
use crate::altitude::Level;
use crate::telemetry::Place;

/// What a route must stay within.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Limits {
    /// Farthest first waypoint from home, m.
    pub first_m: f64,
    /// Longest leg, m.
    pub leg_m: f64,
    /// Lowest waypoint, m above home.
    pub lowest_m: f64,
    /// Highest waypoint, m above home.
    pub highest_m: f64,
    /// Fastest commanded speed, m/s; the vehicle's own counts where it is lower
    /// ([`Performance`](crate::performance::Performance)).
    pub speed_m_s: f64,
    /// Most mission items.
    pub items: usize,
}

impl Default for Limits {
    fn default() -> Self {
        Limits {
            first_m: 5_000.0,
            leg_m: 50_000.0,
            lowest_m: -500.0,
            highest_m: 5_000.0,
            speed_m_s: 100.0,
            items: 500,
        }
    }
}

/// Whether a level lies within the limits.
///
/// # Errors
/// Too low, too high, or in the ground.
pub fn height(level: Level, home: &Place, limits: &Limits) -> Result<(), Reason> {
    if let Level::AboveHome(m) = level
        && m <= 0.0
    {
        return Err(Reason::InTheGround(m));
    }
    let Limits {
        lowest_m,
        highest_m,
        ..
    } = *limits;
    let height_m = level.amsl(home.amsl_m) - home.amsl_m;
    if (lowest_m..=highest_m).contains(&height_m) {
        return Ok(());
    }
    Err(Reason::Height {
        height_m,
        lowest_m,
        highest_m,
    })
}

/// Metres over ground between two places given in degrees, on the sphere: for limits, not for geometry.
#[must_use]
pub fn metres(from: (f64, f64), to: (f64, f64)) -> f64 {
    Haversine.distance(Point::new(from.1, from.0), Point::new(to.1, to.0))
}

/// Whether a leg is no longer than allowed: from the waypoint before, or from home where it is the first.
///
/// # Errors
/// It is longer.
pub(super) fn distance(to: &Leg, from: Option<&Leg>, site: &Site) -> Result<(), Reason> {
    let here = (to.latitude, to.longitude);
    match from {
        None => {
            let home = (site.home.latitude, site.home.longitude);
            let (distance_m, most_m) = (metres(home, here), site.limits.first_m);
            if distance_m > most_m {
                Err(Reason::FarFromHome { distance_m, most_m })
            } else {
                Ok(())
            }
        }
        Some(from) => {
            let before = (from.latitude, from.longitude);
            let (distance_m, most_m) = (metres(before, here), site.limits.leg_m);
            if distance_m > most_m {
                Err(Reason::LongLeg { distance_m, most_m })
            } else {
                Ok(())
            }
        }
    }
}
