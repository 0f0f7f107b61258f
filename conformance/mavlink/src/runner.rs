//! The run: which rules are judged, repetition, liveness, and the judges of passive rules at the end.

use conformance::bench::remarks::repeated;
use conformance::catalogue::{Hazard, Listed};
use conformance::report::RuleReport;
use conformance::verdict::{Judged, Judgement, Verdict};
use conformance::wire::Direction;

use crate::bench::{Bench, Peer, Trial};
use crate::catalogue::{Catalogue, NEEDS, Role, Rule};
use crate::passive::{JUDGES, View};
use crate::scene::Scene;

/// What is run.
#[derive(Clone, Debug, Default)]
pub struct Options {
    /// Only these rules; all where empty.
    pub rules: Vec<String>,
    /// Only rules of signing.
    pub signed_only: bool,
    /// Whether a broken "should" is a fail.
    pub strict: bool,
    /// Whether a fail is repeated.
    pub repeat: bool,
}

impl Options {
    /// Whether this rule was requested.
    #[must_use]
    pub fn wants(&self, rule: &Rule) -> bool {
        (self.rules.is_empty() || self.rules.contains(&rule.id))
            && (!self.signed_only || matches!(rule.group(), "SIGN" | "KEY"))
    }
}

/// Frames of evidence.
const MAX_EVIDENCE: usize = 40;
/// Telemetry, which is left out of evidence.
const TELEMETRY: [&str; 3] = ["HEARTBEAT", "STATUSTEXT", "MISSION_CURRENT"];

/// A run in progress.
pub struct Run<'a> {
    /// Who is judged.
    pub role: Role,
    /// The bench.
    pub bench: &'a Bench,
    /// The catalogue.
    pub catalogue: &'a Catalogue,
    /// What is run.
    pub options: &'a Options,
    /// Called with each judged rule.
    pub show: &'a mut dyn FnMut(&RuleReport),
}

