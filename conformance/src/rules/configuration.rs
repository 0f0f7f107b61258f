//! CONF, the configuration phase (40000 and its answers): that it is complete and ends, and that its ranges and lists
//! agree with what the subject accepts and refuses.

use std::collections::BTreeSet;
use std::sync::Arc;
use std::time::Duration;

use stanag_msgs::Id;

use super::alerts::cause_of;
use super::scene::Scene;
use crate::bench::flight::{Plan, home, load};
use crate::bench::station::{Access, Station, loi};
use crate::bench::trial::Trial;
use crate::verdict::{Judged, Precondition, Stop};
use crate::wire::{Direction, Draft, Seen};

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
        rule: "CONF-005",
        play: a_change_of_availability_is_sent,
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
        rule: "CONF-011",
        play: limits_are_watched_by_the_cucs,
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

/// Indices of an enumerated field that 44003 or 41002 list as unavailable.
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
    t.expect_beside(
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
    })?;
    let response = station.request(0, Access::Request)?;
    for name in ["Vehicle Type", "Vehicle Subtype", "VSM ID"] {
        let (offered, complete_has) = (response.raw(name), complete.raw(name));
        t.expect_of(&complete, complete_has.is_none() || complete_has == offered, || {
            format!("expected 41005 for the vehicle of message 2; {name} is {complete_has:?}, in message 2 {offered:?}")
        })?;
    }
    t.expect_of(&complete, complete.piece.source == station.vehicle, || {
        format!(
            "expected 41005 from {}, got one from {}",
            station.vehicle, complete.piece.source
        )
    })?;
    // Every level that this CUCS may have, and each of them twice.
    let authorised = response.raw("LOI Authorized").unwrap_or_default();
    let payload = if stations > 0 { loi::LOI3 } else { 0x100 };
    for (kind, level, commands) in [
        (1, loi::LOI2, true),
        (2, payload, false),
        (3, loi::LOI4, false),
        (4, loi::LOI5, false),
        (kind, 0, false),
    ] {
        if level != 0 && authorised & level == 0 {
            continue;
        }
        let mark = t.bench.net.mark();
        station.ask(
            request(kind),
            t.timers().config / 3,
            &format!("configuration complete (41005) to request type {kind}"),
            |seen| seen.kind() == 41005,
        )?;
        let flight = station.received(mark, |seen| {
            matches!(seen.kind(), 41000..=41004)
                && seen
                    .raw("Requested Message")
                    .is_some_and(|message| matches!(message, 2016 | 2017 | 13002 | 13003))
        });
        if let Some(flight) = flight.first().filter(|_| commands) {
            t.expect_of(flight, false, || {
                format!("expected the configuration of LOI 2 to request type 1, got that of message {:?}, which needs LOI 4", flight.raw("Requested Message"))
            })?;
        }
    }
    Ok(())
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
    let sends = |mark: usize| {
        t.bench.net.recording().datagrams[mark..]
            .iter()
            .filter(|datagram| datagram.direction == Direction::Sent)
            .flat_map(|datagram| &datagram.messages)
            .filter(|seen| seen.kind() == 40000)
            .count()
    };
    let answers = station
        .received(mark, |seen| matches!(seen.kind(), 41000 | 41001 | 41003))
        .len();
    t.expect(answers <= sends(mark), || {
        format!("expected one answer about field 3 of 2017, got {answers}")
    })?;
    for seen in station.received(mark, |seen| matches!(seen.kind(), 41000..=41004)) {
        let named = (seen.raw("Requested Message"), seen.raw("Requested Field"));
        t.expect_of(&seen, named == (Some(2017), Some(3)), || {
            format!("expected an answer for field 3 of 2017 only, got one for {named:?}")
        })?;
    }
    // A field number that no message has: nothing may report it as supported.
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
            || seen.kind() == 44003
                && seen.raw("Reported Message") == Some(2017)
                && seen.raw("Reported Field") == Some(99)
                && seen.raw("Field Available") == Some(1)
    });
    if let Some(claims) = claims {
        t.expect_of(&claims, false, || {
            "expected field 99 of 2017, which does not exist, not to be called supported".into()
        })?;
    }
    one_field_as_all_of_them(t, &station)
}

