//! STAT, status reports: that they come by themselves after a grant, at the scheduled rate, to each CUCS by its own
//! schedule, with current data, and without invented values where data are missing.

use std::collections::BTreeSet;
use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::time::Duration;

use super::acknowledgement::carried_out;
use super::alerts::{COMMS, about_links, before_the_cause, cautions, loss_alert};
use super::scene::Scene;
use crate::bench::flight::{
    Plan, airborne, clear, download, field, fix, hold, home, loaded, mode, mode_becomes,
    mode_command, stretch,
};
use crate::bench::station::{Access, Station, information_request, loi, schedule};
use crate::bench::trial::Trial;
use crate::verdict::{Judged, Precondition, Stop};
use crate::wire::{Direction, Draft, Seen};

pub(super) const SCENES: &[Scene] = &[
    Scene {
        rule: "STAT-001",
        play: position_comes_by_itself,
    },
    Scene {
        rule: "STAT-002",
        play: default_rate_2_hz,
    },
    Scene {
        rule: "STAT-003",
        play: scheduled_rate_is_kept,
    },
    Scene {
        rule: "STAT-004",
        play: frequency_0_cancels,
    },
    Scene {
        rule: "STAT-005",
        play: asked_once_answered_once,
    },
    Scene {
        rule: "STAT-006",
        play: higher_status_for_a_lower_loi,
    },
    Scene {
        rule: "STAT-008",
        play: altitude_has_its_datum,
    },
    Scene {
        rule: "STAT-009",
        play: waypoint_number_0_means_no_data,
    },
    Scene {
        rule: "STAT-012",
        play: commanded_values_are_the_accepted_ones,
    },
    Scene {
        rule: "STAT-013",
        play: each_engine_by_itself,
    },
    Scene {
        rule: "STAT-015",
        play: stale_data_are_not_sent_as_fresh,
    },
    Scene {
        rule: "STAT-016",
        play: subsystems_answer_for_themselves,
    },
    Scene {
        rule: "MULTI-003",
        play: each_cucs_has_its_own_subscriptions,
    },
];

/// Rate in Hz of a message at a station, over this time that began with `mark`.
pub(super) fn rate_since(station: &Station, mark: usize, kind: u16, time: Duration) -> f64 {
    let vehicle = station.vehicle;
    // The same message by multicast and unicast counts once.
    let stamps: BTreeSet<_> = station
        .received(mark, |seen| {
            seen.kind() == kind && seen.piece.source == vehicle
        })
        .iter()
        .map(|seen| seen.stamp())
        .collect();
    stamps.len() as f64 / time.as_secs_f64()
}

/// The rate in Hz of a message at a station, measured for this time from now.
pub(super) fn rate(t: &Trial, station: &Station, kind: u16, time: Duration) -> Judged<f64> {
    let mark = t.bench.net.mark();
    t.pause(time)?;
    Ok(rate_since(station, mark, kind, time))
}

fn position_comes_by_itself(t: &Trial) -> Judged {
    let station = t.monitor()?;
    let mark = t.bench.net.mark();
    t.pause(t.timers().status / 2)?;
    let count = station.received(mark, |seen| seen.kind() == 4000).len();
    t.expect(count >= 2, || format!("expected at least two 4000 in {:.0} s after LOI 2 was granted, without asking; got {count}", t.timers().status.as_secs_f64() / 2.0))?;
    // After a release and a second grant it starts again.
    station.release()?;
    t.pause(Duration::from_millis(1_600))?;
    station.take(loi::LOI2)?;
    let mark = t.bench.net.mark();
    t.pause(t.timers().status / 4)?;
    let came = station.received(mark, |seen| seen.kind() == 4000);
    let count = came.len();
    t.expect(count >= 2, || {
        format!("expected 4000 by itself after LOI 2 was granted a second time; got {count}")
    })?;
    // None from before the release: a stored state would be shown as if it were current.
    let stamps: Vec<i64> = came.iter().filter_map(|seen| seen.stamp()).collect();
    let oldest = stamps.iter().min().zip(stamps.iter().max());
    let back = oldest.map_or(0, |(oldest, newest)| newest - oldest);
    let took = (t.timers().status / 4).as_millis() as i64;
    t.expect(back < took + 900, || {
        format!("expected 4000 with the state of now after LOI 2 was granted a second time; one is {:.1} s older than the newest", back as f64 / 1000.0)
    })
}

/// The same message by multicast and unicast comes within this time.
const COPIED_WITHIN: Duration = Duration::from_millis(200);

