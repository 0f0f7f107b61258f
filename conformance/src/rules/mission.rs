//! ROUTE on the ground: which plans are loaded and which refused as a whole, that a refusal leaves the old plan, and
//! that a download returns what was uploaded.

use std::collections::{BTreeMap, BTreeSet};

use super::scene::Scene;
use crate::bench::flight::{
    Plan, Transfer, airborne, clear, deliver, difference, download, field, hold, home, load,
    loaded, mode, mode_becomes, mode_command, reported_mode, route_head, run_transfer, stretch,
    to_number, transfer,
};
use crate::bench::station::Station;
use crate::bench::trial::{Player, Trial};
use crate::verdict::{Judged, Stop};
use crate::wire::{Direction, Draft};

pub(super) const SCENES: &[Scene] = &[
    Scene {
        rule: "ROUTE-001",
        play: a_good_route_is_loaded,
    },
    Scene {
        rule: "ROUTE-002",
        play: nothing_is_loaded_before_the_load_command,
    },
    Scene {
        rule: "ROUTE-003",
        play: order_of_arrival_does_not_matter,
    },
    Scene {
        rule: "ROUTE-005",
        play: waypoint_0_and_65535_are_none,
    },
    Scene {
        rule: "ROUTE-006",
        play: a_route_with_a_gap_is_refused,
    },
    Scene {
        rule: "ROUTE-007",
        play: a_refused_upload_leaves_the_old_plan,
    },
    Scene {
        rule: "ROUTE-008",
        play: download_returns_what_was_uploaded,
    },
    Scene {
        rule: "ROUTE-013",
        play: route_type_and_its_default,
    },
    Scene {
        rule: "ROUTE-014",
        play: deleting_a_route_keeps_its_waypoints,
    },
    Scene {
        rule: "ROUTE-019",
        play: unflyable_waypoints_are_refused,
    },
];

/// Fails unless the loaded plan is this one.
pub(super) fn aboard(t: &Trial, a: &Station, plan: &Plan, when: &str) -> Judged {
    let found = download(t, a, &plan.mission)?;
    match difference(plan, &found, &t.bench) {
        None => Ok(()),
        Some(difference) => Err(Stop::fail(format!(
            "expected plan {} {when}; {difference}",
            plan.mission
        ))),
    }
}

/// A controller whose plan is loaded, on the ground.
pub(super) fn with_plan(t: &Trial, numbers: &[i64]) -> Judged<(Player, Plan)> {
    let a = t.controller()?;
    let home = home(t, &a)?;
    let name = format!("P{}", t.bench.net.mark() % 100_000);
    let plan = Plan::zigzag(&home, &name, numbers);
    loaded(t, &a, &plan)?;
    Ok((a, plan))
}

fn a_good_route_is_loaded(t: &Trial) -> Judged {
    let a = t.controller()?;
    let home = home(t, &a)?;
    clear(t, &a)?;
    let plan = Plan::zigzag(&home, "GOOD", &[1, 2, 3, 4]);
    let found = load(t, &a, &plan)?;
    t.expect(found.status == Some(1), || {
        format!(
            "expected 14000 status 1 for a good route of four waypoints, got {:?}",
            found.status
        )
    })?;
    aboard(t, &a, &plan, "aboard once 14000 said complete")?;
    // The second route replaces the first.
    let second = Plan::zigzag(&home, "GOOD2", &[1, 2, 3]);
    let found = load(t, &a, &second)?;
    t.expect(found.status == Some(1), || {
        format!(
            "expected 14000 status 1 for a second good route, got {:?}",
            found.status
        )
    })?;
    let back = download(t, &a, &second.mission)?;
    let route = Plan {
        points: second.points.clone(),
        ..second
    };
    let differs =
        difference(&route, &back, &t.bench).filter(|text| !text.contains("waypoints came back"));
    t.expect(differs.is_none(), || {
        format!(
            "expected the second route aboard once 14000 said complete; {}",
            differs.unwrap_or_default()
        )
    })
}

