//! The payload of 24 that each end sends encrypted: what it holds, and what it wants.

use crate::signing::KeyId;

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

/// What the keys are wanted for.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Wanted {
    /// Bit 1: MAVLink signing.
    pub signing: bool,
    /// Bit 2: the confidential link.
    pub confidential: bool,
}

/// What the responder says of its vehicle.
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

    /// Bits and bytes that mean nothing yet are passed over: a later version may use them.
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn facts_stand_where_the_design_has_them() {
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
