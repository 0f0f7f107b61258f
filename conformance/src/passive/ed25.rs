//! Judges of Edition 2.5: its wrapper, its full vectors, its numbers. Rules that it shares with later editions are
//! judged by the other judges, on the counterparts of its messages in Edition 4 ([`SHARED`]).

use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;
use std::time::Duration;

use stanag_msgs::ed25::Version;
use stanag_msgs::table::Wire;

use super::view::{Found, Judge, View};
use crate::wire::{Seen, WRAPPER_25};

pub(super) const JUDGES: &[Judge] = &[
    Judge {
        rule: "WRAP-002",
        judge: wrapper_of_34_bytes,
    },
    Judge {
        rule: "WRAP-003",
        judge: length_is_that_of_all_fields,
    },
    Judge {
        rule: "WRAP-006",
        judge: sum_over_the_message,
    },
    Judge {
        rule: "WRAP-011",
        judge: version_text,
    },
    Judge {
        rule: "WRAP-015",
        judge: instances_and_sequence,
    },
    Judge {
        rule: "SCALAR-001",
        judge: byte_order,
    },
    Judge {
        rule: "SCALAR-002",
        judge: floats_are_numbers,
    },
    Judge {
        rule: "TIME-001",
        judge: seconds_since_1970,
    },
    Judge {
        rule: "ACK-002",
        judge: acknowledged_by_configuration_only,
    },
    Judge {
        rule: "ACK-004",
        judge: acknowledgements_name_a_message,
    },
];

/// Rules whose judges read bytes, texts, or values by the table: they run on the messages of Edition 2.5 themselves.
pub(super) const AS_THEY_ARE: &[&str] = &["WRAP-004", "SCALAR-005", "SCALAR-006"];
/// Rules whose judges are written in messages of Edition 4: they run on the counterparts.
pub(super) const SHARED: &[&str] = &[
    "DISC-006",
    "DISC-010",
    "AUTH-016",
    "STAT-005",
    "STAT-017",
    "TIME-003",
    "CONF-003",
    "AUTH-011",
    "ROUTE-012",
    "ROUTE-024",
    "CONF-007",
    "ALERT-001",
    "ALERT-003",
];

/// Number of the acknowledgement; #1401 configures it.
const ACKNOWLEDGEMENT: u16 = 1400;
const CONFIGURATION: u16 = 1401;
/// The request by which a CUCS discovers and connects.
const CONNECTION: u16 = 1;
/// Seconds from 1970 to 2000.
const EPOCH_2000_S: f64 = 946_684_800.0;

fn wrapper_of_34_bytes(view: &View<'_>, found: &mut Found) {
    for datagram in view
        .of_subject()
        .filter(|datagram| !datagram.bytes.is_empty())
    {
        found.saw();
        let Some(fault) = &datagram.fault else {
            if datagram
                .originals
                .iter()
                .any(|seen| seen.piece.wrapped.is_none())
            {
                found.fail_at(
                    datagram,
                    "expected the wrapper of Edition 2.5; this is the header of a later edition",
                );
            }
            continue;
        };
        // Six words of 32 bits, the version as a number: the arithmetic of the text, and of skylight-uas.
        let word = datagram.bytes.get(12..16).map_or(0, |word| {
            word.iter()
                .fold(0, |value, &byte| value << 8 | usize::from(byte))
        });
        let reading = if datagram.bytes.len() == 24 + word + 4 {
            "; a wrapper of six words, the version as a number (the reading of 24 bytes), would fit"
        } else {
            ""
        };
        found.fail_at(
            datagram,
            format!("expected datagrams that split into messages with {WRAPPER_25} bytes of wrapper; {fault}{reading}"),
        );
    }
}

fn length_is_that_of_all_fields(view: &View<'_>, found: &mut Found) {
    for seen in view.messages() {
        let Some(info) = seen.info else { continue };
        let fixed = info.fields.iter().all(|field| field.wire.bytes().is_some());
        if fixed {
            let (is, expected) = (seen.piece.data.len(), info.full_bytes());
            found.check(seen, is == expected, || {
                format!("expected {expected} bytes of data in #{}, where every field is always sent; got {is}", info.id)
            });
        }
    }
}

