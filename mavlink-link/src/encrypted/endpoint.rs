//! One end of the link: MAVLink frames on the inside, frames of the radio on the outside.

use core::hash::Hash;
use core::time::Duration;
use std::collections::VecDeque;

use super::config::{Carrier, EncryptedConfig};
use super::exchange::{Keying, Session, Shown};
use super::framing::{self, Deframer, Kind, MAX_CONTENT, MAX_WIRE};
use super::opener::{Opened, Opener, frame_len};
use super::packet::{PACKET, TAG, tag_of};
use super::places::Places;
use super::record::EncryptedRecord;
use super::stats::{Dropped, EncryptedStats};
use crate::Now;
use crate::address::{ProvenAddress, Sender};
use crate::exchange::{Callers, Message, PublicKey, Random, Received, Suite, VERSION};
use crate::frame::{FrameView, Header, KEY_EXCHANGE_ID, MAX_FRAME, encode_raw};
use crate::store::{Disk, Store as _, StoreError};

/// How it stands.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum EncryptedState {
    /// No peer is pinned: only a pairing passes.
    Unpaired,
    /// No keys are agreed on in this run.
    Agreeing,
    /// There are keys, and no packet has verified for some seconds.
    Silent,
    /// Packets of the other end verify.
    Encrypted,
}

impl EncryptedState {
    /// For a status.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Unpaired => "unpaired",
            Self::Agreeing => "agreeing",
            Self::Silent => "silent",
            Self::Encrypted => "encrypted",
        }
    }
}

/// Something for a person.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum EncryptedEvent {
    /// Packets are sent under keys of this epoch from now on.
    Keys {
        /// The epoch.
        epoch: u32,
    },
    /// Many packets in a short time do not verify; at most once in 10 s.
    UnderAttack,
    /// Packets came from elsewhere before they came from the other end: somebody on the way copies them; at most once in
    /// 10 s.
    Copied,
    /// Keys could not be agreed on for a fault of this computer.
    Fault(String),
}

/// One end of an encrypted link. `A` is an address.
#[derive(Debug)]
pub struct EncryptedLink<A> {
    keying: Keying<A>,
    carrier: Carrier,
    linger: Duration,
    places: Places<A>,
    /// Where something came from that the other end alone can have made. A packet is recognised by its end.
    proven: ProvenAddress<A, [u8; TAG]>,
    /// When a copy from elsewhere was last reported.
    copied_at: Option<Duration>,
    /// A packet was opened in what arrived last.
    opened: bool,
    current: Option<Session>,
    /// Of the keys before, until a packet under the current ones has verified.
    previous: Option<Opener>,
    deframer: Deframer,
    received: Vec<u8>,
    out: VecDeque<Queued<A>>,
    pending_to: Option<A>,
    flush_at: Option<Duration>,
    seq: u8,
    /// When something was last sent under the keys in use, or these began.
    sent_at: Duration,
    good_at: Option<Duration>,
    /// Since when nothing has verified, or the keys are new.
    quiet_since: Option<Duration>,
    silence: Silence,
    bad: Bad,
    events: VecDeque<EncryptedEvent>,
    radio: VecDeque<Vec<u8>>,
    stats: EncryptedStats,
}

#[derive(Debug, Clone, Copy)]
struct Queued<A> {
    to: A,
    /// The same packet went to another address, where the other end may be as well.
    again: bool,
    content: [u8; MAX_CONTENT],
    len: usize,
}

/// When the ground begins another exchange because nothing verifies.
#[derive(Debug, Clone, Copy)]
struct Silence {
    ask_at: Option<Duration>,
    pause: Duration,
}

/// Bad packets of late.
#[derive(Debug, Clone, Copy, Default)]
struct Bad {
    since: Duration,
    count: u32,
    alarmed: bool,
}

