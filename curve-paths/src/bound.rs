//! How far a part of a cubic can be from its chord: proven, two-sided, nearly exact.
//!
//! For the part with control points q0..q3 and the chord c = q3 - q0 of length l, let w1, w2 be what is perpendicular
//! to the chord in q1 - q0 and q2 - q0, and s1, s2 their fractions along it. The perpendicular offset of the curve is
//! 3t(1-t)(w + (2t-1)m) with w = (w1+w2)/2 and m = (w2-w1)/2, so with r = |2t-1| its norm is at most
//! 3/4 (1-r^2)(|w| + r|m|), which is greatest at r = u = |m| / (|w| + sqrt(|w|^2 + 3|m|^2)). That is `offset`.
//! Along the chord every point of the curve is matched with the furthest advance so far, clamped to the chord. The
//! matching is monotone and runs from end to end, so the greatest matched distance bounds the Frechet distance, and
//! with it the Hausdorff distance in both directions. `lag` is the greatest difference along the chord; it is zero
//! where 0 <= s1 <= s2 <= 1.

use crate::cubic::Cubic;
use crate::vector::Vec3;

/// The two parts of the bound for one chord, m.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ChordBound {
    /// Greatest offset perpendicular to the chord: exact in the plane, an upper bound in space.
    pub offset_m: f64,
    /// Greatest difference along the chord between the curve and its match: backtracking and overshoot.
    pub lag_m: f64,
}

impl ChordBound {
    /// The bound for the part of a cubic from q0 to q0 + `v3`, whose inner control points are q0 + `v1`, q0 + `v2`.
    #[inline]
    #[must_use]
    pub fn new(v1: Vec3, v2: Vec3, v3: Vec3) -> Self {
        let l2 = v3.norm2();
        if l2 < NO_CHORD_M2 {
            // A part whose ends coincide: all of it lies within the hull of its control points around q0.
            let offset_m = v1.norm2().max(v2.norm2()).max(l2).sqrt();
            return Self {
                offset_m,
                lag_m: 0.0,
            };
        }
        // |w1 + w2| and |w2 - w1| by cross products with the chord: no cancellation, and no term waits for the division.
        let inverse = 1.0 / l2;
        let w_squared = 0.25 * (v1 + v2).cross(v3).norm2() * inverse;
        let m_squared = 0.25 * (v2 - v1).cross(v3).norm2() * inverse;
        let (w, m) = (w_squared.sqrt(), m_squared.sqrt());
        let below = w + (w_squared + 3.0 * m_squared).sqrt();
        let u = if below > 0.0 { m / below } else { 0.0 };
        let offset_m = 0.75 * (1.0 - u * u) * (w + u * m);
        let (along1, along2) = (v1.dot(v3), v2.dot(v3));
        let lag_m = if 0.0 <= along1 && along1 <= along2 && along2 <= l2 {
            0.0
        } else {
            lag(along1 * inverse, along2 * inverse) * l2.sqrt()
        };
        Self { offset_m, lag_m }
    }

    /// A distance, m, that neither the curve exceeds from the chord nor the chord from the curve.
    #[inline]
    #[must_use]
    pub fn distance_m(self) -> f64 {
        if self.lag_m == 0.0 {
            self.offset_m
        } else {
            (self.offset_m * self.offset_m + self.lag_m * self.lag_m).sqrt()
        }
    }
}

