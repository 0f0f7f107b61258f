//! The state of an encrypted link, for the status.

use std::collections::BTreeMap;

use serde::Serialize;

/// One end of an encrypted link.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct EncryptionStatus {
    /// "unpaired" (only a pairing can pass), "agreeing" (no keys yet), "silent" (keys exist, but no packet has verified for
    /// 5 s) or "encrypted" (packets of the other end verify).
    pub state: &'static str,
    /// The epoch of the keys in use.
    pub epoch: Option<u32>,
    /// Counters of packets, and of dropped packets by reason.
    pub packets: BTreeMap<&'static str, u64>,
}
