//! The private curve messages: CURVE.

use super::scene::Scene;
use crate::bench::flight::{
    Plan, clear, deliver, difference, download, home, run_transfer, transfer,
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
        rule: "CURVE-005",
        play: curves_harm_nothing,
    },
];

fn curve(t: &Trial, a: &Station, from: i64, to: i64) -> Judged<Draft> {
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

/// Whether the subject knows the curve messages: a foreign VSM need not.
fn known(t: &Trial, a: &Station) -> Judged {
    let sent = a.send(curve(t, a, 1, 2)?.acked());
    let answer = a.wait(sent.mark, t.timers().ack * 2, |seen| {
        super::acknowledgement::about(seen, 50002, sent.stamp)
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

fn curves_harm_nothing(t: &Trial) -> Judged {
    let a = t.controller()?;
    if known(t, &a).is_ok() {
        return Err(Stop::not_applicable("the subject knows curve messages"));
    }
    let home = home(t, &a)?;
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
