//! The mission watchdog: a vehicle in AUTO.MISSION that makes no progress towards its item is put on hold, with an alert
//! (16000) that names the CUCS's waypoint number.
//!
//! PX4 does not detect that a multicopter has passed a waypoint: one that misses it continues along the leg's line, or
//! hovers beside it, in mission mode and without a message. The watchdog detects two cases:
//!
//! - *missed*: for some seconds it has been further from the item than before, by more than any turn takes at its speed;
//! - *stuck*: for longer than the configured time it has not come nearer, neither over ground nor in height.
//!
//! Promised: neither is reported in regular flight. A turn, a climb on the spot, head wind, a slow speed, a hover, a loiter
//! and a jump count as progress or are allowed for; each new item begins a new approach. Time is by the vehicle's clock, so
//! that simulations faster or slower than real time work too. The watchdog only decides with a MISSION_CURRENT that confirms
//! the current item: a lost message must not make a passed waypoint a missed one.

use mapping::mode::Px4Mode;
use mapping::route::CompiledMission;
use mapping::telemetry::MissionProgress;
use mavlink_link::dialect::{MavType, MissionState};

use super::approach::{Approach, Away, HOVER_NEAR_M, Leg, Moment, STEP_M, away_from};
use super::input::Context;
use super::record::UploadedMission;
use crate::session::alerts::Cause;
use crate::session::effects::{Effects, Request};

/// The machine.
#[derive(Debug, Default)]
pub(super) struct MissionWatchdog {
    approach: Option<Approach<Way>>,
}

/// The vehicle's state along its mission.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Sample {
    /// The vehicle's clock, s since its boot.
    time_s: f64,
    /// When a MISSION_CURRENT last named the item, by the same clock.
    named_s: f64,
    /// MISSION_CURRENT.seq.
    seq: u16,
    /// Its distance to the item; `None` for an item without a position.
    away: Option<Away>,
    /// The loiter, if the item is one.
    loiter: Option<Loiter>,
    /// Speed over ground, m/s.
    speed_m_s: f64,
    /// It turns by banking, so a turn needs room.
    banks: bool,
    /// The slowest commanded speed, m/s.
    slowest_m_s: f64,
}

#[derive(Debug, Clone, Copy, PartialEq)]
struct Loiter {
    /// Within this distance it is at its loiter, m.
    near_m: f64,
    /// How long it stays, s; `None`: without end.
    stay_s: Option<f64>,
}

/// The way to one item.
#[derive(Debug, Clone, Copy)]
struct Way {
    /// The shortest distance so far.
    best: Option<Away>,
    /// Since when it has been further away than a turn explains, s.
    beyond_s: Option<f64>,
}

/// The result of a check.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Finding {
    /// Nothing to report.
    Nothing,
    /// It has made progress, or has a new item.
    Progress,
    /// It flies away from the item; its distance, m.
    Missed(f64),
    /// It has made no progress for this long, s.
    Stuck(f64),
}

impl MissionWatchdog {
    /// Checks whether the vehicle makes progress along its mission, and if not puts it on hold.
    pub(super) fn watch(
        &mut self,
        context: &Context<'_>,
        uploaded: Option<&UploadedMission>,
        transferring: bool,
        effects: &mut Effects<'_>,
    ) {
        let live = context.vehicle.live();
        let Some(limit_s) = context.config.stall_s.filter(|_| live) else {
            return;
        };
        let Some(sample) = sample(context, uploaded) else {
            self.approach = None;
            return;
        };
        // A maneuver in progress changes the mode or the route and has its own checks.
        if context.flight.maneuver || transferring {
            return;
        }
        let what = match self.judge(&sample, limit_s) {
            Finding::Nothing => return,
            Finding::Progress => return effects.clear(Cause::Stalled, "the route is flown again"),
            Finding::Missed(away_m) => format!("missed, {away_m:.0} m away and not turning back"),
            Finding::Stuck(still_s) => {
                let away_m = sample.away.map_or(0.0, |away| away.ground_m);
                format!("no progress for {still_s:.0} s, {away_m:.0} m away")
            }
        };
        let numbers = uploaded.map_or(&[] as &[u16], |uploaded| &uploaded.compiled.waypoint_of);
        let waypoint = numbers.get(usize::from(sample.seq)).copied().unwrap_or(0);
        let stop = context.stop();
        let text = format!("waypoint {waypoint}: {what}; commanding {stop}");
        effects.warn(Cause::Stalled, text);
        effects.request(Request::Hold);
    }

