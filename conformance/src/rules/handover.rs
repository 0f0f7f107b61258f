//! HAND, positive handover (4, 5, 35000) and loss of control by silence: that control passes with consent only, never
//! to two and never to none, and that two requests at once have one winner.

use std::time::Duration;

use super::alerts::{Before, COMMS, about_links, cautions};
use super::scene::Scene;
use crate::bench::flight::{Plan, deliver, download, home, loaded, run_transfer, transfer};
use crate::bench::station::{Access, Station, authorisation, information_request, loi};
use crate::bench::trial::Trial;
use crate::verdict::{Judged, Precondition, Stop};
use crate::wire::{Draft, Seen};

pub(super) const SCENES: &[Scene] = &[
    Scene {
        rule: "HAND-001",
        play: handover_is_reported,
    },
    Scene {
        rule: "HAND-002",
        play: never_two_never_none,
    },
    Scene {
        rule: "HAND-003",
        play: positive_handover,
    },
    Scene {
        rule: "HAND-004",
        play: waits_for_the_data_link,
    },
    Scene {
        rule: "HAND-005",
        play: a_handover_that_lapses,
    },
    Scene {
        rule: "HAND-007",
        play: an_upload_is_not_mixed,
    },
    Scene {
        rule: "HB-001",
        play: heartbeat_at_1_hz,
    },
    Scene {
        rule: "HB-002",
        play: no_heartbeats_no_loss,
    },
    Scene {
        rule: "HB-003",
        play: silence_after_heartbeats,
    },
    Scene {
        rule: "HB-004",
        play: heartbeat_before_a_grant,
    },
    Scene {
        rule: "MULTI-004",
        play: two_at_once,
    },
];

fn granted(seen: &Seen) -> i64 {
    seen.raw("LOI Granted").unwrap_or_default()
}

fn handover_is_reported(t: &Trial) -> Judged {
    let a = t.controller()?;
    let b = t.b()?;
    b.take(loi::LOI2).precondition("B has LOI 2")?;
    // Before a handover 35000 reports none: status 0, how the last one ended, or no answer at all.
    let mark = t.bench.net.mark();
    a.send(information_request(35000));
    let idle = a.wait(mark, t.timers().answer / 2, |seen| seen.kind() == 35000);
    if let Some(idle) = idle {
        t.expect_of(&idle, idle.raw("Status") != Some(1), || {
            "expected no handover in progress in 35000 before one began; it shows status 1".into()
        })?;
    }
    let mark = t.bench.net.mark();
    a.request(loi::LOI4, Access::Release)?;
    b.take(loi::LOI4)?;
    let report = match b.wait(mark, t.timers().answer, |seen| seen.kind() == 35000) {
        Some(report) => report,
        None => b.query(35000)?,
    };
    t.cite(&report);
    let id = |field: &str| report.raw(field).map(|raw| stanag_msgs::Id(raw as u32));
    let status = report.raw("Status");
    t.expect_of(&report, matches!(status, Some(1 | 2)), || {
        format!("expected 35000 with status 1 or 2 after a handover, got {status:?}")
    })?;
    if status == Some(1) {
        let done = b.wait(mark, t.timers().answer, |seen| {
            seen.kind() == 35000 && seen.raw("Status") == Some(2)
        });
        t.expect(
            done.is_some() || b.query(35000)?.raw("Status") == Some(2),
            || "expected 35000 status 2 after status 1".into(),
        )?;
    }
    let acquiring = id("CUCS ID (acquiring control)");
    t.expect_of(&report, acquiring.is_none_or(|id| id == b.id), || {
        format!(
            "expected {} as acquiring CUCS in 35000, got {acquiring:?}",
            b.id
        )
    })?;
    t.expect_of(&report, acquiring.is_some(), || {
        "expected the acquiring CUCS in 35000; its field is absent".into()
    })?;
    let relinquishing = id("CUCS ID (relinquishing control)");
    t.expect_of(
        &report,
        relinquishing.is_none_or(|id| id == a.id || id == stanag_msgs::Id::NULL),
        || {
            format!(
                "expected {} as relinquishing CUCS in 35000, got {relinquishing:?}",
                a.id
            )
        },
    )?;
    // 35000 goes to both stations.
    let reported = a.wait(mark, Duration::from_millis(10), |seen| seen.kind() == 35000);
    let reported = reported.map_or_else(|| a.query(35000), Ok)?;
    let taking = reported
        .raw("CUCS ID (acquiring control)")
        .map(|raw| stanag_msgs::Id(raw as u32));
    t.expect_of(&reported, taking.is_none_or(|id| id == b.id), || {
        format!(
            "expected {} as acquiring CUCS in the 35000 to {}, which handed over; got {taking:?}",
            b.id, a.id
        )
    })
}

