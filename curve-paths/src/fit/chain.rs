//! From pairs to a chain: the fewest parts that cover the track, each of which alone keeps the tolerance.
//!
//! For every fix the furthest end that one leg can reach is searched. Shorter parts of a part that fits almost always
//! fit too, so always taking the longest stride gives the fewest legs. Where a shorter part does not fit, the stride
//! is shortened until all legs fit. A closed track is tried from every start, since the start can decide whether one
//! more leg is needed.

/// What a chain is made of: a way to try one part of the track.
pub(crate) trait Parts {
    /// Whether one leg can stand for the track from fix `i` to fix `j`, i < j.
    fn fits(&mut self, i: usize, j: usize) -> bool;
}

/// The track as the search sees it.
#[derive(Clone, Debug)]
pub(crate) struct Shape<'a> {
    /// Number of different fixes.
    pub(crate) count: usize,
    pub(crate) closed: bool,
    /// Fixes that must be joints, ascending, each below `count`.
    pub(crate) corners: &'a [usize],
}

impl Shape<'_> {
    /// The last fix that a leg from `i` may end at.
    pub(crate) fn limit(&self, i: usize) -> usize {
        let end = self.end(i);
        let next = |from: usize, lap: usize| {
            self.corners
                .iter()
                .copied()
                .find(|&c| c + lap > from)
                .map(|c| c + lap)
        };
        next(i, 0)
            .or_else(|| {
                if self.closed {
                    next(i, self.count)
                } else {
                    None
                }
            })
            .map_or(end, |c| c.min(end))
    }

    /// The fixes that a chain may start from.
    pub(crate) fn starts(&self) -> Vec<usize> {
        if !self.closed {
            vec![0]
        } else if let Some(&corner) = self.corners.first() {
            vec![corner]
        } else {
            (0..self.count).collect()
        }
    }

    /// The fix that a chain from `start` must end at.
    pub(crate) fn end(&self, start: usize) -> usize {
        if self.closed {
            start + self.count
        } else {
            self.count - 1
        }
    }

    /// The fixes of whole rounds before fix `i`; 0 on a track that is not closed.
    pub(crate) fn lap(&self, i: usize) -> usize {
        i / self.count * self.count
    }
}

/// For each fix the furthest end that one leg reaches, searched from that of the fix before. `progress` receives the
/// finished part, 0 to 1.
pub(crate) fn reaches(
    shape: &Shape<'_>,
    parts: &mut dyn Parts,
    progress: &mut dyn FnMut(f64),
) -> Vec<usize> {
    let mut reaches: Vec<usize> = Vec::with_capacity(shape.count);
    let last_start = if shape.closed {
        shape.count
    } else {
        shape.count - 1
    };
    for i in 0..last_start {
        progress(i as f64 / last_start as f64);
        let limit = shape.limit(i);
        let from = reaches.last().copied().unwrap_or(i + 1).clamp(i + 1, limit);
        let mut furthest = None;
        let mut j = from;
        let mut misses = 0;
        // Forwards, past a few failures: what fails to one fix may fit to the next.
        let mut stride = if i == 0 { 4 } else { 1 };
        while j <= limit && misses <= MISSES {
            if parts.fits(i, j) {
                furthest = Some(j);
                misses = 0;
            } else if stride > 1 {
                // The stride was too long: forwards from the last fix that fitted, one at a time.
                j = furthest.map_or(from, |last| last + 1);
                stride = 1;
                continue;
            } else {
                misses += 1;
            }
            if j == limit {
                break;
            }
            j = (j + stride).min(limit);
        }
        // Otherwise backwards. Neighbours are joined by the track itself, so the next fix can always be reached.
        let mut j = from;
        while furthest.is_none() {
            j -= 1;
            if j <= i + 1 || parts.fits(i, j) {
                furthest = Some(j.max(i + 1));
            }
        }
        reaches.push(furthest.unwrap_or(i + 1));
    }
    progress(1.0);
    reaches
}

/// The joints of the shortest chain of parts that all fit, first and last included.
pub(crate) fn fewest(shape: &Shape<'_>, reaches: &[usize], parts: &mut dyn Parts) -> Vec<usize> {
    let reach = |i: usize| {
        let lap = shape.lap(i);
        reaches[i - lap] + lap
    };
    let stride = |start: usize| {
        let end = shape.end(start);
        let mut joints = vec![start];
        let mut at = start;
        while at < end {
            at = reach(at).min(end);
            joints.push(at);
        }
        joints
    };
    let mut chains: Vec<Vec<usize>> = shape.starts().into_iter().map(stride).collect();
    chains.sort_by_key(Vec::len);
    // Each stride is known to fit; only the last leg, which was cut short at the end, is tried again.
    let chosen = chains.iter().position(|joints| match joints[..] {
        [.., a, b] => reach(a) == b || parts.fits(a % shape.count, b - shape.lap(a)),
        _ => false,
    });
    let mut joints = chains.swap_remove(chosen.unwrap_or(0));
    if chosen.is_none() {
        split_last_leg(&mut joints, shape, parts);
    }
    joints
}

/// Splits the last leg until its parts fit.
fn split_last_leg(joints: &mut Vec<usize>, shape: &Shape<'_>, parts: &mut dyn Parts) {
    let Some(end) = joints.pop() else { return };
    while let Some(&a) = joints.last() {
        let lap = shape.lap(a);
        let mut b = end;
        while b > a + 1 && !parts.fits(a - lap, b - lap) {
            b -= 1;
        }
        joints.push(b);
        if b == end {
            return;
        }
    }
}

/// Failures in a row after which the furthest end counts as found.
const MISSES: u32 = 8;