    /// Updates with the present state; `limit_s` is the longest allowed time without progress.
    fn judge(&mut self, sample: &Sample, limit_s: f64) -> Finding {
        let Some(approach) = Approach::follow(&mut self.approach, sample) else {
            return Finding::Progress;
        };
        if !approach.is_named(sample) {
            return Finding::Nothing;
        }
        let finding = approach.judge(sample, limit_s);
        if finding != Finding::Nothing {
            // If the hold is not entered, the next sample begins a new approach.
            self.approach = Some(Approach::begun(sample));
        }
        finding
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
            beyond_s: None,
        }
    }

    fn is_nearer(&mut self, sample: &Sample) -> bool {
        let (Some(best), Some(away)) = (&mut self.best, sample.away) else {
            self.best = self.best.or(sample.away);
            return false;
        };
        let nearer = best.take_nearer(away, true);
        if nearer {
            self.beyond_s = None;
        }
        nearer
    }
}

impl Approach<Way> {
    fn judge(&mut self, sample: &Sample, limit_s: f64) -> Finding {
        let still_s = sample.time_s - self.since_s;
        // Turning back takes time, and flying back the same again; at a slow speed each step of progress takes long.
        let mut patience_s = limit_s + TURN_S * self.fastest_m_s + STEP_M / sample.slowest_m_s;
        let (Some(away), Some(best)) = (sample.away, self.leg.best) else {
            // A delay (13006) is not a stay at a position, and also ends by time.
            patience_s += sample.loiter.and_then(|delay| delay.stay_s).unwrap_or(0.0);
            return stuck(still_s, patience_s);
        };
        if let Some(loiter) = sample.loiter
            && away.ground_m <= loiter.near_m
        {
            self.leg.beyond_s = None;
            let Some(stay_s) = loiter.stay_s else {
                // A loiter without end is never stuck; the time counts from its end.
                self.since_s = sample.time_s;
                return Finding::Nothing;
            };
            // The vehicle counts its stay from when it is on its circle and at its height, some turns later.
            patience_s +=
                stay_s + CIRCLES * loiter.near_m / sample.speed_m_s.max(SLOWEST_CIRCLE_M_S);
            return stuck(still_s, patience_s);
        }
        let room_m = if sample.banks {
            BANKING_ROOM_M + self.fastest_m_s * self.fastest_m_s
        } else {
            HOVERING_ROOM_M + 0.5 * self.fastest_m_s * self.fastest_m_s
        };
        if away.ground_m > best.ground_m + room_m {
            let since_s = *self.leg.beyond_s.get_or_insert(sample.time_s);
            // If the MISSION_CURRENT of the next item was lost, a passed waypoint would look like a missed one.
            if sample.time_s - since_s >= BEYOND_FOR_S && sample.named_s >= since_s {
                return Finding::Missed(away.ground_m);
            }
        } else {
            self.leg.beyond_s = None;
        }
        stuck(still_s, patience_s)
    }
}

fn stuck(still_s: f64, patience_s: f64) -> Finding {
    if still_s > patience_s {
        Finding::Stuck(still_s)
    } else {
        Finding::Nothing
    }
}

