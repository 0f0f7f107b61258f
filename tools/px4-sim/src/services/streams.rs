//! Which messages go out unrequested, and how often.
//!
//! The default rates are those of PX4's ground station link in its simulator, where px4-rc.mavlink raises seven streams
//! to 50 Hz; on a real board they are 5 to 15 Hz.

use mavlink::MessageData as _;
use mavlink::dialects::development as mav;

/// A stream's default rate on PX4's ground station link in its simulator.
#[derive(Debug, Clone, Copy)]
struct Stream {
    id: u32,
    default_us: i32,
    interval_us: i32,
    due: f64,
}

/// The schedule of every stream.
#[derive(Debug, Clone)]
pub(crate) struct Streams(Vec<Stream>);

/// Message, default interval in microseconds; negative is off.
const DEFAULTS: &[(u32, i32)] = &[
    (mav::HEARTBEAT_DATA::ID, 1_000_000),
    (mav::SYS_STATUS_DATA::ID, 1_000_000),
    (mav::SYSTEM_TIME_DATA::ID, -1),
    (mav::GPS_RAW_INT_DATA::ID, 200_000),
    (mav::ATTITUDE_DATA::ID, 20_000),
    (mav::ATTITUDE_QUATERNION_DATA::ID, 20_000),
    (mav::LOCAL_POSITION_NED_DATA::ID, 20_000),
    (mav::GLOBAL_POSITION_INT_DATA::ID, 20_000),
    (mav::SERVO_OUTPUT_RAW_DATA::ID, 20_000),
    (mav::MISSION_CURRENT_DATA::ID, 1_000_000),
    (mav::GPS_GLOBAL_ORIGIN_DATA::ID, -1),
    (mav::VFR_HUD_DATA::ID, 250_000),
    (mav::ATTITUDE_TARGET_DATA::ID, 20_000),
    (mav::POSITION_TARGET_LOCAL_NED_DATA::ID, 20_000),
    (mav::POSITION_TARGET_GLOBAL_INT_DATA::ID, 1_000_000),
    (mav::ALTITUDE_DATA::ID, 1_000_000),
    (mav::BATTERY_STATUS_DATA::ID, 2_000_000),
    (mav::ESTIMATOR_STATUS_DATA::ID, 2_000_000),
    (mav::WIND_COV_DATA::ID, 2_000_000),
    (mav::VIBRATION_DATA::ID, 10_000_000),
    // PX4 sends both every second; here they are sent on request only, so that a link carries what a test is about.
    (mav::ESC_STATUS_DATA::ID, -1),
    (mav::SCALED_PRESSURE_DATA::ID, -1),
    // On a vehicle with a combustion engine.
    (mav::EFI_STATUS_DATA::ID, -1),
    (mav::HOME_POSITION_DATA::ID, 2_000_000),
    (mav::EXTENDED_SYS_STATE_DATA::ID, 1_000_000),
    (mav::ORBIT_EXECUTION_STATUS_DATA::ID, 500_000),
    (mav::CURRENT_MODE_DATA::ID, 2_000_000),
    // On a vehicle whose gimbal PX4 manages.
    (mav::GIMBAL_MANAGER_STATUS_DATA::ID, 2_000_000),
    (mav::GIMBAL_MANAGER_INFORMATION_DATA::ID, -1),
];

impl Streams {
    /// The defaults; everything is first due at `start` seconds.
    pub(crate) fn new(start: f64) -> Self {
        Self(
            DEFAULTS
                .iter()
                .map(|&(id, us)| Stream {
                    id,
                    default_us: us,
                    interval_us: us,
                    due: start,
                })
                .collect(),
        )
    }

    /// Calls `send` for every stream that is due.
    pub(crate) fn poll(&mut self, now: f64, mut send: impl FnMut(u32)) {
        for stream in &mut self.0 {
            if stream.interval_us > 0 && now >= stream.due {
                let period = f64::from(stream.interval_us) * 1e-6;
                // Keeps the phase, unless more than a period was missed: overdue messages in a burst are of no use.
                stream.due = if now - stream.due > period {
                    now + period
                } else {
                    stream.due + period
                };
                send(stream.id);
            }
        }
    }

    /// SET_MESSAGE_INTERVAL: microseconds, 0 the default, negative off. False for an unknown id.
    pub(crate) fn set(&mut self, id: i64, interval_us: f32, now: f64) -> bool {
        let Some(stream) = self.0.iter_mut().find(|s| i64::from(s.id) == id) else {
            return false;
        };
        stream.interval_us = if interval_us == 0.0 {
            stream.default_us
        } else if interval_us < 0.0 || !interval_us.is_finite() {
            -1
        } else {
            (interval_us as i32).max(1000)
        };
        stream.due = now + f64::from(stream.interval_us.max(0)) * 1e-6;
        true
    }

    /// MESSAGE_INTERVAL.interval_us; 0 for an unknown id, as PX4 answers.
    pub(crate) fn interval_us(&self, id: u32) -> i32 {
        self.0
            .iter()
            .find(|s| s.id == id)
            .map_or(0, |s| s.interval_us)
    }

    /// True for a message that can be streamed.
    pub(crate) fn knows(&self, id: u32) -> bool {
        self.0.iter().any(|s| s.id == id)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_stream_keeps_its_rate_and_can_be_changed() {
        let mut streams = Streams::new(0.0);
        let count = |streams: &mut Streams, from: u32| {
            let mut n = 0;
            for step in from..from + 2500 {
                streams.poll(f64::from(step) * 0.004, |id| {
                    n += u32::from(id == mav::ATTITUDE_DATA::ID)
                });
            }
            n
        };
        assert!((499..=501).contains(&count(&mut streams, 0)));
        assert!(streams.set(30, 500_000.0, 10.0));
        assert!((19..=21).contains(&count(&mut streams, 2500)));
        assert!(!streams.set(12345, 1.0, 0.0));
        assert_eq!(streams.interval_us(30), 500_000);
    }
}
