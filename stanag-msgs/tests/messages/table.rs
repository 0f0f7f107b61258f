//! The table is the fact table, fact for fact.

use stanag_msgs::enums::{EnumInfo, EnumKind};
use stanag_msgs::table::{FieldInfo, MESSAGES, MessageInfo, message};
use toml::{Table, Value};

fn facts() -> Table {
    let path = concat!(
        env!("CARGO_MANIFEST_DIR"),
        "/../tests/data/dli/messages.toml"
    );
    std::fs::read_to_string(path).unwrap().parse().unwrap()
}

fn text<'a>(fact: &'a Value, key: &str) -> Option<&'a str> {
    fact.get(key).map(|value| value.as_str().unwrap())
}

fn integer(fact: &Value, key: &str) -> Option<i64> {
    fact.get(key).map(|value| value.as_integer().unwrap())
}

fn number(fact: &Value, key: &str) -> Option<f64> {
    let value = fact.get(key)?;
    value
        .as_float()
        .or_else(|| value.as_integer().map(|integer| integer as f64))
}

#[test]
fn every_message_equals_its_facts() {
    let facts = facts();
    let messages = facts["message"].as_array().unwrap();
    let mut ids: Vec<_> = messages
        .iter()
        .map(|fact| integer(fact, "id").unwrap())
        .collect();
    ids.sort_unstable();
    assert_eq!(
        ids,
        MESSAGES
            .iter()
            .map(|info| i64::from(info.id))
            .collect::<Vec<_>>()
    );
    for fact in messages {
        let id = integer(fact, "id").unwrap();
        same_message(message(id as u16).unwrap(), fact);
    }
}

fn same_message(info: &MessageInfo, fact: &Value) {
    let id = info.id;
    assert_eq!(Some(info.name), text(fact, "name"), "{id}");
    assert_eq!(Some(info.direction.text()), text(fact, "direction"), "{id}");
    assert_eq!(Some(info.traffic.text()), text(fact, "push_pull"), "{id}");
    assert_eq!(
        info.latency_ms.map(i64::from),
        integer(fact, "max_latency_ms"),
        "{id}"
    );
    assert_eq!(
        Some(i64::from(info.presence_bytes)),
        integer(fact, "pv_bytes"),
        "{id}"
    );
    assert_eq!(Some(info.confidence.letter()), text(fact, "conf"), "{id}");
    assert_eq!(Some(info.source), text(fact, "src"), "{id}");
    assert_eq!(Some(info.layout.text()), text(fact, "layout"), "{id}");
    assert_eq!(
        Some(info.corroboration),
        text(fact, "corroboration"),
        "{id}"
    );
    assert_eq!(info.table, text(fact, "table"), "{id}");
    assert_eq!(info.ed2_message, text(fact, "ed2_message"), "{id}");
    assert_eq!(info.note, text(fact, "note"), "{id}");

    let fields = fact["fields"].as_array().unwrap();
    assert_eq!(info.fields.len(), fields.len(), "{id}");
    for (index, (field, fact)) in info.fields.iter().zip(fields).enumerate() {
        assert_eq!(usize::from(field.bit), index, "{id} {}", field.name);
        same_field(id, field, fact);
    }
}

fn same_field(id: u16, field: &FieldInfo, fact: &Value) {
    let name = field.name;
    assert_eq!(Some(name), text(fact, "name"), "{id}");
    assert_eq!(
        Some(i64::from(field.bit)),
        integer(fact, "bit"),
        "{id} {name}"
    );
    assert_eq!(
        Some(field.wire.to_string().as_str()),
        text(fact, "type"),
        "{id} {name}"
    );
    assert_eq!(field.scale, number(fact, "scale"), "{id} {name}");
    assert_eq!(field.unit, text(fact, "unit"), "{id} {name}");
    assert_eq!(
        field.enumeration.map(|info| info.name),
        text(fact, "enum"),
        "{id} {name}"
    );
    assert_eq!(field.uid, text(fact, "uid"), "{id} {name}");
    assert_eq!(
        field.confidence.map(|letter| letter.letter()),
        text(fact, "conf"),
        "{id} {name}"
    );
    let inferred = fact
        .get("width_inferred")
        .is_some_and(|value| value.as_bool().unwrap());
    assert_eq!(field.width_inferred, inferred, "{id} {name}");
    assert_eq!(field.note, text(fact, "note"), "{id} {name}");
}

