//! Second looks at what a VSM keeps for each CUCS (rights, schedules, plans, transfers, alerts) while another CUCS
//! requests, releases, falls silent, or connects again.

use std::collections::BTreeSet;
use std::time::Duration;

use crate::bench::flight::{
    Plan, clear, deliver, download, home, load, loaded, run_transfer, transfer,
};
use crate::bench::station::about;
use crate::bench::station::{Access, Station, authorisation, information_request, loi, schedule};
use crate::bench::trial::Trial;
use crate::rules::configuration::request;
use crate::rules::curves::curve;
use crate::rules::mission::{aboard, with_plan};
use crate::rules::scene::Scene;
use crate::verdict::{Judged, Stop};
use crate::wire::{Draft, Seen};

pub(super) const FURTHER: &[Scene] = &[
    Scene {
        rule: "DISC-003",
        play: another_ones_control_is_no_grant,
    },
    Scene {
        rule: "AUTH-006",
        play: a_curve_is_part_of_the_plan,
    },
    Scene {
        rule: "AUTH-008",
        play: one_of_two_stations_is_given_back,
    },
    Scene {
        rule: "AUTH-010",
        play: all_who_are_known_may_monitor,
    },
    Scene {
        rule: "AUTH-017",
        play: a_payload_station_is_no_control,
    },
    Scene {
        rule: "HAND-001",
        play: the_next_handover_is_reported_as_well,
    },
    Scene {
        rule: "HAND-007",
        play: an_override_ends_an_upload,
    },
    Scene {
        rule: "AUTH-005",
        play: who_keeps_loi_2_keeps_its_status,
    },
    Scene {
        rule: "STAT-016",
        play: several_subsystems_are_all_answered,
    },
    Scene {
        rule: "ACK-001",
        play: each_message_of_a_datagram_is_acknowledged,
    },
    Scene {
        rule: "ACK-006",
        play: a_transfer_is_not_carried_out_again,
    },
    Scene {
        rule: "ROBUST-010",
        play: the_later_lights_stay,
    },
    Scene {
        rule: "ROUTE-006",
        play: a_gap_in_a_contingency_route,
    },
    Scene {
        rule: "ROUTE-007",
        play: a_good_route_right_after_a_refused_one,
    },
    Scene {
        rule: "DISC-009",
        play: a_refused_load_names_no_mission,
    },
    Scene {
        rule: "CONF-001",
        play: two_who_ask_at_once_are_both_answered,
    },
    Scene {
        rule: "CONF-002",
        play: one_field_during_a_whole_configuration,
    },
    Scene {
        rule: "MULTI-002",
        play: each_vehicle_has_its_own_schedules,
    },
];

fn granted(seen: &Seen) -> i64 {
    seen.raw("LOI Granted").unwrap_or_default()
}

/// The bit of a payload station that has this number.
fn bit(number: u8) -> i64 {
    1 << (number - 1)
}

fn another_ones_control_is_no_grant(t: &Trial) -> Judged {
    let Ok(b) = t.b() else { return Ok(()) };
    let a = t.controller()?;
    for seen in b.discover()? {
        let own = seen.piece.destination == b.id && seen.piece.source == a.vehicle;
        t.expect_of(&seen, !own || granted(&seen) == 0, || {
            format!(
                "expected LOI Granted 0 in the answer to a discovery of {}, which holds nothing while {} is in control; got 0x{:02x}",
                b.id,
                a.id,
                granted(&seen)
            )
        })?;
    }
    Ok(())
}

/// Between the holder's waypoints and its load command, a CUCS with LOI 2 sends a curve for one of its legs.
fn a_curve_is_part_of_the_plan(t: &Trial) -> Judged {
    let a = t.controller()?;
    let Ok(b) = t.b() else { return Ok(()) };
    t.grant(&b, loi::LOI2)?;
    let home = home(t, &a)?;
    clear(t, &a)?;
    for message in Plan::zigzag(&home, "STRAIGHT", &[51, 52]).messages() {
        deliver(&a, message);
    }
    b.send(curve(t, &b, 51, 52)?);
    t.pause(Duration::from_millis(100))?;
    t.loaded.set(true);
    if run_transfer(t, &a, transfer(2, "STRAIGHT"), t.timers().load)?.status != Some(1) {
        return Ok(());
    }
    let found = download(t, &a, "STRAIGHT")?;
    let bent = found
        .messages
        .iter()
        .any(|seen| matches!(seen.kind(), 50_001 | 50_002));
    t.expect(!bent, || {
        format!("expected the holder's plan unchanged by a curve of {}, which has LOI 2 only; the download has a curve", b.id)
    })
}

