//! Rules of Edition 2.5 alone: acknowledgements configured by #1401, the mode preference (#48, #109), and remote
//! displays after the resource report (#1202).

use std::time::Duration;

use super::scene::Scene;
use crate::bench::flight::{airborne, fix, fly_until, home, mode};
use crate::bench::trial::{Player, Trial};
use crate::verdict::{Judged, Precondition, Stop};
use crate::wire::dialect::{PREFERENCE_REPORT, REQUEST, RESOURCES, STEERING};
use crate::wire::{Direction, Draft};

pub(super) const SCENES: &[Scene] = &[
    Scene {
        rule: "ACK-004",
        play: acknowledged_by_configuration,
    },
    Scene {
        rule: "MODE-012",
        play: preference_decides_what_rules,
    },
    Scene {
        rule: "CONF-009",
        play: no_remote_display_unasked,
    },
];

/// #1304.
const SERVICES: u16 = 1304;

/// #41 that changes nothing in flight: a loiter for later.
fn loiter(t: &Trial) -> Draft {
    Draft::new(2017)
        .raw("Loiter Type", 1)
        .set("Loiter Radius", t.bench.fresh_radius())
        .raw("Loiter Direction", 1)
}

fn acknowledged_by_configuration(t: &Trial) -> Judged {
    let a = t.controller()?;
    // #41 always has an altitude, and it must be one that can be flown.
    home(t, &a)?;
    let sent = a.send(loiter(t).acked());
    let instance = sent.bytes.get(10..14).unwrap_or_default().to_vec();
    let mut found = None;
    for _ in 0..3 {
        found = a.wait(sent.mark, t.timers().ack, |seen| {
            seen.kind() == 17_000 && seen.raw("Original Message Type") == Some(2017)
        });
        if found.is_some() {
            break;
        }
        a.send_bytes(&sent.bytes);
    }
    let Some(found) = found else {
        return Err(Stop::fail(format!(
            "expected #1400 about #41, for which #1401 was sent, within {:.1} s; none came",
            t.timers().ack.as_secs_f64()
        )));
    };
    let stamp = found.raw("Original Message Time Stamp");
    t.expect_of(&found, stamp == Some(sent.stamp), || {
        format!(
            "expected the time stamp of the original in #1400, {} ms after 2000; got {stamp:?}",
            sent.stamp
        )
    })?;
    let original = found.original.as_ref();
    let named = original.and_then(|seen| seen.fields.as_ref().ok()?.get(INSTANCE).cloned());
    t.expect_of(&found, named.as_deref() == Some(&instance[..]), || {
        format!(
            "expected the instance id of the original in #1400, {instance:02x?}; got {named:02x?}"
        )
    })?;
    // Relinquishing control ends the preference.
    a.release()?;
    t.grant(
        &a,
        crate::bench::station::loi::LOI2 | crate::bench::station::loi::LOI4,
    )?;
    let again = a.send(loiter(t));
    let unasked = a.wait(again.mark, t.timers().quiet, |seen| {
        seen.kind() == 17_000 && seen.raw("Original Message Type") == Some(2017)
    });
    match unasked {
        Some(unasked) => t.expect_of(&unasked, false, || {
            "expected no #1400 after control was released and granted again without another #1401; one came".into()
        }),
        None => Ok(()),
    }
}

const INSTANCE: &str = "Original Message Instance ID";

/// #48, and #109 that shows it.
fn prefer(t: &Trial, a: &Player, altitude: i64) -> Judged {
    for _ in 0..3 {
        let mark = a.prefer([altitude, 0, 0]);
        let shown = a.wait_original(mark, t.timers().answer, |seen| {
            seen.kind() == PREFERENCE_REPORT && seen.raw("Altitude Mode State") == Some(altitude)
        });
        if shown {
            return Ok(());
        }
        a.send(crate::bench::station::information_request(3004));
    }
    Err(Stop::fail(format!(
        "expected #109 with altitude mode {altitude} after #48; it did not come"
    )))
}

fn preference_decides_what_rules(t: &Trial) -> Judged {
    let a = airborne(t)?;
    let start = fix(t, &a)?;
    let wanted = start.altitude + 30.0;
    let steer = || {
        Draft::new(2016)
            .raw("Altitude Command Type", 1)
            .set("Commanded Altitude", wanted)
            .raw("Altitude Type", start.altitude_type)
    };
    prefer(t, &a, 0)?;
    a.send_only(steer(), STEERING);
    let speed = t.bench.profile.figures.speed_factor.max(1.0);
    let time = Duration::from_secs_f64(15.0 / speed).max(t.timers().answer);
    let climbed = fly_until(t, &a, time, |fix| fix.altitude > start.altitude + 10.0)?;
    t.expect(climbed.is_none(), || {
        "expected #43 to command no altitude in mode 12 while #48 says configuration; the vehicle climbs".into()
    })?;
    prefer(t, &a, 2)?;
    a.send_only(steer(), STEERING);
    let climbed = fly_until(t, &a, t.timers().flight.min(t.timers().begin * 3), |fix| {
        fix.altitude > start.altitude + 10.0
    })?;
    let shown = crate::bench::flight::reported_mode(&a).precondition("the mode is reported")?;
    t.expect(climbed.is_some(), || {
        format!("expected #43 to command the altitude in mode {} while #48 says manual; the vehicle does not climb (mode {shown:?})", mode::LOITER)
    })?;
    t.note("\"until the waypoint\" (#48 with 1) is not judged: the rule is played in mode 12");
    prefer(t, &a, 0)
}

fn no_remote_display_unasked(t: &Trial) -> Judged {
    let a = t.monitor()?;
    t.pause(t.timers().quiet)?;
    let mark = a.send_resources();
    let offered = a.wait_original(mark, t.timers().answer, |seen| seen.kind() == SERVICES);
    t.note(if offered {
        "#1304 came after #1202"
    } else {
        "no #1304 came after #1202: no service is offered"
    });
    let recording = t.bench.net.recording();
    let mut reported = false;
    for datagram in &recording.datagrams[t.mark..] {
        for seen in &datagram.originals {
            if seen.socket != a.socket() {
                continue;
            }
            let names = |kind: u16| seen.raw("Message Type") == Some(kind.into());
            reported |= seen.direction == Direction::Sent
                && (seen.kind() == RESOURCES || seen.kind() == REQUEST && names(SERVICES));
            if seen.direction == Direction::Received && seen.kind() == SERVICES && !reported {
                t.cite(seen);
                return Err(Stop::fail(
                    "expected no #1304 before the resource report #1202; one came",
                ));
            }
        }
    }
    Ok(())
}
