//! Judges of what belongs together: an acknowledgement and its message, a grant and its request, a report and the
//! CUCS that requested it.
//!
//! They read whole runs, and so find faults that appear only the second time, only to one CUCS, or only beside
//! something else.

use std::collections::{BTreeMap, BTreeSet};

use super::view::{Found, Judge, View};
use crate::wire::Direction;

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
type Sent = BTreeMap<(u32, i64, i64), (usize, BTreeSet<Vec<u8>>)>;

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
}

fn a_command_ends_once(view: &View<'_>, found: &mut Found) {
    let sent = sent(view);
    let mut ends: BTreeMap<(u32, i64, i64), Vec<i64>> = BTreeMap::new();
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
        let before = ends.entry(key).or_default();
        let ended = before.iter().find(|&&before| before != 1).copied();
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
                let more = granted & !requested & 0x0E;
                found.check(seen, more == 0 || requested == 0, || {
                    format!(
                        "expected {} to be granted what it requested (LOI 0x{requested:02x} so far); LOI Granted is 0x{granted:02x}",
                        seen.piece.destination
                    )
                });
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
    for seen in view
        .datagrams
        .iter()
        .flat_map(|datagram| &datagram.messages)
    {
        match (seen.direction, seen.kind()) {
            (Direction::Sent, 13000) => {
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
                found.check(seen, commands.contains(&(text.clone(), mode)), || {
                    format!("expected 14000 to name Mission ID and plan mode of a 13000 before it; no 13000 had {text:?} and mode {mode}")
                });
            }
            _ => {}
        }
    }
}

/// A vehicle is behind one VSM, and every message names that one.
fn one_vsm_for_one_vehicle(view: &View<'_>, found: &mut Found) {
    let mut vsms: BTreeMap<u32, (u16, i64)> = BTreeMap::new();
    for seen in view
        .messages()
        .filter(|seen| matches!(seen.kind(), 2 | 3 | 5 | 21000 | 41000..=41005))
    {
        let Some(vsm) = seen.raw("VSM ID") else {
            continue;
        };
        let first = *vsms
            .entry(seen.piece.source.0)
            .or_insert((seen.kind(), vsm));
        found.check(seen, first.1 == vsm, || {
            format!(
                "expected one VSM ID of {}; message {} has 0x{:08x}, message {} has 0x{:08x}",
                seen.piece.source,
                first.0,
                first.1 as u32,
                seen.kind(),
                vsm as u32
            )
        });
    }
}

fn one_type_for_one_vehicle(view: &View<'_>, found: &mut Found) {
    let mut types: BTreeMap<u32, (u16, i64, i64)> = BTreeMap::new();
    for seen in view
        .messages()
        .filter(|seen| matches!(seen.kind(), 2 | 3 | 41005))
    {
        let (Some(kind), Some(subtype)) = (seen.raw("Vehicle Type"), seen.raw("Vehicle Subtype"))
        else {
            continue;
        };
        // 0 and 0: not identified yet, as after a restart.
        if (kind, subtype) == (0, 0) {
            continue;
        }
        let first = *types
            .entry(seen.piece.source.0)
            .or_insert((seen.kind(), kind, subtype));
        found.check(seen, (first.1, first.2) == (kind, subtype), || {
            format!(
                "expected one Vehicle Type and Subtype of {}; message {} has {} and {}, message {} has {kind} and {subtype}",
                seen.piece.source, first.0, first.1, first.2, seen.kind()
            )
        });
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

    use stanag_msgs::Id;

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
            [Verdict::Fail; 2]
        );
    }

    #[test]
    fn an_acknowledgement_that_the_network_doubles_is_one() {
        assert_eq!(ends(&[(10, 1_010)]), Verdict::Pass);
        assert_eq!(ends(&[(10, 1_010), (12, 1_010)]), Verdict::Pass);
        assert_eq!(ends(&[(10, 1_010), (12, 1_012)]), Verdict::Fail);
    }
}
