//! The run: order, hazards, repetition, liveness, clean-up, and the judges of passive rules at the end.
//!
//! A run begins with a discovery. It stops where another CUCS is in control. Then a tour makes traffic for the passive
//! rules, and the scenes follow, from harmless to hostile. A fail is repeated twice: unequal results are flaky. After a fail
//! the subject has to answer a discovery, or all that follows is inconclusive. A fail that may be a message which the
//! network lost is inconclusive too, and the run no success. A rule during which the subject was silent,
//! as it is while it restarts, is judged again.

use std::collections::BTreeSet;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::Arc;
use std::time::Duration;

use crate::bench::context::Bench;
use crate::bench::discovery::{TRIPS, alive, silence, survey};
use crate::bench::flight;
use crate::bench::remarks::repeated;
use crate::bench::station::{Access, loi};
use crate::bench::trial::Trial;
use crate::beside::{self, Beside, COMPANIONS, PATIENT, evidence};
use crate::catalogue::{Catalogue, Hazard, Rule, Subject};
use crate::passive::{self, View};
use crate::report::RuleReport;
use crate::rules;
use crate::verdict::{Judged, Judgement, Stop, Verdict, also};
use crate::wire::{Direction, Draft, dialect};

/// What is run.
#[derive(Clone, Debug, Default)]
pub struct Options {
    /// Only these rules; all where empty.
    pub rules: Vec<String>,
    /// Whether a broken "should" is a fail.
    pub strict: bool,
    /// Hazards that are released.
    pub hazards: BTreeSet<Hazard>,
    /// Whether rules may take control from a station of the suite by override.
    pub overrides: bool,
    /// Whether a fail is repeated.
    pub repeat: bool,
    /// Rules whose fail is expected: once is enough.
    pub expected: BTreeSet<String>,
    /// No further rule is begun after this time; where absent, after what the rules may take together.
    pub within: Option<Duration>,
}

/// Share of lost round trips up to which the network counts as lossless.
const WHOLE: f64 = 0.0;
/// Share of lost round trips from which the subject, not the network, is taken to be silent.
const SILENT: f64 = 0.5;
/// What one rule may take of a run, times of flight apart. The same on a network that loses datagrams: there answers
/// are waited for longer, but fails are not repeated.
const RULE_TAKES: Duration = Duration::from_secs(4);
/// The budget is multiplied by this on a network that loses nothing, because the computer may be slow.
const PATIENCE: u32 = 2;
/// Rules whose judges of the traffic may miss a message that the network lost. What the others find, the messages that
/// arrived show.
const MISSES_WHAT_IS_LOST: &[&str] = &[
    "ALERT-001",
    "HB-001",
    "PAYL-007",
    "ROUTE-024",
    "STAT-012",
    "STAT-018",
];
/// Introduces what is said of a subject that was silent in the clean-up of a rule.
const SILENT_CLEAN_UP: &str = "the subject sent nothing for";
/// Introduces the fields that a rule read although Edition 2.5 has none for them.
const UNSEEN: &str = "Edition 2.5 has no field for what this rule also looks at:";

/// A run in progress; `show` is called with each judged rule.
pub struct Run<'a> {
    /// The bench.
    pub bench: Arc<Bench>,
    /// The catalogue.
    pub catalogue: &'a Catalogue,
    /// What is run.
    pub options: &'a Options,
    /// Called with each judged rule.
    pub show: &'a mut dyn FnMut(&RuleReport),
    /// Remarks about the run as a whole.
    pub remarks: Vec<String>,
    /// The ids that scenes may play while another scene runs beside them; all where empty.
    pub cast: BTreeSet<stanag_msgs::Id>,
}

