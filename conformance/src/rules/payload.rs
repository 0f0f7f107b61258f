//! PAYL: payload stations, who may command which, and that pointing, lens and laser do what the message commands and
//! nothing else.

use std::sync::Arc;
use std::time::Duration;

use super::acknowledgement::carried_out;
use super::scene::Scene;
use crate::bench::flight::{Fix, fix, wrapped};
use crate::bench::station::about;
use crate::bench::station::{Access, Station, information_request, loi};
use crate::bench::trial::Trial;
use crate::verdict::{Judged, Precondition, Stop};
use crate::wire::{Draft, Seen};

pub(super) const SCENES: &[Scene] = &[
    Scene {
        rule: "PAYL-001",
        play: one_configuration_for_each_station,
    },
    Scene {
        rule: "PAYL-002",
        play: payload_commands_need_the_stations_loi_3,
    },
    Scene {
        rule: "PAYL-003",
        play: only_the_addressed_station_moves,
    },
    Scene {
        rule: "PAYL-004",
        play: pointing_mode_decides,
    },
    Scene {
        rule: "PAYL-005",
        play: messages_of_the_payload_type,
    },
    Scene {
        rule: "PAYL-006",
        play: laser_fires_on_its_code_only,
    },
    Scene {
        rule: "AUTH-007",
        play: vehicle_controller_may_take_a_station,
    },
    Scene {
        rule: "AUTH-008",
        play: stations_are_given_singly,
    },
    Scene {
        rule: "AUTH-009",
        play: flying_is_not_payload_control,
    },
];

fn bit(station: u8) -> i64 {
    1 << (station - 1)
}

pub(super) fn stations(t: &Trial) -> Judged<Vec<u8>> {
    Ok(t.bench.surveyed()?.stations().into_iter().collect())
}

/// 21101 of this station, on request.
pub(super) fn operating_state(a: &Station, station: u8) -> Judged<Arc<Seen>> {
    a.ask(
        information_request(21101).raw("Station Number 1-16", bit(station)),
        a.bench().timers.answer,
        "the operating state of a payload",
        |seen| {
            seen.kind() == 21101
                && seen
                    .raw("Station Number 1-16")
                    .is_none_or(|found| found == bit(station))
        },
    )
}

/// Where 21101 reports the sensor to point: azimuth in radians.
fn pointing(a: &Station, station: u8) -> Judged<Option<f64>> {
    Ok(operating_state(a, station)?.value("Actual Centreline Azimuth Angle"))
}

/// 19001 to this azimuth in radians.
pub(super) fn steer(station: u8, azimuth: f64) -> Draft {
    Draft::new(19001)
        .raw("Station Number 1-16", bit(station))
        .set("Set Centreline Azimuth Angle", azimuth)
        .set("Set Centreline Elevation Angle", -0.2)
}

/// Pointing by angles relative to the aircraft, on, and active.
pub(super) fn by_angles(station: u8) -> Draft {
    active(station, 1)
}

/// On, active, in this pointing mode.
fn active(station: u8, pointing: i64) -> Draft {
    Draft::new(19100)
        .raw("Station Number 1-16", bit(station))
        .raw("System Operating Mode", 5)
        .raw("Set EO/IR Pointing Mode", pointing)
        .acked()
}

/// Whether the sensor turns to this azimuth in radians, within some time.
pub(super) fn turns(
    t: &Trial,
    a: &Station,
    station: u8,
    azimuth: f64,
    time: Duration,
) -> Judged<bool> {
    turns_to(t, a, station, time, || Ok(azimuth))
}

/// The same of an azimuth that changes with the vehicle.
fn turns_to(
    t: &Trial,
    a: &Station,
    station: u8,
    time: Duration,
    target: impl Fn() -> Judged<f64>,
) -> Judged<bool> {
    let deadline = t.bench.net.now() + time;
    loop {
        let azimuth = target()?;
        if pointing(a, station)?.is_some_and(|found| wrapped(found - azimuth).abs() < 0.06) {
            return Ok(true);
        }
        if t.bench.net.now() >= deadline {
            return Ok(false);
        }
        t.pause(Duration::from_millis(100))?;
    }
}

