//! Manual flight: sticks (2010) become MANUAL_CONTROL. Each is sent as it arrives, and the last one is repeated 25 times a
//! second while sticks keep arriving. With a fixed clock a stick would be up to 40 ms late, which a pilot notices. Messages
//! are at least 15 ms apart: the newest stick waits for that.
//!
//! The stream starts with mode 2 (2016) and not before: PX4 breaks off a mission when sticks move. Mode 2 is refused without
//! sticks, and where the vehicle ignores them (COM_RC_IN_MODE), also for others that it has. When they stop, the stream stops too,
//! [`FRESH`] later: PX4 then detects the loss and acts as configured (COM_RC_LOSS_T, NAV_RCL_ACT). The stream ends with the mode;
//! continuing needs another 2016.
//!
//! It ends as soon as another mode is commanded, before the vehicle shows that: sticks that are let go at that moment would take it
//! back (MAN_OVERRIDE_SPD), and so would those that were sent before ([`Sticks::stand_still`]). PX4 then misses them in whatever mode
//! follows, as it does sticks that fail, until a mode is commanded once it does: see
//! [`Again::AfterSticks`](crate::session::maneuver). So it is where mode 2 is refused: the mode that is flown is commanded again
//! ([`Maneuver::staying`](crate::session::maneuver::Maneuver::staying)).
//!
//! A failsafe of PX4 may take the vehicle out of the mode while sticks arrive, as at a fence. PX4 would miss them there too, and leave
//! the failsafe's mode for what that is to do. So centred ones are sent for as long as they arrive ([`Sticks::stand_aside`]), also after
//! a mode 2 that PX4 refuses there ([`Sticks::give_up`]). They end with the failsafe: PX4 takes one source of sticks at a time, and a pilot
//! who has the vehicle by then would be kept out.
//!
//! No source gives the scale of the sticks: per cent of travel, -100 to 100, throttle 0 to 100. Right, forward (nose
//! down) and clockwise are positive. An absent stick is centred, an absent throttle is half: hold the height.

use std::array;
use std::time::Duration;

use mapping::mode::Px4Mode;
use mapping::parameter::Parameters;
use mavlink_link::dialect::MANUAL_CONTROL_DATA;
use stanag_msgs::messages::UaStickCommand;

/// The machine.
#[derive(Debug, Default)]
pub(crate) struct Sticks {
    latest: Option<(Duration, UaStickCommand)>,
    stream: Stream,
    due: Duration,
    /// When the last one was sent, and the minimum time to the next.
    sent: Duration,
    apart: Duration,
    /// What was sent last: x, y, z and r.
    last: Option<[Axis; 4]>,
    /// That was a step back, or stands still since.
    still: bool,
    /// The vehicle has been sent some in this flight, and takes their end for a loss.
    expected: bool,
    /// The vehicle has shown a mode since the start of the VSM.
    mode_noted: bool,
}

/// What was sent of an axis, and which way it moved last.
#[derive(Debug, Clone, Copy)]
struct Axis {
    value: i16,
    way: i16,
}

impl Axis {
    fn new(value: i16) -> Axis {
        Axis { value, way: 0 }
    }

    fn moved(self, value: i16) -> Axis {
        let way = match value - self.value {
            0 => self.way,
            step => step.signum(),
        };
        Axis { value, way }
    }

    fn a_step_back(self) -> i16 {
        self.value - self.way
    }
}

/// The state of manual flight.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
enum Stream {
    #[default]
    Off,
    /// Mode 2 is commanded; the vehicle does not report it yet.
    Entering,
    /// The vehicle is flown by hand.
    Flying,
    /// The vehicle is flown by hand, but the sticks stopped at that time.
    Lost(Duration),
    /// A failsafe of PX4 has the vehicle: centred ones are sent in place of those that arrive.
    Aside,
    /// Mode 2 was not entered: the last is sent once more, as another mode is entered.
    Ending,
}