impl<A: Copy + Eq + Hash> EncryptedLink<A> {
    /// Begins, with what an earlier process has stored.
    ///
    /// # Errors
    /// The record is there and cannot be read: without its epoch a nonce might be used again.
    pub fn open(
        config: EncryptedConfig<A>,
        now: Duration,
        disk: &dyn Disk,
    ) -> Result<Self, StoreError> {
        let EncryptedConfig {
            role,
            parties,
            identity,
            peer,
            carrier,
            at,
            before,
            linger,
        } = config;
        let record = disk.load::<EncryptedRecord>(&parties.vehicle_id)?;
        let strict = carrier == Carrier::Stream;
        let mut keying = Keying::new(role, parties, identity, record.unwrap_or_default(), strict);
        if let Some(peer) = peer {
            keying.set_peer(peer, now);
        }
        Ok(Self {
            keying,
            carrier,
            linger,
            places: Places::new(at, before),
            proven: ProvenAddress::new(None),
            copied_at: None,
            opened: false,
            current: None,
            previous: None,
            deframer: Deframer::default(),
            received: Vec::with_capacity(4 * MAX_FRAME),
            out: VecDeque::new(),
            pending_to: None,
            flush_at: None,
            seq: 0,
            sent_at: Duration::ZERO,
            good_at: None,
            quiet_since: None,
            silence: Silence::default(),
            bad: Bad::default(),
            events: VecDeque::new(),
            radio: VecDeque::new(),
            stats: EncryptedStats::default(),
        })
    }

    /// With the number of the computer that an address is of: one that asks for keys from many addresses keeps no other out.
    #[must_use]
    pub fn by_host(mut self, host: fn(A) -> u64) -> Self {
        self.places.callers = Callers::by_host(host);
        self
    }

    /// A pairing has pinned this peer: the keys of another are dropped.
    pub fn set_peer(&mut self, peer: PublicKey, now: Duration, disk: &mut dyn Disk) {
        (self.current, self.previous, self.good_at) = (None, None, None);
        (self.pending_to, self.flush_at) = (None, None);
        self.keying.pin(peer, now, disk);
    }

    /// How it stands.
    #[must_use]
    pub fn state(&self, now: Duration) -> EncryptedState {
        match (&self.current, self.keying.is_paired()) {
            (_, false) => EncryptedState::Unpaired,
            (None, true) => EncryptedState::Agreeing,
            (Some(_), true) if self.is_good_within(now, SHOWN_FOR) => EncryptedState::Encrypted,
            (Some(_), true) => EncryptedState::Silent,
        }
    }

    /// The epoch of the keys that packets are sent under.
    #[must_use]
    pub fn epoch(&self) -> Option<u32> {
        self.current.as_ref().map(|session| session.epoch)
    }

    /// For tests: as if so many forgeries more had been tried on the key that packets are opened with.
    #[doc(hidden)]
    pub fn count_forgeries(&mut self, tried: u32) {
        if let Some(session) = &mut self.current {
            session.opener.count_forgeries(tried);
        }
    }

    /// Counts of packets and drops.
    #[must_use]
    pub fn stats(&self) -> &EncryptedStats {
        &self.stats
    }

    /// What has happened since the last call.
    pub fn poll_event(&mut self) -> Option<EncryptedEvent> {
        if let Some(fault) = self.keying.take_fault() {
            return Some(EncryptedEvent::Fault(fault));
        }
        self.events.pop_front()
    }

    /// What the radio at this end has sent, which is not encrypted and proves nothing.
    pub fn poll_radio(&mut self) -> Option<Vec<u8>> {
        self.radio.pop_front()
    }

