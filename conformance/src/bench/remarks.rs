//! What a scene remarks, and the verdict that results: shared by the programs of the suite. `S` is a received or sent
//! message.

use std::cell::RefCell;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::Arc;

use crate::verdict::{Judged, Judgement, Stop, Verdict};

/// Warnings, notes and messages of one scene.
#[derive(Debug)]
pub struct Remarks<S> {
    warnings: RefCell<Vec<String>>,
    notes: RefCell<Vec<String>>,
    cited: RefCell<Vec<Arc<S>>>,
    /// Reasons of fails that a message that arrived shows by itself.
    shown: RefCell<Vec<String>>,
}

impl<S> Default for Remarks<S> {
    fn default() -> Self {
        Self {
            warnings: RefCell::default(),
            notes: RefCell::default(),
            cited: RefCell::default(),
            shown: RefCell::default(),
        }
    }
}

impl<S> Remarks<S> {
    /// Warns: a broken "should", a late answer, an odd value. The scene continues.
    pub fn warn(&self, reason: impl Into<String>) {
        self.warnings.borrow_mut().push(reason.into());
    }

    /// Reports something that is not judged.
    pub fn note(&self, text: impl Into<String>) {
        self.notes.borrow_mut().push(text.into());
    }

    /// Puts a message into the evidence.
    pub fn cite(&self, seen: &Arc<S>) {
        self.cited.borrow_mut().push(seen.clone());
    }

    /// Fails unless `holds`.
    ///
    /// # Errors
    /// The fail, with the reason.
    pub fn expect(&self, holds: bool, reason: impl FnOnce() -> String) -> Judged {
        if holds {
            Ok(())
        } else {
            Err(Stop::Fail(reason()))
        }
    }

    /// Fails with this message as evidence unless `holds`. The message has to show the fault by itself: a network that
    /// loses others does not excuse it.
    ///
    /// # Errors
    /// The fail, with the reason.
    pub fn expect_of(&self, seen: &Arc<S>, holds: bool, reason: impl FnOnce() -> String) -> Judged {
        let result = self.expect_beside(seen, holds, reason);
        if let Err(Stop::Fail(reason)) = &result {
            self.shown.borrow_mut().push(reason.clone());
        }
        result
    }

    /// As [`Self::expect_of`], where the fault may also be that another message did not arrive: a command whose effect
    /// the message reports, or one of several answers.
    ///
    /// # Errors
    /// The fail, with the reason.
    pub fn expect_beside(
        &self,
        seen: &Arc<S>,
        holds: bool,
        reason: impl FnOnce() -> String,
    ) -> Judged {
        self.cite(seen);
        self.expect(holds, reason)
    }

    /// Fails where a message came that must not, with it as evidence.
    ///
    /// # Errors
    /// The fail, with the reason.
    pub fn expect_none(&self, seen: Option<Arc<S>>, reason: impl FnOnce(&S) -> String) -> Judged {
        seen.map_or(Ok(()), |seen| {
            self.expect_beside(&seen, false, || reason(&seen))
        })
    }

    /// What is reported without being judged.
    #[must_use]
    pub fn notes(&self) -> Vec<String> {
        self.notes.borrow().clone()
    }

    /// Runs the scene and judges it. A panic in it is a defect of the suite, and never a verdict about the subject.
    pub fn judge(&self, play: impl FnOnce() -> Judged) -> Judgement {
        match catch_unwind(AssertUnwindSafe(play)) {
            Ok(Ok(())) => match self.warnings.borrow().first() {
                Some(warning) => Judgement::new(Verdict::Warning, warning.clone()),
                None => Judgement::pass(),
            },
            Ok(Err(stop)) => {
                let shown =
                    matches!(&stop, Stop::Fail(reason) if self.shown.borrow().contains(reason));
                Judgement {
                    shown,
                    ..stop.judgement()
                }
            }
            Err(panic) => {
                let text = panic
                    .downcast_ref::<String>()
                    .cloned()
                    .or(panic.downcast_ref::<&str>().map(|text| (*text).to_owned()));
                Stop::inconclusive(format!(
                    "a defect of the suite, not of the subject: {}",
                    text.unwrap_or_default()
                ))
                .judgement()
            }
        }
    }

    /// The evidence: what was cited, and the last of the other messages, at most `limit` of each, in the order of time.
    pub fn evidence<T: Ord>(
        &self,
        others: Vec<Arc<S>>,
        limit: usize,
        at: impl Fn(&S) -> T,
    ) -> Vec<Arc<S>> {
        let skip = others.len().saturating_sub(limit);
        let cited = self.cited.borrow();
        let mut chosen: Vec<Arc<S>> = cited
            .iter()
            .take(limit)
            .cloned()
            .chain(others.into_iter().skip(skip))
            .collect();
        chosen.sort_by_key(|seen| at(seen));
        chosen.dedup_by(|a, b| Arc::ptr_eq(a, b));
        chosen
    }
}

/// Repeats a fail twice; unequal results are flaky. `again` plays once more, and returns `None` where that is not
/// possible.
pub fn repeated(
    first: Judgement,
    attempts: &mut Vec<Verdict>,
    mut again: impl FnMut() -> Option<Judgement>,
) -> Judgement {
    attempts.push(first.verdict);
    if first.verdict != Verdict::Fail {
        return first;
    }
    for _ in 0..2 {
        let Some(other) = again() else { break };
        attempts.push(other.verdict);
        if matches!(other.verdict, Verdict::Pass | Verdict::Warning) {
            let reason = format!("fails at times: {}", first.reason);
            return Judgement {
                shown: first.shown,
                ..Judgement::new(Verdict::Flaky, reason)
            };
        }
    }
    first
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Whether the fail of this scene is shown by a message that arrived.
    fn shown(play: impl FnOnce(&Remarks<i32>) -> Judged) -> bool {
        let remarks = Remarks::default();
        let judgement = remarks.judge(|| play(&remarks));
        assert_eq!(judgement.verdict, Verdict::Fail);
        judgement.shown
    }

    #[test]
    fn only_a_message_that_arrived_shows_a_fail() {
        let answer = Arc::new(3);
        assert!(shown(|remarks| {
            remarks.expect_of(&answer, false, || "expected 17000 type 2, got 3".into())
        }));
        assert!(!shown(|remarks| {
            remarks.expect_beside(&answer, false, || "expected its end; none came".into())
        }));
        assert!(!shown(|remarks| {
            // What was caught, and did not end the scene, is not its fail.
            let caught = remarks.expect_of(&answer, false, || "expected 2, got 3".into());
            assert!(caught.is_err());
            remarks.expect(false, || "expected 17000; none came".into())
        }));
        let first = Judgement {
            shown: true,
            ..Judgement::new(Verdict::Fail, "expected 2, got 3")
        };
        let flaky = repeated(first, &mut Vec::new(), || Some(Judgement::pass()));
        assert_eq!((flaky.verdict, flaky.shown), (Verdict::Flaky, true));
    }
}
