//! Time Stamps of one station: which of them have been used by commands, and the station's clock estimated from them.
//!
//! **Used stamps.** The memory of duplicates is bounded, so an attacker could replay a recorded command after it was
//! displaced from memory. Stamps of displaced commands are therefore kept in [`UsedStamps`], as spans that only grow: a
//! stamp outside of the spans and the memory has never been used. A single minimum would be simpler, but would permanently
//! lock out a station whose clock was a year ahead for a minute; with spans, the years between two of them stay free. Only
//! authorised commands use their stamps, otherwise anybody could use up future ones. If there are too many spans, older ones
//! are merged.
//!
//! **The station's clock.** An attacker can also hold back a command and deliver it later, for the first time. So a command
//! is compared with the other traffic of its station ([`StationClock`]): with the newest received stamp, advanced by our
//! monotonic time. A message may be late by [`MAX_LATE`], including retransmissions. Our own wall clock is not used, so its
//! steps have no effect.
//!
//! A station's own clock may step. After a step forward, messages are accepted, since a recorded or delayed message is never
//! ahead of everything received. The estimated clock follows only once such traffic has lasted for [`SETTLE`]: one datagram
//! from another year must not make all honest ones late. After a step back, messages are refused until rising stamps have
//! arrived for [`SETTLE`] without any that still fits the earlier clock, or for [`CONTESTED`] with only a few. A replay in
//! parallel to the station's own traffic never achieves that.

use std::time::Duration;

use stanag_msgs::TimeStamp;

use super::delay::{Delay, FastestWay};
pub(crate) use super::delay::{NEAR_MS, stamps_apart_ms};

/// Used stamps: closed spans, more than [`MERGED_MS`] apart, in rising order.
#[derive(Debug, Default, Clone, PartialEq, Eq)]
pub(crate) struct UsedStamps {
    spans: Vec<(u64, u64)>,
}

impl UsedStamps {
    /// Whether a stamp lies in a span.
    pub(crate) fn contains(&self, stamp: TimeStamp) -> bool {
        let after = self.spans.partition_point(|(first, _)| *first <= stamp.0);
        after
            .checked_sub(1)
            .and_then(|index| self.spans.get(index))
            .is_some_and(|(_, last)| stamp.0 <= *last)
    }

    /// Adds a stamp.
    pub(crate) fn insert(&mut self, stamp: TimeStamp) {
        self.insert_span(stamp.0, stamp.0);
    }

    /// Adds a span, merged with any other that is nearer than [`MERGED_MS`]. The caller calls [`UsedStamps::bound`], because
    /// a log is read before the station's clock is known.
    pub(crate) fn insert_span(&mut self, mut first: u64, mut last: u64) {
        let begin = self
            .spans
            .partition_point(|(_, end)| end.saturating_add(MERGED_MS) < first);
        let end = self
            .spans
            .partition_point(|(start, _)| *start <= last.saturating_add(MERGED_MS));
        for (known_first, known_last) in self.spans.get(begin..end).into_iter().flatten() {
            first = first.min(*known_first);
            last = last.max(*known_last);
        }
        if let (1, Some(known)) = (end - begin, self.spans.get_mut(begin)) {
            // The usual case for sticks: extend the last span in place.
            *known = (first, last);
            return;
        }
        self.spans.splice(begin..end, [(first, last)]);
    }

    /// First and last stamp of each span.
    pub(crate) fn spans(&self) -> impl Iterator<Item = (u64, u64)> {
        self.spans.iter().copied()
    }