    /// Takes what arrived, and returns the MAVLink frames in it that the other end has sent: whole frames, one behind
    /// the other. Beside these, frames of a pairing, which prove nothing.
    pub fn handle(
        &mut self,
        now: Now,
        from: A,
        bytes: &[u8],
        random: &mut dyn Random,
        disk: &mut dyn Disk,
    ) -> &[u8] {
        self.received.clear();
        self.opened = false;
        if self.carrier == Carrier::Datagrams {
            // Half a frame of one datagram must not swallow the next one's.
            self.deframer.discard();
        }
        let mut rest = bytes;
        let mut content = [0; MAX_CONTENT];
        while let Some(found) = self.deframer.next(&mut rest) {
            let taken = match found {
                Ok(found) => {
                    let len = found.len();
                    content[..len].copy_from_slice(found);
                    self.take(now, from, &content[..len], random, disk)
                }
                Err(why) => Err(why),
            };
            if let Err(why) = taken {
                self.stats.drop_one(why);
            }
        }
        if self.carrier == Carrier::Datagrams
            && let Some(why) = self.deframer.discard()
        {
            self.stats.drop_one(why);
        }
        self.step(now, random, disk);
        &self.received
    }

    fn take(
        &mut self,
        now: Now,
        from: A,
        content: &[u8],
        random: &mut dyn Random,
        disk: &mut dyn Disk,
    ) -> Result<(), Dropped> {
        let (first, body) = content.split_first().ok_or(Dropped::Length)?;
        match Kind::from_wire(*first) {
            Some(Kind::Data) => {
                let packet: &[u8; PACKET] = content.try_into().map_err(|_| Dropped::Length)?;
                self.places.note();
                let taken = self.take_packet(now, from, packet, disk);
                if taken == Err(Dropped::Replayed) {
                    self.note_second(now.mono, from, packet);
                }
                match taken {
                    Ok(()) => {}
                    Err(Dropped::NoKey) => {
                        self.keying.hasten(now.mono, false);
                        self.places.note_call(from, now.mono);
                    }
                    Err(_) => self.note_bad(now.mono),
                }
                taken
            }
            Some(Kind::Radio) => {
                self.stats.radio += 1;
                if self.radio.len() < MAX_RADIO {
                    self.radio.push_back(body.to_vec());
                }
                Ok(())
            }
            Some(Kind::Clear) => self.take_clear(now, from, body, random, disk),
            None if framing::is_mavlink(first) => Err(Dropped::Plaintext),
            None => Err(Dropped::Kind),
        }
    }

    fn take_packet(
        &mut self,
        now: Now,
        from: A,
        packet: &[u8; PACKET],
        disk: &mut dyn Disk,
    ) -> Result<(), Dropped> {
        let current = self.current.as_mut().map(|session| &mut session.opener);
        let mut why = Dropped::NoKey;
        if let Some(opener) = current {
            match opener.open(packet, &mut self.received) {
                Ok(opened) => {
                    // The other end has these keys: those before are over.
                    self.previous = None;
                    self.note_good(now.mono, from, packet, opened);
                    return Ok(());
                }
                Err(cause) => why = cause,
            }
        }
        if let Some(staged) = &mut self.keying.staged
            && let Ok(opened) = staged.opener.open(packet, &mut self.received)
        {
            self.note_good(now.mono, from, packet, opened);
            self.adopt(now.mono, true, disk);
            return Ok(());
        }
        if let Some(previous) = &mut self.previous {
            match previous.open(packet, &mut self.received) {
                Ok(opened) => {
                    self.note_good(now.mono, from, packet, opened);
                    return Ok(());
                }
                Err(Dropped::Replayed) => why = Dropped::Replayed,
                Err(_) => {}
            }
        }
        Err(why)
    }

    /// A packet has come again.
    fn note_second(&mut self, now: Duration, from: A, packet: &[u8; PACKET]) {
        if !self.proven.note_second(now, from, &tag_of(packet)) {
            return;
        }
        self.stats.copied += 1;
        if self
            .copied_at
            .is_none_or(|at| now.saturating_sub(at) >= ALARM_WITHIN)
        {
            self.copied_at = Some(now);
            self.note(EncryptedEvent::Copied);
        }
    }