fn sum_over_the_message(view: &View<'_>, found: &mut Found) {
    for seen in view.messages() {
        let (value, expected) = seen.piece.checksums();
        found.check(seen, value == expected, || {
            format!("expected checksum 0x{expected:08x}, the sum of the bytes before it, in #{}; got 0x{value:08x}", seen.kind())
        });
    }
}

fn version_text(view: &View<'_>, found: &mut Found) {
    // By receiver: each may speak another one.
    let mut first: BTreeMap<u32, String> = BTreeMap::new();
    for seen in view.messages() {
        let Some(wrapped) = &seen.piece.wrapped else {
            continue;
        };
        let text = wrapped.text();
        found.check(seen, Version::from_text(&text).is_some(), || {
            let known: Vec<&str> = Version::ALL.iter().map(|version| version.text()).collect();
            format!(
                "expected one of the versions {}, got {text:?}",
                known.join(", ")
            )
        });
        found.check(seen, wrapped.version.contains(&0), || {
            "expected the version to end in NUL within its ten bytes".into()
        });
        let first = first.entry(seen.piece.destination.0);
        let first = first.or_insert_with(|| text.clone());
        found.check(seen, *first == text, || {
            format!(
                "expected the same version in each message of the subject to {}: {first:?}, then {text:?}",
                seen.piece.destination
            )
        });
    }
}

/// An instance id that is this much lower than the one before is none that was overtaken: they are counted again.
const COUNTED_AGAIN: u32 = 16;
/// A pause of all messages of the subject in which it may have been restarted.
const RESTARTS_FOR: Duration = Duration::from_secs(1);

fn instances_and_sequence(view: &View<'_>, found: &mut Found) {
    let mut known: BTreeMap<(u32, u16), BTreeMap<u32, Arc<Seen>>> = BTreeMap::new();
    let mut last: BTreeMap<(u32, u16), u32> = BTreeMap::new();
    // After a restart the sender may count from the beginning, as in another mission. In a run only the suite restarts it:
    // there ids that come again are those of a counter that is too small.
    let restarts = !view.live || view.profile.means.restart.is_some();
    let mut latest: Option<Duration> = None;
    let mut resumed = Duration::ZERO;
    for seen in view.messages() {
        let Some(wrapped) = &seen.piece.wrapped else {
            continue;
        };
        if latest.is_some_and(|latest| seen.at.saturating_sub(latest) > RESTARTS_FOR) {
            resumed = seen.at;
        }
        latest = Some(seen.at);
        let (key, instance) = ((seen.piece.source.0, seen.kind()), wrapped.instance);
        let of_kind = known.entry(key).or_default();
        // The same bytes again are a duplicate by the network, or by several interfaces.
        let before = of_kind.get(&instance);
        let copy = before.is_some_and(|before| before.piece.bytes == seen.piece.bytes);
        if !copy {
            let before = last.insert(key, instance).unwrap_or(instance);
            let first = of_kind.first_key_value().map(|(first, _)| *first);
            let lowest = instance < before && first.is_some_and(|first| instance <= first);
            let falls = lowest || before.saturating_sub(instance) > COUNTED_AGAIN;
            // Where one message of the kind came before a pause, the first one after it has its id again.
            let of_same = of_kind.get(&instance).filter(|_| of_kind.len() == 1);
            let begins = of_same.is_some_and(|same| same.at < resumed);
            if restarts && (falls || begins) {
                known.clear();
                last = BTreeMap::from([(key, instance)]);
            }
        }
        let of_kind = known.entry(key).or_default();
        let again = !copy && of_kind.contains_key(&instance);
        found.check(seen, !again, || {
            format!(
                "expected an instance id of its own for each #{}; {instance} came twice with other content",
                seen.kind()
            )
        });
        found.check(seen, wrapped.sequence == u32::MAX, || {
            format!(
                "expected the unused packet sequence number to be -1, got 0x{:08x}",
                wrapped.sequence
            )
        });
        of_kind.entry(instance).or_insert_with(|| seen.clone());
    }
}