/// The answer about one field is the same as in the whole configuration, support included.
fn one_field_as_all_of_them(t: &Trial, station: &Station) -> Judged {
    let whole = full(t, station, 3).precondition("a full configuration")?;
    let mut judged = 0;
    for supported in [1, 0] {
        let mut named: Vec<_> = whole
            .iter()
            .filter(|seen| {
                matches!(seen.kind(), 41000 | 41001 | 41003)
                    && seen.raw("Field Supported") == Some(supported)
            })
            .collect();
        named.dedup_by_key(|seen| (seen.raw("Requested Message"), seen.raw("Requested Field")));
        for known in named.into_iter().take(3) {
            let place = (known.raw("Requested Message"), known.raw("Requested Field"));
            let (Some(message), Some(field)) = place else {
                continue;
            };
            let mark = t.bench.net.mark();
            station.send(
                request(0)
                    .raw("Requested Message", message)
                    .raw("Requested Field", field),
            );
            let about = |seen: &Seen| {
                matches!(seen.kind(), 41000..=41004)
                    && (seen.raw("Requested Message"), seen.raw("Requested Field")) == place
            };
            let Some(single) = station.wait(mark, t.timers().answer, about) else {
                continue;
            };
            judged += 1;
            let shown = single.raw("Field Supported");
            t.expect_of(&single, shown.unwrap_or(1) == supported, || {
                format!("expected Field Supported {supported} for field {field} of message {message}, as in the whole configuration; got {shown:?}")
            })?;
            for name in ["Min Value", "Max Value", "Default Value"] {
                if single.kind() != known.kind() || supported == 0 {
                    continue;
                }
                let (alone, among) = (single.value(name), known.value(name));
                t.expect_of(&single, alone == among, || {
                    format!("expected {name} {among:?} for field {field} of message {message}, as in the whole configuration; got {alone:?}")
                })?;
            }
        }
    }
    if judged == 0 {
        t.note("no field of the whole configuration is answered singly");
    }
    Ok(())
}

fn generic_lists_are_not_altered(t: &Trial) -> Judged {
    // The messages are judged by the passive judge of this rule; here they are caused.
    let station = t.any()?;
    full(t, &station, 3).precondition("a full configuration")?;
    Ok(())
}

fn missing_values_are_listed(t: &Trial) -> Judged {
    let a = t.controller()?;
    let configuration = full(t, &a, 3).precondition("a full configuration")?;
    let listed = availability(&configuration, 2016, 2);
    // A mode that is refused must be listed as unavailable. On the ground none of these moves anything.
    for wanted in [16, 17, 22] {
        if listed.contains(&wanted) {
            continue;
        }
        let sent = a.send(crate::bench::flight::mode_command(wanted).acked());
        let refused = a.wait(sent.mark, t.timers().quiet, |seen| {
            crate::bench::station::about(seen, 2016, sent.stamp)
                && seen.raw("Acknowledgement Type") == Some(3)
        });
        let shown = crate::bench::flight::reported_mode(&a)?;
        t.expect(refused.is_none() && shown == Some(wanted), || {
            format!("expected flight mode {wanted} to be listed by 44003 as unavailable, since 2016 with it is not carried out (3001 shows {shown:?})")
        })?;
    }
    values_work_or_are_listed(t, &a, &configuration)
}

