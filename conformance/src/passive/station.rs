//! Judges of a CUCS: what it sends, beside what the scripted vehicle sent it before.
//!
//! In these views the CUCS is the subject: its messages are the received ones, those of the vehicle the sent ones.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

use stanag_msgs::Id;

use super::view::{Found, Judge, View};
use crate::wire::Seen;

pub(super) const JUDGES: &[Judge] = &[
    Judge {
        rule: "DISC-008",
        judge: form_of_a_discovery,
    },
    Judge {
        rule: "AUTH-014",
        judge: sends_what_its_loi_allows,
    },
    Judge {
        rule: "AUTH-015",
        judge: in_control_only_when_granted,
    },
    Judge {
        rule: "WRAP-010",
        judge: damaged_grants_count_for_nothing,
    },
    Judge {
        rule: "HAND-008",
        judge: the_holder_is_asked,
    },
    Judge {
        rule: "ROUTE-022",
        judge: sends_whole_routes,
    },
    Judge {
        rule: "MODE-016",
        judge: only_what_is_available,
    },
    Judge {
        rule: "CONF-010",
        judge: declared_ranges,
    },
    Judge {
        rule: "CONF-012",
        judge: configuration_by_its_own_message,
    },
    Judge {
        rule: "ACK-008",
        judge: acknowledges_when_asked,
    },
    Judge {
        rule: "ACK-009",
        judge: repeats_with_the_same_stamp,
    },
    Judge {
        rule: "SCALAR-003",
        judge: waypoints_in_the_west,
    },
];

/// What a CUCS may need for a message: the bits of LOI, of which it has to hold one.
fn needed(kind: u16) -> Option<i64> {
    match kind {
        2000..=2999 | 13_000..=13_006 => Some(4 | 8),
        19_000..=20_999 => Some(2),
        _ => None,
    }
}

/// LOI Granted to each CUCS over time, by responses whose checksum is right.
fn grants(view: &View<'_>) -> Vec<(f64, Id, i64)> {
    view.requests()
        .filter(|seen| seen.kind() == 2 && sound(seen))
        .map(|seen| {
            (
                seen.at.as_secs_f64(),
                seen.piece.destination,
                seen.raw("LOI Granted").unwrap_or_default(),
            )
        })
        .collect()
}

fn sound(seen: &Seen) -> bool {
    let (value, expected) = seen.piece.checksums();
    value == expected
}

/// What this CUCS held at this time, and since when.
fn held(grants: &[(f64, Id, i64)], cucs: Id, at: f64) -> (i64, f64) {
    let mut now = (0, 0.0);
    for &(time, id, levels) in grants {
        if id == cucs && time <= at && levels != now.0 {
            now = (levels, time);
        }
    }
    now
}

fn form_of_a_discovery(view: &View<'_>, found: &mut Found) {
    let first = view.messages().find(|seen| seen.kind() == 1);
    let broadcast = view
        .messages()
        .filter(|seen| seen.kind() == 1 && seen.piece.destination == Id::BROADCAST);
    for seen in broadcast {
        let field = |name: &str| seen.raw(name).unwrap_or_default();
        found.check(
            seen,
            field("Requested/Handover LOI") == 0 && field("Requested/Handover Access") == 0,
            || {
                format!(
                    "expected LOI 0 and access 0 in a discovery, got LOI 0x{:02x} and access {}",
                    field("Requested/Handover LOI"),
                    field("Requested/Handover Access")
                )
            },
        );
        let vsm = seen.raw("VSM ID").map(|raw| Id(raw as u32));
        found.check(seen, vsm == Some(Id::BROADCAST), || {
            format!("expected the broadcast VSM ID in a discovery, got {vsm:?}")
        });
    }
    if let Some(first) = first
        && first.piece.destination != Id::BROADCAST
    {
        found.warn(first, "the first #1 is directed: no discovery was seen");
    }
}

fn sends_what_its_loi_allows(view: &View<'_>, found: &mut Found) {
    let grants = grants(view);
    for seen in view.messages() {
        let Some(needed) = needed(seen.kind()) else {
            continue;
        };
        let at = seen.at.as_secs_f64();
        let (levels, since) = held(&grants, seen.piece.source, at);
        // What was on its way when the rights changed is nobody's fault.
        found.check(
            seen,
            levels & needed != 0 || at - since < 0.5 && since > 0.0,
            || {
                format!(
                    "expected no message {} of {}, which holds LOI 0x{levels:02x} at that moment",
                    seen.kind(),
                    seen.piece.source
                )
            },
        );
    }
}

