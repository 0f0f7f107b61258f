//! Edition 2.5: the table equals the facts of its public text, the codec and an independent one agree on every
//! message, and what is not a message is named with its place.

use std::io::Read;

use kit::process::{from_hex, hex};
use serde_json::{Value as Json, json};
use stanag_msgs::ed25::{self, HEADER_BYTES, Header, MAX_DATA, TRAILER_BYTES, Version};
use stanag_msgs::field::{EnumKind, FieldInfo};
use stanag_msgs::json::{JsonError, decode_line, encode_line};
use stanag_msgs::table::{Confidence, Layout, MESSAGES, MessageInfo, walk};
use stanag_msgs::{EncodeError, MAX_DATAGRAM, WrapperError, frames};
use toml::{Table, Value};

const DATA: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../tests/data/dli");

fn facts() -> Table {
    let text = std::fs::read_to_string(format!("{DATA}/ed25.toml")).unwrap();
    text.parse().unwrap()
}

fn vectors() -> String {
    let mut text = String::new();
    let file = std::fs::File::open(format!("{DATA}/vectors-ed25-4586.jsonl.gz")).unwrap();
    flate2::read::GzDecoder::new(file)
        .read_to_string(&mut text)
        .unwrap();
    text
}

/// The first vector of this type.
fn vector(id: u64) -> Json {
    let vectors = vectors();
    let mut lines = vectors
        .lines()
        .map(|line| serde_json::from_str(line).unwrap());
    lines.find(|line: &Json| line["id"] == id).unwrap()
}

fn wire(id: u64) -> Vec<u8> {
    from_hex(vector(id)["wire"].as_str().unwrap())
}

#[test]
fn every_vector_agrees_both_ways() {
    let mut seen = std::collections::BTreeSet::new();
    for line in vectors().lines() {
        let mut vector: Json = serde_json::from_str(line).unwrap();
        let wire = vector.as_object_mut().unwrap().remove("wire").unwrap();
        let wire = wire.as_str().unwrap();
        assert_eq!(
            encode_line(&vector.to_string(), true).unwrap(),
            wire,
            "{line}"
        );
        let mut decoded = decode_line(wire, true);
        decoded[0].as_object_mut().unwrap().remove("name").unwrap();
        assert_eq!(
            Json::from(decoded),
            Json::from(vec![vector.clone()]),
            "{line}"
        );

        // As a person reads it, and back again.
        let [read] = &decode_line(wire, false)[..] else {
            panic!("one message")
        };
        assert_eq!(
            encode_line(&read.to_string(), false).unwrap(),
            wire,
            "{read}"
        );
        seen.insert(vector["id"].as_u64().unwrap());
    }
    let known = ed25::messages()
        .map(|message| u64::from(message.id))
        .collect();
    assert_eq!(seen, known);
}

#[test]
fn every_message_and_field_equals_its_facts() {
    let facts = facts();
    let rows = facts["message"].as_array().unwrap();
    assert_eq!(ed25::messages().count(), rows.len());
    let mut fields = 0;
    for (info, fact) in ed25::messages().zip(rows) {
        same_message(info, fact);
        let rows = fact["fields"].as_array().unwrap();
        assert_eq!(info.fields.len(), rows.len(), "{}", info.name);
        for (index, (field, fact)) in info.fields.iter().zip(rows).enumerate() {
            assert_eq!(usize::from(field.bit), index, "{} {}", info.id, field.name);
            same_field(info.id, field, fact);
            fields += 1;
        }
    }
    // Those of the text, and of the three private messages.
    assert_eq!(fields, 814 + 17);
}

fn text<'a>(fact: &'a Value, key: &str) -> Option<&'a str> {
    fact.get(key).map(|value| value.as_str().unwrap())
}

fn same_message(info: &MessageInfo, fact: &Value) {
    let id = info.id;
    let integers = |key: &str| -> Vec<i64> {
        let list = fact.get(key).and_then(Value::as_array);
        list.into_iter()
            .flatten()
            .filter_map(Value::as_integer)
            .collect()
    };
    assert_eq!(Some(i64::from(id)), fact["id"].as_integer());
    assert_eq!(Some(info.name), text(fact, "name"), "{id}");
    assert_eq!(Some(info.direction.text()), text(fact, "direction"), "{id}");
    assert_eq!(Some(info.traffic.text()), text(fact, "push_pull"), "{id}");
    assert_eq!(
        info.latency_ms.map(i64::from),
        fact["max_latency_ms"].as_integer(),
        "{id}"
    );
    assert_eq!(
        info.loi
            .iter()
            .map(|&level| level.into())
            .collect::<Vec<i64>>(),
        integers("loi"),
        "{id}"
    );
    assert_eq!(
        info.ed4_messages
            .iter()
            .map(|&message| message.into())
            .collect::<Vec<i64>>(),
        integers("ed4_message"),
        "{id}"
    );
    assert_eq!(
        Some(info.full_bytes() as i64),
        fact["octets"].as_integer(),
        "{id}"
    );
    assert_eq!(
        (Some(info.source), info.table),
        (text(fact, "clause"), text(fact, "table")),
        "{id}"
    );
    assert_eq!(info.note, text(fact, "note"), "{id}");
    assert_eq!(
        (info.presence_bytes, info.layout),
        (0, Layout::Ed25),
        "{id}"
    );
}

