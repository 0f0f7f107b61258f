//! The set points of a stream: how far along the track each one is, and how fast.

use std::time::Duration;

use curve_paths::vector::Vec3;

use super::way::set_point;
use super::{Flown, LOOKS_BACK_M, Stage, StreamContext, here};
use crate::session::effects::Effects;

impl Flown {
    /// Sends the set point that is due.
    pub(super) fn stream(&mut self, context: &StreamContext<'_>, effects: &mut Effects<'_>) {
        let now = context.now;
        if self.due > now {
            return;
        }
        // A longer gap is not made up for.
        let span_s = now.saturating_sub(self.last).as_secs_f64().min(MAX_SPAN_S);
        self.last = now;
        self.due = if self.due + PERIOD > now {
            self.due + PERIOD
        } else {
            now + PERIOD
        };
        let follows = matches!(
            self.stage,
            Stage::Entering | Stage::Leaving { entered: false, .. }
        );
        if follows {
            self.follow(context);
        } else {
            self.proceed(span_s, context);
        }
        let passed = self
            .marks
            .partition_point(|(from_m, _)| *from_m <= self.s_m);
        if self.stage == Stage::Streaming && passed > self.passed {
            self.passed = passed;
            self.set_current(context, effects);
        }
        let lead_m = self.v_mps * LEAD_S;
        if let Some(along) = self.track.at(self.s_m + lead_m) {
            let along = self.gap.correct(along);
            let message = set_point(&along, self.v_mps, self.accel, context.system);
            effects.vehicle.post(message);
        }
    }

    /// Keeps beside the vehicle, which is not steered yet, and as fast as it is.
    fn follow(&mut self, context: &StreamContext<'_>) {
        let (Some(place), Some([north, east, down])) = (here(context), context.velocity) else {
            return;
        };
        let (from_m, to_m) = (self.s_m - LOOKS_BACK_M, self.s_m + FOLLOWS_M);
        if let Some((s_m, _)) = self.track.nearest(place, from_m, to_m) {
            self.s_m = self.s_m.max(s_m);
        }
        if let Some(along) = self.track.at(self.s_m) {
            let flown = Vec3::new(east, north, -down).dot(along.forward).max(0.0);
            self.v_mps = flown.min(along.fastest_mps.max(BEGINS_MPS));
        }
        self.accel = 0.0;
    }

    /// One step along the track.
    fn proceed(&mut self, span_s: f64, context: &StreamContext<'_>) {
        let brakes = matches!(self.stage, Stage::Leaving { .. });
        let fastest = self
            .track
            .at(self.s_m)
            .map_or(0.0, |along| along.fastest_mps);
        let fastest = fastest * self.gap.pace(context.curving.tolerance_m, self.v_mps);
        let wanted = match (brakes, context.commanded_mps) {
            (true, _) => 0.0,
            (false, Some(cap)) => fastest.min(cap),
            (false, None) => fastest,
        };
        let quicker = self.limits.acceleration * self.limits.corner_gain * span_s;
        let slower = self.limits.acceleration * span_s;
        let before = self.v_mps;
        self.v_mps += (wanted - before).clamp(-slower, quicker);
        self.accel = if span_s > 0.0 {
            (self.v_mps - before) / span_s
        } else {
            0.0
        };
        self.s_m = (self.s_m + 0.5 * (before + self.v_mps) * span_s).min(self.track.length_m());
    }
}

/// Set points: PX4 needs 2 a second, and flies the last one until the next.
const PERIOD: Duration = Duration::from_millis(50);
const MAX_SPAN_S: f64 = 0.2;
/// A set point is for the middle of the time in which it is flown, and some milliseconds on its way, s.
const LEAD_S: f64 = 0.035;
/// A vehicle that has just begun its leg gets on, m/s.
const BEGINS_MPS: f64 = 0.5;
const FOLLOWS_M: f64 = 8.0;
