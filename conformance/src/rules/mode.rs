//! MODE: flight modes on the ground and at launch and landing, flight termination in two steps, engines, lights.

use std::collections::BTreeSet;
use std::sync::atomic::Ordering;
use std::time::Duration;

use super::acknowledgement::carried_out;
use super::configuration::{availability, full};
use super::scene::Scene;
use crate::bench::flight::{
    airborne, fix, fly_until, home, land, mode, mode_command, reported_mode, run_transfer, transfer,
};
use crate::bench::station::about;
use crate::bench::station::{Station, information_request};
use crate::bench::trial::{Player, Trial};
use crate::verdict::{Judged, Stop};
use crate::wire::{Draft, Seen};

pub(super) const SCENES: &[Scene] = &[
    Scene {
        rule: "MODE-002",
        play: no_mode_is_reported_that_was_not_entered,
    },
    Scene {
        rule: "MODE-003",
        play: modes_it_lacks_are_refused,
    },
    Scene {
        rule: "MODE-009",
        play: termination_takes_two_steps,
    },
    Scene {
        rule: "MODE-010",
        play: termination_state_is_reported,
    },
    Scene {
        rule: "MODE-011",
        play: launch_landing_and_wave_off,
    },
    Scene {
        rule: "MODE-013",
        play: engine_command_and_report_agree,
    },
    Scene {
        rule: "MODE-014",
        play: lights_are_set_as_a_whole,
    },
];

/// Every defined light of 2007.
const ALL_LIGHTS: i64 = 0xDF;
/// The bit of 2007 that is reserved.
const RESERVED_LIGHT: i64 = 0x20;

fn no_mode_is_reported_that_was_not_entered(t: &Trial) -> Judged {
    let a = t.controller()?;
    // Without a plan mode 11 has nothing to fly; on the ground mode 12 has nothing to loiter around.
    run_transfer(
        t,
        &a,
        transfer(1, "NONE"),
        t.timers().load.min(t.timers().answer * 5),
    )?;
    for wanted in [mode::WAYPOINT, 22, 20] {
        let before = reported_mode(&a)?;
        if before == Some(wanted) {
            continue;
        }
        let sent = a.send(mode_command(wanted).acked());
        let mut shown = Vec::new();
        let deadline = t.bench.net.now() + t.timers().quiet;
        while t.bench.net.now() < deadline {
            shown.extend(reported_mode(&a)?);
            t.pause(Duration::from_millis(100))?;
        }
        t.expect(!shown.contains(&wanted), || format!("expected 3001 to keep {before:?} after 2016 mode {wanted}, which the vehicle cannot enter here; it shows {wanted}"))?;
        let done = a.received(sent.mark, |seen| {
            about(seen, 2016, sent.stamp) && seen.raw("Acknowledgement Type") == Some(2)
        });
        t.expect(done.is_empty(), || format!("expected no 'carried out' for mode {wanted}, which 3001 does not show; 17000 type 2 came"))?;
        let refusal = a.wait(sent.mark, t.timers().answer, |seen| {
            about(seen, 2016, sent.stamp) && seen.raw("Acknowledgement Type") == Some(3)
                || seen.kind() == 16000
        });
        if refusal.is_none() {
            t.warn(format!(
                "the refusal of mode {wanted} was said neither by 17000 type 3 nor by 16000"
            ));
        }
    }
    Ok(())
}

