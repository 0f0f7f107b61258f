//! The traffic that a judge reads, and what it finds.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;
use std::time::Duration;

use stanag_msgs::Id;

use crate::bench::net::Datagram;
use crate::bench::survey::Survey;
use crate::profile::Profile;
use crate::verdict::{Judgement, Verdict, also};
use crate::wire::{Direction, Seen};

/// Kinds of findings that a reason lists at most.
const MAX_KINDS: usize = 4;

/// A judge and its rule.
pub struct Judge {
    /// Id of the rule.
    pub rule: &'static str,
    /// The judge.
    pub judge: fn(&View<'_>, &mut Found),
}

/// The traffic that is judged.
#[derive(Clone, Copy, Debug)]
pub struct View<'a> {
    /// In the order of time.
    pub datagrams: &'a [Datagram],
    /// What the subject claims.
    pub profile: &'a Profile,
    /// What the discovery showed, where there was one.
    pub survey: Option<&'a Survey>,
    /// Whether both ends have the same clock, and all that was sent is here: true in a live run, false for a capture, which
    /// may begin in the middle of anything. What has to have come before is then not known to be missing.
    pub live: bool,
    /// Whether messages of Edition 2.5 are read themselves, and not their counterparts in Edition 4.
    pub as_they_are: bool,
}

impl<'a> View<'a> {
    /// Datagrams of the subject.
    pub fn of_subject(&self) -> impl Iterator<Item = &'a Datagram> {
        self.datagrams
            .iter()
            .filter(|datagram| datagram.direction == Direction::Received)
    }

    /// Messages of the subject.
    pub fn messages(&self) -> impl Iterator<Item = &'a Arc<Seen>> {
        let as_they_are = self.as_they_are;
        self.of_subject()
            .flat_map(move |datagram| datagram.seen(as_they_are))
    }

    /// Messages of the subject without those that the network delivered twice: the same bytes, time stamp among them,
    /// at the same socket. A message without a stamp may be sent in the same bytes again.
    pub fn once(&self) -> impl Iterator<Item = &'a Arc<Seen>> {
        let mut known = BTreeSet::new();
        self.messages().filter(move |&seen| {
            let same = (seen.socket, seen.kind(), &seen.piece.bytes);
            seen.stamp().is_none() || known.insert(same)
        })
    }

    /// Those of [`once`](Self::once) that no later message of their kind and ends has overtaken on its way: what arrives
    /// late shows the state of before.
    pub fn in_order(&self) -> impl Iterator<Item = &'a Arc<Seen>> {
        let mut latest: BTreeMap<(u16, u32, u32, usize), i64> = BTreeMap::new();
        self.once().filter(move |&seen| {
            let Some(stamp) = seen.stamp() else {
                return true;
            };
            let (source, destination) = (seen.piece.source.0, seen.piece.destination.0);
            let latest = latest
                .entry((seen.kind(), source, destination, seen.socket))
                .or_insert(stamp);
            let overtaken = (1..OVERTAKEN_MS).contains(&(*latest - stamp));
            if !overtaken {
                *latest = stamp;
            }
            !overtaken
        })
    }

    /// Messages to the subject.
    pub fn requests(&self) -> impl Iterator<Item = &'a Arc<Seen>> {
        let as_they_are = self.as_they_are;
        self.datagrams
            .iter()
            .filter(|datagram| datagram.direction == Direction::Sent)
            .flat_map(move |datagram| datagram.seen(as_they_are))
    }

    /// Ids of vehicles: from the discovery, or sources of responses.
    #[must_use]
    pub fn vehicles(&self) -> Vec<Id> {
        match self.survey {
            Some(survey) => survey.vehicle_ids().collect(),
            None => {
                let mut ids: Vec<Id> = self
                    .messages()
                    .filter(|seen| seen.kind() == 2)
                    .map(|seen| seen.piece.source)
                    .collect();
                ids.sort();
                ids.dedup();
                ids
            }
        }
    }

    /// VSM ids as messages 2 and 3 name them.
    #[must_use]
    pub fn vsm_ids(&self) -> Vec<Id> {
        let mut ids: Vec<Id> = self
            .messages()
            .filter(|seen| matches!(seen.kind(), 2 | 3))
            .filter_map(|seen| seen.raw("VSM ID"))
            .map(|raw| Id(raw as u32))
            .collect();
        ids.extend(
            self.profile
                .subject
                .vsm_id
                .iter()
                .filter_map(|id| id.parse::<Id>().ok()),
        );
        ids.sort();
        ids.dedup();
        ids
    }
}

/// No network delivers a message this much later than one that was sent after it, ms: a stamp that falls by more is that of
/// a clock.
pub(super) const OVERTAKEN_MS: i64 = 5_000;
/// Within this time a value that returns is one of two that are named beside each other; after it, a vehicle may have been
/// configured again.
const RETURNS_WITHIN: Duration = Duration::from_secs(60);

/// What is named of one vehicle over time: each value, and when it was named last; the present one is the last.
#[derive(Debug)]
pub(super) struct History<T> {
    values: Vec<(T, Duration)>,
}

