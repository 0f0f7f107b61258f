//! Where a sensor looks: direction, and footprint on the ground.
//!
//! A DLI angle is relative to the vehicle: azimuth right of its x axis, elevation above its waterline (0302.10, 0302.12). A
//! gimbal reports a quaternion that turns from north, from the vehicle's heading or from its body ([`Frame`]).

use crate::attitude::{STILL_RAD, span_ms};
use crate::limits::moved;
use crate::telemetry::{Attitude, Place};

/// What a gimbal's attitude turns from.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Frame {
    /// North, east, down.
    North,
    /// The vehicle's heading, level.
    Heading,
    /// The vehicle's body: a gimbal whose pitch is not locked to the horizon.
    Body,
}

/// How a gimbal stands (GIMBAL_DEVICE_ATTITUDE_STATUS).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct GimbalAttitude {
    /// Attitude, w first.
    pub q: [f64; 4],
    /// What `q` turns from.
    pub frame: Frame,
    /// It is retracted, so that it looks nowhere.
    pub retracted: bool,
    /// It stands or moves to its neutral position.
    pub neutral: bool,
    /// Rates about its y and z axis, rad/s, where it reports them.
    pub rates: Option<[f64; 2]>,
    /// How fast it has turned since its report before, rad/s; 0 where that is not known. PX4 reports rates of 0 for the gimbals that it
    /// drives itself, and many devices report none.
    pub turn_rate: f64,
    /// The vehicle's time since boot when it came, ms, where the vehicle had shown it. The gimbal's own clock may be another
    /// one, which nothing compares with the vehicle's.
    pub vehicle_ms: Option<u32>,
}

impl GimbalAttitude {
    /// Whether it was so at this time of the vehicle since boot, ms: it came about then, and has hardly turned in between by the larger
    /// of what it reports and what its last two reports show.
    #[must_use]
    pub fn is_of(&self, boot_ms: u32) -> bool {
        let Some(vehicle_ms) = self.vehicle_ms else {
            return false;
        };
        let gap_ms = span_ms(vehicle_ms, boot_ms).unsigned_abs();
        let rate = self.rates.map_or(0.0, |[y, z]| y.hypot(z));
        let rate = rate.max(self.turn_rate);
        gap_ms <= MAX_GAP_MS && rate * f64::from(gap_ms) / 1e3 <= STILL_RAD
    }

    /// How fast its line of sight has turned since the report before, rad/s; 0 where the two turn from different frames.
    pub(super) fn rate_since(&self, before: &GimbalAttitude) -> f64 {
        let span = before.vehicle_ms.zip(self.vehicle_ms);
        let Some((from, to)) = span.filter(|_| self.frame == before.frame) else {
            return 0.0;
        };
        // The chord, and not the angle: of two equal quaternions of a length other than 1 it is 0.
        let [x, y, z] = forward(self.q);
        let [old_x, old_y, old_z] = forward(before.q);
        let chord = (x - old_x).hypot(y - old_y).hypot(z - old_z);
        chord * 1e3 / f64::from(span_ms(from, to).max(MIN_SPAN_MS))
    }
}

/// Where a sensor looks, relative to the vehicle's body, rad.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Direction {
    /// Right of the x axis, -pi to pi.
    pub azimuth: f64,
    /// Above the waterline, -pi/2 to pi/2.
    pub elevation: f64,
}

/// The centre of an image on the ground.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Footprint {
    /// Where; the altitude is that of the ground, AMSL.
    pub place: Place,
    /// Distance from the vehicle to it, m.
    pub range_m: f64,
}

/// The unit vector along which a sensor looks: north, east, down.
pub type LineOfSight = [f64; 3];

/// Along what a gimbal looks. `vehicle`: the attitude of what carries it.
#[must_use]
pub fn line_of_sight(gimbal: &GimbalAttitude, vehicle: &Attitude) -> LineOfSight {
    let along = forward(gimbal.q);
    match gimbal.frame {
        Frame::North => along,
        Frame::Heading => turn(along, [0.0, 0.0, vehicle.yaw]),
        Frame::Body => turn(along, [vehicle.roll, vehicle.pitch, vehicle.yaw]),
    }
}

