//! A route as an operator thinks of it: degrees, metres, seconds.

use stanag_msgs::enums::{
    AltitudeType, LimitType, LoiterDirection, LoiterType, RouteType, TurnType, WaypointSpeedType,
};
use stanag_msgs::{EncodeError, OutOfRange};

/// A route: 13001 and what belongs to it.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Route {
    /// Mission ID (0800.04) of the 13000 that loads it; at most 19 characters.
    pub mission_id: Option<String>,
    /// Route ID (0801.05), at most 32 characters.
    pub id: Option<String>,
    /// Route Type (0801.06); absent is flight.
    pub route_type: Option<RouteType>,
    /// Initial Waypoint Number (0801.04); `None`: the first of `waypoints`.
    pub initial: Option<u16>,
    /// The waypoints, in the order in which they are sent.
    pub waypoints: Vec<Waypoint>,
    /// The curved legs.
    pub curves: Vec<Curve>,
    /// Further routes over the same waypoints: sent with it, and not loaded.
    pub further: Vec<FurtherRoute>,
}

/// A route beside the one that is loaded: its 13001.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct FurtherRoute {
    /// Route ID (0801.05), at most 32 characters.
    pub id: Option<String>,
    /// Route Type (0801.06); absent is flight.
    pub route_type: Option<RouteType>,
    /// Initial Waypoint Number (0801.04).
    pub initial: u16,
}

/// A waypoint: 13002, and 13003 where it is loitered at.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Waypoint {
    /// Its number, 1 to 65534, in any order.
    pub number: u16,
    /// Degrees north, WGS-84.
    pub latitude_deg: f64,
    /// Degrees east, WGS-84.
    pub longitude_deg: f64,
    /// Metres above the datum of `altitude_type`.
    pub altitude_m: f64,
    /// The datum; absent is what the VSM takes by default.
    pub altitude_type: Option<AltitudeType>,
    /// Speed of the leg to it, m/s, in steps of 0.5.
    pub speed_m_s: Option<f64>,
    /// What that speed is measured against.
    pub speed_type: Option<WaypointSpeedType>,
    /// The number of the next waypoint; 0 ends the route.
    pub next: u16,
    /// Short turn or fly over.
    pub turn: Option<TurnType>,
    /// What is done there.
    pub loiter: Option<Loiter>,
    /// It ends a loop back to `next`.
    pub repeat: Option<Loop>,
}

/// The end of a loop (0802.17 to .19).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Loop {
    /// What the limit counts.
    pub limit_type: LimitType,
    /// The limit: rounds or seconds.
    pub limit: u16,
}

/// A loiter at a waypoint (13003).
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Loiter {
    /// The pattern.
    pub pattern: Option<LoiterType>,
    /// Metres, in steps of 1.5.
    pub radius_m: Option<f64>,
    /// Metres, in steps of 1.5: of a racetrack or a figure 8.
    pub length_m: Option<f64>,
    /// Degrees from true north: of a racetrack or a figure 8.
    pub bearing_deg: Option<f64>,
    /// Which way round.
    pub direction: Option<LoiterDirection>,
    /// Metres a second, in steps of 0.5.
    pub speed_m_s: Option<f64>,
    /// How long; absent is for ever.
    pub span: Option<LoiterSpan>,
}

/// How long a loiter lasts.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum LoiterSpan {
    /// Seconds.
    Seconds(u16),
    /// Turns.
    Turns(u16),
}

/// A curved leg: a cubic Bezier from one waypoint to another.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Curve {
    /// The waypoint P1.
    pub from: u16,
    /// The waypoint P4, which P1's Next Waypoint must name.
    pub to: u16,
    /// The control point P2.
    pub p2: Place,
    /// The control point P3.
    pub p3: Place,
    /// The datum of the control points' altitudes.
    pub altitude_type: Option<AltitudeType>,
    /// Which message carries it.
    pub form: CurveForm,
}

/// A place, perhaps with an altitude.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Place {
    /// Degrees north, WGS-84.
    pub latitude_deg: f64,
    /// Degrees east, WGS-84.
    pub longitude_deg: f64,
    /// Metres.
    pub altitude_m: Option<f64>,
}

/// The message that carries a curve.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum CurveForm {
    /// 50002, in the scalars of Edition 4.
    #[default]
    Native,
    /// 50001, the paper's message: doubles, no altitudes.
    Paper,
}

/// Why a route cannot be put into messages.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum RouteError {
    /// A route without waypoints.
    #[error("the route has no waypoints: expected at least one")]
    Empty,
    /// A quantity outside what its field expresses.
    #[error("{what}: {fault}")]
    Value {
        /// Which: the waypoint and the field.
        what: String,
        /// The value, and what is expected.
        fault: OutOfRange,
    },
    /// An angle that is not finite.
    #[error("{what}: {value}, expected a finite angle")]
    Angle {
        /// Which: the waypoint and the field.
        what: String,
        /// The value.
        value: f64,
    },
    /// A text that is too long for its field.
    #[error("{what} {value:?}, expected at most {most} 7-bit characters")]
    Text {
        /// The field.
        what: &'static str,
        /// The text.
        value: String,
        /// The most there may be.
        most: usize,
    },
    /// A message without what a route file must have.
    #[error("{of} was sent without its {field}, which is needed")]
    Absent {
        /// The waypoint or the curve.
        of: String,
        /// The field.
        field: &'static str,
    },
    /// 50001 has no field for an altitude.
    #[error("curve from waypoint {from}: 50001 carries no altitudes, use 50002")]
    CurveAltitude {
        /// P1.
        from: u16,
    },
    /// A message longer than a datagram.
    #[error(transparent)]
    Encode(#[from] EncodeError),
}
