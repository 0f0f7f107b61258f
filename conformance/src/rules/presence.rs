//! PV, the presence vector: its width, the meaning of its bits, that an absent field means "unchanged" or "unknown"
//! and not 0, and that a vector that contradicts its data drops the message.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

use super::acknowledgement::carried_out;
use super::scene::Scene;
use crate::bench::station::{Access, Station, information_request, loi};
use crate::bench::trial::Trial;
use crate::verdict::{Judged, Precondition, Stop};
use crate::wire::{Direction, Draft, Seen};

pub(super) const SCENES: &[Scene] = &[
    Scene {
        rule: "PV-001",
        play: width_of_the_vector,
    },
    Scene {
        rule: "PV-002",
        play: least_bit_is_the_time_stamp,
    },
    Scene {
        rule: "PV-004",
        play: absent_is_not_zero,
    },
    Scene {
        rule: "PV-005",
        play: full_vectors_until_partial_ones_are_allowed,
    },
    Scene {
        rule: "PV-007",
        play: vector_and_data_must_agree,
    },
];

fn width_of_the_vector(t: &Trial) -> Judged {
    let a = t.controller()?;
    // 3007 has 37 fields, hence a vector of five bytes.
    let mark = t.bench.net.mark();
    a.send(information_request(3007));
    let Some(found) = a.wait(mark, t.timers().answer, |seen| seen.kind() == 3007) else {
        t.note("3007 is not sent; width judged on the other messages only");
        return Ok(());
    };
    t.expect_of(&found, found.fields.is_ok(), || {
        format!(
            "expected 3007 to decode with a vector of 5 bytes; {:?}",
            found.fields.as_ref().err()
        )
    })
}

fn least_bit_is_the_time_stamp(t: &Trial) -> Judged {
    let station = t.any()?;
    // Three present fields that every subject knows, and no other.
    let draft = Draft::new(1)
        .raw("Requested/Handover LOI", loi::LOI2)
        .raw("Requested/Handover Access", Access::Request as i64);
    let answer = station.ask(
        draft,
        t.timers().answer,
        "message 2 to #1 with time stamp, LOI and access only",
        |seen| seen.kind() == 2,
    )?;
    let granted = answer.raw("LOI Granted").unwrap_or_default();
    t.expect_of(&answer, granted & loi::LOI2 != 0, || {
        format!("expected LOI 2 granted to #1 with three fields, got LOI Granted 0x{granted:02x}")
    })?;
    station.query(3)?;
    requested_fields(t, &station)
}

/// A subject that sends only the requested fields has to send exactly those: bit 0 of the vector means field 1 there
/// too.
fn requested_fields(t: &Trial, station: &Station) -> Judged {
    let whole = station.query(3)?;
    for (bit, name) in [(3, "Vehicle Type"), (6, "Tail Number")] {
        let draft = information_request(3).raw("Requested Field Presence Vector", 1 << bit | 1);
        let some = station.ask(
            draft,
            t.timers().answer,
            "#3 with the requested fields",
            |seen| seen.kind() == 3,
        )?;
        if some.piece.data.len() >= whole.piece.data.len() || !whole.has(name) {
            continue;
        }
        t.expect_of(&some, some.has(name), || {
            format!("expected {name}, field {} of #3, whose bit {bit} was set in the Requested Field Presence Vector; other fields came", bit + 1)
        })?;
    }
    Ok(())
}

