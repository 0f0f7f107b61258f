//! MULTI-002, two vehicles behind one VSM: that commands, plans, rights and losses of one do not touch the other.

use std::time::Duration;

use super::alerts::{Before, cautions, loss_alert};
use super::scene::Scene;
use super::status::{rate, rate_since};
use crate::bench::flight::{Plan, download, home, load};
use crate::bench::station::{Access, Station, loi};
use crate::bench::trial::Trial;
use crate::verdict::{Judged, Stop};

pub(super) const SCENES: &[Scene] = &[Scene {
    rule: "MULTI-002",
    play: commands_reach_their_vehicle_only,
}];

/// While the link of the first vehicle is cut, the status of the second continues.
fn the_loss_of_one_leaves_the_other(t: &Trial, stations: &[Station], before: f64) -> Judged {
    let means = &t.bench.profile.means;
    let (Some(cut), Some(restore)) = (&means.cut_vehicle_link, &means.restore_vehicle_link) else {
        return Ok(());
    };
    crate::means::shell(cut).map_err(Stop::Inconclusive)?;
    let mark = t.bench.net.mark();
    // Nothing is proved by it: the status is measured once the loss is known.
    let found = loss_alert(t, &stations[0], mark, &Before::default(), cautions)
        .and_then(|_| rate(t, &stations[1], 4000, Duration::from_secs(2)));
    crate::means::shell(restore).map_err(Stop::Inconclusive)?;
    super::link::fresh_again(t)?;
    let found = found?;
    t.expect(found >= before * 0.6, || {
        format!(
            "expected 4000 of {} at {before:.1} Hz while {} is silent, got {found:.1} Hz",
            stations[1].vehicle, stations[0].vehicle
        )
    })
}

fn commands_reach_their_vehicle_only(t: &Trial) -> Judged {
    let vehicles: Vec<_> = t.bench.surveyed()?.vehicle_ids().collect();
    let a = t.a()?;
    let mut stations = Vec::new();
    for &vehicle in vehicles.iter().take(2) {
        let mut station = Station::new(&t.bench, a.id, vehicle)?;
        station.vehicle = vehicle;
        if !stations.is_empty() {
            let before = station.request(0, Access::Request)?;
            let granted = before.raw("LOI Granted").unwrap_or_default();
            t.expect_of(&before, granted & loi::LOI4 == 0, || {
                format!("expected control of {} to be its own; who was granted it has LOI Granted 0x{granted:02x} of {vehicle} as well", vehicles[0])
            })?;
        }
        t.grant(&station, loi::LOI2 | loi::LOI4)?;
        stations.push(station);
    }
    let result = (|| {
        let (r1, r2) = (t.bench.fresh_radius(), t.bench.fresh_radius());
        stations[0].set_radius(r1);
        t.expect(stations[0].radius_becomes(r1)?, || {
            format!("expected 3004 of {} to show {r1} m", vehicles[0])
        })?;
        stations[1].set_radius(r2);
        t.expect(stations[1].radius_becomes(r2)?, || {
            format!("expected 3004 of {} to show {r2} m", vehicles[1])
        })?;
        let first = stations[0].radius()?;
        t.expect(first.is_some_and(|first| (first - r1).abs() < 0.8), || {
            format!(
                "expected 3004 of {} to keep {r1} m after a 2017 to {}, got {first:?}",
                vehicles[0], vehicles[1]
            )
        })?;
        // A plan of one vehicle is not a plan of the other.
        let home = home(t, &stations[0])?;
        let plan = Plan::zigzag(&home, "ONLY1", &[211, 212]);
        if load(t, &stations[0], &plan)?.status == Some(1) {
            let other = download(t, &stations[1], "ONLY1")?;
            let foreign = other
                .messages
                .iter()
                .any(|seen| seen.kind() == 13002 && seen.raw("Waypoint Number") == Some(211));
            t.expect(!foreign, || {
                format!(
                    "expected the plan of {} to stay its own; a download from {} has it",
                    vehicles[0], vehicles[1]
                )
            })?;
        }
        let time = Duration::from_secs(2);
        let mark = t.bench.net.mark();
        t.pause(time)?;
        the_loss_of_one_leaves_the_other(t, &stations, rate_since(&stations[1], mark, 4000, time))?;
        // Rights released for one vehicle stay held for the other.
        stations[1].request(loi::LOI4, Access::Release)?;
        let held = stations[0].request(0, Access::Request)?;
        let granted = held.raw("LOI Granted").unwrap_or_default();
        t.expect_of(&held, granted & loi::LOI4 != 0, || {
            format!(
                "expected LOI 4 of {} to stay with who released {}; LOI Granted is 0x{granted:02x}",
                vehicles[0], vehicles[1]
            )
        })?;
        for vehicle in &vehicles[..2] {
            let count = t.bench.net.recording().datagrams[mark..]
                .iter()
                .flat_map(|datagram| &datagram.messages)
                .filter(|seen| seen.kind() == 4000 && seen.piece.source == *vehicle)
                .count();
            t.expect(count > 0, || {
                format!("expected 4000 with source {vehicle}; none came")
            })?;
        }
        Ok(())
    })();
    for station in &stations {
        let _ = station.release();
    }
    result
}
