//! The vehicle's clock against ours, by TIMESYNC (111): converts a vehicle's timestamp to the time at which, by our clock,
//! the measurement was made.
//!
//! A request carries our time (TIMESYNC.ts1). The autopilot returns it with its own (tc1, ns since its boot), which is the
//! clock of its time_boot_ms and time_usec. It read that clock between our sending and our receiving, so an exchange
//! bounds the offset of the two clocks to half its round trip on either side.
//!
//! How the offset is chosen:
//! - of the latest exchanges those with short round trips count, and of these the median. Exchanges delayed in a queue are
//!   left out, and one false answer moves nothing;
//! - it counts only while more than half of the exchanges agree with it, and the latest does. A vehicle that lies now and
//!   then, or whose clock runs at another rate, has no offset;
//! - after [`JUMPED`] exchanges in a row against it the clock has jumped: the earlier ones are discarded.
//!
//! A vehicle timestamp later than now, or older than [`MAX_AGE`], is not used. Where even the youngest of the latest
//! messages would have taken much longer than a round trip, their clock is not that of the answers, and none of them is
//! dated by it. The caller then uses the time of arrival, as for a vehicle that does not answer.

use std::collections::VecDeque;
use std::time::Duration;

use mavlink::dialects::development::{MavMessage, TIMESYNC_DATA};

use crate::frame::Node;

/// A moment by the vehicle's clock.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum BootTime {
    /// time_boot_ms: rolls over after 49.7 days.
    Ms(u32),
    /// time_usec of PX4, since boot.
    Us(u64),
}

/// The client of one vehicle.
#[derive(Debug)]
pub struct Client {
    vehicle: Node,
    /// Unanswered requests: ts1, and when each was sent.
    asked: VecDeque<(i64, Duration)>,
    due: Duration,
    request: Option<i64>,
    samples: VecDeque<Sample>,
    offset_us: Option<i64>,
    /// Exchanges in a row that are against the offset.
    contrary: usize,
    /// Requests since the start or the last [`Client::reset`], until an offset was known.
    quick: u32,
    /// Requests since the last answer.
    unanswered: u32,
    /// The least age at arrival, us, of the previous and of the present batch of messages.
    youngest_us: [Option<i64>; 2],
    dated: u32,
}

#[derive(Debug, Clone, Copy)]
struct Sample {
    /// The vehicle's clock minus ours, us, if it was read halfway.
    offset_us: i64,
    round_trip: Duration,
}

impl Sample {
    /// Whether the offset may be this, by this exchange.
    fn allows(&self, offset_us: i64) -> bool {
        let within = micros(self.round_trip / 2 + SLACK);
        self.offset_us.abs_diff(offset_us) <= within.unsigned_abs()
    }
}

impl Client {
    /// For the autopilot `vehicle`.
    #[must_use]
    pub const fn new(vehicle: Node) -> Self {
        Self {
            vehicle,
            asked: VecDeque::new(),
            due: Duration::ZERO,
            request: None,
            samples: VecDeque::new(),
            offset_us: None,
            contrary: 0,
            quick: 0,
            unanswered: 0,
            youngest_us: [None; 2],
            dated: 0,
        }
    }

    /// The vehicle has restarted, or was not received for a while: its clock is unknown.
    pub fn reset(&mut self) {
        *self = Self::new(self.vehicle);
    }

    /// Takes a message of `from`. `fresh`: it was made after the oldest unanswered request. Returns whether it answered
    /// one.
    pub fn handle_message(
        &mut self,
        now: Duration,
        from: Node,
        message: &MavMessage,
        fresh: bool,
    ) -> bool {
        let MavMessage::TIMESYNC(TIMESYNC_DATA { tc1, ts1, .. }) = *message else {
            return false;
        };
        // With tc1 0 it is a request. PX4 sends those to companions, and gives a ground station's answer no weight.
        if from != self.vehicle || tc1 <= 0 || !fresh {
            return false;
        }
        let Some(place) = self.asked.iter().position(|(asked, _)| *asked == ts1) else {
            return false;
        };
        // Each request has one answer: a repetition finds none.
        let Some((_, sent)) = self.asked.remove(place) else {
            return false;
        };
        self.unanswered = 0;
        let round_trip = now.saturating_sub(sent);
        // A long round trip bounds the offset too loosely to help.
        if round_trip <= MAX_ROUND_TRIP {
            self.take(Sample {
                offset_us: tc1 / 1_000 - micros(sent + round_trip / 2),
                round_trip,
            });
        }
        true
    }

