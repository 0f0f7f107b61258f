//! Judges of what belongs together: an acknowledgement and its message, a grant and its request, a report and the
//! CUCS that requested it.
//!
//! They read whole runs, and so find faults that appear only the second time, only to one CUCS, or only beside
//! something else.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;
use std::time::Duration;

use stanag_msgs::Id;

use super::view::{Found, History, Judge, OVERTAKEN_MS, Tally, View};
use crate::wire::{Direction, Seen};

pub(super) const JUDGES: &[Judge] = &[
    Judge {
        rule: "ACK-001",
        judge: acknowledgements_name_what_was_sent,
    },
    Judge {
        rule: "ACK-007",
        judge: a_command_ends_once,
    },
    Judge {
        rule: "AUTH-016",
        judge: nothing_is_granted_unrequested,
    },
    Judge {
        rule: "DISC-006",
        judge: one_type_for_one_vehicle,
    },
    Judge {
        rule: "ROUTE-020",
        judge: transfers_echo_a_command,
    },
    Judge {
        rule: "DISC-010",
        judge: one_vsm_for_one_vehicle,
    },
    Judge {
        rule: "STAT-005",
        judge: pull_messages_are_pulled,
    },
    Judge {
        rule: "TIME-002",
        judge: stamps_have_milliseconds,
    },
    Judge {
        rule: "TIME-003",
        judge: stamps_are_recent,
    },
];

/// How long before a recording a message may have been sent that is acknowledged in it, ms.
const OLDER_MS: i64 = 600_000;

/// How often a message was sent, and its contents, by source, type and time stamp.
type Sent = BTreeMap<Key, (usize, BTreeSet<Vec<u8>>)>;
/// Whose message it is, its id, and its Time Stamp.
type Key = (u32, i64, i64);

/// What each CUCS sent, by source, type and time stamp: how often, and with how many contents.
fn sent(view: &View<'_>) -> Sent {
    let mut sent = Sent::new();
    for seen in view.requests() {
        let key = (
            seen.piece.source.0,
            i64::from(seen.kind()),
            seen.stamp().unwrap_or_default(),
        );
        let entry = sent.entry(key).or_default();
        entry.0 += 1;
        entry.1.insert(seen.piece.bytes.clone());
    }
    sent
}

fn acknowledgements_name_what_was_sent(view: &View<'_>, found: &mut Found) {
    let sent = sent(view);
    let kinds: BTreeSet<(u32, i64)> = sent.keys().map(|&(id, kind, _)| (id, kind)).collect();
    let mut first: BTreeMap<u32, i64> = BTreeMap::new();
    for &(id, _, stamp) in sent.keys().filter(|(.., stamp)| *stamp != 0) {
        let known = first.entry(id).or_insert(stamp);
        *known = stamp.min(*known);
    }
    // A recording may begin between a message and its acknowledgement, and may be without what another CUCS sent.
    let older = |receiver: u32, stamp: i64| {
        let first = first.get(&receiver);
        !view.live && first.is_none_or(|first| (1..OLDER_MS).contains(&(first - stamp)))
    };
    // Nor does it contain every datagram of its time: of single messages only the acknowledgement was recorded. By the clock of
    // the CUCS such a message is no newer than the last one that was recorded and the time since.
    let mut last: BTreeMap<u32, (i64, Duration)> = BTreeMap::new();
    for seen in view.requests() {
        let newest = (seen.stamp().unwrap_or_default(), seen.at);
        let known = last.entry(seen.piece.source.0).or_insert(newest);
        *known = newest.max(*known);
    }
    let within = |receiver: u32, stamp: i64, at: Duration| {
        let last = last.get(&receiver).filter(|_| !view.live);
        last.is_some_and(|&(last, then)| {
            let since = at.saturating_sub(then).as_millis() as i64;
            stamp <= last + since + OVERTAKEN_MS
        })
    };
    let mut recorded = Tally::default();
    let mut named = BTreeSet::new();
    for seen in view.messages().filter(|seen| seen.kind() == 17000) {
        let (Some(kind), Some(stamp)) = (
            seen.raw("Original Message Type"),
            seen.raw("Original Message Time Stamp"),
        ) else {
            found.fail(
                seen,
                "expected Original Message Type and Time Stamp in 17000; one is absent",
            );
            continue;
        };
        let receiver = seen.piece.destination.0;
        // Discoveries of a flood are not recorded, and messages broken on purpose have no stamp.
        if kind == 1 {
            continue;
        }
        let known =
            sent.contains_key(&(receiver, kind, stamp)) || sent.contains_key(&(receiver, kind, 0));
        if !known && older(receiver, stamp) {
            continue;
        }
        // Copies, and the steps of one command, are about one message.
        if named.insert((receiver, kind, stamp)) {
            recorded.look(seen, known);
        }
        if !known && within(receiver, stamp, seen.at) {
            continue;
        }
        found.check(seen, known, || {
            let why = if kinds.contains(&(receiver, kind)) {
                format!("none with the stamp {stamp}")
            } else {
                "none of that type".into()
            };
            format!(
                "expected 17000 to {} about a message that it sent; it names message {kind}, and {} has sent {why}",
                seen.piece.destination, seen.piece.destination
            )
        });
    }
    if !view.live {
        recorded.judge_by(
            found,
            3,
            5,
            "expected each 17000 about a message that was sent; most of the recording name none",
        );
    }
}

