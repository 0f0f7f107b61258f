//! The stored state of the ground side of the key exchange: its static key, and for each vehicle the paired agent, counter
//! and epoch.

use data_encoding::HEXLOWER;
use mavlink_link::exchange::{Identity, PublicKey, Random};
use mavlink_link::signing::KeyId;
use mavlink_link::store::{Disk, Durability, Store as _, StoreError};
use serde::{Deserialize, Serialize};
use stanag_msgs::Id;
use zeroize::Zeroizing;

use crate::session::vehicle_record;

/// One vehicle's record. Public keys and key ids only.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ExchangeRecord {
    /// The paired agent's static key.
    #[serde(default, with = "hex", skip_serializing_if = "Option::is_none")]
    pub peer: Option<[u8; 32]>,
    /// An agent whose pairing is not proven, and the key that would prove it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub pending: Option<Pending>,
    /// The last key that the agent has confirmed.
    #[serde(default, with = "hex", skip_serializing_if = "Option::is_none")]
    pub agreed: Option<[u8; 8]>,
    /// The counter of the last attempt.
    #[serde(default)]
    pub counter: u64,
    /// The highest agreed epoch.
    #[serde(default)]
    pub epoch: u32,
    /// The key that `since` is about.
    #[serde(default, with = "hex", skip_serializing_if = "Option::is_none")]
    pub key: Option<[u8; 8]>,
    /// When that key was first used, s since 1970.
    #[serde(default)]
    pub since: u64,
    /// What `since` was before a wall clock that was far behind it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub doubted: Option<u64>,
}

/// A pairing that was answered and not confirmed.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Pending {
    /// The static key that the agent claims.
    #[serde(with = "hex")]
    pub peer: Option<[u8; 32]>,
    /// A frame of the vehicle under this key proves it.
    #[serde(with = "hex")]
    pub key: Option<[u8; 8]>,
}

impl ExchangeRecord {
    /// The record of a vehicle; empty if there is none.
    ///
    /// # Errors
    /// It is there and cannot be read.
    pub fn load(store: &dyn Disk, vehicle: Id) -> Result<ExchangeRecord, StoreError> {
        Ok(store.load(&vehicle)?.unwrap_or_default())
    }

    /// Stores it.
    ///
    /// # Errors
    /// It is not durable.
    pub fn save(&self, store: &mut dyn Disk, vehicle: Id) -> Result<(), StoreError> {
        store.save(&vehicle, self)
    }

    /// The paired agent.
    #[must_use]
    pub fn peer(&self) -> Option<PublicKey> {
        self.peer.map(PublicKey::new)
    }

    /// Notes the key that is in use at this time, s since 1970. Returns true if it differs from the one before.
    pub fn note_key(&mut self, key: KeyId, wall_s: u64) -> bool {
        let changed = self.key != Some(*key.bytes());
        if changed {
            (self.key, self.since, self.doubted) = (Some(*key.bytes()), wall_s, None);
        }
        changed
    }

    /// Compares the date of the key with the wall clock, s since 1970. Returns true if it was changed.
    ///
    /// A date that is ahead, by more than a clock that is corrected now and then, is replaced: by it the key would never grow old.
    /// Only one of the two clocks was wrong, and it may be this one: then it comes past the first date again, which is put back.
    pub fn note_clock(&mut self, wall_s: u64) -> bool {
        let latest = wall_s.saturating_add(A_DAY_S);
        if let Some(before) = self.doubted.take_if(|before| *before <= latest) {
            self.since = before;
            return true;
        }
        let ahead = self.since > latest;
        if ahead {
            self.doubted = self.doubted.or(Some(self.since));
            self.since = wall_s;
        }
        ahead
    }
}

const A_DAY_S: u64 = 86_400;

vehicle_record!(ExchangeRecord, "exchange", Power);

/// The static key of this VSM; generated and stored if there is none yet.
///
/// # Errors
/// It cannot be read or made durable, or there are no random bytes.
pub fn identity(disk: &mut dyn Disk, random: &mut dyn Random) -> Result<Identity, StoreError> {
    identity_in(IDENTITY, disk, random)
}

/// As [`identity`], for the exchanges with the guards of CUCSs, where this VSM is the responder: another role has another
/// key.
///
/// # Errors
/// As [`identity`].
pub fn guard_identity(
    disk: &mut dyn Disk,
    random: &mut dyn Random,
) -> Result<Identity, StoreError> {
    identity_in(GUARD_IDENTITY, disk, random)
}

fn identity_in(
    name: &str,
    disk: &mut dyn Disk,
    random: &mut dyn Random,
) -> Result<Identity, StoreError> {
    if let Some(bytes) = disk.read(name, MAX_IDENTITY_BYTES)? {
        // An unreadable identity is an error and is not replaced: a new static key would end every pairing.
        return parse_identity(&bytes)
            .ok_or_else(|| StoreError::new(name, "expected 64 hex digits"));
    }
    let identity =
        Identity::generate(random).map_err(|_| StoreError::new(name, "no random bytes"))?;
    let text = Zeroizing::new(HEXLOWER.encode(identity.expose()));
    disk.replace(name, text.as_bytes(), Durability::Power)?;
    Ok(identity)
}

