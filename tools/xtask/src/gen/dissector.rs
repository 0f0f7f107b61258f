//! The Wireshark dissector: the message table as Lua tables, and an engine (`dissector.lua`) that is the same for all
//! messages, so that a new row needs no new Lua.

use std::fmt::Write;

use stanag_msgs::TimeStamp;
use stanag_msgs::enums::{EnumInfo, EnumKind};
use stanag_msgs::table::{FieldInfo, Layout, MessageInfo, Wire};

use super::reference::{Edition, enumerations};

/// The whole script.
pub(super) fn script() -> String {
    let mut script = String::from(HEAD);
    for (suffix, edition) in [("", Edition::Later), ("_25", Edition::Ed25)] {
        let _ = writeln!(script, "local ENUMS{suffix} = {{");
        for (name, info) in enumerations(edition) {
            let _ = writeln!(script, "  {name} = {},", enumeration(info));
        }
        let _ = writeln!(script, "}}\n\nlocal MESSAGES{suffix} = {{");
        for message in edition.messages() {
            script.push_str(&self::message(message));
        }
        script.push_str("}\n\n");
    }
    script.push_str(ENGINE);
    script
}

fn enumeration(info: &EnumInfo) -> String {
    let mut table = String::from("{ ");
    match info.kind {
        EnumKind::Bitmap => {
            let bits: Vec<String> = info
                .values
                .iter()
                .filter(|(mask, _, _)| *mask != 0)
                .map(|(mask, name, text)| {
                    let short = quoted(&name.to_lowercase());
                    format!(
                        "{{ short = {short}, name = {}, mask = {mask:#x} }}",
                        quoted(text)
                    )
                })
                .collect();
            entry(&mut table, "bits", &format!("{{ {} }}", bits.join(", ")));
        }
        EnumKind::Enumeration => {
            let values: Vec<String> = info
                .values
                .iter()
                .map(|(value, _, text)| format!("[{value}] = {}", quoted(text)))
                .collect();
            entry(
                &mut table,
                "values",
                &format!("{{ {} }}", values.join(", ")),
            );
            let ranges: Vec<String> = info
                .ranges
                .iter()
                .filter_map(|(range, text)| {
                    let (low, high) = bounds(range)?;
                    Some(format!("{{ {low}, {high}, {} }}", quoted(text)))
                })
                .collect();
            if !ranges.is_empty() {
                entry(
                    &mut table,
                    "ranges",
                    &format!("{{ {} }}", ranges.join(", ")),
                );
            }
        }
    }
    table + " }"
}

/// Fields that the info column shows beside the name of their message, and in which words.
const NOTES: &[(&str, &str)] = &[
    ("select_flight_path_control_mode", "mode"),
    ("waypoint_number", "waypoint"),
    ("commanded_waypoint_number", "to waypoint"),
    ("to_waypoint_number", "to waypoint"),
    ("requested_handover_loi", "LOI"),
    ("loi_granted", "LOI granted"),
    ("mission_plan_mode", "plan"),
    ("original_message_type", "of"),
    ("acknowledgement_type", ""),
    ("text", ""),
];

/// The ends of a range of values as the table writes it: `32-255`, or one value.
fn bounds(range: &str) -> Option<(i64, i64)> {
    let (low, high) = range.split_once('-').unwrap_or((range, range));
    Some((low.parse().ok()?, high.parse().ok()?))
}

fn message(message: &MessageInfo) -> String {
    let mut table = String::from("{ ");
    entry(&mut table, "name", &quoted(message.name));
    entry(&mut table, "short", &quoted(&snake(message.rust)));
    entry(&mut table, "presence", &message.presence_bytes.to_string());
    if message.layout == Layout::Ed2Derived {
        entry(&mut table, "provisional", "true");
    }
    let mut text = format!("  [{}] = {table}, fields = {{\n", message.id);
    for field in message.fields {
        let _ = writeln!(text, "    {},", self::field(field));
    }
    text.push_str("  } },\n");
    text
}

