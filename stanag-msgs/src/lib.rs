//! STANAG 4586 Edition 4 (AEP-84 Vol II) DLI messages: wrapper, scalars, one message table, codec.
//!
//! Everything here is a pure function of bytes: no clock, no I/O, no allocation in the codec.
//! Decoding is total: any bytes give a value or an error that says where and why.
//!
//! ```
//! use stanag_msgs::{Bam32, Envelope, Id, Message, frames, messages::InertialStates};
//!
//! let states = InertialStates { latitude: Some(Bam32::from_degrees(47.5)), ..Default::default() };
//! let mut datagram = [0; stanag_msgs::MAX_DATAGRAM];
//! let length = Message::from(states.clone())
//!     .encode(&Envelope::new(Id(0x1b00_0101), Id::BROADCAST), &mut datagram)?;
//!
//! for frame in frames(&datagram[..length]) {
//!     let frame = frame?;
//!     let message = Message::decode(frame.header.message_type, frame.data)?;
//!     assert_eq!(message, Message::InertialStates(states.clone()));
//! }
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

#![forbid(unsafe_code)]

pub mod codec;
pub mod disputed;
pub mod enums;
pub mod id;
pub mod json;
pub mod pcapng;
pub mod profile;
pub mod scalar;
pub mod table;
pub mod vectors;
pub mod wrapper;

pub use codec::{DecodeError, EncodeError};
pub use id::Id;
pub use profile::Profile;
pub use scalar::{Bam16, Bam32, I24, OutOfRange, Scaled, Text, TimeStamp, U24, U40};
pub use table::{Body, Message, messages};
pub use wrapper::{
    ChecksumStyle, Envelope, Frame, Header, MAX_DATAGRAM, Packer, WrapperError, frames,
};
