//! A CUCS under test: the scenarios one after the other, the steps of each, and what they prove.
//!
//! A step is done by the operator, who reads its card in the terminal or on a page ([`page`]), or by a command of the
//! profile's `[on]`. What the CUCS sent is judged from the wire; a question that only eyes can answer is recorded
//! with the name of who answered and when, as the operator's word. A step that nobody does is skipped, and reported
//! as skipped.

mod board;
mod command;
pub mod page;
mod terminal;

use std::collections::BTreeMap;
use std::net::SocketAddr;
use std::sync::Arc;
use std::time::Duration;

use serde_json::json;

pub use board::{Board, Reply};
use command::Child;
pub use terminal::listen as listen_to_terminal;

use crate::bench::net::Net;
use crate::catalogue::{Catalogue, Rule, Subject};
use crate::passive::{View, judges_of};
use crate::profile::Profile;
use crate::report::RuleReport;
use crate::scripted::{Answer, Scenario, Step, VEHICLE, Vehicle};
use crate::verdict::{Judgement, Verdict};
use crate::wire::{Direction, Seen};

/// How often the session looks at what has arrived.
const TICK: Duration = Duration::from_millis(50);
/// How long after a command's end its last datagrams may still arrive.
const LAST_WORDS: Duration = Duration::from_millis(700);
const NOT_SEEN: &str = "not seen: nothing that this rule is about occurred in the traffic";

/// A session with one CUCS.
#[derive(Debug)]
pub struct Session<'a> {
    /// The network with its recording.
    pub net: Arc<Net>,
    /// Where the scripted vehicle listens.
    pub listen: SocketAddr,
    /// The profile, with the commands of `[on]`.
    pub profile: &'a Profile,
    /// The rules.
    pub catalogue: &'a Catalogue,
    /// Where cards are shown, where there is an operator.
    pub board: Option<Arc<Board>>,
    /// Whether a broken "should" is a fail.
    pub strict: bool,
    /// Only these rules; all where empty.
    pub only: Vec<String>,
    /// How long a scenario lasts where one command plays the CUCS from beginning to end.
    pub time: Duration,
    /// Rules with their verdicts so far.
    pub rules: BTreeMap<String, RuleReport>,
    /// Remarks about the session as a whole.
    pub remarks: Vec<String>,
}

/// How a step ended.
enum Ended {
    /// The wire shows that it was done, or its time has passed.
    Done,
    /// The wire does not show that it was done.
    Missing,
    /// A question was answered, and by whom.
    Answered(Answer, String),
    /// Nobody does it, or nobody looks; with the reason.
    Left(String),
}

