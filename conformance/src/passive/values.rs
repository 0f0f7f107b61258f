//! Judges of SCALAR, PV and TIME: numbers, texts, presence vectors and time stamps of all recorded messages.

use std::collections::{BTreeMap, BTreeSet};
use std::f64::consts::FRAC_PI_2;

use stanag_msgs::DecodeError;
use stanag_msgs::field::EnumKind;
use stanag_msgs::table::Wire;

use super::view::{Found, Judge, OVERTAKEN_MS, Tally, View};
use crate::bench::flight::Fix;
use crate::wire::Seen;

pub(super) const JUDGES: &[Judge] = &[
    Judge {
        rule: "SCALAR-001",
        judge: vehicle_type_byte_order,
    },
    Judge {
        rule: "SCALAR-003",
        judge: positions_are_on_the_globe,
    },
    Judge {
        rule: "SCALAR-005",
        judge: texts_end_in_nul,
    },
    Judge {
        rule: "SCALAR-006",
        judge: reserved_values_are_not_sent,
    },
    Judge {
        rule: "PV-001",
        judge: width_of_the_vector,
    },
    Judge {
        rule: "PV-002",
        judge: first_bit_is_the_time_stamp,
    },
    Judge {
        rule: "PV-003",
        judge: only_present_fields,
    },
    Judge {
        rule: "PV-006",
        judge: bits_beyond_the_fields,
    },
    Judge {
        rule: "TIME-002",
        judge: milliseconds_since_2000,
    },
    Judge {
        rule: "TIME-003",
        judge: stamps_are_not_in_the_future,
    },
    Judge {
        rule: "TIME-004",
        judge: stamps_rise,
    },
    Judge {
        rule: "STAT-014",
        judge: no_position_at_0_0,
    },
];

fn vehicle_type_byte_order(view: &View<'_>, found: &mut Found) {
    // Of each vehicle: the type of one may have the bytes of another's exchanged.
    let mut complete: BTreeMap<u32, i64> = BTreeMap::new();
    for seen in view.messages().filter(|seen| seen.kind() == 41005) {
        let value = seen.raw("Vehicle Type").filter(|&value| value != 0);
        if let Some(value) = value {
            complete.entry(seen.piece.source.0).or_insert(value);
        }
    }
    for seen in view.messages().filter(|seen| matches!(seen.kind(), 2 | 3)) {
        let Some(value) = seen.raw("Vehicle Type").filter(|&value| value != 0) else {
            continue;
        };
        let complete = complete.get(&seen.piece.source.0).copied();
        let swapped = i64::from((value as u16).swap_bytes());
        found.check(seen, complete.is_none_or(|other| other != swapped || other == value), || {
            format!("expected Vehicle Type with its most significant byte first; {} has 0x{value:04x}, 41005 has 0x{swapped:04x}", seen.kind())
        });
        // The list of types has small numbers only, so a low byte of 0 looks like swapped bytes; but the custodian may have
        // given out more than 255 by now, and only another message shows which it is.
        if value & 0xFF == 0 && complete.is_none() {
            found.warn(seen, format!("Vehicle Type 0x{value:04x} is a number of the custodian's list only the other way round, and no 41005 shows which was meant"));
        }
    }
}

fn positions_are_on_the_globe(view: &View<'_>, found: &mut Found) {
    let claim = |seen: &Seen| {
        let mut vehicles = view.profile.vehicle.iter();
        let claimed = vehicles.find(|claim| claim.id.parse() == Ok(seen.piece.source));
        claimed.and_then(|claim| claim.position)
    };
    let mut compared = BTreeSet::new();
    for seen in view.messages().filter(|seen| seen.kind() == 4000) {
        let (Some(latitude), Some(longitude)) = (seen.value("Latitude"), seen.value("Longitude"))
        else {
            continue;
        };
        found.check(seen, latitude.abs() <= FRAC_PI_2 + 1e-6, || {
            format!("expected a latitude of -90 to 90 degrees, got {:.4}; offset binary in place of two's complement gives such values", latitude.to_degrees())
        });
        // The profile's position is where the vehicle is when the run begins, so only its first 4000 is compared, and none
        // of a recording, which may begin in flight.
        let first = compared.insert(seen.piece.source);
        if let (Some([north, east]), true) = (claim(seen), first && view.live) {
            let fix = Fix::of(seen);
            let away = fix.map_or(0.0, |fix| {
                fix.distance(north.to_radians(), east.to_radians())
            });
            found.check(seen, away < 2_000.0, || {
                format!(
                    "expected a position near {north:.4}, {east:.4} as the profile says; got {:.4}, {:.4}",
                    latitude.to_degrees(),
                    longitude.to_degrees()
                )
            });
        }
    }
}