fn one_of_two_stations_is_given_back(t: &Trial) -> Judged {
    let stations: Vec<u8> = t.bench.surveyed()?.stations().into_iter().collect();
    let [first, second, ..] = stations[..] else {
        return Ok(());
    };
    let (a, _) = t.payload_pair()?;
    for number in [first, second] {
        let answer = a.request_station(loi::LOI2 | loi::LOI3, Access::Request, bit(number))?;
        if granted(&answer) & loi::LOI3 == 0 {
            return Ok(());
        }
    }
    a.request_station(loi::LOI3, Access::Release, bit(first))?;
    let left = a.request(0, Access::Request)?;
    let named = left.raw("Controlled Station 1-16");
    let kept = named.is_none_or(|named| named & bit(second) != 0);
    t.expect_of(&left, granted(&left) & loi::LOI3 != 0 && kept, || {
        format!(
            "expected {} to keep station {second} when it gives back station {first} alone; LOI Granted is 0x{:02x}, the stations are {named:04x?}",
            a.id,
            granted(&left)
        )
    })
}

fn all_who_are_known_may_monitor(t: &Trial) -> Judged {
    let a = t.controller()?;
    let known: Vec<_> = t.bench.surveyed()?.with(loi::LOI2);
    let others: Vec<_> = known
        .iter()
        .map(|cucs| cucs.id)
        .filter(|id| *id != a.id)
        .collect();
    for id in others {
        t.station(id)?.take(loi::LOI2)?;
    }
    Ok(())
}

fn a_payload_station_is_no_control(t: &Trial) -> Judged {
    let Some(&number) = t.bench.surveyed()?.stations().iter().next() else {
        return Ok(());
    };
    let (a, b) = t.payload_pair()?;
    t.grant(&a, loi::LOI2 | loi::LOI4)?;
    let taken = b.request_station(loi::LOI3, Access::Request, bit(number))?;
    if granted(&taken) & loi::LOI3 == 0 {
        return Ok(());
    }
    b.request_station(loi::LOI3, Access::Release, bit(number))?;
    let held = a.request(0, Access::Request)?;
    t.expect_of(&held, granted(&held) & loi::LOI4 != 0, || {
        format!(
            "expected {} to keep LOI 4 when {} gives back a payload station; LOI Granted is 0x{:02x}",
            a.id,
            b.id,
            granted(&held)
        )
    })
}

fn the_next_handover_is_reported_as_well(t: &Trial) -> Judged {
    let a = t.controller()?;
    let b = t.b()?;
    t.grant(&b, loi::LOI2)?;
    for (from, to) in [(&a, &b), (&b, &a)] {
        from.request(loi::LOI4, Access::Release)?;
        to.take(loi::LOI4)?;
    }
    t.pause(Duration::from_millis(200))?;
    let Ok(report) = a.query(35_000) else {
        return Ok(());
    };
    let id = |field: &str| report.raw(field).map(|raw| stanag_msgs::Id(raw as u32));
    let taking = id("CUCS ID (acquiring control)");
    let ended = report.raw("Status") == Some(2);
    t.expect_of(&report, !ended || taking.is_none_or(|id| id == a.id), || {
        format!(
            "expected {} as acquiring CUCS in 35000 once control had come back to it, got {taking:?}",
            a.id
        )
    })
}

