//! From a densified route and a requested speed to what will be flown: findings, speed changes, time, deviation.

use thiserror::Error;

use super::curvature::tightest;
use super::deviation::{FlownItem, flown_bound_m};
use super::vehicle::{Airframe, LEVEL_M};
use crate::densify::Leg;
use crate::walk::{Densified, Vertex};
use crate::wgs84::Position;

/// What to do at a place that is too tight for the speed.
#[derive(Clone, Copy, Debug, Default, Eq, PartialEq)]
pub enum Policy {
    /// Fly it slower: a speed change before, another after.
    #[default]
    Slow,
    /// Refuse the route.
    Refuse,
}

/// A place that is too tight for the requested speed.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Tight {
    /// The leg, from 0.
    pub leg: usize,
    /// The parameter in it.
    pub t: f64,
    /// Where that is.
    pub position: Position,
    /// Radius of the ground track there, m.
    pub radius_m: f64,
    /// The fastest legal speed there, m/s.
    pub fastest_mps: f64,
}

/// A change of the commanded speed.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SpeedChange {
    /// It takes effect on reaching this vertex of the densified route.
    pub vertex: usize,
    /// The speed from there on, m/s.
    pub speed_mps: f64,
}

/// How a route will be flown.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct FlightPlan {
    /// The places that are too tight for the requested speed: the worst one of each run of chords.
    pub tight: Vec<Tight>,
    /// The fastest speed that the whole route allows, m/s: infinite for straight legs only.
    pub fastest_mps: f64,
    /// Speed changes in order of their vertices; none where one speed is requested for all legs and possible throughout.
    pub changes: Vec<SpeedChange>,
    /// Time for the chords at those speeds, limited by the speed that the autopilot allows itself on each chord, s.
    pub time_s: f64,
    /// The part of it on curved legs, s.
    pub curves_s: f64,
    /// Within this deviation its curves are flown, m ([`flown_bound_m`]); none without curves, and for wings in a wind that
    /// is too strong for the speed.
    pub predicted_deviation_m: Option<f64>,
    /// The slowest chord by the autopilot's own rule, m/s: a tight tolerance makes short chords and slow flight.
    pub slowest_chord_mps: f64,
}

/// Why a route cannot be flown under a policy.
#[derive(Clone, Copy, Debug, Error, PartialEq)]
pub enum NotFlyable {
    /// A turn is too tight for the requested speed, and the policy is to refuse.
    #[error(
        "leg {leg} at t = {t:.3} ({lat:.7}, {lon:.7}): radius {radius_m:.1} m, {speed_mps} m/s asked for, at most {fastest_mps:.1} m/s",
        leg = .0.leg, t = .0.t, lat = .0.position.lat_deg, lon = .0.position.lon_deg, radius_m = .0.radius_m,
        speed_mps = .1, fastest_mps = .0.fastest_mps
    )]
    TooFast(Tight, f64),
    /// A turn is too tight for the slowest speed that the aircraft flies.
    #[error(
        "leg {leg} at t = {t:.3} ({lat:.7}, {lon:.7}): radius {radius_m:.1} m allows {fastest_mps:.1} m/s, the slowest is {slowest_mps} m/s",
        leg = .0.leg, t = .0.t, lat = .0.position.lat_deg, lon = .0.position.lon_deg, radius_m = .0.radius_m,
        fastest_mps = .0.fastest_mps, slowest_mps = .1
    )]
    TooTight(Tight, f64),
    /// A multicopter is too fast on a climbing curve to be at the altitude of its items in time ([`climbing_mps`]).
    #[error(
        "leg {leg} climbs or descends, at {speed_mps} m/s: its shortest chord of {chord_m:.1} m allows {fastest_mps:.1} m/s"
    )]
    ClimbsTooFast {
        /// The leg, from 0.
        leg: usize,
        /// The wished speed, m/s.
        speed_mps: f64,
        /// The shortest chord, m.
        chord_m: f64,
        /// The fastest speed that it allows, m/s.
        fastest_mps: f64,
    },
    /// The speed is out of range.
    #[error("speed is {speed_mps} m/s, expected more than 0 and at most 200")]
    Speed {
        /// The requested speed, m/s.
        speed_mps: f64,
    },
}

