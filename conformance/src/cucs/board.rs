//! The board: the card that the operator sees now, and the reply to it. Shared by terminal and page.

use std::sync::{Mutex, MutexGuard, PoisonError};

use serde::{Deserialize, Serialize};

use crate::scripted::{Scenario, Step};

/// What is shown: the card of one step.
#[derive(Clone, Debug, Default, Serialize)]
pub struct Card {
    /// Its number in the session, from 1.
    pub number: usize,
    /// How many steps the session has.
    pub of: usize,
    /// The scenario.
    pub scenario: String,
    /// What the vehicle does, in a sentence.
    pub about: String,
    /// What to do.
    pub card: String,
    /// The question to answer, where there is one.
    pub question: Option<String>,
    /// Whether the session is over.
    pub finished: bool,
}

/// A reply of the operator.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Reply {
    /// Yes, or: done.
    Yes,
    /// No.
    No,
    /// It cannot be done or seen here.
    Skip,
}

/// The board.
#[derive(Debug)]
pub struct Board {
    operator: String,
    state: Mutex<State>,
}

#[derive(Debug, Default)]
struct State {
    card: Card,
    reply: Option<(Reply, String)>,
}

/// Why a reply is rejected.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum ReplyError {
    /// It is a reply to another card.
    #[error("this card is no longer shown")]
    Stale,
    /// The card asks nothing.
    #[error("the wire shows when this step is done; it can only be skipped")]
    NoQuestion,
}

impl Board {
    /// An empty board, for this operator.
    #[must_use]
    pub fn new(operator: &str) -> Self {
        Self {
            operator: operator.to_owned(),
            state: Mutex::default(),
        }
    }

    fn state(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Shows the card of a step.
    pub fn show(&self, scenario: &Scenario, step: &Step, (number, of): (usize, usize)) {
        let card = Card {
            number,
            of,
            scenario: scenario.name.clone(),
            about: scenario.about.clone(),
            card: step.card.clone(),
            question: step.question.clone(),
            finished: false,
        };
        *self.state() = State { card, reply: None };
    }

    /// The session is over.
    pub fn finish(&self) {
        self.state().card.finished = true;
    }

    /// The current card.
    #[must_use]
    pub fn card(&self) -> Card {
        self.state().card.clone()
    }

    /// Accepts a reply to the card of this number, in the name of `name` or of the session's operator.
    ///
    /// # Errors
    /// Another card is shown, or the card asks nothing.
    pub fn reply(&self, number: usize, reply: Reply, name: &str) -> Result<(), ReplyError> {
        let mut state = self.state();
        if state.card.number != number || state.card.finished {
            return Err(ReplyError::Stale);
        }
        if state.card.question.is_none() && reply == Reply::No {
            return Err(ReplyError::NoQuestion);
        }
        let name = name.trim();
        let by = if name.is_empty() {
            &self.operator
        } else {
            name
        };
        state.reply = Some((reply, by.chars().take(80).collect()));
        Ok(())
    }

    /// Takes the reply, once.
    pub fn take_reply(&self) -> Option<(Reply, String)> {
        self.state().reply.take()
    }
}

/// Date and time, UTC.
pub(super) fn clock() -> String {
    let seconds = std::time::SystemTime::now()
        .duration_since(std::time::UNIX_EPOCH)
        .unwrap_or_default()
        .as_secs();
    crate::report::utc(seconds)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_a_reply_to_the_card_that_is_shown_counts() {
        let scenario = Scenario::named("normal").unwrap();
        let asks = scenario
            .step
            .iter()
            .position(|step| step.question.is_some());
        let board = Board::new("Operator");
        board.show(&scenario, &scenario.step[0], (1, 2));
        assert_eq!(board.reply(1, Reply::No, ""), Err(ReplyError::NoQuestion));
        board.show(&scenario, &scenario.step[asks.unwrap()], (2, 2));
        assert_eq!(board.reply(1, Reply::Yes, ""), Err(ReplyError::Stale));
        board.reply(2, Reply::No, " ").unwrap();
        assert_eq!(board.take_reply(), Some((Reply::No, "Operator".into())));
        assert_eq!(board.take_reply(), None);
        board.finish();
        assert_eq!(board.reply(2, Reply::Yes, ""), Err(ReplyError::Stale));
    }
}
