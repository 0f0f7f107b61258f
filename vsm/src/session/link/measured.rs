//! When the vehicle's values were measured, by this computer's monotonic clock: the source of the Time Stamps in reports.
//!
//! The vehicle stamps its messages with its own clock (time_boot_ms, time_usec), which TIMESYNC compares with ours. If that
//! offset is unknown or implausible, the time of arrival is used. Not so after the bridge itself did not run: what it reads then may
//! have waited in the socket. For [`CATCHES_UP`] only what the vehicle's clock dates is taken.

use std::time::Duration;

use mapping::telemetry::Telemetry;
use mavlink_link::dialect::MavMessage;
use mavlink_link::service::timesync::{BootTime, Client};

/// The measurement times of the latest messages.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub(crate) struct Measured {
    /// GLOBAL_POSITION_INT.
    position: Option<Duration>,
    /// LOCAL_POSITION_NED.
    velocity: Option<Duration>,
    /// ATTITUDE.
    attitude: Option<Duration>,
    /// HIGHRES_IMU.
    force: Option<Duration>,
    /// WIND_COV.
    wind: Option<Duration>,
    /// When position, speed and attitude last arrived.
    arrived: [Option<Duration>; 3],
    had_position: bool,
    /// From when until when the bridge last did not run.
    stopped: Option<(Duration, Duration)>,
    /// A message that was made after that has arrived: what follows it has not waited.
    caught_up: bool,
}

impl Measured {
    /// Forgets position, speed and attitude, each once it has not been reported for [`STALE`]: a vehicle that keeps flying
    /// is not at its last reported position. Returns true if a value was forgotten.
    pub(super) fn forget_stale(&mut self, now: Duration, shown: &mut Telemetry) -> bool {
        let is_over = |at: &mut Option<Duration>| at.take_if(|at| *at + STALE <= now).is_some();
        let [position, velocity, attitude] = self.arrived.each_mut().map(is_over);
        if position {
            (self.position, shown.position, shown.above_home_m) = (None, None, None);
        }
        if velocity {
            (self.velocity, shown.velocity_ned) = (None, None);
        }
        if attitude {
            (self.attitude, shown.attitude) = (None, None);
        }
        position || velocity || attitude
    }

    /// Whether a position was ever reported.
    pub(super) fn had_position(&self) -> bool {
        self.had_position
    }

    /// When the reported position was measured.
    pub(crate) fn position(&self) -> Option<Duration> {
        self.position
    }

    /// The vehicle is received again: what is [`STALE`] by now is forgotten, as it would have been meanwhile. That is no loss of
    /// it: that counts from now on.
    pub(super) fn begin_again(&mut self, now: Duration, shown: &mut Telemetry) {
        let arrived = self.arrived;
        self.forget_stale(now, shown);
        self.arrived = arrived.map(|at| at.map(|_| now));
    }

    /// The vehicle has restarted: nothing is known of it.
    pub(super) fn restart(&mut self) {
        *self = Measured {
            stopped: self.stopped,
            caught_up: self.caught_up,
            ..Measured::default()
        };
    }

    /// The bridge did not run in between: what it reads next may have waited.
    pub(super) fn note_unread(&mut self, from: Duration, until: Duration) {
        // What waited during the stop before may not be through yet.
        let before = self.stopped.filter(|(_, end)| *end + CATCHES_UP >= from);
        self.stopped = Some((before.map_or(from, |(began, _)| began), until));
        self.caught_up = false;
    }

    /// How much longer than it lasts a stop that begins now delays what waits for the vehicle: what it reads first may have waited.
    /// Nothing where it follows another one closely, as on an overloaded computer: the wait would never end.
    pub(super) fn reads_late_by(&self, now: Duration) -> Duration {
        match self.stopped {
            Some((_, until)) if until + OFTEN > now => Duration::ZERO,
            _ => CATCHES_UP,
        }
    }

    /// Whether a message that is handled now may have waited while the bridge did not run.
    pub(super) fn may_have_waited(&self, now: Duration) -> bool {
        !self.caught_up && self.waited_since(now).is_some()
    }

    /// Since when a message may have waited that is handled now; `None` where none has.
    fn waited_since(&self, now: Duration) -> Option<Duration> {
        let (from, until) = self.stopped?;
        (now <= until + CATCHES_UP).then_some(from)
    }

    /// Whether the values of this message can be shown: not where it may have waited, and nothing shows for how long.
    pub(super) fn takes(&self, now: Duration, clock: &Client, message: &MavMessage) -> bool {
        let Some(from) = self.waited_since(now) else {
            return true;
        };
        boot_time(message).is_none_or(|at| clock.measured_waiting(now, at, from).is_some())
    }

    /// Records the time of a message that has just arrived.
    pub(super) fn note(&mut self, now: Duration, clock: &mut Client, message: &MavMessage) {
        let Some(boot) = boot_time(message) else {
            return;
        };
        let at = match self.waited_since(now) {
            Some(from) => clock.measured_waiting(now, boot, from),
            None => Some(clock.measured(now, boot).unwrap_or(now)),
        };
        if at.is_none() {
            return;
        }
        self.caught_up |= self.stopped.is_none_or(|(_, until)| at >= Some(until));
        match message {
            // Arrives with the speed.
            MavMessage::GLOBAL_POSITION_INT(_) => {
                (self.arrived[0], self.arrived[1]) = (Some(now), Some(now));
                (self.position, self.had_position) = (at, true);
            }
            MavMessage::LOCAL_POSITION_NED(_) => {
                (self.arrived[1], self.velocity) = (Some(now), at);
            }
            MavMessage::ATTITUDE(_) => (self.arrived[2], self.attitude) = (Some(now), at),
            MavMessage::HIGHRES_IMU(_) => self.force = at,
            MavMessage::WIND_COV(_) => self.wind = at,
            _ => {}
        }
    }

