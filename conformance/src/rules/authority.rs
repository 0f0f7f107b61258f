//! AUTH, levels of interoperability (messages 1 and 2): who is granted what, that at most one CUCS controls, that
//! commands need their level, and that control survives what it has to survive (silence, a restart, another port).

use std::sync::atomic::Ordering;
use std::time::Duration;

use super::acknowledgement::carried_out;
use super::scene::Scene;
use crate::bench::flight::{
    Plan, airborne, clear, deliver, difference, download, home, land, loaded, mode, mode_command,
    reported_mode, run_transfer, transfer,
};
use crate::bench::station::{Access, Station, authorisation, information_request, loi, schedule};
use crate::bench::trial::Trial;
use crate::verdict::{Judged, Precondition, Stop};
use crate::wire::Draft;

pub(super) const SCENES: &[Scene] = &[
    Scene {
        rule: "AUTH-001",
        play: free_control_is_granted,
    },
    Scene {
        rule: "AUTH-002",
        play: held_control_is_denied,
    },
    Scene {
        rule: "AUTH-003",
        play: override_by_who_may,
    },
    Scene {
        rule: "AUTH-004",
        play: control_lasts,
    },
    Scene {
        rule: "AUTH-005",
        play: release_is_granted,
    },
    Scene {
        rule: "AUTH-006",
        play: commands_need_their_loi,
    },
    Scene {
        rule: "AUTH-010",
        play: any_number_may_monitor,
    },
    Scene {
        rule: "AUTH-011",
        play: never_more_than_authorised,
    },
    Scene {
        rule: "AUTH-012",
        play: loi_bits,
    },
    Scene {
        rule: "AUTH-013",
        play: launch_needs_loi_5,
    },
    Scene {
        rule: "AUTH-016",
        play: every_request_gets_its_answer,
    },
    Scene {
        rule: "AUTH-017",
        play: only_the_holder_can_release,
    },
    Scene {
        rule: "AUTH-018",
        play: control_survives_a_restart,
    },
    Scene {
        rule: "AUTH-019",
        play: another_port_the_same_cucs,
    },
    Scene {
        rule: "AUTH-020",
        play: loi_2_messages_before_a_grant,
    },
];

fn granted(seen: &crate::wire::Seen) -> i64 {
    seen.raw("LOI Granted").unwrap_or_default()
}

/// A station's plain request for LOI 4 has to be denied, and its 2017 must change nothing.
fn denied(t: &Trial, station: &Station) -> Judged {
    let answer = station.request(loi::LOI4, Access::Request)?;
    t.expect_of(&answer, granted(&answer) & loi::LOI4 == 0, || {
        format!(
            "expected #2 to {} without LOI 4 while another holds it; got LOI Granted 0x{:02x}",
            station.id,
            granted(&answer)
        )
    })
}

/// A station's 2017 must change nothing that the holder sees.
fn powerless(t: &Trial, holder: &Station, other: &Station, why: &str) -> Judged {
    let before = holder.radius()?;
    let radius = t.bench.fresh_radius();
    let sent = other.send(Draft::new(2017).set("Loiter Radius", radius).acked());
    let done = carried_out(t, other, &sent, t.timers().quiet / 2)?;
    t.expect(done.is_none(), || {
        format!(
            "expected no 'carried out' for a 2017 of {} ({why}); 17000 type 2 came",
            other.id
        )
    })?;
    let after = holder.radius()?;
    t.expect(after == before, || format!("expected a 2017 of {} ({why}) to change nothing; the loiter radius went from {before:?} to {after:?}", other.id))
}

fn obeyed(t: &Trial, station: &Station, why: &str) -> Judged {
    let works = station.commands_work()?;
    t.expect(works, || {
        format!(
            "expected a 2017 of {} ({why}) to change 3004; it does not",
            station.id
        )
    })
}

