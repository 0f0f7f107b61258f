//! A curved leg (50001, 50002) as the straight chords that a stock PX4 flies, within a proven tolerance.
//!
//! What a curve message means, and why the deviation is bounded, is in [`curve_paths`]. Here it gets its ends from the
//! waypoints, its altitudes a common reference, and its vertices become items of the waypoint that it leads to.

pub use curve_paths::Vertices;
pub use curve_paths::flight::{FixedWing, Multicopter, Policy};

use curve_paths::flight::{Airframe, plan_flight};
use curve_paths::{BezierLeg, Control, Densified, Options, Position, densify};
use stanag_msgs::enums::AltitudeType;

use crate::altitude::{self, Level};
use crate::configuration::Parameters;
use crate::plan::Curve;
use crate::route::{Leg, Site};

/// How curved legs are flown: `vehicle.curve`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Curving {
    /// Largest planned deviation, m.
    pub tolerance_m: f64,
    /// What is done where the curve is too tight for the speed.
    pub policy: Policy,
    /// Whether vertices may leave the curve by up to the tolerance.
    pub vertices: Vertices,
    /// What a vehicle that hovers can do.
    pub multicopter: Multicopter,
    /// What one that does not can do.
    pub fixed_wing: FixedWing,
}

impl Default for Curving {
    fn default() -> Self {
        Curving {
            tolerance_m: 1.0,
            policy: Policy::Slow,
            vertices: Vertices::OnCurve,
            multicopter: Multicopter::default(),
            fixed_wing: FixedWing::default(),
        }
    }
}

impl Curving {
    /// Takes over what the vehicle's own parameters say of it; what it has not told stays the default.
    pub fn know(&mut self, parameters: &Parameters) {
        let (quad, plane) = (&mut self.multicopter, &mut self.fixed_wing);
        for (known, name) in [
            (&mut quad.acceleration, "MPC_ACC_HOR"),
            (&mut quad.jerk, "MPC_JERK_AUTO"),
            (&mut quad.climb_mps, "MPC_Z_V_AUTO_UP"),
            (&mut quad.descent_mps, "MPC_Z_V_AUTO_DN"),
            (&mut plane.slowest_mps, "FW_AIRSPD_MIN"),
        ] {
            *known = parameters.above_zero(name).unwrap_or(*known);
        }
    }
}

/// What was made of the curved legs of a route.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Curved {
    /// Curved legs.
    pub legs: usize,
    /// The chords that they are flown by.
    pub chords: usize,
    /// The tolerance that the chords were made with, m: the configured one, or the smallest that the items allow.
    pub tolerance_m: f64,
    /// Proven deviation of the chords from the curves, both ways, m.
    pub bound_m: f64,
    /// Forecast of the flown deviation, m, never a promise; none for a fixed wing.
    pub predicted_m: Option<f64>,
    /// Forecast of the time that the curved legs take, s.
    pub time_s: f64,
}

impl Curved {
    /// With the chords of one more leg.
    pub(crate) fn and(before: Option<Self>, chords: &Chords, tolerance_m: f64) -> Self {
        let so_far = before.unwrap_or(Self {
            legs: 0,
            chords: 0,
            tolerance_m,
            bound_m: 0.0,
            predicted_m: Some(0.0),
            time_s: 0.0,
        });
        Self {
            legs: so_far.legs + 1,
            chords: so_far.chords + chords.vertices.len() + 1,
            tolerance_m,
            bound_m: so_far.bound_m.max(chords.bound_m),
            predicted_m: so_far
                .predicted_m
                .zip(chords.predicted_m)
                .map(|(a, b)| a.max(b)),
            time_s: so_far.time_s + chords.time_s,
        }
    }