fn texts_end_in_nul(view: &View<'_>, found: &mut Found) {
    for seen in view.messages() {
        let (Some(info), Ok(fields)) = (seen.info, &seen.fields) else {
            continue;
        };
        for field in info
            .fields
            .iter()
            .filter(|field| matches!(field.wire, Wire::Char(_)))
        {
            let Some(bytes) = fields.get(field.name) else {
                continue;
            };
            let end = bytes.iter().position(|&byte| byte == 0);
            found.check(seen, end.is_some(), || {
                format!(
                    "expected {} of message {} to end in NUL within its {} bytes; it has none",
                    field.name,
                    seen.kind(),
                    bytes.len()
                )
            });
            let end = end.unwrap_or(bytes.len());
            found.check(seen, bytes[..end].is_ascii(), || {
                format!(
                    "expected 7-bit characters in {} of message {}",
                    field.name,
                    seen.kind()
                )
            });
            found.check(seen, bytes[end..].iter().all(|&byte| byte == 0), || {
                format!(
                    "expected {} of message {} to be filled up with NUL; something else follows its end",
                    field.name,
                    seen.kind()
                )
            });
        }
    }
}

/// Whether a range of the table, `3-10` or `18`, holds this value.
fn within(range: &str, value: i64) -> bool {
    let mut bounds = range
        .split('-')
        .filter_map(|bound| bound.trim().parse::<i64>().ok());
    let low = bounds.next();
    let high = bounds.next().or(low);
    low.is_some_and(|low| low <= value) && high.is_some_and(|high| value <= high)
}

fn reserved_values_are_not_sent(view: &View<'_>, found: &mut Found) {
    // Vehicle-specific values that 41002 has described, by message and field.
    let described: Vec<(i64, i64, i64)> = view
        .messages()
        .filter(|seen| seen.kind() == 41002)
        .filter_map(|seen| {
            let field = |name: &str| seen.raw(name);
            Some((
                field("Requested Message")?,
                field("Requested Field")?,
                field("Vehicle Specific Enumeration Index")?,
            ))
        })
        .collect();
    for seen in view.messages() {
        let Some(info) = seen.info else { continue };
        for field in info.fields {
            let bits = field
                .enumeration
                .filter(|values| values.kind == EnumKind::Bitmap && !values.values.is_empty());
            if let (Some(bits), Some(value)) = (bits, seen.raw(field.name)) {
                let defined = bits
                    .values
                    .iter()
                    .filter(|(_, _, text)| *text != "reserved")
                    .fold(0, |all, (bit, _, _)| all | bit);
                // Only these two bit fields have reserved bits: stations, subsystems and the like define every bit of
                // their width.
                let named = matches!(bits.name, "lights_bitmap" | "loi_bitmap");
                found.check(seen, !named || value & !defined == 0, || {
                    format!(
                        "expected no reserved bit in {} of message {}; got 0x{value:02x}",
                        field.name,
                        seen.kind()
                    )
                });
            }
            let Some(values) = field
                .enumeration
                .filter(|values| values.kind == EnumKind::Enumeration)
            else {
                continue;
            };
            let Some(value) = seen.raw(field.name) else {
                continue;
            };
            // A refusal repeats the requested mode, defined or not.
            if seen.kind() == 14_000
                && field.name == "Mission Plan Mode"
                && seen.raw("Status") == Some(2)
            {
                continue;
            }
            // Values 23 to 25 are inferred, and this project's private values concern no foreign subject.
            let known = values.text(value).filter(|text| *text != "reserved");
            let range = values.ranges.iter().find(|(range, _)| within(range, value));
            match (known, range) {
                (Some(_), _) => found.saw(),
                (None, Some((_, what))) if !what.starts_with("reserved") => {
                    found.saw();
                    if !described.is_empty()
                        && field.name.contains("Mode")
                        && !described.iter().any(|&(_, _, index)| index == value)
                    {
                        found.warn(
                            seen,
                            format!(
                                "{} of message {} is {value}, which no 41002 of this run describes",
                                field.name,
                                seen.kind()
                            ),
                        );
                    }
                }
                // Where the sources have only part of an enumeration, a value outside that part is not judged.
                (None, None) if values.values.is_empty() || values.source == "none" => {}
                (None, range) => {
                    let what = range.map_or("undefined", |_| "reserved");
                    found.fail(seen, format!("expected a defined value in {} of message {}; got {value}, which is {what}", field.name, seen.kind()));
                }
            }
        }
    }
}