fn free_control_is_granted(t: &Trial) -> Judged {
    let a = t.a()?;
    let answer = a.take(loi::LOI4)?;
    let access = answer.raw("Access Granted");
    t.expect_of(&answer, access == Some(1), || {
        format!("expected Access Granted 1 with the grant, got {access:?}")
    })?;
    t.expect(answer.piece.destination == a.id, || {
        format!("expected #2 to {}, got {}", a.id, answer.piece.destination)
    })?;
    obeyed(t, &a, "granted LOI 4")?;
    // The second time too, and together with other levels; a grant never has what was not requested.
    a.release()?;
    let all = t.bench.surveyed()?.with(loi::LOI4 | loi::LOI5);
    let five = if all.iter().any(|cucs| cucs.id == a.id) {
        loi::LOI5
    } else {
        0
    };
    for levels in [
        loi::LOI4,
        loi::LOI2 | loi::LOI4,
        loi::LOI2 | loi::LOI4 | five,
    ] {
        let answer = a.take(levels)?;
        let more = granted(&answer) & !levels & loi::LOI5;
        t.expect_of(&answer, more == 0, || {
            format!(
                "expected LOI 5 to stay away from a CUCS that requested LOI 0x{levels:02x}; got LOI Granted 0x{:02x}",
                granted(&answer)
            )
        })?;
        let released = a.release()?;
        let access = released.raw("Access Granted");
        t.expect_of(&released, access != Some(1), || {
            format!("expected Access Granted 0 after a release of everything, got {access:?}")
        })?;
        t.expect_of(&released, granted(&released) & (loi::LOI4 | loi::LOI5) == 0, || {
            format!(
                "expected no control after the release of LOI 0x{levels:02x}, got LOI Granted 0x{:02x}",
                granted(&released)
            )
        })?;
    }
    Ok(())
}

fn held_control_is_denied(t: &Trial) -> Judged {
    let a = t.controller()?;
    let b = t.b()?;
    let answer = b.request(loi::LOI4, Access::Request)?;
    let access = answer.raw("Access Granted");
    t.expect_of(&answer, access != Some(1), || {
        format!(
            "expected Access Granted 0 with the denial to {}, which holds nothing; got {access:?}",
            b.id
        )
    })?;
    denied(t, &b)?;
    obeyed(t, &a, "the holder")?;
    powerless(t, &a, &b, "denied")
}

fn override_by_who_may(t: &Trial) -> Judged {
    let b = t.find("a CUCS id that may override", |cucs| {
        cucs.overrides && cucs.authorised & loi::LOI4 != 0
    })?;
    let a = t.find("another CUCS id that may have LOI 4", |cucs| {
        cucs.id != b.id && cucs.authorised & loi::LOI4 != 0
    })?;
    t.grant(&a, loi::LOI2 | loi::LOI4)?;
    obeyed(t, &a, "the holder").precondition("commands work")?;
    // A CUCS that may not override gets nothing by it.
    let weak = t.find("one that may not override", |cucs| {
        !cucs.overrides && cucs.id != a.id && cucs.id != b.id && cucs.authorised & loi::LOI4 != 0
    });
    if let Ok(weak) = weak {
        let answer = weak.request(loi::LOI4, Access::Override)?;
        t.expect_of(&answer, granted(&answer) & loi::LOI4 == 0, || {
            format!(
                "expected an override by {} to be denied, which the policy does not allow it",
                weak.id
            )
        })?;
    }
    let mark = t.bench.net.mark();
    let answer = b.request(loi::LOI2 | loi::LOI4, Access::Override)?;
    t.expect_of(&answer, granted(&answer) & loi::LOI4 != 0, || {
        format!(
            "expected an override by {} to be granted, got LOI Granted 0x{:02x}",
            b.id,
            granted(&answer)
        )
    })?;
    // At once: a former holder that is obeyed for some more seconds means two CUCSs in control.
    let radius = t.bench.fresh_radius();
    let before = b.radius()?;
    a.set_radius(radius);
    t.pause(Duration::from_millis(200))?;
    let after = b.radius()?;
    t.expect(after == before, || format!("expected 2017 of the former holder {} to change nothing; the radius went from {before:?} to {after:?}", a.id))?;
    obeyed(t, &b, "the new holder")?;
    powerless(t, &b, &a, "overridden")?;
    let notice = a.wait(mark, Duration::from_millis(10), |seen| seen.kind() == 2);
    let asked = match notice {
        Some(notice) => notice,
        None => a.request(0, Access::Request)?,
    };
    t.expect_of(&asked, granted(&asked) & loi::LOI4 == 0, || {
        format!(
            "expected #2 to {} without LOI 4 after the override, got 0x{:02x}",
            a.id,
            granted(&asked)
        )
    })
}