/// The static key of a VSM from the content of its file.
pub(crate) fn parse_identity(bytes: &[u8]) -> Option<Identity> {
    let text = std::str::from_utf8(bytes).ok()?;
    let mut key = Zeroizing::new([0; 32]);
    hex::fill(text.trim_end(), &mut *key).then(|| Identity::new(*key))
}

/// The file of the static key.
pub(crate) const IDENTITY: &str = "exchange-identity";
const GUARD_IDENTITY: &str = "exchange-guard-identity";
/// The identity is 64 digits; more than this is never read.
pub(crate) const MAX_IDENTITY_BYTES: u64 = 256;

/// Bytes as hexadecimal text in the record.
mod hex {
    use data_encoding::{HEXLOWER, HEXLOWER_PERMISSIVE};
    use serde::{Deserialize as _, Deserializer, Serializer, de};

    /// Whether the text held exactly this many bytes.
    pub(super) fn fill(text: &str, out: &mut [u8]) -> bool {
        let digits = text.as_bytes();
        digits.len() == out.len() * 2 && HEXLOWER_PERMISSIVE.decode_mut(digits, out).is_ok()
    }

    pub(super) fn serialize<S: Serializer, const N: usize>(
        bytes: &Option<[u8; N]>,
        serializer: S,
    ) -> Result<S::Ok, S::Error> {
        match bytes {
            Some(bytes) => serializer.serialize_str(&HEXLOWER.encode(bytes)),
            None => serializer.serialize_none(),
        }
    }

    pub(super) fn deserialize<'de, D: Deserializer<'de>, const N: usize>(
        deserializer: D,
    ) -> Result<Option<[u8; N]>, D::Error> {
        let Some(text) = Option::<String>::deserialize(deserializer)? else {
            return Ok(None);
        };
        let mut bytes = [0; N];
        if fill(&text, &mut bytes) {
            return Ok(Some(bytes));
        }
        let expected = format!("{} hex digits", N * 2);
        Err(de::Error::invalid_value(
            de::Unexpected::Str(&text),
            &expected.as_str(),
        ))
    }
}

#[cfg(test)]
mod tests {
    use mavlink_link::store::MemoryDisk;

    use super::*;

    #[test]
    fn a_step_of_the_wall_clock_makes_no_key_old_and_none_young_for_ever() {
        let (agreed, years) = (1_796_000_000, 5 * 365 * A_DAY_S);
        let mut record = ExchangeRecord::default();
        record.note_key(KeyId::from_bytes([5; 8]), agreed);
        assert!(!record.note_clock(agreed + 60));
        // Back, further back, and right again.
        assert!(record.note_clock(agreed - years));
        assert_eq!(record.since, agreed - years);
        assert!(record.note_clock(agreed - 2 * years));
        assert!(record.note_clock(agreed + 120));
        assert_eq!((record.since, record.doubted), (agreed, None));
        // It was noted by a clock that was ahead: from now on it grows old.
        let right = agreed - years;
        assert!(record.note_clock(right));
        assert!(!record.note_clock(right + 40 * A_DAY_S));
        assert_eq!(record.since, right);
        // Another key is not concerned.
        assert!(record.note_key(KeyId::from_bytes([6; 8]), right + 40 * A_DAY_S));
        assert!(!record.note_clock(agreed));
        assert_eq!(record.since, right + 40 * A_DAY_S);
    }

    #[test]
    fn a_record_and_the_identity_come_back_from_the_disk() {
        let vehicle = Id(0x1b00_0101);
        let mut disk = MemoryDisk::default();
        let mut record = ExchangeRecord::load(&disk, vehicle).unwrap();
        assert_eq!(record, ExchangeRecord::default());
        record.peer = Some([7; 32]);
        record.pending = Some(Pending {
            peer: Some([8; 32]),
            key: Some([9; 8]),
        });
        record.agreed = Some([6; 8]);
        record.counter = u64::MAX;
        assert!(record.note_key(KeyId::from_bytes([5; 8]), 12));
        assert!(!record.note_key(KeyId::from_bytes([5; 8]), 13));
        record.save(&mut disk, vehicle).unwrap();
        assert_eq!(ExchangeRecord::load(&disk, vehicle).unwrap(), record);

        let mut random = |out: &mut [u8]| {
            out.fill(3);
            Ok(())
        };
        let made = identity(&mut disk, &mut random).unwrap().public();
        assert_eq!(identity(&mut disk, &mut random).unwrap().public(), made);
        disk.replace(IDENTITY, b"short", Durability::Power).unwrap();
        assert!(identity(&mut disk, &mut random).is_err());
    }
}
