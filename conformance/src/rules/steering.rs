//! Commanded values in flight: which fields of 2016 count, and what partial commands and a handover leave unchanged.

use std::f64::consts::TAU;

use super::mission::aboard;
use super::scene::Scene;
use crate::bench::flight::{
    Plan, airborne, fix, fly_until, hold, home, loaded, mode, mode_becomes, mode_command,
    reported_mode, stretch, to_number, wrapped,
};
use crate::bench::station::Station;
use crate::bench::station::about;
use crate::bench::trial::Trial;
use crate::verdict::{Judged, Stop};
use crate::wire::Draft;

pub(super) const SCENES: &[Scene] = &[
    Scene {
        rule: "MODE-006",
        play: steering_obeys_the_command_types,
    },
    Scene {
        rule: "MODE-015",
        play: a_part_commands_that_part,
    },
    Scene {
        rule: "HAND-006",
        play: the_flight_continues_through_a_handover,
    },
];

fn steering_obeys_the_command_types(t: &Trial) -> Judged {
    let a = airborne(t)?;
    let began = fix(t, &a)?;
    // Course east, with a heading that must not count; altitude unchanged, with an altitude that must not count.
    let east = TAU / 4.0;
    let sent = a.send(
        mode_command(mode::AUTOPILOT)
            .raw("Heading Command Type", 2)
            .set("Commanded Course", east)
            .set("Commanded Heading", -east)
            .raw("Altitude Command Type", 0)
            .set("Commanded Altitude", began.altitude + 80.0)
            .raw("Altitude Type", began.altitude_type)
            .set("Commanded Speed", 8.0)
            .raw("Speed Type", 2)
            .acked(),
    );
    let refused = a.wait(sent.mark, t.timers().answer, |seen| {
        about(seen, 2016, sent.stamp) && seen.raw("Acknowledgement Type") == Some(3)
    });
    if refused.is_some() || !mode_becomes(&a, mode::AUTOPILOT, t.timers().begin)? {
        return Err(Stop::not_applicable(
            "mode 15 with a commanded course is refused",
        ));
    }
    // The motion from before the command fades first.
    let speed = t.bench.profile.figures.speed_factor.max(1.0);
    t.pause(std::time::Duration::from_secs_f64((6.0 / speed).max(0.6)))?;
    let climbed_from = began.altitude;
    let began = fix(t, &a)?;
    let moved = fly_until(t, &a, t.timers().begin, |fix| {
        fix.distance(began.latitude, began.longitude) > 40.0
    })?;
    let now = match moved {
        Some(now) => now,
        None => fix(t, &a)?,
    };
    let (north, east_m) = now.from(began.latitude, began.longitude);
    let climbed = now.altitude - climbed_from;
    hold(t, &a)?;
    t.expect(moved.is_some(), || {
        "expected the vehicle to move in mode 15 with a commanded course and speed; it did not"
            .into()
    })?;
    let course = east_m.atan2(north);
    t.expect(wrapped(course - east).abs() < 0.6, || {
        format!(
            "expected a course of 90 degrees, got {:.0}",
            course.to_degrees()
        )
    })?;
    t.expect(climbed < 25.0, || format!("expected altitude command type 0 to leave the altitude alone; the vehicle climbed {climbed:.0} m"))?;
    let pace = now.north.hypot(now.east);
    t.expect((4.0..12.0).contains(&pace), || {
        format!("expected a ground speed of 8 m/s as commanded, 4000 shows {pace:.1} m/s")
    })?;
    heading_alone(t, &a)?;
    altitude_alone(t, &a)?;
    climb_by_speed(t, &a)
}

/// Altitude command type 1 holds the altitude, whatever vertical speed the message has.
fn altitude_alone(t: &Trial, a: &Station) -> Judged {
    let began = fix(t, a)?;
    let sent = a.send(
        mode_command(mode::AUTOPILOT)
            .raw("Altitude Command Type", 1)
            .set("Commanded Altitude", began.altitude + 15.0)
            .raw("Altitude Type", began.altitude_type)
            .set("Commanded Vertical Speed", -1.5)
            .acked(),
    );
    let refused = a.wait(sent.mark, t.timers().ack * 2, |seen| {
        about(seen, 2016, sent.stamp) && seen.raw("Acknowledgement Type") == Some(3)
    });
    if refused.is_some() {
        t.note("mode 15 with an altitude is refused");
        return Ok(());
    }
    let moved = fly_until(t, a, t.timers().begin, |fix| {
        (fix.altitude - began.altitude).abs() > 9.0
    })?;
    hold(t, a)?;
    let by = moved.map_or(0.0, |fix| fix.altitude - began.altitude);
    t.expect(by > 0.0, || {
        format!("expected a climb of 15 m in mode 15 with altitude command type 1, whatever the vertical speed says; the altitude changed by {by:.0} m")
    })
}

