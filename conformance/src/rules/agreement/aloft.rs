//! Second looks in flight: routes up to their end, and the finer fields of 2016.

use std::f64::consts::TAU;
use std::time::Duration;

use crate::bench::flight::{
    Fix, Plan, airborne, clear, field, fix, fly_until, hold, home, load, loaded, mode,
    mode_becomes, mode_command, reported_mode, route_head, stretch, to_number, wrapped,
};
use crate::bench::station::about;
use crate::bench::station::{Station, schedule};
use crate::bench::trial::Trial;
use crate::rules::acknowledgement::refused;
use crate::rules::configuration::{availability, full};
use crate::rules::scene::Scene;
use crate::verdict::{Judged, Precondition};
use crate::wire::Draft;

pub(super) const FURTHER: &[Scene] = &[
    Scene {
        rule: "ROUTE-002",
        play: loading_is_not_flying,
    },
    Scene {
        rule: "ROUTE-015",
        play: turns_are_no_seconds,
    },
    Scene {
        rule: "MODE-004",
        play: to_the_end_and_from_elsewhere,
    },
    Scene {
        rule: "MODE-006",
        play: banks_turns_and_climb_limits,
    },
    Scene {
        rule: "MODE-015",
        play: a_part_acts_and_the_rest_stays,
    },
    Scene {
        rule: "CONF-004",
        play: values_of_2016_work_or_are_listed,
    },
    Scene {
        rule: "STAT-007",
        play: climbs_and_turns_are_reported_alike,
    },
];

fn loading_is_not_flying(t: &Trial) -> Judged {
    if !t.may_fly() {
        return Ok(());
    }
    let Ok(a) = airborne(t) else { return Ok(()) };
    let (home, began) = (home(t, &a)?, fix(t, &a)?);
    let mut plan = Plan::zigzag(&home, "LATER", &[1, 2]);
    stretch(&home, &mut plan, 200.0);
    loaded(t, &a, &plan)?;
    let speed = t.bench.profile.figures.speed_factor.max(1.0);
    t.pause(Duration::from_secs_f64((15.0 / speed).max(1.5)))?;
    let (shown, now) = (reported_mode(&a)?, fix(t, &a)?);
    let away = now.distance(began.latitude, began.longitude);
    hold(t, &a)?;
    t.expect(shown == Some(mode::LOITER) && away < 150.0, || {
        format!("expected a load in mode 12 to change neither mode nor flight; 3001 shows {shown:?}, the vehicle is {away:.0} m away")
    })
}

fn turns_are_no_seconds(t: &Trial) -> Judged {
    let a = airborne(t)?;
    let home = home(t, &a)?;
    let mut plan = Plan::zigzag(&home, "TURNS", &[1, 2]);
    stretch(&home, &mut plan, 120.0);
    let (turns, radius) = (2, 60.0);
    plan.points.insert(
        1,
        Draft::new(13_003)
            .raw("Waypoint Number", 1)
            .raw("Waypoint Loiter Type", 1)
            .set("Loiter Radius", radius)
            .raw("Loiter Direction", 1)
            .raw("Loiter Duration", turns)
            .raw("Loiter Duration Units", 1),
    );
    clear(t, &a)?;
    if load(t, &a, &plan)?.status != Some(1) {
        t.note("a loiter whose duration is in turns is refused");
        return Ok(());
    }
    let (latitude, longitude) = place(&plan, 0);
    a.send(
        mode_command(mode::WAYPOINT)
            .raw("Commanded Waypoint Number", 1)
            .acked(),
    );
    if !mode_becomes(&a, mode::WAYPOINT, t.timers().begin)? {
        return Ok(());
    }
    let near = fly_until(t, &a, t.timers().flight, |fix| {
        fix.distance(latitude, longitude) < radius + 15.0
    })?;
    let speed = t.bench.profile.figures.speed_factor.max(1.0);
    let began = t.bench.net.now();
    // Two turns of 380 m take more than a minute at the plan's 5 m/s; 40 s are clearly less, so a vehicle that has
    // left by then did not loiter.
    let least = Duration::from_secs_f64(40.0 / speed);
    while near.is_some() && t.bench.net.now() < began + least && to_number(&a)? == Some(1) {
        t.pause(Duration::from_millis(50))?;
    }
    let stayed = (t.bench.net.now() - began).as_secs_f64() * speed;
    hold(t, &a)?;
    t.expect(near.is_none() || stayed >= 39.0, || {
        format!(
            "expected {turns} turns of {radius:.0} m at waypoint 1; it was left after {stayed:.0} s"
        )
    })
}

