//! ALERT, warnings, cautions and advisories (16000): that an alert ends with its cause, for every CUCS, that a
//! refusal has its reason, that floods of alerts stay bounded, and that active alerts are sent to a CUCS that
//! connects.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;
use std::time::Duration;

use super::scene::Scene;
use crate::bench::flight::{Plan, home, load, mode_command};
use crate::bench::station::{Station, loi};
use crate::bench::trial::Trial;
use crate::verdict::{Judged, Precondition, Stop};
use crate::wire::{Direction, Draft, Seen};

/// The subsystem of alerts about links and stations.
pub(super) const COMMS: i64 = 3;
/// The data terminals in the air and on the ground: what is wrong with a link may be theirs.
const TERMINALS: [i64; 2] = [10, 11];

pub(super) const SCENES: &[Scene] = &[
    Scene {
        rule: "ALERT-002",
        play: the_end_of_a_cause_clears_its_alert,
    },
    Scene {
        rule: "ALERT-003",
        play: the_reference_can_be_asked_for,
    },
    Scene {
        rule: "ALERT-004",
        play: a_refusal_has_a_reason,
    },
    Scene {
        rule: "ALERT-005",
        play: no_storms,
    },
    Scene {
        rule: "ALERT-006",
        play: standing_alerts_reach_the_newcomer,
    },
];

fn cut_and_restored<T>(t: &Trial, play: impl FnOnce() -> Judged<T>) -> Judged<T> {
    let means = &t.bench.profile.means;
    let (Some(cut), Some(restore)) = (&means.cut_vehicle_link, &means.restore_vehicle_link) else {
        return Err(Stop::not_applicable(
            "needs means.cut_vehicle_link and means.restore_vehicle_link in the profile",
        ));
    };
    crate::means::shell(cut).map_err(Stop::Inconclusive)?;
    let result = play();
    crate::means::shell(restore).map_err(Stop::Inconclusive)?;
    result
}

/// Its id, 0 where it has none.
fn id_of(seen: &Seen) -> i64 {
    seen.raw("Alert (Warning) ID").unwrap_or_default().abs()
}

fn priority_of(seen: &Seen) -> i64 {
    seen.raw("Priority").unwrap_or_default()
}

/// What an alert is about: its subsystem, and its text without the numbers in it.
type Cause = (Option<i64>, String);

/// What an alert is about.
pub(super) fn cause_of(seen: &Seen) -> Cause {
    let text = seen.text("Text").unwrap_or_default();
    let words = text.chars().filter(|letter| !letter.is_ascii_digit());
    (seen.raw("Subsystem ID"), words.collect())
}

/// Alerts that came before something was caused, by their ids: none of them is about it.
#[derive(Default)]
pub(super) struct Before(BTreeMap<i64, Known>);

/// An alert that came before.
#[derive(Default)]
struct Known {
    /// What its parts say.
    causes: BTreeSet<Cause>,
    /// The worst that it was.
    priority: i64,
}

impl Before {
    /// The alerts among these messages, which are in the order of time. One that was cleared meanwhile is not known: it may
    /// be about an earlier occurrence of the same cause.
    pub(super) fn of(messages: &[Arc<Seen>]) -> Self {
        let mut before = Self::default();
        for seen in messages.iter().filter(|seen| seen.kind() == 16000) {
            if seen.raw("Priority") == Some(0) {
                before.0.remove(&id_of(seen));
            } else {
                let known = before.0.entry(id_of(seen)).or_default();
                known.causes.insert(cause_of(seen));
                known.priority = known.priority.max(priority_of(seen));
            }
        }
        before
    }

    /// Whether this came before, as the same alert or in the same words. One that is worse now has a cause that is new: a
    /// weak link that is lost. An alert without an id is no other one's.
    fn has(&self, seen: &Seen) -> bool {
        let (id, cause) = (id_of(seen), cause_of(seen));
        self.0.iter().any(|(&known_id, known)| {
            (id != 0 && known_id == id || known.causes.contains(&cause))
                && priority_of(seen) <= known.priority
        })
    }

