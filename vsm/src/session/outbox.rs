//! What goes out on the DLI side: stamps that rise strictly, one queue, no allocation a message once it has grown.
//!
//! What a message promises may still be on its way to a slow disk. Such a message is held, and with it what answers the
//! same station afterwards, so that its answers keep their order; nobody else waits for it.

use std::collections::{BTreeMap, VecDeque};
use std::net::SocketAddr;
use std::time::Duration;

use mavlink_link::Now;
use mavlink_link::store::{Changes, Progress};
use stanag_msgs::enums::{AckType, AlertPriority};
use stanag_msgs::{Envelope, Frame, Id, MAX_DATAGRAM, Message, TimeStamp, ed25};

use super::context::Origin;
use super::counters::ByType;
use super::station_profile::StationProfile;

/// Where a datagram goes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Destination {
    /// To one CUCS.
    Unicast(SocketAddr),
    /// To the group, where there is one.
    Multicast,
}

/// One datagram.
#[derive(Debug, Clone)]
pub struct Datagram {
    /// Where it goes.
    pub to: Destination,
    message_type: u16,
    destination: Id,
    /// The bytes that it was charged: its station may speak another edition by the time it is sent.
    pub(crate) charged: usize,
    length: usize,
    bytes: [u8; MAX_DATAGRAM],
}

impl Datagram {
    /// Its bytes.
    #[must_use]
    pub fn bytes(&self) -> &[u8] {
        self.bytes.get(..self.length).unwrap_or_default()
    }

    /// The same way with other bytes, of Edition 2.5; `None` where they are too many.
    pub(crate) fn translated(&self, bytes: &[u8]) -> Option<Datagram> {
        let mut datagram = Datagram {
            length: bytes.len(),
            bytes: [0; MAX_DATAGRAM],
            ..*self
        };
        datagram
            .bytes
            .get_mut(..bytes.len())?
            .copy_from_slice(bytes);
        (!bytes.is_empty()).then_some(datagram)
    }

    /// A datagram of Edition 2.5 for a station.
    pub(crate) fn of_ed25(to: Destination, destination: Id, bytes: &[u8]) -> Option<Datagram> {
        let empty = Datagram {
            to,
            message_type: 0,
            destination,
            charged: 0,
            length: 0,
            bytes: [0; MAX_DATAGRAM],
        };
        empty.translated(bytes)
    }

    /// The same with the type of another message, for tests of what waits.
    #[cfg(test)]
    pub(crate) fn with_type(self, message_type: u16) -> Datagram {
        Datagram {
            message_type,
            ..self
        }
    }

    /// Takes the message of another behind its own; false where there is no room, as behind a question of Edition 2.5, which has one
    /// message per datagram.
    fn take_in(&mut self, other: &Datagram) -> bool {
        if ed25::is_ed25(self.bytes()) {
            return false;
        }
        let end = self.length + other.length;
        let Some(room) = self.bytes.get_mut(self.length..end) else {
            return false;
        };
        room.copy_from_slice(other.bytes());
        self.length = end;
        self.charged += other.charged;
        true
    }

    /// Of the first message in it.
    pub(crate) fn message_type(&self) -> u16 {
        self.message_type
    }

    /// Whom it is for.
    #[must_use]
    pub fn destination(&self) -> Id {
        self.destination
    }
}

/// The time of messages. A station refuses what is stamped before what it has, so a wall clock that is wrong for some
/// seconds must not carry the stamps away: they could not come back.
#[derive(Debug, Default)]
struct WallTime {
    /// The clocks when the wall clock was last believed; monotonic time carries it from there.
    believed: Option<Now>,
    /// Since when the wall clock has been further ahead than the time that it should show, and by how much.
    ahead: Option<(Duration, Duration)>,
}

