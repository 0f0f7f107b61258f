//! Keys agreed over the air, as the bridge sees it: frames of the exchange go out and in, the key that waits is looked
//! for in the vehicle's frames, and stations are notified. While nothing answers under the key in force, this end signs its
//! heartbeats under both.
//!
//! Promised: KEY_EXCHANGE goes to the exchange only; the vehicle keeps its current key until one of its own
//! frames verifies under the next, and from that frame on under that one.

use std::collections::VecDeque;
use std::time::Duration;

use mavlink_link::Now;
use mavlink_link::clock::Origin;
use mavlink_link::frame::MAX_FRAME;
use mavlink_link::link::{Auth, KeyExchangeFrame, Link, LinkConfig};
use mavlink_link::receiver::{AUTOPILOT, KeyState};
use mavlink_link::signing::{SigningKey, Stamp};
use mavlink_link::store::{Disk, StoreError};
use serde::Serialize;
use stanag_msgs::enums::AlertPriority;

use super::frame::{OutFrame, Peer};

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

/// What stations are sent of the exchange by 16000.
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

    /// A key that the vehicle may sign with from some moment on: it is looked for in its frames.
    ///
    /// # Errors
    /// The clock of the key cannot be read.
    pub(super) fn offer(
        &mut self,
        config: LinkConfig<Peer>,
        key: SigningKey,
        current: Option<&KeyState>,
        now: Now,
        not_before: Duration,
        store: &mut dyn Disk,
    ) -> Result<(), StoreError> {
        let not_before = Stamp::from_unix(not_before);
        // Agreed about just now, or never used since: nothing older than this program is signed with it.
        let origin = Origin::Provisioned {
            initial: not_before,
        };
        let mut key = KeyState::start(key, origin, not_before, now, store)?;
        if let Some(current) = current {
            // One clock for both keys: a vehicle that this one has lifted must not be too far ahead for the next.
            key.run_from(current.clock().reading(now), now);
        }
        let link = Link::new(config);
        self.next = Some(Box::new(NextKey { link, key }));
        Ok(())
    }

    /// Looks for the next key in what arrived: the first frame of the autopilot that is accepted under it is the proof.
    /// One with an old stamp may be a recording: it is answered by a heartbeat under that key, which lifts a vehicle that
    /// has it. Returns the key where the proof was among these bytes, which have been taken then.
    pub(super) fn look(
        &mut self,
        now: Now,
        from: Peer,
        bytes: &[u8],
        current: Option<&KeyState>,
        out: &mut VecDeque<OutFrame>,
        store: &mut dyn Disk,
    ) -> Option<KeyState> {
        let NextKey { link, key } = self.next.as_deref_mut()?;
        let stale = link.stats().stale;
        let mut proven = false;
        let auth = Auth::Signed {
            key: &mut *key,
            store: &mut *store,
        };
        link.handle_datagram(now, from, bytes, auth, &mut |delivery| {
            proven |= delivery.verified && delivery.header.component_id == AUTOPILOT;
        });
        // The link under the current key sees the same bytes, and reports them.
        while link.poll_event().is_some() {}
        if link.stats().stale > stale
            && let Some(current) = current
        {
            // As when it is adopted: what lifts the vehicle must be above what it has had from us.
            let _ = key.follow(current.clock().reading(now), now, store);
        }
        transmit(link, key, now, out, store);
        if proven {
            self.adopt(now, current, store)
        } else {
            None
        }
    }

    /// Sends what is due under the next key. Heartbeats under it go out only while nothing answers those under the key in
    /// force: then the vehicle may have the next one already, and this end would be accepted under none.
    pub(super) fn handle_timeout(
        &mut self,
        now: Now,
        unanswered: bool,
        current: Option<&KeyState>,
        out: &mut VecDeque<OutFrame>,
        store: &mut dyn Disk,
    ) {
        let Some(NextKey { link, key }) = self.next.as_deref_mut() else {
            return;
        };
        if !unanswered {
            return;
        }
        if let Some(current) = current {
            // The vehicle has one table of streams for all keys. Where the disk fails, nothing can be sent under this key.
            let _ = key.follow(current.clock().reading(now), now, store);
        }
        link.handle_timeout(now);
        transmit(link, key, now, out, store);
    }

    /// Ends the search: the vehicle signs with the next key already. Returns that key.
    pub(super) fn adopt(
        &mut self,
        now: Now,
        current: Option<&KeyState>,
        store: &mut dyn Disk,
    ) -> Option<KeyState> {
        let mut next = self.next.take()?;
        if let Some(current) = current {
            // The vehicle has one table of streams for all keys, so our stamps continue to rise. Where they cannot, its
            // receiver shows it by silence, as with any clock that is behind.
            let _ = next.key.follow(current.clock().reading(now), now, store);
        }
        Some(next.key)
    }
}

/// What the link under the next key wants sent.
fn transmit(
    link: &mut Link<Peer>,
    key: &mut KeyState,
    now: Now,
    out: &mut VecDeque<OutFrame>,
    store: &mut dyn Disk,
) {
    let mut frame = [0; MAX_FRAME];
    loop {
        let auth = Auth::Signed {
            key: &mut *key,
            store: &mut *store,
        };
        let Some(sent) = link.poll_transmit(now, auth, &mut frame) else {
            break;
        };
        out.push_back(OutFrame::new(sent.to, sent.len, frame));
    }
}

const MAX_WAITING: usize = 8;
