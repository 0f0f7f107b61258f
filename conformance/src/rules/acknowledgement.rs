//! ACK, acknowledgements (17000): that each requested one comes, names its message and goes to its sender, that none
//! comes otherwise, and that a repeated message is answered again but not carried out again.

use std::sync::Arc;
use std::time::Duration;

use super::scene::Scene;
use crate::bench::flight::{
    airborne, home, mode, mode_becomes, mode_command, reported_mode, transfer, waypoint,
};
use crate::bench::station::{
    Access, Sent, Station, about, authorisation, information_request, schedule,
};
use crate::bench::trial::Trial;
use crate::verdict::{Judged, Stop};
use crate::wire::{Draft, Seen};

pub(super) const SCENES: &[Scene] = &[
    Scene {
        rule: "ACK-001",
        play: acknowledgement_when_asked_for,
    },
    Scene {
        rule: "ACK-002",
        play: no_acknowledgement_unasked,
    },
    Scene {
        rule: "ACK-003",
        play: acknowledgements_are_not_acknowledged,
    },
    Scene {
        rule: "ACK-005",
        play: a_report_is_its_own_acknowledgement,
    },
    Scene {
        rule: "ACK-006",
        play: a_repetition_is_not_carried_out_again,
    },
    Scene {
        rule: "ACK-007",
        play: received_then_done_or_refused,
    },
];

/// Whether a 17000 type 3 about a message came within the time of an acknowledgement.
pub(super) fn refused(t: &Trial, a: &Station, sent: &Sent) -> bool {
    a.wait(sent.mark, t.timers().ack, |seen| {
        about(seen, sent.kind, sent.stamp) && seen.raw("Acknowledgement Type") == Some(3)
    })
    .is_some()
}

/// The 17000 that reports a message as carried out, where one comes within `time`. A refusal ends the wait shortly
/// after it: [`AFTER_REFUSAL`] is left to see whether it was carried out all the same.
pub(super) fn carried_out(
    t: &Trial,
    station: &Station,
    sent: &Sent,
    time: Duration,
) -> Judged<Option<Arc<Seen>>> {
    let ended = |seen: &Seen| {
        about(seen, sent.kind, sent.stamp)
            && seen
                .raw("Acknowledgement Type")
                .is_some_and(|kind| kind != 1)
    };
    let Some(end) = station.wait(sent.mark, time, ended) else {
        return Ok(None);
    };
    if end.raw("Acknowledgement Type") == Some(2) {
        return Ok(Some(end));
    }
    t.pause(AFTER_REFUSAL.min(time))?;
    Ok(None)
}

/// How long after a refusal the state is checked.
const AFTER_REFUSAL: Duration = Duration::from_millis(250);