impl WallTime {
    fn read(&mut self, now: Now) -> Duration {
        let Some(believed) = self.believed else {
            // Before 2000 there are no stamps. They would all be the first one, and no challenge would ever grow old enough to
            // be answered: on a computer that starts in 1970 they run on from their beginning.
            let wall = now.wall.max(EARLIEST);
            self.believed = Some(Now { wall, ..now });
            return wall;
        };
        let carried = believed
            .wall
            .saturating_add(now.mono.saturating_sub(believed.mono));
        // Small corrections, as time synchronisation makes them all the time, are followed at once.
        let small = now.wall.abs_diff(carried) <= SMALL_STEP;
        let ahead = now.wall.saturating_sub(carried);
        let since = match self.ahead {
            Some((since, by)) if by.abs_diff(ahead) <= SMALL_STEP => since,
            _ => now.mono,
        };
        self.ahead = (!small && now.wall > carried).then_some((since, ahead));
        // Set forward for good, as on a computer that starts in 1970: followed. Set back, it is not, for the same reason
        // as above, until the next start.
        if small || (self.ahead.is_some() && now.mono.saturating_sub(since) >= STEP_LASTS) {
            self.believed = Some(now);
            self.ahead = None;
            return now.wall;
        }
        carried
    }
}

/// A message that waits until the disk has made changes durable.
#[derive(Debug)]
pub(crate) struct Held {
    until: Changes,
    /// They cannot be made durable just now: what answers the same station passes by.
    stuck: bool,
    /// The station whose message led to it.
    asker: Option<usize>,
    what: Waiting,
}

/// What is sent then.
#[derive(Debug)]
pub(crate) enum Waiting {
    /// Stamped again when it is sent, since what does not wait overtakes it: a station sees stamps that rise.
    Datagram(Box<Datagram>),
    /// An acknowledgement. It is remembered for duplicates only when it is sent: after a restart in between the command
    /// counts as unanswered.
    Acknowledgement(Id, Origin, AckType),
}

/// The queue of one bridge.
#[derive(Debug, Default)]
pub(crate) struct Outbox {
    queue: VecDeque<Datagram>,
    time: WallTime,
    held: VecDeque<Held>,
    /// The answers of this call depend on decisions of earlier calls, stored by these changes of the disk.
    pub(crate) answer_after: Changes,
    /// Of the latest message, ms since 1970: the stamp itself rolls over.
    last_stamp_ms: u64,
    /// The same of the latest report of measurements, by source, destination and type.
    measured_ms: BTreeMap<Series, u64>,
    /// The latest alerts (16000), by their stamps: an acknowledgement (17000) names no more than that.
    alerts: VecDeque<(TimeStamp, i32)>,
    /// Which stations show which lasting alert, by its id: until its end was sent to each.
    shown: BTreeMap<i32, Vec<usize>>,
    /// Since when another node may serve this VSM: nothing is sent, and reports are not queued ([`super::Bridge::pause`]).
    pub(crate) paused_since: Option<Duration>,
    pub(crate) sent: ByType,
    /// Datagrams that found no room in the queue since they were last counted.
    left_out: u64,
}

/// How a station is sent an alert.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Instance {
    /// With a negative id, as of a new alert.
    First,
    /// Of an alert that it has.
    Later,
    /// It is over, and the station never had it.
    Never,
}

impl Outbox {
    pub(crate) fn is_paused(&self) -> bool {
        self.paused_since.is_some()
    }

    /// Looks at the clocks though nothing is sent: a wall clock that was set right while nobody listened is followed before
    /// somebody does.
    pub(crate) fn watch_time(&mut self, now: Now) {
        // Before anything was stamped nothing can go back: the wall clock is believed as it stands, also one that was set back.
        if self.last_stamp_ms == 0 && self.measured_ms.is_empty() {
            self.time = WallTime::default();
        }
        self.time.read(now);
    }

    /// The time by which messages are stamped now.
    pub(crate) fn time(&mut self, now: Now) -> Duration {
        self.time.read(now)
    }

    /// The stamp of a message made now: later than every one before.
    pub(crate) fn stamp(&mut self, now: Now) -> TimeStamp {
        let now_ms = stamp_ms(self.time.read(now));
        // Two messages within a millisecond still get rising stamps.
        self.last_stamp_ms = now_ms.max(self.last_stamp_ms + 1);
        TimeStamp::from_unix_ms(self.last_stamp_ms)
    }

    /// An alert was written with this stamp, and has this id.
    pub(crate) fn note_alert(&mut self, stamp: TimeStamp, id: i32) {
        if self.alerts.len() == MAX_ALERTS {
            self.alerts.pop_front();
        }
        self.alerts.push_back((stamp, id));
    }

