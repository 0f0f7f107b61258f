//! What both ends agree on beside the secrets: who they are, what the keys are for, what each has stored.

use sha2::{Digest as _, Sha256};

use super::identity::PublicKey;
use super::message::Suite;
use crate::frame::Node;
use crate::signing::KeyId;

/// What both ends must know alike; otherwise nothing decrypts. It is part of the Noise prologue.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Parties {
    /// The ground side, which starts.
    pub initiator: Node,
    /// The air side, which answers.
    pub responder: Node,
    /// The VSM's DLI identification number.
    pub vsm_id: u32,
    /// The DLI identification number of the vehicle, or of the CUCS whose guard it is.
    pub vehicle_id: u32,
    /// SHA-256 of the canonical policy text, [`policy_digest`].
    pub policy: [u8; 32],
}

impl Parties {
    /// Both ends under the policy of this version, [`POLICY`].
    #[must_use]
    pub fn new(initiator: Node, responder: Node, vsm_id: u32, vehicle_id: u32) -> Self {
        Self {
            initiator,
            responder,
            vsm_id,
            vehicle_id,
            policy: policy_digest(POLICY),
        }
    }

    /// The guard of a CUCS, which starts, and the VSM, which answers: the same exchange in datagrams of the DLI's port.
    /// MAVLink's ids only tell the ends apart. The policy differs, so that no step of one exchange is valid in the other.
    #[must_use]
    pub fn of_guard(vsm_id: u32, cucs_id: u32) -> Self {
        let end = |component| Node {
            system: 0,
            component,
        };
        Self {
            policy: policy_digest(GUARD_POLICY),
            ..Self::new(end(1), end(2), vsm_id, cucs_id)
        }
    }

    /// Both ends' system and component ids, then VSM and vehicle id, big-endian.
    pub(super) fn ids(&self) -> [u8; 12] {
        let mut ids = [0; 12];
        ids[0] = self.initiator.system;
        ids[1] = self.initiator.component;
        ids[2] = self.responder.system;
        ids[3] = self.responder.component;
        ids[4..8].copy_from_slice(&self.vsm_id.to_be_bytes());
        ids[8..].copy_from_slice(&self.vehicle_id.to_be_bytes());
        ids
    }

    /// The Noise prologue of one session.
    pub(super) fn prologue(&self, suite: Suite, session: u32) -> [u8; PROLOGUE] {
        let mut prologue = [0; PROLOGUE];
        let (label, rest) = prologue.split_at_mut(LABEL.len());
        label.copy_from_slice(LABEL);
        // rest[0] is the zero that ends the label.
        rest[1] = suite.to_wire();
        rest[2..14].copy_from_slice(&self.ids());
        rest[14..18].copy_from_slice(&session.to_le_bytes());
        rest[18..].copy_from_slice(&self.policy);
        prologue
    }
}

/// What is agreed on beside the secrets.
pub(super) struct Terms<'a> {
    pub(super) parties: &'a Parties,
    pub(super) session: u32,
    /// What both ends request.
    pub(super) wanted: [Wanted; 2],
    /// The epochs that both ends have stored.
    pub(super) epochs: [u32; 2],
    pub(super) peer: PublicKey,
}

/// counter, wanted, state, zero, epoch, current key id; integers little-endian, as MAVLink's own fields.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Facts {
    /// Rises with every attempt of the initiator; zero from the responder.
    pub(super) counter: u64,
    pub(super) wanted: Wanted,
    pub(super) state: VehicleState,
    /// The highest epoch of the confidential link that this end has stored.
    pub(super) epoch: u32,
    /// The key in force, zeros where there is none.
    pub(super) current: Option<KeyId>,
}

/// What the keys are for.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Wanted {
    /// Bit 1: MAVLink signing.
    pub signing: bool,
    /// Bit 2: the confidential link.
    pub confidential: bool,
}

/// What the responder reports of its vehicle.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct VehicleState {
    /// Bit 1: armed.
    pub armed: bool,
    /// Bit 2: the autopilot signs.
    pub signed: bool,
}

impl Facts {
    pub(super) const LEN: usize = 24;

    pub(super) fn to_bytes(self) -> [u8; Self::LEN] {
        let mut bytes = [0; Self::LEN];
        bytes[..8].copy_from_slice(&self.counter.to_le_bytes());
        bytes[8] = u8::from(self.wanted.signing) | u8::from(self.wanted.confidential) << 1;
        bytes[9] = u8::from(self.state.armed) | u8::from(self.state.signed) << 1;
        bytes[12..16].copy_from_slice(&self.epoch.to_le_bytes());
        if let Some(current) = self.current {
            bytes[16..].copy_from_slice(current.bytes());
        }
        bytes
    }

    /// Bits and bytes without a meaning are ignored: a later version may use them.
    pub(super) fn parse(bytes: &[u8]) -> Option<Self> {
        let bytes: &[u8; Self::LEN] = bytes.try_into().ok()?;
        let mut counter = [0; 8];
        counter.copy_from_slice(&bytes[..8]);
        let mut id = [0; 8];
        id.copy_from_slice(&bytes[16..]);
        Some(Self {
            counter: u64::from_le_bytes(counter),
            wanted: Wanted {
                signing: bytes[8] & 1 != 0,
                confidential: bytes[8] & 2 != 0,
            },
            state: VehicleState {
                armed: bytes[9] & 1 != 0,
                signed: bytes[9] & 2 != 0,
            },
            epoch: u32::from_le_bytes([bytes[12], bytes[13], bytes[14], bytes[15]]),
            current: (id != [0; 8]).then(|| KeyId::from_bytes(id)),
        })
    }
}

/// SHA-256 of a policy text, as both ends must have it.
#[must_use]
pub fn policy_digest(text: &str) -> [u8; 32] {
    Sha256::digest(text.as_bytes()).into()
}

/// The canonical policy text of this version: what an agreed key is used for. Its digest is part of the prologue, so two
/// programs that would use a key differently never agree on one.
pub const POLICY: &str = "vsm policy 1\n\
    signing: MAVLink 2, required in both directions\n\
    unsigned: RADIO_STATUS, KEY_EXCHANGE\n\
    provisioning: air-side agent, disarmed\n";

/// As [`POLICY`], for the keys of the DLI guard.
pub const GUARD_POLICY: &str = "vsm guard policy 1\n\
    trailer: HMAC-SHA256 on every datagram, required in both directions\n\
    in force: at the VSM as soon as it is agreed, the one before for 24 h\n";

const LABEL: &[u8] = b"vsm-key-agreement/1";
const PROLOGUE: usize = LABEL.len() + 2 + 12 + 4 + 32;

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn facts_are_laid_out_as_designed() {
        let facts = Facts {
            counter: 0x0807_0605_0403_0201,
            wanted: Wanted {
                signing: true,
                confidential: true,
            },
            state: VehicleState {
                armed: false,
                signed: true,
            },
            epoch: 0x0d0c_0b0a,
            current: Some(KeyId::from_bytes([9; 8])),
        };
        let bytes = facts.to_bytes();
        assert_eq!(bytes[..12], [1, 2, 3, 4, 5, 6, 7, 8, 3, 2, 0, 0]);
        assert_eq!(bytes[12..16], [0x0a, 0x0b, 0x0c, 0x0d]);
        assert_eq!(bytes[16..], [9; 8]);
        assert_eq!(Facts::parse(&bytes), Some(facts));
        assert_eq!(Facts::parse(&bytes[1..]), None);
    }
}
