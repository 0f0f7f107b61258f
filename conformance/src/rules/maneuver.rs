//! Finer points of flight: turn types, loops, default rates, speed types.

use std::time::Duration;

use super::acknowledgement::about;
use super::scene::Scene;
use crate::bench::flight::{
    Plan, airborne, fix, fly_until, hold, home, load, loaded, mode, mode_becomes, mode_command,
    wrapped,
};
use crate::bench::station::Station;
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
        rule: "MODE-007",
        play: zero_rate_means_the_default,
    },
];

fn to_number(a: &Station) -> Judged<Option<i64>> {
    Ok(a.query(4001)?.raw("To Waypoint Number"))
}

/// The smallest distance of the track from the second of three waypoints, with this turn type there.
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
    a.send(
        mode_command(mode::WAYPOINT)
            .raw("Commanded Waypoint Number", 1)
            .acked(),
    );
    if !mode_becomes(a, mode::WAYPOINT, t.timers().begin)? {
        return Err(Stop::inconclusive("mode 11 was not entered"));
    }
    let (latitude, longitude) = home.offset(corners[1].0, corners[1].1);
    let mut closest = f64::MAX;
    let deadline = t.bench.net.now() + t.timers().flight.div_f64(2.0);
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
    // Between two positions of a fast simulation lies this much.
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
    // The end of a loop names its beginning as next.
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
    a.send(
        mode_command(mode::WAYPOINT)
            .raw("Commanded Waypoint Number", 1)
            .acked(),
    );
    if !mode_becomes(&a, mode::WAYPOINT, t.timers().begin)? {
        return Err(Stop::inconclusive("mode 11 was not entered"));
    }
    let mut order: Vec<i64> = Vec::new();
    let deadline = t.bench.net.now() + t.timers().flight;
    while t.bench.net.now() < deadline && order.last() != Some(&4) {
        if let Some(number) = to_number(&a)?.filter(|number| (1..=4).contains(number))
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
