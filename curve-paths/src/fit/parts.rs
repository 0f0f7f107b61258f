//! The legs that a search may take: the best cubic between two fixes.

use super::chain::Parts;
use super::pair::{PairFit, Scratch, Tangents};
use super::plane;
use super::track::Sampled;

/// Fits a leg between any two fixes of a track.
pub(super) struct Cubics<'a> {
    pub(super) sampled: &'a Sampled,
    pub(super) tolerance_m: f64,
    /// Spacing, m, of a dense measurement that each leg must pass as well; `None` where the search's samples are
    /// enough.
    pub(super) confirm_m: Option<f64>,
    pub(super) scratch: Scratch,
}

impl Cubics<'_> {
    /// The best leg found between two fixes.
    pub(super) fn fit(&mut self, i: usize, j: usize, tangents: Tangents) -> PairFit {
        let (points, arc_m) = self.sampled.part(i, j);
        let mut found = PairFit::run(points, arc_m, tangents, self.tolerance_m, &mut self.scratch);
        if let (Some(spacing_m), true) = (self.confirm_m, found.deviation_m <= self.tolerance_m) {
            found.deviation_m = self.sampled.deviation_m(&found.cubic, (i, j), spacing_m);
        }
        if j == i + 1 && found.deviation_m > self.tolerance_m {
            // Between neighbours the track is a chord, and a leg with arms that are short enough stays on it.
            return PairFit::chord(
                points[0],
                points[points.len() - 1],
                tangents,
                self.tolerance_m,
            );
        }
        found
    }

    /// A leg within the tolerance between two fixes, when one is found.
    pub(super) fn fitting(
        &mut self,
        i: usize,
        j: usize,
        tangents: Tangents,
    ) -> Option<plane::Cubic2> {
        let found = self.fit(i, j, tangents);
        (found.deviation_m <= self.tolerance_m).then_some(found.cubic)
    }
}

impl Parts for Cubics<'_> {
    fn fits(&mut self, i: usize, j: usize) -> bool {
        j <= self.sampled.last_fix() && self.fitting(i, j, Tangents::FREE).is_some()
    }
}
