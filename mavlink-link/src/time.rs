//! The two clocks that a caller passes with every call.
//!
//! Nothing in this crate reads a clock. `mono` drives every timeout and never goes back; `wall` is
//! only ever compared with the stored ceiling of the signing clock and may jump by years.

use core::time::Duration;

/// One reading of both clocks, taken by the caller.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Now {
    /// Time since an arbitrary start of the process; never goes back.
    pub mono: Duration,
    /// Time since 1970-01-01 UTC as the computer believes it; may jump either way.
    pub wall: Duration,
}

impl Now {
    /// Both clocks advanced by the same span, as happens where nobody sets the wall clock.
    #[must_use]
    pub fn after(self, span: Duration) -> Self {
        Self {
            mono: self.mono.saturating_add(span),
            wall: self.wall.saturating_add(span),
        }
    }
}