impl<T> Default for History<T> {
    fn default() -> Self {
        Self { values: Vec::new() }
    }
}

/// A value that differs from the one before.
#[derive(Debug)]
pub(super) struct Change<T> {
    /// The one before.
    pub(super) from: T,
    /// How long ago it was named before, where it was.
    returns_after: Option<Duration>,
}

impl<T: Clone + PartialEq> History<T> {
    /// Takes what is named at this time.
    pub(super) fn take(&mut self, value: T, at: Duration) -> Option<Change<T>> {
        let from = self.values.last().map(|(value, _)| value.clone());
        let known = self.values.iter().position(|(known, _)| *known == value);
        let before = known.map(|place| self.values.remove(place).1);
        let from = from.filter(|from| *from != value);
        self.values.push((value, at));
        Some(Change {
            from: from?,
            returns_after: before.map(|before| at.saturating_sub(before)),
        })
    }
}

impl<T> Change<T> {
    /// Whether the value was named before. In a recording only soon before: a vehicle may have been configured twice in it.
    pub(super) fn returns(&self, view: &View<'_>) -> bool {
        self.returns_after
            .is_some_and(|after| view.live || after < RETURNS_WITHIN)
    }

    /// Judges the change of what never changes while a vehicle is connected. A recording may contain a restart of the VSM
    /// with another configuration, and a logical id may stand for another vehicle: there one change is only remarkable, and
    /// two values beside each other are a fault.
    pub(super) fn judge(
        &self,
        view: &View<'_>,
        seen: &Arc<Seen>,
        found: &mut Found,
        reason: String,
    ) {
        let fixed = view.live && seen.piece.source.owner() != LOGICAL;
        if fixed || self.returns(view) {
            found.fail(seen, reason);
        } else {
            found.warn(seen, reason);
        }
    }
}

/// The owner code of logical ids, which stand for whatever vehicle is connected.
const LOGICAL: u8 = 0;

/// Messages of one kind from one vehicle at one socket belong together.
pub(super) type Ends = (u32, usize);

pub(super) fn ends(seen: &Seen) -> Ends {
    (seen.piece.source.0, seen.socket)
}

/// How many observations of one thing were wrong, and the last wrong one.
#[derive(Default)]
pub(super) struct Tally {
    looks: usize,
    wrong: usize,
    last: Option<Arc<Seen>>,
}

impl Tally {
    pub(super) fn look(&mut self, seen: &Arc<Seen>, right: bool) {
        self.looks += 1;
        if !right {
            self.wrong += 1;
            self.last = Some(seen.clone());
        }
    }

    /// Fails where nearly all observations were wrong: single ones are gusts, or two reports of different moments. False
    /// where there were too few to judge.
    pub(super) fn judge(self, found: &mut Found, fewest: usize, reason: &str) -> bool {
        self.judge_by(found, fewest, 8, reason)
    }

    /// The same where more than so many of ten observations have to be wrong.
    pub(super) fn judge_by(
        self,
        found: &mut Found,
        fewest: usize,
        tenths: usize,
        reason: &str,
    ) -> bool {
        if self.looks < fewest {
            return false;
        }
        found.saw();
        if self.wrong * 10 > self.looks * tenths
            && let Some(last) = &self.last
        {
            found.fail(
                last,
                format!("{reason} ({} of {} times)", self.wrong, self.looks),
            );
        }
        true
    }
}

/// What a judge found.
#[derive(Debug, Default)]
pub struct Found {
    seen: usize,
    missing: Vec<String>,
    fails: Vec<(String, Option<Arc<Seen>>)>,
    warnings: Vec<(String, Option<Arc<Seen>>)>,
}

impl Found {
    /// Notes that something which the rule is about occurred.
    pub fn saw(&mut self) {
        self.seen += 1;
    }

    /// Notes what could not be judged, and why: too little of it occurred, or too weakly.
    pub fn missed(&mut self, what: impl Into<String>) {
        let what = what.into();
        if !self.missing.contains(&what) {
            self.missing.push(what);
        }
    }

    /// Whether anything was judged, and what was not.
    #[must_use]
    pub fn looked(&self) -> (bool, &[String]) {
        let any = self.seen > 0 || !self.fails.is_empty() || !self.warnings.is_empty();
        (any, &self.missing)
    }

    /// The rule is broken, as this message shows.
    pub fn fail(&mut self, seen: &Arc<Seen>, reason: impl Into<String>) {
        self.fails.push((reason.into(), Some(seen.clone())));
    }

    /// The rule is broken by bytes that are not a message.
    pub fn fail_at(&mut self, datagram: &Datagram, reason: impl Into<String>) {
        let reason = format!(
            "{} (datagram {})",
            reason.into(),
            crate::wire::hex(&datagram.bytes[..datagram.bytes.len().min(64)])
        );
        self.fails
            .push((reason, datagram.originals.first().cloned()));
    }

    /// An odd but lawful value.
    pub fn warn(&mut self, seen: &Arc<Seen>, reason: impl Into<String>) {
        self.warnings.push((reason.into(), Some(seen.clone())));
    }