fn acknowledgement_when_asked_for(t: &Trial) -> Judged {
    let a = t.controller()?;
    let mut sent = Vec::new();
    for _ in 0..3 {
        sent.push(
            a.send(
                Draft::new(2017)
                    .set("Loiter Radius", t.bench.fresh_radius())
                    .acked(),
            ),
        );
    }
    for one in &sent {
        let mut found = a.wait(one.mark, t.timers().ack, |seen| {
            about(seen, one.kind, one.stamp)
        });
        if found.is_none() {
            let late = a.wait(one.mark, t.timers().ack * 2, |seen| {
                about(seen, one.kind, one.stamp)
            });
            if late.is_some() {
                t.warn("17000 came late");
            }
            found = late;
        }
        if found.is_none() {
            // One of the two may have been lost: the same bytes once more.
            a.send_bytes(&one.bytes);
            found = a.wait(one.mark, t.timers().ack, |seen| {
                about(seen, one.kind, one.stamp)
            });
        }
        let Some(found) = found else {
            return Err(Stop::fail(format!(
                "expected 17000 about 2017 with stamp {} within {:.1} s; none came",
                one.stamp,
                t.timers().ack.as_secs_f64()
            )));
        };
        t.expect_of(&found, found.piece.destination == a.id, || {
            format!(
                "expected 17000 to its sender {}, got {}",
                a.id, found.piece.destination
            )
        })?;
    }
    // Every command that requests an acknowledgement, whether or not it can be carried out here; settings alone would
    // not show that.
    let home = home(t, &a)?;
    let point = waypoint(&home, 5, 0, home.latitude, home.longitude, 40.0);
    for draft in [
        mode_command(mode::LOITER),
        point,
        Draft::new(2007).raw("Set Lights", 0),
        transfer(5, "ACK"),
        schedule(3, 0),
        Draft::new(15_000).raw("Subsystem ID", 1),
        super::configuration::request(6),
        authorisation(0, Access::Request),
    ] {
        let kind = draft.message_type;
        let sent = a.send(draft.acked());
        let mut found = None;
        for attempt in 0..3 {
            if attempt > 0 {
                a.send_bytes(&sent.bytes);
            }
            found = a.wait(sent.mark, t.timers().ack, |seen| {
                about(seen, kind, sent.stamp)
            });
            if found.is_some() {
                break;
            }
        }
        let Some(found) = found else {
            return Err(Stop::fail(format!(
                "expected 17000 about {kind} with stamp {}, which asked for it; none came",
                sent.stamp
            )));
        };
        t.expect_of(&found, found.piece.source == a.vehicle, || {
            format!(
                "expected 17000 from the vehicle {} that was commanded, got one from {}",
                a.vehicle, found.piece.source
            )
        })?;
    }
    Ok(())
}

fn no_acknowledgement_unasked(t: &Trial) -> Judged {
    let a = t.controller()?;
    let sent = a.set_radius(t.bench.fresh_radius());
    let found = a.wait(sent.mark, t.timers().quiet, |seen| seen.kind() == 17000);
    if let Some(found) = found {
        t.expect_of(&found, false, || {
            "expected no 17000 to a 2017 without the acknowledgement bit; one came".into()
        })?;
    }
    let home = home(t, &a)?;
    let mark = t.bench.net.mark();
    a.send(mode_command(mode::LOITER));
    a.send(waypoint(&home, 5, 0, home.latitude, home.longitude, 40.0));
    a.send(transfer(5, "ACK"));
    a.send(Draft::new(2007).raw("Set Lights", 0));
    let found = a.wait(mark, t.timers().quiet, |seen| seen.kind() == 17000);
    if let Some(found) = found {
        t.expect_of(&found, false, || {
            format!(
                "expected no 17000 to messages without the acknowledgement bit; one about {:?} came",
                found.raw("Original Message Type")
            )
        })?;
    }
    Ok(())
}

fn acknowledgements_are_not_acknowledged(t: &Trial) -> Judged {
    let a = t.controller()?;
    let sent = a.send(
        Draft::new(17000)
            .raw("Original Message Time Stamp", 1)
            .raw("Original Message Type", 4000)
            .raw("Acknowledgement Type", 1)
            .acked(),
    );
    let found = a.wait(sent.mark, t.timers().quiet, |seen| {
        seen.kind() == 17000 && seen.raw("Original Message Type") == Some(17000)
    });
    if let Some(found) = found {
        t.expect_of(&found, false, || {
            "expected no 17000 about a 17000, though it asked for one; one came".into()
        })?;
    }
    Ok(())
}

fn a_report_is_its_own_acknowledgement(t: &Trial) -> Judged {
    let a = t.monitor()?;
    let mark = t.bench.net.mark();
    a.query(3)?;
    let found = a.wait(mark, t.timers().quiet, |seen| seen.kind() == 17000);
    if let Some(found) = found {
        t.expect_of(&found, false, || {
            "expected #3 and nothing else to 17002 without the acknowledgement bit; a 17000 came"
                .into()
        })?;
    }
    let reports = a.received(mark, |seen| seen.kind() == 3).len();
    if reports > 1 {
        t.note(format!("{reports} messages #3 came to one request"));
    }
    let mark = t.bench.net.mark();
    a.send(information_request(3004));
    a.send(Draft::new(15000).raw("Subsystem ID", 1 << 9));
    a.send(schedule(3, 0));
    let found = a.wait(mark, t.timers().quiet, |seen| seen.kind() == 17000);
    if let Some(found) = found {
        t.expect_of(&found, false, || {
            format!(
                "expected no 17000 to requests without the acknowledgement bit; one about {:?} came",
                found.raw("Original Message Type")
            )
        })?;
    }
    Ok(())
}

