//! The lines that the fields of a JSON text stand on.

use std::borrow::Cow;
use std::collections::HashMap;
use std::path::Path;

use serde_json::Value;
use serde_json::value::RawValue;

use super::fault::FormatError;

/// A document, and where in its text each value begins.
///
/// Looked up once for the whole text: to look for each value from the beginning takes minutes for a file of ten thousand points.
pub(super) struct Document<'a> {
    file: &'a Path,
    pub(super) value: Value,
    lines: Lines,
}

impl<'a> Document<'a> {
    /// Reads a text.
    pub(super) fn read(file: &'a Path, text: &str) -> Result<Self, FormatError> {
        let fault = |e: serde_json::Error| FormatError::at(file, Some(e.line() as u64), "", e);
        // First, because it refuses what is nested too deep for the stack.
        let value = serde_json::from_str(text).map_err(fault)?;
        let whole: &RawValue = serde_json::from_str(text).map_err(fault)?;
        let mut counted = Counted {
            text,
            offset: 0,
            line: 1,
        };
        let lines = counted.lines_of(whole).map_err(fault)?;
        Ok(Self { file, value, lines })
    }

    /// What is wrong with the value at a path, and on which line.
    pub(super) fn fault(&self, path: &str, problem: impl ToString) -> FormatError {
        FormatError::at(self.file, Some(self.line_of(path)), path, problem)
    }

    /// The line, from 1, of the value at a path such as `mission.items[3].frame`; of the innermost value around it that is there,
    /// where it is missing itself. A list of numbers on one line is found as a whole.
    pub(super) fn line_of(&self, path: &str) -> u64 {
        let mut at = &self.lines;
        for step in path.split(['.', '[', ']']).filter(|step| !step.is_empty()) {
            let inner = match step.parse::<usize>() {
                Ok(index) => at.elements.get(index),
                Err(_) => {
                    (at.members.iter()).find_map(|(name, lines)| (name == step).then_some(lines))
                }
            };
            let Some(inner) = inner else { break };
            at = inner;
        }
        at.line
    }
}

/// The line of a value, and of those within it.
struct Lines {
    line: u64,
    members: Vec<(String, Lines)>,
    elements: Vec<Lines>,
}

/// How far the lines of a text are counted.
struct Counted<'a> {
    text: &'a str,
    offset: usize,
    line: u64,
}

impl Counted<'_> {
    fn lines_of(&mut self, raw: &RawValue) -> Result<Lines, serde_json::Error> {
        let mut lines = Lines {
            line: self.line_at(raw),
            members: Vec::new(),
            elements: Vec::new(),
        };
        let text = raw.get();
        if text.starts_with('{') {
            let members: HashMap<Cow<'_, str>, &RawValue> = serde_json::from_str(text)?;
            let mut members: Vec<_> = members.into_iter().collect();
            // As they stand, for each line is counted once.
            members.sort_unstable_by_key(|(_, value)| value.get().as_ptr());
            for (name, value) in members {
                lines
                    .members
                    .push((name.into_owned(), self.lines_of(value)?));
            }
        } else if text.starts_with('[') && text.contains(['\n', '[', '{']) {
            let elements: Vec<&RawValue> = serde_json::from_str(text)?;
            for value in elements {
                lines.elements.push(self.lines_of(value)?);
            }
        }
        Ok(lines)
    }

    fn line_at(&mut self, raw: &RawValue) -> u64 {
        let offset = raw
            .get()
            .as_ptr()
            .addr()
            .saturating_sub(self.text.as_ptr().addr());
        if let Some(passed) = self.text.get(self.offset..offset) {
            self.line += passed.matches('\n').count() as u64;
            self.offset = offset;
        }
        self.line
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_value_is_found_and_a_missing_one_by_what_is_around_it() {
        let text = "{\n \"a\": [\n  {\"b\": 1},\n  {\"c\":\n   2}\n ],\n \"d\": [1, 2],\n \"e\": [1,\n  2]\n}";
        let document = Document::read(Path::new("a.json"), text).expect("it is JSON");
        for (path, line) in [
            ("a", 2),
            ("a[0].b", 3),
            ("a[1].c", 5),
            ("a[1].x", 4),
            (".a[7]", 2),
            ("d[1]", 7),
            ("e[1]", 9),
            ("x", 1),
        ] {
            assert_eq!(document.line_of(path), line, "{path}");
        }
    }
}
