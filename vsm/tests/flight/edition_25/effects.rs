//! Each honoured field of Edition 2.5 has an effect of its own, and each other field has none.
//!
//! A case is a message in a scene. It is played twice under the same virtual clock and the same seed, with one field
//! changed, and everything that can be seen is compared: what the station was sent, the plans aboard, parameters, payloads,
//! and where the vehicle is. Which fields are honoured is what the support table says: those with a place in Edition 4 that
//! is honoured there, and those that count here alone. One that no case changes fails the test.

use std::collections::{BTreeMap, BTreeSet};
use std::fmt::Write as _;

use kit::bridge::vehicle_id;
use mapping::support::{self, In25, Received, in_edition_25};
use mavlink_link::dialect::MavMissionType;
use serde_json::Value;
use stanag_msgs::ed25;
use stanag_msgs::table::{self, Direction, FieldInfo, MessageInfo, Wire};

use super::cases::{Case, cases};
use super::*;

/// Whether the support table says of a field that it counts.
fn is_honoured(info: &MessageInfo, field: &FieldInfo) -> bool {
    if info.direction == Direction::ToCucs || field.name == "Time Stamp" {
        return false;
    }
    match in_edition_25(info) {
        In25::Refused(_) | In25::Never(_) => return false,
        In25::ByHand(row) if row.honoured.contains(&(field.bit + 1)) => return true,
        _ => {}
    }
    let place = field.ed4.and_then(|(message, number)| {
        let info = table::message(message)?;
        Some((info, info.fields.get(usize::from(number) - 1)?))
    });
    place.is_some_and(|(info, field)| {
        matches!(support::field(info, field).received, Received::Honoured(_))
    })
}

/// The row of a message.
fn row(number: u16) -> &'static MessageInfo {
    ed25::message(number.into(), ed25::Version::Ed25).expect("a message of the edition")
}

/// All that can be seen of a case that is played with these fields; and whether the message was refused.
fn played(case: &Case, fields: &Value) -> (String, bool) {
    let (mut rig, mut station) = (case.before)();
    station.receive(&rig);
    station.received.clear();
    (case.act)(&mut rig, &mut station, case.number, fields);
    rig.run(1.0);
    station.receive(&rig);
    let mut trace = String::new();
    let mut latest: BTreeMap<u64, String> = BTreeMap::new();
    let number = case.number;
    let names = [format!("#{number} "), format!("message {number} ")];
    let mut refused = false;
    for (message, text) in whole(&station.received) {
        let fields = &message["fields"];
        // That a field is ignored is no effect of it.
        if text.contains("ignored") {
            continue;
        }
        refused |= text.contains("refused") && names.iter().any(|name| text.contains(name));
        let id = message["id"].as_u64().unwrap_or_default();
        if PERIODIC.contains(&id) {
            latest.insert(id, fields.to_string());
        } else {
            let _ = writeln!(trace, "{id} {fields} {text}");
        }
    }
    let vehicle = rig.vehicles[0].vehicle();
    let _ = writeln!(trace, "{latest:#?}\n{:?}", vehicle.payloads());
    for kind in [
        MavMissionType::MAV_MISSION_TYPE_MISSION,
        MavMissionType::MAV_MISSION_TYPE_FENCE,
    ] {
        let _ = writeln!(trace, "{:?}", vehicle.plan(kind));
    }
    let truth = vehicle.truth();
    let (place, attitude) = (truth.position, truth.attitude);
    let _ = writeln!(
        trace,
        "{:?} {} {place:?} {attitude:?}",
        truth.mode, truth.armed
    );
    for parameter in vehicle.params().table() {
        let _ = writeln!(trace, "{parameter:?}");
    }
    (trace, refused)
}

/// The messages, each with the text of an alert: a long one comes in several, one after the other.
fn whole(received: &[Value]) -> Vec<(&Value, String)> {
    let mut all: Vec<(&Value, String)> = Vec::new();
    for message in received {
        let fields = &message["fields"];
        let text = fields["Text"].as_str().unwrap_or_default();
        let continues = fields["Warning ID"].as_i64().is_some_and(|id| id <= -PART);
        match all.last_mut().filter(|_| continues) {
            Some((_, begun)) => begun.push_str(text),
            None => all.push((message, text.to_owned())),
        }
    }
    all
}

