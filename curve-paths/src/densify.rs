//! From curved legs to the vertices of straight ones, within a tolerance that is proven.
//!
//! Promised: the polyline through the vertices and the curve are nowhere further apart than `bound_m`, both ways, in three
//! dimensions, all allowances included; `bound_m` is at most the requested tolerance; every leg's own ends are vertices,
//! each joint once; a closed route ends in exactly the numbers it starts with. Only the output is allocated.

use thiserror::Error;

use crate::free::walk_free;
use crate::leg::{BezierLeg, LegError, Reach, check_altitude, check_ground, check_reach};
use crate::local::ErrorAllowance;
use crate::vector::Vec3;
use crate::walk::{AltitudeAlong, Densified, Rules, Vertex, count, walk};
use crate::wgs84::{Near, Position};

/// One leg of a route.
#[derive(Clone, Copy, Debug, PartialEq)]
#[expect(
    clippy::large_enum_variant,
    reason = "a route has a few hundred legs at most, and a leg stays Copy"
)]
pub enum Leg {
    /// The geodesic from one position to another with an even climb: one chord, which is charged rounding errors
    /// only.
    Straight {
        /// Its start.
        from: Position,
        /// Its end.
        to: Position,
    },
    /// A cubic Bezier leg.
    Bezier(BezierLeg),
}

impl Leg {
    /// A legal straight leg.
    ///
    /// # Errors
    /// When a number is not finite or out of range, or the ends more than 50 km apart.
    pub fn straight(from: Position, to: Position) -> Result<Self, LegError> {
        check_ground("P1", from.ground())?;
        check_ground("P4", to.ground())?;
        check_altitude("P1", from.alt_m)?;
        check_altitude("P4", to.alt_m)?;
        check_reach(
            "P4",
            "P1",
            from.ground().distance_m(to.ground()),
            Reach::default().leg_m,
        )?;
        Ok(Self::Straight { from, to })
    }

    /// Where it starts.
    #[must_use]
    pub const fn start(&self) -> Position {
        match self {
            Self::Straight { from, .. } => *from,
            Self::Bezier(leg) => leg.p1(),
        }
    }

    /// Where it ends.
    #[must_use]
    pub const fn end(&self) -> Position {
        match self {
            Self::Straight { to, .. } => *to,
            Self::Bezier(leg) => leg.p4(),
        }
    }
}

impl From<BezierLeg> for Leg {
    fn from(leg: BezierLeg) -> Self {
        Self::Bezier(leg)
    }
}

/// How to densify.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Options {
    /// Greatest deviation of the polyline from the curve and of the curve from the polyline, m.
    pub tolerance_m: f64,
    /// Shortest chord between two vertices of a curved leg, m on the ground; 4 for flight, 0 for no rule.
    pub min_chord_m: f64,
    /// What is charged to the bound in addition to the geometry.
    pub allowance: ErrorAllowance,
    /// Whether vertices may leave the curve.
    pub vertices: Vertices,
}

/// Where the vertices of curved legs lie; a leg's own ends are always kept.
#[derive(Clone, Copy, Debug, Default, Eq, PartialEq)]
pub enum Vertices {
    /// On the curve.
    #[default]
    OnCurve,
    /// Off the curve by up to the tolerance: about 30 % fewer, and proven all the same.
    Free,
}

impl Options {
    /// For a mission that PX4 flies: its allowance, and chords of at least 4 m.
    #[must_use]
    pub const fn flight(tolerance_m: f64) -> Self {
        Self {
            tolerance_m,
            min_chord_m: 4.0,
            allowance: ErrorAllowance::MISSION_ITEM,
            vertices: Vertices::OnCurve,
        }
    }

    /// Geometry only: no allowance, no minimum chord.
    #[must_use]
    pub const fn geometry(tolerance_m: f64) -> Self {
        Self {
            tolerance_m,
            min_chord_m: 0.0,
            allowance: ErrorAllowance::NONE,
            vertices: Vertices::OnCurve,
        }
    }
}