fn byte_order(view: &View<'_>, found: &mut Found) {
    for datagram in view.of_subject() {
        let Some(word) = datagram.bytes.get(18..22) else {
            continue;
        };
        found.saw();
        let other = u32::from_le_bytes([word[0], word[1], word[2], word[3]]) as usize;
        if datagram.fault.is_some() && datagram.bytes.len() == WRAPPER_25 + other {
            found.fail_at(datagram, format!("expected the most significant byte first; the length fits only the other way round ({other} bytes)"));
        }
    }
}

fn floats_are_numbers(view: &View<'_>, found: &mut Found) {
    for seen in view.messages() {
        let Some(info) = seen.info else { continue };
        for field in info.fields {
            if !matches!(field.wire, Wire::F32 | Wire::F64) {
                continue;
            }
            let Some(value) = seen.value(field.name) else {
                continue;
            };
            found.check(seen, value.is_finite(), || {
                format!(
                    "expected a number in {} of #{}, got {value}",
                    field.name, info.id
                )
            });
            if let Some((low, high)) = field.range
                && (value < low || value > high)
            {
                found.warn(
                    seen,
                    format!(
                        "{} of #{} is {value}, outside of the text's {low} to {high} {}",
                        field.name,
                        info.id,
                        field.unit.unwrap_or_default()
                    ),
                );
            }
        }
    }
}

fn seconds_since_1970(view: &View<'_>, found: &mut Found) {
    for seen in view.messages() {
        let Some(stamp) = seen.value("Time Stamp") else {
            continue;
        };
        let off = stamp - (seen.wall_ms as f64 / 1000.0 + EPOCH_2000_S);
        // Only in a live run one clock stamps both ends; in a recording an offset of days is not the subject's fault.
        let most = if view.live { 5.0 } else { 30.0 * 86_400.0 };
        let named = if (off + EPOCH_2000_S).abs() < 86_400.0 {
            ": seconds since 2000"
        } else if (stamp / 1000.0 - seen.wall_ms as f64 / 1000.0 - EPOCH_2000_S).abs() < 86_400.0 {
            ": milliseconds"
        } else {
            ""
        };
        found.check(seen, off.abs() <= most, || {
            format!("expected seconds since 1970 in the time stamp of #{}, got {stamp}, {off:.0} s off{named}", seen.kind())
        });
    }
}

/// Which message a #1400 is about: type and instance.
fn about(seen: &Seen) -> (Option<i64>, Option<i64>) {
    let named = |part: &str| {
        let field = seen
            .info?
            .fields
            .iter()
            .find(|field| field.name.contains(part))?;
        seen.raw(field.name)
    };
    (named("Message Type"), named("Instance"))
}

fn acknowledged_by_configuration_only(view: &View<'_>, found: &mut Found) {
    let mut configured: BTreeSet<i64> = BTreeSet::new();
    // CUCSs whose connection is in the traffic from its beginning, and that have configured something in it.
    let (mut first, mut whole) = (BTreeMap::new(), BTreeSet::new());
    for seen in view.requests() {
        let cucs = seen.piece.source;
        let begins = *first.entry(cucs).or_insert(seen.kind()) == CONNECTION;
        if seen.kind() == CONFIGURATION {
            configured.extend(about(seen).0);
            if begins {
                whole.insert(cucs);
            }
        }
    }
    for seen in view
        .messages()
        .filter(|seen| seen.kind() == ACKNOWLEDGEMENT)
    {
        let Some(kind) = about(seen).0 else { continue };
        let asked = configured.contains(&kind);
        // A recording may begin after the #1401.
        if !asked && !view.live && !whole.contains(&seen.piece.destination) {
            found.missed(format!(
                "#1400 about #{kind} to {}, whose #1401 may have come before the recording",
                seen.piece.destination
            ));
            continue;
        }
        found.check(seen, asked, || {
            format!("expected no #1400 about #{kind}, which no #1401 asked to be acknowledged")
        });
    }
}