fn absent_is_not_zero(t: &Trial) -> Judged {
    let a = t.controller()?;
    a.set_radius(150.0);
    t.expect(a.radius_becomes(150.0)?, || {
        "expected 3004 to show the radius of 150 m that a 2017 with the radius only set".into()
    })?;
    let mut last = a.query(3004)?;
    for (field, value) in [
        ("Loiter Direction", 1),
        ("Loiter Type", 1),
        ("Loiter Bearing", 100),
    ] {
        let sent = a.send(Draft::new(2017).raw(field, value).acked());
        let done = carried_out(t, &a, &sent, t.timers().answer / 4)?;
        let mut report = a.query(3004)?;
        let lacks = |report: &Seen| {
            let recording = t.bench.net.recording();
            let all = recording.datagrams.iter();
            let before = all.filter(|datagram| datagram.direction == Direction::Received);
            let before = before.flat_map(|datagram| &datagram.messages);
            let of_vehicle = before.filter(|seen| seen.piece.source == a.vehicle);
            may_lack(report, field, of_vehicle.map(Arc::as_ref))
        };
        if done.is_some() {
            if lacks(&report) {
                t.note(format!(
                    "3004 has had no {field} in a loiter of this type: not judged by it"
                ));
            }
            t.expect_beside(&report, report.raw(field) == Some(value) || lacks(&report), || {
                format!("expected {field} {value} in 3004 after a 2017 with it alone that was carried out, got {:?}", report.raw(field))
            })?;
        }
        if field == "Loiter Direction" {
            // The other direction than the one shown: commanding the same again would show nothing.
            let other = if report.raw(field) == Some(1) { 2 } else { 1 };
            let sent = a.send(Draft::new(2017).raw(field, other).acked());
            t.pause(t.timers().answer / 4)?;
            let refused = a.received(sent.mark, |seen| {
                seen.kind() == 17000 && seen.raw("Acknowledgement Type") == Some(3)
            });
            let turned = a.query(3004)?;
            let unshown = turned.raw(field).is_none() && (!refused.is_empty() || lacks(&turned));
            t.expect_beside(&turned, turned.raw(field) == Some(other) || unshown, || {
                format!("expected a 2017 with {field} only to be carried out; 3004 shows {:?}, expected {other}", turned.raw(field))
            })?;
            report = turned;
        }
        // Each setting alone: the others must not change with it.
        for other in [
            "Loiter Type",
            "Loiter Direction",
            "Loiter Length",
            "Loiter Bearing",
            "Loiter Duration",
            "Flying Behaviour",
        ] {
            if other == field {
                continue;
            }
            let (was, is) = (last.raw(other), report.raw(other));
            // A loiter of another type has other fields.
            let turns_type = field == "Loiter Type" && last.raw(field) != report.raw(field);
            let comes_or_goes = was.is_none() || is.is_none();
            t.expect_of(&report, was == is || turns_type && comes_or_goes, || {
                format!("expected {other} to stay {was:?} after a 2017 with {field} only; 3004 shows {is:?}")
            })?;
        }
        last = report.clone();
        let radius = report.value("Loiter Radius");
        t.expect_beside(&report, radius.is_some_and(|radius| (radius - 150.0).abs() < 0.8), || {
            format!("expected the radius of 150 m to stay after a 2017 with {field} only; 3004 shows {radius:?}")
        })?;
    }
    let before = a.query(3002)?;
    let altitude = before.raw("Commanded Altitude");
    a.send(Draft::new(2016).raw("Heading Command Type", 0));
    t.pause(t.timers().answer / 4)?;
    let after = a.query(3002)?;
    t.expect_of(&after, after.raw("Commanded Altitude") == altitude, || {
        format!("expected the commanded altitude to stay {altitude:?} after a 2016 without one; 3002 shows {:?}", after.raw("Commanded Altitude"))
    })
}

/// Whether a 3004 leaves a field out lawfully: none of before had it in a loiter of this type. A bearing, say, is that of a figure of
/// eight, and a vehicle may fly none.
fn may_lack<'a>(report: &Seen, field: &str, mut before: impl Iterator<Item = &'a Seen>) -> bool {
    let same_type = |seen: &Seen| {
        field == "Loiter Type" || seen.raw("Loiter Type") == report.raw("Loiter Type")
    };
    report.raw(field).is_none()
        && !before.any(|seen| seen.kind() == 3004 && seen.has(field) && same_type(seen))
}

fn full_vectors_until_partial_ones_are_allowed(t: &Trial) -> Judged {
    let station = t.monitor()?;
    let mark = t.bench.net.mark();
    t.pause(t.timers().status / 2)?;
    let mut positioned = false;
    let mut vectors: BTreeMap<u16, BTreeSet<Vec<u8>>> = BTreeMap::new();
    for seen in station.received(mark, |seen| matches!(seen.kind(), 3002 | 4000 | 4001)) {
        // Fields that appear later: a position once it is known, a waypoint once it is active.
        positioned |= seen.kind() == 4000 && seen.has("Latitude");
        if seen.kind() == 4001 || seen.kind() == 4000 && !positioned {
            continue;
        }
        let width = seen.info.map_or(1, |info| usize::from(info.presence_bytes));
        vectors
            .entry(seen.kind())
            .or_default()
            .insert(seen.piece.data[..width.min(seen.piece.data.len())].to_vec());
    }
    // Messages that are sent on request only.
    for kind in [3, 3004, 3006, 3009, 3010] {
        let width = |seen: &Seen| {
            let width = seen.info.map_or(1, |info| usize::from(info.presence_bytes));
            seen.piece.data[..width.min(seen.piece.data.len())].to_vec()
        };
        for _ in 0..2 {
            let sent = station.send(information_request(kind));
            let found = station.wait(sent.mark, t.timers().answer / 2, |seen| {
                seen.kind() == kind && seen.piece.source == station.vehicle
            });
            let Some(found) = found else { break };
            vectors.entry(kind).or_default().insert(width(&found));
        }
    }
    if vectors.is_empty() {
        return Err(Stop::inconclusive("no status message came"));
    }
    // A field that was present must not be left out because it has not changed since.
    for (kind, now) in vectors
        .iter()
        .filter(|(kind, _)| [3, 3002, 3004].contains(*kind))
    {
        let bits = |vector: &Vec<u8>| {
            vector
                .iter()
                .fold(0_u64, |bits, &byte| bits << 8 | u64::from(byte))
        };
        let before = {
            let recording = t.bench.net.recording();
            recording.datagrams[..t.mark]
                .iter()
                .filter(|datagram| datagram.direction == Direction::Received)
                .flat_map(|datagram| &datagram.messages)
                .filter(|seen| seen.kind() == *kind && seen.piece.source == station.vehicle)
                .map(|seen| {
                    let width = seen.info.map_or(1, |info| usize::from(info.presence_bytes));
                    bits(&seen.piece.data[..width.min(seen.piece.data.len())].to_vec())
                })
                .fold(0, |all, bits| all | bits)
        };
        let lost = now
            .iter()
            .map(|vector| before & !bits(vector))
            .fold(0, |all, bits| all | bits);
        t.expect(lost == 0, || {
            format!("expected {kind} with all fields that it had before, since partial vectors were not allowed; the bits 0x{lost:x} are left out")
        })?;
    }
    let several = vectors.iter().find(|(_, found)| found.len() > 1);
    match several {
        None => Ok(()),
        Some((kind, found)) => Err(Stop::fail(format!(
            "expected the same vector in each {kind}, since partial vectors were not allowed; got {found:02x?}"
        ))),
    }
}