/// One CUCS sends half a route, and the CUCS that overrides it the other half.
fn an_override_ends_an_upload(t: &Trial) -> Judged {
    let over = t.find("one that may override", |cucs| {
        cucs.overrides && cucs.authorised & loi::LOI4 != 0
    });
    let Ok(b) = over else { return Ok(()) };
    let a = t.find("another that may have LOI 4", |cucs| {
        cucs.id != b.id && cucs.authorised & loi::LOI4 != 0
    })?;
    t.grant(&a, loi::LOI2 | loi::LOI4)?;
    let home = home(t, &a)?;
    clear(t, &a)?;
    let messages = Plan::zigzag(&home, "HALVES", &[61, 62, 63, 64]).messages();
    for message in &messages[..3] {
        deliver(&a, message.clone());
    }
    let taken = b.request(loi::LOI2 | loi::LOI4, Access::Override)?;
    if granted(&taken) & loi::LOI4 == 0 {
        return Ok(());
    }
    for message in &messages[3..] {
        deliver(&b, message.clone());
    }
    t.loaded.set(true);
    let time = t.timers().load.min(t.timers().answer * 8);
    let found = run_transfer(t, &b, transfer(2, "HALVES"), time)?;
    if found.status != Some(1) {
        b.send(transfer(5, "HALVES"));
        return Ok(());
    }
    // The second half alone may be a valid route.
    let back = download(t, &b, "HALVES")?;
    let numbers: Vec<_> = back
        .messages
        .iter()
        .filter(|seen| seen.kind() == 13_002)
        .filter_map(|seen| seen.raw("Waypoint Number"))
        .collect();
    let mixed = numbers.iter().any(|number| (61..=62).contains(number));
    t.expect(!mixed, || {
        format!("expected no plan with waypoints of {}, which {} overrode; the download has {numbers:?}", a.id, b.id)
    })
}

fn who_keeps_loi_2_keeps_its_status(t: &Trial) -> Judged {
    let a = t.controller()?;
    a.request(loi::LOI4 | loi::LOI5, Access::Release)?;
    t.pause(Duration::from_millis(400))?;
    let came = a.collect(Duration::from_millis(1_200), |seen| seen.kind() == 4000)?;
    t.expect(!came.is_empty(), || {
        format!(
            "expected status to continue to {}, which gave LOI 4 back and kept LOI 2; no 4000 came",
            a.id
        )
    })
}

fn several_subsystems_are_all_answered(t: &Trial) -> Judged {
    let station = t.monitor()?;
    let asked = [0, 3, 5, 9];
    let ask = |mask: i64| -> Judged<BTreeSet<i64>> {
        let mark = t.bench.net.mark();
        station.send(Draft::new(15_000).raw("Subsystem ID", mask));
        t.pause(Duration::from_millis(350))?;
        let came = station.received(mark, |seen| seen.kind() == 16_001);
        Ok(came
            .iter()
            .filter_map(|seen| seen.raw("Subsystem ID"))
            .collect())
    };
    let mut alone = BTreeSet::new();
    for number in asked {
        alone.extend(ask(1 << number)?);
    }
    let mask = asked.iter().fold(0, |mask, number| mask | 1_i64 << number);
    // Twice, since one may be lost.
    let mut together = ask(mask)?;
    together.extend(ask(mask)?);
    let missing: Vec<_> = alone.difference(&together).collect();
    t.expect(missing.is_empty(), || {
        format!("expected each of the subsystems {alone:?}, which are reported alone, to be reported when all are asked for together; {missing:?} are missing")
    })
}

fn each_message_of_a_datagram_is_acknowledged(t: &Trial) -> Judged {
    let a = t.controller()?;
    let drafts: Vec<_> = (0..3)
        .map(|_| {
            a.stamped(
                Draft::new(2017)
                    .set("Loiter Radius", t.bench.fresh_radius())
                    .acked(),
            )
        })
        .collect();
    let stamps: BTreeSet<_> = drafts.iter().filter_map(Draft::stamp).collect();
    let bytes: Vec<u8> = drafts.iter().flat_map(|draft| a.encode(draft)).collect();
    let mark = t.bench.net.mark();
    for _ in 0..2 {
        a.send_bytes(&bytes);
        t.pause(t.timers().ack)?;
        let named: BTreeSet<_> = a
            .received(mark, |seen| seen.kind() == 17_000)
            .iter()
            .filter_map(|seen| seen.raw("Original Message Time Stamp"))
            .collect();
        if stamps.is_subset(&named) {
            return who_asked_is_answered(t);
        }
    }
    Err(Stop::fail(
        "expected 17000 about each of three 2017s that came in one datagram and asked for it; some have none",
    ))
}

