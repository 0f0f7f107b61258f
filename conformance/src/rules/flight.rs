//! Rules that are judged in flight: motion, routes, loiters, steering.
//!
//! The first of them launches the vehicle by mode 21; each begins in mode 12, and leaves the vehicle in flight for
//! the next.

use std::f64::consts::TAU;
use std::sync::Arc;
use std::time::Duration;

use super::maneuver::circled;
use super::scene::Scene;
use crate::bench::flight::{
    EARTH_M, Fix, Plan, airborne, clear, fix, fly_from, fly_until, hold, home, loaded, mode,
    mode_becomes, mode_command, reported_mode, stretch, to_number, wrapped,
};
use crate::bench::station::Station;
use crate::bench::station::about;
use crate::bench::trial::Trial;
use crate::verdict::{Judged, Stop};
use crate::wire::{Draft, Seen};

pub(super) const SCENES: &[Scene] = &[
    Scene {
        rule: "STAT-007",
        play: velocity_axes,
    },
    Scene {
        rule: "MODE-001",
        play: mode_report_follows_the_command,
    },
    Scene {
        rule: "MODE-004",
        play: waypoint_mode_flies_the_plan,
    },
    Scene {
        rule: "STAT-010",
        play: the_uploaders_numbers,
    },
    Scene {
        rule: "STAT-011",
        play: arrival_times_are_times_of_day,
    },
    Scene {
        rule: "ROUTE-015",
        play: loiter_waypoints_are_flown,
    },
    Scene {
        rule: "ROUTE-016",
        play: altitude_type_is_honoured,
    },
    Scene {
        rule: "MODE-005",
        play: loiter_where_and_how_commanded,
    },
];

/// A straight piece of flight between two positions.
#[derive(Clone, Debug)]
pub(super) struct Track {
    /// 3009, and the position that came right after it; where the one before it shows the same speed, since 3009 is of a
    /// moment between the two.
    air: Option<(Arc<Seen>, Fix)>,
    /// Metres over the ground.
    pub(super) distance: f64,
    /// Radians from true north.
    pub(super) course: f64,
    /// Heading that 4000 reports at the end, radians; `None` where it could not be compared with the course.
    pub(super) heading: Option<f64>,
    /// Metres north, east and up by positions.
    moved: [f64; 3],
    /// The same by velocities.
    integrated: [f64; 3],
}

/// Commands the vehicle by mode 12 to a place this many metres from where it is.
///
/// Returns the fix to which the offsets were added: the vehicle may still have been moving then.
fn go(t: &Trial, a: &Station, north: f64, east: f64, up: f64) -> Judged<Fix> {
    let now = fix(t, a)?;
    let (latitude, longitude) = now.offset(north, east);
    a.send(
        mode_command(mode::LOITER)
            .set("Loiter Position Latitude", latitude)
            .set("Loiter Position Longitude", longitude)
            .raw("Altitude Command Type", 1)
            .set("Commanded Altitude", now.altitude + up)
            .raw("Altitude Type", now.altitude_type)
            // The speed of the plans' waypoints: an autopilot's own speed for this may be so low that the course is
            // noise.
            .set("Commanded Speed", 5.0)
            .raw("Speed Type", 2)
            .acked(),
    );
    Ok(now)
}

/// Collects fixes for this long.
fn fixes(t: &Trial, a: &Station, time: Duration) -> Judged<Vec<Fix>> {
    let mark = t.bench.net.mark();
    t.pause(time)?;
    Ok(a.received(mark, |seen| seen.kind() == 4000)
        .iter()
        .filter_map(|seen| Fix::of(seen))
        .collect())
}

/// The track between the first and the last of these fixes, in the vehicle's time: the stamps of a simulation may run
/// faster than the clock.
fn track(t: &Trial, fixes: &[Fix]) -> Option<Track> {
    let (first, last) = (fixes.first()?, fixes.last()?);
    let (north, east) = last.from(first.latitude, first.longitude);
    let speed = t.bench.profile.figures.speed_factor.max(0.1);
    let mut integrated = [0.0; 3];
    for pair in fixes.windows(2) {
        let time = (pair[1].at - pair[0].at).as_secs_f64() * speed;
        let mean = |field: fn(&Fix) -> f64| (field(&pair[0]) + field(&pair[1])) / 2.0 * time;
        integrated[0] += mean(|fix| fix.north);
        integrated[1] += mean(|fix| fix.east);
        integrated[2] -= mean(|fix| fix.down);
    }
    Some(Track {
        air: None,
        distance: north.hypot(east),
        course: last.east.atan2(last.north).rem_euclid(TAU),
        // Course and heading at one moment, since a mean over a turn is neither. None in a climb: PX4 flies past the
        // place at which it climbs, with its nose toward it.
        heading: last.heading.filter(|_| {
            last.north.hypot(last.east) > 2.5 && (last.altitude - first.altitude).abs() < 5.0
        }),
        moved: [north, east, last.altitude - first.altitude],
        integrated,
    })
}