/// The state along the uploaded mission, if it is being flown and is not another station's.
pub(super) fn flown(context: &Context<'_>, uploaded: &UploadedMission) -> Option<MissionProgress> {
    let telemetry = &context.vehicle.telemetry;
    let mission = telemetry.mission?;
    // A check that may command a hold must not use reports from before the last command: a pilot may have the vehicle since.
    // Nor during a flight termination: nothing else is commanded then, so the alert would be wrong.
    let flown = context.vehicle.settled_mode() == Some(Px4Mode::MISSION)
        && telemetry.airborne()
        && !context.termination.holds;
    let over = mission.state == MissionState::MISSION_STATE_COMPLETE;
    // The items of another station's plan are unknown; an id of 0 identifies no plan.
    let foreign = !uploaded.is_aboard(mission.mission_id);
    (flown && !over && !foreign).then_some(mission)
}

/// `None` if no mission of ours is being flown.
fn sample(context: &Context<'_>, uploaded: Option<&UploadedMission>) -> Option<Sample> {
    let telemetry = &context.vehicle.telemetry;
    let uploaded = uploaded?;
    let mission = flown(context, uploaded)?;
    // After its route a fixed wing waits for its landing, or lands: PX4 aborts a landing by itself, and a hold would keep it
    // low. Its pattern has a watch of its own (`landing`), which holds nothing.
    if waits_or_lands(&uploaded.compiled, mission.seq) {
        return None;
    }
    let items = &uploaded.compiled.items;
    let item = items.get(usize::from(mission.seq))?;
    let away = away_from(telemetry, item)?;
    let away = item.is_flown_to().then_some(away);
    let banks = banks(telemetry.vehicle_type);
    let radius_m = f64::from(item.params[2]).abs();
    let near_m = match (banks, radius_m > 0.0) {
        (false, _) => HOVER_NEAR_M,
        (true, true) => 2.0 * radius_m + HOVER_NEAR_M,
        (true, false) => CIRCLE_NEAR_M,
    };
    let loiter = match item.command {
        NAV_LOITER_UNLIM => Some(None),
        NAV_LOITER_TIME | NAV_DELAY => Some(Some(f64::from(item.params[0]))),
        _ => None,
    };
    let [north, east, _] = telemetry.velocity_ned?;
    let slowest_m_s = items
        .iter()
        .filter(|item| item.command == DO_CHANGE_SPEED)
        .map(|item| f64::from(item.params[1]))
        .chain(context.flight.commanded.speed_m_s)
        .fold(UNCOMMANDED_M_S, f64::min);
    Some(Sample {
        time_s: seconds(context.vehicle.boot_ms()?),
        named_s: seconds(context.vehicle.progress_boot_ms()?),
        seq: mission.seq,
        away,
        loiter: loiter.map(|stay_s| Loiter { near_m, stay_s }),
        speed_m_s: north.hypot(east),
        banks,
        slowest_m_s: slowest_m_s.max(SLOWEST_M_S),
    })
}

/// Whether a vehicle that reports this item waits at the end of its route for its landing, or lands. Accepts any number.
fn waits_or_lands(compiled: &CompiledMission, seq: u16) -> bool {
    let start = compiled.landing_start();
    start.is_some_and(|start| seq >= start.saturating_sub(1))
}

/// All types but those that only hover: a convertiplane banks half of the time.
pub(super) fn banks(kind: Option<MavType>) -> bool {
    use MavType as T;
    !matches!(
        kind,
        Some(
            T::MAV_TYPE_QUADROTOR
                | T::MAV_TYPE_COAXIAL
                | T::MAV_TYPE_HELICOPTER
                | T::MAV_TYPE_HEXAROTOR
                | T::MAV_TYPE_OCTOROTOR
                | T::MAV_TYPE_TRICOPTER
                | T::MAV_TYPE_DODECAROTOR
        )
    )
}

pub(super) fn seconds(ms: u32) -> f64 {
    f64::from(ms) / 1e3
}