    /// Whether this is an alert of the station's vehicle, or of the VSM itself, that was not there before. An alert that
    /// is taken for the proof of something has to be such a one.
    pub(super) fn begins(&self, station: &Station, seen: &Seen) -> bool {
        let survey = station.bench().survey.get();
        let elsewhere = survey.is_some_and(|survey| {
            let mut others = survey.vehicle_ids().filter(|id| *id != station.vehicle);
            others.any(|id| id == seen.piece.source)
        });
        seen.kind() == 16000 && seen.raw("Priority") != Some(0) && !elsewhere && !self.has(seen)
    }
}

/// How long to look for alerts that come without any cause: some come every three seconds.
const CALM: Duration = Duration::from_millis(3_500);

/// The alerts since `mark`, when nothing was caused yet. A CUCS that connects is sent the active alerts, by some subjects a
/// moment later, and others come every few seconds: hence the pause.
pub(super) fn before_the_cause(t: &Trial, station: &Station, mark: usize) -> Judged<Before> {
    t.pause(CALM)?;
    Ok(Before::of(
        &station.received(mark, |seen| seen.kind() == 16000),
    ))
}

/// Whether an alert is about links and stations: its subsystem is communications or a data terminal, or is absent.
pub(super) fn about_links(seen: &Seen) -> bool {
    seen.raw("Subsystem ID")
        .is_none_or(|subsystem| subsystem == COMMS || TERMINALS.contains(&subsystem))
}

/// Whether an alert is a caution or worse.
pub(super) fn cautions(seen: &Seen) -> bool {
    seen.raw("Priority").is_some_and(|priority| priority >= 2)
}

/// How long after the loss of the vehicle the alert about it may come.
pub(super) const LOSS_REPORTED_WITHIN: Duration = Duration::from_secs(10);

/// The first alert of this kind that has begun since the link was cut, within the time that a loss may take to be reported.
pub(super) fn loss_alert(
    t: &Trial,
    station: &Station,
    mark: usize,
    before: &Before,
    wanted: impl Fn(&Seen) -> bool,
) -> Judged<Option<Arc<Seen>>> {
    let found = station.wait(mark, LOSS_REPORTED_WITHIN, |seen| {
        before.begins(station, seen) && wanted(seen)
    });
    // Other alerts of the same cause may follow it.
    t.pause(Duration::from_millis(300))?;
    Ok(found)
}

/// How long an alert about the link has to last to be taken for one that stands as long as its cause.
const LASTS: Duration = Duration::from_millis(2_500);

/// The alert that the cut of the link raised, and that stands: of those that did not come before, the first that is not
/// cleared again while the vehicle is silent. One that is about something else may come by chance, and end.
fn lasting_alert(
    t: &Trial,
    station: &Station,
    mark: usize,
    before: &Before,
    wanted: impl Fn(&Seen) -> bool,
) -> Judged<Arc<Seen>> {
    let mut ended: BTreeSet<i64> = BTreeSet::new();
    let mut of_link = None;
    for _ in 0..3 {
        let found = loss_alert(t, station, mark, before, |seen| {
            wanted(seen) && !ended.contains(&id_of(seen))
        })?;
        let Some(found) = found else { break };
        t.pause(LASTS)?;
        ended = station
            .received(mark, |seen| {
                seen.kind() == 16000 && seen.raw("Priority") == Some(0)
            })
            .iter()
            .map(|seen| id_of(seen))
            .collect();
        if !ended.contains(&id_of(&found)) {
            return Ok(found);
        }
        if about_links(&found) {
            of_link.get_or_insert(id_of(&found));
        }
    }
    Err(of_link.map_or_else(
        || Stop::inconclusive("no lasting alert came when the vehicle's link was cut"),
        |id| {
            Stop::fail(format!(
                "expected alert {id} to stand as long as the vehicle is silent; it was cleared"
            ))
        },
    ))
}

