//! Judges of what messages mean together: ids, rights, alerts, acknowledgements, transfers, configuration.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;
use std::time::Duration;

use stanag_msgs::Id;
use stanag_msgs::table::Direction;

use super::view::{Ends, Found, Judge, Tally, View, ends};
use crate::wire::Seen;

pub(super) const JUDGES: &[Judge] = &[
    Judge {
        rule: "DISC-010",
        judge: form_of_ids,
    },
    Judge {
        rule: "AUTH-011",
        judge: never_more_than_authorised,
    },
    Judge {
        rule: "HB-001",
        judge: heartbeat_at_1_hz,
    },
    Judge {
        rule: "ALERT-001",
        judge: first_alert_negative_update_positive,
    },
    Judge {
        rule: "ALERT-003",
        judge: values_and_text_of_an_alert,
    },
    Judge {
        rule: "ALERT-005",
        judge: no_storms,
    },
    Judge {
        rule: "ACK-002",
        judge: no_acknowledgement_unasked,
    },
    Judge {
        rule: "ACK-003",
        judge: acknowledgements_are_not_acknowledged,
    },
    Judge {
        rule: "ROUTE-012",
        judge: progress_is_between_0_and_100,
    },
    Judge {
        rule: "ROUTE-024",
        judge: progress_rises,
    },
    Judge {
        rule: "CONF-007",
        judge: limits_make_sense,
    },
    Judge {
        rule: "CONF-003",
        judge: generic_lists_are_not_altered,
    },
];

fn form_of_ids(view: &View<'_>, found: &mut Found) {
    let claimed = view.profile.subject.vsm_id.as_ref();
    let claimed = claimed.and_then(|id| id.parse::<Id>().ok());
    for seen in view.messages() {
        if matches!(seen.kind(), 2 | 3)
            && let Some(claimed) = claimed
            && let Some(raw) = seen.raw("VSM ID")
        {
            let named = Id(raw as u32);
            found.check(seen, named == claimed, || {
                format!(
                    "expected the VSM ID {claimed} of the profile in message {}, got {named}",
                    seen.kind()
                )
            });
        }
        let mut ids = vec![("source", seen.piece.source)];
        if matches!(seen.kind(), 2 | 3) {
            ids.extend(seen.raw("VSM ID").map(|raw| ("VSM ID", Id(raw as u32))));
        }
        for (place, id) in ids {
            let owner = id.owner();
            let of_all = place == "source" && is_about_all_or_none(seen);
            let broadcast_source = place == "source" && owner == 0xFF && !of_all;
            found.check(seen, !broadcast_source, || {
                format!(
                    "expected an id of its own as source of message {}, got {id}",
                    seen.kind()
                )
            });
            let listed = matches!(owner, 0..=27 | 100..=119) || id == Id::NULL || of_all;
            if !listed && !broadcast_source {
                found.warn(
                    seen,
                    format!("{place} {id} begins with owner code {owner}, which the table lacks"),
                );
            }
        }
    }
}

/// Edition 2.5 has no source field: in what a VSM sends the Vehicle ID is read as the source, and the ids of everybody and of
/// nobody mean all vehicles of the VSM, or none, as where no vehicle is connected.
fn is_about_all_or_none(seen: &Seen) -> bool {
    let info = seen.original.as_ref().and_then(|original| original.info);
    info.is_some_and(|info| info.direction != Direction::ToVsm)
        && [Id::BROADCAST, Id::NULL].contains(&seen.piece.source)
}

fn never_more_than_authorised(view: &View<'_>, found: &mut Found) {
    for seen in view.messages().filter(|seen| seen.kind() == 2) {
        let (Some(granted), Some(authorised)) =
            (seen.raw("LOI Granted"), seen.raw("LOI Authorized"))
        else {
            continue;
        };
        found.check(seen, granted & !authorised == 0, || {
            format!(
                "expected LOI Granted within LOI Authorised 0x{authorised:02x}, got 0x{granted:02x}"
            )
        });
    }
}

/// Gaps between heartbeats that are enough to judge them, and how many of ten may be others than 1 s: the network loses one
/// now and then, or delivers it late. A lost heartbeat makes one such gap, a late one two.
const ENOUGH_GAPS: usize = 7;
const OTHER_TENTHS: usize = 3;

