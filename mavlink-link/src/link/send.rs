//! From messages to frames: numbered, stamped and signed at the moment they are sent.
//!
//! There is no queue of signed frames: a retry is encoded and signed again, since the same bytes sent twice would be
//! refused as a replay (pitfall 2).

use core::time::Duration;

use mavlink::Message as _;
use thiserror::Error;

use super::challenge::{ANSWER_EVERY, CHALLENGE_EVERY};
use super::config::Security;
use super::machine::{Auth, Core, Link};
use super::receiver::KeyState;
use super::report::Alert;
use crate::Now;
use crate::dialect::MavMessage;
use crate::frame::{
    EncodeError, Header, INCOMPAT_SIGNED, KEY_EXCHANGE_ID, MAX_FRAME, encode, encode_raw,
};
use crate::signing::clock::{ClockError, WallState};
use crate::signing::{SignError, Stamp, sign};
use crate::store::Disk;

/// A frame that is ready in the caller's buffer.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Sent<A> {
    /// Where it must go.
    pub to: A,
    /// Its bytes in the buffer.
    pub len: usize,
    /// Its sequence number.
    pub seq: u8,
    /// Its stamp, on a signed link: an answer is never stamped below it.
    pub stamp: Option<Stamp>,
}

/// Why a message cannot be sent now.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Error)]
pub enum SendError {
    /// No frame of the vehicle has been accepted yet.
    #[error("nothing received from the vehicle yet: its address is unknown")]
    NoPeer,
    /// The link is signed and no key was given.
    #[error("the link is signed, and there is no key for it")]
    NoKey,
    /// The signing clock has no timestamp available.
    #[error(transparent)]
    Clock(#[from] ClockError),
    /// The bytes given are not a payload.
    #[error(transparent)]
    Encode(#[from] EncodeError),
    /// The frame has no room for its trailer.
    #[error(transparent)]
    Sign(#[from] SignError),
}

impl<A: Copy + Eq> Link<A> {
    /// Writes a message to the peer into `out`. For a retry call it again: the same bytes sent twice would be a replay.
    ///
    /// # Errors
    /// There is no peer, no key, or no timestamp; nothing may be sent then.
    pub fn send(
        &mut self,
        now: Now,
        auth: Auth<'_>,
        msg: &MavMessage,
        out: &mut [u8; MAX_FRAME],
    ) -> Result<Sent<A>, SendError> {
        let to = self.core.peer.peer().ok_or(SendError::NoPeer)?;
        self.core.send_to(to, now, auth, Content::Message(msg), out)
    }

    /// Writes a message given by its id and payload, for one that the dialect does not have, such as
    /// KEY_EXCHANGE. It goes to `to`, or to the peer. KEY_EXCHANGE alone is sent unsigned where there is no
    /// key yet.
    ///
    /// # Errors
    /// As [`send`](Self::send); also where the payload is too long or the message's CRC_EXTRA unknown.
    pub fn send_raw(
        &mut self,
        now: Now,
        auth: Auth<'_>,
        message_id: u32,
        payload: &[u8],
        to: Option<A>,
        out: &mut [u8; MAX_FRAME],
    ) -> Result<Sent<A>, SendError> {
        let to = to.or(self.core.peer.peer()).ok_or(SendError::NoPeer)?;
        self.core
            .send_to(to, now, auth, Content::Raw(message_id, payload), out)
    }

    /// Whether [`poll_transmit`](Self::poll_transmit) has left something that is due: the clock waits for its ceiling to be stored.
    pub fn has_due(&self) -> bool {
        self.core.has_due()
    }

    /// The next heartbeat, challenge or answer to a challenge that is due, if any. Call it until it returns `None`, after each
    /// [`handle_datagram`](Self::handle_datagram) and [`handle_timeout`](Self::handle_timeout).
    pub fn poll_transmit(
        &mut self,
        now: Now,
        mut auth: Auth<'_>,
        out: &mut [u8; MAX_FRAME],
    ) -> Option<Sent<A>> {
        let core = &mut self.core;
        if let Auth::Signed { key, .. } = &mut auth
            && core.heartbeat_due
            && key.watch_wall(now) == WallState::FarAhead
        {
            core.events.alert(Alert::WallFarAhead, now.mono);
        }
        // What is due stays due: a lifting heartbeat that was dropped here would leave a vehicle that has just started
        // refused until the next one, a second of its telemetry.
        if let Auth::Signed { key, store } = &mut auth
            && core.has_due()
            && key.waits(now, &mut **store)
        {
            return None;
        }
        if let Auth::Signed { key, store } = &mut auth
            && let Some(sent) = core.next_ping(now, key, &mut **store, out)
        {
            return Some(sent);
        }
        let to = core.next_heartbeat_to(now.mono)?;
        let heartbeat = MavMessage::HEARTBEAT(core.config.heartbeat());
        let sent = core
            .send_to(to, now, auth, Content::Message(&heartbeat), out)
            .ok()?;
        core.stats.sent_heartbeats += 1;
        if let Some(stamp) = sent.stamp {
            core.heartbeats.record(stamp, now.mono);
            core.receipt.heartbeat(now.mono);
        }
        Some(sent)
    }
}

/// What goes into a frame.
enum Content<'a> {
    Message(&'a MavMessage),
    Raw(u32, &'a [u8]),
}

impl<A: Copy + Eq> Core<A> {
    /// The next PING about clocks, or about whether we are received: to nobody but senders of frames that have verified.
    fn next_ping(
        &mut self,
        now: Now,
        key: &mut KeyState,
        store: &mut dyn Disk,
        out: &mut [u8; MAX_FRAME],
    ) -> Option<Sent<A>> {
        if let Some((to, answer)) = self.answer.take(ANSWER_EVERY, now.mono) {
            let auth = Auth::Signed { key, store };
            let message = answer.message();
            let sent = self.send_to(to, now, auth, Content::Message(&message), out);
            self.stats.clock_answers += u64::from(sent.is_ok());
            return sent.ok();
        }
        let challenged = self.challenge.take(CHALLENGE_EVERY, now.mono);
        let of_path = self.path.due();
        let to = match (challenged, of_path) {
            (Some((to, ())), _) | (None, Some(to)) => to,
            (None, None) if core::mem::take(&mut self.receipt.due) => self.peer.peer()?,
            (None, None) => return None,
        };
        let ping = key.challenge(now, store).ok()?;
        if challenged.is_none() && of_path.is_some() {
            self.path.asked(to, ping.number);
        }
        let auth = Auth::Signed { key, store };
        let sent = self.send_to(to, now, auth, Content::Message(&ping.message()), out);
        let count = match challenged {
            Some(_) => &mut self.stats.clock_challenges,
            None => &mut self.stats.receipt_pings,
        };
        *count += u64::from(sent.is_ok());
        sent.ok()
    }

    pub(super) fn has_due(&self) -> bool {
        self.heartbeat_due
            || self.receipt.due
            || self.path.due().is_some()
            || self.lifts.any()
            || self.answer.any()
            || self.challenge.any()
    }

    fn next_heartbeat_to(&mut self, mono: Duration) -> Option<A> {
        let regular = self.peer.heartbeat_to();
        if let Some((lift, ())) = self.lifts.take(mono) {
            // One heartbeat serves both purposes where it goes to the same place.
            self.heartbeat_due &= regular != Some(lift);
            return Some(lift);
        }
        core::mem::take(&mut self.heartbeat_due)
            .then_some(regular)
            .flatten()
    }

    fn send_to(
        &mut self,
        to: A,
        now: Now,
        auth: Auth<'_>,
        content: Content<'_>,
        out: &mut [u8; MAX_FRAME],
    ) -> Result<Sent<A>, SendError> {
        let message_id = match content {
            Content::Message(msg) => msg.message_id(),
            Content::Raw(message_id, _) => message_id,
        };
        // The exchange that makes the first key cannot be signed with it; its messages authenticate themselves.
        let makes_key = message_id == KEY_EXCHANGE_ID && matches!(auth, Auth::Off);
        let signed = self.config.security == Security::Signed && !makes_key;
        let seq = self.seq;
        let header = Header {
            seq,
            system_id: self.config.own_system,
            component_id: self.config.own_component,
            message_id,
            incompat: if signed { INCOMPAT_SIGNED } else { 0 },
            compat: 0,
        };
        let mut len = match content {
            Content::Message(msg) => encode(msg, header, out),
            Content::Raw(_, payload) => encode_raw(header, payload, out)?,
        };
        let mut stamp = None;
        if signed {
            let Auth::Signed { key, store } = auth else {
                self.stats.no_key += 1;
                return Err(SendError::NoKey);
            };
            let taken = key.take_stamp(now, store).inspect_err(|error| {
                self.stats.send_refused += 1;
                match error {
                    ClockError::Ceiling => self.events.alert(Alert::CeilingNotStored, now.mono),
                    ClockError::Exhausted => self.events.alert(Alert::ClockExhausted, now.mono),
                    // A moment of a slow disk, such as at the first frame under a key.
                    ClockError::Raising => {}
                }
            })?;
            len = sign(key.key(), self.config.link_id, taken, out, len)?;
            stamp = Some(taken);
        }
        self.seq = self.seq.wrapping_add(1);
        self.stats.sent += 1;
        self.stats.sent_bytes += len as u64;
        Ok(Sent {
            to,
            len,
            seq,
            stamp,
        })
    }
}
