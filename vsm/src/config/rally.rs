//! `[[vehicle.rally]]`: places other than home that the vehicle may return to, uploaded as PX4's rally points.

use mapping::area::Area;
use mapping::rally::{self, Height, MAX_POINTS, RallyPoint};
use serde::Deserialize;

use super::error::{Fault, fault};
use super::key::WhenAbsent::{Nothing, Required};
use super::key::table;

table! {
    /// `vehicle.rally`: one rally point.
    #[derive(Debug, Clone, Copy, PartialEq, Deserialize)]
    #[serde(deny_unknown_fields)]
    pub struct Rally {
        /// In a `[[vehicle.rally]]`, one of at most 32 places that the vehicle lands at where it returns, as RTL_TYPE chooses
        /// between them and home ([px4.md](../guide/px4.md#rally-points)): degrees north and east
        pub place: [f64; 2] => Required,
        /// Height of the ground there, m above home, -500 to 5000; or else:
        pub height_m: Option<f64> => Nothing("`altitude_m`"),
        /// Altitude of the ground there, m above mean sea level, -500 to 9000
        pub altitude_m: Option<f64> => Nothing("`height_m`"),
    }
}

impl Rally {
    /// As it is uploaded.
    #[must_use]
    pub fn point(&self) -> RallyPoint {
        let [north, east] = self.place;
        // `check` has ensured that one of the two is set.
        let height = self.altitude_m.map(Height::Amsl);
        let height = height.or(self.height_m.map(Height::AboveHome));
        RallyPoint {
            place: (north, east),
            height: height.unwrap_or(Height::AboveHome(f64::NAN)),
        }
    }
}

/// Checks the rally points of a vehicle with these areas. `at` is where its table begins.
pub(super) fn check(points: &[Rally], areas: &[Area], at: usize) -> Result<(), Fault> {
    if points.len() > MAX_POINTS {
        let expected = "at most 32 points, which PX4 holds";
        return fault(at, "vehicle.rally", points.len(), expected);
    }
    for point in points {
        let [north, east] = point.place;
        let found = format!("[{north}, {east}]");
        // PX4 treats 0, 0 as a place that was never set.
        let never_set = north == 0.0 && east == 0.0;
        let on_earth = north.abs() <= 90.0 && east.abs() <= 180.0;
        if !on_earth || never_set {
            let expected = "degrees north and east, other than 0 and 0";
            return fault(at, "vehicle.rally.place", found, expected);
        }
        let (height, key, range) = match (point.height_m, point.altitude_m) {
            (Some(height), None) => (height, "height_m", -500.0..=5000.0),
            (None, Some(altitude)) => (altitude, "altitude_m", -500.0..=9000.0),
            _ => {
                let expected = "either height_m or altitude_m beside it";
                return fault(at, "vehicle.rally.place", found, expected);
            }
        };
        if !range.contains(&height) {
            let (key, low, high) = (format!("vehicle.rally.{key}"), range.start(), range.end());
            return fault(at, &key, height, &format!("{low} to {high} (metres)"));
        }
    }
    let all: Vec<_> = points.iter().map(Rally::point).collect();
    if let Some(point) = rally::outside(&all, areas) {
        let [north, east] = points[point].place;
        let found = format!("[{north}, {east}]");
        let expected = "a place that the areas of the vehicle (vehicle.area) allow";
        return fault(at, "vehicle.rally.place", found, expected);
    }
    Ok(())
}
