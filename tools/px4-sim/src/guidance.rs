//! What the navigator asks of the airframe, step by step.

use super::geo::Ned;
use super::trajectory::Leg;

/// Where to go.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Guidance {
    /// Motors off or idling on the ground.
    Ground,
    /// Along a leg.
    Leg(Leg),
    /// Along a leg that starts at the ground: slowly at first.
    Climb(Leg),
    /// Over the leg's target, coming down until the ground is there.
    Land(Leg),
    /// By a velocity, a position or both on each axis; an axis with neither stops.
    Steer {
        /// Local position, m.
        position: [Option<f64>; 3],
        /// Velocity, m/s.
        velocity: [Option<f64>; 3],
    },
    /// Round a centre.
    Circle {
        /// Centre in the local frame.
        centre: Ned,
        /// Radius, m; positive is clockwise from above.
        radius: f64,
        /// Speed over ground, m/s.
        speed: f64,
        /// Height to keep, as local down.
        altitude_d: f64,
    },
}

/// Where to look.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Heading {
    /// As now.
    Hold,
    /// Toward the waypoint, or the centre of a circle.
    Along,
    /// A heading, radians.
    To(f64),
    /// A turn rate, rad/s.
    Rate(f64),
}