fn nothing_is_loaded_before_the_load_command(t: &Trial) -> Judged {
    let (a, plan) = with_plan(t, &[1, 2, 3])?;
    let home = home(t, &a)?;
    let mark = t.bench.net.mark();
    for message in Plan::zigzag(&home, "OTHER", &[5, 6, 7]).messages() {
        deliver(&a, message);
    }
    let early = a.wait(mark, t.timers().quiet, |seen| {
        seen.kind() == 14000 && seen.raw("Status") == Some(1)
    });
    if let Some(early) = early {
        t.expect_of(&early, false, || {
            "expected no transfer before the load command; 14000 status 1 came".into()
        })?;
    }
    a.send(transfer(5, "OTHER"));
    t.pause(t.timers().answer / 4)?;
    aboard(
        t,
        &a,
        &plan,
        "still aboard, since the other plan was never loaded",
    )
}

fn order_of_arrival_does_not_matter(t: &Trial) -> Judged {
    let a = t.controller()?;
    let home = home(t, &a)?;
    // A loiter may come before its waypoint too. (3 is the index of the loiter of the waypoint with index 2.)
    for (round, order) in [[5, 3, 2, 0, 4, 1], [1, 4, 2, 3, 5, 0], [0, 5, 4, 3, 2, 1]]
        .into_iter()
        .enumerate()
    {
        let mut plan = Plan::zigzag(&home, &format!("ORDER{round}"), &[1, 2, 3, 4]);
        plan.points.insert(
            2,
            Draft::new(13003)
                .raw("Waypoint Number", 2)
                .raw("Waypoint Loiter Type", 1)
                .set("Loiter Radius", 120.0)
                .raw("Loiter Direction", 1)
                .raw("Loiter Duration", 60)
                .raw("Loiter Duration Units", 0),
        );
        clear(t, &a)?;
        let messages = plan.messages();
        for index in order {
            deliver(&a, messages[index].clone());
        }
        let found = run_transfer(t, &a, transfer(2, &plan.mission), t.timers().load)?;
        t.expect(found.status == Some(1), || {
            format!(
                "expected 14000 status 1 for messages in the order {order:?}, got {:?}",
                found.status
            )
        })?;
        aboard(t, &a, &plan, "whatever the order of its messages")?;
    }
    Ok(())
}

/// Fails unless a plan is refused, and leaves the loaded plan as it was.
fn refused(t: &Trial, a: &Station, aboard_before: &Plan, bad: &Plan, what: &str) -> Judged {
    let mark = t.bench.net.mark();
    let found = load(t, a, bad)?;
    if found.status == Some(1) {
        return Err(Stop::fail(format!(
            "expected 14000 status 2 for a route with {what}; got 1"
        )));
    }
    let acknowledged = a.received(mark, |seen| {
        seen.kind() == 17000 && seen.raw("Acknowledgement Type") == Some(3)
    });
    let asks = found
        .reports
        .iter()
        .any(|seen| seen.raw("Waypoint Request").unwrap_or_default() != 0);
    let ends = found
        .reports
        .iter()
        .filter(|seen| seen.raw("Status") == Some(1))
        .count();
    t.expect(ends == 0, || {
        format!("expected no 14000 status 1 for a route with {what}; it came after status 2")
    })?;
    t.expect(
        found.status == Some(2) || !acknowledged.is_empty() || asks,
        || format!("expected 14000 status 2 for a route with {what}; no end of the transfer came"),
    )?;
    a.send(transfer(5, &bad.mission));
    t.pause(t.timers().answer / 8)?;
    aboard(
        t,
        a,
        aboard_before,
        &format!("unchanged after the refusal of a route with {what}"),
    )
}