/// When each of these messages of one kind came: those of one stamp that come together count once, while a state that is
/// sent again and again keeps the stamp of when it was captured.
fn times_of(messages: &[Arc<Seen>]) -> Vec<Duration> {
    let mut times: Vec<Duration> = Vec::new();
    let mut last: Option<&Arc<Seen>> = None;
    for seen in messages {
        let copy = last.is_some_and(|last| {
            last.stamp() == seen.stamp() && seen.at.saturating_sub(last.at) < COPIED_WITHIN
        });
        if !copy {
            times.push(seen.at);
            last = Some(seen);
        }
    }
    times
}

fn default_rate_2_hz(t: &Trial) -> Judged {
    let station = t.monitor()?;
    let other = t.b();
    if let Ok(other) = &other {
        t.grant(other, loi::LOI2)?;
    }
    t.pause(Duration::from_millis(700))?;
    let time = t.timers().status / 2;
    let mark = t.bench.net.mark();
    t.pause(time)?;
    for station in [Some(&station), other.as_ref().ok()].into_iter().flatten() {
        for kind in [3001, 3002, 4000, 4001] {
            let found = times_of(&station.received(mark, |seen| seen.kind() == kind));
            let rate = found.len() as f64 / time.as_secs_f64();
            let gap = found
                .windows(2)
                .map(|pair| (pair[1] - pair[0]).as_secs_f64())
                .fold(0.0, f64::max);
            t.expect(rate >= 1.8, || {
                format!(
                    "expected {kind} at 2 Hz or faster for {} without a request; got {rate:.1} Hz",
                    station.id
                )
            })?;
            if gap > 1.0 {
                t.warn(format!(
                    "a gap of {gap:.1} s in {kind}, expected at most 1 s"
                ));
            }
        }
    }
    Ok(())
}

fn scheduled_rate_is_kept(t: &Trial) -> Judged {
    let station = t.monitor()?;
    let largest = t.bench.profile.figures.largest_rate_hz;
    // Each rate is tried beside the rates of another pushed message, and of one that is otherwise sent on request
    // only.
    for (hertz, others) in [(3_u16, (1_u16, 4_u16)), (1, (5, 1)), (10, (1, 2))] {
        if hertz > largest {
            continue;
        }
        // One message more or less is no fault: at a low rate the window is longer, so that it weighs less.
        let time = if hertz > 1 {
            window(t.timers().status.mul_f64(0.35), hertz)
        } else {
            t.timers().status / 2
        };
        let expected = [(4000, hertz), (3001, others.0), (3, others.1)];
        // Each schedule twice, as a CUCS does that has seen no answer: the second replaces the first.
        for (kind, hertz) in expected.into_iter().chain(expected) {
            station.send(schedule(kind, hertz));
        }
        t.pause(Duration::from_millis(800))?;
        let mark = t.bench.net.mark();
        t.pause(time)?;
        for (kind, hertz) in expected {
            let found = rate_since(&station, mark, kind, time);
            t.expect(keeps(hertz, found, time), || {
                format!("expected {kind} at {hertz} Hz within 20 % after 17001, got {found:.1} Hz")
            })?;
            if kind == 4000 {
                one_by_one(t, &station, mark, hertz)?;
            }
        }
    }
    Ok(())
}

/// How long a rate is measured, `usual` at least: long enough that one message more or less, in the measure and in what is
/// allowed for it, does not hide a rate that is 30 % off.
fn window(usual: Duration, hertz: u16) -> Duration {
    usual.max(Duration::from_secs_f64(20.5 / f64::from(hertz)))
}

/// Whether a rate is within 20 % of what was requested, but for one message in the time that it was measured.
fn keeps(hertz: u16, found: f64, time: Duration) -> bool {
    let tolerance = 0.2 * f64::from(hertz) + 1.0 / time.as_secs_f64();
    (found - f64::from(hertz)).abs() <= tolerance
}

/// Fails where messages come in bursts: then nearly all gaps are close to zero, whatever the rate is.
fn one_by_one(t: &Trial, station: &Station, mark: usize, hertz: u16) -> Judged {
    let came = station.received(mark, |seen| seen.kind() == 4000);
    let mut gaps: Vec<f64> = came
        .windows(2)
        .map(|pair| (pair[1].at - pair[0].at).as_secs_f64())
        .collect();
    gaps.sort_by(f64::total_cmp);
    // The same message by multicast and unicast counts once.
    let stamps: BTreeSet<_> = came.iter().map(|seen| seen.stamp()).collect();
    let median = gaps.get(gaps.len() / 2).copied().unwrap_or_default();
    let judged = hertz >= 4 && gaps.len() > 8 && stamps.len() * 4 > came.len() * 3;
    t.expect(!judged || median > 0.25 / f64::from(hertz), || {
        format!("expected 4000 at {hertz} Hz one by one; half of them come within {:.0} ms of the one before, in bursts", median * 1000.0)
    })
}

