//! The time, as the shell tells it to the session.

use std::time::Duration;

/// One moment on two clocks.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Now {
    /// Since any fixed moment, never going back: for time-outs.
    pub mono: Duration,
    /// Unix time in ms: for stamps.
    pub unix_ms: u64,
}
