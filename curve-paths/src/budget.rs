//! The smallest tolerance that a number of items allows.
//!
//! For each leg, the number of chords grows almost with the inverse root of the tolerance. So one walk predicts the next
//! tolerance to try, and a few walks enclose the smallest one.

use thiserror::Error;

use crate::densify::{DensifyError, Leg, Options, check, densify};
use crate::leg::BezierLeg;
use crate::local::ErrorAllowance;
use crate::walk::{Densified, Rules, length, length_guessed};

/// A route densified to a number of vertices.
#[derive(Clone, Debug, PartialEq)]
pub struct Budgeted {
    /// The vertices, with their proven bound.
    pub densified: Densified,
    /// Their tolerance, m: the smallest that the budget allows, to a tenth of a percent.
    pub tolerance_m: f64,
}

/// Why no tolerance fits the budget.
#[derive(Clone, Copy, Debug, Error, PartialEq)]
pub enum BudgetError {
    /// The route's own waypoints already exceed the budget.
    #[error("at most {max_vertices} vertices, but the ends of the legs alone are {min}")]
    TooFew {
        /// The allowed number.
        max_vertices: usize,
        /// The ends of the legs, joints counted once.
        min: usize,
    },
    /// The route cannot be densified at all.
    #[error(transparent)]
    Densify(#[from] DensifyError),
}

/// The vertices of a whole route, at most `max_vertices`, first and last counted, with the smallest tolerance that allows
/// this. The tolerance in `options` is the smallest useful one: no more vertices are used than it needs.
///
/// # Errors
/// When the legs' own ends exceed the budget, or the route cannot be densified.
pub fn densify_to_budget(
    legs: &[Leg],
    max_vertices: usize,
    options: &Options,
) -> Result<Budgeted, BudgetError> {
    let fixed_m = check(legs, options)?;
    let min = legs.len() + 1;
    if max_vertices < min {
        return Err(BudgetError::TooFew { max_vertices, min });
    }
    let curves = Curves::new(legs, max_vertices, options);
    let requested_m = options.tolerance_m - fixed_m;
    let mut high = if curves.fit(requested_m) {
        let densified = densify(legs, options)?;
        let tolerance_m = options.tolerance_m;
        if densified.vertices.len() <= max_vertices {
            return Ok(Budgeted {
                densified,
                tolerance_m,
            });
        }
        tolerance_m
    } else {
        fixed_m + curves.smallest(requested_m)
    };
    // The minimum chord may need a larger tolerance than the count did: then the tolerance grows in small steps.
    let mut last = None;
    for _ in 0..MIN_CHORD_STEPS {
        match densify(
            legs,
            &Options {
                tolerance_m: high,
                ..*options
            },
        ) {
            Ok(densified) if densified.vertices.len() <= max_vertices => {
                return Ok(Budgeted {
                    densified,
                    tolerance_m: high,
                });
            }
            Ok(_) => {}
            Err(error) => last = Some(error),
        }
        high *= MIN_CHORD_STEP;
    }
    let too_few = BudgetError::TooFew {
        max_vertices,
        min: max_vertices + 1,
    };
    Err(last.map_or(too_few, BudgetError::Densify))
}

/// The curved legs of a route, and the most chords they may have.
struct Curves<'a> {
    legs: Vec<&'a BezierLeg>,
    max: usize,
    allowance: ErrorAllowance,
}

impl<'a> Curves<'a> {
    fn new(legs: &'a [Leg], max_vertices: usize, options: &Options) -> Self {
        let curves = legs.iter().filter_map(|leg| match leg {
            Leg::Bezier(leg) => Some(leg),
            Leg::Straight { .. } => None,
        });
        let curves: Vec<&BezierLeg> = curves.collect();
        // One vertex begins the route, and each straight leg ends in one.
        let others = 1 + legs.len() - curves.len();
        Self {
            legs: curves,
            max: max_vertices.saturating_sub(others),
            allowance: options.allowance,
        }
    }

    fn rules(&self, tolerance_m: f64) -> Rules {
        Rules {
            tolerance_m,
            min_chord_m: 0.0,
            allowance: self.allowance,
        }
    }

    /// Whether the legs fit at this tolerance, with the fixed allowance subtracted; it stops counting once they do
    /// not.
    fn fit(&self, tolerance_m: f64) -> bool {
        let rules = self.rules(tolerance_m);
        let mut left = self.max;
        self.legs.iter().all(|leg| {
            let chords = length(leg, &rules, left).ceil() as usize;
            let fits = chords <= left;
            left = left.saturating_sub(chords);
            fits
        })
    }

    /// The smallest tolerance, m, at which the legs fit, to [`NARROW`]; they do not fit at `low`.
    fn smallest(&self, mut low: f64) -> f64 {
        let mut high = f64::INFINITY;
        let mut at = low;
        let guessed = |leg: &&BezierLeg| length_guessed(leg, &self.rules(at));
        let mut lengths: Vec<f64> = self.legs.iter().map(guessed).collect();
        let mut walks = 0;
        while high > low * NARROW {
            // Tried just above and just below the prediction of the last walk, above first: if it is right, both ends of
            // the interval are found.
            let aim = at * self.scale(&lengths);
            let near = if high > aim * BESIDE * BESIDE {
                aim * BESIDE
            } else {
                aim / BESIDE
            };
            at = if walks < PREDICTED_WALKS && near > low && near < high {
                near
            } else if high.is_finite() {
                (low * high).sqrt()
            } else {
                2.0 * low
            };
            walks += 1;
            let rules = self.rules(at);
            // A leg that far exceeds the budget needs no exact count.
            let enough = 4 * self.max;
            let mut chords = 0;
            for (leg, known) in self.legs.iter().zip(&mut lengths) {
                *known = length(leg, &rules, enough);
                chords += known.ceil() as usize;
            }
            if chords <= self.max {
                high = at;
            } else {
                low = at;
            }
        }
        high
    }

    /// The factor by which the tolerance of these lengths must grow, so that each leg's chords, rounded up, fit.
    fn scale(&self, lengths: &[f64]) -> f64 {
        let chords = |shrink: f64| -> usize {
            let whole = |length: &f64| ((length * shrink).ceil() as usize).max(1);
            lengths.iter().map(whole).sum()
        };
        let (mut fits, mut over) = (0.0, 1.0);
        while chords(over) <= self.max && over < MAX_SHRINK {
            (fits, over) = (over, 2.0 * over);
        }
        for _ in 0..SHRINK_STEPS {
            let middle = 0.5 * (fits + over);
            if chords(middle) <= self.max {
                fits = middle;
            } else {
                over = middle;
            }
        }
        // The number of chords goes with the inverse root of the tolerance.
        1.0 / (fits * fits)
    }
}

/// The relative width to which the smallest tolerance is determined.
const NARROW: f64 = 1.001;
/// How far beside the prediction to try: two such steps are within the width.
const BESIDE: f64 = 1.000_3;
/// Walks that use the prediction of the one before; after these the interval is halved.
const PREDICTED_WALKS: u32 = 10;
/// The largest factor by which lengths are stretched.
const MAX_SHRINK: f64 = 1e6;
/// Halvings of the interval in which the shrinking is sought.
const SHRINK_STEPS: u32 = 24;
/// Number and size of the steps by which the tolerance grows for the minimum chord: a thousandfold in all.
const MIN_CHORD_STEPS: u32 = 200;
/// Each step of the tolerance, as a factor.
const MIN_CHORD_STEP: f64 = 1.035;