/// Seconds per m/s for turning back and flying back.
pub(super) const TURN_S: f64 = 2.0;
/// Distance for a stop in addition to v^2 / 2 (a deceleration of 1 m/s^2), m.
const HOVERING_ROOM_M: f64 = 20.0;
/// Distance for a turn in addition to v^2 (a circle at 20 degrees of bank, downwind), m.
const BANKING_ROOM_M: f64 = 100.0;
/// A position may jump for a moment, s.
const BEYOND_FOR_S: f64 = 5.0;
/// At a circle of the vehicle's own radius (NAV_LOITER_RAD, 80 m), m.
const CIRCLE_NEAR_M: f64 = 300.0;
/// Length of the turns before a stay counts, in radii.
const CIRCLES: f64 = 20.0;
const SLOWEST_CIRCLE_M_S: f64 = 5.0;
/// Assumed speed if none is commanded, m/s: slower than any cruise.
const UNCOMMANDED_M_S: f64 = 1.0;
/// Minimum assumed speed for a slower command, m/s.
const SLOWEST_M_S: f64 = 0.01;
pub(super) const NAV_LOITER_UNLIM: u16 = 17;
const NAV_DELAY: u16 = 93;
pub(super) const NAV_LOITER_TIME: u16 = 19;
const DO_CHANGE_SPEED: u16 = 178;

#[cfg(test)]
mod tests {
    use mavlink_link::service::mission::Item;

    use super::*;

    #[test]
    fn any_item_that_a_vehicle_reports_is_taken() {
        const DO_LAND_START: u16 = 189;
        let mut compiled = CompiledMission::default();
        for command in [16, 17, DO_LAND_START, 21] {
            compiled.items.push(Item {
                command,
                ..Item::default()
            });
            compiled.waypoint_of.push(0);
        }
        for (seq, expected) in [
            (0, false),
            (1, true),
            (3, true),
            (4, true),
            (u16::MAX, true),
        ] {
            assert_eq!(waits_or_lands(&compiled, seq), expected, "{seq}");
            // Neither does anything else of a mission end the program.
            assert!(compiled.place_from(seq) >= seq);
            assert_eq!(compiled.leg_ended_by(seq), None);
            assert_eq!(compiled.leg_of_item(seq), None);
            assert_eq!(compiled.is_touch_down(seq), seq == 3);
            assert_eq!(compiled.is_past_the_route(seq), expected);
        }
    }

    /// A multicopter at 5 m/s, so far from item 3.
    fn at(time_s: f64, ground_m: f64, height_m: f64) -> Sample {
        Sample {
            time_s,
            named_s: time_s,
            seq: 3,
            away: Some(Away { ground_m, height_m }),
            loiter: None,
            speed_m_s: 5.0,
            banks: false,
            slowest_m_s: 1.0,
        }
    }

    /// The first finding that holds the vehicle, and when.
    fn first_stall(sights: impl Iterator<Item = Sample>) -> Option<(f64, Finding)> {
        let mut watch = MissionWatchdog::default();
        let mut looked = sights.map(|sample| (sample.time_s, watch.judge(&sample, 30.0)));
        looked.find(|(_, finding)| matches!(finding, Finding::Missed(_) | Finding::Stuck(_)))
    }

    fn times(end_s: f64) -> impl Iterator<Item = f64> {
        (0..)
            .map(|k| f64::from(k) * 0.2)
            .take_while(move |t| *t <= end_s)
    }

    #[test]
    fn flying_past_is_found_within_a_hundred_metres() {
        let past = times(300.0).map(|t| at(t, (40.0 - 5.0 * t).hypot(1.5), 0.0));
        let (when, finding) = first_stall(past).expect("it is held");
        let Finding::Missed(away_m) = finding else {
            panic!("{finding:?}")
        };
        assert!(away_m < 100.0 && when < 27.0, "{away_m} m at {when} s");
    }

