//! The agent's disk: the ceilings of its clocks in its store folder, its keys beside their file.

use std::fmt::Write as _;

use mavlink_link::clock::{CeilingStore, StoreError};
use mavlink_link::exchange::{self, Agreed, PinnedPeer, PublicKey, ResponderStore};
use mavlink_link::signing::{KeyId, SigningKey, Stamp};
use serde::{Deserialize, Serialize};

use super::airside::AirsideError;
use super::file_store::FileStore;
use super::key_store::{KeyStore, KeyStoreError};
use crate::airside::{Held, Keys};
use crate::session::{Ceilings, Durability, Store as _};

/// Both, locked for this process.
#[derive(Debug)]
pub struct AirsideDisk {
    pub(super) store: FileStore,
    pub(super) keys: KeyStore,
}

impl AirsideDisk {
    /// The keys as they lie there, and whom it was paired with.
    ///
    /// # Errors
    /// One is there and cannot be used.
    pub fn held(&self) -> Result<Held, AirsideError> {
        let record = self.record().map_err(AirsideError::Exchange)?;
        let peer = match &record.peer {
            None => None,
            Some((key, counter)) => Some(PinnedPeer {
                key: PublicKey::new(unhex(key).ok_or_else(|| {
                    AirsideError::Exchange(exchange_fault("the peer's key is no 64 hex digits"))
                })?),
                counter: *counter,
            }),
        };
        Ok(Held {
            peer,
            epoch: record.epoch,
            current: self.keys.current()?,
            next: self.keys.next()?,
            previous: self.keys.previous()?,
        })
    }
}

impl CeilingStore for AirsideDisk {
    fn load(&mut self, key: &KeyId) -> Result<Option<Stamp>, StoreError> {
        Ceilings(&mut self.store).load(key)
    }

    fn store(&mut self, key: &KeyId, ceiling: Stamp) -> Result<(), StoreError> {
        Ceilings(&mut self.store).store(key, ceiling)
    }
}

impl ResponderStore for AirsideDisk {
    fn withdraw_next(&mut self) -> Result<(), exchange::StoreError> {
        self.keys.drop_next().map_err(exchange_fault)
    }

    fn store_peer(&mut self, peer: &PinnedPeer) -> Result<(), exchange::StoreError> {
        let record = Record {
            peer: Some((hex(peer.key.octets()), peer.counter)),
            ..self.record()?
        };
        self.save(&record)
    }

    fn store_next(&mut self, agreed: &Agreed) -> Result<(), exchange::StoreError> {
        let record = self.record()?;
        let epoch = record.epoch.max(agreed.epoch);
        self.save(&Record { epoch, ..record })?;
        self.keys.stage(&agreed.key).map_err(exchange_fault)
    }
}

/// What the exchange keeps, as a record of the store.
#[derive(Debug, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Record {
    /// The ground's static key in hex, and the counter of its last exchange.
    peer: Option<(String, u64)>,
    /// The highest epoch.
    epoch: u32,
}

impl AirsideDisk {
    fn record(&self) -> Result<Record, exchange::StoreError> {
        let octets = self.store.load(RECORD).map_err(exchange_fault)?;
        match octets {
            None => Ok(Record::default()),
            Some(octets) => serde_json::from_slice(&octets).map_err(exchange_fault),
        }
    }

    fn save(&mut self, record: &Record) -> Result<(), exchange::StoreError> {
        let octets = serde_json::to_vec(record).map_err(exchange_fault)?;
        self.store
            .save(RECORD, &octets, Durability::Power)
            .map_err(exchange_fault)
    }
}

fn hex(octets: &[u8; 32]) -> String {
    octets.iter().fold(String::new(), |mut hex, octet| {
        let _ = write!(hex, "{octet:02x}");
        hex
    })
}

fn unhex(text: &str) -> Option<[u8; 32]> {
    let mut octets = [0; 32];
    if text.len() != 64 || !text.is_ascii() {
        return None;
    }
    for (at, octet) in octets.iter_mut().enumerate() {
        *octet = u8::from_str_radix(text.get(2 * at..2 * at + 2)?, 16).ok()?;
    }
    Some(octets)
}

fn exchange_fault(cause: impl std::fmt::Display) -> exchange::StoreError {
    exchange::StoreError {
        reason: cause.to_string(),
    }
}

const RECORD: &str = "exchange.json";

impl Keys for AirsideDisk {
    fn for_exchange(&mut self) -> &mut dyn ResponderStore {
        self
    }

    fn next(&mut self) -> Result<Option<SigningKey>, StoreError> {
        self.keys.next().map_err(fault)
    }

    fn commit(&mut self) -> Result<(), StoreError> {
        self.keys.commit().map_err(fault)
    }

    fn drop_next(&mut self) -> Result<(), StoreError> {
        self.keys.drop_next().map_err(fault)
    }

    fn drop_previous(&mut self) -> Result<(), StoreError> {
        self.keys.drop_previous().map_err(fault)
    }
}

fn fault(cause: KeyStoreError) -> StoreError {
    StoreError {
        reason: cause.to_string(),
    }
}
