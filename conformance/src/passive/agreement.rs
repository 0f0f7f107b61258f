//! Judges of two things that have to agree: two reports of one state, a report and the time it was taken, an answer
//! and the CUCS that requested it, a value and the profile.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;
use std::time::Duration;

use stanag_msgs::Id;

use super::view::{Ends, Found, Judge, Tally, View, ends};
use crate::bench::fix::Fix;
use crate::wire::{Direction, Seen};

pub(super) const JUDGES: &[Judge] = &[
    Judge {
        rule: "STAT-007",
        judge: motion_is_reported_alike,
    },
    Judge {
        rule: "PV-005",
        judge: fields_do_not_come_and_go,
    },
    Judge {
        rule: "TIME-003",
        judge: positions_are_as_new_as_their_stamps,
    },
    Judge {
        rule: "STAT-012",
        judge: no_ground_state_in_flight,
    },
    Judge {
        rule: "ALERT-003",
        judge: alerts_have_a_text_and_a_time,
    },
    Judge {
        rule: "PAYL-005",
        judge: limits_of_the_camera,
    },
    Judge {
        rule: "PAYL-007",
        judge: the_image_is_on_the_ground,
    },
    Judge {
        rule: "AUTH-016",
        judge: the_answer_names_the_request,
    },
    Judge {
        rule: "WRAP-016",
        judge: acknowledgements_and_alerts_are_the_vehicles,
    },
    Judge {
        rule: "CONF-001",
        judge: configuration_for_who_asked,
    },
    Judge {
        rule: "DISC-009",
        judge: the_tail_number_of_the_profile,
    },
    Judge {
        rule: "DISC-009",
        judge: one_tail_number_at_a_time,
    },
];

/// 4000 and 3009 report one motion: the bank is to the side of the turn, and climb rate and airspeed agree.
fn motion_is_reported_alike(view: &View<'_>, found: &mut Found) {
    let mut latest: BTreeMap<Ends, Arc<Seen>> = BTreeMap::new();
    let (mut banks, mut climbs, mut speeds) =
        (Tally::default(), Tally::default(), Tally::default());
    for seen in view.messages() {
        if seen.kind() == 4000 {
            if let (Some(roll), Some(turn), Some(fix)) =
                (seen.value("Roll"), seen.value("Turn Rate"), Fix::of(seen))
                && roll.abs() > 0.08
                && turn.abs() > 0.08
                && fix.north.hypot(fix.east) > 4.0
            {
                banks.look(seen, roll * turn > 0.0);
            }
            latest.insert(ends(seen), seen.clone());
        }
        let Some(fix) = (seen.kind() == 3009)
            .then(|| latest.get(&ends(seen)))
            .flatten()
            .filter(|motion| seen.at.abs_diff(motion.at).as_millis() < 400)
            .and_then(|motion| Fix::of(motion))
        else {
            continue;
        };
        if let Some(rate) = seen.value("Barometric Altitude Rate")
            && rate.abs() > 1.0
            && fix.down.abs() > 1.0
        {
            climbs.look(seen, rate * fix.down < 0.0);
        }
        let (Some(air), Some(north), Some(east)) = (
            seen.value("True Airspeed"),
            seen.value("U_Wind"),
            seen.value("V_Wind"),
        ) else {
            continue;
        };
        let through = (fix.north - north).hypot(fix.east - east);
        if through > 4.0 && air > 0.0 {
            speeds.look(seen, (air / through - 1.0).abs() < 0.4);
        }
    }
    banks.judge(
        found,
        8,
        "expected Roll and Turn Rate of 4000 to the same side in a turn in flight, right wing down to the right; they are opposed",
    );
    climbs.judge(
        found,
        2,
        "expected Barometric Altitude Rate of 3009 up where W_Speed of 4000 is up; they are opposed",
    );
    speeds.judge(
        found,
        2,
        "expected True Airspeed of 3009 to be the speed of 4000 less the wind of 3009; it differs by more than 40 %",
    );
}

