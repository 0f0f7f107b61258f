//! `vsm klv`: what a vehicle reports as MISB ST 0601 metadata, alone or in an MPEG transport stream beside a video.
//!
//! It is a ground station of its own process with LOI 2, which only reads: it knows of the aircraft what every CUCS is sent, works
//! behind any VSM, and the bridge treats it by the rules for stations. Reading the bridge's own state would give nothing more, and
//! would be work in the thread that flies.
//!
//! - [`view`]: messages 3, 4000 and 21101 become local sets ([`stanag_msgs::klv`]);
//! - [`h264`]: a byte stream is split into access units, the pictures;
//! - [`transport`]: both become packets of a transport stream.
//!
//! All three are without clock and I/O; `program/klv.rs` has the sockets.

pub mod h264;
pub mod transport;
pub mod view;