    /// Bounds the memory: if there are more than [`MAX_SPANS`], merges some of the older ones. `now` is the station's clock.
    ///
    /// The time between two merged spans then counts as used. So only gaps in the past are closed: closing one that contains
    /// `now` or the future would let an attacker with many stamps lock out the station. The smallest gaps of the older half
    /// are closed first, so that a clock set back by minutes, or one that was wrong by years, finds most of its time free.
    pub(crate) fn bound(&mut self, now: TimeStamp) {
        while self.spans.len() > MAX_SPANS {
            let passed = self.passed_gaps(now).count();
            let older = self.passed_gaps(now).take(passed.div_ceil(2));
            let Some(index) = older.min_by_key(|(_, ms)| *ms).map(|(index, _)| index) else {
                return;
            };
            let (_, last) = self.spans.remove(index + 1);
            self.spans[index].1 = last;
        }
    }

    /// The gaps before `now`, the oldest first: the span before each, and its length, ms.
    fn passed_gaps(&self, now: TimeStamp) -> impl Iterator<Item = (usize, u64)> {
        let age = move |stamp: u64| stamps_apart_ms(now, TimeStamp(stamp));
        let after = self.spans.partition_point(|(first, _)| *first <= now.0);
        let order = (after..self.spans.len()).chain(0..after);
        order.filter_map(move |index| match self.spans.get(index..index + 2)? {
            [(_, end), (start, _)] => {
                let (opened, closed) = (age(*end), age(*start));
                // The counter rolls over: the beginning of a gap that ends in the future may seem to be in the past.
                (closed >= 0 && opened >= closed).then_some((index, start - end))
            }
            _ => None,
        })
    }

    /// How many spans begin after `now`.
    pub(crate) fn ahead(&self, now: TimeStamp) -> usize {
        let ahead = |first: u64| stamps_apart_ms(TimeStamp(first), now) > 0;
        self.spans.iter().filter(|(first, _)| ahead(*first)).count()
    }
}

/// The clock of one station, estimated from its traffic.
#[derive(Debug, Default, Clone)]
pub(crate) struct StationClock {
    reference: Option<Reference>,
    /// Since when there has been traffic that follows the reference; `None` if there was none in this run.
    since: Option<Duration>,
    /// Candidate clocks of traffic that does not fit the reference. There are several, so that single forged messages cannot
    /// displace the candidate of the station itself.
    candidates: [Option<Candidate>; MAX_CANDIDATES],
    /// Measures the delay of messages.
    fastest: FastestWay,
}

/// The newest stamp, and its time of arrival.
#[derive(Debug, Clone, Copy)]
struct Reference {
    stamp: TimeStamp,
    at: Duration,
}

/// A candidate clock that fits a part of the traffic.
#[derive(Debug, Clone, Copy)]
struct Candidate {
    newest: Reference,
    /// When it began, without pauses.
    began: Duration,
    /// Since when no newer stamp has fitted the reference.
    alone_since: Option<Duration>,
    /// In how many seconds since its start it was confirmed, and in how many the reference was.
    own: Seconds,
    others: Seconds,
}

/// Counts seconds with a message: a burst of messages counts once.
#[derive(Debug, Default, Clone, Copy)]
struct Seconds {
    count: u64,
    latest: Option<u64>,
}

/// Why a message is late.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Late {
    /// It was delayed, or the station's clock was set back.
    Behind(Duration),
    /// The same, while other messages of the station show the later time.
    Contested(Duration),
    /// The station's stamps have not increased beyond this one for this long.
    Standing(TimeStamp, Duration),
}

impl Reference {
    /// How far a stamp that is received now is ahead of this clock, ms; negative if it is behind.
    fn lead_ms(&self, stamp: TimeStamp, now: Duration) -> i64 {
        let elapsed = now.saturating_sub(self.at).as_millis();
        stamps_apart_ms(stamp, self.stamp) - i64::try_from(elapsed).unwrap_or(i64::MAX / 2)
    }

    /// Whether a stamp received now can be the next of this clock: newer, and not ahead. It may be behind: a station whose
    /// clock was set back may stamp with its last stamp plus one until its clock has caught up.
    fn continues(&self, stamp: TimeStamp, now: Duration) -> bool {
        stamps_apart_ms(stamp, self.stamp) > 0 && self.lead_ms(stamp, now) <= NEAR_MS
    }
}

