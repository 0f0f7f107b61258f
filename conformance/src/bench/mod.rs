//! The bench: sockets, clock and recording, and the stations that a scene plays.
//!
//! Bottom to top: [`tape`], [`listener`] and [`remarks`] are shared with `mavlink-check`; [`net`] opens sockets and
//! records every datagram with time and direction; [`survey`] and [`fix`] hold what is known of the subject;
//! [`context`] outlives a scene; [`station`] is a CUCS of the suite; [`discovery`] makes the survey; [`trial`] is
//! what a rule's scene is given; [`flight`] has what several rules begin with: a route, a launch, a landing.

pub mod context;
pub mod discovery;
pub mod fix;
pub mod flight;
pub mod listener;
pub mod net;
pub mod remarks;
pub mod station;
pub mod survey;
pub mod tape;
pub mod trial;