/// Heading command type 1 turns to the heading, whatever course the message has.
fn heading_alone(t: &Trial, a: &Station) -> Judged {
    let began = fix(t, a)?;
    let Some(heading) = began.heading else {
        return Ok(());
    };
    let target = wrapped(heading + TAU / 3.0);
    let sent = a.send(
        mode_command(mode::AUTOPILOT)
            .raw("Heading Command Type", 1)
            .set("Commanded Heading", target)
            .set("Commanded Course", wrapped(target + TAU / 2.0))
            .raw("Altitude Command Type", 0)
            .acked(),
    );
    let refused = a.wait(sent.mark, t.timers().ack * 2, |seen| {
        about(seen, 2016, sent.stamp) && seen.raw("Acknowledgement Type") == Some(3)
    });
    if refused.is_some() {
        t.note("mode 15 with a commanded heading is refused");
        return Ok(());
    }
    let reached = fly_until(t, a, t.timers().begin, |fix| {
        fix.heading
            .is_some_and(|heading| wrapped(heading - target).abs() < 0.26)
    })?;
    hold(t, a)?;
    t.expect(reached.is_some(), || {
        format!(
            "expected a heading of {:.0} degrees with heading command type 1 and another course in its field; it is not reached",
            target.to_degrees().rem_euclid(360.0)
        )
    })
}

/// Altitude command type 2 climbs and descends by the vertical speed, whatever altitude the message has.
fn climb_by_speed(t: &Trial, a: &Station) -> Judged {
    for (up, what) in [(2.0, "climb"), (-1.5, "descend")] {
        let began = fix(t, a)?;
        let sent = a.send(
            mode_command(mode::AUTOPILOT)
                .raw("Altitude Command Type", 2)
                .set("Commanded Vertical Speed", up)
                .set(
                    "Commanded Altitude",
                    began.altitude - 30.0 * f64::signum(up),
                )
                .raw("Altitude Type", began.altitude_type)
                .acked(),
        );
        let refused = a.wait(sent.mark, t.timers().ack * 2, |seen| {
            about(seen, 2016, sent.stamp) && seen.raw("Acknowledgement Type") == Some(3)
        });
        if refused.is_some() {
            t.note("mode 15 with a vertical speed is refused");
            return Ok(());
        }
        let moved = fly_until(t, a, t.timers().begin, |fix| {
            (fix.altitude - began.altitude).abs() > 8.0
        })?;
        hold(t, a)?;
        let by = moved.map_or(0.0, |fix| fix.altitude - began.altitude);
        t.expect(by * up > 0.0, || {
            format!("expected the vehicle to {what} at {up} m/s with altitude command type 2, whatever the altitude field says; its altitude changed by {by:.0} m")
        })?;
    }
    Ok(())
}