fn frequency_0_cancels(t: &Trial) -> Judged {
    let station = t.monitor()?;
    station.send(schedule(3, 5));
    station.send(schedule(3004, 4));
    t.pause(Duration::from_secs(1))?;
    let mark = t.bench.net.mark();
    let before = rate(t, &station, 3, Duration::from_secs(2))?;
    let beside = rate_since(&station, mark, 3004, Duration::from_secs(2));
    if before < 2.0 {
        return Err(Stop::inconclusive(format!(
            "precondition \"#3 is scheduled at 5 Hz\" is not met: {before:.1} Hz"
        )));
    }
    station.send(schedule(3, 0));
    t.pause(Duration::from_secs(1))?;
    let time = t.timers().quiet.max(Duration::from_secs(2));
    let mark = t.bench.net.mark();
    t.pause(time)?;
    let after = rate_since(&station, mark, 3, time);
    t.expect(after < 0.8, || {
        format!("expected no #3 after its schedule was cancelled, got {after:.1} Hz")
    })?;
    let still = rate_since(&station, mark, 3004, time);
    t.expect(beside < 2.0 || still > 1.0, || {
        format!("expected 3004 to continue as scheduled when the schedule of #3 was cancelled; it went from {beside:.1} to {still:.1} Hz")
    })?;
    let push = rate_since(&station, mark, 4000, time);
    t.expect(push > 0.4, || {
        "expected the default push of 4000 to continue; it stopped".into()
    })
}

fn asked_once_answered_once(t: &Trial) -> Judged {
    let a = t.controller()?;
    let mark = t.bench.net.mark();
    t.pause(t.timers().quiet * 2)?;
    let unasked = a.received(mark, |seen| seen.kind() == 3000).len();
    t.expect(unasked == 0, || {
        format!("expected no 3000 unless it is asked for, got {unasked}")
    })?;
    // A periodic message would look like a second answer.
    t.pause(Duration::from_millis(500))?;
    let other = t.b().ok();
    if let Some(other) = &other {
        t.grant(other, loi::LOI2)?;
        t.pause(Duration::from_millis(300))?;
    }
    let kinds = [3, 3000, 3004];
    let mark = t.bench.net.mark();
    for kind in kinds {
        a.query(kind)?;
    }
    t.pause(t.timers().quiet.min(Duration::from_secs(2)))?;
    for kind in kinds {
        let requests = t.bench.net.recording().datagrams[mark..]
            .iter()
            .flat_map(|datagram| &datagram.messages)
            .filter(|seen| {
                seen.direction == Direction::Sent
                    && seen.kind() == 17002
                    && seen.raw("Message Type") == Some(kind.into())
            })
            .count();
        let came = a.received(mark, |seen| seen.kind() == kind);
        let stamps: BTreeSet<_> = came.iter().map(|seen| seen.stamp()).collect();
        t.expect(stamps.len() <= requests, || {
            format!(
                "expected one {kind} to one 17002, got {} to {requests}",
                stamps.len()
            )
        })?;
        let elsewhere = other.as_ref().map_or(0, |other| {
            other
                .received(mark, |seen| {
                    seen.kind() == kind && seen.piece.destination == other.id
                })
                .len()
        });
        t.expect(elsewhere == 0, || {
            format!("expected {kind} to the CUCS that asked only; another was sent it")
        })?;
    }
    a.query(3001)?;
    Ok(())
}

