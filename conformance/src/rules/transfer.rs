//! ROUTE on the ground, continued: downloads of single waypoints, clearing, cancelling, and what 14000 reports about
//! a transfer.

use super::condition::judged_by_traffic;
use super::mission::{aboard, with_plan};
use super::scene::Scene;
use crate::bench::flight::{
    Plan, deliver, difference, download, field, home, load, loaded, run_transfer, transfer,
};
use crate::bench::trial::Trial;
use crate::verdict::{Judged, Stop};
use crate::wire::Draft;

pub(super) const SCENES: &[Scene] = &[
    Scene {
        rule: "ROUTE-009",
        play: single_waypoint_download,
    },
    Scene {
        rule: "ROUTE-010",
        play: clear_empties_the_plan,
    },
    Scene {
        rule: "ROUTE-011",
        play: cancel_stops_a_transfer,
    },
    Scene {
        rule: "ROUTE-012",
        play: progress_ends,
    },
    Scene {
        rule: "ROUTE-024",
        play: progress_is_made_on_the_way,
    },
    Scene {
        rule: "ROUTE-020",
        play: status_echoes_what_it_is_about,
    },
];

fn single_waypoint_download(t: &Trial) -> Judged {
    let (a, mut plan) = with_plan(t, &[10, 40, 20])?;
    let loiter = Draft::new(13003)
        .raw("Waypoint Number", 40)
        .raw("Waypoint Loiter Type", 1)
        .set("Loiter Radius", 120.0)
        .raw("Loiter Direction", 1)
        .raw("Loiter Duration", 60)
        .raw("Loiter Duration Units", 0);
    plan.points.insert(2, loiter);
    if load(t, &a, &plan)?.status != Some(1) {
        t.note("judged without a loiter waypoint: it is refused");
        plan.points.remove(2);
        loaded(t, &a, &plan)?;
    }
    for wanted in [20, 10, 40] {
        let found = run_transfer(
            t,
            &a,
            transfer(4, &plan.mission).raw("Waypoint Number", wanted),
            t.timers().load,
        )?;
        let numbers: Vec<_> = found
            .messages
            .iter()
            .filter(|seen| seen.kind() == 13002)
            .filter_map(|seen| seen.raw("Waypoint Number"))
            .collect();
        t.expect(
            !numbers.is_empty() && numbers.iter().all(|&number| number == wanted),
            || format!("expected waypoint {wanted} and no other to 13000 mode 4; got {numbers:?}"),
        )?;
        let foreign = found
            .messages
            .iter()
            .find(|seen| seen.kind() == 13003 && seen.raw("Waypoint Number") != Some(wanted));
        t.expect(foreign.is_none(), || {
            format!(
                "expected the loiter of waypoint {wanted} only to 13000 mode 4; one of another came"
            )
        })?;
        let alone = Plan {
            points: plan
                .points
                .iter()
                .filter(|point| field(point, "Waypoint Number") == Some(wanted))
                .cloned()
                .collect(),
            ..plan.clone()
        };
        if let Some(difference) = difference(&alone, &found, &t.bench) {
            return Err(Stop::fail(format!(
                "expected waypoint {wanted} as it was uploaded to 13000 mode 4; {difference}"
            )));
        }
    }
    let unknown = run_transfer(
        t,
        &a,
        transfer(4, &plan.mission).raw("Waypoint Number", 99),
        t.timers().load.min(t.timers().answer * 5),
    )?;
    let came = unknown
        .messages
        .iter()
        .filter(|seen| seen.kind() == 13002)
        .count();
    t.expect(came == 0, || {
        format!("expected no 13002 to a request of waypoint 99, which is not aboard; {came} came")
    })?;
    t.expect(unknown.status == Some(2), || {
        format!(
            "expected 14000 status 2 to a request of waypoint 99, which is not aboard; got {:?}",
            unknown.status
        )
    })
}

fn clear_empties_the_plan(t: &Trial) -> Judged {
    let (a, plan) = with_plan(t, &[1, 2, 3])?;
    let cleared = run_transfer(
        t,
        &a,
        transfer(1, &plan.mission),
        t.timers().load.min(t.timers().answer * 5),
    )?;
    t.note(format!(
        "13000 mode 1 ended with 14000 status {:?}",
        cleared.status
    ));
    let found = download(t, &a, &plan.mission)?;
    let waypoints = found
        .messages
        .iter()
        .filter(|seen| seen.kind() == 13002)
        .count();
    t.expect(waypoints == 0, || {
        format!(
            "expected no waypoint in a download after the mission was cleared; {waypoints} came"
        )
    })?;
    let left = found.messages.iter().find(|seen| {
        seen.kind() != 13001 || seen.raw("Initial Waypoint Number").unwrap_or_default() != 0
    });
    t.expect(left.is_none(), || {
        format!("expected no route and no loiter in a download after the mission was cleared; a {} came", left.map_or(0, |seen| seen.kind()))
    })?;
    t.expect(found.status.is_some(), || {
        "expected 14000 to end the download of an empty plan; none came".into()
    })
}

