//! The simulated network between a ground station and the vehicle, and how bad it may be.

use std::time::Duration;

use kit::network::{self, Faults};
use mavlink::dialects::development::MavMessage;

/// The two ends.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) enum End {
    Ground,
    Vehicle,
}

pub(crate) type Network = network::Network<End, MavMessage>;

const GOOD_5_MS: Faults = Faults {
    overtaking: true,
    ..Faults::NONE.delayed_ms(5, 5)
};
/// Everything arrives, in order.
pub(crate) const FAIR: Faults = GOOD_5_MS;
pub(crate) const RADIO: Faults = Faults {
    loss: 0.2,
    ..GOOD_5_MS.delayed_ms(60, 60)
};
pub(crate) const BAD: Faults = Faults {
    loss: 0.4,
    ..GOOD_5_MS.delayed_ms(20, 60)
};
pub(crate) const WILD: Faults = Faults {
    loss: 0.25,
    duplicate: 0.1,
    ..GOOD_5_MS.delayed_ms(1, 120)
};
/// Nothing arrives.
pub(crate) const DEAD: Faults = Faults {
    loss: 1.0,
    ..GOOD_5_MS
};

/// Loses everything that is on its way.
pub(crate) fn clear(network: &mut Network) {
    while network.receive(Duration::MAX).is_some() {}
}