fn control_lasts(t: &Trial) -> Judged {
    let a = t.controller()?;
    let b = t.b()?;
    let end = t.bench.net.now()
        + Duration::from_secs(61).mul_f64(
            t.bench
                .profile
                .timers
                .get("factor")
                .copied()
                .unwrap_or(1.0)
                .max(0.9),
        );
    while t.bench.net.now() < end {
        t.pause(Duration::from_secs(5))?;
        a.send(information_request(3));
        denied(t, &b)?;
    }
    obeyed(t, &a, "the holder that was quiet")
}

/// A message that is sent only by a schedule.
const SCHEDULED: u16 = 3004;

fn release_is_granted(t: &Trial) -> Judged {
    let a = t.controller()?;
    let b = t.b()?;
    a.send(schedule(SCHEDULED, 5));
    let answer = a.release()?;
    t.expect_of(
        &answer,
        granted(&answer) & (loi::LOI4 | loi::LOI5) == 0,
        || {
            format!(
                "expected #2 without LOI 4 after the release, got LOI Granted 0x{:02x}",
                granted(&answer)
            )
        },
    )?;
    b.take(loi::LOI2 | loi::LOI4)?;
    obeyed(t, &b, "granted after the release of another")?;
    powerless(t, &b, &a, "released")?;
    // A release of all levels also ends the status: it would otherwise continue for ever, to an address that another
    // CUCS may have by then.
    let mark = t.bench.net.mark();
    t.pause(t.timers().status / 10)?;
    let status = a.received(mark, |seen| {
        matches!(seen.kind(), SCHEDULED | 3001 | 3002 | 4000 | 4001)
            && seen.piece.destination == a.id
    });
    t.expect(status.is_empty(), || {
        format!(
            "expected no more status to {}, which has given back all levels; {} messages came, such as {}",
            a.id,
            status.len(),
            status[0].kind()
        )
    })
}

