//! LINK and TIME, data links (28000, 28001), the loss of the vehicle's link or of the CUCS, and stamps of a wrong
//! clock.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::time::Duration;

use super::alerts::{
    Before, COMMS, LOSS_REPORTED_WITHIN, about_links, before_the_cause, cautions, loss_alert,
};
use super::scene::Scene;
use crate::bench::flight::{
    Plan, airborne, fix, fly_until, home, loaded, mode, mode_becomes, mode_command, reported_mode,
    route_head, stretch, transfer,
};
use crate::bench::station::{Access, Station, about, loi};
use crate::bench::trial::Trial;
use crate::profile::OnLoss;
use crate::verdict::{Judged, Precondition as _, Stop};
use crate::wire::{Direction, Draft, Seen};
use stanag_msgs::Id;

pub(super) const SCENES: &[Scene] = &[
    Scene {
        rule: "LINK-001",
        play: data_links_are_found_by_broadcast,
    },
    Scene {
        rule: "LINK-002",
        play: a_link_is_held_by_one,
    },
    Scene {
        rule: "LINK-003",
        play: the_state_of_a_link_on_request,
    },
    Scene {
        rule: "LINK-004",
        play: loss_of_the_vehicle_link_keeps_control,
    },
    Scene {
        rule: "LINK-005",
        play: loss_of_the_cucs_is_flown_as_planned,
    },
    Scene {
        rule: "TIME-005",
        play: a_wrong_clock_is_not_ignored_silently,
    },
];

/// The holder sends heartbeats, then stops, on a long route: another CUCS watches what follows.
fn loss_of_the_cucs_is_flown_as_planned(t: &Trial) -> Judged {
    let figures = &t.bench.profile.figures;
    let Some(planned) = figures.on_loss else {
        return Err(Stop::not_applicable(
            "needs figures.on_loss in the profile: what is provisioned for the loss of the CUCS",
        ));
    };
    let a = airborne(t)?;
    let home = home(t, &a)?;
    let mut plan = Plan::zigzag(&home, "LOST", &[1, 2, 3]);
    stretch(&home, &mut plan, 1_500.0);
    if planned == OnLoss::Contingency {
        let contingency = Plan::zigzag(&home, "LOST", &[101, 102]);
        plan.points.push(route_head("R-LOST", 101, 3));
        plan.points.extend(contingency.points);
    }
    loaded(t, &a, &plan)?;
    a.send(mode_command(mode::WAYPOINT).acked());
    if !mode_becomes(&a, mode::WAYPOINT, t.timers().begin)? {
        return Err(Stop::inconclusive("mode 11 was not entered"));
    }
    let b = t.b()?;
    b.take(loi::LOI2).precondition("B has LOI 2")?;
    // What comes while the CUCS is there is not about its loss.
    let calm = t.bench.net.mark();
    for _ in 0..4 {
        a.send(Draft::new(16002));
        t.pause(Duration::from_secs(1))?;
    }
    let before = Before::of(&b.received(calm, |seen| seen.kind() == 16000));
    let mark = t.bench.net.mark();
    t.pause(Duration::from_secs_f64(figures.act_s))?;
    let expected = |shown: Option<i64>| match planned {
        OnLoss::Continue => shown == Some(mode::WAYPOINT),
        OnLoss::Hold => shown == Some(mode::LOITER),
        OnLoss::Contingency => matches!(shown, Some(23 | 24)),
        OnLoss::Return => !matches!(
            shown,
            None | Some(mode::WAYPOINT | mode::LOITER | mode::AUTOPILOT)
        ),
    };
    let deadline = t.bench.net.now() + t.timers().begin;
    let mut shown = reported_mode(&b)?;
    while !expected(shown) && t.bench.net.now() < deadline {
        t.pause(Duration::from_millis(200))?;
        shown = reported_mode(&b)?;
    }
    t.expect(expected(shown), || {
        format!(
            "expected the vehicle to {planned:?} {:.0} s after the last heartbeat of the CUCS in control, as the profile has it; 3001 shows mode {shown:?}",
            figures.act_s
        )
    })?;
    let from = fix(t, &b)?;
    let far = from.distance(home.latitude, home.longitude);
    let moved = fly_until(t, &b, t.timers().begin, |fix| {
        let moved = fix.distance(from.latitude, from.longitude);
        match planned {
            OnLoss::Return => fix.distance(home.latitude, home.longitude) < (far - 10.0).max(5.0),
            // A hovering vehicle stops, a circling one stays near.
            OnLoss::Hold => moved > 400.0,
            OnLoss::Continue | OnLoss::Contingency => moved > 20.0,
        }
    })?;
    t.expect(moved.is_some() != (planned == OnLoss::Hold), || {
        format!(
            "expected 4000 to show the vehicle {planned:?} after the loss of the CUCS; it does not"
        )
    })?;
    let alerts = b.received(mark, |seen| {
        before.begins(&b, seen) && about_links(seen) && cautions(seen)
    });
    t.expect(!alerts.is_empty(), || {
        format!("expected a 16000 of subsystem {COMMS} (communications) and priority 2 or more about the loss of the CUCS in control, which began with it; none came")
    })
}