fn a_command_ends_once(view: &View<'_>, found: &mut Found) {
    let sent = sent(view);
    // By vehicle: what is for everybody is ended by each of them.
    let mut ends: BTreeMap<(u32, Key), Vec<i64>> = BTreeMap::new();
    for seen in view.once().filter(|seen| seen.kind() == 17000) {
        let (Some(kind), Some(stamp), Some(step)) = (
            seen.raw("Original Message Type"),
            seen.raw("Original Message Time Stamp"),
            seen.raw("Acknowledgement Type"),
        ) else {
            continue;
        };
        let key = (seen.piece.destination.0, kind, stamp);
        let Some((times, contents)) = sent.get(&key) else {
            continue;
        };
        // The same stamp with other content is another message; a duplicate is answered twice.
        if *times != 1 || contents.len() != 1 {
            continue;
        }
        let before = ends.entry((seen.piece.source.0, key)).or_default();
        let ended = before.iter().find(|&&before| before != 1).copied();
        // Of a duplicate that the network made behind the recorder only the second answer is recorded.
        let ended = ended.filter(|&ended| view.live || ended != step);
        found.check(seen, ended.is_none(), || {
            format!(
                "expected one end of a message {kind}; 17000 type {step} came after type {}",
                ended.unwrap_or_default()
            )
        });
        before.push(step);
    }
}

fn nothing_is_granted_unrequested(view: &View<'_>, found: &mut Found) {
    let mut requested: BTreeMap<u32, i64> = BTreeMap::new();
    let mut known: BTreeSet<(u32, u32)> = BTreeSet::new();
    for seen in view
        .datagrams
        .iter()
        .flat_map(|datagram| &datagram.messages)
    {
        match (seen.direction, seen.kind()) {
            (Direction::Sent, 1) if seen.raw("Requested/Handover Access") != Some(0) => {
                *requested.entry(seen.piece.source.0).or_default() |=
                    seen.raw("Requested/Handover LOI").unwrap_or_default();
            }
            // A handover grants as well.
            (Direction::Sent, 4) => {
                *requested.entry(seen.piece.source.0).or_default() |= 0x0F;
                if let Some(id) = seen.raw("Requesting CUCS ID") {
                    *requested.entry(id as u32).or_default() |= 0x0F;
                }
            }
            (Direction::Received, 2) => {
                let Some(granted) = seen.raw("LOI Granted") else {
                    continue;
                };
                let receiver = seen.piece.destination.0;
                // What it is shown first in a recording it may have been granted before that.
                if !view.live && known.insert((seen.piece.source.0, receiver)) {
                    *requested.entry(receiver).or_default() |= granted;
                }
                // A CUCS that has sent nothing yet may hold what it held before the run; every level includes LOI 2.
                let Some(&requested) = requested.get(&receiver) else {
                    continue;
                };
                found.saw();
                let more = granted & !requested & 0x0E;
                if more == 0 || requested == 0 {
                    continue;
                }
                let reason = format!(
                    "expected {} to be granted what it requested (LOI 0x{requested:02x} so far); LOI Granted is 0x{granted:02x}",
                    seen.piece.destination
                );
                // The request may not be in the recording: one datagram that it lacks is enough.
                if view.live {
                    found.fail(seen, reason);
                } else {
                    found.warn(seen, reason);
                }
            }
            _ => {}
        }
    }
}