fn acknowledgements_name_a_message(view: &View<'_>, found: &mut Found) {
    let mut sent: BTreeSet<(i64, i64)> = BTreeSet::new();
    // Time stamps of the messages of each CUCS, bit by bit.
    let mut stamps: BTreeSet<(u32, i64, u64)> = BTreeSet::new();
    for seen in view.requests() {
        let Some(wrapped) = &seen.piece.wrapped else {
            continue;
        };
        let kind = i64::from(seen.kind());
        sent.insert((kind, i64::from(wrapped.instance)));
        let stamp = seen.value("Time Stamp");
        stamps.extend(stamp.map(|stamp| (seen.piece.source.0, kind, stamp.to_bits())));
    }
    for seen in view
        .messages()
        .filter(|seen| seen.kind() == ACKNOWLEDGEMENT)
    {
        let (Some(kind), Some(instance)) = about(seen) else {
            continue;
        };
        let instance = i64::from(instance as u32);
        let known = sent.contains(&(kind, instance));
        // A recording may begin between a message and its acknowledgement, and may lack a datagram.
        let stamp = seen.value("Original Message Time Stamp");
        let absent = stamp.filter(|&stamp| stamp != 0.0).is_some_and(|stamp| {
            !stamps.contains(&(seen.piece.destination.0, kind, stamp.to_bits()))
        });
        if !known && !view.live && absent {
            found.missed(format!(
                "#1400 about #{kind} with instance {instance}, which is not in the recording"
            ));
            continue;
        }
        found.check(seen, known, || {
            format!("expected #1400 to name a message that was sent; #{kind} with instance {instance} was not")
        });
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bench::net::Datagram;
    use crate::passive::view::{verdict_on, verdict_on_recorded};
    use crate::verdict::Verdict;
    use crate::wire::Direction;

    /// A message of this type with this instance id, after so many ms, which its time stamp makes another one.
    fn counted(at_ms: u64, kind: u32, instance: u32) -> Datagram {
        let mut bytes = b"2.5\0\0\0\0\0\0\0".to_vec();
        // Its data are a time stamp and two ids; no stream.
        for word in [instance, kind, 16, u32::MAX, u32::MAX] {
            bytes.extend(word.to_be_bytes());
        }
        bytes.extend((at_ms as f64).to_be_bytes());
        bytes.extend([0x1b, 0, 1, 1, 0x1b, 0, 0, 0xa0]);
        let sum: u32 = bytes.iter().map(|&byte| u32::from(byte)).sum();
        bytes.extend(sum.to_be_bytes());
        let at = Duration::from_millis(at_ms);
        let ends = (([127, 0, 0, 1], 1).into(), ([127, 0, 0, 1], 2).into());
        Datagram::new((at, at), Direction::Received, 0, ends, bytes, None)
    }

    /// What is found in a run, and in a recording.
    fn both(datagrams: &[Datagram]) -> [Verdict; 2] {
        let judge = instances_and_sequence;
        [
            verdict_on(datagrams, judge),
            verdict_on_recorded(datagrams, judge),
        ]
    }

    #[test]
    fn after_a_restart_the_only_id_of_a_kind_comes_again() {
        let once = [counted(0, 20, 1), counted(100, 101, 1)];
        assert_eq!(both(&once), [Verdict::Pass; 2]);
        // Of the first kind after the pause, and of another one, which a new kind comes before.
        for after in [
            vec![counted(2_000, 20, 1), counted(2_100, 101, 1)],
            vec![counted(2_000, 21, 1), counted(2_100, 20, 1)],
        ] {
            let restarted = [once.to_vec(), after].concat();
            assert_eq!(both(&restarted), [Verdict::Fail, Verdict::Pass]);
        }
        // Without a pause, and twice after one.
        let at_once = [once.to_vec(), vec![counted(200, 101, 1)]].concat();
        assert_eq!(both(&at_once), [Verdict::Fail; 2]);
        let twice = [counted(2_000, 101, 1), counted(2_100, 101, 1)];
        let twice = [once.to_vec(), twice.to_vec()].concat();
        assert_eq!(both(&twice), [Verdict::Fail; 2]);
    }

    #[test]
    fn a_counter_that_is_too_small_is_found_in_a_run() {
        let wraps: Vec<_> = (0..300_u32)
            .map(|step| counted(u64::from(step) * 100, 101, step % 256))
            .collect();
        assert_eq!(both(&wraps[..256]), [Verdict::Pass; 2]);
        assert_eq!(both(&wraps), [Verdict::Fail, Verdict::Pass]);
    }
}