/// Plans the flight of a densified route at requested speeds: one for each leg, the last of them for those behind it too.
///
/// Each curved leg is planned for itself, as the bridge makes its mission leg by leg: the aircraft brakes on the curve, from its
/// first point on at the earliest. What a faster leg before costs is in the predicted deviation.
///
/// # Errors
/// When a speed is out of range; a turn is too tight, or a multicopter too fast on a climbing curve, under
/// [`Policy::Refuse`]; or a turn is too tight for the slowest speed.
pub fn plan_flight(
    legs: &[Leg],
    densified: &Densified,
    airframe: &Airframe,
    speeds_mps: &[f64],
    policy: Policy,
) -> Result<FlightPlan, NotFlyable> {
    let last_mps = speeds_mps.last().copied().unwrap_or(f64::NAN);
    let mut each = speeds_mps.iter().copied().chain([last_mps]);
    if let Some(speed_mps) = each.find(|speed_mps| !(*speed_mps > 0.0 && *speed_mps <= 200.0)) {
        return Err(NotFlyable::Speed { speed_mps });
    }
    let requested_mps = |leg: usize| speeds_mps.get(leg).copied().unwrap_or(last_mps);
    let chords = chords(legs, densified, airframe);
    let mut plan = FlightPlan {
        fastest_mps: f64::INFINITY,
        slowest_chord_mps: f64::INFINITY,
        ..Default::default()
    };
    let wished = wished(legs, densified, &chords, airframe, requested_mps, policy)?;
    let mut run: Option<Tight> = None;
    for (chord, &speed_mps) in chords.iter().zip(&wished) {
        plan.fastest_mps = plan.fastest_mps.min(chord.fastest_mps());
        plan.slowest_chord_mps = plan.slowest_chord_mps.min(chord.autopilot_mps);
        match chord.tight.filter(|t| t.fastest_mps < speed_mps) {
            Some(tight) => {
                check(&tight, airframe, speed_mps, policy)?;
                run = Some(
                    run.filter(|r| r.fastest_mps <= tight.fastest_mps)
                        .unwrap_or(tight),
                );
            }
            None => plan.tight.extend(run.take()),
        }
    }
    plan.tight.extend(run);
    let speeds = speeds(&chords, &wished, braking(airframe));
    let first_mps = requested_mps(0);
    let mut now = first_mps;
    for (k, &speed) in speeds.iter().enumerate() {
        if speed != now {
            plan.changes.push(SpeedChange {
                vertex: k,
                speed_mps: speed,
            });
            now = speed;
        }
        let chord_s = chords[k].length_m / speed.min(chords[k].autopilot_mps);
        plan.time_s += chord_s;
        if chords[k].tight.is_some() {
            plan.curves_s += chord_s;
        }
    }
    // The route's last vertex restores the requested speed, which holds for what follows.
    let speed_mps = chords
        .last()
        .map_or(first_mps, |chord| requested_mps(chord.leg));
    if now != speed_mps {
        plan.changes.push(SpeedChange {
            vertex: chords.len(),
            speed_mps,
        });
    }
    let items = items(legs, densified, &speeds, first_mps);
    plan.predicted_deviation_m = flown_bound_m(&items, densified.bound_m, airframe);
    Ok(plan)
}

/// The vertices as the items of a mission, with the acceptance radius of chords.
fn items(legs: &[Leg], densified: &Densified, speeds: &[f64], first_mps: f64) -> Vec<FlownItem> {
    let acceptance_m = chord_acceptance_m(densified.shortest_chord_m);
    let vertices = densified.vertices.iter().enumerate();
    vertices
        .map(|(k, vertex)| FlownItem {
            position: vertex.position,
            speed_mps: *speeds.get(k.max(1) - 1).unwrap_or(&first_mps),
            acceptance_m,
            curved: k > 0 && matches!(legs.get(vertex.leg), Some(Leg::Bezier(_))),
        })
        .collect()
}