/// Flies a leg east, one south, and a climb; the tracks of steady flight.
pub(super) fn tracks(t: &Trial, a: &Station) -> Judged<Vec<Track>> {
    let mut found = Vec::new();
    let speed = t.bench.profile.figures.speed_factor.max(1.0);
    a.send(crate::bench::station::schedule(
        4000,
        t.bench.profile.figures.largest_rate_hz.min(10),
    ));
    for (north, east, up) in [(0.0, 250.0, 0.0), (-250.0, 0.0, 0.0), (0.0, 0.0, 40.0)] {
        let began = fix(t, a)?;
        go(t, a, north, east, up)?;
        // Past the turn: the course is compared in steady flight.
        let away = fly_until(t, a, t.timers().flight.div_f64(4.0), |fix| {
            let moved = fix.distance(began.latitude, began.longitude);
            if up > 0.0 {
                fix.altitude > began.altitude + 5.0
            } else {
                moved > 60.0
            }
        })?;
        if away.is_none() {
            continue;
        }
        let seen = fixes(t, a, Duration::from_secs_f64((9.0 / speed).clamp(1.2, 9.0)))?;
        let air = a.query(3009).ok();
        let mut one = track(t, &seen);
        if let (Some(one), Some(air), Some(before)) = (&mut one, air, seen.last()) {
            let after = fix(t, a)?;
            let change = (after.north - before.north).hypot(after.east - before.east);
            one.air = (change < STEADY_MPS).then_some((air, after));
        }
        found.extend(one);
    }
    Ok(found)
}

/// A change of speed of less than this is none: gusts, and the steps of the fields.
const STEADY_MPS: f64 = 1.5;

/// 3009 agrees with 4000 on the motion over the ground, and through the air it differs by the wind.
fn air_and_ground_agree(t: &Trial, air: &Arc<Seen>, fix: &Fix) -> Judged {
    for (name, other, expected) in [
        ("U_Ground", "U_Speed", fix.north),
        ("V_Ground", "V_Speed", fix.east),
    ] {
        if let Some(found) = air.value(name) {
            t.expect_of(air, (found - expected).abs() < 2.5, || {
                format!("expected {name} of 3009 to agree with {other} of 4000, {expected:.1} m/s; got {found:.1} m/s")
            })?;
        }
    }
    let wind = air.value("U_Wind").zip(air.value("V_Wind"));
    // Edition 2.5 cannot leave out what is not measured: there 0 means nothing was measured.
    let measured = air
        .value("True Airspeed")
        .filter(|found| air.original.is_none() || *found != 0.0);
    if let (Some((north, east)), Some(found)) = (wind, measured) {
        let expected = (fix.north - north).hypot(fix.east - east);
        t.expect_of(air, (found - expected).abs() < 3.0, || {
            format!("expected a True Airspeed of {expected:.1} m/s in 3009, what the wind leaves of the speed over the ground; got {found:.1} m/s")
        })?;
    }
    Ok(())
}

fn velocity_axes(t: &Trial) -> Judged {
    let a = airborne(t)?;
    let tracks = tracks(t, &a)?;
    let mut judged = 0;
    for track in &tracks {
        // In steady flight only: while the vehicle brakes, 3009 and 4000 are of different moments.
        if let Some((air, fix)) = track.air.as_ref().filter(|_| track.heading.is_some()) {
            air_and_ground_agree(t, air, fix)?;
        }
        for (axis, (&moved, &by_speed)) in track.moved.iter().zip(&track.integrated).enumerate() {
            let name = ["U_Speed (north)", "V_Speed (east)", "-W_Speed (up)"][axis];
            if moved.abs() < 8.0 && by_speed.abs() < 8.0 {
                continue;
            }
            judged += 1;
            let tolerance = 5.0 + 0.25 * moved.abs();
            if (moved - by_speed).abs() > tolerance {
                let ratio = moved / by_speed;
                let hint = if (ratio + 1.0).abs() < 0.3 {
                    ": the sign is the opposite"
                } else if (ratio - 0.5).abs() < 0.12 {
                    ": positions move half as far, as with an angle step of pi/2^n"
                } else {
                    ""
                };
                return Err(Stop::fail(format!(
                    "expected {name} to agree with the change of position; the vehicle moved {moved:.0} m, its velocities make {by_speed:.0} m{hint}"
                )));
            }
        }
    }
    if judged == 0 {
        return Err(Stop::inconclusive(
            "the vehicle did not move far enough to compare velocities and positions",
        ));
    }
    Ok(())
}

