//! How the agent stands with PX4's key, and with an order to zeroize.

use std::time::Duration;

use mavlink_link::exchange::AutopilotKey;
use mavlink_link::link::Auth;
use mavlink_link::provisioning::{KeyRollover, KeySlot, State};
use mavlink_link::receiver::KeyState;
use mavlink_link::signing::{KeyId, SigningKey};

use super::keys::Keys;
use crate::session::Peer;

/// The phases of an agent's life; each decides what is relayed.
#[derive(Debug)]
pub(super) enum Phase {
    /// There is no key: only the exchange is received.
    Keyless,
    /// One key in force: what verifies under it passes.
    Relaying(Box<Relaying>),
    /// A key is on its way to PX4.
    HandingOver(Box<HandingOver>),
    /// PX4 takes no key: it is older than v1.18. Nothing passes, and it is asked again now and then.
    CannotSign { key: SigningKey, again_at: Duration },
}

#[derive(Debug)]
pub(super) struct Relaying {
    pub(super) key: KeyState,
    /// Kept until PX4 has restarted and still signs with the current one.
    pub(super) previous: Option<SigningKey>,
}

#[derive(Debug)]
pub(super) struct HandingOver {
    pub(super) handover: KeyRollover<Peer>,
    pub(super) cause: Cause,
    /// The key before the one in force, where that is handed over again.
    pub(super) previous: Option<SigningKey>,
    /// PX4 has the key, and the files do not have it yet: tried again then.
    pub(super) commit_at: Option<Duration>,
}

/// Why a key is handed over.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Cause {
    /// It is a new one: until PX4 has it the link continues under the old one.
    NewKey,
    /// A zeroize: it is to have one that nobody keeps, and no file ever has it.
    Discarded,
    /// PX4 has lost it, or fallen back to the one before: nothing passes until it has it again.
    LostKey,
}

impl Cause {
    /// The key that the ground uses meanwhile.
    fn of_ground(self) -> KeySlot {
        match self {
            // The ground switches at PX4's first frame under the new key, which it can only see after the agent.
            Cause::NewKey | Cause::Discarded => KeySlot::Old,
            Cause::LostKey => KeySlot::New,
        }
    }
}

impl Phase {
    pub(super) fn relaying(key: KeyState, previous: Option<SigningKey>) -> Phase {
        Phase::Relaying(Box::new(Relaying { key, previous }))
    }

    /// What frames of the ground are verified by.
    pub(super) fn ground_auth<'a>(&'a mut self, keys: &'a mut dyn Keys) -> Auth<'a> {
        let key = match self {
            Phase::Keyless | Phase::CannotSign { .. } => None,
            Phase::Relaying(relaying) => Some(&mut relaying.key),
            Phase::HandingOver(on) => on.handover.key_mut(on.cause.of_ground()),
        };
        key.map_or(Auth::Off, |key| Auth::Signed {
            key,
            store: keys.disk(),
        })
    }

    /// What a command of the agent itself is signed with: the key that PX4 has, where that is known.
    pub(super) fn px4_auth<'a>(&'a mut self, keys: &'a mut dyn Keys) -> Auth<'a> {
        let key = match self {
            Phase::Keyless | Phase::CannotSign { .. } => None,
            Phase::Relaying(relaying) => Some(&mut relaying.key),
            // In flight a new key waits: the vehicle flies under the old one.
            Phase::HandingOver(on) if on.cause == Cause::NewKey => {
                on.handover.key_mut(KeySlot::Old)
            }
            Phase::HandingOver(_) => None,
        };
        key.map_or(Auth::Off, |key| Auth::Signed {
            key,
            store: keys.disk(),
        })
    }

    /// Whether PX4 can be commanded by the agent itself.
    pub(super) fn reaches_px4(&self) -> bool {
        match self {
            Phase::Keyless | Phase::CannotSign { .. } => false,
            Phase::Relaying(_) => true,
            Phase::HandingOver(on) => on.cause == Cause::NewKey && on.handover.has_old_key(),
        }
    }

    /// Whether a command must not reach PX4: one that has lost its key would carry out anybody's. `accepted` is when a
    /// frame of PX4 has verified last.
    pub(super) fn is_closed(&self, mono: Duration, accepted: Option<Duration>) -> bool {
        match self {
            Phase::Keyless | Phase::CannotSign { .. } => true,
            // Silence counts as unsigned: PX4 may be restarting without its key, and then accepts any command.
            Phase::Relaying(_) => accepted.is_none_or(|at| mono.saturating_sub(at) > SIGNED_LATELY),
            Phase::HandingOver(on) => {
                on.cause == Cause::LostKey || on.handover.vehicle_is_open(mono)
            }
        }
    }

    /// The name of the state, for the status.
    pub(super) fn name(&self) -> &'static str {
        match self {
            Phase::Keyless => "no key",
            Phase::Relaying(_) => "relaying",
            Phase::CannotSign { .. } => "PX4 cannot sign",
            Phase::HandingOver(on) => match on.handover.state() {
                State::Staged => "staged",
                State::WaitDisarm => "waits for disarmed",
                State::Sent => "key sent",
                State::Committed => "committed",
                State::NotTaken => "key not taken",
                State::RolledBack => "rolled back",
                State::Unknown => "asks which key PX4 has",
            },
        }
    }

    /// The key in force, where it is known.
    pub(super) fn key_id(&self) -> Option<KeyId> {
        match self {
            Phase::Relaying(relaying) => Some(relaying.key.id()),
            Phase::HandingOver(_) | Phase::Keyless | Phase::CannotSign { .. } => None,
        }
    }

    /// The key that PX4 is to be given, or may have been.
    pub(super) fn next_id(&self) -> Option<KeyId> {
        match self {
            Phase::HandingOver(on) => Some(on.handover.new_id()),
            Phase::CannotSign { key, .. } => Some(key.id()),
            Phase::Keyless | Phase::Relaying(_) => None,
        }
    }
}

/// How long PX4 counts as signed after a frame that verified; it sends something each second, and takes longer to start.
const SIGNED_LATELY: Duration = Duration::from_millis(1_800);

/// How far a zeroize has gone.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub(super) enum Stage {
    #[default]
    Safe,
    /// Of the ground, or of an operator of this computer.
    ToStore { ground: bool },
    /// A start has found it, and PX4 has not shown yet that it can be given another key.
    Waiting { until: Duration },
    /// PX4 is being given another key.
    Replacing { until: Duration },
    /// What it came to is sent to whoever asks; then the agent ends.
    Over { key: AutopilotKey, since: Duration },
}