/// A field of 4000 that is present in one message, absent in the next, and so on, is left out because of its value
/// (0, say). While the position is known, the other fields of the motion are known too.
fn fields_do_not_come_and_go(view: &View<'_>, found: &mut Found) {
    // Changes of a field that are no fault yet.
    const MAX_CHANGES: usize = 3;
    // After a gap in the vehicle's data its fields return one after the other.
    const GAP: Duration = Duration::from_millis(1_500);
    // How long after a gap changes are not counted.
    const SETTLED: Duration = Duration::from_secs(5);
    let mut last: BTreeMap<u32, (u64, Duration)> = BTreeMap::new();
    let mut settled: BTreeMap<u32, Duration> = BTreeMap::new();
    let mut changes: BTreeMap<(u32, u8), usize> = BTreeMap::new();
    for seen in view
        .messages()
        .filter(|seen| seen.kind() == 4000 && seen.original.is_none() && seen.has("Latitude"))
    {
        let Some(info) = seen.info else { continue };
        let source = seen.piece.source.0;
        let width = usize::from(info.presence_bytes).min(seen.piece.data.len());
        let vector = seen.piece.data[..width]
            .iter()
            .fold(0_u64, |bits, &byte| bits << 8 | u64::from(byte));
        let (before, at) = last
            .insert(source, (vector, seen.at))
            .unwrap_or((vector, seen.at));
        if seen.at.saturating_sub(at) > GAP {
            settled.insert(source, seen.at + SETTLED);
        }
        if settled
            .get(&source)
            .is_some_and(|&settled| seen.at < settled)
        {
            continue;
        }
        for field in info.fields {
            if (before ^ vector) >> field.bit & 1 == 0 {
                continue;
            }
            let count = changes.entry((source, field.bit)).or_default();
            *count += 1;
            found.check(seen, *count <= MAX_CHANGES, || {
                format!("expected 4000 with all fields that the vehicle has, since partial vectors were not allowed; {} comes and goes", field.name)
            });
        }
    }
}

/// Where the speeds of a report show motion, a position with a later stamp has to differ from the one before.
fn positions_are_as_new_as_their_stamps(view: &View<'_>, found: &mut Found) {
    /// The longest time between samples of a slow vehicle link, ms.
    const BETWEEN_MS: i64 = 900;
    let mut last: BTreeMap<Ends, (i64, [Option<i64>; 2])> = BTreeMap::new();
    for seen in view.messages().filter(|seen| seen.kind() == 4000) {
        let (Some(stamp), Some(fix)) = (seen.stamp(), Fix::of(seen)) else {
            continue;
        };
        let place = ["Latitude", "Longitude"].map(|name| seen.raw(name));
        let moves = fix.north.hypot(fix.east) > 3.0;
        let before = last.entry(ends(seen)).or_insert((stamp, place));
        if !moves || before.1 != place || stamp < before.0 {
            *before = (stamp, place);
            continue;
        }
        let still = stamp - before.0;
        found.check(seen, still < BETWEEN_MS, || {
            format!(
                "expected a position of the time of its stamp; it is the same for {still} ms of stamps while the speed is {:.0} m/s",
                fix.north.hypot(fix.east)
            )
        });
    }
}

/// UA State 1 to 4 are states before a launch, so they contradict a report of flight.
fn no_ground_state_in_flight(view: &View<'_>, found: &mut Found) {
    let mut flying: BTreeMap<Ends, u32> = BTreeMap::new();
    for seen in view.messages() {
        match seen.kind() {
            4000 => {
                let Some(fix) = Fix::of(seen) else { continue };
                let count = flying.entry(ends(seen)).or_default();
                *count = if fix.north.hypot(fix.east) > 3.0 {
                    *count + 1
                } else {
                    0
                };
            }
            3002 => {
                let Some(state) = seen.raw("UA State") else {
                    continue;
                };
                if flying.get(&ends(seen)).is_some_and(|&count| count > 3) {
                    found.check(seen, !(1..=4).contains(&state), || {
                        format!("expected no UA State of before the launch (1 to 4) in 3002 while 4000 shows flight; got {state}")
                    });
                }
            }
            _ => {}
        }
    }
}

