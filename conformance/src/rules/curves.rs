//! CURVE, this project's private curve messages (50001, 50002): that they are loaded, returned and flown, and that a
//! subject without them is not harmed by them.

use super::scene::Scene;
use crate::bench::flight::{
    Fix, Plan, clear, deliver, difference, download, fly_until, hold, home, mode, mode_becomes,
    mode_command, run_transfer, transfer,
};
use crate::bench::station::Station;
use crate::bench::trial::Trial;
use crate::verdict::{Judged, Stop};
use crate::wire::Draft;

pub(super) const SCENES: &[Scene] = &[
    Scene {
        rule: "CURVE-001",
        play: a_curve_leg_is_loaded,
    },
    Scene {
        rule: "CURVE-002",
        play: download_returns_the_curves,
    },
    Scene {
        rule: "CURVE-004",
        play: curve_legs_are_flown,
    },
    Scene {
        rule: "CURVE-003",
        play: repeated_and_contradicting_curves,
    },
    Scene {
        rule: "CURVE-005",
        play: curves_harm_nothing,
    },
];

pub(super) fn curve(t: &Trial, a: &Station, from: i64, to: i64) -> Judged<Draft> {
    let home = home(t, a)?;
    let (north, east) = home.offset(80.0, -15.0);
    let (north2, east2) = home.offset(100.0, 55.0);
    Ok(Draft::new(50002)
        .raw("P1 Waypoint No", from)
        .raw("P4 Waypoint No", to)
        .set("P2 Latitude", north)
        .set("P2 Longitude", east)
        .set("P3 Latitude", north2)
        .set("P3 Longitude", east2))
}

/// Whether the subject knows the curve messages; another maker's VSM need not.
fn known(t: &Trial, a: &Station) -> Judged {
    let sent = a.send(curve(t, a, 1, 2)?.acked());
    let answer = a.wait(sent.mark, t.timers().ack * 2, |seen| {
        crate::bench::station::about(seen, 50002, sent.stamp)
            && seen
                .raw("Acknowledgement Type")
                .is_some_and(|kind| kind != 3)
    });
    answer.map(|_| ()).ok_or_else(|| {
        Stop::not_applicable("50002 is not acknowledged: the subject does not know curve messages")
    })
}

fn send(t: &Trial, a: &Station, plan: &Plan, curve: &Draft, place: usize) -> Judged<Option<i64>> {
    clear(t, a)?;
    let mut messages = plan.messages();
    messages.insert(place.min(messages.len()), curve.clone());
    for message in messages {
        deliver(a, message);
    }
    t.loaded.set(true);
    Ok(run_transfer(t, a, transfer(2, &plan.mission), t.timers().load)?.status)
}

fn a_curve_leg_is_loaded(t: &Trial) -> Judged {
    let a = t.controller()?;
    known(t, &a)?;
    let home = home(t, &a)?;
    for (round, place) in [0, 2, 4].into_iter().enumerate() {
        let plan = Plan::zigzag(&home, &format!("CURVE{round}"), &[1, 2, 3]);
        let status = send(t, &a, &plan, &curve(t, &a, 1, 2)?, place)?;
        t.expect(status == Some(1), || format!("expected a curve from 1 to 2 at place {place} of the upload to load, got 14000 status {status:?}"))?;
    }
    let bad = Plan::zigzag(&home, "CURVEBAD", &[1, 2, 3]);
    let status = send(t, &a, &bad, &curve(t, &a, 1, 3)?, 4)?;
    t.expect(status != Some(1), || {
        "expected a curve from 1 to 3, where 1 goes to 2, to be refused; 14000 status 1 came".into()
    })?;
    a.send(transfer(5, "CURVEBAD"));
    Ok(())
}

