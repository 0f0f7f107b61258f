//! A message in a scene, and everything that can be seen of it.

use std::collections::BTreeMap;
use std::fmt::Write as _;

use mavlink_link::dialect::MavMissionType;
use serde_json::{Map, Value, json};
use stanag_msgs::enums::AlertPriority;
use stanag_msgs::json::{decode_line, encode_line};
use stanag_msgs::{Envelope, Id, MAX_DATAGRAM, Message};

use kit::bridge::{Rig, Setup};

/// A message, where it is sent, and the fields of it that are changed one by one.
#[derive(Clone, Copy)]
pub(super) struct Trial {
    pub(super) setup: fn() -> Setup,
    pub(super) before: fn(&mut Rig),
    pub(super) base: fn() -> Message,
    /// Sends the message, and does what makes its effect seen.
    pub(super) act: fn(&mut Rig, &Message),
    pub(super) changes: &'static [Change],
}

/// One field of the message, changed.
#[derive(Clone, Copy)]
pub(super) struct Change {
    pub(super) field: &'static str,
    /// Its other value: on the wire in JSON; `+n` adds to what it is; `null` leaves it out.
    pub(super) value: &'static str,
    /// Where the message is refused for this value: the words of the table that announce it.
    pub(super) refused: Option<&'static str>,
}

impl Trial {
    /// The scene before the message.
    pub(super) fn prepared(&self) -> Rig {
        let mut rig = Rig::new((self.setup)());
        rig.run(9.0);
        (self.before)(&mut rig);
        rig
    }
}

/// Plays the trial with this message: all that can be seen afterwards.
pub(super) fn traces(trial: &Trial, message: &Message) -> String {
    let mut rig = trial.prepared();
    let marks: Vec<usize> = rig
        .stations
        .iter()
        .map(|station| station.received.len())
        .collect();
    (trial.act)(&mut rig, message);
    rig.run(1.0);
    let mut trace = String::new();
    for (station, mark) in rig.stations.iter().zip(marks) {
        let mut counts: BTreeMap<u16, usize> = BTreeMap::new();
        let mut latest: BTreeMap<u16, String> = BTreeMap::new();
        for (_, from, message) in &station.received[mark..] {
            if is_of_no_effect(message) {
                continue;
            }
            *counts.entry(message.id()).or_default() += 1;
            let reported = unstamped(message);
            if PERIODIC.contains(&message.id()) {
                latest.insert(message.id(), reported);
            } else {
                let _ = writeln!(trace, "{from} {reported}");
            }
        }
        let _ = writeln!(trace, "{counts:?}\n{latest:#?}");
    }
    let vehicle = rig.vehicles[0].vehicle();
    for kind in [
        MavMissionType::MAV_MISSION_TYPE_MISSION,
        MavMissionType::MAV_MISSION_TYPE_FENCE,
    ] {
        let _ = writeln!(trace, "{:?}", vehicle.plan(kind));
    }
    let truth = vehicle.truth();
    let _ = writeln!(
        trace,
        "{:?} {} {:?} {:?}",
        truth.mode, truth.armed, truth.position, truth.attitude
    );
    let _ = writeln!(trace, "{:?}", vehicle.payloads());
    for parameter in vehicle.params().table() {
        let _ = writeln!(trace, "{parameter:?}");
    }
    trace
}

/// That a field is ignored, and that an answer has stood long enough, shows no effect of anything.
fn is_of_no_effect(message: &Message) -> bool {
    let Message::SubsystemStatusAlert(alert) = message else {
        return false;
    };
    let text = alert.text.as_ref().map_or("", |text| text.as_str());
    text.contains(": ignored") || alert.priority == Some(AlertPriority::Cleared)
}

/// Sends it to the vehicle and waits for its end.
pub(super) fn send(rig: &mut Rig, message: &Message) {
    let end = rig.carry_out(message.clone());
    // The end itself can be seen: 16000 reports a refusal, and this that there was an answer.
    assert!(end.is_some(), "message {} is not answered", message.id());
}

/// The fields of a message as they are on the wire.
pub(super) fn raw_fields(message: &Message) -> Map<String, Value> {
    let mut bytes = [0; MAX_DATAGRAM];
    let envelope = Envelope::new(Id(1), Id(2));
    let length = message
        .encode(&envelope, &mut bytes)
        .expect("it fits a datagram");
    let hex: String = bytes[..length]
        .iter()
        .map(|byte| format!("{byte:02x}"))
        .collect();
    let mut decoded = decode_line(&hex, true);
    let fields = decoded
        .pop()
        .and_then(|mut value| value.get_mut("fields").map(Value::take));
    match fields {
        Some(Value::Object(fields)) => fields,
        other => panic!("{other:?}"),
    }
}

/// The message with one field changed.
pub(super) fn altered(message: &Message, name: &str, change: &str) -> Message {
    let mut fields = raw_fields(message);
    let before = fields.remove(name);
    let value = match change.strip_prefix('+') {
        None => serde_json::from_str(change).expect("a value in JSON"),
        Some(more) => match before.expect("a field to add to") {
            Value::Number(old) if old.is_f64() => {
                json!(old.as_f64().unwrap() + more.parse::<f64>().expect("a number"))
            }
            old => json!(old.as_i64().expect("an integer") + more.parse::<i64>().expect("steps")),
        },
    };
    if !value.is_null() {
        fields.insert(name.to_owned(), value);
    }
    built(message.id(), fields)
}

fn built(id: u16, fields: Map<String, Value>) -> Message {
    let line = json!({ "id": id, "source": 1, "destination": 2, "fields": fields });
    let hex = encode_line(&line.to_string(), true).unwrap_or_else(|fault| panic!("{id}: {fault}"));
    let bytes: Vec<u8> = (0..hex.len())
        .step_by(2)
        .map(|at| u8::from_str_radix(&hex[at..at + 2], 16).expect("hexadecimal"))
        .collect();
    let frame = stanag_msgs::frames(&bytes).next().expect("a message");
    Message::decode(id, frame.expect("a sound one").data).expect("of the table")
}

/// A message without its times, and without the id that counts alerts.
fn unstamped(message: &Message) -> String {
    let mut fields = raw_fields(message);
    fields.retain(|name, _| !name.contains("Time"));
    fields.remove("Alert (Warning) ID");
    format!("{} {}", message.id(), Value::Object(fields))
}

/// Pushed all the time: the latest counts.
const PERIODIC: &[u16] = &[3001, 3002, 4000, 4001, 16002, 21101];
