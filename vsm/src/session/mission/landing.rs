//! The landing watch: a wing that comes no nearer to its touch-down in its landing pattern raises an alert (16000).
//!
//! PX4 leaves the loiter before the glide (NAV_LOITER_TO_ALT) only at the loiter's altitude and on the line to the
//! touch-down. Where it does not come to that, as in too much wind, or below an altitude that it cannot reach, it circles
//! without end, in AUTO.MISSION and without a message. The alert names what is waited for, and is cleared once the pattern
//! is flown on.
//!
//! Nothing is commanded: the vehicle circles at a height that was chosen for waiting, and a hold would only take the landing
//! from its operator. Not judged are the loiter at the end of the route, where the vehicle waits for mode 19, and the final
//! approach, which PX4 aborts by itself.
//!
//! Progress is to be nearer than ever before: over ground until the loiter is reached, and in height. Without any for
//! [`TURNS`] turns of the loiter, flown at the cruise speed, or on the way for `vehicle.stall_s` and the time of a turn, the
//! pattern counts as stuck. Time is by the vehicle's clock, and a MISSION_CURRENT must confirm the item, as for the mission
//! watchdog.

use std::f64::consts::TAU;

use mapping::altitude::Level;
use mavlink_link::service::mission::Item;

use super::approach::{Approach, Away, Leg, Moment, away_from};
use super::input::Context;
use super::record::UploadedMission;
use super::watchdog::{NAV_LOITER_TIME, NAV_LOITER_UNLIM, TURN_S, flown, seconds};
use crate::session::alerts::Cause;
use crate::session::effects::Effects;

/// The machine.
#[derive(Debug, Default)]
pub(super) struct LandingWatch {
    approach: Option<Approach<Way>>,
}

/// The way to one item of the pattern, and about it.
#[derive(Debug, Clone, Copy)]
struct Way {
    /// The shortest distances so far.
    best: Away,
    /// It has been on the circle of its loiter.
    circles: bool,
    /// It was found to make no progress.
    stuck: bool,
}

/// The vehicle's state in its landing pattern.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Sample {
    /// The vehicle's clock, s since its boot.
    time_s: f64,
    /// When a MISSION_CURRENT last named the item, by the same clock.
    named_s: f64,
    /// MISSION_CURRENT.seq.
    seq: u16,
    away: Away,
    /// The loiter, if the item is one.
    circle: Option<Circle>,
    /// Speed over ground, m/s.
    speed_m_s: f64,
}

#[derive(Debug, Clone, Copy, PartialEq)]
struct Circle {
    radius_m: f64,
    /// The time of a turn at the cruise speed, s.
    turn_s: f64,
    /// How long it stays, s.
    stay_s: f64,
}

/// The result of a check.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Finding {
    /// Nothing new.
    Nothing,
    /// It has made progress, or has a new item.
    Progress,
    /// It has made no progress for this long, s.
    Stuck(f64),
}

impl LandingWatch {
    /// Checks whether the vehicle makes progress in its landing pattern.
    pub(super) fn watch(
        &mut self,
        context: &Context<'_>,
        uploaded: Option<&UploadedMission>,
        transferring: bool,
        effects: &mut Effects<'_>,
    ) {
        let vehicle = context.vehicle;
        let known = vehicle.settled_mode().is_some() && vehicle.telemetry.mission.is_some();
        // What is unknown, or being changed, is neither a stop nor the end of one.
        if !vehicle.live() || !known || context.flight.maneuver || transferring {
            return;
        }
        let item = uploaded.and_then(|uploaded| pattern_item(context, uploaded));
        let (Some(limit_s), Some((seq, item))) = (context.config.stall_s, item) else {
            self.approach = None;
            let over = "no longer in the landing pattern before the final approach";
            return effects.clear(Cause::LandingPattern, over);
        };
        let Some(sample) = sample(context, seq, item) else {
            return;
        };
        match self.judge(&sample, limit_s) {
            Finding::Nothing => {}
            Finding::Progress => {
                effects.clear(Cause::LandingPattern, "the landing pattern is flown on");
            }
            Finding::Stuck(still_s) => {
                let circles = self.approach.is_some_and(|approach| approach.leg.circles);
                let what = match sample.circle.filter(|_| circles) {
                    Some(circle) => {
                        let turns = still_s / circle.turn_s;
                        let waits = waited_for(context, item, &sample);
                        format!(
                            "on its loiter for {still_s:.0} s ({turns:.0} turns), waiting {waits}"
                        )
                    }
                    None => {
                        let away_m = sample.away.ground_m;
                        format!(
                            "no nearer to its next point for {still_s:.0} s, waiting to reach it, {away_m:.0} m away"
                        )
                    }
                };
                let text = format!(
                    "landing pattern: {what}: it does not land like this; abort by mode 20 (wave-off), or take over"
                );
                effects.warn(Cause::LandingPattern, text);
            }
        }
    }