fn waypoint_0_and_65535_are_none(t: &Trial) -> Judged {
    let (a, plan) = with_plan(t, &[1, 2, 3])?;
    let home = home(t, &a)?;
    for number in [0, 65_535] {
        let mut bad = Plan::zigzag(&home, &format!("N{number}"), &[11, 12]);
        bad.points[0] = bad.points[0].clone().raw("Next Waypoint", number);
        bad.points[1] = bad.points[1].clone().raw("Waypoint Number", number);
        // Next Waypoint 0 ends the route: with it the first waypoint alone would be a good plan, so the route message
        // names waypoint 0.
        if number == 0 {
            bad.head = Some(route_head(&bad.route, 0, 2));
            bad.points.remove(0);
        }
        let found = load(t, &a, &bad)?;
        let came = download(t, &a, &bad.mission)?.messages;
        let kept = came
            .iter()
            .any(|seen| seen.kind() == 13002 && seen.raw("Waypoint Number") == Some(number));
        t.expect(!kept, || {
            format!(
                "expected no waypoint {number} aboard; the download has one (14000 status {:?})",
                found.status
            )
        })?;
        t.expect(number == 0 || found.status != Some(1), || {
            format!("expected a route through waypoint {number} to be refused; 14000 status 1 came")
        })?;
        loaded(t, &a, &plan)?;
    }
    Ok(())
}

fn a_route_with_a_gap_is_refused(t: &Trial) -> Judged {
    let (a, plan) = with_plan(t, &[1, 2, 3])?;
    let home = home(t, &a)?;
    let mut bad = Plan::zigzag(&home, "GAP", &[21, 22, 23]);
    bad.points.remove(1);
    let mark = t.bench.net.mark();
    refused(t, &a, &plan, &bad, "a Next Waypoint that was never sent")?;
    for seen in a.received(mark, |seen| seen.kind() == 14000) {
        let named = seen.raw("Waypoint Request").unwrap_or_default();
        let ended = seen.text("Mission ID").as_deref() == Some("GAP");
        t.expect_of(&seen, !ended || matches!(named, 0 | 22 | 65_535), || {
            format!("expected waypoint 22, which is missing, or none as Waypoint Request of 14000; got {named}")
        })?;
    }
    // The route message names a missing waypoint too.
    let mut headless = Plan::zigzag(&home, "GAP2", &[24, 25]);
    headless.head = Some(route_head(&headless.route, 26, 2));
    refused(
        t,
        &a,
        &plan,
        &headless,
        "an Initial Waypoint that was never sent",
    )
}

fn a_refused_upload_leaves_the_old_plan(t: &Trial) -> Judged {
    let (a, plan) = with_plan(t, &[1, 2, 3])?;
    let home = home(t, &a)?;
    // Waypoint 97 is in no plan of this run: a subject that edits plans in part cannot have it from an earlier one.
    let mut gap = Plan::zigzag(&home, "BAD1", &[1, 2]);
    gap.points[1] = gap.points[1].clone().raw("Next Waypoint", 97);
    refused(
        t,
        &a,
        &plan,
        &gap,
        "a gap, under the numbers of the plan aboard",
    )?;
    let mut latitude = Plan::zigzag(&home, "BAD2", &[1, 2]);
    latitude.points[1] = latitude.points[1]
        .clone()
        .set("Waypoint to Latitude or Relative Y", 1.7);
    refused(t, &a, &plan, &latitude, "a latitude beyond 90 degrees")?;
    let mut far = Plan::zigzag(&home, "BAD3", &[1, 2]);
    let (north, east) = home.offset(-3_000_000.0, 2_000_000.0);
    far.points[1] = far.points[1]
        .clone()
        .set("Waypoint to Latitude or Relative Y", north)
        .set("Waypoint to Longitude or Relative X", east);
    refused(t, &a, &plan, &far, "a waypoint 3,600 km away")?;
    a.release()?;
    a_refusal_does_not_end_the_flight(t)
}