fn never_two_never_none(t: &Trial) -> Judged {
    let a = t.controller()?;
    let b = t.b()?;
    b.take(loi::LOI2).precondition("B has LOI 2")?;
    a.set_radius(91.5);
    t.expect(a.radius_becomes(91.5)?, || {
        "expected 2017 of the holder in 3004".into()
    })
    .precondition("commands work")?;
    // A's radii are odd multiples of the step, B's even ones, so that 3004 shows whose command counted.
    let step =
        |station_b: bool, count: i64| 1.5 * (70 + 2 * (count % 8) + i64::from(station_b)) as f64;
    let mut owners = Vec::new();
    for count in 0..16 {
        a.set_radius(step(false, count));
        b.set_radius(step(true, count));
        if count == 6 {
            a.send(authorisation(loi::LOI4, Access::Release));
            b.send(authorisation(loi::LOI4, Access::Request));
        }
        if count == 8 {
            // The request may have been lost.
            b.send(authorisation(loi::LOI4, Access::Request));
        }
        t.pause(Duration::from_millis(100))?;
        if let Some(radius) = b.radius()? {
            owners.push((radius / 1.5).round() as i64 % 2 != 70 % 2);
        }
    }
    let changes = owners.windows(2).filter(|pair| pair[0] != pair[1]).count();
    t.expect(changes <= 1, || format!("expected the radii in 3004 to come from A, then from B, never mixed; they changed owner {changes} times (true is B: {owners:?})"))?;
    t.expect(owners.first() == Some(&false), || {
        "expected A's commands before the handover".into()
    })?;
    t.expect(owners.last() == Some(&true), || {
        "expected B's commands after the handover".into()
    })?;
    drop(a);
    // By override, where B may: the former holder's commands must stop acting at once.
    let b_id = b.id;
    b.release()?;
    let over = t.find("one that may override", |cucs| {
        cucs.overrides && cucs.authorised & loi::LOI4 != 0
    });
    let Ok(over) = over else { return Ok(()) };
    let held = t.find("another", |cucs| {
        cucs.id != over.id && cucs.authorised & loi::LOI4 != 0
    })?;
    let _ = b_id;
    t.grant(&held, loi::LOI2 | loi::LOI4)?;
    over.request(loi::LOI2 | loi::LOI4, Access::Override)
        .map(|answer| granted(&answer))
        .precondition("the override is granted")?;
    let radius = t.bench.fresh_radius();
    held.set_radius(radius);
    t.pause(Duration::from_millis(150))?;
    let shown = over.radius()?;
    t.expect(shown.is_none_or(|shown| (shown - radius).abs() > 0.8), || format!("expected 2017 of the former holder {} to be refused at once after an override; 3004 shows it", held.id))
}

