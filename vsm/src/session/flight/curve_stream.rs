//! Streamed curves (`vehicle.curve.mode = "offboard"`): a multicopter flies curved legs by set points along the curve itself.
//!
//! The mission stays what is uploaded, chords and all, and what the vehicle falls back to. While it flies to the first P1
//! of a run of curves, set points begin on the line from where it is, and PX4 is put into OFFBOARD. It is handed back behind
//! the last P4: the mission's item is set first, then AUTO.MISSION. In between PX4's current item is kept in step with the
//! curve, so that a fall-back continues with the chord ahead, and 4001 reports the waypoint that is flown to.
//!
//! ```text
//! idle --near P1--> entering --OFFBOARD shown--> streaming --behind P4, or amiss--> handing back --MISSION shown--> idle
//!                       |                            |                                   |
//!                       +-------- another command, or not entered, or not left ----------+
//!                                                    v
//!                              leaving: brakes on the curve until another mode is shown; holds if none was commanded
//! ```
//!
//! What ends a stream early:
//!
//! | | then |
//! |---|---|
//! | the vehicle is further from the curve than its tolerance and [`OVER_M`], or behind | the mission, from the chord ahead |
//! | no position for [`UNWATCHED`], and yet its mode: nobody would see it leave the curve | the mission, from the chord ahead |
//! | another route is being loaded, or the vehicle reports another mission | hold |
//! | a 2016, the loss action, a contingency | what it commands; set points continue until the vehicle has left OFFBOARD |
//! | a flight termination | set points end |
//! | a pilot, a failsafe: another mode | set points end; where the failsafe holds they stand still ([`steering`](super::steering)) |
//! | no report of the mode for [`UNWATCHED`] | set points end: PX4 holds, returns or lands (COM_OBL_RC_ACT) |
//! | the bridge stops, or the link to the vehicle fails | the same, after COM_OF_LOSS_T; a restarted bridge streams nothing |
//!
//! `entry`: whether a stream begins; `way`: the track of a run, and the set points along it; `steps`: which of them is sent;
//! `gap`: what is done about a vehicle that is beside it or behind.
//!
//! A station has no part in it: a curve is streamed, as a mission is flown, whether a CUCS is there or not.

use std::time::Duration;

use curve_paths::Position;
use curve_paths::flight::{Multicopter, Track, offset_m};
use mapping::mode::Px4Mode;
use mapping::parameter::Parameters;
use mapping::route::{Curving, StreamedRun};
use mapping::telemetry::{MissionProgress, Place};

use self::gap::{Gap, OVER_M, right};
use self::way::moved;
use crate::session::effects::Effects;

mod entry;
mod gap;
mod steps;
#[cfg(test)]
mod tests;
mod way;

/// The machine.
#[derive(Debug, Default)]
pub(super) struct CurveStream {
    flown: Option<Box<Flown>>,
    /// Why a run, by its entry, of a mission, by its id, is flown as chords: reported once.
    reported: Option<(u32, u16)>,
}

/// What it reads.
#[derive(Debug)]
pub(super) struct StreamContext<'a> {
    pub(super) now: Duration,
    /// MAVLink system of the vehicle.
    pub(super) system: u8,
    /// The mode that the vehicle has reported since the last command.
    pub(super) mode: Option<Px4Mode>,
    /// When it last reported its mode; `None` after a stop of the bridge, before it has again.
    pub(super) mode_at: Option<Duration>,
    /// Its position, and when that was measured.
    pub(super) position: Option<(Place, Duration)>,
    /// North, east, down, m/s.
    pub(super) velocity: Option<[f64; 3]>,
    pub(super) home: Option<Place>,
    /// Its current item.
    pub(super) mission: Option<MissionProgress>,
    /// The curves of the mission that it flies, if they may be streamed, and that mission's id.
    pub(super) runs: Option<(&'a [StreamedRun], u32)>,
    /// A maneuver is in progress.
    pub(super) maneuver: bool,
    /// Another mission is being uploaded.
    pub(super) transferring: bool,
    /// The mission service is in use, or something else is about to be flown: nothing begins.
    pub(super) busy: bool,
    /// What the vehicle can do, and what PX4 does when set points stop.
    pub(super) parameters: &'a Parameters,
    /// The tolerance, and how the vehicle flies curves.
    pub(super) curving: Curving,
    /// A speed commanded for the present leg (2016), m/s: it is not exceeded.
    pub(super) commanded_mps: Option<f64>,
}

