//! Why a route is refused: at which waypoint, which value, and what was expected of it.

use curve_paths::terrain::{Clearance, tile_name};

use crate::altitude::AltitudeError;
use crate::limits::{HeightError, SpeedError, WIDEST_CIRCLE_M};

/// Why a route cannot be flown, and at which waypoint.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[error("waypoint {waypoint}: {reason}")]
pub struct RouteError {
    /// The offending waypoint, as the CUCS numbers it.
    pub waypoint: u16,
    /// Why.
    pub reason: Reason,
}

/// Why a waypoint cannot be flown.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum Reason {
    /// A Next Waypoint or an Initial Waypoint Number that no 13002 has described.
    #[error("not received")]
    Unknown,
    /// A Next Waypoint leads back, and not from the end of a loop.
    #[error("the route returns to it: only Waypoint Type 1 (end of a loop) may lead back")]
    Loop,
    /// The end of a loop leads nowhere, to itself, or on.
    #[error("the end of a loop leads to {0}, expected a waypoint flown before it")]
    LoopStart(u16),
    /// A loop that is never flown.
    #[error("Loop Limit 0, expected 1 to 65535")]
    LoopLimit,
    /// A loop limited by time.
    #[error("Limit Type 2 (time): PX4 limits loops by count only")]
    LoopTime,
    /// A field that cannot be done without.
    #[error("{0} is missing")]
    Missing(&'static str),
    /// Curves are to be streamed, and the vehicle is no multicopter.
    #[error(
        "vehicle.curve.mode is \"offboard\", and the vehicle has wings: PX4 takes such set points of a multicopter only; set \
         \"mission\""
    )]
    StreamOnWings,
    /// Latitude beyond the poles.
    #[error("latitude {0:.4} deg, expected -90 to 90")]
    Latitude(f64),
    /// Coordinates relative to the route's reference.
    #[error("relative coordinates (Location Type {0}) are not supported")]
    Relative(u8),
    /// The altitude has no usable reference.
    #[error(transparent)]
    Altitude(#[from] AltitudeError),
    /// Below home, too low or too high.
    #[error(transparent)]
    Height(#[from] HeightError),
    /// Too low over the terrain on the way to it.
    #[error(transparent)]
    Terrain(#[from] TerrainError),
    /// The first waypoint is too far from home.
    #[error(
        "{distance_m:.0} m from home, at most {max_m:.0}{}",
        if *swapped { " (with latitude and longitude exchanged it would be near: are they swapped?)" } else { "" }
    )]
    FarFromHome {
        /// Metres.
        distance_m: f64,
        /// Metres.
        max_m: f64,
        /// With latitude and longitude exchanged it would be near.
        swapped: bool,
    },
    /// A leg is too long.
    #[error("{distance_m:.0} m from the waypoint before, at most {max_m:.0}")]
    LongLeg {
        /// Metres.
        distance_m: f64,
        /// Metres.
        max_m: f64,
    },
    /// A speed that the vehicle does not fly.
    #[error(transparent)]
    Speed(#[from] SpeedError),
    /// An arrival time: PX4 flies speeds only.
    #[error("Waypoint Speed Type 3 (arrival time): PX4 accepts speeds only")]
    ArrivalTime,
    /// A value that no source names.
    #[error("{field} {value} is not known")]
    UnknownValue {
        /// The field.
        field: &'static str,
        /// Its value.
        value: u8,
    },
    /// A pattern that PX4 cannot fly.
    #[error("PX4 cannot loiter in a {0}")]
    LoiterType(&'static str),
    /// A circle that is too wide.
    #[error("Loiter Radius {0:.0} m, at most {max:.0}", max = WIDEST_CIRCLE_M)]
    LoiterRadius(f64),
    /// A wing cannot bank that far.
    #[error(
        "Loiter Radius {radius_m:.0} m at {speed_m_s:.1} m/s, at least {least_m:.0} (FW_R_LIM)"
    )]
    TightCircle {
        /// Metres.
        radius_m: f64,
        /// Metres.
        least_m: f64,
        /// m/s
        speed_m_s: f64,
    },
    /// A waypoint that a wing cannot turn to.
    #[error(
        "the turn of {turn_deg:.0} deg at waypoint {at} cannot reach it: it lies inside the turn circle of \
         {radius_m:.0} m at {speed_m_s:.1} m/s (FW_R_LIM); move it further away, or fly slower"
    )]
    TightTurn {
        /// The waypoint of the turn.
        at: u16,
        /// Degrees.
        turn_deg: f64,
        /// Metres.
        radius_m: f64,
        /// m/s
        speed_m_s: f64,
    },
    /// A leg that a wing cannot climb or descend.
    #[error(
        "its altitude changes by {climb_m:.0} m on a leg of {distance_m:.0} m, at {speed_m_s:.1} m/s at most \
         {most_m:.0} m (FW_T_CLMB_MAX, FW_T_SINK_MAX)"
    )]
    Steep {
        /// Metres, up positive.
        climb_m: f64,
        /// Metres.
        distance_m: f64,
        /// m/s
        speed_m_s: f64,
        /// Metres.
        most_m: f64,
    },
    /// A transition of what hovers always, or never.
    #[error("a transition (13006): the vehicle is no VTOL")]
    NoVtol,
    /// An action after a loiter that has no end.
    #[error(
        "an action (13006) after its loiter, which has no end: PX4 would never come to it; give the loiter a duration (13003)"
    )]
    ActionAfterLoiter,
    /// Its payload looks at a place whose altitude has no usable reference.
    #[error("its starepoint (13004): {0}")]
    StarePoint(AltitudeError),
    /// A delay of what cannot stand still.
    #[error(
        "DELAY (13006) on wings: PX4 flies on meanwhile; send a loiter with a duration (13003)"
    )]
    DelayOnWings,
    /// A loop whose start is flown on wings the first time, and hovering the next, or the other way.
    #[error(
        "the loop leads back to waypoint {0} in another state of the VTOL than it was flown to before: transition (13006) \
         at the end of the loop"
    )]
    TransitionInLoop(u16),
    /// A wing's route without a landing.
    #[error(
        "PX4 flies no route of a fixed wing or VTOL without a landing (MIS_TKO_LAND_REQ): send an approach route first \
         (13001, Route Type approach; its last waypoint is the touch-down), or configure vehicle.landing"
    )]
    NoLanding,
    /// An approach route that leads from nowhere to its touch-down.
    #[error(
        "the approach route of a wing needs a waypoint before its last one, which is the touch-down"
    )]
    ShortApproach,
    /// A loop in the approach.
    #[error("a loop in an approach route: it leads to the touch-down, without repetition")]
    LoopInApproach,
    /// The vehicle would wait before its landing.
    #[error(
        "a timed loiter before the touch-down: PX4 lands from a waypoint, or from a loiter without duration, which it \
         leaves at its altitude"
    )]
    ApproachLoiter,
    /// The glide is too steep.
    #[error(
        "from here to the touch-down {height_m:.0} m of height on {final_m:.0} m, {glide_deg:.1} deg, at most \
         {most_deg:.1} (FW_LND_ANG): place it {needed_m:.0} m away, or lower"
    )]
    GlideSlope {
        /// Metres above the touch-down.
        height_m: f64,
        /// Metres over ground.
        final_m: f64,
        /// Degrees.
        glide_deg: f64,
        /// Degrees.
        most_deg: f64,
        /// Metres over ground that the height needs.
        needed_m: f64,
    },
    /// The touch-down lies in the circle of the loiter before it.
    #[error(
        "the touch-down is {away_m:.0} m from the centre of its loiter, inside the radius of {radius_m:.0} m"
    )]
    LandingInsideLoiter {
        /// Metres.
        away_m: f64,
        /// Metres.
        radius_m: f64,
    },
    /// A VTOL would transition too low.
    #[error(
        "a transition {height_m:.0} m above home, at least {least_m:.0} (vehicle.limits.transition_m, VT_FW_MIN_ALT)"
    )]
    LowTransition {
        /// Metres above home.
        height_m: f64,
        /// Metres above home.
        least_m: f64,
    },
    /// A number of turns: PX4 has no such item.
    #[error(
        "a loiter counted in turns: PX4 accepts times only; a fixed wing's turns become a time where \
         radius and speed are given"
    )]
    LoiterTurns,
    /// A curved leg that cannot be flown.
    #[error("its curved leg to {to}: {fault}")]
    Curve {
        /// P4, as the CUCS numbers it.
        to: u16,
        /// Why.
        fault: CurveError,
    },
    /// A curved leg to another waypoint than the next.
    #[error("its curved leg leads to {to}, its Next Waypoint is {next}; {dropped}", dropped = DROPPED)]
    CurveEnd {
        /// P4.
        to: u16,
        /// The waypoint that follows.
        next: u16,
    },
    /// A curved leg names it, and no 13002 has described it.
    #[error(
        "not received, and a curved leg joins it to {0}: send it (13002), or clear the plan (13000 mode 1)"
    )]
    CurveWithoutEnd(u16),
    /// The same, and the curved leg's P1 is known and leads to it: led elsewhere, that drops the curve.
    #[error(
        "not received, and a curved leg joins it to {0}: send it (13002), or {0} with another Next Waypoint, or clear \
         the plan (13000 mode 1)"
    )]
    CurveWithoutP4(u16),
    /// The leg that closes a loop is curved.
    #[error(
        "its curved leg leads back to {0}: a loop is closed by a straight leg, since PX4 would fly the curve after the \
         last pass too"
    )]
    CurveClosesLoop(u16),
    /// The leg that closes a loop needs points between its ends.
    #[error(
        "the leg that leads back to {0} needs points between them to keep its height above the ground: a loop is closed by a \
         straight line, so add a waypoint where the ground is highest, or raise both"
    )]
    GroundInLoop(u16),
    /// Two curved legs from one waypoint.
    #[error("two curved legs start at it, to {0} and to {1}; {dropped}", dropped = DROPPED)]
    TwoCurves(u16, u16),
    /// More items than the vehicle takes.
    #[error("the route needs more than {0} items")]
    TooManyItems(usize),
}