impl Run<'_> {
    /// Runs all requested rules in the order of their risk; returns them in the order of the catalogue.
    #[must_use]
    pub fn rules(&mut self) -> Vec<RuleReport> {
        let judged = self.play();
        let edition = self.bench.profile.subject.edition.clone();
        let mut reports: Vec<RuleReport> = Vec::new();
        for rule in &self.catalogue.rule {
            if !self.wanted(rule) {
                continue;
            }
            let report = judged.iter().find(|report| report.id == rule.id).cloned();
            reports.push(report.unwrap_or_else(|| self.unjudged(rule, &edition)));
        }
        reports
    }

    fn wanted(&self, rule: &Rule) -> bool {
        self.options.rules.is_empty() || self.options.rules.contains(&rule.id)
    }

    /// Rules that cannot be judged here, with the reason.
    fn unjudged(&self, rule: &Rule, edition: &str) -> RuleReport {
        let mut report = RuleReport::new(rule, edition);
        let profile = &self.bench.profile;
        let without = rules::WITHOUT_CODE.iter().find(|(id, _)| *id == rule.id);
        (report.verdict, report.reason) = if rule.subject == Subject::Cucs {
            (
                Verdict::NotApplicable,
                "judges a CUCS; the subject is a VSM".into(),
            )
        } else if let Some(reason) = rules::not_in_edition(rule, edition) {
            (Verdict::NotApplicable, reason)
        } else if !claimed(rule, profile) {
            (
                Verdict::NotApplicable,
                format!("the profile does not claim the set {:?}", rule.profile),
            )
        } else if let Some((_, reason)) = without {
            (Verdict::Skipped, (*reason).to_owned())
        } else {
            (Verdict::Skipped, "has no scene yet".into())
        };
        report
    }

    fn play(&mut self) -> Vec<RuleReport> {
        let released = self.options.hazards.contains(&Hazard::Flight);
        self.bench
            .flight_released
            .store(released, std::sync::atomic::Ordering::SeqCst);
        // Only the option for simulated vehicles releases what may destroy one.
        let simulated = self.options.hazards.contains(&Hazard::Destructive);
        self.bench
            .simulated
            .store(simulated, std::sync::atomic::Ordering::SeqCst);
        let mut reports = Vec::new();
        match survey(&self.bench) {
            Ok(survey) => {
                if survey.loss > WHOLE {
                    self.remarks.push(unanswered(survey.loss));
                }
                if let Some(occupied) = &survey.occupied {
                    self.remarks.push(format!(
                        "not begun: {occupied}. Release it there, then run again"
                    ));
                    return self.all(
                        Verdict::Inconclusive,
                        "not begun: another CUCS is in control",
                    );
                }
                let _ = self.bench.survey.set(survey);
            }
            Err(stop) => {
                let reason = stop.judgement().reason;
                self.remarks.push(reason.clone());
                return self.all(Verdict::Inconclusive, &reason);
            }
        }
        if !self
            .bench
            .survey
            .get()
            .is_some_and(|survey| survey.answered)
        {
            let anything = self
                .bench
                .net
                .recording()
                .datagrams
                .iter()
                .any(|datagram| datagram.direction == Direction::Received);
            if !anything {
                let reason = format!("nothing answered a discovery at {}", self.bench.address);
                self.remarks.push(reason.clone());
                return self.all(Verdict::Inconclusive, &reason);
            }
            // What came is no readable answer: the judges of passive rules report why.
            self.remarks
                .push("datagrams came, but none was an answer to a discovery".into());
            reports.extend(self.all(
                Verdict::Inconclusive,
                "no answer to a discovery that can be read as message 2",
            ));
        } else {
            self.tour();
            reports.extend(self.scenes());
            self.finish();
        }
        self.remark_on_traffic();
        self.judge_passive(&mut reports);
        reports
    }

    /// Adds remarks about the traffic as a whole.
    fn remark_on_traffic(&mut self) {
        let recording = self.bench.net.recording();
        if recording.dropped > 0 {
            self.remarks.push(format!(
                "the subject floods: {} datagrams beyond what is looked at each second were dropped",
                recording.dropped
            ));
        }
        let mut others: Vec<String> = recording
            .datagrams
            .iter()
            .filter(|datagram| {
                datagram.direction == Direction::Received && datagram.remote != self.bench.address
            })
            .map(|datagram| datagram.remote.to_string())
            .collect();
        others.sort();
        others.dedup();
        if !others.is_empty() {
            let many = if others.len() > 4 { " and others" } else { "" };
            self.remarks.push(format!(
                "datagrams came from {}{many}, but {} was addressed: behind a firewall or NAT they would not arrive",
                others[..others.len().min(4)].join(", "),
                self.bench.address
            ));
        }
    }

    /// All rules with one verdict.
    fn all(&self, verdict: Verdict, reason: &str) -> Vec<RuleReport> {
        let edition = &self.bench.profile.subject.edition;
        let judged: BTreeSet<&str> = rules::scenes()
            .into_iter()
            .map(|scene| scene.rule)
            .chain(passive::judges().into_iter().map(|judge| judge.rule))
            .collect();
        self.catalogue
            .rule
            .iter()
            .filter(|rule| self.wanted(rule) && judged.contains(rule.id.as_str()))
            .filter(|rule| rule.subject != Subject::Cucs && rule.editions.contains(edition))
            .map(|rule| RuleReport {
                verdict,
                reason: reason.to_owned(),
                ..RuleReport::new(rule, edition)
            })
            .collect()
    }

    /// Traffic for the judges of passive rules: a bit of everything that a CUCS does.
    fn tour(&mut self) {
        let trial = Trial::new(&self.bench);
        let result = catch_unwind(AssertUnwindSafe(|| tour(&trial)));
        if let Ok(Err(Stop::Fail(reason) | Stop::Inconclusive(reason))) = result {
            self.remarks
                .push(format!("the tour at the beginning ended early: {reason}"));
        }
        let _ = trial.clean_up();
    }

    fn scenes(&mut self) -> Vec<RuleReport> {
        let mut order: Vec<(&Rule, &rules::Scene)> = rules::scenes()
            .into_iter()
            .filter_map(|scene| Some((self.catalogue.find(scene.rule)?, scene)))
            .filter(|(rule, _)| self.wanted(rule))
            .collect();
        order.sort_by_key(|(rule, _)| rank(rule));
        let mut dead: Option<String> = None;
        let mut reports = Vec::new();
        let mut flying = false;
        let within = self.options.within.unwrap_or_else(|| self.budget(&order));
        // From here: an operator may have taken a while to release the vehicle.
        let begun = self.bench.net.now();
        // A rule that mostly waits runs beside rules that do not disturb it; these come first then.
        let mut beside = self.begin_beside(&order);
        if beside.is_some() {
            order.sort_by_key(|(rule, _)| !COMPANIONS.contains(&rule.id.as_str()));
        }
        for (rule, scene) in order {
            if beside
                .as_ref()
                .is_some_and(|one| one.rule == rule.id || !COMPANIONS.contains(&rule.id.as_str()))
                && let Some(report) = beside.take().and_then(|one| self.end_beside(one))
            {
                (self.show)(&report);
                reports.push(report);
            }
            self.cast = beside
                .as_ref()
                .map_or_else(BTreeSet::new, |one| one.others.clone());
            if reports
                .iter()
                .any(|report: &RuleReport| report.id == rule.id)
            {
                continue;
            }
            let mut report = RuleReport::new(rule, &self.bench.profile.subject.edition);
            if let Some(judgement) = self.barred(rule) {
                (report.verdict, report.reason) = (judgement.verdict, judgement.reason);
            } else if self.bench.net.interrupted() {
                (report.verdict, report.reason) = (Verdict::Inconclusive, "interrupted".into());
            } else if let Some(cause) = &dead {
                (report.verdict, report.reason) = (Verdict::Inconclusive, cause.clone());
            } else if self.bench.net.now().saturating_sub(begun) > within {
                let reason = format!(
                    "not begun: the {:.0} s of the run are over (--within)",
                    within.as_secs_f64()
                );
                if !self.remarks.contains(&reason) {
                    self.remarks.push(reason.clone());
                }
                (report.verdict, report.reason) = (Verdict::Inconclusive, reason);
            } else {
                let airborne = flies(rule);
                if flying && !airborne {
                    flying = false;
                    self.land();
                }
                flying |= airborne;
                self.judge(rule, scene, &mut report);
                if self.bench.net.full() {
                    dead = Some(format!(
                        "the recording is full since {}: the subject floods",
                        rule.id
                    ));
                } else if (report.verdict.is_fail() || report.verdict == Verdict::Inconclusive)
                    && !self.bench.net.interrupted()
                    && !alive(&self.bench)
                    && !self.revived()
                {
                    dead = Some(format!(
                        "the subject has answered no discovery since {}",
                        rule.id
                    ));
                    report
                        .notes
                        .push("the subject does not answer a discovery after it".into());
                } else if report.verdict.is_fail() || report.verdict == Verdict::Inconclusive {
                    dead = self.taken_over(rule, &mut report);
                }
            }
            (self.show)(&report);
            reports.push(report);
        }
        if let Some(report) = beside.take().and_then(|one| self.end_beside(one)) {
            (self.show)(&report);
            reports.push(report);
        }
        self.cast.clear();
        if flying {
            self.land();
        }
        reports
    }

    /// How long all these rules may take: a run has to end, whatever the network and the subject do.
    fn budget(&self, order: &[(&Rule, &rules::Scene)]) -> Duration {
        let timers = &self.bench.timers;
        let of = |rule: &Rule| {
            let flight = timers.flight / 3;
            let own = RULE_TAKES.mul_f64(timers.answer.as_secs_f64() / 2.0);
            if flies(rule) { own + flight } else { own }
        };
        let all: Duration = order
            .iter()
            .filter(|(rule, _)| self.barred(rule).is_none())
            .map(|(rule, _)| of(rule))
            .sum();
        // The longest rules alone take this long, and a run may consist of one of them.
        let least = Duration::from_secs(120);
        if self.loss() > WHOLE {
            all + least
        } else {
            (all + least) * PATIENCE
        }
    }

    fn loss(&self) -> f64 {
        self.bench.survey.get().map_or(0.0, |survey| survey.loss)
    }

    /// Whether the network loses datagrams. Where most answers are missing it is the subject that is taken to be silent,
    /// and its fails are repeated as on any other network.
    fn network_loses(&self) -> bool {
        let loss = self.loss();
        loss > WHOLE && loss < SILENT
    }

    /// Begins the rule that waits longest in its own thread, with two ids that no other scene plays meanwhile. Not
    /// where no third id is left for the other rules, nor where few rules are run.
    fn begin_beside(&self, order: &[(&Rule, &rules::Scene)]) -> Option<Beside> {
        let (rule, scene) = order.iter().find(|(rule, _)| rule.id == PATIENT)?;
        let companions = order
            .iter()
            .filter(|(rule, _)| COMPANIONS.contains(&rule.id.as_str()));
        let all: Vec<stanag_msgs::Id> = self
            .bench
            .survey
            .get()?
            .with(loi::LOI4)
            .iter()
            .map(|cucs| cucs.id)
            .collect();
        if self.bench.net.dialect().is_some()
            || self.barred(rule).is_some()
            || all.len() < 3
            || companions.count() < COMPANIONS.len() / 2
        {
            return None;
        }
        // The last two: the run checks with the first id whether the subject lives.
        let (others, cast) = all.split_at(all.len() - 2);
        let cast: BTreeSet<stanag_msgs::Id> = cast.iter().copied().collect();
        let (id, others) = (rule.id.clone(), others.iter().copied().collect());
        let thread = beside::begin(self.bench.clone(), scene.play, cast);
        Some(Beside {
            rule: id,
            others,
            thread,
        })
    }

    /// The report of the rule that was played beside others, where it passed. Any other verdict may be caused by the
    /// others, so the rule is played again alone.
    fn end_beside(&self, beside: Beside) -> Option<RuleReport> {
        let waited = beside.thread.join().ok().filter(|waited| waited.passed)?;
        let rule = self.catalogue.find(&beside.rule)?;
        let mut report = RuleReport::new(rule, &self.bench.profile.subject.edition);
        (report.verdict, report.duration_s) = (Verdict::Pass, waited.duration_s);
        report.attempts.push(Verdict::Pass);
        report.evidence = waited.evidence;
        report.datagrams = Some(waited.datagrams);
        Some(report)
    }

    /// Whether another CUCS has taken LOI 4 by now: the run must not continue beside it.
    ///
    /// Message 2 names the CUCS that it is for, not the one in control. So another CUCS is in control where a
    /// station's control ended without a request, and all ids of the suite are denied LOI 4 though none of them holds
    /// it.
    fn taken_over(&mut self, rule: &Rule, report: &mut RuleReport) -> Option<String> {
        let survey = self.bench.survey.get()?;
        if self.bench.net.interrupted() || survey.with(loi::LOI4).is_empty() || !self.lost_unasked()
        {
            return None;
        }
        let trial = Trial::new(&self.bench);
        let denied = survey.with(loi::LOI4).iter().all(|cucs| {
            let Ok(station) = trial.station(cucs.id) else {
                return false;
            };
            let answer = station.request(loi::LOI2 | loi::LOI4, Access::Request);
            let granted = answer.ok().and_then(|answer| answer.raw("LOI Granted"));
            station.send(crate::bench::station::authorisation(0x0F, Access::Release));
            granted.is_some_and(|granted| granted & loi::LOI4 == 0)
        });
        if !denied {
            return None;
        }
        let cause = format!("another CUCS has taken control during {}", rule.id);
        self.remarks
            .push(format!("ended early: {cause}; nothing more was commanded"));
        report.reason = format!("{cause}: {}", report.reason);
        report.excused |= report.verdict.is_fail();
        report.verdict = Verdict::Inconclusive;
        Some(cause)
    }

    /// Whether message 2 took LOI 4 from a station of the suite when no station had sent anything about rights just
    /// before.
    fn lost_unasked(&self) -> bool {
        let recording = self.bench.net.recording();
        let settled = self.bench.timers.answer / 2;
        let mut holds: BTreeSet<stanag_msgs::Id> = BTreeSet::new();
        let mut asked = Duration::ZERO;
        for datagram in &recording.datagrams {
            for seen in &datagram.messages {
                if seen.direction == Direction::Sent && matches!(seen.kind(), 1 | 4 | 5) {
                    asked = seen.at;
                }
                if seen.direction == Direction::Received
                    && seen.kind() == 2
                    && let Some(granted) = seen.raw("LOI Granted")
                {
                    let to = seen.piece.destination;
                    if granted & loi::LOI4 != 0 {
                        holds.insert(to);
                    } else if holds.remove(&to) && seen.at > asked + settled {
                        return true;
                    }
                }
            }
        }
        false
    }

    /// Restarts the subject by the profile's command; whether it answers again.
    fn revived(&self) -> bool {
        let Some(command) = &self.bench.profile.means.restart else {
            return false;
        };
        crate::means::shell(command).is_ok() && alive(&self.bench)
    }

    fn judge(&mut self, rule: &Rule, scene: &rules::Scene, report: &mut RuleReport) {
        let began = self.bench.net.now();
        let mark = self.bench.net.mark();
        let dropped = self.bench.net.dropped();
        let mut first = self.attempt(scene, report);
        if let Some(silence) = self.silent_and_back(rule, &first, mark) {
            let silent = format!("sent nothing for {:.1} s", silence.as_secs_f64());
            self.remarks.push(format!(
                "the subject {silent} during {}, as in a restart: the rule was judged again",
                rule.id
            ));
            report.notes.push(format!(
                "judged again, because the subject {silent}, as in a restart; before: {}",
                first.reason
            ));
            first = self.attempt(scene, report);
        }
        let mut attempts = Vec::new();
        let judgement = repeated(first, &mut attempts, || {
            // On a network that loses datagrams a fail proves nothing, and repeating it does not change that.
            let possible = self.options.repeat
                && !self.network_loses()
                && !self.options.expected.contains(&rule.id)
                && !self.bench.net.interrupted()
                && alive(&self.bench);
            possible.then(|| self.attempt(scene, report))
        });
        report.attempts.extend(attempts);
        if judgement.reason.starts_with(SILENT_CLEAN_UP) {
            self.remarks
                .push(format!("{}: {}", rule.id, judgement.reason));
        }
        let (judgement, excused) = self.weighed(rule, judgement, dropped);
        (report.verdict, report.reason) = (judgement.verdict, judgement.reason);
        report.excused = excused;
        report.duration_s = (self.bench.net.now() - began).as_secs_f64();
        report.datagrams = Some((mark, self.bench.net.mark()));
    }

    /// How long the subject sent nothing during this rule, where the rule did not pass and the subject answers again: what
    /// it is blamed for may be a restart, of which the rule says nothing. A rule that makes the subject stop fails once
    /// more when it is judged again; one that is about a subject that stops, or that restarts it, is not judged again.
    fn silent_and_back(&self, rule: &Rule, first: &Judgement, mark: usize) -> Option<Duration> {
        let passed = !first.verdict.is_fail() && first.verdict != Verdict::Inconclusive;
        let about_it = matches!(rule.profile.as_str(), "robust" | "load")
            || rule.hazard == Hazard::Destructive
            || rule.needs.iter().any(|need| need == "restart");
        if passed
            || about_it
            || self.network_loses()
            || self.options.expected.contains(&rule.id)
            || self.bench.net.interrupted()
        {
            return None;
        }
        silence(&self.bench, mark).filter(|_| alive(&self.bench))
    }

    /// The judgement at the rule's level. A fail that no message shows is inconclusive on a network that loses datagrams,
    /// or in a flood that is not read as a whole; then the second value is true.
    fn weighed(&self, rule: &Rule, judgement: Judgement, dropped: usize) -> (Judgement, bool) {
        let judgement = judgement.at_level(rule.level, self.options.strict);
        if !judgement.verdict.is_fail() || judgement.shown {
            return (judgement, false);
        }
        let cause = if self.bench.net.dropped() > dropped {
            "the subject floods, so that its answers may have been missed".to_owned()
        } else if self.network_loses() {
            format!("{}, which may be the cause of", unanswered(self.loss()))
        } else {
            return (judgement, false);
        };
        let reason = format!("{cause}: {}", judgement.reason);
        (Judgement::new(Verdict::Inconclusive, reason), true)
    }

    fn attempt(&self, scene: &rules::Scene, report: &mut RuleReport) -> Judgement {
        let trial = Trial::with_cast(&self.bench, self.cast.clone());
        let _ = (self.bench.net.take_missing(), dialect::take_unplaced());
        let mut judgement = trial.judge(|| played(&trial, scene));
        let (missing, unplaced) = (self.bench.net.take_missing(), dialect::take_unplaced());
        // A rule whose messages Edition 2.5 does not have was not played: it is not applicable.
        if !missing.is_empty() && judgement.verdict != Verdict::NotApplicable {
            let reason = format!("Edition 2.5 has no {}", missing.join(", no "));
            judgement = Judgement::new(Verdict::NotApplicable, reason);
        } else if !unplaced.is_empty() && !report.notes.iter().any(|note| note.starts_with(UNSEEN))
        {
            let fields: Vec<String> = unplaced
                .iter()
                .map(|(kind, field)| format!("{field} of {kind}"))
                .collect();
            report.notes.push(format!("{UNSEEN} {}", fields.join(", ")));
        }
        let end = self.bench.net.mark();
        if let Err(stop) = trial.clean_up() {
            report
                .notes
                .push(format!("clean-up: {}", stop.judgement().reason));
            let passed = matches!(judgement.verdict, Verdict::Pass | Verdict::Warning);
            if passed && !self.bench.net.interrupted() {
                let answers = alive(&self.bench);
                // On a network that loses datagrams a release may be unanswered without any silence of the subject.
                let silence = silence(&self.bench, end).filter(|_| !self.network_loses());
                judgement = after_clean_up(judgement, answers, silence);
            }
        }
        report.notes.extend(trial.notes());
        report.evidence = evidence(&self.bench, &trial, end, judgement.verdict == Verdict::Pass);
        judgement
    }

    /// Why a rule is not played.
    fn barred(&self, rule: &Rule) -> Option<Judgement> {
        let profile = &self.bench.profile;
        let not_applicable = |reason: String| Some(Judgement::new(Verdict::NotApplicable, reason));
        if rule.subject == Subject::Cucs {
            return not_applicable("judges a CUCS; the subject is a VSM".into());
        }
        if let Some(reason) = rules::not_in_edition(rule, &profile.subject.edition) {
            return not_applicable(reason);
        }
        if !claimed(rule, profile) {
            return not_applicable(format!(
                "the profile does not claim the set {:?}",
                rule.profile
            ));
        }
        let survey = self.bench.survey.get()?;
        for need in &rule.needs {
            let missing = match need.as_str() {
                "loi4" | "loi5" | "loi3" | "loi2" => {
                    let level = loi_bit(need);
                    let claimed_level = survey
                        .cucs
                        .iter()
                        .any(|cucs| cucs.claimed.unwrap_or_default() & level != 0);
                    (survey.with(level).is_empty() && !claimed_level)
                        .then(|| format!("needs a CUCS id that may have {}", need.to_uppercase()))
                }
                "twocucs" => (survey.cucs.len() < 2)
                    .then(|| "needs two CUCS ids known to the subject".into()),
                "override" => (!survey.cucs.iter().any(|cucs| cucs.overrides))
                    .then(|| "needs a CUCS id that may override, marked so in the profile".into()),
                "multivehicle" => (survey.vehicles.len() < 2)
                    .then(|| "needs two vehicles behind the subject".into()),
                "payload" => survey.stations().is_empty().then(|| {
                    "needs a payload station; none is offered, and the profile claims none".into()
                }),
                "datalink" => (!survey.data_links).then(|| {
                    "needs a data link that the DLI controls; none answered a broadcast 28000"
                        .into()
                }),
                "restart" => profile
                    .means
                    .restart
                    .is_none()
                    .then(|| "needs means.restart in the profile".into()),
                "vehicle" | "airborne" => {
                    survey.vehicles.is_empty().then(|| "needs a vehicle".into())
                }
                _ => None,
            };
            if let Some(reason) = missing {
                return not_applicable(reason);
            }
        }
        if !self.options.hazards.contains(&rule.hazard) && rule.hazard != Hazard::None {
            return Some(Judgement::new(
                Verdict::Skipped,
                format!(
                    "a faulty subject could be a hazard ({}): state that the vehicle is simulated (--simulated, or simulated = true in the profile), \
                     or release it with --real-vehicle and --allow",
                    rule.hazard
                ),
            ));
        }
        None
    }

    fn land(&self) {
        let trial = Trial::new(&self.bench);
        let _ = catch_unwind(AssertUnwindSafe(|| flight::land(&trial)));
        let _ = trial.clean_up();
    }

    /// Leaves the subject as it was found: without a plan of the suite, and with nobody in control.
    fn finish(&self) {
        let trial = Trial::new(&self.bench);
        let _ = catch_unwind(AssertUnwindSafe(|| -> Judged {
            let survey = self.bench.surveyed()?;
            if !self.bench.net.interrupted()
                && self.options.hazards.contains(&Hazard::Ground)
                && !survey.with(loi::LOI4).is_empty()
            {
                let a = trial.a()?;
                if a.take(loi::LOI4).is_ok() {
                    a.send(flight::transfer(1, "CLEAR"));
                }
            }
            Ok(())
        }));
        // An interrupted run waits for nothing more, but it releases control.
        if let Some(survey) = self.bench.survey.get() {
            for cucs in &survey.cucs {
                if let Ok(station) = trial.station(cucs.id) {
                    station.send(crate::bench::station::authorisation(0x0F, Access::Release));
                }
            }
        }
        self.bench.net.pause(Duration::from_millis(50));
    }

    fn judge_passive(&mut self, reports: &mut Vec<RuleReport>) {
        let datagrams = self.bench.net.recording().datagrams.clone();
        let view = View {
            datagrams: &datagrams,
            profile: &self.bench.profile,
            survey: self.bench.survey.get().filter(|survey| survey.answered),
            live: true,
            as_they_are: false,
        };
        let edition = self.bench.profile.subject.edition.clone();
        for applied in passive::judges_of(&edition, Subject::Vsm) {
            let judge = applied.judge;
            let Some(rule) = self
                .catalogue
                .find(judge.rule)
                .filter(|rule| self.wanted(rule))
            else {
                continue;
            };
            if !rule.editions.contains(&edition) || !claimed(rule, &self.bench.profile) {
                continue;
            }
            // A panic in a judge is a defect of the suite, and must not cost the report of the whole run.
            let judged = catch_unwind(AssertUnwindSafe(|| applied.judge(&view)));
            let (mut judgement, evidence) = judged.unwrap_or_else(|_| {
                let reason = "a defect of the suite, not of the subject: its judge panicked";
                (Judgement::new(Verdict::Inconclusive, reason), Vec::new())
            });
            judgement.shown = !MISSES_WHAT_IS_LOST.contains(&rule.id.as_str());
            let (judgement, excused) = self.weighed(rule, judgement, self.bench.net.dropped());
            let index = reports
                .iter()
                .position(|report| report.id == rule.id)
                .unwrap_or_else(|| {
                    reports.push(RuleReport {
                        verdict: Verdict::Skipped,
                        ..RuleReport::new(rule, &edition)
                    });
                    reports.len() - 1
                });
            let report = &mut reports[index];
            let not_seen = judgement.verdict == Verdict::Inconclusive && !excused;
            report.excused |= excused;
            // "Not seen" in the traffic does not weaken what a scene has shown; two judges of one rule add up.
            if not_seen && report.verdict != Verdict::Skipped {
                continue;
            }
            let before = Judgement::new(report.verdict, report.reason.clone());
            let unjudged = report.verdict == Verdict::Inconclusive
                && report.reason.starts_with("not seen")
                || report.verdict == Verdict::Skipped && report.reason.is_empty();
            let after = if unjudged {
                judgement.clone()
            } else if before.verdict.is_fail() && judgement.verdict.is_fail() {
                // Both findings are kept, since only one of them may be expected.
                Judgement::new(before.verdict, also(&before.reason, &judgement.reason))
            } else {
                before.clone().and(judgement.clone())
            };
            if after != before {
                (report.verdict, report.reason) = (after.verdict, after.reason);
                report.evidence = evidence.iter().map(|seen| seen.evidence()).collect();
            }
        }
    }
}