    /// How a station is sent a lasting alert now: its beginning, an update, or its end where it is cleared. A station may have begun
    /// to listen by a restart of the bridge, or just before the alert changed: an update, or an end, of what it was never
    /// sent would be of an alert that it does not know.
    ///
    /// `begins`: the station is sent it as a new one, whatever it has seen.
    pub(crate) fn show(
        &mut self,
        station: usize,
        id: i32,
        begins: bool,
        priority: AlertPriority,
    ) -> Instance {
        let over = priority == AlertPriority::Cleared;
        let known = self.shown.contains_key(&id);
        let to = self.shown.entry(id).or_default();
        let seen = to.contains(&station);
        to.retain(|one| *one != station);
        if !over {
            to.push(station);
        }
        if to.is_empty() {
            self.shown.remove(&id);
        }
        if self.shown.len() > MAX_SHOWN {
            self.shown.pop_first();
        }
        match (begins, seen, over) {
            (true, _, _) | (false, false, false) => Instance::First,
            (false, true, _) => Instance::Later,
            // An end too many does no harm, one too few leaves a lamp on: nobody is left out where nothing is known.
            (false, false, true) if !known => Instance::Later,
            (false, false, true) => Instance::Never,
        }
    }

    /// The id of the alert with this stamp, where it is one of the latest.
    pub(crate) fn alert_of(&self, stamp: TimeStamp) -> Option<i32> {
        let found = self.alerts.iter().find(|(known, _)| *known == stamp);
        found.map(|(_, id)| *id)
    }

    /// When the latest message was stamped, ms since 1970: it does not roll over as the stamp does.
    pub(crate) fn last_stamp_ms(&self) -> u64 {
        self.last_stamp_ms
    }

    /// The stamp of a report of what was measured at `at`, by the monotonic clock: that time, and later than that of the
    /// report before it in its series. Stamps of one message type rise; a measurement is older than an answer of now.
    pub(crate) fn stamp_measured(&mut self, now: Now, at: Duration, series: Series) -> TimeStamp {
        let age = now.mono.saturating_sub(at);
        let at_ms = stamp_ms(self.time.read(now).saturating_sub(age));
        let last_ms = self.measured_ms.entry(series).or_default();
        *last_ms = at_ms.max(*last_ms + 1);
        TimeStamp::from_unix_ms(*last_ms)
    }

    /// Keeps something until changes of the disk are durable; false where there is no room, and something is lost: an
    /// acknowledgement takes the place of the oldest message, since it is sent once, and its command is not carried out again.
    pub(crate) fn hold(
        &mut self,
        (until, stuck): (Changes, bool),
        asker: Option<usize>,
        what: Waiting,
    ) -> bool {
        let of_asker = self.held.iter().filter(|held| held.asker == asker).count();
        let fits = of_asker < MAX_HELD;
        if !fits {
            let is_message =
                |one: &Held| one.asker == asker && matches!(one.what, Waiting::Datagram(_));
            let acknowledges = matches!(what, Waiting::Acknowledgement(..));
            let oldest = self.held.iter().position(is_message);
            let Some(oldest) = oldest.filter(|_| acknowledges) else {
                return false;
            };
            self.held.remove(oldest);
        }
        self.held.push_back(Held {
            until,
            stuck,
            asker,
            what,
        });
        fits
    }

    /// Whether an answer is held for a station, behind which the next one has to wait.
    pub(crate) fn held_for(&self, station: usize) -> Option<Changes> {
        let mut held = self.held.iter();
        let before = |held: &Held| held.asker == Some(station) && !held.stuck;
        held.any(before).then_some(Changes::NONE)
    }

    /// What has waited long enough, in its order for each station.
    pub(crate) fn release(&mut self, progress: impl Fn(Changes) -> Progress) -> Vec<Waiting> {
        let mut behind = Vec::new();
        let mut released = Vec::new();
        for mut held in std::mem::take(&mut self.held) {
            let progress = progress(held.until);
            held.stuck = progress == Progress::Failing;
            if progress == Progress::Durable && !behind.contains(&held.asker) {
                released.push(held.what);
                continue;
            }
            if !held.stuck && !behind.contains(&held.asker) {
                behind.push(held.asker);
            }
            self.held.push_back(held);
        }
        released
    }

    /// What is held for a station was written as it does not read any more; its acknowledgements are not written yet.
    pub(crate) fn drop_written(&mut self, station: Id) {
        let is_for =
            |what: &Waiting| matches!(what, Waiting::Datagram(one) if one.destination == station);
        self.held.retain(|held| !is_for(&held.what));
    }

