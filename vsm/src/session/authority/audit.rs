//! The audit log: every change of control is one line, and a keyed hash chains each line to all lines before it.
//!
//! A line is 64 hex digits, a space and a JSON object. The digits are HMAC-SHA256, by the key of this installation
//! ([`AuditKey`]), of the digits of the previous line (64 zeros before the first), a line feed and the object. A line that
//! is changed, removed, moved or inserted breaks the chain there, and nobody without the key can rewrite it. The authority
//! record holds the end of the log ([`trail`](super::trail)).
//!
//! Logs of earlier versions use plain SHA-256 instead. A line `keyed`, which names the key, continues them: lines before it
//! are verified with SHA-256, lines after it must use the key.
//!
//! A log that has grown to a megabyte is rotated. The next one begins with a line that names the digits of the last line
//! before it: the chain continues over files, and each file can be verified separately.

use std::fmt;
use std::time::Duration;

use data_encoding::HEXLOWER;
use hmac::{Hmac, KeyInit as _, Mac as _};
use mavlink_link::exchange::Random;
use mavlink_link::store::{Disk, Durability, StoreError};
use serde::{Deserialize, Serialize};
use sha2::{Digest, Sha256};
use stanag_msgs::Id;
use zeroize::Zeroizing;

use super::rules::{Change, Rights};
use crate::session::dates::utc;

/// The key of the installation's audit logs: `audit.key` in the store's folder.
pub struct AuditKey(Zeroizing<[u8; 32]>);

impl fmt::Debug for AuditKey {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "AuditKey({})", self.id())
    }
}

impl AuditKey {
    /// The key with these bytes.
    #[must_use]
    pub fn new(bytes: [u8; 32]) -> AuditKey {
        AuditKey(Zeroizing::new(bytes))
    }

    /// Loads the key from a disk; `None` if none was created yet.
    ///
    /// # Errors
    /// It exists but cannot be read, or is not a key.
    pub fn load(disk: &dyn Disk) -> Result<Option<AuditKey>, StoreError> {
        let Some(text) = disk.read(AUDIT_KEY, MAX_KEY_BYTES)? else {
            return Ok(None);
        };
        let text = std::str::from_utf8(&text).unwrap_or_default().trim_end();
        let mut key = Zeroizing::new([0; 32]);
        let mut digits = text.as_bytes().chunks_exact(2);
        for byte in key.iter_mut() {
            let two = digits
                .next()
                .and_then(|two| std::str::from_utf8(two).ok())
                .and_then(|two| u8::from_str_radix(two, 16).ok());
            *byte = two.ok_or_else(|| StoreError::new(AUDIT_KEY, "expected 64 hex digits"))?;
        }
        Ok(Some(AuditKey(key)))
    }

    /// Loads the key from a disk, and creates it at the first start.
    ///
    /// # Errors
    /// As [`AuditKey::load`], or it cannot be created: no random bytes, or the disk does not store it.
    pub fn load_or_make(
        disk: &mut dyn Disk,
        random: &mut dyn Random,
    ) -> Result<AuditKey, StoreError> {
        // A key that cannot be read is not replaced: with another key the existing logs could no longer be verified.
        if let Some(key) = AuditKey::load(disk)? {
            return Ok(key);
        }
        let mut key = Zeroizing::new([0; 32]);
        random
            .fill(&mut *key)
            .map_err(|_| StoreError::new(AUDIT_KEY, "no random bytes"))?;
        let text = Zeroizing::new(HEXLOWER.encode(&*key) + "\n");
        disk.replace(AUDIT_KEY, text.as_bytes(), Durability::Power)?;
        Ok(AuditKey(key))
    }

    /// Its public name: the first 8 bytes of its HMAC of "vsm/1 audit key id".
    #[must_use]
    pub fn id(&self) -> String {
        self.mac(&["vsm/1 audit key id"])[..16].to_owned()
    }

    /// HMAC-SHA256 of texts separated by line feeds, in hex.
    pub(super) fn mac(&self, texts: &[&str]) -> String {
        // An HMAC takes a key of any length.
        let Ok(mut mac) = Hmac::<Sha256>::new_from_slice(&*self.0) else {
            return String::new();
        };
        for (n, text) in texts.iter().enumerate() {
            if n > 0 {
                mac.update(b"\n");
            }
            mac.update(text.as_bytes());
        }
        HEXLOWER.encode(&mac.finalize().into_bytes())
    }
}

/// The end of a log: the number and the hash of its last line.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Chain {
    lines: u64,
    last: String,
    /// The id of the key of its lines; `None` in logs of earlier versions.
    keyed: Option<String>,
}