/// The line of sight of a sensor that looks in this direction.
#[must_use]
pub fn sight_of(direction: Direction, vehicle: &Attitude) -> LineOfSight {
    let (sin_a, cos_a) = direction.azimuth.sin_cos();
    let (sin_e, cos_e) = direction.elevation.sin_cos();
    let body = [cos_e * cos_a, cos_e * sin_a, -sin_e];
    turn(body, [vehicle.roll, vehicle.pitch, vehicle.yaw])
}

/// A line of sight as the DLI has it: relative to the vehicle's body.
#[must_use]
pub fn direction(sight: LineOfSight, vehicle: &Attitude) -> Direction {
    let [x, y, z] = turn_back(sight, [vehicle.roll, vehicle.pitch, vehicle.yaw]);
    Direction {
        azimuth: y.atan2(x),
        elevation: (-z).clamp(-1.0, 1.0).asin(),
    }
}

/// The line of sight from one place to another.
#[must_use]
pub fn sight_to(from: Place, to: Place) -> LineOfSight {
    let (north, east) = offset_m(from, to);
    let down = from.amsl_m - to.amsl_m;
    let length = (north * north + east * east + down * down).sqrt().max(1e-6);
    [north / length, east / length, down / length]
}

/// The attitude, w first, of a gimbal with a level horizon that looks along this, from north.
#[must_use]
pub fn looking_along([north, east, down]: LineOfSight) -> [f64; 4] {
    quaternion([0.0, (-down).clamp(-1.0, 1.0).asin(), east.atan2(north)])
}

/// The quaternion, w first, of roll, pitch and yaw.
#[must_use]
pub fn quaternion(angles: [f64; 3]) -> [f64; 4] {
    let [(sr, cr), (sp, cp), (sy, cy)] = angles.map(|angle| (angle / 2.0).sin_cos());
    [
        cr * cp * cy + sr * sp * sy,
        sr * cp * cy - cr * sp * sy,
        cr * sp * cy + sr * cp * sy,
        cr * cp * sy - sr * sp * cy,
    ]
}

/// The angle between two lines of sight, rad.
#[must_use]
pub fn between(one: LineOfSight, other: LineOfSight) -> f64 {
    let dot: f64 = one.iter().zip(other).map(|(a, b)| a * b).sum();
    dot.clamp(-1.0, 1.0).acos()
}

/// Where the line of sight meets flat ground of this altitude; `None` where it does not within [`MAX_RANGE_M`]. The earth's
/// curvature counts: 8 m at 10 km, which at a shallow angle is hundreds of metres along the ground.
#[must_use]
pub fn on_flat_ground(from: Place, sight: LineOfSight, ground_amsl_m: f64) -> Option<Footprint> {
    let [north, east, down] = sight;
    let height = from.amsl_m - ground_amsl_m;
    if height <= 0.0 {
        return None;
    }
    let along_sq = north * north + east * east;
    let root = down * down - 2.0 * height * along_sq / EARTH_M;
    if down <= 0.0 || root < 0.0 {
        return None;
    }
    // The form of the quadratic's root that is exact straight down too.
    let range_m = 2.0 * height / (down + root.sqrt());
    (range_m <= MAX_RANGE_M).then(|| footprint(from, sight, range_m, ground_amsl_m))
}

/// Where the line of sight meets the terrain; `ground` gives the height AMSL at degrees north and east, none where it is not
/// known. `None` too where the terrain ends before it is met: what lies beyond may be a hill.
#[must_use]
pub fn on_terrain(
    from: Place,
    sight: LineOfSight,
    spacing_m: f64,
    ground: impl Fn(f64, f64) -> Option<f64>,
) -> Option<Footprint> {
    let above = |range_m: f64| {
        let at = along(from, sight, range_m);
        ground(at.latitude, at.longitude).map(|height| (at.amsl_m - height, height))
    };
    if above(0.0)?.0 <= 0.0 {
        return None;
    }
    let step = spacing_m.max(MIN_STEP_M);
    let mut before = 0.0;
    loop {
        let range = before + step;
        if range > MAX_TERRAIN_RANGE_M {
            return None;
        }
        if above(range)?.0 <= 0.0 {
            let (mut over, mut under) = (before, range);
            for _ in 0..HALVINGS {
                let middle = f64::midpoint(over, under);
                if above(middle)?.0 > 0.0 {
                    over = middle;
                } else {
                    under = middle;
                }
            }
            let (_, height) = above(under)?;
            return Some(footprint(from, sight, under, height));
        }
        before = range;
    }
}