impl Reason {
    pub(super) fn unknown(field: &'static str, value: u8) -> Self {
        Self::UnknownValue { field, value }
    }
}

/// A curve that cannot be flown.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum CurveError {
    /// A field that cannot be done without.
    #[error("{0} is missing")]
    Missing(&'static str),
    /// Its altitude has no usable reference.
    #[error(transparent)]
    Altitude(#[from] AltitudeError),
    /// The ground below it is not known.
    #[error(transparent)]
    Terrain(#[from] TerrainError),
    /// Somewhere along it, it is below home, too low or too high.
    #[error("at {latitude:.6}, {longitude:.6} {fault}")]
    Height {
        /// Degrees north.
        latitude: f64,
        /// Degrees east.
        longitude: f64,
        /// Why.
        fault: HeightError,
    },
    /// Too fast to be at the altitude of its points in time.
    #[error(
        "it climbs or descends, at {speed_m_s} m/s: its shortest chord of {chord_m:.1} m allows {fastest_m_s:.1} m/s"
    )]
    ClimbsTooFast {
        /// The wished speed, m/s.
        speed_m_s: f64,
        /// The shortest chord, m.
        chord_m: f64,
        /// The fastest that it allows, m/s.
        fastest_m_s: f64,
    },
    /// A number is not finite, a control point too far away, and so on.
    #[error("{0}")]
    Shape(String),
}

