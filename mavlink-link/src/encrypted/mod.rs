//! The encrypted link: MAVLink between the ground and the air-side agent, inside packets of one size that nobody else can
//! read, make or play again.
//!
//! A machine without clock, socket, disk or randomness, the same at both ends ([`EncryptedLink`]): MAVLink frames go in
//! by [`send`](EncryptedLink::send) and come out of [`handle`](EncryptedLink::handle) at the other end; what goes over the
//! radio comes from [`poll_transmit`](EncryptedLink::poll_transmit). Signing stays as it is, inside.
//!
//! Promised, each by a test of its own (`tests/key_exchange/encrypted`):
//!
//! - Nothing that was sent before keys were agreed on, under other keys, by another station, or that was changed, passes;
//!   nothing passes twice, over restarts of both ends too. Every drop has a name ([`Dropped`]).
//! - No frame of MAVLink leaves in the clear but KEY_EXCHANGE (229): the exchange of the link itself (suite 1), and that of
//!   a pairing (suite 2). No other is taken in the clear. There is no setting, and no message, that changes this.
//! - No nonce is used twice under one key: each run of either end has keys of its own, made of fresh random numbers of
//!   both; the counter begins at 1 and never turns over; and the epoch, which is in the nonce, is on the disk before the
//!   first packet, so that a random source that repeats itself, or a store that was put back, is not enough to have a
//!   nonce again. It would take both ends put back, the disks and the random numbers.
//! - After loss, noise or a restart of either end packets pass again within a second of the link working, also while
//!   somebody floods an end that listens, as long as the other end is where it was. Where somebody on the way works against
//!   it, within the times at the end of `endpoint`.
//!
//! Not promised: that nobody sees that, when, how much and between whom something is sent; that a link which somebody
//! jams works. Suite and cipher are fixed ([`LINK_POLICY`]), so there is nothing to downgrade to. Where a processor has
//! no AES of its own the cipher runs in constant time all the same, only slower.
//!
//! On the wire: 7e ‖ kind ‖ body ‖ 7e (`framing`). A packet (kind 0) is id ‖ counter ‖ 80 bytes, encrypted ‖ tag of 8
//! (`packet`); the 80 bytes are `first` ‖ `used` ‖ at most 78 bytes of MAVLink, where `first` is the offset of the first
//! frame that begins in it (`sealer`, `opener`), so that a lost packet costs the frames that lie in it and no other. An end that has
//! nothing to send sends a packet without a frame now and then, so that silence means something.
//! Kind 1 is for the radio at this end, kind 2 a KEY_EXCHANGE in the clear.
//!
//! Order of the parts: `config`, `framing`, `packet`, `sealer`, `opener`, `record` (the disk), `exchange` (how the keys come
//! about), `places` (where the other end may be), `endpoint` (the machine), `stats`.

mod config;
mod endpoint;
mod exchange;
mod framing;
mod opener;
mod packet;
mod places;
mod record;
mod sealer;
mod stats;

pub use self::config::{Carrier, EncryptedConfig};
pub use self::endpoint::{EncryptedEvent, EncryptedLink, EncryptedState};
pub use self::exchange::{LINK_POLICY, Role};
pub use self::framing::{MAX_CONTENT, MAX_WIRE};
pub use self::record::{ENCRYPTED, EncryptedRecord};
pub use self::sealer::bytes_on_radio;
pub use self::stats::{Dropped, EncryptedStats};
