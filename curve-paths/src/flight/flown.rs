//! Compares a flown track with its route: how far it deviated, and which points of the route it passed.
//!
//! Promised: only the part between the route's start and end counts, wherever the track begins and ends. Distances
//! are in three dimensions, against the curves themselves and not their chords, and both ways: a vehicle that cuts a
//! bend is near the route everywhere, but the bend is far from its track.

use crate::densify::Leg;
use crate::vector::Vec3;
use crate::walk::Densified;
use crate::wgs84::{Position, east_north, up};

/// A comparison of a flown track with its route.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Flown {
    /// Greatest distance of the track from the route and of the route from the track, m.
    pub deviation_m: f64,

    /// Points of the densified route.
    pub points: usize,
    /// How many of them the track passes within the given distance.
    pub passed: usize,
    /// The samples of the track that count: the first, and the one after the last.
    pub part: (usize, usize),
}

/// Measures a flown track against the legs of a route; a point is passed within `within_m`.
///
/// `None` if the track never comes near the start or the end of the route, or reaches the end before the start.
#[must_use]
pub fn measure(
    legs: &[Leg],
    densified: &Densified,
    track: &[Position],
    within_m: f64,
) -> Option<Flown> {
    let flat = Flat::around(legs.first()?.start());
    let flown: Vec<Vec3> = track.iter().map(|p| flat.of(*p)).collect();
    let (start, end) = (flat.of(legs.first()?.start()), flat.of(legs.last()?.end()));
    let near_m = within_m.max(NEAR_M);
    let enters = flown.iter().position(|p| (*p - start).norm() <= near_m)?;
    let leaves = flown.iter().rposition(|p| (*p - end).norm() <= near_m)?;
    // From there to the nearest sample: the approach to the start is not part of the route.
    let first = (enters..flown.len())
        .take_while(|&k| (flown[k] - start).norm() <= near_m)
        .min_by(|&a, &b| {
            (flown[a] - start)
                .norm()
                .total_cmp(&(flown[b] - start).norm())
        })?;
    let last = (0..=leaves)
        .rev()
        .take_while(|&k| (flown[k] - end).norm() <= near_m)
        .min_by(|&a, &b| (flown[a] - end).norm().total_cmp(&(flown[b] - end).norm()))?;
    let part = flown.get(first..=last)?;
    let route = samples(legs, densified, &flat);
    let to_line = |p: Vec3, line: &[Vec3]| {
        line.windows(2)
            .map(|s| to_segment(p, s[0], s[1]))
            .fold(f64::INFINITY, f64::min)
    };
    let farthest = |points: &[Vec3], line: &[Vec3]| {
        let off_m = points.iter().map(|p| to_line(*p, line));
        off_m.fold(0.0, f64::max)
    };
    let deviation_m = farthest(part, &route).max(farthest(&route, part));
    let points = densified.vertices.iter().map(|v| flat.of(v.position));
    let passed = points.filter(|p| to_line(*p, part) <= within_m).count();
    Some(Flown {
        deviation_m,
        points: densified.vertices.len(),
        passed,
        part: (first, last + 1),
    })
}

/// The route itself, sampled within each chord.
fn samples(legs: &[Leg], densified: &Densified, flat: &Flat) -> Vec<Vec3> {
    let mut out: Vec<Vec3> = legs
        .first()
        .map(|l| flat.of(l.start()))
        .into_iter()
        .collect();
    for pair in densified.vertices.windows(2) {
        let a = if pair[0].leg == pair[1].leg {
            pair[0].t
        } else {
            0.0
        };
        match legs.get(pair[1].leg) {
            Some(Leg::Bezier(leg)) => out.extend((1..=SAMPLES).map(|k| {
                let f = f64::from(k) / f64::from(SAMPLES);
                flat.of(leg.at(a + (pair[1].t - a) * f))
            })),
            Some(Leg::Straight { to, .. }) => out.push(flat.of(*to)),
            None => {}
        }
    }
    out
}

fn to_segment(p: Vec3, a: Vec3, b: Vec3) -> f64 {
    let (d, e) = (b - a, p - a);
    let l2 = d.norm2();
    let f = if l2 > 0.0 {
        (e.dot(d) / l2).clamp(0.0, 1.0)
    } else {
        0.0
    };
    (e - d * f).norm()
}

/// A horizontal plane at a place: it shortens distances by less than a millionth within some kilometres.
struct Flat {
    origin: Vec3,
    east: Vec3,
    north: Vec3,
}

impl Flat {
    fn around(place: Position) -> Self {
        let origin = place.ground().to_ecef();
        let (east, north) = east_north(up(origin));
        Self {
            origin,
            east,
            north,
        }
    }

    fn of(&self, p: Position) -> Vec3 {
        let q = p.ground().to_ecef() - self.origin;
        Vec3::new(q.dot(self.east), q.dot(self.north), p.alt_m)
    }
}

/// A track that is never within this distance of an end of the route has not flown it, m.
const NEAR_M: f64 = 12.0;
/// Samples for each chord of a curved leg.
const SAMPLES: u32 = 16;