/// An input.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Input {
    /// Sends the set point that is due, and decides whether to begin or end.
    Advance,
    /// Something else is commanded: the stream lasts until the vehicle has left OFFBOARD.
    Superseded,
    /// Ends set points at once.
    Release,
}

/// A mode to command.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Order {
    /// OFFBOARD.
    Enter,
    /// AUTO.MISSION: PX4's current item is the right one.
    HandBack,
    /// AUTO.LOITER.
    Hold,
}

/// A run that is being streamed.
#[derive(Debug)]
struct Flown {
    track: Track,
    limits: Multicopter,
    entry: u16,
    mission_id: u32,
    /// How far along the track, m, and how fast, m/s.
    s_m: f64,
    v_mps: f64,
    accel: f64,
    due: Duration,
    last: Duration,
    stage: Stage,
    /// From the end of each chord on, m along the track, this item is the mission's current one.
    marks: Vec<(f64, u16)>,
    passed: usize,
    /// The mission continues from here on.
    end_m: f64,
    /// The position that was last compared with the curve.
    seen: Option<Duration>,
    gap: Gap,
    /// When PX4's current item was set last.
    set_at: Option<Duration>,
    names: (u16, u16),
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Stage {
    /// OFFBOARD is commanded; set points follow the vehicle.
    Entering,
    Streaming,
    /// The mission's item is being set, since then; then AUTO.MISSION is `commanded`.
    HandingBack {
        since: Duration,
        commanded: bool,
    },
    /// Brakes. `entered`: the vehicle was in OFFBOARD; otherwise it may still receive that command.
    Leaving {
        since: Duration,
        entered: bool,
    },
}

impl CurveStream {
    /// Whether a curve is being streamed, or the vehicle may still be in OFFBOARD for it.
    pub(super) fn is_flown(&self) -> bool {
        self.flown.is_some()
    }

    /// Whether the vehicle was last seen in OFFBOARD for a curve that nothing has ended.
    pub(super) fn is_streaming(&self) -> bool {
        (self.flown.as_ref()).is_some_and(|flown| flown.stage == Stage::Streaming)
    }

    /// Takes an input; returns the mode to command.
    pub(super) fn handle(
        &mut self,
        context: &StreamContext<'_>,
        input: Input,
        effects: &mut Effects<'_>,
    ) -> Option<Order> {
        match (input, &mut self.flown) {
            (Input::Advance, None) => self.begin(context, effects),
            (Input::Advance, Some(flown)) => {
                let (order, continues) = flown.advance(context, effects);
                if !continues {
                    self.flown = None;
                }
                order
            }
            (Input::Superseded, flown) => {
                if let Some(flown) = flown {
                    flown.leave(context.now);
                }
                None
            }
            (Input::Release, flown) => {
                *flown = None;
                None
            }
        }
    }

    pub(super) fn poll_timeout(&self) -> Option<Duration> {
        self.flown.as_ref().map(|flown| flown.due)
    }
}

impl Flown {
    /// Something else is commanded.
    fn leave(&mut self, now: Duration) {
        self.stage = match self.stage {
            Stage::Entering => Stage::Leaving {
                since: now,
                entered: false,
            },
            Stage::Leaving { entered, .. } => Stage::Leaving {
                since: now,
                entered,
            },
            Stage::Streaming | Stage::HandingBack { .. } => Stage::Leaving {
                since: now,
                entered: true,
            },
        };
    }

