//! What a vehicle reports about each cause, by the evidence that its telemetry keeps.

use mapping::telemetry::Telemetry;

use super::cause::{Seen, What};
use super::provision::Provision;

/// Reports about engine, position, fence and battery. `outside`: whether a place (latitude, longitude) is outside the
/// fence, if there is one.
pub(crate) fn reported(
    telemetry: &Telemetry,
    config: &Provision,
    outside: Option<&dyn Fn((f64, f64)) -> bool>,
) -> [Option<Seen>; 4] {
    let evidence = &telemetry.evidence;
    let bad = |bad: bool| if bad { What::Present } else { What::Absent };
    let seen = |number, what| Seen { number, what };
    let engine = evidence.motors.map(|one| seen(one.number, bad(!one.value)));
    let located = evidence.located;
    let position = located.map(|one| seen(one.number, bad(!one.value)));
    let place = evidence.place.filter(|_| config.fence.is_some());
    let fence = place.zip(outside).map(|(one, outside)| {
        // Without a valid position, the reported place proves no breach.
        let what = match located.is_some_and(|located| !located.value) {
            true => What::Between,
            false => bad(outside(one.value)),
        };
        seen(one.number, what)
    });
    let battery = evidence.battery.map(|one| {
        let below = config.battery_percent;
        let what = match one.value {
            left if left < below => What::Present,
            left if left < below.saturating_add(RECOVERS_PERCENT) => What::Between,
            _ => What::Absent,
        };
        seen(one.number, what)
    });
    [engine, position, fence, battery]
}

/// By how much a battery must recover before it counts as charged again, per cent.
const RECOVERS_PERCENT: u8 = 5;
