//! Requests messages at given rates, by MAV_CMD_SET_MESSAGE_INTERVAL.
//!
//! Uses a [`command::Client`], which has one command outstanding. PX4 forgets rates
//! when it restarts, so the caller decides when to request them again; an id that the vehicle refused
//! is not requested again.

use std::time::Duration;

use mavlink::dialects::development::{MavCmd, MavResult};

use super::command::{self, Command, Outcome, Payload, Repetition, Ticket};

/// How often the vehicle is to send a message.
#[derive(Clone, Copy, PartialEq, Debug)]
pub enum Rate {
    /// So many per second, above 0.
    Hz(f32),
    /// The vehicle's own default.
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

/// The state of one request.
#[derive(Clone, Copy, PartialEq, Debug)]
pub enum RequestState {
    /// Not sent yet.
    Pending,
    /// Sent, not answered.
    Sent,
    /// The vehicle accepted.
    Granted,
    /// The vehicle refused; not sent again. PX4 answers MAV_RESULT_FAILED for an id that it does not know.
    Refused(MavResult),
}

/// A list of messages and rates, and what the vehicle answered to each.
#[derive(Clone, Debug)]
pub struct Intervals {
    requests: Vec<Request>,
    outstanding: Option<(Ticket, usize)>,
    /// No command before this: the last one got no answer.
    not_before: Duration,
}

#[derive(Clone, Copy, Debug)]
struct Request {
    id: u32,
    rate: Rate,
    state: RequestState,
}

impl Intervals {
    /// Requests for these message ids, all pending. A repeated id counts as another request.
    pub fn new(requests: impl IntoIterator<Item = (u32, Rate)>) -> Self {
        let requests = requests
            .into_iter()
            .map(|(id, rate)| Request {
                id,
                rate,
                state: RequestState::Pending,
            })
            .collect();
        Self {
            requests,
            outstanding: None,
            not_before: Duration::ZERO,
        }
    }

    /// One more request, in place of an earlier one for the same message id.
    pub fn request(&mut self, id: u32, rate: Rate) {
        if let Some(request) = self.requests.iter_mut().find(|request| request.id == id) {
            if request.rate != rate {
                *request = Request {
                    id,
                    rate,
                    state: RequestState::Pending,
                };
            }
            return;
        }
        self.requests.push(Request {
            id,
            rate,
            state: RequestState::Pending,
        });
    }

    /// Requests everything again, except what was refused. For a vehicle that restarted or was silent.
    pub fn request_again(&mut self) {
        for request in &mut self.requests {
            if !matches!(request.state, RequestState::Refused(_)) {
                request.state = RequestState::Pending;
            }
        }
        // An answer that still arrives belongs to the request before the restart.
        self.outstanding = None;
        self.not_before = Duration::ZERO;
    }

    /// Requests everything again, refused messages included. For another vehicle, or another firmware.
    pub fn request_all_again(&mut self) {
        for request in &mut self.requests {
            request.state = RequestState::Pending;
        }
        self.request_again();
    }

    /// Submits the next request, if none is outstanding. Call it after every other call.
    pub fn advance(&mut self, now: Duration, commands: &mut command::Client) {
        if self.outstanding.is_some() || now < self.not_before {
            return;
        }
        let Some((place, request)) = self
            // One at a time: PX4 loses acknowledgements under a flood of commands.
            .requests
            .iter_mut()
            .enumerate()
            .find(|(_, request)| request.state == RequestState::Pending)
        else {
            return;
        };
        if let Ok(ticket) = commands.submit(now, set_message_interval(request.id, request.rate)) {
            request.state = RequestState::Sent;
            self.outstanding = Some((ticket, place));
        // The queue of commands is full. That is temporary, so wait and do not count it as a refusal.
        } else {
            self.not_before = now + PAUSE;
        }
    }

    /// Takes an event of the command client; returns whether it was about a request.
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
        let Some(request) = self.requests.get_mut(place) else {
            return true;
        };
        request.state = match *outcome {
            Outcome::Answered { result, .. } => match result {
                MavResult::MAV_RESULT_ACCEPTED => RequestState::Granted,
                MavResult::MAV_RESULT_TEMPORARILY_REJECTED => {
                    self.not_before = now + PAUSE;
                    RequestState::Pending
                }
                // PX4 answers FAILED for a message id that it does not know, and would do so every time.
                result => RequestState::Refused(result),
            },
            Outcome::NoAnswer { .. } | Outcome::Withdrawn => {
                self.not_before = now + PAUSE;
                RequestState::Pending
            }
        };
        true
    }

    /// When [`Intervals::advance`] is next needed, apart from events.
    pub fn poll_timeout(&self) -> Option<Duration> {
        let wants = |request: &Request| request.state == RequestState::Pending;
        (self.outstanding.is_none() && self.requests.iter().any(wants)).then_some(self.not_before)
    }

    /// Whether the vehicle has accepted or refused every request.
    pub fn is_settled(&self) -> bool {
        self.requests.iter().all(|request| {
            matches!(
                request.state,
                RequestState::Granted | RequestState::Refused(_)
            )
        })
    }

    /// Every request and its state.
    pub fn states(&self) -> impl Iterator<Item = (u32, Rate, RequestState)> + '_ {
        self.requests
            .iter()
            .map(|request| (request.id, request.rate, request.state))
    }
}

/// After a request without an answer: the link is bad or the vehicle is gone.
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