/// A refused upload does not end the flight of the loaded route.
fn a_refusal_does_not_end_the_flight(t: &Trial) -> Judged {
    if !t
        .bench
        .flight_released
        .load(std::sync::atomic::Ordering::SeqCst)
    {
        return Ok(());
    }
    let Ok(a) = airborne(t) else { return Ok(()) };
    let home = home(t, &a)?;
    let mut plan = Plan::zigzag(&home, "FLOWN", &[1, 2, 3]);
    stretch(&home, &mut plan, 900.0);
    loaded(t, &a, &plan)?;
    a.send(mode_command(mode::WAYPOINT).acked());
    if !mode_becomes(&a, mode::WAYPOINT, t.timers().begin)? {
        t.note("not judged in flight: mode 11 was not entered");
        return Ok(());
    }
    let to = to_number(&a)?;
    let mut gap = Plan::zigzag(&home, "BAD4", &[5, 6]);
    gap.points[1] = gap.points[1].clone().raw("Next Waypoint", 97);
    let found = load(t, &a, &gap)?;
    t.pause(t.timers().answer / 2)?;
    let (shown, still) = (reported_mode(&a)?, to_number(&a)?);
    hold(t, &a)?;
    if found.status == Some(1) {
        return Err(Stop::fail(
            "expected 14000 status 2 for a route with a gap while another is flown; got 1",
        ));
    }
    t.expect(shown == Some(mode::WAYPOINT) && still == to, || {
        format!("expected mode 11 and To {to:?} to stay when an upload is refused in flight; 3001 shows {shown:?}, 4001 {still:?}")
    })?;
    aboard(
        t,
        &a,
        &plan,
        "unchanged by an upload that was refused in flight",
    )
}

fn download_returns_what_was_uploaded(t: &Trial) -> Judged {
    let a = t.controller()?;
    let home = home(t, &a)?;
    clear(t, &a)?;
    let mut plan = Plan::zigzag(&home, "VALUES", &[10, 40, 20, 65_534]);
    // A name of the full length: a subject that keeps fewer characters returns a different one.
    plan.route = "R-VALUES-TO-THE-NORTH".to_owned();
    plan.head = Some(route_head(&plan.route, 10, 2));
    for (index, point) in plan.points.iter_mut().enumerate() {
        // Values that do not survive a float of 32 bits, degrees times 1e7, or whole metres.
        *point = point
            .clone()
            .set(
                "Waypoint to Altitude",
                home.altitude + 47.14 + 3.34 * index as f64,
            )
            .set("Waypoint to Speed", 4.0 + 0.5 * index as f64)
            .raw("Turn Type", (index % 2) as i64);
    }
    plan.points.insert(
        2,
        Draft::new(13003)
            .raw("Waypoint Number", 40)
            .raw("Waypoint Loiter Type", 1)
            .set("Loiter Radius", 120.0)
            .raw("Loiter Direction", 1)
            .raw("Loiter Duration", 60)
            .raw("Loiter Duration Units", 0),
    );
    // First with every field that a lawful vehicle may lack; without them where that is refused.
    let mut rich = plan.clone();
    for (index, point) in rich.points.iter_mut().enumerate() {
        if point.message_type == 13002 && !t.of_edition_25() {
            *point = point
                .clone()
                .raw("Altitude Change Behaviour", (index % 2) as i64)
                .raw("Optional Messages for Waypoint", 0)
                .raw("Waypoint Type", 0)
                .raw("Limit Type", 0)
                .raw("Loop Limit", 0);
        }
    }
    let mut found = load(t, &a, &rich)?;
    if found.status == Some(1) {
        plan = rich;
    } else {
        clear(t, &a)?;
        found = load(t, &a, &plan)?;
    }
    if found.status != Some(1) {
        return Err(Stop::inconclusive(format!(
            "the plan with a loiter waypoint was not loaded: 14000 status {:?}",
            found.status
        )));
    }
    let mark = t.bench.net.mark();
    let found = download(t, &a, "VALUES")?;
    t.expect(found.status == Some(1), || {
        format!(
            "expected 14000 status 1 at the end of the download, got {:?}",
            found.status
        )
    })?;
    each_message_comes_once(t, &found, mark)?;
    if let Some(difference) = difference(&plan, &found, &t.bench) {
        return Err(Stop::fail(format!(
            "expected the download to return the uploader's values; {difference}"
        )));
    }
    let head = found.messages.iter().find(|seen| seen.kind() == 13001);
    let Some(head) = head else {
        return Err(Stop::fail("expected 13001 in the download; none came"));
    };
    let sent = plan.head.as_ref();
    for name in ["Initial Waypoint Number", "Route Type"] {
        let expected = sent.and_then(|sent| field(sent, name));
        t.expect_of(head, head.raw(name) == expected, || {
            format!(
                "expected 13001 as it was uploaded; {name} is {:?}, expected {expected:?}",
                head.raw(name)
            )
        })?;
    }
    let route = head.text("Route ID");
    t.expect_of(head, route.as_deref() == Some(plan.route.as_str()), || {
        format!("expected Route ID {:?} back, got {route:?}", plan.route)
    })?;
    values_that_may_be_refused(t, &a, &plan)?;
    if load(t, &a, &plan)?.status != Some(1) {
        return Err(Stop::inconclusive("the plan was not loaded a second time"));
    }
    // A second download returns the same.
    let again = download(t, &a, "VALUES")?;
    if let Some(difference) = difference(&plan, &again, &t.bench) {
        return Err(Stop::fail(format!(
            "expected a second download to return the uploader's values; {difference}"
        )));
    }
    Ok(())
}

