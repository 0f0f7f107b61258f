//! Judges of the vehicle's condition: UA State of 3002 and the engines of 3007, against what was commanded and how the
//! vehicle moves.

use std::collections::{BTreeMap, BTreeSet};
use std::time::Duration;

use super::view::{Found, Judge, Tally, View};
use crate::bench::fix::Fix;
use crate::bench::flight::mode;
use crate::wire::{Direction, Seen};

pub(super) const JUDGES: &[Judge] = &[
    Judge {
        rule: "STAT-018",
        judge: ua_state_follows_the_flight,
    },
    Judge {
        rule: "STAT-019",
        judge: engines_turn_while_they_run,
    },
];

/// Values of UA State.
const LAUNCH_ABORT: i64 = 4;
const VEHICLE_SPECIFIC: i64 = 10;

/// What a recording shows of the flights of one vehicle.
#[derive(Default)]
struct Flights {
    /// Successive 4000s that show it moving.
    moving: u32,
    /// Whether a launch was commanded that has not led to a flight so far.
    launching: bool,
    /// Whether it was in flight, with no launch commanded since.
    flown: bool,
}

impl Flights {
    fn take(&mut self, fix: &Fix) {
        self.moving = if fix.north.hypot(fix.east) > 3.0 {
            self.moving + 1
        } else {
            0
        };
        // A single report may be a gust on the ground.
        if self.moving > 3 {
            (self.flown, self.launching) = (true, false);
        }
    }
}

/// A launch can be aborted until the vehicle flies: 4 is no state after a flight. Values of the vehicle's own are those
/// that 41002 describes.
fn ua_state_follows_the_flight(view: &View<'_>, found: &mut Found) {
    let info = stanag_msgs::table::message(3002).and_then(|info| info.field("UA State"));
    let number = info.map(|field| i64::from(field.bit) + 1);
    let described: BTreeSet<i64> = view
        .messages()
        .filter(|seen| {
            seen.kind() == 41002
                && seen.raw("Requested Message") == Some(3002)
                && seen.raw("Requested Field") == number
        })
        .filter_map(|seen| seen.raw("Vehicle Specific Enumeration Index"))
        .collect();
    let mut flights: BTreeMap<u32, Flights> = BTreeMap::new();
    let all = view.datagrams.iter();
    for seen in all.flat_map(|datagram| &datagram.messages) {
        match (seen.direction, seen.kind()) {
            (Direction::Sent, 2016)
                if seen.raw("Select Flight Path Control Mode") == Some(mode::LAUNCH) =>
            {
                let flights = flights.entry(seen.piece.destination.0).or_default();
                flights.launching = true;
            }
            (Direction::Received, 4000) => {
                if let Some(fix) = Fix::of(seen) {
                    flights.entry(seen.piece.source.0).or_default().take(&fix);
                }
            }
            (Direction::Received, 3002) => {
                let Some(state) = seen.raw("UA State").filter(|&state| state != 0) else {
                    continue;
                };
                found.saw();
                let flights = flights.entry(seen.piece.source.0).or_default();
                if state == LAUNCH_ABORT && !flights.launching {
                    let reason = "expected UA State 4 of 3002, launch abort, after a launch that led to no flight";
                    if flights.flown && view.live {
                        found.fail(
                            seen,
                            format!(
                                "{reason}; the vehicle has flown, and no launch was commanded since"
                            ),
                        );
                    } else {
                        // An earlier launch, or one by another station, may have been aborted.
                        found.warn(seen, format!("{reason}; none was seen"));
                    }
                }
                let known = state < VEHICLE_SPECIFIC || described.is_empty();
                found.check(seen, known || described.contains(&state), || {
                    format!("expected a UA State of 3002 that 41002 describes ({described:?}), or one below 10; got {state}")
                });
            }
            _ => {}
        }
    }
    if found.looked().0 {
        return;
    }
    found.missed("no 3002 with a UA State other than 0 (unknown)");
}

/// How long an engine and its vehicle have stood still, by the clock, before the engine has to: a propeller runs down.
const RUN_DOWN: Duration = Duration::from_secs(4);
/// What the wind may turn a stopped propeller with, rad/s.
const WIND_MILLS: f64 = 30.0;
/// A climb straight up, which takes engines: ground speed below, and climb above this, m/s.
const STRAIGHT_MPS: f64 = 1.5;
const CLIMBS_MPS: f64 = 1.0;
/// The oldest 4000 by which a 3007 is judged, and the oldest 3007 of another engine beside it.
const FRESH: Duration = Duration::from_millis(600);
const BESIDE: Duration = Duration::from_secs(1);
/// Reports in such climbs that are enough.
const ENOUGH: usize = 4;

