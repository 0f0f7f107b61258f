//! Keys agreed over the air, as the bridge sees it: frames of the exchange go out and in, the key that waits is looked
//! for in the vehicle's frames, and stations are told.
//!
//! Promised: KEY_EXCHANGE goes to the exchange only; the vehicle goes on under its current key until one of its own
//! frames verifies under the next, and from that frame on under that one.

use std::collections::VecDeque;
use std::time::Duration;

use mavlink_link::Now;
use mavlink_link::clock::Origin;
use mavlink_link::frame::{KEY_EXCHANGE_ID, MAX_FRAME};
use mavlink_link::link::{KeyExchangeFrame, Link};
use mavlink_link::receiver::{AUTOPILOT, KeyState};
use mavlink_link::signing::{SigningKey, Stamp};
use mavlink_link::store::{Disk, StoreError};
use serde::Serialize;
use stanag_msgs::enums::AlertPriority;

use super::frame::{OutFrame, Peer};
use super::key_recovery::KeyChange;
use super::{VehicleLink, auth};

/// The part of the exchange that a vehicle's link holds.
#[derive(Debug, Default)]
pub(crate) struct Agreement {
    /// Whether anybody waits for KEY_EXCHANGE frames.
    pub(crate) wanted: bool,
    pub(crate) inbox: VecDeque<KeyExchangeFrame<Peer>>,
    pub(crate) next: Option<Box<NextKey>>,
    pub(crate) status: Option<ExchangeStatus>,
}

/// A key that the vehicle may sign with from some moment on.
#[derive(Debug)]
pub(crate) struct NextKey {
    /// Judges and lifts what is signed with it, as the vehicle's link does under the current key.
    link: Link<Peer>,
    key: KeyState,
}

/// How the exchange with the air-side agent stands, for `vsm status`.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct ExchangeStatus {
    /// "on" or "legacy".
    pub mode: &'static str,
    /// The fingerprint of the paired agent.
    pub peer: Option<String>,
    /// What it does or waits for.
    pub state: String,
    /// The id of the key that is agreed and not in use yet.
    pub next_key_id: Option<String>,
    /// Messages that were of use.
    pub taken: u64,
    /// Messages that were passed over.
    pub ignored: u64,
}

/// What stations are told of the exchange by 16000.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum ExchangeNotice {
    /// Something that happened.
    Once(AlertPriority, String),
    /// Something that lasts, in place of what stood before.
    Stands(AlertPriority, String),
    /// What stood is over.
    Over(&'static str),
}

impl Agreement {
    pub(super) fn queue(&mut self, frame: KeyExchangeFrame<Peer>) {
        // The link holds back all but a few; whoever empties this is called after every datagram.
        if self.inbox.len() < MAX_WAITING {
            self.inbox.push_back(frame);
        }
    }

    pub(crate) fn status(&self) -> Option<ExchangeStatus> {
        self.status.clone()
    }
}

impl VehicleLink {
    /// A key that the vehicle may sign with from some moment on: it is looked for in its frames.
    ///
    /// # Errors
    /// The clock of the key cannot be read.
    pub(crate) fn offer_next_key(
        &mut self,
        key: SigningKey,
        now: Now,
        not_before: Duration,
        store: &mut dyn Disk,
    ) -> Result<(), StoreError> {
        let not_before = Stamp::from_unix(not_before);
        // Agreed about just now, or never used since: nothing older than this program is signed with it.
        let origin = Origin::Provisioned {
            initial: not_before,
        };
        let key = KeyState::start(key, origin, not_before, now, store)?;
        let link = Link::new(*self.link.config());
        self.agreement.next = Some(Box::new(NextKey { link, key }));
        Ok(())
    }

    /// Looks for the next key in what arrived: the first frame of the autopilot that is accepted under it is the proof.
    /// One with an old stamp may be a recording: it is answered by a heartbeat under that key, which lifts a vehicle that
    /// has it. True where the proof was among these bytes, which have been taken then.
    pub(super) fn look_for_next_key(
        &mut self,
        now: Now,
        from: Peer,
        bytes: &[u8],
        store: &mut dyn Disk,
    ) -> bool {
        let Some(next) = &mut self.agreement.next else {
            return false;
        };
        let NextKey { link, key } = &mut **next;
        let stale = link.stats().stale;
        let mut proven = false;
        link.handle_datagram(now, from, bytes, auth(Some(key), store), &mut |delivery| {
            proven |= delivery.verified && delivery.header.component_id == AUTOPILOT;
        });
        // The link under the current key sees the same bytes, and tells.
        while link.poll_event().is_some() {}
        if link.stats().stale > stale
            && let Some(current) = &self.key
        {
            // As when it is adopted: what lifts the vehicle must be above what it has had from us.
            let _ = key.follow(current.clock().reading(now), now, store);
        }
        let mut frame = [0; MAX_FRAME];
        while let Some(sent) = link.poll_transmit(now, auth(Some(key), store), &mut frame) {
            self.out.push_back(OutFrame::new(sent.to, sent.len, frame));
        }
        if proven {
            self.adopt_next_key(now, store);
            self.key_recovery.change = Some(KeyChange::Commit);
        }
        proven
    }

    /// The vehicle signs with the next key already.
    pub(crate) fn adopt_next_key(&mut self, now: Now, store: &mut dyn Disk) {
        let Some(mut next) = self.agreement.next.take() else {
            return;
        };
        if let Some(current) = &self.key {
            // The vehicle has one table of streams for all keys, so our stamps go on rising. Where they cannot, its
            // receiver tells by silence, as with any clock that is behind.
            let _ = next.key.follow(current.clock().reading(now), now, store);
        }
        self.key = Some(next.key);
    }

    /// Sends a KEY_EXCHANGE payload to the vehicle's peer, or to `otherwise` where there is none yet.
    pub(crate) fn send_key_exchange(
        &mut self,
        now: Now,
        payload: &[u8],
        otherwise: Option<Peer>,
        store: &mut dyn Disk,
    ) {
        let to = self.link.peer().or(otherwise);
        let mut bytes = [0; MAX_FRAME];
        let auth = auth(self.key.as_mut(), store);
        // A message that cannot leave is lost, and sent again in time.
        if let Ok(sent) = self
            .link
            .send_raw(now, auth, KEY_EXCHANGE_ID, payload, to, &mut bytes)
        {
            self.sent.count(KEY_EXCHANGE_ID);
            self.out.push_back(OutFrame::new(sent.to, sent.len, bytes));
        }
    }
}

const MAX_WAITING: usize = 8;
