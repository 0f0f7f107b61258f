//! What a vehicle's sensors have told beyond [`crate::telemetry`]: the source of 3009, 3010, 12101 and 16001.

use mavlink_link::dialect::MavMessage;

/// The battery (BATTERY_STATUS of id 0, SYS_STATUS where that has not come).
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Battery {
    /// Volts: the cells added.
    pub volts: Option<f64>,
    /// Amperes out of it.
    pub amperes: Option<f64>,
    /// Kelvin.
    pub kelvin: Option<f64>,
}

/// SYS_STATUS: which sensors are used, and which of these are well.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Health {
    /// onboard_control_sensors_enabled.
    pub enabled: u32,
    /// onboard_control_sensors_health.
    pub healthy: u32,
}

impl Health {
    /// Whether one of these sensors is used and not well.
    #[must_use]
    pub fn fails(self, sensors: u32) -> bool {
        self.enabled & !self.healthy & sensors != 0
    }
}

/// The latest values.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Sensed {
    /// Velocity of the air over ground: north, east, m/s (WIND_COV.wind_x, wind_y).
    pub wind_ne: Option<[f64; 2]>,
    /// Specific force in the body's axes: forward, right, down, m/s^2 (HIGHRES_IMU). At rest -9.81 down.
    pub acceleration: Option<[f64; 3]>,
    /// The battery.
    pub battery: Battery,
    /// SYS_STATUS.
    pub health: Option<Health>,
    /// ESTIMATOR_STATUS.flags.
    pub estimator: Option<u16>,
}

impl Sensed {
    /// Takes in one message. True where it held something that is kept here.
    pub(crate) fn update(&mut self, message: &MavMessage) -> bool {
        match message {
            MavMessage::WIND_COV(m) => {
                let wind = [m.wind_x, m.wind_y].map(f64::from);
                self.wind_ne = wind.iter().all(|v| v.is_finite()).then_some(wind);
            }
            MavMessage::HIGHRES_IMU(m) => {
                let force = [m.xacc, m.yacc, m.zacc].map(f64::from);
                self.acceleration = force.iter().all(|v| v.is_finite()).then_some(force);
            }
            MavMessage::BATTERY_STATUS(m) if m.id == 0 => {
                let cells = m.voltages.iter().filter(|cell| **cell != u16::MAX);
                let millivolts: u32 = cells.map(|cell| u32::from(*cell)).sum();
                self.battery = Battery {
                    volts: (millivolts > 0).then(|| f64::from(millivolts) / 1e3),
                    amperes: (m.current_battery >= 0).then(|| f64::from(m.current_battery) / 1e2),
                    kelvin: (m.temperature != i16::MAX)
                        .then(|| f64::from(m.temperature) / 1e2 + 273.15),
                };
            }
            MavMessage::SYS_STATUS(m) => {
                self.health = Some(Health {
                    enabled: m.onboard_control_sensors_enabled.bits(),
                    healthy: m.onboard_control_sensors_health.bits(),
                });
                if m.voltage_battery != u16::MAX && m.voltage_battery > 0 {
                    let volts = f64::from(m.voltage_battery) / 1e3;
                    self.battery.volts = self.battery.volts.or(Some(volts));
                }
            }
            MavMessage::ESTIMATOR_STATUS(m) => self.estimator = Some(m.flags.bits()),
            _ => return false,
        }
        true
    }
}
