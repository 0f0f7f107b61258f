//! Explains errors of a configuration by its keys: line, key, value, what was expected, an example.
//!
//! The parser knows positions and Rust's types; the meaning and range of a key are at its declaration
//! ([`key`](super::key)). This module combines the two. A valid file of another kind is named with the command that takes
//! it, and nothing of it is quoted: it may be a key.

use std::ops::Range;
use std::path::Path;

use serde::de::DeserializeOwned;

use super::error::{ConfigError, Fault};
use super::key::Key;
use super::key::WhenAbsent::{Nothing, Required, Table, Value, ValueOrTable};

/// A place in a text of TOML.
#[derive(Debug, PartialEq, Eq)]
struct Place<'a> {
    /// From 1.
    line: usize,
    /// The table that begins in this line or before, such as `vehicle.curve`; empty before the first.
    table: &'a str,
    /// The place is in the line that begins the table; true where it has two brackets.
    header: Option<bool>,
    /// The line in which the statement begins that the place is in.
    statement: usize,
    /// The keys in front of the place, from the table: `curve.tolerance_m`.
    keys: String,
    /// What stands behind the last of them, up to a remark.
    value: &'a str,
}

impl<'a> Place<'a> {
    fn at(text: &'a str, offset: usize) -> Place<'a> {
        let offset = offset.min(text.len());
        let mut place = Place {
            line: 0,
            table: "",
            header: None,
            statement: 0,
            keys: String::new(),
            value: "",
        };
        let mut statement = 0;
        let mut begin = 0;
        if text.is_empty() {
            place.line = 1;
        }
        for line in text.split_inclusive('\n') {
            if begin > offset {
                break;
            }
            place.line += 1;
            place.header = None;
            let bare = line.trim();
            if let Some((name, list)) = header(bare) {
                (place.table, place.header, statement) = (name, Some(list), begin + line.len());
                place.statement = 0;
            } else if bare.split('=').next().is_some_and(|key| is_key(key.trim())) {
                (statement, place.statement) = (begin, place.line);
            }
            begin += line.len();
        }
        if place.header.is_none() {
            // For a line of several inline tables and lists, the last key before the position counts.
            let whole = text.get(statement..).unwrap_or_default();
            if let Some((outer, rest)) = whole.split_once('=') {
                place.keys = outer.trim().to_owned();
                place.value = rest;
                let first = statement + outer.len() + 1;
                let before = text.get(first..offset.max(first)).unwrap_or_default();
                if let Some((front, _)) = before.rsplit_once('=') {
                    let inner = front.rsplit(['{', ',']).next().unwrap_or_default().trim();
                    if is_key(inner) {
                        place.keys += ".";
                        place.keys += inner;
                        place.value = rest.get(front.len() + 1..).unwrap_or_default();
                    }
                }
            }
        }
        let value = place.value.lines().next().unwrap_or_default();
        place.value = value.split(" #").next().unwrap_or_default().trim();
        place
    }

    /// The key with its tables.
    fn path(&self) -> String {
        match (self.table, self.keys.as_str()) {
            ("", keys) => keys.to_owned(),
            (table, "") => table.to_owned(),
            (table, keys) => format!("{table}.{keys}"),
        }
    }
}

/// The name in `[name]` or `[[name]]`, and whether it is the second; `None` for what is no such line, as in a list of lists.
fn header(line: &str) -> Option<(&str, bool)> {
    let line = line.split('#').next().unwrap_or_default().trim();
    let inner = line.strip_prefix('[')?.strip_suffix(']')?;
    let (name, list) = match inner.strip_prefix('[') {
        Some(inner) => (inner.strip_suffix(']')?, true),
        None => (inner, false),
    };
    is_key(name.trim()).then_some((name.trim(), list))
}

fn is_key(text: &str) -> bool {
    let mut characters = text.chars();
    let letter = characters
        .next()
        .is_some_and(|c| c.is_alphabetic() || c == '_');
    letter && characters.all(|c| c.is_alphanumeric() || matches!(c, '_' | '-' | '.'))
}

/// Puts the parser's error of a `T` into words. `keys` declares the tables of the file; empty where nothing does.
pub(super) fn explain<T: DeserializeOwned>(
    cause: &toml::de::Error,
    text: &str,
    keys: &'static [Key],
) -> ConfigError {
    let message = cause.message();
    let Range { start, end } = cause.span().unwrap_or(0..0);
    let place = Place::at(text, start);
    let path = place.path();
    let quoted = |message: &str| message.split('`').nth(1).unwrap_or_default().to_owned();
    let fault = |key: &str, fault: String| ConfigError::Key {
        line: place.line,
        key: key.to_owned(),
        fault,
    };
    if message.starts_with("missing field") {
        // The missing field has no position: the span is that of its table, or of the whole file.
        let (name, whole) = (quoted(message), place.table.is_empty());
        let table = if whole || start == 0 {
            ""
        } else {
            path.as_str()
        };
        let key = join(table, &name);
        return fault(&key, format!("is missing{}", expectation("", &key, keys)));
    }
    if message.starts_with("unknown field") {
        let name = quoted(message);
        let table = path
            .strip_suffix(&name)
            .unwrap_or(&path)
            .trim_end_matches('.');
        let elsewhere = match tables_of(&name, keys).as_slice() {
            [] => String::new(),
            [of, ..] => format!(" here; {name} belongs in [{of}]"),
        };
        let expected = message
            .split_once(", ")
            .map_or("", |(_, expected)| expected);
        return fault(
            &join(table, &name),
            format!("is not known{elsewhere}; {expected}"),
        );
    }
    if let Some(list) = place.header {
        let table = place.table;
        match (list, message.contains("expected a sequence")) {
            (false, true) => {
                let is =
                    format!("is one table [{table}], expected a list of them: write [[{table}]]");
                return fault(table, is);
            }
            (true, _) if message.starts_with("invalid type") => {
                let is = format!("is a list [[{table}]], expected one table: write [{table}]");
                return fault(table, is);
            }
            _ => {}
        }
    }
    let syntax = toml::from_str::<toml::Table>(text).is_err();
    let elsewhere = syntax && (place.statement != place.line || message == "duplicate key");
    if elsewhere || path.is_empty() {
        return ConfigError::Syntax(cause.to_string().trim_end().into());
    }
    if !syntax && message.starts_with(NO_TEXT) {
        let found = shown(text.get(start..end).unwrap_or(place.value));
        let choices = choices::<T>(text, start..end);
        let expected = choices.map_or_else(
            || "a text in quotes".to_owned(),
            |choices| format!("a text in quotes, {choices}"),
        );
        return fault(
            &path,
            format!("is {found}{}", expectation(&expected, &path, keys)),
        );
    }
    if !syntax && !message.starts_with("invalid ") && !message.starts_with("unknown variant") {
        // The message is already one of our own.
        return fault(&path, format!("is refused: {message}"));
    }
    // A syntax error is usually a text without its quotes.
    let found = if syntax {
        place.value
    } else {
        text.get(start..end).unwrap_or(place.value)
    };
    let expected = match message.rsplit_once("expected ") {
        _ if syntax => expected_in_toml(found),
        Some((_, expected)) => in_words(expected).to_owned(),
        // "invalid socket address syntax" and the like
        None if message.contains("socket address") => {
            "an IP address, which is no name, and a port of 1 to 65535".to_owned()
        }
        None => message
            .strip_prefix("invalid ")
            .unwrap_or(message)
            .to_owned(),
    };
    fault(
        &path,
        format!("is {}{}", shown(found), expectation(&expected, &path, keys)),
    )
}

/// How the parser begins where an enumeration is given something else than a text: it names neither the value nor the choices.
const NO_TEXT: &str = "wanted ";

/// The choices of the enumeration whose value stands there. The parser names them of a text that is none of them, so it is given one.
fn choices<T: DeserializeOwned>(text: &str, at: Range<usize>) -> Option<String> {
    let probe = [text.get(..at.start)?, "\"?\"", text.get(at.end..)?].concat();
    let fault = toml::from_str::<T>(&probe).err()?;
    let choices = fault
        .message()
        .strip_prefix("unknown variant `?`, expected ");
    choices.map(str::to_owned)
}

impl Fault {
    /// With its line and an example.
    pub(super) fn located(self, text: &str, keys: &'static [Key]) -> ConfigError {
        let example = example_of(&self.key, keys)
            .map_or(String::new(), |example| format!("; such as: {example}"));
        ConfigError::Value {
            line: line_of(text, self.at, &self.key),
            key: self.key,
            found: self.found,
            expected: self.expected + &example,
        }
    }
}

fn join(table: &str, key: &str) -> String {
    if table.is_empty() {
        key.to_owned()
    } else {
        format!("{table}.{key}")
    }
}

/// What may be quoted of a value: a key that somebody wrote into the configuration is not repeated into a log.
fn shown(value: &str) -> String {
    let value = value.trim();
    let digits = value.chars().filter(char::is_ascii_hexdigit).count();
    match value.char_indices().nth(60) {
        _ if digits >= 32 => format!("a text with {digits} hex digits"),
        Some((end, _)) => format!("{}...", value.get(..end).unwrap_or_default()),
        None => value.to_owned(),
    }
}

/// `, expected WHAT (MEANING), such as: KEY = VALUE`: as much of it as is known.
pub(super) fn expectation(what: &str, path: &str, keys: &'static [Key]) -> String {
    let key = find(path, keys);
    let meaning = key.map_or(String::new(), meaning);
    let expected = match (what, meaning.as_str()) {
        ("", "") => String::new(),
        ("", meaning) => format!(", expected: {meaning}"),
        (what, "") => format!(", expected {what}"),
        (what, meaning) => format!(", expected {what} ({meaning})"),
    };
    match example_of(path, keys) {
        Some(example) => format!("{expected}; such as: {example}"),
        None => expected,
    }
}

/// The line of a key, from 1, in the table that begins at a byte of the text; 0 for a table that has no place.
pub(super) fn line_of(text: &str, table_at: usize, path: &str) -> usize {
    let (table, name) = path.rsplit_once('.').unwrap_or(("", path));
    let mut lines = (1..).zip(text.lines()).peekable();
    let begins = |line: &str| header(line.trim()).is_some_and(|(name, _)| name == table);
    let first = match table_at {
        0 => text.lines().position(begins).map_or(1, |index| index + 1),
        at => 1 + text.get(..at).unwrap_or_default().matches('\n').count(),
    };
    while lines.next_if(|(number, _)| *number < first).is_some() {}
    let names = |line: &str| {
        let line = line.split(" #").next().unwrap_or_default();
        let mut keys = line
            .split('=')
            .map(|part| part.rsplit(['{', ',']).next().unwrap_or_default().trim());
        keys.any(|key| key == name)
    };
    let within = lines.take_while(|(number, line)| {
        // A nested table still belongs to the table.
        *number == first
            || header(line.trim())
                .is_none_or(|(name, _)| table.starts_with(name) || name.starts_with(table))
    });
    let mut found = within.filter(|(_, line)| header(line.trim()).is_none() && names(line));
    found.next().map_or(first, |(number, _)| number)
}

/// The line of a key in the file of a configuration, from 1. `table_at`: the byte at which its table begins, 0 for one that the
/// file has once. `None` where the file cannot be read.
#[must_use]
pub fn line_in(file: &Path, table_at: usize, key: &str) -> Option<usize> {
    let text = ConfigError::read(file, "").ok()?;
    Some(line_of(&text, table_at, key))
}

/// How a key may stand in the file, where that is known.
pub(super) fn example_of(path: &str, keys: &'static [Key]) -> Option<String> {
    find(path, keys).and_then(|key| example(path, key))
}

/// The first sentence of what a key means.
fn meaning(key: &Key) -> String {
    let lines: Vec<&str> = key.meaning.iter().map(|line| line.trim()).collect();
    let text = lines.join(" ");
    let first = text.split(". ").next().unwrap_or_default();
    first.trim_end_matches(['.', ':']).to_owned()
}

/// How the key may stand in the file.
fn example(path: &str, key: &Key) -> Option<String> {
    let listed = EXAMPLES.iter().find(|(name, _)| *name == path);
    match (key.absent, listed) {
        (_, Some((_, value))) => Some(format!("{} = {value}", key.name)),
        (Value(default), None) => Some(format!("{} = {default}", key.name)),
        (Table(inner), None) => {
            let required = inner.iter().filter(|key| matches!(key.absent, Required));
            let lines: Option<Vec<String>> = required
                .map(|key| example(&join(path, key.name), key))
                .collect();
            let lines = lines.filter(|lines| !lines.is_empty())?;
            Some(format!("[{path}] {}", lines.join(", ")))
        }
        (Required | Nothing(_) | ValueOrTable(_), None) => None,
    }
}

/// Examples of keys that have no default.
const EXAMPLES: &[(&str, &str)] = &[
    ("dli.vsm_id", "\"1b:00:00:01\""),
    ("dli.listen", "\"127.0.0.1:4586\""),
    ("dli.multicast", "\"225.200.1.0:51017\""),
    ("dli.interface", "\"eth0\""),
    ("cucs.id", "\"1b:00:00:a0\""),
    ("cucs.loi", "[2, 3, 4, 5]"),
    ("cucs.address", "\"127.0.0.1\""),
    ("cucs.provisional", "\"status\""),
    ("cucs.guard.key_file", "\"a0.key\""),
    ("access.list", "\"access.list\""),
    ("access.key_file", "\"access.key\""),
    ("forward.name", "\"qgc\""),
    ("forward.link", "\"udpout:127.0.0.1:14560\""),
    ("forward.vehicles", "[\"1b:00:01:01\"]"),
    ("forward.key_file", "\"qgc.key\""),
    ("forward.users", "[1000]"),
    ("vehicle.id", "\"1b:00:01:01\""),
    ("vehicle.logical_id", "\"00:00:00:01\""),
    ("vehicle.link", "\"udpin:127.0.0.1:14550\""),
    ("vehicle.system_id", "1"),
    ("vehicle.count", "1"),
    ("vehicle.tail_number", "\"PX4-01\""),
    ("vehicle.signing", "{ key_file = \"uav1.key\" }"),
    ("vehicle.signing.key_file", "\"uav1.key\""),
    ("vehicle.vehicle_link_id", "0"),
    ("vehicle.rate_bps", "57600"),
    ("vehicle.landing.course_deg", "270.0"),
    ("vehicle.landing.glide_deg", "4.0"),
    ("vehicle.landing.radius_m", "-80.0"),
    ("vehicle.landing.place", "[47.0, 8.0]"),
    ("vehicle.terrain", "\"terrain/\""),
    ("vehicle.termination.action", "\"land\""),
    ("vehicle.contingency.battery", "\"rtl\""),
    ("vehicle.contingency.position", "\"land\""),
    ("vehicle.contingency.fence", "\"rtl\""),
    ("vehicle.contingency.engine", "\"land\""),
    (
        "vehicle.controls.parameters",
        "[\"MPC_XY_*\", \"NAV_LOITER_RAD\"]",
    ),
    (
        "vehicle.controls.groups",
        "[\"Multicopter Position Control\"]",
    ),
    ("vehicle.area.keep", "\"in\""),
    (
        "vehicle.area.vertices",
        "[[47.0, 8.0], [47.1, 8.0], [47.0, 8.1]]",
    ),
    ("vehicle.area.centre", "[47.0, 8.0]"),
    ("vehicle.area.radius_m", "500.0"),
    ("vehicle.rally.place", "[47.0, 8.0]"),
    ("vehicle.rally.height_m", "0.0"),
    ("vehicle.rally.altitude_m", "488.0"),
    ("vehicle.payload.station", "1"),
    ("vehicle.payload.gimbal", "154"),
    ("vehicle.payload.camera", "100"),
    ("store.dir", "\"state\""),
    ("store.kind", "\"etcd\""),
    ("store.endpoints", "[\"http://10.0.0.1:2379\"]"),
    ("store.node", "\"alpha\""),
    ("store.key_file", "\"fleet.key\""),
    ("http.listen", "\"127.0.0.1:8586\""),
    ("web.tiles", "\"map.pmtiles\""),
    ("record.dir", "\"recordings\""),
];

/// A key by its path.
fn find(path: &str, keys: &'static [Key]) -> Option<&'static Key> {
    let (name, rest) = path.split_once('.').unwrap_or((path, ""));
    let key = keys.iter().find(|key| key.name == name)?;
    match key.absent {
        _ if rest.is_empty() => Some(key),
        Table(inner) | ValueOrTable(inner) => find(rest, inner),
        _ => None,
    }
}

/// The tables that have a key of this name.
fn tables_of(name: &str, keys: &'static [Key]) -> Vec<String> {
    fn collect(table: &str, name: &str, keys: &'static [Key], found: &mut Vec<String>) {
        for key in keys {
            if key.name == name && !table.is_empty() {
                found.push(table.to_owned());
            }
            if let Table(inner) | ValueOrTable(inner) = key.absent {
                collect(&join(table, key.name), name, inner, found);
            }
        }
    }
    let mut found = Vec::new();
    collect("", name, keys, &mut found);
    found
}

/// What the parser calls a kind of value, as people do.
fn in_words(expected: &str) -> &str {
    match expected {
        "u8" | "u16" | "u32" | "u64" | "i64" | "usize" => "a whole number",
        "f64" | "f32" => "a number",
        "a string" => "a text in quotes",
        "path string" => "the name of a file or folder in quotes",
        "a boolean" => "true or false",
        "socket address" => "an address and a port in quotes",
        "IP address" => "an address in quotes",
        "a sequence" => "a list in brackets",
        table if table.starts_with("struct ") => "a table",
        other => other,
    }
}

/// What TOML has for a value that it cannot read.
fn expected_in_toml(found: &str) -> String {
    let bare = !found.starts_with(['"', '\'', '[', '{']);
    match found.to_ascii_lowercase().as_str() {
        "true" | "false" | "yes" | "no" | "on" => "true or false".to_owned(),
        "" => "a value".to_owned(),
        _ if bare => format!("a number, or a text in quotes: \"{}\"", shown(found)),
        _ => "a value with closing quotes or brackets".to_owned(),
    }
}

/// What a file is that is no configuration of the bridge or, for the agent, none of the agent: its kind, and what takes it.
pub(super) fn other_kind(text: &str, agent: bool) -> Option<(&'static str, &'static str)> {
    let trimmed = text.trim();
    let lines = || {
        let lines = trimmed.lines().map(str::trim);
        lines.filter(|line| !line.is_empty() && !line.starts_with('#'))
    };
    let has = |table: &str| lines().filter_map(header).any(|(name, _)| name == table);
    let first = lines().next().unwrap_or_default();
    let hex = |line: &str| line.len() >= 32 && line.bytes().all(|byte| byte.is_ascii_hexdigit());
    if hex(trimmed) && trimmed.len() == 64 {
        Some((
            "a signing key",
            "a configuration names it as `signing = { key_file = \"FILE\" }`",
        ))
    } else if !agent && has("agent") && has("px4") {
        Some(("the configuration of an agent", "`vsm airside` runs it"))
    } else if agent && has("dli") {
        Some(("the configuration of a bridge", "`vsm run` runs it"))
    } else if has("waypoint") || has("curve") && !has("vehicle") {
        Some(("a route", "`cucs send` uploads it"))
    } else if has("area") {
        Some(("a geofence", "`cucs fence` uploads it"))
    } else if trimmed.starts_with(['{', '<']) || trimmed.starts_with("QGC WPL") {
        Some(("a plan, a route or a track", "`curve-plan send` uploads it"))
    } else if !first.contains(['=', '['])
        && VERBS.contains(&first.split(' ').next().unwrap_or_default())
    {
        Some(("a script of `cucs`", "`cucs script` runs it"))
    } else if lines().all(hex) && !first.is_empty() {
        Some(("datagrams in hex", "`vsm decode` decodes them"))
    } else {
        None
    }
}

/// With which a script may begin.
const VERBS: &[&str] = &[
    "discover",
    "take",
    "vehicle",
    "heartbeats",
    "send",
    "launch",
    "fly",
    "sleep",
    "wait",
    "watch",
];

#[cfg(test)]
mod tests {
    use std::path::Path;

    use super::*;
    use crate::config::Config;

    #[test]
    fn every_key_without_a_default_has_an_example_that_the_parser_takes() {
        fn check(table: &str, keys: &'static [Key]) {
            for key in keys {
                let path = join(table, key.name);
                match key.absent {
                    Table(inner) => check(&path, inner),
                    ValueOrTable(inner) => {
                        assert!(example(&path, key).is_some(), "{path}: add it to EXAMPLES");
                        check(&path, inner);
                    }
                    _ if path.ends_with("disputed.NAME") => {}
                    _ => {
                        let example = example(&path, key);
                        let example =
                            example.unwrap_or_else(|| panic!("{path}: add it to EXAMPLES"));
                        example.parse::<toml::Table>().expect(&path);
                    }
                }
            }
        }
        check("", Config::KEYS);
        for (path, _) in EXAMPLES {
            assert!(
                find(path, Config::KEYS).is_some(),
                "{path} is no key any more"
            );
        }
        let text = |table: &str| {
            let listed = EXAMPLES
                .iter()
                .filter(|(path, _)| path.rsplit_once('.').unwrap().0 == table);
            listed.fold(String::new(), |text, (path, value)| {
                text + path.rsplit_once('.').unwrap().1 + " = " + value + "\n"
            })
        };
        let whole = [
            "[dli]",
            "[[cucs]]",
            "[[vehicle]]",
            "[store]",
            "[http]",
            "[record]",
        ]
        .map(|header| format!("{header}\n{}", text(header.trim_matches(['[', ']']))));
        Config::parse(&whole.concat(), Path::new("")).unwrap();
    }

    #[test]
    fn a_place_is_found_in_inline_tables_and_lists_of_several_lines() {
        let text = "a = 1\n[vehicle.x] # b\nc = { d = 1, e = \"f\" }\nv = [\n  [1, 2],\n  [3, 4],\n]\n[[list]]\n";
        let at = |part: &str| Place::at(text, text.find(part).unwrap());
        assert_eq!((at("1").path().as_str(), at("1").line), ("a", 1));
        assert_eq!(at("\"f\"").path(), "vehicle.x.c.e");
        assert_eq!(
            (at("{").path().as_str(), at("{").value),
            ("vehicle.x.c", "{ d = 1, e = \"f\" }")
        );
        assert_eq!(
            (at("[3").path().as_str(), at("[3").line),
            ("vehicle.x.v", 6)
        );
        assert_eq!(
            (at("[[list").header, at("[[list").table),
            (Some(true), "list")
        );
    }

    #[test]
    fn a_file_of_another_kind_is_recognised() {
        for (text, of) in [
            (
                include_str!("../../../examples/airside.toml"),
                "vsm airside",
            ),
            (
                include_str!("../../../examples/square.route.toml"),
                "cucs send",
            ),
            (
                include_str!("../../../examples/curve.route.toml"),
                "cucs send",
            ),
            (
                include_str!("../../../examples/area.fence.toml"),
                "cucs fence",
            ),
            (include_str!("../../../examples/square.cucs"), "cucs script"),
            ("{\"fileType\": \"Plan\"}", "curve-plan send"),
            ("<?xml version=\"1.0\"?><kml/>", "curve-plan send"),
            ("QGC WPL 110\n", "curve-plan send"),
            ("000000021b000101ffffffff0bb92000020c\n", "vsm decode"),
        ] {
            let (kind, command) = other_kind(text, false).expect(of);
            assert!(command.contains(of), "{kind}: {command}");
        }
        assert!(
            other_kind(&"5a".repeat(32), false).is_some_and(|(kind, _)| kind == "a signing key")
        );
        for good in [
            include_str!("../../../examples/vsm.toml"),
            include_str!("../../../examples/two-vehicles.toml"),
            include_str!("../../../examples/radio.toml"),
            "",
        ] {
            assert_eq!(other_kind(good, false), None);
        }
        let bridge = include_str!("../../../examples/vsm.toml");
        assert!(other_kind(bridge, true).is_some_and(|(_, command)| command.contains("vsm run")));
    }
}
