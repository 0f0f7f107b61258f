//! The access list as a file: one line for each entry, each with its own MAC, followed by their count and a MAC over all.
//!
//! ```text
//! vsm-acl 1
//! vsm 1b:00:00:01
//! version 7
//! grant 1b:00:00:a0 1b:00:01:01 fly 2027-01-31T00:00:00Z 3fa9c1d2e4b56789 9c1e..
//! grant 1b:00:00:a0 1b:00:01:01 launch never 3fa9c1d2e4b56789 07aa..
//! end 2 5b0a..
//! ```
//!
//! CUCS, vehicle, group of messages, until when, id of the guard key. An unsigned list has `unsigned` in place of each MAC.
//! An entry's MAC is HMAC-SHA256(access key, "vsm-acl-1", VSM ID, version, CUCS ID, vehicle ID, group, until, guard key id):
//! an entry copied from another list, or from another version of this one, does not verify. The list's is HMAC-SHA256(access
//! key, "vsm-acl-list-1", VSM ID, version, count, the entries' MACs in their order).
//!
//! The format is canonical: any other spelling or order is refused, so that the text that a person reads is the text that is
//! verified.

use std::fmt::{self, Write as _};
use std::num::NonZeroU64;
use std::str::{FromStr as _, Lines};

use data_encoding::{HEXLOWER, HEXLOWER_PERMISSIVE};
use hmac::{Hmac, KeyInit as _, Mac as _};
use mavlink_link::signing::{KeyId, SigningKey};
use sha2::Sha256;
use stanag_msgs::Id;

use super::group::Group;
use crate::session::dates::{parse_utc, utc};

/// One line: what a CUCS may send to a vehicle.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct AccessEntry {
    /// CUCS ID.
    pub cucs: Id,
    /// Vehicle ID.
    pub vehicle: Id,
    /// What it may send.
    pub group: Group,
    /// The id of the guard key under which its datagrams must verify.
    pub key: KeyId,
    /// When it expires, seconds since 1970; `None`: never.
    pub until: Option<NonZeroU64>,
}

impl AccessEntry {
    /// Its expiry, as written in a list.
    #[must_use]
    pub fn until_text(&self) -> String {
        self.until
            .map_or_else(|| NEVER.to_owned(), |until| utc(until.get()))
    }

    /// The key by which entries are unique and sorted.
    fn place(&self) -> (Id, Id, Group, KeyId) {
        (self.cucs, self.vehicle, self.group, self.key)
    }
}

/// A list, signed or not.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct AccessList {
    vsm: Id,
    version: u64,
    entries: Vec<AccessEntry>,
}

/// The key that a list is signed and verified by. `Debug` shows its id alone.
pub struct AccessKey {
    id: KeyId,
    // On the heap: a value that is moved would leave copies on stacks, which nothing wipes.
    keyed: Box<Hmac<Sha256>>,
}

impl AccessKey {
    /// The key of these bytes.
    #[must_use]
    pub fn new(key: &SigningKey) -> AccessKey {
        let keyed = Hmac::new_from_slice(key.expose()).expect("HMAC takes a key of any length");
        AccessKey {
            id: key.id(),
            keyed: Box::new(keyed),
        }
    }

    /// Its public name.
    #[must_use]
    pub fn id(&self) -> KeyId {
        self.id
    }

    fn of_entry(&self, list: &AccessList, entry: &AccessEntry) -> Hmac<Sha256> {
        let until = entry.until.map_or(0, NonZeroU64::get);
        self.begin(b"vsm-acl-1", list)
            .chain_update(entry.cucs.0.to_be_bytes())
            .chain_update(entry.vehicle.0.to_be_bytes())
            .chain_update([entry.group.code()])
            .chain_update(until.to_be_bytes())
            .chain_update(entry.key.bytes())
    }

    fn of_list(&self, list: &AccessList, entries: &[Mac]) -> Hmac<Sha256> {
        let count = entries.len() as u64;
        let list = self
            .begin(b"vsm-acl-list-1", list)
            .chain_update(count.to_be_bytes());
        entries.iter().fold(list, Hmac::chain_update)
    }