fn in_control_only_when_granted(view: &View<'_>, found: &mut Found) {
    let grants = grants(view);
    for seen in view
        .messages()
        .filter(|seen| matches!(seen.kind(), 2016 | 2017 | 13_000))
    {
        let at = seen.at.as_secs_f64();
        let (levels, since) = held(&grants, seen.piece.source, at);
        found.check(
            seen,
            levels & 0x0C != 0 || at - since < 2.0 && since > 0.0,
            || {
                let when = if since > 0.0 {
                    format!("{:.1} s after #2 took it away", at - since)
                } else {
                    "before any grant".into()
                };
                format!(
                    "expected flight commands only while LOI 4 is granted; {} came {when}",
                    seen.kind()
                )
            },
        );
    }
}

fn damaged_grants_count_for_nothing(view: &View<'_>, found: &mut Found) {
    let damaged: Vec<(f64, Id)> = view
        .requests()
        .filter(|seen| {
            seen.kind() == 2
                && !sound(seen)
                && seen.raw("LOI Granted").unwrap_or_default() & 0x0C != 0
        })
        .map(|seen| (seen.at.as_secs_f64(), seen.piece.destination))
        .collect();
    if damaged.is_empty() {
        return;
    }
    let grants = grants(view);
    found.saw();
    for seen in view
        .messages()
        .filter(|seen| matches!(seen.kind(), 2016 | 2017 | 13_000..=13_006))
    {
        let at = seen.at.as_secs_f64();
        let only_damaged = damaged
            .iter()
            .any(|&(time, id)| id == seen.piece.source && time <= at)
            && held(&grants, seen.piece.source, at).0 & 0x0C == 0;
        found.check(seen, !only_damaged, || {
            format!(
                "expected a grant with a wrong checksum to be dropped; {} came after it",
                seen.kind()
            )
        });
    }
}

fn the_holder_is_asked(view: &View<'_>, found: &mut Found) {
    for request in view.requests().filter(|seen| seen.kind() == 4) {
        let at = request.at.as_secs_f64();
        found.saw();
        let answer = view.messages().find(|seen| {
            let after = seen.at.as_secs_f64() - at;
            let releases = seen.kind() == 1
                && seen.raw("Requested/Handover Access") == Some(0)
                && seen.raw("Requested/Handover LOI").unwrap_or_default() != 0;
            (0.0..0.8).contains(&after) && (matches!(seen.kind(), 4 | 5) || releases)
        });
        if let Some(answer) = answer {
            found.fail(answer, format!("expected a handover request to be shown to the operator; {} came {:.2} s after it, faster than anyone decides", answer.kind(), answer.at.as_secs_f64() - at));
        }
    }
}

fn sends_whole_routes(view: &View<'_>, found: &mut Found) {
    let mut numbers: BTreeSet<i64> = BTreeSet::new();
    let mut nexts: Vec<(Arc<Seen>, i64)> = Vec::new();
    let mut load: Option<Arc<Seen>> = None;
    for seen in view.messages() {
        match seen.kind() {
            13_002 => {
                if let (Some(load), Some(number)) = (&load, seen.raw("Waypoint Number")) {
                    let late = seen.at.as_secs_f64() - load.at.as_secs_f64();
                    found.check(seen, late > 5.0 || numbers.contains(&number), || format!("expected every waypoint before the load command; waypoint {number} came {late:.2} s after it"));
                }
                numbers.extend(seen.raw("Waypoint Number"));
                nexts.extend(seen.raw("Next Waypoint").map(|next| (seen.clone(), next)));
            }
            13_000 if seen.raw("Mission Plan Mode") == Some(2) => {
                found.saw();
                for (point, next) in &nexts {
                    found.check(point, *next == 0 || numbers.contains(next), || format!("expected waypoint {next}, which a Next Waypoint names, before the load command; it was never sent"));
                }
                load = Some(seen.clone());
            }
            _ => {}
        }
    }
}

/// Indices that 44003 of the vehicle marks as not available, with the time.
fn unavailable(view: &View<'_>) -> Vec<(f64, i64, i64, i64)> {
    view.requests()
        .filter(|seen| {
            seen.kind() == 44_003
                && seen
                    .raw("Enumerated Index Enable")
                    .is_some_and(|enable| enable < 0)
        })
        .filter_map(|seen| {
            Some((
                seen.at.as_secs_f64(),
                seen.raw("Reported Message")?,
                seen.raw("Reported Field")?,
                seen.raw("Reported Enumerated Index")?,
            ))
        })
        .collect()
}

fn only_what_is_available(view: &View<'_>, found: &mut Found) {
    let marked = unavailable(view);
    if marked.is_empty() {
        return;
    }
    for seen in view.messages().filter(|seen| seen.kind() == 2016) {
        let Some(mode) = seen.raw("Select Flight Path Control Mode") else {
            continue;
        };
        let at = seen.at.as_secs_f64();
        let barred = marked.iter().any(|&(time, message, field, index)| {
            time + 0.5 < at && message == 2016 && field == 2 && index == mode
        });
        found.check(seen, !barred, || {
            format!("expected no mode that 44003 marks as unavailable; 2016 with mode {mode} came")
        });
    }
}