fn mode_report_follows_the_command(t: &Trial) -> Judged {
    let a = match airborne(t) {
        // Not entering mode 12 is a failed precondition elsewhere; here it breaks the rule itself.
        Err(Stop::Inconclusive(reason)) if reason.contains("3001 does not show mode 12") => {
            return Err(Stop::fail(
                "expected 3001 to show mode 12 after 2016 mode 12; it does not",
            ));
        }
        other => other?,
    };
    let home = home(t, &a)?;
    let mut plan = Plan::zigzag(&home, "MODES", &[1, 2, 3]);
    stretch(&home, &mut plan, 150.0);
    loaded(t, &a, &plan)?;
    for wanted in [mode::WAYPOINT, mode::LOITER] {
        let sent = a.send(mode_command(wanted).acked());
        let shown = mode_becomes(&a, wanted, t.timers().begin)?;
        let refused = a.received(sent.mark, |seen| {
            about(seen, 2016, sent.stamp) && seen.raw("Acknowledgement Type") == Some(3)
        });
        t.expect(shown || !refused.is_empty(), || {
            format!(
                "expected 3001 to show mode {wanted} within {:.0} s of 2016",
                t.timers().begin.as_secs_f64()
            )
        })?;
        if !refused.is_empty() {
            return Err(Stop::inconclusive(format!("mode {wanted} was refused")));
        }
    }
    Ok(())
}

fn to_becomes(t: &Trial, a: &Station, number: i64, time: Duration) -> Judged<bool> {
    let deadline = t.bench.net.now() + time;
    while t.bench.net.now() < deadline {
        if to_number(a)? == Some(number) {
            return Ok(true);
        }
        t.pause(Duration::from_millis(100))?;
    }
    Ok(false)
}

