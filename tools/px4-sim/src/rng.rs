//! The one source of noise: SplitMix64, seeded, the same on every machine. Not for secrets.

/// A small seeded generator.
#[derive(Debug, Clone)]
pub(super) struct Rng(u64);

impl Rng {
    /// Starts at `seed`.
    pub(super) fn new(seed: u64) -> Self {
        Self(seed)
    }

    /// The next 64 bits.
    pub(super) fn bits(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        z ^ (z >> 31)
    }

    /// Uniform in [0, 1).
    pub(super) fn unit(&mut self) -> f64 {
        (self.bits() >> 11) as f64 / (1u64 << 53) as f64
    }

    /// Close to normal, standard deviation one: the sum of twelve uniforms, so at most six.
    pub(super) fn normal(&mut self) -> f64 {
        (0..12).map(|_| self.unit()).sum::<f64>() - 6.0
    }
}

/// Noise with a memory: first-order Gauss-Markov.
#[derive(Debug, Clone)]
pub(super) struct Drift {
    value: f64,
    sigma: f64,
    tau_s: f64,
}

impl Drift {
    /// Zero now; wanders with deviation `sigma` and correlation time `tau_s`.
    pub(super) fn new(sigma: f64, tau_s: f64) -> Self {
        Self {
            value: 0.0,
            sigma,
            tau_s,
        }
    }

    /// Steps by `dt_s` and gives the new value.
    pub(super) fn step(&mut self, dt_s: f64, rng: &mut Rng) -> f64 {
        let keep = (-dt_s / self.tau_s).exp();
        self.value = self.value * keep + rng.normal() * self.sigma * (1.0 - keep * keep).sqrt();
        self.value
    }

    /// The present value.
    pub(super) fn value(&self) -> f64 {
        self.value
    }
}