    /// What [`handle`](Self::handle) has returned last.
    #[must_use]
    pub fn received(&self) -> &[u8] {
        &self.received
    }

    /// Where that comes from: the other end's address where it was opened, which a copy from elsewhere does not change; otherwise
    /// `from`.
    #[must_use]
    pub fn sender(&self, from: A) -> A {
        if self.opened {
            self.proven.get().unwrap_or(from)
        } else {
            from
        }
    }

    fn note_good(&mut self, now: Duration, from: A, packet: &[u8; PACKET], opened: Opened) {
        (self.good_at, self.quiet_since) = (Some(now), Some(now));
        self.opened = true;
        let _ = self
            .proven
            .prove(now, from, Sender::Main, Some(tag_of(packet)));
        self.silence = Silence::default();
        self.stats.opened += 1;
        self.stats.lost += u64::from(opened.missing);
        self.stats.lost = self.stats.lost.saturating_sub(u64::from(opened.late));
        if opened.malformed {
            self.stats.drop_one(Dropped::Inside);
        }
    }

    fn note_bad(&mut self, now: Duration) {
        if now.saturating_sub(self.bad.since) >= ALARM_WITHIN {
            self.bad = Bad {
                since: now,
                ..Bad::default()
            };
        }
        self.bad.count = self.bad.count.saturating_add(1);
        if self.bad.count >= ALARM_AT && !self.bad.alarmed {
            self.bad.alarmed = true;
            self.note(EncryptedEvent::UnderAttack);
        }
    }

    /// A KEY_EXCHANGE in the clear: the link's own goes to its exchange, a pairing inside, and nothing else passes.
    fn take_clear(
        &mut self,
        now: Now,
        from: A,
        body: &[u8],
        random: &mut dyn Random,
        disk: &mut dyn Disk,
    ) -> Result<(), Dropped> {
        let frame = FrameView::parse(body).map_err(|_| Dropped::NotExchange)?;
        if frame.as_bytes().len() != body.len() {
            return Err(Dropped::NotExchange);
        }
        let header = frame.header();
        match clear_suite(&frame) {
            Some(Suite::Pairing) => self.received.extend_from_slice(body),
            Some(Suite::Pinned) => {
                let source = crate::frame::Node {
                    system: header.system_id,
                    component: header.component_id,
                };
                if source != self.keying.peer_node() {
                    return Err(Dropped::Station);
                }
                self.places.note();
                let working = self.is_good_within(now.mono, WORKING_FOR);
                let message = (from, source, frame.payload());
                match self.keying.handle(now, message, working, random, disk) {
                    Shown::Nothing => {}
                    // What an air end is sent its exchange has answered.
                    Shown::Made
                        if self.keying.is_air() || self.is_good_within(now.mono, SILENCE) => {}
                    Shown::Made => self.places.note_call(from, now.mono),
                    Shown::MadeNow => {
                        let _ = self.proven.prove(now.mono, from, Sender::Main, None);
                    }
                }
            }
            None => return Err(Dropped::NotExchange),
        }
        self.stats.clear += 1;
        Ok(())
    }

    fn is_good_within(&self, now: Duration, time: Duration) -> bool {
        let good = |at: Duration| now.saturating_sub(at) < time;
        self.good_at.is_some_and(good)
    }

    /// Where the other end has been found, in this run: for a later one, where that is not configured.
    #[must_use]
    pub fn found_at(&self) -> Option<A> {
        self.proven.get().filter(|_| self.places.fixed().is_none())
    }

    fn is_reachable(&self) -> bool {
        self.places.is_any(self.proven.get())
    }

    /// Sends one MAVLink frame to the other end. Without keys it is dropped: the protocols above repeat what matters, and a
    /// command that waited might no longer be meant. Nothing ever leaves in the clear but a pairing.
    pub fn send(&mut self, now: Duration, to: A, frame: &[u8]) {
        if let Err(why) = self.enqueue(now, to, frame) {
            self.stats.drop_one(why);
        }
    }