fn cancel_stops_a_transfer(t: &Trial) -> Judged {
    cancel_stops_a_download(t)?;
    let (a, plan) = with_plan(t, &[1, 2, 3])?;
    let home = home(t, &a)?;
    let half = Plan::zigzag(&home, "HALF", &[51, 52, 53, 54]);
    for message in half.messages() {
        deliver(&a, message);
    }
    a.send(transfer(5, "HALF"));
    t.pause(t.timers().answer / 4)?;
    let found = run_transfer(
        t,
        &a,
        transfer(2, "HALF"),
        t.timers().load.min(t.timers().answer * 8),
    )?;
    let back = download(t, &a, &plan.mission)?;
    let foreign = back
        .messages
        .iter()
        .filter(|seen| seen.kind() == 13002)
        .filter_map(|seen| seen.raw("Waypoint Number"))
        .find(|number| (51..=54).contains(number));
    t.expect(foreign.is_none(), || format!("expected nothing of a cancelled upload to be loaded by a later load command; waypoint {foreign:?} came back (14000 status {:?})", found.status))?;
    aboard(t, &a, &plan, "unchanged after a cancelled upload")
}

/// A download that is sent in parts ends when it is cancelled; one that came at once cannot be stopped.
fn cancel_stops_a_download(t: &Trial) -> Judged {
    let (a, plan) = with_plan(t, &(1..=100).collect::<Vec<i64>>())?;
    let sent = a.send(transfer(3, &plan.mission));
    let begun = a.wait(sent.mark, t.timers().load, |seen| seen.kind() == 13002);
    if begun.is_none() {
        return Err(Stop::inconclusive(
            "a download of 100 waypoints did not begin",
        ));
    }
    a.send(transfer(5, &plan.mission));
    let cancelled = t.bench.net.now();
    t.pause(t.timers().quiet)?;
    let came = a.received(sent.mark, |seen| seen.kind() == 13002);
    let complete = a.received(sent.mark, |seen| {
        seen.kind() == 14000
            && seen.raw("Status") == Some(1)
            && seen.raw("Mission Plan Mode") == Some(3)
    });
    t.expect(came.len() >= 100 || complete.is_empty(), || {
        format!("expected 14000 status 2, or none, for a download that was cancelled after {} of 100 waypoints; status 1 came", came.len())
    })?;
    let last = came
        .last()
        .map_or(std::time::Duration::ZERO, |seen| seen.at);
    let late = last.saturating_sub(cancelled);
    t.expect(
        came.len() < 100 || late < std::time::Duration::from_millis(200),
        || {
            format!(
                "expected the cancelled download to end; all {} waypoints came, the last {:.1} s after 13000 mode 5",
                came.len(),
                late.as_secs_f64()
            )
        },
    )?;
    a.release()?;
    Ok(())
}

fn progress_ends(t: &Trial) -> Judged {
    // The passive judge of this rule judges the values in all traffic; here each kind of transfer is caused.
    let (a, plan) = with_plan(t, &[1, 2, 3])?;
    let found = download(t, &a, &plan.mission)?;
    t.expect(found.status.is_some(), || {
        "expected a download to end with 14000 status 1 or 2; no end came".into()
    })?;
    let one = run_transfer(
        t,
        &a,
        transfer(4, &plan.mission).raw("Waypoint Number", 2),
        t.timers().load.min(t.timers().answer * 5),
    )?;
    t.expect(one.status.is_some(), || {
        "expected the download of one waypoint to end with 14000 status 1 or 2; no end came".into()
    })?;
    for (what, transfer) in [
        ("a download", &found),
        ("the download of one waypoint", &one),
    ] {
        let ends = transfer
            .reports
            .iter()
            .filter(|seen| seen.raw("Status").is_some_and(|status| status != 0))
            .count();
        t.expect(ends == 1, || {
            format!("expected {what} to end once, got {ends} messages 14000 with status 1 or 2")
        })?;
    }
    Ok(())
}

fn progress_is_made_on_the_way(t: &Trial) -> Judged {
    // So many waypoints that the transfer takes its time.
    let (a, plan) = with_plan(t, &(1..=100).collect::<Vec<i64>>())?;
    download(t, &a, &plan.mission)?;
    judged_by_traffic(t, "ROUTE-024")
}

fn status_echoes_what_it_is_about(t: &Trial) -> Judged {
    let a = t.controller()?;
    let home = home(t, &a)?;
    // A name of the field's full length: a subject that keeps fewer characters echoes a different one.
    let name = "M1-TO-THE-NORTH-EAS";
    let plan = Plan::zigzag(&home, name, &[1, 2]);
    let up = load(t, &a, &plan)?;
    let down = download(t, &a, name)?;
    let mut gap = Plan::zigzag(&home, name, &[3, 4]);
    gap.points.remove(1);
    let refused = load(t, &a, &gap)?;
    for (transfer, mode) in [(up, 2), (down, 3), (refused, 2)] {
        if transfer.reports.is_empty() {
            return Err(Stop::inconclusive("no 14000 came"));
        }
        for seen in &transfer.reports {
            let (id, echoed) = (seen.text("Mission ID"), seen.raw("Mission Plan Mode"));
            t.expect_of(seen, id.as_deref() == Some(name) && echoed == Some(mode), || {
                format!("expected 14000 with Mission ID {name} and plan mode {mode}, got {id:?} and {echoed:?}")
            })?;
        }
    }
    Ok(())
}
