//! The descent watch: a vehicle that sinks towards the ground in its mission is put on hold, with an alert (16000).
//!
//! A route below home is refused, so the lowest altitude of a loaded mission is known to be safe. A vehicle that is well
//! below it and still sinking has a fault: a fixed wing with a wrong altitude reference dives in AUTO.MISSION (PX4's own
//! simulation does after a take-off from 489 m), and a multicopter without enough thrust sinks; PX4 reports neither. Not
//! checked: a landing item of the route, and a mission that another station has loaded.
//!
//! What "well below" means:
//!
//! - *multicopter*, 5 m: where a leg climbs PX4 v1.18 swings about the altitude of its item, by up to 4 m above and 1 m below
//!   (docs/guide/curves.md); the whole of it counts, since nothing keeps a heavier one from swinging as far down;
//! - *wings*, 20 m: they trade height for speed in gusts and turns, and a VTOL loses some in a transition. The figure is chosen and not
//!   measured: PX4 states none, and no aircraft has flown for it;
//! - *a low mission*, half of its height: 3 m above home are left of 6, not 1.
//!
//! Below that altitude a vehicle may still be climbing to its mission after a take-off or manual flight, so only height lost
//! since then counts. A multicopter oscillates on that climb too: until it has reached the heights of its mission, it must
//! lose half of the margin.

use mapping::route::CompiledMission;
use stanag_msgs::enums::{AlertPriority, SubsystemId};

use super::input::Context;
use super::record::UploadedMission;
use super::watchdog::{banks, flown, seconds};
use crate::session::alerts::Cause;
use crate::session::effects::{Effects, Request};

/// The machine.
#[derive(Debug, Default)]
pub(super) struct DescentWatch {
    /// The highest point of this mission flight, m above home.
    highest_m: Option<f64>,
    /// Whether it has been at the heights of this mission.
    reached: bool,
    /// Since when it has been well below, by the vehicle's clock, s.
    below_s: Option<f64>,
}

/// What the vehicle shows.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Sample {
    /// The vehicle's clock, s since its boot.
    time_s: f64,
    /// When a MISSION_CURRENT last named the item, by the same clock.
    named_s: f64,
    /// Metres above home.
    height_m: f64,
    /// Downwards, m/s.
    sinks_m_s: f64,
    /// The lowest altitude of the mission, m above home.
    lowest_m: f64,
    /// Whether the mission has a landing, and whether it is flown now.
    landing: Option<bool>,
    /// It is a type that turns by banking.
    banks: bool,
}

/// The result of a check.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Finding {
    /// It is at the heights of its mission.
    High,
    /// It is below them but not known to be sinking.
    Low,
    /// It sinks.
    Sinks,
}

impl DescentWatch {
    /// Checks whether the vehicle sinks below its mission, and if so puts it on hold.
    pub(super) fn watch(
        &mut self,
        context: &Context<'_>,
        uploaded: Option<&UploadedMission>,
        transferring: bool,
        effects: &mut Effects<'_>,
    ) {
        let telemetry = &context.vehicle.telemetry;
        if telemetry.stands() {
            effects.clear(Cause::Sinking, "the vehicle is on the ground");
        }
        let sample = uploaded.and_then(|uploaded| sample(context, uploaded));
        let Some(sample) = sample.filter(|_| context.vehicle.live()) else {
            *self = DescentWatch::default();
            return;
        };
        // A maneuver in progress changes the mode or the route and has its own checks.
        if context.flight.maneuver || transferring {
            return;
        }
        match self.judge(&sample) {
            Finding::Low => {}
            Finding::High => effects.clear(Cause::Sinking, "at the heights of its mission again"),
            Finding::Sinks => {
                let Sample {
                    height_m,
                    sinks_m_s,
                    lowest_m,
                    ..
                } = sample;
                let text = format!(
                    "sinks in its mission: {height_m:.1} m above home, {sinks_m_s:.1} m/s down; its lowest waypoint is \
                     {lowest_m:.1} m above home; commanding {}: take over by hand if it still sinks",
                    context.stop()
                );
                let (priority, about) = (AlertPriority::Emergency, SubsystemId::VsmStatus);
                effects.raise(Cause::Sinking, priority, about, text);
                effects.request(Request::Hold);
            }
        }
    }