fn heartbeat_at_1_hz(view: &View<'_>, found: &mut Found) {
    let mut last: BTreeMap<(u32, u32, usize), Duration> = BTreeMap::new();
    let mut gaps: BTreeMap<u32, Tally> = BTreeMap::new();
    for seen in view.once().filter(|seen| seen.kind() == 16002) {
        // A heartbeat that requests an acknowledgement checks an address (a VSM proves one so): it is sent in
        // addition to the periodic ones.
        if seen.piece.ack() {
            continue;
        }
        let key = (seen.piece.source.0, seen.piece.destination.0, seen.socket);
        if let Some(before) = last.insert(key, seen.at) {
            let gap = (seen.at.saturating_sub(before)).as_secs_f64();
            // Several groups, or a reconnection, make gaps that are not the sender's period.
            if gap < 3.0 {
                let right = (0.8..=1.2).contains(&gap);
                if right {
                    found.saw();
                }
                gaps.entry(key.0).or_default().look(seen, right);
            }
        }
    }
    for gaps in gaps.into_values() {
        gaps.judge_by(
            found,
            ENOUGH_GAPS,
            OTHER_TENTHS,
            "expected heartbeats 0.8 to 1.2 s apart; other gaps came",
        );
    }
}

/// A CUCS, and the socket at which it receives.
type Receiver = (u32, usize);
/// Whose alert it is, and its number without the sign.
type Alert = (u32, i64);

fn first_alert_negative_update_positive(view: &View<'_>, found: &mut Found) {
    // By receiver: each CUCS is sent every alert in messages of its own. And by sender: each vehicle counts its own.
    let mut open: BTreeMap<Receiver, BTreeSet<Alert>> = BTreeMap::new();
    let mut first: BTreeMap<(Receiver, Alert), Vec<u8>> = BTreeMap::new();
    let mut parts = BTreeSet::new();
    let mut ever = BTreeSet::new();
    // A CUCS without levels is sent no updates of an alert: when it connects again, an active alert is new to it.
    let levels = |seen: &&Arc<Seen>| {
        seen.kind() == 1 && seen.raw("Requested/Handover LOI").unwrap_or_default() != 0
    };
    let mut connects: Vec<_> = view.requests().filter(levels).collect();
    connects.sort_by_key(|seen| seen.at);
    let mut connects = connects.into_iter().peekable();
    for seen in view.messages().filter(|seen| seen.kind() == 16000) {
        while let Some(connected) = connects.next_if(|connected| connected.at <= seen.at) {
            let receiver = (connected.piece.source.0, connected.socket);
            open.remove(&receiver);
            first.retain(|known, _| known.0 != receiver);
            parts.retain(|known: &(Receiver, Alert, i64)| known.0 != receiver);
        }
        let Some(id) = seen.raw("Alert (Warning) ID") else {
            continue;
        };
        let receiver = (seen.piece.destination.0, seen.socket);
        let known = open.entry(receiver).or_default();
        let alert = (seen.piece.source.0, id.saturating_abs());
        // A long text is sent in parts, which together are one message of the alert: each part occurs once.
        let of_several = seen
            .raw("Append Total Number")
            .is_some_and(|total| total > 1);
        if let Some(order) = seen.raw("Append Order").filter(|_| of_several && id < 0)
            && parts.insert((receiver, alert, order))
            && known.contains(&alert)
        {
            continue;
        }
        if id < 0 {
            ever.insert(alert.1);
            let again = !known.insert(alert);
            // The same bytes again are a duplicate by the network or a repetition by the sender, and not a new alert.
            let before = first.insert((receiver, alert), seen.piece.bytes.clone());
            let same = before.is_some_and(|bytes| bytes == seen.piece.bytes);
            found.saw();
            if !again || same {
                continue;
            }
            let reason =
                format!("expected a new negative id for a new alert; {id} was used before");
            // In a recording the VSM may have been restarted meanwhile, and its alerts are counted from the beginning.
            if view.live {
                found.fail(seen, reason);
            } else {
                found.warn(seen, reason);
            }
        } else {
            // A receiver that joined later, or that lost the first message, sees an update only.
            let elsewhere = ever.contains(&id);
            found.check(seen, id != 0 && (elsewhere || !view.live), || format!("expected the first message of an alert to have a negative id; got {id}, and -{id} was never sent"));
        }
    }
}

