//! Whether a stream begins: the vehicle flies to the first P1 of a run, near enough to enter the mode and to brake for a corner.

use curve_paths::flight::{Track, offset_m};
use curve_paths::vector::Vec3;
use mapping::mode::Px4Mode;
use mapping::route::stream_permitted;

use super::gap::Gap;
use super::way::{base_m, legs, marks, raised};
use super::{CurveStream, Flown, Order, Stage, StreamContext, here};
use crate::session::effects::Effects;

impl CurveStream {
    /// Begins the stream where the vehicle flies to the first P1 of a run and is near enough.
    pub(super) fn begin(
        &mut self,
        context: &StreamContext<'_>,
        effects: &mut Effects<'_>,
    ) -> Option<Order> {
        let (runs, mission_id) = context.runs?;
        let busy = context.maneuver || context.transferring || context.busy;
        if context.mode != Some(Px4Mode::MISSION) || busy {
            return None;
        }
        let mission = context
            .mission
            .filter(|mission| mission.mission_id == mission_id)?;
        let run = runs.iter().find(|run| run.entry == mission.seq);
        let Some(run) = run else {
            // It may come by again.
            self.reported = None;
            return None;
        };
        let key = (mission_id, run.entry);
        if self.reported == Some(key) {
            return None;
        }
        let (place, [north, east, down], home) = (here(context)?, context.velocity?, context.home?);
        let (first, last) = (run.legs.first()?, run.legs.last()?);
        let ahead = offset_m(place, raised(first.curve.p1(), base_m(first, home)));
        let speed = north.hypot(east);
        let distance_m = ahead.x.hypot(ahead.y);
        // Room to enter the mode, and to brake for a corner at P1.
        let limits = context.curving.multicopter;
        let brake = limits.acceleration * limits.corner_gain;
        let needed_m = ENTERS_WITHIN_S * speed + speed * speed / (2.0 * brake);
        if distance_m > NEAR_M + needed_m + ENTERS_WITHIN_S * speed {
            return None;
        }
        let straight = speed < SLOW_MPS
            || Vec3::new(east, north, -down).unit().dot(ahead.unit()) > ON_LINE_COS;
        // It may still be turning towards P1.
        if !straight && distance_m > needed_m {
            return None;
        }
        self.reported = Some(key);
        let names = (first.ends.0, last.ends.1);
        let track = Track::new(&legs(run, place, home), &limits);
        let soon = track.at((ENTERS_WITHIN_S * speed).min(distance_m));
        let permitted = stream_permitted(context.parameters).and_then(|()| {
            if !straight {
                Err("the vehicle does not fly straight to the first point".to_owned())
            } else if soon.is_none_or(|along| along.fastest_mps + SLOW_MPS < speed) {
                Err("the vehicle is too fast, so near to the first point".to_owned())
            } else {
                Ok(())
            }
        });
        if let Err(why) = permitted {
            effects.advise(format!(
                "curves {} to {} are flown as chords, not streamed: {why}",
                names.0, names.1
            ));
            return None;
        }
        let marks = marks(run, &track);
        let end_m = track.ends_m().get(run.legs.len()).copied()?;
        let mut flown = Flown {
            entry: run.entry,
            mission_id,
            s_m: 0.0,
            v_mps: speed,
            accel: 0.0,
            due: context.now,
            last: context.now,
            stage: Stage::Entering,
            marks,
            passed: 0,
            // Without a way on the mission completes P4 where the vehicle has stopped.
            end_m: if run.exit.is_some() {
                end_m
            } else {
                end_m - ARRIVED_M
            },
            seen: None,
            gap: Gap::default(),
            set_at: None,
            names,
            limits,
            track,
        };
        // PX4 refuses OFFBOARD without set points.
        flown.advance(context, effects);
        self.flown = Some(Box::new(flown));
        Some(Order::Enter)
    }
}

/// Until PX4 is in OFFBOARD and has reported it, s: CURRENT_MODE comes at 5 Hz.
const ENTERS_WITHIN_S: f64 = 1.5;
/// A vehicle this near to P1 is streamed to however slow it is, m; nearer than that it is not.
const NEAR_M: f64 = 5.0;
/// The direction of a slower one means nothing, m/s.
const SLOW_MPS: f64 = 1.0;
/// It flies to P1 within 20 degrees.
const ON_LINE_COS: f64 = 0.94;
/// A vehicle this near to the end of the track has arrived, m.
const ARRIVED_M: f64 = 0.1;
