//! The file of definitions: events by their ids, with messages and arguments; and the general metadata, which names it.

use std::collections::BTreeMap;

use mavlink_link::service::event::Received;
use serde::{Deserialize, Deserializer};

use super::packed::{UnpackError, unpack};
use super::text::{Argument, MAX_TEXT, Values, sentence};
use super::{Described, Group};

/// Why metadata cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum MetadataError {
    /// It does not unpack.
    #[error(transparent)]
    Packed(#[from] UnpackError),
    /// It is not JSON of this form.
    #[error("not the JSON of such metadata: {0}")]
    Json(#[from] serde_json::Error),
    /// It names no such file.
    #[error("the vehicle's general metadata names no file of {0}")]
    NoFile(Definitions),
    /// It is somewhere else.
    #[error("the vehicle's metadata is at {0:?}: expected a file of the vehicle itself (mftp://)")]
    Elsewhere(String),
    /// More than a vehicle has.
    #[error(
        "{0} groups of a component and {1} events: expected at most {MAX_GROUPS} and {MAX_EVENTS}"
    )]
    TooMany(usize, usize),
    /// More than a vehicle has.
    #[error("{0} parameters: expected at most {1}")]
    TooManyParameters(usize, usize),
}

/// What a file of metadata defines (COMP_METADATA_TYPE).
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Definitions {
    /// COMP_METADATA_TYPE_PARAMETER
    Parameters = 1,
    /// COMP_METADATA_TYPE_EVENTS
    Events = 4,
}

impl std::fmt::Display for Definitions {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(match self {
            Definitions::Parameters => "parameters (type 1)",
            Definitions::Events => "events (type 4)",
        })
    }
}

/// Where the vehicle has its definitions, by its general metadata: a path for MAVLink FTP.
///
/// # Errors
/// It cannot be read, or names no such file of the vehicle.
pub fn find(general: &[u8], wanted: Definitions) -> Result<String, MetadataError> {
    let general: General = serde_json::from_slice(&unpack(general)?)?;
    let mut types = general.types.into_iter();
    let found = types.find(|one| one.kind == wanted as u32);
    path_of(&found.ok_or(MetadataError::NoFile(wanted))?.uri)
}

/// The path in an `mftp://` address of the autopilot; `mftp://[;comp=1]` names it.
///
/// # Errors
/// The address is another one.
pub fn path_of(uri: &str) -> Result<String, MetadataError> {
    let elsewhere = || MetadataError::Elsewhere(uri.chars().take(200).collect());
    let rest = uri.strip_prefix("mftp://").ok_or_else(elsewhere)?;
    let path = rest.strip_prefix("[;comp=1]").unwrap_or(rest);
    if path.is_empty() || path.starts_with('[') {
        return Err(elsewhere());
    }
    Ok(format!("/{}", path.trim_start_matches('/')))
}

#[derive(Debug, Deserialize)]
struct General {
    #[serde(rename = "metadataTypes", default)]
    types: Vec<Metadata>,
}

#[derive(Debug, Deserialize)]
struct Metadata {
    #[serde(rename = "type")]
    kind: u32,
    #[serde(default)]
    uri: String,
}

/// What the events of a vehicle mean.
#[derive(Debug, Clone, Default)]
pub struct Catalogue {
    components: BTreeMap<u8, Component>,
}

#[derive(Debug, Clone, Default, Deserialize)]
struct Component {
    #[serde(default)]
    namespace: String,
    #[serde(default)]
    enums: BTreeMap<String, Enumeration>,
    #[serde(rename = "event_groups", default)]
    groups: BTreeMap<String, Events>,
}

#[derive(Debug, Clone, Default, Deserialize)]
struct Events {
    #[serde(default)]
    events: BTreeMap<u32, Definition>,
}

#[derive(Debug, Clone, Deserialize)]
struct Definition {
    #[serde(default, deserialize_with = "cut")]
    message: String,
    #[serde(default)]
    arguments: Vec<ArgumentType>,
}

#[derive(Debug, Clone, Deserialize)]
struct ArgumentType {
    #[serde(rename = "type")]
    name: String,
}

#[derive(Debug, Clone, Deserialize)]
struct Enumeration {
    #[serde(rename = "type")]
    base: String,
    #[serde(default)]
    is_bitfield: bool,
    /// By the value as a decimal number.
    #[serde(default)]
    entries: BTreeMap<String, Entry>,
}

#[derive(Debug, Clone, Deserialize)]
struct Entry {
    #[serde(default, deserialize_with = "cut")]
    description: String,
}