fn higher_status_for_a_lower_loi(t: &Trial) -> Judged {
    let station = t.monitor()?;
    let mark = t.bench.net.mark();
    for kind in [3002, 3007] {
        station.send(information_request(kind));
        station.send(schedule(kind, 2));
    }
    t.pause(t.timers().answer)?;
    let answered = station
        .received(mark, |seen| matches!(seen.kind(), 3002 | 3007))
        .len();
    t.note(format!(
        "{answered} messages of a higher LOI came to a holder of LOI 2"
    ));
    let answer = station.request(0, Access::Request)?;
    let granted = answer.raw("LOI Granted").unwrap_or_default();
    if granted & loi::LOI2 == 0 {
        // The rule is a "may", but losing the right breaks a "must".
        t.note("LOI 2 was lost");
        return Err(Stop::fail(format!(
            "expected LOI 2 to stay after a request for status of a higher LOI, got LOI Granted 0x{granted:02x}"
        )));
    }
    t.expect(granted & !loi::LOI2 == 0, || {
        format!("expected LOI 2 and nothing above it after a request for status of a higher LOI, got LOI Granted 0x{granted:02x}")
    })?;
    let mark = t.bench.net.mark();
    let continues = station.wait(mark, t.timers().answer, |seen| seen.kind() == 4000);
    t.expect(continues.is_some(), || {
        "expected status to continue after a request for status of a higher LOI; no 4000 came"
            .into()
    })
}

fn altitude_has_its_datum(t: &Trial) -> Judged {
    let station = t.monitor()?;
    let claim = t.bench.profile.vehicle.first().cloned().unwrap_or_default();
    let now = fix(t, &station)?;
    let Some(amsl) = claim.amsl_m else {
        return Err(Stop::not_applicable(
            "needs vehicle.amsl_m in the profile: the height of the place where the vehicle stands",
        ));
    };
    let expected = match (now.altitude_type, claim.geoid_m) {
        (3, Some(geoid)) => amsl + geoid,
        (3, None) => {
            if (now.altitude - amsl).abs() < 5.0 {
                t.warn("the altitude under type 3 equals the height above sea: state vehicle.geoid_m to judge it");
            }
            return Ok(());
        }
        (2, _) => 0.0,
        _ => amsl,
    };
    let geoid_reading = now.altitude_type == 3 && (now.altitude - amsl).abs() < 10.0;
    t.expect((now.altitude - expected).abs() < 15.0, || {
        format!(
            "expected an altitude of {expected:.0} m within 15 m for altitude type {}, got {:.1} m{}",
            now.altitude_type,
            now.altitude,
            if geoid_reading { ": height above sea level under type 3, the geoid reading" } else { "" }
        )
    })?;
    // 3009 has one altitude field for each datum.
    let Ok(air) = station.query(3009) else {
        return Ok(());
    };
    let home = t
        .bench
        .home
        .get()
        .map_or(now.altitude, |home| home.altitude);
    let height = now.altitude - home;
    for (name, expected) in [
        (
            "WGS-84 Altitude",
            claim.geoid_m.map(|geoid| amsl + geoid + height),
        ),
        ("AGL Altitude", Some(height)),
    ] {
        if let (Some(found), Some(expected)) = (air.value(name), expected) {
            t.expect_of(&air, (found - expected).abs() < 15.0, || {
                format!("expected {name} of 3009 within 15 m of {expected:.0} m, got {found:.1} m")
            })?;
        }
    }
    Ok(())
}

fn waypoint_number_0_means_no_data(t: &Trial) -> Judged {
    let station = t.monitor()?;
    let mark = t.bench.net.mark();
    let found = station.wait(mark, t.timers().answer, |seen| seen.kind() == 4001);
    let found = found.map_or_else(|| station.query(4001), Ok)?;
    for number in [
        "From Waypoint Number",
        "To Waypoint Number",
        "Next Waypoint Number",
    ] {
        let group = number.trim_end_matches(" Number");
        let value = found.raw(number);
        let (latitude, longitude) = (
            found.raw(&format!("{group} - Latitude")),
            found.raw(&format!("{group} - Longitude")),
        );
        // 0 and 0 mark the place as not valid; a waypoint number needs a place.
        let placed = latitude.is_some()
            && longitude.is_some()
            && !(latitude == Some(0) && longitude == Some(0));
        t.expect_of(&found, value.unwrap_or_default() == 0 || placed, || format!("expected a place with {number} {value:?} in 4001; latitude and longitude are missing"))?;
    }
    drop(station);
    no_number_of_a_plan_that_is_gone(t)
}