    fn begin(&self, context: &[u8], list: &AccessList) -> Hmac<Sha256> {
        Hmac::clone(&self.keyed)
            .chain_update(context)
            .chain_update(list.vsm.0.to_be_bytes())
            .chain_update(list.version.to_be_bytes())
    }
}

impl fmt::Debug for AccessKey {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "AccessKey({})", self.id)
    }
}

type Mac = [u8; 32];
/// The MACs of the entries, and that of the list.
type Macs = (Vec<Mac>, Mac);

impl AccessList {
    /// A list without entries, of version 0: it has never been signed.
    #[must_use]
    pub const fn new(vsm: Id) -> AccessList {
        AccessList {
            vsm,
            version: 0,
            entries: Vec::new(),
        }
    }

    /// The VSM that it is for.
    #[must_use]
    pub const fn vsm(&self) -> Id {
        self.vsm
    }

    /// How often it was signed.
    #[must_use]
    pub const fn version(&self) -> u64 {
        self.version
    }

    /// Its entries, in their order.
    #[must_use]
    pub fn entries(&self) -> &[AccessEntry] {
        &self.entries
    }

    /// Adds an entry, in place of one for the same CUCS, vehicle, group and key.
    ///
    /// # Errors
    /// The list is full: 4,096.
    pub fn grant(&mut self, entry: AccessEntry) -> Result<(), ListError> {
        match self
            .entries
            .binary_search_by_key(&entry.place(), AccessEntry::place)
        {
            Ok(place) => self.entries[place] = entry,
            Err(_) if self.entries.len() == MAX_ENTRIES => return Err(ListError::Full),
            // Inserted in order: `parse` refuses a list whose entries are not sorted.
            Err(place) => self.entries.insert(place, entry),
        }
        Ok(())
    }

    /// Removes the entries for which this holds; returns their number.
    pub fn revoke(&mut self, of: impl Fn(&AccessEntry) -> bool) -> usize {
        let before = self.entries.len();
        self.entries.retain(|entry| !of(entry));
        before - self.entries.len()
    }

    /// The list as a file, unsigned: a VSM refuses it.
    #[must_use]
    pub fn draft(&self) -> String {
        self.text(None)
    }

    /// The list as a file, signed as this version.
    #[must_use]
    pub fn signed(&mut self, version: u64, key: &AccessKey) -> String {
        self.version = version;
        let macs = self.entries.iter().map(|entry| key.of_entry(self, entry));
        let macs: Vec<Mac> = macs.map(|mac| mac.finalize().into_bytes().into()).collect();
        let list = key.of_list(self, &macs).finalize().into_bytes().into();
        self.text(Some((&macs, &list)))
    }

    fn text(&self, macs: Option<(&[Mac], &Mac)>) -> String {
        let mut text = format!("{FIRST}\nvsm {}\nversion {}\n", self.vsm, self.version);
        for (n, entry) in self.entries.iter().enumerate() {
            let AccessEntry {
                cucs,
                vehicle,
                group,
                key,
                ..
            } = entry;
            let until = entry.until_text();
            let mac = macs.and_then(|(all, _)| all.get(n));
            let _ = writeln!(
                text,
                "grant {cucs} {vehicle} {group} {until} {key} {}",
                hex(mac)
            );
        }
        let _ = writeln!(
            text,
            "end {} {}",
            self.entries.len(),
            hex(macs.map(|(_, list)| list))
        );
        text
    }

    /// Reads a list without verifying its MACs: only for showing or changing it.
    ///
    /// # Errors
    /// It is not a list: with the line and what was expected.
    pub fn read(bytes: &[u8]) -> Result<AccessList, ListError> {
        parse(bytes).map(|(list, _)| list)
    }