    /// How many messages wait for the disk.
    pub(crate) fn waiting(&self) -> usize {
        self.held.len()
    }

    /// A message in a datagram of its own, as the station reads it; `None` where it does not fit one.
    pub(crate) fn compose(
        to: Destination,
        profile: &StationProfile,
        envelope: &Envelope,
        message: &Message,
    ) -> Option<Datagram> {
        if !profile.may_be_sent(message) {
            return None;
        }
        let mut datagram = Datagram {
            to,
            message_type: message.id(),
            destination: envelope.destination,
            charged: 0,
            length: 0,
            bytes: [0; MAX_DATAGRAM],
        };
        match profile.encode(message, envelope, &mut datagram.bytes) {
            Ok(length) => datagram.length = length,
            // Every message of ours is shorter than a datagram; one that is not is lost, and visibly so.
            Err(_) => debug_assert!(false, "message {} does not fit a datagram", message.id()),
        }
        (datagram.length > 0).then_some(datagram)
    }

    /// A datagram that has waited, stamped now: what did not wait has overtaken it, and a station sees stamps that rise.
    pub(crate) fn restamped(
        &mut self,
        now: Now,
        datagram: Datagram,
        profile: &StationProfile,
    ) -> Datagram {
        let readings = &profile.readings;
        let Some(Ok(frame)) = readings.frames(datagram.bytes()).next() else {
            return datagram;
        };
        let envelope = profile.envelope(frame.header.source, frame.header.destination);
        let decoded = readings.decode(frame.header.message_type, frame.data);
        let series = (
            frame.header.source,
            frame.header.destination,
            frame.header.message_type,
        );
        let stamp = match self.measured_ms.get_mut(&series) {
            None => self.stamp(now),
            // What was measured is no younger for having waited: it comes just after what has overtaken it.
            Some(last_ms) => {
                *last_ms += 1;
                TimeStamp::from_unix_ms(*last_ms)
            }
        };
        let stamped = decoded.map(|message| message.stamped(stamp));
        let again =
            stamped.map(|message| Outbox::compose(datagram.to, profile, &envelope, &message));
        let charged = datagram.charged;
        let again = again.ok().flatten();
        again.map_or(datagram, |again| Datagram { charged, ..again })
    }

    /// Queues a datagram for the socket.
    pub(crate) fn push(&mut self, datagram: Datagram) {
        if self.queue.len() < MAX_QUEUED {
            self.sent.count(datagram.message_type.into());
            self.queue.push_back(datagram);
        } else {
            self.left_out += 1;
        }
    }

    /// How many datagrams found no room in the queue since the last call.
    pub(crate) fn take_left_out(&mut self) -> u64 {
        std::mem::take(&mut self.left_out)
    }

    /// Queues a message for the socket: in the last datagram for the same station, where there is room in it.
    ///
    /// Its own order is kept, since nothing of that station lies behind that datagram. A queue is as long as what one wake-up leads
    /// to, for a handful of stations in turn: the search is short.
    pub(crate) fn pack(&mut self, datagram: Datagram) {
        let mut latest = self.queue.iter_mut().rev().take(MAX_STATIONS_IN_TURN);
        let for_it =
            |one: &&mut Datagram| one.to == datagram.to && one.destination == datagram.destination;
        let last = latest.find(for_it);
        if last.is_none_or(|last| !last.take_in(&datagram)) {
            return self.push(datagram);
        }
        self.sent.count(datagram.message_type.into());
    }

    /// Puts the messages of a datagram back before all others, each in one of its own. The first has what all were charged.
    pub(crate) fn put_back<'a>(
        &mut self,
        packed: &Datagram,
        messages: impl Iterator<Item = Frame<'a>>,
    ) {
        let mut each: Vec<_> = messages
            .filter_map(|one| packed.translated(one.bytes))
            .collect();
        for later in each.iter_mut().skip(1) {
            later.charged = 0;
        }
        for datagram in each.into_iter().rev() {
            self.queue.push_front(datagram);
        }
    }

    pub(crate) fn pop(&mut self) -> Option<Datagram> {
        self.queue.pop_front()
    }

    pub(crate) fn is_empty(&self) -> bool {
        self.queue.is_empty()
    }
}