/// The acceptance radius of chords, m, by the shortest of them: under 2 m a multicopter can miss a vertex for good,
/// since PX4 does not test whether a waypoint was passed; over half a chord it would skip one.
#[must_use]
pub fn chord_acceptance_m(shortest_chord_m: f64) -> f64 {
    (0.5 * shortest_chord_m).clamp(MIN_ACCEPTANCE_M, MAX_ACCEPTANCE_M)
}

/// Whether PX4 sees these vertices at different altitudes.
#[must_use]
pub fn climbs(vertices: &[Vertex]) -> bool {
    let rise_m = |pair: &[Vertex]| (pair[1].position.alt_m - pair[0].position.alt_m).abs();
    !vertices.windows(2).all(|pair| rise_m(pair) <= LEVEL_M)
}

/// The speed, at most the wished one, at which a multicopter that swings about its altitude still reaches each item of a
/// climbing curve: it must stay within the acceptance radius, half a chord at most, for as long as the swing exceeds the
/// vertical one. Rounded down to tenths where it is slower than wished.
#[must_use]
pub fn climbing_mps(wished_mps: f64, shortest_chord_m: f64) -> f64 {
    let fastest_mps = shortest_chord_m / CURVE_SWING_S;
    if wished_mps <= fastest_mps {
        wished_mps
    } else {
        tenths(fastest_mps)
    }
}

/// Whole tenths, downwards: the resolution used for a DO_CHANGE_SPEED.
fn tenths(speed_mps: f64) -> f64 {
    (speed_mps * 10.0).floor() * 0.1
}

/// The speed of each chord as far as turns do not matter: a multicopter flies a climbing curve no faster than its shortest
/// chord allows.
fn wished(
    legs: &[Leg],
    densified: &Densified,
    chords: &[Chord],
    airframe: &Airframe,
    requested_mps: impl Fn(usize) -> f64,
    policy: Policy,
) -> Result<Vec<f64>, NotFlyable> {
    let each = chords.iter().map(|chord| requested_mps(chord.leg));
    let mut wished: Vec<f64> = each.collect();
    if let Airframe::FixedWing(_) = airframe {
        return Ok(wished);
    }
    // Chord k leads to vertex k + 1, whose leg it belongs to.
    let ends = densified.vertices.get(1..).unwrap_or_default();
    let mut first = 0;
    for run in ends.chunk_by(|a, b| a.leg == b.leg) {
        let (leg, from, to) = (run[0].leg, first, first + run.len());
        first = to;
        let curved = matches!(legs.get(leg), Some(Leg::Bezier(_)));
        if !curved || !climbs(&densified.vertices[from..=to]) {
            continue;
        }
        let lengths = chords[from..to].iter().map(|chord| chord.length_m);
        let chord_m = lengths.fold(f64::INFINITY, f64::min);
        let speed_mps = requested_mps(leg);
        let slow_mps = climbing_mps(speed_mps, chord_m);
        if slow_mps >= speed_mps {
            continue;
        }
        if policy == Policy::Refuse || slow_mps <= 0.0 {
            return Err(NotFlyable::ClimbsTooFast {
                leg,
                speed_mps,
                chord_m,
                fastest_mps: chord_m / CURVE_SWING_S,
            });
        }
        wished[from..to].fill(slow_mps);
    }
    Ok(wished)
}

fn check(
    tight: &Tight,
    airframe: &Airframe,
    speed_mps: f64,
    policy: Policy,
) -> Result<(), NotFlyable> {
    if policy == Policy::Refuse {
        return Err(NotFlyable::TooFast(*tight, speed_mps));
    }
    match airframe {
        Airframe::FixedWing(f) if tight.fastest_mps < f.slowest_mps => {
            Err(NotFlyable::TooTight(*tight, f.slowest_mps))
        }
        _ => Ok(()),
    }
}