impl Seconds {
    fn note(&mut self, now: Duration) {
        if self.latest != Some(now.as_secs()) {
            self.latest = Some(now.as_secs());
            self.count += 1;
        }
    }
}

impl Candidate {
    fn new(newest: Reference) -> Candidate {
        let mut own = Seconds::default();
        own.note(newest.at);
        Candidate {
            newest,
            began: newest.at,
            alone_since: Some(newest.at),
            own,
            others: Seconds::default(),
        }
    }

    /// Adds a message to the candidate; returns true if it is now accepted as the station's clock.
    fn goes_on(&mut self, new: Reference) -> bool {
        if new.at.saturating_sub(self.newest.at) > IDLE {
            *self = Candidate {
                alone_since: self.alone_since,
                ..Candidate::new(new)
            };
        }
        self.newest = new;
        self.own.note(new.at);
        let alone_since = *self.alone_since.get_or_insert(new.at);
        let alone = new.at.saturating_sub(alone_since) >= SETTLE;
        // An attacker who occasionally forges a message of the old time must not block the new clock forever, and a replay
        // in parallel to the station's own traffic (once a second) must not move it.
        let lasting = new.at.saturating_sub(self.began) >= CONTESTED;
        alone || lasting && 3 * self.others.count <= self.own.count
    }
}

impl StationClock {
    /// The newest stamp of an earlier run: messages older than that by [`MAX_LATE`] are late, whenever the station is
    /// received again.
    pub(crate) fn restore(&mut self, newest: TimeStamp, now: Duration) {
        self.reference = Some(Reference {
            stamp: newest,
            at: now,
        });
    }

    /// The estimated time of the station's clock now.
    pub(crate) fn reading(&self, now: Duration) -> Option<TimeStamp> {
        let Reference { stamp, at } = self.reference?;
        let elapsed = u64::try_from(now.saturating_sub(at).as_millis()).unwrap_or_default();
        Some(TimeStamp(
            stamp.0.wrapping_add(elapsed) % TimeStamp::PERIOD_MS,
        ))
    }

    /// Whether a stamp received now is ahead of the clock.
    pub(crate) fn is_ahead(&self, stamp: TimeStamp, now: Duration) -> bool {
        let reference = self.reference;
        reference.is_some_and(|reference| reference.lead_ms(stamp, now) > NEAR_MS)
    }

    /// By how much a stamp received now exceeds [`MAX_LATE`]; `None` if it is in time.
    pub(crate) fn lateness(&self, stamp: TimeStamp, now: Duration) -> Option<Duration> {
        let lead_ms = self.reference?.lead_ms(stamp, now);
        let late = Duration::from_millis(u64::try_from(-lead_ms).ok()?);
        (late > MAX_LATE).then_some(late)
    }

    /// Why a stamp that was just noted is late; `None` if it is in time.
    pub(crate) fn late(&self, stamp: TimeStamp, now: Duration) -> Option<Late> {
        let by = self.lateness(stamp, now)?;
        let reference = self.reference?;
        let candidates = self.candidates.iter().flatten().map(|one| one.newest);
        let latest = candidates
            .chain([reference])
            .max_by_key(|one| one.at)
            .unwrap_or(reference);
        let age = |one: Reference| now.saturating_sub(one.at);
        Some(if age(latest) >= SETTLE {
            Late::Standing(latest.stamp, age(latest))
        } else if age(reference) < SETTLE {
            Late::Contested(by)
        } else {
            Late::Behind(by)
        })
    }

    /// The delay of a message with this stamp, which was just noted.
    pub(crate) fn delay(&self, stamp: TimeStamp, now: Duration) -> Delay {
        self.fastest.delay(stamp, now)
    }