/// Each generic value of these fields works, or is listed as unavailable; what is listed is refused.
fn values_work_or_are_listed(t: &Trial, a: &Station, configuration: &[Arc<Seen>]) -> Judged {
    if t.of_edition_25() {
        t.note("loiter types and directions were not tried: #1400 says that #41 came, never that it is refused");
        return Ok(());
    }
    for (field, number, values) in [("Loiter Type", 2, 1..=4), ("Loiter Direction", 7, 1..=3)] {
        let listed = availability(configuration, 2017, number);
        let before = a.query(3004)?.raw(field);
        for value in values {
            let sent = a.send(Draft::new(2017).raw(field, value).acked());
            let end = a.wait(sent.mark, t.timers().ack * 2, |seen| {
                crate::bench::station::about(seen, 2017, sent.stamp)
                    && seen.raw("Acknowledgement Type") != Some(1)
            });
            let Some(end) = end else { continue };
            let refused = end.raw("Acknowledgement Type") == Some(3);
            t.expect_beside(&end, refused == listed.contains(&value), || {
                if refused {
                    format!("expected {field} {value} of 2017 to be listed by 44003, since it is refused; it is not")
                } else {
                    format!("expected {field} {value} of 2017, which 44003 lists as unavailable, to be refused; it was carried out")
                }
            })?;
        }
        if let Some(before) = before {
            a.send(Draft::new(2017).raw(field, before));
        }
    }
    Ok(())
}

/// Where a new configuration phase differs from the one before, the change has to have been sent when it happened.
fn a_change_of_availability_is_sent(t: &Trial) -> Judged {
    if !t
        .bench
        .flight_released
        .load(std::sync::atomic::Ordering::SeqCst)
    {
        return Err(Stop::not_applicable(
            "needs a vehicle in flight, where a plan makes mode 11 available",
        ));
    }
    off_the_ground(t)?;
    let a = crate::bench::flight::airborne(t)?;
    let home = home(t, &a)?;
    let phase = || phase(t, &a, 3);
    crate::bench::flight::clear(t, &a)?;
    let before = phase()?;
    let mark = t.bench.net.mark();
    if load(t, &a, &Plan::zigzag(&home, "AVAIL", &[1, 2]))?.status != Some(1) {
        return Err(Stop::inconclusive("a good route was not loaded"));
    }
    t.pause(t.timers().answer / 2)?;
    let unasked = about_modes(&a, mark);
    let reported_modes: BTreeSet<i64> = unasked
        .iter()
        .filter_map(|seen| seen.raw("Reported Enumerated Index"))
        .collect();
    let after = phase()?;
    let changed: BTreeSet<i64> = before.symmetric_difference(&after).copied().collect();
    if changed.is_empty() {
        return Err(Stop::not_applicable(
            "no mode becomes available by a plan, as the configuration says",
        ));
    }
    t.expect(changed.is_subset(&reported_modes), || {
        format!("expected 44003 at once about the modes {changed:?}, which the configuration lists otherwise since a plan is aboard; it came about {reported_modes:?}")
    })?;
    expect_change_reported(t, &unasked, &changed, &after)?;
    // And the reverse, when the plan is cleared.
    let mark = t.bench.net.mark();
    crate::bench::flight::clear(t, &a)?;
    t.pause(t.timers().answer / 2)?;
    // Read before the configuration is requested, which would report the same.
    let unasked = about_modes(&a, mark);
    let gone = phase()?;
    let changed: BTreeSet<i64> = after.symmetric_difference(&gone).copied().collect();
    expect_change_reported(t, &unasked, &changed, &gone)
}

/// The flight modes that a configuration phase of this type lists as unavailable.
fn phase(t: &Trial, a: &Station, kind: i64) -> Judged<BTreeSet<i64>> {
    let mark = t.bench.net.mark();
    a.ask(
        request(kind),
        t.timers().config / 3,
        "configuration complete (41005)",
        |seen| seen.kind() == 41005,
    )
    .precondition("a full configuration")?;
    // Some subjects send availability just behind 41005.
    t.pause(Duration::from_millis(200))?;
    Ok(availability(&a.received(mark, is_answer), 2016, 2))
}

