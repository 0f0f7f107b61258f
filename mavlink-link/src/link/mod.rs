//! One physical link to one vehicle: parser, receiver, peer lock and sender in one machine.
//!
//! The caller owns sockets, clocks, keys and disk. It passes what arrives to [`Link::handle_datagram`], calls
//! [`Link::handle_timeout`] at the time of [`Link::poll_timeout`], and after each of the two sends what
//! [`Link::poll_transmit`] writes and reads [`Link::poll_event`].
//!
//! Promised: foreign input never panics, blocks or allocates; on a signed link no frame is delivered
//! that was not verified, except those of a configured list, none is delivered twice, and only a verified
//! frame moves the peer. Our own heartbeats are sent at 1 Hz unprompted: PX4's timestamps are not wall clock, and fall
//! back when it restarts; a verified frame of ours lifts them again.
//!
//! Order of the parts: `config`, `receiver` (which frames of a key are accepted), `peer` (who the peer is, and whether it
//! is live), `lift` (who is sent the heartbeats that lift timestamps), `path` (which of two addresses leads to it),
//! `challenge` (how clocks that are apart find together), `freshness` (how old a frame can be), `pin` (which link id the
//! autopilot uses here), `report` (events and counters), `machine` (the state), `receive` and `send`.
//!
//! ```
//! use core::time::Duration;
//! use mavlink_link::Now;
//! use mavlink_link::clock::Origin;
//! use mavlink_link::frame::MAX_FRAME;
//! use mavlink_link::link::{Auth, Endpoint, Link, LinkConfig, Security};
//! use mavlink_link::receiver::KeyState;
//! use mavlink_link::signing::{SigningKey, Stamp};
//! # use mavlink_link::store::{Disk, Durability, StoreError};
//! # #[derive(Default)]
//! # struct Files(std::collections::BTreeMap<String, Vec<u8>>);
//! # impl Disk for Files {
//! #     fn read(&self, name: &str, _: u64) -> Result<Option<zeroize::Zeroizing<Vec<u8>>>, StoreError> {
//! #         Ok(self.0.get(name).cloned().map(zeroize::Zeroizing::new))
//! #     }
//! #     fn replace(&mut self, name: &str, bytes: &[u8], _: Durability) -> Result<(), StoreError> {
//! #         self.0.insert(name.to_owned(), bytes.to_vec());
//! #         Ok(())
//! #     }
//! #     fn append(&mut self, _: &str, _: &[u8], _: Durability) -> Result<(), StoreError> { Ok(()) }
//! #     fn rename(&mut self, _: &str, _: &str) -> Result<(), StoreError> { Ok(()) }
//! #     fn remove(&mut self, _: &str) -> Result<(), StoreError> { Ok(()) }
//! # }
//!
//! let now = Now { mono: Duration::ZERO, wall: Duration::from_secs(1_795_219_200) };
//! let mut disk = Files::default();
//! let key = SigningKey::new([7; 32])?;
//! let mut key = KeyState::start(key, Origin::KeyFile, Stamp::ZERO, now, &mut disk)?;
//! // A vehicle of system id 1 at a fixed address; here an address is a port number.
//! let mut link = Link::<u16>::new(LinkConfig::new(1, Security::Signed, Endpoint::Fixed(14_580)));
//!
//! link.handle_timeout(now);
//! let mut out = [0; MAX_FRAME];
//! let auth = Auth::Signed { key: &mut key, store: &mut disk };
//! let heartbeat = link.poll_transmit(now, auth, &mut out).expect("the first heartbeat is due");
//! assert_eq!(heartbeat.to, 14_580);
//! let datagram = out[..heartbeat.len].to_vec();
//!
//! // Our own frame, reflected: it verifies, and is still not delivered.
//! let auth = Auth::Signed { key: &mut key, store: &mut disk };
//! link.handle_datagram(now, 14_580, &datagram, auth, &mut |delivery| panic!("{delivery:?}"));
//! assert_eq!(link.stats().reflected, 1);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

pub(crate) mod challenge;
mod config;
mod freshness;
mod lift;
mod machine;
mod path;
mod peer;
mod pin;
mod receive;
pub mod receiver;
mod report;
mod send;

pub use self::config::{LinkConfig, Role, Security};
pub use self::freshness::Age;
pub(crate) use self::lift::{Lifts, Rising};
pub use self::machine::{Auth, Link};
pub use self::peer::{Endpoint, LinkState, UNSIGNED_SILENCE};
pub use self::receive::Delivery;
pub use self::report::{Alert, Event, KeyExchangeFrame, LinkStats};
pub use self::send::{SendError, Sent};
