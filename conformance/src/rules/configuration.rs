//! Configuration phase: CONF.

use std::collections::BTreeSet;
use std::sync::Arc;
use std::time::Duration;

use stanag_msgs::Id;

use super::scene::Scene;
use crate::bench::station::Station;
use crate::bench::trial::Trial;
use crate::verdict::{Judged, Precondition, Stop};
use crate::wire::{Draft, Seen};

pub(super) const SCENES: &[Scene] = &[
    Scene {
        rule: "CONF-001",
        play: configuration_ends_with_complete,
    },
    Scene {
        rule: "CONF-002",
        play: single_parameter,
    },
    Scene {
        rule: "CONF-003",
        play: generic_lists_are_not_altered,
    },
    Scene {
        rule: "CONF-004",
        play: missing_values_are_listed,
    },
    Scene {
        rule: "CONF-006",
        play: abort_stops_the_answers,
    },
    Scene {
        rule: "CONF-007",
        play: limits_make_sense,
    },
    Scene {
        rule: "CONF-008",
        play: what_is_declared_is_accepted,
    },
];

/// 40000 of this request type.
pub(super) fn request(kind: i64) -> Draft {
    Draft::new(40000)
        .id("VSM ID", Id::BROADCAST)
        .raw("Data Link ID", 0)
        .raw("Request Type", kind)
}

fn is_answer(seen: &Seen) -> bool {
    matches!(seen.kind(), 41000..=41004 | 44003)
}

/// The answers to 40000 of this type up to 41005.
pub(super) fn full(t: &Trial, station: &Station, kind: i64) -> Judged<Vec<Arc<Seen>>> {
    let complete = station.ask(
        request(kind),
        t.timers().config / 3,
        "configuration complete (41005)",
        |seen| seen.kind() == 41005,
    );
    let sent = t.mark;
    let complete = complete?;
    t.cite(&complete);
    Ok(station.received(sent, is_answer))
}

/// Indices of an enumerated field that 44003 or 41002 say the vehicle lacks.
pub(super) fn availability(configuration: &[Arc<Seen>], message: i64, field: i64) -> BTreeSet<i64> {
    configuration
        .iter()
        .filter(|seen| {
            seen.kind() == 44003
                && seen.raw("Reported Message") == Some(message)
                && seen.raw("Reported Field") == Some(field)
        })
        .filter(|seen| {
            seen.raw("Enumerated Index Enable")
                .is_some_and(|enable| enable < 0)
        })
        .filter_map(|seen| seen.raw("Reported Enumerated Index"))
        .collect()
}

fn configuration_ends_with_complete(t: &Trial) -> Judged {
    let station = t.any()?;
    let authorised = t.bench.surveyed()?.with(crate::bench::station::loi::LOI4);
    let kind = if authorised.is_empty() { 1 } else { 3 };
    let mark = t.bench.net.mark();
    let complete = station.ask(
        request(kind),
        t.timers().config / 3,
        "configuration complete (41005)",
        |seen| seen.kind() == 41005,
    )?;
    let answers = station.received(mark, is_answer);
    t.expect_of(
        &complete,
        answers.iter().any(|seen| seen.at <= complete.at),
        || "expected configuration messages before 41005; it came first".into(),
    )?;
    let after = t.bench.net.mark();
    t.pause(t.timers().quiet)?;
    let late = station.received(after, |seen| matches!(seen.kind(), 41000..=41004));
    if let Some(late) = late.first() {
        t.expect_of(late, false, || {
            format!(
                "expected no configuration message after 41005; {} came {:.1} s later",
                late.kind(),
                (late.at - complete.at).as_secs_f64()
            )
        })?;
    }
    let count = station.received(mark, |seen| seen.kind() == 41005).len();
    let requests = t.bench.net.recording().datagrams[mark..]
        .iter()
        .flat_map(|datagram| &datagram.messages)
        .filter(|seen| seen.kind() == 40000)
        .count();
    let stations = t.bench.surveyed()?.stations().len();
    t.expect(count <= requests * (1 + stations), || {
        format!("expected one 41005 to a request, got {count} to {requests}")
    })
}

fn single_parameter(t: &Trial) -> Judged {
    let station = t.any()?;
    // The loiter radius, field 3 of 2017.
    let draft = request(0)
        .raw("Requested Message", 2017)
        .raw("Requested Field", 3);
    let mark = t.bench.net.mark();
    let answer = station.ask(
        draft,
        t.timers().answer,
        "a configuration message for field 3 of 2017",
        is_answer,
    )?;
    t.cite(&answer);
    t.pause(t.timers().answer / 2)?;
    for seen in station.received(mark, |seen| matches!(seen.kind(), 41000..=41004)) {
        let named = (seen.raw("Requested Message"), seen.raw("Requested Field"));
        t.expect_of(&seen, named == (Some(2017), Some(3)), || {
            format!("expected an answer for field 3 of 2017 only, got one for {named:?}")
        })?;
    }
    // A field that no message has: nothing can say that it is supported.
    let mark = t.bench.net.mark();
    station.send(
        request(0)
            .raw("Requested Message", 2017)
            .raw("Requested Field", 99),
    );
    let claims = station.wait(mark, t.timers().answer / 2, |seen| {
        matches!(seen.kind(), 41000..=41004)
            && seen.raw("Requested Field") == Some(99)
            && seen.raw("Field Supported") == Some(1)
    });
    if let Some(claims) = claims {
        t.expect_of(&claims, false, || {
            "expected field 99 of 2017, which does not exist, not to be called supported".into()
        })?;
    }
    Ok(())
}

