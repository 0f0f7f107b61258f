//! How tightly a leg turns, seen from above: this determines bank and lateral acceleration.

use crate::leg::BezierLeg;
use crate::vector::Vec3;
use crate::wgs84::{Position, up};

/// The tightest place of a part of a leg.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Tightest {
    /// Its parameter.
    pub t: f64,
    /// Its position.
    pub position: Position,
    /// Radius of the ground track there, m; infinite on a straight.
    pub radius_m: f64,
    /// Greatest change of curvature along the part, 1/m^2: this determines lateral jerk.
    pub curvature_rate: f64,
}

/// The tightest place between two parameters of a leg.
///
/// Sampled, then refined to a millionth of the part; a cusp gives a radius of 0 or close to it.
#[must_use]
pub fn tightest(leg: &BezierLeg, a: f64, b: f64) -> Tightest {
    let view = View::of(leg, 0.5 * (a + b));
    let at = |k: u32| a + (b - a) * f64::from(k) / f64::from(SAMPLES);
    let mut worst = (a, 0.0);
    let mut curvature_rate: f64 = 0.0;
    let mut before: Option<f64> = None;
    let step_m = |k: u32| (leg.offsets().at(at(k)) - leg.offsets().at(at(k - 1))).norm();
    for k in 0..=SAMPLES {
        let signed = view.curvature(at(k));
        if signed.abs() > worst.1 {
            worst = (at(k), signed.abs());
        }
        if let Some(before) = before {
            let apart_m = step_m(k);
            if apart_m > 0.0 && signed.is_finite() {
                curvature_rate = curvature_rate.max((signed - before).abs() / apart_m);
            }
        }
        before = signed.is_finite().then_some(signed);
    }
    // Ternary search between the neighbours of the worst sample.
    let step = (b - a) / f64::from(SAMPLES);
    let (mut low, mut high) = ((worst.0 - step).max(a), (worst.0 + step).min(b));
    for _ in 0..40 {
        let (l, h) = (low + (high - low) / 3.0, high - (high - low) / 3.0);
        if view.curvature(l).abs() < view.curvature(h).abs() {
            low = l
        } else {
            high = h
        }
    }
    let t = 0.5 * (low + high);
    let found = view.curvature(t).abs();
    let (t, curvature) = if found > worst.1 { (t, found) } else { worst };
    Tightest {
        t,
        position: leg.at(t),
        radius_m: 1.0 / curvature,
        curvature_rate,
    }
}

/// The leg seen along the vertical at one of its points.
struct View<'a> {
    leg: &'a BezierLeg,
    up: Vec3,
}

impl<'a> View<'a> {
    fn of(leg: &'a BezierLeg, t: f64) -> Self {
        Self {
            leg,
            up: up(leg.origin() + leg.offsets().at(t)),
        }
    }

    /// Curvature of the ground track, 1/m, positive to the left. Where the speed is zero: infinite if the curve turns
    /// there.
    fn curvature(&self, t: f64) -> f64 {
        let (d, dd) = (
            self.leg.offsets().derivative(t),
            self.leg.offsets().second_derivative(t),
        );
        let flat = d - self.up * d.dot(self.up);
        let speed2 = flat.norm2();
        let turn = self.up.dot(flat.cross(dd));
        // Below this, the rounding errors of a straight leg would look like a turn.
        if turn.abs() <= 1e-9 * dd.norm() * d.norm().max(1e-6) {
            return 0.0;
        }
        turn / (speed2 * speed2.sqrt())
    }
}

/// Samples of a part: a cubic has at most a handful of curvature peaks.
const SAMPLES: u32 = 64;
