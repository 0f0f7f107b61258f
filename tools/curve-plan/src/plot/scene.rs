//! What a picture shows, in metres: independent of how it is drawn.

use cucs::formats::Draft;
use curve_paths::{Densified, Leg, Position};

/// A place on the picture's map, m east and north of its middle.
pub(crate) type Point = [f64; 2];

/// A sample of the curve.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Sample {
    pub(crate) at: Point,
    /// Degrees north and east.
    pub(crate) place: [f64; 2],
    pub(crate) alt_m: f64,
    /// Length of the route up to here, m.
    pub(crate) along_m: f64,
    /// Distance from the chord that replaces it, m.
    pub(crate) deviation_m: f64,
    /// Radius of the curved leg, m; infinite on a straight one.
    pub(crate) radius_m: f64,
}

/// Everything to be drawn.
#[derive(Debug, Default)]
pub(crate) struct Scene {
    pub(crate) title: String,
    pub(crate) curve: Vec<Sample>,
    /// P1-P2 and P4-P3 of each curved leg.
    pub(crate) arms: Vec<[Point; 2]>,
    /// The route's own waypoints, with their numbers.
    pub(crate) joints: Vec<(Point, usize)>,
    pub(crate) vertices: Vec<Point>,
    pub(crate) home: Option<Point>,
    /// The track that the route was fitted to.
    pub(crate) track: Measured,
    /// The flown track: the approach to the route and the way home are drawn, but not measured.
    pub(crate) flown: Measured,
    pub(crate) tolerance_m: f64,
    pub(crate) bound_m: f64,
}

/// Positions that were drawn or flown beside a route.
#[derive(Debug, Default)]
pub(crate) struct Measured {
    pub(crate) points: Vec<Point>,
    /// Length along the route and distance from it of each position, m.
    pub(crate) deviation: Vec<[f64; 2]>,
}

/// What a route is compared with in the picture.
#[derive(Debug, Default)]
pub(crate) struct Beside {
    pub(crate) home: Option<Position>,
    pub(crate) track: Vec<Position>,
    pub(crate) flown: Vec<Position>,
}

impl Scene {
    /// Gathers the scene of a route: its legs, and the straight ones by which it is flown.
    pub(crate) fn new(
        route: &Draft,
        legs: &[Leg],
        densified: &Densified,
        tolerance_m: f64,
        beside: &Beside,
    ) -> Self {
        let map = Map::around(densified);
        let flat = |positions: &[Position]| positions.iter().map(|&p| map.to_flat(p)).collect();
        let mut scene = Self {
            title: route.name.clone(),
            vertices: densified
                .vertices
                .iter()
                .map(|v| map.to_flat(v.position))
                .collect(),
            // A flight starts at home.
            home: beside
                .home
                .or(route.home)
                .or(beside.flown.first().copied())
                .map(|home| map.to_flat(home)),
            tolerance_m,
            bound_m: densified.bound_m,
            ..Self::default()
        };
        for (k, point) in route.points.iter().enumerate() {
            let joint = (map.to_flat(point.position), route.number(k));
            scene.joints.push(joint);
        }
        for leg in legs {
            if let Leg::Bezier(b) = leg {
                let control =
                    |c: curve_paths::Control| map.to_flat(Position::new(c.lat_deg, c.lon_deg, 0.0));
                scene.arms.push([map.to_flat(b.p1()), control(b.p2())]);
                scene.arms.push([map.to_flat(b.p4()), control(b.p3())]);
            }
        }
        scene.sample(legs, densified, &map);
        scene.track = scene.measured(flat(&beside.track), false);
        scene.flown = scene.measured(flat(&beside.flown), true);
        scene
    }