/// One command is answered once; the same message by multicast and unicast, or doubled by the network, counts as one.
fn each_message_comes_once(t: &Trial, found: &Transfer, mark: usize) -> Judged {
    let commands = t.bench.net.recording().datagrams[mark..]
        .iter()
        .flat_map(|datagram| &datagram.messages)
        .filter(|seen| seen.direction == Direction::Sent && seen.kind() == 13000)
        .count();
    let mut stamps: BTreeMap<(u16, Option<i64>), BTreeSet<i64>> = BTreeMap::new();
    for seen in &found.messages {
        if let (13002 | 13003, Some(stamp)) = (seen.kind(), seen.stamp()) {
            let key = (seen.kind(), seen.raw("Waypoint Number"));
            stamps.entry(key).or_default().insert(stamp);
        }
    }
    let most = stamps.iter().max_by_key(|(_, stamps)| stamps.len());
    t.expect(
        most.is_none_or(|(_, stamps)| stamps.len() <= commands),
        || {
            let ((kind, number), stamps) = most.unwrap_or((&(0, None), const { &BTreeSet::new() }));
            format!(
                "expected each message once in a download, got {} of {kind} of waypoint {}",
                stamps.len(),
                number.unwrap_or_default()
            )
        },
    )
}

/// A waypoint with a value that a lawful vehicle may refuse: where it is accepted, it comes back as it was sent, and
/// not as the vehicle rounds it.
fn values_that_may_be_refused(t: &Trial, a: &Station, plan: &Plan) -> Judged {
    type Change = fn(Draft) -> Draft;
    let cases: [(&str, Change); 4] = [
        ("an altitude above ground", |point| {
            point
                .raw("Waypoint Altitude Type", 2)
                .set("Waypoint to Altitude", 61.24)
        }),
        ("an altitude above the sea", |point| {
            point.raw("Waypoint Altitude Type", 1)
        }),
        ("an indicated airspeed", |point| {
            point
                .raw("Waypoint Speed Type", 0)
                .set("Waypoint to Speed", 7.5)
        }),
        ("no speed", |point| point.set("Waypoint to Speed", 0.0)),
    ];
    for (what, change) in cases {
        let mut other = plan.clone();
        if let Some(point) = other
            .points
            .iter_mut()
            .rev()
            .find(|point| point.message_type == 13002)
        {
            *point = change(point.clone());
        }
        clear(t, a)?;
        if load(t, a, &other)?.status != Some(1) {
            t.note(format!("a waypoint with {what} is refused"));
            continue;
        }
        let found = download(t, a, &other.mission)?;
        if let Some(difference) = difference(&other, &found, &t.bench) {
            return Err(Stop::fail(format!(
                "expected a waypoint with {what} back as it was uploaded; {difference}"
            )));
        }
    }
    clear(t, a)
}

