//! The bridge: any STANAG 4586 ground station flies any PX4.
//!
//! - [`airside`]: the agent beside PX4, sans-I/O too.
//! - [`config`]: the configuration file.
//! - [`guard_exchange`]: agrees about keys of the DLI guard, sans-I/O too.
//! - [`key_exchange`]: agrees about signing keys with the air-side agent, sans-I/O too.
//! - `klv`: a vehicle's state as the metadata of a video; a ground station of its own, beside the bridge.
//! - [`program`]: the command line.
//! - [`relay_policy`]: what may be passed on to PX4.
//! - [`session`]: sans-I/O machines that know time.
//! - [`shell`]: sockets, files, clocks, the log.

#![forbid(unsafe_code)]

pub mod airside;
pub mod config;
pub mod guard_exchange;
pub mod key_exchange;
#[cfg(feature = "klv")]
pub mod klv;
pub mod program;
pub mod relay_policy;
pub mod session;
pub mod shell;

/// The name of a MAVLink message of the dialect; empty where it has none.
#[must_use]
pub fn message_name(id: u32) -> &'static str {
    use mavlink::Message as _;
    mavlink_link::dialect::MavMessage::default_message_from_id(id)
        .map_or("", |message| message.message_name())
}