    /// Returns the mode to command, and whether the stream continues.
    fn advance(
        &mut self,
        context: &StreamContext<'_>,
        effects: &mut Effects<'_>,
    ) -> (Option<Order>, bool) {
        let now = context.now;
        let blind = context.mode_at.map(|at| now.saturating_sub(at));
        if blind.is_none_or(|blind| blind > UNWATCHED) {
            effects.warn_of_link(
                "the vehicle does not show its mode: the set points of its curve end, and PX4 acts by COM_OBL_RC_ACT",
            );
            return (None, false);
        }
        if self.has_ended(context, effects) {
            return (None, false);
        }
        let order = self.decide(context, effects);
        self.stream(context, effects);
        (order, true)
    }

    /// Whether the vehicle is in another mode, and will not enter OFFBOARD any later.
    fn has_ended(&self, context: &StreamContext<'_>, effects: &mut Effects<'_>) -> bool {
        let Some(mode) = context.mode.filter(|mode| *mode != Px4Mode::OFFBOARD) else {
            return false;
        };
        match self.stage {
            // Reports still show the mission.
            Stage::Entering => mode != Px4Mode::MISSION && !context.maneuver,
            Stage::Streaming => {
                effects.advise(format!(
                    "the vehicle is in {}: the curve is no longer streamed",
                    mode.name()
                ));
                true
            }
            Stage::HandingBack { .. } => true,
            // The command to enter OFFBOARD may still be on its way.
            Stage::Leaving { since, entered } => {
                entered || context.now.saturating_sub(since) >= ON_ITS_WAY
            }
        }
    }

    fn decide(&mut self, context: &StreamContext<'_>, effects: &mut Effects<'_>) -> Option<Order> {
        let now = context.now;
        let entered = context.mode == Some(Px4Mode::OFFBOARD);
        match self.stage {
            Stage::Entering if entered && !context.maneuver => {
                self.stage = Stage::Streaming;
                effects.advise(format!(
                    "streaming the curve from waypoint {} to {} (OFFBOARD)",
                    self.names.0, self.names.1
                ));
            }
            // Refused, or not shown in time: the maneuver has begun with the first set point.
            Stage::Entering if !context.maneuver && self.due > self.last => {
                self.leave(now);
            }
            Stage::Entering => {}
            Stage::Streaming if self.is_another(context) => {
                self.leave(now);
                return Some(Order::Hold);
            }
            Stage::Streaming => {
                if let Some(why) = self.amiss(context) {
                    effects.warn_of_link(format!(
                        "the curve from waypoint {} to {} is no longer streamed: {why}; commanding the mission",
                        self.names.0, self.names.1
                    ));
                    self.hand_back(now);
                } else if self.s_m >= self.end_m {
                    self.hand_back(now);
                }
            }
            Stage::HandingBack { .. } if self.is_another(context) => {
                self.leave(now);
                return Some(Order::Hold);
            }
            Stage::HandingBack { since, commanded } => {
                if !commanded && !context.maneuver {
                    // PX4 may finish items without a position, a speed, before it names them.
                    let wanted = self.current()..=self.current().saturating_add(MAX_SPEEDS);
                    if context
                        .mission
                        .is_some_and(|mission| wanted.contains(&mission.seq))
                    {
                        self.stage = Stage::HandingBack {
                            since: now,
                            commanded: true,
                        };
                        return Some(Order::HandBack);
                    }
                    if now.saturating_sub(since) > SHOWS_ITEM_WITHIN {
                        effects.warn_of_link(
                            "the vehicle does not take the mission's next item: commanding hold",
                        );
                        self.leave(now);
                        return Some(Order::Hold);
                    }
                    if self
                        .set_at
                        .is_none_or(|at| now.saturating_sub(at) > SET_AGAIN)
                    {
                        self.set_current(context, effects);
                    }
                } else if commanded && !context.maneuver {
                    // The maneuver has ended, and the vehicle is still in OFFBOARD.
                    self.leave(now);
                    return Some(Order::Hold);
                }
            }
            // It did receive the command.
            Stage::Leaving { entered: false, .. } if entered => {
                self.stage = Stage::Leaving {
                    since: now,
                    entered: true,
                };
            }
            // Nothing else has taken the vehicle out of it.
            Stage::Leaving { since, entered } => {
                if entered && !context.maneuver && now.saturating_sub(since) > HOLDS_AFTER {
                    self.leave(now);
                    return Some(Order::Hold);
                }
            }
        }
        None
    }

