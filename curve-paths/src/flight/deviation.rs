//! A bound for the flown deviation of a route's curves: what the guidance adds to the planned deviation.
//!
//! It is not proven, as the planned one is, but every flight of docs/guide/curves.md stayed within it. For wings, the items
//! are flown with PX4's guidance law ([`Npfg`](super::Npfg)), without wind and with the allowed wind from eight directions;
//! the worst of these tracks, with a margin, is the bound. For a multicopter it is that of its worst corner, from PX4's
//! position smoothing.
//!
//! The deviation counts both ways: from the track to the curve, and from the curve to the track, since a vehicle that
//! cuts a bend is near the route everywhere, but the bend is far from its track.

use std::f64::consts::TAU;

use super::npfg::{NorthEast, dot, minus, norm, plus};
use super::vehicle::{Airframe, FixedWing, Multicopter};
use super::wing_track::{self, Mark};
use crate::wgs84::{Position, east_north, up};

/// The part of a mission item that decides how the way to it is flown.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FlownItem {
    /// Its position.
    pub position: Position,
    /// Speed on the leg to it, m/s: air speed for wings, ground speed for a multicopter.
    pub speed_mps: f64,
    /// Its acceptance radius, m; wings use one of their own ([`FixedWing::switch_m`]).
    pub acceptance_m: f64,
    /// Whether the leg to it is a chord of a curve.
    pub curved: bool,
}

/// The flown deviation of a mission's curves, m, if the chords are within `bound_m` of them.
///
/// `None` without a curve, and for wings where the wind exceeds [`MAX_WIND_SHARE`] of the speed somewhere.
#[must_use]
pub fn flown_bound_m(items: &[FlownItem], bound_m: f64, airframe: &Airframe) -> Option<f64> {
    if !items.iter().any(|item| item.curved) {
        return None;
    }
    match airframe {
        Airframe::FixedWing(wing) => {
            let added_m = on_wings(items, wing)?;
            Some(bound_m + WING_FACTOR * added_m + WING_M)
        }
        Airframe::Multicopter(copter) => Some(bound_m + by_corners(items, copter)),
    }
}

/// The greatest distance between the chords and the tracks of wings, both ways, m.
fn on_wings(items: &[FlownItem], wing: &FixedWing) -> Option<f64> {
    let slowest_mps = items
        .iter()
        .map(|i| i.speed_mps)
        .fold(f64::INFINITY, f64::min);
    if wing.wind_mps > MAX_WIND_SHARE * slowest_mps {
        return None;
    }
    let items = around_curves(items);
    let longest_m =
        ON_LINE_S * (items.iter().map(|i| i.speed_mps).fold(0.0, f64::max) + wing.wind_mps);
    let places = flat(items, longest_m);
    let marks: Vec<Mark> = items
        .iter()
        .zip(&places)
        .map(|(item, place)| Mark {
            place: *place,
            speed_mps: item.speed_mps,
        })
        .collect();
    let curved: Vec<bool> = items.iter().map(|item| item.curved).collect();
    let chords = Chords::new(&places, curved);
    let mut winds = vec![[0.0, 0.0]];
    if wing.wind_mps > 0.0 {
        winds.extend((0..WINDS).map(|k| {
            let (sin, cos) = (TAU * f64::from(k) / f64::from(WINDS)).sin_cos();
            [wing.wind_mps * cos, wing.wind_mps * sin]
        }));
    }
    let off_m = winds
        .into_iter()
        .map(|wind| chords.apart_m(&wing_track::fly(&marks, wing, wind)));
    // A wind that carries the vehicle away gives an infinite distance.
    Some(off_m.fold(0.0, f64::max)).filter(|off_m| off_m.is_finite())
}

/// The items of the curves, and those before and after that affect how the curves are entered and left.
fn around_curves(items: &[FlownItem]) -> &[FlownItem] {
    let first = items.iter().position(|item| item.curved).unwrap_or(0);
    let last = items.iter().rposition(|item| item.curved).unwrap_or(0);
    let end = (last + 1 + AROUND).min(items.len());
    items
        .get(first.saturating_sub(1 + AROUND)..end)
        .unwrap_or(items)
}

/// The items seen from above, m from the first; legs are cut to `longest_m`.
fn flat(items: &[FlownItem], longest_m: f64) -> Vec<NorthEast> {
    let mut places = Vec::with_capacity(items.len());
    let mut at = [0.0, 0.0];
    let mut before: Option<Position> = None;
    for item in items {
        if let Some(before) = before {
            // From item to item, so that a long route is as accurate as a short one.
            let from = before.ground().to_ecef();
            let (east, north) = east_north(up(from));
            let step = item.position.ground().to_ecef() - from;
            let step = [step.dot(north), step.dot(east)];
            at = plus(at, step, (longest_m / norm(step)).min(1.0));
        }
        places.push(at);
        before = Some(item.position);
    }
    places
}

/// The chords of a route, and the parts that count: its curves, and half of the straight leg after each, onto which a
/// vehicle that leaves a curve too wide is carried. The other half belongs to the corner at its end.
struct Chords<'a> {
    places: &'a [NorthEast],
    curved: Vec<bool>,
    /// The distance of each place along the route, m.
    along_m: Vec<f64>,
}

