//! Why a track is not fitted, and the allowed tolerances.

use thiserror::Error;

use crate::leg::LegError;

/// Why a track cannot be fitted.
#[derive(Clone, Copy, Debug, Error, PartialEq)]
pub enum FitError {
    /// The tolerance is out of range.
    #[error("tolerance is {tolerance_m} m, expected {min_m} to {max_m} m")]
    Tolerance {
        /// The requested tolerance, m.
        tolerance_m: f64,
        /// The smallest, m.
        min_m: f64,
        /// The largest, m.
        max_m: f64,
    },
    /// No fit that was found passed the dense measurement.
    #[error("the best fit is {deviation_m} m off, expected at most {tolerance_m} m")]
    NotWithin {
        /// The deviation of the best fit, m.
        deviation_m: f64,
        /// The requested tolerance, m.
        tolerance_m: f64,
    },
    /// A leg between two fixes is not legal: they are too far apart.
    #[error("leg from fix {from}: {error}")]
    Leg {
        /// The fix that it starts at.
        from: usize,
        /// What is wrong with the leg.
        error: LegError,
    },
}

/// Checks a tolerance, m.
///
/// # Errors
/// It is out of range.
pub(super) fn check_tolerance(tolerance_m: f64) -> Result<(), FitError> {
    const MIN_M: f64 = 0.01;
    const MAX_M: f64 = 10_000.0;
    if (MIN_M..=MAX_M).contains(&tolerance_m) {
        Ok(())
    } else {
        Err(FitError::Tolerance {
            tolerance_m,
            min_m: MIN_M,
            max_m: MAX_M,
        })
    }
}