fn commanded_altitude(a: &Station, home_altitude: f64, up: f64, kind: i64) -> Draft {
    let _ = a;
    Draft::new(2016)
        .raw("Select Flight Path Control Mode", mode::LOITER)
        .raw("Altitude Command Type", 1)
        .set("Commanded Altitude", home_altitude + up)
        .raw("Altitude Type", kind)
}

fn shows_altitude(t: &Trial, a: &Station, raw: i64) -> Judged<bool> {
    let deadline = t.bench.net.now() + t.timers().answer;
    loop {
        if a.query(3002)?.raw("Commanded Altitude") == Some(raw) {
            return Ok(true);
        }
        if t.bench.net.now() > deadline {
            return Ok(false);
        }
        t.pause(Duration::from_millis(50))?;
    }
}

fn a_repetition_is_not_carried_out_again(t: &Trial) -> Judged {
    // First with a setting: it shows whether an old command acts again, and needs no flight.
    let a = t.controller()?;
    let (r1, r2, r3) = (
        t.bench.fresh_radius(),
        t.bench.fresh_radius(),
        t.bench.fresh_radius(),
    );
    let first = a.send(Draft::new(2017).set("Loiter Radius", r1).acked());
    if !a.radius_becomes(r1)? {
        return Err(Stop::inconclusive("2017 does not change 3004"));
    }
    // The same stamp with other content is a new message. It is sent before anything with a later stamp: behind that
    // it would be an overtaken message, and whether those act is judged below.
    a.send(
        Draft::new(2017)
            .raw("Time Stamp", first.stamp)
            .set("Loiter Radius", r3)
            .acked(),
    );
    if !a.radius_becomes(r3)? {
        t.warn(format!(
            "a 2017 with the stamp of the one before and another radius ({r3} m) is not carried out"
        ));
    }
    a.set_radius(r2);
    if !a.radius_becomes(r2)? {
        return Err(Stop::inconclusive("2017 does not change 3004"));
    }
    let mark = a.send_bytes(&first.bytes);
    let again = a.wait(mark, t.timers().ack * 2, |seen| {
        about(seen, first.kind, first.stamp)
    });
    t.expect(again.is_some(), || {
        "expected 17000 again for the same bytes".into()
    })?;
    t.pause(Duration::from_millis(200))?;
    let shown = a.radius()?;
    t.expect(shown.is_some_and(|shown| (shown - r2).abs() < 0.8), || {
        format!("expected the radius to stay {r2} m after the bytes of an older 2017 came again; 3004 shows {shown:?}")
    })?;
    a.release()?;
    let Ok(a) = airborne(t) else {
        t.note("not judged in flight: the vehicle could not be launched");
        return Ok(());
    };
    let home = home(t, &a)?;
    let low = commanded_altitude(&a, home.altitude, 60.0, home.altitude_type);
    let high = commanded_altitude(&a, home.altitude, 75.0, home.altitude_type);
    let high_raw = crate::bench::flight::field(&high, "Commanded Altitude").unwrap_or_default();
    let first = a.send(low.acked());
    t.pause(Duration::from_millis(300))?;
    a.send(high.acked());
    if !shows_altitude(t, &a, high_raw)? {
        t.note("3002 does not show the altitude of the latest 2016");
        return Ok(());
    }
    a.send_bytes(&first.bytes);
    t.pause(t.timers().quiet)?;
    let shown = a.query(3002)?;
    t.expect_of(&shown, shown.raw("Commanded Altitude") == Some(high_raw), || {
        format!("expected the commanded altitude of the latest 2016 to stay when the bytes of an older one came again; 3002 shows {:?}", shown.value("Commanded Altitude"))
    })
}

