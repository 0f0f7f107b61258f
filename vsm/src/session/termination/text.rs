//! The texts about a termination for operators, the log and the audit log.

use stanag_msgs::Id;

use super::rules::{Outcome, Refusal};
use crate::config::TerminationAction as Action;
use crate::session::two_steps;

/// The commanded action, in words.
pub(super) fn action(action: Action) -> &'static str {
    match action {
        Action::Terminate => "end the flight (MAV_CMD_DO_FLIGHTTERMINATION)",
        Action::Land => "land now (AUTO.LAND)",
        Action::Return => "return (AUTO.RTL)",
    }
}

/// Why an order is refused.
pub(super) fn refusal(refusal: Refusal, armed_s: f64) -> String {
    match refusal {
        Refusal::Steps(two_steps::Refusal::NotPlanned) => {
            "flight termination is off: set [vehicle.termination] in the configuration of the VSM".into()
        }
        Refusal::Steps(two_steps::Refusal::Layout) => {
            "the layout of 2005 is derived from Edition 2: set provisional = \"all\" in [dli] or for this CUCS".into()
        }
        Refusal::Steps(other) => other.words(armed_s),
        Refusal::Disarmed => "the vehicle is disarmed: there is no flight to end".into(),
        Refusal::AlreadyCommanded => {
            "it is already commanded; the command is repeated until the vehicle confirms it".into()
        }
        Refusal::AlreadyExecuting => "the vehicle already shows it".into(),
        Refusal::Final => {
            "a flight termination is final in PX4: it ends with a restart of the autopilot on the ground".into()
        }
    }
}

/// The name of an outcome in the audit log, and the CUCS that caused it.
pub(super) fn audit(outcome: Outcome) -> (&'static str, Option<Id>) {
    match outcome {
        Outcome::Armed(by, _) => ("termination armed", Some(by)),
        Outcome::Commanded(by, _) => ("termination commanded", Some(by)),
        Outcome::Reset(by, _) => ("termination reset", Some(by)),
        Outcome::Withdrawn(by, _) => ("termination withdrawn", Some(by)),
        Outcome::Released(by, _) | Outcome::ReleasedTo(by, _) => ("termination released", Some(by)),
        Outcome::ArmedTooLong(by) | Outcome::ControlPassed(by) | Outcome::Replanned(by) => {
            ("termination disarmed", Some(by))
        }
        Outcome::Confirmed(by, _) => ("termination confirmed", Some(by)),
        Outcome::Resumed(by, _) => ("termination resumed", Some(by)),
        Outcome::ByItself => ("termination shown", None),
        Outcome::Unconfirmed(by, _)
        | Outcome::DisarmedFirst(by, _)
        | Outcome::NotResumed(by, _) => ("termination not confirmed", Some(by)),
        Outcome::Done(_) | Outcome::Left(_) | Outcome::Restarted => ("termination ended", None),
    }
}

/// What a restart has found.
pub(super) fn cut_off(by: Id, what: Action) -> String {
    format!(
        "FLIGHT TERMINATION COMMANDED by {by} before a restart of this VSM: {}; no data from the vehicle yet, other commands are \
         refused until it shows what it does, or until it is reset (2005 state 0)",
        action(what)
    )
}

/// What a restart has found, and cannot tell from a later flight.
pub(super) fn of_another_time(by: Id, what: Action) -> String {
    format!(
        "a flight termination of {by} ({}) was not over when this VSM ended, which may be long ago: it is not taken up; if this is \
         still that flight, look at what the vehicle does, and arm and execute it again",
        action(what)
    )
}

/// The outcome, in words.
pub(super) fn outcome(outcome: Outcome, armed_s: f64, confirm_s: f64) -> String {
    match outcome {
        Outcome::Armed(by, what) => format!(
            "FLIGHT TERMINATION ARMED by {by}: {}, once it is executed (2005 state 2, execute) within {armed_s} s",
            action(what)
        ),
        Outcome::Commanded(by, what) => format!(
            "FLIGHT TERMINATION COMMANDED by {by}: {}; not confirmed by the vehicle yet",
            action(what)
        ),
        Outcome::Reset(by, true) => format!("flight termination disarmed by {by}"),
        Outcome::Reset(by, false) => format!("flight termination reset by {by}: it was not armed"),
        Outcome::Withdrawn(by, what) => format!(
            "flight termination withdrawn by {by} before the vehicle has shown it: it may have received the command to {}",
            action(what)
        ),
        Outcome::Released(by, what) => format!(
            "flight termination released by {by}: the vehicle continues to {}, other commands are taken again",
            action(what)
        ),
        Outcome::ReleasedTo(by, what) => format!(
            "flight termination released: {by} controls the vehicle, whose layout of 2005 is not agreed on (provisional); the \
             vehicle continues to {}, other commands are taken again",
            action(what)
        ),
        Outcome::ArmedTooLong(by) => format!(
            "flight termination disarmed: {by} did not execute it within {armed_s} s"
        ),
        Outcome::ControlPassed(by) => {
            format!("flight termination disarmed: {by}, which armed it, no longer controls the vehicle")
        }
        Outcome::Replanned(by) => format!(
            "flight termination disarmed: the configuration plans it otherwise than when {by} armed it"
        ),
        Outcome::Confirmed(by, Action::Terminate) => format!(
            "FLIGHT TERMINATION EXECUTED by {by}: the vehicle shows TERMINATION, which is final until PX4 restarts"
        ),
        Outcome::Confirmed(by, what) => format!(
            "FLIGHT TERMINATION EXECUTED by {by}: the vehicle shows that it is to {}; other commands are refused until it \
             is reset (2005 state 0)",
            action(what)
        ),
        Outcome::Resumed(by, what) => format!(
            "FLIGHT TERMINATION of {by}, executed before a restart of this VSM: the vehicle shows that it is to {}; other commands \
             are refused until it is reset (2005 state 0)",
            action(what)
        ),
        Outcome::NotResumed(by, what) => format!(
            "FLIGHT TERMINATION NOT SHOWN: commanded by {by} before a restart of this VSM, the vehicle does not show that it is to {}; \
             arm and execute it again",
            action(what)
        ),
        Outcome::ByItself => {
            "the vehicle shows TERMINATION, not commanded by this VSM since its start: by itself, its pilot, another station, or \
             before that start; final until PX4 restarts"
                .into()
        }
        Outcome::Unconfirmed(by, what) => format!(
            "FLIGHT TERMINATION NOT CONFIRMED: commanded by {by}, the vehicle did not show that it is to {} within \
             {confirm_s} s; arm and execute it again",
            action(what)
        ),
        Outcome::DisarmedFirst(by, what) => format!(
            "flight termination of {by} ended: the vehicle is disarmed and did not show that it is to {}",
            action(what)
        ),
        Outcome::Done(what) => {
            format!("flight termination ended: commanded to {}, the vehicle is disarmed", action(what))
        }
        Outcome::Left(what) => format!(
            "FLIGHT TERMINATION LEFT: the vehicle no longer shows that it is to {}, a pilot or a failsafe has taken it",
            action(what)
        ),
        Outcome::Restarted => {
            "the vehicle no longer shows TERMINATION: its autopilot has restarted".into()
        }
    }
}
