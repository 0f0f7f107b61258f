//! SCALAR: angles, integers of three bytes, ranges and signs of values.

use std::time::Duration;

use super::acknowledgement::carried_out;
use super::scene::Scene;
use crate::bench::flight::{
    Fix, Plan, clear, difference, download, fix, fly_until, hold, home, load, mode, mode_becomes,
    mode_command, waypoint, wrapped,
};
use crate::bench::trial::Trial;
use crate::verdict::{Judged, Precondition, Stop};
use crate::wire::Draft;
use crate::wire::dialect::places::has_field;

pub(super) const SCENES: &[Scene] = &[
    Scene {
        rule: "SCALAR-003",
        play: angles_are_twos_complement,
    },
    Scene {
        rule: "SCALAR-004",
        play: three_byte_integers_and_their_steps,
    },
    Scene {
        rule: "SCALAR-007",
        play: values_out_of_range_are_not_used,
    },
    Scene {
        rule: "SCALAR-008",
        play: bearings_from_true_north,
    },
    Scene {
        rule: "SCALAR-009",
        play: turn_rate_keeps_its_scale,
    },
];

/// Whether a plan came back as it was sent; false where it was refused.
fn returns(t: &Trial, a: &crate::bench::station::Station, plan: &Plan, what: &str) -> Judged<bool> {
    clear(t, a)?;
    let loaded = load(t, a, plan)?;
    if loaded.status != Some(1) {
        return Ok(false);
    }
    let found = download(t, a, &plan.mission)?;
    match difference(plan, &found, &t.bench) {
        None => Ok(true),
        Some(difference) => Err(Stop::fail(format!(
            "expected {what} to come back by download unchanged; {difference}"
        ))),
    }
}

fn angles_are_twos_complement(t: &Trial) -> Judged {
    let a = t.controller()?;
    let now = fix(t, &a)?;
    t.expect(now.latitude.abs() <= std::f64::consts::FRAC_PI_2, || {
        format!(
            "expected a latitude of -90 to 90 degrees in 4000, got {:.3}",
            now.latitude.to_degrees()
        )
    })?;
    let home = home(t, &a)?;
    let mut plan = Plan::zigzag(&home, "ANGLES", &[1, 2]);
    returns(t, &a, &plan, "a plan near home")?;
    // West and south; most vehicles refuse these as too far away, which 14000 then reports.
    for (north, east) in [(-0.5, -3.1413), (1.55, -2.0)] {
        plan.points = vec![
            waypoint(
                &Fix {
                    latitude: north,
                    longitude: east,
                    ..home
                },
                1,
                2,
                north,
                east,
                50.0,
            ),
            waypoint(&home, 2, 0, north + 1e-5, east + 1e-6, 50.0),
        ];
        if !returns(t, &a, &plan, "a waypoint in the western hemisphere")? {
            t.note(
                "a route in the western hemisphere is refused, since it is far from the vehicle",
            );
        }
    }
    Ok(())
}

fn three_byte_integers_and_their_steps(t: &Trial) -> Judged {
    let a = t.controller()?;
    let home = home(t, &a)?;
    let mut accepted = 0;
    for up in [
        50.02,
        51.98,
        -500.0 - home.altitude,
        4_999.98 - home.altitude,
        20_000.0 - home.altitude,
    ] {
        let mut plan = Plan::zigzag(&home, "STEPS", &[1, 2]);
        plan.points[0] = plan.points[0]
            .clone()
            .set("Waypoint to Altitude", home.altitude + up);
        accepted += usize::from(returns(
            t,
            &a,
            &plan,
            &format!("a waypoint at {:.2} m", home.altitude + up),
        )?);
    }
    t.expect(accepted > 0, || {
        "expected a waypoint 50 m above the vehicle to be accepted".into()
    })?;
    let claim = t
        .bench
        .profile
        .vehicle
        .first()
        .and_then(|vehicle| Some((vehicle.amsl_m?, vehicle.geoid_m)));
    if let Some((amsl, geoid)) = claim {
        let expected = match home.altitude_type {
            3 => amsl + geoid.unwrap_or_default(),
            2 => 0.0,
            _ => amsl,
        };
        let tolerance = if geoid.is_none() && home.altitude_type == 3 {
            110.0
        } else {
            10.0
        };
        t.expect((home.altitude - expected).abs() < tolerance, || format!("expected an altitude near {expected:.0} m (type {}), got {:.1} m; a step other than 0.02 m gives such values", home.altitude_type, home.altitude))?;
    }
    Ok(())
}

