//! The best cubic between two fixes: least squares across the curve, the foot of each sample moved along, with
//! Lawson's weights reducing the largest deviation.
//!
//! The ends are given; the two inner control points have four unknowns, or two where the tangents at the ends are
//! given too. Each round projects the samples to the curve, weighs them by their distance, and solves for the control
//! points. Distances across the curve count in full and those along it at a hundredth, which converges about as fast
//! as Newton's method without its instability. A fit counts only when the deviation both ways is within the
//! tolerance.

use super::plane::{Cubic2, Vec2, curve_to_polyline2};

/// Buffers for [`PairFit::run`], reused from pair to pair.
#[derive(Debug, Default)]
pub(crate) struct Scratch {
    t: Vec<f64>,
    weight: Vec<f64>,
    distance: Vec<f64>,
}

/// What is given at the ends beside their places.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Tangents {
    /// Direction in which the leg leaves its start, when given, length 1.
    pub(crate) start: Option<Vec2>,
    /// Direction in which the leg arrives at its end, when given, length 1.
    pub(crate) end: Option<Vec2>,
}

impl Tangents {
    pub(crate) const FREE: Self = Self {
        start: None,
        end: None,
    };
}

/// A cubic through a part of a track, and its deviation both ways, m.
#[derive(Clone, Copy, Debug)]
pub(crate) struct PairFit {
    pub(crate) cubic: Cubic2,
    pub(crate) deviation_m: f64,
}

impl PairFit {
    /// The best cubic found for the samples; the search stops at the first one within the tolerance, or when none is
    /// likely.
    pub(crate) fn run(
        points: &[Vec2],
        arc_m: &[f64],
        tangents: Tangents,
        tolerance_m: f64,
        scratch: &mut Scratch,
    ) -> Self {
        let mut search = Search::new(points, arc_m, tangents, scratch);
        let mut best = Self {
            cubic: search.cubic,
            deviation_m: f64::INFINITY,
        };
        let mut stale = 0;
        for round in 0..MAX_ROUNDS {
            search.solve();
            let one_sided2 = search.project();
            if one_sided2 < best.deviation_m * best.deviation_m {
                let both2 = one_sided2.max(curve_to_polyline2(&search.cubic, points));
                let deviation_m = both2.sqrt();
                if deviation_m < best.deviation_m {
                    stale = if deviation_m < 0.98 * best.deviation_m {
                        0
                    } else {
                        stale + 1
                    };
                    best = Self {
                        cubic: search.cubic,
                        deviation_m,
                    };
                } else {
                    stale += 1;
                }
            } else {
                stale += 1;
            }
            let hopeless = round >= 4 && best.deviation_m > 2.5 * tolerance_m;
            if best.deviation_m <= tolerance_m || hopeless || stale >= PATIENCE {
                break;
            }
            search.weigh();
        }
        best
    }
}

impl PairFit {
    /// A leg along the chord from `a` to `b` whatever its tangents: its arms are shorter than the tolerance.
    pub(crate) fn chord(a: Vec2, b: Vec2, tangents: Tangents, tolerance_m: f64) -> Self {
        let arm = (MIN_ARM * (b - a).norm()).min(0.9 * tolerance_m);
        let q1 = tangents.start.map_or(a.lerp(b, 1.0 / 3.0), |d| a + d * arm);
        let q2 = tangents.end.map_or(a.lerp(b, 2.0 / 3.0), |d| b - d * arm);
        Self {
            cubic: Cubic2([a, q1, q2, b]),
            deviation_m: arm,
        }
    }
}

struct Search<'a> {
    points: &'a [Vec2],
    cubic: Cubic2,
    tangents: Tangents,
    s: &'a mut Scratch,
    by_point: bool,
}