fn commands_need_their_loi(t: &Trial) -> Judged {
    let a = t.controller()?;
    obeyed(t, &a, "the holder").precondition("commands work")?;
    let home = home(t, &a)?;
    let plan = Plan::zigzag(&home, "OWN", &[1, 2, 3]);
    loaded(t, &a, &plan)?;
    let monitor = t.b()?;
    monitor.take(loi::LOI2).precondition("B has LOI 2")?;
    let nothing = t.c().or_else(|_| t.stranger())?;
    for (station, why) in [(&monitor, "LOI 2 only"), (&nothing, "no LOI")] {
        powerless(t, &a, station, why)?;
        let lights = |seen: &crate::wire::Seen| seen.raw("Navigation Lights State");
        let lit = a.query(3006).ok().and_then(|seen| lights(&seen));
        let before = reported_mode(&a)?;
        let wanted = if before == Some(mode::LOITER) {
            mode::WAYPOINT
        } else {
            mode::LOITER
        };
        let mark = t.bench.net.mark();
        station.send(mode_command(wanted).acked());
        for message in Plan::zigzag(&home, "FOREIGN", &[7, 8]).messages() {
            station.send(message.acked());
        }
        station.send(transfer(2, "FOREIGN").acked());
        station.send(
            Draft::new(2008)
                .raw("Engine Number", 1)
                .raw("Engine Command", 1)
                .acked(),
        );
        station.send(
            Draft::new(2005)
                .raw("Commanded Flight Termination State", 1)
                .acked(),
        );
        let other = lit.unwrap_or_default() ^ 1;
        station.send(Draft::new(2007).raw("Set Lights", other).acked());
        station.send(
            Draft::new(2000)
                .raw("Initial Propulsion Energy", 100)
                .acked(),
        );
        station.send(transfer(1, "FOREIGN").acked());
        let done = station.wait(mark, t.timers().quiet, |seen| {
            (seen.kind() == 17000 && seen.raw("Acknowledgement Type") == Some(2))
                || (seen.kind() == 14000 && seen.raw("Status") == Some(1))
        });
        if let Some(done) = done {
            t.expect_of(&done, false, || format!("expected commands of a CUCS with {why} to be refused or ignored; message {} says that one was carried out", done.kind()))?;
        }
        if let Some(lit) = lit {
            let shown = a.query(3006)?;
            t.expect_of(&shown, lights(&shown) == Some(lit), || {
                format!("expected 2007 of a CUCS with {why} to switch no light; 3006 went from 0x{lit:02x} to {:02x?}", lights(&shown))
            })?;
        }
        let engine = a.query(3007).ok();
        if let Some(engine) = engine.filter(|seen| seen.raw("Engine Status") != Some(0)) {
            t.expect_of(
                &engine,
                engine.raw("Reported Engine Command") != Some(1),
                || {
                    format!(
                        "expected 2008 of a CUCS with {why} to start no engine; 3007 reports it"
                    )
                },
            )?;
        }
        let armed = a.query(3005).ok();
        if let Some(armed) = armed {
            let state = armed.raw("Reported Flight Termination State");
            t.expect_of(&armed, state.unwrap_or_default() == 0, || {
                format!("expected 2005 of a CUCS with {why} to arm nothing; 3005 shows {state:?}")
            })?;
        }
        let after = reported_mode(&a)?;
        t.expect(after == before || after != Some(wanted), || format!("expected 2016 of a CUCS with {why} to change nothing; 3001 went from {before:?} to {after:?}"))?;
    }
    let found = download(t, &a, "OWN")?;
    match difference(&plan, &found, &t.bench) {
        None => an_upload_is_the_holders(t, &a, &monitor),
        Some(difference) => Err(Stop::fail(format!(
            "expected the plan aboard unchanged by CUCSs without LOI 4; {difference}"
        ))),
    }
}

/// Between the holder's waypoints and its load command another CUCS changes one waypoint, and sends a cancel.
fn an_upload_is_the_holders(t: &Trial, a: &Station, monitor: &Station) -> Judged {
    let home = home(t, a)?;
    clear(t, a)?;
    let plan = Plan::zigzag(&home, "MINE", &[51, 52, 53]);
    for message in plan.messages() {
        deliver(a, message);
    }
    let other = Plan::zigzag(&home, "FOREIGN", &[50, 51, 52]);
    for message in &other.points {
        monitor.send(message.clone());
    }
    monitor.send(transfer(5, "MINE"));
    t.pause(Duration::from_millis(200))?;
    let loaded = run_transfer(t, a, transfer(2, "MINE"), t.timers().load)?;
    t.expect(loaded.status == Some(1), || {
        format!(
            "expected the holder's upload to load, whatever {} with LOI 2 sent in between; got 14000 status {:?}",
            monitor.id, loaded.status
        )
    })?;
    let found = download(t, a, "MINE")?;
    match difference(&plan, &found, &t.bench) {
        None => Ok(()),
        Some(difference) => Err(Stop::fail(format!(
            "expected the holder's upload unchanged by waypoints of {} with LOI 2; {difference}",
            monitor.id
        ))),
    }
}

fn any_number_may_monitor(t: &Trial) -> Judged {
    let _a = t.controller()?;
    let mut monitors = vec![t.b()?];
    monitors.extend(t.c().ok());
    for station in &monitors {
        station.take(loi::LOI2)?;
        let mark = t.bench.net.mark();
        let came = station
            .wait(mark, t.timers().answer * 2, |seen| seen.kind() == 4000)
            .is_some()
            || station.query(4000).is_ok();
        t.expect(came, || {
            format!(
                "expected 4000 at {} with LOI 2 while another has LOI 4",
                station.id
            )
        })?;
    }
    Ok(())
}

