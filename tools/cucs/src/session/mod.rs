//! The CUCS as a state machine without socket or clock.
//!
//! - [`traffic`]: counters of messages sent, received and dropped;
//! - [`sender`]: messages on their way to the VSM: time stamps, window, retransmission;
//! - [`alert`]: 16000s with a text in several messages;
//! - [`vehicle`]: what one vehicle last reported;
//! - [`edition_25`]: the border to VSMs of Edition 2.5;
//! - [`machine`]: the session that joins them: datagrams and time in, datagrams and events out.

pub(crate) mod alert;
pub(crate) mod edition_25;
pub(crate) mod machine;
pub(crate) mod sender;
pub(crate) mod traffic;
pub(crate) mod vehicle;
