//! Scripts: one subcommand of `cucs` on each line; `#` starts a comment.
//!
//! A script is parsed as a whole before anything is sent, so that a typing error in a later line does not end it in
//! the middle of a flight.

use std::path::{Path, PathBuf};

use clap::Parser;

use super::verb::Verb;

/// A line of a script.
#[derive(Clone, Debug)]
pub struct Line {
    /// Its number, from 1.
    pub number: usize,
    /// Its text.
    pub text: String,
    /// The subcommand.
    pub verb: Verb,
}

/// Why a script cannot be run.
#[derive(Debug, thiserror::Error)]
pub enum ScriptError {
    /// It cannot be read.
    #[error("{}: {source}", path.display())]
    Read {
        /// The file.
        path: PathBuf,
        /// The system's error.
        source: std::io::Error,
    },
    /// A line that is not a subcommand.
    #[error("{}:{line}: {message}", path.display())]
    Line {
        /// The file.
        path: PathBuf,
        /// The line, from 1.
        line: usize,
        /// What is wrong with it.
        message: String,
    },
}

impl Line {
    /// Reads a script, all of it before any of it is carried out.
    ///
    /// # Errors
    /// It cannot be read, or a line is not a subcommand.
    pub fn load(path: &Path) -> Result<Vec<Line>, ScriptError> {
        let text = std::fs::read_to_string(path).map_err(|source| ScriptError::Read {
            path: path.to_owned(),
            source,
        })?;
        Line::parse(path, &text)
    }

    /// Reads the text of a script; `path` is only for messages.
    ///
    /// # Errors
    /// A line is not a subcommand.
    pub fn parse(path: &Path, text: &str) -> Result<Vec<Line>, ScriptError> {
        let mut lines = Vec::new();
        for (text, number) in text.lines().zip(1..) {
            let verb = parse_line(text).map_err(|message| ScriptError::Line {
                path: path.to_owned(),
                line: number,
                message,
            })?;
            if let Some(verb) = verb {
                let text = text.trim().to_owned();
                lines.push(Line { number, text, verb });
            }
        }
        Ok(lines)
    }
}

/// The subcommand of one line; `None` where it is empty or a comment.
///
/// # Errors
/// It is not a subcommand: the message names what was expected.
pub fn parse_line(line: &str) -> Result<Option<Verb>, String> {
    let words = words(line)?;
    if words.is_empty() {
        return Ok(None);
    }
    match Words::try_parse_from(words) {
        Ok(words) => Ok(Some(words.verb)),
        Err(fault) => Err(message(&fault)),
    }
}

#[derive(Debug, Parser)]
#[command(multicall = true, disable_help_flag = true)]
struct Words {
    #[command(subcommand)]
    verb: Verb,
}

/// The first paragraph of clap's message, on one line; the whole message where help was requested.
fn message(fault: &clap::Error) -> String {
    let text = fault.render().to_string();
    if fault.kind() == clap::error::ErrorKind::DisplayHelp {
        return text;
    }
    let paragraph = text.split("\n\n").next().unwrap_or_default();
    let flat: Vec<&str> = paragraph.lines().map(str::trim).collect();
    flat.join(" ").trim_start_matches("error: ").to_owned()
}

/// Words with spaces between them; "quotes" keep spaces together; # ends the line.
fn words(line: &str) -> Result<Vec<String>, String> {
    let mut words = Vec::new();
    let mut word: Option<String> = None;
    let mut quoted = false;
    for character in line.chars() {
        match character {
            '"' => {
                quoted = !quoted;
                word.get_or_insert_default();
            }
            '#' if !quoted && word.is_none() => break,
            space if space.is_whitespace() && !quoted => words.extend(word.take()),
            other => word.get_or_insert_default().push(other),
        }
    }
    if quoted {
        return Err("missing closing quote".to_owned());
    }
    words.extend(word);
    Ok(words)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::operator::verb::Condition;

    #[test]
    fn lines_are_the_subcommands() {
        for (line, expected) in [
            ("launch 30", "Launch"),
            ("  land  # here", "Land"),
            ("take --loi 2,4,5 --override", "Take"),
            ("send \"a file.toml\" --mission-id M1", "Send"),
            ("mode 12 --altitude 40 --position -33.9,18.4", "Mode"),
            ("wait waypoint 3 --within 20", "Wait"),
        ] {
            let verb = parse_line(line).unwrap().unwrap();
            assert!(
                format!("{verb:?}").starts_with(expected),
                "{line}: {verb:?}"
            );
        }
        assert!(parse_line("").unwrap().is_none());
        assert!(parse_line("  # nothing").unwrap().is_none());
        let wait = parse_line("wait alert \"no route\"").unwrap();
        assert!(matches!(
            wait,
            Some(Verb::Wait { condition: Condition::Alert { text }, within }) if text == "no route" && within == 120.0
        ));
    }

    #[test]
    fn a_bad_line_is_reported_with_its_number_before_anything_is_done() {
        let text = "discover\n\nlunch 30\n";
        let fault = Line::parse(Path::new("a.cucs"), text)
            .unwrap_err()
            .to_string();
        assert!(fault.starts_with("a.cucs:3: "), "{fault}");
        assert!(fault.contains("lunch"), "{fault}");
        for bad in [
            "launch",
            "launch high",
            "take --loi 6",
            "wait mode",
            "say \"x",
        ] {
            assert!(parse_line(bad).is_err(), "{bad}");
        }
    }
}
