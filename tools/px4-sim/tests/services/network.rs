//! A network that loses, doubles, delays and reorders, as its seed says.

use std::collections::BTreeMap;
use std::time::Duration;

use mavlink::dialects::development::MavMessage;

/// How a network treats each message, one way or the other.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Weather {
    /// Lost, in percent.
    pub(crate) loss: u64,
    /// Delivered twice, in percent.
    pub(crate) double: u64,
    /// Delay in milliseconds, from and to; the spread makes messages overtake each other.
    pub(crate) delay_ms: (u64, u64),
}

pub(crate) const FAIR: Weather = Weather {
    loss: 0,
    double: 0,
    delay_ms: (5, 5),
};
pub(crate) const RADIO: Weather = Weather {
    loss: 20,
    double: 0,
    delay_ms: (60, 60),
};
pub(crate) const BAD: Weather = Weather {
    loss: 40,
    double: 0,
    delay_ms: (20, 60),
};
pub(crate) const WILD: Weather = Weather {
    loss: 25,
    double: 10,
    delay_ms: (1, 120),
};

pub(crate) struct Network {
    pub(crate) weather: Weather,
    seed: u64,
    /// By time and order of sending: whether it goes to the vehicle, and what.
    pub(crate) flying: BTreeMap<(Duration, u64), (bool, MavMessage)>,
    sent: u64,
}

impl Network {
    pub(crate) fn new(weather: Weather, seed: u64) -> Self {
        Self {
            weather,
            seed,
            flying: BTreeMap::new(),
            sent: 0,
        }
    }

    pub(crate) fn send(&mut self, now: Duration, to_vehicle: bool, message: &MavMessage) {
        let copies = if self.percent(self.weather.double) {
            2
        } else {
            1
        };
        for _ in 0..copies {
            if self.percent(self.weather.loss) {
                continue;
            }
            let (from, to) = self.weather.delay_ms;
            let delay = from + self.random() % (to - from + 1);
            self.sent += 1;
            let at = now + Duration::from_millis(delay);
            self.flying
                .insert((at, self.sent), (to_vehicle, message.clone()));
        }
    }

    pub(crate) fn next_at(&self) -> Option<Duration> {
        self.flying.keys().next().map(|(at, _)| *at)
    }

    pub(crate) fn arrive(&mut self, now: Duration) -> Option<(bool, MavMessage)> {
        let entry = self.flying.first_entry()?;
        (entry.key().0 <= now).then(|| entry.remove())
    }

    pub(crate) fn percent(&mut self, chance: u64) -> bool {
        self.random() % 100 < chance
    }

    /// SplitMix64.
    pub(crate) fn random(&mut self) -> u64 {
        self.seed = self.seed.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.seed;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }
}
