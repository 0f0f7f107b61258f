//! What a frame of a web client asks for, once it has verified.

use base64::Engine as _;
use base64::prelude::BASE64_STANDARD;
use serde::Deserialize;
use serde::de::{Deserializer, Error as _};
use serde_json::{Map, Value};
use stanag_msgs::{Id, TimeStamp, json};

/// What a client wants.
#[derive(Debug, Clone, PartialEq)]
pub enum Request {
    /// A message of the DLI, as the datagram that a station sends.
    Message(Vec<u8>),
    /// A file of a route, to be sent as messages.
    Route(RouteFile),
}

/// A file of a route.
#[derive(Debug, Clone, PartialEq)]
pub struct RouteFile {
    /// Its destination.
    pub vehicle: Id,
    /// The name of the file, whose ending is its format.
    pub file: String,
    /// What it holds.
    pub content: Vec<u8>,
    /// The Time Stamp of its first message, ms since 2000.
    pub stamp: u64,
    /// The name or the number of the line that is the route, where there are several.
    pub line: Option<String>,
    /// Above home, of a file without altitudes, m.
    pub height_m: Option<f64>,
    /// Above mean sea level, of a file without altitudes, m.
    pub altitude_m: Option<f64>,
}

/// The same as it is written.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Written {
    #[serde(deserialize_with = "id")]
    vehicle: Id,
    file: String,
    text: Option<String>,
    base64: Option<String>,
    stamp: u64,
    line: Option<String>,
    height_m: Option<f64>,
    altitude_m: Option<f64>,
}

fn id<'de, D: Deserializer<'de>>(deserializer: D) -> Result<Id, D::Error> {
    let text = String::deserialize(deserializer)?;
    text.parse()
        .map_err(|fault| D::Error::custom(format!("vehicle: {fault}")))
}

/// A frame that verifies and cannot be used.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Unusable {
    /// Its number.
    pub of: u64,
    /// What was found, and what was expected.
    pub why: String,
}

impl Request {
    /// Reads the frame of this client.
    pub(super) fn read(frame: &Value, cucs: Id) -> Result<Request, String> {
        let object = frame.as_object().into_iter().flatten();
        let mut asked = object.filter(|(key, _)| *key != "n");
        match (asked.next(), asked.next()) {
            (Some((key, value)), None) if key == "message" => message(value, cucs),
            (Some((key, value)), None) if key == "route" => route(value),
            _ => Err(
                "expected n and either message or route: docs/guide/websocket.md has the shapes"
                    .to_owned(),
            ),
        }
    }
}

fn message(value: &Value, cucs: Id) -> Result<Request, String> {
    let given = value
        .as_object()
        .ok_or("message: expected an object with id, destination and fields")?;
    let mut object: Map<String, Value> = given.clone();
    for (key, found) in given {
        match key.as_str() {
            "id" | "name" | "source" | "destination" | "ack" | "fields" => {}
            // As decoded messages have them. A web client speaks Edition 4, and needs no checksum on its way.
            "idd" | "checksum" if found.is_u64() => {
                object.remove(key);
            }
            _ => {
                return Err(format!(
                    "message: {key} is {found}, expected a message of Edition 4: id, destination, ack and fields"
                ));
            }
        }
    }
    object
        .entry("source")
        .or_insert_with(|| cucs.to_string().into());
    json::encode(&Value::Object(object), false)
        .map(Request::Message)
        .map_err(|fault| format!("message: {fault}"))
}

fn route(value: &Value) -> Result<Request, String> {
    let written = Written::deserialize(value).map_err(|fault| format!("route: {fault}"))?;
    let content = match (written.text, written.base64) {
        (Some(text), None) => text.into_bytes(),
        (None, Some(digits)) => BASE64_STANDARD
            .decode(digits)
            .map_err(|fault| format!("route: base64: {fault}"))?,
        _ => return Err("route: expected either text or base64".to_owned()),
    };
    let stamp = written.stamp;
    if stamp >= TimeStamp::PERIOD_MS {
        return Err(format!(
            "route: stamp {stamp}, expected ms since 2000-01-01"
        ));
    }
    Ok(Request::Route(RouteFile {
        vehicle: written.vehicle,
        file: written.file,
        content,
        stamp,
        line: written.line,
        height_m: written.height_m,
        altitude_m: written.altitude_m,
    }))
}