fn one_configuration_for_each_station(t: &Trial) -> Judged {
    let a = t.monitor()?;
    let expected = stations(t)?;
    let mark = t.bench.net.mark();
    a.query(21000)?;
    t.pause(t.timers().answer / 2)?;
    let found: Vec<i64> = a
        .received(mark, |seen| seen.kind() == 21000)
        .iter()
        .filter_map(|seen| seen.raw("Station Number 1-16"))
        .collect();
    let reports = a.received(mark, |seen| seen.kind() == 21000);
    let all = found.iter().fold(0, |all, bits| all | bits);
    for seen in &reports {
        let named = seen.raw("Station Number 1-16").unwrap_or_default();
        let lacking = seen
            .raw("Payload Stations Available 1-16")
            .unwrap_or_default()
            & !all;
        t.expect_beside(seen, lacking == 0, || {
            format!("expected 21000 for each of Payload Stations Available; none came for the bits 0x{lacking:04x}")
        })?;
        t.expect_of(seen, named.count_ones() <= 1, || {
            format!("expected one station in each 21000, got the bits 0x{named:04x}")
        })?;
        if let Some(available) = seen.raw("Payload Stations Available 1-16") {
            t.expect_of(seen, available & named == named, || {
                format!("expected station 0x{named:04x} among Payload Stations Available, got 0x{available:04x}")
            })?;
        }
    }
    for station in expected {
        t.expect(found.contains(&bit(station)), || {
            format!("expected 21000 for station {station}; got those of the bits {found:02x?}")
        })?;
        // A request that names one station is answered for that station only.
        let mark = t.bench.net.mark();
        a.send(information_request(21000).raw("Station Number 1-16", bit(station)));
        let one = a.wait(mark, t.timers().answer, |seen| seen.kind() == 21000);
        let named = one
            .as_ref()
            .and_then(|seen| seen.raw("Station Number 1-16"));
        t.expect(named.is_none_or(|named| named == bit(station)), || {
            format!(
                "expected 21000 of station {station} when it alone is named, got 0x{:04x}",
                named.unwrap_or_default()
            )
        })?;
    }
    Ok(())
}

/// Takes a station; the bits of the stations that the grant names.
pub(super) fn take_station(t: &Trial, station: &Station, number: u8) -> Judged<i64> {
    let answer = station.request_station(loi::LOI2 | loi::LOI3, Access::Request, bit(number))?;
    let granted = answer.raw("LOI Granted").unwrap_or_default();
    t.expect_of(&answer, granted & loi::LOI3 != 0, || {
        format!(
            "expected LOI 3 of station {number} granted to {}, got LOI Granted 0x{granted:02x}",
            station.id
        )
    })?;
    let stations = answer.raw("Controlled Station 1-16");
    t.expect_of(&answer, stations.is_none_or(|bits| bits & bit(number) != 0), || {
        format!("expected the bit of station {number} in Controlled Station 1-16 of its grant, got {stations:04x?}")
    })?;
    Ok(stations.unwrap_or_default())
}

fn still(t: &Trial, a: &Station, station: u8, command: Draft, by: &Station, why: &str) -> Judged {
    let before = pointing(a, station)?;
    let sent = by.send(by_angles(station));
    let steered = by.send(command.acked());
    carried_out(t, by, &steered, t.timers().quiet)?;
    t.pause(t.timers().quiet / 3)?;
    let done = by.received(sent.mark, |seen| {
        seen.kind() == 17000 && seen.raw("Acknowledgement Type") == Some(2)
    });
    t.expect(done.is_empty(), || {
        format!(
            "expected no 'carried out' for a payload command of {} ({why}); 17000 type 2 came",
            by.id
        )
    })?;
    let after = pointing(a, station)?;
    let same = match (before, after) {
        (Some(before), Some(after)) => wrapped(before - after).abs() < 0.05,
        _ => true,
    };
    t.expect(same, || format!("expected station {station} to stay after a command of {} ({why}); its azimuth went from {before:?} to {after:?}", by.id))
}

