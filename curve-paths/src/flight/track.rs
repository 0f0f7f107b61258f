//! A row of legs as a track for a vehicle that is sent set points: place, direction, bend and speed at each metre of it.
//!
//! Promised: every place of the track is on its leg to a millimetre where the leg bends no tighter than 2 m; the speed is
//! nowhere over what the vehicle can turn, climb and brake for (acceleration and jerk of [`Multicopter`]), and the track
//! ends at rest. Corners between legs are passed at a walk: no vehicle turns on the spot at speed.
//!
//! Nothing is allocated after [`Track::new`], and [`Track::at`] is a binary search: it is called 20 times a second.

use super::vehicle::Multicopter;
use crate::densify::Leg;
use crate::vector::Vec3;
use crate::wgs84::Position;

/// A leg of a track.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TrackLeg {
    /// Its shape.
    pub leg: Leg,
    /// Added to its altitudes, m: the altitude of their reference.
    pub raised_m: f64,
    /// The speed along it where nothing forces a lower one, m/s.
    pub speed_mps: f64,
}

/// A track.
#[derive(Clone, Debug, PartialEq)]
pub struct Track {
    nodes: Vec<Node>,
    ends_m: Vec<f64>,
}

/// A place of a track.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Along {
    /// The place.
    pub position: Position,
    /// Its direction: a unit vector east, north, up.
    pub forward: Vec3,
    /// How the direction changes, 1/m: east, north, up.
    pub bend: Vec3,
    /// The fastest speed there, m/s.
    pub fastest_mps: f64,
}

/// A sampled place, by its distance from the start.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Node {
    s_m: f64,
    at: Along,
}

impl Track {
    /// The track of these legs, each beginning where the one before ends. Legs without length are left out.
    #[must_use]
    pub fn new(legs: &[TrackLeg], limits: &Multicopter) -> Self {
        let mut track = Self {
            nodes: Vec::new(),
            ends_m: Vec::with_capacity(legs.len()),
        };
        for leg in legs {
            track.add(leg, limits);
            track.ends_m.push(track.length_m());
        }
        track.brake(limits);
        track
    }

    /// Its length, m.
    #[must_use]
    pub fn length_m(&self) -> f64 {
        self.nodes.last().map_or(0.0, |node| node.s_m)
    }

    /// Where its legs end, m from its start.
    #[must_use]
    pub fn ends_m(&self) -> &[f64] {
        &self.ends_m
    }

    /// The place at a distance from its start, kept within the track; `None` for a track without length.
    #[must_use]
    pub fn at(&self, s_m: f64) -> Option<Along> {
        let after = self.nodes.partition_point(|node| node.s_m <= s_m);
        let after = after.clamp(1, self.nodes.len().checked_sub(1)?.max(1));
        let (a, b) = (self.nodes.get(after - 1)?, self.nodes.get(after)?);
        let span_m = b.s_m - a.s_m;
        let part = if span_m > 0.0 {
            ((s_m - a.s_m) / span_m).clamp(0.0, 1.0)
        } else {
            1.0
        };
        let mix = |a: f64, b: f64| a + part * (b - a);
        let turn = |a: Vec3, b: Vec3| a + (b - a) * part;
        let (from, to) = (a.at.position, b.at.position);
        Some(Along {
            position: Position::new(
                mix(from.lat_deg, to.lat_deg),
                from.lon_deg + part * across(from.lon_deg, to.lon_deg),
                mix(from.alt_m, to.alt_m),
            ),
            forward: turn(a.at.forward, b.at.forward).unit(),
            bend: turn(a.at.bend, b.at.bend),
            fastest_mps: mix(a.at.fastest_mps, b.at.fastest_mps),
        })
    }

