//! Sessions that have been answered and not confirmed, and the one that was.

use core::fmt;
use core::time::Duration;

use zeroize::Zeroizing;

use crate::exchange::keys::{Agreed, Confirmation, Outcome};
use crate::exchange::message::{Message, Status};
use crate::exchange::terms::Facts;

/// Step 2 has been sent.
pub(super) struct HalfOpen<A> {
    pub(super) from: A,
    pub(super) since: Duration,
    pub(super) offer: Message,
    pub(super) answer: Message,
    pub(super) waits_for: WaitsFor,
}

pub(super) enum WaitsFor {
    /// Suite 1: everything is derived; the initiator has only to prove that it has derived the same.
    Proof(Box<(Agreed, Confirmation)>, u64),
    /// Suite 2: its last Noise message. The state is built again for each try, from the ephemeral key, since a forged
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
pub(super) struct PairingSlots<A>([Option<HalfOpen<A>>; SLOTS]);

impl<A> Default for PairingSlots<A> {
    fn default() -> Self {
        Self([const { None }; SLOTS])
    }
}

impl<A: Copy + Eq> PairingSlots<A> {
    pub(super) fn expire(&mut self, now: Duration) {
        for slot in &mut self.0 {
            slot.take_if(|open| open.is_over(now));
        }
    }

    pub(super) fn find(&self, session: u32) -> Option<&HalfOpen<A>> {
        self.0
            .iter()
            .flatten()
            .find(|open| open.offer.session == session)
    }

    /// Takes a free place, or the oldest one of the address with the most sessions, so that a flood from one address
    /// displaces its own.
    pub(super) fn insert(&mut self, open: HalfOpen<A>) {
        let share = |of: &HalfOpen<A>| {
            self.0
                .iter()
                .flatten()
                .filter(|other| other.from == of.from)
                .count()
        };
        let place = self.0.iter().position(Option::is_none).unwrap_or_else(|| {
            let claim = |at: &usize| {
                self.0[*at]
                    .as_ref()
                    .map(|open| (share(open), core::cmp::Reverse(open.since)))
            };
            (0..SLOTS).max_by_key(claim).unwrap_or(0)
        });
        self.0[place] = Some(open);
    }
}

/// The last session that was confirmed.
#[derive(Debug)]
pub(super) struct Done {
    pub(super) confirm: Message,
    pub(super) ephemeral: [u8; 32],
    pub(super) confirmation: Confirmation,
    pub(super) outcome: Outcome,
}

impl Done {
    pub(super) fn report(&mut self, status: Status, reason: u8) {
        let Outcome {
            status: before,
            reason: because,
            seq,
        } = self.outcome;
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
