//! Sockets, files, clocks and the log around the sessions. It can be read in one sitting.

pub mod file_store;
pub mod key_file;
