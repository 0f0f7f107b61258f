//! The line that a field of a JSON text stands on.

use std::borrow::Cow;
use std::collections::HashMap;
use std::path::Path;

use serde_json::Value;
use serde_json::value::RawValue;

use super::fault::FormatError;

/// The document in a file.
pub(super) fn document(file: &Path, text: &str) -> Result<Value, FormatError> {
    serde_json::from_str(text).map_err(|e| FormatError::at(file, Some(e.line() as u64), "", e))
}

/// What is wrong with the value at a path, and on which line.
pub(super) fn fault(file: &Path, text: &str, path: &str, problem: impl ToString) -> FormatError {
    FormatError::at(file, line_of(text, path), path, problem)
}

/// The line, from 1, of the value at a path such as `mission.items[3].frame`; of the innermost value around it that is
/// there, where it is missing itself. `None` for what is no JSON.
pub(super) fn line_of(text: &str, path: &str) -> Option<u64> {
    let mut value: &RawValue = serde_json::from_str(text).ok()?;
    let steps = path.split(['.', '[', ']']).filter(|step| !step.is_empty());
    for step in steps {
        let raw = value.get();
        let inner = match step.parse::<usize>() {
            Ok(index) => serde_json::from_str::<Vec<&RawValue>>(raw)
                .ok()
                .and_then(|list| list.get(index).copied()),
            Err(_) => serde_json::from_str::<HashMap<Cow<'_, str>, &RawValue>>(raw)
                .ok()
                .and_then(|object| object.get(step).copied()),
        };
        let Some(inner) = inner else { break };
        value = inner;
    }
    let before = (value.get().as_ptr() as usize).checked_sub(text.as_ptr() as usize)?;
    Some(1 + text.get(..before)?.matches('\n').count() as u64)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_value_is_found_and_a_missing_one_by_what_is_around_it() {
        let text = "{\n \"a\": [\n  {\"b\": 1},\n  {\"c\":\n   2}\n ]\n}";
        assert_eq!(line_of(text, "a"), Some(2));
        assert_eq!(line_of(text, "a[0].b"), Some(3));
        assert_eq!(line_of(text, "a[1].c"), Some(5));
        assert_eq!(line_of(text, "a[1].x"), Some(4));
        assert_eq!(line_of(text, ".a[7]"), Some(2));
        assert_eq!(line_of("{", "a"), None);
    }
}