fn the_end_of_a_cause_clears_its_alert(t: &Trial) -> Judged {
    let before = t.bench.net.mark();
    let station = t.monitor()?;
    let other = t.b().ok();
    if let Some(other) = &other {
        t.grant(other, loi::LOI2)?;
    }
    let before = before_the_cause(t, &station, before)?;
    let mark = t.bench.net.mark();
    // The alert stays active as long as its cause lasts.
    let raised = cut_and_restored(t, || {
        lasting_alert(t, &station, mark, &before, |seen| {
            cautions(seen) && seen.raw("Type") == Some(1)
        })
    })?;
    t.cite(&raised);
    let id = raised.raw("Alert (Warning) ID").unwrap_or_default().abs();
    let cleared = station.wait(mark, Duration::from_secs(10), |seen| {
        seen.kind() == 16000
            && seen.raw("Priority") == Some(0)
            && seen.raw("Alert (Warning) ID") == Some(id)
    });
    t.expect(cleared.is_some(), || format!("expected alert {id} to be cleared with priority 0 once the vehicle's link was back; it was not"))?;
    // It is cleared for every CUCS that was sent it.
    let Some(other) = other else { return Ok(()) };
    let ends = |seen: &Seen, priorities: std::ops::RangeInclusive<i64>| {
        seen.kind() == 16000
            && seen
                .raw("Priority")
                .is_some_and(|priority| priorities.contains(&priority))
            && seen
                .raw("Alert (Warning) ID")
                .is_some_and(|found| found.abs() == id)
    };
    if !other.received(mark, |seen| ends(seen, 2..=5)).is_empty() {
        let cleared = other.wait(mark, t.timers().answer, |seen| ends(seen, 0..=0));
        t.expect(cleared.is_some(), || {
            format!(
                "expected the end of alert {id} at {} as well, which was sent it; it did not come",
                other.id
            )
        })?;
    }
    // A CUCS that connects after the end is not sent it.
    other.release()?;
    let Ok(b) = t.b() else { return Ok(()) };
    let mark = t.bench.net.mark();
    b.take(loi::LOI2)?;
    let stale = b.wait(mark, t.timers().answer / 2, |seen| {
        seen.kind() == 16000
            && seen.raw("Priority").is_some_and(|priority| priority > 0)
            && seen
                .raw("Alert (Warning) ID")
                .is_some_and(|found| found.abs() == id)
    });
    t.expect(stale.is_none(), || {
        format!("expected alert {id}, which was cleared, not to be sent to {} when it connects; it came", b.id)
    })
}

/// The reference is -1 where there is nothing more to request; any other is answered when 15001 names it.
fn the_reference_can_be_asked_for(t: &Trial) -> Judged {
    let a = t.controller()?;
    let mark = t.bench.net.mark();
    a.send(mode_command(17).acked());
    let Some(alert) = a.wait(mark, t.timers().answer, |seen| seen.kind() == 16000) else {
        return Err(Stop::inconclusive(
            "no alert came to the refusal of mode 17",
        ));
    };
    t.cite(&alert);
    let reference = alert.raw("Subsystem State Report Reference");
    let Some(reference) = reference.filter(|&reference| reference != -1) else {
        return Ok(());
    };
    let sent = a.send(
        Draft::new(15001)
            .raw("Subsystem State Report Reference", reference)
            .acked(),
    );
    let more = a.wait(sent.mark, t.timers().answer, |seen| {
        matches!(seen.kind(), 15_002 | 16_001 | 16_003..=16_999)
            || seen.kind() == 17000
                && seen.raw("Original Message Type") == Some(15001)
                && seen.raw("Acknowledgement Type") == Some(2)
    });
    t.expect_beside(&alert, more.is_some(), || {
        format!("expected report reference -1 in 16000 where nothing more can be asked, got {reference}, and 15001 with it brings nothing")
    })
}

/// Where an alert began that is renewed: one that has its number without the sign, and stood before.
#[derive(Debug, PartialEq)]
enum Origin {
    /// It is no renewal: it begins with this message.
    New,
    /// With a command, which was refused then.
    Command,
    /// With a request for control or a connection: it may be about that, or older.
    Unknown,
    /// By itself.
    Itself,
}