    fn enqueue(&mut self, now: Duration, to: A, frame: &[u8]) -> Result<(), Dropped> {
        if frame_len(frame) != Some(frame.len()) {
            return Err(Dropped::UnsentShape);
        }
        if self.out.len() >= MAX_QUEUED {
            return Err(Dropped::UnsentFull);
        }
        if let Ok(view) = FrameView::parse(frame)
            && clear_suite(&view) == Some(Suite::Pairing)
        {
            self.queue_clear(to, frame);
            return Ok(());
        }
        if self.pending_to.is_some_and(|pending| pending != to) {
            self.flush();
        }
        let mute = self.is_mute();
        let session = self.current.as_mut().ok_or(Dropped::UnsentNoKey)?;
        if mute || !session.sealer.has_room_for(frame.len()) {
            return Err(Dropped::UnsentNoKey);
        }
        let (out, stats) = (&mut self.out, &mut self.stats);
        session.sealer.push(frame, |packet| {
            stats.sealed += 1;
            out.push_back(Queued::new(to, &packet));
        });
        self.pending_to = session.sealer.is_pending().then_some(to);
        if self.linger.is_zero() {
            self.flush();
        } else if self.pending_to.is_some() {
            self.flush_at.get_or_insert(now.saturating_add(self.linger));
        }
        self.sent_at = now;
        Ok(())
    }

    /// An air end that can open nothing is silent: a ground that received it would take no request for other keys.
    fn is_mute(&self) -> bool {
        self.needs_keys() && self.keying.is_air()
    }

    /// When a packet without a frame is due, and where it goes. Before a signing key is in force neither end may have anything to
    /// say for minutes: without such packets that would look like an end that has lost its keys.
    fn idle_at(&self) -> Option<(Duration, A)> {
        let session = self.current.as_ref()?;
        let to = self.places.fixed().or(self.proven.get())?;
        let pause = if self.keying.is_air() {
            AIR_IDLE
        } else {
            GROUND_IDLE
        };
        let may_send = !self.is_mute() && session.sealer.has_room_for(0);
        may_send.then(|| (self.sent_at.saturating_add(pause), to))
    }

    fn send_idle(&mut self, now: Duration) {
        let Some((_, to)) = self.idle_at().filter(|(at, _)| now >= *at) else {
            return;
        };
        let session = self.current.as_mut();
        if let Some(packet) = session.and_then(|session| session.sealer.seal()) {
            self.sent_at = now;
            self.stats.sealed += 1;
            self.out.push_back(Queued::new(to, &packet));
        }
    }

    fn flush(&mut self) {
        self.flush_at = None;
        if let (Some(to), Some(session)) = (self.pending_to.take(), &mut self.current)
            && let Some(packet) = session.sealer.flush()
        {
            self.stats.sealed += 1;
            self.out.push_back(Queued::new(to, &packet));
        }
    }

    /// Sends this to the radio at this end, in the clear: it never goes further.
    pub fn send_radio(&mut self, to: A, bytes: &[u8]) {
        if self.out.len() < MAX_QUEUED && bytes.len() < MAX_CONTENT {
            let mut content = [0; MAX_CONTENT];
            content[0] = Kind::Radio.to_wire();
            content[1..=bytes.len()].copy_from_slice(bytes);
            self.stats.radio += 1;
            self.out
                .push_back(Queued::new(to, &content[..=bytes.len()]));
        }
    }

    fn queue_clear(&mut self, to: A, frame: &[u8]) {
        let mut content = [0; MAX_CONTENT];
        content[0] = Kind::Clear.to_wire();
        if let Some(place) = content.get_mut(1..=frame.len()) {
            place.copy_from_slice(frame);
            self.stats.clear += 1;
            self.out
                .push_back(Queued::new(to, &content[..=frame.len()]));
        }
    }