fn footprint(from: Place, sight: LineOfSight, range_m: f64, amsl_m: f64) -> Footprint {
    Footprint {
        place: Place {
            amsl_m,
            ..along(from, sight, range_m)
        },
        range_m,
    }
}

/// The place at a distance along a line of sight, above a round earth.
fn along(from: Place, [north, east, down]: LineOfSight, range_m: f64) -> Place {
    let level_m = range_m * north.hypot(east);
    let start = (from.latitude, from.longitude);
    let (latitude, longitude) = moved(start, east.atan2(north), level_m);
    Place {
        latitude,
        longitude,
        amsl_m: from.amsl_m - range_m * down + level_m * level_m / (2.0 * EARTH_M),
    }
}

/// Metres north and east of one place to another, for distances at which a sensor sees anything.
#[must_use]
pub fn offset_m(from: Place, to: Place) -> (f64, f64) {
    let east_deg = (to.longitude - from.longitude + 540.0).rem_euclid(360.0) - 180.0;
    let middle = f64::midpoint(from.latitude, to.latitude).to_radians();
    (
        (to.latitude - from.latitude).to_radians() * EARTH_M,
        east_deg.to_radians() * EARTH_M * middle.cos(),
    )
}

/// Roll, pitch and yaw of a quaternion, w first.
#[must_use]
pub fn euler([w, x, y, z]: [f64; 4]) -> [f64; 3] {
    [
        (2.0 * (w * x + y * z)).atan2(1.0 - 2.0 * (x * x + y * y)),
        (2.0 * (w * y - z * x)).clamp(-1.0, 1.0).asin(),
        (2.0 * (w * z + x * y)).atan2(1.0 - 2.0 * (y * y + z * z)),
    ]
}

fn forward([w, x, y, z]: [f64; 4]) -> [f64; 3] {
    [
        1.0 - 2.0 * (y * y + z * z),
        2.0 * (x * y + w * z),
        2.0 * (x * z - w * y),
    ]
}

/// A vector of a body with this roll, pitch and yaw, in the frame that those turn from.
fn turn([x, y, z]: [f64; 3], [roll, pitch, yaw]: [f64; 3]) -> [f64; 3] {
    let ((sr, cr), (sp, cp), (sy, cy)) = (roll.sin_cos(), pitch.sin_cos(), yaw.sin_cos());
    let (y, z) = (cr * y - sr * z, sr * y + cr * z);
    let (x, z) = (cp * x + sp * z, -sp * x + cp * z);
    [cy * x - sy * y, sy * x + cy * y, z]
}

/// The reverse.
fn turn_back([x, y, z]: [f64; 3], [roll, pitch, yaw]: [f64; 3]) -> [f64; 3] {
    let ((sr, cr), (sp, cp), (sy, cy)) = (roll.sin_cos(), pitch.sin_cos(), yaw.sin_cos());
    let (x, y) = (cy * x + sy * y, -sy * x + cy * y);
    let (x, z) = (cp * x - sp * z, sp * x + cp * z);
    [x, cr * y + sr * z, -sr * y + cr * z]
}

/// The period of a gimbal that reports once a second, as PX4 has it on a radio, and a half.
const MAX_GAP_MS: u32 = 1_500;
/// The period of a gimbal that reports 50 times a second: a radio may deliver two reports at once.
const MIN_SPAN_MS: i32 = 20;
/// Farthest footprint: Reported Range ends there (0302.21).
pub const MAX_RANGE_M: f64 = 100_000.0;
/// Farther the terrain is not searched: 600 steps of the finest grids.
const MAX_TERRAIN_RANGE_M: f64 = 30_000.0;
const MIN_STEP_M: f64 = 10.0;
const HALVINGS: u32 = 8;
const EARTH_M: f64 = 6_371_000.0;