    fn hand_back(&mut self, now: Duration) {
        self.set_at = None;
        self.stage = Stage::HandingBack {
            since: now,
            commanded: false,
        };
    }

    /// Whether the mission is being replaced, or is not the one of the curve.
    fn is_another(&self, context: &StreamContext<'_>) -> bool {
        let id = context.mission.map(|mission| mission.mission_id);
        context.transferring || id.is_some_and(|id| id != self.mission_id)
    }

    /// Why the vehicle should no longer be streamed to.
    fn amiss(&mut self, context: &StreamContext<'_>) -> Option<String> {
        let Some((place, at)) = context.position else {
            return Some("no position".to_owned());
        };
        let age = context.now.saturating_sub(at);
        if age > UNWATCHED {
            return Some(format!("no position for {:.1} s", age.as_secs_f64()));
        }
        if self.seen.replace(at) == Some(at) {
            return None;
        }
        let there = Position::new(place.latitude, place.longitude, place.amsl_m);
        let expected_m = self.s_m - self.v_mps * age.as_secs_f64();
        let (from_m, to_m) = (expected_m - LOOKS_BACK_M, expected_m + LOOKS_AHEAD_M);
        let (s_m, off_m) = self.track.nearest(there, from_m, to_m)?;
        let on = self.track.at(s_m)?;
        self.gap.note(
            at,
            offset_m(on.position, there).dot(right(on.forward)),
            expected_m - s_m,
        );
        let most_m = context.curving.tolerance_m + OVER_M;
        if off_m > most_m {
            return Some(format!(
                "{off_m:.1} m from it, expected at most {most_m:.1} m"
            ));
        }
        let (late_m, most_m) = (self.gap.late_m, LATE_M + LATE_S * self.v_mps);
        (late_m > most_m).then(|| format!("{late_m:.1} m behind, expected at most {most_m:.1} m"))
    }

    /// The mission's current item at this place of the curve.
    fn current(&self) -> u16 {
        let last = self.passed.checked_sub(1);
        let mark = last.and_then(|last| self.marks.get(last));
        mark.map_or(self.entry, |(_, item)| *item)
    }

    /// Makes it PX4's.
    fn set_current(&mut self, context: &StreamContext<'_>, effects: &mut Effects<'_>) {
        self.set_at = Some(context.now);
        // Without an event: it would be for a chord that the next one supersedes, and restart the progress along the route.
        effects.vehicle.missions.point_to(self.current());
    }
}

/// Where the vehicle is now.
fn here(context: &StreamContext<'_>) -> Option<Position> {
    let (place, at) = context.position?;
    let age = context.now.saturating_sub(at).min(UNWATCHED);
    Some(moved(place, context.velocity?, age.as_secs_f64()))
}

/// Without a position for this long it is handed back. Without a report of its mode the set points end: PX4 may have taken
/// them for lost meanwhile, where this computer or the link had stopped, and what its failsafe flies is not to be commanded away
/// by an older state. Both come at 5 Hz.
const UNWATCHED: Duration = Duration::from_secs(2);
/// The vehicle may still receive a given-up command within this time.
const ON_ITS_WAY: Duration = Duration::from_secs(2);
/// A vehicle that nothing else takes out of OFFBOARD is put on hold: longer than a maneuver lasts.
const HOLDS_AFTER: Duration = Duration::from_secs(8);
/// How far the vehicle may be behind the set points, m and s: PX4 catches up by 0.95 m/s for each metre.
const LATE_M: f64 = 2.0;
const LATE_S: f64 = 0.6;
/// Where on the track it is looked for, m.
const LOOKS_BACK_M: f64 = 15.0;
const LOOKS_AHEAD_M: f64 = 10.0;
/// MISSION_CURRENT comes at 1 Hz, and on each change.
const SHOWS_ITEM_WITHIN: Duration = Duration::from_secs(3);
const SET_AGAIN: Duration = Duration::from_millis(400);
/// Items between two places of a curve: the speeds before the second and after the first.
const MAX_SPEEDS: u16 = 2;
