//! Commands, one outstanding at a time, each repeated until COMMAND_ACK answers it.
//!
//! What PX4 v1.18 does with repeats: it ignores COMMAND_LONG.confirmation and executes
//! a repeated command again, with a COMMAND_ACK each time. Therefore a [`Command`] states whether
//! it may be repeated, and one that may not is sent once. An acknowledgement names the command
//! and nothing else. After a command that was sent more than once, the next one with the same number waits until the
//! surplus acknowledgements have arrived, or can no longer arrive.
//!
//! An accepted command proves little (PX4 accepts modes that it does not enter): the caller
//! checks the vehicle's state.

use std::collections::VecDeque;
use std::time::Duration;

use mavlink::dialects::development::{
    COMMAND_ACK_DATA, COMMAND_INT_DATA, COMMAND_LONG_DATA, MavCmd, MavFrame, MavMessage, MavResult,
};

use super::bounded::Bounded;
use crate::frame::Node;

/// Waits and repeats.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct Timing {
    /// Wait for COMMAND_ACK before a repeat. PX4 answers in 4 to 18 ms; the rest is the radio.
    pub answer: Duration,
    /// How often a command that may be repeated is sent in all.
    pub tries: u8,
    /// Wait for COMMAND_ACK after the last of them: a link may take 2 s each way.
    pub last_answer: Duration,
    /// Wait for COMMAND_ACK of a command that may not be repeated.
    pub answer_once: Duration,
    /// Wait after each MAV_RESULT_IN_PROGRESS for the next report.
    pub progress: Duration,
    /// Longest time for a command in progress, whatever progress it reports.
    pub progress_total: Duration,
}

impl Default for Timing {
    fn default() -> Self {
        Self {
            answer: Duration::from_millis(500),
            tries: 6,
            last_answer: Duration::from_secs(3),
            answer_once: Duration::from_secs(2),
            progress: Duration::from_secs(5),
            progress_total: Duration::from_secs(120),
        }
    }
}

/// Whether the vehicle may execute a command twice.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum Repetition {
    /// Twice is as good as once: modes, arming, rates, absolute positions.
    Safe,
    /// Twice is not once: steps, toggles, pulses, anything relative.
    Never,
}

/// The parameters, by the message that carries them.
#[derive(Clone, Copy, PartialEq, Debug)]
pub enum Payload {
    /// COMMAND_LONG (76): param1 to param7; NaN is "not set".
    Long([f32; 7]),
    /// COMMAND_INT (75): a place without loss of precision.
    Int {
        /// COMMAND_INT.frame
        frame: MavFrame,
        /// param1 to param4
        params: [f32; 4],
        /// Latitude in degrees * 1e7, or param5
        x: i32,
        /// Longitude in degrees * 1e7, or param6
        y: i32,
        /// Altitude in metres, or param7
        z: f32,
    },
}

/// One command, without its target.
#[derive(Clone, Copy, PartialEq, Debug)]
pub struct Command {
    /// MAV_CMD
    pub command: MavCmd,
    /// Its parameters.
    pub payload: Payload,
    /// Whether it may be sent twice.
    pub repetition: Repetition,
}

/// COMMAND_LONG (76) to a node, as it is sent first: param1 and those after it, at most 7. The others are 0.
pub fn long<const N: usize>(to: Node, command: MavCmd, params: [f32; N]) -> MavMessage {
    const { assert!(N <= 7) };
    let mut all = [0.0; 7];
    all[..N].copy_from_slice(&params);
    repeated(to, command, all, 0)
}

fn repeated(to: Node, command: MavCmd, params: [f32; 7], confirmation: u8) -> MavMessage {
    let [param1, param2, param3, param4, param5, param6, param7] = params;
    MavMessage::COMMAND_LONG(COMMAND_LONG_DATA {
        param1,
        param2,
        param3,
        param4,
        param5,
        param6,
        param7,
        command,
        target_system: to.system,
        target_component: to.component,
        confirmation,
    })
}

/// Identifies a submitted command in its events.
#[derive(Clone, Copy, PartialEq, Eq, Hash, Debug)]
pub struct Ticket(u64);

/// Why a command was not accepted for sending.
#[derive(Clone, Copy, PartialEq, Eq, Debug, thiserror::Error)]
pub enum SubmitError {
    /// Too many wait already, or too many events are unread.
    #[error("{0} commands are waiting already")]
    Full(usize),
}

/// How a command ended.
#[derive(Clone, Copy, PartialEq, Debug)]
pub enum Outcome {
    /// The vehicle's answer.
    Answered {
        /// COMMAND_ACK.result
        result: MavResult,
        /// COMMAND_ACK.result_param2
        result_param2: i32,
    },
    /// No answer to any try; it may have been executed nevertheless.
    NoAnswer {
        /// How often it was sent.
        tries: u8,
    },
    /// The caller withdrew it; if it was sent, it may be executed nevertheless.
    Withdrawn,
}

