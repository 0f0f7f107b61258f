//! Finer points of flight (rules of ROUTE and MODE): turn types, loops, numbers with gaps, default rates, speed
//! types.

use std::time::Duration;

use super::mission::aboard;
use super::scene::Scene;
use crate::bench::flight::{
    Fix, Plan, airborne, clear, fix, fly_from, fly_until, hold, home, load, loaded, mode,
    mode_becomes, mode_command, reported_mode, to_number, wrapped,
};
use crate::bench::station::Station;
use crate::bench::station::about;
use crate::bench::trial::Trial;
use crate::verdict::{Judged, Stop};

pub(super) const SCENES: &[Scene] = &[
    Scene {
        rule: "ROUTE-017",
        play: turn_type,
    },
    Scene {
        rule: "ROUTE-021",
        play: loops_by_limit_type_and_count,
    },
    Scene {
        rule: "ROUTE-004",
        play: numbers_need_not_be_contiguous,
    },
    Scene {
        rule: "MODE-007",
        play: zero_rate_means_the_default,
    },
    Scene {
        rule: "MODE-008",
        play: speed_types,
    },
];

/// Fails unless the positions lie on a circle and go round it in this direction: 1 clockwise, -1 counter-clockwise. A
/// vehicle that can only hover stays at the place itself.
pub(super) fn circled(
    t: &Trial,
    fixes: &[Fix],
    place: (f64, f64),
    radius: f64,
    way: f64,
    what: &str,
) -> Judged {
    let from_place: Vec<(f64, f64)> = fixes.iter().map(|fix| fix.from(place.0, place.1)).collect();
    let mut far: Vec<f64> = from_place
        .iter()
        .map(|(north, east)| north.hypot(*east))
        .collect();
    if far.len() < 8 {
        t.note(format!("too few positions to judge the circle of {what}"));
        return Ok(());
    }
    let turned: f64 = from_place
        .windows(2)
        .map(|pair| wrapped(pair[1].1.atan2(pair[1].0) - pair[0].1.atan2(pair[0].0)))
        .sum();
    far.sort_by(f64::total_cmp);
    let median = far[far.len() / 2];
    if median < 12.0 {
        t.note(format!("the vehicle hovers at {what}"));
        return Ok(());
    }
    t.expect((median - radius).abs() <= 0.25 * radius + 5.0, || {
        format!("expected {what} to be flown at {radius:.0} m from its place, got {median:.0} m")
    })?;
    t.expect(turned * way > 0.5 || turned.abs() < 0.5, || {
        let (expected, got) = if way > 0.0 {
            ("clockwise", "counter-clockwise")
        } else {
            ("counter-clockwise", "clockwise")
        };
        format!("expected {what} to be flown {expected}, it is flown {got}")
    })
}

fn numbers_need_not_be_contiguous(t: &Trial) -> Judged {
    let grounded = !t
        .bench
        .flight_released
        .load(std::sync::atomic::Ordering::SeqCst);
    let a = if grounded {
        t.controller()?
    } else {
        airborne(t).or_else(|_| t.controller())?
    };
    let home = home(t, &a)?;
    clear(t, &a)?;
    let numbers = [10, 40, 20, 65_534];
    let mut plan = Plan::zigzag(&home, "GAPS", &numbers);
    for point in &mut plan.points {
        *point = point.clone().set("Waypoint to Speed", 8.0);
    }
    let found = load(t, &a, &plan)?;
    t.expect(found.status == Some(1), || {
        format!(
            "expected 14000 status 1 for waypoints 10, 40, 20, 65534; got {:?}",
            found.status
        )
    })?;
    aboard(t, &a, &plan, "with its own numbers")?;
    if grounded {
        return Ok(());
    }
    // Flown from its start, by Next Waypoint.
    a.send(crate::bench::station::schedule(
        4001,
        t.bench.profile.figures.largest_rate_hz.min(10),
    ));
    let sent = a.send(mode_command(mode::WAYPOINT).acked());
    if !mode_becomes(&a, mode::WAYPOINT, t.timers().begin)? {
        t.note("mode 11 was not entered: the order is not flown");
        return Ok(());
    }
    let order = || -> Vec<i64> {
        let mut order: Vec<i64> = a
            .received(sent.mark, |seen| seen.kind() == 4001)
            .iter()
            .filter_map(|seen| seen.raw("To Waypoint Number"))
            .filter(|number| ![0, 65_535].contains(number))
            .collect();
        order.dedup();
        order
    };
    let deadline = t.bench.net.now() + t.timers().flight.div_f64(2.0);
    while t.bench.net.now() < deadline
        && order().last() != numbers.last()
        && reported_mode(&a)? == Some(mode::WAYPOINT)
    {
        t.pause(Duration::from_millis(200))?;
    }
    let flown = order();
    hold(t, &a)?;
    // A fast simulation may pass a waypoint between two reports, but none is reached before its turn.
    let places: Vec<usize> = flown
        .iter()
        .filter_map(|number| numbers.iter().position(|other| other == number))
        .collect();
    let rising = places.windows(2).all(|pair| pair[0] < pair[1]);
    if flown.len() < 2 {
        t.note("too few of its waypoints were seen to judge the order in which the route is flown");
    }
    t.expect(rising, || {
        format!("expected the route to be flown as 10, 40, 20, 65534, by Next Waypoint from its start; 4001 showed To {flown:?}")
    })
}