#[derive(Deserialize)]
struct File {
    components: BTreeMap<u8, Component>,
}

/// Cuts a text to what an alert shows, with room for its marks: the sender of the file must not fill the memory.
fn cut<'de, D: Deserializer<'de>>(from: D) -> Result<String, D::Error> {
    let text = String::deserialize(from)?;
    Ok(text.chars().take(2 * MAX_TEXT).collect())
}

impl Catalogue {
    /// The definitions of a file, packed or not.
    ///
    /// # Errors
    /// It does not unpack, is not of this form, or has more than a vehicle has.
    pub fn read(file: &[u8]) -> Result<Self, MetadataError> {
        let File { components } = serde_json::from_slice(&unpack(file)?)?;
        let read = Self { components };
        // Each event is looked for in all groups of its component.
        let all = read.components.values();
        let groups = all.map(|one| one.groups.len()).max().unwrap_or(0);
        if groups > MAX_GROUPS || read.len() > MAX_EVENTS {
            return Err(MetadataError::TooMany(groups, read.len()));
        }
        Ok(read)
    }

    /// How many events it defines.
    #[must_use]
    pub fn len(&self) -> usize {
        let groups = self.components.values().flat_map(|one| one.groups.values());
        groups.map(|group| group.events.len()).sum()
    }

    /// Whether it defines none.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// What an event means; `None` where it is not defined, or its arguments are not as they are defined.
    #[must_use]
    pub fn describe(&self, event: &Received) -> Option<Described> {
        let component = self.components.get(&u8::try_from(event.id >> 24).ok()?)?;
        let number = event.id & 0xff_ffff;
        let (name, definition) = component
            .groups
            .iter()
            .find_map(|(name, group)| Some((name, group.events.get(&number)?)))?;
        let mut values = Values::new(&event.arguments);
        let arguments: Option<Vec<Argument>> = definition
            .arguments
            .iter()
            .map(|argument| self.argument(component, &argument.name, &mut values))
            .collect();
        let group = match name.as_str() {
            "default" => Group::Default,
            "health" | "arming_check" => Group::Check,
            _ => Group::Other,
        };
        let text = sentence(&definition.message, &arguments?);
        (!text.is_empty()).then_some(Described { group, text })
    }

    fn argument(&self, own: &Component, name: &str, values: &mut Values<'_>) -> Option<Argument> {
        let Some(kind) = self.enumeration(own, name) else {
            return values.take(name);
        };
        let Argument::Whole(value) = values.take(&kind.base)? else {
            return None;
        };
        let named = |value: i128| {
            let entry = kind.entries.get(&value.to_string())?;
            Some(entry.description.as_str())
        };
        if kind.is_bitfield {
            let bits = (0..64).map(|bit| 1_i128 << bit);
            let set = bits.filter(|bit| value & bit != 0);
            let all: Vec<&str> = set.filter_map(named).collect();
            return Some(Argument::Named(all.join(", ")));
        }
        Some(match named(value) {
            Some(text) => Argument::Named(text.to_owned()),
            None => Argument::Whole(value),
        })
    }

    /// An enumeration of the event's own component, of another one by its namespace, or of the common ones.
    fn enumeration<'a>(&'a self, own: &'a Component, name: &str) -> Option<&'a Enumeration> {
        if let Some((space, name)) = name.split_once("::") {
            let mut all = self.components.values();
            return all.find(|one| one.namespace == space)?.enums.get(name);
        }
        let common = self.components.get(&0);
        own.enums
            .get(name)
            .or_else(|| common.and_then(|common| common.enums.get(name)))
    }
}

/// PX4 has 6.
const MAX_GROUPS: usize = 16;
/// PX4 has some 500.
const MAX_EVENTS: usize = 20_000;

#[cfg(test)]
mod tests {
    use super::*;
    use crate::event::Group;

