//! Random curved legs of every kind, and the oracles that judge their chords.

use curve_paths::{BezierLeg, Control, ErrorAllowance, Ground, Position, Vertex};
use geographiclib_rs::{DirectGeodesic, Geodesic, InverseGeodesic};

/// The shapes that legs are drawn from.
#[derive(Clone, Copy, Debug, Eq, Hash, PartialEq)]
pub enum Kind {
    /// A bend to one side.
    Gentle,
    /// A bend to one side, then to the other.
    S,
    /// It overshoots its end and comes back.
    Hook,
    /// It crosses itself.
    Loop,
    /// It almost stops and turns on the spot.
    NearCusp,
    /// All points on one line.
    Straight,
    /// Control points that coincide with an end or each other.
    Coincident,
    /// It ends where it starts.
    Closed,
    /// Along one line, there and back.
    BackAndForth,
}

impl Kind {
    /// All kinds; a seed picks one by its remainder.
    pub const ALL: [Self; 9] = [
        Self::Gentle,
        Self::S,
        Self::Hook,
        Self::Loop,
        Self::NearCusp,
        Self::Straight,
        Self::Coincident,
        Self::Closed,
        Self::BackAndForth,
    ];
}

/// The published figures are about exactly these legs, so the generator is fixed here (splitmix64) instead of taken
/// from a library that may change.
struct Random(u64);

impl Random {
    fn new(seed: u64) -> Self {
        Self(seed.wrapping_mul(0x9e37_79b9_7f4a_7c15) ^ 0x1234_5678_9abc_def1)
    }

    /// Uniform in 0 to 1.
    fn unit(&mut self) -> f64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((z ^ (z >> 31)) >> 11) as f64 / (1u64 << 53) as f64
    }

    fn within(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * self.unit()
    }
}

/// A leg of the kind that the seed names, anywhere on earth, 20 m to 20 km long.
pub fn random_leg(seed: u64) -> (Kind, BezierLeg) {
    let mut r = Random::new(seed);
    let kind = Kind::ALL[(seed % 9) as usize];
    let size = 20.0 * 1_000f64.powf(r.unit());
    let size = if matches!(kind, Kind::Straight | Kind::Gentle) {
        size
    } else {
        size.min(5_000.0)
    };
    let mut wide = |l: f64, h: f64| r.within(l, h);
    // Along and across the chord, in fractions of its length.
    let (p2, p3, p4) = match kind {
        Kind::Gentle => ((0.33, wide(-0.3, 0.3)), (0.67, wide(-0.3, 0.3)), (1.0, 0.0)),
        Kind::S => ((0.4, wide(0.2, 1.0)), (0.6, -wide(0.2, 1.0)), (1.0, 0.0)),
        Kind::Hook => (
            (wide(1.0, 2.5), 0.0),
            (wide(1.0, 2.0), wide(0.3, 1.0)),
            (1.0, wide(0.1, 0.5)),
        ),
        Kind::Loop => (
            (wide(1.2, 2.5), wide(0.5, 1.5)),
            (-wide(0.2, 1.5), wide(0.5, 1.5)),
            (1.0, 0.0),
        ),
        Kind::NearCusp => (
            (1.0 + wide(-1e-3, 1e-3), 1.0),
            (wide(-1e-3, 1e-3), 1.0),
            (1.0, 0.0),
        ),
        Kind::Straight => ((wide(0.0, 0.5), 0.0), (wide(0.5, 1.0), 0.0), (1.0, 0.0)),
        Kind::Coincident => match seed / 9 % 3 {
            0 => ((0.0, 0.0), (wide(0.2, 0.9), wide(-0.5, 0.5)), (1.0, 0.0)),
            1 => ((wide(0.2, 0.9), wide(-0.5, 0.5)), (1.0, 0.0), (1.0, 0.0)),
            _ => ((0.5, 0.4), (0.5, 0.4), (1.0, 0.0)),
        },
        Kind::Closed => (
            (wide(0.5, 1.0), wide(0.2, 1.0)),
            (-wide(0.5, 1.0), wide(0.2, 1.0)),
            (0.0, 0.0),
        ),
        Kind::BackAndForth => ((wide(1.0, 2.0), 0.0), (-wide(0.1, 0.8), 0.0), (1.0, 0.0)),
    };
    let centre = match seed / 9 % 4 {
        0 => (37.29, 127.2),
        1 => (r.within(-80.0, 80.0), r.within(-180.0, 180.0)),
        2 => (r.within(-60.0, 60.0), 179.999_9),
        _ => (r.within(80.0, 89.99), r.within(-180.0, 180.0)),
    };
    let heading = r.within(0.0, 360.0);
    let earth = Geodesic::wgs84();
    let place = |(along, across): (f64, f64)| {
        let (x, y): (f64, f64) = (along * size, across * size);
        let distance = x.hypot(y);
        let (lat, lon, _) = earth.direct(
            centre.0,
            centre.1,
            heading + y.atan2(x).to_degrees(),
            distance,
        );
        Ground::new(lat, lon)
    };
    let (g1, g2, g3, g4) = (place((0.0, 0.0)), place(p2), place(p3), place(p4));
    let low = r.within(0.0, 3_000.0);
    let mut climb = || low + r.within(-0.2, 0.2) * size.min(4_000.0);
    let alt = [low.max(0.0), climb(), climb(), climb()];
    let bernstein = (seed / 9).is_multiple_of(3);
    let control = |g: Ground, a: f64| Control {
        lat_deg: g.lat_deg,
        lon_deg: g.lon_deg,
        alt_m: bernstein.then_some(a),
    };
    let a4 = if seed / 9 % 3 == 1 { alt[0] } else { alt[3] };
    let leg = BezierLeg::new(
        Position::new(g1.lat_deg, g1.lon_deg, alt[0]),
        control(g2, alt[1]),
        control(g3, alt[2]),
        Position::new(g4.lat_deg, g4.lon_deg, a4),
    )
    .unwrap();
    (kind, leg)
}