    /// Reads a list that the holder of this key has signed for this VSM.
    ///
    /// # Errors
    /// It is not: with the reason.
    pub fn verified(bytes: &[u8], key: &AccessKey, vsm: Id) -> Result<AccessList, ListError> {
        let (list, macs) = parse(bytes)?;
        let (entries, closing) = macs.ok_or(ListError::Unsigned)?;
        if list.vsm != vsm {
            return Err(ListError::OtherVsm {
                found: list.vsm,
                expected: vsm,
            });
        }
        for ((entry, mac), line) in list.entries.iter().zip(&entries).zip(FIRST_ENTRY..) {
            let expected = key.of_entry(&list, entry);
            expected
                .verify_slice(mac)
                .map_err(|_| ListError::Entry { line, key: key.id })?;
        }
        let expected = key.of_list(&list, &entries);
        expected
            .verify_slice(&closing)
            .map_err(|_| ListError::Closing { key: key.id })?;
        Ok(list)
    }
}

/// The list, and the MACs of its entries and of itself if it is signed.
fn parse(bytes: &[u8]) -> Result<(AccessList, Option<Macs>), ListError> {
    if bytes.len() > MAX_LIST_BYTES {
        return Err(ListError::TooLong(bytes.len()));
    }
    // The length is checked before anything is parsed: the file may be any file.
    let text = std::str::from_utf8(bytes).map_err(|_| ListError::NoText)?;
    let mut lines = Reader {
        lines: text.lines(),
        number: 0,
    };
    lines.next_is(FIRST, |line| (line == FIRST).then_some(()))?;
    let vsm = lines.next_is("vsm and a VSM ID, such as vsm 1b:00:00:01", |line| {
        line.strip_prefix("vsm ")?.parse().ok()
    })?;
    let version = lines.next_is("version and a number, such as version 7", |line| {
        line.strip_prefix("version ")?.parse().ok()
    })?;
    let mut list = AccessList {
        version,
        ..AccessList::new(vsm)
    };
    let mut macs = Vec::new();
    let (count, closing) = loop {
        match lines.next_is(ENTRY, line)? {
            Line::Entry(entry, mac) => {
                let line = lines.number;
                match list.entries.last().map(AccessEntry::place) {
                    Some(before) if before == entry.place() => {
                        return Err(ListError::Duplicate { line });
                    }
                    Some(before) if before > entry.place() => {
                        return Err(ListError::Order { line });
                    }
                    _ if list.entries.len() == MAX_ENTRIES => return Err(ListError::Full),
                    _ => {}
                }
                list.entries.push(entry);
                macs.push(mac);
            }
            Line::End(count, mac) => break (count, mac),
        }
    };
    if count != list.entries.len() {
        return Err(ListError::Count {
            named: count,
            found: list.entries.len(),
        });
    }
    // Signed only if every entry has a MAC. A partly signed list is written without any below, and so differs from its
    // text.
    let macs: Option<Vec<Mac>> = macs.into_iter().collect();
    let signed = macs.zip(closing);
    let written = list.text(signed.as_ref().map(|(entries, list)| (&**entries, list)));
    if written == text {
        return Ok((list, signed));
    }
    // This catches other spellings, and lists in which only some MACs are present.
    let same = written.lines().zip(text.lines());
    let line = 1 + same.take_while(|(one, other)| one == other).count();
    Err(ListError::Form { line })
}

struct Reader<'a> {
    lines: Lines<'a>,
    number: usize,
}