    /// What an operator is told of it.
    pub(crate) fn note(&self, wished_m: f64, items: usize) -> String {
        let Self {
            legs,
            chords,
            tolerance_m,
            bound_m,
            time_s,
            ..
        } = self;
        let mut text = format!(
            "{legs} curved legs in {chords} chords, proven within {bound_m:.2} m, {time_s:.0} s"
        );
        if let Some(predicted_m) = self.predicted_m {
            text += &format!("; flown within {predicted_m:.1} m, predicted and not promised");
        }
        if *tolerance_m > wished_m {
            text += &format!(
                "; tolerance {tolerance_m:.2} m, not {wished_m} m: the smallest that {items} items allow"
            );
        }
        text
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
    /// A vehicle that hovers climbs or descends along it.
    pub climbs: bool,
    /// The speed was lowered somewhere and must be set again after P4.
    pub slowed: bool,
    /// A station that draws the cubic in latitude and longitude shows another line.
    pub reads_differently: bool,
    /// Proven deviation of the chords, m.
    pub bound_m: f64,
    /// Forecast of the flown deviation, m.
    pub predicted_m: Option<f64>,
    /// Forecast of the time, s.
    pub time_s: f64,
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
    let options = Options {
        vertices: site.curving.vertices,
        ..Options::flight(tolerance_m)
    };
    let densified = densify(&legs, &options).map_err(|fault| shape(&fault))?;
    let airframe = if site.hovers {
        Airframe::Multicopter(site.curving.multicopter)
    } else {
        Airframe::FixedWing(site.curving.fixed_wing)
    };
    let climbs = site.hovers && !is_level(&densified);
    let wished_m_s = speed_m_s;
    let speed_m_s = if climbs {
        climbing_speed(wished_m_s, &densified, site.curving.policy)?
    } else {
        wished_m_s
    };
    let flown = plan_flight(&legs, &densified, &airframe, speed_m_s, site.curving.policy)
        .map_err(|fault| shape(&fault))?;
    let speed_at = |vertex: usize| {
        let change = flown.changes.iter().find(|change| change.vertex == vertex);
        change.map(|change| change.speed_mps)
    };
    let slower = (speed_m_s < wished_m_s).then_some(speed_m_s);
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
    let half_m = 0.5 * densified.shortest_chord_m;
    // Under 2 m a multicopter can miss a vertex for good; over half a chord it would skip one.
    let mut acceptance_m = half_m.clamp(MIN_ACCEPTANCE_M, MAX_ACCEPTANCE_M);
    let mut predicted_m = flown.predicted_deviation_m;
    if climbs {
        let wider_m = (0.5 * SWING_S * speed_m_s).clamp(acceptance_m, half_m.max(acceptance_m));
        // It turns so much earlier.
        let cut_m = 0.5 * (wider_m - acceptance_m) * sharpest_turn(&densified);
        predicted_m = predicted_m.map(|m| m + cut_m);
        acceptance_m = wider_m;
    }
    Ok(Chords {
        vertices: vertices.collect(),
        speed_at_start_m_s: speed_at(0).or(slower),
        acceptance_m: acceptance_m as f32,
        climbs,
        slowed: slower.is_some() || !flown.changes.is_empty(),
        reads_differently: leg.reads_differently(tolerance_m),
        bound_m: densified.bound_m,
        predicted_m,
        time_s: flown.time_s,
    })
}

/// Whether all its vertices are at one altitude, as PX4 sees it.
fn is_level(densified: &Densified) -> bool {
    let altitudes = densified.vertices.windows(2);
    altitudes
        .map(|pair| (pair[1].position.alt_m - pair[0].position.alt_m).abs())
        .all(|rise_m| rise_m <= LEVEL_M)
}

/// The speed at which a vehicle that swings about the altitude of its item is still taken at each: it must stay within
/// the acceptance radius, half a chord at most, for as long as a swing takes it out of the vertical one.
fn climbing_speed(
    wished_m_s: f64,
    densified: &Densified,
    policy: Policy,
) -> Result<f64, CurveError> {
    let fastest_m_s = densified.shortest_chord_m / SWING_S;
    if wished_m_s <= fastest_m_s {
        return Ok(wished_m_s);
    }
    match policy {
        // Whole tenths, downwards: that is what a DO_CHANGE_SPEED should say.
        Policy::Slow => Ok((fastest_m_s * 10.0).floor() * 0.1),
        Policy::Refuse => Err(CurveError::ClimbsTooFast {
            speed_m_s: wished_m_s,
            chord_m: densified.shortest_chord_m,
            fastest_m_s,
        }),
    }
}

/// The greatest change of heading from one chord to the next, rad.
fn sharpest_turn(densified: &Densified) -> f64 {
    let places: Vec<_> = densified
        .vertices
        .iter()
        .map(|vertex| vertex.position.ground().to_ecef())
        .collect();
    let turn = |at: &[curve_paths::vector::Vec3]| {
        let (before, after) = ((at[1] - at[0]).unit(), (at[2] - at[1]).unit());
        before.dot(after).clamp(-1.0, 1.0).acos()
    };
    places.windows(3).map(turn).fold(0.0, f64::max)
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
pub(crate) const MIN_ACCEPTANCE_M: f64 = 2.0;
const MAX_ACCEPTANCE_M: f64 = 3.0;
/// PX4 v1.18 swings about the altitude of an item where the next one's is another: up to 2.7 s of each swing it is
/// further off than NAV_MC_ALT_RAD (0.8 m), and takes no waypoint that it passes meanwhile, for good.
pub(crate) const SWING_S: f64 = 3.0;
/// Altitudes this close are one to PX4, m.
const LEVEL_M: f64 = 1e-3;