fn values_and_text_of_an_alert(view: &View<'_>, found: &mut Found) {
    for seen in view.messages().filter(|seen| seen.kind() == 16000) {
        for (field, high) in [("Priority", 5), ("Type", 3)] {
            if let Some(value) = seen.raw(field) {
                found.check(seen, (0..=high).contains(&value), || {
                    format!("expected {field} 0 to {high}, got {value}")
                });
            }
        }
        if let Some(subsystem) = seen.raw("Subsystem ID") {
            found.check(seen, matches!(subsystem, 0..=11 | 20..=31), || {
                format!("expected a defined subsystem, got {subsystem}")
            });
        }
        let ended = seen
            .fields
            .as_ref()
            .ok()
            .and_then(|fields| fields.get("Text"))
            .is_none_or(|text| text.contains(&0));
        found.check(seen, ended, || {
            "expected the text to end in NUL within its 80 bytes".into()
        });
        if seen
            .raw("Subsystem State Report Reference")
            .is_some_and(|reference| reference < -1)
        {
            found.fail(
                seen,
                "expected -1 as report reference where nothing more can be asked, got less",
            );
        }
    }
}

/// What is the same alert: of one vehicle, to one receiver, about one subsystem, in the same words.
type SameAlert = (Ends, u32, Option<i64>, String);

fn no_storms(view: &View<'_>, found: &mut Found) {
    let mut times: BTreeMap<SameAlert, Vec<f64>> = BTreeMap::new();
    // Not the ends of alerts, which have no text of their own: many may end at once.
    for seen in view
        .once()
        .filter(|seen| seen.kind() == 16000 && seen.raw("Priority") != Some(0))
    {
        let key = (
            ends(seen),
            seen.piece.destination.0,
            seen.raw("Subsystem ID"),
            seen.text("Text").unwrap_or_default(),
        );
        let times = times.entry(key).or_default();
        times.push(seen.at.as_secs_f64());
        let window = times
            .iter()
            .filter(|&&time| seen.at.as_secs_f64() - time < 10.0)
            .count();
        found.check(seen, window <= 20, || {
            format!("expected the same alert at most about once a second; {window} in 10 s")
        });
    }
}

fn no_acknowledgement_unasked(view: &View<'_>, found: &mut Found) {
    // A message that is in the traffic and requested no acknowledgement. A 17000 with a stamp of no message is judged
    // by another rule; floods are not recorded.
    let mut asked = BTreeSet::new();
    let mut unasked = BTreeSet::new();
    for seen in view.requests() {
        let Some(stamp) = seen.stamp() else { continue };
        let key = (i64::from(seen.kind()), stamp);
        if seen.piece.ack() {
            asked.insert(key)
        } else {
            unasked.insert(key)
        };
    }
    for seen in view.messages().filter(|seen| seen.kind() == 17000) {
        let (Some(kind), Some(stamp)) = (
            seen.raw("Original Message Type"),
            seen.raw("Original Message Time Stamp"),
        ) else {
            continue;
        };
        let key = (kind, stamp);
        found.check(seen, asked.contains(&key) || !unasked.contains(&key), || {
            format!("expected no 17000 unless it was asked for; it names message {kind} with stamp {stamp}, which did not ask")
        });
    }
}

fn acknowledgements_are_not_acknowledged(view: &View<'_>, found: &mut Found) {
    for seen in view.messages().filter(|seen| seen.kind() == 17000) {
        found.check(seen, !seen.piece.ack(), || {
            "expected 17000 without the acknowledgement bit".into()
        });
        found.check(
            seen,
            seen.raw("Original Message Type") != Some(17000),
            || "expected no 17000 about a 17000".into(),
        );
    }
}

/// A transfer: of a vehicle, to a CUCS, in a plan mode.
type Transfer = (Ends, u32, Option<i64>);
/// How soon after the end of a transfer another end is about the same one, where the command of the next may be missing.
const CONTRADICTS_WITHIN: Duration = Duration::from_secs(5);

