//! Rules that are judged in flight.

use super::Scene;

use crate::bench::station::Station;
use crate::bench::trial::Trial;
use crate::verdict::Judged;

pub(super) const SCENES: &[Scene] = &[];

/// A straight piece of flight.
#[derive(Clone, Copy, Debug)]
pub(super) struct Track {
    pub(super) distance: f64,
    pub(super) course: f64,
    pub(super) heading: Option<f64>,
}

pub(super) fn tracks(_t: &Trial, _a: &Station) -> Judged<Vec<Track>> {
    Ok(Vec::new())
}
