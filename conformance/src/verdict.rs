//! Verdicts, and which of two counts.
//!
//! A fail beats inconclusive beats warning beats pass, and the first reason is kept, as in TTCN-3. A scene ends early
//! with a [`Stop`], which `?` returns from it.

use serde::{Deserialize, Serialize};

use crate::catalogue::Level;

/// The result of judging a rule.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Deserialize, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Verdict {
    /// What had to be seen was seen.
    Pass,
    /// A "must" is broken.
    Fail,
    /// A "should" is broken, an answer was late, a value is odd but lawful.
    Warning,
    /// It could not be judged.
    Inconclusive,
    /// The profile does not claim it, or the edition lacks it.
    NotApplicable,
    /// Excluded, or its hazard was not released.
    #[default]
    Skipped,
    /// Fails, but not every time.
    Flaky,
}

impl Verdict {
    /// Its name in reports.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Pass => "pass",
            Self::Fail => "fail",
            Self::Warning => "warning",
            Self::Inconclusive => "inconclusive",
            Self::NotApplicable => "not_applicable",
            Self::Skipped => "skipped",
            Self::Flaky => "flaky",
        }
    }

    /// All verdicts, worst first: the order of reports.
    pub const ALL: [Self; 7] = [
        Self::Fail,
        Self::Flaky,
        Self::Warning,
        Self::Inconclusive,
        Self::Pass,
        Self::NotApplicable,
        Self::Skipped,
    ];

    /// Whether it makes the run red.
    #[must_use]
    pub fn is_fail(self) -> bool {
        matches!(self, Self::Fail | Self::Flaky)
    }

    /// The larger weight counts where two judgements of one rule meet.
    fn weight(self) -> u8 {
        match self {
            Self::Skipped => 0,
            Self::NotApplicable => 1,
            Self::Pass => 2,
            Self::Warning => 3,
            Self::Inconclusive => 4,
            Self::Flaky => 5,
            Self::Fail => 6,
        }
    }
}

/// Separates the findings of a rule in its reason, where they are of several kinds.
const ALSO: &str = "; also: ";

/// The findings of a reason, the first one first.
pub fn findings(reason: &str) -> impl Iterator<Item = &str> {
    reason.split(ALSO)
}

/// A reason with one more finding.
#[must_use]
pub fn also(reason: &str, other: &str) -> String {
    format!("{reason}{ALSO}{other}")
}

/// A verdict with its reason: one sentence with what was expected and what was found.
#[derive(Clone, Debug, PartialEq)]
pub struct Judgement {
    /// The verdict.
    pub verdict: Verdict,
    /// Why; empty for a plain pass.
    pub reason: String,
    /// Whether a message that arrived shows it: what the network may have lost is then not the cause.
    pub shown: bool,
}

impl Judgement {
    /// A judgement. Rules write a field that may be absent with `{:?}`: the reason shows the value alone, or
    /// "absent".
    pub fn new(verdict: Verdict, reason: impl Into<String>) -> Self {
        Self {
            verdict,
            reason: without_options(&reason.into()),
            shown: false,
        }
    }

    /// A pass without remark.
    #[must_use]
    pub fn pass() -> Self {
        Self::new(Verdict::Pass, "")
    }

    /// The judgement of the two that counts; where they weigh the same, the first.
    #[must_use]
    pub fn and(self, other: Self) -> Self {
        // "Not seen" in the traffic does not weaken what the scene has shown, nor the reverse.
        if other.verdict.weight() > self.verdict.weight() {
            other
        } else {
            self
        }
    }

    /// The verdict at the rule's level: a broken "should" is a warning unless `strict`, a "may" is never judged.
    #[must_use]
    pub fn at_level(self, level: Level, strict: bool) -> Self {
        let verdict = match (self.verdict, level) {
            (Verdict::Fail | Verdict::Flaky, Level::Should) if !strict => Verdict::Warning,
            (Verdict::Fail | Verdict::Flaky | Verdict::Warning, Level::May) => Verdict::Pass,
            (verdict, _) => verdict,
        };
        Self { verdict, ..self }
    }
}