    fn take(&mut self, sample: Sample) {
        // Reserved at once, in full: the queue never grows afterwards.
        self.samples
            .reserve_exact(SAMPLES - self.samples.len().min(SAMPLES));
        if self.samples.len() >= SAMPLES {
            self.samples.pop_front();
        }
        self.samples.push_back(sample);
        self.contrary = match self.offset_us {
            Some(known) if !sample.allows(known) => self.contrary + 1,
            _ => 0,
        };
        if self.contrary >= JUMPED {
            // The contrary exchanges are the latest ones: they describe the clock as it is after the jump.
            let before = self.samples.len() - self.contrary;
            self.samples.drain(..before);
            self.contrary = 0;
        }
        if self.contrary == 0 {
            self.offset_us = self.estimate();
        }
    }

    fn estimate(&self) -> Option<i64> {
        let shortest = self.samples.iter().map(|one| one.round_trip).min()?;
        // A frame that waits in a radio's queue has a longer round trip, and waits on one side only: it biases the
        // midpoint.
        let quick = |one: &&Sample| one.round_trip <= 2 * shortest + SHORT;
        // Runs for every answer, so it allocates nothing.
        let (mut offsets, mut count) = ([0; SAMPLES], 0);
        for (place, sample) in offsets.iter_mut().zip(self.samples.iter().filter(quick)) {
            (*place, count) = (sample.offset_us, count + 1);
        }
        let offsets = offsets.get_mut(..count)?;
        offsets.sort_unstable();
        let median = *offsets.get(count / 2)?;
        let agree = self.samples.iter().filter(|one| one.allows(median)).count();
        (agree >= MIN_SAMPLES && 2 * agree > self.samples.len()).then_some(median)
    }

    /// Requests the vehicle's time, where that is due. For a vehicle that is received.
    pub fn handle_timeout(&mut self, now: Duration) {
        if now < self.due {
            return;
        }
        self.asked
            .retain(|(_, sent)| now.saturating_sub(*sent) <= MAX_ROUND_TRIP);
        if self.asked.len() < MAX_ASKED {
            self.asked.reserve_exact(MAX_ASKED - self.asked.len());
            // Never 0, and different each time: the answer is recognised by it.
            let ts1 = i64::try_from(now.as_nanos()).unwrap_or(i64::MAX).max(1);
            self.asked.push_back((ts1, now));
            self.request = Some(ts1);
            self.unanswered = self.unanswered.saturating_add(1);
            self.quick = self.quick.saturating_add(1);
        }
        self.due = now + self.interval();
    }

    fn interval(&self) -> Duration {
        match self.offset() {
            _ if self.unanswered > GIVES_UP => RARELY,
            Some(_) => STEADY,
            None if self.quick < QUICK => QUICKLY,
            None => STEADY,
        }
    }

    /// When [`Client::handle_timeout`] is next needed.
    #[must_use]
    pub const fn poll_timeout(&self) -> Duration {
        self.due
    }

    /// The request to send now.
    pub fn poll_transmit(&mut self) -> Option<MavMessage> {
        let ts1 = self.request.take()?;
        Some(MavMessage::TIMESYNC(TIMESYNC_DATA {
            tc1: 0,
            ts1,
            target_system: self.vehicle.system,
            target_component: self.vehicle.component,
        }))
    }

    /// Whether an answer is awaited.
    #[must_use]
    pub fn is_waiting(&self) -> bool {
        !self.asked.is_empty()
    }

    /// The vehicle's clock minus ours, us; `None` while it is not known.
    #[must_use]
    pub fn offset(&self) -> Option<i64> {
        self.offset_us.filter(|_| self.contrary == 0)
    }

    /// Whether the vehicle answers; `None` of one that never has.
    #[must_use]
    pub fn answers(&self) -> Option<bool> {
        (!self.samples.is_empty()).then_some(self.unanswered <= MAX_UNANSWERED)
    }

    /// The shortest round trip of the latest exchanges.
    #[must_use]
    pub fn round_trip(&self) -> Option<Duration> {
        self.samples.iter().map(|one| one.round_trip).min()
    }

    /// When, by our clock, something was measured that arrives now; `None` where the vehicle's clock is not known, or what it
    /// shows cannot be.
    #[must_use]
    pub fn measured(&mut self, now: Duration, at: BootTime) -> Option<Duration> {
        let age_us = self.age_us(now, at, MAX_AGE)?;
        let longest = self.longest_us()?;
        if self.note_age(age_us) > longest {
            return None;
        }
        Some(before(now, age_us))
    }

