//! Second looks on the ground: rights, acknowledgements, plans, rates, and who is sent what.

use std::time::Duration;

use crate::bench::flight::{
    Plan, clear, deliver, fix, fly_until, home, loaded, mode, mode_command, run_transfer, transfer,
};
use crate::bench::station::about;
use crate::bench::station::{
    Access, Station, authorisation, discovery, information_request, loi, schedule,
};
use crate::bench::trial::Trial;
use crate::rules::acknowledgement::refused;
use crate::rules::configuration::full;
use crate::rules::mission::aboard;
use crate::rules::scene::Scene;
use crate::verdict::{Judged, Precondition, Stop};
use crate::wire::{Draft, Seen};

pub(super) const FURTHER: &[Scene] = &[
    Scene {
        rule: "DISC-001",
        play: asked_by_itself,
    },
    Scene {
        rule: "AUTH-002",
        play: a_denial_changes_nothing,
    },
    Scene {
        rule: "AUTH-003",
        play: the_former_holder_is_informed,
    },
    Scene {
        rule: "AUTH-008",
        play: a_station_has_one_holder,
    },
    Scene {
        rule: "AUTH-013",
        play: no_mode_of_loi_4_launches,
    },
    Scene {
        rule: "HAND-001",
        play: both_sides_are_informed,
    },
    Scene {
        rule: "ROBUST-010",
        play: the_later_command_stays,
    },
    Scene {
        rule: "ACK-007",
        play: what_cannot_be_done_is_not_done,
    },
    Scene {
        rule: "ROUTE-003",
        play: equal_stamps_do_not_make_messages_equal,
    },
    Scene {
        rule: "ROUTE-010",
        play: no_name_of_a_plan_that_is_gone,
    },
    Scene {
        rule: "ROUTE-020",
        play: an_unknown_plan_mode_is_not_complete,
    },
    Scene {
        rule: "MODE-010",
        play: the_termination_mode_is_shown,
    },
    Scene {
        rule: "CONF-001",
        play: while_others_are_connected,
    },
    Scene {
        rule: "MULTI-002",
        play: a_refusal_names_its_vehicle,
    },
];

fn granted(seen: &Seen) -> i64 {
    seen.raw("LOI Granted").unwrap_or_default()
}

fn asked_by_itself(t: &Trial) -> Judged {
    let station = t.any()?;
    let vehicle = station.vehicle;
    let mark = t.bench.net.mark();
    for _ in 0..3 {
        station.send(discovery().to(vehicle));
        let answer = station.wait(mark, t.timers().answer / 2, |seen| {
            seen.kind() == 2 && seen.piece.source == vehicle
        });
        if answer.is_some() {
            return Ok(());
        }
    }
    Err(Stop::fail(format!(
        "expected #2 to a discovery that is addressed to {vehicle} alone; none came"
    )))
}

fn a_denial_changes_nothing(t: &Trial) -> Judged {
    let a = t.controller()?;
    let b = t.b()?;
    t.grant(&b, loi::LOI2)?;
    let answer = b.request(loi::LOI4, Access::Request)?;
    t.expect_of(&answer, granted(&answer) & loi::LOI2 != 0, || {
        format!(
            "expected {} to keep LOI 2 when LOI 4 is denied to it; LOI Granted is 0x{:02x}",
            b.id,
            granted(&answer)
        )
    })?;
    // A plain request never overrides, also not from a CUCS that may.
    let strong = t.find("another that may override", |cucs| {
        cucs.overrides && cucs.id != a.id && cucs.authorised & loi::LOI4 != 0
    });
    let denied: Vec<_> = strong.into_iter().chain([b]).collect();
    for station in &denied {
        let answer = station.request(loi::LOI4, Access::Request)?;
        t.expect_of(&answer, granted(&answer) & loi::LOI4 == 0, || {
            format!("expected a plain request (access 1) of {} to be denied while {} holds LOI 4, whether it may override or not", station.id, a.id)
        })?;
    }
    // What was denied is not granted later by itself.
    a.release()?;
    t.pause(t.timers().quiet)?;
    for station in &denied {
        let answer = station.request(0, Access::Request)?;
        t.expect_of(&answer, granted(&answer) & loi::LOI4 == 0, || {
            format!("expected {}, to which control was denied, to have none when it became free, before it requests it again", station.id)
        })?;
    }
    Ok(())
}

