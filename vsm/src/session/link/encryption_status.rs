//! How an encrypted link stands, for a status.

use std::collections::BTreeMap;

use serde::Serialize;

/// One end of an encrypted link.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct EncryptionStatus {
    /// "unpaired" (nothing passes but a pairing), "agreeing" (no keys yet), "silent" (keys, and no packet has verified for
    /// 5 s) or "encrypted": packets of the other end verify.
    pub state: &'static str,
    /// The epoch of the keys in use.
    pub epoch: Option<u32>,
    /// Packets and what was dropped, by its reason.
    pub packets: BTreeMap<&'static str, u64>,
}