/// The ground speed that is flown at a commanded 10 m/s of this type, in the direction of the wind.
fn flown_at(t: &Trial, a: &Station, kind: i64, course: f64) -> Judged<Option<f64>> {
    let sent = a.send(
        mode_command(mode::AUTOPILOT)
            .raw("Heading Command Type", 2)
            .set("Commanded Course", course)
            .raw("Altitude Command Type", 0)
            .set("Commanded Speed", 10.0)
            .raw("Speed Type", kind)
            .acked(),
    );
    let refused = a.wait(sent.mark, t.timers().ack * 2, |seen| {
        about(seen, 2016, sent.stamp) && seen.raw("Acknowledgement Type") == Some(3)
    });
    if refused.is_some() || !mode_becomes(a, mode::AUTOPILOT, t.timers().begin)? {
        return Ok(None);
    }
    let speed = t.bench.profile.figures.speed_factor.max(1.0);
    t.pause(Duration::from_secs_f64((12.0 / speed).max(1.2)))?;
    let now = fix(t, a)?;
    Ok(Some(now.north.hypot(now.east)))
}

fn speed_types(t: &Trial) -> Judged {
    let a = airborne(t)?;
    let air = a.query(3009).ok();
    let wind = |name: &str| air.as_ref().and_then(|seen| seen.value(name));
    let (north, east) = (
        wind("U_Wind").unwrap_or_default(),
        wind("V_Wind").unwrap_or_default(),
    );
    let (blows, course) = (north.hypot(east), east.atan2(north));
    let over_ground = flown_at(t, &a, 2, course)?;
    let through_air = flown_at(t, &a, 1, course)?;
    // Without wind, airspeed and ground speed are the same: indicated airspeed is tried in a wind only.
    let indicated = if blows > 2.5 {
        flown_at(t, &a, 0, course)?
    } else {
        None
    };
    hold(t, &a)?;
    let Some(over_ground) = over_ground else {
        return Err(Stop::not_applicable(
            "mode 15 with a commanded ground speed is refused",
        ));
    };
    if over_ground < 0.5 {
        return Err(Stop::inconclusive(
            "the vehicle does not move in mode 15 with a commanded course and speed",
        ));
    }
    t.expect((over_ground - 10.0).abs() <= 2.5, || {
        format!("expected 10 m/s over the ground for a commanded speed of 10 m/s of type 2 (ground), 4000 shows {over_ground:.1} m/s")
    })?;
    if through_air.is_none() {
        t.note("airspeeds are refused");
    }
    for (what, flown) in [("true", through_air), ("indicated", indicated)] {
        t.expect(flown.is_none_or(|flown| (flown - 10.0 - blows).abs() <= 2.5), || {
            format!("expected {:.1} m/s over the ground for {what} airspeed of 10 m/s with {blows:.1} m/s of wind from behind, 4000 shows {:.1} m/s", 10.0 + blows, flown.unwrap_or_default())
        })?;
    }
    Ok(())
}

/// The smallest distance, in metres, of the track from the second of three waypoints, with this turn type there.
fn closest(t: &Trial, a: &Station, turn: i64) -> Judged<f64> {
    let home = home(t, a)?;
    let mut plan = Plan::zigzag(&home, &format!("TURN{turn}"), &[1, 2, 3]);
    let corners = [(60.0, 0.0), (60.0, 90.0), (-30.0, 90.0)];
    for (point, (north, east)) in plan.points.iter_mut().zip(corners) {
        let (latitude, longitude) = home.offset(north, east);
        *point = point
            .clone()
            .set("Waypoint to Latitude or Relative Y", latitude)
            .set("Waypoint to Longitude or Relative X", longitude)
            .raw("Turn Type", turn);
    }
    loaded(t, a, &plan)?;
    fly_from(t, a, 1)?;
    let (latitude, longitude) = home.offset(corners[1].0, corners[1].1);
    let mut closest = f64::MAX;
    // The rule before may have left the vehicle far away or high up.
    let deadline = t.bench.net.now() + t.timers().flight;
    while t.bench.net.now() < deadline {
        closest = closest.min(fix(t, a)?.distance(latitude, longitude));
        if to_number(a)? == Some(3)
            && closest < 40.0
            && fix(t, a)?.distance(latitude, longitude) > closest + 15.0
        {
            break;
        }
    }
    hold(t, a)?;
    Ok(closest)
}

