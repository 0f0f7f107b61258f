//! Transfers: single downloads, clearing, cancelling, what 14000 echoes: ROUTE on the ground.

use super::mission::{aboard, with_plan};
use super::scene::Scene;
use crate::bench::flight::{Plan, deliver, download, home, run_transfer, transfer};
use crate::bench::trial::Trial;
use crate::verdict::{Judged, Stop};

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
        rule: "ROUTE-020",
        play: status_echoes_what_it_is_about,
    },
];

fn single_waypoint_download(t: &Trial) -> Judged {
    let (a, plan) = with_plan(t, &[10, 40, 20])?;
    let found = run_transfer(
        t,
        &a,
        transfer(4, &plan.mission).raw("Waypoint Number", 20),
        t.timers().load,
    )?;
    let numbers: Vec<_> = found
        .messages
        .iter()
        .filter(|seen| seen.kind() == 13002)
        .filter_map(|seen| seen.raw("Waypoint Number"))
        .collect();
    t.expect(
        !numbers.is_empty() && numbers.iter().all(|&number| number == 20),
        || format!("expected waypoint 20 and no other to 13000 mode 4; got {numbers:?}"),
    )?;
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
    t.expect(found.status.is_some(), || {
        "expected 14000 to end the download of an empty plan; none came".into()
    })
}

fn cancel_stops_a_transfer(t: &Trial) -> Judged {
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

fn progress_ends(t: &Trial) -> Judged {
    // The values are judged on the traffic of the whole run; here is a transfer of each kind.
    let (a, plan) = with_plan(t, &[1, 2, 3])?;
    let found = download(t, &a, &plan.mission)?;
    t.expect(found.status.is_some(), || {
        "expected a download to end with 14000 status 1 or 2; no end came".into()
    })
}

fn status_echoes_what_it_is_about(t: &Trial) -> Judged {
    let a = t.controller()?;
    let home = home(t, &a)?;
    let plan = Plan::zigzag(&home, "M1", &[1, 2]);
    let up = crate::bench::flight::load(t, &a, &plan)?;
    let down = download(t, &a, "M1")?;
    for (transfer, mode) in [(up, 2), (down, 3)] {
        if transfer.reports.is_empty() {
            return Err(Stop::inconclusive("no 14000 came"));
        }
        for seen in &transfer.reports {
            let (id, echoed) = (seen.text("Mission ID"), seen.raw("Mission Plan Mode"));
            t.expect_of(seen, id.as_deref() == Some("M1") && echoed == Some(mode), || {
                format!("expected 14000 with Mission ID M1 and plan mode {mode}, got {id:?} and {echoed:?}")
            })?;
        }
    }
    Ok(())
}
