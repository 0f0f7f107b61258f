//! The state of one link, and what time does to it.

use core::time::Duration;

use super::challenge::{Ping, Receipt, Turns};
use super::config::{LinkConfig, Security};
use super::freshness::HeartbeatLog;
use super::lift::{Lifts, Rising};
use super::path::PathProbe;
use super::peer::{LinkState, PeerLock, Presence};
use super::pin::LinkIdPin;
use super::receiver::KeyState;
use super::report::{Alert, Event, Events, LinkStats};
use crate::Now;
use crate::frame::Parser;
use crate::store::Disk;

/// What a link signs and verifies with, lent for one call.
pub enum Auth<'a> {
    /// The key's state, shared by all links of the key, and the store of its clock.
    Signed {
        /// Key, clock and streams.
        key: &'a mut KeyState,
        /// Where the clock's ceiling is kept.
        store: &'a mut dyn Disk,
    },
    /// For a link with [`Security::Off`](super::Security::Off); a signed link neither sends nor accepts anything without
    /// a key.
    Off,
}

/// One link. `A` is an address: a socket address, or `()` on a serial port.
#[derive(Debug)]
pub struct Link<A> {
    pub(super) config: LinkConfig<A>,
    /// Joins frames that the peer split over two datagrams.
    pub(super) parser: Parser,
    /// For the datagrams of all other senders, each on its own, so that nobody can delay the peer's frames.
    pub(super) strange: Parser,
    pub(super) bytes_at: Duration,
    pub(super) core: Core<A>,
}

/// All of a link except its parsers: the frames that it works on borrow those.
#[derive(Debug)]
pub(super) struct Core<A> {
    pub(super) config: LinkConfig<A>,
    pub(super) peer: PeerLock<A>,
    pub(super) presence: Presence,
    pub(super) rising: Rising<A>,
    pub(super) pin: LinkIdPin,
    pub(super) heartbeats: HeartbeatLog,
    pub(super) seq: u8,
    pub(super) heartbeat_at: Duration,
    pub(super) heartbeat_due: bool,
    /// Where heartbeats must go at once to lift stamps.
    pub(super) lifts: Lifts<A, ()>,
    /// Senders of verified frames that are stamped too far ahead.
    pub(super) challenge: Turns<A, ()>,
    /// Who is to be answered that we are here.
    pub(super) answer: Turns<A, Ping>,
    pub(super) receipt: Receipt,
    pub(super) path: PathProbe<A>,
    pub(super) bad_signatures: Burst,
    pub(super) events: Events<A>,
    pub(super) stats: LinkStats,
    /// Frames of other systems than the vehicle, by system id.
    pub(super) others: Box<[u32; 256]>,
}

/// Distinguishes many in a short time from a few now and then.
#[derive(Debug, Default)]
pub(super) struct Burst {
    since: Duration,
    count: u32,
}

impl Burst {
    /// Counts one more; true from the tenth within ten seconds on.
    pub(super) fn one_more(&mut self, mono: Duration) -> bool {
        if mono.saturating_sub(self.since) > Duration::from_secs(10) {
            (self.since, self.count) = (mono, 0);
        }
        self.count = self.count.saturating_add(1);
        self.count >= 10
    }
}

impl<A: Copy + Eq> Link<A> {
    /// A link that has received nothing; its first heartbeat is due at once.
    #[must_use]
    pub fn new(config: LinkConfig<A>) -> Self {
        Self {
            config,
            parser: Parser::new(),
            strange: Parser::new(),
            bytes_at: Duration::ZERO,
            core: Core {
                config,
                peer: PeerLock::new(config.endpoint),
                presence: Presence::new(),
                rising: Rising::new(),
                pin: LinkIdPin::new(config.vehicle_link_id, config.known_link_id),
                heartbeats: HeartbeatLog::new(),
                seq: 0,
                // The first heartbeat is due at once: a signed frame of ours lifts the stamps of a restarted PX4.
                heartbeat_at: Duration::ZERO,
                heartbeat_due: false,
                lifts: Lifts::new(),
                challenge: Turns::new(),
                answer: Turns::new(),
                receipt: Receipt::default(),
                path: PathProbe::new(),
                bad_signatures: Burst::default(),
                events: Events::new(),
                stats: LinkStats::default(),
                others: Box::new([0; 256]),
            },
        }
    }

    /// The settings.
    #[must_use]
    pub fn config(&self) -> &LinkConfig<A> {
        &self.config
    }

    /// Where messages are sent; `None` on a listening link that has accepted nothing yet.
    #[must_use]
    pub fn peer(&self) -> Option<A> {
        self.core.peer.peer()
    }

    /// Where the vehicle may be as well, while frames of it arrive from several addresses and nothing has shown yet which is its
    /// own: what is sent to the peer goes there too, except a key.
    pub fn others(&self, mono: Duration) -> impl Iterator<Item = A> + use<A> {
        self.core.peer.others(mono)
    }

