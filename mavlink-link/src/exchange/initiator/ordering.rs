//! How far an order to zeroize is: what is sent, and until when its report is waited for.

use core::time::Duration;

use crate::exchange::order::{Order, ZeroizeReport};

/// An order on its way.
#[derive(Debug)]
pub(super) struct Ordering {
    pub(super) order: Order,
    pub(super) session: u32,
    pub(super) next_at: Duration,
    /// It is sent with its challenge, and not answered, since then.
    pub(super) asked_at: Option<Duration>,
    /// When nobody has answered for long enough.
    pub(super) silent_at: Duration,
    /// When what has not been reported is not waited for any more.
    pub(super) over_at: Duration,
    pub(super) reported: Option<ZeroizeReport>,
    pub(super) due: bool,
}
