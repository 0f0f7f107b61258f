//! The two-sided deviation between a cubic and the polyline that it stands for, both in the plane.
//!
//! A measure of one side only is a trap: fits that pass every fix can stray metres between them.

use super::plane::{Cubic2, Vec2};

/// Greatest squared distance of the curve from the polyline of `points`, m^2. The nearest segment is looked for
/// around the last one, so a curve that runs ahead or back along its track is measured too far, never too near.
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

/// Greatest squared distance from any of `from` to the polyline `to`, every segment looked at.
fn one_sided2(from: &[Vec2], to: &[Vec2]) -> f64 {
    let nearest = |x: &Vec2| {
        to.windows(2)
            .map(|s| x.to_segment2(s[0], s[1]))
            .fold(f64::INFINITY, f64::min)
    };
    from.iter().map(nearest).fold(0.0, f64::max)
}

/// Segments looked at behind and ahead of the last nearest one.
const BACK: usize = 4;
const AHEAD: usize = 8;
/// Samples of one leg at most.
const MAX_SAMPLES: usize = 20_000;
