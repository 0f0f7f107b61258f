//! From bytes to deliveries.
//!
//! Every frame ends in exactly one delivery, one event or one counter. Nothing of the link changes before the signature
//! has been verified (pitfall 13: a forger could otherwise make it deaf).

use core::time::Duration;

use super::challenge::{PING_ID, Ping};
use super::config::Security;
use super::freshness::Age;
use super::machine::{Auth, Core, Link};
use super::receiver::{AUTOPILOT, Expected, Refusal};
use super::report::{Alert, Event, KeyExchangeFrame};
use crate::Now;
use crate::address::Sender;
use crate::dialect::MavMessage;
use crate::frame::Stamp;
use crate::frame::{FrameView, Header, KEY_EXCHANGE_ID, Undecoded};

/// A frame for the caller, each at most once.
#[derive(Debug)]
pub struct Delivery<'a> {
    /// The frame's header.
    pub header: Header,
    /// The message, or why the dialect cannot decode it.
    pub message: Result<MavMessage, Undecoded>,
    /// The payload as on the wire, trailing zeros trimmed.
    pub payload: &'a [u8],
    /// The whole frame, for a recording.
    pub frame: FrameView<'a>,
    /// Whether the signature was verified and the stamp accepted.
    pub verified: bool,
    /// The stamp of a verified frame.
    pub stamp: Option<Stamp>,
    /// How old a verified frame can be at most.
    pub age: Age,
}

impl Delivery<'_> {
    /// Whether this frame can be the answer to something that was sent with that stamp.
    ///
    /// The vehicle lifts its timestamps to ours, so an answer is never stamped below the request, and a
    /// frame that may be older than a minute confirms nothing: an old COMMAND_ACK must not confirm a new command
    /// (pitfall 25). Without signing (`None`) this cannot be decided, and everything counts.
    #[must_use]
    pub fn can_answer(&self, sent: Option<Stamp>) -> bool {
        match sent {
            None => true,
            Some(sent) => self.stamp.is_some_and(|stamp| stamp >= sent) && !self.age.is_late(),
        }
    }
}

