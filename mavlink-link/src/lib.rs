//! MAVLink 2 frames, signing, the peer lock and the PX4 services, without sockets or clock.
//!
//! From the bytes up: [`frame`] finds and makes frames, [`signing`] signs and verifies them, [`clock`]
//! says which stamps may be used and [`receiver`] which frames are believed; [`link`] joins them into
//! one machine a physical link, and [`service`] speaks PX4's mission, command and parameter protocols
//! over it. [`provisioning`] gives a vehicle a key, [`exchange`] agrees about one over the air. [`frame`] and [`signing`] are usable alone.
//!
//! Nothing here owns a socket, a clock, a disk or randomness: time comes in as [`Now`], what must survive a restart
//! goes out through [`store::Disk`]. Foreign input never panics and never makes memory grow. The message structs are those of the `mavlink` crate's `development` [`dialect`].

#![forbid(unsafe_code)]

#[cfg(feature = "key-exchange")]
pub mod exchange;
pub mod frame;
pub mod link;
pub mod provisioning;
pub mod service;
pub mod signing;
pub mod store;
mod time;
pub mod tlog;

pub use mavlink::dialects::development as dialect;

#[doc(inline)]
pub use self::link::receiver;
#[doc(inline)]
pub use self::signing::clock;
pub use self::time::Now;

/// The example of the README is a test.
#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;
