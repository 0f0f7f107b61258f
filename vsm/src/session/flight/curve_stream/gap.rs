//! How far the vehicle is from where it should be, and what is done about it.
//!
//! PX4 holds a vehicle against wind and its own drag by an integral in fixed directions. In a bend these forces turn faster
//! than that follows (MPC_XY_VEL_I_ACC), and the vehicle is carried outwards, in proportion to them and to its lateral
//! acceleration. So the set points move to the other side, and are slower where that is not enough.

use std::time::Duration;

use curve_paths::flight::Along;
use curve_paths::vector::Vec3;

use super::way::shifted;

/// The gap, and the correction so far.
#[derive(Debug, Default)]
pub(super) struct Gap {
    /// To the right of the track, and behind on it, m.
    right_m: f64,
    pub(super) late_m: f64,
    /// How fast the gap to the right grows, m/s.
    drift_mps: f64,
    /// By how much the set points are moved to the right, m.
    moved_m: f64,
    at: Option<Duration>,
}

impl Gap {
    /// A position, measured at this time.
    pub(super) fn note(&mut self, at: Duration, right_m: f64, late_m: f64) {
        let before = self.at.replace(at);
        let span_s = before.map_or(0.0, |before| at.saturating_sub(before).as_secs_f64());
        self.moved_m -= MOVES_PER_S * right_m * span_s.min(1.0);
        self.moved_m = self.moved_m.clamp(-MOVED_M, MOVED_M);
        if span_s > 0.0 {
            // Two positions may be stamped closer than they were measured.
            let drift_mps = (right_m - self.right_m) / span_s;
            self.drift_mps = drift_mps.clamp(-DRIFTS_MPS, DRIFTS_MPS);
        }
        (self.right_m, self.late_m) = (right_m, late_m);
    }

    /// The part of its speed that a vehicle with this gap should have.
    pub(super) fn pace(&self, tolerance_m: f64, speed_mps: f64) -> f64 {
        // Where it will be soon: a vehicle needs seconds to slow down.
        let right_m = self.right_m + SOON_S * self.drift_mps;
        let beside = right_m.abs() / (BESIDE_PART * (tolerance_m + OVER_M));
        let behind = (self.late_m - BEHIND_M).max(0.0) / (BEHIND_M + BEHIND_S * speed_mps);
        (1.6 - 0.6 * beside.max(behind)).clamp(SLOWEST_PART, 1.0)
    }

    /// The place to command for the vehicle to be at this one.
    pub(super) fn correct(&self, along: Along) -> Along {
        let back_m = BACK_PART * self.right_m + BACK_S * self.drift_mps;
        let aside = right(along.forward) * (self.moved_m - back_m);
        Along {
            position: shifted(along.position, aside),
            ..along
        }
    }
}

/// To the right of a direction.
pub(super) fn right(forward: Vec3) -> Vec3 {
    Vec3::new(forward.y, -forward.x, 0.0).unit()
}

/// By this part of a gap to one side the set points move to the other within a second, up to `MOVED_M`, and by this at once.
const MOVES_PER_S: f64 = 0.7;
const BACK_PART: f64 = 0.5;
const BACK_S: f64 = 0.3;
const SOON_S: f64 = 0.8;
const DRIFTS_MPS: f64 = 2.0;
const MOVED_M: f64 = 3.0;
/// A vehicle that is further to a side than this part of what ends the stream, or behind by more than these, is waited for.
const BESIDE_PART: f64 = 0.35;
const BEHIND_M: f64 = 0.5;
const BEHIND_S: f64 = 0.2;
const SLOWEST_PART: f64 = 0.3;
/// Metres over the tolerance at which the vehicle is handed back.
pub(super) const OVER_M: f64 = 0.3;

#[cfg(test)]
mod tests {
    use curve_paths::Position;

    use super::*;

    const SECOND: Duration = Duration::from_secs(1);

    fn north() -> Along {
        Along {
            position: Position::new(47.0, 8.0, 430.0),
            forward: Vec3::new(0.0, 1.0, 0.0),
            bend: Vec3::ZERO,
            fastest_mps: 5.0,
        }
    }

    #[test]
    fn a_vehicle_to_the_right_is_commanded_to_the_left_and_more_so_the_longer_it_stays() {
        let mut gap = Gap::default();
        let mut before_deg = north().position.lon_deg;
        for k in 1..5 {
            gap.note(SECOND * k, 0.4, 0.0);
            let lon_deg = gap.correct(north()).position.lon_deg;
            assert!(lon_deg < before_deg, "{k}");
            before_deg = lon_deg;
        }
        (5..100).for_each(|k| gap.note(SECOND * k, 1.0, 0.0));
        let moved_m = (8.0 - gap.correct(north()).position.lon_deg) * 76_056.0;
        assert!((moved_m - 3.5).abs() < 0.05, "{moved_m}");
    }

    #[test]
    fn who_is_beside_or_behind_is_waited_for() {
        let pace = |right_m: f64, late_m: f64| {
            let mut gap = Gap::default();
            gap.note(SECOND, right_m, late_m);
            gap.pace(1.0, 5.0)
        };
        assert_eq!(pace(0.2, 0.5), 1.0);
        assert!(pace(-0.8, 0.0) < 0.9 && pace(0.0, 3.0) < 0.8);
        assert_eq!(pace(5.0, 0.0), SLOWEST_PART);
    }
}
