//! The codec of `stanag-msgs` as a Python extension: three functions over JSON texts. What Python sees, with types and
//! exceptions, is the package around it (`stanag_msgs/__init__.py`): a dictionary is nearer to JSON than to Rust, and
//! `json` of Python's library is faster than building objects one by one across the border.

use pyo3::prelude::*;
use serde_json::{Value, json};
use stanag_msgs::ed25;
use stanag_msgs::field::EnumKind;
use stanag_msgs::json as codec;
use stanag_msgs::table::{FieldInfo, MESSAGES, MessageInfo};

/// The messages of a datagram as a JSON list; a part that is none has `error` and `offset`.
#[pyfunction]
fn decode(datagram: &[u8], raw: bool) -> String {
    Value::from(codec::decode(datagram, raw)).to_string()
}

/// The datagram of a message as a JSON object, or what is wrong with it.
#[pyfunction]
fn encode(message: &str, raw: bool) -> PyResult<Vec<u8>> {
    let value = serde_json::from_str(message).map_err(invalid)?;
    codec::encode(&value, raw).map_err(invalid)
}

fn invalid(error: impl ToString) -> PyErr {
    pyo3::exceptions::PyValueError::new_err(error.to_string())
}

/// The message table as a JSON list: of Edition 2.5, or of Editions 3 and 4.
#[pyfunction]
fn table(edition_2_5: bool) -> String {
    let messages: Vec<Value> = if edition_2_5 {
        ed25::messages().map(message).collect()
    } else {
        MESSAGES.iter().map(message).collect()
    };
    Value::from(messages).to_string()
}

fn message(info: &MessageInfo) -> Value {
    json!({
        "id": info.id,
        "name": info.name,
        "direction": info.direction.text(),
        "confidence": info.confidence.letter(),
        "fields": info.fields.iter().map(field).collect::<Vec<_>>(),
    })
}

fn field(info: &FieldInfo) -> Value {
    let values = info.enumeration.map(|enumeration| {
        let values = enumeration.values.iter();
        json!({
            "bitmap": enumeration.kind == EnumKind::Bitmap,
            "values": values.map(|(value, _, text)| json!([value, text])).collect::<Vec<_>>(),
        })
    });
    json!({
        "number": info.bit + 1,
        "name": info.name,
        "type": info.wire.to_string(),
        "step": info.step(),
        "unit": info.unit,
        "range": info.range.map(|(low, high)| json!([low, high])),
        "enumeration": values,
    })
}

/// The extension module.
#[pymodule]
mod _native {
    #[pymodule_export]
    use super::{decode, encode, table};
}
