//! What the vehicle believes of itself: the truth, and errors that wander slowly.

use super::geo::Ned;
use super::rng::{Drift, Rng};

/// Errors of position and of the sensors shown raw.
#[derive(Debug, Clone)]
pub(super) struct Estimator {
    position: [Drift; 3],
    gnss: [Drift; 3],
    rng: Rng,
}

impl Estimator {
    /// Errors as a GNSS and inertial solution has them: decimetres, over tens of seconds.
    pub(super) fn new(seed: u64) -> Self {
        Self {
            position: [
                Drift::new(0.08, 20.0),
                Drift::new(0.08, 20.0),
                Drift::new(0.05, 15.0),
            ],
            gnss: [
                Drift::new(0.25, 5.0),
                Drift::new(0.25, 5.0),
                Drift::new(0.4, 8.0),
            ],
            rng: Rng::new(seed ^ 0xE5F1),
        }
    }

    /// One step.
    pub(super) fn step(&mut self, dt: f64) {
        for drift in self.position.iter_mut().chain(&mut self.gnss) {
            drift.step(dt, &mut self.rng);
        }
    }

    /// Believed position less true position.
    pub(super) fn position_error(&self) -> Ned {
        let [n, e, d] = &self.position;
        Ned::new(n.value(), e.value(), d.value())
    }

    /// Error of the raw GNSS fix.
    pub(super) fn gnss_error(&self) -> Ned {
        let [n, e, d] = &self.gnss;
        Ned::new(n.value(), e.value(), d.value())
    }
}
