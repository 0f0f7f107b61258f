//! A simulated PX4 v1.18 that behaves as the real one was observed to behave on the wire.
//!
//! Layers, each usable alone:
//! - [`Vehicle`]: physics, commander, navigator and the MAVLink services, without socket or clock.
//!   Messages and time go in, messages come out; the same seed gives the same flight.
//! - [`Autopilot`]: the vehicle behind its links: frames, PX4's signing with its pitfalls, the lock
//!   on the first sender. Datagrams and time go in, datagrams come out.
//! - [`Simulator`]: an autopilot on UDP sockets with a clock, as the `px4-sim` program and the
//!   demo run it.
//!
//! The folders, each built on those before it: `physics` (where the vehicle is and how it moves), `flight` (PX4's
//! commander and navigator), `services` (streams, texts, uploads), `payload` (gimbals and
//! cameras), `vehicle` (all of it joined, stepped at 250 Hz),
//! `link` (frames and signing).
//!
//! ```
//! use std::time::Duration;
//! use px4_sim::{Config, Mode, Vehicle};
//!
//! let mut vehicle = Vehicle::new(Config::default());
//! vehicle.step(Duration::from_secs(10));
//! assert_eq!(vehicle.truth().mode, Mode::Loiter);
//! let first = vehicle.poll_transmit().expect("a booted PX4 sends HEARTBEAT unrequested");
//! assert!(first.message().is_some());
//! ```

mod config;
mod flight;
mod key_files;
mod link;
mod link_address;
mod payload;
mod physics;
pub mod program;
pub mod services;
mod simulator;
mod vehicle;

pub use config::{Airframe, Config, Param, Params};
pub use flight::mode::Mode;
pub use key_files::{KeyFileError, read_key_file};
pub use link::autopilot::{Autopilot, LinkCounters, Transmit};
pub use link::signing::{Admission, Refusal, Setup, Signing};
pub use link_address::{LinkAddress, LinkAddressError};
pub use mavlink_link::service::param::Value;
pub use payload::PayloadTruth;
pub use physics::motion::{Geodetic, LocalFrame, Ned};
pub use physics::vtol::VtolState;
pub use services::files::{Files, Loaded};
pub use simulator::{Counters, Simulator, SimulatorConfig, SimulatorError};
pub use vehicle::actions::Actions;
pub use vehicle::ground::GroundGrid;
pub use vehicle::state::{
    ClockFault, HealthFaults, Outgoing, TICK, Truth, Vehicle, VehicleCounters,
};
