//! Sockets, files, clocks and the log around the sans-I/O machines of `session`, `airside` and `key_exchange`.
//!
//! From the bottom up: `ownership` checks which files are trusted; `disk` implements [`Disk`](mavlink_link::store::Disk),
//! and `queued_disk` puts a thread before it that writes, so that a running bridge never waits for that; `key_file`
//! and `key_store` are the signing keys, `memory` keeps them out of swap, `guard_file` those of the DLI guard, `guard_agreed` those agreed with the guard,
//! `ordered_files` the thread that writes them, `lent_files` what a thread may change that outlives its store; `clock` and
//! `timer` the time, `sockets` UDP and serial lines, `interfaces` the networks, `local_peers` with `socket_owners` the
//! programs at their other end, `encryption` the encrypted links on these,
//! `rest` what a loop does with one that fails;
//! `recording` and `dli_recording` write the traffic, `log_pipe` the log; `status_socket`, `pairing_socket`, `web` and
//! `service` show the state to people and to systemd; `tasks` ends a program when a part of it has ended. On these stand
//! the programs: `server` (`vsm run`), `replay` (`vsm replay`), `airside` with `airside_disk` and `airside_key` (`vsm
//! airside`), `guard_proxy` and `guard_link` (`vsm guard`), `pairing` (`vsm pair`), `key_link` (`vsm key`) and
//! `settings_link` (`vsm check-vehicle`). `self_check` holds the checks that need no bridge, with `trial_disk` for a start
//! that is only tried, `fleet` a
//! store that several computers share, `erase` what `vsm zeroize` and an order to zeroize do with the files of all these.

pub mod airside;
pub mod airside_disk;
pub mod airside_key;
pub mod clock;
pub mod disk;
pub mod dli_recording;
mod encryption;
pub mod erase;
pub mod files_socket;
#[cfg(feature = "etcd")]
pub mod fleet;
pub mod guard_agreed;
pub mod guard_file;
pub mod guard_link;
pub mod guard_proxy;
pub mod interfaces;
pub mod key_file;
pub mod key_link;
pub mod key_store;
mod lent_files;
pub mod local_peers;
pub mod log_pipe;
pub mod memory;
pub mod ordered_files;
pub mod ownership;
pub mod pairing;
pub mod pairing_socket;
pub mod queued_disk;
pub mod recording;
pub mod replay;
mod rest;
pub mod self_check;
pub mod server;
pub mod service;
pub mod settings_link;
mod socket_owners;
pub mod sockets;
pub mod status_socket;
pub mod tasks;
pub mod tcp;
mod test_fault;
mod timer;
mod trial_disk;
pub mod web;