fn data_links_are_found_by_broadcast(t: &Trial) -> Judged {
    let station = t.monitor()?;
    let draft = Draft::new(28000)
        .to(Id::BROADCAST)
        .id("VSM ID", Id::BROADCAST)
        .id("Data Link ID", Id::BROADCAST)
        .raw("Control Assignment Request", 0);
    let mark = t.bench.net.mark();
    let found = station.ask(
        draft,
        t.timers().answer,
        "28001 to a broadcast 28000",
        |seen| seen.kind() == 28001,
    )?;
    t.pause(t.timers().answer / 4)?;
    let requests = t.bench.net.recording().datagrams[mark..]
        .iter()
        .flat_map(|datagram| &datagram.messages)
        .filter(|seen| seen.direction == Direction::Sent && seen.kind() == 28000)
        .count();
    let mut links: BTreeMap<(stanag_msgs::Id, Vec<u8>), usize> = BTreeMap::new();
    for seen in station.received(mark, |seen| seen.kind() == 28001) {
        let availability = seen.raw("Data Link Control Availability");
        t.expect_of(&seen, matches!(availability, Some(0 | 1)), || {
            format!("expected 'available' (0) or 'unavailable' (1) in 28001 to a broadcast, got {availability:?}; 2 is 'granted'")
        })?;
        // Everything but the stamp identifies the link.
        let width = seen.info.map_or(0, |info| usize::from(info.presence_bytes)) + 5;
        let content = seen.piece.data.get(width..).unwrap_or_default().to_vec();
        *links.entry((seen.piece.source, content)).or_default() += 1;
    }
    let most = links.values().max().copied().unwrap_or_default();
    t.expect_of(&found, most <= requests, || {
        format!("expected one 28001 for each link and vehicle type, got {most} of one to {requests} requests")
    })
}

/// 28000 for the link that a broadcast showed: 0 requests, 1 releases.
fn directed(station: &Station, link: i64, assignment: i64) -> Judged<Option<i64>> {
    let answer = station.ask(
        Draft::new(28000)
            .id("VSM ID", Id::BROADCAST)
            .raw("Data Link ID", link)
            .raw("Control Assignment Request", assignment),
        station.bench().timers.answer,
        "28001 to a directed 28000",
        |seen| seen.kind() == 28001,
    )?;
    Ok(answer.raw("Data Link Control Availability"))
}

