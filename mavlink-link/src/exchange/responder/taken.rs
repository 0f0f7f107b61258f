//! Orders to zeroize that were taken, and what has become of each.

use core::time::Duration;
use std::collections::VecDeque;

use crate::exchange::gate::Gate;
use crate::exchange::order::{Nonce, ZeroizeReport};

/// In the order in which they were taken.
pub(super) type Orders<A> = VecDeque<Taken<A>>;

/// An order that was taken.
#[derive(Debug)]
pub(super) struct Taken<A> {
    pub(super) number: Nonce,
    pub(super) session: u32,
    /// Where it came from last.
    pub(super) from: A,
    pub(super) gate: Gate,
    /// Its challenge holds for some time after this.
    pub(super) at: Duration,
    /// None until the caller has decided.
    pub(super) report: Option<ZeroizeReport>,
}
