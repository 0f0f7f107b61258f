//! Legs between heights above the ground (altitude type 2 with `vehicle.agl = "terrain"`): a profile of straight lines that
//! keeps its distance from the ground between waypoints too.
//!
//! At a waypoint the vehicle is at its commanded height above the ground. Between two waypoints the commanded height
//! changes evenly, and the ground does not. Where a straight line would come closer to the ground than [`KEPT`] of that
//! height, a point is added, at the full height above the closest place, and both halves are checked again. Over a valley
//! the line stays straight: following every dip would cost climbs for nothing. On wings the profile begins to climb early
//! enough for the wing.
//!
//! The ground is sampled along the line only, at each third of a sample of the elevation files. Deviations from the line
//! (`vehicle.curve.wind_m_s`, a cut corner) are not considered: the height must include a margin for them.

use curve_paths::Position;
use curve_paths::terrain::{Terrain, between};

use super::error::{MAX_PLACES, TerrainError};
use super::wings::Wings;

/// A point of the profile.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Point {
    /// Its position, altitude in metres above mean sea level.
    pub(super) position: Position,
    /// The node at it, or before it.
    pub(super) node: usize,
    /// How far it is from that node to the next, 0 to below 1.
    pub(super) part: f64,
}

/// The steepest climb and descent: metres of height per metre.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Slopes {
    up: f64,
    down: f64,
}

impl Slopes {
    /// For wings at a speed.
    pub(super) fn of(wings: &Wings, speed_m_s: f64) -> Slopes {
        Slopes {
            up: USED_OF_CLIMB * wings.climb_m_s / speed_m_s,
            down: USED_OF_CLIMB * wings.sink_m_s / speed_m_s,
        }
    }
}

/// A sampled place.
#[derive(Debug, Clone, Copy)]
struct Sample {
    at: Point,
    /// Metres over ground from the first node.
    along_m: f64,
    /// The altitude flown there if a point is added, m above mean sea level.
    full_m: f64,
    /// The lowest altitude a line may have there.
    needed_m: f64,
}

/// The profile over these nodes, whose altitudes are heights above the ground, in flying order; the nodes are points of it.
/// `looked_at` counts the samples, at most [`MAX_PLACES`].
///
/// # Errors
/// The ground is unknown somewhere, or the route is too long.
pub(super) fn follow(
    nodes: &[Position],
    slopes: Option<Slopes>,
    terrain: &Terrain,
    looked_at: &mut usize,
) -> Result<Vec<Point>, TerrainError> {
    let mut samples = sample(nodes, terrain, looked_at)?;
    if let Some(slopes) = slopes {
        climb_in_time(&mut samples, slopes);
    }
    let mut points = Vec::with_capacity(nodes.len());
    let mut start: Option<usize> = None;
    for (index, sample) in samples.iter().enumerate() {
        if sample.at.part > 0.0 {
            continue;
        }
        if let Some(start) = start {
            let added = points_between(&samples, start, index);
            points.extend(added.into_iter().filter_map(|at| samples.get(at)));
        }
        points.push(sample);
        start = Some(index);
    }
    let risen = |sample: &Sample| Point {
        position: Position {
            alt_m: sample.full_m,
            ..sample.at.position
        },
        ..sample.at
    };
    Ok(points.into_iter().map(risen).collect())
}