impl<'a> Chords<'a> {
    fn new(places: &'a [NorthEast], curved: Vec<bool>) -> Self {
        let mut along_m = vec![0.0];
        for pair in places.windows(2) {
            let last = along_m.last().copied().unwrap_or(0.0);
            along_m.push(last + norm(minus(pair[1], pair[0])));
        }
        Self {
            places,
            curved,
            along_m,
        }
    }

    /// The greatest distance between the track and the curved chords, both ways, m.
    fn apart_m(&self, track: &[NorthEast]) -> f64 {
        let mut worst_m = 0.0_f64;
        // The distance along the route of each place of the track. It never decreases: the track follows the order of the
        // route, also where the route crosses itself.
        let mut passed: Vec<f64> = Vec::with_capacity(track.len());
        let mut reached_m = 0.0_f64;
        for at in track {
            let (off_m, along_m, counts) = self.nearest(*at, reached_m);
            reached_m = reached_m.max(along_m);
            passed.push(reached_m);
            if counts {
                worst_m = worst_m.max(off_m);
            }
        }
        for leg in 1..self.places.len() {
            for share in [0.0, 0.5, 1.0] {
                if !self.counts(leg, share) {
                    continue;
                }
                let (from, to) = (self.places[leg - 1], self.places[leg]);
                let place = plus(from, minus(to, from), share);
                let along_m = self.along_m[leg - 1] * (1.0 - share) + self.along_m[leg] * share;
                let low = passed.partition_point(|m| *m < along_m - WINDOW_M);
                let high = passed.partition_point(|m| *m <= along_m + WINDOW_M);
                let near = track.get(low..high).unwrap_or(&[]);
                let off_m = near.iter().map(|at| norm(minus(*at, place)));
                worst_m = worst_m.max(off_m.fold(f64::INFINITY, f64::min));
            }
        }
        worst_m
    }

    /// Whether a place of a leg counts.
    fn counts(&self, leg: usize, share: f64) -> bool {
        self.curved[leg] || self.curved[leg - 1] && share <= 0.5
    }

    /// Distance to the nearest chord around a place of the route, its distance along the route, and whether it counts.
    fn nearest(&self, at: NorthEast, reached_m: f64) -> (f64, f64, bool) {
        let low = self.along_m.partition_point(|m| *m < reached_m - WINDOW_M);
        let mut best = (f64::INFINITY, reached_m, false);
        for leg in low.max(1)..self.places.len() {
            if self.along_m[leg - 1] > reached_m + WINDOW_M {
                break;
            }
            let (from, to) = (self.places[leg - 1], self.places[leg]);
            let chord = minus(to, from);
            let length2 = dot(chord, chord);
            let share = if length2 > 0.0 {
                (dot(minus(at, from), chord) / length2).clamp(0.0, 1.0)
            } else {
                0.0
            };
            let off_m = norm(minus(at, plus(from, chord, share)));
            if off_m < best.0 {
                let along_m = self.along_m[leg - 1] + share * length2.sqrt();
                best = (off_m, along_m, self.counts(leg, share));
            }
        }
        best
    }
}

/// What the worst corner of a multicopter's curves adds, m.
fn by_corners(items: &[FlownItem], copter: &Multicopter) -> f64 {
    let places = flat(items, f64::INFINITY);
    let mut level_m = 0.0_f64;
    let mut lead_m = 0.0_f64;
    for k in 1..items.len() {
        if !items[k].curved {
            continue;
        }
        let length_m = norm(minus(places[k], places[k - 1]));
        let time_s = length_m
            / items[k]
                .speed_mps
                .min(copter.on_chord_mps(length_m))
                .max(0.1);
        let rise_m = items[k].position.alt_m - items[k - 1].position.alt_m;
        lead_m = lead_m.max(copter.lead_m(rise_m, time_s));
        for corner in [k - 1, k] {
            if let (Some(before), Some(after)) = (
                corner.checked_sub(1).map(|b| places[b]),
                places.get(corner + 1),
            ) {
                let legs = [minus(places[corner], before), minus(*after, places[corner])];
                level_m = level_m.max(copter.corner_m(
                    legs,
                    items[corner].speed_mps.max(items[k].speed_mps),
                    items[corner].acceptance_m,
                ));
            }
        }
        level_m = level_m.max(copter.straight_m(items[k].speed_mps));
    }
    level_m.hypot(lead_m)
}

/// The strongest wind for which wings are predicted, as a part of their air speed.
pub const MAX_WIND_SHARE: f64 = 0.6;
/// Items before and after the curves that are included.
const AROUND: usize = 3;
/// After this time, s, a vehicle flies along its line: the rest of a leg changes nothing, and is left out.
const ON_LINE_S: f64 = 25.0;
/// Directions of the wind.
const WINDS: u32 = 8;
/// A track is matched with the part of the route this far before and behind its last match, m.
const WINDOW_M: f64 = 150.0;
/// A margin on the computed deviation: the largest measured ratio of flown to computed was 1.3
/// (docs/guide/curves.md).
const WING_FACTOR: f64 = 1.4;
/// Added for effects that are not computed: estimate, gusts, height, m.
const WING_M: f64 = 2.0;
