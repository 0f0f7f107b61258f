//! How two ends of a key whose signing clocks are further apart than a receiver follows find together again.
//!
//! A computer that starts with a wrong wall clock may stamp years ahead of its peer. The peer verifies such frames and
//! must refuse them: followed without proof, one recorded frame could drag its clock. So it asks. A challenge is a PING to
//! everybody, signed, with a number that was never used before; the answer is the same PING, signed, addressed to who
//! asked. That is what PX4 does with every PING, and what [`Link`](super::Link) does with a challenge, whatever the
//! challenge's own timestamp: that of the end which is behind is stale by nature.
//!
//! An answer proves that the one who has the key runs at that timestamp now, and only then does the clock behind
//! move up to it ([`SigningClock::meet`](crate::clock::SigningClock::meet)). No recording can do that: the number did not
//! exist when it was made. A recorded challenge gets an answer to a number that nobody waits for. Clocks only ever move up,
//! to the clock of an end that has the key, so any number of ends and any order of events find one clock.
//!
//! The same PING, between clocks that agree, shows that the other end receives us ([`Receipt`]).
//!
//! The number is an HMAC under the key of a timestamp of ours, none of which is ever used twice, over restarts too: new,
//! and not foreseeable for someone who gets PX4 to sign answers on a port that takes unsigned frames.

use core::time::Duration;

use hmac::{Hmac, KeyInit as _, Mac as _};
use sha2::Sha256;

use crate::dialect::MavMessage;
#[expect(
    deprecated,
    reason = "PX4 answers PING; TIMESYNC, which replaces it, sets its clock"
)]
use crate::dialect::PING_DATA;
use crate::frame::{FrameView, Header, Stamp};
use crate::signing::SigningKey;

/// What shows that the other end receives us: frames of it that arrive show only that we receive it.
///
/// An autopilot has no clock of its own: its timestamps rise to ours, and show what it has received. Another component of its
/// system, or a ground station, has one, and is asked by PING every two seconds, and each second once an answer is older.
/// One that has never answered is judged by its timestamps all the same.
#[derive(Debug, Default)]
pub(super) struct Receipt {
    /// When our first heartbeat was sent.
    first_heartbeat: Option<Duration>,
    /// When the newest frame was sent that the other end has received for certain.
    received: Option<Duration>,
    /// It stamps by a clock of its own.
    has_clock: bool,
    /// It has answered a PING.
    answers: bool,
    asked: Option<Duration>,
    /// That nothing is received has been reported.
    reported: bool,
    /// A PING is to be sent.
    pub(super) due: bool,
}

impl Receipt {
    pub(super) fn heartbeat(&mut self, mono: Duration) {
        self.first_heartbeat.get_or_insert(mono);
    }

    /// A frame was accepted that its timestamp shows to be made after a heartbeat that was sent then.
    pub(super) fn by_stamp(&mut self, sent: Duration) {
        if !self.answers {
            self.receive(sent);
        }
    }

    fn receive(&mut self, sent: Duration) {
        if Some(sent) > self.received {
            (self.received, self.reported) = (Some(sent), false);
        }
    }

    /// A frame of a component that is no autopilot was accepted.
    pub(super) fn by_own_clock(&mut self) {
        self.has_clock = true;
    }

    /// A PING that was sent then has been answered.
    pub(super) fn by_answer(&mut self, sent: Duration) {
        // An autopilot answers too: it needs no PING for that.
        self.answers = self.has_clock;
        self.receive(sent);
    }

    /// When the newest frame was sent that was received for certain, else our first heartbeat.
    pub(super) fn since(&self) -> Option<Duration> {
        self.received.or(self.first_heartbeat)
    }

    /// True once each time that nothing has been received for so long, nor since the other end is received again.
    pub(super) fn is_overdue(
        &mut self,
        span: Duration,
        resumed: Option<Duration>,
        mono: Duration,
    ) -> bool {
        let since = self
            .since()
            .map(|at| resumed.map_or(at, |again| again.max(at)));
        let overdue = since.is_some_and(|at| mono.saturating_sub(at) > span);
        overdue && !core::mem::replace(&mut self.reported, overdue)
    }

    /// Asks where it is time to, of an end whose frames are being accepted.
    pub(super) fn handle_timeout(&mut self, mono: Duration) {
        if !self.has_clock {
            return;
        }
        let every = if self.answers {
            CHALLENGE_EVERY
        } else {
            TRY_EVERY
        };
        let ago = |at: Option<Duration>, span| at.is_none_or(|at| mono.saturating_sub(at) >= span);
        let old = !self.answers || ago(self.received, RECEIPT_LASTS);
        if old && ago(self.asked, every) {
            (self.asked, self.due) = (Some(mono), true);
        }
    }
}

/// The numbers that an answer is awaited for.
#[derive(Debug, Default)]
pub(super) struct Challenges {
    waiting: [Option<(u64, Duration)>; WAITING],
    next: usize,
}

impl Challenges {
    /// Makes a challenge of a timestamp that is used for nothing else.
    pub(super) fn make(&mut self, key: &SigningKey, unique: Stamp, mono: Duration) -> Ping {
        let mut number = [0; 8];
        // An HMAC accepts a key of any length, so this cannot fail.
        if let Ok(mut mac) = Hmac::<Sha256>::new_from_slice(key.expose()) {
            mac.update(b"vsm/1 clock challenge");
            mac.update(&unique.get().to_le_bytes());
            number.copy_from_slice(&mac.finalize().into_bytes()[..8]);
        }
        let number = u64::from_le_bytes(number);
        self.waiting[self.next] = Some((number, mono));
        self.next = (self.next + 1) % WAITING;
        Ping {
            number,
            target_system: 0,
            target_component: 0,
        }
    }

