//! `[[vehicle]]`: one vehicle, its link and key, and the bounds of what it is told to fly.

use serde::Deserialize;
use stanag_msgs::Id;

use super::Area;
use super::value::{self, LinkAddress, Signing, id};

/// `[[vehicle]]`
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Vehicle {
    /// Its identification number (the wrapper's destination of commands).
    #[serde(deserialize_with = "id")]
    pub id: Id,
    /// Where its MAVLink is.
    pub link: LinkAddress,
    /// Its MAVLink system id, 1 to 255.
    pub system_id: u8,
    /// Tail Number of message 3, at most 15 characters.
    #[serde(default)]
    pub tail_number: String,
    /// The signing key, or `"off"`.
    pub signing: Signing,
    /// The MAVLink signing link id of this VSM on that link.
    #[serde(default)]
    pub link_id: u8,
    /// The MAVLink signing link id of the vehicle's autopilot on that link; learned, and kept, where absent.
    pub vehicle_link_id: Option<u8>,
    /// How curved legs are flown.
    #[serde(default)]
    pub curve: Curve,
    /// How altitude type 2 (AGL) is flown.
    #[serde(default)]
    pub agl: Agl,
    /// Bounds of a route.
    #[serde(default)]
    pub limits: Limits,
    /// Areas of its geofence, which no CUCS can take away.
    #[serde(default)]
    pub area: Vec<Area>,
    /// Longest time, s, that a mission may get no nearer to its waypoint, 10 to 3600: then the vehicle is told to
    /// hold. `None`, as `0` in the file, for ever.
    #[serde(default = "value::default_stall", deserialize_with = "value::stall")]
    pub stall_s: Option<f64>,
}

/// `vehicle.curve`
#[derive(Debug, Clone, Copy, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Curve {
    /// Largest planned deviation from the curve, m, 0.1 to 100.
    pub tolerance_m: f64,
    /// Most items that a route may become, 2 to 10000: where it would become more, its curves are flown within the
    /// smallest tolerance that these allow.
    pub max_items: u16,
    /// What is done where the curve is too tight for the speed.
    pub policy: CurvePolicy,
    /// Where the vertices of the straight legs lie.
    pub vertices: CurveVertices,
}

impl Default for Curve {
    fn default() -> Self {
        Curve {
            tolerance_m: 1.0,
            max_items: 500,
            policy: CurvePolicy::Slow,
            vertices: CurveVertices::On,
        }
    }
}

/// `vehicle.curve.vertices`
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum CurveVertices {
    /// On the curve.
    On,
    /// Off it by up to the tolerance: about a quarter fewer items, proven all the same.
    Free,
}

/// `vehicle.curve.policy`
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum CurvePolicy {
    /// Slow down before the tight part, and speed up after.
    Slow,
    /// Refuse the route.
    Refuse,
}

/// `vehicle.agl`
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Agl {
    /// Flown as height above home (MAVLink frame 6).
    #[default]
    Home,
    /// Refused.
    Refuse,
}

/// `vehicle.limits`: a route beyond these is refused whole.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Limits {
    /// Farthest first waypoint from home, m.
    pub first_m: f64,
    /// Longest leg, m.
    pub leg_m: f64,
    /// Lowest waypoint, m above home.
    pub lowest_m: f64,
    /// Highest waypoint, m above home.
    pub highest_m: f64,
    /// Fastest commanded speed, m/s.
    pub speed_m_s: f64,
}

impl Default for Limits {
    fn default() -> Self {
        let mapping::limits::Limits {
            first_m,
            leg_m,
            lowest_m,
            highest_m,
            speed_m_s,
            ..
        } = mapping::limits::Limits::default();
        Limits {
            first_m,
            leg_m,
            lowest_m,
            highest_m,
            speed_m_s,
        }
    }
}
