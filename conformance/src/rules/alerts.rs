//! Warnings, cautions, advisories: ALERT.

use std::time::Duration;

use super::scene::Scene;
use crate::bench::flight::{Plan, home, load, mode_command};
use crate::bench::station::loi;
use crate::bench::trial::Trial;
use crate::verdict::{Judged, Stop};

pub(super) const SCENES: &[Scene] = &[
    Scene {
        rule: "ALERT-002",
        play: the_end_of_a_cause_clears_its_alert,
    },
    Scene {
        rule: "ALERT-004",
        play: a_refusal_says_why,
    },
    Scene {
        rule: "ALERT-005",
        play: no_storms,
    },
    Scene {
        rule: "ALERT-006",
        play: standing_alerts_reach_the_newcomer,
    },
];

fn cut_and_restored<T>(t: &Trial, play: impl FnOnce() -> Judged<T>) -> Judged<T> {
    let means = &t.bench.profile.means;
    let (Some(cut), Some(restore)) = (&means.cut_vehicle_link, &means.restore_vehicle_link) else {
        return Err(Stop::not_applicable(
            "needs means.cut_vehicle_link and means.restore_vehicle_link in the profile",
        ));
    };
    crate::means::shell(cut).map_err(Stop::Inconclusive)?;
    let result = play();
    crate::means::shell(restore).map_err(Stop::Inconclusive)?;
    result
}

fn the_end_of_a_cause_clears_its_alert(t: &Trial) -> Judged {
    let station = t.monitor()?;
    let mark = t.bench.net.mark();
    let raised = cut_and_restored(t, || {
        t.pause(Duration::from_secs(9))?;
        let raised = station.received(mark, |seen| {
            seen.kind() == 16000
                && seen.raw("Priority").is_some_and(|priority| priority >= 2)
                && seen.raw("Type") == Some(1)
        });
        raised.first().cloned().ok_or_else(|| {
            Stop::inconclusive("no lasting alert came when the vehicle's link was cut")
        })
    })?;
    t.cite(&raised);
    let id = raised.raw("Alert (Warning) ID").unwrap_or_default().abs();
    let cleared = station.wait(mark, Duration::from_secs(10), |seen| {
        seen.kind() == 16000
            && seen.raw("Priority") == Some(0)
            && seen
                .raw("Alert (Warning) ID")
                .is_some_and(|found| found.abs() == id)
    });
    t.expect(cleared.is_some(), || format!("expected alert {id} to be cleared with priority 0 once the vehicle's link was back; it was not"))
}

fn a_refusal_says_why(t: &Trial) -> Judged {
    let a = t.controller()?;
    let mark = t.bench.net.mark();
    a.send(mode_command(17).acked());
    let said = a.wait(mark, t.timers().answer * 2, |seen| {
        seen.kind() == 16000 && seen.text("Text").is_some_and(|text| !text.is_empty())
    });
    t.expect(said.is_some(), || {
        "expected a 16000 with the reason after the refusal of mode 17; none came".into()
    })?;
    let home = home(t, &a)?;
    let mut gap = Plan::zigzag(&home, "WHY", &[71, 72, 73]);
    gap.points.remove(1);
    let mark = t.bench.net.mark();
    let found = load(t, &a, &gap)?;
    if found.status == Some(1) {
        return Err(Stop::inconclusive("a route with a gap was accepted"));
    }
    let said = a.wait(mark, t.timers().answer * 2, |seen| {
        seen.kind() == 16000 && seen.text("Text").is_some_and(|text| !text.is_empty())
    });
    t.expect(said.is_some(), || {
        "expected a 16000 with the reason after the refusal of a route with a gap; none came".into()
    })
}

fn no_storms(t: &Trial) -> Judged {
    let a = t.controller()?;
    let mark = t.bench.net.mark();
    for _ in 0..300 {
        a.send(mode_command(17));
        t.pause(Duration::from_millis(10))?;
    }
    t.pause(Duration::from_secs(1))?;
    let count = a.received(mark, |seen| seen.kind() == 16000).len();
    t.expect(count <= 20, || {
        format!("expected at most 20 alerts in the time of 300 refused commands, got {count}")
    })
}

fn standing_alerts_reach_the_newcomer(t: &Trial) -> Judged {
    let a = t.monitor()?;
    let mark = t.bench.net.mark();
    cut_and_restored(t, || {
        t.pause(Duration::from_secs(9))?;
        let raised = a.received(mark, |seen| {
            seen.kind() == 16000 && seen.raw("Type") == Some(1)
        });
        let raised = raised.first().cloned().ok_or_else(|| {
            Stop::inconclusive("no lasting alert came when the vehicle's link was cut")
        })?;
        let id = raised.raw("Alert (Warning) ID").unwrap_or_default().abs();
        let b = t.b()?;
        let late = t.bench.net.mark();
        b.take(loi::LOI2)?;
        let came = b.wait(late, t.timers().answer, |seen| {
            seen.kind() == 16000
                && seen
                    .raw("Alert (Warning) ID")
                    .is_some_and(|found| found.abs() == id)
        });
        t.expect(came.is_some(), || {
            format!(
                "expected the standing alert {id} at {} once it was granted LOI 2; it did not come",
                b.id
            )
        })
    })
}
