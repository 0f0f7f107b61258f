//! The fewest legs through a track: cubic Bezier legs, or straight ones, within a two-sided tolerance.
//!
//! Promised of a [`Fitted`]: every leg starts and ends on a fix, joints are shared bit for bit, and no point of a leg
//! is further than `deviation_m` from its part of the polyline of fixes, nor the other way, as measured by samples a
//! quarter of the tolerance apart at most; `deviation_m` is at most the tolerance.

mod chain;
mod corner;
mod deviation;
mod pair;
mod plane;
mod smooth;
mod straight;
mod track;

use thiserror::Error;

use crate::leg::{BezierLeg, Control, LegError};
use chain::{Parts, Shape};
use pair::{PairFit, Scratch, Tangents};
use track::Sampled;

pub use straight::{Start, Straightened, straighten};
pub use track::{Track, TrackError};

/// How legs meet.
#[derive(Clone, Copy, Debug, Default, Eq, PartialEq)]
pub enum Continuity {
    /// In place only.
    #[default]
    G0,
    /// In place and direction, save at corners.
    G1,
}

/// How to fit.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FitOptions {
    /// Greatest deviation both ways on the ground, m.
    pub tolerance_m: f64,
    /// How legs meet.
    pub continuity: Continuity,
    /// A fix where the track turns by more than this is a corner and becomes a joint, degrees; none, no corners.
    pub corner_deg: Option<f64>,
}

/// A fitted route.
#[derive(Clone, Debug, PartialEq)]
pub struct Fitted {
    /// The legs in order; of a closed track, the last ends where the first starts.
    pub legs: Vec<BezierLeg>,
    /// The fix that each leg starts at, and the one that the last ends at.
    pub joints: Vec<usize>,
    /// Greatest deviation both ways, m.
    pub deviation_m: f64,
}

/// Why a track cannot be fitted.
#[derive(Clone, Copy, Debug, Error, PartialEq)]
pub enum FitError {
    /// The tolerance is out of range.
    #[error("tolerance is {tolerance_m} m, expected {least_m} to {most_m} m")]
    Tolerance {
        /// What was asked for, m.
        tolerance_m: f64,
        /// The least, m.
        least_m: f64,
        /// The most, m.
        most_m: f64,
    },
    /// The search found nothing that a dense measure confirms.
    #[error("the best fit is {deviation_m} m off, expected at most {tolerance_m} m")]
    NotWithin {
        /// What was reached, m.
        deviation_m: f64,
        /// What was asked for, m.
        tolerance_m: f64,
    },
    /// A leg between two fixes is not legal: they are too far apart.
    #[error("leg from fix {from}: {error}")]
    Leg {
        /// The fix that it starts at.
        from: usize,
        /// What is wrong with it.
        error: LegError,
    },
}

/// The fewest cubic legs found through a track; `progress` is told the part done, 0 to 1.
///
/// # Errors
/// When the tolerance is out of range, or two fixes are further apart than a leg may be long.
pub fn fit(
    track: &Track,
    options: &FitOptions,
    progress: &mut dyn FnMut(f64),
) -> Result<Fitted, FitError> {
    check_tolerance(options.tolerance_m)?;
    let sampled = Sampled::new(track, options.tolerance_m);
    let corners = options.corner_deg.map_or_else(Vec::new, |deg| {
        corner::corners(&sampled, deg, CORNER_REACH * options.tolerance_m)
    });
    let shape = Shape {
        count: sampled.count,
        closed: sampled.closed,
        corners: &corners,
    };
    let mut inner_m = options.tolerance_m * (1.0 - SAMPLING_RESERVE);
    let mut deviation_m = f64::INFINITY;
    let spacing_m = VERIFY * options.tolerance_m;
    for confirm_m in [None, None, Some(spacing_m)] {
        let mut cubics = Cubics {
            sampled: &sampled,
            tolerance_m: inner_m,
            confirm_m,
            scratch: Scratch::default(),
        };
        let links = search(&mut cubics, &shape, options.continuity, progress);
        let fitted = measured(track, &sampled, links, spacing_m)?;
        if fitted.deviation_m <= options.tolerance_m {
            return Ok(fitted);
        }
        // Something lay between the samples of the search: once more with as much in reserve, and where that moves
        // it elsewhere only, with no leg taken that the dense measure refuses.
        deviation_m = fitted.deviation_m;
        inner_m *= 0.999 * options.tolerance_m / deviation_m;
    }
    Err(FitError::NotWithin {
        deviation_m,
        tolerance_m: options.tolerance_m,
    })
}