/// Where the alert of this message began, by all that came and was sent before it. A message that was sent up to `within`
/// before its first one may be its cause.
fn origin_of(before: &[Arc<Seen>], alert: &Seen, within: Duration) -> Origin {
    let number = alert.raw("Alert (Warning) ID").unwrap_or_default();
    if number <= 0 {
        return Origin::New;
    }
    let begins = |seen: &&Arc<Seen>| {
        seen.direction == Direction::Received
            && seen.kind() == 16000
            && seen.piece.source == alert.piece.source
            && seen.raw("Alert (Warning) ID") == Some(-number)
    };
    // Its number may have been that of an earlier alert, which has ended.
    let Some(first) = before.iter().rev().find(begins) else {
        return Origin::Unknown;
    };
    let mut causes = before
        .iter()
        .filter(|seen| seen.direction == Direction::Sent && seen.at <= first.at)
        .filter(|seen| first.at.saturating_sub(seen.at) <= within)
        .map(|seen| seen.kind())
        .peekable();
    if causes.peek().is_none() {
        return Origin::Itself;
    }
    if causes.any(|kind| matches!(kind, 2000..=2999 | 13_000..=13_006 | 19_000..=20_999 | 50_001..))
    {
        Origin::Command
    } else {
        Origin::Unknown
    }
}

/// The alert with the reason of what `act` has refused: one that has begun with it, and that does not come without it too.
/// A renewal of one that an earlier refusal raised is one, too; of another that stood it is none.
fn reason_of(
    t: &Trial,
    a: &Station,
    what: &str,
    act: impl FnOnce() -> Judged,
) -> Judged<Arc<Seen>> {
    // What an earlier refusal still brings comes within this time, and is the same as what this one will bring.
    t.pause(LASTS)?;
    let before = before_the_cause(t, a, t.bench.net.mark())?;
    let mark = t.bench.net.mark();
    act()?;
    let within = t.timers().answer * 2;
    let alert = a.wait(mark, within, |seen| {
        before.begins(a, seen) && seen.text("Text").is_some_and(|text| !text.is_empty())
    });
    let Some(alert) = alert else {
        return Err(Stop::fail(format!(
            "expected a 16000 with the reason after {what}; none came but what comes without it too"
        )));
    };
    let history: Vec<Arc<Seen>> = t.bench.net.recording().datagrams[..mark]
        .iter()
        .flat_map(|datagram| datagram.messages.iter().cloned())
        .collect();
    let origin = origin_of(&history, &alert, within);
    t.expect_beside(&alert, origin != Origin::Itself, || {
        format!(
            "expected a 16000 with the reason after {what}; {:?} stood before, raised by no command, and is renewed",
            alert.text("Text").unwrap_or_default()
        )
    })?;
    if origin == Origin::Unknown {
        return Err(Stop::inconclusive(format!(
            "after {what} an alert was renewed that stood before, {:?}: what raised it was not seen",
            alert.text("Text").unwrap_or_default()
        )));
    }
    t.pause(LASTS)?;
    // A reminder has the id of the alert itself.
    let later = a.collect(CALM, |seen| seen.kind() == 16000)?;
    let by_chance = later
        .iter()
        .any(|seen| cause_of(seen) == cause_of(&alert) && id_of(seen) != id_of(&alert));
    t.expect_beside(&alert, !by_chance, || {
        format!(
            "expected a 16000 with the reason after {what}; {:?} comes without it too",
            alert.text("Text").unwrap_or_default()
        )
    })?;
    Ok(alert)
}

fn a_refusal_has_a_reason(t: &Trial) -> Judged {
    let a = t.controller()?;
    let alert = reason_of(t, &a, "the refusal of mode 17", || {
        a.send(mode_command(17).acked());
        Ok(())
    })?;
    let first = alert.text("Text").unwrap_or_default();
    let home = home(t, &a)?;
    let mut gap = Plan::zigzag(&home, "WHY", &[71, 72, 73]);
    gap.points.remove(1);
    let mark = t.bench.net.mark();
    reason_of(t, &a, "the refusal of a route with a gap", || {
        match load(t, &a, &gap)?.status {
            Some(1) => Err(Stop::inconclusive("a route with a gap was accepted")),
            _ => Ok(()),
        }
    })?;
    let other = a.received(mark, |seen| {
        seen.kind() == 16000 && seen.text("Text").is_some_and(|text| text != first)
    });
    t.expect(!other.is_empty(), || {
        format!("expected a text that names the reason; the refusals of a mode and of a route with a gap both say {first:?}")
    })
}