fn width_of_the_vector(view: &View<'_>, found: &mut Found) {
    for seen in view.messages().filter(|seen| seen.info.is_some()) {
        match &seen.fields {
            Ok(_) => found.saw(),
            Err(DecodeError::NoPresence {
                expected,
                found: got,
                ..
            }) => {
                found.fail(seen, format!("expected a presence vector of {expected} bytes in message {}, which has {got} bytes of data", seen.kind()));
            }
            Err(error) => {
                // If another width fits, the reason names it: that is what the sender did.
                let data = &seen.piece.data;
                let fits = (1..=8).find(|&width| {
                    Some(width) != seen.info.map(|info| usize::from(info.presence_bytes))
                        && fits_with(seen, data, width)
                });
                if let Some(width) = fits {
                    found.fail(seen, format!("message {} decodes with a presence vector of {width} bytes only, not with the table's: {error}", seen.kind()));
                }
            }
        }
    }
}

fn fits_with(seen: &crate::wire::Seen, data: &[u8], width: usize) -> bool {
    let Some(info) = seen.info else { return false };
    let Some(vector) = data.get(..width) else {
        return false;
    };
    let bits = vector
        .iter()
        .fold(0_u64, |bits, &byte| bits << 8 | u64::from(byte));
    if info.fields.len() < 64 && bits >> info.fields.len() != 0 {
        return false;
    }
    let size = |bits: u64| {
        info.fields
            .iter()
            .filter(|field| bits >> field.bit & 1 == 1)
            .map(|field| field.wire.bytes().unwrap_or_default())
            .sum::<usize>()
    };
    // A vector that is too short leaves the presence of the fields beyond it unknown: each combination is tried.
    let unknown = info.fields.len().saturating_sub(8 * width).min(8);
    (0..1_u64 << unknown).any(|beyond| width + size(bits | beyond << (8 * width)) == data.len())
}

fn first_bit_is_the_time_stamp(view: &View<'_>, found: &mut Found) {
    // 50001 has a layout of its own.
    for seen in view
        .messages()
        .filter(|seen| seen.info.is_some() && seen.kind() < 50_000)
    {
        let Ok(fields) = &seen.fields else {
            // The same vector shifted by one bit: a sender that takes the time stamp as always present.
            let info = seen.info.map_or(0, |info| usize::from(info.presence_bytes));
            let bits = seen
                .piece
                .data
                .iter()
                .take(info)
                .fold(0_u64, |bits, &byte| bits << 8 | u64::from(byte));
            let shifted = seen.info.is_some_and(|info| {
                let widths = info
                    .fields
                    .iter()
                    .filter(|field| field.bit == 0 || bits >> (field.bit - 1) & 1 == 1);
                usize::from(info.presence_bytes)
                    + widths
                        .map(|field| field.wire.bytes().unwrap_or_default())
                        .sum::<usize>()
                    == seen.piece.data.len()
            });
            if shifted {
                found.fail(seen, format!("expected bit 0 of the vector to stand for the time stamp; message {} decodes only with bit 0 for field 2", seen.kind()));
            }
            continue;
        };
        found.check(seen, fields.contains_key("Time Stamp"), || {
            format!(
                "expected the bit of the time stamp in message {}, vector is {}",
                seen.kind(),
                crate::wire::hex(&seen.piece.data[..seen.piece.data.len().min(4)])
            )
        });
    }
}