fn generic_lists_are_not_altered(t: &Trial) -> Judged {
    // Judged on the messages, by the judge of this rule; here they are caused.
    let station = t.any()?;
    full(t, &station, 3).precondition("a full configuration")?;
    Ok(())
}

fn missing_values_are_listed(t: &Trial) -> Judged {
    let a = t.controller()?;
    let configuration = full(t, &a, 3).precondition("a full configuration")?;
    let listed = availability(&configuration, 2016, 2);
    // Modes of which 2016 is refused though they are not listed. On the ground none of them moves anything.
    for wanted in [16, 17, 22] {
        if listed.contains(&wanted) {
            continue;
        }
        let sent = a.send(crate::bench::flight::mode_command(wanted).acked());
        let refused = a.wait(sent.mark, t.timers().quiet, |seen| {
            super::acknowledgement::about(seen, 2016, sent.stamp)
                && seen.raw("Acknowledgement Type") == Some(3)
        });
        let shown = crate::bench::flight::reported_mode(&a)?;
        t.expect(refused.is_none() && shown == Some(wanted), || {
            format!("expected flight mode {wanted} to be listed by 44003 as unavailable, since 2016 with it is not carried out (3001 shows {shown:?})")
        })?;
    }
    Ok(())
}

fn abort_stops_the_answers(t: &Trial) -> Judged {
    let station = t.any()?;
    let sent = station.send(request(3));
    let first = station.wait(sent.mark, t.timers().answer, is_answer);
    if first.is_none() {
        return Err(Stop::inconclusive("no configuration message came"));
    }
    station.send(request(6));
    // What was on its way comes at once.
    t.pause(Duration::from_millis(500))?;
    let mark = t.bench.net.mark();
    t.pause(t.timers().quiet + Duration::from_millis(500))?;
    let late = station.received(mark, |seen| matches!(seen.kind(), 41000..=41005));
    t.expect(late.is_empty(), || {
        format!(
            "expected no configuration message later than 0.5 s after the abort; {} came",
            late.len()
        )
    })?;
    station.ask(
        request(3),
        t.timers().config / 3,
        "41005 to a new request",
        |seen| seen.kind() == 41005,
    )?;
    Ok(())
}

fn limits_make_sense(t: &Trial) -> Judged {
    let station = t.any()?;
    full(t, &station, 3).precondition("a full configuration")?;
    Ok(())
}

fn what_is_declared_is_accepted(t: &Trial) -> Judged {
    let a = t.controller()?;
    let configuration = full(t, &a, 3).precondition("a full configuration")?;
    let declared = configuration.iter().find(|seen| {
        matches!(seen.kind(), 41000 | 41001 | 41003)
            && seen.raw("Requested Message") == Some(2017)
            && seen.raw("Requested Field") == Some(3)
            && seen.raw("Field Supported") != Some(0)
    });
    let Some(declared) = declared else {
        return Err(Stop::not_applicable(
            "no range is declared for the loiter radius (field 3 of 2017)",
        ));
    };
    t.cite(declared);
    let (Some(low), Some(high)) = (declared.value("Min Value"), declared.value("Max Value")) else {
        return Err(Stop::not_applicable(
            "the declared loiter radius has no minimum and maximum",
        ));
    };
    // Declared in metres or in steps of the wire (1.5 m): judged so that either reading is lawful.
    for radius in [low * 1.5, high] {
        if radius <= 0.0 || radius > 98_000.0 || low * 1.5 > high {
            continue;
        }
        let raw = (radius / 1.5).floor() * 1.5;
        if raw < low * 1.5 {
            continue;
        }
        a.set_radius(raw);
        t.expect(a.radius_becomes(raw)?, || format!("expected a loiter radius of {raw:.1} m, within the declared {low} to {high}, to be accepted; 3004 does not show it"))?;
    }
    let beyond = (high * 1.1).ceil() * 1.5 + 3.0;
    if beyond < 98_000.0 {
        a.set_radius(beyond);
        t.pause(t.timers().answer / 2)?;
        let shown = a.radius()?;
        t.expect(shown.is_none_or(|shown| (shown - beyond).abs() > 0.8), || format!("expected a loiter radius of {beyond:.1} m, beyond the declared {high}, to be refused; 3004 shows it"))?;
    }
    Ok(())
}
