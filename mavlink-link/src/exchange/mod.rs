//! Agreement on signing keys over the air, in KEY_EXCHANGE (229) frames: Noise KK between pinned static keys, Noise XXpsk3
//! once for pairing, each confirmed by both ends.
//!
//! Two machines without clock, socket, disk or randomness: the [`Initiator`] on the ground (the VSM), and the
//! [`Responder`] in the air (the agent beside the autopilot). Time, random bytes and the disk are arguments;
//! payloads are inputs, [`Message`]s are outputs. The caller frames, signs and sends them
//! ([`Link::send_raw`](crate::link::Link::send_raw)).
//!
//! Promised, and each tested by running both ends against each other under loss, duplication, reordering, delay and
//! restart between any two disk writes:
//!
//! - a peer with neither a static key nor the pairing code changes nothing but counters;
//! - a key that the responder may install in the autopilot is always on the initiator's disk: there is no state in which
//!   the vehicle signs with a key that the ground does not have;
//! - no key is replaced on silence.
//!
//! Order of the parts: `message` (the bytes of 229), `identity` (static keys), `pairing` (the code), `terms` (what both
//! ends agree on beside the secrets), `gate` (who may start a handshake), `noise` (the handshake), `keys` (what is derived
//! from it), `store` (what must be on disk at which step), `initiator` and `responder` (the two machines), `stats`; `callers`
//! is where a message goes while nothing shows where the peer is, `order` the order to zeroize between paired ends, `legacy`
//! the unauthenticated exchange.
//!
//! A caller must keep on disk: its [`Identity`], the peer's [`PublicKey`], the counter, the epoch, and the keys
//! `current` and `next`. [`InitiatorStore`] and [`ResponderStore`] define when, [`InitiatorMemory`] and
//! [`ResponderMemory`] what a new process starts with.
//!
//! ```
//! use core::time::Duration;
//! use mavlink_link::Now;
//! use mavlink_link::exchange::*;
//!
//! // A disk that only remembers the last key.
//! #[derive(Default)]
//! struct Disk(Option<mavlink_link::signing::KeyId>);
//! impl InitiatorStore for Disk {
//!     fn store_counter(&mut self, _: u64) -> Result<(), StoreError> { Ok(()) }
//!     fn promote_next(&mut self) -> Result<(), StoreError> { Ok(()) }
//!     fn store_next(&mut self, agreed: &Agreed) -> Result<(), StoreError> {
//!         self.0 = Some(agreed.key.id());
//!         Ok(())
//!     }
//!     fn drop_next(&mut self) -> Result<(), StoreError> { Ok(()) }
//!     fn pin(&mut self, _: &PublicKey) -> Result<(), StoreError> { Ok(()) }
//! }
//! impl ResponderStore for Disk {
//!     fn withdraw_next(&mut self) -> Result<(), StoreError> { Ok(()) }
//!     fn store_agreed(&mut self, _: &PinnedPeer, agreed: &Agreed) -> Result<(), StoreError> {
//!         self.0 = Some(agreed.key.id());
//!         Ok(())
//!     }
//! }
//!
//! // The system's random source in a program; here a counter will do.
//! let mut seed = 0_u8;
//! let mut random = |out: &mut [u8]| {
//!     out.iter_mut().for_each(|byte| { seed = seed.wrapping_mul(5).wrapping_add(3); *byte = seed });
//!     Ok(())
//! };
//! let (ground, air) = (Node { system: 245, component: 190 }, Node { system: 1, component: 191 });
//! let parties = Parties::new(ground, air, 0x1b00_0001, 0x1b00_0101);
//! let wanted = Wanted { signing: true, confidential: false };
//! let code = PairingCode::generate(&mut random)?;
//!
//! let config = ResponderConfig { parties, identity: Identity::generate(&mut random)?, wanted };
//! let (mut responder, mut air_disk) = (Responder::new(config, ResponderMemory::default(), Duration::ZERO), Disk::default());
//! responder.open_window(Duration::ZERO, &code, &mut air_disk)?;
//!
//! let trust = Trust::Pairing(code);
//! let config = InitiatorConfig { parties, identity: Identity::generate(&mut random)?, trust, wanted };
//! let (mut initiator, mut ground_disk) = (Initiator::new(config, InitiatorMemory::default(), Duration::ZERO), Disk::default());
//! initiator.want();
//!
//! let now = Now { mono: Duration::ZERO, wall: Duration::from_secs(1_800_000_000) };
//! initiator.handle_timeout(now, &mut random, &mut ground_disk);
//! while let Some(message) = initiator.poll_transmit() {
//!     let payload = message.to_payload();
//!     let inbound = Inbound { from: (), source: ground, verified: false, payload: &payload };
//!     responder.handle(now.mono, inbound, &mut random, &mut air_disk)?;
//!     while let Some(answer) = responder.poll_transmit() {
//!         let payload = answer.message.to_payload();
//!         let inbound = Inbound { from: (), source: air, verified: false, payload: &payload };
//!         initiator.handle(now, inbound, &mut ground_disk)?;
//!     }
//! }
//! assert!(ground_disk.0.is_some());
//! assert_eq!(ground_disk.0, air_disk.0);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

mod callers;
mod gate;
mod identity;
mod initiator;
mod keys;
mod legacy;
mod message;
mod noise;
mod order;
mod pairing;
mod responder;
mod stats;
mod store;
mod terms;

pub use self::callers::Callers;
pub use self::identity::{Fingerprint, Identity, NoRandom, PublicKey, Random};
pub use self::initiator::{Initiator, InitiatorConfig, InitiatorEvent, KeyInForce, Trust};
pub use self::keys::{Agreed, ConfidentialKeys};
pub use self::legacy::Legacy;
pub use self::message::{
    Data, Inbound, MAX_DATA, MAX_MESSAGE, Message, MessageError, Received, Status, Step, Suite,
    VERSION,
};
pub use self::order::{AutopilotKey, ZeroizeRefusal, ZeroizeReport};
pub use self::pairing::{CodeError, PairingCode};
pub use self::responder::{Outbound, Responder, ResponderConfig, ResponderEvent, WindowError};
pub use self::stats::{ExchangeStats, Ignored};
pub use self::store::{
    InitiatorMemory, InitiatorStore, PinnedPeer, ResponderMemory, ResponderStore, StagedKey,
    StoreError,
};
pub use self::terms::{GUARD_POLICY, POLICY, Parties, VehicleState, Wanted, policy_digest};
pub use crate::frame::Node;