fn a_part_commands_that_part(t: &Trial) -> Judged {
    let a = airborne(t)?;
    let began = fix(t, &a)?;
    a.send(
        Draft::new(2016)
            .raw("Altitude Command Type", 1)
            .set("Commanded Altitude", began.altitude + 20.0)
            .raw("Altitude Type", began.altitude_type)
            .acked(),
    );
    let reached = fly_until(t, &a, t.timers().flight.div_f64(3.0), |fix| {
        fix.altitude > began.altitude + 15.0 || fix.altitude < began.altitude - 15.0
    })?;
    let now = match reached {
        Some(now) => now,
        None => fix(t, &a)?,
    };
    let shown = reported_mode(&a)?;
    t.expect(shown == Some(mode::LOITER), || {
        format!("expected mode 12 to stay after a 2016 with an altitude only; 3001 shows {shown:?}")
    })?;
    t.expect(now.altitude > began.altitude + 15.0, || {
        format!(
            "expected a climb of 20 m after a 2016 with an altitude only, got {:.0} m",
            now.altitude - began.altitude
        )
    })?;
    t.expect(
        now.distance(began.latitude, began.longitude) < 200.0,
        || "expected the loiter place to stay after a 2016 with an altitude only".into(),
    )?;
    // And a speed alone.
    let altitude = a.query(3002)?.raw("Commanded Altitude");
    a.send(
        Draft::new(2016)
            .set("Commanded Speed", 6.0)
            .raw("Speed Type", 2)
            .acked(),
    );
    t.pause(t.timers().answer / 2)?;
    let shown = reported_mode(&a)?;
    t.expect(shown == Some(mode::LOITER), || {
        format!("expected mode 12 to stay after a 2016 with a speed only; 3001 shows {shown:?}")
    })?;
    let after = a.query(3002)?;
    t.expect_of(&after, after.raw("Commanded Altitude") == altitude, || {
        format!("expected the commanded altitude to stay {altitude:?} after a 2016 with a speed only; 3002 shows {:?}", after.raw("Commanded Altitude"))
    })?;
    // On a route as well.
    let home = home(t, &a)?;
    let mut plan = Plan::zigzag(&home, "PART", &[1, 2]);
    stretch(&home, &mut plan, 500.0);
    loaded(t, &a, &plan)?;
    a.send(mode_command(mode::WAYPOINT).acked());
    if !mode_becomes(&a, mode::WAYPOINT, t.timers().begin)? {
        return Ok(());
    }
    let to = to_number(&a)?;
    let low = fix(t, &a)?;
    a.send(
        Draft::new(2016)
            .raw("Altitude Command Type", 1)
            .set("Commanded Altitude", low.altitude + 20.0)
            .raw("Altitude Type", low.altitude_type)
            .acked(),
    );
    t.pause(t.timers().answer / 2)?;
    let (shown, still) = (reported_mode(&a)?, to_number(&a)?);
    hold(t, &a)?;
    t.expect(shown == Some(mode::WAYPOINT) && still == to, || {
        format!("expected mode 11 and To {to:?} to stay after a 2016 with an altitude only; 3001 shows {shown:?}, 4001 {still:?}")
    })
}

fn the_flight_continues_through_a_handover(t: &Trial) -> Judged {
    use crate::bench::station::{Access, loi};
    let a = airborne(t)?;
    let home = home(t, &a)?;
    let mut plan = Plan::zigzag(&home, "HANDOVER", &[1, 2, 3]);
    // So long that it does not end during the handover, however slow the computer is.
    stretch(&home, &mut plan, 1_500.0);
    loaded(t, &a, &plan)?;
    a.send(mode_command(mode::WAYPOINT).acked());
    if !mode_becomes(&a, mode::WAYPOINT, t.timers().begin)? {
        t.note("mode 11 was not entered: judged in mode 12");
    }
    // Some lights on, where the vehicle has lights.
    let sent = a.send(Draft::new(2007).raw("Set Lights", 0x45));
    let lit = a
        .wait(sent.mark, t.timers().answer / 4, |seen| seen.kind() == 3006)
        .is_some();
    // Mode, the To waypoint, and the commanded values.
    let state = |station: &Station| -> Judged<[Vec<Option<i64>>; 2]> {
        let states = station.query(3002)?;
        let commanded = [
            "Commanded Altitude",
            "Altitude Type",
            "Commanded Speed",
            "Speed Type",
        ];
        // What 2017 set is part of it; Edition 2.5 has no report of the loiter.
        let mut values: Vec<_> = commanded.iter().map(|name| states.raw(name)).collect();
        if !t.of_edition_25() {
            let loiter = station.query(3004)?;
            values.extend(
                ["Loiter Type", "Loiter Radius", "Loiter Direction"].map(|name| loiter.raw(name)),
            );
        }
        if lit {
            values.push(station.query(3006)?.raw("Navigation Lights State"));
        }
        Ok([vec![reported_mode(station)?, to_number(station)?], values])
    };
    let radius = t.bench.fresh_radius();
    a.set_radius(radius);
    if !t.of_edition_25() && !a.radius_becomes(radius)? {
        t.note("2017 does not change 3004: the loiter settings are not judged");
    }
    let before = state(&a)?;
    let b = t.b()?;
    a.request(0x0F, Access::Release)?;
    b.take(loi::LOI2 | loi::LOI4)?;
    t.pause(t.timers().quiet)?;
    let after = state(&b)?;
    hold(t, &b)?;
    b.send(Draft::new(2007).raw("Set Lights", 0));
    t.expect(before == after, || format!("expected mode, commanded values, loiter settings and To waypoint to stay through a handover; {before:?} became {after:?}"))?;
    aboard(t, &b, &plan, "still aboard after a handover")
}
