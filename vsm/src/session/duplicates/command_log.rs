//! The lines of the log of commands, written and read.
//!
//! Each state of a command is one line: digest, message type, Time Stamp, destination, 1 if an acknowledgement was
//! requested, mode, and the answer (`-` before it is known), followed by `unauthorised` if the command was refused as late
//! or for a missing right. A later line with the same digest replaces the earlier one. `used` and `sticks` lines have the
//! first and last of a span of used stamps; they are written in one step with the rest when the whole log is rewritten.

use std::fmt::Write as _;

use data_encoding::HEXLOWER;
use stanag_msgs::enums::AckType;
use stanag_msgs::{Id, TimeStamp};

use super::recent::{Digest, Seen};

pub(super) fn write_line(out: &mut String, seen: &Seen) {
    HEXLOWER.encode_append(&seen.digest.0, out);
    let Seen {
        stamp,
        message_type,
        destination,
        ack_requested,
        mode,
        answer,
        accepted,
        ..
    } = *seen;
    let (stamp, destination, ack) = (stamp.0, destination.0, u8::from(ack_requested));
    let _ = write!(
        out,
        " {message_type} {stamp} {destination:08x} {ack} {mode} "
    );
    let _ = match answer {
        Some(answer) => write!(out, "{}", answer.raw()),
        None => write!(out, "-"),
    };
    let _ = writeln!(out, "{}", if accepted { "" } else { UNAUTHORISED });
}

pub(super) fn write_span(out: &mut String, name: &str, first: u64, last: u64) {
    let _ = writeln!(out, "{name} {first} {last}");
}

pub(super) fn parse_span(line: &str) -> Option<(&str, u64, u64)> {
    let mut words = line.split(' ');
    let name = words
        .next()
        .filter(|name| [USED_LINE, STICKS_LINE].contains(name))?;
    let (first, last) = (words.next()?.parse().ok()?, words.next()?.parse().ok()?);
    (first <= last && words.next().is_none()).then_some((name, first, last))
}

pub(super) fn parse_line(line: &str) -> Option<Seen> {
    let (line, accepted) = match line.strip_suffix(UNAUTHORISED) {
        Some(line) => (line, false),
        None => (line, true),
    };
    let mut words = line.split(' ');
    let digest: [u8; 16] = u128::from_str_radix(words.next().filter(|hex| hex.len() == 32)?, 16)
        .ok()?
        .to_be_bytes();
    let seen = Seen {
        digest: Digest(digest),
        message_type: words.next()?.parse().ok()?,
        stamp: TimeStamp(words.next()?.parse().ok()?),
        destination: Id(u32::from_str_radix(words.next()?, 16).ok()?),
        ack_requested: words.next()? == "1",
        mode: words.next()?.parse().ok()?,
        answer: match words.next()? {
            "-" => None,
            number => Some(AckType::from_raw(number.parse().ok()?)),
        },
        question: false,
        accepted,
        came: None,
    };
    words.next().is_none().then_some(seen)
}

pub(super) fn log_file(station: Id) -> String {
    format!("commands-{:08x}.log", station.0)
}

pub(super) const USED_LINE: &str = "used";
pub(super) const STICKS_LINE: &str = "sticks";
/// Ends a line of the log.
const UNAUTHORISED: &str = " unauthorised";