struct Chord {
    leg: usize,
    length_m: f64,
    tight: Option<Tight>,
    /// The speed to which PX4 limits itself on the chord, m/s.
    autopilot_mps: f64,
}

impl Chord {
    fn fastest_mps(&self) -> f64 {
        self.tight.map_or(f64::INFINITY, |t| t.fastest_mps)
    }
}

fn chords(legs: &[Leg], densified: &Densified, airframe: &Airframe) -> Vec<Chord> {
    densified
        .vertices
        .windows(2)
        .map(|pair| {
            let length_m = pair[0]
                .position
                .ground()
                .distance_m(pair[1].position.ground());
            let tight = match legs.get(pair[1].leg) {
                Some(Leg::Bezier(leg)) => {
                    let a = if pair[0].leg == pair[1].leg {
                        pair[0].t
                    } else {
                        0.0
                    };
                    let found = tightest(leg, a, pair[1].t);
                    let fastest_mps = match airframe {
                        Airframe::FixedWing(f) => f.fastest_mps(found.radius_m),
                        Airframe::Multicopter(m) => {
                            m.fastest_mps(found.radius_m, found.curvature_rate)
                        }
                    };
                    Some(Tight {
                        leg: pair[1].leg,
                        t: found.t,
                        position: found.position,
                        radius_m: found.radius_m,
                        fastest_mps: fastest_mps.max(CRAWL_MPS),
                    })
                }
                _ => None,
            };
            let autopilot_mps = match airframe {
                Airframe::FixedWing(_) => f64::INFINITY,
                Airframe::Multicopter(m) => m.on_chord_mps(length_m).max(CRAWL_MPS),
            };
            Chord {
                leg: pair[1].leg,
                length_m,
                tight,
                autopilot_mps,
            }
        })
        .collect()
}

/// The speed of each chord: what it allows where that is less than wished, one speed for each run of such chords of a leg, and
/// the same speed on those of that leg before it that braking takes.
fn speeds(chords: &[Chord], wished: &[f64], braking: f64) -> Vec<f64> {
    let mut speeds = wished.to_vec();
    let allows = |k: usize| chords[k].fastest_mps() >= wished[k];
    let mut k = 0;
    while k < chords.len() {
        if allows(k) {
            k += 1;
            continue;
        }
        let leg = chords[k].leg;
        let end = (k..chords.len())
            .find(|&j| allows(j) || chords[j].leg != leg)
            .unwrap_or(chords.len());
        let slowest = chords[k..end]
            .iter()
            .map(Chord::fastest_mps)
            .fold(f64::INFINITY, f64::min);
        let slow = tenths(slowest).max(CRAWL_MPS);
        let mut needed_m = (wished[k] * wished[k] - slow * slow) / (2.0 * braking);
        let mut first = k;
        while first > 0 && chords[first - 1].leg == leg && needed_m > 0.0 {
            first -= 1;
            needed_m -= chords[first].length_m;
        }
        speeds[first..end].iter_mut().for_each(|s| *s = s.min(slow));
        k = end;
    }
    speeds
}

/// Deceleration to plan with, m/s^2: half of what the airframe can do.
fn braking(airframe: &Airframe) -> f64 {
    match airframe {
        Airframe::FixedWing(_) => 0.5,
        Airframe::Multicopter(m) => (0.5 * m.acceleration).max(0.1),
    }
}

/// Acceptance radii of chords, m.
pub const MIN_ACCEPTANCE_M: f64 = 2.0;
const MAX_ACCEPTANCE_M: f64 = 3.0;
/// How long a swing about the altitude takes at the points of a climbing curve, which are flown slowly, s: for up to 2.7 s of
/// each PX4 v1.18 is further off than NAV_MC_ALT_RAD (0.8 m), and never accepts a waypoint that it passes meanwhile.
pub const CURVE_SWING_S: f64 = 3.0;
/// No place is flown slower than this, m/s: at a cusp a multicopter all but stops and turns.
const CRAWL_MPS: f64 = 0.5;