fn a_link_is_held_by_one(t: &Trial) -> Judged {
    let (a, b) = (t.a()?, t.b()?);
    t.grant(&a, loi::LOI2)?;
    t.grant(&b, loi::LOI2)?;
    let link = 0;
    let first = directed(&a, link, 0);
    if !matches!(first, Ok(Some(2))) {
        let _ = directed(&a, link, 1);
        // An answer to the directed request shows that the link is known; 0 in it, that the link is free.
        t.expect(!matches!(first, Ok(Some(0))), || {
            "expected a directed request (0) for a free link to be granted (2); 28001 says that the link is still available".into()
        })?;
        if !t.bench.surveyed()?.links_available {
            return Err(Stop::not_applicable(
                "28001 says of every data link that it is unavailable (1): no station can have one",
            ));
        }
        return Err(Stop::inconclusive(format!(
            "the id of the link is not known to the suite: a directed request brings {first:?}"
        )));
    }
    let result = (|| {
        for (station, assignment, expected, what) in [
            (&b, 0, 1, "unavailable (1) to B while A holds the link"),
            (
                &b,
                1,
                1,
                "unavailable (1) to a release by B, which holds nothing",
            ),
            (&a, 1, 0, "available (0) once A has released the link"),
            (&b, 0, 2, "granted (2) to B for a link that is free"),
        ] {
            let found = directed(station, link, assignment)?;
            t.expect(found == Some(expected), || {
                format!("expected {what} in 28001, got {found:?}")
            })?;
        }
        Ok(())
    })();
    for station in [&a, &b] {
        let _ = directed(station, link, 1);
    }
    result
}

fn the_state_of_a_link_on_request(t: &Trial) -> Judged {
    let station = t.monitor()?;
    let mark = t.bench.net.mark();
    let found = station.query(32005)?;
    t.cite(&found);
    t.pause(t.timers().answer / 4)?;
    let reports = station.received(mark, |seen| seen.kind() == 32005);
    let terminals: BTreeSet<_> = reports
        .iter()
        .filter_map(|seen| seen.raw("Addressed Terminal"))
        .collect();
    t.expect(terminals.len() != 1 || reports.is_empty(), || {
        format!("expected 32005 for the terminal in the air and the one on the ground, got {terminals:?}")
    })?;
    for seen in &reports {
        let state = seen.raw("Data Link State").unwrap_or(-1);
        t.expect_of(seen, state >= 0, || {
            "expected a Data Link State in 32005".into()
        })?;
    }
    Ok(())
}

/// Waits until positions of the vehicle come with new stamps, as they do once its link is back; 5 s at most, since
/// the next rule finds out by itself if they do not.
pub(super) fn fresh_again(t: &Trial) -> Judged {
    let station = t.any()?;
    station.take(loi::LOI2)?;
    let mut stamps = BTreeSet::new();
    let mark = t.bench.net.mark();
    station.wait(mark, Duration::from_secs(5), |seen| {
        let position = seen.kind() == 4000 && seen.has("Latitude");
        position && {
            stamps.extend(seen.stamp());
            stamps.len() > 2
        }
    });
    t.pause(Duration::from_millis(500))
}

/// The stamps of the positions, or of 4001, that come within two seconds; the set with the fewest of several looks,
/// up to the end of the time that a loss may take to be reported. A vehicle without link has at most one.
pub(super) fn stamps_of_the_silent(t: &Trial, station: &Station) -> Judged<BTreeSet<i64>> {
    let deadline = t.bench.net.now() + LOSS_REPORTED_WITHIN;
    loop {
        let mark = t.bench.net.mark();
        t.pause(Duration::from_secs(2))?;
        let of = |wanted: fn(&Seen) -> bool| -> BTreeSet<i64> {
            let came = station.received(mark, wanted);
            came.iter().filter_map(|seen| seen.stamp()).collect()
        };
        let positions = of(|seen| seen.kind() == 4000 && seen.has("Latitude"));
        let waypoints = of(|seen| seen.kind() == 4001);
        let stamps = if positions.len() < waypoints.len() {
            waypoints
        } else {
            positions
        };
        if stamps.len() <= 1 || t.bench.net.now() >= deadline {
            return Ok(stamps);
        }
    }
}