fn never_more_than_authorised(t: &Trial) -> Judged {
    let survey = t.bench.surveyed()?;
    let limited: Vec<_> = survey
        .cucs
        .iter()
        .filter(|cucs| cucs.claimed.unwrap_or(cucs.authorised) & 0x0F != 0x0F)
        .map(|cucs| (cucs.id, cucs.claimed))
        .collect();
    let mut stations = vec![(t.any()?, None)];
    for (id, claimed) in limited {
        stations.push((t.station(id)?, claimed));
    }
    for (station, claimed) in stations {
        let answer = station.request(0x0F, Access::Request)?;
        let authorised = claimed.or(answer.raw("LOI Authorized")).unwrap_or_default();
        t.expect_of(&answer, granted(&answer) & !authorised == 0, || {
            format!(
                "expected at most LOI 0x{authorised:02x} for {}, got LOI Granted 0x{:02x}",
                station.id,
                granted(&answer)
            )
        })?;
        station.release()?;
    }
    // A CUCS that may not override gets nothing by it.
    let a = t.controller()?;
    let b = t.find("one that may not override", |cucs| {
        !cucs.overrides
            && cucs.id != a.id
            && cucs.authorised & loi::LOI4 != 0
            && cucs.claimed.is_some()
    });
    if let Ok(b) = b {
        let answer = b.request(loi::LOI4, Access::Override)?;
        t.expect_of(&answer, granted(&answer) & loi::LOI4 == 0, || format!("expected the override of {} to be denied, which its policy in the profile does not allow", b.id))?;
    }
    Ok(())
}

fn loi_bits(t: &Trial) -> Judged {
    let survey = t.bench.surveyed()?;
    let mut seen_any = false;
    for cucs in &survey.cucs {
        let station = t.station(cucs.id)?;
        for answer in station.discover()? {
            let Some(raw) = answer.raw("LOI Authorized") else {
                continue;
            };
            seen_any = true;
            if let Some(claimed) = cucs.claimed {
                let payload = survey.stations().is_empty();
                // LOI 3 concerns payload stations: a VSM without any need not offer it.
                let expected = if payload {
                    claimed & !loi::LOI3
                } else {
                    claimed
                };
                let found = if payload { raw & !loi::LOI3 } else { raw };
                let reading_m = raw >> 1 == claimed && raw & 1 == 0;
                t.expect_of(&answer, found == expected, || {
                    format!(
                        "expected LOI Authorised 0x{expected:02x} for {} as the profile says; got 0x{raw:02x}{}",
                        cucs.id,
                        if reading_m { ", which is the bits 2, 4, 8, 16 of reading M" } else { "" }
                    )
                })?;
            }
            t.expect_of(&answer, raw & !0x0F == 0, || format!("expected LOI bits 1, 2, 4 and 8; got 0x{raw:02x} in LOI Authorised of {} (2, 4, 8, 16 would be reading M)", cucs.id))?;
            // Every higher level includes LOI 2: a subject whose bits start at 2 uses the other reading.
            t.expect_of(&answer, raw & loi::LOI2 != 0 || raw == 0, || format!("expected LOI 2 (bit 1) in LOI Authorised 0x{raw:02x} of {}, since every higher level contains it", cucs.id))?;
        }
    }
    let station = t.any()?;
    let answer = station.take(loi::LOI2)?;
    t.expect_of(&answer, granted(&answer) & !loi::LOI2 == 0, || {
        format!(
            "expected LOI Granted 0x01 after a request of LOI 2, got 0x{:02x}",
            granted(&answer)
        )
    })?;
    t.expect(seen_any, || "expected LOI Authorised in message 2".into())
}

fn launch_needs_loi_5(t: &Trial) -> Judged {
    let a = t.controller()?;
    let answer = a.request(0, Access::Request)?;
    t.expect(granted(&answer) & loi::LOI5 == 0, || {
        "LOI 5 was granted without being asked for".into()
    })
    .precondition("A has LOI 4 only")?;
    not_without_loi_5(t, &a, mode::LAUNCH)?;
    let engine = a.query(3007);
    if let Ok(engine) = engine {
        t.expect_of(
            &engine,
            engine.raw("Engine Status").unwrap_or_default() == 0,
            || "expected engines stopped in 3007 after a launch with LOI 4 only".into(),
        )?;
    }
    a.release()?;
    if !t.bench.flight_released.load(Ordering::SeqCst) {
        return Ok(());
    }
    // The landing is tried in flight: on the ground it would be refused for another reason.
    let Ok(a) = airborne(t) else { return Ok(()) };
    let answer = a.request(loi::LOI5, Access::Release)?;
    let result = if granted(&answer) & (loi::LOI4 | loi::LOI5) == loi::LOI4 {
        not_without_loi_5(t, &a, mode::LAND)
    } else {
        t.note("LOI 5 cannot be released alone: the landing is not judged");
        Ok(())
    };
    a.release()?;
    land(t)?;
    result
}

