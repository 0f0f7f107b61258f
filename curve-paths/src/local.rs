//! A leg seen from a local horizontal: east, north and altitude, in which both the curve and its chords are measured.
//!
//! Earth-centred, a chord's middle lies below the ground and so does a long leg's; that depth is no deviation, as the
//! altitude is a curve of its own. So the earth-centred cubic is projected along the vertical at a nearby point, and
//! its depth replaced by the altitude: still exactly a cubic, to which [`ChordBound`] applies. The largest error of
//! the projection itself is charged to each chord:
//!
//! - the geodesic between the chord's ends bulges by l^2/8R along a vertical that leans by at most rho/R here;
//! - the curve's depth changes by at most h times the greatest vertical speed between two points of the part, and is
//!   taken off along verticals that lean by as much;
//! - lengths across are foreshortened by at most 1 + (rho/R)^2 + depth/R.
//!
//! rho is the distance from the frame's origin, kept under a kilometre or the chord's length by moving the frame.

use crate::bound::{ChordBound, off_curve_m};
use crate::leg::{BezierLeg, Climb};
use crate::vector::Vec3;
use crate::wgs84::{SMALLEST_RADIUS_M, east_north, up};

/// What is charged to a chord beside the geometry, m: errors of numbers and of the flown line.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ErrorAllowance {
    /// For the rounding of each vertex, latitude and longitude together, m.
    pub rounding_m: f64,
    /// Whether the altitude is sent as an IEEE single: half a unit in its last place is charged.
    pub single_altitude: bool,
    /// For the line that the autopilot flies between two items, m for each square metre of chord length.
    pub line_per_m2: f64,
}

impl ErrorAllowance {
    /// `MISSION_ITEM_INT` flown by PX4: 1e-7 degree (7.9 mm), altitude in single precision (0.25 mm below 8 km),
    /// its own straight line 0.17 mm off for a chord of 1 km and 17 mm for 10 km.
    pub const MISSION_ITEM: Self = Self {
        rounding_m: 7.9e-3,
        single_altitude: true,
        line_per_m2: 1.7e-10,
    };
    /// Geometry only.
    pub const NONE: Self = Self {
        rounding_m: 0.0,
        single_altitude: false,
        line_per_m2: 0.0,
    };

    /// What every chord pays whatever its length, m, for altitudes up to `highest_m`.
    #[must_use]
    pub fn fixed_m(&self, highest_m: f64) -> f64 {
        let altitude = if self.single_altitude {
            // Half the distance to the next single: 24 significant bits.
            f64::from(highest_m.abs().max(1.0) as f32)
                .log2()
                .floor()
                .exp2()
                * 2f64.powi(-24)
        } else {
            0.0
        };
        self.rounding_m + altitude
    }
}

/// A chord as measured: where it ends, how long it is, how far the curve can be from it.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Chord {
    /// Parameter of its start.
    pub(crate) a: f64,
    /// Parameter of its end.
    pub(crate) b: f64,
    /// Its length on the ground, m.
    pub(crate) ground_m: f64,
    /// Proven deviation both ways, fixed allowance not included, m.
    pub(crate) bound_m: f64,
    end: Sample,
}

/// Where a search starts.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Guess {
    /// The length of parameter that the chord should need.
    pub(crate) h: f64,
    /// How the root of the bound grows with h beside in proportion: about as exp(slope h).
    pub(crate) slope: f64,
}

/// A point of the local curve, and its derivative by t.
#[derive(Clone, Copy, Debug)]
struct Sample {
    at: Vec3,
    speed: Vec3,
}

/// A leg in its current frame, standing at a vertex.
pub(crate) struct Local<'a> {
    leg: &'a BezierLeg,
    line_per_m2: f64,
    east: Vec3,
    north: Vec3,
    /// Power coefficients of (east, north, altitude); the altitude is left 0 for an even climb.
    k: [Vec3; 4],
    /// Climb per metre of length for an even climb, else 0.
    gradient: f64,
    /// Greatest vertical speed of the earth-centred cubic, m for t from 0 to 1.
    sink_m: f64,
    /// Greatest depth of the earth-centred cubic as a fraction of R.
    depth: f64,
    t: f64,
    here: Sample,
    /// The length of parameter of the chord before; 0 where there is none.
    last: f64,
}

impl BezierLeg {
    /// Proven deviation, m, both ways and in three dimensions, between the part from `a` to `b` and its chord, with
    /// what the chord's length is charged; fixed allowance not included.
    #[must_use]
    pub fn chord_bound_m(&self, a: f64, b: f64, allowance: &ErrorAllowance) -> f64 {
        let mut local = Local::new(self, allowance);
        local.reframe(a);
        local.chord(b).bound_m
    }
}

