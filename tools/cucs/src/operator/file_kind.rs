//! A file for the wrong subcommand: what it is, and the command that reads it.
//!
//! Checked before a file is parsed, since "unknown field `dli`" helps nobody who gave a configuration for a route.
//! Nothing in the file is quoted, because it may be a key.

use std::path::Path;

use super::error::OperatorError;

/// The subcommands that read a file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Reader {
    Send,
    Fence,
    Script,
}

/// Refuses a file that is certainly meant for another command. A file that is not recognised is left to the parser.
///
/// # Errors
/// It is of another kind.
pub(crate) fn check(path: &Path, reader: Reader) -> Result<(), OperatorError> {
    // A file that cannot be read is reported by the parser.
    let text = std::fs::read_to_string(path).unwrap_or_default();
    match kind(&text) {
        Some((kind, command, taken_by)) if taken_by != Some(reader) => {
            Err(OperatorError::OtherKind {
                path: path.to_owned(),
                kind,
                command,
            })
        }
        _ => Ok(()),
    }
}

/// What the file is, the command that reads it, and the subcommand of `cucs` where it is one.
fn kind(text: &str) -> Option<(&'static str, &'static str, Option<Reader>)> {
    let text = text.trim();
    let has = |header: &str| {
        text.lines()
            .any(|line| line.trim_start().starts_with(header))
    };
    if text.len() == 64 && text.bytes().all(|byte| byte.is_ascii_hexdigit()) {
        Some(("a signing key", "no command sends it", None))
    } else if has("[dli]") || has("[[vehicle]]") {
        Some(("the configuration of a bridge", "`vsm run` runs it", None))
    } else if has("[agent]") {
        let command = "`vsm airside` runs it";
        Some(("the configuration of an agent", command, None))
    } else if has("[[waypoint]]") {
        let command = "`cucs send` uploads it";
        Some(("a route", command, Some(Reader::Send)))
    } else if has("[[area]]") {
        let command = "`cucs fence` uploads it";
        Some(("a geofence", command, Some(Reader::Fence)))
    } else {
        None
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_file_for_another_command_is_named_with_it() {
        let folder = concat!(env!("CARGO_MANIFEST_DIR"), "/../../examples/");
        for (name, reader, expected) in [
            ("vsm.toml", Reader::Send, Some("`vsm run`")),
            ("airside.toml", Reader::Send, Some("`vsm airside`")),
            ("area.fence.toml", Reader::Send, Some("`cucs fence`")),
            ("square.route.toml", Reader::Fence, Some("`cucs send`")),
            ("square.route.toml", Reader::Script, Some("`cucs send`")),
            ("square.route.toml", Reader::Send, None),
            ("curve.route.toml", Reader::Send, None),
            ("area.fence.toml", Reader::Fence, None),
            ("square.cucs", Reader::Script, None),
            ("no-such-file", Reader::Send, None),
        ] {
            let checked = check(&Path::new(folder).join(name), reader);
            let error = checked
                .err()
                .map(|fault| (fault.exit_status(), fault.to_string()));
            match (expected, error) {
                (None, None) => {}
                (Some(part), Some((2, error))) => assert!(error.contains(part), "{name}: {error}"),
                (expected, error) => panic!("{name}: {error:?}, expected {expected:?}"),
            }
        }
        let key = "5a".repeat(32);
        assert_eq!(kind(&key).map(|(kind, _, _)| kind), Some("a signing key"));
    }
}
