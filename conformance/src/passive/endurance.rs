//! Judges of a CUCS under hostile and impossible input: whether it still sends, and answers, afterwards.
//!
//! The scripted vehicle sends what no vehicle should, then requests an acknowledgement. A CUCS that sends nothing
//! after that has stopped: its program ended, hangs, or has closed its socket.

use super::view::{Found, Judge, View};
use crate::bench::net::Datagram;
use crate::wire::{Direction, Seen};

pub(super) const JUDGES: &[Judge] = &[
    Judge {
        rule: "ROBUST-001",
        judge: |view, found| continues_after(view, found, "a truncated datagram", truncated),
    },
    Judge {
        rule: "ROBUST-002",
        judge: |view, found| continues_after(view, found, "a message with a wrong length", lying),
    },
    Judge {
        rule: "ROBUST-003",
        judge: |view, found| continues_after(view, found, "an unknown message", unknown),
    },
    Judge {
        rule: "ROBUST-005",
        judge: |view, found| continues_after(view, found, "a datagram of unusual size", odd_size),
    },
    Judge {
        rule: "ROBUST-007",
        judge: |view, found| continues_after(view, found, "a text without NUL", unended_text),
    },
    Judge {
        rule: "ROBUST-008",
        judge: the_other_sides_messages,
    },
    Judge {
        rule: "ROBUST-011",
        judge: |view, found| continues_after(view, found, "values out of range", impossible),
    },
];

/// What arrives within this time after the input may have been sent before it, and proves nothing.
const ON_ITS_WAY_S: f64 = 0.15;
/// How long a recording has to continue for silence in it to mean something.
const SILENCE_S: f64 = 0.4;

fn hostile(datagram: &Datagram) -> bool {
    odd_size(datagram)
        || truncated(datagram)
        || lying(datagram)
        || unknown(datagram)
        || unended_text(datagram)
        || impossible(datagram)
}

/// Fails unless the CUCS sends something after the first datagram of this kind. Where several kinds follow closely,
/// the silence is charged to the first of them.
fn continues_after(view: &View<'_>, found: &mut Found, what: &str, kind: fn(&Datagram) -> bool) {
    // A CUCS that is played step by step may be silent between two steps, so it is not judged here; the next step
    // shows whether it continues.
    if !view.profile.on.keys().eq(["start"]) {
        return;
    }
    let of_vehicle = || {
        view.datagrams
            .iter()
            .filter(|datagram| datagram.direction == Direction::Sent)
    };
    let Some(first) = of_vehicle().find(|datagram| kind(datagram)) else {
        return;
    };
    found.saw();
    let at = |datagram: &Datagram| datagram.at.as_secs_f64();
    let last_received = view.of_subject().map(at).fold(f64::MIN, f64::max);
    let end = view.datagrams.last().map_or(0.0, at);
    let silent = last_received < at(first) + ON_ITS_WAY_S && end - at(first) > SILENCE_S;
    // A hostile datagram after the last sign of life, and before this one, is the cause instead.
    let earlier = of_vehicle()
        .take_while(|datagram| datagram.at < first.at)
        .any(|datagram| hostile(datagram) && at(datagram) + ON_ITS_WAY_S > last_received);
    if silent && !earlier {
        found.fail_at(
            first,
            format!(
                "expected the CUCS to continue after {what}; nothing came from it in the {:.1} s that followed",
                end - at(first)
            ),
        );
    }
}

fn odd_size(datagram: &Datagram) -> bool {
    datagram.bytes.is_empty() || datagram.bytes.len() > 548
}

fn length(datagram: &Datagram) -> Option<usize> {
    let place = if stanag_msgs::ed25::is_ed25(&datagram.bytes) {
        18..22
    } else {
        2..4
    };
    let word = datagram.bytes.get(place)?;
    Some(
        word.iter()
            .fold(0, |length, &byte| length << 8 | usize::from(byte)),
    )
}

fn truncated(datagram: &Datagram) -> bool {
    let bytes = datagram.bytes.len();
    (1..crate::wire::HEADER).contains(&bytes)
        || !odd_size(datagram)
            && datagram.fault.is_some()
            && length(datagram).is_some_and(|length| length <= 528)
}

fn lying(datagram: &Datagram) -> bool {
    !odd_size(datagram)
        && datagram.bytes.len() >= crate::wire::HEADER
        && length(datagram).is_some_and(|length| length == 0 || length > 528)
}

fn unknown(datagram: &Datagram) -> bool {
    datagram
        .originals
        .iter()
        .any(|seen| seen.info.is_none() && seen.piece.length > 0)
}

