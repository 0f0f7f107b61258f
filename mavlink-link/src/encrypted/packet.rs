//! One packet: id u32 ‖ counter u32 ‖ 80 bytes, encrypted ‖ tag of 8; all numbers big-endian. AES-256-GCM.
//!
//! The nonce is id ‖ epoch ‖ counter, of which the epoch is not on the wire. Associated data is the frame's kind, id and
//! counter. A tag of 8 bytes is within NIST SP 800-38D, appendix C, as failed attempts under one key are limited
//! ([`Opener`](super::opener::Opener)).

use core::fmt;

use aes_gcm::aead::consts::{U8, U12};
use aes_gcm::aead::{AeadInOut as _, KeyInit as _};
use aes_gcm::{AesGcm, aes::Aes256};

use super::framing::Kind;

/// What is encrypted of a packet.
pub(super) const PLAIN: usize = 80;
/// The content of its frame: kind, id, counter, 80 bytes and tag.
pub(super) const PACKET: usize = 1 + 8 + PLAIN + TAG;

pub(super) const TAG: usize = 8;
const ASSOCIATED: usize = 1 + 8;

/// The end of a packet, which nobody else can have made for it.
pub(super) fn tag_of(packet: &[u8; PACKET]) -> [u8; TAG] {
    let mut tag = [0; TAG];
    tag.copy_from_slice(&packet[PACKET - TAG..]);
    tag
}

/// One key, used in one direction by one station in one epoch. The schedule lies on the heap, where it is wiped when
/// dropped: no later move leaves a copy. It is made on the stack, which may keep one until that is written again: the crate has
/// no way to make it in place.
pub(super) struct PacketKey {
    cipher: Box<AesGcm<Aes256, U12, U8>>,
    id: u32,
    epoch: u32,
}

impl fmt::Debug for PacketKey {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("PacketKey")
            .field("id", &self.id)
            .field("epoch", &self.epoch)
            .finish_non_exhaustive()
    }
}

impl PacketKey {
    /// The key of the station with this id, in this epoch.
    pub(super) fn new(key: &[u8; 32], id: u32, epoch: u32) -> Self {
        Self {
            cipher: Box::new(AesGcm::new(key.into())),
            id,
            epoch,
        }
    }

    fn nonce(&self, counter: u32) -> [u8; 12] {
        let mut nonce = [0; 12];
        nonce[..4].copy_from_slice(&self.id.to_be_bytes());
        nonce[4..8].copy_from_slice(&self.epoch.to_be_bytes());
        nonce[8..].copy_from_slice(&counter.to_be_bytes());
        nonce
    }

    /// Whether the packet names this key's station.
    pub(super) fn is_of(&self, packet: &[u8; PACKET]) -> bool {
        packet[1..5] == self.id.to_be_bytes()
    }

    /// Seals a packet. The caller uses each counter once.
    pub(super) fn seal(&self, counter: u32, plain: &[u8; PLAIN]) -> Option<[u8; PACKET]> {
        let mut packet = [0; PACKET];
        packet[0] = Kind::Data.to_wire();
        packet[1..5].copy_from_slice(&self.id.to_be_bytes());
        packet[5..ASSOCIATED].copy_from_slice(&counter.to_be_bytes());
        let (associated, rest) = packet.split_at_mut(ASSOCIATED);
        let (data, tag) = rest.split_at_mut(PLAIN);
        data.copy_from_slice(plain);
        let nonce = self.nonce(counter);
        // It fails for lengths that no packet has; nothing is sent then.
        let sealed = self
            .cipher
            .encrypt_inout_detached((&nonce).into(), associated, data.into())
            .ok()?;
        tag.copy_from_slice(&sealed);
        Some(packet)
    }

    /// What a packet holds, where it was sealed with this key and has not been changed.
    pub(super) fn open(&self, packet: &[u8; PACKET]) -> Option<[u8; PLAIN]> {
        let (associated, rest) = packet.split_at(ASSOCIATED);
        let (data, tag) = rest.split_first_chunk::<PLAIN>()?;
        let tag: &[u8; TAG] = tag.try_into().ok()?;
        let mut plain = *data;
        let nonce = self.nonce(counter_of(packet));
        self.cipher
            .decrypt_inout_detached(
                (&nonce).into(),
                associated,
                plain.as_mut_slice().into(),
                tag.into(),
            )
            .ok()?;
        Some(plain)
    }
}

/// The counter of a packet, as on the wire.
pub(super) fn counter_of(packet: &[u8; PACKET]) -> u32 {
    u32::from_be_bytes([packet[5], packet[6], packet[7], packet[8]])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_packet_is_sealed_as_another_implementation_does_it() {
        // Python's `cryptography` 50.0.2, AESGCM(bytes(range(32))).encrypt(nonce, data, associated); the first 8 of its tag.
        let key: [u8; 32] = core::array::from_fn(|at| at as u8);
        let plain: [u8; PLAIN] = core::array::from_fn(|at| at as u8 ^ 0x5a);
        let packet = PacketKey::new(&key, 0x1b00_0001, 7)
            .seal(9, &plain)
            .unwrap();
        assert_eq!(packet[..9], [0, 0x1b, 0, 0, 1, 0, 0, 0, 9]);
        let hex: String = packet[9..]
            .iter()
            .map(|byte| format!("{byte:02x}"))
            .collect();
        assert_eq!(hex, VECTOR);
    }

    #[test]
    fn no_byte_can_be_changed_and_no_other_station_epoch_or_direction_opens_it() {
        let key = PacketKey::new(&[1; 32], 2, 3);
        let packet = key.seal(4, &[5; PLAIN]).unwrap();
        assert_eq!(key.open(&packet), Some([5; PLAIN]));
        for at in 0..PACKET {
            let mut bent = packet;
            bent[at] ^= 0x10;
            assert_eq!(key.open(&bent), None, "byte {at}");
        }
        for other in [
            PacketKey::new(&[1; 32], 3, 3),
            PacketKey::new(&[1; 32], 2, 4),
            PacketKey::new(&[2; 32], 2, 3),
        ] {
            assert_eq!(other.open(&packet), None);
        }
        assert!(!format!("{key:?}").contains("01, 01"));
    }

    const VECTOR: &str = "f222ff9e2fa4b8d3f429eeb27df1131aabf8dab60b5226bc187d549ec770dd36c6ec1b82142de565403534927e53f8ca7d72\
         601dc7bc9b2fcca2535aa40a21bed3cc1efc42c3dd64be6fc25fe38b19facc4a45785de284f0";
}