    fn queue_message(&mut self, to: A, message: &Message) {
        let node = self.keying.own_node();
        let header = Header {
            seq: self.seq,
            system_id: node.system,
            component_id: node.component,
            message_id: KEY_EXCHANGE_ID,
            ..Header::default()
        };
        self.seq = self.seq.wrapping_add(1);
        let mut frame = [0; MAX_FRAME];
        if let Ok(len) = encode_raw(header, &message.to_payload(), &mut frame) {
            self.queue_clear(to, &frame[..len]);
        }
    }

    /// Writes the next frame that is to leave. Call it until it gives `None`, after each of the others.
    pub fn poll_transmit(
        &mut self,
        now: Duration,
        disk: &mut dyn Disk,
        out: &mut [u8; MAX_WIRE],
    ) -> Option<(A, usize)> {
        if self.flush_at.is_some_and(|at| now >= at) {
            self.flush();
        }
        self.adopt(now, false, disk);
        self.send_idle(now);
        if self.out.is_empty() && self.is_reachable() {
            let hint = |keying: &mut Keying<A>| keying.poll_hint(now).map(|hint| (None, hint));
            let message = self.keying.poll_transmit(now, disk);
            let needs_keys = self.needs_keys();
            match message.or_else(|| needs_keys.then(|| hint(&mut self.keying)).flatten()) {
                None => {}
                Some((Some(to), message)) => self.queue_message(to, &message),
                Some((None, message)) => {
                    if let Some(to) = self.places.known(self.proven.get()) {
                        self.places.callers.served(to);
                        self.queue_message(to, &message);
                    }
                }
            }
        }
        let needs_keys = self.needs_keys();
        if self.out.is_empty()
            && let Some((to, message)) = self
                .places
                .callers
                .poll(now, || self.keying.message_for_caller(needs_keys, disk))
        {
            self.queue_message(to, &message);
        }
        let next = self.out.pop_front()?;
        let length = framing::write(&next.content[..next.len], out);
        let to = next.to;
        if !next.again && self.proven.get() == Some(to) {
            for other in self.proven.others(now) {
                self.out.push_front(Queued {
                    to: other,
                    again: true,
                    ..next
                });
            }
        }
        Some((to, length))
    }

    /// Does what is due by now. Calling it early or late does no harm.
    pub fn handle_timeout(&mut self, now: Now, random: &mut dyn Random, disk: &mut dyn Disk) {
        self.step(now, random, disk);
    }

    fn step(&mut self, now: Now, random: &mut dyn Random, disk: &mut dyn Disk) {
        if !self.is_reachable() {
            return;
        }
        // Each time, for it moves on what is due next.
        let silent = self.is_silent_for_too_long(now.mono);
        if silent || self.is_worn() {
            self.keying.want();
        }
        self.keying.handle_timeout(now, random, disk);
        self.adopt(now.mono, false, disk);
    }

    /// With keys, and nothing has verified for a while: the other end may have lost its own. The ground asks, now and then.
    fn is_silent_for_too_long(&mut self, now: Duration) -> bool {
        let Some(since) = self.quiet_since.filter(|_| self.current.is_some()) else {
            return false;
        };
        let at = self.silence.ask_at.unwrap_or(since.saturating_add(SILENCE));
        let due = now >= at;
        if due {
            self.silence = Silence {
                ask_at: Some(now.saturating_add(self.silence.pause)),
                pause: (self.silence.pause * 2).min(ASK_AGAIN_LAST),
            };
        }
        due
    }

    /// The keys were used so often, or forgeries tried on them, that others are due.
    fn is_worn(&self) -> bool {
        self.current.as_ref().is_some_and(|session| {
            session.sealer.counter().max(session.opener.counter()) >= WORN
                || session.opener.is_retired()
        })
    }

    fn needs_keys(&self) -> bool {
        match &self.current {
            None => true,
            Some(session) => session.opener.is_retired(),
        }
    }

