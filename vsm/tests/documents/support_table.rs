//! The support table is true, field by field: a field that it calls honoured changes what the vehicle does or what is
//! answered, one that it calls ignored changes nothing, and of what it lists as sent every field is, and no other.
//!
//! Each trial is a message in a scene. It is played twice under the same virtual clock and the same seed, with one field
//! changed, and everything that can be seen is compared: answers, alerts, messages, plans aboard, parameters, and where
//! the vehicle is. A field that the table calls honoured and that no trial changes fails the test. What makes this worth
//! something: played twice without a change a trial leaves the same trace; unchanged it is carried out; that a field is
//! ignored is no effect; and where all that the change does is to have the message refused, the table must state it.

use std::collections::BTreeSet;

use crate::scene::{Change, altered, raw_fields, traces};
use crate::trials::{trials, trials_of};
use kit::bridge::{Rig, orders, vehicle_id};
use mapping::support::{Received, field, rows};
use serde_json::{Value, json};
use stanag_msgs::table::{self, FieldInfo, Wire};
use stanag_msgs::{ChecksumStyle, Envelope, MAX_DATAGRAM, Message, TimeStamp};

const TIME_STAMP: &str = "Time Stamp";

#[test]
fn every_honoured_field_is_tried() {
    let mut tried = BTreeSet::new();
    for trial in trials() {
        let id = (trial.base)().id();
        let info = table::message(id).expect("a message of the table");
        for Change { field: name, .. } in trial.changes {
            let known = info.field(name).unwrap_or_else(|| panic!("{id} {name}"));
            let honoured = matches!(field(info, known).received, Received::Honoured(_));
            assert!(honoured, "{id} {name} is tried and not honoured");
            tried.insert((id, *name));
        }
    }
    let mut untried = Vec::new();
    for row in rows() {
        for (name, _) in row.honoured {
            if *name != TIME_STAMP && !tried.contains(&(row.id, *name)) {
                untried.push(format!("{} {name}", row.id));
            }
        }
        let some = row.honoured.is_empty() || trials_of(row.id).next().is_some();
        assert!(some, "{} has no trial", row.id);
    }
    assert!(untried.is_empty(), "no trial changes: {untried:#?}");
}

/// Plays the trials of these messages, each honoured field changed.
fn show_an_effect(ids: std::ops::RangeInclusive<u16>) {
    let mut faults = Vec::new();
    for trial in trials() {
        let base = (trial.base)();
        let id = base.id();
        if !ids.contains(&id) {
            continue;
        }
        let before = traces(&trial, &base);
        assert_eq!(
            before,
            traces(&trial, &base),
            "{id}: chance has a hand in it"
        );
        let refusals = [id.to_string(), table::named(id)].map(|what| format!("{what} refused"));
        let refused = |traces: &str| refusals.iter().any(|refusal| traces.contains(refusal));
        if refused(&before) {
            faults.push(format!("{id}: refused without a change"));
        }
        for change in trial.changes {
            let what = format!("{id} {} = {}", change.field, change.value);
            let changed = altered(&base, change.field, change.value);
            assert_ne!(changed, base, "{what}: that is its value already");
            let after = traces(&trial, &changed);
            if after == before {
                faults.push(format!("{what}: no effect"));
            }
            match (refused(&after), change.refused) {
                (true, None) => faults.push(format!("{what}: refused, which was not expected")),
                (false, Some(_)) => faults.push(format!("{what}: expected to be refused")),
                (true, Some(rule)) if !is_announced(&base, change.field, rule) => {
                    faults.push(format!("{what}: the table does not announce `{rule}`"));
                }
                _ => {}
            }
        }
    }
    assert!(faults.is_empty(), "{faults:#?}");
}

/// Whether the table announces of a field, in these words, that a value is refused.
fn is_announced(message: &Message, name: &str, rule: &str) -> bool {
    let info = message.info();
    let known = info.field(name).expect("a field of the message");
    match field(info, known).received {
        Received::Honoured(how) => how.contains(rule),
        _ => false,
    }
}

#[test]
fn honoured_fields_of_rights_show_an_effect() {
    show_an_effect(0..=1_999);
}

#[test]
fn honoured_fields_of_flight_commands_show_an_effect() {
    show_an_effect(2_000..=12_999);
}

#[test]
fn honoured_fields_of_routes_show_an_effect() {
    show_an_effect(13_000..=14_999);
}

#[test]
fn honoured_fields_of_requests_show_an_effect() {
    show_an_effect(15_000..=49_999);
}

#[test]
fn honoured_fields_of_private_messages_show_an_effect() {
    show_an_effect(50_000..=65_535);
}