/// A mode of launch and recovery, commanded with LOI 4 alone, changes nothing.
fn not_without_loi_5(t: &Trial, a: &Station, wanted: i64) -> Judged {
    let before = reported_mode(a)?;
    let sent = a.send(mode_command(wanted).raw("Altitude Command Type", 1).acked());
    let done = carried_out(t, a, &sent, t.timers().quiet)?;
    if let Some(done) = done {
        t.expect_of(&done, false, || {
            format!("expected mode {wanted} with LOI 4 only to be refused; 17000 type 2 came")
        })?;
    }
    let after = reported_mode(a)?;
    t.expect(after == before || after != Some(wanted), || {
        format!(
            "expected 3001 to stay at {before:?} after mode {wanted} with LOI 4 only, got {after:?}"
        )
    })
}

fn every_request_gets_its_answer(t: &Trial) -> Judged {
    let a = t.controller()?;
    let b = t.b()?;
    b.take(loi::LOI2).precondition("B has LOI 2")?;
    for levels in [loi::LOI4, loi::LOI2, loi::LOI2 | loi::LOI4] {
        let first = b.request(levels, Access::Request)?;
        let second = b.request(levels, Access::Request)?;
        t.cite(&first);
        t.expect_of(&second, granted(&first) == granted(&second), || {
            format!(
                "expected the same LOI Granted to the same request, got 0x{:02x} and 0x{:02x}",
                granted(&first),
                granted(&second)
            )
        })?;
        t.expect(granted(&first) & loi::LOI2 != 0, || {
            format!(
                "expected LOI Granted to be all that the CUCS holds, LOI 2 among it; got 0x{:02x}",
                granted(&first)
            )
        })?;
        t.expect(granted(&first) & loi::LOI4 == 0, || {
            format!(
                "expected LOI 4 denied while {} holds it; got 0x{:02x}",
                a.id,
                granted(&first)
            )
        })?;
    }
    // The answer may have been lost: the same bytes are answered again.
    let sent = b.send(authorisation(loi::LOI4, Access::Request));
    let answers = |seen: &crate::wire::Seen| seen.kind() == 2;
    let first = b.wait(sent.mark, t.timers().answer, answers);
    let mark = b.send_bytes(&sent.bytes);
    let again = b.wait(mark, t.timers().answer, answers).or_else(|| {
        let mark = b.send_bytes(&sent.bytes);
        b.wait(mark, t.timers().answer, answers)
    });
    t.expect(first.is_none() || again.is_some(), || {
        "expected #2 to a request that comes a second time with the same bytes; none came".into()
    })?;
    powerless(t, &a, &b, "LOI Granted shows LOI 2 only")?;
    // The holder requests again: whatever LOI Granted shows it to hold has to work.
    for levels in [loi::LOI4, loi::LOI2, 0] {
        let answer = a.request(levels, Access::Request)?;
        let shown = granted(&answer) & loi::LOI4 != 0;
        t.expect_of(&answer, shown, || {
            format!(
                "expected the holder to keep LOI 4 when it requests LOI 0x{levels:02x}; got LOI Granted 0x{:02x}",
                granted(&answer)
            )
        })?;
    }
    obeyed(t, &a, "the holder that asked again")
}

