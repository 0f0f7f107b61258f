//! What the machine decides of an input: the answer to who asked, what changed hands, which handovers began and ended.

use std::fmt;
use std::time::Duration;

use stanag_msgs::Id;

use super::rights::Rights;

/// What came of an input.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Decision {
    /// For who asked.
    pub answer: Answer,
    /// What changed hands, in order. Each is a line of the audit log.
    pub changes: Vec<Change>,
    /// Handovers that began, or now wait for something else.
    pub begun: Vec<Handover>,
    /// Handovers that ended.
    pub ended: Vec<Ended>,
}

/// The answer to a request. What is held afterwards is asked of the machine.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub enum Answer {
    /// All that was asked for is held, given up, or done.
    #[default]
    Granted,
    /// Something is still to be decided: another is asked, or a load ends first.
    Waits,
    /// Something of it was refused; the rest, if any, was granted.
    Refused {
        /// What was not granted.
        missing: Rights,
        /// Why.
        why: Refusal,
    },
}

/// Why something is not granted.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Refusal {
    /// `cucs.loi` does not allow it.
    NotAuthorised,
    /// Another holds it.
    Held(Id),
    /// An override of this holder, without `cucs.override`.
    NoOverride(Id),
    /// An override by a lower `cucs.rank` than this holder's.
    Rank(Id),
    /// It is being handed over to another.
    Busy(Id),
    /// The vehicle takes off or lands: control passes to another by override only.
    LaunchOrLanding,
    /// A CUCS that the configuration does not list, or the asker itself, cannot succeed.
    NoSuccessor(Id),
    /// The asker holds nothing of what it wants to hand over.
    NotHeld,
    /// There is no handover to answer.
    NoHandover,
    /// It cannot be stored: a right that would not survive a restart is not granted.
    NotStored,
    /// The vehicle has no payload station of that number, or none at all.
    NoStation,
    /// Its sender has had more decisions stored than it may in a short time.
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
    /// Who had some of them.
    pub from: Option<Id>,
    /// All that `from` lost.
    pub lost: Rights,
    /// Who has them now.
    pub to: Option<Id>,
    /// All that `to` gained.
    pub gained: Rights,
    /// Why.
    pub why: Reason,
}

/// Why rights changed hands.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Reason {
    /// They were free, and asked for.
    Requested,
    /// Their holder gave them up.
    Released,
    /// Taken by override.
    Overridden,
    /// Their holder consented, or its successor accepted.
    HandedOver,
    /// Taken, or given, while their holder was silent.
    OfferedInSilence,
    /// Their holder was silent for too long.
    Lost,
    /// A station, explicitly asked for by the controller.
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
    /// Who holds the rights; nobody where free control waits for a load of another.
    pub from: Option<Id>,
    /// Who is to have them.
    pub to: Id,
    /// Which.
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
    /// It is decided, for this reason, and waits until the load of another has ended.
    Load(Reason),
}

/// A handover that ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Ended {
    /// As it was.
    pub handover: Handover,
    /// How it ended.
    pub outcome: Outcome,
}

/// How a handover ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Outcome {
    /// These rights were moved, in one step.
    Completed(Rights),
    /// The holder refused.
    Refused,
    /// The successor declined.
    Declined,
    /// Who began it withdrew it.
    Withdrawn,
    /// Nobody answered in time.
    Lapsed,
    /// Another has the rights now, or one of the two is gone.
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
