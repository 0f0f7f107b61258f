//! Where the other end may be while no packet of it has verified in this run.
//!
//! An end that was started again has no keys, so that every packet is as good as any: anybody can send one, from any address
//! that he writes on it, and be the last to have done so however often the other end sends its own. What begins an exchange
//! therefore goes to where an earlier process has found the other end, which nobody can change from outside, again and
//! again; and to [`Callers`] once for each call: who only had his address forged is sent less than twice as much as was sent
//! in his name.

use core::time::Duration;

use crate::exchange::Callers;

/// The places, of which none is proven.
#[derive(Debug)]
pub(super) struct Places<A> {
    /// By configuration: then it is nowhere else.
    fixed: Option<A>,
    /// Where an earlier process has found it.
    before: Option<A>,
    /// Something has arrived that may be of the other end.
    received: bool,
    pub(super) callers: Callers<A>,
}

impl<A: Copy + Eq> Places<A> {
    pub(super) fn new(fixed: Option<A>, before: Option<A>) -> Self {
        Self {
            fixed,
            before,
            received: false,
            callers: Callers::default(),
        }
    }

    pub(super) fn fixed(&self) -> Option<A> {
        self.fixed
    }

    /// Where it is, or was last. `proven`: where it was in this run.
    pub(super) fn known(&self, proven: Option<A>) -> Option<A> {
        self.fixed.or(proven).or(self.before)
    }

    /// Whether there is anybody to send to.
    pub(super) fn is_any(&self, proven: Option<A>) -> bool {
        self.received || self.known(proven).is_some()
    }

    /// Anybody can have sent this.
    pub(super) fn note(&mut self) {
        self.received = true;
    }

    /// What came from there asks for keys.
    pub(super) fn note_call(&mut self, from: A, now: Duration) {
        if self.fixed.is_none() {
            self.callers.note(from, now);
        }
    }
}