fn positive_handover(t: &Trial) -> Judged {
    let a = t.controller()?;
    let b = t.b()?;
    b.take(loi::LOI2).precondition("B has LOI 2")?;
    t.expect(a.commands_work()?, || "expected 2017 of the holder".into())
        .precondition("commands work")?;
    let before = a.radius()?;
    b.send(
        Draft::new(4)
            .id("VSM ID", stanag_msgs::Id::BROADCAST)
            .raw("Requested/Handover LOI", loi::LOI4)
            .id("Requesting CUCS ID", b.id),
    );
    t.pause(t.timers().quiet)?;
    b.set_radius(t.bench.fresh_radius());
    t.pause(Duration::from_millis(300))?;
    let after = a.radius()?;
    t.expect(after == before, || format!("expected nothing to move without the holder's consent; B's 2017 changed the radius from {before:?} to {after:?}"))?;
    t.expect(a.commands_work()?, || {
        "expected the holder's commands to work after a #4 that it did not answer".into()
    })?;
    // The holder's release of what was requested is its consent.
    let mark = t.bench.net.mark();
    b.send(
        Draft::new(4)
            .id("VSM ID", stanag_msgs::Id::BROADCAST)
            .raw("Requested/Handover LOI", loi::LOI4)
            .id("Requesting CUCS ID", b.id),
    );
    t.pause(Duration::from_millis(300))?;
    still_denied(t, &b, "a second #4 without the holder's consent")?;
    if !t.of_edition_25() {
        // The holder answers without releasing.
        a.send(
            Draft::new(4)
                .id("VSM ID", stanag_msgs::Id::BROADCAST)
                .raw("Requested/Handover LOI", 0)
                .id("Requesting CUCS ID", b.id),
        );
        t.pause(Duration::from_millis(300))?;
        still_denied(
            t,
            &b,
            "the holder's #4 without a level, which is no consent",
        )?;
        b.send(
            Draft::new(4)
                .id("VSM ID", stanag_msgs::Id::BROADCAST)
                .raw("Requested/Handover LOI", loi::LOI4)
                .id("Requesting CUCS ID", b.id),
        );
        t.pause(Duration::from_millis(300))?;
    }
    a.request(loi::LOI4, Access::Release)?;
    let grant = b.wait(mark, t.timers().answer, |seen| {
        seen.kind() == 5 && seen.raw("LOI Authorized").unwrap_or_default() != 0
    });
    let Some(grant) = grant else {
        return Err(Stop::fail(
            "expected #5 to the requester of #4 once the holder consented; none came",
        ));
    };
    let (levels, to) = (grant.raw("LOI Authorized"), grant.raw("Requesting CUCS ID"));
    t.expect_of(
        &grant,
        levels.is_some_and(|levels| levels & loi::LOI4 != 0),
        || format!("expected LOI 4 in LOI Authorized of #5, got {levels:?}"),
    )?;
    t.expect_of(
        &grant,
        to.map(|to| stanag_msgs::Id(to as u32)) == Some(b.id),
        || format!("expected {} as Requesting CUCS ID in #5, got {to:?}", b.id),
    )?;
    t.expect(b.commands_work()?, || {
        "expected the commands of the CUCS that #5 names to work".into()
    })
}

fn still_denied(t: &Trial, b: &Station, after: &str) -> Judged {
    let answer = b.request(0, Access::Request)?;
    t.expect_of(&answer, granted(&answer) & loi::LOI4 == 0, || {
        format!(
            "expected {} not to be in control after {after}; LOI Granted is 0x{:02x}",
            b.id,
            granted(&answer)
        )
    })
}

fn waits_for_the_data_link(t: &Trial) -> Judged {
    let b = t.b()?;
    b.take(loi::LOI2).precondition("B has LOI 2")?;
    let mark = t.bench.net.mark();
    b.send(authorisation(loi::LOI4, Access::Request).raw(
        "Wait for Vehicle Data Link Transition Coordination Message",
        1,
    ));
    let early = b.wait(mark, t.timers().quiet, |seen| {
        seen.kind() == 2 && granted(seen) & loi::LOI4 != 0
    });
    if let Some(early) = early {
        t.expect_of(&early, false, || {
            format!(
                "expected a request that waits for the data link not to be granted before 34000; #2 grants LOI 0x{:02x}",
                granted(&early)
            )
        })?;
    }
    // 34000 is sent by the CUCS that will have the link.
    b.send(Draft::new(34000).id("Acquiring CUCS ID", b.id));
    let passed = b.wait(mark, t.timers().answer, |seen| {
        seen.kind() == 2 && granted(seen) & loi::LOI4 != 0
            || seen.kind() == 35000 && matches!(seen.raw("Status"), Some(2 | 3))
    });
    if passed.is_none() {
        t.note("neither a grant nor 35000 came for 34000 by the acquiring CUCS");
    }
    Ok(())
}

