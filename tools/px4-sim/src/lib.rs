//! A simulated PX4 v1.18, as honest as what was seen of the real one on the wire.
//!
//! Layers, each usable alone:
//! - [`Vehicle`]: physics, commander, navigator and the MAVLink services, without socket or clock.
//!   Messages and time go in, messages come out; the same seed gives the same flight.
//! - [`Autopilot`]: the vehicle behind its links: frames, PX4's signing with its falls, the lock
//!   on the first sender. Datagrams and time go in, datagrams come out.
//! - [`Simulator`]: an autopilot on UDP sockets with a clock, as the `px4-sim` program and the
//!   demo run it.

mod attitude;
mod autopilot;
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
mod key_file;
mod link;
mod maneuvers;
mod mission;
mod mission_course;
mod mode;
mod motion_reports;
mod navigator;
mod operator;
mod params;
mod plane;
pub mod program;
mod quad;
mod reports;
mod rng;
pub mod services;
mod signing;
mod signing_file;
mod simulator;
mod steering;
mod streams;
mod texts;
mod tick;
mod trajectory;
mod vehicle;
mod view;

pub use autopilot::{Autopilot, LinkCounters, Transmit};
pub use config::{Airframe, Config};
pub use geo::{Geodetic, LocalFrame, Ned};
pub use key_file::{KeyFileError, read_key_file};
pub use link::{LinkAddress, LinkAddressError};
pub use mavlink_link::service::param::Value;
pub use mode::Mode;
pub use params::{Param, Params};
pub use signing::{Admission, Refusal, Setup, Signing};
pub use simulator::{Counters, Simulator, SimulatorConfig, SimulatorError};
pub use vehicle::{HealthFaults, Outgoing, TICK, Truth, Vehicle, VehicleCounters};