/// What is due now.
#[derive(Debug, PartialEq)]
pub(super) enum Due {
    None,
    Send(MANUAL_CONTROL_DATA),
    /// The sticks have just stopped.
    Stopped,
}

impl Sticks {
    /// Takes a 2010. A stick with an older stamp than the last one arrived late and is ignored.
    pub(super) fn take(&mut self, now: Duration, sticks: &UaStickCommand) -> Result<(), String> {
        let signed = [
            ("Lateral Stick", sticks.lateral_stick),
            ("Longitudinal Stick", sticks.longitudinal_stick),
            ("Rotational Stick", sticks.rotational_stick_rudder),
        ];
        for (name, value) in signed {
            if let Some(value) = value.filter(|value| !(-100..=100).contains(value)) {
                return Err(format!("{name} {value}, expected -100 to 100"));
            }
        }
        if let Some(throttle) = sticks.throttle_stick_engine_1.filter(|value| *value > 100) {
            return Err(format!("Throttle Stick {throttle}, expected 0 to 100"));
        }
        let overtaken = self.latest.as_ref().is_some_and(|(at, latest)| {
            match (latest.time_stamp, sticks.time_stamp) {
                // Only if it arrives among newer ones: later it is from a clock that was set back.
                (Some(latest), Some(new)) if now.saturating_sub(*at) < FRESH => {
                    new < latest && latest.0 - new.0 < CLOCK_SET_MS
                }
                _ => false,
            }
        });
        if !overtaken {
            self.latest = Some((now, sticks.clone()));
            // A new stick does not wait for the next repetition, only for the minimum spacing.
            self.due = self.due.min(self.sent + self.apart);
        }
        Ok(())
    }

    /// Control has changed: the previous CUCS's sticks and stamps no longer apply, since each CUCS has its own clock.
    pub(crate) fn forget(&mut self) {
        self.latest = None;
    }

    /// Whether sticks are arriving.
    pub(super) fn fresh(&self, now: Duration) -> bool {
        self.latest
            .as_ref()
            .is_some_and(|(at, _)| now.saturating_sub(*at) < FRESH)
    }

    /// Whether POSCTL is flown with these sticks. PX4 leaves the mode soon after they stop, unless it has other sticks: then
    /// a pilot is flying.
    pub(super) fn steer(&self, now: Duration) -> bool {
        match self.stream {
            Stream::Off | Stream::Aside | Stream::Ending => false,
            Stream::Entering | Stream::Flying => true,
            Stream::Lost(since) => now.saturating_sub(since) < LEFT_WITHIN,
        }
    }

    /// Whether those that the vehicle reports to have may be these. It has them until it takes them for lost.
    pub(super) fn were_shown(&self, now: Duration, lost_within: Duration) -> bool {
        !self.sent.is_zero() && now.saturating_sub(self.sent) < lost_within + SHOWN_WITHIN
    }

    /// `slow`: on a serial line, of which 66 a second would be most, packed and encrypted.
    pub(super) fn engage(&mut self, now: Duration, slow: bool) {
        self.apart = if slow { PERIOD } else { SHORTEST };
        self.stream = Stream::Entering;
        self.due = now;
    }

    /// Nothing is sent for now: the vehicle's mode is not known since a stop of the bridge, and PX4 would leave its failsafe for
    /// sticks; or another mode is being entered.
    pub(super) fn withhold(&mut self, now: Duration) {
        self.due = self.due.max(now + PERIOD);
    }

    /// The last sticks once more as another mode is entered, where they still come, each axis a step of a thousandth back.
    ///
    /// PX4 judges the last movement every 0.2 s until it misses the sticks (ManualControl::Run), and takes it for a pilot who wants the
    /// vehicle where three samples in a row went one way (MovingDiff): none after that step has.
    pub(super) fn stand_still(&mut self, now: Duration, system: u8) -> Option<MANUAL_CONTROL_DATA> {
        let last = self.last.filter(|_| !self.still && self.fresh(now))?;
        let back = last.map(Axis::a_step_back);
        self.sent = now;
        self.note_sent(back);
        self.still = true;
        Some(message(back, system))
    }

