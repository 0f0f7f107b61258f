//! A position and motion as 4000 reports it, and distances on the ground.

use std::time::Duration;

use crate::wire::Seen;

/// Metres for each radian of latitude, on a sphere: exact enough for the few hundred metres that a rule flies.
pub const EARTH_M: f64 = 6_371_000.0;

/// Position and motion of one 4000.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Fix {
    /// Time of the run.
    pub at: Duration,
    /// Radians, north positive.
    pub latitude: f64,
    /// Radians, east positive.
    pub longitude: f64,
    /// Metres, in the datum that `altitude_type` names.
    pub altitude: f64,
    /// Altitude Type.
    pub altitude_type: i64,
    /// Toward north, m/s.
    pub north: f64,
    /// Toward east, m/s.
    pub east: f64,
    /// Down, m/s.
    pub down: f64,
    /// Radians from true north.
    pub heading: Option<f64>,
}

impl Fix {
    /// The fix of a 4000, where it has a position.
    #[must_use]
    pub fn of(seen: &Seen) -> Option<Self> {
        Some(Self {
            at: seen.at,
            latitude: seen.value("Latitude")?,
            longitude: seen.value("Longitude")?,
            altitude: seen.value("Altitude")?,
            altitude_type: seen.raw("Altitude Type").unwrap_or(3),
            north: seen.value("U_Speed").unwrap_or_default(),
            east: seen.value("V_Speed").unwrap_or_default(),
            down: seen.value("W_Speed").unwrap_or_default(),
            heading: seen.value("Heading"),
        })
    }

    /// The fix of a 4000 with a position and all three speeds: one that is absent is not known, and not 0.
    #[must_use]
    pub fn with_speeds(seen: &Seen) -> Option<Self> {
        let speeds = ["U_Speed", "V_Speed", "W_Speed"];
        Self::of(seen).filter(|_| speeds.into_iter().all(|name| seen.has(name)))
    }

    /// Metres north and east of another place.
    #[must_use]
    pub fn from(&self, latitude: f64, longitude: f64) -> (f64, f64) {
        let east = wrapped(self.longitude - longitude) * latitude.cos() * EARTH_M;
        ((self.latitude - latitude) * EARTH_M, east)
    }

    /// Metres over the ground to another place.
    #[must_use]
    pub fn distance(&self, latitude: f64, longitude: f64) -> f64 {
        let (north, east) = self.from(latitude, longitude);
        north.hypot(east)
    }

    /// Latitude and longitude, in radians, of the place this many metres north and east.
    #[must_use]
    pub fn offset(&self, north: f64, east: f64) -> (f64, f64) {
        (
            self.latitude + north / EARTH_M,
            self.longitude + east / EARTH_M / self.latitude.cos(),
        )
    }
}

/// An angle in radians, wrapped to -pi to pi.
#[must_use]
pub fn wrapped(angle: f64) -> f64 {
    use std::f64::consts::{PI, TAU};
    (angle + PI).rem_euclid(TAU) - PI
}
