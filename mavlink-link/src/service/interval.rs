//! Asks the vehicle for messages at given rates, by MAV_CMD_SET_MESSAGE_INTERVAL.
//!
//! Sits on top of a [`command::Client`], which has one command outstanding. PX4 forgets rates
//! when it restarts, so that the caller says when to ask again; an id that the vehicle refused
//! is remembered and left alone.

use std::time::Duration;

use mavlink::dialects::development::{MavCmd, MavResult};

use super::command::{self, Command, Outcome, Payload, Repetition, Ticket};

/// How often a message shall come.
#[derive(Clone, Copy, PartialEq, Debug)]
pub enum Rate {
    /// So many a second, above 0.
    Hz(f32),
    /// As the vehicle thinks best.
    Default,
    /// Never.
    Off,
}

impl Rate {
    /// SET_MESSAGE_INTERVAL.param2: microseconds, 0 for the default, -1 for off.
    fn interval_us(self) -> f32 {
        match self {
            Self::Hz(rate) if rate > 0.0 => (1e6 / rate).round(),
            Self::Hz(_) | Self::Off => -1.0,
            Self::Default => 0.0,
        }
    }
}

/// How far a wish has come.
#[derive(Clone, Copy, PartialEq, Debug)]
pub enum Standing {
    /// To be asked for.
    Pending,
    /// Asked for, not answered.
    Asked,
    /// The vehicle agreed.
    Granted,
    /// The vehicle refused, and is not asked again: MAV_RESULT_FAILED is PX4's word for an id
    /// that it does not know.
    Refused(MavResult),
}

/// A list of messages and rates, and how far the vehicle has agreed to it.
#[derive(Clone, Debug)]
pub struct Intervals {
    wishes: Vec<Wish>,
    outstanding: Option<(Ticket, usize)>,
    /// No command before this: the last one had no answer.
    not_before: Duration,
}

#[derive(Clone, Copy, Debug)]
struct Wish {
    id: u32,
    rate: Rate,
    standing: Standing,
}

impl Intervals {
    /// Wishes for the message ids, all pending. A repeated id counts as another wish.
    pub fn new(wishes: impl IntoIterator<Item = (u32, Rate)>) -> Self {
        let wishes = wishes
            .into_iter()
            .map(|(id, rate)| Wish {
                id,
                rate,
                standing: Standing::Pending,
            })
            .collect();
        Self {
            wishes,
            outstanding: None,
            not_before: Duration::ZERO,
        }
    }

    /// One more wish, in place of an earlier one for the same message id.
    pub fn wish(&mut self, id: u32, rate: Rate) {
        if let Some(wish) = self.wishes.iter_mut().find(|wish| wish.id == id) {
            if wish.rate != rate {
                *wish = Wish {
                    id,
                    rate,
                    standing: Standing::Pending,
                };
            }
            return;
        }
        self.wishes.push(Wish {
            id,
            rate,
            standing: Standing::Pending,
        });
    }

    /// Asks for everything again, except what was refused: the vehicle restarted or was silent.
    pub fn ask_again(&mut self) {
        for wish in &mut self.wishes {
            if !matches!(wish.standing, Standing::Refused(_)) {
                wish.standing = Standing::Pending;
            }
        }
        // An answer that is still to come is to the question before the restart.
        self.outstanding = None;
        self.not_before = Duration::ZERO;
    }

    /// Forgets refusals too: there is another vehicle, or another firmware.
    pub fn ask_anew(&mut self) {
        for wish in &mut self.wishes {
            wish.standing = Standing::Pending;
        }
        self.ask_again();
    }

    /// Submits the next wish, if none is outstanding. Call it after anything else was called.
    pub fn advance(&mut self, now: Duration, commands: &mut command::Client) {
        if self.outstanding.is_some() || now < self.not_before {
            return;
        }
        let Some((place, wish)) = self
            .wishes
            .iter_mut()
            .enumerate()
            .find(|(_, wish)| wish.standing == Standing::Pending)
        else {
            return;
        };
        if let Ok(ticket) = commands.submit(now, set_message_interval(wish.id, wish.rate)) {
            wish.standing = Standing::Asked;
            self.outstanding = Some((ticket, place));
        } else {
            self.not_before = now + PAUSE;
        }
    }

    /// Takes an event of the command client; returns whether it was about a wish.
    pub fn handle_event(&mut self, now: Duration, event: &command::Event) -> bool {
        let command::Event::Done {
            ticket, outcome, ..
        } = event
        else {
            return false;
        };
        let Some((_, place)) = self.outstanding.take_if(|(ours, _)| ours == ticket) else {
            return false;
        };
        let Some(wish) = self.wishes.get_mut(place) else {
            return true;
        };
        wish.standing = match *outcome {
            Outcome::Answered { result, .. } => match result {
                MavResult::MAV_RESULT_ACCEPTED => Standing::Granted,
                MavResult::MAV_RESULT_TEMPORARILY_REJECTED => {
                    self.not_before = now + PAUSE;
                    Standing::Pending
                }
                result => Standing::Refused(result),
            },
            Outcome::NoAnswer { .. } | Outcome::Withdrawn => {
                self.not_before = now + PAUSE;
                Standing::Pending
            }
        };
        true
    }

    /// When [`Intervals::advance`] is next needed, apart from events.
    pub fn poll_timeout(&self) -> Option<Duration> {
        let wants = |wish: &Wish| wish.standing == Standing::Pending;
        (self.outstanding.is_none() && self.wishes.iter().any(wants)).then_some(self.not_before)
    }

    /// Whether the vehicle has agreed to or refused every wish.
    pub fn is_settled(&self) -> bool {
        self.wishes
            .iter()
            .all(|wish| matches!(wish.standing, Standing::Granted | Standing::Refused(_)))
    }

    /// Every wish and how far it has come.
    pub fn standings(&self) -> impl Iterator<Item = (u32, Rate, Standing)> + '_ {
        self.wishes
            .iter()
            .map(|wish| (wish.id, wish.rate, wish.standing))
    }
}

/// After a wish without an answer: the link is bad or the vehicle away.
const PAUSE: Duration = Duration::from_secs(3);

fn set_message_interval(id: u32, rate: Rate) -> Command {
    // Message ids have 24 bits, which a float holds exactly.
    let params = [id as f32, rate.interval_us(), 0.0, 0.0, 0.0, 0.0, 0.0];
    Command {
        command: MavCmd::MAV_CMD_SET_MESSAGE_INTERVAL,
        payload: Payload::Long(params),
        repetition: Repetition::Safe,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rates_become_microseconds() {
        assert_eq!(Rate::Hz(4.0).interval_us(), 250_000.0);
        assert_eq!(Rate::Hz(0.0).interval_us(), -1.0);
        assert_eq!(Rate::Hz(f32::NAN).interval_us(), -1.0);
        assert_eq!(Rate::Off.interval_us(), -1.0);
        assert_eq!(Rate::Default.interval_us(), 0.0);
    }
}
