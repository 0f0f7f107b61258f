//! What the Time Stamps of one station are worth: which of them have commanded already, and what its clock shows.
//!
//! **Used stamps.** The memory of duplicates is bounded, so a recorded command can wait until it has been pushed out.
//! The stamp of what leaves the memory therefore stays, in [`UsedStamps`]: spans that only grow, so that a stamp outside
//! of them and outside of the memory has never commanded. A single floor would be simpler, and would lock out for good
//! a station whose clock was wrong by a year for a minute; the years between two spans stay free. Only of what was
//! authorised is the stamp used: else anybody could use up moments to come. Where there are too many spans, older ones
//! become one.
//!
//! **The station's clock.** A command can also be held back and delivered later, for the first time. It is
//! measured against the other traffic of its station ([`StationClock`]): the newest stamp received, carried on by our
//! monotonic time. A message may be late by [`MAX_LATE`], retransmissions included. No wall clock of ours takes part,
//! so that none of ours can step.
//!
//! A station's own clock may step. Forward: what is ahead is accepted, since nothing recorded or held back is ahead of
//! everything that was received. The clock follows it only once such traffic has lasted for [`SETTLE`]: one datagram
//! from another year must not make all honest ones late. Back: refused, until rising stamps have come for [`SETTLE`]
//! without one that still fits the clock as it was, or for [`CONTESTED`] with few that do. A replay beside the station's
//! own traffic never gets there.

use std::time::Duration;

use stanag_msgs::TimeStamp;

use super::delay::{Delay, FastestWay};
pub(crate) use super::delay::{NEAR_MS, stamps_apart_ms};

/// Stamps that must not command again: closed spans, apart by more than [`MERGED_MS`], in rising order.
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

    /// Adds a span, and everything between it and another that is nearer than [`MERGED_MS`]. [`UsedStamps::bound`] is
    /// for the caller: what a log holds is read before it is known what the clock shows.
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
            // As with every next stick: nothing moves.
            *known = (first, last);
            return;
        }
        self.spans.splice(begin..end, [(first, last)]);
    }

    /// First and last stamp of each span.
    pub(crate) fn spans(&self) -> impl Iterator<Item = (u64, u64)> {
        self.spans.iter().copied()
    }

    /// Bounds the memory: where there are more than [`MAX_SPANS`], some of the older become one, by a clock that shows
    /// `now`.
    ///
    /// What lies between two used stamps counts as used from then on. So only gaps that have passed are closed: with one
    /// that `now` or the future lies in, who makes many stamps would lock out the station itself. Of the older half the
    /// smallest: a clock that is set back by minutes, and one that was wrong by years, find most of their time free.
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

    /// The gaps that a clock that shows `now` has passed, the oldest first: the span before each, and how long it is, ms.
    fn passed_gaps(&self, now: TimeStamp) -> impl Iterator<Item = (usize, u64)> {
        let age = move |stamp: u64| stamps_apart_ms(now, TimeStamp(stamp));
        let after = self.spans.partition_point(|(first, _)| *first <= now.0);
        let order = (after..self.spans.len()).chain(0..after);
        order.filter_map(move |index| match self.spans.get(index..index + 2)? {
            [(_, end), (start, _)] => {
                let (opened, closed) = (age(*end), age(*start));
                // The counter rolls over: of a gap that has its end in the future, the beginning may seem to have passed.
                (closed >= 0 && opened >= closed).then_some((index, start - end))
            }
            _ => None,
        })
    }

    /// How many spans begin later than a clock that shows `now`.
    pub(crate) fn ahead(&self, now: TimeStamp) -> usize {
        let ahead = |first: u64| stamps_apart_ms(TimeStamp(first), now) > 0;
        self.spans.iter().filter(|(first, _)| ahead(*first)).count()
    }
}

/// The clock of one station, as its traffic shows it.
#[derive(Debug, Default, Clone)]
pub(crate) struct StationClock {
    reference: Option<Reference>,
    /// Since when there has been traffic that follows the reference; `None` where it was not received in this run.
    since: Option<Duration>,
    /// Traffic that does not fit the reference, by what it would show. Several, so that single messages of any time, as
    /// anybody may forge them, do not take the place of what the station itself sends.
    candidates: [Option<Candidate>; MAX_CANDIDATES],
    /// What is fresh by it.
    fastest: FastestWay,
}

/// The newest stamp, and when it was received.
#[derive(Debug, Clone, Copy)]
struct Reference {
    stamp: TimeStamp,
    at: Duration,
}

/// Another clock that a part of the traffic shows.
#[derive(Debug, Clone, Copy)]
struct Candidate {
    newest: Reference,
    /// When it began, pauses apart.
    began: Duration,
    /// Since when nothing newer has fitted the reference.
    alone_since: Option<Duration>,
    /// In how many seconds since it began it has shown itself, and in how many the reference has.
    own: Seconds,
    others: Seconds,
}

