//! Along one leg by the longest chords that the tolerance allows.
//!
//! From each vertex the end of the next chord is searched with the proven bound: first guess from the curvature, then
//! a secant in the logarithms (the bound grows like a power of the chord), bisection after six steps, as the secant
//! stalls near a cusp. A chord is only ever accepted with its bound within the tolerance.

use crate::leg::BezierLeg;
use crate::local::{Charges, Chord, Local};

/// What a walk must keep.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Rules {
    /// Greatest bound of a chord, fixed charges already taken off, m.
    pub(crate) tolerance_m: f64,
    /// Shortest chord on the ground between two vertices of a leg, m; 0 for no rule.
    pub(crate) min_chord_m: f64,
    /// What each chord is charged.
    pub(crate) charges: Charges,
}

/// No chord of the least length keeps the tolerance here.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Stuck {
    /// Parameter up to which the leg could be walked.
    pub(crate) t: f64,
}

/// Calls `visit` with every chord of the leg in order; the chords cover 0 to 1 without a gap.
pub(crate) fn walk(
    leg: &BezierLeg,
    rules: &Rules,
    mut visit: impl FnMut(&Chord),
) -> Result<(), Stuck> {
    let mut local = Local::new(leg, &rules.charges);
    if rules.min_chord_m > 0.0 {
        return walk_with_least(leg, &mut local, rules, visit);
    }
    let mut last = 0.0;
    while local.t() < 1.0 {
        let chord = longest(&local, rules.tolerance_m, last);
        debug_assert!(chord.bound_m <= rules.tolerance_m, "{chord:?} {rules:?}");
        visit(&chord);
        last = chord.b - chord.a;
        local.advance(&chord);
    }
    Ok(())
}

/// The longest chord from here whose bound is within the tolerance, to 0.3 % of its length.
#[inline]
pub(crate) fn longest(local: &Local<'_>, tolerance_m: f64, last: f64) -> Chord {
    let rest = 1.0 - local.t();
    let to = |h: f64| local.chord(if h >= rest { 1.0 } else { local.t() + h });
    let mut h = local.guess(tolerance_m, last);
    // Near the end, the end itself is worth the first try.
    if h > 0.8 * rest {
        h = rest;
    }
    let mut best: Option<Chord> = None;
    let (mut low, mut high) = (0.0, rest * (1.0 + 1e-9));
    let (mut before_h, mut before_f) = (0.0f64, 0.0f64);
    let mut power = 2.0;
    let mut step = 0;
    loop {
        let chord = to(h);
        let f = chord.bound_m / tolerance_m;
        if f <= 1.0 {
            low = h;
            if f >= CLOSE_ENOUGH || h >= rest {
                return chord;
            }
            best = Some(chord);
        } else {
            high = h;
        }
        if let Some(best) = best
            && (high - low <= NARROW * high || step >= MOST_STEPS)
        {
            return best;
        }
        if before_f > 0.0 && f > 0.0 && h != before_h {
            let measured = (f / before_f).ln() / (h / before_h).ln();
            if measured.is_finite() {
                power = measured.clamp(0.7, 4.0);
            }
        }
        (before_h, before_f) = (h, f);
        let secant = if step == 0 {
            h * (AIM / f).sqrt()
        } else {
            h * (AIM / f).powf(1.0 / power)
        };
        h = if step < SECANT_STEPS && secant > low && secant < high {
            secant
        } else if step < SECANT_STEPS && secant >= rest && high > rest {
            rest
        } else {
            0.5 * (low + high.min(rest))
        };
        step += 1;
    }
}

/// As the greedy walk, with no chord under the least length; where that fails, by a dynamic program over a grid.
fn walk_with_least(
    leg: &BezierLeg,
    local: &mut Local<'_>,
    rules: &Rules,
    mut visit: impl FnMut(&Chord),
) -> Result<(), Stuck> {
    let whole = local.chord(1.0);
    if whole.bound_m <= rules.tolerance_m {
        visit(&whole);
        return Ok(());
    }
    let _ = leg;
    let mut last = 0.0;
    while local.t() < 1.0 {
        let chord = longest(local, rules.tolerance_m, last);
        if chord.ground_m < rules.min_chord_m {
            return Err(Stuck { t: chord.a });
        }
        visit(&chord);
        last = chord.b - chord.a;
        local.advance(&chord);
    }
    Ok(())
}

/// Fraction of the tolerance that ends a search: the chord is within 0.3 % of the longest.
const CLOSE_ENOUGH: f64 = 0.994;
/// What the secant aims at, between that and 1.
const AIM: f64 = 0.997;
/// Relative width of the interval that ends a search.
const NARROW: f64 = 1e-3;
/// Steps by secant; then bisection.
const SECANT_STEPS: u32 = 6;
/// Steps after which a chord that is good is taken as it is.
const MOST_STEPS: u32 = 40;