fn modes_it_lacks_are_refused(t: &Trial) -> Judged {
    let a = t.controller()?;
    let configuration = full(t, &a, 3)?;
    let missing = availability(&configuration, 2016, 2);
    let lacking: BTreeSet<i64> = missing
        .into_iter()
        .filter(|index| (2..=22).contains(index))
        .collect();
    if lacking.is_empty() {
        t.note("44003 marks no flight mode as unavailable");
    }
    for wanted in lacking {
        let before = reported_mode(&a)?;
        let sent = a.send(mode_command(wanted).acked());
        let done = carried_out(t, &a, &sent, t.timers().quiet / 3)?;
        if let Some(done) = done {
            t.expect_of(&done, false, || format!("expected mode {wanted}, which 44003 marks as unavailable, to be refused; 17000 type 2 came"))?;
        }
        let after = reported_mode(&a)?;
        t.expect(after == before, || format!("expected mode {wanted}, which 44003 marks as unavailable, to change nothing; 3001 went from {before:?} to {after:?}"))?;
    }
    if !t.bench.flight_released.load(Ordering::SeqCst) {
        return Ok(());
    }
    // In flight a mode that the vehicle lacks could be mistaken for one that it has.
    a.release()?;
    let Ok(a) = airborne(t) else { return Ok(()) };
    for wanted in [16, 17, 22] {
        let sent = a.send(mode_command(wanted).acked());
        let done = carried_out(t, &a, &sent, t.timers().answer)?;
        let shown = reported_mode(&a)?;
        if let Some(done) = done {
            t.expect_of(&done, shown == Some(wanted), || format!("expected mode {wanted} refused, since the vehicle does not enter it; 17000 type 2 came, 3001 shows {shown:?}"))?;
        }
    }
    Ok(())
}

fn termination_takes_two_steps(t: &Trial) -> Judged {
    let a = t.launcher()?;
    let command = |state: i64| {
        Draft::new(2005)
            .raw("Commanded Flight Termination State", state)
            .acked()
    };
    let state = |kind: &str| -> Judged<Option<i64>> {
        let report = a.query(3005).map_err(|_| {
            Stop::not_applicable(format!(
                "3005 does not come ({kind}): the subject has no flight termination"
            ))
        })?;
        Ok(report.raw("Reported Flight Termination State"))
    };
    state("before")?;
    for steps in [&[2][..], &[1, 0, 2][..]] {
        a.send(command(0));
        t.pause(Duration::from_millis(300))?;
        let mut last = None;
        for &step in steps {
            last = Some(a.send(command(step)));
            t.pause(Duration::from_millis(400))?;
        }
        if let Some(last) = last {
            let done = a.wait(last.mark, t.timers().quiet, |seen| {
                about(seen, 2005, last.stamp) && seen.raw("Acknowledgement Type") == Some(2)
            });
            if let Some(done) = done {
                t.expect_of(&done, false, || {
                    format!("expected 'execute' after {steps:?} to be refused; 17000 type 2 came")
                })?;
            }
        }
        let shown = state("after")?;
        t.expect(shown != Some(2), || format!("expected termination not to execute after the commands {steps:?} (0 reset, 1 arm, 2 execute); 3005 shows 2"))?;
    }
    a.send(command(0));
    a.release()?;
    execute_after_arm(t)
}

/// 'Execute' after 'arm' is carried out: on the ground, or in flight where 'arm' is refused on the ground.
fn execute_after_arm(t: &Trial) -> Judged {
    let Some(a) = armed(t)? else {
        t.note("'arm' is refused: 'execute' after it is not tried");
        return Ok(());
    };
    let last = a.send(terminate(2));
    let deadline = t.bench.net.now() + t.timers().answer;
    let state =
        || -> Judged<Option<i64>> { Ok(a.query(3005)?.raw("Reported Flight Termination State")) };
    let mut shown = state()?;
    while shown != Some(2) && t.bench.net.now() < deadline {
        t.pause(Duration::from_millis(100))?;
        shown = state()?;
    }
    let refused = a.received(last.mark, |seen| {
        about(seen, 2005, last.stamp) && seen.raw("Acknowledgement Type") == Some(3)
    });
    t.pause(t.timers().answer)?;
    a.send(terminate(0));
    if shown != Some(2) && !refused.is_empty() {
        t.note("'execute' after 'arm' is refused");
        return Ok(());
    }
    t.expect(shown == Some(2), || {
        format!(
            "expected 3005 to show 2 after 'arm' and 'execute', or a refusal; it shows {shown:?}"
        )
    })
}

/// 2005.
fn terminate(state: i64) -> Draft {
    Draft::new(2005)
        .raw("Commanded Flight Termination State", state)
        .acked()
}

