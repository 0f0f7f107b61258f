//! Data links, the vehicle's link, and clocks: LINK, TIME.

use std::time::Duration;

use super::scene::Scene;
use crate::bench::flight::mode_command;
use crate::bench::station::{Access, loi};
use crate::bench::trial::Trial;
use crate::verdict::{Judged, Stop};
use crate::wire::Draft;
use stanag_msgs::Id;

pub(super) const SCENES: &[Scene] = &[
    Scene {
        rule: "LINK-001",
        play: data_links_are_found_by_broadcast,
    },
    Scene {
        rule: "LINK-004",
        play: loss_of_the_vehicle_link_keeps_control,
    },
    Scene {
        rule: "TIME-005",
        play: a_wrong_clock_is_not_ignored_silently,
    },
];

fn data_links_are_found_by_broadcast(t: &Trial) -> Judged {
    let station = t.any()?;
    let draft = Draft::new(28000)
        .to(Id::BROADCAST)
        .id("VSM ID", Id::BROADCAST)
        .id("Data Link ID", Id::BROADCAST)
        .raw("Control Assignment Request", 0);
    let found = station.ask(
        draft,
        t.timers().answer,
        "28001 to a broadcast 28000",
        |seen| seen.kind() == 28001,
    )?;
    let availability = found.raw("Data Link Control Availability");
    t.expect_of(&found, availability != Some(2), || {
        "expected 'available' or 'unavailable' in 28001 to a broadcast, got 'granted'".into()
    })
}

fn loss_of_the_vehicle_link_keeps_control(t: &Trial) -> Judged {
    let means = &t.bench.profile.means;
    let (Some(cut), Some(restore)) = (&means.cut_vehicle_link, &means.restore_vehicle_link) else {
        return Err(Stop::not_applicable(
            "needs means.cut_vehicle_link and means.restore_vehicle_link in the profile",
        ));
    };
    let a = t.controller()?;
    let b = t.b()?;
    let mark = t.bench.net.mark();
    crate::means::shell(cut).map_err(Stop::Inconclusive)?;
    let result = (|| {
        t.pause(Duration::from_secs(10))?;
        let alert = a.received(mark, |seen| seen.kind() == 16000);
        t.expect(!alert.is_empty(), || {
            "expected a 16000 within 10 s of the loss of the vehicle; none came".into()
        })?;
        let sent = a.send(mode_command(12).acked());
        let refused = a.wait(sent.mark, t.timers().answer * 2, |seen| {
            super::acknowledgement::about(seen, 2016, sent.stamp)
                && seen.raw("Acknowledgement Type") == Some(3)
        });
        t.expect(refused.is_some(), || {
            "expected 17000 type 3 to a 2016 while the vehicle is silent; it did not come".into()
        })?;
        let answer = b.request(loi::LOI4, Access::Request)?;
        let granted = answer.raw("LOI Granted").unwrap_or_default();
        t.expect_of(&answer, granted & loi::LOI4 == 0, || "expected control to stay with its holder while the vehicle is silent; B was granted LOI 4".into())?;
        let late = t.bench.net.mark();
        t.pause(Duration::from_secs(2))?;
        let stamps: std::collections::BTreeSet<_> = a
            .received(late, |seen| seen.kind() == 4000 && seen.has("Latitude"))
            .iter()
            .filter_map(|seen| seen.stamp())
            .collect();
        t.expect(stamps.len() <= 1, || {
            format!(
                "expected no fresh stamps on positions of a silent vehicle; {} came",
                stamps.len()
            )
        })
    })();
    crate::means::shell(restore).map_err(Stop::Inconclusive)?;
    t.pause(Duration::from_secs(3))?;
    result
}

fn a_wrong_clock_is_not_ignored_silently(t: &Trial) -> Judged {
    let now = t.bench.net.wall_ms() as i64;
    for (what, stamp) in [
        ("an hour old", now - 3_600_000),
        ("an hour ahead", now + 3_600_000),
        ("0", 0),
    ] {
        let a = t.controller()?;
        let radius = t.bench.fresh_radius();
        let mark = t.bench.net.mark();
        a.send(
            Draft::new(2017)
                .raw("Time Stamp", stamp)
                .set("Loiter Radius", radius)
                .acked(),
        );
        let said = a.wait(mark, t.timers().answer, |seen| {
            seen.kind() == 16000
                || seen.kind() == 17000 && seen.raw("Acknowledgement Type") == Some(3)
        });
        let carried_out = said.is_none() && a.radius_becomes(radius)?;
        t.expect(said.is_some() || carried_out, || format!("expected a 2017 with a stamp {what} to be carried out or refused by 17000 type 3 or 16000; nothing came and 3004 does not show it"))?;
        a.release()?;
    }
    Ok(())
}
