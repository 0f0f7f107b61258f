//! The codec and an independent implementation agree, both ways, on every layout.
//!
//! A vector is a line of JSON: a message in the raw form of `stanag_msgs::json`, without its name,
//! and `wire`, the same in hexadecimal.

use std::collections::BTreeSet;
use std::io::Read;

use serde_json::Value;
use stanag_msgs::json::{JsonError, decode_line, encode_line};
use stanag_msgs::table::MESSAGES;
use stanag_msgs::{DecodeError, EncodeError, MAX_DATAGRAM, Message, WrapperError, frames};

fn vectors() -> String {
    let path = concat!(
        env!("CARGO_MANIFEST_DIR"),
        "/../tests/data/dli/vectors-4586.jsonl.gz"
    );
    let mut text = String::new();
    let file = std::fs::File::open(path).unwrap();
    flate2::read::GzDecoder::new(file)
        .read_to_string(&mut text)
        .unwrap();
    text
}

#[test]
fn every_vector_agrees_both_ways() {
    let mut seen = BTreeSet::new();
    for line in vectors().lines() {
        check(line).unwrap_or_else(|mismatch| panic!("{mismatch}\n{line}"));
        let value: Value = serde_json::from_str(line).unwrap();
        seen.insert(value["id"].as_u64().unwrap());
    }
    let known = MESSAGES
        .iter()
        .filter(|info| info.fields.iter().all(|field| field.wire.bytes().is_some()));
    assert_eq!(seen, known.map(|info| u64::from(info.id)).collect());
}

#[test]
fn a_wrong_vector_is_detected() {
    let vectors = vectors();
    let line = vectors
        .lines()
        .find(|line| line.contains("\"id\": 4000,"))
        .unwrap();
    assert_eq!(check(line), Ok(()));
    let mut value: Value = serde_json::from_str(line).unwrap();
    value["fields"]["Altitude"] = 1.into();
    assert!(matches!(
        check(&value.to_string()),
        Err(Mismatch::Differs { .. })
    ));
    value["fields"]["Altitude"] = (1 << 23).into();
    assert!(matches!(check(&value.to_string()), Err(Mismatch::Json(_))));
    assert!(matches!(check("{}"), Err(Mismatch::Vector { .. })));
}

/// Checks one vector in four ways: JSON to wire, wire to JSON, wire to struct, struct to wire.
fn check(vector: &str) -> Result<(), Mismatch> {
    let mut expected: Value = serde_json::from_str(vector).map_err(|error| Mismatch::Vector {
        what: error.to_string(),
    })?;
    let wire = expected
        .as_object_mut()
        .and_then(|object| object.remove("wire"));
    let Some(wire) = wire.as_ref().and_then(Value::as_str) else {
        return Err(Mismatch::Vector {
            what: "no wire".to_owned(),
        });
    };

    let encoded = encode_line(&expected.to_string(), true)?;
    differ("JSON to wire", encoded.as_str(), wire)?;

    let mut decoded = decode_line(wire, true);
    for value in &mut decoded {
        if let Some(object) = value.as_object_mut() {
            object.remove("name");
        }
    }
    differ(
        "wire to JSON",
        &Value::from(decoded),
        &Value::from(vec![expected]),
    )?;

    let bytes: Vec<u8> = (0..wire.len() / 2)
        .map_while(|index| u8::from_str_radix(wire.get(2 * index..2 * index + 2)?, 16).ok())
        .collect();
    for frame in frames(&bytes) {
        let frame = frame?;
        let message = Message::decode(frame.header.message_type, frame.data)?;
        let mut out = [0; MAX_DATAGRAM];
        let length = message.encode(&frame.header.envelope(), &mut out)?;
        differ("struct to wire", &out[..length], frame.bytes)?;
    }
    Ok(())
}

/// How the codec and a vector differ.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
enum Mismatch {
    /// The line is not a vector.
    #[error("not a vector: {what}")]
    Vector {
        /// Why.
        what: String,
    },
    /// A step gives something else.
    #[error("{step}: {found}, expected {expected}")]
    Differs {
        /// The step.
        step: &'static str,
        /// What it gives.
        found: String,
        /// What the vector has.
        expected: String,
    },
    /// The JSON is refused.
    #[error(transparent)]
    Json(#[from] JsonError),
    /// The wrapper is refused.
    #[error(transparent)]
    Wrapper(#[from] WrapperError),
    /// The data is refused.
    #[error(transparent)]
    Decode(#[from] DecodeError),
    /// The struct cannot be written.
    #[error(transparent)]
    Encode(#[from] EncodeError),
}

fn differ<T, U>(step: &'static str, found: &T, expected: &U) -> Result<(), Mismatch>
where
    T: std::fmt::Debug + PartialEq<U> + ?Sized,
    U: std::fmt::Debug + ?Sized,
{
    if found == expected {
        return Ok(());
    }
    Err(Mismatch::Differs {
        step,
        found: format!("{found:?}"),
        expected: format!("{expected:?}"),
    })
}
