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

/// How high above the lowest place that was seen a vehicle is in flight, m: a take-off that is broken off is fast on the
/// runway, or just above it.
const ALOFT_M: f64 = 25.0;

/// What a recording shows of the flights of one vehicle.
#[derive(Default)]
struct Flights {
    /// The lowest altitude of each Altitude Type, m.
    lowest: BTreeMap<i64, f64>,
    /// Successive 4000s that show it flying.
    flying: u32,
    /// Whether a launch was commanded that has not led to a flight so far.
    launching: bool,
    /// Whether it was in flight, with no launch commanded since.
    flown: bool,
}

impl Flights {
    fn take(&mut self, fix: &Fix) {
        let lowest = self.lowest.entry(fix.altitude_type);
        let lowest = lowest.or_insert(fix.altitude);
        *lowest = fix.altitude.min(*lowest);
        let flies = fix.north.hypot(fix.east) > 3.0 && fix.altitude > *lowest + ALOFT_M;
        self.flying = if flies { self.flying + 1 } else { 0 };
        // A single report may be a wrong altitude.
        if self.flying > 3 {
            (self.flown, self.launching) = (true, false);
        }
    }
}

/// Values of its own that 41002s describe, and how many these say that there are.
#[derive(Default)]
struct Described {
    values: BTreeSet<i64>,
    count: usize,
}

impl Described {
    fn take(&mut self, seen: &Seen) {
        let index = seen.raw("Vehicle Specific Enumeration Index");
        self.values
            .extend(index.filter(|&index| index >= VEHICLE_SPECIFIC));
        let count = seen.raw("Vehicle Specific Enumeration Count");
        let count = count.and_then(|count| usize::try_from(count).ok());
        self.count = self.count.max(count.unwrap_or_default());
    }

    /// Whether all of them came: others may have been described before the recording, or got lost.
    fn whole(&self) -> bool {
        !self.values.is_empty() && self.values.len() >= self.count
    }
}

/// What is described of UA State, by the sender of the 41002s.
fn described(view: &View<'_>) -> BTreeMap<u32, Described> {
    let info = stanag_msgs::table::message(3002).and_then(|info| info.field("UA State"));
    let number = info.map(|field| i64::from(field.bit) + 1);
    let mut described: BTreeMap<u32, Described> = BTreeMap::new();
    for seen in view.messages().filter(|seen| {
        seen.kind() == 41002
            && seen.raw("Requested Message") == Some(3002)
            && seen.raw("Requested Field") == number
    }) {
        let sender = seen.piece.source.0;
        described.entry(sender).or_default().take(seen);
    }
    described
}

/// Modes that may launch a vehicle: the launch itself, and the route of a vehicle on the ground.
const LAUNCHES: [Option<i64>; 2] = [Some(mode::LAUNCH), Some(mode::WAYPOINT)];

