//! The bench: sockets, clock and recording, and the stations that a scene plays.
//!
//! Bottom to top: [`net`] opens sockets and records every datagram with time and direction; [`station`] is a CUCS of
//! the suite; [`survey`] finds out by discovery who may do what; [`trial`] is what a rule's scene is given; [`flight`]
//! are the scenes that several rules begin with: a route, a launch, a landing.

pub mod flight;
pub mod net;
pub mod station;
pub mod survey;
pub mod trial;
