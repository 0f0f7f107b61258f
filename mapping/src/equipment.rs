//! What a vehicle has reported of its equipment: receivers, electrical buses, motors, the air around it, its radio.
//!
//! Latest values in SI units, each for [`FRESH`]: a source that has fallen silent is absent ([`Equipment::forget`]); [`equipment_reports`](crate::equipment_reports) makes the messages of the DLI of them.

use core::time::Duration;

use mavlink_link::dialect::{GpsFixType, HighresImuUpdatedFlags, MavMessage};

/// How long a value counts: PX4 sends each of them every 2 s at least, of which a radio may lose several.
pub const FRESH: Duration = Duration::from_secs(10);

/// A satellite receiver (GPS_RAW_INT).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Gps {
    /// GPS_RAW_INT.fix_type, as a number: 3 is a 3-D fix.
    pub fix: u8,
    /// Satellites in use.
    pub satellites: Option<u8>,
    /// Horizontal dilution of precision.
    pub hdop: Option<f64>,
    /// Vertical dilution of precision.
    pub vdop: Option<f64>,
    /// UTC, ms since 1970, as the receiver has it. PX4 sends its time since boot instead while it has none.
    pub utc_ms: Option<u64>,
}

/// An electrical bus (BATTERY_STATUS, GENERATOR_STATUS).
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Bus {
    /// Volts.
    pub volts: Option<f64>,
    /// Amperes drawn from it.
    pub amperes: Option<f64>,
    /// Until the battery is empty, s.
    pub remaining_s: Option<u32>,
}

/// A combustion engine (EFI_STATUS).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Combustion {
    /// Revolutions a minute.
    pub rpm: Option<f64>,
    /// How far its throttle is open, per cent.
    pub throttle: Option<f64>,
}

/// The air outside (HIGHRES_IMU, else SCALED_PRESSURE).
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Air {
    /// Kelvin.
    pub kelvin: Option<f64>,
    /// The same at the barometer, which is warmer.
    pub barometer_kelvin: Option<f64>,
}

/// A radio (RADIO_STATUS), in the units of SiK radios: half decibels.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Radio {
    /// Signal at the radio that reports; `None` where unknown.
    pub signal: Option<u8>,
    /// Noise there.
    pub noise: Option<u8>,
    /// Signal at the other end.
    pub remote_signal: Option<u8>,
    /// Noise there.
    pub remote_noise: Option<u8>,
    /// How much of its send buffer is free, per cent.
    pub free: u8,
}

/// The latest values.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Equipment {
    /// The first receiver.
    pub gps: Option<Gps>,
    /// By Bus ID: batteries by their BATTERY_STATUS.id, then the generator.
    pub buses: [Option<Bus>; BUSES],
    /// Revolutions a minute by motor, from 0 (ESC_STATUS).
    pub rpm: [Option<f64>; MOTORS],
    /// The first combustion engine.
    pub combustion: Option<Combustion>,
    /// The air.
    pub air: Air,
    /// The radio.
    pub radio: Option<Radio>,
    at: Times,
}

/// When each was last reported.
#[derive(Debug, Clone, Default, PartialEq)]
struct Times {
    gps: Duration,
    buses: [Duration; BUSES],
    rpm: [Duration; MOTORS],
    combustion: Duration,
    kelvin: Duration,
    barometer_kelvin: Duration,
    radio: Duration,
}

