//! The messages that are only encoded and decoded (neither honoured, sent, nor refused with a reason), and why.

use stanag_msgs::table::MessageInfo;

use super::lookup;
use super::refusals::why_refused;

static REASONS: &[(&[u16], &str)] = &[
    (
        &[6000],
        "PX4 drives transponders, and reports the state of none over MAVLink",
    ),
    (
        &[17_003],
        "no source gives the length of its File Name, nor the values of its File Type; `vsm files` transfers files",
    ),
    (
        &[32_004],
        "its one field says where an RF terminal takes commands from, and no source gives the values; this end has no RF terminal",
    ),
    (
        &[32_100, 32_101, 32_102, 32_103],
        "an antenna on a pedestal is no part of a MAVLink link: PX4 reports none, and this VSM drives none",
    ),
    (
        &[32_201],
        "a vehicle has one data link here, so that there is none to fall back to; no source gives the values",
    ),
    (
        &[32_300],
        "no source says which datagrams its one byte counts, or over which time; `vsm status` has counters of both sides",
    ),
    (
        &[32_301],
        "no source establishes the length of its Uniform Resource Identifier, nor the values of its Stream N Type; the private message 50025 announces the same",
    ),
    (
        &[42_003, 43_002],
        "no source gives the length of their texts or the values of Input Type and Enable, and no message of Edition 2 has them, \
         from which they could be derived; controls are described by 41000 and 41001 of 50011 instead",
    ),
];

/// Whether a message has no effect, not even a refusal with a reason of its own.
#[must_use]
pub fn is_codec_only(message: &MessageInfo) -> bool {
    let row = lookup::message(message.id);
    row.is_none_or(|row| row.taken.is_empty() && row.sends.is_empty())
        && why_refused(message.id).is_none()
}

/// Why it has none; `None` for every other message.
#[must_use]
pub fn why_codec_only(message: &MessageInfo) -> Option<&'static str> {
    let mut reasons = REASONS.iter();
    let (_, why) = reasons.find(|(ids, _)| ids.contains(&message.id))?;
    is_codec_only(message).then_some(*why)
}

#[cfg(test)]
mod tests {
    use stanag_msgs::table::{self, MESSAGES};

    use super::*;

    #[test]
    fn at_most_fifteen_messages_are_codec_only_and_each_has_its_reason() {
        let all: Vec<_> = MESSAGES.iter().filter(|one| is_codec_only(one)).collect();
        for one in &all {
            assert!(why_codec_only(one).is_some(), "{} {}", one.id, one.name);
        }
        let ids: Vec<u16> = all.iter().map(|one| one.id).collect();
        assert!(ids.len() <= 15, "{}: {ids:?}", ids.len());
    }

    #[test]
    fn no_point_of_the_comparison_is_missing() {
        let page = include_str!("../../../docs/guide/points.md");
        let rows: Vec<&str> = page.lines().filter(|line| line.starts_with("| ")).collect();
        // The first 7 of the 41 points are context; some points share a row.
        let column = |row: &&str, at| row.split('|').nth(at).unwrap_or("").trim().to_owned();
        let points = rows.iter().skip(1).map(|row| column(row, 1));
        let mut points: Vec<u8> = points
            .flat_map(|points| {
                let all = points.split(", ").map(str::parse);
                all.collect::<Result<Vec<u8>, _>>().expect("numbers")
            })
            .collect();
        points.sort_unstable();
        assert_eq!(points, (8..=41).collect::<Vec<u8>>());
        for row in rows.iter().skip(1) {
            let state = column(row, 3);
            // Another byte order alone would break every peer; anything else that is missing is named in its row.
            let expected = if column(row, 1) == "9" {
                "declined"
            } else {
                "works"
            };
            assert_eq!(state, expected, "{row}");
            assert!(expected == "works" || !column(row, 4).is_empty(), "{row}");
        }
    }

    #[test]
    fn reasons_are_of_messages_of_the_table_and_each_stands_once() {
        let mut ids: Vec<u16> = REASONS.iter().flat_map(|(ids, _)| *ids).copied().collect();
        for id in &ids {
            let message = table::message(*id).expect("a message of the table");
            assert!(is_codec_only(message), "{id}: something is done with it");
        }
        let count = ids.len();
        ids.sort_unstable();
        ids.dedup();
        assert_eq!(ids.len(), count);
    }
}