/// Each 14000 names the Mission ID and the plan mode of one of the commands before it, also where that was refused or
/// cancelled.
fn transfers_echo_a_command(view: &View<'_>, found: &mut Found) {
    let mut commands: BTreeSet<(String, i64)> = BTreeSet::new();
    let mut broken = false;
    let mut senders: BTreeSet<Id> = BTreeSet::new();
    let mut ends: BTreeSet<&[u8]> = BTreeSet::new();
    let mut recorded = Tally::default();
    for seen in view
        .datagrams
        .iter()
        .flat_map(|datagram| &datagram.messages)
    {
        match (seen.direction, seen.kind()) {
            (Direction::Sent, 13000) => {
                senders.insert(seen.piece.source);
                let text = seen.text("Mission ID").unwrap_or_default();
                // Sent on purpose without a NUL, or with bytes that are not characters: how that is echoed is judged
                // by another rule.
                broken |= text.len() >= 20 || !text.is_ascii();
                commands.extend(
                    seen.raw("Mission Plan Mode")
                        .map(|mode| (text.clone(), mode)),
                );
            }
            (Direction::Received, 14000) if !broken && !commands.is_empty() => {
                let (Some(text), Some(mode)) =
                    (seen.text("Mission ID"), seen.raw("Mission Plan Mode"))
                else {
                    continue;
                };
                let named = commands.contains(&(text.clone(), mode));
                // A transfer has any number of reports on its way, and one end. Of a CUCS that only listens no command is
                // recorded.
                let ends_one = seen.raw("Status").is_some_and(|status| status != 0)
                    && senders.contains(&seen.piece.destination)
                    && ends.insert(&seen.piece.bytes);
                if ends_one {
                    recorded.look(seen, named);
                }
                // A transfer may have begun before a recording, or its command may not be in it.
                if !named && !view.live {
                    found.missed(format!(
                        "14000 about {text:?} in mode {mode}, whose 13000 is not in the recording"
                    ));
                    continue;
                }
                found.check(seen, named, || {
                    format!("expected 14000 to name Mission ID and plan mode of a 13000 before it; no 13000 had {text:?} and mode {mode}")
                });
            }
            _ => {}
        }
    }
    if !view.live {
        recorded.judge_by(
            found,
            3,
            5,
            "expected the last 14000 of each transfer to name Mission ID and plan mode of a 13000 before it; most of the recording name none",
        );
    }
}