    /// The nearest place between two distances from the start: its distance from the start, and from `position`, m. Places
    /// outside are not looked at, since a track may cross itself.
    #[must_use]
    pub fn nearest(&self, position: Position, from_m: f64, to_m: f64) -> Option<(f64, f64)> {
        let first = self.nodes.partition_point(|node| node.s_m < from_m);
        let first = first.saturating_sub(1);
        let pairs = self.nodes.windows(2).skip(first);
        let pairs = pairs.take_while(|pair| pair[0].s_m <= to_m);
        let near = pairs.map(|pair| {
            let [a, b] = [pair[0], pair[1]];
            let chord = offset_m(a.at.position, b.at.position);
            let out = offset_m(a.at.position, position);
            let part = if chord.norm2() > 0.0 {
                (out.dot(chord) / chord.norm2()).clamp(0.0, 1.0)
            } else {
                0.0
            };
            let s_m = a.s_m + part * (b.s_m - a.s_m);
            (s_m, (out - chord * part).norm())
        });
        near.min_by(|a, b| a.1.total_cmp(&b.1))
    }

    fn add(&mut self, leg: &TrackLeg, limits: &Multicopter) {
        let places = places(leg);
        let begun = self.nodes.len();
        let mut s_m = self.length_m();
        for (k, place) in places.iter().enumerate() {
            let before = k.checked_sub(1).and_then(|before| places.get(before));
            let step_m = before.map_or(0.0, |before| offset_m(*before, *place).norm());
            if before.is_some() && step_m < SHORTEST_M {
                continue;
            }
            s_m += step_m;
            self.nodes.push(Node {
                s_m,
                at: Along {
                    position: *place,
                    forward: Vec3::ZERO,
                    bend: Vec3::ZERO,
                    fastest_mps: leg.speed_mps,
                },
            });
        }
        let Some(nodes) = self.nodes.get_mut(begun..) else {
            return;
        };
        if nodes.len() < 2 {
            self.nodes.truncate(begun);
            return;
        }
        let forward = slopes(nodes, |a, b| offset_m(a.at.position, b.at.position).unit());
        for (node, forward) in nodes.iter_mut().zip(forward) {
            node.at.forward = forward;
        }
        let per_m =
            |a: Vec3, b: Vec3, (from, to): (&Node, &Node)| (b - a) * (1.0 / (to.s_m - from.s_m));
        let bend = slopes(nodes, |a, b| per_m(a.at.forward, b.at.forward, (a, b)));
        for (node, bend) in nodes.iter_mut().zip(bend) {
            node.at.bend = bend;
        }
        let rate = slopes(nodes, |a, b| per_m(a.at.bend, b.at.bend, (a, b)));
        for (node, rate) in nodes.iter_mut().zip(rate) {
            let Along {
                forward,
                bend,
                fastest_mps,
                ..
            } = &mut node.at;
            let climb_mps = if forward.z > 0.0 {
                limits.climb_mps
            } else {
                limits.descent_mps
            };
            let caps = [
                (limits.acceleration / bend.norm()).sqrt(),
                (limits.jerk / rate.norm()).cbrt(),
                climb_mps / forward.z.abs(),
            ];
            // A division by zero is no limit.
            let cap = caps.into_iter().filter(|cap| cap.is_finite());
            *fastest_mps = cap
                .fold(*fastest_mps, f64::min)
                .max(SLOWEST_MPS.min(*fastest_mps));
        }
        self.corner(begun);
    }

    /// Slows for the corner at the joint that begins at this node.
    fn corner(&mut self, at: usize) {
        let Some((before, after)) = self.nodes.split_at_mut_checked(at) else {
            return;
        };
        if let (Some(before), Some(after)) = (before.last_mut(), after.first_mut()) {
            let turn = (after.at.forward - before.at.forward).norm();
            let slow = before.at.fastest_mps.min(after.at.fastest_mps);
            let slow = slow.min((CORNER_MPS / turn.max(1e-6)).max(SLOWEST_MPS));
            (before.at.fastest_mps, after.at.fastest_mps) = (slow, slow);
        }
    }

    /// Lets the vehicle brake in time, and end at rest.
    fn brake(&mut self, limits: &Multicopter) {
        let brake = limits.acceleration * limits.corner_gain;
        let mut next: Option<(f64, f64)> = None;
        for node in self.nodes.iter_mut().rev() {
            let allowed = next.map_or(0.0, |(s_m, mps): (f64, f64)| {
                (mps * mps + 2.0 * brake * (s_m - node.s_m)).sqrt()
            });
            node.at.fastest_mps = node.at.fastest_mps.min(allowed);
            next = Some((node.s_m, node.at.fastest_mps));
        }
    }
}

