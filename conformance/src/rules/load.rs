//! LOAD: that status and commands continue under many commands, long routes and a flood from unknown ids.

use std::time::Duration;

use super::scene::Scene;
use crate::bench::flight::{Plan, clear, difference, download, home, load};
use crate::bench::station::about;
use crate::bench::station::{Access, authorisation, loi};
use crate::bench::trial::Trial;
use crate::verdict::{Judged, Stop};
use crate::wire::Draft;
use stanag_msgs::Id;

pub(super) const SCENES: &[Scene] = &[
    Scene {
        rule: "LOAD-001",
        play: many_commands_a_second,
    },
    Scene {
        rule: "LOAD-002",
        play: long_routes,
    },
    Scene {
        rule: "LOAD-003",
        play: a_flood_by_strangers,
    },
];

fn many_commands_a_second(t: &Trial) -> Judged {
    let a = t.controller()?;
    let rate = t.bench.profile.figures.load_per_s.max(1);
    let seconds = 10;
    let idle = t.bench.net.mark();
    t.pause(Duration::from_secs(2))?;
    let before = a
        .received(idle, |seen| {
            seen.kind() == 4000 && seen.piece.source == a.vehicle
        })
        .len() as f64
        / 2.0;
    let mark = t.bench.net.mark();
    let mut last = 0.0;
    let began = t.bench.net.now();
    let total = rate * seconds;
    for count in 0..total {
        last = t.bench.radius(count);
        a.send(Draft::new(2017).set("Loiter Radius", last).acked());
        let due = began + Duration::from_secs_f64(f64::from(count) / f64::from(rate));
        if let Some(wait) = due.checked_sub(t.bench.net.now()) {
            t.pause(wait)?;
        }
    }
    let loaded = t.bench.net.now() - began;
    let status = a
        .received(mark, |seen| {
            seen.kind() == 4000 && seen.piece.source == a.vehicle
        })
        .len() as f64
        / loaded.as_secs_f64();
    let deadline = t.bench.net.now() + t.timers().answer;
    while t.bench.net.now() < deadline
        && a.received(mark, |seen| seen.kind() == 17000).len() < total as usize
    {
        t.pause(Duration::from_millis(100))?;
    }
    let stamps: std::collections::BTreeSet<_> = a
        .received(mark, |seen| seen.kind() == 17000)
        .iter()
        .filter_map(|seen| seen.raw("Original Message Time Stamp"))
        .collect();
    let share = stamps.len() as f64 / f64::from(total);
    t.note(format!(
        "{:.1} % of {total} commands at {rate}/s acknowledged",
        share * 100.0
    ));
    t.expect(share >= 0.99, || {
        format!(
            "expected 99.9 % of {total} commands at {rate}/s to be acknowledged, got {:.1} %",
            share * 100.0
        )
    })?;
    // A window of two seconds may have one message more or less: it is subtracted.
    t.expect(status >= before * 0.7 - 0.5, || {
        format!("expected 4000 at {before:.1} Hz under {rate} commands a second as without them, got {status:.1} Hz")
    })?;
    t.expect(a.radius_becomes(last)?, || {
        format!("expected the last of {total} radii ({last} m) in 3004")
    })
}

/// As many as every vehicle has to accept, and more than a byte can count.
fn long_routes(t: &Trial) -> Judged {
    let a = t.controller()?;
    let home = home(t, &a)?;
    for count in [100_i64, 300] {
        clear(t, &a)?;
        let mut plan = Plan::zigzag(&home, "LONG", &(1..=count).collect::<Vec<i64>>());
        for (index, point) in plan.points.iter_mut().enumerate() {
            let angle = index as f64 * 0.2;
            let (latitude, longitude) = home.offset(
                (100.0 + 5.0 * index as f64) * angle.cos(),
                (100.0 + 5.0 * index as f64) * angle.sin(),
            );
            *point = point
                .clone()
                .set("Waypoint to Latitude or Relative Y", latitude)
                .set("Waypoint to Longitude or Relative X", longitude);
        }
        let began = t.bench.net.now();
        let found = load(t, &a, &plan)?;
        t.note(format!(
            "{count} waypoints in {:.1} s, 14000 status {:?}",
            (t.bench.net.now() - began).as_secs_f64(),
            found.status
        ));
        if found.status != Some(1) && count > 100 {
            // The limit that the subject declares may be lower.
            return Ok(());
        }
        t.expect(found.status == Some(1), || {
            format!(
                "expected a route of {count} waypoints to load, got 14000 status {:?}",
                found.status
            )
        })?;
        let back = download(t, &a, "LONG")?;
        if let Some(difference) = difference(&plan, &back, &t.bench) {
            return Err(Stop::fail(format!(
                "expected a download of {count} waypoints to equal the upload; {difference}"
            )));
        }
    }
    Ok(())
}

fn a_flood_by_strangers(t: &Trial) -> Judged {
    let a = t.controller()?;
    let stranger = t.stranger()?;
    let mut answered = 0;
    let rounds = 5;
    for round in 0..rounds {
        let sent = a.send(
            Draft::new(2017)
                .set("Loiter Radius", t.bench.fresh_radius())
                .acked(),
        );
        let began = t.bench.net.now();
        let mut id = 0_u32;
        while t.bench.net.now() < began + Duration::from_secs(1) {
            for _ in 0..20 {
                id += 1;
                // Several have the stamp of one millisecond. With rising stamps the flood would run ahead of the
                // clock, and the stamps of later rules would be in the future.
                let draft = authorisation(loi::LOI4, Access::Request)
                    .from(Id(0x1b00_8000 + (id + round) % 1000))
                    .raw("Time Stamp", t.bench.net.wall_ms() as i64);
                stranger.flood(&stranger.encode(&draft));
            }
            t.pause(Duration::from_millis(4))?;
        }
        let found = a.wait(sent.mark, t.timers().answer, |seen| {
            about(seen, 2017, sent.stamp)
        });
        answered += u32::from(found.is_some());
    }
    t.expect(answered + 1 >= rounds, || format!("expected the holder's 2017 to be acknowledged under a flood by strangers, got {answered} of {rounds}"))?;
    t.expect(a.commands_work()?, || {
        "expected the holder's commands to work after a flood by strangers".into()
    })
}