fn vector_and_data_must_agree(t: &Trial) -> Judged {
    let a = t.controller()?;
    t.expect(a.commands_work()?, || {
        "expected 2017 of the holder in 3004".into()
    })
    .precondition("commands work")?;
    let before = a.radius()?;
    let radius = t.bench.fresh_radius();
    let whole = a
        .stamped(
            Draft::new(2017)
                .set("Loiter Radius", radius)
                .raw("Loiter Direction", 1),
        )
        .acked();
    let data = whole.data();
    let missing = data[..data.len() - 2].to_vec();
    let mut left_over = data.clone();
    left_over.extend([0x11, 0x22]);
    // The vector names all fields, but only a few follow.
    let mut all_named = data.clone();
    all_named[..2].copy_from_slice(&[0x07, 0xFF]);
    let sent: Vec<_> = [
        ("a field missing", missing),
        ("two bytes left over", left_over),
        ("a vector of all fields", all_named),
    ]
    .into_iter()
    .map(|(what, data)| {
        let mut draft = whole.clone();
        draft.data = Some(data);
        (what, a.send(draft))
    })
    .collect();
    t.pause(t.timers().quiet)?;
    // An acknowledgement of type 2 with one of these stamps shows that a broken message was carried out.
    let mark = sent.first().map_or(0, |(_, first)| first.mark);
    let done = a.received(mark, |seen| {
        seen.kind() == 17000 && seen.raw("Acknowledgement Type") == Some(2)
    });
    let names: Vec<&str> = sent.iter().map(|(what, _)| *what).collect();
    if let Some(done) = done.first() {
        t.expect_of(done, false, || {
            format!(
                "expected no 'carried out' for 2017s with {}; 17000 type 2 came",
                names.join(", with ")
            )
        })?;
    }
    let after = a.radius()?;
    t.expect(after == before, || format!("expected 2017s with {} to be dropped whole; the radius went from {before:?} to {after:?}", names.join(", with ")))?;
    t.expect(a.commands_work()?, || {
        "expected the next good 2017 to work".into()
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_setting_may_be_left_out_of_a_loiter_that_never_had_it() {
        let report = |kind: i64, bearing: Option<i64>| {
            let report = Draft::new(3004).raw("Loiter Type", kind);
            match bearing {
                Some(bearing) => report.raw("Loiter Bearing", bearing).seen(),
                None => report.seen(),
            }
        };
        let lacks =
            |report: &Seen, before: &[Seen]| may_lack(report, "Loiter Bearing", before.iter());
        let (circle, eight) = (1, 3);
        let bare = report(circle, None);
        assert!(lacks(&bare, &[]));
        assert!(lacks(&bare, &[report(circle, None)]));
        assert!(
            lacks(&bare, &[report(eight, Some(100))]),
            "it is that of an eight"
        );
        assert!(!lacks(&bare, &[report(circle, Some(0))]), "it had one");
        // One that is reported is judged by its value.
        assert!(!lacks(&report(circle, Some(0)), &[]));
        let without_type = Draft::new(3004).seen();
        assert!(!may_lack(&without_type, "Loiter Type", [bare].iter()));
    }
}