fn a_handover_that_lapses(t: &Trial) -> Judged {
    let a = t.controller()?;
    let b = t.b()?;
    b.take(loi::LOI2).precondition("B has LOI 2")?;
    let mark = t.bench.net.mark();
    b.send(
        Draft::new(4)
            .id("VSM ID", stanag_msgs::Id::BROADCAST)
            .raw("Requested/Handover LOI", loi::LOI4)
            .id("Requesting CUCS ID", b.id),
    );
    // B no longer answers, and A never does.
    let status = |wanted: i64| {
        move |seen: &crate::wire::Seen| seen.kind() == 35000 && seen.raw("Status") == Some(wanted)
    };
    let begun = a.wait(mark, t.timers().answer, status(1)).is_some();
    let limit = Duration::from_secs_f64(t.bench.profile.figures.handover_s) + t.timers().answer;
    let failed = a.wait(mark, limit, status(3));
    let successful = a.received(mark, status(2));
    t.expect(successful.is_empty(), || {
        "expected a handover to which nobody consented not to succeed; 35000 status 2 came".into()
    })?;
    let held = a.request(0, Access::Request)?;
    t.expect_of(&held, granted(&held) & loi::LOI4 != 0, || {
        format!(
            "expected the holder to be in control after a handover that lapsed, got LOI Granted 0x{:02x}",
            granted(&held)
        )
    })?;
    t.expect(a.commands_work()?, || {
        "expected the holder's 2017 to work after a handover that lapsed".into()
    })?;
    let before = a.radius()?;
    b.set_radius(t.bench.fresh_radius());
    t.pause(Duration::from_millis(300))?;
    let after = a.radius()?;
    t.expect(after == before, || format!("expected 2017 of {}, whose handover lapsed, to change nothing; the radius went from {before:?} to {after:?}", b.id))?;
    // A later release does not revive a handover that has lapsed.
    a.request(loi::LOI4 | loi::LOI5, Access::Release)?;
    still_denied(
        t,
        &b,
        "a release of the holder after its request had lapsed",
    )?;
    if failed.is_none() && begun {
        let seconds = t.bench.profile.figures.handover_s;
        return Err(Stop::fail(format!(
            "expected 35000 status 3 once a handover lapsed to which nobody consented; it said in progress, and nothing more in {seconds:.0} s (figures.handover_s of the profile)"
        )));
    }
    if failed.is_none() {
        return Err(Stop::inconclusive("no 35000 came for a #4"));
    }
    Ok(())
}

fn an_upload_is_not_mixed(t: &Trial) -> Judged {
    let a = t.controller()?;
    let b = t.b()?;
    let home = home(t, &a)?;
    let plan = Plan::zigzag(&home, "BEFORE", &[1, 2, 3]);
    loaded(t, &a, &plan)?;
    let whole = Plan::zigzag(&home, "MIXED", &[61, 62, 63, 64]);
    let messages = whole.messages();
    for message in &messages[..3] {
        deliver(&a, message.clone());
    }
    a.release()?;
    t.grant(&b, loi::LOI2 | loi::LOI4)?;
    for message in &messages[3..] {
        deliver(&b, message.clone());
    }
    t.loaded.set(true);
    let found = run_transfer(
        t,
        &b,
        transfer(2, "MIXED"),
        t.timers().load.min(t.timers().answer * 8),
    )?;
    let back = download(t, &b, "MIXED")?;
    let numbers: Vec<_> = back
        .messages
        .iter()
        .filter(|seen| seen.kind() == 13002)
        .filter_map(|seen| seen.raw("Waypoint Number"))
        .collect();
    let mixed = numbers.iter().any(|number| (61..=62).contains(number))
        && numbers.iter().any(|number| (63..=64).contains(number));
    t.expect(!mixed, || format!("expected no plan with waypoints of two CUCSs; the download has {numbers:?} (14000 status {:?})", found.status))?;
    t.expect(found.status != Some(1) || !numbers.contains(&61), || {
        "expected a plan begun by A and finished by B to be refused; 14000 status 1 came".into()
    })
}

fn no_heartbeats_no_loss(t: &Trial) -> Judged {
    let a = t.controller()?;
    let b = t.b()?;
    let silence = t.bench.profile.figures.act_s * 1.5;
    // B, which only monitors, sends heartbeats and then stops: that is no loss of control.
    b.take(loi::LOI2).precondition("B has LOI 2")?;
    for _ in 0..2 {
        b.send(Draft::new(16002));
        t.pause(Duration::from_millis(200))?;
    }
    t.pause(Duration::from_secs_f64(silence))?;
    let answer = b.request(loi::LOI4, Access::Request)?;
    t.expect_of(&answer, granted(&answer) & loi::LOI4 == 0, || format!("expected B's request to be denied after {silence:.0} s of a holder that never sent a heartbeat"))?;
    t.expect(a.commands_work()?, || {
        "expected the quiet holder's 2017 to work".into()
    })
}

