//! The audit log: every change of control is a line, and each line is bound to all before it by a hash.
//!
//! A line is 64 hex digits, a space and a JSON object. The digits are SHA-256 of the digits of the line before (64
//! zeros before the first), a line feed and the object: a line that is changed, left out, moved or put in breaks the
//! chain there. What has been cut off at the end cannot be seen: keep the last line elsewhere where that matters.
//!
//! A log that has grown to a megabyte is put aside, and the next begins with a line that names the digits of the last
//! line before it: the chain goes on over files, and each can be verified by itself.

use std::fmt;
use std::time::Duration;

use serde::{Deserialize, Serialize};
use sha2::{Digest, Sha256};
use stanag_msgs::Id;

use super::rules::{Change, Rights};

/// Where the log stands: the number and the hash of its last line.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Chain {
    lines: u64,
    last: String,
}

/// What a line says.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Entry {
    /// The VSM has started, with these holders as they were stored.
    Started(Vec<(Id, Rights)>),
    /// Rights changed hands.
    Change(Change),
    /// The change before could not be stored, and does not hold.
    NotKept,
    /// The first line of a log that follows another.
    Continued,
}

/// What a log is found to be.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Verified {
    /// What it follows: the beginning of all, or the last line of the log before.
    pub follows: Chain,
    /// Where to go on.
    pub chain: Chain,
    /// The first line that does not fit.
    pub broken: Option<Broken>,
    /// The last line has no end: a crash cut it off.
    pub torn: bool,
}

/// A line that does not follow from those before it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Broken {
    /// Its number, from 1.
    pub line: u64,
}

impl fmt::Display for Broken {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(
            f,
            "line {} does not follow from the lines before it",
            self.line
        )
    }
}

/// What a first line must tell where its log follows another.
#[derive(Deserialize)]
struct First {
    line: u64,
    after: Option<String>,
}

#[derive(Serialize)]
struct Line<'a> {
    /// From 1.
    line: u64,
    /// ms since 1970.
    time_ms: u64,
    vehicle: String,
    what: &'a str,
    #[serde(skip_serializing_if = "Option::is_none")]
    from: Option<String>,
    #[serde(skip_serializing_if = "Option::is_none")]
    lost: Option<String>,
    #[serde(skip_serializing_if = "Option::is_none")]
    to: Option<String>,
    #[serde(skip_serializing_if = "Option::is_none")]
    gained: Option<String>,
    #[serde(skip_serializing_if = "Option::is_none")]
    why: Option<String>,
    #[serde(skip_serializing_if = "Option::is_none")]
    holders: Option<Vec<(String, String)>>,
    /// The digits of the last line of the log before.
    #[serde(skip_serializing_if = "Option::is_none")]
    after: Option<&'a str>,
}

impl Default for Chain {
    fn default() -> Chain {
        Chain {
            lines: 0,
            last: "0".repeat(HASH_DIGITS),
        }
    }
}

impl Chain {
    /// How many lines there are.
    #[must_use]
    pub fn lines(&self) -> u64 {
        self.lines
    }

    /// The chain with one line more, and that line with its line feed.
    #[must_use]
    pub fn extended(&self, wall: Duration, vehicle: Id, entry: &Entry) -> (Chain, String) {
        let mut line = Line {
            line: self.lines + 1,
            time_ms: u64::try_from(wall.as_millis()).unwrap_or(u64::MAX),
            vehicle: vehicle.to_string(),
            what: "",
            from: None,
            lost: None,
            to: None,
            gained: None,
            why: None,
            holders: None,
            after: None,
        };
        match entry {
            Entry::Started(holders) => {
                line.what = "started";
                let named = |(id, rights): &(Id, Rights)| (id.to_string(), rights.to_string());
                line.holders = Some(holders.iter().map(named).collect());
            }
            Entry::Change(change) => {
                let some = |rights: Rights| (!rights.is_empty()).then(|| rights.to_string());
                line.what = "change";
                line.from = change.from.map(|id| id.to_string());
                line.lost = some(change.lost);
                line.to = change.to.map(|id| id.to_string());
                line.gained = some(change.gained);
                line.why = Some(change.why.to_string());
            }
            Entry::NotKept => line.what = "not kept",
            Entry::Continued => {
                line.what = "continued";
                line.after = Some(&self.last);
            }
        }
        // Text and numbers alone: this cannot fail.
        let object = serde_json::to_string(&line).unwrap_or_default();
        let last = hash(&self.last, &object);
        let text = format!("{last} {object}\n");
        let lines = self.lines + 1;
        (Chain { lines, last }, text)
    }