fn progress_is_between_0_and_100(view: &View<'_>, found: &mut Found) {
    let mut last: BTreeMap<Transfer, i64> = BTreeMap::new();
    let mut commands: Vec<(f64, usize)> = view
        .requests()
        .filter(|seen| seen.kind() == 13000)
        .map(|seen| (seen.at.as_secs_f64(), seen.socket))
        .collect();
    commands.sort_by(|a, b| a.0.total_cmp(&b.0));
    let mut previous = 0.0;
    let mut ended: BTreeMap<Transfer, (i64, Duration)> = BTreeMap::new();
    for seen in view.in_order().filter(|seen| seen.kind() == 14000) {
        let at = seen.at.as_secs_f64();
        // A new transfer starts at 0 %.
        if commands
            .iter()
            .any(|&(time, _)| time > previous && time <= at)
        {
            last.clear();
            ended.clear();
        }
        previous = at;
        // The command that cancels a transfer ends by itself, apart from the transfer.
        let mode = seen.raw("Mission Plan Mode");
        let key = (ends(seen), seen.piece.destination.0, mode);
        // The same end twice is a repetition; a different one contradicts the first. Later in a recording it is that of
        // another transfer, whose command is not in it.
        if let Some(end) = seen.raw("Status").filter(|&status| status != 0) {
            let first = ended.entry(key).or_insert((end, seen.at));
            if !view.live && seen.at.saturating_sub(first.1) > CONTRADICTS_WITHIN {
                *first = (end, seen.at);
            }
            let first = first.0;
            found.check(seen, first == end, || {
                format!("expected one end of a transfer; 14000 status {end} follows status {first}")
            });
        }
        let Some(percent) = seen.raw("Percent Complete") else {
            continue;
        };
        found.check(seen, percent <= 100, || {
            format!("expected Percent Complete 0 to 100, got {percent}")
        });
        // Only of loads and downloads: a clear or a cancel has no parts to count.
        let whole =
            seen.raw("Status") == Some(1) && matches!(seen.raw("Mission Plan Mode"), Some(2 | 3));
        found.check(seen, !whole || percent == 100, || {
            format!("expected Percent Complete 100 with status 1 (complete) of a load or a download, got {percent}")
        });
        let before = last.insert(key, percent);
        // A rejection may have any percentage; in a recording one of 0 may begin a transfer whose command is not in it.
        let rejected = seen.raw("Status").is_some_and(|status| status == 2);
        let begins = !view.live && percent == 0;
        found.check(
            seen,
            rejected || begins || before.is_none_or(|before| before <= percent),
            || {
                format!(
                    "expected Percent Complete not to fall within a transfer; {percent} follows {}",
                    before.unwrap_or_default()
                )
            },
        );
        if seen.raw("Status").is_some_and(|status| status != 0) {
            last.remove(&key);
        }
    }
}

/// Reports in progress that show whether the percentage rises: a subject may report the beginning twice.
const RISING_BY: usize = 3;
/// A transfer that took longer has to report progress: who waits for it takes it for stuck. How often is nowhere specified.
const LONG: Duration = Duration::from_secs(20);
/// A transfer without an end that reports one percentage for longer makes no progress.
const STUCK: Duration = Duration::from_secs(30);

/// Reports in progress of one transfer: of a vehicle, to a CUCS, in a plan mode.
type Transfers = BTreeMap<(Ends, u32, i64), Vec<Arc<Seen>>>;

/// The percentage of all these reports, where it is the same one.
fn one_percentage(reports: &[Arc<Seen>]) -> Option<i64> {
    let percent = reports.first()?.raw("Percent Complete")?;
    let same = |report: &Arc<Seen>| report.raw("Percent Complete") == Some(percent);
    reports.iter().all(same).then_some(percent)
}

/// From the first to the last of these reports, and from the first to `end`.
fn lasted(reports: &[Arc<Seen>], end: Duration) -> (Duration, Duration) {
    let first = reports.first().map_or(end, |report| report.at);
    let last = reports.last().map_or(end, |report| report.at);
    (last.saturating_sub(first), end.saturating_sub(first))
}

/// Judges a transfer of which no end came. In a recording the link to the vehicle may have been lost meanwhile. False where
/// it was reported for too short a time.
fn judge_endless(view: &View<'_>, reports: &[Arc<Seen>], found: &mut Found) -> bool {
    let Some(last) = reports.last() else {
        return false;
    };
    let (reported, _) = lasted(reports, last.at);
    if reports.len() < RISING_BY || reported < STUCK {
        return false;
    }
    found.saw();
    if let Some(percent) = one_percentage(reports) {
        let reason = format!(
            "expected Percent Complete of 14000 to rise while a transfer is in progress; all {} reports in {:.0} s have {percent}, and no end came",
            reports.len(),
            reported.as_secs_f64()
        );
        if view.live {
            found.fail(last, reason);
        } else {
            found.warn(last, reason);
        }
    }
    true
}