    fn note_sent(&mut self, axes: [i16; 4]) {
        self.last = Some(match self.last {
            Some(last) => array::from_fn(|axis| last[axis].moved(axes[axis])),
            None => axes.map(Axis::new),
        });
    }

    /// `failsafe`: the vehicle flies by itself as a failsafe of PX4, and not because of a command. Returns whether the sticks have just
    /// ceased to steer: they steer again by another 2016, also where PX4 returns to the mode by itself.
    pub(super) fn stand_aside(&mut self, now: Duration, failsafe: bool) -> bool {
        match self.stream {
            // Those that have stopped are what it is for.
            Stream::Flying if failsafe && self.fresh(now) => {
                self.stream = Stream::Aside;
                true
            }
            // A pilot or another station has the vehicle, or may have it: POSCTL shows no difference to a return of PX4 by itself.
            Stream::Aside if !failsafe => {
                self.release();
                false
            }
            _ => false,
        }
    }

    /// Whether centred ones are sent while a failsafe has the vehicle.
    pub(super) fn are_aside(&self) -> bool {
        self.stream == Stream::Aside
    }

    /// Mode 2 was not entered: the sticks end, unless a failsafe of PX4 has the vehicle and would be left for want of them. Returns
    /// whether centred ones follow.
    pub(super) fn give_up(&mut self, failsafe: bool) -> bool {
        match self.stream {
            Stream::Entering if failsafe && self.expected => {
                self.stream = Stream::Aside;
                return true;
            }
            Stream::Entering => {
                self.stream = Stream::Ending;
                self.due = self.sent + self.apart;
            }
            Stream::Aside | Stream::Ending => {}
            Stream::Off | Stream::Flying | Stream::Lost(_) => self.release(),
        }
        false
    }

    /// The mode that ends them is flown.
    pub(super) fn end_aside(&mut self) {
        if self.are_aside() {
            self.release();
        }
    }

    /// Whether another may be sent, so that PX4 judges the last by itself.
    pub(super) fn are_apart(&self, now: Duration) -> bool {
        now >= self.sent + self.apart
    }

    /// Ends the stream: mode 2 was not entered, or another mode is.
    pub(crate) fn release(&mut self) {
        self.stream = Stream::Off;
        self.last = None;
        self.still = false;
    }

    /// `mode`: the last reported mode, and whether the report is newer than the last command that may change it.
    pub(super) fn advance(
        &mut self,
        now: Duration,
        (mode, newer): (Option<Px4Mode>, bool),
        system: u8,
    ) -> Due {
        let by_hand = mode == Some(Px4Mode::POSCTL);
        match self.stream {
            Stream::Off => return Due::None,
            Stream::Ending if !self.are_apart(now) => return Due::None,
            Stream::Ending => {
                let still = self.stand_still(now, system);
                self.release();
                return still.map_or(Due::None, Due::Send);
            }
            // A report from before the command may show an earlier POSCTL.
            Stream::Entering if by_hand && newer => self.stream = Stream::Flying,
            Stream::Entering => {}
            Stream::Flying | Stream::Lost(_) if !by_hand => {
                self.release();
                return Due::None;
            }
            Stream::Flying | Stream::Lost(_) | Stream::Aside => {}
        }
        if !self.fresh(now) {
            // Do not repeat the last sticks: PX4 must detect the loss and act by its own parameters.
            if matches!(self.stream, Stream::Lost(_)) {
                return Due::None;
            }
            let is_aside = self.are_aside();
            self.release();
            if !is_aside {
                self.stream = Stream::Lost(now);
            }
            return Due::Stopped;
        }
        // Sticks that return while POSCTL is still flown need no new 2016.
        if matches!(self.stream, Stream::Lost(_)) {
            self.stream = Stream::Flying;
        }
        if self.due > now {
            return Due::None;
        }
        // Counted from the due time, so that late calls keep the rate; a longer gap is not made up for.
        self.due = if self.due + PERIOD > now {
            (self.due + PERIOD).max(now + self.apart)
        } else {
            now + PERIOD
        };
        self.sent = now;
        let Some((_, sticks)) = &self.latest else {
            return Due::None;
        };
        // To the centre they move twice one way at most, after the step back: PX4 takes three for a pilot's.
        let axes = match self.last.filter(|_| !self.still) {
            _ if !self.are_aside() => axes(sticks),
            Some(last) => last.map(Axis::a_step_back),
            None => CENTRED,
        };
        self.still = self.are_aside();
        self.note_sent(axes);
        self.expected = true;
        Due::Send(message(axes, system))
    }