/// A launch can be aborted until the vehicle flies: 4 is no state after a flight. Values of the vehicle's own are those
/// that 41002 describes.
fn ua_state_follows_the_flight(view: &View<'_>, found: &mut Found) {
    let described = described(view);
    let states = view.messages().filter(|seen| seen.kind() == 3002);
    let vehicles: BTreeSet<u32> = states.map(|seen| seen.piece.source.0).collect();
    // A VSM may describe the values of all its vehicles in its own name.
    let of_vsm = described.iter().find(|(id, _)| !vehicles.contains(*id));
    let of_vsm = of_vsm.map(|(_, described)| described);
    let mut flights: BTreeMap<u32, Flights> = BTreeMap::new();
    let all = view.datagrams.iter();
    for seen in all.flat_map(|datagram| &datagram.messages) {
        match (seen.direction, seen.kind()) {
            (Direction::Sent, 2016)
                if LAUNCHES.contains(&seen.raw("Select Flight Path Control Mode")) =>
            {
                let flights = flights.entry(seen.piece.destination.0).or_default();
                flights.launching = true;
            }
            (Direction::Received, 4000) => {
                if let Some(fix) = Fix::with_speeds(seen) {
                    flights.entry(seen.piece.source.0).or_default().take(&fix);
                }
            }
            (Direction::Received, 3002) => {
                let Some(state) = seen.raw("UA State").filter(|&state| state != 0) else {
                    continue;
                };
                found.saw();
                let vehicle = seen.piece.source.0;
                let flights = flights.entry(vehicle).or_default();
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
                let own = described.get(&vehicle).or(of_vsm);
                if let Some(own) = own.filter(|own| state >= VEHICLE_SPECIFIC && own.whole()) {
                    found.check(seen, own.values.contains(&state), || {
                        format!("expected a UA State of 3002 that 41002 describes ({:?}), or one below 10; got {state}", own.values)
                    });
                }
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
/// A gap between reports in which an engine may have run, or its vehicle flown, and stopped again.
const UNSEEN: Duration = Duration::from_secs(10);
/// What a light wind may turn a stopped propeller with, rad/s.
const WIND_MILLS: f64 = 30.0;
/// What is left of the speed of a turbine, or a rotor without a brake, that runs down for as long, at most.
const SLOWER: f64 = 0.9;
/// No wind turns an engine of a vehicle at rest with this share of the fastest that it has run.
const NO_WIND: f64 = 0.5;
/// A climb straight up, which takes engines: ground speed below, and climb above this, m/s.
const STRAIGHT_MPS: f64 = 1.5;
const CLIMBS_MPS: f64 = 1.0;
/// The oldest 4000 by which a 3007 is judged, and the oldest 3007 of another engine beside it.
const FRESH: Duration = Duration::from_millis(600);
const BESIDE: Duration = Duration::from_secs(1);
/// Reports in such climbs that are enough.
const ENOUGH: usize = 4;
/// Values of Engine Status; others are a state of a vehicle's own, or an engine that was started.
const STOPPED: i64 = 0;
const RUNNING: i64 = 2;

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
    status: i64,
    /// rad/s, where it reports that.
    turns: Option<f64>,
    stopped_since: Option<Duration>,
    /// What it turned at when it was seen first since it has stopped, or since it was seen to turn slower.
    stopping: Option<(Duration, f64)>,
}

impl Engine {
    fn take(&mut self, at: Duration, status: i64, turns: Option<f64>) {
        // In a gap of its reports it may have run.
        if at.saturating_sub(self.at) > UNSEEN {
            (self.stopped_since, self.stopping) = (None, None);
        }
        (self.at, self.status, self.turns) = (at, status, turns);
        if status == STOPPED {
            self.stopped_since.get_or_insert(at);
            self.stopping = self.stopping.or(turns.map(|turns| (at, turns)));
        } else {
            (self.stopped_since, self.stopping) = (None, None);
        }
    }

    /// What a stopped engine turns at, and whether it still runs down; `None` where that is not known yet.
    fn runs_down(&mut self) -> Option<(f64, bool)> {
        let ((since, before), turns) = self.stopping.zip(self.turns)?;
        if self.at.saturating_sub(since) < RUN_DOWN {
            return None;
        }
        let slower = turns < before * SLOWER;
        if slower {
            self.stopping = Some((self.at, turns));
        }
        Some((turns, slower))
    }
}

impl Vehicle {
    fn take(&mut self, fix: Fix) {
        let rests = fix.north.hypot(fix.east) < 1.0 && fix.down.abs() < 0.5;
        // In a gap of its reports it may have flown.
        let gap = (self.fix).is_some_and(|last| fix.at.saturating_sub(last.at) > UNSEEN);
        let since = self.rests_since.filter(|_| !gap);
        self.rests_since = rests.then(|| since.unwrap_or(fix.at));
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

    /// Whether the vehicle and all its engines have stood for long enough by now: one that runs may turn the gear, or the
    /// air, of another.
    fn has_run_down(&self, now: Duration) -> bool {
        let engines = self.engines.values().map(|engine| engine.stopped_since);
        engines
            .chain([self.rests_since])
            .all(|since| since.is_some_and(|since| now.saturating_sub(since) >= RUN_DOWN))
            && (self.fix).is_some_and(|fix| now.saturating_sub(fix.at) < RUN_DOWN)
    }

    /// The speed of the fastest of all engines that do not stand, rad/s. `None` where none runs, and where one of them was
    /// not reported just now, or without its speed: it may be the one that lifts the vehicle.
    fn fastest(&self, now: Duration) -> Option<f64> {
        let mut engines = self.engines.values();
        let fresh = engines.all(|engine| now.saturating_sub(engine.at) < BESIDE);
        let (mut runs, mut fastest) = (false, 0.0_f64);
        for engine in self.engines.values().filter(|one| one.status != STOPPED) {
            runs |= engine.status == RUNNING;
            fastest = fastest.max(engine.turns?);
        }
        (fresh && runs).then_some(fastest)
    }
}

/// The fastest of the speeds that a 3007 has, rad/s.
fn turns(seen: &Seen) -> Option<f64> {
    ["Engine Speed 1", "Engine Speed 2", "Engine Speed 3"]
        .into_iter()
        .filter_map(|name| seen.value(name))
        .reduce(f64::max)
}

/// The fastest that each engine of each vehicle runs, rad/s.
fn fastest_of_each(view: &View<'_>) -> BTreeMap<(u32, i64), f64> {
    let mut fastest: BTreeMap<(u32, i64), f64> = BTreeMap::new();
    for seen in view.messages().filter(|seen| seen.kind() == 3007) {
        let runs = seen
            .raw("Engine Status")
            .filter(|&status| status != STOPPED);
        if let (Some(_), Some(number), Some(turns)) = (
            runs,
            seen.raw("Engine Number"),
            turns(seen).filter(|&turns| turns > 0.0),
        ) {
            let known = fastest
                .entry((seen.piece.source.0, number))
                .or_insert(turns);
            *known = turns.max(*known);
        }
    }
    fastest
}

/// An engine that is stopped does not turn once it has run down on the ground, and in a climb straight up one engine at
/// least turns. A vehicle on wings may glide, or turn the propeller of a stopped engine by its speed: it is judged on the
/// ground only, where wind may turn one too.
fn engines_turn_while_they_run(view: &View<'_>, found: &mut Found) {
    let fastest = fastest_of_each(view);
    let mut vehicles: BTreeMap<u32, Vehicle> = BTreeMap::new();
    let mut climbs = Tally::default();
    for seen in view.messages() {
        let vehicle = vehicles.entry(seen.piece.source.0).or_default();
        if seen.kind() == 4000
            && let Some(fix) = Fix::with_speeds(seen)
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
        let engine = vehicle.engines.entry(number).or_default();
        engine.take(seen.at, status, turns(seen));
        let runs_down = engine.runs_down();
        if let Some((turns, slower)) = runs_down.filter(|_| vehicle.has_run_down(seen.at)) {
            let stands = turns <= WIND_MILLS || slower;
            let fastest = fastest.get(&(seen.piece.source.0, number));
            let no_wind = fastest.is_some_and(|fastest| turns > fastest * NO_WIND);
            let reason = format!(
                "expected engine {number}, stopped (Engine Status 0) for {:.0} s on the ground, not to turn; Engine Speed of 3007 is {turns:.0} rad/s",
                RUN_DOWN.as_secs_f64()
            );
            if stands || no_wind {
                found.check(seen, stands, || reason);
            } else {
                found.warn(seen, format!("{reason}, as in a wind"));
            }
        }
        if vehicle.climbs(seen.at)
            && let Some(fastest) = vehicle.fastest(seen.at)
        {
            climbs.look(seen, fastest > 0.0);
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
    use stanag_msgs::Id;

    use super::*;
    use crate::bench::net::Datagram;
    use crate::passive::view::trace::{received, sent};
    use crate::passive::view::verdict_on;
    use crate::verdict::Verdict;
    use crate::wire::Draft;

    /// A vehicle on a runway at 500 m, or straight above it.
    fn moves(at_ms: u64, pace: f64, up: f64) -> Datagram {
        moves_at(at_ms, 500.0, pace, up)
    }

    fn moves_at(at_ms: u64, altitude: f64, pace: f64, up: f64) -> Datagram {
        let draft = Draft::new(4000)
            .set("Latitude", 0.8)
            .set("Longitude", 0.1)
            .set("Altitude", altitude)
            .set("U_Speed", pace)
            .set("V_Speed", 0.0)
            .set("W_Speed", -up);
        received(at_ms, draft)
    }

    fn state(at_ms: u64, state: i64) -> Datagram {
        received(at_ms, Draft::new(3002).raw("UA State", state))
    }

    fn describes(index: i64) -> Draft {
        Draft::new(41002)
            .raw("Requested Message", 3002)
            .raw("Requested Field", 17)
            .raw("Vehicle Specific Enumeration Index", index)
    }

    fn launch(at_ms: u64) -> Datagram {
        let draft = Draft::new(2016).raw("Select Flight Path Control Mode", mode::LAUNCH);
        sent(at_ms, draft)
    }

    /// 3002 before a launch, in flight, and after a landing.
    fn states(before: i64, aloft: i64, after: i64) -> Verdict {
        let mut run = vec![
            received(0, describes(10)),
            moves(50, 0.0, 0.0),
            state(100, before),
            launch(200),
        ];
        run.extend((0..8).map(|step| moves_at(1_000 + step * 500, 540.0, 8.0, 0.0)));
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
        for pace in [0.0, 25.0] {
            // At rest, and on the runway.
            let mut run = vec![moves(0, 0.0, 0.0), state(100, 3), launch(200)];
            run.extend((0..8).map(|step| moves(1_000 + step * 500, pace, 0.0)));
            run.push(state(5_000, 4));
            assert_eq!(verdict_on(&run, ua_state_follows_the_flight), Verdict::Pass);
        }
    }

    #[test]
    fn only_a_vehicle_whose_own_values_are_all_described_is_judged_by_them() {
        let judged = |description: Draft| {
            let other = Id(0x1b00_0102);
            let mut of_other = Draft::new(3002).raw("UA State", 3);
            of_other.source = Some(other);
            let run = [
                received(0, description),
                received(50, of_other),
                state(100, 11),
            ];
            verdict_on(&run, ua_state_follows_the_flight)
        };
        let from = |source: Id| {
            let mut draft = describes(10);
            draft.source = Some(source);
            draft
        };
        assert_eq!(judged(describes(10)), Verdict::Fail);
        assert_eq!(judged(describes(11)), Verdict::Pass);
        // Another was described before, or got lost.
        let of_two = describes(10).raw("Vehicle Specific Enumeration Count", 2);
        assert_eq!(judged(of_two), Verdict::Pass);
        // The value of another vehicle, and one that the VSM describes for all.
        assert_eq!(judged(from(Id(0x1b00_0102))), Verdict::Pass);
        assert_eq!(judged(from(Id(0x1b00_0001))), Verdict::Fail);
    }

    fn engine(at_ms: u64, status: i64, turns: Option<f64>) -> Datagram {
        engine_of(1, at_ms, status, turns)
    }

    fn engine_of(number: i64, at_ms: u64, status: i64, turns: Option<f64>) -> Datagram {
        let draft = Draft::new(3007)
            .raw("Engine Number", number)
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

    /// What is found where a vehicle stands for six seconds, and these of its engines report beside it.
    fn parked(engines: impl Fn(u64) -> Vec<Datagram>) -> Verdict {
        let mut run = Vec::new();
        for step in 0..13 {
            run.push(moves(step * 500, 0.0, 0.0));
            run.extend(engines(step * 500 + 100));
        }
        // An engine of this vehicle runs with 600 rad/s.
        run.push(engine(7_000, 2, Some(600.0)));
        verdict_on(&run, engines_turn_while_they_run)
    }

    #[test]
    fn a_turbine_runs_down_and_a_wind_turns_a_propeller() {
        let stopped = |turns: fn(f64) -> f64| {
            parked(|at_ms| vec![engine(at_ms, 0, Some(turns(at_ms as f64 / 1000.0)))])
        };
        assert_eq!(stopped(|_| 600.0), Verdict::Fail);
        // Slowly, from 5,000 rad/s.
        assert_eq!(
            stopped(|time| 5_000.0 * (-time / 20.0).exp()),
            Verdict::Pass
        );
        assert_eq!(stopped(|_| 100.0), Verdict::Warning);
    }

    #[test]
    fn an_engine_may_have_run_in_a_gap_of_its_reports() {
        let after_gap = |gap_ms: u64| {
            let mut run = Vec::new();
            for step in 0..13 {
                run.push(moves(step * 500, 0.0, 0.0));
                run.push(engine(step * 500 + 100, 0, Some(0.0)));
            }
            for step in 0..4 {
                let at_ms = 6_500 + gap_ms + step * 500;
                run.push(moves(at_ms, 0.0, 0.0));
                run.push(engine(at_ms + 100, 0, Some(500.0)));
            }
            run.push(engine(200_000, 2, Some(600.0)));
            verdict_on(&run, engines_turn_while_they_run)
        };
        assert_eq!(after_gap(0), Verdict::Fail);
        assert_eq!(after_gap(60_000), Verdict::Pass);
    }

    #[test]
    fn an_engine_on_the_gear_of_another_turns() {
        let twin = parked(|at_ms| {
            vec![
                engine_of(2, at_ms, 2, Some(600.0)),
                engine(at_ms, 0, Some(590.0)),
            ]
        });
        assert_eq!(twin, Verdict::Inconclusive);
    }

    #[test]
    fn an_engine_that_does_not_lift_may_stand_in_a_climb() {
        let climbs = |lifting: Option<f64>| {
            let mut run = Vec::new();
            for step in 0..12 {
                run.push(moves(step * 500, 0.0, 3.0));
                run.push(engine(step * 500 + 50, 2, lifting));
                run.push(engine_of(2, step * 500 + 100, 2, Some(0.0)));
            }
            verdict_on(&run, engines_turn_while_they_run)
        };
        assert_eq!(climbs(Some(500.0)), Verdict::Pass);
        // What lifts it reports no speed.
        assert_eq!(climbs(None), Verdict::Inconclusive);
        assert_eq!(climbs(Some(0.0)), Verdict::Fail);
    }

    #[test]
    fn a_speed_that_is_absent_is_not_0() {
        let run: Vec<_> = (0..13)
            .flat_map(|step| {
                let draft = Draft::new(4000)
                    .set("Latitude", 0.8)
                    .set("Longitude", 0.1)
                    .set("Altitude", 900.0)
                    .set("W_Speed", -2.0 * (step % 2) as f64);
                [
                    received(step * 500, draft),
                    engine(step * 500 + 100, 0, Some(300.0)),
                    engine(step * 500 + 200, 2, Some(0.0)),
                ]
            })
            .collect();
        assert_eq!(
            verdict_on(&run, engines_turn_while_they_run),
            Verdict::Inconclusive
        );
    }
}
