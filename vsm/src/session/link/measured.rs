//! When the vehicle's values were measured, by this computer's monotonic clock: the source of the Time Stamps in reports.
//!
//! The vehicle stamps its messages with its own clock (time_boot_ms, time_usec), which TIMESYNC compares with ours. If that
//! offset is unknown or implausible, the time of arrival is used.

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

    /// The vehicle is received again: values from before its silence are soon reported again, or forgotten.
    pub(super) fn begin_again(&mut self, now: Duration) {
        for at in self.arrived.iter_mut().flatten() {
            *at = now;
        }
    }

    /// Records the time of a message that has just arrived.
    pub(super) fn note(&mut self, now: Duration, clock: &mut Client, message: &MavMessage) {
        match message {
            // Arrives with the speed.
            MavMessage::GLOBAL_POSITION_INT(_) => {
                (self.arrived[0], self.arrived[1]) = (Some(now), Some(now));
                self.had_position = true;
            }
            MavMessage::LOCAL_POSITION_NED(_) => self.arrived[1] = Some(now),
            MavMessage::ATTITUDE(_) => self.arrived[2] = Some(now),
            _ => {}
        }
        let (slot, at) = match message {
            MavMessage::GLOBAL_POSITION_INT(m) => {
                (&mut self.position, BootTime::Ms(m.time_boot_ms))
            }
            MavMessage::LOCAL_POSITION_NED(m) => (&mut self.velocity, BootTime::Ms(m.time_boot_ms)),
            MavMessage::ATTITUDE(m) => (&mut self.attitude, BootTime::Ms(m.time_boot_ms)),
            MavMessage::HIGHRES_IMU(m) => (&mut self.force, BootTime::Us(m.time_usec)),
            MavMessage::WIND_COV(m) => (&mut self.wind, BootTime::Us(m.time_usec)),
            _ => return,
        };
        *slot = Some(clock.measured(now, at).unwrap_or(now));
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
            INERTIAL_STATES | WAYPOINT_STATES | AIR_AND_GROUND => place(),
            BODY_SENSED => self.force.or(self.attitude),
            WEATHER => self.wind,
            _ => return None,
        };
        Some(at.unwrap_or(now))
    }
}

/// Each is requested at 5 Hz. This is longer than the time until a vehicle counts as silent, which is another alert.
const STALE: Duration = Duration::from_secs(5);
const AIR_AND_GROUND: u16 = 3009;
const BODY_SENSED: u16 = 3010;
const WEATHER: u16 = 18_300;
const INERTIAL_STATES: u16 = 4000;
const WAYPOINT_STATES: u16 = 4001;
