//! Key agreement over the air, on the bridge's side: it carries the frames of the exchange, looks for the next key in the
//! vehicle's frames, and notifies stations. While nothing answers under the key in force, this end signs its heartbeats
//! under both keys.
//!
//! Promised: KEY_EXCHANGE goes to the exchange only. The current key stays in force until one of the vehicle's own frames
//! verifies under the next key; from that frame on the next key is in force.

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
    /// Whether an exchange is configured, so that KEY_EXCHANGE frames are wanted.
    pub(crate) wanted: bool,
    pub(crate) inbox: VecDeque<KeyExchangeFrame<Peer>>,
    pub(crate) next: Option<Box<NextKey>>,
}

/// A key that the vehicle may start to sign with at any moment.
#[derive(Debug)]
pub(crate) struct NextKey {
    /// A link under this key: it verifies frames and raises the vehicle's timestamps, as the vehicle's link does under the
    /// current key.
    link: Link<Peer>,
    key: KeyState,
}

/// The state of the exchange with the air-side agent, for `vsm status`.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct ExchangeStatus {
    /// "on" or "legacy".
    pub mode: &'static str,
    /// The fingerprint of the paired agent.
    pub peer: Option<String>,
    /// What the exchange is doing or waiting for.
    pub state: String,
    /// The id of a key that is agreed but not yet in use.
    pub next_key_id: Option<String>,
    /// Number of accepted messages.
    pub taken: u64,
    /// Number of ignored messages.
    pub ignored: u64,
}

/// A notice about the exchange, sent to stations as 16000.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum ExchangeNotice {
    /// A one-time event.
    Once(AlertPriority, String),
    /// A lasting alert, replacing the previous one.
    Stands(AlertPriority, String),
    /// The lasting alert is cleared.
    Over(&'static str),
}

impl Agreement {
    pub(super) fn queue(&mut self, frame: KeyExchangeFrame<Peer>) {
        // The link limits their number, and the caller empties this queue after every datagram.
        if self.inbox.len() < MAX_WAITING {
            self.inbox.push_back(frame);
        }
    }

    /// Starts to look for this key in the vehicle's frames: the vehicle may start to sign with it at any moment.
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
        // The key was agreed just now, or was never used: no frame older than this program is signed with it.
        let origin = Origin::Provisioned {
            initial: not_before,
        };
        let mut key = KeyState::start(key, origin, not_before, now, store)?;
        if let Some(current) = current {
            // Both keys share one clock: if the vehicle's timestamps were raised under the current key, they must not be too
            // far ahead for the next.
            key.run_from(current.clock().reading(now), now);
        }
        let link = Link::new(config);
        self.next = Some(Box::new(NextKey { link, key }));
        Ok(())
    }

    /// Looks for the next key in received bytes. The first frame of the autopilot that is accepted under the next key proves
    /// that the vehicle has it. A frame with an old timestamp may be a recording: it is answered by a heartbeat under that
    /// key, which raises the timestamps of a vehicle that has it. Returns the key if the proof is in these bytes, which are
    /// then consumed.
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
        // The link under the current key handles the same bytes and reports them.
        while link.poll_event().is_some() {}
        if link.stats().stale > stale
            && let Some(current) = current
        {
            // As on adoption: the timestamp that raises the vehicle's must be above all that it has received from us.
            let _ = key.follow(current.clock().reading(now), now, store);
        }
        transmit(link, key, now, out, store);
        if proven {
            self.adopt(now, current, store)
        } else {
            None
        }
    }

    /// Sends what is due under the next key. Heartbeats under it are sent only while nothing answers those under the key in
    /// force: the vehicle may then have the next key already, and would accept this end under neither.
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
            // The vehicle has one table of streams for all keys. If the disk fails, nothing can be sent under this key.
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
            // The vehicle has one table of streams for all keys, so our timestamps must continue to rise. If they cannot,
            // the vehicle does not answer, as with any clock that is behind.
            let _ = next.key.follow(current.clock().reading(now), now, store);
        }
        Some(next.key)
    }
}

/// The frames that the link under the next key has to send.
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