fn no_storms(t: &Trial) -> Judged {
    let a = t.controller()?;
    let mark = t.bench.net.mark();
    let began = t.bench.net.now();
    for _ in 0..300 {
        a.send(mode_command(17));
        t.pause(Duration::from_millis(10))?;
    }
    t.pause(Duration::from_secs(1))?;
    // Not counted: the further parts of a long text, and the end of an earlier alert.
    let first = |seen: &Seen| {
        seen.kind() == 16000
            && seen.raw("Append Order").unwrap_or_default() <= 1
            && seen.raw("Priority") != Some(0)
    };
    let count = a.received(mark, first).len() as f64;
    // About two a second are allowed; where sending the 300 takes longer than the 3 s that it should, more.
    let took = (t.bench.net.now() - began).as_secs_f64();
    let most = (2.0 * took).max(20.0);
    t.expect(count <= most, || {
        format!("expected at most {most:.0} alerts in the {took:.0} s of 300 refused commands, got {count}")
    })?;
    // A flood of alerts must not keep another one from arriving.
    let storm: Vec<_> = a
        .received(mark, |seen| seen.kind() == 16000)
        .iter()
        .filter_map(|seen| seen.text("Text"))
        .collect();
    if storm.is_empty() {
        return Ok(());
    }
    let home = home(t, &a)?;
    let mut gap = Plan::zigzag(&home, "STORM", &[81, 82, 83]);
    gap.points.remove(1);
    let mark = t.bench.net.mark();
    if load(t, &a, &gap)?.status == Some(1) {
        return Ok(());
    }
    let other = a.wait(mark, t.timers().answer * 2, |seen| {
        seen.kind() == 16000 && seen.text("Text").is_some_and(|text| !storm.contains(&text))
    });
    t.expect(other.is_some(), || {
        "expected the alert about a refused route to come through after 300 refused commands; it did not".into()
    })
}

fn standing_alerts_reach_the_newcomer(t: &Trial) -> Judged {
    let before = t.bench.net.mark();
    let a = t.monitor()?;
    let before = before_the_cause(t, &a, before)?;
    let mark = t.bench.net.mark();
    cut_and_restored(t, || {
        let raised = lasting_alert(t, &a, mark, &before, |seen| seen.raw("Type") == Some(1))
            // That it is cleared too early is of another rule.
            .precondition("an alert that stands")?;
        let id = raised.raw("Alert (Warning) ID").unwrap_or_default().abs();
        let b = t.b()?;
        let late = t.bench.net.mark();
        b.take(loi::LOI2)?;
        let came = b.wait(late, t.timers().answer, |seen| {
            seen.kind() == 16000
                && seen
                    .raw("Alert (Warning) ID")
                    .is_some_and(|found| found.abs() == id)
        });
        t.expect(came.is_some(), || {
            format!(
                "expected the standing alert {id} at {} once it was granted LOI 2; it did not come",
                b.id
            )
        })?;
        // At every connection, not only the first.
        b.release()?;
        let again = t.bench.net.mark();
        b.take(loi::LOI2)?;
        let came = b.wait(again, t.timers().answer, |seen| {
            seen.kind() == 16000
                && seen
                    .raw("Alert (Warning) ID")
                    .is_some_and(|found| found.abs() == id)
        });
        t.expect(came.is_some(), || {
            format!("expected the standing alert {id} at {} when it connects again; it came the first time only", b.id)
        })
    })
}

#[cfg(test)]
mod tests {
    use stanag_msgs::Id;

    use super::*;
    use crate::wire::split;