fn alerts_have_a_text_and_a_time(view: &View<'_>, found: &mut Found) {
    for seen in view.messages().filter(|seen| seen.kind() == 16000) {
        let Some(priority) = seen.raw("Priority").filter(|&priority| priority >= 2) else {
            continue;
        };
        // An alert with a reference may leave the details to the state report that the reference names.
        let more = seen
            .raw("Subsystem State Report Reference")
            .is_some_and(|reference| reference >= 0);
        if let Some(text) = seen.text("Text").filter(|_| !more) {
            found.check(seen, !text.is_empty(), || {
                format!("expected an alert of priority {priority} to say what happened; its text is empty")
            });
        }
        if seen.raw("Type") == Some(3)
            && let Some(time) = seen.raw("Persistence")
        {
            found.check(seen, time != 0, || {
                "expected an alert that is shown for a time (type 3) to name the time; its Persistence is 0".into()
            });
        }
    }
}

fn limits_of_the_camera(view: &View<'_>, found: &mut Found) {
    for seen in view.messages().filter(|seen| seen.kind() == 21100) {
        for part in ["Elevation", "Azimuth"] {
            let end = |name: &str| seen.raw(&format!("Field of Regard - {part} {name}"));
            if let (Some(low), Some(high)) = (end("Min"), end("Max")) {
                found.check(seen, low <= high, || {
                    format!("expected Field of Regard - {part} Min not above Max in 21100; got {low} and {high}")
                });
            }
        }
    }
}

/// What a camera sees below the horizon lies below the aircraft.
fn the_image_is_on_the_ground(view: &View<'_>, found: &mut Found) {
    let mut latest: BTreeMap<Ends, Fix> = BTreeMap::new();
    for seen in view.messages() {
        if seen.kind() == 4000
            && let Some(fix) = Fix::of(seen)
        {
            latest.insert(ends(seen), fix);
        }
        if seen.kind() != 21101 || seen.raw("Image Position") == Some(0) {
            continue;
        }
        let (Some(ground), Some(elevation), Some(vehicle)) = (
            seen.value("Altitude"),
            seen.value("Actual Centreline Elevation Angle"),
            latest.get(&ends(seen)),
        ) else {
            continue;
        };
        // Only with altitude type 3: 21101 names no datum, and the other types of 4000 may differ from it by more
        // than the 5 m that are allowed here.
        if elevation < -0.1 && vehicle.altitude_type == 3 {
            found.check(seen, ground < vehicle.altitude + 5.0, || {
                format!(
                    "expected the image centre of a camera that looks down below the vehicle; it is at {ground:.0} m, the vehicle at {:.0} m",
                    vehicle.altitude
                )
            });
        }
    }
}

/// Access Requested of #2 is that of the #1 that it answers.
fn the_answer_names_the_request(view: &View<'_>, found: &mut Found) {
    let mut requests: BTreeMap<Ends, (i64, Duration)> = BTreeMap::new();
    let mut answers = Tally::default();
    for seen in view
        .datagrams
        .iter()
        .flat_map(|datagram| &datagram.messages)
    {
        match (seen.direction, seen.kind()) {
            (Direction::Sent, 1) => {
                let access = seen.raw("Requested/Handover Access").unwrap_or_default();
                requests.insert(ends(seen), (access, seen.at));
            }
            (Direction::Received, 2) => {
                let key = (seen.piece.destination.0, seen.socket);
                // Only soon after the request: a later #2 may report something else. An access of 0 is not compared:
                // some subjects mean "none" by it.
                if let (Some(named), Some((asked, at))) =
                    (seen.raw("Access Requested"), requests.remove(&key))
                    && asked != 0
                    && seen.at.abs_diff(at) < Duration::from_millis(500)
                {
                    answers.look(seen, named == asked);
                }
            }
            _ => {}
        }
    }
    answers.judge(
        found,
        3,
        "expected #2 to name in Access Requested what the request that it answers has in Requested/Handover Access",
    );
}