fn to_the_end_and_from_elsewhere(t: &Trial) -> Judged {
    let a = airborne(t)?;
    let home = home(t, &a)?;
    let to = |number: i64| {
        mode_command(mode::WAYPOINT)
            .raw("Commanded Waypoint Number", number)
            .acked()
    };
    let route = |name: &str, spacing: f64| {
        let mut plan = Plan::zigzag(&home, name, &[1, 2, 3]);
        stretch(&home, &mut plan, spacing);
        for point in &mut plan.points {
            *point = point.clone().set("Waypoint to Speed", 8.0);
        }
        plan
    };
    let plan = route("WHOLE", 60.0);
    loaded(t, &a, &plan)?;
    a.send(to(1));
    if !mode_becomes(&a, mode::WAYPOINT, t.timers().begin)? {
        return Ok(());
    }
    let (latitude, longitude) = place(&plan, 2);
    let there = fly_until(t, &a, t.timers().flight.div_f64(2.0), |fix| {
        fix.distance(latitude, longitude) < 25.0
    })?;
    hold(t, &a)?;
    t.expect(there.is_some(), || {
        "expected the route to be flown to its last waypoint; the vehicle never came within 25 m of it".into()
    })?;
    // While it flies to the first waypoint it is sent to the third.
    let mut elsewhere = route("ELSEWHERE", 600.0);
    // Without a commanded speed: an absent speed does not mean a speed of 0.
    let paced = elsewhere.clone();
    for point in &mut elsewhere.points {
        *point = point.clone().set("Waypoint to Speed", 0.0);
    }
    clear(t, &a)?;
    if load(t, &a, &elsewhere)?.status != Some(1) {
        t.note("waypoints without a speed are refused");
        loaded(t, &a, &paced)?;
    }
    a.send(to(1));
    if !mode_becomes(&a, mode::WAYPOINT, t.timers().begin)? || to_number(&a)? != Some(1) {
        return Ok(());
    }
    let sent = a.send(to(3));
    if refused(t, &a, &sent) {
        t.note("another waypoint is refused in mode 11");
        hold(t, &a)?;
        return Ok(());
    }
    let deadline = t.bench.net.now() + t.timers().answer;
    while to_number(&a)? == Some(1) && t.bench.net.now() < deadline {
        t.pause(Duration::from_millis(50))?;
    }
    let (shown, began) = (to_number(&a)?, fix(t, &a)?);
    let moved = fly_until(t, &a, t.timers().begin / 2, |fix| {
        fix.distance(began.latitude, began.longitude) > 25.0
    })?;
    hold(t, &a)?;
    t.expect(shown != Some(1), || {
        "expected waypoint 3, commanded in mode 11 on the way to waypoint 1, to be flown to; 4001 still shows To 1".into()
    })?;
    t.expect(moved.is_some(), || {
        "expected a waypoint without a speed to be flown to at the vehicle's own; the vehicle does not move".into()
    })?;
    the_flight_route_is_flown(t, &a, &home)
}

/// Mode 11 flies the flight route, and not the contingency route, which was sent last.
fn the_flight_route_is_flown(t: &Trial, a: &Station, home: &Fix) -> Judged {
    let mut plan = Plan::zigzag(home, "BESIDE", &[1, 2]);
    stretch(home, &mut plan, 400.0);
    let contingency = Plan::zigzag(home, "BESIDE", &[101, 102]);
    plan.points.push(route_head("R-BESIDE", 101, 3));
    plan.points.extend(contingency.points);
    clear(t, a)?;
    if load(t, a, &plan)?.status != Some(1) {
        t.note("a contingency route beside the flight route is refused");
        return Ok(());
    }
    let sent = a.send(mode_command(mode::WAYPOINT).acked());
    if refused(t, a, &sent) || !mode_becomes(a, mode::WAYPOINT, t.timers().answer * 2)? {
        t.note("mode 11 is not entered with a contingency route beside the flight route");
        return Ok(());
    }
    let deadline = t.bench.net.now() + t.timers().answer;
    let mut shown = to_number(a)?;
    while matches!(shown, None | Some(0 | 65_535)) && t.bench.net.now() < deadline {
        t.pause(Duration::from_millis(50))?;
        shown = to_number(a)?;
    }
    hold(t, a)?;
    t.expect(!matches!(shown, Some(101 | 102)), || {
        format!("expected mode 11 to fly the flight route 1, 2, not the contingency route beside it; 4001 shows To {shown:?}")
    })
}

