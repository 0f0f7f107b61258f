//! Orders to zeroize that were accepted, and the outcome of each.

use core::time::Duration;
use std::collections::VecDeque;

use crate::exchange::gate::Gate;
use crate::exchange::order::{Nonce, ZeroizeReport};

/// In the order in which they were accepted.
pub(super) type Orders<A> = VecDeque<Taken<A>>;

/// An accepted order.
#[derive(Debug)]
pub(super) struct Taken<A> {
    pub(super) number: Nonce,
    pub(super) session: u32,
    /// Where it last came from.
    pub(super) from: A,
    pub(super) gate: Gate,
    /// Its challenge holds for some time after this.
    pub(super) at: Duration,
    /// `None` until the caller has decided.
    pub(super) report: Option<ZeroizeReport>,
}