/// What a loss at the beginning of the run is called, 0 to 1. Whether the network or the subject lost them is not known.
fn unanswered(loss: f64) -> String {
    format!(
        "{:.0} of {TRIPS} discoveries were not answered, not even late",
        loss * TRIPS as f64
    )
}

/// The judgement of a rule that passed, and whose release of control was not confirmed. Silence may pass a rule about
/// what must not be answered; it does not where the subject has stopped answering at all, or died of the release and was
/// restarted.
fn after_clean_up(judgement: Judgement, answers: bool, silence: Option<Duration>) -> Judgement {
    match silence {
        _ if !answers => Judgement::new(
            Verdict::Fail,
            "expected the subject to answer a discovery after what this rule sent; it answers none",
        ),
        Some(silence) => Judgement::new(
            Verdict::Warning,
            format!(
                "{SILENT_CLEAN_UP} {:.1} s when control was released after this rule, as in a crash; it answers again",
                silence.as_secs_f64()
            ),
        ),
        None => judgement,
    }
}

/// Whether the profile claims the set of this rule.
fn claimed(rule: &Rule, profile: &crate::profile::Profile) -> bool {
    if rule.profile == "project" || rule.basis == "contract" {
        return profile.subject.project;
    }
    profile.subject.sets.is_empty() || profile.subject.sets.contains(&rule.profile)
}

