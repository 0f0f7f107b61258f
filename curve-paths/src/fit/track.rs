//! The track to fit: a checked sequence of fixes, projected, with samples between them.

use thiserror::Error;

use super::plane::{Cubic2, Plane, Vec2, two_sided_m};
use crate::leg::{LegError, check_altitude, check_ground};
use crate::wgs84::{Ground, Position};

/// A recorded or drawn track: at least two fixes, no two successive ones in the same place.
#[derive(Clone, Debug, PartialEq)]
pub struct Track {
    fixes: Vec<Position>,
    closed: bool,
}

/// Why a sequence of fixes is not a track.
#[derive(Clone, Copy, Debug, Error, PartialEq)]
pub enum TrackError {
    /// Too few different fixes.
    #[error("{count} different fixes, expected at least {min}")]
    TooFew {
        /// How many there are, repeated ones counted once.
        count: usize,
        /// How many are needed: 2, or 3 for a closed track.
        min: usize,
    },
    /// A fix is not a position.
    #[error("fix {index}: {error}")]
    Fix {
        /// The fix, from 0.
        index: usize,
        /// What is wrong with it.
        error: LegError,
    },
    /// The track is too wide for one plane.
    #[error(
        "fix {index} is {distance_m:.0} m from the middle of the track, expected at most {max_m:.0} m"
    )]
    TooWide {
        /// The fix, from 0.
        index: usize,
        /// Its distance from the middle, m.
        distance_m: f64,
        /// The greatest allowed distance, m.
        max_m: f64,
    },
}

impl Track {
    /// A track of these fixes; repeated successive fixes count once. A closed track returns from its last fix to its
    /// first, and need not repeat it.
    ///
    /// # Errors
    /// A fix is not a position, too few fixes differ, or the track is wider than 200 km.
    pub fn new(fixes: &[Position], closed: bool) -> Result<Self, TrackError> {
        let mut kept: Vec<Position> = Vec::with_capacity(fixes.len());
        for (index, fix) in fixes.iter().enumerate() {
            check_ground("fix", fix.ground())
                .and_then(|()| check_altitude("fix", fix.alt_m))
                .map_err(|error| TrackError::Fix { index, error })?;
            if kept
                .last()
                .is_none_or(|last| last.ground().distance_m(fix.ground()) > SAME_PLACE_M)
            {
                kept.push(*fix);
            }
        }
        // A closed track that repeats its first fix at its end would be closed by a gap without length.
        if let (true, [first, .., last]) = (closed, &kept[..])
            && first.ground().distance_m(last.ground()) <= SAME_PLACE_M
        {
            kept.pop();
        }
        let min = if closed { 3 } else { 2 };
        if kept.len() < min {
            return Err(TrackError::TooFew {
                count: kept.len(),
                min,
            });
        }
        let track = Self {
            fixes: kept,
            closed,
        };
        let middle = track.middle();
        for (index, fix) in track.fixes.iter().enumerate() {
            let distance_m = middle.distance_m(fix.ground());
            if distance_m > MAX_REACH_M {
                return Err(TrackError::TooWide {
                    index,
                    distance_m,
                    max_m: MAX_REACH_M,
                });
            }
        }
        Ok(track)
    }

    /// Its fixes, repeated ones left out.
    #[must_use]
    pub fn fixes(&self) -> &[Position] {
        &self.fixes
    }

    /// Whether it returns to its first fix.
    #[must_use]
    pub const fn is_closed(&self) -> bool {
        self.closed
    }

    /// The number of gaps between fixes, the closing one included.
    #[must_use]
    pub fn gaps(&self) -> usize {
        self.fixes.len() - usize::from(!self.closed)
    }

    pub(crate) fn middle(&self) -> Ground {
        let ecef = |p: &Position| p.ground().to_ecef();
        let sum = self
            .fixes
            .iter()
            .map(ecef)
            .fold(Default::default(), |a: crate::vector::Vec3, b| a + b);
        Ground::from_ecef(sum * (1.0 / self.fixes.len() as f64))
    }
}

/// A track in the plane, with samples between the fixes. A closed track is written out twice, so that every part of
/// it is a slice.
#[derive(Debug)]
pub(crate) struct Sampled {
    pub(crate) plane: Plane,
    /// Fixes and points between them, evenly on each gap.
    pub(crate) points: Vec<Vec2>,
    /// Length of the track up to each point, m.
    pub(crate) arc_m: Vec<f64>,
    /// For each fix, its index in `points`.
    pub(crate) fix: Vec<usize>,
    /// Number of different fixes.
    pub(crate) count: usize,
    pub(crate) closed: bool,
}