fn route_type_and_its_default(t: &Trial) -> Judged {
    let a = t.controller()?;
    let home = home(t, &a)?;
    clear(t, &a)?;
    let mut plan = Plan::zigzag(&home, "TYPES", &[1, 2]);
    // The contingency route is kept beside the flight route.
    let contingency = Plan::zigzag(&home, "TYPES", &[101, 102]);
    plan.points.push(route_head("R-CONT", 101, 3));
    let extra = contingency.points.clone();
    plan.points.extend(extra);
    let found = load(t, &a, &plan)?;
    if found.status != Some(1) {
        return Err(Stop::inconclusive(format!(
            "a flight route and a contingency route were not loaded together: 14000 status {:?}",
            found.status
        )));
    }
    let found = download(t, &a, "TYPES")?;
    for (route, kind) in [(plan.route.as_str(), 2), ("R-CONT", 3)] {
        let back = found
            .messages
            .iter()
            .find(|seen| seen.kind() == 13001 && seen.text("Route ID").as_deref() == Some(route));
        let back_kind = back.and_then(|seen| seen.raw("Route Type"));
        t.expect(back_kind == Some(kind), || {
            format!("expected route {route} back with type {kind}, got {back_kind:?}")
        })?;
        let first = if kind == 2 { 1 } else { 101 };
        let back_first = back.and_then(|seen| seen.raw("Initial Waypoint Number"));
        t.expect(back_first == Some(first), || {
            format!("expected route {route} back with initial waypoint {first}, got {back_first:?}")
        })?;
    }
    // The other route types, where the vehicle accepts them.
    for (route, first, kind) in [
        ("R-LAUNCH", 201, 0),
        ("R-APPROACH", 203, 1),
        ("R-CONT-B", 205, 4),
    ] {
        clear(t, &a)?;
        let mut plan = Plan::zigzag(&home, "TYPES", &[1, 2]);
        let other = Plan::zigzag(&home, "TYPES", &[first, first + 1]);
        plan.points.push(route_head(route, first, kind));
        plan.points.extend(other.points);
        if load(t, &a, &plan)?.status != Some(1) {
            t.note(format!("a route of type {kind} is refused"));
            continue;
        }
        let found = download(t, &a, "TYPES")?;
        let back = found
            .messages
            .iter()
            .find(|seen| seen.kind() == 13001 && seen.text("Route ID").as_deref() == Some(route));
        let back_kind = back.and_then(|seen| seen.raw("Route Type"));
        t.expect(back_kind == Some(kind), || {
            format!("expected route {route} back with type {kind}, got {back_kind:?}")
        })?;
    }
    // Without a route message it is a flight route.
    clear(t, &a)?;
    let mut plain = Plan::zigzag(&home, "PLAIN", &[1, 2, 3]);
    plain.head = None;
    let found = load(t, &a, &plain)?;
    if found.status != Some(1) {
        return Err(Stop::fail(format!(
            "expected waypoints without a 13001 to be a route of type flight; 14000 status {:?} came",
            found.status
        )));
    }
    let found = download(t, &a, "PLAIN")?;
    let kind = found
        .messages
        .iter()
        .find(|seen| seen.kind() == 13001)
        .map(|seen| seen.raw("Route Type"));
    t.expect(kind.is_none() || kind == Some(Some(2)), || {
        format!("expected route type 2 for waypoints without a 13001, got {kind:?}")
    })
}