impl<A: Copy + Eq> Link<A> {
    /// Takes a datagram, or a read of a serial port, and delivers the accepted frames.
    ///
    /// A frame split over two datagrams is joined only where both come from the peer.
    pub fn handle_datagram(
        &mut self,
        now: Now,
        from: A,
        bytes: &[u8],
        mut auth: Auth<'_>,
        deliver: &mut dyn FnMut(Delivery<'_>),
    ) {
        let core = &mut self.core;
        core.stats.datagrams += 1;
        core.stats.bytes += bytes.len() as u64;
        let is_peer = core.peer.peer() == Some(from);
        // A stranger has a parser of its own: the start of a frame from there must not swallow the peer's next one.
        let parser = if is_peer {
            &mut self.parser
        } else {
            &mut self.strange
        };
        if is_peer {
            if now.mono.saturating_sub(self.bytes_at) > PARTIAL_FRAME_LIFE {
                parser.expire_pending();
            }
            self.bytes_at = now.mono;
        }
        let mut frames = parser.feed(bytes);
        while let Some(item) = frames.next() {
            // Refusals are counted by the parser.
            let Ok(frame) = item else { continue };
            if core.take(now, from, &frame, &mut auth, deliver) == Trust::Verified {
                frames.accept_unchecked();
            }
        }
        self.strange.discard_pending();
    }
}

/// Whether a frame's bytes were proved by its signature.
#[derive(PartialEq, Eq)]
enum Trust {
    Verified,
    Unverified,
}

impl<A: Copy + Eq> Core<A> {
    fn take(
        &mut self,
        now: Now,
        from: A,
        frame: &FrameView<'_>,
        auth: &mut Auth<'_>,
        deliver: &mut dyn FnMut(Delivery<'_>),
    ) -> Trust {
        if self.config.security == Security::Off {
            self.take_unsigned_link(now, from, frame, deliver);
            return Trust::Unverified;
        }
        let Auth::Signed { key, store } = auth else {
            self.take_without_key(from, frame);
            return Trust::Unverified;
        };
        let expected = Expected {
            own_system: self.config.own_system,
            system: self.config.vehicle_system,
            autopilot_link: self.pin.expected(now.mono),
            only: self.config.only,
        };
        // Under our own system id an unsigned frame continues to `receive`, which counts it as reflected.
        if !frame.is_signed() && frame.header().system_id != self.config.own_system {
            self.take_unsigned(now, from, frame, deliver);
            return Trust::Unverified;
        }
        let judged = match key.receive(frame, expected, now, &mut **store) {
            Err(Refusal::UnexpectedLink) if self.may_move_pin(now.mono, frame) => {
                let any_link = Expected {
                    autopilot_link: None,
                    ..expected
                };
                key.receive(frame, any_link, now, &mut **store)
            }
            judged => judged,
        };
        if frame.header().message_id == PING_ID {
            // A challenge is answered whatever its timestamp: the end that sends it is behind, or was restarted.
            if matches!(judged, Ok(_) | Err(Refusal::Stale | Refusal::Future)) {
                self.note_challenge(from, frame);
                if let Some((number, sent)) = key.answered(frame, self.config.own_system, now) {
                    self.receipt.by_answer(sent);
                    self.path.answered(number);
                }
            }
            if let Some(ahead) = key.take_met() {
                self.stats.clock_met += 1;
                self.receipt.by_answer(now.mono);
                self.challenge.clear();
                self.events.push(Event::ClockMet(ahead));
            }
        }
        match judged {
            Ok(stamp) => {
                self.accept(now, from, frame, stamp, deliver);
                Trust::Verified
            }
            Err(refusal) => {
                if refusal == Refusal::Future
                    && let Some(signature) = frame.signature()
                    && key.wants_challenge(frame.header().system_id, now)
                {
                    let peer = self.peer.peer();
                    self.challenge.note(from, peer, signature.stamp, ());
                }
                self.refuse(now, from, frame, refusal)
            }
        }
    }

    fn accept(
        &mut self,
        now: Now,
        from: A,
        frame: &FrameView<'_>,
        stamp: Stamp,
        deliver: &mut dyn FnMut(Delivery<'_>),
    ) {
        let header = frame.header();
        let age = self.heartbeats.age(stamp, now.mono);
        if let Age::AtMost(age) = age {
            self.receipt.by_stamp(now.mono.saturating_sub(age));
        }
        if header.component_id == AUTOPILOT {
            self.presence.autopilot_accepted(now.mono);
        }
        if let (AUTOPILOT, Some(signature)) = (header.component_id, frame.signature())
            && self.pin.record(signature.link_id, age, now.mono)
        {
            self.events.alert(Alert::LinkIdMoved, now.mono);
        }
        if header.component_id != AUTOPILOT {
            self.receipt.by_own_clock();
        }
        let by = if header.component_id == AUTOPILOT {
            Sender::Main
        } else {
            Sender::Beside
        };
        let moved = self
            .peer
            .confirm(from, by, frame.signature(), now.mono)
            .or_else(|| self.compare_paths(now.mono));
        if let Some((before, to)) = moved {
            self.events.push(Event::PeerChanged { from: before, to });
        }
        if !age.is_late() || self.heartbeats.bounds_nothing(now.mono) {
            self.presence.is_present(now.mono);
        }
        if self.presence.accepted(now.mono) {
            self.events.push(Event::Live);
        }
        if header.message_id == KEY_EXCHANGE_ID {
            self.stats.key_exchange += 1;
            self.events.push_exchange(KeyExchangeFrame::new(
                self.peer.peer().unwrap_or(from),
                frame,
                Some(stamp),
            ));
            return;
        }
        if Ping::of(frame).is_some() {
            self.stats.clock_pings += 1;
            return;
        }
        self.stats.delivered_verified += 1;
        self.stats.late += u64::from(age.is_late());
        self.deliver(frame, Some(stamp), age, deliver);
    }

    /// Frames come from a second address: finds out which of the two leads to the vehicle.
    fn compare_paths(&mut self, mono: Duration) -> Option<(Option<A>, A)> {
        let (known, other) = (self.peer.peer()?, self.peer.contender(mono)?);
        let is_there = self.path.compare(known, other, mono);
        is_there
            .then(|| self.peer.answered_at(mono, other))
            .flatten()
    }

    fn count_other(&mut self, system: u8) {
        self.stats.unexpected_system += 1;
        let count = &mut self.others[usize::from(system)];
        *count = count.saturating_add(1);
    }

    fn note_challenge(&mut self, from: A, frame: &FrameView<'_>) {
        if let (Some(ping), Some(signature)) = (Ping::of(frame), frame.signature())
            && let Some(answer) = ping.answer(frame.header())
        {
            self.answer
                .note(from, self.peer.peer(), signature.stamp, answer);
        }
    }

    fn may_move_pin(&self, mono: Duration, frame: &FrameView<'_>) -> bool {
        frame.signature().is_some_and(|signature| {
            let age = self.heartbeats.age(signature.stamp, mono);
            self.pin.may_move(signature.link_id, age, mono)
        })
    }

    fn refuse(&mut self, now: Now, from: A, frame: &FrameView<'_>, refusal: Refusal) -> Trust {
        // Without CRC_EXTRA and without a correct signature these may be noise, so they count as an unknown message and as nothing else.
        let verified = matches!(
            refusal,
            Refusal::UnexpectedLink
                | Refusal::TableFull
                | Refusal::Future
                | Refusal::Stale
                | Refusal::Ceiling
                | Refusal::Raising
        );
        if !frame.is_checked() && !verified {
            self.stats.unknown_id += 1;
            return Trust::Unverified;
        }
        let stats = &mut self.stats;
        match refusal {
            Refusal::Reflected => stats.reflected += 1,
            Refusal::UnexpectedSystem => self.count_other(frame.header().system_id),
            Refusal::NotListed => stats.not_listed += 1,
            Refusal::UnexpectedLink => {
                stats.unexpected_link += 1;
                if self.pin.is_movable() {
                    // The vehicle may have restarted with another link id: lifted, it can prove that it is live.
                    self.fallen_back(now.mono, from, frame);
                }
            }
            Refusal::Unsigned => stats.unsigned_vehicle += 1,
            Refusal::BadSignature => {
                stats.bad_signature += 1;
                if self.bad_signatures.one_more(now.mono) {
                    self.events.alert(Alert::BadSignatures, now.mono);
                }
            }
            Refusal::TableFull => {
                stats.stream_table_full += 1;
                self.events.alert(Alert::StreamTableFull, now.mono);
            }
            Refusal::Future => {
                stats.future += 1;
                self.events.alert(Alert::Future, now.mono);
                if self.presence.ahead(now.mono) {
                    self.events.push(Event::Ahead);
                }
            }
            Refusal::Ceiling => {
                stats.ceiling_not_stored += 1;
                self.events.alert(Alert::CeilingNotStored, now.mono);
            }
            Refusal::Raising => stats.ceiling_not_stored += 1,
            Refusal::Stale => {
                stats.stale += 1;
                if let Some(signature) = frame.signature()
                    && self.peer.was_copied(from, &signature, now.mono)
                {
                    self.stats.copied += 1;
                    self.events.alert(Alert::Copied, now.mono);
                }
                self.fallen_back(now.mono, from, frame);
            }
        }
        if verified {
            Trust::Verified
        } else {
            Trust::Unverified
        }
    }

    /// A verified frame with an old timestamp: the vehicle may have restarted, so a heartbeat that lifts
    /// its timestamps is sent there as soon as its turn comes, and nothing else. A recording that is played again has no effect.
    fn fallen_back(&mut self, mono: Duration, from: A, frame: &FrameView<'_>) {
        let Some(stamp) = frame.signature().map(|signature| signature.stamp) else {
            return;
        };
        if !self.rising.counts(from, stamp, mono) {
            return;
        }
        self.peer.stale_from(from, mono);
        if self.presence.stale(mono) {
            self.events.push(Event::Behind);
        }
        self.lifts.note(from, self.peer.heartbeat_to(), stamp, ());
    }

    /// Any frame on a signed link before there is a key: only the exchange that makes one is passed on,
    /// and its messages authenticate themselves.
    fn take_without_key(&mut self, from: A, frame: &FrameView<'_>) {
        let header = frame.header();
        if header.message_id == KEY_EXCHANGE_ID && header.system_id == self.config.vehicle_system {
            self.stats.key_exchange += 1;
            self.events
                .push_exchange(KeyExchangeFrame::new(from, frame, None));
        } else {
            self.stats.no_key += 1;
        }
    }

    /// An unsigned frame on a signed link.
    fn take_unsigned(
        &mut self,
        now: Now,
        from: A,
        frame: &FrameView<'_>,
        deliver: &mut dyn FnMut(Delivery<'_>),
    ) {
        let Header {
            system_id,
            component_id,
            message_id,
            ..
        } = frame.header();
        let of_vehicle = system_id == self.config.vehicle_system;
        if message_id == KEY_EXCHANGE_ID && of_vehicle {
            self.stats.key_exchange += 1;
            self.events
                .push_exchange(KeyExchangeFrame::new(from, frame, None));
        } else if self.config.accept_unsigned.contains(&message_id) {
            if self.peer.peer() == Some(from) {
                self.stats.delivered_unverified += 1;
                self.deliver(frame, None, Age::Unknown, deliver);
            } else {
                self.stats.unsigned_stranger += 1;
            }
        } else if of_vehicle {
            self.stats.unsigned_vehicle += 1;
            // A signing PX4 forwards anybody's unsigned heartbeats, but no other unsigned message.
            if component_id == AUTOPILOT
                && message_id != HEARTBEAT_ID
                && !self.presence.autopilot_signs(now.mono)
            {
                self.events.alert(Alert::VehicleUnsigned, now.mono);
            }
        } else {
            self.count_other(system_id);
        }
    }

    /// Any frame on a link without signing.
    fn take_unsigned_link(
        &mut self,
        now: Now,
        from: A,
        frame: &FrameView<'_>,
        deliver: &mut dyn FnMut(Delivery<'_>),
    ) {
        let Header {
            system_id,
            message_id,
            ..
        } = frame.header();
        if !frame.is_checked() {
            self.stats.unknown_id += 1;
            return;
        }
        if system_id == self.config.own_system {
            self.stats.reflected += 1;
            return;
        }
        let of_vehicle = system_id == self.config.vehicle_system;
        if !of_vehicle {
            // RADIO_STATUS carries the radio's own system id; it never takes the peer lock.
            if !self.config.accept_unsigned.contains(&message_id) {
                self.count_other(system_id);
            } else if self.peer.peer() == Some(from) {
                self.stats.delivered_unverified += 1;
                self.deliver(frame, None, Age::Unknown, deliver);
            } else {
                self.stats.unsigned_stranger += 1;
            }
            return;
        }
        match self.peer.admit_unsigned(from, now.mono) {
            Err(_) => {
                self.stats.wrong_peer += 1;
                return;
            }
            Ok(Some((before, to))) => self.events.push(Event::PeerChanged { from: before, to }),
            Ok(None) => {}
        }
        if self.presence.accepted(now.mono) {
            self.events.push(Event::Live);
        }
        if message_id == KEY_EXCHANGE_ID {
            self.stats.key_exchange += 1;
            self.events
                .push_exchange(KeyExchangeFrame::new(from, frame, None));
        } else {
            self.stats.delivered_unverified += 1;
            self.deliver(frame, None, Age::Unknown, deliver);
        }
    }

    fn deliver(
        &mut self,
        frame: &FrameView<'_>,
        stamp: Option<Stamp>,
        age: Age,
        deliver: &mut dyn FnMut(Delivery<'_>),
    ) {
        let message = frame.message();
        match message {
            Ok(_) => {}
            Err(Undecoded::UnknownId(_)) => self.stats.undecoded_id += 1,
            Err(Undecoded::UnknownValue { .. } | Undecoded::Size) => {
                self.stats.undecoded_value += 1
            }
        }
        deliver(Delivery {
            header: frame.header(),
            message,
            payload: frame.payload(),
            frame: *frame,
            verified: stamp.is_some(),
            stamp,
            age,
        });
    }
}

const HEARTBEAT_ID: u32 = 0;
/// How long the start of a frame waits for its end.
const PARTIAL_FRAME_LIFE: Duration = Duration::from_millis(500);
