//! Messages of Edition 2.5 as the rules see them.

use std::sync::Arc;

use stanag_msgs::table::{self, FieldInfo, Wire};

use super::places::{self, NAMING};
use super::{EPOCH_2000_S, LOITER, LOITER_REPORT, PREFERENCE, PREFERENCE_REPORT, STEERING, marker};
use crate::wire::{Draft, Seen, split};

/// The messages of Edition 4 that hold the same as this one of Edition 2.5, with the fields that correspond.
#[must_use]
pub fn counterparts(seen: &Arc<Seen>) -> Vec<Arc<Seen>> {
    let Some(info) = seen.info.filter(|_| seen.piece.wrapped.is_some()) else {
        return Vec::new();
    };
    if seen.fields.is_err() {
        return Vec::new();
    }
    let drafts: Vec<Draft> = match info.id {
        PREFERENCE_REPORT | PREFERENCE => preference(seen).into_iter().collect(),
        _ => info
            .ed4_messages
            .iter()
            .filter_map(|&kind| draft(seen, kind))
            .collect(),
    };
    drafts
        .into_iter()
        .filter_map(|draft| {
            let bytes = draft.encode(seen.piece.source, seen.piece.destination, 32, 2);
            let piece = split(&bytes).0.into_iter().next()?;
            let made = Seen::new(seen.at, seen.wall_ms, seen.direction, seen.socket, piece);
            Some(Arc::new(Seen {
                original: Some(seen.clone()),
                ..made
            }))
        })
        .collect()
}

/// The fields of a message that have a place in this message of Edition 4.
fn draft(seen: &Seen, kind: u16) -> Option<Draft> {
    let (info, other) = (seen.info?, table::message(kind)?);
    let mut draft = Draft::new(kind);
    for field in info.fields {
        if let Some((message, number)) = field.ed4
            && message == kind
            && counts(seen, field)
            && let Some(target) = other.fields.get(usize::from(number).checked_sub(1)?)
        {
            draft = carry(seen, field, target, draft);
        }
    }
    if let Some(naming) = NAMING.iter().find(|naming| naming.ed25 == info.id) {
        draft = named(seen, naming, draft)?;
    }
    Some(draft)
}

/// Whether the value of a field counts. #43 always sends all its fields; its type fields show which count.
fn counts(seen: &Seen, field: &FieldInfo) -> bool {
    if seen.kind() != STEERING {
        return true;
    }
    let number = field.bit + 1;
    let altitude = seen.raw("Altitude Command Type").unwrap_or_default();
    let heading = seen.raw("Heading Command Type").unwrap_or_default();
    match number {
        4 | 17 => altitude != 0,
        5 => matches!(altitude, 1 | 3),
        6 => matches!(altitude, 2 | 3),
        7 => heading != 0,
        8 => matches!(heading, 1 | 3),
        9 => matches!(heading, 2 | 3),
        10 => heading == 5 || heading != 0 && seen.value(field.name) != Some(0.0),
        11 | 12 => heading == 4,
        13 | 15 | 16 => seen.value(field.name) != Some(0.0),
        14 => seen.value("Commanded Speed") != Some(0.0),
        18 | 19 => {
            let place = |name: &str| seen.value(name).unwrap_or_default();
            (
                place("Loiter Position Latitude"),
                place("Loiter Position Longitude"),
            ) != (0.0, 0.0)
        }
        _ => true,
    }
}

/// Which message and field a message names, by the numbers of Edition 4; none where Edition 4 has no such.
fn named(seen: &Seen, naming: &places::Naming, draft: Draft) -> Option<Draft> {
    let name = |number: u8| {
        let index = usize::from(number).checked_sub(1)?;
        Some(seen.info?.fields.get(index)?.name)
    };
    let (message, field) = naming.ed25_fields;
    let number = u16::try_from(seen.raw(name(message)?)?).ok()?;
    let other = |number: u8| {
        table::message(naming.ed4)?
            .fields
            .get(usize::from(number) - 1)
    };
    if number == 0 {
        return Some(draft);
    }
    if field == 0 {
        let kind = places::kind_of(number)?;
        return Some(draft.raw(other(naming.ed4_fields.0)?.name, kind.into()));
    }
    let of = u8::try_from(seen.raw(name(field)?)?).ok()?;
    let (kind, of) = places::counterpart_of(number, of)?;
    Some(
        draft
            .raw(other(naming.ed4_fields.0)?.name, kind.into())
            .raw(other(naming.ed4_fields.1)?.name, of.into()),
    )
}

/// #48 and #109 as the setting that they stand for.
fn preference(seen: &Seen) -> Option<Draft> {
    let parts: Vec<i64> = seen
        .info?
        .fields
        .iter()
        .skip(3)
        .filter_map(|field| seen.raw(field.name))
        .collect();
    let radius = marker::radius_of(parts.try_into().ok()?)?;
    let report = seen.kind() == PREFERENCE_REPORT;
    let draft = Draft::new(if report { LOITER_REPORT } else { LOITER });
    let stamp = seen.value("Time Stamp")?;
    Some(
        draft
            .raw("Time Stamp", stamp_ms(stamp)?)
            .set("Loiter Radius", radius),
    )
}

/// Seconds since 1970 as milliseconds since 2000, where they are a time.
fn stamp_ms(seconds: f64) -> Option<i64> {
    let ms = ((seconds - EPOCH_2000_S) * 1000.0).round();
    (0.0..(1_u64 << 40) as f64)
        .contains(&ms)
        .then_some(ms as i64)
}

/// Copies one field; a value without number or text, or that does not fit the step of Edition 4, is left out.
fn carry(seen: &Seen, field: &FieldInfo, target: &FieldInfo, draft: Draft) -> Draft {
    if matches!(target.wire, Wire::Char(_)) {
        return match seen.text(field.name) {
            Some(text) => draft.text(target.name, text.as_bytes()),
            None => draft,
        };
    }
    let Some(value) = seen.value(field.name).filter(|value| value.is_finite()) else {
        return draft;
    };
    // Times count from 1970 in seconds there, from 2000 in milliseconds here.
    if target.wire == Wire::U40 {
        return match stamp_ms(value) {
            Some(ms) => draft.raw(target.name, ms),
            None => draft,
        };
    }
    match target.wire.integers() {
        Some((low, high)) => {
            let raw = (value / target.step()).round();
            if (low as f64..=high as f64).contains(&raw) {
                draft.raw(target.name, raw as i64)
            } else {
                draft
            }
        }
        None => draft.set(target.name, value),
    }
}
