//! Judges of a CUCS: what it sends, compared with what the scripted vehicle sent before.
//!
//! In these views the CUCS is the subject: its messages are the received ones, those of the vehicle the sent ones.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;
use std::time::Duration;

use stanag_msgs::Id;
use stanag_msgs::field::EnumKind;

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
        rule: "ACK-009",
        judge: commands_once,
    },
    Judge {
        rule: "ACK-008",
        judge: acknowledges_to_whom_it_may_concern,
    },
    Judge {
        rule: "WRAP-016",
        judge: commands_are_addressed,
    },
];

/// The LOI bits for a message: a CUCS has to hold at least one of them to send it.
fn needed(seen: &Seen) -> Option<i64> {
    match seen.kind() {
        // Launch and recovery.
        2016 if seen
            .raw("Select Flight Path Control Mode")
            .is_some_and(|mode| (19..=21).contains(&mode)) =>
        {
            Some(8)
        }
        2000..=2999 | 13_000..=13_006 => Some(4 | 8),
        19_000..=20_999 => Some(2),
        _ => None,
    }
}

/// LOI Granted to each CUCS over time, by responses whose checksum is right.
fn grants(view: &View<'_>) -> Vec<(f64, Id, i64)> {
    view.requests()
        .filter(|seen| seen.kind() == 2 && seen.sound())
        .map(|seen| {
            (
                seen.at.as_secs_f64(),
                seen.piece.destination,
                seen.raw("LOI Granted").unwrap_or_default(),
            )
        })
        .collect()
}

/// The LOI bits that this CUCS held at this time, and since when.
fn held(grants: &[(f64, Id, i64)], cucs: Id, at: f64) -> (i64, f64) {
    let mut now = (0, 0.0);
    for &(time, id, levels) in grants {
        if id == cucs && time <= at && levels != now.0 {
            now = (levels, time);
        }
    }
    now
}