/// Source, destination and type of a report.
pub(crate) type Series = (Id, Id, u16);

/// A time since 1970 as stamps count it, before they roll over: none is before 2000, nor what was measured just before
/// [`EARLIEST`].
fn stamp_ms(wall: Duration) -> u64 {
    u64::try_from(wall.as_millis())
        .unwrap_or(u64::MAX / 2)
        .clamp(TimeStamp::EPOCH_UNIX_MS, u64::MAX / 2)
}

/// Datagrams that wait for the socket at most: a download of a full plan to several stations.
const MAX_QUEUED: usize = 65_536;
/// Datagrams that are looked at for one to the same station.
const MAX_STATIONS_IN_TURN: usize = 16;
/// Messages that wait for the disk at most, of what one station has led to.
const MAX_HELD: usize = 256;
/// Lasting alerts of which it is known who shows them: more than a bridge with thousands of vehicles has.
const MAX_SHOWN: usize = 65_536;
/// Alerts whose acknowledgement is still understood.
const MAX_ALERTS: usize = 1_024;
/// The earliest time that is stamped: a little after 2000-01-01, so that the stamps of challenges, which are some seconds old, are none
/// of 2034.
const EARLIEST: Duration = Duration::from_millis(TimeStamp::EPOCH_UNIX_MS + 60_000);
/// A change of the wall clock against monotonic time that is no step.
const SMALL_STEP: Duration = Duration::from_secs(1);
/// How long a step forward must last before the stamps follow it.
const STEP_LASTS: Duration = Duration::from_secs(10);

#[cfg(test)]
mod tests {
    use super::*;
    use crate::session::duplicates::stamps_apart_ms;

    const WALL: Duration = Duration::from_secs(1_795_219_200);
    const YEAR: i64 = 366 * 86_400;

    /// What is stamped each second while the wall clock is wrong by so many seconds, in s after [`WALL`].
    fn stamps(wrong: impl IntoIterator<Item = i64>) -> Vec<u64> {
        let mut outbox = Outbox::default();
        let start = TimeStamp::from_unix_ms(u64::try_from(WALL.as_millis()).unwrap()).0;
        let stamps = wrong.into_iter().zip(0_u64..).map(|(wrong, second)| {
            let wall = WALL.as_secs().saturating_add(second);
            let now = Now {
                mono: Duration::from_secs(500 + second),
                wall: Duration::from_secs(wall.saturating_add_signed(wrong)),
            };
            (outbox.stamp(now).0.saturating_sub(start)) / 1_000
        });
        stamps.collect()
    }

    #[test]
    fn an_alert_is_the_first_to_whoever_was_never_sent_it_and_its_end_goes_to_nobody_else() {
        use AlertPriority::{Cleared, Warning};
        let mut outbox = Outbox::default();
        assert_eq!(outbox.show(0, 7, true, Warning), Instance::First);
        assert_eq!(outbox.show(0, 7, false, Warning), Instance::Later);
        assert_eq!(
            outbox.show(1, 7, false, Warning),
            Instance::First,
            "an update"
        );
        assert_eq!(outbox.show(2, 7, false, Cleared), Instance::Never);
        assert_eq!(
            outbox.show(0, 7, false, Cleared),
            Instance::Later,
            "its end"
        );
        assert_eq!(outbox.show(0, 7, false, Cleared), Instance::Never, "once");
        assert_eq!(outbox.show(1, 7, false, Cleared), Instance::Later);
        assert!(outbox.shown.is_empty(), "what is over takes no room");
        // Thousands of vehicles that fall silent at once, and return.
        for id in 0..3_000 {
            outbox.show(0, id, true, Warning);
        }
        for id in 0..3_000 {
            assert_eq!(outbox.show(0, id, false, Cleared), Instance::Later, "{id}");
        }
    }

