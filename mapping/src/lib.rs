//! Pure functions between STANAG 4586 and MAVLink: no state, no clock, no I/O.
//!
//! - [`plan`]: the routes and waypoints that a CUCS has sent, as DLI messages, and what is wrong with one by itself.
//! - [`route`]: a route of a plan becomes mission items, or a refusal that names the waypoint.
//! - [`mode`]: flight path control modes and PX4's modes.
//! - [`altitude`]: altitude types and MAVLink frames.
//! - [`telemetry`]: what a vehicle has said of itself, from its messages.
//! - [`report`]: messages 3001, 3002, 4000 and 4001 from that.
//! - [`sensed`]: what its sensors have told beyond that.
//! - [`status`]: messages 3000, 3004 to 3010, 12101 and 16001.
//! - [`alert`]: texts and faults to message 16000.
//! - [`configuration`]: the answers of the configuration phase, from what the vehicle is.
//! - [`support`]: what is done with each field of each message.

pub mod alert;
pub mod altitude;
pub mod configuration;
pub mod curve;
mod loiter;
mod loops;
pub mod mode;
pub mod plan;
pub mod report;
pub mod route;
pub mod sensed;
pub mod status;
pub mod support;
pub mod telemetry;