/// Latitude and longitude of a plan's waypoint.
fn place(plan: &Plan, index: usize) -> (f64, f64) {
    let point = plan.points[index].seen();
    let value = |name: &str| point.value(name).unwrap_or_default();
    (
        value("Waypoint to Latitude or Relative Y"),
        value("Waypoint to Longitude or Relative X"),
    )
}

/// How far the heading turned, positive to the right, in this many seconds of the vehicle's time after a command;
/// `None` where it is refused.
fn turned(t: &Trial, a: &Station, command: Draft, seconds: f64) -> Judged<Option<f64>> {
    let sent = a.send(command.acked());
    if refused(t, a, &sent) || !mode_becomes(a, mode::AUTOPILOT, t.timers().begin)? {
        return Ok(None);
    }
    let speed = t.bench.profile.figures.speed_factor.max(1.0);
    let deadline = t.bench.net.now() + Duration::from_secs_f64((seconds / speed).max(0.5));
    let (mut all, mut before) = (0.0, fix(t, a)?.heading);
    while t.bench.net.now() < deadline {
        let now = fix(t, a)?.heading;
        if let (Some(from), Some(to)) = (before, now) {
            all += wrapped(to - from);
        }
        before = now;
    }
    Ok(before.map(|_| all))
}

fn banks_turns_and_climb_limits(t: &Trial) -> Judged {
    let a = airborne(t)?;
    let steer = |kind: i64| {
        mode_command(mode::AUTOPILOT)
            .raw("Heading Command Type", kind)
            .raw("Altitude Command Type", 0)
            .set("Commanded Speed", 8.0)
            .raw("Speed Type", 2)
    };
    for (command, what) in [
        (
            steer(4).set("Commanded Roll", 0.3),
            "a roll of 0.3 rad (type 4)",
        ),
        (
            steer(5).set("Commanded Turn Rate", 0.15),
            "a turn rate of 0.15 rad/s (type 5)",
        ),
    ] {
        let by = turned(t, &a, command, 8.0)?;
        hold(t, &a)?;
        match by {
            None => t.note(format!("{what} is refused")),
            Some(by) => t.expect(by > -0.1, || {
                format!(
                    "expected {what} to turn to the right; the heading turned by {:.0} degrees",
                    by.to_degrees()
                )
            })?,
        }
    }
    magnetic_headings(t, &a)?;
    course_beside_heading(t, &a)?;
    // Altitude command type 3: the altitude, at most at the vertical speed.
    let began = fix(t, &a)?;
    let sent = a.send(
        mode_command(mode::AUTOPILOT)
            .raw("Altitude Command Type", 3)
            .set("Commanded Altitude", began.altitude + 30.0)
            .raw("Altitude Type", began.altitude_type)
            .set("Commanded Vertical Speed", 0.5)
            .acked(),
    );
    if refused(t, &a, &sent) || !mode_becomes(&a, mode::AUTOPILOT, t.timers().begin)? {
        t.note("altitude command type 3 is refused");
        return Ok(());
    }
    let speed = t.bench.profile.figures.speed_factor.max(1.0);
    t.pause(Duration::from_secs_f64((5.0 / speed).max(1.0)))?;
    hold(t, &a)?;
    // Recorded from the command on: a climb without the limit could be over before the first query.
    let fastest = a
        .received(sent.mark, |seen| seen.kind() == 4000)
        .iter()
        .filter_map(|seen| Some(-Fix::of(seen)?.down))
        .fold(0.0, f64::max);
    t.expect(fastest < 1.5, || {
        format!("expected altitude command type 3 to climb at 0.5 m/s, as the vertical speed says; 4000 shows {fastest:.1} m/s")
    })
}

