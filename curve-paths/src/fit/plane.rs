//! The plane that a track is fitted in: the projection along the vertical at its middle, and cubics in it.
//!
//! Earth-centred cubics stay cubics under this projection, control point by control point; only the depth of a leg
//! under the ground makes a difference, which is its sag times the lean of the vertical: 0.01 mm on a track of 4 km.

use std::ops::{Add, Mul, Sub};

use crate::vector::Vec3;
use crate::wgs84::{Ground, east_north, on_ground, up};

/// A point or offset in the plane, m.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct Vec2 {
    pub(crate) x: f64,
    pub(crate) y: f64,
}

impl Vec2 {
    pub(crate) const fn new(x: f64, y: f64) -> Self {
        Self { x, y }
    }

    #[inline]
    pub(crate) fn dot(self, o: Self) -> f64 {
        self.x * o.x + self.y * o.y
    }

    #[inline]
    pub(crate) fn cross(self, o: Self) -> f64 {
        self.x * o.y - self.y * o.x
    }

    #[inline]
    pub(crate) fn norm2(self) -> f64 {
        self.dot(self)
    }

    #[inline]
    pub(crate) fn norm(self) -> f64 {
        self.norm2().sqrt()
    }

    pub(crate) fn unit(self) -> Self {
        let n = self.norm();
        if n > 0.0 {
            self * (1.0 / n)
        } else {
            Self::new(1.0, 0.0)
        }
    }

    #[inline]
    pub(crate) fn lerp(self, o: Self, f: f64) -> Self {
        self + (o - self) * f
    }

    /// Squared distance to the segment from `a` to `b`.
    #[inline]
    pub(crate) fn to_segment2(self, a: Self, b: Self) -> f64 {
        let (d, e) = (b - a, self - a);
        let l2 = d.norm2();
        let t = if l2 > 0.0 {
            (e.dot(d) / l2).clamp(0.0, 1.0)
        } else {
            0.0
        };
        (e - d * t).norm2()
    }
}

impl Add for Vec2 {
    type Output = Self;
    #[inline]
    fn add(self, o: Self) -> Self {
        Self::new(self.x + o.x, self.y + o.y)
    }
}

impl Sub for Vec2 {
    type Output = Self;
    #[inline]
    fn sub(self, o: Self) -> Self {
        Self::new(self.x - o.x, self.y - o.y)
    }
}

impl Mul<f64> for Vec2 {
    type Output = Self;
    #[inline]
    fn mul(self, k: f64) -> Self {
        Self::new(self.x * k, self.y * k)
    }
}

/// A cubic in the plane.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Cubic2(pub(crate) [Vec2; 4]);

impl Cubic2 {
    #[inline]
    pub(crate) fn at(&self, t: f64) -> Vec2 {
        let [p0, p1, p2, p3] = self.0;
        let s = 1.0 - t;
        p0 * (s * s * s) + p1 * (3.0 * s * s * t) + p2 * (3.0 * s * t * t) + p3 * (t * t * t)
    }

    #[inline]
    pub(crate) fn derivative(&self, t: f64) -> Vec2 {
        let [p0, p1, p2, p3] = self.0;
        let s = 1.0 - t;
        (p1 - p0) * (3.0 * s * s) + (p2 - p1) * (6.0 * s * t) + (p3 - p2) * (3.0 * t * t)
    }

    #[inline]
    pub(crate) fn second_derivative(&self, t: f64) -> Vec2 {
        let [p0, p1, p2, p3] = self.0;
        (p2 - p1 * 2.0 + p0) * (6.0 * (1.0 - t)) + (p3 - p2 * 2.0 + p1) * (6.0 * t)
    }

    /// One safeguarded Newton step from `t` towards the parameter of the point nearest to `x`.
    #[inline]
    pub(crate) fn towards_foot(&self, t: f64, x: Vec2) -> f64 {
        let r = self.at(t) - x;
        let d = self.derivative(t);
        let d2 = d.norm2();
        let slope = d2 + r.dot(self.second_derivative(t));
        // Away from the nearest point Newton's slope can vanish or change sign; Gauss's never does.
        let slope = if slope > 0.3 * d2 { slope } else { d2 };
        if slope > 0.0 {
            (t - r.dot(d) / slope).clamp(0.0, 1.0)
        } else {
            t
        }
    }
}