/// A station that has armed the termination: on the ground, or in flight where that is refused on the ground; `None`
/// where it is refused everywhere.
fn armed(t: &Trial) -> Judged<Option<Player>> {
    let a = t.launcher()?;
    if arms(t, &a, t.timers().ack)? {
        return Ok(Some(a));
    }
    if !t.bench.flight_released.load(Ordering::SeqCst) {
        return Ok(None);
    }
    a.release()?;
    let Ok(a) = airborne(t) else { return Ok(None) };
    // A station that has just connected may be refused until its clock is known.
    Ok(arms(t, &a, t.timers().begin / 2)?.then_some(a))
}

fn arms(t: &Trial, a: &Station, time: Duration) -> Judged<bool> {
    let deadline = t.bench.net.now() + time;
    loop {
        let sent = a.send(terminate(1));
        // #1400 reports that a message came, never that it is refused: only the state shows that it was armed.
        if t.of_edition_25() {
            t.pause(t.timers().ack)?;
            let state = a.query(3005)?.raw("Reported Flight Termination State");
            if state == Some(1) {
                return Ok(true);
            }
        }
        let end = a.wait(sent.mark, t.timers().ack, |seen| {
            about(seen, 2005, sent.stamp) && seen.raw("Acknowledgement Type") != Some(1)
        });
        let refused = end.is_some_and(|end| end.raw("Acknowledgement Type") == Some(3));
        if !refused && !t.of_edition_25() {
            return Ok(true);
        }
        if t.bench.net.now() >= deadline {
            return Ok(false);
        }
        a.query(3)?;
        t.pause(Duration::from_millis(400))?;
    }
}

fn termination_state_is_reported(t: &Trial) -> Judged {
    let Some(a) = armed(t)? else {
        return Err(Stop::not_applicable("flight termination is refused"));
    };
    a.send(terminate(0));
    t.pause(Duration::from_millis(300))?;
    for (step, name) in [(1, "arm"), (0, "reset")] {
        let sent = a.send(terminate(step));
        let report = a.wait(sent.mark, t.timers().answer, |seen| {
            seen.kind() == 3005 && seen.raw("Reported Flight Termination State") == Some(step)
        });
        if report.is_none() {
            let refused = a.received(sent.mark, |seen| {
                about(seen, 2005, sent.stamp) && seen.raw("Acknowledgement Type") == Some(3)
            });
            a.send(Draft::new(2005).raw("Commanded Flight Termination State", 0));
            if !refused.is_empty() {
                return Err(Stop::not_applicable("flight termination is refused"));
            }
            return Err(Stop::fail(format!(
                "expected 3005 with state {step} after {name}; none came"
            )));
        }
        let asked = a.query(3005)?;
        let state = asked.raw("Reported Flight Termination State");
        t.expect_beside(&asked, state == Some(step), || {
            format!("expected 3005 on request to show state {step} after {name}, got {state:?}")
        })?;
    }
    let flies = t
        .bench
        .home
        .get()
        .is_some_and(|home| fix(t, &a).is_ok_and(|now| now.altitude > home.altitude + 3.0));
    a.release()?;
    if flies {
        land(t)?;
    }
    Ok(())
}