fn values_out_of_range_are_not_used(t: &Trial) -> Judged {
    let a = t.controller()?;
    t.expect(a.commands_work()?, || {
        "expected 2017 of the holder in 3004".into()
    })
    .precondition("commands work")?;
    let cases = [
        (
            "loiter type 200",
            Draft::new(2017).raw("Loiter Type", 200),
            3004,
            "Loiter Type",
            200,
        ),
        (
            "loiter direction 9",
            Draft::new(2017).raw("Loiter Direction", 9),
            3004,
            "Loiter Direction",
            9,
        ),
        (
            "loiter radius 0",
            Draft::new(2017).raw("Loiter Radius", 0),
            3004,
            "Loiter Radius",
            0,
        ),
        (
            "altitude type 9",
            Draft::new(2016)
                .raw("Altitude Command Type", 1)
                .set("Commanded Altitude", 77.0)
                .raw("Altitude Type", 9),
            3002,
            "Altitude Type",
            9,
        ),
        (
            "heading command type 9",
            Draft::new(2016).raw("Heading Command Type", 9),
            3002,
            "Heading Command Type",
            9,
        ),
        (
            "altitude command type 9",
            Draft::new(2016)
                .raw("Altitude Command Type", 9)
                .set("Commanded Altitude", 77.0),
            3002,
            "Altitude Command Type",
            9,
        ),
        (
            "speed type 9",
            Draft::new(2016)
                .set("Commanded Speed", 7.0)
                .raw("Speed Type", 9),
            3002,
            "Speed Type",
            9,
        ),
        (
            "a loiter latitude beyond 90 degrees",
            mode_command(mode::LOITER)
                .set("Loiter Position Latitude", 1.7)
                .set("Loiter Position Longitude", 0.1),
            3002,
            "Commanded Loiter Position Latitude",
            (1.7 / (std::f64::consts::PI / 2_f64.powi(31))).round() as i64,
        ),
    ];
    for (what, draft, report, field, value) in cases {
        if t.of_edition_25() && !has_field(report, field) {
            t.note(format!(
                "{what} was not tried: Edition 2.5 reports no {field}"
            ));
            continue;
        }
        let sent = a.send(draft.acked());
        let done = carried_out(t, &a, &sent, t.timers().quiet)?;
        // A radius of 0 may mean the vehicle's default.
        if value == 0 {
            if done.is_some() {
                t.warn(format!("{what} is carried out"));
            }
            continue;
        }
        if let Some(done) = done {
            t.expect_of(&done, false, || {
                format!("expected {what} not to be carried out; 17000 type 2 came")
            })?;
        }
        let shown = a.query(report)?;
        t.expect_of(&shown, shown.raw(field) != Some(value), || {
            format!("expected {what} not to be used; {report} shows it")
        })?;
    }
    t.expect(a.commands_work()?, || {
        "expected the next good 2017 to work".into()
    })
}

fn bearings_from_true_north(t: &Trial) -> Judged {
    let a = crate::bench::flight::airborne(t)?;
    let tracks = super::flight::tracks(t, &a)?;
    let mut compared = 0;
    for track in &tracks {
        if track.distance < 10.0 {
            continue;
        }
        // A multicopter may fly sideways; then its course does not show its heading.
        let Some(heading) = track.heading else {
            continue;
        };
        compared += 1;
        let off = wrapped(heading - track.course).to_degrees();
        let half = wrapped(heading - track.course / 2.0).to_degrees();
        let hint = if half.abs() < 3.0 && off.abs() > 10.0 {
            "; half of it fits, so the step of the angle is wrong"
        } else {
            ""
        };
        t.expect(off.abs() <= 10.0, || {
            format!(
                "expected a heading within 10 degrees of the course {:.0}; 4000 shows {:.0}{hint}",
                track.course.to_degrees(),
                heading.to_degrees()
            )
        })?;
    }
    if compared == 0 {
        return Err(Stop::inconclusive(
            "no leg was long enough to compare heading and course",
        ));
    }
    Ok(())
}