    #[test]
    fn messages_share_a_datagram_until_it_is_full_and_are_put_back_one_by_one() {
        let to = |port| Destination::Unicast(SocketAddr::from(([127, 0, 0, 1], port)));
        let message = |port, id: u32| {
            let envelope = Envelope::new(Id(1), Id(id));
            let mut one = Datagram::of_ed25(to(port), Id(id), &[0]).unwrap();
            let heartbeat = Message::from(stanag_msgs::messages::Heartbeat::default());
            one.length = heartbeat.encode(&envelope, &mut one.bytes).unwrap();
            one
        };
        let mut outbox = Outbox::default();
        let length = message(1, 7).length;
        for _ in 0..40 {
            outbox.pack(message(1, 7));
            outbox.pack(message(2, 8));
            // Another id at the same address is another station.
            outbox.pack(message(1, 9));
        }
        let all: Vec<Datagram> = std::iter::from_fn(|| outbox.pop()).collect();
        let fits = MAX_DATAGRAM / length;
        assert_eq!(all.len(), 3 * 40_usize.div_ceil(fits));
        let count = |one: &Datagram| stanag_msgs::frames(one.bytes()).flatten().count();
        assert_eq!(all.iter().map(count).sum::<usize>(), 120);
        assert!(all.iter().all(|one| {
            let mut each = stanag_msgs::frames(one.bytes()).flatten();
            each.all(|frame| frame.header.destination == one.destination)
        }));
        outbox.put_back(&all[0], stanag_msgs::frames(all[0].bytes()).flatten());
        let single: Vec<Datagram> = std::iter::from_fn(|| outbox.pop()).collect();
        assert_eq!(single.len(), fits.min(40));
        assert!(single.iter().all(|one| count(one) == 1 && one.to == to(1)));
    }

    #[test]
    fn no_message_of_a_later_edition_is_packed_behind_a_question_of_edition_2_5() {
        let later = to_station();
        let mut outbox = Outbox::default();
        outbox.push(Datagram::of_ed25(later.to, later.destination, b"2.5").unwrap());
        outbox.pack(later.clone());
        outbox.pack(later);
        let all = std::iter::from_fn(|| outbox.pop());
        let lengths: Vec<usize> = all.map(|one| one.bytes().len()).collect();
        assert_eq!(lengths, [3, 2]);
    }

    fn to_station() -> Datagram {
        let to = Destination::Unicast(SocketAddr::from(([127, 0, 0, 1], 40_000)));
        Datagram::of_ed25(to, Id(1), &[0]).unwrap()
    }

    #[test]
    fn an_acknowledgement_that_waits_for_the_disk_takes_the_place_of_a_message_and_each_loss_is_seen()
     {
        let mut outbox = Outbox::default();
        let until = (Changes { after: 0, until: 1 }, false);
        let heartbeat = Message::from(stanag_msgs::messages::Heartbeat::default());
        let origin = crate::session::testing::origin(&heartbeat);
        let acknowledgement = || Waiting::Acknowledgement(Id(1), origin, AckType::CarriedOut);
        let message = || Waiting::Datagram(Box::new(to_station()));
        for _ in 0..MAX_HELD {
            assert!(outbox.hold(until, Some(0), message()));
        }
        assert!(!outbox.hold(until, Some(0), message()));
        // A message is lost for each, and that is reported.
        for _ in 0..MAX_HELD {
            assert!(!outbox.hold(until, Some(0), acknowledgement()));
        }
        assert!(!outbox.hold(until, Some(0), acknowledgement()));
        assert!(outbox.hold(until, Some(1), acknowledgement()));
        let released = outbox.release(|_| Progress::Durable);
        assert_eq!(released.len(), MAX_HELD + 1);
        let acknowledges = |one: &Waiting| matches!(one, Waiting::Acknowledgement(..));
        assert!(released.iter().all(acknowledges));
    }

    #[test]
    fn datagrams_that_the_queue_has_no_room_for_are_counted() {
        let mut outbox = Outbox::default();
        for _ in 0..MAX_QUEUED + 5 {
            outbox.push(to_station());
        }
        assert_eq!(outbox.take_left_out(), 5);
        assert_eq!(outbox.take_left_out(), 0);
    }