#[test]
fn ignored_fields_show_none() {
    let mut with = Vec::new();
    let mut seen = BTreeSet::new();
    for trial in trials() {
        let base = (trial.base)();
        if !seen.insert(base.id()) {
            continue;
        }
        let ignored: Vec<&FieldInfo> = base
            .info()
            .fields
            .iter()
            .filter(|one| field(base.info(), one).received == Received::Ignored)
            .filter(|one| one.name != TIME_STAMP)
            .collect();
        if ignored.is_empty() {
            continue;
        }
        let before = traces(&trial, &base);
        for one in ignored {
            let changed = altered(&base, one.name, &some_value(one).to_string());
            if traces(&trial, &changed) != before {
                with.push(format!("{} {}", base.id(), one.name));
            }
        }
    }
    assert!(with.is_empty(), "an effect of: {with:#?}");
}

/// A value that the field can have, and that is not what an empty one has.
fn some_value(field: &FieldInfo) -> Value {
    match field.wire {
        Wire::Char(_) | Wire::UnsizedText | Wire::UnsizedBytes => json!("X"),
        Wire::F32 | Wire::F64 => json!(1.0),
        _ => json!(1),
    }
}

#[test]
fn every_time_stamp_identifies_a_duplicate_and_is_returned() {
    let mut seen = BTreeSet::new();
    for trial in trials() {
        let base = (trial.base)();
        let honoured = rows().any(|row| {
            row.id == base.id() && row.honoured.iter().any(|(name, _)| *name == TIME_STAMP)
        });
        // Sticks are many and old ones are dropped: see below.
        if !honoured || base.id() == 2010 || !seen.insert(base.id()) {
            continue;
        }
        let mut rig = trial.prepared();
        // 17000 is matched by the stamp that it returns.
        let ticket = rig.send(base.clone());
        let end = rig.end(ticket);
        assert!(end.is_some(), "{} is not answered", base.id());
        rig.run(0.5);
        let (answers, duplicates) = (rig.station().answers(ticket).len(), counted(&rig));
        rig.stations[0].repeat(ticket);
        rig.run(0.5);
        let again = rig.station().answers(ticket);
        assert_eq!(again.len(), answers + 1, "{}", base.id());
        assert_eq!(again.last().copied(), end, "{}", base.id());
        assert_eq!(counted(&rig), duplicates + 1, "{}", base.id());
    }
    // The heartbeat changes nothing but who is there.
    let mut rig = Rig::ready();
    rig.done(stanag_msgs::messages::Heartbeat::default());
}

fn counted(rig: &Rig) -> u64 {
    let status = rig
        .bridge
        .as_ref()
        .expect("a bridge")
        .status("test".to_owned(), rig.now().mono);
    let counters = serde_json::to_value(&status.refused).expect("counters");
    counters["duplicate"].as_u64().unwrap_or(0)
}

#[test]
fn an_overtaken_stick_command_changes_nothing() {
    let fly = |late: bool| {
        let mut rig = Rig::ready();
        rig.take_off(20.0);
        for round in 0..40 {
            rig.send_once(crate::trials::messages::sticks());
            if round == 2 {
                let _ = rig.send(orders::mode(
                    stanag_msgs::enums::FlightPathControlMode::FlightDirector,
                ));
            }
            if late && round > 10 {
                let hard = altered(
                    &crate::trials::messages::sticks().into(),
                    "Lateral Stick",
                    "-100",
                );
                send_stamped(&mut rig, &hard, TimeStamp(1));
            }
            rig.run(0.1);
        }
        rig.truth().position
    };
    assert_eq!(fly(true), fly(false));
}

/// Sends a message with a stamp of old.
fn send_stamped(rig: &mut Rig, message: &Message, stamp: TimeStamp) {
    let old = altered(message, TIME_STAMP, &stamp.0.to_string());
    let envelope = Envelope::new(rig.station().id, vehicle_id(0)).summed(ChecksumStyle::Crc32);
    let mut bytes = [0; MAX_DATAGRAM];
    let length = old.encode(&envelope, &mut bytes).expect("it fits");
    let (clock, from) = (rig.clock.elapsed(), rig.station().address);
    let to = std::net::SocketAddr::from(([127, 0, 0, 1], 4_586));
    rig.dli.send(clock, from, to, bytes[..length].to_vec());
}

#[test]
fn a_trial_sees_what_it_is_to_see() {
    // The same message twice leaves the same trace; a field that is not there is not made up.
    for trial in trials().into_iter().take(4) {
        let base = (trial.base)();
        assert_eq!(
            traces(&trial, &base),
            traces(&trial, &base),
            "{}",
            base.id()
        );
        assert!(raw_fields(&base).len() <= base.info().fields.len());
    }
}