/// The places of a leg, close enough to be joined by straight lines.
fn places(leg: &TrackLeg) -> Vec<Position> {
    let raised = |place: Position| Position {
        alt_m: place.alt_m + leg.raised_m,
        ..place
    };
    match leg.leg {
        Leg::Straight { from, to } => {
            let count = (offset_m(from, to).norm() / STRAIGHT_STEP_M).ceil();
            let count = count.clamp(2.0, MAX_STEPS) as u32;
            let at = |k: u32| {
                let part = f64::from(k) / f64::from(count);
                raised(Position::new(
                    from.lat_deg + part * (to.lat_deg - from.lat_deg),
                    from.lon_deg + part * across(from.lon_deg, to.lon_deg),
                    from.alt_m + part * (to.alt_m - from.alt_m),
                ))
            };
            (0..=count).map(at).collect()
        }
        Leg::Bezier(curve) => {
            // Even steps of t are up to three times as long in places as their mean.
            let count = (3.0 * curve.length_m() / CURVE_STEP_M).ceil();
            let count = count.clamp(16.0, MAX_STEPS) as u32;
            let at = |k: u32| raised(curve.at(f64::from(k) / f64::from(count)));
            (0..=count).map(at).collect()
        }
    }
}

/// A difference quotient at each node: between its neighbours, at the ends to the only one. That is the quotient half a step further
/// in, so that a bend which begins at a joint seems to begin with a jerk, and is begun slower than it need be. The deviations in
/// docs/guide/curves.md were flown so.
fn slopes(nodes: &[Node], between: impl Fn(&Node, &Node) -> Vec3) -> Vec<Vec3> {
    let last = nodes.len() - 1;
    let at = |k: usize| between(&nodes[k.saturating_sub(1)], &nodes[(k + 1).min(last)]);
    (0..=last).map(at).collect()
}

/// East, north and up from one place to another a few kilometres away, m.
#[must_use]
pub fn offset_m(from: Position, to: Position) -> Vec3 {
    const A: f64 = 6_378_137.0;
    const E2: f64 = 0.006_694_379_990_141_317;
    let lat = (0.5 * (from.lat_deg + to.lat_deg)).to_radians();
    let w2 = 1.0 - E2 * lat.sin() * lat.sin();
    let (prime, meridian) = (A / w2.sqrt(), A * (1.0 - E2) / (w2 * w2.sqrt()));
    Vec3::new(
        across(from.lon_deg, to.lon_deg).to_radians() * prime * lat.cos(),
        (to.lat_deg - from.lat_deg).to_radians() * meridian,
        to.alt_m - from.alt_m,
    )
}

/// Degrees of longitude from one to another, the short way round.
fn across(from_deg: f64, to_deg: f64) -> f64 {
    (to_deg - from_deg + 540.0).rem_euclid(360.0) - 180.0
}

/// Between two places of a curve, m: with a radius of 2 m the chord is 1 mm off.
const CURVE_STEP_M: f64 = 0.18;
/// Between two places of a straight leg, m: for the speeds along it.
const STRAIGHT_STEP_M: f64 = 1.0;
/// Places closer than this are one, m.
const SHORTEST_M: f64 = 1e-4;
/// No leg has more: one of 50 km is 1 mm off its chords at a radius of 2 km.
const MAX_STEPS: f64 = 40_000.0;
/// The change of velocity at a corner, m/s: PX4 is carried some decimetres by it.
const CORNER_MPS: f64 = 0.5;
/// A vehicle that has to turn on the spot still gets on, m/s.
const SLOWEST_MPS: f64 = 0.3;

#[cfg(test)]
mod tests {
    use super::*;
    use crate::leg::{BezierLeg, Control};

    const HOME: Position = Position::new(47.0, 8.0, 500.0);

    /// Metres north and east of home.
    fn at(north: f64, east: f64) -> Position {
        Position::new(47.0 + north / 111_181.0, 8.0 + east / 76_056.0, HOME.alt_m)
    }

