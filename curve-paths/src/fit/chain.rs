//! From pairs to a chain: the fewest parts that cover the track, each of which alone keeps the tolerance.
//!
//! For every fix the furthest end is found that one leg can reach. Shorter parts of a part that fits almost always
//! fit too, so the fewest legs are those of the longest strides; where that is not so (the fit of the shorter part
//! fails), the stride is taken back until all legs fit. A closed track is tried from every start: one leg fewer hangs
//! on it.

/// What a chain is made of: a way to try one part.
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

    /// The fixes of the whole rounds before fix `i`: none on a track that is not closed.
    pub(crate) fn lap(&self, i: usize) -> usize {
        i / self.count * self.count
    }
}

/// For each fix the furthest end that one leg reaches, found by walking on from its neighbour's. `progress` receives
/// the part done, 0 to 1.
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
        // On, past a few failures: what fails at one fix may fit at the next.
        let mut stride = if i == 0 { 4 } else { 1 };
        while j <= limit && misses <= MISSES {
            if parts.fits(i, j) {
                furthest = Some(j);
                misses = 0;
            } else if stride > 1 {
                // Strode too far: on from the last that fitted, one by one.
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
        // Or back. Neighbours are joined by the track itself, so the next fix is always reached.
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
    // The strides themselves fit; the last leg is the one that was cut short.
    let chosen = chains.iter().position(|joints| match joints[..] {
        [.., a, b] => reach(a) == b || parts.fits(a % shape.count, b - shape.lap(a)),
        _ => false,
    });
    let mut joints = chains.swap_remove(chosen.unwrap_or(0));
    if chosen.is_none() {
        mend(&mut joints, shape, parts);
    }
    joints
}

/// Splits the last leg until its parts fit.
fn mend(joints: &mut Vec<usize>, shape: &Shape<'_>, parts: &mut dyn Parts) {
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

/// Failures in a row after which a reach is taken as found.
const MISSES: u32 = 8;