/// A launch makes modes available and others unavailable; the CUCS in control is sent these changes. Not judged where
/// the vehicle flies already.
fn off_the_ground(t: &Trial) -> Judged {
    let a = t.launcher()?;
    let home = home(t, &a)?;
    if crate::bench::flight::fix(t, &a)?.altitude > home.altitude + 3.0 {
        return a.release().map(|_| ());
    }
    let kinds = [3, 4];
    let mut before = BTreeSet::new();
    for kind in kinds {
        before.extend(phase(t, &a, kind)?);
    }
    let mark = t.bench.net.mark();
    let flier = crate::bench::flight::airborne(t)?;
    t.pause(t.timers().answer / 2)?;
    let unasked: BTreeSet<i64> = t.bench.net.recording().datagrams[mark..]
        .iter()
        .filter(|datagram| datagram.direction == Direction::Received)
        .flat_map(|datagram| &datagram.messages)
        .filter(|seen| is_about_modes(seen))
        .filter_map(|seen| seen.raw("Reported Enumerated Index"))
        .collect();
    let mut after = BTreeSet::new();
    for kind in kinds {
        after.extend(phase(t, &flier, kind)?);
    }
    flier.release()?;
    let changed: BTreeSet<i64> = before.symmetric_difference(&after).copied().collect();
    t.expect(changed.is_subset(&unasked), || {
        format!("expected 44003 at once about the modes {changed:?}, which the configuration lists otherwise since the launch; it came about {unasked:?}")
    })
}

fn is_about_modes(seen: &Seen) -> bool {
    seen.kind() == 44003
        && seen.raw("Reported Message") == Some(2016)
        && seen.raw("Reported Field") == Some(2)
}

/// The 44003s about flight modes since `mark`.
fn about_modes(a: &Station, mark: usize) -> Vec<Arc<Seen>> {
    a.received(mark, is_about_modes)
}

/// The last 44003 about each of these modes has to report it as unavailable where the configuration lists it so,
/// otherwise as available.
fn expect_change_reported(
    t: &Trial,
    unasked: &[Arc<Seen>],
    changed: &BTreeSet<i64>,
    unavailable: &BTreeSet<i64>,
) -> Judged {
    for mode in changed {
        let of = |seen: &&Arc<Seen>| seen.raw("Reported Enumerated Index") == Some(*mode);
        let gone = unavailable.contains(mode);
        let what = if gone { "unavailable" } else { "available" };
        let Some(last) = unasked.iter().rfind(of) else {
            return Err(Stop::fail(format!(
                "expected 44003 at once about mode {mode}, which has become {what}; none came"
            )));
        };
        let enable = last.raw("Enumerated Index Enable").unwrap_or_default();
        t.expect_beside(last, (enable < 0) == gone, || {
            format!("expected 44003 to say that mode {mode} has become {what}, as the configuration lists it; Enumerated Index Enable is {enable}")
        })?;
    }
    Ok(())
}