fn sample(
    nodes: &[Position],
    terrain: &Terrain,
    looked_at: &mut usize,
) -> Result<Vec<Sample>, TerrainError> {
    let spacing_m = terrain.spacing_m();
    let mut samples = Vec::new();
    let mut add = |at: Point, along_m: f64| {
        let Position {
            lat_deg, lon_deg, ..
        } = at.position;
        let ground_m = terrain
            .height_m(lat_deg, lon_deg)
            .ok_or(TerrainError::Unknown { lat_deg, lon_deg })?;
        let full_m = ground_m + at.position.alt_m;
        samples.push(Sample {
            at,
            along_m,
            full_m,
            needed_m: full_m - (1.0 - KEPT) * at.position.alt_m.max(0.0),
        });
        Ok::<_, TerrainError>(())
    };
    let mut begun_m = 0.0;
    for (node, from) in nodes.iter().enumerate() {
        let Some(to) = nodes.get(node + 1) else {
            let (position, part) = (*from, 0.0);
            add(
                Point {
                    position,
                    node,
                    part,
                },
                begun_m,
            )?;
            break;
        };
        let length_m = from.ground().distance_m(to.ground());
        let places = (length_m / spacing_m).ceil().max(1.0);
        // Checked before the line is sampled: one leg alone may exceed the limit.
        if *looked_at as f64 + places > MAX_PLACES as f64 {
            return Err(TerrainError::Long { spacing_m });
        }
        *looked_at += places as usize;
        for place in 0..places as usize {
            let part = place as f64 / places;
            let position = between(*from, *to, part);
            add(
                Point {
                    position,
                    node,
                    part,
                },
                begun_m + part * length_m,
            )?;
        }
        begun_m += length_m;
    }
    Ok(samples)
}

/// Raises the profile so that a wing that climbs and sinks no faster than this can fly it. The ends stay: a waypoint is
/// flown at its commanded height, and a leg that is too steep for that is refused.
fn climb_in_time(samples: &mut [Sample], slopes: Slopes) {
    let raise = |sample: &mut Sample, to_m: f64| {
        if to_m > sample.full_m {
            sample.needed_m += to_m - sample.full_m;
            sample.full_m = to_m;
        }
    };
    let last = samples.len().saturating_sub(1);
    // Backwards for climbs: each place must be high enough to reach the next one.
    for at in (1..last).rev() {
        let [this, next] = [at, at + 1].map(|at| samples[at]);
        let reach_m = next.full_m - slopes.up * (next.along_m - this.along_m);
        raise(&mut samples[at], reach_m);
    }
    // Forwards for descents, in the same way.
    for at in 1..last {
        let [before, this] = [at - 1, at].map(|at| samples[at]);
        let reach_m = before.full_m - slopes.down * (this.along_m - before.along_m);
        raise(&mut samples[at], reach_m);
    }
}

/// The samples between two others that must become points, in order.
fn points_between(samples: &[Sample], start: usize, end: usize) -> Vec<usize> {
    // A stack in place of recursion: a route may have many thousand samples.
    let mut kept = Vec::new();
    let mut open = vec![(start, end)];
    while let Some((from, to)) = open.pop() {
        let ends = [from, to].map(|at| (samples[at].along_m, samples[at].full_m));
        let [(begin_m, low_m), (finish_m, high_m)] = ends;
        let slope = (high_m - low_m) / (finish_m - begin_m).max(SHORTEST_M);
        let missing_m = |at: usize| {
            let sample = &samples[at];
            sample.needed_m - (low_m + slope * (sample.along_m - begin_m))
        };
        let worst = (from + 1..to).max_by(|a, b| missing_m(*a).total_cmp(&missing_m(*b)));
        if let Some(worst) = worst.filter(|at| missing_m(*at) > 0.0) {
            kept.push(worst);
            open.extend([(from, worst), (worst, to)]);
        }
    }
    kept.sort_unstable();
    kept
}

/// The part of the commanded height that is kept between waypoints. A line that never came closer would need a point at
/// each bump of the elevation files.
const KEPT: f64 = 0.9;
/// The part of a wing's climb and descent that the profile uses: the rest is for corrections.
const USED_OF_CLIMB: f64 = 0.8;
/// The shortest line, m.
const SHORTEST_M: f64 = 1e-3;

#[cfg(test)]
mod tests {
    use curve_paths::terrain::Grid;

    use super::*;

    /// Ground at 100 m, with a ridge of 300 m along 8.01 degrees east, 760 m from either side.
    fn ridge() -> Terrain {
        let text = "ncols 3\nnrows 3\nxllcenter 8\nyllcenter 47\ncellsize 0.01\n\
                    100 300 100\n100 300 100\n100 300 100\n";
        Terrain::new(vec![Grid::read("ridge.asc", text.into()).expect("a grid")])
    }

    fn at(lon_deg: f64, height_m: f64) -> Position {
        Position::new(47.01, lon_deg, height_m)
    }