    const FILE: &str = r#"{"version": 2, "components": {
        "0": {"namespace": "common", "enums": {"side_t": {"type": "uint8_t", "is_bitfield": true,
            "entries": {"1": {"description": "left"}, "2": {"description": "right"}}}}},
        "1": {"namespace": "px4", "enums": {"reason_t": {"type": "uint8_t",
            "entries": {"4": {"description": "external command"}}}},
          "event_groups": {
            "default": {"events": {
              "42": {"name": "a", "message": "Armed by {1}", "arguments": [{"type": "reason_t"}]},
              "43": {"name": "b", "message": "Climb {2:.1m_v} on the {1} at \\{x\\}", "arguments":
                [{"type": "common::side_t"}, {"type": "float"}]}}},
            "health": {"events": {"7": {"name": "c", "message": "See <param>BAT_LOW_THR</param>"}}},
            "calibration": {"events": {"8": {"name": "d", "message": "p"}}}}}}}"#;

    fn event(number: u32, bytes: &[u8]) -> Received {
        let mut arguments = [0; 40];
        arguments[..bytes.len()].copy_from_slice(bytes);
        Received {
            id: 1 << 24 | number,
            sequence: 0,
            level: 6,
            arguments,
        }
    }

    #[test]
    fn arguments_are_named_by_the_vehicles_own_definitions() {
        let catalogue = Catalogue::read(FILE.as_bytes()).expect("it is of the form");
        assert_eq!(catalogue.len(), 4);
        let text = |event| catalogue.describe(&event).map(|known| known.text);
        assert_eq!(
            text(event(42, &[4])).as_deref(),
            Some("Armed by external command")
        );
        assert_eq!(text(event(42, &[9])).as_deref(), Some("Armed by 9"));
        let mut bytes = vec![3];
        bytes.extend(12.34_f32.to_le_bytes());
        assert_eq!(
            text(event(43, &bytes)).as_deref(),
            Some("Climb 12.3 m on the left, right at {x}")
        );
        assert_eq!(text(event(99, &[])), None);
        let group = |number| {
            catalogue
                .describe(&event(number, &[]))
                .map(|known| known.group)
        };
        assert_eq!(group(7), Some(Group::Check));
        assert_eq!(group(8), Some(Group::Other));
        assert_eq!(text(event(7, &[])).as_deref(), Some("See BAT_LOW_THR"));
    }

    #[test]
    fn only_files_of_the_vehicle_itself_are_taken() {
        let general = |uri: &str| {
            format!(
                r#"{{"metadataTypes": [{{"type": 1, "uri": "x"}}, {{"type": 4, "uri": "{uri}"}}]}}"#
            )
        };
        let found = |uri: &str| find(general(uri).as_bytes(), Definitions::Events).ok();
        assert_eq!(
            found("mftp://etc/extras/e.json.xz").as_deref(),
            Some("/etc/extras/e.json.xz")
        );
        assert_eq!(found("mftp://[;comp=1]/a.json").as_deref(), Some("/a.json"));
        assert_eq!(found("mftp://[;comp=100]/a.json"), None);
        assert_eq!(found("https://example.org/a.json"), None);
        assert!(matches!(
            find(b"{}", Definitions::Events),
            Err(MetadataError::NoFile(Definitions::Events))
        ));
    }

    #[test]
    fn definitions_that_would_fill_the_memory_describe_one_line_or_are_refused() {
        let long = FILE
            .replace("external command", &"x".repeat(1_000_000))
            .replace("Armed by {1}", &"{1}".repeat(600_000));
        let long = Catalogue::read(long.as_bytes()).expect("the form is right");
        let text = long.describe(&event(42, &[4])).expect("it is defined").text;
        assert_eq!(text, "x".repeat(MAX_TEXT));
        let with = |groups: &str| {
            let file = format!(r#"{{"components": {{"1": {{"event_groups": {{{groups}}}}}}}}}"#);
            Catalogue::read(file.as_bytes())
        };
        let groups: Vec<String> = (0..17).map(|at| format!(r#""{at}": {{}}"#)).collect();
        assert!(matches!(
            with(&groups.join(",")),
            Err(MetadataError::TooMany(17, 0))
        ));
        assert!(with(&groups[..16].join(",")).is_ok());
        let events: Vec<String> = (0..20_001).map(|at| format!(r#""{at}": {{}}"#)).collect();
        let events = format!(r#""default": {{"events": {{{}}}}}"#, events.join(","));
        assert!(matches!(
            with(&events),
            Err(MetadataError::TooMany(1, 20_001))
        ));
    }

    #[test]
    fn damaged_definitions_are_refused_and_odd_ones_describe_nothing() {
        assert!(matches!(
            Catalogue::read(b"{\"components\": 7}"),
            Err(MetadataError::Json(_))
        ));
        let odd = FILE.replace("\"reason_t\"}]", "\"unknown_t\"}]");
        let odd = Catalogue::read(odd.as_bytes()).expect("the form is right");
        assert_eq!(
            odd.describe(&event(42, &[4])),
            None,
            "an argument of unknown size"
        );
    }
}
