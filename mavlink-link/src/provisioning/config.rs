//! What a handover is told and what it tells.

use thiserror::Error;

use crate::clock::StoreError;
use crate::link::LinkConfig;
use crate::signing::Stamp;

/// The settings of a handover.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct HandoverConfig<A> {
    /// The link: the same ids and link id as in flight, for the vehicle keeps every stream it hears.
    pub link: LinkConfig<A>,
    /// A date that cannot be in the future, such as that of the build.
    pub not_before: Stamp,
    /// Whether the link may show the key: if not, it is only found out which key the vehicle has.
    pub may_send_key: bool,
    /// Whether a vehicle that should sign is believed without a signature, from whatever address: a person, or the agent
    /// beside it, says that it has lost its key. Otherwise only the address counts that has proved to be the vehicle.
    pub believe_unsigned: bool,
}

/// Where a handover stands.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum State {
    /// The new key is on disk; for 10 s nobody but the one vehicle may be heard.
    Staged,
    /// Waits for the vehicle's word that it is disarmed.
    WaitDisarm,
    /// SETUP_SIGNING is out, and heartbeats under both keys.
    Sent,
    /// The vehicle signs with the new key.
    Committed,
    /// The vehicle still uses the old key; passed through on the way to another try.
    NotTaken,
    /// Three tries were not taken; the new key is given up after half a minute of the old one.
    RolledBack,
    /// The vehicle is silent: it may have either key, so both are kept and tried.
    Unknown,
}

/// Something to do or to tell.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Event {
    /// It has moved to this state.
    State(State),
    /// Another autopilot is on the link, or the same one from two addresses; nothing is sent while there are two.
    SeveralAutopilots {
        /// Its system id.
        system: u8,
    },
    /// The vehicle refuses while it is armed.
    RefusedWhileArmed,
    /// Make the new key the current one on disk, and the current one the previous.
    Commit,
    /// The vehicle had the new key and has it no more: its power was cut while it wrote its key file.
    FellBack,
    /// It is over.
    Ended(Outcome),
}

/// How a handover ended. Silence is no end.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Outcome {
    /// The vehicle has the new key.
    Committed,
    /// The vehicle keeps the old key: the new one may be deleted.
    RolledBack,
    /// The vehicle stays unsigned (PX4 1.17 and older cannot sign). The new key stays on disk.
    NeverSigns,
    /// More than one autopilot was on the link: nothing was sent.
    SeveralAutopilots,
}

/// Why a handover cannot begin.
#[derive(Debug, Clone, PartialEq, Eq, Error)]
pub enum StartError {
    /// The clock of the new key cannot be read.
    #[error(transparent)]
    Store(#[from] StoreError),
    /// No frame could tell which of the two it was signed with.
    #[error("the new key is the current one, expected another")]
    SameKey,
}
