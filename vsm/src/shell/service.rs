//! Notifies a service manager: ready, alive, stopping. Without one nothing is sent.

use std::sync::mpsc::RecvTimeoutError;
use std::time::Duration;

use sd_notify::NotifyState;

/// Reports that the bridge serves.
pub fn ready() {
    notify(NotifyState::Ready);
}

/// Reports that it stops.
pub fn stopping() {
    notify(NotifyState::Stopping);
}

/// Reports that it is alive. The caller must have checked that every part of the program works: without this report the
/// program is ended and restarted.
pub fn alive() {
    notify(NotifyState::Watchdog);
}

/// Keeps a service manager from ending this program during long `work`, at a start too.
pub fn while_busy<T>(work: impl FnOnce() -> T) -> T {
    let (done, ended) = std::sync::mpsc::channel::<()>();
    std::thread::scope(move |scope| {
        scope.spawn(move || {
            let pause = ping_interval().unwrap_or(BUSY).min(BUSY);
            while ended.recv_timeout(pause) == Err(RecvTimeoutError::Timeout) {
                alive();
                notify(NotifyState::ExtendTimeoutUsec(EXTENDED_US));
            }
        });
        let result = work();
        drop(done);
        result
    })
}

/// How often [`alive`] is expected: twice in each period of the service manager; `None` if it has none.
#[must_use]
pub fn ping_interval() -> Option<Duration> {
    let mut micros = 0;
    sd_notify::watchdog_enabled(false, &mut micros)
        // A timer with a period of zero panics.
        .then(|| Duration::from_micros(micros / 2).max(SHORTEST))
}

fn notify(state: NotifyState<'_>) {
    if let Err(cause) = sd_notify::notify(false, &[state]) {
        tracing::warn!("the service manager cannot be notified: {cause}");
    }
}

const BUSY: Duration = Duration::from_secs(2);
const EXTENDED_US: u32 = 30_000_000;
const SHORTEST: Duration = Duration::from_millis(10);