fn acknowledgements_and_alerts_are_the_vehicles(view: &View<'_>, found: &mut Found) {
    let (vehicles, vsm_ids) = (view.vehicles(), view.vsm_ids());
    let only_vsm = |id: &Id| vsm_ids.contains(id) && !vehicles.contains(id);
    let mut addressed: BTreeMap<(u32, i64, i64), BTreeSet<Id>> = BTreeMap::new();
    for seen in view.requests().filter(|seen| seen.piece.ack()) {
        let stamp = seen.stamp().unwrap_or_default();
        addressed
            .entry((seen.piece.source.0, seen.kind().into(), stamp))
            .or_default()
            .insert(seen.piece.destination);
    }
    for seen in view.messages() {
        let source = seen.piece.source;
        match seen.kind() {
            17000 => {
                let key = seen
                    .raw("Original Message Type")
                    .zip(seen.raw("Original Message Time Stamp"))
                    .map(|(kind, stamp)| (seen.piece.destination.0, kind, stamp));
                let Some(to) = key.and_then(|key| addressed.get(&key)) else {
                    continue;
                };
                let to_vehicles = to.iter().all(|id| vehicles.contains(id));
                found.check(seen, !to_vehicles || !only_vsm(&source), || {
                    format!("expected 17000 from the vehicle that was addressed; it came from the VSM's id {source}")
                });
            }
            16000 => {
                // The VSM may report on itself: subsystem 9.
                let own = seen
                    .raw("Subsystem ID")
                    .is_none_or(|subsystem| subsystem == 9);
                if !own && only_vsm(&source) {
                    found.warn(seen, format!("an alert about a part of a vehicle comes from the VSM's id {source}: which vehicle it is about is not known"));
                }
            }
            _ => {}
        }
    }
}

/// A configuration phase is sent to the CUCS that began it, and ends once.
fn configuration_for_who_asked(view: &View<'_>, found: &mut Found) {
    let mut asked: BTreeMap<(u32, u32), usize> = BTreeMap::new();
    let mut ended: BTreeMap<(u32, u32), BTreeSet<i64>> = BTreeMap::new();
    let mut askers = BTreeSet::new();
    // A recording may begin within a configuration phase, and without what began it.
    let begun_before = |asked: bool| !asked && !view.live;
    for seen in view
        .datagrams
        .iter()
        .flat_map(|datagram| &datagram.messages)
    {
        let (source, destination) = (seen.piece.source.0, seen.piece.destination.0);
        match (seen.direction, seen.kind()) {
            (Direction::Sent, 40_000) => {
                askers.insert(source);
                *asked.entry((destination, source)).or_default() += 1;
            }
            // Vehicle-specific values (41002) are described to every CUCS that is sent them.
            (Direction::Received, kind @ (41_000 | 41_001 | 41_003 | 41_005))
                if seen.piece.destination != Id::BROADCAST
                    && !begun_before(askers.contains(&destination)) =>
            {
                found.check(seen, askers.contains(&destination), || {
                    format!("expected the configuration ({kind}) at CUCSs that sent 40000 only; it came to {}", seen.piece.destination)
                });
                if kind == 41_005 {
                    let key = (source, destination);
                    let ends = ended.entry(key).or_default();
                    ends.insert(seen.stamp().unwrap_or_default());
                    let (ends, asked) = (ends.len(), asked.get(&key).copied().unwrap_or_default());
                    found.check(seen, asked == 0 || ends <= asked, || {
                        format!("expected one 41005 to each 40000; {ends} came to {asked}")
                    });
                }
            }
            _ => {}
        }
    }
}

