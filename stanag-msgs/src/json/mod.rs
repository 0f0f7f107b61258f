//! Messages as JSON, by the table alone: what `vsm decode` and `vsm encode` do.
//!
//! ```
//! use stanag_msgs::json::{decode_line, encode_line};
//!
//! let line = r#"{"id": 3001, "source": "1b:00:01:01", "destination": "ff:ff:ff:ff",
//!     "fields": {"Select Flight Path Control Mode": "loiter"}}"#.replace('\n', " ");
//! let hex = encode_line(&line, false)?;
//! assert_eq!(hex, "000000021b000101ffffffff0bb92000020c");
//! assert_eq!(decode_line(&hex, false)[0]["fields"]["Select Flight Path Control Mode"], "loiter");
//! # Ok::<(), stanag_msgs::json::JsonError>(())
//! ```
//!
//! A message is `{"id", "name", "source", "destination", "ack", "idd", "checksum", "fields"}`; the
//! fields are named as in the table, and only those present are listed. A message to encode that has another key is refused.
//!
//! A message of Edition 2.5 is `{"id", "name", "idd", "instance", "fields"}`: `idd` is the text of its wrapper (`"2.5"`), and
//! sender and receiver are among the fields. All fields must be given, but for a raw one: there a field left out is sent as
//! zero.
//!
//! | wire | raw | otherwise |
//! |---|---|---|
//! | integers, BAM | the integer on the wire | times the step, in the unit of the table |
//! | time stamps | ms since 2000 | the same |
//! | enumerations | the integer | the text of the table, or the integer where it has none |
//! | bitmaps | the integer | a list of the texts of the bits, unknown bits as integers |
//! | f32, f64 | the number that it equals exactly | the same |
//! | not finite | `"NaN"`, `"Infinity"`, `"-Infinity"`; another NaN with its bits, `"NaN:7f800001"` | the same |
//! | text | the characters before the first NUL | the same, others than 7-bit as `?` |
//!
//! In a raw text a byte that is not 7-bit is the Unicode character of the same number, both ways, so
//! nothing before the first NUL is lost; what follows it is. A text too long is cut when raw, to leave
//! room for its NUL; otherwise it is an error, as is a value outside its range. Integers never lose a bit.

mod decode;
mod encode;
mod number;

pub use decode::{decode, decode_line, fields, frame, frame_ed25};
pub use encode::{JsonError, encode, encode_line};