impl<'a> Local<'a> {
    pub(crate) fn new(leg: &'a BezierLeg, allowance: &ErrorAllowance) -> Self {
        let [p0, p1, p2, p3] = leg.offsets().0;
        // One vertical for the whole leg; what the others lean from it is charged below.
        let middle = up(leg.origin() + (p0 + p1 + p2 + p3) * 0.25);
        let hull_m = [p0, p1, p2, p3]
            .iter()
            .map(|p| (*p - p0).norm())
            .fold(0.0, f64::max);
        let lean = 2.0 * hull_m / SMALLEST_RADIUS_M;
        let sink_m = [p1 - p0, p2 - p1, p3 - p2]
            .iter()
            .map(|d| 3.0 * (d.dot(middle).abs() + d.norm() * lean))
            .fold(0.0, f64::max);
        // The hull spans at most twice hull_m, and sags by the square of half of that over 2R.
        let depth = hull_m * hull_m / (2.0 * SMALLEST_RADIUS_M * SMALLEST_RADIUS_M);
        let gradient = match leg.climb() {
            Climb::Cubic(_) => 0.0,
            Climb::Even {
                rise_m, length_m, ..
            } => rise_m.abs() / length_m,
        };
        let still = Sample {
            at: Vec3::ZERO,
            speed: Vec3::ZERO,
        };
        let line_per_m2 = allowance.line_per_m2;
        let mut local = Self {
            leg,
            line_per_m2,
            east: Vec3::ZERO,
            north: Vec3::ZERO,
            k: [Vec3::ZERO; 4],
            gradient,
            sink_m,
            depth,
            t: 0.0,
            here: still,
            last: 0.0,
        };
        local.reframe(0.0);
        local
    }

    /// Moves to the parameter `t`, in a new frame there; no chord is before it.
    pub(crate) fn reframe(&mut self, t: f64) {
        self.last = 0.0;
        self.move_frame(t);
    }

    fn move_frame(&mut self, t: f64) {
        let offsets = self.leg.offsets();
        let origin = offsets.at(t);
        let u = up(self.leg.origin() + origin);
        let (e, n) = east_north(u);
        (self.east, self.north) = (e, n);
        let flat = |p: Vec3| Vec3::new((p - origin).dot(e), (p - origin).dot(n), 0.0);
        let mut p = offsets.0.map(flat);
        if let Climb::Cubic(alt) = self.leg.climb() {
            for (p, alt) in p.iter_mut().zip(alt) {
                p.z = alt - alt_reference(&self.leg.climb());
            }
        }
        let [p0, p1, p2, p3] = p;
        self.k = [
            p0,
            (p1 - p0) * 3.0,
            (p2 - p1 * 2.0 + p0) * 3.0,
            p3 - p2 * 3.0 + p1 * 3.0 - p0,
        ];
        self.t = t;
        self.here = self.sample(t);
    }

    /// Moves to the end of a chord; the frame follows once its origin is a kilometre behind.
    pub(crate) fn advance(&mut self, chord: &Chord) {
        self.last = chord.b - chord.a;
        if flat_norm2(chord.end.at) > FRAME_REACH_M * FRAME_REACH_M {
            self.move_frame(chord.b);
        } else {
            self.t = chord.b;
            self.here = chord.end;
        }
    }

    /// The parameter of the present vertex.
    pub(crate) const fn t(&self) -> f64 {
        self.t
    }

    /// The length of parameter of the chord before; 0 where there is none.
    pub(crate) const fn last(&self) -> f64 {
        self.last
    }

    /// The chord from here to parameter `b`.
    #[inline]
    pub(crate) fn chord(&self, b: f64) -> Chord {
        let end = self.sample(b);
        let h = b - self.t;
        let third = h * (1.0 / 3.0);
        let v3 = end.at - self.here.at;
        let v1 = self.here.speed * third;
        let v2 = v3 - end.speed * third;
        let part = ChordBound::new(v1, v2, v3);
        let ground2 = flat_norm2(v3);
        let mut geometry = part.distance_m();
        if self.gradient > 0.0 {
            // An even climb differs from the chord's by the gradient times what the curve is longer, at most.
            let polygon = v1.norm() + (v2 - v1).norm() + (v3 - v2).norm();
            let late = self.gradient * (polygon - ground2.sqrt()).max(0.0);
            geometry = (geometry * geometry + late * late).sqrt();
        }
        let bound_m = self.charged(geometry, end.at, h, ground2);
        Chord {
            a: self.t,
            b,
            ground_m: ground2.sqrt(),
            bound_m,
            end,
        }
    }

    /// The geometric bound of a chord to the place `end`, over `h` of the parameter, with what the frame and the
    /// autopilot's line can add.
    #[inline]
    fn charged(&self, geometry: f64, end: Vec3, h: f64, ground2: f64) -> f64 {
        let rho = flat_norm2(end).max(flat_norm2(self.here.at)).sqrt() * (1.0 / SMALLEST_RADIUS_M);
        let frame = rho * (ground2 * (1.0 / (8.0 * SMALLEST_RADIUS_M)) + h * self.sink_m)
            + geometry * (rho * rho + self.depth);
        geometry + frame + ground2 * self.line_per_m2
    }