    fn judge(&mut self, sample: &Sample) -> Finding {
        let highest_m = self.highest_m.unwrap_or(sample.height_m);
        let highest_m = highest_m.max(sample.height_m);
        self.highest_m = Some(highest_m);
        let most_m = if sample.banks { WINGS_M } else { HOVERING_M };
        let margin_m = if sample.lowest_m > 0.0 {
            most_m.min(0.5 * sample.lowest_m)
        } else {
            most_m
        };
        if sample.height_m >= sample.lowest_m - margin_m {
            self.below_s = None;
            self.reached = true;
            return Finding::High;
        }
        let below_s = *self.below_s.get_or_insert(sample.time_s);
        // If the mission ends in a landing, the MISSION_CURRENT at its start may have been lost.
        let lands = match sample.landing {
            None => false,
            Some(now) => now || sample.named_s < below_s,
        };
        let lost_m = highest_m - sample.height_m;
        let noise_m = if self.reached {
            LOST_M.min(most_m / 5.0)
        } else {
            // On its climb to a low mission it must be detected before it reaches the ground.
            LOST_M.min(margin_m / 2.0).max(LOST_M.min(most_m / 5.0))
        };
        let sinks = sample.sinks_m_s > SINKS_M_S && lost_m > noise_m;
        if lands || !sinks {
            return Finding::Low;
        }
        // If the hold is not entered, the descent is detected again once more height is lost.
        self.highest_m = Some(sample.height_m);
        Finding::Sinks
    }
}

/// `None` if no mission of ours is being flown.
fn sample(context: &Context<'_>, uploaded: &UploadedMission) -> Option<Sample> {
    let telemetry = &context.vehicle.telemetry;
    let mission = flown(context, uploaded)?;
    let compiled: &CompiledMission = &uploaded.compiled;
    let home_m = telemetry.home?.amsl_m;
    let [_, _, down_m_s] = telemetry.velocity_ned?;
    Some(Sample {
        time_s: seconds(context.vehicle.boot_ms()?),
        named_s: seconds(context.vehicle.progress_boot_ms()?),
        height_m: telemetry.position?.amsl_m - home_m,
        sinks_m_s: down_m_s,
        lowest_m: compiled.lowest_amsl_m(home_m)? - home_m,
        landing: compiled.has_landing().then(|| compiled.lands(mission.seq)),
        banks: banks(telemetry.vehicle_type),
    })
}

/// The distance that counts as well below the mission, for a multicopter and a fixed wing, m.
const HOVERING_M: f64 = 5.0;
const WINGS_M: f64 = 20.0;
/// A slower descent is ignored: a hovering vehicle moves as fast, m/s.
const SINKS_M_S: f64 = 0.3;
/// Loss of height that exceeds noise and gusts, m; for a multicopter 1 m, and on its climb to the mission half of the
/// margin, up to 2.5 m.
const LOST_M: f64 = 4.0;

#[cfg(test)]
mod tests {
    use super::*;

    /// A multicopter in a mission at 20 m.
    fn at(time_s: f64, height_m: f64, sinks_m_s: f64) -> Sample {
        Sample {
            time_s,
            named_s: time_s,
            height_m,
            sinks_m_s,
            lowest_m: 20.0,
            landing: None,
            banks: false,
        }
    }

    /// The height at which it is found to sink.
    fn found(samples: impl Iterator<Item = Sample>) -> Option<f64> {
        let mut watch = DescentWatch::default();
        let mut samples = samples.map(|sample| (sample, watch.judge(&sample)));
        let found = samples.find(|(_, finding)| *finding == Finding::Sinks);
        found.map(|(sample, _)| sample.height_m)
    }

