//! A chain whose legs also share their direction where they meet.
//!
//! Each leg starts in the direction in which the one before it arrived, and reaches as far as it can with its own end
//! free; the last leg of a closed track is given both tangents. The best start is not known beforehand, so starts
//! along the whole first leg are tried.

use super::chain::Shape;
use super::pair::{MIN_ARM, Tangents};
use super::parts::Cubics;
use super::plane::{Cubic2, Vec2};

/// A leg of a chain: from fix, to fix (in the second round where necessary), and the curve.
pub(crate) type Link = (usize, usize, Cubic2);

/// The shortest smooth chain found. `reaches` are those of legs free at both ends: no leg reaches further.
pub(crate) fn fewest(
    shape: &Shape<'_>,
    reaches: &[usize],
    cubics: &mut Cubics<'_>,
    progress: &mut dyn FnMut(f64),
) -> Vec<Link> {
    let mut starts = shape.starts();
    if starts.len() > 1 {
        let first = reaches[0].min(shape.count);
        let stride = (first / STARTS).max(1);
        starts = (0..first).step_by(stride).collect();
    }
    let mut best: Option<Vec<Link>> = None;
    let tries = starts.len();
    for (k, start) in starts.into_iter().enumerate() {
        progress(k as f64 / tries as f64);
        let max = best.as_ref().map_or(usize::MAX, Vec::len);
        if let Some(chain) = chain_from(start, shape, reaches, cubics, max) {
            best = Some(chain);
        }
    }
    progress(1.0);
    best.unwrap_or_default()
}

/// The chain from one start; `None` once it cannot be shorter than `most`.
fn chain_from(
    start: usize,
    shape: &Shape<'_>,
    reaches: &[usize],
    cubics: &mut Cubics<'_>,
    max: usize,
) -> Option<Vec<Link>> {
    let end = shape.end(start);
    let is_corner = |i: usize| shape.corners.contains(&(i % shape.count));
    let mut chain: Vec<Link> = Vec::new();
    let mut at = start;
    let mut direction: Option<Vec2> = None;
    while at < end {
        if chain.len() + 1 >= max {
            return None;
        }
        let lap = shape.lap(at);
        let reach = (reaches[at - lap] + lap).min(end);
        let closing = match chain.first() {
            Some((_, _, first)) if shape.closed && !is_corner(end) => Some(leaving(first)),
            _ => None,
        };
        let mut fit = |to: usize, end_tangent: Option<Vec2>| {
            let tangents = Tangents {
                start: direction,
                end: end_tangent,
            };
            cubics
                .fitting(at - lap, to - lap, tangents)
                .filter(|c| to == at + 1 || has_arms(c))
        };
        let mut to = reach;
        let cubic = loop {
            let tangent = if to == end { closing } else { None };
            if let Some(cubic) = fit(to, tangent) {
                break cubic;
            }
            // A last leg that cannot close the track alone is halved: both halves then fit.
            to = if to == end && closing.is_some() {
                at + (end - at).div_ceil(2).min(end - at - 1)
            } else {
                to - 1
            };
            if to <= at {
                return None;
            }
        };
        chain.push((at - lap, to - lap, cubic));
        direction = (!is_corner(to)).then(|| arriving(&cubic));
        at = to;
    }
    Some(chain)
}

/// Whether both arms are long enough to define a direction.
fn has_arms(c: &Cubic2) -> bool {
    let min = 0.99 * MIN_ARM * (c.0[3] - c.0[0]).norm();
    (c.0[1] - c.0[0]).norm() >= min && (c.0[3] - c.0[2]).norm() >= min
}

fn leaving(c: &Cubic2) -> Vec2 {
    (c.0[1] - c.0[0]).unit()
}

fn arriving(c: &Cubic2) -> Vec2 {
    (c.0[3] - c.0[2]).unit()
}

/// Starts tried on a closed track without corners.
const STARTS: usize = 32;