fn loi_bit(need: &str) -> i64 {
    match need {
        "loi2" => loi::LOI2,
        "loi3" => loi::LOI3,
        "loi4" => loi::LOI4,
        _ => loi::LOI5,
    }
}

/// Whether its scene leaves the vehicle in the air: the rule is about flying, or is judged in flight as well.
fn flies(rule: &Rule) -> bool {
    rule.hazard == Hazard::Flight
        || rule.needs.iter().any(|need| need == "airborne")
        || [
            "ROUTE-002",
            "ROUTE-004",
            "ROUTE-007",
            "STAT-009",
            "CONF-004",
            "CONF-005",
            "MODE-003",
            "PAYL-007",
        ]
        .contains(&rule.id.as_str())
}

/// From harmless to hostile; rules in flight together.
fn rank(rule: &Rule) -> (u8, String) {
    let set = match rule.profile.as_str() {
        "core" => 1,
        "monitor" => 2,
        "config" => 3,
        "control" => 4,
        "handover" => 5,
        "payload" => 6,
        "link" => 7,
        "project" => 8,
        "launch" => 9,
        "load" => 11,
        "robust" => 12,
        _ => 10,
    };
    let airborne = flies(rule);
    let rank = match rule.hazard {
        // Once a station has sent heartbeats its silence counts as a loss of control, so these rules come after all
        // others but one.
        _ if ["HB-001", "HB-002", "HB-003", "HB-004", "LINK-005"].contains(&rule.id.as_str()) => 23,
        // What may stop a subject comes last.
        _ if ["ROBUST-002", "ROBUST-004", "ROBUST-005", "LOAD-003"].contains(&rule.id.as_str()) => {
            20
        }
        // It executes a termination: nothing is sure to fly afterwards.
        _ if rule.id == "MODE-009" => 24,
        Hazard::Destructive => 21,
        _ if ["AUTH-018", "DISC-005", "STAT-015", "LINK-004", "ALERT-002"]
            .contains(&rule.id.as_str()) =>
        {
            19
        }
        _ if airborne => 10,
        _ => set,
    };
    (rank, rule.id.clone())
}