impl<'a> Search<'a> {
    fn new(points: &'a [Vec2], arc_m: &[f64], tangents: Tangents, s: &'a mut Scratch) -> Self {
        let (from, length_m) = (arc_m[0], arc_m[arc_m.len() - 1] - arc_m[0]);
        s.t.clear();
        s.t.extend(arc_m.iter().map(|a| (a - from) / length_m));
        s.weight.clear();
        s.weight.resize(points.len(), 1.0);
        s.distance.clear();
        s.distance.resize(points.len(), 0.0);
        let (p0, p3) = (points[0], points[points.len() - 1]);
        let third = length_m / 3.0;
        let p1 = tangents
            .start
            .map_or(p0.lerp(p3, 1.0 / 3.0), |d| p0 + d * third);
        let p2 = tangents
            .end
            .map_or(p0.lerp(p3, 2.0 / 3.0), |d| p3 - d * third);
        Self {
            points,
            cubic: Cubic2([p0, p1, p2, p3]),
            tangents,
            s,
            by_point: true,
        }
    }

    /// Solves for the control points at the current feet.
    fn solve(&mut self) {
        let [p0, p1, p2, p3] = self.cubic.0;
        let along_weight = if self.by_point { 1.0 } else { ALONG };
        let mut a = [[0.0; 4]; 4];
        let mut b = [0.0; 4];
        for ((&x, &t), &w) in self.points.iter().zip(&self.s.t).zip(&self.s.weight) {
            let s = 1.0 - t;
            let (b1, b2) = (3.0 * s * s * t, 3.0 * s * t * t);
            let r = x
                - p0 * (s * s * (s + 3.0 * t))
                - p3 * (t * t * (t + 3.0 * s))
                - (p1 - p0) * b1
                - (p2 - p3) * b2;
            let d = self.cubic.derivative(t).unit();
            // M = nn' + along tt' of the local normal and tangent.
            let k = 1.0 - along_weight;
            let (mxx, mxy, myy) = (1.0 - k * d.x * d.x, -k * d.x * d.y, 1.0 - k * d.y * d.y);
            let mr = Vec2::new(mxx * r.x + mxy * r.y, mxy * r.x + myy * r.y);
            let (w11, w12, w22) = (w * b1 * b1, w * b1 * b2, w * b2 * b2);
            a[0][0] += w11 * mxx;
            a[1][0] += w11 * mxy;
            a[1][1] += w11 * myy;
            a[2][0] += w12 * mxx;
            a[2][1] += w12 * mxy;
            a[3][1] += w12 * myy;
            a[2][2] += w22 * mxx;
            a[3][2] += w22 * mxy;
            a[3][3] += w22 * myy;
            b[0] += w * b1 * mr.x;
            b[1] += w * b1 * mr.y;
            b[2] += w * b2 * mr.x;
            b[3] += w * b2 * mr.y;
        }
        a[3][0] = a[2][1];
        // r is what remains over the present control points, so the solution is a step from them.
        let step = match (self.tangents.start, self.tangents.end) {
            (None, None) => solve_spd(a, b),
            (start, end) => solve_along(a, b, start, end),
        };
        let mut q1 = p1 + Vec2::new(step[0], step[1]);
        let mut q2 = p2 + Vec2::new(step[2], step[3]);
        // A given tangent points forwards, so its arm is not negative.
        let min = MIN_ARM * (p3 - p0).norm();
        if let Some(d) = self.tangents.start {
            q1 = p0 + d * (q1 - p0).dot(d).max(min);
        }
        if let Some(d) = self.tangents.end {
            q2 = p3 - d * (p3 - q2).dot(d).max(min);
        }
        self.cubic = Cubic2([p0, q1, q2, p3]);
        self.by_point = false;
    }

    /// Moves every foot to its nearest point; the greatest squared distance.
    fn project(&mut self) -> f64 {
        let mut worst2: f64 = 0.0;
        for ((&x, t), d) in self
            .points
            .iter()
            .zip(&mut self.s.t)
            .zip(&mut self.s.distance)
        {
            let first = self.cubic.towards_foot(*t, x);
            *t = self.cubic.towards_foot(first, x);
            let d2 = (self.cubic.at(*t) - x).norm2();
            *d = d2.sqrt();
            worst2 = worst2.max(d2);
        }
        worst2
    }

