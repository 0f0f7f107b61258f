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

/// Says that it is alive, twice in each period that the service manager waits; ends at once where it does not wait.
///
/// Runs beside the machine on its one thread: where the machine hangs nothing is said, and the service is restarted.
pub async fn keep_alive() {
    let mut micros = 0;
    if !sd_notify::watchdog_enabled(false, &mut micros) {
        return;
    }
    // `interval` panics on a period of zero.
    let mut ticks = tokio::time::interval(Duration::from_micros(micros / 2).max(SHORTEST));
    loop {
        ticks.tick().await;
        say(NotifyState::Watchdog);
    }
}

fn say(state: NotifyState<'_>) {
    if let Err(cause) = sd_notify::notify(false, &[state]) {
        tracing::warn!("the service manager cannot be notified: {cause}");
    }
}

const SHORTEST: Duration = Duration::from_millis(10);