fn field(field: &FieldInfo) -> String {
    let mut table = String::from("{ ");
    entry(&mut table, "short", &quoted(field.rust));
    entry(&mut table, "name", &quoted(field.name));
    match field.wire {
        Wire::Char(bytes) => entry(&mut table, "chars", &bytes.to_string()),
        wire => entry(&mut table, "wire", &quoted(&wire.to_string())),
    }
    if let Some(info) = field.enumeration {
        entry(&mut table, "enum", &quoted(info.name));
    }
    if field.identification {
        entry(&mut table, "id", "true");
    }
    if let Some((_, note)) = NOTES.iter().find(|(name, _)| *name == field.rust) {
        entry(&mut table, "note", &quoted(note));
    }
    if field.step() != 1.0 {
        entry(&mut table, "step", &format!("{:?}", field.step()));
    }
    match field.unit {
        Some(TimeStamp::UNIT) if field.wire == Wire::U40 => entry(&mut table, "time", "true"),
        Some(unit) => entry(&mut table, "unit", &quoted(unit)),
        None => {}
    }
    if let Some((low, high)) = field.range {
        entry(&mut table, "low", &format!("{low:?}"));
        entry(&mut table, "high", &format!("{high:?}"));
    }
    table + " }"
}

/// `UaRoute` to `ua_route`.
fn snake(name: &str) -> String {
    let mut snake = String::new();
    for character in name.chars() {
        if character.is_uppercase() && !snake.is_empty() {
            snake.push('_');
        }
        snake.extend(character.to_lowercase());
    }
    snake
}

/// A Lua string.
fn quoted(text: &str) -> String {
    let mut quoted = String::from("\"");
    for character in text.chars() {
        match character {
            '"' | '\\' => quoted.extend(['\\', character]),
            '\n' => quoted.push_str("\\n"),
            _ => quoted.push(character),
        }
    }
    quoted.push('"');
    quoted
}

/// Appends `, name = value`, or without the comma where it is the first.
fn entry(table: &mut String, name: &str, value: &str) {
    if !table.ends_with("{ ") {
        table.push_str(", ");
    }
    // Writing to a String cannot fail.
    let _ = write!(table, "{name} = {value}");
}

const HEAD: &str = r#"-- Wireshark dissector for STANAG 4586 DLI messages: Edition 4 (AEP-84 Vol II), with the private ones, and Edition 2.5.
-- Generated by `cargo xtask gen` from the message table; changes here are lost.
--
-- Copy it to the folder of personal Lua plugins (Help, About, Folders), or start
--   wireshark -X lua_script:stanag4586.lua
-- The UDP ports are a preference of the protocol; datagrams on other ports are recognised by their content.
-- Fields are named stanag4586.<message>.<field>, as in stanag4586.inertial_states.latitude, those of Edition 2.5
-- stanag4586.ed25.<message>.<field>; a scaled field is in SI units, and its value on the wire is below it, with ".raw" at the end of its name.

"#;

const ENGINE: &str = include_str!("dissector.lua");

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_of_fields_are_distinct() {
        for edition in [Edition::Later, Edition::Ed25] {
            let messages = edition.messages();
            let mut names: Vec<_> = messages.iter().map(|message| snake(message.rust)).collect();
            let count = names.len();
            names.sort();
            names.dedup();
            assert_eq!(names.len(), count);
        }
        assert_eq!(snake("UaPositionWaypoint"), "ua_position_waypoint");
    }

    #[test]
    fn ranges_are_read_as_the_table_writes_them() {
        assert_eq!(bounds("32-255"), Some((32, 255)));
        assert_eq!(bounds("18"), Some((18, 18)));
        assert_eq!(bounds("0x10..0x8000"), None);
        for info in enumerations(Edition::Later).values() {
            if info.kind == EnumKind::Enumeration {
                for (range, _) in info.ranges {
                    assert!(bounds(range).is_some(), "{} {range}", info.name);
                }
            }
        }
    }

    #[test]
    fn a_row_of_the_table_becomes_a_row_of_lua() {
        let row = stanag_msgs::table::message(16002).unwrap();
        assert_eq!(
            message(row),
            "  [16002] = { name = \"Heartbeat\", short = \"heartbeat\", presence = 1, fields = {\n    \
             { short = \"time_stamp\", name = \"Time Stamp\", wire = \"u40\", time = true },\n  } },\n"
        );
    }

    #[test]
    fn quotes_in_a_text_are_escaped() {
        assert_eq!(quoted("a \"b\" \\"), "\"a \\\"b\\\" \\\\\"");
    }

    #[test]
    fn entries_are_separated_by_commas() {
        let mut table = String::from("{ ");
        entry(&mut table, "a", "1");
        entry(&mut table, "b", &quoted("x"));
        assert_eq!(table, "{ a = 1, b = \"x\"");
    }
}
