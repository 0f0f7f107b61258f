//! The configuration phase: what a CUCS must know of the vehicle to build its screens and commands, as the messages
//! 41000 to 41005, 43000, 43001 and 44003 that answer a 40000.
//!
//! - A field that can be used is answered by the message of its kind: 41000 for signed integers and angles, 41003 for
//!   unsigned ones, 41001 for floats, 41002 for enumerations, 41004 for texts. Values are in steps of the field on the
//!   wire, so that a command is built of them as they are; the help text has the unit and the source.
//! - A field that is not used, a message that is not supported, and a value of an enumeration that is refused, are
//!   reported by 44003: Reported Field 0 is the whole message, and an Enumerated Index is the value itself.
//! - Values of this VSM's own (modes, states) are described one by one by 41002.
//! - What is not known, such as home before the vehicle has reported it, is absent.
//! - What a command of another station, or the vehicle itself, has set since is reported by 44000 and 44002 ([`changes`]).
//! - Parameters that the configuration chooses are controls: fields of 50011, with values by 44000 and 44001
//!   ([`Controls`]).

mod answer;
mod bounds;
pub mod changes;
mod controls;
mod request;
#[cfg(test)]
mod tests;

pub use answer::answers;
pub use bounds::{Bounds, Subject, bounds};
pub use controls::{Change, Controls, ValuesBy};
pub use request::{Level, Request, RequestError, Scope};