fn unended_text(datagram: &Datagram) -> bool {
    datagram.originals.iter().any(|seen| {
        let (Some(info), Ok(fields)) = (seen.info, &seen.fields) else {
            return false;
        };
        info.fields
            .iter()
            .filter(|field| matches!(field.wire, stanag_msgs::table::Wire::Char(_)))
            .filter_map(|field| fields.get(field.name))
            .any(|text| !text.contains(&0))
    })
}

fn impossible(datagram: &Datagram) -> bool {
    datagram.messages.iter().any(|seen| match seen.kind() {
        3001 => seen
            .raw("Select Flight Path Control Mode")
            .is_some_and(|mode| mode > 31),
        4000 => seen
            .value("Latitude")
            .is_some_and(|latitude| latitude.abs() > std::f64::consts::FRAC_PI_2),
        4001 => seen
            .raw("To Waypoint Number")
            .is_some_and(|number| (50_000..65_535).contains(&number)),
        16_000 => seen
            .raw("Subsystem ID")
            .is_some_and(|id| !matches!(id, 0..=11 | 20..=31)),
        _ => false,
    })
}

/// A CUCS never sends what only a VSM may send, and does not answer what only a CUCS may send.
fn the_other_sides_messages(view: &View<'_>, found: &mut Found) {
    let wrong_way = |seen: &Seen| matches!(seen.kind(), 1 | 2016 | 2017 | 13_000);
    for asked in view.requests().filter(|seen| wrong_way(seen)) {
        let answer = view.messages().find(|seen| {
            seen.at >= asked.at
                && seen.kind() == 17_000
                && seen.raw("Original Message Type") == Some(asked.kind().into())
                && seen.raw("Original Message Time Stamp") == asked.stamp()
                && seen.raw("Acknowledgement Type") == Some(2)
        });
        found.check(asked, answer.is_none(), || {
            format!("expected message {} of a vehicle not to be carried out by a CUCS; 17000 type 2 came", asked.kind())
        });
    }
    for seen in view.messages() {
        found.check(
            seen,
            !matches!(seen.kind(), 2 | 3 | 5 | 3000..=4001 | 14_000 | 16_000 | 16_001 | 41_000..=41_005 | 44_003),
            || format!("expected a CUCS to send no message {}, which only a VSM may", seen.kind()),
        );
    }
}

#[cfg(test)]
mod tests {
    use std::time::Duration;

    use super::*;

    fn datagram(at_ms: u64, direction: Direction, bytes: &[u8]) -> Datagram {
        let at = Duration::from_millis(at_ms);
        let ends = (([127, 0, 0, 1], 1).into(), ([127, 0, 0, 1], 2).into());
        Datagram::new((at, at), direction, 0, ends, bytes.to_vec(), None)
    }

    fn verdict(datagrams: &[Datagram], rule: &str) -> crate::verdict::Verdict {
        let mut profile = crate::profile::Profile::default();
        profile.on.insert("start".into(), "cucs".into());
        let view = View {
            datagrams,
            profile: &profile,
            survey: None,
            live: true,
            as_they_are: false,
        };
        let judge = JUDGES.iter().find(|judge| judge.rule == rule).unwrap();
        let applied = crate::passive::Applied {
            judge,
            as_they_are: false,
        };
        applied.judge(&view).0.verdict
    }

    #[test]
    fn the_first_of_several_inputs_answers_for_the_silence() {
        use crate::verdict::Verdict;
        let alive = crate::wire::Draft::new(16_002).raw("Time Stamp", 1).encode(
            stanag_msgs::Id(0x1b00_00a0),
            stanag_msgs::Id(1),
            32,
            1,
        );
        let mut run = vec![
            datagram(0, Direction::Received, &alive),
            datagram(100, Direction::Sent, &[]),
            datagram(600, Direction::Received, &alive),
            datagram(700, Direction::Sent, &[1, 2, 3]),
            datagram(900, Direction::Sent, &[0; 600]),
            datagram(2_000, Direction::Sent, &alive),
        ];
        assert_eq!(verdict(&run, "ROBUST-005"), Verdict::Pass);
        assert_eq!(verdict(&run, "ROBUST-001"), Verdict::Fail);
        run.insert(5, datagram(1_500, Direction::Received, &alive));
        assert_eq!(verdict(&run, "ROBUST-001"), Verdict::Pass);
        assert_eq!(verdict(&run[..1], "ROBUST-001"), Verdict::Inconclusive);
    }
}