/// Proven distance, m, both ways, between a part of a cubic and a chord whose ends need not lie on it: `c` are the
/// part's control points relative to the chord's start, `v` is the chord.
///
/// The offset across the chord is a cubic in each of two directions, and the extremes of a cubic are known exactly.
/// Along the chord, what lies before its start or beyond its end is matched with that end, and lies in the hull of
/// its own control points. A part that runs back somewhere is charged everything that it runs back.
#[must_use]
pub fn off_curve_m(c: [Vec3; 4], v: Vec3) -> f64 {
    let l2 = v.norm2();
    let ends = c[0].norm().max((c[3] - v).norm());
    if l2 < NO_CHORD_M2 {
        return c.iter().map(|p| p.norm()).fold(l2.sqrt(), f64::max);
    }
    // Fractions along the chord (s) and the rest across it (w).
    let s = c.map(|p| p.dot(v) / l2);
    let mut w = c;
    for (w, s) in w.iter_mut().zip(s) {
        *w = *w - v * s;
    }
    // Two directions across, the first along the widest offset: the extremes of a plane curve are then exact, as the second
    // component is zero throughout.
    let widest = w
        .iter()
        .copied()
        .fold(Vec3::ZERO, |a, b| if b.norm2() > a.norm2() { b } else { a });
    let first = widest.unit();
    let second = v.unit().cross(first);
    let across = greatest(w.map(|w| w.dot(first))).hypot(greatest(w.map(|w| w.dot(second))));
    if s[0] <= s[1] && s[1] <= s[2] && s[2] <= s[3] {
        let curve = Cubic(c);
        let mut worst = across.max(ends);
        if s[0] < 0.0 {
            worst = worst.max(hull(&curve.part(0.0, crossing(s, 0.0)), Vec3::ZERO));
        }
        if s[3] > 1.0 {
            worst = worst.max(hull(&curve.part(crossing(s, 1.0), 1.0), v));
        }
        return worst;
    }
    // A part that runs back is rare (a loop or a cusp); a coarse bound is enough there.
    let back: f64 = s.windows(2).map(|p| (p[0] - p[1]).max(0.0)).sum();
    let (min, max) = (
        s.iter().copied().fold(0.0, f64::min),
        s.iter().copied().fold(1.0, f64::max),
    );
    let lag_m = (back - min + (max - 1.0)) * l2.sqrt();
    across.hypot(lag_m).max(ends)
}

fn hull(part: &Cubic, around: Vec3) -> f64 {
    part.0
        .iter()
        .map(|p| (*p - around).norm())
        .fold(0.0, f64::max)
}

/// A parameter at or past which (for 0) or up to which (for 1) a rising Bernstein cubic is on the far side of `level`.
fn crossing(s: [f64; 4], level: f64) -> f64 {
    let at = |t: f64| {
        let r = 1.0 - t;
        r * r * (r * s[0] + 3.0 * t * s[1]) + t * t * (3.0 * r * s[2] + t * s[3])
    };
    // Bisection keeps the side that includes the crossing, so a coarse end only makes the part, and the bound, larger.
    let (mut low, mut high) = (0.0, 1.0);
    for _ in 0..20 {
        let middle = 0.5 * (low + high);
        if at(middle) < level {
            low = middle
        } else {
            high = middle
        }
    }
    if level > 0.5 { low } else { high }
}

/// The greatest absolute value of a Bernstein cubic on 0 to 1.
fn greatest(x: [f64; 4]) -> f64 {
    let at = |t: f64| {
        let r = 1.0 - t;
        r * r * (r * x[0] + 3.0 * t * x[1]) + t * t * (3.0 * r * x[2] + t * x[3])
    };
    let (d0, d1, d2) = (x[1] - x[0], x[2] - x[1], x[3] - x[2]);
    let (a, b, c) = (d0 - 2.0 * d1 + d2, d1 - d0, d0);
    let mut max = x[0].abs().max(x[3].abs());
    let discriminant = b * b - a * c;
    if discriminant >= 0.0 {
        let q = -(b + discriminant.sqrt().copysign(b));
        for t in [q / a, c / q] {
            if t > 0.0 && t < 1.0 {
                max = max.max(at(t).abs());
            }
        }
    }
    max
}

/// Squared length under which a chord has no direction worth using, m^2.
const NO_CHORD_M2: f64 = 1e-18;

