//! The fewest legs through a track: cubic Bezier legs, or straight ones, within a two-sided tolerance.
//!
//! Promised of a [`Fitted`]: every leg starts and ends on a fix, joints are shared bit for bit, and no point of a leg
//! is further than `deviation_m` from its part of the polyline of fixes, nor the other way, as measured by samples a
//! quarter of the tolerance apart at most; `deviation_m` is at most the tolerance.

mod chain;
mod error;
mod pair;
mod parts;
mod plane;
mod smooth;
mod straight;
mod track;

use crate::leg::{BezierLeg, Control};
use chain::Shape;
use error::check_tolerance;
use pair::{Scratch, Tangents};
use parts::Cubics;
use track::Sampled;

pub use error::FitError;
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

/// The fewest cubic legs found through a track; `progress` receives the part done, 0 to 1.
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
        track::corners(&sampled, deg, CORNER_REACH * options.tolerance_m)
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
        // The curve deviated between the samples of the search. Tried again with that much in reserve; where that
        // only moves the deviation elsewhere, once more with every leg confirmed by the dense measurement.
        deviation_m = fitted.deviation_m;
        inner_m *= 0.999 * options.tolerance_m / deviation_m;
    }
    Err(FitError::NotWithin {
        deviation_m,
        tolerance_m: options.tolerance_m,
    })
}

/// The legs of one search, not measured densely yet.
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
                let lap = shape.lap(pair[0]);
                let (i, j) = (pair[0] - lap, pair[1] - lap);
                (i, j, cubics.fit(i, j, Tangents::FREE).cubic)
            })
            .collect(),
        Continuity::G1 => smooth::fewest(shape, &reaches, cubics, &mut |done| {
            progress(share + share * done)
        }),
    }
}

/// The route of `links` and its deviation from the track, by samples `spacing_m` apart.
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

/// Kept back from the tolerance while searching, for what lies between the samples.
const SAMPLING_RESERVE: f64 = 2e-3;
/// Spacing of the samples that a found leg is measured with, as a part of the tolerance.
const VERIFY: f64 = 0.25;
/// How far to either side of a fix its turn is measured, as a multiple of the tolerance.
const CORNER_REACH: f64 = 3.0;