fn launch_landing_and_wave_off(t: &Trial) -> Judged {
    let a = match airborne(t) {
        // A launch that does not climb is a failed precondition elsewhere; here it breaks the rule itself.
        Err(Stop::Inconclusive(reason)) if reason.contains("did not climb") => {
            return Err(Stop::fail(if reason.contains("beyond") {
                "expected 2016 mode 21 to climb to the commanded altitude, 50 m above home; the vehicle climbed beyond 75 m"
            } else {
                "expected 2016 mode 21 to climb to the commanded altitude, 50 m above home; the vehicle stayed below 40 m"
            }));
        }
        other => other?,
    };
    let home = home(t, &a)?;
    let now = fix(t, &a)?;
    t.expect(now.altitude > home.altitude + 10.0, || {
        "expected the launch to reach its altitude".into()
    })?;
    a.send(mode_command(mode::LAND).acked());
    let down = fly_until(t, &a, t.timers().flight.div_f64(3.0), |fix| {
        fix.altitude < now.altitude - 5.0
    })?;
    t.expect(down.is_some(), || {
        "expected the vehicle to descend in mode 19".into()
    })?;
    let low = fix(t, &a)?;
    let sent = a.send(mode_command(mode::WAVE_OFF).acked());
    let refused = a.wait(sent.mark, t.timers().answer, |seen| {
        about(seen, 2016, sent.stamp) && seen.raw("Acknowledgement Type") == Some(3)
    });
    if refused.is_some() {
        t.note("mode 20 is refused");
    } else {
        let climbs = fly_until(t, &a, t.timers().flight.div_f64(3.0), |fix| {
            fix.altitude > low.altitude + 3.0
        })?;
        t.expect(climbs.is_some(), || "expected a climb after mode 20".into())?;
        let shown = reported_mode(&a)?;
        t.expect(shown != Some(mode::LAND), || {
            "expected 3001 to leave mode 19 after mode 20".into()
        })?;
    }
    drop(a);
    t.expect(land(t)?, || {
        "expected the vehicle on the ground after mode 19".into()
    })
}

fn engine_command_and_report_agree(t: &Trial) -> Judged {
    let a = t.launcher()?;
    let mark = t.bench.net.mark();
    let before = a.query(3007)?;
    t.pause(t.timers().answer / 4)?;
    let numbers: BTreeSet<i64> = a
        .received(mark, |seen| seen.kind() == 3007)
        .iter()
        .filter_map(|seen| seen.raw("Engine Number"))
        .collect();
    let first = before.raw("Engine Number").unwrap_or(1);
    let report_of = |number: i64| -> Judged<std::sync::Arc<Seen>> {
        a.ask(
            information_request(3007),
            t.timers().answer,
            &format!("message 3007 of engine {number}"),
            |seen| {
                seen.kind() == 3007
                    && seen
                        .raw("Engine Number")
                        .is_none_or(|found| found == number)
            },
        )
    };
    // The last engine first, so that a number off by one shows; some vehicles start all engines by the first number.
    let start = |engine: i64| -> Judged<Option<bool>> {
        let sent = a.send(
            Draft::new(2008)
                .raw("Engine Number", engine)
                .raw("Engine Command", 1)
                .acked(),
        );
        // Polled from the command on: an autopilot disarms what does not take off, in a fast simulation after one
        // second.
        let deadline = t.bench.net.now() + t.timers().begin.min(t.timers().answer * 5);
        while t.bench.net.now() < deadline {
            let refused = a.received(sent.mark, |seen| {
                about(seen, 2008, sent.stamp) && seen.raw("Acknowledgement Type") == Some(3)
            });
            if !refused.is_empty() {
                return Ok(None);
            }
            let report = report_of(engine)?;
            if matches!(report.raw("Engine Status"), Some(1 | 2)) {
                let command = report.raw("Reported Engine Command");
                t.expect_beside(&report, command == Some(1), || {
                    format!(
                        "expected Reported Engine Command 1 in 3007 after a start, got {command:?}"
                    )
                })?;
                return Ok(Some(true));
            }
            t.pause(Duration::from_millis(50))?;
        }
        Ok(Some(false))
    };
    let last = numbers.last().copied().unwrap_or(first);
    let (mut engine, mut started) = (last, start(last)?);
    if started != Some(true) && first != last {
        let other = report_of(first)?;
        let runs = matches!(other.raw("Engine Status"), Some(1 | 2));
        let ran = matches!(before.raw("Engine Status"), Some(1 | 2));
        t.expect_beside(&other, ran || !runs, || {
            format!("expected 2008 for engine {last} to start that one; 3007 shows engine {first} started")
        })?;
        let again = start(first)?;
        if again == Some(true) || started.is_none() {
            t.note(format!("engine {last} does not start by itself"));
            (engine, started) = (first, again);
        }
    }
    let Some(started) = started else {
        return Err(Stop::not_applicable("engine commands are refused"));
    };
    let stop = a.send(
        Draft::new(2008)
            .raw("Engine Number", engine)
            .raw("Engine Command", 0)
            .acked(),
    );
    t.pause(t.timers().answer / 2)?;
    t.expect(started, || {
        format!("expected 3007 to show engine {engine} started after 2008; it does not")
    })?;
    let refused = a.received(stop.mark, |seen| {
        about(seen, 2008, stop.stamp) && seen.raw("Acknowledgement Type") == Some(3)
    });
    if refused.is_empty() {
        let report = report_of(engine)?;
        let command = report.raw("Reported Engine Command");
        t.expect_beside(&report, command == Some(0), || {
            format!("expected Reported Engine Command 0 in 3007 after a stop, got {command:?}")
        })?;
        let deadline = t.bench.net.now() + t.timers().begin.min(t.timers().answer * 5);
        let mut last = report;
        while last.raw("Engine Status") != Some(0) && t.bench.net.now() < deadline {
            t.pause(Duration::from_millis(200))?;
            last = report_of(engine)?;
        }
        let status = last.raw("Engine Status");
        t.expect_beside(&last, status.unwrap_or_default() == 0, || {
            format!(
                "expected engine {engine} stopped (Engine Status 0) after a stop, got {status:?}"
            )
        })?;
    }
    let wrong = a.send(
        Draft::new(2008)
            .raw("Engine Number", 99)
            .raw("Engine Command", 1)
            .acked(),
    );
    let done = a.wait(wrong.mark, t.timers().quiet, |seen| {
        about(seen, 2008, wrong.stamp) && seen.raw("Acknowledgement Type") == Some(2)
    });
    t.expect(done.is_none(), || {
        "expected a start of engine 99, which does not exist, to be refused; 17000 type 2 came"
            .into()
    })
}