/// A route is flown, left, and cleared: 4001 shows none of its numbers afterwards.
fn no_number_of_a_plan_that_is_gone(t: &Trial) -> Judged {
    if !t.bench.flight_released.load(Ordering::SeqCst) {
        return Ok(());
    }
    let Ok(a) = airborne(t) else { return Ok(()) };
    let home = home(t, &a)?;
    let mut plan = Plan::zigzag(&home, "GONE", &[31, 32]);
    stretch(&home, &mut plan, 300.0);
    loaded(t, &a, &plan)?;
    a.send(mode_command(mode::WAYPOINT).acked());
    if !mode_becomes(&a, mode::WAYPOINT, t.timers().begin)? {
        return Ok(());
    }
    t.pause(t.timers().answer / 2)?;
    hold(t, &a)?;
    clear(t, &a)?;
    let mut shown = a.query(4001)?;
    let deadline = t.bench.net.now() + t.timers().answer;
    let names = [
        "From Waypoint Number",
        "To Waypoint Number",
        "Next Waypoint Number",
    ];
    let left = |seen: &Seen| {
        names
            .into_iter()
            .find(|name| matches!(seen.raw(name), Some(31 | 32)))
    };
    while left(&shown).is_some() && t.bench.net.now() < deadline {
        t.pause(Duration::from_millis(100))?;
        shown = a.query(4001)?;
    }
    // In Edition 2.5 a mission without a route message cannot be cleared; a refusal leaves it loaded.
    let still = download(t, &a, "GONE")?;
    if still.messages.iter().any(|seen| seen.kind() == 13002) {
        t.note("the mission was not cleared: its numbers are not judged");
        return Ok(());
    }
    let name = left(&shown).unwrap_or_default();
    t.expect_of(&shown, name.is_empty(), || {
        format!(
            "expected no number of a route that was left and cleared in 4001; {name} is {:?}",
            shown.raw(name)
        )
    })
}

/// Climb in metres, high enough to be seen on its way.
const CLIMB_M: f64 = 40.0;

/// In flight an accepted value is reported, with its type.
fn accepted_values_are_shown(t: &Trial) -> Judged {
    if !t.bench.flight_released.load(Ordering::SeqCst) {
        return Ok(());
    }
    let Ok(a) = airborne(t) else {
        return Ok(());
    };
    let now = fix(t, &a)?;
    let good = mode_command(12)
        .raw("Altitude Command Type", 1)
        .set("Commanded Altitude", now.altitude + CLIMB_M)
        .raw("Altitude Type", now.altitude_type)
        .acked();
    let raw = field(&good, "Commanded Altitude");
    let sent = a.send(good);
    let deadline = t.bench.net.now() + t.timers().begin.min(t.timers().answer * 3);
    let mut shown = a.query(3002)?;
    // A "commanded" altitude that changes on the way is the vehicle's position, and not the command.
    let mut before = BTreeSet::new();
    while shown.raw("Commanded Altitude") != raw && t.bench.net.now() < deadline {
        before.extend(shown.raw("Commanded Altitude"));
        t.pause(Duration::from_millis(100))?;
        shown = a.query(3002)?;
    }
    t.expect_of(&shown, before.len() < 4, || {
        format!("expected Commanded Altitude of 3002 to become what was commanded; it moved through {} other values on the way", before.len())
    })?;
    let refused = a.received(sent.mark, |seen| {
        seen.kind() == 17000 && seen.raw("Acknowledgement Type") == Some(3)
    });
    if refused.is_empty() && shown.has("Commanded Altitude") {
        t.expect_beside(&shown, shown.raw("Commanded Altitude") == raw, || {
            format!(
                "expected 3002 to show the accepted altitude of {:.1} m, got {:?}",
                now.altitude + CLIMB_M,
                shown.value("Commanded Altitude")
            )
        })?;
        let kind = shown.raw("Altitude Type");
        t.expect_beside(&shown, kind == Some(now.altitude_type), || {
            format!(
                "expected 3002 to show altitude type {}, as commanded; got {kind:?}",
                now.altitude_type
            )
        })?;
    }
    steering_is_shown(t, &a)?;
    hold(t, &a)?;
    a.release()?;
    Ok(())
}