/// The Hausdorff distance, m, from samples, between the leg and the polyline of the vertices rounded as mission items
/// are. Each part is compared with its own chord, so the result can only be larger than against the whole polyline.
pub fn two_sided_deviation_m(leg: &BezierLeg, vertices: &[Vertex], samples: usize) -> f64 {
    let earth = Geodesic::wgs84();
    let mut worst: f64 = 0.0;
    for pair in vertices.windows(2) {
        let a = if pair[0].t >= 1.0 { 0.0 } else { pair[0].t };
        let (v0, v1) = (rounded(pair[0].position), rounded(pair[1].position));
        let (length, azimuth, _, _): (f64, f64, f64, f64) =
            earth.inverse(v0.lat_deg, v0.lon_deg, v1.lat_deg, v1.lon_deg);
        // Along the chord, across it, and up: over one chord the sphere is exact enough.
        let local = |p: Position| {
            let (s, az, _, _): (f64, f64, f64, f64) =
                earth.inverse(v0.lat_deg, v0.lon_deg, p.lat_deg, p.lon_deg);
            let turn = (az - azimuth).to_radians();
            let across = ((s / SPHERE_M).sin() * turn.sin()).asin();
            let along = ((s / SPHERE_M).tan() * turn.cos()).atan();
            [along * SPHERE_M, across * SPHERE_M, p.alt_m - v0.alt_m]
        };
        let end = [length, 0.0, v1.alt_m - v0.alt_m];
        let curve: Vec<[f64; 3]> = (0..=samples)
            .map(|i| local(leg.at(a + (pair[1].t - a) * i as f64 / samples as f64)))
            .collect();
        for &p in &curve {
            worst = worst.max(to_segment(p, [0.0; 3], end));
        }
        for i in 0..=samples {
            let f = i as f64 / samples as f64;
            let q = end.map(|x| x * f);
            let nearest = curve
                .windows(2)
                .map(|s| to_segment(q, s[0], s[1]))
                .fold(f64::INFINITY, f64::min);
            worst = worst.max(nearest);
        }
    }
    worst
}

/// Mean radius of the earth, m.
const SPHERE_M: f64 = 6_371_000.0;

/// A position as MISSION_ITEM_INT carries it.
pub fn rounded(p: Position) -> Position {
    let grid = |deg: f64| (deg * 1e7).round() / 1e7;
    Position::new(grid(p.lat_deg), grid(p.lon_deg), f64::from(p.alt_m as f32))
}

fn to_segment(p: [f64; 3], a: [f64; 3], b: [f64; 3]) -> f64 {
    let sub = |u: [f64; 3], v: [f64; 3]| [u[0] - v[0], u[1] - v[1], u[2] - v[2]];
    let dot = |u: [f64; 3], v: [f64; 3]| u[0] * v[0] + u[1] * v[1] + u[2] * v[2];
    let (d, e) = (sub(b, a), sub(p, a));
    let l2 = dot(d, d);
    let t = if l2 > 0.0 {
        (dot(e, d) / l2).clamp(0.0, 1.0)
    } else {
        0.0
    };
    let r = [e[0] - d[0] * t, e[1] - d[1] * t, e[2] - d[2] * t];
    dot(r, r).sqrt()
}

/// Fewest chords with vertices at even steps of t that keep the tolerance by the proven bound.
pub fn fewest_chords(
    leg: &BezierLeg,
    tolerance_m: f64,
    allowance: &ErrorAllowance,
    grid: usize,
) -> usize {
    let t = |i: usize| i as f64 / grid as f64;
    let mut fewest = vec![usize::MAX; grid + 1];
    fewest[0] = 0;
    for j in 1..=grid {
        for i in 0..j {
            if fewest[i] != usize::MAX
                && fewest[i] + 1 < fewest[j]
                && leg.chord_bound_m(t(i), t(j), allowance) <= tolerance_m
            {
                fewest[j] = fewest[i] + 1;
            }
        }
    }
    fewest[grid]
}