    /// A VSM that was killed leaves a vehicle in POSCTL whose sticks have ended, and which may not miss them yet: what is commanded
    /// then is met by their loss as if this one had sent them.
    pub(super) fn note_first_mode(&mut self, now: Duration, mode: Px4Mode) {
        if !self.mode_noted && mode == Px4Mode::POSCTL {
            (self.expected, self.sent) = (true, now);
        }
        self.mode_noted = true;
    }

    /// Whether the vehicle takes the end of the stream for a loss of the sticks.
    pub(super) fn are_expected(&self) -> bool {
        self.expected
    }

    /// Whether it is still to miss those that have ended.
    pub(super) fn will_be_missed(&self, now: Duration, lost_within: Duration) -> bool {
        self.expected && now.saturating_sub(self.sent) <= lost_within
    }

    /// It does so no longer: a mode was commanded since.
    pub(super) fn are_ended(&mut self) {
        self.expected = false;
    }

    /// The vehicle is disarmed, and arms without sticks once it has noticed that there are none.
    pub(super) fn note_disarmed(&mut self, now: Duration, lost_within: Duration) {
        self.expected &= now.saturating_sub(self.sent) <= lost_within;
    }

    pub(crate) fn poll_timeout(&self) -> Option<Duration> {
        match self.stream {
            Stream::Entering | Stream::Flying | Stream::Aside | Stream::Ending => Some(self.due),
            Stream::Off | Stream::Lost(_) => None,
        }
    }

    /// The last 2010, and until when it is valid.
    pub(crate) fn latest(&self) -> Option<(&UaStickCommand, Duration)> {
        let latest = self.latest.as_ref();
        latest.map(|(at, sticks)| (sticks, *at + FRESH))
    }
}

/// By then PX4 has taken sticks that have ended for lost, and its failsafe is active. It looks every 0.2 s whether they are older
/// than COM_RC_LOSS_T (ManualControl::Run), and every 0.1 s what follows (Commander::run); a link delays what is commanded next.
pub(super) fn lost_within(parameters: &Parameters) -> Duration {
    Duration::from_secs_f64(parameters.sticks_last_s()) + Duration::from_millis(500)
}

/// x, y, z and r of MANUAL_CONTROL.
fn axes(sticks: &UaStickCommand) -> [i16; 4] {
    // DLI sticks are per cent, those of MANUAL_CONTROL per mille.
    let axis = |stick: Option<i8>| i16::from(stick.unwrap_or(0)) * 10;
    let throttle = sticks.throttle_stick_engine_1;
    let z = throttle.map_or(HALF_THROTTLE, |throttle| i16::from(throttle) * 10);
    let r = axis(sticks.rotational_stick_rudder);
    [
        axis(sticks.longitudinal_stick),
        axis(sticks.lateral_stick),
        z,
        // The left stick in a lower corner is a gesture to PX4: it arms and disarms (MAN_ARM_GESTURE), or stops the motors in
        // flight (MAN_KILL_GEST_T). That needs LOI 5, and has messages of its own (2008, 2005); sticks need LOI 4.
        if z < LOW {
            r.clamp(-NO_GESTURE, NO_GESTURE)
        } else {
            r
        },
    ]
}