    /// The same of something that may have waited on this computer since `from`, where the caller did not run. It may be older by
    /// that, and says nothing about how long messages take: those before it must have shown that.
    #[must_use]
    pub fn measured_waiting(
        &self,
        now: Duration,
        at: BootTime,
        from: Duration,
    ) -> Option<Duration> {
        let age_us = self.age_us(now, at, MAX_AGE + now.saturating_sub(from))?;
        let youngest = self.youngest_us.iter().flatten().min()?;
        (*youngest <= self.longest_us()?).then(|| before(now, age_us))
    }

    /// How old it is, us, where it can be: no older than `oldest`.
    fn age_us(&self, now: Duration, at: BootTime, oldest: Duration) -> Option<i64> {
        let vehicle_us = micros(now).checked_add(self.offset()?)?;
        let age_us = match at {
            BootTime::Us(us) => vehicle_us.checked_sub(i64::try_from(us).ok()?)?,
            BootTime::Ms(ms) => {
                // time_boot_ms rolls over after 49.7 days. A wrapping difference of 32 bits survives that, since ages are
                // short.
                let vehicle_ms = vehicle_us.div_euclid(1_000) as u32;
                let age_ms = vehicle_ms.wrapping_sub(ms) as i32;
                i64::from(age_ms) * 1_000 + vehicle_us.rem_euclid(1_000)
            }
        };
        (age_us >= -micros(SLACK) && age_us <= micros(oldest)).then_some(age_us)
    }

    /// How old the youngest of the latest messages may be, us.
    fn longest_us(&self) -> Option<i64> {
        Some(micros(self.round_trip()? + LATE))
    }

    /// The least age of the latest messages, this one's among them.
    fn note_age(&mut self, age_us: i64) -> i64 {
        // Two batches of minima make a sliding minimum that needs no list of ages.
        self.dated += 1;
        if self.dated > AGES {
            self.youngest_us = [self.youngest_us[1], None];
            self.dated = 1;
        }
        let [before, latest] = &mut self.youngest_us;
        let latest = latest.insert(latest.map_or(age_us, |known| known.min(age_us)));
        before.map_or(*latest, |before| before.min(*latest))
    }
}

/// The time so long before `now`; what is a tick ahead is now.
fn before(now: Duration, age_us: i64) -> Duration {
    now.saturating_sub(Duration::from_micros(
        u64::try_from(age_us).unwrap_or_default(),
    ))
}

fn micros(time: Duration) -> i64 {
    i64::try_from(time.as_micros()).unwrap_or(i64::MAX)
}

/// Exchanges that are remembered: a minute of them.
const SAMPLES: usize = 12;
/// Exchanges that must agree before an offset counts.
const MIN_SAMPLES: usize = 3;
/// Exchanges in a row against the offset after which the clock has jumped.
pub const JUMPED: usize = 3;
/// Round trips that differ by no more than this are equally short.
const SHORT: Duration = Duration::from_millis(2);
/// Clocks are read in ticks, a loaded autopilot answers late, and crystals drift by 50 us a second: no contradiction.
const SLACK: Duration = Duration::from_millis(10);
/// Older measurements are not used: the vehicle counts as silent by then.
pub const MAX_AGE: Duration = Duration::from_millis(3_500);
/// How much longer than a round trip a message may take, when it was made as soon as it was measured.
const LATE: Duration = Duration::from_millis(500);
/// Messages of which the youngest counts: some seconds of them.
const AGES: u32 = 32;
/// Longer round trips bound the offset too loosely.
const MAX_ROUND_TRIP: Duration = Duration::from_secs(3);
const MAX_ASKED: usize = 16;
const QUICKLY: Duration = Duration::from_millis(200);
const STEADY: Duration = Duration::from_secs(5);
const RARELY: Duration = Duration::from_secs(30);
/// Requests in quick succession at most: a radio has little room.
const QUICK: u32 = 20;
/// With more unanswered requests in a row the vehicle no longer answers.
const MAX_UNANSWERED: u32 = 3;
/// After so many unanswered requests the vehicle is treated as one that does not answer.
const GIVES_UP: u32 = 10;

#[cfg(test)]
mod tests {
    use super::*;

    const VEHICLE: Node = Node::new(1, 1);
    /// The vehicle was switched on so long before us, us.
    const BOOTED_US: i64 = 7_000_000;

    /// Both clocks; answers come after the delays of the way there and back, from a vehicle clock that is wrong by `wrong_us`.
    struct Pair {
        now: Duration,
        client: Client,
    }

    impl Pair {
        fn new() -> Pair {
            Pair {
                now: Duration::from_secs(40),
                client: Client::new(VEHICLE),
            }
        }

