//! A curved leg (50001, 50002) as the straight chords that a stock PX4 flies, within a proven tolerance.
//!
//! What a curve message means, and why the deviation is bounded, is in [`curve_paths`]. Here it gets its ends from the
//! waypoints, its altitudes a common reference, and its vertices become items of the waypoint that it leads to.

pub use curve_paths::flight::Policy;

use curve_paths::flight::{Airframe, FixedWing, Multicopter, plan_flight};
use curve_paths::{BezierLeg, Control, Options, Position, densify};
use stanag_msgs::enums::AltitudeType;

use crate::altitude::{self, Level};
use crate::plan::Curve;
use crate::route::{Leg, Site};

/// How curved legs are flown: `vehicle.curve`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Curving {
    /// Largest planned deviation, m.
    pub tolerance_m: f64,
    /// What is done where the curve is too tight for the speed.
    pub policy: Policy,
}

impl Default for Curving {
    fn default() -> Self {
        Curving {
            tolerance_m: 1.0,
            policy: Policy::Slow,
        }
    }
}

/// A curved leg as chords.
#[derive(Debug, Clone, PartialEq)]
pub struct Chords {
    /// The vertices between P1 and P4, and the speed from each on where it changes there.
    pub vertices: Vec<Chord>,
    /// The speed from P1 on, where it differs from the wished one.
    pub speed_at_start_m_s: Option<f64>,
    /// Acceptance radius for all vertices and both ends, m.
    pub acceptance_m: f32,
    /// The speed was lowered somewhere and must be set again after P4.
    pub slowed: bool,
    /// A station that draws the cubic in latitude and longitude shows another line.
    pub reads_differently: bool,
}

/// One vertex of it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Chord {
    /// Degrees north.
    pub latitude: f64,
    /// Degrees east.
    pub longitude: f64,
    /// Its altitude, in the reference of both ends.
    pub level: Level,
    /// The speed from there on, m/s, where it changes.
    pub speed_m_s: Option<f64>,
}

/// A curve that cannot be flown.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum CurveError {
    /// A field that cannot be done without.
    #[error("{0} is missing")]
    Missing(&'static str),
    /// Its altitude has no usable reference.
    #[error(transparent)]
    Altitude(#[from] altitude::AltitudeError),
    /// A number is not finite, a control point too far away, and so on.
    #[error("{0}")]
    Shape(String),
}

/// Makes the chords of the curve from `p1` to `p4`, flown at `speed_m_s`.
///
/// # Errors
/// A field is missing or not finite, a control point is over 50 km from its end, or the curve is too tight.
pub fn chords(
    p1: &Leg,
    p4: &Leg,
    curve: &Curve,
    speed_m_s: f64,
    site: &Site,
) -> Result<Chords, CurveError> {
    let above_home = matches!(
        (p1.level, p4.level),
        (Level::AboveHome(_), Level::AboveHome(_))
    );
    let metres = |level: Level| {
        level.amsl(site.home.amsl_m) - if above_home { site.home.amsl_m } else { 0.0 }
    };
    let (p2, p3) = controls(curve, site, &metres)?;
    let position = |leg: &Leg| Position::new(leg.latitude, leg.longitude, metres(leg.level));
    let leg = BezierLeg::new(position(p1), p2, p3, position(p4))
        .map_err(|fault| CurveError::Shape(fault.to_string()))?;
    let shape = |fault: &dyn std::fmt::Display| CurveError::Shape(fault.to_string());
    let legs = [curve_paths::Leg::Bezier(leg)];
    let tolerance_m = site.curving.tolerance_m;
    let densified = densify(&legs, &Options::flight(tolerance_m)).map_err(|fault| shape(&fault))?;
    let airframe = if site.hovers {
        Airframe::Multicopter(Multicopter::default())
    } else {
        Airframe::FixedWing(FixedWing::default())
    };
    let flown = plan_flight(&legs, &densified, &airframe, speed_m_s, site.curving.policy)
        .map_err(|fault| shape(&fault))?;
    let speed_at = |vertex: usize| {
        let change = flown
            .changes
            .iter()
            .find(|change| change.vertex == vertex)?;
        Some(change.speed_mps)
    };
    let last = densified.vertices.len().saturating_sub(1);
    let vertices = densified
        .vertices
        .iter()
        .enumerate()
        .take(last)
        .skip(1)
        .map(|(index, vertex)| {
            let Position {
                lat_deg,
                lon_deg,
                alt_m,
            } = vertex.position;
            let level = if above_home {
                Level::AboveHome(alt_m)
            } else {
                Level::Amsl(alt_m)
            };
            Chord {
                latitude: lat_deg,
                longitude: lon_deg,
                level,
                speed_m_s: speed_at(index),
            }
        });
    // Under 2 m a multicopter can miss a vertex for good; over half a chord it would skip one.
    let acceptance_m =
        (0.5 * densified.shortest_chord_m).clamp(LEAST_ACCEPTANCE_M, MOST_ACCEPTANCE_M) as f32;
    Ok(Chords {
        vertices: vertices.collect(),
        speed_at_start_m_s: speed_at(0),
        acceptance_m,
        slowed: !flown.changes.is_empty(),
        reads_differently: leg.reads_differently(tolerance_m),
    })
}

fn controls(
    curve: &Curve,
    site: &Site,
    metres: &dyn Fn(Level) -> f64,
) -> Result<(Control, Control), CurveError> {
    match curve {
        Curve::Paper(curve) => {
            // 50001 carries radians as doubles.
            let point =
                |latitude: Option<f64>, longitude: Option<f64>, names: [&'static str; 2]| {
                    let latitude = latitude.ok_or(CurveError::Missing(names[0]))?;
                    let longitude = longitude.ok_or(CurveError::Missing(names[1]))?;
                    Ok::<_, CurveError>(Control::level(
                        latitude.to_degrees(),
                        longitude.to_degrees(),
                    ))
                };
            Ok((
                point(
                    curve.p2_latitude,
                    curve.p2_longitude,
                    ["P2 Latitude", "P2 Longitude"],
                )?,
                point(
                    curve.p3_latitude,
                    curve.p3_longitude,
                    ["P3 Latitude", "P3 Longitude"],
                )?,
            ))
        }
        Curve::Native(curve) => {
            let altitude = |altitude: Option<stanag_msgs::scalar::Altitude>,
                            kind: Option<AltitudeType>| {
                let Some(altitude) = altitude else {
                    return Ok(None);
                };
                let level =
                    altitude::level(altitude.si(), kind, site.geoid_m, site.agl, site.altimeter)?;
                Ok::<_, CurveError>(Some(metres(level)))
            };
            let degrees = |bam: Option<stanag_msgs::Bam32>, name| {
                bam.map(|bam| bam.degrees())
                    .ok_or(CurveError::Missing(name))
            };
            Ok((
                Control {
                    lat_deg: degrees(curve.p2_latitude, "P2 Latitude")?,
                    lon_deg: degrees(curve.p2_longitude, "P2 Longitude")?,
                    alt_m: altitude(curve.p2_altitude, curve.altitude_type)?,
                },
                Control {
                    lat_deg: degrees(curve.p3_latitude, "P3 Latitude")?,
                    lon_deg: degrees(curve.p3_longitude, "P3 Longitude")?,
                    alt_m: altitude(curve.p3_altitude, curve.altitude_type)?,
                },
            ))
        }
    }
}

/// Acceptance radii, m.
const LEAST_ACCEPTANCE_M: f64 = 2.0;
const MOST_ACCEPTANCE_M: f64 = 3.0;
