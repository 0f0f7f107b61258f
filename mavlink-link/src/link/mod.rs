//! One physical link to one vehicle: parser, receiver, peer lock and sender in one machine.
//!
//! The caller owns sockets, clocks, keys and disk. It hands in what arrives with
//! [`Link::handle_datagram`], calls [`Link::handle_timeout`] when [`Link::poll_timeout`] says so, and
//! after each of the two sends what [`Link::poll_transmit`] has and reads [`Link::poll_event`].
//!
//! Promised: foreign input never panics, blocks or allocates; on a signed link no frame is delivered
//! that was not verified, but for the configured list, none is delivered twice, and only a verified
//! frame moves the peer. Our own heartbeats go out at 1 Hz unprompted: they are what lifts the stamps
//! of a vehicle that has restarted.

mod config;
mod event;
mod freshness;
mod machine;
mod peer;
mod pin;
mod presence;
mod receive;
pub mod receiver;
mod send;
mod stats;

pub use self::config::{LinkConfig, Role, Security};
pub use self::event::{Alert, Event, KeyExchangeFrame};
pub use self::freshness::Age;
pub use self::machine::{Auth, Link};
pub use self::peer::{Endpoint, UNSIGNED_SILENCE};
pub use self::presence::LinkState;
pub use self::receive::Delivery;
pub use self::send::{SendError, Sent};
pub use self::stats::LinkStats;