    /// Notes the stamp of a message that was received for the first time.
    pub(crate) fn note(&mut self, stamp: TimeStamp, now: Duration) {
        let new = Reference { stamp, at: now };
        let Some(reference) = self.reference else {
            self.fastest.note(stamp, now);
            return self.follow(new, now);
        };
        let in_time = self.lateness(stamp, now).is_none();
        let ahead = self.is_ahead(stamp, now);
        if ahead && !self.is_settled(now) {
            // The first received message may have been old. Honest traffic is ahead of it and need not wait.
            self.fastest.forget();
            self.fastest.note(stamp, now);
            self.candidates = [None; MAX_CANDIDATES];
            return self.follow(new, now);
        }
        let newer_ms = stamps_apart_ms(stamp, reference.stamp);
        if in_time && !ahead {
            self.fastest.note(stamp, now);
            // An older stamp brings nothing new.
            if newer_ms > 0 {
                self.follow(new, self.since.unwrap_or(now));
                for candidate in self.candidates.iter_mut().flatten() {
                    candidate.alone_since = None;
                    candidate.others.note(now);
                }
            }
            return;
        }
        if newer_ms == 0 {
            // A stamp that does not increase is no evidence of a clock.
            return;
        }
        let continued = |one: &&mut Candidate| one.newest.continues(stamp, now);
        let candidates = self.candidates.iter_mut().flatten();
        let nearest = |one: &&mut Candidate| one.newest.lead_ms(stamp, now).abs();
        if let Some(candidate) = candidates.filter(continued).min_by_key(nearest) {
            if candidate.goes_on(new) {
                let began = candidate.began;
                let is_it = |one: &Candidate| one.newest.stamp == stamp;
                self.fastest.forget();
                self.fastest.note(stamp, now);
                for slot in self.candidates.iter_mut() {
                    *slot = slot.filter(|one| !is_it(one));
                }
                self.follow(new, began);
            }
            return;
        }
        let overtaken = |one: &Candidate| {
            (-MAX_LATE_MS..=0).contains(&stamps_apart_ms(stamp, one.newest.stamp))
        };
        if !self.candidates.iter().flatten().any(overtaken) {
            self.begin(new);
        }
    }

    /// Begins a candidate if there is room: a recently confirmed one is not displaced.
    fn begin(&mut self, new: Reference) {
        let at = |slot: &Option<Candidate>| slot.map(|one| one.newest.at);
        let Some(oldest) = self.candidates.iter_mut().min_by_key(|slot| at(slot)) else {
            return;
        };
        if at(oldest).is_none_or(|at| new.at.saturating_sub(at) > IDLE) {
            *oldest = Some(Candidate::new(new));
        }
    }

    fn follow(&mut self, new: Reference, since: Duration) {
        self.reference = Some(new);
        self.since = Some(since);
    }

    fn is_settled(&self, now: Duration) -> bool {
        let since = self.since;
        since.is_some_and(|since| now.saturating_sub(since) >= SETTLE)
    }
}

/// Maximum age of a command on arrival, by its station's own clock. In the networks of the tests, stations retry for up to
/// 40 s.
pub(crate) const MAX_LATE: Duration = Duration::from_secs(60);
const MAX_LATE_MS: i64 = MAX_LATE.as_millis() as i64;
/// A candidate clock is accepted after this time.
pub(crate) const SETTLE: Duration = Duration::from_secs(5);
/// The same while some messages still fit the earlier clock: at most one for every three.
const CONTESTED: Duration = Duration::from_secs(30);
/// Maximum number of candidate clocks.
const MAX_CANDIDATES: usize = 8;
/// A candidate that was not confirmed for longer than this can be displaced, and starts again.
const IDLE: Duration = Duration::from_secs(10);
/// Used stamps that are nearer than this are merged into one span.
const MERGED_MS: u64 = 1_000;
/// Number of past spans that are kept: 16 KiB for each station and kind.
const MAX_SPANS: usize = 1_024;
/// Number of spans ahead of a station's clock. A clock that is set forward is followed within seconds, so an honest station
/// needs few.
pub(crate) const MAX_AHEAD: usize = 512;