    /// Fails unless `holds`; either way what the rule is about has occurred.
    pub fn check(&mut self, seen: &Arc<Seen>, holds: bool, reason: impl FnOnce() -> String) {
        self.saw();
        if !holds {
            self.fail(seen, reason());
        }
    }

    /// The judgement with its messages. Of many similar findings the first is shown, with their number, then one of
    /// each other kind.
    #[must_use]
    pub fn judgement(self) -> (Judgement, Vec<Arc<Seen>>) {
        let (verdict, found) = if !self.fails.is_empty() {
            (Verdict::Fail, self.fails)
        } else if !self.warnings.is_empty() {
            (Verdict::Warning, self.warnings)
        } else if self.seen > 0 {
            return (Judgement::pass(), Vec::new());
        } else {
            let reason = if self.missing.is_empty() {
                "nothing that this rule is about occurred in the traffic".to_owned()
            } else {
                self.missing.join("; ")
            };
            let reason = format!("not seen: {reason}");
            return (Judgement::new(Verdict::Inconclusive, reason), Vec::new());
        };
        let more = if found.len() > 1 {
            format!(" (and {} more)", found.len() - 1)
        } else {
            String::new()
        };
        let mut reason = format!("{}{more}", found[0].0);
        // Findings that differ only in numbers are of one kind.
        let kind =
            |text: &str| -> String { text.chars().filter(|c| !c.is_ascii_digit()).collect() };
        let mut kinds = vec![kind(&found[0].0)];
        for (text, _) in &found {
            if kinds.len() < MAX_KINDS && !kinds.contains(&kind(text)) {
                kinds.push(kind(text));
                reason = also(&reason, text);
            }
        }
        let evidence = found
            .into_iter()
            .filter_map(|(_, seen)| seen)
            .take(5)
            .collect();
        (Judgement::new(verdict, reason), evidence)
    }
}

/// What a judge finds in these datagrams of a live run.
#[cfg(test)]
pub(super) fn verdict_on(datagrams: &[Datagram], judge: fn(&View<'_>, &mut Found)) -> Verdict {
    verdict(datagrams, true, judge)
}

/// What a judge finds in these datagrams of a recording.
#[cfg(test)]
pub(super) fn verdict_on_recorded(
    datagrams: &[Datagram],
    judge: fn(&View<'_>, &mut Found),
) -> Verdict {
    verdict(datagrams, false, judge)
}

#[cfg(test)]
fn verdict(datagrams: &[Datagram], live: bool, judge: fn(&View<'_>, &mut Found)) -> Verdict {
    let view = View {
        datagrams,
        profile: &Profile::default(),
        survey: None,
        live,
        as_they_are: false,
    };
    let mut found = Found::default();
    judge(&view, &mut found);
    found.judgement().0.verdict
}

/// Messages of a vehicle and of a CUCS for the tests of judges. The time stamp is the time, where a draft has none.
#[cfg(test)]
pub(super) mod trace {
    use std::time::Duration;

    use stanag_msgs::Id;

    use crate::bench::net::Datagram;
    use crate::wire::{Direction, Draft};

    const VEHICLE: Id = Id(0x1b00_0101);
    const CUCS: Id = Id(0x1b00_00a0);

    /// The same datagrams from and to computers that a network connects.
    pub(in crate::passive) fn by_network(mut datagrams: Vec<Datagram>) -> Vec<Datagram> {
        for datagram in &mut datagrams {
            datagram.local = ([10, 0, 0, 2], 1).into();
            datagram.remote = ([10, 0, 0, 1], 2).into();
        }
        datagrams
    }

    /// A message that the subject sent: the vehicle, unless `draft` names another source.
    pub(in crate::passive) fn received(at_ms: u64, draft: Draft) -> Datagram {
        datagram(at_ms, Direction::Received, draft, (VEHICLE, CUCS))
    }

    /// A message that the subject was sent, by the CUCS unless `draft` names another source.
    pub(in crate::passive) fn sent(at_ms: u64, draft: Draft) -> Datagram {
        datagram(at_ms, Direction::Sent, draft, (CUCS, VEHICLE))
    }

    /// A message of a CUCS that is the subject.
    pub(in crate::passive) fn of_cucs(at_ms: u64, draft: Draft) -> Datagram {
        datagram(at_ms, Direction::Received, draft, (CUCS, VEHICLE))
    }

    /// A message of the vehicle to a CUCS that is the subject.
    pub(in crate::passive) fn to_cucs(at_ms: u64, draft: Draft) -> Datagram {
        datagram(at_ms, Direction::Sent, draft, (VEHICLE, CUCS))
    }

    fn datagram(
        at_ms: u64,
        direction: Direction,
        draft: Draft,
        (source, destination): (Id, Id),
    ) -> Datagram {
        let draft = if draft.has("Time Stamp") {
            draft
        } else {
            draft.raw("Time Stamp", at_ms as i64)
        };
        let at = Duration::from_millis(at_ms);
        let ends = (([127, 0, 0, 1], 1).into(), ([127, 0, 0, 1], 2).into());
        let bytes = draft.encode(source, destination, 32, 1);
        Datagram::new((at, at), direction, 0, ends, bytes, None)
    }
}