fn same_field(id: u16, field: &FieldInfo, fact: &Value) {
    let name = format!("{id} {}", field.name);
    assert_eq!(Some(field.name), text(fact, "name"), "{name}");
    assert_eq!(
        Some(field.wire.to_string().as_str()),
        text(fact, "type"),
        "{name}"
    );
    assert_eq!(field.uid, text(fact, "uid"), "{name}");
    let unit = text(fact, "unit").filter(|unit| *unit != "of the field");
    assert_eq!(field.unit, unit, "{name}");
    assert_eq!(
        field.scale,
        fact.get("scale").and_then(Value::as_float),
        "{name}"
    );
    assert_eq!(
        field.enumeration.map(|info| info.name),
        text(fact, "enum"),
        "{name}"
    );
    let doubtful = text(fact, "conf").map(|_| Confidence::C);
    assert_eq!(field.confidence, doubtful, "{name}");
    let place = text(fact, "ed4").filter(|place| !place.starts_with("wrapper"));
    let place = place.map(|place| {
        let (message, number) = place.split_once('.').unwrap();
        (message.parse().unwrap(), number.parse().unwrap())
    });
    assert_eq!(field.ed4, place, "{name}");
    if let Some(note) = text(fact, "note") {
        assert!(field.note.unwrap().contains(note), "{name}");
    }
    assert_eq!(field.range, range(fact, field), "{name}");
}

/// The range of a fact with both ends included, where it is one of numbers.
fn range(fact: &Value, field: &FieldInfo) -> Option<(f64, f64)> {
    let (low, high) = text(fact, "range")?.split_once("..")?;
    let number = |text: &str| {
        let text = text.trim_matches('<');
        let Some((factor, divisor)) = text.split_once("pi") else {
            return text.parse().unwrap();
        };
        let factor = match factor {
            "" => 1.0,
            "-" => -1.0,
            factor => factor.parse().unwrap(),
        };
        factor * std::f64::consts::PI
            / divisor
                .strip_prefix('/')
                .map_or(1.0, |by| by.parse().unwrap())
    };
    let below = if high.starts_with('<') && field.wire.integers().is_some() {
        1.0
    } else {
        0.0
    };
    Some((number(low), number(high) - below))
}

#[test]
fn every_enumeration_equals_its_facts() {
    let facts = facts();
    let enums = facts["enums"].as_table().unwrap();
    let mut seen = std::collections::BTreeSet::new();
    for field in ed25::messages().flat_map(|info| info.fields) {
        let Some(info) = field.enumeration else {
            continue;
        };
        if !seen.insert(info.name) {
            continue;
        }
        let fact = &enums[info.name];
        let kind = if info.kind == EnumKind::Bitmap {
            "bitmap"
        } else {
            "enum"
        };
        assert_eq!(Some(kind), text(fact, "kind"), "{}", info.name);
        assert_eq!(
            info.description,
            text(fact, "desc").unwrap_or_default(),
            "{}",
            info.name
        );
        let values = fact["values"].as_table().unwrap();
        assert_eq!(info.values.len(), values.len(), "{}", info.name);
        for (key, value) in values {
            let raw = match key.strip_prefix("0x") {
                Some(hex) => i64::from_str_radix(hex, 16).unwrap(),
                None => key.parse().unwrap(),
            };
            assert_eq!(info.text(raw), value.as_str(), "{} {key}", info.name);
            let (low, high) = field.wire.integers().unwrap();
            assert!((low..=high).contains(&raw), "{} {key}", info.name);
        }
        let ranges = fact.get("ranges").and_then(Value::as_table);
        assert_eq!(
            info.ranges.len(),
            ranges.map_or(0, Table::len),
            "{}",
            info.name
        );
        for (range, meaning) in info.ranges {
            assert_eq!(
                fact["ranges"][*range].as_str(),
                Some(*meaning),
                "{}",
                info.name
            );
        }
    }
    assert_eq!(seen.len(), enums.len());
}

#[test]
fn every_field_with_a_place_in_edition_4_has_one_that_exists() {
    for field in ed25::messages().flat_map(|info| info.fields) {
        if let Some((message, number)) = field.ed4 {
            let info = MESSAGES.iter().find(|info| info.id == message).unwrap();
            assert!(
                usize::from(number) <= info.fields.len() && number > 0,
                "{}",
                field.name
            );
        }
    }
}

#[test]
fn messages_follow_one_another_in_a_datagram() {
    let (alert, lights) = (wire(1100), wire(44));
    let both = [alert.clone(), lights.clone()].concat();
    let found: Vec<_> = ed25::frames(&both)
        .map(|frame| frame.unwrap().bytes.to_vec())
        .collect();
    assert_eq!(found, [alert, lights]);
    let decoded = decode_line(&hex(&both), true);
    assert_eq!(
        (&decoded[0]["id"], &decoded[1]["id"]),
        (&json!(1100), &json!(44))
    );
}