#[cfg(test)]
mod tests {
    use super::*;

    const HOUR_MS: u64 = 3_600_000;
    const NOON: u64 = 850_000_000_000;

    fn s(seconds: f64) -> Duration {
        Duration::from_secs_f64(seconds)
    }

    /// Heartbeats at 1 Hz for so many seconds from `at`, whose stamps begin with `stamp`.
    fn beat(clock: &mut StationClock, at: f64, stamp: u64, seconds: u64) {
        for n in 0..=seconds {
            let stamp = TimeStamp((stamp + 1_000 * n) % TimeStamp::PERIOD_MS);
            clock.note(stamp, s(at + n as f64));
        }
    }

    fn in_time(clock: &StationClock, stamp: u64, at: f64) -> bool {
        clock.lateness(TimeStamp(stamp), s(at)).is_none()
    }

    #[test]
    fn used_stamps_stay_used_and_few_and_far_ones_stay_free() {
        let mut random = kit::Random::with_seed(5);
        let (mut used, mut all) = (UsedStamps::default(), Vec::new());
        let mut stamp = NOON;
        for n in 0..8_000 {
            // A thousand a minute, then an hour's pause.
            stamp += if n % 1_000 == 0 {
                HOUR_MS
            } else {
                random.u64(0..9_000)
            };
            let one = TimeStamp(stamp - random.u64(0..5_000));
            used.insert(one);
            used.bound(TimeStamp(stamp));
            all.push(one);
            assert!(used.spans.len() <= MAX_SPANS);
        }
        assert!(all.iter().all(|one| used.contains(*one)));
        assert!(
            used.spans
                .windows(2)
                .all(|pair| pair[0].1 + MERGED_MS < pair[1].0)
        );
        let mut gaps = used.spans.windows(2).map(|pair| pair[1].0 - pair[0].1);
        assert!(gaps.by_ref().filter(|gap| *gap > HOUR_MS / 2).count() >= 6);
        assert!(!used.contains(TimeStamp(NOON)) && !used.contains(TimeStamp(stamp + HOUR_MS)));
    }

    #[test]
    fn however_many_stamps_were_used_now_and_the_future_stay_free() {
        let free = |used: &UsedStamps, from: u64, seconds: u64| {
            let mut moments =
                (0..seconds).map(|n| TimeStamp((from + n * 1_000) % TimeStamp::PERIOD_MS));
            moments.all(|moment| !used.contains(moment))
        };
        // Also where the counter rolls over a moment ago, or soon.
        for now in [NOON, 5_000, TimeStamp::PERIOD_MS - 5_000] {
            let (mut used, clock) = (UsedStamps::default(), TimeStamp(now));
            let at = |ms: i64| {
                let period = TimeStamp::PERIOD_MS as i64;
                TimeStamp((now as i64 + ms).rem_euclid(period) as u64)
            };
            // Every two seconds of the hour to come, before a pause of ten minutes; the days before an hour apart.
            for n in 0..1_500 {
                used.insert(at(600_000 + 2_000 * n));
                used.insert(at(-(HOUR_MS as i64) * (n + 1)));
                used.bound(clock);
            }
            assert!(free(&used, now, 590), "{now}");
            assert!(
                (0..1_500).all(|n| !used.contains(at(601_000 + 2_000 * n))),
                "{now}"
            );
            // Of the past the latest stay apart too.
            assert!(!used.contains(at(-(HOUR_MS as i64) / 2)), "{now}");
            assert!(
                (1..=1_500).all(|n| used.contains(at(-(HOUR_MS as i64) * n))),
                "{now}"
            );
            assert_eq!(used.ahead(clock), 1_500, "{now}");
            // As soon as they have passed they are bounded as well.
            used.bound(at(2 * HOUR_MS as i64));
            assert!(used.spans.len() <= MAX_SPANS + 1);
        }
    }