/// The event that a line records.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Entry {
    /// The VSM has started, with these holders of rights as stored.
    Started(Vec<(Id, Rights)>),
    /// Rights changed hands.
    Change(Change),
    /// The changes of the previous decision could not be stored and are not in effect.
    NotKept,
    /// The first line of a log that follows another.
    Continued,
    /// From this line on the chain uses a key.
    Keyed,
    /// A start found this fault in the logs: without this line the next start would find them intact.
    Fault(String),
    /// The outcome of a flight termination.
    Termination {
        /// In two or three words.
        what: &'static str,
        /// The CUCS that ordered it.
        by: Option<Id>,
        /// Description.
        why: String,
    },
    /// How often a station has gained and lost rights that command no aircraft, since the previous line about it.
    Repeated {
        /// The station.
        station: Id,
        /// How often it gained some.
        gained: u32,
        /// How often it lost some.
        lost: u32,
    },
    /// Lines that were only counted, since the disk took none for too long. This line has the time of the first of them.
    NotWritten {
        /// How many.
        lines: u64,
        /// The time of the last of them, since 1970.
        until: Duration,
    },
}

/// The result of examining a log.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Verified {
    /// What it follows: the beginning of the chain, or the last line of the previous log.
    pub follows: Chain,
    /// Where to continue.
    pub chain: Chain,
    /// The first line that breaks the chain.
    pub broken: Option<Broken>,
    /// Whether the last line is incomplete: a crash cut it off.
    pub torn: bool,
    /// The id of the first key that is not available: lines with it were not verified.
    pub other_key: Option<String>,
    /// What its own lines report: faults that earlier starts have found, and lines that were not written. Line number and text.
    pub reported: Vec<(u64, String)>,
    /// The digits of each of its lines, in their order; of one that breaks the chain those that it claims.
    pub digits: Vec<String>,
}

/// A line that breaks the chain.
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

/// What the first line of a log names if the log follows another.
#[derive(Deserialize)]
struct First {
    line: u64,
    what: String,
    after: Option<String>,
    key: Option<String>,
    why: Option<String>,
}

/// What a line names that stands for lines that were not written.
#[derive(Deserialize)]
struct Counted {
    time_ms: u64,
    until_ms: u64,
    not_written: u64,
}

impl fmt::Display for Counted {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let time = |ms: u64| utc(ms / 1_000);
        write!(
            f,
            "not written: {} lines, from {} to {}: the disk took none",
            self.not_written,
            time(self.time_ms),
            time(self.until_ms)
        )
    }
}

#[derive(Default, Serialize)]
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
    /// The id of the key of this line and those after it.
    #[serde(skip_serializing_if = "Option::is_none")]
    key: Option<&'a str>,
    #[serde(skip_serializing_if = "Option::is_none")]
    times_gained: Option<u32>,
    #[serde(skip_serializing_if = "Option::is_none")]
    times_lost: Option<u32>,
    /// How many lines this one stands for, from `time_ms` to `until_ms`.
    #[serde(skip_serializing_if = "Option::is_none")]
    not_written: Option<u64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    until_ms: Option<u64>,
}

impl Default for Chain {
    fn default() -> Chain {
        Chain {
            lines: 0,
            last: "0".repeat(HASH_DIGITS),
            keyed: None,
        }
    }
}

impl Chain {
    /// Number of lines.
    #[must_use]
    pub fn lines(&self) -> u64 {
        self.lines
    }

    /// The digits of the last line.
    #[must_use]
    pub fn digits(&self) -> &str {
        &self.last
    }

    /// The id of its key.
    #[must_use]
    pub fn keyed(&self) -> Option<&str> {
        self.keyed.as_deref()
    }

    /// The end that a record has of a log: the number of its last line, and its digits.
    pub(super) fn at(lines: u64, digits: &str, key: &AuditKey) -> Chain {
        Chain {
            lines,
            last: digits.to_owned(),
            keyed: Some(key.id()),
        }
    }