/// A vehicle is behind one VSM, and every message names that one.
fn one_vsm_for_one_vehicle(view: &View<'_>, found: &mut Found) {
    let mut vsms: BTreeMap<u32, History<i64>> = BTreeMap::new();
    for seen in view
        .in_order()
        .filter(|seen| matches!(seen.kind(), 2 | 3 | 5 | 21000 | 41000..=41005))
        .filter(|seen| is_of_one_vehicle(seen))
    {
        // Nobody, where the id does not apply, is no other VSM.
        let Some(vsm) = seen
            .raw("VSM ID")
            .filter(|&vsm| ![0, Id::NULL.0].contains(&(vsm as u32)))
        else {
            continue;
        };
        found.saw();
        let history = vsms.entry(seen.piece.source.0).or_default();
        if let Some(change) = history.take(vsm, seen.at) {
            let reason = format!(
                "expected one VSM ID of {}; message {} has 0x{:08x}, a message before it had 0x{:08x}",
                seen.piece.source,
                seen.kind(),
                vsm as u32,
                change.from as u32
            );
            change.judge(view, seen, found, reason);
        }
    }
}

/// Whether the source is one vehicle, and not nobody or everybody: a VSM without a vehicle, or one of Edition 2.5, whose Vehicle
/// ID is read as the source, about all of its vehicles.
fn is_of_one_vehicle(seen: &Seen) -> bool {
    ![Id::NULL, Id::BROADCAST].contains(&seen.piece.source)
}

fn one_type_for_one_vehicle(view: &View<'_>, found: &mut Found) {
    for field in ["Vehicle Type", "Vehicle Subtype"] {
        one_value_for_one_vehicle(view, field, found);
    }
}

/// Judges a field of #2, #3 and 41005 that is the same in each of them. 0 is "not identified": every message may have it for
/// a while, as after a restart, but none may keep it while another has the value.
fn one_value_for_one_vehicle(view: &View<'_>, field: &str, found: &mut Found) {
    let mut values: BTreeMap<u32, History<i64>> = BTreeMap::new();
    let mut filled: BTreeSet<(u32, u16)> = BTreeSet::new();
    let mut empty: BTreeMap<(u32, u16), Arc<Seen>> = BTreeMap::new();
    for seen in view
        .in_order()
        .filter(|seen| matches!(seen.kind(), 2 | 3 | 41005))
        .filter(|seen| is_of_one_vehicle(seen))
    {
        let (Some(kind), Some(subtype), Some(value)) = (
            seen.raw("Vehicle Type"),
            seen.raw("Vehicle Subtype"),
            seen.raw(field),
        ) else {
            continue;
        };
        if (kind, subtype) == (0, 0) {
            continue;
        }
        found.saw();
        let source = seen.piece.source.0;
        if value == 0 {
            if values.contains_key(&source) {
                empty.insert((source, seen.kind()), seen.clone());
            }
            continue;
        }
        filled.insert((source, seen.kind()));
        if let Some(change) = values.entry(source).or_default().take(value, seen.at) {
            let reason = format!(
                "expected one {field} of {}; message {} has {value}, a message before it had {}",
                seen.piece.source,
                seen.kind(),
                change.from
            );
            change.judge(view, seen, found, reason);
        }
    }
    for (_, seen) in empty.iter().filter(|(key, _)| !filled.contains(*key)) {
        let reason = format!(
            "expected one {field} of {}; message {} has 0, others have another",
            seen.piece.source,
            seen.kind()
        );
        // A recording may end before the vehicle is identified again.
        if view.live {
            found.fail(seen, reason);
        } else {
            found.warn(seen, reason);
        }
    }
}

fn pull_messages_are_pulled(view: &View<'_>, found: &mut Found) {
    let mut asked: BTreeSet<(usize, i64)> = BTreeSet::new();
    for seen in view
        .datagrams
        .iter()
        .flat_map(|datagram| &datagram.messages)
    {
        match (seen.direction, seen.kind()) {
            (Direction::Sent, 17001) => {
                asked.extend(
                    seen.raw("Requested Message Type")
                        .map(|kind| (seen.socket, kind)),
                );
            }
            (Direction::Sent, 17002) => {
                asked.extend(seen.raw("Message Type").map(|kind| (seen.socket, kind)));
            }
            (Direction::Received, kind @ 3000) => {
                let pulled = asked.contains(&(seen.socket, kind.into()));
                // A schedule may be older than a recording.
                if !pulled && !view.live {
                    found.missed(format!(
                        "{kind} came without a request or schedule in the recording"
                    ));
                    continue;
                }
                found.check(seen, pulled, || {
                    format!(
                        "expected {kind} on request or schedule only; it came to {}, which did not ask",
                        seen.piece.destination
                    )
                });
            }
            _ => {}
        }
    }
}

