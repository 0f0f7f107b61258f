//! The track of a run of curves: from the vehicle to P1, the curves, some way behind P4; and the set points along it.

use curve_paths::flight::{Along, Track, TrackLeg, offset_m};
use curve_paths::vector::Vec3;
use curve_paths::{Leg, Position};
use mapping::route::{StreamedLeg, StreamedRun};
use mapping::telemetry::Place;
use mavlink_link::dialect::{
    MavFrame, MavMessage, PositionTargetTypemask, SET_POSITION_TARGET_GLOBAL_INT_DATA,
};

/// The place that a vehicle reaches in this time, s; velocity north, east, down.
pub(super) fn moved(place: Place, [north, east, down]: [f64; 3], after_s: f64) -> Position {
    let at = Position::new(place.latitude, place.longitude, place.amsl_m);
    shifted(at, Vec3::new(east, north, -down) * after_s)
}

/// The place so many metres east, north and up of another.
pub(super) fn shifted(at: Position, by: Vec3) -> Position {
    let beyond = Position::new(at.lat_deg + DEGREE, at.lon_deg + DEGREE, at.alt_m);
    let unit = offset_m(at, beyond);
    Position::new(
        at.lat_deg + DEGREE * by.y / unit.y,
        at.lon_deg + DEGREE * by.x / unit.x,
        at.alt_m + by.z,
    )
}

/// The altitude to which a leg's are relative, m above mean sea level.
pub(super) fn base_m(leg: &StreamedLeg, home: Place) -> f64 {
    if leg.above_home { home.amsl_m } else { 0.0 }
}

pub(super) fn raised(place: Position, by_m: f64) -> Position {
    Position {
        alt_m: place.alt_m + by_m,
        ..place
    }
}

/// From where the vehicle is to the first P1, the curves, and some way behind the last P4.
pub(super) fn legs(run: &StreamedRun, from: Position, home: Place) -> Vec<TrackLeg> {
    let speed = |leg: Option<&StreamedLeg>| leg.map_or(0.0, |leg| leg.speed_m_s);
    let (first, last) = (run.legs.first(), run.legs.last());
    let line = |from, to, speed_mps| TrackLeg {
        leg: Leg::Straight { from, to },
        raised_m: 0.0,
        speed_mps,
    };
    let end = |leg: &StreamedLeg, place| raised(place, base_m(leg, home));
    let way_in = first.map(|leg| line(from, end(leg, leg.curve.p1()), speed(first)));
    let curves = run.legs.iter().map(|leg| TrackLeg {
        leg: Leg::Bezier(leg.curve),
        raised_m: base_m(leg, home),
        speed_mps: leg.speed_m_s,
    });
    let way_out = last.zip(run.exit).map(|(leg, (ground, level))| {
        let from = end(leg, leg.curve.p4());
        let to = Position::new(ground.lat_deg, ground.lon_deg, level.amsl(home.amsl_m));
        let part = (WAY_OUT_M / offset_m(from, to).norm()).min(1.0);
        let to = Position::new(
            from.lat_deg + part * (to.lat_deg - from.lat_deg),
            from.lon_deg + part * (to.lon_deg - from.lon_deg),
            from.alt_m + part * (to.alt_m - from.alt_m),
        );
        line(from, to, speed(last))
    });
    way_in.into_iter().chain(curves).chain(way_out).collect()
}

/// From where on which item is the mission's current one.
pub(super) fn marks(run: &StreamedRun, track: &Track) -> Vec<(f64, u16)> {
    let mut marks = Vec::new();
    // The item of P1, which is the P4 before.
    let mut begins = run.entry;
    for (leg, ends) in run.legs.iter().zip(track.ends_m().windows(2)) {
        let [mut from_m, to_m] = [ends[0], ends[1]];
        marks.push((from_m, begins.saturating_add(1)));
        begins = leg.end;
        for (ground, next) in &leg.vertices {
            let at = |s_m: f64| track.at(s_m).map(|along| along.position);
            let chord_m = at(from_m).map_or(0.0, |here| here.ground().distance_m(*ground));
            let place = Position::new(
                ground.lat_deg,
                ground.lon_deg,
                at(from_m + chord_m).map_or(0.0, |there| there.alt_m),
            );
            // A chord is nearly as long as its part of the curve, which may cross itself further on.
            let within_m = (from_m + 1.5 * chord_m + 2.0).min(to_m);
            if let Some((s_m, _)) = track.nearest(place, from_m, within_m) {
                from_m = s_m.max(from_m);
                marks.push((from_m, *next));
            }
        }
    }
    // Without a way on, the mission completes P4 itself.
    let end_m = track.ends_m().get(run.legs.len());
    marks.extend(end_m.zip(run.exit).map(|(end_m, _)| (*end_m, run.resume)));
    marks
}

#[expect(
    deprecated,
    reason = "PX4 v1.18 takes MAV_FRAME_GLOBAL_INT, and not its synonym that replaces it"
)]
pub(super) fn set_point(along: &Along, speed_mps: f64, accel: f64, system: u8) -> MavMessage {
    let Along {
        position,
        forward,
        bend,
        ..
    } = *along;
    let velocity = forward * speed_mps;
    let acceleration = forward * accel + bend * (speed_mps * speed_mps);
    let e7 = |degrees: f64| (degrees * 1e7).round() as i32;
    let message = SET_POSITION_TARGET_GLOBAL_INT_DATA {
        target_system: system,
        target_component: AUTOPILOT,
        // Above mean sea level. In the frame above home PX4 v1.18 exchanges a sign (mavlink_receiver.cpp), and would dive.
        coordinate_frame: MavFrame::MAV_FRAME_GLOBAL_INT,
        type_mask: PositionTargetTypemask::from_bits_retain(WITHOUT_YAW_RATE),
        lat_int: e7(position.lat_deg),
        lon_int: e7(position.lon_deg),
        alt: position.alt_m as f32,
        vx: velocity.y as f32,
        vy: velocity.x as f32,
        // Down is positive.
        vz: -velocity.z as f32,
        afx: acceleration.y as f32,
        afy: acceleration.x as f32,
        afz: -acceleration.z as f32,
        yaw: forward.x.atan2(forward.y) as f32,
        ..SET_POSITION_TARGET_GLOBAL_INT_DATA::default()
    };
    MavMessage::SET_POSITION_TARGET_GLOBAL_INT(message)
}

/// The set points continue this far behind the last P4 while PX4 is handed back, m: enough at 10 m/s for 3 s and to brake.
const WAY_OUT_M: f64 = 80.0;
/// Ignore the yaw rate only.
const WITHOUT_YAW_RATE: u16 = 0x800;
const AUTOPILOT: u8 = 1;
/// A small angle, degrees.
const DEGREE: f64 = 1e-3;