    fn adopt(&mut self, now: Duration, proven: bool, disk: &mut dyn Disk) {
        let Some(session) = self.keying.take_confirmed(proven, disk) else {
            return;
        };
        // What waits was put together for the keys before, and leaves under them.
        self.flush();
        let epoch = session.epoch;
        // The pauses of the silence stay as they are: keys under which nothing is received either must not be replaced sooner than
        // those before. A packet ends them.
        (self.quiet_since, self.sent_at) = (Some(now), now);
        let before = self.current.replace(session);
        self.previous = before.filter(|_| !proven).map(|session| session.opener);
        self.note(EncryptedEvent::Keys { epoch });
    }

    fn note(&mut self, event: EncryptedEvent) {
        if self.events.len() < MAX_EVENTS {
            self.events.push_back(event);
        }
    }

    /// When [`handle_timeout`](Self::handle_timeout), or [`poll_transmit`](Self::poll_transmit), is next needed, in
    /// monotonic time.
    #[must_use]
    pub fn poll_timeout(&self) -> Option<Duration> {
        let keying = if self.is_reachable() {
            self.keying.poll_timeout(self.needs_keys())
        } else {
            None
        };
        let silent = match (self.quiet_since, &self.current) {
            (Some(since), Some(_)) => {
                let due = since.saturating_add(SILENCE);
                Some(self.silence.ask_at.unwrap_or(due))
            }
            _ => None,
        };
        let idle = self.idle_at().map(|(at, _)| at);
        let due = self.flush_at.into_iter().chain(keying);
        due.chain(silent).chain(idle).min()
    }
}

impl Default for Silence {
    fn default() -> Self {
        Self {
            ask_at: None,
            pause: ASK_AGAIN,
        }
    }
}

impl<A> Queued<A> {
    fn new(to: A, bytes: &[u8]) -> Self {
        let mut content = [0; MAX_CONTENT];
        let len = bytes.len().min(MAX_CONTENT);
        content[..len].copy_from_slice(&bytes[..len]);
        Self {
            to,
            again: false,
            content,
            len,
        }
    }
}

/// The suite of an exchange that may pass in the clear; `None` for every other frame, the legacy exchange too.
fn clear_suite(frame: &FrameView<'_>) -> Option<Suite> {
    let exchange = frame.header().message_id == KEY_EXCHANGE_ID && frame.is_checked();
    match Message::parse(frame.payload()) {
        Ok(Received::Exchange(message)) if exchange && message.version == VERSION => {
            Suite::from_wire(message.suite)
        }
        _ => None,
    }
}

/// The link works: a request for other keys is a recording, or comes from an end that will ask again.
const WORKING_FOR: Duration = Duration::from_millis(250);
/// How long after a packet the link counts as encrypted.
const SHOWN_FOR: Duration = Duration::from_secs(5);
/// Without a packet for so long the ground begins another exchange: at once, then after these pauses.
const SILENCE: Duration = Duration::from_secs(2);
const ASK_AGAIN: Duration = Duration::from_secs(10);
const ASK_AGAIN_LAST: Duration = Duration::from_secs(60);
/// An end that has sent nothing for so long sends a packet without a frame. That of the air shows the ground that it has the keys:
/// two in a row may be lost within [`SILENCE`]. That of the ground is for the other end's status alone; a bridge's heartbeats are
/// more frequent.
const AIR_IDLE: Duration = Duration::from_millis(600);
const GROUND_IDLE: Duration = Duration::from_secs(2);
/// So many bad packets within this time are an alarm.
const ALARM_AT: u32 = 32;
const ALARM_WITHIN: Duration = Duration::from_secs(10);
/// Packets under one key before another is agreed on; its last counter is twice as far.
const WORN: u32 = 1 << 31;
const MAX_QUEUED: usize = 64;
const MAX_RADIO: usize = 8;
const MAX_EVENTS: usize = 16;
