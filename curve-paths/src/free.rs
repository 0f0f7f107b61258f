//! Vertices off the curve: fewer items for the same tolerance.
//!
//! A chord with its ends on the curve lies on the inner side of a bend and uses the tolerance on that side only. With its
//! ends moved outwards by nearly the tolerance, its middle may be inside by as much: chords become longer by a factor of
//! root two. A leg's own ends stay. The deviation both ways is proven for each chord by
//! [`off_curve_m`](crate::bound::off_curve_m).

use crate::leg::BezierLeg;
use crate::local::Local;
use crate::vector::Vec3;
use crate::walk::{AltitudeAlong, Densified, Rules, Vertex};
use crate::wgs84::{Ground, Position};

/// Appends the vertices of a leg after its start; false, with nothing appended, if the search fails.
pub(crate) fn walk_free(
    leg: &BezierLeg,
    index: usize,
    rules: &Rules,
    fixed_m: f64,
    out: &mut Densified,
) -> bool {
    let before = (out.vertices.len(), out.bound_m, out.shortest_chord_m);
    let mut local = Local::new(leg, &rules.allowance);
    let mut altitude = AltitudeAlong::new(leg);
    // The offset of the present vertex, earth-centred and in altitude.
    let mut offset = (Vec3::ZERO, 0.0);
    let mut last = 0.0;
    while local.t() < 1.0 {
        let t = local.t();
        let here = local.framed(offset.0, offset.1);
        let Some(chord) = longest(&local, here, rules, last) else {
            // Everything is undone: the caller densifies this leg again with its vertices on the curve.
            out.vertices.truncate(before.0);
            (out.bound_m, out.shortest_chord_m) = (before.1, before.2);
            return false;
        };
        out.bound_m = out.bound_m.max(fixed_m + chord.bound_m);
        out.shortest_chord_m = out.shortest_chord_m.min(chord.ground_m);
        offset = local.unframed(chord.offset);
        let position = if chord.b >= 1.0 {
            leg.p4()
        } else {
            let ground = Ground::from_ecef(leg.origin() + leg.offsets().at(chord.b) + offset.0);
            Position::new(
                ground.lat_deg,
                ground.lon_deg,
                altitude.at(t, chord.b) + offset.1,
            )
        };
        out.vertices.push(Vertex {
            position,
            leg: index,
            t: chord.b,
        });
        last = chord.b - t;
        local.reframe(chord.b);
    }
    true
}

struct FreeChord {
    b: f64,
    offset: Vec3,
    bound_m: f64,
    ground_m: f64,
}

/// The longest chord found that starts off the curve by `from`.
fn longest(local: &Local<'_>, from: Vec3, rules: &Rules, last: f64) -> Option<FreeChord> {
    let t = local.t();
    let rest = 1.0 - t;
    // A chord to an end moved outwards, or to one on the curve where that fails.
    let try_to = |h: f64| -> Option<FreeChord> {
        let b = if h >= rest { 1.0 } else { t + h };
        let tried = |offset: Vec3| {
            let (bound_m, ground_m) = local.chord_off_curve(from, offset, b);
            (bound_m <= rules.tolerance_m && ground_m >= rules.min_chord_m).then_some(FreeChord {
                b,
                offset,
                bound_m,
                ground_m,
            })
        };
        // The end of a leg is a waypoint of the route, which must not move.
        if b >= 1.0 {
            return tried(Vec3::ZERO);
        }
        let out = local
            .outward(b)
            .filter(|(_, bend_m)| *bend_m > STRAIGHT * rules.tolerance_m);
        out.and_then(|(out, _)| tried(out * (OUTWARD * rules.tolerance_m)))
            .or_else(|| tried(Vec3::ZERO))
    };
    if let Some(chord) = try_to(rest) {
        return Some(chord);
    }
    let (mut low, mut high) = (0.0, rest);
    let mut best = None;
    // Outward ends allow chords longer by root two; the bound then decides.
    let mut h = (1.4 * local.guess(rules.tolerance_m, last).h).min(0.7 * rest);
    for _ in 0..MAX_STEPS {
        match try_to(h) {
            Some(chord) => {
                low = h;
                best = Some(chord);
            }
            None => high = h,
        }
        h = if low == 0.0 {
            0.6 * h
        } else if high >= rest && h * 1.25 < rest {
            h * 1.25
        } else {
            0.5 * (low + high)
        };
        if low > 0.0 && high - low <= NARROW * high {
            break;
        }
    }
    best
}

/// How far outwards a vertex moves, as a part of the tolerance: the rest is for the chord between two such vertices.
const OUTWARD: f64 = 0.97;
/// With less bend than this, as a multiple of the tolerance, a chord has no outer side.
const STRAIGHT: f64 = 0.1;
/// Relative width that ends a search.
const NARROW: f64 = 2e-3;
/// Steps after which a search ends with the best chord so far.
const MAX_STEPS: u32 = 40;