        fn exchange(&mut self, there_ms: u64, back_ms: u64, wrong_us: i64) -> MavMessage {
            self.now = self.now.max(self.client.poll_timeout());
            self.client.handle_timeout(self.now);
            let Some(MavMessage::TIMESYNC(mut request)) = self.client.poll_transmit() else {
                panic!("nothing is asked at {:?}", self.now);
            };
            assert_eq!(request.tc1, 0);
            self.now += Duration::from_millis(there_ms);
            request.tc1 = (micros(self.now) + BOOTED_US + wrong_us) * 1_000;
            self.now += Duration::from_millis(back_ms);
            let answer = MavMessage::TIMESYNC(request);
            self.client.handle_message(self.now, VEHICLE, &answer, true);
            answer
        }

        /// By how much the offset is wrong, us.
        fn error_us(&self) -> Option<u64> {
            Some(self.client.offset()?.abs_diff(BOOTED_US))
        }
    }

    #[test]
    fn three_exchanges_that_agree_give_the_offset_and_two_do_not() {
        let mut pair = Pair::new();
        for n in 0..5 {
            assert_eq!(pair.error_us().is_some(), n >= 3, "{n}");
            pair.exchange(2, 2, 0);
        }
        assert_eq!(pair.error_us(), Some(0));
        assert_eq!(pair.client.round_trip(), Some(Duration::from_millis(4)));
    }

    #[test]
    fn queues_on_either_way_move_it_by_less_than_their_length() {
        let mut random = dice(9);
        let mut pair = Pair::new();
        for _ in 0..200 {
            // Two of three are held back, for up to 600 ms, on one way.
            let (there, back) = match random() % 3 {
                0 => (3, 3),
                1 => (3 + random() % 600, 3),
                _ => (3, 3 + random() % 600),
            };
            pair.exchange(there, back, 0);
            if let Some(error) = pair.error_us() {
                assert!(error <= 300_000);
            }
        }
        assert!(pair.error_us().expect("they agree") < 5_000);
    }

    #[test]
    fn an_answer_that_lies_is_outvoted_and_the_time_of_arrival_counts_until_the_next() {
        let mut pair = Pair::new();
        for _ in 0..6 {
            pair.exchange(2, 2, 0);
        }
        for lie_us in [-9_000_000, 40_000, i64::MAX / 4_000] {
            pair.exchange(2, 2, lie_us);
            assert_eq!(pair.error_us(), None, "in doubt after {lie_us}");
            pair.exchange(2, 2, 0);
            assert_eq!(pair.error_us(), Some(0));
        }
    }

    #[test]
    fn a_clock_that_jumps_is_followed_after_three_exchanges_and_not_believed_meanwhile() {
        for jump_us in [-6_000_000, 30_000, 86_400_000_000] {
            let mut pair = Pair::new();
            for _ in 0..12 {
                pair.exchange(2, 2, 0);
            }
            for n in 0..3 {
                assert_eq!(pair.error_us().is_some(), n == 0);
                pair.exchange(2, 2, jump_us);
            }
            let offset = pair.client.offset().expect("the new one");
            assert_eq!(offset - BOOTED_US, jump_us);
        }
    }

    #[test]
    fn a_clock_that_runs_ten_times_as_fast_has_no_offset() {
        let mut pair = Pair::new();
        for _ in 0..60 {
            let wrong = 9 * micros(pair.now);
            pair.exchange(2, 2, wrong);
            assert_eq!(pair.error_us(), None);
        }
        // Nor is it asked five times a second for ever.
        assert_eq!(
            pair.client.poll_timeout().saturating_sub(pair.now),
            STEADY - Duration::from_millis(4)
        );
    }

    #[test]
    fn repeated_foreign_unrequested_and_old_answers_change_nothing() {
        let mut pair = Pair::new();
        let mut answers: Vec<MavMessage> = (0..4).map(|_| pair.exchange(2, 2, 0)).collect();
        let (offset, samples) = (pair.client.offset(), pair.client.samples.len());
        answers.push(MavMessage::TIMESYNC(TIMESYNC_DATA {
            tc1: 5_000_000,
            ts1: 77,
            ..TIMESYNC_DATA::default()
        }));
        for answer in &answers {
            assert!(!pair.client.handle_message(pair.now, VEHICLE, answer, true));
        }
        pair.now = pair.client.poll_timeout();
        pair.client.handle_timeout(pair.now);
        let Some(MavMessage::TIMESYNC(mut request)) = pair.client.poll_transmit() else {
            panic!("it is due");
        };
        // PX4's own requests have tc1 0.
        assert!(!pair.client.handle_message(
            pair.now,
            VEHICLE,
            &MavMessage::TIMESYNC(request.clone()),
            true
        ));
        request.tc1 = 1;
        let answer = MavMessage::TIMESYNC(request);
        assert!(
            !pair
                .client
                .handle_message(pair.now, Node::new(1, 158), &answer, true)
        );
        assert!(
            !pair
                .client
                .handle_message(pair.now, VEHICLE, &answer, false),
            "a recording"
        );
        assert_eq!(
            (pair.client.offset(), pair.client.samples.len()),
            (offset, samples)
        );
    }