fn message([x, y, z, r]: [i16; 4], system: u8) -> MANUAL_CONTROL_DATA {
    MANUAL_CONTROL_DATA {
        target: system,
        x,
        y,
        z,
        r,
        ..MANUAL_CONTROL_DATA::default()
    }
}

/// How long a stick is valid. A link that loses every second of 10 sticks a second can still be flown.
const FRESH: Duration = Duration::from_millis(300);
/// PX4 takes this long to accept that there are sticks: until then it refuses the mode, with a STATUSTEXT.
pub(super) const SEEN_WITHIN: Duration = Duration::from_millis(500);
/// By then PX4 has left POSCTL for its failsafe for lost sticks (COM_RC_LOSS_T, default 0.5 s) and has reported it.
const LEFT_WITHIN: Duration = Duration::from_secs(3);
/// SYS_STATUS comes once a second, and may be lost a few times.
const SHOWN_WITHIN: Duration = Duration::from_secs(5);
/// Period of MANUAL_CONTROL without new sticks.
const PERIOD: Duration = Duration::from_millis(40);
/// Minimum time between two messages. Less than the 20 ms of a CUCS that sends 50 a second, so that a slightly early stick
/// is not delayed.
const SHORTEST: Duration = Duration::from_millis(15);
const HALF_THROTTLE: i16 = 500;
/// x, y, z and r of sticks that nobody touches.
const CENTRED: [i16; 4] = [0, 0, HALF_THROTTLE, 0];
/// PX4 sees a gesture below a throttle of 100 and beyond a rudder of 900 (ManualControl::processStickArming), which it rounds to
/// more than 0.9. Half a tenth away from both, rounding and [`Axis::a_step_back`] make none.
const LOW: i16 = 150;
const NO_GESTURE: i16 = 850;
/// A stamp this far back means that the clock was set.
const CLOCK_SET_MS: u64 = 10_000;

#[cfg(test)]
mod tests {
    use stanag_msgs::TimeStamp;

    use super::*;

    fn forward(stamp: u64, per_cent: i8) -> UaStickCommand {
        UaStickCommand {
            time_stamp: Some(TimeStamp(stamp)),
            longitudinal_stick: Some(per_cent),
            ..UaStickCommand::default()
        }
    }

    fn x(due: Due) -> Option<i16> {
        match due {
            Due::Send(m) => Some(m.x),
            _ => None,
        }
    }

    #[test]
    fn each_is_sent_as_it_comes_and_no_more_often_than_the_link_bears() {
        let ms = Duration::from_millis;
        let mut sticks = Sticks::default();
        sticks.take(ms(0), &forward(1, 1)).unwrap();
        sticks.engage(ms(0), false);
        let mut sent = Vec::new();
        for now in 0..1_000 {
            // 50 a second, each up to 4 ms early or late; then 500 a second.
            let jitter = [0, 4, 1, 3][now as usize / 20 % 4];
            if now < 500 && now % 20 == jitter || now >= 500 && now % 2 == 0 {
                sticks
                    .take(ms(now), &forward(now + 2, (now % 100) as i8))
                    .unwrap();
                if now < 500 {
                    let due = sticks.advance(ms(now), (Some(Px4Mode::POSCTL), true), 1);
                    assert_eq!(x(due), Some((now % 100) as i16 * 10), "at {now} ms");
                    sent.push(now);
                }
            }
            let due = sticks.advance(ms(now), (Some(Px4Mode::POSCTL), true), 1);
            sent.extend(x(due).map(|_| now));
        }
        assert!(
            sent.windows(2).all(|pair| pair[1] - pair[0] >= 15),
            "{sent:?}"
        );
        assert!(sent.len() <= 25 + 34, "{}", sent.len());
    }