    /// The state of the link.
    #[must_use]
    pub fn state(&self) -> LinkState {
        self.core.presence.state()
    }

    /// The link id of the vehicle's component 1, where it was learned for certain. Kept and given as
    /// [`LinkConfig::known_link_id`] to the next run, it refuses captures of another link from the start.
    #[must_use]
    pub fn learned_link_id(&self) -> Option<u8> {
        self.core.pin.learned()
    }

    /// When the last frame was accepted, in the caller's monotonic time.
    #[must_use]
    pub fn accepted_at(&self) -> Option<Duration> {
        self.core.presence.accepted_at()
    }

    /// When the last frame was accepted that was made within a minute of it: stamped at or above a heartbeat of ours of that
    /// minute. Whoever records frames and delivers them later does not move it. Where no heartbeat was sent for a minute nothing
    /// bounds an age, and every accepted frame counts.
    #[must_use]
    pub fn present_at(&self) -> Option<Duration> {
        self.core.presence.present_at()
    }

    /// How old the newest frame of ours is that the vehicle has received for certain, or the first where it has received
    /// none; `None` on an unsigned link, and before the first. Frames of the vehicle that are accepted show that
    /// we receive it; this shows that it receives us.
    #[must_use]
    pub fn unanswered(&self, mono: Duration) -> Option<Duration> {
        let since = self.core.receipt.since()?;
        Some(mono.saturating_sub(since))
    }

    /// The other systems whose frames came, and how many of each: what [`LinkStats::unexpected_system`] counts together.
    pub fn other_systems(&self) -> impl Iterator<Item = (u8, u32)> + '_ {
        let all = (0..=u8::MAX).zip(self.core.others.iter().copied());
        all.filter(|(_, count)| *count > 0)
    }

    /// The next event, in the order they happened.
    pub fn poll_event(&mut self) -> Option<Event<A>> {
        self.core.events.pop()
    }

    /// When [`handle_timeout`](Self::handle_timeout) is next needed, in monotonic time.
    #[must_use]
    pub fn poll_timeout(&self) -> Duration {
        let heartbeat = self.core.heartbeat_at;
        self.core
            .presence
            .alert_at()
            .map_or(heartbeat, |alert| alert.min(heartbeat))
    }

    /// Does what is due by now. Calling it early or late does no harm.
    pub fn handle_timeout(&mut self, now: Now) {
        let core = &mut self.core;
        if core.heartbeat_at <= now.mono {
            core.heartbeat_due = true;
            let next = core.heartbeat_at.saturating_add(HEARTBEAT_EVERY);
            // After a long pause the next one is a second from now: missed heartbeats are not sent late.
            core.heartbeat_at = if next > now.mono {
                next
            } else {
                now.mono.saturating_add(HEARTBEAT_EVERY)
            };
        }
        if core.presence.take_alert(now.mono) {
            core.events.alert(Alert::StaysBehind, now.mono);
        }
        // Only while it is received: silence has a report of its own.
        let accepted = core.presence.accepted_at();
        let received = accepted.filter(|at| now.mono.saturating_sub(*at) < UNANSWERED);
        if let Some(at) = received
            && core.config.security == Security::Signed
        {
            core.receipt.handle_timeout(now.mono);
            // Counted up to the last frame that was received, not up to now: where a link is cut both ways the newest
            // answer is up to a second older than that frame, and the vehicle is silent. And not from before that silence:
            // when the link is back, the vehicle has not had the time to answer.
            let resumed = core.presence.resumed_at();
            if core.receipt.is_overdue(UNANSWERED, resumed, at) {
                core.events.alert(Alert::Unanswered, now.mono);
            }
        }
    }

    /// The counters.
    #[must_use]
    pub fn stats(&self) -> LinkStats {
        let (own, strange) = (self.parser.counts(), self.strange.counts());
        let mut stats = self.core.stats;
        stats.events_lost = self.core.events.lost;
        for counts in [own, strange] {
            stats.good_frames += counts.good;
            stats.bad_crc += counts.bad_crc;
            stats.unknown_incompat += counts.unknown_incompat;
            stats.mavlink1 += counts.mavlink1;
            stats.unknown_id += counts.unknown_id;
            stats.truncated += counts.truncated;
            stats.garbage_bytes += counts.garbage_bytes;
        }
        // A correct checksum shows that a frame is whole, and not whose it is.
        let refused = stats.bad_signature + stats.unsigned_vehicle;
        stats.good_frames = stats.good_frames.saturating_sub(refused);
        stats
    }
}

const HEARTBEAT_EVERY: Duration = Duration::from_secs(1);
/// How long no frame of ours may be answered before it is reported: some may be lost.
const UNANSWERED: Duration = Duration::from_secs(10);
