//! Sessions that are answered and not confirmed, and the last confirmed one.

use core::fmt;
use core::time::Duration;
use std::collections::VecDeque;

use zeroize::Zeroizing;

use super::limits::Claim;
use crate::exchange::gate::Gate;
use crate::exchange::keys::{Agreed, Confirmation, Outcome};
use crate::exchange::message::{Message, Status};
use crate::exchange::terms::Facts;

/// Where a message came from, and what it has proved on arrival.
#[derive(Debug)]
pub(super) struct Arrival<A> {
    pub(super) from: A,
    pub(super) claim: Claim,
    /// The gate it passed; the answer passes it at the other end.
    pub(super) gate: Gate,
}

/// Step 2 has been sent.
pub(super) struct HalfOpen<A> {
    pub(super) from: A,
    pub(super) since: Duration,
    pub(super) offer: Message,
    pub(super) answer: Message,
    pub(super) waits_for: WaitsFor,
}

pub(super) enum WaitsFor {
    /// Suite 1: everything is derived; the initiator only has to prove that it has derived the same.
    Proof(Box<(Agreed, Confirmation)>, u64),
    /// Suite 2: the initiator's last Noise message. Each try builds the state again, from the ephemeral key, since a forged
    /// message corrupts a state.
    Message {
        ephemeral: Zeroizing<[u8; 32]>,
        /// What step 2 reported of this end.
        facts: [u8; Facts::LEN],
    },
}

impl<A> HalfOpen<A> {
    pub(super) fn until(&self) -> Duration {
        self.since.saturating_add(HALF_OPEN_LIFE)
    }

    pub(super) fn is_over(&self, now: Duration) -> bool {
        now >= self.until()
    }
}

impl<A> fmt::Debug for HalfOpen<A> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("HalfOpen")
            .field("offer", &self.offer)
            .finish_non_exhaustive()
    }
}

/// The sessions of a pairing window.
pub(super) struct PairingSlots<A> {
    open: [Option<HalfOpen<A>>; SLOTS],
    /// The numbers of the sessions opened in this window. Only holders of the code open one, so a repeated number is a
    /// recording, and opens none.
    seen: VecDeque<u32>,
}

impl<A> Default for PairingSlots<A> {
    fn default() -> Self {
        Self {
            open: [const { None }; SLOTS],
            seen: VecDeque::new(),
        }
    }
}

impl<A: Copy + Eq> PairingSlots<A> {
    pub(super) fn expire(&mut self, now: Duration) {
        for slot in &mut self.open {
            slot.take_if(|open| open.is_over(now));
        }
    }

    /// Whether a session with this number was opened before and is closed.
    pub(super) fn is_over(&self, session: u32) -> bool {
        self.seen.contains(&session)
    }

    pub(super) fn find(&self, session: u32) -> Option<&HalfOpen<A>> {
        self.open
            .iter()
            .flatten()
            .find(|open| open.offer.session == session)
    }

    /// Takes a free place, or the oldest one of the address with the most sessions, so that a flood from one address
    /// displaces its own.
    pub(super) fn insert(&mut self, open: HalfOpen<A>) {
        if self.seen.len() == SEEN {
            self.seen.pop_front();
        }
        self.seen.push_back(open.offer.session);
        let share = |of: &HalfOpen<A>| {
            self.open
                .iter()
                .flatten()
                .filter(|other| other.from == of.from)
                .count()
        };
        let place = self
            .open
            .iter()
            .position(Option::is_none)
            .unwrap_or_else(|| {
                // The address with the most sessions loses its oldest: an honest initiator has one.
                let claim = |at: &usize| {
                    self.open[*at]
                        .as_ref()
                        .map(|open| (share(open), core::cmp::Reverse(open.since)))
                };
                (0..SLOTS).max_by_key(claim).unwrap_or(0)
            });
        self.open[place] = Some(open);
    }
}

/// The last session that was confirmed.
#[derive(Debug)]
pub(super) struct Done<A> {
    /// Where it was confirmed from.
    pub(super) from: A,
    /// The gate of the session: after a pairing the window, and with it the code, is gone.
    pub(super) gate: Gate,
    pub(super) confirm: Message,
    pub(super) ephemeral: [u8; 32],
    pub(super) confirmation: Confirmation,
    pub(super) outcome: Outcome,
}

impl<A> Done<A> {
    pub(super) fn report(&mut self, status: Status, reason: u8) {
        let Outcome {
            status: before,
            reason: because,
            seq,
        } = self.outcome;
        // The sequence rises only with a change, so that the initiator can tell news from repetition.
        if (before, because) != (status, reason) {
            self.outcome = Outcome {
                status,
                reason,
                seq: seq.saturating_add(1),
            };
        }
    }
}

/// How long a session may stay half-open.
const HALF_OPEN_LIFE: Duration = Duration::from_secs(10);
/// Half-open sessions of a pairing.
const SLOTS: usize = 4;
/// Attempts of 10 s in a window of 10 minutes.
const SEEN: usize = 64;