fn with(fields: &Value, name: &str, value: &Value) -> Value {
    let mut changed = fields.clone();
    changed[name] = value.clone();
    changed
}

#[test]
fn every_honoured_field_is_in_a_case() {
    let mut untried = BTreeSet::new();
    let all = cases();
    for info in ed25::messages() {
        let honoured = info.fields.iter().filter(|field| is_honoured(info, field));
        untried.extend(honoured.map(|field| (info.id, field.name)));
    }
    assert!(untried.len() > 75, "{}", untried.len());
    for case in &all {
        for (name, _) in case.changes.iter().chain(&case.refused) {
            let info = row(case.number);
            let field = info.field(name);
            let field = field.unwrap_or_else(|| panic!("#{} has no {name}", case.number));
            assert!(is_honoured(info, field), "#{} {name}", case.number);
            untried.remove(&(case.number, *name));
        }
    }
    assert!(untried.is_empty(), "no case changes: {untried:#?}");
}

/// Plays the cases of these messages.
fn play(numbers: impl std::ops::RangeBounds<u16>) {
    let mut faults = Vec::new();
    let mut seen = BTreeSet::new();
    for case in cases() {
        if !numbers.contains(&case.number) {
            continue;
        }
        let number = case.number;
        let (before, refused) = played(&case, &case.base);
        if refused {
            faults.push(format!("#{number} {}: refused", case.base));
            continue;
        }
        assert_eq!(played(&case, &case.base).0, before, "#{number}: chance");
        let changes = case.changes.iter().map(|change| (change, false));
        for ((name, value), expected) in
            changes.chain(case.refused.iter().map(|change| (change, true)))
        {
            let (after, refused) = played(&case, &with(&case.base, name, value));
            let what = format!("#{number} {name} = {value}");
            if after == before {
                faults.push(format!("{what}: no effect"));
            }
            if refused != expected {
                faults.push(format!("{what}: refused is {refused}"));
            }
        }
        let info = row(number);
        let others = info.fields.iter().skip(3);
        let others =
            others.filter(|field| !is_honoured(info, field) && seen.insert((number, field.bit)));
        for field in others {
            let value = match field.wire {
                Wire::Char(_) => json!("X"),
                _ if field.unit == Some("s since 1970") => json!(1.8e9),
                _ => json!(1),
            };
            if played(&case, &with(&case.base, field.name, &value)).0 != before {
                faults.push(format!(
                    "#{number} {}: an effect, and not honoured",
                    field.name
                ));
            }
        }
    }
    assert!(faults.is_empty(), "{faults:#?}");
}

#[test]
fn honoured_fields_of_rights_and_modes_show_an_effect_and_others_none() {
    play(..43);
}

#[test]
fn honoured_fields_of_demands_show_an_effect_and_others_none() {
    play(43..200);
}

#[test]
fn honoured_fields_of_payloads_and_handovers_show_an_effect_and_others_none() {
    play(200..800);
}

#[test]
fn honoured_fields_of_plans_show_an_effect_and_others_none() {
    play(800..1000);
}

#[test]
fn honoured_fields_of_requests_show_an_effect_and_others_none() {
    play(1000..);
}

/// Its Time Stamp tells a message from a repetition of another, in each message that has a place in Edition 4.
#[test]
fn a_repetition_of_any_message_is_carried_out_once() {
    let mut seen = BTreeSet::new();
    for case in cases() {
        let stamp = row(case.number).fields[0].ed4;
        if stamp.is_none() || !seen.insert(case.number) {
            continue;
        }
        let (mut rig, mut station) = (case.before)();
        let bytes = station.datagram(&rig, vehicle_id(0), case.number, &case.base);
        let before = border::count(&rig, "duplicate");
        for _ in 0..2 {
            rig.deliver_from(station.address, &bytes);
            rig.run(0.5);
        }
        let after = border::count(&rig, "duplicate");
        assert_eq!(after, before + 1, "#{}", case.number);
    }
}

/// The numbers of the parts of one alert are so far apart.
const PART: i64 = 10_000_000;
/// Pushed all the time: the latest counts.
const PERIODIC: &[u64] = &[101, 104, 106, 110, 302];