fn only_present_fields(view: &View<'_>, found: &mut Found) {
    for seen in view.messages().filter(|seen| seen.info.is_some()) {
        match &seen.fields {
            Err(error @ (DecodeError::Truncated { .. } | DecodeError::Trailing { .. })) => {
                found.fail(
                    seen,
                    format!("expected vector, set fields and length to agree; {error}"),
                );
            }
            _ => found.saw(),
        }
    }
}

fn bits_beyond_the_fields(view: &View<'_>, found: &mut Found) {
    for seen in view.messages().filter(|seen| seen.info.is_some()) {
        match &seen.fields {
            Err(error @ DecodeError::UnknownPresence { .. }) => found.fail(
                seen,
                format!("expected bits beyond the last field to be 0; {error}"),
            ),
            _ => found.saw(),
        }
    }
}

fn milliseconds_since_2000(view: &View<'_>, found: &mut Found) {
    // The difference of the epochs 1970 and 2000, by which a wrong epoch is recognised.
    const YEARS_30_S: f64 = 946_684_800.0;
    // Only in a live run one clock stamps both ends; that of a recorder may be wrong by days.
    let most = if view.live { 5.0 } else { 30.0 * 86_400.0 };
    for seen in view.messages().filter(|seen| seen.kind() < 50_000) {
        let Some(stamp) = seen.stamp() else { continue };
        let offset = (stamp as f64 - seen.wall_ms as f64) / 1000.0;
        if offset.abs() <= most {
            found.saw();
            continue;
        }
        let hours = offset / 3600.0;
        let named = if (offset.abs() - YEARS_30_S).abs() < 86_400.0 {
            "30 years: the epoch is 1970"
        } else if hours.abs() < 25.0
            && hours.abs() > 0.4
            && (hours * 4.0 - (hours * 4.0).round()).abs() < 0.01
        {
            "a time zone"
        } else if (12.0..=40.0).contains(&offset.abs()) {
            "leap or GPS seconds"
        } else if stamp as f64 * 1000.0 - 30.0 * 3.15e10 > 0.0 && stamp < 2_000_000_000 {
            "seconds in place of milliseconds"
        } else {
            "no known error"
        };
        // Data of a vehicle without link are old, and the stamp of an answer may repeat that of its request.
        if offset < 0.0 && offset > -600.0 && matches!(seen.kind(), 3000..=4001) {
            found.saw();
            continue;
        }
        found.fail(seen, format!("expected a time stamp within {most:.0} s of the suite's clock in message {}; it is {offset:.1} s off ({named})", seen.kind()));
    }
}

fn stamps_are_not_in_the_future(view: &View<'_>, found: &mut Found) {
    if !view.live {
        return;
    }
    // On a loopback address both ends have one clock.
    let same = view
        .datagrams
        .first()
        .is_some_and(|datagram| datagram.remote.ip().is_loopback());
    let allowed = if same { 150 } else { 1_000 };
    for seen in view.messages().filter(|seen| seen.kind() < 50_000) {
        let Some(stamp) = seen.stamp() else { continue };
        let ahead = stamp - seen.wall_ms as i64;
        if ahead > 5_000 {
            // A wrong epoch is judged by TIME-002.
            continue;
        }
        found.check(seen, ahead <= allowed, || {
            format!("expected the stamp of message {} not later than its receipt; it is {ahead} ms ahead", seen.kind())
        });
    }
}

/// Stamps of one type that are enough to count those that fall by little, and how many of ten may where a network is between
/// both ends: it delivers some messages after others that were sent later.
const ENOUGH_STAMPS: usize = 20;
const OVERTAKEN_TENTHS: usize = 1;
/// A stamp has 40 bits of milliseconds, and begins again at 0 in the year 2034.
const STAMPS: i64 = 1 << 40;