/// Where magnetic north differs from true north, a heading of that reference differs too.
fn magnetic_headings(t: &Trial, a: &Station) -> Judged {
    let variation = a
        .query(4000)?
        .value("Magnetic Variation")
        .unwrap_or_default();
    if variation.abs() < 0.15 {
        return Ok(());
    }
    let Some(heading) = fix(t, a)?.heading else {
        return Ok(());
    };
    let magnetic = wrapped(heading + TAU / 5.0);
    let sent = a.send(
        mode_command(mode::AUTOPILOT)
            .raw("Heading Command Type", 1)
            .set("Commanded Heading", magnetic)
            .raw("Heading Reference", 1)
            .raw("Altitude Command Type", 0)
            .acked(),
    );
    if refused(t, a, &sent) {
        t.note("magnetic headings are refused");
        return Ok(());
    }
    let target = wrapped(magnetic + variation);
    let reached = fly_until(t, a, t.timers().begin, |fix| {
        fix.heading
            .is_some_and(|heading| wrapped(heading - target).abs() < 0.05)
    })?;
    // It may pass through the heading on its way: it has to stay there.
    t.pause(Duration::from_millis(500))?;
    let stays = fix(t, a)?.heading.unwrap_or(target);
    hold(t, a)?;
    t.expect(reached.is_some() && wrapped(stays - target).abs() < 0.1, || {
        format!(
            "expected a heading of {:.0} degrees true for one of {:.0} degrees magnetic, with a variation of {:.0}; 4000 shows {:.0}",
            target.to_degrees().rem_euclid(360.0),
            magnetic.to_degrees().rem_euclid(360.0),
            variation.to_degrees(),
            stays.to_degrees().rem_euclid(360.0)
        )
    })
}

/// Heading command type 3: the nose along the heading, the track along the course.
fn course_beside_heading(t: &Trial, a: &Station) -> Judged {
    let Some(heading) = fix(t, a)?.heading else {
        return Ok(());
    };
    let course = wrapped(heading + TAU / 4.0);
    let sent = a.send(
        mode_command(mode::AUTOPILOT)
            .raw("Heading Command Type", 3)
            .set("Commanded Heading", wrapped(heading - 0.4))
            .set("Commanded Course", course)
            .raw("Altitude Command Type", 0)
            .set("Commanded Speed", 8.0)
            .raw("Speed Type", 2)
            .acked(),
    );
    if refused(t, a, &sent) || !mode_becomes(a, mode::AUTOPILOT, t.timers().begin)? {
        t.note("heading command type 3 is refused");
        return Ok(());
    }
    let speed = t.bench.profile.figures.speed_factor.max(1.0);
    t.pause(Duration::from_secs_f64((8.0 / speed).max(0.8)))?;
    let began = fix(t, a)?;
    let moved = fly_until(t, a, t.timers().begin / 2, |fix| {
        fix.distance(began.latitude, began.longitude) > 30.0
    })?;
    hold(t, a)?;
    let Some(now) = moved else {
        t.note("the vehicle does not move by heading command type 3");
        return Ok(());
    };
    let (north, east) = now.from(began.latitude, began.longitude);
    let flown = east.atan2(north);
    t.expect(wrapped(flown - course).abs() < 0.6, || {
        format!(
            "expected the course of {:.0} degrees with heading command type 3, whatever the heading; the vehicle flies along {:.0}",
            course.to_degrees().rem_euclid(360.0),
            flown.to_degrees().rem_euclid(360.0)
        )
    })
}

fn a_part_acts_and_the_rest_stays(t: &Trial) -> Judged {
    let a = airborne(t)?;
    let home = home(t, &a)?;
    let mut plan = Plan::zigzag(&home, "PARTS", &[1, 2]);
    stretch(&home, &mut plan, 900.0);
    loaded(t, &a, &plan)?;
    let higher = |from: f64, kind: i64| {
        Draft::new(2016)
            .raw("Altitude Command Type", 1)
            .set("Commanded Altitude", from + 25.0)
            .raw("Altitude Type", kind)
            .acked()
    };
    a.send(mode_command(mode::WAYPOINT).acked());
    if mode_becomes(&a, mode::WAYPOINT, t.timers().begin)? {
        let low = fix(t, &a)?;
        let sent = a.send(higher(low.altitude, low.altitude_type));
        if refused(t, &a, &sent) {
            t.note("an altitude alone is refused on a route");
        } else {
            let up = fly_until(t, &a, t.timers().begin, |fix| {
                fix.altitude > low.altitude + 12.0
            })?;
            t.expect(up.is_some(), || {
                "expected a 2016 with an altitude alone, accepted on a route, to change the altitude by 25 m; it did not".into()
            })?;
        }
    }
    hold(t, &a)?;
    // In mode 15 the turn to the commanded heading continues.
    let now = fix(t, &a)?;
    let Some(heading) = now.heading else {
        return Ok(());
    };
    let target = wrapped(heading + TAU / 2.2);
    let sent = a.send(
        mode_command(mode::AUTOPILOT)
            .raw("Heading Command Type", 1)
            .set("Commanded Heading", target)
            .raw("Altitude Command Type", 0)
            .acked(),
    );
    // Before the turn has ended, however fast the simulation is.
    t.pause(Duration::from_millis(60))?;
    a.send(higher(now.altitude - 15.0, now.altitude_type));
    if refused(t, &a, &sent) || !mode_becomes(&a, mode::AUTOPILOT, t.timers().begin)? {
        return Ok(());
    }
    let reached = fly_until(t, &a, t.timers().begin, |fix| {
        fix.heading
            .is_some_and(|heading| wrapped(heading - target).abs() < 0.26)
    })?;
    hold(t, &a)?;
    t.expect(reached.is_some(), || {
        format!("expected a 2016 with an altitude alone to leave the commanded heading of {:.0} degrees; it is not reached", target.to_degrees().rem_euclid(360.0))
    })?;
    the_later_2016_stays(t, &a)?;
    a_speed_alone_is_flown(t, &a)
}