    /// Sinking from 40 m at 1.5 m/s to 12 m below home.
    fn sinking(change: impl Fn(Sample) -> Sample) -> impl Iterator<Item = Sample> {
        (0..175).map(move |k| {
            let time_s = f64::from(k) * 0.2;
            change(at(time_s, 40.0 - 1.5 * time_s, 1.5))
        })
    }

    #[test]
    fn sinking_is_found_below_the_margin_of_the_vehicle_and_of_a_low_mission() {
        let height_m = |lowest_m: f64, banks: bool| {
            let of = move |sample| Sample {
                lowest_m,
                banks,
                ..sample
            };
            found(sinking(of)).map_or(f64::NAN, f64::ceil)
        };
        assert_eq!(height_m(20.0, false), 15.0);
        assert_eq!(height_m(6.0, false), 3.0);
        assert_eq!(height_m(35.0, true), 18.0);
        assert_eq!(height_m(38.0, false), 33.0);
        // Below home, where that is allowed.
        assert_eq!(height_m(-5.0, false), -10.0);
    }

    #[test]
    fn a_landing_of_the_route_is_no_descent_even_where_its_beginning_was_not_received() {
        let lands = |sample| Sample {
            landing: Some(true),
            ..sample
        };
        assert_eq!(found(sinking(lands)), None);
        let unnamed = |sample: Sample| Sample {
            landing: Some(false),
            named_s: sample.time_s.min(10.0),
            ..sample
        };
        assert_eq!(found(sinking(unnamed)), None);
        let named = |sample| Sample {
            landing: Some(false),
            ..sample
        };
        assert!(found(sinking(named)).is_some());
    }

    #[test]
    fn a_climb_from_the_ground_a_swing_and_noise_are_no_descent() {
        let climb = (0..100).map(|k| {
            let time_s = f64::from(k) * 0.2;
            at(
                time_s,
                2.0 + time_s + 0.4 * time_s.sin(),
                0.4 - time_s.cos(),
            )
        });
        assert_eq!(found(climb), None);
        // From a hold at 45 m to a mission at 65 m: past the beginning of the leg, and back to it.
        let heights = [
            (45.4, 0.1),
            (46.6, -2.3),
            (50.5, -0.2),
            (48.9, 1.1),
            (48.8, 0.0),
        ];
        let up = heights
            .into_iter()
            .zip(0..)
            .map(|((height_m, sinks), k)| Sample {
                lowest_m: 65.0,
                ..at(f64::from(k) * 2.0, height_m, sinks)
            });
        assert_eq!(found(up), None);
        // But not down again from there.
        let falls = (0..20).map(|k| Sample {
            lowest_m: 65.0,
            ..at(f64::from(k), 50.0 - f64::from(k), 1.0)
        });
        assert_eq!(found(falls), Some(47.0));
        // Nor to the ground below a low mission.
        let low = (0..7).map(|k| Sample {
            lowest_m: 6.0,
            ..at(f64::from(k), 2.8 - 0.4 * f64::from(k), 0.4)
        });
        let height_m = found(low).expect("it is found");
        assert!((1.1..1.3).contains(&height_m), "{height_m}");
        let swing = (0..100).map(|k| {
            let time_s = f64::from(k) * 0.2;
            at(time_s, 20.0 + 4.0 * time_s.sin(), -4.0 * time_s.cos())
        });
        assert_eq!(found(swing), None);
    }

    #[test]
    fn a_vehicle_that_does_not_hold_is_found_again() {
        let mut watch = DescentWatch::default();
        let times = sinking(|sample| sample)
            .filter(|sample| watch.judge(sample) == Finding::Sinks)
            .count();
        assert!(times > 5, "{times}");
    }
}