    /// Updates with the present state; `limit_s` is the longest allowed time without progress on the way.
    fn judge(&mut self, sample: &Sample, limit_s: f64) -> Finding {
        let Some(approach) = Approach::follow(&mut self.approach, sample) else {
            return Finding::Progress;
        };
        let still_s = sample.time_s - approach.since_s;
        // Reported once, with the figures of that moment: an alert that followed them would be a stream.
        if approach.leg.stuck
            || !approach.is_named(sample)
            || still_s <= approach.patience_s(sample, limit_s)
        {
            return Finding::Nothing;
        }
        approach.leg.stuck = true;
        Finding::Stuck(still_s)
    }
}

impl Leg for Way {
    type Sample = Sample;

    fn moment(sample: &Sample) -> Moment {
        Moment {
            time_s: sample.time_s,
            named_s: sample.named_s,
            seq: sample.seq,
            speed_m_s: sample.speed_m_s,
        }
    }

    fn begun(sample: &Sample) -> Way {
        Way {
            best: sample.away,
            circles: sample.is_at_circle(),
            stuck: false,
        }
    }

    fn is_nearer(&mut self, sample: &Sample) -> bool {
        let arrives = !self.circles && sample.is_at_circle();
        self.circles |= arrives;
        // On its circle it comes no nearer over ground, however long it flies.
        let nearer = self.best.take_nearer(sample.away, !self.circles) || arrives;
        if nearer {
            self.stuck = false;
        }
        nearer
    }
}

impl Approach<Way> {
    /// How long it may take without progress, s.
    fn patience_s(&self, sample: &Sample, limit_s: f64) -> f64 {
        match sample.circle.filter(|_| self.leg.circles) {
            Some(circle) => circle.stay_s + TURNS * circle.turn_s,
            None => limit_s + TURN_S * self.fastest_m_s,
        }
    }
}

impl Sample {
    fn is_at_circle(&self) -> bool {
        let near = |circle: Circle| self.away.ground_m <= circle.radius_m + NEAR_CIRCLE_M;
        self.circle.is_some_and(near)
    }
}

/// The item of the landing pattern that the vehicle flies to, before its touch-down.
fn pattern_item<'u>(
    context: &Context<'_>,
    uploaded: &'u UploadedMission,
) -> Option<(u16, &'u Item)> {
    let seq = flown(context, uploaded)?.seq;
    let compiled = &uploaded.compiled;
    let item = compiled.items.get(usize::from(seq))?;
    let before = seq >= compiled.landing_start()? && !compiled.is_touch_down(seq);
    (before && item.is_flown_to()).then_some((seq, item))
}

/// `None` while the vehicle has not reported what is needed.
fn sample(context: &Context<'_>, seq: u16, item: &Item) -> Option<Sample> {
    let vehicle = context.vehicle;
    let [north, east, _] = vehicle.telemetry.velocity_ned?;
    Some(Sample {
        time_s: seconds(vehicle.boot_ms()?),
        named_s: seconds(vehicle.progress_boot_ms()?),
        seq,
        away: away_from(&vehicle.telemetry, item)?,
        circle: circle(context, item),
        speed_m_s: north.hypot(east),
    })
}

/// The circle of an item, if it is a loiter.
fn circle(context: &Context<'_>, item: &Item) -> Option<Circle> {
    let [first, second, third, _] = item.params.map(f64::from);
    let (radius_m, stay_s) = match item.command {
        NAV_LOITER_TO_ALT => (second, 0.0),
        NAV_LOITER_TIME => (third, first),
        NAV_LOITER_UNLIM => (third, 0.0),
        _ => return None,
    };
    // 0 is the vehicle's own radius.
    let own_m = context.parameters.wings(context)?.loiter_radius_m;
    let radius_m = if radius_m == 0.0 { own_m } else { radius_m }.abs();
    let cruise_m_s = context.parameters.route_performance(context).cruise_m_s;
    Some(Circle {
        radius_m,
        turn_s: TAU * radius_m / cruise_m_s.max(SLOWEST_M_S),
        stay_s,
    })
}

/// What a vehicle on its loiter waits for.
fn waited_for(context: &Context<'_>, item: &Item, sample: &Sample) -> String {
    let telemetry = &context.vehicle.telemetry;
    if item.command == NAV_LOITER_UNLIM {
        return "for a command: this loiter of the approach has no end (13003)".to_owned();
    }
    if sample.away.height_m <= ALTITUDE_NEAR_M {
        return "to leave it for the next point: it is at its altitude and not on that line, as in much wind"
            .to_owned();
    }
    let level = Level::of_frame(item.frame, item.z.into());
    match telemetry.home.zip(telemetry.position).zip(level) {
        Some(((home, here), level)) => {
            let height_m = here.amsl_m - home.amsl_m;
            let expected_m = level.above_home(home.amsl_m);
            format!("for its altitude, {height_m:.0} m above home, expected {expected_m:.0} m")
        }
        None => format!("for its altitude, {:.0} m away", sample.away.height_m),
    }
}

