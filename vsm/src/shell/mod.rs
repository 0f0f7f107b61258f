//! Sockets, files, clocks and the log around the sessions. It can be read in one sitting.

pub mod airside;
pub mod airside_disk;
pub mod clock;
pub mod disk;
pub mod dli_recording;
pub mod http;
pub mod key_file;
pub mod key_guard;
pub mod key_link;
pub mod key_store;
pub mod pairing;
pub mod pairing_socket;
pub mod recording;
pub mod server;
pub mod service;
pub mod sitl_key_file;
pub mod sockets;
pub mod status_socket;