    fn followed(nodes: &[Position], slopes: Option<Slopes>) -> Result<Vec<Point>, TerrainError> {
        follow(nodes, slopes, &ridge(), &mut 0)
    }

    /// The least height above the ground along a profile.
    fn least_m(points: &[Point]) -> f64 {
        let terrain = ridge();
        let ground = |lat, lon| Ok::<_, ()>(terrain.height_m(lat, lon));
        let least = |pair: &[Point]| {
            let (from, to) = (pair[0].position, pair[1].position);
            let found = curve_paths::terrain::profile(from, to, 1.0, ground).expect("no fault");
            found.lowest.expect("it is known").clearance_m
        };
        points.windows(2).map(least).fold(f64::INFINITY, f64::min)
    }

    #[test]
    fn over_a_ridge_a_point_is_added_and_over_a_slope_none() {
        let over = followed(&[at(8.0, 50.0), at(8.02, 50.0)], None).expect("it is known");
        // The crest may lie between two places that are looked at.
        assert!((3..=4).contains(&over.len()), "{over:?}");
        assert!((over[1].position.lon_deg - 8.01).abs() < 3e-4, "{over:?}");
        assert!((over[1].position.alt_m - 350.0).abs() < 8.0, "{over:?}");
        assert_eq!(over[0].position.alt_m.round(), 150.0);
        assert!(least_m(&over) >= 0.9 * 50.0 - 0.5, "{}", least_m(&over));
        let up = followed(&[at(8.0, 50.0), at(8.01, 50.0)], None).expect("it is known");
        assert_eq!(up.len(), 2, "{up:?}");
        // Down into the valley between two ridges a straight line is high enough.
        let valley =
            "ncols 3 nrows 2 xllcenter 8 yllcenter 47 cellsize 0.01 300 100 300 300 100 300";
        let valley = Terrain::new(vec![Grid::read("v.asc", valley.into()).expect("a grid")]);
        let nodes = [
            Position::new(47.005, 8.0, 50.0),
            Position::new(47.005, 8.02, 50.0),
        ];
        let across = follow(&nodes, None, &valley, &mut 0).expect("it is known");
        assert_eq!(across.len(), 2, "{across:?}");
    }

    #[test]
    fn the_height_changes_evenly_from_one_waypoint_to_the_next() {
        let over = followed(&[at(8.0, 20.0), at(8.02, 120.0)], None).expect("it is known");
        let crest = over[1].position;
        assert!((crest.alt_m - 370.0).abs() < 8.0, "{over:?}");
        assert_eq!(
            over.last().map(|last| last.position.alt_m.round()),
            Some(220.0)
        );
    }

    #[test]
    fn wings_climb_in_time_and_no_steeper_than_they_can() {
        // 200 m up in 760 m: 0.26; these can 0.35 up and down.
        let fast = Slopes {
            up: 0.35,
            down: 0.35,
        };
        let steps = [at(8.005, 50.0), at(8.009, 20.0), at(8.02, 50.0)];
        for nodes in [&[at(8.0, 50.0), at(8.02, 50.0)][..], &steps] {
            let over = followed(nodes, Some(fast)).expect("it is known");
            assert!(least_m(&over) >= 17.0, "{over:?}");
            for pair in over.windows(2).skip(1) {
                let [from, to] = [pair[0].position, pair[1].position];
                let slope = (to.alt_m - from.alt_m) / from.ground().distance_m(to.ground());
                assert!(slope.abs() < 0.36, "{slope} {over:?}");
            }
        }
    }

    #[test]
    fn where_the_ground_is_not_known_nothing_is_planned() {
        let beyond = followed(&[at(8.0, 50.0), at(8.03, 50.0)], None);
        let why = beyond.expect_err("it leaves the file").to_string();
        assert!(
            why.contains("is not known") && why.contains("N47E008.hgt"),
            "{why}"
        );
        let far = [
            Position::new(47.0, 8.0, 50.0),
            Position::new(47.0, -170.0, 50.0),
        ];
        let mut almost = MAX_PLACES - 10;
        let long = follow(&far, None, &ridge(), &mut almost);
        assert!(matches!(long, Err(TerrainError::Long { .. })), "{long:?}");
    }
}
