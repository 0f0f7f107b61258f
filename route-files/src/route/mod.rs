//! Routes: what an operator plans, the file it is kept in, and the messages that carry it.
//!
//! A route is what is to be sent, not what can be flown: whether waypoints hang together, legs are short enough and
//! altitudes safe is the VSM's to judge, and a station that sends it nonsense gets to see how it is refused. Only
//! what no message can carry is refused here.
//!
//! - [`model`]: the route itself;
//! - [`form`]: keys and words of a route file; [`mod@read`] and [`mod@write`] the two directions;
//! - [`messages`]: into messages, and back from a download.

pub mod form;
pub mod messages;
pub mod model;
pub mod read;
pub mod write;