    /// Checks a log from its first line on.
    #[must_use]
    pub fn verify(bytes: &[u8]) -> Verified {
        let follows = Chain::before(bytes);
        let mut chain = follows.clone();
        let mut broken = None;
        let torn = bytes.last().is_some_and(|byte| *byte != b'\n');
        let mut lines: Vec<&[u8]> = bytes.split(|byte| *byte == b'\n').collect();
        // After the last line feed there is nothing, or what a crash has cut off: no line yet.
        lines.pop();
        for bytes in lines {
            let fits = std::str::from_utf8(bytes)
                .ok()
                .and_then(|line| line.split_once(' '))
                .filter(|(digits, object)| hash(&chain.last, object) == *digits);
            match fits {
                Some((digits, _)) => digits.clone_into(&mut chain.last),
                // What a crash has cut off was closed by the next start, and is no line of the chain.
                None if is_torn(bytes) => continue,
                // Counted as a line all the same: the log continues with the number after it.
                None => {
                    broken = broken.or(Some(Broken {
                        line: chain.lines + 1,
                    }));
                    // It goes on from what it finds: one break is one break.
                    let digits = bytes.get(..HASH_DIGITS).map(String::from_utf8_lossy);
                    if let Some(digits) = digits {
                        chain.last = digits.into_owned();
                    }
                }
            }
            chain.lines += 1;
        }
        Verified {
            follows,
            chain,
            broken,
            torn,
        }
    }
}

impl Chain {
    /// What the first line of a log says that it follows.
    fn before(bytes: &[u8]) -> Chain {
        let first = bytes.split(|byte| *byte == b'\n').next();
        let first = first
            .and_then(|line| line.get(HASH_DIGITS + 1..))
            .and_then(|object| serde_json::from_slice::<First>(object).ok());
        match first {
            Some(First {
                line,
                after: Some(last),
            }) => Chain {
                lines: line.saturating_sub(1),
                last,
            },
            _ => Chain::default(),
        }
    }
}

/// A beginning of a line: it has no closing brace.
fn is_torn(bytes: &[u8]) -> bool {
    bytes.last() != Some(&b'}')
}

fn hash(before: &str, object: &str) -> String {
    let mut sum = Sha256::new();
    sum.update(before.as_bytes());
    sum.update(b"\n");
    sum.update(object.as_bytes());
    let digest = sum.finalize();
    digest.iter().map(|byte| format!("{byte:02x}")).collect()
}

const HASH_DIGITS: usize = 64;

#[cfg(test)]
mod tests {
    use super::*;

    fn log(lines: usize) -> String {
        let mut chain = Chain::default();
        let mut text = String::new();
        for n in 0..lines {
            let wall = Duration::from_secs(n as u64);
            let (next, line) = chain.extended(wall, Id(0x1b00_0101), &Entry::NotKept);
            chain = next;
            text += &line;
        }
        text
    }

    #[test]
    fn a_log_goes_on_where_it_stopped() {
        let verified = Chain::verify(log(3).as_bytes());
        assert_eq!(
            (verified.chain.lines(), verified.broken, verified.torn),
            (3, None, false)
        );
        let wall = Duration::from_secs(3);
        let (_, line) = verified
            .chain
            .extended(wall, Id(0x1b00_0101), &Entry::NotKept);
        assert_eq!(log(4), log(3) + &line);
    }

    #[test]
    fn a_changed_line_breaks_the_chain_there() {
        let text = log(4).replacen("\"time_ms\":2000", "\"time_ms\":2001", 1);
        let broken = Chain::verify(text.as_bytes()).broken;
        assert_eq!(broken, Some(Broken { line: 3 }));
    }

    #[test]
    fn a_line_left_out_moved_or_doubled_breaks_the_chain() {
        let text = log(4);
        let lines: Vec<&str> = text.lines().collect();
        for order in [
            vec![0, 2, 3],
            vec![0, 2, 1, 3],
            vec![0, 1, 1, 2, 3],
            vec![1, 2, 3],
        ] {
            let other: String = order.iter().map(|n| format!("{}\n", lines[*n])).collect();
            assert!(
                Chain::verify(other.as_bytes()).broken.is_some(),
                "{order:?}"
            );
        }
    }

    #[test]
    fn a_line_that_a_crash_cut_off_is_no_break() {
        let whole = log(3);
        let cut = &whole[..whole.len() - 20];
        let verified = Chain::verify(cut.as_bytes());
        assert_eq!(
            (verified.chain.lines(), verified.broken, verified.torn),
            (2, None, true)
        );
        let (_, line) = verified
            .chain
            .extended(Duration::ZERO, Id(1), &Entry::NotKept);
        let healed = format!("{cut}\n{line}");
        let verified = Chain::verify(healed.as_bytes());
        assert_eq!(
            (verified.chain.lines(), verified.broken, verified.torn),
            (3, None, false)
        );
    }

    #[test]
    fn a_log_that_follows_another_is_verified_by_itself_and_after_it() {
        let before = Chain::verify(log(3).as_bytes()).chain;
        let vehicle = Id(0x1b00_0101);
        let (chain, first) = before.extended(Duration::ZERO, vehicle, &Entry::Continued);
        let (chain, second) = chain.extended(Duration::ZERO, vehicle, &Entry::NotKept);
        let text = first + &second;
        let verified = Chain::verify(text.as_bytes());
        assert_eq!((verified.broken, &verified.chain), (None, &chain));
        assert_eq!((verified.follows, chain.lines()), (before, 5));
        let forged = text.replacen("\"line\":4", "\"line\":6", 1);
        assert!(Chain::verify(forged.as_bytes()).broken.is_some());
    }
}