fn loss_of_the_vehicle_link_keeps_control(t: &Trial) -> Judged {
    let means = &t.bench.profile.means;
    let (Some(cut), Some(restore)) = (&means.cut_vehicle_link, &means.restore_vehicle_link) else {
        return Err(Stop::not_applicable(
            "needs means.cut_vehicle_link and means.restore_vehicle_link in the profile",
        ));
    };
    let a = t.launcher().or_else(|_| t.controller())?;
    let b = t.b()?;
    let before = before_the_cause(t, &a, t.mark)?;
    let running = |seen: Arc<Seen>| seen.raw("Engine Status").unwrap_or_default() != 0;
    let was_running = a.query(3007).is_ok_and(running);
    let mark = t.bench.net.mark();
    crate::means::shell(cut).map_err(Stop::Inconclusive)?;
    let result = (|| {
        // Alerts about something else may come meanwhile.
        let alert = loss_alert(t, &a, mark, &before, about_links)?;
        t.expect(alert.is_some(), || {
            let named: BTreeSet<_> = a
                .received(mark, |seen| seen.kind() == 16000)
                .iter()
                .filter_map(|seen| seen.raw("Subsystem ID"))
                .collect();
            format!("expected a 16000 of subsystem {COMMS} (communications) that begins within 10 s of the loss of the vehicle; alerts came of {named:?}")
        })?;
        if t.bench.flight_released.load(Ordering::SeqCst) && !was_running {
            a.send(
                Draft::new(2008)
                    .raw("Engine Number", 1)
                    .raw("Engine Command", 1)
                    .acked(),
            );
        }
        let sent = a.send(mode_command(12).acked());
        let refused = a.wait(sent.mark, t.timers().answer * 2, |seen| {
            about(seen, 2016, sent.stamp) && seen.raw("Acknowledgement Type") == Some(3)
        });
        t.expect(refused.is_some(), || {
            "expected 17000 type 3 to a 2016 while the vehicle is silent; it did not come".into()
        })?;
        // A route cannot have reached a vehicle that does not answer, so its load must not end as complete.
        if let Some(home) = t.bench.home.get() {
            let mark = t.bench.net.mark();
            for message in Plan::zigzag(home, "SILENT", &[1, 2]).messages() {
                a.send(message);
            }
            a.send(transfer(2, "SILENT"));
            let complete = a.wait(mark, t.timers().answer, |seen| {
                seen.kind() == 14_000 && seen.raw("Status").is_some_and(|status| status != 0)
            });
            a.send(transfer(5, "SILENT"));
            t.expect(
                complete.is_none_or(|end| end.raw("Status") != Some(1)),
                || {
                    "expected no 14000 status 1 for a load while the vehicle is silent; it came"
                        .into()
                },
            )?;
        }
        let answer = b.request(loi::LOI4, Access::Request)?;
        let granted = answer.raw("LOI Granted").unwrap_or_default();
        t.expect_of(&answer, granted & loi::LOI4 == 0, || "expected control to stay with its holder while the vehicle is silent; B was granted LOI 4".into())?;
        let stamps = stamps_of_the_silent(t, &a)?;
        t.expect(stamps.len() <= 1, || {
            format!(
                "expected no fresh stamps on positions (4000) or waypoints (4001) of a silent vehicle; {} came",
                stamps.len()
            )
        })
    })();
    crate::means::shell(restore).map_err(Stop::Inconclusive)?;
    fresh_again(t)?;
    result?;
    // What was refused is not carried out once the link is back.
    let engines = a.query(3007).ok();
    if let (Some(engines), false) = (&engines, was_running) {
        let status = engines.raw("Engine Status");
        t.expect_of(engines, status.unwrap_or_default() == 0, || {
            format!("expected an engine start that came while the vehicle was silent not to be carried out later; 3007 shows Engine Status {status:?}")
        })?;
    }
    Ok(())
}

fn a_wrong_clock_is_not_ignored_silently(t: &Trial) -> Judged {
    let calm = t.controller()?;
    let before = before_the_cause(t, &calm, t.mark)?;
    calm.release()?;
    let now = t.bench.net.wall_ms() as i64;
    for (what, stamp) in [
        ("five seconds old", now - 5_000),
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
        let refusal = a.wait(mark, t.timers().answer, |seen| {
            before.begins(&a, seen)
                || about(seen, 2017, stamp) && seen.raw("Acknowledgement Type") == Some(3)
        });
        let carried_out = refusal.is_none() && a.radius_becomes(radius)?;
        t.expect(refusal.is_some() || carried_out, || format!("expected a 2017 with a stamp {what} to be carried out or refused by 17000 type 3 or 16000; nothing came and 3004 does not show it"))?;
        a.release()?;
    }
    Ok(())
}
