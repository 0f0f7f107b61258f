//! MAVLink 2 frames, signing, the peer lock and the PX4 services, without sockets or clock.

#![forbid(unsafe_code)]

pub mod clock;
pub mod frame;
pub mod link;
pub mod receiver;
pub mod service;
pub mod signing;
mod time;
pub mod tlog;

pub use mavlink::dialects::development as dialect;

pub use self::time::Now;