fn waypoint_mode_flies_the_plan(t: &Trial) -> Judged {
    let a = airborne(t)?;
    let home = home(t, &a)?;
    let mut plan = Plan::zigzag(&home, "FLY", &[10, 40, 20, 65_534]);
    stretch(&home, &mut plan, 150.0);
    for point in &mut plan.points {
        *point = point.clone().set("Waypoint to Speed", PACE_MPS);
    }
    loaded(t, &a, &plan)?;
    let sent = a.send(
        mode_command(mode::WAYPOINT)
            .raw("Commanded Waypoint Number", 20)
            .acked(),
    );
    let third = to_becomes(t, &a, 20, t.timers().begin)?;
    let shown = to_number(&a)?;
    if !third {
        let refused = a.received(sent.mark, |seen| {
            about(seen, 2016, sent.stamp) && seen.raw("Acknowledgement Type") == Some(3)
        });
        if !refused.is_empty() {
            return Err(Stop::inconclusive("mode 11 from waypoint 20 was refused"));
        }
        return Err(Stop::fail(format!(
            "expected 4001 To = 20 after mode 11 from waypoint 20, got {shown:?}"
        )));
    }
    let before = fix(t, &a)?;
    let (latitude, longitude) = place(&plan, 20);
    let nearer = fly_until(t, &a, t.timers().begin, |fix| {
        fix.distance(latitude, longitude) < before.distance(latitude, longitude) - 10.0
    })?;
    t.expect(
        nearer.is_some() || before.distance(latitude, longitude) < 30.0,
        || "expected the distance to waypoint 20 to fall in mode 11".into(),
    )?;
    // From the start the route is flown by Next Waypoint: 10, then 40.
    t.expect(hold(t, &a)?, || "expected mode 12".into())?;
    a.send(
        mode_command(mode::WAYPOINT)
            .raw("Commanded Waypoint Number", 10)
            .acked(),
    );
    t.expect(to_becomes(t, &a, 10, t.timers().begin)?, || {
        "expected 4001 To = 10 after mode 11 from waypoint 10".into()
    })?;
    let deadline = t.bench.net.now() + t.timers().flight;
    let mut next = Some(10);
    let leg = t.bench.net.mark();
    while next == Some(10) && t.bench.net.now() < deadline {
        next = to_number(&a)?;
        t.pause(Duration::from_millis(100))?;
    }
    speed_of_the_leg(t, &a, leg)?;
    t.expect(next == Some(40), || {
        format!("expected waypoint 40 after 10, as Next Waypoint says; 4001 shows To = {next:?}")
    })?;
    // Without a number, mode 11 starts the route at its beginning or continues where it was left: the texts allow
    // both readings.
    let left = to_number(&a)?;
    hold(t, &a)?;
    a.send(mode_command(mode::WAYPOINT).acked());
    let deadline = t.bench.net.now() + t.timers().begin / 2;
    let mut to = None;
    while t.bench.net.now() < deadline && !(to == Some(10) || to.is_some() && to == left) {
        t.pause(Duration::from_millis(100))?;
        to = to_number(&a)?.filter(|to| ![0, 65_535].contains(to));
    }
    t.expect(to == Some(10) || to.is_some() && to == left, || {
        format!("expected 4001 To = 10, the start of the route, or {left:?}, to which it flew before, after mode 11 without a Commanded Waypoint Number; got {to:?}")
    })?;
    if to != Some(10) {
        t.note("mode 11 without a Commanded Waypoint Number continues the route where it was left");
    }
    // A waypoint number that is not in the loaded plan.
    hold(t, &a)?;
    a.send(
        mode_command(mode::WAYPOINT)
            .raw("Commanded Waypoint Number", 77)
            .acked(),
    );
    t.pause(t.timers().quiet)?;
    let shown = reported_mode(&a)?;
    t.expect(shown != Some(mode::WAYPOINT), || {
        "expected mode 11 from waypoint 77, which is not aboard, to be refused; 3001 shows 11"
            .into()
    })
}

/// Ground speed of the waypoints of MODE-004, m/s.
const PACE_MPS: f64 = 9.0;

/// The leg to waypoint 10, which is long enough to reach its speed.
fn speed_of_the_leg(t: &Trial, a: &Station, mark: usize) -> Judged {
    let paces: Vec<f64> = a
        .received(mark, |seen| seen.kind() == 4000)
        .iter()
        .filter_map(|seen| Fix::of(seen))
        .map(|fix| fix.north.hypot(fix.east))
        .collect();
    let fastest = paces.iter().copied().fold(0.0, f64::max);
    if paces.len() < 4 {
        t.note("too few positions came on the way to waypoint 10 to judge its speed");
        return Ok(());
    }
    t.expect((PACE_MPS * 0.7..PACE_MPS * 1.4).contains(&fastest), || {
        format!("expected the speed of {PACE_MPS} m/s that the waypoints have on the way to waypoint 10; 4000 shows {fastest:.1} m/s at most")
    })
}

fn place(plan: &Plan, number: i64) -> (f64, f64) {
    let point = plan.points.iter().find(|point| {
        point.message_type == 13002
            && crate::bench::flight::field(point, "Waypoint Number") == Some(number)
    });
    let value = |name: &str| {
        point
            .and_then(|point| crate::bench::flight::field(point, name))
            .unwrap_or_default() as f64
            * std::f64::consts::PI
            / 2_f64.powi(31)
    };
    (
        value("Waypoint to Latitude or Relative Y"),
        value("Waypoint to Longitude or Relative X"),
    )
}