fn the_former_holder_is_informed(t: &Trial) -> Judged {
    let b = t.find("a CUCS id that may override", |cucs| {
        cucs.overrides && cucs.authorised & loi::LOI4 != 0
    })?;
    let a = t.find("another CUCS id that may have LOI 4 and 5", |cucs| {
        cucs.id != b.id && cucs.authorised & (loi::LOI4 | loi::LOI5) == loi::LOI4 | loi::LOI5
    })?;
    let weak = t.find("one that may not override", |cucs| {
        !cucs.overrides && cucs.authorised & loi::LOI4 != 0
    });
    if let Ok(weak) = weak {
        let answer = weak.request(0, Access::Request)?;
        let access = answer.raw("Access Authorized");
        t.expect_of(&answer, access != Some(2), || {
            format!("expected Access Authorized of #2 to {}, which may not override, to say so; it is 2", weak.id)
        })?;
    }
    t.grant(&a, loi::LOI2 | loi::LOI4 | loi::LOI5)?;
    let mark = t.bench.net.mark();
    b.request(loi::LOI2 | loi::LOI4, Access::Override)?;
    let informed = a.wait(mark, t.timers().answer, |seen| {
        matches!(seen.kind(), 2 | 35_000) && seen.piece.destination == a.id
    });
    t.expect(informed.is_some(), || {
        format!("expected #2 or 35000 to {}, whose control was overridden, without a request; none came", a.id)
    })?;
    let left = a.request(0, Access::Request)?;
    let control = granted(&left) & (loi::LOI4 | loi::LOI5);
    t.expect_of(&left, control == 0, || {
        format!("expected neither LOI 4 nor 5 to stay with {} after the override; LOI Granted is 0x{:02x}", a.id, granted(&left))
    })
}

fn a_station_has_one_holder(t: &Trial) -> Judged {
    let stations = t.bench.surveyed()?.stations();
    let Some(&number) = stations.iter().next() else {
        return Ok(());
    };
    let bit = 1 << (number - 1);
    let (a, b) = t.payload_pair()?;
    let first = a.request_station(loi::LOI2 | loi::LOI3, Access::Request, bit)?;
    if granted(&first) & loi::LOI3 == 0 {
        return Ok(());
    }
    let second = b.request_station(loi::LOI2 | loi::LOI3, Access::Request, bit)?;
    let named = second.raw("Controlled Station 1-16").unwrap_or_default();
    t.expect_of(&second, granted(&second) & loi::LOI3 == 0 || named & bit == 0, || {
        format!("expected LOI 3 of station {number}, which {} holds, to be denied to {}; it is granted", a.id, b.id)
    })?;
    let still = a.request(0, Access::Request)?;
    t.expect_of(&still, granted(&still) & loi::LOI3 != 0, || {
        format!(
            "expected {} to keep LOI 3 of station {number} when {} requests it",
            a.id, b.id
        )
    })
}

fn no_mode_of_loi_4_launches(t: &Trial) -> Judged {
    if !t.may_fly() {
        return Ok(());
    }
    let a = t.controller()?;
    let home = home(t, &a)?;
    if fix(t, &a)?.altitude > home.altitude + 3.0 {
        t.note("the vehicle is in the air: what the other modes do on the ground is not judged");
        return Ok(());
    }
    loaded(t, &a, &Plan::zigzag(&home, "GROUND", &[1, 2, 3]))?;
    a.send(mode_command(mode::WAYPOINT).acked());
    let speed = t.bench.profile.figures.speed_factor.max(1.0);
    let time = Duration::from_secs_f64(15.0 / speed).max(t.timers().answer);
    let flies = fly_until(t, &a, time, |fix| fix.altitude > home.altitude + 4.0)?;
    t.expect(flies.is_none(), || {
        "expected mode 11 with LOI 4 to launch nothing from the ground; the vehicle climbs".into()
    })
}