/// Another CUCS requests something while one is in control: the answer goes to the CUCS that requested it.
fn who_asked_is_answered(t: &Trial) -> Judged {
    let Ok(b) = t.b() else { return Ok(()) };
    t.grant(&b, loi::LOI2)?;
    let sent = b.send(information_request(3).acked());
    for attempt in 0..3 {
        if attempt > 0 {
            b.send_bytes(&sent.bytes);
        }
        let came = b.wait(sent.mark, t.timers().ack, |seen| {
            about(seen, sent.kind, sent.stamp) && seen.piece.destination == b.id
        });
        if came.is_some() {
            return Ok(());
        }
    }
    Err(Stop::fail(format!(
        "expected 17000 about the 17002 of {}, beside a CUCS in control, to {} itself; none came",
        b.id, b.id
    )))
}

/// Commands that set no state, such as a clear, act once for their bytes, however late the repetition arrives.
fn a_transfer_is_not_carried_out_again(t: &Trial) -> Judged {
    let a = t.controller()?;
    let home = home(t, &a)?;
    let sent = a.send(transfer(1, "ONCE").acked());
    let cleared = a.wait(sent.mark, t.timers().answer, |seen| {
        seen.kind() == 14_000 && seen.raw("Status") == Some(1)
    });
    let plan = Plan::zigzag(&home, "KEPT", &[1, 2]);
    t.loaded.set(true);
    if cleared.is_none() || load(t, &a, &plan)?.status != Some(1) {
        t.note(
            "a transfer that comes again is not judged: a clear and a load did not both succeed",
        );
        return Ok(());
    }
    // Later than a short memory of duplicates lasts.
    t.pause((sent.at + Duration::from_secs(3)).saturating_sub(t.bench.net.now()))?;
    a.send_bytes(&sent.bytes);
    t.pause(t.timers().quiet / 2)?;
    aboard(
        t,
        &a,
        &plan,
        "aboard, though the bytes of a 13000 that cleared the one before came again",
    )
}

fn the_later_lights_stay(t: &Trial) -> Judged {
    let a = t.controller()?;
    let lit = || -> Option<i64> { a.query(3006).ok()?.raw("Navigation Lights State") };
    if lit().is_none() {
        return Ok(());
    }
    let set = |lights: i64| Draft::new(2007).raw("Set Lights", lights);
    let overtaken = a.encode(&a.stamped(set(1)));
    t.pause(Duration::from_millis(30))?;
    a.send(set(0));
    t.pause(Duration::from_millis(300))?;
    if lit() != Some(0) {
        return Ok(());
    }
    a.send_bytes(&overtaken);
    t.pause(t.timers().quiet / 3)?;
    let shown = lit();
    a.send(set(0));
    t.expect(shown == Some(0), || {
        format!("expected a 2007 that a later one has overtaken not to undo it; 3006 shows {shown:?}, expected 0")
    })
}

fn a_gap_in_a_contingency_route(t: &Trial) -> Judged {
    let a = t.controller()?;
    let home = home(t, &a)?;
    let mut plan = Plan::zigzag(&home, "GAP3", &[1, 2]);
    let contingency = Plan::zigzag(&home, "GAP3", &[101, 102, 103]);
    plan.points
        .push(crate::bench::flight::route_head("R-GAP3", 101, 3));
    plan.points.push(contingency.points[0].clone());
    plan.points.push(contingency.points[2].clone());
    let found = load(t, &a, &plan)?;
    a.send(transfer(5, "GAP3"));
    t.expect(found.status != Some(1), || {
        "expected 14000 status 2 for a plan whose contingency route names waypoint 102, which was never sent; got 1".into()
    })
}

/// The fault of one upload does not count against the next.
fn a_good_route_right_after_a_refused_one(t: &Trial) -> Judged {
    let (a, _) = with_plan(t, &[1, 2, 3])?;
    let home = home(t, &a)?;
    let mut bad = Plan::zigzag(&home, "WRONG", &[1, 2]);
    bad.points[1] = bad.points[1].clone().set("Waypoint to Altitude", 150_000.0);
    if load(t, &a, &bad)?.status == Some(1) {
        return Ok(());
    }
    // Under the numbers of the refused plan, so that anything left of it shows.
    let found = load(t, &a, &Plan::zigzag(&home, "RIGHT", &[1, 2]))?;
    t.expect(found.status == Some(1), || {
        format!("expected a good route right after a refused one, under its numbers, to load; got 14000 status {:?}", found.status)
    })
}