fn the_uploaders_numbers(t: &Trial) -> Judged {
    let a = airborne(t)?;
    let home = home(t, &a)?;
    let mut plan = Plan::zigzag(&home, "NUMBERS", &[10, 40, 20]);
    stretch(&home, &mut plan, 60.0);
    loaded(t, &a, &plan)?;
    fly_from(t, &a, 10)?;
    let mark = t.bench.net.mark();
    let deadline = t.bench.net.now() + t.timers().flight.div_f64(3.0).min(Duration::from_secs(40));
    while t.bench.net.now() < deadline && reported_mode(&a)? == Some(mode::WAYPOINT) {
        t.pause(Duration::from_millis(300))?;
        let reached = a.received(mark, |seen| {
            seen.kind() == 4001 && seen.raw("To Waypoint Number") == Some(20)
        });
        if !reached.is_empty() {
            break;
        }
    }
    let known = [10, 40, 20, 0, 65_535];
    for seen in a.received(mark, |seen| seen.kind() == 4001) {
        for (number, latitude) in [
            ("From Waypoint Number", "From Waypoint - Latitude"),
            ("To Waypoint Number", "To Waypoint - Latitude"),
            ("Next Waypoint Number", "Next Waypoint - Latitude"),
        ] {
            let Some(value) = seen.raw(number) else {
                continue;
            };
            t.expect_of(&seen, known.contains(&value), || format!("expected the uploader's numbers 10, 40, 20 (or 0, 65535) in 4001; {number} is {value}"))?;
            if ![10, 40, 20].contains(&value) {
                continue;
            }
            let prefix = latitude.trim_end_matches(" - Latitude");
            let (altitude, kind) = (
                seen.value(&format!("{prefix} Altitude")),
                seen.raw("Altitude Type"),
            );
            // Only in the datum of the upload; one step of difference is the autopilot's rounding.
            if let Some(altitude) = altitude.filter(|_| kind == Some(home.altitude_type)) {
                t.expect_of(&seen, (altitude - home.altitude - 50.0).abs() < 3.0, || {
                    format!("expected waypoint {value} at {:.0} m as uploaded; 4001 shows {altitude:.0} m", home.altitude + 50.0)
                })?;
            }
            if !prefix.starts_with("From")
                && let Some(pace) = seen.value(&format!("{prefix} Speed"))
                && seen.raw("Speed Type") == Some(2)
            {
                t.expect_of(&seen, pace == 0.0 || (pace - 5.0).abs() < 1.1, || {
                    format!(
                        "expected 5 m/s to waypoint {value} as uploaded; 4001 shows {pace:.1} m/s"
                    )
                })?;
            }
            let longitude = latitude.replace("Latitude", "Longitude");
            if let (Some(north), Some(east)) = (seen.value(latitude), seen.value(&longitude)) {
                let (expected_north, expected_east) = place(&plan, value);
                let off = ((north - expected_north) * EARTH_M)
                    .hypot(wrapped(east - expected_east) * expected_north.cos() * EARTH_M);
                t.expect_of(&seen, off < 3.0, || format!("expected waypoint {value} where it was uploaded; 4001 shows it {off:.0} m away"))?;
            }
        }
        // From, To and Next follow one another as in the route; 0 where one does not apply.
        let to = seen.raw("To Waypoint Number").unwrap_or_default();
        let order = [(10, 0, 40), (40, 10, 20), (20, 40, 0)];
        if let Some((_, from, next)) = order.into_iter().find(|(number, _, _)| *number == to) {
            for (name, expected) in [
                ("From Waypoint Number", from),
                ("Next Waypoint Number", next),
            ] {
                let shown = seen.raw(name).unwrap_or_default();
                let none =
                    [0, 65_535].contains(&shown) && (name.starts_with("From") || expected == 0);
                t.expect_of(&seen, shown == expected || none, || {
                    format!("expected {name} {expected} in 4001 on the way to {to} of the route 10, 40, 20; got {shown}")
                })?;
            }
        }
    }
    Ok(())
}

