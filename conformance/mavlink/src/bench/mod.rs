//! The base of the scenes: sockets with a recording ([`net`]), the station that the suite plays ([`peer`]), and what
//! a scene is given ([`trial`]).

pub mod net;
pub mod peer;
pub mod trial;

pub use net::{Net, Port, Seen};
pub use peer::Peer;
pub use trial::{Bench, Trial};