/// Why a route cannot be densified with these options.
#[derive(Clone, Copy, Debug, Error, PartialEq)]
pub enum DensifyError {
    /// The route has no leg.
    #[error("the route has no leg, expected at least one")]
    Empty,
    /// A leg starts elsewhere than the one before it ends.
    #[error(
        "leg {leg} starts {gap_m} m from the end of the leg before it, expected the same position"
    )]
    Gap {
        /// The leg, from 0.
        leg: usize,
        /// The distance, m.
        gap_m: f64,
    },
    /// The tolerance is not a number, or smaller than what the allowances take of it.
    #[error("tolerance is {tolerance_m} m, expected {min_m:.4} to 10000 m")]
    Tolerance {
        /// The requested tolerance, m.
        tolerance_m: f64,
        /// The smallest possible tolerance, m.
        min_m: f64,
    },
    /// The curve turns too tightly, or climbs too steeply, for chords of the minimum length.
    #[error(
        "leg {leg} at t = {t:.4} ({lat:.7}, {lon:.7}): it turns or climbs too sharply for chords of {min_chord_m} m or longer \
         within {tolerance_m} m: make it wider or less steep there, or allow a larger tolerance or shorter chords",
        lat = .at.lat_deg, lon = .at.lon_deg
    )]
    ChordTooShort {
        /// The leg, from 0.
        leg: usize,
        /// The parameter.
        t: f64,
        /// Where that is.
        at: Position,
        /// The minimum chord, m.
        min_chord_m: f64,
        /// The tolerance, m.
        tolerance_m: f64,
    },
}

/// The vertices of a whole route.
///
/// # Errors
/// The route is empty or has a gap, the tolerance cannot be kept, or the minimum chord prevents it.
pub fn densify(legs: &[Leg], options: &Options) -> Result<Densified, DensifyError> {
    let first = legs.first().ok_or(DensifyError::Empty)?.start();
    let fixed_m = check(legs, options)?;
    let rules = Rules {
        tolerance_m: options.tolerance_m - fixed_m,
        min_chord_m: options.min_chord_m,
        allowance: options.allowance,
    };
    let mut out = Densified {
        vertices: Vec::with_capacity(1 + legs.len() * VERTICES_A_LEG),
        bound_m: fixed_m,
        shortest_chord_m: f64::INFINITY,
    };
    out.vertices.push(Vertex {
        position: first,
        leg: 0,
        t: 0.0,
    });
    for (index, leg) in legs.iter().enumerate() {
        match leg {
            Leg::Straight { from, to } => {
                let length_m = from.ground().distance_m(to.ground());
                out.shortest_chord_m = out.shortest_chord_m.min(length_m);
                out.vertices.push(Vertex {
                    position: *to,
                    leg: index,
                    t: 1.0,
                });
            }
            Leg::Bezier(leg) => {
                if options.vertices == Vertices::Free
                    && freed(leg, index, &rules, fixed_m, &mut out)
                {
                    continue;
                }
                densify_leg(leg, index, &rules, fixed_m, &mut out).map_err(|t| {
                    DensifyError::ChordTooShort {
                        leg: index,
                        t,
                        at: leg.at(t),
                        min_chord_m: options.min_chord_m,
                        tolerance_m: options.tolerance_m,
                    }
                })?
            }
        }
    }
    // The ends of a closed route may differ by less than any message resolves. With equal numbers PX4 is given the
    // same item for both.
    if let [first, .., last] = &mut out.vertices[..]
        && apart_m(first.position, last.position) <= SAME_M
    {
        last.position = first.position;
    }
    Ok(out)
}

/// The number of vertices that [`densify`] makes with vertices on the curve and no least chord, first and last
/// counted: the search alone, without their latitudes and longitudes.
///
/// As [`densify`], except for the minimum chord.
pub fn vertices_needed(legs: &[Leg], options: &Options) -> Result<usize, DensifyError> {
    legs.first().ok_or(DensifyError::Empty)?;
    let tolerance_m = options.tolerance_m - check(legs, options)?;
    let rules = Rules {
        tolerance_m,
        min_chord_m: 0.0,
        allowance: options.allowance,
    };
    let chords = |leg: &Leg| match leg {
        Leg::Straight { .. } => 1,
        Leg::Bezier(leg) => count(leg, &rules, usize::MAX),
    };
    Ok(1 + legs.iter().map(chords).sum::<usize>())
}

