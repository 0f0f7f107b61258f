//! Why a message was ignored, and how often.

use thiserror::Error;

use super::message::MessageError;

/// Why a KEY_EXCHANGE message changes nothing.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Error)]
pub enum Ignored {
    /// It is not a KEY_EXCHANGE.
    #[error(transparent)]
    Message(MessageError),
    /// The legacy exchange, which nothing here falls back to.
    #[error("the bare public key of the legacy exchange")]
    Legacy,
    /// Not from the peer's system and component.
    #[error("not from the peer's system and component")]
    Source,
    /// Not to our system and component.
    #[error("for another system or component")]
    Target,
    /// A version that is not known.
    #[error("another version, expected 2")]
    Version,
    /// A suite that is not known, or not the one this peer has.
    #[error("not the suite of this peer")]
    Suite,
    /// A step that is not known.
    #[error("unknown step")]
    Step,
    /// A step that only we send.
    #[error("a step that only we send")]
    Reflected,
    /// Not of a session that is open.
    #[error("not of an open session")]
    Session,
    /// A session that is open, with other content than before.
    #[error("other content for an open session")]
    Changed,
    /// It does not decrypt or verify.
    #[error("not made with the peer's keys")]
    Forged,
    /// Its counter is not above the last.
    #[error("the counter is not above the last")]
    OldCounter,
    /// Above the rate limit.
    #[error("above the rate limit")]
    Limited,
    /// It repeats an earlier message.
    #[error("received before")]
    Repeated,
    /// A pairing while no window is open, or another exchange while one is.
    #[error("refused by the state of the pairing window")]
    Window,
    /// Another key is being installed in the autopilot and is not replaced.
    #[error("another key is being installed")]
    Busy,
    /// The disk failed.
    #[error("the disk failed")]
    NotStored,
    /// There are no random bytes.
    #[error("no random bytes")]
    NoRandom,
    /// A request for an exchange that is not proved to be the peer's, or one that comes while the key is too young.
    #[error("a request that is not verified under the key in force, or comes too early")]
    Hint,
    /// An order without a recent challenge of this process: a recording, or a delayed order.
    #[error("an order without its challenge")]
    Challenge,
}

impl Ignored {
    /// Every reason's name, in the order of [`ExchangeStats::by_reason`].
    const NAMES: [&'static str; 20] = [
        "message",
        "legacy",
        "source",
        "target",
        "version",
        "suite",
        "step",
        "reflected",
        "session",
        "changed",
        "forged",
        "old_counter",
        "limited",
        "repeated",
        "window",
        "busy",
        "not_stored",
        "no_random",
        "hint",
        "challenge",
    ];

    fn place(self) -> usize {
        match self {
            Self::Message(_) => 0,
            Self::Legacy => 1,
            Self::Source => 2,
            Self::Target => 3,
            Self::Version => 4,
            Self::Suite => 5,
            Self::Step => 6,
            Self::Reflected => 7,
            Self::Session => 8,
            Self::Changed => 9,
            Self::Forged => 10,
            Self::OldCounter => 11,
            Self::Limited => 12,
            Self::Repeated => 13,
            Self::Window => 14,
            Self::Busy => 15,
            Self::NotStored => 16,
            Self::NoRandom => 17,
            Self::Hint => 18,
            Self::Challenge => 19,
        }
    }
}

/// Counts of messages.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct ExchangeStats {
    /// Messages that were accepted.
    pub taken: u64,
    ignored: [u64; Ignored::NAMES.len()],
}

impl ExchangeStats {
    pub(super) fn count(&mut self, result: Result<(), Ignored>) {
        match result {
            Ok(()) => self.taken += 1,
            Err(ignored) => self.ignored[ignored.place()] += 1,
        }
    }

    /// Every reason and how often it occurred.
    pub fn by_reason(&self) -> impl Iterator<Item = (&'static str, u64)> {
        Ignored::NAMES.into_iter().zip(self.ignored)
    }

    /// How often this reason occurred.
    #[must_use]
    pub fn count_of(&self, ignored: Ignored) -> u64 {
        self.ignored[ignored.place()]
    }
}
