//! A cubic Bezier curve in three dimensions: value, derivatives, exact split, length. No panic, no allocation.

use crate::vector::Vec3;

/// The four control points of a cubic, in any Cartesian frame, m.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Cubic(pub [Vec3; 4]);

impl Cubic {
    /// The point at parameter `t`, 0 to 1.
    #[inline]
    #[must_use]
    pub fn at(&self, t: f64) -> Vec3 {
        let [p0, p1, p2, p3] = self.0;
        let s = 1.0 - t;
        p0 * (s * s * s) + p1 * (3.0 * s * s * t) + p2 * (3.0 * s * t * t) + p3 * (t * t * t)
    }

    /// The first derivative by `t`.
    #[inline]
    #[must_use]
    pub fn derivative(&self, t: f64) -> Vec3 {
        let [p0, p1, p2, p3] = self.0;
        let s = 1.0 - t;
        (p1 - p0) * (3.0 * s * s) + (p2 - p1) * (6.0 * s * t) + (p3 - p2) * (3.0 * t * t)
    }

    /// The second derivative by `t`.
    #[inline]
    #[must_use]
    pub fn second_derivative(&self, t: f64) -> Vec3 {
        let [p0, p1, p2, p3] = self.0;
        (p2 - p1 * 2.0 + p0) * (6.0 * (1.0 - t)) + (p3 - p2 * 2.0 + p1) * (6.0 * t)
    }

    /// De Casteljau's split: the two halves trace the same curve, and meet in the same bits.
    #[must_use]
    pub fn split(&self, t: f64) -> (Self, Self) {
        let [p0, p1, p2, p3] = self.0;
        let (a, b, c) = (p0.lerp(p1, t), p1.lerp(p2, t), p2.lerp(p3, t));
        let (d, e) = (a.lerp(b, t), b.lerp(c, t));
        let f = d.lerp(e, t);
        (Self([p0, a, d, f]), Self([f, e, c, p3]))
    }

    /// The part between two parameters, as a cubic of its own.
    #[must_use]
    pub fn part(&self, a: f64, b: f64) -> Self {
        let third = (b - a) / 3.0;
        let (q0, q3) = (self.at(a), self.at(b));
        Self([
            q0,
            q0 + self.derivative(a) * third,
            q3 - self.derivative(b) * third,
            q3,
        ])
    }

    /// The same curve in the other direction.
    #[must_use]
    pub fn reversed(&self) -> Self {
        let [p0, p1, p2, p3] = self.0;
        Self([p3, p2, p1, p0])
    }

    /// The length of the curve, m. Each piece is integrated with five Gauss points once its control polygon is within
    /// 0.1 % of its chord and its speed changes little. So cusps cost more splits, but no accuracy.
    #[must_use]
    pub fn length(&self) -> f64 {
        self.length_to_depth(0)
    }

    fn length_to_depth(&self, depth: u32) -> f64 {
        let [p0, p1, p2, p3] = self.0;
        let sides = [(p1 - p0).norm(), (p2 - p1).norm(), (p3 - p2).norm()];
        let polygon = sides[0] + sides[1] + sides[2];
        let chord = (p3 - p0).norm();
        // The length is between the two.
        if polygon - chord <= 1e-9 || depth >= DEEPEST {
            return 0.5 * (polygon + chord);
        }
        let min = sides[0].min(sides[1]).min(sides[2]);
        if polygon <= 1.001 * chord && polygon <= EVEN * min {
            return GAUSS_5
                .iter()
                .map(|&(t, w)| w * self.derivative(t).norm())
                .sum();
        }
        let (a, b) = self.split(0.5);
        a.length_to_depth(depth + 1) + b.length_to_depth(depth + 1)
    }
}

/// Halvings after which a piece of a legal leg is shorter than a tenth of a millimetre.
const DEEPEST: u32 = 30;

/// How many times its shortest side a piece's polygon may be for its speed to be smooth enough: 3 when it is even.
const EVEN: f64 = 8.0;

/// Nodes on 0 to 1 and weights of the five-point Gauss-Legendre rule.
const GAUSS_5: [(f64, f64); 5] = [
    (0.046_910_077_030_668_0, 0.118_463_442_528_094_54),
    (0.230_765_344_947_158_45, 0.239_314_335_249_683_24),
    (0.5, 0.284_444_444_444_444_44),
    (0.769_234_655_052_841_5, 0.239_314_335_249_683_24),
    (0.953_089_922_969_332, 0.118_463_442_528_094_54),
];

#[cfg(test)]
mod tests {
    use super::*;

    const HOOK: Cubic = Cubic([
        Vec3::new(0.0, 0.0, 1.0),
        Vec3::new(120.0, 0.0, 5.0),
        Vec3::new(-40.0, 90.0, -3.0),
        Vec3::new(60.0, 20.0, 9.0),
    ]);

    #[test]
    fn a_split_traces_the_same_curve() {
        for s in [0.1, 0.5, 0.83] {
            let (a, b) = HOOK.split(s);
            assert_eq!(a.0[3], b.0[0]);
            for i in 0..=20 {
                let t = f64::from(i) / 20.0;
                assert!((a.at(t) - HOOK.at(t * s)).norm() < 1e-12);
                assert!((b.at(t) - HOOK.at(s + t * (1.0 - s))).norm() < 1e-12);
            }
        }
    }

    #[test]
    fn a_part_is_a_cubic_of_its_own() {
        let part = HOOK.part(0.2, 0.7);
        assert!((part.at(0.4) - HOOK.at(0.4)).norm() < 1e-12);
    }

    #[test]
    fn the_length_agrees_with_many_chords_also_through_a_cusp() {
        let cusp = Cubic([
            Vec3::ZERO,
            Vec3::new(100.0, 100.0, 0.0),
            Vec3::new(0.0, 100.0, 0.0),
            Vec3::new(100.0, 0.0, 0.0),
        ]);
        for c in [HOOK, cusp] {
            let n = 200_000;
            let at = |i: i32| c.at(f64::from(i) / f64::from(n));
            let chords: f64 = (0..n).map(|i| (at(i + 1) - at(i)).norm()).sum();
            assert!(
                (c.length() - chords).abs() < 1e-5,
                "{} {chords}",
                c.length()
            );
        }
    }
}