fn both_sides_are_informed(t: &Trial) -> Judged {
    let a = t.controller()?;
    let b = t.b()?;
    t.grant(&b, loi::LOI2)?;
    a.request(loi::LOI4, Access::Release)?;
    let mark = t.bench.net.mark();
    b.take(loi::LOI2 | loi::LOI4)?;
    let informed = |station: &Station| {
        station
            .wait(mark, t.timers().answer / 2, |seen| {
                seen.kind() == 35_000 && seen.piece.destination == station.id
            })
            .is_some()
    };
    if !informed(&b) {
        t.note("no 35000 came to the CUCS that took over: nothing to compare");
        return Ok(());
    }
    if !informed(&a) {
        t.warn(format!(
            "35000 about the handover came to {}, which took over, and not to {}, which still has LOI 2",
            b.id, a.id
        ));
    }
    Ok(())
}

fn the_later_command_stays(t: &Trial) -> Judged {
    let a = t.controller()?;
    let (early, late) = (t.bench.fresh_radius(), t.bench.fresh_radius());
    // Made first, sent last: the network has swapped them.
    let overtaken = a.stamped(Draft::new(2017).set("Loiter Radius", early));
    let overtaken = a.encode(&overtaken);
    t.pause(Duration::from_millis(30))?;
    a.set_radius(late);
    if !a.radius_becomes(late)? {
        return Ok(());
    }
    a.send_bytes(&overtaken);
    t.pause(t.timers().quiet / 3)?;
    let shown = a.radius()?;
    t.expect(shown.is_some_and(|shown| (shown - late).abs() < 0.8), || {
        format!("expected a 2017 that a later one has overtaken not to undo it; 3004 shows {shown:?} m, expected {late} m")
    })
}

fn what_cannot_be_done_is_not_done(t: &Trial) -> Judged {
    let a = t.controller()?;
    // A number that no edition assigns.
    let nothing = 29_999;
    let drafts = [information_request(nothing), schedule(nothing, 1)];
    let sent = drafts.map(|draft| a.send(draft.acked()));
    t.pause(t.timers().quiet)?;
    for sent in sent {
        let kind = sent.kind;
        let done = a
            .received(sent.mark, |seen| {
                about(seen, kind, sent.stamp) && seen.raw("Acknowledgement Type") == Some(2)
            })
            .pop();
        if let Some(done) = done {
            t.expect_of(&done, false, || {
                format!("expected no 'carried out' for a {kind} about message {nothing}, which there is not; 17000 type 2 came")
            })?;
        }
    }
    Ok(())
}

fn equal_stamps_do_not_make_messages_equal(t: &Trial) -> Judged {
    let a = t.controller()?;
    let home = home(t, &a)?;
    clear(t, &a)?;
    // Sent within one millisecond, all have one stamp.
    let plan = Plan::zigzag(&home, "ONEMS", &[1, 2, 3, 4]);
    let stamp = t.bench.net.stamp();
    for message in plan.messages() {
        deliver(&a, message.raw("Time Stamp", stamp));
    }
    let found = run_transfer(t, &a, transfer(2, "ONEMS"), t.timers().load)?;
    t.expect(found.status == Some(1), || {
        format!("expected 14000 status 1 for a route whose messages were made in one millisecond, got {:?}", found.status)
    })?;
    aboard(t, &a, &plan, "aboard, though its messages have one stamp")?;
    // Of two messages for one waypoint the later one is what the operator wants.
    clear(t, &a)?;
    let twice = Plan::zigzag(&home, "TWICE", &[1, 2]);
    let mut changed = twice.clone();
    changed.points[1] = changed.points[1].clone().set("Waypoint to Speed", 8.0);
    for message in twice.messages() {
        deliver(&a, message);
    }
    deliver(&a, changed.points[1].clone());
    let found = run_transfer(t, &a, transfer(2, "TWICE"), t.timers().load)?;
    if found.status != Some(1) {
        t.note("a waypoint that is sent twice is refused");
        return Ok(());
    }
    aboard(
        t,
        &a,
        &changed,
        "with the later of two messages for one waypoint",
    )
}

