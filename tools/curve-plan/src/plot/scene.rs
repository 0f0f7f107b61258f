//! What a picture shows, in metres: independent of how it is drawn.

use curve_paths::{Densified, Leg, Position};

/// A place on the picture's map, m east and north of its middle.
pub(crate) type Point = [f64; 2];

/// A sample of the curve.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Sample {
    pub(crate) at: Point,
    pub(crate) alt_m: f64,
    /// Length of the route up to here, m.
    pub(crate) along_m: f64,
    /// Distance from the chord that stands for it, m.
    pub(crate) deviation_m: f64,
    /// Radius of the track, m; infinite on a straight.
    pub(crate) radius_m: f64,
}

/// Everything to be drawn.
#[derive(Debug, Default)]
pub(crate) struct Scene {
    pub(crate) title: String,
    pub(crate) curve: Vec<Sample>,
    /// P1-P2 and P4-P3 of each curved leg.
    pub(crate) arms: Vec<[Point; 2]>,
    /// The route's own waypoints.
    pub(crate) joints: Vec<Point>,
    pub(crate) vertices: Vec<Point>,
    pub(crate) flown: Vec<Point>,
    /// Length along the route and distance from it of each flown position near it, m.
    pub(crate) flown_deviation: Vec<[f64; 2]>,
    pub(crate) tolerance_m: f64,
    pub(crate) bound_m: f64,
}

impl Scene {
    /// Gathers the scene.
    pub(crate) fn new(
        title: &str,
        legs: &[Leg],
        densified: &Densified,
        tolerance_m: f64,
        flown: &[Position],
    ) -> Self {
        let map = Map::around(densified);
        let mut scene = Self {
            title: title.to_owned(),
            vertices: densified
                .vertices
                .iter()
                .map(|v| map.to_flat(v.position))
                .collect(),
            flown: flown.iter().map(|&p| map.to_flat(p)).collect(),
            tolerance_m,
            bound_m: densified.bound_m,
            ..Self::default()
        };
        for leg in legs {
            scene.joints.push(map.to_flat(leg.start()));
            if let Leg::Bezier(b) = leg {
                let control =
                    |c: curve_paths::Control| map.to_flat(Position::new(c.lat_deg, c.lon_deg, 0.0));
                scene.arms.push([map.to_flat(b.p1()), control(b.p2())]);
                scene.arms.push([map.to_flat(b.p4()), control(b.p3())]);
            }
        }
        scene
            .joints
            .extend(legs.last().map(|l| map.to_flat(l.end())));
        scene.sample(legs, densified, &map);
        scene.measure_flown();
        scene
    }

    fn sample(&mut self, legs: &[Leg], densified: &Densified, map: &Map) {
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
                    alt_m: position.alt_m,
                    along_m,
                    deviation_m,
                    radius_m: f64::INFINITY,
                });
            }
        }
        self.curve.dedup_by(|b, a| distance(a.at, b.at) < 1e-6);
        for k in 1..self.curve.len().saturating_sub(1) {
            self.curve[k].radius_m =
                circumradius(self.curve[k - 1].at, self.curve[k].at, self.curve[k + 1].at);
        }
    }

    fn measure_flown(&mut self) {
        for p in &self.flown {
            let nearest = self.curve.windows(2).map(|s| {
                let [d, f] = to_segment(*p, s[0].at, s[1].at);
                [s[0].along_m + f * (s[1].along_m - s[0].along_m), d]
            });
            self.flown_deviation
                .extend(nearest.min_by(|a, b| a[1].total_cmp(&b[1])));
        }
    }

    /// Smallest and greatest coordinates of all that is drawn on the map.
    pub(crate) fn extent(&self) -> [Point; 2] {
        let mut extent = [[f64::INFINITY; 2], [f64::NEG_INFINITY; 2]];
        let curve = self.curve.iter().map(|s| s.at);
        let arms = self.arms.iter().flatten().copied();
        for p in curve.chain(arms).chain(self.flown.iter().copied()) {
            for k in 0..2 {
                extent[0][k] = extent[0][k].min(p[k]);
                extent[1][k] = extent[1][k].max(p[k]);
            }
        }
        extent
    }
}

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
    // Perpendicular to a chord that climbs, the difference in altitude counts less.
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

/// Samples of a chord.
const SAMPLES: u32 = 16;