fn stamps_have_milliseconds(view: &View<'_>, found: &mut Found) {
    let mut stamps: BTreeMap<u16, (usize, usize)> = BTreeMap::new();
    let mut last = None;
    for seen in view
        .messages()
        .filter(|seen| matches!(seen.kind(), 2 | 3001 | 4000 | 17000))
    {
        let Some(stamp) = seen.stamp() else { continue };
        let count = stamps.entry(seen.kind()).or_default();
        count.0 += 1;
        count.1 += usize::from(stamp % 1000 == 0);
        last = Some(seen);
    }
    let Some(last) = last else { return };
    for (kind, (all, whole)) in stamps {
        found.check(last, all < 20 || whole < all, || {
            format!("expected time stamps in milliseconds; all {all} of message {kind} are whole seconds")
        });
    }
}

fn stamps_are_recent(view: &View<'_>, found: &mut Found) {
    if !view.live {
        return;
    }
    let mut ages = Vec::new();
    for seen in view.messages().filter(|seen| seen.kind() == 4000) {
        let Some(stamp) = seen.stamp() else { continue };
        let age = seen.wall_ms as i64 - stamp;
        // A wrong epoch or time zone is judged by TIME-002.
        if (0..1_200_000).contains(&age) {
            ages.push((age, seen));
        }
    }
    ages.sort_by_key(|(age, _)| *age);
    let Some((median, seen)) = ages.get(ages.len() / 2) else {
        return;
    };
    if ages.len() < 20 {
        return;
    }
    found.check(seen, *median <= 3_000, || {
        format!("expected stamps of 4000 that tell when the data were captured; half of them are more than {:.1} s old when they arrive", *median as f64 / 1000.0)
    });
}

#[cfg(test)]
mod tests {
    use std::time::Duration;

    use super::*;
    use crate::bench::net::Datagram;
    use crate::passive::view::trace::{received, sent};
    use crate::passive::view::{verdict_on, verdict_on_recorded};
    use crate::verdict::Verdict;
    use crate::wire::Draft;

    const STATION: Id = Id(0x1b00_00a0);
    const VEHICLE: Id = Id(0x1b00_0101);

    fn datagram(at_ms: u64, direction: Direction, bytes: Vec<u8>) -> Datagram {
        let at = Duration::from_millis(at_ms);
        let ends = (([127, 0, 0, 1], 1).into(), ([127, 0, 0, 1], 2).into());
        Datagram::new((at, at), direction, 0, ends, bytes, None)
    }

    /// The verdict on a 2017 at 0 ms and its acknowledgements: when each arrived, and its own time stamp.
    fn ends(acknowledgements: &[(u64, i64)]) -> Verdict {
        let command = Draft::new(2017).raw("Time Stamp", 1_000).acked();
        let command = command.encode(STATION, VEHICLE, 32, 1);
        let mut datagrams = vec![datagram(0, Direction::Sent, command)];
        for &(at_ms, stamp) in acknowledgements {
            let done = Draft::new(17000)
                .raw("Time Stamp", stamp)
                .raw("Original Message Time Stamp", 1_000)
                .raw("Original Message Type", 2017)
                .raw("Acknowledgement Type", 2);
            let done = done.encode(VEHICLE, STATION, 32, 1);
            datagrams.push(datagram(at_ms, Direction::Received, done));
        }
        crate::passive::view::verdict_on(&datagrams, a_command_ends_once)
    }