fn arrival_times_are_times_of_day(t: &Trial) -> Judged {
    let a = airborne(t)?;
    let home = home(t, &a)?;
    // The route begins where the vehicle is, with a short first leg, so that the judged leg has a waypoint before it.
    let now = fix(t, &a)?;
    let mut plan = Plan::zigzag(&home, "TIMES", &[1, 2, 3]);
    for (point, north) in plan.points.iter_mut().zip([40.0, 440.0, 840.0]) {
        let (latitude, longitude) = now.offset(north, 0.0);
        *point = point
            .clone()
            .set("Waypoint to Latitude or Relative Y", latitude)
            .set("Waypoint to Longitude or Relative X", longitude);
    }
    loaded(t, &a, &plan)?;
    fly_from(t, &a, 1)?;
    let speed = t.bench.profile.figures.speed_factor.max(0.1);
    to_becomes(t, &a, 2, t.timers().flight.div_f64(4.0))?;
    // In steady flight distance divided by speed is the time.
    t.pause(Duration::from_secs_f64((8.0 / speed).clamp(1.0, 8.0)))?;
    let before = fix(t, &a)?;
    let seen = a.query(4001)?;
    let now = fix(t, &a)?;
    let Some(time) = seen.raw("To Waypoint Time").filter(|&time| time != 0) else {
        return Err(Stop::not_applicable("4001 carries no To Waypoint Time"));
    };
    let ahead = (time - seen.stamp().unwrap_or_default()) as f64 / 1000.0;
    t.expect_of(&seen, (-5.0..36_000.0).contains(&ahead), || format!("expected To Waypoint Time as a time of day shortly after the stamp; it is {ahead:.0} s from it"))?;
    if let Some(from) = seen.raw("From Waypoint Time").filter(|&from| from != 0)
        && !matches!(seen.raw("From Waypoint Number"), None | Some(0))
    {
        t.expect_of(
            &seen,
            from <= seen.stamp().unwrap_or_default() + 1_000,
            || "expected From Waypoint Time in the past; it is later than the stamp".into(),
        )?;
    }
    let over_ground = now.north.hypot(now.east);
    let to = seen
        .raw("To Waypoint Number")
        .filter(|to| [1, 2].contains(to));
    if let Some(to) = to.filter(|_| over_ground > 1.5) {
        let (latitude, longitude) = place(&plan, to);
        // 4001 is of a moment between the two positions, which may be far apart where the computer is slow.
        let [earlier, takes] =
            [before, now].map(|fix| fix.distance(latitude, longitude) / over_ground);
        // In the vehicle's time or in the clock's: a simulation may run faster, and both are accepted.
        let near = |pace: f64| {
            let (least, most) = (earlier.min(takes) / pace, earlier.max(takes) / pace);
            let slack = |expected: f64| 0.35 * expected + 3.0 + 2.0 / speed;
            (least - slack(least)..=most + slack(most)).contains(&ahead)
        };
        t.expect_of(&seen, near(1.0) || near(speed), || {
            format!("expected To Waypoint Time {takes:.0} s after the stamp, the distance over the speed; it is {ahead:.1} s")
        })?;
    }
    if let (Some(2 | 3), Some(next)) = (
        seen.raw("Next Waypoint Number"),
        seen.raw("Next Waypoint Time"),
    ) {
        t.expect_of(&seen, next == 0 || next > time, || {
            format!(
                "expected Next Waypoint Time later than To Waypoint Time; it is {} s earlier",
                (time - next) as f64 / 1000.0
            )
        })?;
    }
    Ok(())
}

fn loiter_waypoints_are_flown(t: &Trial) -> Judged {
    let a = airborne(t)?;
    let home = home(t, &a)?;
    let mut plan = Plan::zigzag(&home, "LOITER", &[1, 2, 3]);
    let seconds = 20;
    // A duration of 0 is not a loiter.
    plan.points.insert(
        1,
        Draft::new(13003)
            .raw("Waypoint Number", 1)
            .raw("Waypoint Loiter Type", 1)
            .set("Loiter Radius", 60.0)
            .raw("Loiter Direction", 1)
            .raw("Loiter Duration", 0)
            .raw("Loiter Duration Units", 0),
    );
    plan.points.insert(
        3,
        Draft::new(13003)
            .raw("Waypoint Number", 2)
            .raw("Waypoint Loiter Type", 1)
            .set("Loiter Radius", 60.0)
            .raw("Loiter Direction", 1)
            .raw("Loiter Duration", seconds)
            .raw("Loiter Duration Units", 0),
    );
    loaded(t, &a, &plan)?;
    fly_from(t, &a, 1)?;
    let speed = t.bench.profile.figures.speed_factor.max(0.1);
    let (latitude, longitude) = place(&plan, 2);
    // How long the vehicle stays near the second waypoint, in its own time.
    a.send(crate::bench::station::schedule(
        4000,
        t.bench.profile.figures.largest_rate_hz.min(10),
    ));
    if !to_becomes(t, &a, 2, t.timers().flight.div_f64(2.0))? {
        let (north, east) = place(&plan, 1);
        let now = fix(t, &a)?;
        if now.distance(north, east) < 75.0 {
            return Err(Stop::fail(
                "expected the leg to waypoint 2 after waypoint 1, whose loiter has a duration of 0; the vehicle stays at waypoint 1",
            ));
        }
        return Err(Stop::inconclusive(
            "4001 does not show the way to the loiter waypoint",
        ));
    }
    let near = fly_until(t, &a, t.timers().flight, |fix| {
        fix.distance(latitude, longitude) < 75.0
    })?;
    if near.is_none() {
        return Err(Stop::inconclusive(
            "the vehicle did not reach the loiter waypoint",
        ));
    }
    let began = t.bench.net.now();
    let mark = t.bench.net.mark();
    let deadline = began + Duration::from_secs_f64(180.0 / speed).max(t.timers().answer * 4);
    let mut ended = false;
    while t.bench.net.now() < deadline {
        if to_number(&a)? != Some(2) {
            ended = true;
            break;
        }
        t.pause(Duration::from_millis(50))?;
    }
    let stayed = (t.bench.net.now() - began).as_secs_f64() * speed;
    t.expect(ended, || format!("expected the leg to waypoint 3 after {seconds} s of loiter; the vehicle still loiters after {stayed:.0} s"))?;
    t.expect(stayed >= seconds as f64 * 0.7, || {
        format!("expected {seconds} s of loiter at waypoint 2, got {stayed:.0} s")
    })?;
    t.expect(stayed <= seconds as f64 + 60.0, || {
        format!("expected {seconds} s of loiter at waypoint 2, got {stayed:.0} s")
    })?;
    let seen: Vec<Fix> = a
        .received(mark, |seen| seen.kind() == 4000)
        .iter()
        .filter_map(|seen| Fix::of(seen))
        .collect();
    circled(
        t,
        &seen,
        (latitude, longitude),
        60.0,
        1.0,
        "the loiter of waypoint 2",
    )
}