    /// Adds a line to the chain, and returns the new end and the line with its line feed. With `key` the line uses it; the
    /// first such line after an unkeyed chain must be [`Entry::Keyed`].
    #[must_use]
    pub fn extended(
        &self,
        key: Option<&AuditKey>,
        wall: Duration,
        vehicle: Id,
        entry: &Entry,
    ) -> (Chain, String) {
        let id = key.map(AuditKey::id);
        let mut line = Line {
            line: self.lines + 1,
            time_ms: milliseconds(wall),
            vehicle: vehicle.to_string(),
            ..Line::default()
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
                line.key = id.as_deref();
            }
            Entry::Keyed => {
                line.what = KEYED;
                line.key = id.as_deref();
            }
            Entry::Fault(why) => {
                line.what = FAULT;
                line.why = Some(why.clone());
            }
            Entry::Termination { what, by, why } => {
                line.what = what;
                line.from = by.map(|id| id.to_string());
                line.why = Some(why.clone());
            }
            Entry::Repeated {
                station,
                gained,
                lost,
            } => {
                line.what = "repeated";
                line.to = Some(station.to_string());
                line.times_gained = Some(*gained);
                line.times_lost = Some(*lost);
            }
            Entry::NotWritten { lines, until } => {
                line.what = NOT_WRITTEN;
                line.not_written = Some(*lines);
                line.until_ms = Some(milliseconds(*until));
            }
        }
        // Only text and numbers: this cannot fail.
        let object = serde_json::to_string(&line).unwrap_or_default();
        let last = hash(key, &self.last, &object);
        let text = format!("{last} {object}\n");
        let chain = Chain {
            lines: self.lines + 1,
            last,
            keyed: id,
        };
        (chain, text)
    }

    /// Verifies a log from its first line on.
    #[must_use]
    pub fn verify(bytes: &[u8], key: Option<&AuditKey>) -> Verified {
        let own = key.map(AuditKey::id);
        let follows = Chain::before(bytes);
        let mut chain = follows.clone();
        let (mut broken, mut other_key) = (None, None);
        let (mut reported, mut digits_of_lines) = (Vec::new(), Vec::new());
        let torn = bytes.last().is_some_and(|byte| *byte != b'\n');
        let mut lines = bytes.split(|byte| *byte == b'\n').peekable();
        while let Some(bytes) = lines.next() {
            // After the last line feed there is nothing, or what a crash left: a part of a line, or all of it but its line feed. The
            // next start closes it, so that one that is whole is a line then, which later ones follow.
            let is_unclosed = lines.peek().is_none();
            let line = std::str::from_utf8(bytes)
                .ok()
                .and_then(|line| line.split_once(' '));
            // No other line can contain these bytes: quotes within texts are escaped.
            if let Some((_, object)) = line
                && object.contains(KEYED_LINE)
                && let Ok(First { what, key, .. }) = serde_json::from_str(object)
                && what == KEYED
            {
                chain.keyed = key.or(Some(String::new()));
            }
            let unknown = chain.keyed.is_some() && chain.keyed != own;
            if unknown && other_key.is_none() && !is_torn(bytes) {
                other_key.clone_from(&chain.keyed);
            }
            let key = key.filter(|_| chain.keyed.is_some());
            let fits = line
                .filter(|(digits, object)| unknown || hash(key, &chain.last, object) == *digits);
            match fits {
                Some((digits, object)) => {
                    digits.clone_into(&mut chain.last);
                    reported.extend(report_of(object).map(|text| (chain.lines + 1, text)));
                }
                // A line that a crash cut off was closed by the next start; it is not part of the chain.
                None if is_unclosed || is_torn(bytes) => continue,
                // It still counts as a line: the log continues with the next number.
                None => {
                    broken = broken.or(Some(Broken {
                        line: chain.lines + 1,
                    }));
                    // Continue from this line, so that one break is reported once.
                    let digits = bytes.get(..HASH_DIGITS).map(String::from_utf8_lossy);
                    if let Some(digits) = digits {
                        chain.last = digits.into_owned();
                    }
                }
            }
            chain.lines += 1;
            digits_of_lines.push(chain.last.clone());
        }
        Verified {
            follows,
            chain,
            broken,
            torn,
            other_key,
            reported,
            digits: digits_of_lines,
        }
    }
}

impl Chain {
    /// What the first line of a log claims to follow. What a crash has cut off is not part of the chain, and claims nothing.
    fn before(bytes: &[u8]) -> Chain {
        let mut lines = bytes.split(|byte| *byte == b'\n');
        let first = lines.find(|line| !is_torn(line));
        let first = first
            .and_then(|line| line.get(HASH_DIGITS + 1..))
            .and_then(|object| serde_json::from_slice::<First>(object).ok());
        match first {
            // The number is the file's own claim: counting on from a forged one must not overflow.
            Some(First {
                line,
                after: Some(last),
                key,
                ..
            }) if line <= MAX_LINE => Chain {
                lines: line.saturating_sub(1),
                last,
                keyed: key,
            },
            _ => Chain::default(),
        }
    }
}