fn turn_type(t: &Trial) -> Judged {
    let a = airborne(t)?;
    a.send(crate::bench::station::schedule(
        4000,
        t.bench.profile.figures.largest_rate_hz.min(10),
    ));
    let over = closest(t, &a, 1)?;
    let speed = t.bench.profile.figures.speed_factor.max(1.0);
    // The distance that a fast simulation flies between two positions.
    let blind = 8.0 * speed / f64::from(t.bench.profile.figures.largest_rate_hz.max(1));
    t.expect(over <= 10.0 + blind, || format!("expected the track to pass over the waypoint with turn type 1, its smallest distance was {over:.0} m"))
}

fn loops_by_limit_type_and_count(t: &Trial) -> Judged {
    let a = airborne(t)?;
    let home = home(t, &a)?;
    let mut plan = Plan::zigzag(&home, "LOOP", &[1, 2, 3, 4]);
    for (point, (north, east)) in
        plan.points
            .iter_mut()
            .zip([(20.0, 0.0), (40.0, 0.0), (40.0, 30.0), (20.0, 40.0)])
    {
        let (latitude, longitude) = home.offset(north, east);
        *point = point
            .clone()
            .set("Waypoint to Latitude or Relative Y", latitude)
            .set("Waypoint to Longitude or Relative X", longitude);
    }
    for point in &mut plan.points {
        *point = point.clone().set("Waypoint to Speed", 8.0);
    }
    // The last waypoint of a loop names its first one as next.
    plan.points[2] = plan.points[2]
        .clone()
        .raw("Waypoint Type", 1)
        .raw("Next Waypoint", 2)
        .raw("Limit Type", 1)
        .raw("Loop Limit", 2);
    let found = load(t, &a, &plan)?;
    if found.status != Some(1) {
        t.note("a route with a loop is refused");
        return Ok(());
    }
    fly_from(t, &a, 1)?;
    let mut order: Vec<i64> = Vec::new();
    let deadline = t.bench.net.now() + t.timers().flight;
    while t.bench.net.now() < deadline && order.last() != Some(&4) {
        let to = to_number(&a)?.filter(|number| (1..=4).contains(number));
        if to.is_none() && !order.is_empty() && reported_mode(&a)? != Some(mode::WAYPOINT) {
            // The route is flown to its end, which may be that of the last loop.
            break;
        }
        if let Some(number) = to
            && order.last() != Some(&number)
        {
            order.push(number);
        }
        t.expect(order.len() < 14, || {
            format!("expected a loop to end by its limit of 2; 4001 showed To {order:?}")
        })?;
        t.pause(Duration::from_millis(50))?;
    }
    hold(t, &a)?;
    t.note(format!("To waypoints: {order:?}"));
    let loops = order.iter().filter(|number| **number == 3).count();
    t.expect(loops >= 2, || {
        format!("expected waypoints 2 and 3 again, as the loop says; 4001 showed To {order:?}")
    })
}

fn zero_rate_means_the_default(t: &Trial) -> Judged {
    let a = airborne(t)?;
    let began = fix(t, &a)?;
    let Some(heading) = began.heading else {
        return Err(Stop::inconclusive("4000 has no heading"));
    };
    let target = wrapped(heading + std::f64::consts::FRAC_PI_2);
    let sent = a.send(
        mode_command(mode::AUTOPILOT)
            .raw("Heading Command Type", 1)
            .set("Commanded Heading", target)
            .raw("Commanded Turn Rate", 0)
            .raw("Altitude Command Type", 0)
            .acked(),
    );
    let refused = a.wait(sent.mark, t.timers().answer, |seen| {
        about(seen, 2016, sent.stamp) && seen.raw("Acknowledgement Type") == Some(3)
    });
    if refused.is_some() {
        return Err(Stop::not_applicable(
            "mode 15 with a commanded heading is refused",
        ));
    }
    let reached = fly_until(t, &a, t.timers().flight.div_f64(4.0), |fix| {
        fix.heading
            .is_some_and(|heading| wrapped(heading - target).abs() < 0.2)
    })?;
    hold(t, &a)?;
    t.expect(reached.is_some(), || format!("expected the heading {:.0} degrees with a turn rate of 0, which means the vehicle's own", target.to_degrees()))
}