fn the_tail_number_of_the_profile(view: &View<'_>, found: &mut Found) {
    for seen in view.messages().filter(|seen| seen.kind() == 3) {
        let claim = view
            .profile
            .vehicle
            .iter()
            .find(|claim| claim.id.parse() == Ok(seen.piece.source));
        let (Some(expected), Some(named)) = (
            claim.and_then(|claim| claim.tail_number.as_ref()),
            seen.text("Tail Number"),
        ) else {
            continue;
        };
        // A logical id is named by "0".
        found.check(seen, named == *expected || named == "0", || {
            format!("expected the tail number {expected:?} of the profile in #3, got {named:?}")
        });
    }
}

/// A vehicle may be given another tail number, but one that returns to a number before it has two at once.
fn one_tail_number_at_a_time(view: &View<'_>, found: &mut Found) {
    let mut known: BTreeMap<u32, Vec<String>> = BTreeMap::new();
    for seen in view.messages().filter(|seen| seen.kind() == 3) {
        let named = seen.text("Tail Number").unwrap_or_default();
        // A logical id is named by "0".
        if ["", "0"].contains(&named.as_str()) {
            continue;
        }
        let numbers = known.entry(seen.piece.source.0).or_default();
        let place = numbers.iter().position(|number| *number == named);
        let last = numbers.len().saturating_sub(1);
        found.check(seen, place.is_none_or(|place| place == last), || {
            format!(
                "expected one tail number of {} in #3; it is {named:?} again after others",
                seen.piece.source
            )
        });
        if place.is_none() {
            numbers.push(named);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bench::net::Datagram;
    use crate::verdict::Verdict;
    use crate::wire::Draft;

    fn verdict(tail_numbers: &[&str]) -> Verdict {
        let datagrams: Vec<Datagram> = tail_numbers
            .iter()
            .map(|named| {
                let bytes = Draft::new(3).text("Tail Number", named.as_bytes()).encode(
                    Id(0x1b00_0101),
                    Id(0x1b00_00a0),
                    32,
                    1,
                );
                let at = Duration::ZERO;
                let ends = (([127, 0, 0, 1], 1).into(), ([127, 0, 0, 1], 2).into());
                Datagram::new((at, at), Direction::Received, 0, ends, bytes, None)
            })
            .collect();
        crate::passive::view::verdict_on(&datagrams, one_tail_number_at_a_time)
    }

    #[test]
    fn a_recording_may_begin_within_a_configuration_phase() {
        use crate::passive::view::trace::{received, sent};
        use crate::passive::view::{verdict_on, verdict_on_recorded};
        let ends = [received(100, Draft::new(41_005))];
        let judge = configuration_for_who_asked;
        assert_eq!(verdict_on(&ends, judge), Verdict::Fail);
        assert_eq!(verdict_on_recorded(&ends, judge), Verdict::Inconclusive);
        // The end of an older phase is none of this one's, which has one.
        let mut all = ends.to_vec();
        all.push(sent(200, Draft::new(40_000)));
        all.push(received(300, Draft::new(41_005)));
        assert_eq!(verdict_on_recorded(&all, judge), Verdict::Pass);
        all.push(received(400, Draft::new(41_005)));
        assert_eq!(verdict_on_recorded(&all, judge), Verdict::Fail);
    }

    #[test]
    fn a_tail_number_may_change_but_not_return() {
        assert_eq!(verdict(&["0", ""]), Verdict::Inconclusive);
        assert_eq!(verdict(&["A1", "0", "A1", "A1"]), Verdict::Pass);
        assert_eq!(verdict(&["A1", "A1", "B2", "B2"]), Verdict::Pass);
        assert_eq!(verdict(&["A1", "A1", "B2", "A1"]), Verdict::Fail);
    }
}