fn altitude_type_is_honoured(t: &Trial) -> Judged {
    // The launch itself may have climbed too high because its altitude type was ignored: the second call then finds
    // the vehicle in the air.
    let a = airborne(t).or_else(|_| airborne(t))?;
    let home = home(t, &a)?;
    // First above ground: 45 m is 45 m over home, whatever the datum of 4000. Then in the datum of 4000, then above
    // sea level.
    let mut levels = vec![
        (2, 45.0, 45.0),
        (home.altitude_type, home.altitude + 65.0, 65.0),
    ];
    let amsl = t
        .bench
        .profile
        .vehicle
        .first()
        .and_then(|vehicle| vehicle.amsl_m);
    if let Some(amsl) = amsl.filter(|_| home.altitude_type != 1) {
        levels.push((1, amsl + 45.0, 45.0));
    }
    for (round, (kind, altitude, expected)) in levels.into_iter().enumerate() {
        let mut plan = Plan::zigzag(&home, &format!("ALT{kind}"), &[1, 2]);
        // Each further out: the vehicle must not already be where it has to arrive.
        stretch(&home, &mut plan, 90.0 + 60.0 * round as f64);
        // The first waypoint in the datum of 4000, so that each waypoint's own type counts.
        let of = [
            (home.altitude_type, home.altitude + expected),
            (kind, altitude),
        ];
        for (point, (kind, altitude)) in plan.points.iter_mut().zip(of) {
            *point = point
                .clone()
                .set("Waypoint to Altitude", altitude)
                .raw("Waypoint Altitude Type", kind)
                .set("Waypoint to Speed", 10.0);
        }
        clear(t, &a)?;
        let found = crate::bench::flight::load(t, &a, &plan)?;
        if found.status != Some(1) {
            t.note(format!("altitude type {kind} is refused"));
            continue;
        }
        fly_from(t, &a, 1)?;
        let (latitude, longitude) = place(&plan, 2);
        let there = fly_until(t, &a, t.timers().flight.div_f64(2.0), |fix| {
            fix.distance(latitude, longitude) < 15.0 || (fix.altitude - home.altitude) < 12.0
        })?;
        let reached = match there {
            Some(there) => there,
            None => fix(t, &a)?,
        };
        let above = reached.altitude - home.altitude;
        // Back to level before the verdict, so that a wrong altitude ends here.
        hold(t, &a)?;
        t.expect((above - expected).abs() <= 12.0, || {
            let ignored = if above < 15.0 { ": the type is ignored" } else { "" };
            format!("expected {expected:.0} m above home for a waypoint of {altitude:.0} m with altitude type {kind}, got {above:.0} m{ignored}")
        })?;
    }
    Ok(())
}

