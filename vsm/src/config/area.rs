//! `[[vehicle.area]]`: areas of the geofence that are always aboard.

use mapping::area::{self, Shape};
use serde::Deserialize;

/// One area: a polygon by `vertices`, or a circle by `centre` and `radius_m`.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Area {
    /// Whether the vehicle stays inside or outside.
    pub keep: Keep,
    /// Corners of a polygon in turn, 3 to 64: degrees north and east.
    #[serde(default)]
    pub vertices: Vec<[f64; 2]>,
    /// Centre of a circle: degrees north and east.
    pub centre: Option<[f64; 2]>,
    /// Radius of the circle, m.
    pub radius_m: Option<f64>,
}

/// `vehicle.area.keep`
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Keep {
    /// It stays inside.
    In,
    /// It stays outside.
    Out,
}

impl Area {
    /// As the fence is made of it.
    #[must_use]
    pub fn area(&self) -> area::Area {
        let shape = match (self.centre, self.radius_m) {
            (Some([north, east]), Some(radius_m)) => Shape::Circle {
                centre: (north, east),
                radius_m,
            },
            _ => Shape::Polygon(self.vertices.iter().map(|[n, e]| (*n, *e)).collect()),
        };
        area::Area {
            keep_in: self.keep == Keep::In,
            shape,
        }
    }
}

/// Whether the areas make a fence; what is wrong where they do not.
pub(super) fn check(areas: &[Area]) -> Result<(), String> {
    let mut all = Vec::with_capacity(areas.len());
    for (number, area) in (1..).zip(areas) {
        let places = area.vertices.iter().chain(&area.centre);
        for [north, east] in places {
            if !(-90.0..=90.0).contains(north) || !(-180.0..=180.0).contains(east) {
                return Err(format!(
                    "area {number}: {north}, {east} is no place on earth"
                ));
            }
        }
        match (area.vertices.len(), area.centre, area.radius_m) {
            (3.., None, None) => {}
            (0, Some(_), Some(radius_m)) if radius_m > 0.0 && radius_m <= 1e5 => {}
            (0, Some(_), Some(radius_m)) => {
                return Err(format!("area {number}: radius_m {radius_m}"));
            }
            (count, _, _) => {
                return Err(format!(
                    "area {number}: {count} vertices, centre and radius_m {}",
                    if area.centre.is_some() && area.radius_m.is_some() {
                        "too"
                    } else {
                        "not both given"
                    }
                ));
            }
        }
        all.push(area.area());
    }
    area::fence(&all, &[], None)
        .map(|_| ())
        .map_err(|fault| fault.reason.to_string())
}