/// What was seen last of one vehicle.
#[derive(Default)]
struct Vehicle {
    fix: Option<Fix>,
    rests_since: Option<Duration>,
    engines: BTreeMap<i64, Engine>,
}

/// What was seen last of one engine.
#[derive(Default)]
struct Engine {
    at: Duration,
    stopped_since: Option<Duration>,
    /// rad/s, of a running engine that reports it.
    turns: Option<f64>,
}

impl Vehicle {
    fn take(&mut self, fix: Fix) {
        let rests = fix.north.hypot(fix.east) < 1.0 && fix.down.abs() < 0.5;
        self.rests_since = rests.then(|| self.rests_since.unwrap_or(fix.at));
        self.fix = Some(fix);
    }

    /// Whether the vehicle climbs straight up at this moment.
    fn climbs(&self, now: Duration) -> bool {
        self.fix.is_some_and(|fix| {
            now.saturating_sub(fix.at) < FRESH
                && fix.north.hypot(fix.east) < STRAIGHT_MPS
                && fix.down < -CLIMBS_MPS
        })
    }

    /// Whether vehicle and engine have stood for long enough by now.
    fn has_run_down(&self, engine: i64, now: Duration) -> bool {
        let engine = self.engines.get(&engine);
        [self.rests_since, engine.and_then(|one| one.stopped_since)]
            .into_iter()
            .all(|since| since.is_some_and(|since| now.saturating_sub(since) >= RUN_DOWN))
            && (self.fix).is_some_and(|fix| now.saturating_sub(fix.at) < RUN_DOWN)
    }
}

/// The fastest of the speeds that a 3007 has, rad/s.
fn turns(seen: &Seen) -> Option<f64> {
    ["Engine Speed 1", "Engine Speed 2", "Engine Speed 3"]
        .into_iter()
        .filter_map(|name| seen.value(name))
        .reduce(f64::max)
}