    /// What a judge finds in a live run, and in a recording that begins with the first of these datagrams.
    fn both(datagrams: &[Datagram], judge: fn(&View<'_>, &mut Found)) -> [Verdict; 2] {
        [
            verdict_on(datagrams, judge),
            verdict_on_recorded(datagrams, judge),
        ]
    }

    #[test]
    fn a_recording_may_begin_after_what_was_sent_for_it() {
        let acknowledged = |stamp: i64| {
            let draft = Draft::new(17000)
                .raw("Original Message Time Stamp", stamp)
                .raw("Original Message Type", 2017);
            [
                received(100_100, draft),
                sent(100_200, Draft::new(2016).raw("Time Stamp", 100_200)),
            ]
        };
        let judge = acknowledgements_name_what_was_sent;
        assert_eq!(
            both(&acknowledged(99_900), judge),
            [Verdict::Fail, Verdict::Inconclusive]
        );
        // That of no message, before or in it.
        assert_eq!(
            both(&acknowledged(100_150 + OLDER_MS), judge),
            [Verdict::Fail; 2]
        );

        let pulled = [received(0, Draft::new(3000))];
        assert_eq!(
            both(&pulled, pull_messages_are_pulled),
            [Verdict::Fail, Verdict::Inconclusive]
        );
    }

    #[test]
    fn a_level_that_was_held_before_a_recording_was_granted_before_it() {
        let granted =
            |at_ms: u64, levels: i64| received(at_ms, Draft::new(2).raw("LOI Granted", levels));
        let request = |at_ms: u64, levels: i64| {
            let draft = Draft::new(1)
                .raw("Requested/Handover LOI", levels)
                .raw("Requested/Handover Access", 1);
            sent(at_ms, draft)
        };
        // It asks for LOI 2, and holds LOI 4.
        let holds = [request(0, 1), granted(100, 5)];
        assert_eq!(
            both(&holds, nothing_is_granted_unrequested),
            [Verdict::Fail, Verdict::Pass]
        );
        // In the recording LOI 4 is granted without a request.
        let given = [
            request(0, 1),
            granted(100, 1),
            request(200, 1),
            granted(300, 5),
        ];
        assert_eq!(
            both(&given, nothing_is_granted_unrequested),
            [Verdict::Fail, Verdict::Warning]
        );
    }

    /// #2 with this type and subtype, or another message that names them.
    fn typed(at_ms: u64, message: u16, kind: i64, subtype: i64) -> Datagram {
        let draft = Draft::new(message)
            .raw("Vehicle Type", kind)
            .raw("Vehicle Subtype", subtype);
        received(at_ms, draft)
    }

    #[test]
    fn a_vehicle_has_one_type_in_all_messages() {
        let judge = one_type_for_one_vehicle;
        let same = [typed(0, 2, 22, 1), typed(100, 3, 22, 1)];
        assert_eq!(both(&same, judge), [Verdict::Pass; 2]);
        // #2 and #3 beside each other.
        let differ = [
            typed(0, 2, 22, 1),
            typed(100, 3, 21, 1),
            typed(5_000, 2, 22, 1),
        ];
        assert_eq!(both(&differ, judge), [Verdict::Fail; 2]);
        // #3 never has the subtype.
        let without = [typed(0, 2, 22, 1), typed(100, 3, 22, 0)];
        assert_eq!(both(&without, judge), [Verdict::Fail, Verdict::Warning]);
    }

    #[test]
    fn a_vehicle_may_be_configured_again_between_two_parts_of_a_recording() {
        let judge = one_type_for_one_vehicle;
        let restart = [typed(0, 2, 22, 1), typed(60_000, 2, 21, 3)];
        assert_eq!(both(&restart, judge), [Verdict::Fail, Verdict::Warning]);
        // And back again, hours later.
        let mut back = restart.to_vec();
        back.push(typed(9_000_000, 2, 22, 1));
        assert_eq!(both(&back, judge), [Verdict::Fail, Verdict::Warning]);
        // A copy of a message of before, and one that was overtaken.
        let copied = typed(59_000, 2, 22, 1);
        let [before, after] = restart;
        let overtaken = typed(59_500, 2, 22, 1);
        let late = [before, copied.clone(), after, copied, overtaken];
        assert_eq!(verdict_on_recorded(&late, judge), Verdict::Warning);
    }

    #[test]
    fn after_a_restart_a_vehicle_is_not_identified_for_a_while() {
        let again = [
            typed(0, 2, 22, 1),
            typed(100, 3, 22, 1),
            typed(5_000, 2, 22, 0),
            typed(5_100, 3, 22, 0),
            typed(6_000, 2, 22, 1),
        ];
        assert_eq!(both(&again, one_type_for_one_vehicle), [Verdict::Pass; 2]);
    }

    #[test]
    fn a_logical_id_stands_for_one_vehicle_after_another() {
        let of = |at_ms: u64, source: Id, kind: i64| {
            let mut draft = Draft::new(2)
                .raw("Vehicle Type", kind)
                .raw("Vehicle Subtype", 1);
            draft.source = Some(source);
            received(at_ms, draft)
        };
        let judge = one_type_for_one_vehicle;
        let logical = [of(0, Id(1), 22), of(90_000, Id(1), 21)];
        assert_eq!(both(&logical, judge), [Verdict::Warning; 2]);
        // Nobody has no type.
        let nobody = [of(0, Id::NULL, 22), of(100, Id::NULL, 21)];
        assert_eq!(both(&nobody, judge), [Verdict::Inconclusive; 2]);
    }

    #[test]
    fn a_vehicle_is_behind_one_vsm_at_a_time() {
        let named = |at_ms: u64, message: u16, vsm: Id| {
            received(at_ms, Draft::new(message).id("VSM ID", vsm))
        };
        let judge = one_vsm_for_one_vehicle;
        let (first, second) = (Id(0x1b00_0001), Id(0x1b00_0002));
        let beside = [
            named(0, 2, first),
            named(100, 41_005, second),
            named(200, 2, first),
        ];
        assert_eq!(both(&beside, judge), [Verdict::Fail; 2]);
        // It comes to another VSM, which a recording shows and a run does not.
        let moves = [named(0, 2, first), named(90_000, 2, second)];
        assert_eq!(both(&moves, judge), [Verdict::Fail, Verdict::Warning]);
        // An id that does not apply names no other VSM.
        let null = [named(0, 2, first), named(100, 41_005, Id::NULL)];
        assert_eq!(both(&null, judge), [Verdict::Pass; 2]);
    }

    #[test]
    fn a_recording_lacks_some_datagrams() {
        // A 17000 about a 2016 with each of these stamps, of which the recording has the first.
        let acknowledged = |stamps: &[i64]| {
            let mut run = vec![sent(100, Draft::new(2016).raw("Time Stamp", 100))];
            run.extend(stamps.iter().map(|&stamp| {
                let draft = Draft::new(17000)
                    .raw("Original Message Time Stamp", stamp)
                    .raw("Original Message Type", 2016);
                received(stamp as u64 + 50, draft)
            }));
            run
        };
        let judge = acknowledgements_name_what_was_sent;
        let mut one = acknowledged(&[100, 60_000]);
        assert_eq!(both(&one, judge), [Verdict::Fail, Verdict::Pass]);
        // Received, then done.
        let again = Draft::new(17000)
            .raw("Original Message Time Stamp", 60_000)
            .raw("Original Message Type", 2016);
        one.push(received(60_100, again));
        assert_eq!(both(&one, judge), [Verdict::Fail, Verdict::Pass]);
        // Most of them name nothing that was sent.
        let wrong = acknowledged(&[100, 200, 300, 400]);
        assert_eq!(both(&wrong, judge), [Verdict::Fail; 2]);

        // The 13000 of a download is not there, that of a later clear is.
        let command = Draft::new(13_000)
            .raw("Mission Plan Mode", 1)
            .text("Mission ID", b"A");
        let ends = Draft::new(14_000)
            .raw("Mission Plan Mode", 3)
            .text("Mission ID", b"B");
        let run = [sent(0, command), received(100, ends)];
        assert_eq!(
            both(&run, transfers_echo_a_command),
            [Verdict::Fail, Verdict::Inconclusive]
        );
    }

    #[test]
    fn most_transfers_of_a_recording_name_their_command() {
        // Each 13000 has another Mission ID in mode 1; and its 14000s, with these statuses, have this one and mode.
        let run = |named: Option<&str>, mode: i64, statuses: &[i64]| {
            let mut run = Vec::new();
            for (at_ms, mission) in (0..).step_by(10_000).zip(["A", "B", "C", "D"]) {
                let command = Draft::new(13_000)
                    .raw("Mission Plan Mode", 1)
                    .text("Mission ID", mission.as_bytes());
                run.push(sent(at_ms, command));
                for (after_ms, &status) in (100..).step_by(100).zip(statuses) {
                    let report = Draft::new(14_000)
                        .raw("Status", status)
                        .raw("Mission Plan Mode", mode)
                        .text("Mission ID", named.unwrap_or(mission).as_bytes());
                    run.push(received(at_ms + after_ms, report));
                }
            }
            run
        };
        let judge = transfers_echo_a_command;
        let right = run(None, 1, &[0, 0, 1]);
        assert_eq!(both(&right, judge), [Verdict::Pass; 2]);
        for wrong in [run(Some(""), 1, &[0, 1]), run(None, 2, &[0, 1])] {
            assert_eq!(both(&wrong, judge), [Verdict::Fail; 2]);
        }
        // The command of one transfer with many reports is missing.
        let mut one = run(None, 1, &[0, 0, 0, 0, 0, 0, 1]);
        one.remove(8);
        assert_eq!(both(&one, judge), [Verdict::Fail, Verdict::Pass]);
        // A CUCS that only listens has sent none of the commands.
        let mut listens = run(Some("E"), 1, &[0, 1]);
        listens.retain(|datagram| datagram.direction == Direction::Received);
        let mut command = Draft::new(13_000)
            .raw("Mission Plan Mode", 1)
            .text("Mission ID", b"A");
        command.source = Some(Id(0x1b00_00a1));
        listens.insert(0, sent(0, command));
        assert_eq!(
            both(&listens, judge),
            [Verdict::Fail, Verdict::Inconclusive]
        );
    }

    #[test]
    fn a_command_to_all_vehicles_is_ended_by_each() {
        let mut command = Draft::new(2017).raw("Time Stamp", 1_000).acked();
        command.destination = Some(Id::BROADCAST);
        let done = |vehicle: u32, step: i64| {
            let mut draft = Draft::new(17000)
                .raw("Original Message Time Stamp", 1_000)
                .raw("Original Message Type", 2017)
                .raw("Acknowledgement Type", step);
            draft.source = Some(Id(VEHICLE.0 + vehicle));
            received(1_100 + u64::from(vehicle) + step as u64, draft)
        };
        let run = |second: Datagram| [sent(1_000, command.clone()), done(0, 2), second];
        let judge = a_command_ends_once;
        assert_eq!(both(&run(done(1, 2)), judge), [Verdict::Pass; 2]);
        assert_eq!(both(&run(done(0, 3)), judge), [Verdict::Fail; 2]);
    }

    #[test]
    fn an_acknowledgement_that_the_network_doubles_is_one() {
        assert_eq!(ends(&[(10, 1_010)]), Verdict::Pass);
        assert_eq!(ends(&[(10, 1_010), (12, 1_010)]), Verdict::Pass);
        assert_eq!(ends(&[(10, 1_010), (12, 1_012)]), Verdict::Fail);
    }
}