    /// The chord from `from` off the curve here to `to` off the curve at `b`: its bound and its length on the ground.
    pub(crate) fn chord_off_curve(&self, from: Vec3, to: Vec3, b: f64) -> (f64, f64) {
        let end = self.sample(b);
        let h = b - self.t;
        let third = h * (1.0 / 3.0);
        let c0 = -from;
        let c3 = end.at - self.here.at - from;
        let c = [c0, c0 + self.here.speed * third, c3 - end.speed * third, c3];
        let v = c3 + to;
        let mut geometry = off_curve_m(c, v);
        let ground2 = flat_norm2(v);
        if self.gradient > 0.0 {
            // The climb is even along the curve's length s on the curve, and along the chord's on the chord. Where
            // x runs forward from x0 to x1, the two differ by no more than this; what runs back is added.
            let l = ground2.sqrt();
            let x = c.map(|p| if l > 0.0 { p.dot(v) / l } else { 0.0 });
            let longest: f64 = c.windows(2).map(|p| (p[1] - p[0]).norm()).sum();
            let back: f64 = x.windows(2).map(|p| (p[0] - p[1]).max(0.0)).sum();
            let late = |s: f64| {
                let ends = x[0].abs().max((l - x[3]).abs());
                ends.max((l - s - x[0]).abs()).max((s - x[3]).abs())
            };
            let late = late(longest).max(late((c3 - c0).norm())) + 2.0 * back;
            geometry = geometry.hypot(self.gradient * late);
        }
        (self.charged(geometry, end.at, h, ground2), ground2.sqrt())
    }

    /// The direction, length 1, away from the centre of curvature at `t`, and how much the curve bends there, m for
    /// the whole leg; none where it is straight or stands still.
    pub(crate) fn outward(&self, t: f64) -> Option<(Vec3, f64)> {
        let [_, k1, k2, k3] = self.k;
        let bend = k2 * 2.0 + k3 * (6.0 * t);
        let speed = k1 + (k2 * 2.0 + k3 * (3.0 * t)) * t;
        let along = bend.dot(speed) / speed.norm2();
        let across = bend - speed * along;
        let size = across.norm();
        (along.is_finite() && size > 1e-9).then(|| (-across.unit(), size))
    }

    /// A vector in the current frame as an earth-centred one and an altitude, and back by [`Local::framed`].
    pub(crate) fn unframed(&self, v: Vec3) -> (Vec3, f64) {
        (self.east * v.x + self.north * v.y, v.z)
    }

    /// An earth-centred horizontal vector and an altitude in the current frame.
    pub(crate) fn framed(&self, v: Vec3, alt_m: f64) -> Vec3 {
        Vec3::new(v.dot(self.east), v.dot(self.north), alt_m)
    }

    /// A chord from here whose offset should reach `tolerance_m`, judged from the curvature half of `chord` ahead.
    #[inline]
    pub(crate) fn guess(&self, tolerance_m: f64, chord: f64) -> Guess {
        let m = self.t + 0.5 * chord;
        let [_, k1, k2, k3] = self.k;
        let bend = k2 * 2.0 + k3 * (6.0 * m);
        let speed = k1 + (k2 * 2.0 + k3 * (3.0 * m)) * m;
        // What the curve bends across its course, times its speed; under the rounding of the product it is straight.
        let product = bend.cross(speed);
        let (across2, speed2) = (product.norm2(), speed.norm2());
        if across2 <= 1e-12 * bend.norm2() * speed2 {
            return Guess { h: 1.0, slope: 0.0 };
        }
        let h = (64.0 * tolerance_m * tolerance_m * speed2 / across2)
            .sqrt()
            .sqrt();
        // The offset is h^2/8 of what bends across, whose logarithm changes by this over t.
        let per_t = (k3 * 6.0).cross(speed).dot(product) / across2 - speed.dot(bend) / speed2;
        // The middle moves by half of what h does, and the root of the offset changes by half of that.
        Guess {
            h,
            slope: 0.25 * per_t,
        }
    }

    #[inline]
    fn sample(&self, t: f64) -> Sample {
        let [k0, k1, k2, k3] = self.k;
        let at = k0 + (k1 + (k2 + k3 * t) * t) * t;
        let speed = k1 + (k2 * 2.0 + k3 * (3.0 * t)) * t;
        Sample { at, speed }
    }
}

/// A frame is moved once its origin is this far behind, m.
const FRAME_REACH_M: f64 = 1_000.0;

/// Altitudes are measured from the first, to keep the differences exact.
fn alt_reference(climb: &Climb) -> f64 {
    match climb {
        Climb::Cubic([a1, ..]) => *a1,
        Climb::Even { from_m, .. } => *from_m,
    }
}

#[inline]
fn flat_norm2(v: Vec3) -> f64 {
    v.x * v.x + v.y * v.y
}
