//! Edition 2.5 of the DLI (February 2007), complete, from its public text; also with the numbers of Edition 2 and its
//! Amendment 1.
//!
//! Edition 2.5 differs from the later ones in everything around the data: a wrapper of 34 bytes without source and
//! destination (they are fields 2 and 3 of each message), no presence vector (each field is always sent), no
//! acknowledgement bit, and a checksum that is the sum of the bytes. The first byte of a datagram is an ASCII digit,
//! which no later edition has there: [`is_ed25`] distinguishes them, so that one port serves all.
//!
//! Parts: `values` (enumerations and bitmaps), `table` (one row for each message, in the form of the Edition 4 table:
//! [`MessageInfo`](crate::table::MessageInfo) with a presence vector of no bytes), `wrapper` (splitting a datagram, and
//! writing one), [`record`] (a message of any edition as values in units, and the way of each field from one edition to the
//! other), `correspondence` (what of Edition 4 is where). [`walk`](crate::table::walk) reads the fields of the data,
//! [`json`](crate::json) shows and writes them.
//!
//! ```
//! use stanag_msgs::ed25;
//! use stanag_msgs::json::{decode_line, encode_line};
//!
//! let line = r#"{"id": 42, "idd": "2.5", "instance": 7, "fields": {"Time Stamp": 1163000000.0,
//!     "Vehicle ID": 452984833, "CUCS ID": 452984992, "Select Flight Path Control Mode": "loiter (#41)"}}"#;
//! let hex = encode_line(&line.replace('\n', " "), false)?;
//! assert!(hex.starts_with("322e35")); // "2.5"
//! assert_eq!(decode_line(&hex, true)[0]["fields"]["Select Flight Path Control Mode"], 12);
//! assert_eq!(ed25::message(42, ed25::Version::Ed25).unwrap().full_bytes(), 17);
//! # Ok::<(), stanag_msgs::json::JsonError>(())
//! ```

mod correspondence;
pub mod record;
pub mod table;
pub(crate) mod values;
mod wrapper;

pub use correspondence::{Parties, commands_of, ed4_of, parties, places, plan_record, reports_of};
pub use record::{Fault, Record, Value};
pub use table::{message, messages, named};
pub use wrapper::{
    Frame, Frames, HEADER_BYTES, Header, MAX_DATA, TRAILER_BYTES, Version, encode, frames, is_ed25,
};