/// Course, speed and their types after a command that was carried out, and the place of a loiter.
fn steering_is_shown(t: &Trial, a: &Station) -> Judged {
    let now = fix(t, a)?;
    let (latitude, longitude) = now.offset(60.0, 40.0);
    let steer = mode_command(15)
        .raw("Heading Command Type", 2)
        .set("Commanded Course", 0.7)
        .raw("Altitude Command Type", 0)
        .set("Commanded Speed", 6.0)
        .raw("Speed Type", 2);
    let loiter = mode_command(12)
        .set("Loiter Position Latitude", latitude)
        .set("Loiter Position Longitude", longitude)
        .set("Commanded Speed", 4.0)
        .raw("Speed Type", 2);
    let same = |names: &[&'static str]| names.iter().map(|&name| (name, name)).collect();
    let cases: [(Draft, Vec<(&str, &str)>); 2] = [
        (
            steer,
            same(&[
                "Heading Command Type",
                "Commanded Course",
                "Commanded Speed",
                "Speed Type",
            ]),
        ),
        (
            loiter,
            vec![
                (
                    "Loiter Position Latitude",
                    "Commanded Loiter Position Latitude",
                ),
                (
                    "Loiter Position Longitude",
                    "Commanded Loiter Position Longitude",
                ),
                ("Commanded Speed", "Commanded Speed"),
            ],
        ),
    ];
    for (draft, fields) in cases {
        let sent = a.send(draft.clone().acked());
        let done = carried_out(t, a, &sent, t.timers().begin)?;
        let mut shown = a.query(3002)?;
        if done.is_none() {
            t.note("a command by which commanded values are judged was not carried out");
            continue;
        }
        let wanted = |seen: &Seen, (commanded, reported): &(&str, &str)| {
            let value = field(&draft, commanded);
            seen.raw(reported).is_none() || seen.raw(reported) == value
        };
        let deadline = t.bench.net.now() + t.timers().answer;
        while !fields.iter().all(|pair| wanted(&shown, pair)) && t.bench.net.now() < deadline {
            t.pause(Duration::from_millis(100))?;
            shown = a.query(3002)?;
        }
        for pair in &fields {
            t.expect_beside(&shown, wanted(&shown, pair), || {
                let value = field(&draft, pair.0);
                format!("expected {} {value:?} (as on the wire) in 3002 after a 2016 with it was carried out, got {:?}", pair.1, shown.raw(pair.1))
            })?;
        }
    }
    Ok(())
}

fn commanded_values_are_the_accepted_ones(t: &Trial) -> Judged {
    accepted_values_are_shown(t)?;
    let a = t.controller()?;
    let home = home(t, &a)?;
    let before = a.query(3002)?.raw("Commanded Altitude");
    let bad = mode_command(12)
        .raw("Altitude Command Type", 1)
        .set("Commanded Altitude", 150_000.0)
        .raw("Altitude Type", home.altitude_type)
        .raw("Heading Command Type", 2)
        .set("Commanded Course", 2.1)
        .set("Commanded Speed", 7.5)
        .raw("Speed Type", 2)
        .acked();
    let raw = field(&bad, "Commanded Altitude");
    let others = ["Commanded Course", "Commanded Speed"].map(|name| (name, field(&bad, name)));
    let was = a.query(3002)?;
    let sent = a.send(bad);
    let done = carried_out(t, &a, &sent, t.timers().quiet)?;
    let after = a.query(3002)?;
    for (name, refused) in others {
        let taken = after.raw(name) == refused && was.raw(name) != refused;
        t.expect_beside(&after, done.is_some() || !taken, || {
            format!("expected {name} of a 2016 that was refused for its altitude not to be shown by 3002; it is")
        })?;
    }
    t.expect_of(&after, after.raw("Commanded Altitude") != raw, || format!("expected 3002 not to show a refused altitude of 150 km; it went from {before:?} to {:?}", after.raw("Commanded Altitude")))
}

fn each_engine_by_itself(t: &Trial) -> Judged {
    let a = t.controller()?;
    let engines = a
        .query(3000)
        .ok()
        .and_then(|seen| seen.raw("Number of Engines"));
    let mark = t.bench.net.mark();
    a.query(3007)?;
    t.pause(t.timers().answer / 2)?;
    let numbers: BTreeSet<_> = a
        .received(mark, |seen| seen.kind() == 3007)
        .iter()
        .filter_map(|seen| seen.raw("Engine Number"))
        .collect();
    match engines {
        Some(engines) if engines > 0 => t.expect(numbers.len() as i64 == engines, || format!("expected a 3007 for each of {engines} engines of 3000, got engine numbers {numbers:?}")),
        _ => {
            t.note("3000 does not say how many engines there are");
            Ok(())
        }
    }
}

fn stale_data_are_not_sent_as_fresh(t: &Trial) -> Judged {
    let means = &t.bench.profile.means;
    let (Some(cut), Some(restore)) = (&means.cut_vehicle_link, &means.restore_vehicle_link) else {
        return Err(Stop::not_applicable(
            "needs means.cut_vehicle_link and means.restore_vehicle_link in the profile",
        ));
    };
    let station = t.monitor()?;
    let before = fix(t, &station).precondition("the vehicle has a position")?;
    let other = t.b().ok();
    if let Some(other) = &other {
        t.grant(other, loi::LOI2)?;
    }
    let calm = before_the_cause(t, &station, t.mark)?;
    // Before the cut, since its command may take longer than the subject to see it.
    let mark = t.bench.net.mark();
    crate::means::shell(cut).map_err(Stop::Inconclusive)?;
    let warned = |seen: &Seen| cautions(seen) && about_links(seen);
    let result = (|| {
        let alert = loss_alert(t, &station, mark, &calm, warned)?;
        let stamps = super::link::stamps_of_the_silent(t, &station)?;
        t.expect(stamps.len() <= 1, || {
            format!("expected the stamps of 4000 and 4001 to stop within 10 s of the vehicle's silence; {} different stamps came in 2 s ({:.5} as before the loss)", stamps.len(), before.latitude.to_degrees())
        })?;
        t.expect(alert.is_some(), || {
            "expected a 16000 (communications or a data terminal, caution or worse) that begins within 10 s of the loss of the vehicle; none came"
                .into()
        })?;
        // Every connected CUCS is without data, and has to be alerted.
        if let Some(other) = &other {
            let informed = other.received(mark, |seen| calm.begins(other, seen) && warned(seen));
            t.expect(!informed.is_empty(), || {
                format!("expected a 16000 about the loss of the vehicle at {} as well, which has LOI 2; none came", other.id)
            })?;
        }
        nothing_new_on_request(t, &station)?;
        let asked = t.bench.net.mark();
        let of_alert = alert.and_then(|alert| alert.raw("Subsystem ID"));
        let subsystem = of_alert.unwrap_or(COMMS);
        station.send(Draft::new(15000).raw("Subsystem ID", 1 << subsystem));
        let link = station.wait(asked, t.timers().answer / 2, |seen| {
            seen.kind() == 16001 && seen.raw("Subsystem ID") == Some(subsystem)
        });
        match link {
            Some(link) => t.expect_of(&link, link.raw("Subsystem State") != Some(1), || {
                format!("expected subsystem {subsystem}, of which the alert is, not to be nominal (1) in 16001 while the vehicle is silent")
            }),
            None => Ok(()),
        }
    })();
    crate::means::shell(restore).map_err(Stop::Inconclusive)?;
    let mark = t.bench.net.mark();
    // Status restarts without a request, as it was before the loss.
    let mut stamps = BTreeSet::new();
    let again = station.wait(mark, Duration::from_secs(8), |seen| {
        seen.kind() == 4000 && seen.has("Latitude") && {
            stamps.extend(seen.stamp());
            stamps.len() > 3
        }
    });
    t.pause(Duration::from_millis(500))?;
    result?;
    t.expect(again.is_some(), || {
        format!("expected 4000 to come by itself again once the vehicle's link was back; {} came in 8 s", stamps.len())
    })
}

/// A request for the position of a vehicle without link is answered by none, or by the last one with its own stamp.
fn nothing_new_on_request(t: &Trial, station: &Station) -> Judged {
    let stamps = |mark: usize| {
        let came = station.received(mark, |seen| seen.kind() == 4000 && seen.has("Latitude"));
        came.iter().filter_map(|seen| seen.stamp()).max()
    };
    let Some(last) = stamps(t.mark) else {
        return Ok(());
    };
    let mark = t.bench.net.mark();
    station.send(information_request(4000));
    t.pause(t.timers().answer / 4)?;
    let shown = stamps(mark).unwrap_or(last);
    // A stamp that is only just later than the last one (stamps have to rise) is not a new one.
    t.expect(shown <= last + 100, || {
        format!("expected no position, or the last one with its stamp, to a 17002 for 4000 of a silent vehicle; its stamp is {:.1} s later", (shown - last) as f64 / 1000.0)
    })
}

fn subsystems_answer_for_themselves(t: &Trial) -> Judged {
    let station = t.monitor()?;
    // Engine, navigation, VSM.
    let asked = [0, 5, 9];
    let mask = asked.iter().fold(0, |mask, bit| mask | 1_i64 << bit);
    let mark = t.bench.net.mark();
    station.ask(
        Draft::new(15000).raw("Subsystem ID", mask),
        t.timers().answer,
        "a subsystem status report (16001)",
        |seen| seen.kind() == 16001,
    )?;
    t.pause(t.timers().answer / 2)?;
    let reports = station.received(mark, |seen| seen.kind() == 16001);
    let all: BTreeSet<_> = reports
        .iter()
        .map(|seen| seen.raw("Subsystem ID"))
        .collect();
    // Each subsystem alone: the report has to be about that one.
    for bit in asked {
        let mark = t.bench.net.mark();
        station.send(Draft::new(15000).raw("Subsystem ID", 1_i64 << bit));
        let first = station.wait(mark, t.timers().answer, |seen| seen.kind() == 16001);
        t.pause(Duration::from_millis(300))?;
        let came = station.received(mark, |seen| seen.kind() == 16001);
        let found: BTreeSet<_> = came.iter().map(|seen| seen.raw("Subsystem ID")).collect();
        // The same message by multicast and unicast counts once.
        let stamps: BTreeSet<_> = came.iter().map(|seen| seen.stamp()).collect();
        t.expect(stamps.len() <= 1, || {
            format!(
                "expected one report of subsystem {bit} to one 15000, got {}",
                stamps.len()
            )
        })?;
        let exists = all.contains(&Some(bit));
        t.expect(first.is_some() || !exists, || {
            format!("expected a report of subsystem {bit} when it alone is asked for, as among others; none came")
        })?;
        t.expect(found.iter().all(|&id| id == Some(bit)), || {
            format!("expected the report of subsystem {bit} only, got {found:?}")
        })?;
    }
    for seen in &reports {
        let subsystem = seen.raw("Subsystem ID").unwrap_or(-1);
        t.expect_of(seen, asked.contains(&subsystem), || {
            format!("expected reports of the subsystems {asked:?} only, got one of {subsystem}")
        })?;
        let state = seen.raw("Subsystem State").unwrap_or(-1);
        t.expect_of(seen, (0..=5).contains(&state), || {
            format!("expected a state of 0 to 5 for subsystem {subsystem}, got {state}")
        })?;
    }
    Ok(())
}

fn each_cucs_has_its_own_subscriptions(t: &Trial) -> Judged {
    let a = t.monitor()?;
    let b = t.b()?;
    t.grant(&b, loi::LOI2)?;
    let (kinds, hertz) = ([4000, 3], 5_u16);
    for kind in kinds {
        a.send(schedule(kind, hertz));
        b.send(schedule(kind, 1));
    }
    t.pause(Duration::from_millis(600))?;
    for kind in kinds {
        b.send(schedule(kind, 0));
    }
    t.pause(Duration::from_millis(600))?;
    let time = t.timers().status / 3;
    let mark = t.bench.net.mark();
    t.pause(time)?;
    for kind in kinds {
        let found = rate_since(&a, mark, kind, time);
        let tolerance = 0.2 * f64::from(hertz) + 1.0 / time.as_secs_f64();
        t.expect((found - f64::from(hertz)).abs() <= tolerance, || {
            format!("expected {kind} at {hertz} Hz for {} after {} cancelled its own, got {found:.1} Hz", a.id, b.id)
        })?;
        a.send(schedule(kind, 0));
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use stanag_msgs::Id;

    use super::*;
    use crate::wire::split;

    #[test]
    fn what_comes_by_multicast_and_unicast_counts_once() {
        let message = |at_ms: u64, stamp: i64| {
            let bytes = Draft::new(3001).raw("Time Stamp", stamp);
            let bytes = bytes.encode(Id(0x1b00_0101), Id(0x1b00_00a0), 32, 1);
            let piece = split(&bytes).0.remove(0);
            let at = Duration::from_millis(at_ms);
            Arc::new(Seen::new(at, 0, Direction::Received, 0, piece))
        };
        let count = |all: &[(u64, i64)]| {
            let all: Vec<_> = all.iter().map(|&(at, stamp)| message(at, stamp)).collect();
            times_of(&all).len()
        };
        // 1 Hz, each twice.
        assert_eq!(count(&[(0, 1), (5, 1), (1_000, 2), (1_005, 2)]), 2);
        // 2 Hz; the mode was reported to the subject once.
        assert_eq!(count(&[(0, 1), (500, 1), (1_000, 1), (1_500, 1)]), 4);
        // Two reports that the network delivers together.
        assert_eq!(count(&[(0, 1), (5, 2)]), 2);
    }

    #[test]
    fn a_rate_that_is_30_per_cent_off_is_found() {
        for hertz in [3_u16, 10] {
            let time = window(Duration::from_millis(1_750), hertz);
            let measured = |rate: f64| (rate * time.as_secs_f64()).floor() / time.as_secs_f64();
            let hz = f64::from(hertz);
            for (factor, kept) in [
                (0.7, false),
                (0.9, true),
                (1.0, true),
                (1.1, true),
                (1.3, false),
            ] {
                assert_eq!(
                    keeps(hertz, measured(hz * factor), time),
                    kept,
                    "{hertz} {factor}"
                );
            }
        }
    }
}