fn silence_after_heartbeats(t: &Trial) -> Judged {
    let a = t.controller()?;
    let b = t.b()?;
    a.send(Draft::new(16002));
    t.pause(Duration::from_secs(1))?;
    // What comes while the holder is there is not about its silence.
    let calm = t.bench.net.mark();
    for _ in 0..3 {
        a.send(Draft::new(16002));
        t.pause(Duration::from_secs(1))?;
    }
    let before = Before::of(&a.received(calm, |seen| seen.kind() == 16000));
    let of_silence = |station: &Station, seen: &Seen| {
        before.begins(station, seen) && about_links(seen) && cautions(seen)
    };
    let figures = &t.bench.profile.figures;
    let began = t.bench.net.now();
    let mark = t.bench.net.mark();
    // The last heartbeat was one second ago.
    t.pause(Duration::from_secs_f64((figures.offer_s - 2.5).max(0.0)))?;
    // Another station's heartbeats do not count as the holder's.
    b.send(Draft::new(16002));
    let early = b.request(loi::LOI4, Access::Request)?;
    t.expect_of(&early, granted(&early) & loi::LOI4 == 0, || {
        "expected B's request to be denied before control is offered".into()
    })?;
    let wait =
        Duration::from_secs_f64(figures.offer_s + 0.6).saturating_sub(t.bench.net.now() - began);
    t.pause(wait)?;
    // A refused request of the other station is an alert too, but not about the silence.
    let warned = a.received(mark, |seen| of_silence(&a, seen));
    t.expect(!warned.is_empty(), || {
        format!("expected a 16000 of subsystem {COMMS} (communications), caution or worse, about the silence of the holder before its control is offered; none began with it")
    })?;
    let late = b.request(loi::LOI4, Access::Request)?;
    t.expect_of(&late, granted(&late) & loi::LOI4 != 0, || {
        format!(
            "expected B's request to be granted {:.0} s after the holder's last heartbeat",
            figures.offer_s + 1.6
        )
    })?;
    // In the second run nobody requests control, and the holder's heartbeats return: nothing is offered any longer,
    // and the alert about the silence is cleared.
    b.release()?;
    t.grant(&a, loi::LOI2 | loi::LOI4)?;
    let mark = t.bench.net.mark();
    a.send(Draft::new(16002));
    t.pause(Duration::from_secs_f64(figures.offer_s + 0.6))?;
    for _ in 0..2 {
        a.send(Draft::new(16002));
        t.pause(Duration::from_secs(1))?;
    }
    let of = |seen: &Seen| seen.raw("Alert (Warning) ID").unwrap_or_default().abs();
    for raised in a.received(mark, |seen| {
        of_silence(&a, seen)
            && seen.raw("Type") == Some(1)
            && seen.raw("Subsystem ID") == Some(COMMS)
    }) {
        let cleared = a.received(mark, |seen| {
            seen.kind() == 16000 && seen.raw("Priority") == Some(0) && of(seen) == of(&raised)
        });
        t.expect_beside(&raised, !cleared.is_empty(), || {
            format!("expected alert {} about the silence to be cleared when the holder's heartbeats came again; it was not", of(&raised))
        })?;
    }
    let denied = b.request(loi::LOI4, Access::Request)?;
    t.expect_of(&denied, granted(&denied) & loi::LOI4 == 0, || {
        "expected B's request to be denied once the heartbeats of the holder came again; it was granted".into()
    })?;
    // In the third run they do not return: control is taken.
    let last = t.bench.net.now();
    let mark = t.bench.net.mark();
    a.send(Draft::new(16002));
    t.pause(Duration::from_secs_f64(figures.act_s + 1.5))?;
    let radius = t.bench.fresh_radius();
    let sent = a.send(Draft::new(2017).set("Loiter Radius", radius).acked());
    let done = a.wait(sent.mark, t.timers().answer, |seen| {
        seen.kind() == 17000 && seen.raw("Acknowledgement Type") == Some(2)
    });
    t.expect(done.is_none(), || {
        format!(
            "expected a 2017 of the holder to be refused {:.0} s after its last heartbeat, when control was taken; 17000 type 2 came",
            figures.act_s + 1.5
        )
    })?;
    let taken = last + Duration::from_secs_f64((figures.act_s - 1.0).max(0.0));
    let reported = [&a, &b].into_iter().any(|station| {
        let came = station.received(mark, |seen| {
            let says_so = match seen.kind() {
                // The former holder learns by #2 that it holds LOI 4 no longer.
                2 => station.id == a.id && granted(seen) & loi::LOI4 == 0,
                35_000 => seen.raw("Status") != Some(0),
                _ => of_silence(station, seen),
            };
            says_so && seen.at > taken && seen.at < sent.at
        });
        !came.is_empty()
    });
    t.expect(reported, || {
        format!("expected a report that control was taken (16000 of subsystem {COMMS}, #2 without LOI 4 to the former holder, or 35000) {:.0} s after the last heartbeat; none came to either CUCS", figures.act_s)
    })
}

