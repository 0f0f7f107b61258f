//! When what the vehicle shows was measured, by this computer's monotonic clock: the source of the Time Stamps of what it
//! reports of itself.
//!
//! The vehicle dates its messages by its own clock (time_boot_ms, time_usec), which TIMESYNC compares with ours. Where that is
//! not known, or cannot be believed, the time of arrival stands in.

use std::time::Duration;

use mapping::telemetry::Telemetry;
use mavlink_link::dialect::MavMessage;
use mavlink_link::service::timesync::{BootTime, Client};

/// The times of the latest messages.
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
}

impl Measured {
    /// Takes the time of a message that has just arrived.
    pub(super) fn note(&mut self, now: Duration, clock: &mut Client, message: &MavMessage) {
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

    /// When a report of now was valid; `None` of one that is not made of measurements.
    ///
    /// One stamp stands for several messages of the vehicle: that of the position, which loses its worth soonest, where the
    /// report has it.
    pub(crate) fn of(&self, message: u16, now: Duration, vehicle: &Telemetry) -> Option<Duration> {
        // As the report leaves it out.
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

const AIR_AND_GROUND: u16 = 3009;
const BODY_SENSED: u16 = 3010;
const WEATHER: u16 = 18_300;
const INERTIAL_STATES: u16 = 4000;
const WAYPOINT_STATES: u16 = 4001;
