//! Checking the codec against vectors of an independent implementation.
//!
//! A vector is a line of JSON: a message in the raw form of [`crate::json`], without its name,
//! and `wire`, the same in hexadecimal.

use serde_json::Value;

use crate::codec::{DecodeError, EncodeError};
use crate::json::{JsonError, decode_line, encode_line};
use crate::table::Message;
use crate::wrapper::{MAX_DATAGRAM, WrapperError, frames};

/// Checks one vector in four ways: JSON to wire, wire to JSON, wire to struct, struct to wire.
pub fn check(vector: &str) -> Result<(), Mismatch> {
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

    differ("JSON to wire", encode_line(vector, true)?.as_str(), wire)?;

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
pub enum Mismatch {
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