fn a_refused_load_names_no_mission(t: &Trial) -> Judged {
    let a = t.controller()?;
    let home = home(t, &a)?;
    let (good, bad) = ("NAMED", "REFUSED");
    loaded(t, &a, &Plan::zigzag(&home, good, &[1, 2]))?;
    if a.query(3)?.text("Mission ID").as_deref() != Some(good) {
        return Ok(());
    }
    let mut gap = Plan::zigzag(&home, bad, &[21, 22, 23]);
    gap.points.remove(1);
    if load(t, &a, &gap)?.status == Some(1) {
        return Ok(());
    }
    let shown = a.query(3)?;
    let named = shown.text("Mission ID");
    t.expect_of(&shown, named.as_deref() != Some(bad), || {
        format!("expected #3 to name mission {good}, which is aboard, after the load of {bad} was refused; it names {bad}")
    })
}

fn two_who_ask_at_once_are_both_answered(t: &Trial) -> Judged {
    let (Ok(a), Ok(b)) = (t.a(), t.b()) else {
        return Ok(());
    };
    t.grant(&a, loi::LOI2)?;
    t.grant(&b, loi::LOI2)?;
    let complete = |seen: &Seen| seen.kind() == 41_005;
    for _ in 0..2 {
        let mark = t.bench.net.mark();
        a.send(request(3));
        b.send(request(3));
        let time = t.timers().config / 3;
        if a.wait(mark, time, complete).is_some() && b.wait(mark, time, complete).is_some() {
            return Ok(());
        }
    }
    Err(Stop::fail(format!(
        "expected a configuration phase for each of {} and {}, which sent 40000 at once; 41005 did not come to both",
        a.id, b.id
    )))
}

fn one_field_during_a_whole_configuration(t: &Trial) -> Judged {
    let station = t.any()?;
    for _ in 0..2 {
        let single = request(0)
            .raw("Requested Message", 2017)
            .raw("Requested Field", 3);
        let mark = station.send_together(vec![request(3), single]);
        let complete = station.wait(mark, t.timers().config / 3, |seen| seen.kind() == 41_005);
        if complete.is_some() {
            return Ok(());
        }
    }
    Err(Stop::fail(
        "expected a configuration phase to continue to 41005 when one field is asked for beside it; it does not end",
    ))
}

fn each_vehicle_has_its_own_schedules(t: &Trial) -> Judged {
    let vehicles: Vec<_> = t.bench.surveyed()?.vehicle_ids().collect();
    let a = t.a()?;
    let mut stations = Vec::new();
    for &vehicle in vehicles.iter().take(2) {
        let mut station = Station::new(&t.bench, a.id, vehicle)?;
        station.vehicle = vehicle;
        t.grant(&station, loi::LOI2)?;
        stations.push(station);
    }
    let Some(last) = stations.last() else {
        return Ok(());
    };
    for vehicle in &vehicles[..stations.len()] {
        last.send(schedule(3, 5).to(*vehicle));
    }
    t.pause(Duration::from_millis(500))?;
    let (mark, time) = (t.bench.net.mark(), Duration::from_millis(1_600));
    t.pause(time)?;
    let mut result = Ok(());
    for vehicle in &vehicles[..stations.len()] {
        let came = last.received(mark, |seen| {
            seen.kind() == 3 && seen.piece.source == *vehicle
        });
        let stamps: BTreeSet<_> = came.iter().map(|seen| seen.stamp()).collect();
        if stamps.len() < 4 && result.is_ok() {
            result = Err(Stop::fail(format!(
                "expected #3 of {vehicle} at 5 Hz when it is scheduled for two vehicles; {} came in {:.1} s",
                stamps.len(),
                time.as_secs_f64()
            )));
        }
        last.send(schedule(3, 0).to(*vehicle));
    }
    for station in &stations {
        station.send(authorisation(0x0F, Access::Release));
    }
    result
}
