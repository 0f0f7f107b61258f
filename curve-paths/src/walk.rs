//! Walks along one leg by the longest chords that the tolerance allows.
//!
//! From each vertex the end of the next chord is searched with the proven bound. The first guess comes from the curvature
//! and its change. Then follows a secant on the root of the bound (which grows almost like the chord), and bisection after
//! six steps, since the secant stalls near a cusp. A chord is accepted only if its bound is within the tolerance.

use crate::leg::BezierLeg;
use crate::local::{Chord, ErrorAllowance, Local};
use crate::wgs84::Position;

/// A vertex of the densified route.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Vertex {
    /// Its position.
    pub position: Position,
    /// The leg that it ends or lies in, from 0; the route's first vertex belongs to leg 0.
    pub leg: usize,
    /// Its parameter in that leg: 0 only for the route's first vertex, 1 for a leg's end.
    pub t: f64,
}

/// The vertices, with their proven bound.
#[derive(Clone, Debug, PartialEq)]
pub struct Densified {
    /// The vertices in order; the last equals the first in every bit of its position when the route is closed.
    pub vertices: Vec<Vertex>,
    /// Proven deviation both ways, allowance included, m; never over the tolerance.
    pub bound_m: f64,
    /// The shortest chord on the ground between two vertices, m; infinite when there is none.
    pub shortest_chord_m: f64,
}

/// The altitude at rising parameters; the length is summed from chord to chord.
pub(crate) struct AltitudeAlong<'a> {
    leg: &'a BezierLeg,
    length_m: f64,
}

impl<'a> AltitudeAlong<'a> {
    pub(crate) const fn new(leg: &'a BezierLeg) -> Self {
        Self { leg, length_m: 0.0 }
    }

    pub(crate) fn at(&mut self, a: f64, b: f64) -> f64 {
        match self.leg.climb() {
            crate::leg::Climb::Cubic(_) => self.leg.altitude_at(b),
            crate::leg::Climb::Even {
                from_m,
                rise_m,
                length_m,
            } => {
                self.length_m += self.leg.offsets().part(a, b).length();
                from_m + rise_m * (self.length_m / length_m).min(1.0)
            }
        }
    }
}

/// The rules for a walk.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Rules {
    /// Greatest bound of a chord, with the fixed allowance already subtracted, m.
    pub(crate) tolerance_m: f64,
    /// Shortest chord on the ground between two vertices of a leg, m; 0 for no rule.
    pub(crate) min_chord_m: f64,
    /// What each chord is charged.
    pub(crate) allowance: ErrorAllowance,
}

/// No chord of the minimum length keeps the tolerance here.
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
    let mut local = Local::new(leg, &rules.allowance);
    if rules.min_chord_m > 0.0 {
        return walk_with_min(leg, &mut local, rules, visit);
    }
    let whole = local.chord(1.0);
    if whole.bound_m <= rules.tolerance_m {
        visit(&whole);
        return Ok(());
    }
    while local.t() < 1.0 {
        let chord = longest(&local, rules.tolerance_m);
        debug_assert!(chord.bound_m <= rules.tolerance_m, "{chord:?} {rules:?}");
        visit(&chord);
        local.advance(&chord);
    }
    Ok(())
}