fn heartbeat_at_1_hz(t: &Trial) -> Judged {
    let station = t.monitor()?;
    let mark = t.bench.net.mark();
    for _ in 0..6 {
        station.send(Draft::new(16002));
        t.pause(Duration::from_secs(1))?;
    }
    let times: Vec<f64> = station
        .received(mark, |seen| seen.kind() == 16002)
        .iter()
        .map(|seen| seen.at.as_secs_f64())
        .collect();
    if times.is_empty() {
        return Err(Stop::not_applicable("the subject sends no heartbeats"));
    }
    let gap = times
        .windows(2)
        .map(|pair| pair[1] - pair[0])
        .fold(0.0, f64::max);
    t.expect(gap <= 1.5 && times.len() >= 4, || {
        format!(
            "expected heartbeats about 1 s apart, got {} in 6 s, the longest gap {gap:.1} s",
            times.len()
        )
    })
}

fn heartbeat_before_a_grant(t: &Trial) -> Judged {
    let a = t.any()?;
    let mark = t.bench.net.mark();
    for _ in 0..20 {
        a.send(Draft::new(16002));
        t.pause(Duration::from_millis(20))?;
    }
    a.take(loi::LOI2)?;
    let alerts = a.received(mark, |seen| {
        seen.kind() == 16000
            && seen
                .text("Text")
                .is_some_and(|text| text.to_lowercase().contains("heartbeat"))
    });
    if !alerts.is_empty() {
        return Err(Stop::fail(
            "expected no 16000 about heartbeats before a grant; one came",
        ));
    }
    Ok(())
}

fn two_at_once(t: &Trial) -> Judged {
    let a = t.a()?;
    let b = t.b()?;
    for round in 0..12 {
        let mark = t.bench.net.mark();
        let (first, second) = if round % 2 == 0 { (&a, &b) } else { (&b, &a) };
        first.send(authorisation(loi::LOI4, Access::Request));
        second.send(authorisation(loi::LOI4, Access::Request));
        let answers: Vec<_> = [&a, &b]
            .iter()
            .map(|station| {
                station.wait(mark, t.timers().answer, |seen| {
                    seen.kind() == 2 && seen.piece.destination == station.id
                })
            })
            .collect();
        let settle = t.bench.settle_ms.load(std::sync::atomic::Ordering::SeqCst);
        t.pause(Duration::from_millis(u64::from(settle.max(50))))?;
        let answers: Vec<_> = if settle == 0 {
            answers
        } else {
            [&a, &b]
                .iter()
                .map(|station| {
                    station
                        .received(mark, |seen| {
                            seen.kind() == 2 && seen.piece.destination == station.id
                        })
                        .pop()
                })
                .collect()
        };
        if answers.iter().any(Option::is_none) {
            return Err(Stop::inconclusive("a request was not answered"));
        }
        let holders: Vec<bool> = answers
            .iter()
            .flatten()
            .map(|answer| granted(answer) & loi::LOI4 != 0)
            .collect();
        for answer in answers.iter().flatten() {
            t.cite(answer);
        }
        t.expect(holders.iter().filter(|held| **held).count() == 1, || format!("expected exactly one of two requests that came together to be granted; granted to A and B: {holders:?}"))?;
        a.release()?;
        b.release()?;
    }
    Ok(())
}