fn download_returns_the_curves(t: &Trial) -> Judged {
    let a = t.controller()?;
    known(t, &a)?;
    let home = home(t, &a)?;
    let plan = Plan::zigzag(&home, "CURVES", &[1, 2, 3]);
    let status = send(t, &a, &plan, &curve(t, &a, 1, 2)?, 4)?;
    if status != Some(1) {
        return Err(Stop::inconclusive(format!(
            "a plan with a curve was not loaded: 14000 status {status:?}"
        )));
    }
    let back = download(t, &a, "CURVES")?;
    if let Some(difference) = difference(&plan, &back, &t.bench) {
        return Err(Stop::fail(format!(
            "expected the uploader's waypoints back; {difference}"
        )));
    }
    let curves = back
        .messages
        .iter()
        .filter(|seen| matches!(seen.kind(), 50001 | 50002))
        .count();
    t.expect(curves == 1, || {
        format!("expected the curve back in the download, got {curves} curve messages")
    })
}

/// The curve messages of a download, without their stamps.
fn curves_aboard(t: &Trial, a: &Station, mission: &str) -> Judged<Vec<Option<i64>>> {
    let back = download(t, a, mission)?;
    Ok(back
        .messages
        .iter()
        .filter(|seen| seen.kind() == 50002)
        .map(|seen| seen.raw("P2 Latitude"))
        .collect())
}

fn repeated_and_contradicting_curves(t: &Trial) -> Judged {
    let a = t.controller()?;
    known(t, &a)?;
    let home = home(t, &a)?;
    let (north, _) = home.offset(95.0, 0.0);
    let first = curve(t, &a, 1, 2)?;
    let second = first.clone().set("P2 Latitude", north);
    let upload = |name: &str, curves: &[Draft]| -> Judged<Option<i64>> {
        let plan = Plan::zigzag(&home, name, &[1, 2, 3]);
        clear(t, &a)?;
        for message in plan.messages() {
            deliver(&a, message);
        }
        for curve in curves {
            deliver(&a, curve.clone());
        }
        t.loaded.set(true);
        Ok(run_transfer(t, &a, transfer(2, name), t.timers().load)?.status)
    };
    let status = upload("AGAIN", &[first.clone(), first.clone()])?;
    t.expect(status == Some(1), || {
        format!("expected the same curve again to be accepted, got 14000 status {status:?}")
    })?;
    let status = upload("OTHER", &[first.clone(), second.clone()])?;
    t.expect(status == Some(1), || {
        format!("expected another curve for the same two ends to be accepted, got 14000 status {status:?}")
    })?;
    let aboard = curves_aboard(t, &a, "OTHER")?;
    let expected = crate::bench::flight::field(&second, "P2 Latitude");
    t.expect(aboard == [expected], || {
        format!("expected the second curve for the same two ends to replace the first (P2 Latitude {expected:?}); the download has {aboard:?}")
    })?;
    let status = upload("TWOLEGS", &[first.clone(), curve(t, &a, 1, 3)?])?;
    t.expect(status != Some(1), || {
        "expected two curve legs from one waypoint to be refused; 14000 status 1 came".into()
    })?;
    a.send(transfer(5, "TWOLEGS"));
    // 50001 names vehicle and CUCS itself: both have to equal those of the wrapper.
    let (north, east) = home.offset(80.0, -15.0);
    let foreign = Draft::new(50001)
        .set("Time Stamp", 1.0)
        .id("Vehicle ID", stanag_msgs::Id(a.vehicle.0 + 0x4200))
        .id("CUCS ID", a.id)
        .raw("P1 Waypoint No", 1)
        .raw("P4 Waypoint No", 2)
        .set("P2 Latitude", north)
        .set("P2 Longitude", east)
        .set("P3 Latitude", north)
        .set("P3 Longitude", east);
    let sent = a.send(foreign.acked());
    let done = a.wait(sent.mark, t.timers().ack, |seen| {
        seen.kind() == 17000
            && seen.raw("Original Message Type") == Some(50_001)
            && seen.raw("Acknowledgement Type") == Some(2)
    });
    a.send(transfer(5, "FOREIGN"));
    t.expect(done.is_none(), || {
        "expected a 50001 for another vehicle than its wrapper's to be refused; 17000 type 2 came"
            .into()
    })
}

