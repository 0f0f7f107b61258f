//! Curves within a number of items: the smallest tolerance that the items allow.
//!
//! The whole mission is made anew for each tolerance that is tried, so that what is counted is what is flown: speed
//! changes, straight legs and jumps too.

use crate::curve::Curving;
use crate::plan::Plan;
use crate::route::{CompiledMission, Reason, RouteError, Site, compile_within};

/// The mission with the smallest tolerance that its items allow; none where even the coarsest needs more.
///
/// # Errors
/// Anything but too many items: a coarser tolerance does not mend it.
pub(crate) fn compile(
    plan: &Plan,
    initial: u16,
    site: &Site,
) -> Result<Option<CompiledMission>, RouteError> {
    let try_with = |tolerance_m| {
        let curving = Curving {
            tolerance_m,
            ..site.curving
        };
        match compile_within(plan, initial, &Site { curving, ..*site }) {
            Ok(compiled) => Ok(Some(compiled)),
            Err(RouteError {
                reason: Reason::TooManyItems(_),
                ..
            }) => Ok(None),
            Err(other) => Err(other),
        }
    };
    let mut low_m = site.curving.tolerance_m;
    let (mut best, mut high_m) = loop {
        // A straight route gains nothing, and a curve this coarse is not the one that was drawn.
        if low_m >= COARSEST_M {
            return Ok(None);
        }
        let tried_m = (2.0 * low_m).min(COARSEST_M);
        match try_with(tried_m)? {
            Some(compiled) => break (compiled, tried_m),
            None => low_m = tried_m,
        }
    };
    while high_m > CLOSE * low_m {
        let tried_m = (low_m * high_m).sqrt();
        match try_with(tried_m)? {
            Some(compiled) => (best, high_m) = (compiled, tried_m),
            None => low_m = tried_m,
        }
    }
    Ok(Some(best))
}

/// The coarsest tolerance that a configuration may name, m.
const COARSEST_M: f64 = 100.0;
/// Relative width at which the smallest tolerance is known.
const CLOSE: f64 = 1.01;