/// In mode 15, on a course: a commanded speed alone is flown.
fn a_speed_alone_is_flown(t: &Trial, a: &Station) -> Judged {
    let heading = fix(t, a)?.heading.unwrap_or_default();
    let sent = a.send(
        mode_command(mode::AUTOPILOT)
            .raw("Heading Command Type", 2)
            .set("Commanded Course", heading)
            .raw("Altitude Command Type", 0)
            .set("Commanded Speed", 9.0)
            .raw("Speed Type", 2)
            .acked(),
    );
    if refused(t, a, &sent) || !mode_becomes(a, mode::AUTOPILOT, t.timers().begin)? {
        return Ok(());
    }
    let speed = t.bench.profile.figures.speed_factor.max(1.0);
    let settled = Duration::from_secs_f64((6.0 / speed).max(0.6));
    t.pause(settled)?;
    let fast = fix(t, a)?;
    let alone = Draft::new(2016)
        .set("Commanded Speed", 4.0)
        .raw("Speed Type", 2)
        .acked();
    let sent = a.send(alone);
    let taken = !refused(t, a, &sent);
    let pace = |fix: &Fix| fix.north.hypot(fix.east);
    let slower = fly_until(t, a, t.timers().begin / 2, |fix| pace(fix) < 6.0)?;
    hold(t, a)?;
    if !taken || pace(&fast) < 7.0 {
        t.note("a speed alone in mode 15 is not judged");
        return Ok(());
    }
    t.expect(slower.is_some(), || {
        format!("expected a 2016 with a speed of 4 m/s alone, accepted in mode 15 at {:.1} m/s, to be flown; the vehicle is not slower", pace(&fast))
    })
}

/// Of two speeds the one with the later stamp counts, whichever arrives last.
fn the_later_2016_stays(t: &Trial, a: &Station) -> Judged {
    let speed = |speed: f64| {
        Draft::new(2016)
            .set("Commanded Speed", speed)
            .raw("Speed Type", 2)
    };
    let overtaken = a.encode(&a.stamped(speed(4.0)));
    t.pause(Duration::from_millis(30))?;
    let late = field(&speed(7.0), "Commanded Speed");
    a.send(speed(7.0));
    t.pause(t.timers().answer / 4)?;
    if a.query(3002)?.raw("Commanded Speed") != late {
        t.note("3002 does not show a speed alone: a 2016 that was overtaken is not judged");
        return Ok(());
    }
    a.send_bytes(&overtaken);
    t.pause(t.timers().quiet / 3)?;
    let shown = a.query(3002)?;
    let named = shown.raw("Commanded Speed");
    t.expect_beside(&shown, named == late, || {
        format!("expected a 2016 that a later one has overtaken not to undo it; 3002 shows the speed {named:?}, expected {late:?} (as on the wire)")
    })
}