    fn sample(&mut self, legs: &[Leg], densified: &Densified, map: &Map) {
        let mut of_leg: Vec<usize> = Vec::new();
        for pair in densified.vertices.windows(2) {
            let (v0, v1) = (pair[0], pair[1]);
            let a = if v0.leg == v1.leg { v0.t } else { 0.0 };
            let ends = [v0.position, v1.position].map(|p| (map.to_flat(p), p.alt_m));
            for k in 0..=SAMPLES {
                let f = f64::from(k) / f64::from(SAMPLES);
                let position = match &legs[v1.leg] {
                    Leg::Bezier(leg) => leg.at(a + (v1.t - a) * f),
                    Leg::Straight { from, to } => Position::new(
                        from.lat_deg + (to.lat_deg - from.lat_deg) * f,
                        from.lon_deg + (to.lon_deg - from.lon_deg) * f,
                        from.alt_m + (to.alt_m - from.alt_m) * f,
                    ),
                };
                let at = map.to_flat(position);
                let deviation_m = to_chord(at, position.alt_m, ends[0], ends[1]);
                let along_m = self
                    .curve
                    .last()
                    .map_or(0.0, |s: &Sample| s.along_m + distance(s.at, at));
                self.curve.push(Sample {
                    at,
                    place: [position.lat_deg, position.lon_deg],
                    alt_m: position.alt_m,
                    along_m,
                    deviation_m,
                    radius_m: f64::INFINITY,
                });
                of_leg.push(v1.leg);
            }
        }
        // A corner between two legs is not a curve: a radius is that of three samples of one curved leg. The samples
        // at a leg's ends have the radius of their neighbours.
        for (leg, shape) in legs.iter().enumerate() {
            let first = of_leg.partition_point(|&l| l < leg);
            let samples = first..of_leg.partition_point(|&l| l <= leg);
            if !matches!(shape, Leg::Bezier(_)) {
                continue;
            }
            let own = &mut self.curve[samples];
            let apart: Vec<usize> = (0..own.len())
                .filter(|&k| k == 0 || distance(own[k - 1].at, own[k].at) > 1e-6)
                .collect();
            for three in apart.windows(3) {
                let [a, b, c] = [0, 1, 2].map(|n| own[three[n]].at);
                own[three[1]].radius_m = circumradius(a, b, c);
            }
            if let [first, second, .., before, last] = apart.as_slice() {
                own[*first].radius_m = own[*second].radius_m;
                own[*last].radius_m = own[*before].radius_m;
            }
        }
        self.curve.dedup_by(|b, a| distance(a.at, b.at) < 1e-6);
    }

    /// Measures positions against the curve. A flight is measured from the route's start to its end: the way there
    /// and back is no deviation.
    fn measured(&self, points: Vec<Point>, flight: bool) -> Measured {
        let on_route = if flight {
            self.on_route(&points)
        } else {
            0..points.len()
        };
        let nearest = |p: &Point| {
            let chords = self.curve.windows(2).map(|s| {
                let [d, f] = to_segment(*p, s[0].at, s[1].at);
                [s[0].along_m + f * (s[1].along_m - s[0].along_m), d]
            });
            chords.min_by(|a, b| a[1].total_cmp(&b[1]))
        };
        let deviation = points[on_route].iter().filter_map(nearest).collect();
        Measured { points, deviation }
    }

    /// The part of a flight between the route's start and end: from where it was nearest to the start for the first
    /// time, to where it was nearest to the end for the last time.
    fn on_route(&self, flown: &[Point]) -> std::ops::Range<usize> {
        let near = |place: Option<&Sample>| {
            let apart = place.map(|s| flown.iter().map(|p| distance(*p, s.at)).collect());
            let apart: Vec<f64> = apart.unwrap_or_default();
            let least = apart.iter().copied().fold(f64::INFINITY, f64::min);
            (apart, least + PASSED_M)
        };
        let (from_start, at_start) = near(self.curve.first());
        let (from_end, at_end) = near(self.curve.last());
        let start = from_start.iter().position(|d| *d <= at_start).unwrap_or(0);
        let end = from_end.iter().rposition(|d| *d <= at_end);
        match end.filter(|end| *end > start) {
            Some(end) => start..end + 1,
            None => start..flown.len(),
        }
    }

