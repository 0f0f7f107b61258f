//! Which messages go out unrequested, and how often.
//!
//! The default rates are those of PX4's ground station link in its simulator, where px4-rc.mavlink raises seven streams
//! to 50 Hz; on a real board they are 5 to 15 Hz.

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

/// Message ids of the streams.
pub(crate) mod id {
    #![allow(missing_docs, reason = "each has the name of its message")]
    pub(crate) const HEARTBEAT: u32 = 0;
    pub(crate) const SYS_STATUS: u32 = 1;
    pub(crate) const SYSTEM_TIME: u32 = 2;
    pub(crate) const GPS_RAW_INT: u32 = 24;
    pub(crate) const ATTITUDE: u32 = 30;
    pub(crate) const ATTITUDE_QUATERNION: u32 = 31;
    pub(crate) const LOCAL_POSITION_NED: u32 = 32;
    pub(crate) const GLOBAL_POSITION_INT: u32 = 33;
    pub(crate) const SERVO_OUTPUT_RAW: u32 = 36;
    pub(crate) const MISSION_CURRENT: u32 = 42;
    pub(crate) const GPS_GLOBAL_ORIGIN: u32 = 49;
    pub(crate) const VFR_HUD: u32 = 74;
    pub(crate) const ATTITUDE_TARGET: u32 = 83;
    pub(crate) const POSITION_TARGET_LOCAL_NED: u32 = 85;
    pub(crate) const POSITION_TARGET_GLOBAL_INT: u32 = 87;
    pub(crate) const ALTITUDE: u32 = 141;
    pub(crate) const BATTERY_STATUS: u32 = 147;
    pub(crate) const AUTOPILOT_VERSION: u32 = 148;
    pub(crate) const ESTIMATOR_STATUS: u32 = 230;
    pub(crate) const WIND_COV: u32 = 231;
    pub(crate) const VIBRATION: u32 = 241;
    pub(crate) const HOME_POSITION: u32 = 242;
    pub(crate) const MESSAGE_INTERVAL: u32 = 244;
    pub(crate) const EXTENDED_SYS_STATE: u32 = 245;
    pub(crate) const PROTOCOL_VERSION: u32 = 300;
    pub(crate) const ORBIT_EXECUTION_STATUS: u32 = 360;
    pub(crate) const AVAILABLE_MODES: u32 = 435;
    pub(crate) const CURRENT_MODE: u32 = 436;
}

/// Message, default interval in microseconds; negative is off.
const DEFAULTS: &[(u32, i32)] = &[
    (id::HEARTBEAT, 1_000_000),
    (id::SYS_STATUS, 1_000_000),
    (id::SYSTEM_TIME, -1),
    (id::GPS_RAW_INT, 200_000),
    (id::ATTITUDE, 20_000),
    (id::ATTITUDE_QUATERNION, 20_000),
    (id::LOCAL_POSITION_NED, 20_000),
    (id::GLOBAL_POSITION_INT, 20_000),
    (id::SERVO_OUTPUT_RAW, 20_000),
    (id::MISSION_CURRENT, 1_000_000),
    (id::GPS_GLOBAL_ORIGIN, -1),
    (id::VFR_HUD, 250_000),
    (id::ATTITUDE_TARGET, 20_000),
    (id::POSITION_TARGET_LOCAL_NED, 20_000),
    (id::POSITION_TARGET_GLOBAL_INT, 1_000_000),
    (id::ALTITUDE, 1_000_000),
    (id::BATTERY_STATUS, 2_000_000),
    (id::ESTIMATOR_STATUS, 2_000_000),
    (id::WIND_COV, 2_000_000),
    (id::VIBRATION, 10_000_000),
    (id::HOME_POSITION, 2_000_000),
    (id::EXTENDED_SYS_STATE, 1_000_000),
    (id::ORBIT_EXECUTION_STATUS, 500_000),
    (id::CURRENT_MODE, 2_000_000),
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
                // Keep the phase, unless more than a period was missed: a burst of overdue messages helps nobody.
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
                    n += u32::from(id == id::ATTITUDE)
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