/// Plays the scene, then the second looks once it has passed. What the subject lacks of a second look is not part of
/// the rule: it becomes a note.
fn played(t: &Trial, scene: &rules::Scene) -> Judged {
    (scene.play)(t)?;
    let further = rules::further(scene.rule).filter(|_| !t.of_edition_25());
    for scene in further {
        t.clean_up()?;
        match (scene.play)(t) {
            Err(Stop::NotApplicable(reason)) => t.note(reason),
            other => other?,
        }
    }
    Ok(())
}

fn tour(t: &Trial) -> Judged {
    let station = t.any()?;
    station.discover()?;
    let all = t.bench.surveyed()?.with(loi::LOI4);
    let levels = if all.is_empty() {
        loi::LOI2
    } else {
        loi::LOI2 | loi::LOI4
    };
    let granted = station
        .request(levels, Access::Request)?
        .raw("LOI Granted")
        .unwrap_or_default();
    let mark = t.bench.net.mark();
    for kind in [
        3, 3000, 3001, 3002, 3004, 3005, 3006, 3007, 3009, 3010, 4000, 4001, 43000,
    ] {
        station.send(crate::bench::station::information_request(kind));
        t.pause(Duration::from_millis(20))?;
    }
    station.send(Draft::new(15000).raw("Subsystem ID", 0xFFF));
    station.send(
        Draft::new(40000)
            .id("VSM ID", stanag_msgs::Id::BROADCAST)
            .raw("Data Link ID", 0)
            .raw("Request Type", if granted & loi::LOI4 != 0 { 3 } else { 1 }),
    );
    station.wait(mark, t.timers().config / 3, |seen| seen.kind() == 41005);
    if granted & loi::LOI4 != 0 {
        station.send(
            Draft::new(2017)
                .set("Loiter Radius", t.bench.fresh_radius())
                .acked(),
        );
        station.query(3004)?;
        flight::download(t, &station, "TOUR")?;
        if t.bench
            .flight_released
            .load(std::sync::atomic::Ordering::SeqCst)
        {
            // Most vehicles refuse these modes, with an alert.
            station.send(flight::mode_command(17).acked());
            station.send(flight::mode_command(22).acked());
        }
        if let Ok(home) = flight::fix(t, &station) {
            let _ = t.bench.home.set(home);
        }
    }
    t.pause(t.timers().status.min(Duration::from_secs(3)))?;
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_crash_in_the_clean_up_is_no_pass() {
        let verdict = |answers, silence_s: Option<u64>| {
            let silence = silence_s.map(Duration::from_secs);
            after_clean_up(Judgement::pass(), answers, silence).verdict
        };
        assert_eq!(verdict(true, None), Verdict::Pass);
        assert_eq!(verdict(true, Some(6)), Verdict::Warning);
        assert_eq!(verdict(false, Some(6)), Verdict::Fail);
        assert_eq!(verdict(false, None), Verdict::Fail);
    }
}