impl Sampled {
    pub(crate) fn new(track: &Track, tolerance_m: f64) -> Self {
        let plane = Plane::at(track.middle());
        let flat: Vec<Vec2> = track
            .fixes
            .iter()
            .map(|f| plane.project(f.ground()))
            .collect();
        let count = flat.len();
        let rounds = if track.closed { 2 * count + 1 } else { count };
        let spacing_m = SPACING * tolerance_m.sqrt();
        let mut sampled = Self {
            plane,
            points: Vec::new(),
            arc_m: Vec::new(),
            fix: Vec::new(),
            count,
            closed: track.closed,
        };
        let mut arc_m = 0.0;
        for k in 0..rounds {
            let here = flat[k % count];
            if k > 0 {
                let from = flat[(k - 1) % count];
                let gap_m = (here - from).norm();
                let steps = (gap_m / spacing_m).ceil().clamp(2.0, 64.0) as usize;
                for i in 1..steps {
                    let f = i as f64 / steps as f64;
                    sampled.points.push(from.lerp(here, f));
                    sampled.arc_m.push(arc_m + gap_m * f);
                }
                arc_m += gap_m;
            }
            sampled.fix.push(sampled.points.len());
            sampled.points.push(here);
            sampled.arc_m.push(arc_m);
        }
        sampled
    }

    /// The last fix that a part may end at: for a closed track the whole second round.
    pub(crate) fn last_fix(&self) -> usize {
        self.fix.len() - 1
    }

    /// The samples from fix `i` to fix `j`.
    pub(crate) fn part(&self, i: usize, j: usize) -> (&[Vec2], &[f64]) {
        let range = self.fix[i]..=self.fix[j];
        (&self.points[range.clone()], &self.arc_m[range])
    }

    /// The place of a fix, of either round.
    pub(crate) fn at_fix(&self, i: usize) -> Vec2 {
        self.points[self.fix[i]]
    }

    /// The deviation both ways between a leg and its part of the track, fix `i` to fix `j`, by samples `spacing_m`
    /// apart at most, m.
    pub(crate) fn deviation_m(&self, leg: &Cubic2, (i, j): (usize, usize), spacing_m: f64) -> f64 {
        let fixes: Vec<Vec2> = (i..=j).map(|k| self.at_fix(k)).collect();
        two_sided_m(leg, &fixes, spacing_m)
    }
}

/// The fixes at which the track, compared over `reach_m` before and after, turns by more than `corner_deg`; of
/// several within that reach, the one that turns most. Ascending.
pub(crate) fn corners(track: &Sampled, corner_deg: f64, reach_m: f64) -> Vec<usize> {
    let turns: Vec<f64> = (0..track.count)
        .map(|i| turn_deg(track, i, reach_m))
        .collect();
    let arc = |i: usize| track.arc_m[track.fix[i]];
    let lap_m = if track.closed {
        arc(track.count)
    } else {
        f64::INFINITY
    };
    let is_top = |&i: &usize| {
        turns[i] > corner_deg
            && (0..track.count).all(|k| {
                let apart = (arc(k) - arc(i)).abs();
                let near = apart.min(lap_m - apart) <= reach_m;
                k == i || !near || turns[k] < turns[i] || (turns[k] == turns[i] && k > i)
            })
    };
    (0..track.count).filter(is_top).collect()
}

fn turn_deg(track: &Sampled, i: usize, reach_m: f64) -> f64 {
    if !track.closed && (i == 0 || i == track.count - 1) {
        return 0.0;
    }
    // In the second round of a closed track every fix but the last few has room on both sides.
    let k = track.fix[if track.closed && i < track.count / 2 {
        i + track.count
    } else {
        i
    }];
    let here = track.arc_m[k];
    let (before, after) = (at(track, here - reach_m), at(track, here + reach_m));
    let (a, b) = (track.points[k] - before, after - track.points[k]);
    a.cross(b).atan2(a.dot(b)).abs().to_degrees()
}

/// The point of the track at this length along it; beyond its ends, the end.
fn at(track: &Sampled, arc_m: f64) -> Vec2 {
    let k = track.arc_m.partition_point(|&a| a < arc_m);
    if k == 0 {
        return track.points[0];
    }
    if k == track.points.len() {
        return track.points[k - 1];
    }
    let (a, b) = (track.arc_m[k - 1], track.arc_m[k]);
    track.points[k - 1].lerp(track.points[k], (arc_m - a) / (b - a))
}

/// Fixes closer than this are one, m.
const SAME_PLACE_M: f64 = 1e-4;
/// Greatest distance of a fix from the middle of its track, m: beyond it the error of the projection would count.
const MAX_REACH_M: f64 = 100_000.0;
/// Spacing of samples on a long gap, m for a tolerance of 1 m: a polyline's gaps are straight, the curve's are not.
const SPACING: f64 = 6.0;
