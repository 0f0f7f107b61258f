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
        // Away from the nearest point Newton's slope can vanish or turn; Gauss's never does.
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