    fn bend(radius: f64) -> Leg {
        let k = 0.552_284_75 * radius;
        let control = |p: Position| Control::level(p.lat_deg, p.lon_deg);
        let leg = BezierLeg::new(
            at(0.0, 0.0),
            control(at(k, 0.0)),
            control(at(radius, radius - k)),
            at(radius, radius),
        );
        Leg::Bezier(leg.expect("a leg"))
    }

    fn track(legs: &[Leg], speed_mps: f64) -> Track {
        let legs: Vec<TrackLeg> = legs
            .iter()
            .map(|leg| TrackLeg {
                leg: *leg,
                raised_m: 0.0,
                speed_mps,
            })
            .collect();
        Track::new(&legs, &Multicopter::default())
    }

    #[test]
    fn a_quarter_circle_is_as_long_bends_as_much_and_is_flown_as_fast_as_its_radius_says() {
        let track = track(&[bend(50.0)], 20.0);
        assert!(
            (track.length_m() - 78.54).abs() < 0.3,
            "{}",
            track.length_m()
        );
        let middle = track.at(20.0).expect("a place");
        assert!((1.0 / middle.bend.norm() - 50.0).abs() < 1.0, "{middle:?}");
        assert!(middle.bend.dot(middle.forward).abs() < 1e-4);
        // sqrt(3 m/s^2 * 50 m)
        assert!((middle.fastest_mps - 12.2).abs() < 0.3, "{middle:?}");
        assert_eq!(track.at(1e9).expect("its end").fastest_mps, 0.0);
    }

    #[test]
    fn it_brakes_for_a_corner_and_for_its_end_and_little_for_a_smooth_joint() {
        let in_line = Leg::Straight {
            from: at(-60.0, 0.0),
            to: at(0.0, 0.0),
        };
        let across = Leg::Straight {
            from: at(0.0, -60.0),
            to: at(0.0, 0.0),
        };
        let smooth = track(&[in_line, bend(50.0)], 5.0);
        let joint_m = smooth.ends_m()[0];
        assert!((joint_m - 60.0).abs() < 0.2, "{joint_m}");
        let at_joint = smooth.at(joint_m).expect("a place").fastest_mps;
        assert!((3.0..=5.0).contains(&at_joint), "{at_joint}");
        let corner = track(&[across, bend(50.0)], 5.0);
        let fastest = |s_m: f64| corner.at(s_m).expect("a place").fastest_mps;
        assert!(fastest(corner.ends_m()[0]) < 0.5);
        assert!(fastest(corner.ends_m()[0] - 30.0) == 5.0);
        for pair in corner.nodes.windows(2) {
            let (a, b) = (pair[0].at.fastest_mps, pair[1].at.fastest_mps);
            assert!(a * a - b * b <= 3.0 * (pair[1].s_m - pair[0].s_m) + 1e-6);
        }
    }

    #[test]
    fn the_nearest_place_is_found_within_the_part_that_is_looked_at() {
        let track = track(&[bend(50.0)], 5.0);
        let there = track.at(30.0).expect("a place");
        let left = Vec3::new(-there.forward.y, there.forward.x, 0.0);
        let beside = Position::new(
            there.position.lat_deg + 2.0 * left.y / 111_181.0,
            there.position.lon_deg + 2.0 * left.x / 76_056.0,
            there.position.alt_m,
        );
        let (s_m, off_m) = track.nearest(beside, 0.0, 60.0).expect("near");
        assert!(
            (s_m - 30.0).abs() < 0.1 && (off_m - 2.0).abs() < 0.02,
            "{s_m} {off_m}"
        );
        let (s_m, _) = track.nearest(beside, 0.0, 10.0).expect("near");
        assert!(s_m <= 10.3, "{s_m}");
    }

    #[test]
    fn nothing_without_length_is_a_track() {
        let point = Leg::Straight {
            from: HOME,
            to: HOME,
        };
        let nothing = track(&[point], 5.0);
        assert!(nothing.at(0.0).is_none() && nothing.nearest(HOME, 0.0, 1.0).is_none());
        assert_eq!(track(&[], 5.0).length_m(), 0.0);
    }
}