fn turn_rate_keeps_its_scale(t: &Trial) -> Judged {
    let a = crate::bench::flight::airborne(t)?;
    let sent = a.send(
        mode_command(mode::AUTOPILOT)
            .raw("Heading Command Type", 5)
            .raw("Commanded Turn Rate", 500)
            .raw("Altitude Command Type", 0)
            .acked(),
    );
    let refused = a.wait(sent.mark, t.timers().answer, |seen| {
        seen.kind() == 17000 && seen.raw("Acknowledgement Type") == Some(3)
    });
    if refused.is_some() {
        return Err(Stop::not_applicable(
            "the vehicle refuses a commanded turn rate",
        ));
    }
    mode_becomes(&a, mode::AUTOPILOT, t.timers().begin)?;
    let deadline = t.bench.net.now() + t.timers().answer;
    let mut states = a.query(3002)?;
    while states.raw("Commanded Turn Rate") != Some(500) && t.bench.net.now() < deadline {
        t.pause(Duration::from_millis(100))?;
        states = a.query(3002)?;
    }
    let found = states.raw("Commanded Turn Rate");
    t.expect_beside(&states, found == Some(500), || {
        format!("expected the raw turn rate 500 in 3002, got {found:?}")
    })?;
    // The scale of the turn rate is disputed, the sign is not: positive is clockwise, in the heading and in 4000.
    a.send(crate::bench::station::schedule(
        4000,
        t.bench.profile.figures.largest_rate_hz.min(10),
    ));
    t.pause(Duration::from_millis(200))?;
    let mark = t.bench.net.mark();
    let began = fix(t, &a)?;
    let turned = |fix: &Fix| {
        began
            .heading
            .zip(fix.heading)
            .map_or(0.0, |(from, to)| wrapped(to - from))
    };
    let moved = fly_until(t, &a, t.timers().begin / 4, |fix| turned(fix).abs() > 0.8)?;
    let rates: Vec<i64> = a
        .received(mark, |seen| seen.kind() == 4000)
        .iter()
        .filter_map(|seen| seen.raw("Turn Rate"))
        .filter(|rate| *rate != 0)
        .collect();
    // Queried while it still turns: the body rates of 3010 have the same sign.
    let body = a.query(3010).ok();
    hold(t, &a)?;
    // Where a fast simulation may turn half a circle between two positions, the direction cannot be seen.
    let Some(moved) = moved.filter(|fix| turned(fix).abs() < 2.0) else {
        t.note("the way of the turn is not seen between two positions");
        return Ok(());
    };
    t.expect(turned(&moved) > 0.0, || {
        format!("expected a turn to the right at a commanded turn rate above 0; the heading went {:.0} degrees to the left", -turned(&moved).to_degrees())
    })?;
    if let Some(body) = body {
        let yaw = body.raw("Yaw_Rate").unwrap_or_default();
        let right = rates.iter().filter(|rate| **rate > 0).count();
        t.expect_of(&body, yaw >= 0 || right * 2 < rates.len(), || {
            format!("expected a Yaw_Rate above 0 in 3010 in a level turn to the right, as the Turn Rate of 4000; it is {yaw} (as on the wire)")
        })?;
    }
    let left = rates.iter().filter(|rate| **rate < 0).count();
    t.expect(rates.len() < 4 || left * 2 < rates.len(), || {
        format!(
            "expected a Turn Rate above 0 in 4000 in a turn to the right; {left} of {} are below",
            rates.len()
        )
    })
}