impl<'a> Reader<'a> {
    fn next_is<T>(
        &mut self,
        expected: &'static str,
        is: impl Fn(&'a str) -> Option<T>,
    ) -> Result<T, ListError> {
        let line = self.lines.next().ok_or(ListError::Truncated)?;
        self.number += 1;
        is(line).ok_or_else(|| ListError::Line {
            line: self.number,
            found: line.chars().take(MAX_SHOWN).collect(),
            expected,
        })
    }
}

enum Line {
    Entry(AccessEntry, Option<Mac>),
    End(usize, Option<Mac>),
}

fn line(text: &str) -> Option<Line> {
    let words: Vec<&str> = text.split(' ').collect();
    match words[..] {
        ["grant", cucs, vehicle, group, until, key, mac] => {
            let entry = AccessEntry {
                cucs: cucs.parse().ok()?,
                vehicle: vehicle.parse().ok()?,
                group: Group::from_str(group).ok()?,
                key: KeyId::parse(key)?,
                until: parse_until(until)?,
            };
            Some(Line::Entry(entry, parse_mac(mac)?))
        }
        ["end", count, mac] => Some(Line::End(count.parse().ok()?, parse_mac(mac)?)),
        _ => None,
    }
}

/// `never`, or a time in seconds such as `2027-01-31T00:00:00Z`.
#[must_use]
pub fn parse_until(text: &str) -> Option<Option<NonZeroU64>> {
    match text {
        NEVER => Some(None),
        other => Some(Some(NonZeroU64::new(parse_utc(other)?)?)),
    }
}

fn parse_mac(text: &str) -> Option<Option<Mac>> {
    if text == UNSIGNED {
        return Some(None);
    }
    let mac = HEXLOWER_PERMISSIVE.decode(text.as_bytes()).ok()?;
    Some(Some(mac.try_into().ok()?))
}

fn hex(mac: Option<&Mac>) -> String {
    mac.map_or_else(|| UNSIGNED.to_owned(), |mac| HEXLOWER.encode(mac))
}

/// Why a list is refused.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum ListError {
    /// It is longer than any list.
    #[error("an access list of {0} bytes, expected {MAX_LIST_BYTES} at most")]
    TooLong(usize),
    /// It is not UTF-8.
    #[error("the access list is not text")]
    NoText,
    /// A line is not a line of a list.
    #[error("line {line} of the access list is {found:?}, expected {expected}")]
    Line {
        /// Which, from 1.
        line: usize,
        /// How it begins.
        found: String,
        /// What was expected.
        expected: &'static str,
    },
    /// Its last line is missing.
    #[error("the access list has no line `end`: it was cut off")]
    Truncated,
    /// Entries are missing, or too many.
    #[error(
        "the access list has {found} entries, and its last line says {named}: one was taken out or put in"
    )]
    Count {
        /// By the last line.
        named: usize,
        /// That there are.
        found: usize,
    },
    /// An entry is duplicated.
    #[error(
        "line {line} of the access list is for the same CUCS, vehicle, group and key as the line before"
    )]
    Duplicate {
        /// Which, from 1.
        line: usize,
    },
    /// An entry is out of order.
    #[error("line {line} of the access list is not in its order: by CUCS, vehicle, group and key")]
    Order {
        /// Which, from 1.
        line: usize,
    },
    /// A line is not in the canonical form.
    #[error("line {line} of the access list is not spelled as `vsm access` writes it")]
    Form {
        /// Which, from 1.
        line: usize,
    },
    /// It has no MACs.
    #[error("the access list is not signed: run `vsm access sign`")]
    Unsigned,
    /// It is for another VSM.
    #[error("the access list is for VSM {found}, expected {expected}")]
    OtherVsm {
        /// The VSM that it is for.
        found: Id,
        /// This one.
        expected: Id,
    },
    /// The MAC of an entry is not the key's.
    #[error(
        "line {line} of the access list does not verify under key {key}: it was changed, or is of another list, version or key"
    )]
    Entry {
        /// Which, from 1.
        line: usize,
        /// The key.
        key: KeyId,
    },
    /// The MAC of the list is not the key's.
    #[error(
        "the last line of the access list does not verify under key {key}: entries were taken out, or put in"
    )]
    Closing {
        /// The key.
        key: KeyId,
    },
    /// There is no room for another entry.
    #[error("an access list has {MAX_ENTRIES} entries at most")]
    Full,
}

/// Maximum number of entries of a list.
const MAX_ENTRIES: usize = 4_096;
/// The longest list: its entries, and a line more than its first and last ones.
pub const MAX_LIST_BYTES: usize = (MAX_ENTRIES + 1) * 160;

const FIRST: &str = "vsm-acl 1";
/// The line of the first entry.
const FIRST_ENTRY: usize = 4;
const NEVER: &str = "never";
const UNSIGNED: &str = "unsigned";
const ENTRY: &str = "grant CUCS VEHICLE GROUP UNTIL KEY MAC, or end COUNT MAC";
const MAX_SHOWN: usize = 60;

#[cfg(test)]
mod tests;