/// The legs of one search, not yet measured densely.
fn search(
    cubics: &mut Cubics<'_>,
    shape: &Shape<'_>,
    continuity: Continuity,
    progress: &mut dyn FnMut(f64),
) -> Vec<smooth::Link> {
    let share = if continuity == Continuity::G0 {
        1.0
    } else {
        0.5
    };
    let reaches = chain::reaches(shape, cubics, &mut |done| progress(share * done));
    match continuity {
        Continuity::G0 => chain::fewest(shape, &reaches, cubics)
            .windows(2)
            .map(|pair| {
                let lap = if shape.closed {
                    pair[0] / shape.count * shape.count
                } else {
                    0
                };
                let (i, j) = (pair[0] - lap, pair[1] - lap);
                (i, j, cubics.fit(i, j, Tangents::FREE).cubic)
            })
            .collect(),
        Continuity::G1 => smooth::fewest(shape, &reaches, cubics, &mut |done| {
            progress(share + share * done)
        }),
    }
}

/// The route of `links` and how far it strays, by samples `spacing_m` apart.
fn measured(
    track: &Track,
    sampled: &Sampled,
    links: Vec<smooth::Link>,
    spacing_m: f64,
) -> Result<Fitted, FitError> {
    let end = |k: usize| track.fixes()[k % sampled.count];
    let mut legs = Vec::with_capacity(links.len());
    let mut joints: Vec<usize> = links.iter().map(|link| link.0 % sampled.count).collect();
    joints.extend(links.last().map(|link| link.1 % sampled.count));
    let mut deviation_m: f64 = 0.0;
    for (i, j, cubic) in links {
        deviation_m = deviation_m.max(sampled.deviation_m(&cubic, (i, j), spacing_m));
        let control = |k: usize| {
            let g = sampled
                .plane
                .unproject(cubic.0[k])
                .unwrap_or_else(|| end(i).ground());
            Control::level(g.lat_deg, g.lon_deg)
        };
        let leg = BezierLeg::new(end(i), control(1), control(2), end(j));
        legs.push(leg.map_err(|error| FitError::Leg {
            from: i % sampled.count,
            error,
        })?);
    }
    Ok(Fitted {
        legs,
        joints,
        deviation_m,
    })
}

struct Cubics<'a> {
    sampled: &'a Sampled,
    tolerance_m: f64,
    /// The spacing that each leg is measured with again before it is taken, m; none, the search's samples do.
    confirm_m: Option<f64>,
    scratch: Scratch,
}

impl Cubics<'_> {
    /// The best leg found between two fixes.
    fn fit(&mut self, i: usize, j: usize, tangents: Tangents) -> PairFit {
        let (points, arc_m) = self.sampled.part(i, j);
        let mut found = PairFit::run(points, arc_m, tangents, self.tolerance_m, &mut self.scratch);
        if let (Some(spacing_m), true) = (self.confirm_m, found.deviation_m <= self.tolerance_m) {
            found.deviation_m = self.sampled.deviation_m(&found.cubic, (i, j), spacing_m);
        }
        if j == i + 1 && found.deviation_m > self.tolerance_m {
            // Between neighbours the track is a chord, and arms that are short enough keep to it.
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
    fn fitting(&mut self, i: usize, j: usize, tangents: Tangents) -> Option<plane::Cubic2> {
        let found = self.fit(i, j, tangents);
        (found.deviation_m <= self.tolerance_m).then_some(found.cubic)
    }
}

impl Parts for Cubics<'_> {
    fn fits(&mut self, i: usize, j: usize) -> bool {
        j <= self.sampled.last_fix() && self.fitting(i, j, Tangents::FREE).is_some()
    }
}

pub(crate) fn check_tolerance(tolerance_m: f64) -> Result<(), FitError> {
    const MIN_M: f64 = 0.01;
    const MAX_M: f64 = 10_000.0;
    if (MIN_M..=MAX_M).contains(&tolerance_m) {
        Ok(())
    } else {
        Err(FitError::Tolerance {
            tolerance_m,
            least_m: MIN_M,
            most_m: MAX_M,
        })
    }
}

/// Kept back from the tolerance while searching, for what lies between the samples.
const SAMPLING_RESERVE: f64 = 2e-3;
/// Spacing of the samples that a found leg is measured with, as a part of the tolerance.
const VERIFY: f64 = 0.25;
/// How far to either side a corner is looked at, as a multiple of the tolerance.
const CORNER_REACH: f64 = 3.0;
