//! The state of PX4's key, and of an order to zeroize.

use std::time::Duration;

use mavlink_link::exchange::AutopilotKey;
use mavlink_link::link::Auth;
use mavlink_link::provisioning::{KeyRollover, KeySlot, State};
use mavlink_link::receiver::KeyState;
use mavlink_link::signing::{KeyId, SigningKey};

use super::keys::Keys;
use crate::session::Peer;

/// The phases of an agent. Each decides what is relayed.
#[derive(Debug)]
pub(super) enum Phase {
    /// There is no key: only the key exchange is processed.
    Keyless,
    /// One key is in force: frames that verify under it pass.
    Relaying(Box<Relaying>),
    /// A key is being installed on PX4.
    HandingOver(Box<HandingOver>),
    /// PX4 accepts no key, because it is older than v1.18. Nothing passes; the key is offered again from time to time.
    CannotSign { key: SigningKey, again_at: Duration },
}

#[derive(Debug)]
pub(super) struct Relaying {
    pub(super) key: KeyState,
    /// Kept until PX4 has restarted and still signs with the current key.
    pub(super) previous: Option<SigningKey>,
}

#[derive(Debug)]
pub(super) struct HandingOver {
    pub(super) handover: KeyRollover<Peer>,
    pub(super) cause: Cause,
    /// The key before the one in force, if the latter is being sent again.
    pub(super) previous: Option<SigningKey>,
    /// PX4 has the key, but the files do not yet: when to retry that.
    pub(super) commit_at: Option<Duration>,
}

/// Why a key is installed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Cause {
    /// A new key: the link uses the old one until PX4 has it.
    NewKey,
    /// A zeroize: PX4 gets a key that nobody keeps and no file ever holds.
    Discarded,
    /// PX4 has lost its key, or fallen back to the previous one: nothing passes until it has it again.
    LostKey,
}

impl Cause {
    /// The key that the ground uses in the meantime.
    fn of_ground(self) -> KeySlot {
        match self {
            // The ground switches at PX4's first frame under the new key, which reaches it only through the agent.
            Cause::NewKey | Cause::Discarded => KeySlot::Old,
            Cause::LostKey => KeySlot::New,
        }
    }
}

impl Phase {
    pub(super) fn relaying(key: KeyState, previous: Option<SigningKey>) -> Phase {
        Phase::Relaying(Box::new(Relaying { key, previous }))
    }

    /// The key that verifies frames of the ground.
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

    /// The key that signs a command of the agent itself: the one that PX4 has, if that is known.
    pub(super) fn px4_auth<'a>(&'a mut self, keys: &'a mut dyn Keys) -> Auth<'a> {
        let key = match self {
            Phase::Keyless | Phase::CannotSign { .. } => None,
            Phase::Relaying(relaying) => Some(&mut relaying.key),
            // PX4 accepts a key only while disarmed, so in flight it still uses the old one.
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

    /// Whether the agent itself can command PX4.
    pub(super) fn reaches_px4(&self) -> bool {
        match self {
            Phase::Keyless | Phase::CannotSign { .. } => false,
            Phase::Relaying(_) => true,
            Phase::HandingOver(on) => on.cause == Cause::NewKey && on.handover.has_old_key(),
        }
    }

    /// Whether no command may reach PX4: one that has lost its key would carry out anybody's. `accepted`: when a frame of
    /// PX4 last verified.
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

    /// The key in force, if it is known.
    pub(super) fn key_id(&self) -> Option<KeyId> {
        match self {
            Phase::Relaying(relaying) => Some(relaying.key.id()),
            Phase::HandingOver(_) | Phase::Keyless | Phase::CannotSign { .. } => None,
        }
    }

    /// The key that is to be sent to PX4, or may have been sent.
    pub(super) fn next_id(&self) -> Option<KeyId> {
        match self {
            Phase::HandingOver(on) => Some(on.handover.new_id()),
            Phase::CannotSign { key, .. } => Some(key.id()),
            Phase::Keyless | Phase::Relaying(_) => None,
        }
    }
}

/// How long PX4 counts as signed after a verified frame. It sends at least one frame a second, and a restart takes longer
/// than this.
const SIGNED_LATELY: Duration = Duration::from_millis(1_800);

/// The progress of a zeroize.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub(super) enum Stage {
    #[default]
    Safe,
    /// An order has arrived, from the ground or from an operator of this computer.
    ToStore { ground: bool },
    /// A restart has found a stored order, and PX4 has not shown yet that it can be given another key.
    Waiting { until: Duration },
    /// PX4 is being given another key.
    Replacing { until: Duration },
    /// Its result is sent to whoever asks; then the agent ends.
    Over { key: AutopilotKey, since: Duration },
}