fn payload_commands_need_the_stations_loi_3(t: &Trial) -> Judged {
    let station = stations(t)?[0];
    let (watcher, b) = t.payload_pair()?;
    t.grant(&b, loi::LOI2)?;
    t.grant(&watcher, loi::LOI2)?;
    pointing(&watcher, station).precondition("the payload reports where it points")?;
    still(t, &watcher, station, steer(station, 0.9), &b, "LOI 2 only")?;
    if let Some(&other) = stations(t)?.get(1) {
        take_station(t, &b, other).precondition("B has LOI 3 of another station")?;
        still(
            t,
            &watcher,
            station,
            steer(station, -0.9),
            &b,
            "LOI 3 of another station",
        )?;
    }
    Ok(())
}

fn only_the_addressed_station_moves(t: &Trial) -> Judged {
    let all = stations(t)?;
    let [first, second, ..] = all[..] else {
        return Err(Stop::not_applicable("needs two payload stations"));
    };
    let (a, _) = t.payload_pair()?;
    for station in [first, second] {
        take_station(t, &a, station).precondition("LOI 3 is granted")?;
    }
    let before = pointing(&a, first)?;
    let target = if before.is_some_and(|before| wrapped(before - 0.52).abs() < 0.2) {
        -0.52
    } else {
        0.52
    };
    a.send(by_angles(second));
    a.send(steer(second, target).acked());
    t.expect(turns(t, &a, second, target, t.timers().begin)?, || {
        format!("expected station {second} to turn to {target:.2} rad; its report does not show it")
    })?;
    let after = pointing(&a, first)?;
    let same = before
        .zip(after)
        .is_none_or(|(before, after)| wrapped(before - after).abs() < 0.05);
    t.expect(same, || format!("expected station {first} to stay when station {second} is addressed; its azimuth went from {before:?} to {after:?}"))?;
    lens_of_the_other(t, &a, first, second, target)?;
    // A command for several stations acts on every station whose bit is set.
    let both = bit(first) | bit(second);
    let sent = a.send(by_angles(first).raw("Station Number 1-16", both));
    let refused = |kind: u16, stamp: i64| {
        move |seen: &Seen| about(seen, kind, stamp) && seen.raw("Acknowledgement Type") == Some(3)
    };
    if a.wait(sent.mark, t.timers().ack, refused(19100, sent.stamp))
        .is_some()
    {
        t.note("a command for two stations at once is refused");
        return Ok(());
    }
    let before = sent.mark;
    let sent = a.send(steer(first, 0.2).raw("Station Number 1-16", both).acked());
    // #1400 of Edition 2.5 reports that a command came; the reason of a refusal is in an alert.
    let alerted = || {
        let alerts = a.received(before, |seen| {
            seen.kind() == 16000 && seen.raw("Priority").is_some_and(|priority| priority >= 2)
        });
        t.of_edition_25() && !alerts.is_empty()
    };
    if a.wait(sent.mark, t.timers().ack, refused(19001, sent.stamp))
        .is_some()
        || alerted()
    {
        t.note("a command for two stations at once is refused");
        return Ok(());
    }
    for station in [first, second] {
        t.expect(turns(t, &a, station, 0.2, t.timers().begin / 2)?, || {
            format!("expected station {station} to turn to 0.20 rad by a command with the bits of both stations; its report does not show it")
        })?;
    }
    Ok(())
}

/// A field of view commanded for the second station leaves that of the first unchanged.
fn lens_of_the_other(t: &Trial, a: &Station, first: u8, second: u8, azimuth: f64) -> Judged {
    let view = |number: u8| -> Judged<Option<f64>> {
        Ok(operating_state(a, number)?.value("Actual Horizontal Field of View"))
    };
    let (Some(before), Some(own)) = (view(first)?, view(second)?) else {
        return Ok(());
    };
    let zoom = |to: f64| steer(second, azimuth).set("Set Horizontal Field of View", to);
    a.send(zoom(own * 0.7));
    t.pause(t.timers().answer / 4)?;
    let after = view(first)?;
    a.send(zoom(own));
    t.expect(after.is_none_or(|after| (after / before - 1.0).abs() < 0.1), || {
        format!("expected the field of view of station {first} to stay when station {second} is commanded one; it went from {before:.3} rad to {after:?} rad")
    })
}