/// A transfer that took its time, and was complete, has reported more than one percentage on its way. Not judged where it
/// was soon done and the reports came at its beginning only.
fn progress_rises(view: &View<'_>, found: &mut Found) {
    let mut open = Transfers::new();
    let (mut commands, mut judged) = (view.requests().peekable(), false);
    for seen in view.once().filter(|seen| seen.kind() == 14000) {
        while let Some(command) = commands.next_if(|command| command.at <= seen.at) {
            // Another command begins another transfer, or is a repetition: then less is judged.
            if command.kind() == 13000 {
                let to = (command.piece.destination.0, command.socket);
                open.retain(|known, reports| {
                    let before = known.0 == to;
                    judged |= before && judge_endless(view, reports, found);
                    !before
                });
            }
        }
        let Some(status) = seen.raw("Status") else {
            continue;
        };
        // Edition 2.5 does not name the mode.
        let mode = seen.raw("Mission Plan Mode").unwrap_or_default();
        let key = (ends(seen), seen.piece.destination.0, mode);
        if status == 0 {
            open.entry(key).or_default().push(seen.clone());
            continue;
        }
        let Some(reports) = open.remove(&key).filter(|_| status == 1) else {
            continue;
        };
        let (reported, took) = lasted(&reports, seen.at);
        let throughout = reported * 2 >= took;
        let often = reports.len() >= RISING_BY && throughout;
        if !often && took < LONG {
            continue;
        }
        judged = true;
        found.saw();
        let Some(percent) = one_percentage(&reports) else {
            continue;
        };
        let reason = format!(
            "expected Percent Complete of 14000 to rise on the way; all {} reports in {:.1} s of a transfer have {percent}",
            reports.len(),
            took.as_secs_f64()
        );
        // Reports at the beginning alone may be right, and none has to follow. As without an end, in a recording a link may have been
        // lost on the way, or reports on their way to the recorder.
        if often || (view.live && throughout) {
            found.fail(seen, reason);
        } else {
            found.warn(seen, reason);
        }
    }
    for reports in open.values() {
        judged |= judge_endless(view, reports, found);
    }
    if !judged {
        found.missed(format!(
            "no transfer with {RISING_BY} or more reports in progress through most of its time, or of {} s",
            LONG.as_secs()
        ));
    }
}

fn limits_make_sense(view: &View<'_>, found: &mut Found) {
    for seen in view
        .messages()
        .filter(|seen| matches!(seen.kind(), 41000 | 41001 | 41003))
    {
        if seen.raw("Field Supported") == Some(0) {
            continue;
        }
        let chains: [&[&str]; 3] = [
            &["Min Value", "Default Value", "Max Value"],
            &[
                "Min Value",
                "Min Display Value",
                "Max Display Value",
                "Max Value",
            ],
            &[
                "Low Warning Limit",
                "Low Caution Limit",
                "High Caution Limit",
                "High Warning Limit",
            ],
        ];
        for chain in chains {
            let values: Vec<(&str, f64)> = chain
                .iter()
                .filter_map(|name| Some((*name, seen.value(name)?)))
                .collect();
            for pair in values.windows(2) {
                let [(low, a), (high, b)] = pair else {
                    continue;
                };
                // Edition 2.5 always sends the display range, also where there is no display.
                let undisplayed = seen.value("Max Display Value") == Some(0.0)
                    && seen.value("Min Display Value") == Some(0.0);
                if undisplayed && (low.contains("Display") || high.contains("Display")) {
                    continue;
                }
                // Some subjects mean "no limit" by 0 on both sides.
                found.check(
                    seen,
                    a <= b
                        || a.is_nan()
                        || b.is_nan()
                        || (chain[0] == "Low Warning Limit" && (*a == 0.0 || *b == 0.0)),
                    || {
                        format!(
                            "expected {low} <= {high} for field {} of message {}; got {a} and {b}",
                            seen.raw("Requested Field").unwrap_or_default(),
                            seen.raw("Requested Message").unwrap_or_default()
                        )
                    },
                );
            }
        }
    }
}

