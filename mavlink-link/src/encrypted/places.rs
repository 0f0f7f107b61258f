//! Where the other end may be while no packet of it has verified in this run.
//!
//! An end that was started again has no keys, so that every packet is as good as any: anybody can send one, and be the last to
//! have done so however often the other end sends its own. What begins an exchange therefore goes to all of these: where an
//! earlier process has found the other end, which nobody can change from outside; where the last message came from that
//! the other end has made, perhaps long ago; where the last packet came from; and, once for each call, to [`Callers`].

use core::time::Duration;

use crate::exchange::Callers;

/// The places, of which none is proven.
#[derive(Debug)]
pub(super) struct Places<A> {
    /// By configuration: then it is nowhere else.
    fixed: Option<A>,
    /// Where an earlier process has found it.
    before: Option<A>,
    /// Where the last message of an exchange came from that it has made.
    message: Option<A>,
    /// Where the last packet came from.
    packet: Option<A>,
    pub(super) callers: Callers<A>,
}

impl<A: Copy + Eq> Places<A> {
    pub(super) fn new(fixed: Option<A>, before: Option<A>) -> Self {
        Self {
            fixed,
            before,
            message: None,
            packet: None,
            callers: Callers::default(),
        }
    }

    pub(super) fn fixed(&self) -> Option<A> {
        self.fixed
    }

    /// Anybody can have sent this.
    pub(super) fn note_packet(&mut self, from: A) {
        self.packet = Some(from);
    }

    /// The other end has made this, now or long ago.
    pub(super) fn note_message(&mut self, from: A) {
        self.message = Some(from);
    }

    /// What came from there asks for keys.
    pub(super) fn note_call(&mut self, from: A, now: Duration) {
        if self.fixed.is_none() {
            self.callers.note(from, now);
        }
    }

    /// All of them, each once. `proven`: where it was in this run; `received`: packets of it verify from there.
    pub(super) fn all(
        &self,
        proven: Option<A>,
        received: bool,
    ) -> impl Iterator<Item = A> + use<A> {
        let known = self.fixed.or(proven).or(self.before);
        let is_open = self.fixed.is_none() && !received;
        let message = self.message.filter(|at| is_open && Some(*at) != known);
        let packet = self.packet.filter(|at| {
            let other = Some(*at) != known && Some(*at) != message;
            is_open && other
        });
        known.into_iter().chain(message).chain(packet)
    }
}