/// What a line reports that is wrong with the log or missing from it.
fn report_of(object: &str) -> Option<String> {
    // No other line can contain these bytes: quotes within texts are escaped.
    if object.contains(FAULT_LINE) {
        let First { why, .. } = serde_json::from_str(object).ok()?;
        return Some(format!("a start of the VSM found: {}", why?));
    }
    if object.contains(NOT_WRITTEN_LINE) {
        let counted: Counted = serde_json::from_str(object).ok()?;
        return Some(counted.to_string());
    }
    None
}

fn milliseconds(since_1970: Duration) -> u64 {
    u64::try_from(since_1970.as_millis()).unwrap_or(u64::MAX)
}

/// The beginning of a line, without a closing brace.
fn is_torn(bytes: &[u8]) -> bool {
    bytes.last() != Some(&b'}')
}

fn hash(key: Option<&AuditKey>, before: &str, object: &str) -> String {
    if let Some(key) = key {
        return key.mac(&[before, object]);
    }
    let mut sum = Sha256::new();
    sum.update(before.as_bytes());
    sum.update(b"\n");
    sum.update(object.as_bytes());
    HEXLOWER.encode(&sum.finalize())
}

const FAULT: &str = "fault";
const FAULT_LINE: &str = "\"what\":\"fault\"";
const NOT_WRITTEN: &str = "not written";
const NOT_WRITTEN_LINE: &str = "\"what\":\"not written\"";
const KEYED: &str = "keyed";
const KEYED_LINE: &str = "\"what\":\"keyed\"";
pub(crate) const AUDIT_KEY: &str = "audit.key";
/// The key is 64 digits; no more than this is read.
const MAX_KEY_BYTES: u64 = 256;
const HASH_DIGITS: usize = 64;
/// No log gets here: a line a microsecond for three centuries.
const MAX_LINE: u64 = 1 << 53;

#[cfg(test)]
mod tests {
    use super::*;

    fn log(lines: usize) -> String {
        let mut chain = Chain::default();
        let mut text = String::new();
        for n in 0..lines {
            let wall = Duration::from_secs(n as u64);
            let (next, line) = chain.extended(None, wall, Id(0x1b00_0101), &Entry::NotKept);
            chain = next;
            text += &line;
        }
        text
    }

    #[test]
    fn a_log_goes_on_where_it_stopped() {
        let verified = Chain::verify(log(3).as_bytes(), None);
        assert_eq!(
            (verified.chain.lines(), verified.broken, verified.torn),
            (3, None, false)
        );
        let wall = Duration::from_secs(3);
        let (_, line) = verified
            .chain
            .extended(None, wall, Id(0x1b00_0101), &Entry::NotKept);
        assert_eq!(log(4), log(3) + &line);
    }