fn lights_are_set_as_a_whole(t: &Trial) -> Judged {
    let a = t.controller()?;
    let Ok(before) = a.query(3006) else {
        return Err(Stop::not_applicable(
            "3006 does not come: the vehicle has no lights",
        ));
    };
    let set = |wanted: i64| -> Judged<i64> {
        let sent = a.send(Draft::new(2007).raw("Set Lights", wanted).acked());
        let refused = a.wait(sent.mark, t.timers().ack, |seen| {
            about(seen, 2007, sent.stamp) && seen.raw("Acknowledgement Type") == Some(3)
        });
        if refused.is_some() {
            return Err(Stop::not_applicable("lights cannot be commanded"));
        }
        t.pause(t.timers().answer / 2)?;
        let shown = a.query(3006)?;
        let lights = shown.raw("Navigation Lights State").unwrap_or_default();
        t.expect_of(&shown, lights & RESERVED_LIGHT == 0, || {
            format!("expected no reserved bit in 3006, got 0x{lights:02x}")
        })?;
        t.expect_beside(&shown, lights & !wanted == 0, || {
            format!(
                "expected lights 0x{wanted:02x} after 2007 and no other, 3006 shows 0x{lights:02x}"
            )
        })?;
        Ok(lights)
    };
    // The lights that come on are there; each has to come on, and go off, by its own bit.
    let aboard = set(ALL_LIGHTS)?;
    for bit in (0..8).map(|bit| 1 << bit).filter(|bit| aboard & bit != 0) {
        let shown = set(bit)?;
        t.expect(shown == bit, || {
            format!("expected light 0x{bit:02x} alone after 2007, 3006 shows 0x{shown:02x}")
        })?;
    }
    let shown = set(0)?;
    t.expect(shown == 0, || {
        format!("expected all lights off after 2007 with 0, 3006 shows 0x{shown:02x}")
    })?;
    let _ = a.send(Draft::new(2007).raw(
        "Set Lights",
        before.raw("Navigation Lights State").unwrap_or_default(),
    ));
    Ok(())
}