    #[test]
    fn stamps_rise_through_the_roll_over_of_2034() {
        let roll_over = Duration::from_millis(TimeStamp::EPOCH_UNIX_MS + TimeStamp::PERIOD_MS);
        let mut outbox = Outbox::default();
        let series = (Id(1), Id(2), 4000);
        let (mut last, mut last_measured) = (None::<TimeStamp>, None::<TimeStamp>);
        for n in 0..400 {
            let passed = Duration::from_millis(10 * n);
            let now = Now {
                mono: passed,
                wall: roll_over - Duration::from_secs(2) + passed,
            };
            let stamp = outbox.stamp(now);
            let measured = outbox.stamp_measured(
                now,
                passed.saturating_sub(Duration::from_millis(120)),
                series,
            );
            for (stamp, last) in [(stamp, &mut last), (measured, &mut last_measured)] {
                assert!(stamp.0 < TimeStamp::PERIOD_MS, "it fits its five bytes");
                assert!(
                    last.is_none_or(|last| stamps_apart_ms(stamp, last) > 0),
                    "{n}"
                );
                *last = Some(stamp);
            }
        }
        assert_eq!(last, Some(TimeStamp(1_990)), "1.99 s after it");
        assert_eq!(last_measured, Some(TimeStamp(1_870)));
    }

    #[test]
    fn what_was_measured_keeps_its_time_beside_answers_of_now_and_rises_in_its_series() {
        let mut outbox = Outbox::default();
        let (one, other) = ((Id(1), Id(2), 4000), (Id(1), Id(3), 4000));
        let at = |ms: u64| Now {
            mono: Duration::from_millis(ms),
            wall: WALL + Duration::from_millis(ms),
        };
        let ms = |stamp: TimeStamp| stamp.unix_ms() - u64::try_from(WALL.as_millis()).unwrap();
        assert_eq!(ms(outbox.stamp(at(1_000))), 1_000);
        let measured = Duration::from_millis(880);
        for series in [one, other] {
            assert_eq!(ms(outbox.stamp_measured(at(1_001), measured, series)), 880);
        }
        assert_eq!(
            ms(outbox.stamp_measured(at(1_002), measured, one)),
            881,
            "nothing newer is known"
        );
        assert_eq!(
            ms(outbox.stamp(at(1_003))),
            1_003,
            "answers are not moved by it"
        );
        let newer = Duration::from_millis(1_080);
        assert_eq!(ms(outbox.stamp_measured(at(1_200), newer, one)), 1_080);
    }

    #[test]
    fn stamps_run_on_through_a_wall_clock_that_is_wrong_for_some_seconds() {
        for wrong in [7_200, 10 * YEAR, -7_200, -10 * YEAR] {
            let walls = [0, 0, wrong, wrong, wrong, wrong, wrong, 0, 0, 0];
            assert_eq!(stamps(walls), (0..10).collect::<Vec<_>>(), "{wrong}");
        }
    }

    #[test]
    fn before_anything_is_stamped_the_wall_clock_is_believed_as_it_stands() {
        let at = |mono: u64, wall: Duration| Now {
            mono: Duration::from_secs(mono),
            wall,
        };
        for wrong in [
            WALL - Duration::from_secs(7_200),
            WALL + Duration::from_secs(120),
        ] {
            let mut outbox = Outbox::default();
            outbox.watch_time(at(1, wrong));
            outbox.watch_time(at(2, WALL));
            let ms = u64::try_from(WALL.as_millis()).unwrap();
            assert_eq!(outbox.stamp(at(2, WALL)).unix_ms(), ms);
        }
    }

    #[test]
    fn a_wall_clock_that_was_set_forward_for_good_is_followed_and_one_set_back_is_not() {
        let forward = stamps((0..20).map(|second| if second < 3 { 0 } else { 3_600 }));
        assert_eq!(forward[12], 12, "not yet");
        assert_eq!(forward[19], 3_619);
        let back = stamps((0..20).map(|second| if second < 3 { 0 } else { -3_600 }));
        assert_eq!(back, (0..20).collect::<Vec<_>>());
        // Small corrections are followed at once.
        assert_eq!(stamps([0, 1, 1]), [0, 2, 3]);
    }

    #[test]
    fn before_2000_stamps_run_on_from_there_until_the_wall_clock_is_set() {
        let at = |mono: u64, wall: Duration| Now {
            mono: Duration::from_secs(mono),
            wall: wall + Duration::from_secs(mono),
        };
        let unset = Duration::ZERO;
        let mut outbox = Outbox::default();
        outbox.watch_time(at(1, unset));
        let first = outbox.stamp(at(1, unset));
        assert_eq!(outbox.stamp(at(61, unset)).0 - first.0, 60_000);
        outbox.stamp(at(62, WALL));
        let ms = u64::try_from(WALL.as_millis()).unwrap();
        assert_eq!(outbox.stamp(at(73, WALL)).unix_ms(), ms + 73_000);
    }
}