#[test]
fn the_first_byte_tells_the_editions_apart() {
    for line in vectors().lines() {
        let vector: Json = serde_json::from_str(line).unwrap();
        assert!(ed25::is_ed25(&from_hex(vector["wire"].as_str().unwrap())));
    }
    for info in MESSAGES {
        let line = json!({"id": info.id, "source": 1, "destination": 2, "fields": {}});
        for idd in [30, 32] {
            let mut line = line.clone();
            line["idd"] = idd.into();
            let datagram = from_hex(&encode_line(&line.to_string(), true).unwrap());
            assert!(!ed25::is_ed25(&datagram) && frames(&datagram).next().unwrap().is_ok());
        }
    }
    assert!(!ed25::is_ed25(&[]));
}

#[test]
fn every_flipped_bit_is_detected() {
    for id in [1, 42, 1304] {
        let good = wire(id);
        for bit in 0..8 * good.len() {
            let mut bad = good.clone();
            bad[bit / 8] ^= 1 << (bit % 8);
            let frame = ed25::frames(&bad).next().unwrap();
            assert!(frame.is_err(), "{id}, bit {bit}");
        }
    }
}

#[test]
fn what_is_no_message_is_named_with_its_place() {
    let good = wire(42);
    let first = |datagram: &[u8]| ed25::frames(datagram).next().unwrap().unwrap_err();
    let total = HEADER_BYTES + 17 + TRAILER_BYTES;
    for length in 0..total {
        let fault = first(&good[..length]);
        match length {
            0..HEADER_BYTES => assert!(matches!(fault, WrapperError::NoHeader { .. })),
            _ => assert_eq!(
                fault,
                WrapperError::Truncated {
                    offset: 0,
                    value: length,
                    expected: total
                }
            ),
        }
    }
    let of_length = |value: u32| {
        let mut bad = good.clone();
        bad[18..22].copy_from_slice(&value.to_be_bytes());
        first(&bad)
    };
    for value in [0, MAX_DATA as u32 + 1, u32::MAX] {
        let expected = WrapperError::Length {
            offset: 18,
            value: value as usize,
            expected: MAX_DATA,
        };
        assert_eq!(of_length(value), expected);
    }
    assert!(matches!(
        first(&[b'2'; MAX_DATAGRAM + 1]),
        WrapperError::Oversized { .. }
    ));

    // A version whose text was not available, with a correct checksum; the next message is still found.
    let mut other = good.clone();
    other[..3].copy_from_slice(b"2.6");
    let end = total - TRAILER_BYTES;
    let sum: u32 = other[..end].iter().map(|&byte| u32::from(byte)).sum();
    other[end..].copy_from_slice(&sum.to_be_bytes());
    let fault = first(&other);
    assert_eq!(
        fault.to_string(),
        "offset 0: IDD version \"2.6\", expected 2.5, 7, 8 or 9"
    );
    assert_eq!(fault.reason(), "idd");
    let both = [other, good].concat();
    assert_eq!(ed25::frames(&both).filter(Result::is_ok).count(), 1);
}

#[test]
fn data_of_another_length_is_refused() {
    for info in ed25::messages() {
        let data = vec![0; info.full_bytes() + 1];
        let read = |data: &[u8]| walk(info, data).collect::<Result<Vec<_>, _>>().is_ok();
        assert!(
            read(&data[1..]) && !read(&data) && !read(&data[2..]),
            "{}",
            info.name
        );
    }
}

#[test]
fn a_message_that_does_not_fit_is_not_written() {
    let header = Header {
        version: Version::Ed25,
        instance: 0,
        message_type: 1304,
    };
    let mut out = [0; MAX_DATAGRAM];
    assert_eq!(
        ed25::encode(&header, &[0; MAX_DATA], &mut out),
        Ok(MAX_DATAGRAM)
    );
    assert!(matches!(
        ed25::encode(&header, &[0; MAX_DATA + 1], &mut out),
        Err(EncodeError::TooLong { .. })
    ));
    assert!(matches!(
        ed25::encode(&header, &[0; 20], &mut out[..53]),
        Err(EncodeError::BufferTooSmall { available: 53 })
    ));
}

#[test]
fn a_field_left_out_is_an_error_unless_raw() {
    let line = json!({"id": 48, "idd": "2.5", "fields": {"Time Stamp": 1.0}}).to_string();
    assert_eq!(
        encode_line(&line, false),
        Err(JsonError::Missing { key: "Vehicle ID" })
    );
    let hex = encode_line(&line, true).unwrap();
    assert_eq!(hex.len(), 2 * (HEADER_BYTES + 19 + TRAILER_BYTES));
    let other = json!({"id": 48, "idd": "2.6", "fields": {}}).to_string();
    assert_eq!(
        encode_line(&other, true).unwrap_err().to_string(),
        "idd: \"2.6\", expected 30 to 32, or \"2.5\", \"7\", \"8\" or \"9\""
    );
}
