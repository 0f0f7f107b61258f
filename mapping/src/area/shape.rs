//! An area, and what lies inside of it: polygons on plain longitudes, as PX4 compares them, and circles on the globe.

use geo::{Contains, Coord, Intersects, Line, LineString, Point, Polygon};

use crate::limits::metres;

/// One area, whole.
#[derive(Debug, Clone, PartialEq)]
pub struct Area {
    /// Whether the vehicle stays inside, else outside.
    pub keep_in: bool,
    /// Its outline.
    pub shape: Shape,
}

/// The outline of an area, degrees north and east.
#[derive(Debug, Clone, PartialEq)]
pub enum Shape {
    /// The corners in turn, 3 and more.
    Polygon(Vec<(f64, f64)>),
    /// A circle.
    Circle {
        /// Its centre.
        centre: (f64, f64),
        /// Metres, above 0.
        radius_m: f64,
    },
}

impl Area {
    /// Whether a place, degrees north and east, lies within the outline.
    #[must_use]
    pub fn contains(&self, at: (f64, f64)) -> bool {
        self.bound().contains(at)
    }

    pub(super) fn bound(&self) -> Bound {
        let inside = match &self.shape {
            Shape::Polygon(corners) => Inside::Polygon(outline(corners)),
            Shape::Circle { centre, radius_m } => Inside::Circle {
                centre: *centre,
                radius_m: *radius_m,
            },
        };
        Bound {
            keep_in: self.keep_in,
            inside,
        }
    }
}

/// An area to test places against: its polygon is built once for all of them.
pub(super) struct Bound {
    pub(super) keep_in: bool,
    inside: Inside,
}

enum Inside {
    Polygon(Polygon),
    Circle { centre: (f64, f64), radius_m: f64 },
}

impl Bound {
    pub(super) fn contains(&self, at: (f64, f64)) -> bool {
        match &self.inside {
            Inside::Polygon(outline) => outline.contains(&Point::new(at.1, at.0)),
            Inside::Circle { centre, radius_m } => metres(*centre, at) <= *radius_m,
        }
    }

    /// Whether a straight way lies on the wrong side of it, or a part of the way does.
    pub(super) fn is_crossed(&self, from: (f64, f64), to: (f64, f64)) -> bool {
        let ends = [from, to];
        if ends.iter().any(|at| self.contains(*at) != self.keep_in) {
            return true;
        }
        match &self.inside {
            Inside::Polygon(outline) => {
                let crosses = |way: &Line| {
                    let mut sides = outline.exterior().lines();
                    sides.any(|side| side.intersects(way))
                };
                plain(from, to).iter().any(crosses)
            }
            // No straight way between two places inside of a circle leaves it.
            Inside::Circle { .. } if self.keep_in => false,
            Inside::Circle { centre, .. } => self.contains(nearest(*centre, from, to)),
        }
    }
}

/// Degrees of longitude eastward from one to another, the shorter way around.
fn eastward(from: f64, to: f64) -> f64 {
    (to - from + 540.0).rem_euclid(360.0) - 180.0
}

/// The way between two places in plain longitudes, as polygons have them: one across 180 degrees once on either side.
fn plain(from: (f64, f64), to: (f64, f64)) -> [Line; 2] {
    let east = eastward(from.1, to.1);
    let way = |first: f64, last: f64| {
        let ends = [(from.0, first), (to.0, last)];
        let [start, end] = ends.map(|(y, x)| Coord { x, y });
        Line::new(start, end)
    };
    [way(from.1, from.1 + east), way(to.1 - east, to.1)]
}

/// The place of a straight way that is nearest to a place, on a plane that touches the globe there.
fn nearest(to: (f64, f64), start: (f64, f64), end: (f64, f64)) -> (f64, f64) {
    let shrinks = to.0.to_radians().cos();
    let east = eastward(start.1, end.1);
    let way = (end.0 - start.0, shrinks * east);
    let here = (start.0 - to.0, shrinks * eastward(to.1, start.1));
    let length2 = way.0 * way.0 + way.1 * way.1;
    let part = if length2 > 0.0 {
        (-(here.0 * way.0 + here.1 * way.1) / length2).clamp(0.0, 1.0)
    } else {
        0.0
    };
    (start.0 + part * way.0, start.1 + part * east)
}

pub(super) fn outline(corners: &[(f64, f64)]) -> Polygon {
    let ring = corners.iter().map(|(north, east)| (*east, *north));
    Polygon::new(ring.collect::<LineString>(), Vec::new())
}

/// The first corner from which a side leads over more than half the globe, and how far, degrees of longitude: the area that was
/// meant crosses 180 degrees. PX4 compares plain longitudes (geofence.cpp, `insidePolygon`), and so does [`Area::contains`]: inside
/// and outside would be exchanged.
pub(super) fn across_180(corners: &[(f64, f64)]) -> Option<(usize, f64)> {
    let next = corners.iter().cycle().skip(1);
    let sides = corners.iter().zip(next);
    let spans_deg = sides.map(|((_, from), (_, to))| (to - from).abs());
    spans_deg
        .enumerate()
        .find(|(_, span_deg)| *span_deg > 180.0)
}
