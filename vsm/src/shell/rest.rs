//! The rest of a link or socket that has failed, in a loop that serves several.
//!
//! One that fails each time, as a serial line that was unplugged, must neither use a whole core nor flood the log. A pause of
//! the loop would stop the others too: PX4's datagrams would wait in their socket, and what is decided by them would be
//! decided by the past.

use std::io;
use std::time::{Duration, Instant};

/// When a source may be asked again, and when its failure was last logged.
#[derive(Debug, Default)]
pub(super) struct Rest {
    until: Option<Instant>,
    logged: Option<Instant>,
}

impl Rest {
    /// What `source` returns, which is not asked before the rest is over. May be dropped at any time.
    pub(super) async fn before<T>(&self, source: impl Future<Output = T>) -> T {
        if let Some(until) = self.until.filter(|until| Instant::now() < *until) {
            tokio::time::sleep_until(until.into()).await;
        }
        source.await
    }

    /// The source has failed.
    pub(super) fn begin(&mut self, what: &str, cause: &io::Error) {
        let now = Instant::now();
        self.until = Some(now + REST);
        if self.logged.is_none_or(|at| now - at >= LOGGED_EVERY) {
            self.logged = Some(now);
            tracing::warn!("{what}: {cause}");
        }
    }
}

/// A line that was unplugged wakes the thread four times a second until a person comes.
const REST: Duration = Duration::from_millis(250);
const LOGGED_EVERY: Duration = Duration::from_secs(60);

#[cfg(test)]
mod tests {
    use super::*;

    #[tokio::test]
    async fn a_source_that_fails_is_asked_after_its_rest_and_logged_once_a_minute() {
        let mut rest = Rest::default();
        rest.before(std::future::ready(())).await;
        for _ in 0..3 {
            rest.begin("a link", &io::ErrorKind::UnexpectedEof.into());
            let begun = Instant::now();
            rest.before(std::future::ready(())).await;
            let took = begun.elapsed();
            assert!(took >= REST - Duration::from_millis(5), "{took:?}");
        }
        // Since the first.
        assert!(rest.logged.unwrap().elapsed() >= 2 * REST);
    }
}