/// The projection: the vertical at one point, and back to the ground.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Plane {
    origin: Vec3,
    east: Vec3,
    north: Vec3,
    up: Vec3,
}

impl Plane {
    pub(crate) fn at(middle: Ground) -> Self {
        let origin = middle.to_ecef();
        let up = up(origin);
        let (east, north) = east_north(up);
        Self {
            origin,
            east,
            north,
            up,
        }
    }

    pub(crate) fn project(&self, ground: Ground) -> Vec2 {
        let d = ground.to_ecef() - self.origin;
        Vec2::new(d.dot(self.east), d.dot(self.north))
    }

    /// The place on the ground that projects to `p`; none beyond the horizon.
    pub(crate) fn unproject(&self, p: Vec2) -> Option<Ground> {
        let foot = self.origin + self.east * p.x + self.north * p.y;
        on_ground(foot, self.up).map(Ground::from_ecef)
    }
}

// The two-sided deviation between a cubic and the polyline that it replaces. Measuring one side only is a pitfall: a
// curve through every fix can be metres off between them.

/// Greatest squared distance of the curve from the polyline of `points`, m^2. The nearest segment is searched around
/// the last one, so a curve that runs ahead or back along its track is measured too far, never too near.
pub(crate) fn curve_to_polyline2(cubic: &Cubic2, points: &[Vec2]) -> f64 {
    let n = 2 * points.len();
    let mut segment = 0;
    let mut worst2: f64 = 0.0;
    for k in 1..n {
        let x = cubic.at(k as f64 / n as f64);
        worst2 = worst2.max(nearest2(x, points, &mut segment));
    }
    worst2
}

/// Squared distance from `x` to the polyline near its segment `segment`, which moves along.
fn nearest2(x: Vec2, points: &[Vec2], segment: &mut usize) -> f64 {
    let first = segment.saturating_sub(BACK);
    let last = (*segment + AHEAD).min(points.len() - 2);
    let mut best = (f64::INFINITY, *segment);
    for k in first..=last {
        let d2 = x.to_segment2(points[k], points[k + 1]);
        if d2 < best.0 {
            best = (d2, k);
        }
    }
    *segment = best.1;
    best.0
}

/// The deviation both ways between a cubic and the polyline of `points`, m, from samples no further apart than
/// `spacing_m` on either; each against the other's own part.
pub(crate) fn two_sided_m(cubic: &Cubic2, points: &[Vec2], spacing_m: f64) -> f64 {
    let [p0, p1, p2, p3] = cubic.0;
    let polygon_m = (p1 - p0).norm() + (p2 - p1).norm() + (p3 - p2).norm();
    let n = ((3.0 * polygon_m / spacing_m).ceil() as usize).clamp(8, MAX_SAMPLES);
    let curve: Vec<Vec2> = (0..=n).map(|k| cubic.at(k as f64 / n as f64)).collect();
    one_sided2(&curve, points)
        .max(one_sided2(&resampled(points, spacing_m), &curve))
        .sqrt()
}

fn resampled(points: &[Vec2], spacing_m: f64) -> Vec<Vec2> {
    let mut out = Vec::new();
    for pair in points.windows(2) {
        let steps =
            (((pair[1] - pair[0]).norm() / spacing_m).ceil() as usize).clamp(1, MAX_SAMPLES);
        out.extend((0..steps).map(|k| pair[0].lerp(pair[1], k as f64 / steps as f64)));
    }
    out.extend(points.last());
    out
}

/// Greatest squared distance of any point of `from` from the polyline `to`; every segment is compared.
fn one_sided2(from: &[Vec2], to: &[Vec2]) -> f64 {
    let nearest = |x: &Vec2| {
        to.windows(2)
            .map(|s| x.to_segment2(s[0], s[1]))
            .fold(f64::INFINITY, f64::min)
    };
    from.iter().map(nearest).fold(0.0, f64::max)
}

/// Segments compared behind and ahead of the last nearest one.
const BACK: usize = 4;
const AHEAD: usize = 8;
/// Samples of one leg at most.
const MAX_SAMPLES: usize = 20_000;