fn no_name_of_a_plan_that_is_gone(t: &Trial) -> Judged {
    let a = t.controller()?;
    let home = home(t, &a)?;
    let name = format!("OLD{}", t.bench.net.mark() % 10_000);
    loaded(t, &a, &Plan::zigzag(&home, &name, &[1, 2]))?;
    if a.query(3)?.text("Mission ID").as_deref() != Some(&name) {
        return Ok(());
    }
    clear(t, &a)?;
    let deadline = t.bench.net.now() + t.timers().answer;
    let mut shown = a.query(3)?;
    while shown.text("Mission ID").as_deref() == Some(&name) && t.bench.net.now() < deadline {
        t.pause(Duration::from_millis(100))?;
        shown = a.query(3)?;
    }
    t.expect_beside(
        &shown,
        shown.text("Mission ID").as_deref() != Some(&name),
        || format!("expected #3 not to name mission {name} any more once it was cleared"),
    )
}

fn an_unknown_plan_mode_is_not_complete(t: &Trial) -> Judged {
    let a = t.controller()?;
    let sent = a.send(transfer(9, "NOMODE").acked());
    let done = a.wait(sent.mark, t.timers().quiet, |seen| {
        seen.kind() == 14_000 && seen.raw("Status") == Some(1)
            || about(seen, 13_000, sent.stamp) && seen.raw("Acknowledgement Type") == Some(2)
    });
    match done {
        Some(done) => t.expect_of(&done, false, || {
            "expected a 13000 with Mission Plan Mode 9, which there is not, to be refused; its end is reported as complete".into()
        }),
        None => Ok(()),
    }
}

fn the_termination_mode_is_shown(t: &Trial) -> Judged {
    let a = t.launcher()?;
    let terminate = |state: i64, mode: i64| {
        Draft::new(2005)
            .raw("Commanded Flight Termination State", state)
            .raw("Flight Termination Mode", mode)
            .acked()
    };
    let mut result = Ok(());
    for mode in [1, 0] {
        let sent = a.send(terminate(1, mode));
        if refused(t, &a, &sent) {
            t.note(format!("flight termination mode {mode} is refused"));
            continue;
        }
        let shown = a.query(3005)?;
        let named = shown.raw("Reported Flight Termination Mode");
        result = t.expect_beside(&shown, named.is_none_or(|named| named == mode), || {
            format!(
                "expected 3005 to show termination mode {mode} once it was armed, got {named:?}"
            )
        });
        a.send(terminate(0, mode));
        t.pause(Duration::from_millis(200))?;
        if result.is_err() {
            break;
        }
    }
    result
}

/// Judges nothing: it makes a configuration phase beside another CUCS, for the judge of who is sent what.
fn while_others_are_connected(t: &Trial) -> Judged {
    let a = t.controller()?;
    let b = t.b()?;
    t.grant(&b, loi::LOI2)?;
    full(t, &a, 3).precondition("a full configuration")?;
    t.pause(t.timers().quiet / 3)
}

fn a_refusal_names_its_vehicle(t: &Trial) -> Judged {
    let vehicles: Vec<_> = t.bench.surveyed()?.vehicle_ids().collect();
    let [first, second, ..] = vehicles[..] else {
        return Ok(());
    };
    let a = t.a()?;
    let mut other = Station::new(&t.bench, a.id, second)?;
    other.vehicle = second;
    t.grant(&other, loi::LOI2 | loi::LOI4)?;
    let sent = other.send(mode_command(17).acked());
    let alert = other.wait(sent.mark, t.timers().answer, |seen| {
        seen.kind() == 16_000 && seen.raw("Priority").is_some_and(|priority| priority >= 2)
    });
    other.send(authorisation(0x0F, Access::Release));
    match alert {
        Some(alert) => t.expect_of(&alert, alert.piece.source != first, || {
            format!("expected the alert about a command to {second} from that vehicle; it came from {first}")
        }),
        None => Ok(()),
    }
}