    #[test]
    fn the_stream_is_at_least_20_hertz_while_sticks_come_and_ends_with_them() {
        let ms = Duration::from_millis;
        let mut sticks = Sticks::default();
        assert_eq!(
            sticks.advance(ms(0), (Some(Px4Mode::POSCTL), true), 1),
            Due::None
        );
        sticks.take(ms(0), &forward(1, 50)).unwrap();
        sticks.engage(ms(0), false);
        let (mut sent, mut stopped) = (0, 0);
        for now in 0..2_000 {
            if now < 1_000 && now % 100 == 0 {
                sticks.take(ms(now), &forward(now + 1, 50)).unwrap();
            }
            match sticks.advance(ms(now), (Some(Px4Mode::POSCTL), true), 1) {
                Due::Stopped => stopped += 1,
                due => sent += u32::from(x(due) == Some(500)),
            }
        }
        // Each of the ten, and after each another one every 40 ms, for 0.3 s after the last.
        assert!((36..=38).contains(&sent), "{sent}");
        assert_eq!(stopped, 1);
    }

    #[test]
    fn an_overtaken_stick_changes_nothing_and_a_wild_one_is_refused() {
        let mut sticks = Sticks::default();
        sticks.take(Duration::ZERO, &forward(500, 20)).unwrap();
        sticks.take(Duration::ZERO, &forward(400, -80)).unwrap();
        sticks.engage(Duration::ZERO, false);
        assert_eq!(
            x(sticks.advance(Duration::ZERO, (None, true), 1)),
            Some(200)
        );
        assert!(sticks.take(Duration::ZERO, &forward(600, 101)).is_err());
    }

    /// As ManualControl::processStickArming judges it, compiled with -freciprocal-math.
    fn is_gesture(m: &MANUAL_CONTROL_DATA) -> bool {
        let (throttle, yaw) = (f32::from(m.z) * 0.001 * 2.0 - 1.0, f32::from(m.r) * 0.001);
        throttle < -0.8 && yaw.abs() > 0.9
    }

    #[test]
    fn no_stick_makes_a_gesture_that_arms_or_stops_motors() {
        let ms = Duration::from_millis;
        assert!(is_gesture(&message([0, 0, 0, 900], 1)));
        for throttle in 0..=100 {
            for rudder in -100..=100 {
                let at = |rudder| UaStickCommand {
                    throttle_stick_engine_1: Some(throttle),
                    rotational_stick_rudder: Some(rudder),
                    ..UaStickCommand::default()
                };
                let sent = message(axes(&at(rudder)), 1);
                assert_eq!(sent.z, i16::from(throttle) * 10);
                let as_it_is = i16::from(rudder) * 10;
                let expected = if throttle < 15 {
                    as_it_is.clamp(-850, 850)
                } else {
                    as_it_is
                };
                assert_eq!(sent.r, expected, "{throttle}");
                assert!(!is_gesture(&sent), "{throttle} {rudder}");

                // Nor do the last once more, which are a step back of what was sent.
                let mut sticks = Sticks::default();
                sticks.engage(ms(0), false);
                for (now, rudder) in [(0, 0), (20, rudder)] {
                    sticks.take(ms(now), &at(rudder)).unwrap();
                    sticks.advance(ms(now), (Some(Px4Mode::POSCTL), true), 1);
                }
                let still = sticks.stand_still(ms(40), 1).expect("sticks");
                assert_eq!(still.r, expected - expected.signum(), "{throttle}");
                assert!(!is_gesture(&still), "{throttle} {rudder}");
            }
        }
    }