/// Writes `Some(40)` as `40` and `None` as `absent`, for readers who do not write Rust.
fn without_options(text: &str) -> String {
    let mut plain = String::with_capacity(text.len());
    // For each open parenthesis, whether it belongs to a `Some`.
    let mut open = Vec::new();
    let mut rest = text;
    while let Some(next) = rest.chars().next() {
        // Only at the start of a word: a subject's own text may contain it within one.
        let begins = !plain.ends_with(|before: char| before.is_alphanumeric());
        if let Some(behind) = rest.strip_prefix("Some(").filter(|_| begins) {
            open.push(true);
            rest = behind;
            continue;
        }
        if let Some(behind) = rest
            .strip_prefix("None")
            .filter(|behind| begins && !behind.starts_with(|after: char| after.is_alphanumeric()))
        {
            plain.push_str("absent");
            rest = behind;
            continue;
        }
        let ends_option = match next {
            '(' => {
                open.push(false);
                false
            }
            ')' => open.pop() == Some(true),
            _ => false,
        };
        if !ends_option {
            plain.push(next);
        }
        rest = &rest[next.len_utf8()..];
    }
    plain
}

/// Why a scene ends early.
#[derive(Clone, Debug, PartialEq)]
pub enum Stop {
    /// The rule is broken.
    Fail(String),
    /// It cannot be judged: a precondition is not met, or was lost.
    Inconclusive(String),
    /// The subject does not have what the rule is about.
    NotApplicable(String),
    /// The operator stopped the run.
    Interrupted,
}

/// What a scene returns.
pub type Judged<T = ()> = Result<T, Stop>;

impl Stop {
    /// The rule is broken.
    pub fn fail(reason: impl Into<String>) -> Self {
        Self::Fail(reason.into())
    }

    /// The rule cannot be judged.
    pub fn inconclusive(reason: impl Into<String>) -> Self {
        Self::Inconclusive(reason.into())
    }

    /// The subject does not have what the rule is about.
    pub fn not_applicable(reason: impl Into<String>) -> Self {
        Self::NotApplicable(reason.into())
    }

    /// The verdict that it results in.
    #[must_use]
    pub fn judgement(self) -> Judgement {
        match self {
            Self::Fail(reason) => Judgement::new(Verdict::Fail, reason),
            Self::Inconclusive(reason) => Judgement::new(Verdict::Inconclusive, reason),
            Self::NotApplicable(reason) => Judgement::new(Verdict::NotApplicable, reason),
            Self::Interrupted => Judgement::new(Verdict::Inconclusive, "interrupted"),
        }
    }
}

/// Turns the fail of a precondition into "inconclusive".
pub trait Precondition<T> {
    /// The same result, but a fail becomes inconclusive, introduced by `what`.
    ///
    /// # Errors
    /// The error of the result, with a fail made inconclusive.
    fn precondition(self, what: &str) -> Judged<T>;
}

impl<T> Precondition<T> for Judged<T> {
    fn precondition(self, what: &str) -> Judged<T> {
        self.map_err(|stop| match stop {
            Stop::Fail(reason) => {
                Stop::Inconclusive(format!("precondition \"{what}\" is not met: {reason}"))
            }
            other => other,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_fail_beats_all_and_the_first_reason_stays() {
        let fail = |reason| Judgement::new(Verdict::Fail, reason);
        let open = Judgement::new(Verdict::Inconclusive, "silence");
        assert_eq!(Judgement::pass().and(open.clone()), open);
        assert_eq!(open.clone().and(fail("one")), fail("one"));
        assert_eq!(fail("one").and(fail("two")), fail("one"));
        assert_eq!(fail("one").and(open), fail("one"));
    }

    #[test]
    fn a_broken_should_is_a_warning_unless_strict() {
        let fail = Judgement::new(Verdict::Fail, "late");
        let verdict = |level, strict| fail.clone().at_level(level, strict).verdict;
        assert_eq!(verdict(Level::Should, false), Verdict::Warning);
        assert_eq!(verdict(Level::Should, true), Verdict::Fail);
        assert_eq!(verdict(Level::Must, false), Verdict::Fail);
        assert_eq!(verdict(Level::May, true), Verdict::Pass);
    }

    #[test]
    fn a_reason_shows_values_and_no_options() {
        let reason = format!(
            "shows {:?} (was {:?}), {:?} and {:?}",
            Some(40),
            None::<i64>,
            (Some(1), [None, Some("a (b)")]),
            "Someone()"
        );
        let judged = Judgement::new(Verdict::Fail, reason);
        assert_eq!(
            judged.reason,
            "shows 40 (was absent), (1, [absent, \"a (b)\"]) and \"Someone()\""
        );
    }
}
