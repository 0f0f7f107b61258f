//! STAT in flight, continued: rates and accelerations, the state of the vehicle, its engines.
//!
//! These scenes make the traffic. The judges of the traffic (`passive::motion`, `passive::condition`) judge it, since they
//! need many reports, and those of other scenes count too; a scene notes what was too little or too weak for them.

use std::f64::consts::TAU;
use std::time::Duration;

use super::acknowledgement::refused;
use super::configuration::full;
use super::scene::Scene;
use crate::bench::fix::{Fix, wrapped};
use crate::bench::flight::{airborne, fix, fly_until, hold, home, mode, mode_command};
use crate::bench::station::{Station, schedule};
use crate::bench::trial::Trial;
use crate::passive::{self, View};
use crate::verdict::{Judged, Stop};
use crate::wire::Draft;

pub(super) const SCENES: &[Scene] = &[
    Scene {
        rule: "STAT-017",
        play: rates_and_accelerations,
    },
    Scene {
        rule: "STAT-018",
        play: the_state_of_the_vehicle,
    },
    Scene {
        rule: "STAT-019",
        play: engines_on_the_ground_and_in_a_climb,
    },
];

/// Ends a scene whose rule the judges of the traffic judge: inconclusive where this trial's was not enough for them.
pub(super) fn judged_by_traffic(t: &Trial, rule: &str) -> Judged {
    let datagrams = t.bench.net.recording().datagrams[t.mark..].to_vec();
    let view = View {
        datagrams: &datagrams,
        profile: &t.bench.profile,
        survey: t.bench.survey.get(),
        live: true,
        as_they_are: false,
    };
    let (any, missing) = passive::looked_at(rule, &view);
    if !any {
        return Err(Stop::inconclusive(format!(
            "not seen: {}",
            missing.join("; ")
        )));
    }
    for what in missing {
        t.note(format!("not judged: {what}"));
    }
    Ok(())
}

/// This many seconds of the vehicle, and long enough for some reports.
fn seconds(t: &Trial, seconds: f64) -> Duration {
    let speed = t.bench.profile.figures.speed_factor.max(1.0);
    Duration::from_secs_f64((seconds / speed).max(0.6))
}

/// Reports of the motion as often as the subject sends them.
fn schedule_motion(t: &Trial, a: &Station) {
    let largest = t.bench.profile.figures.largest_rate_hz;
    a.send(schedule(4000, largest.min(10)));
}

/// A 2016 with the altitude of a fix, so many metres higher.
fn at_altitude(draft: Draft, fix: &Fix, up: f64) -> Draft {
    draft
        .raw("Altitude Command Type", 1)
        .set("Commanded Altitude", fix.altitude + up)
        .raw("Altitude Type", fix.altitude_type)
}

/// Gets faster along each quarter of the compass, turning to it, and brakes, while it climbs and descends.
fn rates_and_accelerations(t: &Trial) -> Judged {
    let a = airborne(t)?;
    let began = fix(t, &a)?;
    schedule_motion(t, &a);
    let mut steers = true;
    for (leg, quarter) in [0.0, 1.0, 2.0, 3.0, 0.0, 1.0].into_iter().enumerate() {
        let up = if leg % 2 == 0 { 15.0 } else { 0.0 };
        let course = quarter * TAU / 4.0;
        if steers {
            let steer = mode_command(mode::AUTOPILOT)
                .raw("Heading Command Type", 2)
                .set("Commanded Course", wrapped(course))
                .set("Commanded Speed", 8.0)
                .raw("Speed Type", 2);
            let sent = a.send(at_altitude(steer, &began, up).acked());
            steers = leg > 0 || !refused(t, &a, &sent);
        }
        if !steers {
            // A vehicle that is not steered flies to a place, and stays there.
            let (latitude, longitude) = began.offset(60.0 * course.cos(), 60.0 * course.sin());
            let there = mode_command(mode::LOITER)
                .set("Loiter Position Latitude", latitude)
                .set("Loiter Position Longitude", longitude)
                .set("Commanded Speed", 8.0)
                .raw("Speed Type", 2);
            a.send(at_altitude(there, &began, up));
        }
        t.pause(seconds(t, 5.0))?;
        hold(t, &a)?;
        t.pause(seconds(t, 5.0))?;
    }
    a.send(schedule(4000, 0));
    judged_by_traffic(t, "STAT-017")
}

/// Lands the vehicle; false where it does not come down in time.
fn landed(t: &Trial, a: &Station) -> Judged<bool> {
    let home = home(t, a)?;
    a.send(mode_command(mode::LAND));
    let down = fly_until(t, a, t.timers().flight, |fix| {
        fix.altitude < home.altitude + 2.0
    })?;
    // The state on the ground follows the touchdown by a moment.
    t.pause(seconds(t, 5.0))?;
    Ok(down.is_some())
}

fn the_state_of_the_vehicle(t: &Trial) -> Judged {
    let a = airborne(t)?;
    let states = || -> Judged {
        for _ in 0..3 {
            a.query(3002)?;
            t.pause(Duration::from_millis(200))?;
        }
        Ok(())
    };
    // The names of the vehicle's own values, where it has some.
    for kind in [1, 3] {
        if full(t, &a, kind).is_err() {
            t.note(format!("40000 of request type {kind} is not answered"));
        }
    }
    // A report of flight is one of a vehicle that moves.
    let began = fix(t, &a)?;
    let (latitude, longitude) = began.offset(150.0, 0.0);
    a.send(
        mode_command(mode::LOITER)
            .set("Loiter Position Latitude", latitude)
            .set("Loiter Position Longitude", longitude)
            .set("Commanded Speed", 8.0)
            .raw("Speed Type", 2),
    );
    let moves = fly_until(t, &a, t.timers().begin, |fix| {
        fix.distance(began.latitude, began.longitude) > 25.0
    })?;
    states()?;
    if moves.is_none() {
        t.note("the vehicle did not move to a place: its state in flight is not judged");
    }
    if landed(t, &a)? {
        states()?;
    } else {
        t.note("the vehicle did not land: its state after a landing is not judged");
    }
    judged_by_traffic(t, "STAT-018")
}

/// Longer than an engine needs to run down.
const STANDS: Duration = Duration::from_millis(4_500);

fn engines_on_the_ground_and_in_a_climb(t: &Trial) -> Judged {
    let stopped = |a: &Station| -> Judged {
        for _ in 0..2 {
            a.query(3007)?;
            t.pause(STANDS)?;
        }
        a.query(3007)?;
        Ok(())
    };
    let a = t.launcher()?;
    if a.query(3007).is_err() {
        return Err(Stop::not_applicable("3007 is not sent"));
    }
    let home = home(t, &a)?;
    if fix(t, &a)?.altitude < home.altitude + 3.0 {
        stopped(&a)?;
    }
    a.release()?;
    let a = airborne(t)?;
    schedule_motion(t, &a);
    // A subject may have the vehicle report its engines only once somebody asks for them.
    a.query(3007)?;
    let began = fix(t, &a)?;
    a.send(at_altitude(Draft::new(2016), &began, 60.0));
    let climbs = fly_until(t, &a, t.timers().begin, |fix| fix.down < -1.5)?;
    for _ in 0..6 {
        a.query(3007)?;
        t.pause(Duration::from_millis(100))?;
    }
    if climbs.is_none() {
        t.note("the vehicle did not climb by a 2016 with an altitude");
    }
    a.send(schedule(4000, 0));
    // What it was in the climb must not stay.
    if landed(t, &a)? {
        stopped(&a)?;
    }
    judged_by_traffic(t, "STAT-019")
}