#[cfg(test)]
mod tests {
    use super::*;

    const HERE: Place = Place {
        latitude: 47.4,
        longitude: 8.5,
        amsl_m: 588.0,
    };

    fn vehicle(roll: f64, pitch: f64, yaw: f64) -> Attitude {
        Attitude {
            roll: roll.to_radians(),
            pitch: pitch.to_radians(),
            yaw: yaw.to_radians(),
            roll_rate: 0.0,
            pitch_rate: 0.0,
            yaw_rate: 0.0,
        }
    }

    fn quaternion(pitch: f64, yaw: f64) -> [f64; 4] {
        let ((sp, cp), (sy, cy)) = (
            (pitch.to_radians() / 2.0).sin_cos(),
            (yaw.to_radians() / 2.0).sin_cos(),
        );
        [cp * cy, -sp * sy, sp * cy, cp * sy]
    }

    fn gimbal(frame: Frame, pitch: f64, yaw: f64) -> GimbalAttitude {
        GimbalAttitude {
            q: quaternion(pitch, yaw),
            frame,
            retracted: false,
            neutral: false,
            rates: None,
            turn_rate: 0.0,
            vehicle_ms: None,
        }
    }

    #[test]
    fn a_gimbal_of_each_frame_shows_the_same_direction() {
        let flying = vehicle(0.0, 0.0, 90.0);
        for (frame, yaw) in [
            (Frame::North, 120.0),
            (Frame::Heading, 30.0),
            (Frame::Body, 30.0),
        ] {
            let sight = line_of_sight(&gimbal(frame, -40.0, yaw), &flying);
            let Direction { azimuth, elevation } = direction(sight, &flying);
            assert!(
                (azimuth.to_degrees() - 30.0).abs() < 1e-9,
                "{frame:?} {azimuth}"
            );
            assert!(
                (elevation.to_degrees() + 40.0).abs() < 1e-9,
                "{frame:?} {elevation}"
            );
        }
    }

    #[test]
    fn a_gimbal_stands_for_another_moment_only_where_it_has_hardly_turned() {
        let of = |vehicle_ms, rates| {
            let gimbal = GimbalAttitude {
                vehicle_ms,
                rates,
                ..gimbal(Frame::Body, -40.0, 0.0)
            };
            gimbal.is_of(20_000)
        };
        assert!(!of(None, None), "the vehicle has shown no time");
        for (vehicle_ms, still) in [
            (18_499, false),
            (18_500, true),
            (21_500, true),
            (21_501, false),
        ] {
            assert_eq!(of(Some(vehicle_ms), None), still, "{vehicle_ms}");
            assert_eq!(of(Some(vehicle_ms), Some([0.0; 2])), still, "{vehicle_ms}");
        }
        // A turn of 0.25 rad/s is one of 3 degrees in 0.2 s.
        assert!(of(Some(19_800), Some([0.15, -0.2])));
        assert!(!of(Some(19_700), Some([0.15, -0.2])));
        assert!(of(Some(20_000), Some([1.0, 1.0])));
        // The same turn, of a gimbal that reports rates of 0.
        for (vehicle_ms, still) in [(19_800, true), (19_700, false)] {
            let gimbal = GimbalAttitude {
                turn_rate: 0.25,
                rates: Some([0.0; 2]),
                vehicle_ms: Some(vehicle_ms),
                ..gimbal(Frame::Body, -40.0, 0.0)
            };
            assert_eq!(gimbal.is_of(20_000), still, "{vehicle_ms}");
        }
    }