fn declared_ranges(view: &View<'_>, found: &mut Found) {
    let declared = view.requests().find(|seen| {
        matches!(seen.kind(), 41_001 | 41_003)
            && seen.raw("Requested Message") == Some(2017)
            && seen.raw("Requested Field") == Some(3)
    });
    let Some(declared) = declared else { return };
    let (Some(low), Some(high)) = (declared.value("Min Value"), declared.value("Max Value")) else {
        return;
    };
    for seen in view
        .messages()
        .filter(|seen| seen.kind() == 2017 && seen.at > declared.at)
    {
        let Some(radius) = seen.value("Loiter Radius") else {
            continue;
        };
        found.check(seen, radius >= low - 1.5 && radius <= high + 1.5, || {
            format!(
                "expected a loiter radius within the declared {low} to {high} m, got {radius} m"
            )
        });
    }
}

fn configuration_by_its_own_message(view: &View<'_>, found: &mut Found) {
    for seen in view
        .messages()
        .filter(|seen| matches!(seen.kind(), 17_002 | 40_000))
    {
        let named = if seen.kind() == 17_002 {
            seen.raw("Message Type")
        } else {
            None
        };
        found.check(
            seen,
            !named.is_some_and(|kind| matches!(kind, 41_000..=41_005 | 44_003)),
            || {
                format!(
                    "expected configuration to be requested by 40000; 17002 names {}",
                    named.unwrap_or_default()
                )
            },
        );
    }
}

fn acknowledges_when_asked(view: &View<'_>, found: &mut Found) {
    let last = view
        .datagrams
        .last()
        .map_or(0.0, |datagram| datagram.at.as_secs_f64());
    for asked in view
        .requests()
        .filter(|seen| seen.piece.ack() && seen.kind() != 17_000)
    {
        let at = asked.at.as_secs_f64();
        if last - at < 2.0 {
            continue;
        }
        let answered = view.messages().any(|seen| {
            seen.kind() == 17_000
                && seen.raw("Original Message Type") == Some(asked.kind().into())
                && seen.raw("Original Message Time Stamp") == asked.stamp()
                && seen.at > asked.at
        });
        found.check(asked, answered, || {
            format!(
                "expected 17000 about message {}, which asked for it; none came",
                asked.kind()
            )
        });
    }
}

fn repeats_with_the_same_stamp(view: &View<'_>, found: &mut Found) {
    // By content without the stamp: what was sent again with another stamp while nothing had acknowledged the first.
    let acknowledged: BTreeSet<i64> = view
        .requests()
        .filter(|seen| seen.kind() == 17_000)
        .filter_map(|seen| seen.raw("Original Message Time Stamp"))
        .collect();
    let mut open: BTreeMap<(u16, Vec<u8>), (f64, i64)> = BTreeMap::new();
    for seen in view
        .messages()
        .filter(|seen| seen.piece.ack() && matches!(seen.kind(), 2016 | 2017))
    {
        let Some(stamp) = seen.stamp() else { continue };
        let width = seen.info.map_or(0, |info| usize::from(info.presence_bytes)) + 5;
        let content = seen.piece.data.get(width..).unwrap_or_default().to_vec();
        let at = seen.at.as_secs_f64();
        if let Some(&(before, first)) = open.get(&(seen.kind(), content.clone()))
            && at - before < 5.0
            && !acknowledged.contains(&first)
        {
            found.check(seen, stamp == first, || format!("expected the repetition of an unacknowledged {} to have the same stamp; {first} became {stamp}", seen.kind()));
        }
        open.insert((seen.kind(), content), (at, stamp));
    }
}

fn waypoints_in_the_west(view: &View<'_>, found: &mut Found) {
    let Some((latitude, longitude)) = view
        .requests()
        .find(|seen| seen.kind() == 4000)
        .and_then(|seen| Some((seen.value("Latitude")?, seen.value("Longitude")?)))
    else {
        return;
    };
    for seen in view.messages().filter(|seen| seen.kind() == 13_002) {
        let (Some(north), Some(east)) = (
            seen.value("Waypoint to Latitude or Relative Y"),
            seen.value("Waypoint to Longitude or Relative X"),
        ) else {
            continue;
        };
        if (north - latitude).abs() > 0.02 {
            continue;
        }
        found.check(seen, (east - longitude).abs() < 0.5, || {
            format!(
                "expected a longitude near {:.1} degrees, where the vehicle is; got {:.1}",
                longitude.to_degrees(),
                east.to_degrees()
            )
        });
    }
}