/// Adds the leg with its vertices off the curve; false, with nothing added, where that saves no vertex.
fn freed(leg: &BezierLeg, index: usize, rules: &Rules, fixed_m: f64, out: &mut Densified) -> bool {
    let before = (out.vertices.len(), out.bound_m, out.shortest_chord_m);
    if !walk_free(leg, index, rules, fixed_m, out) {
        return false;
    }
    let needed = out.vertices.len() - before.0;
    // A vertex on the curve is simpler: vertices leave the curve only where that saves items.
    if count(leg, rules, needed) <= needed {
        out.vertices.truncate(before.0);
        (out.bound_m, out.shortest_chord_m) = (before.1, before.2);
        return false;
    }
    true
}

fn densify_leg(
    leg: &BezierLeg,
    index: usize,
    rules: &Rules,
    fixed_m: f64,
    out: &mut Densified,
) -> Result<(), f64> {
    let mut altitude = AltitudeAlong::new(leg);
    let near = Near::new(leg.origin());
    walk(leg, rules, |chord| {
        out.bound_m = out.bound_m.max(fixed_m + chord.bound_m);
        out.shortest_chord_m = out.shortest_chord_m.min(chord.ground_m);
        // The leg's own end is copied: a computed one would differ by rounding.
        let position = if chord.b >= 1.0 {
            leg.p4()
        } else {
            let ground = near.ground(leg.origin() + leg.offsets().at(chord.b));
            Position::new(
                ground.lat_deg,
                ground.lon_deg,
                altitude.at(chord.a, chord.b),
            )
        };
        out.vertices.push(Vertex {
            position,
            leg: index,
            t: chord.b,
        });
    })
    .map_err(|stuck| stuck.t)
}

/// Checks the route against its options; returns what every vertex is charged, m.
pub(crate) fn check(legs: &[Leg], options: &Options) -> Result<f64, DensifyError> {
    for (index, pair) in legs.windows(2).enumerate() {
        let gap_m = apart_m(pair[0].end(), pair[1].start());
        if gap_m.is_nan() || gap_m > SAME_M {
            return Err(DensifyError::Gap {
                leg: index + 1,
                gap_m,
            });
        }
    }
    // float32 altitudes round more coarsely the higher they are, so the highest point sets the charge.
    let highest_m = legs.iter().map(highest).fold(0.0, f64::max);
    let fixed_m = options.allowance.fixed_m(highest_m);
    let min_m = fixed_m + MIN_GEOMETRY_M;
    if !(min_m..=MAX_TOLERANCE_M).contains(&options.tolerance_m) {
        return Err(DensifyError::Tolerance {
            tolerance_m: options.tolerance_m,
            min_m,
        });
    }
    Ok(fixed_m)
}

fn highest(leg: &Leg) -> f64 {
    let ends = leg.start().alt_m.abs().max(leg.end().alt_m.abs());
    match leg {
        Leg::Straight { .. } => ends,
        Leg::Bezier(leg) => [leg.p2(), leg.p3()]
            .iter()
            .filter_map(|c| c.alt_m)
            .fold(ends, |m, a| m.max(a.abs())),
    }
}

fn apart_m(a: Position, b: Position) -> f64 {
    let flat: Vec3 = a.ground().to_ecef() - b.ground().to_ecef();
    flat.norm().hypot(a.alt_m - b.alt_m)
}

/// Positions no further apart than this are equal: far less than any message can carry, m.
const SAME_M: f64 = 1e-6;
/// Allocated for these at once; a route that needs more grows the buffer.
const VERTICES_A_LEG: usize = 16;
/// What the allowance must leave for the geometry, m.
const MIN_GEOMETRY_M: f64 = 1e-3;
/// A tolerance over this is a mistake, m.
const MAX_TOLERANCE_M: f64 = 10_000.0;