impl Run<'_> {
    /// Plays these scenes in their order, then judges the passive rules; returns reports in the order of the
    /// catalogue.
    pub fn rules(&mut self, peer: &Peer, scenes: &[&Scene]) -> Vec<RuleReport> {
        let mut judged: Vec<RuleReport> = Vec::new();
        let mut dead: Option<String> = None;
        for Scene { rule: id, play } in scenes.iter().copied() {
            let Some(rule) = self
                .catalogue
                .find(id)
                .filter(|rule| self.options.wants(rule) && rule.subjects.contains(&self.role))
            else {
                continue;
            };
            let mut report = rule.report();
            if let Some(judgement) = self.barred(rule) {
                (report.verdict, report.reason) = (judgement.verdict, judgement.reason);
            } else if self.bench.net.interrupted() {
                (report.verdict, report.reason) = (Verdict::Inconclusive, "interrupted".into());
            } else if let Some(cause) = &dead {
                (report.verdict, report.reason) = (Verdict::Inconclusive, cause.clone());
            } else if Trial::new(self.bench, peer).armed() {
                (report.verdict, report.reason) = (
                    Verdict::Inconclusive,
                    "the vehicle is armed: nothing more is sent to it".into(),
                );
            } else {
                self.judge(rule, *play, peer, &mut report);
                if matches!(
                    report.verdict,
                    Verdict::Fail | Verdict::Flaky | Verdict::Inconclusive
                ) && self.role == Role::Autopilot
                    && !self.bench.net.interrupted()
                    && !Trial::new(self.bench, peer).answers(peer)
                    && !self.revived(peer)
                {
                    dead = Some(format!(
                        "the subject has answered no honest request since {id}"
                    ));
                    report
                        .notes
                        .push("the subject answers no honest request after it".into());
                }
            }
            (self.show)(&report);
            judged.push(report);
        }
        self.judge_passive(&mut judged);
        let mut reports = Vec::new();
        for rule in &self.catalogue.rule {
            if !self.options.wants(rule) || !rule.subjects.contains(&self.role) {
                continue;
            }
            let found = judged.iter().find(|report| report.id == rule.id).cloned();
            reports.push(found.unwrap_or_else(|| RuleReport {
                verdict: Verdict::Inconclusive,
                reason: "not seen: nothing that this rule is about occurred".into(),
                ..rule.report()
            }));
        }
        reports
    }

    fn revived(&self, peer: &Peer) -> bool {
        let Some(command) = &self.bench.restart else {
            return false;
        };
        conformance::means::shell(command).is_ok()
            && (0..5).any(|_| Trial::new(self.bench, peer).answers(peer))
    }

    /// Why a rule is not played.
    fn barred(&self, rule: &Rule) -> Option<Judgement> {
        let bench = self.bench;
        for need in &rule.needs {
            let there = match need.as_str() {
                "key" => bench.net.key().is_some(),
                "second" => bench.second.is_some(),
                "restart" => bench.restart.is_some(),
                "logs" => !bench.logs.is_empty(),
                "phrase" => bench.phrase.is_some(),
                "setup-signing" => bench.setup_signing,
                "system-time" => bench.system_time,
                _ => true,
            };
            if !there {
                let how = NEEDS
                    .iter()
                    .find(|(name, _)| name == need)
                    .map_or("", |(_, how)| how);
                return Some(Judgement::new(
                    Verdict::NotApplicable,
                    format!("needs {how}"),
                ));
            }
        }
        if rule.hazard != Hazard::None && !bench.hazards.contains(&rule.hazard) {
            return Some(Judgement::new(
                Verdict::Skipped,
                format!(
                    "a faulty subject could be a hazard ({}): state that the vehicle is simulated (--simulated), or release it with --allow",
                    rule.hazard
                ),
            ));
        }
        None
    }

    fn judge(
        &self,
        rule: &Rule,
        play: fn(&Trial<'_>) -> Judged,
        peer: &Peer,
        report: &mut RuleReport,
    ) {
        let (began, first) = (self.bench.net.now(), self.bench.net.datagrams());
        let first_attempt = self.attempt(play, peer, report);
        // A rule that may leave the subject changed is not played three times.
        let repeats = self.options.repeat && rule.hazard < Hazard::Destructive;
        let mut attempts = Vec::new();
        let judgement = repeated(first_attempt, &mut attempts, || {
            let possible = repeats && !self.bench.net.interrupted();
            possible.then(|| self.attempt(play, peer, report))
        });
        report.attempts.extend(attempts);
        let judgement = judgement.at_level(rule.level, self.options.strict);
        (report.verdict, report.reason) = (judgement.verdict, judgement.reason);
        report.duration_s = (self.bench.net.now() - began).as_secs_f64();
        report.datagrams = Some((first, self.bench.net.datagrams()));
    }

    fn attempt(
        &self,
        play: fn(&Trial<'_>) -> Judged,
        peer: &Peer,
        report: &mut RuleReport,
    ) -> Judgement {
        let trial = Trial::new(self.bench, peer);
        let judgement = trial.judge(|| play(&trial));
        report.notes.extend(trial.notes());
        report.evidence = self.evidence(&trial, judgement.verdict == Verdict::Pass);
        judgement
    }

    fn evidence(&self, trial: &Trial<'_>, passed: bool) -> Vec<serde_json::Value> {
        let wanted = if passed {
            MAX_EVIDENCE / 8
        } else {
            MAX_EVIDENCE
        };
        let frames = self.bench.net.all(trial.mark, |seen| {
            seen.direction == Direction::Sent
                || seen.frame.target().is_some()
                || !TELEMETRY.iter().any(|name| seen.frame.is(name)) && seen.frame.is("PARAM_VALUE")
        });
        let chosen = trial.evidence(frames, wanted, |seen| seen.at);
        chosen.iter().map(|seen| seen.evidence()).collect()
    }

    fn judge_passive(&mut self, judged: &mut Vec<RuleReport>) {
        // For an autopilot only the link that is judged: to a second link it may forward what scenes have sent in its
        // name.
        let frames = self.bench.net.all(0, |seen| {
            seen.direction == Direction::Received
                && seen.socket == self.bench.port.number
                && (seen.frame.system, seen.frame.component) == self.bench.subject
        });
        // When the first of these rules was played.
        let since = |wanted: &dyn Fn(&RuleReport) -> bool| {
            let first = judged
                .iter()
                .filter(|report| !report.attempts.is_empty() && wanted(report))
                .filter_map(|report| report.datagrams)
                .map(|(first, _)| first)
                .min()?;
            let recording = self.bench.net.recording();
            recording.datagrams.get(first).map(|datagram| datagram.at)
        };
        let view = View {
            frames: &frames,
            role: self.role,
            key: self.bench.net.key(),
            // A restart brings PX4's timestamps back to those of its key file.
            rekeyed: since(&|report| {
                report.group == "KEY"
                    || matches!(report.id.as_str(), "SIGN-007" | "SIGN-019" | "SIGN-032")
            }),
            shifted: since(&|report| matches!(report.id.as_str(), "SIGN-011" | "SIGN-012")),
            logs: &self.bench.logs,
            phrase: self.bench.phrase.as_deref(),
        };
        let mut found = Vec::new();
        for judge in JUDGES {
            let Some(rule) = self
                .catalogue
                .find(judge.rule)
                .filter(|rule| self.options.wants(rule) && rule.subjects.contains(&self.role))
            else {
                continue;
            };
            let (judgement, evidence) = (judge.judge)(&view);
            let judgement = judgement.at_level(rule.level, self.options.strict);
            found.push(RuleReport {
                verdict: judgement.verdict,
                reason: judgement.reason,
                evidence: evidence.iter().map(|seen| seen.evidence()).collect(),
                ..rule.report()
            });
        }
        for report in found {
            (self.show)(&report);
            judged.push(report);
        }
    }
}
