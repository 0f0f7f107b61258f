//! The fewest straight legs with vertices on the fixes: a proven optimum, not a heuristic search.
//!
//! A chord may replace a part of the track when every fix of the part is within the tolerance of the chord. That
//! bounds both sides: the polyline runs from one end of the chord to the other, so some point of it lies across from
//! every point of the chord, on a segment whose ends, and therefore all of it, are within the tolerance.

use super::error::{FitError, check_tolerance};
use super::plane::Vec2;
use super::track::{Sampled, Track};

/// The fewest straight legs.
#[derive(Clone, Debug, PartialEq)]
pub struct Straightened {
    /// The fixes that are vertices, in order; on a closed track the first is repeated at the end.
    pub joints: Vec<usize>,
    /// Greatest deviation both ways, m.
    pub deviation_m: f64,
}

impl Straightened {
    /// The number of legs.
    #[must_use]
    pub fn legs(&self) -> usize {
        self.joints.len() - 1
    }
}

/// Where a closed chain may start.
#[derive(Clone, Copy, Debug, Default, Eq, PartialEq)]
pub enum Start {
    /// At the first fix, as a route that is flown from there.
    #[default]
    First,
    /// At whichever fix saves a leg.
    Any,
}

/// The fewest straight legs through fixes of the track; of several such sets, the one with the smallest sum of
/// deviations.
///
/// # Errors
/// When the tolerance is out of range.
pub fn straighten(track: &Track, tolerance_m: f64, start: Start) -> Result<Straightened, FitError> {
    check_tolerance(tolerance_m)?;
    let sampled = Sampled::new(track, tolerance_m);
    let count = sampled.count;
    let fixes: Vec<Vec2> = (0..=sampled.last_fix())
        .map(|k| sampled.at_fix(k))
        .collect();
    let starts = if sampled.closed { count } else { count - 1 };
    let ends: Vec<Vec<(u32, f32)>> = (0..starts)
        .map(|i| ends_of(&fixes, i, count, sampled.closed, tolerance_m))
        .collect();
    // Wherever a closed chain starts, some vertex of it lies within the longest leg from fix 0.
    let first = if sampled.closed && start == Start::Any {
        ends[0].last().map_or(1, |e| e.0 as usize)
    } else {
        1
    };
    let mut best: Option<(usize, f64, Vec<usize>)> = None;
    for start in 0..first.min(count) {
        let end = if sampled.closed {
            start + count
        } else {
            count - 1
        };
        if let Some((legs, sum, joints)) = shortest(&ends, start, end, count)
            && best.as_ref().is_none_or(|(l, s, _)| (legs, sum) < (*l, *s))
        {
            best = Some((legs, sum, joints));
        }
    }
    let joints = best.map(|b| b.2).unwrap_or_default();
    let deviation_m = joints
        .windows(2)
        .map(|pair| deviation2(&fixes, pair[0] % count, pair[1] - pair[0] / count * count))
        .fold(0.0, f64::max)
        .sqrt();
    Ok(Straightened {
        joints: joints.into_iter().map(|j| j % count).collect(),
        deviation_m,
    })
}

/// The fixes that one chord from `i` can end at, each with its deviation.
fn ends_of(
    fixes: &[Vec2],
    i: usize,
    count: usize,
    closed: bool,
    tolerance_m: f64,
) -> Vec<(u32, f32)> {
    let limit = if closed { i + count } else { count - 1 };
    let mut ends = Vec::new();
    // Stops past the furthest fix that any chord could reach: there the track is further from its start than the
    // tolerance from every chord. In practice, a run of failures as long as the run of successes shows that.
    let mut misses = 0;
    for j in i + 1..=limit {
        let d2 = deviation2(fixes, i, j);
        if d2 <= tolerance_m * tolerance_m {
            ends.push((j as u32, d2.sqrt() as f32));
            misses = 0;
        } else {
            misses += 1;
            if misses > 16 + 2 * ends.len() {
                break;
            }
        }
    }
    ends
}

fn deviation2(fixes: &[Vec2], i: usize, j: usize) -> f64 {
    (i + 1..j)
        .map(|k| fixes[k].to_segment2(fixes[i], fixes[j]))
        .fold(0.0, f64::max)
}

/// Fewest legs from `start` to `end`, then least sum of deviations.
fn shortest(
    ends: &[Vec<(u32, f32)>],
    start: usize,
    end: usize,
    count: usize,
) -> Option<(usize, f64, Vec<usize>)> {
    let n = end - start + 1;
    let mut cost: Vec<(usize, f64, usize)> = vec![(usize::MAX, 0.0, 0); n];
    cost[0] = (0, 0.0, 0);
    for i in start..end {
        let (legs, sum, _) = cost[i - start];
        if legs == usize::MAX {
            continue;
        }
        let lap = i / count * count;
        for &(j, deviation) in &ends[i - lap] {
            let j = j as usize + lap;
            if j > end {
                break;
            }
            let next = &mut cost[j - start];
            let new = (legs + 1, sum + f64::from(deviation));
            if new < (next.0, next.1) {
                *next = (new.0, new.1, i);
            }
        }
    }
    let (legs, sum, _) = cost[n - 1];
    if legs == usize::MAX {
        return None;
    }
    let mut joints = vec![end];
    while let Some(&at) = joints.last()
        && at > start
    {
        joints.push(cost[at - start].2);
    }
    joints.reverse();
    Some((legs, sum, joints))
}