/// How a curve is got rid of.
const DROPPED: &str = "a 13002 that changes its Next Waypoint drops the curve to the one before";

/// A place of a route that is too low over the terrain.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
pub enum TerrainError {
    /// It is at the ground, below it, or not as high above it as configured.
    #[error("{}", low(found, *needed_m))]
    Low {
        /// Where, and how high above the ground.
        found: Clearance,
        /// `vehicle.limits.above_terrain_m`.
        needed_m: f64,
    },
    /// A leg between heights above the ground leads where that is not known: a guess could be below it.
    #[error(
        "on the way to it, the height of the ground at {lat_deg:.6}, {lon_deg:.6} is not known (altitude type 2): add {} to \
         vehicle.terrain, or command altitudes above mean sea level",
        tile_name(*lat_deg, *lon_deg)
    )]
    Unknown {
        /// Degrees north.
        lat_deg: f64,
        /// Degrees east.
        lon_deg: f64,
    },
    /// Comparing it would keep the bridge from its other work.
    #[error(
        "the route is longer than what is compared with the terrain, {MAX_PLACES} places each {spacing_m:.0} m: divide it"
    )]
    Long {
        /// Between two places, m.
        spacing_m: f64,
    },
}

fn low(found: &Clearance, needed_m: f64) -> String {
    let Clearance { clearance_m, at } = found;
    let place = format!("at {:.6}, {:.6}", at.lat_deg, at.lon_deg);
    let ground_m = at.alt_m - clearance_m;
    let how = if *clearance_m > 0.0 {
        format!(
            "{clearance_m:.1} m above the terrain ({ground_m:.1} m), expected over {needed_m:.1} m"
        )
    } else {
        format!("{:.1} m below the terrain ({ground_m:.1} m)", -clearance_m)
    };
    format!(
        "on the way to it, {place}, {:.1} m AMSL is {how}: raise it, or allow it by vehicle.limits.above_terrain_m",
        at.alt_m
    )
}

/// Places of a route that are compared at most: 4,000 km over tiles of an arc second, some 20 ms.
pub(super) const MAX_PLACES: usize = 400_000;