    fn alert(id: i64, priority: i64, subsystem: i64, text: &str) -> Arc<Seen> {
        let draft = Draft::new(16000)
            .raw("Alert (Warning) ID", id)
            .raw("Priority", priority)
            .raw("Subsystem ID", subsystem)
            .text("Text", text.as_bytes());
        let bytes = draft.encode(Id(0x1b00_0101), Id(0x1b00_00a0), 32, 1);
        let piece = split(&bytes).0.remove(0);
        Arc::new(Seen::new(Duration::ZERO, 0, Direction::Received, 0, piece))
    }

    #[test]
    fn an_alert_that_came_without_the_cause_is_not_about_it() {
        let before = Before::of(&[alert(-7, 2, 2, "cabin light 1 left on")]);
        assert!(before.has(&alert(7, 2, 2, "another text")));
        assert!(before.has(&alert(-8, 2, 2, "cabin light 2 left on")));
        // The same subsystem, or the same text, alone is no sign.
        assert!(!before.has(&alert(-8, 2, 2, "battery at 15 % or less")));
        assert!(!before.has(&alert(-8, 2, 3, "cabin light 1 left on")));
    }

    #[test]
    fn an_alert_that_gets_worse_has_a_new_cause() {
        let before = Before::of(&[alert(-7, 2, COMMS, "link at 40 %"), alert(0, 2, 2, "light")]);
        assert!(before.has(&alert(7, 2, COMMS, "link at 20 %")));
        assert!(!before.has(&alert(7, 4, COMMS, "link lost")));
        // An id that is absent reads as 0, and says nothing.
        assert!(!before.has(&alert(0, 2, COMMS, "link lost")));
    }

    #[test]
    fn an_alert_that_was_cleared_before_the_cause_may_come_with_it() {
        let before = Before::of(&[
            alert(-7, 3, 3, "no data from the CUCS"),
            alert(7, 0, 3, "CUCS in control"),
        ]);
        assert!(!before.has(&alert(-8, 3, 3, "no data from the CUCS")));
    }

    /// A message at this time, in ms.
    fn at(at_ms: u64, direction: Direction, draft: &Draft) -> Arc<Seen> {
        let bytes = draft.encode(Id(0x1b00_0101), Id(0x1b00_00a0), 32, 1);
        let piece = split(&bytes).0.remove(0);
        Arc::new(Seen::new(
            Duration::from_millis(at_ms),
            0,
            direction,
            0,
            piece,
        ))
    }

    #[test]
    fn a_renewal_is_a_reason_where_a_command_raised_the_alert() {
        let raised = |at_ms: u64, id: i64| {
            let draft = Draft::new(16000).raw("Alert (Warning) ID", id);
            at(at_ms, Direction::Received, &draft)
        };
        let sent = |at_ms: u64, kind: u16| at(at_ms, Direction::Sent, &Draft::new(kind));
        let origin = |before: &[Arc<Seen>], id: i64| {
            origin_of(before, &raised(60_000, id), Duration::from_secs(4))
        };
        assert_eq!(origin(&[], -7), Origin::New);
        let refused = [sent(10_000, 2016), raised(10_100, -7)];
        assert_eq!(origin(&refused, 7), Origin::Command);
        // A light that was left on long after the last command, and is renewed in place of the reason.
        let by_itself = [sent(10_000, 2016), raised(20_000, -7)];
        assert_eq!(origin(&by_itself, 7), Origin::Itself);
        // Sent to a CUCS that connects, or its beginning was not seen.
        let connects = [sent(10_000, 1), raised(10_100, -7)];
        assert_eq!(origin(&connects, 7), Origin::Unknown);
        assert_eq!(origin(&[], 7), Origin::Unknown);
        // The number is used again.
        let again = [
            by_itself.as_slice(),
            &[sent(30_000, 13_000), raised(30_100, -7)],
        ]
        .concat();
        assert_eq!(origin(&again, 7), Origin::Command);
    }

    #[test]
    fn an_alert_about_a_link_is_of_communications() {
        assert!(about_links(&alert(-1, 2, COMMS, "")));
        // The data terminal on the ground.
        assert!(about_links(&alert(-1, 2, 11, "")));
        assert!(!about_links(&alert(-1, 2, 9, "")));
        assert!(cautions(&alert(-1, 2, COMMS, "")) && !cautions(&alert(-1, 1, COMMS, "")));
    }
}