/// Stations that the last #2 to this CUCS names.
fn stations_of(view: &View<'_>, cucs: Id, at: f64) -> Option<i64> {
    view.requests()
        .filter(|seen| seen.kind() == 2 && seen.sound() && seen.piece.destination == cucs)
        .take_while(|seen| seen.at.as_secs_f64() <= at)
        .filter_map(|seen| seen.raw("Controlled Station 1-16"))
        .last()
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
    // A CUCS that was granted or denied something, and sends nothing beyond it, keeps the rule.
    if !grants.is_empty() {
        found.saw();
    }
    for seen in view.messages() {
        let Some(needed) = needed(seen) else {
            continue;
        };
        let at = seen.at.as_secs_f64();
        let (levels, _) = held(&grants, seen.piece.source, at);
        if needed == 2
            && let Some(stations) = seen
                .info
                .and_then(|info| info.field("Station Number 1-16"))
                .and_then(|_| seen.raw("Station Number 1-16"))
        {
            let own = stations_of(view, seen.piece.source, at);
            found.check(seen, own.is_none_or(|own| stations & !own == 0), || {
                format!(
                    "expected message {} for stations that {} was granted (0x{:04x}), got 0x{stations:04x}",
                    seen.kind(),
                    seen.piece.source,
                    own.unwrap_or_default()
                )
            });
        }
        // Half a second of grace: what was sent just before the rights changed is no fault.
        found.check(
            seen,
            levels & needed != 0 || held(&grants, seen.piece.source, at - 0.5).0 & needed != 0,
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
            levels & 0x0C != 0 || held(&grants, seen.piece.source, at - 2.0).0 & 0x0C != 0,
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
                && !seen.sound()
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
        // The operator of a scripted session refuses; in a recording the operator may have consented.
        let consents = |seen: &&Arc<Seen>| {
            seen.kind() == 4
                && seen.at > request.at
                && seen.raw("Requested/Handover LOI").unwrap_or_default() != 0
        };
        if let Some(consent) = view.messages().filter(|_| view.live).find(consents) {
            found.fail(consent, "expected a #4 without a level, or none, where the operator refused the request; one that names a level came");
        }
        let answer = view.messages().find(|seen| {
            let after = seen.at.as_secs_f64() - at;
            let releases = seen.kind() == 1
                && seen.raw("Requested/Handover Access") == Some(0)
                && seen.raw("Requested/Handover LOI").unwrap_or_default() != 0;
            (0.0..1.5).contains(&after) && (matches!(seen.kind(), 4 | 5) || releases)
        });
        if let Some(answer) = answer {
            found.fail(answer, format!("expected a handover request to be shown to the operator; {} came {:.2} s after it, faster than anyone decides", answer.kind(), answer.at.as_secs_f64() - at));
        }
    }
}

fn sends_whole_routes(view: &View<'_>, found: &mut Found) {
    let mut numbers: BTreeSet<i64> = BTreeSet::new();
    let mut named: Vec<(Arc<Seen>, &str, i64)> = Vec::new();
    // Waypoints whose Optional Messages announce 13003 to 13006, and those for which one of these came.
    let (mut announced, mut followed) = (BTreeMap::new(), BTreeSet::new());
    let mut heads = 0;
    let mut load: Option<Arc<Seen>> = None;
    let mut last: Option<Arc<Seen>> = None;
    for seen in view.messages() {
        match seen.kind() {
            13_001..=13_006 => {
                let number = seen
                    .info
                    .and_then(|info| info.field("Waypoint Number"))
                    .and_then(|_| seen.raw("Waypoint Number"));
                // The same bytes again, for a network that loses some, are not a new message.
                let again = view
                    .messages()
                    .any(|other| other.at < seen.at && other.piece.bytes == seen.piece.bytes);
                if let Some(load) = load.as_ref().filter(|_| !again) {
                    let late = seen.at.as_secs_f64() - load.at.as_secs_f64();
                    found.check(seen, late > 5.0, || format!("expected all of a route before the load command; message {} came {late:.2} s after it", seen.kind()));
                }
                if seen.kind() == 13_002 {
                    found.check(
                        seen,
                        number.is_some_and(|number| (1..=65_534).contains(&number)),
                        || format!("expected a Waypoint Number of 1 to 65534, got {number:?}"),
                    );
                    numbers.extend(number);
                    let next = seen.raw("Next Waypoint").unwrap_or_default();
                    found.check(seen, next == 0 || Some(next) != number, || {
                        format!("expected another waypoint as Next Waypoint, or 0; waypoint {next} names itself")
                    });
                    named.push((seen.clone(), "Next Waypoint", next));
                    let optional = seen.raw("Optional Messages for Waypoint");
                    if let (Some(number), Some(1..)) = (number, optional) {
                        announced.insert(number, seen.clone());
                    }
                } else if seen.kind() == 13_001 {
                    let first = seen.raw("Initial Waypoint Number").unwrap_or_default();
                    heads += 1;
                    named.push((seen.clone(), "Initial Waypoint Number", first));
                } else if let Some(number) = number {
                    named.push((seen.clone(), "Waypoint Number", number));
                    followed.insert(number);
                }
                last = Some(seen.clone());
            }
            13_000 if seen.raw("Mission Plan Mode") == Some(2) => {
                found.check(seen, !numbers.is_empty(), || {
                    "expected waypoints before the load command; none was sent".into()
                });
                for (number, point) in &announced {
                    found.check(point, followed.contains(number), || {
                        format!("expected one of 13003 to 13006 for waypoint {number}, whose Optional Messages for Waypoint announces it, before the load command; none came")
                    });
                }
                // A route has a first waypoint, and every other waypoint is the Next Waypoint of some other.
                let reached: BTreeSet<i64> = named
                    .iter()
                    .filter(|(_, field, number)| *field != "Waypoint Number" && *number != 0)
                    .map(|(_, _, number)| *number)
                    .collect();
                let begins = named
                    .iter()
                    .any(|(_, field, number)| *field == "Initial Waypoint Number" && *number != 0);
                found.check(seen, heads == 0 || begins || numbers.is_empty(), || {
                    "expected a route message with the waypoint at which the route begins; Initial Waypoint Number 0 deletes it".into()
                });
                // Without a route message nothing names the first waypoint: one is allowed to be unnamed.
                let lost = numbers.difference(&reached).count();
                found.check(seen, lost <= usize::from(heads == 0), || {
                    format!("expected each waypoint to be the Next Waypoint of another, or the first of a route; {lost} of {} are neither", numbers.len())
                });
                for (point, field, number) in &named {
                    found.check(point, *number == 0 || numbers.contains(number), || format!("expected waypoint {number}, which {field} of {} names, before the load command; it was never sent", point.kind()));
                }
                let twice = load.as_ref().is_some_and(|load| {
                    load.piece.bytes != seen.piece.bytes
                        && last.as_ref().is_none_or(|last| last.at < load.at)
                        && seen.at.as_secs_f64() - load.at.as_secs_f64() < 5.0
                });
                found.check(seen, !twice, || {
                    "expected one load command for a route; another came without a new waypoint"
                        .into()
                });
                load = Some(seen.clone());
            }
            _ => {}
        }
    }
    let end = view
        .datagrams
        .last()
        .map_or(0.0, |datagram| datagram.at.as_secs_f64());
    if let Some(last) = &last {
        let waited = end - last.at.as_secs_f64();
        let loaded = load.as_ref().is_some_and(|load| load.at >= last.at)
            || load
                .as_ref()
                .is_some_and(|load| last.at.as_secs_f64() - load.at.as_secs_f64() < 5.0);
        found.check(last, loaded || waited < 5.0, || {
            format!("expected a load command after the route; none came in {waited:.0} s")
        });
    }
}

/// Message, field and enumeration index that a 44003 is about. Where it says of a whole field that it is not available, the
/// index means nothing.
fn enumerated(seen: &Seen) -> Option<(i64, i64, i64)> {
    if seen.kind() != 44_003 || seen.raw("Field Available") == Some(0) {
        return None;
    }
    Some((
        seen.raw("Reported Message")?,
        seen.raw("Reported Field")?,
        seen.raw("Reported Enumerated Index")?,
    ))
}

/// Whether a 44003 to the sender of this message had marked an index as not available for at least half a second; a later
/// 44003 may give it back.
fn unavailable(view: &View<'_>, index: (i64, i64, i64), sent: &Seen) -> bool {
    view.requests()
        .filter(|seen| {
            enumerated(seen) == Some(index)
                && [sent.piece.source, Id::BROADCAST].contains(&seen.piece.destination)
                && seen.at + Duration::from_millis(500) < sent.at
        })
        .filter_map(|seen| seen.raw("Enumerated Index Enable"))
        .last()
        .is_some_and(|enable| enable < 0)
}

fn only_what_is_available(view: &View<'_>, found: &mut Found) {
    let indices: BTreeSet<(i64, i64, i64)> = view
        .requests()
        .filter_map(|seen| enumerated(seen))
        .collect();
    for (message, number, index) in indices {
        // Fields are counted from 1, the time stamp being the first; 0 is the whole message.
        let field = u16::try_from(message)
            .ok()
            .and_then(stanag_msgs::table::message)
            .and_then(|info| info.fields.get(usize::try_from(number - 1).ok()?));
        let Some((field, values)) = field.and_then(|field| Some((field, field.enumeration?)))
        else {
            continue;
        };
        for seen in view
            .messages()
            .filter(|seen| i64::from(seen.kind()) == message)
        {
            let Some(value) = seen.raw(field.name) else {
                continue;
            };
            // The index of a bit is its number.
            let chosen = match values.kind {
                EnumKind::Enumeration => value == index,
                EnumKind::Bitmap => (0..63).contains(&index) && value >> index & 1 == 1,
            };
            let barred = chosen && unavailable(view, (message, number, index), seen);
            found.check(seen, !barred, || {
                format!(
                    "expected no value that 44003 marks as unavailable (index {index}); {message} with {} {value} came",
                    field.name
                )
            });
        }
    }
}

/// Compares every value of a command with what 41000, 41001 and 41003 declared for its field: integers in steps of
/// the wire, floats in the unit of the field.
fn declared_ranges(view: &View<'_>, found: &mut Found) {
    for declared in view
        .requests()
        .filter(|seen| matches!(seen.kind(), 41_000 | 41_001 | 41_003))
    {
        let (Some(message), Some(number)) = (
            declared.raw("Requested Message"),
            declared.raw("Requested Field"),
        ) else {
            continue;
        };
        let field = u16::try_from(message)
            .ok()
            .and_then(stanag_msgs::table::message)
            .and_then(|info| info.fields.get(usize::try_from(number - 1).ok()?));
        let Some(field) = field else { continue };
        let supported = declared.raw("Field Supported") != Some(0);
        let (low, high) = (declared.value("Min Value"), declared.value("Max Value"));
        for seen in view
            .messages()
            .filter(|seen| i64::from(seen.kind()) == message && seen.at > declared.at)
        {
            let float = declared.kind() == 41_001;
            let sent = if float {
                seen.value(field.name)
            } else {
                seen.raw(field.name).map(|raw| raw as f64)
            };
            let Some(sent) = sent else { continue };
            if !supported {
                found.check(seen, sent == 0.0, || {
                    format!(
                        "expected no {} in message {message}, which the vehicle does not support; got {sent}",
                        field.name
                    )
                });
                continue;
            }
            let slack = if float { field.step() } else { 0.0 };
            let within = low.is_none_or(|low| sent >= low - slack)
                && high.is_none_or(|high| sent <= high + slack);
            found.check(seen, within, || {
                format!(
                    "expected {} of message {message} within the declared {} to {}, got {sent}",
                    field.name,
                    low.unwrap_or(f64::NEG_INFINITY),
                    high.unwrap_or(f64::INFINITY)
                )
            });
        }
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

/// Three times what a sender waits before it repeats.
const ACKNOWLEDGED_S: f64 = 3.0;

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
        let answer = view.messages().find(|seen| {
            seen.kind() == 17_000
                && seen.raw("Original Message Type") == Some(asked.kind().into())
                && seen.raw("Original Message Time Stamp") == asked.stamp()
                && seen.at > asked.at
        });
        found.check(asked, answer.is_some(), || {
            format!(
                "expected 17000 about message {}, which asked for it; none came",
                asked.kind()
            )
        });
        let late = answer.map_or(0.0, |seen| seen.at.as_secs_f64() - at);
        found.check(asked, late <= ACKNOWLEDGED_S, || {
            format!(
                "expected 17000 about message {} within {ACKNOWLEDGED_S:.0} s; it came after {late:.1} s, when it would have been sent again",
                asked.kind()
            )
        });
    }
}

/// A command with new content or a new stamp after this is a new one, s.
const REPEATED_WITHIN_S: f64 = 12.0;
/// The same bytes again this much later are a repetition, not a copy that the network or a second interface made, s.
const REPEATED_AFTER_S: f64 = 0.2;
/// Within this time a command that nothing acknowledged comes again, unless another one has replaced it before, s.
const REPEATED_BEFORE_S: f64 = 6.0;
/// A second press of a button comes sooner than this, where the acknowledgement of the first is still under way, s.
const PRESSED_TWICE_S: f64 = 1.0;

/// A command that was sent last with this content.
struct Command {
    at: f64,
    stamp: i64,
    /// Whether the same bytes were sent again.
    repeated: bool,
}

/// Source, destination, and fields by their names.
type Content = (Id, Id, Vec<(&'static str, Vec<u8>)>);

/// What a command says, and to whom: one button may command each of several vehicles. Its fields, but not its time stamp, nor
/// the number of its activity, which a CUCS may count up with each message. The data as they are where they are no fields.
fn content(seen: &Seen) -> Content {
    let fields = match &seen.fields {
        Ok(fields) => {
            let fields = fields.iter().map(|(&name, bytes)| (name, bytes.clone()));
            fields
                .filter(|(name, _)| !["Time Stamp", "Activity ID"].contains(name))
                .collect()
        }
        Err(_) => vec![("", seen.piece.data.clone())],
    };
    (seen.piece.source, seen.piece.destination, fields)
}

fn repeats_with_the_same_stamp(view: &View<'_>, found: &mut Found) {
    // Compared without the stamp: the same content with another stamp, while nothing had acknowledged the first, is a
    // repetition made wrong.
    let mut acknowledged: BTreeMap<(i64, i64), f64> = BTreeMap::new();
    for seen in view.requests().filter(|seen| seen.kind() == 17_000) {
        let kind = seen.raw("Original Message Type");
        let about = kind.zip(seen.raw("Original Message Time Stamp"));
        if let Some(about) = about {
            acknowledged.entry(about).or_insert(seen.at.as_secs_f64());
        }
    }
    let acknowledged = |kind: u16, stamp: i64| acknowledged.get(&(kind.into(), stamp)).copied();
    let end = view
        .datagrams
        .last()
        .map_or(0.0, |datagram| datagram.at.as_secs_f64());
    let mut open: BTreeMap<(u16, Content), Command> = BTreeMap::new();
    let mut times: BTreeMap<Vec<u8>, (usize, Arc<Seen>)> = BTreeMap::new();
    for seen in view
        .messages()
        .filter(|seen| seen.piece.ack() && matches!(seen.kind(), 2000..=2999))
    {
        let Some(stamp) = seen.stamp() else { continue };
        let at = seen.at.as_secs_f64();
        let command = open.entry((seen.kind(), content(seen))).or_insert(Command {
            at,
            stamp,
            repeated: false,
        });
        if stamp == command.stamp {
            found.saw();
            command.repeated |= at - command.at > REPEATED_AFTER_S;
        } else {
            // Once the same bytes came again, and brought nothing, the operator may command it once more. What came after
            // the new stamp was no reason to send one; in a recording the answer may have had a long way.
            let first = command.stamp;
            let waited = at - command.at;
            let answered = acknowledged(seen.kind(), first)
                .is_some_and(|answer| answer <= at || waited < PRESSED_TWICE_S || !view.live);
            let again = !command.repeated && waited < REPEATED_WITHIN_S && !answered;
            found.check(seen, !again, || format!("expected the repetition of an unacknowledged {} to have the same stamp; {first} became {stamp}", seen.kind()));
            *command = Command {
                at,
                stamp,
                repeated: false,
            };
        }
        times
            .entry(seen.piece.bytes.clone())
            .or_insert_with(|| (0, seen.clone()))
            .0 += 1;
    }
    for (count, seen) in times.values() {
        found.check(seen, *count <= 20, || {
            format!(
                "expected a limited number of repetitions of a {}, got {count}",
                seen.kind()
            )
        });
        // The first was lost and never sent again: neither these bytes nor, as judged above, the same content with
        // another stamp. Another command of the type in time is a reason not to: the older one must not come after it.
        let (at, stamp) = (seen.at.as_secs_f64(), seen.stamp().unwrap_or_default());
        let ends = |seen: &Seen| (seen.piece.source, seen.piece.destination);
        let replaced = view
            .messages()
            .filter(|other| other.kind() == seen.kind() && ends(other) == ends(seen))
            .filter(|other| other.at > seen.at && other.stamp() != seen.stamp())
            .map(|other| other.at.as_secs_f64())
            .next();
        let waited = replaced.unwrap_or(end) - at;
        let lost = acknowledged(seen.kind(), stamp).is_none() && *count == 1;
        found.check(seen, !lost || waited <= REPEATED_BEFORE_S, || {
            format!("expected a {} that nothing acknowledged to be sent again; it was not in {waited:.0} s", seen.kind())
        });
    }
}

/// Commands name a single vehicle as destination and the CUCS itself as source.
fn commands_are_addressed(view: &View<'_>, found: &mut Found) {
    let vehicles: BTreeSet<Id> = view.requests().map(|seen| seen.piece.source).collect();
    for seen in view.messages() {
        let (source, destination) = (seen.piece.source, seen.piece.destination);
        found.check(seen, !vehicles.contains(&source), || {
            format!(
                "expected the CUCS as source of message {}, got the vehicle {source}",
                seen.kind()
            )
        });
        let everybody = matches!(seen.kind(), 1 | 16_002 | 28_000 | 17_000);
        found.check(seen, everybody || destination != Id::BROADCAST, || {
            format!(
                "expected message {} to be addressed to one vehicle, got the broadcast id",
                seen.kind()
            )
        });
    }
}

/// How often the same 2016 comes, each time as a new one, before it is no operator who commands it, and how soon, s.
const STREAM: usize = 3;
const STREAM_WITHIN_S: f64 = 3.0;

/// Without an acknowledgement nothing is known to be lost, and nothing is to be sent again: a 2016 that comes again and
/// again with new stamps is a new command each time. Judged in a session only, whose operator is asked for it once.
fn commands_once(view: &View<'_>, found: &mut Found) {
    let mut last: BTreeMap<Content, (f64, usize)> = BTreeMap::new();
    // The same bytes again are no new command, however late the network delivers them.
    for seen in view
        .once()
        .filter(|seen| view.live && seen.kind() == 2016 && !seen.piece.ack())
        .filter(|seen| seen.stamp().is_some())
    {
        let at = seen.at.as_secs_f64();
        let (before, count) = last.entry(content(seen)).or_insert((at, 0));
        *count = if at - *before < STREAM_WITHIN_S {
            *count + 1
        } else {
            1
        };
        *before = at;
        let count = *count;
        found.check(seen, count < STREAM, || {
            format!("expected a 2016 that asks for no acknowledgement to be sent once for one command; the same came {count} times, each with a new stamp")
        });
    }
}

/// 17000 goes to the station that requested it, and names the message it is about.
fn acknowledges_to_whom_it_may_concern(view: &View<'_>, found: &mut Found) {
    for seen in view.messages().filter(|seen| seen.kind() == 17_000) {
        let (kind, stamp) = (
            seen.raw("Original Message Type"),
            seen.raw("Original Message Time Stamp"),
        );
        let asked = view.requests().find(|asked| {
            Some(i64::from(asked.kind())) == kind && asked.stamp() == stamp && asked.at <= seen.at
        });
        found.check(seen, asked.is_some(), || {
            format!("expected 17000 about a message of the vehicle; none of type {kind:?} has the stamp {stamp:?}")
        });
        if let Some(asked) = asked {
            found.check(seen, seen.piece.destination == asked.piece.source, || {
                format!(
                    "expected 17000 to {}, which asked; it went to {}",
                    asked.piece.source, seen.piece.destination
                )
            });
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bench::net::Datagram;
    use crate::passive::view::trace::{of_cucs, to_cucs};
    use crate::passive::view::verdict_on;
    use crate::verdict::Verdict;
    use crate::wire::Draft;

    /// The loiter mode, commanded at these times, ms, with these stamps.
    fn run(commands: &[(u64, i64)], acked: bool) -> Vec<Datagram> {
        let draft = |stamp: i64| {
            let draft = Draft::new(2016)
                .raw("Time Stamp", stamp)
                .raw("Select Flight Path Control Mode", 12);
            if acked { draft.acked() } else { draft }
        };
        commands
            .iter()
            .map(|&(at_ms, stamp)| of_cucs(at_ms, draft(stamp)))
            .collect()
    }

    #[test]
    fn a_repetition_with_a_new_stamp_is_found_however_late() {
        let judged =
            |commands: &[(u64, i64)]| verdict_on(&run(commands, true), repeats_with_the_same_stamp);
        assert_eq!(judged(&[(0, 1), (1000, 1), (2000, 1)]), Verdict::Pass);
        assert_eq!(judged(&[(0, 1), (1000, 2)]), Verdict::Fail);
        assert_eq!(judged(&[(0, 1), (6000, 2)]), Verdict::Fail);
        // Another press of the button, after the repetitions or much later.
        assert_eq!(judged(&[(0, 1), (1000, 1), (4000, 2)]), Verdict::Pass);
        assert_eq!(judged(&[(0, 1), (1000, 1), (20_000, 2)]), Verdict::Pass);
        // A copy that the network made is no repetition.
        assert_eq!(judged(&[(0, 1), (1, 1), (6000, 2)]), Verdict::Fail);
    }

    #[test]
    fn an_activity_that_is_counted_up_makes_no_new_command() {
        let command = |(at_ms, activity): (u64, i64)| {
            let draft = Draft::new(2016)
                .raw("Select Flight Path Control Mode", 12)
                .raw("Activity ID", activity);
            of_cucs(at_ms, draft.acked())
        };
        let all = [(0, 1), (1000, 2)].map(command);
        assert_eq!(verdict_on(&all, repeats_with_the_same_stamp), Verdict::Fail);
    }

    #[test]
    fn a_command_that_was_acknowledged_may_be_given_again() {
        let mut all = run(&[(0, 1)], true);
        all.push(acknowledged(100, 1));
        all.extend(run(&[(2000, 2)], true));
        assert_eq!(verdict_on(&all, repeats_with_the_same_stamp), Verdict::Pass);
    }

    /// The acknowledgement of the command with this stamp, received at this time, ms.
    fn acknowledged(at_ms: u64, stamp: i64) -> Datagram {
        let answer = Draft::new(17_000)
            .raw("Original Message Time Stamp", stamp)
            .raw("Original Message Type", 2016);
        to_cucs(at_ms, answer)
    }

    #[test]
    fn what_is_acknowledged_after_a_new_stamp_was_no_reason_for_it() {
        let judged = |second_ms: u64, answer_ms: u64| {
            let mut all = run(&[(0, 1)], true);
            all.extend(run(&[(second_ms, 2)], true));
            all.push(acknowledged(answer_ms, 1));
            all.push(acknowledged(answer_ms + 10, 2));
            all.sort_by_key(|datagram| datagram.at);
            verdict_on(&all, repeats_with_the_same_stamp)
        };
        assert_eq!(judged(2000, 2100), Verdict::Fail);
        assert_eq!(judged(2000, 1900), Verdict::Pass);
        // Pressed twice before the answer can have come.
        assert_eq!(judged(400, 500), Verdict::Pass);
    }

    #[test]
    fn a_lost_command_is_repeated_unless_another_replaces_it_in_time() {
        let judged = |next_ms: u64| {
            let mut all = run(&[(0, 1)], true);
            let other = Draft::new(2016)
                .raw("Time Stamp", 2)
                .raw("Select Flight Path Control Mode", 11);
            all.push(of_cucs(next_ms, other.acked()));
            all.push(acknowledged(next_ms + 50, 2));
            verdict_on(&all, repeats_with_the_same_stamp)
        };
        assert_eq!(judged(3_000), Verdict::Pass);
        assert_eq!(judged(20_000), Verdict::Fail);
        // Nor does another press of the button do what the repetition should have done.
        let pressed = run(&[(0, 1), (20_000, 2)], true);
        assert_eq!(
            verdict_on(&pressed, repeats_with_the_same_stamp),
            Verdict::Fail
        );
    }

    /// All vehicles are to hold.
    #[test]
    fn one_command_to_each_of_several_vehicles_is_no_repetition() {
        let command = |at_ms: u64, stamp: i64, vehicle: u32, acked: bool| {
            let mut draft = Draft::new(2016)
                .raw("Time Stamp", stamp)
                .raw("Select Flight Path Control Mode", 12);
            draft.destination = Some(Id(0x1b00_0101 + vehicle));
            of_cucs(at_ms, if acked { draft.acked() } else { draft })
        };
        // The first one's is lost, and repeated; or it is not.
        let mut all = vec![
            command(0, 1, 0, true),
            command(100, 2, 1, true),
            acknowledged(150, 2),
            command(2_000, 1, 0, true),
            acknowledged(2_050, 1),
        ];
        assert_eq!(verdict_on(&all, repeats_with_the_same_stamp), Verdict::Pass);
        all.truncate(3);
        all.push(command(20_000, 3, 1, true));
        all.push(acknowledged(20_050, 3));
        assert_eq!(verdict_on(&all, repeats_with_the_same_stamp), Verdict::Fail);

        let each: Vec<_> = (0..5)
            .map(|vehicle| {
                command(
                    u64::from(vehicle) * 10,
                    i64::from(vehicle) + 1,
                    vehicle,
                    false,
                )
            })
            .collect();
        assert_eq!(verdict_on(&each, commands_once), Verdict::Pass);
    }

    #[test]
    fn a_stream_of_commands_is_no_operator() {
        let judged = |commands: &[(u64, i64)]| verdict_on(&run(commands, false), commands_once);
        assert_eq!(judged(&[(0, 1), (1000, 2), (2000, 3)]), Verdict::Fail);
        assert_eq!(judged(&[(0, 1), (1000, 2)]), Verdict::Pass);
        assert_eq!(judged(&[(0, 1), (5000, 2), (10_000, 3)]), Verdict::Pass);
        // The same bytes again are no new command.
        assert_eq!(judged(&[(0, 1), (1000, 1), (2000, 1)]), Verdict::Pass);
        // Two commands, of which the network delivers copies in another order.
        let copies = [(0, 1), (1000, 2), (1100, 1), (1200, 2)];
        assert_eq!(judged(&copies), Verdict::Pass);
    }

    /// 44003 about Location Type 1, and a relative waypoint 2 s later.
    fn relative_after(enabled: &[i64]) -> Verdict {
        let declared = |(at_ms, &enabled): (u64, &i64)| {
            let draft = Draft::new(44_003)
                .raw("Reported Message", 13_002)
                .raw("Reported Field", 5)
                .raw("Reported Enumerated Index", 1)
                .raw("Enumerated Index Enable", enabled);
            to_cucs(at_ms, draft)
        };
        let mut all: Vec<Datagram> = (0..).zip(enabled).map(declared).collect();
        let waypoint = Draft::new(13_002)
            .raw("Waypoint Number", 1)
            .raw("Location Type", 1);
        all.push(of_cucs(2000, waypoint));
        verdict_on(&all, only_what_is_available)
    }

    #[test]
    fn a_value_that_is_not_available_is_not_sent() {
        assert_eq!(relative_after(&[-2]), Verdict::Fail);
        assert_eq!(relative_after(&[-1]), Verdict::Fail);
        assert_eq!(relative_after(&[-2, 1]), Verdict::Pass);
        assert_eq!(relative_after(&[]), Verdict::Inconclusive);
    }

    /// 44003 about landing lights, bit 6 of 2007, and these lights a second later.
    fn lights_after(declared: Draft, lights: i64) -> Verdict {
        let declared = declared
            .raw("Reported Message", 2007)
            .raw("Reported Field", 2)
            .raw("Reported Enumerated Index", 6)
            .raw("Enumerated Index Enable", -2);
        let command = Draft::new(2007).raw("Set Lights", lights);
        let all = [to_cucs(0, declared), of_cucs(1000, command)];
        verdict_on(&all, only_what_is_available)
    }

    #[test]
    fn the_index_of_a_bit_is_its_number() {
        let declared = Draft::new(44_003);
        assert_eq!(lights_after(declared.clone(), 0x41), Verdict::Fail);
        assert_eq!(lights_after(declared, 6), Verdict::Pass);
    }

    #[test]
    fn availability_is_that_of_a_value_and_for_who_was_sent_it() {
        // Of the whole field: the index means nothing.
        let field = Draft::new(44_003).raw("Field Available", 0);
        assert_eq!(lights_after(field, 0x41), Verdict::Inconclusive);
        let mut elsewhere = Draft::new(44_003);
        elsewhere.destination = Some(Id(0x1b00_00a1));
        assert_eq!(lights_after(elsewhere, 0x41), Verdict::Pass);
    }
}