/// Greatest difference between s(t) = 3 s1 t(1-t)^2 + 3 s2 t^2(1-t) + t^3 and its clamped running maximum: it can
/// only be reached at a root of s'.
fn lag(s1: f64, s2: f64) -> f64 {
    let s = |t: f64| {
        let r = 1.0 - t;
        t * (3.0 * r * (s1 * r + s2 * t) + t * t)
    };
    // s'/3 = a t^2 + 2 b t + c
    let (a, b, c) = (3.0 * (s1 - s2) + 1.0, s2 - 2.0 * s1, s1);
    let discriminant = b * b - a * c;
    if discriminant <= 0.0 {
        return 0.0;
    }
    // Citardauq's form for the second root: no cancellation, and correct when a is 0.
    let q = -(b + discriminant.sqrt().copysign(b));
    let (r1, r2) = (q / a, c / q);
    let mut furthest: f64 = 0.0;
    let mut lag: f64 = 0.0;
    for t in [r1.min(r2), r1.max(r2)] {
        if t > 0.0 && t < 1.0 {
            let here = s(t);
            furthest = furthest.max(here.min(1.0));
            lag = lag.max((here - furthest).abs());
        }
    }
    lag
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sampled_frechet_upper(c: &Cubic) -> f64 {
        let chord = c.0[3] - c.0[0];
        let l2 = chord.norm2();
        let (mut furthest, mut worst): (f64, f64) = (0.0, 0.0);
        for i in 0..=2_000 {
            let p = c.at(f64::from(i) / 2_000.0) - c.0[0];
            furthest = furthest.max((p.dot(chord) / l2).clamp(0.0, 1.0));
            worst = worst.max((p - chord * furthest).norm());
        }
        worst
    }

    #[test]
    fn it_is_exact_in_the_plane_and_never_less_in_space() {
        let mut state = 1u64;
        let mut next = || {
            state = state
                .wrapping_mul(6_364_136_223_846_793_005)
                .wrapping_add(1_442_695_040_888_963_407);
            (state >> 11) as f64 / (1u64 << 53) as f64 * 4.0 - 1.5
        };
        for case in 0..5_000 {
            let flat = case % 2 == 0;
            let mut p = || Vec3::new(next(), next(), if flat { 0.0 } else { next() });
            let c = Cubic([Vec3::ZERO, p(), p(), Vec3::new(1.0, 0.0, 0.0)]);
            let bound = ChordBound::new(c.0[1], c.0[2], c.0[3]);
            let sampled = sampled_frechet_upper(&c);
            assert!(
                bound.distance_m() >= sampled - 1e-9,
                "{c:?} {bound:?} {sampled}"
            );
            if flat && bound.lag_m == 0.0 {
                assert!(
                    bound.distance_m() <= sampled + 1e-5,
                    "{c:?} {bound:?} {sampled}"
                );
            }
        }
    }

    #[test]
    fn with_ends_off_the_curve_it_is_never_less_than_sampled_either_way() {
        let mut state = 7u64;
        let mut next = || {
            state = state
                .wrapping_mul(6_364_136_223_846_793_005)
                .wrapping_add(1_442_695_040_888_963_407);
            (state >> 11) as f64 / (1u64 << 53) as f64 - 0.5
        };
        for _ in 0..1_000 {
            let near =
                |n: &mut dyn FnMut() -> f64, x: f64| Vec3::new(x + 0.3 * n(), n(), 0.3 * n());
            let c = [
                near(&mut next, 0.0),
                near(&mut next, 0.3),
                near(&mut next, 0.7),
                near(&mut next, 1.0),
            ];
            let v = Vec3::new(1.0, 0.0, 0.0);
            let bound = off_curve_m(c, v);
            let curve: Vec<Vec3> = (0..=200)
                .map(|i| Cubic(c).at(f64::from(i) / 200.0))
                .collect();
            for p in &curve {
                let near = (*p - v * p.x.clamp(0.0, 1.0)).norm();
                assert!(near <= bound + 1e-9, "{c:?} {near} {bound}");
            }
            for i in 0..=50 {
                let q = v * (f64::from(i) / 50.0);
                let near = curve
                    .iter()
                    .map(|p| (*p - q).norm())
                    .fold(f64::INFINITY, f64::min);
                assert!(near <= bound + 0.01, "{c:?} {near} {bound}");
            }
        }
    }

    #[test]
    fn a_closed_part_is_bounded_by_its_control_points() {
        let b = ChordBound::new(
            Vec3::new(3.0, 4.0, 0.0),
            Vec3::new(0.0, 1.0, 0.0),
            Vec3::ZERO,
        );
        assert_eq!(b.distance_m(), 5.0);
    }
}
