//! The progress of an order to zeroize: what is sent, and how long its report is awaited.

use core::time::Duration;

use crate::exchange::order::{Order, ZeroizeReport};

/// An order in progress.
#[derive(Debug)]
pub(super) struct Ordering {
    pub(super) order: Order,
    pub(super) session: u32,
    pub(super) next_at: Duration,
    /// When it was sent with its challenge and is not answered yet.
    pub(super) asked_at: Option<Duration>,
    /// When the order ends, if nothing is received before.
    pub(super) silent_at: Duration,
    /// When the order ends in any case.
    pub(super) over_at: Duration,
    pub(super) reported: Option<ZeroizeReport>,
    pub(super) due: bool,
}
