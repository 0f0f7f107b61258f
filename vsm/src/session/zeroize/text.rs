//! What operators, the log and the audit log are sent of a zeroize.

use stanag_msgs::Id;

use super::rules::{Outcome, Refusal};
use crate::session::two_steps;

/// Why an order is refused.
pub(crate) fn refusal(refusal: Refusal, armed_s: f64) -> String {
    match refusal {
        Refusal::Steps(two_steps::Refusal::NotPlanned) => {
            "zeroize by message is off: set zeroize.by_message in the configuration of the VSM, or run `vsm zeroize` there".into()
        }
        Refusal::Steps(other) => other.words(armed_s),
        Refusal::Unguarded => {
            "anyone who can send to the DLI could have sent it: give this station a guard (cucs.guard), or run `vsm zeroize` on the \
             VSM's computer"
                .into()
        }
        Refusal::InFlight(vehicle) => format!(
            "vehicle {vehicle} is not known to be disarmed, and would lose its link: land and disarm it (or allow \
             zeroize.in_flight, or `vsm zeroize --in-flight`)"
        ),
        Refusal::OfAnother(vehicle, by) => format!(
            "{by} controls vehicle {vehicle}, which would lose its link: it has to release it first"
        ),
        Refusal::AlreadyOrdered => "it is ordered already".into(),
    }
}

/// How a record of it is named in the audit log, and by whom it came about.
pub(crate) fn audit(outcome: Outcome) -> (&'static str, Option<Id>) {
    match outcome {
        Outcome::Armed { by, .. } => ("zeroize armed", Some(by)),
        Outcome::Ordered { by, .. } => ("zeroize ordered", by),
        Outcome::Reset(by, _) => ("zeroize reset", Some(by)),
        Outcome::ArmedTooLong(by) | Outcome::ControlPassed(by) => ("zeroize disarmed", Some(by)),
    }
}

/// What has become of it.
pub(crate) fn outcome(outcome: Outcome, armed_s: f64) -> String {
    match outcome {
        Outcome::Armed { by, flying } => format!(
            "ZEROIZE ARMED by {by}: executed (50024 state 2, execute) within {armed_s} s it erases keys, plans, recordings and logs of \
             this VSM, and ends it{}",
            flies_on(flying)
        ),
        Outcome::Ordered { by, flying } => format!(
            "ZEROIZE ORDERED by {}: this VSM ends, and erases keys, plans, recordings and logs{}",
            by.map_or_else(|| "an operator of its computer".into(), |id| id.to_string()),
            flies_on(flying)
        ),
        Outcome::Reset(by, true) => format!("zeroize disarmed by {by}"),
        Outcome::Reset(by, false) => format!("zeroize reset by {by}: it was not armed"),
        Outcome::ArmedTooLong(by) => {
            format!("zeroize disarmed: {by} did not execute it within {armed_s} s")
        }
        Outcome::ControlPassed(by) => {
            format!("zeroize disarmed: {by}, which armed it, no longer controls the vehicle")
        }
    }
}

fn flies_on(vehicle: Option<Id>) -> String {
    vehicle.map_or_else(String::new, |id| {
        format!(
            "; VEHICLE {id} IS NOT KNOWN TO BE DISARMED, loses its link and flies PX4's failsafe"
        )
    })
}