    /// The one that this frame, which has verified, is the answer to: its number, and when it was made.
    pub(super) fn answered(
        &self,
        frame: &FrameView<'_>,
        own_system: u8,
        mono: Duration,
    ) -> Option<(u64, Duration)> {
        let ping = Ping::of(frame).filter(|ping| ping.target_system == own_system)?;
        let mut waiting = self.waiting.iter().flatten().copied();
        waiting
            .find(|&(number, at)| number == ping.number && mono.saturating_sub(at) <= ANSWER_WITHIN)
    }

    /// The clocks have met: nothing is awaited any more.
    pub(super) fn end(&mut self) {
        self.waiting = [None; WAITING];
    }
}

/// A PING of this protocol.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Ping {
    pub(super) number: u64,
    target_system: u8,
    target_component: u8,
}

impl Ping {
    /// The PING in this frame, if it is one of this protocol: other PINGs are messages like any other.
    pub(crate) fn of(frame: &FrameView<'_>) -> Option<Ping> {
        if frame.header().message_id != PING_ID {
            return None;
        }
        // Trailing zeros are trimmed on the wire: time_usec u64, seq u32, target_system u8, target_component u8.
        let mut payload = [0; 14];
        let sent = frame.payload();
        payload.get_mut(..sent.len())?.copy_from_slice(sent);
        let (number, rest) = payload.split_first_chunk::<8>()?;
        let (seq, target) = rest.split_first_chunk::<4>()?;
        (u32::from_le_bytes(*seq) == SEQ).then_some(Ping {
            number: u64::from_le_bytes(*number),
            target_system: target[0],
            target_component: target[1],
        })
    }

    /// What is sent back where this is a challenge.
    pub(crate) fn answer(self, asked_by: Header) -> Option<Ping> {
        (self.target_system == 0 && self.target_component == 0).then_some(Ping {
            target_system: asked_by.system_id,
            target_component: asked_by.component_id,
            ..self
        })
    }

    /// As it is sent.
    #[expect(
        deprecated,
        reason = "PX4 answers PING; TIMESYNC, which replaces it, sets its clock"
    )]
    pub(crate) fn message(self) -> MavMessage {
        MavMessage::PING(PING_DATA {
            time_usec: self.number,
            seq: SEQ,
            target_system: self.target_system,
            target_component: self.target_component,
        })
    }
}

/// Where challenges or answers are to be sent: to the peer, and to one other sender.
///
/// The two have places of their own, and of the others the one with the newest timestamp: an end that is there stamps
/// above all that was ever recorded of it, so whoever plays recordings, however many, does not get its turn.
#[derive(Debug)]
pub(crate) struct Turns<A, T> {
    peer: Option<(A, T)>,
    other: Option<(Stamp, A, T)>,
    served: [Option<Duration>; 2],
}

impl<A: Copy + Eq, T> Turns<A, T> {
    pub(crate) fn new() -> Self {
        Self {
            peer: None,
            other: None,
            served: [None; 2],
        }
    }

    /// A verified frame with that timestamp came from there.
    pub(crate) fn note(&mut self, from: A, peer: Option<A>, stamp: Stamp, what: T) {
        if peer == Some(from) {
            self.peer = Some((from, what));
        } else if self
            .other
            .as_ref()
            .is_none_or(|(newest, ..)| stamp > *newest)
        {
            self.other = Some((stamp, from, what));
        }
    }

    /// The next one whose turn has come: each place once in that time.
    pub(crate) fn take(&mut self, every: Duration, mono: Duration) -> Option<(A, T)> {
        let due = |at: &mut Option<Duration>| {
            let due = at.is_none_or(|at| mono.saturating_sub(at) >= every);
            if due {
                *at = Some(mono);
            }
            due
        };
        let [peer_at, other_at] = &mut self.served;
        if self.peer.is_some() && due(peer_at) {
            return self.peer.take();
        }
        if self.other.is_some() && due(other_at) {
            return self.other.take().map(|(_, to, what)| (to, what));
        }
        None
    }

    /// Whether somebody waits for a turn.
    pub(crate) fn any(&self) -> bool {
        self.peer.is_some() || self.other.is_some()
    }

    pub(crate) fn clear(&mut self) {
        (self.peer, self.other) = (None, None);
    }
}

pub(crate) const PING_ID: u32 = 4;
/// PING.seq of this protocol.
const SEQ: u32 = u32::from_be_bytes(*b"CLK?");
/// As many as can be on their way: for [`ANSWER_WITHIN`] one a second to each of two places on two links, and some more
/// for two addresses.
const WAITING: usize = 32;
/// How old an answer may be. A slow radio takes a second or two each way.
const ANSWER_WITHIN: Duration = Duration::from_secs(5);
/// How often each place gets a challenge.
pub(crate) const CHALLENGE_EVERY: Duration = Duration::from_secs(1);
/// How often each place gets an answer.
pub(crate) const ANSWER_EVERY: Duration = Duration::from_millis(200);
/// How long a receipt is new enough.
const RECEIPT_LASTS: Duration = Duration::from_secs(2);
/// How often an end that has never answered is asked all the same.
const TRY_EVERY: Duration = Duration::from_secs(5);
/// How long an end must not have been accepted before it is challenged.
pub(super) const REFUSED_FOR: Duration = Duration::from_secs(2);