impl Equipment {
    /// Takes in one message that arrived at `now`. True where it held something that is kept here.
    pub fn update(&mut self, now: Duration, message: &MavMessage) -> bool {
        match message {
            MavMessage::GPS_RAW_INT(m) => {
                let dilution = |hundredths: u16| {
                    (hundredths != u16::MAX).then(|| f64::from(hundredths) / 100.0)
                };
                self.at.gps = now;
                self.gps = Some(Gps {
                    fix: m.fix_type as u8,
                    satellites: (m.satellites_visible != u8::MAX).then_some(m.satellites_visible),
                    hdop: dilution(m.eph),
                    vdop: dilution(m.epv),
                    utc_ms: (m.time_usec > SINCE_BOOT_US).then_some(m.time_usec / 1_000),
                });
            }
            MavMessage::BATTERY_STATUS(m) => {
                let id = usize::from(m.id);
                let (Some(bus), true) = (self.buses.get_mut(id), m.id < BATTERIES) else {
                    return false;
                };
                self.at.buses[id] = now;
                let cells = m.voltages.iter().filter(|cell| **cell != u16::MAX);
                let millivolts: u32 = cells.map(|cell| u32::from(*cell)).sum();
                *bus = Some(Bus {
                    volts: (millivolts > 0).then(|| f64::from(millivolts) / 1e3),
                    amperes: (m.current_battery >= 0).then(|| f64::from(m.current_battery) / 1e2),
                    // An extension field, 0 where it is not known.
                    remaining_s: u32::try_from(m.time_remaining).ok().filter(|s| *s > 0),
                });
            }
            MavMessage::GENERATOR_STATUS(m) => {
                let known = |value: f32| value.is_finite().then_some(f64::from(value));
                self.at.buses[usize::from(BATTERIES)] = now;
                self.buses[usize::from(BATTERIES)] = Some(Bus {
                    volts: known(m.bus_voltage),
                    amperes: known(m.load_current),
                    remaining_s: None,
                });
            }
            MavMessage::ESC_STATUS(m) => {
                let motors = self.rpm.iter_mut().zip(&mut self.at.rpm);
                for ((motor, at), rpm) in motors.skip(usize::from(m.index)).zip(m.rpm) {
                    (*motor, *at) = (Some(f64::from(rpm)), now);
                }
            }
            MavMessage::EFI_STATUS(m) if m.ecu_index == 0.0 => {
                // Its temperatures are left out: MAVLink has degrees Celsius there, and PX4 v1.18 sends kelvins.
                let known = |value: f32| (value >= 0.0).then_some(f64::from(value));
                self.at.combustion = now;
                self.combustion = Some(Combustion {
                    rpm: known(m.rpm),
                    throttle: known(m.throttle_position).filter(|percent| *percent <= 100.0),
                });
            }
            MavMessage::HIGHRES_IMU(m) => {
                let measured = HighresImuUpdatedFlags::HIGHRES_IMU_UPDATED_TEMPERATURE;
                if m.fields_updated.contains(measured) && m.temperature.is_finite() {
                    self.at.kelvin = now;
                    self.air.kelvin = Some(f64::from(m.temperature) + FREEZING_K);
                }
            }
            MavMessage::SCALED_PRESSURE(m) => {
                // The barometer's own, some degrees above that of the air.
                self.at.barometer_kelvin = now;
                self.air.barometer_kelvin = Some(f64::from(m.temperature) / 100.0 + FREEZING_K);
            }
            MavMessage::RADIO_STATUS(m) => {
                let known = |level: u8| (level != u8::MAX).then_some(level);
                self.at.radio = now;
                self.radio = Some(Radio {
                    signal: known(m.rssi),
                    noise: known(m.noise),
                    remote_signal: known(m.remrssi),
                    remote_noise: known(m.remnoise),
                    free: m.txbuf,
                });
            }
            _ => return false,
        }
        true
    }

    /// Forgets what has not been reported for [`FRESH`].
    pub fn forget(&mut self, now: Duration) {
        fn drop_old<T>(value: &mut Option<T>, now: Duration, at: Duration) {
            value.take_if(|_| now.saturating_sub(at) >= FRESH);
        }
        let at = &self.at;
        drop_old(&mut self.gps, now, at.gps);
        for (bus, at) in self.buses.iter_mut().zip(at.buses) {
            drop_old(bus, now, at);
        }
        for (rpm, at) in self.rpm.iter_mut().zip(at.rpm) {
            drop_old(rpm, now, at);
        }
        drop_old(&mut self.combustion, now, at.combustion);
        drop_old(&mut self.air.kelvin, now, at.kelvin);
        drop_old(&mut self.air.barometer_kelvin, now, at.barometer_kelvin);
        drop_old(&mut self.radio, now, at.radio);
    }
}

impl Gps {
    /// Whether it has a position in three dimensions.
    #[must_use]
    pub fn is_fixed(self) -> bool {
        self.fix >= GpsFixType::GPS_FIX_TYPE_3D_FIX as u8
    }
}

/// BATTERY_STATUS.id of the batteries that are kept: PX4 has four.
const BATTERIES: u8 = 4;
const BUSES: usize = 5;
/// PX4's motors.
const MOTORS: usize = 12;
/// A time in us that is later than this is no time since boot: 2001 as Unix time.
const SINCE_BOOT_US: u64 = 978_307_200_000_000;
const FREEZING_K: f64 = 273.15;
