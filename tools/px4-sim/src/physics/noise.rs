//! Noise: the difference between the vehicle's estimate and the truth, and between its flight and the planned path.
//!
//! Everything random in a vehicle comes from generators seeded by [`Config::seed`](crate::Config::seed), one for each
//! part, so that the same settings give the same flight to the last bit.

use rand_xoshiro::SplitMix64;
use rand_xoshiro::rand_core::{Rng as _, SeedableRng as _};

use super::motion::Ned;

/// A seeded source of normally distributed numbers.
#[derive(Debug, Clone)]
pub(crate) struct Noise(SplitMix64);

impl Noise {
    /// Starts at `seed`.
    pub(crate) fn new(seed: u64) -> Self {
        Self(SplitMix64::from_seed(seed.to_le_bytes()))
    }

    /// Nearly normal, with standard deviation one: the sum of twelve uniforms, so at most six in size, which bounds
    /// the gusts.
    fn normal(&mut self) -> f64 {
        (0..12).map(|_| self.uniform()).sum::<f64>() - 6.0
    }

    /// Uniform in [0, 1): the 53 bits that a double holds.
    fn uniform(&mut self) -> f64 {
        (self.0.next_u64() >> 11) as f64 / (1_u64 << 53) as f64
    }
}

/// Noise with memory: a first-order Gauss-Markov process.
#[derive(Debug, Clone)]
pub(crate) struct Drift {
    value: f64,
    sigma: f64,
    tau_s: f64,
}

impl Drift {
    /// Starts at zero, and wanders with deviation `sigma` and correlation time `tau_s`.
    pub(crate) fn new(sigma: f64, tau_s: f64) -> Self {
        Self {
            value: 0.0,
            sigma,
            tau_s,
        }
    }

    /// Advances by `dt_s` and returns the new value.
    pub(crate) fn step(&mut self, dt_s: f64, noise: &mut Noise) -> f64 {
        let keep = (-dt_s / self.tau_s).exp();
        self.value = self.value * keep + noise.normal() * self.sigma * (1.0 - keep * keep).sqrt();
        self.value
    }
}

/// The vehicle's estimate of its position: the truth, plus errors that wander slowly.
#[derive(Debug, Clone)]
pub(crate) struct Estimator {
    position: [Drift; 3],
    gnss: [Drift; 3],
    noise: Noise,
}

impl Estimator {
    /// Errors like those of a GNSS and inertial solution: decimetres, over tens of seconds.
    pub(crate) fn new(seed: u64) -> Self {
        let drifts = |all: [(f64, f64); 3]| all.map(|(sigma, tau_s)| Drift::new(sigma, tau_s));
        Self {
            position: drifts([(0.08, 20.0), (0.08, 20.0), (0.05, 15.0)]),
            gnss: drifts([(0.25, 5.0), (0.25, 5.0), (0.4, 8.0)]),
            noise: Noise::new(seed ^ 0xE5F1),
        }
    }

    /// One step.
    pub(crate) fn step(&mut self, dt: f64) {
        for drift in self.position.iter_mut().chain(&mut self.gnss) {
            drift.step(dt, &mut self.noise);
        }
    }

    /// Estimated position minus true position.
    pub(crate) fn position_error(&self) -> Ned {
        error(&self.position)
    }

    /// Error of the raw GNSS fix.
    pub(crate) fn gnss_error(&self) -> Ned {
        error(&self.gnss)
    }
}

fn error([n, e, d]: &[Drift; 3]) -> Ned {
    Ned::new(n.value, e.value, d.value)
}
