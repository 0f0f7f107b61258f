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
    /// Radians, right wing down.
    pub roll: Option<f64>,
    /// Radians, nose up.
    pub pitch: Option<f64>,
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
            roll: seen.value("Roll"),
            pitch: seen.value("Pitch"),
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

    /// The unit vector north, east and down along what looks by these angles from the vehicle's axes, in radians: right of
    /// its nose, and above its waterline. None without a heading; a tilt that is not reported is none.
    #[must_use]
    pub fn sight(&self, azimuth: f64, elevation: f64) -> Option<[f64; 3]> {
        let (sin_yaw, cos_yaw) = self.heading?.sin_cos();
        let (sin_pitch, cos_pitch) = self.pitch.unwrap_or_default().sin_cos();
        let (sin_roll, cos_roll) = self.roll.unwrap_or_default().sin_cos();
        let along = elevation.cos();
        let (x, y, z) = (
            along * azimuth.cos(),
            along * azimuth.sin(),
            -elevation.sin(),
        );
        let (y, z) = (cos_roll * y - sin_roll * z, sin_roll * y + cos_roll * z);
        let (x, z) = (cos_pitch * x + sin_pitch * z, cos_pitch * z - sin_pitch * x);
        Some([cos_yaw * x - sin_yaw * y, sin_yaw * x + cos_yaw * y, z])
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::wire::Draft;

    /// Along what a camera at these angles looks from a vehicle with this roll, pitch and heading; all in degrees.
    fn sight([azimuth, elevation]: [f64; 2], [roll, pitch, heading]: [f64; 3]) -> [i32; 3] {
        let fix = Draft::new(4000)
            .set("Latitude", 0.8)
            .set("Longitude", 0.1)
            .set("Altitude", 500.0)
            .set("Roll", roll.to_radians())
            .set("Pitch", pitch.to_radians())
            .set("Heading", heading.to_radians());
        let fix = Fix::of(&fix.seen()).unwrap();
        let sight = fix.sight(azimuth.to_radians(), elevation.to_radians());
        sight.unwrap().map(|part| (part * 100.0).round() as i32)
    }

    #[test]
    fn a_line_of_sight_is_from_the_axes_of_a_vehicle_that_turns_and_tilts() {
        let level = [0.0; 3];
        assert_eq!(sight([0.0, 0.0], level), [100, 0, 0]);
        assert_eq!(sight([90.0, -30.0], level), [0, 87, 50]);
        assert_eq!(sight([-90.0, 0.0], [0.0, 0.0, 90.0]), [100, 0, 0]);
        // The nose up: what looks ahead looks up, and what looks down looks ahead.
        assert_eq!(sight([0.0, 0.0], [0.0, 30.0, 0.0]), [87, 0, -50]);
        assert_eq!(sight([0.0, -90.0], [0.0, 30.0, 0.0]), [50, 0, 87]);
        // The right wing down: what looks right looks down, and what looks down looks left.
        assert_eq!(sight([90.0, 0.0], [30.0, 0.0, 0.0]), [0, 87, 50]);
        assert_eq!(sight([0.0, -90.0], [30.0, 0.0, 90.0]), [50, 0, 87]);
    }
}