fn pointing_mode_decides(t: &Trial) -> Judged {
    let station = stations(t)?[0];
    let (a, _) = t.payload_pair()?;
    take_station(t, &a, station).precondition("LOI 3 is granted")?;
    let target = 30_f64.to_radians();
    a.send(by_angles(station));
    a.send(steer(station, target).acked());
    t.expect(turns(t, &a, station, target, t.timers().begin)?, || "expected the sensor 30 degrees to the right in pointing mode 1; its report does not show it".into())?;
    let state = a.query(21101)?;
    let elevation = state.value("Actual Centreline Elevation Angle");
    t.expect_beside(&state, elevation.is_none_or(|found| wrapped(found + 0.2).abs() < 0.1), || {
        format!("expected an elevation of -0.2 rad (down) as commanded, the report shows {elevation:?}")
    })?;
    a.send(steer(station, -target).acked());
    t.expect(turns(t, &a, station, -target, t.timers().begin)?, || {
        "expected the sensor 30 degrees to the left in pointing mode 1; its report does not show it"
            .into()
    })?;
    let shown = state.raw("Pointing Mode State");
    t.expect_beside(&state, shown.is_none_or(|shown| shown == 1), || {
        format!("expected pointing mode 1 in 21101 after 19100 with it, got {shown:?}")
    })?;
    slew_rates(t, &a, station)?;
    ground_point(t, &a, station)
}

/// Pointing mode 2 turns by the slew rate, to the right for positive rates, whatever angles the message has.
fn slew_rates(t: &Trial, a: &Station, station: u8) -> Judged {
    let refused = |sent: &crate::bench::station::Sent| {
        a.wait(sent.mark, t.timers().ack, |seen| {
            about(seen, sent.kind, sent.stamp) && seen.raw("Acknowledgement Type") == Some(3)
        })
        .is_some()
    };
    a.send(steer(station, 0.0).acked());
    turns(t, a, station, 0.0, t.timers().begin / 2)?;
    let sent = a.send(active(station, 2));
    if refused(&sent) {
        t.note("pointing mode 2 (slew rates) is refused");
        return Ok(());
    }
    let slew = |rate: f64, up: f64| {
        Draft::new(19001)
            .raw("Station Number 1-16", bit(station))
            .set("Set Centreline Azimuth Angle", -0.5)
            .set("Horizontal Slew Rate", rate)
            .set("Vertical Slew Rate", up)
            .acked()
    };
    let elevation = || -> Judged<Option<f64>> {
        Ok(a.query(21101)?.value("Actual Centreline Elevation Angle"))
    };
    let (before, low) = (pointing(a, station)?, elevation()?);
    let sent = a.send(slew(0.25, 0.2));
    if refused(&sent) {
        t.note("a slew rate is refused");
        a.send(by_angles(station));
        return Ok(());
    }
    t.pause(Duration::from_millis(800))?;
    let (after, high) = (pointing(a, station)?, elevation()?);
    let state = operating_state(a, station)?;
    let shown = state.raw("Pointing Mode State");
    t.expect_beside(&state, shown.is_none_or(|shown| shown == 2), || {
        format!("expected pointing mode 2 in 21101 after 19100 with it, got {shown:?}")
    })?;
    a.send(slew(0.0, 0.0));
    a.send(by_angles(station));
    a.send(steer(station, 0.0).acked());
    let by = before
        .zip(after)
        .map(|(before, after)| wrapped(after - before));
    t.expect(by.is_none_or(|by| by > 0.03), || {
        format!("expected the sensor to turn to the right at a slew rate of 0.25 rad/s in pointing mode 2; its azimuth went from {before:?} to {after:?}")
    })?;
    let by = low.zip(high).map(|(low, high)| wrapped(high - low));
    t.expect(by.is_none_or(|by| by > 0.02), || {
        format!("expected the sensor to rise at a vertical slew rate of 0.2 rad/s in pointing mode 2; its elevation went from {low:?} to {high:?}")
    })?;
    field_of_view(t, a, station)
}