fn deleting_a_route_keeps_its_waypoints(t: &Trial) -> Judged {
    let (a, plan) = with_plan(t, &[1, 2, 3])?;
    deliver(&a, route_head(&plan.route, 0, 2));
    let found = run_transfer(t, &a, transfer(2, &plan.mission), t.timers().load)?;
    let back = download(t, &a, &plan.mission)?;
    let kept = back.messages.iter().any(|seen| {
        seen.kind() == 13001
            && seen.text("Route ID").as_deref() == Some(plan.route.as_str())
            && seen.raw("Initial Waypoint Number") != Some(0)
    });
    if found.status == Some(1) {
        t.expect(!kept, || {
            format!(
                "expected no 13001 of {} after its deletion; it came back",
                plan.route
            )
        })?;
    } else {
        t.note("a load without any route is refused");
    }
    let waypoints = back
        .messages
        .iter()
        .filter(|seen| seen.kind() == 13002)
        .count();
    t.expect(waypoints >= 3, || format!("expected all three waypoints still there after the deletion of their route, got {waypoints}"))
}

fn unflyable_waypoints_are_refused(t: &Trial) -> Judged {
    let (a, plan) = with_plan(t, &[1, 2, 3])?;
    let home = home(t, &a)?;
    type Change = fn(Draft) -> Draft;
    let cases: [(&str, Change); 4] = [
        ("an altitude of 150 km", |point| {
            point.set("Waypoint to Altitude", 150_000.0)
        }),
        ("altitude type 9", |point| {
            point.raw("Waypoint Altitude Type", 9)
        }),
        ("location type 7", |point| point.raw("Location Type", 7)),
        ("a speed of 32 km/s", |point| {
            point.set("Waypoint to Speed", 32_000.0)
        }),
    ];
    for (index, (what, change)) in cases.into_iter().enumerate() {
        let mut bad = Plan::zigzag(&home, &format!("UNFLY{index}"), &[31, 32, 33]);
        bad.points[1] = change(bad.points[1].clone());
        let mark = t.bench.net.mark();
        refused(t, &a, &plan, &bad, what)?;
        let named = a.received(mark, |seen| {
            seen.kind() == 16000 && seen.text("Text").is_some_and(|text| text.contains("32"))
                || seen.kind() == 14000 && seen.raw("Waypoint Request") == Some(32)
        });
        if named.is_empty() {
            t.warn(format!(
                "neither 14000 nor a 16000 names waypoint 32, the one with {what}"
            ));
        }
    }
    // The finer fields only have to be checked: a refusal of any of them is enough.
    let loiter = |field: &str, value: i64| {
        Draft::new(13003)
            .raw("Waypoint Number", 32)
            .raw("Waypoint Loiter Type", 1)
            .set("Loiter Radius", 120.0)
            .raw("Loiter Direction", 1)
            .raw("Loiter Duration", 60)
            .raw("Loiter Duration Units", 0)
            .raw(field, value)
    };
    for (what, extra) in [
        (
            "a loiter of type 200",
            Some(loiter("Waypoint Loiter Type", 200)),
        ),
        ("turn type 9", None),
    ] {
        let mut bad = Plan::zigzag(&home, "FINER", &[31, 32, 33]);
        match extra {
            Some(extra) => bad.points.insert(2, extra),
            None => bad.points[1] = bad.points[1].clone().raw("Turn Type", 9),
        }
        let found = load(t, &a, &bad)?;
        t.expect(found.status != Some(1), || {
            format!("expected 14000 status 2 for a route with {what}; got 1")
        })?;
    }
    a.send(transfer(5, "FINER"));
    Ok(())
}
