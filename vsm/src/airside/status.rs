//! What the agent is doing, for `vsm airside status`. Keys are named by their ids only.

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
    /// How it stands with PX4's key: "relaying", "no key", "staged", "waits for disarmed", "key sent", "asks which key
    /// PX4 has", "rolled back", "PX4 cannot sign".
    pub state: &'static str,
    /// The id of the key in force.
    pub key_id: Option<String>,
    /// The id of a key that PX4 is to be given, or may have been.
    pub next_key_id: Option<String>,
    /// Frames of the ground passed on to PX4.
    pub to_px4: u64,
    /// Frames of PX4 passed on to the ground.
    pub to_ground: u64,
    /// Verified frames not passed on all the same, by the reason.
    pub held_back: Counters,
    /// Messages that the ground may not send to PX4, by their ids.
    pub denied_messages: ByType,
    /// Commands that it may not give, by their numbers.
    pub denied_commands: ByType,
    /// The fingerprint of the agent's own static key.
    pub identity: String,
    /// That of the ground's, once paired.
    pub ground: Option<String>,
    /// How long the pairing window is still open, s.
    pub window_s: Option<u64>,
    /// KEY_EXCHANGE by what became of it.
    pub exchange: BTreeMap<&'static str, u64>,
    /// How the encrypted link stands, where the ground's is one.
    pub encryption: Option<EncryptionStatus>,
    /// What it flies while nothing is received of the ground, where that is configured.
    pub contingency: Option<AloneStatus>,
    /// The ground's side.
    pub radio: SideStatus,
    /// PX4's side.
    pub px4: SideStatus,
}

/// One side.
#[derive(Debug, Clone, Serialize)]
pub struct SideStatus {
    /// Where the other end is.
    pub peer: Option<String>,
    /// How it stands: "waiting", "live", "unanswered", "behind" or "ahead", as the bridge's link.
    pub state: &'static str,
    /// How old the newest frame of ours is that a verified frame from there has answered, or the first where none has
    /// been, s.
    pub unanswered_s: Option<f64>,
    /// Frames by what became of them.
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