/// Tried in flight, where only the value itself can be the reason of a refusal.
fn values_of_2016_work_or_are_listed(t: &Trial) -> Judged {
    if !t.may_fly() {
        return Ok(());
    }
    let Ok(a) = airborne(t) else { return Ok(()) };
    let listed_by = full(t, &a, 3).precondition("a full configuration")?;
    let now = fix(t, &a)?;
    let number = |name: &str| {
        let info = Draft::new(2016).seen().info;
        let field = info.and_then(|info| info.field(name));
        field.map_or(0, |field| i64::from(field.bit) + 1)
    };
    let speed = |kind: i64| {
        Draft::new(2016)
            .set("Commanded Speed", 6.0)
            .raw("Speed Type", kind)
    };
    let altitude = |kind: i64| {
        let of_type = |value: f64| {
            Draft::new(2016)
                .raw("Altitude Command Type", 1)
                .set("Commanded Altitude", value)
                .raw("Altitude Type", kind)
        };
        levels(t, &now, kind).into_iter().map(of_type).collect()
    };
    let speed = |kind: i64| vec![speed(kind)];
    type Make<'a> = &'a dyn Fn(i64) -> Vec<Draft>;
    let cases: [(&str, std::ops::RangeInclusive<i64>, Make<'_>); 2] = [
        ("Speed Type", 0..=3, &speed),
        ("Altitude Type", 0..=3, &altitude),
    ];
    let mut result = Ok(());
    for (field, values, make) in cases {
        let listed = availability(&listed_by, 2016, number(field));
        for value in values {
            // A type counts as refused where each of its values is refused.
            let mut last = None;
            for draft in make(value) {
                let sent = a.send(draft.acked());
                last = a.wait(sent.mark, t.timers().ack * 2, |seen| {
                    about(seen, 2016, sent.stamp) && seen.raw("Acknowledgement Type") != Some(1)
                });
                if last
                    .as_ref()
                    .is_none_or(|end| end.raw("Acknowledgement Type") != Some(3))
                {
                    break;
                }
            }
            let Some(end) = last else { continue };
            let no = end.raw("Acknowledgement Type") == Some(3);
            if result.is_ok() {
                result = t.expect_beside(&end, no == listed.contains(&value), || {
                    if no {
                        format!("expected {field} {value} of 2016 to be listed by 44003, since it is refused; it is not")
                    } else {
                        format!("expected {field} {value} of 2016, which 44003 lists as unavailable, to be refused; it was carried out")
                    }
                });
            }
        }
    }
    hold(t, &a)?;
    result
}

/// Altitudes of this type that may be where the vehicle is, to be tried in turn: a single one where its datum is
/// known. The others differ from 4000's by an unknown amount, up to 107 m (the geoid above the ellipsoid). They are
/// tried on a simulated vehicle only, around the number in 4000, so that one of them is near the vehicle.
fn levels(t: &Trial, now: &Fix, kind: i64) -> Vec<f64> {
    let home = t.bench.home.get();
    let above_home = home.map_or(0.0, |home| now.altitude - home.altitude);
    let vehicle = t.bench.profile.vehicle.first();
    match kind {
        2 => vec![above_home],
        _ if kind == now.altitude_type => vec![now.altitude],
        1 if let Some(amsl) = vehicle.and_then(|vehicle| vehicle.amsl_m) => vec![amsl + above_home],
        _ if t.is_simulated() => {
            // Above first: away from the ground.
            [0.0, 45.0, 90.0, -45.0, -90.0]
                .map(|up| now.altitude + up)
                .to_vec()
        }
        _ => vec![],
    }
}

/// Judges nothing: it makes a climb and two turns for the judge that compares 3009 and 4000.
fn climbs_and_turns_are_reported_alike(t: &Trial) -> Judged {
    if !t.may_fly() {
        return Ok(());
    }
    let Ok(a) = airborne(t) else { return Ok(()) };
    let now = fix(t, &a)?;
    let speed = t.bench.profile.figures.speed_factor.max(1.0);
    for up in [25.0, 0.0] {
        a.send(
            Draft::new(2016)
                .raw("Altitude Command Type", 1)
                .set("Commanded Altitude", now.altitude + up)
                .raw("Altitude Type", now.altitude_type),
        );
        t.pause(Duration::from_secs_f64((3.0 / speed).max(0.4)))?;
        for _ in 0..3 {
            a.query(4000)?;
            a.query(3009)?;
        }
    }
    a.send(schedule(
        4000,
        t.bench.profile.figures.largest_rate_hz.min(10),
    ));
    let Some(heading) = fix(t, &a)?.heading else {
        return Ok(());
    };
    for part in [0.45, 0.9, 0.45] {
        a.send(
            mode_command(mode::AUTOPILOT)
                .raw("Heading Command Type", 2)
                .set("Commanded Course", wrapped(heading + part * TAU))
                .raw("Altitude Command Type", 0)
                .set("Commanded Speed", 8.0)
                .raw("Speed Type", 2),
        );
        t.pause(Duration::from_secs_f64((8.0 / speed).max(0.8)))?;
        a.query(3009)?;
    }
    a.send(schedule(4000, 0));
    hold(t, &a)?;
    Ok(())
}