    /// Smallest and greatest coordinates of the route and of what was measured against it. Home is included unless it
    /// is so far away that the route would become a dot.
    pub(crate) fn extent(&self) -> [Point; 2] {
        let grow = |extent: [Point; 2], p: Point| {
            let [low, high] = extent;
            [
                [low[0].min(p[0]), low[1].min(p[1])],
                [high[0].max(p[0]), high[1].max(p[1])],
            ]
        };
        let curve = self.curve.iter().map(|s| s.at);
        let arms = self.arms.iter().flatten().copied();
        let extent = curve
            .chain(arms)
            .fold([[f64::INFINITY; 2], [f64::NEG_INFINITY; 2]], grow);
        let size = distance(extent[0], extent[1]);
        let beside = self
            .home
            .into_iter()
            .chain(self.track.points.iter().copied());
        beside
            .chain(self.flown.points.iter().copied())
            .filter(|p| {
                let inside = [0, 1].map(|k| p[k].clamp(extent[0][k], extent[1][k]));
                distance(*p, inside) <= 0.3 * size
            })
            .fold(extent, grow)
    }
}

/// Positions of one pass are within this distance of the nearest, m: a fifth of a second at 10 m/s.
const PASSED_M: f64 = 2.0;

/// A flat map around the middle of a route: good to a millimetre in a kilometre over some kilometres.
struct Map {
    lat_deg: f64,
    lon_deg: f64,
    /// m per degree.
    scale: Point,
}

impl Map {
    fn around(densified: &Densified) -> Self {
        let first = densified.vertices[0].position;
        let n = densified.vertices.len() as f64;
        let turn = |deg: f64| (deg + 540.0).rem_euclid(360.0) - 180.0;
        let sum = densified.vertices.iter().fold([0.0, 0.0], |s, v| {
            [
                s[0] + v.position.lat_deg - first.lat_deg,
                s[1] + turn(v.position.lon_deg - first.lon_deg),
            ]
        });
        let lat_deg = first.lat_deg + sum[0] / n;
        let (s, c) = lat_deg.to_radians().sin_cos();
        let e2 = curve_paths::wgs84::FLATTENING * (2.0 - curve_paths::wgs84::FLATTENING);
        let w = (1.0 - e2 * s * s).sqrt();
        let a = curve_paths::wgs84::SEMI_MAJOR_M.to_radians();
        Self {
            lat_deg,
            lon_deg: first.lon_deg + sum[1] / n,
            scale: [a * c / w, a * (1.0 - e2) / (w * w * w)],
        }
    }

    fn to_flat(&self, p: Position) -> Point {
        let east = (p.lon_deg - self.lon_deg + 540.0).rem_euclid(360.0) - 180.0;
        [
            east * self.scale[0],
            (p.lat_deg - self.lat_deg) * self.scale[1],
        ]
    }
}

pub(crate) fn distance(a: Point, b: Point) -> f64 {
    (a[0] - b[0]).hypot(a[1] - b[1])
}

/// Distance from `p` to a segment, and the fraction along it of the nearest point.
fn to_segment(p: Point, a: Point, b: Point) -> [f64; 2] {
    let (d, e) = ([b[0] - a[0], b[1] - a[1]], [p[0] - a[0], p[1] - a[1]]);
    let l2 = d[0] * d[0] + d[1] * d[1];
    let f = if l2 > 0.0 {
        ((e[0] * d[0] + e[1] * d[1]) / l2).clamp(0.0, 1.0)
    } else {
        0.0
    };
    [(e[0] - f * d[0]).hypot(e[1] - f * d[1]), f]
}

fn to_chord(p: Point, alt_m: f64, (a, alt_a): (Point, f64), (b, alt_b): (Point, f64)) -> f64 {
    let [across, f] = to_segment(p, a, b);
    let up = alt_m - alt_a - f * (alt_b - alt_a);
    // Measured perpendicular to a chord that climbs, so a difference in altitude counts less than in full.
    let length = distance(a, b);
    let steep = if length > 0.0 {
        ((alt_b - alt_a) / length).atan().cos()
    } else {
        1.0
    };
    across.hypot(up * steep)
}

fn circumradius(a: Point, b: Point, c: Point) -> f64 {
    let twice_area = (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]);
    let sides = distance(a, b) * distance(b, c) * distance(c, a);
    if twice_area.abs() < 1e-9 * sides.max(1e-12) {
        f64::INFINITY
    } else {
        sides / (2.0 * twice_area.abs())
    }
}

/// Samples for each chord.
const SAMPLES: u32 = 16;