/// The longest chord from here whose bound is within the tolerance, to half a percent of its length.
#[inline]
pub(crate) fn longest(local: &Local<'_>, tolerance_m: f64) -> Chord {
    let rest = 1.0 - local.t();
    let to = |h: f64| local.chord(if h >= rest { 1.0 } else { local.t() + h });
    let per_tolerance = 1.0 / tolerance_m;
    let guess = local.guess(tolerance_m, local.last());
    let moved = (guess.slope * (guess.h - local.last())).clamp(-0.5, 0.5);
    let mut h = AIM * guess.h * (1.0 - moved);
    // Near the end of the leg, try the end first.
    if h > 0.8 * rest {
        h = rest;
    }
    let mut best: Option<Chord> = None;
    let (mut low, mut high) = (0.0, rest * (1.0 + 1e-9));
    let (mut before_h, mut before_g) = (0.0, 0.0);
    let mut step = 0;
    loop {
        let chord = to(h);
        let f = chord.bound_m * per_tolerance;
        if chord.bound_m <= tolerance_m {
            low = h;
            if f >= CLOSE_ENOUGH || h >= rest {
                return chord;
            }
            best = Some(chord);
        } else {
            high = h;
        }
        if let Some(best) = best
            && (high - low <= NARROW * high || step >= MAX_STEPS)
        {
            return best;
        }
        // The bound grows almost with the square of the chord, so its root is almost a straight line for the secant.
        let g = f.sqrt();
        let per_g = if step == 0 {
            // Without an earlier measurement: the expected growth of the root here.
            h / (g * (1.0 + (guess.slope * h).clamp(-0.5, 1.0)))
        } else {
            (h - before_h) / (g - before_g)
        };
        let secant = h + (AIM - g) * per_g;
        (before_h, before_g) = (h, g);
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

/// The number of chords that the greedy walk needs; it stops counting past `enough`.
pub(crate) fn count(leg: &BezierLeg, rules: &Rules, enough: usize) -> usize {
    length(leg, rules, enough).ceil() as usize
}

/// The number of full chords that the greedy walk needs, with the last one counted by its used part: never 0, and the
/// number of chords when rounded up. It stops counting past `enough`.
pub(crate) fn length(leg: &BezierLeg, rules: &Rules, enough: usize) -> f64 {
    // The length of a chord grows about with the root of its allowed deviation.
    let used = |last: &Chord| (last.bound_m / rules.tolerance_m).sqrt().clamp(1e-6, 1.0);
    let mut local = Local::new(leg, &rules.allowance);
    let whole = local.chord(1.0);
    if whole.bound_m <= rules.tolerance_m {
        return used(&whole);
    }
    let mut chords = 0;
    loop {
        let chord = longest(&local, rules.tolerance_m);
        if chord.b >= 1.0 || chords >= enough {
            return chords as f64 + used(&chord);
        }
        chords += 1;
        local.advance(&chord);
    }
}

/// An estimate of [`length`] without a walk, from the curvature at a few places.
pub(crate) fn length_guessed(leg: &BezierLeg, rules: &Rules) -> f64 {
    let local = Local::new(leg, &rules.allowance);
    let place = |k: u32| (f64::from(k) + 0.5) / f64::from(PLACES);
    let density = |k: u32| 1.0 / local.guess(rules.tolerance_m, 2.0 * place(k)).h;
    (0..PLACES).map(density).sum::<f64>() / f64::from(PLACES)
}

/// As the greedy walk, but with no chord shorter than the minimum. A last chord that is too short is lengthened at
/// the cost of the one before; where that fails too, a dynamic program over a grid decides.
fn walk_with_min(
    leg: &BezierLeg,
    local: &mut Local<'_>,
    rules: &Rules,
    mut visit: impl FnMut(&Chord),
) -> Result<(), Stuck> {
    // If one chord is enough, its ends are the route's own waypoints, and its length cannot be changed.
    let whole = local.chord(1.0);
    if whole.bound_m <= rules.tolerance_m {
        visit(&whole);
        return Ok(());
    }
    // A first pass without `visit`: whether the greedy walk succeeds, and whether its end needs balancing.
    let mut balance = None;
    let mut before: Option<Chord> = None;
    while local.t() < 1.0 {
        let chord = longest(local, rules.tolerance_m);
        if chord.ground_m < rules.min_chord_m {
            balance = match before {
                Some(before) if chord.b >= 1.0 => rebalanced(leg, &before, rules),
                _ => None,
            };
            if balance.is_none() {
                return optimum_with_min(leg, rules, visit);
            }
            break;
        }
        before = Some(chord);
        local.advance(&chord);
    }
    // Second pass: `visit` cannot be undone, so it is called only now that every chord is certain.
    local.reframe(0.0);
    while local.t() < 1.0 {
        if let Some((first, second)) = &balance
            && first.a == local.t()
        {
            visit(first);
            visit(second);
            return Ok(());
        }
        let chord = longest(local, rules.tolerance_m);
        visit(&chord);
        local.advance(&chord);
    }
    Ok(())
}

/// Two chords from the start of `chord` to the end of the leg, both long enough and within the tolerance, if they exist:
/// the vertex between them is moved back from the end of `chord`.
fn rebalanced(leg: &BezierLeg, chord: &Chord, rules: &Rules) -> Option<(Chord, Chord)> {
    let mut local = Local::new(leg, &rules.allowance);
    (1..=BALANCE_STEPS).find_map(|k| {
        let t = chord.b - (chord.b - chord.a) * f64::from(k) / f64::from(BALANCE_STEPS + 1);
        local.reframe(chord.a);
        let first = local.chord(t);
        local.reframe(t);
        let second = local.chord(1.0);
        let fits = |c: &Chord| c.ground_m >= rules.min_chord_m && c.bound_m <= rules.tolerance_m;
        (fits(&first) && fits(&second)).then_some((first, second))
    })
}

/// The fewest chords with vertices on an even grid of t, none under the minimum length. Needed only near cusps, so its cost
/// (a few ms) and its buffers do not matter.
fn optimum_with_min(
    leg: &BezierLeg,
    rules: &Rules,
    mut visit: impl FnMut(&Chord),
) -> Result<(), Stuck> {
    let t = |k: usize| k as f64 / GRID as f64;
    let mut local = Local::new(leg, &rules.allowance);
    // For each grid point: chords from the start, and the point before.
    let mut best: Vec<Option<(u32, usize)>> = vec![None; GRID + 1];
    best[0] = Some((0, 0));
    let mut furthest = 0;
    for i in 0..GRID {
        let Some((chords, _)) = best[i] else { continue };
        furthest = i;
        local.reframe(t(i));
        for (j, best) in best.iter_mut().enumerate().skip(i + 1) {
            if best.is_none_or(|(known, _)| chords + 1 < known) {
                let chord = local.chord(t(j));
                if chord.ground_m >= rules.min_chord_m && chord.bound_m <= rules.tolerance_m {
                    *best = Some((chords + 1, i));
                }
            }
        }
    }
    let mut ends = Vec::new();
    let mut at = GRID;
    while at > 0 {
        ends.push(at);
        at = best[at].ok_or(Stuck { t: t(furthest) })?.1;
    }
    let mut from = 0;
    for &to in ends.iter().rev() {
        local.reframe(t(from));
        visit(&local.chord(t(to)));
        from = to;
    }
    Ok(())
}

/// Places at which the curvature is sampled for an estimate.
const PLACES: u32 = 8;
/// Places tried for the last vertex but one.
const BALANCE_STEPS: u32 = 31;
/// Grid of the dynamic program.
const GRID: usize = 384;
/// Fraction of the tolerance that ends a search: the chord is within half a percent of the longest.
const CLOSE_ENOUGH: f64 = 0.99;
/// The secant's target: between the root of the above and 1.
const AIM: f64 = 0.9975;
/// Relative width of the interval that ends a search.
const NARROW: f64 = 1e-3;
/// Steps by secant before bisection.
const SECANT_STEPS: u32 = 6;
/// Steps after which a valid chord is accepted as it is.
const MAX_STEPS: u32 = 40;