/// What a [`Client`] reports.
#[derive(Clone, Copy, PartialEq, Debug)]
pub enum Event {
    /// MAV_RESULT_IN_PROGRESS. An unread one of the same command is replaced.
    InProgress {
        /// Which command.
        ticket: Ticket,
        /// COMMAND_ACK.progress, 0..=100, when the vehicle knows it.
        percent: Option<u8>,
    },
    /// The end of a command; every submitted one has exactly one.
    Done {
        /// Which command.
        ticket: Ticket,
        /// Its MAV_CMD.
        command: MavCmd,
        /// How it ended.
        outcome: Outcome,
        /// The node that the command was sent to, and therefore that answered.
        from: Node,
    },
}

/// Sends commands to one node.
#[derive(Debug)]
pub struct Client {
    us: Node,
    vehicle: Node,
    timing: Timing,
    waiting: VecDeque<(Ticket, Command)>,
    active: Option<Active>,
    surplus: Option<Surplus>,
    next_ticket: u64,
    out: Bounded<MavMessage>,
    events: Bounded<Event>,
}

#[derive(Debug)]
struct Active {
    ticket: Ticket,
    command: Command,
    tries: u8,
    deadline: Duration,
    /// When it must have ended, once it is in progress.
    give_up: Option<Duration>,
}

/// Acknowledgements that may still come for a command that is done.
#[derive(Debug)]
struct Surplus {
    command: MavCmd,
    left: u8,
    until: Duration,
}

impl Client {
    /// A client named `us` on the link, for commands to `vehicle`.
    pub const fn new(us: Node, vehicle: Node, timing: Timing) -> Self {
        Self {
            us,
            vehicle,
            timing,
            waiting: VecDeque::new(),
            active: None,
            surplus: None,
            next_ticket: 0,
            out: Bounded::new(MAX_OUT),
            events: Bounded::new(MAX_EVENTS),
        }
    }

    /// Queues a command.
    ///
    /// # Errors
    /// Too many commands are waiting, or too many events are unread.
    pub fn submit(&mut self, now: Duration, command: Command) -> Result<Ticket, SubmitError> {
        let pending = self.pending();
        // Every submitted command ends in an event, so room for those events is kept.
        if pending >= MAX_WAITING || pending + self.events.len() >= MAX_EVENTS / 2 {
            return Err(SubmitError::Full(pending));
        }
        let ticket = Ticket(self.next_ticket);
        self.next_ticket += 1;
        self.waiting.push_back((ticket, command));
        self.advance(now);
        Ok(ticket)
    }

    /// Withdraws a command; its event is [`Outcome::Withdrawn`]. Unknown tickets are ignored.
    pub fn withdraw(&mut self, now: Duration, ticket: Ticket) {
        if let Some(active) = self.active.take_if(|active| active.ticket == ticket) {
            // Each send may still be acknowledged: the next command with this number must not take such an answer for its
            // own.
            self.finish(now, &active, Outcome::Withdrawn, active.tries);
            self.advance(now);
        } else if let Some(place) = self.waiting.iter().position(|(t, _)| *t == ticket)
            && let Some((ticket, command)) = self.waiting.remove(place)
        {
            self.done(ticket, command.command, Outcome::Withdrawn);
        }
    }

    /// Commands that have not ended.
    pub fn pending(&self) -> usize {
        self.waiting.len() + usize::from(self.active.is_some())
    }

    /// Takes a message of `from`; `fresh` is false when it may be a replay.
    ///
    /// Returns whether it was the answer to the outstanding command.
    pub fn handle_message(
        &mut self,
        now: Duration,
        from: Node,
        message: &MavMessage,
        fresh: bool,
    ) -> bool {
        let MavMessage::COMMAND_ACK(ack) = message else {
            return false;
        };
        let for_us = self.us == Node::new(ack.target_system, ack.target_component);
        // PX4 sends all answers to its first UDP sender, those to other stations' commands too.
        if !fresh || from != self.vehicle || !for_us {
            return false;
        }
        let taken = self.handle_ack(now, ack);
        self.advance(now);
        taken
    }

    /// Does what is due.
    pub fn handle_timeout(&mut self, now: Duration) {
        if self.surplus.as_ref().is_some_and(|s| s.until <= now) {
            self.surplus = None;
        }
        if let Some(mut active) = self.active.take_if(|active| active.deadline <= now) {
            let may_repeat = active.command.repetition == Repetition::Safe
                // IN_PROGRESS proves receipt, and PX4 would execute a repeated command again.
                && active.give_up.is_none()
                && active.tries < self.timing.tries;
            if may_repeat {
                self.send(&active.command, active.tries);
                active.tries += 1;
                let wait = if active.tries < self.timing.tries {
                    self.timing.answer
                } else {
                    self.timing.last_answer
                };
                active.deadline = now + wait;
                self.active = Some(active);
            } else {
                // None of the tries was answered, so any of them may still be.
                let tries = active.tries;
                self.finish(now, &active, Outcome::NoAnswer { tries }, tries);
            }
        }
        self.advance(now);
    }

