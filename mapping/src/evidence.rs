//! What a contingency is judged by: values that name the report which they are of.
//!
//! Telemetry keeps the latest value of each kind, so that one report reads as a condition that lasts. What is flown because of
//! it must be confirmed by further reports: each value here has a number that rises with every report of it. What the vehicle
//! does not report is absent, and never a reason to fly anything.

use mavlink_link::dialect::MavMessage;

/// A value, and the number of its report.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Reading<T> {
    /// The value.
    pub value: T,
    /// Another one with every report.
    pub number: u32,
}

/// The latest reports.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Evidence {
    /// Energy left, per cent: SYS_STATUS.battery_remaining, the lowest of PX4's batteries; BATTERY_STATUS of id 0 of a vehicle whose
    /// SYS_STATUS has none.
    pub battery: Option<Reading<u8>>,
    /// The estimator has a position (ESTIMATOR_STATUS.flags).
    pub located: Option<Reading<bool>>,
    /// Degrees north and east (GLOBAL_POSITION_INT).
    pub place: Option<Reading<(f64, f64)>>,
    /// The motors are well (SYS_STATUS, of a vehicle that watches them).
    pub motors: Option<Reading<bool>>,
    /// SYS_STATUS has reported the energy left: batteries of a vehicle that has several differ.
    by_status: bool,
}

impl Evidence {
    pub(crate) fn update(&mut self, message: &MavMessage) {
        match message {
            MavMessage::SYS_STATUS(m) => {
                if let Some(percent) = percent(m.battery_remaining) {
                    self.by_status = true;
                    next(&mut self.battery, percent);
                }
                if m.onboard_control_sensors_enabled.bits() & MOTOR_OUTPUTS != 0 {
                    let healthy = m.onboard_control_sensors_health.bits();
                    next(&mut self.motors, healthy & MOTOR_OUTPUTS != 0);
                }
            }
            MavMessage::BATTERY_STATUS(m) if m.id == 0 && !self.by_status => {
                if let Some(percent) = percent(m.battery_remaining) {
                    next(&mut self.battery, percent);
                }
            }
            MavMessage::ESTIMATOR_STATUS(m) => {
                next(&mut self.located, m.flags.bits() & POSITION == POSITION);
            }
            MavMessage::GLOBAL_POSITION_INT(m) => {
                let degrees = |e7: i32| f64::from(e7) / 1e7;
                next(&mut self.place, (degrees(m.lat), degrees(m.lon)));
            }
            _ => {}
        }
    }
}

fn next<T>(reading: &mut Option<Reading<T>>, value: T) {
    let before = reading.as_ref().map_or(0, |before| before.number);
    let number = before.wrapping_add(1);
    *reading = Some(Reading { value, number });
}

pub(crate) fn percent(remaining: i8) -> Option<u8> {
    u8::try_from(remaining)
        .ok()
        .filter(|percent| *percent <= 100)
}

/// MAV_SYS_STATUS_SENSOR_MOTOR_OUTPUTS.
pub(crate) const MOTOR_OUTPUTS: u32 = 0x8000;
/// ESTIMATOR_STATUS_FLAGS: attitude, both velocities, absolute horizontal position.
pub(crate) const POSITION: u16 = 0x1 | 0x2 | 0x4 | 0x10;

#[cfg(test)]
mod tests {
    use mavlink_link::dialect::{BATTERY_STATUS_DATA, SYS_STATUS_DATA};

    use super::*;

    fn status(remaining: i8) -> MavMessage {
        MavMessage::SYS_STATUS(SYS_STATUS_DATA {
            battery_remaining: remaining,
            ..SYS_STATUS_DATA::default()
        })
    }

    fn one_battery(remaining: i8) -> MavMessage {
        MavMessage::BATTERY_STATUS(BATTERY_STATUS_DATA {
            battery_remaining: remaining,
            ..BATTERY_STATUS_DATA::default()
        })
    }

    #[test]
    fn what_is_not_reported_is_absent_and_each_report_has_its_number() {
        let mut evidence = Evidence::default();
        evidence.update(&status(-1));
        assert_eq!(evidence, Evidence::default());
        for number in 1..4 {
            evidence.update(&one_battery(40));
            assert_eq!(evidence.battery, Some(Reading { value: 40, number }));
        }
        // The lowest of several counts, once it is reported.
        evidence.update(&status(20));
        evidence.update(&one_battery(40));
        assert_eq!(evidence.battery.map(|one| one.value), Some(20));
        assert_eq!(evidence.motors, None, "not watched by the vehicle");
    }
}