/// Turns of a loiter without progress: PX4 leaves it within one or two once it is at its altitude.
const TURNS: f64 = 4.0;
/// How far off its circle a vehicle counts as on it, m.
const NEAR_CIRCLE_M: f64 = 50.0;
/// PX4 counts a wing as at an altitude so near to it: the default of NAV_FW_ALT_RAD, m.
const ALTITUDE_NEAR_M: f64 = 10.0;
/// Slower than any wing cruises, m/s.
const SLOWEST_M_S: f64 = 5.0;
const NAV_LOITER_TO_ALT: u16 = 31;

#[cfg(test)]
mod tests {
    use super::*;

    /// At 15 m/s, so far from a loiter of 80 m radius, which takes 33.5 s for a turn.
    fn at(time_s: f64, ground_m: f64, height_m: f64) -> Sample {
        Sample {
            time_s,
            named_s: time_s,
            seq: 4,
            away: Away { ground_m, height_m },
            circle: Some(Circle {
                radius_m: 80.0,
                turn_s: TAU * 80.0 / 15.0,
                stay_s: 0.0,
            }),
            speed_m_s: 15.0,
        }
    }

    fn times(end_s: f64) -> impl Iterator<Item = f64> {
        (0..)
            .map(|k| f64::from(k) * 0.5)
            .take_while(move |time_s| *time_s <= end_s)
    }

    /// When it was found to be stuck, each time.
    fn found(samples: impl Iterator<Item = Sample>) -> Vec<f64> {
        let mut watch = LandingWatch::default();
        let stuck = samples.filter(|sample| matches!(watch.judge(sample, 30.0), Finding::Stuck(_)));
        stuck.map(|sample| sample.time_s).collect()
    }

    /// It reaches its circle after 28 s, and comes down by 1 m/s to 20 m off the loiter's altitude, after 40 s.
    fn circling(time_s: f64) -> Sample {
        at(
            time_s,
            (500.0 - 15.0 * time_s).max(80.0),
            (60.0 - time_s).max(20.0),
        )
    }

    #[test]
    fn a_loiter_that_is_not_left_is_found_after_four_turns_and_reported_once() {
        let found = found(times(4_000.0).map(circling));
        assert_eq!(found.len(), 1, "{found:?}");
        assert!(
            (40.0 + 130.0..40.0 + 137.0).contains(&found[0]),
            "{found:?}"
        );
    }

    #[test]
    fn a_swing_about_the_circle_and_the_altitude_is_no_progress() {
        let swings = times(1_000.0).map(|time_s| Sample {
            away: Away {
                ground_m: circling(time_s).away.ground_m + 30.0 * (time_s / 5.0).sin(),
                height_m: circling(time_s).away.height_m + 2.0 * (time_s / 3.0).sin(),
            },
            ..circling(time_s)
        });
        assert_eq!(found(swings).len(), 1);
    }

    #[test]
    fn what_is_flown_on_clears_the_alert_and_is_judged_again() {
        let mut watch = LandingWatch::default();
        let stuck = times(400.0)
            .filter(|time_s| matches!(watch.judge(&circling(*time_s), 30.0), Finding::Stuck(_)));
        assert_eq!(stuck.count(), 1);
        assert_eq!(watch.judge(&at(401.0, 80.0, 10.0), 30.0), Finding::Progress);
        let later = times(200.0).map(|time_s| at(402.0 + time_s, 80.0, 10.0));
        let again = later.filter(|one| matches!(watch.judge(one, 30.0), Finding::Stuck(_)));
        assert_eq!(again.count(), 1);
        let next = Sample {
            seq: 5,
            ..at(700.0, 600.0, 10.0)
        };
        assert_eq!(watch.judge(&next, 30.0), Finding::Progress);
    }

    #[test]
    fn a_slow_descent_a_stay_and_a_slow_way_are_no_stop() {
        // 3 m in a turn.
        let slow = times(600.0).map(|time_s| at(time_s, 80.0, 60.0 - 0.09 * time_s));
        assert_eq!(found(slow), [0.0; 0]);
        let stays = times(700.0).map(|time_s| {
            let mut sample = at(time_s, 80.0, 2.0);
            sample.circle = sample.circle.map(|circle| Circle {
                stay_s: 600.0,
                ..circle
            });
            sample
        });
        assert_eq!(found(stays), [0.0; 0]);
        // Against the wind.
        let way = times(900.0).map(|time_s| at(time_s, 1_000.0 - 0.5 * time_s, 2.0));
        assert_eq!(found(way), [0.0; 0]);
    }

    #[test]
    fn a_vehicle_that_is_blown_away_before_its_loiter_is_found() {
        let blown = times(200.0).map(|time_s| at(time_s, 300.0 + 3.0 * time_s, 2.0));
        let found = found(blown);
        assert_eq!(found.len(), 1);
        assert!((60.0..63.0).contains(&found[0]), "{found:?}");
    }

    #[test]
    fn an_item_that_was_not_named_since_may_be_over() {
        let unnamed = times(400.0).map(|time_s| Sample {
            named_s: time_s.min(30.0),
            ..circling(time_s)
        });
        assert_eq!(found(unnamed), [0.0; 0]);
    }
}