    /// The caller did not run for so long, so that an answer may wait unread: nothing is given up for that time.
    pub fn postpone(&mut self, by: Duration) {
        if let Some(active) = &mut self.active {
            active.deadline += by;
            active.give_up = active.give_up.map(|at| at + by);
        }
        if let Some(surplus) = &mut self.surplus {
            surplus.until += by;
        }
    }

    /// When [`Client::handle_timeout`] is next needed.
    pub fn poll_timeout(&self) -> Option<Duration> {
        match (&self.active, &self.surplus) {
            (Some(active), _) => Some(active.deadline),
            (None, Some(surplus)) => Some(surplus.until),
            (None, None) => None,
        }
    }

    /// The next message for the vehicle.
    pub fn poll_transmit(&mut self) -> Option<MavMessage> {
        self.out.pop()
    }

    /// The next event.
    pub fn poll_event(&mut self) -> Option<Event> {
        self.events.pop()
    }

    fn handle_ack(&mut self, now: Duration, ack: &COMMAND_ACK_DATA) -> bool {
        let Some(mut active) = self.active.take_if(|a| a.command.command == ack.command) else {
            self.count_surplus(ack.command);
            return false;
        };
        if ack.result != MavResult::MAV_RESULT_IN_PROGRESS {
            let outcome = Outcome::Answered {
                result: ack.result,
                result_param2: ack.result_param2,
            };
            // One answer has arrived; each earlier try may bring another.
            let surplus = active.tries.saturating_sub(1);
            self.finish(now, &active, outcome, surplus);
            return true;
        }
        let give_up = *active
            .give_up
            .get_or_insert(now + self.timing.progress_total);
        active.deadline = (now + self.timing.progress).min(give_up);
        let event = Event::InProgress {
            ticket: active.ticket,
            percent: (ack.progress <= 100).then_some(ack.progress),
        };
        // Unread progress is replaced, so that the queue has room for the end.
        match self.events.last_mut() {
            Some(last @ Event::InProgress { .. }) => *last = event,
            _ => {
                self.events.push(event);
            }
        }
        self.active = Some(active);
        true
    }

    fn count_surplus(&mut self, command: MavCmd) {
        if let Some(surplus) = &mut self.surplus
            && surplus.command == command
        {
            surplus.left -= 1;
            if surplus.left == 0 {
                self.surplus = None;
            }
        }
    }

    fn finish(&mut self, now: Duration, active: &Active, outcome: Outcome, surplus: u8) {
        // What a slow link had no room for yet is not sent after its end was reported.
        self.out.clear();
        if surplus > 0 {
            self.surplus = Some(Surplus {
                command: active.command.command,
                left: surplus,
                until: now + self.timing.answer,
            });
        }
        self.done(active.ticket, active.command.command, outcome);
    }

    fn done(&mut self, ticket: Ticket, command: MavCmd, outcome: Outcome) {
        if matches!(self.events.last_mut(), Some(Event::InProgress { .. })) {
            self.events.pop_last();
        }
        self.events.push(Event::Done {
            ticket,
            command,
            outcome,
            from: self.vehicle,
        });
    }

    /// Sends the next command, if none is outstanding and no late answer could be mistaken for its own.
    fn advance(&mut self, now: Duration) {
        // PX4 v1.18 loses acknowledgements under a flood: of 200 commands sent back to back it acknowledged 24.
        if self.active.is_some() {
            return;
        }
        let Some((_, command)) = self.waiting.front() else {
            return;
        };
        let late = self
            .surplus
            .as_ref()
            .is_some_and(|s| s.command == command.command && s.until > now);
        if late {
            return;
        }
        if let Some((ticket, command)) = self.waiting.pop_front() {
            self.send(&command, 0);
            let wait = match command.repetition {
                Repetition::Safe => self.timing.answer,
                Repetition::Never => self.timing.answer_once,
            };
            self.active = Some(Active {
                ticket,
                command,
                tries: 1,
                deadline: now + wait,
                give_up: None,
            });
        }
    }

    fn send(&mut self, command: &Command, confirmation: u8) {
        let target_system = self.vehicle.system;
        let target_component = self.vehicle.component;
        self.out.push(match command.payload {
            Payload::Long(params) => repeated(self.vehicle, command.command, params, confirmation),
            Payload::Int {
                frame,
                params: [param1, param2, param3, param4],
                x,
                y,
                z,
            } => MavMessage::COMMAND_INT(COMMAND_INT_DATA {
                param1,
                param2,
                param3,
                param4,
                x,
                y,
                z,
                command: command.command,
                target_system,
                target_component,
                frame,
                // The message defines both as not used.
                current: 0,
                autocontinue: 0,
            }),
        });
    }
}

/// Commands not ended, the outstanding one among them.
const MAX_WAITING: usize = 16;
const MAX_EVENTS: usize = 64;
const MAX_OUT: usize = 32;
