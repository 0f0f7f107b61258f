//! The few forms of Lua that a table is written in.

use std::fmt::Write;

/// A Lua string.
pub(super) fn quoted(text: &str) -> String {
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
pub(super) fn entry(table: &mut String, name: &str, value: &str) {
    if !table.ends_with("{ ") {
        table.push_str(", ");
    }
    // Writing to a String cannot fail.
    let _ = write!(table, "{name} = {value}");
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_text_cannot_end_its_string() {
        assert_eq!(quoted("a \"b\" \\"), "\"a \\\"b\\\" \\\\\"");
    }

    #[test]
    fn entries_are_parted_by_commas() {
        let mut table = String::from("{ ");
        entry(&mut table, "a", "1");
        entry(&mut table, "b", &quoted("x"));
        assert_eq!(table, "{ a = 1, b = \"x\"");
    }
}
