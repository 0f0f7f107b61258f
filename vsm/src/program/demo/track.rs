//! The flown track, how far it deviates from the planned one, and where a payload looked from it.

use px4_sim::{Mode, Truth};
use stanag_msgs::enums::EoirPointingMode;

/// A place in metres from home, at a time of the vehicle.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Point {
    pub(crate) time_s: f64,
    pub(crate) north_m: f64,
    pub(crate) east_m: f64,
    pub(crate) up_m: f64,
    /// Flown in AUTO.MISSION.
    pub(crate) in_mission: bool,
}

impl Point {
    pub(crate) const HOME: Point = Point {
        time_s: 0.0,
        north_m: 0.0,
        east_m: 0.0,
        up_m: 0.0,
        in_mission: false,
    };

    pub(crate) fn of(truth: &Truth) -> Point {
        Point {
            time_s: truth.time.as_secs_f64(),
            north_m: truth.position.n,
            east_m: truth.position.e,
            up_m: -truth.position.d,
            in_mission: truth.mode == Mode::Mission,
        }
    }
}

/// Where the sensor looked at one moment, as the vehicle reported it.
#[derive(Debug, Clone, Copy)]
pub(super) struct Look {
    /// The vehicle, m from home.
    pub(super) from: (f64, f64),
    /// The image centre, m from home.
    pub(super) to: (f64, f64),
    /// Half the width of the view there, m, where the camera reports its field of view.
    pub(super) half_width_m: Option<f64>,
    /// To the image centre, m over ground.
    pub(super) away_m: f64,
    pub(super) mode: Option<EoirPointingMode>,
}

/// A flight.
#[derive(Debug, Clone, Default)]
pub(crate) struct Track {
    pub(crate) points: Vec<Point>,
}

impl Track {
    /// From samples of the simulated vehicle's truth, from arming to disarming.
    pub(crate) fn flown(samples: &[Truth]) -> Track {
        Track::of(samples.iter().filter(|truth| truth.armed))
    }

    /// From arming to the last sample, armed or not.
    pub(crate) fn since_arming(samples: &[Truth]) -> Track {
        Track::of(samples.iter().skip_while(|truth| !truth.armed))
    }

    fn of<'a>(samples: impl Iterator<Item = &'a Truth>) -> Track {
        Track {
            points: samples.map(Point::of).collect(),
        }
    }

    /// The point flown in AUTO.MISSION that is nearest to a waypoint, over ground.
    pub(crate) fn nearest(&self, to: &Point) -> Option<&Point> {
        self.points
            .iter()
            .filter(|point| point.in_mission)
            .min_by(|a, b| ground(a, to).total_cmp(&ground(b, to)))
    }

    /// Largest distance over ground, m, of what was flown in AUTO.MISSION from the legs of a route.
    pub(crate) fn deviation_m(&self, route: &[Point]) -> f64 {
        let from_route = |point: &Point| {
            let legs = route.windows(2).filter_map(|leg| match leg {
                [from, to] => Some(from_leg(point, from, to)),
                _ => None,
            });
            legs.fold(f64::MAX, f64::min)
        };
        self.points
            .iter()
            .filter(|point| point.in_mission)
            .map(from_route)
            .fold(0.0, f64::max)
    }
}

fn ground(a: &Point, b: &Point) -> f64 {
    (a.north_m - b.north_m).hypot(a.east_m - b.east_m)
}

fn from_leg(point: &Point, from: &Point, to: &Point) -> f64 {
    let (north, east) = (to.north_m - from.north_m, to.east_m - from.east_m);
    let length2 = north * north + east * east;
    let along = if length2 > 0.0 {
        ((point.north_m - from.north_m) * north + (point.east_m - from.east_m) * east) / length2
    } else {
        0.0
    };
    let along = along.clamp(0.0, 1.0);
    (point.north_m - from.north_m - along * north).hypot(point.east_m - from.east_m - along * east)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(north_m: f64, east_m: f64) -> Point {
        Point {
            time_s: 0.0,
            north_m,
            east_m,
            up_m: 0.0,
            in_mission: true,
        }
    }

    #[test]
    fn deviation_is_measured_to_the_nearest_leg() {
        let route = [at(0.0, 0.0), at(100.0, 0.0), at(100.0, 100.0)];
        let track = Track {
            points: vec![at(50.0, 3.0), at(104.0, 50.0), at(100.0, 107.0)],
        };
        assert!((track.deviation_m(&route) - 7.0).abs() < 1e-9);
    }
}