    #[test]
    fn retransmissions_of_forty_seconds_are_in_time_and_what_was_held_back_is_late() {
        let mut clock = StationClock::default();
        assert!(in_time(&clock, 7, 0.0), "the first message sets it");
        beat(&mut clock, 0.0, NOON, 100);
        assert!(in_time(&clock, NOON + 60_000, 100.0));
        assert!(!in_time(&clock, NOON + 39_000, 100.0));
        // Also where nothing has come since.
        assert!(!in_time(&clock, NOON + 100_001, 161.0));
        assert!(in_time(&clock, NOON + 161_000, 161.0));
    }

    #[test]
    fn a_clock_set_back_by_any_time_heals_in_seconds() {
        for back in [90_000, HOUR_MS, 365 * 24 * HOUR_MS, 20 * 365 * 24 * HOUR_MS] {
            let mut clock = StationClock::default();
            beat(&mut clock, 0.0, NOON, 100);
            let set = NOON + 101_000 - back;
            assert!(
                !in_time(&clock, set, 101.0) || back > TimeStamp::PERIOD_MS / 2,
                "{back}"
            );
            beat(&mut clock, 101.0, set, 5);
            assert!(in_time(&clock, set + 5_000, 106.0), "{back}");
            beat(&mut clock, 107.0, set + 6_000, 60);
            assert!(in_time(&clock, set + 66_000, 167.0), "{back}");
            assert!(!in_time(&clock, set + 5_000, 167.0), "{back}");
        }
    }

    #[test]
    fn a_clock_set_forward_is_followed_without_a_refusal() {
        for forward in [3_000, HOUR_MS, 365 * 24 * HOUR_MS, 16 * 365 * 24 * HOUR_MS] {
            let mut clock = StationClock::default();
            beat(&mut clock, 0.0, NOON, 100);
            let set = (NOON + 101_000 + forward) % TimeStamp::PERIOD_MS;
            for n in 0..100 {
                let stamp = (set + n * 1_000) % TimeStamp::PERIOD_MS;
                assert!(in_time(&clock, stamp, 101.0 + n as f64), "{forward} {n}");
                clock.note(TimeStamp(stamp), s(101.0 + n as f64));
            }
            assert!(!in_time(&clock, set, 201.0), "{forward}");
        }
    }

    #[test]
    fn a_station_that_stamps_with_the_last_stamp_and_one_stays_in_time() {
        let mut clock = StationClock::default();
        beat(&mut clock, 0.0, NOON, 10);
        for n in 0..3_600 {
            let (stamp, at) = (NOON + 10_001 + n, 11.0 + n as f64);
            assert!(in_time(&clock, stamp, at));
            clock.note(TimeStamp(stamp), s(at));
        }
    }

    #[test]
    fn replays_beside_the_stations_own_traffic_move_nothing() {
        for lead in [-(HOUR_MS as i64), HOUR_MS as i64] {
            let mut clock = StationClock::default();
            beat(&mut clock, 0.0, NOON, 10);
            for n in 0..600_u64 {
                let (own, at) = (NOON + 11_000 + n * 1_000, 11.0 + n as f64);
                assert!(in_time(&clock, own, at), "{lead} {n}");
                clock.note(TimeStamp(own), s(at));
                // One frame of another time, now and then; a stream of them where they are behind.
                if lead < 0 || n % 10 == 0 {
                    let other = own.checked_add_signed(lead).unwrap();
                    clock.note(TimeStamp(other), s(at + 0.5));
                }
                assert!(lead > 0 || !in_time(&clock, own - HOUR_MS, at));
            }
        }
    }