#[test]
fn every_enumeration_equals_its_facts() {
    let facts = facts();
    let enums = facts["enums"].as_table().unwrap();
    let mut seen = std::collections::BTreeSet::new();
    for info in MESSAGES
        .iter()
        .flat_map(|info| info.fields)
        .filter_map(|field| field.enumeration)
    {
        if seen.insert(info.name) {
            same_enumeration(info, &enums[info.name]);
        }
    }
    assert_eq!(seen.len(), enums.len());
}

fn same_enumeration(info: &EnumInfo, fact: &Value) {
    let name = info.name;
    let kind = if info.kind == EnumKind::Bitmap {
        "bitmap"
    } else {
        "enum"
    };
    assert_eq!(Some(kind), text(fact, "kind"), "{name}");
    assert_eq!(Some(info.confidence.letter()), text(fact, "conf"), "{name}");
    assert_eq!(Some(info.source), text(fact, "src"), "{name}");
    assert_eq!(
        info.description,
        text(fact, "desc").unwrap_or_default(),
        "{name}"
    );
    let mut count = 0;
    for (key, value) in fact
        .get("values")
        .and_then(Value::as_table)
        .into_iter()
        .flatten()
    {
        let raw = match key.strip_prefix("0x") {
            Some(hex) => i64::from_str_radix(hex, 16).unwrap(),
            None => key.parse().unwrap(),
        };
        assert_eq!(info.text(raw), value.as_str(), "{name} {key}");
        assert_eq!(
            info.value(value.as_str().unwrap()),
            Some(raw),
            "{name} {key}"
        );
        count += 1;
    }
    // Where sources are silent the project adds values of its own.
    assert!(
        info.values.len() == count || text(fact, "conf") == Some("?"),
        "{name}"
    );
    for &(range, meaning) in info.ranges {
        assert_eq!(
            fact["ranges"][range].as_str(),
            Some(meaning),
            "{name} {range}"
        );
    }
    let ranges = fact
        .get("ranges")
        .and_then(Value::as_table)
        .map_or(0, Table::len);
    assert_eq!(info.ranges.len(), ranges, "{name}");
}

#[test]
fn no_two_values_of_an_enumeration_share_value_or_text() {
    for field in MESSAGES.iter().flat_map(|info| info.fields) {
        let Some(info) = field.enumeration else {
            continue;
        };
        for (index, (raw, rust, text)) in info.values.iter().enumerate() {
            let (low, high) = field.wire.integers().unwrap();
            assert!((low..=high).contains(raw), "{} {text}", info.name);
            for (other_raw, other_rust, other_text) in &info.values[..index] {
                assert!(
                    raw != other_raw && rust != other_rust && text != other_text,
                    "{} {text}",
                    info.name
                );
            }
        }
    }
}

#[test]
fn every_message_fits_a_datagram() {
    for info in MESSAGES {
        assert!(info.full_bytes() <= 528, "{}", info.name);
        let bits = usize::from(info.presence_bytes) * 8;
        assert!(
            info.fields.len() <= bits && info.fields.len() > bits - 8,
            "{}",
            info.name
        );
    }
    assert_eq!(
        MESSAGES
            .iter()
            .filter(|info| info.fields.iter().all(|field| field.wire.bytes().is_some()))
            .count(),
        103
    );
    assert!(message(0).is_none() && message(2009).is_none() && message(65535).is_none());
}
