//! Judges of two things that have to agree: two reports of one state, a report and the time it was taken, an answer
//! and the CUCS that requested it, a value and the profile.

use std::collections::{BTreeMap, BTreeSet};
use std::f64::consts::TAU;
use std::sync::Arc;
use std::time::Duration;

use stanag_msgs::Id;

use super::view::{Ends, Found, History, Judge, Tally, View, ends};
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
            .filter(|motion| of_one_moment(seen, motion))
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

/// Whether two reports are of about one time: both as they came and by their stamps, since what has waited on the way comes together.
fn of_one_moment(one: &Seen, other: &Seen) -> bool {
    const APART_MS: u128 = 400;
    let stamps = one.stamp().zip(other.stamp());
    let apart = stamps.map_or(0, |(one, other)| one.abs_diff(other));
    one.at.abs_diff(other.at).as_millis() < APART_MS && u128::from(apart) < APART_MS
}

/// A field of 4000 that is present in one message, absent in the next, and so on, is left out because of its value
/// (0, say). While the position is known, the other fields of the motion are known too. Each CUCS by itself: one may have
/// been promised less than another.
fn fields_do_not_come_and_go(view: &View<'_>, found: &mut Found) {
    // Changes of a field that are no fault yet, and in which time: in hours of flight a sensor may fail more often.
    const MAX_CHANGES: usize = 3;
    const WITHIN: Duration = Duration::from_secs(60);
    // After a gap in the vehicle's data its fields return one after the other.
    const GAP: Duration = Duration::from_millis(1_500);
    // How long after a gap changes are not counted.
    const SETTLED: Duration = Duration::from_secs(5);
    let promised = Promised::of(view);
    let mut last: BTreeMap<(u32, u32), (u64, Duration)> = BTreeMap::new();
    let mut settled: BTreeMap<(u32, u32), Duration> = BTreeMap::new();
    let mut changes: BTreeMap<((u32, u32), u8), Vec<Duration>> = BTreeMap::new();
    for seen in view
        .in_order()
        .filter(|seen| seen.kind() == 4000 && seen.original.is_none() && seen.has("Latitude"))
    {
        let Some(info) = seen.info else { continue };
        if !promised.full(view, seen) {
            found.missed(format!(
                "{} has said how it takes vectors, has requested some fields of 4000 alone, or its #1 is not in the traffic",
                seen.piece.destination
            ));
            continue;
        }
        let ends = (seen.piece.source.0, seen.piece.destination.0);
        let width = usize::from(info.presence_bytes).min(seen.piece.data.len());
        let vector = seen.piece.data[..width]
            .iter()
            .fold(0_u64, |bits, &byte| bits << 8 | u64::from(byte));
        let (before, at) = last
            .insert(ends, (vector, seen.at))
            .unwrap_or((vector, seen.at));
        if seen.at.saturating_sub(at) > GAP {
            settled.insert(ends, seen.at + SETTLED);
        }
        if settled.get(&ends).is_some_and(|&settled| seen.at < settled) {
            continue;
        }
        for field in info.fields {
            if (before ^ vector) >> field.bit & 1 == 0 {
                continue;
            }
            let times = changes.entry((ends, field.bit)).or_default();
            times.retain(|&time| seen.at.saturating_sub(time) < WITHIN);
            times.push(seen.at);
            found.check(seen, times.len() <= MAX_CHANGES, || {
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

/// Which CUCSs have to be sent full vectors of 4000.
struct Promised {
    /// Those that connected.
    connected: BTreeSet<Id>,
    /// Since when one has said how it takes vectors, as the values of that field are not known, or has requested some fields
    /// alone.
    partial: BTreeMap<Id, Duration>,
}

impl Promised {
    fn of(view: &View<'_>) -> Self {
        let (mut connected, mut partial) = (BTreeSet::new(), BTreeMap::new());
        for seen in view.requests() {
            let some = match seen.kind() {
                1 | 4 => {
                    connected.insert(seen.piece.source);
                    seen.has("Presence Vector Support")
                }
                17_002 => {
                    let fields = seen.raw("Requested Field Presence Vector");
                    seen.raw("Message Type") == Some(4000) && fields.is_some_and(|bits| bits != 0)
                }
                _ => false,
            };
            if some {
                partial.entry(seen.piece.source).or_insert(seen.at);
            }
        }
        Self { connected, partial }
    }

    /// Whether this message has to be full. What goes to everybody goes to all of them. In a recording the #1 in which a CUCS
    /// said it may be missing.
    fn full(&self, view: &View<'_>, seen: &Seen) -> bool {
        let receiver = seen.piece.destination;
        let for_it = |id: &Id| [*id, Id::BROADCAST].contains(&receiver);
        let mut partial = self.partial.iter();
        let said = partial.any(|(id, since)| for_it(id) && *since <= seen.at);
        let known = view.live || self.connected.iter().any(for_it);
        known && !said
    }
}

/// Above the lowest place that was seen a vehicle is in flight, m: one on a runway or a ship is fast as well.
const ALOFT_M: f64 = 10.0;
/// The oldest 4000 by which a 3002 is judged: between older ones a vehicle may have landed.
const FLIES_FOR: Duration = Duration::from_millis(1_500);

/// What 4000 shows of the flight of one vehicle at one socket.
#[derive(Default)]
struct Flying {
    /// Successive 4000s in flight.
    count: u32,
    at: Duration,
}

/// UA State 1 to 4 are states before a launch, so they contradict a report of flight.
fn no_ground_state_in_flight(view: &View<'_>, found: &mut Found) {
    // The lowest altitude of each vehicle and Altitude Type, m: at all sockets, since one may be opened in flight.
    let mut lowest: BTreeMap<(u32, i64), f64> = BTreeMap::new();
    let mut flying: BTreeMap<Ends, Flying> = BTreeMap::new();
    for seen in view.in_order() {
        match seen.kind() {
            4000 => {
                let Some(fix) = Fix::of(seen) else { continue };
                let flying = flying.entry(ends(seen)).or_default();
                let lowest = lowest.entry((seen.piece.source.0, fix.altitude_type));
                let lowest = lowest.or_insert(fix.altitude);
                *lowest = fix.altitude.min(*lowest);
                let flies = fix.north.hypot(fix.east) > 3.0 && fix.altitude > *lowest + ALOFT_M;
                flying.count = if flies { flying.count + 1 } else { 0 };
                flying.at = seen.at;
            }
            3002 => {
                let Some(state) = seen.raw("UA State") else {
                    continue;
                };
                let flies = flying.get(&ends(seen)).is_some_and(|flying| {
                    flying.count > 3 && seen.at.saturating_sub(flying.at) < FLIES_FOR
                });
                if flies {
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

/// How far outside of its azimuth limits a camera is seen to look before they cannot be right, rad.
const OUTSIDE_RAD: f64 = 0.1;

/// Whether a direction lies in the range that goes from one azimuth clockwise to another, perhaps across the tail.
fn lies_between(azimuth: f64, low: f64, high: f64) -> bool {
    let from_low = (azimuth - low).rem_euclid(TAU);
    from_low <= (high - low).rem_euclid(TAU) + OUTSIDE_RAD || from_low >= TAU - OUTSIDE_RAD
}

fn limits_of_the_camera(view: &View<'_>, found: &mut Found) {
    let station = |seen: &Seen| (seen.piece.source, seen.raw("Station Number 1-16"));
    for seen in view.messages().filter(|seen| seen.kind() == 21100) {
        let ends = |part: &str| {
            let end = |name: &str| seen.value(&format!("Field of Regard - {part} {name}"));
            end("Min").zip(end("Max"))
        };
        if let Some((low, high)) = ends("Elevation") {
            found.check(seen, low <= high, || {
                format!("expected Field of Regard - Elevation Min not above Max in 21100; got {low:.3} and {high:.3} rad")
            });
        }
        let Some((low, high)) = ends("Azimuth") else {
            continue;
        };
        found.saw();
        if low <= high {
            continue;
        }
        // A camera at the tail turns across it: only where it looks shows that the limits are exchanged.
        let looks = view
            .messages()
            .filter(|other| other.kind() == 21101 && station(other) == station(seen));
        let mut looks = looks.filter_map(|other| other.value("Actual Centreline Azimuth Angle"));
        if let Some(azimuth) = looks.find(|&azimuth| !lies_between(azimuth, low, high)) {
            found.fail(
                seen,
                format!("expected Field of Regard - Azimuth Min not above Max in 21100, or a camera that looks across the tail; got {low:.3} and {high:.3} rad, and it looks to {azimuth:.3} rad"),
            );
        }
    }
}

/// The oldest 4000 by which an image is judged: in a gap the aircraft may have climbed.
const IMAGED_FROM: Duration = Duration::from_secs(3);

/// How far down a camera looks at least where its image is judged: the sine of the angle below the horizon.
const LOOKS_DOWN: f64 = 0.1;

/// What a camera sees below the horizon lies below the aircraft. Its angles are from the aircraft's axes: in a bank it may look above
/// the horizon with a negative elevation, at a mountain.
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
            (latest.get(&ends(seen))).filter(|fix| seen.at.saturating_sub(fix.at) < IMAGED_FROM),
        ) else {
            continue;
        };
        let level = Fix {
            heading: Some(0.0),
            ..*vehicle
        };
        let azimuth = seen.value("Actual Centreline Azimuth Angle");
        let sight = level.sight(azimuth.unwrap_or_default(), elevation);
        let down = sight.is_some_and(|[_, _, down]| down > LOOKS_DOWN) && elevation < -LOOKS_DOWN;
        // Only with altitude type 3: 21101 names no datum, and the other types of 4000 may differ from it by more
        // than the 5 m that are allowed here.
        if down && vehicle.altitude_type == 3 {
            found.check(seen, ground < vehicle.altitude + 5.0, || {
                format!(
                    "expected the image centre of a camera that looks down below the vehicle; it is at {ground:.0} m, the vehicle at {:.0} m",
                    vehicle.altitude
                )
            });
        }
    }
}

/// How soon a #2 is taken for the answer to a #1.
const ANSWERED_WITHIN: Duration = Duration::from_millis(500);

/// Access Requested of #2 is that of the #1 that it answers.
fn the_answer_names_the_request(view: &View<'_>, found: &mut Found) {
    // By vehicle: a CUCS may request several at once.
    let mut requests: BTreeMap<(Ends, Id), (i64, Duration)> = BTreeMap::new();
    let mut answers = Tally::default();
    for seen in view
        .datagrams
        .iter()
        .flat_map(|datagram| &datagram.messages)
    {
        match (seen.direction, seen.kind()) {
            (Direction::Sent, 1) => {
                let access = seen.raw("Requested/Handover Access").unwrap_or_default();
                let key = (ends(seen), seen.piece.destination);
                let before = requests.insert(key, (access, seen.at));
                // Two at once: which of them an answer is to is not known.
                if before.is_some_and(|(other, at)| {
                    other != access && seen.at.abs_diff(at) < ANSWERED_WITHIN
                }) {
                    requests.insert(key, (0, seen.at));
                }
            }
            (Direction::Received, 2) => {
                let key = ((seen.piece.destination.0, seen.socket), seen.piece.source);
                // Only soon after the request: a later #2 may report something else. An access of 0 is not compared:
                // some subjects mean "none" by it.
                if let (Some(named), Some((asked, at))) =
                    (seen.raw("Access Requested"), requests.remove(&key))
                    && asked != 0
                    && seen.at.abs_diff(at) < ANSWERED_WITHIN
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
                if seen.piece.destination != Id::BROADCAST =>
            {
                let key = (source, destination);
                let asked = asked.entry(key).or_default();
                let ends = ended.entry(key).or_default();
                // A recording may be without what began a phase; what comes of the phase shows that it was begun.
                if !view.live && kind != 41_005 && ends.len() >= *asked {
                    *asked += 1;
                }
                if !view.live && *asked == 0 {
                    continue;
                }
                found.check(seen, !view.live || askers.contains(&destination), || {
                    format!("expected the configuration ({kind}) at CUCSs that sent 40000 only; it came to {}", seen.piece.destination)
                });
                if kind == 41_005 {
                    ends.insert(seen.stamp().unwrap_or_default());
                    let (ends, asked) = (ends.len(), *asked);
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
    let mut known: BTreeMap<u32, History<String>> = BTreeMap::new();
    for seen in view.in_order().filter(|seen| seen.kind() == 3) {
        let named = seen.text("Tail Number").unwrap_or_default();
        // A logical id is named by "0".
        if ["", "0"].contains(&named.as_str()) {
            continue;
        }
        let numbers = known.entry(seen.piece.source.0).or_default();
        let change = numbers.take(named.clone(), seen.at);
        let returns = change.is_some_and(|change| change.returns(view));
        found.check(seen, !returns, || {
            format!(
                "expected one tail number of {} in #3; it is {named:?} again after others",
                seen.piece.source
            )
        });
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
        // It begins within one phase, the next begins before that ends, and of a third the 40000 is missing.
        let phases = [
            received(100, Draft::new(41_003)),
            sent(200, Draft::new(40_000)),
            received(300, Draft::new(41_005)),
            received(400, Draft::new(41_005)),
            received(500, Draft::new(41_003)),
            received(600, Draft::new(41_005)),
        ];
        assert_eq!(verdict_on(&phases, judge), Verdict::Fail);
        assert_eq!(verdict_on_recorded(&phases, judge), Verdict::Pass);
    }

    /// A 4000 to the CUCS with or without its altitude.
    fn position(at_ms: u64, altitude: bool) -> Draft {
        let draft = Draft::new(4000)
            .raw("Time Stamp", at_ms as i64)
            .set("Latitude", 0.8)
            .set("Longitude", 0.1);
        if altitude {
            draft.set("Altitude", 500.0)
        } else {
            draft
        }
    }

    /// What is found where the altitude comes and goes each `every_ms`, after these messages of the CUCS.
    fn altitude_comes_and_goes(every_ms: u64, before: &[Datagram]) -> [Verdict; 2] {
        use crate::passive::view::trace::received;
        let mut run = before.to_vec();
        run.extend((0..600).map(|step| {
            let at_ms = 1_000 + step * 500;
            received(at_ms, position(at_ms, (at_ms / every_ms).is_multiple_of(2)))
        }));
        both(&run, fields_do_not_come_and_go)
    }

    /// What a judge finds in a live run, and in a recording.
    fn both(datagrams: &[Datagram], judge: fn(&View<'_>, &mut Found)) -> [Verdict; 2] {
        use crate::passive::view::{verdict_on, verdict_on_recorded};
        [
            verdict_on(datagrams, judge),
            verdict_on_recorded(datagrams, judge),
        ]
    }

    #[test]
    fn fields_that_come_and_go_are_found_and_a_sensor_that_fails_twice_is_not() {
        use crate::passive::view::trace::sent;
        let connects = [sent(0, Draft::new(1))];
        for every_ms in [500, 2_000, 10_000] {
            let found = altitude_comes_and_goes(every_ms, &connects);
            assert_eq!(found, [Verdict::Fail; 2], "{every_ms}");
        }
        assert_eq!(
            altitude_comes_and_goes(45_000, &connects),
            [Verdict::Pass; 2]
        );
    }

    #[test]
    fn a_cucs_may_have_allowed_partial_vectors() {
        use crate::passive::view::trace::sent;
        let allows = Draft::new(1).raw("Presence Vector Support", 1);
        let some = Draft::new(17_002)
            .raw("Message Type", 4000)
            .raw("Requested Field Presence Vector", 7);
        for before in [allows, some] {
            let run = [sent(0, Draft::new(1)), sent(10, before)];
            let found = altitude_comes_and_goes(500, &run);
            assert_eq!(found, [Verdict::Inconclusive; 2]);
        }
        // Perhaps before the recording.
        let found = altitude_comes_and_goes(500, &[]);
        assert_eq!(found, [Verdict::Fail, Verdict::Inconclusive]);
    }

    #[test]
    fn each_cucs_is_sent_vectors_of_its_own() {
        use crate::passive::view::trace::{received, sent};
        let mut allows = Draft::new(1).raw("Presence Vector Support", 1);
        allows.source = Some(Id(0x1b00_00a1));
        let mut run = vec![sent(0, Draft::new(1)), sent(10, allows)];
        for step in 0..20 {
            let at_ms = 1_000 + step * 500;
            run.push(received(at_ms, position(at_ms, true)));
            let mut other = position(at_ms + 5, false);
            other.destination = Some(Id(0x1b00_00a1));
            run.push(received(at_ms + 5, other));
        }
        let judge = fields_do_not_come_and_go;
        assert_eq!(both(&run, judge), [Verdict::Inconclusive; 2]);
        // Nor is the vector of one compared with that of another where both have to be full.
        run.remove(1);
        assert_eq!(both(&run, judge), [Verdict::Inconclusive; 2]);
    }

    #[test]
    fn a_reordered_pair_around_a_change_is_one_change() {
        use crate::passive::view::trace::{received, sent};
        let of =
            |at_ms: u64, stamp: u64, altitude: bool| received(at_ms, position(stamp, altitude));
        let reordered = [
            sent(0, Draft::new(1)),
            of(1_000, 1_000, true),
            of(1_100, 1_100, true),
            of(1_200, 1_300, false),
            of(1_201, 1_200, true),
            of(1_202, 1_100, true),
            of(1_400, 1_400, false),
            of(1_500, 1_500, true),
        ];
        assert_eq!(
            both(&reordered, fields_do_not_come_and_go),
            [Verdict::Pass; 2]
        );
    }

    #[test]
    fn a_run_on_a_runway_and_a_landing_in_a_gap_are_no_flight() {
        use crate::passive::view::trace::received;
        // At 30 m/s and this height, for 5 s, and a 3002 with "pre-launch" so long after it.
        let judged = |height: f64, after_ms: u64| {
            let mut run: Vec<_> = (0..11)
                .map(|step| {
                    let up = if step == 0 { 0.0 } else { height };
                    let draft = position(step * 500, false)
                        .set("Altitude", 500.0 + up)
                        .set("U_Speed", 30.0);
                    received(step * 500, draft)
                })
                .collect();
            run.push(received(
                5_000 + after_ms,
                Draft::new(3002).raw("UA State", 3),
            ));
            both(&run, no_ground_state_in_flight)
        };
        assert_eq!(judged(30.0, 200), [Verdict::Fail; 2]);
        assert_eq!(judged(2.0, 200), [Verdict::Inconclusive; 2]);
        assert_eq!(judged(30.0, 60_000), [Verdict::Inconclusive; 2]);
    }

    #[test]
    fn a_socket_that_is_opened_in_flight_sees_flight() {
        use crate::passive::view::trace::received;
        let at_socket = |socket: usize, one: &Datagram| {
            let (time, ends) = ((one.at, one.wall), (one.local, one.remote));
            Datagram::new(time, one.direction, socket, ends, one.bytes.clone(), None)
        };
        let moves = |at_ms: u64, altitude: f64| {
            let draft = position(at_ms, false).set("Altitude", altitude);
            received(at_ms, draft.set("U_Speed", 30.0))
        };
        let mut run = vec![moves(0, 500.0)];
        let mut later: Vec<_> = (2..8).map(|step| moves(step * 500, 600.0)).collect();
        later.push(received(3_600, Draft::new(3002).raw("UA State", 3)));
        run.extend(later.iter().map(|one| at_socket(1, one)));
        assert_eq!(both(&run, no_ground_state_in_flight), [Verdict::Fail; 2]);
        // What one socket sees of flight is not counted with what another one sees.
        let apart = later.iter().enumerate();
        let apart = apart.map(|(place, one)| at_socket(place % 2, one));
        let apart: Vec<_> = run[..1].iter().cloned().chain(apart).collect();
        assert_eq!(
            both(&apart, no_ground_state_in_flight),
            [Verdict::Inconclusive; 2]
        );
    }

    #[test]
    fn an_image_is_that_of_the_place_of_its_time() {
        use crate::passive::view::trace::received;
        let judged = |after_ms: u64, roll: f64, azimuth: f64| {
            let aircraft = position(0, true).raw("Altitude Type", 3).set("Roll", roll);
            let image = Draft::new(21_101)
                .set("Altitude", 900.0)
                .set("Actual Centreline Elevation Angle", -0.5)
                .set("Actual Centreline Azimuth Angle", azimuth);
            let run = [received(0, aircraft), received(after_ms, image)];
            both(&run, the_image_is_on_the_ground)
        };
        assert_eq!(judged(500, 0.0, -1.57), [Verdict::Fail; 2]);
        // Meanwhile it has climbed.
        assert_eq!(judged(60_000, 0.0, -1.57), [Verdict::Inconclusive; 2]);
        // The right wing down: above its left wing it looks above the horizon, perhaps at a mountain.
        assert_eq!(judged(500, 0.7, -1.57), [Verdict::Inconclusive; 2]);
        assert_eq!(judged(500, 0.7, 1.57), [Verdict::Fail; 2]);
    }

    #[test]
    fn what_has_waited_on_the_way_is_not_compared_with_what_has_not() {
        use crate::passive::view::trace::received;
        // Each 3009 comes just after a 4000, and is of so much later; it climbs where that sinks.
        let judged = |later_ms: u64| {
            let run: Vec<_> = (1..5)
                .flat_map(|step| {
                    let at_ms = step * 10_000;
                    let motion = position(at_ms, true).set("W_Speed", 3.0);
                    let air = Draft::new(3009)
                        .raw("Time Stamp", (at_ms + later_ms) as i64)
                        .set("Barometric Altitude Rate", 3.0);
                    [
                        received(at_ms + 3_000, motion),
                        received(at_ms + 3_010, air),
                    ]
                })
                .collect();
            both(&run, motion_is_reported_alike)
        };
        assert_eq!(judged(0), [Verdict::Fail; 2]);
        assert_eq!(judged(2_000), [Verdict::Inconclusive; 2]);
    }

    #[test]
    fn a_camera_at_the_tail_turns_across_it() {
        use crate::passive::view::trace::received;
        let judged = |low: f64, high: f64, looks: f64| {
            let limits = Draft::new(21_100)
                .set("Field of Regard - Azimuth Min", low)
                .set("Field of Regard - Azimuth Max", high);
            let state = Draft::new(21_101).set("Actual Centreline Azimuth Angle", looks);
            let run = [received(0, state), received(10, limits)];
            both(&run, limits_of_the_camera)
        };
        assert_eq!(judged(-1.5, 1.5, 0.5), [Verdict::Pass; 2]);
        assert_eq!(judged(1.5, -1.5, 3.0), [Verdict::Pass; 2]);
        assert_eq!(judged(1.5, -1.5, -3.0), [Verdict::Pass; 2]);
        // Exchanged: it looks ahead.
        assert_eq!(judged(1.5, -1.5, 0.5), [Verdict::Fail; 2]);
        assert_eq!(judged(3.1, -3.1, 0.0), [Verdict::Fail; 2]);
    }

    #[test]
    fn an_answer_is_that_of_the_vehicle_that_was_requested() {
        use crate::passive::view::trace::{received, sent};
        let second = Id(0x1b00_0102);
        let request = |at_ms: u64, vehicle: Option<Id>, access: i64| {
            let mut draft = Draft::new(1).raw("Requested/Handover Access", access);
            draft.destination = vehicle;
            sent(at_ms, draft)
        };
        let answer = |at_ms: u64, vehicle: Option<Id>, access: i64| {
            let mut draft = Draft::new(2).raw("Access Requested", access);
            draft.source = vehicle;
            received(at_ms, draft)
        };
        let run = |named: i64, other: Option<Id>| {
            let all: Vec<_> = (0..4)
                .flat_map(|step| {
                    let at_ms = step * 1_000;
                    [
                        request(at_ms, None, 1),
                        request(at_ms + 10, other, 2),
                        answer(at_ms + 50, None, named),
                        answer(at_ms + 60, other, 2),
                    ]
                })
                .collect();
            both(&all, the_answer_names_the_request)
        };
        assert_eq!(run(1, Some(second)), [Verdict::Pass; 2]);
        // To one vehicle, both at once: which of them is answered is not known.
        assert_eq!(run(1, None), [Verdict::Inconclusive; 2]);
        let wrong: Vec<_> = (0..4)
            .flat_map(|step| {
                let at_ms = step * 1_000;
                [request(at_ms, None, 1), answer(at_ms + 50, None, 0)]
            })
            .collect();
        assert_eq!(
            both(&wrong, the_answer_names_the_request),
            [Verdict::Fail; 2]
        );
    }

    #[test]
    fn a_copy_of_a_number_of_before_does_not_bring_it_back() {
        use crate::passive::view::trace::received;
        let named = |at_ms: u64, number: &str| {
            received(at_ms, Draft::new(3).text("Tail Number", number.as_bytes()))
        };
        let mut run = vec![named(0, "A1"), named(1_000, "B2")];
        run.push(run[0].clone());
        assert_eq!(both(&run, one_tail_number_at_a_time), [Verdict::Pass; 2]);
        // Again an hour later: in a recording it may have been given back.
        run.push(named(3_600_000, "A1"));
        assert_eq!(
            both(&run, one_tail_number_at_a_time),
            [Verdict::Fail, Verdict::Pass]
        );
    }

    #[test]
    fn a_tail_number_may_change_but_not_return() {
        assert_eq!(verdict(&["0", ""]), Verdict::Inconclusive);
        assert_eq!(verdict(&["A1", "0", "A1", "A1"]), Verdict::Pass);
        assert_eq!(verdict(&["A1", "A1", "B2", "B2"]), Verdict::Pass);
        assert_eq!(verdict(&["A1", "A1", "B2", "A1"]), Verdict::Fail);
    }
}