    #[test]
    fn two_reports_of_a_gimbal_show_how_fast_it_turns() {
        let at = |vehicle_ms: u32, frame, yaw: f64| GimbalAttitude {
            vehicle_ms: Some(vehicle_ms),
            ..gimbal(frame, 0.0, yaw)
        };
        let before = at(10_000, Frame::Body, 0.0);
        let rate_deg_s = |now: GimbalAttitude| now.rate_since(&before).to_degrees().round();
        assert_eq!(rate_deg_s(at(10_200, Frame::Body, 5.0)), 25.0);
        assert_eq!(rate_deg_s(at(11_000, Frame::Body, -5.0)), 5.0);
        assert_eq!(rate_deg_s(at(10_000, Frame::Body, 1.0)), 50.0, "at once");
        // In another frame nothing is known of it, nor where the vehicle has shown no time.
        assert_eq!(rate_deg_s(at(10_200, Frame::North, 5.0)), 0.0);
        assert_eq!(rate_deg_s(gimbal(Frame::Body, 0.0, 5.0)), 0.0);
        // A quaternion of a length other than 1 does not turn it.
        let longer = |vehicle_ms| {
            let one = at(vehicle_ms, Frame::Body, 30.0);
            GimbalAttitude {
                q: one.q.map(|part| part * 1.01),
                ..one
            }
        };
        assert!(longer(10_020).rate_since(&longer(10_000)) < 1e-9);
    }

    #[test]
    fn a_banked_vehicle_sees_the_horizon_off_its_waterline() {
        // Looking right along the horizon, 20 degrees right wing down: that is 20 degrees above the right wing.
        let banked = vehicle(20.0, 0.0, 0.0);
        let sight = line_of_sight(&gimbal(Frame::Heading, 0.0, 90.0), &banked);
        let seen = direction(sight, &banked);
        assert!((seen.azimuth.to_degrees() - 90.0).abs() < 1e-9, "{seen:?}");
        assert!(
            (seen.elevation.to_degrees() - 20.0).abs() < 1e-9,
            "{seen:?}"
        );
        let back = sight_of(seen, &banked);
        assert!(between(sight, back) < 1e-7);
    }

    #[test]
    fn a_footprint_is_where_a_ray_meets_flat_ground() {
        let level = vehicle(0.0, 0.0, 0.0);
        let down = line_of_sight(&gimbal(Frame::North, -90.0, 0.0), &level);
        let below = on_flat_ground(HERE, down, 488.0).expect("ground");
        assert!((below.range_m - 100.0).abs() < 1e-6, "{below:?}");
        let east = line_of_sight(&gimbal(Frame::North, -45.0, 90.0), &level);
        let print = on_flat_ground(HERE, east, 488.0).expect("ground");
        let (north_m, east_m) = offset_m(HERE, print.place);
        assert!(
            north_m.abs() < 0.1 && (east_m - 100.0).abs() < 0.3,
            "{north_m} {east_m}"
        );
        assert!((print.range_m - 141.42).abs() < 0.01);
        let along = forward(looking_along(east));
        assert!(between(along, east) < 1e-7, "{along:?}");
        // And it is where one would look to see that place.
        assert!(between(sight_to(HERE, print.place), east).to_degrees() < 0.2);
    }

    #[test]
    fn above_the_horizon_or_below_the_ground_nothing_is_met() {
        let level = vehicle(0.0, 0.0, 0.0);
        let up = line_of_sight(&gimbal(Frame::North, 10.0, 0.0), &level);
        assert_eq!(on_flat_ground(HERE, up, 488.0), None);
        let down = line_of_sight(&gimbal(Frame::North, -30.0, 0.0), &level);
        assert_eq!(on_flat_ground(HERE, down, 600.0), None);
        // Shallower than the horizon dips.
        let shallow = line_of_sight(&gimbal(Frame::North, -0.1, 0.0), &level);
        assert_eq!(on_flat_ground(HERE, shallow, 488.0), None);
    }

    #[test]
    fn a_hill_is_met_before_the_plain_behind_it_and_unknown_ground_meets_nothing() {
        let level = vehicle(0.0, 0.0, 0.0);
        let north = line_of_sight(&gimbal(Frame::North, -10.0, 0.0), &level);
        // A wall of 80 m, 200 m north.
        let wall = HERE.latitude + 200.0 / 111_195.0;
        let ground = |latitude: f64, _| Some(if latitude > wall { 568.0 } else { 488.0 });
        let print = on_terrain(HERE, north, 10.0, ground).expect("the hill");
        assert!((print.range_m - 203.0).abs() < 12.0, "{print:?}");
        assert_eq!(print.place.amsl_m, 568.0);
        let gap = |latitude: f64, _| (latitude < wall).then_some(488.0);
        assert_eq!(on_terrain(HERE, north, 10.0, gap), None);
    }
}