    #[test]
    fn a_measurement_is_dated_by_the_vehicles_clock_over_its_roll_over() {
        let mut pair = Pair::new();
        for _ in 0..4 {
            pair.exchange(2, 2, 0);
        }
        let age = Duration::from_millis(120);
        let at = |pair: &mut Pair, boot: BootTime| pair.client.measured(pair.now, boot);
        let boot_us = micros(pair.now - age) + BOOTED_US;
        assert_eq!(
            at(&mut pair, BootTime::Us(boot_us as u64)),
            Some(pair.now - age)
        );
        let by_ms = at(&mut pair, BootTime::Ms((boot_us / 1_000) as u32)).expect("plausible");
        assert!((pair.now - age).abs_diff(by_ms) <= Duration::from_millis(1));
        // 49.7 days later time_boot_ms begins again.
        pair.client.offset_us = Some((1 << 32) * 1_000 - micros(pair.now) + 50_000);
        let before = u32::MAX - 69;
        let by_ms = at(&mut pair, BootTime::Ms(before)).expect("plausible");
        assert_eq!(pair.now - by_ms, age);
    }

    #[test]
    fn what_waited_is_dated_where_messages_before_it_were() {
        let mut pair = Pair::new();
        for _ in 0..4 {
            pair.exchange(2, 2, 0);
        }
        let boot = |at: Duration| BootTime::Us((micros(at) + BOOTED_US) as u64);
        let stopped = pair.now;
        let waited =
            |pair: &Pair, at: Duration| pair.client.measured_waiting(pair.now, boot(at), stopped);
        pair.now += Duration::from_secs(13);
        let made = stopped + Duration::from_secs(2);
        assert_eq!(waited(&pair, made), None, "nothing was dated before");
        let fresh = boot(pair.now);
        assert_eq!(pair.client.measured(pair.now, fresh), Some(pair.now));
        assert_eq!(waited(&pair, made), Some(made));
        assert_eq!(pair.client.measured(pair.now, boot(made)), None);
        let long_before = stopped - MAX_AGE - Duration::from_secs(1);
        assert_eq!(waited(&pair, long_before), None);
    }

    #[test]
    fn a_time_that_cannot_be_is_none() {
        let mut pair = Pair::new();
        assert_eq!(
            pair.client.measured(pair.now, BootTime::Ms(0)),
            None,
            "nothing is known"
        );
        for _ in 0..4 {
            pair.exchange(2, 2, 0);
        }
        let now_us = (micros(pair.now) + BOOTED_US) as u64;
        for us in [0, now_us - 3_600_000, now_us + 200_000, u64::MAX] {
            assert_eq!(
                pair.client.measured(pair.now, BootTime::Us(us)),
                None,
                "{us}"
            );
        }
        // All of them as old as this: they are not dated by the clock that answers.
        let old = BootTime::Us(now_us - 900_000);
        assert_eq!(pair.client.measured(pair.now, old), None);
        // A tick ahead is now, never later.
        let ahead = BootTime::Us(now_us + 4_000);
        assert_eq!(pair.client.measured(pair.now, ahead), Some(pair.now));
        // One of many that waited in a queue is dated.
        assert_eq!(
            pair.client.measured(pair.now, old),
            Some(pair.now - Duration::from_millis(900))
        );
    }

    #[test]
    fn a_vehicle_that_does_not_answer_is_asked_rarely() {
        let mut client = Client::new(VEHICLE);
        let (mut now, mut asked) = (Duration::ZERO, 0);
        while now < Duration::from_secs(600) {
            now = now.max(client.poll_timeout());
            client.handle_timeout(now);
            asked += u32::from(client.poll_transmit().is_some());
            now += Duration::from_millis(1);
        }
        assert!((20..45).contains(&asked), "{asked} requests in ten minutes");
        assert!(client.asked.len() <= MAX_ASKED);
    }

    /// Numbers from 0 to 2^31, the same for a seed.
    fn dice(seed: u64) -> impl FnMut() -> u64 {
        let mut state = seed;
        move || {
            state = state
                .wrapping_mul(6_364_136_223_846_793_005)
                .wrapping_add(1_442_695_040_888_963_407);
            state >> 33
        }
    }
}
