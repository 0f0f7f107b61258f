//! A decision about an input: the answer to the requester, the rights that changed hands, and the handovers that began and
//! ended.

use std::fmt;
use std::time::Duration;

use stanag_msgs::Id;

use super::rights::Rights;

/// The decision about an input.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Decision {
    /// The answer to the requester.
    pub answer: Answer,
    /// Changes of rights, in order. Each is a line of the audit log.
    pub changes: Vec<Change>,
    /// Handovers that began, or now wait for something else.
    pub begun: Vec<Handover>,
    /// Handovers that ended.
    pub ended: Vec<Ended>,
}

impl Decision {
    /// Whether it only ends rights and requests: nobody has more by it.
    #[must_use]
    pub fn gives_up(&self) -> bool {
        self.begun.is_empty() && self.changes.iter().all(|change| change.to.is_none())
    }
}

/// The answer to a request. The machine has the rights held afterwards.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub enum Answer {
    /// The request is fully carried out.
    #[default]
    Granted,
    /// Part of it is pending: another CUCS must answer, or a load must end first.
    Waits,
    /// Part of it was refused; the rest, if any, was granted.
    Refused {
        /// The rights that were not granted.
        missing: Rights,
        /// Why.
        why: Refusal,
    },
}

/// Why rights are not granted.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Refusal {
    /// `cucs.loi` does not allow it.
    NotAuthorised,
    /// Another CUCS holds it.
    Held(Id),
    /// An override of this holder, without `cucs.override`.
    NoOverride(Id),
    /// An override by a lower `cucs.rank` than this holder's.
    Rank(Id),
    /// It is being handed over to another CUCS.
    Busy(Id),
    /// The vehicle is taking off or landing: control passes by override only.
    LaunchOrLanding,
    /// The named successor is not configured, or is the sender itself.
    NoSuccessor(Id),
    /// The sender holds none of the rights that it wants to hand over.
    NotHeld,
    /// There is no handover to answer.
    NoHandover,
    /// The decision cannot be stored: a right that would not survive a restart is not granted.
    NotStored,
    /// The vehicle has no payload station of that number, or none at all.
    NoStation,
    /// Its sender has caused too many stored decisions in a short time.
    TooOften,
}

impl fmt::Display for Refusal {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Refusal::NotAuthorised => write!(f, "not authorised by configuration"),
            Refusal::Held(id) => write!(f, "{id} holds it"),
            Refusal::NoOverride(id) => write!(
                f,
                "{id} holds it, and this CUCS may not override: its entry has no override = true"
            ),
            Refusal::Rank(id) => write!(
                f,
                "{id} holds it, and is of a higher rank: by cucs.rank, or since it has a guard"
            ),
            Refusal::Busy(id) => write!(f, "it is being handed over to {id}"),
            Refusal::LaunchOrLanding => write!(f, "the vehicle takes off or lands"),
            Refusal::NoSuccessor(id) => write!(f, "{id} cannot take control"),
            Refusal::NotHeld => write!(f, "not held by the sender of the handover"),
            Refusal::NoHandover => write!(f, "there is no handover to answer"),
            Refusal::NoStation => write!(f, "the vehicle has no such payload station"),
            Refusal::NotStored => write!(f, "it cannot be stored"),
            Refusal::TooOften => write!(
                f,
                "too many changes of rights by this station: wait some seconds"
            ),
        }
    }
}

/// Rights that changed hands in one step.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub struct Change {
    /// The previous holder.
    pub from: Option<Id>,
    /// All rights that `from` lost.
    pub lost: Rights,
    /// The new holder.
    pub to: Option<Id>,
    /// All rights that `to` gained.
    pub gained: Rights,
    /// Why.
    pub why: Reason,
}

/// Why rights changed hands.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Reason {
    /// They were free and requested.
    Requested,
    /// Their holder released them.
    Released,
    /// Taken by override.
    Overridden,
    /// Their holder consented, or its successor accepted.
    HandedOver,
    /// Taken by, or given to, another while their holder was silent.
    OfferedInSilence,
    /// Their holder was silent for too long.
    Lost,
    /// A payload station that the controller requested by number.
    Controller,
    /// The configuration no longer allows it.
    Withdrawn,
}

impl fmt::Display for Reason {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Reason::Requested => "requested",
            Reason::Released => "released",
            Reason::Overridden => "overridden",
            Reason::HandedOver => "handed over",
            Reason::OfferedInSilence => "offered in silence",
            Reason::Lost => "holder lost",
            Reason::Controller => "asked for by the controller",
            Reason::Withdrawn => "withdrawn by the configuration",
        })
    }
}

/// A handover that is not decided yet.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub struct Handover {
    /// The holder; `None` if free control waits for another CUCS's load.
    pub from: Option<Id>,
    /// The acquirer.
    pub to: Id,
    /// The rights.
    pub rights: Rights,
    /// What it waits for.
    pub stage: Stage,
}

/// What a handover waits for.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Stage {
    /// The holder's consent, until then.
    Consent(Duration),
    /// The named successor's acceptance, until then.
    Acceptance(Duration),
    /// It is decided, for this reason, and waits for another CUCS's load to end.
    Load(Reason),
}

/// A handover that ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Ended {
    /// The handover.
    pub handover: Handover,
    /// How it ended.
    pub outcome: Outcome,
}

/// How a handover ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Outcome {
    /// These rights passed, in one step.
    Completed(Rights),
    /// The holder refused.
    Refused,
    /// The successor declined.
    Declined,
    /// Its initiator withdrew it.
    Withdrawn,
    /// Nobody answered in time.
    Lapsed,
    /// Another CUCS has the rights now, or one of the parties is gone.
    Overtaken,
    /// The vehicle began to take off or land.
    LaunchOrLanding,
}

impl fmt::Display for Outcome {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Outcome::Completed(rights) => write!(f, "{} handed over", rights.in_words()),
            Outcome::Refused => write!(f, "refused by the holder"),
            Outcome::Declined => write!(f, "declined by the successor"),
            Outcome::Withdrawn => write!(f, "withdrawn"),
            Outcome::Lapsed => write!(f, "lapsed"),
            Outcome::Overtaken => write!(f, "overtaken"),
            Outcome::LaunchOrLanding => write!(f, "not during launch or landing"),
        }
    }
}