fn loiter_where_and_how_commanded(t: &Trial) -> Judged {
    let a = airborne(t)?;
    a.send(
        Draft::new(2017)
            .raw("Loiter Type", 1)
            .set("Loiter Radius", 90.0)
            .raw("Loiter Direction", 2),
    );
    t.pause(Duration::from_millis(200))?;
    let began = go(t, &a, 0.0, 300.0, 12.0)?;
    let (latitude, longitude) = began.offset(0.0, 300.0);
    let mark = t.bench.net.mark();
    let near = fly_until(t, &a, t.timers().flight, |fix| {
        fix.distance(latitude, longitude) < 110.0
    })?;
    t.expect(near.is_some(), || {
        "expected the vehicle near the commanded loiter place, 300 m east; it did not arrive".into()
    })?;
    let mut paces: Vec<f64> = a
        .received(mark, |seen| seen.kind() == 4000)
        .iter()
        .filter_map(|seen| Fix::of(seen))
        .map(|fix| fix.north.hypot(fix.east))
        .collect();
    paces.sort_by(f64::total_cmp);
    if let Some(pace) = paces.get(paces.len() / 2).filter(|_| paces.len() > 5) {
        t.expect(*pace < 8.5, || {
            format!("expected 5 m/s on the way to the loiter place as commanded, 4000 shows {pace:.1} m/s")
        })?;
    }
    // Edition 2.5 reports no loiter.
    if !t.of_edition_25() {
        let shown = a.query(3004)?;
        t.expect_beside(
            &shown,
            shown
                .value("Loiter Radius")
                .is_some_and(|radius| (radius - 90.0).abs() < 1.0),
            || "expected 3004 to show the radius of 90 m".into(),
        )?;
    }
    a.send(crate::bench::station::schedule(
        4000,
        t.bench.profile.figures.largest_rate_hz.min(10),
    ));
    let speed = t.bench.profile.figures.speed_factor.max(1.0);
    t.pause(Duration::from_secs_f64((15.0 / speed).max(1.5)))?;
    let seen = fixes(t, &a, Duration::from_secs_f64((30.0 / speed).max(3.0)))?;
    circled(
        t,
        &seen,
        (latitude, longitude),
        90.0,
        -1.0,
        "the commanded loiter",
    )?;
    let there = fix(t, &a)?;
    let height = there.altitude - began.altitude;
    t.expect((height - 12.0).abs() < 6.0, || {
        format!("expected the loiter 12 m above where it was commanded, as its altitude says; it is flown at {height:.0} m")
    })?;
    // The commanded place is not a waypoint, so it has no waypoint number.
    let shown = a.query(4001)?;
    let to = shown.raw("To Waypoint Number");
    if to == Some(65_535)
        && let (Some(north), Some(east)) = (
            shown.value("To Waypoint - Latitude"),
            shown.value("To Waypoint - Longitude"),
        )
    {
        let off = ((north - latitude) * EARTH_M)
            .hypot(wrapped(east - longitude) * latitude.cos() * EARTH_M);
        t.expect_beside(&shown, off < 5.0, || {
            format!("expected the commanded loiter place with To = 65535 in 4001; it shows one {off:.0} m away")
        })?;
    }
    if !matches!(to, None | Some(0 | 65_535)) {
        t.cite(&shown);
        t.warn(format!(
            "4001 shows To = {to:?} at a commanded loiter place, expected 65535 (or 0)"
        ));
    }
    // A vehicle that circles is also commanded to circle the other way.
    if there.distance(latitude, longitude) > 40.0 {
        return the_other_way_round(t, &a, (latitude, longitude), &there);
    }
    Ok(())
}

fn the_other_way_round(t: &Trial, a: &Station, place: (f64, f64), now: &Fix) -> Judged {
    let radius = 75.0;
    a.send(
        Draft::new(2017)
            .raw("Loiter Type", 1)
            .set("Loiter Radius", radius)
            .raw("Loiter Direction", 1),
    );
    t.pause(Duration::from_millis(150))?;
    a.send(
        mode_command(mode::LOITER)
            .set("Loiter Position Latitude", place.0)
            .set("Loiter Position Longitude", place.1)
            .raw("Altitude Command Type", 1)
            .set("Commanded Altitude", now.altitude)
            .raw("Altitude Type", now.altitude_type)
            .acked(),
    );
    let speed = t.bench.profile.figures.speed_factor.max(1.0);
    t.pause(Duration::from_secs_f64((20.0 / speed).max(2.0)))?;
    let seen = fixes(t, a, Duration::from_secs_f64((20.0 / speed).max(2.0)))?;
    circled(
        t,
        &seen,
        place,
        radius,
        1.0,
        "a second loiter, to the right",
    )
}