/// Seconds in which something was received: a burst of messages counts as one.
#[derive(Debug, Default, Clone, Copy)]
struct Seconds {
    count: u64,
    latest: Option<u64>,
}

/// Why a message is late.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Late {
    /// It was long on its way, or the clock was set back.
    Behind(Duration),
    /// The same, and other messages of the station show the later time.
    Contested(Duration),
    /// The station's stamps have not risen above this one for so long.
    Standing(TimeStamp, Duration),
}

impl Reference {
    /// How far a stamp that is received now is ahead of this clock, ms; negative where it is behind.
    fn lead_ms(&self, stamp: TimeStamp, now: Duration) -> i64 {
        let elapsed = now.saturating_sub(self.at).as_millis();
        stamps_apart_ms(stamp, self.stamp) - i64::try_from(elapsed).unwrap_or(i64::MAX / 2)
    }

    /// Whether a stamp received now can be the next of this clock: newer, and not ahead. It may be behind: a station
    /// whose clock was set back may stamp with the last stamp and one, until its clock has caught up.
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

    /// Takes its next message; true where it is the clock of the station.
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
        // Who forges a message of the old time now and then must not hold the clock down for ever; who replays beside the
        // station's own traffic must not move it. That traffic comes once a second.
        let lasting = new.at.saturating_sub(self.began) >= CONTESTED;
        alone || lasting && 3 * self.others.count <= self.own.count
    }
}

impl StationClock {
    /// The newest stamp of an earlier run: what is older than that by [`MAX_LATE`] is late, whenever the station is
    /// received again.
    pub(crate) fn restore(&mut self, newest: TimeStamp, now: Duration) {
        self.reference = Some(Reference {
            stamp: newest,
            at: now,
        });
    }

    /// What it shows now.
    pub(crate) fn reading(&self, now: Duration) -> Option<TimeStamp> {
        let Reference { stamp, at } = self.reference?;
        let elapsed = u64::try_from(now.saturating_sub(at).as_millis()).unwrap_or_default();
        Some(TimeStamp(
            stamp.0.wrapping_add(elapsed) % TimeStamp::PERIOD_MS,
        ))
    }

    /// Whether a stamp received now is of a time that it has not reached.
    pub(crate) fn is_ahead(&self, stamp: TimeStamp, now: Duration) -> bool {
        let reference = self.reference;
        reference.is_some_and(|reference| reference.lead_ms(stamp, now) > NEAR_MS)
    }

    /// By how much a stamp received now is later than [`MAX_LATE`] allows; `None` where it is in time.
    pub(crate) fn lateness(&self, stamp: TimeStamp, now: Duration) -> Option<Duration> {
        let lead_ms = self.reference?.lead_ms(stamp, now);
        let late = Duration::from_millis(u64::try_from(-lead_ms).ok()?);
        (late > MAX_LATE).then_some(late)
    }

    /// Why a stamp that was noted just now is late; `None` where it is in time.
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

    /// How long a message with this stamp, which was noted just now, has been on its way.
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
            // What was received first may have been old. Honest traffic is ahead of that, and need not wait.
            self.fastest.forget();
            self.fastest.note(stamp, now);
            self.candidates = [None; MAX_CANDIDATES];
            return self.follow(new, now);
        }
        let newer_ms = stamps_apart_ms(stamp, reference.stamp);
        if in_time && !ahead {
            self.fastest.note(stamp, now);
            // What was overtaken on its way brings nothing new.
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
            // A stamp that stands still shows no clock.
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

    /// Begins a candidate, where there is room: one that has just shown itself is not driven out.
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

/// A command that arrives later than this after it was sent, by its station's own clock, is refused. Stations repeat for
/// up to 40 s over the networks that the tests have.
pub(crate) const MAX_LATE: Duration = Duration::from_secs(60);
const MAX_LATE_MS: i64 = MAX_LATE.as_millis() as i64;
/// Another reading of a station's clock is believed after this time.
pub(crate) const SETTLE: Duration = Duration::from_secs(5);
/// The same beside messages that show the reading before: at most one for three.
const CONTESTED: Duration = Duration::from_secs(30);
/// Other readings that are followed at a time.
const MAX_CANDIDATES: usize = 8;
/// One that has not shown itself for longer makes room, and begins again.
const IDLE: Duration = Duration::from_secs(10);
/// Two used stamps that are nearer than this make one span.
const MERGED_MS: u64 = 1_000;
/// Spans kept of what has passed: 16 KiB a station and kind.
const MAX_SPANS: usize = 1_024;
/// Spans ahead of a station's clock. A clock that is set forward is followed in seconds, so that an honest one makes few.
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