impl Session<'_> {
    /// Plays the scenarios in turn. Ends early where the operator stops it.
    ///
    /// # Errors
    /// The vehicle cannot listen, or the command that starts the CUCS cannot be run.
    pub fn play(&mut self, scenarios: &[Scenario]) -> Result<(), String> {
        self.expect_rules(scenarios);
        let total = scenarios.iter().map(|scenario| scenario.step.len()).sum();
        let mut number = 0;
        for scenario in scenarios {
            if self.net.interrupted() {
                self.remarks.push("interrupted by the operator".into());
                break;
            }
            let mark = self.net.mark();
            let mut vehicle = Vehicle::new(&self.net, self.listen, scenario.clone())
                .map_err(|error| format!("{}: {error}", self.listen))?;
            self.listen = vehicle.local();
            let started = match self.profile.on.get("start") {
                Some(command) => Some(self.begin(command, scenario, "start")?),
                None => None,
            };
            let scripted = self.board.is_none() && self.profile.on.keys().all(|id| id == "start");
            match (scripted, started) {
                (true, Some(mut child)) => self.serve_script(&mut vehicle, &mut child),
                (_, started) => {
                    for step in &scenario.step {
                        number += 1;
                        let ended = self.step(&mut vehicle, scenario, step, (number, total), mark);
                        self.judge_step(scenario, step, &ended);
                    }
                    vehicle.serve(self.net.now() + LAST_WORDS / 2);
                    drop(started);
                }
            }
            self.judge_traffic(scenario, mark);
        }
        if let Some(board) = &self.board {
            board.finish();
        }
        Ok(())
    }

    /// Whether anything came from a CUCS.
    #[must_use]
    pub fn answered(&self) -> bool {
        let recording = self.net.recording();
        let mut all = recording.datagrams.iter();
        all.any(|datagram| datagram.direction == Direction::Received)
    }

    fn wanted(&self, id: &str) -> Option<&Rule> {
        let edition = &self.profile.subject.edition;
        self.catalogue.find(id).filter(|rule| {
            rule.subject != Subject::Vsm
                && rule.editions.contains(edition)
                && (self.only.is_empty() || self.only.contains(&rule.id))
        })
    }

    /// Every rule of a CUCS that something here can judge is in the report, also where nothing occurs that shows it.
    fn expect_rules(&mut self, scenarios: &[Scenario]) {
        let steps = scenarios.iter().flat_map(|scenario| &scenario.step);
        let ids: Vec<String> = judges_of(&self.profile.subject.edition, Subject::Cucs)
            .iter()
            .map(|applied| applied.judge.rule.to_owned())
            .chain(steps.flat_map(|step| step.rules.clone()))
            .collect();
        for id in ids {
            if let Some(rule) = self.wanted(&id) {
                let report = RuleReport {
                    verdict: Verdict::Inconclusive,
                    reason: NOT_SEEN.into(),
                    ..RuleReport::new(rule, &self.profile.subject.edition)
                };
                self.rules.entry(id).or_insert(report);
            }
        }
    }

    fn begin(&self, command: &str, scenario: &Scenario, step: &str) -> Result<Child, String> {
        let command = command
            .replace("{scenario}", &scenario.name)
            .replace("{step}", step)
            .replace("{vsm}", &self.listen.to_string())
            .replace("{vehicle}", &VEHICLE.to_string());
        Child::begin(&command)
    }

    /// The CUCS runs its own script: the vehicle serves until the script has ended.
    fn serve_script(&self, vehicle: &mut Vehicle, child: &mut Child) {
        let end = self.net.now() + self.time;
        while self.net.now() < end && !self.net.interrupted() {
            vehicle.serve((self.net.now() + 4 * TICK).min(end));
            if child.ended().is_some() {
                vehicle.serve((self.net.now() + LAST_WORDS).min(end));
                return;
            }
        }
    }

    fn step(
        &mut self,
        vehicle: &mut Vehicle,
        scenario: &Scenario,
        step: &Step,
        number: (usize, usize),
        begin: usize,
    ) -> Ended {
        let command = self.profile.on.get(&step.id);
        // A card with neither a sign on the wire nor a question only has to last its time.
        let waits = step.done.is_none() && step.question.is_none();
        if command.is_none() && self.board.is_none() && !waits {
            return Ended::Left(format!(
                "nobody looks or acts: no operator, and no command on.{}",
                step.id
            ));
        }
        let mark = match &step.done {
            Some(done) if done.earlier => begin,
            _ => self.net.mark(),
        };
        vehicle.begin_step(&step.id);
        let began = self.net.now();
        let least = began + Duration::from_secs_f64(step.lasts_s);
        let factor = self.profile.timers.get("factor").copied().unwrap_or(1.0);
        let end = least + Duration::from_secs_f64(step.within_s * factor);
        let ended = match command {
            Some(command) => {
                if step.question.is_some() {
                    vehicle.serve(least);
                }
                match self.begin(command, scenario, &step.id) {
                    Ok(mut child) => {
                        self.step_of_command(vehicle, step, &mut child, mark, (least, end))
                    }
                    Err(error) => Ended::Left(error),
                }
            }
            None => match self.board.clone() {
                Some(board) => {
                    board.show(scenario, step, number);
                    terminal::print_card(&board.card());
                    self.step_of_operator(vehicle, step, &board, mark, (least, end))
                }
                None => {
                    vehicle.serve(least);
                    Ended::Done
                }
            },
        };
        if let (Ended::Missing, Some(done)) = (&ended, &step.done) {
            self.remarks.push(format!(
                "scenario {}, step {}: no message {} came within {:.0} s",
                scenario.name,
                step.id,
                done.message,
                (self.net.now() - began).as_secs_f64()
            ));
        }
        ended
    }

    fn step_of_command(
        &mut self,
        vehicle: &mut Vehicle,
        step: &Step,
        child: &mut Child,
        mark: usize,
        (least, end): (Duration, Duration),
    ) -> Ended {
        let status = loop {
            if self.net.now() >= end || self.net.interrupted() {
                break None;
            }
            vehicle.serve(self.net.now() + TICK);
            if let Some(status) = child.ended() {
                break Some(status);
            }
        };
        if step.question.is_some() {
            let by = format!("the command on.{}", step.id);
            return match status {
                Some(0) => Ended::Answered(Answer::Yes, by),
                Some(1) => Ended::Answered(Answer::No, by),
                Some(other) => Ended::Left(format!(
                    "{by} ended with status {other}, expected 0 for yes or 1 for no"
                )),
                None => Ended::Left(format!("{by} did not end in time")),
            };
        }
        vehicle.serve(least);
        let Some(done) = &step.done else {
            return Ended::Done;
        };
        let grace = self.net.now() + LAST_WORDS;
        while !self.shown(done, mark) {
            if self.net.now() >= grace || self.net.interrupted() {
                // The wire decides; the command's exit status only helps to explain a failure.
                let ended = match status {
                    Some(status) => format!("ended with status {status}"),
                    None => "did not end in time".into(),
                };
                self.remarks.push(format!("on.{} {ended}", step.id));
                return Ended::Missing;
            }
            vehicle.serve(self.net.now() + TICK);
        }
        Ended::Done
    }

    fn step_of_operator(
        &self,
        vehicle: &mut Vehicle,
        step: &Step,
        board: &Board,
        mark: usize,
        (least, end): (Duration, Duration),
    ) -> Ended {
        while self.net.now() < end && !self.net.interrupted() {
            vehicle.serve(self.net.now() + TICK);
            let (reply, by) = match board.take_reply() {
                None if step.question.is_some() => continue,
                None => (None, String::new()),
                Some((reply, by)) => (Some(reply), by),
            };
            match (reply, &step.question, &step.done) {
                (Some(Reply::Skip), ..) => return Ended::Left(format!("skipped by {by}")),
                (Some(Reply::Yes), Some(_), _) => return Ended::Answered(Answer::Yes, by),
                (Some(Reply::No), Some(_), _) => return Ended::Answered(Answer::No, by),
                // The wire shows whether it was done; the operator only ends the wait.
                (_, None, Some(done)) if self.net.now() >= least && self.shown(done, mark) => {
                    return Ended::Done;
                }
                (Some(_), None, None) if self.net.now() >= least => return Ended::Done,
                // A step that nothing ends, and in which nothing is to be done, ends after its time.
                (None, None, None) if step.lasts_s >= 2.0 && self.net.now() >= least => {
                    return Ended::Done;
                }
                _ => {}
            }
        }
        match (&step.question, &step.done) {
            (Some(_), _) => Ended::Left("the operator did not answer in time".into()),
            (None, Some(_)) => Ended::Missing,
            (None, None) => Ended::Done,
        }
    }

    fn shown(&self, done: &crate::scripted::Done, mark: usize) -> bool {
        let wanted = |datagram: &crate::bench::net::Datagram, seen: &Arc<Seen>| {
            datagram.direction == Direction::Received && done.shown_by(seen)
        };
        self.net.wait(mark, Duration::ZERO, wanted).is_some()
    }

    fn judge_step(&mut self, scenario: &Scenario, step: &Step, ended: &Ended) {
        let place = format!("scenario {}, step {}", scenario.name, step.id);
        let now = self.net.now();
        for id in &step.rules {
            let Some(level) = self.wanted(id).map(|rule| rule.level) else {
                continue;
            };
            let strict = self.strict;
            let Some(report) = self.rules.get_mut(id) else {
                continue;
            };
            let judgement = match ended {
                Ended::Done => Judgement::pass(),
                Ended::Missing => {
                    let kind = step.done.as_ref().map_or(0, |done| done.message);
                    Judgement::new(
                        Verdict::Fail,
                        format!(
                            "expected the CUCS to go on working ({}); no message {kind} came in {place}",
                            scenario.about
                        ),
                    )
                }
                Ended::Answered(answer, by) => {
                    let question = step.question.as_deref().unwrap_or_default();
                    report.notes.push(format!(
                        "operator's word: {:?} was answered {} by {by} at {} ({place})",
                        question,
                        answer.name(),
                        board::clock()
                    ));
                    report.evidence.push(json!({
                        "time": (now.as_secs_f64() * 1e3).round() / 1e3,
                        "direction": "operator",
                        "source": by,
                        "destination": "",
                        "id": 0,
                        "name": "operator's word",
                        "fields": { "question": question, "answer": answer.name(), "expected": step.expect.name() },
                        "hex": "",
                    }));
                    if *answer == step.expect {
                        Judgement::pass()
                    } else {
                        Judgement::new(
                            Verdict::Fail,
                            format!(
                                "expected {:?} to be answered {}; {by} answered {} ({place})",
                                question,
                                step.expect.name(),
                                answer.name()
                            ),
                        )
                    }
                }
                Ended::Left(reason) => {
                    if report.reason == NOT_SEEN {
                        (report.verdict, report.reason) =
                            (Verdict::Skipped, format!("{reason} ({place})"));
                    } else {
                        report
                            .notes
                            .push(format!("{place} was not judged: {reason}"));
                    }
                    continue;
                }
            };
            add(report, judgement.at_level(level, strict));
        }
    }

    fn judge_traffic(&mut self, scenario: &Scenario, mark: usize) {
        let datagrams = self.net.recording().datagrams[mark..].to_vec();
        let view = View {
            datagrams: &datagrams,
            profile: self.profile,
            survey: None,
            live: true,
            as_they_are: false,
        };
        for applied in judges_of(&self.profile.subject.edition, Subject::Cucs) {
            let judge = applied.judge;
            let Some(level) = self.wanted(judge.rule).map(|rule| rule.level) else {
                continue;
            };
            let (judgement, evidence) = applied.judge(&view);
            let Some(report) = self.rules.get_mut(judge.rule) else {
                continue;
            };
            if judgement.verdict == Verdict::Inconclusive {
                continue;
            }
            if add(report, judgement.at_level(level, self.strict)) {
                report.notes.push(format!("scenario {}", scenario.name));
                report
                    .evidence
                    .extend(evidence.iter().map(|seen| seen.evidence()));
                report.datagrams = Some((mark, mark + datagrams.len()));
            }
        }
    }
}

/// Adds a judgement to a rule's report; true where that changed it.
fn add(report: &mut RuleReport, judgement: Judgement) -> bool {
    let unjudged = report.reason == NOT_SEEN || report.verdict == Verdict::Skipped;
    let before = Judgement::new(report.verdict, report.reason.clone());
    let after = if unjudged {
        judgement
    } else {
        before.clone().and(judgement)
    };
    let changed = after != before;
    (report.verdict, report.reason) = (after.verdict, after.reason);
    changed
}