    #[test]
    fn single_forged_messages_do_not_hold_down_a_clock_that_was_set() {
        let set = NOON - 365 * 24 * HOUR_MS;
        let mut random = kit::Random::with_seed(3);
        // Forged every 4 s, and several times a second: of any time, and of the time before the step.
        for (old, every, within) in [(false, 4, 6), (false, 1, 30), (true, 4, 45)] {
            let mut clock = StationClock::default();
            beat(&mut clock, 0.0, NOON, 100);
            let mut followed = None;
            for n in 0..300_u64 {
                let at = 101.0 + n as f64;
                clock.note(TimeStamp(set + n * 1_000), s(at));
                if in_time(&clock, set + n * 1_000, at) {
                    followed = followed.or(Some(n));
                } else {
                    assert_eq!(followed, None, "{old} {every} {n}");
                }
                if n % every == 0 {
                    for k in 1..=4 / every {
                        let forged = match old {
                            true => NOON + 101_000 + n * 1_000 + k,
                            false => random.u64(0..TimeStamp::PERIOD_MS),
                        };
                        clock.note(TimeStamp(forged), s(at + 0.1 * k as f64));
                    }
                }
            }
            assert!(
                followed.is_some_and(|n| n <= within),
                "{old} {every}: {followed:?}"
            );
        }
    }

    #[test]
    fn stamps_that_do_not_rise_are_late_for_that_reason() {
        let mut clock = StationClock::default();
        for n in 0..200_u64 {
            // It stands still; later it counts the same three seconds again and again.
            let stamp = TimeStamp(if n < 100 { NOON } else { NOON + n % 3 * 1_000 });
            clock.note(stamp, s(n as f64));
            match clock.late(stamp, s(n as f64)) {
                None => assert!(n <= 62, "{n}"),
                Some(Late::Standing(newest, _)) => assert!(n > 60 && newest.0 < NOON + 3_000),
                // It has risen just now, as far as anybody can know.
                Some(Late::Behind(_)) => assert!((100..108).contains(&n), "{n}"),
                other => panic!("{n}: {other:?}"),
            }
        }
        // Once they rise, they are followed.
        beat(&mut clock, 200.0, NOON + 10_000, 6);
        assert!(in_time(&clock, NOON + 16_000, 206.0));
    }

    #[test]
    fn two_clocks_of_one_station_are_late_for_that_reason() {
        let mut clock = StationClock::default();
        beat(&mut clock, 0.0, NOON, 10);
        for n in 11..120 {
            clock.note(TimeStamp(NOON + n * 1_000), s(n as f64));
            let (other, at) = (TimeStamp(NOON - HOUR_MS + n * 1_000), s(n as f64 + 0.5));
            clock.note(other, at);
            assert!(
                matches!(clock.late(other, at), Some(Late::Contested(_))),
                "{n}"
            );
        }
    }

    #[test]
    fn an_old_frame_received_first_after_a_start_costs_no_command() {
        let mut clock = StationClock::default();
        clock.restore(TimeStamp(NOON), s(0.0));
        assert!(!in_time(&clock, NOON - HOUR_MS, 1.0), "of before the start");
        clock.note(TimeStamp(NOON - HOUR_MS), s(1.0));
        let own = NOON + 3 * HOUR_MS;
        assert!(in_time(&clock, own, 2.0));
        clock.note(TimeStamp(own), s(2.0));
        assert!(!in_time(&clock, NOON + HOUR_MS, 3.0));
    }

    #[test]
    fn the_rollover_of_the_counter_is_no_step() {
        let mut clock = StationClock::default();
        beat(&mut clock, 0.0, TimeStamp::PERIOD_MS - 20_000, 40);
        assert!(in_time(&clock, 20_500, 40.5));
        assert!(in_time(&clock, TimeStamp::PERIOD_MS - 5_000, 40.5));
        assert!(!in_time(&clock, 20_500, 140.5));
        assert_eq!(
            stamps_apart_ms(TimeStamp(5), TimeStamp(TimeStamp::PERIOD_MS - 5)),
            10
        );
        assert_eq!(
            stamps_apart_ms(TimeStamp(TimeStamp::PERIOD_MS - 5), TimeStamp(5)),
            -10
        );
    }
}
