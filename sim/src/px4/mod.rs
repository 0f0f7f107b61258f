//! A simulated PX4 v1.18, as honest as what was seen of the real one on the wire.
//!
//! Layers, each usable alone:
//! - [`Vehicle`]: physics, commander, navigator and the MAVLink services, without socket or clock.
//!   Messages and time go in, messages come out; the same seed gives the same flight.

mod attitude;
mod body;
mod command;
mod commander;
mod config;
mod dispatch;
mod estimator;
mod fence;
mod geo;
mod guidance;
mod inbox;
mod mission;
mod mode;
mod navigator;
mod params;
mod plane;
mod quad;
mod reports;
mod rng;
mod steering;
mod streams;
mod texts;
mod trajectory;
mod vehicle;

pub use config::{Airframe, Config};
pub use geo::{Geodetic, LocalFrame, Ned};
pub use mavlink_link::service::param::Value;
pub use mode::Mode;
pub use params::{Param, Params};
pub use vehicle::{Outgoing, TICK, Truth, Vehicle, VehicleCounters};