    #[test]
    fn a_changed_line_breaks_the_chain_there() {
        let text = log(4).replacen("\"time_ms\":2000", "\"time_ms\":2001", 1);
        let broken = Chain::verify(text.as_bytes(), None).broken;
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
                Chain::verify(other.as_bytes(), None).broken.is_some(),
                "{order:?}"
            );
        }
    }

    #[test]
    fn a_line_that_a_crash_cut_off_is_no_break() {
        let whole = log(3);
        let cut = &whole[..whole.len() - 20];
        let verified = Chain::verify(cut.as_bytes(), None);
        assert_eq!(
            (verified.chain.lines(), verified.broken, verified.torn),
            (2, None, true)
        );
        let (_, line) = verified
            .chain
            .extended(None, Duration::ZERO, Id(1), &Entry::NotKept);
        let healed = format!("{cut}\n{line}");
        let verified = Chain::verify(healed.as_bytes(), None);
        assert_eq!(
            (verified.chain.lines(), verified.broken, verified.torn),
            (3, None, false)
        );
    }

    #[test]
    fn a_line_of_which_a_crash_cut_off_the_line_feed_alone_is_one_that_the_next_follows() {
        let whole = log(3);
        let cut = whole.trim_end();
        let verified = Chain::verify(cut.as_bytes(), None);
        assert_eq!(
            (verified.chain.lines(), verified.broken, verified.torn),
            (3, None, true)
        );
        let (_, line) = verified
            .chain
            .extended(None, Duration::ZERO, Id(1), &Entry::NotKept);
        let healed = format!("{cut}\n{line}");
        let verified = Chain::verify(healed.as_bytes(), None);
        assert_eq!((verified.chain.lines(), verified.broken), (4, None));
    }

    #[test]
    fn what_a_crash_left_of_the_first_line_of_a_file_names_nothing_that_it_follows() {
        let before = Chain::verify(log(3).as_bytes(), None).chain;
        let vehicle = Id(0x1b00_0101);
        let (_, first) = before.extended(None, Duration::ZERO, vehicle, &Entry::Continued);
        // A space behind the object is not written by anybody here, and an object with it can be read.
        for torn in [&first[..100], &format!("{} ", first.trim_end())] {
            let verified = Chain::verify(format!("{torn}\n{first}").as_bytes(), None);
            assert_eq!((verified.broken, verified.chain.lines()), (None, 4));
            assert_eq!(verified.follows, before);
            let verified = Chain::verify(format!("{torn}\n").as_bytes(), None);
            assert_eq!(verified.follows, Chain::default());
            assert!(verified.digits.is_empty());
        }
    }

    #[test]
    fn a_log_that_follows_another_is_verified_by_itself_and_after_it() {
        let before = Chain::verify(log(3).as_bytes(), None).chain;
        let vehicle = Id(0x1b00_0101);
        let (chain, first) = before.extended(None, Duration::ZERO, vehicle, &Entry::Continued);
        let (chain, second) = chain.extended(None, Duration::ZERO, vehicle, &Entry::NotKept);
        let text = first + &second;
        let verified = Chain::verify(text.as_bytes(), None);
        assert_eq!((verified.broken, &verified.chain), (None, &chain));
        assert_eq!((verified.follows, chain.lines()), (before, 5));
        let forged = text.replacen("\"line\":4", "\"line\":6", 1);
        assert!(Chain::verify(forged.as_bytes(), None).broken.is_some());
    }

    #[test]
    fn without_the_key_no_line_can_be_changed_added_or_rewritten() {
        let (key, other) = (AuditKey::new([7; 32]), AuditKey::new([8; 32]));
        let vehicle = Id(0x1b00_0101);
        // A log of an earlier version, continued with a key.
        let plain = log(2);
        let mut chain = Chain::verify(plain.as_bytes(), Some(&key)).chain;
        let mut text = plain.clone();
        for entry in [Entry::Keyed, Entry::NotKept, Entry::NotKept] {
            let (next, line) = chain.extended(Some(&key), Duration::ZERO, vehicle, &entry);
            chain = next;
            text += &line;
        }
        let verified = Chain::verify(text.as_bytes(), Some(&key));
        assert_eq!((verified.broken, verified.other_key), (None, None));
        assert_eq!(
            verified.digits,
            text.lines().map(|line| &line[..64]).collect::<Vec<_>>()
        );
        assert_eq!(verified.chain, chain);

        // Rewritten from the fourth line on, by SHA-256 or by another key.
        let upto = text
            .lines()
            .take(3)
            .map(|line| line.len() + 1)
            .sum::<usize>();
        let before = Chain::verify(&text.as_bytes()[..upto], Some(&key)).chain;
        let forger = |key| {
            before
                .extended(key, Duration::ZERO, vehicle, &Entry::NotKept)
                .1
        };
        for line in [forger(None), forger(Some(&other))] {
            let forged = text[..upto].to_owned() + &line;
            let broken = Chain::verify(forged.as_bytes(), Some(&key)).broken;
            assert_eq!(broken, Some(Broken { line: 4 }));
        }
        // Another key's own transition is named.
        let (_, line) = before.extended(Some(&other), Duration::ZERO, vehicle, &Entry::Keyed);
        let forged = text[..upto].to_owned() + &line;
        let verified = Chain::verify(forged.as_bytes(), Some(&key));
        assert_eq!(verified.other_key, Some(other.id()));
        // And without any key the keyed part is named, too.
        let verified = Chain::verify(text.as_bytes(), None);
        assert_eq!(
            (verified.broken, verified.other_key),
            (None, Some(key.id()))
        );
    }

    #[test]
    fn a_log_that_claims_to_follow_more_lines_than_any_has_is_broken() {
        let chain = Chain {
            lines: u64::MAX - 2,
            last: "1".repeat(HASH_DIGITS),
            keyed: None,
        };
        let wall = Duration::from_secs(1_800_000_000);
        let vehicle = Id(0x1b00_0101);
        let (next, first) = chain.extended(None, wall, vehicle, &Entry::Continued);
        let (_, second) = next.extended(None, wall, vehicle, &Entry::NotKept);
        let bytes = format!("{first}{second}{second}");
        let verified = Chain::verify(bytes.as_bytes(), None);
        assert_eq!(verified.broken, Some(Broken { line: 1 }));
        assert_eq!(verified.chain.lines(), 3);
    }
}