/// An engine that is stopped does not turn once it has run down on the ground, and in a climb straight up one engine at
/// least turns. A vehicle on wings may glide, or turn the propeller of a stopped engine by its speed: it is judged on the
/// ground only.
fn engines_turn_while_they_run(view: &View<'_>, found: &mut Found) {
    let mut vehicles: BTreeMap<u32, Vehicle> = BTreeMap::new();
    let mut climbs = Tally::default();
    for seen in view.messages() {
        let vehicle = vehicles.entry(seen.piece.source.0).or_default();
        if seen.kind() == 4000
            && let Some(fix) = Fix::of(seen)
        {
            vehicle.take(fix);
        }
        if seen.kind() != 3007 {
            continue;
        }
        let (Some(status), Some(number)) = (seen.raw("Engine Status"), seen.raw("Engine Number"))
        else {
            continue;
        };
        let turns = turns(seen);
        let engine = vehicle.engines.entry(number).or_default();
        engine.at = seen.at;
        engine.stopped_since = (status == 0).then(|| engine.stopped_since.unwrap_or(seen.at));
        engine.turns = turns.filter(|_| status == 2);
        if let Some(turns) = turns.filter(|_| vehicle.has_run_down(number, seen.at)) {
            found.check(seen, turns <= WIND_MILLS, || {
                format!("expected engine {number}, stopped (Engine Status 0) for {:.0} s on the ground, not to turn; Engine Speed of 3007 is {turns:.0} rad/s", RUN_DOWN.as_secs_f64())
            });
        }
        if vehicle.climbs(seen.at) {
            let beside = vehicle.engines.values();
            let beside = beside.filter(|one| seen.at.saturating_sub(one.at) < BESIDE);
            let fastest = beside.filter_map(|one| one.turns).reduce(f64::max);
            if let Some(fastest) = fastest {
                climbs.look(seen, fastest > 0.0);
            }
        }
    }
    let judged = climbs.judge(
        found,
        ENOUGH,
        "expected an engine of 3007 that runs (Engine Status 2) to turn in a climb straight up; Engine Speed of all engines is 0",
    );
    if !judged {
        found.missed(
            "no 3007 with an Engine Speed in a climb straight up, in which engines have to turn",
        );
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bench::net::Datagram;
    use crate::passive::view::trace::{received, sent};
    use crate::passive::view::verdict_on;
    use crate::verdict::Verdict;
    use crate::wire::Draft;

    fn moves(at_ms: u64, pace: f64, up: f64) -> Datagram {
        let draft = Draft::new(4000)
            .set("Latitude", 0.8)
            .set("Longitude", 0.1)
            .set("Altitude", 500.0)
            .set("U_Speed", pace)
            .set("V_Speed", 0.0)
            .set("W_Speed", -up);
        received(at_ms, draft)
    }

    fn state(at_ms: u64, state: i64) -> Datagram {
        received(at_ms, Draft::new(3002).raw("UA State", state))
    }

    fn describes(index: i64) -> Datagram {
        let draft = Draft::new(41002)
            .raw("Requested Message", 3002)
            .raw("Requested Field", 17)
            .raw("Vehicle Specific Enumeration Index", index);
        received(0, draft)
    }

    /// 3002 before a launch, in flight, and after a landing.
    fn states(before: i64, aloft: i64, after: i64) -> Verdict {
        let launch = Draft::new(2016).raw("Select Flight Path Control Mode", mode::LAUNCH);
        let mut run = vec![describes(10), state(100, before), sent(200, launch)];
        run.extend((0..8).map(|step| moves(1_000 + step * 500, 8.0, 0.0)));
        run.push(state(5_000, aloft));
        run.extend((0..4).map(|step| moves(6_000 + step * 500, 0.0, 0.0)));
        run.push(state(9_000, after));
        verdict_on(&run, ua_state_follows_the_flight)
    }

    #[test]
    fn ua_state_is_that_of_the_flight() {
        assert_eq!(states(3, 10, 3), Verdict::Pass);
        // Unknown is no wrong state, and nothing is judged by it.
        assert_eq!(states(0, 0, 0), Verdict::Inconclusive);
        // One too high: 11 is not described, and after a flight there is no launch to abort.
        assert_eq!(states(3, 11, 3), Verdict::Fail);
        assert_eq!(states(3, 10, 4), Verdict::Fail);
        // Before the recording a launch may have been aborted.
        assert_eq!(states(4, 10, 3), Verdict::Warning);
    }

    #[test]
    fn a_launch_that_is_aborted_is_one() {
        let launch = Draft::new(2016).raw("Select Flight Path Control Mode", mode::LAUNCH);
        let run = [
            state(100, 3),
            sent(200, launch),
            moves(300, 0.0, 0.0),
            state(400, 4),
        ];
        assert_eq!(verdict_on(&run, ua_state_follows_the_flight), Verdict::Pass);
    }

    fn engine(at_ms: u64, status: i64, turns: Option<f64>) -> Datagram {
        let draft = Draft::new(3007)
            .raw("Engine Number", 1)
            .raw("Engine Status", status);
        let draft = match turns {
            Some(turns) => draft.set("Engine Speed 1", turns),
            None => draft,
        };
        received(at_ms, draft)
    }

    /// An engine on the ground, stopped for six seconds, then in a climb of as long at this ground speed.
    fn engines(stopped: Option<f64>, running: Option<f64>, pace: f64) -> Verdict {
        let mut run = Vec::new();
        for step in 0..13 {
            run.push(moves(step * 500, 0.0, 0.0));
            run.push(engine(step * 500 + 100, 0, stopped));
        }
        for step in 14..26 {
            run.push(moves(step * 500, pace, 3.0));
            run.push(engine(step * 500 + 100, 2, running));
        }
        verdict_on(&run, engines_turn_while_they_run)
    }

    #[test]
    fn an_engine_turns_while_it_runs() {
        assert_eq!(engines(Some(0.0), Some(600.0), 0.0), Verdict::Pass);
        assert_eq!(engines(Some(600.0), Some(600.0), 0.0), Verdict::Fail);
        assert_eq!(engines(Some(0.0), Some(0.0), 0.0), Verdict::Fail);
        // A light wind turns a propeller; a vehicle on wings may climb with its engine idle.
        assert_eq!(engines(Some(20.0), Some(0.0), 15.0), Verdict::Pass);
        assert_eq!(engines(None, None, 0.0), Verdict::Inconclusive);
    }

    #[test]
    fn an_engine_that_was_just_stopped_runs_down() {
        let run: Vec<_> = (0..7)
            .flat_map(|step| {
                [
                    moves(step * 500, 0.0, 0.0),
                    engine(step * 500 + 100, 0, Some(400.0 - 60.0 * step as f64)),
                ]
            })
            .collect();
        assert_eq!(
            verdict_on(&run, engines_turn_while_they_run),
            Verdict::Inconclusive
        );
    }
}