fn only_the_holder_can_release(t: &Trial) -> Judged {
    let a = t.controller()?;
    let b = t.b()?;
    let _ = b.request(loi::LOI4, Access::Release);
    let _ = b.request(0x0F, Access::Release);
    let held = a.request(0, Access::Request)?;
    t.expect_of(&held, granted(&held) & loi::LOI4 != 0, || {
        format!(
            "expected {} to hold LOI 4 after a release by {}, which holds nothing; got 0x{:02x}",
            a.id,
            b.id,
            granted(&held)
        )
    })?;
    // Also not when B gives up a level of its own.
    b.take(loi::LOI2).precondition("B has LOI 2")?;
    b.release()?;
    let held = a.request(0, Access::Request)?;
    t.expect_of(&held, granted(&held) & loi::LOI4 != 0, || {
        format!(
            "expected {} to hold LOI 4 after {} gave up its LOI 2; got 0x{:02x}",
            a.id,
            b.id,
            granted(&held)
        )
    })?;
    obeyed(t, &a, "the holder, after another's release")
}

fn control_survives_a_restart(t: &Trial) -> Judged {
    let a = t.controller()?;
    let b = t.b()?;
    let command = t.bench.profile.means.restart.clone().unwrap_or_default();
    crate::means::shell(&command).map_err(Stop::Inconclusive)?;
    let answer = first_answer(t, &b)?;
    t.expect_of(&answer, granted(&answer) & loi::LOI4 == 0, || "expected B's request to be denied after the restart, because A was in control; it was granted".into())?;
    obeyed(t, &a, "the holder before the restart")?;
    // What was released before the restart is free after it.
    a.release()?;
    crate::means::shell(&command).map_err(Stop::Inconclusive)?;
    let answer = first_answer(t, &b)?;
    t.expect_of(&answer, granted(&answer) & loi::LOI4 != 0, || "expected B's request to be granted after a restart, because A had released control before it; it was denied".into())
}

/// The first answer to a request for LOI 4, from a subject that is still starting.
fn first_answer(t: &Trial, station: &Station) -> Judged<std::sync::Arc<crate::wire::Seen>> {
    let mark = t.bench.net.mark();
    for _ in 0..20 {
        station.send(authorisation(loi::LOI4, Access::Request));
        if let Some(answer) = station.wait(mark, t.timers().answer / 2, |seen| seen.kind() == 2) {
            return Ok(answer);
        }
    }
    Err(Stop::inconclusive(
        "the subject does not answer after its restart",
    ))
}

fn another_port_the_same_cucs(t: &Trial) -> Judged {
    let old = t.controller()?;
    obeyed(t, &old, "the holder").precondition("commands work")?;
    let new = t.station(old.id)?;
    obeyed(t, &new, "the holder from another port")?;
    let mark = t.bench.net.mark();
    let came = new.wait(
        mark,
        Duration::from_secs(2).max(t.timers().answer),
        |seen| seen.kind() == 4000,
    );
    t.expect(came.is_some(), || {
        "expected 4000 at the new port within 2 s; none came".into()
    })?;
    // Alerts go to the address where the station is now.
    let mark = t.bench.net.mark();
    new.send(mode_command(17).acked());
    let alert = |seen: &crate::wire::Seen| seen.kind() == 16000;
    let moved = new.wait(mark, t.timers().answer, alert);
    t.expect(moved.is_some() || old.received(mark, alert).is_empty(), || {
        "expected the alert about a refused command at the port from which it was sent; it came to the port before".into()
    })
}

fn loi_2_messages_before_a_grant(t: &Trial) -> Judged {
    let station = t.any()?;
    let mark = t.bench.net.mark();
    station.send(super::configuration::request(1));
    station.send(information_request(3));
    t.pause(t.timers().answer)?;
    let came = station
        .received(mark, |seen| {
            matches!(seen.kind(), 3 | 41000..=41005 | 44003)
        })
        .len();
    t.note(format!(
        "{came} messages came in answer to 40000 and 17002 before a grant"
    ));
    if !t.bench.surveyed()?.with(loi::LOI4).is_empty() && station.take(loi::LOI4).is_err() {
        return Err(Stop::fail(
            "expected a grant of LOI 4 after LOI 2 messages without a grant; it is denied",
        ));
    }
    station.take(loi::LOI2)?;
    Ok(())
}