    /// Lawson's step: each weight grows with the sample's distance.
    fn weigh(&mut self) {
        let n = self.points.len() as f64;
        let mean = self.s.distance.iter().sum::<f64>() / n;
        if mean > 0.0 {
            let mut sum = 0.0;
            for (w, d) in self.s.weight.iter_mut().zip(&self.s.distance) {
                *w *= 0.1 + 0.9 * d / mean;
                sum += *w;
            }
            let scale = n / sum;
            self.s
                .weight
                .iter_mut()
                .for_each(|w| *w = (*w * scale).max(1e-4));
        }
    }
}

/// Cholesky's solution of a symmetric system given by its lower triangle, with slight damping.
fn solve_spd(mut a: [[f64; 4]; 4], mut b: [f64; 4]) -> [f64; 4] {
    let damping = DAMPING * (a[0][0] + a[1][1] + a[2][2] + a[3][3]) + f64::MIN_POSITIVE;
    for j in 0..4 {
        a[j][j] += damping;
        for k in 0..j {
            a[j][j] -= a[j][k] * a[j][k];
        }
        if a[j][j] <= 0.0 {
            return [0.0; 4];
        }
        a[j][j] = a[j][j].sqrt();
        for i in j + 1..4 {
            for k in 0..j {
                a[i][j] -= a[i][k] * a[j][k];
            }
            a[i][j] /= a[j][j];
        }
    }
    for i in 0..4 {
        for k in 0..i {
            b[i] -= a[i][k] * b[k];
        }
        b[i] /= a[i][i];
    }
    for i in (0..4).rev() {
        for k in i + 1..4 {
            b[i] -= a[k][i] * b[k];
        }
        b[i] /= a[i][i];
    }
    b
}

/// The same with a control point restricted to the line along its tangent.
fn solve_along(a: [[f64; 4]; 4], b: [f64; 4], start: Option<Vec2>, end: Option<Vec2>) -> [f64; 4] {
    // A restricted point has one direction, a free one two: columns of the basis in which the step is written.
    let across = |d: Vec2| [(d, true), (Vec2::new(-d.y, d.x), false)];
    let first = across(start.unwrap_or(Vec2::new(1.0, 0.0)));
    let second = across(end.unwrap_or(Vec2::new(1.0, 0.0)));
    let basis = [
        (0, first[0].0),
        (0, first[1].0),
        (2, second[0].0),
        (2, second[1].0),
    ];
    let kept = [true, start.is_none(), true, end.is_none()];
    let full = |i: usize, j: usize| if i >= j { a[i][j] } else { a[j][i] };
    let mut ra = [[0.0; 4]; 4];
    let mut rb = [0.0; 4];
    for i in 0..4 {
        if !kept[i] {
            ra[i][i] = 1.0;
            continue;
        }
        let (oi, u) = basis[i];
        rb[i] = u.x * b[oi] + u.y * b[oi + 1];
        for j in 0..=i {
            if kept[j] {
                let (oj, v) = basis[j];
                ra[i][j] = u.x * (full(oi, oj) * v.x + full(oi, oj + 1) * v.y)
                    + u.y * (full(oi + 1, oj) * v.x + full(oi + 1, oj + 1) * v.y);
            }
        }
    }
    let c = solve_spd(ra, rb);
    let mut step = [0.0; 4];
    for i in 0..4 {
        if kept[i] {
            let (o, u) = basis[i];
            step[o] += c[i] * u.x;
            step[o + 1] += c[i] * u.y;
        }
    }
    step
}

/// Rounds after which the search ends in any case.
const MAX_ROUNDS: u32 = 40;
/// Rounds without 2 % of progress that end a fit.
const PATIENCE: u32 = 6;
/// Weight of a distance along the curve against one across.
const ALONG: f64 = 0.01;
/// Damping of the normal equations, as a part of their trace.
const DAMPING: f64 = 1e-9;
/// Shortest arm of a tangent that counts, as a part of the chord: a shorter one would hide a corner.
pub(crate) const MIN_ARM: f64 = 0.15;