fn stamps_rise(view: &View<'_>, found: &mut Found) {
    let mut last: BTreeMap<(u16, u32, u32, usize), i64> = BTreeMap::new();
    let mut overtaken: BTreeMap<(u16, u32), Tally> = BTreeMap::new();
    // On one computer nothing is overtaken.
    let local = view
        .datagrams
        .first()
        .is_some_and(|datagram| datagram.remote.ip().is_loopback());
    // The same bytes again are a repetition, or a copy that the network made: they are as old as the first.
    for seen in view.once().filter(|seen| {
        matches!(
            seen.kind(),
            2 | 3001 | 3002 | 3004 | 4000 | 4001 | 14_000 | 17000 | 2016 | 2017 | 13_002
        )
    }) {
        let Some(stamp) = seen.stamp() else { continue };
        let key = (
            seen.kind(),
            seen.piece.source.0,
            seen.piece.destination.0,
            seen.socket,
        );
        let before = *last.entry(key).or_insert(stamp);
        let rises = (stamp - before).rem_euclid(STAMPS) < STAMPS / 2;
        let late = !local && !rises && before - stamp < OVERTAKEN_MS;
        let tally = overtaken.entry((key.0, key.1)).or_default();
        tally.look(seen, !late);
        if late {
            continue;
        }
        last.insert(key, stamp);
        found.check(seen, rises, || {
            format!(
                "expected stamps of message {} that do not fall; {stamp} follows {before}",
                seen.kind()
            )
        });
    }
    for ((kind, _), tally) in overtaken {
        tally.judge_by(
            found,
            ENOUGH_STAMPS,
            OVERTAKEN_TENTHS,
            &format!(
                "expected stamps of message {kind} that do not fall; more of them do than a network exchanges"
            ),
        );
    }
}

fn no_position_at_0_0(view: &View<'_>, found: &mut Found) {
    for seen in view.messages().filter(|seen| seen.kind() == 4000) {
        let (latitude, longitude) = (seen.raw("Latitude"), seen.raw("Longitude"));
        found.check(seen, !(latitude == Some(0) && longitude == Some(0)), || {
            "expected an unknown position to be absent from 4000; latitude and longitude are both 0".into()
        });
    }
}

#[cfg(test)]
mod tests {
    use stanag_msgs::Id;

    use super::*;
    use crate::bench::net::Datagram;
    use crate::passive::view::trace::{by_network, of_cucs, received};
    use crate::passive::view::{verdict_on, verdict_on_recorded};
    use crate::verdict::Verdict;
    use crate::wire::Draft;

    #[test]
    fn a_repetition_is_as_old_as_the_first() {
        let judged = |stamps: &[i64]| {
            let all: Vec<_> = (0..)
                .zip(stamps)
                .map(|(at_ms, &stamp)| of_cucs(at_ms, Draft::new(2017).raw("Time Stamp", stamp)))
                .collect();
            verdict_on(&all, stamps_rise)
        };
        assert_eq!(judged(&[10, 20, 10]), Verdict::Pass);
        assert_eq!(judged(&[10, 20, 15]), Verdict::Fail);
    }

    /// What is found in 4000s with these stamps, on one computer, and through a network.
    fn stamped(stamps: &[i64]) -> [Verdict; 2] {
        let all: Vec<Datagram> = (0..)
            .zip(stamps)
            .map(|(step, &stamp)| received(step * 100, Draft::new(4000).raw("Time Stamp", stamp)))
            .collect();
        let near = verdict_on(&all, stamps_rise);
        [near, verdict_on(&by_network(all), stamps_rise)]
    }