fn generic_lists_are_not_altered(view: &View<'_>, found: &mut Found) {
    for seen in view.messages().filter(|seen| seen.kind() == 41002) {
        let (Some(message), Some(field)) =
            (seen.raw("Requested Message"), seen.raw("Requested Field"))
        else {
            continue;
        };
        if seen.raw("Field Supported") == Some(0) {
            found.saw();
            continue;
        }
        let Some(index) = seen.raw("Vehicle Specific Enumeration Index") else {
            continue;
        };
        let info = u16::try_from(message)
            .ok()
            .and_then(stanag_msgs::table::message);
        // Fields are counted from 1, the time stamp being the first.
        let values = info
            .and_then(|info| info.fields.get(usize::try_from(field - 1).ok()?))
            .and_then(|field| field.enumeration);
        let generic = values.and_then(|values| values.text(index));
        let text = seen
            .text("Vehicle Specific Enumeration Text")
            .unwrap_or_default();
        let counted = seen.raw("Vehicle Specific Enumeration Count").unwrap_or(1) > 0;
        found.check(seen, generic.is_none() || text.is_empty() || !counted, || {
            format!("expected 41002 to describe vehicle-specific values only; index {index} of field {field} of message {message} is generic ({}) and described as {text:?}", generic.unwrap_or_default())
        });
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bench::net::Datagram;
    use crate::passive::view::trace::{received, sent};
    use crate::passive::view::{verdict_on, verdict_on_recorded};
    use crate::verdict::Verdict;
    use crate::wire::Draft;

    fn report(status: i64, percent: i64) -> Draft {
        Draft::new(14000)
            .raw("Status", status)
            .raw("Percent Complete", percent)
    }

    /// A load whose reports in progress come at these times, in ms, with these percentages, and that is complete after 1 s.
    fn load(reports: &[(u64, i64)]) -> Verdict {
        load_until(reports, Some(1_000))
    }

    /// The same, complete at this time, in ms, or never.
    fn load_until(reports: &[(u64, i64)], end_ms: Option<u64>) -> Verdict {
        verdict_on(&loaded(reports, end_ms), progress_rises)
    }

    fn loaded(reports: &[(u64, i64)], end_ms: Option<u64>) -> Vec<Datagram> {
        let report =
            |status: i64, percent: i64| report(status, percent).raw("Mission Plan Mode", 2);
        let command = Draft::new(13000).raw("Mission Plan Mode", 2);
        let mut run = vec![sent(100, command)];
        run.extend(
            (reports.iter()).map(|&(at_ms, percent)| received(at_ms + 200, report(0, percent))),
        );
        run.extend(end_ms.map(|at_ms| received(at_ms + 200, report(1, 100))));
        run
    }

    #[test]
    fn progress_is_made_on_the_way() {
        assert_eq!(load(&[(0, 0), (300, 40), (700, 80)]), Verdict::Pass);
        assert_eq!(load(&[(0, 0), (300, 0), (700, 0)]), Verdict::Fail);
        assert_eq!(load(&[(0, 100), (300, 100), (700, 100)]), Verdict::Fail);
        // Too few, or at the beginning only: a subject that reports seldom is not judged.
        assert_eq!(load(&[(0, 0), (700, 0)]), Verdict::Inconclusive);
        assert_eq!(load(&[(0, 0), (10, 0), (20, 0)]), Verdict::Inconclusive);
        assert_eq!(load(&[]), Verdict::Inconclusive);
    }

    #[test]
    fn a_long_wait_at_one_percentage_is_judged_by_few_reports() {
        let long = |reports: &[(u64, i64)]| load_until(reports, Some(25_000));
        // Nobody has to report more often.
        assert_eq!(long(&[(0, 0)]), Verdict::Warning);
        assert_eq!(long(&[(0, 0), (10, 0), (20, 0)]), Verdict::Warning);
        assert_eq!(long(&[(0, 0), (13_000, 0)]), Verdict::Fail);
        assert_eq!(long(&[(0, 0), (9_000, 50)]), Verdict::Pass);
        // Nothing is reported while a subject has nothing to report.
        assert_eq!(long(&[]), Verdict::Inconclusive);
        // In a recording the link to the vehicle may have been lost meanwhile.
        let recorded = |reports: &[(u64, i64)], end_ms| {
            verdict_on_recorded(&loaded(reports, Some(end_ms)), progress_rises)
        };
        assert_eq!(recorded(&[(0, 0)], 25_000), Verdict::Warning);
        let seldom = [(0, 0), (13_000, 0)];
        assert_eq!(recorded(&seldom, 25_000), Verdict::Warning);
        let often = [(0, 0), (10_000, 0), (20_000, 0)];
        assert_eq!(recorded(&often, 25_000), Verdict::Fail);
    }

    #[test]
    fn a_transfer_that_stays_at_one_percentage_for_ever_is_judged() {
        let endless = |percent: fn(u64) -> u64, seconds: u64| {
            let reports: Vec<(u64, i64)> = (0..=seconds / 5)
                .map(|step| (step * 5_000, percent(step) as i64))
                .collect();
            load_until(&reports, None)
        };
        assert_eq!(endless(|_| 0, 40), Verdict::Fail);
        assert_eq!(endless(|step| step, 40), Verdict::Pass);
        // The link to the vehicle may be lost for a while.
        assert_eq!(endless(|_| 0, 20), Verdict::Inconclusive);
    }

    fn heartbeats(times_ms: &[u64]) -> Verdict {
        let all: Vec<_> = (times_ms.iter())
            .map(|&at_ms| received(at_ms, Draft::new(16_002)))
            .collect();
        verdict_on(&all, heartbeat_at_1_hz)
    }

    #[test]
    fn a_heartbeat_that_is_lost_or_late_is_no_other_period() {
        let every = |step_ms: u64, count: u64| -> Vec<u64> {
            (0..count).map(|step| step * step_ms).collect()
        };
        assert_eq!(heartbeats(&every(1_000, 8)), Verdict::Pass);
        let mut lossy = every(1_000, 8);
        lossy.remove(3);
        assert_eq!(heartbeats(&lossy), Verdict::Pass);
        assert_eq!(heartbeats(&[0, 1_000, 3_000, 4_000]), Verdict::Pass);
        let mut late = every(1_000, 10);
        late[4] += 300;
        assert_eq!(heartbeats(&late), Verdict::Pass);
        for step_ms in [300, 400, 2_000] {
            assert_eq!(heartbeats(&every(step_ms, 8)), Verdict::Fail, "{step_ms}");
        }
        // In pairs every two seconds.
        let pairs: Vec<u64> = (0..8)
            .map(|step| step / 2 * 2_000 + step % 2 * 10)
            .collect();
        assert_eq!(heartbeats(&pairs), Verdict::Fail);
        // One gap is too little to judge.
        assert_eq!(heartbeats(&[0, 2_000]), Verdict::Inconclusive);
    }

    /// What is found in alerts of these vehicles with these numbers, a second apart, in a run and in a recording.
    fn alerts(all: &[(u32, i64)]) -> [Verdict; 2] {
        let all: Vec<_> = (0..)
            .zip(all)
            .map(|(step, &(vehicle, number))| {
                let mut draft = Draft::new(16000).raw("Alert (Warning) ID", number);
                draft.source = Some(Id(0x1b00_0101 + vehicle));
                received(step * 1_000, draft)
            })
            .collect();
        let judge = first_alert_negative_update_positive;
        [verdict_on(&all, judge), verdict_on_recorded(&all, judge)]
    }

    #[test]
    fn alerts_are_counted_by_each_vehicle_and_from_the_beginning_after_a_restart() {
        assert_eq!(alerts(&[(0, -1), (0, 1), (0, -2)]), [Verdict::Pass; 2]);
        assert_eq!(alerts(&[(0, -1), (1, -1), (1, 1)]), [Verdict::Pass; 2]);
        // A restart cannot be seen in a recording, and is no part of a run.
        let again = [(0, -1), (0, -2), (0, -1)];
        assert_eq!(alerts(&again), [Verdict::Fail, Verdict::Warning]);
        assert_eq!(alerts(&[(0, 1)]), [Verdict::Fail, Verdict::Pass]);
    }

    /// What is found in 14000s of a load: when, of which vehicle, with which status and percentage.
    fn loads(reports: &[(u64, u32, i64, i64)]) -> [Verdict; 2] {
        let all: Vec<_> = (reports.iter())
            .map(|&(at_ms, vehicle, status, percent)| {
                let mut draft = report(status, percent).raw("Mission Plan Mode", 2);
                draft.source = Some(Id(0x1b00_0101 + vehicle));
                received(at_ms, draft)
            })
            .collect();
        let judge = progress_is_between_0_and_100;
        [verdict_on(&all, judge), verdict_on_recorded(&all, judge)]
    }

    #[test]
    fn a_transfer_is_that_of_one_vehicle() {
        let falls = [(0, 0, 0, 60), (100, 0, 0, 30), (200, 0, 1, 100)];
        assert_eq!(loads(&falls), [Verdict::Fail; 2]);
        let two = [(0, 0, 0, 60), (100, 1, 0, 30), (200, 0, 1, 100)];
        assert_eq!(loads(&two), [Verdict::Pass; 2]);
        let both_ends = [(0, 0, 1, 100), (100, 0, 2, 100)];
        assert_eq!(loads(&both_ends), [Verdict::Fail; 2]);
        // Another load, whose 13000 is not in the recording.
        let later = [(0, 0, 1, 100), (60_000, 0, 0, 0), (61_000, 0, 2, 0)];
        assert_eq!(loads(&later), [Verdict::Fail, Verdict::Pass]);
        let begun_again = [(0, 0, 0, 60), (60_000, 0, 0, 0)];
        assert_eq!(loads(&begun_again), [Verdict::Fail, Verdict::Pass]);
    }

    #[test]
    fn progress_that_was_overtaken_or_doubled_is_no_fall() {
        let of = |at_ms: u64, stamp: i64, percent: i64| {
            received(at_ms, report(0, percent).raw("Time Stamp", stamp))
        };
        let run = [
            of(0, 10, 20),
            of(50, 60, 60),
            of(60, 40, 40),
            of(70, 10, 20),
            of(80, 80, 80),
        ];
        assert_eq!(
            verdict_on(&run, progress_is_between_0_and_100),
            Verdict::Pass
        );
    }

    #[test]
    fn ids_of_everybody_and_nobody_are_no_sources() {
        let from = |source: Id| {
            let mut draft = Draft::new(3001);
            draft.source = Some(source);
            verdict_on(&[received(0, draft)], form_of_ids)
        };
        assert_eq!(from(Id(0x1b00_0101)), Verdict::Pass);
        for source in [Id::BROADCAST, Id::NULL, Id(0xff00_00a0)] {
            assert_eq!(from(source), Verdict::Fail, "{source}");
        }
    }

    #[test]
    fn many_alerts_of_several_vehicles_and_their_ends_are_no_storm() {
        let alerts = |count: u64, vehicles: u64, priority: i64, text: &str| {
            let all: Vec<_> = (0..count)
                .map(|step| {
                    let mut draft = Draft::new(16000)
                        .raw("Priority", priority)
                        .text("Text", text.as_bytes());
                    draft.source = Some(Id(0x1b00_0101 + (step % vehicles) as u32));
                    received(step * 100, draft)
                })
                .collect();
            verdict_on(&all, no_storms)
        };
        assert_eq!(alerts(30, 1, 2, "LINK LOST"), Verdict::Fail);
        assert_eq!(alerts(30, 3, 2, "LINK LOST"), Verdict::Pass);
        assert_eq!(alerts(30, 1, 0, ""), Verdict::Inconclusive);
    }

    #[test]
    fn transfers_to_two_vehicles_are_judged_apart() {
        let of = |vehicle: u32, mut draft: Draft| {
            draft.source = Some(Id(vehicle));
            draft
        };
        // Two reports of each; without a mode, as in Edition 2.5.
        let run = |second: u32| {
            let first = 0x1b00_0101;
            let all = [
                (100, of(first, report(0, 0))),
                (200, of(second, report(0, 0))),
                (600, of(first, report(0, 0))),
                (700, of(second, report(0, 0))),
                (1_000, of(first, report(1, 100))),
                (1_000, of(second, report(1, 100))),
            ];
            verdict_on(
                &all.map(|(at_ms, draft)| received(at_ms, draft)),
                progress_rises,
            )
        };
        assert_eq!(run(0x1b00_0102), Verdict::Inconclusive);
        assert_eq!(run(0x1b00_0101), Verdict::Fail);
    }
}