/// Settings and waypoints are carried out, or refused, at once: only storing them is commanded.
fn settings_are_answered_at_once(t: &Trial) -> Judged {
    let a = t.controller()?;
    let home = home(t, &a)?;
    let cases = [
        (
            "a good 2017",
            Draft::new(2017).set("Loiter Radius", t.bench.fresh_radius()),
            2,
        ),
        (
            "a good 13002",
            waypoint(&home, 5, 0, home.latitude, home.longitude, 40.0),
            2,
        ),
        (
            "a 2017 with loiter type 200",
            Draft::new(2017).raw("Loiter Type", 200),
            3,
        ),
    ];
    for (what, draft, expected) in cases {
        let kind = draft.message_type;
        let sent = a.send(draft.acked());
        let answered = |seen: &Seen| {
            about(seen, kind, sent.stamp)
                && seen
                    .raw("Acknowledgement Type")
                    .is_some_and(|kind| kind != 1)
        };
        let mut last = a.wait(sent.mark, t.timers().ack * 2, answered);
        if last.is_none() {
            a.send_bytes(&sent.bytes);
            last = a.wait(sent.mark, t.timers().ack * 2, answered);
        }
        let Some(last) = last else {
            return Err(Stop::fail(format!(
                "expected 17000 type {expected} to {what} at once; neither 2 nor 3 came"
            )));
        };
        let found = last.raw("Acknowledgement Type");
        t.expect_of(&last, found == Some(expected), || {
            format!("expected 17000 type {expected} to {what}, got {found:?}")
        })?;
    }
    a.send(transfer(5, "ACK"));
    a.release()?;
    Ok(())
}

fn received_then_done_or_refused(t: &Trial) -> Judged {
    settings_are_answered_at_once(t)?;
    let a = airborne(t)?;
    // First into another mode, so that mode 12 has to be entered.
    let other = a.send(
        mode_command(mode::AUTOPILOT)
            .raw("Altitude Command Type", 0)
            .acked(),
    );
    let left = mode_becomes(&a, mode::AUTOPILOT, t.timers().begin)?;
    let _ = other;
    if left {
        let sent = a.send(mode_command(mode::LOITER).acked());
        let done = a.wait(sent.mark, t.timers().begin, |seen| {
            about(seen, 2016, sent.stamp) && seen.raw("Acknowledgement Type") == Some(2)
        });
        let entered = a.wait(sent.mark, t.timers().begin, |seen| {
            seen.kind() == 3001 && seen.raw("Select Flight Path Control Mode") == Some(mode::LOITER)
        });
        if let (Some(done), Some(entered)) = (&done, &entered) {
            t.cite(entered);
            t.expect_of(done, done.at + Duration::from_millis(600) >= entered.at, || {
                format!("expected 'carried out' only after 3001 shows mode 12; it came {:.2} s earlier", (entered.at - done.at).as_secs_f64())
            })?;
        }
        let first = a.wait(sent.mark, t.timers().ack, |seen| {
            about(seen, 2016, sent.stamp)
        });
        t.expect(first.is_some(), || {
            "expected 17000 within the acknowledgement time of 2016 mode 12".into()
        })?;
    }
    // Modes that no vehicle has.
    for wanted in [mode::WAYPOINT + 6, 22] {
        let sent = a.send(mode_command(wanted).acked());
        let done = a.wait(
            sent.mark,
            t.timers().begin.min(t.timers().answer * 3),
            |seen| {
                about(seen, 2016, sent.stamp)
                    && seen
                        .raw("Acknowledgement Type")
                        .is_some_and(|kind| kind != 1)
            },
        );
        let shown = reported_mode(&a)?;
        if let Some(done) = done {
            let kind = done.raw("Acknowledgement Type");
            t.expect_of(&done, kind != Some(2) || shown == Some(wanted), || format!("expected no 'carried out' for mode {wanted}, while 3001 shows {shown:?}; 17000 type 2 came"))?;
        } else if shown != Some(wanted) {
            return Err(Stop::fail(format!(
                "expected 17000 type 3 to 2016 mode {wanted}, which was not entered; none came"
            )));
        }
    }
    Ok(())
}