    #[test]
    fn hanging_beside_a_waypoint_is_found_after_the_time_and_no_sooner() {
        let hanging = times(300.0).map(|t| Sample {
            speed_m_s: 0.1,
            ..at(t, (40.0 - 5.0 * t).max(2.5) + 0.3 * t.sin(), 0.0)
        });
        let (when, finding) = first_stall(hanging).expect("it is held");
        assert!(matches!(finding, Finding::Stuck(still_s) if still_s > 30.0));
        assert!((37.0..60.0).contains(&when), "{when}");
    }

    #[test]
    fn slow_flight_a_climb_a_reversal_and_a_lost_report_are_no_stall() {
        // 5 cm/s against the wind, where 10 cm/s were commanded.
        let slow = times(900.0).map(|t| Sample {
            slowest_m_s: 0.05,
            speed_m_s: 0.05,
            ..at(t, 80.0 - 0.05 * t, 0.0)
        });
        assert_eq!(first_stall(slow), None);
        // A climb on the spot of 400 m at 0.5 m/s, then the leg.
        let climb = times(800.0).map(|t| at(t, 500.0, 400.0 - 0.5 * t));
        assert_eq!(first_stall(climb), None);
        // Braking from 20 m/s at 1.5 m/s^2, and back.
        let reversal = times(60.0).map(|t| {
            let v = (20.0 - 1.5 * t).max(-20.0);
            Sample {
                speed_m_s: v.abs(),
                ..at(t, 50.0 + 20.0 * t - 0.75 * t * t, 0.0)
            }
        });
        assert_eq!(
            first_stall(reversal.take_while(|s| s.away.is_some_and(|a| a.ground_m > 0.0))),
            None
        );
        // The item was passed 60 s ago, and no MISSION_CURRENT has come since.
        let unnamed = times(60.0).map(|t| Sample {
            named_s: t.min(7.0),
            ..at(t, (40.0 - 5.0 * t).abs(), 0.0)
        });
        assert_eq!(first_stall(unnamed), None);
    }

    #[test]
    fn a_loiter_is_no_stall_while_it_lasts() {
        let loiter = |stay_s| {
            times(4_000.0).map(move |t| Sample {
                loiter: Some(Loiter {
                    near_m: 50.0,
                    stay_s,
                }),
                ..at(t, 3.0, 0.2)
            })
        };
        assert_eq!(first_stall(loiter(None)), None);
        let (when, _) = first_stall(loiter(Some(1_000.0))).expect("it stays too long");
        assert!(when > 1_030.0, "{when}");
    }

    #[test]
    fn a_plane_may_turn_and_come_round_again() {
        // A circle of 150 m radius at 20 m/s that begins over the waypoint before.
        let turn = times(47.0).map(|t| {
            let a = 20.0 * t / 150.0;
            let (x, y) = (150.0 * a.sin(), 150.0 * (1.0 - a.cos()));
            Sample {
                banks: true,
                speed_m_s: 20.0,
                ..at(t, (x + 60.0).hypot(y), 0.0)
            }
        });
        assert_eq!(first_stall(turn), None);
        let away = times(200.0).map(|t| Sample {
            banks: true,
            speed_m_s: 20.0,
            ..at(t, 100.0 + 20.0 * t, 0.0)
        });
        assert!(matches!(first_stall(away), Some((_, Finding::Missed(_)))));
    }

    #[test]
    fn a_new_item_or_a_new_boot_begins_a_new_approach() {
        let mut watch = MissionWatchdog::default();
        watch.judge(&at(0.0, 100.0, 0.0), 30.0);
        let later = Sample {
            seq: 4,
            ..at(500.0, 100.0, 0.0)
        };
        assert_eq!(watch.judge(&later, 30.0), Finding::Progress);
        assert_eq!(
            watch.judge(
                &Sample {
                    seq: 4,
                    ..at(1.0, 300.0, 0.0)
                },
                30.0
            ),
            Finding::Progress
        );
    }
}