    #[test]
    fn a_network_delivers_some_messages_after_later_ones() {
        let mut stamps: Vec<i64> = (0..40).map(|step| 10_000 + step * 100).collect();
        assert_eq!(stamped(&stamps), [Verdict::Pass; 2]);
        stamps.swap(20, 21);
        assert_eq!(stamped(&stamps), [Verdict::Fail, Verdict::Pass]);
        // Two pairs of few.
        let few = [100, 300, 200, 400, 500, 600, 800, 700, 900, 1_000];
        assert_eq!(stamped(&few), [Verdict::Fail, Verdict::Pass]);
        // A clock that is set back, and stamps of which every third falls.
        let mut back = stamps.clone();
        for stamp in &mut back[30..] {
            *stamp -= 9_000;
        }
        assert_eq!(stamped(&back), [Verdict::Fail; 2]);
        let third: Vec<i64> = (0..40)
            .map(|step| 10_000 + step * 100 - if step % 3 == 0 { 750 } else { 0 })
            .collect();
        assert_eq!(stamped(&third), [Verdict::Fail; 2]);
        // The 40 bits are used up.
        let wraps = [STAMPS - 200, STAMPS - 100, 0, 100];
        assert_eq!(stamped(&wraps), [Verdict::Pass; 2]);
    }

    /// A message that names this type of this vehicle.
    fn typed(message: u16, vehicle: u32, kind: i64) -> Datagram {
        let mut draft = Draft::new(message).raw("Vehicle Type", kind);
        draft.source = Some(Id(0x1b00_0101 + vehicle));
        received(u64::from(message), draft)
    }

    #[test]
    fn exchanged_bytes_of_a_type_are_those_of_one_vehicle() {
        let judged = |all: &[Datagram]| verdict_on(all, vehicle_type_byte_order);
        let right = [typed(2, 0, 0x16), typed(41_005, 0, 0x16)];
        assert_eq!(judged(&right), Verdict::Pass);
        let exchanged = [typed(2, 0, 0x1600), typed(41_005, 0, 0x16)];
        assert_eq!(judged(&exchanged), Verdict::Fail);
        // Another vehicle has the type that this would be the other way round.
        let two = [typed(2, 0, 0x0102), typed(41_005, 1, 0x0201)];
        assert_eq!(judged(&two), Verdict::Pass);
        // 256 is a number of a longer list; without a 41005, as in a recording that begins late, it is not known.
        let large = [typed(2, 0, 0x100), typed(41_005, 0, 0x100)];
        assert_eq!(judged(&large), Verdict::Pass);
        assert_eq!(judged(&large[..1]), Verdict::Warning);
    }

    #[test]
    fn a_vehicle_begins_at_its_own_place_and_a_recording_anywhere() {
        let mut profile = crate::profile::Profile::default();
        profile.vehicle.push(crate::profile::VehicleClaims {
            id: "1b:00:01:01".into(),
            position: Some([45.0, 8.0]),
            ..Default::default()
        });
        let judged = |vehicle: u32, live: bool| {
            let mut draft = Draft::new(4000)
                .set("Latitude", 0.5)
                .set("Longitude", 0.1)
                .set("Altitude", 500.0);
            draft.source = Some(Id(0x1b00_0101 + vehicle));
            let datagrams = [received(0, draft)];
            let view = View {
                datagrams: &datagrams,
                profile: &profile,
                survey: None,
                live,
                as_they_are: false,
            };
            let mut found = Found::default();
            positions_are_on_the_globe(&view, &mut found);
            found.judgement().0.verdict
        };
        assert_eq!(judged(0, true), Verdict::Fail);
        assert_eq!(judged(1, true), Verdict::Pass);
        assert_eq!(judged(0, false), Verdict::Pass);
    }

    #[test]
    fn the_clock_of_a_recorder_may_be_wrong() {
        // Without a time of their own the messages of a trace came in the year 2000.
        let hours = 3_600_000;
        let off = |ms: i64| [received(0, Draft::new(17000).raw("Time Stamp", ms))];
        assert_eq!(
            verdict_on(&off(7 * hours), milliseconds_since_2000),
            Verdict::Fail
        );
        assert_eq!(
            verdict_on_recorded(&off(7 * hours), milliseconds_since_2000),
            Verdict::Pass
        );
        assert_eq!(
            verdict_on_recorded(&off(1_000 * hours), milliseconds_since_2000),
            Verdict::Fail
        );
    }
}