/// A curve leg is flown as a curve: the track passes the middle of the curve, well off the straight line.
fn curve_legs_are_flown(t: &Trial) -> Judged {
    let a = crate::bench::flight::airborne(t)?;
    known(t, &a)?;
    let home = home(t, &a)?;
    clear(t, &a)?;
    let mut plan = Plan::zigzag(&home, "ARC", &[1, 2]);
    for (point, (north, east)) in plan.points.iter_mut().zip([(60.0, 0.0), (60.0, 240.0)]) {
        let (latitude, longitude) = home.offset(north, east);
        *point = point
            .clone()
            .set("Waypoint to Latitude or Relative Y", latitude)
            .set("Waypoint to Longitude or Relative X", longitude);
    }
    let ((p2n, p2e), (p3n, p3e)) = (home.offset(160.0, 60.0), home.offset(160.0, 180.0));
    let arc = Draft::new(50002)
        .raw("P1 Waypoint No", 1)
        .raw("P4 Waypoint No", 2)
        .set("P2 Latitude", p2n)
        .set("P2 Longitude", p2e)
        .set("P3 Latitude", p3n)
        .set("P3 Longitude", p3e);
    for message in plan.messages().into_iter().chain([arc]) {
        deliver(&a, message);
    }
    t.loaded.set(true);
    let status = run_transfer(t, &a, transfer(2, "ARC"), t.timers().load)?.status;
    if status != Some(1) {
        return Err(Stop::inconclusive(format!(
            "a route with an arc of 100 m was not loaded: 14000 status {status:?}"
        )));
    }
    a.send(crate::bench::station::schedule(
        4000,
        t.bench.profile.figures.largest_rate_hz.min(10),
    ));
    let sent = a.send(mode_command(mode::WAYPOINT).acked());
    if !mode_becomes(&a, mode::WAYPOINT, t.timers().begin)? {
        return Err(Stop::inconclusive("mode 11 was not entered"));
    }
    // The middle of the curve is three quarters of 100 m north of the straight line.
    let (north, east) = home.offset(135.0, 120.0);
    let (end_north, end_east) = home.offset(60.0, 240.0);
    fly_until(t, &a, t.timers().flight.div_f64(2.0), |fix| {
        fix.distance(end_north, end_east) < 20.0
    })?;
    hold(t, &a)?;
    let nearest = a
        .received(sent.mark, |seen| seen.kind() == 4000)
        .iter()
        .filter_map(|seen| Fix::of(seen))
        .map(|fix| fix.distance(north, east))
        .fold(f64::MAX, f64::min);
    let speed = t.bench.profile.figures.speed_factor.max(1.0);
    let blind = 8.0 * speed / f64::from(t.bench.profile.figures.largest_rate_hz.max(1));
    t.expect(nearest <= 10.0 + blind, || {
        format!("expected the track to follow the curve, whose middle lies 75 m off the straight line; its smallest distance from there is {nearest:.0} m")
    })
}

fn curves_harm_nothing(t: &Trial) -> Judged {
    let a = t.controller()?;
    let home = home(t, &a)?;
    if known(t, &a).is_ok() {
        // The subject claims to know curves; what it accepted has to come back in a download.
        let plan = Plan::zigzag(&home, "KNOWN", &[1, 2, 3]);
        let status = send(t, &a, &plan, &curve(t, &a, 1, 2)?.acked(), 4)?;
        let aboard = curves_aboard(t, &a, "KNOWN")?;
        t.expect(status != Some(1) || !aboard.is_empty(), || {
            "expected a 50002 that is acknowledged as carried out to be in the plan; the download has no curve".into()
        })?;
        return Err(Stop::not_applicable("the subject knows curve messages"));
    }
    let plan = Plan::zigzag(&home, "STRAIGHT", &[1, 2, 3]);
    let status = send(t, &a, &plan, &curve(t, &a, 1, 2)?.acked(), 3)?;
    let done = t.all_received(|seen| {
        seen.kind() == 17000
            && seen.raw("Original Message Type") == Some(50_002)
            && seen.raw("Acknowledgement Type") == Some(2)
    });
    t.expect(done.is_empty(), || {
        "expected no 'carried out' for a 50002 that the subject does not know; 17000 type 2 came"
            .into()
    })?;
    t.note(format!(
        "an upload with a foreign 50002 ends with 14000 status {status:?}"
    ));
    Ok(())
}
