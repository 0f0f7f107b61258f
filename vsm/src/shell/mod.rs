//! Sockets, files, clocks and the log around the sessions. It can be read in one sitting.

pub mod clock;
pub mod file_store;
pub mod key_file;
pub mod recording;
pub mod server;
pub mod sockets;
pub mod status_socket;
