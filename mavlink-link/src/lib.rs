//! MAVLink 2 to a PX4 vehicle, signed: frames, signing, one machine for each link, PX4's services, and its keys.
//!
//! From the bytes up, each module using only those above it:
//!
//! | module | what it does |
//! |---|---|
//! | [`frame`] | finds frames in bytes and encodes them; usable alone |
//! | [`store`] | the one way to persist: typed records over a disk |
//! | [`signing`] | signs and verifies frames; [`clock`] decides which timestamps may be used |
//! | [`link`] | one machine for each physical link; [`receiver`] decides which frames are accepted |
//! | [`service`] | PX4's mission, parameter and command protocols, from the ground station's side |
//! | [`provisioning`] | gives a vehicle a new signing key, and proves which key it has |
//! | [`exchange`] | agrees on a signing key over the air (feature `key-exchange`) |
//! | [`encrypted`] | encrypts a link between the ground and the air-side agent (feature `encrypted-link`) |
//! | [`tlog`] | recordings of a link without its secrets |
//!
//! Nothing here owns a socket, a clock, a disk or randomness: time is an argument ([`Now`]), and what must survive a
//! restart is written to a [`store::Disk`]. Foreign input never panics and never makes memory grow. The message structs
//! are those of the `mavlink` crate's `development` [`dialect`].
//!
//! Comments name pitfalls by number: the errors of other signing implementations, listed with the tests that show each
//! in `docs/reference/promises.md` of the repository.

#![forbid(unsafe_code)]

mod address;
#[cfg(feature = "encrypted-link")]
pub mod encrypted;
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
