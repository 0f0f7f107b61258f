//! The smallest tolerance that a number of items allows.

use thiserror::Error;

use crate::densify::{Densified, DensifyError, Leg, Options, check, densify};
use crate::walk::{Rules, count};

/// A route densified to a number of vertices.
#[derive(Clone, Debug, PartialEq)]
pub struct Budgeted {
    /// The vertices, and what is proven of them.
    pub densified: Densified,
    /// The tolerance that they were made with, m: the smallest that the budget allows, to a tenth of a percent.
    pub tolerance_m: f64,
}

/// Why no tolerance fits the budget.
#[derive(Clone, Copy, Debug, Error, PartialEq)]
pub enum BudgetError {
    /// The route's own waypoints are too many already.
    #[error("at most {max_vertices} vertices, but the ends of the legs alone are {least}")]
    TooFew {
        /// What was allowed.
        max_vertices: usize,
        /// The ends of the legs, joints counted once.
        least: usize,
    },
    /// The route cannot be densified at all.
    #[error(transparent)]
    Densify(#[from] DensifyError),
}

/// The vertices of a whole route, at most `max_vertices` of them, first and last counted, with the smallest tolerance
/// that allows it. The tolerance in `options` is the smallest that is of use; more vertices than it needs are not
/// spent.
///
/// # Errors
/// When the legs' own ends exceed the budget, or the route cannot be densified.
pub fn densify_to_budget(
    legs: &[Leg],
    max_vertices: usize,
    options: &Options,
) -> Result<Budgeted, BudgetError> {
    let fixed_m = check(legs, options)?;
    let least = legs.len() + 1;
    if max_vertices < least {
        return Err(BudgetError::TooFew {
            max_vertices,
            least,
        });
    }
    let inner = |vertices: usize| (vertices - legs.len()).max(1) as f64;
    let needs = |tolerance_m: f64| {
        let rules = Rules {
            tolerance_m: tolerance_m - fixed_m,
            min_chord_m: 0.0,
            charges: options.charges,
        };
        let enough = 2 * max_vertices;
        let mut total = 1;
        for leg in legs {
            total += match leg {
                Leg::Straight { .. } => 1,
                Leg::Bezier(leg) => count(leg, &rules, enough),
            };
            if total > enough {
                break;
            }
        }
        total
    };
    let mut tolerance_m = options.tolerance_m;
    let mut needed = needs(tolerance_m);
    if needed <= max_vertices {
        let densified = densify(legs, options)?;
        return Ok(Budgeted {
            densified,
            tolerance_m,
        });
    }
    let (mut low, mut high) = (tolerance_m, f64::INFINITY);
    // Chords grow with the root of the tolerance, so the number says how far off it is; the number moves in steps, so
    // after a few such guesses the interval is halved.
    let mut guesses = 0;
    while high > low * NARROW {
        let scale = (inner(needed) / inner(max_vertices)).powi(2);
        let guess = fixed_m + (tolerance_m - fixed_m) * scale;
        tolerance_m = if guesses < GUESSES && guess > low && guess < high {
            guess
        } else if high.is_finite() {
            (low * high).sqrt()
        } else {
            2.0 * low.max(tolerance_m)
        };
        guesses += 1;
        needed = needs(tolerance_m);
        if needed <= max_vertices {
            high = tolerance_m;
        } else {
            low = tolerance_m;
        }
    }
    // The least chord can ask for more than the count did: then the tolerance gives way by small steps.
    let mut last = None;
    for _ in 0..LEAST_CHORD_STEPS {
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
        high *= LEAST_CHORD_STEP;
    }
    let too_few = BudgetError::TooFew {
        max_vertices,
        least: max_vertices + 1,
    };
    Err(last.map_or(too_few, BudgetError::Densify))
}

/// Relative width at which the smallest tolerance is known.
const NARROW: f64 = 1.001;
/// Guesses before halving.
const GUESSES: u32 = 4;
/// Steps, and their size, by which a tolerance gives way to the least chord: a thousandfold in all.
const LEAST_CHORD_STEPS: u32 = 200;
const LEAST_CHORD_STEP: f64 = 1.035;
