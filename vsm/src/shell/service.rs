//! What a service manager is told: ready, alive, stopping. Without one nothing is said.

use std::time::Duration;

use sd_notify::NotifyState;

/// Says that the bridge serves.
pub fn ready() {
    say(NotifyState::Ready);
}

/// Says that it stops.
pub fn stopping() {
    say(NotifyState::Stopping);
}

/// Says that it is alive. Whoever calls this has found out that every part of the program works: silent, the program is
/// ended and started again.
pub fn alive() {
    say(NotifyState::Watchdog);
}

/// How often [`alive`] is expected: twice in each period that the service manager waits; `None` where it does not wait.
#[must_use]
pub fn ping_interval() -> Option<Duration> {
    let mut micros = 0;
    sd_notify::watchdog_enabled(false, &mut micros)
        // A timer with a period of zero panics.
        .then(|| Duration::from_micros(micros / 2).max(SHORTEST))
}

fn say(state: NotifyState<'_>) {
    if let Err(cause) = sd_notify::notify(false, &[state]) {
        tracing::warn!("the service manager cannot be notified: {cause}");
    }
}

const SHORTEST: Duration = Duration::from_millis(10);