/// A commanded field of view is reported, or nothing changes: not every lens zooms.
fn field_of_view(t: &Trial, a: &Station, station: u8) -> Judged {
    let view =
        || -> Judged<Option<f64>> { Ok(a.query(21101)?.value("Actual Horizontal Field of View")) };
    let Some(before) = view()? else {
        return Ok(());
    };
    // A value this small is hardly a field of view in radians, so the subject may use another unit.
    let wide = before > 0.02;
    for wanted in if wide {
        [before * 0.7, before]
    } else {
        [0.6, 0.3]
    } {
        a.send(
            steer(station, 0.0)
                .set("Set Horizontal Field of View", wanted)
                .acked(),
        );
        let deadline = t.bench.net.now() + t.timers().answer;
        let mut shown = before;
        while (shown / wanted - 1.0).abs() > 0.1 && t.bench.net.now() < deadline {
            t.pause(Duration::from_millis(100))?;
            shown = view()?.unwrap_or(before);
        }
        if (shown - before).abs() < 0.02 * before && wanted != before {
            t.note("the field of view cannot be commanded");
            return Ok(());
        }
        t.expect((shown / wanted - 1.0).abs() <= 0.1, || {
            format!("expected a horizontal field of view of {wanted:.3} rad in 21101 as commanded, got {shown:.3} rad")
        })?;
    }
    Ok(())
}

/// Pointing mode 4 points at the ground place, whatever angles the message has.
fn ground_point(t: &Trial, a: &Station, station: u8) -> Judged {
    let now = fix(t, a)?;
    if now.heading.is_none() {
        return Ok(());
    }
    let sent = a.send(active(station, 4));
    let refused = a.wait(sent.mark, t.timers().ack, |seen| {
        about(seen, 19100, sent.stamp) && seen.raw("Acknowledgement Type") == Some(3)
    });
    if refused.is_some() {
        t.note("pointing mode 4 (ground point) is refused");
        return Ok(());
    }
    for (north, east) in [(0.0, 400.0), (300.0, -300.0)] {
        let (latitude, longitude) = now.offset(north, east);
        // From the nose of a vehicle that may fly and turn meanwhile.
        let bearing_from = |fix: &Fix| {
            let (past_north, past_east) = fix.from(latitude, longitude);
            let heading = fix.heading.unwrap_or_default();
            wrapped(f64::atan2(-past_east, -past_north) - heading)
        };
        let bearing = bearing_from(&now);
        let sent = a.send(
            steer(station, wrapped(bearing + 1.5))
                .set("Latitude", latitude)
                .set("Longitude", longitude)
                .set("Altitude", now.altitude)
                .raw("Altitude Type", now.altitude_type)
                .acked(),
        );
        let refused = a.wait(sent.mark, t.timers().ack, |seen| {
            about(seen, 19001, sent.stamp) && seen.raw("Acknowledgement Type") == Some(3)
        });
        if refused.is_some() {
            t.note("a ground point is refused");
            return Ok(());
        }
        let target = || -> Judged<f64> { Ok(bearing_from(&fix(t, a)?)) };
        t.expect(turns_to(t, a, station, t.timers().begin, target)?, || {
            format!("expected the sensor to look at the ground point {bearing:.2} rad from the nose in pointing mode 4; 21101 does not show it")
        })?;
    }
    a.send(by_angles(station));
    Ok(())
}

fn messages_of_the_payload_type(t: &Trial) -> Judged {
    let a = t.monitor()?;
    let found = a.query(21000)?;
    t.cite(&found);
    let kind = found.raw("Payload Type");
    if matches!(kind, Some(1..=3)) {
        a.query(21101)?;
        a.query(21100)?;
    }
    if kind != Some(4) {
        a.send(
            Draft::new(19200)
                .raw("Station Number 1-16", 1)
                .raw("Set Radar State", 1)
                .acked(),
        );
    }
    t.pause(Duration::from_millis(300))?;
    a.query(3)?;
    Ok(())
}

