//! What the agent is doing, for `vsm airside status`. Keys are named only by their ids.

use std::collections::BTreeMap;
use std::time::Duration;

use mavlink_link::link::Link;
use serde::Serialize;

use super::contingency::AloneStatus;
use crate::session::{ByType, Counters, EncryptionStatus, Peer, link_state_name};

/// The whole agent.
#[derive(Debug, Clone, Serialize)]
pub struct AirsideStatus {
    /// Vehicle ID.
    pub vehicle: String,
    /// Since the start, s.
    pub uptime_s: f64,
    /// The state of PX4's key: "relaying", "no key", "staged", "waits for disarmed", "key sent", "asks which key PX4 has",
    /// "rolled back", "PX4 cannot sign".
    pub state: &'static str,
    /// The id of the key in force.
    pub key_id: Option<String>,
    /// The id of a key that is to be sent to PX4, or may have been sent.
    pub next_key_id: Option<String>,
    /// Whether the memory of the process, and every key in it, is kept out of swap.
    pub memory_locked: bool,
    /// Frames of the ground passed on to PX4.
    pub to_px4: u64,
    /// Frames of PX4 passed on to the ground.
    pub to_ground: u64,
    /// Verified frames that were not passed on, by reason.
    pub held_back: Counters,
    /// Messages that the ground may not send to PX4, by their ids.
    pub denied_messages: ByType,
    /// Commands that it may not send, by their numbers.
    pub denied_commands: ByType,
    /// The fingerprint of the agent's own static key.
    pub identity: String,
    /// That of the ground's, once paired.
    pub ground: Option<String>,
    /// How long the pairing window is still open, s.
    pub window_s: Option<u64>,
    /// KEY_EXCHANGE messages by result.
    pub exchange: BTreeMap<&'static str, u64>,
    /// The state of the encrypted link, if the ground's link is one.
    pub encryption: Option<EncryptionStatus>,
    /// What it flies while nothing is received from the ground, if that is configured.
    pub contingency: Option<AloneStatus>,
    /// The ground's side.
    pub radio: SideStatus,
    /// PX4's side.
    pub px4: SideStatus,
}

/// One side.
#[derive(Debug, Clone, Serialize)]
pub struct SideStatus {
    /// The address of the other end.
    pub peer: Option<String>,
    /// Its state: "waiting", "live", "silent", "unanswered", "behind" or "ahead", as for the bridge's link.
    pub state: &'static str,
    /// The age of the newest frame of ours that a verified frame from there has answered, or of the first one if none has
    /// been answered, s.
    pub unanswered_s: Option<f64>,
    /// Frames by result.
    pub frames: BTreeMap<&'static str, u64>,
}

impl SideStatus {
    pub(super) fn new(link: &Link<Peer>, mono: Duration) -> SideStatus {
        let (stats, unanswered) = (link.stats(), link.unanswered(mono));
        SideStatus {
            peer: link.peer().map(|peer| peer.to_string()),
            state: link_state_name(link, mono),
            unanswered_s: unanswered.map(|age| age.as_secs_f64()),
            frames: stats.iter().filter(|&(_, count)| count > 0).collect(),
        }
    }
}