fn abort_stops_the_answers(t: &Trial) -> Judged {
    let station = t.any()?;
    // The number of messages of a whole configuration: a subject that sends them all at once has nothing left to
    // stop.
    let mark = t.bench.net.mark();
    full(t, &station, 3).precondition("a full configuration")?;
    let whole = station
        .received(mark, |seen| matches!(seen.kind(), 41000..=41005))
        .len();
    let mark = station.send_together(vec![request(3), request(6)]);
    let aborted = t.bench.net.now();
    t.pause(t.timers().quiet)?;
    let came = station.received(mark, |seen| matches!(seen.kind(), 41000..=41005));
    let last = came.last().map_or(Duration::ZERO, |seen| seen.at);
    let late = last.saturating_sub(aborted);
    t.expect(came.len() < whole || late < Duration::from_millis(200), || {
        format!(
            "expected the abort right behind the request to end the configuration; all {whole} messages came, the last {:.1} s after it",
            late.as_secs_f64()
        )
    })?;
    let sent = station.send(request(3));
    let first = station.wait(sent.mark, t.timers().answer, is_answer);
    if first.is_none() {
        return Err(Stop::inconclusive("no configuration message came"));
    }
    station.send(request(6));
    // What was sent before the abort arrives within half a second.
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

/// The CUCS warns by the declared limits; the VSM does not raise an alert of its own for them.
fn limits_are_watched_by_the_cucs(t: &Trial) -> Judged {
    let means = &t.bench.profile.means;
    let (Some(lower), Some(restore)) = (&means.lower_energy, &means.restore_energy) else {
        return Err(Stop::not_applicable(
            "needs means.lower_energy and means.restore_energy in the profile",
        ));
    };
    let station = t.monitor()?;
    let configuration = full(t, &station, 1).precondition("a full configuration")?;
    let declared = configuration.iter().find(|seen| {
        matches!(seen.kind(), 41000 | 41001 | 41003)
            && seen.raw("Requested Message") == Some(3002)
            && seen.raw("Requested Field") == Some(ENERGY)
            && seen.raw("Low Caution Limit").is_some_and(|limit| limit > 0)
    });
    let Some(declared) = declared else {
        return Err(Stop::not_applicable(
            "no caution limit is declared for the energy level (field 12 of 3002)",
        ));
    };
    t.cite(declared);
    let limit = declared.raw("Low Caution Limit").unwrap_or_default();
    let full = energy(&*station.query(3002)?);
    if full.is_none_or(|level| level <= limit) {
        return Err(Stop::inconclusive(
            "the energy level is below its declared caution limit already, or absent",
        ));
    }
    // Alerts about the VSM itself (subsystem 9) may come meanwhile, and do not count.
    let own_alert = |seen: &Seen| {
        seen.kind() == 16000
            && seen.raw("Priority").is_some_and(|priority| priority >= 2)
            && seen.raw("Subsystem ID") != Some(9)
    };
    // What comes without the cause is not about it: as long a look as the level is low for, before and between.
    let watch = t.timers().status.max(t.timers().quiet);
    let commands = (lower.as_str(), restore.as_str());
    let normal = station.collect(watch, own_alert)?;
    let mut others: BTreeSet<_> = normal.iter().map(|seen| cause_of(seen)).collect();
    let first = lowered(t, &station, commands, limit, |seen| {
        own_alert(seen) && !others.contains(&cause_of(seen))
    })?;
    if !first.low {
        let shown = first.shown;
        t.expect(shown != full, || {
            format!("expected Current Propulsion Energy Level of 3002 to follow means.lower_energy, or no CUCS can watch it; it stays {full:?}")
        })?;
        return Err(Stop::inconclusive(
            "means.lower_energy did not bring the energy level in 3002 below its declared caution limit",
        ));
    }
    if first.alerts.is_empty() {
        return Ok(());
    }
    // An alert that comes by chance does not come a second time with the level.
    let mark = t.bench.net.mark();
    station.wait(mark, watch, |seen| {
        seen.kind() == 3002 && energy(seen).is_some_and(|level| level > limit)
    });
    let between = station.collect(watch, |seen| {
        own_alert(seen) && seen.raw("Alert (Warning) ID").is_some_and(|id| id < 0)
    })?;
    others.extend(between.iter().map(|seen| cause_of(seen)));
    let second = lowered(t, &station, commands, limit, |seen| {
        own_alert(seen) && !others.contains(&cause_of(seen))
    })?;
    let again: BTreeSet<_> = second.alerts.iter().map(|seen| cause_of(seen)).collect();
    let own = first
        .alerts
        .iter()
        .find(|seen| again.contains(&cause_of(seen)));
    if let Some(own) = own {
        t.expect_of(own, false, || {
            format!(
                "expected no 16000 for an energy level below its declared limit, which the CUCS watches; got {:?}",
                own.text("Text").unwrap_or_default()
            )
        })?;
    }
    t.note("an alert came while the energy level was low, but not each time: it is not taken for one about the level");
    Ok(())
}

/// Current Propulsion Energy Level of a 3002.
fn energy(seen: &Seen) -> Option<i64> {
    seen.raw("Current Propulsion Energy Level")
}

/// What a low energy level brought.
struct Lowered {
    /// Whether 3002 showed it below the limit.
    low: bool,
    /// What 3002 showed last.
    shown: Option<i64>,
    /// The alerts that came meanwhile.
    alerts: Vec<Arc<Seen>>,
}

/// Lowers the energy level by the first command until an alert came, or the time for one is over, and restores it by the
/// second.
fn lowered(
    t: &Trial,
    station: &Station,
    (lower, restore): (&str, &str),
    limit: i64,
    alert: impl Fn(&Seen) -> bool,
) -> Judged<Lowered> {
    let mark = t.bench.net.mark();
    crate::means::shell(lower).map_err(Stop::Inconclusive)?;
    let result = (|| -> Judged<Lowered> {
        let low = station.wait(mark, t.timers().status, |seen| {
            seen.kind() == 3002 && energy(seen).is_some_and(|level| level < limit)
        });
        // A subject that watches the level may ignore a short dip: its alert may come seconds after the first report
        // below the limit.
        let time = t.timers().status.max(t.timers().quiet);
        if station.wait(mark, time, &alert).is_some() {
            // Others may follow the first.
            t.pause(t.timers().quiet)?;
        }
        let shown = energy(&*station.query(3002)?);
        Ok(Lowered {
            low: low.is_some(),
            shown,
            alerts: station.received(mark, &alert),
        })
    })();
    crate::means::shell(restore).map_err(Stop::Inconclusive)?;
    result
}

/// Current Propulsion Energy Level of 3002.
const ENERGY: i64 = 12;

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
    // Integers are steps of the field on the wire, as this project reads it; a float is in the field's unit. Where
    // the profile does not settle that, both readings are lawful: only what is within, or beyond, both is judged.
    let reported = !t.of_edition_25();
    if !reported {
        t.note("the declared loiter radius was not tried: Edition 2.5 reports none");
    }
    for radius in [low * 1.5, high].into_iter().filter(|_| reported) {
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
    altitudes_within_what_is_declared(t, &a, &configuration)?;
    speeds_within_what_is_declared(t, &a, &configuration)?;
    // Below the minimum in both readings.
    let below = (low * 0.5 / 1.5).floor() * 1.5;
    if reported && below >= 1.5 {
        a.set_radius(below);
        t.pause(t.timers().answer / 2)?;
        let shown = a.radius()?;
        t.expect(shown.is_none_or(|shown| (shown - below).abs() > 0.8), || format!("expected a loiter radius of {below:.1} m, below the declared {low}, to be refused; 3004 shows it"))?;
    }
    let beyond = (high * 1.1).ceil() * 1.5 + 3.0;
    if reported && beyond < 98_000.0 {
        a.set_radius(beyond);
        t.pause(t.timers().answer / 2)?;
        let shown = a.radius()?;
        t.expect(shown.is_none_or(|shown| (shown - beyond).abs() > 0.8), || format!("expected a loiter radius of {beyond:.1} m, beyond the declared {high}, to be refused; 3004 shows it"))?;
    }
    Ok(())
}

/// A waypoint's speed beyond the declared range is refused, be the range in steps of 0.5 m/s or in m/s: it is beyond
/// both.
fn speeds_within_what_is_declared(t: &Trial, a: &Station, configuration: &[Arc<Seen>]) -> Judged {
    let declared = configuration.iter().find(|seen| {
        matches!(seen.kind(), 41000 | 41001 | 41003)
            && seen.raw("Requested Message") == Some(13002)
            && seen.raw("Requested Field") == Some(9)
            && seen.raw("Field Supported") != Some(0)
    });
    let Some(high) = declared.and_then(|seen| seen.value("Max Value")) else {
        return Ok(());
    };
    // The integers of 41000 and 41003 are taken as steps; a float of 41001 is in the unit.
    let integers = declared.is_some_and(|seen| seen.kind() != 41001);
    let beyond = if integers { high * 0.5 } else { high } * 1.3 + 3.0;
    if high <= 0.0 || beyond > 32_000.0 {
        return Ok(());
    }
    let home = home(t, a)?;
    // The declared maximum must be accepted: a subject that declares more than it accepts misleads its CUCS.
    let fastest = if integers { high * 0.5 } else { high };
    let mut plan = Plan::zigzag(&home, "FASTEST", &[95, 96]);
    plan.points[1] = plan.points[1].clone().set("Waypoint to Speed", fastest);
    let found = load(t, a, &plan)?;
    t.expect(found.status != Some(2), || {
        format!("expected a waypoint at {fastest:.1} m/s, the declared maximum, to be accepted; 14000 status 2 came")
    })?;
    let mut plan = Plan::zigzag(&home, "TOOFAST", &[93, 94]);
    plan.points[1] = plan.points[1].clone().set("Waypoint to Speed", beyond);
    let found = load(t, a, &plan)?;
    t.expect(found.status != Some(1), || {
        format!("expected a waypoint at {beyond:.1} m/s, beyond the declared {high}, to be refused; 14000 status 1 came")
    })
}

/// The same for the altitude of a waypoint: one beyond the declared range is refused with its route. The range is in
/// the altitude type that the configuration names as the initial one, otherwise in that of 4000.
fn altitudes_within_what_is_declared(
    t: &Trial,
    a: &Station,
    configuration: &[Arc<Seen>],
) -> Judged {
    let declared = configuration.iter().find(|seen| {
        matches!(seen.kind(), 41000 | 41001)
            && seen.raw("Requested Message") == Some(13002)
            && seen.raw("Requested Field") == Some(6)
            && seen.raw("Field Supported") != Some(0)
    });
    let Some(high) = declared.and_then(|seen| seen.value("Max Value")) else {
        return Ok(());
    };
    let home = home(t, a)?;
    // Edition 2.5 does not name the altitude type of the range: the ground's altitude is added, so that the value is
    // beyond it in each type.
    let ground = if t.of_edition_25() {
        home.altitude.abs()
    } else {
        0.0
    };
    // In steps of 0.02 m, or in metres: beyond both.
    let beyond = high.max(high * 0.02) * 1.1 + 10.0 + ground;
    let step = high * 0.02 * 1.1 + 10.0 + ground;
    let kind = configuration.iter().find(|seen| {
        seen.kind() == 41002
            && seen.raw("Requested Message") == Some(13002)
            && seen.raw("Requested Field") == Some(7)
            && seen.raw("Field Supported") != Some(0)
    });
    let kind = kind.and_then(|seen| seen.raw("Default Value"));
    for (altitude, sure) in [
        (beyond, true),
        (step, declared.is_some_and(|seen| seen.kind() == 41000)),
    ] {
        if altitude > 167_000.0 || !sure {
            continue;
        }
        let mut plan = Plan::zigzag(&home, "BEYOND", &[91, 92]);
        plan.points[1] = plan.points[1].clone().set("Waypoint to Altitude", altitude);
        if let Some(kind) = kind {
            plan.points[1] = plan.points[1].clone().raw("Waypoint Altitude Type", kind);
        }
        let found = load(t, a, &plan)?;
        t.expect(found.status != Some(1), || {
            let kind = kind.unwrap_or(home.altitude_type);
            format!("expected a waypoint at {altitude:.0} m of altitude type {kind}, beyond the declared {high}, to be refused; 14000 status 1 came")
        })?;
    }
    Ok(())
}