    /// The measurement time for a report composed now; `None` if the report contains no measurements.
    ///
    /// A report may combine several messages of the vehicle but has one Time Stamp: that of the position, if it has one,
    /// since a position ages fastest.
    pub(crate) fn of(&self, message: u16, now: Duration, vehicle: &Telemetry) -> Option<Duration> {
        // As in the report, which leaves it out.
        let position = self.position.filter(|_| vehicle.gps_fix != Some(false));
        let place = || position.or(self.attitude).or(self.velocity);
        let at = match message {
            // 21101 also without an image centre: of two payload stations one may show it and one a direction alone, and the stamps
            // of both are one series.
            INERTIAL_STATES | WAYPOINT_STATES | AIR_AND_GROUND | RELATIVE_LOCATION
            | EO_IR_LASER_STATE => place(),
            BODY_SENSED => self.force.or(self.attitude),
            WEATHER => self.wind,
            _ => return None,
        };
        Some(at.unwrap_or(now))
    }
}

/// When a message of measurements was made, by the vehicle's clock.
fn boot_time(message: &MavMessage) -> Option<BootTime> {
    match message {
        MavMessage::GLOBAL_POSITION_INT(m) => Some(BootTime::Ms(m.time_boot_ms)),
        MavMessage::LOCAL_POSITION_NED(m) => Some(BootTime::Ms(m.time_boot_ms)),
        MavMessage::ATTITUDE(m) => Some(BootTime::Ms(m.time_boot_ms)),
        MavMessage::HIGHRES_IMU(m) => Some(BootTime::Us(m.time_usec)),
        MavMessage::WIND_COV(m) => Some(BootTime::Us(m.time_usec)),
        _ => None,
    }
}

/// How long after a stop the bridge may still read what waited: a socket's buffer takes it a fraction of that.
pub(super) const CATCHES_UP: Duration = Duration::from_secs(2);
/// A stop within this time after another one is one of many.
const OFTEN: Duration = Duration::from_secs(30);
/// Each is requested at 5 Hz. This is longer than the time until a vehicle counts as silent, which is another alert.
const STALE: Duration = Duration::from_secs(5);
const AIR_AND_GROUND: u16 = 3009;
const BODY_SENSED: u16 = 3010;
const RELATIVE_LOCATION: u16 = 3016;
const WEATHER: u16 = 18_300;
const INERTIAL_STATES: u16 = 4000;
const WAYPOINT_STATES: u16 = 4001;
const EO_IR_LASER_STATE: u16 = 21_101;

#[cfg(test)]
mod tests {
    use mapping::telemetry::Place;

    use super::*;

    fn seconds(s: u64) -> Duration {
        Duration::from_secs(s)
    }

    /// A vehicle whose position arrived at 100 s.
    fn shown() -> (Measured, Telemetry) {
        let arrived = Measured {
            position: Some(seconds(100)),
            arrived: [Some(seconds(100)), None, None],
            had_position: true,
            ..Measured::default()
        };
        let telemetry = Telemetry {
            position: Some(Place {
                latitude: 47.0,
                longitude: 8.0,
                amsl_m: 400.0,
            }),
            ..Telemetry::default()
        };
        (arrived, telemetry)
    }

    /// A computer that does not run this process for 1.2 s of every 3 s.
    #[test]
    fn what_is_waited_for_ends_where_stops_follow_one_another() {
        let mut measured = Measured::default();
        let (pause, begin) = (Duration::from_millis(1_200), seconds(100));
        let (mut now, mut deadline) = (begin, begin + seconds(6));
        while now < deadline {
            now += seconds(3) - pause;
            deadline += measured.reads_late_by(now) + pause;
            measured.note_unread(now, now + pause);
            now += pause;
            assert!(now < begin + seconds(20), "it does not end");
        }
        assert_eq!(measured.reads_late_by(now + OFTEN), CATCHES_UP);
    }

    #[test]
    fn a_position_of_before_a_long_stop_is_no_longer_shown_and_is_not_called_lost_at_once() {
        for (stopped_s, stays) in [(3, true), (13, false)] {
            let (mut measured, mut telemetry) = shown();
            let until = seconds(100 + stopped_s);
            measured.note_unread(seconds(100), until);
            measured.begin_again(until, &mut telemetry);
            assert_eq!(telemetry.position.is_some(), stays, "{stopped_s} s");
            assert_eq!(measured.position().is_some(), stays, "{stopped_s} s");
            let soon = until + seconds(4);
            assert!(!measured.forget_stale(soon, &mut telemetry));
            assert!(measured.forget_stale(until + STALE, &mut telemetry));
            assert_eq!(telemetry.position, None);
        }
    }

    #[test]
    fn a_position_of_before_a_silence_is_not_shown_when_the_vehicle_is_back() {
        for (silent_s, stays) in [(4, true), (60, false)] {
            let (mut measured, mut telemetry) = shown();
            measured.begin_again(seconds(100 + silent_s), &mut telemetry);
            assert_eq!(telemetry.position.is_some(), stays, "{silent_s} s");
        }
    }
}
