//! Requests messages at given rates, by MAV_CMD_SET_MESSAGE_INTERVAL.
//!
//! Uses a [`command::Client`], which has one command outstanding. PX4 forgets rates
//! when it restarts, so the caller decides when to request them again; an id that the vehicle refused
//! is not requested again. A link that the vehicle's own streams fill loses the answers until these are lowered: there all requests
//! are sent once without waiting for any ([`Intervals::poll_round`]).

use std::time::Duration;

use mavlink::dialects::development::{MavCmd, MavMessage, MavResult};

use super::command::{self, Command, Outcome, Payload, Repetition, Ticket};
use crate::frame::Node;

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
    /// The last command got no answer, and no round has begun since.
    unanswered: bool,
    /// The next place of a round; [`PAUSED`] behind its end.
    round: Option<usize>,
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
            unanswered: false,
            round: None,
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
        if self.round.is_none() {
            self.not_before = Duration::ZERO;
        }
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
        if self.outstanding.is_some() || self.round.is_some() || now < self.not_before {
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

    /// The next request of a round, in which each that was not granted is sent once, in their order, without waiting for an answer.
    /// A round begins where a command got no answer, or the link is `full`; commands rest until it is over and its answers, which do
    /// not say what they answer, are gone. Only for a link on which little else can be why an answer is lost: elsewhere it is not
    /// called.
    pub fn poll_round(&mut self, now: Duration, to: Node, full: bool) -> Option<MavMessage> {
        let full = full && self.outstanding.is_none() && now >= self.not_before;
        if self.round.is_none() && (self.unanswered || full) {
            (self.round, self.unanswered, self.not_before) = (Some(0), false, now);
        }
        let from = self.round?;
        if now < self.not_before {
            return None;
        }
        let waits =
            |request: &Request| matches!(request.state, RequestState::Pending | RequestState::Sent);
        let mut rest = self.requests.iter().enumerate().skip(from);
        if let Some((place, request)) = rest.find(|(_, request)| waits(request)) {
            let params = [request.id as f32, request.rate.interval_us()];
            (self.round, self.not_before) = (Some(place + 1), now + ROUND_EVERY);
            let command = MavCmd::MAV_CMD_SET_MESSAGE_INTERVAL;
            return Some(command::long(to, command, params));
        }
        if from == PAUSED {
            self.round = None;
        } else {
            (self.round, self.not_before) = (Some(PAUSED), now + PAUSE);
        }
        None
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
                self.unanswered = matches!(*outcome, Outcome::NoAnswer { .. });
                self.not_before = now + PAUSE;
                RequestState::Pending
            }
        };
        true
    }

    /// When [`Intervals::advance`] is next needed, apart from events; `None` in a round.
    pub fn poll_timeout(&self) -> Option<Duration> {
        let wants = |request: &Request| request.state == RequestState::Pending;
        let rests = self.outstanding.is_some() || self.round.is_some();
        (!rests && self.requests.iter().any(wants)).then_some(self.not_before)
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
/// Between two requests of a round; the caller may have room for fewer.
const ROUND_EVERY: Duration = Duration::from_millis(100);
/// No request has this place.
const PAUSED: usize = usize::MAX;

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

    const TO: Node = Node::new(1, 1);

    fn id_of(message: &MavMessage) -> f32 {
        let MavMessage::COMMAND_LONG(long) = message else {
            panic!("{message:?}");
        };
        assert_eq!(long.command, MavCmd::MAV_CMD_SET_MESSAGE_INTERVAL);
        long.param1
    }

    /// What a round sends within this time from `from` on, looked at each 10 ms.
    fn round(intervals: &mut Intervals, from: Duration, millis: u64, full: bool) -> Vec<f32> {
        let ticks = (0..millis).step_by(10).map(Duration::from_millis);
        let sent = ticks.filter_map(|tick| intervals.poll_round(from + tick, TO, full));
        sent.map(|message| id_of(&message)).collect()
    }

    fn three() -> Intervals {
        Intervals::new([(31, Rate::Off), (33, Rate::Hz(4.0)), (30, Rate::Hz(1.0))])
    }

    #[test]
    fn on_a_full_link_all_are_sent_once_and_again_after_a_pause() {
        let mut intervals = three();
        let mut commands =
            command::Client::new(Node::new(245, 190), TO, command::Timing::default());
        let begun = Duration::from_secs(9);
        assert!(round(&mut intervals, begun, 500, false).is_empty());
        assert_eq!(
            round(&mut intervals, begun, 3_000, true),
            [31.0, 33.0, 30.0]
        );
        // Nor does a command disturb it, also where the vehicle is live meanwhile.
        intervals.request_again();
        intervals.advance(begun + PAUSE, &mut commands);
        assert!(commands.poll_transmit().is_none());
        let again = begun + Duration::from_secs(4);
        assert_eq!(
            round(&mut intervals, again, 1_000, true),
            [31.0, 33.0, 30.0]
        );
        // It is no longer full: commands follow, which are answered.
        let over = again + Duration::from_secs(4);
        assert!(round(&mut intervals, over, 100, false).is_empty());
        intervals.advance(over, &mut commands);
        let first = commands.poll_transmit().expect("a command");
        assert_eq!(id_of(&first), 31.0);
    }

    #[test]
    fn a_command_without_an_answer_begins_a_round() {
        let mut intervals = three();
        let mut commands =
            command::Client::new(Node::new(245, 190), TO, command::Timing::default());
        intervals.advance(Duration::ZERO, &mut commands);
        let mut sent = Vec::new();
        for tick in 0..1_000 {
            let now = Duration::from_millis(10 * tick);
            commands.handle_timeout(now);
            while commands.poll_transmit().is_some() {}
            while let Some(event) = commands.poll_event() {
                assert!(intervals.handle_event(now, &event));
            }
            sent.extend(intervals.poll_round(now, TO, false));
            if sent.len() == 3 {
                break;
            }
        }
        let sent: Vec<_> = sent.iter().map(id_of).collect();
        assert_eq!(sent, [31.0, 33.0, 30.0]);
        assert_eq!(intervals.poll_timeout(), None);
    }
}
