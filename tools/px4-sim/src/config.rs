//! What a simulated vehicle is told before it boots.

use super::geo::Geodetic;
use super::params::Param;

/// Kind of airframe.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Airframe {
    /// Quadrotor: hovers, turns on the spot (HEARTBEAT.type 2).
    Quad,
    /// Fixed wing: no hover, a loiter is an orbit (HEARTBEAT.type 1).
    Plane,
}

/// Settings of one simulated vehicle. The same settings and the same calls give the same flight,
/// to the last bit.
#[derive(Debug, Clone, PartialEq)]
pub struct Config {
    /// MAVLink system id, 1 to 255.
    pub system_id: u8,
    /// Where it stands at boot; altitude AMSL.
    pub home: Geodetic,
    /// Airframe.
    pub airframe: Airframe,
    /// Seed of every noise in this vehicle.
    pub seed: u64,
    /// Height of the geoid above the WGS-84 ellipsoid at home, metres; GPS_RAW_INT.alt_ellipsoid
    /// is AMSL plus this. (PX4's built-in simulator reports zero; a receiver does not.)
    pub geoid_separation_m: f64,
    /// Steady wind, metres a second, the direction that the air moves to: north, east.
    pub wind_ne_ms: [f64; 2],
    /// Heading at boot, radians clockwise from true north.
    pub heading_rad: f64,
    /// Magnetic declination, radians, east positive. The vehicle's headings are true.
    pub declination_rad: f64,
    /// Wall clock at boot, microseconds since 1970, as a GPS receiver would give it;
    /// zero where it is not known. Only SYSTEM_TIME shows it.
    pub unix_time_us: u64,
    /// Parameters that differ from the defaults at boot.
    pub params: Vec<(Param, f64)>,
    /// Speaks operator control (REQUEST_OPERATOR_CONTROL, CONTROL_STATUS), as PX4 v1.18 does not.
    pub operator_control: bool,
}

impl Default for Config {
    fn default() -> Self {
        Self {
            system_id: 1,
            home: Geodetic {
                latitude_deg: 47.397_743_4,
                longitude_deg: 8.545_593_9,
                altitude_m: 488.0,
            },
            airframe: Airframe::Quad,
            seed: 1,
            geoid_separation_m: 47.4,
            wind_ne_ms: [0.0; 2],
            heading_rad: 0.0,
            declination_rad: 3.41_f64.to_radians(),
            unix_time_us: 0,
            params: Vec::new(),
            operator_control: false,
        }
    }
}