fn laser_fires_on_its_code_only(t: &Trial) -> Judged {
    let station = stations(t)?[0];
    let (a, _) = t.payload_pair()?;
    take_station(t, &a, station).precondition("LOI 3 is granted")?;
    let lasing = |seen: &crate::wire::Seen| {
        [
            "Fire Laser Pointer Status",
            "Fire Laser Rangefinder Status",
            "Laser Designator Status",
        ]
        .map(|field| seen.raw(field))
    };
    let state = || operating_state(&a, station);
    let before = lasing(&*state().precondition("the payload reports its state")?);
    // A message with other fields leaves it unchanged.
    a.send(by_angles(station));
    a.send(steer(station, 0.1).acked());
    t.pause(Duration::from_millis(150))?;
    let after = state()?;
    t.expect_of(&after, lasing(&after) == before, || {
        format!("expected 19100 and 19001 without a firing field to leave the lasers as they were ({before:?}); 21101 shows {:?}", lasing(&after))
    })?;
    for field in [
        "Fire Laser Pointer",
        "Fire Laser Rangefinder",
        "Initiate Laser Designator",
    ] {
        // One bit away from 238 and 85, the codes for firing; and 0xFF, 1, 2, which a careless "not 0" would accept.
        let near = |code: i64| (0..8).map(move |bit| code ^ (1 << bit));
        for code in [0xFF, 1, 2].into_iter().chain(near(238)).chain(near(85)) {
            // Codes that have a defined meaning are left out.
            if [0, 51, 68, 85, 238].contains(&code) {
                continue;
            }
            a.send(
                Draft::new(19100)
                    .raw("Station Number 1-16", bit(station))
                    .raw(field, code)
                    .acked(),
            );
            t.pause(Duration::from_millis(60))?;
            let after = state()?;
            t.expect_of(&after, lasing(&after) == before, || {
                format!("expected {field} 0x{code:02x}, which is no code for firing, to leave the lasers as they were ({before:?}); 21101 shows {:?}", lasing(&after))
            })?;
        }
    }
    Ok(())
}

fn vehicle_controller_may_take_a_station(t: &Trial) -> Judged {
    let station = stations(t)?[0];
    let (a, b) = t.payload_pair()?;
    t.grant(&a, loi::LOI2 | loi::LOI4)?;
    take_station(t, &b, station).precondition("B has LOI 3")?;
    if let Ok(c) = t.find("a third CUCS id that may have LOI 3", |cucs| {
        cucs.id != a.id && cucs.id != b.id && cucs.authorised & loi::LOI3 != 0
    }) {
        let answer = c.request_station(loi::LOI3, Access::Request, bit(station))?;
        let granted = answer.raw("LOI Granted").unwrap_or_default();
        t.expect_of(&answer, granted & loi::LOI3 == 0, || format!("expected C's plain request for station {station} to be denied, got LOI Granted 0x{granted:02x}"))?;
    }
    take_station(t, &a, station)?;
    pointing(&a, station).precondition("the payload reports where it points")?;
    still(
        t,
        &a,
        station,
        steer(station, 0.9),
        &b,
        "its station was taken by the vehicle's controller",
    )
}

fn stations_are_given_singly(t: &Trial) -> Judged {
    let all = stations(t)?;
    let [first, second, ..] = all[..] else {
        return Err(Stop::not_applicable("needs two payload stations"));
    };
    let (a, b) = t.payload_pair()?;
    let named = take_station(t, &a, first)?;
    t.expect(named & bit(second) == 0, || {
        format!("expected the grant of station {first} to name it alone, got Controlled Station 1-16 0x{named:04x}")
    })?;
    take_station(t, &b, second)?;
    still(
        t,
        &b,
        second,
        steer(second, 0.7),
        &a,
        "LOI 3 of another station",
    )?;
    // Once released, the station is free for the other CUCS, and no longer obeys its former holder.
    a.release()?;
    take_station(t, &b, first)?;
    t.grant(&a, loi::LOI2)?;
    still(
        t,
        &b,
        first,
        steer(first, -0.7),
        &a,
        "its station was released",
    )
}

fn flying_is_not_payload_control(t: &Trial) -> Judged {
    let station = stations(t)?[0];
    let (a, _) = t.payload_pair()?;
    t.grant(&a, loi::LOI2 | loi::LOI4)?;
    pointing(&a, station).precondition("the payload reports where it points")?;
    still(
        t,
        &a,
        station,
        steer(station, 0.8),
        &a,
        "LOI 4 without LOI 3",
    )?;
    take_station(t, &a, station)?;
    a.send(by_angles(station));
    a.send(steer(station, 0.8).acked());
    t.expect(turns(t, &a, station, 0.8, t.timers().begin)?, || {
        "expected the payload command to work once LOI 3 was granted".into()
    })
}