    #[test]
    fn the_last_sticks_step_back_once_as_another_mode_is_entered() {
        let ms = Duration::from_millis;
        let by_hand = (Some(Px4Mode::POSCTL), true);
        let mut sticks = Sticks::default();
        sticks.engage(ms(0), false);
        assert_eq!(sticks.stand_still(ms(0), 1), None, "none were sent");
        // Let go, and for the last samples held.
        for (at, per_cent) in [(0, 100), (20, 50), (40, -100), (60, -100)] {
            sticks.take(ms(at), &forward(at + 1, per_cent)).unwrap();
            assert_eq!(
                x(sticks.advance(ms(at), by_hand, 1)),
                Some(i16::from(per_cent) * 10)
            );
        }
        assert!(!sticks.are_apart(ms(74)) && sticks.are_apart(ms(75)));
        let still = sticks.stand_still(ms(80), 1).expect("sticks");
        assert_eq!([still.x, still.y, still.z, still.r], [-999, 0, 500, 0]);
        assert_eq!(still.target, 1);
        assert_eq!(sticks.stand_still(ms(120), 1), None, "once");
        // The mode was refused, and later they stop: PX4 misses them from then on.
        sticks.take(ms(120), &forward(121, 30)).unwrap();
        assert_eq!(x(sticks.advance(ms(120), by_hand, 1)), Some(300));
        assert_eq!(sticks.advance(ms(120) + FRESH, by_hand, 1), Due::Stopped);
        sticks.take(ms(500), &forward(501, 30)).unwrap();
        assert_eq!(sticks.stand_still(ms(500), 1), None);
    }

    #[test]
    fn centred_ones_are_sent_while_a_failsafe_has_the_vehicle_and_move_no_three_times_one_way() {
        let ms = Duration::from_millis;
        let (by_hand, held) = ((Some(Px4Mode::POSCTL), true), (Some(Px4Mode::LOITER), true));
        // Pushed, let go, and held.
        for moved in [[0, 30, 60, 90], [90, 60, 30, 10], [60, 60, 60, 60]] {
            let mut sticks = Sticks::default();
            sticks.engage(ms(0), false);
            let mut sent: Vec<i16> = Vec::new();
            for (at, per_cent) in (0..).step_by(20).zip(moved) {
                sticks.take(ms(at), &forward(at + 1, per_cent)).unwrap();
                sent.extend(x(sticks.advance(ms(at), by_hand, 1)));
            }
            assert!(sticks.stand_aside(ms(70), true) && sticks.are_aside());
            assert!(!sticks.stand_aside(ms(71), true), "once");
            let held_from = sent.len();
            for at in (80..1_000).step_by(20) {
                sticks.take(ms(at), &forward(at + 1, -80)).unwrap();
                sent.extend(x(sticks.advance(ms(at), held, 1)));
            }
            assert!(sent.len() > held_from + 25, "{sent:?}");
            assert_eq!(sent[held_from + 1], 0, "{sent:?}");
            assert!(sent[held_from + 1..].iter().all(|x| *x == 0), "{sent:?}");
            let steps = sent.windows(2).map(|pair| (pair[1] - pair[0]).signum());
            let steps: Vec<_> = steps.skip(held_from - 1).filter(|way| *way != 0).collect();
            let last = moved[3] - moved[2];
            let one_way = steps.iter().filter(|way| **way == -1).count();
            assert!(one_way <= 2, "{sent:?}");
            // The first one breaks off the movement that it came in.
            assert!(
                last == 0 || steps[0] == -i16::from(last).signum(),
                "{sent:?}"
            );
            // They end with those that arrive.
            assert!(!sticks.stand_aside(ms(1_000), true) && sticks.are_aside());
            assert_eq!(sticks.advance(ms(1_500), held, 1), Due::Stopped);
            assert_eq!(sticks.advance(ms(1_501), held, 1), Due::None);
        }
    }

    #[test]
    fn the_sticks_of_another_controller_count_whatever_its_clock() {
        let ms = Duration::from_millis;
        let mut sticks = Sticks::default();
        sticks.take(ms(0), &forward(5_000, 20)).unwrap();
        sticks.engage(ms(0), false);
        assert_eq!(
            x(sticks.advance(ms(0), (Some(Px4Mode::POSCTL), true), 1)),
            Some(200)
        );
        sticks.forget();
        assert_eq!(
            sticks.advance(ms(40), (Some(Px4Mode::POSCTL), true), 1),
            Due::Stopped
        );
        sticks.take(ms(80), &forward(4_000, -30)).unwrap();
        assert_eq!(
            x(sticks.advance(ms(80), (Some(Px4Mode::POSCTL), true), 1)),
            Some(-300)
        );
    }
}
